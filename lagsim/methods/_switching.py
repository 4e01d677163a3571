"""Switches in the state: where within a step the first one is met.

Each surface has a margin: how far the state is from leaving the mode it is in. A step
is looked at several times, for a margin that has become negative and, by the slopes
at both ends of each part, for one that has been so in between: a touch, a narrow pulse.
The first moment is located by bisection on the dense output, to the last bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods._interface import (
    BAND,
    MARGINS,
    SLACK,
    SURFACES,
    SWITCHING,
    interpolate,
    margins,
)
from lagsim.methods._state import (
    CUT,
    HEADER,
    ROW_LIMIT,
    SIZE,
    STEP_H,
    STEP_T,
    SWITCHED,
    T,
)
from lagsim.native.kernel_types import at

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

# A step is looked at this often.
LOOKS = 8
# Slopes are differences over this part of a step: a look and its neighbour lie closer
# than anything that a method resolves.
BESIDE = 2.0**-13
# A least margin is located to this part of the stretch it lies in: its own error is of
# the square of that.
NARROW = 1e-8
GOLDEN = 0.6180339887498949


def find_switch(s: Floats, p: Floats) -> None:
    """Look for the first switch in the last step, and let it end there.

    s[SWITCHED] becomes the number of the surface.
    """
    count = int(p[SURFACES])
    now = at(p, int(p[SWITCHING]) + 1 + MARGINS * count)
    before = at(now, count)
    slopes = at(now, 2 * count)
    look(s, p, 0.0)
    for k in range(count):
        before[k] = now[k]
    look(s, p, BESIDE)
    for k in range(count):
        slopes[k] = (now[k] - before[k]) / BESIDE
    low = 0.0
    high = 0.0
    for part in range(1, LOOKS + 1):
        if high == 0.0:
            x = part / LOOKS
            high = first_end(s, p, low, x)
            if high == 0.0:
                low = x
    if high > 0.0:
        cut(s, p, low, high)


def look(s: Floats, p: Floats, x: float) -> None:
    """Leave the margins at the fraction x of the last step."""
    count = int(p[SURFACES])
    z = at(s, HEADER + 4 * int(s[SIZE]) + 2)
    interpolate(s, x, z)
    now = at(p, int(p[SWITCHING]) + 1 + MARGINS * count)
    margins(s[STEP_T] + x * s[STEP_H], z, p, now)


def over(p: Floats) -> int:
    """Give the number of a surface whose mode is over at the last look; or 0."""
    count = int(p[SURFACES])
    now = at(p, int(p[SWITCHING]) + 1 + MARGINS * count)
    for k in range(count):
        if not now[k] >= least_allowed(p, k):
            return k + 1
    return 0


def least_allowed(p: Floats, k: int) -> float:
    """Give the margin below which a mode is over beyond doubt."""
    count = int(p[SURFACES])
    kept = at(p, int(p[SWITCHING]) + 1)
    return -max(float(kept[SLACK * count + k]), float(kept[BAND * count + k]))


def first_end(s: Floats, p: Floats, low: float, x: float) -> float:
    """Give a point in (low, x] where a mode is over, or 0.

    Leaves the margins and slopes at x as those before the next part.
    """
    count = int(p[SURFACES])
    now = at(p, int(p[SWITCHING]) + 1 + MARGINS * count)
    slack = at(p, int(p[SWITCHING]) + 1 + SLACK * count)
    before = at(now, count)
    slopes = at(now, 2 * count)
    end = at(now, 3 * count)
    rise = at(now, 4 * count)
    look(s, p, x)
    if over(p) > 0:
        return x
    for k in range(count):
        end[k] = now[k]
    look(s, p, x - BESIDE)
    for k in range(count):
        rise[k] = (end[k] - now[k]) / BESIDE
    high = 0.0
    for k in range(count):
        if touches(x - low, before[k], slopes[k], end[k], rise[k]):
            least = least_margin(s, p, k, low, x)
            if margin_at(s, p, k, least) < least_allowed(p, k):
                high = least if high == 0.0 else min(high, least)
        if end[k] > slack[k]:
            slack[k] = 0.0
        before[k] = end[k]
        slopes[k] = rise[k]
    return high


def margin_at(s: Floats, p: Floats, k: int, x: float) -> float:
    """Give one margin at the fraction x of the last step."""
    look(s, p, x)
    return float(p[int(p[SWITCHING]) + 1 + MARGINS * int(p[SURFACES]) + k])


def touches(width: float, a: float, fall: float, b: float, rise: float) -> bool:
    """Tell whether a margin could be negative between a and b.

    It falls at the start and rises at the end; a convex one stays above its tangents.
    """
    if fall >= 0.0 or rise <= 0.0:
        return False
    meets = (b - a - rise * width) / (fall - rise)
    return a + fall * meets < 0.0


def least_margin(s: Floats, p: Floats, k: int, low: float, high: float) -> float:
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


def cut(s: Floats, p: Floats, low: float, high: float) -> None:
    """End the step at the first moment in (low, high] at which a mode is over.

    That is where its margin vanishes, also where only one well below 0 tells it.
    """
    look(s, p, high)
    first = over(p) - 1
    for k in range(int(p[SURFACES])):
        least = least_allowed(p, k)
        if not margin_at(s, p, k, high) >= least:
            first = k
            if margin_at(s, p, k, low) >= 0.0:
                least = 0.0
            high = end_of(s, p, k, least, low, high)
    s[SWITCHED] = first + 1.0
    shorten(s, high)


def end_of(
    s: Floats, p: Floats, k: int, least: float, low: float, high: float
) -> float:
    """Give the first point in (low, high] at which margin k is below `least`."""
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        if not margin_at(s, p, k, middle) >= least:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    return high


def shorten(s: Floats, x: float) -> None:
    """Let the last step end at its fraction x.

    Its state stays until the rows before that moment are written: methods may
    interpolate from it.
    """
    s[CUT] = x
    s[T] = s[STEP_T] + x * s[STEP_H]
    s[ROW_LIMIT] = min(s[ROW_LIMIT], s[T])
