"""Error tolerances from each component's own scale, and the first step.

The default tolerance of a component is rtol times the largest size it has had, and not
less than a natural floor, so that components which should stay zero are not controlled
at rounding level: for velocity i FLOOR * sqrt(2 E / M_ii), with E the largest kinetic
energy or change of potential so far; for coordinate i that times the step. No unit
enters: metres and millimetres give the same steps.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods._interface import derivative, measure
from lagsim.methods._state import (
    ARC_START,
    ATOL,
    END,
    ENERGY,
    EVALUATIONS,
    FORCES,
    HEADER,
    POTENTIAL,
    ROW_STEP,
    RTOL,
    SIZE,
    N,
    T,
)
from lagsim.native.kernel_types import at

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

FLOOR = 1e-3
# Of the length of an arc: too short to matter.
INSTANT = 1e-6
# No component is controlled below its share of the rounding of the whole motion.
NOISE = 4.0 * 2.0**-53
# Forces that cancel, as in equilibrium, leave rounding of their own size in y', which
# the error estimate enlarges a few times; control below that only wastes steps.
FORCE_NOISE = 32.0 * 2.0**-53
# A change of the state this small, against its size, shows how large the forces are.
PROBE = 2.0**-30
# A step over which energy or forces grow by more than this has blown up: what it blew
# up to is no scale for its error.
JUMP = 1e6
# The part of the tolerance that one step may use: errors of many steps add up, and the
# tolerance is meant for the motion (Kepler's, e = 0.6, 100 orbits: 6 digits at 1e-11).
LOCAL = 0.1


def record_sizes(s: Floats, p: Floats) -> None:
    """Take the state, accepted, into the largest sizes and the energy."""
    size = int(s[SIZE])
    record_extents(s)
    s[ENERGY] = energy_scale(s, p, s[T], at(s, HEADER))
    driven = at(s, HEADER + 3 * size + 2 + int(s[N]))
    s[FORCES] = max(s[FORCES], driven[0])


def record_extents(s: Floats) -> None:
    """Take the state into the largest sizes: all that a fixed step asks for."""
    size = int(s[SIZE])
    y = at(s, HEADER)
    sizes = at(s, HEADER + size)
    for i in range(size):
        sizes[i] = max(sizes[i], abs(y[i]))


def energy_scale(s: Floats, p: Floats, t: float, y: Floats) -> float:
    """Give the largest kinetic energy or change of potential, `y` included.

    Leaves what `measure` gives in the state.
    """
    measured = at(s, HEADER + 3 * int(s[SIZE]))
    measure(t, y, p, measured)
    if s[EVALUATIONS] <= 1.0:
        s[POTENTIAL] = measured[1]
    change = abs(measured[1] - s[POTENTIAL])
    return max(float(s[ENERGY]), abs(float(measured[0])), float(change))


def set_tolerances(
    s: Floats, p: Floats, t: float, new: Floats, rates: Floats, h: float
) -> None:
    """Set the tolerance of each component for a step of length h to `new` at t.

    new, rates : (size,), the state after the step and y' before it. A tolerance of 0
    means that the component has no scale and is not controlled.
    """
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    sizes = at(s, HEADER + size)
    tolerances = at(s, HEADER + 2 * size)
    if s[ATOL] >= 0.0:
        for i in range(size):
            scale = max(abs(y[i]), abs(new[i]))
            tolerances[i] = LOCAL * (s[ATOL] + s[RTOL] * scale)
        return
    masses = at(s, HEADER + 3 * size + 2)
    # A start from rest with a jump in the force (dry friction) is off by the same part
    # of every step, however short; what happens in an instant is not controlled finer.
    instant = INSTANT * (s[END] - s[ARC_START])
    moment = max(h, instant)
    energy = energy_after(s, p, t, new, moment)
    whole = 0.0
    for i in range(n):
        whole += masses[i] * sizes[i] * sizes[i]
    rtol = LOCAL * s[RTOL]
    for i in range(size):
        scale = max(sizes[i], abs(new[i]), moment * abs(rates[i]))
        if i < n:
            scale = max(scale, instant * instant * abs(rates[n + i]))
        mass = inertia(n, masses, i)
        if i >= 2 * n and mass == 0.0:
            noise = FORCE_NOISE * h * h * s[FORCES]
            tolerances[i] = max(rtol * max(scale, FLOOR * energy), noise)
        elif mass <= 0.0:
            tolerances[i] = rtol * scale
        elif i < n or i >= 2 * n:
            floor = FLOOR * sqrt(2.0 * energy / mass) * h
            tolerances[i] = max(rtol * max(scale, floor), NOISE * sqrt(whole / mass))
        else:
            floor = FLOOR * sqrt(2.0 * energy / mass)
            noise = NOISE / FLOOR * floor + FORCE_NOISE * h * sqrt(s[FORCES] / mass)
            tolerances[i] = max(rtol * max(scale, floor), noise)


def inertia(n: int, masses: Floats, i: int) -> float:
    """Give the inertia of component i of y, of its coordinate; of work 0."""
    if i < 2 * n:
        return float(masses[i % n])
    if n > 0:
        return float(masses[i - n + 1])
    return 0.0


def energy_after(s: Floats, p: Floats, t: float, new: Floats, moment: float) -> float:
    """Give the energy that is a scale for a step to `new` at t.

    What the forces could do in the `moment` counts as motion: at rest under load,
    nothing else gives a scale.
    """
    energy = energy_scale(s, p, t, new)
    driven = at(s, HEADER + 3 * int(s[SIZE]) + 2 + int(s[N]))
    force = driven[0]
    if s[FORCES] > 0.0:
        force = min(force, JUMP * s[FORCES])
    known = max(float(s[ENERGY]), 0.5 * moment * moment * force)
    if known > 0.0:
        energy = max(known, min(energy, JUMP * known))
    return energy


def probe_forces(s: Floats, p: Floats, k: Floats) -> None:
    """Find how large the forces are that may cancel in y', from y' nearby.

    The sum of M_ii a_i^2 with a_i the change of y' per relative change of y. Components
    change by different parts, or a change of the whole scene's size or place would
    hide what cancels.
    """
    size = int(s[SIZE])
    n = int(s[N])
    y = at(s, HEADER)
    masses = at(s, HEADER + 3 * size + 2)
    z = at(s, HEADER + 4 * size + 2)
    slopes = at(z, size)
    for i in range(size):
        part = 0.618033988749895 * (i + 1)
        z[i] = y[i] * (1.0 + PROBE * (0.5 + part - int(part)))
    derivative(s[T], z, p, slopes)
    s[EVALUATIONS] += 1.0
    forces = 0.0
    for i in range(n):
        change = (slopes[n + i] - k[n + i]) / PROBE
        forces += masses[i] * change * change
    if forces < 1e300:
        s[FORCES] = max(s[FORCES], forces)


def first_step(s: Floats, p: Floats, order: int, k: Floats) -> float:
    """Give a first step: one explicit Euler step tells the second derivative.

    Hairer, Norsett and Wanner, Solving ODEs I, II.4. k : (size,) is y' at the start.
    """
    size = int(s[SIZE])
    y = at(s, HEADER)
    z = at(s, HEADER + 4 * size + 2)
    slopes = at(z, size)
    tolerances = at(s, HEADER + 2 * size)
    probe_forces(s, p, k)
    set_tolerances(s, p, s[T], y, k, s[ROW_STEP])
    d0 = 0.0
    d1 = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            d0 += (y[i] / tolerances[i]) * (y[i] / tolerances[i])
            d1 += (k[i] / tolerances[i]) * (k[i] / tolerances[i])
    span = s[END] - s[T]
    h = min(1e-3 * s[ROW_STEP], span)
    if d0 > 1e-10 and d1 > 1e-10:
        h = min(0.01 * sqrt(d0 / d1), span)
    for i in range(size):
        z[i] = y[i] + h * k[i]
    derivative(s[T] + h, z, p, slopes)
    s[EVALUATIONS] += 1.0
    d2 = 0.0
    for i in range(size):
        if tolerances[i] > 0.0:
            bend = (slopes[i] - k[i]) / tolerances[i]
            d2 += bend * bend
    steepest = max(sqrt(d2) / h, sqrt(d1))
    if not steepest < 1e300:
        return float(1e-3 * h)
    guess = max(1e-6 * span, 1e-3 * h)
    if steepest > 1e-15:
        guess = (0.01 / steepest) ** (1.0 / order)
    return float(min(100.0 * h, guess, span))
