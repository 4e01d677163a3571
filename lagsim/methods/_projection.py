"""Projection onto the constraints: positions, then velocities.

Newton's method in the metric of M at the current iterate (Hairer and Wanner, Solving
ODEs II, section VII.2). The M-metric velocity projection never raises the kinetic
energy where the constraints are homogeneous in the velocities.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods._interface import position_step, velocity_step
from lagsim.native.kernel_types import at

if TYPE_CHECKING:
    from lagsim.native.kernel_types import Floats

# A Newton step this small, relative to the sizes, leaves less than rounding behind:
# convergence is quadratic.
LAST = 1e-8
# Where steps no longer shrink, they are rounding if smaller than this.
STALLED = 1e-10
MOST = 12
# Not worth a correction: a quarter of a unit in the last place.
NOTHING = 2.0**-54


def project(n: int, t: float, y: Floats, p: Floats, sizes: Floats, work: Floats) -> int:
    """Project y in place; give 1 where Newton's method converged, else 0.

    sizes : (2 n,), work : (n + 1,), where work[n] is left as the worst pivot ratio.
    """
    previous = 0.0
    settled = False
    for iteration in range(MOST):
        if not settled:
            position_step(t, y, p, work)
            change = relative_size(n, work, sizes)
            if not change < 1e300:
                return 0
            if iteration > 0 and change >= 0.5 * previous:
                if change > STALLED:
                    return 0
                settled = True
            elif change > NOTHING:
                for i in range(n):
                    y[i] += work[i]
            if change < LAST:
                settled = True
            previous = change
    if not settled:
        return 0
    return project_velocities(n, t, y, p, sizes, work)


def project_velocities(
    n: int, t: float, y: Floats, p: Floats, sizes: Floats, work: Floats
) -> int:
    """Project the velocities of y in place; arguments and result as `project`."""
    previous = 0.0
    for iteration in range(MOST):
        velocity_step(t, y, p, work)
        change = relative_size(n, work, at(sizes, n))
        if not change < 1e300:
            return 0
        if iteration > 0 and change >= 0.5 * previous:
            if change > STALLED:
                return 0
            return 1
        if change > NOTHING:
            for i in range(n):
                y[n + i] += work[i]
        if change < LAST:
            return 1
        previous = change
    return 0


def relative_size(n: int, step: Floats, sizes: Floats) -> float:
    """Give the largest |step_i| / sizes_i over the components that have a size."""
    largest = 0.0
    for i in range(n):
        if sizes[i] > 0.0:
            change = abs(step[i]) / sizes[i]
            if not change <= largest:
                largest = change
    return largest
