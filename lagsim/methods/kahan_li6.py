"""Kahan-Li 6: nine Verlet steps, two of them backwards, make order 6.

A symmetric method has only even powers of the step in its error. Verlet steps of
different lengths can cancel these powers one after the other, if some of them go back
in time; of the ways to reach order 6 with nine, this one was found by a long search for
small weights. It inherits from Verlet's method that it is symplectic and reversible:
the energy's error, of size (h w)^6, swings and does not grow. What would grow is
rounding, so it is carried along (compensated summation).

For many periods of a smooth motion; it costs nine evaluations per step. Stable for
h w < 2.532, w the fastest frequency; a step of h w = 0.1 to 0.5 is usual. It needs a
constant mass matrix and forces that depend on positions and time only.

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

NAME = "kahan-li6"
TITLE = "Kahan-Li composition of 9 Verlet steps"
ORDER = 6
DENSE_ORDER = 6
ADAPTIVE = False
IMAGINARY_LIMIT = 2.532
HANDLES = "constant M, forces f(q, t); no constraints"

# Half of the weights and the middle one; the others mirror them.
HALF = (
    0.39216144400731413927925056,
    0.33259913678935943859974864,
    -0.70624617255763935980996482,
    0.08221359629355080023149045,
    0.79854399093482996339895035,
)
WEIGHTS = (*HALF, *HALF[-2::-1])
STAGES = 9
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
