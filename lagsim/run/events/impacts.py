"""Moving constraints whose rate jumps: an inelastic impact."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.notes import Event
from lagsim.run.events.modes import ON
from lagsim.run.states import pulled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.arcs import Run

# A moving constraint whose residual jumps by more than this, against its scale, tears.
TORN = 1e-6


# What the rounding of a state does to a rate, times this, is no jump.
ROUNDING = 16.0
# Units in the last place of the time by which a row stands before an impact.
BEFORE = 8.0


def row_before(run: Run) -> Floats:
    """Give the columns (1, k) just before the time reached, dated then.

    Where all switches still are as they were; before they are set anew.
    """
    n = run.system.n
    moment = BEFORE * np.spacing(abs(run.t))
    row = run.row()
    row[0, 0] -= moment
    row[0, 1 : 1 + n] -= moment * run.y[n : 2 * n]
    columns = run.runner.tabulate(row)
    columns[0, 0] = run.t
    return columns


def impact(run: Run, row: Floats) -> bool:
    """Meet a constraint whose rate jumps: the velocities are projected.

    That is the inelastic impact, the least change in the metric of M. Gives whether
    a position has jumped instead, which no motion can follow. row : what `row_before`
    gave.
    """
    before = run.observed()
    names = run.system.columns.names
    for constraint in run.equations.rows:
        g = before[names.index(f"residual_{constraint.name}")]
        scale = before[names.index(f"scale.{constraint.name}")]
        if constraint.holonomic and abs(g) > TORN * scale and _is_far(run):
            run.torn = constraint.name
            return True
    n = run.system.n
    step = run.runner.function("velocity_step")(run.t, run.y)[:n]
    if not _strikes(run, step):
        return False
    run.hand_on(row)
    run.y[n : 2 * n] += step
    if run.system.has_work:
        energy = names.index("energy")
        run.y[2 * n] += run.observed()[energy] - before[energy]
    run.events.append(Event(run.t, "impact"))
    if run.row_time(0) > run.t:
        run.emit(run.row())
    return False


def _strikes(run: Run, step: Floats) -> bool:
    """Tell whether velocities jump by more than the rounding of the state explains."""
    n, size = run.system.n, run.system.size
    seen = np.maximum(np.abs(run.y), run.sizes)
    steps = run.runner.function("velocity_step")
    noise = np.zeros(n)
    for sign in (1.0, -1.0):
        moment = ON * max(abs(run.t), run.simulation.end - run.simulation.start)
        aside = np.array([1.0 if i % 2 else sign for i in range(size)])
        moved = steps(run.t + moment, run.y + ON * aside * seen)[:n]
        noise = np.fmax(noise, np.abs(moved - step))
    noise += ON * seen[n : 2 * n]
    most = TORN * 1e-3 * run.ranges[n : 2 * n] + ROUNDING * noise
    return bool(np.any(np.abs(step) > most))


def _is_far(run: Run) -> bool:
    """Tell whether the constraints ask for another position.

    Against the motion so far of what they move: at one place all terms of a residual
    may vanish.
    """
    n = run.system.n
    masses = np.maximum(run.state.masses[:n], 0.0)
    step = run.runner.function("position_step")(run.t, run.y)[:n]
    return pulled(masses, step, run.ranges[:n], run.sizes[:n]) > TORN
