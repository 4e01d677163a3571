"""The equations of a step of Radau IIA, and Newton's method for them.

With Z the increments of the stages and W = T^-1 Z, the simplified Newton iteration
falls apart into one real and one complex system of the size of the state, which
`_linearised` makes half as large.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
section IV.8.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.controller import LOCAL, against
from lagsim.methods.parts.interface import derivative, jacobian
from lagsim.methods.parts.linearised import (
    decompose_pair,
    decompose_real,
    solve_pair,
    solve_real,
)
from lagsim.methods.parts.radau_tableau import ALPHA, BETA, GAMMA, T_INVERSE, C
from lagsim.methods.parts.radau_tableau import T as TRANSFORM
from lagsim.methods.parts.state import (
    EVALUATIONS,
    FACTORISATIONS,
    HEADER,
    RTOL,
    SIZE,
    H,
    N,
    T,
)
from lagsim.native.kernels.words import at, total, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

MOST = 10  # iterations
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
CEILING = 7  # a step at which Newton's method failed, slowly forgotten; 0: none
OWN = 8

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


def renew(s: Floats, p: Floats, h: float) -> int:
    """Evaluate the Jacobian and factor where that is due; give 0 where singular."""
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
            rate = latest if iteration == 1 else sqrt(rate * latest)
            if rate >= 0.99:
                return 0
            left_over = rate / (1.0 - rate)
            ahead = MOST - 2 - iteration
            coming = left_over * size * rate**ahead / limit
            hopeless = coming >= 1.0 and left_over * size > limit
            # Quotients alternate where the errors of J do: one alone is no rate yet.
            if hopeless and iteration > 1:
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
            polynomial(s, 1.0 + C[stage] * h / own[PREVIOUS_H], part)
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


def norm(size: int, x: Floats, tolerances: Floats) -> float:
    """Give the mean size (root of the mean square) of x against the tolerances."""
    square = 0.0
    controlled = 0
    for i in range(size):
        if tolerances[i] > 0.0:
            part = against(x[i], tolerances[i])
            square += part * part
            controlled += 1
    if controlled == 0:
        return 0.0
    return sqrt(square / controlled)


def polynomial(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step, or beyond it."""
    size = int(s[SIZE])
    dense = at(s, HEADER + 6 * size + 6 + OWN + POLYNOMIAL * size)
    for i in range(size):
        value = 0.0
        for m in unrolled(4):
            value = (value + dense[(4 - m) * size + i]) * x
        out[i] = dense[i] + value
