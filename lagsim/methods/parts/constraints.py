"""Projection onto the constraints: positions, then velocities.

Newton's method in the metric of M at the current iterate (Hairer and Wanner, Solving
ODEs II, section VII.2). The M-metric velocity projection never raises the kinetic
energy where the constraints are homogeneous in the velocities.
"""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods.parts.control import Control
from lagsim.methods.parts.parameters import NOTE, Parameters
from lagsim.methods.parts.state import (
    LOCAL,
    derivative,
    interpolate,
    position_step,
    velocity_step,
)
from lagsim.native.layout import array
from lagsim.tolerances import (
    CONVERGED,
    OVERFLOW,
    RESIDUAL_ROUNDOFF,
    SUM_ROUNDOFF,
    TERM_ROUNDOFF,
)

MOST = 12


class Rank(Control):
    """Memory of the rank of the constraint Jacobian, and of projection residuals."""

    sigma: float  # about the smallest singular value of the scaled Jacobian
    sigma_slope: float  # the largest rate of change of sigma so far
    close_below: float  # sigma below this is close to a loss of rank
    degenerate_below: float  # at sigma below this the kernel returns; 0: never
    lost_at: float  # the time of the last loss of rank
    watched: float  # 1 if the last step is to be searched for a loss of rank
    early: float = 0.184  # the fraction of a step at which a near loss is passed
    passes: float  # 1 if the last trial step was to pass a loss of rank
    falling: float  # the last rate of decrease of sigma, per unit of time
    # the planned step over a loss of rank, once there is room for it; or 0
    planned: float
    planned_at: float  # the time at which this step was planned
    tried: float  # the error of the last step over a loss that was rejected; or 0
    fixed_rows: float  # 1 if all constraints are holonomic and independent of time
    missed: float  # the largest relative residual before a projection
    satisfied: float  # rows up to this part of the last step are not projected
    step_ahead: Floats = array(lambda s: s.n + 3)  # the result of `velocity_step` there


def project_step(s: Rank, p: Parameters, t: float, h: float, new: Floats) -> int:
    """Project the new state (size,) of a step h to time t; return 0 on failure, else 1.

    The smallest singular value of the rows there is recorded.
    """
    if project(s, p, t, h, new, s.work) == 0:
        return 0
    record_sigma(s, s.work[s.n + 1], h)
    return 1


def project(s: Rank, p: Parameters, t: float, h: float, y: Floats, work: Floats) -> int:
    """Project y (size,) at time t onto the constraints, in place.

    Return 1 if Newton's method converged, else 0. h is the length of the step that led
    to y.

    work : (n + 3,), working memory; on return work[n + 1] is the singular value of
        `velocity_step`.
    """
    s.missed = 0.0
    for level in range(2):
        if project_level(level, s, p, t, h, y, work) == 0:
            return 0
    return 1


def project_level(
    level: int, s: Rank, p: Parameters, t: float, h: float, y: Floats, work: Floats
) -> int:
    """Project the positions (level 0) or the velocities (level 1) of y (size,) alone.

    Return 1 if Newton's method converged, else 0. t, h and work as in `project`.
    """
    n = s.n
    part = y[level * n :]
    previous = 0.0
    for iteration in range(MOST):
        if level == 0:
            position_step(t, y, p, work)
        else:
            velocity_step(t, y, p, work)
        if not is_finite(n, work):
            return 0
        if iteration == 0:
            s.missed = max(s.missed, work[n])
        # Residuals shrink by more than half, or they are rounding.
        stalled = iteration > 0 and work[n] >= 0.5 * previous
        done = work[n + 2] <= TERM_ROUNDOFF or work[n] <= RESIDUAL_ROUNDOFF
        if not done:
            done = is_small(level, s, h, part, work) > 0
        if stalled:
            return 1 if done or work[n] <= CONVERGED else 0
        part[:n] += work[:n]
        if done:
            return 1
        previous = work[n]
    return 0


def is_small(level: int, s: Rank, h: float, x: Floats, step: Floats) -> int:
    """Whether a Newton step (n,) is rounding of coordinates, in the metric of M.

    Sizes are weighted by the shares of coordinates in the Newton step, so that a heavy
    body that hardly moves sets no scale for a light one joined to it.

    level, x : 0 and positions (n,), or 1 and velocities (n,).
    h : the length of the step of the method; the displacement that forces could cause
        within h counts as a size, which is the scale of a structure at rest.
    """
    n = s.n
    sizes = s.sizes[level * n :]
    masses = s.masses
    moment = h if level > 0 else h * h
    moved = 0.0
    for i in range(n):
        moved += masses[i] * step[i] * step[i]
    if moved == 0.0:
        return 1
    whole = 0.0
    for i in range(n):
        share = masses[i] * step[i] * step[i] / moved
        largest = max(abs(x[i]), sizes[i], moment * s.parts[i])
        whole += share * masses[i] * largest * largest
    return 1 if moved <= SUM_ROUNDOFF * SUM_ROUNDOFF * whole else 0


def is_finite(n: int, x: Floats) -> bool:
    """Whether all components of x (n,) are finite."""
    largest = 0.0
    for i in range(n):
        if not abs(x[i]) < OVERFLOW:
            largest = OVERFLOW
    return largest < OVERFLOW


def largest_part(level: int, s: Rank, h: float, x: Floats, step: Floats) -> float:
    """Return the largest ratio of a change `step` (n,) to the size of its component.

    Other bodies do not matter, however heavy or far. The displacement that forces could
    cause in the time h counts as a size; the ratio is 1 for a component without a size,
    and OVERFLOW for a change that is not finite.

    level, x : 0 and positions (n,), or 1 and velocities (n,).
    """
    sizes = s.sizes[level * s.n :]
    moment = h if level > 0 else h * h
    largest = 0.0
    for i in range(s.n):
        change = abs(step[i])
        if not change < OVERFLOW:
            return OVERFLOW
        if change > 0.0:
            own = max(abs(x[i]), sizes[i], moment * s.parts[i])
            part = change / own if change < own * OVERFLOW else 1.0
            largest = max(largest, part)
    return float(largest)


# --- singular configurations: loss of rank of the constraint rows ---------------------
# sigma approximates the smallest singular value of the scaled constraint Jacobian. Near
# a singular configuration residuals of stages are divided by sigma, and rounding in a
# velocity by its square: steps that end there, or shrink on their way there, lose
# digits, and steps that pass it at a distance lose none.

# A loss of rank is close if sigma falls below this part of its usual value or of its
# largest value.
CLOSE = 0.03
# Safety factor of the observed rate of change of sigma.
MARGIN = 1.5
FASTER = 4.0
# Fractions of a step at which a loss of rank may lie: BETWEEN, or up to LATEST, or
# `early` if the loss is near, or up to AT_ONCE. There no method has a stage: `dop853`
# has stages at 0, 0.05, 0.08, 0.12, then from 0.25 to 0.33, and from 0.60 on; `dopri5`
# at 0.2, 0.3 and from 0.8 on; `radau` at 0.16 and from 0.64 on. The step before covers
# at least SHORT of the distance.
BETWEEN = 0.467
LATEST = 0.55
AT_ONCE = 0.026
SHORT = 0.4
# The step over a loss has the length of steps at a distance of this many steps.
NEAR = 4.0
# Largest relative error of a step over a loss; largest if shorter steps err more; the
# error, in tolerances, that such a step is given.
PASSABLE = 1e-10
WORST = 1e-6
ACCEPTED = 0.9
# Number of secants in the search for a loss ahead, each at half of the estimated
# distance: sigma falls there by about a half, or by less than FALLS without a loss.
SEARCHES = 3
FALLS = 0.8
# Part of the first step over which the change of sigma is computed.
GLANCE = 0.1


def record_sigma(s: Rank, sigma: float, h: float) -> None:
    """Store sigma, the smallest singular value of the rows, after a time h.

    `watched` becomes 1, so that the step is searched for a loss of rank, if sigma could
    have fallen to zero and risen again within h at the steepest slope so far.
    """
    slope = abs(sigma - s.sigma) / h
    s.falling = (s.sigma - sigma) / h
    s.close_below = max(s.close_below, CLOSE * sigma)
    s.sigma_slope = max(s.sigma_slope, slope)
    s.watched = 0.0
    if s.sigma + sigma <= MARGIN * s.sigma_slope * h:
        s.watched = 1.0
    s.sigma = sigma


def record_between(s: Rank, p: Parameters, sigma: float, h: float) -> None:
    """Store sigma after a step of length h, and sigma at the middle of the step.

    Sigma may vanish within a long step and have equal values at both ends; it is not
    evaluated between these if it would have to change faster than at any time so far by
    the factor FASTER.

    sigma : the value after the step.
    """
    if s.sigma + sigma > FASTER * s.sigma_slope * h > 0.0:
        record_sigma(s, sigma, h)
        return
    record_sigma(s, sigma_at(s, p, 0.5), 0.5 * h)
    watched = s.watched
    record_sigma(s, sigma, 0.5 * h)
    s.watched = max(s.watched, watched)


def clear_of_loss(s: Rank, p: Parameters, h: float, rest: float) -> float:
    """Return the step to try: h, or a step whose stages keep off a loss of rank.

    Near a loss, rounding errors are divided by sigma at each stage, and by sigma^2 at
    the end of a step. A step that passes the loss therefore has the loss between two of
    its stages, and the step before ends at the distance that this requires. The passing
    step is as long as steps were before the loss came near: close to it the controller
    would reduce steps by errors that projection removes.

    rest : the time to the end of the arc.
    """
    if s.passes > 0.0 and s.t <= s.planned_at:
        s.planned = 0.0  # the planned step has been tried
    s.passes = 0.0
    if s.falling <= 0.0:
        s.planned = s.tried = 0.0
        return h
    whole = min(max(h, s.planned), rest)
    ahead = s.sigma / s.falling
    s.planned = whole if ahead < NEAR * whole else 0.0
    if ahead >= (1.0 + BETWEEN) * whole:
        return h
    ahead = time_to_loss(s, p, ahead)
    if ahead <= 0.0:
        s.planned = 0.0
        return h
    if ahead >= (1.0 + BETWEEN) * whole:
        return h
    if ahead > LATEST * whole:
        return float(min(h, max(ahead - BETWEEN * whole, SHORT * ahead)))
    s.passes = 1.0
    s.planned_at = s.t
    if ahead > BETWEEN * whole or ahead <= AT_ONCE * whole:
        return float(whole)
    if ahead > s.early * whole:
        return float(ahead / BETWEEN)
    return float(ahead / s.early)


def needs_loops(s: Rank) -> bool:
    """Whether a failed step is to be repeated with the QR decomposition.

    True for a step over a loss of rank with straight-line code, which squares the
    condition number of the rows.
    """
    return float(s.passes) > 0.0 and float(s.degenerate_below) > 0.0


def time_to_loss(s: Rank, p: Parameters, ahead: float) -> float:
    """Return the time until rank is lost, or nearly so; 0 if no loss is seen.

    The time is found by secants through sigma along a parabola from the current state.

    ahead : the estimate from the recent slope of sigma.
    """
    n, y, rates, z, out = s.n, s.y, s.spare, s.work, s.step_ahead
    v, a = y[s.velocities], rates[s.velocities]
    derivative(s.t, y, p, rates)
    s.evaluations += 1.0
    before = 0.0
    sigma = s.sigma
    for _look in range(SEARCHES):
        t = before + 0.5 * (ahead - before)
        z[: s.size] = y
        z[:n] = y[:n] + t * (v[:n] + 0.5 * t * a[:n])
        z[s.velocities] = v[:n] + t * a[:n]
        velocity_step(s.t + t, z, p, out)
        if not out[n + 1] < FALLS * sigma:
            return 0.0
        ahead = t + out[n + 1] / (sigma - out[n + 1]) * (t - before)
        before = t
        sigma = out[n + 1]
    return ahead


def step_past_loss(s: Rank, p: Parameters, h: float) -> float:
    """Return a first step, h or longer, whose end is far from a loss of rank.

    If a step over the loss is to be repeated with another solver (`needs_loops`),
    return its planned length instead.
    """
    if s.passes > 0.0 and s.t <= s.planned_at:
        s.passes = 0.0
        return float(s.planned)
    s.sigma = sigma = sigma_ahead(s, p, 0.0)
    s.falling = (sigma - sigma_ahead(s, p, GLANCE * h)) / (GLANCE * h)
    # With another solver of the equations sigma has another rate of change.
    s.sigma_slope = max(s.sigma_slope, abs(s.falling))
    while sigma < s.close_below and s.t + 2.0 * h < s.end:
        h = 2.0 * h
        sigma = sigma_ahead(s, p, h)
    return h


def sigma_ahead(s: Rank, p: Parameters, h: float) -> float:
    """Return the smallest singular value of the rows at a time h after the present.

    Positions are extrapolated by the velocities.
    """
    n, z = s.n, s.work
    z[: s.size] = s.y
    z[s.positions] += h * s.y[s.velocities]
    velocity_step(s.t + h, z, p, s.spare)
    return float(s.spare[n + 1])


def sigma_at(s: Rank, p: Parameters, x: float) -> float:
    """Return the rows' smallest singular value at the fraction x of the last step."""
    interpolate(s, p, x, s.work)
    velocity_step(s.step_t + x * s.step_h, s.work, p, s.spare)
    return float(s.spare[s.n + 1])


def error_past_loss(s: Rank, error: float) -> float:
    """Return the error of a step in tolerances, lowered to pass a loss of rank.

    Where a step goes over a loss of rank, shorter steps have a smaller truncation error
    and more rounding: beyond the minimum of both, a shorter step loses all digits. The
    error there is set to ACCEPTED, unless it exceeds the bound for such steps.
    """
    if s.passes == 0.0 or error < 1.0:
        return error
    least = s.tried > 0.0 and error > s.tried
    s.tried = error
    bound = WORST if least else PASSABLE
    return ACCEPTED if error * s.rtol < bound else error


def hides_error(s: Rank, p: Parameters) -> bool:
    """Whether residuals of the constraints at the stages hide the error of a step.

    Close to a singular configuration, residuals at stages are divided by sigma. The
    error estimated off the constraints is then unrelated to the motion, which the
    constraints determine, but would reduce steps without end.
    """
    passes = s.passes > 0.0
    close = p.least_sigma < s.close_below
    return p.loops > 0 and (passes or close)


def note_directions(s: Rank, p: Parameters, t: float, new: Floats) -> None:
    """Store the directions in which projection will move the state `new` (size,).

    t : the time of that state.
    """
    p.least_sigma = NOTE
    velocity_step(t, new, p, s.work)


def forget_removed(s: Rank, p: Parameters, h: float, error: Floats) -> float:
    """Remove, from `error` (2 n,) of q and q', the part that projection removes.

    Return twice the kinetic energy of that part, as velocities (errors of q over h),
    relative to the energy of the mechanism.

    h : the length of the step.
    """
    n = s.n
    removed = 0.0
    for k in range(int(p.noted)):
        z = p.directions[n * k :]
        mass = p.momenta[n * k :]
        energy = energy_along(s, z, mass)
        for level in range(2):
            part = error[level * n :]
            share = 0.0
            for i in range(n):
                share += mass[i] * part[i]
            part[:n] -= share * z[:n]
            if energy > 0.0:
                removed += share * share / energy / (1.0 if level == 1 else h * h)
    return removed


def energy_along(s: Rank, z: Floats, mass: Floats) -> float:
    """Return twice the largest kinetic energy so far of the mechanism along z (n,).

    The mechanism consists of all coordinates that rows or the mass matrix couple to the
    largest component of the direction z; its energy is at most that of the whole model.

    mass : (n,), M z.
    """
    n = s.n
    speeds = s.sizes[s.velocities]
    most = 0
    for i in range(n):
        if abs(mass[i] * z[i]) > abs(mass[most] * z[most]):
            most = i
    energy = 0.0
    for i in range(n):
        if s.joined[i] == s.joined[most] and s.masses[i] > 0.0:
            energy += s.masses[i] * speeds[i] * speeds[i]
    return float(min(energy, 2.0 * s.energy))


def curved_error(s: Rank, removed: float, left: float) -> float:
    """Return the error of a step in tolerances, raised by the constraints' curvature.

    left : the error in tolerances after the part off the constraints is removed.
    removed : the relative energy of that part, see `forget_removed`, which is the
        square of its size relative to the speed and remains as an error of second
        order.
    """
    return float(max(left, removed / (LOCAL * s.rtol)))
