"""The folder of one run of a sweep: what the run alone would write."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from lagsim.run.observers.extremes import Extremes, Followed
from lagsim.run.session import Clock
from lagsim.studies.attempts import Attempts, ErrorBars

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
    from lagsim.outputs import table
    from lagsim.outputs.manifest import encode
    from lagsim.outputs.results import MANIFEST, open_results

    clock, columns = Clock(), session.system.columns
    names = columns.names[: columns.table]
    with open_results(folder) as results:
        path = results.part(table.NAME)
        with contextlib.closing(table.TableWriter(path, names)) as writer:
            attempts = Attempts(
                Followed(writer, extremes), interrupt, clock, error_bars=error_bars,
                thinned=plots,
            )  # fmt: skip
            found = attempts.best(session)
            if found.fault is not None:
                raise found.fault
        for name, content in found.files(found.thin):
            results.write(name, content)
        clock.lap("output")
        files = [*results.names, MANIFEST]
        results.commit(encode(found.record(found.cautions(), clock.timings, files)))
    return found
