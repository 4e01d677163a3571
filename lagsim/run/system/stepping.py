"""What is compiled for methods that meet all rows by impulses, in steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.mechanics.constraints import Kind
from lagsim.methods.parts.parameters import ALWAYS
from lagsim.run.system.laws import CODES

if TYPE_CHECKING:
    from lagsim.language.sparse import SparseVector
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.methods.parts.parameters import Parameters
    from lagsim.run.system.columns import Columns


class Pattern(NamedTuple):
    """Which elements of M and of the rows there are.

    first : the first column of each row of M; starts, columns : of the rows' elements.
    """

    first: list[int]
    starts: list[int]
    columns: list[int]

    @property
    def inertial(self) -> int:
        """The elements of M in its envelope."""
        return sum(i - j + 1 for i, j in enumerate(self.first))


def pattern(e: Equations) -> Pattern:
    """Find the pattern of some equations."""
    starts, columns = [0], []
    for A in e.slopes:
        columns += list(A.entries)
        starts.append(len(columns))
    first = [min(i, *_before(row, i)) for i, row in enumerate(e.M)]
    return Pattern(first, starts, columns)


def _before(row: SparseVector, i: int) -> list[int]:
    return [i, *(j for j in row.entries if j < i)]


def fill(p: Parameters, e: Equations, found: Pattern) -> None:
    """Tell the kernels what rows there are."""
    count, laws = len(e.rows), e.laws
    p.inertia_first[:] = found.first
    p.slope_starts[:], p.slope_columns[:] = found.starts, found.columns
    p.met_kind[:] = [ALWAYS] * count + [CODES[law.kind] for law in laws]
    # Equalities come first.
    for name, numbers in (
        ("met_normal", [law.normal for law in laws]),
        ("met_pair", [law.pair for law in laws]),
    ):
        shifted = [k + count if k >= 0 else -1 for k in numbers]
        getattr(p, name)[:] = [-1] * count + shifted
    p.met_restitution[:] = [0.0] * count + [law.restitution for law in laws]


def stepping_functions(
    e: Equations, columns: Columns, found: Pattern
) -> dict[str, list[int]]:
    """Give `balance`, `effort`, and the columns of rows, in which nothing strikes."""
    g = e.graph
    rows = [*e.rows, *(law.row for law in e.laws)]
    always = [g.zero] * len(e.rows)
    lam = {g.variable(name): g.zero for name in e.multipliers}
    at_impacts = {
        g.variable(f"impulse.{law.constraint}"): g.zero
        for law in e.laws
        if law.kind is Kind.CONTACT
    }
    return {
        "balance": [
            *(e.M[i][j] for i, k in enumerate(found.first) for j in range(k, i + 1)),
            *(slope for row in rows for slope in row.A.entries.values()),
            *e.f,
            *(row.residual if row.holonomic else g.zero for row in rows),
            *(_offset(e, row) for row in rows),
            *always, *(law.bound for law in e.laws),
            *always, *(law.static for law in e.laws),
            *(g.one for _ in e.rows),
            *(g.one if law.when is None else law.when for law in e.laws),
        ],
        "effort": g.substitute(e.powers, lam),
        "columns": g.substitute(columns.nodes.values(), at_impacts),
    }  # fmt: skip


def _offset(e: Equations, row: Row) -> int:
    """Give the rate less A q'."""
    g = e.graph
    if row.holonomic:
        return g.call("neg", row.transport)
    if row.pfaffian and row.transport == g.zero:
        return g.zero
    rates = [g.variable(name) for name in e.velocities]
    moved = g.product_sum((slope, rates[j]) for j, slope in row.A.entries.items())
    return g.call("sub", row.rate, moved)
