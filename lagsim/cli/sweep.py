"""`lagsim sweep`: one model at many values of parameters and of its start."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.cli._closing import progress_bar
from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import (
    AsJson,
    Jobs,
    ModelPath,
    Quiet,
    Sets,
    assignments,
    coloured,
    counted,
    output_folder,
    show_json,
    table,
)
from lagsim.cli._streams import UnwritableError, complain, say
from lagsim.cli._writing import commit, sorted_out
from lagsim.cli.run import ErrorBar, with_settings
from lagsim.errors import InputError, LagsimError, Problem
from lagsim.files import content
from lagsim.model.reader import read_file
from lagsim.outputs.results import open_results
from lagsim.run.interrupt import Interrupt
from lagsim.run.session import wanted
from lagsim.studies.attempts import ErrorBars
from lagsim.studies.sweep.grid import parsed
from lagsim.studies.sweep.runs import INADMISSIBLE, Found, Work, packed
from lagsim.studies.sweep.sweeping import (
    JOURNAL,
    MANIFEST,
    Journal,
    document,
    identity,
    made_of,
    mark,
    sweep,
)
from lagsim.studies.workers import cores, machines, processes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.outputs.results import Results
    from lagsim.studies.workers import Hired

# So many letters of a reason are shown; the table has all of it.
REASON = 160


def _names(context: typer.Context, incomplete: str) -> list[str]:
    """Give what may be swept of the model that stands before it."""
    try:
        model = read_file(str(context.params["model"]))
    except (LagsimError, KeyError):
        return []
    names = [p.name for p in model.parameters] + [x.name for x in model.initial]
    return [f"{name}=" for name in names if name.startswith(incomplete)]


@with_settings
def command(
    model: ModelPath,
    values: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME=A:B:N|NAME=V1,V2,...",
            help="A parameter or a start value, and its values: N values from A to B, "
            "or a list; each may be an expression.",
            autocompletion=_names,
        ),
    ],
    folder: Annotated[
        Path | None, output_folder("Output folder; default results/NAME/sweep.")
    ] = None,
    jobs: Jobs = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the results of each run in DIR/run-K.")
    ] = False,
    ends: Annotated[
        bool,
        typer.Option(
            "--ends",
            help="Compute only the last value of each column: no rows, no error "
            "estimate, much faster.",
        ),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue an interrupted sweep.")
    ] = False,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Address of a Dask scheduler, whose workers make the runs.",
        ),
    ] = None,
    sets: Sets = None,
    *,
    options: dict[str, str],
    error_bar: ErrorBar = ErrorBars.AUTO,
    no_plots: Annotated[bool, typer.Option("--no-plots", help="No pictures.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> int:
    """Run a model at all combinations of parameter values."""
    job = _Job(
        folder, jobs, dask, keep=keep, ends=ends, resume=resume, plots=not no_plots,
        as_json=as_json, quiet=quiet,
    )  # fmt: skip
    with faults_shown(job.documents if as_json else None, file=model) as code:
        code.append(job.run(model, values, assignments(sets), options, error_bar))
    for one in job.documents:
        show_json(one)
    return code[-1]


@dataclass
class _Job:
    """The options of the command."""

    folder: Path | None
    jobs: int | None
    dask: str | None
    keep: bool
    ends: bool
    resume: bool
    plots: bool
    as_json: bool
    quiet: bool
    documents: list[Any] = field(default_factory=list)

    def run(
        self,
        path: str,
        values: Sequence[str],
        overrides: Mapping[str, str],
        options: Mapping[str, str],
        error_bars: ErrorBars,
    ) -> int:
        """Do it; give the exit code."""
        model = read_file(path, overrides)
        hint = "add it, or give --duration"
        wanted(model, "sweep", options, hint)
        error_bars = self._error_bars(error_bars)
        grid = parsed(model, values)
        folder = self.folder or Path("results") / model.name / "sweep"
        kept = str(folder.absolute()) if self.keep else None
        work = Work(
            packed(model), tuple(options.items()), grid, error_bars, kept,
            plots=self.keep and self.plots, ends=self.ends,
        )  # fmt: skip
        with open_results(folder, MANIFEST) as results:
            return self._sweep(Found(model, work), results)

    def _error_bars(self, asked: ErrorBars) -> ErrorBars:
        """Give when runs are repeated: where no rows are made, never."""
        if not self.ends:
            return asked
        if self.keep or asked is ErrorBars.ALWAYS:
            what = "--keep" if self.keep else "--error-bar always"
            text = f"--ends makes no rows, which {what} asks for"
            raise InputError([Problem("usage", text, hint="leave one of them out")])
        return ErrorBars.NEVER

    def _sweep(self, found: Found, results: Results) -> int:

        if self.resume and (code := self._known(found, results.folder)) is not None:
            return code
        interrupt = Interrupt()
        rows = Journal(results.folder / JOURNAL, identity(found))
        try:
            with interrupt.noted(), contextlib.closing(rows):
                try:
                    if self.resume:
                        found.rows |= rows.resumed()
                    else:
                        rows.begin()
                except IsADirectoryError as error:
                    raise results.unusable(error) from None
                self._make(found, rows, interrupt)
        except OSError as error:
            text = f"lagsim: {results.folder} cannot be written: {error.strerror}"
            raise UnwritableError(text) from None
        if found.missing:
            known = f"{len(found.rows)} of {found.grid.runs} runs"
            complain(f"lagsim: interrupted; {known} are kept")
            complain("  hint: the same command with --resume continues from there")
            return 128 + (interrupt.signal or 0)
        code = self._finish(found, results)
        rows.remove()
        return code

    def _known(self, found: Found, folder: Path) -> int | None:
        """Give the exit code of a sweep that has come to its end before."""
        try:
            there = json.loads(content(folder / MANIFEST))
        except (OSError, ValueError):
            return None
        other = not isinstance(there, dict) or there.get("identity") != mark(found)
        if other or (folder / JOURNAL).exists():
            return None
        if self.as_json:
            self.documents.append(there)
        elif not self.quiet:
            say(f"nothing to do: {folder} holds this sweep, complete")
        return _code(there["outcomes"], there["complete"], there["runs"])

    def _make(self, found: Found, rows: Journal, interrupt: Interrupt) -> None:
        """Make the runs that are missing."""
        with contextlib.ExitStack() as stack:
            hired: Hired = processes
            most = self.jobs or cores()
            if self.dask is not None:
                hired, there = stack.enter_context(machines(self.dask))
                most = self.jobs or there
            progress = stack.enter_context(progress_bar("sweep", quiet=self.quiet))
            sweep(
                found, most, wanted=self.jobs is not None, hired=hired, journal=rows,
                interrupt=interrupt, progress=progress,
            )  # fmt: skip

    def _finish(self, found: Found, results: Results) -> int:
        """Write what was found, and tell it; give the exit code."""
        files, undrawn = sorted_out(made_of(found, plots=self.plots))
        content = document(found, [*files, MANIFEST]) | undrawn
        commit(results, content, files)
        missing = found.grid.runs - content["complete"]
        if missing:
            whole = counted(found.grid.runs, "run")
            complain(f"lagsim: {missing} of {whole} are not complete")
        if not self.quiet:
            for note in content["notes"]:
                complain(f"note: {note}")
        if self.as_json:
            self.documents.append(content)
        elif not self.quiet:
            say(summary(found, content, results.folder))
        return _code(content["outcomes"], content["complete"], found.grid.runs)


def _code(outcomes: Mapping[str, int], complete: int, runs: int) -> int:
    if outcomes.get(INADMISSIBLE) == runs:
        return 1
    return 0 if complete == runs else 3


def summary(found: Found, document: Mapping[str, Any], folder: Path) -> str:
    """Give the closing lines."""
    grid, complete = found.grid, document["complete"]
    colour = "32" if complete == grid.runs else "31"
    head = f"{coloured('done', colour)}: {document['model']['name']}, "
    head += f"{complete} of {counted(grid.runs, 'run')} complete"
    rows = [("swept", f"{axis.name}: {_spread(axis.values)}") for axis in grid.axes]
    first = {r.outcome: r.reason for _, r in sorted(found.rows.items(), reverse=True)}
    for outcome, count in document["outcomes"].items():
        if reason := first[outcome]:
            told = f"{counted(count, 'run')}, the first: {_cut(reason)}"
            rows.append((outcome, told))
    seconds = document["timings"]["runs"]
    each = seconds / max(1, grid.runs)
    rows.append(("took", f"{seconds:.3g} s, {each * 1e3:.3g} ms a run"))
    rows.append(("files", f"{folder}: {', '.join(document['files'])}"))
    return head + "\n" + table(rows)


def _cut(reason: str) -> str:
    return reason if len(reason) <= REASON else reason[:REASON].rstrip() + " ..."


def _spread(values: Sequence[float]) -> str:
    if len(values) == 1:
        return f"{values[0]:g}"
    return f"{len(values)} values from {values[0]:g} to {values[-1]:g}"
