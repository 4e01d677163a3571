"""What is noted of each step, whoever makes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import inertias
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# By then the first steps, which are guessed, have grown to what the motion needs.
SETTLING = 10.0


def record_step(s: State) -> None:
    """Note the smallest step; what an end cuts short does not count."""
    known = s.smallest_step
    counts = s.steps > SETTLING and s.t < s.end
    if counts and (known == 0.0 or s.step_h < known):
        s.smallest_step = s.step_h


def note_inertias(s: State, p: Parameters, now: Floats) -> None:
    """Note how large and how small each inertia is, and when it is smallest.

    Where one vanishes beside its usual size, a coordinate loses its meaning. Steps get
    short there, so that the ends of steps come as close as the motion does.
    """
    count = s.inertias
    largest = s.inertia_largest
    smallest = s.inertia_smallest
    when = s.inertia_when
    inertias(s.t, s.y, p, now)
    for i in range(count):
        largest[i] = max(largest[i], now[i])
        if now[i] < smallest[i]:
            smallest[i] = now[i]
            when[i] = s.t


def keep_sizes(s: State) -> None:
    """Note the largest sizes: a step may go far past where it will end."""
    size = s.size
    sizes = s.sizes
    low = s.low
    high = s.high
    sizes_before = s.sizes_before
    low_before = s.low_before
    high_before = s.high_before
    for i in range(size):
        sizes_before[i] = sizes[i]
        low_before[i] = low[i]
        high_before[i] = high[i]


def pass_rows(s: State) -> None:
    """Go on to the next row after the time reached, without writing those before."""
    t = s.row_start + s.row * s.row_step
    while t < s.row_limit and t <= s.t:
        s.row += 1.0
        t = s.row_start + s.row * s.row_step
