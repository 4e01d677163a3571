"""Choice of the multipliers of dependent rows, where they are not unique.

Where rows are dependent, the motion is unique and the multipliers are not: a box on
four legs may stand on any three that support its weight. Where Lemke's method does not
end at independent contacts, because friction is bounded by discs, contacts are removed
until the remaining ones are independent, as far as friction permits. Friction that rows
share is distributed such that discs have the least parts of their bounds: a disc slips
only where no distribution holds it, in a direction that the other rows leave free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.algebra import Span, least_squares, null_space
from lagsim.mechanics.complementarity import (
    STEPS,
    ComplementarityProblem,
    Solution,
    coupled_groups,
    is_regular,
    solve,
)
from lagsim.tolerances import (
    ACCELERATION_ROUNDOFF,
    CONVERGED,
    DEPENDENT_ROWS,
    SETTLED_IMPULSE,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.rows import Closed


# Friction up to this part of its bound needs no further sharing. Close to its bound
# each small increase of a load would end a mode and begin another one.
INSIDE = 0.5
# Newton steps on the central path up to this length, in the local metric, are undamped.
NEAR_PATH = 0.25


@dataclass(frozen=True)
class ContactRows:
    """Rows of a complementarity problem whose solution determines their modes.

    Attributes
    ----------
    closed : Closed
        The closed laws with their Delassus matrix.
    problem : ComplementarityProblem
        The problem whose solution are the multipliers of the rows.
    sizes : ndarray, shape (r,)
        The bounds of bounded multipliers, as in `rows.Closed.problem`.
    given : ndarray of bool, shape (r,)
        The rows that slide.
    directions : ndarray, shape (r,)
        The directions of the rows that slide.
    roundoff : ndarray, shape (r,)
        Accelerations up to this size count as 0.
    """

    closed: Closed
    problem: ComplementarityProblem
    sizes: Floats
    given: Flags
    directions: Floats
    roundoff: Floats

    @cached_property
    def one_sided(self) -> list[int]:
        """Indices of contacts and freewheels."""
        found: list[int] = np.flatnonzero(self.closed.table.one_sided).tolist()
        return found

    def rounding(self, p: Floats, limits: Floats, *, coupled: bool = False) -> Floats:
        """Return roundoff bounds (r,) of the accelerations at multipliers p (r,).

        The bounds are computed for the larger of |p| and `limits` (r,), so that a row
        at rest without a force has the bound of its largest friction.

        coupled : whether to return larger bounds for all rows that are coupled with
            discs, whose multipliers are less accurate.
        """
        problem = self.problem
        pushes = np.maximum(np.abs(p), limits)
        terms = np.abs(problem.D) @ pushes + np.abs(problem.c)
        on_discs = (problem.pairs >= 0) | coupled
        parts = np.where(on_discs, SETTLED_IMPULSE, ACCELERATION_ROUNDOFF)
        return np.asarray(np.maximum(self.roundoff, parts * terms))

    def part(self, p: Floats, mask: Flags) -> float:
        """Return the largest friction of marked rows, as a part of its bound.

        p : multipliers (r,).
        mask : (r,).
        """
        limits, most = self.problem.limits(p), 0.0
        for k in np.flatnonzero(mask & (limits > 0.0)).tolist():
            most = max(most, float(np.linalg.norm(p[self.disc(k)])) / limits.item(k))
        return most

    @cached_property
    def forces(self) -> Floats:
        """Forces (k,) other than the forces of multipliers, in the metric of M.

        They satisfy `problem.c` = Y^T forces, where the columns of Y, `closed.factor`
        (k, r), are the rows of the closed laws in this metric.
        """
        Y = self.closed.factor
        lengths = np.linalg.norm(Y, axis=0)
        own = lengths > 0.0
        return least_squares(
            (Y[:, own] / lengths[own]).T, self.problem.c[own] / lengths[own]
        )

    def unbalanced(self, p: Floats, rests: Flags, K: Floats) -> Floats:
        """Return the least x (j,) with which the rows at rest are in balance.

        The forces are K x, the forces of the multipliers p, and all other forces of the
        model.

        Parameters
        ----------
        p : ndarray, shape (r,)
            Multipliers.
        rests : ndarray of bool, shape (r,)
            The rows at rest.
        K : ndarray, shape (k, j)
            Directions in the space of the factor.
        """
        Y = self.closed.factor[:, rests]
        lengths = np.linalg.norm(Y, axis=0)
        U, s, _ = np.linalg.svd(
            Y / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False
        )
        Q = U[:, s > DEPENDENT_ROWS * s[0]].T
        return least_squares(Q @ K, Q @ (self.closed.columns @ p + self.forces))

    def disc(self, k: int) -> list[int]:
        """Return both rows of row k's disc, in ascending order; [k] without a disc."""
        pair = self.closed.table.pairs.item(k)
        return [k] if pair < 0 else [min(k, pair), max(k, pair)]

    @cached_property
    def groups(self) -> list[set[int]]:
        """Groups of rows that are coupled by D, bounds or discs."""
        return [set(rows) for rows in coupled_groups(self.problem)]

    @cached_property
    def regular(self) -> bool:
        """Whether all rows are linearly independent by a margin."""
        return self.closed.pushes is None and is_regular(self.closed.D)

    @cached_property
    def alone(self) -> set[int]:
        """Rows that are coupled with no other row."""
        return {k for group in self.groups if len(group) == 1 for k in group}


class Independent(Span):
    """Span of columns of Y turn (k, r), to which independent columns are added.

    The columns are scaled to length 1.

    Parameters
    ----------
    Y : ndarray, shape (k, r)
        The columns: rows of laws in the metric of M.
    turn : ndarray, shape (r, r), optional
        A rotation of the columns.
    regular : bool
        Whether all columns are known to be independent.
    """

    def __init__(
        self, Y: Floats, turn: Floats | None = None, *, regular: bool = False
    ) -> None:
        super().__init__(len(Y))
        self.regular = regular
        if regular:
            return
        if turn is not None and not np.array_equal(turn, np.eye(len(turn))):
            Y = Y @ turn
        lengths = np.linalg.norm(Y, axis=0)
        self.units = (Y / np.where(lengths > 0.0, lengths, 1.0)).T
        # A column whose elements no other column has is independent of all others.
        shared = np.count_nonzero(Y, axis=1) > 1
        self.alone = (lengths > 0.0) & ~(self.units != 0.0)[:, shared].any(axis=1)

    def takes(self, row: int) -> bool:
        """Add column `row` of Y to the span if it is independent of the span.

        Returns whether the column is independent. A column that shares no element with
        another column is independent, and is not stored.
        """
        if self.regular or self.alone[row]:
            return True
        return self.extend(self.units[row], DEPENDENT_ROWS)

    def adds(self, row: int) -> bool:
        """Whether column `row` of Y is independent of the span, which is unchanged."""
        return bool(np.linalg.norm(self.outside(self.units[row])) > DEPENDENT_ROWS)


def solved_rows(rows: ContactRows) -> Solution:
    """Solve for the multipliers of all rows and their accelerations.

    For groups of rows at rest that are coupled with discs, multipliers within the
    limits that balance all forces are sought first, since whether bodies stay at rest
    does not depend on inertias. All other groups are solved as one contact problem.
    """
    problem = rows.problem
    if not problem.discs:
        return solve(problem)
    found = Solution(np.zeros(len(problem.c)), problem.c.copy(), found=True)
    free = (problem.normals < 0) & ~rows.given
    free[rows.one_sided] = False
    on_discs = problem.pairs >= 0
    left = list[int]()
    for group in coupled_groups(problem):
        rests = np.zeros(len(free), dtype=bool)
        rests[group] = free[group].all() and on_discs[group].any()
        rests &= rows.closed.columns.any(axis=0)
        spread = _spread(rows, found, rests, balanced=False) if rests.any() else None
        left += [] if spread else group
        found = spread or found
    if left:
        left.sort()
        found.p[left], found.w[left], solved = solve(problem.part(left))
        found = found._replace(found=solved)
    return found


def supported(rows: ContactRows, solution: Solution) -> Solution:
    """Return a solution in which contacts with a force are independent, if possible.

    Contacts are released one by one as long as the accelerations of all rows are
    unchanged to rounding.
    """
    problem, p = rows.problem, solution.p
    rounding = rows.rounding(p, problem.limits(p))
    while True:
        for k in _spare(rows, solution):
            away = (np.arange(len(problem.c)) == k) | (problem.normals == k)
            low, high = (np.where(away, 0.0, x) for x in (problem.low, problem.high))
            without = replace(problem, low=low, high=high)
            less = solve(without)
            full = problem.D @ less.p + problem.c
            if less.found and (np.abs(full - solution.w) <= rounding).all():
                solution, problem = less._replace(w=full), without
                break
        else:
            return solution


def _spare(rows: ContactRows, solution: Solution) -> list[int]:
    """Return the contacts that should be released first if contacts are dependent.

    The multipliers are changed along a null vector of the contacts with a force, in
    both directions, up to the first multiplier that becomes 0; the contacts of these
    multipliers are returned. The list is empty if the contacts with a force are
    independent.

    rows, solution : all r rows, and their multipliers.
    """
    p, span = solution.p, Independent(rows.closed.columns)
    bear = [k for k in rows.one_sided if p[k] > 0.0]
    if all(span.takes(k) for k in bear):
        return []
    s = np.sqrt(rows.closed.D.diagonal()[bear])
    z = np.linalg.svd(span.units[bear].T)[2][-1] / s
    ends = []
    for direction in (z, -z):
        falls = direction < -np.abs(z).max() * DEPENDENT_ROWS
        parts = np.where(falls, p[bear] / np.where(falls, -direction, 1.0), np.inf)
        if np.isfinite(parts.min()):
            ends.append(bear[int(parts.argmin())])
    return sorted(ends, key=lambda k: float(p[k]))


def eased(rows: ContactRows, solution: Solution) -> Solution:
    """Return a solution whose static friction is as far inside its bounds as possible.

    A slip begins only where no choice of multipliers prevents it. Whether bodies at
    rest stay at rest is a question of forces alone, whatever the inertias are: where
    rows that are coupled with a disc are all at rest, it is decided first whether they
    stay. Otherwise the rows without acceleration stay at rest.
    """
    for group in coupled_groups(rows.problem):
        discs = [disc for disc in rows.problem.discs if disc[0] in group]
        if not discs:
            continue
        limits = rows.problem.limits(solution.p)
        rounding = rows.rounding(solution.p, limits, coupled=True)
        still = np.abs(solution.w) <= rounding
        for disc in discs:  # both of its rows rest, or neither
            still[disc] = np.linalg.norm(solution.w[disc]) <= rounding[disc].max()
        rests = np.zeros(len(still), dtype=bool)
        rests[group] = True
        slides = bool((rests & rows.given).any())
        rests &= ~rows.given & rows.closed.columns.any(axis=0)
        moves = bool((rests & ~still).any())
        if not moves and rows.part(solution.p, rests) < INSIDE:
            continue
        found = _spread(rows, solution, rests, balanced=False) if not slides else None
        if found is None and (slides or moves):
            found = _spread(rows, solution, rests & still, balanced=True)
        solution = found or solution
    return solution


def _spread(
    rows: ContactRows, solution: Solution, rests: Flags, *, balanced: bool
) -> Solution | None:
    """Return a solution with least friction in which the rows `rests` rest, or None.

    Their multipliers are at the least parts of their bounds. None where no multipliers
    hold these rows, or no better multipliers are found.

    Parameters
    ----------
    rows : ContactRows
        All r rows.
    solution : Solution
        The multipliers of all other rows are unchanged.
    rests : ndarray of bool, shape (r,)
        The rows that rest.
    balanced : bool
        Whether the accelerations of these rows are 0 in `solution`.
    """
    closed, p, table = rows.closed, solution.p.copy(), rows.closed.table
    sided, equal = rests & table.one_sided, rests & table.equal
    pushes = sided & (p > 0.0)
    has_friction = rests & (rows.problem.limits(p) > 0.0)
    shared = np.flatnonzero(has_friction | pushes | equal)
    if not len(shared):
        return None
    lengths = np.linalg.norm(closed.columns[:, shared], axis=0)
    K = closed.columns[:, shared] / lengths
    if not balanced:
        for _ in range(2):
            p[shared] -= rows.unbalanced(p, rests, K) / lengths
        if not (p[pushes] > 0.0).all():
            return None
    discs, radii = np.zeros((2, len(p), len(p)))
    for k in np.flatnonzero(has_friction).tolist():
        first = rows.disc(k)[0]
        discs[first, k], radii[first, table.normals[k]] = 1.0, table.normals[k] >= 0
    own = discs.any(axis=1)
    discs, radii = discs[own][:, shared], radii[own][:, shared]
    limits = rows.problem.limits(p)
    bounds = np.where(has_friction, limits, np.where(pushes, p, 1.0))[shared]
    most = (limits[shared] * lengths).max()
    bounds = np.where(equal[shared], most / lengths, bounds)
    free = null_space(K) / (lengths * bounds)[:, None]
    shifted = p.copy()
    if free.size and (balanced or rows.part(p, rests) > INSIDE):
        free = np.linalg.qr(free)[0]
        parts = least_parts(p[shared] / bounds, free, discs, radii, pushes[shared])
        shifted[shared] = parts * bounds
    part = rows.part(shifted, rests)
    most = min(1.0, rows.part(p, rests)) if balanced else 1.0 + SETTLED_IMPULSE
    if not part < most:
        return None
    return solution._replace(p=shifted, w=np.where(rests, 0.0, solution.w))


def least_parts(
    x: Floats, free: Floats, discs: Floats, radii: Floats, pushes: Flags
) -> Floats:
    """Minimize the largest |x_g| over discs g among multipliers x + free y (k,).

    |x_g| is the norm of the two multipliers of disc g, in parts of their bounds. Newton
    steps follow the central path of the cones |x_g| < s + radii_g (x - x_0) to the
    least s, as long as the iterates stay inside the cones to rounding (Y. Nesterov,
    Lectures on Convex Optimization, 2018, section 5.2).

    Parameters
    ----------
    x : ndarray, shape (k,)
        The initial multipliers x_0.
    free : ndarray, shape (k, d)
        The directions in which x may change.
    discs : ndarray, shape (g, k)
        For each of g discs, 1 at its rows and 0 elsewhere.
    radii : ndarray, shape (g, k)
        The derivatives of the radius of each disc by the multipliers.
    pushes : ndarray of bool, shape (k,)
        The multipliers that stay positive.
    """
    k, d = free.shape
    largest = np.sqrt((discs @ x**2).max())
    G = np.zeros((k + 1, d + 1))  # x and s by y and s
    G[:k, :d], G[k, d] = free, 1.0
    u, first, weight = np.append(x, 2.0 * largest), radii @ x, 1.0 / largest
    grow, signed = np.column_stack([radii, np.ones(len(discs))]), np.flatnonzero(pushes)
    while weight < 1.0 / CONVERGED:
        for _ in range(STEPS):
            r = grow @ u - first
            left = r * r - discs @ u[:k] ** 2
            if not min(r.min(), left.min(), u[signed].min(initial=1.0)) > 0.0:
                return x
            x, inverse = u[:k], 1.0 / left[:, None]
            R, P = grow @ G, G[signed] / u[signed, None]
            C = 2.0 * inverse * ((discs * x) @ G[:k] - r[:, None] * R)
            slope = C.sum(axis=0) - P.sum(axis=0)
            slope[d] += weight
            bend = 2.0 * (G[:k].T * (inverse.T @ discs)) @ G[:k]
            bend += C.T @ C + P.T @ P - 2.0 * (inverse * R).T @ R
            step = -np.linalg.lstsq(bend, slope, rcond=None)[0]
            size = np.sqrt(max(0.0, -slope @ step))
            u = u + G @ step / (1.0 + size if size > NEAR_PATH else 1.0)
            if size <= NEAR_PATH:
                break
        weight *= 10.0
    return x
