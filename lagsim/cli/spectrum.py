"""`lagsim spectrum`: the frequencies in a column of a result."""

from __future__ import annotations

from functools import partial
from pathlib import Path  # noqa: TC003  typer looks at it

import orjson
import typer

from lagsim import files
from lagsim.cli._shared import (
    JSON,
    aligned,
    option,
    print_stderr,
    print_stdout,
    show_json,
    write_file,
    write_picture,
)
from lagsim.codes.known import UNKNOWN_NAME, USAGE
from lagsim.errors import Problem, Problems, counted, did_you_mean, unusable
from lagsim.language.names import member_hint
from lagsim.outputs.results import MANIFEST
from lagsim.outputs.table import table_of
from lagsim.studies.spectrum import Spectrum, spectrum
from lagsim.studies.tables import read_results

ENDINGS = (".png", ".svg", ".pdf", ".csv")


def command(
    result: Path = typer.Argument(
        metavar="RESULT", help="Folder of a run, or its table."
    ),
    column: str = typer.Argument(metavar="COLUMN", help="The column to analyse."),
    output: list[Path] | None = option(
        "FILE",
        "A picture (.png, .svg, .pdf) or all amplitudes (.csv); may be repeated.",
        "-o", "--output"
    ),
    as_json: bool = JSON,
) -> int:  # fmt: skip
    """List the frequencies in a column, and their amplitudes."""
    hint = "the ending of the name gives the format: .png, .svg, .pdf or .csv"
    problems = Problems(
        Problem(USAGE, f"{file}: no such format", hint=hint)
        for file in output or ()
        if file.suffix not in ENDINGS
    )
    problems.refuse()
    found = _spectrum(result, column)
    for file in output or ():
        if file.suffix == ".csv":
            rows = zip(found.frequency.tolist(), found.amplitude.tolist(), strict=True)
            write_file(file, table_of(("frequency", "amplitude"), rows))
        else:
            write_picture(file, partial(_picture, found, result, file.suffix[1:]))
    if as_json:
        show_json({"result": str(result), **found.record})
    else:
        print_stdout(report(found))
    return 0


def _spectrum(result: Path, column: str) -> Spectrum:
    """Return the spectrum of a column of a result."""
    table = read_results(result)
    for remark in table.remarks:
        print_stderr(f"warning: {remark}")
    if column not in table.columns:
        columns = table.columns
        hint = member_hint(column, columns) or did_you_mean(column, columns)
        hint = hint or f"its columns are {', '.join(table.columns)}"
        text = f"{table.name}: there is no column `{column}`"
        raise unusable(UNKNOWN_NAME, text, hint=hint)
    return spectrum(table.t, table[column], column, table.units.get(column, ""))


def _picture(found: Spectrum, result: Path, form: str) -> bytes:
    """Return a picture of a spectrum, titled by the model, else by the file.

    result : the folder of the run, or its table.
    """
    from lagsim.outputs.figure import encoded_figure

    folder = result if result.is_dir() else result.parent
    try:
        record = orjson.loads(files.content(folder / MANIFEST))
        title = str(record["model"]["name"])
    except (OSError, ValueError, KeyError, TypeError):
        title = result.name
    return encoded_figure(found.plot(title), form)


def report(found: Spectrum) -> str:
    """Return the report as text."""
    unit = f" {found.unit}" if found.unit else ""
    rows = f"{counted(found.rows, 'row')} {found.step:.6g} s apart"
    lines = [
        f"{found.column}: {rows}, mean {found.mean:.6g}{unit}, window {found.window}",
        f"  frequencies nearer than {found.resolution:.2g} Hz are one peak",
    ]
    if not found.peaks:
        return "\n".join([*lines, "  no peaks"])
    amplitude = f"amplitude ({found.unit})" if found.unit else "amplitude"
    cells = [("Hz", amplitude, "period (s)")]
    cells += [
        (f"{p.frequency:.6g}", f"{p.amplitude:.5g}", f"{1 / p.frequency:.6g}")
        for p in found.peaks
    ]
    return "\n".join([*lines, aligned(cells, lefts=0)])
