"""Sparse vectors and matrices of graph nodes; disjoint sets of indices."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph


class SparseVector:
    """Vector of nodes that stores only entries that do not vanish identically.

    Algorithms whose cost must not grow with the length of the vector iterate over
    `entries`.

    Attributes
    ----------
    entries : dict of int to int
        Index -> node, in ascending order, without zeros.
    """

    __slots__ = ("_length", "_zero", "entries")

    def __init__(self, g: Graph, length: int, entries: Mapping[int, int]) -> None:
        self._length, self._zero = length, g.zero
        self.entries = {j: entries[j] for j in sorted(entries) if entries[j] != g.zero}

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, j: int) -> int:
        return self.entries.get(j, self._zero)

    def __iter__(self) -> Iterator[int]:
        found = [self._zero] * self._length
        for j, node in self.entries.items():
            found[j] = node
        return iter(found)


class TooLongError(Exception):
    """Signal that an elimination would exceed its budget of operations."""


class Budget:
    """Counter of operations that raises TooLongError past a limit."""

    def __init__(self, limit: float = math.inf) -> None:
        self.operations = 0
        self.limit = limit

    def stop(self) -> None:
        """Remove the limit and continue to count."""
        self.limit = math.inf

    def add(self, operations: int) -> None:
        """Count further operations."""
        self.foresee(operations)
        self.operations += operations

    def foresee(self, operations: int) -> None:
        """Raise TooLongError if `operations` more would pass the limit.

        The operations are not counted.
        """
        if self.operations + operations > self.limit:
            raise TooLongError


def minimum_degree(
    rows: Sequence[set[int]],
    budget: Budget,
    after: Mapping[int, Collection[int]] | None = None,
) -> list[int]:
    """Return an order of elimination with little fill; operations are counted.

    The row with the fewest entries is eliminated next; of several such rows, the first
    (A. George and J. W. H. Liu, SIAM Review 31 (1989), section 2).

    Parameters
    ----------
    rows
        The columns of the entries of each row, symmetric; modified by the elimination.
    budget
        Counter of the operations.
    after
        Row -> neighbours of the row that must be eliminated before it.
    """
    order: list[int] = []
    waits = {k: set(before) for k, before in (after or {}).items() if before}
    queue = [(len(row), k) for k, row in enumerate(rows)]
    heapify(queue)
    left = set(range(len(rows)))
    while left:
        degree, k = heappop(queue)
        if k not in left or k in waits or degree != len(rows[k]):
            continue  # out of date: another entry has its degree
        left.remove(k)
        order.append(k)
        others = rows[k] - {k}
        budget.add(1 + len(others) * (len(others) + 3) // 2)
        for i in others:
            rows[i].remove(k)
            rows[i] |= others
            if i in waits:
                waits[i].discard(k)
                if not waits[i]:
                    del waits[i]
            heappush(queue, (len(rows[i]), i))
    return order


def squares(Z: Sequence[Collection[int]]) -> int:
    """Return the number of operations that form Z^T D^-1 Z, D diagonal.

    Z : for each column of the matrix Z, the row indices of its nonzero entries.
    """
    holders = Counter(k for z in Z for k in z)
    return sum(count * (count + 1) for count in holders.values())


def fill(Z: Sequence[Collection[int]]) -> int:
    """Return the number of operations that factor Z^T D^-1 Z, D diagonal.

    The order is that of minimum degree; no products are assumed to cancel.

    Z : for each column of the matrix Z, the row indices of its nonzero entries.
    """
    holders: dict[int, set[int]] = {}
    for i, z in enumerate(Z):
        for k in z:
            holders.setdefault(k, set()).add(i)
    budget = Budget()
    minimum_degree([set().union(*(holders[k] for k in z)) for z in Z], budget)
    return budget.operations


class DisjointSets:
    """Disjoint sets of the indices below `size`, initially one set for each.

    Examples
    --------
    >>> sets = DisjointSets(4)
    >>> sets.merge(0, 2)
    >>> sets.sets()
    [[0, 2], [1], [3]]
    """

    def __init__(self, size: int) -> None:
        self._leader = list(range(size))

    def leader(self, i: int) -> int:
        """Return the index that represents the set of `i`."""
        above = self._leader
        while above[i] != i:
            above[i] = above[above[i]]
            i = above[i]
        return i

    def merge(self, i: int, j: int) -> None:
        """Merge the sets of `i` and `j`."""
        i, j = self.leader(i), self.leader(j)
        self._leader[max(i, j)] = min(i, j)

    def unite(self, members: Iterable[int | None]) -> int | None:
        """Merge the sets of the given indices; return the first index, or None.

        The result is None if there is no index.

        members : indices, of which None is skipped.
        """
        first = None
        for j in members:
            if first is None:
                first = j
            elif j is not None and j != first:
                self.merge(first, j)
        return first

    def sets(self) -> list[list[int]]:
        """Return the sets, each ascending, in the order of their first indices."""
        found: dict[int, list[int]] = defaultdict(list)
        for i in range(len(self._leader)):
            found[self.leader(i)].append(i)
        return list(found.values())


def joined(n: int, rows: Iterable[Iterable[int]]) -> list[int]:
    """Return, for each of n coordinates, the least index in its group.

    A group has all coordinates that are coupled directly or through others.

    rows : for each row, the indices of the coordinates that it couples.
    """
    sets = DisjointSets(n)
    pairs = [pair for row in rows for pair in pairwise(row)]
    if not pairs:
        return [*range(n)]
    for i, j in pairs:
        sets.merge(i, j)
    return [sets.leader(i) for i in range(n)]
