"""Equality constraints on the graph: residuals, rates, the rows of A and b.

Holonomic g(q, t) = 0: A = dg/dq, its rate is A q' + g_t, and A q'' = b with
b = -(d/dt A q' + d/dt g_t) at constant q'. Nonholonomic phi(q, q', t) = 0: A = dphi/dq'
(Chetaev's rule where phi is not linear), its rate is phi, b = -(phi_q q' + phi_t).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lagsim.expressions.derivatives import gradient, tangent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.expressions.graph import Graph
    from lagsim.model import Constraint


@dataclass(frozen=True, slots=True)
class Row:
    """One equality constraint, as nodes.

    Attributes
    ----------
    residual : int
        g, or phi.
    rate : int
        What must vanish on the level of velocities: A q' + g_t, or phi.
    A : tuple of int, shape (n,)
    b : int
    transport : int
        A q' on the constraint: -g_t, or A q' for phi not homogeneous in q', else 0.
        Its product with lambda is the constraint's power.
    residual_scale, rate_scale : int
        The largest of the terms and of |q_i dg/dq_i| (of |q'_i d rate/d q'_i|): what a
        residual is compared with, so that units do not matter.
    """

    name: str
    holonomic: bool
    residual: int
    rate: int
    A: tuple[int, ...]
    b: int
    transport: int
    residual_scale: int
    rate_scale: int
    scleronomic: bool
    pfaffian: bool


def constraint_row(
    g: Graph, constraint: Constraint, q: Sequence[str], velocities: Sequence[str]
) -> Row:
    """Derive the row of an equality constraint."""
    node = constraint.relation.node
    positions = [g.variable(name) for name in q]
    rates = [g.variable(name) for name in velocities]
    names = g.depends([node])
    flow = dict(zip(positions, rates, strict=True))
    flow[g.variable("t")] = g.one
    holonomic = not names & frozenset(velocities)
    if holonomic:
        A = gradient(g, node, positions)
        drift = gradient(g, node, [g.variable("t")])[0]
        rate = g.call("add", g.product_sum(zip(A, rates, strict=True)), drift)
        transport = g.call("neg", drift)
        residual_scale = scale_of(g, node, positions, A)
    else:
        A = gradient(g, node, rates)
        rate = node
        degrees = g.degree(node, velocities)
        homogeneous = degrees is not None and len(degrees) == 1
        transport = g.zero if homogeneous else g.product_sum(zip(A, rates, strict=True))
        residual_scale = scale_of(g, node, rates, A)
    degrees = g.degree(rate, velocities)
    return Row(
        name=constraint.name,
        holonomic=holonomic,
        residual=node,
        rate=rate,
        A=tuple(A),
        b=g.call("neg", tangent(g, [rate], flow)[0]),
        transport=transport,
        residual_scale=residual_scale,
        rate_scale=scale_of(g, rate, rates, A),
        scleronomic="t" not in names,
        pfaffian=degrees is not None and degrees <= frozenset((0, 1)),
    )


def scale_of(
    g: Graph, node: int, variables: Sequence[int], slopes: Sequence[int]
) -> int:
    """Give the largest of the terms of `node` and of |v d node/d v|."""
    sizes = [g.call("abs", term) for term in _terms(g, node)]
    sizes += [
        g.call("abs", g.call("mul", v, slope))
        for v, slope in zip(variables, slopes, strict=True)
    ]
    largest = g.zero
    for size in sizes:
        largest = g.call("max", largest, size)
    return largest


def _terms(g: Graph, node: int) -> list[int]:
    """Give the addends of `node`, through sums, differences and signs."""
    stack, terms = [node], []
    while stack:
        n = stack.pop()
        if g.ops[n] in ("add", "sub", "neg"):
            stack.extend(g.args[n])
        else:
            terms.append(n)
    return sorted(set(terms))
