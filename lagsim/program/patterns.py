"""Sparsity patterns of the mass matrix M = L L^T, of the rows A, and of A L^-T."""

from __future__ import annotations

from itertools import accumulate, chain
from typing import TYPE_CHECKING, NamedTuple

from lagsim.mechanics.rows import RowTable

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.methods.moreau import Impulses
    from lagsim.methods.parts.parameters import Parameters


class Pattern(NamedTuple):
    """Sparsity pattern of M and of the rows.

    Attributes
    ----------
    first : list of int, length n
        First column of each row of M.
    starts, columns : list of int
        Of the elements of the rows: index of the first element of each row, and column
        of each element.
    """

    first: list[int]
    starts: list[int]
    columns: list[int]

    @property
    def inertial(self) -> int:
        """Number of elements of M in its envelope."""
        return sum(i - j + 1 for i, j in enumerate(self.first))


# An operation on elements that are found by lists costs as much as this many others.
LISTED = 2


class RowPattern(NamedTuple):
    """Sparsity of A L^-T, of the rows of equalities and laws, with M = L L^T.

    Attributes
    ----------
    first : list of int, length n
        First column of each row of L.
    ranges : list of list of (int, int), length m
        The reach of each row: columns of the row of A L^-T, and columns of the friction
        that a multiplier of the row causes, as ranges (first, last + 1).
    near : list of list of int, length m
        Rows, ascending, whose reaches overlap with that of each row. Empty where there
        are no laws.
    whole : bool
        Whether every row of L and of the constraints counts as full, and all rows as
        coupled, so that kernels need no lists.
    """

    first: list[int]
    ranges: list[list[tuple[int, int]]]
    near: list[list[int]]
    whole: bool = False

    @property
    def is_dense(self) -> bool:
        """Whether M and the rows are too closely coupled for lists to save time.

        The elements in products of two rows of L, of A L^-T, and of both are counted.
        """
        n, m = len(self.first), len(self.ranges)
        heights = [i - k + 1 for i, k in enumerate(self.first)]
        lengths = [sum(end - begin for begin, end in own) for own in self.ranges]
        factored = sum(k * k for k in heights) + m * sum(heights)
        coupled = sum(a * len(b) for a, b in zip(lengths, self.near, strict=True))
        most = n * n * (n + m) // 2 + n * m * m * bool(coupled)
        return LISTED * (factored + coupled) >= most

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the memory that `fill` needs, by the names of `Parameters`."""
        return {
            "reached": sum(map(len, self.ranges)),
            "neighbours": sum(map(len, self.near)),
        }

    def fill(self, p: Parameters) -> None:
        """Store the sparsity in the parameters of the kernels."""
        p.inertia_first[:] = self.first
        ranges = list(chain(*self.ranges))
        _store(p.reach_starts, accumulate(map(len, self.ranges), initial=0))
        _store(p.reach_begins, (begin for begin, _ in ranges))
        _store(p.reach_ends, (end for _, end in ranges))
        if p.laws:
            _store(p.near_starts, accumulate(map(len, self.near), initial=0))
            _store(p.near_rows, chain(*self.near))


def _store(words: Floats, numbers: Iterable[int]) -> None:
    """Store integers as the bits of doubles, `words`, which kernels read by `bits`."""
    words.view("int64")[:] = list(numbers)


def row_pattern(e: Equations, *, augmented: bool) -> RowPattern:
    """Return the sparsity of L and of A L^-T, where M = L L^T and A has all rows.

    augmented : whether M is replaced by M + A^T W A, with the rows A of the equalities.
    """
    first = [min([i, *row.entries]) for i, row in enumerate(e.M)]
    if augmented:
        for row in e.rows:
            for j in row.A.entries:
                first[j] = min(first[j], *row.A.entries)
    count = len(e.rows)
    columns = [set(row.A.entries) for row in e.every_row]
    for k, law in enumerate(e.laws):
        if law.slider:
            columns[count + k].add(law.slider.coordinate)
        if law.normal >= 0:
            columns[count + law.normal] |= columns[count + k]
    reach = [_reach(own, first) for own in columns]
    near = _overlapping(reach, len(first)) if e.laws else [[] for _ in reach]
    found = RowPattern(first, [_ranges(own) for own in reach], near)
    if not found.is_dense:
        return found
    n, m = len(first), len(reach)
    near = [list(range(m)) for _ in reach] if e.laws else near
    return RowPattern([0] * n, [[(0, n)] for _ in reach], near, whole=True)


def _ranges(numbers: list[int]) -> list[tuple[int, int]]:
    """Return ascending numbers as ranges (first, last + 1)."""
    found: list[tuple[int, int]] = []
    for j in numbers:
        if found and found[-1][1] == j:
            found[-1] = found[-1][0], j + 1
        else:
            found.append((j, j + 1))
    return found


def _overlapping(reach: list[list[int]], n: int) -> list[list[int]]:
    """Return for each row the indices, ascending, of rows that share a column with it.

    reach : the columns of each row.
    n : number of columns.
    """
    holders: list[list[int]] = [[] for _ in range(n)]
    for k, own in enumerate(reach):
        for j in own:
            holders[j].append(k)
    near: list[set[int]] = [set() for _ in reach]
    for sharing in holders:
        for k in sharing:
            near[k].update(sharing)
    return [sorted(x) for x in near]


def _reach(columns: set[int], first: list[int]) -> list[int]:
    """Return the rows, ascending, of L^-1 x that are not 0 for a vector x.

    columns : the elements of x that are not 0.
    first : the first column of each row of L.
    """
    found: list[int] = []
    last = -1
    for i in range(min(columns, default=len(first)), len(first)):
        if i in columns or first[i] <= last:
            found.append(i)
            last = i
    return found


def pattern(e: Equations) -> Pattern:
    """Return the sparsity pattern of M and of the rows."""
    starts, columns = [0], []
    for A in e.slopes:
        columns += list(A.entries)
        starts.append(len(columns))
    first = [min([i, *row.entries]) for i, row in enumerate(e.M)]
    return Pattern(first, starts, columns)


def fill(p: Impulses, e: Equations, found: Pattern) -> None:
    """Store the sparsity pattern, and the columns of each row in p.

    found : the pattern.
    """
    relations = e.relations
    table = RowTable.of(relations)
    p.inertia_first[:] = found.first
    p.slope_starts[:], p.slope_columns[:] = found.starts, found.columns
    p.row_low[:], p.row_high[:], p.row_gapped[:] = table.low, table.high, table.gapped
    p.row_normal[:], p.row_pair[:] = table.normals, table.pairs
    p.row_returns[:] = [x.always for x in relations]
    p.row_restitution[:] = [x.restitution for x in relations]
