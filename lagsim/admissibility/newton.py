"""The nearest point that meets equations: damped Newton, then a true minimum.

`nearest` minimises |x - x0| in a metric subject to r(x) = 0: damped Newton steps of
least change reach the equations, then Newton's method on the Lagrange function
(J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., section 18.1) goes to the
minimum, which is not in general where the first iteration ends. Where the equations
cannot be reached it says why.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.native.kernel_types import Floats

    Equations = Callable[[Floats], tuple[Floats, Floats]]

RANK = 1e-10
MOST_STEPS = 60
# A residual this small against its own terms is rounding.
MET = 1e-12
DIFFERENCE = 2.0**-17  # about the cube root of the unit roundoff
SMALLEST_DAMPING = 1e-6
# Newton's method halves the distance to a double root: that many halvings in a row.
HALVINGS = 5


class Trouble(Enum):
    """Why the equations could not be reached, or what was odd about the root."""

    NONE = ""
    DOUBLE_ROOT = "double root"
    MINIMUM = "positive minimum"
    RANK_LOSS = "loss of rank"
    NOT_FINITE = "values that are not finite"


@dataclass(frozen=True, slots=True)
class Found:
    """Where the iteration ended, and whether the equations are met there."""

    x: Floats
    met: bool
    trouble: Trouble = Trouble.NONE


def nearest(equations: Equations, x0: Floats, metric: Floats) -> Found:
    """Give the point nearest to `x0` in `metric` (k, k) that meets `equations`.

    Where none is found, the point of least |r| near there.
    """
    reached = reach(equations, x0, metric)
    if not reached.met:
        return _explained(equations, reached)
    x = _descend(equations, x0, reached.x, metric)
    return Found(x, met=True, trouble=reached.trouble)


def reach(equations: Equations, x0: Floats, metric: Floats) -> Found:
    """Take damped steps of least change until the equations are met."""
    x = x0.copy()
    r, J = equations(x)
    halvings, last = 0, np.inf
    double = False
    for _ in range(MOST_STEPS):
        if not np.any(r):
            break
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(r))):
            return Found(x, met=False, trouble=Trouble.NOT_FINITE)
        step = least_change(J, r, metric)
        length = float(np.sqrt(_length(step, metric)))
        halvings = halvings + 1 if 0.4 < length / last < 0.6 else 0
        last = length
        if halvings >= HALVINGS:  # at a double root twice the step goes all the way
            double, step = True, 2 * step
        damped = _damped(equations, x, r, J, step)
        if damped is None:
            break  # no decrease: rounding, or a minimum of |r|
        x, r, J = damped
    met = relative(r, J, x) < MET or not np.any(r)
    trouble = Trouble.DOUBLE_ROOT if double and met else Trouble.NONE
    return Found(x, met=met, trouble=trouble)


def _damped(
    equations: Equations, x: Floats, r: Floats, J: Floats, step: Floats
) -> tuple[Floats, Floats, Floats] | None:
    """Take as much of the step as lowers |r|; None where no part of it does."""
    weights = np.abs(J).max(axis=1, initial=0.0)
    weights[weights == 0] = 1.0
    before = np.linalg.norm(r / weights)
    damping = 1.0
    while damping > SMALLEST_DAMPING:
        trial = x + damping * step
        r_trial, J_trial = equations(trial)
        if np.linalg.norm(r_trial / weights) < before:
            return trial, r_trial, J_trial
        damping /= 2
    return None


def least_change(J: Floats, residual: Floats, metric: Floats) -> Floats:
    """Give the least dx in `metric` with J dx = -residual (in the least squares)."""
    L = np.linalg.cholesky(metric)
    Y = np.linalg.solve(L, J.T).T
    lengths = np.linalg.norm(Y, axis=1)
    lengths[lengths == 0] = 1.0
    right = -residual / lengths
    solution = np.linalg.lstsq(Y / lengths[:, None], right, rcond=RANK)[0]
    return np.asarray(np.linalg.solve(L.T, solution))


def relative(residual: Floats, J: Floats, x: Floats) -> float:
    """Give the largest residual against |J| |x|, the size of its linear terms."""
    if not np.all(np.isfinite(residual)):
        return np.inf
    sizes = np.abs(J) @ np.abs(x)
    floor = np.max(np.abs(J), axis=1, initial=0.0) * np.max(np.abs(x), initial=0.0)
    sizes = np.maximum(sizes, floor)
    sizes[sizes == 0] = 1.0
    return float(np.max(np.abs(residual) / sizes, initial=0.0))


def _explained(equations: Equations, reached: Found) -> Found:
    """Say why the equations were not reached; give the point of least |r|."""
    if reached.trouble is Trouble.NOT_FINITE:
        return reached
    from scipy.optimize import least_squares  # slow to load, and only failures need it

    def residual(x: Floats) -> Floats:
        return np.nan_to_num(equations(x)[0], nan=1e100, posinf=1e100, neginf=-1e100)

    def slopes(x: Floats) -> Floats:
        return np.nan_to_num(equations(x)[1])

    fit = least_squares(residual, reached.x, jac=slopes, xtol=1e-15, ftol=1e-15)
    x: Floats = np.asarray(fit.x, dtype=float)
    r, J = equations(x)
    if relative(r, J, x) < MET:
        return Found(x, met=True)
    sizes = np.linalg.svd(J, compute_uv=False)
    steepest = float(np.linalg.norm(J.T @ r))
    size = float(np.linalg.norm(J)) * float(np.linalg.norm(r))
    flat = steepest <= 1e-6 * size
    if flat or not np.any(J):
        return Found(x, met=False, trouble=Trouble.MINIMUM)
    lost = sizes[-1] <= 1e-6 * sizes[0]
    return Found(x, met=False, trouble=Trouble.RANK_LOSS if lost else Trouble.MINIMUM)


def _descend(equations: Equations, x0: Floats, x: Floats, metric: Floats) -> Floats:
    """Go from an admissible point to the nearest one, where Newton's method can."""
    r, J = equations(x)
    if np.linalg.matrix_rank(J) == len(x):
        return x  # isolated: there is nothing to choose
    gap = metric @ (x - x0)
    multipliers = np.asarray(np.linalg.lstsq(J.T, gap, rcond=RANK)[0], dtype=float)
    best = x
    for _ in range(MOST_STEPS):
        H = _hessian(equations, x, multipliers, metric)
        m, k = J.shape
        K = np.block([[H, -J.T], [J, np.zeros((m, m))]])
        right = np.concatenate([-metric @ (x - x0), -r])
        solution = np.linalg.lstsq(K, right, rcond=RANK)[0]
        step, multipliers = solution[:k], np.asarray(solution[k:], dtype=float)
        x = x + step
        r, J = equations(x)
        if not np.all(np.isfinite(r)):
            return best
        if np.linalg.norm(step) <= 1e-13 * np.linalg.norm(x):
            break
    polished = reach(equations, x, metric)
    if not polished.met:
        return best
    nearer = _length(polished.x - x0, metric) <= _length(best - x0, metric)
    return polished.x if nearer else best


def _hessian(
    equations: Equations, x: Floats, multipliers: Floats, metric: Floats
) -> Floats:
    """Give metric - sum multiplier_i r_i'' by central differences of the slopes.

    Where that is not positive along the equations, the metric alone.
    """
    k = len(x)
    curvature = np.empty((k, k))
    for j in range(k):
        e = np.zeros(k)
        e[j] = DIFFERENCE * max(abs(x[j]), np.max(np.abs(x)), 1e-300)
        ahead, behind = equations(x + e)[1], equations(x - e)[1]
        curvature[j] = multipliers @ (ahead - behind) / (2 * e[j])
    H = metric - (curvature + curvature.T) / 2
    if not np.all(np.isfinite(H)):
        return metric
    kernel = null_space(equations(x)[1])
    if kernel.shape[1] and np.linalg.eigvalsh(kernel.T @ H @ kernel)[0] <= 0:
        return metric
    return H


def null_space(J: Floats) -> Floats:
    """Give an orthonormal basis (k, k - rank) of what J maps to zero."""
    if not J.size:
        return np.eye(J.shape[1])
    _, sizes, basis = np.linalg.svd(J)
    rank = int(np.sum(sizes > RANK * np.max(sizes, initial=0.0)))
    return np.asarray(basis[rank:].T)


def _length(x: Floats, metric: Floats) -> float:
    return float(x @ metric @ x)
