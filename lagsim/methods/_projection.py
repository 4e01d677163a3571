"""Projection onto the constraints: positions, then velocities.

Newton's method in the metric of M at the current iterate (Hairer and Wanner, Solving
ODEs II, section VII.2). The M-metric velocity projection never raises the kinetic
energy where the constraints are homogeneous in the velocities.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods._interface import (
    position_step,
    position_steps,
    velocity_step,
    velocity_steps,
)
from lagsim.methods._singular import record_health
from lagsim.methods._state import HEADER, LANES_AT, SIZE, STEP_H, N
from lagsim.native.kernel_types import apart, at, unrolled
from lagsim.native.sincos import LANES

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


def project_rows(s: Floats, p: Floats, rows: Floats, count: int) -> None:
    """Project up to LANES rows (count, 1 + size) of the last step, side by side.

    One Newton step is enough for nearly all; a row that needs more is done by itself.
    One that does not converge stays as it is.
    """
    n = int(s[N])
    size = int(s[SIZE])
    y = at(s, int(s[LANES_AT]))
    step = at(y, LANES * (1 + size))
    sizes = at(s, HEADER + size)
    masses = at(s, HEADER + 3 * size + 2)
    work = at(s, HEADER + 4 * size + 2)
    h = s[STEP_H]
    for level in range(2):
        for lane in unrolled(LANES):
            row = at(rows, min(lane, count - 1) * (1 + size))
            for i in range(1 + size):
                y[i * LANES + lane] = row[i]
        least = h * h * masses[n] * (h * h if level == 0 else 1.0)
        if level == 0:
            position_steps(0.0, y, p, step)
        else:
            velocity_steps(0.0, y, p, step)
        changes = at(step, LANES * (n + 2))
        relative_sizes(
            n, step, masses, at(y, LANES * (1 + level * n)), at(sizes, level * n),
            least, changes,
        )  # fmt: skip
        for lane in range(count):
            row = at(rows, lane * (1 + size))
            part = at(row, 1 + level * n)
            change = changes[lane]
            if change < LAST or (change < 1e300 and step[n * LANES + lane] <= ROUNDING):
                for i in range(n):
                    part[i] += step[i * LANES + lane]
            else:
                project_level(level, n, row[0], h, at(row, 1), p, sizes, masses, work)


def relative_sizes(
    n: int,
    step: Floats,
    masses: Floats,
    x: Floats,
    sizes: Floats,
    least: float,
    out: Floats,
) -> None:
    """Give `relative_size` of LANES steps; out : (2 LANES,), the second for work."""
    whole = at(out, LANES)
    for lane in apart(LANES):
        out[lane] = 0.0
        whole[lane] = 0.0
    for i in range(n):
        for lane in apart(LANES):
            move = step[i * LANES + lane]
            size = max(abs(x[i * LANES + lane]), sizes[i])
            out[lane] += masses[i] * move * move
            whole[lane] += masses[i] * size * size
    for lane in range(LANES):
        if out[lane] > 0.0:
            out[lane] = sqrt(out[lane] / max(whole[lane], least))
