"""Search beside switches in conditions: stretches of a step between them, and zeros.

A condition with a step (`floor(x) = 1`) or a kink (`abs(x) <= 0`) is smooth between the
switches in its expression, whose arguments are signals of the kind FALLING. A stretch,
a part of a step, ends just before the first switch (`one_sided_up_to`), and the next
one, of the length of rounding, leads over it (`sample_past`): there the rows may jump,
and a condition may be 0 on one side only (`zero_at`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from lagsim.methods.parts.missed import AT_END, is_zero
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.search_table import (
    ARGUMENT,
    AROUND,
    BESIDE,
    CLEAR,
    EVENT,
    FALLING,
    KNOWN,
    NEXT,
    SearchTable,
    end_of,
    error_between,
    events,
    follows,
    margin,
    minimum_in_half,
    rows,
    rows_at,
    same_time,
    sample,
    sampled,
    state_at,
    value_at,
    variation,
)
from lagsim.methods.parts.state import located, located_slopes
from lagsim.methods.parts.truth import terms_of
from lagsim.tolerances import SUM_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.native.kernels.words import Static

UNTIL = True

# Least distance of sample points in a step.
FINEST = 2.0**-14
# A jump is within this distance of its switch, as a part of a step.
NEARBY = 2.0**-40
# Length of the stretch past a switch beside which slopes vary, as a part of the step.
CLOSE = 2.0**-16
# A value beside a switch may be 0 there if it is below this part of its change.
ZERO = 2.0**-10


def one_sided_up_to(s: SearchTable, p: Parameters) -> float:
    """Return the end of the part of the stretch in which no condition jumps.

    It is a point just before the first switch in a condition, whose fraction is stored
    in `switch`; the middle of the stretch, if values do not yet determine an argument;
    or the end of the stretch. A condition with a step may have equal values at all
    points of a stretch, and others in between.
    """
    low, x = float(s.places[0]), float(s.places[2])
    width, first = x - low, inf
    for k in range(events(s), events(s) + s.signals):
        if s.kinds[k - events(s)] != FALLING:
            continue
        a, m, b = s.starts[k], s.middles[k], s.ends[k]
        error = error_between(s, k)
        # An argument far from 0 keeps its sign, whatever the rounding of a constant is.
        clear = max(min(a, m, b), -max(a, m, b))
        enough = max(KNOWN * variation(s, k), CLEAR * clear)
        doubtful = width >= FINEST and error > enough
        one_sided = min(a, m, b) > 0.0 or max(a, m, b) < 0.0
        if (doubtful or not one_sided) and is_zero(s, p, k):
            continue
        if not doubtful:
            first = min(first, switch_of(s, p, k))
        elif first == inf:
            return low + 0.5 * width
    if first == inf:
        return x
    if s.switch == inf:
        s.usual = width
    s.switch = first
    return max(first - NEARBY, low)


def switch_of(s: SearchTable, p: Parameters, k: int) -> float:
    """Return the fraction in the stretch at which signal k is 0 or falls below 0.

    The result is inf if there is none. In a stretch that begins just past a switch, a
    zero close to the start is this switch, and does not count.
    """
    low, x = float(s.places[0]), float(s.places[2])
    tiny = NEARBY * variation(s, k)
    begun = low == s.past
    if abs(s.starts[k]) <= tiny and not begun:
        return low
    switch = falls_at(s, p, k)
    if begun and switch - low <= AT_END * (x - low):
        return inf
    falls = switch < x or s.ends[k] < 0.0 <= s.starts[k] or abs(s.ends[k]) <= tiny
    return switch if falls else inf


def falls_at(s: SearchTable, p: Parameters, k: int) -> float:
    """Return the fraction at which row k becomes negative, or the stretch's end."""
    if s.starts[k] < 0.0:
        return float(s.places[2])
    for half in range(2):
        high, value = float(s.places[half + 1]), sampled(s, k, half + 1)
        if not value < 0.0:
            high = minimum_in_half(ARGUMENT, s, p, k, half, 0.0)
            if high < s.places[half + 1]:
                value = value_at(ARGUMENT, s, p, k, high)
        if value < 0.0:
            return end_of(ARGUMENT, s, p, k, 0.0, s.places[half], high)
    return float(s.places[2])


def sample_past(
    kind: Static, s: SearchTable, p: Parameters, low: float, past: float
) -> float:
    """Sample the rows of a kind at the end of a stretch over a switch; return the end.

    The rows may jump within: their slopes count as 0. The stretch ends at the first
    fraction past a switch on one side of which a condition is 0, see `zero_at`.

    low, past : the fractions just before and after the switch.
    """
    count = rows(s)
    beside = BESIDE * s.usual
    sample(kind, s, p, past, beside, s.ends)
    if UNTIL and kind == EVENT:
        zero = zero_at(s, p, low, past)
        if low < zero and zero < past:
            past = zero
            sample(kind, s, p, past, beside, s.ends)
    s.middles[:count] = s.ends[:count]
    s.middles[count : 2 * count] = 0.0
    s.starts[count : 2 * count] = 0.0
    if kind == EVENT:  # a mode has ended if its row is below 0 at the end
        s.starts[:count] = s.ends[:count]
    s.places[0], s.places[1] = low, past
    s.places[2] = s.past = past
    s.switch = inf
    rows_at(kind, s, p, past + NEXT)
    for k in range(events(s) + s.signals):
        change, near = s.ends[count + k], (s.values[k] - s.ends[k]) / NEXT
        if abs(near - change) > KNOWN * max(abs(near), abs(change)):
            s.usual = min(s.usual, CLOSE)  # another switch may be close
    return past


def zero_at(s: SearchTable, p: Parameters, low: float, past: float) -> float:
    """Return the fraction just past a switch on one side of which a condition is 0.

    The result is inf if no false condition is 0 there. It is stored in `zero_at`:
    the condition becomes true, if only for an instant. For example the value of
    `mod(x, 1) = 0` jumps from 1 to 0, or from 0 to 1; `abs(x) <= 0` has a kink. A value
    that has not been clear of 0 since the condition was true does not count.

    low, past : as for `sample_past`; rows are known there.
    """
    first = inf
    for k in range(s.conditions):
        if s.kinked[k] == 0.0:
            continue
        armed = abs(s.orientation[k]) == 1.0 and not follows(s, k)
        armed = armed and margin(s, s.surfaces + k) == 0.0 and s.armed_at[k] <= s.switch
        leaves = s.starts[s.surfaces + k] < 2.0 * s.leeway[k] and s.imprecise[k] == 0.0
        armed = armed and not leaves
        armed = armed and may_be_zero(s, k, low, past)
        if armed and is_zero_beside(s, p, k, s.switch):
            x = past_jump(s, p, k, s.switch)
            if low < x and x < inf:
                s.zero_at[k] = x
                first = min(first, x)
    return first


def may_be_zero(s: SearchTable, k: int, low: float, past: float) -> bool:
    """Whether condition k may be 0 on one side of a switch between two fractions.

    A value within the part ZERO of its change is examined, and one at an end of the
    step, where the jump may belong to the step before or after.
    """
    row, count = s.surfaces + k, rows(s)
    a, b = abs(s.starts[row] - s.leeway[k]), abs(s.ends[row] - s.leeway[k])
    change = max(a, b, abs(s.starts[count + row]), abs(s.ends[count + row]))
    return low == 0.0 or past == 1.0 or min(a, b) <= ZERO * change


def past_jump(s: SearchTable, p: Parameters, k: int, switch: float) -> float:
    """Return the first fraction past a jump of condition k to 0, or from 0.

    At a kink it is the fraction of the switch. The result is inf if the values at the
    ends of the step show that the jump belongs to the step before or after.
    """
    before, after = limit(s, p, k, switch, -1.0), limit(s, p, k, switch, 1.0)
    if not abs(after - before) > 2.0 * rounding_of(s, p, k, switch):
        return switch
    low, high = max(switch - NEARBY, 0.0), min(switch + NEARBY, 1.0)
    if has_jumped(s, p, k, low, before, after):
        return inf
    if not has_jumped(s, p, k, high, before, after):
        return inf
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        if has_jumped(s, p, k, middle, before, after):
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    return high


def has_jumped(
    s: SearchTable, p: Parameters, k: int, x: float, before: float, after: float
) -> bool:
    """Whether condition k has jumped at the fraction x of the step.

    before, after : its limits, one of them 0. A value between the limits, as that of
        `sign` at 0, is on the side that is not 0.
    """
    conditions_at(s, p, x)
    value = float(s.values[k])
    if abs(after) < abs(before):
        return abs(value - after) < abs(value - before)
    return abs(value - after) <= abs(value - before)


def limit(s: SearchTable, p: Parameters, k: int, x: float, way: float) -> float:
    """Return the limit of condition k on one side of the fraction x of the step.

    It is extrapolated from two points, also past the ends of the step: at x itself the
    value may be that of either side, by rounding.

    way : -1 before x, 1 after it.
    """
    conditions_at(s, p, x + 2.0 * way * AROUND)
    far = s.values[k]
    conditions_at(s, p, x + way * AROUND)
    return float(2.0 * s.values[k] - far)


def is_zero_beside(s: SearchTable, p: Parameters, k: int, x: float) -> bool:
    """Whether the limit of condition k on one side of the fraction x of the step is 0.

    It is 0 to the rounding of its terms and of the time.
    """
    before, after = limit(s, p, k, x, -1.0), limit(s, p, k, x, 1.0)
    change = abs(float(s.values[k]) - after) / AROUND
    late = change * same_time(s, s.step_end) / s.step_h
    return min(abs(before), abs(after)) <= rounding_of(s, p, k, x) + late


def rounding_of(s: SearchTable, p: Parameters, k: int, x: float) -> float:
    """Return the rounding of the terms of condition k at the fraction x of the step."""
    t = state_at(s, p, x, s.work)
    located_slopes(t, s.work, p, s.condition_slopes)
    return SUM_ROUNDOFF * terms_of(s, k)


def conditions_at(s: SearchTable, p: Parameters, x: float) -> None:
    """Store the values of conditions at the fraction x of the last step in s.values."""
    located(state_at(s, p, x, s.work), s.work, p, s.values)
