"""`lagsim fit`: the values with which a model explains measured data."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lagsim.cli._shared import (
    FORMAT,
    JOBS,
    JSON,
    MODEL,
    NO_PLOTS,
    Measured,
    PictureFormat,
    aligned,
    aligned_pairs,
    assignments,
    check_replaced,
    coloured,
    experiment,
    option,
    output_folder,
    print_stderr,
    quiet,
    titled_rows,
    write_file,
)
from lagsim.cli.run import with_settings
from lagsim.codes.known import USAGE
from lagsim.errors import Problems, counted
from lagsim.model.reader import read_file
from lagsim.model.reader.fields import OPTIONS
from lagsim.outputs.results import Results
from lagsim.run.session import settings_of
from lagsim.studies.fit import report
from lagsim.studies.fit.data import read_record
from lagsim.studies.fit.estimate import LINEAR, LOSSES
from lagsim.studies.fit.fitting import SPENT, Fit
from lagsim.studies.options import RUNS_OF_FITS

if TYPE_CHECKING:
    from lagsim.cli._shared import Progress
    from lagsim.run.interrupt import Interrupt

    Document = dict[str, Any]

Loss = Enum("Loss", {name.upper(): name for name in LOSSES})  # type: ignore[misc]


@with_settings({key: OPTIONS[key] for key in RUNS_OF_FITS})
def command(
    model: str = MODEL,
    data: list[Path] = typer.Argument(
        metavar="DATA.csv...", help="Measured data: columns t and quantities."
    ),
    vary: list[str] | None = option(
        "NAME[=A:B]",
        "A parameter, a start value, or t0, the difference of the clocks, with bounds; "
        "NAME@K belongs to the data file K alone; may be repeated.",
        "--vary",
    ),
    match: list[str] | None = option(
        "COLUMN=EXPR[:SD]",
        "The quantity that a column measures, and the standard deviation of the "
        "measurement; may be repeated.",
        "--match",
    ),
    loss: Loss = typer.Option(
        LINEAR, "--loss", help="soft_l1 and huber reduce the weight of outliers."
    ),
    starts: int = typer.Option(
        0, "--starts", metavar="N", min=0,
        help="Number of other starts, within the bounds, beside that of the file.",
    ),
    write: Path | None = option(
        "FILE", "Write the model file with the values found to FILE, too.", "--write"
    ),
    folder: Path | None = output_folder("Output folder; default results/NAME/fit."),
    jobs: int | None = JOBS,
    sets: list[str] | None = option(
        "NAME[@K]=EXPR",
        "Another value of a parameter or of the start; NAME@K for the data file K "
        "alone; may be repeated.",
        "--set",
    ),
    *,
    options: dict[str, str],
    form: PictureFormat = FORMAT,
    no_plots: bool = NO_PLOTS,
    as_json: bool = JSON,
    quiet: bool = quiet(),
) -> int:  # fmt: skip
    """Find the values of parameters with which a model explains measured data."""
    every, matched = assignments(sets), _matched(match)
    own = {name: text for name, text in every.items() if "@" in name}
    given = {name: text for name, text in every.items() if name not in own}
    read = read_file(model, given)
    settings_of(read, "fit", options, "add it, or give --duration")
    problems, records = Problems(), []
    for path in data:
        with problems.gathered():
            records.append(read_record(path))
    problems.refuse()
    if write is not None:
        check_replaced(write, read)
    fit = Fit(
        read, records, vary or (), matched, loss.value, own=own, options=options,
        jobs=jobs,
    )  # fmt: skip
    where = folder or Path("results") / read.name / "fit"
    Results(where, report.MANIFEST).refuse_changed(report.name_of(fit))
    for record in fit.records:
        if unused := fit.unused(record):
            text = f"note: {record.name}: not used: {', '.join(unused)}"
            print_stderr(f"{text}; `--match` says what a column measures")

    def measure(interrupt: Interrupt, progress: Progress) -> Measured:
        fit.interrupt = interrupt
        found = fit.found(starts, progress)
        document, contents = report.files_of(fit, found, given)
        if write is not None:
            write_file(write, contents[report.name_of(fit)])

        def draw() -> bytes:
            from lagsim.studies.fit.chart import chart

            return chart(fit, found, form.value)

        def summary(files: str) -> str:
            return _summary(document, files)

        return Measured(
            document, contents, f"fit.{form.value}", None if no_plots else draw,
            summary, code=3 if found.outcome == SPENT else 0,
        )  # fmt: skip

    return experiment(
        "fit", measure, where, report.MANIFEST, quiet=quiet, as_json=as_json
    )


def _matched(match: list[str] | None) -> dict[str, str]:
    """Parse the options `--match COLUMN=EXPR[:SD]`; return `EXPR[:SD]` by column."""
    problems, found = Problems(), dict[str, str]()
    for text in match or ():
        column, equals, after = text.partition("=")
        column = column.strip()
        if not (column and equals and after.strip()):
            message = f"--match {text}: a column and an expression are expected"
            problems.add(USAGE, message, hint="such as --match angle=theta*180/pi")
        elif column in found:
            problems.add(USAGE, f"--match {column} is given twice")
        found[column] = after
    problems.refuse()
    return found


def _summary(document: Document, files: str) -> str:
    """Return the lines that the command prints at its end.

    files : text on the files that were written.
    """
    done = document["complete"]
    head = coloured(document["outcome"], "32" if done else "31")
    name, freedom = document["model"]["name"], document["degrees_of_freedom"]
    text = f"{head}: {name}, {counted(document['iterations'], 'iteration')}, "
    text += counted(document["runs"], "run")
    lines = [text, aligned(report.lines(document), lefts=1)]
    more = [
        (column, f"rms {rms:.4g}, noise {document['noise'][column]:.4g}")
        for column, rms in document["rms"].items()
        if rms is not None
    ]
    if document["chi2"] is not None:
        more.append(
            ("chi2", f"{document['chi2']:.6g} for {freedom} degrees of freedom")
        )
    more += titled_rows(
        "undetermined",
        (
            ", ".join(f"{name} {part:+.3g}" for name, part in one.items())
            for one in document["combinations"]
        ),
    )
    if document["starts"] > 1:
        found = f"{document['reached']} of {document['starts']} lead here"
        more.append(("starts", found))
    return "\n".join([*lines, aligned_pairs([*more, ("files", files)])])
