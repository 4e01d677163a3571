"""Where a fixed-step method becomes unstable, from eigenvalues alone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    Amplification = Callable[[complex], float]

# Sizes of z = h*lambda that are looked at, by the first factor in so many directions,
# those of the fastest eigenvalues (Kahan and Li's method of order 8 is unstable in a
# gap of 1.4 % only), and by the second in others.
SMALLEST, LARGEST = 0.02, 50.0
FINE, COARSE, MOST_FINE = 1.008, 1.12, 12
# A method that amplifies an oscillation at so small a step does so at any.
AT_ONCE = 1e-3
BISECTIONS = 40
# An amplification exceeds 1 if by more than rounding does ...
ROUNDING = 1e-8
# ... and that of a motion that itself grows by e^x if by more than this part of x:
# short of it an error of the method is no instability. A motion that grows by more than
# this part of its eigenvalue is left out: no method holds what does not hold.
SLACK = 0.1
# What an eigenvalue does is seen within a run if its size times the run exceeds this.
SEEN = 1e-2


def exceeds(amplification: Amplification, z: complex) -> bool:
    """Tell whether a step amplifies more than the motion itself does."""
    grows = max(0.0, z.real)
    allowed = math.exp(min(grows, 300.0)) * (1.0 + SLACK * grows)
    with np.errstate(all="ignore"):
        found = amplification(z)
    return not found <= allowed * (1.0 + ROUNDING)


def limit(
    amplification: Amplification, direction: complex, most: float, factor: float = FINE
) -> float:
    """Give the smallest size of z in a direction that is unstable; inf below `most`."""
    if exceeds(amplification, AT_ONCE * direction):
        return 0.0
    low, high = AT_ONCE, SMALLEST
    while not exceeds(amplification, high * direction):
        if high >= most:
            return math.inf
        low, high = high, high * factor
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if exceeds(amplification, middle * direction):
            high = middle
        else:
            low = middle
    return high


def predicted(
    amplification: Amplification, eigenvalues: Iterable[complex], span: float
) -> float | None:
    """Give the smallest unstable step for any of the eigenvalues.

    0 where every step is unstable, None where none is found.

    Parameters
    ----------
    span
        How long a run is: slower eigenvalues do nothing in it.
    """
    best = math.inf
    found: dict[complex, float] = {}
    fastest_first = sorted(eigenvalues, key=lambda x: -abs(x))
    for eigenvalue in fastest_first:
        size = float(abs(eigenvalue))
        if size * span < SEEN:
            break
        if eigenvalue.real > SLACK * size:
            continue
        # The conjugate does the same; directions that differ by rounding are one.
        direction = complex(eigenvalue.real, abs(eigenvalue.imag)) / size
        key = complex(round(direction.real, 9), round(direction.imag, 9))
        if key not in found:
            most = min(LARGEST, best * size)
            factor = FINE if len(found) < MOST_FINE else COARSE
            reach = limit(amplification, direction, most, factor)
            if math.isfinite(reach) or most == LARGEST:
                found[key] = reach
        best = min(best, found.get(key, math.inf) / size)
    return best if math.isfinite(best) else None
