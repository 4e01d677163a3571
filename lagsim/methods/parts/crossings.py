"""Sections of the motion: crossings of relations, and strobes, which end no step.

The relation of a section is a row of the table in which a step is searched (`search`),
with the sign of the side that the motion comes from: a crossing is where the row falls
below 0. The state there, on the dense output, is written beside the rows, and the
motion continues unchanged.

A relation has crossed 0 if it exceeds its band on the other side: rounding, and the
error of the state within tolerances. So a touch is no crossing, and a motion that a
constraint holds on a section does not cross the section. The crossing is located where
the relation passes 0, possibly before it leaves the band; until then the crossing
waits.

Between two neighbouring fractions of a step a continuous relation changes by rounding.
A larger change is a jump of the relation itself (`mod`, `if`), which is no crossing.
Sides at an instant are determined before the first act (an impact, an event); a
relation on the other side after all acts has crossed its section. A crossing at the
same instant as the end of a step is located at the start of the next step, after all
acts.
"""

from __future__ import annotations

from math import floor, inf

from lagsim.language.arrays import Floats
from lagsim.methods.parts.constraints import project
from lagsim.methods.parts.leaving import find_leaving
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.search_table import (
    AROUND,
    BESIDE,
    CROSSING,
    FARTHER,
    NEXT,
    POINTS,
    SearchTable,
    end_of,
    error_of_component,
    error_of_state,
    jumps,
    lowest,
    margin,
    minimum_in_half,
    relations,
    reuse_ends,
    same_time,
    sample,
    sampled,
    value_at,
)
from lagsim.methods.parts.state import (
    interpolate,
    project_sliding,
    section_slopes,
    sections,
)
from lagsim.native.kernels.words import bits, from_bits
from lagsim.native.layout import array
from lagsim.tolerances import OVERFLOW, SUM_ROUNDOFF

CONSTRAINED = True
SWITCHES = True
LOCALIZED = True

# First fraction of a step at which a relation that leaves 0 is compared with its band.
FIRST = NEXT * BESIDE / POINTS
# At the end of a run on a section, the relation at the distance AGO is half of its
# value at twice the distance if it is crossed, a quarter if it is touched.
AGO = 2.0**-10
TURNS = 0.375
# Part of a period by which the end of the run may be early.
SHORT = 1e-9
# A change by the error of the state below this part of the linear one is no linear one.
STEEP = 0.25


class Crossings(SearchTable):
    """Memory of the sections of a run, and of the crossings found."""

    strobes: int
    # number of states of sections that the memory can hold until they are read
    states_room: int
    sought: float  # 1 if sections are recorded
    widest: float  # relations are first evaluated at the ends of this part of a step
    states_found: float  # number of states stored in `crossed_states`
    searched: float = 1.0  # the last step has been searched up to this fraction
    banded: float  # 1 once the bands of the last step are known
    # By methods that step over impacts: the fraction of the last step at which the
    # state jumps, or 0; the time by which such impacts are late or early.
    leap: float
    coarse: float
    # time of the first act; sides at this time are those before the act
    instant: float = -inf
    # Where the row of each relation falls below 0 on a stretch, and a point past it.
    roots: Floats = array("sections")
    beyond: Floats = array("sections")
    # 1: only rising crossings count, -1: only falling ones, 0: both.
    ways: Floats = array("sections")
    # 1 while a crossing waits: until it is past its band, or until the next step.
    waits: Floats = array("sections")
    postponed: Floats = array("sections")
    # The time at which each relation has last jumped by itself.
    jumped: Floats = array("sections", -inf)
    relation_slopes: Floats = array(lambda s: s.sections * (1 + s.size))
    # The time and the state of each waiting crossing.
    waiting: Floats = array(lambda s: s.sections * (1 + s.size))
    periods: Floats = array("strobes")
    passed: Floats = array("strobes")  # the number of the next time
    # For each recorded state: the number of its section, the time, and the state.
    crossed_states: Floats = array(lambda s: s.states_room * (2 + s.size))


def begin_search(s: Crossings, p: Parameters) -> None:
    """Store the crossings caused by acts at the start of the last step.

    Acts are impacts and events; a crossing is caused if a relation is past 0 after the
    acts. A relation that is 0 after the acts waits: if the motion stays on the section,
    it has reached the section at this time.
    """
    s.banded = 0.0
    interpolate(s, p, 0.0, s.point)
    relations_at(s, p, s.step_t, s.point)
    for j in range(s.sections):
        s.bands[j] = band(s, p, j, s.step_t, s.point)
    find_leaving(CROSSING, s, p)
    for j in range(s.sections):
        acted = s.step_t == s.arc_start or s.postponed[j] > 0.0
        s.postponed[j] = 0.0
        if not acted or s.sides[j] == 0.0:
            continue
        value = value_at(CROSSING, s, p, relations(s) + j, 0.0)
        if value < 0.0 and is_past(s, p, j, 0.0, s.sides[j]):
            if jumps_back(s, p, j):
                s.sides[j] = -s.sides[j]
            else:
                cross(s, p, j, 0.0)
            s.end_step = 0.0  # the row has another sign now
        elif not (waits_longer(s, j) or is_past(s, p, j, 0.0, -s.sides[j])):
            wait(s, j, shown_time(s, s.step_t), s.point)


def jumps_back(s: Crossings, p: Parameters, j: int) -> bool:
    """Whether relation j is past 0 at the start of the last step by its own jump.

    A relation that jumps where acts are (`floor(x)` at a wall x = 0) may be past 0 just
    before them by rounding of the state, and return as they move the state by rounding.
    """
    if not is_same(s, s.step_t, s.jumped[j]):
        return False
    state_at(s, p, 0.0, s.point)
    relations_at(s, p, s.step_t, s.point)
    value = abs(float(s.values[relations(s) + j]))
    return change_by_error(s, p, j, s.step_t, s.point) > value


def compute_bands(s: Crossings, p: Parameters) -> None:
    """Store the rounding bounds of all relations of sections in s.bands (sections,).

    They hold for the last step, and are computed once for it.
    """
    if s.banded == 0.0:
        s.banded = 1.0
        x = s.cut if s.cut > 0.0 else 1.0
        t = s.step_t + x * s.step_h
        interpolate(s, p, x, s.point)
        relations_at(s, p, t, s.point)
        for j in range(s.sections):
            s.bands[j] = band(s, p, j, t, s.point)


def sample_first(s: Crossings, p: Parameters, low: float) -> None:
    """Write all rows and slopes at the fraction `low` of the last step to `starts`.

    At the start of a step the values at the end of the step before are used, unless an
    arc begins there.
    """
    known = low == 0.0 and s.end_step > 0.0 and s.end_time == s.step_t
    if LOCALIZED or not known or s.step_t == s.arc_start:
        sample(CROSSING, s, p, low, BESIDE * s.widest, s.starts)
        return
    reuse_ends(s, relations(s), s.sections, s.step_h)


def crossed_within(s: Crossings, p: Parameters, half: int) -> float:
    """Store the first crossing in half of the stretch; return a fraction just past it.

    0 if there is none. A crossing at the same instant as the end of the step is
    postponed, and the end is returned.

    half : 0 before the middle point, 1 after it.
    """
    if sides_unchanged(s, half):
        return 0.0
    for j in range(s.sections):
        s.roots[j] = inf
        if s.sides[j] == 0.0:
            s.roots[j] = exit_fraction(s, p, j, half)
        else:
            bracket(s, p, j, half)
    while True:
        root = inf
        for j in range(s.sections):
            root = min(root, s.roots[j])
        if root == inf:
            return 0.0
        past = decide_crossings(s, p, root, s.places[half + 1])
        if past > 0.0:
            return past


def sides_unchanged(s: Crossings, half: int) -> bool:
    """Whether all relations provably keep their sides in half of the stretch."""
    for j in range(s.sections):
        least = lowest(1.0, s, relations(s) + j, half)
        if not least > 0.0 or s.waits[j] > 0.0 or s.sides[j] == 0.0:
            return False
    return True


def exit_fraction(s: Crossings, p: Parameters, j: int, half: int) -> float:
    """Return the fraction in half of the stretch at which the motion leaves section j.

    The result is inf if the motion does not leave the section there. Since it may
    return to the section very soon, the start of an arc is sampled densely.
    """
    compute_bands(s, p)
    x = float(s.places[half + 1])
    begins = s.places[half] == 0.0 and s.step_t == s.arc_start
    return left_within(s, p, j, FIRST if begins else x, x)


def left_within(s: Crossings, p: Parameters, j: int, near: float, x: float) -> float:
    """Return the first of some fractions at which section j is off its band, or inf.

    The fractions increase geometrically from `near` to x.
    """
    while True:
        near = min(near, x)
        value = value_at(CROSSING, s, p, relations(s) + j, near)
        side = 1.0 if value > 0.0 else -1.0
        if abs(value) > s.bands[j] and is_past(s, p, j, near, -side):
            return near
        if near >= x:
            return inf
        near = FARTHER * near


def bracket(s: Crossings, p: Parameters, j: int, half: int) -> None:
    """Store an interval that contains the crossing of section j, if there is one.

    The ends of the interval are stored in `roots` and `beyond`. If the row of the
    section is below 0 at the start of the half, the root is there. A row that returns
    above its band has touched the section: its crossing does not wait.

    half : see `crossed_within`.
    """
    k, low, x = relations(s) + j, s.places[half], s.places[half + 1]
    a, b = sampled(s, k, half), sampled(s, k, half + 1)
    s.beyond[j] = x
    least = minimum_in_half(CROSSING, s, p, k, half, 0.0)
    if least < x and value_at(CROSSING, s, p, k, least) < min(b, 0.0):
        s.beyond[j] = least
    if b >= 0.0 and s.beyond[j] == x:
        if s.waits[j] > 0.0:
            compute_bands(s, p)
            s.waits[j] = 1.0 if b <= s.bands[j] else 0.0
        return
    s.roots[j] = low
    if a >= 0.0:
        s.roots[j] = end_of(CROSSING, s, p, k, 0.0, low, s.beyond[j])
    elif s.waits[j] == 0.0 and low > 0.0:
        # Beside the crossing of another section rounding decides which comes first.
        s.roots[j] = end_of(CROSSING, s, p, k, 0.0, max(0.0, low - AROUND), low)


def decide_crossings(s: Crossings, p: Parameters, root: float, x: float) -> float:
    """Decide the crossings at the fraction `root` of the step, in a stretch up to x.

    A relation that is past its band at the end x of the stretch has crossed its
    section; otherwise the crossing waits. Return a fraction just past the root, or 0 if
    no section is crossed.
    """
    end = s.cut if s.cut > 0.0 else 1.0
    late = s.t - (s.step_t + root * s.step_h) <= same_time(s, s.t)
    past = 0.0
    for j in range(s.sections):
        if s.roots[j] != root:
            continue
        s.roots[j] = inf
        side = s.sides[j]
        if side == 0.0:
            left = value_at(CROSSING, s, p, relations(s) + j, root)
            s.sides[j] = 1.0 if left > 0.0 else -1.0
            past = root
        elif relation_jumps(s, p, j, root):
            s.waits[j] = 0.0
            s.sides[j] = -side
            s.jumped[j] = s.step_t + root * s.step_h
            past = root
        elif late and s.waits[j] == 0.0:
            s.postponed[j] = 1.0
            return end
        elif is_past(s, p, j, s.beyond[j], side):
            cross(s, p, j, root)
            past = root
            if root == 0.0:  # it has waited; the sign of its row changes here
                past = min(left_within(s, p, j, FIRST, s.beyond[j]), s.beyond[j])
        elif s.beyond[j] == x and s.waits[j] == 0.0:
            # It is within rounding up to the end of the arc: reached at this end.
            ends = x == end and (s.cut > 0.0 or s.t == s.end)
            at_root = end if ends else root_of(s, p, j, root)
            state_at(s, p, at_root, s.point)
            t = s.t if ends else s.step_t + at_root * s.step_h
            wait(s, j, shown_time(s, t), s.point)
    return past


def wait(s: Crossings, j: int, t: float, y: Floats) -> None:
    """Mark section j as waiting, since the motion has reached it at time t in state y.

    y : (size,).
    """
    s.waits[j] = 1.0
    kept = s.waiting[j * (1 + s.size) :]
    kept[0] = t
    kept[1 : 1 + s.size] = y[: s.size]


def relation_jumps(s: Crossings, p: Parameters, j: int, root: float) -> bool:
    """Whether the relation of section j is discontinuous at the fraction `root`.

    False for a crossing that waits, at the start of the step, and at an impact within.
    """
    if s.waits[j] > 0.0 or root == s.leap or root == 0.0:
        return False
    x = max(0.0, root - AROUND)
    t = s.step_t + x * s.step_h
    interpolate(s, p, x, s.point)
    relations_at(s, p, t, s.point)
    within = 2.0 * band(s, p, j, t, s.point)
    return jumps(CROSSING, s, p, relations(s) + j, root, within)


def root_of(s: Crossings, p: Parameters, j: int, root: float) -> float:
    """Return the fraction at which section j's relation is 0, or the first past 0.

    root : the first number at which the relation is past 0; the number before is
        returned if the relation is 0 there.
    """
    if root == 0.0:
        return root
    last = from_bits(bits(root) - 1)
    if value_at(CROSSING, s, p, relations(s) + j, last) == 0.0:
        return last
    return root


def cross(s: Crossings, p: Parameters, j: int, root: float) -> None:
    """Store the state of a crossing of section j, if its direction counts.

    The state is that at the fraction `root` of the step, or the one stored while the
    crossing waited. A waiting crossing at the time of an instant is dated after all
    acts.
    """
    x = root_of(s, p, j, root)
    waits = s.waits[j] > 0.0
    s.sides[j] = -s.sides[j]
    s.waits[j] = 0.0
    if s.ways[j] * s.sides[j] < 0.0:
        return
    kept = s.waiting[j * (1 + s.size) :]
    if waits and not (s.step_t == s.arc_start and is_same(s, kept[0], s.step_t)):
        record(s, j, kept[0], kept[1:])
    else:
        state_at(s, p, 0.0 if waits else x, s.point)
        t = s.step_t if waits else s.step_t + x * s.step_h
        record(s, j, shown_time(s, t), s.point)


def waits_longer(s: Crossings, j: int) -> bool:
    """Whether section j waits, and was reached before the start of the last step."""
    reached = s.waiting[j * (1 + s.size)]
    return s.waits[j] > 0.0 and not is_same(s, reached, s.step_t)


def is_same(s: Crossings, t: float, other: float) -> bool:
    """Whether the times t and `other` belong to one instant."""
    return abs(t - other) <= same_time(s, t)


def record(s: Crossings, number: int, t: float, y: Floats) -> None:
    """Write the time t and the state y (size,) to the rows of section `number`."""
    out = s.crossed_states[int(s.states_found) * (2 + s.size) :]
    out[0] = float(number)
    out[1] = t
    out[2 : 2 + s.size] = y[: s.size]
    s.states_found += 1.0


def state_at(s: Crossings, p: Parameters, x: float, z: Floats) -> None:
    """Write the projected state (size,) at the fraction x of the last step to z."""
    t = s.step_t + x * s.step_h
    interpolate(s, p, x, z)
    if CONSTRAINED and x > s.satisfied:
        project(s, p, t, s.step_h, z, s.work)
    if SWITCHES:
        project_sliding(t, z, p)


def relations_at(s: Crossings, p: Parameters, t: float, z: Floats) -> None:
    """Store the relations at time t and state z (size,) in s.values, and their slopes.

    The slopes, and the sizes of the terms, are stored in s.relation_slopes.
    """
    section_slopes(t, z, p, s.relation_slopes)
    sections(t, z, p, s.values[relations(s) :])


def shown_time(s: Crossings, t: float) -> float:
    """Return the time written for a state at t: t, or a special time of its instant.

    Such times are the start and the end of the arc, and the time of a row.
    """
    if is_same(s, t, s.arc_start):
        return float(s.arc_start)
    if is_same(s, t, s.end):
        return float(s.end)
    row = s.row_start + floor((t - s.row_start) / s.row_step + 0.5) * s.row_step
    return row if is_same(s, t, row) else t


def is_past(s: Crossings, p: Parameters, j: int, x: float, side: float) -> bool:
    """Whether the relation of section j is past 0 by more than its bound `band`.

    x : the fraction of the last step, at which the projected state is evaluated.
    side : 1 or -1, the side of 0 from which the motion comes.
    """
    t = s.step_t + x * s.step_h
    state_at(s, p, x, s.point)
    relations_at(s, p, t, s.point)
    value = float(side * s.values[relations(s) + j])
    return value < -band(s, p, j, t, s.point)


def band(s: Crossings, p: Parameters, j: int, t: float, z: Floats) -> float:
    """Return the bound of |relation of section j| that counts as 0.

    The bound is the rounding of the terms of the relation, plus the error of the state
    times |`relation_slopes`|, 0 if this is not finite; and the margin of a relation
    that leaves 0, see `leaving`. Beside a pole slopes are no bound of changes by
    errors (`log(x)` at x = 1e-16): the change itself counts there.

    t, z : the time and the state (size,) at which the relations are known.
    """
    slopes = s.relation_slopes[s.sections + j * s.size :]
    error = error_of_state(s, slopes, s.size, s.coarse)
    if abs(s.values[relations(s) + j]) <= error:
        change = change_by_error(s, p, j, t, z)
        error = change if change < STEEP * error else error
    found = SUM_ROUNDOFF * abs(s.relation_slopes[j]) + error
    return float(found if found < OVERFLOW else 0.0) + margin(s, relations(s) + j)


def change_by_error(s: Crossings, p: Parameters, j: int, t: float, z: Floats) -> float:
    """Return the change of relation j towards 0 by the error of the state z (size,).

    t, z : as for `band`.
    """
    row = relations(s) + j
    value = float(s.values[row])
    slopes = s.relation_slopes[s.sections + j * s.size :]
    for i in range(s.size):
        error = error_of_component(s, i)
        if i < s.n:
            error = max(error, s.coarse * s.sizes[s.n + i])
        s.work[i] = z[i] - error if slopes[i] * value > 0.0 else z[i] + error
    sections(t, s.work, p, s.values[relations(s) :])
    change = abs(float(s.values[row]) - value)
    sections(t, z, p, s.values[relations(s) :])
    return change


def update_relations(s: Crossings, p: Parameters) -> None:
    """Update the sides of relations by the state just before the acts at this time.

    A jump of a relation itself is no crossing. All acts at one time count together: a
    second call at one instant has no effect.
    """
    if is_same(s, s.t, s.instant):
        return
    s.instant = s.t
    relations_at(s, p, s.t, s.y)
    for j in range(s.sections):
        here = s.waits[j] + s.postponed[j] == 0.0
        value = s.sides[j] * s.values[relations(s) + j]
        if here and value < -band(s, p, j, s.t, s.y):
            s.sides[j] = -s.sides[j]
            s.jumped[j] = s.t


def find_strobes(s: Crossings, p: Parameters) -> int:
    """Write the states at the times of strobes up to the time reached.

    Return 0 if the buffer is full before, else 1. A strobe at the time reached waits
    for the acts at that time.
    """
    same = same_time(s, s.t)
    for j in range(s.strobes):
        while strobe_time(s, j) < s.t - same:
            if s.states_found >= s.states_room:
                return 0
            t = strobe_time(s, j)
            state_at(s, p, max(0.0, (t - s.step_t) / s.step_h), s.point)
            record(s, s.sections + j, shown_time(s, t), s.point)
            s.passed[j] += 1.0
    return 1


def strobe_time(s: Crossings, j: int) -> float:
    """Return the time of the next state of strobe j."""
    return float(s.row_start + s.passed[j] * s.periods[j])


def finish(s: Crossings, p: Parameters, whole: float) -> None:
    """Write the states of sections at the end of a run, at most one for each section.

    Acts at the end may have crossed a section. A motion that reaches a section and does
    not turn crosses the section.

    whole : 1 if the run has reached its end time, else 0.
    """
    if s.sections > 0:
        finish_located(s, p)
    short = SHORT if whole > 0.0 else 0.0
    for j in range(s.strobes):
        if strobe_time(s, j) <= s.t + max(same_time(s, s.t), short * s.periods[j]):
            record(s, s.sections + j, s.t, s.y)
            s.passed[j] += 1.0


def finish_located(s: Crossings, p: Parameters) -> None:
    """Write the states of the sections that the end of a run has crossed or reaches."""
    relations_at(s, p, s.t, s.y)
    for j in range(s.sections):
        s.bands[j] = band(s, p, j, s.t, s.y)
        s.roots[j] = s.sides[j] * s.values[relations(s) + j]
    for j in range(s.sections):
        way = -s.sides[j]
        crossed = s.roots[j] < -s.bands[j]
        if way != 0.0 and not crossed and s.roots[j] <= s.bands[j]:
            crossed = comes_to(s, p, j)
        if crossed and s.ways[j] * way >= 0.0:
            kept = s.waiting[j * (1 + s.size) :]
            if s.waits[j] > 0.0 and not is_same(s, kept[0], s.t):
                record(s, j, kept[0], kept[1:])
            else:
                record(s, j, s.t, s.y)
    s.sides[:] = 0.0


def comes_to(s: Crossings, p: Parameters, j: int) -> bool:
    """Whether the last step ends on section j and the motion does not turn there."""
    # no step has been made since the start of the arc
    if s.arc_start == s.t or not s.step_h > 0.0:
        return float(s.postponed[j]) > 0.0
    x = (s.t - s.step_t) / s.step_h
    # Before the end, or, where that is near the start of the step, past it.
    ago = AGO if x > 0.5 else -AGO
    side, k = (1.0 if x > 0.5 else -1.0), relations(s) + j
    near = side * value_at(CROSSING, s, p, k, x - ago)
    far = side * value_at(CROSSING, s, p, k, x - 2.0 * ago)
    return float(near) > max(float(s.bands[j]), float(TURNS * far))
