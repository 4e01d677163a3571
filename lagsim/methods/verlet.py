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

from lagsim.language.arrays import Floats
from lagsim.methods import Structure
from lagsim.methods.parts.constraints import is_finite
from lagsim.methods.parts.control import add
from lagsim.methods.parts.fixed import Fixed, interpolate, step
from lagsim.methods.parts.fixed import start as begin
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, NOT_FINITE, derivative, power
from lagsim.native.layout import array

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["interpolate", "step"]

NAME = "verlet"
TITLE = "Stoermer-Verlet (leapfrog)"
ORDER = 2
DENSE_ORDER = 2
ADAPTIVE = False
IMAGINARY_LIMIT = 2.0
HANDLES = "constant M, forces f(q, t); no constraints"

NEEDS = ("power",)

CONSTRAINED = False  # for code shared with methods that support constraints


# --- kicks and drifts of Verlet's method and its compositions
#
# A kick changes the velocities at fixed positions, a drift the positions at fixed
# velocities. Both are exact flows if M is constant and the forces depend on positions
# and time alone, so that their composition is symplectic. Time advances with the drift;
# `work` is advanced by the kicks, with the power at the middle of each, which is exact
# because power is linear in the velocities there.
#
# All sums are compensated: over many periods rounding is the only limit of the
# conservation of energy.


class Symplectic(Fixed):
    """Memory of compositions of Verlet steps; `new` is the state between steps."""

    stages: int = 1
    weights: Floats = array("stages", 1.0)
    stage_ends: Floats = array("stages")  # ends of the stages, in parts of the step
    # Weights of the kicks: half of a Verlet step's kick comes before it and half after
    # it; adjacent halves are combined.
    kicks: Floats = array(lambda s: s.stages + 1)


STATE = Symplectic


def refusal(scene: Structure) -> str:
    """Return the reason why a model cannot be split into kicks and drifts, or "".

    scene : the structure of the model.
    """
    if scene.constraints == "holonomic":
        return (
            "it has constraints (`rattle` is Verlet's method for holonomic ones, "
            "`dop853` projects onto constraints)"
        )
    if scene.constraints != "none":
        return (
            "it has constraints between velocities (`dop853` projects onto constraints)"
        )
    return inseparable(scene)


def inseparable(scene: Structure) -> str:
    """Return the reason why the motion does not split into kicks and drifts, or "".

    scene : the structure of the model.
    """
    instead = (
        "(`midpoint` and `gauss4` are symplectic for any Lagrangian, `dop853` follows "
        "any motion closely)"
    )
    if not scene.constant_mass:
        return (
            f"its mass matrix varies with {scene.mass_varies_with}, so the "
            f"acceleration depends on the velocities {instead}"
        )
    if not scene.forces_free_of_velocities:
        return f"its forces depend on the velocities {instead}"
    return ""


def composed_amplification(weights: Sequence[float], z: complex) -> float:
    """Return the spectral radius of a composition of Verlet steps of `weights`.

    The oscillator is q'' = 2 Re(z) q' - |z|^2 q, and the step is 1. The damping force
    is evaluated with the velocity before each half kick. (Runs refuse damping.)
    """
    (a, c), (b, d) = (_composed(weights, z, *unit) for unit in ((1.0, 0.0), (0.0, 1.0)))
    half = 0.5 * (a + d)
    # Product of the kicks' determinants; a*d - b*c would cancel if the method is
    # unstable.
    determinant = 1.0
    for weight in weights:
        determinant *= (1.0 + weight * z.real) ** 2
    square = 0.25 * (a - d) ** 2 + b * c
    if square <= 0.0:
        return float(abs(determinant) ** 0.5)
    return float(abs(half) + square**0.5)


def _composed(
    weights: Sequence[float], z: complex, q: float, v: float
) -> tuple[float, float]:
    for weight in weights:
        v += 0.5 * weight * (2.0 * z.real * v - abs(z) ** 2 * q)
        q += weight * v
        v += 0.5 * weight * (2.0 * z.real * v - abs(z) ** 2 * q)
    return q, v


amplification = partial(composed_amplification, (1.0,))


def start(s: Symplectic, p: Parameters) -> None:
    """Begin an arc: evaluate y' at the start; set the lengths of kicks and drifts."""
    end = 0.0
    before = 0.0
    for stage in range(s.stages):
        s.kicks[stage] = 0.5 * (before + s.weights[stage])
        before = s.weights[stage]
        end += before
        s.stage_ends[stage] = end
    s.kicks[s.stages] = 0.5 * before
    s.stage_ends[s.stages - 1] = 1.0
    begin(s, p)


def make(s: Symplectic, p: Parameters, after: float, h: float) -> int:
    """Compute the state s.new (size,) after a step h, at the time `after`.

    Return DONE, or the code of a failure. See `fixed.make`.
    """
    s.new[:] = s.y
    s.slope[:] = s.k
    kick(s, p, s.t, s.kicks[0] * h)
    for stage in range(s.stages):
        t = s.t + s.stage_ends[stage] * h
        drift(s, p, t, s.weights[stage] * h)
        kick(s, p, t, s.kicks[stage + 1] * h)
    if not is_finite(s.size, s.new):
        return NOT_FINITE
    s.evaluations += s.stages
    # The velocities have changed since the forces were evaluated.
    s.slope[s.positions] = s.new[s.velocities]
    if s.size > s.quadratures.start:
        power(after, s.new, p, s.slope[s.quadratures])
    return DONE


def drift(s: Symplectic, p: Parameters, t: float, h: float) -> None:
    """Advance the positions by a time h at constant velocity; evaluate y' at t."""
    new = s.new
    add(s.n, new, s.compensation, h, new[s.velocities])
    derivative(t, new, p, s.slope)


def kick(s: Symplectic, p: Parameters, t: float, h: float) -> None:
    """Advance velocities and works by a time h, with the forces at the positions.

    t : the time of these positions.
    """
    n, new = s.n, s.new
    v, compensation, a = (
        new[s.velocities],
        s.compensation[s.velocities],
        s.slope[s.velocities],
    )
    if s.size > s.quadratures.start:
        work, rate = new[s.quadratures], s.slope[s.quadratures]
        add(n, v, compensation, 0.5 * h, a)
        power(t, new, p, rate)
        count = s.size - s.quadratures.start
        add(count, work, s.compensation[s.quadratures], h, rate)
        add(n, v, compensation, 0.5 * h, a)
    else:
        add(n, v, compensation, h, a)
