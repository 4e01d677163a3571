"""Uncertainty of fitted values: covariance, leverages, undetermined combinations.

Source: Y. Bard, Nonlinear Parameter Estimation (1974), chapter 7; for robust losses
P. J. Huber, Robust Statistics (1981), section 7.6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.studies.fit.names import Varied

LINEAR = "linear"
LOSSES = (LINEAR, "soft_l1", "huber")
# Least ratio of a singular value to the largest of a combination that is determined.
DETERMINED = 1e-7
# Degrees of freedom if none remain.
SPENT_ROWS = 1e-9
# Parts of a combination below this size are rounding.
TINY_PART = 1e-5


class Estimate(NamedTuple):
    """Values with their uncertainties, in multiples of the scales of the names.

    Attributes
    ----------
    covariance : ndarray, shape (p, p)
        Covariance of the names; nan for names that are not determined, or are at a
        bound.
    combinations : list of dict of str to float
        Combinations that the data do not determine: name -> relative change. Such a
        change alters no residual.
    leverages : ndarray, shape (n,)
        Leverage of each residual: the part of its variance that the fit removes.
    """

    covariance: Floats
    combinations: list[dict[str, float]]
    leverages: Floats


def estimated(
    J: Floats, x: Floats, names: Sequence[Varied], active: Collection[str], error: float
) -> Estimate:
    """Return covariance, undetermined combinations and leverages of a fit.

    Parameters
    ----------
    J : ndarray, shape (n, p)
        Derivatives of the residuals, in standard deviations, by the names in multiples
        of their scales.
    x : ndarray, shape (p,)
        Values of the names.
    names : sequence of Varied
    active : collection of str
        Labels of the names at a bound, which are left out.
    error : float
        Relative error of the derivatives.
    """
    p, scales = len(names), np.array([one.scale for one in names])
    free = np.array([one.label not in active for one in names])
    norms, (U, sizes, Vt), kept = _decomposed(J[:, free], error)
    leverages = np.sum(U[: len(J), kept] ** 2, axis=1)
    labels = [one.label for one in names if one.label not in active]
    relative = (scales / np.where(x == 0.0, scales, np.abs(x)))[free]
    combinations = _combinations(Vt[~kept] / norms * relative, labels)
    part = Vt[kept] / sizes[kept][:, None]
    inner = part.T @ part / np.outer(norms, norms)
    loose = {name for one in combinations for name in one}
    unknown = np.array([name in loose for name in labels], dtype=bool)
    inner[unknown, :] = inner[:, unknown] = np.nan
    covariance = np.full((p, p), np.nan)
    covariance[np.ix_(free, free)] = inner
    return Estimate(covariance, combinations, leverages)


def _decomposed(
    J: Floats, error: float = 0.0
) -> tuple[Floats, tuple[Floats, Floats, Floats], Flags]:
    """Return the singular value decomposition of a Jacobian with columns of length 1.

    J : (n, p).
    error : relative error of J.

    Returns
    -------
    norms : ndarray, shape (p,)
        The lengths of the columns; 1 for a column of zeros.
    decomposition : tuple of ndarray, shape (n, p), (p,), (p, p)
        U, singular values and V^T; with rows of zeros where n < p.
    kept : ndarray of bool, shape (p,)
        Singular values beyond the relative error of the derivatives.
    """
    norms = np.linalg.norm(J, axis=0)
    norms[norms == 0.0] = 1.0
    padded = np.pad(J / norms, ((0, max(0, J.shape[1] - len(J))), (0, 0)))
    U, sizes, Vt = np.linalg.svd(padded, full_matrices=False)
    largest = float(np.max(sizes, initial=0.0))
    return norms, (U, sizes, Vt), sizes > max(DETERMINED, error) * largest


def determined(J: Floats) -> Floats:
    """Return a Jacobian J (n, p) without its parts along small singular values.

    These parts are rounding errors, along which a step would have an arbitrary size.
    """
    norms, (U, sizes, Vt), kept = _decomposed(J)
    if kept.all():
        return J
    return np.asarray((U[: len(J), kept] * sizes[kept]) @ Vt[kept] * norms)


def undetermined(J: Floats, error: float) -> Floats:
    """Return an orthonormal basis of the changes of values that alter no residual.

    Parameters
    ----------
    J : ndarray, shape (n, p)
    error : float
        Relative error of J.

    Returns
    -------
    basis : ndarray, shape (d, p)
    """
    norms, (_, _, Vt), kept = _decomposed(J, error)
    return np.asarray(np.linalg.qr((Vt[~kept] / norms).T)[0].T)


def _combinations(kernel: Floats, names: Sequence[str]) -> list[dict[str, float]]:
    """Return the combinations that span `kernel` (d, p), each of few names.

    Each maps names to relative changes, of which the largest is 1.

    names : (p,), the names of the columns of `kernel`.
    """
    rest = kernel.copy()
    for k in range(len(rest)):
        row, column = divmod(int(np.argmax(np.abs(rest[k:]))), rest.shape[1])
        rest[[k, k + row]] = rest[[k + row, k]]
        rest[k] /= rest[k, column]
        for other in range(len(rest)):
            if other != k:
                rest[other] -= rest[other, column] * rest[k]
    return [
        {
            name: part
            for name, part in zip(names, one.tolist(), strict=True)
            if abs(part) > TINY_PART
        }
        for one in (row / row[np.argmax(np.abs(row))] for row in rest)
    ]


def next_step_length(J: Floats, r: Floats, loss: str) -> float:
    """Return the length, in residuals, of the next step of the Gauss-Newton method.

    It is the norm of J dx for the step dx: 1 for a step by a standard error, if
    residuals are in standard deviations. It is a measure of how far a fit is from its
    minimum.

    Parameters
    ----------
    J : ndarray, shape (n, p)
        Derivatives of the residuals.
    r : ndarray, shape (n,)
        Residuals.
    loss : str
        One of LOSSES.
    """
    z = r * r
    weights = {
        LOSSES[0]: np.ones_like(z),
        LOSSES[1]: (1.0 + z) ** -0.5,
        LOSSES[2]: np.maximum(z, 1.0) ** -0.5,
    }[loss]
    roots = np.sqrt(weights)
    _, (U, _, _), kept = _decomposed(J * roots[:, None])
    return float(np.linalg.norm(U[: len(J), kept].T @ (roots * r)))


def robust_factor(r: Floats, loss: str, free: float) -> float:
    """Return the factor of the covariance of an M-estimate (Huber, equation 7.6.6).

    r : (n,), residuals in standard deviations.
    loss : `soft_l1` or `huber`.
    free : degrees of freedom.
    """
    z = r * r
    if loss == LOSSES[1]:
        first, second = (1.0 + z) ** -0.5, -0.5 * (1.0 + z) ** -1.5
    else:
        outer = np.maximum(z, 1.0)
        first = outer**-0.5
        second = np.where(z > 1.0, -0.5 * outer**-1.5, 0.0)
    bend = float(np.mean(first + 2.0 * z * second))
    return float(np.sum(z * first**2)) / max(free, SPENT_ROWS) / bend**2
