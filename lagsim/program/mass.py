"""Kernels of the mass matrix: M = L L^T, and the motion without constraint forces.

Where M alone is singular, M and f are replaced by M + A^T W A and f + A^T W b with a
diagonal W that scales A^T W A to the size of M: q'' and lambda do not change.

Matrices are flat arrays, row by row. L has the envelope of M: `first` (n,) holds the
column of the first element of each row that is not always 0.

Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 4.2.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.words import bits

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Whether each row of L and of the constraints counts as reaching all coordinates, and
# all other rows: where lists would cost more than they save. Set by the translator.
WHOLE = False


def factor(p: Parameters) -> None:
    """Factor M = L L^T, or M + A^T W A with the rows A that always hold, into p.L."""
    n = p.n
    p.L[:] = p.M
    if p.augmented > 0.0:
        A = p.A
        for k in range(p.m - p.laws):
            row = A[k * n :]
            weight = row_weight(n, p.M, row)
            for i in range(n):
                p.L[i * n : i * n + i + 1] += weight * row[i] * row[: i + 1]
    cholesky(n, p.inertia_first, p.L)
    for i in range(n):
        p.pivots[i] = p.L[i * n + i]


def cholesky(n: int, first: Floats, L: Floats) -> None:
    """Replace the lower triangle of L (n, n) by its Cholesky factor; nan if indefinite.

    first : (n,), see `first_column`.

    Examples
    --------
    >>> import numpy as np
    >>> L = np.array([4.0, 0.0, 2.0, 5.0])  # 2 x 2, row by row
    >>> cholesky(2, np.zeros(2), L)
    >>> L.tolist()
    [2.0, 0.0, 1.0, 2.0]
    """
    if WHOLE:
        for j in range(n):  # by columns, whose divisions do not wait for each other
            for i in range(j, n):
                reduce_element(n, i, j, 0, L)
    else:
        for i in range(n):
            begin = int(first[i])
            for j in range(begin, i + 1):
                reduce_element(n, i, j, max(begin, int(first[j])), L)


def reduce_element(n: int, i: int, j: int, begin: int, L: Floats) -> None:
    """Replace M_ij in L (n, n) by the element L_ij of the Cholesky factor.

    M_ij less the sum of L_ik L_jk, begin <= k < j, is divided by L_jj (i > j), or its
    root is taken (i = j); nan if a pivot is not positive.

    begin : the first column in which rows i and j may both be nonzero.
    """
    value = L[i * n + j]
    for k in range(begin, j):
        value -= L[i * n + k] * L[j * n + k]
    if i > j:
        L[i * n + j] = value / L[j * n + j]
    elif value > 0.0:
        L[j * n + j] = sqrt(value)
    else:
        L[j * n + j] = nan


def row_weight(n: int, M: Floats, row: Floats) -> float:
    """Return the weight w that scales w row^T row (n, n) to the size of M.

    The size is the largest diagonal element of M among the row's coordinates: with the
    inertia of a heavier body elsewhere, rounding would destroy the elements of M here.
    0 for a row of zeros.
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
    """Add A^T W b to the forces p.f (n,), with the weights W of `row_weight`."""
    n = p.n
    for k in range(p.m - p.laws):
        row = p.A[k * n :]
        weight = row_weight(n, p.M, row) * p.b[k]
        p.f[:] += weight * row[:n]


def forward(n: int, first: Floats, L: Floats, x: Floats) -> None:
    """Replace x (n,) by L^-1 x, L (n, n) lower triangular.

    first : (n,), see `first_column`.
    """
    for i in range(n):
        value = x[i]
        for j in range(first_column(first, i), i):
            value -= L[i * n + j] * x[j]
        x[i] = value / L[i * n + i]


def forward_mass(p: Parameters, x: Floats) -> None:
    """Replace x (n,) by L^-1 x, where M = L L^T."""
    n = p.n
    for i in range(n):
        value = x[i]
        for j in range(first_column(p.inertia_first, i), i):
            value -= p.L[i * n + j] * x[j]
        x[i] = value / p.pivots[i]


def backward_mass(p: Parameters, x: Floats, out: Floats) -> None:
    """Store L^-T x (n,) in out, where M = L L^T; x is overwritten."""
    n = p.n
    for k in range(n):
        i = n - 1 - k
        value = x[i] / p.pivots[i]
        out[i] = value
        begin = first_column(p.inertia_first, i)
        if begin < i:
            x[begin:i] -= p.L[i * n + begin : i * n + i] * value


def backward(n: int, first: Floats, L: Floats, x: Floats, out: Floats) -> None:
    """Store L^-T x (n,) in out; x is overwritten.

    first : see `first_column`.
    """
    for k in range(n):
        i = n - 1 - k
        value = x[i] / L[i * n + i]
        out[i] = value
        begin = first_column(first, i)
        x[begin:i] -= L[i * n + begin : i * n + i] * value


def first_column(first: Floats, i: int) -> int:
    """Return the column of the first element of row i of L that may be nonzero.

    first : (n,), these columns.
    """
    if WHOLE:
        return 0
    return int(first[i])


def free_motion(p: Parameters) -> None:
    """Store M^-1 f (n,) in p.motion, and L^-1 f (n,) in p.v."""
    p.v[:] = p.f
    forward_mass(p, p.v)
    p.u[:] = p.v
    backward_mass(p, p.u, p.motion)


def missing(p: Parameters, i: int) -> float:
    """Return b_i - A_i q'', the residual of row i on the level of accelerations."""
    A = p.A[i * p.n :]
    value = p.b[i]
    for e in range(first_range(p, i), first_range(p, i + 1)):
        for j in range(range_begin(p, e), range_end(p, e)):
            value -= A[j] * p.motion[j]
    return float(value)


def first_range(p: Parameters, i: int) -> int:
    """Return the index of the first column range of row i.

    Column ranges cover the possible nonzeros of the rows of A L^-T, and of the friction
    that their multipliers cause; the ranges of row i are first_range(i) ...
    first_range(i + 1) - 1.
    """
    if WHOLE:
        return i
    return bits(p.reach_starts[i])


def range_begin(p: Parameters, e: int) -> int:
    """Return the first column of column range e, see `first_range`."""
    if WHOLE:
        return 0
    return bits(p.reach_begins[e])


def range_end(p: Parameters, e: int) -> int:
    """Return the end, exclusive, of column range e, see `first_range`."""
    if WHOLE:
        return p.n
    return bits(p.reach_ends[e])


def store_direction(p: Parameters, k: int, u: Floats) -> None:
    """Store z = L^-T u in row k of p.directions, and M z in row k of p.momenta.

    u : (n,), of length 1, so that z has length 1 in the metric of M.
    """
    n = p.n
    z, momentum = p.directions[n * k :], p.momenta[n * k :]
    for a in range(n):
        momentum[a] = 0.0
        for j in range(a + 1):
            momentum[a] += p.L[a * n + j] * u[j]
    backward(n, p.inertia_first, p.L, u, z)


def product(length: int, a: Floats, b: Floats) -> float:
    """Return the inner product of the first `length` elements of a and b."""
    value = 0.0
    for i in range(length):
        value += a[i] * b[i]
    return value
