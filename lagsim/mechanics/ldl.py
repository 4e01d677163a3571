"""Symbolic solution of the equations of motion by sparse L D L^T factorisation.

    [ M  A^T ] [  q''   ]   [ f ]
    [ A   0  ] [ -lambda ] = [ b ]

by M = L D L^T, Z = L^-1 A^T, S = Z^T D^-1 Z = A M^-1 A^T and S = L D L^T again. Zero
entries of M and A are never multiplied, each factorisation is in an order of small
fill, and subexpressions of parameters alone are later computed only once
(`straight_line`). Code too long to compile runs from a tape (`tapes`): a chain of
n rods in Cartesian coordinates takes O(n) operations. M and S must be regular; `dense`
solves all other equations.

Each row is first divided by the numeric factor that its entries have in common, which
is exact: 2 dx x'' + 2 dy y'' = -2 (dx'^2 + dy'^2) is multiplied by 1/2.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.forms import Collected
from lagsim.language.graph import memoize
from lagsim.language.sparse import Budget, TooLongError, fill, minimum_degree, squares
from lagsim.mechanics.chains import Factorisation, Vector, symmetric
from lagsim.mechanics.derivation import has_angles

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


class Scaled(NamedTuple):
    """Row of A q'' = b multiplied by a number.

    Attributes
    ----------
    weight : float
        The number.
    A : dict
        Index of a coordinate -> node of the entry, multiplied by `weight`.
    b : int
        Node of the right-hand side, multiplied by `weight`.
    """

    weight: float
    A: Vector
    b: int


def without_content(x: Collected, row: Row) -> Scaled:
    """Return the row divided by the numeric factor that most of its entries contain.

    The weight of the result is the inverse of the factor.

    x : rewriter of the graph.
    """
    g, found = x.g, Counter[float]()
    for node in row.A.entries.values():
        still, core = x.parts(node)
        if core != g.one:
            found[abs(_number(x, still))] += 1
    weight = 1.0 / found.most_common(1)[0][0] if found else 1.0
    w = g.constant(weight)
    A = {j: x.sum([(w, node)]) for j, node in row.A.entries.items()}
    b = x.sum([(w, sign, n) for sign, n in x.addends(row.b)])
    return Scaled(weight, A, b)


def _number(x: Collected, still: int) -> float:
    g = x.g
    if g.ops[still] == "neg":
        return -_number(x, g.args[still][0])
    if g.ops[still] == "mul":
        still = g.args[still][0]
    value = g.value(still)
    return value or 1.0


# Straight-line code of a few thousand operations compiles in well under a second;
# beyond that a full M is for loops (measured: an n-link pendulum past n of about 16)
# and a sparse one for tapes.
BUDGET = 3000
# Cost of a multiplication in sparse elimination, in multiplications of dense loops.
WORTH = 4


def affordable(n: int, m: int) -> int:
    """Return the count of multiplications beyond which loops are faster than code.

    The loops are in `dense`, the code is straight-line code for the elimination.

    n, m : numbers of coordinates and rows.
    """
    return max(BUDGET, dense_operations(n, m) // WORTH)


def dense_operations(n: int, m: int) -> int:
    """Estimate the multiplications of `dense`: factors of M, rows of A, and a QR.

    n, m : numbers of coordinates and rows.
    """
    return n**3 // 6 + m * n**2 // 2 + m**2 * (n - m // 3)


def turns(e: Equations) -> bool:
    """Whether the Lagrangian contains sines or cosines in a model without rows."""
    return not e.rows and has_angles(e.graph, e.model.lagrangian)


def _has_masses(e: Equations) -> bool:
    from lagsim.mechanics.tensions import has_masses

    return has_masses(e)


def elimination_of(equations: Equations) -> Elimination | None:
    """Return the elimination of equations; None where loops are faster.

    The result is memoized for all values of the parameters, except that links with and
    without mass have eliminations of their own.
    """
    e = equations
    key = (Elimination, e.nodes, e.model.lagrangian, turns(e) and _has_masses(e))

    def found() -> Elimination | None:
        # The choice of the factors of a tree has counted the operations of M already.
        along_tree = e.tree is not None and e.chains is not None
        try:
            most = math.inf if along_tree else affordable(len(e.q), len(e.rows))
            return Elimination(e, most)
        except TooLongError:
            return None

    return memoize(e.graph, key, found)


def without_rows(equations: Equations) -> Elimination:
    """Return the elimination without constraints: q'' = M^-1 f."""
    return Elimination(replace(equations, rows=(), laws=()), math.inf)


def collected_along(e: Equations) -> Collected:
    """Return a rewriter of sums of products; all variables of the motion vary in it."""
    return Collected(e.graph, (*e.moving, *e.accelerations, *e.multipliers))


def factored_mass(equations: Equations, budget: Budget) -> Factorisation:
    """Factor M = L D L^T: along its chains, or entry by entry.

    budget : the number of multiplications that are permitted.
    """
    g = equations.graph
    if equations.chains is not None:
        return equations.chains.factorisation(g, budget)
    given, x = equations.mass_entries, collected_along(equations)
    entries = dict(zip(given, x.tidy(list(given.values())), strict=True))
    late = {i for (i, j), node in entries.items() if i == j and x.moves(node)}
    rows = symmetric(len(equations.q), entries)
    # an elimination beyond the budget is not begun
    minimum_degree(list(map(set, rows)), Budget(budget.limit))
    return Factorisation(g, rows, budget, moving=late)


class Elimination:
    """Symbolic solution for q'' and lambda, and for corrections in the metric of M.

    Parameters
    ----------
    equations : Equations
    limit : float
        The largest number of multiplications.

    Attributes
    ----------
    along_links : bool
        Whether q'' is computed by `tensions`, with the present values of masses.

    Raises
    ------
    TooLongError
        Where the elimination takes more than `limit` multiplications.
    """

    def __init__(self, equations: Equations, limit: float = BUDGET) -> None:
        e, g = equations, equations.graph
        self.g = g
        self.budget = Budget(limit)
        self.n, self.m = len(e.q), len(e.rows)
        self.names = [row.name for row in e.rows]
        self.equations = e
        self.mass = factored_mass(e, self.budget)
        self.rows = [without_content(self.collected, row) for row in e.rows]
        self.Z = [self.mass.forward(row.A) for row in self.rows]
        self.unit = self._unit()
        # Forces of a tree share their terms; tidied sums would each have their own
        # copy.
        forces = [] if e.tree else e.f
        tidy = self.collected.tidy([*forces, *e.other_rates])
        self.other_rates = tidy[len(forces) :]
        self.forces = tidy[: len(forces)] or list(e.f)
        rows = symmetric(self.m, self._schur())
        self.schur = Factorisation(g, rows, self.budget)
        f = dict(enumerate(self.forces))
        self._motion = self._solve(f, [row.b for row in self.rows])
        # Corrections are computed later, with a part of these operations.
        self.operations = self.budget.operations
        self.budget.stop()
        found = None
        if turns(e):
            from lagsim.mechanics.tensions import accelerations

            found = accelerations(e)
        # `operations` stays that of L D L^T: tapes pay as early as before.
        self.along_links = found is not None and (
            g.cost(found, e.moving) < g.cost(self._motion[0], e.moving)
        )
        if found is not None and self.along_links:
            self._motion = found, []

    @cached_property
    def collected(self) -> Collected:
        """Rewriter of sums of products on the graph, see `language.forms.Collected`."""
        return collected_along(self.equations)

    def _unit(self) -> int:
        """Return the node of a mass that serves as the unit of mass.

        It is the commonest pivot D_k of M among the indices k of nonzero entries in Z =
        L^-1 A^T, or 1 if one of these pivots varies along the motion.
        """
        pivots = [
            self.mass.pivots[k][0] for k in sorted({k for z in self.Z for k in z})
        ]
        if not pivots or any(map(self.collected.moves, pivots)):
            return self.g.one
        return Counter(pivots).most_common(1)[0][0]

    def _inverse(self, k: int) -> int:
        """Return the node of unit / D_k, where `unit` is the unit of mass."""
        g, inverse = self.g, self.mass.inverse[k]
        if self.unit == g.one:
            return inverse
        pivot = self.mass.pivots[k][0]
        return self.collected.still([self.unit, g.call("div", g.one, pivot)])

    def _schur(self) -> dict[tuple[int, int], int]:
        """Return S = Z^T D^-1 Z times the unit of mass, as a dict (i, j) -> node."""
        # an elimination beyond the budget is not begun
        self.budget.foresee(squares(self.Z) + fill(self.Z))
        holders: dict[int, list[int]] = {}  # coordinate -> rows of Z that have it
        entries = {}
        for i, z in enumerate(self.Z):
            for k in z:
                holders.setdefault(k, []).append(i)
            near = sorted({j for k in z for j in holders[k]})
            for j in near:
                entries[i, j] = self._weighted(z, self.Z[j])
        return entries

    def _weighted(self, z: Mapping[int, int], other: Mapping[int, int]) -> int:
        """Return the node of the unit of mass times z^T D^-1 other.

        z, other : sparse vectors, unknown -> node.
        """
        terms: list[tuple[int, ...]] = []
        for k in sorted(z.keys() & other.keys()):
            self.budget.add(2)
            inverse = self._inverse(k)
            if self.collected.moves(inverse):
                terms.append((self.g.call("mul", z[k], inverse), other[k]))
            else:
                terms.append((inverse, z[k], other[k]))
        return self.collected.sum(terms)

    def motion(self) -> tuple[list[int], list[int]]:
        """Return the nodes of the solution: q'', shape (n,), and lambda, shape (m,)."""
        return self._motion

    def response(self, forces: Sequence[int]) -> list[int]:
        """Return the accelerations, shape (n,), by forces, shape (n,), with b = 0."""
        return self._solve(dict(enumerate(forces)), [self.g.zero] * self.m)[0]

    def reactions(self) -> list[int]:
        """Return, for each row k, the squared norm of the acceleration by lambda_k.

        The result, shape (m,), is lambda_k^2 (A M^-1 A^T)_kk: the square of the length
        of M^-1 A_k^T lambda_k in the metric of M. It is the scale of rounding errors of
        row k.
        """
        g = self.g
        return [
            g.call("mul", g.call("mul", lam, lam), self.square(k))
            for k, lam in enumerate(self._motion[1])
        ]

    def square(self, k: int) -> int:
        """Return the diagonal entry (A M^-1 A^T)_kk of the unscaled row k."""
        g, (whole, weight) = self.g, (self.schur.pivots[k][1], self.rows[k].weight)
        divisor = self.collected.still([self.unit, g.constant(weight**2)])
        return self.collected.sum([(whole, g.call("div", g.one, divisor))])

    def _solve(self, f: Vector, b: Sequence[int]) -> tuple[list[int], list[int]]:
        """Return the nodes of q'' (n,) and lambda (m,) for given f and b.

        f : coordinate -> node. b : (m,), of the scaled rows.
        """
        g, f = self.g, self.mass.forward(f)
        right = {i: self._missing(b[i], z, f) for i, z in enumerate(self.Z)}
        found = self.schur.solve(right)
        q = self._accelerations(f, found)
        lam = [
            self.collected.sum([(self.unit, g.constant(row.weight), found[k])])
            if k in found
            else g.zero
            for k, row in enumerate(self.rows)
        ]
        return [q.get(j, g.zero) for j in range(self.n)], lam

    def _missing(self, b: int, z: Mapping[int, int], f: Mapping[int, int]) -> int:
        """Return the node of b - z^T D^-1 f, the right-hand side for one multiplier.

        b : right-hand side of the row.
        z, f : sparse vectors L^-1 A_k and L^-1 f.
        """
        g, x = self.g, self.collected
        minus = g.constant(-1.0)
        terms: list[tuple[int, ...]] = list(x.addends(b))
        for k in sorted(z.keys() & f.keys()):
            self.budget.add(2)
            inverse = self.mass.inverse[k]
            if self.unit == g.one:  # S has these products already
                terms.append((minus, g.call("mul", z[k], inverse), f[k]))
            else:
                terms.append((minus, z[k], x.scaled(f[k], inverse)))
        return x.sum(terms)

    def _accelerations(self, f: Mapping[int, int], lam: Mapping[int, int]) -> Vector:
        """Return M^-1 (f + A^T lam), from L^-1 f.

        f : L^-1 f, from `Factorisation.forward`.
        lam : multipliers in the unit of mass.
        """
        g, x, mass = self.g, self.collected, self.mass
        terms: dict[int, list[tuple[int, ...]]] = {}
        for i, multiplier in sorted(lam.items()):
            for k, entry in self.Z[i].items():
                self.budget.add(1)
                terms.setdefault(k, []).append((entry, multiplier))
        reactions = {k: x.sum(found) for k, found in terms.items()}
        scaled: Vector = {}
        for k in sorted(f.keys() | reactions.keys()):
            push, pull = f.get(k, g.zero), reactions.get(k, g.zero)
            inverse = mass.inverse[k]
            if self.unit != g.one:
                free = x.scaled(push, inverse)
                scaled[k] = x.sum([(free,), (pull, self._inverse(k))])
            elif mass.columns[k] or k in reactions:  # other rows have `push` as well
                scaled[k] = g.call("mul", g.call("add", push, pull), inverse)
            else:
                scaled[k] = x.scaled(push, inverse)
        return mass.upward(scaled)

    def correction(self, residuals: Sequence[int]) -> list[int]:
        """Return the least change of q, in the metric of M, that cancels residuals.

        The change -M^-1 A^T S^-1 residuals, shape (n,), cancels the `residuals`, shape
        (m,), to first order. All are nodes.
        """
        g = self.g
        right = [
            self.collected.sum([(g.constant(-row.weight), x)])
            for row, x in zip(self.rows, residuals, strict=True)
        ]
        return self._solve({}, right)[0]

    def smallest_singular_value(self) -> int:
        """Return the root of the smallest ratio of a pivot of S to its diagonal entry.

        The root tends to 0 as the smallest singular value of the scaled rows does. The
        length of a row counts as at least the variable `length.<name>`, so that a
        vanishing row yields 0 as well.
        """
        g = self.g
        worst = g.one
        for k, (pivot, _) in self.schur.pivots.items():
            length = g.variable(f"length.{self.names[k]}")
            usual = g.call("max", self.square(k), g.call("mul", length, length))
            weight = g.constant(self.rows[k].weight ** 2)
            scale = self.collected.still([self.unit, weight])
            worst = g.call(
                "min", g.call("div", g.call("div", pivot, scale), usual), worst
            )
        return g.call("sqrt", g.call("max", worst, g.zero))
