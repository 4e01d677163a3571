"""Linear algebra of small dense and large sparse matrices: metrics, spans, factors.

Changes of the coordinates (n,) are measured in the metric of the mass matrix M (n, n).
Where M is singular, a metric completed from the constraint rows A (m, n) replaces it;
that metric depends neither on the units of massless coordinates nor on the scaling of
the rows.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.tolerances import COMPUTED_ZERO, DEPENDENT_ROWS, HALF_OF_DIGITS

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats


# --- Vectors


def largest(x: Floats) -> float:
    """Return the largest |x_k| of a vector x (k,), k > 0; nan if an element is nan."""
    return float(np.maximum.reduce(np.abs(x)))


@lru_cache(maxsize=64)
def identity(n: int) -> Floats:
    """Return the identity matrix (n, n), which must not be changed; memoized."""
    found = np.eye(n)
    found.flags.writeable = False
    return found


# --- Metrics


def least_change_metric(M: Floats) -> Floats:
    """Return the metric of least changes: M (k, k) if positive definite, else I."""
    return M if is_positive(M) else np.eye(len(M))


def rank_metric(M: Floats, A: Floats) -> Floats:
    """Return the metric (n, n) in which the rank of constraint rows is determined.

    This is M where M is positive definite. Otherwise it is diagonal: M_jj, with the
    entries of massless coordinates chosen by `sizes_of`.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        The mass matrix.
    A : ndarray, shape (m, n)
        The constraint rows.
    """
    if is_positive(M):
        return M
    return np.diag(sizes_of(np.sqrt(np.abs(np.diag(M))), A) ** 2)


def solving_metric(M: Floats, A: Floats) -> Floats:
    """Return the positive matrix (n, n) in whose norm accelerations change least.

    It is `completed(M, A)`, or the identity if this matrix is singular.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        The mass matrix.
    A : ndarray, shape (m, n)
        The constraint rows.
    """
    return least_change_metric(completed(M, A))


def completed(M: Floats, A: Floats) -> Floats:
    """Return M where it is positive definite, else M + A^T W A, shape (n, n).

    W is diagonal, with weights that make each term of A^T W A as large as the entries
    of M on the coordinates of its row (see `program/dense.py`).

    Parameters
    ----------
    M : ndarray, shape (n, n)
        The mass matrix.
    A : ndarray, shape (m, n)
        The constraint rows.
    """
    if is_positive(M):
        return M
    inertias = np.abs(np.diag(M))
    coupled = np.max(np.where(A != 0.0, inertias, 0.0), axis=1, initial=0.0)
    sizes = np.where(coupled > 0.0, coupled, np.max(inertias, initial=0.0) or 1.0)
    squares = np.sum(A * A, axis=1)
    weights = sizes / np.where(squares > 0.0, squares, 1.0)
    return np.asarray(M + (A.T * weights) @ A)


def sizes_of(roots: Floats, A: Floats) -> Floats:
    """Return the size (n,) of each coordinate, sqrt(M_jj) or a value derived from A.

    The size of a massless coordinate is the largest ratio, over all rows, of its entry
    to the norm of the entries of the coordinates with mass, each divided by its size.
    The unit of a massless coordinate therefore does not matter.

    Parameters
    ----------
    roots : ndarray, shape (n,)
        sqrt(M_jj), 0 for massless coordinates.
    A : ndarray, shape (m, n)
        The constraint rows.
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


def is_positive(M: Floats) -> bool:
    """Whether M (n, n), scaled to a unit diagonal, is positive definite."""
    size = np.sqrt(np.abs(np.diag(M)))
    if not np.all(size > 0) or not np.all(np.isfinite(M)):
        return False
    return bool(np.linalg.eigvalsh(M / np.outer(size, size))[0] > DEPENDENT_ROWS)


# --- Solutions and spans


def least_squares(
    A: Floats, b: Floats, cutoff: float | None = DEPENDENT_ROWS
) -> Floats:
    """Return the x of least norm that minimizes |A x - b|.

    Parameters
    ----------
    A : ndarray, shape (m, n)
    b : ndarray, shape (m,) or (m, k)
    cutoff : float or None
        Singular values below this part of the largest count as 0; with None, below
        numpy's default part.

    Raises
    ------
    LinAlgError
        Where an entry of A or b is not finite. (LAPACK would also print a message on
        stderr.)
    """
    if A.size == b.size == 1:  # a single contact, at each of its impacts
        a, c = float(A.item()), float(b.item())
        if not (math.isfinite(a) and math.isfinite(c)):
            raise np.linalg.LinAlgError("not finite")
        return np.full(b.shape, c / a if a else 0.0)
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise np.linalg.LinAlgError("not finite")
    return np.asarray(np.linalg.lstsq(A, b, rcond=cutoff)[0])


def cholesky(metric: Floats) -> Floats:
    """Return the lower triangular L (n, n) with L L^T = metric.

    Raises
    ------
    LinAlgError
        Where the metric is not positive definite.
    """
    return np.asarray(np.linalg.cholesky(metric), dtype=float)


# Matrices from this size on are solved by their band, where it is at most this part of
# them: below, calls cost more than operations.
BANDED, NARROW = 32, 1.0 / 8.0


def symmetric_band(D: Floats) -> Floats | None:
    """Return the band (b + 1, r) of a symmetric matrix D (r, r).

    Row k holds the k-th diagonal below the main one, as scipy's lower form has it; b is
    the number of these diagonals. None where D is small, or its band is not narrow.
    """
    r = len(D)
    if r < BANDED:
        return None
    left = np.count_nonzero(D)
    rows: list[Floats] = []
    if left > r * r * NARROW:
        return None
    while left > 0 and len(rows) <= r * NARROW:
        below = D.diagonal(-len(rows))
        left -= np.count_nonzero(below) * (2 if rows else 1)
        rows.append(np.append(below, np.zeros(len(rows))))
    return np.array(rows) if left == 0 else None


class BandFactor:
    """Cholesky factor of a symmetric, positive definite matrix (r, r), from its band.

    A matrix that is not positive definite raises LinAlgError.

    band : ndarray, shape (b + 1, r), see `symmetric_band`.
    """

    def __init__(self, band: Floats) -> None:
        from scipy.linalg import cholesky_banded  # slow to load

        self.lower = cholesky_banded(band, lower=True, check_finite=False)

    def solve(self, right: Floats) -> Floats:
        """Return the solution x (r,) of the system with a right-hand side (r,)."""
        from scipy.linalg import cho_solve_banded

        x = cho_solve_banded((self.lower, True), right, check_finite=False)
        return np.asarray(x, dtype=float)


def whitened_rows(A: Floats, L: Floats) -> tuple[Floats, Floats]:
    """Return the rows A L^-T scaled to length 1, and their lengths before (m,).

    The lengths are those of the rows of A in the metric (L L^T)^-1. A row of length 0
    stays 0.

    Parameters
    ----------
    A : ndarray, shape (m, k)
    L : ndarray, shape (k, k)
        Cholesky factor of the metric.
    """
    Y = np.linalg.solve(L, A.T).T
    lengths = np.linalg.norm(Y, axis=1)
    return Y / np.where(lengths > 0, lengths, 1.0)[:, None], lengths


class Metric:
    """Projections of changes (n,) of the coordinates in the metric `completed(M, A)`.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        The mass matrix, positive definite on the null space of A.
    A : ndarray, shape (m, n)
        The constraint rows, which may be linearly dependent.
    drags : ndarray, shape (m, n), optional
        Generalized forces per unit of each multiplier, in addition to A^T.

    Attributes
    ----------
    G, L : ndarray, shape (n, n)
        The metric G = completed(M, A), and its Cholesky factor, L L^T = G.
    free : ndarray, shape (n, d)
        Basis of the null space of A, of dimension d, orthonormal in G and in M.
    inverse : ndarray, shape (n, m)
        A^+, the pseudoinverse of A: A^+ b is the change of least norm in G with
        A A^+ b = b.

    Raises
    ------
    LinAlgError
        Where G is not positive definite.
    """

    def __init__(self, M: Floats, A: Floats, drags: Floats | None = None) -> None:
        self.M, self.G, self._drags = M, completed(M, A), drags
        self.L = cholesky(self.G)
        rows, lengths = whitened_rows(A, self.L)
        U, s, V = np.linalg.svd(rows)
        rank = int(np.sum(s > DEPENDENT_ROWS * np.max(s, initial=1.0)))
        back = np.linalg.inv(self.L.T)
        self.free = back @ V[rank:].T
        scales = np.where(lengths > 0.0, lengths, 1.0)
        self._pseudo = V[:rank].T @ (U[:, :rank] / s[:rank]).T / scales
        self.inverse = back @ self._pseudo

    def motion(self, f: Floats, b: Floats) -> tuple[Floats, Floats]:
        """Solve M q'' = f + A^T lambda, A q'' = b for q'' (n,) and lambda (m,).

        Parameters
        ----------
        f : ndarray, shape (n,)
            The forces.
        b : ndarray, shape (m,)
            The right-hand sides of the rows.
        """
        q = self.inverse @ b
        f = self.with_drags(f, q)
        q = q + self.free @ (self.free.T @ (f - self.M @ q))
        return q, self.multipliers(f - self.M @ q)

    def with_drags(self, f: Floats, forced: Floats) -> Floats:
        """Return forces f (n,) or (n, k) with the drags of the multipliers added.

        A^T lambda + D^T lambda + f - M (a + forced) = 0 with A a = 0, for drags D.

        forced : the accelerations that the rows prescribe, in the shape of f.
        """
        if self._drags is None:
            return f
        D, Z = self._drags, self.free
        held = self.multipliers(np.eye(len(Z)) - self.M @ Z @ Z.T)
        loads = np.eye(len(D)) - held @ D.T
        lam = np.linalg.lstsq(loads, held @ (f - self.M @ forced), rcond=None)[0]
        return np.asarray(f + D.T @ lam)

    def multipliers(self, f: Floats) -> Floats:
        """Solve f + A^T lambda = 0 for lambda (m,), by least squares in G^-1.

        Parameters
        ----------
        f : ndarray, shape (n,) or (n, k)
            The forces; the result has the shape (m,) or (m, k).
        """
        return np.asarray(-self._pseudo.T @ np.linalg.solve(self.L, f))


def multiple_of(x: Floats, y: Floats) -> float:
    """Return the number c with y = c x within rounding; 0 if there is none.

    x, y : (n,).
    """
    square = float(x @ x)
    factor = float(y @ x) / square if square > 0.0 else 0.0
    same = np.max(np.abs(y - factor * x)) <= COMPUTED_ZERO * np.max(np.abs(y))
    return factor if same else 0.0


def null_space(J: Floats, cutoff: float | None = None) -> Floats:
    """Return an orthonormal basis (k, k - rank) of the null space of J (m, k).

    Singular values up to `cutoff` count as zero. The default of `cutoff` is
    DEPENDENT_ROWS times the largest singular value.
    """
    if not J.size:
        return np.eye(J.shape[1])
    _, sizes, basis = np.linalg.svd(J)
    least = DEPENDENT_ROWS * np.max(sizes, initial=0.0) if cutoff is None else cutoff
    return np.asarray(basis[int(np.sum(sizes > least)) :].T)


class Span:
    """Orthonormal basis of a subspace of R^n, extended vector by vector.

    Parameters
    ----------
    n : int
        The dimension of the space.

    Attributes
    ----------
    size : int
        The dimension of the subspace.
    """

    def __init__(self, n: int) -> None:
        self._basis, self.size = np.empty((n, n)), 0

    @property
    def basis(self) -> Floats:
        """The basis vectors as rows, shape (size, n)."""
        return self._basis[: self.size]

    def outside(self, vector: Floats) -> Floats:
        """Return the component (n,) of a vector (n,) that is orthogonal to the span."""
        left = vector.copy()
        for _ in range(2):  # twice is enough (Kahan)
            left -= (self.basis @ left) @ self.basis
        return left

    def extend(self, vector: Floats, least: float) -> bool:
        """Extend the basis by the component of a vector (n,) outside the span.

        Returns
        -------
        bool
            Whether that component is longer than `least`; the basis is unchanged where
            it is not.
        """
        rest = self.outside(vector)
        length = float(np.linalg.norm(rest))
        if not length > least:
            return False
        if self.size < len(self._basis):
            self._basis[self.size] = rest / length
            self.size += 1
        return True


# --- Sparse matrices

MOST_ITERATIONS = 200
# Number of right-hand sides in one sparse solve.
TOGETHER = 64


class Entries(NamedTuple):
    """Nonzero entries of a matrix: row indices i, columns j, and values; each (k,)."""

    i: Any
    j: Any
    values: Floats

    def dense(self, rows: int, columns: int) -> Floats:
        """Return the dense matrix, shape (rows, columns)."""
        found = np.zeros((rows, columns))
        found[self.i, self.j] = self.values
        return found

    def sparse(self, rows: int, columns: int) -> Any:
        """Return the matrix as a scipy `csc_matrix`, shape (rows, columns)."""
        from scipy.sparse import csc_matrix

        places = (self.i, self.j)
        return csc_matrix((self.values, places), shape=(rows, columns))


def kkt_factors(M: Any, A: Any) -> Any:
    """Compute the sparse LU factors of [[M, A^T], [A, 0]].

    Parameters
    ----------
    M : sparse matrix, shape (n, n)
    A : sparse matrix, shape (m, n)

    Returns
    -------
    SuperLU or None
        None where the matrix is singular.
    """
    from scipy.sparse import bmat

    return factored(bmat([[M, A.T], [A, None]], format="csc"))


def factored(A: Any, *, symmetric: bool = False) -> Any:
    """Compute the sparse LU factors of A.

    Parameters
    ----------
    A : sparse matrix, shape (n, n)
    symmetric : bool
        Whether A is symmetric and needs no pivoting: the order of elimination then
        reduces the fill of A + A^T.

    Returns
    -------
    SuperLU or None
        None where A is singular.
    """
    from scipy.sparse.linalg import splu

    # If rows are exchanged, an order that suits A + A^T fills the factors: for a chain
    # of 3,000 rods 13.6 million entries instead of 84,000.
    order, threshold = ("MMD_AT_PLUS_A", 0.0) if symmetric else ("COLAMD", 1.0)
    try:
        return splu(
            A.tocsc(),
            permc_spec=order,
            diag_pivot_thresh=threshold,
            options={"SymmetricMode": symmetric},
        )
    except RuntimeError:
        return None


def lengths_in(M: Any, A: Any) -> Floats:
    """Return the lengths (m,) of the rows of A in the metric M^-1.

    Parameters
    ----------
    M : sparse matrix, shape (n, n)
        Symmetric and positive definite.
    A : sparse matrix, shape (m, n)
        The rows.
    """
    entries = M.tocoo()
    if np.all(entries.row == entries.col):
        return np.asarray(np.sqrt(A.multiply(A) @ (1.0 / M.diagonal())))
    factors = factored(M, symmetric=True)
    columns = A.T.tocsc()
    squares = []
    for k in range(0, A.shape[0], TOGETHER):
        part = columns[:, k : k + TOGETHER].toarray()
        squares.append(np.sum(part * factors.solve(part), axis=0))
    return np.asarray(np.sqrt(np.concatenate(squares)))


def largest_eigenvalue(
    apply: Callable[[Floats], Floats], size: int
) -> tuple[float, Floats]:
    """Compute the largest eigenvalue of a positive operator by power iteration.

    Parameters
    ----------
    apply : callable
        Maps a vector (size,) to its product with the operator.
    size : int
        Length of the vectors.

    Returns
    -------
    value : float
        inf where an iterate is 0 or not finite.
    vector : ndarray, shape (size,)
        The eigenvector, of length 1.
    """
    x = np.random.default_rng(5).standard_normal(size)  # a fixed seed: reproducible
    x /= np.linalg.norm(x)
    value = 0.0
    for _ in range(MOST_ITERATIONS):
        image = apply(x)
        before, value = value, float(np.linalg.norm(image))
        if not 0.0 < value < np.inf:
            return np.inf, x
        x = image / value
        if abs(value - before) <= HALF_OF_DIGITS * value:
            break
    return value, x
