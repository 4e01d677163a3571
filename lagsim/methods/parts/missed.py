"""Missed-feature check and defect check of an accepted step.

A localized term (a hill, a wall, a gate) is flat to rounding except where its argument,
the signal, is close to one value; ends and stages of a step may all lie where it is
flat. A signal is smooth, and resolved by the step: from its values and slopes at both
ends and between them follows whether it comes closer to that value inside than at
either end. Only then the dense output is searched (`search`) for the closest approach,
and y' from the equations is compared there, and on its shoulders, with the slope of the
dense output. Where they differ by more than the tolerance allows, the step is rejected,
and the next is half as long as the way to that place.

The distance of a signal is the logarithm of how far below one its term is, base e.
"""

from __future__ import annotations

from math import log

from lagsim.language.arrays import Floats
from lagsim.methods.parts.constraints import Rank
from lagsim.methods.parts.control import (
    PERTURBED,
    move_aside,
    perturb,
    scattered,
    set_reach,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import (
    derivative,
    interpolate,
    interpolate_rates,
    rounding,
    signals,
)
from lagsim.native.layout import array
from lagsim.tolerances import OVERFLOW, TERM_ROUNDOFF, TINY, VALUE_ROUNDOFF

# What a signal does: the function goes with e^u, steps where u vanishes, goes with
# 1/|u|^power or with |u|^power. Where one falls below 0 a condition steps or bends: no
# feature is looked for there, but points of the search for events are on either side.
LARGEST = 0.0
NEAR_ZERO = 1.0
SMALL = 2.0
LARGE = 3.0
FALLING = 4.0

# A function that becomes e^1.4, four times, larger inside a step than at either end is
# searched for; less than that the stages of a step see.
APPROACH = 1.4
# Between the ends of a stretch rows are evaluated here, not in the middle: a period may
# be half of it.
BETWEEN = 0.6180339887498949
# Slopes are differences over this part of the way between points: closer than anything
# that a method resolves.
BESIDE = 2.0**-10
# A row is known on a stretch where its value between is that of the cubic through the
# ends up to the first part of how it varies; the slope there counts as the second says.
# Of points that are too far apart one of both may agree by chance, hardly both.
KNOWN = 0.1
TURNED = 0.25
# A signal is known as well where its distance is, up to this.
FLAT = 0.1
# Multiples of it, less their whole parts, are spread evenly, too.
GOLDEN = 0.6180339887498949
# y' from the equations and the slope of the dense output differ by up to so many
# tolerances where nothing has been missed: dense output is of lower order.
PASSED = 1e4


class Table(Rank):
    """Rows, functions that a step is searched for, at its points; sizes before it.

    Event functions of surfaces and laws, then those of conditions, then signals, the
    arguments of localized terms, then the relations of sections; the last is the
    smallest singular value.
    """

    surfaces: int  # that switches are located on, and laws whose modes end
    conditions: int  # of events and `until`, which are located when they become true
    signals: int
    sections: int  # relations whose crossings are shown
    feature_possible: float  # 1 if the last step is to be searched for a missed feature
    defect_row: float  # the row at which the last defect was found
    most_step: float  # no step is longer until one has been made; 0: no such limit
    # Of each signal: its kind, the power that goes with it, the farthest it has been
    # since it was close.
    kinds: Floats = array("signals")
    powers: Floats = array("signals")
    farthest: Floats = array("signals")
    # Rows at a point; their values, then slopes, at the start of a stretch, within it,
    # and at its end.
    values: Floats = array(lambda s: relations(s) + s.sections + 1)
    starts: Floats = array(lambda s: 2 * rows(s))
    middles: Floats = array(lambda s: 2 * rows(s))
    ends: Floats = array(lambda s: 2 * rows(s))
    # Sizes, least and largest values before the last step.
    sizes_before: Floats = array("size")
    low_before: Floats = array("size")
    high_before: Floats = array("size")


def events(s: Table) -> int:
    """Count of event functions, the first rows."""
    return s.surfaces + s.conditions


def relations(s: Table) -> int:
    """Return the number of the first row that is the relation of a section."""
    return s.surfaces + s.conditions + s.signals


def rows(s: Table) -> int:
    """Count of all rows."""
    return relations(s) + s.sections + 1


def next_end(s: Table, p: Parameters) -> float:
    """Time at which a step ends at the latest: the arc's end, or a knot."""
    if p.passed < p.known:
        knot = p.knot_times[int(p.passed)]
        if knot < s.end - p.apart:
            return float(knot)
    return float(s.end)


def check_features(
    s: Table,
    p: Parameters,
    h: float,
    old: Floats,
    old_rates: Floats,
    new: Floats,
    new_rates: Floats,
) -> None:
    """Set `feature_possible`: a signal may come close to its value within a step.

    From y and y' (size,) at both ends, between which y is interpolated.
    """
    sample_roughly(s, p, h, old, old_rates, new, new_rates, 0.0, BESIDE, s.starts)
    sample_roughly(s, p, h, old, old_rates, new, new_rates, 1.0, -BESIDE, s.ends)
    x = BETWEEN
    sample_roughly(s, p, h, old, old_rates, new, new_rates, x, -BESIDE, s.middles)
    # At the end of an arc its closest approach may be that of the whole motion.
    s.feature_possible = 1.0 if s.t + h >= next_end(s, p) else 0.0
    for k in range(events(s), events(s) + s.signals):
        if may_approach(s, k, 1.0):
            s.feature_possible = 1.0


def sample_roughly(
    s: Table,
    p: Parameters,
    h: float,
    old: Floats,
    old_rates: Floats,
    new: Floats,
    new_rates: Floats,
    x: float,
    beside: float,
    out: Floats,
) -> None:
    """Signals and their slopes, among rows (2 R,), at the fraction x of such a step."""
    z, count = s.point, rows(s)
    old_a, new_a = old_rates[s.velocities], new_rates[s.velocities]
    for point in range(2):
        u = x if point == 1 else x + beside
        for i in range(s.size):
            change = new[i] - old[i]
            A = h * old_rates[i]
            B = h * new_rates[i]
            z[i] = cubic(u, old[i], A, new[i], B)
            if i < s.n:
                # Positions with their second derivatives too: what the cubic lacks.
                P = 3.0 * change - 2.0 * A - B
                Q = A + B - 2.0 * change
                a = 0.5 * h * h * old_a[i] - P
                b = 0.5 * h * h * new_a[i] - P - 3.0 * Q
                z[i] += u * u * (1.0 - u) * (1.0 - u) * ((1.0 - u) * a + u * b)
        signals(s.t + u * h, z, p, s.values[events(s) :])
        if point == 0:
            out[count : 2 * count] = s.values[:count]
    out[:count] = s.values[:count]
    out[count : 2 * count] = (out[count : 2 * count] - s.values[:count]) / beside


def may_approach(s: Table, k: int, width: float) -> bool:
    """Whether the distance of signal k may be less inside a stretch than at its ends.

    Or is not known from its ends.
    """
    if not signal_is_known(s, k, width):
        return True
    first = away(s, k, s.starts)
    middle = away(s, k, s.middles)
    last = away(s, k, s.ends)
    left = closest(s, k, s.starts, s.middles, BETWEEN * width)
    right = closest(s, k, s.middles, s.ends, (1.0 - BETWEEN) * width)
    dip = min(first, max(middle, right, last)) - left
    dip = max(dip, min(max(first, left), max(right, last)) - middle)
    dip = max(dip, min(max(first, left, middle), last) - right)
    return dip > APPROACH


def cubic(x: float, a: float, A: float, b: float, B: float) -> float:
    """Value at x of the cubic with values a, b and slopes A, B at 0 and 1."""
    P = 3.0 * (b - a) - 2.0 * A - B
    Q = A + B - 2.0 * (b - a)
    return a + x * (A + x * (P + x * Q))


def off(s: Table, k: int, width: float) -> float:
    """How far the value of row k between the ends of a stretch is from their cubic."""
    A = width * s.starts[rows(s) + k]
    B = width * s.ends[rows(s) + k]
    value = cubic(BETWEEN, s.starts[k], A, s.ends[k], B)
    return float(abs(value - s.middles[k]))


def turned(s: Table, k: int, width: float) -> float:
    """How far its slope is from that of the cubic, as it counts beside values."""
    A = width * s.starts[rows(s) + k]
    B = width * s.ends[rows(s) + k]
    change = s.ends[k] - s.starts[k]
    P = 3.0 * change - 2.0 * A - B
    Q = A + B - 2.0 * change
    slope = A + BETWEEN * (2.0 * P + 3.0 * BETWEEN * Q)
    return float(TURNED * abs(slope - width * s.middles[rows(s) + k]))


def variation(s: Table, k: int) -> float:
    """How much row k varies on a stretch."""
    m = s.middles[k]
    return float(max(abs(m - s.starts[k]), abs(m - s.ends[k])))


def signal_is_known(s: Table, k: int, width: float) -> bool:
    """Whether signal k on a stretch, or its distance, follows from its ends."""
    kind = s.kinds[k - events(s)]
    power = s.powers[k - events(s)]
    error = max(off(s, k, width), turned(s, k, width))
    if not error < OVERFLOW:
        return False
    if error <= KNOWN * variation(s, k):
        return True
    m = s.middles[k]
    near = m - error if m > 0.0 else m + error
    if kind == LARGEST or (kind == LARGE and m > 0.0):
        near = m + error
    return abs(distance(kind, power, near) - distance(kind, power, m)) < FLAT


def distance(kind: float, power: float, u: float) -> float:
    """Distance of a signal u: powers of e by which its term is below one."""
    if kind == FALLING:
        return 0.0
    if kind == LARGEST:
        return -power * u
    if kind == NEAR_ZERO:
        return 2.0 * power * abs(u)
    if kind == SMALL:
        return power * log(max(abs(u), TINY))
    return -power * log(max(abs(u), TINY))


def away(s: Table, k: int, at_point: Floats) -> float:
    """Distance of signal k, from the rows at a point."""
    return distance(s.kinds[k - events(s)], s.powers[k - events(s)], at_point[k])


def closest(s: Table, k: int, left: Floats, right: Floats, width: float) -> float:
    """Least distance of signal k on its cubic between two points, or less than it."""
    kind = s.kinds[k - events(s)]
    low = lowest(1.0, s, k, left, right, width)
    u = -lowest(-1.0, s, k, left, right, width)
    if kind == LARGE:
        u = max(u, -low)
    elif kind != LARGEST:
        u = max(low, -u, 0.0)
    return distance(kind, s.powers[k - events(s)], u)


def lowest(
    way: float, s: Table, k: int, left: Floats, right: Floats, width: float
) -> float:
    """Least value of row k, times `way`, on its cubic between two points, or less.

    The cubic lies within the hull of a, a + A/3, b - B/3, b. Slopes are differences:
    what seems to turn at an end may do so just inside of it.
    """
    a = way * left[k]
    b = way * right[k]
    c = a + way * width / 3.0 * left[rows(s) + k]
    d = b - way * width / 3.0 * right[rows(s) + k]
    low = min(a, b, c, d)
    error = 2.0 * BESIDE * (max(a, b, c, d) - low)
    if min(abs(c - a), abs(d - b)) <= error:
        low -= 3.0 * BESIDE * error
    return float(low)


def is_missed(s: Table, p: Parameters, x: float) -> bool:
    """Whether the last step has missed a feature at its fraction x."""
    s.evaluations += 1.0
    return differs(s, p, x, PASSED) and not is_rounding(s, p, x, PASSED)


# --- defect check: the dense output against y' from the equations ---------------------
# The defect at a row is y' from the equations less the slope of the dense output. Where
# it is too large, the step has passed over a feature that neither its stages nor its
# series saw, whatever its form; it is rejected.
#
# Of the rows in a step every tenth is checked: no feature of ten rows is missed, and
# where no step has so many the check costs nothing. A step that is rejected without
# need is not made shorter than five rows by that; towards the last row with a defect,
# than LEAST of one.

# In output steps. A check costs about as much as a row.
APART = 10.0
LEAST = 2.0**-4
# The largest defect of a step that has missed nothing, in tolerances. Over the
# shipped models, all their rows and five tolerances it was up to 14 (taylor), 100
# (dop853) and 80 (radau), but for what `is_beyond` allows.
LEFT = 1e3
# Of what a force does in an output step.
EXPECTED = 1e-2


def find_defect(s: Table, p: Parameters) -> float:
    """Row with a defect, as a fraction of the last step, or 0."""
    # A step over a loss of rank has the length that it needs.
    if s.passes > 0.0:
        return 0.0
    reach = min(s.t, s.row_limit)
    if s.defect_row >= s.row and time_of(s, s.defect_row) < reach:
        x = place(s, s.defect_row)
        if x * s.step_h > LEAST * s.row_step and is_off(s, p, x):
            return x
    k = s.row + APART - 1.0
    while time_of(s, k) < reach:
        x = place(s, k)
        if is_off(s, p, x):
            s.defect_row = k
            expect(s)
            return x
        k += APART
    return 0.0


def expect(s: Table) -> None:
    """Count the defect at a row as a size of the motion, before it is reached.

    Or the first traces of it would be controlled as finely as denormal numbers are.
    """
    n, delta = s.n, s.row_step
    sizes = s.sizes_before
    for i in range(n, s.size):
        push = EXPECTED * delta * abs(s.exact_rates[i] - s.point_rates[i])
        if push < OVERFLOW:
            sizes[i] = max(sizes[i], push)
            if i < s.velocities.stop:
                sizes[i - n] = max(sizes[i - n], delta * push)


def time_of(s: Table, k: float) -> float:
    """Time of row k."""
    return float(s.row_start + k * s.row_step)


def place(s: Table, k: float) -> float:
    """Where row k is, as a fraction of the last step."""
    return (time_of(s, k) - s.step_t) / s.step_h


def is_off(s: Table, p: Parameters, x: float) -> bool:
    """Whether there is a defect beyond rounding and tolerances."""
    if not differs(s, p, x, LEFT) or is_rounding(s, p, x, LEFT):
        return False
    return is_beyond(s, p, x)


def is_rounding(s: Table, p: Parameters, x: float, most: float) -> bool:
    """Whether the defect that `differs` has left is the state's rounding alone.

    Beside a root no slope tells what that does. most : as there; rounding itself leaves
    no more than it does.
    """
    set_reach(s, s.point, s.exact_rates, 0.0)
    t = s.step_t + x * s.step_h
    perturb(s, p, t, s.point, s.exact_rates, TERM_ROUNDOFF, 2, s.far_before)
    for i in range(s.n, s.size):
        s.far_before[i] *= PERTURBED
    return not exceeds(s, most, s.far_before)


def hardly_varies(s: Table, p: Parameters, k: int, x: float) -> bool:
    """Whether signal k varies by rounding and tolerances alone at three points.

    That is, than rounding the state does, or moving it by its tolerances, to one side,
    at the last, at x. What a push hands on along a chain at rest goes with ever higher
    powers of the time: at first no step, however short, has its shape.
    """
    z = s.point
    now = s.values[events(s) :]
    most = 0.0
    for way in range(2):
        interpolate(s, p, x, z)
        part = TERM_ROUNDOFF if way == 0 else -TERM_ROUNDOFF
        move_aside(s.size, z, z, part, way, z)
        move_within(s, 1.0 if way == 0 else -1.0, z)
        signals(s.step_t + x * s.step_h, z, p, now)
        most = max(most, float(abs(s.values[k] - s.ends[k])))
    return variation(s, k) <= most


def is_beyond(s: Table, p: Parameters, x: float) -> bool:
    """Whether the defect found by `differs` exceeds the tolerances.

    The state is not known better than to as many tolerances. What a change by that does
    to y' is no sign, where it is stiff or close to a loss of rank; nor is its rounding.
    """
    t = s.step_t + x * s.step_h
    z = s.point
    rounding(t, z, p, s.work)
    move_within(s, LEFT, z)
    derivative(t, z, p, s.spare)
    for i in range(s.n, s.size):
        s.spare[i] = abs(s.spare[i] - s.exact_rates[i])
        s.spare[i] += VALUE_ROUNDOFF * abs(s.work[i - s.n])
    return exceeds(s, LEFT, s.spare)


def exceeds(s: Table, most: float, besides: Floats) -> bool:
    """Whether the defect exceeds so many tolerances and what is allowed besides."""
    for i in range(s.n, s.size):
        allowed = most * s.tolerances[i] / s.step_h + besides[i]
        defect = abs(s.exact_rates[i] - s.point_rates[i])
        if s.tolerances[i] > 0.0 and not defect <= allowed:
            return True
    return False


def move_within(s: Table, tolerances: float, z: Floats) -> None:
    """Move a state by about so many of its tolerances.

    By parts and signs of each component's own: what is alike in two may cancel.
    """
    for i in range(s.size):
        part = 2.0 * scattered(i, 0) - 1.0
        part += 0.5 if part > 0.0 else -0.5
        z[i] += part * tolerances * s.tolerances[i]


def differs(s: Table, p: Parameters, x: float, most: float) -> bool:
    """Whether the defect exceeds `most`, in tolerances; leave both rates.

    most : in tolerances.
    """
    interpolate_rates(s, x, s.point_rates)
    interpolate(s, p, x, s.point)
    derivative(s.step_t + x * s.step_h, s.point, p, s.exact_rates)
    s.far_before[:] = 0.0
    return exceeds(s, most, s.far_before)


def keep_extents(s: Table) -> None:
    """Note the largest sizes: a step may go far past where it will end."""
    s.sizes_before[:] = s.sizes
    s.low_before[:] = s.low
    s.high_before[:] = s.high


def restore_extents(s: Table) -> None:
    """Take back the sizes that the last step has led to."""
    s.sizes[:] = s.sizes_before
    s.low[:] = s.low_before
    s.high[:] = s.high_before


def reject_step(s: Table, p: Parameters, x: float) -> None:
    """Reject the last step; the next is half as long as to its fraction x."""
    interpolate(s, p, 0.0, s.point)
    s.y[:] = s.point[: s.size]
    restore_extents(s)
    s.t = s.step_t
    s.most_step = 0.5 * x * s.step_h
    s.steps -= 1.0
    s.rejections += 1.0
    s.cut = 0.0
    s.fresh = 1.0
