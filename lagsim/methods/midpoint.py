"""The implicit midpoint rule: order 2, symplectic for any Lagrangian.

The Gauss method of one stage, in positions and momenta: where the mass matrix varies
with the positions (double pendulum, polar coordinates) it is still symplectic and
symmetric, which the same rule in positions and velocities is not. Energy errors, of
size (step * frequency)^2, do not grow; quadratic invariants, such as angular momentum
and the energy of linear oscillations, are kept to rounding. Forces and damping are
allowed; there is nothing to conserve then, the order stays. Stable at any step on the
imaginary axis, but fast motion past step * frequency of about 1 has the wrong phase,
and Newton's method must converge.

Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
sections II.1.3, VI.4 and VIII.6.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from lagsim.methods.parts import gauss
from lagsim.methods.parts.fixed import hermite
from lagsim.methods.parts.gauss import (
    COEFFICIENTS,
    COUNT,
    NODES,
    WEIGHTS,
    begin_stages,
    gauss_step,
)
from lagsim.methods.parts.state import HEADER, SIZE, N
from lagsim.methods.parts.tableau import Tableau
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure

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

NEEDS = ("lagrangian",)

CONSTRAINED = False  # for what is shared with methods that can be


def refusal(scene: Structure) -> str:
    """Say why momenta do not tell the motion, or give ""."""
    return gauss.refusal(scene)


def amplification(z: complex) -> float:
    """Give the size of the stability function at z = h * eigenvalue."""
    return TABLEAU.amplification(z)


def state_size(size: int) -> int:
    """Give the length of the array of state for `size` components."""
    return gauss.state_size(size, len(B))


def start(s: Floats, p: Floats) -> None:
    """Begin an arc: momenta from velocities."""
    words = at(s, HEADER + 13 * int(s[SIZE]) + 6 + int(s[N]))
    words[COUNT] = 1.0
    words[NODES] = C[0]
    words[WEIGHTS] = B[0]
    words[COEFFICIENTS] = A[0][0]
    begin_stages(s, p)


def step(s: Floats, p: Floats) -> int:
    """Make one step, or give a code other than 0."""
    return gauss_step(s, p)


def interpolate(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step: cubic Hermite."""
    hermite(s, x, out)
