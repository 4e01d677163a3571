"""The nearest point that meets equations: damped Newton, then a true minimum.

`nearest` minimises |x - x0| in a metric subject to r(x) = 0: damped Newton steps of
least change reach the equations, then Newton's method on the Lagrange function
(J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., section 18.1) goes to the
minimum, which is not in general where the first iteration ends.
"""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Found:
    """Where the iteration ended, and whether the equations are met there."""

    x: Floats
    met: bool


def nearest(equations: Equations, x0: Floats, metric: Floats) -> Found:
    """Give the point nearest to `x0` in `metric` (k, k) that meets `equations`."""
    reached = _reach(equations, x0, metric)
    if not reached.met:
        return reached
    return Found(_descend(equations, x0, reached.x, metric), met=True)


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


def _reach(equations: Equations, x0: Floats, metric: Floats) -> Found:
    """Take damped steps of least change until the equations are met."""
    x = x0.copy()
    r, J = equations(x)
    for _ in range(MOST_STEPS):
        if not np.any(r):
            return Found(x, met=True)
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(r))):
            return Found(x, met=False)
        step = least_change(J, r, metric)
        weights = np.abs(J).max(axis=1, initial=0.0)
        weights[weights == 0] = 1.0
        before = np.linalg.norm(r / weights)
        damping = 1.0
        while damping > 1e-6:
            trial = x + damping * step
            r_trial, J_trial = equations(trial)
            if np.linalg.norm(r_trial / weights) < before:
                break
            damping /= 2
        else:
            break  # no decrease: rounding, or a minimum of |r|
        x, r, J = trial, r_trial, J_trial
    return Found(x, met=relative(r, J, x) < MET)


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
    polished = _reach(equations, x, metric)
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
    J = equations(x)[1]
    kernel = null_space(J)
    if not np.all(np.isfinite(H)):
        return metric
    if kernel.shape[1] and np.linalg.eigvalsh(kernel.T @ H @ kernel)[0] <= 0:
        return metric
    return H


def null_space(J: Floats) -> Floats:
    """Give an orthonormal basis (k, k - rank) of what J maps to zero."""
    _, sizes, basis = np.linalg.svd(J)
    rank = int(np.sum(sizes > RANK * np.max(sizes, initial=0.0)))
    return np.asarray(basis[rank:].T)


def _length(x: Floats, metric: Floats) -> float:
    return float(x @ metric @ x)
