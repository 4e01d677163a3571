"""The equations of motion solved by loops: for many coordinates and for hard cases.

    [ M  A^T ] [  q''    ]   [ f ]
    [ A   0  ] [ -lambda ] = [ b ]

M = L L^T; the columns of Y = L^-1 A^T are scaled to length 1 and Y = Q R is made by
Householder reflections with column pivoting, so that nearly parallel rows keep their
digits (S = Y^T Y would square the condition). Rows that are
redundant everywhere are set aside: away from the constraints, at the stages of a step,
they are not quite so, and which of them is left out must not change from stage to
stage. lambda is the solution of least norm over all rows, and A^T lambda is unique.
Where M alone is singular, M + A^T W A and f + A^T W b stand for M and f: q'' and
lambda are the same (W diagonal, to the size of M).

Sources: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., sections 4.2,
5.2, 5.4 and 5.5.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods._interface import LEAST_HEALTH, WEAK
from lagsim.native.kernel_types import at, external

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

# Where things lie in p.
COUNT = 0  # n
ROWS = 1  # m
MOTION = 2  # offset of q'' (n) and lambda (m), then this module's working memory
HAS_WORK = 3
AUGMENTED = 4
EXPECTED = 5  # the rank that the rows have in general
REFERENCE = 6  # the largest health so far: what is small is small against it
HEALTH = 7  # size of the last independent column, now
# 8 and 9: LEAST_HEALTH and WEAK, see methods._interface.
HEADER = 10

NAN = float("nan")
# A pivoted column counts as zero past the rank that the rows have in general (away from
# the constraints, at the stages of a step, dependent rows are not quite so), and below
# PASSING of REFERENCE: where rank is lost on the way, what would be divided by it is
# rounding.
RANK = 1e-10
PASSING = 1e-8
# The weakest direction is noted below this part of REFERENCE.
NOTED = 0.5


def workspace(n: int, m: int) -> int:
    """Give the length from MOTION on.

    q'', lambda, the rows' largest lengths, which rows are set aside, terms, L, Y, u, v,
    what `per_row` has, and the weakest direction.
    """
    return weak_direction(n, m) + 3 * n


def weak_direction(n: int, m: int) -> int:
    """Give where z, M z and room for one more (n,) lie, from MOTION on."""
    terms = n * n + n * m + n + 3 * m + 2
    return (n + 3 * m) + terms + n * n + n * m + 2 * n + 7 * m + m * m


@external
def dynamics(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give M (n, n), A (m, n), f (n,), b (m,), power (1,), transport (m,)."""


@external
def geometry(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give M (n, n), A (m, n), residuals (m,), rates (m,), the largest of each (2,).

    The largest against their scales.
    """


@external
def columns(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the columns of a row, from q'' and lambda in p."""


def derivative(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give y' (size,)."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    motion = at(p, int(p[MOTION]))
    solve_motion(t, y, p)
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = motion[i]
    if p[HAS_WORK] > 0.0:
        terms = at(motion, n + 3 * m)
        power = at(terms, n * n + n * m + n + m)
        out[2 * n] = power[0]
        for i in range(m):
            out[2 * n] += power[1 + i] * motion[n + i]


def observe(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the columns of a row."""
    solve_motion(t, y, p)
    columns(t, y, p, out)


def position_step(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the least change (n,) in the metric of M that removes the residuals.

    Then the largest residual against its scale (1,).
    """
    n = int(p[COUNT])
    m = int(p[ROWS])
    terms = at(p, int(p[MOTION]) + n + 3 * m)
    geometry(t, y, p, terms)
    residuals = at(terms, n * n + n * m)
    correction(p, residuals, out)
    out[n] = residuals[2 * m]


def velocity_step(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the same for the velocities and the rates; then HEALTH (1,)."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    terms = at(p, int(p[MOTION]) + n + 3 * m)
    geometry(t, y, p, terms)
    rates = at(terms, n * n + n * m + m)
    correction(p, rates, out)
    out[n] = rates[m + 1]
    out[n + 1] = p[HEALTH]
    p[REFERENCE] = max(p[REFERENCE], p[HEALTH])


def correction(p: Floats, residuals: Floats, out: Floats) -> None:
    """Give -M^-1 A^T S^-1 residuals (n,)."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    terms = at(p, int(p[MOTION]) + n + 3 * m)
    L = at(terms, n * n + n * m + n + 3 * m + 2)
    Y = at(L, n * n)
    u = at(Y, n * m)
    per_row = at(u, 2 * n)
    right = at(per_row, m)
    factor(n, m, p[AUGMENTED] > 0.0, terms, L)
    lengths = at(p, int(p[MOTION]) + n + m)
    spread(n, m, at(terms, n * n), L, lengths, Y, per_row)
    for i in range(m):
        right[i] = -residuals[i] * per_row[i]
    rank = reflect(n, m, p, L, Y, per_row)
    impress(n, m, rank, Y, per_row, u)
    backward(n, L, u, out)


def solve_motion(t: float, y: Floats, p: Floats) -> None:
    """Leave q'' (n,) and lambda (m,) at MOTION."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    motion = at(p, int(p[MOTION]))
    terms = at(motion, n + 3 * m)
    f = at(terms, n * n + n * m)
    b = at(f, n)
    L = at(terms, n * n + n * m + n + 3 * m + 2)
    Y = at(L, n * n)
    u = at(Y, n * m)
    v = at(u, n)
    per_row = at(v, n)
    right = at(per_row, m)
    dynamics(t, y, p, terms)
    factor(n, m, p[AUGMENTED] > 0.0, terms, L)
    if p[AUGMENTED] > 0.0:
        augment_force(n, m, terms)
    for j in range(n):
        v[j] = f[j]
    forward(n, L, v)
    spread(n, m, at(terms, n * n), L, at(motion, n + m), Y, per_row)
    for i in range(m):
        right[i] = b[i] * per_row[i]
        for j in range(n):
            right[i] -= Y[i * n + j] * v[j]
    rank = reflect(n, m, p, L, Y, per_row)
    impress(n, m, rank, Y, per_row, u)
    multipliers(n, m, rank, Y, per_row, at(motion, n))
    for j in range(n):
        u[j] += v[j]
    backward(n, L, u, motion)


def factor(n: int, m: int, augmented: bool, terms: Floats, L: Floats) -> None:
    """Factor M, or M + A^T W A."""
    for i in range(n):
        for j in range(i + 1):
            L[i * n + j] = terms[i * n + j]
    if augmented:
        A = at(terms, n * n)
        for k in range(m):
            row = at(A, k * n)
            weight = row_weight(n, terms, row)
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
    """Give the weight that brings row^T row to the size of M."""
    largest = 0.0
    square = 0.0
    for j in range(n):
        largest = max(largest, abs(M[j * n + j]))
        square += row[j] * row[j]
    if square == 0.0:
        return 0.0
    if largest == 0.0:
        return 1.0 / square
    return largest / square


def augment_force(n: int, m: int, terms: Floats) -> None:
    """Add A^T W b to f."""
    A = at(terms, n * n)
    f = at(A, n * m)
    b = at(f, n)
    for k in range(m):
        row = at(A, k * n)
        weight = row_weight(n, terms, row) * b[k]
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


# per_row holds, m each: scales, right side (w after `impress`), diagonal of R, factors
# of the reflections, original index, spare; then m*m for `multipliers`.
def spread(
    n: int,
    m: int,
    A: Floats,
    L: Floats,
    lengths: Floats,
    Y: Floats,
    per_row: Floats,
) -> None:
    """Make the rows of Y: L^-1 A_i, scaled, and the scales.

    The scale of a row is the largest length (m,) that it has had, so that one that
    vanishes on the way is seen to.
    """
    for i in range(m):
        row = at(Y, i * n)
        for j in range(n):
            row[j] = A[i * n + j]
        forward(n, L, row)
        length = 0.0
        for j in range(n):
            length += row[j] * row[j]
        length = sqrt(length)
        lengths[i] = max(lengths[i], length)
        per_row[i] = 0.0
        if lengths[i] > 0.0:
            per_row[i] = 1.0 / lengths[i]
        for j in range(n):
            row[j] *= per_row[i]


def reflect(n: int, m: int, p: Floats, L: Floats, Y: Floats, per_row: Floats) -> int:
    """Triangularise Y^T by reflections with pivoting; give the rank.

    Leaves the size of the last column that is independent in general as HEALTH. Row k
    of Y then holds R[0:k, k] and the k-th reflection's vector after its first
    component, which is 1.
    """
    diagonal = at(per_row, 2 * m)
    factors = at(per_row, 3 * m)
    aside = at(p, int(p[MOTION]) + n + 2 * m)
    kept = set_aside(n, m, aside, Y, per_row)
    cutoff = max(RANK, PASSING * p[REFERENCE])
    expected = min(n, kept, int(p[EXPECTED]))
    p[HEALTH] = 1.0
    for k in range(expected):
        best = longest_row(n, k, kept, Y)
        longest = sqrt(rest_of_row(n, k, at(Y, best * n)))
        p[HEALTH] = longest
        if longest < cutoff:
            note_weakest(n, m, k, best, p, L, Y, per_row)
            return k
        swap(n, m, k, best, Y, per_row)
        if k == expected - 1:
            note_weakest(n, m, k, k, p, L, Y, per_row)
        row = at(Y, k * n)
        diagonal[k] = -longest
        if row[k] < 0.0:
            diagonal[k] = longest
        head = row[k] - diagonal[k]
        factors[k] = -head / diagonal[k]
        for j in range(k + 1, n):
            row[j] /= head
        for i in range(k + 1, m):
            mirror(n, k, row, factors[k], at(Y, i * n))
    return expected


def note_weakest(
    n: int, m: int, k: int, i: int, p: Floats, L: Floats, Y: Floats, per_row: Floats
) -> None:
    """Note the direction in which the constraints are weakest, if it is the weakest.

    That is what is left of row i after k reflections.
    """
    if p[HEALTH] >= p[LEAST_HEALTH] or p[HEALTH] >= NOTED * p[REFERENCE]:
        return
    p[LEAST_HEALTH] = p[HEALTH]
    z = at(p, int(p[WEAK]))
    mass = at(z, n)
    u = at(mass, n)
    factors = at(per_row, 3 * m)
    for j in range(n):
        u[j] = 0.0
        if j >= k:
            u[j] = Y[i * n + j]
    for back in range(k):
        j = k - 1 - back
        mirror(n, j, at(Y, j * n), factors[j], u)
    for a in range(n):
        mass[a] = 0.0
        for j in range(a + 1):
            mass[a] += L[a * n + j] * u[j]
    backward(n, L, u, z)


def longest_row(n: int, k: int, end: int, Y: Floats) -> int:
    """Give the row among k, ..., end - 1 that is longest from column k on."""
    best = k
    longest = -1.0
    for i in range(k, end):
        length = rest_of_row(n, k, at(Y, i * n))
        if length > longest:
            longest = length
            best = i
    return best


def set_aside(n: int, m: int, aside: Floats, Y: Floats, per_row: Floats) -> int:
    """Put the rows that are marked in `aside` (m,) last; give how many are not."""
    order = at(per_row, 4 * m)
    kept = m
    for back in range(m):
        i = m - 1 - back
        order[i] = i
        if aside[i] > 0.0:
            kept -= 1
    end = m
    for back in range(m):
        i = m - 1 - back
        if aside[i] > 0.0:
            end -= 1
            swap(n, m, i, end, Y, per_row)
    return kept


def rest_of_row(n: int, k: int, row: Floats) -> float:
    """Give the square of the length of a row from column k on."""
    length = 0.0
    for j in range(k, n):
        length += row[j] * row[j]
    return length


def swap(n: int, m: int, k: int, i: int, Y: Floats, per_row: Floats) -> None:
    """Exchange rows k and i of Y, with their scale, right side and index."""
    for j in range(n):
        Y[k * n + j], Y[i * n + j] = Y[i * n + j], Y[k * n + j]
    per_row[k], per_row[i] = per_row[i], per_row[k]
    right = at(per_row, m)
    right[k], right[i] = right[i], right[k]
    order = at(per_row, 4 * m)
    order[k], order[i] = order[i], order[k]


def mirror(n: int, k: int, row: Floats, factor_k: float, x: Floats) -> None:
    """Apply the k-th reflection to x (n,)."""
    product = x[k]
    for j in range(k + 1, n):
        product += row[j] * x[j]
    product *= factor_k
    x[k] -= product
    for j in range(k + 1, n):
        x[j] -= product * row[j]


def impress(n: int, m: int, rank: int, Y: Floats, per_row: Floats, u: Floats) -> None:
    """Give u = Q w (n,) with R^T w = right side: the constraint forces times L^-1."""
    w = at(per_row, m)
    diagonal = at(per_row, 2 * m)
    factors = at(per_row, 3 * m)
    for k in range(rank):
        for j in range(k):
            w[k] -= Y[k * n + j] * w[j]
        w[k] /= diagonal[k]
    for j in range(n):
        u[j] = 0.0
    for k in range(rank):
        u[k] = w[k]
    for i in range(rank):
        k = rank - 1 - i
        mirror(n, k, at(Y, k * n), factors[k], u)


def multipliers(
    n: int, m: int, rank: int, Y: Floats, per_row: Floats, out: Floats
) -> None:
    """Give lambda (m,) of R lambda = w in the original scale and order, of least norm.

    With B = R1^-1 R2 and x = R1^-1 w: lambda = (x - B z, z), (I + B^T B) z = B^T x.
    """
    w = at(per_row, m)
    order = at(per_row, 4 * m)
    x = at(per_row, 5 * m)
    B = at(per_row, 6 * m)
    for k in range(rank):
        x[k] = w[k]
    unscaled_backward(n, m, rank, Y, per_row, x)
    if rank < m:
        shorten(n, m, rank, Y, per_row, x, B, w)
    for c in range(rank, m):
        out[int(order[c])] = w[c - rank]
    for k in range(rank):
        out[int(order[k])] = x[k]


def shorten(
    n: int,
    m: int,
    rank: int,
    Y: Floats,
    per_row: Floats,
    x: Floats,
    B: Floats,
    free: Floats,
) -> None:
    """Give the `free` multipliers z (m - rank,), and x - B z for x, of least norm."""
    spare = m - rank
    normal = at(B, rank * spare)
    for c in range(spare):
        column = at(B, c * rank)
        for k in range(rank):
            column[k] = 0.0
            if per_row[rank + c] > 0.0:
                column[k] = Y[(rank + c) * n + k] / per_row[rank + c]
        unscaled_backward(n, m, rank, Y, per_row, column)
    z = at(x, rank)
    for c in range(spare):
        z[c] = inner(rank, at(B, c * rank), x)
        for d in range(c + 1):
            normal[c * spare + d] = inner(rank, at(B, c * rank), at(B, d * rank))
        normal[c * spare + c] += 1.0
    cholesky(spare, normal)
    forward(spare, normal, z)
    backward(spare, normal, z, free)
    for c in range(spare):
        for k in range(rank):
            x[k] -= B[c * rank + k] * free[c]


def unscaled_backward(
    n: int, m: int, rank: int, Y: Floats, per_row: Floats, x: Floats
) -> None:
    """Replace x (rank,) by the solution of R1 D^-1 x, D the scales."""
    diagonal = at(per_row, 2 * m)
    for i in range(rank):
        k = rank - 1 - i
        for j in range(k + 1, rank):
            x[k] -= Y[j * n + k] * x[j] / per_row[j]
        x[k] *= per_row[k] / diagonal[k]


def inner(length: int, a: Floats, b: Floats) -> float:
    """Give the inner product."""
    value = 0.0
    for i in range(length):
        value += a[i] * b[i]
    return value
