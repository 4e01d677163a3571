"""What ends a step early: where within it the first switch, or `until`, is met.

Each surface has a margin: how far the state is from leaving the mode it is in; so has
`until`, while it is false. A step is looked at several times, and once more between two
looks: where that is not what the values and slopes at both ends tell, looks come closer
until it is. A margin that has become negative, and by the slopes one that has
been so in between (a touch, a narrow pulse), ends the step. The first moment is located
by bisection on the dense output, to the last bit. A step that wants more looks than
there may be ends where they do, and the next one begins there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import (
    interpolate,
    margins,
    until,
)
from lagsim.methods.parts.looks import BETWEEN, look_at_signals, stirs
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State
from lagsim.methods.parts.strays import hardly_varies
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

SWITCHES = True
UNTIL = True
SLEEPERS = True

# A step is looked at at least this often.
LOOKS = 8
# Slopes are differences over this part of the way between looks: closer than anything
# that a method resolves.
BESIDE = 2.0**-10
# A margin is known between two looks where that in the middle is what the ends tell up
# to the first part of how it varies, or the last of the least of it; the slope there
# counts as the second says. Of looks that are too far apart one of both may agree by
# chance, hardly both.
KNOWN = 0.1
TURNED = 0.25
CLEAR = 0.25
# Looks come no closer than this, and there are so many in a step.
FINEST = 2.0**-14
# Or than this about where a function wakes; this many times it where looks have run out
# before this part of the step: so many steps at most for one.
NARROWEST = 2.0**-40
COARSER = 16.0
LEAST_PART = 2.0**-5
MOST_LOOKS = 2000
# A least margin is located to this part of the stretch it lies in: its own error is of
# the square of that.
NARROW = 1e-8
GOLDEN = 0.6180339887498949


def watched(p: Parameters) -> int:
    """Give how many margins there are (C); that of `until` is the last one."""
    count = 0
    if SWITCHES:
        count = p.surfaces + p.laws
    if UNTIL:
        count += 1
    return count


def find_end(s: State, p: Parameters) -> None:
    """Look for what ends the last step, the first of all, and let it end there.

    s.switched becomes the number of the surface, or s.event 1 for `until`.
    """
    low = 0.0
    if UNTIL and s.orientation == 0.0:
        low = armed(s, p)
        if low < 0.0:
            low = 0.0
            if not SWITCHES:
                return
    search(s, p, low)


def armed(s: State, p: Parameters) -> float:
    """Give where in the last step `until` becomes false, which it was not; -1: nowhere.

    From then on it counts.
    """
    if s.equation > 0.0:
        value = until_at(s, p, BESIDE / LOOKS)
        s.orientation = 1.0 if value > 0.0 else (-1.0 if value < 0.0 else 0.0)
        return 0.0 if s.orientation != 0.0 else -1.0
    for look in range(LOOKS + 1):
        x = look / LOOKS
        if until_at(s, p, x) < 0.0:
            s.orientation = -1.0
            return x
    return -1.0


def until_at(s: State, p: Parameters, x: float) -> float:
    """Give the residual or gap of `until` at the fraction x of the last step."""
    z = s.work
    interpolate(s, x, z)
    value = s.spare
    until(s.step_t + x * s.step_h, z, p, value)
    return float(value[0])


def search(s: State, p: Parameters, low: float) -> None:
    """Go through the last step from its fraction `low` on."""
    count = watched(p)
    first = s.margins_first
    middle = s.margins_middle
    last = s.margins_last
    widest = 2.0 / LOOKS
    width = widest
    narrowest = NARROWEST
    looks = 0
    high = 0.0
    sample(s, p, low, BESIDE * width, first)
    while low < 1.0 and high == 0.0:
        x = min(low + width, 1.0)
        half = low + BETWEEN * (x - low)
        sample(s, p, half, -BESIDE * width, middle)
        sample(s, p, x, -BESIDE * width, last)
        looks += 2
        clear = x - low < FINEST or known(s, p, x - low)
        if SLEEPERS and clear and x - low > narrowest:
            clear = nothing_stirs(s, p, low, x)
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
            for i in range(2 * count):
                first[i] = last[i]
            low = x
            width = min(2.0 * width, widest)
        elif looks >= MOST_LOOKS and low > LEAST_PART:
            s.cut = low
            s.t = s.step_t + low * s.step_h
            return
        else:
            if looks >= MOST_LOOKS:
                looks = 0
                narrowest *= COARSER
            width = 0.5 * (x - low)
            sample(s, p, low, BESIDE * width, first)


def nothing_stirs(s: State, p: Parameters, low: float, x: float) -> bool:
    """Tell whether nothing comes closer to waking inside a stretch than at its ends.

    A margin that is made of one would be flat at every look.
    """
    count = s.signals
    look_at_signals(s, p, low, s.signals_first)
    look_at_signals(s, p, low + BETWEEN * (x - low), s.signals_middle)
    look_at_signals(s, p, x, s.signals_last)
    still = True
    for k in range(count):
        if still and stirs(s, k, (x - low) * s.step_h):
            still = hardly_varies(s, p, k, x)
    return still


def look(s: State, p: Parameters, x: float) -> None:
    """Leave the margins at the fraction x of the last step."""
    z = s.work
    now = s.margins
    t = s.step_t + x * s.step_h
    interpolate(s, x, z)
    if SWITCHES:
        margins(t, z, p, now)
    if UNTIL:
        last = watched(p) - 1
        until(t, z, p, at(now, last))
        now[last] *= s.orientation
        if s.orientation == 0.0:
            now[last] = 1.0


def sample(s: State, p: Parameters, x: float, beside: float, out: Floats) -> None:
    """Give margins and slopes (2 C,) at the fraction x of the last step."""
    count = watched(p)
    now = s.margins
    look(s, p, x + beside)
    for k in range(count):
        out[count + k] = now[k]
    look(s, p, x)
    for k in range(count):
        out[k] = now[k]
        out[count + k] = (out[count + k] - now[k]) / beside


def known(s: State, p: Parameters, width: float) -> bool:
    """Tell whether what all margins do on a stretch follows from its ends."""
    count = watched(p)
    first = s.margins_first
    middle = s.margins_middle
    last = s.margins_last
    for k in range(count):
        a = first[k]
        m = middle[k]
        b = last[k]
        A = width * first[count + k]
        B = width * last[count + k]
        P = 3.0 * (b - a) - 2.0 * A - B
        Q = A + B - 2.0 * (b - a)
        off = abs(a + BETWEEN * (A + BETWEEN * (P + BETWEEN * Q)) - m)
        turned = A + BETWEEN * (2.0 * P + 3.0 * BETWEEN * Q)
        turned = TURNED * abs(turned - width * middle[count + k])
        reach = max(abs(m - a), abs(m - b))
        # What is off by no more than counts as none cannot be known better, nor can
        # slopes where that rounds.
        enough = max(KNOWN * reach, CLEAR * min(a, m, b), -least_allowed(p, k))
        rounding = rounding_of(p, k)
        unknown = off > max(enough, rounding)
        unknown = unknown or turned > max(enough, TURNED / BESIDE * rounding)
        if unknown and not is_nothing(p, k, max(abs(a), abs(m), abs(b))):
            return False
    return True


def rounding_of(p: Parameters, k: int) -> float:
    """Give what of a margin is rounding, also of the time that moves its wall."""
    if SWITCHES and p.surfaces <= k < p.surfaces + p.laws:
        return float(p.law_rounding[k - p.surfaces])
    return 0.0


def is_nothing(p: Parameters, k: int, margin: float) -> bool:
    """Tell whether the margin of a law is rounding: slopes of that say nothing."""
    if SWITCHES and p.surfaces <= k < p.surfaces + p.laws:
        return margin <= -least_allowed(p, k)
    return False


def least_allowed(p: Parameters, k: int) -> float:
    """Give the margin below which a mode is over beyond doubt; of `until` 0."""
    if SWITCHES and k < p.surfaces + p.laws:
        return -max(float(p.slack[k]), float(p.band[k]))
    return 0.0


def over(p: Parameters, k: int, margin: float) -> bool:
    """Tell whether margin k says that the mode is over."""
    if UNTIL and k == watched(p) - 1:
        return not margin > 0.0
    return not margin >= least_allowed(p, k)


def first_end(
    s: State, p: Parameters, low: float, x: float, before: Floats, after: Floats
) -> float:
    """Give a point in (low, x] where something ends, or 0.

    No later than any least margin that is negative: what has ended is so there still.
    before, after : (2 C,), margins and slopes there.
    """
    count = watched(p)
    high = 0.0
    for k in range(count):
        if over(p, k, after[k]):
            high = x
    for k in range(count):
        fall = before[count + k]
        rise = after[count + k]
        if touches(x - low, before[k], fall, after[k], rise):
            least = least_margin(s, p, k, low, x)
            if over(p, k, margin_at(s, p, k, least)):
                high = least if high == 0.0 else min(high, least)
    if SWITCHES and high == 0.0:
        slack = p.slack
        for k in range(p.surfaces + p.laws):
            if after[k] > slack[k]:
                slack[k] = 0.0
    return high


def margin_at(s: State, p: Parameters, k: int, x: float) -> float:
    """Give one margin at the fraction x of the last step."""
    look(s, p, x)
    return float(s.margins[k])


def touches(width: float, a: float, fall: float, b: float, rise: float) -> bool:
    """Tell whether a margin could be negative between a and b.

    It falls at the start and rises at the end; a convex one stays above its tangents.
    """
    if fall >= 0.0 or rise <= 0.0:
        return False
    meets = (b - a - rise * width) / (fall - rise)
    return a + fall * meets < 0.0


def least_margin(s: State, p: Parameters, k: int, low: float, high: float) -> float:
    """Give where a margin is least, by golden section."""
    left = high - GOLDEN * (high - low)
    right = low + GOLDEN * (high - low)
    at_left = margin_at(s, p, k, left)
    at_right = margin_at(s, p, k, right)
    narrow = NARROW * (high - low)
    while high - low > narrow:
        if at_left < at_right:
            high = right
            right = left
            at_right = at_left
            left = high - GOLDEN * (high - low)
            at_left = margin_at(s, p, k, left)
        else:
            low = left
            left = right
            at_left = at_right
            right = low + GOLDEN * (high - low)
            at_right = margin_at(s, p, k, right)
    return 0.5 * (low + high)


def cut(s: State, p: Parameters, low: float, high: float) -> None:
    """End the step at the first moment in (low, high] at which something ends.

    That is where its margin vanishes, also where only one well below 0 tells it.
    """
    count = watched(p)
    first = count
    for k in range(count):
        if over(p, k, margin_at(s, p, k, high)):
            first = k
            least = least_allowed(p, k)
            if margin_at(s, p, k, low) >= 0.0:
                least = 0.0
            high = end_of(s, p, k, least, low, high)
            if SWITCHES and least < 0.0:
                # A flight that began a rounding below ends where it is over.
                middle = 0.5 * (low + high)
                if margin_at(s, p, k, middle) > p.slack[k]:
                    high = end_of(s, p, k, -float(p.band[k]), middle, high)
    if UNTIL and first == count - 1:
        s.event = 1.0
    else:
        s.switched = first + 1.0
    shorten(s, high)


def end_of(
    s: State, p: Parameters, k: int, least: float, low: float, high: float
) -> float:
    """Give the first point in (low, high] at which margin k is below `least`."""
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        margin = margin_at(s, p, k, middle)
        ended = not margin >= least
        if UNTIL and k == watched(p) - 1:
            ended = not margin > 0.0
        if ended:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    return high


def shorten(s: State, x: float) -> None:
    """Let the last step end at its fraction x.

    Its state stays until the rows before that moment are written: methods may
    interpolate from it.
    """
    s.cut = x
    s.t = s.step_t + x * s.step_h
    s.row_limit = min(s.row_limit, s.t)
