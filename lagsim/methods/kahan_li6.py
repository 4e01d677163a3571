"""Kahan-Li 6: nine Verlet steps, two backwards in time, order 6.

The error of a symmetric method has only even powers of the step. Verlet steps of
different lengths, some backwards in time, cancel these powers one after the other;
these nine lengths were found by a search for small weights. Like Verlet's
method it is symplectic and reversible: the error of the energy, of size (h w)^6,
oscillates and does not grow. Summation is compensated, so rounding does not accumulate.

For many periods of a smooth motion; it takes nine evaluations per step. Stable for h w
< 2.532, w the fastest frequency; a step of h w = 0.1 to 0.5 is usual. It needs a
constant mass matrix and forces that depend on positions and time only.

Source: W. Kahan and R.-C. Li, Composition constants for raising the orders of
unconventional schemes for ordinary differential equations, Math. Comp. 66 (1997)
1089-1099; E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
section V.3.2.
"""

from __future__ import annotations

from functools import partial

from lagsim.language.arrays import Floats
from lagsim.methods.kahan_li8 import Composition, interpolate, make, start, step
from lagsim.methods.verlet import composed_amplification, refusal
from lagsim.native.layout import array

__all__ = ["interpolate", "make", "refusal", "start", "step"]

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
amplification = partial(composed_amplification, WEIGHTS)
NEEDS = ("power",)

CONSTRAINED = False  # for code shared with methods that support constraints


class KahanLi6(Composition):
    """Memory of `kahan-li6`, with the weights of the Verlet steps."""

    stages: int = 9
    weights: Floats = array("stages", WEIGHTS)


STATE = KahanLi6
