"""Taylor: the motion's own power series, made on the graph of the equations.

The coefficients up to order K come from recurrences, operation by operation, as
straight-line code. K follows from the tolerance (15 at the default), the step from the
last four coefficients: two alone vanish where a start is symmetric, and the error then
grows without a warning. The next step's series, which is needed anyway, tells how far
the motion is off the equations at the step's end: a step that is too long is made anew.
Where that happens to most steps the scene
is stiff. Rows between steps are the series itself, to full order. The method for tight
tolerances; its code grows with the square of K and takes longer to compile. On the
imaginary axis order 15 does not grow for step * frequency below 1.66, and beyond by
less than its truncation error, which is what bounds the step.

Sources: A. Jorba and M. Zou, Experimental Mathematics 14 (2005), sections 3.1 to 3.3;
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I, 2nd
ed., section I.8.
"""

from __future__ import annotations

import math
from math import exp, log
from typing import TYPE_CHECKING

from lagsim.methods.parts.adaptive import usable_step
from lagsim.methods.parts.controller import (
    LOCAL,
    against,
    foresee,
    look_again,
    look_at_rounding,
    record_measured,
    record_sizes,
    set_tolerances,
)
from lagsim.methods.parts.interface import series
from lagsim.methods.parts.looks import suspect
from lagsim.methods.parts.projection import project
from lagsim.methods.parts.singular import leave_loss, record_health
from lagsim.methods.parts.state import (
    AT_BOUND,
    DONE,
    END,
    EVALUATIONS,
    HEADER,
    NOT_FINITE,
    PROJECTION_FAILED,
    REJECTIONS,
    ROW_STEP,
    SIZE,
    STEP_H,
    STEP_T,
    STEP_TOO_SMALL,
    STEPS,
    H,
    N,
    T,
)
from lagsim.native.kernels.words import at, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure

NAME = "taylor"
TITLE = "Taylor series, order from the tolerance"
ORDER = 15  # at the default tolerance
DENSE_ORDER = 15
ADAPTIVE = True
IMAGINARY_LIMIT = 1.66
HANDLES = "smooth models, not large; equality constraints"

NEEDS = ("series",)

CONSTRAINED = True
SLEEPERS = True

# Terms shrink by e^2 from one to the next at the step that costs least per unit of
# time (Jorba and Zou, proposition 3.1).
LOG_SHRINK = 2.0
LEAST_ORDER = 4
MOST_ORDER = 22
# How many of the last coefficients bound the step.
GUARD = 4
# A step that is made anew is shortened by not less than the first and not more than the
# second.
# A priori bounds are met with this much room, or one step in two fails the check.
SAFETY = 0.9
# An error of up to this many tolerances is let pass: the bound is for the step before.
PASSED = 1.0
SHORTER = 0.9
# A step that is shorter than this part of the last one is asked for the reason.
SUDDEN = 0.7
# So often the first step and its tolerances are made to agree, to this part.
LOOKS = 20
SETTLED = 0.7
SHORTEST = 0.2


def order_for(rtol: float) -> int:
    """Give the order for a tolerance (Jorba and Zou, (3-5))."""
    order = math.ceil(1.0 - 0.5 * math.log(LOCAL * max(rtol, 1e-300)))
    return min(max(order, LEAST_ORDER), MOST_ORDER)


def refusal(_scene: Structure) -> str:
    """Give "": what it cannot handle shows when its code is estimated."""
    return ""


def amplification(z: complex) -> float:
    """Give the size of the sum of z^k / k! up to ORDER."""
    total = 1.0 + 0j
    for k in range(ORDER, 0, -1):
        total = 1.0 + total * z / k
    return abs(total)


def state_size(size: int) -> int:
    """Give the length of the array of state for `size` components."""
    return HEADER + 6 * size + 6 + 1 + 2 * (1 + (MOST_ORDER + 1) * size) + size


# The method's own arrays: which of the two series is the present one (1), two series
# (1 + (MOST_ORDER + 1) size each: K, then y_0 ... y_K), new (size).
def start(s: Floats, p: Floats) -> None:
    """Begin an arc: the series at its start, the first step."""
    size = int(s[SIZE])
    own = at(s, HEADER + 6 * size + 6)
    y = at(s, HEADER)
    c = at(own, 1)
    own[0] = 0.0
    series(s[T], y, p, c)
    s[EVALUATIONS] += 1.0
    s[STEP_H] = 0.0
    record_sizes(s, p)
    rates = at(c, 1 + size)
    look_at_rounding(s, p, s[T], y, rates, 1.0)
    foresee(s, p, rates)
    # Tolerances depend on the step, and on where it leads what is at rest: some looks
    # settle both well enough.
    new = at(s, buffer(size, 2.0))
    s[H] = min(float(s[ROW_STEP]), s[END] - s[T])
    for _ in range(LOOKS):
        before = s[H]
        lead(size, c, before, new)
        set_tolerances(s, p, s[T], new, rates, before)
        s[H] = min(before, chosen_step(s, c))
        if s[H] > SETTLED * before:
            break
    if CONSTRAINED:
        s[H] = leave_loss(s, p, s[H])


def lead(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give how far off (size,) the terms of a series may lead in a step."""
    order = int(c[0])
    for i in range(size):
        far = 0.0
        for back in range(order):
            far = (far + abs(c[1 + (order - back) * size + i])) * h
        out[i] = c[1 + i] + far


def chosen_step(s: Floats, c: Floats) -> float:
    """Give the step at which the terms after the last are within the tolerance.

    If each of the last GUARD terms is within its bound, and they shrink by e^2 from
    one to the next, so is the first that is left out. Not longer than the arc.
    """
    size = int(s[SIZE])
    order = int(c[0])
    tolerances = at(s, HEADER + 2 * size)
    largest = at(s, HEADER + 4 * size + 2)
    arc = s[END] - s[T]
    if arc <= 0.0:
        return 0.0
    for back in unrolled(GUARD):
        largest[back] = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            for back in unrolled(GUARD):
                term = abs(c[1 + (order - back) * size + i]) / tolerances[i]
                largest[back] = max(largest[back], term)
    logarithm = log(arc / SAFETY)
    for back in unrolled(GUARD):
        if largest[back] > 0.0:
            bound = (back + 1) * LOG_SHRINK - log(largest[back])
            logarithm = min(logarithm, bound / (order - back))
    return SAFETY * exp(logarithm)


def step(s: Floats, p: Floats) -> int:
    """Make one accepted step, or give a code other than 0."""
    trouble = STEP_TOO_SMALL
    rejected = False
    work = at(s, HEADER + 4 * int(s[SIZE]) + 2)
    health = 1.0
    while True:
        h = usable_step(s, p)
        if h == 0.0:
            return trouble
        if attempt(s, h) == 0:
            s[H] = SHORTEST * h
            trouble = NOT_FINITE
        elif CONSTRAINED and settle(s, p, h) == 0:
            s[H] = 0.25 * h
            trouble = PROJECTION_FAILED
        else:
            health = work[int(s[N]) + 1]
            error = check(s, p, h)
            if error <= PASSED:
                break
            s[H] = SHORTEST * h
            trouble = NOT_FINITE
            if error < 1e300:
                order = s[HEADER + 6 * int(s[SIZE]) + 7]
                shorter = SHORTER * (PASSED / error) ** (1.0 / (order + 1.0))
                s[H] = h * max(SHORTEST, shorter)
                trouble = STEP_TOO_SMALL
        rejected = True
        s[REJECTIONS] += 1.0
    if CONSTRAINED:
        record_health(s, health, h)
    accept(s, p, h)
    s[AT_BOUND] = max(s[AT_BOUND] + (1.0 if rejected else -1.0), 0.0)
    return DONE


def buffer(size: int, which: float) -> int:
    """Give where one of the two series lies in the state."""
    return HEADER + 6 * size + 7 + int(which) * (1 + (MOST_ORDER + 1) * size)


def sum_series(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of y_k h^k, even and odd powers apart: they can overlap."""
    order = int(c[0])
    square = h * h
    for i in range(size):
        high = c[1 + order * size + i]
        low = c[1 + (order - 1) * size + i]
        for back in range(1, (order + 1) // 2):
            k = order - 2 * back
            high = high * square + c[1 + k * size + i]
            low = low * square + c[1 + (k - 1) * size + i]
        out[i] = high * h + low
        if order % 2 == 0:
            out[i] = out[i] * h + c[1 + i]


def sum_rates(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of k y_k h^(k - 1) in the same way."""
    order = int(c[0])
    square = h * h
    for i in range(size):
        high = order * c[1 + order * size + i]
        low = (order - 1) * c[1 + (order - 1) * size + i]
        for back in range(1, order // 2):
            k = order - 2 * back
            high = high * square + k * c[1 + k * size + i]
            low = low * square + (k - 1) * c[1 + (k - 1) * size + i]
        out[i] = high * h + low
        if order % 2 == 1:
            out[i] = out[i] * h + c[1 + size + i]


def attempt(s: Floats, h: float) -> int:
    """Give the state after a step of length h; 0 where it is not finite."""
    size = int(s[SIZE])
    own = at(s, HEADER + 6 * size + 6)
    new = at(own, 1 + 2 * (1 + (MOST_ORDER + 1) * size))
    sum_series(size, at(s, buffer(size, own[0])), h, new)
    for i in range(size):
        if not abs(new[i]) < 1e300:
            return 0
    return 1


def settle(s: Floats, p: Floats, h: float) -> int:
    """Project the new state onto the constraints; give 0 where that fails.

    Leaves how independent they are there in the working memory.
    """
    size = int(s[SIZE])
    new = at(s, buffer(size, 2.0))
    work = at(s, HEADER + 4 * size + 2)
    return project(s, p, s[T] + h, h, new, work)


def check(s: Floats, p: Floats, h: float) -> float:
    """Give the error in units of the tolerance, from y' at the end of the step.

    What the series' rate differs by there from y' is (K + 1) y_(K+1) h^K and what
    follows. Leaves the series of the next step.
    """
    size = int(s[SIZE])
    which = s[HEADER + 6 * size + 6]
    c = at(s, buffer(size, which))
    following = at(s, buffer(size, 1.0 - which))
    new = at(s, buffer(size, 2.0))
    series(s[T] + h, new, p, following)
    s[EVALUATIONS] += 1.0
    set_tolerances(s, p, s[T] + h, new, at(c, 1 + size), h)
    error = misfit(s, c, at(following, 1 + size), h)
    # Perhaps it is nothing but rounding.
    doubtful = error > PASSED and error < 1e300
    if doubtful and look_again(s, p, h, new, at(c, 1 + size), 1.0) > 0:
        error = misfit(s, c, at(following, 1 + size), h)
    return error


def misfit(s: Floats, c: Floats, slope: Floats, h: float) -> float:
    """Give the error of a step of series c, from y' (size,) at its end."""
    size = int(s[SIZE])
    tolerances = at(s, HEADER + 2 * size)
    rates = at(s, HEADER + 4 * size + 2)
    sum_rates(size, c, h, rates)
    worst = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            off = abs(slope[i] - rates[i]) * h / (c[0] + 1.0)
            if not off < 1e300:
                return 1e300
            worst = max(worst, against(off, tolerances[i]))
    return worst


def accept(s: Floats, p: Floats, h: float) -> None:
    """Take the new state and its series; the old one is the dense output."""
    size = int(s[SIZE])
    own = at(s, HEADER + 6 * size + 6)
    y = at(s, HEADER)
    new = at(s, buffer(size, 2.0))
    if SLEEPERS:
        before = at(s, buffer(size, own[0]) + 1 + size)
        following = at(s, buffer(size, 1.0 - own[0]) + 1 + size)
        suspect(s, p, h, y, before, new, following)
    own[0] = 1.0 - own[0]
    for i in range(size):
        y[i] = new[i]
    s[STEP_T] = s[T]
    s[STEP_H] = h
    s[T] = s[T] + h
    s[STEPS] += 1.0
    record_measured(s, p)
    c = at(s, buffer(size, own[0]))
    s[H] = chosen_step(s, c)
    if s[H] < SUDDEN * h:
        # Perhaps it is rounding that the last coefficients consist of.
        rates = at(c, 1 + size)
        look_at_rounding(s, p, s[T], y, rates, 1.0)
        set_tolerances(s, p, s[T], y, rates, h)
        s[H] = chosen_step(s, c)


def interpolate(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step: the series there."""
    size = int(s[SIZE])
    which = s[HEADER + 6 * size + 6]
    sum_series(size, at(s, buffer(size, 1.0 - which)), x * s[STEP_H], out)
