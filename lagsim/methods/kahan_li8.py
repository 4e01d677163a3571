"""Kahan-Li 8: seventeen Verlet steps, five of them backwards, give order 8.

The same construction as `kahan-li6`, two orders higher. It is the method for keeping an
energy to rounding over many thousands of periods, as of planets: with compensated
summation the error of Kepler's energy is some 1e-14 after ten thousand orbits. For
fewer digits `kahan-li6` or `verlet` are cheaper; for the path over a few hundred
periods `dop853` is.

It takes seventeen evaluations per step. Stable for h w < 3.096, w the fastest
frequency; a step of h w = 0.1 to 0.5 is usual. It needs a constant mass matrix and
forces that depend on positions and time only.

Source: W. Kahan and R.-C. Li, Composition constants for raising the orders of
unconventional schemes for ordinary differential equations, Math. Comp. 66 (1997)
1089-1099; E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
section V.3.2.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from lagsim.methods.parts import symplectic
from lagsim.methods.parts.composition import Composition, interpolate, start, step
from lagsim.methods.parts.symplectic import refusal
from lagsim.native.layout import array

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

__all__ = ["interpolate", "refusal", "start", "step"]

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
amplification = partial(symplectic.amplification, WEIGHTS)
NEEDS = ("power",)

CONSTRAINED = False  # for what is shared with methods that can be
UNTIL = True


class KahanLi8(Composition):
    """The weights of its Verlet steps."""

    stages: int = 17
    weights: Floats = array(lambda s: s.stages, WEIGHTS)


STATE = KahanLi8
