"""The loop around any method: rows on a grid, `until`, and an orderly return.

Compiled once for each of the settings CONSTRAINED, UNTIL, SWITCHES, SLEEPERS and
ADAPTIVE; what a model does not need is left out.
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
from lagsim.methods.parts.looks import overlooked
from lagsim.methods.parts.noise import forget_rest
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.projection import project
from lagsim.methods.parts.singular import watch
from lagsim.methods.parts.state import (
    BLOCK_FULL,
    DEGENERATE,
    DONE,
    EVENT_FOUND,
    FEATURE_PASSED,
    PAUSED,
    RANK_LOST,
    STIFF,
    SWITCH_FOUND,
    State,
)
from lagsim.methods.parts.strays import strayed, take_back
from lagsim.methods.parts.switching import find_end
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True
UNTIL = True
SWITCHES = True
SLEEPERS = True
ADAPTIVE = True

# By then the first steps, which are guessed, have grown to what the motion needs.
SETTLING = 10.0
NOWHERE = -1
# A state that is pulled by this part of its size was off by rounding: some of 2^-47,
# within which it is on a surface.
ROUNDED = 2.0**-44


def advance(s: State, p: Parameters, out: Floats, rows: int, budget: int) -> int:
    """Integrate until `rows` rows are written, `budget` steps made, or all is done.

    out : (rows, 1 + size), the time and the state of each row. Gives one of the codes
    of `state`; s.emitted says how many rows were written.
    """
    s.emitted = 0.0
    begin(s, p)
    made = 0
    while True:
        if emit(s, p, out, rows) == 0:
            return BLOCK_FULL
        code = arrived(s, p)
        if code != NOWHERE:
            return code
        if s.ask_at > 0.0 and s.at_bound >= s.ask_at:
            return STIFF
        if made >= budget:
            return PAUSED
        made += 1
        if SWITCHES or ADAPTIVE:
            keep_sizes(s)
        s.met = 0.0
        code = step(s, p)
        if code != DONE:
            return code
        s.most_step = 0.0
        if ADAPTIVE and has_missed(s, p) > 0:
            begin(s, p)
            continue
        record_step(s)
        inspect(s, p)
        if CONSTRAINED and watch(s, p) > 0:
            return RANK_LOST


def arrived(s: State, p: Parameters) -> int:
    """Give the code of what has been reached, if anything; its rows are written."""
    if s.cut > 0.0:
        take_cut(s, p)
        if s.event == 0.0 and s.switched == 0.0:
            s.fresh = 1.0
            begin(s, p)
    if s.event > 0.0:
        return EVENT_FOUND
    if SWITCHES and s.switched > 0.0:
        return SWITCH_FOUND
    if s.t >= s.end:
        return DONE
    if s.feature_width > 0.0 and s.t >= s.feature_end:
        return FEATURE_PASSED
    if CONSTRAINED and s.health < s.degenerate_below:
        return DEGENERATE
    return NOWHERE


def has_missed(s: State, p: Parameters) -> int:
    """Take the last step back where it missed something; tell whether it did."""
    x = 0.0
    if SLEEPERS and s.suspect > 0.0:
        x = overlooked(s, p)
    if x == 0.0:
        x = strayed(s, p)
    if x == 0.0:
        return 0
    take_back(s, x)
    return 1


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
    y = s.y
    width = 2 * s.n
    inertias(s.t, y, p, now)
    for i in range(count):
        largest[i] = max(largest[i], now[i])
        if now[i] < smallest[i]:
            smallest[i] = now[i]
            when[i] = s.t
            where = at(s.inertia_where, width * i)
            for j in range(width):
                where[j] = y[j]


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


def inspect(s: State, p: Parameters) -> None:
    """Look for what ends the arc, or the run, within the last step."""
    if SWITCHES or UNTIL:
        find_end(s, p)
    if SWITCHES and s.cut == 0.0:
        pull_back(s, p, s.t, s.y)
    if s.inertias > 0:
        note_inertias(s, p, s.work)


def take_cut(s: State, p: Parameters) -> None:
    """Take the state at the moment that the last step was cut at."""
    size = s.size
    y = s.y
    z = s.work
    interpolate(s, s.cut, z)
    for i in range(size):
        y[i] = z[i]
    if SWITCHES:
        # What lies past the switch has not been.
        sizes = s.sizes
        low = s.low
        high = s.high
        sizes_before = s.sizes_before
        low_before = s.low_before
        high_before = s.high_before
        for i in range(size):
            sizes[i] = max(sizes_before[i], abs(y[i]))
            low[i] = min(low_before[i], y[i])
            high[i] = max(high_before[i], y[i])
    if CONSTRAINED:
        settle(s, p, s.t, y)
    if SWITCHES:
        pull_back(s, p, s.t, y)
    s.cut = 0.0


def pull_back(s: State, p: Parameters, t: float, y: Floats) -> None:
    """Pull a state onto what it slides along, and note how far it moves."""
    n = s.n
    former = s.work
    for i in range(2 * n):
        former[i] = y[i]
    pull(t, y, p)
    s.pulled = max(s.pulled, pulled(s, y, former, 0), pulled(s, y, former, n))


def pulled(s: State, y: Floats, former: Floats, first: int) -> float:
    """Give how far positions (first = 0) or velocities (first = n) were pulled.

    Against how far those have moved that were pulled, and what their forces' terms do
    in a step, which may cancel. Each counts by the push that it got: bodies that the
    surface does not touch are no measure, nor is where the origin lies.
    """
    n = s.n
    h = s.step_h
    sizes = s.sizes
    masses = s.masses
    low = s.low
    high = s.high
    parts = s.parts
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


def begin(s: State, p: Parameters) -> None:
    """Begin an arc if this is one."""
    if s.fresh > 0.0:
        forget_rest(s)
        start(s, p)
        if UNTIL:
            arm(s, p, s.work)
        s.fresh = 0.0


def emit(s: State, p: Parameters, out: Floats, rows: int) -> int:
    """Write the rows up to the time reached; give 0 where the block is full first."""
    first = int(s.emitted)
    complete = fill(s, out, rows)
    end = int(s.emitted)
    width = 1 + s.size
    # The row of the state itself needs nothing.
    own = s.step_h == 0.0 or out[max(end - 1, 0) * width] == s.t
    if end > first and own and s.cut == 0.0:
        end -= 1
    if CONSTRAINED:
        unmet = first
        while unmet < end and out[unmet * width] <= s.step_t + s.met * s.step_h:
            unmet += 1
        settle_rows(s, p, at(out, unmet * width), end - unmet)
    if SWITCHES:
        for k in range(first, end):
            row = at(out, k * width)
            pull(row[0], at(row, 1), p)
    return complete


def fill(s: State, out: Floats, rows: int) -> int:
    """Write rows as the method interpolates them; full after a state beside them."""
    size = s.size
    y = s.y
    while True:
        t = s.row_start + s.row * s.row_step
        due = t < s.row_limit and t <= s.t
        beside = has_extra(s) and not (due and t < s.extra)
        if beside:
            t = s.extra
        elif not due:
            return 1
        written = int(s.emitted)
        if written >= rows:
            return 0
        row = at(out, written * (1 + size))
        row[0] = t
        if (t == s.t and s.cut == 0.0) or s.step_h == 0.0:
            for i in range(size):
                row[1 + i] = y[i]
        else:
            interpolate(s, (t - s.step_t) / s.step_h, at(row, 1))
        s.emitted += 1.0
        if beside:
            s.extras -= 1.0
            return 0
        s.row += 1.0


def has_extra(s: State) -> bool:
    """Tell whether a state beside the rows is due; at an end it is the next arc's."""
    at_hand = s.extra == s.t and s.cut == 0.0 and s.t < s.end
    return s.extras > 0.0 and (s.extra < s.t or at_hand)


def settle_rows(s: State, p: Parameters, out: Floats, rows: int) -> None:
    """Project rows (rows, 1 + size) between steps."""
    for k in range(rows):
        row = at(out, k * (1 + s.size))
        settle(s, p, row[0], at(row, 1))


def settle(s: State, p: Parameters, t: float, y: Floats) -> None:
    """Project a state between steps; one that does not converge stays as it is."""
    project(s, p, t, s.step_h, y, s.work)


def arm(s: State, p: Parameters, work: Floats) -> None:
    """Note on which side of `until` the state is: it counts once it has been false."""
    until(s.t, s.y, p, work)
    orient(s, work[0])


def orient(s: State, value: float) -> None:
    """Set ORIENTATION as soon as the condition is false."""
    if s.orientation == 0.0:
        if s.equation > 0.0:
            if value > 0.0:
                s.orientation = 1.0
            if value < 0.0:
                s.orientation = -1.0
        elif value < 0.0:
            s.orientation = -1.0


def tabulate(
    states: Floats, rows: int, size: int, p: Parameters, out: Floats, width: int
) -> None:
    """Give the columns (rows, width) of states (rows, 1 + size)."""
    for i in range(rows):
        row = at(states, i * (1 + size))
        observe(row[0], at(row, 1), p, at(out, i * width))
