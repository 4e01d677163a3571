"""Virtual separation: the force that holds a definition to its expression.

With x taken for a coordinate of its own, held by the constraint x = r(q, t), the
equation of x is

    d/dt dL/dx' - dL/dx = Q_x + sum_c lambda_c dg_c/dx + R_x,

and the motion, which is known, gives R_x: nothing is solved. R_x is the multiplier of
x - r = 0, the force on all that is written with x.
Source: C. Lanczos, The Variational Principles of Mechanics, section III.5 (the physical
meaning of the Lagrangian multiplier).
"""

from __future__ import annotations

from graphlib import TopologicalSorter
from typing import TYPE_CHECKING

from lagsim.language.derivatives import gradient, tangent
from lagsim.mechanics.equations import derive

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations


def reactions(e: Equations) -> dict[str, int]:
    """Give R_x of each definition that `output.reactions` names.

    Each with nothing but itself separated, as nodes of the state, q'' and lambda.
    """
    g = e.graph
    separated, expressions = e.model.separated()
    apart = derive(separated)
    own = dict(zip(apart.q, apart.motion_residuals(), strict=False))
    # All are separated at once: what is written with x through another definition
    # rests on x by the force that holds that one.
    users = {
        name: [
            other for other, node in expressions.items() if name in g.depends([node])
        ]
        for name in expressions
    }
    held: dict[str, int] = {}
    for name in TopologicalSorter(users).static_order():
        x = g.variable(name)
        rest = (
            (held[other], gradient(g, expressions[other], [x])[0])
            for other in users[name]
        )
        held[name] = g.call("add", own[name], g.product_sum(rest))
    nodes = g.substitute((held[name] for name in expressions), _motion(e))
    return dict(zip(expressions, nodes, strict=True))


def _motion(e: Equations) -> dict[int, int]:
    """Give what the separated definitions and their rates are along the motion."""
    g = e.graph
    seed = {g.variable("t"): g.one}
    for q in e.q:
        seed[g.variable(q)] = g.variable(f"{q}_dot")
        seed[g.variable(f"{q}_dot")] = g.variable(f"{q}_ddot")
    found = {d.name: d.node for d in e.model.definitions}
    names = e.model.output.reactions
    new: dict[int, int] = {}
    nodes = [found[name] for name in names]
    for order in ("", "_dot", "_ddot"):
        new |= dict(zip((g.variable(n + order) for n in names), nodes, strict=True))
        nodes = tangent(g, nodes, seed)
    return new
