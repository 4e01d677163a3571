"""Rows within a step against the equations: y' there, and the dense output's slope.

A row shows q'' from the equations beside a state from the dense output. Where that does
not move by it, the step has passed over something that neither its stages nor its
series saw, whatever it is made of; it is taken back.

Of the rows in a step every tenth is asked: nothing that shows in ten rows is missed,
and where no step has so many it costs nothing. What is taken back without need is not
made shorter than five rows by that; towards the row that differed last, than LEAST of
one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import (
    derivative,
    interpolate,
    interpolate_rates,
    rounding,
    signals,
)
from lagsim.methods.parts.noise import RATE_NOISE, ROUNDED, SHAKEN, move_aside, shake
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# In output steps. To ask costs about as much as a row.
APART = 10.0
LEAST = 2.0**-4
# What y' and the dense output's slope differ by in a step, in tolerances. Over the
# shipped models, all their rows and five tolerances it was up to 14 (taylor), 100
# (dop853) and 80 (radau), but for what `is_beyond` allows.
LEFT = 1e3
# Of what a force does in an output step.
EXPECTED = 1e-2
# Multiples of it, less their whole parts, are spread evenly.
GOLDEN = 0.6180339887498949


def strayed(s: State, p: Parameters) -> float:
    """Give a row at which the last step differs, as a fraction of it, or 0."""
    # A step over a loss of rank has the length that it needs.
    if s.passes > 0.0:
        return 0.0
    reach = min(s.t, s.row_limit)
    if s.doubted >= s.row and time_of(s, s.doubted) < reach:
        x = place(s, s.doubted)
        if x * s.step_h > LEAST * s.row_step and is_off(s, p, x):
            return x
    k = s.row + APART - 1.0
    while time_of(s, k) < reach:
        x = place(s, k)
        if is_off(s, p, x):
            s.doubted = k
            expect(s)
            return x
        k += APART
    return 0.0


def expect(s: State) -> None:
    """Let what a row shows count as a size of the motion, before it is there.

    Or the first traces of it would be controlled as finely as denormal numbers are.
    """
    n = s.n
    delta = s.row_step
    right = s.asked
    slope = s.look_rates
    sizes = s.sizes_before
    for i in range(n, s.size):
        push = EXPECTED * delta * abs(right[i] - slope[i])
        if push < 1e300:
            sizes[i] = max(sizes[i], push)
            if i < 2 * n:
                sizes[i - n] = max(sizes[i - n], delta * push)


def time_of(s: State, k: float) -> float:
    """Give the time of row k."""
    return float(s.row_start + k * s.row_step)


def place(s: State, k: float) -> float:
    """Give where row k is, as a fraction of the last step."""
    return (time_of(s, k) - s.step_t) / s.step_h


def is_off(s: State, p: Parameters, x: float) -> bool:
    """Tell whether y' is not the slope of the dense output, for all that may be."""
    if not differs(s, p, x, LEFT) or is_rounding(s, p, x, LEFT):
        return False
    return is_beyond(s, p, x)


def is_rounding(s: State, p: Parameters, x: float, most: float) -> bool:
    """Tell whether y', as `differs` has left it, is off by the state's rounding alone.

    Beside a root no slope tells what that does. most : as there; rounding itself leaves
    no more than it does.
    """
    slope = s.look_rates
    right = s.asked
    found = s.far_before
    tolerances = s.tolerances
    shake(s, p, s.step_t + x * s.step_h, s.look, right, found)
    for i in range(s.n, s.size):
        allowed = most * tolerances[i] / s.step_h + SHAKEN * found[i]
        if tolerances[i] > 0.0 and not abs(right[i] - slope[i]) <= allowed:
            return False
    return True


def hardly_varies(s: State, p: Parameters, k: int, x: float) -> bool:
    """Tell whether signal k varies between three looks by no more than may be.

    That is, than rounding the state does, or moving it by its tolerances, to one side,
    at the last, at x. What a push hands on along a chain at rest goes with ever higher
    powers of the time: at first no step, however short, has its shape.
    """
    b = s.signals_last[k]
    change = float(
        max(abs(s.signals_middle[k] - s.signals_first[k]), abs(b - s.signals_middle[k]))
    )
    z = s.look
    noise = 0.0
    for way in range(2):
        interpolate(s, x, z)
        move_aside(s.size, z, ROUNDED if way == 0 else -ROUNDED, z)
        move_within(s, 1.0 if way == 0 else -1.0, z)
        signals(s.step_t + x * s.step_h, z, p, s.signals_beside)
        noise = max(noise, float(abs(s.signals_beside[k] - b)))
    return change <= noise


def is_beyond(s: State, p: Parameters, x: float) -> bool:
    """Tell whether y', as `differs` has left it, is off by more than may be.

    The state is not known better than to as many tolerances. What a change by that does
    to y' is no sign, where it is stiff or close to a loss of rank; nor is its rounding.
    """
    n = s.n
    t = s.step_t + x * s.step_h
    z = s.look
    slope = s.look_rates
    right = s.asked
    noise = s.work
    beside = s.spare
    tolerances = s.tolerances
    rounding(t, z, p, noise)
    move_within(s, LEFT, z)
    derivative(t, z, p, beside)
    for i in range(n, s.size):
        allowed = LEFT * tolerances[i] / s.step_h + RATE_NOISE * abs(noise[i - n])
        allowed += abs(beside[i] - right[i])
        if tolerances[i] > 0.0 and not abs(right[i] - slope[i]) <= allowed:
            return True
    return False


def move_within(s: State, tolerances: float, z: Floats) -> None:
    """Move a state by about so many of its tolerances.

    By parts and signs of each component's own: what is alike in two may cancel.
    """
    for i in range(s.size):
        part = GOLDEN * (i + 1)
        part = (0.5 + part - int(part)) * (1.0 - 2.0 * (i % 2))
        z[i] += part * tolerances * s.tolerances[i]


def differs(s: State, p: Parameters, x: float, most: float) -> bool:
    """Tell whether y' is not the slope of the dense output: by more than that.

    most : in tolerances.
    """
    size = s.size
    z = s.look
    rates = s.look_rates
    right = s.asked
    tolerances = s.tolerances
    interpolate_rates(s, x, rates)
    interpolate(s, x, z)
    derivative(s.step_t + x * s.step_h, z, p, right)
    for i in range(s.n, size):
        off = abs(right[i] - rates[i]) * s.step_h
        if tolerances[i] > 0.0 and not off <= most * tolerances[i]:
            return True
    return False


def take_back(s: State, x: float) -> None:
    """Take the last step back; the next is half as long as to its fraction x."""
    size = s.size
    y = s.y
    z = s.look
    sizes = s.sizes
    low = s.low
    high = s.high
    sizes_before = s.sizes_before
    low_before = s.low_before
    high_before = s.high_before
    interpolate(s, 0.0, z)
    for i in range(size):
        y[i] = z[i]
        # Where it led to has not been.
        sizes[i] = sizes_before[i]
        low[i] = low_before[i]
        high[i] = high_before[i]
    s.t = s.step_t
    s.most_step = 0.5 * x * s.step_h
    s.steps -= 1.0
    s.rejections += 1.0
    s.cut = 0.0
    s.fresh = 1.0
