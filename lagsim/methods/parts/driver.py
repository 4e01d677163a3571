"""The loop around any method: rows on a grid, conditions, and an orderly return.

Compiled once for each of the settings CONSTRAINED, UNTIL, SWITCHES, LOCALIZED and
ADAPTIVE; what a model does not need is left out.
"""

from __future__ import annotations

from math import inf, sqrt

from lagsim.language.arrays import Floats
from lagsim.methods.parts import missed
from lagsim.methods.parts import state as at
from lagsim.methods.parts.constraints import clear_of_loss, project, watch
from lagsim.methods.parts.control import drop_compensation, record_extents
from lagsim.methods.parts.missed import BETWEEN, GOLDEN, Signals
from lagsim.methods.parts.parameters import FREEWHEEL, OFF, Parameters
from lagsim.methods.parts.state import (
    derivative,
    event_functions,
    inertias,
    interpolate,
    located,
    observe,
    project_sliding,
    start,
    step,
)
from lagsim.native.layout import array
from lagsim.tolerances import SUM_ROUNDOFF, SURFACE_ROUNDOFF, TIME_ROUNDOFF, TINY

CONSTRAINED = True
UNTIL = True
SWITCHES = True
LOCALIZED = True
ADAPTIVE = True

# By then the first steps, which are guessed, have grown to what the motion needs.
SETTLING = 10.0
NOWHERE = -1


class State(Signals):
    """State of every method: the above, events, and bounds of a step."""

    surfaces: int  # that switches are located on, and laws whose modes end
    inertias: int  # which are followed, whether they vanish on the way
    conditions: int  # of events and `until`, which are located when they become true

    event: float  # the number, from 1, of the condition that has been located; or 0
    switched: float  # the number, from 1, of the surface a switch was located on; or 0
    # The farthest a state was pulled onto what it slides along, against the motion.
    projected: float
    longest: float  # no step is longer than this; 0: any
    smallest_step: float  # once the first steps have found their size; 0: none yet
    speed: float  # about how fast the fastest motion is, for explicit methods
    at_bound: float  # steps held by stability ...
    off_bound: float  # ... since when so many were not
    ask_at: float  # at so many the kernel returns; 0: never
    feature: float  # about this time something short happens that depends on t alone
    feature_width: float  # ... of this width; 0: nothing is known of
    feature_reach: float  # it counts from so far before it ...
    feature_end: float  # ... to this time

    # A condition holds where this times its function is <= 0; 0: not armed, it has not
    # been false since, that is less than 0 by more than the leeway.
    orientation: Floats = array("conditions")
    equation: Floats = array("conditions")  # 1 of an equation
    leeway: Floats = array("conditions")

    # Event functions of surfaces and of conditions at a point; with their slopes, at
    # the start of a stretch, within it and at its end.
    event_functions: Floats = array(lambda s: s.surfaces + s.conditions)
    event_starts: Floats = array(lambda s: 2 * (s.surfaces + s.conditions))
    event_middles: Floats = array(lambda s: 2 * (s.surfaces + s.conditions))
    event_ends: Floats = array(lambda s: 2 * (s.surfaces + s.conditions))

    # Of each inertia: the largest, the smallest, its time, and the state there.
    inertia_largest: Floats = array("inertias")
    inertia_smallest: Floats = array("inertias", inf)
    inertia_when: Floats = array("inertias")
    inertia_where: Floats = array(lambda s: s.dynamic.stop * s.inertias)


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
            return at.BLOCK_FULL
        code = arrived(s, p)
        if code != NOWHERE:
            return code
        if s.ask_at > 0.0 and s.at_bound >= s.ask_at:
            return at.STIFF
        if made >= budget:
            return at.PAUSED
        made += 1
        if SWITCHES or ADAPTIVE:
            missed.keep_extents(s)
        s.satisfied = 0.0
        code = step(s, p)
        if code != at.DONE:
            return code
        s.most_step = 0.0
        if ADAPTIVE and has_missed(s, p) > 0:
            begin(s, p)
            continue
        inspect(s, p)
        if CONSTRAINED and watch(s, p) > 0:
            return at.RANK_LOST


def arrived(s: State, p: Parameters) -> int:
    """Code of the end that has been reached, if any; its rows are written."""
    if s.cut > 0.0:
        take_cut(s, p)
        if s.event == 0.0 and s.switched == 0.0:
            s.fresh = 1.0
            s.arc_start = s.t
            begin(s, p)
    if s.event > 0.0:
        return at.EVENT_FOUND
    if SWITCHES and s.switched > 0.0:
        return at.SWITCH_FOUND
    if s.t >= s.end:
        return at.DONE
    if p.passed < p.known and s.t >= p.knot_times[int(p.passed)] - p.apart:
        pass_knots(s, p)
    if p.passed >= p.known and p.known > 0.0:
        return at.KNOTS_PASSED
    if s.feature_width > 0.0 and s.t >= s.feature_end:
        return at.FEATURE_PASSED
    if CONSTRAINED and s.sigma < s.degenerate_below:
        return at.DEGENERATE
    return NOWHERE


def pass_knots(s: State, p: Parameters) -> None:
    """Go on with the pieces of tables that begin at the time reached.

    As y' goes on without a jump, the next step may be as long as the last one.
    """
    while p.passed < p.known and s.t >= p.knot_times[int(p.passed)] - p.apart:
        pass_knot(p)
    last = s.step_h
    start(s, p)
    if ADAPTIVE:
        s.h = max(s.h, last)
    else:
        s.arc_start = s.t


def pass_knot(p: Parameters) -> None:
    """Take the cell behind the next knot."""
    k = int(p.passed)
    p.fixed[p.first_mode + int(p.knot_modes[k])] = p.cells_after[k]
    p.passed += 1.0


def return_past_knot(p: Parameters) -> None:
    """Take the cell before the knot that was passed last."""
    p.passed -= 1.0
    k = int(p.passed)
    p.fixed[p.first_mode + int(p.knot_modes[k])] = p.cells_before[k]


def has_missed(s: State, p: Parameters) -> int:
    """Take the last step back where it missed something; return whether it did."""
    x = 0.0
    if LOCALIZED and s.feature_possible > 0.0:
        x = missed.missed_feature(s, p)
    if x == 0.0:
        x = missed.find_defect(s, p)
    if x == 0.0:
        return 0
    missed.reject_step(s, p, x)
    return 1


def note_inertias(s: State, p: Parameters, now: Floats) -> None:
    """Note how large and how small each inertia is, and when it is smallest.

    Where one vanishes beside its usual size, a coordinate loses its meaning. Steps get
    short there, so that the ends of steps come as close as the motion does.
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
    """Search the last step for an end of the arc or of the run; note the smallest.

    But for those that an end cuts short.
    """
    known = s.smallest_step
    counts = s.steps > SETTLING and s.t < next_end(s, p)
    if counts and (known == 0.0 or s.step_h < known):
        s.smallest_step = s.step_h
    if SWITCHES or UNTIL:
        find_end(s, p)
    if SWITCHES and s.cut == 0.0:
        project_state(s, p, s.t, s.y)
    if s.inertias > 0:
        note_inertias(s, p, s.work)


def take_cut(s: State, p: Parameters) -> None:
    """Take the state at the moment that the last step was cut at."""
    interpolate(s, p, s.cut, s.work)
    s.y[:] = s.work[: s.size]
    if SWITCHES:
        # What lies past the switch has not been.
        missed.restore_extents(s)
        record_extents(s)
    if CONSTRAINED:
        project(s, p, s.t, s.step_h, s.y, s.work)
    if SWITCHES:
        project_state(s, p, s.t, s.y)
    s.cut = 0.0


def project_state(s: State, p: Parameters, t: float, y: Floats) -> None:
    """Project a state onto the surfaces it slides along, and record the distance."""
    former = s.work
    former[s.dynamic] = y[s.dynamic]
    project_sliding(t, y, p)
    s.projected = max(
        s.projected, projected(s, y, former, 0), projected(s, y, former, s.n)
    )


def projected(s: State, y: Floats, former: Floats, first: int) -> float:
    """Shift of positions (first = 0) or velocities (first = n) by the projection.

    Against how far those have moved that were pulled, and what their forces' terms do
    in a step, which may cancel. Each counts by the push that it got: bodies that the
    surface does not touch are no measure, nor is where the origin lies.
    """
    n, h = s.n, s.step_h
    high, low = s.high[s.velocities], s.low[s.velocities]
    moved = 0.0
    whole = 0.0
    for i in range(n):
        k = first + i
        change = abs(y[k] - former[k])
        reach = high[i] - low[i] + h * s.parts[i]
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
    return 1.0  # what is no number, too


def begin(s: State, p: Parameters) -> None:
    """Begin an arc if this is one."""
    if s.fresh > 0.0:
        drop_compensation(s)
        start(s, p)
        if UNTIL:
            orient(s, p, s.t, s.y, inf)
        s.fresh = 0.0


def emit(s: State, p: Parameters, out: Floats, rows: int) -> int:
    """Write the rows up to the time reached; return 0 where the block is full first."""
    first = int(s.emitted)
    complete = fill(s, p, out, rows)
    end = int(s.emitted)
    width = 1 + s.size
    # The row of the state itself needs nothing.
    own = s.step_h == 0.0 or out[max(end - 1, 0) * width] == s.t
    if end > first and own and s.cut == 0.0:
        end -= 1
    for k in range(first, end):
        row = out[k * width :]
        # One for which Newton's method does not converge stays as it is.
        if CONSTRAINED and row[0] > s.step_t + s.satisfied * s.step_h:
            project(s, p, row[0], s.step_h, row[1:], s.work)
        if SWITCHES:
            project_sliding(row[0], row[1:], p)
    return complete


def fill(s: State, p: Parameters, out: Floats, rows: int) -> int:
    """Write rows as the method interpolates them; full after a state beside them."""
    while True:
        t = s.row_start + s.row * s.row_step
        due = t < s.row_limit and t <= s.t
        # A state beside the rows; at an end it is the next arc's.
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
        if (t == s.t and s.cut == 0.0) or s.step_h == 0.0:
            row[1 : 1 + s.size] = s.y
        else:
            counted = s.evaluations
            interpolate(s, p, (t - s.step_t) / s.step_h, row[1:])
            if beside:
                s.evaluations = counted  # nothing that is decided by them depends on it
        s.emitted += 1.0
        if beside:
            s.extras -= 1.0
            return 0
        s.row += 1.0


def orient(s: State, p: Parameters, t: float, y: Floats, most: float) -> None:
    """Arm the conditions that are false at a state: they count from then on.

    Of inequalities those with no more leeway than `most`.
    """
    values = s.event_functions
    located(t, y, p, values)
    for k in range(s.conditions):
        if s.orientation[k] == 0.0 and (s.equation[k] > 0.0 or s.leeway[k] <= most):
            if values[k] < -s.leeway[k]:
                s.orientation[k] = -1.0
                s.leeway[k] = 0.0
            elif s.equation[k] > 0.0 and values[k] > s.leeway[k]:
                s.orientation[k] = 1.0
                s.leeway[k] = 0.0


def tabulate(
    states: Floats, rows: int, size: int, p: Parameters, out: Floats, width: int
) -> None:
    """Columns (rows, width) of states (rows, 1 + size); they depend on nothing else.

    With the pieces of tables that there were at the time of each.
    """
    exchange_lengths(p)
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
    """Exchange what constraint rows are scaled by on the way with that of the plan."""
    p.reference, p.usual_reference = p.usual_reference, p.reference
    for i in range(p.m if p.loops > 0 else 0):
        k = p.lengths[i]
        p.lengths[i] = p.usual_lengths[i]
        p.usual_lengths[i] = k


# --- the length of the step to try, and what bounds it --------------------------------
# Whether an explicit method's step is held by stability is seen at no cost. Two states
# at the same time, close together, and y' at both: the quotient of the differences
# tells how fast the fastest motion is, which is what they differ in when the step is at
# the bound. In the metric of the energy, sqrt(|da| / |dq|) is the frequency of an
# undamped oscillation in any phase and the rate of one that is damped, |da| / |dv| is
# at most that, and serves where dq is below rounding.
#
# Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
# section IV.2 (automatic stiffness detection), for systems of first order.

# Steps towards what happens at its own time are this part of the way to it.
CLOSER = 0.25

# What is closer than so many of the smallest steps has been reached.
REACHED = 4.0

# A step past this part of the limit is at the bound: step control holds it between
# this and a little more than 1, and accuracy asks for less than a tenth of it.
PART = 0.5
# So many steps in a row below it, and there is no bound.
FREE_STEPS = 6.0


def next_end(s: State, p: Parameters) -> float:
    """Time at which the next step ends at the latest: the arc's end, or a knot."""
    if p.passed < p.known:
        knot = p.knot_times[int(p.passed)]
        if knot < s.end - p.apart:
            return float(knot)
    return float(s.end)


def usable_step(s: State, p: Parameters) -> float:
    """Step to try, with t + h exact; 0 where it would be too small."""
    t, h = s.t, s.h
    if s.most_step > 0.0:
        h = min(h, s.most_step)
    if s.feature_width > 0.0:
        h = up_to_feature(s, h)
    rest = next_end(s, p) - t
    passes = False
    if CONSTRAINED:
        # A step over a loss of rank has the length that it needs, whatever is asked.
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


def up_to_feature(s: State, h: float) -> float:
    """Step, bounded by a feature that depends on t alone.

    It ends where that begins; from there steps shrink with the way left to it.
    """
    away = s.feature - s.t
    before = away - s.feature_reach - s.feature_width
    if before > REACHED * TIME_ROUNDOFF * abs(s.t):
        return float(min(h, before))
    if away < -s.feature_reach:
        return h
    return float(min(h, max(s.feature_width, CLOSER * abs(away))))


def record_speed(
    s: State, h: float, limit: float, y: Floats, k: Floats, z: Floats, slope: Floats
) -> None:
    """Note the fastest motion, from states y and z with slopes k and `slope`."""
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
    if h * s.speed > PART * limit:
        s.at_bound += 1.0
        s.off_bound = 0.0
    else:
        s.off_bound += 1.0
        if s.off_bound >= FREE_STEPS:
            s.at_bound = 0.0


# --- events: the first switch, or condition, within a step ----------------------------
# Each surface has an event function: how far the state is from leaving the
# mode it is in; so has each condition, while it is false. Margins are evaluated at
# several points of a step, and once more between each two: where the value there does
# not follow from values and slopes at both, the points come closer until it does. One
# that has become negative, and by the slopes one that has been so in between (a touch,
# a narrow pulse), ends the step. The first root is located by bisection on the dense
# output, to the last bit. A step that needs more points than are allowed ends where
# they do, and the next one begins there.

# Event functions are evaluated at so many points of a step at least.
POINTS = 8
# Slopes are differences over this part of the way between points: closer than anything
# that a method resolves.
BESIDE = 2.0**-10
# One is known between two points where that in the middle is what the ends tell up
# to the first part of how it varies, or the last of the least of it; the slope there
# counts as the second says. Of points that are too far apart one of both may agree by
# chance, hardly both.
KNOWN = 0.1
TURNED = 0.25
CLEAR = 0.25
# Points come no closer than this, and there are so many in a step.
FINEST = 2.0**-14
# Or than this about a localized term; this many times it where points have run out
# before this part of the step: so many steps at most for one.
NARROWEST = 2.0**-40
COARSER = 16.0
LEAST_PART = 2.0**-5
MOST_POINTS = 2000
# A minimum is located to this part of the stretch it lies in: its own error is of
# the square of that.
NARROW = 1e-8


def of_surfaces(p: Parameters) -> int:
    """Count of the event functions of surfaces and laws; conditions come after."""
    if SWITCHES:
        return p.surfaces + p.laws
    return 0


def watched(s: State, p: Parameters) -> int:
    """Count of all event functions (C)."""
    if UNTIL:
        return of_surfaces(p) + s.conditions
    return of_surfaces(p)


def find_end(s: State, p: Parameters) -> None:
    """Search the last step for its first event, and end it there.

    s.switched becomes the number of the surface, or s.event that of the condition. One
    that is true is followed until it is false: from there on it counts.
    """
    t = s.t
    rows = s.row_limit
    if UNTIL:
        if true_at_once(s, p):
            cut(s, p, 0.0, TINY)
            return
        follow_true(s, p)
    search(s, p, 0.0)
    while UNTIL and s.event > 0.0 and follows(s, int(s.event) - 1):
        low = s.cut
        s.orientation[int(s.event) - 1] = -1.0
        s.leeway[int(s.event) - 1] = 0.0
        s.event = 0.0
        s.cut = 0.0
        s.t = t
        s.row_limit = rows
        search(s, p, low)
    if UNTIL:
        for k in range(s.conditions):
            if follows(s, k):
                s.orientation[k] = 0.0


def true_at_once(s: State, p: Parameters) -> bool:
    """Whether a condition that was false is true at the start: a velocity has jumped.

    It need not be true for long, and be false at all points of the step.
    """
    events_at(s, p, 0.0)
    for k in range(s.conditions):
        if not s.event_functions[of_surfaces(p) + k] > 0.0:
            return True
    return False


def follow_true(s: State, p: Parameters) -> None:
    """Follow the inequalities that are true at the start of the last step."""
    waits = False
    for k in range(s.conditions):
        waits = waits or s.orientation[k] == 0.0
    if waits:
        x = BESIDE / POINTS
        interpolate(s, p, x, s.work)
        orient(s, p, s.step_t + x * s.step_h, s.work, 0.0)
        for k in range(s.conditions):
            if s.orientation[k] == 0.0 and s.equation[k] == 0.0 and s.leeway[k] < inf:
                s.orientation[k] = 1.0


def follows(s: State, k: int) -> bool:
    """Whether condition k is an inequality that is true, and watched for its end."""
    return not (s.orientation[k] <= 0.0 or s.equation[k] > 0.0)


def search(s: State, p: Parameters, low: float) -> None:
    """Go through the last step from its fraction `low` on."""
    count = watched(s, p)
    first, middle, last = s.event_starts, s.event_middles, s.event_ends
    widest = 2.0 / POINTS
    width = widest
    narrowest = NARROWEST
    points = 0
    high = 0.0
    sample(s, p, low, BESIDE * width, first)
    while low < 1.0 and high == 0.0:
        x = min(low + width, 1.0)
        half = low + BETWEEN * (x - low)
        sample(s, p, half, -BESIDE * width, middle)
        sample(s, p, x, -BESIDE * width, last)
        points += 2
        clear = x - low < FINEST or known(s, p, x - low)
        if LOCALIZED and clear and x - low > narrowest:
            clear = none_approaches(s, p, low, x)
        if clear:
            high = first_end(s, p, low, half, first, middle)
            if high > 0.0:
                x = half
            else:
                high = first_end(s, p, half, x, middle, last)
                if high > 0.0:
                    low = half
            if high > 0.0:
                cut(s, p, low, high)
            first[: 2 * count] = last[: 2 * count]
            low = x
            width = min(2.0 * width, widest)
        elif points >= MOST_POINTS and low > LEAST_PART:
            s.cut = low
            s.t = s.step_t + low * s.step_h
            return
        else:
            if points >= MOST_POINTS:
                points = 0
                narrowest *= COARSER
            width = 0.5 * (x - low)
            sample(s, p, low, BESIDE * width, first)


def none_approaches(s: State, p: Parameters, low: float, x: float) -> bool:
    """Whether no signal comes closer inside a stretch than at its ends.

    A event function that is made of one would be flat at every point.
    """
    missed.signals_at(s, p, low, s.signals_first)
    missed.signals_at(s, p, low + BETWEEN * (x - low), s.signals_middle)
    missed.signals_at(s, p, x, s.signals_last)
    still = True
    for k in range(s.signals):
        if still and missed.may_approach(s, k, (x - low) * s.step_h):
            still = missed.hardly_varies(s, p, k, x)
    return still


def events_at(s: State, p: Parameters, x: float) -> None:
    """Leave the event functions at the fraction x of the last step."""
    z, now = s.work, s.event_functions
    t = s.step_t + x * s.step_h
    interpolate(s, p, x, z)
    if SWITCHES:
        event_functions(t, z, p, now)
    if UNTIL:
        own = now[of_surfaces(p) :]
        located(t, z, p, own)
        for k in range(s.conditions):
            own[k] = own[k] * s.orientation[k] + s.leeway[k]
            if s.orientation[k] == 0.0:
                own[k] = 1.0
            if own[k] == 0.0 and follows(s, k):
                own[k] = TINY  # of what is true, 0 is not its end


def sample(s: State, p: Parameters, x: float, beside: float, out: Floats) -> None:
    """Margins and slopes (2 C,) at the fraction x of the last step."""
    count = watched(s, p)
    now = s.event_functions
    events_at(s, p, x + beside)
    out[count : 2 * count] = now[:count]
    events_at(s, p, x)
    out[:count] = now[:count]
    out[count : 2 * count] = (out[count : 2 * count] - now[:count]) / beside


def known(s: State, p: Parameters, width: float) -> bool:
    """Whether all event functions on a stretch follow from values at its ends."""
    count = watched(s, p)
    for k in range(count):
        a = s.event_starts[k]
        m = s.event_middles[k]
        b = s.event_ends[k]
        A = width * s.event_starts[count + k]
        B = width * s.event_ends[count + k]
        P = 3.0 * (b - a) - 2.0 * A - B
        Q = A + B - 2.0 * (b - a)
        off = abs(a + BETWEEN * (A + BETWEEN * (P + BETWEEN * Q)) - m)
        turned = A + BETWEEN * (2.0 * P + 3.0 * BETWEEN * Q)
        turned = TURNED * abs(turned - width * s.event_middles[count + k])
        reach = max(abs(m - a), abs(m - b))
        # What is off by no more than counts as none cannot be known better, nor can
        # slopes where that rounds.
        enough = max(KNOWN * reach, CLEAR * min(a, m, b), -least_allowed(p, k))
        rounding = 0.0  # also by that of the time
        nothing = -1.0
        if SWITCHES and p.surfaces <= k < p.surfaces + p.laws:
            # That of a law may be rounding, and its slopes with it.
            rounding = p.law_rounding[k - p.surfaces]
            nothing = -least_allowed(p, k)
        if UNTIL and k >= of_surfaces(p):
            # Of a condition that is held on its edge all is, and its leeway beside it.
            rounding = s.leeway[k - of_surfaces(p)]
            nothing = 2.0 * rounding
        unknown = off > max(enough, rounding)
        unknown = unknown or turned > max(enough, TURNED / BESIDE * rounding)
        if unknown and not max(abs(a), abs(m), abs(b)) <= nothing:
            return False
    return True


def least_allowed(p: Parameters, k: int) -> float:
    """Value of an event function below which a mode ends; 0 of a condition."""
    if SWITCHES and k < p.surfaces + p.laws:
        return -max(float(p.slack[k]), float(p.band[k]))
    return 0.0


def over(p: Parameters, k: int, value: float) -> bool:
    """Whether the mode is over by event function k."""
    if UNTIL and k >= of_surfaces(p):
        return not value > 0.0
    return not value >= least_allowed(p, k)


def ends(s: State, p: Parameters, k: int, value: float, x: float) -> bool:
    """Whether a mode ends at the fraction x of the last step, by event function k."""
    return over(p, k, value) and x >= errs_until(s, p, k, value)


def errs_until(s: State, p: Parameters, k: int, value: float) -> float:
    """Fraction of the last step up to which a gap has such a value by an error.

    One that is open after the step, and neither closes at its start nor is pushed to,
    is open in between: where it is not, the interpolant errs, as it does about what
    leaves the ground as a power of the time. What has not risen at the end of such a
    step either is below its ground by the method's error, and on it from then on.
    """
    law = k - p.surfaces
    if not SWITCHES or not 0 <= law < p.laws or p.law_mode[law] != OFF:
        return 0.0
    is_open = not over(p, k, event_function_at(s, p, k, 1.0))
    if p.law_kind[law] > FREEWHEEL or not value >= -error_of_gap(s, p, law, is_open):
        return 0.0
    if is_open:
        return inf
    return 1.0 if not ADAPTIVE and p.slack[k] > 0.0 else 0.0


def error_of_gap(s: State, p: Parameters, k: int, is_open: bool) -> float:
    """Error in the last step of law k, if it parts at the start; 0 if it does not.

    Of the interpolant, by what the accelerations change in the step; of the method
    where the gap is not open after it, by these themselves; or the tolerance.
    """
    last, first = s.exact_rates[s.velocities], s.spare[s.velocities]
    interpolate(s, p, 1.0, s.work)
    derivative(s.step_t + s.step_h, s.work, p, s.exact_rates)
    interpolate(s, p, 0.0, s.work)
    derivative(s.step_t, s.work, p, s.spare)
    at = p.m - p.laws + k
    row, push, error = p.A[at * s.n :], -p.b[at], 0.0
    roundoff, moved = abs(push), 0.0
    h = s.step_h
    for i in range(s.n):
        push += row[i] * first[i]
        roundoff += abs(row[i]) * max(s.parts[i], abs(first[i]))
        moved += abs(row[i]) * s.sizes[s.n + i]
        bend = abs(last[i] - first[i]) if is_open else max(abs(last[i]), abs(first[i]))
        bend *= h if p.law_kind[k] == FREEWHEEL else 0.5 * h * h
        error += abs(row[i]) * (s.tolerances[i] if ADAPTIVE else bend)
    moved = max(moved, h * roundoff)
    if p.law_speeds[k] < -SUM_ROUNDOFF * moved or push < -SUM_ROUNDOFF * roundoff:
        return 0.0
    return float(error)


def first_end(
    s: State, p: Parameters, low: float, x: float, before: Floats, after: Floats
) -> float:
    """Point in (low, x] where something ends, or 0.

    No later than any least function that is negative: what has ended is so there still.
    before, after : (2 C,), event functions and slopes there.
    """
    count = watched(s, p)
    high = 0.0
    for k in range(count):
        if ends(s, p, k, after[k], x):
            high = x
    for k in range(count):
        fall = before[count + k]
        rise = after[count + k]
        if touches(x - low, before[k], fall, after[k], rise):
            least = least_event(s, p, k, low, x)
            if ends(s, p, k, event_function_at(s, p, k, least), least):
                high = least if high == 0.0 else min(high, least)
    if SWITCHES and high == 0.0:
        slack = p.slack
        for k in range(p.surfaces + p.laws):
            if after[k] > slack[k]:
                slack[k] = 0.0
    return high


def event_function_at(s: State, p: Parameters, k: int, x: float) -> float:
    """Return one event function at the fraction x of the last step."""
    events_at(s, p, x)
    return float(s.event_functions[k])


def touches(width: float, a: float, fall: float, b: float, rise: float) -> bool:
    """Whether a event function could be negative between a and b.

    It falls at the start and rises at the end; a convex one stays above its tangents.
    """
    if fall >= 0.0 or rise <= 0.0:
        return False
    meets = (b - a - rise * width) / (fall - rise)
    return a + fall * meets < 0.0


def least_event(s: State, p: Parameters, k: int, low: float, high: float) -> float:
    """Minimum of event function k in [low, high], by golden section."""
    left = high - GOLDEN * (high - low)
    right = low + GOLDEN * (high - low)
    at_left = event_function_at(s, p, k, left)
    at_right = event_function_at(s, p, k, right)
    narrow = NARROW * (high - low)
    while high - low > narrow:
        if at_left < at_right:
            high = right
            right = left
            at_right = at_left
            left = high - GOLDEN * (high - low)
            at_left = event_function_at(s, p, k, left)
        else:
            low = left
            left = right
            at_left = at_right
            right = low + GOLDEN * (high - low)
            at_right = event_function_at(s, p, k, right)
    return 0.5 * (low + high)


def cut(s: State, p: Parameters, low: float, high: float) -> None:
    """End the step at the first moment in (low, high] at which something ends.

    That is where its function vanishes, also where only one well below 0 tells it.
    """
    count = watched(s, p)
    first = count
    for k in range(count):
        if ends(s, p, k, event_function_at(s, p, k, high), high):
            first = k
            least = least_allowed(p, k)
            if event_function_at(s, p, k, low) >= 0.0:
                least = 0.0
            if errs_until(s, p, k, event_function_at(s, p, k, high)) == 0.0:
                high = end_of(s, p, k, least, low, high)
            if SWITCHES and least < 0.0:
                # A flight that began a rounding below ends where it is over.
                middle = 0.5 * (low + high)
                if event_function_at(s, p, k, middle) > p.slack[k]:
                    high = end_of(s, p, k, -float(p.band[k]), middle, high)
    if UNTIL and first >= of_surfaces(p):
        s.event = first - of_surfaces(p) + 1.0
    else:
        s.switched = first + 1.0
    if SWITCHES:
        for k in range(p.laws):
            law = p.surfaces + k
            value = event_function_at(s, p, law, high)
            errs = over(p, law, value) and errs_until(s, p, law, value) > 0.0
            p.law_opens[k] = 1.0 if errs else 0.0
    shorten(s, high)


def end_of(
    s: State, p: Parameters, k: int, least: float, low: float, high: float
) -> float:
    """Return the first point in (low, high] at which function k is below `least`."""
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        value = event_function_at(s, p, k, middle)
        ended = not value >= least
        if UNTIL and k >= of_surfaces(p):
            ended = not value > 0.0
        if ended:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    return high


def shorten(s: State, x: float) -> None:
    """End the last step at its fraction x.

    Its state stays until the rows before that moment are written: methods may
    interpolate from it.
    """
    s.cut = x
    s.t = s.step_t + x * s.step_h
    s.row_limit = min(s.row_limit, s.t)
