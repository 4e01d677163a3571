"""`lagsim sweep`: one model at many values of parameters and of its start."""

from __future__ import annotations

import contextlib
import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._shared import (
    JOBS,
    JSON,
    MODEL,
    NO_PLOTS,
    SETS,
    Measured,
    aligned_pairs,
    assignments,
    coloured,
    experiment,
    flag,
    option,
    output_folder,
    print_stdout,
    quiet,
    show_json,
    writing,
)
from lagsim.cli.run import ERROR_BAR, with_settings
from lagsim.codes.known import USAGE
from lagsim.errors import LagsimError, counted, unusable
from lagsim.files import content
from lagsim.model.reader import read_file
from lagsim.model.reader.runs import FROM
from lagsim.outputs.manifest import versions
from lagsim.outputs.results import Results
from lagsim.run.session import settings_of
from lagsim.studies.attempts import ErrorBars
from lagsim.studies.sweep import sweeping
from lagsim.studies.sweep.grid import EXAMPLE, Axis, Grid, SweepRows, parse_axes
from lagsim.studies.sweep.sweeping import (
    CHART,
    JOURNAL,
    MANIFEST,
    TABLE,
    Journal,
    of_file,
    sampled,
)
from lagsim.studies.sweep.sweeping import EXAMPLE as SAMPLED
from lagsim.studies.trial import INADMISSIBLE
from lagsim.studies.workers import Workers, cores, machines, processes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.cli._shared import Progress
    from lagsim.model.model import Model
    from lagsim.run.interrupt import Interrupt

# The largest number of letters of a printed reason; the table has the whole text.
REASON = 160


def _names(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of a model that can be swept and begin with `incomplete`.

    These complete an argument in a shell.
    """
    try:
        model = read_file(str(context.params["model"]))
    except (LagsimError, KeyError):
        return []
    names = [p.name for p in model.parameters] + [x.name for x in model.initial]
    return [f"{name}=" for name in names if name.startswith(incomplete)]


@with_settings()
def command(
    model: str = MODEL,
    values: list[str] | None = typer.Argument(
        None, metavar="NAME=A:B:N|NAME=V1,V2,...",
        help="A parameter or a start value, and its values: N values from A to B, or a "
        "list; each may be an expression.",
        autocompletion=_names,
    ),
    points: Path | None = option(
        "FILE.csv", "Instead of a grid, the runs of a table: a column for each name."
    ),
    sample: list[str] | None = option(
        "NAME=normal(M, S)|NAME=uniform(A, B)",
        "Instead of a grid, random values of a name; the same on every machine."
    ),
    count: int | None = option("N", "How many runs a sample has.", "-N", min=1),
    seed: int = typer.Option(
        0, min=0, max=2**64 - 1, help="Another number draws another sample."
    ),
    folder: Path | None = output_folder("Output folder; default results/NAME/sweep."),
    jobs: int | None = JOBS,
    keep: bool = flag("--keep", "Keep the results of each run in DIR/run-K."),
    ends: bool = flag(
        "--ends",
        "Compute only the last value of each column: no rows, no error estimate, much "
        "faster."
    ),
    since: str | None = option(
        "T0",
        "Compute .min, .max, .mean, .rms and .peak_to_peak of the rows from T0 on.",
        "--from"
    ),
    resume: bool = flag("--resume", "Continue an interrupted sweep."),
    dask: str | None = option(
        "ADDRESS", "Address of a Dask scheduler, whose workers make the runs."
    ),
    sets: list[str] | None = SETS,
    *,
    options: dict[str, str],
    error_bar: ErrorBars = ERROR_BAR,
    no_plots: bool = NO_PLOTS,
    as_json: bool = JSON,
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Run a model at all combinations of parameter values."""
    others = {
        "--keep": keep,
        "--error-bar always": error_bar is ErrorBars.ALWAYS,
        "--from": since is not None,
    }
    if ends and (stated := [name for name, given in others.items() if given]):
        text = f"--ends stores no rows, which {stated[0]} requires"
        raise unusable(USAGE, text, hint="leave one of the two out")
    if since is not None:
        options = options | {FROM: since}
    fixed = assignments(sets)
    read = read_file(model, fixed)
    settings_of(read, "sweep", options, "add it, or give --duration")
    grid = _grid(read, values or [], points, sample or [], count, seed)
    if twice := [axis.name for axis in grid.axes if axis.name in fixed]:
        text = f"{', '.join(twice)}: both swept and given by --set"
        raise unusable(USAGE, text, hint="leave --set out for names that are swept")
    where = folder or Path("results") / read.name / "sweep"
    kept = str(where.absolute()) if keep else None
    plots = not no_plots
    found = SweepRows.of(
        read, grid, options, error_bar, folder=kept, plots=keep and plots, ends=ends
    )
    known = _earlier_record(found, where) if resume else None
    if known is not None:
        if as_json:
            show_json(known)
        elif not quiet:
            print_stdout(f"{where} already contains this sweep, complete")
        return _code(known)
    journal = Journal(where / JOURNAL, found)
    measure = partial(
        _measured, found, journal, jobs, dask, resume=resume, plots=plots, quiet=quiet
    )
    code = experiment("sweep", measure, where, MANIFEST, quiet=quiet, as_json=as_json)
    if not found.missing:
        journal.remove()
    return code


def _grid(
    read: Model,
    values: list[str],
    points: Path | None,
    sample: list[str],
    count: int | None,
    seed: int,
) -> Grid:
    if bool(values) + bool(sample) + (points is not None) != 1:
        text = "one of NAME=A:B:N, --points and --sample is expected"
        raise unusable(USAGE, text, hint=EXAMPLE)
    if bool(sample) is not (count is not None) or (seed and not sample):
        text = "-N is used with --sample, and --seed with both"
        raise unusable(USAGE, text, hint=SAMPLED)
    if points is not None:
        return of_file(read, points)
    if count is None:
        return parse_axes(read, values)
    pairs = ([x.strip() for x in text.split("=", 1)] for text in sample)
    return sampled(read, ((name, "".join(rest)) for name, *rest in pairs), count, seed)


def _earlier_record(found: SweepRows, folder: Path) -> Any:
    """Return the record of an earlier complete sweep with equal rows; None if none."""
    try:
        there = json.loads(content(folder / MANIFEST))
    except (OSError, ValueError):
        return None
    known = isinstance(there, dict) and there.get("identity") == sweeping.digest_of(
        found
    )
    return there if known and not (folder / JOURNAL).exists() else None


def _measured(
    found: SweepRows,
    journal: Journal,
    jobs: int | None,
    dask: str | None,
    interrupt: Interrupt,
    progress: Progress,
    *,
    resume: bool,
    plots: bool,
    quiet: bool,
) -> Measured | list[str]:
    """Compute the missing runs of a sweep; return the result for `experiment`.

    After an interrupt, remarks on how to continue are returned.

    found : the sweep.
    journal : file of its rows.
    jobs : number of processes, or None.
    dask : address of a scheduler, or None.
    """
    folder = journal.path.parent
    with contextlib.ExitStack() as stack:
        stack.enter_context(writing(folder))
        stack.enter_context(contextlib.closing(journal))
        try:
            if resume:
                found.rows |= journal.resume()
            else:
                journal.begin()
        except IsADirectoryError as error:
            raise Results(folder).unusable(error) from None
        workers: Workers = processes
        most = jobs or cores()
        if dask is not None:
            workers, there = stack.enter_context(machines(dask))
            most = jobs or there
        sweeping.sweep(
            found, most, requested=jobs is not None, workers=workers, journal=journal,
            interrupt=interrupt, progress=progress,
        )  # fmt: skip
    if found.missing:
        known = f"{len(found.rows)} of {found.grid.runs} runs"
        return [
            f"lagsim: interrupted; {known} are kept",
            "  hint: the same command with --resume continues from there",
        ]
    document = sweeping.document(found)
    runs = document["runs"]
    missing = runs - document["complete"]
    remarks = []
    if missing:
        whole = counted(runs, "run")
        remarks.append(f"lagsim: {missing} of {whole} are not complete")
    if not quiet:
        remarks += [f"note: {note}" for note in document["notes"]]

    def draw() -> bytes:
        picture = sweeping.draw_chart(found)
        document["versions"] = versions()  # that of matplotlib, too
        return picture

    return Measured(
        document, {TABLE: sweeping.table(found)}, CHART, draw if plots else None,
        partial(_summary, found, document), remarks, _code(document),
    )  # fmt: skip


def _code(document: Mapping[str, Any]) -> int:
    runs = document["runs"]
    if document["outcomes"].get(INADMISSIBLE) == runs:
        return 1
    return 0 if document["complete"] == runs else 3


def _summary(found: SweepRows, document: Mapping[str, Any], files: str) -> str:
    """Return the summary that the command prints at its end.

    files : text on the files that were written.
    """
    runs, complete = document["runs"], document["complete"]
    head = f"{coloured('done', '32' if complete == runs else '31')}: "
    head += (
        f"{document['model']['name']}, {complete} of {counted(runs, 'run')} complete"
    )
    rows = [("swept", f"{x.name}: {_spread(x)}") for x in found.grid.axes]
    first = {r.outcome: r.reason for _, r in sorted(found.rows.items(), reverse=True)}
    for outcome, count in document["outcomes"].items():
        if reason := first[outcome]:
            if len(reason) > REASON:
                reason = reason[:REASON].rstrip() + " ..."
            text = f"{counted(count, 'run')}, the first: {reason}"
            rows.append((outcome, text))
    seconds = document["timings"]["runs"]
    rows.append(("took", f"{seconds:.3g} s, {seconds / runs * 1e3:.3g} ms a run"))
    return head + "\n" + aligned_pairs([*rows, ("files", files)])


def _spread(axis: Axis) -> str:
    values = sorted(axis.values) if axis.drawn else axis.values
    if len(values) == 1:
        return f"{values[0]:g}"
    return f"{len(values)} values from {values[0]:g} to {values[-1]:g}"
