"""Moving constraints whose rate jumps: an inelastic impact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.methods import _state as at
from lagsim.trajectory import Event

if TYPE_CHECKING:
    from lagsim.simulate.arcs import Run

# A moving constraint whose residual jumps by more than this, against its scale, tears.
TORN = 1e-6


def impact(run: Run) -> bool:
    """Meet a constraint whose rate jumps: the velocities are projected.

    That is the inelastic impact, the least change in the metric of M. Gives whether
    a position has jumped instead, which no motion can follow.
    """
    before = run.observed()
    names = run.system.columns.names
    for row in run.equations.rows:
        g = before[names.index(f"residual_{row.name}")]
        scale = before[names.index(f"scale.{row.name}")]
        if row.holonomic and abs(g) > TORN * scale and _is_far(run):
            run.torn = row.name
            return True
    n = run.system.n
    step = run.runner.function("velocity_step")(run.t, run.y)[:n]
    sizes = run.state[at.HEADER + run.system.size + n :][:n]
    if np.all(np.abs(step) <= TORN * 1e-3 * np.maximum(sizes, 1e-300)):
        return False
    run.emit(run.row())
    run.y[n : 2 * n] += step
    if run.system.has_work:
        energy = names.index("energy")
        run.y[2 * n] += run.observed()[energy] - before[energy]
    run.events.append(Event(run.t, "impact"))
    if run.row_time(0) > run.t:
        run.emit(run.row())
    return False


def _is_far(run: Run) -> bool:
    """Tell whether the constraints ask for another position, in the metric of M.

    Against the motion so far: at one place all terms of a residual may vanish.
    """
    n, size = run.system.n, run.system.size
    masses = np.maximum(run.state[at.HEADER + 3 * size + 2 :][:n], 0.0)
    step = run.runner.function("position_step")(run.t, run.y)[:n]
    return bool(masses @ step**2 > TORN**2 * (masses @ run.sizes[:n] ** 2))
