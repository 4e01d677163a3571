"""`lagsim run`: check, derive, integrate, write."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._closing import progress_bar, summary
from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import (
    AsJson,
    ModelPath,
    Sets,
    Strict,
    assignments,
    refused,
    show_json,
)
from lagsim.cli._streams import UnwritableError, complain, say
from lagsim.cli._writing import commit, cut_short, open_table
from lagsim.methods import names
from lagsim.model.settings import DEFAULT_ROWS, DEFAULT_RTOL, ROWS_TO_DECAY
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
    no_plots: Annotated[bool, typer.Option("--no-plots", help="No pictures.")] = False,
    as_json: AsJson = False,
    quiet: Annotated[
        bool, typer.Option("-q", "--quiet", help="Say nothing unless it fails.")
    ] = False,
    strict: Strict = False,
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
        folder, error_bar, plots=not no_plots, as_json=as_json, quiet=quiet,
        strict=strict,
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
        *,
        plots: bool,
        as_json: bool,
        quiet: bool,
        strict: bool,
    ) -> None:
        self.folder = folder
        self.error_bars = error_bars
        self.plots = plots
        self.as_json = as_json
        self.quiet = quiet
        self.strict = strict
        # The processor time so far is close to what starting and importing took.
        self.clock = Clock()
        self.clock.timings["import"] = time.process_time()

    def run(
        self, path: str, overrides: Mapping[str, str], options: Mapping[str, str]
    ) -> int:
        """Do it; give the exit code."""
        from lagsim.model.reader import read_file

        clock = self.clock
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

        columns, interrupt = session.system.columns, Interrupt()
        with open_table(results, columns.names[: columns.table]) as writer, (
            interrupt.noted()
        ):  # fmt: skip
            found = Attempts(
                writer, interrupt, self.clock, error_bars=self.error_bars,
                thinned=self.plots, progress=partial(progress_bar, quiet=self.quiet),
            ).best(session)  # fmt: skip
            full = found.fault or self._write(found, results)
            cautions = found.cautions()
            self.clock.lap("output")
            files = [*results.names, MANIFEST]
            document = found.record(cautions, self.clock.timings, files)
            if full:
                document |= cut_short(writer, found, full)
            if self.folder is None and (before := results.before()):
                from lagsim.outputs.replaced import replaced

                caution = replaced(before, document, results.folder)
                document["warnings"] += [caution._asdict()] if caution else []
            commit(results, document, {})
        self._report(found, document, results.folder)
        if full:
            return UnwritableError.exit_code
        if interrupt.signal is not None:
            return 128 + interrupt.signal
        if not found.trajectory.outcome.complete:
            return 3
        return self._strictly(found, document)

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

    def _strictly(self, found: Attempt, document: Mapping[str, Any]) -> int:
        """Give the exit code of a run that is complete; say why it is not 0."""
        cautions = document["warnings"]
        if not (self.strict and cautions):
            return 0
        from lagsim.cli._github import ERROR, annotate

        model = found.session.case.equations.model
        told = refused(model.name, [caution["code"] for caution in cautions])
        complain(told)
        annotate(ERROR, told.removeprefix("lagsim: "), model.file)
        return 1

    def _report(
        self, found: Attempt, document: Mapping[str, Any], folder: Path
    ) -> None:
        if not document["complete"]:
            complain(f"lagsim: {document['reason']}")
        if not self.quiet or self.strict:
            for caution in document["warnings"]:
                complain(f"warning: {caution['text']}")
        if self.as_json:
            show_json(document)
        elif not self.quiet:
            say(summary(found, document, folder))
