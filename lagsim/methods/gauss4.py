"""Gauss collocation with two stages: order 4, symplectic for any Lagrangian.

The method uses positions and momenta, so the mass matrix may vary with the positions.
Energy errors, of size (step * frequency)^4, do not grow; quadratic invariants such as
angular momentum are kept to rounding; the method is symmetric. For more than two digits
it is better than `midpoint`. Forces and damping are allowed. The order is 4 for motion
that is not stiff, and 2 for stiff motion. Stable at any step on the imaginary axis, but
fast motion past step * frequency of about 2 has the wrong phase, and Newton's method
must converge.

Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
sections II.1.3, VI.4 and VIII.6.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.gauss import Gauss, interpolate, refusal, start, step
from lagsim.methods.parts.tableau import Tableau
from lagsim.native.layout import array

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

__all__ = ["interpolate", "refusal", "start", "step"]

NAME = "gauss4"
TITLE = "Gauss collocation, 2 stages"
ORDER = 4
DENSE_ORDER = 3
ADAPTIVE = False
IMAGINARY_LIMIT = inf
HANDLES = "any model without constraints"

A = (
    (1 / 4, 1 / 4 - sqrt(3.0) / 6),
    (1 / 4 + sqrt(3.0) / 6, 1 / 4),
)
B = (1 / 2, 1 / 2)
C = (1 / 2 - sqrt(3.0) / 6, 1 / 2 + sqrt(3.0) / 6)
TABLEAU = Tableau(A, B, C, ORDER)
amplification = TABLEAU.amplification

NEEDS = ("lagrangian",)

CONSTRAINED = False  # for what is shared with methods that can be


class Gauss4(Gauss):
    """Its tableau."""

    stages: int = 2
    nodes: Floats = array(lambda s: s.stages, C)
    weights: Floats = array(lambda s: s.stages, B)
    coefficients: Floats = array(lambda s: s.stages**2, (*A[0], *A[1]))


STATE = Gauss4
