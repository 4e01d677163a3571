"""Newton's matrix of an implicit method, by its entries that do not vanish.

With the residuals r = M q'' - f - A^T lambda and s = A q'' - b, changes of q, of
lambda, of q' and of q'' hold R_q dq + R_v dv + M da - A^T dlambda = 0, and so does s.
An implicit method has dv = g dq - r and da = g dv - s: what is left is

    (C0 + g C1 + g^2 C2) (dq, dlambda) = C1 r + C2 (g r + s),

with C0 = (R_q, -A^T; S_q, 0), C1 = (R_v; S_v), C2 = (M; A), as sparse as the scene is.
The rate of each work is one more row, with -1 in C1 for the change of work itself.

It is factored without exchanging rows, in an order of minimum degree, in which a
constraint comes after its coordinates: its pivot is then a Schur complement.

Sources: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
section IV.8; T. A. Davis, Direct Methods for Sparse Linear Systems, chapter 6.
"""

from __future__ import annotations

import math
from collections import Counter
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import slopes
from lagsim.language.sparse import Budget, TooLongError, minimum_degree
from lagsim.mechanics.equations import memoized_by_motion
from lagsim.mechanics.ldl import dense_operations

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.ldl import Elimination
    from lagsim.methods.parts.newton import SparseNewton

# A multiplication among what does not vanish takes as long as so many of full rows.
SLOWER = 6.0
# Real and complex multiplications, in real ones: factors of both are made.
BOTH = 5


class Entry(NamedTuple):
    """An entry of C0, C1 or C2: which of them, its row, its column, its node."""

    power: int
    row: int
    column: int
    node: int


class Newton(NamedTuple):
    """The entries of C0, C1 and C2, in this order, and the factors' pattern.

    Rows and columns count coordinates, then constraints, then works.

    Attributes
    ----------
    entries : tuple of Entry
    counts : tuple of int
        Of C0, C1 and C2.
    places : tuple of int, length N
        Where each row and column comes in the order of elimination.
    starts : tuple of int, length N + 1
        Where each row of the factors begins among their entries; rows in that order.
    diagonals : tuple of int, length N
        Where its diagonal is.
    columns : tuple of int
        Of each entry of the factors, in ascending order.
    slots : tuple of int
        Where each entry of C0, C1 and C2 is among them.
    operations : int
        Real multiplications of a real and a complex factorisation.
    """

    entries: tuple[Entry, ...]
    counts: tuple[int, int, int]
    places: tuple[int, ...]
    starts: tuple[int, ...]
    diagonals: tuple[int, ...]
    columns: tuple[int, ...]
    slots: tuple[int, ...]
    operations: int

    @property
    def sizes_of_factors(self) -> dict[str, int]:
        """Sizes of what a method keeps."""
        return {
            "unknowns": len(self.places),
            "entries": len(self.entries),
            "filled": len(self.columns),
        }

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the pattern in `SparseNewton`."""
        still, moving, _ = self.counts
        return {**self.sizes_of_factors, "still": still, "damped": still + moving}

    def fill(self, p: SparseNewton) -> None:
        """Write the pattern."""
        n = p.n
        p.newton_slots[:] = self.slots
        p.newton_rows[:] = [self.places[entry.row] for entry in self.entries]
        # Of works, which are the last unknowns, too.
        moved = p.quadratures.start - (n + p.m)
        p.newton_parts[:] = [
            e.column + (moved if e.column >= n + p.m else 0) for e in self.entries
        ]
        p.newton_places[:] = self.places
        p.newton_starts[:] = self.starts
        p.newton_diagonals[:] = self.diagonals
        p.newton_columns[:] = self.columns

    def nodes(self, equations: Equations, elimination: Elimination) -> list[int]:
        """Entries, with q'' and lambda as `elimination` solves for them."""
        g = equations.graph
        motion = (*equations.accelerations, *equations.multipliers)
        found = (node for part in elimination.motion() for node in part)
        new = dict(zip(map(g.variable, motion), found, strict=True))
        return g.substitute([entry.node for entry in self.entries], new)

    def jacobian(self, n: int, values: Floats) -> Floats:
        """Return dq''/d(q, q') (n, 2 n) of the entries' values."""
        N = len(self.places)
        C = np.zeros((3, N, N))
        for (power, row, column, _), value in zip(self.entries, values, strict=True):
            C[power, row, column] = value
        whole = np.hstack([C[2, :, :n], C[0, :, n:]])
        right = np.hstack([C[0, :, :n], C[1, :, :n]])
        N -= int(np.count_nonzero(C[1].diagonal()[n:]))  # works
        whole, right = whole[:N, :N], right[:N]
        return np.asarray(np.linalg.solve(whole, -right)[:n])


@memoized_by_motion
def newton(equations: Equations) -> Newton | None:
    """Find Newton's matrix; None where full matrices take fewer operations."""
    if equations.laws or equations.states or equations.chains is not None:
        return None
    n, m = len(equations.q), len(equations.rows)
    # Multiplications of both factorisations (2 n: complex), and of J.
    full = n**3 // 3 + (2 * n) ** 3 // 3 + 2 * n**3 + dense_operations(n, m)
    most = int(full / SLOWER / BOTH)
    entries = sorted(_entries(equations, most))
    if len(entries) > most:
        return None
    after = {n + i: row.A.entries.keys() for i, row in enumerate(equations.rows)}
    try:
        return factored(entries, n + m, after, most)
    except TooLongError:
        return None


def factored(
    entries: Sequence[Entry],
    size: int,
    after: Mapping[int, Collection[int]],
    most: float = math.inf,
) -> Newton:
    """Order the matrix of these entries, and find the pattern of its factors.

    Parameters
    ----------
    size
        Rows that are put into an order. Some may follow that nothing depends on.
    after
        Row -> those that must come before it.
    most
        Real multiplications.

    Raises
    ------
    TooLongError
        Where a real factorisation takes more of them.
    """
    neighbours: list[set[int]] = [set() for _ in range(size)]
    for entry in entries:
        if entry.row < size:
            neighbours[entry.row].add(entry.column)
            neighbours[entry.column].add(entry.row)
    order = minimum_degree([set(row) for row in neighbours], Budget(most), after=after)
    rows = max((1 + entry.row for entry in entries), default=0)
    places = list(range(max(size, rows)))
    for place, k in enumerate(order):
        places[k] = place
    upper = _filled([{places[j] for j in neighbours[k]} for k in order])
    lower: list[list[int]] = [[] for _ in upper]
    for i, row in enumerate(upper):
        for j in row:
            lower[j].append(i)
    for k in range(size, len(places)):
        last = {places[entry.column] for entry in entries if entry.row == k}
        for i in range(size):
            if i in last:
                last.update(upper[i])
        lower.append(sorted(last - {k}))
        upper.append([])
    operations = sum(1 + len(upper[k]) for row in lower for k in row)
    Budget(most).add(operations)
    columns = [[*row, i, *upper[i]] for i, row in enumerate(lower)]
    return _laid_out(entries, places, columns, BOTH * operations)


def _filled(rows: Sequence[set[int]]) -> list[list[int]]:
    """Columns right of the diagonal that each row has in the factors."""
    upper = [{j for j in row if j > i} for i, row in enumerate(rows)]
    for row in upper:
        if row:
            parent = min(row)
            upper[parent] |= row - {parent}
    return [sorted(row) for row in upper]


def _laid_out(
    entries: Sequence[Entry],
    places: Sequence[int],
    columns: Sequence[Sequence[int]],
    operations: int,
) -> Newton:
    starts = [0, *accumulate(len(row) for row in columns)]
    slot = {
        (i, j): start + k
        for i, (start, row) in enumerate(zip(starts, columns, strict=False))
        for k, j in enumerate(row)
    }
    powers = Counter(entry.power for entry in entries)
    return Newton(
        entries=tuple(entries),
        counts=(powers[0], powers[1], powers[2]),
        places=tuple(places),
        starts=tuple(starts),
        diagonals=tuple(slot[i, i] for i in range(len(columns))),
        columns=tuple(j for row in columns for j in row),
        slots=tuple(slot[places[e.row], places[e.column]] for e in entries),
        operations=operations,
    )


def _entries(equations: Equations, most: int) -> Iterator[Entry]:
    """Entries; of more than `most` only some."""
    e, g = equations, equations.graph
    n, m = len(e.q), len(e.rows)
    columns: dict[int, tuple[int, int]] = {}
    for power, names in enumerate((e.q, e.velocities, e.accelerations)):
        columns |= {g.variable(name): (power, j) for j, name in enumerate(names)}
    columns |= {g.variable(x): (0, n + i) for i, x in enumerate(e.multipliers)}
    variables = frozenset(columns)
    count = 0
    for row, residual in enumerate((*e.motion_residuals(), *e.powers)):
        for variable, node in slopes(g, residual, variables).items():
            if node != g.zero:
                yield Entry(columns[variable][0], row, columns[variable][1], node)
                count += 1
        if count > most:
            return
    for row in range(n + m, n + m + len(e.works)):
        yield Entry(1, row, row, g.constant(-1.0))
