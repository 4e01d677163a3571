"""`lagsim derive`: the equations of motion, for people, papers and programs."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from lagsim.api.deriving import derive
from lagsim.cli._faults import faults_shown
from lagsim.cli._shared import ModelPath, Sets, assignments, show_json
from lagsim.cli._streams import harmless, put
from lagsim.cli._writing import put_file
from lagsim.errors import InputError, Problem, visible
from lagsim.model.reader import read_file
from lagsim.outputs.manifest import encode


class Format(StrEnum):
    """What can be written."""

    text = "text"
    latex = "latex"
    json = "json"
    python = "python"


def command(
    model: ModelPath,
    sets: Sets = None,
    form: Annotated[
        Format, typer.Option("--format", help="Format of the equations.")
    ] = Format.text,
    ascii_only: Annotated[
        bool,
        typer.Option("--ascii", help="Write the text in ASCII, as in model files."),
    ] = False,
    substitute: Annotated[
        bool, typer.Option("--substitute", help="Replace parameters by their numbers.")
    ] = False,
    solve: Annotated[
        bool,
        typer.Option(
            "--solve", help="Solve for the accelerations, even if the result is long."
        ),
    ] = False,
    gauss: Annotated[
        bool, typer.Option("--gauss", help="Add Gauss's principle.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write to a file."),
    ] = None,
) -> int:
    """Derive the equations of motion, symbolically."""
    documents: list[Any] = []
    told = documents if form is Format.json else None
    options = {"substitute": substitute, "solve": solve, "gauss": gauss}
    with faults_shown(told, file=model) as code:
        _refuse(model, form, {**options, "ascii": ascii_only}, output)
        content = _derived(model, sets, form, ascii_only=ascii_only, **options)
        _deliver(content, output)
        code.append(0)
    for faults in documents:
        show_json(faults)
    return code[-1]


def _refuse(
    model: str, form: Format, options: dict[str, bool], output: Path | None
) -> None:
    """Refuse options that mean nothing for the format, and a file that cannot be.

    Raises
    ------
    InputError
    """
    meant = {
        Format.text: ("ascii", "substitute", "solve", "gauss"),
        Format.python: (),
    }.get(form, ("substitute", "solve", "gauss"))
    problems = [
        Problem("usage", f"--{name} means nothing with --format {form.value}")
        for name, given in options.items()
        if given and name not in meant
    ]
    if output is not None and output.is_dir():
        problems.append(_unwritable(output, "it is a folder"))
    elif output is not None and not output.parent.is_dir():
        problems.append(_unwritable(output, "there is no such folder"))
    elif output is not None and output.resolve() == Path(model).resolve():
        problems.append(_unwritable(output, "it is the model"))
    if problems:
        raise InputError(problems)


def _unwritable(output: Path, why: str | None) -> Problem:
    return Problem("output-file", f"{output} cannot be written: {why}")


def _derived(
    path: str,
    sets: list[str] | None,
    form: Format,
    *,
    ascii_only: bool,
    substitute: bool,
    solve: bool,
    gauss: bool,
) -> bytes:
    """Give what is written."""
    model = read_file(path, assignments(sets))
    if form is not Format.python:
        from lagsim.show.symbols import refuse_long

        refuse_long(model, substitute=substitute)
    found = derive(model, substitute=substitute, solve=solve, gauss=gauss)
    if form is Format.json:
        return encode(found.json)
    text = found.as_text(ascii_only=True) if ascii_only else getattr(found, form.value)
    return str(text).encode()


def _deliver(content: bytes, output: Path | None) -> None:
    """Print, or write a file, which appears whole or not at all.

    Raises
    ------
    UnwritableError
        Where the file cannot be made.
    """
    if output is None:
        put(lambda: _print(content))
        return
    # The file behind a link is replaced, not the link.
    put_file(output.resolve() if output.is_file() else output, content)


def _print(content: bytes) -> None:
    """Print text; a stream that does not know a letter gets its number."""
    text = content.decode()
    if sys.stdout.isatty():
        text = visible(text)
    encoding = sys.stdout.encoding or "utf-8"
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        text = text.encode(encoding, "backslashreplace").decode(encoding)
    sys.stdout.write(harmless(text))
