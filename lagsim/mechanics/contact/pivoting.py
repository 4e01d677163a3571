"""Lemke's method for linear complementarity: w = M z + q; w, z >= 0; w z = 0.

It goes along edges from a point where an artificial variable makes all q >= 0. Ties are
broken lexicographically, so that it cannot run in circles: on degenerate problems too
(balls that touch at rest, redundant legs) it ends. For copositive matrices, which
those of contacts and of friction are, it ends in a solution where there is one.

Source: R. W. Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem
(1992), sections 4.4 and 4.9.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.tolerances import SAME_RATIO, TABLEAU_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats

# Pivots for each row; a few times the number of rows is what it needs in practice.
PATIENCE = 50


class _Tableau:
    """basic + T nonbasic = rhs; labels: w_i is i, z_i is n + i, the artificial 2 n."""

    def __init__(self, M: Floats, q: Floats) -> None:
        n = self.n = len(q)
        self.T = np.empty((n, n + 2))
        self.T[:, :n] = -M
        self.T[:, n] = -1.0
        self.T[:, n + 1] = q
        self.basic = list(range(n))
        self.column = {n + j: j for j in range(n + 1)}
        self.labels = list(range(n, 2 * n + 1))

    def exchange(self, row: int, entering: int) -> int:
        """Make a variable basic in a row; give the one that leaves it."""
        T, col = self.T, self.column.pop(entering)
        leaving = self.basic[row]
        inverse = 1.0 / T[row, col]
        pivot_row = T[row] * inverse
        pivot_row[col] = inverse
        factors = T[:, col].copy()
        factors[row] = 0.0
        T[:, col] = 0.0
        T -= factors[:, None] * pivot_row
        T[row] = pivot_row
        self.basic[row], self.labels[col] = entering, leaving
        self.column[leaving] = col
        return leaving

    def order(self, row: int, scale: float) -> list[int]:
        """Give what decides between tied rows: that of the inverse of the basis."""
        column, basic, T = self.column, self.basic[row], self.T[row].tolist()
        entries = [
            T[column[j]] if j in column else float(basic == j) for j in range(self.n)
        ]
        return [round(x / scale / SAME_RATIO) for x in entries]

    def leaving_row(self, entering: int) -> int:
        """Give the row that blocks first, or -1 if none does."""
        col: list[float] = self.T[:, self.column[entering]].tolist()
        rhs: list[float] = self.T[:, -1].tolist()
        ratios = {
            i: max(x, 0.0) / a
            for i, (a, x) in enumerate(zip(col, rhs, strict=True))
            if a > TABLEAU_ROUNDOFF
        }
        if not ratios:
            return -1
        most = min(ratios.values()) * (1.0 + SAME_RATIO) + SAME_RATIO
        tied = [i for i, ratio in ratios.items() if ratio <= most]
        if len(tied) == 1:
            return tied[0]
        for i in tied:
            if self.basic[i] == 2 * self.n:
                return i
        return min(tied, key=lambda i: self.order(i, col[i]))


def lemke(M: Floats, q: Floats) -> Flags | None:
    """Give which z are basic in a solution, or None where a ray is all there is.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        With entries near 1: scaled.
    q : ndarray, shape (n,)

    Raises
    ------
    FloatingPointError
        Where q is not finite.
    """
    n = len(q)
    size = float(np.abs(q).max(initial=0.0))
    if not np.isfinite(size):
        raise FloatingPointError("forces that are not finite")
    if not n or float(q.min()) >= 0.0:
        return np.zeros(n, dtype=bool)
    tableau = _Tableau(M, q / size)
    least = np.flatnonzero(tableau.T[:, -1] <= tableau.T[:, -1].min() + SAME_RATIO)
    leaving = tableau.exchange(int(least[-1]), 2 * n)
    for _ in range(PATIENCE * n):
        entering = leaving + n if leaving < n else leaving - n
        row = tableau.leaving_row(entering)
        if row < 0:
            return None
        leaving = tableau.exchange(row, entering)
        if leaving == 2 * n:
            basis = np.zeros(n, dtype=bool)
            basis[[label - n for label in tableau.basic if label >= n]] = True
            return basis
    return None
