"""The runs of a sweep: a piece of them in whichever process, compiled once in each.

A piece knows all that it needs, so that it may be done anywhere. What a process has
compiled serves all pieces that it gets. What comes of a run are the numbers that a run
alone gives; where values need other functions (another method suits them, say), the
model is taken from its beginning once more, and what that gives serves others, too.

Where the ends of runs are all that is asked for, many are made at a time: starts and
values of a whole piece are looked at together, the runs are calls of the kernel in one
memory. What is not plain in any of this is made as a run by itself, which gives the
same numbers: a start that needs a closer look, a run that comes to anything but its
end, energy that is not kept, a model that `run.ensemble` refuses.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import pickle
import zlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.inertia import clear_starts, needs_no_solve
from lagsim.errors import InputError, LagsimError
from lagsim.mechanics.equations import derive
from lagsim.methods.parts.state import DONE as ENDED
from lagsim.outputs.units import of_table
from lagsim.run.ensemble import Ensemble, refusal
from lagsim.run.observers import Extremes, Followed
from lagsim.run.session import Clock, Session, StartError, examined, wanted
from lagsim.run.system.functions import Columns
from lagsim.run.system.localized import names_in_exponents
from lagsim.run.trajectory import Outcome
from lagsim.studies.alarms import UNEXPLAINED
from lagsim.studies.attempts import Attempts, ErrorBars
from lagsim.studies.drawing import beside
from lagsim.studies.sweep.grid import Grid, bound, value_of

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Model
    from lagsim.run.ensemble import Ends
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.attempts import Attempt

# A run whose energy less work ends so far from where it began, as a part of what is in
# play at both ends, is looked at by its rows: a tenth of what raises a doubt there.
KEPT = 0.1
TOLD = ("energy", "work", "kinetic", "potential")


class Values(NamedTuple):
    """What the runs of a piece differ in.

    Attributes
    ----------
    parameters : dict of str to ndarray (runs,)
    starts : ndarray, shape (runs, 2 n)
        Positions, then velocities.
    swept : ndarray, shape (runs, axes)
    """

    parameters: dict[str, Floats]
    starts: Floats
    swept: Floats


class EndsOfRuns:
    """Makes ends for the runs of a session's form.

    Attributes
    ----------
    refusal : str
        Why each is made by itself; "" where none needs it.
    """

    def __init__(
        self, session: Session, grid: Grid, options: Mapping[str, str]
    ) -> None:
        self.session, self.grid, self.options = session, grid, options
        self.refusal = refusal(session) or self._refusal()
        if not self.refusal:
            self._ensemble = Ensemble(session)

    def _refusal(self) -> str:
        equations = self.session.case.equations
        if not needs_no_solve(equations):
            return "start values are solved for by the constraints"
        names = {axis.name for axis in self.grid.axes}
        self._follow = equations.model.rests_on(names) or any(
            axis.says(names) for axis in self.grid.axes
        )
        powers = names_in_exponents(equations, ())
        if powers and (self._follow or not powers.isdisjoint(names)):
            return "a swept value is in an exponent"
        return ""

    def made(
        self, numbers: Sequence[int], interrupt: Interrupt
    ) -> tuple[Values, Flags, Ends] | None:
        """Give values of runs, which of them have ended plainly, and their ends.

        None where an end is asked for.
        """
        values = self._followed(numbers) if self._follow else self._plain(numbers)
        clear = self._clear(values)
        ends = self._ensemble.ends(values.parameters, values.starts, interrupt)
        if ends is None:
            return None
        clear &= (ends.codes == ENDED) & self._keeps_energy(ends)
        return values, clear, ends

    def _plain(self, numbers: Sequence[int]) -> Values:
        """Give values that nothing else follows."""
        case, grid = self.session.case, self.grid
        start = np.concatenate([case.start.q, case.start.v])
        starts = np.repeat(start[None], len(numbers), 0)
        names = (*case.equations.q, *case.equations.velocities)
        places = np.unravel_index(np.array(numbers), [len(a.texts) for a in grid.axes])
        parameters, swept = {}, []
        for axis, place in zip(grid.axes, places, strict=True):
            values = np.array(axis.values)[place]
            swept.append(values)
            if axis.starts:
                starts[:, names.index(axis.name)] = values
            else:
                parameters[axis.name] = values
        return Values(parameters, starts, np.array(swept).T)

    def _followed(self, numbers: Sequence[int]) -> Values:
        """Give values as each run by itself binds them; nan for what cannot be had."""
        case, grid = self.session.case, self.grid
        equations = case.equations
        n = len(equations.q)
        names = [p.name for p in equations.model.parameters]
        found = np.full((len(numbers), len(names)), np.nan)
        starts = np.full((len(numbers), 2 * n), np.nan)
        swept = np.full((len(numbers), len(grid.axes)), np.nan)
        for k, number in enumerate(numbers):
            model = self._bound(grid.texts(number))
            if model is not None:
                found[k] = [p.value for p in model.parameters]
                starts[k] = [x.value for x in model.initial[: 2 * n]]
                swept[k] = [value_of(model, axis.name) for axis in grid.axes]
        return Values(dict(zip(names, found.T, strict=True)), starts, swept)

    def _bound(self, texts: Mapping[str, str]) -> Model | None:
        """Give the model of a run; None where it cannot be had, or asks otherwise."""
        case = self.session.case
        try:
            model = bound(case.equations.model, texts)
            settings = wanted(model, "sweep", self.options)
        except LagsimError:
            return None
        return model if settings == case.settings else None

    def _clear(self, values: Values) -> Flags:
        case = self.session.case
        equations, runs = case.equations, len(values.starts)
        known: dict[str, float | Floats] = {"t": case.settings.start}
        known |= {p.name: p.value for p in equations.model.parameters}
        known |= values.parameters
        names = (*equations.q, *equations.velocities)
        moved = np.any(values.starts != values.starts[:1], axis=0)
        for name, column, differ in zip(names, values.starts.T, moved, strict=True):
            known[name] = column if differ else float(column[0])
        given: Flags = np.all(np.isfinite(values.starts), axis=1)
        return given & clear_starts(equations, known, runs)

    def _keeps_energy(self, ends: Ends) -> Flags:
        """Tell whose energy less work has not moved, by its first and last row."""
        names = self.session.system.columns.names
        begun, ended = (
            {x: rows[:, names.index(x)] for x in TOLD if x in names}
            for rows in (ends.begun, ends.ended)
        )
        moved = {x: np.abs(ended[x] - begun[x]) for x in ended}
        drift = ended["energy"] - begun["energy"]
        if "work" in ended:
            drift -= ended["work"] - begun["work"]
        play = np.maximum.reduce(
            [*moved.values(), np.abs(ended.get("kinetic", ended["energy"]))]
        )
        kept: Flags = np.abs(drift) <= KEPT * UNEXPLAINED * play
        return kept


def written(
    session: Session,
    folder: Path,
    extremes: Extremes,
    interrupt: Interrupt,
    error_bars: ErrorBars,
    *,
    plots: bool,
) -> Attempt:
    """Make a run, and write its results.

    Raises
    ------
    InputError
        Where the folder cannot be used.
    OSError
        Where there is no room.
    """
    from lagsim.outputs import Format
    from lagsim.outputs.manifest import encode
    from lagsim.outputs.results import MANIFEST, open_results
    from lagsim.outputs.table import table_writer
    from lagsim.outputs.units import of_table

    clock = Clock()
    units = of_table(session.case.equations, session.system.columns.of_table)
    with open_results(folder) as results:
        path = results.part(Format.CSV.file)
        with contextlib.closing(
            table_writer(Format.CSV, path, units, show_units=False)
        ) as writer:
            attempts = Attempts(
                Followed(writer, extremes), interrupt, clock, error_bars=error_bars,
                thinned=plots,
            )  # fmt: skip
            found = attempts.best(session)
            if found.fault is not None:
                raise found.fault
            writer.finish()
        undrawn = list(results.fill(beside(found, found.thin, found.frames)))
        clock.lap("output")
        files = [*results.names, MANIFEST]
        record = found.record([*found.cautions(), *undrawn], clock.timings, files)
        results.commit(encode(record | {"sha256": results.digests()}))
    return found


# So many ways of compiling a model are kept; the one longest out of use goes.
MOST_FORMS = 16
# Runs that are looked at and made together: some tens of milliseconds.
AT_ONCE = 256
# Runs leave circles of objects behind, which are collected after so many: the young
# ones only, all else is there to stay.
COLLECTED = 50
DONE = Outcome.DONE.word
INADMISSIBLE, UNUSABLE = "inadmissible", "unusable"
NOTHING = np.empty((3, 0))


def packed(model: Model) -> bytes:
    """Give a model as it goes to other processes."""
    return pickle.dumps(model)


class Work(NamedTuple):
    """What all runs of a sweep have in common; `model` is a pickled Model.

    `kept` is where each run's folder goes, if it is to be kept. `ends`: of each column
    the last value is all that is asked for.
    """

    model: bytes
    options: tuple[tuple[str, str], ...]
    grid: Grid
    error_bars: ErrorBars
    kept: str | None = None
    plots: bool = False
    ends: bool = False


class Piece(NamedTuple):
    """Some runs of a sweep, by their numbers."""

    work: Work
    numbers: tuple[int, ...]


class Row(NamedTuple):
    """What came of a run.

    Attributes
    ----------
    values : tuple of float
        Of what is swept, in this run.
    error : float or None
        The estimated error, as a part of a coordinate's range.
    numbers : ndarray, shape (3, columns)
        What each column ends with, and its least and greatest value, or (1, columns)
        where ends are all that is asked for; of no columns where there was no run.
    form : int
        The same for runs with the same compiled functions; 0 where there was no run.
    """

    values: tuple[float, ...]
    outcome: str
    complete: bool = False
    error: float | None = None
    reason: str = ""
    numbers: Floats = NOTHING
    form: int = 0


@dataclass(slots=True)
class Found:
    """A sweep, and what is known of it so far.

    Attributes
    ----------
    rows : dict of int to Row
        By the number of the run.
    columns : tuple of str
        Of the runs' tables.
    units : dict of str to str
        Of the columns, where something was run.
    seconds : float
        What it took this time.
    """

    model: Model
    work: Work
    rows: dict[int, Row] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def grid(self) -> Grid:
        """What is swept."""
        return self.work.grid

    @property
    def missing(self) -> list[int]:
        """The numbers of the runs that are still to be made."""
        return [k for k in range(self.grid.runs) if k not in self.rows]


def rows_of(piece: Piece, interrupt: Interrupt) -> list[tuple[int, Row]]:
    """Make the rows of a piece; fewer where an end is asked for."""
    return [row for rows in made(piece, interrupt) for row in rows]


def made(piece: Piece, interrupt: Interrupt) -> Iterator[list[tuple[int, Row]]]:
    """Make them one by one; of ends alone some at a time."""
    runs = runs_of(piece.work)
    numbers = piece.numbers
    if piece.work.ends and numbers:
        # The first run shows how the others are made.
        first = runs.row(numbers[0], interrupt)
        if first is None:
            return
        yield [(numbers[0], first)]
        numbers = yield from _made_together(runs, numbers[1:], interrupt)
    for number in numbers:
        row = None if interrupt.asked else runs.row(number, interrupt)
        if row is None:
            return
        yield [(number, row)]


def _made_together(
    runs: Runs, numbers: tuple[int, ...], interrupt: Interrupt
) -> Generator[list[tuple[int, Row]], None, tuple[int, ...]]:
    """Make rows of ends alone; give the runs that cannot be made so."""
    together = runs.together
    if together is None:
        return numbers
    for first in range(0, len(numbers), AT_ONCE):
        some = numbers[first : first + AT_ONCE]
        found = None if interrupt.asked else together.made(some, interrupt)
        if found is None:
            return ()
        values, plain, ends = found
        rows: list[tuple[int, Row]] = []
        cells, form = ends.ended[:, None, : len(runs.columns)], runs.form
        for k, own in enumerate(values.swept.tolist()):
            row: Row | None
            if plain[k]:
                row = Row(tuple(own), DONE, True, None, "", cells[k], form)
            else:
                row = runs.row(some[k], interrupt)
            if row is None:
                yield rows
                return ()
            rows.append((some[k], row))
        yield rows
    return ()


@functools.lru_cache(maxsize=2)
def runs_of(work: Work) -> Runs:
    """Give what this process makes the runs of a sweep with."""
    return Runs(work)


class _Form:
    """A model read and derived once, and what has been compiled for its first run."""

    def __init__(self, work: Work) -> None:
        self.model: Model = pickle.loads(work.model)
        self.options = dict(work.options)
        self.equations = derive(self.model)
        self.session: Session | None = None

    def bound(self, texts: Mapping[str, str]) -> Session | None:
        """Give the session of other values; None where they need other functions.

        Raises
        ------
        InputError, StartError
        """
        model = bound(self.model, texts)
        case = examined(self.equations, model, wanted(model, "sweep", self.options))
        if self.session is None:
            self.session = case.ready()
            return self.session
        return self.session.bound(case)


class Runs:
    """Makes runs, one after the other.

    Attributes
    ----------
    columns : tuple of str
        Those of a run's table.
    """

    def __init__(self, work: Work) -> None:
        self.work = work
        self._forms = [_Form(work)]
        columns = Columns(self._forms[0].equations, {})
        self.columns = columns.of_table
        self._done = 0

    def units(self) -> dict[str, str]:
        """Give the units of the columns, where something has been compiled."""
        sessions = [form.session for form in self._forms if form.session is not None]
        if not sessions:
            return {}
        return of_table(sessions[0].case.equations, self.columns)

    def row(self, number: int, interrupt: Interrupt) -> Row | None:
        """Make a run; None where it was interrupted."""
        self._done += 1
        if self._done % COLLECTED == 0 and not gc.isenabled():
            gc.collect(0)
        grid = self.work.grid
        try:
            session = self._session(grid.texts(number))
        except (StartError, InputError) as error:
            outcome = INADMISSIBLE if isinstance(error, StartError) else UNUSABLE
            return Row(tuple(grid.values(number)), outcome, reason=_reason(error))
        extremes = Extremes(len(self.columns))
        found = self._attempt(number, session, extremes, interrupt)
        trajectory, bar = found.trajectory, found.bar
        if trajectory.outcome is Outcome.INTERRUPTED:
            return None
        model, complete = session.case.equations.model, trajectory.outcome.complete
        return Row(
            tuple(value_of(model, axis.name) for axis in grid.axes),
            trajectory.outcome.word,
            complete,
            None if isinstance(bar, str) else bar.relative,
            "" if complete else trajectory.reason,
            extremes.end[None] if self.work.ends else extremes.told,
            _mark(session),
        )

    def _session(self, texts: Mapping[str, str]) -> Session:
        """Give the session of a run, compiled if need be."""
        for k, form in enumerate(self._forms):
            session = form.bound(texts)
            if session is not None:
                self._forms.insert(0, self._forms.pop(k))
                return session
        new = _Form(self.work)
        self._forms = [new, *self._forms[: MOST_FORMS - 1]]
        session = new.bound(texts)
        assert session is not None
        return session

    def _attempt(
        self, number: int, session: Session, extremes: Extremes, interrupt: Interrupt
    ) -> Attempt:
        work = self.work
        if work.kept is not None:
            folder = Path(work.kept, folder_of(number, work.grid))
            return written(
                session, folder, extremes, interrupt, work.error_bars, plots=work.plots
            )
        attempts = Attempts(extremes, interrupt, Clock(), error_bars=work.error_bars)
        return attempts.best(session)

    @cached_property
    def together(self) -> EndsOfRuns | None:
        """What makes the ends of many runs at once, of the form of the last one.

        None where there is none, or its runs are made one by one.
        """
        form = self._forms[0]
        if form.session is None:
            return None
        found = EndsOfRuns(form.session, self.work.grid, form.options)
        return None if found.refusal else found

    @property
    def form(self) -> int:
        """The number of that form."""
        session = self._forms[0].session
        assert session is not None
        return _mark(session)


def _reason(error: StartError | InputError) -> str:
    if isinstance(error, StartError):
        return str(error)
    return "; ".join(problem.text for problem in error.problems)


def folder_of(number: int, grid: Grid) -> str:
    """Give the name of a run's folder: its row in sweep.csv, from 1."""
    return f"run-{number + 1:0{len(str(grid.runs))}}"


def _mark(session: Session) -> int:
    """Give a number that runs share for which the same functions were compiled."""
    watched = [(x.kind, x.power) for x in session.system.indicators]
    return zlib.crc32(repr((session.plan.form, watched)).encode())
