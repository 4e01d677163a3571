"""The nearest point that satisfies relations: damped Newton, then a true minimum.

`nearest` minimises |x - x0| in a metric subject to r(x) = 0. Damped Newton steps of
least change reach the relations; then Newton's method on the Lagrange function, along
the relations and with a return to them after each step (J. Nocedal and S. J. Wright,
Numerical Optimization, 2nd ed., chapters 15 and 18), goes down to the minimum, which is
not in general where the first iteration ends. Where the relations cannot be reached it
says why.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.language.arrays import Floats


# --- The metric of changes: M, and its replacement where M is singular

# Singular values below this part of the largest, of what was scaled, are zero.
RANK = 1e-10


def metric_of(M: Floats, free: Sequence[int]) -> Floats:
    """Give the metric of least change on the values `free`: M, or Euclid's.

    Euclid's where M is not positive definite on them.
    """
    part = M[np.ix_(list(free), list(free))]
    return part if _positive(part) else np.eye(len(free))


def rank_metric(M: Floats, A: Floats) -> Floats:
    """Give the metric in which rows are compared: M, or its diagonal, completed."""
    if _positive(M):
        return M
    return np.diag(sizes_of(np.sqrt(np.abs(np.diag(M))), A) ** 2)


def solving_metric(M: Floats, A: Floats) -> Floats:
    """Give the metric of least change in which the motion is solved for.

    M; where that is singular M + A^T W A, W diagonal and to the size of M (see
    `solve.dense`); where that is, too, Euclid's.
    """
    if _positive(M):
        return M
    inertias = np.abs(np.diag(M))
    met = np.max(np.where(A != 0.0, inertias, 0.0), axis=1, initial=0.0)
    sizes = np.where(met > 0.0, met, np.max(inertias, initial=0.0) or 1.0)
    squares = np.sum(A * A, axis=1)
    weights = sizes / np.where(squares > 0.0, squares, 1.0)
    whole = np.asarray(M + (A.T * weights) @ A)
    return whole if _positive(whole) else np.eye(len(M))


def sizes_of(roots: Floats, A: Floats) -> Floats:
    """Give for each coordinate sqrt(M_jj), or what the rows A (m, n) put in its place.

    roots : (n,), sqrt(M_jj).

    A massless coordinate counts as much as the others in the row that weighs it most,
    so that its unit does not matter.
    """
    sizes = roots.copy()
    massless = sizes == 0
    if not massless.any():
        return sizes
    heavy = ~massless
    known = np.linalg.norm(A[:, heavy] / sizes[heavy], axis=1)
    weights = np.abs(A[:, massless]) / np.where(known > 0, known, 1.0)[:, None]
    found = np.max(weights, axis=0, initial=0.0)
    usable = np.isfinite(found) & (found > 0)
    sizes[massless] = np.where(usable, found, 1.0)
    return sizes


def _positive(M: Floats) -> bool:
    size = np.sqrt(np.abs(np.diag(M)))
    if not np.all(size > 0) or not np.all(np.isfinite(M)):
        return False
    return bool(np.linalg.eigvalsh(M / np.outer(size, size))[0] > RANK)


def least_squares(A: Floats, b: Floats, cutoff: float | None = RANK) -> Floats:
    """Give the least x of least |A x - b|, with singular values below a part left out.

    Raises
    ------
    LinAlgError
        Where something is not finite. LAPACK would say so on stderr, too.
    """
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise np.linalg.LinAlgError("not finite")
    return np.asarray(np.linalg.lstsq(A, b, rcond=cutoff)[0])


# --- Divergence: relations that are satisfied by rounding alone, ever farther out
#
# `x = sqrt(1 + x^2)` has no solution; its residual falls as 1/(2 x), and its terms
# grow, until at some 1e7 the one is rounding of the other. A root is where a relation
# begins to be satisfied: on the way to it, it is not. There its slope tells the root
# from its neighbours.

# Not a root: that part of the way before it, the relation is met as well.
BACKWARD = 0.1
# And what its slope there makes of the whole way is no more than so many times its
# residual, or than the rounding of its slopes along the way.
LEVEL = 8.0
SLOPE_ROUNDING = 2.0**-50


class Missed(Protocol):
    """Residuals, of which some are not met."""

    def missed(self, x: Floats, errors: Floats) -> Any:
        """Tell of each of r whether it is not met (m,)."""


def runs_away(
    relations: Missed,
    at: Callable[[Floats], tuple[Floats, Any]],
    x0: Floats,
    x: Floats,
    errors: Floats,
) -> bool:
    """Tell whether a relation that x0 misses is met at x by rounding alone.

    at : x -> r (m,) and dr/dx (m, k), dense or sparse.
    """
    way = x - x0
    if not np.any(way):
        return False
    back = x - BACKWARD * way
    r, J = at(x)
    first, slopes = at(x0)
    told = np.abs(J @ way)
    if not np.all(np.isfinite(told)):
        return False
    noise = np.maximum(np.abs(r), SLOPE_ROUNDING * (abs(slopes) @ np.abs(way)))
    gone = ~(told > LEVEL * np.maximum(noise, SLOPE_ROUNDING * np.abs(first)))
    if not np.any(gone):
        return False
    missed = relations.missed(x0, errors) & ~relations.missed(back, errors)
    return bool(np.any(gone & missed))


# --- Newton's method, and the minimum

MOST_STEPS = 60
# A residual this small against its own terms is met, and then polished.
MET = 1e-12
POLISHING = 3
# The rounding error of a value that was solved for, against its size.
SOLVED = 2.0**-51
SMALLEST_DAMPING = 1e-6
# Newton's method leaves (k - 1)/k of the distance to a k-fold root: such a part, steady
# to so much, that many times in a row.
HALVINGS = 5
SLOW = (0.4, 0.85)
STEADY = 0.05
ARRIVED = 2
# The gradient along the relations, against the change, that a minimum may have left.
FLAT = 1e-12
# Other starts, and the sizes at which they are looked for; with more unknowns than
# these the nearest point is a minimum among its neighbours only.
OTHER_STARTS = 6
FEW = 8


class Trouble(Enum):
    """Why the relations could not be reached, or what was odd about the root."""

    NONE = ""
    DOUBLE_ROOT = "double root"
    MINIMUM = "positive minimum"
    RANK_LOSS = "loss of rank"
    RUNS_AWAY = "no root at a finite distance"
    NOT_FINITE = "values that are not finite"


class Found(NamedTuple):
    """Where the iteration ended, and whether the relations are met there.

    Where they are not, also in words: why, and the least residual.
    """

    x: Floats
    met: bool
    trouble: Trouble = Trouble.NONE
    reason: str = ""
    least: str = ""


class Relations(Protocol):
    """Residuals and their slopes; when they are met."""

    def __call__(self, x: Floats) -> tuple[Floats, Floats]:
        """Give r (m,) and dr/dx (m, k)."""

    def curvature(self, x: Floats, multipliers: Floats) -> Floats:
        """Give the sum of multiplier_i d2r_i/dx dx, (k, k)."""

    def met(self, x: Floats, errors: Floats) -> bool:
        """Tell whether r is small against its terms, or rounding for these errors."""

    def missed(self, x: Floats, errors: Floats) -> Any:
        """Tell of each of r whether it is not (m,)."""

    def exact(self, x: Floats) -> bool:
        """Tell whether r is within the rounding errors of x as it was stated."""


def nearest(
    relations: Relations, x0: Floats, metric: Floats, *, far: bool = True
) -> Found:
    """Give the point nearest to `x0` in `metric` (k, k) that meets `relations`.

    Where none is found, the point of least |r| near there. `far`: other starts are
    tried, too, for a nearer point or where the first fails.
    """
    if relations.exact(x0):
        return Found(x0.copy(), met=True)
    reached = reach(relations, x0, metric)
    if far and not reached.met:
        # In the metric the way can be a narrow valley.
        other = reach(relations, x0, _by_size(x0, metric))
        reached = other if other.met else reached
    best = _descend(relations, x0, reached.x, metric) if reached.met else None
    if far and (best is None or len(x0) <= FEW):
        for start in _others(relations, x0, best, metric):
            other = reach(relations, start, metric, x0)
            if not other.met:
                continue
            x = _descend(relations, x0, other.x, metric)
            if best is None:
                reached = other
            if best is None or _length(x - x0, metric) < (1 - 1e-6) * _length(
                best - x0, metric
            ):
                best = x
    if best is None:
        return _explained(relations, reached, metric)
    return Found(best, met=True, trouble=reached.trouble)


def _by_size(x0: Floats, metric: Floats) -> Floats:
    """Give the metric in which each value counts against its own size."""
    diagonal = np.diag(metric)
    size = np.abs(x0)
    rest = np.sqrt(_length(x0, metric) or 1.0) / np.sqrt(diagonal)
    return np.diag(np.where(size > 0, size, rest) ** -2.0)


def _others(
    relations: Relations, x0: Floats, best: Floats | None, metric: Floats
) -> Iterator[Floats]:
    """Give other starts around x0, as far as the point found; the same each time."""
    random = np.random.default_rng(3)
    L = cholesky(metric)
    if best is None:
        far = float(np.sqrt(_length(x0, metric))) or 1.0
        near = _bent(relations, x0, L) or far
    else:
        near = far = float(np.sqrt(_length(best - x0, metric)))
    for k in range(OTHER_STARTS):
        kick = np.linalg.solve(L.T, random.standard_normal(len(x0)))
        size = near if k < OTHER_STARTS // 2 else far
        yield x0 + size * 10.0 ** ((k % 3) - 1) * kick


def _bent(relations: Relations, x0: Floats, L: Floats) -> float:
    """Give how far away relations are met by their second derivatives; 0: not known."""
    r = relations(x0)[0]
    found = 0.0
    for one, residual in zip(np.eye(len(r)), r, strict=True):
        bend = np.linalg.norm(_congruent(relations.curvature(x0, one), L))
        if np.isfinite(residual) and np.isfinite(bend) and bend > 0.0:
            found = max(found, float(np.sqrt(2.0 * abs(residual) / bend)))
    return found


def _congruent(H: Floats, L: Floats) -> Floats:
    half = np.linalg.solve(L, np.nan_to_num(H, nan=np.inf))
    return np.asarray(np.linalg.solve(L, half.T))


def reach(
    relations: Relations, x0: Floats, metric: Floats, guess: Floats | None = None
) -> Found:
    """Take damped steps of least change until the relations are met.

    `guess`: what was to be solved for, if x0 is another start.
    """
    try:
        return _reached(relations, x0, metric, x0 if guess is None else guess)
    except np.linalg.LinAlgError:  # steps went where doubles hold no more
        return Found(x0.copy(), met=False, trouble=Trouble.NOT_FINITE)


def _reached(relations: Relations, x0: Floats, metric: Floats, guess: Floats) -> Found:
    x = x0.copy()
    L = cholesky(metric)
    r, J = relations(x)
    # What x is left with: the rounding of the largest that each value has been, and of
    # the way that all of them went together.
    largest, ulp = np.abs(x), SOLVED / np.sqrt(np.diag(metric))
    way = 0.0
    halvings, last, before = 0, np.inf, np.inf
    jump, jumped, polished = -MOST_STEPS, False, 0
    for k in range(MOST_STEPS):
        if not np.any(r) or polished >= POLISHING:
            break
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(r))):
            return Found(x, met=False, trouble=Trouble.NOT_FINITE)
        step = least_change(J, r, L)
        length = float(np.sqrt(_length(step, metric)))
        part = length / (last or 1.0)
        steady = SLOW[0] < part < SLOW[1] and abs(part - before) < STEADY
        halvings = halvings + 1 if steady else 0
        last, before = length, part
        if halvings >= HALVINGS:  # take the rest of a geometric series, at one go
            jump, step = k, step / (1.0 - part)
            halvings = 0
        met = relations.met(x, SOLVED * largest + way * ulp)
        jumped |= met and not polished and k - jump <= ARRIVED
        polished += met
        damped = _damped(relations, x, r, _lengths(J, L), step, once=met)
        if damped is None:
            break  # no decrease: rounding, or a minimum of |r|
        x, r, J = damped
        largest = np.maximum(largest, np.abs(x))
        way = max(way, float(np.linalg.norm(L.T @ (x - x0))))
    met = not np.any(r) or relations.met(x, SOLVED * largest + way * ulp)
    if met and runs_away(relations, relations, guess, x, SOLVED * largest + way * ulp):
        return Found(x, met=False, trouble=Trouble.RUNS_AWAY)
    # Far from a simple root steps can shrink so, too; then the last ones do not.
    jumped |= not polished and k - jump <= ARRIVED
    trouble = Trouble.DOUBLE_ROOT if jumped and met else Trouble.NONE
    return Found(x, met=met, trouble=trouble)


def _damped(
    relations: Relations,
    x: Floats,
    r: Floats,
    weights: Floats,
    step: Floats,
    *,
    once: bool,
) -> tuple[Floats, Floats, Floats] | None:
    """Take as much of the step as lowers |r|; None where no part of it does."""
    before = np.linalg.norm(r / weights)
    damping = 1.0
    while damping > (0.6 if once else SMALLEST_DAMPING):
        trial = x + damping * step
        r_trial, J_trial = relations(trial)
        if np.linalg.norm(r_trial / weights) < before:
            return trial, r_trial, J_trial
        damping /= 2
    return None


def _lengths(J: Floats, L: Floats) -> Floats:
    """Give the lengths of the rows of J in the metric L L^T; 1 where one vanishes."""
    lengths = np.linalg.norm(np.linalg.solve(L, J.T), axis=0)
    lengths[lengths == 0] = 1.0
    return np.asarray(lengths)


def least_change(J: Floats, residual: Floats, L: Floats) -> Floats:
    """Give the least dx in L L^T with J dx = -residual (in the least squares)."""
    Y = np.linalg.solve(L, J.T).T
    lengths = _lengths(J, L)
    right = -residual / lengths
    solution = least_squares(Y / lengths[:, None], right)
    return np.asarray(np.linalg.solve(L.T, solution))


def _explained(relations: Relations, reached: Found, metric: Floats) -> Found:
    """Say why the relations were not reached; give the point of least |r|."""
    if reached.trouble in (Trouble.NOT_FINITE, Trouble.RUNS_AWAY):
        return reached
    from scipy.optimize import least_squares  # slow to load, and only failures need it

    L = cholesky(metric)
    weights = _lengths(np.nan_to_num(relations(reached.x)[1]), L)

    # In z = L^T x, so that units do not matter.
    def back(z: Floats) -> Floats:
        return np.asarray(np.linalg.solve(L.T, z), dtype=float)

    def residual(z: Floats) -> Floats:
        r = relations(back(z))[0] / weights
        return np.nan_to_num(r, nan=1e100, posinf=1e100, neginf=-1e100)

    def slopes(z: Floats) -> Floats:
        J = np.nan_to_num(relations(back(z))[1])
        return np.asarray(np.linalg.solve(L, (J / weights[:, None]).T).T)

    fit = least_squares(
        residual, L.T @ reached.x, jac=slopes, xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    z: Floats = np.asarray(fit.x, dtype=float)
    x = back(z)
    way = float(np.linalg.norm(z - L.T @ reached.x)) / np.sqrt(np.diag(metric))
    if relations.met(x, SOLVED * (np.abs(x) + way)):
        return Found(x, met=True)
    r, J = residual(z), slopes(z)
    sizes = np.linalg.svd(J, compute_uv=False)
    steepest = float(np.linalg.norm(J.T @ r))
    size = float(np.linalg.norm(J)) * float(np.linalg.norm(r))
    if steepest <= 1e-6 * size or not np.any(J):
        return Found(x, met=False, trouble=Trouble.MINIMUM)
    lost = sizes[-1] <= 1e-6 * sizes[0]
    return Found(x, met=False, trouble=Trouble.RANK_LOSS if lost else Trouble.MINIMUM)


class _Slope:
    """|x - x0|^2 / 2 along the relations: its gradient and a step down."""

    def __init__(
        self, relations: Relations, x0: Floats, x: Floats, metric: Floats
    ) -> None:
        self.relations, self.x, self.metric = relations, x, metric
        self.J = relations(x)[1]
        self.L = cholesky(metric)
        lengths = _lengths(self.J, self.L)
        Y = np.linalg.solve(self.L, self.J.T).T / lengths[:, None]
        gap = self.L.T @ (x - x0)
        self.multipliers = least_squares(Y.T, gap) / lengths
        self.kernel = np.linalg.solve(self.L.T, null_space(Y))
        self.gradient = self.kernel.T @ (metric @ (x - x0))
        self.change = float(np.linalg.norm(gap))
        self.steepness = float(np.linalg.norm(self.gradient))

    def step(self) -> Floats:
        """Give Newton's step along the relations; one downwards where that is not."""
        H = self.kernel.T @ self._hessian() @ self.kernel
        bends, directions = np.linalg.eigh(H)
        along = directions.T @ self.gradient
        if self.steepness <= FLAT * self.change and bends[0] < -1e-6:
            # A ridge, not a valley: leave it on the side that is the same each time.
            return np.asarray(0.1 * self.change * (self.kernel @ directions[:, 0]))
        down = -along / np.maximum(np.abs(bends), 1e-3)
        return np.asarray(self.kernel @ (directions @ down))

    def _hessian(self) -> Floats:
        """Give metric - sum multiplier_i r_i'', of the Lagrange function."""
        H = self.metric - self.relations.curvature(self.x, self.multipliers)
        return H if np.all(np.isfinite(H)) else self.metric


def _descend(relations: Relations, x0: Floats, x: Floats, metric: Floats) -> Floats:
    """Go along the relations from a point that meets them to the nearest one."""
    try:
        return _descended(_Slope(relations, x0, x, metric), x0)
    except np.linalg.LinAlgError:
        return x


def _descended(here: _Slope, x0: Floats) -> Floats:
    for _ in range(MOST_STEPS):
        if not here.kernel.shape[1] or here.change == 0:
            break  # isolated: there is nothing to choose
        step = here.step()
        if not np.any(step):
            break
        there = _lower(here, x0, step)
        if there is None:
            break
        here = there
    return here.x


def _lower(here: _Slope, x0: Floats, step: Floats) -> _Slope | None:
    """Take as much of the step as comes nearer; None where no part of it does."""
    damping = 1.0
    while damping > SMALLEST_DAMPING:
        trial = reach(here.relations, here.x + damping * step, here.metric)
        if trial.met:
            there = _Slope(here.relations, x0, trial.x, here.metric)
            if there.change < (1 - 1e-10) * here.change:
                return there
            # Near the minimum only the gradient still tells nearer from farther.
            level = there.change <= (1 + 1e-10) * here.change
            if level and there.steepness < 0.5 * here.steepness:
                return there
            if level and damping == 1.0 and here.steepness < 1e-6 * here.change:
                return None
        damping /= 2
    return None


def cholesky(metric: Floats) -> Floats:
    """Give L with L L^T = metric."""
    return np.asarray(np.linalg.cholesky(metric), dtype=float)


def null_space(J: Floats) -> Floats:
    """Give an orthonormal basis (k, k - rank) of what J maps to zero."""
    if not J.size:
        return np.eye(J.shape[1])
    _, sizes, basis = np.linalg.svd(J)
    rank = int(np.sum(sizes > RANK * np.max(sizes, initial=0.0)))
    return np.asarray(basis[rank:].T)


def _length(x: Floats, metric: Floats) -> float:
    return float(x @ metric @ x)
