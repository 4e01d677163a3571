"""Looks into a step for functions that wake within it.

A step whose ends and stages see nothing may have leapt over a hill, a wall or a gate
that is flat to rounding where they lie. What wakes such a function is its argument (a
signal): smooth, and resolved by the step. From its values and rates at both ends and
between them follows whether it comes closer to waking inside than at either end. Only
then the dense output is searched for the closest approach, and y' from the equations is
compared there, and on its shoulders, with the slope of the dense output. Where they
differ by more than the tolerance allows, the step is taken back and made half as long
as the way to that place.

A signal tells how far a function is from waking, in powers of e: its `distance`.
"""

from __future__ import annotations

from math import log, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import interpolate, signals
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import State
from lagsim.methods.parts.strays import differs, hardly_varies, is_rounding

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# What a signal does: the function goes with e^u, steps where u vanishes, goes with
# 1/|u|^power or with |u|^power.
LARGEST = 0.0
NEAR_ZERO = 1.0
SMALL = 2.0
LARGE = 3.0

# A function that becomes e^1.4, four times, larger inside a step than at either end is
# looked at; less than that the stages of a step see.
WAKES = 1.4
# Between both ends a step is looked at here, not in the middle: what repeats itself may
# do so twice.
BETWEEN = 0.6180339887498949
# A signal there is known from the ends up to this part of its range; its rate
# counts as the second says.
KNOWN = 0.1
TURNED = 0.25
# On the shoulders of a closest approach, where the distance has grown by so much: at
# the top of a hill itself there is no force.
SHOULDER = 0.3
FOOT = 8.0
# So many doublings lead from there to the other end of any step.
DOUBLINGS = 60
# A closest approach is found well enough once the distance changes by less than this.
FLAT = 0.1
GOLDEN = 0.6180339887498949
SEARCH = 80
# Looks at the signals of one step, at most; what needs more has to be shorter.
MOST_LOOKS = 400
# Nothing is divided further, and a step not shortened to less than the second.
FINEST = 2.0**-12
PART = 0.25
# y' from the equations and the slope of the dense output differ by up to so many
# tolerances where nothing has been missed: dense output is of lower order.
PASSED = 1e4
# Slopes are differences over this part of a step, of fourth order: exact to rounding
# for the polynomials that they are taken of.
BESIDE = 2.0**-8
TINY = 1e-300
AT_END = 1e-9


def suspect(
    s: State,
    p: Parameters,
    h: float,
    old: Floats,
    old_rates: Floats,
    new: Floats,
    new_rates: Floats,
) -> None:
    """Set SUSPECT where a signal may come close to waking within a step from T.

    From y and y' (size,) at both ends, between which both are interpolated.
    """
    size = s.size
    n = s.n
    count = s.signals
    z = s.look
    rates = s.look_rates
    for i in range(size):
        z[i] = old[i]
        rates[i] = old_rates[i]
    signals(s.t, z, p, s.signals_first)
    for i in range(size):
        z[i] = new[i]
        rates[i] = new_rates[i]
    signals(s.t + h, z, p, s.signals_last)
    x = BETWEEN
    for i in range(size):
        first = old[i]
        change = new[i] - first
        A = h * old_rates[i]
        B = h * new_rates[i]
        P = 3.0 * change - 2.0 * A - B
        Q = A + B - 2.0 * change
        z[i] = first + x * (A + x * (P + x * Q))
        if i < n:
            # Positions with their second derivatives too: what the cubic lacks.
            a = 0.5 * h * h * old_rates[n + i] - P
            b = 0.5 * h * h * new_rates[n + i] - P - 3.0 * Q
            z[i] += x * x * (1.0 - x) * (1.0 - x) * ((1.0 - x) * a + x * b)
        rates[i] = (A + x * (2.0 * P + 3.0 * x * Q)) / h
    signals(s.t + BETWEEN * h, z, p, s.signals_middle)
    s.suspect = 0.0
    for k in range(count):
        if stirs(s, k, h):
            s.suspect = 1.0


def stirs(s: State, k: int, h: float) -> bool:
    """Tell whether signal k may come closer to waking inside a step than at its ends.

    Or is not known from its ends.
    """
    if not known(s, k, h):
        return True
    if goes_one_way(s, k, h):
        return False
    first = away(s, k, s.signals_first)
    middle = away(s, k, s.signals_middle)
    last = away(s, k, s.signals_last)
    left = closest(s, k, s.signals_first, s.signals_middle, BETWEEN * h)
    right = closest(s, k, s.signals_middle, s.signals_last, (1.0 - BETWEEN) * h)
    dip = min(first, max(middle, right, last)) - left
    dip = max(dip, min(max(first, left), max(right, last)) - middle)
    dip = max(dip, min(max(first, left, middle), last) - right)
    return dip > WAKES


def goes_one_way(s: State, k: int, h: float) -> bool:
    """Tell whether signal k only rises or only falls in a step, and is never 0.

    Then it is closest to waking at an end. From its polygons: a cubic between two looks
    turns no oftener than a, a + A/3, b - B/3, b do.
    """
    rate = s.signals + k
    a = float(s.signals_first[k])
    m = float(s.signals_middle[k])
    b = float(s.signals_last[k])
    left = BETWEEN * h / 3.0
    right = (1.0 - BETWEEN) * h / 3.0
    A = s.signals_first[rate]
    M = s.signals_middle[rate]
    B = s.signals_last[rate]
    way = 1.0 if b > a else -1.0
    least = float(min(way * A, way * M, way * B))
    least = min(least, float(way * (m - a - left * (A + M))))
    least = min(least, float(way * (b - m - right * (M + B))))
    return least >= 0.0 and a * b > 0.0


def distance(kind: float, power: float, u: float) -> float:
    """Give how far a signal is from waking what it wakes, in powers of e."""
    if kind == LARGEST:
        return -power * u
    if kind == NEAR_ZERO:
        return 2.0 * power * abs(u)
    if kind == SMALL:
        return power * log(max(abs(u), TINY))
    return -power * log(max(abs(u), TINY))


def away(s: State, k: int, at_look: Floats) -> float:
    """Give that of signal k at a look."""
    return distance(s.kinds[k], s.powers[k], at_look[k])


def known(s: State, k: int, width: float) -> bool:
    """Tell whether values and rates at both ends give the value in the middle."""
    kind = s.kinds[k]
    power = s.powers[k]
    first = s.signals_first
    middle = s.signals_middle
    last = s.signals_last
    a = first[k]
    m = middle[k]
    b = last[k]
    rate = s.signals + k
    A = width * first[rate]
    B = width * last[rate]
    P = 3.0 * (b - a) - 2.0 * A - B
    Q = A + B - 2.0 * (b - a)
    guess = a + BETWEEN * (A + BETWEEN * (P + BETWEEN * Q))
    turned = A + BETWEEN * (2.0 * P + 3.0 * BETWEEN * Q) - width * middle[rate]
    off = max(abs(guess - m), TURNED * abs(turned))
    if not off < 1e300:
        return False
    if off <= KNOWN * max(abs(m - a), abs(m - b)):
        return True
    near = m - off if m > 0.0 else m + off
    if kind == LARGEST or (kind == LARGE and m > 0.0):
        near = m + off
    return abs(distance(kind, power, near) - distance(kind, power, m)) < FLAT


def closest(s: State, k: int, left: Floats, right: Floats, width: float) -> float:
    """Give the least distance of signal k on the cubic between two looks."""
    kind = s.kinds[k]
    power = s.powers[k]
    a = left[k]
    b = right[k]
    A = width * left[s.signals + k]
    B = width * right[s.signals + k]
    least = min(distance(kind, power, a), distance(kind, power, b))
    # c(x) = a + A x + P x^2 + Q x^3
    P = 3.0 * (b - a) - 2.0 * A - B
    Q = A + B - 2.0 * (b - a)
    under = P * P - 3.0 * A * Q
    crosses = a * b < 0.0
    if under >= 0.0:
        # Both roots of c', without cancellation.
        q = -(P + (sqrt(under) if P >= 0.0 else -sqrt(under)))
        for root in range(2):
            top = A if root == 0 else q
            bottom = q if root == 0 else 3.0 * Q
            x = top / bottom if abs(bottom) > TINY else -1.0
            if x > 0.0 and x < 1.0:
                c = a + x * (A + x * (P + x * Q))
                least = min(least, distance(kind, power, c))
                crosses = crosses or a * c < 0.0
    if crosses and kind != LARGEST and kind != LARGE:
        least = min(least, distance(kind, power, 0.0))
    return least


def overlooked(s: State, p: Parameters) -> float:
    """Give a place in the last step, as a fraction, where y' is not what it should be.

    Or 0 where there is none. What cannot be searched by MOST_LOOKS looks counts too.
    """
    count = s.signals
    h = s.step_h
    first = s.signals_first
    last = s.signals_last
    farthest = s.farthest
    look_at_signals(s, p, 0.0, first)
    for k in range(count):
        farthest[k] = away(s, k, first)
    low = 0.0
    width = 0.5
    looks = 0
    while low < 1.0:
        high = min(low + width, 1.0)
        look_at_signals(s, p, high, last)
        look_at_signals(s, p, low + BETWEEN * (high - low), s.signals_middle)
        looks += 2
        clear = True
        for k in range(count):
            if clear and not known(s, k, (high - low) * h):
                clear = hardly_varies(s, p, k, high)
        if clear or high - low < FINEST:
            found = visit(s, p, low, high)
            if found > 0.0:
                return found
            for i in range(2 * count):
                first[i] = last[i]
            low = high
            width = 2.0 * width
        elif looks >= MOST_LOOKS:
            return max(high, PART)
        else:
            width = 0.5 * (high - low)
    return 0.0


def look_at_signals(s: State, p: Parameters, x: float, out: Floats) -> None:
    """Give the signals and their rates (2 K,) at the fraction x of the last step."""
    z = s.look
    slopes(s, x)
    interpolate(s, x, z)
    signals(s.step_t + x * s.step_h, z, p, out)


def slopes(s: State, x: float) -> None:
    """Leave the slope of the dense output as that of the look."""
    size = s.size
    z = s.look
    rates = s.look_rates
    a = s.far_before
    b = s.far_after
    c = s.near_before
    interpolate(s, x - 2.0 * BESIDE, a)
    interpolate(s, x + 2.0 * BESIDE, b)
    interpolate(s, x - BESIDE, c)
    interpolate(s, x + BESIDE, z)
    unit = 1.0 / (12.0 * BESIDE * s.step_h)
    for i in range(size):
        rates[i] = unit * (8.0 * (z[i] - c[i]) - (b[i] - a[i]))


def visit(s: State, p: Parameters, low: float, high: float) -> float:
    """Look where a signal comes close between two looks; give what `overlooked` does.

    Keeps how far each has been since.
    """
    count = s.signals
    farthest = s.farthest
    middle = s.signals_middle
    width = (high - low) * s.step_h
    found = 0.0
    for k in range(count):
        least = min(
            closest(s, k, s.signals_first, middle, BETWEEN * width),
            closest(s, k, middle, s.signals_last, (1.0 - BETWEEN) * width),
        )
        end = away(s, k, s.signals_last)
        if farthest[k] - least > WAKES and found == 0.0:
            found = visited(s, p, k, low, high)
            if end - least > FLAT:
                farthest[k] = least
        farthest[k] = max(farthest[k], end)
    return found


def visited(s: State, p: Parameters, k: int, low: float, high: float) -> float:
    """Look at the closest approach of signal k in [low, high], and around it."""
    x = approach(s, p, k, low, high)
    if high - x < AT_END * (high - low):
        return 0.0  # it comes closer still, or the next step begins there
    if is_missed(s, p, x):
        return x
    least = apart(s, p, k, x)
    beside = 2.0**-50
    left = True
    right = True
    for _ in range(DOUBLINGS):
        beside *= 2.0
        if left:
            left = x - beside > 0.0
            far = apart(s, p, k, x - beside) - least if left else 0.0
            left = left and far < FOOT
            if left and far > SHOULDER and is_missed(s, p, x - beside):
                return x - beside
        if right:
            right = x + beside < 1.0
            far = apart(s, p, k, x + beside) - least if right else 0.0
            right = right and far < FOOT
            if right and far > SHOULDER and is_missed(s, p, x + beside):
                return x
    return 0.0


def approach(s: State, p: Parameters, k: int, low: float, high: float) -> float:
    """Give where signal k is closest to waking in [low, high], by golden section."""
    left = high - GOLDEN * (high - low)
    right = low + GOLDEN * (high - low)
    at_left = apart(s, p, k, left)
    at_right = apart(s, p, k, right)
    for _ in range(SEARCH):
        if at_left < at_right:
            high = right
            right = left
            at_right = at_left
            left = high - GOLDEN * (high - low)
            at_left = apart(s, p, k, left)
        else:
            low = left
            left = right
            at_left = at_right
            right = low + GOLDEN * (high - low)
            at_right = apart(s, p, k, right)
    return 0.5 * (low + high)


def apart(s: State, p: Parameters, k: int, x: float) -> float:
    """Give the distance of one signal at the fraction x of the last step."""
    interpolate(s, x, s.look)
    signals(s.step_t + x * s.step_h, s.look, p, s.signals_middle)
    return away(s, k, s.signals_middle)


def is_missed(s: State, p: Parameters, x: float) -> bool:
    """Tell whether the last step has missed something there."""
    s.evaluations += 1.0
    return differs(s, p, x, PASSED) and not is_rounding(s, p, x, PASSED)
