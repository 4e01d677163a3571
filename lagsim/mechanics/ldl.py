"""The equations of motion solved on the graph, entry by entry.

    [ M  A^T ] [  q''   ]   [ f ]
    [ A   0  ] [ -lambda ] = [ b ]

by M = L D L^T, Z = L^-1 A^T, S = Z^T D^-1 Z = A M^-1 A^T and S = L D L^T again. What
is zero in M and A is never multiplied, each factorisation is made in an order that
keeps fill small, and what depends on parameters alone is later computed only once
(`straight_line`). What is too long to compile runs from a tape (`tapes`): a chain of
n rods in Cartesian coordinates takes O(n) operations. For regular M and rows; `dense`
is for all else.
"""

from __future__ import annotations

import math
from dataclasses import replace
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING

from lagsim.language.sparse import Meter, minimum_degree

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.articulated import Articulated
    from lagsim.mechanics.equations import Equations

# Straight-line code of a few thousand operations compiles in well under a second;
# beyond that a full M is for loops (measured: an n-link pendulum past n of about 16)
# and a sparse one for tapes.
BUDGET = 3000
# A multiplication of a sparse elimination costs as much as these of a dense one.
WORTH = 4

Vector = dict[int, int]  # index -> node; what is absent is zero


def affordable(n: int, m: int) -> int:
    """Give how many multiplications an elimination may take before loops win."""
    return max(BUDGET, dense_operations(n, m) // WORTH)


def dense_operations(n: int, m: int) -> int:
    """Give about how many multiplications `dense` makes: M factored, the rows, QR."""
    return n**3 // 6 + m * n**2 // 2 + m**2 * (n - m // 3)


class Factorisation:
    """S = L D L^T of a symmetric matrix, in minimum-degree order.

    Attributes
    ----------
    order : list of int
    below : dict
        Column k of L without its unit diagonal, as row -> node.
    inverse : dict
        1 / D_k.
    pivots : dict
        D_k and the diagonal entry that it came from.
    """

    def __init__(
        self, g: Graph, size: int, entries: Mapping[tuple[int, int], int], meter: Meter
    ) -> None:
        self.g = g
        self.meter = meter
        rows: list[Vector] = [{} for _ in range(size)]
        for (i, j), node in entries.items():
            rows[i][j] = node
            rows[j][i] = node
        self.order = minimum_degree([set(row) for row in rows], meter)
        self.place = {k: at for at, k in enumerate(self.order)}
        self.below: dict[int, Vector] = {}
        self.inverse: Vector = {}
        self.pivots: dict[int, tuple[int, int]] = {}
        first = {k: rows[k].get(k, g.zero) for k in range(size)}
        for k in self.order:
            self._eliminate(k, rows, first[k])

    def _eliminate(self, k: int, rows: list[Vector], first: int) -> None:
        g = self.g
        pivot = rows[k].pop(k, g.zero)
        self.pivots[k] = pivot, first
        inverse = g.call("div", g.one, pivot)
        column = {i: g.call("mul", node, inverse) for i, node in rows[k].items()}
        self.inverse[k] = inverse
        self.below[k] = column
        others = sorted(column)
        for i in others:
            del rows[i][k]
        for a, i in enumerate(others):
            for j in others[a:]:
                term = g.call("mul", column[i], rows[k][j])
                rows[i][j] = rows[j][i] = g.call("sub", rows[i].get(j, g.zero), term)

    def forward(self, right: Mapping[int, int]) -> Vector:
        """Give L^-1 right."""
        g = self.g
        z = {i: node for i, node in right.items() if node != g.zero}
        queue = [self.place[i] for i in z]
        heapify(queue)
        while queue:
            k = self.order[heappop(queue)]
            for i, entry in self.below[k].items():
                self.meter.add(1)
                if i not in z:
                    heappush(queue, self.place[i])
                term = g.call("mul", entry, z[k])
                z[i] = g.call("sub", z.get(i, g.zero), term)
        return z

    def backward(self, z: Mapping[int, int]) -> Vector:
        """Give L^-T D^-1 z."""
        g = self.g
        x: Vector = {}
        for k in reversed(self.order):
            value = g.call("mul", z[k], self.inverse[k]) if k in z else g.zero
            for i, entry in self.below[k].items():
                if i in x:
                    self.meter.add(1)
                    value = g.call("sub", value, g.call("mul", entry, x[i]))
            if value != g.zero:
                x[k] = value
        return x

    def less(self, node: int, z: Mapping[int, int], other: Mapping[int, int]) -> int:
        """Give node - z^T D^-1 other."""
        g = self.g
        for k in sorted(z.keys() & other.keys()):
            part = g.call("mul", g.call("mul", z[k], self.inverse[k]), other[k])
            node = g.call("sub", node, part)
        return node

    def solve(self, right: Mapping[int, int]) -> Vector:
        """Give the solution for `right`."""
        return self.backward(self.forward(right))


def unconstrained(equations: Equations) -> list[int]:
    """Give M^-1 f (n,), the accelerations without constraints."""
    return Elimination(replace(equations, rows=(), laws=()), math.inf).motion()[0]


def factored_mass(equations: Equations, meter: Meter) -> Factorisation | Articulated:
    """Give L D L^T of M: along its chains, or entry by entry."""
    g = equations.graph
    if equations.chains is not None:
        from lagsim.mechanics.articulated import Articulated  # of many links

        return Articulated(g, equations.chains, meter)
    return Factorisation(g, len(equations.q), equations.mass_entries, meter)


class Elimination:
    """Solves for q'' and lambda, and for corrections in the metric of M.

    Raises
    ------
    TooLongError
        Where that takes more than `limit` multiplications.
    """

    def __init__(self, equations: Equations, limit: float = BUDGET) -> None:
        g = self.g = equations.graph
        self.meter = Meter(limit)
        n = len(equations.q)
        self.n, self.m = n, len(equations.rows)
        self.names = [row.name for row in equations.rows]
        self.mass = factored_mass(equations, self.meter)
        self.Z = [self.mass.forward(row.A.entries) for row in equations.rows]
        f = self.mass.forward(dict(enumerate(equations.f)))
        self.schur = Factorisation(g, self.m, self._schur(), self.meter)
        self._motion = self._solve(f, [row.b for row in equations.rows])
        # What is solved for later, corrections, is a part of this.
        self.operations = self.meter.operations
        self.meter.stop()
        if not equations.rows:
            self._motion = self._along_links(equations), []

    def _schur(self) -> dict[tuple[int, int], int]:
        holders: dict[int, list[int]] = {}  # coordinate -> rows of Z that have it
        entries = {}
        for i, z in enumerate(self.Z):
            for k in z:
                holders.setdefault(k, []).append(i)
            near = sorted({j for k in z for j in holders[k]})
            for j in near:
                common = sorted(z.keys() & self.Z[j].keys())
                entries[i, j] = self._weighted(z, self.Z[j], common)
        return entries

    def _weighted(
        self, z: Mapping[int, int], other: Mapping[int, int], common: Iterable[int]
    ) -> int:
        """Give z^T D^-1 other over the entries both have."""
        g, total = self.g, self.g.zero
        for k in common:
            self.meter.add(2)
            scaled = g.call("mul", z[k], self.mass.inverse[k])
            total = g.call("add", total, g.call("mul", scaled, other[k]))
        return total

    def _along_links(self, equations: Equations) -> list[int]:
        """Give q'' by the forces in massless links, where that is shorter."""
        g, before = self.g, self._motion[0]
        below = g.cone([equations.model.lagrangian])
        if not any(g.ops[node] in ("sin", "cos") for node in below):
            return before
        from lagsim.mechanics.tensions import accelerations  # of what turns

        found = accelerations(equations)
        moving = {*equations.q, *equations.velocities, "t"}
        if found is None or g.cost(found, moving) >= g.cost(before, moving):
            return before
        return found  # `operations` stays that of L D L^T: tapes pay as early as before

    def motion(self) -> tuple[list[int], list[int]]:
        """Give q'' (n,) and lambda (m,)."""
        return self._motion

    def response(self, forces: Sequence[int]) -> list[int]:
        """Give the accelerations (n,) that forces alone would make, with b = 0."""
        moved = self.mass.forward(dict(enumerate(forces)))
        return self._solve(moved, [self.g.zero] * self.m)[0]

    def reactions(self) -> list[int]:
        """Give for each row the square of its force in the metric of M, A M^-1 A^T."""
        g = self.g
        return [
            g.call("mul", g.call("mul", lam, lam), self.schur.pivots[k][1])
            for k, lam in enumerate(self._motion[1])
        ]

    def _solve(self, f: Vector, b: Sequence[int]) -> tuple[list[int], list[int]]:
        """Give q'' and lambda of f, as `Factorisation.forward` gives it, and b."""
        g = self.g
        right = {
            i: g.call("sub", b[i], self._weighted(z, f, sorted(z.keys() & f.keys())))
            for i, z in enumerate(self.Z)
        }
        lam = self.schur.solve(right)
        moved = dict(f)
        self._add_forces(moved, lam)
        q = self.mass.backward(moved)
        return (
            [q.get(j, g.zero) for j in range(self.n)],
            [lam.get(i, g.zero) for i in range(self.m)],
        )

    def correction(self, residuals: Sequence[int]) -> list[int]:
        """Give the least change, in the metric of M, that removes `residuals`.

        -M^-1 A^T S^-1 residuals, to first order; shape (n,).
        """
        g = self.g
        right = {i: g.call("neg", r) for i, r in enumerate(residuals)}
        moved: Vector = {}
        self._add_forces(moved, self.schur.solve(right))
        change = self.mass.backward(moved)
        return [change.get(j, g.zero) for j in range(self.n)]

    def _add_forces(self, to: Vector, lam: Mapping[int, int]) -> None:
        """Add Z lam, the constraint forces in the factor's coordinates."""
        g = self.g
        for i, multiplier in sorted(lam.items()):
            for k, entry in self.Z[i].items():
                self.meter.add(1)
                term = g.call("mul", entry, multiplier)
                to[k] = g.call("add", to.get(k, g.zero), term)

    def health(self) -> int:
        """Give the root of the smallest ratio of a pivot of S to its diagonal entry.

        It goes to 0 as the smallest singular value of the scaled rows does. A row
        counts as not shorter than the variable `length.<name>`, so that one that
        vanishes is seen to.
        """
        g = self.g
        worst = g.one
        for k, (pivot, entry) in self.schur.pivots.items():
            length = g.variable(f"length.{self.names[k]}")
            usual = g.call("max", entry, g.call("mul", length, length))
            worst = g.call("min", g.call("div", pivot, usual), worst)
        return g.call("sqrt", g.call("max", worst, g.zero))
