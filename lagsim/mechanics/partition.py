"""Accelerations of constrained motions from those of independent coordinates.

The m rows A q'' = b determine the accelerations of m dependent coordinates from those
of the n - m independent ones. The rows are solved in small blocks, each with as many
rows R as coordinates C, by Cramer's rule:

    a_C = J a + p,    J = -A_RC^-1 A_R,    p = A_RC^-1 b_R,

where a are the accelerations of all other coordinates in the rows R. The coordinates of
a block occur in no row of a later block. One block after the other is put into the
equations of motion,

    (M + M_C^T J + J^T (M_C + M_CC J)) a = f - M_C^T p + J^T (f_C - M_CC p),

which at the end are those of the independent coordinates. The multipliers of a block
are A_RC^-T ((M_C + M_CC J) a - (f_C - M_CC p)).

Two rows with common entries, as of two loops that share a joint, are first replaced by
one of them and their difference, which has fewer entries.

A block may become singular along the motion although the rows stay independent. The
partition is valid while the volume of each block is not small.

Sources: R. A. Wehage and E. J. Haug, J. Mech. Des. 104 (1982) 247 (generalized
coordinate partitioning); E. Hairer and G. Wanner, Solving Ordinary Differential
Equations II, section VII.1 (state-space form).
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.language.forms import fewer_terms
from lagsim.language.graph import memoize
from lagsim.mechanics.chains import Factorisation, Vector
from lagsim.mechanics.ldl import Elimination

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from numpy.typing import NDArray

    from lagsim.language.arrays import Floats
    from lagsim.language.forms import Collected
    from lagsim.language.graph import Graph

# Largest number of rows of a block: a joint in space.
LARGEST = 3
# Least volume of a block at the start, of 1 for columns that are orthogonal.
LEAST_VOLUME = 0.2
# A partition is used where q'' takes less than this part of the operations.
PAYS = 0.9


class Difference(NamedTuple):
    """Replacement of a row by row - sign * other, which has fewer entries.

    Attributes
    ----------
    row, other : int
        Indices of two rows.
    sign : float
        1 or -1.
    """

    row: int
    other: int
    sign: float


class ShorterRows(NamedTuple):
    """Rows of A q'' = b after the replacement of some by differences.

    Attributes
    ----------
    A : tuple of dict
        For each row: index of a coordinate -> node of the entry.
    differences : tuple of Difference
        In the order of the replacements.
    """

    A: tuple[Vector, ...]
    differences: tuple[Difference, ...]


class Block(NamedTuple):
    """Block of constraint rows and of the dependent coordinates that they determine.

    Attributes
    ----------
    rows, columns : tuple of int
        Indices of the rows, and of as many dependent coordinates.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]


Blocks = tuple[Block, ...]
Matrix = dict[int, Vector]  # row -> its entries
Marks: TypeAlias = "NDArray[np.bool_]"


def partition_of(
    whole: Elimination, values: Mapping[str, float], sizes: Sequence[float]
) -> Partition | None:
    """Return the solution by a partition; None where it does not pay, or none is found.

    Parameters
    ----------
    whole : Elimination
        The solution by M^-1, without a partition.
    values : mapping of str to float
        The values of all variables at the start.
    sizes : sequence of float, length n
        The square roots of the inertias of the coordinates, or substitutes for them.
    """
    e, g = whole.equations, whole.g
    # With more independent coordinates than rows M^-1 takes fewer operations.
    if not e.rows or e.chains is not None or not 0 < whole.n - whole.m <= whole.m:
        return None
    rows = memoize(g, (ShorterRows, e.nodes), lambda: _in_differences(whole))
    numbers = [np.array(evaluate(g, A.values(), values)) for A in rows.A]
    A = np.zeros((whole.m, whole.n))
    for k, entries in enumerate(rows.A):
        A[k, list(entries)] = numbers[k]
    moving = np.zeros(A.shape, dtype=bool)
    for k, entries in enumerate(rows.A):
        moving[k, list(entries)] = [whole.collected.moves(x) for x in entries.values()]
    blocks = blocks_of(A / np.asarray(sizes), moving, [set(x) for x in rows.A])
    if blocks is None:
        return None
    if not all(x > 0.0 for x in evaluate(g, e.inertias, values)):
        return None
    key = (Partition, e.nodes, blocks)
    found = memoize(g, key, lambda: Partition(whole, rows, blocks))
    costs = (g.cost(x.motion()[0], e.moving) for x in (found, whole))
    return found if next(costs) < PAYS * next(costs) else None


def _in_differences(whole: Elimination) -> ShorterRows:
    """Return the rows of A, of which differences replace some with more entries."""
    x = whole.collected
    A, found = [{**row.A} for row in whole.rows], list[Difference]()
    while True:
        pairs = [
            (_fewer(x, A[i], A[j], sign), -i, -j, sign)
            for i in range(len(A))
            for j in range(len(A))
            for sign in (1.0, -1.0)
            if i != j
        ]
        gain, i, j, sign = max(pairs, default=(0, 0, 0, 0.0))
        if gain <= 0:
            return ShorterRows(tuple(A), tuple(found))
        best = Difference(-i, -j, sign)
        A[best.row] = _difference(x, A[best.row], A[best.other], sign)
        found.append(best)


def _fewer(x: Collected, a: Vector, b: Vector, sign: float) -> int:
    """Return the number of entries that a - sign b has fewer than a; negative if more.

    a, b : rows of nodes. Entries cancel if they are equal nodes.
    """
    g, both = x.g, a.keys() & b.keys()
    opposite = {g.call("neg", b[c]) for c in both} if sign < 0.0 else set[int]()
    equal = sum(a[c] == b[c] if sign > 0.0 else a[c] in opposite for c in both)
    return equal - len(b.keys() - both)


def _difference(x: Collected, a: Vector, b: Vector, sign: float) -> Vector:
    g = x.g
    found = {
        c: _less(x, a.get(c, g.zero), sign, b.get(c, g.zero)) for c in sorted({*a, *b})
    }
    return {c: node for c, node in found.items() if node != g.zero}


def _less(x: Collected, a: int, sign: float, b: int) -> int:
    """Return the node of a - sign b, in which equal terms cancel."""
    minus = x.g.constant(-sign)
    return x.sum([*x.addends(a), *((minus, *term) for term in x.addends(b))])


def blocks_of(
    A: Floats, moving: Marks, entries: Sequence[Collection[int]]
) -> Blocks | None:
    """Return blocks of all rows, or None where a block would be large or near singular.

    The rows of a block are all rows that one of its coordinates occurs in, besides the
    rows of the blocks before. A block with constant entries is preferred, then the one
    with the largest volume.

    Parameters
    ----------
    A : ndarray, shape (m, n)
        The entries, each divided by the size of its coordinate.
    moving : ndarray of bool, shape (m, n)
        Marks the entries that vary along the motion.
    entries : sequence of collection of int, length m
        The coordinates of each row.
    """
    left, found = set(range(len(A))), list[Block]()
    while left:
        best = _next_block(A, moving, entries, left)
        if best is None:
            return None
        found.append(best)
        left.difference_update(best.rows)
    return tuple(found)


def _next_block(
    A: Floats,
    moving: Marks,
    entries: Sequence[Collection[int]],
    left: Collection[int],
) -> Block | None:
    """Return the block with the fewest rows, of the rows `left`; None if none is found.

    For the arguments see `blocks_of`.
    """
    holders: dict[int, set[int]] = {}
    for k in sorted(left):
        for c in entries[k]:
            holders.setdefault(c, set()).add(k)
    for rows in sorted({tuple(sorted(x)) for x in holders.values()}, key=_by_length):
        if len(rows) > LARGEST:
            break
        own = sorted(c for c, x in holders.items() if x.issubset(rows))
        tried = [
            (int(moving[np.ix_(rows, cs)].sum()), -volume(A[list(rows)], cs), cs)
            for cs in combinations(own, len(rows))
        ]
        good = [x for x in tried if -x[1] >= LEAST_VOLUME]
        if good:
            return Block(rows, min(good)[2])
    return None


def _by_length(rows: tuple[int, ...]) -> tuple[int, tuple[int, ...]]:
    return len(rows), rows


def volume(A: Floats, columns: Sequence[int]) -> float:
    """Return |det A_C| over the product of the lengths of the rows of A (k, n).

    A_C (k, k) has the columns `columns` of A. The volume is at most 1; it is 0 if A_C
    is singular, or not finite.

    Examples
    --------
    >>> volume(np.array([[3.0, 4.0]]), [1])
    0.8
    """
    lengths = np.prod(np.linalg.norm(A, axis=1))
    found = abs(np.linalg.det(A[:, list(columns)])) / lengths if lengths > 0.0 else 0.0
    return float(found) if np.isfinite(found) else 0.0


class _Solved(NamedTuple):
    """A block that is solved for the accelerations of its coordinates.

    Attributes
    ----------
    rows, columns : tuple of int
        Of the block.
    determinant : int
        Node of det A_RC.
    cofactors : dict
        (coordinate, row) -> node of the entry of A_RC^-1 times the determinant.
    shift : dict
        Coordinate of the block -> node of p along the motion.
    J, momenta : dict
        Coordinate of the block -> its row of J, and of M_C + M_CC J without M_CC.
    own, across : dict
        Coordinate of the block -> its row of M_CC, and of M_C without M_CC.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    determinant: int
    cofactors: dict[tuple[int, int], int]
    shift: Vector
    J: Matrix
    momenta: Matrix
    own: Matrix
    across: Matrix


class Partition(Elimination):
    """Symbolic solution for q'' and lambda by independent coordinates.

    Parameters
    ----------
    whole : Elimination
        The solution by M^-1.
    rows : ShorterRows
        The rows, with differences in place of some.
    blocks : tuple of Block
        The blocks in which the rows are solved.

    Attributes
    ----------
    blocks : tuple of Block
    """

    def __init__(self, whole: Elimination, rows: ShorterRows, blocks: Blocks) -> None:
        self._whole = whole
        self.g, self.equations, self.names = whole.g, whole.equations, whole.names
        self.n, self.m, self.along_links = whole.n, whole.m, False
        # The inverse of M remains the scale of rounding errors and corrections.
        self.mass, self.rows, self.Z = whole.mass, whole.rows, whole.Z
        self.unit, self.schur = whole.unit, whole.schur
        self.forces, self.other_rates = whole.forces, whole.other_rates
        self.budget, self.operations = whole.budget, whole.operations
        self.blocks, self._A, self._differences = blocks, rows.A, rows.differences
        entries, M = self.equations.mass_entries, [Vector() for _ in range(self.n)]
        tidy = self.collected.tidy(list(entries.values()))
        for (i, j), node in zip(entries, tidy, strict=True):
            M[i][j] = node
        right = self._in_differences([row.b for row in self.rows])
        self._solved = [self._solve_block(block, M, right) for block in blocks]
        self._reduced = Factorisation(self.g, M, self.budget, unknowns=self.independent)
        shifts = [block.shift for block in self._solved]
        self._motion = self._accelerated(dict(enumerate(self.forces)), shifts)

    @property
    def independent(self) -> list[int]:
        """Indices of the coordinates that are in no block."""
        in_blocks = {c for block in self.blocks for c in block.columns}
        return [c for c in range(self.n) if c not in in_blocks]

    def _solve_block(
        self, block: Block, M: list[Vector], right: Sequence[int]
    ) -> _Solved:
        """Solve the rows of a block for its accelerations, and eliminate these from M.

        M : the rows of the mass matrix, coordinate -> node; changed in place.
        right : right-hand sides (m,), see `_in_differences`.
        """
        g, A, (rows, columns) = self.g, self._A, block
        others = sorted({c for k in rows for c in A[k]}.difference(columns))
        D = [[A[k].get(c, g.zero) for c in columns] for k in rows]
        cofactors = {
            (c, k): _cofactor(g, D, i, j)
            for j, c in enumerate(columns)
            for i, k in enumerate(rows)
        }

        def numerator(c: int, values: Mapping[int, int]) -> int:
            return g.product_sum(
                (cofactors[c, k], values[k]) for k in rows if k in values
            )

        minus = {
            o: {k: g.call("neg", A[k][o]) for k in rows if o in A[k]} for o in others
        }
        whole = numerator(columns[0], {k: D[i][0] for i, k in enumerate(rows)})
        slopes = [(c, o) for c in columns for o in others]
        nodes = [numerator(c, minus[o]) for c, o in slopes]
        nodes += [numerator(c, dict(enumerate(right))) for c in columns]
        nodes = fewer_terms(g, [whole, *nodes], self.equations.moving)
        whole, *nodes = self.collected.tidy(nodes)
        quotients = [self._over(node, whole) for node in nodes]
        J: Matrix = {c: {} for c in columns}
        for (c, o), node in zip(slopes, quotients, strict=False):
            if node != g.zero:
                J[c][o] = node
        shift = dict(zip(columns, quotients[len(slopes) :], strict=True))
        own = {c: {d: M[c][d] for d in columns if d in M[c]} for c in columns}
        across = {
            c: {o: node for o, node in M[c].items() if o not in columns}
            for c in columns
        }
        momenta = {c: self._plus(across[c], own[c], J) for c in columns}
        for c in columns:
            for o in across[c]:
                del M[o][c]
            M[c].clear()
        self._add_motion(M, J, momenta, across)
        return _Solved(rows, columns, whole, cofactors, shift, J, momenta, own, across)

    def _add_motion(
        self, M: list[Vector], J: Matrix, momenta: Matrix, across: Matrix
    ) -> None:
        """Add M_C^T J + J^T (M_C + M_CC J) to the rows of M, in place."""
        x, terms = self.collected, dict[tuple[int, int], list[tuple[int, int]]]()
        for c, slopes in J.items():
            pairs = [(across[c], slopes), (slopes, momenta[c])]
            for one, other in pairs:
                for a, left in one.items():
                    for b, right in other.items():
                        if a <= b:
                            terms.setdefault((a, b), []).append((left, right))
        for (a, b), products in sorted(terms.items()):
            known = x.addends(M[a].get(b, self.g.zero))
            M[a][b] = M[b][a] = x.sum([*known, *products])

    def _plus(self, across: Vector, own: Vector, J: Matrix) -> Vector:
        """Return the row `across` + `own` J as nodes by coordinate.

        It has the coefficients of a momentum by the other coordinates after the block's
        coordinates are eliminated, see `momenta` of `_Solved`.
        """
        x, g = self.collected, self.g
        every = sorted({*across, *(o for d in own for o in J[d])})
        return {
            o: x.sum([
                *x.addends(across.get(o, g.zero)),
                *((node, J[d][o]) for d, node in own.items() if o in J[d]),
            ])
            for o in every
        }  # fmt: skip

    def _over(self, node: int, divisor: int) -> int:
        """Return node / divisor, with the constant factors of both in one."""
        g, x = self.g, self.collected
        whole, core = x.parts(divisor)
        inverse = g.call("div", g.one, whole)
        terms = list(x.addends(node))
        if len(terms) == 1 or x.parts(node)[0] != g.one:
            still, rest = x.parts(node)
            return g.call("mul", x.still([still, inverse]), g.call("div", rest, core))
        inside = x.sum((inverse, sign, *x.parts(n)) for sign, n in terms)
        return g.call("div", inside, core)

    def _in_differences(self, right: Sequence[int]) -> list[int]:
        """Return right-hand sides (m,) of `ShorterRows`, which has differences of rows.

        right : the right-hand sides (m,) of the scaled rows before the replacement.
        """
        found = list(right)
        for d in self._differences:
            found[d.row] = _less(self.collected, found[d.row], d.sign, found[d.other])
        return found

    def _solve(self, f: Vector, b: Sequence[int]) -> tuple[list[int], list[int]]:
        right, shifts = self._in_differences(b), list[Vector]()
        for s in self._solved:
            products = {c: [(s.cofactors[c, k], right[k]) for k in s.rows]
                        for c in s.columns}  # fmt: skip
            found = {c: self.collected.sum(x) for c, x in products.items()}
            shifts.append({c: self._over(x, s.determinant) for c, x in found.items()})
        return self._accelerated(f, shifts)

    def _accelerated(
        self, f: Vector, shifts: Sequence[Vector]
    ) -> tuple[list[int], list[int]]:
        """Return the nodes of q'' (n,) and lambda (m,) for given forces and shifts.

        f : coordinate -> node. shifts : p of each block, as coordinate -> node.
        """
        g, x, minus = self.g, self.collected, self.g.constant(-1.0)
        f, pushes = dict(f), list[Vector]()
        for s, p in zip(self._solved, shifts, strict=True):
            push = {
                c: x.sum([
                    *x.addends(f.get(c, g.zero)),
                    *((minus, node, p[d]) for d, node in s.own[c].items()),
                ])
                for c in s.columns
            }  # fmt: skip
            for o in sorted({o for c in s.columns for o in (*s.across[c], *s.J[c])}):
                parts = [(minus, s.across[c][o], p[c])
                         for c in s.columns if o in s.across[c]]  # fmt: skip
                moved = [(s.J[c][o], push[c]) for c in s.columns if o in s.J[c]]
                f[o] = x.sum([*x.addends(f.get(o, g.zero)), *parts, *moved])
            pushes.append(push)
        a = self._reduced.solve({c: f.get(c, g.zero) for c in self.independent})
        lam = [g.zero] * self.m
        steps = list(zip(self._solved, shifts, pushes, strict=True))
        for s, p, push in reversed(steps):
            for c in s.columns:
                terms = [(node, a[o]) for o, node in s.J[c].items() if o in a]
                a[c] = x.sum([(p[c],), *terms])
            left = {
                c: x.sum([
                    *((node, a[o]) for o, node in s.momenta[c].items() if o in a),
                    (minus, push[c]),
                ])
                for c in s.columns
            }  # fmt: skip
            for k in s.rows:
                total = x.sum((s.cofactors[c, k], left[c]) for c in s.columns)
                lam[k] = self._over(total, s.determinant)
        for d in reversed(self._differences):
            lam[d.other] = _less(x, lam[d.other], d.sign, lam[d.row])
        weights = (g.constant(row.weight) for row in self.rows)
        lam = [x.sum([pair]) for pair in zip(weights, lam, strict=True)]
        return [a.get(c, g.zero) for c in range(self.n)], lam

    def correction(self, residuals: Sequence[int]) -> list[int]:
        """Return the least change of q (n,), as nodes, that cancels residuals (m,).

        It is that of `Elimination`: without the partition it takes fewer operations,
        since it contains sines and cosines of the same angles as the residuals.
        """
        return self._whole.correction(residuals)

    def smallest_singular_value(self) -> int:
        """Return the node of a number in [0, 1] that is 0 where a block is singular.

        It is the least of the volumes of all blocks, see `volume`, with coordinates
        scaled by the roots of their inertias. The length of a row is at least its
        weight times the variable `length.<name>`.
        """
        g, worst, inertias = self.g, self.g.one, self.equations.inertias

        def square(node: int, c: int) -> int:
            return g.call("div", g.call("mul", node, node), inertias[c])

        for s in self._solved:
            part = g.call("mul", s.determinant, s.determinant)
            for c in s.columns:
                part = g.call("div", part, inertias[c])
            for k in s.rows:
                length = g.call("mul", g.constant(self.rows[k].weight),
                                g.variable(f"length.{self.names[k]}"))  # fmt: skip
                usual = g.sum(square(node, c) for c, node in self._A[k].items())
                usual = g.call("max", usual, g.call("mul", length, length))
                part = g.call("div", part, usual)
            worst = g.call("min", part, worst)
        return g.call("sqrt", worst)


def _cofactor(g: Graph, D: Sequence[Sequence[int]], i: int, j: int) -> int:
    """Return the cofactor of entry (i, j) of a matrix D (k, k) of nodes."""
    minor = [[*row[:j], *row[j + 1 :]] for k, row in enumerate(D) if k != i]
    found = _determinant(g, minor)
    return g.call("neg", found) if (i + j) % 2 else found


def _determinant(g: Graph, D: Sequence[Sequence[int]]) -> int:
    if not D:
        return g.one
    return g.product_sum((D[0][j], _cofactor(g, D, 0, j)) for j in range(len(D)))
