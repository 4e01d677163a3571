"""What the matrix exponential is made of: balancing, a short series, doubling.

Matrices (m, m) row by row, unless it is said otherwise.

Sources: N. J. Higham, SIAM Journal on Matrix Analysis 26 (2005) (scaling and squaring);
B. N. Parlett and C. Reinsch, Numerische Mathematik 13 (1969) (balancing).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# The terms left out: 0.5^15/15! = 2e-17, and 1/21! = 2e-20 for quadratic forms.
TERMS = 14
FORM_TERMS = 20
SWEEPS = 64
# Beyond, or if not finite, nothing is balanced.
LARGEST = 1e300
# Of the norm, where nothing that acts back has one.
NEGLIGIBLE = 2.0**-100


def norm(m: int, columns: int, a: Floats) -> float:
    """Give the largest sum of sizes in the first `columns` columns."""
    largest = 0.0
    for j in range(columns):
        column = 0.0
        for i in range(m):
            column += abs(a[i * m + j])
        largest = max(largest, column)
    return largest


def balance(m: int, a: Floats, d: Floats) -> None:
    """Replace A by D^-1 A D with about equal rows and columns, D powers of two.

    B. N. Parlett and C. Reinsch, Numer. Math. 13 (1969). No unit enters the number of
    squarings then. The last row is zero, so the last scale is free.
    """
    for i in range(m):
        d[i] = 1.0
    changed = True
    for _sweep in range(SWEEPS):
        if changed:
            changed = False
            for i in range(m - 1):
                factor = balancing(m, a, i)
                if factor != 1.0:
                    changed = True
                    rescale(m, a, d, i, factor)
    isolate(m, a, d)
    largest = norm(m, m - 1, a)
    last = 0.0
    for i in range(m):
        last += abs(a[i * m + m - 1])
    factor = 1.0
    while last * factor > largest and factor > 0.0:
        factor = 0.5 * factor
    rescale(m, a, d, m - 1, factor)


def isolate(m: int, a: Floats, d: Floats) -> None:
    """Scale what nothing depends on, or what depends on nothing, below the rest.

    The coordinate and the rate of a body in free fall, say: their scales are free, and
    the rates of the motion are those of the rest. Parlett and Reinsch permute them out.
    """
    largest = coupled_norm(m, a)
    largest = max(largest, NEGLIGIBLE * norm(m, m - 1, a))
    for i in range(m - 1):
        row = off_diagonal(m, a, i, m, 1)
        column = off_diagonal(m, a, i, 1, m)
        factor = 1.0
        if column == 0.0 and row < LARGEST:
            while row > largest * factor:
                factor = 2.0 * factor
        elif row == 0.0 and column < LARGEST:
            while column * factor > largest:
                factor = 0.5 * factor
        if factor != 1.0:
            rescale(m, a, d, i, factor)


def coupled_norm(m: int, a: Floats) -> float:
    """Give the norm of what depends on something and on which something depends."""
    largest = 0.0
    for j in range(m - 1):
        if off_diagonal(m, a, j, m, 1) > 0.0:
            column = abs(a[j * m + j])
            for i in range(m - 1):
                if i != j and off_diagonal(m, a, i, 1, m) > 0.0:
                    column += abs(a[i * m + j])
            largest = max(largest, column)
    return largest


def off_diagonal(m: int, a: Floats, i: int, by_row: int, by_column: int) -> float:
    """Give the sum of sizes of row i (m, 1) or column i (1, m) without the diagonal."""
    total = 0.0
    for j in range(m - 1):
        if j != i:
            total += abs(a[i * by_row + j * by_column])
    return total


def balancing(m: int, a: Floats, i: int) -> float:
    """Give the power of two that column i is to be multiplied by, row i divided."""
    column = off_diagonal(m, a, i, 1, m)
    row = off_diagonal(m, a, i, m, 1)
    if column == 0.0 or row == 0.0 or not column + row < LARGEST:
        return 1.0
    before = column + row
    factor = 1.0
    while column < 0.5 * row:
        factor = 2.0 * factor
        column = 4.0 * column
    while column >= 2.0 * row:
        factor = 0.5 * factor
        column = 0.25 * column
    if (column + row) / factor < 0.95 * before:
        return factor
    return 1.0


def rescale(m: int, a: Floats, d: Floats, i: int, factor: float) -> None:
    """Multiply column i by a power of two, divide row i by it, and note that in d."""
    d[i] = d[i] * factor
    for j in range(m):
        a[i * m + j] = a[i * m + j] / factor
    for j in range(m):
        a[j * m + i] = a[j * m + i] * factor


def begin_exponential(m: int, tau: float, a: Floats, F: Floats, x: Floats) -> None:
    """Set F to the series A tau (1 + A tau/2 (1 + A tau/3 (...)))."""
    for i in range(m * m):
        F[i] = 0.0
    for back in range(TERMS):
        part = tau / (TERMS - back)
        multiply(m, a, F, x)
        for i in range(m * m):
            F[i] = part * (a[i] + x[i])


def begin_form(
    m: int, tau: float, a: Floats, form: Floats, Q: Floats, x: Floats, y: Floats
) -> None:
    """Set Q to the sum of tau^(k + 1)/(k + 1)! L^k(P), L(X) = X A + A^T X."""
    for i in range(m * m):
        y[i] = tau * form[i]
        Q[i] = y[i]
    for k in range(FORM_TERMS):
        multiply(m, y, a, x)
        part = tau / (k + 2)
        for i in range(m):
            for j in range(m):
                y[i * m + j] = part * (x[i * m + j] + x[j * m + i])
        for i in range(m * m):
            Q[i] += y[i]


def double_form(m: int, F: Floats, Q: Floats, x: Floats, y: Floats) -> None:
    """Replace Q by Q + (1 + F)^T Q (1 + F)."""
    multiply(m, Q, F, x)
    for i in range(m * m):
        y[i] = 0.0
    for k in range(m):
        for i in range(m):
            factor = F[k * m + i]
            if factor != 0.0:
                for j in range(m):
                    y[i * m + j] += factor * x[k * m + j]
    for i in range(m):
        for j in range(m):
            y[i * m + j] += x[i * m + j] + x[j * m + i]
    for i in range(m * m):
        Q[i] = 2.0 * Q[i] + y[i]


def multiply(m: int, a: Floats, b: Floats, out: Floats) -> None:
    """Give the product of two matrices (m, m)."""
    for i in range(m):
        row = at(out, i * m)
        for j in range(m):
            row[j] = 0.0
        for k in range(m):
            factor = a[i * m + k]
            if factor != 0.0:
                for j in range(m):
                    row[j] += factor * b[k * m + j]


def times_columns(m: int, a: Floats, z: Floats, out: Floats) -> None:
    """Give the product with a matrix that is stored by columns."""
    for i in range(m):
        out[i] = 0.0
    for j in range(m):
        column = at(a, j * m)
        factor = z[j]
        for i in range(m):
            out[i] += factor * column[i]
