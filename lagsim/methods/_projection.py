"""Projection onto the constraints: positions, then velocities.

Newton's method in the metric of M at the current iterate (Hairer and Wanner, Solving
ODEs II, section VII.2). The M-metric velocity projection never raises the kinetic
energy where the constraints are homogeneous in the velocities.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods._interface import position_step, velocity_step
from lagsim.methods._singular import record_health
from lagsim.methods._state import HEADER, SIZE, N
from lagsim.native.kernel_types import at

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

# A Newton step this small leaves less than rounding behind: convergence is quadratic.
LAST = 1e-8
# A residual this small against its terms is rounding.
ROUNDING = 2.0**-47
# Where steps no longer shrink, they are rounding if smaller than this.
STALLED = 1e-10
MOST = 12


def meet_constraints(s: Floats, p: Floats, t: float, h: float, new: Floats) -> int:
    """Project the state that a step h has led to; give 0 where that fails."""
    n = int(s[N])
    size = int(s[SIZE])
    work = at(s, HEADER + 4 * size + 2)
    sizes = at(s, HEADER + size)
    masses = at(s, HEADER + 3 * size + 2)
    if project(n, t, h, new, p, sizes, masses, work) == 0:
        return 0
    record_health(s, work[n + 1], h)
    return 1


def project(
    n: int,
    t: float,
    h: float,
    y: Floats,
    p: Floats,
    sizes: Floats,
    masses: Floats,
    work: Floats,
) -> int:
    """Project y in place; give 1 where Newton's method converged, else 0.

    h is the step that led to y; sizes : (2 n,), the largest sizes of positions and
    velocities so far; masses : (n + 1,), the diagonal of M and f^2/M as `measure` gives
    them; work : (n + 2,), where work[n + 1] is left as `velocity_step` gives it.
    """
    for level in range(2):
        if project_level(level, n, t, h, y, p, sizes, masses, work) == 0:
            return 0
    return 1


def project_level(
    level: int,
    n: int,
    t: float,
    h: float,
    y: Floats,
    p: Floats,
    sizes: Floats,
    masses: Floats,
    work: Floats,
) -> int:
    """Project the positions (level 0) or the velocities (1) alone."""
    # What the forces could do within the step: the scale of a structure at rest.
    least = h * h * masses[n] * (h * h if level == 0 else 1.0)
    part = at(y, level * n)
    previous = 0.0
    for iteration in range(MOST):
        newton_step(level, t, y, p, work)
        change = relative_size(n, work, masses, part, at(sizes, level * n), least)
        if not change < 1e300:
            return 0
        stalled = iteration > 0 and change >= 0.5 * previous
        if stalled and change > STALLED and work[n] > ROUNDING:
            return 0
        if not stalled:
            for i in range(n):
                part[i] += work[i]
        if stalled or change < LAST or work[n] <= ROUNDING:
            return 1
        previous = change
    return 0


def newton_step(level: int, t: float, y: Floats, p: Floats, out: Floats) -> None:
    """Give the Newton step of the positions (level 0) or of the velocities (1)."""
    if level == 0:
        position_step(t, y, p, out)
    else:
        velocity_step(t, y, p, out)


def relative_size(
    n: int, step: Floats, masses: Floats, x: Floats, sizes: Floats, least: float
) -> float:
    """Give the size of a step against that of x, both in the metric of diag M.

    The square of x counts as not less than `least`.
    """
    moved = 0.0
    whole = 0.0
    for i in range(n):
        size = max(abs(x[i]), sizes[i])
        moved += masses[i] * step[i] * step[i]
        whole += masses[i] * size * size
    if moved == 0.0:
        return 0.0
    return sqrt(moved / max(whole, least))
