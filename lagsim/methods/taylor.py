"""Taylor: the power series of the motion, computed on the expression graph.

Recurrences give the coefficients of the power series up to order K, operation by
operation. The method for tight tolerances; it takes longer to compile than others.

- **Code.** Straight-line code or, if that is long, a loop over the order with
  vectorised products.
- **Order.** K follows from the tolerance: 17 at the default.
- **Step.** It follows from the last four coefficients. The last two alone vanish at a
  symmetric start, and the error would then grow without a warning.
- **Error.** The next step's series, which is needed anyway, gives the defect of the
  equations at the end of the step; a step that is too long is repeated. If most steps
  are too long, or nearly so, the model is stiff.
- **Rows** between steps are values of the series, to full order.
- **Stability.** On the imaginary axis order 17 grows for step * frequency below 1.66
  and above 4.97, by less than its truncation error, which limits the step.
- **Limits.** If an expression has a value but no derivatives (drag that grows with the
  square of the speed, at rest), there is no series, and `dop853` continues.

Sources: A. Jorba and M. Zou, Experimental Mathematics 14 (2005), sections 3.1 to 3.3;
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd
ed., section I.8.
"""

from __future__ import annotations

import math
from math import exp, floor, log

from lagsim.language.arrays import Floats
from lagsim.methods import unrestricted
from lagsim.methods.parts import constraints, control
from lagsim.methods.parts import state as at
from lagsim.methods.parts.driver import State, usable_step
from lagsim.methods.parts.first_step import foresee
from lagsim.methods.parts.onset import (
    LIMITED,
    set_aside,
    sides_are_clear,
    spread_scales,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import (
    LOCAL,
    bend,
    check_features,
    extend,
    lengthen,
    reached,
    reached_twice,
    series,
    slope,
    weigh,
)
from lagsim.native.elementary import BIAS, ONE_POWER
from lagsim.native.graph.polynomials import LAST_ORDERS, MOST_BEYOND
from lagsim.native.kernels.words import apart, bits, from_bits
from lagsim.native.layout import array
from lagsim.tolerances import OVERFLOW, SQUARABLE, STATE_ROUNDOFF, TINY

NAME = "taylor"
TITLE = "Taylor series, order from the tolerance"
ORDER = 17  # at the default tolerance
DENSE_ORDER = 17
ADAPTIVE = True
IMAGINARY_LIMIT = 4.97
HANDLES = "smooth models, not large; equality constraints"

# whether a series can be generated is found when its code is estimated
refusal = unrestricted
NEEDS = ("series",)
STATES = True

CONSTRAINED = True
SWITCHES = True

LEAST_ORDER = 4
# Orders above that of least cost for a series alone (Jorba and Zou): costs that do not
# depend on the order (check, projection, rows) are shared by longer steps. Measured at
# equal errors of 1e-7 to 1e-12: six scenes take 0.90 to 0.97 of the time.
MORE_ORDERS = 2
# At tight tolerances steps of lower order, shorter and more of them, cost the same and
# average more of the rounding of forces.
TIGHT_ORDER = 14
# A repeated step is shortened by at least the first factor and at most the second. An
# error up to the third number of tolerances is accepted. The a priori bound permits a
# decaying mode 0.8 of a tolerance (order 13), and errors vary about that: with 1 in
# place of 2, 4 to 10 of 60 steps of Andrews' mechanism are repeated at 1e-8 to 1e-6, a
# sixth of the time, and the errors of the motion are no smaller. Where rounding sets a
# tolerance 1 is needed: beside a change point far from the origin a larger error is
# rounding that the loss of rank enlarges, and the motion would take the other branch.
PASSED = 2.0
SHORTER = 0.9
# Number of steps for which terms of forces are reused while they are far from being a
# scale.
SPARED = 15.0
# The reason for a step shorter than this part of the last one is examined.
SUDDEN = 0.7
# Up to this fraction of a step the series at its start has the smaller residual.
HALF = 0.5
UNKNOWN = -1.0
# Number of iterations that make the first step and its tolerances consistent, and the
# tolerance of the iteration.
PASSES = 20
SETTLED = 0.7
SHORTEST = 0.2
# Part of the first step in which the bound of the motion by its series is close.
CLOSE = 0.25


def order_for(rtol: float) -> int:
    """Return the order for a relative tolerance rtol (Jorba and Zou, (3-5))."""
    order = math.ceil(1.0 - 0.5 * math.log(LOCAL * max(rtol, TINY))) + MORE_ORDERS
    most = TIGHT_ORDER if rtol < control.TIGHT else MOST_ORDER
    return min(max(order, LEAST_ORDER), most)


def amplification(z: complex) -> float:
    """Return |sum_k z^k / k!|, k up to ORDER: the growth in a step with h L = z.

    L : the eigenvalue of y' = L y.
    """
    return abs(sum(z**k / math.factorial(k) for k in range(ORDER + 1)))


def start(s: Taylor, p: Parameters) -> None:
    """Begin an arc: compute the series at the start, and choose the first step."""
    c = s.series
    s.which = 0.0
    series(s.t, s.y, p, c)
    s.evaluations += 1.0
    s.step_h = 0.0
    s.spared = 0.0
    s.alone = 0.0
    s.held_error = HELD * error_at_bound(c[0], safety(s))
    control.record_sizes(s, p)
    rates = c[1 + s.size :]
    control.bound_roundoff(s, p, s.t, s.y, rates, 1.0, 0.0, 1)
    foresee(s, p, rates)
    # Tolerances depend on the step, and on the motion of components at rest during the
    # step. A rejected step has an upper bound for the next trial.
    first = s.most_step if s.most_step > 0.0 else s.row_step
    longest = min(float(first), s.end - s.t)
    s.h = consistent_step(s, p, longest, OVERFLOW)
    if sets_off(s) and sides_are_clear(s, p, s.t, s.y):
        others = consistent_step(s, p, longest, 0.0)
        if others > LIMITED * s.h:
            lead(s.size, c, CLOSE * others, s.new)
            spread_scales(s, p, s.t, s.y, rates, s.new, CLOSE * others)
        s.h = consistent_step(s, p, longest, OVERFLOW)
    if CONSTRAINED:
        s.h = constraints.step_past_loss(s, p, s.h)


def sets_off(s: Taylor) -> bool:
    """Whether a component at rest is set in motion by others in the first instant."""
    foreseen = 0.0
    for i in range(s.velocities.stop):
        foreseen = max(foreseen, s.foreseen[i])
    return foreseen > 0.0


def consistent_step(s: Taylor, p: Parameters, longest: float, most: float) -> float:
    """Return the first step, at most `longest`, with tolerances that depend on it.

    A component at rest whose size after the first instant (`foreseen`) exceeds `most`
    is not controlled. Tolerances and step are computed in turn until the step settles.
    """
    c, h = s.series, longest
    for _ in range(PASSES):
        before = h
        lead(s.size, c, before, s.new)
        control.set_tolerances(s, p, s.t, s.new, c[1 + s.size :], before)
        for i in range(s.velocities.stop):
            rests = s.high[i] == s.low[i] and (i >= s.n or s.y[s.n + i] == 0.0)
            if rests and s.foreseen[i] > most:
                s.tolerances[i] = 0.0
                s.steady = 0.0
        set_fineness(s)
        h = min(before, weighed_step(s, c, s.t))
        if h > SETTLED * before:
            break
    return h


def step(s: Taylor, p: Parameters) -> int:
    """Advance by one accepted step, or return a code other than DONE."""
    rejected = False
    trouble = at.STEP_TOO_SMALL
    while True:
        h = usable_step(s, p)
        if h == 0.0:
            return trouble
        if not attempt(s, p, h, rejected):
            s.h = SHORTEST * h
            trouble = at.NOT_FINITE
        elif CONSTRAINED and constraints.project(s, p, s.t + h, h, s.new, s.work) == 0:
            s.h = 0.25 * h
            trouble = at.PROJECTION_FAILED
        else:
            # The smallest singular value there, as computed by the projection.
            sigma = s.work[s.n + 1]
            error = check(s, p, h)
            if error <= 1.0 or error <= most_error(s, h):
                accept(s, p, h, rejected or error > s.held_error)
                if CONSTRAINED:
                    constraints.record_between(s, p, sigma, h)
                return at.DONE
            trouble = shorten(s, h, error)
            # Close to a loss of rank a series enlarges rounding by powers of the step.
            if CONSTRAINED and s.passes > 0.0:
                s.rejections += 1.0
                return at.LOSS_AHEAD
        rejected = True
        s.rejections += 1.0


def shorten(s: Taylor, h: float, error: float) -> int:
    """Set s.h to the step to try after a rejected step h; return the failure's code.

    error : in units of the tolerance.
    """
    if not error < OVERFLOW:
        s.h = SHORTEST * h
        return at.NOT_FINITE
    shorter = exp(log(most_error(s, h) / error) / (s.series[0] + 1.0))
    s.h = h * max(SHORTEST, SHORTER * shorter)
    return at.STEP_TOO_SMALL


def attempt(s: Taylor, p: Parameters, h: float, rejected: bool) -> bool:
    """Compute the state after a step h; return whether it is finite.

    rejected : whether a longer step from this state was rejected.
    """
    size = s.size
    c = s.series[present(s) :]
    if s.rtol < control.TIGHT and not rejected:
        control.find_drift(s, p, c[1 + size :], s.drift)
    reach(s, c, s.compensation, h, s.new)
    # The slope is added separately, so that the two sums do not wait for each other.
    slope(h, c, s.rates)
    return constraints.is_finite(size, s.new)


def check(s: Taylor, p: Parameters, h: float) -> float:
    """Return the error in tolerances of a step h, by the series at its end.

    There the rate of the old series differs from y' by (K + 1) y_(K+1) h^K and higher
    terms; y' is that of the next step's series.
    """
    size = s.size
    c = s.series[present(s) :]
    following = s.series[former(s) :]
    series(s.t + h, s.new, p, following)
    s.evaluations += 1.0
    if control.set_tolerances(s, p, s.t + h, s.new, c[1 + size :], h):
        set_fineness(s)
    error = misfit(s, c[0], following, h)
    most = most_error(s, h) if error > 1.0 else PASSED
    if error > most and sides_are_clear(s, p, s.t, s.y):
        error = error_at_onset(s, p, h, error)
    # The error may be rounding alone.
    doubtful = error > most and error < OVERFLOW
    while doubtful and control.allow_roundoff(s, p, h, s.new, c[1 + size :], 1.0):
        set_fineness(s)
        error = misfit(s, c[0], following, h)
        doubtful = error > most_error(s, h)
    return constraints.error_past_loss(s, error) if CONSTRAINED else error


def most_error(s: Taylor, h: float) -> float:
    """Return the error in tolerances up to which a step h is accepted, see `PASSED`."""
    return 1.0 if control.is_set_by_rounding(s, h) else PASSED


def accept(s: Taylor, p: Parameters, h: float, stability_limited: bool) -> None:
    """Accept the new state after a step h, and its series.

    The old series becomes the dense output.

    stability_limited : whether stability, and not accuracy, may limit the step.
    """
    size, y = s.size, s.y
    following = s.series[former(s) :]
    rates = following[1 + size :]
    # First the results that the next step needs, then the results that it does not wait
    # for.
    next_ = chosen_step(s, following[0], s.t + h)
    if next_ < SUDDEN * h and sides_are_clear(s, p, s.t + h, s.new):
        next_ = unlimited_step(s, p, h, next_)
    if s.signals > 0:
        before = s.series[present(s) + 1 + size :]
        check_features(s, p, h, y, before, s.new, rates)
    if CONSTRAINED:
        s.satisfied = satisfied_part(s, following[0] + 1.0)
        s.alone = s.satisfied
        s.longer = UNKNOWN
    s.which = 1.0 - s.which
    new, carried, compensation = s.new, s.carried, s.compensation
    for i in apart(size):
        y[i] = new[i]
        carried[i] = compensation[i]
    control.keep_compensation(s)
    s.step_t = s.t
    s.step_h = h
    s.t = s.t + h
    s.steps += 1.0
    renewed = s.spared == 0.0
    control.record_measured(s, p)
    free = not CONSTRAINED and not SWITCHES and p.m == 0 and p.works == 0
    if renewed and free and s.wide > 0.0:
        s.spared = SPARED
    s.h = next_
    if next_ < SUDDEN * h:
        # The last coefficients may consist of rounding.
        control.bound_roundoff(s, p, s.t, y, rates, 1.0, h, 1)
        control.set_tolerances(s, p, s.t, y, rates, h)
        set_fineness(s)
        s.h = weighed_step(s, following, s.t)
    s.at_bound = max(s.at_bound + (1.0 if stability_limited else -1.0), 0.0)


def error_at_onset(s: Taylor, p: Parameters, h: float, error: float) -> float:
    """Return the error of a step h in tolerances, raised for components at their onset.

    Such components begin to move by the motion of others, see `onset`.

    error : the error in tolerances so far.
    """
    c = s.series[present(s) :]
    after = s.series[former(s) :]
    rates = c[1 + s.size :]
    if set_aside(s, h, s.new, rates, 0.0) == 0:
        return error
    set_fineness(s)
    if misfit(s, c[0], after, h) <= PASSED:
        spread_scales(s, p, s.t, s.y, rates, s.new, h)
    control.compute_tolerances(s, p, s.new, rates, h)
    set_fineness(s)
    return misfit(s, c[0], after, h)


def unlimited_step(s: Taylor, p: Parameters, h: float, next_: float) -> float:
    """Return the length of the next step after a step h.

    It is `next_` unless components at their onset (see `onset`) limit it; these then
    have scales by the motion of others, and the length is computed again.
    """
    before = s.series[present(s) + 1 + s.size :]
    following = s.series[former(s) :]
    t = s.t + h
    if set_aside(s, h, s.new, before, 0.0) == 0:
        return next_
    set_fineness(s)
    others = weighed_step(s, following, t)
    if others > LIMITED * next_:
        rates = following[1 + s.size :]
        spread_scales(s, p, t, s.new, rates, s.new, others)
    control.compute_tolerances(s, p, s.new, before, h)
    set_fineness(s)
    return weighed_step(s, following, t)


def interpolate(s: Taylor, p: Parameters, x: float, out: Floats) -> None:  # noqa: ARG001
    """Write the state (size,) at the fraction x of the last step, by its series.

    With constraints the series at the nearer end is used: both ends are projected, and
    the residual grows with a high power of the distance. Where it would exceed rounding
    the series is continued beyond its order.
    """
    h = s.step_h
    late = CONSTRAINED and x > HALF
    if late:
        after = s.series[present(s) :]
        reach(s, after, s.compensation, (x - 1.0) * h, out)
    else:
        before = s.series[former(s) :]
        reach(s, before, s.carried, x * h, out)
    if CONSTRAINED:
        prolong(s, x, out)


def interpolate_rows(s: Taylor, p: Parameters, rows: Floats, count: int) -> None:
    """Write the states at the times of rows (count, 1 + size) in the last step.

    Two rows that are nearer to the same end of the step are computed side by side.
    """
    h, width = s.step_h, 1 + s.size
    before = s.series[former(s) :]
    after = s.series[present(s) :]
    k = 0
    while k < count:
        row, other = rows[k * width :], rows[min(k + 1, count - 1) * width :]
        x, further = (row[0] - s.step_t) / h, (other[0] - s.step_t) / h
        late = CONSTRAINED and x > HALF
        apart = CONSTRAINED and not late and further > HALF
        if apart or k + 1 == count or s.rtol < control.TIGHT:
            interpolate(s, p, x, row[1:])
            k += 1
            continue
        if late:
            back, less = (x - 1.0) * h, (further - 1.0) * h
            reached_twice(back, less, after, s.compensation, row[1:], other[1:])
        else:
            reached_twice(x * h, further * h, before, s.carried, row[1:], other[1:])
        if CONSTRAINED:
            prolong(s, x, row[1:])
            prolong(s, further, other[1:])
        k += 2


def prolong(s: Taylor, x: float, out: Floats) -> None:
    """Add the terms beyond the order to a state (size,) at x, if they are needed.

    x : the fraction of the last step.
    """
    late = x > HALF
    near = 1.0 - x if late else x
    if s.alone > 0.0 and near > s.alone and continues(s) > 0:
        more = s.beyond_order[int((1 + MOST_BEYOND) * s.n) if late else 0 :]
        lengthen(near, -s.step_h if late else s.step_h, more, out, out[s.velocities])


def satisfied_part(s: Taylor, order: float) -> float:
    """Return the fraction of the last step in which rows need no projection.

    Rows of the output nearer to an end of the step than this fraction need none. It is
    assumed that the dense output is a polynomial that begins at this end, and that the
    residual grows as x^order over the step, from rounding to the residual before the
    projection. If the constraints depend on time or velocities, rounding of times and
    positions adds to the residual, and the fraction is 0.
    """
    if s.fixed_rows == 0.0:
        return 0.0
    if s.missed <= STATE_ROUNDOFF:
        return 1.0
    part = rough_log2(max(LEAST_NUMBER, STATE_ROUNDOFF / s.missed)) / order
    return min(1.0, rough_power_of_two(part))


def continues(s: Taylor) -> int:
    """Whether the series at the ends of the last step are continued beyond their order.

    The terms are computed when they are first needed in a step; `satisfied` is then
    raised to the part of the step in which rows need no projection. The series are not
    continued if the terms do not decrease fast enough to gain by that.
    """
    if s.longer == UNKNOWN:
        n = s.n
        before = s.series[former(s) :]
        after = s.series[present(s) :]
        order = before[0]
        count = min(MOST_BEYOND, int(order) - 1)
        early, late = s.beyond_order, s.beyond_order[(1 + MOST_BEYOND) * n :]
        extend(s.step_h, before[n:], after[n:], early)
        extend(-s.step_h, after[n:], before[n:], late)
        first = 0.0
        last = 0.0
        for i in range(n):
            part = s.fineness[n + i]
            first = max(first, part * max(abs(early[n + i]), abs(late[n + i])))
            k = count * n + i
            last = max(last, part * max(abs(early[k]), abs(late[k])))
        s.longer = 0.0
        if 0.0 < last < first < OVERFLOW:
            # The remainder is about the first omitted term: by the decrease from the
            # first to the last term, times the error of the first term by this
            # decrease.
            more, fewer = 1.0, 1.0
            for j in range(count):
                more *= order + 2.0 + j
                fewer *= count + 1.0 + j
            left = rough_log2(max(LEAST_NUMBER, last / first))
            left = left * (count / (count - 1.0)) + rough_log2(more / fewer)
            if left < 0.0:
                s.longer = 1.0
                s.satisfied = s.alone * rough_power_of_two(-left / (order + 1.0))
    return int(s.longer)


def interpolate_rates(s: Taylor, x: float, out: Floats) -> None:
    """Write the derivative of the dense output at x to components n ... of out (size,).

    The components written are the rates that follow q' in y'.
    """
    if CONSTRAINED and x > HALF:
        slope((x - 1.0) * s.step_h, s.series[present(s) :], out)
        return
    before = s.series[former(s) :]
    slope(x * s.step_h, before, out)


# --- power series c = [order, y_0 (size,), ..., y_order]: the two series of a step, at
# its start and at its end

MOST_ORDER = 18
# Terms shrink by e^2 from one to the next at the step that costs least per unit of
# time (Jorba and Zou, proposition 3.1).
LOG2_SHRINK = 2.0 * 1.4426950408889634
# Numbers below this are subnormal.
LEAST_NUMBER = 2.0**-1000
# 1/k of each order k, and 1 for 0.
INVERSE = tuple(1.0 / max(k, 1) for k in range(MOST_ORDER + 1))
# Safety factor of the step by the a-priori bound; without it many steps fail the check
# (measured at 1e-8, elastic pendulum: 2 of 365; with 0.9: some 20, and errors larger by
# 2 to 8). Series of constrained motions fail rarely (Andrews' mechanism: 4 of 62). With
# 0.86 their runs take 5 % less time, but five of 24 runs through change points end on
# the other branch or lose digits, with 0.9 none.
SAFETY, HELD_SAFETY = 0.86, 0.9
# A step counts as limited by stability if its error is this part of that at the bound.
# Errors of other steps are about 0.3 of this error.
HELD = 0.9
# At tight tolerances truncation is kept below rounding, since it grows faster; and
# shorter steps average more of the rounding of forces.
TIGHT_SAFETY = 0.6
# Base-2 logarithm of an unbounded step.
UNBOUNDED = 1000.0
# Least-maximum fits of (log2(1 + f) - f)/(f (1 - f)) and of (1 + f - 2^f)/(f (1 - f))
# for 0 <= f <= 1, by powers of f.
OF_LOG2 = (0.43872574, -0.23905821, 0.08213067)
OF_POWER = (0.30699608, 0.06544626, 0.013702)


class Taylor(State):
    """Memory of two series, each its order K, then y_0 ... y_K, and a new state."""

    # error, in tolerances, from which a step counts as limited by stability
    held_error: float
    which: float  # index of the present one of the two series: 0 or 1
    series: Floats = array(lambda s: 2 * span(s))
    new: Floats = array("size")
    rates: Floats = array("size")  # rates by the series at the new state
    # 1/tolerance; 0 for components without error control
    fineness: Floats = array("size")
    # The compensation at the start of the last step, and its rate.
    carried: Floats = array("size")
    # Of the series weighed last: the largest terms of its last orders, and the error of
    # the slope at its start, in tolerances, see `state.weigh`.
    weighed: Floats = array(lambda _: LAST_ORDERS + 1)
    drift: Floats = array("size")
    # Up to this part of the last step from either end only the series of that end is
    # used; whether the series is continued beyond it: 1, 0, or UNKNOWN; and the
    # continued terms.
    alone: float
    longer: float
    beyond_order: Floats = array(lambda s: 2 * (1 + MOST_BEYOND) * s.n)


STATE = Taylor


def span(s: Taylor) -> int:
    """Return the length of a series in memory."""
    return 1 + (MOST_ORDER + 1) * s.size


def present(s: Taylor) -> int:
    """Return the index in `series` at which the present one of both begins."""
    return span(s) if s.which > 0.0 else 0


def former(s: Taylor) -> int:
    """Return the index in `series` at which the other one begins."""
    return 0 if s.which > 0.0 else span(s)


def reach(s: Taylor, c: Floats, compensation: Floats, h: float, out: Floats) -> None:
    """Evaluate the series c at a time h after its start; write the state to out.

    The roundoff is stored in `remainder`. At the end of the step this is the new state
    to the last bit, so that both are on one side of a switch.

    out : (size,).
    compensation : (size,), the compensation at the start, which is added.
    """
    if s.rtol >= control.TIGHT:
        reached(h, c, compensation, out, s.remainder)
        return
    size, remainder = s.size, s.remainder
    bend(h, c, remainder)
    control.add_exactly(size, c[1:], c[1 + size :], h, out, remainder)
    control.add_drift(s, s.drift, h)
    s.remainder[:] += compensation[:size]
    control.add_compensated(size, out, remainder, out, remainder)


def weighed_step(s: Taylor, c: Floats, t: float) -> float:
    """Return `chosen_step` from t, for a series c whose terms are not weighed yet."""
    weigh(c, s.rates, s.fineness, s.weighed)
    return chosen_step(s, c[0], t)


def chosen_step(s: Taylor, order: float, t: float) -> float:
    """Return a step from t, with the series weighed last, with an error in tolerance.

    If each of the last four terms is within its bound, and the terms decrease by e^2
    from one to the next, the first omitted term is within its bound, too. The result is
    at most the length of the arc, and 0 if a coefficient is not finite.

    order : the order of the series.
    """
    k, weighed = int(order), s.weighed
    arc = s.end - t
    if arc <= 0.0:
        return 0.0
    if not max(weighed[0], weighed[1], weighed[2], weighed[3]) < OVERFLOW:
        return 0.0
    logarithm = min(
        bound(weighed[3], 4.0 * LOG2_SHRINK, INVERSE[k - 3]),
        bound(weighed[2], 3.0 * LOG2_SHRINK, INVERSE[k - 2]),
        bound(weighed[1], 2.0 * LOG2_SHRINK, INVERSE[k - 1]),
        bound(weighed[0], LOG2_SHRINK, INVERSE[k]),
    )
    return min(safety(s) * rough_power_of_two(logarithm), float(arc))


def safety(s: Taylor) -> float:
    """Return the factor by which the step of the a priori bounds is shortened."""
    if s.rtol < control.TIGHT:
        return TIGHT_SAFETY
    return HELD_SAFETY if CONSTRAINED else SAFETY


def error_at_bound(order: float, factor: float) -> float:
    """Return the error, in tolerances, of a step that stability limits.

    The steps h for a decaying mode y' = -L y settle where h L is at the bound of
    stability, K/e + 1.4 within 1 % at order K. The last term is then e^2 factor^K by
    `chosen_step`, and the error is h L/(K + 1) of it.

    factor : the safety factor of the step.

    Examples
    --------
    >>> round(error_at_bound(13.0, 0.86), 2)
    0.46
    """
    reach = order * exp(-1.0) + 1.4
    return exp(2.0 + order * log(factor)) * reach / (order + 1.0)


def bound(term: float, shrink: float, part: float) -> float:
    """Return log2 h of the longest step h with `term` h^k at most 2^shrink.

    The error is 1e-4/k, small enough for the length of a step. The result is UNBOUNDED
    if the term is 0.

    term : |y_k|, the size of the coefficient of order k in tolerances.
    part : 1/k.
    """
    found = (shrink - rough_log2(max(term, LEAST_NUMBER))) * part
    return found if term > LEAST_NUMBER else UNBOUNDED


def rough_log2(x: float) -> float:
    """Return log2 x of a normal number x > 0, with an error of 1.2e-4.

    The result is computed from the exponent, and a polynomial of the significand that
    is exact at both ends.

    Examples
    --------
    >>> rough_log2(8.0), round(rough_log2(10.0), 3)
    (3.0, 3.322)
    """
    whole = bits(x) // ONE_POWER
    part = from_bits(bits(x) - (whole - BIAS) * ONE_POWER) - 1.0
    bend = OF_LOG2[0] + part * (OF_LOG2[1] + part * OF_LOG2[2])
    return (whole - BIAS) + (part + part * (1.0 - part) * bend)


def rough_power_of_two(x: float) -> float:
    """Return 2^x for |x| < 1022, with a relative error of 5e-6.

    Examples
    --------
    >>> rough_power_of_two(-2.0), round(rough_power_of_two(0.5), 4)
    (0.25, 1.4142)
    """
    whole = floor(x)
    part = x - whole
    bend = OF_POWER[0] + part * (OF_POWER[1] + part * OF_POWER[2])
    power = from_bits((whole + BIAS) * ONE_POWER)
    return power * (1.0 + (part - part * (1.0 - part) * bend))


def lead(size: int, c: Floats, h: float, out: Floats) -> None:
    """Write y_0 + sum_k |y_k| h^k (size,), a bound of the motion of the series c.

    The bound is written to out (size,).
    """
    order = int(c[0])
    for i in range(size):
        far = 0.0
        for back in range(order):
            far = (far + abs(c[1 + (order - back) * size + i])) * h
        out[i] = c[1 + i] + far


def misfit(s: Taylor, order: float, following: Floats, h: float) -> float:
    """Return a step's error in tolerances: the difference of y' at its end.

    The square of a finite error is finite. OVERFLOW if a difference is not finite. The
    terms of the next series are weighed for `chosen_step`.

    following : the series at the end, with y' by the equations; the other rate is that
        of the series at the start.
    order : the order of the series at the start.
    h : the length of the step.
    """
    weigh(following, s.rates, s.fineness, s.weighed)
    worst = s.weighed[LAST_ORDERS]
    return min(SQUARABLE, worst * (h / (order + 1.0))) if worst < OVERFLOW else OVERFLOW


def set_fineness(s: Taylor) -> None:
    """Store 1/tolerance of each component; 0 for a component that is not controlled."""
    tolerances, fineness = s.tolerances, s.fineness
    for i in range(s.size):
        tolerance = tolerances[i]
        part = 1.0 / max(LEAST_NUMBER, tolerance)
        fineness[i] = part if tolerance > 0.0 else 0.0
