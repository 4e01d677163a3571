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

from typing import TYPE_CHECKING

from lagsim.kkt._cholesky import augment_force, backward, factor, forward
from lagsim.kkt._layout import (
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
from lagsim.kkt._rows import impress, multipliers, reflect, spread
from lagsim.native.kernel_types import at, external

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats


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
    order = at(per_row, 4 * m)
    factor_rows(p, terms)
    for k in range(m):
        right[k] = -residuals[int(order[k])] * per_row[k]
    impress(n, m, int(p[RANKED]), Y, per_row, u)
    backward(n, L, u, out)


def solve_motion(t: float, y: Floats, p: Floats) -> None:
    """Leave q'' (n,) and lambda (m,) at MOTION."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    motion = at(p, int(p[MOTION]))
    terms = at(motion, n + 3 * m)
    f = at(terms, n * n + n * m)
    L = at(terms, n * n + n * m + n + 3 * m + 2)
    Y = at(L, n * n)
    u = at(Y, n * m)
    v = at(u, n)
    per_row = at(v, n)
    dynamics(t, y, p, terms)
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


def factor_rows(p: Floats, terms: Floats) -> None:
    """Factor M and the rows, as far as that has not been done for the whole arc."""
    n = int(p[COUNT])
    m = int(p[ROWS])
    lengths = at(p, int(p[MOTION]) + n + m)
    L = at(terms, n * n + n * m + n + 3 * m + 2)
    Y = at(L, n * n)
    per_row = at(Y, n * m + 2 * n)
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
