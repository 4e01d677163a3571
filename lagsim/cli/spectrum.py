"""`lagsim spectrum`: the frequencies in a column of a result."""

from __future__ import annotations

from pathlib import Path  # noqa: TC003  typer looks at it
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim import files
from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import AsJson, aligned, counted, show_json
from lagsim.cli._streams import complain, say
from lagsim.cli._writing import put_file, put_picture
from lagsim.errors import InputError, Problem
from lagsim.outputs.results import MANIFEST
from lagsim.outputs.table import table_of
from lagsim.studies.spectrum import spectrum
from lagsim.studies.tables import read_results

if TYPE_CHECKING:
    from lagsim.studies.spectrum import Spectrum

PICTURES = (".png", ".svg", ".pdf")


def command(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="Folder of a run, or its table.")
    ],
    column: Annotated[
        str, typer.Argument(metavar="COLUMN", help="The column to analyse.")
    ],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="A picture (.png, .svg, .pdf) or all amplitudes (.csv); may be "
            "repeated.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> int:
    """List the frequencies in a column, and their amplitudes."""
    documents: list[Any] = []
    with faults_shown(documents if as_json else None) as code:
        _refuse(output or ())
        found = _spectrum(result, column)
        for file in output or ():
            _write(file, found, _title(result))
        if as_json:
            documents.append({"result": str(result), **found.record})
        else:
            say(report(found))
        code.append(0)
    for content in documents:
        show_json(content)
    return code[-1]


def _refuse(files: list[Path] | tuple[()]) -> None:
    """Refuse files that are neither pictures nor tables.

    Raises
    ------
    InputError
    """
    hint = "the ending of the name gives the format: .png, .svg, .pdf or .csv"
    problems = [
        Problem("usage", f"{file}: no such format", hint=hint)
        for file in files
        if file.suffix not in (*PICTURES, ".csv")
    ]
    if problems:
        raise InputError(problems)


def _spectrum(result: Path, column: str) -> Spectrum:
    """Read a result and look at a column of it.

    Raises
    ------
    InputError
    """
    from difflib import get_close_matches

    table = read_results(result)
    for remark in table.remarks:
        complain(f"warning: {remark}")
    if column not in table.columns:
        near = get_close_matches(column, table.columns, 1)
        hint = f"did you mean `{near[0]}`?" if near else ""
        hint = hint or f"its columns are {', '.join(table.columns)}"
        text = f"{table.name}: there is no column `{column}`"
        raise InputError([Problem("unknown-name", text, hint=hint)])
    return spectrum(table.t, table[column], column, table.units.get(column, ""))


def _title(result: Path) -> str:
    """Give the model's name, else that of the file."""
    import orjson

    folder = result if result.is_dir() else result.parent
    try:
        return str(orjson.loads(files.content(folder / MANIFEST))["model"]["name"])
    except (OSError, ValueError, KeyError, TypeError):
        return result.name


def _write(file: Path, found: Spectrum, title: str) -> None:
    """Write a picture or a table.

    Raises
    ------
    UnwritableError
    """
    if file.suffix == ".csv":
        rows = zip(found.frequency.tolist(), found.amplitude.tolist(), strict=True)
        put_file(file, table_of(("frequency", "amplitude"), rows))
    else:
        from lagsim.outputs.figure import content

        put_picture(file, lambda: content(found.plot(title), file.suffix[1:]))


def report(found: Spectrum) -> str:
    """Give what a person reads."""
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
