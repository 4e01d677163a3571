"""M = L L^T, alone or together with the constraints, and its triangular solves.

Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 4.2.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

NAN = float("nan")


def factor(p: Parameters) -> None:
    """Factor M, or M + A^T W A with the rows that always hold."""
    n, M, L = p.n, p.M, p.L
    for i in range(n):
        for j in range(i + 1):
            L[i * n + j] = M[i * n + j]
    if p.augmented > 0.0:
        A = p.A
        for k in range(p.m - p.laws):
            row = at(A, k * n)
            weight = row_weight(n, M, row)
            for i in range(n):
                for j in range(i + 1):
                    L[i * n + j] += weight * row[i] * row[j]
    cholesky(n, L)


def cholesky(n: int, L: Floats) -> None:
    """Replace the lower triangle by its Cholesky factor; nan where not positive."""
    for j in range(n):
        for i in range(j, n):
            value = L[i * n + j]
            for k in range(j):
                value -= L[i * n + k] * L[j * n + k]
            if i > j:
                L[i * n + j] = value / L[j * n + j]
            elif value > 0.0:
                L[j * n + j] = sqrt(value)
            else:
                L[j * n + j] = NAN


def row_weight(n: int, M: Floats, row: Floats) -> float:
    """Give the weight that brings row^T row to the size of M where the row is.

    That of other bodies would drown in it what M has there.
    """
    largest = 0.0
    whole = 0.0
    square = 0.0
    for j in range(n):
        inertia = abs(M[j * n + j])
        whole = max(whole, inertia)
        if row[j] != 0.0:
            largest = max(largest, inertia)
        square += row[j] * row[j]
    if square == 0.0:
        return 0.0
    if largest == 0.0:
        largest = whole
    if largest == 0.0:
        return 1.0 / square
    return largest / square


def augment_force(p: Parameters) -> None:
    """Add A^T W b to f."""
    n, M, A, f, b = p.n, p.M, p.A, p.f, p.b
    for k in range(p.m - p.laws):
        row = at(A, k * n)
        weight = row_weight(n, M, row) * b[k]
        for j in range(n):
            f[j] += weight * row[j]


def forward(n: int, L: Floats, x: Floats) -> None:
    """Replace x by L^-1 x."""
    for i in range(n):
        value = x[i]
        for j in range(i):
            value -= L[i * n + j] * x[j]
        x[i] = value / L[i * n + i]


def backward(n: int, L: Floats, x: Floats, out: Floats) -> None:
    """Give L^-T x; x is used up."""
    for k in range(n):
        i = n - 1 - k
        value = x[i] / L[i * n + i]
        out[i] = value
        for j in range(i):
            x[j] -= L[i * n + j] * value
