"""The table of functions in which a step is searched, and the location of a zero.

A row of the table is a function of the fraction x of a step, on the dense output. A row
is of one kind, in the order of the table:

    EVENT     the event function of a surface, a law or a condition
    SIGNAL    the argument of a localized term, see `missed`
    CROSSING  the relation of a section, positive on the side that the motion comes from
    RANK      the smallest singular value of the constraint rows

Values and slopes of all rows of a kind are sampled at both ends of a stretch of the
step, and once between the ends. From these follow whether a row is known on the stretch
(`row_is_known`), and whether the row may have a minimum inside (`lowest`). The minimum
is located by golden section (`least_of`), and a zero to the last bit (`end_of`).
"""

from __future__ import annotations

from functools import cached_property
from math import inf, log
from typing import TYPE_CHECKING

from lagsim.language.arrays import Floats
from lagsim.methods.parts.constraints import Rank, sigma_at
from lagsim.methods.parts.parameters import LEVEL, Parameters
from lagsim.methods.parts.state import (
    event_functions,
    interpolate,
    located,
    sections,
    signals,
)
from lagsim.native.kernels.words import bits, from_bits
from lagsim.native.layout import after, array, part
from lagsim.tolerances import OVERFLOW, SAME_INSTANT, TINY

if TYPE_CHECKING:
    from lagsim.native.kernels.words import Static

UNTIL = True
SWITCHES = True
LOCALIZED = True

EVENT, SIGNAL, CROSSING, RANK = 0, 1, 2, 3
# Kind of the search for zeros of signals, without any event function.
ARGUMENT = 4

# Kinds of signals u: the term varies as e^u, has a step at u = 0, varies as 1/|u|^power
# or as |u|^power. FALLING: a condition steps or bends where u falls below 0; there is
# no feature, but the search for events has points on either side.
LARGEST = 0.0
NEAR_ZERO = 1.0
SMALL = 2.0
LARGE = 3.0
FALLING = 4.0

# Fraction of a stretch at which rows are evaluated; not 1/2, which may be a period.
BETWEEN = 0.6180339887498949
# Slopes are differences over this part of the distance between points: closer than any
# method resolves.
BESIDE = 2.0**-10
# A row is known on a stretch if its inner value differs from the cubic through the ends
# by at most the part KNOWN of its variation, or CLEAR of its least value, and its
# slope, weighted by TURNED, does so as well. With points too far apart one of the two
# tests may succeed by chance, but rarely both.
KNOWN = 0.1
CLEAR = 0.25
TURNED = 0.25
THIRD = 1.0 / 3.0
# Coefficients of the polynomials of `missed.shape_step`.
DEGREES = 6
GOLDEN = 0.6180339887498949
# Number of golden sections that locate a minimum to 1e-8 of a stretch; the error of the
# minimum is of second order.
NARROW = 39
# Of the ITP method (k_1 times the width of the bracket).
ITP = 0.2
# Points of a step at which events are evaluated: least and largest number.
POINTS = 8
MOST_POINTS = 2000
# Up to this fraction of a step an inequality that jumps just after the start of the run
# has its value after the jump. After a zero the search for the next one begins at this
# part of the step, or of the first place, at distances that grow by FARTHER.
NEXT = 2.0**-26
FARTHER = 4.0
# A row jumps if its change between neighbouring fractions of a step exceeds the part
# JUMP of its change within the part AROUND of the step; beside a pole both are equal.
AROUND = 2.0**-30
JUMP = 0.25
# A change by this many roundings of a condition may be a jump.
MANY = 64.0
# The orientation, within the search of a step, of an equation whose value is 0 beyond
# the start of the step.
STAYS = 2.0
# Error of the state of a step: in tolerances, and as a part of the range of a
# component.
ERRED = 30.0
PLACES = 2.0**-40


class SearchTable(Rank):
    """Memory of the rows (functions) searched in a step, and of sizes before it.

    Rows are event functions of surfaces and laws, then those of conditions, then
    signals (arguments of localized terms), then relations of sections, then the
    smallest singular value.
    """

    # number of surfaces on which switches are located, and of laws whose modes end
    surfaces: int
    # number of conditions of events and `until`, located when they become true
    conditions: int
    signals: int
    sections: int  # number of relations whose crossings are recorded
    sampled: int  # number of leading components of y on which the signals depend
    feature_possible: float  # 1 if the last step is to be searched for a missed feature
    defect_row: float  # the row of the last defect
    # 1 if the last step had a defect, at a later row than the step before
    defect_found: float
    most_step: float  # upper bound of the next step until a step is accepted; 0: none
    # For each signal: its kind, the power of the kind, and the largest distance since
    # it was last close.
    kinds: Floats = array("signals")
    powers: Floats = array("signals")
    farthest: Floats = array("signals")
    # Rows at a point. The fractions of the step at the start, within, and at the end of
    # the stretch that is examined; values of rows, then slopes, at these points.
    values: Floats = array(lambda s: relations(s) + s.sections + 1)
    places: Floats = array(lambda _: 3)
    points: Floats = array(lambda s: 6 * rows(s))
    starts: Floats = part("points", lambda s: 2 * rows(s))
    middles: Floats = after("starts", lambda s: 2 * rows(s))
    ends: Floats = after("middles", lambda s: 2 * rows(s))
    # Values and slopes at the end of the last step that was examined, its time, and the
    # length of the step; 0: unknown.
    last_ends: Floats = array(lambda s: 2 * rows(s))
    end_time: float
    end_step: float
    step_end: float  # the time at the end of the last step
    # Fractions of the last step: the first switch in a condition from the start of the
    # stretch on, inf if unknown; a point just past the last switch; and the length of
    # stretches between switches.
    switch: float
    past: float
    usual: float
    # Polynomials of the components of the state in the last step.
    shape: Floats = array(lambda s: DEGREES * s.sampled)
    # The margin of each row whose value leaves 0 from rest, see `leaving`; -1: it does
    # not leave. The errors of the components in the last step; the leeway of each
    # condition without its margin.
    margins: Floats = array(lambda s: relations(s) + s.sections, -1.0)
    step_errors: Floats = array("size")
    own_leeway: Floats = array("conditions")
    # The fraction of the last step at which each condition was armed, or 0.
    armed_at: Floats = array("conditions")
    # Sizes, least and largest values before the last step.
    sizes_before: Floats = array("size")
    low_before: Floats = array("size")
    high_before: Floats = array("size")

    # All event functions at one fraction of the step, see `store_values`.
    inner_values: Floats = array(lambda s: s.surfaces + s.conditions)
    event: float  # the number, from 1, of the located condition; or 0
    switched: float  # the number, from 1, of the surface of the located switch; or 0
    # 1 where the expression of a surface or condition may have a pole; 0 for laws.
    poles: Floats = array(lambda s: s.surfaces + s.conditions)
    # 1 if the surface or the condition is discontinuous at the located time
    discontinuous: float
    # 1 if another condition becomes true by a jump where one has been located
    jumps_beside: float

    # The truth of conditions, see `conditions.Truth`. A condition holds where its
    # orientation times its function is <= 0. Orientation 0: not armed, the value has
    # not been below -leeway since the condition was last true.
    truth: Floats = array(lambda s: 2 * s.conditions)
    orientation: Floats = part("truth", "conditions")
    leeway: Floats = after("orientation", "conditions")
    equation: Floats = array("conditions")  # 1 for an equation
    kinked: Floats = array("conditions")  # 1 if its expression has switches, as `abs`
    zero: Floats = array("conditions")  # sizes up to which a value is 0
    # At an instant, see `truth`: the values; their rates, 0 if below rounding; the
    # sizes of their terms; then their slopes by the motion and t.
    worth: Floats = array("conditions")
    trend: Floats = array("conditions")
    condition_slopes: Floats = array(lambda s: s.conditions * (2 + s.dynamic.stop))
    # Values at two states just before or after, see `truth.evaluate_beside`.
    beside: Floats = array(lambda s: 2 * s.conditions)
    # Change of the value of an inequality by jumps just after the start of the run, if
    # it is true then; otherwise, and after the first step, 0.
    ahead: Floats = array("conditions")
    met_first: float  # the index of the first condition satisfied at the instant, or -1
    calm: float  # 1 if no condition changes unless the state or the modes jump
    # Flags of conditions. `marked`: has become true; `stays`: is true and its value
    # stays at 0; `was_clear`: had a value off 0 before a change, which is in `former`.
    marked: Floats = array("conditions")
    stays: Floats = array("conditions")
    # 1 while a condition that was located waits for a more precise one (`truth.wait`).
    imprecise: Floats = array("conditions")
    any_stays: float  # 1 if any value stays at 0
    was_clear: Floats = array("conditions")
    former: Floats = array("conditions")
    # Fraction of the step at which the search has continued past a change of the
    # condition, or -1, up to the start of the next search; its orientation and its
    # leeway before the change.
    passed_at: Floats = array("conditions")
    passed_side: Floats = array("conditions")
    passed_leeway: Floats = array("conditions")
    # The fraction of the last step at which each condition is 0 at a switch in its
    # expression, see `search.zero_at`; or -inf.
    zero_at: Floats = array("conditions", -inf)

    # For each section: the last sign of its relation, 0 before the motion has left the
    # section; and the largest value of the relation that counts as on the section, see
    # `crossings.band`.
    sides: Floats = array("sections")
    bands: Floats = array("sections")

    @cached_property
    def truth_words(self) -> memoryview:
        """View of the bytes of the truth of all conditions."""
        words = self.numbers[self.place("truth") : self.place_after("truth")]
        return words.cast("B") if self.conditions else memoryview(bytearray())


def events(s: SearchTable) -> int:
    """Return the number of event functions, of surfaces, laws and conditions.

    Rows 0 ... events - 1 of the table belong to the event functions.
    """
    return s.surfaces + s.conditions


def relations(s: SearchTable) -> int:
    """Return the index of the first row that is the relation of a section."""
    return s.surfaces + s.conditions + s.signals


def rows(s: SearchTable) -> int:
    """Return the number R of rows of the table.

    The rows are the event functions, the signals, the relations of sections, and the
    smallest singular value.
    """
    return relations(s) + s.sections + 1


def facing(s: SearchTable, j: int) -> float:
    """Return the factor, 1 or -1, of the relation of section j in the table.

    The row is positive on the side from which the motion comes; the factor is 1 until
    the motion has left the section.
    """
    return -1.0 if s.sides[j] < 0.0 else 1.0


def same_time(s: SearchTable, t: float) -> float:
    """Return the largest difference from t of a time at the same instant."""
    return SAME_INSTANT * max(abs(t), abs(s.row_start))


def follows(s: SearchTable, k: int) -> bool:
    """Whether condition k is true, and located when it becomes false."""
    if s.equation[k] > 0.0:
        return not s.orientation[k] < STAYS
    return not s.orientation[k] <= 0.0


def least_allowed(kind: Static, s: SearchTable, p: Parameters, k: int) -> float:
    """Return the value below which row k, of the kind EVENT or CROSSING, counts as < 0.

    For a surface or a law it is minus the slack, for a section minus the band, for a
    condition 0.
    """
    if kind == CROSSING:
        return -float(s.bands[k - relations(s)])
    if SWITCHES and k < s.surfaces:
        return -max(float(p.slack[k]), float(p.band[k]))
    return 0.0


def rows_at(kind: Static, s: SearchTable, p: Parameters, x: float) -> None:
    """Store the rows of a kind at the fraction x of the last step in s.values (R,).

    Signals are stored for every kind but RANK.
    """
    z, now = s.point, s.values
    if kind == RANK:
        now[rows(s) - 1] = sigma_at(s, p, x)
        return
    t = state_at(s, p, x, z)
    if LOCALIZED:
        signals(t, z, p, now[events(s) :])
    if kind == CROSSING:
        related = now[relations(s) :]
        sections(t, z, p, related)
        for j in range(s.sections):
            related[j] = facing(s, j) * related[j]
            if not abs(related[j]) <= inf:  # no value, no crossing
                related[j] = inf
    if SWITCHES and kind == EVENT:
        event_functions(t, z, p, now)
    if UNTIL and kind == EVENT:
        located(t, z, p, now[s.surfaces :])
        orient_conditions(s, x, now[s.surfaces :])


def state_at(s: SearchTable, p: Parameters, x: float, out: Floats) -> float:
    """Write the state (size,) at the fraction x of the last step; return its time.

    At the end of the step it is the state with which the next step begins: a value that
    is 0 there has one sign in both steps. The dense output differs by rounding.
    """
    if x == 1.0:
        out[: s.size] = s.y[: s.size]
        return float(s.step_end)
    interpolate(s, p, x, out)
    return float(s.step_t + x * s.step_h)


def orient_conditions(s: SearchTable, x: float, own: Floats) -> None:
    """Replace the values of conditions by their rows, which fall below 0 at an event.

    A condition that is not armed has the row 1. A condition without a value (the root
    of a negative number) is false: its row is -inf if it is true so far, else inf.

    own : ndarray, shape (C,), the values of the C conditions at the fraction x of the
        last step; on return their rows: the value times `orientation`, plus `leeway`.
        For an equation that stays at 0 the row is its rounding less its magnitude.
    """
    for k in range(s.conditions):
        if x <= NEXT and own[k] < 0.0:  # within the rounding of the interpolant
            own[k] += s.ahead[k]
        if s.equation[k] > 0.0 and s.orientation[k] == STAYS:
            own[k] = max(s.leeway[k], MANY * s.zero[k]) - abs(own[k])
        else:
            own[k] = own[k] * s.orientation[k] + s.leeway[k]
        if s.orientation[k] == 0.0:
            own[k] = 1.0
        if not abs(own[k]) <= inf:
            own[k] = -inf if follows(s, k) else inf
        if x < s.armed_at[k]:  # the motion has not left the last zero yet
            own[k] = max(own[k], TINY)
        if own[k] == 0.0:  # true; so a true condition has not ended
            own[k] = TINY if follows(s, k) else -TINY


def sample(
    kind: Static, s: SearchTable, p: Parameters, x: float, beside: float, out: Floats
) -> None:
    """Compute the rows of a kind, and their slopes, at the fraction x of the last step.

    The slopes are the differences of values at x + beside and x, divided by `beside`.

    kind : see `rows_at`.
    beside : the difference of the two fractions.
    out : (2 R,), the values of the R rows of the table, then the slopes.
    """
    count = rows(s)
    now = s.values
    rows_at(kind, s, p, x + beside)
    out[count : 2 * count] = now[:count]
    rows_at(kind, s, p, x)
    out[:count] = now[:count]
    out[count : 2 * count] = (out[count : 2 * count] - now[:count]) / beside


def value_at(kind: Static, s: SearchTable, p: Parameters, k: int, x: float) -> float:
    """Return the value of row k at the fraction x of the last step.

    For the kind SIGNAL it is the distance of the signal.
    """
    rows_at(kind, s, p, x)
    if kind == SIGNAL:
        return distance_from_activity(s, k, s.values)
    return float(s.values[k])


def distance(kind: float, power: float, u: float) -> float:
    """Return the distance of a signal u from the activity of its localized term.

    The distance is -log of the term, relative to 1, where the signal is u; 0 for the
    kind FALLING.

    kind, power : see `program.localized.Indicator`.
    """
    if kind == FALLING:
        return 0.0
    if kind == LARGEST:
        return -power * u
    if kind == NEAR_ZERO:
        return 2.0 * power * abs(u)
    if kind == SMALL:
        return power * log(max(abs(u), TINY))
    return -power * log(max(abs(u), TINY))


def distance_from_activity(s: SearchTable, k: int, at_point: Floats) -> float:
    """Return the distance of signal k from the activity of its localized term.

    at_point : (R,), the values of all rows of the table at one point of the step.
    """
    return distance(s.kinds[k - events(s)], s.powers[k - events(s)], at_point[k])


def reuse_ends(s: SearchTable, first: int, count: int, h: float) -> None:
    """Set `count` rows at the start of a step h to those at the end of the step before.

    The slopes are converted to the length h.

    first : the index of the first row.
    """
    part = h / s.end_step
    for k in range(first, first + count):
        s.starts[k] = s.last_ends[k]
        s.starts[rows(s) + k] = part * s.last_ends[rows(s) + k]


def store_ends(
    s: SearchTable, first: int, count: int, t: float, h: float, ends: Floats
) -> None:
    """Store `count` rows of the table at the end of a step h, at the time t.

    The rows and their slopes are read from `ends` (2 R,).

    first : the index of the first row.
    """
    s.end_time, s.end_step = t, h
    for k in range(first, first + count):
        s.last_ends[k] = ends[k]
        s.last_ends[rows(s) + k] = ends[rows(s) + k]


# --- knowledge of a row on a stretch: hull, extrema, errors


def width(s: SearchTable) -> float:
    """Return the length of the stretch, as a fraction of the step."""
    return float(s.places[2] - s.places[0])


def off(of_slope: Static, s: SearchTable, k: int) -> float:
    """Return |row k - its cubic| at the middle point of the stretch.

    The cubic interpolates values and slopes at both ends.

    of_slope : 0, or 1 for the difference of the slopes, times the length of the stretch
        and TURNED.
    """
    A = width(s) * s.starts[rows(s) + k]
    B = width(s) * s.ends[rows(s) + k]
    change = s.ends[k] - s.starts[k]
    P = 3.0 * change - 2.0 * A - B
    Q = A + B - 2.0 * change
    if of_slope == 1:
        slope = A + BETWEEN * (2.0 * P + 3.0 * BETWEEN * Q)
        return float(TURNED * abs(slope - width(s) * s.middles[rows(s) + k]))
    value = s.starts[k] + BETWEEN * (A + BETWEEN * (P + BETWEEN * Q))
    return float(abs(value - s.middles[k]))


def sampled(s: SearchTable, k: int, point: int) -> float:
    """Return row k at the start (0), the middle point (1) or the end (2)."""
    return float(s.points[2 * point * rows(s) + k])


def variation(s: SearchTable, k: int) -> float:
    """Return the largest change of row k from the middle of a stretch to an end."""
    m = s.middles[k]
    return float(max(abs(m - s.starts[k]), abs(m - s.ends[k])))


def lowest(way: float, s: SearchTable, k: int, half: int) -> float:
    """Return a lower bound of `way` times row k on its cubic in half of the stretch.

    With the values a, b at the ends of the half, and A, B the slopes there times its
    length, the cubic lies within the hull of a, a + A/3, b - B/3, b. As slopes are
    differences, an extremum that seems to be at an end may be just inside.

    way : 1 or -1.
    half : 0 before the middle point, 1 after it.
    """
    left, count = s.points[2 * half * rows(s) :], rows(s)
    a = way * left[k]
    b = way * left[2 * count + k]
    part = way * (THIRD * (s.places[half + 1] - s.places[half]))
    c = a + part * left[count + k]
    d = b - part * left[3 * count + k]
    low = min(a, b, c, d)
    error = 2.0 * BESIDE * (max(a, b, c, d) - low)
    if min(abs(c - a), abs(d - b)) <= error:
        low -= 3.0 * BESIDE * error
    return float(low)


def error_between(s: SearchTable, k: int) -> float:
    """Return the largest known |row k - its cubic| on the stretch, see `off`."""
    return max(off(0, s, k), off(1, s, k))


def row_is_known(kind: Static, s: SearchTable, p: Parameters, k: int) -> bool:
    """Whether values and slopes at the ends of the stretch determine row k inside.

    kind : EVENT or CROSSING.
    """
    a, m, b = s.starts[k], s.middles[k], s.ends[k]
    least = least_allowed(kind, s, p, k)
    # Errors within the slack cannot be reduced, nor can slopes within its rounding.
    enough = max(KNOWN * variation(s, k), CLEAR * min(a, m, b), -least)
    rounding = 0.0
    nothing = -1.0
    if SWITCHES and kind == EVENT and p.surfaces <= k < s.surfaces:
        # The values of a law may be rounding, and the slopes with them.
        rounding = p.law_rounding[k - p.surfaces]
        nothing = -least
    if SWITCHES and kind == EVENT and k < p.surfaces and p.slides[k] == LEVEL:
        nothing = -least  # at its level to rounding
    if UNTIL and kind == EVENT and k >= s.surfaces:
        # The values of a condition that stays at 0 are rounding, within its leeway.
        rounding = s.leeway[k - s.surfaces]
        nothing = 2.0 * rounding
    if kind == CROSSING or (UNTIL and k >= s.surfaces):
        if a == inf and m == inf and b == inf:
            return True
        if max(abs(a), abs(m), abs(b)) == inf:
            return False
    unknown = off(0, s, k) > max(enough, rounding)
    if off(1, s, k) > max(enough, TURNED / BESIDE * rounding):
        unknown = True
    return not unknown or max(abs(a), abs(m), abs(b)) <= nothing


def error_of_state(s: SearchTable, slopes: Floats, count: int, coarse: float) -> float:
    """Return the error of a function caused by the error of the state; 0 if not finite.

    slopes : (count,), the derivatives by the first components of the state.
    coarse : the error of times, or 0. Positions have this error times their largest
        velocities.
    """
    found = 0.0
    for i in range(count):
        error = error_of_component(s, i)
        if i < s.n:
            error = max(error, coarse * s.sizes[s.n + i])
        found += abs(slopes[i]) * error
    return found if found < OVERFLOW else 0.0


def error_of_component(s: SearchTable, i: int) -> float:
    """Return the error of component i of the state, by its tolerance and its range."""
    found = max(ERRED * s.tolerances[i], PLACES * (s.high[i] - s.low[i]))
    return max(float(found), 0.0)


def margin(s: SearchTable, k: int) -> float:
    """Return the margin of row k, or 0 if its value does not leave 0."""
    return max(float(s.margins[k]), 0.0)


# --- location of minima and zeros


def minimum_in_half(
    kind: Static, s: SearchTable, p: Parameters, k: int, half: int, least: float
) -> float:
    """Return the fraction of a minimum of row k in half of the stretch.

    The value at the minimum has to be below `least`. If the hull of the row's cubic
    shows that the row is nowhere below both `least` and its values at the ends, the end
    of the half is returned.

    half : 0 before the middle point, 1 after it.
    kind : the kind of the row, as in the module docstring.
    """
    most = min(sampled(s, k, half), sampled(s, k, half + 1), least)
    if lowest(1.0, s, k, half) < most:
        return least_of(kind, NARROW, s, p, k, s.places[half], s.places[half + 1])
    return float(s.places[half + 1])


def least_of(
    kind: Static,
    rounds: Static,
    s: SearchTable,
    p: Parameters,
    k: int,
    low: float,
    high: float,
) -> float:
    """Return the fraction in [low, high] at which row k is least, by golden section.

    rounds : the number of divisions of the interval.
    kind : the kind of the row.
    """
    left = high - GOLDEN * (high - low)
    right = low + GOLDEN * (high - low)
    at_left = value_at(kind, s, p, k, left)
    at_right = value_at(kind, s, p, k, right)
    for _ in range(rounds):
        if at_left < at_right:
            high = right
            right = left
            at_right = at_left
            left = high - GOLDEN * (high - low)
            at_left = value_at(kind, s, p, k, left)
        else:
            low = left
            left = right
            at_left = at_right
            right = low + GOLDEN * (high - low)
            at_right = value_at(kind, s, p, k, right)
    return 0.5 * (low + high)


def end_of(
    kind: Static,
    s: SearchTable,
    p: Parameters,
    k: int,
    least: float,
    low: float,
    high: float,
) -> float:
    """Return the first point in (low, high] at which row k is below `least`.

    The point is located by the ITP method: the secant, moved toward the middle, with no
    more evaluations than bisection needs, but for one. The iteration ends at two
    neighbouring numbers, and the larger one is returned.

    Source: I. F. D. Oliveira and R. H. C. Takahashi, An enhancement of the bisection
    method average performance preserving minmax optimality, ACM Trans. Math. Softw. 47
    (2020).

    kind : the kind of the row.
    """
    at_low = value_at(kind, s, p, k, low) - least
    at_high = value_at(kind, s, p, k, high) - least
    curved = ITP / (high - low)
    most = 2.0 * (high - low)  # half the bracket, by the remaining bisections
    middle = 0.5 * (low + high)
    while low < middle and middle < high:
        most *= 0.5
        x = middle
        if at_low - at_high > 0.0:
            x = low + (high - low) * (at_low / (at_low - at_high))
        width = high - low
        toward = 1.0 if x < middle else -1.0
        moved = min(curved * width * width, abs(middle - x))
        x += toward * moved
        free = max(0.0, most - 0.5 * width)
        if not abs(x - middle) <= free:
            x = middle - toward * free
        if not (low < x and x < high):
            x = middle
        value = value_at(kind, s, p, k, x) - least
        if value >= 0.0:
            low = x
            at_low = value
        else:
            high = x
            at_high = value
        middle = 0.5 * (low + high)
    return high


def jumps(
    kind: Static, s: SearchTable, p: Parameters, k: int, root: float, rounding: float
) -> bool:
    """Whether row k is discontinuous at its zero, at the fraction `root` of the step.

    root : the first number at which the row is below 0.
    rounding : the largest change of a continuous row between two neighbouring
        fractions.
    kind : the kind of the row.
    """
    last = value_at(kind, s, p, k, from_bits(bits(root) - 1))
    first = value_at(kind, s, p, k, root)
    change = last - first
    if last < 0.0 or change <= rounding:
        return False
    before = value_at(kind, s, p, k, max(0.0, root - AROUND))
    after = value_at(kind, s, p, k, min(1.0, root + AROUND))
    return not change < JUMP * (abs(before - last) + abs(first - after))
