"""A motion's power series, c = [order, y_0 (size,), ..., y_order]: sums, the step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.methods.parts.controller import against
from lagsim.methods.parts.noise import TIGHT
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import exponent, two_to, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Terms shrink by e^2 from one to the next at the step that costs least per unit of
# time (Jorba and Zou, proposition 3.1).
LOG_SHRINK = 2.0 / math.log(2.0)  # as a power of two
# Below this numbers are not normal.
LEAST_NUMBER = 2.0**-1000
# How many of the last coefficients bound the step.
GUARD = 4
# A priori bounds are met with this much room, or one step in two fails the check.
SAFETY = 0.9
# At tight tolerances truncation is kept below rounding, which it outgrows; and shorter
# steps average more of what forces are rounded by.
TIGHT_SAFETY = 0.6
# Logarithms and powers of two by interpolants at Chebyshev's nodes: lanes of vectors
# have them at once. A step is not known better than to their nine digits.
# log2(1 + f)/f for 1/sqrt(2) <= 1 + f <= sqrt(2); f times it is within 4e-10.
LOGARITHM = (
    1.4426950417560511, -0.7213475119905358, 0.48089790445500086, -0.36067466009513405,
    0.2885755897331174, -0.24044757077719425, 0.20504002106652403, -0.17919457239512765,
    0.17234259277671127, -0.16765051818984325, 0.09481863798699576,
)  # fmt: skip
# 2^f for |f| <= 1/2, within 1e-10.
POWER = (
    0.9999999999595618, 0.6931471805568324, 0.24022651213498092, 0.055504109063258665,
    0.009618025613318034, 0.0013333478473685416, 0.00015469729214118296,
    1.5303700711365693e-05,
)  # fmt: skip
ROOT = 2.0**0.5
# Exponents of normal numbers; and what rounds to a whole number when it is added.
LEAST = -1022.0
MOST = 1023.0
ROUNDER = 1.5 * 2.0**52


def chosen_step(s: State, c: Floats, t: float) -> float:
    """Give the step from t at which the terms after the last are within the tolerance.

    If each of the last GUARD terms is within its bound, and they shrink by e^2 from
    one to the next, so is the first that is left out. Not longer than the arc.
    """
    size = s.size
    order = int(c[0])
    tolerances = s.tolerances
    largest = s.work
    arc = s.end - t
    if arc <= 0.0:
        return 0.0
    for back in unrolled(GUARD):
        largest[back] = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            part = 1.0 / max(tolerances[i], LEAST_NUMBER)
            for back in unrolled(GUARD):
                term = abs(c[1 + (order - back) * size + i]) * part
                largest[back] = max(largest[back], term)
    safety = TIGHT_SAFETY if s.rtol < TIGHT else SAFETY
    logarithm = log2_of(max(arc / safety, LEAST_NUMBER))
    for back in unrolled(GUARD):
        if not largest[back] < 1e300:
            return 0.0
        if largest[back] > LEAST_NUMBER:
            bound = (back + 1) * LOG_SHRINK - log2_of(largest[back])
            logarithm = min(logarithm, bound / (order - back))
    return safety * two_to_the(logarithm)


def sum_bend(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of y_k h^k from k = 2, even and odd powers apart: they overlap."""
    order = int(c[0])
    square = h * h
    for i in range(size):
        high = c[1 + order * size + i]
        low = c[1 + (order - 1) * size + i]
        for back in range(1, (order - 1) // 2):
            k = order - 2 * back
            high = high * square + c[1 + k * size + i]
            low = low * square + c[1 + (k - 1) * size + i]
        if order % 2 == 0:
            low = low * h + c[1 + 2 * size + i]
            out[i] = (high * square + low) * square
        else:
            out[i] = (high * h + low) * square


def sum_rates(size: int, first: int, c: Floats, h: float, out: Floats) -> None:
    """Give the sum of k y_k h^(k - 1) in the same way, from component `first` on."""
    order = int(c[0])
    square = h * h
    for i in range(first, size):
        high = order * c[1 + order * size + i]
        low = (order - 1) * c[1 + (order - 1) * size + i]
        for back in range(1, order // 2):
            k = order - 2 * back
            high = high * square + k * c[1 + k * size + i]
            low = low * square + (k - 1) * c[1 + (k - 1) * size + i]
        out[i] = high * h + low
        if order % 2 == 1:
            out[i] = out[i] * h + c[1 + size + i]


def lead(size: int, c: Floats, h: float, out: Floats) -> None:
    """Give how far off (size,) the terms of a series may lead in a step."""
    order = int(c[0])
    for i in range(size):
        far = 0.0
        for back in range(order):
            far = (far + abs(c[1 + (order - back) * size + i])) * h
        out[i] = c[1 + i] + far


def misfit(s: State, c: Floats, slope: Floats, h: float) -> float:
    """Give the error of a step of series c, from y' (size,) at its end."""
    size = s.size
    tolerances = s.tolerances
    rates = s.work
    sum_rates(size, 0, c, h, rates)
    worst = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            off = abs(slope[i] - rates[i]) * h / (c[0] + 1.0)
            if not off < 1e300:
                return 1e300
            worst = max(worst, against(off, tolerances[i]))
    return worst


def log2_of(x: float) -> float:
    """Give log2(x) of a normal number that is positive."""
    k = exponent(x)
    m = x * two_to(min(max(-k, LEAST), MOST))
    if m > ROOT:
        m = 0.5 * m
        k += 1.0
    f = m - 1.0
    found = LOGARITHM[10]
    for down in unrolled(10):
        found = found * f + LOGARITHM[9 - down]
    return k + f * found


def two_to_the(x: float) -> float:
    """Give 2^x, or the nearest power of two that is a normal number."""
    x = min(max(x, LEAST), MOST)
    k = (x + ROUNDER) - ROUNDER
    f = x - k
    found = POWER[7]
    for down in unrolled(7):
        found = found * f + POWER[6 - down]
    return found * two_to(k)
