"""Gauss collocation with two stages: order 4, symplectic for any Lagrangian.

In positions and momenta, so that mass matrices that vary with the positions are no
exception: energy errors, of size (step * frequency)^4, do not grow, quadratic
invariants such as angular momentum are kept to rounding, and the method is symmetric.
The step to be preferred to `midpoint` wherever more than two digits are wanted. Forces
and damping are allowed; the order stays on motion that is not stiff, and falls to 2
where it is. Stable at any step on the imaginary axis, but fast motion past step *
frequency of about 2 has the wrong phase, and Newton's method must converge.

Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration, 2nd ed.,
sections II.1.3, VI.4 and VIII.6.
"""

from __future__ import annotations

from math import inf, sqrt
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
from lagsim.native.kernels.words import at, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure

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
    words[COUNT] = 2.0
    for i in unrolled(2):
        words[NODES + i] = C[i]
        words[WEIGHTS + i] = B[i]
        for j in unrolled(2):
            words[COEFFICIENTS + 2 * i + j] = A[i][j]
    begin_stages(s, p)


def step(s: Floats, p: Floats) -> int:
    """Make one step, or give a code other than 0."""
    return gauss_step(s, p)


def interpolate(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step: cubic Hermite."""
    hermite(s, x, out)
