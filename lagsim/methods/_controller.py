"""Error tolerances from each component's own scale, and the first step.

The default tolerance of a component is rtol times its own scale: the range that it has
gone through, which no shift of the origin and no other body changes, or what its rate
does in the step. Where forces cancel, what each of them could do counts a little too.
And no component is controlled below its own rounding: that of its value, and that of
its rate. The latter is looked at where a step would be rejected: what the rounding of
the state does to it, and what is rounded where it is computed. No unit enters: metres
and millimetres give the same steps.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods._interface import (
    derivative,
    measure,
    rounding,
    terms,
)
from lagsim.methods._state import (
    ARC_START,
    ATOL,
    END,
    ENERGY,
    EVALUATIONS,
    EXTENTS_AT,
    HEADER,
    LOOKED,
    LOST_BELOW,
    POTENTIAL,
    ROW_STEP,
    RTOL,
    SIZE,
    N,
    T,
)
from lagsim.native.kernel_types import at

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

# Of what the terms of a rate could do in a step, though they cancel: errors of other
# components within the tolerance leave a part of them.
FLOOR = 1e-3
# What of its range counts as the size of a component: an oscillation about 0 is half of
# it in size, a motion away from 0 the whole.
WIDTH = 0.7
# Of the length of an arc: too short to matter.
INSTANT = 1e-6
# A value is not known better than this part of itself.
NOISE = 4.0 * 2.0**-53
# Rates of the size of one leave so much in the error estimate, by their rounding.
RATE_NOISE = 32.0 * 2.0**-53
# A relative change of the state this small shows what its rounding does to y'.
PROBE = 2.0**-36
# Below this a number has no digits to control.
UNDERFLOW = 1e-290
# The part of the tolerance that one step may use: errors of many steps add up, and the
# tolerance is meant for the motion (Kepler's, e = 0.6, 100 orbits: 6 digits at 1e-11).
LOCAL = 0.1


def record_sizes(s: Floats, p: Floats) -> None:
    """Take the state, accepted, into the largest sizes and the energy."""
    take_measure(s, s[T], at(s, HEADER), p)
    record_measured(s, p)


def record_measured(s: Floats, p: Floats) -> None:
    """Do the same where `set_tolerances` has measured this state last."""
    record_extents(s)
    s[ENERGY] = energy_scale(s)
    size = int(s[SIZE])
    n = int(s[N])
    masses = at(s, HEADER + 3 * size + 2)
    parts = at(s, int(s[EXTENTS_AT]) + 2 * size)
    terms(s[T], at(s, HEADER), p, parts)
    # From here on as accelerations, and the whole in the metric of M.
    masses[n] = 0.0
    for i in range(n):
        if masses[i] > 0.0:
            masses[n] += parts[i] * parts[i] / masses[i]
            parts[i] /= masses[i]
        else:
            parts[i] = 0.0


def record_extents(s: Floats) -> None:
    """Take the state into the largest sizes: all that a fixed step asks for."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    sizes = at(s, HEADER + size)
    low = at(s, int(s[EXTENTS_AT]))
    high = at(low, size)
    noise = at(high, 2 * size)
    for i in range(size):
        sizes[i] = max(sizes[i], abs(y[i]))
        low[i] = min(low[i], y[i])
        high[i] = max(high[i], y[i])
        noise[i] = 0.0
    s[LOOKED] = 0.0


def take_measure(s: Floats, t: float, y: Floats, p: Floats) -> None:
    """Leave what `measure` gives in the state."""
    measured = at(s, HEADER + 3 * int(s[SIZE]))
    measure(t, y, p, measured)
    if s[EVALUATIONS] <= 1.0:
        s[POTENTIAL] = measured[1]


def energy_scale(s: Floats) -> float:
    """Give the largest kinetic energy or change of potential, what is measured too."""
    measured = at(s, HEADER + 3 * int(s[SIZE]))
    change = abs(measured[1] - s[POTENTIAL])
    return max(float(s[ENERGY]), abs(float(measured[0])), float(change))


def set_tolerances(
    s: Floats, p: Floats, t: float, new: Floats, rates: Floats, h: float
) -> None:
    """Set the tolerance of each component for a step of length h to `new` at t.

    new, rates : (size,), the state after the step and y' before it. A tolerance of 0
    means that the component has no scale and is not controlled.
    """
    take_measure(s, t, new, p)
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    sizes = at(s, HEADER + size)
    tolerances = at(s, HEADER + 2 * size)
    if s[ATOL] >= 0.0:
        for i in range(size):
            scale = max(abs(y[i]), abs(new[i]))
            tolerances[i] = LOCAL * (s[ATOL] + s[RTOL] * scale)
        return
    low = at(s, int(s[EXTENTS_AT]))
    high = at(low, size)
    parts = at(high, size)
    noise = at(parts, size)
    # A start from rest with a jump in the force (dry friction) is off by the same part
    # of every step, however short; what happens in an instant is not controlled finer.
    instant = INSTANT * (s[END] - s[ARC_START])
    moment = max(h, instant)
    rtol = LOCAL * s[RTOL]
    for i in range(size):
        scale = WIDTH * (max(high[i], new[i]) - min(low[i], new[i]))
        scale = max(scale, moment * abs(rates[i]))
        part = parts[i]
        if i < n:
            part = parts[i] * moment
            scale = max(scale, instant * instant * abs(rates[n + i]))
            noise[i] = max(RATE_NOISE * abs(rates[i]), noise[n + i] * h)
        elif i < 2 * n:
            part = parts[i - n]
        scale = max(scale, FLOOR * moment * part)
        rough = max(NOISE * max(sizes[i], abs(new[i])), noise[i] * h, UNDERFLOW)
        tolerances[i] = max(rtol * scale, rough)


def look_at_rounding(
    s: Floats, p: Floats, t: float, y: Floats, k: Floats, health: float
) -> None:
    """Find what rounding leaves in the rates k (size,) at y, for this step.

    From a bound of what is rounded on the way, and from y' nearby. A health below 1 is
    that of rows close to a loss of rank, which enlarges the former; y' off the
    constraints says nothing there.
    """
    size = int(s[SIZE])
    n = int(s[N])
    noise = at(s, int(s[EXTENTS_AT]) + 3 * size)
    z = at(s, HEADER + 4 * size + 2)
    rounding(t, y, p, z)
    larger = 1.0 / max(health, float(s[LOST_BELOW]))
    for i in range(n, size):
        noise[i] = larger * abs(z[i - n])
    if health >= 1.0:
        add_probe(s, p, t, y, k)
    for i in range(n, size):
        if not noise[i] < 1e300:
            noise[i] = 0.0
        noise[i] = RATE_NOISE * (abs(k[i]) + noise[i])
    s[LOOKED] = 1.0


def add_probe(s: Floats, p: Floats, t: float, y: Floats, k: Floats) -> None:
    """Add what the rounding of the state does to its rates k.

    Components change by different parts, or a change of the whole scene's size or
    place would hide what cancels.
    """
    size = int(s[SIZE])
    n = int(s[N])
    noise = at(s, int(s[EXTENTS_AT]) + 3 * size)
    z = at(s, HEADER + 4 * size + 2)
    slopes = at(z, size)
    for i in range(size):
        part = 0.618033988749895 * (i + 1)
        z[i] = y[i] * (1.0 + PROBE * (0.5 + part - int(part)))
    derivative(t * (1.0 + PROBE), z, p, slopes)
    s[EVALUATIONS] += 1.0
    for i in range(n, size):
        noise[i] += abs(slopes[i] - k[i]) / PROBE


def first_step(s: Floats, p: Floats, order: int, k: Floats) -> float:
    """Give a first step: one explicit Euler step tells the second derivative.

    Hairer, Norsett and Wanner, Solving ODEs I, II.4. k : (size,) is y' at the start.
    """
    size = int(s[SIZE])
    y = at(s, HEADER)
    z = at(s, HEADER + 4 * size + 2)
    slopes = at(z, size)
    tolerances = at(s, HEADER + 2 * size)
    look_at_rounding(s, p, s[T], y, k, 1.0)
    set_tolerances(s, p, s[T], y, k, s[ROW_STEP])
    d0 = 0.0
    d1 = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            d0 += (y[i] / tolerances[i]) * (y[i] / tolerances[i])
            d1 += (k[i] / tolerances[i]) * (k[i] / tolerances[i])
    span = s[END] - s[T]
    h = min(1e-3 * s[ROW_STEP], span)
    if d0 > 1e-10 and d1 > 1e-10:
        h = min(0.01 * sqrt(d0 / d1), span)
    for i in range(size):
        z[i] = y[i] + h * k[i]
    derivative(s[T] + h, z, p, slopes)
    s[EVALUATIONS] += 1.0
    # What rests has a scale by now.
    set_tolerances(s, p, s[T] + h, z, slopes, h)
    d2 = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            bend = (slopes[i] - k[i]) / tolerances[i]
            d2 += bend * bend
    steepest = max(sqrt(d2) / h, sqrt(d1))
    if not steepest < 1e300:
        return float(1e-3 * h)
    guess = max(1e-6 * span, 1e-3 * h)
    if steepest > 1e-15:
        guess = (0.01 / steepest) ** (1.0 / order)
    return float(min(100.0 * h, guess, span))
