"""S x = r solved on the graph for S that is a sum of squares.

x^T S x = sum over u of w_u (sum over t of p_tu x_t)^2. What meets in the same x is a
group, and as long as an x_t stands in one group alone, Lagrange's identity

    |p_i|^2 |p_t|^2 - (p_i p_t)^2 = sum over u < v of (p_iu p_tv - p_iv p_tu)^2

gives what eliminating it leaves as sums of positive terms: nothing cancels.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.graph import Graph

Vector = dict[int, int]  # index -> node; what is absent is zero
Pair = tuple[int, int]


class Group(NamedTuple):
    """The squares in which the same x stand.

    Attributes
    ----------
    norms : dict
        i -> |p_i|^2.
    dots : dict
        (i, j), i < j -> p_i p_j.
    areas : dict
        (i, j), i < j -> for each u < v: w_u w_v, and p_iu p_jv - p_iv p_ju.
    """

    norms: Vector
    dots: dict[Pair, int]
    areas: dict[Pair, list[Pair]]

    @property
    def nodes(self) -> list[int]:
        """All but weights."""
        areas = (area for found in self.areas.values() for _, area in found)
        return [*self.norms.values(), *self.dots.values(), *areas]

    def written(self, new: Mapping[int, int]) -> Group:
        """Give the same with other nodes."""
        return Group(
            {i: new[n] for i, n in self.norms.items()},
            {key: new[n] for key, n in self.dots.items()},
            {key: [(w, new[n]) for w, n in x] for key, x in self.areas.items()},
        )


def groups(g: Graph, parts: Mapping[int, Vector], weights: Vector) -> list[Group]:
    """Give the groups of p, t -> u -> p_tu, and w, u -> w_u."""
    members: dict[int, list[int]] = {}
    for t in sorted(parts):
        for u in parts[t]:
            members.setdefault(u, []).append(t)
    alike: dict[tuple[int, ...], list[int]] = {}
    for u, met in members.items():
        alike.setdefault(tuple(met), []).append(u)
    found = []
    for those, us in alike.items():
        p = {t: {u: parts[t][u] for u in us} for t in those}
        pairs = list(combinations(those, 2))
        norms = {i: weighted(g, p[i], p[i], weights) for i in those}
        dots = {(i, j): weighted(g, p[i], p[j], weights) for i, j in pairs}
        areas = {(i, j): _areas(g, p[i], p[j], weights) for i, j in pairs}
        found.append(Group(norms, dots, areas))
    return found


def weighted(g: Graph, one: Vector, other: Vector, weights: Vector) -> int:
    """Give the sum of w a b over what both have."""
    terms = (
        (weights[u], g.call("mul", a, other[u])) for u, a in one.items() if u in other
    )
    return g.product_sum(terms)


def _areas(g: Graph, one: Vector, other: Vector, weights: Vector) -> list[Pair]:
    found = []
    for u, v in combinations(one, 2):
        weight = g.call("mul", weights[u], weights[v])
        terms = (g.call("mul", one[x], other[y]) for x, y in ((u, v), (v, u)))
        found.append((weight, g.call("sub", *terms)))
    return found


class Squares:
    """S, eliminated in minimum-degree order."""

    def __init__(self, g: Graph, found: list[Group]) -> None:
        self.g = g
        members = {i for group in found for i in group.norms}
        self._groups = dict(enumerate(found))
        # The diagonal and the entries that are in no group (any more).
        self._own = dict.fromkeys(members, g.zero)
        self._rows: dict[int, Vector] = {i: {} for i in members}
        self._in: dict[int, set[int]] = {i: set() for i in members}
        for k, group in enumerate(found):
            if len(group.norms) == 1:
                self._dissolve(k)
            else:
                for i in group.norms:
                    self._in[i].add(k)
        self.columns: dict[int, Vector] = {}
        self.pivots: Vector = {}
        self._depths = dict.fromkeys(members, 0)
        queue = [self._key(t) for t in members]
        heapify(queue)
        while queue:
            key = heappop(queue)
            t = key[-1]
            if t in self.pivots or key != self._key(t):
                continue  # out of date: another entry has its degree
            self._eliminate(t)
            for i in self.columns[t]:
                self._depths[i] = max(self._depths[i], self._depths[t] + 1)
                heappush(queue, self._key(i))

    def _key(self, t: int) -> tuple[int, int, int]:
        """Rank what may come next: few neighbours, then what waits for little."""
        met = set(self._rows[t]).union(*(self._groups[k].norms for k in self._in[t]))
        return len(met), self._depths[t], t

    def _add(self, i: int, j: int, term: int) -> None:
        g = self.g
        if i == j:
            self._own[i] = g.call("add", self._own[i], term)
        else:
            node = g.call("add", self._rows[i].get(j, g.zero), term)
            self._rows[i][j] = self._rows[j][i] = node

    def _dissolve(self, k: int) -> None:
        """Make entries of a group."""
        group = self._groups.pop(k)
        for i, norm in group.norms.items():
            self._in[i].discard(k)
            self._add(i, i, norm)
        for (i, j), product in group.dots.items():
            self._add(i, j, product)

    def _eliminate(self, t: int) -> None:
        g = self.g
        if len(self._in[t]) == 1 and not self._rows[t]:
            [k] = self._in[t]
            row, pivot, left = self._freed(t, k)
        else:
            for k in sorted(self._in[t]):
                self._dissolve(k)
            row, pivot, left = self._rows[t], self._own[t], {}
            for i in row:
                del self._rows[i][t]
        self.pivots[t] = pivot
        column = {i: g.call("div", node, pivot) for i, node in row.items()}
        self.columns[t] = column
        for i, j in combinations(sorted(row), 2):
            self._add(i, j, g.call("neg", g.call("mul", column[i], row[j])))
        for i in row:
            if i in left:
                self._add(i, i, g.call("div", left[i], pivot))
            else:
                self._add(i, i, g.call("neg", g.call("mul", column[i], row[i])))

    def _freed(self, t: int, k: int) -> tuple[Vector, int, Vector]:
        """Give row, pivot, and pivot times what is left, of t in group k alone."""
        g, group, own = self.g, self._groups.pop(k), self._own[t]
        pivot = g.call("add", own, group.norms[t])
        row, left = {}, {}
        for i, norm in group.norms.items():
            self._in[i].discard(k)
            if i == t:
                continue
            row[i] = group.dots[min(i, t), max(i, t)]
            squares = (
                (w, g.call("mul", area, area))
                for w, area in group.areas[min(i, t), max(i, t)]
            )
            rest = g.call("mul", own, norm)
            left[i] = g.call("add", rest, g.product_sum(squares))
        for (i, j), product in group.dots.items():
            if t not in (i, j):
                self._add(i, j, product)
        return row, pivot, left

    def solve(self, right: Mapping[int, int]) -> Vector:
        """Give x; what is absent is zero."""
        g, z, x = self.g, dict(right), Vector()
        for t, column in self.columns.items():
            for i, entry in column.items():
                term = g.call("mul", entry, z.get(t, g.zero))
                z[i] = g.call("sub", z.get(i, g.zero), term)
        for t in reversed(self.columns):
            value = g.call("div", z.get(t, g.zero), self.pivots[t])
            for i, entry in self.columns[t].items():
                term = g.call("mul", entry, x.get(i, g.zero))
                value = g.call("sub", value, term)
            if value != g.zero:
                x[t] = value
        return x
