"""Generalized-alpha: structural dynamics' implicit method with adjustable damping.

Order 2, fixed step, stable at any step on the whole imaginary axis. `spectral_radius`
chooses how fast motion is damped. Resolved motion loses a part of order (step *
frequency)^3. So only oscillations that are too fast for the step, as in a fine mesh,
are damped. The energy is not conserved exactly, as it is by `midpoint` and `gauss4`.

A step balances accelerations, q'' = F(t, q, q'), with the exact Jacobian in Newton's
method. Constraints are satisfied by projection after each step; the proof of order 2
for constrained motion is for the form with multipliers in the step (Arnold and Bruels).

Sources: J. Chung and G. M. Hulbert, J. Appl. Mech. 60 (1993) 371-375; M. Arnold and O.
Bruels, Multibody Syst. Dyn. 18 (2007) 185-202.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from lagsim.language.arrays import Floats
from lagsim.methods.parts import newton
from lagsim.methods.parts.constraints import largest_part
from lagsim.methods.parts.fixed import Fixed, conclude, interpolate, judge, step
from lagsim.methods.parts.fixed import start as begin
from lagsim.methods.parts.missed import next_end
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.state import DONE, NEWTON_FAILED, derivative, jacobian
from lagsim.native.layout import array, option
from lagsim.tolerances import SAME_STEP

if TYPE_CHECKING:
    from typing import TypedDict

    class Options(TypedDict, total=False):
        """Types of the options, for type checkers."""

        spectral_radius: float | str | None


__all__ = ["interpolate", "step"]

NAME = "generalized-alpha"
TITLE = "generalized-alpha"
ORDER = 2
DENSE_ORDER = 2
ADAPTIVE = False
IMAGINARY_LIMIT = inf
HANDLES = "any model; equality constraints by projection"

refusal = newton.too_large
NEEDS = ("jacobian",)

CONSTRAINED = True

RADIUS = 0.8
# A motion is resolved if the rate of its restoring force, times about a ninth of a
# step, and times the step, is less.
RESOLVED = 0.5


def amplification(z: complex, radius: float = RADIUS) -> float:
    """Return the spectral radius of a step on q'' = 2 Re(z) q' - |z|^2 q, h = 1.

    The result is the spectral radius of the matrix (3, 3) that advances (q, q', a)
    (Chung and Hulbert, section 3).

    radius : the method's `spectral_radius`.
    """
    import numpy as np

    alpha_m, alpha_f, gamma, beta = (
        share(radius),
        radius / (radius + 1.0),
        weight(radius),
        displacement(radius),
    )
    force = np.array([-(abs(z) ** 2), 2.0 * z.real, 0.0])
    after = np.array([[1.0, 0.0, -beta], [0.0, 1.0, -gamma], [0.0, 0.0, 1 - alpha_m]])
    before = np.array(
        [[1.0, 1.0, 0.5 - beta], [0.0, 1.0, 1.0 - gamma], [0.0, 0.0, -alpha_m]]
    )
    after[2] -= (1.0 - alpha_f) * force
    before[2] += alpha_f * force
    return float(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(after, before)))))


def share(radius: float) -> float:
    """Return alpha_m, the share of the old acceleration in the balance (eq. 25).

    radius : the method's `spectral_radius`, here and in `weight` and `displacement`.
    """
    return (2.0 * radius - 1.0) / (radius + 1.0)


def weight(radius: float) -> float:
    """Return gamma, the weight of the new acceleration in the velocity (eq. 17).

    radius : the method's `spectral_radius`.
    """
    return 0.5 - share(radius) + radius / (radius + 1.0)


def displacement(radius: float) -> float:
    """Return beta, the weight of the new acceleration in the displacement (eq. 20).

    radius : the method's `spectral_radius`.
    """
    half = 0.5 * (1.0 - share(radius) + radius / (radius + 1.0))
    return half * half


class GeneralizedAlpha(Fixed):
    """Memory of the method: its accelerations, and the factors of Newton's matrix."""

    spectral_radius: float = option(
        RADIUS, 0.0, 1.0,
        "the factor by which one step reduces an oscillation that is infinitely fast "
        "against the step; 1 keeps it, 0 removes it at once",
    )  # fmt: skip
    due: float  # 1 if the matrix is to be factored
    factored_h: float  # the step size for which it was factored
    a: Floats = array("n")
    a_new: Floats = array("n")
    change: Floats = array("n")
    J: Floats = array(lambda s: (s.size - s.n) * s.dynamic.stop)
    factors: Floats = array(lambda s: s.n * s.n)
    pivots: Floats = array("n")


STATE = GeneralizedAlpha


def start(s: GeneralizedAlpha, p: Parameters) -> None:
    """Begin an arc: evaluate y' and the method's acceleration at the start."""
    begin(s, p)
    aim(s, p)
    s.due = 1.0


def aim(s: GeneralizedAlpha, p: Parameters) -> None:
    """Set the first acceleration `a` of the method, at the time to which it belongs.

    The time of `a` differs from the start by alpha_m - alpha_f steps; the acceleration
    at the start would reduce the order of the first step by one (Arnold and Bruels,
    section 3). Its change in this time is added, from a second evaluation, except for
    components whose fast motion the step does not resolve. The first step may be
    shorter than the others: on a short stretch between two points of a table a force
    may be steep.
    """
    n, y, k, z = s.n, s.y, s.k, s.new
    h = min(s.fixed_step, next_end(s, p) - s.t)
    radius = s.spectral_radius
    off = share(radius) - radius / (radius + 1.0)
    ahead = abs(off) * h
    v, a, ahead_a = y[s.velocities], k[s.velocities], s.slope[s.velocities]
    z[:n] = y[:n] + ahead * (v[:n] + 0.5 * ahead * a[:n])
    z[s.velocities] = v[:n] + ahead * a[:n]
    derivative(s.t + ahead, z, p, s.slope)
    s.evaluations += 1.0
    jacobian(s.t, y, p, s.J)
    for i in range(n):
        s.a[i] = a[i]
        row = s.J[i * s.dynamic.stop :]
        if ahead * (h * abs(row[i]) + abs(row[n + i])) < RESOLVED:
            change = ahead_a[i] - a[i]
            s.a[i] += change if off >= 0.0 else -change


def make(s: GeneralizedAlpha, p: Parameters, after: float, h: float) -> int:
    """Compute `new` a step h later, at the time `after`; return DONE or a code.

    See `fixed.make`.
    """
    code = balance(s, p, after, h)
    if code != DONE:
        return code
    for i in range(s.quadratures.start, s.size):
        s.new[i] = s.y[i] + 0.5 * h * (s.k[i] + s.slope[i])
    s.a[:] = s.a_new
    return conclude(s, p, after, h)


def balance(s: GeneralizedAlpha, p: Parameters, after: float, h: float) -> int:
    """Solve for the acceleration after a step h, and compute the new state at `after`.

    The equation is (1 - alpha_m) a1 + alpha_m a0 = (1 - alpha_f) F1 + alpha_f F0, with
    a and F (n,), accelerations of the method and of the model. Return DONE or
    NEWTON_FAILED.
    """
    n, new = s.n, s.new
    v, force, old_force = new[s.velocities], s.slope[s.velocities], s.k[s.velocities]
    change, radius = s.change, s.spectral_radius
    alpha_m = share(radius)
    alpha_f = radius / (radius + 1.0)
    gamma = weight(radius)
    s.a_new[:] = s.a
    advance(s, h)
    if abs(s.factored_h - h) > SAME_STEP * h:
        s.due = 1.0
    previous = 0.0
    for iteration in range(newton.MOST):
        if s.due > 0.0 and renew(s, p, after, h) == 0:
            return NEWTON_FAILED
        s.due = 0.0
        derivative(after, new, p, s.slope)
        s.evaluations += 1.0
        for i in range(n):
            new_force = (1.0 - alpha_f) * force[i] + alpha_f * old_force[i]
            change[i] = new_force - (1.0 - alpha_m) * s.a_new[i] - alpha_m * s.a[i]
        newton.solve(1, n, n, s.factors, s.pivots, change)
        s.a_new[:] += change
        s.change[:] *= h * gamma
        advance(s, h)
        moved = largest_part(1, s, h, v, change)
        state = judge(s, p, h, v, change, iteration, moved, previous)
        if state == newton.SOLVED:
            return DONE
        if state == newton.LOST:
            return NEWTON_FAILED
        if state == newton.RENEW:
            s.due = 1.0
        previous = moved
    return NEWTON_FAILED


def advance(s: GeneralizedAlpha, h: float) -> None:
    """Write positions and velocities after a step h to `new`, from `a` and `a_new`."""
    y, v, new_v = s.y, s.y[s.velocities], s.new[s.velocities]
    gamma = weight(s.spectral_radius)
    beta = displacement(s.spectral_radius)
    for i in range(s.n):
        mean = (0.5 - beta) * s.a[i] + beta * s.a_new[i]
        s.new[i] = y[i] + h * (v[i] + h * mean)
        new_v[i] = v[i] + h * ((1.0 - gamma) * s.a[i] + gamma * s.a_new[i])


def renew(s: GeneralizedAlpha, p: Parameters, after: float, h: float) -> int:
    """Factor Newton's matrix of the balance at `after`; return 0 if singular, else 1.

    The matrix is (1 - alpha_m) - (1 - alpha_f)(h^2 beta Jq + h gamma Jv), with Jq and
    Jv the derivatives of the accelerations.

    after : the time after the step h.
    """
    n, J, factors, radius = s.n, s.J, s.factors, s.spectral_radius
    part = 1.0 - radius / (radius + 1.0)
    positions = part * h * h * displacement(radius)
    velocities = part * h * weight(radius)
    jacobian(after, s.new, p, J)
    width = s.dynamic.stop
    newton.zero_nonfinite(n * width, J)
    s.factorisations += 2.0
    s.factored_h = h
    for i in range(n):
        row = J[i * width :]
        factors[i * n : (i + 1) * n] = (
            -positions * row[:n] - velocities * row[s.velocities]
        )
        factors[i * n + i] += 1.0 - share(radius)
    return newton.decompose(1, n, n, factors, s.pivots)
