"""`lagsim derive`: the equations of motion, for people, papers and programs."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path

import typer

from lagsim.api.models import derive
from lagsim.cli._shared import (
    MODEL,
    SETS,
    assignments,
    flag,
    harmless,
    option,
    write_file,
    write_stdout,
)
from lagsim.codes.known import OUTPUT_FILE, USAGE
from lagsim.errors import Problem, Problems, visible
from lagsim.model.reader import read_file
from lagsim.outputs.manifest import encode


class EquationFormat(StrEnum):
    """Formats of equations."""

    text = "text"
    latex = "latex"
    json = "json"
    python = "python"


def command(
    model: str = MODEL,
    sets: list[str] | None = SETS,
    form: EquationFormat = typer.Option(
        EquationFormat.text, "--format", help="Format of the equations."
    ),
    ascii_only: bool = flag("--ascii", "Write the text in ASCII, as in model files."),
    substitute: bool = flag("--substitute", "Replace parameters by their numbers."),
    solve: bool = flag(
        "--solve", "Solve for the accelerations, even if the result is long."
    ),
    gauss: bool = flag("--gauss", "Add Gauss's principle."),
    expand: bool = flag(
        "--expand",
        "Write the definitions of the file out, even if the result is long."
    ),
    output: Path | None = option("FILE", "Write to a file.", "-o", "--output"),
) -> int:  # fmt: skip
    """Derive the equations of motion, symbolically."""
    options = {"substitute": substitute, "solve": solve, "gauss": gauss}
    options["expand"] = expand
    _refuse(model, form, {**options, "ascii": ascii_only}, output)
    read = read_file(model, assignments(sets))
    found = derive(read, **options)
    if form is EquationFormat.json:
        content = encode(found.json)
    elif ascii_only:
        content = found.as_text(ascii_only=True).encode()
    else:
        content = str(getattr(found, form.value)).encode()
    if output is None:
        write_stdout(lambda: _print(content))
    else:
        # The file behind a link is replaced, not the link.
        write_file(output.resolve() if output.is_file() else output, content)
    return 0


def _refuse(
    model: str, form: EquationFormat, options: dict[str, bool], output: Path | None
) -> None:
    """Raise an error for options that do not fit the format, and for a bad file.

    options : whether each option is set, by name.
    output : the file, or None.
    """
    meant = {
        EquationFormat.text: ("ascii", "substitute", "solve", "gauss", "expand"),
        EquationFormat.python: (),
    }.get(form, ("substitute", "solve", "gauss", "expand"))
    problems = Problems(
        Problem(USAGE, f"--{name} has no effect with --format {form.value}")
        for name, given in options.items()
        if given and name not in meant
    )
    why = ""
    if output is not None and output.is_dir():
        why = "it is a folder"
    elif output is not None and not output.parent.is_dir():
        why = "there is no such folder"
    elif output is not None and output.resolve() == Path(model).resolve():
        why = "it is the model"
    if why:
        problems.add(OUTPUT_FILE, f"{output} cannot be written: {why}")
    problems.refuse()


def _print(content: bytes) -> None:
    """Print the equations, UTF-8 text, on stdout.

    A letter that the stream cannot encode is printed as its number.
    """
    text = content.decode()
    if sys.stdout.isatty():
        text = visible(text)
    encoding = sys.stdout.encoding or "utf-8"
    text = text.encode(encoding, "backslashreplace").decode(encoding)
    sys.stdout.write(harmless(text))
