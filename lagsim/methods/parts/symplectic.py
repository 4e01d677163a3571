"""Verlet's method and its compositions: positions and velocities moved in turn.

A kick moves the velocities at fixed positions, a drift the positions at fixed
velocities. Both are motions that can be made exactly where M is constant and the forces
depend on positions and time alone, so that what is made of them is symplectic. Time
moves with the drift; `work` is moved by the kicks, with the power at the middle of
each, which is exact because power is linear in the velocities there.

All sums carry what rounding has cut off: over many periods nothing else limits how well
the energy is kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.fixed import Fixed
from lagsim.methods.parts.interface import derivative, power
from lagsim.methods.parts.noise import add
from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.mechanics.structure import Structure


class Symplectic(Fixed):
    """`new` is the state on its way, and `rest` goes with it."""


def refusal(scene: Structure) -> str:
    """Say why positions and velocities cannot be moved in turn, or give ""."""
    if scene.constraints == "holonomic":
        return (
            "it has constraints (`rattle` is Verlet's method for holonomic ones, "
            "`dop853` projects onto them)"
        )
    if scene.constraints != "none":
        return "it has constraints between velocities (`dop853` projects onto them)"
    return inseparable(scene)


def inseparable(scene: Structure) -> str:
    """Say why the motion does not split into kicks and drifts, or give ""."""
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


def amplification(weights: Sequence[float], z: complex) -> float:
    """Give the spectral radius of a composition of Verlet steps of `weights`.

    For q'' = 2 Re(z) q' - |z|^2 q and a step of 1. Damping, which a run refuses, is
    taken as explicit: by the velocity before each half kick.
    """
    (a, c), (b, d) = (_composed(weights, z, *unit) for unit in ((1.0, 0.0), (0.0, 1.0)))
    half = 0.5 * (a + d)
    # By the kicks alone; a*d - b*c would cancel where the method is unstable.
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


def depart(s: Symplectic) -> None:
    """Put the state where it is moved from stage to stage."""
    size = s.size
    y = s.y
    new = s.new
    slope = s.slope
    k = s.k
    for i in range(size):
        new[i] = y[i]
        slope[i] = k[i]


def drift(s: Symplectic, p: Parameters, t: float, h: float) -> None:
    """Move the positions for a time h, to the time t, and look at the forces there."""
    n = s.n
    slope = s.slope
    new = s.new
    add(n, new, s.rest, h, at(new, n))
    derivative(t, new, p, slope)


def kick(s: Symplectic, p: Parameters, t: float, h: float) -> None:
    """Move the velocities, and `work`, by the forces at the positions reached."""
    size = s.size
    n = s.n
    slope = s.slope
    new = s.new
    rest = s.rest
    if size > 2 * n:
        add(n, at(new, n), at(rest, n), 0.5 * h, at(slope, n))
        power(t, new, p, at(slope, 2 * n))
        add(size - 2 * n, at(new, 2 * n), at(rest, 2 * n), h, at(slope, 2 * n))
        add(n, at(new, n), at(rest, n), 0.5 * h, at(slope, n))
    else:
        add(n, at(new, n), at(rest, n), h, at(slope, n))


def arrive(s: Symplectic, p: Parameters, t: float) -> None:
    """Make y' after the step: the velocities have moved since the forces were found."""
    size = s.size
    n = s.n
    slope = s.slope
    new = s.new
    for i in range(n):
        slope[i] = new[n + i]
    if size > 2 * n:
        power(t, new, p, at(slope, 2 * n))
