"""The loop around any method: rows on a grid, `until`, and an orderly return.

Compiled once for each of the settings CONSTRAINED, UNTIL, SWITCHES, SLEEPERS and WIDE;
what a model does not need is left out.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import (
    inertias,
    interpolate,
    observe,
    pull,
    start,
    step,
    until,
)
from lagsim.methods.parts.looks import overlooked, take_back
from lagsim.methods.parts.projection import project, project_rows
from lagsim.methods.parts.singular import watch
from lagsim.methods.parts.state import (
    ASK_AT,
    AT_BOUND,
    BLOCK_FULL,
    CUT,
    DEGENERATE,
    DEGENERATE_BELOW,
    DONE,
    EMITTED,
    END,
    EQUATION,
    EVENT,
    EVENT_FOUND,
    EXTENTS_AT,
    FEATURE_END,
    FEATURE_PASSED,
    FEATURE_WIDTH,
    FRESH,
    HEADER,
    HEALTH,
    INERTIAS,
    INERTIAS_AT,
    MOST_STEP,
    ORIENTATION,
    PAUSED,
    PULLED,
    RANK_LOST,
    ROW,
    ROW_LIMIT,
    ROW_START,
    ROW_STEP,
    SIZE,
    SIZES_BEFORE,
    SMALLEST_STEP,
    STEP_H,
    STEP_T,
    STEPS,
    STIFF,
    SUSPECT,
    SWITCH_FOUND,
    SWITCHED,
    N,
    T,
)
from lagsim.methods.parts.switching import find_end
from lagsim.native.graph.sincos import LANES
from lagsim.native.kernels.words import at, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True
UNTIL = True
SWITCHES = True
WIDE = True
SLEEPERS = True

# By then the first steps, which are guessed, have grown to what the motion needs.
SETTLING = 10.0
NOWHERE = -1
# A state that is pulled by this part of its size was off by rounding: some of 2^-47,
# within which it is on a surface.
ROUNDED = 2.0**-44


def advance(s: Floats, p: Floats, out: Floats, rows: int, budget: int) -> int:
    """Integrate until `rows` rows are written, `budget` steps made, or all is done.

    out : (rows, 1 + size), the time and the state of each row. Gives one of the codes
    of `_state`; s[EMITTED] says how many rows were written.
    """
    s[EMITTED] = 0.0
    begin(s, p)
    made = 0
    while True:
        if emit(s, p, out, rows) == 0:
            return BLOCK_FULL
        code = arrived(s, p)
        if code != NOWHERE:
            return code
        if s[ASK_AT] > 0.0 and s[AT_BOUND] >= s[ASK_AT]:
            return STIFF
        if made >= budget:
            return PAUSED
        made += 1
        if SWITCHES:
            keep_sizes(s)
        code = step(s, p)
        if code != DONE:
            return code
        s[MOST_STEP] = 0.0
        if SLEEPERS and has_leapt(s, p) > 0:
            begin(s, p)
            continue
        record_step(s)
        inspect(s, p)
        if CONSTRAINED and watch(s, p) > 0:
            return RANK_LOST


def arrived(s: Floats, p: Floats) -> int:
    """Give the code of what has been reached, if anything; its rows are written."""
    if s[CUT] > 0.0:
        take_cut(s, p)
        if s[EVENT] == 0.0 and s[SWITCHED] == 0.0:
            s[FRESH] = 1.0
            begin(s, p)
    if s[EVENT] > 0.0:
        return EVENT_FOUND
    if SWITCHES and s[SWITCHED] > 0.0:
        return SWITCH_FOUND
    if s[T] >= s[END]:
        return DONE
    if s[FEATURE_WIDTH] > 0.0 and s[T] >= s[FEATURE_END]:
        return FEATURE_PASSED
    if CONSTRAINED and s[HEALTH] < s[DEGENERATE_BELOW]:
        return DEGENERATE
    return NOWHERE


def has_leapt(s: Floats, p: Floats) -> int:
    """Take the last step back where it leapt over something; tell whether it did."""
    if s[SUSPECT] == 0.0:
        return 0
    x = overlooked(s, p)
    if x == 0.0:
        return 0
    take_back(s, x)
    return 1


def record_step(s: Floats) -> None:
    """Note the smallest step; what an end cuts short does not count."""
    known = s[SMALLEST_STEP]
    counts = s[STEPS] > SETTLING and s[T] < s[END]
    if counts and (known == 0.0 or s[STEP_H] < known):
        s[SMALLEST_STEP] = s[STEP_H]


def inspect(s: Floats, p: Floats) -> None:
    """Look for what ends the arc, or the run, within the last step."""
    if SWITCHES or UNTIL:
        find_end(s, p)
    if SWITCHES and s[CUT] == 0.0:
        pull_back(s, p, s[T], at(s, HEADER))
    if s[INERTIAS] > 0.0:
        note_inertias(s, p, at(s, HEADER + 4 * int(s[SIZE]) + 2))


def note_inertias(s: Floats, p: Floats, now: Floats) -> None:
    """Note how large and how small each inertia is, and when it is smallest.

    Where one vanishes beside its usual size, a coordinate loses its meaning. Steps get
    short there, so that the ends of steps come as close as the motion does.
    """
    count = int(s[INERTIAS])
    largest = at(s, int(s[INERTIAS_AT]))
    smallest = at(largest, count)
    when = at(smallest, count)
    inertias(s[T], at(s, HEADER), p, now)
    for i in range(count):
        largest[i] = max(largest[i], now[i])
        if now[i] < smallest[i]:
            smallest[i] = now[i]
            when[i] = s[T]


def keep_sizes(s: Floats) -> None:
    """Note the largest sizes: a step may go far past the switch that will cut it."""
    size = int(s[SIZE])
    sizes = at(s, HEADER + size)
    extents = at(s, int(s[EXTENTS_AT]))
    before = at(s, int(s[SIZES_BEFORE]))
    for i in range(size):
        before[i] = sizes[i]
    for i in range(2 * size):
        before[size + i] = extents[i]


def take_cut(s: Floats, p: Floats) -> None:
    """Take the state at the moment that the last step was cut at."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    z = at(s, HEADER + 4 * size + 2)
    interpolate(s, s[CUT], z)
    for i in range(size):
        y[i] = z[i]
    if SWITCHES:
        # What lies past the switch has not been.
        sizes = at(s, HEADER + size)
        low = at(s, int(s[EXTENTS_AT]))
        high = at(low, size)
        before = at(s, int(s[SIZES_BEFORE]))
        for i in range(size):
            sizes[i] = max(before[i], abs(y[i]))
            low[i] = min(before[size + i], y[i])
            high[i] = max(before[2 * size + i], y[i])
    if CONSTRAINED:
        settle(s, p, s[T], y)
    if SWITCHES:
        pull_back(s, p, s[T], y)
    s[CUT] = 0.0


def pull_back(s: Floats, p: Floats, t: float, y: Floats) -> None:
    """Pull a state onto what it slides along, and note how far it moves."""
    n = int(s[N])
    former = at(s, HEADER + 4 * int(s[SIZE]) + 2)
    for i in range(2 * n):
        former[i] = y[i]
    pull(t, y, p)
    s[PULLED] = max(s[PULLED], pulled(s, y, former, 0), pulled(s, y, former, n))


def pulled(s: Floats, y: Floats, former: Floats, first: int) -> float:
    """Give how far positions (first = 0) or velocities (first = n) were pulled.

    Against how far those have moved that were pulled, and what their forces' terms do
    in a step, which may cancel. Each counts by the push that it got: bodies that the
    surface does not touch are no measure, nor is where the origin lies.
    """
    n = int(s[N])
    size = int(s[SIZE])
    h = s[STEP_H]
    sizes = at(s, HEADER + size)
    masses = at(s, HEADER + 3 * size + 2)
    low = at(s, int(s[EXTENTS_AT]))
    high = at(low, size)
    parts = at(high, size)
    moved = 0.0
    whole = 0.0
    for i in range(n):
        k = first + i
        change = abs(y[k] - former[k])
        reach = high[n + i] - low[n + i] + h * parts[i]
        if first == 0:
            reach = high[i] - low[i] + h * reach
        whole += (masses[i] * change * reach) ** 2
        if not change <= ROUNDED * sizes[k]:
            moved += masses[i] * change * change
    if moved == 0.0:
        return 0.0
    far = moved / sqrt(whole) if whole > 0.0 else 1.0
    if far < 1.0:
        return far
    return 1.0  # what is no number, too


def begin(s: Floats, p: Floats) -> None:
    """Begin an arc if this is one."""
    if s[FRESH] > 0.0:
        start(s, p)
        if UNTIL:
            arm(s, p, at(s, HEADER + 4 * int(s[SIZE]) + 2))
        s[FRESH] = 0.0


def emit(s: Floats, p: Floats, out: Floats, rows: int) -> int:
    """Write the rows up to the time reached; give 0 where the block is full first."""
    first = int(s[EMITTED])
    complete = fill(s, out, rows)
    end = int(s[EMITTED])
    width = 1 + int(s[SIZE])
    # The row of the state itself needs nothing.
    own = s[STEP_H] == 0.0 or out[max(end - 1, 0) * width] == s[T]
    if end > first and own and s[CUT] == 0.0:
        end -= 1
    if CONSTRAINED and end > first:
        settle_rows(s, p, at(out, first * width), end - first)
    if SWITCHES:
        for k in range(first, end):
            row = at(out, k * width)
            pull(row[0], at(row, 1), p)
    return complete


def fill(s: Floats, out: Floats, rows: int) -> int:
    """Write the rows as the method interpolates them; give what `emit` gives."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    while True:
        t = s[ROW_START] + s[ROW] * s[ROW_STEP]
        if t >= s[ROW_LIMIT] or t > s[T]:
            return 1
        written = int(s[EMITTED])
        if written >= rows:
            return 0
        row = at(out, written * (1 + size))
        row[0] = t
        if (t == s[T] and s[CUT] == 0.0) or s[STEP_H] == 0.0:
            for i in range(size):
                row[1 + i] = y[i]
        else:
            interpolate(s, (t - s[STEP_T]) / s[STEP_H], at(row, 1))
        s[EMITTED] += 1.0
        s[ROW] += 1.0


def settle_rows(s: Floats, p: Floats, out: Floats, rows: int) -> None:
    """Project rows (rows, 1 + size) between steps."""
    if WIDE:
        for first in range(0, rows, LANES):
            some = at(out, first * (1 + int(s[SIZE])))
            project_rows(s, p, some, min(LANES, rows - first))
    else:
        for k in range(rows):
            row = at(out, k * (1 + int(s[SIZE])))
            settle(s, p, row[0], at(row, 1))


def settle(s: Floats, p: Floats, t: float, y: Floats) -> None:
    """Project a state between steps; one that does not converge stays as it is."""
    project(s, p, t, s[STEP_H], y, at(s, HEADER + 4 * int(s[SIZE]) + 2))


def arm(s: Floats, p: Floats, work: Floats) -> None:
    """Note on which side of `until` the state is: it counts once it has been false."""
    until(s[T], at(s, HEADER), p, work)
    orient(s, work[0])


def orient(s: Floats, value: float) -> None:
    """Set ORIENTATION as soon as the condition is false."""
    if s[ORIENTATION] == 0.0:
        if s[EQUATION] > 0.0:
            if value > 0.0:
                s[ORIENTATION] = 1.0
            if value < 0.0:
                s[ORIENTATION] = -1.0
        elif value < 0.0:
            s[ORIENTATION] = -1.0


def tabulate(
    states: Floats,
    rows: int,
    size: int,
    p: Floats,
    out: Floats,
    width: int,
    work: Floats,
) -> None:
    """Give the columns (rows, width) of states (rows, 1 + size).

    Where `observe` is WIDE it takes LANES rows at once, through
    work : (1 + size + width, LANES).
    """
    if not WIDE:
        for i in range(rows):
            row = at(states, i * (1 + size))
            observe(row[0], at(row, 1), p, at(out, i * width))
        return
    found = at(work, LANES * (1 + size))
    for first in range(0, rows, LANES):
        for lane in unrolled(LANES):
            row = at(states, min(first + lane, rows - 1) * (1 + size))
            for k in range(1 + size):
                work[k * LANES + lane] = row[k]
        observe(0.0, work, p, found)
        for lane in unrolled(LANES):
            if first + lane < rows:
                columns = at(out, (first + lane) * width)
                for k in range(width):
                    columns[k] = found[k * LANES + lane]
