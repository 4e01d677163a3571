"""The loop around any method: rows on a grid, conditions, and return codes.

`advance` takes steps until a block of rows is full or an arc ends; `tabulate` computes
the output columns of states.

Names in capitals are constants at compile time: `advance` is compiled once for each
combination of CONSTRAINED, SWITCHES and ADAPTIVE that models need, and `tabulate` for
both values of TOGETHER (several rows in one vector). The searches of a step are linked:
each is compiled for the constants that it depends on.
"""

from __future__ import annotations

from math import inf, sqrt

from lagsim.language.arrays import Floats
from lagsim.methods.parts import missed
from lagsim.methods.parts import state as at
from lagsim.methods.parts.constraints import clear_of_loss, project
from lagsim.methods.parts.control import drop_compensation, record_extents
from lagsim.methods.parts.crossings import Crossings
from lagsim.methods.parts.leaving import has_no_end, store_distances
from lagsim.methods.parts.parameters import FOLLOWED, PUSH, REDUNDANT, Parameters
from lagsim.methods.parts.search_table import state_at
from lagsim.methods.parts.state import (
    event_functions,
    find_crossings,
    find_end,
    inertias,
    interpolate,
    interpolate_rows,
    loses_rank,
    missed_feature,
    observe,
    observe_rows,
    project_sliding,
    start,
    step,
    surface_rows,
    surfaces,
)
from lagsim.native.graph.lines import LANES
from lagsim.native.layout import array
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    RESIDUAL_ROUNDOFF,
    SURFACE_ROUNDOFF,
    TIME_ROUNDOFF,
)

CONSTRAINED = True
SWITCHES = True
ADAPTIVE = True
TOGETHER = False

# Number of steps after which lengths no longer depend on the guessed first step.
SETTLING = 10.0
NOWHERE = -1


class State(Crossings):
    """Memory of every method: that of `Crossings`, and bounds of a step."""

    inertias: int  # number of inertias that are monitored for zeros
    noted: int  # number of passed levels of tables that the memory can hold
    crossed: float  # number of levels stored
    cross_times: Floats = array("noted")
    cross_surfaces: Floats = array("noted")  # the number of the surface of each level
    cross_levels: Floats = array("noted")
    # the number, from 1, of the last table passed at a jump of y' ...
    met_surface: float
    met_level: float  # ... and at which of its levels
    # The largest distance by which a state was projected onto the surface it slides
    # along.
    projected: float
    longest: float  # upper bound of all steps; 0: none
    smallest_step: float  # the smallest step after the first steps; 0: none yet
    speed: float  # estimated rate of the fastest motion, for explicit methods
    at_bound: float  # number of steps limited by stability ...
    off_bound: float  # ... and number of successive steps that were not
    pause_at: float  # value of `at_bound` at which the kernel returns; 0: never

    # For each inertia: the largest value, the smallest value, its time, and the state
    # there.
    inertia_largest: Floats = array("inertias")
    inertia_smallest: Floats = array("inertias", inf)
    inertia_when: Floats = array("inertias")
    inertia_where: Floats = array(lambda s: s.dynamic.stop * s.inertias)


def advance(s: State, p: Parameters, out: Floats, rows: int, budget: int) -> int:
    """Integrate until `rows` rows are written, `budget` steps made, or an end.

    Return one of the codes of `state`; s.emitted is then the number of rows written.

    out : (rows, 1 + size), the time and the state of each row.
    """
    s.emitted = 0.0
    begin(s, p)
    made = 0
    while True:
        if show(s, p, out, rows) == 0:
            return at.BLOCK_FULL
        code = arrived(s, p)
        if code != NOWHERE:
            return code
        if s.pause_at > 0.0 and s.at_bound >= s.pause_at:
            return at.STIFF
        if made >= budget:
            return at.PAUSED
        if SWITCHES or ADAPTIVE:
            missed.store_extents(s)
        s.satisfied = 0.0
        code = step(s, p)
        if code != at.DONE:
            return code
        s.step_end = s.t
        s.most_step = 0.0
        if ADAPTIVE and has_missed(s, p) > 0:
            begin(s, p)
            continue
        made += 1
        s.searched = 0.0
        inspect(s, p)
        if CONSTRAINED and loses_rank(s, p):
            return at.RANK_LOST


def show(s: State, p: Parameters, out: Floats, rows: int) -> int:
    """Write the states of sections, then the output rows, of the last step.

    Return 0 if a buffer becomes full before all are written, else 1.

    out : (rows, 1 + size), for the output rows.

    rows : the most rows that out has room for.
    """
    if s.sought > 0.0 and find_crossings(s, p) == 0:
        return 0
    return emit(s, p, out, rows)


def arrived(s: State, p: Parameters) -> int:
    """Return the code of the end that the run has reached, or NOWHERE.

    A step that has been cut is ended first; knots at the time reached are passed.
    """
    if s.cut > 0.0:
        end_at_cut(s, p)
        if s.event == 0.0 and s.switched == 0.0:
            s.fresh = 1.0
            s.arc_start = s.t
            begin(s, p)
    if s.event > 0.0:
        return at.EVENT_FOUND
    if SWITCHES and s.switched > 0.0 and not passes_level(s, p):
        return at.SWITCH_FOUND
    if s.t >= s.end:
        return at.DONE
    if pass_knots(p, s.t + p.knot_distance) > 0:
        if SWITCHES and is_at_level(s, p, NOWHERE):
            return at.SWITCH_FOUND
        restart(s, p)
    if (p.passed >= p.known and p.known > 0.0) or s.crossed >= max(s.noted, 1):
        return at.KNOTS_PASSED
    if CONSTRAINED and s.sigma < s.degenerate_below:
        return at.DEGENERATE
    return NOWHERE


def pass_knots(p: Parameters, t: float) -> int:
    """Advance the cells of tables past all knots up to time t; return their number."""
    count = 0
    while p.passed < p.known and p.knot_times[int(p.passed)] <= t:
        pass_knot(p)
        count += 1
    return count


def passes_level(s: State, p: Parameters) -> bool:
    """Let the motion pass the level of a table's surface that the last step reached.

    Return True if the motion continues in the next cell; False, without effect, if the
    run has to select the modes of surfaces and laws.
    """
    k = int(s.switched) - 1
    if k >= p.surfaces or p.slides[k] != 0.0 or p.decisive[k] > 0.0:
        return False
    surfaces(s.t, s.y, p, s.values)
    value = s.values[k]
    way = 1.0 if value - p.least[k] > p.most[k] - value else -1.0
    level = p.most[k] if way > 0.0 else p.least[k]
    jumps = not p.first_smooth[k] < level < p.last_smooth[k]
    if jumps and (
        not p.first_met[k] < level < p.last_met[k]
        or not passes_clearly(s, p, k, way, level)
    ):
        return False
    shift_side(p, k, way)
    if is_at_level(s, p, k) or (jumps and p.laws > 0 and not laws_unchanged(s, p)):
        shift_side(p, k, -way)
        s.switched = k + 1.0
        return False
    if jumps:
        s.arc_start = s.t
    p.slack[k] = 2.0 * max(0.0, way * (level - value))
    s.cross_times[int(s.crossed)] = s.t
    s.cross_surfaces[int(s.crossed)] = k
    s.cross_levels[int(s.crossed)] = level
    s.crossed += 1.0
    s.switched = 0.0
    s.row_limit = s.arc_rows
    restart(s, p)
    return True


def shift_side(p: Parameters, k: int, way: float) -> None:
    """Move surface k, of a table, to the next cell in the direction `way`, 1 or -1."""
    p.side[k] += way
    p.low[k] += way
    p.high[k] += way
    p.least[k] += way
    p.most[k] += way


def is_at_level(s: State, p: Parameters, passed: int) -> bool:
    """Whether the expression of a surface is at its level, within rounding.

    The test is made after a point of a linear table has been passed. From there on the
    expression may remain at the level, as `q*table(t)` does if the table falls to 0 and
    stays 0: its value then never exceeds the level, and the search for zeros would not
    end the step. The surface found is stored in s.switched. Surfaces whose sides decide
    no jump (points of tables) do not count.

    passed : the surface of the table.
    """
    surface_rows(s.t, s.y, p, p.rows)
    surfaces(s.t, s.y, p, s.values)
    for k in range(p.surfaces):
        tabled = p.first_met[k] < p.last_met[k] or p.first_smooth[k] < p.last_smooth[k]
        if k == passed or tabled or p.slides[k] != 0.0:
            continue
        off = min(s.values[k] - p.least[k], p.most[k] - s.values[k])
        if abs(off) <= SURFACE_ROUNDOFF * p.surface_scales[k]:
            s.switched = k + 1.0
            return True
    return False


def laws_unchanged(s: State, p: Parameters) -> bool:
    """Whether all laws keep their modes after a jump of forces, by a clear margin.

    The margin is larger than rounding; without it, the forces may press an open contact
    together. Laws whose condition `when` is false in this arc do not count.
    """
    event_functions(s.t, s.y, p, s.values)
    for k in range(p.laws):
        law = p.surfaces + k
        if p.slack[law] == inf:  # its condition `when` is false in this arc
            continue
        clear = max(float(p.slack[law]), float(p.band[law]), float(p.law_rounding[k]))
        if p.law_mode[k] == REDUNDANT or not s.values[law] > CLEAR_OF_ROUNDING * clear:
            return False
    return True


def passes_clearly(s: State, p: Parameters, k: int, way: float, level: float) -> bool:
    """Whether surface k passes `level` at a rate that is clearly not zero.

    False where the motion slides along another surface, or where this level was passed
    just before, as by a motion that comes to rest at it.

    way : 1 or -1, the direction.
    """
    last = int(s.crossed) - 1
    again = last >= 0 and s.cross_surfaces[last] == k and s.cross_levels[last] == level
    if p.laws > 0:  # friction brings a motion to rest there, in a series of passages
        again = s.met_surface == k + 1.0 and s.met_level == level
    s.met_surface = k + 1.0
    s.met_level = level
    for i in range(p.surfaces):
        again = again or p.slides[i] != 0.0 or p.floor[i] > 0.0
    if again:
        return False
    surface_rows(s.t, s.y, p, p.rows)
    terms = 0.0
    seen = s.sizes[s.driven]
    for e in range(int(p.row_starts[k]), int(p.row_starts[k + 1])):
        terms += abs(p.J[e]) * seen[int(p.row_columns[e])]
    clear = CLEAR_OF_ROUNDING * RESIDUAL_ROUNDOFF * terms
    return float(way * p.rates[k]) > clear


def restart(s: State, p: Parameters) -> None:
    """Restart the method at the state reached, with a first step like the last."""
    last = s.step_h
    s.end_step = 0.0
    start(s, p)
    if ADAPTIVE:
        s.h = max(s.h, last)
    else:
        s.arc_start = s.t


def pass_knot(p: Parameters) -> None:
    """Set the table cell that is valid after the next knot."""
    k = int(p.passed)
    p.branches[int(p.knot_modes[k])] = p.cells_after[k]
    p.passed += 1.0


def return_past_knot(p: Parameters) -> None:
    """Set the table cell that is valid before the knot passed last."""
    p.passed -= 1.0
    k = int(p.passed)
    p.branches[int(p.knot_modes[k])] = p.cells_before[k]


def has_missed(s: State, p: Parameters) -> int:
    """Reject the last step if it missed a localized term or has a defect.

    Return 1 if it is rejected, else 0.
    """
    x = 0.0
    if s.feature_possible > 0.0:
        x = missed_feature(s, p)
    if x == 0.0:
        x = missed.find_defect(s, p)
        if s.defect_found > 0.0:
            missed.expect(s, p, x)
    if x == 0.0:
        return 0
    missed.reject_step(s, p, x)
    return 1


def note_inertias(s: State, p: Parameters, now: Floats) -> None:
    """Store the largest and smallest value of each inertia, with time and state.

    Where an inertia vanishes beside its usual size, a coordinate loses its meaning.
    Steps are short there, so that ends of steps are close to the minimum.

    now : (inertias,), working memory.
    """
    width = s.dynamic.stop
    inertias(s.t, s.y, p, now)
    for i in range(s.inertias):
        s.inertia_largest[i] = max(s.inertia_largest[i], now[i])
        if now[i] < s.inertia_smallest[i]:
            s.inertia_smallest[i] = now[i]
            s.inertia_when[i] = s.t
            where = s.inertia_where[width * i :]
            where[s.dynamic] = s.y[s.dynamic]


def inspect(s: State, p: Parameters) -> None:
    """Search the last step for an end of the arc or run, and update `smallest_step`.

    Steps that an end cuts short do not count as smallest. The state is projected onto
    the surfaces that the motion slides along.
    """
    known = s.smallest_step
    counts = s.steps > SETTLING and s.t < missed.next_end(s, p)
    if counts and (known == 0.0 or s.step_h < known):
        s.smallest_step = s.step_h
    find_end(s, p)
    if SWITCHES and s.cut == 0.0:
        leave_levels(s, p)
        project_state(s, p, s.t, s.y)
    if s.inertias > 0:
        note_inertias(s, p, s.work)


def leave_levels(s: State, p: Parameters) -> None:
    """Set the slack of each surface without ends to 0 once it has left its level.

    The slack of any other surface is set to 0 by the search of its event function.
    """
    waits = False
    for k in range(p.surfaces):
        waits = waits or (p.slack[k] > 0.0 and has_no_end(p, k))
    if not waits:
        return
    store_distances(s.t, s.y, p, s.values)
    for k in range(p.surfaces):
        if has_no_end(p, k) and abs(s.values[k]) > p.slack[k]:
            p.slack[k] = 0.0


def end_at_cut(s: State, p: Parameters) -> None:
    """End the last step early: set the state to its value at the fraction `cut`."""
    state_at(s, p, s.cut, s.work)
    s.y[:] = s.work[: s.size]
    if SWITCHES:
        # Extents past the switch do not count.
        missed.restore_extents(s)
        record_extents(s)
    if CONSTRAINED:
        project(s, p, s.t, s.step_h, s.y, s.work)
    if SWITCHES:
        project_state(s, p, s.t, s.y)
    s.cut = 0.0


def project_state(s: State, p: Parameters, t: float, y: Floats) -> None:
    """Project y (size,) onto the surfaces that the motion slides along, in place.

    `projected` becomes the largest relative shift so far of the positions or of the
    velocities.

    t : the time.
    """
    if p.sliding == 0.0:
        return
    former = s.work
    former[s.dynamic] = y[s.dynamic]
    project_sliding(t, y, p)
    for first in range(2):
        found = projected(s, p, y, former, first * s.n)
        if found > s.projected:
            surface_rows(t, former, p, p.rows)
            if not is_near(p, first > 0):
                s.projected = found


def jump_along(p: Parameters, i: int) -> float:
    """Return the sum of the |jumps| of acceleration i across surfaces of sliding.

    The surfaces are those along which the motion slides. At a kink of an equality the
    jump is the acceleration that the jump of the constraint force causes.
    """
    width = p.size + p.m
    j = 0
    found = 0.0
    for k in range(p.surfaces):
        if p.slides[k] >= FOLLOWED:
            j += 1
            part = abs(p.side_fields[j * width + p.n + i])
            if p.corner[k] > 0.0 and p.slides[k] == FOLLOWED:
                jump = p.levers[k * (1 + p.m)]
                for r in range(p.m):
                    lever = p.levers[k * (1 + p.m) + 1 + r]
                    jump += lever * p.side_fields[p.size + r]
                part *= abs(jump) / PUSH
            found += part
    return found


def is_near(p: Parameters, rates: bool) -> bool:
    """Whether the state of the rows in p.rows is on the followed surfaces, to rounding.

    The rounding is that of the surfaces' expressions: the number of a table's cell, for
    example, is not 0 at a point x = 0, and has a rounding that x does not have.

    rates : whether surfaces of rates are tested, else surfaces of positions.
    """
    for k in range(p.surfaces):
        if p.slides[k] == FOLLOWED:
            off = abs(p.residuals[k] - p.least[k])
            if p.on_rates[k] > 0.0:
                off = abs(p.rates[k] - p.most[k])
            own = p.on_rates[k] > 0.0
            if (own and not rates) or (rates and not own):
                off = 0.0
            if not off <= SURFACE_ROUNDOFF * p.surface_scales[k]:
                return False
    return True


def projected(s: State, p: Parameters, y: Floats, former: Floats, first: int) -> float:
    """Return the relative shift of positions (first = 0) or velocities (first = n).

    The shift is divided by the ranges of the components that the projection moves, each
    increased by its change in a step by the magnitudes of the terms of its force. Jumps
    of forces at the followed surfaces count as terms. Components are weighted by their
    shifts, so that other bodies and the origin have no influence. The result is at most
    1, and 1 for a shift that is not finite.

    y, former : (size,), the state after and before projection.
    """
    n, h = s.n, s.step_h
    high, low = s.high[s.velocities], s.low[s.velocities]
    moved = 0.0
    whole = 0.0
    for i in range(n):
        k = first + i
        change = abs(y[k] - former[k])
        reach = high[i] - low[i] + h * (s.parts[i] + jump_along(p, i))
        if first == 0:
            reach = s.high[i] - s.low[i] + h * reach
        whole += (s.masses[i] * change * reach) ** 2
        if not change <= SURFACE_ROUNDOFF * s.sizes[k]:
            moved += s.masses[i] * change * change
    if moved == 0.0:
        return 0.0
    far = moved / sqrt(whole) if whole > 0.0 else 1.0
    if far < 1.0:
        return far
    return 1.0  # also for nan


def begin(s: State, p: Parameters) -> None:
    """Begin an arc if s.fresh is 1, otherwise change nothing."""
    if s.fresh > 0.0:
        drop_compensation(s)
        s.end_step = 0.0
        start(s, p)
        s.fresh = 0.0


def emit(s: State, p: Parameters, out: Floats, rows: int) -> int:
    """Write the projected rows up to the time reached to out (rows, 1 + size).

    Return 0 if the block is full before, else 1.
    """
    first = int(s.emitted)
    complete = fill(s, p, out, rows)
    end = int(s.emitted)
    width = 1 + s.size
    # No interpolation is needed for the row at the state itself.
    own = s.step_h == 0.0 or out[max(end - 1, 0) * width] == s.t
    if end > first and own and s.cut == 0.0:
        end -= 1
    for k in range(first, end):
        row = out[k * width :]
        # A row for which Newton's method does not converge is left unprojected.
        if CONSTRAINED and not is_satisfied(s, row[0]):
            project(s, p, row[0], s.step_h, row[1:], s.work)
        if SWITCHES:
            project_sliding(row[0], row[1:], p)
    return complete


def is_satisfied(s: State, t: float) -> bool:
    """Whether the dense output at time t in the last step satisfies the constraints.

    True up to the fraction `satisfied` of the step from either of its ends, see
    `taylor.satisfied_part`.
    """
    from_start = t - s.step_t
    near = min(from_start, s.step_h - from_start)
    return s.satisfied > 0.0 and near <= s.satisfied * s.step_h


def fill(s: State, p: Parameters, out: Floats, rows: int) -> int:
    """Write interpolated rows up to the time reached to out (rows, 1 + size).

    States requested between rows are written, too. Return 1 when all are written; 0 if
    the block is full, or after the last requested state in the list.
    """
    while True:
        t = s.row_start + s.row * s.row_step
        due = t < s.row_limit and t <= s.t
        # A state requested between rows; a state at the end of the arc belongs to the
        # next arc.
        at_hand = s.extra == s.t and s.cut == 0.0 and s.t < s.end
        beside = s.extras > 0.0 and (s.extra < s.t or at_hand)
        beside = beside and not (due and t < s.extra)
        if beside:
            t = s.extra
        elif not due:
            return 1
        written = int(s.emitted)
        if written >= rows:
            return 0
        row = out[written * (1 + s.size) :]
        row[0] = t
        more = 0
        if (t == s.t and s.cut == 0.0) or s.step_h == 0.0:
            row[1 : 1 + s.size] = s.y
        elif beside:
            # the result does not depend on these evaluations
            counted = s.evaluations
            interpolate(s, p, (t - s.step_t) / s.step_h, row[1:])
            s.evaluations = counted
        else:
            more = following(s, row, rows - written)
            interpolate_rows(s, p, row, 1 + more)
            s.row += more
            s.emitted += more
        s.emitted += 1.0
        if beside:
            s.extras -= 1.0
            s.listed -= 1.0
            if s.listed < 1.0:
                return 0
            s.extra = s.extra_times[int(s.listed) - 1]
        else:
            s.row += 1.0


def following(s: State, out: Floats, rows: int) -> int:
    """Write the times of output rows after the next row to `out`; return their number.

    Only rows within the last step count, and only those before the next state that is
    requested between rows.

    out : (rows, 1 + size), with the next row first; times are written from row 1 on.
    """
    end = min(s.t, s.row_limit)
    if s.extras > 0.0:
        end = min(end, s.extra)
    count = 0
    while count + 1 < rows:
        t = s.row_start + (s.row + (count + 1)) * s.row_step
        if not t < end:
            break
        count += 1
        out[count * (1 + s.size)] = t
    return count


def tabulate(
    states: Floats, rows: int, size: int, p: Parameters, out: Floats, width: int
) -> None:
    """Write the columns (rows, width) of states (rows, 1 + size) to out.

    Tables have the cells that were in force at the time of each state.
    """
    exchange_lengths(p)
    if TOGETHER:
        first = 0
        while first < rows:
            count = min(LANES, rows - first)
            there = out[first * width :]
            observe_rows(states[first * (1 + size) :], p, there, count)
            first += LANES
        exchange_lengths(p)
        return
    passed = p.passed
    for i in range(rows):
        row = states[i * (1 + size) :]
        while p.passed > 0.0 and row[0] < p.knot_times[int(p.passed) - 1]:
            return_past_knot(p)
        while p.passed < passed and row[0] >= p.knot_times[int(p.passed)]:
            pass_knot(p)
        observe(row[0], row[1:], p, out[i * width :])
    while p.passed < passed:
        pass_knot(p)
    exchange_lengths(p)


def exchange_lengths(p: Parameters) -> None:
    """Exchange two sets of scales of constraint rows: the run's and the plan's.

    The plan's are p.usual_lengths and p.usual_reference; `tabulate` uses these, so that
    the columns of a row do not depend on the steps before.
    """
    p.reference, p.usual_reference = p.usual_reference, p.reference
    for i in range(p.m if p.loops > 0 else 0):
        k = p.lengths[i]
        p.lengths[i] = p.usual_lengths[i]
        p.usual_lengths[i] = k


# --- the length of the step to try, and what bounds it --------------------------------
# Stability bounds of an explicit method's step are detected at no cost, from two states
# at one time, close together, and y' at both. If the step is at the bound, the states
# differ in the fastest motion, and the quotient of the differences is its rate. In the
# metric of the energy, sqrt(|da| / |dq|) is the frequency of an undamped oscillation in
# any phase, or the rate of a damped one; |da| / |dv| is at most this value, and is used
# where dq is below rounding.
#
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# section IV.2 (automatic stiffness detection), for systems of first order.

# Number of successive steps below it after which the step is not bound by stability.
FREE_STEPS = 6.0


def usable_step(s: State, p: Parameters) -> float:
    """Return the step h to try, with t + h a double; 0 if such a step is too small.

    It is at most the way to the next end, see `missed.next_end`, and keeps off a loss
    of rank, see `constraints.clear_of_loss`.
    """
    t, h = s.t, s.h
    if s.most_step > 0.0:
        h = min(h, s.most_step)
    rest = missed.next_end(s, p) - t
    passes = False
    if CONSTRAINED:
        # A step over a loss of rank ignores the limits `most_step` and `longest`.
        h = clear_of_loss(s, p, h, rest)
        passes = s.passes > 0.0
    if s.longest > 0.0 and not passes:
        h = min(h, s.longest)
    # Not t + 1.01 h >= END: rounded, that holds for ever at the last digit of t.
    if 1.01 * h >= rest:
        return float(rest)
    if not h > TIME_ROUNDOFF * max(abs(t), 1e-6 * rest):
        return 0.0
    return float((t + h) - t)


def record_speed(
    s: State,
    h: float,
    stability_bound: float,
    y: Floats,
    k: Floats,
    z: Floats,
    slope: Floats,
) -> None:
    """Store the estimated rate of the fastest motion.

    The estimate is computed from states y and z (size,) at one time. The step h counts
    as limited by stability if h times the rate exceeds `stability_bound`; successive
    steps of this kind are counted.

    k, slope : (size,), y' at y and at z.
    """
    masses, v, other_v = s.masses, y[s.velocities], z[s.velocities]
    a, other_a = k[s.velocities], slope[s.velocities]
    positions = 0.0
    velocities = 0.0
    accelerations = 0.0
    for i in range(s.n):
        dq = y[i] - z[i]
        dv = v[i] - other_v[i]
        da = a[i] - other_a[i]
        positions += masses[i] * dq * dq
        velocities += masses[i] * dv * dv
        accelerations += masses[i] * da * da
    s.speed = 0.0
    if positions > 0.0:
        s.speed = sqrt(sqrt(accelerations / positions))
    moved = velocities + sqrt(accelerations) * sqrt(positions)
    if moved > 0.0:
        s.speed = max(float(s.speed), sqrt(accelerations / moved))
    if h * s.speed > stability_bound:
        s.at_bound += 1.0
        s.off_bound = 0.0
    else:
        s.off_bound += 1.0
        if s.off_bound >= FREE_STEPS:
            s.at_bound = 0.0
