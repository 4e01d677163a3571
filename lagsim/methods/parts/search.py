"""The search of the last step: for events, features and losses of rank.

What is searched is a table of rows, functions of the fraction x of the step, by the
dense output:

    EVENT    the event function of a surface, a law or a condition: how far the state
             is from leaving a mode, or from making a condition true. It ends the step
             where it falls below 0, or below its slack
    SIGNAL   the distance of the argument of a localized term from where that acts. The
             step is rejected where the term acts and the dense output does not show it
    RANK     the smallest singular value of the constraint rows. A loss is noted

Values and slopes of event functions and signals are taken at several points, and once
more between each two: where the value there does not follow from values and slopes at
both, the points come closer until it does (`cubic`). Only then what happens between two
points is looked for: an event function that is negative at one, or by the slopes may
have been between them (a touch, a narrow pulse); the closest approach of a signal. A
minimum within a stretch is located by golden section (`least_of`), and the first moment
at which something ends by bisection, to the last bit.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from lagsim.language.arrays import Floats
from lagsim.methods.parts import missed
from lagsim.methods.parts.constraints import FALLS, sigma_at
from lagsim.methods.parts.missed import (
    APPROACH,
    BETWEEN,
    FLAT,
    GOLDEN,
    Signals,
    apart,
    away,
    closest,
    cubic,
    cubic_slope,
    hardly_varies,
    is_missed,
    signals_at,
)
from lagsim.methods.parts.parameters import FREEWHEEL, OFF, Parameters
from lagsim.methods.parts.state import (
    derivative,
    event_functions,
    interpolate,
    located,
)
from lagsim.native.layout import array
from lagsim.tolerances import SUM_ROUNDOFF, TINY

if TYPE_CHECKING:
    from lagsim.native.kernels.words import Static

UNTIL = True
SWITCHES = True
LOCALIZED = True
ADAPTIVE = True

EVENT, SIGNAL, RANK = 0, 1, 2


class Events(Signals):
    """Event functions of modes, and of the conditions of events and `until`."""

    surfaces: int  # that switches are located on, and laws whose modes end
    conditions: int  # of events and `until`, which are located when they become true

    event: float  # the number, from 1, of the condition that has been located; or 0
    switched: float  # the number, from 1, of the surface a switch was located on; or 0

    # A condition holds where this times its function is <= 0; 0: not armed, it has not
    # been false since, that is less than 0 by more than the leeway.
    orientation: Floats = array("conditions")
    equation: Floats = array("conditions")  # 1 of an equation
    leeway: Floats = array("conditions")

    # Event functions of surfaces and of conditions at a point; with their slopes, at
    # the start of a stretch, within it and at its end.
    event_functions: Floats = array(lambda s: s.surfaces + s.conditions)
    event_starts: Floats = array(lambda s: 2 * (s.surfaces + s.conditions))
    event_middles: Floats = array(lambda s: 2 * (s.surfaces + s.conditions))
    event_ends: Floats = array(lambda s: 2 * (s.surfaces + s.conditions))


# --- events: the first switch, or condition, within the step --------------------------

# Event functions are evaluated at so many points of a step at least.
POINTS = 8
# Slopes are differences over this part of the way between points: closer than anything
# that a method resolves.
BESIDE = 2.0**-10
# One is known between two points where that in the middle is what the ends tell up
# to the first part of how it varies, or the last of the least of it; the slope there
# counts as the second says. Of points that are too far apart one of both may agree by
# chance, hardly both.
KNOWN = 0.1
TURNED = 0.25
CLEAR = 0.25
# Points come no closer than this, and there are so many in a step.
FINEST = 2.0**-14
# Or than this about a localized term; this many times it where points have run out
# before this part of the step: so many steps at most for one.
NARROWEST = 2.0**-40
COARSER = 16.0
LEAST_PART = 2.0**-5
MOST_POINTS = 2000
# The error of a minimum is of the square of the part of a stretch, 1e-8, that it is
# located to by so many golden sections.
NARROW = 39


def of_surfaces(p: Parameters) -> int:
    """Count of the event functions of surfaces and laws; conditions come after."""
    if SWITCHES:
        return p.surfaces + p.laws
    return 0


def watched(s: Events, p: Parameters) -> int:
    """Count of all event functions (C)."""
    if UNTIL:
        return of_surfaces(p) + s.conditions
    return of_surfaces(p)


def find_end(s: Events, p: Parameters) -> None:
    """Search the last step for its first event, and end it there.

    s.switched becomes the number of the surface, or s.event that of the condition. One
    that is true is followed until it is false: from there on it counts.
    """
    t = s.t
    if UNTIL:
        if s.step_t == s.arc_start and true_at_once(s, p):
            cut(s, p, 0.0, TINY)
            return
        follow_true(s, p)
    search(s, p, 0.0)
    while UNTIL and s.event > 0.0 and follows(s, int(s.event) - 1):
        low = s.cut
        s.orientation[int(s.event) - 1] = -1.0
        s.leeway[int(s.event) - 1] = 0.0
        s.event = 0.0
        s.cut = 0.0
        s.t = t
        s.row_limit = s.arc_rows
        search(s, p, low)
    if UNTIL:
        for k in range(s.conditions):
            if follows(s, k):
                s.orientation[k] = 0.0


def true_at_once(s: Events, p: Parameters) -> bool:
    """Whether a condition that was false is true at the start: a velocity has jumped.

    Or a mode has been set. It need not be true for long, and be false at all points of
    the step. Asked of the first step of an arc.
    """
    events_at(s, p, 0.0)
    for k in range(s.conditions):
        if not s.event_functions[of_surfaces(p) + k] > 0.0:
            return True
    return False


def follow_true(s: Events, p: Parameters) -> None:
    """Follow the inequalities that are true at the start of the last step."""
    waits = False
    for k in range(s.conditions):
        waits = waits or s.orientation[k] == 0.0
    if waits:
        x = BESIDE / POINTS
        interpolate(s, p, x, s.work)
        orient(s, p, s.step_t + x * s.step_h, s.work, 0.0)
        for k in range(s.conditions):
            if s.orientation[k] == 0.0 and s.equation[k] == 0.0 and s.leeway[k] < inf:
                s.orientation[k] = 1.0


def follows(s: Events, k: int) -> bool:
    """Whether condition k is an inequality that is true, and watched for its end."""
    return not (s.orientation[k] <= 0.0 or s.equation[k] > 0.0)


def search(s: Events, p: Parameters, low: float) -> None:
    """Go through the last step from its fraction `low` on."""
    count = watched(s, p)
    first, middle, last = s.event_starts, s.event_middles, s.event_ends
    widest = 2.0 / POINTS
    width = widest
    narrowest = NARROWEST
    points = 0
    high = 0.0
    sample(s, p, low, BESIDE * width, first)
    while low < 1.0 and high == 0.0:
        x = min(low + width, 1.0)
        half = low + BETWEEN * (x - low)
        sample(s, p, half, -BESIDE * width, middle)
        sample(s, p, x, -BESIDE * width, last)
        points += 2
        clear = x - low < FINEST or known(s, p, x - low)
        if LOCALIZED and clear and x - low > narrowest:
            clear = none_approaches(s, p, low, x)
        if clear:
            high = first_end(s, p, low, half, first, middle)
            if high > 0.0:
                x = half
            else:
                high = first_end(s, p, half, x, middle, last)
                if high > 0.0:
                    low = half
            if high > 0.0:
                cut(s, p, low, high)
            first[: 2 * count] = last[: 2 * count]
            low = x
            width = min(2.0 * width, widest)
        elif points >= MOST_POINTS and low > LEAST_PART:
            s.cut = low
            s.t = s.step_t + low * s.step_h
            return
        else:
            if points >= MOST_POINTS:
                points = 0
                narrowest *= COARSER
            width = 0.5 * (x - low)
            sample(s, p, low, BESIDE * width, first)


def none_approaches(s: Events, p: Parameters, low: float, x: float) -> bool:
    """Whether no signal comes closer inside a stretch than at its ends.

    A event function that is made of one would be flat at every point.
    """
    signals_at(s, p, low, s.signals_first)
    signals_at(s, p, low + BETWEEN * (x - low), s.signals_middle)
    signals_at(s, p, x, s.signals_last)
    still = True
    for k in range(s.signals):
        if still and missed.may_approach(s, k, (x - low) * s.step_h):
            still = hardly_varies(s, p, k, x)
    return still


def events_at(s: Events, p: Parameters, x: float) -> None:
    """Leave the event functions at the fraction x of the last step."""
    z, now = s.work, s.event_functions
    t = s.step_t + x * s.step_h
    interpolate(s, p, x, z)
    if SWITCHES:
        event_functions(t, z, p, now)
    if UNTIL:
        own = now[of_surfaces(p) :]
        located(t, z, p, own)
        for k in range(s.conditions):
            own[k] = own[k] * s.orientation[k] + s.leeway[k]
            if s.orientation[k] == 0.0:
                own[k] = 1.0
            if own[k] == 0.0 and follows(s, k):
                own[k] = TINY  # of what is true, 0 is not its end


def sample(s: Events, p: Parameters, x: float, beside: float, out: Floats) -> None:
    """Margins and slopes (2 C,) at the fraction x of the last step."""
    count = watched(s, p)
    now = s.event_functions
    events_at(s, p, x + beside)
    out[count : 2 * count] = now[:count]
    events_at(s, p, x)
    out[:count] = now[:count]
    out[count : 2 * count] = (out[count : 2 * count] - now[:count]) / beside


def known(s: Events, p: Parameters, width: float) -> bool:
    """Whether all event functions on a stretch follow from values at its ends."""
    count = watched(s, p)
    for k in range(count):
        a = s.event_starts[k]
        m = s.event_middles[k]
        b = s.event_ends[k]
        A = width * s.event_starts[count + k]
        B = width * s.event_ends[count + k]
        off = abs(cubic(BETWEEN, a, A, b, B) - m)
        turned = cubic_slope(BETWEEN, a, A, b, B) - width * s.event_middles[count + k]
        turned = TURNED * abs(turned)
        reach = max(abs(m - a), abs(m - b))
        # What is off by no more than counts as none cannot be known better, nor can
        # slopes where that rounds.
        enough = max(KNOWN * reach, CLEAR * min(a, m, b), -least_allowed(p, k))
        rounding = 0.0  # also by that of the time
        nothing = -1.0
        if SWITCHES and p.surfaces <= k < p.surfaces + p.laws:
            # That of a law may be rounding, and its slopes with it.
            rounding = p.law_rounding[k - p.surfaces]
            nothing = -least_allowed(p, k)
        if UNTIL and k >= of_surfaces(p):
            # Of a condition that is held on its edge all is, and its leeway beside it.
            rounding = s.leeway[k - of_surfaces(p)]
            nothing = 2.0 * rounding
        unknown = off > max(enough, rounding)
        unknown = unknown or turned > max(enough, TURNED / BESIDE * rounding)
        if unknown and not max(abs(a), abs(m), abs(b)) <= nothing:
            return False
    return True


def least_allowed(p: Parameters, k: int) -> float:
    """Value of an event function below which a mode ends; 0 of a condition."""
    if SWITCHES and k < p.surfaces + p.laws:
        return -max(float(p.slack[k]), float(p.band[k]))
    return 0.0


def over(p: Parameters, k: int, value: float) -> bool:
    """Whether the mode is over by event function k."""
    if UNTIL and k >= of_surfaces(p):
        return not value > 0.0
    return not value >= least_allowed(p, k)


def ends(s: Events, p: Parameters, k: int, value: float, x: float) -> bool:
    """Whether a mode ends at the fraction x of the last step, by event function k."""
    return over(p, k, value) and x >= errs_until(s, p, k, value)


def errs_until(s: Events, p: Parameters, k: int, value: float) -> float:
    """Fraction of the last step up to which a gap has such a value by an error.

    One that is open after the step, and neither closes at its start nor is pushed to,
    is open in between: where it is not, the interpolant errs, as it does about what
    leaves the ground as a power of the time. What has not risen at the end of such a
    step either is below its ground by the method's error, and on it from then on.
    """
    law = k - p.surfaces
    if not SWITCHES or not 0 <= law < p.laws or p.law_mode[law] != OFF:
        return 0.0
    is_open = not over(p, k, value_at(EVENT, s, p, k, 1.0))
    if p.law_kind[law] > FREEWHEEL or not value >= -error_of_gap(s, p, law, is_open):
        return 0.0
    if is_open:
        return inf
    return 1.0 if not ADAPTIVE and p.slack[k] > 0.0 else 0.0


def error_of_gap(s: Events, p: Parameters, k: int, is_open: bool) -> float:
    """Error in the last step of law k, if it parts at the start; 0 if it does not.

    Of the interpolant, by what the accelerations change in the step; of the method
    where the gap is not open after it, by these themselves; or the tolerance.
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


def first_end(
    s: Events, p: Parameters, low: float, x: float, before: Floats, after: Floats
) -> float:
    """Point in (low, x] where something ends, or 0.

    No later than any least function that is negative: what has ended is so there still.
    before, after : (2 C,), event functions and slopes there.
    """
    count = watched(s, p)
    high = 0.0
    for k in range(count):
        if ends(s, p, k, after[k], x):
            high = x
    for k in range(count):
        fall = before[count + k]
        rise = after[count + k]
        if touches(x - low, before[k], fall, after[k], rise):
            least = least_of(EVENT, NARROW, s, p, k, low, x)
            if ends(s, p, k, value_at(EVENT, s, p, k, least), least):
                high = least if high == 0.0 else min(high, least)
    if SWITCHES and high == 0.0:
        slack = p.slack
        for k in range(p.surfaces + p.laws):
            if after[k] > slack[k]:
                slack[k] = 0.0
    return high


def touches(width: float, a: float, fall: float, b: float, rise: float) -> bool:
    """Whether a event function could be negative between a and b.

    It falls at the start and rises at the end; a convex one stays above its tangents.
    """
    if fall >= 0.0 or rise <= 0.0:
        return False
    meets = (b - a - rise * width) / (fall - rise)
    return a + fall * meets < 0.0


def cut(s: Events, p: Parameters, low: float, high: float) -> None:
    """End the step at the first moment in (low, high] at which something ends.

    That is where its function vanishes, also where only one well below 0 tells it.
    """
    count = watched(s, p)
    first = count
    for k in range(count):
        if ends(s, p, k, value_at(EVENT, s, p, k, high), high):
            first = k
            least = least_allowed(p, k)
            if value_at(EVENT, s, p, k, low) >= 0.0:
                least = 0.0
            if errs_until(s, p, k, value_at(EVENT, s, p, k, high)) == 0.0:
                high = end_of(s, p, k, least, low, high)
            if SWITCHES and least < 0.0:
                # A flight that began a rounding below ends where it is over.
                middle = 0.5 * (low + high)
                if value_at(EVENT, s, p, k, middle) > p.slack[k]:
                    high = end_of(s, p, k, -float(p.band[k]), middle, high)
    if UNTIL and first >= of_surfaces(p):
        s.event = first - of_surfaces(p) + 1.0
    else:
        s.switched = first + 1.0
    if SWITCHES:
        for k in range(p.laws):
            law = p.surfaces + k
            value = value_at(EVENT, s, p, law, high)
            errs = over(p, law, value) and errs_until(s, p, law, value) > 0.0
            p.law_opens[k] = 1.0 if errs else 0.0
    shorten(s, high)


def end_of(
    s: Events, p: Parameters, k: int, least: float, low: float, high: float
) -> float:
    """Return the first point in (low, high] at which function k is below `least`."""
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        value = value_at(EVENT, s, p, k, middle)
        ended = not value >= least
        if UNTIL and k >= of_surfaces(p):
            ended = not value > 0.0
        if ended:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    return high


def shorten(s: Events, x: float) -> None:
    """End the last step at its fraction x.

    Its state stays until the rows before that moment are written: methods may
    interpolate from it.
    """
    s.cut = x
    s.t = s.step_t + x * s.step_h
    s.row_limit = min(s.row_limit, s.t)


def value_at(kind: Static, s: Events, p: Parameters, k: int, x: float) -> float:
    """Value of row k of a kind at the fraction x of the last step."""
    if kind == RANK:
        return sigma_at(s, p, x)
    if kind == SIGNAL:
        return apart(s, p, k, x)
    events_at(s, p, x)
    return float(s.event_functions[k])


def least_of(
    kind: Static,
    rounds: Static,
    s: Events,
    p: Parameters,
    k: int,
    low: float,
    high: float,
) -> float:
    """Where row k of a kind is least in [low, high], by so many golden sections."""
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


def orient(s: Events, p: Parameters, t: float, y: Floats, most: float) -> None:
    """Arm the conditions that are false at a state: they count from then on.

    Of inequalities those with no more leeway than `most`.
    """
    values = s.event_functions
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

# On the shoulders of a closest approach, where the distance has grown by so much: at
# the top of a hill itself there is no force.
SHOULDER = 0.3
FOOT = 8.0
# So many doublings lead from there to the other end of any step.
DOUBLINGS = 60
# A closest approach is located to rounding by so many golden sections.
CLOSEST = 80
# Signals are evaluated at so many points of a step; one that needs more is too long.
MOST_SIGNALS = 400
# Nothing is divided further, and a step not shortened to less than the second.
FINEST_SIGNALS = 2.0**-12
PART = 0.25
# At the end of a stretch within this part of it.
AT_END = 1e-9


def missed_feature(s: Events, p: Parameters) -> float:
    """Fraction of the last step at which the dense output misses a feature.

    Or 0 where there is none. A step that cannot be searched by MOST_SIGNALS counts too.
    """
    h = s.step_h
    signals_at(s, p, 0.0, s.signals_first)
    for k in range(s.signals):
        s.farthest[k] = away(s, k, s.signals_first)
    low = 0.0
    width = 0.5
    points = 0
    while low < 1.0:
        high = min(low + width, 1.0)
        signals_at(s, p, high, s.signals_last)
        signals_at(s, p, low + BETWEEN * (high - low), s.signals_middle)
        points += 2
        clear = True
        for k in range(s.signals):
            if clear and not missed.known(s, k, (high - low) * h):
                clear = hardly_varies(s, p, k, high)
        if clear or high - low < FINEST_SIGNALS:
            found = search_stretch(s, p, low, high)
            if found > 0.0:
                return found
            s.signals_first[:] = s.signals_last
            low = high
            width = 2.0 * width
        elif points >= MOST_SIGNALS:
            return max(high, PART)
        else:
            width = 0.5 * (high - low)
    return 0.0


def search_stretch(s: Events, p: Parameters, low: float, high: float) -> float:
    """Search between two points for signals that come close, see `missed_feature`.

    Keeps how far each has been since.
    """
    farthest = s.farthest
    width = (high - low) * s.step_h
    found = 0.0
    for k in range(s.signals):
        least = min(
            closest(s, k, s.signals_first, s.signals_middle, BETWEEN * width),
            closest(s, k, s.signals_middle, s.signals_last, (1.0 - BETWEEN) * width),
        )
        end = away(s, k, s.signals_last)
        if farthest[k] - least > APPROACH and found == 0.0:
            found = search_approach(s, p, k, low, high)
            if end - least > FLAT:
                farthest[k] = least
        farthest[k] = max(farthest[k], end)
    return found


def search_approach(s: Events, p: Parameters, k: int, low: float, high: float) -> float:
    """Compare slopes at the closest approach of signal k in [low, high], and around."""
    x = least_of(SIGNAL, CLOSEST, s, p, k, low, high)
    if high - x < AT_END * (high - low):
        return 0.0  # it comes closer still, or the next step begins there
    if is_missed(s, p, x):
        return x
    least = apart(s, p, k, x)
    beside = 2.0**-50
    left = True
    right = True
    for _ in range(DOUBLINGS):
        beside *= 2.0
        if left:
            left = x - beside > 0.0
            far = apart(s, p, k, x - beside) - least if left else 0.0
            left = left and far < FOOT
            if left and far > SHOULDER and is_missed(s, p, x - beside):
                return x - beside
        if right:
            right = x + beside < 1.0
            far = apart(s, p, k, x + beside) - least if right else 0.0
            right = right and far < FOOT
            if right and far > SHOULDER and is_missed(s, p, x + beside):
                return x
    return 0.0


# --- losses of rank -------------------------------------------------------------------

# A loss of rank is looked for where sigma is less at one of these parts of a step,
# or falls over this first part of it and rises over the last; it is located to 1e-9.
PARTS = 8
NUDGE = 1e-3
NARROWER = 44


def loses_rank(s: Events, p: Parameters) -> bool:
    """Whether rank is lost within the last step, where it is to be searched for that.

    The state where it is found is left in the working memory.
    """
    if s.watched == 0.0:
        return False
    low = lowest_part(s, p)
    if low < 0.0:
        return False
    high = 1.0
    if low > 0.0:
        high = low + 1.0 / PARTS
        low -= 1.0 / PARTS
    low = least_of(RANK, NARROWER, s, p, 0, low, high)
    if sigma_at(s, p, low) < s.lost_below:
        s.lost_at = s.step_t + low * s.step_h
        return True
    return False


def lowest_part(s: Events, p: Parameters) -> float:
    """Fraction of the last step at which the smallest singular value is least.

    0 where it is somewhere in it, and below 0 where it is at an end. What the sigma is
    told as jumps a little where rows change their order: close to an end that hides
    whether it falls.
    """
    lowest = FALLS * min(s.previous_sigma, s.sigma)
    found = -1.0
    for k in range(1, PARTS):
        sigma = sigma_at(s, p, k / PARTS)
        if sigma < lowest:
            lowest = sigma
            found = k / PARTS
    falls = found < 0.0 and sigma_at(s, p, NUDGE) < s.previous_sigma
    if falls and sigma_at(s, p, 1.0 - NUDGE) < s.sigma:
        return 0.0
    return found
