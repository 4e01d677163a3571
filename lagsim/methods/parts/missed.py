"""Missed-feature check and defect check of an accepted step.

A localized term (a hill, a wall, a gate) is flat to rounding except where its argument,
the signal, is close to one value; ends and stages of a step may all lie where it is
flat. A signal is smooth and resolved by the step: its values and slopes at both ends
and between them determine whether it comes closer to that value inside than at the
ends. If so, the dense output is searched (`search`) for the closest approach, and
there, and beside it, y' from the equations is compared with the slope of the dense
output. If they differ by more than the tolerance allows, the step is rejected, and the
next step is half as long as the way to that place.

The distance of a signal is -log of the term relative to one.
"""

from __future__ import annotations

from math import inf

from lagsim.language.arrays import Floats
from lagsim.methods.parts.control import (
    PERTURBED,
    move_aside,
    perturb,
    pseudorandom,
    set_reach,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.search_table import (
    BESIDE,
    BETWEEN,
    DEGREES,
    EVENT,
    KNOWN,
    LARGE,
    LARGEST,
    SIGNAL,
    SMALL,
    THIRD,
    SearchTable,
    distance,
    distance_from_activity,
    error_between,
    events,
    least_allowed,
    least_of,
    lowest,
    reuse_ends,
    rows,
    store_ends,
    value_at,
    variation,
    width,
)
from lagsim.methods.parts.state import (
    derivative,
    event_functions,
    interpolate,
    interpolate_rates,
    rounding,
    signals,
)
from lagsim.native.kernels.words import apart
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    OVERFLOW,
    TERM_ROUNDOFF,
    VALUE_ROUNDOFF,
)

SWITCHES = True


# A term that is e^1.4, four times, larger inside a step than at either end is searched;
# smaller variations are seen by the stages of a step.
APPROACH = 1.4
# Extrema by slopes that are differences may be lower than the hull of a cubic by less
# than this part of its height.
ROOM = 1.001
# A signal is also known if the error of its distance is below this.
FLAT = 0.1
# Largest difference, in tolerances, of y' from the equations and the slope of the dense
# output without a missed feature: dense output is of lower order.
PASSED = 1e4
# Number of golden sections that locate a closest approach to rounding. An approach
# within this part of a stretch from an end is at the end.
CLOSEST = 80
AT_END = 1e-9
# Growth of the distance on the shoulders of a closest approach, where slopes are
# compared as well: at the top of a hill itself there is no force.
SHOULDER = 0.3
FOOT = 8.0
# Number of doublings that lead from there to the other end of any step.
DOUBLINGS = 60


def next_end(s: SearchTable, p: Parameters) -> float:
    """Return the latest time at which a step may end: the arc's end, or a knot."""
    if p.passed < p.known:
        knot = p.knot_times[int(p.passed)]
        if knot < s.end - p.knot_distance:
            return float(knot)
    return float(s.end)


def check_features(
    s: SearchTable,
    p: Parameters,
    h: float,
    old: Floats,
    old_rates: Floats,
    new: Floats,
    new_rates: Floats,
) -> None:
    """Set `feature_possible`: 1 if a localized term may become active within a step h.

    old, old_rates, new, new_rates : (size,), y and y' at both ends.
    """
    shape_step(s, h, old, old_rates, new, new_rates)
    first = events(s)
    if not SWITCHES and s.end_step > 0.0 and s.end_time == s.t:
        reuse_ends(s, first, s.signals, h)
    else:
        sample_roughly(s, p, h, 0.0, BESIDE, s.starts)
    sample_end(s, p, h, new, new_rates)
    sample_roughly(s, p, h, BETWEEN, -BESIDE, s.middles)
    store_ends(s, first, s.signals, s.t + h, h, s.ends)
    s.places[1], s.places[2] = BETWEEN, 1.0
    s.places[0] = 0.0
    # At the end of an arc its closest approach may be that of the whole motion.
    s.feature_possible = 1.0 if s.t + h >= next_end(s, p) else 0.0
    for k in range(first, first + s.signals):
        if may_approach(s, k):
            s.feature_possible = 1.0


def shape_step(
    s: SearchTable,
    h: float,
    old: Floats,
    old_rates: Floats,
    new: Floats,
    new_rates: Floats,
) -> None:
    """Store polynomials of the state in the fraction u of a step h, in `shape`.

    The polynomials are cubics between the states old and new, with the rates old_rates
    and new_rates (size,) at the ends, and for positions also the terms that match the
    second derivatives there.
    """
    shape, n = s.shape, s.n
    old_a, new_a = old_rates[s.velocities], new_rates[s.velocities]
    for i in range(s.sampled):
        change = new[i] - old[i]
        A = h * old_rates[i]
        B = h * new_rates[i]
        P = 3.0 * change - 2.0 * A - B
        Q = A + B - 2.0 * change
        a = 0.0
        b = 0.0
        if i < n:
            # value u^2 (1 - u)^2 ((1 - u) a + u b) of the correction
            a = 0.5 * h * h * old_a[i] - P
            b = 0.5 * h * h * new_a[i] - P - 3.0 * Q
        k = DEGREES * i
        shape[k] = old[i]
        shape[k + 1] = A
        shape[k + 2] = P + a
        shape[k + 3] = Q + b - 3.0 * a
        shape[k + 4] = 3.0 * a - 2.0 * b
        shape[k + 5] = b - a


def sample_roughly(
    s: SearchTable, p: Parameters, h: float, x: float, beside: float, out: Floats
) -> None:
    """Estimate signals and their slopes at the fraction x of a step h, in out (2 R,).

    The signals are evaluated on the polynomials of `shape_step`.

    beside : the distance over which slopes are differenced, a power of 2.
    """
    z, shape, count, components = s.point, s.shape, rows(s), s.sampled
    first = events(s)
    for point in range(2):
        u = x if point == 1 else x + beside
        for i in range(components):
            k = DEGREES * i
            high = shape[k + 4] + u * shape[k + 5]
            middle = shape[k + 2] + u * shape[k + 3]
            low = shape[k] + u * shape[k + 1]
            z[i] = low + u * u * (middle + u * u * high)
        signals(s.t + u * h, z, p, out[first + (0 if point == 1 else count) :])
    set_slopes(s, 1.0 / beside, out)


def sample_end(
    s: SearchTable, p: Parameters, h: float, new: Floats, new_rates: Floats
) -> None:
    """Evaluate the signals and their slopes at the end of a step h, in `ends` (2 R,).

    new, new_rates : (size,), y and y' there; just before the end the state is
        extrapolated by y'.
    """
    z, first = s.point, events(s)
    part = BESIDE * h
    signals(s.t + h, new, p, s.ends[first:])
    for i in range(s.sampled):
        z[i] = new[i] - part * new_rates[i]
    signals(s.t + (1.0 - BESIDE) * h, z, p, s.ends[first + rows(s) :])
    set_slopes(s, -1.0 / BESIDE, s.ends)


def set_slopes(s: SearchTable, per: float, out: Floats) -> None:
    """Replace the signals beside a point, in the second half of out (2 R,), by slopes.

    The first half holds the signals at the point.

    per : 1/distance.
    """
    count = rows(s)
    for k in range(events(s), events(s) + s.signals):
        out[count + k] = (out[count + k] - out[k]) * per


def may_approach(s: SearchTable, k: int) -> bool:
    """Whether the term of signal k may become more active inside the stretch.

    True if the signal may be closer to activity of the term within the stretch than at
    both ends, or if values and slopes at the ends do not determine the signal in
    between. A signal without a value at the start belongs to a branch not in force.
    """
    if not abs(s.starts[k]) <= inf:
        return False
    if not signal_is_known(s, k):
        return True
    kind = s.kinds[k - events(s)]
    power = s.powers[k - events(s)]
    if SMALL <= kind <= LARGE and varies_little(s, k, power):
        return False
    on_left, on_right = nearest(s, k, 0), nearest(s, k, 1)
    if SMALL <= kind <= LARGE:  # a power of the signal
        # Distances differ by power log(largest/least), which is at most this.
        a, m, b = abs(s.starts[k]), abs(s.middles[k]), abs(s.ends[k])
        least = min(a, m, b, abs(on_left), abs(on_right))
        largest = max(a, m, b, abs(on_left), abs(on_right))
        if power * (largest - least) <= APPROACH * least:
            return False
    first = distance_from_activity(s, k, s.starts)
    middle = distance_from_activity(s, k, s.middles)
    last = distance_from_activity(s, k, s.ends)
    left = distance(kind, power, on_left)
    right = distance(kind, power, on_right)
    dip = min(first, max(middle, right, last)) - left
    dip = max(dip, min(max(first, left), max(right, last)) - middle)
    dip = max(dip, min(max(first, left, middle), last) - right)
    return dip > APPROACH


def varies_little(s: SearchTable, k: int, power: float) -> bool:
    """Whether a power of signal k varies by a factor below e^APPROACH in the stretch.

    Bounds are the hulls of the cubics on both sides of the middle point.

    power : the exponent.
    """
    count = rows(s)
    left = THIRD * BETWEEN * width(s)
    right = THIRD * (1.0 - BETWEEN) * width(s)
    a, m, b = s.starts[k], s.middles[k], s.ends[k]
    turn = s.middles[count + k]
    one = a + left * s.starts[count + k]
    two = m - left * turn
    three = m + right * turn
    four = b - right * s.ends[count + k]
    low = min(a, m, b, one, two, three, four)
    high = max(a, m, b, one, two, three, four)
    least = low if low > 0.0 else -high
    return float(power * (high - low) * ROOM) <= float(APPROACH * least)


def signal_is_known(s: SearchTable, k: int) -> bool:
    """Whether values and slopes at the ends of the stretch determine signal k within.

    It suffices that the distance of the signal is determined.
    """
    kind = s.kinds[k - events(s)]
    power = s.powers[k - events(s)]
    error = error_between(s, k)
    if not error < OVERFLOW:
        return False
    if error <= KNOWN * variation(s, k):
        return True
    m = s.middles[k]
    near = m - error if m > 0.0 else m + error
    if kind == LARGEST or (kind == LARGE and m > 0.0):
        near = m + error
    return abs(distance(kind, power, near) - distance(kind, power, m)) < FLAT


def closest(s: SearchTable, k: int) -> float:
    """Return a lower bound of the distance of signal k on the stretch."""
    kind, power = s.kinds[k - events(s)], s.powers[k - events(s)]
    before = distance(kind, power, nearest(s, k, 0))
    return min(before, distance(kind, power, nearest(s, k, 1)))


def nearest(s: SearchTable, k: int, half: int) -> float:
    """Return a bound of signal k in half of the stretch, on the side of its activity.

    The signal is nowhere closer than this bound to the value at which its term is
    active, see `search_table.lowest`.
    """
    kind = s.kinds[k - events(s)]
    low = lowest(1.0, s, k, half)
    u = -lowest(-1.0, s, k, half)
    if kind == LARGE:
        u = max(u, -low)
    elif kind != LARGEST:
        u = max(low, -u, 0.0)
    return u


def is_missed(s: SearchTable, p: Parameters, x: float) -> bool:
    """Whether y' has a feature at x that the dense output lacks.

    x : the fraction of the last step.
    """
    s.evaluations += 1.0
    return differs(s, p, x, PASSED) and not is_rounding(s, p, x, PASSED)


def missed_within(s: SearchTable, p: Parameters) -> float:
    """Return the fraction in the stretch at which a localized term is missed, or 0.

    The largest distance of each signal since its last approach is updated.
    """
    low, high = s.places[0], s.places[2]
    for k in range(events(s), events(s) + s.signals):
        own = k - events(s)
        if s.farthest[own] - closest(s, k) > APPROACH:
            x = least_of(SIGNAL, CLOSEST, s, p, k, low, high)
            # Or the signal comes closer still, or the next step begins there.
            inside = high - x >= AT_END * (high - low)
            if inside or (high == 1.0 and s.t >= next_end(s, p)):
                found = missed_about(s, p, k, x)
                if found > 0.0:
                    expect(s, p, found)
                    return found
                s.farthest[own] = value_at(SIGNAL, s, p, k, x)
        s.farthest[own] = max(s.farthest[own], distance_from_activity(s, k, s.ends))
    return 0.0


def missed_about(s: SearchTable, p: Parameters, k: int, x: float) -> float:
    """Compare y' at the closest approach of signal k, and at its shoulders.

    Return the fraction at which the slope of the dense output and y' of the equations
    differ, or 0 for none.

    x : the fraction of the last step at the closest approach.
    """
    if is_missed(s, p, x):
        return x
    least = value_at(SIGNAL, s, p, k, x)
    before = missed_on_side(s, p, k, x, least, -1.0)
    return before if before > 0.0 else missed_on_side(s, p, k, x, least, 1.0)


def missed_on_side(
    s: SearchTable, p: Parameters, k: int, x: float, least: float, way: float
) -> float:
    """Search one side of a closest approach for a slope that the dense output misses.

    The slope of the dense output is compared with y' of the equations at points where
    the distance of the signal exceeds its least value by more than SHOULDER and less
    than FOOT. If they differ at one, return the lesser of x and its fraction; else 0.

    k : the signal.
    x, least : the fraction of the step at its closest approach, and the distance there.
    way : -1 for the side before x, 1 for that after it.
    """
    beside = way * 2.0**-50
    for _ in range(DOUBLINGS):
        beside *= 2.0
        if not 0.0 < x + beside < 1.0:
            return 0.0
        far = value_at(SIGNAL, s, p, k, x + beside) - least
        if not far < FOOT:
            return 0.0
        if far > SHOULDER and is_missed(s, p, x + beside):
            return min(x, x + beside)
    return 0.0


# --- defect check: the dense output against y' from the equations ---------------------
# The defect at a row is y' from the equations less the slope of the dense output. Where
# it is too large, the step has passed over a feature, of any form, that was seen
# neither by its stages nor by its series; the step is rejected.
#
# Of the rows in a step every tenth is checked: no feature of ten rows is missed, and
# where no step has so many the check costs nothing. A step that is rejected without
# need is not made shorter than five rows by that; towards the last row with a defect,
# than LEAST of one.

# In output steps. A check costs about as much as a row.
APART = 10.0
LEAST = 2.0**-4
# The largest defect of a step without a missed feature, in tolerances. Over the shipped
# models, all their rows and five tolerances it was up to 14 (taylor), 100 (dop853) and
# 80 (radau), apart from defects allowed by `is_beyond`.
LEFT = 1e3
# Part of the change by a force in an output step.
EXPECTED = 1e-2


def find_defect(s: SearchTable, p: Parameters) -> float:
    """Return the fraction of the last step at which a row has a defect; 0 if none has.

    Of the rows of the output, every `APART`-th is examined, and the last one with a
    defect again. In a step over a loss of rank no row is examined.
    """
    s.defect_found = 0.0
    # The length of a step over a loss of rank is fixed.
    if s.passes > 0.0:
        return 0.0
    reach = min(s.t, s.row_limit)
    if s.defect_row >= s.row and time_of(s, s.defect_row) < reach:
        x = place(s, s.defect_row)
        if x * s.step_h > LEAST * s.row_step and is_off(s, p, x):
            return x
    k = s.row + APART - 1.0
    while time_of(s, k) < reach:
        x = place(s, k)
        if is_off(s, p, x):
            s.defect_row = k
            s.defect_found = 1.0
            return x
        k += APART
    return 0.0


def expect(s: SearchTable, p: Parameters, x: float) -> None:
    """Raise the sizes of components by the changes that the defect at x causes.

    Without these sizes, tolerances would be nearly 0 at the very beginning of a motion
    from rest. Sizes are unchanged if a mode has ended before x, since rates beyond its
    end have no meaning.

    x : the fraction of the last step.
    """
    if SWITCHES:
        interpolate(s, p, x, s.point)
        event_functions(s.step_t + x * s.step_h, s.point, p, s.values)
        for k in range(s.surfaces):
            if s.values[k] < least_allowed(EVENT, s, p, k):
                return
    n, delta = s.n, s.row_step
    sizes = s.sizes_before
    for i in range(n, s.size):
        push = EXPECTED * delta * abs(s.exact_rates[i] - s.point_rates[i])
        if push < OVERFLOW:
            sizes[i] = max(sizes[i], push)
            if i < s.velocities.stop:
                sizes[i - n] = max(sizes[i - n], delta * push)


def time_of(s: SearchTable, k: float) -> float:
    """Return the time of output row k, counted from the first row."""
    return float(s.row_start + k * s.row_step)


def place(s: SearchTable, k: float) -> float:
    """Return the fraction of the last step at which output row k lies."""
    return (time_of(s, k) - s.step_t) / s.step_h


def is_off(s: SearchTable, p: Parameters, x: float) -> bool:
    """Whether the defect at x exceeds rounding and tolerances.

    x : the fraction of the last step.
    """
    if not differs(s, p, x, LEFT) or is_rounding(s, p, x, LEFT):
        return False
    return is_beyond(s, p, x)


def is_rounding(s: SearchTable, p: Parameters, x: float, most: float) -> bool:
    """Whether rounding of the state alone can cause the defect stored by `differs`.

    The effect of rounding is computed at displaced states. It does not follow from
    derivatives, which are unbounded near the zero of a square root.

    x : the fraction of the last step.
    most : the bound, in tolerances, as in `differs`.
    """
    set_reach(s, p, s.point, s.exact_rates, 0.0)
    t = s.step_t + x * s.step_h
    perturb(s, p, t, s.point, s.exact_rates, TERM_ROUNDOFF, 2, s.far_before)
    for i in range(s.n, s.size):
        s.far_before[i] *= PERTURBED
    return not exceeds(s, most, s.far_before)


def hardly_varies(s: SearchTable, p: Parameters, k: int) -> bool:
    """Whether signal k varies by no more than rounding and tolerances on the stretch.

    Along a chain at rest, motion spreads with increasing powers of the time: at first
    no step, however short, resolves the shape of the signal.
    """
    return variation(s, k) <= moved_by_rounding(s, p, k, 1.0)


def is_zero(s: SearchTable, p: Parameters, k: int) -> bool:
    """Whether signal k is 0 on the stretch, except for roundoff.

    Where the terms of a switch's argument cancel, its sign is roundoff alone.
    """
    largest = float(max(abs(s.starts[k]), abs(s.middles[k]), abs(s.ends[k])))
    return largest <= CLEAR_OF_ROUNDING * moved_by_rounding(s, p, k, 0.0)


def moved_by_rounding(
    s: SearchTable, p: Parameters, k: int, tolerances: float
) -> float:
    """Return the change of signal k by rounding of time and state at the stretch's end.

    tolerances : displacement of the state that is added to its rounding, in units of
        the tolerances of its components.
    """
    z, now, x = s.point, s.values[events(s) :], s.places[2]
    most, t = 0.0, s.step_t + x * s.step_h
    for way in range(2):
        interpolate(s, p, x, z)
        part = TERM_ROUNDOFF if way == 0 else -TERM_ROUNDOFF
        move_aside(s.size, z, z, part, way, z)
        move_within(s, tolerances, way, z)
        signals((1.0 + part) * t, z, p, now)
        most = max(most, float(abs(s.values[k] - s.ends[k])))
    return most


def is_beyond(s: SearchTable, p: Parameters, x: float) -> bool:
    """Whether the defect that `differs` stored exceeds the tolerances.

    The state has an error of LEFT tolerances. The change of y' by such an error, where
    y' is stiff or close to a loss of rank, and the rounding of y' are allowed.

    x : the fraction of the last step.
    """
    t = s.step_t + x * s.step_h
    z = s.point
    rounding(t, z, p, s.work)
    move_within(s, LEFT, 0, z)
    derivative(t, z, p, s.spare)
    for i in range(s.n, s.size):
        s.spare[i] = abs(s.spare[i] - s.exact_rates[i])
        s.spare[i] += VALUE_ROUNDOFF * abs(s.work[i - s.n])
    return exceeds(s, LEFT, s.spare)


def exceeds(s: SearchTable, most: float, besides: Floats) -> bool:
    """Whether the defect of a rate exceeds `most` tolerances plus `besides` (size,)."""
    for i in range(s.n, s.size):
        allowed = most * s.tolerances[i] / s.step_h + besides[i]
        defect = abs(s.exact_rates[i] - s.point_rates[i])
        if s.tolerances[i] > 0.0 and not defect <= allowed:
            return True
    return False


def move_within(s: SearchTable, tolerances: float, way: int, z: Floats) -> None:
    """Move a state z (size,), in place, by about `tolerances` times the tolerances.

    Each component is moved by a part and sign of its own, since equal changes may
    cancel.

    way : 0 or 1, the direction.
    """
    for i in range(s.size):
        part = 2.0 * pseudorandom(i, way) - 1.0
        part += 0.5 if part > 0.0 else -0.5
        z[i] += part * tolerances * s.tolerances[i]


def differs(s: SearchTable, p: Parameters, x: float, most: float) -> bool:
    """Whether the defect at the fraction x exceeds `most` tolerances; store both rates.

    The rates are `point_rates`, of the dense output, and `exact_rates`, of the
    equations.
    """
    interpolate_rates(s, x, s.point_rates)
    interpolate(s, p, x, s.point)
    derivative(s.step_t + x * s.step_h, s.point, p, s.exact_rates)
    s.far_before[:] = 0.0
    return exceeds(s, most, s.far_before)


def store_extents(s: SearchTable) -> None:
    """Store the sizes and ranges of the state's components before a step.

    They are restored if the step is shortened to end at an event.
    """
    sizes, low, high = s.sizes, s.low, s.high
    sizes_before, low_before, high_before = s.sizes_before, s.low_before, s.high_before
    for i in apart(s.size):
        sizes_before[i] = sizes[i]
        low_before[i] = low[i]
        high_before[i] = high[i]


def restore_extents(s: SearchTable) -> None:
    """Restore the sizes and ranges that were stored before the last step."""
    s.sizes[:] = s.sizes_before
    s.low[:] = s.low_before
    s.high[:] = s.high_before


def reject_step(s: SearchTable, p: Parameters, x: float) -> None:
    """Reject the last step; the next step ends halfway to its fraction x.

    The state is that at the start of the rejected step.
    """
    interpolate(s, p, 0.0, s.point)
    s.y[:] = s.point[: s.size]
    restore_extents(s)
    s.t = s.step_t
    s.most_step = 0.5 * x * s.step_h
    s.steps -= 1.0
    s.rejections += 1.0
    s.cut = 0.0
    s.fresh = 1.0
