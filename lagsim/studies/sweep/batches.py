"""Runs of a sweep by calls of a kernel in one memory, many at a time.

A run without switches, contacts and events is a few calls of the kernel, and so is its
repeat: no session is made for it, and no observers. The starts of a batch are examined
together; with constraints a run begins at the start of the first run, so that swept
values may change forces, but neither the mass matrix M nor constraints. The numbers of
a run are equal in every bit to those of a separate run. A run is made separately if its
start needs a full examination, if it does not reach its end, if its energy is not
conserved, if a constraint is not satisfied, if its repeat disagrees, or if `refusal`
rejects the model.
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
import zlib
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.refusal import clear_starts, needs_no_solve
from lagsim.errors import LagsimError
from lagsim.language.columns import RESIDUAL
from lagsim.mechanics.equations import may_jump
from lagsim.mechanics.groups import groups
from lagsim.methods.parts.state import BLOCK_FULL
from lagsim.methods.parts.state import DONE as ENDED
from lagsim.program.localized import names_in_exponents
from lagsim.run.arc import LONG
from lagsim.run.arcs import Run, statistics_of
from lagsim.run.interrupt import FIRST_CHECK
from lagsim.run.observers import Extremes, Measures, extremes_of
from lagsim.run.observers.monitors import MOST_ROWS, energy_in_play, energy_parts
from lagsim.run.session import settings_of
from lagsim.run.trajectory import Outcome, Trajectory
from lagsim.studies.attempts import ErrorBars
from lagsim.studies.audit.evidence import UNEXPLAINED
from lagsim.studies.error_bar import RESOLVED_BY
from lagsim.studies.repeats import (
    LEAST_ROWS,
    Allowance,
    by_other_means,
    excess,
    steps_of,
)
from lagsim.studies.sweep.grid import NOTHING, SweepInput, SweepRow, value_of
from lagsim.studies.trial import Compiled
from lagsim.tolerances import (
    ENERGY_DRIFT,
    NO_MOTION,
    SAME_STEP,
    SATISFIED,
    SUM_ROUNDOFF,
    UNIT_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Session
    from lagsim.studies.repeats import Repeat

    # Parameters, each (runs,); positions, then velocities (runs, 2 n); swept values
    # (runs, axes).
    Values = tuple[dict[str, Floats], Floats, Floats]

_WORD = re.compile(r"\w+")
# A run whose rows are not computed is made separately if its energy less work changes
# by more than this part of the bound of the audit.
KEPT = 0.1
ENERGIES = ("energy", "work", "kinetic", "potential")
# Runs in a batch: some tens of milliseconds, without rows and with rows.
ENDS_AT_ONCE, ROWS_AT_ONCE = 256, 32
# Factor by which a range exceeds the bound below which a coordinate is at rest.
CLEAR = 2.0
DONE = Outcome.DONE.word


def form_of(session: Session) -> int:
    """Return an integer that identifies the compiled functions of a session."""
    watched = [(x.kind, x.power) for x in session.system.indicators]
    return zlib.crc32(repr((session.plan.form, watched)).encode())


def observer_of(session: Session) -> Extremes:
    """Return the observer of the values of each column of a run."""
    settings, columns = session.case.settings, len(session.columns.of_table)
    if settings.measured_from is None:
        return Extremes(columns)
    # Row k is at start + k*output_step, rounded.
    since = settings.measured_from - SAME_STEP * settings.output_step
    return Measures(columns, since)


def refusal(session: Session) -> str:
    """Return the reason why runs cannot be made in batches; "" if they can.

    A run of a batch consists of calls of the kernel alone.
    """
    plan, system = session.plan, session.system
    if system.watched:
        return "contacts and switches are located in each run separately"
    if system.m and not holds_plainly(session):
        return "the constraints are solved by loops, may jump, or are not enforced"
    if plan.reduction.eliminated:
        return "eliminated coordinates are recovered in each run separately"
    if system.model.until is not None:
        return "`until` is located in each run separately"
    if system.model.events:
        return "events act in each run separately"
    if plan.switches.modes or system.timed:
        return "events at given times are located in each run separately"
    if session.columns.wants_sections:
        return "crossings of sections are located in each run separately"
    return ""


def holds_plainly(session: Session) -> bool:
    """Whether a session enforces constraints so that runs can be made in batches.

    Steps are then projected onto rows that stay independent and never jump.
    """
    plan, e = session.plan, session.equations
    solved = plan.elimination is not None and not plan.augmented
    jumps = may_jump(e, [node for x in e.rows for node in (x.residual, x.rate)])
    return plan.projected and solved and not jumps


def names_at_start(equations: Equations) -> frozenset[str]:
    """Return the names that M, constraints and start values depend on.

    Runs with equal values of these names have equal starts, and equal lengths and ranks
    of the rows of constraints.
    """
    e, rows = equations, equations.rows
    nodes = [*e.mass_nodes, *(x for row in rows for x in row.A.entries.values())]
    nodes += [x for row in rows for x in (row.residual, row.rate, row.b)]
    nodes += [x for row in rows for x in (row.residual_scale, row.rate_scale)]
    nodes += [x.node for x in e.model.initial if x.node is not None]
    return e.graph.depends(nodes)


def refusal_of_rows(session: Session, bars: ErrorBars) -> str:
    """Return the reason why rows of runs cannot be computed in batches; else "".

    The rows are needed for extremes of columns and for error bars; last values alone
    need none.

    bars : when runs have an error bar.
    """
    plan, settings = session.plan, session.case.settings
    if settings.duration > (MOST_ROWS - 2) * settings.output_step:
        return "rows are computed in blocks"
    if bars is not ErrorBars.NEVER and plan.rtol is None:
        return "a method with fixed steps is repeated by another one"
    if plan.atol is None and len(groups(session.equations)) > 1:
        return "the energies of decoupled groups are examined in each run separately"
    return ""


class Batch:
    """Runs of a sweep with equal compiled functions, many at once.

    Parameters
    ----------
    session : Session
        The compiled session of the first run.
    work : SweepInput
        The input of the sweep.
    columns : int
        Number of columns of the sweep.

    Attributes
    ----------
    refusal : str
        The reason why each run must be made separately, or "".
    size : int
        Number of runs of a batch.
    """

    def __init__(self, session: Session, work: SweepInput, columns: int) -> None:
        self.session, self.work, self.grid = session, work, work.grid
        self.columns, self.size = columns, ENDS_AT_ONCE if work.ends else ROWS_AT_ONCE
        self.options = dict(work.options)
        equations, axes = session.equations, self.grid.axes
        names = {axis.name for axis in axes}
        words = {word for x in axes for y in x.texts for word in _WORD.findall(y)}
        self._follow = equations.model.stated.depends_on(names) or bool(words & names)
        powers = names_in_exponents(equations, ())
        self.refusal = refusal(session)
        # Values that decide where a motion with constraints begins.
        self._deciding = names_at_start(equations) if equations.rows else frozenset()
        if session.case.settings.rest or not needs_no_solve(equations):
            varies = any(axis.starts for axis in axes) or not equations.rows
            if session.case.settings.rest or varies:
                self.refusal = "start values are solved for by the constraints"
        if not self._deciding.isdisjoint(names):
            self.refusal = "a swept value changes the constraints or the mass matrix"
        elif powers and (self._follow or not powers.isdisjoint(names)):
            self.refusal = "a swept value is in an exponent"
        if not self.refusal and not work.ends:
            self.refusal = refusal_of_rows(session, work.error_bars)
        if not self.refusal and work.ends:
            self._ensemble = Ensemble(session)
        elif not self.refusal:
            self._judge = Judge(session, work.error_bars)

    def rows(
        self, numbers: Sequence[int], interrupt: Interrupt
    ) -> list[SweepRow | None]:
        """Return the rows of runs; None for a run that must be made separately.

        After an interrupt there are fewer rows.

        numbers : indices of the runs in the sweep.
        """
        values = self._followed if self._follow else self._plain
        parameters, starts, swept = values(numbers)
        clear = self._clear(parameters, starts)
        if not self.work.ends:
            return self._judged(parameters, starts, swept, clear, interrupt)
        ends = self._ensemble.ends(parameters, starts, interrupt)
        if ends is None:
            return []
        clear &= (ends.codes == ENDED) & self._keeps_energy(ends)
        clear &= satisfied(self.session, ends.ended)
        cells, form = ends.ended[:, None, : self.columns], form_of(self.session)
        return [
            SweepRow(tuple(own), DONE, True, None, "", cell, form) if plain else None
            for own, cell, plain in zip(swept.tolist(), cells, clear, strict=True)
        ]

    def _judged(
        self,
        parameters: Mapping[str, Floats],
        starts: Floats,
        swept: Floats,
        clear: Flags,
        interrupt: Interrupt,
    ) -> list[SweepRow | None]:
        """Return the rows of runs with their extremes and errors, as `rows` does.

        Parameters
        ----------
        parameters : mapping of str to ndarray, shape (runs,)
            Parameters that differ from the session.
        starts : ndarray, shape (runs, 2 n + l)
            Positions, velocities and first-order states.
        swept : ndarray, shape (runs, axes)
            The swept values.
        clear : ndarray of bool, shape (runs,)
            Runs with an admissible start.
        interrupt : Interrupt
        """
        form, judge = form_of(self.session), self._judge
        judge.prepare(parameters)
        found: list[SweepRow | None] = []
        for k, own in enumerate(swept.tolist()):
            run = judge.run(k, starts[k]) if clear[k] else None
            row = SweepRow(tuple(own), DONE, True, None, "", NOTHING, form)
            found.append(run and row._replace(error=run.error, numbers=run.cells))
            if interrupt.requested:
                break
        return found

    def _plain(self, numbers: Sequence[int]) -> Values:
        """Return parameters, starts and swept values of some runs, see `_judged`.

        The method serves models in which no expression depends on the swept names.

        numbers : indices of the runs.
        """
        case = self.session.case
        start = np.concatenate([case.start.q, case.start.v, case.start.s])
        starts = np.repeat(start[None], len(numbers), 0)
        parameters, swept = {}, []
        for axis, places in self.grid.at(np.array(numbers)):
            values = np.array(axis.values)[places]
            swept.append(values)
            if axis.starts:
                starts[:, case.equations.state.index(axis.name)] = values
            else:
                parameters[axis.name] = values
        return parameters, starts, np.array(swept).T

    def _followed(self, numbers: Sequence[int]) -> Values:
        """Return parameters, starts and swept values of some runs, see `_judged`.

        The method serves models with expressions that depend on the swept names: the
        model is bound to the values of each run; nan if that fails, or if the run may
        begin at another state on the constraints.

        numbers : indices of the runs.
        """
        case, axes = self.session.case, self.grid.axes
        unbound, constrained = case.model, bool(case.equations.rows)
        own = np.concatenate([case.start.q, case.start.v, case.start.s])
        names = [p.name for p in unbound.parameters]
        sizes = len(names), len(case.equations.state), len(axes)
        found, starts, swept = (np.full((len(numbers), k), np.nan) for k in sizes)
        for k, number in enumerate(numbers):
            with contextlib.suppress(LagsimError):
                model = unbound.bind(**self.grid.texts(number))
                equal = settings_of(model, "sweep", self.options) == case.settings
                if equal and not (constrained and self._begins_elsewhere(model)):
                    found[k] = [p.value for p in model.parameters]
                    initial = [x.value for x in model.initial[: sizes[1]]]
                    starts[k] = own if constrained else initial
                    swept[k] = [value_of(model, axis.name) for axis in axes]
        return dict(zip(names, found.T, strict=True)), starts, swept

    def _begins_elsewhere(self, model: Model) -> bool:
        """Whether a constrained motion may begin at another state than the batch's.

        It may where a start value of `model`, or a parameter on which the examination
        of the start depends, differs from that of the compiled session.
        """
        own = self.session.case.model

        def deciding(of: Model) -> list[float]:
            values = [p.value for p in of.parameters if p.name in self._deciding]
            return [*values, *(x.value for x in of.initial)]

        return deciding(model) != deciding(own)

    def _clear(self, parameters: Mapping[str, Floats], starts: Floats) -> Flags:
        """Return a mask (runs,) of runs whose start is admissible without examination.

        parameters, starts : see `_judged`.
        """
        case, equations = self.session.case, self.session.equations
        known: dict[str, float | Floats] = {"t": case.settings.start}
        known |= equations.model.parameter_values
        known |= parameters
        names = equations.state
        moved = np.any(starts != starts[:1], axis=0)
        for name, column, differ in zip(names, starts.T, moved, strict=True):
            known[name] = column if differ else float(column[0])
        given: Flags = np.all(np.isfinite(starts), axis=1)
        return given & clear_starts(equations, known, len(starts))

    def _keeps_energy(self, ends: Ends) -> Flags:
        """Return a mask (runs,) of runs with equal energy less work at both ends."""
        names = self.session.columns.names
        at = {x: names.index(x) for x in ENERGIES if x in names}
        moved = {x: ends.ended[:, k] - ends.begun[:, k] for x, k in at.items()}
        drift = moved["energy"] - moved.get("work", 0.0)
        size = np.abs(ends.ended[:, at.get("kinetic", at["energy"])])
        play = np.maximum.reduce([size, *map(np.abs, moved.values())])
        kept: Flags = np.abs(drift) <= KEPT * UNEXPLAINED * play
        return kept


def _largest(operation: np.ufunc, a: Floats, b: Floats, out: Floats) -> Floats:
    """Return the largest absolute value (k,) of each row of operation(a, b), (k, rows).

    out : memory for the result of the operation, (k, rows).
    """
    largest: Floats = np.maximum.reduce(np.abs(operation(a, b, out), out), axis=1)
    return largest


@functools.lru_cache(maxsize=8)
def _spans(order: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """Return slices for each stretch of consecutive numbers in `order`.

    Each item has the positions of a stretch in `order`, and its numbers.
    """
    first = [k for k, x in enumerate(order) if k == 0 or x != order[k - 1] + 1]
    ends = [*first[1:], len(order)]
    return [
        (slice(a, b), slice(order[a], order[b - 1] + 1))
        for a, b in zip(first, ends, strict=True)
    ]


def satisfied(session: Session, rows: Floats) -> Flags:
    """Return a mask (k,) of the rows in which all constraints are satisfied.

    rows : (k, columns).
    """
    names, equalities = session.columns.names, session.equations.rows
    if not equalities:
        return np.ones(len(rows), dtype=bool)
    off = [names.index(RESIDUAL.of(row.name)) for row in equalities]
    scales = [names.index(f"scale:{row.name}") for row in equalities]
    within: Flags = np.all(np.abs(rows[:, off]) <= SATISFIED * rows[:, scales], axis=1)
    return within


class Ends(NamedTuple):
    """Results of several runs.

    Attributes
    ----------
    codes : ndarray, shape (runs,)
        Return codes of the kernel, see `methods.parts.state`: DONE, or a code of a run
        that must be made separately.
    begun, ended : ndarray, shape (runs, columns)
        The first and the last row.
    """

    codes: Floats
    begun: Floats
    ended: Floats


class Ensemble:
    """Runs of a session, with other parameters and starts, in one kernel memory.

    It can be used only for sessions for which `refusal` returns "".

    Attributes
    ----------
    session : Session
        A session with its own copy of the compiled system, whose memory the runs use.
    arc : Arc
        The arc of all runs; its state is that of the last run.
    """

    def __init__(self, session: Session) -> None:
        # A repeat by another method uses the memory of the system's own method.
        system = session.system.bound(session.system.model, session.system.plan)
        self.session = session._replace(system=system)
        run = Run(self.session.first_arc(), [])
        run.begin()
        self.arc = run.arc
        self._start = run.arc.state.copy()
        # Memory of the rows of a run, and of its columns, which all runs share: new
        # memory for each would be cleared page by page.
        self._table = np.empty((0, session.system.rows_observed))
        self._columns = np.empty(0)
        self.prepare({})

    def prepare(self, parameters: Mapping[str, Floats]) -> None:
        """Store the values of parameters of the next runs, each of shape (runs,)."""
        self._places = [self.session.system.place(name) for name in parameters]
        self._values = np.array(list(parameters.values())).T
        self.arc.runner.prepare()
        self._prepared = self.session.system.p.flat.copy()

    def begin(self, k: int, start: Floats) -> None:
        """Set the memory to the start of run k: the state `start` (2 n + l,)."""
        arc, p = self.arc, self.session.system.p
        arc.state.flat[:] = self._start.flat
        arc.y[: len(start)] = start
        if self._places:
            p.flat[self._places] = self._values[k]
            arc.runner.prepare()
        else:  # a copy takes a twentieth of the time of the first run after other work
            p.flat[:] = self._prepared

    def ends(
        self,
        parameters: Mapping[str, Floats],
        starts: Floats,
        interrupt: Interrupt | None = None,
    ) -> Ends | None:
        """Return the ends of runs; None after an interrupt.

        Parameters
        ----------
        parameters : mapping of str to ndarray, shape (runs,)
            Parameters that differ from the session.
        starts : ndarray, shape (runs, 2 n + l)
            Positions, velocities and first-order states.
        """
        arc = self.arc
        codes = np.empty(len(starts))
        rows = np.empty((len(starts), 2, self.session.system.rows_observed))
        self.prepare(parameters)
        for k, start in enumerate(starts):
            self.begin(k, start)
            first = arc.row()
            codes[k] = code = arc.runner.advance(arc.state, LONG, LONG)
            while code == BLOCK_FULL:
                codes[k] = code = arc.runner.advance(arc.state, LONG, LONG)
            rows[k] = arc.runner.tabulate(np.concatenate([first, arc.row()]))
            if interrupt is not None and interrupt.requested:
                return None
        return Ends(codes, rows[:, 0], rows[:, 1])

    def table(self, k: int, start: Floats, longest: float = 0.0) -> Floats | None:
        """Return the table (rows, columns) of run k; its last row is at the end time.

        The table is valid until the next run. None if the run does not reach its end,
        or takes FIRST_CHECK steps: a separate run begins to predict its end there, see
        `run.interrupt`.

        start : (2 n + l,), coordinates, velocities and first-order states at the start.
        longest : the longest step; 0 for no limit.
        """
        self.begin(k, start)
        state, runner = self.arc.state, self.arc.runner
        state.longest = longest
        code, filled = BLOCK_FULL, 0
        while code == BLOCK_FULL and state.steps < FIRST_CHECK:
            code = runner.advance(state, LONG, FIRST_CHECK)
            count = int(state.emitted)
            if code == ENDED and count < len(runner.block):
                runner.block[count, 0], runner.block[count, 1:] = state.t, state.y
                count += 1
            runner.shown(count, self._room(filled, count))
            filled += count
        if code != ENDED or state.steps >= FIRST_CHECK:
            return None
        if self._table[filled - 1, 0] < state.t:
            self._room(filled, 1)[:] = runner.tabulate(self.arc.row())
            filled += 1
        return self._table[:filled]

    def _room(self, filled: int, count: int) -> Floats:
        """Return memory for `count` rows (count, columns) after `filled` rows."""
        last = filled + count
        if last > len(self._table):
            longer = np.empty((2 * last, self._table.shape[1]))
            longer[:filled] = self._table[:filled]
            self._table = longer
        return self._table[filled:last]

    def by_columns(self, table: Floats, order: Sequence[int]) -> Floats:
        """Return some columns (k, rows) of a table (rows, columns), each contiguous.

        These are valid until the next call.

        order : indices of the columns, (k,).
        """
        count, rows = len(order), len(table)
        if len(self._columns) < count * rows:
            self._columns = np.empty(count * len(self._table))
        columns = self._columns[: count * rows].reshape(count, rows)
        for place, span in _spans(tuple(order)):
            columns[place] = table[:, span].T
        return columns

    @property
    def trajectory(self) -> Trajectory:
        """The result of the last run, which has reached its end."""
        start, made = self.session.case.settings.start, statistics_of(self.arc, 1)
        return Trajectory(Outcome.DONE, "", start, self.arc.t, 0, made)


class Judged(NamedTuple):
    """Result of a run of a batch.

    Attributes
    ----------
    cells : ndarray
        Values of each column, as `SweepRow.numbers`.
    error : float or None
        The estimated error.
    """

    cells: Floats
    error: float | None


class Sound(NamedTuple):
    """Columns of a run that passes the audit.

    Attributes
    ----------
    columns : ndarray, shape (k, rows)
        The first k columns in the order of `Judge`.
    low, high : ndarray, shape (k,)
        Least and greatest value of each column, ignoring nan.
    """

    columns: Floats
    low: Floats
    high: Floats


class Judge:
    """Judgement of the runs of a batch, by their rows and repeats, as by `Attempts`.

    A run is plain if its audit has no finding, and its error is so small that neither
    the horizon nor the motion of coordinates at rest matters.

    Parameters
    ----------
    session : Session
        A compiled session of the model.
    bars : ErrorBars
        When runs have an error bar.
    """

    def __init__(self, session: Session, bars: ErrorBars) -> None:
        columns, equations = session.columns, session.equations
        self._ensemble, self._bars = Ensemble(session), bars
        energies = energy_parts(columns.names)
        # Columns in the order in which a run is judged: time, coordinates and rates,
        # first-order states; then the others on which judgements depend; then the rest
        # of the observed ones.
        state = equations.state_columns
        dynamic = range(1 + self._ensemble.arc.state.dynamic.stop)
        judged = dict.fromkeys([*state, *dynamic, *energies.values()])
        observed = range(len(columns.of_table))
        self._order = [*dict.fromkeys([*judged, *observed])]
        self._judged = self._order[: len(judged)]
        self._observed = [self._order.index(k) for k in observed]
        self._energies = {name: self._order.index(k) for name, k in energies.items()}
        n, self._state = len(equations.q), slice(len(state))
        self._coordinates, self._rates = slice(1, 1 + n), slice(1 + n, 1 + 2 * n)
        self._valued = [*range(1, 1 + n), *range(1 + 2 * n, len(state))]
        names = *equations.q, *(x.name for x in equations.states)
        self._components = [session.system.state.index(name) for name in names]
        self._compiled = Compiled()
        self._repeats: Ensemble | None = None
        self._parameters: Mapping[str, Floats] = {}

    def prepare(self, parameters: Mapping[str, Floats]) -> None:
        """Store the values of parameters of the next runs, each of shape (runs,)."""
        self._parameters = parameters
        for ensemble in (self._ensemble, self._repeats):
            if ensemble is not None:
                ensemble.prepare(parameters)

    def run(self, k: int, start: Floats) -> Judged | None:
        """Return the result of run k; None if it must be made separately.

        start : positions, velocities and first-order states, shape (2 n + l,).
        """
        own, error = self._ensemble, None
        with np.errstate(all="ignore"):
            table = own.table(k, start)
            sound = self._sound(own, table, self._order)
            if table is None or sound is None:
                return None
            if self._bars is not ErrorBars.NEVER:
                error = self._error(k, start, sound)
                if error is None:
                    return None
            return Judged(self._cells(table, sound), error)

    def _cells(self, table: Floats, sound: Sound) -> Floats:
        """Return the values of each column of a run, as `SweepRow.numbers`.

        table : the rows (rows, columns).
        """
        if self._ensemble.session.case.settings.measured_from is None:
            found = np.array([sound.columns[:, -1], sound.low, sound.high])
            return found[:, self._observed]
        observer = observer_of(self._ensemble.session)
        observer.add(table)
        return observer.stacked

    def _sound(
        self, ensemble: Ensemble, table: Floats | None, order: Sequence[int]
    ) -> Sound | None:
        """Return the columns of a run; None if it does not pass the audit.

        None if the values are not all finite, if energy less work is not conserved, or
        if a constraint is not satisfied.

        table : rows (rows, columns), or None.
        order : indices of the columns, (k,).
        """
        if table is None or not satisfied(ensemble.session, table).all():
            return None
        columns = ensemble.by_columns(table, order)
        # The sum is finite only if all its terms are.
        if not math.isfinite(np.add.reduce(columns[: len(self._judged)], axis=None)):
            return None
        low, high = extremes_of(columns)
        places = self._energies
        energy = places["energy"]
        first, least, greatest = columns[energy, 0], low[energy], high[energy]
        if "work" in places:
            balance = columns[energy] - columns[places["work"]]
            first, least, greatest = balance[0], np.min(balance), np.max(balance)
        between = float(ensemble.arc.state.energy)
        in_play = energy_in_play(places, low, high, between)
        kept = max(greatest - first, first - least) <= ENERGY_DRIFT * in_play
        return Sound(columns, low, high) if kept else None

    def _error(self, k: int, start: Floats, sound: Sound) -> float | None:
        """Return the error of run k, which was just made, by a repeat.

        None if the run is not plain, and must be made separately.

        start : (2 n + l,), the state at the start.
        sound : the rows of the run.
        """
        session, run = self._ensemble.session, self._ensemble.trajectory
        always = self._bars is ErrorBars.ALWAYS
        rows = sound.columns.shape[1]
        if rows < 2 or (not always and excess(session, run)):
            return None
        finer = -(-LEAST_ROWS // rows)
        other = next(by_other_means(session, run, self._compiled))
        again = self._repeated(other, finer)
        table = again.table(k, start, other.session.longest_step)
        found = self._sound(again, table, self._judged)
        if found is None:
            return None
        repeat = again.trajectory
        if not always:
            most = Allowance(session.system, run).steps_beside(session, run, other)
            arc = int(other.limited(most).arc_steps)
            if repeat.statistics.steps > most - arc:
                return None
        method = other.session.plan.method
        if method == session.plan.method and steps_of(run) == steps_of(repeat):
            return None
        return self._difference(sound, found, finer)

    def _repeated(self, other: Repeat, finer: int) -> Ensemble:
        """Return the ensemble that repeats the runs with more frequent output.

        other : the means of the repeats: method and tolerance.
        finer : the number of output steps of a repeat in one output step of the run.
        """
        if self._repeats is None:
            spacing = self._ensemble.session.case.settings.output_step / finer
            session = other.session.with_settings(output_step=spacing)
            self._repeats = Ensemble(session)
            self._repeats.prepare(self._parameters)
        return self._repeats

    def _difference(self, own: Sound, again: Sound, finer: int) -> float | None:
        """Return the error relative to ranges, as `error_bar_of` computes it.

        None if another scale than the range of a coordinate might be needed.

        The last row of both is at the end.

        own, again : rows of the run, and of its repeat, whose output is `finer` times
            as frequent.
        """
        assert self._repeats is not None
        places, rates, which = self._coordinates, self._rates, self._state
        own_rows, paired = own.columns[which], again.columns[which]
        if finer > 1:
            paired = np.concatenate([paired[:, :-1:finer], paired[:, -1:]], axis=1)
        if paired.shape != own_rows.shape:
            return None
        # The largest of all rows: roundoff bounds grow from row to row.
        largest = np.fmax(-own.low[which], own.high[which])
        # The columns of the repeat are not needed any more, and overwritten.
        worst = _largest(np.subtract, paired, own_rows, paired)
        worst = np.fmax(worst, UNIT_ROUNDOFF * largest)
        by_time = _largest(np.multiply, own_rows[:1], own_rows[rates], paired[rates])
        worst[places] = np.fmax(worst[places], UNIT_ROUNDOFF * by_time)
        state, valued = self._repeats.arc.state, self._valued
        low, high = state.low[self._components], state.high[self._components]
        for rows in (own, again):
            low = np.fmin(low, rows.low[valued])
            high = np.fmax(high, rows.high[valued])
        if self._ensemble.session.equations.rows:
            # Coordinates linked by constraints share the rounding of their positions.
            largest[places] = np.max(largest[places])
        sizes, worst, largest = high - low, worst[valued], largest[valued]
        least = np.fmax(NO_MOTION * CLEAR * sizes.max(), SUM_ROUNDOFF * largest)
        if not ((sizes > least) & (worst <= RESOLVED_BY * sizes)).all():
            return None
        return float((worst / sizes).max())
