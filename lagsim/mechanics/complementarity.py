"""Mixed linear complementarity problems with bounds that depend on other multipliers.

Find multipliers p (r,) such that, with w = D p + c, each row k satisfies

    low_k <= p_k <= high_k,   w_k >= 0 at low_k,   w_k <= 0 at high_k,   else w_k = 0

where both bounds are affine in the multiplier p_n of the contact of the row. The kind
of a row is expressed by its bounds alone:

    equality in force                      -inf, inf
    contact, freewheel                     0, inf
    slip: friction of a contact            -mu p_n, mu p_n; of two slips |p| <= mu p_n
    equality of bounded multiplier         -L, L
    sliding row, d = -sign of the slip     both d mu p_n, or d L
    row out of force                       0, 0

D need not be symmetric. Rows may be linearly dependent: then p is not unique, but w is.

The following attempts are made in turn; the first that solves the problem to rounding
counts, else the best one.

0. A large problem with constant bounds and a symmetric D with a narrow band, as of a
   stack: the rows that hold are found by Newton's method on that band.
1. Newton's method on F(p) = p - P(p - w), with P the projection onto the bounds. F is
   piecewise smooth; where the method converges, the rows that hold are solved as
   equations. The result is discarded where these rows are dependent: it would
   distribute the multipliers over all of them where a few rows suffice.
2. Lemke's method. With directions d_i that span a row (1 and -1; for two slips a
   polygon in place of the disc), p = sum of a_i d_i, a >= 0, and l, the size of the
   slip,

       a_i >= 0 complements d_i . w + l,    l >= 0 complements high - sum of a_i

   which for friction is copositive for every mu: there is a solution, and Lemke's
   method finds it. Ties are broken lexicographically, which excludes cycles: on
   degenerate problems (balls that touch at rest, redundant legs) the method ends, too,
   at a solution whose rows with nonzero multipliers are independent. With discs,
   Newton's method continues from there, or from a polygon of more corners. Last, where
   all bounds are constant, Newton's method for a smoothed minimum problem.
3. Proximal point iteration: a small addition to the diagonal makes rows independent,
   and its effect on the solution is removed by iteration. Where rows with discs are
   dependent, this attempt is the first: it leads approximately to the least
   multipliers, inside the discs where possible.
4. Lemke's method with each bounded multiplier fixed at the bound opposite to its rate.
   Rates far larger than all changes by multipliers would hide these changes by
   rounding in the pivots.

Sources: D. E. Stewart, J. C. Trinkle, An implicit time-stepping scheme for rigid body
dynamics with inelastic collisions and Coulomb friction, Int. J. Num. Meth. Eng. 39
(1996) 2673; R. W. Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem
(1992), sections 4.4 and 4.9; P. Alart, A. Curnier, A mixed formulation for frictional
contact problems prone to Newton like solution methods, Comput. Methods Appl. Mech. Eng.
92 (1991) 353.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.algebra import (
    BANDED,
    BandFactor,
    identity,
    largest,
    least_squares,
    symmetric_band,
)
from lagsim.mechanics.lemke import lemke
from lagsim.tolerances import (
    CONVERGED,
    DEPENDENT_DIRECTIONS,
    DEPENDENT_SQUARE,
    RESIDUAL_ROUNDOFF,
    SOLVED_LAWS,
    TERM_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.language.arrays import Flags, Floats, Ints


@dataclass(frozen=True)
class ComplementarityProblem:
    """Mixed linear complementarity problem of r rows; see the module docstring.

    Attributes
    ----------
    D : ndarray, shape (r, r)
    c : ndarray, shape (r,)
    low, high : ndarray, shape (2, r)
        Bounds of p: of row k, low[0, k] + low[1, k] p_n, with n the row of its contact.
    normals, pairs : ndarray of int, shape (r,)
        The index of the row of the contact; the index of the other slip of a pair,
        whose bounds are symmetric to 0. -1 where there is none.
    """

    D: Floats
    c: Floats
    low: Floats
    high: Floats
    normals: Ints
    pairs: Ints

    def part(self, rows: list[int]) -> ComplementarityProblem:
        """Return the problem of `rows` alone.

        The other rows must not be coupled with these rows.
        """
        place = np.full(len(self.c) + 1, -1)  # the last entry is for index -1
        place[rows] = np.arange(len(rows))
        return ComplementarityProblem(
            self.D[np.ix_(rows, rows)], self.c[rows], self.low[:, rows],
            self.high[:, rows], place[self.normals[rows]], place[self.pairs[rows]],
        )  # fmt: skip

    @cached_property
    def fixed(self) -> Flags:
        """Mask (r,) of the rows whose lower and upper bound are equal."""
        return np.asarray((self.low == self.high).all(axis=0))

    @cached_property
    def own(self) -> Flags:
        """Mask (r,) of the rows whose bounds are constant, not bounds of friction."""
        return self.normals < 0

    @cached_property
    def is_constant(self) -> bool:
        """Whether no bound depends on a contact."""
        return bool(self.own.all())

    @cached_property
    def discs(self) -> list[list[int]]:
        """Pairs of indices of the rows that share a disc, in ascending order."""
        pairs = [[j, k] for k, j in enumerate(self.pairs.tolist()) if 0 <= j < k]
        return [rows for rows in pairs if not self.fixed[rows[1]]]

    def bounds(self, p: Floats) -> tuple[Floats, Floats]:
        """Return the lower and the upper bounds, each (r,), at multipliers p (r,)."""
        if self.is_constant:
            return self.low[0], self.high[0]
        push = p[self.normals]
        push = np.where(self.fixed, push, np.maximum(push, 0.0))
        push[self.own] = 0.0
        return self.low[0] + self.low[1] * push, self.high[0] + self.high[1] * push

    def limits(self, p: Floats) -> Floats:
        """Return the bound of each |p_k| at multipliers p (r,).

        It is 0 for rows without two-sided bounds.
        """
        most = np.abs(self.bounds(p)[1])
        return np.where(np.isfinite(most), most, 0.0)


class Solution(NamedTuple):
    """Multipliers p (r,), w = D p + c (r,), and `found`: whether they are a solution.

    w is exactly 0 where p is between its bounds.
    """

    p: Floats
    w: Floats
    found: bool


def solve(problem: ComplementarityProblem) -> Solution:
    """Solve a mixed linear complementarity problem.

    Decoupled groups of rows are solved separately, since a size that is rounding in one
    group may be significant in another.

    Parameters
    ----------
    problem : ComplementarityProblem
        Of r rows.

    Returns
    -------
    Solution
        With `found` False where no attempt solves the problem of some group.

    Raises
    ------
    FloatingPointError
        Where c or D is not finite.
    """
    if not (np.isfinite(problem.c).all() and np.isfinite(problem.D).all()):
        raise FloatingPointError("forces that are not finite")
    parts = coupled_groups(problem)
    p, w = np.zeros((2, len(problem.c)))
    own, found = problem.D.diagonal(), True
    alone = [rows[0] for rows in parts if len(rows) == 1 and own[rows[0]] >= 0.0]
    if alone:
        p[alone], w[alone] = _solved_alone(problem, alone)
    at_rest = problem.c == 0.0
    if at_rest.any():
        within = (problem.low <= 0.0) & (problem.high >= 0.0)
        at_rest &= within.all(axis=0)
    for rows in parts:
        if at_rest[rows].all():
            continue
        if len(rows) > 1 or own[rows[0]] < 0.0:
            part = problem if len(parts) == 1 else problem.part(rows)
            p[rows], w[rows], solved = _solved(part)
            found = found and solved
    return Solution(p, w, found)


def _solved_alone(
    problem: ComplementarityProblem, rows: list[int]
) -> tuple[Floats, Floats]:
    """Return p (k,) and w (k,) of the k `rows`, which are coupled with no other row.

    The diagonal elements of D of these rows must not be negative.

    problem : the problem of all rows.
    """
    own, c = problem.D.diagonal()[rows], problem.c[rows]
    moves = own > 0.0
    z = np.where(moves, -c / np.where(moves, own, 1.0), 0.0)
    p = np.clip(z, problem.low[0, rows], problem.high[0, rows])
    p = np.where(moves, p, 0.0)
    return p, np.where(moves & (p == z), 0.0, own * p + c)


def coupled_groups(problem: ComplementarityProblem) -> list[list[int]]:
    """Return the groups of rows that are coupled by entries of D, bounds or discs.

    Each group is a list of indices of rows.
    """
    r = len(problem.c)
    if problem.D.all():
        return [list(range(r))] if r else []
    coupled = (problem.D != 0.0).tobytes()
    return _groups(r, coupled, tuple(problem.normals), tuple(problem.pairs))


@lru_cache(maxsize=64)
def _groups(r: int, coupled: bytes, *others: tuple[int, ...]) -> list[list[int]]:
    """Return the groups of r rows that are coupled; memoized, since they seldom change.

    coupled : flags (r, r) of coupled rows, as bytes.
    others : tuples with the index, for each row, of another row in its group, or -1.
    """
    sets = DisjointSets(r)
    pairs = np.frombuffer(coupled, dtype=bool).reshape(r, r)
    for i, j in np.argwhere(np.triu(pairs | pairs.T, 1)).tolist():
        sets.merge(i, j)
    for linked in others:
        for k, j in enumerate(linked):
            if j >= 0:
                sets.merge(k, int(j))
    return sets.sets()


def solved_regular(D: Floats, right: Floats) -> Floats | None:
    """Solve D x = right for x (k,) by a Cholesky factor.

    None for a single row, or where rows are nearly dependent.

    D : ndarray, shape (k, k)
        Symmetric to rounding.
    """
    if not is_regular(D):
        return None
    if (band := symmetric_band(D)) is not None:
        factor = BandFactor(band)
        x = factor.solve(right)
        return x - factor.solve(D @ x - right)
    x = np.asarray(np.linalg.solve(D, right), dtype=float)
    return np.asarray(x - np.linalg.solve(D, D @ x - right))


# Least pivot of a regular matrix that is scaled to a diagonal of ones.
REGULAR_PIVOT = 1e-2


def is_regular(D: Floats) -> bool:
    """Whether D (k, k), k > 1, has no pivot near 0 if scaled to a unit diagonal.

    D : symmetric to rounding.
    """
    own = D.diagonal()
    if not (len(own) > 1 and own.min() > 0.0 and np.isfinite(own).all()):
        return False
    if np.count_nonzero(D) == len(own):
        return True  # diagonal
    band, s = symmetric_band(D), 1.0 / np.sqrt(own)
    try:
        if band is not None:
            pivots = s * BandFactor(band).lower[0]
        else:
            pivots = np.asarray(np.linalg.cholesky(D * s * s[:, None]).diagonal())
    except np.linalg.LinAlgError:
        return False
    return bool(pivots.min() ** 2 >= REGULAR_PIVOT)


def _solved(problem: ComplementarityProblem) -> Solution:
    found = _solved_by_band(problem)
    if found is not None:
        return found
    unit, s = _scaled(problem)
    best, least = None, np.inf
    for point in _attempts(unit):
        off = max(point.residual, point.residual_of_discs())
        if off < least:
            best, least = point, off
        if least <= CONVERGED:
            break
    best = best or _MultiplierPoint(unit, np.zeros(len(s)))
    p = best.p - best.F
    free = [k for rows in unit.discs for k in rows]
    p[free] = best.p[free]
    w = np.where(best.inside, 0.0, best.w)
    return Solution(p * s, w / s, best.residual < SOLVED_LAWS)


def _solved_by_band(problem: ComplementarityProblem) -> Solution | None:
    """Solve a large problem with constant bounds by Newton's method on the band of D.

    The first step solves w = D p + c = 0 for all rows whose bounds differ. Each further
    step solves it for the rows whose z_k = p_k - w_k/D_kk is between their bounds; the
    other multipliers are at the bound nearest to z_k. Return None if D is not symmetric
    with a narrow band, rows are nearly dependent, or the method does not converge.
    """
    D, c, r = problem.D, problem.c, len(problem.c)
    if r < BANDED or not problem.is_constant or problem.discs:
        return None
    band, own = symmetric_band(D), D.diagonal()
    if band is None or not own.min() > 0.0:
        return None
    if np.abs(D - D.T).max() > TERM_ROUNDOFF * own.max():
        return None
    low, high = problem.low[0], problem.high[0]
    inside, p = low < high, np.clip(np.zeros(r), low, high)
    for _ in range(STEPS):
        part = band.copy()
        part[0, ~inside] = 1.0
        for k in range(1, len(band)):
            part[k, : r - k] *= inside[k:] & inside[: r - k]
        try:
            factor = BandFactor(part)
        except np.linalg.LinAlgError:
            return None
        if (factor.lower[0] ** 2 / part[0]).min() <= DEPENDENT_DIRECTIONS:
            return None
        for _ in range(2):  # refined once
            p = p - factor.solve(np.where(inside, D @ p + c, 0.0))
        w = D @ p + c
        z = p - w / own
        inside, nearest = (low < z) & (z < high), np.clip(z, low, high)
        terms = np.abs(D) @ np.abs(p) + np.abs(c)
        if np.abs((p - nearest) * own).max() <= CONVERGED * terms.max():
            return Solution(nearest, np.where(inside, 0.0, w), found=True)
        p = np.where(inside, p, nearest)
    return None


def _scaled(problem: ComplementarityProblem) -> tuple[ComplementarityProblem, Floats]:
    """Return the problem scaled to a diagonal near 1, and scales (r,) of multipliers.

    The scales are powers of two. The multipliers of the given problem are those of the
    scaled problem times the scales. Rows without an entry in D have the bounds 0.
    """
    D, n, low, high = problem.D, problem.normals, problem.low, problem.high
    most = D.diagonal()
    if problem.discs:  # the two rows of a disc have one scale, between their own scales
        pairs = problem.pairs
        mean, larger = np.sqrt(most * most[pairs]), np.maximum(most, most[pairs])
        most = np.where(pairs >= 0, np.where(mean > 0.0, mean, larger), most)
    own = most > 0.0
    s = 2.0 ** -np.round(np.log2(np.where(own, most, 1.0)) / 2.0)
    by = np.array([1.0 / s, np.where(problem.own, 1.0, s[n]) / s])
    if not own.all():
        present = D.any(axis=0) | D.any(axis=1)
        low, high = (np.where(present, bound, 0.0) for bound in (low, high))
    low, high = low * by, high * by
    D = D * s * s[:, None]
    return replace(problem, D=D, c=s * problem.c, low=low, high=high), s


# Part of the diagonal that proximal points add, and number of iterations, each for
# problems with discs and without.
FIRM_ON_DISCS, FIRM = 1e-2, 1e-6
PROXIMAL_ON_DISCS, PROXIMAL = 8, 2


def _attempts(unit: ComplementarityProblem) -> Iterator[_MultiplierPoint]:
    """Yield candidate solutions of a scaled problem, see the module docstring."""
    r, discs = len(unit.c), bool(unit.discs)
    if not discs or np.linalg.matrix_rank(unit.D, DEPENDENT_DIRECTIONS) == r:
        point = _descend(unit, _start(unit))
        if _regular(point.slopes(), np.ones(r)) is not None:
            yield point
    if discs:
        yield _proximal(unit, FIRM_ON_DISCS, PROXIMAL_ON_DISCS)
        for corners in CORNERS:
            yield _descend(unit, _by_pivots(unit, corners))
        # Where solutions of D p + c = 0 touch a disc, Newton's steps are slow.
        yield _descend(unit, -least_squares(unit.D, unit.c, DEPENDENT_SQUARE))
        symmetric = unit.is_constant and (unit.low[0] == -unit.high[0]).all()
        if symmetric and _symmetric(unit):
            yield _descend(unit, _smoothed(unit))
        return
    yield _MultiplierPoint(unit, _by_pivots(unit))
    yield _proximal(unit, FIRM, PROXIMAL)
    limited = np.isfinite(unit.high).all(axis=0)
    at = np.where(unit.c > 0.0, unit.low, unit.high)
    low, high = np.where(limited, at, unit.low), np.where(limited, at, unit.high)
    yield _MultiplierPoint(unit, _by_pivots(replace(unit, low=low, high=high)))


def _proximal(
    unit: ComplementarityProblem, shift: float, times: int
) -> _MultiplierPoint:
    """Compute multipliers by proximal point iteration.

    Parameters
    ----------
    unit : ComplementarityProblem
        Scaled.
    shift : float
        The part of the diagonal that is added to it.
    times : int
        The largest number of iterations.
    """
    p, extra = np.zeros(len(unit.c)), shift * np.abs(unit.D.diagonal())
    D, discs = unit.D + np.diag(extra), bool(unit.discs)
    for _ in range(times):
        shifted = replace(unit, D=D, c=unit.c - extra * p)
        p = _descend(shifted, p).p if discs else _by_pivots(shifted)
        found = _descend(unit, p)
        if found.residual <= RESIDUAL_ROUNDOFF:
            break
    return found


def _start(unit: ComplementarityProblem) -> Floats:
    """Return the multipliers (r,) from which Newton's method starts.

    If no bound depends on another multiplier and D is symmetric and positive definite,
    the solution is unique: the start is then the solution with all rows held, cut at
    the bounds. (From 0, Newton's method would reach the rows of a stack one by one.)
    Otherwise, as for dependent rows, the start is 0, since the former start would lead
    to an arbitrary one of several solutions.

    unit : the scaled problem.
    """
    D, start = unit.D, np.zeros(len(unit.c))
    plain = unit.is_constant and not unit.discs
    if not (plain and _symmetric(unit)):
        return start
    try:
        pivots = np.linalg.cholesky(D).diagonal()
    except np.linalg.LinAlgError:
        return start
    if pivots.min() <= DEPENDENT_DIRECTIONS:
        return start
    return np.clip(np.linalg.solve(D, -unit.c), unit.low[0], unit.high[0])


def _symmetric(unit: ComplementarityProblem) -> bool:
    """Whether D of a scaled problem is symmetric to rounding."""
    return bool(np.abs(unit.D - unit.D.T).max() <= TERM_ROUNDOFF)


# First and last smoothing, in parts of the largest |c|, and the ratio of two; greatest
# number of Newton steps at each, and of halvings of a step; part of its slope by which
# the function falls.
ROUNDED, SHARPER, LAST = 1.0, 1e-2, 1e-18
HALVED, FALLS = 40, 1e-4


def _smoothed(unit: ComplementarityProblem) -> Floats:
    """Minimize a smoothed dual function; return multipliers (r,) near the solution.

    With bounds b symmetric to 0, the multipliers minimize the convex function p D p / 2
    + sum of b_g |w_g|, w = D p + c, over single rows and discs g. |w| is replaced by
    sqrt(|w|^2 + e^2) with ever smaller e: Newton's method follows the minimum also
    where inertias in the directions of a disc differ by many powers of ten, since
    nothing is compared across these directions.

    unit : the scaled problem.
    """
    D, pairs, b = unit.D, unit.pairs, unit.high[0]
    p, unit_rows = np.zeros(len(b)), np.eye(len(b))
    share = np.where(pairs < 0, b, 0.5 * b)  # a disc has two rows

    def lengths(w: Floats, e: float) -> Floats:
        others = np.where(pairs < 0, 0.0, w[pairs])
        return np.asarray(np.sqrt(w * w + others * others + e * e))

    size = float(np.abs(unit.c).max())
    e = ROUNDED * size
    while e > LAST * size:
        for _ in range(STEPS):
            w = unit.c + D @ p
            long = lengths(w, e)
            F = p + b * w / long
            if np.abs(F).max() <= CONVERGED * b.max():
                break
            H = np.diag(b / long * (1.0 - (w / long) ** 2))
            for i, k in unit.discs:
                H[i, k] = H[k, i] = -b[i] * w[i] * w[k] / long[i] ** 3
            step = _newton_step(unit_rows + H @ D, F)
            value = 0.5 * p @ D @ p + share @ long
            slope, part = F @ D @ step, 1.0
            for _ in range(HALVED):
                there = p + part * step
                w = unit.c + D @ there
                long = lengths(w, e)
                less = 0.5 * there @ D @ there + share @ long
                if less <= value + FALLS * part * slope:
                    break
                # Near the minimum, differences of the function are rounding.
                if np.abs(there + b * w / long).max() < 0.5 * np.abs(F).max():
                    break
                part *= 0.5
            p = there
        e *= SHARPER
    return p


# --- Newton's method ------------------------------------------------------------------

# Largest number of Newton steps; near the solution about five suffice.
STEPS = 30
# Damping factors of a Newton step, in the order of trial.
PARTS = (1.0, 0.5, 0.25, 0.0625)
# A solution larger than the right-hand side by this factor indicates dependent rows.
FAR = 1e8


def _descend(problem: ComplementarityProblem, p: Floats) -> _MultiplierPoint:
    """Iterate Newton's method from p (r,) as long as the size of F decreases.

    problem : the problem, whose residual F is defined in the module docstring.
    """
    here = _MultiplierPoint(problem, p)
    least = TERM_ROUNDOFF * largest(problem.c)
    for _ in range(STEPS):
        if here.size <= least:
            break
        step = _newton_step(here.slopes(), here.F)
        for part in PARTS:
            there = _MultiplierPoint(problem, here.p + part * step)
            if there.size < here.size:
                break
        else:
            break
        here = there
    return here


def _newton_step(J: Floats, F: Floats) -> Floats:
    """Return x (r,) with J x = -F; the least x where J (r, r) is singular to rounding.

    F : ndarray, shape (r,).
    """
    step = _regular(J, -F)
    if step is None:
        step = np.asarray(np.linalg.lstsq(J, -F, rcond=TERM_ROUNDOFF)[0], float)
    return step


def _regular(J: Floats, right: Floats) -> Floats | None:
    """Solve J x = right for x (r,); None where J (r, r) is singular to rounding."""
    try:
        x = np.asarray(np.linalg.solve(J, right), float)
    except np.linalg.LinAlgError:
        return None
    return None if largest(x) > FAR * largest(right) else x


class _MultiplierPoint:
    """Multipliers p (r,) with the residual F (r,), which is zero at solutions.

    Attributes
    ----------
    w : ndarray, shape (r,)
        D p + c.
    z : ndarray, shape (r,)
        p - w.
    high : ndarray, shape (r,)
        The upper bounds at p.
    inside : ndarray of bool, shape (r,)
        z is between the bounds, or inside the disc: the row holds, with F = w.
    F : ndarray, shape (r,)
        p less the projection of z onto the bounds, where z is outside.
    size : float
        The largest |F|.
    """

    def __init__(self, problem: ComplementarityProblem, p: Floats) -> None:
        self.problem, self.p = problem, p
        self.w = problem.D @ p + problem.c
        low, self.high = problem.bounds(p)
        z = self.z = p - self.w
        self.inside = (low < z) & (z < self.high)
        nearest = np.minimum(np.maximum(z, low), self.high)
        self.F = np.where(self.inside, self.w, p - nearest)
        for rows in problem.discs:
            size, bound = float(np.hypot(*z[rows])), self.high[rows[1]]
            self.inside[rows] = size <= bound
            self.F[rows] = self.w[rows]
            if size > bound:
                self.F[rows] = p[rows] - bound / size * z[rows]
        self.size = largest(self.F)

    @cached_property
    def residual(self) -> float:
        """The largest |F| relative to the largest sum of |terms| of w."""
        problem = self.problem
        terms = np.abs(problem.D) @ np.abs(self.p) + np.abs(problem.c)
        return self.size / (float(terms.max()) or 1.0)

    def residual_of_discs(self) -> float:
        """Return the largest |F| of rows of discs, relative to the terms of each row.

        F is zero at solutions. The two rows of a disc are scaled by one number; where
        the inertia in their directions differs, the terms of one row are much smaller
        than the terms of the other, and `residual` would hide an error in this row.
        """
        problem, most = self.problem, 0.0
        for k in (k for rows in problem.discs for k in rows):
            terms = float(np.abs(problem.D[k]) @ np.abs(self.p) + abs(problem.c[k]))
            most = max(most, abs(float(self.F[k])) / terms if terms else 0.0)
        return most

    def slopes(self) -> Floats:
        """Return the generalized Jacobian dF/dp (r, r)."""
        problem, D, n = self.problem, self.problem.D, self.problem.normals
        unit_rows = identity(len(n))
        J = np.where(self.inside[:, None], D, unit_rows)
        if not problem.is_constant:
            at = (~(self.inside | problem.own)).nonzero()[0]
            of = n[at]
            above = self.z[at] >= self.high[at]
            slopes = np.where(above, problem.high[1, at], problem.low[1, at])
            pushed = (self.p[of] >= 0.0) | problem.fixed[at]
            J[at, of] -= np.where(pushed, slopes, 0.0)
        for rows in problem.discs:
            if self.inside[rows[0]]:
                continue
            k, z = rows[1], self.z[rows]
            size = float(np.hypot(*z))
            unit, across = z / size, np.eye(2) - np.outer(z, z) / size**2
            J[rows] = unit_rows[rows]
            J[rows] -= self.high[k] / size * across @ (unit_rows[rows] - D[rows])
            if n[k] >= 0 and self.p[n[k]] >= 0.0:
                J[rows, n[k]] -= problem.high[1, k] * unit
        return J


# --- pivots ---------------------------------------------------------------------------

# Directions of a bounded row, and numbers of corners of the polygon that replaces a
# disc: the second is tried where Newton's method does not converge from the first.
SIDES = np.array([[1.0], [-1.0]])
CORNERS = (8, 32)


def _by_pivots(problem: ComplementarityProblem, corners: int = 0) -> Floats:
    """Compute multipliers (r,) by Lemke's method, or 0 where it ends on a ray.

    corners : the number of corners of the polygon that replaces each disc.
    problem : the problem, scaled.
    """
    r, pairs = len(problem.c), problem.pairs
    lowest, highest = problem.low[0], problem.high[0]
    fixed = problem.fixed
    free = np.flatnonzero(np.isinf(lowest)).tolist()
    # p = E x + p0, where x are the multipliers that are not fixed.
    E, p0 = np.diag(np.where(fixed, 0.0, 1.0)), np.where(fixed, lowest, 0.0)
    moved = np.flatnonzero(fixed & (problem.normals >= 0))
    E[moved, problem.normals[moved]] = problem.low[1, moved]
    signed = np.flatnonzero(~fixed & ~np.isinf(lowest) & np.isinf(highest))
    boxed = np.flatnonzero(~fixed & np.isfinite(highest))
    groups = [[pairs.item(k), k] if pairs[k] >= 0 else [k] for k in boxed.tolist()]
    groups = [group for group in groups if group[0] <= group[-1]]
    rows = [*signed.tolist(), *(k for group in groups for k in group)]
    # x = base + N a for these rows, group by group, with a >= 0.
    base = np.zeros(len(rows))
    angles = 2.0 * np.pi * np.arange(corners) / max(corners, 1)
    polygon = np.column_stack([np.cos(angles), np.sin(angles)])
    spans, caps = [], np.zeros((2, len(groups)))
    i = n = len(signed)
    for j, group in enumerate(groups):
        k = group[-1]
        opposite = lowest[k] == -highest[k]
        spans.append(polygon if len(group) == 2 else SIDES if opposite else SIDES[:1])
        base[i] = 0.0 if opposite else lowest[k]
        caps[:, j] = highest[k] - base[i], problem.high[1, k]
        i += len(group)
    N, owners = _directions(n, spans)
    G, h = problem.D @ E, problem.c + problem.D @ p0
    B = np.column_stack([G[np.ix_(free, rows)], h[free]])
    X = least_squares(G[np.ix_(free, free)], B, DEPENDENT_SQUARE) if free else B
    H = np.column_stack([G[np.ix_(rows, rows)], h[rows]]) - G[np.ix_(rows, free)] @ X
    first, place = N.shape[1], {k: i for i, k in enumerate(signed.tolist())}
    M = np.zeros((first + len(groups),) * 2)
    M[:first, :first] = N.T @ H[:, :-1] @ N
    M[n:first, first:], M[first:, n:first] = owners, -owners.T
    for j, group in enumerate(groups):
        if problem.normals[group[0]] in place:
            M[first + j, place[problem.normals[group[0]]]] = caps[1, j]
    q = np.concatenate([N.T @ (H[:, -1] + H[:, :-1] @ base), caps[0]])
    a = lemke(M, q)
    if a is None:
        return np.zeros(r)
    x = np.zeros(r)
    x[rows] = base + N @ a[:first]
    x[free] = -X @ np.append(x[rows], 1.0)
    return E @ x + p0


def _directions(signed: int, spans: list[Floats]) -> tuple[Floats, Floats]:
    """Return the directions d_i of Lemke's method, and the group of each.

    Parameters
    ----------
    signed : int
        The number of one-sided rows.
    spans : list of ndarray
        The directions of each group of bounded rows: (directions, 1 or 2).

    Returns
    -------
    N : ndarray, shape (rows, directions)
        Block diagonal: the identity, then the directions of each group as columns.
    owners : ndarray, shape (directions - signed, groups)
        1 where a direction belongs to the group.
    """
    count = signed + sum(len(d) for d in spans)
    N = np.zeros((signed + sum(d.shape[1] for d in spans), count))
    N[:signed, :signed] = np.eye(signed)
    owners = np.zeros((count - signed, len(spans)))
    i = j = signed
    for group, d in enumerate(spans):
        N[i : i + d.shape[1], j : j + len(d)] = d.T
        owners[j - signed : j - signed + len(d), group] = 1.0
        i, j = i + d.shape[1], j + len(d)
    return N, owners
