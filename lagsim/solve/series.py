"""The Taylor series of a motion whose equations are solved on the graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.graph import remembered
from lagsim.language.normal_form import normal_form
from lagsim.language.series import series_operations, taylor_series
from lagsim.methods.taylor import order_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination

# Straight-line code this long compiles in 2 to 3 s (measured: 0.12 s per thousand).
MOST_OPERATIONS = 20_000


def motion_rates(equations: Equations, elimination: Elimination) -> list[int]:
    """Give y' = (q', q'', power where there is one, other quadratures)."""
    e, g = equations, equations.graph
    accelerations, multipliers = elimination.motion()
    new = dict(zip(map(g.variable, e.multipliers), multipliers, strict=True))
    new |= dict(zip(map(g.variable, e.accelerations), accelerations, strict=True))
    velocities = [g.variable(v) for v in e.velocities]
    return [*velocities, *accelerations, *g.substitute(e.quadrature_rates, new)]


def series_length(equations: Equations, elimination: Elimination, rtol: float) -> int:
    """Estimate the operations of one step's series, without making it."""
    rates = tuple(motion_rates(equations, elimination))
    return _length(equations.graph, _state(equations), rates, order_for(rtol))


def motion_series(equations: Equations, rates: Sequence[int], rtol: float) -> list[int]:
    """Give the order for a tolerance, then the coefficients (order + 1, size).

    `rates` is y' with its branches frozen: a series made before would not know those
    of the arc.
    """
    g, order = equations.graph, order_for(rtol)
    state = _state(equations)
    rows = taylor_series(g, state, _shorter(g, state, tuple(rates)), order)
    return [g.constant(order), *(node for row in rows for node in row)]


def _state(equations: Equations) -> tuple[int, ...]:
    names = [*equations.q, *equations.velocities]
    names += ["work"] * (equations.power is not None)
    return tuple(map(equations.graph.variable, names))


@remembered
def _length(
    g: Graph, state: tuple[int, ...], rates: tuple[int, ...], order: int
) -> int:
    return series_operations(g, state, _shorter(g, state, rates), order)


@remembered
def _shorter(
    g: Graph, state: tuple[int, ...], rates: tuple[int, ...]
) -> tuple[int, ...]:
    """Give `rates`, or their normal form where its series is shorter."""
    names = [str(g.payload(v)) for v in state]
    moving = g.dependent(rates, [*names, "t"])
    forms = rates, tuple(normal_form(g, rates, moving))
    return min(forms, key=lambda nodes: series_operations(g, state, nodes, 10))
