"""Grid of a sweep, and the runs at all combinations of its values.

Runs are made in pieces by any process, and functions are compiled once in each process.

A piece is self-contained. The functions that a process has compiled are used for all
its pieces, with results equal in every bit to those of a separate run. If values need
other functions (because another method suits these values, for example), the model is
read again, and its functions serve later runs, too.

If only the ends of runs are requested, many runs are made at a time: the starts of a
batch are examined together, and the runs are calls of the kernel with one memory. A run
is made separately, with equal numbers, if its start needs a full examination, if it
does not reach its end, if its energy is not conserved, or if `refusal` rejects the
model.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import math
import pickle
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.admissibility.refusal import clear_starts, needs_no_solve
from lagsim.errors import InputError, LagsimError, Problems, did_you_mean, unusable
from lagsim.language.names import member_hint, rate_of, rated
from lagsim.methods.parts.state import BLOCK_FULL
from lagsim.methods.parts.state import DONE as ENDED
from lagsim.model.reader.runs import FROM
from lagsim.outputs import TableFormat
from lagsim.outputs.manifest import encode
from lagsim.outputs.table import table_writer
from lagsim.outputs.units import of_table
from lagsim.program.localized import names_in_exponents
from lagsim.program.output_row import Columns
from lagsim.run.arc import LONG
from lagsim.run.arcs import Run
from lagsim.run.observers import Extremes, Measures
from lagsim.run.session import Session, StartError, Stopwatch, wanted
from lagsim.run.trajectory import Outcome
from lagsim.studies.attempts import Attempt, Attempts, ErrorBars
from lagsim.studies.audit.evidence import UNEXPLAINED
from lagsim.studies.drawing import other_files
from lagsim.studies.trials import Forms, refused_trial, structural_values
from lagsim.tolerances import SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt

    # Parameters, each (runs,); positions, then velocities (runs, 2 n); swept values
    # (runs, axes).
    Values = tuple[dict[str, Floats], Floats, Floats]

    from lagsim.language.arrays import Floats
    from lagsim.run.session import Session


# More runs than this are refused.
MOST_RUNS = 10**6
# A comma that separates values, not arguments of a function.
_COMMA = re.compile(r",(?![^()]*\))")
_NUMBER = re.compile(r"-?\d+\.?\d*(e[-+]?\d{1,2})?", re.ASCII)
_WORD = re.compile(r"\w+")
EXAMPLE = "such as K=10:40:7 (from, to, how many) or K=10,20,40"
# The other columns of sweep.csv that have no dot in their names.
OUTCOME, COMPLETE, ERROR, REASON = "outcome", "complete", "error", "reason"


class Axis(NamedTuple):
    """Swept name with its values.

    Attributes
    ----------
    name : str
    starts : bool
        Whether the name is an entry of `initial`, not a parameter.
    texts : tuple of str
        The values as expressions.
    values : tuple of float
        The values as numbers, with all other names as in the file.
    unit : str
    drawn : str
        The distribution that the values are a sample of, or "".
    """

    name: str
    starts: bool
    texts: tuple[str, ...]
    values: tuple[float, ...]
    unit: str = ""
    drawn: str = ""

    @classmethod
    def of(cls, model: Model, name: str, texts: Sequence[str]) -> Axis:
        """Return the axis of a name of `model`.

        Raises
        ------
        InputError
            If there is no such name, or a value cannot be used.
        """
        units = {p.name: p.unit for p in model.parameters}
        starts = name not in units
        unit = units.get(name, "")
        if starts:
            _check_start(model, name)
            units = {x.name: x.unit for x in (*model.variables, *model.definitions)}
            rated_unit = units.get(rated(name)[0])
            unit = units.get(name) or (f"{rated_unit}/s" if rated_unit else "")
        values: list[float] = []
        for text in texts:
            # The first one shows that the name can be bound.
            plain = values and _NUMBER.fullmatch(text)
            x = float(text) if plain else value_of(model.bind(**{name: text}), name)
            values.append(x)
        return cls(name, starts, tuple(texts), tuple(values), unit)


class Grid(NamedTuple):
    """Combinations of the values of axes; the first axis varies most slowly.

    Attributes
    ----------
    together : bool
        Whether run k has value k of every axis, in place of all combinations.
    seed : int or None
        The seed of a sample.
    """

    axes: tuple[Axis, ...]
    together: bool = False
    seed: int | None = None

    @property
    def runs(self) -> int:
        """The number of runs."""
        return self.shape[0] if self.together else math.prod(self.shape)

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values of each axis."""
        return tuple(len(axis.texts) for axis in self.axes)

    def at(self, numbers: Any) -> Iterator[tuple[Axis, Any]]:
        """Return each axis with the index of its value in a run or in several runs."""
        places: Any = [numbers] * len(self.axes)
        if not self.together:
            places = np.unravel_index(numbers, self.shape)
        return zip(self.axes, places, strict=True)

    def texts(self, number: int) -> dict[str, str]:
        """Return the values of all names in a run, as texts."""
        return {axis.name: axis.texts[place] for axis, place in self.at(number)}

    def values(self, number: int) -> tuple[float, ...]:
        """Return the values of all axes in a run, as numbers."""
        return tuple(axis.values[place] for axis, place in self.at(number))


def value_of(model: Model, name: str) -> float:
    """Return the value of a parameter or the start value with a name."""
    values = {x.name: x.value for x in model.initial}
    values |= model.parameter_values
    return values.get(name, math.nan)


def grid_of(
    model: Model,
    given: Mapping[str, Iterable[float | str]],
    *,
    together: bool = False,
) -> Grid:
    """Return the grid of names and values, or points with `together`.

    Raises
    ------
    InputError
        If a name or a value cannot be used, or the grid has too many runs.
    """
    problems = Problems()
    axes = []
    for name, values in given.items():
        texts = [x if isinstance(x, str) else repr(float(x)) for x in values]
        with problems.gathered():
            axes.append(Axis.of(model, name, texts))
        if not texts:
            problems.add("usage", f"{name} has no values", hint=EXAMPLE)
        if name in (OUTCOME, COMPLETE, ERROR, REASON):
            text = f"`{name}` cannot be swept: sweep.csv has a column of that name"
            problems.add("usage", text, hint="give it another name")
    problems.refuse()
    grid = Grid(tuple(axes), together)
    if together and len({*grid.shape}) > 1:
        text = f"the names have {', '.join(map(str, grid.shape))} values"
        hint = "points have as many values of each name"
        raise unusable("usage", text, hint=hint)
    refuse_many(grid.runs)
    return grid


def refuse_many(runs: int) -> None:
    """Raise an InputError for a sweep of more than MOST_RUNS runs."""
    if runs > MOST_RUNS:
        text = f"these are {runs} runs, more than {MOST_RUNS}"
        raise unusable("usage", text, hint="sweep them in parts")


def parse_axes(model: Model, arguments: Iterable[str]) -> Grid:
    """Parse arguments `name=a:b:n` and `name=v1,v2,...` into a grid.

    Raises
    ------
    InputError
        If an argument is malformed, or a name or a value cannot be used.
    """
    given: dict[str, list[str]] = {}
    problems = Problems()
    for argument in arguments:
        name, equals, values = (part.strip() for part in argument.partition("="))
        if not (name and equals and values):
            text = f"{argument}: a name and its values are expected"
            problems.add("usage", text, hint=EXAMPLE)
        elif name in given:
            problems.add("usage", f"{name} is given twice")
        else:
            with problems.gathered():
                given[name] = _values(model, name, values)
    problems.refuse()
    return grid_of(model, given)


def _values(model: Model, name: str, text: str) -> list[str]:
    """Parse the values of a swept name, `a:b:n` or `v1,v2,...`, into texts."""
    if ":" not in text:
        return [part.strip() for part in _COMMA.split(text)]
    first, _, rest = text.partition(":")
    last, _, many = rest.rpartition(":")
    if not (many.strip().isdecimal() and int(many) >= 2 and last and ":" not in last):
        found = f"{name}={text}: two ends and how many values, 2 or more, are expected"
        raise unusable("usage", found, hint=EXAMPLE)
    refuse_many(int(many))
    a, b = Axis.of(model, name, (first, last)).values
    steps = int(many) - 1  # between round ends they are round
    return [repr(a + (b - a) * k / steps) for k in range(steps)] + [repr(b)]


def _check_start(model: Model, name: str) -> None:
    moving = [c.name for c in model.coordinates] + [d.name for d in model.definitions]
    known = [*moving, *map(rate_of, moving), *(x.name for x in model.initial)]
    if name not in known:
        parameters = [p.name for p in model.parameters]
        among = [*parameters, *known]
        hint = member_hint(name, among) or did_you_mean(name, among)
        hint = hint or f"its parameters are {', '.join(parameters) or 'none'}"
        text = f"`{name}` is no parameter of {model.name}, and has no start value"
        raise unusable("unknown-name", text, hint=hint)


# A run is made separately, with all rows, if its energy less work changes by more than
# this part of the bound of the audit.
KEPT = 0.1
ENERGIES = ("energy", "work", "kinetic", "potential")
# Runs in a batch: some tens of milliseconds.
AT_ONCE = 256
# Runs between two collections of the young generation of objects, since runs leave
# reference cycles.
COLLECTED = 50
DONE = Outcome.DONE.word
NOTHING = np.empty((3, 0))
# Values of each column of a run, in the order of sweep.csv.
EXTREMES = ("end", "min", "max")
MEASURES = (*EXTREMES, "mean", "rms", "peak_to_peak")


class SweepInput(NamedTuple):
    """Input that all runs of a sweep share.

    Attributes
    ----------
    model : bytes
        The pickled Model.
    options : tuple of (str, str)
        Options of runs by name.
    grid : Grid
    error_bars : ErrorBars
    kept : str or None
        The folder for the folders of the runs; None if only rows are stored.
    plots : bool
        Whether pictures of the runs are drawn.
    ends : bool
        Whether only the last value of each column is requested.
    """

    model: bytes
    options: tuple[tuple[str, str], ...]
    grid: Grid
    error_bars: ErrorBars
    kept: str | None = None
    plots: bool = False
    ends: bool = False

    @property
    def parts(self) -> tuple[str, ...]:
        """The values of each column: its end, extremes, and with `from` measures."""
        if self.ends:
            return EXTREMES[:1]
        return MEASURES if FROM in dict(self.options) else EXTREMES


class SweepRow(NamedTuple):
    """Result of a run: a row of the sweep.

    Attributes
    ----------
    values : tuple of float
        The swept values of the run.
    outcome : str
    complete : bool
    error : float or None
        The estimated error, relative to the range of a coordinate.
    reason : str
        The reason of an incomplete run.
    numbers : ndarray, shape (3, columns)
        Values of each column: a row for each of `Work.parts`; no columns if there was
        no run.
    form : int
        A number shared by runs with equal compiled functions; 0 if there was no run.
    """

    values: tuple[float, ...]
    outcome: str
    complete: bool = False
    error: float | None = None
    reason: str = ""
    numbers: Floats = NOTHING
    form: int = 0


@dataclass(slots=True)
class SweepRows:
    """Sweep with the rows computed so far.

    Attributes
    ----------
    rows : dict of int to SweepRow
        Rows by the index of the run.
    columns : tuple of str
        Columns of the tables of the runs.
    units : dict of str to str
        Units of the columns, known after the first run.
    seconds : float
        The time of this session of the sweep.
    """

    model: Model
    work: SweepInput
    rows: dict[int, SweepRow] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0

    @classmethod
    def of(
        cls,
        model: Model,
        grid: Grid,
        options: Mapping[str, object],
        error_bars: ErrorBars,
        **more: Any,
    ) -> SweepRows:
        """Return a sweep without rows; the arguments are fields of `SweepInput`."""
        texts = tuple((name, str(x)) for name, x in options.items())
        work = SweepInput(pickle.dumps(model), texts, grid, error_bars, **more)
        return cls(
            model, work._replace(error_bars=ErrorBars.NEVER) if work.ends else work
        )

    @property
    def grid(self) -> Grid:
        """The grid of the sweep."""
        return self.work.grid

    @property
    def missing(self) -> list[int]:
        """The indices of the runs without a row."""
        return [k for k in range(self.grid.runs) if k not in self.rows]


class Runs:
    """Runs of a sweep in one process.

    Attributes
    ----------
    columns : tuple of str
        Columns of the tables of the runs; the union if the members of a family vary.
    batch : Batch or None
        Computes the ends of many runs at once, for the form of the first run; None if
        runs are made one by one.
    """

    def __init__(self, work: SweepInput) -> None:
        self.work, grid = work, work.grid
        self._forms = Forms(work.model, dict(work.options), "sweep")
        first = self._forms.form(grid.texts(0))
        others = {
            tuple(structural_values(first.model, grid.texts(k)).items()): None
            for k in range(1, grid.runs if first.structure else 1)
        }
        forms = [first, *(self._forms.form(dict(texts)) for texts in others)]
        tables = [Columns(form.equations, {}).of_table for form in forms]
        longest = sorted(tables, key=len, reverse=True)
        self.columns = tuple(dict.fromkeys(name for t in longest for name in t))
        self._forms.known = [first]
        self.batch: Batch | None = None
        self._tried, self._done = bool(first.structure), 0

    def __reduce__(self) -> tuple[Callable[[SweepInput], Runs], tuple[SweepInput]]:
        return runs_of, (self.work,)

    def units(self) -> dict[str, str]:
        """Return the units of the columns; {} before the first compilation."""
        for form in self._forms.known:
            for session in form.compiled.known[:1]:
                return of_table(session.equations, self.columns)
        return {}

    def made(
        self, numbers: Sequence[int], interrupt: Interrupt
    ) -> Iterator[list[SweepRow]]:
        """Yield the rows of runs: one at a time, or AT_ONCE if only ends are requested.

        After an interrupt there are fewer rows.
        """
        left = numbers
        while left and not interrupt.asked:
            # The first run shows how the others are made.
            size = AT_ONCE if self.batch is not None else 1
            rows = self._rows(left[:size], interrupt)
            yield rows
            if len(rows) < len(left[:size]):
                return
            left = left[size:]

    def _rows(self, numbers: Sequence[int], interrupt: Interrupt) -> list[SweepRow]:
        together: list[SweepRow | None] = [None] * len(numbers)
        if self.batch is not None:
            together = self.batch.rows(numbers, interrupt)
        found = []
        for number, plain in zip(numbers, together, strict=False):
            row = plain or self.row(number, interrupt)
            if row is None:
                break
            found.append(row)
        return found

    def row(self, number: int, interrupt: Interrupt) -> SweepRow | None:
        """Return the row of a run; None after an interrupt."""
        self._done += 1
        if self._done % COLLECTED == 0 and not gc.isenabled():
            gc.collect(0)
        grid = self.work.grid
        try:
            session = self._forms.session(grid.texts(number))
        except (InputError, StartError) as error:
            found = refused_trial(error)
            return SweepRow(grid.values(number), found.outcome, reason=found.reason)
        own, work = session.columns.of_table, self.work
        extremes = _observer(session)
        if work.kept is not None:
            made = self._written(number, session, extremes, interrupt)
        else:
            bars = work.error_bars
            made = Attempts(extremes, interrupt, Stopwatch(), error_bars=bars).best(
                session
            )
        trajectory, bar = made.trajectory, made.bar
        if trajectory.outcome is Outcome.INTERRUPTED:
            return None
        if work.ends and not self._tried:
            self._tried = True
            batch = Batch(session, work, len(self.columns))
            self.batch = None if batch.refusal else batch
        model, complete = session.case.model, trajectory.outcome.complete
        numbers = extremes.end[None] if work.ends else extremes.stacked
        # Columns that a run with other members lacks are nan.
        cells = np.full((len(numbers), len(self.columns)), np.nan)
        cells[:, [self.columns.index(name) for name in own]] = numbers
        return SweepRow(
            tuple(value_of(model, axis.name) for axis in grid.axes),
            trajectory.outcome.word,
            complete,
            None if isinstance(bar, str) else bar.relative,
            "" if complete else trajectory.reason,
            cells,
            _mark(session),
        )

    def _written(
        self, number: int, session: Session, extremes: Extremes, interrupt: Interrupt
    ) -> Attempt:
        """Make a run, and write its folder of results."""
        from lagsim.outputs.results import MANIFEST, open_results

        clock, work = Stopwatch(), self.work
        assert work.kept is not None
        width = len(str(work.grid.runs))  # its number is its row in sweep.csv, from 1
        folder = Path(work.kept, f"run-{number + 1:0{width}}")
        units = of_table(session.equations, session.columns.of_table)
        with open_results(folder) as results:
            path = results.part(TableFormat.CSV.file)
            with contextlib.closing(
                table_writer(TableFormat.CSV, path, units, show_units=False)
            ) as writer:
                found = Attempts(
                    writer, interrupt, clock, error_bars=work.error_bars,
                    thinned=work.plots, followers=[extremes],
                ).best(session)  # fmt: skip
                if found.fault is not None:
                    raise found.fault
                writer.finish()
            undrawn = results.fill(other_files(found))
            cautions = [*results.cautions, *found.cautions(), *undrawn]
            clock.lap("output")
            files = [*results.names, MANIFEST]
            record = found.record(cautions, clock.timings, files)
            results.commit(encode(record | {"sha256": results.digests()}))
        return found


@functools.lru_cache(maxsize=2)
def runs_of(work: SweepInput) -> Runs:
    """Return the runs of a sweep in this process."""
    return Runs(work)


def _mark(session: Session) -> int:
    """Return a number that is equal for runs with equal compiled functions."""
    watched = [(x.kind, x.power) for x in session.system.indicators]
    return zlib.crc32(repr((session.plan.form, watched)).encode())


def _observer(session: Session) -> Extremes:
    """Return the observer of the values of each column of a run."""
    settings, columns = session.case.settings, len(session.columns.of_table)
    if settings.measured_from is None:
        return Extremes(columns)
    # Row k is at start + k*output_step, rounded.
    since = settings.measured_from - SAME_STEP * settings.output_step
    return Measures(columns, since)


class Batch:
    """Ends of runs of one form, many at once.

    Attributes
    ----------
    refusal : str
        The reason why each run must be made separately, or "".
    """

    def __init__(self, session: Session, work: SweepInput, columns: int) -> None:
        self.session, self.grid, self.columns = session, work.grid, columns
        self.options = dict(work.options)
        equations, axes = session.equations, self.grid.axes
        names = {axis.name for axis in axes}
        words = {word for x in axes for y in x.texts for word in _WORD.findall(y)}
        self._follow = equations.model.stated.depends_on(names) or bool(words & names)
        powers = names_in_exponents(equations, ())
        self.refusal = refusal(session)
        if session.case.settings.rest or not needs_no_solve(equations):
            self.refusal = "start values are solved for by the constraints"
        elif powers and (self._follow or not powers.isdisjoint(names)):
            self.refusal = "a swept value is in an exponent"
        if not self.refusal:
            self._ensemble = Ensemble(session)

    def rows(
        self, numbers: Sequence[int], interrupt: Interrupt
    ) -> list[SweepRow | None]:
        """Return the rows of runs; None for a run that must be made separately.

        After an interrupt the list is empty.
        """
        values = self._followed if self._follow else self._plain
        parameters, starts, swept = values(numbers)
        clear = self._clear(parameters, starts)
        ends = self._ensemble.ends(parameters, starts, interrupt)
        if ends is None:
            return []
        clear &= (ends.codes == ENDED) & self._keeps_energy(ends)
        cells, form = ends.ended[:, None, : self.columns], _mark(self.session)
        return [
            SweepRow(tuple(own), DONE, True, None, "", cell, form) if plain else None
            for own, cell, plain in zip(swept.tolist(), cells, clear, strict=True)
        ]

    def _plain(self, numbers: Sequence[int]) -> Values:
        """Return the values of runs where no expression depends on the swept names.

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
        """Return the values of runs where expressions depend on the swept names.

        The model is bound to the values of each run; nan if that fails.
        """
        case, axes = self.session.case, self.grid.axes
        unbound = case.model
        names = [p.name for p in unbound.parameters]
        sizes = len(names), len(case.equations.state), len(axes)
        found, starts, swept = (np.full((len(numbers), k), np.nan) for k in sizes)
        for k, number in enumerate(numbers):
            with contextlib.suppress(LagsimError):
                model = unbound.bind(**self.grid.texts(number))
                if wanted(model, "sweep", self.options) == case.settings:
                    found[k] = [p.value for p in model.parameters]
                    starts[k] = [x.value for x in model.initial[: sizes[1]]]
                    swept[k] = [value_of(model, axis.name) for axis in axes]
        return dict(zip(names, found.T, strict=True)), starts, swept

    def _clear(self, parameters: Mapping[str, Floats], starts: Floats) -> Flags:
        """Mark runs (runs,) whose start is admissible without a full examination."""
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
        """Mark runs (runs,) in which energy less work is equal at both ends."""
        names = self.session.columns.names
        at = {x: names.index(x) for x in ENERGIES if x in names}
        moved = {x: ends.ended[:, k] - ends.begun[:, k] for x, k in at.items()}
        drift = moved["energy"] - moved.get("work", 0.0)
        size = np.abs(ends.ended[:, at.get("kinetic", at["energy"])])
        play = np.maximum.reduce([size, *map(np.abs, moved.values())])
        kept: Flags = np.abs(drift) <= KEPT * UNEXPLAINED * play
        return kept


# --- The ends of many runs of one session, with other parameters and other starts
#
# A loop over calls of the kernel in the memory of one run: no observers, no rows but
# those of the start and of the end. Each run has the bits that it has alone.


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


def refusal(session: Session) -> str:
    """Return the reason why a run needs more than calls of the kernel, or ""."""
    plan, system = session.plan, session.system
    if system.m or system.watched:
        return "constraints and switches are located in each run separately"
    if plan.reduction.eliminated:
        return "eliminated coordinates are recovered in each run separately"
    if system.model.until is not None:
        return "`until` is located in each run separately"
    if system.model.events:
        return "events act in each run separately"
    if plan.switches.modes or system.timed:
        return "events at given times are located in each run separately"
    return ""


class Ensemble:
    """Runs of a session with one kernel memory.

    Only for sessions for which `refusal` returns "".
    """

    def __init__(self, session: Session) -> None:
        self._system = session.system.bound(session.system.model, session.plan)
        run = Run(session._replace(system=self._system).first_arc(), [])
        run.begin()
        self._arc = run.arc
        self._start = run.arc.state.copy()

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
        arc, p = self._arc, self._system.p
        places = [self._system.place(name) for name in parameters]
        values = np.array(list(parameters.values())).T
        codes = np.empty(len(starts))
        rows = np.empty((len(starts), 2, self._system.rows_observed))
        for k, start in enumerate(starts):
            arc.state.flat[:] = self._start.flat
            arc.y[: len(start)] = start
            if places:
                p.flat[places] = values[k]
            arc.runner.prepare()
            first = arc.row()
            codes[k] = code = arc.runner.advance(arc.state, LONG, LONG)
            while code == BLOCK_FULL:
                codes[k] = code = arc.runner.advance(arc.state, LONG, LONG)
            rows[k] = arc.runner.tabulate(np.concatenate([first, arc.row()]))
            if interrupt is not None and interrupt.asked:
                return None
        return Ends(codes, rows[:, 0], rows[:, 1])
