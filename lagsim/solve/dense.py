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

from lagsim.native.kernels.words import at, external
from lagsim.solve._cholesky import augment_force, backward, factor, forward
from lagsim.solve._layout import (
    AUGMENTED,
    CONSTANT,
    COUNT,
    FACTORED,
    GAIN,
    HEALTH,
    MOTION,
    QUADRATURES,
    RANKED,
    REFERENCE,
    ROWS,
)
from lagsim.solve._rows import impress, keep_lengths, multipliers, reflect, spread

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


# What reflections leave of a vector, in units of the roundoff of its norm.
REFLECTED = 4.0


@external
def dynamics(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give M (n, n), A (m, n), f (n,), b (m,)."""


@external
def quadratures(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the rates of what follows the velocities, from q'' and lambda in p."""


@external
def geometry(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give M (n, n), A (m, n), residuals (m,), rates (m,), the largest of each (2,).

    The largest against their scales.
    """


@external
def bends(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give what Newton steps leave; y holds them in the place of the velocities.

    Of those of the positions (1,) and of the velocities (1,), against the scales of
    the residuals.
    """


@external
def loads(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the rounding of the forces (n,), and of the rates that follow."""


@external
def columns(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the columns of a row, from q'' and lambda in p."""


def derivative(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give y' (size,)."""
    n = int(p[COUNT])
    motion = at(p, int(p[MOTION]))
    solve_motion(t, y, p)
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = motion[i]
    if p[QUADRATURES] > 0.0:
        quadratures(t, y, p, at(out, 2 * n))


def field(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give y' (size,) and lambda (m,)."""
    n = int(p[COUNT])
    size = 2 * n + int(p[QUADRATURES])
    derivative(t, y, p, out)
    motion = at(p, int(p[MOTION]))
    for i in range(int(p[ROWS])):
        out[size + i] = motion[n + i]


def observe(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the columns of a row, without what pulls the state to the constraints."""
    gain = p[GAIN]
    p[GAIN] = 0.0
    solve_motion(t, y, p)
    columns(t, y, p, out)
    p[GAIN] = gain


def rounding(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give what rounding does to q'' (n,), and that of other rates.

    In units of the unit roundoff: that of the forces, each with its sign, and that of
    the constraint forces. In the metric of M reflections leave it anywhere among the
    coordinates that are joined. out has room for 2 size + 4.
    """
    n = int(p[COUNT])
    m = int(p[ROWS])
    motion = at(p, int(p[MOTION]))
    terms = at(motion, n + 3 * m)
    f = at(terms, n * n + n * m)
    reaction = at(out, 2 * n + int(p[QUADRATURES]))
    solve_motion(t, y, p)
    gather(n, m, terms, at(motion, n), reaction)
    loads(t, y, p, out)
    for i in range(n):
        f[i] = out[i]
    for i in range(m):
        f[n + i] = 0.0
    solve_terms(p)
    for i in range(n):
        out[i] = abs(motion[i]) + REFLECTED * reaction[i]


def gather(n: int, m: int, terms: Floats, lam: Floats, out: Floats) -> None:
    """Give what constraint forces could do to each coordinate (n,), as accelerations.

    The norm of them all in the metric of diag M, among what is joined by rows or by M.
    Where they cancel, what the addends of their rows could do counts.
    """
    A = at(terms, n * n)
    f = at(A, n * m)
    label = at(out, n)
    join(n, m, terms, label)
    for i in range(n):
        out[i] = 0.0
    for k in range(m):
        row = at(A, k * n)
        square = 0.0
        asked = abs(f[n + k])
        first = 0
        for j in range(n):
            if row[j] != 0.0 and terms[j * n + j] > 0.0:
                square += row[j] * row[j] / terms[j * n + j]
                asked += abs(row[j] * f[j]) / terms[j * n + j]
                first = j
        if square > 0.0:
            force = max(lam[k] * lam[k] * square, asked * asked / square)
            out[int(label[first])] += force
    for back in range(n):
        i = n - 1 - back
        square = out[int(label[i])]
        label[i] = 0.0
        if terms[i * n + i] > 0.0:
            label[i] = sqrt(square / terms[i * n + i])
    for i in range(n):
        out[i] = label[i]


def join(n: int, m: int, terms: Floats, label: Floats) -> None:
    """Give each coordinate the first one that rows, or M, join it with: (n,)."""
    for i in range(n):
        label[i] = i
    for _ in range(n):
        changed = 0.0
        for k in range(n + m):
            # The rows of M, then those of A.
            row = at(terms, k * n)
            least = 1.0 * n
            for j in range(n):
                if row[j] != 0.0:
                    least = min(least, label[j])
            for j in range(n):
                if row[j] != 0.0 and label[j] > least:
                    label[j] = least
                    changed = 1.0
        if changed == 0.0:
            return


def position_step(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the least change (n,) in the metric of M that removes the residuals.

    Then the largest residual against its scale, 0, and what the change leaves, (3,).
    """
    n = int(p[COUNT])
    m = int(p[ROWS])
    terms = at(p, int(p[MOTION]) + n + 3 * m)
    geometry(t, y, p, terms)
    residuals = at(terms, n * n + n * m)
    correction(p, residuals, out)
    out[n] = residuals[2 * m]
    out[n + 1] = 0.0
    out[n + 2] = left_over(0, t, y, p, out)


def velocity_step(t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the same for the velocities and the rates, with HEALTH instead of 0."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    terms = at(p, int(p[MOTION]) + n + 3 * m)
    geometry(t, y, p, terms)
    rates = at(terms, n * n + n * m + m)
    correction(p, rates, out)
    out[n] = rates[m + 1]
    out[n + 1] = p[HEALTH]
    out[n + 2] = left_over(1, t, y, p, out)
    lengths = at(p, int(p[MOTION]) + n + m)
    keep_lengths(m, at(terms, per_row_at(n, m)), lengths)
    p[REFERENCE] = max(p[REFERENCE], p[HEALTH])


def left_over(level: int, t: float, y: Floats, p: Floats, step: Floats) -> float:
    """Give what a Newton step leaves of the residuals, or of the rates."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    # Where `correction` is done with M and A.
    found = at(p, int(p[MOTION]) + n + 3 * m)
    z = at(found, 2)
    for i in range(n):
        z[i] = y[i]
        z[n + i] = step[i]
    bends(t, z, p, found)
    return float(found[level])


def correction(p: Floats, residuals: Floats, out: Floats) -> None:
    """Give -M^-1 A^T S^-1 residuals (n,)."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    terms = at(p, int(p[MOTION]) + n + 3 * m)
    L = at(terms, n * n + n * m + n + 3 * m + 2)
    Y = at(L, n * n)
    u = at(Y, n * m + n)
    per_row = at(u, 2 * n)
    right = at(per_row, m)
    order = at(per_row, 4 * m)
    factor_rows(p, terms)
    for k in range(m):
        right[k] = -residuals[int(order[k])] * per_row[k]
    impress(n, m, int(p[RANKED]), Y, per_row, u)
    backward(n, L, u, out)


def solve_motion(t: float, y: Floats, p: Floats) -> None:
    """Leave q'' (n,) and lambda (m,) at MOTION."""
    dynamics(t, y, p, at(p, int(p[MOTION]) + int(p[COUNT]) + 3 * int(p[ROWS])))
    solve_terms(p)


def solve_terms(p: Floats) -> None:
    """Do so for the terms that are there."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    motion = at(p, int(p[MOTION]))
    terms = at(motion, n + 3 * m)
    f = at(terms, n * n + n * m)
    L = at(terms, n * n + n * m + n + 3 * m + 2)
    Y = at(L, n * n)
    u = at(Y, n * m + n)
    v = at(u, n)
    per_row = at(v, n)
    if p[AUGMENTED] > 0.0:
        augment_force(n, m, terms)
    factor_rows(p, terms)
    for j in range(n):
        v[j] = f[j]
    forward(n, L, v)
    for j in range(n):
        u[j] = v[j]
    backward(n, L, u, motion)
    right_side(n, m, terms, motion, per_row)
    rank = int(p[RANKED])
    impress(n, m, rank, Y, per_row, u)
    multipliers(n, m, rank, Y, per_row, at(motion, n))
    for j in range(n):
        u[j] += v[j]
    backward(n, L, u, motion)


def per_row_at(n: int, m: int) -> int:
    """Give where `per_row` is, from the terms on."""
    return n * n + n * m + n + 3 * m + 2 + n * n + n * m + 3 * n


def factor_rows(p: Floats, terms: Floats) -> None:
    """Factor M and the rows, as far as that has not been done for the whole arc."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    lengths = at(p, int(p[MOTION]) + n + m)
    L = at(terms, n * n + n * m + n + 3 * m + 2)
    Y = at(L, n * n)
    per_row = at(Y, n * m + 3 * n)
    if p[FACTORED] < 1.0:
        factor(n, m, p[AUGMENTED] > 0.0, terms, L)
    if p[FACTORED] < 2.0:
        spread(n, m, at(terms, n * n), L, lengths, Y, per_row)
        p[RANKED] = reflect(n, m, p, L, Y, per_row)
    p[FACTORED] = p[CONSTANT]


def right_side(n: int, m: int, terms: Floats, free: Floats, per_row: Floats) -> None:
    """Give b - A M^-1 f in the order and scale of the rows; free = M^-1 f : (n,)."""
    A = at(terms, n * n)
    b = at(terms, n * n + n * m + n)
    right = at(per_row, m)
    order = at(per_row, 4 * m)
    for k in range(m):
        i = int(order[k])
        right[k] = b[i]
        for j in range(n):
            right[k] -= A[i * n + j] * free[j]
        right[k] *= per_row[k]
