"""Projection onto the constraints: positions, then velocities.

Newton's method in the metric of M at the current iterate (Hairer and Wanner, Solving
ODEs II, section VII.2). The M-metric velocity projection never raises the kinetic
energy where the constraints are homogeneous in the velocities.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.interface import position_step, velocity_step
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.singular import record_health
from lagsim.methods.parts.state import State
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# What a Newton step leaves of a residual is rounding if this small against its terms.
# Terms know what a double can hold of a position, whatever else stands in the scene.
LAST = 2.0**-50
# No row gets a residual of more than this, of its terms, by what a step is off.
UNIT = 2.0**-53
# A residual this small against its terms is rounding.
ROUNDING = 2.0**-47
# Where steps no longer shrink, they are rounding if the residual is smaller than this.
STALLED = 1e-12
# A step this small against the coordinates that it moves is rounding, too: there may be
# rows all of whose terms vanish.
SMALL = 2.0**-46
MOST = 12


def meet_constraints(s: State, p: Parameters, t: float, h: float, new: Floats) -> int:
    """Project the state that a step h has led to; give 0 where that fails."""
    work = s.work
    if project(s, p, t, h, new, work) == 0:
        return 0
    record_health(s, work[s.n + 1], h)
    return 1


def project(
    s: State, p: Parameters, t: float, h: float, y: Floats, work: Floats
) -> int:
    """Project y in place; give 1 where Newton's method converged, else 0.

    h is the step that led to y. work : (n + 3,), where work[n + 1] is left as
    `velocity_step` gives it.
    """
    s.missed = 0.0
    for level in range(2):
        if project_level(level, s, p, t, h, y, work) == 0:
            return 0
    return 1


def met_part(s: State, order: float) -> float:
    """Give the part of a step whose rows meet the constraints as they are.

    Of one whose rows are the polynomial that its end was a value of: the residual grows
    from what it is at the start, rounding, to what the projection of the end began
    with, by this order. What moves is also off by the rounding of the time, relations
    of velocities by that of positions.
    """
    if s.fixed_rows == 0.0:
        return 0.0
    if s.missed <= UNIT:
        return 1.0
    return float((UNIT / s.missed) ** (1.0 / order))


def project_level(
    level: int, s: State, p: Parameters, t: float, h: float, y: Floats, work: Floats
) -> int:
    """Project the positions (level 0) or the velocities (1) alone."""
    n = s.n
    part = at(y, level * n)
    previous = 0.0
    for iteration in range(MOST):
        newton_step(level, t, y, p, work)
        if not is_finite(n, work):
            return 0
        if iteration == 0:
            s.missed = max(s.missed, work[n])
        # Residuals shrink by more than half, or they are rounding.
        stalled = iteration > 0 and work[n] >= 0.5 * previous
        done = work[n + 2] <= LAST or work[n] <= ROUNDING
        if not done:
            done = is_small(level, s, h, part, work) > 0
        if stalled:
            return 1 if done or work[n] <= STALLED else 0
        for i in range(n):
            part[i] += work[i]
        if done:
            return 1
        previous = work[n]
    return 0


def is_small(level: int, s: State, h: float, x: Floats, step: Floats) -> int:
    """Tell whether a step is rounding of what it moves, in the metric of diag M.

    What the forces could do within the step counts as size: the scale of a structure at
    rest. A coordinate counts by its share of the step: a heavy body that hardly moves
    says nothing of a light one that it is joined to.
    """
    n = s.n
    sizes = at(s.sizes, level * n)
    masses = s.masses
    parts = s.parts
    moment = h if level > 0 else h * h
    moved = 0.0
    for i in range(n):
        moved += masses[i] * step[i] * step[i]
    if moved == 0.0:
        return 1
    whole = 0.0
    for i in range(n):
        share = masses[i] * step[i] * step[i] / moved
        largest = max(abs(x[i]), sizes[i], moment * parts[i])
        whole += share * masses[i] * largest * largest
    return 1 if moved <= SMALL * SMALL * whole else 0


def newton_step(level: int, t: float, y: Floats, p: Parameters, out: Floats) -> None:
    """Give the Newton step of the positions (level 0) or of the velocities (1)."""
    if level == 0:
        position_step(t, y, p, out)
    else:
        velocity_step(t, y, p, out)


def is_finite(n: int, step: Floats) -> bool:
    """Tell whether a step (n,) can be made."""
    largest = 0.0
    for i in range(n):
        if not abs(step[i]) < 1e300:
            largest = 1e300
    return largest < 1e300


def largest_part(level: int, s: State, h: float, x: Floats, step: Floats) -> float:
    """Give the largest part of its own size by which a step (n,) changes a component.

    Of the positions (level 0) or the velocities x. No other body enters, however heavy
    or far. What the forces could do in the time h counts as size; what has none changes
    by the whole of itself.
    """
    n = s.n
    sizes = at(s.sizes, level * n)
    parts = s.parts
    moment = h if level > 0 else h * h
    largest = 0.0
    for i in range(n):
        change = abs(step[i])
        if not change < 1e300:
            return 1e300
        if change > 0.0:
            own = max(abs(x[i]), sizes[i], moment * parts[i])
            part = change / own if change < own * 1e300 else 1.0
            largest = max(largest, part)
    return float(largest)
