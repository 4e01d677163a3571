"""The equations of a step of Radau IIA, and Newton's method for them.

With Z the increments of the stages and W = T^-1 Z, the simplified Newton iteration
falls apart into one real and one complex system of the size of the state, which
`linearised` makes half as large.

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
from lagsim.methods.parts.noise import look_at_rounding
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.radau_tableau import ALPHA, BETA, GAMMA, T_INVERSE, C
from lagsim.methods.parts.radau_tableau import T as TRANSFORM
from lagsim.methods.parts.sparse_lu import (
    factor_pair,
    factor_real,
    sparse_pair,
    sparse_real,
)
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import at, total, unrolled
from lagsim.native.layout import array

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True
SPARSE = False  # the matrices of the iterations are; set by the translator
MOST = 10  # iterations
# What Newton's method may leave, in parts of the tolerance; not below rounding.
LEFT = 0.03
ROUNDING = 10.0 * 2.0**-52


class Radau(State):
    """What is carried from step to step, stages, and factors."""

    rate: float  # of convergence, in the last step
    left_over: float  # rate/(1 - rate), carried from step to step
    previous_h: float  # of the last step; 0 at the start of an arc
    factored_h: float  # the step that the factors belong to; 0: none
    jacobian: float  # 0: to be evaluated; 1: of an earlier state; 2: of this one
    iterations: float
    ceiling: float  # a step at which Newton's method failed, slowly forgotten; 0: none
    slope: Floats = array(lambda s: s.size)  # y' at the start ...
    last_slope: Floats = array(lambda s: s.size)  # ... as the polynomial before has it
    z: Floats = array(lambda s: s.size)
    new: Floats = array(lambda s: s.size)
    errors: Floats = array(lambda s: s.size)
    dense: Floats = array(lambda s: 5 * s.size)  # y and four coefficients
    Z: Floats = array(lambda s: 3 * s.size)  # the increments of the stages
    W: Floats = array(lambda s: 3 * s.size)  # T^-1 Z
    F: Floats = array(lambda s: 3 * s.size)  # the right side
    J: Floats = array(lambda s: s.entries or (s.size - s.n) * 2 * s.n)
    K: Floats = array(lambda s: s.filled or s.n * s.n)  # real factors ...
    pivots: Floats = array(lambda s: s.n)  # ... and their pivots, where they are full
    pair: Floats = array(lambda s: 2 * s.filled or 4 * s.n * s.n)  # complex ones
    pair_pivots: Floats = array(lambda s: 2 * s.n)
    x: Floats = array(lambda s: 2 * max(s.n, s.unknowns))


def renew(s: Radau, p: Parameters, h: float) -> int:
    """Evaluate the Jacobian and factor where that is due; give 0 where singular."""
    if s.jacobian == 0.0:
        jacobian(s.t, s.y, p, s.J)
        s.factorisations += 1.0
        s.jacobian = 2.0
        s.factored_h = 0.0
    # The last bits of h do not matter to the iteration.
    if abs(h - s.factored_h) <= 1e-9 * h:
        return 1
    s.factored_h = h
    s.factorisations += 2.0
    done = factor(s, p, h)
    if done == 0:
        s.factored_h = 0.0
    return done


def factor(s: Radau, p: Parameters, h: float) -> int:
    """Factor the real and the complex matrix; give 0 where one is singular."""
    n = s.n
    J = s.J
    g = GAMMA / h
    alpha = ALPHA / h
    beta = BETA / h
    if SPARSE:
        done = factor_real(p, g, J, s.K, s.x)
        if done > 0:
            done = factor_pair(p, alpha, beta, J, s.pair, s.x)
    else:
        done = decompose_real(n, g, J, s.K, s.pivots)
        if done > 0:
            done = decompose_pair(n, alpha, beta, J, s.pair, s.pair_pivots)
    return done


def solve_one(s: Radau, p: Parameters, h: float, r: Floats) -> None:
    """Replace r (size,) by the solution with the real matrix."""
    g = GAMMA / h
    if SPARSE:
        sparse_real(p, g, s.J, s.K, r, s.x)
    else:
        solve_real(s.n, s.size - 2 * s.n, g, s.J, s.K, s.pivots, r)


def solve_two(
    s: Radau, p: Parameters, h: float, real: Floats, imaginary: Floats
) -> None:
    """Replace real + i imaginary, (size,) each, by that with the complex one."""
    n = s.n
    alpha = ALPHA / h
    beta = BETA / h
    if SPARSE:
        sparse_pair(p, alpha, beta, s.J, s.pair, real, imaginary, s.x)
    else:
        solve_pair(
            n, s.size - 2 * n, alpha, beta, s.J, s.pair, s.pair_pivots, real,
            imaginary, s.x,
        )  # fmt: skip


def converge(s: Radau, p: Parameters, h: float) -> int:
    """Solve for the stages by simplified Newton iterations; give 0 where that fails.

    Section IV.8, (8.13); the rate of convergence says what is left, and what will be.
    """
    limit = max(LEFT, ROUNDING / (LOCAL * s.rtol))
    guess(s, h)
    left_over = max(s.left_over, 2.0**-52) ** 0.8
    previous = 0.0
    rate = 0.0
    for iteration in range(MOST):
        size = newton_step(s, p, h)
        if not size < 1e300:
            return 0
        if iteration > 0:
            latest = size / previous
            rate = latest if iteration == 1 else sqrt(rate * latest)
            left_over = rate / (1.0 - rate) if rate < 0.99 else 1e300
            ahead = MOST - 2 - iteration
            coming = left_over * size * rate**ahead / limit
            hopeless = coming >= 1.0 and left_over * size > limit
            # Quotients alternate where the errors of J do: one alone is no rate yet.
            if hopeless and (iteration > 1 or rate >= 0.99):
                if is_rounding(s, p, h, size):
                    apply_step(s)
                    s.iterations = iteration + 1
                    return 1
                if rate < 0.99:
                    slower = max(1e-4, min(20.0, coming))
                    s.h = 0.8 * h * slower ** (-1.0 / (4.0 + ahead))
                return 0
        previous = max(size, 1e-300)
        apply_step(s)
        if left_over * size <= limit:
            s.rate = rate
            s.left_over = left_over
            s.iterations = iteration + 1
            return 1
    return 0


def is_rounding(s: Radau, p: Parameters, h: float, change: float) -> bool:
    """Tell whether a change of W is no larger than what rounding leaves of the rates.

    A stiff force rounds the state that it is asked at; however often, the iteration
    comes no closer. What the estimate would not let pass is too large for that.
    """
    size = s.size
    noise = s.noise
    errors = s.errors
    if change * s.rtol**0.2 >= 1.0:
        return False
    if CONSTRAINED and p.least_health < s.close_below:
        return False
    if s.looked == 0.0:
        look_at_rounding(s, p, s.t, s.y, s.slope, 1.0)
    for i in range(size):
        errors[i] = noise[i] if i >= s.n else 0.0
        if s.looked == 0.0:
            noise[i] = 0.0
    solve_one(s, p, h, errors)
    return change <= norm(size, errors, s.tolerances)


def guess(s: Radau, h: float) -> None:
    """Start from the polynomial of the step before, or from nothing."""
    size = s.size
    y = s.y
    Z = s.Z
    W = s.W
    if s.previous_h > 0.0:
        for stage in unrolled(3):
            part = at(Z, stage * size)
            polynomial(s, 1.0 + C[stage] * h / s.previous_h, part)
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


def newton_step(s: Radau, p: Parameters, h: float) -> float:
    """Leave the change of W where F was, and give its size against the tolerance."""
    size = s.size
    y = s.y
    z = s.z
    Z = s.Z
    W = s.W
    F = s.F
    for stage in unrolled(3):
        for i in range(size):
            z[i] = y[i] + Z[stage * size + i]
        derivative(s.t + C[stage] * h, z, p, at(F, stage * size))
    s.evaluations += 3.0
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
    real = at(F, size)
    imaginary = at(F, 2 * size)
    solve_one(s, p, h, F)
    solve_two(s, p, h, real, imaginary)
    return (
        norm(size, F, s.tolerances)
        + norm(size, real, s.tolerances)
        + norm(size, imaginary, s.tolerances)
    )


def apply_step(s: Radau) -> None:
    """Add the change to W, and make Z of it."""
    size = s.size
    Z = s.Z
    W = s.W
    F = s.F
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


def polynomial(s: Radau, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step, or beyond it."""
    size = s.size
    dense = s.dense
    for i in range(size):
        value = 0.0
        for m in unrolled(4):
            value = (value + dense[(4 - m) * size + i]) * x
        out[i] = dense[i] + value
