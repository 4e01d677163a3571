"""A motion's power series, c = [order, y_0 (size,), ..., y_order]: sums, the step.

And what Taylor's step keeps: the series at both its ends.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.methods.parts.controller import HUGE
from lagsim.methods.parts.noise import TIGHT, add_drift, add_exactly, carry
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import at, exponent, fused, mantissa, two_to
from lagsim.native.layout import array

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

MOST_ORDER = 18
# Terms shrink by e^2 from one to the next at the step that costs least per unit of
# time (Jorba and Zou, proposition 3.1).
LOG_SHRINK = 2.0 / math.log(2.0)  # as a power of two
# Below this numbers are not normal.
LEAST_NUMBER = 2.0**-1000
# A priori bounds are met with this much room, or one step in two fails the check.
SAFETY = 0.9
# At tight tolerances truncation is kept below rounding, which it outgrows; and shorter
# steps average more of what forces are rounded by.
TIGHT_SAFETY = 0.6
# Logarithms and powers of two by interpolants at Chebyshev's nodes. A step is not known
# better than to their nine digits.
# log2(1 + f)/f for 0 <= f <= 1; f times it is within 2e-10.
LOGARITHM = (
    1.442695040695281, -0.721347464488058, 0.48089563727879786, -0.36062166708448046,
    0.2880130904231821, -0.23724857110215014, 0.19337101304091628, -0.14544969777453617,
    0.09161531514341954, -0.04299252211648444, 0.012876924428271262,
    -0.0018070985458731863,
)  # fmt: skip
# 2^f for |f| <= 1/2, within 1e-10.
POWER = (
    0.9999999999595618, 0.6931471805568324, 0.24022651213498092, 0.055504109063258665,
    0.009618025613318034, 0.0013333478473685416, 0.00015469729214118296,
    1.5303700711365693e-05,
)  # fmt: skip
# Exponents of normal numbers; and what rounds to a whole number when it is added.
LEAST = -1022.0
MOST = 1023.0
ROUNDER = 1.5 * 2.0**52


class Taylor(State):
    """Two series, each its order K, then y_0 ... y_K; and the new state."""

    which: float  # of the two series is the present one: 0 or 1
    trial: float  # the step that is tried
    trouble: float  # the code of what was wrong with the last one
    rejected: float  # 1 once one was not accepted
    series: Floats = array(lambda s: buffer(s.size, 2.0))
    new: Floats = array(lambda s: s.size)
    rates: Floats = array(lambda s: s.size)  # the series' own at the new state
    # The rest at the start of the last step, and where tolerances are tight its rate.
    carried: Floats = array(lambda s: s.size)
    drift: Floats = array(lambda s: s.size)


def buffer(size: int, which: float) -> int:
    """Give where one of the two series lies; of both, how long they are."""
    return int(which) * (1 + (MOST_ORDER + 1) * size)


def reach(s: Taylor, c: Floats, rest: Floats, h: float, out: Floats) -> None:
    """Give the state (size,) at h in a step of series c, and in `left` its own rest.

    rest : (size,), what the state lacked at the start. At the end of the step this is
    the new state to the last bit: what lies past a switch there does so here.
    """
    size = s.size
    left = s.left
    sum_bend(size, c, h, left)
    if s.rtol < TIGHT:
        add_exactly(size, at(c, 1), at(c, 1 + size), h, out, left)
        add_drift(s, s.drift, h)
        for i in range(size):
            left[i] += rest[i]
        carry(size, out, left, out, left)
        return
    for i in range(size):
        before = c[1 + i]
        change = left[i] + fused(h, c[1 + size + i], rest[i])
        after = before + change
        moved = after - before
        out[i] = after
        left[i] = (before - (after - moved)) + (change - moved)


def chosen_step(s: State, c: Floats, t: float) -> float:
    """Give the step from t at which the terms after the last are within the tolerance.

    If each of the last four terms is within its bound, and they shrink by e^2 from
    one to the next, so is the first that is left out. Not longer than the arc.
    """
    size = s.size
    order = int(c[0])
    tolerances = s.tolerances
    arc = s.end - t
    if arc <= 0.0:
        return 0.0
    last = 0.0
    second = 0.0
    third = 0.0
    fourth = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            part = 1.0 / max(LEAST_NUMBER, tolerances[i])
            k = 1 + order * size + i
            last = max(last, abs(c[k]) * part)
            second = max(second, abs(c[k - size]) * part)
            third = max(third, abs(c[k - 2 * size]) * part)
            fourth = max(fourth, abs(c[k - 3 * size]) * part)
    if not max(last, second, third, fourth) < 1e300:
        return 0.0
    logarithm = min(
        bound(fourth, 4.0 * LOG_SHRINK, order - 3),
        bound(third, 3.0 * LOG_SHRINK, order - 2),
        bound(second, 2.0 * LOG_SHRINK, order - 1),
        bound(last, LOG_SHRINK, order),
    )
    safety = TIGHT_SAFETY if s.rtol < TIGHT else SAFETY
    return min(safety * two_to_the(logarithm), float(arc))


def bound(term: float, shrink: float, k: int) -> float:
    """Give the logarithm of the step up to which a term, y_k, tells that it will do."""
    part = 1.0 / k
    found = (shrink - log2_of(max(term, LEAST_NUMBER))) * part
    return found if term > LEAST_NUMBER else MOST


def sum_bend(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of y_k h^k from k = 2, even and odd powers apart: they overlap."""
    order = int(c[0])
    square = h * h
    for i in range(size):
        high = c[1 + order * size + i]
        low = c[1 + (order - 1) * size + i]
        for back in range(1, (order - 1) // 2):
            k = order - 2 * back
            high = fused(high, square, c[1 + k * size + i])
            low = fused(low, square, c[1 + (k - 1) * size + i])
        if order % 2 == 0:
            low = fused(low, h, c[1 + 2 * size + i])
            high = fused(high, square, low)
        else:
            high = fused(high, h, low)
        out[i] = high * square


def sum_rates(size: int, first: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of k y_k h^(k - 1) in the same way, from component `first` on."""
    order = int(c[0])
    square = h * h
    for i in range(first, size):
        times = c[0]
        place = 1 + order * size + i
        high = times * c[place]
        low = (times - 1.0) * c[place - size]
        for _ in range(1, order // 2):
            times -= 2.0
            place -= 2 * size
            high = fused(high, square, times * c[place])
            low = fused(low, square, (times - 1.0) * c[place - size])
        high = fused(high, h, low)
        if order % 2 == 1:
            high = fused(high, h, c[1 + size + i])
        out[i] = high


def lead(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give how far off (size,) the terms of a series may lead in a step."""
    order = int(c[0])
    for i in range(size):
        far = 0.0
        for back in range(order):
            far = (far + abs(c[1 + (order - back) * size + i])) * h
        out[i] = c[1 + i] + far


def misfit(s: State, order: float, slope: Floats, rates: Floats, h: float) -> float:
    """Give the error of a step, from y' (size,) at its end and the series' own there.

    One that is finite has a finite square.
    """
    size = s.size
    tolerances = s.tolerances
    part = h / (order + 1.0)
    worst = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            off = abs(slope[i] - rates[i]) * part
            found = min(HUGE, off / max(LEAST_NUMBER, tolerances[i]))
            worst = max(worst, found if off < 1e300 else 1e300)
    return worst


def is_finite(size: int, y: Floats) -> bool:
    """Tell whether all components of y (size,) are."""
    finite = True
    for i in range(size):
        finite = finite and abs(y[i]) < 1e300
    return finite


def log2_of(x: float) -> float:
    """Give log2(x) of a normal number that is positive."""
    f = mantissa(x) - 1.0
    square = f * f
    fourth = square * square
    low = fused(LOGARITHM[1], f, LOGARITHM[0])
    low = fused(fused(LOGARITHM[3], f, LOGARITHM[2]), square, low)
    middle = fused(LOGARITHM[5], f, LOGARITHM[4])
    middle = fused(fused(LOGARITHM[7], f, LOGARITHM[6]), square, middle)
    high = fused(LOGARITHM[9], f, LOGARITHM[8])
    high = fused(fused(LOGARITHM[11], f, LOGARITHM[10]), square, high)
    found = fused(fused(high, fourth, middle), fourth, low)
    return fused(f, found, exponent(x))


def two_to_the(x: float) -> float:
    """Give 2^x, or the nearest power of two that is a normal number."""
    x = min(max(x, LEAST), MOST)
    k = (x + ROUNDER) - ROUNDER
    f = x - k
    square = f * f
    low = fused(POWER[1], f, POWER[0])
    low = fused(fused(POWER[3], f, POWER[2]), square, low)
    high = fused(POWER[5], f, POWER[4])
    high = fused(fused(POWER[7], f, POWER[6]), square, high)
    return fused(high, square * square, low) * two_to(k)
