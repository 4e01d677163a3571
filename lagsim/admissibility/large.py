"""Scenes of many coordinates: M and A as sparse matrices.

What is decided here is decided as for small scenes, as long as M is safely positive and
the rows are safely independent; where they are not, the caller falls back on dense
matrices, which takes time proportional to the cube of the number of coordinates.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.admissibility.newton import MOST_STEPS, SOLVED, Found, runs_away

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.admissibility.point import AtState, Entries, Point
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.chains import Chains

# Coordinates from which on a dense decomposition takes longer than loading scipy.
LARGE = 200
# A smallest singular value, or eigenvalue, above this is safely not zero.
SURELY = 1e-5
# Inverse iteration ends when the value changes by less than this part.
SETTLED = 1e-6
MOST_ITERATIONS = 200
# Columns that are solved for together.
TOGETHER = 64
# A step this small, against the values, is the last; so is one that is no shorter than
# this part of the one before.
LAST = 1e-12
SHORTER = 0.9


def is_large(point: Point) -> bool:
    """Tell whether a scene is large."""
    return point.n >= LARGE


def matrix(entries: Entries, rows: int, columns: int) -> Any:
    """Give a scipy matrix in compressed columns."""
    from scipy.sparse import csc_matrix

    return csc_matrix((entries.values, (entries.i, entries.j)), shape=(rows, columns))


def is_positive(point: Point, q: Floats, v: Floats) -> bool:
    """Tell whether M is safely positive definite; False where it is not safe."""
    if point.e.chains is not None:
        return _is_positive_along(point, point.e.chains, q, v)
    M = matrix(point.mass_entries(q, v), point.n, point.n)
    diagonal = M.diagonal()
    if not (np.all(np.isfinite(M.data)) and np.all(diagonal > 0)):
        return False
    if _is_diagonal(M):
        return True
    from scipy.sparse import diags

    scale = diags(1.0 / np.sqrt(diagonal))
    factors = _factored(scale @ M @ scale, symmetric=True)
    if factors is None or not np.all(factors.U.diagonal() > 0):
        return False
    if not np.array_equal(factors.perm_r, factors.perm_c):
        return False  # pivots off the diagonal say nothing
    return 1.0 / _largest(factors.solve, point.n)[0] > SURELY


def _is_positive_along(point: Point, chains: Chains, q: Floats, v: Floats) -> bool:
    """Tell it by the pivots of M, against its diagonal."""
    from lagsim.language.sparse import Meter
    from lagsim.mechanics.chains import Articulated

    pivots = Articulated(point.g, chains, Meter()).pivots
    own = point.array([pivots[k][0] for k in range(point.n)], q, v)
    diagonal = point.array(point.e.inertias, q, v)
    if not (np.all(np.isfinite(own)) and np.all(diagonal > 0)):
        return False
    return bool(np.min(own / diagonal) > SURELY)


def row_lengths(point: Point, q: Floats, v: Floats) -> Floats:
    """Give the lengths (m,) of rows in the metric of M; nan where M is not safe."""
    rows, n = point.e.rows, point.n
    if not is_positive(point, q, v):
        return np.full(len(rows), np.nan)
    A = matrix(point.jacobian_entries(rows, q, v), len(rows), n)
    return _lengths(matrix(point.mass_entries(q, v), n, n), A)


class SparseRows:
    """The constraint rows at a state, in the metric of M.

    Attributes
    ----------
    smallest : float
        The smallest singular value of the rows, each divided by its length or by
        `usual`; 0 where that is not safe to tell.
    weakest : ndarray, shape (m,)
        The combination of rows that it belongs to.
    """

    def __init__(
        self,
        point: Point,
        q: Floats,
        v: Floats,
        errors: Mapping[str, float] | None = None,
        usual: Sequence[float] | None = None,
    ) -> None:
        rows = point.e.rows
        m, n = len(rows), point.n
        M = matrix(point.mass_entries(q, v), n, n)
        A = matrix(point.jacobian_entries(rows, q, v, errors), m, n)
        self.smallest = 0.0
        self.weakest = np.zeros(m)
        if is_positive(point, q, v):
            lengths = _lengths(M, A)
            scale = lengths if usual is None else np.fmax(usual, lengths)
            if np.all(scale > 0):
                self._weigh(M, A, scale)

    def _weigh(self, M: Any, A: Any, scale: Floats) -> None:
        from scipy.sparse import bmat, diags

        scaled = diags(1.0 / scale) @ A
        factors = _factored(bmat([[M, scaled.T], [scaled, None]], format="csc"))
        if factors is None:
            return
        n = M.shape[0]

        def inverse(r: Floats) -> Floats:
            """Give (A M^-1 A^T)^-1 r."""
            return -np.asarray(factors.solve(np.concatenate([np.zeros(n), r])))[n:]

        largest, self.weakest = _largest(inverse, len(scale))
        self.smallest = 1.0 / math.sqrt(largest) if np.isfinite(largest) else 0.0


def nearest(relations: AtState, x0: Floats, M: Any) -> Found | None:
    """Give the point nearest to x0 in the metric M (n, n) that meets the relations.

    Each step goes to the nearest point that meets them to first order. None where that
    does not settle.
    """
    from scipy.sparse import bmat

    def at(x: Floats) -> tuple[Floats, Any]:
        r, entries = relations.sparse(x)
        return r, matrix(entries, len(r), len(x))

    if relations.exact(x0):
        return Found(x0.copy(), met=True)
    x, last = x0.copy(), np.inf
    for _ in range(MOST_STEPS):
        r, J = at(x)
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(J.data))):
            return None
        factors = _factored(bmat([[M, J.T], [J, None]], format="csc"))
        if factors is None:
            return None
        step = factors.solve(np.concatenate([M @ (x0 - x), -r]))[: len(x)]
        if not np.all(np.isfinite(step)):
            return None
        x = x + step
        # Each value against its own size, for others may be far larger; one that
        # should be zero ends where steps no longer become shorter.
        length = float(np.sqrt(step @ (M @ step)))
        if np.all(np.abs(step) <= LAST * np.abs(x)) or length > SHORTER * last:
            way = np.sqrt((x - x0) @ (M @ (x - x0)) / M.diagonal())
            errors = SOLVED * (np.abs(x) + way)
            if not relations.met(x, errors) or runs_away(relations, at, x0, x, errors):
                return None
            return Found(x, met=True)
        last = length
    return None


def _lengths(M: Any, A: Any) -> Floats:
    """Give the lengths (m,) of the rows of A."""
    if _is_diagonal(M):
        return np.asarray(np.sqrt(A.multiply(A) @ (1.0 / M.diagonal())))
    factors = _factored(M, symmetric=True)
    columns = A.T.tocsc()
    squares = []
    for k in range(0, A.shape[0], TOGETHER):
        part = columns[:, k : k + TOGETHER].toarray()
        squares.append(np.sum(part * factors.solve(part), axis=0))
    return np.asarray(np.sqrt(np.concatenate(squares)))


def _is_diagonal(M: Any) -> bool:
    entries = M.tocoo()
    return bool(np.all(entries.row == entries.col))


def _factored(A: Any, *, symmetric: bool = False) -> Any:
    """Give LU factors, `symmetric` without pivoting; None where A is singular."""
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


def _largest(apply: Callable[[Floats], Floats], size: int) -> tuple[float, Floats]:
    """Give the largest eigenvalue of a positive operator, and its vector."""
    x = np.random.default_rng(5).standard_normal(size)  # the same each time
    x /= np.linalg.norm(x)
    value = 0.0
    for _ in range(MOST_ITERATIONS):
        moved = apply(x)
        before, value = value, float(np.linalg.norm(moved))
        if not 0.0 < value < np.inf:
            return np.inf, x
        x = moved / value
        if abs(value - before) <= SETTLED * value:
            break
    return value, x
