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

from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.words import at, external
from lagsim.solve._cholesky import augment_force, backward, factor, forward
from lagsim.solve._rows import impress, keep_lengths, multipliers, reflect, spread

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


# What reflections leave of a vector, in units of the roundoff of its norm.
REFLECTED = 4.0


@external
def dynamics(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give M (n, n), A (m, n), f (n,), b (m,)."""


@external
def quadratures(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the rates of what follows the velocities, from q'' and lambda in p."""


@external
def geometry(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give M (n, n), A (m, n), residuals (m,), rates (m,), the largest of each (2,).

    The largest against their scales.
    """


@external
def bends(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give what Newton steps leave; y holds them in the place of the velocities.

    Of those of the positions (1,) and of the velocities (1,), against the scales of
    the residuals.
    """


@external
def loads(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the rounding of the forces (n,), and of the rates that follow."""


@external
def columns(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the columns of a row, from q'' and lambda in p."""


def derivative(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give y' (size,)."""
    n, motion = p.n, p.motion
    solve_motion(t, y, p)
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = motion[i]
    if p.size > 2 * n:
        quadratures(t, y, p, at(out, 2 * n))


def field(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give y' (size,) and lambda (m,)."""
    derivative(t, y, p, out)
    multipliers = p.multipliers
    for i in range(p.m):
        out[p.size + i] = multipliers[i]


def observe(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the columns of a row, without what pulls the state to the constraints."""
    gain = p.gain
    p.gain = 0.0
    solve_motion(t, y, p)
    columns(t, y, p, out)
    p.gain = gain


def rounding(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give what rounding does to q'' (n,), and that of other rates.

    In units of the unit roundoff: that of the forces, each with its sign, and that of
    the constraint forces. In the metric of M reflections leave it anywhere among the
    coordinates that are joined. out has room for 2 size + 4.
    """
    n, motion, f, b = p.n, p.motion, p.f, p.b
    reaction = at(out, p.size)
    solve_motion(t, y, p)
    gather(p, reaction)
    loads(t, y, p, out)
    for i in range(n):
        f[i] = out[i]
    for i in range(p.m):
        b[i] = 0.0
    solve_terms(p)
    for i in range(n):
        out[i] = abs(motion[i]) + REFLECTED * reaction[i]


def gather(p: Parameters, out: Floats) -> None:
    """Give what constraint forces could do to each coordinate (n,), as accelerations.

    The norm of them all in the metric of diag M, among what is joined by rows or by M.
    Where they cancel, what the addends of their rows could do counts.
    """
    n, M, A, f, b, lam = p.n, p.M, p.A, p.f, p.b, p.multipliers
    label = at(out, n)
    join(n, p.m, p.terms, label)
    for i in range(n):
        out[i] = 0.0
    for k in range(p.m):
        row = at(A, k * n)
        square = 0.0
        asked = abs(b[k])
        first = 0
        for j in range(n):
            if row[j] != 0.0 and M[j * n + j] > 0.0:
                square += row[j] * row[j] / M[j * n + j]
                asked += abs(row[j] * f[j]) / M[j * n + j]
                first = j
        if square > 0.0:
            force = max(lam[k] * lam[k] * square, asked * asked / square)
            out[int(label[first])] += force
    for back in range(n):
        i = n - 1 - back
        square = out[int(label[i])]
        label[i] = 0.0
        if M[i * n + i] > 0.0:
            label[i] = sqrt(square / M[i * n + i])
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


def position_step(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the least change (n,) in the metric of M that removes the residuals.

    Then the largest residual against its scale, 0, and what the change leaves, (3,).
    """
    n, largest = p.n, p.largest
    geometry(t, y, p, p.terms)
    correction(p, p.gaps, out)
    out[n] = largest[0]
    out[n + 1] = 0.0
    out[n + 2] = left_over(0, t, y, p, out)


def velocity_step(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the same for the velocities and the rates, with sigma instead of 0."""
    n, largest = p.n, p.largest
    geometry(t, y, p, p.terms)
    correction(p, p.gap_rates, out)
    out[n] = largest[1]
    out[n + 1] = p.sigma
    out[n + 2] = left_over(1, t, y, p, out)
    keep_lengths(p)
    p.reference = max(p.reference, p.sigma)


def left_over(level: int, t: float, y: Floats, p: Parameters, step: Floats) -> float:
    """Give what a Newton step leaves of the residuals, or of the rates."""
    n, z = p.n, p.tried
    for i in range(n):
        z[i] = y[i]
        z[n + i] = step[i]
    bends(t, z, p, p.left)
    return float(p.left[level])


def correction(p: Parameters, residuals: Floats, out: Floats) -> None:
    """Give -M^-1 A^T S^-1 residuals (n,)."""
    scales, right, order = p.scales, p.w, p.order
    factor_rows(p)
    for k in range(p.m):
        right[k] = -residuals[int(order[k])] * scales[k]
    impress(p, int(p.ranked))
    backward(p.n, p.L, p.u, out)


def solve_motion(t: float, y: Floats, p: Parameters) -> None:
    """Leave q'' (n,) and lambda (m,) as the motion."""
    dynamics(t, y, p, p.terms)
    solve_terms(p)


def solve_terms(p: Parameters) -> None:
    """Do so for the terms that are there."""
    n, motion, f, L, u, v = p.n, p.motion, p.f, p.L, p.u, p.v
    if p.augmented > 0.0:
        augment_force(p)
    factor_rows(p)
    for j in range(n):
        v[j] = f[j]
    forward(n, L, v)
    for j in range(n):
        u[j] = v[j]
    backward(n, L, u, motion)
    right_side(p)
    rank = int(p.ranked)
    impress(p, rank)
    multipliers(p, rank)
    for j in range(n):
        u[j] += v[j]
    backward(n, L, u, motion)


def factor_rows(p: Parameters) -> None:
    """Factor M and the rows, as far as that has not been done for the whole arc."""
    if p.factored < 1.0:
        factor(p)
    if p.factored < 2.0:
        spread(p)
        p.ranked = reflect(p)
    p.factored = p.constant


def right_side(p: Parameters) -> None:
    """Leave b - A M^-1 f in the order and scale of the rows; the motion is M^-1 f."""
    n, A, b, free, scales, right = p.n, p.A, p.b, p.motion, p.scales, p.w
    order = p.order
    for k in range(p.m):
        i = int(order[k])
        right[k] = b[i]
        for j in range(n):
            right[k] -= A[i * n + j] * free[j]
        right[k] *= scales[k]
