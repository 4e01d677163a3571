"""Linear algebra of small dense and large sparse matrices: metrics, spans, factors.

The metric of changes is M. Where M is singular another one takes its place, in which
neither the units of coordinates nor the scales of relations count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.tolerances import COMPUTED_ZERO, DEPENDENT_ROWS, HALF_OF_DIGITS

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats


# --- Metrics


def least_change_metric(M: Floats) -> Floats:
    """Metric of least change (k, k): M, or Euclid's where it is not positive."""
    return M if is_positive(M) else np.eye(len(M))


def rank_metric(M: Floats, A: Floats) -> Floats:
    """Metric (n, n) in which rows are compared: M, or its diagonal, completed."""
    if is_positive(M):
        return M
    return np.diag(sizes_of(np.sqrt(np.abs(np.diag(M))), A) ** 2)


def solving_metric(M: Floats, A: Floats) -> Floats:
    """Metric (n, n) of least change in which the motion is solved for.

    `completed`, or Euclid's where that is singular, too.
    """
    return least_change_metric(completed(M, A))


def completed(M: Floats, A: Floats) -> Floats:
    """M, or M + A^T W A where it is singular (n, n).

    W is diagonal and to the size of M (see `program/dense.py`).
    """
    if is_positive(M):
        return M
    inertias = np.abs(np.diag(M))
    held = np.max(np.where(A != 0.0, inertias, 0.0), axis=1, initial=0.0)
    sizes = np.where(held > 0.0, held, np.max(inertias, initial=0.0) or 1.0)
    squares = np.sum(A * A, axis=1)
    weights = sizes / np.where(squares > 0.0, squares, 1.0)
    return np.asarray(M + (A.T * weights) @ A)


def sizes_of(roots: Floats, A: Floats) -> Floats:
    """Size of each coordinate: sqrt(M_jj), or what the rows A (m, n) put in its place.

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


def is_positive(M: Floats) -> bool:
    """Whether M, scaled to a diagonal of 1, is positive definite."""
    size = np.sqrt(np.abs(np.diag(M)))
    if not np.all(size > 0) or not np.all(np.isfinite(M)):
        return False
    return bool(np.linalg.eigvalsh(M / np.outer(size, size))[0] > DEPENDENT_ROWS)


# --- Solutions and spans


def least_squares(
    A: Floats, b: Floats, cutoff: float | None = DEPENDENT_ROWS
) -> Floats:
    """Return least x of least |A x - b|, with singular values below a part left out.

    Raises
    ------
    LinAlgError
        Where something is not finite. LAPACK would say so on stderr, too.
    """
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
        raise np.linalg.LinAlgError("not finite")
    return np.asarray(np.linalg.lstsq(A, b, rcond=cutoff)[0])


def cholesky(metric: Floats) -> Floats:
    """L with L L^T = metric."""
    return np.asarray(np.linalg.cholesky(metric), dtype=float)


def scaled(A: Floats, L: Floats) -> tuple[Floats, Floats]:
    """Rows of A (m, k) in the metric of (L L^T)^-1, to length 1 or 0.

    And their lengths (m,).
    """
    Y = np.linalg.solve(L, A.T).T
    lengths = np.linalg.norm(Y, axis=1)
    return Y / np.where(lengths > 0, lengths, 1.0)[:, None], lengths


class Metric:
    """Changes (n,) in the metric in which a motion is solved for, along rows or not.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        The mass matrix, positive along what A lets through.
    A : ndarray, shape (m, n)
        The rows of constraints, which may be dependent.

    Attributes
    ----------
    G, L : ndarray, shape (n, n)
        M, `completed`; L L^T = G.
    free : ndarray, shape (n, d)
        The changes that A lets through, A free = 0: orthonormal by G, and by M.
    inverse : ndarray, shape (n, m)
        A^+, the least change by G that changes the rows by given amounts.

    Raises
    ------
    LinAlgError
        Where that is not positive.
    """

    def __init__(self, M: Floats, A: Floats) -> None:
        self.M, self.G = M, completed(M, A)
        self.L = cholesky(self.G)
        rows, lengths = scaled(A, self.L)
        U, s, V = np.linalg.svd(rows)
        rank = int(np.sum(s > DEPENDENT_ROWS * np.max(s, initial=1.0)))
        back = np.linalg.inv(self.L.T)
        self.free = back @ V[rank:].T
        scales = np.where(lengths > 0.0, lengths, 1.0)
        self._pseudo = V[:rank].T @ (U[:, :rank] / s[:rank]).T / scales
        self.inverse = back @ self._pseudo

    def motion(self, f: Floats, b: Floats) -> tuple[Floats, Floats]:
        """Return q'' (n,) and lambda (m,) of M q'' = f + A^T lambda, A q'' = b."""
        q = self.inverse @ b
        q = q + self.free @ (self.free.T @ (f - self.M @ q))
        return q, self.multipliers(f - self.M @ q)

    def multipliers(self, f: Floats) -> Floats:
        """Lambda (m,) that comes closest to f + A^T lambda = 0."""
        return np.asarray(-self._pseudo.T @ np.linalg.solve(self.L, f))


def multiple_of(x: Floats, y: Floats) -> float:
    """Factor by which y is x (n,) within rounding; 0 where it is no multiple."""
    square = float(x @ x)
    factor = float(y @ x) / square if square > 0.0 else 0.0
    same = np.max(np.abs(y - factor * x)) <= COMPUTED_ZERO * np.max(np.abs(y))
    return factor if same else 0.0


def null_space(J: Floats, cutoff: float | None = None) -> Floats:
    """Orthonormal basis (k, k - rank) of what J (m, k) maps to zero.

    Singular values count as zero up to `cutoff`; by default up to DEPENDENT_ROWS times
    the largest.
    """
    if not J.size:
        return np.eye(J.shape[1])
    _, sizes, basis = np.linalg.svd(J)
    least = DEPENDENT_ROWS * np.max(sizes, initial=0.0) if cutoff is None else cutoff
    return np.asarray(basis[int(np.sum(sizes > least)) :].T)


class Span:
    """Growing orthonormal basis of a space of n dimensions."""

    def __init__(self, n: int) -> None:
        self._basis, self.size = np.empty((n, n)), 0

    @property
    def basis(self) -> Floats:
        """The vectors, (size, n)."""
        return self._basis[: self.size]

    def outside(self, vector: Floats) -> Floats:
        """Part of a vector that is orthogonal to the span, (n,)."""
        left = vector.copy()
        for _ in range(2):  # twice is enough (Kahan)
            left -= (self.basis @ left) @ self.basis
        return left

    def extend(self, vector: Floats, least: float) -> bool:
        """Add what of a vector is outside, if it is longer than `least`; tell so."""
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
# Columns that are solved for together.
TOGETHER = 64


class Entries(NamedTuple):
    """Entries of a matrix that are not zero: rows, columns, values, each (k,)."""

    i: Any
    j: Any
    values: Floats

    def dense(self, rows: int, columns: int) -> Floats:
        """Matrix (rows, columns)."""
        found = np.zeros((rows, columns))
        found[self.i, self.j] = self.values
        return found

    def sparse(self, rows: int, columns: int) -> Any:
        """Matrix as scipy's, in compressed columns."""
        from scipy.sparse import csc_matrix

        places = (self.i, self.j)
        return csc_matrix((self.values, places), shape=(rows, columns))


def kkt_factors(M: Any, A: Any) -> Any:
    """LU factors of [[M, A^T], [A, 0]]; None where it is singular."""
    from scipy.sparse import bmat

    return factored(bmat([[M, A.T], [A, None]], format="csc"))


def factored(A: Any, *, symmetric: bool = False) -> Any:
    """LU factors, `symmetric` without pivoting; None where A is singular."""
    from scipy.sparse.linalg import splu

    # With rows exchanged an order that is good for A + A^T fills the factors: of a
    # chain of 3,000 rods 13.6 million entries instead of 84,000.
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
    """Lengths (m,) of the rows of A in the metric of M^-1, both sparse."""
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
    """Return the largest eigenvalue of a positive operator, and its vector (size,)."""
    x = np.random.default_rng(5).standard_normal(size)  # the same each time
    x /= np.linalg.norm(x)
    value = 0.0
    for _ in range(MOST_ITERATIONS):
        moved = apply(x)
        before, value = value, float(np.linalg.norm(moved))
        if not 0.0 < value < np.inf:
            return np.inf, x
        x = moved / value
        if abs(value - before) <= HALF_OF_DIGITS * value:
            break
    return value, x
