"""L D L^T of symmetric matrices of nodes, in minimum-degree order.

Unknowns may be sums of others, with which the matrix is shorter. From the outside in

- a sum that no other sum needs any more is put into the rows as what it is;
- an unknown that stands in no sum any more is eliminated: the pivots are those of the
  matrix without sums, in the same order.
"""

from __future__ import annotations

from collections import Counter
from functools import cached_property
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Container, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.language.sparse import Budget

Vector = dict[int, int]  # index -> node; what is absent is zero


def add_to(g: Graph, x: Vector, i: int, term: int) -> None:
    """Add a term to entry i of x."""
    x[i] = g.call("add", x.get(i, g.zero), term)


def symmetric(size: int, entries: Mapping[tuple[int, int], int]) -> list[Vector]:
    """Rows of a symmetric matrix by the entries of at least one triangle."""
    rows = [Vector() for _ in range(size)]
    for (i, j), node in entries.items():
        rows[i][j] = rows[j][i] = node
    return rows


class Factorisation:
    """S = L D L^T.

    Parameters
    ----------
    rows
        Of S; used up. Where only `some` unknowns are eliminated, what is left is there.
    sums
        Unknown -> its factor of each unknown in it, all with lower numbers or no sums.
    late
        What comes later where the degree is the same: whose diagonal entry moves.
    some
        The unknowns that are eliminated, if not all.

    Attributes
    ----------
    columns : dict
        Column k of L without its unit diagonal, as row -> node, or sum k as it is: in
        the order of elimination.
    inverse : dict
        1 / D_k.
    pivots : dict
        D_k and the diagonal entry that it came from.

    Raises
    ------
    TooLongError
        Where that takes more multiplications than `budget` has left.
    """

    def __init__(
        self,
        g: Graph,
        rows: Sequence[Vector],
        budget: Budget,
        sums: Mapping[int, Vector] | None = None,
        late: Container[int] = (),
        some: Collection[int] | None = None,
    ) -> None:
        self.g, self.budget, self.rows = g, budget, rows
        self.sums, self.late = sums or {}, late
        self.columns: dict[int, Vector] = {}
        self.inverse: Vector = {}
        self.pivots: dict[int, tuple[int, int]] = {}
        self.depths = [0] * len(rows)
        for k, form in self.sums.items():
            self.depths[k] = 1 + max(self.depths[i] for i in form)
        self._diagonal = [row.get(k, g.zero) for k, row in enumerate(rows)]
        self._eliminate_all(range(len(rows)) if some is None else some)

    def _eliminate_all(self, some: Collection[int]) -> None:
        users = Counter(i for form in self.sums.values() for i in form)
        queue = [self._rank(k) for k in some if not users[k]]
        heapify(queue)
        while queue:
            rank = heappop(queue)
            k = rank[-1]
            if k in self.columns or rank != self._rank(k):
                continue  # out of date: another entry has its rank
            users.subtract(self.sums.get(k, {}).keys())
            touched = self._put_in(k) if k in self.sums else self._eliminate(k)
            for i in touched:
                if i in some and not users[i]:
                    heappush(queue, self._rank(i))

    def _rank(self, k: int) -> tuple[int, int, int, int]:
        """Rank in the elimination: unknowns of few neighbours, then outer sums."""
        if k in self.sums:
            return 1, -self.depths[k], 0, k
        return 0, len(self.rows[k]), k in self.late, k

    def _taken(self, k: int) -> tuple[int, Vector]:
        """Diagonal entry of k, and the others, and take k out of the rows."""
        row = dict(self.rows[k])
        own = row.pop(k, self.g.zero)
        self.rows[k].clear()
        for i in row:
            del self.rows[i][k]
        return own, row

    def _add(self, i: int, j: int, term: int) -> None:
        add_to(self.g, self.rows[i], j, term)
        self.rows[j][i] = self.rows[i][j]

    def _times(self, a: int, b: int) -> int:
        g = self.g
        self.budget.add(g.zero != a != g.one and g.zero != b != g.one)
        return g.call("mul", a, b)

    def _put_in(self, k: int) -> Iterable[int]:
        """Write the sum k as it is in all rows."""
        form = self.columns[k] = self.sums[k]
        own, row = self._taken(k)
        for i, entry in row.items():
            for j, factor in form.items():
                term = self._times(entry, factor)
                self._add(i, j, self.g.call("add", term, term) if i == j else term)
        scaled = [(i, factor, self._times(own, factor)) for i, factor in form.items()]
        for at, (i, _, entry) in enumerate(scaled):
            for j, factor, _ in scaled[at:]:
                self._add(i, j, self._times(entry, factor))
        return row.keys() | form.keys()

    def _eliminate(self, k: int) -> Iterable[int]:
        g = self.g
        pivot, row = self._taken(k)
        self.budget.add(1 + len(row) * (len(row) + 3) // 2)
        self.pivots[k] = pivot, self._diagonal[k]
        inverse = self.inverse[k] = g.call("div", g.one, pivot)
        column = {i: g.call("mul", node, inverse) for i, node in row.items()}
        self.columns[k] = column
        others = sorted(column)
        for at, i in enumerate(others):
            for j in others[at:]:
                self._add(i, j, g.call("neg", g.call("mul", column[i], row[j])))
        return others

    @cached_property
    def _filled(self) -> list[tuple[int, Vector]]:
        """Columns that are not empty, once all unknowns are eliminated."""
        return [(k, column) for k, column in self.columns.items() if column]

    def forward(self, right: Mapping[int, int]) -> Vector:
        """L^-1 right, with what unknowns that are sums bear handed on."""
        z = {i: node for i, node in right.items() if node != self.g.zero}
        for k, column in self._filled:
            if k in z:
                op, value = ("add", z.pop(k)) if k in self.sums else ("sub", z[k])
                for i, entry in column.items():
                    term = self._times(entry, value)
                    z[i] = self.g.call(op, z.get(i, self.g.zero), term)
        return z

    def backward(self, z: Mapping[int, int], given: Vector | None = None) -> Vector:
        """Solution L^-T D^-1 z; unknowns that are left have given values."""
        return self.upward({k: self._over_pivot(z[k], k) for k in z}, given)

    def _over_pivot(self, node: int, k: int) -> int:
        return self.g.call("mul", node, self.inverse.get(k, self.g.zero))

    def upward(self, scaled: Mapping[int, int], given: Vector | None = None) -> Vector:
        """L^-T scaled."""
        g, x = self.g, dict(given or {})
        for k, column in reversed(self.columns.items()):
            value, op = scaled.get(k, g.zero), "add" if k in self.sums else "sub"
            for i, entry in column.items():
                if i in x:
                    value = g.call(op, value, self._times(entry, x[i]))
            if value != g.zero:
                x[k] = value
        return x

    def solve(self, right: Mapping[int, int]) -> Vector:
        """Solution for `right`."""
        return self.backward(self.forward(right))
