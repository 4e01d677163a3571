"""What changes are measured by: M, and what stands in where M is singular."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats

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
