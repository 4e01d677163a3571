"""Forces of bodies on chains, along the rates of positions in which L is written.

With L in u = d/dt x(q, t) beside q and q', Lagrange's equations are

    d/dt(dL/du) du/dq' + d/dt(dL/dq') - dL/dq = Q,    u and q' apart in each slope

for d/dt(du/dq') = du/dq: what the slopes of du/dq' would give twice, and cancels, is
never made. In articulated bodies this is the bias force.
Source: R. Featherstone, Rigid Body Dynamics Algorithms, chapter 5; T. R. Kane and
D. A. Levinson, Dynamics: Theory and Applications, section 4.11.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.derivatives import pulled, slopes, tangent
from lagsim.language.products import slow_factors_first
from lagsim.model.model import Level

if TYPE_CHECKING:
    from lagsim.mechanics.constraints import Flow
    from lagsim.model.model import Model


def inertial_forces(model: Model, flow: Flow) -> list[int]:
    """Give dL/dq - d/dt(dL/dq') at q'' = 0, shape (n,)."""
    g = model.graph
    rates = sorted(rates_of_places(model, flow))
    variables = frozenset((*rates, *flow.rates, *flow.positions))
    found = slopes(g, model.lagrangian, variables)
    moving = [v for v in (*rates, *flow.rates) if v in found]
    changes = tangent(g, [found[v] for v in moving], flow.forward)
    weights = {v: g.call("neg", x) for v, x in zip(moving, changes, strict=True)}
    along = pulled(g, weights, frozenset(flow.rates))
    forces = [
        g.call("add", found.get(q, g.zero), along.get(v, g.zero))
        for q, v in zip(flow.positions, flow.rates, strict=True)
    ]
    places = g.depends(flow.positions) | {"t"}
    return slow_factors_first(g, forces, places, flow.velocities)


def rates_of_places(model: Model, flow: Flow) -> dict[int, int]:
    """Give the rates of all positions in L, each with one; but no single velocities."""
    g = model.graph
    placed = (d.node for d in model.definitions if d.level is Level.POSITION)
    cone = g.cone([*placed, model.lagrangian])
    faster = g.dependent(cone, flow.velocities)
    places = [n for n in reversed(cone) if n not in faster]
    found = dict(zip(tangent(g, places, flow.forward), places, strict=True))
    return {rate: place for rate, place in found.items() if g.args[rate]}
