"""Impacts of constraints, and singularities: of coordinates, and of their Jacobian.

A moving constraint whose rate jumps is met by an inelastic impact. So is the corner of
one with a kink: the motion goes on past it where that leads onto the new side, else it
stops there, see `Switching.stop`.

In polar coordinates the inertia of the angle is m r^2, of a spherical pendulum's
azimuth m l^2 sin^2 theta, and of Euler's angles a pivot of M is: where one of them
falls to a small part of its largest value, the coordinate hardly means anything, its
rate is huge, and steps are short though nothing happens. The inertias are looked at
after every step (`methods.parts.driver`), since rows may miss such a moment.

Where constraints lose rank, those that depend on each other are named.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import weakest_rows
from lagsim.admissibility.refusal import admitted_inertia, gimbal_lock
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import Instant
from lagsim.mechanics.ldl import dense_operations
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Event
from lagsim.plan.plan import by_loops, usual_lengths
from lagsim.program.system import System
from lagsim.run.arc import shift
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome, Source
from lagsim.tolerances import CLEAR_OF_ROUNDING, RESIDUAL_ROUNDOFF, SAME_TIME, SATISFIED

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc
    from lagsim.run.events.switching import Switching


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
    row[0, 1 : 1 + n] -= moment * arc.y[arc.velocities]
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
    """By how much velocities (n,) are off the constraints and may be."""
    if arc.plan.projected:
        return np.zeros(arc.system.n)
    return _newton_step(arc, "velocity")


def _newton_step(arc: Arc, level: str) -> Floats:
    """Newton step (n,) onto the constraints, of positions or velocities."""
    return arc.runner.function(f"{level}_step")(arc.t, arc.y)[: arc.system.n]


def impact(arc: Arc, before: Before, switching: Switching | None) -> Decision:
    """Meet a constraint whose rate jumps: the velocities are projected.

    That is the inelastic impact, the least change in the metric of M. No motion can
    follow a position that jumps.
    """
    now = arc.observed()
    names = arc.system.columns.names
    for constraint in arc.equations.rows:
        at = names.index(f"residual_{constraint.name}")
        g = now[at] - before.row[0, at]
        scale = now[names.index(f"scale:{constraint.name}")]
        if constraint.holonomic and abs(g) > SATISFIED * scale and _is_far(arc):
            return Decision(ending=Ending(Outcome.CONSTRAINT_JUMPS, constraint.name))
    step = _newton_step(arc, "velocity") - before.off
    if not _strikes(arc, step, before.off):
        return GO_ON
    before.row[0, 0] = arc.t
    y = arc.y.copy()
    y[arc.velocities] += step
    bent = [] if switching is None else switching.corners_met(arc)
    rests = switching.stop(arc, y, bent) if switching is not None and bent else []
    energy = float(arc.add_work(y, arc.energies(arc.y, now)).sum())
    events = [Event(arc.t, "impact")]
    if switching is not None and bent:
        events = [
            Event(arc.t, "corner", name, switch=switching.sides[k].text, energy=energy)
            for k in bent
            for name in arc.system.switches.corners[k].rows
        ]
        events += rests
    return Decision(events=tuple(events), rows=before.row, y=y)


def _strikes(arc: Arc, step: Floats, off: Floats) -> bool:
    """Whether velocities jump by more than the rounding of the state explains.

    What is held has no speed but that: what forces could do in a step is its scale.
    """
    n, size = arc.system.n, arc.system.size
    seen = arc.seen.copy()
    seen[arc.velocities] += arc.state.step_h * arc.state.parts[:n]
    steps = arc.runner.function("velocity_step")
    roundoff = np.zeros(n)
    for sign in (1.0, -1.0):
        moment = RESIDUAL_ROUNDOFF * max(abs(arc.t), arc.settings.duration)
        aside = np.array([1.0 if i % 2 else sign for i in range(size)])
        moved = steps(arc.t + moment, arc.y + RESIDUAL_ROUNDOFF * aside * seen)[:n]
        roundoff = np.fmax(roundoff, np.abs(moved - off - step))
    roundoff += RESIDUAL_ROUNDOFF * seen[arc.velocities]
    most = SATISFIED * 1e-3 * arc.ranges[arc.velocities] + CLEAR_OF_ROUNDING * roundoff
    return bool(np.any(np.abs(step) > most))


def _is_far(arc: Arc) -> bool:
    """Whether the constraints ask for another position.

    Against the motion so far of what they move: at one place all terms of a residual
    may vanish. What the jump of a rate does within the rounding of the time is no way.
    """
    n = arc.system.n
    step, rates = (np.abs(_newton_step(arc, x)) for x in ("position", "velocity"))
    step = np.maximum(step - SAME_TIME * np.spacing(abs(arc.t)) * rates, 0.0)
    return shift(arc.masses, step, arc.ranges[:n], arc.sizes[:n]) > SATISFIED


# An inertia below this part of its largest value is close to none: the lever arm is a
# 300th of what it was. (Measured on an oscillator in polar coordinates that misses the
# pole by 1e-1, 3e-3 and 1e-5 of its amplitude: 20,600, 33,900 and 46,500 evaluations,
# errors of 2e-11, 1e-9 and 1e-8 of the range.)
VANISHING = 1e-5


def singularity_caution(arc: Arc) -> list[Caution]:
    """Warn of the coordinate that came closest to losing its meaning."""
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
    return [Caution("coordinate-singularity", text)]


def _is_held(arc: Arc, k: int) -> bool:
    """Whether the constraints hold the coordinate where its inertia is smallest.

    A component of a quaternion has none along the quaternion itself, whose length is
    one: a force on the coordinate then meets the inertia of what it can move.
    """
    e, name = arc.system.equations, arc.system.inertias[k]
    if not e.rows or name not in e.q:
        return False
    found = admitted_inertia(_smallest(arc, k), e.q.index(name))
    return not found < VANISHING * float(arc.state.inertia_largest[k])


def _smallest(arc: Arc, k: int) -> Point:
    """Point at which an inertia was smallest."""
    state = arc.state
    where = state.inertia_where.reshape(state.inertias, -1)[k]
    blocks = state.positions, state.velocities, state.first_order
    there = Instant(float(state.inertia_when[k]), *(where[x] for x in blocks))
    return Point(arc.system.equations, there)


# Beyond so many multiplications, about a second, the loops are not gone on with.
MOST_DENSE = 10**9


class Dependence(Source):
    """Goes on with the QR decomposition where the rows lose their independence."""

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go on with it, unless that is too much."""
        if code != at.DEGENERATE:
            return None
        found = f"at t = {arc.t:.9g} the constraints become nearly dependent"
        if dense_operations(arc.system.n, arc.system.m) > MOST_DENSE:
            text = (
                f"{found}, and there are too many for a QR decomposition: from there "
                "on multipliers may lose digits"
            )
            cautions = (Caution("nearly-dependent", text),)
            return Decision(cautions=cautions, numbers={"degenerate_below": 0.0})
        text = f"{found}; from there on they are solved by a QR decomposition"
        plan = by_loops(arc.plan)
        return Decision(
            cautions=(Caution("nearly-dependent", text),),
            arc=arc.by(plan, System(arc.equations, plan)),
        )


# Rows whose share in the direction that is lost is more than this are named.
HEAVY = 1e-3


class RankLosses(Source):
    """Losses of rank of a run, and the constraints reported so far."""

    def __init__(self) -> None:
        self._usual: tuple[float, ...] | None = None  # lengths of all constraint rows

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Report a loss of rank, with the constraints in it."""
        if code != at.RANK_LOST:
            return None
        time = arc.state.lost_at
        at_loss = arc.state.work[: arc.system.size]
        full = len(arc.equations.q)
        row = arc.runner.tabulate(np.array([[time, *at_loss]]))[0]
        q, v = row[1 : 1 + full], row[1 + full : 1 + 2 * full]
        s = at_loss[arc.state.first_order]
        if self._usual is None:
            self._usual = usual_lengths(arc.equations, arc.start)
        rank = arc.plan.rank + len(arc.plan.reduction.eliminated)
        point = Point(arc.equations, Instant(time, q, v, s))
        left, smallest = weakest_rows(point, rank, self._usual)
        rows = zip(arc.equations.rows, np.abs(left) > HEAVY, strict=True)
        names = tuple(row.name for row, is_in in rows if is_in)
        events = tuple(Event(time, "rank", name, smallest) for name in names)
        some = ", ".join(names)
        text = (
            f"at t = {time:.9g} the constraints {some} become dependent "
            f"(smallest singular value {smallest:.1e}): a singular configuration, "
            "where motions branch; their multipliers are large around it"
        )
        return Decision(events, self.once("rank", text, some))
