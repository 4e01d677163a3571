"""Truth of located conditions at an instant, decided from their values and rates.

`search` locates where a condition becomes true within a step; the arrays `orientation`
and `leeway` store on which side of 0 the value of each condition is. At an instant the
state, its rates and the modes of the file may jump, and rounding leaves values of
either sign where the exact value is 0. Therefore the truth of each condition is decided
and stored here, first from the state just before the instant (`decide_before`,
`mark_satisfied`) and then from the state just after all acts, impacts and changes of
modes (`change`, `settle`). A value within its rounding of 0 counts as on the side to
which its rate leads, until the value has left the rounding.

Just before an instant a condition is false where its value is below 0, or is 0 and
falls. It is satisfied by the motion where its value has reached 0, or would reach 0
within the instant. After the instant a condition becomes true that was false and whose
value is now above 0, has jumped to 0, or is 0 and rises. An equation is satisfied where
its value reaches 0 or jumps past 0; its value is on one of two sides, and a value of 0
is on the side to which its rate leads.
"""

from __future__ import annotations

from math import inf, nan

from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.search_table import (
    SearchTable,
    error_of_component,
    error_of_state,
    margin,
    same_time,
)
from lagsim.methods.parts.state import derivative, located, located_slopes
from lagsim.tolerances import OVERFLOW, RESIDUAL_ROUNDOFF, SUM_ROUNDOFF

# Whether y' is known at an instant; methods with impulses at each step have
# accelerations after a step only.
RATED = True

# Largest value at a located zero, relative to the terms of the condition, that counts
# as the error to which the state is known (constraints are satisfied to such an error).
# A larger value is a jump of the condition.
LOCATED = 1e-7
# Least size up to which a value counts as 0: a true condition has a leeway, however
# small its terms are, and is followed until it ends.
LEAST = 1e-250
# A condition does not change at an instant if its value is farther from 0 than this
# multiple of its last zero tolerance, and than NEAR times its leeway.
FAR = 1024.0
NEAR = 4.0
# A value has jumped to 0 if its distance from 0 is within the error of the state, and
# the error at most this part of the jump.
LEAP = 2.0**-20
# Time over which one-sided rates are differenced, as a part of the last step. Ratio of
# the changes in this time and in half of it: at least that of a root, 1 for a jump; and
# the largest deviation from 2, the ratio of a linear change.
ASIDE = 2.0**-12
STEEPEST = 1.2
UNEVEN = 0.25


def evaluate_with_bounds(s: SearchTable, p: Parameters, found: int, way: int) -> None:
    """Evaluate all conditions at the state reached; store values, bounds and rates.

    `worth` has the values, `zero` the sizes up to which a value counts as 0, and
    `trend` the rates.

    found : the index of the condition located there, or -1; its value there bounds the
        error of the state.
    way : -1 for the rates just before the state, 1 for the rates just after it, where
        a condition has a kink (`abs(x) <= 0` at x = 0); 0 for the rates by the slopes.
    """
    slopes, rates = s.condition_slopes, s.exact_rates
    evaluate(s, p)
    located_slopes(s.t, s.y, p, slopes)
    if RATED:
        derivative(s.t, s.y, p, rates)
    velocities = s.y[s.velocities]
    for i in range(s.n):
        rates[i] = velocities[i]
    part = SUM_ROUNDOFF
    if found >= 0:
        terms = terms_of(s, found)
        value = abs(s.worth[found])
        if value <= LOCATED * terms:
            part = max(part, 2.0 * value / terms if terms > 0.0 else 2.0 * value)
    least = max(RESIDUAL_ROUNDOFF, float(s.rtol))
    width_of = s.dynamic.stop + 1
    ahead = 0.0
    for k in range(s.conditions):
        row = slopes[s.conditions + k * width_of :]
        change = row[s.dynamic.stop]
        moved = abs(row[s.dynamic.stop])
        known = True
        for i in range(s.dynamic.stop):
            change += row[i] * rates[i]
            moved += abs(row[i]) * speed_of(s, i)
            known = known and (RATED or i < s.n or row[i] == 0.0)
        if not known or not abs(change) > least * moved:
            change = 0.0
        s.trend[k] = change
        zero = part * terms_of(s, k) + same_time(s, s.t) * abs(change)
        s.zero[k] = max(zero, LEAST)
        ahead = turn_at_kink(s, p, k, way, least * moved, ahead)


def turn_at_kink(
    s: SearchTable, p: Parameters, k: int, way: int, least: float, ahead: float
) -> float:
    """Replace the rate of condition k at a kink by the rate on one side of the state.

    Return the time of `evaluate_beside`, 0 if the states are not evaluated yet.

    way : see `evaluate_with_bounds`.
    least : the least rate that is not 0.
    ahead : the time returned for the condition before.
    """
    if way == 0 or not abs(s.worth[k]) <= s.zero[k]:
        return ahead
    if ahead == 0.0:
        ahead = evaluate_beside(s, p, way)
    turned = rate_beside(s, k, ahead)
    if turned * s.trend[k] <= 0.0 and abs(turned) > least:
        s.trend[k] = turned
    return ahead


def evaluate_beside(s: SearchTable, p: Parameters, way: int) -> float:
    """Evaluate all conditions at two states just before or after the state reached.

    The states are on the line along the present rates; the values at the nearer one are
    stored first in `beside` (2 C,). Return the time to the farther one, at twice the
    distance of the nearer one; nan if no time has passed since the last instant.

    way : -1 before, 1 after.
    """
    time = float(s.step_h)
    if way < 0:
        time = min(time, float(s.t) - float(s.arc_start))
    time *= way * ASIDE
    state = s.point
    for half in range(2):
        part = 0.5 * time * (1 + half)
        for i in range(s.size):
            state[i] = s.y[i] + part * s.exact_rates[i]
        located(s.t + part, state, p, s.beside[half * s.conditions :])
    return time if abs(time) > same_time(s, s.t) else nan


def rate_beside(s: SearchTable, k: int, time: float) -> float:
    """Return the rate of condition k on one side of the state; 0 if it is not known.

    It is not known where the value does not change by more than its rounding, or jumps.
    After the state the change has to be in proportion to the time: a value at rest that
    leaves 0 later is decided by its leeway. Before it the value may reach 0 like a
    power of the time, as that of `x^2 <= 0` does.

    time : the time to the farther state of `evaluate_beside`.
    """
    near = s.beside[k] - s.worth[k]
    far = s.beside[s.conditions + k] - s.worth[k]
    ratio = far / near if near != 0.0 else 0.0
    known = ratio > STEEPEST and (time < 0.0 or abs(ratio - 2.0) < UNEVEN)
    return float(far / time) if known and abs(far) > NEAR * s.zero[k] else 0.0


def evaluate(s: SearchTable, p: Parameters) -> None:
    """Store the values of all conditions at the state reached in `worth`.

    At the start of the run the values include the jumps just after the start. A
    condition without a value is false: its value is stored as -inf, for an equation as
    inf on its side.
    """
    located(s.t, s.y, p, s.worth)
    for k in range(s.conditions):
        s.worth[k] += s.ahead[k]
        if not abs(s.worth[k]) <= inf:
            is_above = s.equation[k] > 0.0 and s.orientation[k] >= 0.0
            s.worth[k] = inf if is_above else -inf


def largest(s: SearchTable, i: int) -> float:
    """Return the largest magnitude of component i so far, with the current state."""
    return max(abs(float(s.y[i])), float(s.sizes[i]))


def speed_of(s: SearchTable, i: int) -> float:
    """Return the scale of the rate of component i, to which its error is relative.

    For a coordinate it is the largest velocity; for a velocity the largest force.
    """
    if i < s.n:
        return largest(s, s.n + i)
    if i < 2 * s.n:
        return max(abs(float(s.exact_rates[i])), float(s.parts[i - s.n]))
    return abs(float(s.exact_rates[i]))


def terms_of(s: SearchTable, k: int) -> float:
    """Return the magnitude of the terms of condition k, at the largest states so far.

    It is sum_i |dc_k/dy_i| max |y_i|, or the size of the terms at present if larger.
    """
    row = s.condition_slopes[s.conditions + k * (s.dynamic.stop + 1) :]
    terms = 0.0
    for i in range(s.dynamic.stop):
        terms += abs(row[i]) * largest(s, i)
    size = float(s.condition_slopes[k])
    # A root at 0 and the apex of a cone have no finite slope.
    return max(terms if terms < OVERFLOW else 0.0, size if size < OVERFLOW else 0.0)


def error_of_time(s: SearchTable, k: int) -> float:
    """Return the rounding error of the time of condition k; 0 if its rate is 0."""
    rate = abs(float(s.trend[k]))
    return float(s.zero[k]) / rate if rate > 0.0 else 0.0


def located_within(s: SearchTable, p: Parameters) -> float:
    """Return the rounding error of the time of the condition located last.

    0 if no condition is located.
    """
    found = int(s.event) - 1
    if found < 0:
        return 0.0
    evaluate_with_bounds(s, p, found, 0)
    return error_of_time(s, found)


def decide_before(s: SearchTable, p: Parameters, found: int) -> int:
    """Evaluate the conditions at the state just before an instant.

    Rates are evaluated only where a condition may change; `calm` becomes 1 if no
    condition can change unless the state jumps. Return 1 if an inequality is false by
    its value that is located, or jumps past 0, at this time, else 0.

    found : see `evaluate_with_bounds`.
    """
    s.met_first = float(found)
    s.calm = 0.0
    far = found < 0 and s.steps > 0.0
    if far:
        evaluate(s, p)
        s.trend[:] = 0.0
        s.calm = 1.0
    for k in range(s.conditions if far else 0):
        least = FAR * s.zero[k]
        if s.leeway[k] < inf:
            least = max(least, NEAR * abs(s.leeway[k]))
        far = far and abs(s.worth[k]) > least and not is_zero_at_switch(s, k)
        if not is_calm(s, k, least):
            s.calm = 0.0
    if not far:
        s.calm = 0.0
        evaluate_with_bounds(s, p, found, -1)
    for k in range(s.conditions):
        is_false = s.equation[k] == 0.0 and s.worth[k] < -s.zero[k]
        if is_false and (k == found or is_zero_at_switch(s, k)):
            return 1
    return 0


def is_zero_at_switch(s: SearchTable, k: int) -> bool:
    """Whether condition k is 0 at this instant on one side of a switch in it."""
    time = s.step_t + float(s.zero_at[k]) * s.step_h
    return abs(time - s.t) <= same_time(s, s.t)


def is_calm(s: SearchTable, k: int, least: float) -> bool:
    """Whether condition k can change only if the state or the modes jump.

    That is so where its value is at least `least` from 0 on its side, or where the
    condition is true for ever.
    """
    value, side = float(s.worth[k]), float(s.orientation[k])
    if side != 0.0:
        return value * side > least
    if s.leeway[k] == inf:
        return abs(value) > least
    return value > least and s.equation[k] == 0.0


def mark_satisfied(s: SearchTable, p: Parameters) -> int:
    """Find the conditions that the motion satisfies at the instant; return the count.

    `marked` is 1 for these conditions. A condition that is about to become false at
    that time counts as false, and so does one that has become false by a jump of a
    switch in its expression.
    """
    s.marked[:] = 0.0
    s.any_stays = 0.0
    count = 0 if s.calm > 0.0 else mark(s)
    s.imprecise[:] = 0.0
    if s.calm > 0.0:
        return 0
    record_falsified(s)
    choose_sides(s, p)
    return count


def mark(s: SearchTable) -> int:
    """Set `marked` to 1 for conditions that the motion satisfies; return the count.

    The sign of a value within its margin is unknown, see `leaving`.
    """
    count = 0
    for k in range(s.conditions):
        side, within = s.orientation[k], margin(s, s.surfaces + k)
        miss = s.worth[k] * side
        satisfied = miss + s.leeway[k] + within <= 0.0
        comes = s.trend[k] * side < 0.0 and within == 0.0
        satisfied = satisfied or (comes and miss <= s.zero[k])
        satisfied = satisfied or is_zero_at_switch(s, k) or rests_at_zero(s, k, miss)
        s.marked[k] = 0.0
        if (satisfied and side != 0.0) or k == int(s.met_first):
            s.marked[k] = 1.0
            count += 1
    return count


def rests_at_zero(s: SearchTable, k: int, miss: float) -> bool:
    """Whether the value of condition k has come to rest at 0, to rounding.

    It does where friction stops a body at `x = 1`, or `x >= 1`. A value that waits for
    a more precise condition has reached 0, too.

    miss : the value, positive on the side of the motion before.
    """
    if s.trend[k] != 0.0 or miss > s.zero[k] or margin(s, s.surfaces + k) > 0.0:
        return False
    return s.imprecise[k] > 0.0 or not is_leaving(s, k)


def is_leaving(s: SearchTable, k: int) -> bool:
    """Whether the value of condition k has not been clear of 0 since it was true."""
    if s.leeway[k] != 0.0:
        return True
    return float(s.passed_at[k]) >= 0.0


def wait(s: SearchTable, p: Parameters) -> int:
    """Decide whether the conditions just located wait for a more precise one.

    The time at which a condition is located has an error by rounding. If another
    condition becomes true within this error, both belong to one instant, at the time of
    the condition with the smaller error. Until then the motion continues, and the
    others are located later, by twice their rounding. Return 1 if they wait, else 0.
    """
    found = int(s.event) - 1
    s.met_first = float(found)
    evaluate_with_bounds(s, p, found, -1)
    mark(s)
    delay = 0.0
    for k in range(s.conditions):
        if s.marked[k] > 0.0:
            if not abs(s.worth[k]) <= s.zero[k] or s.leeway[k] > 0.0:
                return 0  # true by a jump at an exact time, or after a wait
            delay = max(delay, error_of_time(s, k))
    waits = 0
    for k in range(s.conditions):
        side = s.orientation[k]
        comes = side != 0.0 and s.trend[k] * side < 0.0
        if (
            comes
            and s.marked[k] == 0.0
            and s.worth[k] * side <= delay * abs(s.trend[k])
        ):
            waits = 1
    if waits == 0:
        return 0
    for k in range(s.conditions):
        if s.marked[k] > 0.0:
            s.leeway[k] = 2.0 * s.zero[k]
            s.imprecise[k] = 1.0
    s.event = 0.0
    s.fresh = 1.0
    s.row_limit = s.arc_rows
    return 1


def mark_true(s: SearchTable, _p: Parameters) -> None:
    """Store that the conditions whose `marked` is 1 are true from now on."""
    for k in range(s.conditions):
        if s.marked[k] > 0.0:
            miss = max(0.0, s.worth[k] * s.orientation[k])
            s.orientation[k] = 0.0
            jumped = k == int(s.met_first) and s.discontinuous > 0.0
            jumped = jumped or is_zero_at_switch(s, k)
            s.zero_at[k] = -inf
            if jumped:  # its slope, and therefore its rounding, may be unbounded
                s.zero[k] = LEAST
            s.leeway[k] = 0.0 if jumped else 2.0 * (miss + s.zero[k])


def change(s: SearchTable, p: Parameters) -> int:
    """Find the conditions that become true by modes that events have set.

    Their rates are not considered. Return the count; `marked` is 1 for each.
    """
    s.any_stays = 0.0
    remember(s)
    evaluate(s, p)
    if s.fixed_step > 0.0:
        located_slopes(s.t, s.y, p, s.condition_slopes)
        bound_jumped(s)
    return become(s, 0)


def settle(s: SearchTable, p: Parameters, jumped: int) -> int:
    """Find the conditions that become true at the state just after the instant.

    Return the number of conditions; `marked` is 1 for each.

    jumped : 1 if velocities or modes may have jumped, else 0.
    """
    s.marked[:] = 0.0
    s.any_stays = 0.0
    if s.calm > 0.0 and jumped == 0:
        return 0
    s.calm = 0.0
    remember(s)
    if jumped > 0:
        evaluate(s, p)
    if s.steps > 0.0 and not may_change(s):
        return 0
    evaluate_with_bounds(s, p, -1, 1)
    count = become(s, 1)
    choose_sides(s, p)
    return count


def bound_jumped(s: SearchTable) -> None:
    """Store the margins of values that acts have brought to 0 but for a step's error.

    In the first fixed steps of a motion from rest the error may exceed the motion, so
    that the sign after the jump is unknown: `x + on >= 1` where `on` becomes 1. A value
    that an impact brings to 0 is reached.
    """
    for k in range(s.conditions):
        slopes = s.condition_slopes[s.conditions + k * (s.dynamic.stop + 1) :]
        error = 0.0
        for i in range(s.dynamic.stop):
            if s.step_errors[i] > error_of_component(s, i):
                error += abs(slopes[i]) * s.step_errors[i]
        size = abs(float(s.worth[k]))
        jumped = error < OVERFLOW and abs(s.worth[k] - s.former[k]) > error
        if jumped and size <= error and error > s.zero[k]:
            row = s.surfaces + k
            s.margins[row] = max(float(s.margins[row]), error)


def remember(s: SearchTable) -> None:
    """Store the values of conditions in `former`; mark values other than 0.

    `was_clear` marks values that differ from 0 by more than the condition's zero
    tolerance.
    """
    for k in range(s.conditions):
        s.former[k] = s.worth[k]
        s.was_clear[k] = 1.0 if abs(s.worth[k]) > s.zero[k] else 0.0


def may_change(s: SearchTable) -> bool:
    """Whether a false condition is close to 0, or a true condition is past 0.

    The value of a condition just satisfied is 0; the kernel follows the value from
    there.
    """
    for k in range(s.conditions):
        value, side = s.worth[k], s.orientation[k]
        far = NEAR * max(float(s.zero[k]), abs(s.leeway[k]))
        if side != 0.0 and value * side <= max(far, LEAP * abs(value - s.former[k])):
            return True
        past = value < -far or (s.equation[k] > 0.0 and abs(value) > far)
        if side == 0.0 and past:
            return True
    return False


def become(s: SearchTable, rated: int) -> int:
    """Find the conditions that became true; store the sides of the false conditions.

    Return the number of conditions that became true; `marked` is 1 for each.

    rated : 1 if rates are known: then a condition whose value is 0 and rises becomes
        true, and so does one whose value has jumped to 0, but for the error of the
        state; 0: by values alone.
    """
    count = 0
    for k in range(s.conditions):
        side, leeway = s.orientation[k], s.leeway[k]
        zero, within = max(float(s.zero[k]), float(leeway)), margin(s, s.surfaces + k)
        miss = s.worth[k] * side
        # Negative: an impact has left the value close to 0, see `leeway_of_closed`.
        true = miss < -zero - within or (leeway < 0.0 and miss + leeway <= 0.0)
        rises = rated > 0 and s.trend[k] * side < 0.0 and s.equation[k] == 0.0
        rises = within == 0.0 and (rises or s.was_clear[k] > 0.0)
        true = true or (miss <= zero and rises)
        if rated > 0 and side != 0.0 and within == 0.0 and not true:
            slopes = s.condition_slopes[s.conditions + k * (s.dynamic.stop + 1) :]
            error = error_of_state(s, slopes, s.dynamic.stop, 0.0)
            leap = s.former[k] * side - miss
            true = miss <= error and LEAP * leap > error
        s.marked[k] = 0.0
        if true and side != 0.0:
            s.marked[k] = 1.0
            count += 1
    record_falsified(s)
    return count


def record_falsified(s: SearchTable) -> None:
    """Store the sides of conditions that were true and have become false."""
    for k in range(s.conditions):
        value = float(s.worth[k])
        zero = max(float(s.zero[k]), float(s.leeway[k]))
        is_off = abs(value) > max(zero, margin(s, s.surfaces + k))
        if s.orientation[k] == 0.0 and is_off and (value < 0.0 or s.equation[k] > 0.0):
            s.orientation[k] = 1.0 if value > 0.0 else -1.0
            s.leeway[k] = 0.0


def choose_sides(s: SearchTable, _p: Parameters) -> None:
    """Store, for each condition whose value is 0, the side to which its rate leads.

    `s.stays` is set to 1 for true conditions whose values remain 0.
    """
    s.any_stays = 0.0
    for k in range(s.conditions):
        rate, leeway = s.trend[k], float(s.leeway[k])
        size = abs(float(s.worth[k]))
        s.stays[k] = 0.0
        if not leeway < inf or not size <= max(float(s.zero[k]), leeway):
            continue
        undecided = s.orientation[k] == 0.0 or s.equation[k] > 0.0
        if s.margins[s.surfaces + k] >= 0.0 and undecided:
            continue
        leaves = leeway >= 0.0 and is_leaving(s, k)
        if rate == 0.0 and s.equation[k] == 0.0 and leaves:
            s.orientation[k] = 0.0  # it has become false by rounding
        turns = s.orientation[k] == 0.0 and rate < 0.0
        if s.equation[k] > 0.0:
            turns = rate != 0.0
        if turns:
            s.orientation[k] = 1.0 if rate > 0.0 else -1.0
        least = 2.0 * max(float(s.zero[k]), size)
        remains = rate == 0.0 and s.orientation[k] == 0.0 and leeway <= least
        if turns or remains:
            s.leeway[k] = max(leeway, least)
        if remains:
            s.stays[k] = 1.0
            s.any_stays = 1.0
