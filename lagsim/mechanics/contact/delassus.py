"""How rows answer to multipliers, beside the equalities that hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.tolerances import DEPENDENT_ROWS

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


class Delassus(NamedTuple):
    """The answer of rows to their multipliers.

    Attributes
    ----------
    D : ndarray, shape (r, r)
        rows K rows^T, where K f is the acceleration that forces f give.
    response : ndarray, shape (n, r)
        K rows^T.
    factor : ndarray, shape (k, r)
        D = factor^T factor, for the k free directions.
    """

    D: Floats
    response: Floats
    factor: Floats


def delassus(M: Floats, A: Floats, rows: Floats) -> Delassus:
    """Give the Delassus matrix of rows (r, n) beside equalities A (e, n).

    M (n, n) has to be positive in all directions that A lets through; coordinates
    without mass, and equalities that others imply, do no harm. Coordinates are scaled
    by powers of two. A row on which nothing can act has zeros.
    """
    diagonal = M.diagonal()
    if not len(A) and np.count_nonzero(M) == len(M) and diagonal.min() > 0.0:
        factor = (rows / np.sqrt(diagonal)).T
        return Delassus(factor.T @ factor, (rows / diagonal).T, factor)
    s = _scales(M, A)
    mass, scaled = M * s * s[:, None], rows * s
    if len(A):
        Z = freedom(A * s)
        mass, seen = Z.T @ mass @ Z, scaled @ Z
        lengths = np.linalg.norm(scaled, axis=1)
        seen[np.linalg.norm(seen, axis=1) <= DEPENDENT_ROWS * lengths] = 0.0
    else:
        Z, seen = None, scaled
    L = np.linalg.cholesky(mass)
    factor = np.linalg.solve(L, seen.T)
    response = np.linalg.solve(L.T, factor)
    if Z is not None:
        response = Z @ response
    return Delassus(factor.T @ factor, response * s[:, None], factor)


def _scales(M: Floats, A: Floats) -> Floats:
    """Give powers of two (n,) that bring masses, or else columns of A, near 1."""
    diagonal = M.diagonal()
    heavy = diagonal > 0.0
    s = np.ones(len(diagonal))
    s[heavy] = 2.0 ** -np.round(np.log2(diagonal[heavy]) / 2.0)
    if heavy.all() or not len(A):
        return s
    sizes = np.abs(A * s * heavy).max(axis=1)
    sizes[sizes == 0.0] = 1.0
    columns = (np.abs(A) / sizes[:, None]).max(axis=0)
    light = ~heavy & (columns > 0.0)
    s[light] = 2.0 ** -np.round(np.log2(columns[light]))
    return s


def freedom(A: Floats) -> Floats:
    """Give an orthonormal basis (n, n - rank) of what rows A let through."""
    lengths = np.linalg.norm(A, axis=1)
    A = A[lengths > 0.0] / lengths[lengths > 0.0, None]
    if not len(A):
        return np.eye(A.shape[1])
    _, sizes, V = np.linalg.svd(A)
    return np.asarray(V[int((sizes > DEPENDENT_ROWS * sizes[0]).sum()) :].T)
