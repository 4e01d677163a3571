"""What is compiled where rows hold at times, see `solve.laws`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.derivatives import tangent
from lagsim.mechanics.constraints import Kind
from lagsim.methods.parts import parameters as kept

if TYPE_CHECKING:
    from lagsim.language.graph import Graph
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.run.system.columns import Columns

CODES = {
    Kind.CONTACT: kept.CONTACT,
    Kind.FREEWHEEL: kept.FREEWHEEL,
    Kind.SLIP: kept.SLIP,
    Kind.LIMITED: kept.LIMITED,
    Kind.TIMED: kept.TIMED,
}


def law_functions(e: Equations, columns: Columns) -> dict[str, list[int]]:
    """Give what the loops of `solve.laws` begin with, and what modes hang on."""
    g = e.graph
    rows = [*e.rows, *(law.row for law in e.laws)]
    M = [node for row in e.M for node in row]
    A = [node for row in rows for node in row.A]
    held = [row.residual if row.holonomic else g.zero for row in rows]
    return {
        "dynamics": [
            *M, *A, *e.f, *(row.b for row in rows),
            *(law.row.rate for law in e.laws),
            *(law.bound for law in e.laws),
            *(law.static for law in e.laws),
        ],
        "geometry": [
            *M, *A, *held, *(row.rate for row in rows),
            *(row.residual_scale for row in rows),
            *(row.rate_scale for row in rows),
        ],
        "quadratures": e.quadrature_rates,
        "columns": list(columns.nodes.values()),
        "gaps": [
            law.row.residual if law.kind is Kind.CONTACT else law.row.rate
            for law in e.laws
        ],
        "conditions": [g.one if law.when is None else law.when for law in e.laws],
        "bends": [
            *(_bend(e, row) for row in rows),
            *(g.zero if row.holonomic or row.pfaffian else g.one for row in rows),
        ],
    }  # fmt: skip


def _bend(e: Equations, row: Row) -> int:
    """Give what a Newton step leaves of a residual, against its scale.

    The step stands in the place of the velocities; see `functions.bends`.
    """
    g: Graph = e.graph
    if not row.holonomic:
        return g.zero
    step = dict(zip(map(g.variable, e.q), map(g.variable, e.velocities), strict=True))
    (first,) = tangent(g, [row.residual], step)
    (second,) = tangent(g, [first], step)
    half = g.call("mul", g.constant(0.5), second)
    whole = g.call("add", g.call("add", row.residual, first), half)
    part = g.call("div", g.call("abs", whole), row.residual_scale)
    return g.call("if", g.call("gt", row.residual_scale, g.zero), part, g.zero)
