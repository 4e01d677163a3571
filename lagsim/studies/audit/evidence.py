"""Evidence on a run: residuals of constraints and energies, from its rows.

A residual or an energy counts if it exceeds the rounding errors that the rows show. The
argument `run` of the functions is the evidence on the run, an `Evidence`.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.run.error import HIGHER, could_push, largest_beside
from lagsim.run.observers.monitors import (
    Checkpoints,
    EnergyMonitor,
    Gaps,
    ResidualMonitor,
)
from lagsim.studies.audit.balances import Balance, energy_error, group_balances
from lagsim.tolerances import PLACE_BESIDE, SATISFIED, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.run.error import ErrorBar
    from lagsim.run.session import Session
    from lagsim.run.trajectory import Trajectory

# The least unexplained change of the energy that raises a warning, relative to the
# energy in play: half of it, as an error of an amplitude, is about the width of a line
# in a picture, and the drift at the default tolerance is a million times smaller.
UNEXPLAINED = 1e-3
# Safety factor of the energy error that the errors of the state explain, to first order
# and with all errors in the worst direction.
FAR = 100.0
# A residual up to this multiple of its rounding satisfies its constraint: a projection
# ends within some units in the last place of each coordinate.
ROUNDED = 16.0


class Evidence:
    """Evidence for the audit and the warnings of a run, with its result and error bar.

    A repeat is audited too, since a repeat that is not valid is no reason to reject the
    run.

    Parameters
    ----------
    session : Session
        The session of the run.
    stride : int
        Output intervals from one checkpoint to the next; 0 to store none.

    Attributes
    ----------
    gaps : Gaps
        Values that are not finite.
    residuals : ResidualMonitor
        Constraint residuals with their scales, and the drift of energy - work.
    monitor : EnergyMonitor
        Energies and states of the rows.
    checkpoints : Checkpoints
        Rows that are compared with those of a repeat.
    trajectory : Trajectory
        The result of the run; set by `end`.
    bar : ErrorBar or str
        The error bar, or the reason why there is none; set by `end`.
    """

    trajectory: Trajectory
    bar: ErrorBar | str

    def __init__(self, session: Session, stride: int = 1) -> None:
        columns, settings = session.columns, session.case.settings
        self.session, self.plan = session, session.plan
        self.equations = session.equations
        self.gaps = Gaps(columns.names[: columns.table])
        self.residuals = ResidualMonitor(columns.names)
        self.monitor = EnergyMonitor(columns.names, self.equations)
        self.checkpoints = Checkpoints(self.equations, settings, stride)

    def add(self, rows: Floats) -> None:
        """Pass rows (k, columns) to the observers."""
        self.gaps.add(rows)
        self.residuals.add(rows)
        self.monitor.add(rows)
        if self.checkpoints.stride:
            self.checkpoints.add(rows)

    def end(self, trajectory: Trajectory, bar: ErrorBar | str) -> Self:
        """Store the result of the run and its error bar; return this object.

        The extremes of the state and the energy between rows, which the run recorded at
        its steps, are passed to the monitor.
        """
        self.monitor.between_rows = trajectory.largest_energy
        self.monitor.extents = trajectory.extents
        self.trajectory, self.bar = trajectory, bar
        return self

    @cached_property
    def balances(self) -> Sequence[Balance]:
        """The energy balances of all decoupled groups, then of the whole system.

        They are computed after the last row. With an absolute tolerance in the model or
        the options the groups are left out, since an absolute tolerance does not
        bound the relative error of a group with a small motion.
        """
        e, monitor, residuals = self.equations, self.monitor, self.residuals
        worst = residuals.drift.row
        worst = worst if worst is None else worst[e.state_columns]
        whole = Balance(
            range(len(e.q)), (), e.energy, monitor.energy_in_play, monitor.work_range,
            residuals.drift.size, residuals.energy_gained, worst,
            monitor.balance, monitor.passed, residuals.drift.since,
        )  # fmt: skip
        return [*(group_balances(e, monitor) if self.plan.atol is None else ()), whole]


def worst_residual(
    run: Evidence, coarse: tuple[float, Floats] | None = None
) -> tuple[str, float] | None:
    """Return the worst violated constraint and its residual relative to its scale.

    None if all constraints are satisfied.

    Parameters
    ----------
    coarse : tuple of float and ndarray, optional
        For a method that does not locate events: the time until it corrects a residual,
        and the largest speeds (n,).
    """
    for name, part, by_motion in _residuals_off(run, coarse):
        if not by_motion <= SATISFIED:
            return name, part
    return None


def constraint_residual(run: Evidence) -> float:
    """Return the largest relative residual of all constraints.

    A residual is relative to the scale of its constraint or to the motion of the
    coordinates in the constraint, whichever is larger. The value is inf or nan if a
    residual is not finite.
    """
    parts = run.residuals.constraint_parts
    off = {
        name: min(part, by_motion)
        for name, part, by_motion in _residuals_off(run, None)
    }
    return max((parts | off).values(), default=0.0)


def _residuals_off(
    run: Evidence, coarse: tuple[float, Floats] | None
) -> Iterator[tuple[str, float, float]]:
    """Yield constraints whose residual exceeds the part SATISFIED of their scale.

    Each item consists of

    - the name of the constraint,
    - the residual relative to the scale of the constraint,
    - the residual relative to the motion: the ranges of the coordinates times the
      slopes of the constraint; 0 for a residual within the rounding of its state. It
      decides where all terms of the constraint are close to 0, so that their size is no
      scale.

    Residuals that arise within one step are omitted.

    coarse : see `worst_residual`.
    """
    equations, start = run.equations, run.session.case.examined.state
    n, g, ranges = len(equations.q), equations.graph, run.monitor.ranges
    contacts = {x.name for x in equations.laws if x.gapped}
    names = run.session.columns.names
    for name, residual, part, values in run.residuals.constraints_off(SATISFIED):
        if not math.isfinite(residual):
            yield name, part, residual
            continue
        row = equations.row(name)
        range_of_motion = (
            ranges[1 : 1 + n] if row.holonomic else ranges[1 + n : 1 + 2 * n]
        )
        state = equations.model.parameter_values
        state |= dict(zip(names, values.tolist(), strict=False))
        if residual <= ROUNDED * _rounding(equations, row, state):
            yield name, part, 0.0
            continue
        slopes = np.abs(evaluate(g, list(row.A), state))
        if coarse is not None:
            left = _changed(equations, row, state, values, coarse[0])
            if name in contacts:
                still = state | dict.fromkeys(equations.velocities, 0.0)
                (moving,) = evaluate(g, [row.rate], still)
                left = coarse[0] * (float(slopes @ coarse[1]) + abs(moving))
            if residual <= left:
                continue
        # The motion of each coordinate that the largest motion can cause by inertia:
        # for a heavier body at most its own range, so that the motion of a light body
        # does not hide its residual; for a lighter one less, as the roots of the
        # masses.
        seed = largest_beside(inertia_roots(equations, start), range_of_motion)
        seed = PLACE_BESIDE * seed + motion_of_rest(run, range(n))[0]
        motion = float(slopes @ range_of_motion) + float(slopes @ seed) / SATISFIED
        yield name, part, residual / motion if motion > 0.0 else math.inf


def _rounding(equations: Equations, row: Row, state: Mapping[str, float]) -> float:
    """Return the error of a residual by the rounding of time, state and operations.

    state : values of parameters and columns by name.
    """
    inexact = {*equations.state, "t"}
    values = {
        name: (x, UNIT_ROUNDOFF * abs(x) if name in inexact else 0.0)
        for name, x in state.items()
    }
    ((_, error),) = evaluate_with_error(equations.graph, [row.residual], values)
    return error


def inertia_roots(equations: Equations, start: Instant) -> Floats:
    """Return the square roots of the mass matrix's diagonal at the start, (n,)."""
    diagonal = Point(equations, start).array(equations.inertias)
    return np.sqrt(np.fmax(diagonal, 0.0))


def _changed(
    equations: Equations, row: Row, state: Mapping[str, float], values: Floats, h: float
) -> float:
    """Return a bound of the residual of a constraint that one step of size h can cause.

    The step satisfies the linearised rate of the constraint with positions and time of
    half a step before.

    Parameters
    ----------
    row : Row
        The constraint.
    state : mapping
        Values of parameters and columns by name.
    values : ndarray
        The row of the table: time, coordinates, velocities, accelerations and more.
    """
    g, n = equations.graph, len(equations.q)
    q, v, a = values[1 : 1 + 3 * n].reshape(3, n)

    def rate(ago: float, more: float) -> float:
        x = {**state, "t": state["t"] - ago}
        x |= zip(equations.q, (q - ago * v).tolist(), strict=True)
        x |= zip(equations.velocities, (v + more * a).tolist(), strict=True)
        return float(evaluate(g, [row.rate], x)[0])

    now = rate(0.0, 0.0)
    off = max(abs(rate(part * h, 0.0) - now) for part in (0.25, 0.5, 1.0))
    off += abs(rate(0.0, h) - 2.0 * now + rate(0.0, -h))
    return h * (abs(now) + off) if row.holonomic else off


def motion_of_rest(run: Evidence, which: Sequence[int]) -> tuple[Floats, float]:
    """Return the motion that rounding causes in coordinates at rest, and its energy.

    Where forces balance, the rounding error of their sum moves a coordinate, and in a
    system at rest there is no larger motion to compare that motion with. A coordinate
    that moves farther than by rounding has the value 0.

    Parameters
    ----------
    which : sequence of int
        Indices of the coordinates considered.

    Returns
    -------
    displacements : ndarray, shape (n,)
        The motion in the units of the coordinates.
    energy : float
        The energy of this motion.
    """
    n, monitor = len(run.equations.q), run.monitor
    rows, span = monitor.passed, float(monitor.ranges[0])
    ranges = monitor.ranges[1 : 1 + n]
    found = could_push(
        run.equations, rows, which, span, monitor.constraint_forces, ranges
    )
    rests = ranges <= HIGHER * found.displacement
    displacements = np.where(rests, found.displacement, 0.0)
    return displacements, float(displacements @ found.forces)


def energy_rounding(run: Evidence, balance: Balance, times: float = FAR) -> float:
    """Return the rounding error of an energy at the worst row of a balance.

    It is the larger of two values: the rounding error by the state, by the work of
    constraint forces, and by positions that constraints determine, multiplied by
    `times`; and the energy of the motion that rounding causes at rest.
    """
    row, monitor, j = balance.worst_row, run.monitor, list(balance.coordinates)
    if row is None:
        return 0.0
    state = UNIT_ROUNDOFF * np.abs(row[1 : 1 + len(run.equations.state)])
    own = energy_error(run.equations, balance.energy, row, state)
    own += UNIT_ROUNDOFF * float(monitor.constraint_forces[j] @ monitor.ranges[1:][j])
    own += _energy_of_residuals(run, balance, state)
    return max(times * own, motion_of_rest(run, balance.coordinates)[1])


def _energy_of_residuals(run: Evidence, balance: Balance, state: Floats) -> float:
    """Return the change of energy by rounding errors of position constraints.

    A constraint is satisfied up to the rounding error r of its residual, which changes
    the energy by lambda r. The multiplier lambda is the least-squares fit to the
    largest constraint forces on all coordinates: at a kink the force on a single
    coordinate may be 0.

    balance : the balance of the energy, with its worst row.
    state : rounding errors (size,) of the state variables.
    """
    e, row, found = run.equations, balance.worst_row, 0.0
    assert row is not None
    values = {name: (x, 0.0) for name, x in e.model.parameter_values.items()}
    values |= {"t": (float(row[0]), 0.0)}
    values |= zip(e.state, zip(row[1:].tolist(), state.tolist(), strict=False),
                  strict=False)  # fmt: skip
    for relation in (x for x in e.every_row if x.holonomic):
        own, nodes = (
            [*relation.A.entries],
            [relation.residual, *relation.A.entries.values()],
        )
        # The row of a slider without mass depends on its motion, too.
        unknown = e.graph.depends(nodes) - values.keys()
        if unknown or not set(own) <= set(balance.coordinates):
            continue
        (_, error), *slopes = evaluate_with_error(e.graph, nodes, values)
        sizes = np.abs([slope for slope, _ in slopes])
        if whole := float(sizes @ sizes):
            found += error * float(run.monitor.constraint_forces[own] @ sizes) / whole
    return found
