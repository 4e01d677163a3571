"""Warnings on a run (inputs, steps, energy, constraints, error), and its audit.

A warning is a `Caution`: a stable code, and a text that names a part of the model and a
remedy. The loop over arcs raises the warnings `rank`, `unresolved-switch`,
`coordinate-singularity`, and `step-at-stability-bound` of methods with step control.
This module raises the other ones, from the rows of the run: on inputs without effect,
violated constraints, energy that no force explains, the horizon of a forecast, and
steps (`step_bounds`). docs/failing.md explains each code.

The drift of energy - work and the constraint residuals are errors that the rows of a
run show without a reference. For an adaptive method both must stay within the bound
that its error estimate implies. If either exceeds this bound by far, or if a repeat by
another method follows another motion, the audit has a finding: the run is repeated by
other means, and if these fail as well, its rows are not valid. (Chaotic motions depart
from any repeat and conserve their energy: for these only the horizon is reported.)
"""

from __future__ import annotations

import math
from functools import cached_property, partial
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.language.evaluate import evaluate, evaluate_rows, evaluate_with_error
from lagsim.language.functions import STEPS
from lagsim.mechanics.constraints import Kind, Row
from lagsim.mechanics.equations import (
    NOBODY,
    Equations,
    Instant,
    groups,
    owners_of,
    shared,
)
from lagsim.methods import method, options_of
from lagsim.notes import Caution
from lagsim.run.error import ErrorBar, Failed, could_push, largest_beside
from lagsim.run.observers.monitors import (
    EnergyMonitor,
    Gap,
    Gaps,
    ResidualMonitor,
    gained,
)
from lagsim.run.trajectory import Outcome, Trajectory
from lagsim.tolerances import (
    COMPUTED_ZERO,
    ENERGY_DRIFT,
    ENERGY_ROUNDOFF,
    HALF_OF_DIGITS,
    PLACE_BESIDE,
    SAME_ENERGY,
    SAME_ROW,
    SATISFIED,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lagsim.codes.known import WarningCode
    from lagsim.language.arrays import Floats
    from lagsim.run.session import Session


class Evidence:
    """Evidence for the warnings of a run: monitors of its rows, its end, its error bar.

    A repeat is audited too, since a repeat that is not valid is no reason to reject the
    run.

    Attributes
    ----------
    gaps : Gaps
        Values that are not finite.
    residuals : ResidualMonitor
        Constraint residuals with their scales, and the drift of energy - work.
    monitor : EnergyMonitor
        Energies and states of the rows.
    trajectory : Trajectory
        Set by `end`.
    bar : ErrorBar or str
        The error bar, or the reason why there is none; set by `end`.
    """

    trajectory: Trajectory
    bar: ErrorBar | str

    def __init__(self, session: Session) -> None:
        columns = session.columns
        self.session, self.plan = session, session.plan
        self.equations = session.equations
        self.gaps = Gaps(columns.names[: columns.table])
        self.residuals = ResidualMonitor(columns.names)
        self.monitor = EnergyMonitor(columns.names, self.equations)

    def add(self, rows: Floats) -> None:
        """Pass rows (k, columns) to the monitors."""
        self.gaps.add(rows)
        self.residuals.add(rows)
        self.monitor.add(rows)

    def end(self, trajectory: Trajectory, bar: ErrorBar | str) -> Evidence:
        """Store the end of the run and its error bar; return this object.

        The extremes of the state and the energy between rows, which the steps recorded,
        are passed to the monitor.
        """
        self.monitor.between_rows = trajectory.largest_energy
        self.monitor.extents = trajectory.extents
        self.trajectory, self.bar = trajectory, bar
        return self

    @cached_property
    def balances(self) -> Sequence[Balance]:
        """The energy balances of all decoupled groups, then of the whole system.

        They are computed after the last row. With an absolute tolerance in the model or
        the options the groups are left out: such a tolerance says nothing about the
        accuracy of a group with a small motion.
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


# Energy balances: where the energy is a sum over decoupled groups of coordinates, each
# group has a balance of its own, the energy of the group less the work done on it (see
# `mechanics.equations`), so that a large group does not hide the drift of a small one.
# Values come from the rows that the monitor has stored.

# The largest number of rows that are evaluated, and of operations for all rows.
MOST_ROWS = 512
MOST_OPERATIONS = 2e5
# The rows represent a velocity if they contain this part of its largest value.
SHOWN = 0.5


class Balance(NamedTuple):
    """Energy balance, energy - work, of all coordinates or of a decoupled group.

    Attributes
    ----------
    coordinates : sequence of int
        Indices of the coordinates of the group.
    names : tuple of str
        Names of the coordinates of a group; empty for the whole system.
    energy : int
        The node of the energy.
    in_play : float
        The energy in play: the largest of the kinetic energy (rows and steps), of the
        range of the remaining energy, and of `work_range`.
    work_range : float
        The range of the work done on the group.
    drift : float
        The largest absolute deviation of energy - work from its first value.
    farthest : float
        The deviation of size `drift`, with its sign.
    worst_row : ndarray or None
        The row with the largest deviation: time, coordinates, velocities and more.
    kept : ndarray, shape (k,)
        Energy - work at `rows`.
    rows : ndarray, shape (k, 1 + 2 n)
        Times, coordinates and velocities of some rows.
    since : callable
        Returns, for a bound, the first time at which the drift exceeds it, or None.
    """

    coordinates: Sequence[int]
    names: tuple[str, ...]
    energy: int
    in_play: float
    work_range: float
    drift: float
    farthest: float
    worst_row: Floats | None
    kept: Floats
    rows: Floats
    since: Callable[[float], float | None]

    @property
    def label(self) -> str:
        """Name of the balance in messages."""
        return f"energy - work{self.of}"

    @property
    def of(self) -> str:
        """The names of the group in messages, as in " of x, y".

        "" for the whole system.
        """
        return f" of {', '.join(self.names)}" if self.names else ""

    @property
    def part(self) -> float:
        """The drift relative to the energy in play."""
        return self.drift / (self.in_play or 1.0)


def group_balances(equations: Equations, monitor: EnergyMonitor) -> list[Balance]:
    """Return the balance of each group; [] if the energy is no sum over groups."""
    e, g = equations, equations.graph
    found = groups(e) if len(e.q) > 1 and len(monitor.passed) > 1 else []
    if len(found) < 2 or (len(e.works) == 1 and e.works[0].energy == e.energy):
        return []
    energies, forms = (shared(e, found, x)[0] for x in (e.energy, e.kinetic_form))
    nodes = [*energies, *forms]
    group_of = {x[j]: k for k, many in enumerate(found)
                for x in (e.q, e.velocities) for j in many}  # fmt: skip
    cone = g.cone(nodes)
    owners, own = owners_of(g, cone, group_of), 2 * [*range(len(found))]
    if any(owners[x] not in (k, NOBODY) for k, x in zip(own, nodes, strict=True)):
        return []
    most = min(MOST_ROWS, int(MOST_OPERATIONS / len(cone)))
    stride = -(-len(monitor.passed) // max(most, 2))
    rows, worked = monitor.passed[::stride], monitor.worked[::stride]
    known: dict[str, Any] = e.model.parameter_values
    known |= dict(zip(("t", *e.state), rows.T, strict=True))
    each, kinetic = np.split(evaluate_rows(g, nodes, known, len(rows)), 2)
    fastest = np.max(np.abs(kinetic), axis=1)
    for speeds in _between(e.velocities, known, monitor.extents):
        more = evaluate_rows(g, forms, known | speeds, len(rows))
        fastest = np.fmax(fastest, np.max(more, axis=1))
    rest = np.sum(each, axis=0) - np.sum(worked, axis=1) - monitor.balance[::stride]
    # Terms without a coordinate depend on time alone; `work` contains them unchanged.
    timed = [k for k, work in enumerate(e.works) if not work.coordinates]
    rest += np.sum(worked[:, timed], axis=1)
    if not np.ptp(rest) <= SAME_ENERGY * np.max(np.abs(each)):
        return []
    done = np.zeros_like(each)
    of_first = {e.q[group[0]]: i for i, group in enumerate(found)}
    for work, its in zip(e.works, worked.T, strict=True):
        for i in {of_first[name] for name in work.coordinates if name in of_first}:
            done[i] += its
    ranges, work_ranges = np.ptp(each - kinetic, axis=1), np.ptp(done, axis=1)
    drifts = each - done - (each[:, :1] - done[:, :1])
    sizes = np.abs(drifts)
    made = []
    for i, (group, k) in enumerate(zip(found, np.argmax(sizes, axis=1), strict=True)):
        in_play = max(fastest[i], ranges[i], work_ranges[i])
        made.append(
            Balance(
                group, tuple(e.q[j] for j in group), energies[i], float(in_play),
                float(work_ranges[i]), float(sizes[i, k]), float(drifts[i, k]),
                rows[k], drifts[i], rows, partial(_since, rows[:, 0], sizes[i]),
            )
        )  # fmt: skip
    return made


def _since(times: Floats, sizes: Floats, bound: float) -> float | None:
    """Return the first of `times` (k,) where `sizes` (k,) exceed a bound, or None."""
    off = np.flatnonzero(sizes > bound)
    return float(times[off[0]]) if len(off) else None


def _between(
    velocities: Sequence[str],
    rows: Mapping[str, Floats],
    extents: Mapping[str, tuple[float, float]],
) -> list[dict[str, float]]:
    """Return extremes between rows of velocities, where rows do not show these.

    velocities : names. rows : columns of the table by name. extremes : least and
    greatest value by name, at the ends of steps. Returns two entries, the least and the
    greatest values by name, or none.
    """
    missed = {
        v: extents[v]
        for v in velocities
        if v in extents
        and np.max(np.abs(rows[v])) < SHOWN * np.max(np.abs(extents[v])) < np.inf
    }
    return [{v: x[k] for v, x in missed.items()} for k in (0, 1)] if missed else []


def energy_error(equations: Equations, node: int, row: Floats, errors: Floats) -> float:
    """Return the error of an energy for given errors of the state.

    Parameters
    ----------
    node : int
        The node of the energy.
    row : ndarray
        Time, coordinates, velocities, and further columns.
    errors : ndarray, shape (2 n,)
        Error bounds of coordinates and velocities.
    """
    values = {p.name: (p.value, 0.0) for p in equations.model.parameters}
    names, off = ("t", *equations.state), [0.0, *errors.tolist()]
    state = zip_longest(row[: len(names)].tolist(), off, fillvalue=0.0)
    values |= dict(zip(names, state, strict=False))
    ((_, error),) = evaluate_with_error(equations.graph, [node], values)
    return float(error)


# A jump of a potential exerts no impulse in the model, so a jump of the energy there is
# no error. Most energies with a switch are continuous at the switch, however (a spring
# that acts on one side), and a loss of energy there is an error. Therefore the energy
# is evaluated on both sides of each switch that the rows pass, at neighbouring doubles,
# its jumps are subtracted, and the remaining drift is compared with the usual bounds.

# Functions that jump where an argument changes its sign: an angle at its cut, quotients
# and powers at a pole. The value is the index of that argument.
CUT = {"atan2": 0, "div": 1, "pow": 0}
# All functions that jump: step functions, choices, and functions with a cut.
SWITCHES = STEPS | {"if", *CUT}
# The largest number of switches located between one row and the next.
MOST_ON_A_WAY = 8


def jumps(equations: Equations, balance: Balance) -> Floats:
    """Return the jumps of the energy between rows, shape (k,).

    The first entry is the jump between the worst row and the first row, and each other
    entry that between two consecutive rows.
    """
    energy, rows = Energy(equations, balance.energy), balance.rows
    if not energy.switches:
        return np.zeros(len(rows))
    worst = rows[0] if balance.worst_row is None else balance.worst_row
    ways = pairwise([worst[: rows.shape[1]], *rows])
    least = COMPUTED_ZERO * balance.in_play
    return np.array([energy.jump(a, b, least) for a, b in ways])


def without_jumps(equations: Equations, balance: Balance) -> Floats | None:
    """Return energy - work of the rows without the jumps of the energy, shape (k,).

    None if the energy does not jump.
    """
    jumped, kept = jumps(equations, balance)[1:], balance.kept
    sizes = np.abs(jumped[jumped != 0.0])
    if not len(sizes):
        return None
    changes, size = np.diff(kept) - jumped, float(np.max(sizes))
    if np.ptp(sizes) <= HALF_OF_DIGITS * size < np.inf:
        changes -= size * np.round(changes / size)
    return np.asarray(np.concatenate([[0.0], np.cumsum(changes)]) + kept[0])


class Energy:
    """An energy as a function of the state, with its switches."""

    def __init__(self, equations: Equations, energy: int) -> None:
        g = equations.graph
        self.graph, self.energy = g, energy
        self.names = ("t", *equations.state)
        self.parameters = equations.model.parameter_values
        found = sorted(
            n for n in g.dependent([energy], self.names) if g.ops[n] in SWITCHES
        )
        # The node whose value tells the side: the condition of a choice, the argument
        # that changes its sign of an angle or a quotient, else the value of the switch.
        inner = {**CUT, "if": 0}
        ops = [g.ops[n] for n in found]
        pairs = [*zip(found, ops, strict=True)]
        self.switches = [g.args[n][inner[op]] if op in inner else n for n, op in pairs]
        self.cut = [op in CUT for op in ops]

    def sides(self, state: Floats) -> list[float]:
        """Return a number for each switch that identifies the side of a state."""
        values = zip(self._values(self.switches, state), self.cut, strict=True)
        return [math.copysign(1.0, x) if cut else float(x) for x, cut in values]

    def jump(self, a: Floats, b: Floats, least: float) -> float:
        """Return the sum of the jumps of the energy on the straight line from a to b.

        Jumps of at most `least`, or of the size of rounding, are left out.

        Parameters
        ----------
        a, b : ndarray, shape (1 + 2 n,)
            Time, coordinates and velocities.
        """
        x = found = 0.0
        at_b = self.sides(b)
        for _switch in range(MOST_ON_A_WAY):
            at_x = self.sides(a + x * (b - a))
            if at_x == at_b:
                break
            low, high = x, 1.0
            while low < (middle := 0.5 * (low + high)) < high:
                if self.sides(a + middle * (b - a)) == at_x:
                    low = middle
                else:
                    high = middle
            ends = (self._values([self.energy], a + y * (b - a)) for y in (low, high))
            (before,), (after,) = ends
            size = max(abs(before), abs(after))
            if not abs(after - before) <= max(least, ENERGY_ROUNDOFF * size):
                found += after - before
            x = high
        return found

    def _values(self, nodes: list[int], state: Floats) -> list[float]:
        values = dict(zip(self.names, state.tolist(), strict=True))
        return evaluate(self.graph, nodes, self.parameters | values)


def about_inputs(run: Evidence) -> list[Caution]:
    """Return warnings on inputs that have no effect, and on a changed start."""
    case, plan = run.session.case, run.plan
    changes, settings, name = case.examined.changes, case.settings, plan.method
    moved = (f"{x} from {old!r} to {new!r}" for x, (old, new) in changes.items())
    others = [key for key, _ in settings.options if key not in options_of(name)]
    tolerances = (settings.rtol, settings.atol) != (None, None)
    penalty = plan.formulation == "baumgarte"
    found: list[tuple[bool, WarningCode, str]] = [
        (bool(changes), "start-changed",
         f"the run starts from the nearest exact state: {', '.join(moved)}"),
        (plan.step is None and settings.step is not None, "step-unused",
         f"`step` has no effect: {name} chooses its steps"),
        *((True, "option-unused",
           f"`{key}` has no effect: {name} has no such parameter") for key in others),
        (plan.rtol is None and tolerances, "tolerance-unused",
         f"tolerances have no effect: {name} has fixed steps"),
        (settings.gain is not None and not penalty, "gain-unused",
         f"`gain` has no effect: the formulation is {plan.formulation}"),
    ]  # fmt: skip
    return [Caution(code, text) for applies, code, text in found if applies]


# The largest number of columns that a message names; further columns are counted.
MOST = 12


def about_gaps(found: Mapping[str, Gap]) -> Caution:
    """Return the warning on columns with values that are not finite."""
    told = [
        f"`{name}` is {gap.value} at t = {gap.time:.9g}"
        + (f", the first of {gap.rows} rows" if gap.rows > 1 else "")
        for name, gap in found.items()
    ]
    text = f"not all values of the table are finite: {'; '.join(told[:MOST])}"
    if len(told) > MOST:
        text += f"; and {len(told) - MOST} more columns"
    if "energy" in found or "work" in found:
        text += "; so the energy drift is not known"
    return Caution("column-not-finite", text)


# The least unexplained change of the energy that raises a warning, relative to the
# energy in play: half of it, as an error of an amplitude, is about the width of a line
# in a picture, and the drift at the default tolerance is a million times smaller.
UNEXPLAINED = 1e-3
# Safety factor of the energy error that the errors of the state explain, to first order
# and with all errors in the worst direction.
FAR = 100.0
# Steps until a method without location of events corrects a residual: it detects a
# contact up to one step late, and stops the penetration within the next step.
LATE = 2.0
# Energy drift that counts, in relative tolerances (the shipped models reach 20).
MANY = 1e3
# Factor of the rounding error of an energy difference between two rows.
BOTH = 4.0
# A coordinate is at rest if it moves less than this many times as far as the rounding
# of the forces on it would move it.
HIGHER = 16.0


def _drift(run: Evidence) -> str:
    """Return the text on an energy drift beyond the tolerance, or "".

    Only methods with step control are considered. A drift of more than `UNEXPLAINED` is
    left to `about_energy`.
    """
    equations, plan = run.equations, run.plan
    if plan.rtol is None:
        return ""
    least = max(ENERGY_DRIFT, MANY * (plan.rtol or 0.0))
    for balance in sorted(run.balances, key=lambda x: x.part, reverse=True):
        if not balance.part > least:
            break
        if balance.part > UNEXPLAINED or balance.worst_row is None:
            continue
        rounded = _rounded(run, balance, BOTH)
        since = balance.since(max(least * balance.in_play, rounded))
        if since is not None and not jumps(equations, balance).any():
            of = f"{balance.label} is off by {balance.part:.2g} of the energy in play"
            return f"{of} from t = {since:.6g} on"
    return ""


def about_error(run: Evidence) -> list[Caution]:
    """Return warnings on an unknown error, an uncertain end, the horizon, and drift.

    The drift of the energy is compared with the tolerance, whatever the error bar is.
    """
    bar, plan, drift = run.bar, run.plan, _drift(run)
    if isinstance(bar, str):
        if not drift and not isinstance(bar, Failed):
            return []
        text = f"the error of the rows is not known: {bar}"
        return [Caution("error-unknown", f"{text}; {drift}" if drift else text)]
    found = []
    if bar.parted:
        text = f"{bar.parted}: it is not known which is right"
        found.append(Caution("end-in-doubt", f"how the run ends is uncertain: {text}"))
    if bar.horizon is not None:
        less = "a shorter step" if plan.rtol is None else "a tighter rtol"
        text = (
            f"past t = {bar.horizon:.6g} the estimated error exceeds a tenth of a "
            "coordinate's range: later rows show one possible motion of many "
            f"({less} moves this time)"
        )
        found.append(Caution("horizon", text))
    if drift and plan.atol is None:
        text = (
            f"{drift}, more than the tolerance allows: the error of the rows is "
            f"about {bar.relative:.2g} of a coordinate's range (far from the "
            "origin, positions have few digits left for small motions)"
        )
        found.append(Caution("energy-drifts", text))
    return found


def about_constraints(run: Evidence) -> list[Caution]:
    """Return the warning on a constraint that rows do not satisfy; [] if all do.

    For a method that does not locate impacts, the bound of a residual is the change of
    the constraint in `LATE` steps: such a method is no more accurate.
    """
    plan, trajectory = run.plan, run.trajectory
    coarse = None
    if plan.step is not None and not getattr(method(plan.method), "EVENTS", True):
        extents = trajectory.extents
        speeds = [
            max(map(abs, extents.get(v, (0.0,)))) for v in run.equations.velocities
        ]
        coarse = LATE * plan.step, np.array(speeds)
    found = worst_residual(run, coarse)
    if found is None:
        return []
    name, worst = found
    if trajectory.outcome is Outcome.CONSTRAINT_JUMPS:
        since = run.residuals.constraint_since(name, SATISFIED)
        length = trajectory.end - trajectory.start
        if since is not None and trajectory.end - since <= SAME_ROW * length:
            return []  # the last row shows the jump that has ended the run
    why = "the constraints do not determine this motion, and the rows are not valid"
    loose = not plan.projected or plan.formulation in ("baumgarte", "drift")
    if loose and not plan.reduction.eliminated:
        why = (
            f"the formulation {plan.formulation} does not enforce it; `projection` does"
        )
    text = (
        f"constraint `{name}` is not satisfied in all rows (off by {worst:.2g} of "
        f"its scale): {why}"
    )
    return [Caution("constraint-not-held", text)]


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
    for name, part, moved in _residuals_off(run, coarse):
        if not moved <= SATISFIED:
            return name, part
    return None


def constraint_residual(run: Evidence) -> float:
    """Return the largest relative residual of all constraints.

    A residual is relative to the scale of its constraint or to the motion of the
    coordinates in the constraint, whichever is larger. The value is inf or nan if a
    residual is not finite.
    """
    parts = run.residuals.constraint_parts
    off = {name: min(part, moved) for name, part, moved in _residuals_off(run, None)}
    return max((parts | off).values(), default=0.0)


def _residuals_off(
    run: Evidence, coarse: tuple[float, Floats] | None
) -> Iterator[tuple[str, float, float]]:
    """Yield constraints whose residual exceeds the part SATISFIED of their scale.

    Each item has the name, the residual relative to the scale, and the residual
    relative to the motion: the size of the motion of the coordinates, multiplied by the
    slopes of the constraint. The latter decides where all terms of a constraint are
    close to zero, so that their sizes are no scale. Residuals that one step explains
    are left out; `coarse` is that of `worst_residual`.
    """
    equations, start = run.equations, run.session.case.examined.state
    n, g, ranges = len(equations.q), equations.graph, run.monitor.ranges
    contacts = {x.name for x in equations.laws if x.kind is Kind.CONTACT}
    names = run.session.columns.names
    for name, residual, part, values in run.residuals.constraints_off(SATISFIED):
        if not math.isfinite(residual):
            yield name, part, residual
            continue
        row = equations.row(name)
        moved = ranges[1 : 1 + n] if row.holonomic else ranges[1 + n : 1 + 2 * n]
        state = equations.model.parameter_values
        state |= dict(zip(names, values.tolist(), strict=False))
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
        seed = largest_beside(inertia_roots(equations, start), moved)
        seed = PLACE_BESIDE * seed + motion_of_rest(run, range(n))[0]
        motion = float(slopes @ moved) + float(slopes @ seed) / SATISFIED
        yield name, part, residual / motion if motion > 0.0 else math.inf


def inertia_roots(equations: Equations, start: Instant) -> Floats:
    """Return the square roots of the diagonal of M at the start, shape (n,)."""
    diagonal = Point(equations, start).array(equations.inertias)
    return np.sqrt(np.fmax(diagonal, 0.0))


def _changed(
    equations: Equations, row: Row, state: Mapping[str, float], values: Floats, h: float
) -> float:
    """Return a bound of the residual of a constraint after a step of size h.

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
    system at rest there is no larger motion to compare that motion with. Coordinates
    that move farther have the value 0.

    Parameters
    ----------
    which : sequence of int
        Indices of the coordinates considered.

    Returns
    -------
    moved : ndarray, shape (n,)
        In the units of the coordinates.
    energy : float
    """
    n, monitor = len(run.equations.q), run.monitor
    rows, span = monitor.passed, float(monitor.ranges[0])
    found = could_push(run.equations, rows, which, span, monitor.held)
    rests = monitor.ranges[1 : 1 + n] <= HIGHER * found.moved
    moved = np.where(rests, found.moved, 0.0)
    return moved, float(moved @ found.forces)


def _rounded(run: Evidence, balance: Balance, times: float = FAR) -> float:
    """Return the rounding error of an energy at the worst row of a balance.

    The larger of two values: `times` the rounding error by the state and by the work of
    constraint forces, and the energy of the motion that rounding causes at rest.
    """
    row, monitor, j = balance.worst_row, run.monitor, list(balance.coordinates)
    if row is None:
        return 0.0
    state = UNIT_ROUNDOFF * np.abs(row[1 : 1 + len(run.equations.state)])
    own = times * energy_error(run.equations, balance.energy, row, state)
    own += times * UNIT_ROUNDOFF * float(monitor.held[j] @ monitor.ranges[1:][j])
    return max(own, motion_of_rest(run, balance.coordinates)[1])


def about_energy(run: Evidence) -> list[Caution]:
    """Return warnings on energy that is gained or lost without a force.

    There is a warning for each decoupled group, or one for the whole system. With step
    control the largest deviation of energy - work counts. With a fixed step its trend
    counts, since the energy of a symplectic method oscillates without a trend.
    """
    found: list[Caution] = []
    for balance in run.balances:
        if balance.names or not found:
            found += _gained(run, balance)
    return found


def _gained(run: Evidence, balance: Balance) -> list[Caution]:
    plan, settings = run.plan, run.session.case.settings
    least, change = UNEXPLAINED * balance.in_play, balance.farthest
    if plan.rtol is None or not math.isfinite(change):
        change = gained(balance.kept)
    if not abs(change) > least or abs(change) <= _rounded(run, balance):
        return []
    since = balance.since(least)
    rest = without_jumps(run.equations, balance)
    if rest is not None:
        drifts = rest - rest[0]
        change = float(drifts[np.argmax(np.abs(drifts))])
        if plan.rtol is None:
            change = gained(rest)
        if not abs(change) > least:
            return []
        since = float(balance.rows[np.argmax(np.abs(drifts) > least), 0])
    when = run.monitor.end if plan.rtol is None or since is None else since
    way = "gained" if change > 0.0 else "lost"
    reached, how = "from", "a tighter rtol"
    if plan.rtol is None:
        reached, how = "by", "a shorter step"
    text = (
        f"the motion{balance.of} has {way} energy that no force explains, "
        f"{abs(change) / balance.in_play:.2g} of the energy in play {reached} t = "
        f"{when:.6g}"
    )
    if rest is not None:
        text += ", besides jumps of its expression, which are no error"
    elif run.trajectory.outcome.complete:
        whose = plan.method
        if plan.formulation == "drift":
            whose += " and of the formulation drift"
        # Advise nothing that has been tried.
        how += " keeps" if settings.method == "auto" else ", or `--method auto`, keeps"
        text += f": that is an error of {whose}; {how} it"
    return [Caution("energy-gained" if change > 0.0 else "energy-lost", text)]


# Bound of the energy drift, in relative tolerances, for any estimated error: rows with
# a larger drift, which is also above UNEXPLAINED, are not valid.
ACCURATE = 1e6
# The relative tolerance that stands for an exact method.
EXACT_RTOL = 1e-12
# A repeat follows another motion if it differs by the part PARTED of a range and by
# TOLERANCES times the tolerance.
PARTED = 1e-3
TOLERANCES = 1e4
# Formulations in which constraints, and with them the energy, drift.
LOOSE = ("baumgarte", "drift")


class Finding(NamedTuple):
    """Reason why rows are doubtful, and the first time at which they are.

    Attributes
    ----------
    text : str
    time : float
    refutes : bool
        Whether the rows cannot be a motion of the model; else a further run decides.
    parts : bool
        Whether a constraint is not satisfied.
    """

    text: str
    time: float
    refutes: bool
    parts: bool = False


def up_to(session: Session, time: float) -> Session:
    """Return the session ended at the last output time before `time`."""
    settings = session.case.settings
    start, step = settings.start, settings.output_step
    last = math.ceil((time - start) / step - SAME_ROW) - 1
    end = min(start + max(last, SAME_ROW) * step, settings.end)
    return session._replace(case=session.case.asking(end=end))


def audit(run: Evidence) -> Finding | None:
    """Return the finding against a complete run, or None."""
    plan = run.plan
    if (
        plan.rtol is None
        or not run.trajectory.outcome.complete
        or plan.formulation in LOOSE
    ):
        return None
    found = _unsatisfied(run)
    for balance in run.balances:
        found = found or _off(run, balance)
    return found or _another_motion(run)


def fault(run: Evidence) -> str:
    """Return the text of the audit's finding against a run; "" without one."""
    found = audit(run)
    return "" if found is None else f"from t = {found.time:.6g} on, {found.text}"


def _unsatisfied(run: Evidence) -> Finding | None:
    found = worst_residual(run)
    if found is None:
        return None
    name, worst = found
    text = f"constraint `{name}` is off by {worst:.2g} of its scale"
    since = run.residuals.constraint_since(name, SATISFIED)
    return None if since is None else Finding(text, since, refutes=True, parts=True)


def _off(run: Evidence, balance: Balance) -> Finding | None:
    """Compare an energy drift with the energy error that errors of the state explain.

    Return the finding if the drift is larger, else None.
    """
    drift, in_play, row = balance.drift, balance.in_play, balance.worst_row
    if not ENERGY_DRIFT * in_play < drift < math.inf or row is None:
        return None
    text = f"{balance.label} is off by {drift / in_play:.2g} of the energy in play"
    explained = _explained(run, balance, row)
    wrong = max(UNEXPLAINED, ACCURATE * (run.plan.rtol or EXACT_RTOL)) * in_play
    bound = min(FAR * explained, wrong)
    bound = max(bound, _rounded(run, balance), ENERGY_DRIFT * in_play)
    since = balance.since(bound)
    if not drift > bound or since is None or jumps(run.equations, balance).any():
        return None
    if drift > FAR * explained:
        text += f", and the estimated error explains {explained / in_play:.1g}"
    return Finding(text, since, refutes=True)


def _explained(run: Evidence, balance: Balance, row: Floats) -> float:
    """Return the error of energy - work that errors of the state in a row explain.

    inf if unknown.
    """
    bar = run.bar
    if isinstance(bar, str) or bar.rates is None:
        return math.inf
    # Errors up to the first compared row after the time of `row`.
    until = min(int(np.searchsorted(bar.times, row[0])) + 1, len(bar.times))
    q, s = np.split(bar.errors[:until], [bar.rates.shape[1]], axis=1)
    errors = np.max(np.hstack([q, bar.rates[:until], s]), axis=0)
    part = float(np.max(bar.parts[:until], initial=0.0))
    part += FAR * (run.plan.rtol or EXACT_RTOL)
    error = energy_error(run.equations, balance.energy, row, errors)
    return error + part * balance.work_range


def _another_motion(run: Evidence) -> Finding | None:
    """Return the finding that a repeat followed another motion, or None."""
    bar = run.bar
    if isinstance(bar, str):
        return None
    if bar.parted:
        return Finding(bar.parted, float(bar.times[-1]), refutes=False)
    lost, most = bar.lost, TOLERANCES * run.plan.tolerance
    if not np.max(lost) > max(PARTED, most):
        return None
    text = f"a repeat by {bar.method} gives another motion"
    return Finding(text, float(bar.times[np.argmax(lost > most)]), refutes=False)


# Least mean step of a run whose steps resolve the motion, times the fastest rate of the
# rows (a series has 0.5 to 1.5). Shorter steps are limited by stability.
FOLLOWS = 0.05


def alarms(run: Evidence) -> list[Caution]:
    """Return all warnings on a run, in the order of its stages."""
    return [
        *run.session.case.examined.warnings,
        *about_inputs(run),
        *run.trajectory.warnings,
        *_about_steps(run),
        *about_energy(run),
        *about_constraints(run),
        *about_error(run),
        *([about_gaps(run.gaps.found)] if run.gaps.found else []),
    ]


def _about_steps(run: Evidence) -> list[Caution]:
    """Return warnings on steps that eigenvalues show to be too long."""
    plan, trajectory, monitor = run.plan, run.trajectory, run.monitor
    steps = trajectory.statistics.steps
    chosen = plan.step is None and plan.formulation != "baumgarte"
    module = method(plan.method)
    # Explicit pairs detect steps at the bound themselves.
    if not steps or (chosen and hasattr(module, "PAIR")):
        return []
    if chosen and math.isfinite(module.IMAGINARY_LIMIT):
        h = (trajectory.end - trajectory.start) / steps
        if h * monitor.fastest_rate > FOLLOWS:
            return []
    from lagsim.studies.step_bounds import about_steps

    return about_steps(run.equations, plan, trajectory, monitor)
