"""Runs of a sweep at all combinations of its values.

Runs are made in pieces by any process, and functions are compiled once in each process.

A piece is self-contained. The functions that a process has compiled are used for all
its pieces, with results equal in every bit to those of a separate run. If values need
other functions (because another method suits these values, for example), the model is
read again, and its functions serve later runs, too.

The first run is made separately; it shows whether others can be made in batches.
"""

from __future__ import annotations

import contextlib
import functools
import gc
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError
from lagsim.outputs import TableFormat
from lagsim.outputs.manifest import encode
from lagsim.outputs.table import table_writer
from lagsim.outputs.units import of_table
from lagsim.program.output_row import Columns
from lagsim.run.session import StartError, Stopwatch
from lagsim.run.trajectory import Outcome
from lagsim.studies.attempts import Attempt, Attempts, Records
from lagsim.studies.drawing import other_files
from lagsim.studies.sweep.batches import Batch, form_of, observer_of
from lagsim.studies.sweep.grid import SweepInput, SweepRow, value_of
from lagsim.studies.trial import Compiled, refused_trial
from lagsim.studies.trials import Forms, structural_values

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Extremes
    from lagsim.run.session import Session

# Runs between two collections of the young generation of objects, since runs leave
# reference cycles.
COLLECTED = 50


class Runs:
    """Runs of a sweep in one process.

    Parameters
    ----------
    work : SweepInput
        The input of the sweep.

    Attributes
    ----------
    columns : tuple of str
        Columns of the tables of the runs; their union, if the number of members of a
        family varies.
    batch : Batch or None
        Computes many runs at once, for the form of the first run; None if runs are made
        one by one.
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
        self._compiled = Compiled()
        self._tried, self._done = bool(first.structure), 0

    def __reduce__(self) -> tuple[Callable[[SweepInput], Runs], tuple[SweepInput]]:
        return runs_of, (self.work,)

    def units(self) -> dict[str, str]:
        """Return the units of the columns; {} before the first compilation."""
        for form in self._forms.known:
            for session in form.compiled.known[:1]:
                return of_table(session.equations, self.columns)
        return {}

    def rows(
        self, numbers: Sequence[int], interrupt: Interrupt
    ) -> Iterator[list[SweepRow]]:
        """Make runs; yield their rows in lists: a single row, or the rows of a batch.

        After an interrupt there are fewer rows.

        numbers : indices of the runs.
        """
        left = numbers
        while left and not interrupt.requested:
            # The first run shows how the others are made.
            size = self.batch.size if self.batch is not None else 1
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
        """Return the row of the run with an index; None after an interrupt."""
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
        extremes = observer_of(session)
        if work.folder is not None:
            made = self._written(number, session, extremes, interrupt)
        else:
            bars = work.error_bars
            made = Attempts(
                extremes,
                interrupt,
                Stopwatch(),
                error_bars=bars,
                compiled=self._compiled,
            ).best(session)
        trajectory, bar = made.trajectory, made.bar
        if trajectory.outcome is Outcome.INTERRUPTED:
            return None
        if work.folder is None and not self._tried:
            self._tried = True
            batch = Batch(session, work, len(self.columns))
            self.batch = None if batch.refusal else batch
        model, complete = session.case.model, trajectory.outcome.complete
        numbers = extremes.end[None] if work.ends else extremes.stacked
        # Columns that a run with other members does not have are nan.
        cells = np.full((len(numbers), len(self.columns)), np.nan)
        cells[:, [self.columns.index(name) for name in own]] = numbers
        return SweepRow(
            tuple(value_of(model, axis.name) for axis in grid.axes),
            trajectory.outcome.word,
            complete,
            None if isinstance(bar, str) else bar.relative,
            "" if complete else trajectory.reason,
            cells,
            form_of(session),
        )

    def _written(
        self, number: int, session: Session, extremes: Extremes, interrupt: Interrupt
    ) -> Attempt:
        """Execute a run, write its folder of results, and return the attempt.

        number : index of the run.
        extremes : observer of its columns.
        """
        from lagsim.outputs.results import MANIFEST, open_results

        clock, work = Stopwatch(), self.work
        assert work.folder is not None
        # the number of the run is its row in sweep.csv, from 1
        width = len(str(work.grid.runs))
        folder = Path(work.folder, f"run-{number + 1:0{width}}")
        units = of_table(session.equations, session.columns.of_table)
        with open_results(folder) as results:
            path = results.part(TableFormat.CSV.file)
            with contextlib.closing(
                table_writer(TableFormat.CSV, path, units, show_units=False)
            ) as writer:
                found = Attempts(
                    writer, interrupt, clock, error_bars=work.error_bars,
                    records=Records(thinned=work.plots), followers=[extremes],
                    compiled=self._compiled,
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
    """Return the runs of a sweep in this process.

    work : the input of the sweep.
    """
    return Runs(work)
