"""The implicit midpoint rule: order 2, symplectic for any Lagrangian.

The Gauss method of one stage, in positions and momenta. So it is symplectic and
symmetric even if the mass matrix varies with the positions (double pendulum, polar
coordinates); the same rule in positions and velocities is not. Forces and damping are
allowed, with the same order.

- **Energy.** Errors, of size (step * frequency)^2, do not grow. Quadratic invariants,
  such as angular momentum and the energy of linear oscillations, are kept to rounding.
- **Stability.** Stable at any step on the imaginary axis, but fast motion past step *
  frequency of about 1 has the wrong phase, and Newton's method must converge.

Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
sections II.1.3, VI.4 and VIII.6.
"""

from __future__ import annotations

from math import inf

from lagsim.language.arrays import Floats
from lagsim.methods.gauss4 import Gauss, interpolate, make, refusal, start, step
from lagsim.methods.parts.fixed import Tableau
from lagsim.native.layout import array

__all__ = ["interpolate", "make", "refusal", "start", "step"]

NAME = "midpoint"
TITLE = "implicit midpoint rule"
ORDER = 2
DENSE_ORDER = 2
ADAPTIVE = False
IMAGINARY_LIMIT = inf
HANDLES = "any model without constraints"

A = ((1 / 2,),)
B = (1.0,)
C = (1 / 2,)
TABLEAU = Tableau(A, B, C, ORDER)
amplification = TABLEAU.amplification

NEEDS = ("lagrangian",)

CONSTRAINED = False  # for code shared with methods that support constraints


class Midpoint(Gauss):
    """Memory of `midpoint`, with the tableau of the method."""

    stages: int = 1
    nodes: Floats = array("stages", C)
    weights: Floats = array("stages", B)
    coefficients: Floats = array(lambda s: s.stages**2, A[0], replaces=True)


STATE = Midpoint
