"""The mass matrix by loops: M = L L^T, and the motion that no row constrains.

Where M alone is singular, M + A^T W A and f + A^T W b stand for M and f: q'' and lambda
are the same (W diagonal, to the size of M).

Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 4.2.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def factor(p: Parameters) -> None:
    """Factor M, or M + A^T W A with the rows that always hold."""
    n = p.n
    p.L[:] = p.M
    if p.augmented > 0.0:
        A = p.A
        for k in range(p.m - p.laws):
            row = A[k * n :]
            weight = row_weight(n, p.M, row)
            for i in range(n):
                p.L[i * n : i * n + i + 1] += weight * row[i] * row[: i + 1]
    cholesky(n, p.L)


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
                L[j * n + j] = nan


def row_weight(n: int, M: Floats, row: Floats) -> float:
    """Weight that brings row^T row to the size of M where the row is.

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
    n = p.n
    for k in range(p.m - p.laws):
        row = p.A[k * n :]
        weight = row_weight(n, p.M, row) * p.b[k]
        p.f[:] += weight * row[:n]


def forward(n: int, L: Floats, x: Floats) -> None:
    """Replace x by L^-1 x."""
    for i in range(n):
        value = x[i]
        for j in range(i):
            value -= L[i * n + j] * x[j]
        x[i] = value / L[i * n + i]


def backward(n: int, L: Floats, x: Floats, out: Floats) -> None:
    """L^-T x; x is used up."""
    for k in range(n):
        i = n - 1 - k
        value = x[i] / L[i * n + i]
        out[i] = value
        x[:i] -= L[i * n : i * n + i] * value


def free_motion(p: Parameters) -> None:
    """Leave M^-1 f as the motion, and L^-1 f as v (n,)."""
    p.v[:] = p.f
    forward(p.n, p.L, p.v)
    p.u[:] = p.v
    backward(p.n, p.L, p.u, p.motion)


def missing(p: Parameters, i: int) -> float:
    """Residual of row i in the accelerations: b_i - A_i q''."""
    A = p.A[i * p.n :]
    value = p.b[i]
    for j in range(p.n):
        value -= A[j] * p.motion[j]
    return float(value)


def product(length: int, a: Floats, b: Floats) -> float:
    """Inner product."""
    value = 0.0
    for i in range(length):
        value += a[i] * b[i]
    return value
