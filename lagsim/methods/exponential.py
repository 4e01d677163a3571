"""Exponential: the exact motion of a linear model that does not change in time.

y' = J y + c is solved by one matrix exponential for each length of step, computed at
the start. A step is then one product with a matrix, exact to rounding for any length
and any frequency. Work, the integral of a quadratic form, is one more product. Both are
products with the motion since the start of the arc, so that rounding is relative to the
motion and not to the distance from the origin. The steps are those of the rows unless
`step` is given. There is no limit of stability.

Sources: C. Moler and C. Van Loan, SIAM Review 45 (2003), methods 1 and 3; B. N. Parlett
and C. Reinsch, Numer. Math. 13 (1969) (balancing); N. J. Higham, SIAM J. Matrix Anal.
Appl. 26 (2005) (scaling and squaring); C. Van Loan, IEEE Transactions on Automatic
Control 23 (1978) (integrals of quadratic forms).
"""

from __future__ import annotations

import cmath
import math

from lagsim.language.arrays import Floats
from lagsim.methods import Structure
from lagsim.methods.parts.constraints import is_finite, project_step
from lagsim.methods.parts.control import record_sizes
from lagsim.methods.parts.fixed import Fixed, step
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, NOT_FINITE, PROJECTION_FAILED, linear
from lagsim.native.kernels.words import unrolled
from lagsim.native.layout import after, array, part
from lagsim.tolerances import OVERFLOW, SAME_STEP, UNCOUPLED

__all__ = ["step"]

NAME = "exponential"
TITLE = "matrix exponential"
ORDER = math.inf
DENSE_ORDER = math.inf
ADAPTIVE = False
IMAGINARY_LIMIT = math.inf
HANDLES = "linear models that do not change in time; exact"

NEEDS = ("linear",)
STATES = True

CONSTRAINED = True

# Of the matrix that is exponentiated by its series; what is larger is halved before
# and squared after.
SMALL = 0.5
# The terms left out: 0.5^15/15! = 2e-17, and 1/21! = 2e-20 for quadratic forms.
TERMS = 14
FORM_TERMS = 20
SWEEPS = 64
# Gauss-Legendre on [0, 1], 8 points (Abramowitz and Stegun, table 25.4). A quadratic
# form of what moves by less than SMALL is off by 1e-17.
NODES = (
    0.01985507175123188, 0.10166676129318664, 0.2372337950418355, 0.4082826787521751,
    0.5917173212478249, 0.7627662049581645, 0.8983332387068134, 0.9801449282487681,
)  # fmt: skip
WEIGHTS = (
    0.05061426814518813, 0.11119051722668723, 0.15685332293894363, 0.18134189168918100,
    0.18134189168918100, 0.15685332293894363, 0.11119051722668723, 0.05061426814518813,
)  # fmt: skip


def refusal(scene: Structure) -> str:
    """Return the reason for refusal, not linear or not autonomous, or ""."""
    if not scene.linear:
        return (
            "its equations of motion are not linear; `dop853` handles any, "
            "`taylor` smooth ones"
        )
    if not scene.autonomous:
        return "its equations of motion depend on time; `dop853` handles that"
    return ""


def amplification(z: complex) -> float:
    """Return |exp(z)|."""
    return abs(cmath.exp(z))


def width(s: Exponential) -> int:
    """Return the number of components of z = (q, q', 1), from the origin of the arc."""
    return s.dynamic.stop + 1


def square(s: Exponential) -> int:
    """Return the number of entries of a matrix for z."""
    return width(s) ** 2


def works(s: Exponential) -> int:
    """Return the number of works."""
    return s.size - s.dynamic.stop


def squares(s: Exponential) -> int:
    """Return the number of entries of the matrices for all works."""
    return works(s) * square(s)


class Exponential(Fixed):
    """Memory of the matrices, for z = (q, q', 1) with q and q' from `origin`."""

    # Rows need no slopes.
    before: Floats = array(lambda _: 0)
    k: Floats = array(lambda _: 0)
    slope: Floats = array(lambda _: 0)
    made_for: float  # the step
    norm: float  # of A
    A: Floats = array(square)  # both balanced: A ...
    forms: Floats = array(squares)  # ... and the forms P of the powers
    # What `linear` gives; then, for a step, exp - 1 by columns, and two to work with.
    given: Floats = array(lambda s: (1 + works(s)) * (1 + 3 * square(s)))
    F: Floats = part("given", square)
    x: Floats = after("F", square)
    second: Floats = after("x", square)
    Q: Floats = array(squares)  # the forms of the works over a step
    d: Floats = array(width)  # the scales
    origin: Floats = array(width)  # the state at the start of the arc, and 0
    z: Floats = array(width)  # at the start of the step
    moved: Floats = array(width)
    terms: Floats = array(lambda s: (TERMS + 1) * width(s))


STATE = Exponential


def start(s: Exponential, p: Parameters) -> None:
    """Begin an arc: compute the matrices for its steps."""
    m = width(s)
    linear(s.t, s.y, p, s.given)
    s.A[:] = 0.0
    s.forms[:] = 0.0
    s.origin[: m - 1] = s.y[: m - 1]
    s.origin[m - 1] = 0.0
    count = fill(m, s.given, s.A)
    move_columns(m, s.A, s.origin)
    balance(m, s.A, s.d)
    for k in range(works(s)):
        form = s.forms[k * m * m :]
        count += fill(m, s.given[count:], form)
        move_columns(m, form, s.origin)
        move_rows(m, form, s.origin)
        for i in range(m):
            row = form[i * m :]
            row[:m] = row[:m] * s.d[i] * s.d
    s.norm = norm(m, m, s.A)
    make_matrices(s, s.fixed_step)
    s.evaluations += 1.0
    s.step_h = 0.0
    record_sizes(s, p)


def fill(m: int, given: Floats, matrix: Floats) -> int:
    """Set the entries of a sparse matrix; return the number of values read.

    given : the number of entries, then i, j and value of each.
    """
    count = int(given[0])
    for k in range(count):
        i = int(given[1 + 3 * k])
        j = int(given[2 + 3 * k])
        matrix[i * m + j] = given[3 + 3 * k]
    return 1 + 3 * count


def move_columns(m: int, matrix: Floats, origin: Floats) -> None:
    """Add matrix @ origin to the last column, which multiplies 1."""
    for i in range(m):
        for j in range(m - 1):
            matrix[i * m + m - 1] += matrix[i * m + j] * origin[j]


def move_rows(m: int, matrix: Floats, origin: Floats) -> None:
    """Add origin @ matrix to the last row."""
    for i in range(m - 1):
        for j in range(m):
            matrix[(m - 1) * m + j] += origin[i] * matrix[i * m + j]


def make_matrices(s: Exponential, h: float) -> None:
    """Compute the matrices for steps of length h.

    F = exp(A h) - 1 by its series at h / 2^k, then F <- 2 F + F^2, k times: without the
    1, the error is relative to the motion in a step, not to the state. The work over a
    step is z^T Q z, with Q the integral of exp(A^T x) P exp(A x) over the step; over
    twice the step Q <- Q + exp(A^T h) Q exp(A h).
    """
    m = width(s)
    entries = m * m
    F, Q, x, d = s.F, s.Q, s.x, s.d
    s.made_for = h
    tau = h
    doublings = 0
    while s.norm * tau > SMALL and doublings < 1000:
        tau = 0.5 * tau
        doublings += 1
    count = works(s)
    for k in range(count):
        begin_form(m, tau, s.A, s.forms[k * entries :], Q[k * entries :], x, s.second)
    # A tau (1 + A tau/2 (1 + A tau/3 (...))).
    s.F[:] = 0.0
    for back in range(TERMS):
        multiply(m, s.A, F, x)
        s.F[:] = tau / (TERMS - back) * (s.A + x)
    for _doubling in range(doublings):
        for k in range(count):
            double_form(m, F, Q[k * entries :], x, s.second)
        multiply(m, F, F, x)
        s.F[:] = 2.0 * F + x
    for i in range(m):
        for j in range(m):
            x[j * m + i] = F[i * m + j] * d[i] / d[j]
            for k in range(count):
                Q[k * entries + i * m + j] /= d[i] * d[j]
    s.F[:] = x


def make(s: Exponential, p: Parameters, after: float, h: float) -> int:
    """Compute one step, see `fixed.make`."""
    m = width(s)
    y, z, moved, new = s.y, s.z, s.moved, s.new
    if abs(h - s.made_for) > SAME_STEP * s.made_for:
        make_matrices(s, h)
    z[: m - 1] = y[: m - 1] - s.origin[: m - 1]
    z[m - 1] = 1.0
    times_columns(m, s.F, z, moved)
    new[: m - 1] = moved[: m - 1] + y[: m - 1]
    if not is_finite(m - 1, new):
        return NOT_FINITE
    if CONSTRAINED and project_step(s, p, after, h, new) == 0:
        return PROJECTION_FAILED
    done = new[s.quadratures]
    new[s.quadratures] = y[s.quadratures]
    for k in range(works(s)):
        times_columns(m, s.Q[k * m * m :], z, moved)
        for i in range(m):
            done[k] += z[i] * moved[i]
    s.evaluations += 1.0
    return DONE


def interpolate(s: Exponential, p: Parameters, x: float, out: Floats) -> None:  # noqa: ARG001
    """Write the state (size,) at the fraction x of the last step, by the series.

    In short parts: N. J. Higham and A. H. Al-Mohy, SIAM J. Sci. Comput. 33 (2011).
    """
    m = width(s)
    count = works(s)
    terms, found = s.terms, out[s.quadratures]
    out[s.quadratures] = s.old[s.quadratures]
    length = x * s.step_h
    parts = int(s.norm * length / SMALL) + 1
    terms[:m] = s.z / s.d
    for _part in range(parts):
        make_terms(m, length / parts, s.A, terms)
        if count > 0:
            for node in unrolled(8):
                sum_terms(m, TERMS, NODES[node], terms, s.moved)
                for k in range(count):
                    power = value_of(m, s.forms[k * m * m :], s.moved)
                    found[k] += length / parts * WEIGHTS[node] * power
        sum_terms(m, TERMS, 1.0, terms, terms)
    out[: m - 1] = terms[: m - 1] * s.d[: m - 1] + s.origin[: m - 1]


def make_terms(m: int, tau: float, a: Floats, terms: Floats) -> None:
    """Write the terms z_k = (A tau)^k z_0 / k!."""
    for k in range(1, TERMS + 1):
        before = terms[(k - 1) * m :]
        for i in range(m):
            value = 0.0
            for j in range(m):
                if a[i * m + j] != 0.0:
                    value += a[i * m + j] * before[j]
            terms[k * m + i] = tau / k * value


def sum_terms(m: int, order: int, x: float, terms: Floats, out: Floats) -> None:
    """Compute the sum of z_k x^k."""
    for i in range(m):
        value = terms[order * m + i]
        for back in range(1, order + 1):
            value = value * x + terms[(order - back) * m + i]
        out[i] = value


def value_of(m: int, form: Floats, z: Floats) -> float:
    """Return z^T P z."""
    value = 0.0
    for i in range(m):
        for j in range(m):
            if form[i * m + j] != 0.0:
                value += form[i * m + j] * z[i] * z[j]
    return value


# Matrices (m, m) row by row, unless it is said otherwise.


def norm(m: int, columns: int, a: Floats) -> float:
    """Return the largest sum of absolute values in the first `columns` columns."""
    largest = 0.0
    for j in range(columns):
        column = 0.0
        for i in range(m):
            column += abs(a[i * m + j])
        largest = max(largest, column)
    return largest


def balance(m: int, a: Floats, d: Floats) -> None:
    """Replace A by D^-1 A D with rows and columns of similar size, D powers of two.

    B. N. Parlett and C. Reinsch, Numer. Math. 13 (1969). The number of squarings is
    then independent of units. The last row is zero, so the last scale is free.
    """
    d[:m] = 1.0
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
    """Scale components that are coupled in one direction alone below the others.

    As the coordinate and the rate of a body in free fall: their scales are free, and
    the rates of the motion are those of the other components. Parlett and Reinsch
    permute such components out.
    """
    largest = coupled_norm(m, a)
    largest = max(largest, UNCOUPLED * norm(m, m - 1, a))
    for i in range(m - 1):
        row = off_diagonal(m, a, i, m, 1)
        column = off_diagonal(m, a, i, 1, m)
        factor = 1.0
        if column == 0.0 and row < OVERFLOW:
            while row > largest * factor:
                factor = 2.0 * factor
        elif row == 0.0 and column < OVERFLOW:
            while column * factor > largest:
                factor = 0.5 * factor
        if factor != 1.0:
            rescale(m, a, d, i, factor)


def coupled_norm(m: int, a: Floats) -> float:
    """Return the norm of the components that are coupled in both directions."""
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
    """Return the absolute sum of row i (m, 1) or column i (1, m), off diagonal."""
    total = 0.0
    for j in range(m - 1):
        if j != i:
            total += abs(a[i * by_row + j * by_column])
    return total


def balancing(m: int, a: Floats, i: int) -> float:
    """Return the power of two that multiplies column i and divides row i."""
    column = off_diagonal(m, a, i, 1, m)
    row = off_diagonal(m, a, i, m, 1)
    if column == 0.0 or row == 0.0 or not column + row < OVERFLOW:
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
    """Multiply column i by a power of two, divide row i by it, and update d."""
    d[i] = d[i] * factor
    a[i * m : (i + 1) * m] = a[i * m : (i + 1) * m] / factor
    for j in range(m):
        a[j * m + i] = a[j * m + i] * factor


def begin_form(
    m: int, tau: float, a: Floats, form: Floats, Q: Floats, x: Floats, y: Floats
) -> None:
    """Set Q to the sum of tau^(k + 1)/(k + 1)! L^k(P), L(X) = X A + A^T X."""
    y[: m * m] = tau * form[: m * m]
    Q[: m * m] = y[: m * m]
    for k in range(FORM_TERMS):
        multiply(m, y, a, x)
        part = tau / (k + 2)
        for i in range(m):
            for j in range(m):
                y[i * m + j] = part * (x[i * m + j] + x[j * m + i])
        Q[: m * m] += y[: m * m]


def double_form(m: int, F: Floats, Q: Floats, x: Floats, y: Floats) -> None:
    """Replace Q by Q + (1 + F)^T Q (1 + F)."""
    multiply(m, Q, F, x)
    y[: m * m] = 0.0
    for k in range(m):
        for i in range(m):
            factor = F[k * m + i]
            if factor != 0.0:
                y[i * m : (i + 1) * m] += factor * x[k * m : (k + 1) * m]
    for i in range(m):
        for j in range(m):
            y[i * m + j] += x[i * m + j] + x[j * m + i]
    Q[: m * m] = 2.0 * Q[: m * m] + y[: m * m]


def multiply(m: int, a: Floats, b: Floats, out: Floats) -> None:
    """Compute the product of two matrices (m, m)."""
    for i in range(m):
        row = out[i * m :]
        row[:m] = 0.0
        for k in range(m):
            factor = a[i * m + k]
            if factor != 0.0:
                row[:m] += factor * b[k * m : (k + 1) * m]


def times_columns(m: int, a: Floats, z: Floats, out: Floats) -> None:
    """Compute the product of a vector and a matrix that is stored by columns."""
    out[:m] = 0.0
    for j in range(m):
        column = a[j * m :]
        factor = z[j]
        out[:m] += factor * column[:m]
