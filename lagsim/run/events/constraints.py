"""Impacts on constraints, coordinate singularities, and losses of constraint rank.

A jump in the rate of a moving constraint causes an inelastic impact. So does the corner
of a constraint with a kink: the motion continues past the corner if the velocities
after the impact lead onto the new side, else it stops there, see `Switching.stop`.

The inertia of an angle is m r^2 in polar coordinates, m l^2 sin^2 theta for the azimuth
of a spherical pendulum, and a pivot of M for Euler angles. Where an inertia falls to a
small part of its largest value, its coordinate is nearly undefined, the coordinate's
rate is huge, and steps are short although the motion is smooth. The kernels check the
inertias after every step (`methods.parts.driver`), since the rows of the table may miss
such a moment.

Where the constraint Jacobian loses rank, the dependent constraints are reported.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import weakest_rows
from lagsim.admissibility.refusal import admitted_inertia, gimbal_lock
from lagsim.codes.known import COORDINATE_SINGULARITY, NEARLY_DEPENDENT, RANK
from lagsim.language.columns import RESIDUAL
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import Instant
from lagsim.mechanics.ldl import dense_operations
from lagsim.mechanics.pieces import whole
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Event
from lagsim.plan.plan import by_loops, usual_lengths, without_partition
from lagsim.program.system import System
from lagsim.run.arc import NO_LOSS, shift
from lagsim.run.events.corner_sides import corner_events
from lagsim.run.events.impulses import transmit
from lagsim.run.events.records import Before, SurfacesAt
from lagsim.run.modes import EqualitiesAlone
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome, Source
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    RESIDUAL_ROUNDOFF,
    SAME_TIME,
    SATISFIED,
    SUM_ROUNDOFF,
    SURFACE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.plan.plan import Plan
    from lagsim.run.arc import Arc
    from lagsim.run.events.switching import Switching


def before_event(arc: Arc) -> Before:
    """Return the table row just before the state reached, with the present modes.

    The velocity error on the constraints at that state is part of the result.
    """
    n = arc.system.n
    moment = SAME_TIME * np.spacing(abs(arc.t))
    row = arc.row()
    row[0, 0] -= moment
    row[0, 1 : 1 + n] -= moment * arc.y[arc.velocities]
    columns = arc.runner.tabulate(row)
    columns[0, 0] = arc.t
    return Before(columns, _velocity_errors(arc))


def row_of(arc: Arc) -> Before:
    """Return the table row of the state reached, without an error of velocities."""
    return Before(arc.runner.tabulate(arc.row()), np.zeros(arc.system.n))


def at_start(arc: Arc) -> Before:
    """Return the table row at the start of the run, and the velocity error there.

    Switches of t have their values at the start itself in the row, and keep these
    values in the memory; the first arc has the values just after the start. Called
    within a selection of modes.
    """
    discrete = [mode.discrete for mode in arc.system.switches.modes]
    values = {**arc.parameters, "t": arc.t}
    arc.system.set_modes(
        [float(x) for x in evaluate(arc.equations.graph, discrete, values)]
    )
    arc.runner.prepare()
    return Before(arc.runner.tabulate(arc.row()), _velocity_errors(arc))


def _velocity_errors(arc: Arc) -> Floats:
    """Return the present error (n,) of the velocities on the constraints.

    An impact does not remove this error. It is 0 if each step is projected; else it is
    the Newton step of the velocities onto the constraints.
    """
    if arc.plan.projected:
        return np.zeros(arc.system.n)
    return _newton_step(arc, "velocity")


def _newton_step(arc: Arc, level: str) -> Floats:
    """Return the Newton step (n,) onto the constraints at the state reached.

    level : "position" or "velocity", the components that are changed.
    """
    return arc.runner.function(f"{level}_step")(arc.t, arc.y)[: arc.system.n]


def inelastic_impact(
    arc: Arc, before: Before, switching: Switching | None, surfaces: SurfacesAt
) -> tuple[Decision, SurfacesAt]:
    """Apply the inelastic impact of constraints whose rate jumps.

    The velocities are projected onto the constraints by the least change in the metric
    of M, as if no law acted: the impacts of laws that then approach are added to the
    jump later. If the position that a holonomic constraint prescribes jumps, the run
    ends.

    Parameters
    ----------
    arc : Arc
        The arc that has ended, at the state reached.
    before : Before
        The row and the velocity error just before the instant.
    switching : Switching or None
        The switching surfaces of the run, for corners.
    surfaces : SurfacesAt
        The surfaces at this instant.

    Returns
    -------
    Decision
        `GO_ON` where the velocities jump by no more than rounding.
    SurfacesAt
        The surfaces, with the corners at which velocities are stopped.
    """
    from lagsim.run.events.switching import corners_met

    now = arc.observed()
    bent, rests = corners_met(arc, surfaces.levels), list[Event]()
    with EqualitiesAlone(arc):
        jumps = "" if before.compared else _jumping(arc, before, now, bent)
        if jumps:
            return Decision(ending=Ending(Outcome.CONSTRAINT_JUMPS, jumps)), surfaces
        step = _newton_step(arc, "velocity") - before.off
        if not _strikes(arc, step, before.off):
            return GO_ON, surfaces
        before.row[0, 0] = arc.t
        y = arc.y.copy()
        if switching is not None and arc.system.switches.bends:
            rests, stopped = switching.stop(arc, y, surfaces, before.off)
            surfaces = surfaces._replace(stopped=stopped)
        else:
            y[arc.velocities] += step
    energy = float(arc.add_work(y, arc.energies(arc.y, now)).sum())
    given = transmit(arc, arc.y, y, np.zeros(len(arc.equations.laws)))
    events = [Event(arc.t, "impact")]
    if switching is not None and bent:
        events = [*corner_events(arc, bent, energy), *rests]
    found = Decision(events=tuple(events), rows=before.row, y=y, impulses=given)
    return found, surfaces


def _jumping(arc: Arc, before: Before, now: Floats, bent: list[int]) -> str:
    """Return the name of a holonomic constraint whose residual has jumped, or "".

    The position that the constraint prescribes has then jumped, and no motion can
    continue.

    before : the table row before the instant.
    now : ndarray, shape (k,), the columns of the table at the state reached.
    bent : the indices of the corners that the state is on.
    """
    names = arc.system.columns.names
    for constraint in arc.equations.rows:
        at = names.index(RESIDUAL.of(constraint.name))
        g = now[at] - before.row[0, at]
        scale = now[names.index(f"scale:{constraint.name}")]
        far = constraint.holonomic and abs(g) > SATISFIED * scale
        if far and _is_far(arc, bent):
            return constraint.name
    return ""


def _strikes(arc: Arc, step: Floats, off: Floats) -> bool:
    """Whether velocities jump by more than the rounding of the state explains.

    The magnitude of a velocity that constraints hold at 0 is rounding alone. Therefore
    the change of velocities by the forces in one step is added to their magnitudes.

    Parameters
    ----------
    arc : Arc
        The arc that has ended, at the state reached.
    step, off : ndarray, shape (n,)
        The jump of the velocities, and their error before it.
    """
    n, size = arc.system.n, arc.system.size
    magnitudes = arc.magnitudes.copy()
    magnitudes[arc.velocities] += arc.state.step_h * arc.state.parts[:n]
    steps = arc.runner.function("velocity_step")
    roundoff = np.zeros(n)
    for sign in (1.0, -1.0):
        moment = RESIDUAL_ROUNDOFF * max(abs(arc.t), arc.settings.duration)
        aside = np.array([1.0 if i % 2 else sign for i in range(size)])
        displaced = steps(
            arc.t + moment, arc.y + RESIDUAL_ROUNDOFF * aside * magnitudes
        )[:n]
        roundoff = np.fmax(roundoff, np.abs(displaced - off - step))
    roundoff += RESIDUAL_ROUNDOFF * magnitudes[arc.velocities]
    most = SATISFIED * 1e-3 * arc.ranges[arc.velocities] + CLEAR_OF_ROUNDING * roundoff
    return bool(np.any(np.abs(step) > most))


def _is_far(arc: Arc, bent: Collection[int]) -> bool:
    """Whether the position is farther from the constraints than the tolerance.

    The distance is relative to the ranges of the coordinates so far, since all terms of
    a residual may vanish at one position. The displacement by a jump of a rate within
    the rounding of the time is subtracted, and the rounding of the displacement by
    forces in the last step, since the range of a body at rest is its rounding. At a
    corner of `bent`, the indices of corners, the distance may be the rounding of the
    surface's expression.
    """
    n = arc.system.n
    step, rates = (np.abs(_newton_step(arc, x)) for x in ("position", "velocity"))
    rounded = SUM_ROUNDOFF * arc.state.parts[:n] * arc.state.step_h**2
    step -= SAME_TIME * np.spacing(abs(arc.t)) * rates + rounded
    step = np.maximum(step, 0.0)
    if bent and np.all(arc.masses > 0.0):
        (_, _, _, scales), J = arc.surface_rows(arc.t, arc.y)
        lengths = np.sqrt(J[:, :n] ** 2 @ (1.0 / arc.masses))
        off = max(float(scales[k] / lengths[k]) for k in bent)
        if np.sqrt(arc.masses @ step**2) <= SURFACE_ROUNDOFF * off:
            return False
    return shift(arc.masses, step, arc.ranges[:n], arc.sizes[:n]) > SATISFIED


# An inertia below this part of its largest value is nearly 0: the lever arm is a 300th
# of its largest value. (Measured on an oscillator in polar coordinates that misses the
# pole by 1e-1, 3e-3 and 1e-5 of its amplitude: 20,600, 33,900 and 46,500 evaluations,
# errors of 2e-11, 1e-9 and 1e-8 of the range.)
VANISHING = 1e-5


def singularity_caution(arc: Arc) -> list[Caution]:
    """Return [warning of the coordinate whose inertia fell lowest], or []."""
    state = arc.state
    if not state.inertias or not arc.steps:
        return []
    pairs = zip(state.inertia_smallest, state.inertia_largest, strict=True)
    parts = [float(least / most) if most > 0.0 else 1.0 for least, most in pairs]
    vanishing = [(part, k) for k, part in enumerate(parts) if part < VANISHING]
    part, k = min((x for x in vanishing if not _is_held(arc, x[1])), default=(1.0, -1))
    if k < 0:
        return []
    name, when = arc.system.inertias[k], float(state.inertia_when[k])
    why = f"`{name}` is nearly undefined there (polar coordinates at the pole, angles "
    why += "at gimbal lock)"
    instead = "Cartesian coordinates, or angles with their pole elsewhere, avoid this"
    if frame := gimbal_lock(_smallest(arc, k), [name]):
        why = f"the angles of the frame `{frame}` are in gimbal lock there"
        instead = "a `quaternion`, or other `axes`, avoid this"
    text = (
        f"at t = {when:.9g} the inertia of `{name}` falls to {part:.1g} of its "
        f"largest value: {why}, which alone makes the steps short; {instead}"
    )
    return [Caution(COORDINATE_SINGULARITY, text)]


def _is_held(arc: Arc, k: int) -> bool:
    """Whether inertia k vanishes only in directions that the constraints exclude.

    If so, its smallest value is no singularity: for example, the components of a
    quaternion have no inertia along the quaternion itself, whose length is 1. Only the
    inertia of motions that the constraints admit is compared with the largest one.
    """
    e, name = arc.system.equations, arc.system.inertias[k]
    if not e.rows or name not in e.q:
        return False
    found = admitted_inertia(_smallest(arc, k), e.q.index(name))
    return not found < VANISHING * float(arc.state.inertia_largest[k])


def _smallest(arc: Arc, k: int) -> Point:
    """Return the state at which inertia k was smallest so far."""
    state = arc.state
    where = state.inertia_where.reshape(state.inertias, -1)[k]
    blocks = state.positions, state.velocities, state.first_order
    there = Instant(float(state.inertia_when[k]), *(where[x] for x in blocks))
    return Point(arc.system.equations, there)


# Largest number of multiplications, about a second, of the dense QR decomposition.
MOST_DENSE = 10**9


class NearDependence(Source):
    """Source that changes to QR decomposition where rows become nearly dependent."""

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision to solve by QR where rows become nearly dependent.

        The decision is a warning alone where QR would cost too much. None for codes of
        the kernel other than `DEGENERATE`.

        code : the kernel's return code.
        """
        if code != at.DEGENERATE:
            return None
        found = f"at t = {arc.t:.9g} the constraints become nearly dependent"
        then = "; from there on they are solved by a QR decomposition"
        few = dense_operations(arc.system.n, arc.system.m) <= MOST_DENSE
        if not few:
            then = ", and there are too many for a QR decomposition: from there "
            then += "on multipliers may lose digits"
        cautions = (Caution(NEARLY_DEPENDENT, found + then),)
        if not few:
            return Decision(cautions=cautions, numbers={"degenerate_below": 0.0})
        return Decision(cautions=cautions, arc=_by(arc, by_loops(arc.plan)))


# With a smaller part of the usual smallest singular value of the rows, where the volume
# of a block vanishes, the rows lose their rank.
VANISHED = 1e-2
UNDETERMINED = "the independent coordinates no longer determine the others"
# Codes of kernels at which a partition is given up.
LOST_CODES = (
    at.DEGENERATE, at.LOSS_AHEAD, at.NOT_FINITE, at.STEP_TOO_SMALL,
    at.PROJECTION_FAILED, at.NEWTON_FAILED,
)  # fmt: skip


class LostPartition(Source):
    """Source that changes to the solution by M^-1 where a partition fails.

    A partition takes some coordinates as independent, and solves the constraint rows
    for the others in blocks. It fails where the volume of a block (its determinant with
    rows of length 1) becomes small, or where the method fails.
    """

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision to solve by M^-1; None for codes of other sources.

        None if the rows themselves lose their rank, or without a partition. code : the
        kernel's return code.
        """
        lost = code == at.RANK_LOST and not _lose_rank(arc)
        if not arc.plan.blocks or not (lost or code in LOST_CODES):
            return None
        plan = without_partition(arc.plan, UNDETERMINED)
        last = plan.choices[-1]
        last = last._replace(choice=f"{last.choice} from t = {arc.t:.9g} on")
        numbers = {"h": 0.0, **NO_LOSS}
        return Decision(choices=(last,), arc=_by(arc, plan), numbers=numbers)


def _by(arc: Arc, plan: Plan) -> Arc:
    """Return the arc at its present state, solved by another plan."""
    return arc.by(plan, System(arc.equations, plan, quick=arc.system.quick))


def _lose_rank(arc: Arc) -> bool:
    """Whether the rows lose their rank at the time of a loss that the kernel found."""
    time, n = arc.state.lost_at, arc.system.n
    y = arc.state.work[: arc.system.size]
    q, v, s = y[:n], y[n : 2 * n], y[arc.state.first_order]
    e = arc.system.equations
    point = Point(e, Instant(time, q, v, s))
    _, smallest = weakest_rows(point, arc.plan.rank, arc.plan.lengths)
    return bool(smallest <= VANISHED * arc.plan.smallest_singular_value)


# Rows with a larger component in the left null vector than this are reported.
HEAVY = 1e-3


class RankLosses(Source):
    """Source that reports losses of rank of a run, once for each set of constraints."""

    def __init__(self) -> None:
        # Lengths of the rows of the equalities, by the names of the rows.
        self._usual: dict[tuple[str, ...], tuple[float, ...]] = {}

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the events and the warning for a loss of rank, with its constraints.

        None for codes of the kernel other than `RANK_LOST`.

        code : the kernel's return code.
        """
        if code != at.RANK_LOST:
            return None
        time = arc.state.lost_at
        at_loss = arc.state.work[: arc.system.size]
        full = len(arc.equations.q)
        row = arc.runner.tabulate(np.array([[time, *at_loss]]))[0]
        q, v = row[1 : 1 + full], row[1 + full : 1 + 2 * full]
        s = at_loss[arc.state.first_order]
        at_times = _held_at_times(arc)
        equations = replace(arc.equations, rows=arc.equations.rows + at_times)
        all_names = tuple(row.name for row in equations.rows)
        if all_names not in self._usual:
            self._usual[all_names] = usual_lengths(equations, arc.start)
        rank = arc.plan.rank + len(arc.plan.reduction.eliminated) + len(at_times)
        point = Point(equations, Instant(time, q, v, s))
        left, smallest = weakest_rows(point, rank, self._usual[all_names])
        rows = zip(all_names, np.abs(left) > HEAVY, strict=True)
        names = tuple(dict.fromkeys(whole(name) for name, is_in in rows if is_in))
        events = tuple(Event(time, "rank", name, smallest) for name in names)
        listed = ", ".join(names)
        text = (
            f"at t = {time:.9g} the constraints {listed} become dependent "
            f"(smallest singular value {smallest:.1e}): a singular configuration, "
            "where motions branch; their multipliers are large around it"
        )
        return Decision(events, self.once(RANK, text, listed))


def _held_at_times(arc: Arc) -> tuple[Row, ...]:
    """Return the rows of equalities with a condition `when` that hold in the arc."""
    if not arc.system.laws:
        return ()
    held = arc.system.law_table.equal & (arc.system.p.law_mode == kept.HELD)
    return tuple(arc.system.laws[k].row for k in np.flatnonzero(held).tolist())
