"""The search of the last step: for events, features and losses of rank.

A step is searched in a table of rows, functions of the fraction x of the step on the
dense output:

    EVENT    the event function of a surface, a law or a condition: its distance from
             leaving a mode, or from becoming true. It ends the step where it falls
             below 0, or below its slack
    SIGNAL   the argument of a localized term, whose distance is that from the place of
             the term. The step is rejected if the term acts and the dense output does
             not show it
    RANK     the smallest singular value of the constraint rows. A loss of rank is
             where it vanishes, and is recorded
    CROSSING the relation of a section, on the side that the motion comes from: it falls
             below 0 where the section is crossed. It ends no step, see `crossings`

Values and slopes of rows are evaluated at several points, and once more between each
two: if a row there does not follow from values and slopes at both, the points are
refined until it does (`missed.off`). Then roots between two points are searched: of an
event function that is negative at one, or may have been between them (a touch, a narrow
pulse), by its cubic; and the closest approach of a signal. A minimum within a stretch
is located by golden section (`least_of`), and the first root to the last bit
(`end_of`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from lagsim.language.arrays import Floats
from lagsim.methods.parts import missed
from lagsim.methods.parts.constraints import MARGIN, sigma_at
from lagsim.methods.parts.missed import (
    APPROACH,
    BESIDE,
    BETWEEN,
    GOLDEN,
    SearchTable,
    events,
    relations,
    rows,
)
from lagsim.methods.parts.parameters import FREEWHEEL, OFF, Parameters
from lagsim.methods.parts.state import (
    derivative,
    event_functions,
    interpolate,
    located,
    sections,
    signals,
)
from lagsim.native.layout import array
from lagsim.tolerances import SAME_INSTANT, SUM_ROUNDOFF, TINY

if TYPE_CHECKING:
    from lagsim.native.kernels.words import Static

UNTIL = True
SWITCHES = True
LOCALIZED = True
SECTIONS = True
ADAPTIVE = True

EVENT, SIGNAL, RANK, CROSSING = 0, 1, 2, 3


class Events(SearchTable):
    """Memory of the conditions that are located, and of the event found."""

    # All event functions at one fraction of the step, see `keep_values`.
    kept: Floats = array(lambda s: s.surfaces + s.conditions)
    event: float  # the number, from 1, of the condition that has been located; or 0
    switched: float  # the number, from 1, of the surface a switch was located on; or 0

    # A condition holds where this times its function is <= 0; 0: not armed, it has not
    # been false since, that is less than 0 by more than the leeway.
    orientation: Floats = array("conditions")
    equation: Floats = array("conditions")  # 1 of an equation
    leeway: Floats = array("conditions")
    zero: Floats = array("conditions")  # sizes up to which a value is 0
    # At an instant, see `truth`: the values, their rates, 0 where below rounding; the
    # sizes of their terms, then their slopes by the motion and t.
    worth: Floats = array("conditions")
    trend: Floats = array("conditions")
    condition_slopes: Floats = array(lambda s: s.conditions * (2 + s.dynamic.stop))
    # The change of the value of an inequality by jumps just after the start of the run,
    # if it is true then; else, and after the first step, 0.
    ahead: Floats = array("conditions")
    met_first: float  # the index of the condition located there, or -1
    calm: float  # 1 if no condition changes unless the state or the modes jump
    # 1 where a condition has become true; where it is true and its value stays at 0;
    # and where its value was off 0 before a change; the values before it.
    marked: Floats = array("conditions")
    stays: Floats = array("conditions")
    any_stays: float  # 1 if any value stays at 0
    was_clear: Floats = array("conditions")
    former: Floats = array("conditions")

    # Of each section: the last sign of its relation, 0 before the motion has left the
    # section; and the largest value of the relation on it, see `crossings.band`.
    sides: Floats = array("sections")
    bands: Floats = array("sections")


# --- the table, and the one loop over stretches of a step -----------------------------

# Least number of points of a step at which rows are evaluated.
POINTS = 8
# An event function is known if its error is at most this part of its least value.
CLEAR = 0.25
# Least distance of points: for events, for features, and for sections, beside a jump of
# the relation; largest number of points in a step.
FINEST = 2.0**-14
FINEST_SIGNALS = 2.0**-12
FINEST_CROSSINGS = 2.0**-30
MOST_POINTS = 2000
MOST_SIGNALS = 400
# Least part to which a step with too many points is shortened.
PART = 0.25
# Number of golden sections that locate a closest approach to rounding. An approach
# within this part of a stretch from an end is at the end.
CLOSEST = 80
AT_END = 1e-9
# After a root the search for the next one begins at this part of the first place, at
# distances that grow by FARTHER; after the end of a true condition, at this part of the
# step.
NEXT = 2.0**-26
FARTHER = 4.0
# A smallest singular value up to this is 0 within half of the digits.
LOST = 2.0**-26
# Of the ITP method (k_1 times the width of the bracket).
ITP = 0.2
# A function jumps if its change over the part JUST of the time is half of that over
# SOON; it is continuous if its change is at most SOON times that over half of the time,
# or JUMP times its rounding.
JUST, SOON, JUMP = 2.0**-50, 2.0**-12, 64.0
# Number of golden sections that locate a minimum to 1e-8 of a stretch; the error of the
# minimum is of second order.
NARROW = 39


def search(kind: Static, s: Events, p: Parameters, low: float) -> float:
    """Search the last step from its fraction `low` on, for one kind of row.

    EVENT: end the step at the first event, or where the search needs too many points.
    The part before an event is searched again: an earlier event may be too short to be
    seen beside the motion after it, as where a motion turns back through several levels
    of one surface. SIGNAL: search features that the dense output misses; a step that
    needs more than MOST_SIGNALS points counts as one with a feature. RANK: search a
    loss of rank. Return the fraction of the event, feature or loss, or 0 if there is
    none.
    """
    first, last, count = s.starts, s.ends, 2 * rows(s)
    widest = 2.0 / POINTS
    width = widest
    most = MOST_POINTS if kind == EVENT else MOST_SIGNALS
    points = 0
    found, until = 0.0, 1.0
    sample(kind, s, p, low, BESIDE * width, first)
    while low < until:
        x = min(low + width, until)
        half = low + BETWEEN * (x - low)
        sample(kind, s, p, half, -BESIDE * width, s.middles)
        sample(kind, s, p, x, -BESIDE * width, last)
        points += 2
        narrower = 0.0 if kind == RANK else unknown_up_to(kind, s, p, low, x)
        if points >= most and kind == EVENT and (low == 0.0 or found > 0.0):
            narrower = 0.0  # the step leads on, in any case
        if narrower == 0.0:
            end = found_within(kind, s, p, low, x, found)
            if end > 0.0:
                if kind != EVENT or end - low < FINEST:
                    return end
                found, until = end, end
                width = end - low
                sample(kind, s, p, low, BESIDE * width, first)
            else:
                first[:count] = last[:count]
                low = x
                width = min(2.0 * width, widest)
        elif points < most:
            width = narrower
            sample(kind, s, p, low, BESIDE * width, first)
        elif kind == SIGNAL:
            return max(x, PART)
        else:
            shorten(s, low)
            return low
    return found


def found_within(
    kind: Static, s: Events, p: Parameters, low: float, x: float, known: float
) -> float:
    """Return the fraction in (low, x] of an event, feature or loss of rank, or 0.

    known : the fraction of an event found before in this step, or 0.
    """
    if kind == SIGNAL:
        return missed_within(s, p, low, x)
    if kind == RANK:
        return lost_within(s, p, low, x)
    half = low + BETWEEN * (x - low)
    end = end_within(s, p, low, half, s.starts, s.middles)
    if end == 0.0 and x != known:
        end = end_within(s, p, half, x, s.middles, s.ends)
    return end


def rows_at(kind: Static, s: Events, p: Parameters, x: float) -> None:
    """Store the rows of a kind at the fraction x of the last step in s.values (R,).

    Signals are stored for every kind but RANK.
    """
    z, now = s.point, s.values
    if kind == RANK:
        now[rows(s) - 1] = sigma_at(s, p, x)
        return
    t = s.step_t + x * s.step_h
    interpolate(s, p, x, z)
    if LOCALIZED:
        signals(t, z, p, now[events(s) :])
    if SECTIONS and kind == CROSSING:
        sections(t, z, p, now[relations(s) :])
    if SWITCHES and kind == EVENT:
        event_functions(t, z, p, now)
    if UNTIL and kind == EVENT:
        own = now[s.surfaces :]
        located(t, z, p, own)
        for k in range(s.conditions):
            if x <= NEXT and own[k] < 0.0:  # closer than the interpolant's rounding
                own[k] += s.ahead[k]
            own[k] = own[k] * s.orientation[k] + s.leeway[k]
            if s.orientation[k] == 0.0:
                own[k] = 1.0
            if own[k] == 0.0:  # true, and so of what is true not its end
                own[k] = TINY if follows(s, k) else -TINY


def sample(
    kind: Static, s: Events, p: Parameters, x: float, beside: float, out: Floats
) -> None:
    """Write rows of a kind and their slopes at the fraction x of the last step.

    out : (2 R,), the values, then the slopes. beside : the distance over which values
    are differenced to slopes.
    """
    count = rows(s)
    now = s.values
    rows_at(kind, s, p, x + beside)
    out[count : 2 * count] = now[:count]
    rows_at(kind, s, p, x)
    out[:count] = now[:count]
    out[count : 2 * count] = (out[count : 2 * count] - now[:count]) / beside


def unknown_up_to(
    kind: Static, s: Events, p: Parameters, low: float, x: float
) -> float:
    """Return the width of a shorter stretch to examine than (low, x); 0 if not needed.

    A shorter one is not needed if the values and slopes at its ends determine what is
    searched for, the `kind`, in between. For events, no signal may approach the
    activity of its term inside either, since an event function made of the term would
    be flat at every point; the shorter stretch then ends at the closest approach. low,
    x, and the result are fractions of the step.
    """
    width, near = x - low, x
    finest = FINEST_SIGNALS if kind == SIGNAL else FINEST
    divisible = width >= (FINEST_CROSSINGS if kind == CROSSING else finest)
    if kind == EVENT and divisible and not events_are_known(s, p, width):
        return 0.5 * width
    if kind == CROSSING and divisible and not sections_are_known(s, width):
        return 0.5 * width
    divisible = width >= finest
    if LOCALIZED:
        for k in range(events(s), events(s) + s.signals):
            if not missed.may_approach(s, k, width) or missed.hardly_varies(s, p, k, x):
                continue
            if divisible and not missed.signal_is_known(s, k, width):
                return 0.5 * width
            if kind != SIGNAL:
                least = least_of(SIGNAL, CLOSEST, s, p, k, low, x)
                if AT_END * width < least - low < (1.0 - AT_END) * width:
                    near = min(near, least)
    if LOCALIZED and kind != SIGNAL:
        near = min(near, one_sided_up_to(s, p, low, x))
    return near - low if near < x else 0.0


def events_are_known(s: Events, p: Parameters, width: float) -> bool:
    """Whether values and slopes at the ends of a stretch determine all event functions.

    width : the length of the stretch, as a fraction of the step.
    """
    known = True
    for k in range(events(s)):
        known = known and event_is_known(s, p, k, width)
    return known


def sections_are_known(s: Events, width: float) -> bool:
    """Whether values and slopes at the ends of a stretch determine all relations.

    width : the length of the stretch, as a fraction of the step. The relations are
    those of sections; an error within the band of a section is allowed.
    """
    for j in range(s.sections):
        k = relations(s) + j
        a = s.sides[j] * s.starts[k]
        m = s.sides[j] * s.middles[k]
        b = s.sides[j] * s.ends[k]
        enough = max(missed.KNOWN * missed.variation(s, k), CLEAR * min(a, m, b))
        enough = max(enough, float(s.bands[j]))
        if max(missed.off(s, k, width), missed.turned(s, k, width)) > enough:
            return False
    return True


def one_sided_up_to(s: Events, p: Parameters, low: float, x: float) -> float:
    """Return a point in (low, x] just past the first jump of a condition, or x.

    A condition with a step has equal values at all points, though its value may differ
    in between.
    """
    width, near = x - low, x
    for k in range(events(s), events(s) + s.signals):
        if s.kinds[k - events(s)] != missed.FALLING:
            continue
        a, m, b = s.starts[k], s.middles[k], s.ends[k]
        error = max(missed.off(s, k, width), missed.turned(s, k, width))
        # An argument far from 0 keeps its sign, whatever rounding leaves of a constant.
        enough = max(
            missed.KNOWN * missed.variation(s, k),
            CLEAR * max(min(a, m, b), -max(a, m, b)),
        )
        doubtful = width >= FINEST and error > enough
        one_sided = min(a, m, b) > 0.0 or max(a, m, b) < 0.0
        if (doubtful or not one_sided) and missed.is_zero(s, p, k, x):
            continue
        if doubtful:
            return low + 0.5 * width
        past = falls_at(s, p, k, low, x) + AT_END * width
        if AT_END * width < past - low < (1.0 - AT_END) * width:
            near = min(near, past)
    return near


def falls_at(s: Events, p: Parameters, k: int, low: float, x: float) -> float:
    """Return the fraction in (low, x] at which row k first becomes negative, or x."""
    if s.starts[k] < 0.0:
        return x
    half = low + BETWEEN * (x - low)
    high = 0.0
    if s.middles[k] < 0.0:
        high = half
    elif missed.lowest(1.0, s, k, s.starts, s.middles, half - low) < 0.0:
        high = least_of(EVENT, NARROW, s, p, k, low, half)
    if high == 0.0 or not value_at(EVENT, s, p, k, high) < 0.0:
        high = x
        if missed.lowest(1.0, s, k, s.middles, s.ends, x - half) < min(0.0, s.ends[k]):
            high = least_of(EVENT, NARROW, s, p, k, half, x)
    if not value_at(EVENT, s, p, k, high) < 0.0:
        return x
    return end_of(EVENT, s, p, k, 0.0, low, high)


def event_is_known(s: Events, p: Parameters, k: int, width: float) -> bool:
    """Whether values and slopes at the ends of a stretch determine event function k.

    width : the length of the stretch, as a fraction of the step.
    """
    a = s.starts[k]
    m = s.middles[k]
    b = s.ends[k]
    # What is off by no more than counts as none cannot be known better, nor can slopes
    # where that rounds.
    enough = max(
        missed.KNOWN * missed.variation(s, k),
        CLEAR * min(a, m, b),
        -least_allowed(s, p, k),
    )
    rounding = 0.0  # also by that of the time
    nothing = -1.0
    if SWITCHES and p.surfaces <= k < s.surfaces:
        # That of a law may be rounding, and its slopes with it.
        rounding = p.law_rounding[k - p.surfaces]
        nothing = -least_allowed(s, p, k)
    if UNTIL and k >= s.surfaces:
        # Of a condition that is held on its edge all is, and its leeway beside it.
        rounding = s.leeway[k - s.surfaces]
        nothing = 2.0 * rounding
    unknown = missed.off(s, k, width) > max(enough, rounding)
    if missed.turned(s, k, width) > max(enough, missed.TURNED / BESIDE * rounding):
        unknown = True
    return not unknown or max(abs(a), abs(m), abs(b)) <= nothing


def value_at(kind: Static, s: Events, p: Parameters, k: int, x: float) -> float:
    """Return the value of row k at the fraction x of the last step.

    For the kind SIGNAL it is the distance of the signal; for CROSSING the relation is
    multiplied by the side from which the motion comes.
    """
    rows_at(kind, s, p, x)
    if kind == SIGNAL:
        return missed.away(s, k, s.values)
    if kind == CROSSING:
        return float(s.sides[k - relations(s)] * s.values[k])
    return float(s.values[k])


def least_of(
    kind: Static,
    rounds: Static,
    s: Events,
    p: Parameters,
    k: int,
    low: float,
    high: float,
) -> float:
    """Return the fraction in [low, high] at which row k is least, by golden section.

    rounds : the number of divisions of the interval.
    """
    left = high - GOLDEN * (high - low)
    right = low + GOLDEN * (high - low)
    at_left = value_at(kind, s, p, k, left)
    at_right = value_at(kind, s, p, k, right)
    for _ in range(rounds):
        if at_left < at_right:
            high = right
            right = left
            at_right = at_left
            left = high - GOLDEN * (high - low)
            at_left = value_at(kind, s, p, k, left)
        else:
            low = left
            left = right
            at_left = at_right
            right = low + GOLDEN * (high - low)
            at_right = value_at(kind, s, p, k, right)
    return 0.5 * (low + high)


# --- events: the first switch, or condition, within the step --------------------------


def find_end(s: Events, p: Parameters) -> None:
    """Search the last step for its first event, and end the step there.

    s.switched becomes the number of the surface or law, or s.event that of the
    condition, from 1. A condition that is true is followed until it is false, and is
    armed from there on: located when it becomes true again.
    """
    t = s.t
    if UNTIL:
        follow_true(s, p)
    search(EVENT, s, p, 0.0)
    while UNTIL and s.event > 0.0:
        passed = int(s.event) - 1
        side, leeway = s.orientation[passed], s.leeway[passed]
        if not goes_on(s, p, passed):
            break
        before = max(s.cut - NEXT, 0.0)
        low = min(s.cut + NEXT, 1.0)  # clear of what rounding makes of a jump
        s.event = 0.0
        s.cut = 0.0
        s.t = t
        s.row_limit = s.arc_rows
        if SWITCHES and mode_ends(s, p, low):
            cut(s, p, before, low)
            if s.switched > 0.0:  # a slip that stops has not passed 0
                s.orientation[passed] = side
                s.leeway[passed] = leeway
        else:
            search(EVENT, s, p, low)
    if UNTIL:
        for k in range(s.conditions):
            if follows(s, k):
                s.orientation[k] = 0.0
            elif s.orientation[k] != 0.0 and s.cut == 0.0:
                # One that is off 0 by more than its leeway needs none.
                clear = s.ends[s.surfaces + k] > 2.0 * s.leeway[k]
                s.leeway[k] = 0.0 if clear else s.leeway[k]
            s.ahead[k] = 0.0


def mode_ends(s: Events, p: Parameters, x: float) -> bool:
    """Whether a mode of a surface or a law has ended at the fraction x of the step."""
    over = False
    keep_values(s, p, x)
    for k in range(s.surfaces):
        over = over or ends(s, p, k, s.kept[k], x)
    return over


def keep_values(s: Events, p: Parameters, x: float) -> None:
    """Store all event functions at the fraction x of the last step in s.kept."""
    rows_at(EVENT, s, p, x)
    s.kept[:] = s.values[: events(s)]


def goes_on(s: Events, p: Parameters, k: int) -> bool:
    """Whether the step continues past a point at which condition k has been located.

    True at the end of a condition that was true, which is armed there, and at a jump of
    the function of an equation, which is no passage of 0.
    """
    if follows(s, k):
        s.orientation[k] = -1.0
    elif s.equation[k] > 0.0 and jumps(s, p, s.surfaces + k):
        s.orientation[k] = -s.orientation[k]
    else:
        return False
    s.leeway[k] = 0.0
    return True


def jumps(s: Events, p: Parameters, k: int) -> bool:
    """Whether event function k jumps where the step is cut, within rounding of x.

    A continuous function changes there by a small part of its change in the time
    before.
    """
    x = s.cut
    now = value_at(EVENT, s, p, k, x)
    jump = value_at(EVENT, s, p, k, x * (1.0 - JUST)) - now
    soon = abs(value_at(EVENT, s, p, k, x * (1.0 - SOON)) - now)
    before = abs(value_at(EVENT, s, p, k, 0.5 * x) - now)
    after = abs(value_at(EVENT, s, p, k, 0.5 * (1.0 + x)) - now)
    least = JUMP * float(s.zero[k - s.surfaces])
    return jump > 0.5 * soon and jump > max(SOON * max(before, after), least)


def follow_true(s: Events, p: Parameters) -> None:
    """Prepare the search for conditions that are true at the start of the last step.

    Inequalities are located when they end; roots of equations once they are left.
    """
    waits = False
    for k in range(s.conditions):
        waits = waits or s.orientation[k] == 0.0
    if waits:
        if s.step_t == s.arc_start:
            follow_roots(s, p)
        x = BESIDE / POINTS
        interpolate(s, p, x, s.work)
        orient(s, p, s.step_t + x * s.step_h, s.work, 0.0)
        for k in range(s.conditions):
            if s.orientation[k] == 0.0 and s.equation[k] == 0.0 and s.leeway[k] < inf:
                s.orientation[k] = 1.0


def follow_roots(s: Events, p: Parameters) -> None:
    """Arm the equations that hold at the start of an arc, to locate their next roots.

    The orientation is the sign of the function just after the start, since another root
    may follow soon. If rounding at the start has the opposite sign, the leeway is kept
    for this step.
    """
    x = NEXT * BESIDE / POINTS
    while x < BESIDE / POINTS:
        interpolate(s, p, x, s.work)
        located(s.step_t + x * s.step_h, s.work, p, s.values)
        for k in range(s.conditions):
            value = s.values[k]
            waits = s.equation[k] > 0.0 and s.orientation[k] == 0.0
            if waits and abs(value) > s.leeway[k]:
                s.orientation[k] = 1.0 if value > 0.0 else -1.0
        x *= FARTHER
    interpolate(s, p, 0.0, s.work)
    located(s.step_t, s.work, p, s.values)
    for k in range(s.conditions):
        if s.equation[k] > 0.0 and s.values[k] * s.orientation[k] > 0.0:
            s.leeway[k] = 0.0


def follows(s: Events, k: int) -> bool:
    """Whether condition k is an inequality that is true, and located when it ends."""
    return not (s.orientation[k] <= 0.0 or s.equation[k] > 0.0)


def least_allowed(s: Events, p: Parameters, k: int) -> float:
    """Return the value of event function k below which its mode ends.

    The value is 0 for a condition.
    """
    if SWITCHES and k < s.surfaces:
        return -max(float(p.slack[k]), float(p.band[k]))
    return 0.0


def ends(s: Events, p: Parameters, k: int, value: float, x: float) -> bool:
    """Whether event function k, with `value` at the fraction x, ends a mode there."""
    if value >= least_allowed(s, p, k):
        return False
    return x >= errs_until(s, p, k, value)


def errs_until(s: Events, p: Parameters, k: int, value: float) -> float:
    """Return the fraction of the step up to which a negative gap counts as an error.

    k : the event function. value : its value, the gap, where it is negative. A gap that
    is open after the step, and neither closes nor is pushed together at its start, is
    open in between: a negative value is an error of the interpolant, as for a body that
    leaves the ground as a power of the time (inf). If the gap is still negative at the
    end of such a step, within the method's error, it counts from then on (1). 0: any
    negative value counts, as of functions that are no gaps.
    """
    law = k - p.surfaces
    if not SWITCHES or not 0 <= law < p.laws or p.law_mode[law] != OFF:
        return 0.0
    is_open = value_at(EVENT, s, p, k, 1.0) >= least_allowed(s, p, k)
    if p.law_kind[law] > FREEWHEEL or not value >= -error_of_gap(s, p, law, is_open):
        return 0.0
    if is_open:
        return inf
    return 1.0 if not ADAPTIVE and p.slack[k] > 0.0 else 0.0


def error_of_gap(s: Events, p: Parameters, k: int, is_open: bool) -> float:
    """Return the error of law k's gap in the last step if it opens at its start.

    0 if the gap does not open there. is_open : whether the gap is open after the step;
    if so, the error is that of the interpolant, by the change of the accelerations;
    else that of the method, by the accelerations. With step control it is the
    tolerance.
    """
    last, first = s.exact_rates[s.velocities], s.spare[s.velocities]
    interpolate(s, p, 1.0, s.work)
    derivative(s.step_t + s.step_h, s.work, p, s.exact_rates)
    interpolate(s, p, 0.0, s.work)
    derivative(s.step_t, s.work, p, s.spare)
    at = p.m - p.laws + k
    row, push, error = p.A[at * s.n :], -p.b[at], 0.0
    roundoff, moved = abs(push), 0.0
    h = s.step_h
    for i in range(s.n):
        push += row[i] * first[i]
        roundoff += abs(row[i]) * max(s.parts[i], abs(first[i]))
        moved += abs(row[i]) * s.sizes[s.n + i]
        bend = abs(last[i] - first[i]) if is_open else max(abs(last[i]), abs(first[i]))
        bend *= h if p.law_kind[k] == FREEWHEEL else 0.5 * h * h
        error += abs(row[i]) * (s.tolerances[i] if ADAPTIVE else bend)
    moved = max(moved, h * roundoff)
    if p.law_speeds[k] < -SUM_ROUNDOFF * moved or push < -SUM_ROUNDOFF * roundoff:
        return 0.0
    return float(error)


def end_within(
    s: Events, p: Parameters, low: float, x: float, before: Floats, after: Floats
) -> float:
    """End the step at the first event in (low, x]; return its fraction, or 0.

    The event is not later than any minimum at which a function is negative: the
    function has ended a mode by then. before, after : (2 R,), rows and slopes at low
    and x.
    """
    high = 0.0
    for k in range(events(s)):
        if ends(s, p, k, after[k], x):
            high = x
    for k in range(events(s)):
        most = min(before[k], after[k], least_allowed(s, p, k))
        if missed.lowest(1.0, s, k, before, after, x - low) < most:
            least = least_of(EVENT, NARROW, s, p, k, low, x)
            if ends(s, p, k, value_at(EVENT, s, p, k, least), least):
                high = least if high == 0.0 else min(high, least)
    if high > 0.0:
        cut(s, p, low, high)
        return s.cut
    if SWITCHES:
        for k in range(s.surfaces):
            if after[k] > p.slack[k]:
                p.slack[k] = 0.0
    return 0.0


def cut(s: Events, p: Parameters, low: float, high: float) -> None:
    """End the step at the first point in (low, high] at which a mode ends.

    The point is the root of the event function, even if only a value well below 0
    revealed that the mode ends.
    """
    first = events(s)
    s.event = 0.0
    s.switched = 0.0
    keep_values(s, p, high)
    for k in range(events(s)):
        if ends(s, p, k, s.kept[k], high):
            first = k
            least = least_allowed(s, p, k)
            if value_at(EVENT, s, p, k, low) >= 0.0:
                least = 0.0
            if errs_until(s, p, k, s.kept[k]) == 0.0:
                high = end_of(EVENT, s, p, k, least, low, high)
            if SWITCHES and least < 0.0:
                # A flight that began a rounding below ends where it is over.
                middle = 0.5 * (low + high)
                if value_at(EVENT, s, p, k, middle) > p.slack[k]:
                    high = end_of(EVENT, s, p, k, -float(p.band[k]), middle, high)
            keep_values(s, p, high)
    if UNTIL and first >= s.surfaces:
        s.event = first - s.surfaces + 1.0
    else:
        s.switched = first + 1.0
    if SWITCHES:
        for k in range(p.laws):
            law = p.surfaces + k
            value = s.kept[law]
            over = not value >= least_allowed(s, p, law)
            errs = over and errs_until(s, p, law, value) > 0.0
            p.law_opens[k] = 1.0 if errs else 0.0
    shorten(s, high)
    # Rows at the same instant are the next arc's.
    same = SAME_INSTANT * max(abs(s.t), abs(s.row_start))
    s.row_limit = min(s.row_limit, s.t - same)


def end_of(
    kind: Static,
    s: Events,
    p: Parameters,
    k: int,
    least: float,
    low: float,
    high: float,
) -> float:
    """Return the first point in (low, high] at which row k is below `least`.

    The point is located by the ITP method: the secant, moved toward the middle, with no
    more evaluations than bisection needs, but for one. The iteration ends at two
    neighbouring numbers, and the larger one is returned.

    Source: I. F. D. Oliveira and R. H. C. Takahashi, An enhancement of the bisection
    method average performance preserving minmax optimality, ACM Trans. Math. Softw. 47
    (2020).
    """
    at_low = value_at(kind, s, p, k, low) - least
    at_high = value_at(kind, s, p, k, high) - least
    curved = ITP / (high - low)
    most = 2.0 * (high - low)  # of half the bracket, by bisections that are left
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        most *= 0.5
        x = middle
        if at_low - at_high > 0.0:
            x = low + (high - low) * (at_low / (at_low - at_high))
        width = high - low
        toward = 1.0 if x < middle else -1.0
        moved = min(curved * width * width, abs(middle - x))
        x += toward * moved
        free = max(0.0, most - 0.5 * width)
        if not abs(x - middle) <= free:
            x = middle - toward * free
        if not (low < x and x < high):
            x = middle
        value = value_at(kind, s, p, k, x) - least
        if value >= 0.0:
            low = x
            at_low = value
        else:
            high = x
            at_high = value
        middle = 0.5 * (low + high)
    return high


def shorten(s: Events, x: float) -> None:
    """End the last step at its fraction x.

    The state after the step is kept until the rows before x are written: methods may
    interpolate from it.
    """
    s.cut = x
    s.t = s.step_t + x * s.step_h


def orient(s: Events, p: Parameters, t: float, y: Floats, most: float) -> None:
    """Arm the conditions that are false at y (size,), to be located when they are true.

    Inequalities are armed only with a leeway of at most `most`.
    """
    values = s.values
    located(t, y, p, values)
    for k in range(s.conditions):
        if s.orientation[k] == 0.0 and (s.equation[k] > 0.0 or s.leeway[k] <= most):
            if values[k] < -s.leeway[k]:
                s.orientation[k] = -1.0
                s.leeway[k] = 0.0
            elif s.equation[k] > 0.0 and values[k] > s.leeway[k]:
                s.orientation[k] = 1.0
                s.leeway[k] = 0.0


# --- features that the step has missed ------------------------------------------------

# Growth of the distance on the shoulders of a closest approach, where slopes are
# compared as well: at the top of a hill itself there is no force.
SHOULDER = 0.3
FOOT = 8.0
# Number of doublings that lead from there to the other end of any step.
DOUBLINGS = 60


def missed_feature(s: Events, p: Parameters) -> float:
    """Return the fraction of the last step at which a localized term is missed, or 0.

    There the dense output lacks a term of the forces (a pulse, a steep wall), or the
    search must stop for the number of its points.
    """
    rows_at(SIGNAL, s, p, 0.0)
    for k in range(s.signals):
        s.farthest[k] = missed.away(s, events(s) + k, s.values)
    return search(SIGNAL, s, p, 0.0)


def missed_within(s: Events, p: Parameters, low: float, high: float) -> float:
    """Return the fraction in [low, high] at which a localized term is missed, or 0.

    The largest distance of each signal since its last approach is updated.
    """
    half = BETWEEN * (high - low)
    for k in range(events(s), events(s) + s.signals):
        own = k - events(s)
        least = min(
            missed.closest(s, k, s.starts, s.middles, half),
            missed.closest(s, k, s.middles, s.ends, high - low - half),
        )
        if s.farthest[own] - least > APPROACH:
            x = least_of(SIGNAL, CLOSEST, s, p, k, low, high)
            # Or it comes closer still, or the next step begins there.
            inside = high - x >= AT_END * (high - low)
            if inside or (high == 1.0 and s.t >= missed.next_end(s, p)):
                found = missed_about(s, p, k, x)
                if found > 0.0:
                    expect(s, p, found)
                    return found
                s.farthest[own] = value_at(SIGNAL, s, p, k, x)
        s.farthest[own] = max(s.farthest[own], missed.away(s, k, s.ends))
    return 0.0


def expect(s: Events, p: Parameters, x: float) -> None:
    """Raise sizes by the defect at the fraction x, unless a mode ends before x.

    Past the end of a mode the step is no motion, and its rates may have any magnitude.
    """
    if SWITCHES:
        rows_at(EVENT, s, p, x)
        for k in range(s.surfaces):
            if s.values[k] < least_allowed(s, p, k):
                return
    missed.expect(s)


def missed_about(s: Events, p: Parameters, k: int, x: float) -> float:
    """Compare slopes at the closest approach of signal k, at x, and beside it.

    Return the fraction at which the slopes of the dense output and of the equations
    differ, or 0.
    """
    if missed.is_missed(s, p, x):
        return x
    least = value_at(SIGNAL, s, p, k, x)
    beside = 2.0**-50
    left = True
    right = True
    for _ in range(DOUBLINGS):
        beside *= 2.0
        if left:
            left = x - beside > 0.0
            far = value_at(SIGNAL, s, p, k, x - beside) - least if left else 0.0
            left = left and far < FOOT
            if left and far > SHOULDER and missed.is_missed(s, p, x - beside):
                return x - beside
        if right:
            right = x + beside < 1.0
            far = value_at(SIGNAL, s, p, k, x + beside) - least if right else 0.0
            right = right and far < FOOT
            if right and far > SHOULDER and missed.is_missed(s, p, x + beside):
                return x
    return 0.0


# --- losses of rank -------------------------------------------------------------------

# A loss of rank is located to 1e-9 of a stretch.
NARROWER = 44


def loses_rank(s: Events, p: Parameters) -> bool:
    """Whether rank is lost within the last step; s.work is then the state there."""
    return s.watched > 0.0 and search(RANK, s, p, 0.0) > 0.0


def lost_within(s: Events, p: Parameters, low: float, x: float) -> float:
    """Return the fraction of the step in [low, x] at which rank is lost, or 0.

    Sigma has a kink there, and small jumps where rows change their order, which may
    hide the sign of its slope: a stretch is searched where values or slopes fall and
    rise again, or where sigma could vanish in between at the steepest slope so far. On
    a set of states that all lose rank, where sigma vanishes at an end, the latter does
    not count.
    """
    k = rows(s) - 1
    slopes = rows(s) + k
    falls = s.starts[slopes] < 0.0 or s.middles[k] < s.starts[k]
    rises = s.ends[slopes] > 0.0 or s.middles[k] < s.ends[k]
    steepest = MARGIN * s.sigma_slope * s.step_h * (x - low)
    ends = min(s.starts[k], s.ends[k])
    vanishes = ends > LOST and s.starts[k] + s.ends[k] <= steepest
    if not (falls and rises) and not vanishes:
        return 0.0
    # The slope at the start is that just before.
    low = max(low - BESIDE * (x - low), 0.0)
    x = least_of(RANK, NARROWER, s, p, k, low, x)
    if value_at(RANK, s, p, k, x) >= s.lost_below:
        return 0.0
    s.lost_at = s.step_t + x * s.step_h
    return x
