"""Radau IIA of order 5: implicit, for stiff models.

Very stiff springs and dampers do not limit its step once their fast motion has died
out. It damps such motion itself (L-stable): a fast oscillation below the tolerance
disappears, so energy is lost.

- **Order** 5; on stiff parts of the motion the order falls to 3.
- **Newton.** Simplified iterations with the exact Jacobian. A sparse Newton matrix is
  factored as such: for chains and trees in a time proportional to the number of bodies.
- **Error.** An estimate of order 3, with the tolerance adapted to it, and Gustafsson's
  predictive step control.
- **Rows** between steps are of order 4, from the slopes of the stages.
- **Stability.** Stable on the whole imaginary axis and in the left half-plane: there is
  no limit on step * frequency.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
sections IV.5, IV.8 and IV.15; K. Gustafsson, ACM Trans. Math. Software 20 (1994).
"""

from __future__ import annotations

from math import inf, sqrt

from lagsim.language.arrays import Floats
from lagsim.methods.parts import constraints, control, newton
from lagsim.methods.parts import state as at
from lagsim.methods.parts.driver import State, usable_step
from lagsim.methods.parts.first_step import first_step, within_oscillation
from lagsim.methods.parts.fixed import Tableau
from lagsim.methods.parts.newton import SparseNewton
from lagsim.methods.parts.onset import (
    LIMITED,
    LIMITING,
    set_aside,
    sides_are_clear,
    spread_scales,
)
from lagsim.methods.parts.state import LOCAL, check_features, derivative, jacobian
from lagsim.native.kernels.words import Static, total, unrolled
from lagsim.native.layout import array
from lagsim.tolerances import OVERFLOW, SAME_STEP, TINY, UNIT_ROUNDOFF

NAME = "radau"
TITLE = "Radau IIA"
ORDER = 5
DENSE_ORDER = 4
ADAPTIVE = True
IMAGINARY_LIMIT = inf
HANDLES = "any model; equality constraints by projection"
refusal = newton.too_large
NEEDS = ("jacobian",)
STATES = True

CONSTRAINED = True
SWITCHES = True
SPARSE = False  # whether Newton's matrices are sparse; set by the translator

# The step size at which Newton's method failed is avoided; the limit grows by this
# factor per step.
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
# Largest effect of the roundoff of a rate that is assumed without sampling, in
# tolerances of the component's change in the step: at a start from rest, changes are
# small relative to the following ones.
ASSUMED = 1e3
# Number of samples of roundoff; their displacements, in units of roundoff: the larger
# ones show the effect of the state's rounding, since few terms cancel by chance, and
# the smaller ones the rounding within an evaluation. Roundoff in the error estimate
# relative to the effect of one unit: the coefficients ERROR are as large as 10, and few
# samples find the largest effect.
SAMPLES = 4
FAR = 32.0
NEAR = 4.0
SAMPLED = 16.0
# Roundoff of T^-1 Z relative to that of Z: the sums of entries of T^-1 are as large as
# 21.
OF_STAGES = 8.0


def start(s: Radau, p: SparseNewton) -> None:
    """Begin an arc: evaluate y' at the start, and choose the first step."""
    slope = s.slope
    derivative(s.t, s.y, p, slope)
    s.evaluations += 1.0
    s.last_slope[:] = slope
    s.rate = s.previous_h = s.previous_error = s.factored_h = 0.0
    s.jacobian = s.iterations = s.ceiling = s.step_h = s.sampled_h = 0.0
    s.left_over = 1.0
    control.record_sizes(s, p)
    s.h = within_oscillation(s, p, first_step(s, p, 4, slope), slope)
    if CONSTRAINED:
        s.h = constraints.step_past_loss(s, p, s.h)


def step(s: Radau, p: SparseNewton) -> int:
    """Advance by one accepted step, or return a code other than DONE."""
    rejected = False
    trouble = at.STEP_TOO_SMALL
    while True:
        h = usable_step(s, p)
        if h == 0.0:
            return trouble
        if CONSTRAINED and cannot_pass(s, p, rejected):
            return at.LOSS_AHEAD
        error = attempt(s, p, h)
        trouble = verdict(s, p, h, error)
        if trouble == at.DONE:
            break
        if CONSTRAINED and constraints.needs_loops(s):
            return at.DEGENERATE
        rejected = True
        s.rejections += 1.0
        if s.jacobian < 2.0:
            s.jacobian = 0.0
    quotient = predict(s, h, error)
    accept(s, p, h)
    plan_next(s, h, h / quotient, rejected)
    return at.DONE


def plan_next(s: Radau, h: float, ahead: float, rejected: bool) -> None:
    """Choose the next step after one of length h, and whether to keep the Jacobian.

    ahead : the length of the next step by the error estimates.
    rejected : whether an attempt at the last step was rejected.
    """
    s.h = min(ahead, h) if rejected else ahead
    if s.ceiling > 0.0:
        s.ceiling *= FORGOTTEN
        s.h = min(s.h, CLEAR * s.ceiling)
    s.jacobian = 0.0
    if s.rate <= KEEP_BELOW:
        s.jacobian = 1.0
        if h <= s.h and s.h <= NOT_WORTH * h:
            s.h = h


def cannot_pass(s: Radau, p: SparseNewton, rejected: bool) -> bool:
    """Whether a step begins at a loss of rank, passes one, or fails just before one.

    Near a loss of rank the accelerations off the constraints, and their derivatives,
    grow with the inverse of sigma: Newton's method for the stages finds a false
    solution, or none. An explicit method has its stages at a distance from the loss.

    rejected : whether an attempt at this step was rejected.
    """
    if rejected and s.planned > 0.0 and s.falling > 0.0:
        return constraints.time_to_loss(s, p, s.sigma / s.falling) > 0.0
    leaves = s.step_h == 0.0 and s.sigma < s.close_below
    return leaves or s.passes > 0.0


def verdict(s: Radau, p: SparseNewton, h: float, error: float) -> int:
    """Return the code of an attempted step h; s.h becomes the next step to try.

    error : the error of the step in units of the tolerance, negative if Newton's method
        failed.
    """
    if not error < OVERFLOW:
        s.h = 0.1 * h
        return at.NOT_FINITE
    if error < 0.0:
        s.ceiling = h
        return at.NEWTON_FAILED
    if error >= 1.0:
        s.h = 0.1 * h
        if s.previous_h > 0.0:
            s.h = h / change(s, error)
        return at.STEP_TOO_SMALL
    if CONSTRAINED and constraints.project_step(s, p, s.t + h, h, s.new) == 0:
        s.h = 0.25 * h
        return at.PROJECTION_FAILED
    return at.DONE


def change(s: Radau, error: float) -> float:
    """Return the factor by which the step is divided, IV.8 (8.21).

    The factor is larger after many Newton iterations.

    error : in units of the tolerance.
    """
    safety = SAFETY * (2.0 * MOST + 1.0) / (2.0 * MOST + s.iterations)
    return float(max(1.0 / GROW, min(SHRINK, error**0.25 / safety)))


def predict(s: Radau, h: float, error: float) -> float:
    """Return the factor by which the step is divided, IV.8 (8.25).

    The factor follows from the errors of the last two steps.

    h, error : the accepted step, and its error in units of the tolerance.
    """
    quotient = change(s, error)
    if s.previous_h > 0.0:
        ahead = (error * error / s.previous_error) ** 0.25 / SAFETY
        ahead *= s.previous_h / h
        quotient = max(quotient, 1.0 / GROW, min(SHRINK, ahead))
    s.previous_error = max(0.01, error)
    return float(quotient)


def attempt(s: Radau, p: SparseNewton, h: float) -> float:
    """Compute a step h; return its error in units of the tolerance.

    The error is negative if Newton's method did not converge; s.h is then the step to
    try next.
    """
    if CONSTRAINED:
        p.least_sigma = 1.0
    control.set_tolerances(s, p, s.t, s.y, s.slope, h)
    s.h = 0.5 * h
    if renew(s, p, h) == 0:
        return -1.0
    if converge(s, p, h) == 0 and converge_others(s, p, h) == 0:
        return -1.0
    s.new[:] = s.y + s.Z[2 * s.size :]
    control.set_tolerances(s, p, s.t + h, s.new, s.slope, h)
    error = estimate(s, p, h)
    if sides_are_clear(s, p, s.t, s.y):
        error = error_at_onset(s, p, h, error)
    sigma = 1.0
    if CONSTRAINED and p.least_sigma < s.close_below:
        sigma = p.least_sigma
    # The error may be rounding alone.
    while error >= 1.0 and allow_roundoff(s, p, h, sigma):
        error = norm(1, s.size, s.errors, s.tolerances)
        error *= s.rtol**0.2
    return error


def error_at_onset(s: Radau, p: SparseNewton, h: float, error: float) -> float:
    """Return the error of a step h in tolerances, raised for components at their onset.

    Such components begin to move by the motion of others, see `onset`. An implicit step
    reaches all components at once; tolerances are raised until those at their onset no
    longer limit the step.

    error : the error in tolerances so far.
    """
    part = s.rtol**0.2
    limits = error >= LIMITING
    while limits and set_aside(s, h, s.new, s.slope, min(error - 1.0, 0.0)) > 0:
        others = part * norm(1, s.size, s.errors, s.tolerances)
        hops = s.hops
        if others < 1.0 and LIMITED * others < error:
            spread_scales(s, p, s.t, s.y, s.slope, s.new, h)
        control.compute_tolerances(s, p, s.new, s.slope, h)
        error = part * norm(1, s.size, s.errors, s.tolerances)
        # Again, if more components in a row remain to be reached.
        limits = s.hops > hops and error >= LIMITING
    return float(error)


def converge_others(s: Radau, p: SparseNewton, h: float) -> int:
    """Solve for the stages with the tolerances of components at their onset ignored.

    These tolerances may be too small for Newton's method, see `onset`. Return 0 on
    failure, or if no component is at its onset, else 1.
    """
    if not sides_are_clear(s, p, s.t, s.y):
        return 0
    s.new[:] = s.y + s.Z[2 * s.size :]
    if set_aside(s, h, s.new, s.slope, 0.0) == 0:
        return 0
    return converge(s, p, h)


def allow_roundoff(s: Radau, p: SparseNewton, h: float, sigma: float) -> bool:
    """Adapt the tolerances to the roundoff in a step h.

    In an explicit step a rate's roundoff has the effect roundoff times h. For an
    implicit step, which damps the errors of stiff rates, this is an upper bound. If
    this bound would hide significant errors, it is limited, and samples replace it.

    Return False, without an effect, if this has been done for this step, else True.

    sigma : see `control.bound_roundoff`.
    """
    # After a rejection the samples alone are renewed.
    limited = s.rounding_known > 0.0 and s.sampled_h > 0.0 and s.sampled_h != h
    if not limited:
        if not control.bound_step(s, p, h, s.new, s.slope, sigma):
            return False
        limited = sigma >= 1.0 and limit_roundoff(s, h)
    if limited:
        sample_roundoff(s, p, h)
        for i in range(s.n, s.size):
            sampled = min(s.disturbed[i] / h, float(s.bounded[i]))
            s.roundoff[i] = max(s.roundoff[i], sampled)
        s.rounding_known = control.MOST_WAYS
    control.adapt_to_roundoff(s, p, h, s.new, s.slope)
    return True


def limit_roundoff(s: Radau, h: float) -> bool:
    """Limit the roundoff bounds of the rates by the changes in the step h.

    Return whether a bound has been reduced.
    """
    limited = False
    part = ASSUMED * LOCAL * s.rtol / h
    for i in range(s.n, s.size):
        most = part * abs(s.Z[2 * s.size + i])
        s.bounded[i] = s.roundoff[i]
        if s.roundoff[i] > most:
            s.roundoff[i] = most
            limited = True
    return limited


def sample_roundoff(s: Radau, p: SparseNewton, h: float) -> None:
    """Sample the effect of roundoff on the error estimate of a step h, in `disturbed`.

    The rates are evaluated at states displaced by a few units of roundoff. Their
    changes are multiplied by the inverse of the Newton matrix, as the error estimate
    is. The errors of several rates that contain one rounded term are correlated; in a
    sample they cancel as in the step.
    """
    if s.sampled_h == h:
        return
    s.sampled_h = h
    s.disturbed[:] = 0.0
    changes = s.F[s.size :]
    for way in range(SAMPLES):
        units = FAR if way % 2 == 0 else NEAR
        change = units * UNIT_ROUNDOFF
        for i in range(s.size):
            s.z[i] = s.y[i] + change * s.reach[i] * signed(i, way)
        derivative(s.t * (1.0 + change * signed(s.size, way)), s.z, p, changes)
        s.evaluations += 1.0
        for i in range(s.size):
            changes[i] -= s.slope[i]
            if not abs(changes[i]) < OVERFLOW:
                changes[i] = 0.0
        solve(1, s, p, changes)
        for i in range(s.size):
            s.disturbed[i] = max(s.disturbed[i], SAMPLED / units * abs(changes[i]))


def signed(i: int, way: int) -> float:
    """Return a pseudorandom number in [-2, -1] or [1, 2] for component i and `way`."""
    part = 2.0 * control.pseudorandom(i, way) - 1.0
    return part + 1.0 if part > 0.0 else part - 1.0


def estimate(s: Radau, p: SparseNewton, h: float) -> float:
    """Return the error of the step h in tolerances: IV.8 (8.19), or (8.20).

    The estimate (8.20) is used in the first step and after a rejection, if (8.19) is
    too large.
    """
    size, errors, F = s.size, s.errors, s.F
    for i in range(size):
        F[i] = total(ERROR[k] * s.Z[k * size + i] for k in unrolled(3)) / h
        errors[i] = F[i] + s.slope[i]
    error = filtered(s, p, h, errors)
    if error >= 1.0 and (s.previous_h == 0.0 or s.jacobian == 2.0):
        s.z[:] = s.y + errors
        derivative(s.t, s.z, p, errors)
        s.evaluations += 1.0
        s.errors[:] += F[:size]
        error = filtered(s, p, h, errors)
    return error


def filtered(s: Radau, p: SparseNewton, h: float, errors: Floats) -> float:
    """Solve for the errors (size,) in place; return their norm in tolerances.

    The tolerance is that of the estimate, which varies as h^4, while the error of the
    whole motion varies as h^5: with the estimate held to tolerance^(4/5), the error is
    proportional to the tolerance (RADAU5 uses 2/3).

    errors : the right side of (8.19) or (8.20).
    """
    solve(1, s, p, errors)
    error = norm(1, s.size, errors, s.tolerances) * s.rtol**0.2
    if CONSTRAINED and error >= 1.0 and constraints.hides_error(s, p):
        constraints.note_directions(s, p, s.t + h, s.new)
        removed = constraints.forget_removed(s, p, h, errors)
        left = norm(1, s.size, errors, s.tolerances) * s.rtol**0.2
        error = constraints.curved_error(s, removed, left)
    return float(error)


def accept(s: Radau, p: SparseNewton, h: float) -> None:
    """Accept the new state after a step h; store the dense output of the step.

    Its derivative interpolates the slopes at the start and at the stages.
    """
    size, slope, new = s.size, s.slope, s.new
    for i in range(size):
        first = h * s.last_slope[i]
        if s.previous_h == 0.0:
            # f(y0) of a fast motion that begins here would bend the whole step: the
            # slope of the stages' polynomial, with its residual damped as by (8.19).
            # Within the tolerance f(y0) is right, and rounding may point elsewhere.
            damped = GAMMA * s.errors[i] - total(
                ERROR[k] * s.Z[k * size + i] for k in unrolled(3)
            )
            if abs(damped - first) > s.tolerances[i]:
                first = damped
        s.dense[i] = s.y[i]
        for m in unrolled(4):
            s.dense[(m + 1) * size + i] = first * DENSE[m][0] + total(
                DENSE[m][k + 1] * s.Z[k * size + i] for k in unrolled(3)
            )
        s.last_slope[i] = total(SLOPE[k] * s.Z[k * size + i] for k in unrolled(3)) / h
    s.previous_h = h
    s.sampled_h = 0.0
    s.evaluations += 1.0
    if s.signals > 0:
        before = s.z
        before[:size] = slope
        derivative(s.t + h, new, p, slope)
        check_features(s, p, h, s.y, before, new, slope)
    else:
        derivative(s.t + h, new, p, slope)
    s.y[:] = new
    s.step_t = s.t
    s.step_h = h
    s.t = s.t + h
    s.steps += 1.0
    control.record_sizes(s, p)


def interpolate_rates(s: Radau, x: float, out: Floats) -> None:
    """Write the derivative of the dense output at x to components n ... of out (size,).

    The components written are the rates that follow q' in y'.
    """
    for i in range(s.n, s.size):
        slope = 0.0
        for m in unrolled(4):
            slope = slope * x + (4 - m) * s.dense[(4 - m) * s.size + i]
        out[i] = slope / s.step_h


# --- the equations of a step, and Newton's method for them
#
# For T^-1 Z, with Z the increments of the stages, the simplified Newton iteration
# decouples into one real and one complex system of the size of the state, whose size is
# halved, see `newton`.
#
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# section IV.8.

MOST = 10  # largest number of iterations
# Residual error of Newton's method, in parts of the tolerance; not below rounding.
LEFT = 0.03
ROUNDING = 20.0 * UNIT_ROUNDOFF


def full(s: Radau) -> int:
    """Return the number of rows of a dense Newton matrix, n + states."""
    return s.n + s.states


class Radau(State):
    """Memory of RADAU: stages, factors, and values carried from step to step."""

    rate: float  # rate of convergence in the last step
    left_over: float  # rate/(1 - rate), used in the next step
    # Numbers of rows, entries, and entries of the factors of Newton's matrix, if
    # sparse.
    unknowns: int
    entries: int
    filled: int
    previous_error: float  # error of the last accepted step, for predictive control
    previous_h: float  # size of the last step; 0 at the start of an arc
    factored_h: float  # the step size for which the matrix was factored; 0: none
    jacobian: float  # 0: to be evaluated; 1: of an earlier state; 2: of this one
    iterations: float
    sampled_h: float  # the step size for which roundoff was sampled; 0: none
    # upper bound of steps after a failure of Newton's method, which grows; 0: none
    ceiling: float
    slope: Floats = array("size")  # y' at the start of the step ...
    last_slope: Floats = array("size")  # ... by the polynomial of the step before
    z: Floats = array("size")
    disturbed: Floats = array("size")  # the effect of roundoff on the error estimate
    bounded: Floats = array("size")  # roundoff bounds of rates before they are limited
    new: Floats = array("size")
    errors: Floats = array("size")
    # y and four coefficients of the dense output
    dense: Floats = array(lambda s: 5 * s.size)
    Z: Floats = array(lambda s: 3 * s.size)  # the increments of the stages
    F: Floats = array(lambda s: 3 * s.size)  # slopes of the stages
    # The right side, then the change of T^-1 Z: the real system, then the complex one.
    W: Floats = array(lambda s: 3 * s.size)
    J: Floats = array(lambda s: s.entries or (s.size - s.n) * s.dynamic.stop)
    # The factors of the real matrix and of the complex one; their pivots if the
    # matrices are full; the eigenvalues over h and their squares; working memory.
    K: Floats = array(lambda s: s.filled or full(s) ** 2)
    pair: Floats = array(lambda s: 2 * (s.filled or full(s) ** 2))
    pivots: Floats = array(lambda s: 2 * full(s))
    g: Floats = array(lambda _: 6)
    x: Floats = array(lambda s: 2 * (s.n + max(full(s), s.unknowns)))


STATE = Radau
PARAMETERS = SparseNewton


def renew(s: Radau, p: SparseNewton, h: float) -> int:
    """Evaluate the Jacobian and factor the matrices of a step h, where this is due.

    Return 0 if a matrix is singular, else 1.
    """
    if s.jacobian == 0.0:
        jacobian(s.t, s.y, p, s.J)
        count = s.entries if SPARSE else (s.size - s.n) * s.dynamic.stop
        newton.zero_nonfinite(count, s.J)
        s.factorisations += 1.0
        s.jacobian = 2.0
        s.factored_h = 0.0
    # The last bits of h do not matter to the iteration.
    if abs(h - s.factored_h) <= SAME_STEP * h:
        return 1
    s.factored_h = h
    s.factorisations += 2.0
    s.g[0], s.g[2], s.g[3] = GAMMA / h, ALPHA / h, BETA / h
    if factor(1, s, p) > 0 and factor(2, s, p) > 0:
        return 1
    s.factored_h = 0.0
    return 0


def factor(width: Static, s: Radau, p: SparseNewton) -> int:
    """Factor the real (width 1) or complex (width 2) matrix of Newton's method.

    Return 0 if the matrix is singular, else 1.
    """
    g = s.g[2 * (width - 1) :]
    K = s.K if width == 1 else s.pair
    newton.square(width, g)
    if SPARSE:
        return newton.decompose_sparse(width, p, g, s.J, K, s.x)
    pivots = s.pivots[(width - 1) * full(s) :]
    return newton.decompose_newton(width, s, g, s.J, K, pivots)


def solve(width: Static, s: Radau, p: SparseNewton, r: Floats) -> None:
    """Solve the real (width 1) or complex (width 2) Newton system, in place.

    r : (size,), the right side, then the solution.
    """
    g = s.g[2 * (width - 1) :]
    K = s.K if width == 1 else s.pair
    if SPARSE:
        newton.solve_sparse(width, p, g, s.J, K, r, s.x)
    else:
        pivots = s.pivots[(width - 1) * full(s) :]
        newton.solve_newton(width, s, g, s.J, K, pivots, r, s.x)


def converge(s: Radau, p: SparseNewton, h: float) -> int:
    """Solve for the stages by simplified Newton; return 0 on failure, else 1.

    Section IV.8, (8.13); the rate of convergence predicts the remaining error. On
    failure s.h may become a step with which the iteration is expected to converge.
    """
    limit = max(LEFT, ROUNDING / (LOCAL * s.rtol))
    guess(s, p, h)
    error_factor = max(s.left_over, 2.0**-52) ** 0.8
    previous = 0.0
    rate = 0.0
    for iteration in range(MOST):
        size = newton_step(s, p, h)
        if not size < OVERFLOW:
            return 0
        if iteration > 0:
            latest = size / previous
            rate = latest if iteration == 1 else sqrt(rate * latest)
            error_factor = rate / (1.0 - rate) if rate < 0.99 else OVERFLOW
            ahead = MOST - 2 - iteration
            coming = error_factor * size * rate**ahead / limit
            diverges = coming >= 1.0 and error_factor * size > limit
            # Quotients alternate if the errors of J do: a single quotient is no rate.
            if diverges and (iteration > 1 or rate >= 0.99):
                if is_rounding(s, p, h):
                    apply_step(s)
                    s.iterations = iteration + 1
                    return 1
                if rate < 0.99:
                    slower = max(1e-4, min(20.0, coming))
                    s.h = 0.8 * h * slower ** (-1.0 / (4.0 + ahead))
                return 0
        previous = max(size, TINY)
        apply_step(s)
        if error_factor * size <= limit:
            s.rate = rate
            s.left_over = error_factor
            s.iterations = iteration + 1
            return 1
    s.iterations = MOST
    return 1 if is_rounding(s, p, h) else 0


def is_rounding(s: Radau, p: SparseNewton, h: float) -> bool:
    """Whether the last change W of T^-1 Z is roundoff of the rates, or of the state.

    T and Z are those of `newton_step`.

    A stiff force is evaluated at a rounded state, and further iterations do not reduce
    its error. The tolerances are raised to the roundoff. The result is False if the
    error estimate would reject this roundoff. In a step of a few units in the last
    place of the time, as before an end of an arc, the tolerance of a velocity is the
    rounding of its value.
    """
    errors = s.errors
    if CONSTRAINED and p.least_sigma < s.close_below:
        return False
    s.new[:] = s.y + h * s.slope  # stages may be far from any state of the motion
    while allow_roundoff(s, p, h, 1.0):
        pass
    change = size_of_change(s)
    if change * s.rtol**0.2 >= 1.0:
        return False
    sample_roundoff(s, p, h)
    for i in range(s.size):
        errors[i] = max(OF_STAGES * s.disturbed[i], s.roundoff[i] * h)
        errors[i] += 3.0 * ROUNDING * abs(s.y[i])  # rounding of a sum of three terms
    return change <= norm(1, s.size, errors, s.tolerances)


def guess(s: Radau, p: SparseNewton, h: float) -> None:
    """Set the first guess Z of the stages from the last step's polynomial, or to 0."""
    s.Z[:] = 0.0
    if s.previous_h > 0.0:
        for stage in unrolled(3):
            part = s.Z[stage * s.size :]
            interpolate(s, p, 1.0 + C[stage] * h / s.previous_h, part)
            part[: s.size] -= s.y


def newton_step(s: Radau, p: SparseNewton, h: float) -> float:
    """Compute the change W of T^-1 Z; return its norm in tolerances.

    Z (3 size,) are the increments of the stages; T (3, 3) splits the Newton system into
    a real and a complex one (section IV.8).
    """
    size, F, W, Z = s.size, s.F, s.W, s.Z
    for stage in unrolled(3):
        s.z[:] = s.y + Z[stage * size : (stage + 1) * size]
        derivative(s.t + C[stage] * h, s.z, p, F[stage * size :])
    s.evaluations += 3.0
    for i in range(size):
        a = total(T_INVERSE[0][k] * Z[k * size + i] for k in unrolled(3))
        b = total(T_INVERSE[1][k] * Z[k * size + i] for k in unrolled(3))
        c = total(T_INVERSE[2][k] * Z[k * size + i] for k in unrolled(3))
        W[i] = total(T_INVERSE[0][k] * F[k * size + i] for k in unrolled(3))
        real = total(T_INVERSE[1][k] * F[k * size + i] for k in unrolled(3))
        imaginary = total(T_INVERSE[2][k] * F[k * size + i] for k in unrolled(3))
        W[i] -= GAMMA / h * a
        W[size + 2 * i] = real - ALPHA / h * b + BETA / h * c
        W[size + 2 * i + 1] = imaginary - BETA / h * b - ALPHA / h * c
    solve(1, s, p, W)
    solve(2, s, p, W[size:])
    return size_of_change(s)


def size_of_change(s: Radau) -> float:
    """Return the norm of W, the change of T^-1 Z, in tolerances."""
    size, W = s.size, s.W
    real = norm(2, size, W[size:], s.tolerances)
    imaginary = norm(2, size, W[size + 1 :], s.tolerances)
    return norm(1, size, W, s.tolerances) + real + imaginary


def apply_step(s: Radau) -> None:
    """Add T W to Z, the increments of the stages, see `newton_step`."""
    size, W = s.size, s.W
    for i in range(size):
        for j in unrolled(3):
            pair = T[j][1] * W[size + 2 * i] + T[j][2] * W[size + 2 * i + 1]
            s.Z[j * size + i] += T[j][0] * W[i] + pair


def norm(stride: Static, size: int, x: Floats, tolerances: Floats) -> float:
    """Return the root mean square of `size` numbers of x over the tolerances (size,).

    The numbers are x[0], x[stride], ...; components with a tolerance of 0 do not count.
    0 if none counts.
    """
    square = 0.0
    controlled = 0
    for i in range(size):
        if tolerances[i] > 0.0:
            part = control.against(x[stride * i], tolerances[i])
            square += part * part
            controlled += 1
    if controlled == 0:
        return 0.0
    return sqrt(square / controlled)


def interpolate(s: Radau, p: SparseNewton, x: float, out: Floats) -> None:  # noqa: ARG001
    """Write the state (size,) at the fraction x of the last step, also beyond 1."""
    for i in range(s.size):
        value = 0.0
        for m in unrolled(4):
            value = (value + s.dense[(4 - m) * s.size + i]) * x
        out[i] = s.dense[i] + value


# --- coefficients ---------------------------------------------------------------------
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# sections IV.5 and IV.8.

R = sqrt(6.0)
A = (
    ((88.0 - 7.0 * R) / 360.0, (296.0 - 169.0 * R) / 1800.0, (3.0 * R - 2.0) / 225.0),
    ((296.0 + 169.0 * R) / 1800.0, (88.0 + 7.0 * R) / 360.0, (-3.0 * R - 2.0) / 225.0),
    ((16.0 - R) / 36.0, (16.0 + R) / 36.0, 1.0 / 9.0),
)
B = A[2]
C = ((4.0 - R) / 10.0, (4.0 + R) / 10.0, 1.0)

# A^-1 T = T [GAMMA, 0, 0; 0, ALPHA, -BETA; 0, BETA, ALPHA]. Eigenvectors are, at the
# nodes, the sum of N^(k)/mu^k over k, with N = (x - 1)(x^2 - 4 x/5 + 1/10).
GAMMA = 3.6378342527444957
ALPHA, BETA = 2.6810828736277521, 3.0504301992474105
T = (
    (0.036684729172915112, 0.013748450783639650, -0.033958232556650483),
    (0.097195266112938672, -0.10468844842656654, 0.034056924834283473),
    (0.38844991406148168, -0.044224957030740838, 0.24980495329668131),
)
T_INVERSE = (
    (10.757419271537078, 0.84356517764397957, 1.3473460195349984),
    (4.8233627757121459, -9.7576805582265367, 1.9859873137983349),
    (-15.874007011153375, -3.0392344673271640, 2.2595779253684523),
)

# Error = (GAMMA/h - J)^-1 (f(y0) + sum ERROR_i Z_i / h), IV.8 (8.19): the difference to
# an embedded formula of order 3 that also uses f(y0).
ERROR = (-(13.0 + 7.0 * R) / 3.0, (-13.0 + 7.0 * R) / 3.0, -1.0 / 3.0)

# h times the slope at the end of the step, sum SLOPE_i Z_i: the last row of A^-1.
SLOPE = (5.5319726474218083, -7.5319726474218083, 5.0)
# The polynomial with the slopes of the stages at the nodes, and f(y0) at 0: for x^1 to
# x^4 the coefficients of h f(y0) and of the Z_i.
DENSE = (
    (1.0, 0.0, 0.0, 0.0),
    (-4.5, 19.590050852146731, 4.0766158145199360, -7.0 / 6.0),
    (6.0, -44.712074351715270, -0.62125898161806378, 4.0 / 3.0),
    (-2.5, 25.122023499568539, -3.4553568329018722, 5.0 / 6.0),
)

TABLEAU = Tableau(A, B, C, ORDER)
amplification = TABLEAU.amplification
