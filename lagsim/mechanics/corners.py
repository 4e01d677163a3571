"""Corners of equalities: rows that jump at a surface, and the force that holds there.

The constraint of a wire y = k*abs(x) has a different row on each side of x = 0. At the
corner both rows hold, and the motion can stay there: the constraint force is then a
combination of the forces of both sides,

    ((1 - w) A_low + w A_high)^T lambda = A_low^T lambda + w C lambda du/dq,

since the rows of a continuous relation differ only by a multiple C of du/dq, where
u(q, t) = 0 is the equation of the surface. A force p du/dq added to the row of the
lower side, with the push p as its multiplier, therefore replaces the row of the upper
side and keeps u at 0. The motion leaves the corner where the share of the upper side,
w = p / (C lambda), leaves [0, 1]: the row of one side alone then leads away from the
corner. Where the applied force jumps at the surface too, by d du/dq, the push is
p = w (C lambda + d).

A relation of velocities, y' = k*abs(x'), has its corner at a surface u(q', q, t) = 0,
and du/dq' takes the place of du/dq. So has a limited relation of velocities, whose
multiplier lambda is at its bound while it slides.

Source: P. Lotstedt, Mechanical systems of rigid bodies subject to unilateral
constraints, SIAM J. Appl. Math. 42, 1982, section 2, on corners as intersections.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.language.derivatives import gradient
from lagsim.mechanics.constraints import LIMITED
from lagsim.mechanics.surfaces import Corner

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.switches import Switches


def corners(e: Equations, switches: Switches) -> dict[int, Corner]:
    """Locate the corners of equalities, by their index in `switches.sides`.

    Parameters
    ----------
    e : Equations
        The equations, without the forces of `with_pushes`.
    switches : Switches
        The switches of `e`.

    Returns
    -------
    dict
        Index of the side -> its corner. Surfaces at which no row of an equality jumps
        have none.
    """
    limited = [x.role is LIMITED for x in e.relations]
    some = [(r, x.row) for r, x in enumerate(e.relations) if x.equal or limited[r]]
    if not some or not switches.sides:
        return {}
    g, fast = e.graph, frozenset(e.velocities)
    slopes = {r: switches.freeze(list(row.A)) for r, row in some}
    followers = _followers(g, switches)
    found = {}
    for k, side in enumerate(switches.sides):
        own = {g.variable(x) for x in followers[k]}
        (u,) = switches.freeze([side.node])
        moving = bool(fast & g.depends([u]))
        bent = [(r, row) for r, row in some if not own.isdisjoint(g.cone(slopes[r]))]
        if not bent:
            continue
        J = gradient(g, u, _variables(e, moving=moving))
        square = g.product_sum((x, x) for x in J)
        if square == g.zero:
            continue
        levers = [g.zero] * (1 + len(e.multipliers))
        levers[0] = _along(g, switches.freeze(e.f), J, square)
        for r, _ in bent:
            levers[1 + r] = _along(g, slopes[r], J, square)
        names = tuple(row.name for _, row in bent)
        equal = not all(limited[r] for r, _ in bent)
        found[k] = Corner(f"push.{k}", tuple(levers), names, moving, equal)
    return found


def _variables(e: Equations, *, moving: bool) -> Sequence[int]:
    """Return the variables q (n,), or q' if `moving`, of the gradient of a surface."""
    return e.flow.rates if moving else e.flow.positions


def _followers(g: Graph, switches: Switches) -> list[frozenset[str]]:
    """Return, for each side, its mode variable and those that may change with it.

    A side may change with another side if its expression depends on that side, directly
    or through further sides. The argument of `abs(mod(x, 2) - 1)` jumps with the
    `floor` of `mod`, from 1 to -1, where the value of `abs` is continuous.

    switches : the switches of the equations.
    """
    nodes = switches.freeze([x.node for x in switches.sides])
    pairs = [*zip(switches.sides, nodes, strict=True)]
    found = []
    for side in switches.sides:
        changed = {side.variable}
        rest = [(x.variable, n) for x, n in pairs if x is not side and not x.whole]
        while more := [x for x in rest if changed & g.depends([x[1]])]:
            changed |= set(dict(more))
            rest = [x for x in rest if x not in more]
        found.append(frozenset(changed))
    return found


def _along(g: Graph, rows: list[int], J: list[int], square: int) -> int:
    """Return the component of a row along a surface's gradient, divided by |J|.

    Parameters
    ----------
    rows : list of int, length n
        The row, as nodes of mode variables.
    J : list of int, length n
        du/dq of the surface u = 0.
    square : int
        J . J.
    """
    return g.call("div", g.product_sum(zip(rows, J, strict=True)), square)


def with_pushes(
    e: Equations, switches: Switches, found: Mapping[int, Corner]
) -> Equations:
    """Return the equations with the force p du/dq of each corner added to f.

    Parameters
    ----------
    e : Equations
        The equations, without these forces.
    switches : Switches
        The switches of `e`.
    found : mapping
        The corners of `e` by the index of their side, from `corners`.

    Returns
    -------
    Equations
        With the pushes p as further variables. The power of a push at a surface that
        moves in time, or of velocities, is added to the work of each group that
        contains all coordinates of the surface.
    """
    g, f, works = e.graph, list(e.f), list(e.works)
    rates = [g.variable(name) for name in e.velocities]
    for k, corner in found.items():
        push, u = g.variable(corner.push), switches.sides[k].node
        J = gradient(g, u, _variables(e, moving=corner.moving))
        f = [
            g.call("add", a, g.call("mul", push, x)) for a, x in zip(f, J, strict=True)
        ]
        own = {name for name, x in zip(e.q, J, strict=True) if x != g.zero}
        power = g.call("mul", push, g.product_sum(zip(J, rates, strict=True)))
        for i, work in enumerate(works):
            moved = corner.moving or "t" in g.depends([u])
            if own <= work.coordinates and moved:
                works[i] = work._replace(rate=g.call("add", work.rate, power))
    return replace(e, f=tuple(f), works=tuple(works))
