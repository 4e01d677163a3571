"""Corners of equalities: rows that bend at a surface, and what holds a motion there.

A wire y = k*abs(x) has another row on each side of x = 0. At its corner both hold, and
the motion with them: the force of the constraint is then a combination of those of both
sides,

    ((1 - w) A_low + w A_high)^T lambda = A_low^T lambda + w C lambda du/dq,

since the rows of a relation that is continuous differ by C du/dq alone, where u is what
the surface is at 0 of. So a force p du/dq on the lower side, the push, takes the place
of the other row, and holds u at rest. The motion leaves the corner where the share w of
the upper side, p / (C lambda), leaves [0, 1]: one of the sides alone would lead it away
then. A force that steps there too, by d, adds to what the share stands for: p = w (C
lambda + d).

Source: P. Lotstedt, Mechanical systems of rigid bodies subject to unilateral
constraints, SIAM J. Appl. Math. 42, 1982, section 2, on corners as intersections.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.language.derivatives import gradient
from lagsim.mechanics.surfaces import Corner

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.surfaces import Side
    from lagsim.mechanics.switches import Switches


def corners(e: Equations, switches: Switches) -> dict[int, Corner]:
    """Corners of equalities by the numbers of their sides, before anything pushes."""
    held = [(r, row) for r, row in enumerate(e.every_row) if _is_equality(e, r, row)]
    if not held or not switches.sides:
        return {}
    g, fast = e.graph, frozenset(e.velocities)
    slopes = {r: switches.freeze(list(row.A)) for r, row in held}
    found = {}
    for k, side in enumerate(switches.sides):
        variable = g.variable(side.variable)
        bent = [(r, row) for r, row in held if variable in g.cone(slopes[r])]
        (u,) = switches.freeze([side.node])
        if not bent or fast & g.depends([u]):
            continue
        J = gradient(g, u, e.flow.positions)
        square = g.product_sum((x, x) for x in J)
        if square == g.zero:
            continue
        levers = [g.zero] * (1 + len(e.multipliers))
        levers[0] = _along(g, side, switches.freeze(e.f), J, square)
        for r, _ in bent:
            levers[1 + r] = _along(g, side, slopes[r], J, square)
        names = tuple(row.name for _, row in bent)
        found[k] = Corner(f"push.{k}", tuple(levers), names)
    return found


def _is_equality(e: Equations, r: int, row: Row) -> bool:
    """Whether a row of positions holds on both sides, where it is in force."""
    law = e.laws[r - len(e.rows)] if r >= len(e.rows) else None
    return row.holonomic and (
        law is None or (law.when is not None and not law.kind.one_sided)
    )


def _along(g: Graph, side: Side, rows: list[int], J: list[int], square: int) -> int:
    """Jump of a row (n,) at a surface, in units of its gradient J (n,)."""
    variable = g.variable(side.variable)
    low, high = g.constant(-1.0), g.one
    if side.whole:
        low, high = variable, g.call("add", variable, g.one)
    ends = [g.substitute(rows, {variable: x}) for x in (high, low)]
    jumps = (g.call("sub", a, b) for a, b in zip(*ends, strict=True))
    return g.call("div", g.product_sum(zip(jumps, J, strict=True)), square)


def with_pushes(
    e: Equations, switches: Switches, found: Mapping[int, Corner]
) -> Equations:
    """Equations with a force at each corner, which holds a motion there."""
    g, f, works = e.graph, list(e.f), list(e.works)
    rates = [g.variable(name) for name in e.velocities]
    for k, corner in found.items():
        push, u = g.variable(corner.push), switches.sides[k].node
        J = gradient(g, u, e.flow.positions)
        f = [
            g.call("add", a, g.call("mul", push, x)) for a, x in zip(f, J, strict=True)
        ]
        own = {name for name, x in zip(e.q, J, strict=True) if x != g.zero}
        power = g.call("mul", push, g.product_sum(zip(J, rates, strict=True)))
        for i, work in enumerate(works):
            if own <= work.coordinates and "t" in g.depends([u]):
                works[i] = work._replace(rate=g.call("add", work.rate, power))
    return replace(e, f=tuple(f), works=tuple(works))
