"""The runs of a sweep: a piece of them in whichever process, compiled once in each.

A piece knows all that it needs, so that it may be done anywhere. What a process has
compiled serves all pieces that it gets. What comes of a run are the numbers that a run
alone gives; where values need other functions (another method suits them, say), the
model is taken from its beginning once more, and what that gives serves others, too.
"""

from __future__ import annotations

import functools
import gc
import pickle
import zlib
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.errors import InputError
from lagsim.mechanics.equations import derive
from lagsim.outputs.units import of_table
from lagsim.run.observers.extremes import Extremes
from lagsim.run.session import Clock, Session, StartError, examined, wanted
from lagsim.run.system.columns import Columns
from lagsim.run.trajectory import Outcome
from lagsim.studies.attempts import Attempts, ErrorBars
from lagsim.studies.sweep.ends import EndsOfRuns
from lagsim.studies.sweep.grid import Grid, bound, value_of
from lagsim.studies.sweep.kept import written

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt
    from lagsim.studies.attempts import Attempt

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
    complete: bool
    error: float | None
    reason: str
    numbers: Floats
    form: int


def rows_of(piece: Piece, interrupt: Interrupt) -> list[tuple[int, Row]]:
    """Make the rows of a piece; fewer where an end is asked for."""
    return [row for rows in made(piece, interrupt) for row in rows]


def made(piece: Piece, interrupt: Interrupt) -> Iterator[list[tuple[int, Row]]]:
    """Make them one by one; of ends alone some at a time."""
    runs = runs_of(piece.work)
    numbers = piece.numbers
    if piece.work.ends and numbers:
        # The first run tells how the others are made.
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
            values = tuple(grid.values(number))
            return Row(values, outcome, False, None, _reason(error), NOTHING, 0)
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
    watched = [(x.kind, x.power) for x in session.system.sleepers]
    return zlib.crc32(repr((session.plan.form, watched)).encode())
