"""Radau IIA of order 5: implicit, for stiff models.

Very stiff springs and dampers do not limit its step once their fast motion has died
out. It damps such motion itself (L-stable): a fast oscillation below the tolerance
disappears, so energy is lost. Simplified Newton iterations with the exact Jacobian,
Gustafsson's predictive step control, an error estimate of order 3 with the tolerance
adapted to it, dense output of order 4 from the stages' slopes. On stiff parts of the
motion the order falls to 3. Stable on the whole imaginary axis and in the left
half-plane: no limit on step * frequency. A sparse Newton matrix is factored as such:
for chains and trees in a time proportional to the number of bodies.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
sections IV.5, IV.8 and IV.15; K. Gustafsson, ACM Trans. Math. Software 20 (1994).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.constraints import (
    bent,
    forget_removed,
    hides_error,
    leave_loss,
    meet_constraints,
    needs_loops,
    note_directions,
    time_to_loss,
)
from lagsim.methods.parts.control import (
    against,
    allow_roundoff,
    bound_roundoff,
    first_step,
    record_sizes,
    set_tolerances,
)
from lagsim.methods.parts.driver import State, usable_step
from lagsim.methods.parts.fixed import Tableau
from lagsim.methods.parts.missed import check_features
from lagsim.methods.parts.newton import (
    decompose_pair,
    decompose_real,
    factor_pair,
    factor_real,
    solve_pair,
    solve_real,
    sparse_pair,
    sparse_real,
    take_finite,
    too_large,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import (
    DEGENERATE,
    DONE,
    LOCAL,
    LOSS_AHEAD,
    NEWTON_FAILED,
    NOT_FINITE,
    PROJECTION_FAILED,
    STEP_TOO_SMALL,
    derivative,
    jacobian,
)
from lagsim.native.kernels.words import at, total, unrolled
from lagsim.native.layout import array
from lagsim.tolerances import OVERFLOW, SAME_STEP, TINY, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats

NAME = "radau"
TITLE = "Radau IIA"
ORDER = 5
DENSE_ORDER = 4
ADAPTIVE = True
IMAGINARY_LIMIT = inf
HANDLES = "any model; equality constraints by projection"
refusal = too_large
NEEDS = ("jacobian",)

CONSTRAINED = True
LOCALIZED = True
SPARSE = False  # the matrices of the iterations are; set by the translator

# A step at which Newton's method failed is kept clear of, and grows by this per step.
FORGOTTEN = 1.1
CLEAR = 0.8
# The values of RADAU5 (IV.8): safety, bounds of the step's change, the rate of
# convergence below which the Jacobian is kept, and the growth of the step that is not
# worth a factorisation.
SAFETY = 0.9
SHRINK = 8.0
GROW = 5.0
KEEP_BELOW = 1e-3
NOT_WORTH = 1.2


def start(s: Radau, p: Parameters) -> None:
    """Begin an arc: evaluate at its start, choose the first step."""
    size, slope, last = s.size, s.slope, s.last_slope
    derivative(s.t, s.y, p, slope)
    s.evaluations += 1.0
    for i in range(size):
        last[i] = slope[i]
    s.rate = s.previous_h = s.previous_error = s.factored_h = 0.0
    s.jacobian = s.iterations = s.ceiling = s.step_h = 0.0
    s.left_over = 1.0
    record_sizes(s, p)
    s.h = first_step(s, p, 4, slope)
    if CONSTRAINED:
        s.h = leave_loss(s, p, s.h)


def step(s: Radau, p: Parameters) -> int:
    """Make one accepted step, or give a code other than 0."""
    rejected = False
    trouble = STEP_TOO_SMALL
    while True:
        h = usable_step(s, p)
        if h == 0.0:
            return trouble
        if CONSTRAINED and cannot_pass(s, p, rejected):
            return LOSS_AHEAD
        error = attempt(s, p, h)
        trouble = verdict(s, p, h, error)
        if trouble == DONE:
            break
        if CONSTRAINED and needs_loops(s):
            return DEGENERATE
        rejected = True
        s.rejections += 1.0
        if s.jacobian < 2.0:
            s.jacobian = 0.0
    quotient = predict(s, h, error)
    accept(s, p, h)
    plan_next(s, h, h / quotient, rejected)
    return DONE


def plan_next(s: Radau, h: float, ahead: float, rejected: bool) -> None:
    """Choose the step after one of length h, and whether the Jacobian is kept."""
    s.h = min(ahead, h) if rejected else ahead
    if s.ceiling > 0.0:
        s.ceiling *= FORGOTTEN
        s.h = min(s.h, CLEAR * s.ceiling)
    s.jacobian = 0.0
    if s.rate <= KEEP_BELOW:
        s.jacobian = 1.0
        if h <= s.h and s.h <= NOT_WORTH * h:
            s.h = h


def cannot_pass(s: Radau, p: Parameters, rejected: bool) -> bool:
    """Tell whether the step is one over or from a loss of rank, or fails before it.

    The accelerations off the constraints, and their derivatives, grow with the inverse
    of sigma: Newton's method for the stages finds a false solution, or
    none. An explicit method has stages at a distance.
    """
    if rejected and s.planned > 0.0 and s.falling > 0.0:
        return time_to_loss(s, p, s.sigma / s.falling) > 0.0
    leaves = s.step_h == 0.0 and s.sigma < s.close_below
    return leaves or s.passes > 0.0


def verdict(s: Radau, p: Parameters, h: float, error: float) -> int:
    """Code of an attempted step, DONE or its failure; s.h is the next to try."""
    if not error < OVERFLOW:
        s.h = 0.1 * h
        return NOT_FINITE
    if error < 0.0:
        s.ceiling = h
        return NEWTON_FAILED
    if error >= 1.0:
        s.h = 0.1 * h
        if s.previous_h > 0.0:
            s.h = h / change(s, error)
        return STEP_TOO_SMALL
    if CONSTRAINED and meet_constraints(s, p, s.t + h, h, s.new) == 0:
        s.h = 0.25 * h
        return PROJECTION_FAILED
    return DONE


def change(s: Radau, error: float) -> float:
    """Give by how much the step should shrink: IV.8 (8.21), less after long Newton."""
    safety = SAFETY * (2.0 * MOST + 1.0) / (2.0 * MOST + s.iterations)
    return float(max(1.0 / GROW, min(SHRINK, error**0.25 / safety)))


def predict(s: Radau, h: float, error: float) -> float:
    """Give the same after an accepted step, with the last one: IV.8 (8.25)."""
    quotient = change(s, error)
    if s.previous_h > 0.0:
        ahead = (error * error / s.previous_error) ** 0.25 / SAFETY
        ahead *= s.previous_h / h
        quotient = max(quotient, 1.0 / GROW, min(SHRINK, ahead))
    s.previous_error = max(0.01, error)
    return float(quotient)


def attempt(s: Radau, p: Parameters, h: float) -> float:
    """Make a step and give its error in units of the tolerance.

    Negative where Newton's method did not converge; s.h is then the step to try next.
    """
    size, y, new, Z = s.size, s.y, s.new, s.Z
    if CONSTRAINED:
        p.least_sigma = 1.0
    set_tolerances(s, p, s.t, y, s.slope, h)
    s.h = 0.5 * h
    if renew(s, p, h) == 0:
        return -1.0
    if converge(s, p, h) == 0:
        return -1.0
    for i in range(size):
        new[i] = y[i] + Z[2 * size + i]
    slope = s.slope
    set_tolerances(s, p, s.t + h, new, slope, h)
    error = estimate(s, p, h)
    sigma = 1.0
    if CONSTRAINED and p.least_sigma < s.close_below:
        sigma = p.least_sigma
    # Perhaps it is nothing but rounding.
    if error >= 1.0 and allow_roundoff(s, p, h, new, slope, sigma):
        error = norm(size, s.errors, s.tolerances)
        error *= s.rtol**0.2
    return error


def estimate(s: Radau, p: Parameters, h: float) -> float:
    """Give the error of the step: IV.8 (8.19), (8.20) for a first or repeated step."""
    size, y, slope, z, errors, F, Z = s.size, s.y, s.slope, s.z, s.errors, s.F, s.Z
    for i in range(size):
        F[i] = total(ERROR[k] * Z[k * size + i] for k in unrolled(3)) / h
        errors[i] = F[i] + slope[i]
    error = filtered(s, p, h, errors)
    if error >= 1.0 and (s.previous_h == 0.0 or s.jacobian == 2.0):
        for i in range(size):
            z[i] = y[i] + errors[i]
        derivative(s.t, z, p, errors)
        s.evaluations += 1.0
        for i in range(size):
            errors[i] += F[i]
        error = filtered(s, p, h, errors)
    return error


def filtered(s: Radau, p: Parameters, h: float, errors: Floats) -> float:
    """Solve for the errors, and give their size against the estimate's tolerance.

    The estimate goes with h^4, the error of the whole motion with h^5: held to
    tolerance^(4/5), the result follows the tolerance (RADAU5 takes 2/3).
    """
    size = s.size
    solve_one(s, p, h, errors)
    tolerances = s.tolerances
    error = norm(size, errors, tolerances) * s.rtol**0.2
    if CONSTRAINED and error >= 1.0 and hides_error(s, p):
        note_directions(s, p, s.t + h, s.new)
        removed = forget_removed(s, p, h, errors)
        left = norm(size, errors, tolerances) * s.rtol**0.2
        error = bent(s, removed, left)
    return float(error)


def accept(s: Radau, p: Parameters, h: float) -> None:
    """Take the new state; keep the polynomial through the slopes of the stages."""
    size, y, slope, last, new = s.size, s.y, s.slope, s.last_slope, s.new
    dense, Z = s.dense, s.Z
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
    s.previous_h = h
    s.evaluations += 1.0
    if LOCALIZED:
        before = s.z
        for i in range(size):
            before[i] = slope[i]
        derivative(s.t + h, new, p, slope)
        check_features(s, p, h, y, before, new, slope)
    else:
        derivative(s.t + h, new, p, slope)
    for i in range(size):
        y[i] = new[i]
    s.step_t = s.t
    s.step_h = h
    s.t = s.t + h
    s.steps += 1.0
    record_sizes(s, p)


def interpolate(s: Radau, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step."""
    polynomial(s, x, out)


def interpolate_rates(s: Radau, x: float, out: Floats) -> None:
    """Give the slope of that, from the velocities on."""
    size, dense = s.size, s.dense
    for i in range(s.n, size):
        slope = 0.0
        for m in unrolled(4):
            slope = slope * x + (4 - m) * dense[(4 - m) * size + i]
        out[i] = slope / s.step_h


# --- the equations of a step, and Newton's method for them ----------------------------
# With Z the increments of the stages and W = T^-1 Z, the simplified Newton iteration
# falls apart into one real and one complex system of the size of the state, which are
# made half as large, see `newton`.
#
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# section IV.8.

MOST = 10  # iterations
# What Newton's method may leave, in parts of the tolerance; not below rounding.
LEFT = 0.03
ROUNDING = 20.0 * UNIT_ROUNDOFF


class Radau(State):
    """What is carried from step to step, stages, and factors."""

    rate: float  # of convergence, in the last step
    left_over: float  # rate/(1 - rate), carried from step to step
    # Of Newton's matrix where it is sparse: rows, entries, those of its factors.
    unknowns: int
    entries: int
    filled: int
    previous_error: float  # of the last accepted step, for predictive control
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


STATE = Radau


def renew(s: Radau, p: Parameters, h: float) -> int:
    """Evaluate the Jacobian and factor where that is due; give 0 where singular."""
    if s.jacobian == 0.0:
        jacobian(s.t, s.y, p, s.J)
        take_finite(s.entries if SPARSE else (s.size - s.n) * 2 * s.n, s.J)
        s.factorisations += 1.0
        s.jacobian = 2.0
        s.factored_h = 0.0
    # The last bits of h do not matter to the iteration.
    if abs(h - s.factored_h) <= SAME_STEP * h:
        return 1
    s.factored_h = h
    s.factorisations += 2.0
    done = factor(s, p, h)
    if done == 0:
        s.factored_h = 0.0
    return done


def factor(s: Radau, p: Parameters, h: float) -> int:
    """Factor the real and the complex matrix; give 0 where one is singular."""
    n, J = s.n, s.J
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
        if not size < OVERFLOW:
            return 0
        if iteration > 0:
            latest = size / previous
            rate = latest if iteration == 1 else sqrt(rate * latest)
            left_over = rate / (1.0 - rate) if rate < 0.99 else OVERFLOW
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
        previous = max(size, TINY)
        apply_step(s)
        if left_over * size <= limit:
            s.rate = rate
            s.left_over = left_over
            s.iterations = iteration + 1
            return 1
    return 0


def is_rounding(s: Radau, p: Parameters, h: float, change: float) -> bool:
    """Whether a change of W is no larger than the roundoff of the rates.

    A stiff force rounds the state that it is asked at; however often, the iteration
    comes no closer. What the estimate would not let pass is too large for that.
    """
    size, roundoff, errors = s.size, s.roundoff, s.errors
    if change * s.rtol**0.2 >= 1.0:
        return False
    if CONSTRAINED and p.least_sigma < s.close_below:
        return False
    if s.rounding_known == 0.0:
        bound_roundoff(s, p, s.t, s.y, s.slope, 1.0)
    for i in range(size):
        errors[i] = roundoff[i] if i >= s.n else 0.0
        if s.rounding_known == 0.0:
            roundoff[i] = 0.0
    solve_one(s, p, h, errors)
    return change <= norm(size, errors, s.tolerances)


def guess(s: Radau, h: float) -> None:
    """Start from the polynomial of the step before, or from nothing."""
    size, y, Z, W = s.size, s.y, s.Z, s.W
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
    size, y, z, Z, W, F = s.size, s.y, s.z, s.Z, s.W, s.F
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
    size, Z, W, F = s.size, s.Z, s.W, s.F
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
    size, dense = s.size, s.dense
    for i in range(size):
        value = 0.0
        for m in unrolled(4):
            value = (value + dense[(4 - m) * size + i]) * x
        out[i] = dense[i] + value


# --- coefficients, and what diagonalises them -----------------------------------------
# The nodes are the zeros of N(x) = (x - 1)(x^2 - 4 x/5 + 1/10). A and B integrate
# Lagrange's polynomials. An eigenvector of A^-1 for the eigenvalue mu is, at the nodes,
# the polynomial N'/mu + N''/mu^2 + N'''/mu^3: its derivative less mu times itself is a
# multiple of N, and it vanishes at 0.
#
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# sections IV.5 and IV.8.

Rows = tuple[tuple[float, ...], ...]


def integrals(nodes: Sequence[float]) -> Rows:
    """Give, for each node, the integral from 0 of its polynomial: x^1, x^2, ..."""
    rows = []
    for j, own in enumerate(nodes):
        product, scale = [1.0], 1.0
        for k, other in enumerate(nodes):
            if k != j:
                shifted = [0.0, *product]
                product = [
                    a - other * b for a, b in zip(shifted, [*product, 0.0], strict=True)
                ]
                scale *= own - other
        rows.append(tuple(a / (scale * (k + 1)) for k, a in enumerate(product)))
    return tuple(rows)


def at_point(row: Sequence[float], x: float) -> float:
    """Give the polynomial row[0] x + row[1] x^2 + ... ."""
    value = 0.0
    for a in reversed(row):
        value = (value + a) * x
    return value


def inverse(A: Rows) -> Rows:
    """Give the inverse (3, 3), by cofactors."""
    minors = [
        [
            A[(i + 1) % 3][(j + 1) % 3] * A[(i + 2) % 3][(j + 2) % 3]
            - A[(i + 1) % 3][(j + 2) % 3] * A[(i + 2) % 3][(j + 1) % 3]
            for j in range(3)
        ]
        for i in range(3)
    ]
    whole = sum(a * b for a, b in zip(A[0], minors[0], strict=True))
    return tuple(tuple(minors[j][i] / whole for j in range(3)) for i in range(3))


C = ((4.0 - sqrt(6.0)) / 10.0, (4.0 + sqrt(6.0)) / 10.0, 1.0)
A = tuple(tuple(at_point(row, c) for row in integrals(C)) for c in C)
B = A[2]
A_INVERSE = inverse(A)

# The eigenvalues of A^-1: GAMMA, and ALPHA + i BETA with its conjugate.
_cubes = (
    9.0 ** (2.0 / 3.0) - 9.0 ** (1.0 / 3.0),
    9.0 ** (2.0 / 3.0) + 9.0 ** (1.0 / 3.0),
)
GAMMA = 30.0 / (6.0 + _cubes[0])
_complex = 1.0 / ((12.0 - _cubes[0] + 1j * sqrt(3.0) * _cubes[1]) / 60.0)
ALPHA, BETA = _complex.real, abs(_complex.imag)


def _eigenvector(mu: complex) -> list[complex]:
    # N = x^3 - 9/5 x^2 + 9/10 x - 1/10
    return [
        (3.0 * c * c - 3.6 * c + 0.9) / mu
        + (6.0 * c - 3.6) / (mu * mu)
        + 6.0 / (mu * mu * mu)
        for c in C
    ]


# A^-1 T = T [GAMMA, 0, 0; 0, ALPHA, -BETA; 0, BETA, ALPHA].
_real, _pair = _eigenvector(GAMMA), _eigenvector(complex(ALPHA, BETA))
TRANSFORM = tuple((a.real, b.real, -b.imag) for a, b in zip(_real, _pair, strict=True))
T_INVERSE = inverse(TRANSFORM)

# Error = (GAMMA/h - J)^-1 (f(y0) + sum ERROR_i Z_i / h), IV.8 (8.19): the difference to
# an embedded formula of order 3 that also uses f(y0).
ERROR = (
    -(13.0 + 7.0 * sqrt(6.0)) / 3.0,
    (-13.0 + 7.0 * sqrt(6.0)) / 3.0,
    -1.0 / 3.0,
)

# y0 + h sum_j y'_j (DENSE[j][0] x + ... + DENSE[j][3] x^4), y' at 0 and the nodes.
DENSE = integrals((0.0, *C))

TABLEAU = Tableau(A, B, C, ORDER)
amplification = TABLEAU.amplification
