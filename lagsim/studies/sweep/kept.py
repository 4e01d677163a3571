"""The folder of one run of a sweep: what the run alone would write."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from lagsim.run.observers.extremes import Extremes, Followed
from lagsim.run.session import Clock
from lagsim.studies.attempts import Attempts, ErrorBars
from lagsim.studies.beside import beside

if TYPE_CHECKING:
    from pathlib import Path

    from lagsim.run.interrupt import Interrupt
    from lagsim.run.session import Session
    from lagsim.studies.attempts import Attempt


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
