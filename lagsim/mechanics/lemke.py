"""Lemke's method for linear complementarity problems, and rates that decide ties.

Source: R. W. Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem
(1992), sections 4.4 and 4.9.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.algebra import least_squares
from lagsim.tolerances import DEPENDENT_SQUARE, SOLUTION_ROUNDOFF, TABLEAU_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats, Ints

# Largest number of pivots per row; in practice a few per row suffice.
PATIENCE = 50
# Rates are differences: their rounding error as a part of their terms; and the addition
# to the diagonal that makes rows independent whose rates differ by rounding.
RATES_ROUNDOFF, REGULAR = 1e-6, 1e-7


def lemke(M: Floats, q: Floats) -> Floats | None:
    """Solve w = M z + q; w, z >= 0; w z = 0 by Lemke's method.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        Scaled to entries near 1.
    q : ndarray, shape (n,)

    Returns
    -------
    z : ndarray, shape (n,), or None
        None where the method ends on a ray, or after PATIENCE n pivots.
    """
    n, size = len(q), float(np.abs(q).max(initial=0.0))
    if not n or float(q.min()) >= 0.0:
        return np.zeros(n)
    # Columns: w (the inverse of the basis), z, the artificial variable, q.
    T = np.hstack([np.eye(n), -M, np.full((n, 1), -1.0), q[:, None] / size])
    basis = np.arange(n)
    row = int(np.flatnonzero(T[:, -1] <= T[:, -1].min() + SOLUTION_ROUNDOFF)[-1])
    entering = 2 * n
    for _ in range(PATIENCE * n):
        pivots = T[row] / T[row, entering]
        T -= np.outer(T[:, entering], pivots)
        T[row] = pivots
        leaving, basis[row] = int(basis[row]), entering
        if leaving == 2 * n:
            return _on_basis(M, q, basis)
        entering = leaving + n if leaving < n else leaving - n
        row = _leaving_row(T, T[:, entering], basis == 2 * n)
        if row < 0:
            return None
    return None


def _leaving_row(T: Floats, column: Floats, artificial: Flags) -> int:
    """Return the row of the lexicographic minimum ratio test, or -1 on a ray.

    Parameters
    ----------
    T : ndarray, shape (n, 2 n + 2)
        The tableau.
    column : ndarray, shape (n,)
        The entering column.
    artificial : ndarray of bool, shape (n,)
        True at the row of the artificial variable, which leaves first at ties.
    """
    tied = np.flatnonzero(column > TABLEAU_ROUNDOFF)
    if not len(tied):
        return -1
    ratios = np.maximum(T[tied, -1], 0.0) / column[tied]
    tied = tied[ratios <= ratios.min() * (1.0 + SOLUTION_ROUNDOFF) + SOLUTION_ROUNDOFF]
    if artificial[tied].any():
        return int(tied[artificial[tied]][0])
    j = 0
    while len(tied) > 1 and j < len(T):
        ratios = T[tied, j] / column[tied]
        tied = tied[ratios <= ratios.min() + SOLUTION_ROUNDOFF]
        j += 1
    return int(tied[0])


def _on_basis(M: Floats, q: Floats, basis: Ints) -> Floats:
    """Solve M z + q = 0 for the entries of z in the basis; return z (n,).

    All other entries are 0. The solution is accurate to rounding.

    basis : indices of basic variables; index n + i is that of z_i.
    """
    z, basic = np.zeros(len(q)), np.sort(basis[basis >= len(q)]) - len(q)
    B = M[np.ix_(basic, basic)]
    for _ in range(2):
        z[basic] -= least_squares(B, (M @ z + q)[basic], DEPENDENT_SQUARE)
    return np.maximum(z, 0.0)


def rates_at(
    D: Floats, c: Floats, noise: Floats, free: list[int], ways: Floats
) -> tuple[Floats, Floats]:
    """Solve for the rates x (r,) of multipliers, and w = D x + c; rates decide ties.

    A tie is a row with a multiplier at a bound and w = 0.

    Parameters
    ----------
    D : ndarray, shape (r, r)
        Accelerations of the r rows per unit multiplier.
    c, noise : ndarray, shape (r,)
        The rates of accelerations at constant multipliers, and their rounding errors.
    free : list of int
        Indices of independent rows with w = 0 and x of either sign.
    ways : ndarray, shape (k, r)
        The directions in which the k multipliers at a bound leave that bound.

    Returns
    -------
    x, w : ndarray, shape (r,)
        Both 0 where there is no solution; entries of w within rounding are 0.
    """
    c = np.where(np.abs(c) > noise, c, 0.0)
    right = np.column_stack([D, c])
    hold = least_squares(D[np.ix_(free, free)], right[free], DEPENDENT_SQUARE)
    G = right - D[:, free] @ hold
    sizes = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", ways, D, ways), 0.0))
    N = ways[sizes > 0.0] / sizes[sizes > 0.0, None]
    M = N @ G[:, :-1] @ N.T + REGULAR * np.eye(len(N))
    a = lemke(M, N @ np.where(np.abs(G[:, -1]) > noise, G[:, -1], 0.0))
    if a is None:
        return np.zeros(len(c)), np.zeros(len(c))
    x = a @ N
    x[free] -= hold @ np.append(x, 1.0)
    w, terms = D @ x + c, np.abs(D) @ np.abs(x) + np.abs(c)
    return x, np.where(np.abs(w) > noise + RATES_ROUNDOFF * terms, w, 0.0)
