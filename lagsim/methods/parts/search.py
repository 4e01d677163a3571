"""The search of the last step: one loop for rows of every kind of the table.

The rows of one kind are searched from the start of the step on (`search`). At the first
zero of a row

    EVENT     the step ends, and with it the arc; or the row is passed: the end of a
              true inequality, and a jump of an equation past 0, end nothing. A level of
              a table that decides nothing is passed by `driver.passes_level`
    CROSSING  the state is recorded, and the search goes on, see `crossings`
    SIGNAL    a term acts, in place of a zero: the step is rejected if the dense output
              does not show it, see `missed`
    RANK      the smallest singular value vanishes: a loss of rank is recorded

Rows are evaluated at several points, and once more between each two neighbours. If the
value of a row in between does not follow from its values and slopes at both neighbours,
points are added until it does. Then zeros between neighbours are located on the cubic
of each row that is negative at one of them, or may be negative in between (a touch, a
narrow pulse). For a signal the closest approach is located.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from lagsim.methods.parts import crossings, missed
from lagsim.methods.parts.constraints import MARGIN, project
from lagsim.methods.parts.crossings import Crossings
from lagsim.methods.parts.jumps import (
    FINEST,
    NEARBY,
    conditions_at,
    is_zero_beside,
    one_sided_up_to,
    sample_past,
)
from lagsim.methods.parts.leaving import find_leaving, rates_at_ends
from lagsim.methods.parts.missed import AT_END, CLOSEST
from lagsim.methods.parts.parameters import LEVEL, OFF, Parameters
from lagsim.methods.parts.search_table import (
    AROUND,
    BESIDE,
    BETWEEN,
    CROSSING,
    EVENT,
    FARTHER,
    JUMP,
    MANY,
    MOST_POINTS,
    NEXT,
    POINTS,
    RANK,
    SIGNAL,
    STAYS,
    SearchTable,
    distance_from_activity,
    end_of,
    events,
    follows,
    jumps,
    least_allowed,
    least_of,
    margin,
    minimum_in_half,
    relations,
    row_is_known,
    rows,
    rows_at,
    same_time,
    sample,
    sampled,
    state_at,
    store_ends,
    value_at,
)
from lagsim.methods.parts.state import located
from lagsim.native.kernels.words import bits, from_bits
from lagsim.tolerances import SUM_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.native.kernels.words import Static

UNTIL = True
CONSTRAINED = True
SWITCHES = True
LOCALIZED = True

# Least distance of sample points in a step for features, and for sections beside a jump
# of the relation; largest number of points in a step with a signal.
FINEST_SIGNALS = 2.0**-12
FINEST_CROSSINGS = 2.0**-30
MOST_SIGNALS = 400
# Part of a step within which a jump is located on projected states.
WITHIN = 2.0**-6
# Least factor by which a step with too many points is shortened.
PART = 0.25
# A smallest singular value up to this is 0 within half of the digits.
LOST = 2.0**-26


# --- the one loop over stretches of a step --------------------------------------------


def search(
    kind: Static, s: Crossings, p: Parameters, low: float, until: float
) -> float:
    """Search the last step between two fractions for the first zero of rows of a kind.

    Return the fraction of the zero (of a crossing, a fraction just past it), or 0 if
    there is none.

    EVENT: end the step at the first event, or where the search needs too many points.
    The part before an event is searched again: an earlier event may be too short to be
    found between points that include the motion after it, as where a motion turns back
    through several levels of one surface. If the search needs too many points before
    the fraction FINEST, the stretch is passed although its rows are not known: steps
    that end there would creep towards a pole, near which no number of points suffices.
    CROSSING: record the crossing.
    SIGNAL: search features that the dense output misses; a step that needs more than
    MOST_SIGNALS points counts as one with a feature.
    RANK: search a loss of rank.

    low, until : the fractions.
    """
    first, last, count = s.starts, s.ends, 2 * rows(s)
    widest = s.widest if kind == CROSSING else 2.0 / POINTS
    width = widest
    most = MOST_SIGNALS if kind == SIGNAL else MOST_POINTS
    points = 0
    found = 0.0
    s.switch, s.past = inf, -1.0
    if kind == CROSSING:
        crossings.sample_first(s, p, low)
    else:
        sample(kind, s, p, low, BESIDE * width, first)
    while low < until:
        x = sample_stretch(kind, s, p, low, width, until)
        points += 2
        at_switch = x == s.past
        narrower = 0.0
        if not at_switch and kind != RANK:
            narrower = unknown_up_to(kind, s, p)
        leads_on = kind == CROSSING or (kind == EVENT and (low < FINEST or found > 0.0))
        if points >= most and leads_on:
            narrower = 0.0
        if narrower == 0.0:
            end = found_within(kind, s, p, found)
            if end > 0.0:
                if kind != EVENT or end - low < FINEST:
                    return end
                found, until = end, end
                width = end - low
                sample(kind, s, p, low, BESIDE * width, first)
            else:
                first[:count] = last[:count]
                low = x
                width = s.usual if at_switch else min(2.0 * width, widest)
        elif points < most:
            width = narrower
            sample(kind, s, p, low, BESIDE * width, first)
        elif kind == SIGNAL:
            return max(x, PART)
        else:
            shorten(s, low)
            return low
    return found


def sample_stretch(
    kind: Static, s: Crossings, p: Parameters, low: float, width: float, until: float
) -> float:
    """Sample the rows of a kind within and at the end of a stretch; return the end.

    A stretch ends just before the first switch in a condition, and the next one leads
    over the switch.

    low, width, until : the start of the stretch, its greatest length, and the end of
        the search.
    """
    x = min(low + width, until, s.switch - NEARBY)
    if x <= low:
        return sample_past(kind, s, p, low, min(s.switch + NEARBY, until))
    half = low + BETWEEN * (x - low)
    s.places[0], s.places[1] = low, half
    s.places[2] = x
    sample(kind, s, p, half, -BESIDE * width, s.middles)
    sample(kind, s, p, x, -BESIDE * width, s.ends)
    return x


def found_within(kind: Static, s: Crossings, p: Parameters, known: float) -> float:
    """Return the fraction in the stretch of the first zero of rows of a kind, or 0.

    known : the fraction of an event found before in this step, or 0.
    """
    if kind == SIGNAL:
        return missed.missed_within(s, p)
    if kind == RANK:
        return lost_within(s, p)
    end = 0.0
    for half in range(2):
        if end == 0.0 and kind == CROSSING:
            end = crossings.crossed_within(s, p, half)
        elif end == 0.0 and (half == 0 or s.places[2] != known):
            end = end_within(s, p, half)
    return end


def unknown_up_to(kind: Static, s: Crossings, p: Parameters) -> float:
    """Return the length of a shorter stretch to examine; 0 if the present one is known.

    A stretch is known if the values and slopes at its ends determine the functions of
    the kind in between. An event function may contain only a localized term, such as a
    narrow pulse, and be flat at all sample points: for events, the argument of no such
    term may come close to the values at which the term is active inside the stretch. If
    one does, the shorter stretch ends at the closest approach.

    kind : EVENT, CROSSING or SIGNAL.
    """
    low, x = float(s.places[0]), float(s.places[2])
    width, near = x - low, x
    finest = FINEST_SIGNALS if kind == SIGNAL else FINEST
    least_width = FINEST_CROSSINGS if kind == CROSSING else finest
    if LOCALIZED and kind != SIGNAL:
        near = one_sided_up_to(s, p)
        if near < x:
            return near - low if near > low else width
    if kind != SIGNAL and width >= least_width and not are_known(kind, s, p):
        return 0.5 * width
    divisible = width >= finest
    if LOCALIZED:
        for k in range(events(s), events(s) + s.signals):
            if not missed.may_approach(s, k) or missed.hardly_varies(s, p, k):
                continue
            if divisible and not missed.signal_is_known(s, k):
                return 0.5 * width
            if kind != SIGNAL:
                least = least_of(SIGNAL, CLOSEST, s, p, k, low, x)
                if AT_END * width < least - low < (1.0 - AT_END) * width:
                    near = min(near, least)
    return near - low if near < x else 0.0


def are_known(kind: Static, s: Crossings, p: Parameters) -> bool:
    """Whether values and slopes at the ends of the stretch determine rows of a kind.

    The bands of sections are computed only where a relation is not known.

    kind : EVENT or CROSSING.
    """
    first = relations(s) if kind == CROSSING else 0
    count = s.sections if kind == CROSSING else events(s)
    for k in range(first, first + count):
        if not row_is_known(kind, s, p, k):
            if kind == EVENT or s.banded > 0.0:
                return False
            crossings.compute_bands(s, p)
            if not row_is_known(kind, s, p, k):
                return False
    return True


# --- events: the first switch, or condition, within the step --------------------------


def find_end(s: Crossings, p: Parameters) -> None:
    """Search the last step for its first event, and end the step there.

    On return s.switched is the index, from 1, of the surface or law whose mode has
    ended, or s.event is the index, from 1, of the condition that has become true. A
    condition that is true at the start of the step can be located only after it has
    become false.
    """
    find_leaving(EVENT, s, p)
    add_margins(s, p)
    if UNTIL:
        prepare_true(s, p)
    search(EVENT, s, p, 0.0, 1.0)
    if UNTIL and s.event > 0.0:
        continue_past(s, p)
        if CONSTRAINED and s.event > 0.0:
            end_past_jump(s, p, int(s.event) - 1)
        s.jumps_beside = 1.0 if s.event > 0.0 and another_jumps(s, p) else 0.0
    if UNTIL and s.cut > 0.0:
        disarm_past(s)
    if UNTIL:
        for k in range(s.conditions):
            if follows(s, k):
                s.orientation[k] = 0.0
            elif s.orientation[k] != 0.0 and s.cut == 0.0:
                # A condition whose value exceeds its leeway needs none.
                clear = s.ends[s.surfaces + k] > 2.0 * s.leeway[k]
                s.leeway[k] = 0.0 if clear else s.leeway[k]
            if s.leeway[k] == s.own_leeway[k] + margin(s, s.surfaces + k):
                s.leeway[k] = s.own_leeway[k]
            s.ahead[k] = 0.0


def add_margins(s: SearchTable, p: Parameters) -> None:
    """Add the margins of values that leave 0 to the slack, and to the leeway.

    See `leaving`. A surface keeps its slack in an arc until its value exceeds it.
    """
    if SWITCHES:
        for k in range(s.surfaces):
            if s.margins[k] > 0.0:
                p.slack[k] = max(p.slack[k], s.margins[k])
    if UNTIL:
        for k in range(s.conditions):
            s.own_leeway[k] = s.leeway[k]
            s.armed_at[k] = 0.0
            s.zero_at[k] = -inf
            s.passed_at[k] = -1.0
            s.leeway[k] += margin(s, s.surfaces + k)


def continue_past(s: Crossings, p: Parameters) -> None:
    """Search on past each located condition that does not end the arc.

    The search ends at the first event that ends the arc, or at the end of the step.
    Conditions that were passed at the time of this event regain their orientation and
    leeway, since their truth is decided when the instant is settled: the velocity of a
    slip that stops there, for example, has not passed 0.
    """
    while s.event > 0.0:
        k = int(s.event) - 1
        side, leeway = s.orientation[k], s.leeway[k]
        if not continues_past(s, p, k):
            break
        before = max(s.cut - NEXT, 0.0)
        low = min(s.cut + NEXT, 1.0)  # beyond the rounding at a jump
        s.passed_at[k] = s.cut
        s.passed_side[k] = side
        s.passed_leeway[k] = leeway
        s.armed_at[k] = low
        s.event = 0.0
        s.cut = 0.0
        s.t = s.step_end
        s.row_limit = s.arc_rows
        end = end_beside(s, p, before, low)
        if end > 0.0:
            cut(s, p, before, end)
        else:
            search(EVENT, s, p, low, 1.0)
    for k in range(s.conditions if s.cut > 0.0 else 0):
        if s.passed_at[k] >= max(s.cut - NEXT, 0.0):
            s.orientation[k] = s.passed_side[k]
            s.leeway[k] = s.passed_leeway[k]
            s.armed_at[k] = 0.0


def end_past_jump(s: Crossings, p: Parameters, k: int) -> None:
    """Move the end of the step past the jump of condition k that is located there.

    The state at the end is projected onto the constraints, which may return a value to
    the side before its jump: the condition would be false at its own act, and true for
    the rest of the run. If no projected state in the part WITHIN of the step has
    jumped, no condition counts as located, and the motion continues from the last one.
    """
    end = float(s.cut)
    last = from_bits(bits(end) - 1)
    if s.kinked[k] == 0.0 or end >= 1.0:
        return
    before, after = condition_at(s, p, k, last), condition_at(s, p, k, end)
    slow = abs(before - condition_at(s, p, k, max(end - AROUND, 0.0)))
    slow += abs(condition_at(s, p, k, min(end + AROUND, 1.0)) - after)
    leap = abs(after - before)
    if not leap > max(MANY * float(s.zero[k]), JUMP * slow):  # no jump, or no value
        return
    if is_past_jump(s, p, k, end, before, after):
        return
    low, high, step = end, end, end - last
    found = False
    while not found and high < min(end + WITHIN, 1.0):
        low, step = high, FARTHER * step
        high = min(low + step, 1.0)
        found = is_past_jump(s, p, k, high, before, after)
    middle = 0.5 * (low + high)
    while found and low < middle and middle < high:
        if is_past_jump(s, p, k, middle, before, after):
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    if not found:
        s.event = 0.0
    if s.zero_at[k] == end:
        s.zero_at[k] = high
    shorten(s, high)
    s.row_limit = min(s.arc_rows, s.t - same_time(s, s.t))


def condition_at(s: Crossings, p: Parameters, k: int, x: float) -> float:
    """Return the value of condition k at the fraction x of the last step."""
    conditions_at(s, p, x)
    return float(s.values[k])


def is_past_jump(
    s: Crossings, p: Parameters, k: int, x: float, before: float, after: float
) -> bool:
    """Whether condition k has jumped in the projected state at a fraction of the step.

    x : the fraction.
    before, after : the values just before and after the jump.
    """
    t = state_at(s, p, x, s.point)
    if x < 1.0:
        project(s, p, t, s.step_h, s.point, s.work)
    located(t, s.point, p, s.values)
    value = float(s.values[k])
    return abs(value - after) <= abs(value - before)


def end_beside(s: Crossings, p: Parameters, before: float, after: float) -> float:
    """Return a fraction between two of the step at which a row has ended, or 0.

    It is that of a condition that is 0 at a switch there (`zero_at`), or `after`. A
    condition that has been passed there does not count.

    before, after : fractions just before and after a condition that was passed.
    """
    for k in range(s.conditions):
        if before <= s.zero_at[k] <= after and s.passed_at[k] < before:
            return float(s.zero_at[k])
    over = False
    store_values(s, p, after)
    for k in range(events(s)):
        over = over or ends(s, p, k, s.inner_values[k], after)
    return after if over else 0.0


def another_jumps(s: SearchTable, p: Parameters) -> bool:
    """Whether a false condition becomes true by a jump where one has been located.

    Its switch may be just after the end of the step, by rounding or since its value at
    the level is the former one, as that of `floor(-x)`.
    """
    waiting = 0
    for c in range(s.conditions):
        if is_false_at_end(s, c):
            waiting += 1
    if waiting == 0:
        return False
    rows_at(EVENT, s, p, s.cut + NEARBY)
    found = False
    for c in range(s.conditions):
        if is_false_at_end(s, c):
            found = found or s.values[s.surfaces + c] < 0.0
    return found


def is_false_at_end(s: SearchTable, c: int) -> bool:
    """Whether condition c contains switches, and is false where the step ends."""
    is_armed = s.orientation[c] != 0.0 and not follows(s, c) and c + 1.0 != s.event
    return s.kinked[c] > 0.0 and is_armed and s.inner_values[s.surfaces + c] >= 0.0


def store_values(s: SearchTable, p: Parameters, x: float) -> None:
    """Store all event functions at the fraction x of the last step."""
    rows_at(EVENT, s, p, x)
    s.inner_values[:] = s.values[: events(s)]


def continues_past(s: Crossings, p: Parameters, k: int) -> bool:
    """Whether the step continues past a point at which condition k has been located.

    It continues where a condition that was true becomes false, and where the function
    of an equation jumps past 0, which does not count as a zero. A jump to 0 or from 0
    does (`floor(x) = 1`). The orientation of the condition is then updated, and its
    leeway is 0.
    """
    row, rounding = s.surfaces + k, MANY * float(s.zero[k])
    if follows(s, k):
        if s.equation[k] == 0.0:
            s.orientation[k] = -1.0
            conditions_at(s, p, s.cut)
            if abs(s.values[k]) <= s.zero[k]:  # not clear of 0 yet
                s.leeway[k] = 2.0 * s.zero[k]
                return True
        else:
            conditions_at(s, p, min(s.cut + NEXT, 1.0))
            s.orientation[k] = 1.0 if s.values[k] > 0.0 else -1.0
    elif s.equation[k] > 0.0 and jumps(EVENT, s, p, row, s.cut, rounding):
        if is_zero_beside(s, p, k, s.cut):
            return False
        s.orientation[k] = -s.orientation[k]
    else:
        return False
    s.leeway[k] = 0.0
    return True


def prepare_true(s: SearchTable, p: Parameters) -> None:
    """Prepare the search for conditions that are true at the start of the last step.

    Inequalities are located when they end, and so are equations whose values stay at 0
    at first (`floor(x) = 1`). Equations are armed once their roots are left, by the
    sign of the function: at the start of an arc just after it, since another root may
    follow soon. If rounding at the start has the opposite sign, the leeway is kept for
    this step.
    """
    waits = False
    for k in range(s.conditions):
        waits = waits or s.orientation[k] == 0.0
    if not waits:
        return
    starts, last = s.step_t == s.arc_start, BESIDE / POINTS
    x = NEXT * last if starts else last
    while x <= last:
        conditions_at(s, p, x)
        for k in range(s.conditions):
            arm(s, k, x, x == last)
        x *= FARTHER
    if starts:
        conditions_at(s, p, 0.0)
    for k in range(s.conditions):
        equation = s.equation[k] > 0.0
        armed = equation and s.armed_at[k] > 0.0
        if starts and armed and s.values[k] * s.orientation[k] > 0.0:
            s.leeway[k] = 0.0
        if s.orientation[k] == 0.0 and s.leeway[k] < inf:
            s.orientation[k] = STAYS if equation else 1.0


def arm(s: SearchTable, k: int, x: float, last: bool) -> None:
    """Arm condition k if it is false, to be located when it is true.

    x : the fraction of the last step at which the values are known.
    last : whether inequalities are armed as well, and the leeway ends.
    """
    value, equation = s.values[k], s.equation[k] > 0.0
    waits = s.orientation[k] == 0.0 and (equation or (last and s.leeway[k] <= 0.0))
    if waits and abs(value) > s.leeway[k] and (equation or value < 0.0):
        s.orientation[k] = 1.0 if value > 0.0 else -1.0
        s.armed_at[k] = x
        if last:
            s.leeway[k] = 0.0


def disarm_past(s: SearchTable) -> None:
    """Undo the arming of conditions at points past the end of a step cut short."""
    for k in range(s.conditions):
        if s.armed_at[k] > s.cut:
            s.orientation[k] = 0.0
            s.leeway[k] = s.own_leeway[k]


def ends(s: SearchTable, p: Parameters, k: int, value: float, x: float) -> bool:
    """Whether event function k has ended a mode at the fraction x of the step.

    A negative value that is an error of the dense output, see `errs_until`, ends no
    mode.

    value : the value of the function there.
    """
    if value >= least_allowed(EVENT, s, p, k):
        return UNTIL and k >= s.surfaces and touches(s, k, x)
    return x >= errs_until(s, p, k, value)


def touches(s: SearchTable, k: int, x: float) -> bool:
    """Whether the condition of event function k is 0 at a switch, see `zero_at`.

    x : the fraction of the step.
    """
    zero = float(s.zero_at[k - s.surfaces])
    return zero <= x <= zero + NEARBY


def errs_until(s: SearchTable, p: Parameters, k: int, value: float) -> float:
    """Return the fraction of the step up to which a negative gap counts as an error.

    The contact must open at the start of the step: its gap neither closes nor is
    pressed together there. The result is

    - inf if the gap is open after the step: negative values within the step are errors
      of the interpolant, as for a body that leaves the ground as a power of the time;
    - 1 if the gap is negative, within the error of the method, after a fixed step;
    - 0 in all other cases, and for functions that are no gaps: any negative value
      counts.

    With constraints, values within the step of a surface at its level are errors of the
    interpolant, too, if the surface is at its level after the step.

    k : the event function.
    value : its value, the gap, where it is negative.
    """
    law = k - p.surfaces
    if SWITCHES and law < 0 and p.slides[k] == LEVEL and p.m > 0:
        is_at_level = value_at(EVENT, s, p, k, 1.0) >= least_allowed(EVENT, s, p, k)
        return inf if is_at_level else 0.0
    if not SWITCHES or not 0 <= law < p.laws or p.law_mode[law] != OFF:
        return 0.0
    is_open = value_at(EVENT, s, p, k, 1.0) >= least_allowed(EVENT, s, p, k)
    if p.law_low[law] != 0.0 or not value >= -error_of_gap(s, p, law, is_open):
        return 0.0
    if is_open:
        return inf
    return 1.0 if s.fixed_step > 0.0 and p.slack[k] > 0.0 else 0.0


def error_of_gap(s: SearchTable, p: Parameters, k: int, is_open: bool) -> float:
    """Return the error of the gap of law k in the last step; 0 if it does not open.

    The gap must open at the start of the step. With step control the error follows from
    the tolerances. With fixed steps it is estimated from the accelerations.

    is_open : whether the gap is open after the step. The error is then that of the
        interpolant, estimated from the change of the accelerations in the step; else
        that of the method, estimated from the accelerations themselves.
    """
    last, first = s.exact_rates[s.velocities], s.spare[s.velocities]
    rates_at_ends(s, p)
    at = p.m - p.laws + k
    row, push, error = p.A[at * s.n :], -p.b[at], 0.0
    roundoff, moved = abs(push), 0.0
    h = s.step_h
    for i in range(s.n):
        push += row[i] * first[i]
        roundoff += abs(row[i]) * max(s.parts[i], abs(first[i]))
        moved += abs(row[i]) * s.sizes[s.n + i]
        bend = abs(last[i] - first[i]) if is_open else max(abs(last[i]), abs(first[i]))
        bend *= 0.5 * h * h if p.law_gapped[k] > 0.0 else h
        error += abs(row[i]) * (bend if s.fixed_step > 0.0 else s.tolerances[i])
    moved = max(moved, h * roundoff)
    if p.law_speeds[k] < -SUM_ROUNDOFF * moved or push < -SUM_ROUNDOFF * roundoff:
        return 0.0
    return float(error)


def end_within(s: SearchTable, p: Parameters, half: int) -> float:
    """End the step at the first event in half of the stretch; return the end, or 0.

    The event is not later than any minimum at which a function is negative: the
    function has ended a mode by then.

    half : 0 before the middle point, 1 after it.
    """
    high, low, x = 0.0, s.places[half], s.places[half + 1]
    for k in range(events(s)):
        if ends(s, p, k, sampled(s, k, half + 1), x):
            high = x
    for k in range(events(s)):
        inside = ended_inside(s, p, k, half)
        if inside < inf:
            high = inside if high == 0.0 else min(high, inside)
    if high > 0.0:
        cut(s, p, low, high)
        return s.cut
    if SWITCHES:
        for k in range(s.surfaces):
            value = sampled(s, k, half + 1)
            if p.slack[k] < value < inf:
                p.slack[k] = 0.0
    return 0.0


def ended_inside(s: SearchTable, p: Parameters, k: int, half: int) -> float:
    """Return a fraction within half of the stretch at which function k ended a mode.

    It is at a minimum of the function, or at a bound of its values; inf if there is
    none.

    k : the event function.
    half : 0 before the middle point, 1 after it.
    """
    found = inf
    least = minimum_in_half(EVENT, s, p, k, half, least_allowed(EVENT, s, p, k))
    x = s.places[half + 1]
    if least < x and ends(s, p, k, value_at(EVENT, s, p, k, least), least):
        found = least
    if UNTIL and k >= s.surfaces:
        last = bound_of_values(s, p, k, half)
        if last < found and ends(s, p, k, value_at(EVENT, s, p, k, last), last):
            found = last
    return found


def bound_of_values(s: SearchTable, p: Parameters, k: int, half: int) -> float:
    """Return the fraction in half of the stretch up to which condition k has a value.

    It is the fraction from which on the condition has a value, if it has none at the
    start of the half; inf if it has a value at both ends, or at none.

    k : the row of the condition.
    half : 0 before the middle point, 1 after it.
    """
    a, b = sampled(s, k, half), sampled(s, k, half + 1)
    if max(a, b) < inf or min(a, b) == inf:
        return inf
    known, unknown = float(s.places[half]), float(s.places[half + 1])
    if a == inf:
        known, unknown = unknown, known
    middle = 0.5 * (known + unknown)
    while min(known, unknown) < middle and middle < max(known, unknown):
        if value_at(EVENT, s, p, k, middle) < inf:
            known = middle
        else:
            unknown = middle
        middle = 0.5 * (known + unknown)
    return known


def cut(s: SearchTable, p: Parameters, low: float, high: float) -> None:
    """End the step at the first point in (low, high] at which a mode ends.

    The point is the root of the event function, even if only a value well below 0
    revealed that the mode ends.
    """
    first = events(s)
    s.event = 0.0
    s.switched = 0.0
    store_values(s, p, high)
    for k in range(events(s)):
        if ends(s, p, k, s.inner_values[k], high):
            first = k
            least = least_allowed(EVENT, s, p, k)
            if value_at(EVENT, s, p, k, low) >= 0.0:
                least = 0.0
            below = s.inner_values[k] < least
            if below and errs_until(s, p, k, s.inner_values[k]) == 0.0:
                high = end_of(EVENT, s, p, k, least, low, high)
            if SWITCHES and least < 0.0:
                # A flight that began below the ground by rounding ends where the gap
                # returns to 0.
                middle = 0.5 * (low + high)
                if value_at(EVENT, s, p, k, middle) > p.slack[k]:
                    high = end_of(EVENT, s, p, k, -float(p.band[k]), middle, high)
            store_values(s, p, high)
    if UNTIL and first >= s.surfaces:
        s.event = first - s.surfaces + 1.0
    else:
        s.switched = first + 1.0
    if SWITCHES:
        for k in range(p.laws):
            law = p.surfaces + k
            value = s.inner_values[law]
            over = not value >= least_allowed(EVENT, s, p, law)
            errs = over and errs_until(s, p, law, value) > 0.0
            p.law_opens[k] = 1.0 if errs else 0.0
    s.discontinuous = 1.0 if is_discontinuous(s, p, first, high) else 0.0
    shorten(s, high)
    # Rows at the same instant belong to the next arc.
    s.row_limit = min(s.row_limit, s.t - same_time(s, s.t))


def is_discontinuous(s: SearchTable, p: Parameters, k: int, x: float) -> bool:
    """Whether event function k, of a surface or condition, jumps past 0 at fraction x.

    It does at a pole, and at the cut of an angle, and a condition where its values
    begin. False for the mode of a law, and for a surface that the motion follows.
    """
    is_condition = UNTIL and k >= s.surfaces
    before = from_bits(bits(x) - 1) if x > 0.0 else 0.0
    if is_condition and value_at(EVENT, s, p, k, before) == inf:
        return True
    if s.poles[k] == 0.0:
        return False
    rounding = 0.0
    if is_condition:
        rounding = MANY * float(s.zero[k - s.surfaces])
    elif SWITCHES and p.slides[k] != 0.0:
        return False
    return x > 0.0 and jumps(EVENT, s, p, k, x, rounding)


def shorten(s: SearchTable, x: float) -> None:
    """End the last step at its fraction x.

    The state after the step is kept until the rows before x are written: methods may
    interpolate from it.
    """
    s.cut = x
    s.t = s.step_end if x >= 1.0 else s.step_t + x * s.step_h


# --- sections: the crossings before the end of the step


def find_crossings(s: Crossings, p: Parameters) -> int:
    """Write the states of sections, crossings and strobes, in the last step.

    Return 0 if the buffer is full before the end of the step, else 1.
    """
    evaluations = s.evaluations
    complete = find_located(s, p) * crossings.find_strobes(s, p)
    s.evaluations = evaluations  # the result does not depend on these evaluations
    return complete


def find_located(s: Crossings, p: Parameters) -> int:
    """Search the last step for crossings; return 0 if the buffer is full, else 1.

    The part of the step before its first event, if any, is searched; after a full
    buffer the search continues from the crossing last stored.
    """
    if s.sections == 0 or s.searched >= 1.0:
        return 1
    end = s.cut if s.cut > 0.0 else 1.0
    if s.t - s.step_t <= same_time(s, s.t):
        s.searched = 1.0
        return 1
    if s.searched == 0.0:
        if s.states_found + s.sections > s.states_room:
            return 0
        crossings.begin_search(s, p)
    low = s.searched
    while low < end:
        if s.states_found + s.sections > s.states_room:
            s.searched = low
            return 0
        past = search(CROSSING, s, p, low, end)
        if past == 0.0:
            h = s.step_h if end == 1.0 else 0.0  # 0: not used for the next step
            store_ends(s, relations(s), s.sections, s.t, h, s.starts)
        low = past if past > 0.0 else end
    s.searched = 1.0
    return 1


# --- features that the step has missed, and losses of rank


def missed_feature(s: Crossings, p: Parameters) -> float:
    """Return the fraction of the last step at which a localized term is missed, or 0.

    There the dense output lacks a term of the forces (a pulse, a steep wall), or the
    search must stop for the number of its points.
    """
    rows_at(SIGNAL, s, p, 0.0)
    for k in range(s.signals):
        s.farthest[k] = distance_from_activity(s, events(s) + k, s.values)
    return search(SIGNAL, s, p, 0.0, 1.0)


# A loss of rank is located to 1e-9 of a stretch.
NARROWER = 44


def loses_rank(s: Crossings, p: Parameters) -> bool:
    """Whether rank is lost within the last step; s.work is then the state there."""
    return s.watched > 0.0 and search(RANK, s, p, 0.0, 1.0) > 0.0


def lost_within(s: SearchTable, p: Parameters) -> float:
    """Return the fraction of the step, in the stretch, at which rank is lost, or 0.

    Sigma has a kink there, and small jumps where rows change their order, which may
    hide the sign of its slope: a stretch is searched where values or slopes fall and
    rise again, or where sigma could vanish in between at the steepest slope so far. The
    second criterion is not applied where sigma vanishes at an end of the stretch, as on
    a set of states that all lose rank.
    """
    k, low, x = rows(s) - 1, s.places[0], s.places[2]
    slopes = rows(s) + k
    falls = s.starts[slopes] < 0.0 or s.middles[k] < s.starts[k]
    rises = s.ends[slopes] > 0.0 or s.middles[k] < s.ends[k]
    steepest = MARGIN * s.sigma_slope * s.step_h * (x - low)
    ends = min(s.starts[k], s.ends[k])
    vanishes = ends > LOST and s.starts[k] + s.ends[k] <= steepest
    if not (falls and rises) and not vanishes:
        return 0.0
    # The slope at the start is the slope just before it.
    low = max(low - BESIDE * (x - low), 0.0)
    x = least_of(RANK, NARROWER, s, p, k, low, x)
    if value_at(RANK, s, p, k, x) >= s.lost_below:
        return 0.0
    s.lost_at = s.step_t + x * s.step_h
    return x
