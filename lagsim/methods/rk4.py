"""RK4: the classic Runge-Kutta method of order 4, with a fixed step.

For comparison with lecture notes and older programs, and for lessons on accuracy and
stability: there is no error control. Rows between steps come from cubic Hermite
interpolation. Stable on the imaginary axis for step * frequency below 2.83.

Source: W. Kutta, Z. Math. Phys. 46 (1901); E. Hairer, S. P. Norsett and G. Wanner,
Solving Ordinary Differential Equations I, 2nd ed., sections II.1 and II.6.
"""

from __future__ import annotations

from math import floor
from typing import TYPE_CHECKING

from lagsim.methods._controller import record_sizes
from lagsim.methods._interface import derivative
from lagsim.methods._projection import project
from lagsim.methods._singular import record_health
from lagsim.methods._state import (
    ARC_START,
    DONE,
    END,
    EVALUATIONS,
    FIXED_STEP,
    HEADER,
    NOT_FINITE,
    PROJECTION_FAILED,
    SIZE,
    STEP_H,
    STEP_T,
    STEPS,
    N,
    T,
)
from lagsim.methods._tableau import Tableau
from lagsim.native.kernel_types import at, total, unrolled

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats
    from lagsim.structure import Structure

NAME = "rk4"
TITLE = "classic Runge-Kutta"
ORDER = 4
DENSE_ORDER = 3
ADAPTIVE = False
IMAGINARY_LIMIT = 2.83
HANDLES = "any model; equality constraints by projection; fixed step"

A = ((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0))
B = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
C = (0.0, 1 / 2, 1 / 2, 1.0)
TABLEAU = Tableau(A, B, C, ORDER)

NEEDS = ()
QUADRATURES = True

CONSTRAINED = True


def refusal(_scene: Structure) -> str:
    """Give "": it handles everything."""
    return ""


def amplification(z: complex) -> float:
    """Give the size of the stability function at z = h * eigenvalue."""
    return TABLEAU.amplification(z)


def state_size(size: int) -> int:
    """Give the length of the array of state for `size` components."""
    return HEADER + 6 * size + 6 + 9 * size


# The method's own arrays: k (5 size), z (size), new (size), old (size), old k (size).
def start(s: Floats, p: Floats) -> None:
    """Begin an arc: evaluate at its start."""
    size = int(s[SIZE])
    derivative(s[T], at(s, HEADER), p, at(s, HEADER + 6 * size + 6))
    s[EVALUATIONS] += 1.0
    s[STEP_H] = 0.0
    record_sizes(s, p)


def step(s: Floats, p: Floats) -> int:
    """Make one step, or give a code other than 0."""
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    k = at(s, HEADER + 6 * size + 6)
    z = at(k, 5 * size)
    new = at(k, 6 * size)
    t = s[T]
    after = next_time(s)
    h = after - t
    for stage in unrolled(1, 4):
        for i in range(size):
            slope = total(A[stage][j] * k[j * size + i] for j in unrolled(stage))
            z[i] = y[i] + h * slope
        derivative(t + C[stage] * h, z, p, at(k, stage * size))
    for i in range(size):
        new[i] = y[i] + h * total(B[j] * k[j * size + i] for j in unrolled(4))
        if not abs(new[i]) < 1e300:
            return NOT_FINITE
    if CONSTRAINED:
        work = at(s, HEADER + 4 * size + 2)
        sizes = at(s, HEADER + size)
        masses = at(s, HEADER + 3 * size + 2)
        if project(n, after, h, new, p, sizes, masses, work) == 0:
            return PROJECTION_FAILED
        record_health(s, work[n + 1], h)
    derivative(after, new, p, at(k, 4 * size))
    s[EVALUATIONS] += 4.0
    accept(s, p, t, after)
    return DONE


def next_time(s: Floats) -> float:
    """Give the end of the step: a whole number of steps into the arc, or its end."""
    made = floor((s[T] - s[ARC_START]) / s[FIXED_STEP] + 0.5)
    after = s[ARC_START] + (made + 1) * s[FIXED_STEP]
    if after + 1e-9 * s[FIXED_STEP] >= s[END]:
        return float(s[END])
    return float(after)


def accept(s: Floats, p: Floats, t: float, after: float) -> None:
    """Take the new state; keep the old one for interpolation."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    k = at(s, HEADER + 6 * size + 6)
    new = at(k, 6 * size)
    old = at(k, 7 * size)
    slope = at(k, 8 * size)
    for i in range(size):
        old[i] = y[i]
        slope[i] = k[i]
        y[i] = new[i]
        k[i] = k[4 * size + i]
    s[STEP_T] = t
    s[STEP_H] = after - t
    s[T] = after
    s[STEPS] += 1.0
    record_sizes(s, p)


def interpolate(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step: cubic Hermite (II.6)."""
    size = int(s[SIZE])
    h = s[STEP_H]
    y = at(s, HEADER)
    k = at(s, HEADER + 6 * size + 6)
    old = at(k, 7 * size)
    slope = at(k, 8 * size)
    u = 1.0 - x
    for i in range(size):
        change = y[i] - old[i]
        bend = u * (h * slope[i] - change) - x * (h * k[i] - change)
        out[i] = old[i] + x * (change + u * bend)
