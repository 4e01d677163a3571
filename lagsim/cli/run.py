"""`lagsim run`: check, derive, integrate, write."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._closing import progress_bar, summary
from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import AsJson, ModelPath, Sets, assignments, show_json
from lagsim.cli._streams import UnwritableError, complain, say
from lagsim.cli._writing import commit, cut_short, finish, open_table
from lagsim.errors import InputError, Problem
from lagsim.methods import names
from lagsim.model.settings import DEFAULT_ROWS, DEFAULT_RTOL, ROWS_TO_DECAY
from lagsim.outputs import Format
from lagsim.run.session import Clock, open_case, wanted
from lagsim.studies.attempts import ErrorBars

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.outputs.results import Results
    from lagsim.run.session import Session
    from lagsim.studies.attempts import Attempt


def command(
    model: ModelPath,
    folder: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder; default results/NAME."
        ),
    ] = None,
    sets: Sets = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="M",
            help="Integration method; see `lagsim methods`.",
            autocompletion=lambda: ["auto", *names()],
        ),
    ] = None,
    rtol: Annotated[
        str | None,
        typer.Option(
            metavar="X", help=f"Relative tolerance; default {DEFAULT_RTOL:g}."
        ),
    ] = None,
    atol: Annotated[
        str | None,
        typer.Option(
            metavar="X",
            help="Absolute tolerance; default rtol times each component's scale.",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="H", help="Step of fixed-step methods; default the output step."
        ),
    ] = None,
    formulation: Annotated[
        str | None,
        typer.Option(
            metavar="F",
            help="How constraints are met: projection, elimination, baumgarte, "
            "drift; full: nothing is reduced.",
        ),
    ] = None,
    gain: Annotated[
        str | None,
        typer.Option(
            metavar="X",
            help="Of baumgarte, per unit of time; "
            f"default {1 / ROWS_TO_DECAY:g}/output step.",
        ),
    ] = None,
    spectral_radius: Annotated[
        str | None,
        typer.Option(metavar="X", help="Of generalized-alpha, from 0 to 1."),
    ] = None,
    duration: Annotated[
        str | None, typer.Option(metavar="T", help="How long to run.")
    ] = None,
    output_step: Annotated[
        str | None,
        typer.Option(
            metavar="H", help=f"Spacing of rows; default duration/{DEFAULT_ROWS}."
        ),
    ] = None,
    error_bar: Annotated[
        ErrorBars,
        typer.Option(
            help="Repeat the run more tightly to estimate its error; auto: where that "
            "takes no more than about 2 s."
        ),
    ] = ErrorBars.AUTO,
    table: Annotated[
        Format, typer.Option(help="How the table is kept: trajectory.csv, and so on.")
    ] = Format.CSV,
    units: Annotated[
        bool, typer.Option("--units", help="A line of units below the header of CSV.")
    ] = False,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="No pictures.")] = False,
    as_json: AsJson = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Say nothing unless it fails.")
    ] = False,
) -> int:
    """Check the start, integrate, write a table and pictures."""
    options = {
        "method": method,
        "rtol": rtol,
        "atol": atol,
        "step": step,
        "formulation": formulation,
        "gain": gain,
        "spectral_radius": spectral_radius,
        "duration": duration,
        "output_step": output_step,
    }
    given = {name: text for name, text in options.items() if text is not None}
    job = _Job(
        folder, error_bar, table, show_units=units, plots=not no_plots,
        as_json=as_json, quiet=quiet,
    )  # fmt: skip
    documents: list[Any] = []
    with faults_shown(documents if as_json else None, file=model) as code:
        code.append(job.run(model, assignments(sets), given))
    for faults in documents:
        show_json(faults)
    return code[-1]


class _Job:
    """One run of one model, with its clock and its manners."""

    def __init__(
        self,
        folder: Path | None,
        error_bars: ErrorBars,
        table: Format,
        *,
        show_units: bool,
        plots: bool,
        as_json: bool,
        quiet: bool,
    ) -> None:
        self.folder = folder
        self.error_bars = error_bars
        self.table, self.show_units = table, show_units
        self.plots = plots
        self.as_json = as_json
        self.quiet = quiet
        # The processor time so far is close to what starting and importing took.
        self.clock = Clock()
        self.clock.timings["import"] = time.process_time()

    def run(
        self, path: str, overrides: Mapping[str, str], options: Mapping[str, str]
    ) -> int:
        """Do it; give the exit code."""
        from lagsim.model.reader import read_file

        clock = self.clock
        if self.show_units and self.table is not Format.CSV:
            text = f"--units means nothing with --table {self.table}"
            hint = "run.json has the units of all columns, and Parquet its own"
            raise InputError([Problem("usage", text, hint=hint)])
        clock.lap("import")
        model = read_file(path, overrides, options)
        settings = wanted(model, "run", hint="add it, or give --duration")
        clock.lap("read")
        session = open_case(model, settings, clock=clock).ready(clock=clock)
        from lagsim.outputs.results import open_results

        with open_results(self.folder or Path("results") / model.name) as results:
            return self._integrate(session, results)

    def _integrate(self, session: Session, results: Results) -> int:
        from lagsim.outputs.results import MANIFEST
        from lagsim.run.interrupt import Interrupt
        from lagsim.studies.attempts import Attempts

        units, interrupt = session.system.units(), Interrupt()
        table = open_table(results, self.table, units, show_units=self.show_units)
        with table as writer, interrupt.noted():
            found = Attempts(
                writer, interrupt, self.clock, error_bars=self.error_bars,
                thinned=self.plots, progress=partial(progress_bar, quiet=self.quiet),
            ).best(session)  # fmt: skip
            lost = finish(writer, results, self.table)
            full = lost or found.fault or self._write(found, results)
            cautions = found.cautions()
            self.clock.lap("output")
            files = [*results.names, MANIFEST]
            document = found.record(cautions, self.clock.timings, files)
            if full:
                document |= cut_short(writer, found, full, lost=lost is not None)
            commit(results, document, {})
        self._report(found, document, results.folder)
        if full:
            return UnwritableError.exit_code
        if interrupt.signal is not None:
            return 128 + interrupt.signal
        return 0 if found.trajectory.outcome.complete else 3

    def _write(self, found: Attempt, results: Results) -> OSError | None:
        """Write what stands beside the table; give what kept one from being written."""
        try:
            for name, content in found.files(found.thin):
                results.write(name, content)
        except OSError as error:
            return error
        finally:
            if found.thin is not None:
                self.clock.lap("plots")
        return None

    def _report(
        self, found: Attempt, document: Mapping[str, Any], folder: Path
    ) -> None:
        if not document["complete"]:
            complain(f"lagsim: {document['reason']}")
        if not self.quiet:
            for caution in document["warnings"]:
                complain(f"warning: {caution['text']}")
        if self.as_json:
            show_json(document)
        elif not self.quiet:
            say(summary(found, document, folder))
