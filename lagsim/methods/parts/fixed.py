"""What the methods with a fixed step share: where a step ends, and rows within it.

Their own arrays begin with the state (size) and y' (size) before the last step, then y'
(size) at the state reached.
"""

from __future__ import annotations

from math import floor
from typing import TYPE_CHECKING

from lagsim.methods.parts.controller import record_extents, record_sizes
from lagsim.methods.parts.interface import derivative
from lagsim.methods.parts.state import (
    ARC_START,
    END,
    EVALUATIONS,
    FIXED_STEP,
    HEADER,
    SIZE,
    STEP_H,
    STEP_T,
    STEPS,
    T,
)
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True


def begin(s: Floats, p: Floats) -> None:
    """Begin an arc: evaluate at its start."""
    size = int(s[SIZE])
    derivative(s[T], at(s, HEADER), p, at(s, HEADER + 8 * size + 6))
    s[EVALUATIONS] += 1.0
    s[STEP_H] = 0.0
    record_sizes(s, p)


def next_time(s: Floats) -> float:
    """Give the end of the step: a whole number of steps into the arc, or its end."""
    made = floor((s[T] - s[ARC_START]) / s[FIXED_STEP] + 0.5)
    after = s[ARC_START] + (made + 1) * s[FIXED_STEP]
    if after + 1e-9 * s[FIXED_STEP] >= s[END]:
        return float(s[END])
    return float(after)


def step_length(s: Floats, after: float) -> float:
    """Give the step that ends at `after`.

    Full steps are the same to the last bit, which after - t is not: a symplectic
    method conserves an energy that depends on the step.
    """
    if after < s[END]:
        return float(s[FIXED_STEP])
    return float(after - s[T])


def is_finite(size: int, y: Floats) -> bool:
    """Tell whether a state can be gone on with."""
    largest = 0.0
    for i in range(size):
        if not abs(y[i]) < 1e300:
            largest = 1e300
    return largest < 1e300


def take(s: Floats, p: Floats, after: float, new: Floats, slope: Floats) -> None:
    """Take the new state and y' there; keep the old ones for interpolation."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    old = at(s, HEADER + 6 * size + 6)
    before = at(old, size)
    k = at(before, size)
    for i in range(size):
        old[i] = y[i]
        before[i] = k[i]
        y[i] = new[i]
        k[i] = slope[i]
    s[STEP_T] = s[T]
    s[STEP_H] = after - s[T]
    s[T] = after
    s[STEPS] += 1.0
    note_sizes(s, p)


def note_sizes(s: Floats, p: Floats) -> None:
    """Take the state into the largest sizes; what only projection needs, for that."""
    if CONSTRAINED:
        record_sizes(s, p)
    else:
        record_extents(s)


def hermite(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step by the cubic through its ends.

    Hairer, Norsett and Wanner, Solving ODEs I, II.6.
    """
    size = int(s[SIZE])
    h = s[STEP_H]
    y = at(s, HEADER)
    old = at(s, HEADER + 6 * size + 6)
    before = at(old, size)
    k = at(before, size)
    u = 1.0 - x
    for i in range(size):
        change = y[i] - old[i]
        bend = u * (h * before[i] - change) - x * (h * k[i] - change)
        out[i] = old[i] + x * (change + u * bend)
