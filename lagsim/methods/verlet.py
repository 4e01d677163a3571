"""Verlet: half a kick, a drift, half a kick; one evaluation per step, order 2.

The leapfrog of molecular dynamics and of the planets. Each part of the step is a motion
made exactly, so the step preserves the symplectic form, and run backwards it returns
on its own path. It does not conserve the energy but a nearby one: the error of the
energy swings within bounds of size (h w)^2 and does not grow, for millions of periods,
where an explicit Runge-Kutta method gains or loses a little in each.

Stable for h w < 2, w the fastest frequency: 3.14 steps per period. Well below that, an
oscillation is too fast by the fraction (h w)^2/24, with the right amplitude. With a
nonlinear force, the step resonates with the motion if a period is a whole number of
steps: at h w = sqrt(3) it is three steps, and in a cubic potential no motion of any
amplitude is stable.

It needs a constant mass matrix and forces that depend on positions and time only.

Source: L. Verlet, Phys. Rev. 159 (1967) 98-103; E. Hairer, C. Lubich and G. Wanner,
Geometric Numerical Integration, 2nd ed., sections I.1.4 and IX.8 (energy over long
times).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from lagsim.methods.parts import symplectic
from lagsim.methods.parts.fixed import (
    begin,
    hermite,
    is_finite,
    next_time,
    step_length,
    take,
)
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, NOT_FINITE
from lagsim.methods.parts.symplectic import (
    Symplectic,
    arrive,
    depart,
    drift,
    kick,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

NAME = "verlet"
TITLE = "Stoermer-Verlet (leapfrog)"
ORDER = 2
DENSE_ORDER = 2
ADAPTIVE = False
IMAGINARY_LIMIT = 2.0
HANDLES = "constant M, forces f(q, t); no constraints"

NEEDS = ("power",)

refusal = symplectic.refusal
amplification = partial(symplectic.amplification, (1.0,))
CONSTRAINED = False  # for what is shared with methods that can be
STATE = Symplectic


def start(s: Symplectic, p: Parameters) -> None:
    """Begin an arc: evaluate at its start."""
    begin(s, p)


def step(s: Symplectic, p: Parameters) -> int:
    """Make one step, or give a code other than 0."""
    after = next_time(s)
    h = step_length(s, after)
    depart(s)
    kick(s, p, s.t, 0.5 * h)
    drift(s, p, after, h)
    kick(s, p, after, 0.5 * h)
    if not is_finite(s.size, s.new):
        return NOT_FINITE
    s.evaluations += 1.0
    arrive(s, p, after)
    take(s, p, after)
    return DONE


def interpolate(s: Symplectic, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step: cubic Hermite."""
    hermite(s, x, out)
