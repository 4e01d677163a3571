"""M x = f solved along the chains in which velocities are written, in O(n) operations.

The velocities of bodies on links are sums along the chain: x_k' is x_{k-1}' and a term
of q_k'. M of the angles is full, though the kinetic energy in all of x_k' and q_k' is a
short sum of squares. So the x_k' stay unknowns beside the q_k', and from the tips on

- x_k', which no other sum needs any more, is put into the squares as the sum it is;
- q_k', which stands in no sum any more, is eliminated: L D L^T as of M, entry by entry.

What is left between is the inertia of all that hangs there, as the joint feels it: the
articulated body. The pivots are those of M in the same order.
Source: R. Featherstone, Rigid Body Dynamics Algorithms, chapter 7; A. Griewank and
A. Walther, Evaluating Derivatives, chapter 9 (elimination on a graph of sums).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, overload

from lagsim.language.sparse import (
    Meter,
    SparseVector,
    TooLongError,
    minimum_degree,
)
from lagsim.mechanics.chains import chains

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lagsim.language.graph import Graph
    from lagsim.mechanics.chains import Chains

# For each velocity and each term of a sum: what hangs in chains takes some tens.
MOST_OPERATIONS = 100

Vector = dict[int, int]  # unknown -> node; what is absent is zero


class Articulated:
    """L D L^T of M by way of `Chains`; solves as `Factorisation` of M does.

    Attributes
    ----------
    inverse : dict
        1 / D_k of the velocities.
    pivots : dict
        D_k, twice: no entry of M is made.
    """

    def __init__(self, g: Graph, found: Chains, meter: Meter) -> None:
        self.g, self.meter, self.size = g, meter, found.size
        self.sums = dict(enumerate(found.sums, found.size))
        self.rows: list[Vector] = [{} for _ in range(found.size + len(found.sums))]
        for (i, j), node in found.squares.items():
            self.rows[i][j] = self.rows[j][i] = node
        self.depth = dict.fromkeys(range(found.size), 0)
        for k, form in self.sums.items():
            self.depth[k] = 1 + max(self.depth[i] for i in form)
        self.inverse: Vector = {}
        self.pivots: dict[int, tuple[int, int]] = {}
        # A sum as it is, or the column of L of a velocity.
        self.steps: list[tuple[int, Vector]] = []
        self._from_the_tips()
        del self.rows

    def _from_the_tips(self) -> None:
        users = Counter(i for form in self.sums.values() for i in form)
        queue = [self._key(k) for k in range(len(self.rows)) if not users[k]]
        heapify(queue)
        done = set[int]()
        while queue:
            key = heappop(queue)
            k = key[-1]
            if k in done or key != self._key(k):
                continue  # out of date: another entry has its count
            done.add(k)
            touched = set(self.rows[k]) - {k}
            if k in self.sums:
                form = self.sums[k]
                users.subtract(form.keys())
                self._put_in(k, form)
                touched |= form.keys()
            else:
                self._eliminate(k)
            for i in touched:
                if not users[i]:
                    heappush(queue, self._key(i))

    def _key(self, k: int) -> tuple[int, int, int]:
        """Rank what may come next: velocities of few neighbours, then outer sums."""
        if k in self.sums:
            return 1, -self.depth[k], k
        return 0, len(self.rows[k]), k

    def _times(self, a: int, b: int) -> int:
        g = self.g
        self.meter.add(g.zero != a != g.one and g.zero != b != g.one)
        return g.call("mul", a, b)

    def _add(self, i: int, j: int, term: int) -> None:
        g = self.g
        node = g.call("add", self.rows[i].get(j, g.zero), term)
        self.rows[i][j] = self.rows[j][i] = node

    def _taken(self, k: int) -> tuple[int, Vector]:
        """Give the diagonal entry of k, and the others, and take k out of the rows."""
        row = self.rows[k]
        own = row.pop(k, self.g.zero)
        for i in row:
            del self.rows[i][k]
        return own, row

    def _put_in(self, k: int, form: Vector) -> None:
        """Write the sum k as `form` in all squares."""
        self.steps.append((k, form))
        own, row = self._taken(k)
        for i, entry in row.items():
            for j, factor in form.items():
                term = self._times(entry, factor)
                self._add(i, j, self.g.call("add", term, term) if i == j else term)
        scaled = [(i, factor, self._times(own, factor)) for i, factor in form.items()]
        for at, (i, _, entry) in enumerate(scaled):
            for j, factor, _ in scaled[at:]:
                self._add(i, j, self._times(entry, factor))

    def _eliminate(self, k: int) -> None:
        pivot, row = self._taken(k)
        self.pivots[k] = pivot, pivot
        inverse = self.inverse[k] = self.g.call("div", self.g.one, pivot)
        self.meter.add(1)
        column = {i: self._times(node, inverse) for i, node in row.items()}
        self.steps.append((k, column))
        others = sorted(column)
        for at, i in enumerate(others):
            for j in others[at:]:
                term = self._times(column[i], row[j])
                self._add(i, j, self.g.call("neg", term))

    def solve(self, right: Mapping[int, int]) -> Vector:
        """Give the solution for `right`."""
        return self.backward(self.forward(right))

    def forward(self, right: Mapping[int, int]) -> Vector:
        """Give L^-1 right."""
        g = self.g
        z = {i: node for i, node in right.items() if node != g.zero}
        for k, column in self.steps:
            if k not in z:
                continue
            force, op = (z.pop(k), "add") if k in self.sums else (z[k], "sub")
            for i, entry in column.items():
                term = self._times(entry, force)
                z[i] = g.call(op, z.get(i, g.zero), term)
        return z

    def backward(self, z: Mapping[int, int]) -> Vector:
        """Give L^-T D^-1 z."""
        g = self.g
        x: Vector = {}
        for k, column in reversed(self.steps):
            value, op = g.zero, "add"
            if k not in self.sums:
                value, op = self._times(z.get(k, g.zero), self.inverse[k]), "sub"
            for i, entry in column.items():
                term = self._times(entry, x.get(i, g.zero))
                value = g.call(op, value, term)
            x[k] = value
        return {k: x[k] for k in range(self.size) if x[k] != g.zero}


class Composite(Articulated):
    """The diagonal of M: what hangs at each joint as one rigid body.

    The composite-rigid-body algorithm, Featherstone's chapter 6, for its diagonal.
    """

    def diagonal(self) -> list[int]:
        """Give M_kk (n,)."""
        return [self.pivots[k][0] for k in range(self.size)]

    def _eliminate(self, k: int) -> None:
        pivot, _ = self._taken(k)
        self.pivots[k] = pivot, pivot


class ChainedMass(Sequence[SparseVector]):
    """M of bodies on chains, whose entries are made where somebody reads them.

    There are n^2 of them, and of what `chains` has only some n.
    """

    def __init__(
        self, g: Graph, found: Chains, rows: Callable[[], tuple[SparseVector, ...]]
    ) -> None:
        self.chains = found
        self._graph, self._rows = g, rows

    @cached_property
    def diagonal(self) -> tuple[int, ...]:
        """M_jj (n,)."""
        return tuple(Composite(self._graph, self.chains, Meter()).diagonal())

    @cached_property
    def rows(self) -> tuple[SparseVector, ...]:
        """The entries, row by row."""
        return self._rows()

    def __len__(self) -> int:
        return self.chains.size

    @overload
    def __getitem__(self, i: int) -> SparseVector: ...
    @overload
    def __getitem__(self, i: slice) -> tuple[SparseVector, ...]: ...
    def __getitem__(self, i: int | slice) -> SparseVector | tuple[SparseVector, ...]:
        return self.rows[i]


def shorter_chains(
    g: Graph, lagrangian: int, rates: Sequence[int], names: Sequence[str]
) -> Chains | None:
    """Give the chains of `lagrangian` where they take fewer operations than M does."""
    found = chains(g, lagrangian, rates, names)
    if found is None or not found.sums:
        return None
    terms = len(rates) + sum(map(len, found.sums))
    if sum(len(form) ** 2 for form in found.sums) > MOST_OPERATIONS * terms:
        return None  # one sum of all velocities is no chain
    meter = Meter(MOST_OPERATIONS * terms)
    try:
        Articulated(g, found, meter)
    except TooLongError:
        return None
    neighbours = found.neighbours()
    if sum(map(int.bit_count, neighbours)) // 2 > meter.operations:
        return found  # each entry takes one multiplication at least
    rows = [{i for i in range(len(rates)) if x >> i & 1} for x in neighbours]
    try:
        minimum_degree(rows, Meter(meter.operations))
    except TooLongError:
        return found
    return None
