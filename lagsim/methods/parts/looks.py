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

from lagsim.methods.parts.interface import derivative, interpolate, signals
from lagsim.methods.parts.state import (
    CUT,
    EVALUATIONS,
    FRESH,
    HEADER,
    LOOKS_AT,
    MOST_STEP,
    REJECTIONS,
    SIGNALS,
    SIZE,
    STEP_H,
    STEP_T,
    STEPS,
    SUSPECT,
    N,
    T,
)
from lagsim.native.kernels.words import at

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


def looks_size(size: int, count: int) -> int:
    """Give how much memory looks for so many signals need."""
    return 9 * count + 6 * size if count else 0


# The memory at LOOKS_AT: kinds, powers, highest (K each), first, middle, last (2 K
# each: values, then rates), then y and y' of a look (2 size), room (4 size).
def suspect(
    s: Floats,
    p: Floats,
    h: float,
    old: Floats,
    old_rates: Floats,
    new: Floats,
    new_rates: Floats,
) -> None:
    """Set SUSPECT where a signal may come close to waking within a step from T.

    From y and y' (size,) at both ends, between which both are interpolated.
    """
    size = int(s[SIZE])
    n = int(s[N])
    count = int(s[SIGNALS])
    own = at(s, int(s[LOOKS_AT]))
    z = at(own, 9 * count)
    rates = at(z, size)
    for i in range(size):
        z[i] = old[i]
        rates[i] = old_rates[i]
    signals(s[T], z, p, at(own, 3 * count))
    for i in range(size):
        z[i] = new[i]
        rates[i] = new_rates[i]
    signals(s[T] + h, z, p, at(own, 7 * count))
    for i in range(size):
        change = new[i] - old[i]
        A = h * old_rates[i]
        B = h * new_rates[i]
        P = 3.0 * change - 2.0 * A - B
        Q = A + B - 2.0 * change
        z[i] = old[i] + BETWEEN * (A + BETWEEN * (P + BETWEEN * Q))
        rates[i] = (A + BETWEEN * (2.0 * P + 3.0 * BETWEEN * Q)) / h
    for i in range(n):
        # Positions with their second derivatives too: what the cubic lacks.
        change = new[i] - old[i]
        P = 3.0 * change - h * (2.0 * old_rates[i] + new_rates[i])
        Q = h * (old_rates[i] + new_rates[i]) - 2.0 * change
        a = 0.5 * h * h * old_rates[n + i] - P
        b = 0.5 * h * h * new_rates[n + i] - P - 3.0 * Q
        x = BETWEEN
        y = 1.0 - BETWEEN
        z[i] += x * x * y * y * (y * a + x * b)
    signals(s[T] + BETWEEN * h, z, p, at(own, 5 * count))
    s[SUSPECT] = 0.0
    for k in range(count):
        if stirs(k, count, h, own):
            s[SUSPECT] = 1.0


def stirs(k: int, count: int, h: float, own: Floats) -> bool:
    """Tell whether signal k may come closer to waking inside a step than at its ends.

    Or is not known from its ends.
    """
    kind = own[k]
    power = own[count + k]
    a = own[3 * count + k]
    m = own[5 * count + k]
    b = own[7 * count + k]
    first = distance(kind, power, a)
    middle = distance(kind, power, m)
    last = distance(kind, power, b)
    if not known(k, count, h, own):
        return True
    left = closest(k, 3, 5, count, BETWEEN * h, own)
    right = closest(k, 5, 7, count, (1.0 - BETWEEN) * h, own)
    dip = min(first, max(middle, right, last)) - left
    dip = max(dip, min(max(first, left), max(right, last)) - middle)
    dip = max(dip, min(max(first, left, middle), last) - right)
    return dip > WAKES


def distance(kind: float, power: float, u: float) -> float:
    """Give how far a signal is from waking what it wakes, in powers of e."""
    if kind == LARGEST:
        return -power * u
    if kind == NEAR_ZERO:
        return 2.0 * power * abs(u)
    if kind == SMALL:
        return power * log(max(abs(u), TINY))
    return -power * log(max(abs(u), TINY))


def known(k: int, count: int, width: float, own: Floats) -> bool:
    """Tell whether values and rates at both ends give the value in the middle."""
    kind = own[k]
    power = own[count + k]
    a = own[3 * count + k]
    m = own[5 * count + k]
    b = own[7 * count + k]
    A = width * own[4 * count + k]
    B = width * own[8 * count + k]
    P = 3.0 * (b - a) - 2.0 * A - B
    Q = A + B - 2.0 * (b - a)
    guess = a + BETWEEN * (A + BETWEEN * (P + BETWEEN * Q))
    turned = A + BETWEEN * (2.0 * P + 3.0 * BETWEEN * Q) - width * own[6 * count + k]
    off = max(abs(guess - m), TURNED * abs(turned))
    if not off < 1e300:
        return False
    if off <= KNOWN * max(abs(m - a), abs(m - b)):
        return True
    near = m - off if m > 0.0 else m + off
    if kind == LARGEST or (kind == LARGE and m > 0.0):
        near = m + off
    return abs(distance(kind, power, near) - distance(kind, power, m)) < FLAT


def closest(
    k: int, left: int, right: int, count: int, width: float, own: Floats
) -> float:
    """Give the least distance of signal k on the cubic between two looks.

    left, right : where they lie, in numbers of signals.
    """
    kind = own[k]
    power = own[count + k]
    a = own[left * count + k]
    b = own[right * count + k]
    A = width * own[(left + 1) * count + k]
    B = width * own[(right + 1) * count + k]
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


def overlooked(s: Floats, p: Floats) -> float:
    """Give a place in the last step, as a fraction, where y' is not what it should be.

    Or 0 where there is none. What cannot be searched by MOST_LOOKS looks counts too.
    """
    count = int(s[SIGNALS])
    h = s[STEP_H]
    own = at(s, int(s[LOOKS_AT]))
    look_at_signals(s, p, 0.0, at(own, 3 * count))
    for k in range(count):
        own[2 * count + k] = distance(own[k], own[count + k], own[3 * count + k])
    low = 0.0
    width = 0.5
    looks = 0
    while low < 1.0:
        high = min(low + width, 1.0)
        look_at_signals(s, p, high, at(own, 7 * count))
        look_at_signals(s, p, low + BETWEEN * (high - low), at(own, 5 * count))
        looks += 2
        clear = True
        for k in range(count):
            clear = clear and known(k, count, (high - low) * h, own)
        if clear or high - low < FINEST:
            found = visit(s, p, low, high)
            if found > 0.0:
                return found
            for i in range(2 * count):
                own[3 * count + i] = own[7 * count + i]
            low = high
            width = 2.0 * width
        elif looks >= MOST_LOOKS:
            return max(high, PART)
        else:
            width = 0.5 * (high - low)
    return 0.0


def look_at_signals(s: Floats, p: Floats, x: float, out: Floats) -> None:
    """Give the signals and their rates (2 K,) at the fraction x of the last step."""
    z = at(s, int(s[LOOKS_AT]) + 9 * int(s[SIGNALS]))
    slopes(s, x, z)
    interpolate(s, x, z)
    signals(s[STEP_T] + x * s[STEP_H], z, p, out)


def slopes(s: Floats, x: float, z: Floats) -> None:
    """Leave the slope of the dense output in z[size:]; z : (6 size,)."""
    size = int(s[SIZE])
    rates = at(z, size)
    a = at(z, 2 * size)
    b = at(z, 3 * size)
    c = at(z, 4 * size)
    interpolate(s, x - 2.0 * BESIDE, a)
    interpolate(s, x + 2.0 * BESIDE, b)
    interpolate(s, x - BESIDE, c)
    interpolate(s, x + BESIDE, z)
    unit = 1.0 / (12.0 * BESIDE * s[STEP_H])
    for i in range(size):
        rates[i] = unit * (8.0 * (z[i] - c[i]) - (b[i] - a[i]))


def visit(s: Floats, p: Floats, low: float, high: float) -> float:
    """Look where a signal comes close between two looks; give what `overlooked` does.

    Keeps how far each has been since.
    """
    count = int(s[SIGNALS])
    own = at(s, int(s[LOOKS_AT]))
    highest = at(own, 2 * count)
    width = (high - low) * s[STEP_H]
    found = 0.0
    for k in range(count):
        least = min(
            closest(k, 3, 5, count, BETWEEN * width, own),
            closest(k, 5, 7, count, (1.0 - BETWEEN) * width, own),
        )
        end = distance(own[k], own[count + k], own[7 * count + k])
        if highest[k] - least > WAKES and found == 0.0:
            found = visited(s, p, k, low, high)
            if end - least > FLAT:
                highest[k] = least
        highest[k] = max(highest[k], end)
    return found


def visited(s: Floats, p: Floats, k: int, low: float, high: float) -> float:
    """Look at the closest approach of signal k in [low, high], and around it."""
    x = approach(s, p, k, low, high)
    if high - x < AT_END * (high - low):
        return 0.0  # it comes closer still, or the next step begins there
    if differs(s, p, x):
        return x
    least = apart(s, p, k, x)
    beside = 2.0**-50
    left = True
    right = True
    for _ in range(DOUBLINGS):
        beside *= 2.0
        if left:
            left = x - beside > 0.0
            away = apart(s, p, k, x - beside) - least if left else 0.0
            left = left and away < FOOT
            if left and away > SHOULDER and differs(s, p, x - beside):
                return x - beside
        if right:
            right = x + beside < 1.0
            away = apart(s, p, k, x + beside) - least if right else 0.0
            right = right and away < FOOT
            if right and away > SHOULDER and differs(s, p, x + beside):
                return x
    return 0.0


def approach(s: Floats, p: Floats, k: int, low: float, high: float) -> float:
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


def apart(s: Floats, p: Floats, k: int, x: float) -> float:
    """Give the distance of one signal at the fraction x of the last step."""
    count = int(s[SIGNALS])
    own = at(s, int(s[LOOKS_AT]))
    z = at(own, 9 * count)
    interpolate(s, x, z)
    signals(s[STEP_T] + x * s[STEP_H], z, p, at(own, 5 * count))
    return distance(own[k], own[count + k], own[5 * count + k])


def differs(s: Floats, p: Floats, x: float) -> bool:
    """Tell whether y' is not the slope of the dense output, for all that is allowed."""
    size = int(s[SIZE])
    z = at(s, int(s[LOOKS_AT]) + 9 * int(s[SIGNALS]))
    rates = at(z, size)
    right = at(z, 2 * size)
    tolerances = at(s, HEADER + 2 * size)
    slopes(s, x, z)
    interpolate(s, x, z)
    derivative(s[STEP_T] + x * s[STEP_H], z, p, right)
    s[EVALUATIONS] += 1.0
    for i in range(int(s[N]), size):
        off = abs(right[i] - rates[i]) * s[STEP_H]
        if tolerances[i] > 0.0 and not off <= PASSED * tolerances[i]:
            return True
    return False


def take_back(s: Floats, x: float) -> None:
    """Take the last step back; the next is half as long as to its fraction x."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    z = at(s, int(s[LOOKS_AT]) + 9 * int(s[SIGNALS]))
    interpolate(s, 0.0, z)
    for i in range(size):
        y[i] = z[i]
    s[T] = s[STEP_T]
    s[MOST_STEP] = 0.5 * x * s[STEP_H]
    s[STEPS] -= 1.0
    s[REJECTIONS] += 1.0
    s[CUT] = 0.0
    s[FRESH] = 1.0
