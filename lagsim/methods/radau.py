"""Radau IIA of order 5: implicit, for stiff scenes.

Very stiff springs and dampers do not bound its step: what is fast and has died out is
passed over. It damps such motion itself (L-stable): a fast oscillation that is excited
and smaller than the tolerance disappears, so energy is lost. Simplified Newton
iterations with the exact Jacobian, Gustafsson's predictive step control, an error
estimate of order 3 with the tolerance adapted to it, dense output of order 4 from the
stages' slopes. On stiff parts of the motion the order falls to 3. Stable on the whole
imaginary axis and in the left half-plane: no limit on step * frequency.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
sections IV.5, IV.8 and IV.15; K. Gustafsson, ACM Trans. Math. Software 20 (1994).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import TYPE_CHECKING

from lagsim.methods._adaptive import settle, usable_step
from lagsim.methods._controller import (
    LOCAL,
    first_step,
    record_sizes,
    set_tolerances,
)
from lagsim.methods._interface import LEAST_HEALTH, derivative, jacobian
from lagsim.methods._linearised import (
    decompose_pair,
    decompose_real,
    solve_pair,
    solve_real,
)
from lagsim.methods._radau_tableau import (
    A_INVERSE,
    ALPHA,
    BETA,
    DENSE,
    ERROR,
    GAMMA,
    T_INVERSE,
    A,
    B,
    C,
)
from lagsim.methods._radau_tableau import T as TRANSFORM
from lagsim.methods._singular import forget_weak_direction, leave_loss
from lagsim.methods._state import (
    CLOSE_BELOW,
    DONE,
    EVALUATIONS,
    FACTORISATIONS,
    HEADER,
    NEWTON_FAILED,
    NOT_FINITE,
    PROJECTION_FAILED,
    REJECTIONS,
    RTOL,
    SIZE,
    STEP_H,
    STEP_T,
    STEP_TOO_SMALL,
    STEPS,
    H,
    N,
    T,
)
from lagsim.methods._tableau import Tableau
from lagsim.native.kernel_types import at, total, unrolled

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats
    from lagsim.structure import Structure

NAME = "radau"
TITLE = "Radau IIA"
ORDER = 5
DENSE_ORDER = 4
ADAPTIVE = True
IMAGINARY_LIMIT = inf
HANDLES = "any model, stiff ones too; equality constraints by projection"
TABLEAU = Tableau(A, B, C, ORDER)

NEEDS = ("jacobian",)

CONSTRAINED = True

# The names and values of RADAU5 (IV.8): iterations, safety, bounds of the step's
# change, the rate of convergence below which the Jacobian is kept, and the growth of
# the step that is not worth a factorisation.
MOST = 10
SAFETY = 0.9
SHRINK = 8.0
GROW = 5.0
KEEP_BELOW = 1e-3
NOT_WORTH = 1.2
# What Newton's method may leave, in parts of the tolerance; not below rounding.
LEFT = 0.03
ROUNDING = 10.0 * 2.0**-52

# The method's own words.
RATE = 0  # of convergence, in the last step
LEFT_OVER = 1  # RATE/(1 - RATE), carried from step to step
PREVIOUS_H = 2  # of the last step; 0 at the start of an arc
PREVIOUS_ERROR = 3
FACTORED_H = 4  # the step that the factors belong to; 0: none
JACOBIAN = 5  # 0: to be evaluated; 1: of an earlier state; 2: of this one
ITERATIONS = 6
OWN = 7


def refusal(_scene: Structure) -> str:
    """Give "": it handles everything."""
    return ""


def amplification(z: complex) -> float:
    """Give the size of the stability function at z = h * eigenvalue."""
    return TABLEAU.amplification(z)


def state_size(size: int) -> int:
    """Give the length of the array of state for `size` components."""
    n = size // 2
    return HEADER + 6 * size + 6 + OWN + 19 * size + matrices(n)


def matrices(n: int) -> int:
    """Give the length of the Jacobian, both factorisations and room for a solution."""
    return (n + 1) * 2 * n + n * n + n + 4 * n * n + 2 * n + 2 * n


# The method's own arrays, after its words: y' at the start (size), the same as the
# collocation polynomial before has it (size), z (size), new (size), error (size),
# dense: y and four coefficients (5 size), Z (3 size), W (3 size), F (3 size); then the
# Jacobian (n + 1, 2 n), real factors and pivots, complex ones, and x (2 n).
SLOPE = OWN
LAST_SLOPE = 1
STAGE = 2
NEW = 3
ERRORS = 4
POLYNOMIAL = 5
INCREMENTS = 10
TRANSFORMED = 13
RIGHT = 16
MATRICES = 19


def start(s: Floats, p: Floats) -> None:
    """Begin an arc: evaluate at its start, choose the first step."""
    size = int(s[SIZE])
    own = at(s, HEADER + 6 * size + 6)
    slope = at(own, OWN)
    last = at(own, OWN + LAST_SLOPE * size)
    derivative(s[T], at(s, HEADER), p, slope)
    s[EVALUATIONS] += 1.0
    for i in range(size):
        last[i] = slope[i]
    for k in range(OWN):
        own[k] = 0.0
    own[LEFT_OVER] = 1.0
    s[STEP_H] = 0.0
    record_sizes(s, p)
    s[H] = first_step(s, p, 4, slope)
    if CONSTRAINED:
        s[H] = leave_loss(s, p, s[H])


def step(s: Floats, p: Floats) -> int:
    """Make one accepted step, or give a code other than 0."""
    size = int(s[SIZE])
    own = at(s, HEADER + 6 * size + 6)
    new = at(own, OWN + NEW * size)
    rejected = False
    trouble = STEP_TOO_SMALL
    while True:
        h = usable_step(s)
        if h == 0.0:
            return trouble
        error = attempt(s, p, h)
        if not error < 1e300:
            s[H] = 0.1 * h
            trouble = NOT_FINITE
        elif error < 0.0:
            trouble = NEWTON_FAILED
        elif error >= 1.0:
            s[H] = 0.1 * h
            if own[PREVIOUS_H] > 0.0:
                s[H] = h / change(s, error)
            trouble = STEP_TOO_SMALL
        elif CONSTRAINED and settle(s, p, h, new) == 0:
            s[H] = 0.25 * h
            trouble = PROJECTION_FAILED
        else:
            break
        rejected = True
        s[REJECTIONS] += 1.0
        if own[JACOBIAN] < 2.0:
            own[JACOBIAN] = 0.0
    quotient = predict(s, h, error)
    accept(s, p, h)
    s[H] = h / quotient
    if rejected:
        s[H] = min(s[H], h)
    own[JACOBIAN] = 0.0
    if own[RATE] <= KEEP_BELOW:
        own[JACOBIAN] = 1.0
        if h <= s[H] and s[H] <= NOT_WORTH * h:
            s[H] = h
    return DONE


def change(s: Floats, error: float) -> float:
    """Give by how much the step should shrink: IV.8 (8.21), less after long Newton."""
    own = at(s, HEADER + 6 * int(s[SIZE]) + 6)
    safety = SAFETY * (2.0 * MOST + 1.0) / (2.0 * MOST + own[ITERATIONS])
    return max(1.0 / GROW, min(SHRINK, error**0.25 / safety))


def predict(s: Floats, h: float, error: float) -> float:
    """Give the same after an accepted step, with the last one: IV.8 (8.25)."""
    own = at(s, HEADER + 6 * int(s[SIZE]) + 6)
    quotient = change(s, error)
    if own[PREVIOUS_H] > 0.0:
        ahead = (error * error / own[PREVIOUS_ERROR]) ** 0.25 / SAFETY
        ahead *= own[PREVIOUS_H] / h
        quotient = max(quotient, max(1.0 / GROW, min(SHRINK, ahead)))
    own[PREVIOUS_ERROR] = max(0.01, error)
    return quotient


def attempt(s: Floats, p: Floats, h: float) -> float:
    """Make a step and give its error in units of the tolerance.

    Negative where Newton's method did not converge; s[H] is then the step to try next.
    """
    size = int(s[SIZE])
    y = at(s, HEADER)
    own = at(s, HEADER + 6 * size + 6)
    new = at(own, OWN + NEW * size)
    Z = at(own, OWN + INCREMENTS * size)
    if CONSTRAINED:
        p[LEAST_HEALTH] = 1.0
    set_tolerances(s, p, s[T], y, at(own, OWN), h)
    s[H] = 0.5 * h
    if renew(s, p, h) == 0:
        return -1.0
    if converge(s, p, h) == 0:
        return -1.0
    for i in range(size):
        new[i] = y[i] + Z[2 * size + i]
    set_tolerances(s, p, s[T] + h, new, at(own, OWN), h)
    return estimate(s, p, h)


def renew(s: Floats, p: Floats, h: float) -> int:
    """Evaluate the Jacobian and factor, as far as that is due; give 0 where singular."""
    size = int(s[SIZE])
    n = int(s[N])
    own = at(s, HEADER + 6 * size + 6)
    J = at(own, OWN + MATRICES * size)
    K = at(J, (n + 1) * 2 * n)
    pair = at(K, n * n + n)
    if own[JACOBIAN] == 0.0:
        jacobian(s[T], at(s, HEADER), p, J)
        s[FACTORISATIONS] += 1.0
        own[JACOBIAN] = 2.0
        own[FACTORED_H] = 0.0
    # The last bits of h do not matter to the iteration.
    if abs(h - own[FACTORED_H]) <= 1e-9 * h:
        return 1
    own[FACTORED_H] = h
    s[FACTORISATIONS] += 2.0
    done = decompose_real(n, GAMMA / h, J, K, at(K, n * n))
    if done > 0:
        pivots = at(pair, 4 * n * n)
        done = decompose_pair(n, ALPHA / h, BETA / h, J, pair, pivots)
    if done == 0:
        own[FACTORED_H] = 0.0
    return done


def converge(s: Floats, p: Floats, h: float) -> int:
    """Solve for the stages by simplified Newton iterations; give 0 where that fails.

    Section IV.8, (8.13); the rate of convergence says what is left, and what will be.
    """
    own = at(s, HEADER + 6 * int(s[SIZE]) + 6)
    limit = max(LEFT, ROUNDING / (LOCAL * s[RTOL]))
    guess(s, h)
    left_over = max(own[LEFT_OVER], 2.0**-52) ** 0.8
    previous = 0.0
    rate = 0.0
    for iteration in range(MOST):
        size = newton_step(s, p, h)
        if not size < 1e300:
            return 0
        if iteration > 0:
            latest = size / previous
            if iteration == 1:
                rate = latest
            else:
                rate = sqrt(rate * latest)
            if rate >= 0.99:
                return 0
            left_over = rate / (1.0 - rate)
            ahead = MOST - 2 - iteration
            coming = left_over * size * rate**ahead / limit
            if coming >= 1.0 and left_over * size > limit:
                slower = max(1e-4, min(20.0, coming))
                s[H] = 0.8 * h * slower ** (-1.0 / (4.0 + ahead))
                return 0
        previous = max(size, 1e-300)
        apply_step(s)
        if left_over * size <= limit:
            own[RATE] = rate
            own[LEFT_OVER] = left_over
            own[ITERATIONS] = iteration + 1
            return 1
    return 0


def guess(s: Floats, h: float) -> None:
    """Start from the polynomial of the step before, or from nothing."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    own = at(s, HEADER + 6 * size + 6)
    Z = at(own, OWN + INCREMENTS * size)
    W = at(own, OWN + TRANSFORMED * size)
    if own[PREVIOUS_H] > 0.0:
        for stage in unrolled(3):
            part = at(Z, stage * size)
            interpolate(s, 1.0 + C[stage] * h / own[PREVIOUS_H], part)
            for i in range(size):
                part[i] -= y[i]
    else:
        for i in range(3 * size):
            Z[i] = 0.0
    for i in range(size):
        for j in unrolled(3):
            W[j * size + i] = total(
                T_INVERSE[j][k] * Z[k * size + i] for k in unrolled(3)
            )


def newton_step(s: Floats, p: Floats, h: float) -> float:
    """Leave the change of W where F was, and give its size against the tolerance."""
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    own = at(s, HEADER + 6 * size + 6)
    z = at(own, OWN + STAGE * size)
    Z = at(own, OWN + INCREMENTS * size)
    W = at(own, OWN + TRANSFORMED * size)
    F = at(own, OWN + RIGHT * size)
    for stage in unrolled(3):
        for i in range(size):
            z[i] = y[i] + Z[stage * size + i]
        derivative(s[T] + C[stage] * h, z, p, at(F, stage * size))
    s[EVALUATIONS] += 3.0
    g = GAMMA / h
    alpha = ALPHA / h
    beta = BETA / h
    for i in range(size):
        a = total(T_INVERSE[0][k] * F[k * size + i] for k in unrolled(3))
        b = total(T_INVERSE[1][k] * F[k * size + i] for k in unrolled(3))
        c = total(T_INVERSE[2][k] * F[k * size + i] for k in unrolled(3))
        F[i] = a - g * W[i]
        F[size + i] = b - alpha * W[size + i] + beta * W[2 * size + i]
        F[2 * size + i] = c - beta * W[size + i] - alpha * W[2 * size + i]
    J = at(own, OWN + MATRICES * size)
    K = at(J, (n + 1) * 2 * n)
    pair = at(K, n * n + n)
    pivots = at(pair, 4 * n * n)
    work = size > 2 * n
    imaginary = at(F, 2 * size)
    solve_real(n, work, g, J, K, at(K, n * n), F)
    solve_pair(
        n, work, alpha, beta, J, pair, pivots, at(F, size), imaginary, at(pivots, 2 * n)
    )
    return (
        norm(size, F, at(s, HEADER + 2 * size))
        + norm(size, at(F, size), at(s, HEADER + 2 * size))
        + norm(size, imaginary, at(s, HEADER + 2 * size))
    )


def norm(size: int, x: Floats, tolerances: Floats) -> float:
    """Give the mean size (root of the mean square) of x against the tolerances."""
    square = 0.0
    controlled = 0
    for i in range(size):
        if tolerances[i] > 0.0:
            part = x[i] / tolerances[i]
            square += part * part
            controlled += 1
    if controlled == 0:
        return 0.0
    return sqrt(square / controlled)


def apply_step(s: Floats) -> None:
    """Add the change to W, and make Z of it."""
    size = int(s[SIZE])
    own = at(s, HEADER + 6 * size + 6)
    Z = at(own, OWN + INCREMENTS * size)
    W = at(own, OWN + TRANSFORMED * size)
    F = at(own, OWN + RIGHT * size)
    for i in range(3 * size):
        W[i] += F[i]
    for i in range(size):
        for j in unrolled(3):
            Z[j * size + i] = total(
                TRANSFORM[j][k] * W[k * size + i] for k in unrolled(3)
            )


def estimate(s: Floats, p: Floats, h: float) -> float:
    """Give the error of the step: IV.8 (8.19), (8.20) for a first or repeated step."""
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    own = at(s, HEADER + 6 * size + 6)
    slope = at(own, OWN)
    z = at(own, OWN + STAGE * size)
    errors = at(own, OWN + ERRORS * size)
    F = at(own, OWN + RIGHT * size)
    Z = at(own, OWN + INCREMENTS * size)
    for i in range(size):
        F[i] = total(ERROR[k] * Z[k * size + i] for k in unrolled(3)) / h
        errors[i] = F[i] + slope[i]
    error = filtered(s, p, h, errors)
    if error >= 1.0 and (own[PREVIOUS_H] == 0.0 or own[JACOBIAN] == 2.0):
        for i in range(size):
            z[i] = y[i] + errors[i]
        derivative(s[T], z, p, errors)
        s[EVALUATIONS] += 1.0
        for i in range(size):
            errors[i] += F[i]
        error = filtered(s, p, h, errors)
    return error


def filtered(s: Floats, p: Floats, h: float, errors: Floats) -> float:
    """Solve for the errors, and give their size against the estimate's tolerance.

    The estimate is of order 3: held to the tolerance itself, it would ask for steps
    that make the result far better. So its tolerance is tolerance^(2/3), as in RADAU5.
    """
    size = int(s[SIZE])
    n = int(s[N])
    own = at(s, HEADER + 6 * size + 6)
    J = at(own, OWN + MATRICES * size)
    K = at(J, (n + 1) * 2 * n)
    solve_real(n, size > 2 * n, GAMMA / h, J, K, at(K, n * n), errors)
    if CONSTRAINED and p[LEAST_HEALTH] < s[CLOSE_BELOW]:
        forget_weak_direction(n, p, errors)
    return norm(size, errors, at(s, HEADER + 2 * size)) * s[RTOL] ** (1.0 / 3.0)


def accept(s: Floats, p: Floats, h: float) -> None:
    """Take the new state; keep the polynomial through the slopes of the stages."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    own = at(s, HEADER + 6 * size + 6)
    slope = at(own, OWN)
    last = at(own, OWN + LAST_SLOPE * size)
    new = at(own, OWN + NEW * size)
    dense = at(own, OWN + POLYNOMIAL * size)
    Z = at(own, OWN + INCREMENTS * size)
    for i in range(size):
        a = total(A_INVERSE[0][k] * Z[k * size + i] for k in unrolled(3))
        b = total(A_INVERSE[1][k] * Z[k * size + i] for k in unrolled(3))
        c = total(A_INVERSE[2][k] * Z[k * size + i] for k in unrolled(3))
        first = h * last[i]
        dense[i] = y[i]
        for m in unrolled(4):
            dense[(m + 1) * size + i] = (
                first * DENSE[0][m]
                + a * DENSE[1][m]
                + b * DENSE[2][m]
                + c * DENSE[3][m]
            )
        last[i] = c / h
        y[i] = new[i]
    own[PREVIOUS_H] = h
    s[STEP_T] = s[T]
    s[STEP_H] = h
    s[T] = s[T] + h
    s[STEPS] += 1.0
    derivative(s[T], y, p, slope)
    s[EVALUATIONS] += 1.0
    record_sizes(s, p)


def interpolate(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step."""
    size = int(s[SIZE])
    dense = at(s, HEADER + 6 * size + 6 + OWN + POLYNOMIAL * size)
    for i in range(size):
        value = 0.0
        for m in unrolled(4):
            value = (value + dense[(4 - m) * size + i]) * x
        out[i] = dense[i] + value
