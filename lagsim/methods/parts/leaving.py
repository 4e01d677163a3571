"""Values that leave 0 from rest, and the errors up to which their signs are unknown.

A motion that begins from rest at an instant may leave like a power of the time: a force
t^2 moves a body by t^4/12. At first the error of the method, and that of its dense
output, exceed the motion, and the sign of a value that leaves 0 means nothing. A value
*leaves* from the start of an arc until it exceeds the bound of its error in the present
step, its margin. Up to the margin

- a true condition stays true;
- a surface keeps its side, and a slip its direction: the margin is part of the slack;
- a section is not crossed: the margin is part of its band.

A value leaves if it is 0 at the start of an arc, to its rounding, and if a motion with
the rates of that time changes it in the step by no more than its margin. With fixed
steps a condition leaves also from a value within its margin.

The margin is the change of the value at states that differ by the errors of the
components. With step control these errors follow from the tolerances. With fixed steps
they are at least h |Delta a| for velocities and states, and h^2 |Delta a|/2 for
positions, where the rate of the velocity changes by Delta a in the step h: the position
after the first step of `verlet`, for example, has no part of the force after its start.
"""

from __future__ import annotations

from math import floor, inf
from typing import TYPE_CHECKING

from lagsim.methods.parts.control import pseudorandom
from lagsim.methods.parts.parameters import SLIDING, Parameters
from lagsim.methods.parts.search_table import (
    BETWEEN,
    CROSSING,
    EVENT,
    SearchTable,
    error_of_component,
    events,
    relations,
)
from lagsim.methods.parts.state import (
    derivative,
    event_functions,
    interpolate,
    located,
    sections,
    surfaces,
)
from lagsim.tolerances import OVERFLOW

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.native.kernels.words import Static

UNTIL = True
SWITCHES = True
# Whether y' is known at an instant, see `truth`.
RATED = True

# Largest change of each component, relative to its error, at which margins are found
# (FAR). The change is at least the error, since its pseudorandom part is 1/2 or more.
# The value there is compared with the value at the part CLOSE of the change.
FAR = 2.0
CLOSE = 2.0**-6


def find_leaving(kind: Static, s: SearchTable, p: Parameters) -> None:
    """Find the values of a kind that leave 0 in the last step, and their margins.

    A value that exceeds its margin at the start of the step has left 0.

    kind : EVENT for surfaces, slips and conditions, CROSSING for sections.
    """
    if not RATED:
        return
    first, last, count = 0, events(s), 0
    if kind == CROSSING:
        first, last = relations(s), relations(s) + s.sections
    new = s.step_t == s.arc_start
    for k in range(first, last):
        zero = zero_of(kind, s, p, k)
        s.starts[k] = inf if s.margins[k] >= 0.0 else zero
        if zero < 0.0:
            s.margins[k] = -1.0
        elif new and (s.margins[k] < 0.0 or (kind == EVENT and k < s.surfaces)):
            s.margins[k] = inf  # not known yet
        count += 1 if s.margins[k] >= 0.0 else 0
    if count == 0:
        return
    interpolate(s, p, 0.0, s.work)
    evaluate_values(kind, s, p, s.step_t)
    count = 0
    for k in range(first, last):
        if abs(s.values[k]) > s.starts[k]:
            s.margins[k] = -1.0
        s.starts[k] = s.values[k]
        count += 1 if s.margins[k] >= 0.0 else 0
    if count > 0:
        bound_margins(kind, s, p, first, last)


def evaluate_values(kind: Static, s: SearchTable, p: Parameters, t: float) -> None:
    """Store the values of a kind at the time t and the state in `work` in s.values."""
    if SWITCHES and kind == EVENT:
        event_functions(t, s.work, p, s.values)
        store_distances(t, s.work, p, s.values)
    if UNTIL and kind == EVENT:
        located(t, s.work, p, s.values[s.surfaces :])
    if kind == CROSSING:
        sections(t, s.work, p, s.values[relations(s) :])


def store_distances(t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Store the distances of surfaces without ends from their levels in out.

    Such a surface is in conditions and output only, and has no event function.
    """
    endless = False
    for k in range(p.surfaces):
        endless = endless or has_no_end(p, k)
    if not endless:
        return
    surfaces(t, y, p, p.rows)
    for k in range(p.surfaces):
        if has_no_end(p, k):
            out[k] = p.rows[k] - p.is_whole[k] * floor(p.rows[k] + 0.5)


def has_no_end(p: Parameters, k: int) -> bool:
    """Whether surface k cannot end an arc: it is not followed and has no end levels."""
    return not (p.slides[k] != 0.0 or p.least[k] > -inf or p.most[k] < inf)


def zero_of(kind: Static, s: SearchTable, p: Parameters, k: int) -> float:
    """Return the size up to which row k counts as 0 at the start of an arc.

    The result is negative if no value of the row counts as 0.

    A surface or a slip that leaves has a slack. With step control a condition that is
    false, and 0 to its rounding, is located where it becomes true, however soon. With
    fixed steps a condition within its margin is 0.
    """
    if kind == CROSSING:
        return float(s.bands[k - relations(s)])
    if UNTIL and k >= s.surfaces:
        c = k - s.surfaces
        zero = zero_of_condition(s, c)
        if not zero < inf:
            return -1.0
        if s.fixed_step > 0.0:
            return inf
        return zero if s.orientation[c] == 0.0 else -1.0
    if not SWITCHES or not 0.0 < p.slack[k] < inf:
        return -1.0
    law = k - p.surfaces
    leaves = p.slides[k] == 0.0 if law < 0 else p.law_mode[law] == SLIDING
    return float(p.slack[k]) if leaves else -1.0


def zero_of_condition(s: SearchTable, c: int) -> float:
    """Return the size up to which condition c counts as 0: its rounding or leeway."""
    return max(float(s.leeway[c]), float(s.zero[c]))


def bound_margins(
    kind: Static, s: SearchTable, p: Parameters, first: int, last: int
) -> None:
    """Compute the margins of the rows first ... last - 1 that leave 0.

    The values at the start of the step are in `starts`. In the first step of an arc, a
    value leaves 0 if its rate changes it by no more than the margin; in later steps,
    while it is within the margin. Surfaces and slips leave as long as they have a
    slack. A false condition that is true at the end of the step has no margin: it is
    located in the step.
    """
    bound_errors(s, p)
    change_by_errors(kind, s, p, first, last)
    change_by_rates(kind, s, p, first, last)
    most, off = s.middles, s.ends
    for k in range(first, last):
        if s.margins[k] >= 0.0:
            s.margins[k] = most[k] if off[k] <= most[k] else -1.0
            if SWITCHES and k < p.surfaces and kind == EVENT and has_no_end(p, k):
                p.slack[k] = max(p.slack[k], s.margins[k])
    if UNTIL and kind == EVENT:
        interpolate(s, p, 1.0, s.work)
        located(s.step_t + s.step_h, s.work, p, s.values[s.surfaces :])
        for c in range(s.conditions):
            if s.values[s.surfaces + c] * s.orientation[c] < -float(s.zero[c]):
                s.margins[s.surfaces + c] = -1.0


def change_by_rates(
    kind: Static, s: SearchTable, p: Parameters, first: int, last: int
) -> None:
    """Store the least margins of rows first ... last - 1 that leave 0 in `ends`.

    The rows are evaluated within the step and at its end, by a motion with the rates at
    the start: at the end alone a periodic row may have its value at the start.
    """
    before, off = s.starts, s.ends
    for k in range(first, last):
        off[k] = 0.0
    h = BETWEEN * s.step_h
    for _ in range(2):
        interpolate(s, p, 0.0, s.work)
        for i in range(s.size):
            s.work[i] += h * s.spare[i]
        evaluate_values(kind, s, p, s.step_t + h)
        for k in range(first, last):
            off[k] = max(off[k], change_within(kind, s, k, before[k], s.values[k]))
        h = s.step_h


def change_within(
    kind: Static, s: SearchTable, k: int, before: float, after: float
) -> float:
    """Return the least margin with which row k still counts as leaving 0.

    before, after : the value at the start of the step, and after it by a motion with
        the rates at the start.
    """
    if s.margins[k] != inf:
        return 0.0 if kind == EVENT and k < s.surfaces else abs(before)
    change = abs(after - before)
    if UNTIL and kind == EVENT and k >= s.surfaces:
        change = max(change, abs(before) - zero_of_condition(s, k - s.surfaces))
    return change


def change_by_errors(
    kind: Static, s: SearchTable, p: Parameters, first: int, last: int
) -> None:
    """Store the largest changes of rows first ... last - 1 by errors in `middles`.

    Each row is evaluated at two states that differ from the state at the start of the
    step by at least `step_errors` in each component. Its value there is compared with
    that at a closer state on the same side: a jump of the row at the start of the step
    is no error.
    """
    most, close = s.middles, s.ends
    for k in range(first, last):
        most[k] = 0.0
    for way in range(2):
        move_by_errors(s, p, CLOSE * FAR, way)
        evaluate_values(kind, s, p, s.step_t)
        close[first:last] = s.values[first:last]
        move_by_errors(s, p, FAR, way)
        evaluate_values(kind, s, p, s.step_t)
        for k in range(first, last):
            off = abs(s.values[k] - close[k])
            if off < OVERFLOW:
                most[k] = max(most[k], off)


def move_by_errors(s: SearchTable, p: Parameters, size: float, way: int) -> None:
    """Write the state at the start of the step, changed by errors, to `work`.

    size : the largest change of each component, in units of its error.
    way : 0 or 1, the direction.
    """
    interpolate(s, p, 0.0, s.work)
    for i in range(s.size):
        part = pseudorandom(i, way) - 0.5
        part += 0.5 if part > 0.0 else -0.5
        s.work[i] += size * part * s.step_errors[i]


def bound_errors(s: SearchTable, p: Parameters) -> None:
    """Store bounds (size,) of the errors of the last step in `step_errors`.

    The rates at the start of the step are stored in `spare`, as by `rates_at_ends`,
    with the velocities as the rates of positions.
    """
    rates_at_ends(s, p)
    h = s.step_h
    for i in range(s.size):
        s.step_errors[i] = error_of_component(s, i)
    for i in range(s.n):
        s.spare[i] = s.work[s.n + i]
    for i in range(s.n, s.dynamic.stop):
        change = h * abs(s.exact_rates[i] - s.spare[i])
        if s.fixed_step > 0.0 and change < OVERFLOW:
            s.step_errors[i] = max(s.step_errors[i], change)
            if i < 2 * s.n:
                found = 0.5 * h * change
                s.step_errors[i - s.n] = max(s.step_errors[i - s.n], found)


def rates_at_ends(s: SearchTable, p: Parameters) -> None:
    """Store y' at both ends of the last step, and the state at its start.

    y' at the end is stored in `exact_rates`, y' at the start in `spare`, the state in
    `work`. The functions of the model are evaluated at the start last.
    """
    interpolate(s, p, 1.0, s.work)
    derivative(s.step_t + s.step_h, s.work, p, s.exact_rates)
    interpolate(s, p, 0.0, s.work)
    derivative(s.step_t, s.work, p, s.spare)
    s.evaluations += 2.0
