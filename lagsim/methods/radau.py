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

from math import inf
from typing import TYPE_CHECKING

from lagsim.methods.parts.adaptive import usable_step
from lagsim.methods.parts.controller import (
    first_step,
    look_again,
    record_sizes,
    set_tolerances,
)
from lagsim.methods.parts.interface import derivative
from lagsim.methods.parts.looks import suspect
from lagsim.methods.parts.lu import too_large
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.projection import meet_constraints
from lagsim.methods.parts.radau_newton import (
    MOST,
    Radau,
    converge,
    norm,
    polynomial,
    renew,
    solve_one,
)
from lagsim.methods.parts.radau_tableau import A_INVERSE, DENSE, ERROR, A, B, C
from lagsim.methods.parts.singular import (
    bent,
    forget_removed,
    hides_error,
    leave_loss,
    needs_loops,
    note_directions,
    time_to_loss,
)
from lagsim.methods.parts.state import (
    DEGENERATE,
    DONE,
    LOSS_AHEAD,
    NEWTON_FAILED,
    NOT_FINITE,
    PROJECTION_FAILED,
    STEP_TOO_SMALL,
)
from lagsim.methods.parts.tableau import Tableau
from lagsim.native.kernels.words import total, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

NAME = "radau"
TITLE = "Radau IIA"
ORDER = 5
DENSE_ORDER = 4
ADAPTIVE = True
IMAGINARY_LIMIT = inf
HANDLES = "any model; equality constraints by projection"
TABLEAU = Tableau(A, B, C, ORDER)
amplification = TABLEAU.amplification

refusal = too_large
NEEDS = ("jacobian",)

CONSTRAINED = True
SLEEPERS = True
SPARSE = False
STATE = Radau

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
    size = s.size
    slope = s.slope
    last = s.last_slope
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
    of the rows' independence: Newton's method for the stages finds a false solution, or
    none. An explicit method has stages at a distance.
    """
    if rejected and s.planned > 0.0 and s.falling > 0.0:
        return time_to_loss(s, p, s.health / s.falling) > 0.0
    leaves = s.step_h == 0.0 and s.health < s.close_below
    return leaves or s.passes > 0.0


def verdict(s: Radau, p: Parameters, h: float, error: float) -> int:
    """Give DONE, or what is wrong with the step and, in s.h, the one to try next."""
    if not error < 1e300:
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
    size = s.size
    y = s.y
    new = s.new
    Z = s.Z
    if CONSTRAINED:
        p.least_health = 1.0
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
    health = 1.0
    if CONSTRAINED and p.least_health < s.close_below:
        health = p.least_health
    # Perhaps it is nothing but rounding.
    if error >= 1.0 and look_again(s, p, h, new, slope, health):
        error = norm(size, s.errors, s.tolerances)
        error *= s.rtol**0.2
    return error


def estimate(s: Radau, p: Parameters, h: float) -> float:
    """Give the error of the step: IV.8 (8.19), (8.20) for a first or repeated step."""
    size = s.size
    y = s.y
    slope = s.slope
    z = s.z
    errors = s.errors
    F = s.F
    Z = s.Z
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
    size = s.size
    y = s.y
    slope = s.slope
    last = s.last_slope
    new = s.new
    dense = s.dense
    Z = s.Z
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
    if SLEEPERS:
        before = s.z
        for i in range(size):
            before[i] = slope[i]
        derivative(s.t + h, new, p, slope)
        suspect(s, p, h, y, before, new, slope)
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
    size = s.size
    dense = s.dense
    for i in range(s.n, size):
        slope = 0.0
        for m in unrolled(4):
            slope = slope * x + (4 - m) * dense[(4 - m) * size + i]
        out[i] = slope / s.step_h
