"""Kahan-Li 8: seventeen Verlet steps, five of them backwards, make order 8.

What `kahan-li6` does, taken two orders further. Where an energy is to be kept to
rounding over many thousands of periods, as of planets, this is the method: with
compensated summation the error of Kepler's energy is some 1e-14 after ten thousand
orbits. Where fewer digits will do, `kahan-li6` or `verlet` are cheaper, and where it is
the path that counts for a few hundred periods, `dop853` is.

It costs seventeen evaluations per step. Stable for h w < 3.096, w the fastest
frequency; a step of h w = 0.1 to 0.5 is usual. It needs a constant mass matrix and
forces that depend on positions and time only.

Source: W. Kahan and R.-C. Li, Composition constants for raising the orders of
unconventional schemes for ordinary differential equations, Math. Comp. 66 (1997)
1089-1099; E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
section V.3.2.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from lagsim.methods.parts import symplectic
from lagsim.methods.parts.composition import ARRAYS, make_dense, within
from lagsim.methods.parts.fixed import begin, is_finite, next_time, step_length, take
from lagsim.methods.parts.state import DONE, EVALUATIONS, HEADER, NOT_FINITE, SIZE, T
from lagsim.methods.parts.symplectic import arrive, clear, depart, drift, kick
from lagsim.native.kernels.words import at, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure

NAME = "kahan-li8"
TITLE = "Kahan-Li composition of 17 Verlet steps"
ORDER = 8
DENSE_ORDER = 6
ADAPTIVE = False
IMAGINARY_LIMIT = 3.096
HANDLES = "constant M, forces f(q, t); no constraints"

# Half of the weights and the middle one; the others mirror them.
HALF = (
    0.13020248308889008087881763,
    0.56116298177510838456196441,
    -0.38947496264484728640807860,
    0.15884190655515560089621075,
    -0.39590389413323757733623154,
    0.18453964097831570709183254,
    0.25837438768632204729397911,
    0.29501172360931029887096624,
    -0.60550853383003451169892108,
)
WEIGHTS = (*HALF, *HALF[-2::-1])
STAGES = 17
# Where the Verlet steps end, as parts of the whole step.
ENDS = (*itertools.accumulate(WEIGHTS[:-1]), 1.0)
# Half of a step's kick before it and half after it; those that meet are one.
KICKS = tuple(0.5 * (a + b) for a, b in itertools.pairwise((0.0, *WEIGHTS, 0.0)))

NEEDS = ("power",)

CONSTRAINED = False  # for what is shared with methods that can be
UNTIL = True


def refusal(scene: Structure) -> str:
    """Say why positions and velocities cannot be moved in turn, or give ""."""
    return symplectic.refusal(scene)


def amplification(z: complex) -> float:
    """Give the spectral radius for q'' = 2 Re(z) q' - |z|^2 q, h = 1.

    Damping, which a run refuses, is taken by the velocity before each half kick.
    """
    return symplectic.amplification(WEIGHTS, z)


def state_size(size: int) -> int:
    """Give the length of the array of state for `size` components."""
    return HEADER + 6 * size + 6 + ARRAYS * size


def start(s: Floats, p: Floats) -> None:
    """Begin an arc: evaluate at its start."""
    begin(s, p)
    clear(s)


def step(s: Floats, p: Floats) -> int:
    """Make one step, or give a code other than 0."""
    size = int(s[SIZE])
    slope = at(s, HEADER + 9 * size + 6)
    new = at(slope, size)
    t = s[T]
    after = next_time(s)
    h = step_length(s, after)
    depart(s)
    kick(s, p, t, KICKS[0] * h)
    for stage in unrolled(STAGES):
        drift(s, p, t + ENDS[stage] * h, WEIGHTS[stage] * h)
        kick(s, p, t + ENDS[stage] * h, KICKS[stage + 1] * h)
    if not is_finite(size, new):
        return NOT_FINITE
    s[EVALUATIONS] += STAGES
    arrive(s, p, after)
    take(s, p, after, new, slope)
    make_dense(s, p)
    return DONE


def interpolate(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step."""
    within(s, x, out)
