"""Moving constraints whose rate jumps: an inelastic impact."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.notes import Event
from lagsim.run.arc import pulled
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    RESIDUAL_ROUNDOFF,
    SAME_TIME,
    SATISFIED,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc


class Before(NamedTuple):
    """What was just before the time reached: columns (1, k), dated then.

    And by how much velocities (n,) were off the constraints: what has drifted away from
    them, or is pulled back only slowly, is no impact.
    """

    row: Floats
    off: Floats


def before_event(arc: Arc) -> Before:
    """Look at the state reached where all switches still are as they were."""
    n = arc.system.n
    moment = SAME_TIME * np.spacing(abs(arc.t))
    row = arc.row()
    row[0, 0] -= moment
    row[0, 1 : 1 + n] -= moment * arc.y[n : 2 * n]
    columns = arc.runner.tabulate(row)
    columns[0, 0] = arc.t
    return Before(columns, _off(arc))


def at_start(arc: Arc) -> Before:
    """Look at the start with switches in time as they are written at that instant.

    In the first arc they are what they are from there on.
    """
    discrete = [mode.discrete for mode in arc.system.switches.modes]
    values = {**arc.parameters, "t": arc.t}
    arc.system.set_modes(
        [float(x) for x in evaluate(arc.equations.graph, discrete, values)]
    )
    arc.runner.prepare()
    return Before(arc.runner.tabulate(arc.row()), _off(arc))


def _off(arc: Arc) -> Floats:
    """Give by how much velocities (n,) are off the constraints and may be."""
    n = arc.system.n
    if arc.plan.projected:
        return np.zeros(n)
    return arc.runner.function("velocity_step")(arc.t, arc.y)[:n]


def impact(arc: Arc, before: Before) -> Decision:
    """Meet a constraint whose rate jumps: the velocities are projected.

    That is the inelastic impact, the least change in the metric of M. No motion can
    follow a position that jumps.
    """
    now = arc.observed()
    names = arc.system.columns.names
    for constraint in arc.equations.rows:
        at = names.index(f"residual_{constraint.name}")
        g = now[at] - before.row[0, at]
        scale = now[names.index(f"scale.{constraint.name}")]
        if constraint.holonomic and abs(g) > SATISFIED * scale and _is_far(arc):
            return Decision(ending=Ending(Outcome.CONSTRAINT_JUMPS, constraint.name))
    n = arc.system.n
    step = arc.runner.function("velocity_step")(arc.t, arc.y)[:n] - before.off
    if not _strikes(arc, step, before.off):
        return GO_ON
    arc.meet_row()
    before.row[0, 0] = arc.t
    y = arc.y.copy()
    y[n : 2 * n] += step
    works = slice(2 * n, 2 * n + arc.system.works)
    y[works] += arc.energies(y) - arc.energies(arc.y, now)
    return Decision(events=(Event(arc.t, "impact"),), rows=before.row, y=y)


def _strikes(arc: Arc, step: Floats, off: Floats) -> bool:
    """Tell whether velocities jump by more than the rounding of the state explains."""
    n, size = arc.system.n, arc.system.size
    seen = arc.seen
    steps = arc.runner.function("velocity_step")
    noise = np.zeros(n)
    for sign in (1.0, -1.0):
        moment = RESIDUAL_ROUNDOFF * max(abs(arc.t), arc.settings.duration)
        aside = np.array([1.0 if i % 2 else sign for i in range(size)])
        moved = steps(arc.t + moment, arc.y + RESIDUAL_ROUNDOFF * aside * seen)[:n]
        noise = np.fmax(noise, np.abs(moved - off - step))
    noise += RESIDUAL_ROUNDOFF * seen[n : 2 * n]
    most = SATISFIED * 1e-3 * arc.ranges[n : 2 * n] + CLEAR_OF_ROUNDING * noise
    return bool(np.any(np.abs(step) > most))


def _is_far(arc: Arc) -> bool:
    """Tell whether the constraints ask for another position.

    Against the motion so far of what they move: at one place all terms of a residual
    may vanish. What the jump of a rate does within the rounding of the time is no way.
    """
    n = arc.system.n
    step, rates = (
        np.abs(arc.runner.function(f"{name}_step")(arc.t, arc.y)[:n])
        for name in ("position", "velocity")
    )
    step = np.maximum(step - SAME_TIME * np.spacing(abs(arc.t)) * rates, 0.0)
    return pulled(arc.masses, step, arc.ranges[:n], arc.sizes[:n]) > SATISFIED
