"""Disjoint sets of indices that grow together.

R. E. Tarjan, J. van Leeuwen, J. ACM 31 (1984) 245: with halved paths the cost of n
merges is n but for a factor that is 5 at most.
"""

from __future__ import annotations

from collections import defaultdict


class DisjointSets:
    """The indices below `size`, at first each in a set of its own."""

    def __init__(self, size: int) -> None:
        self._leader = list(range(size))

    def leader(self, i: int) -> int:
        """Give the one index that stands for the set of `i`."""
        above = self._leader
        while above[i] != i:
            above[i] = above[above[i]]
            i = above[i]
        return i

    def merge(self, i: int, j: int) -> None:
        """Make one set of those of `i` and `j`."""
        i, j = self.leader(i), self.leader(j)
        self._leader[max(i, j)] = min(i, j)

    def sets(self) -> list[list[int]]:
        """Give them, each in order, by their first indices."""
        found: dict[int, list[int]] = defaultdict(list)
        for i in range(len(self._leader)):
            found[self.leader(i)].append(i)
        return list(found.values())
