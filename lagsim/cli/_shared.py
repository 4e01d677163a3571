"""What several commands have in common: options, faults, printing."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim import __version__
from lagsim.cli._streams import complain, put, say
from lagsim.errors import InputError, LagsimError, Place, Problem
from lagsim.methods import names

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from lagsim.model.settings import Settings

ModelPath = Annotated[
    str, typer.Argument(metavar="MODEL", help="Model file; - is standard input.")
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=EXPR",
        help="Give a parameter another value; may be repeated.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")]


def _show_version(asked: bool) -> None:
    if asked:
        say(f"lagsim {__version__}")
        raise typer.Exit


def ask_version(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            help="Show the version and stop.",
            callback=_show_version,
            is_eager=True,
        ),
    ] = False,
) -> None:
    """From energies to motion: simulate a system written down as T and V."""


def assignments(sets: Iterable[str] | None) -> dict[str, str]:
    """Take `--set name=expr` apart.

    Raises
    ------
    InputError
        Where there is no `=`, or a name stands twice.
    """
    found: dict[str, str] = {}
    problems = []
    for text in sets or ():
        name, equals, expression = text.partition("=")
        name = name.strip()
        if not equals or not name:
            message = f"--set {text}: a name and an expression are expected"
            problems.append(Problem("usage", message, hint="such as --set g=1.62"))
        elif name in found:
            problems.append(Problem("usage", f"--set {name} is given twice"))
        found[name] = expression
    if problems:
        raise InputError(problems)
    return found


def method_problems(
    asked: str, place: Place | None = None, *, auto: bool = True
) -> list[Problem]:
    """Give the fault of a method that does not exist; `auto` may leave the choice."""
    known = [*(["auto"] if auto else []), *names()]
    if asked in known:
        return []
    hint = f"one of {', '.join(known)}; `lagsim methods` describes them"
    return [Problem("unknown-method", f"there is no method `{asked}`", place, hint)]


def unknown_names(settings: Settings) -> list[Problem]:
    """Give the faults of a method, and a formulation, that do not exist."""
    from lagsim.plan.formulation import formulation_problems

    return [
        *method_problems(settings.method, settings.method_place),
        *formulation_problems(settings.formulation, settings.formulation_place),
    ]


@contextlib.contextmanager
def faults_shown(
    documents: list[Any] | None = None, *, file: str | None = None
) -> Iterator[list[int]]:
    """Print the faults of the input; the list that is given gets the exit code.

    Parameters
    ----------
    documents
        Gets the faults instead, as the document that `--json` prints.
    file
        Named with faults that have no place in it.
    """
    code: list[int] = []
    try:
        yield code
    except LagsimError as error:
        code.append(error.exit_code)
        problems = [Problem("failed", str(error))]
        if isinstance(error, InputError):
            problems = list(error.problems)
        if documents is None:
            _print_problems(problems)
        else:
            documents.append(errors_document(problems, file))


def _print_problems(problems: list[Problem]) -> None:
    complain("\n\n".join(map(str, problems)))
    if len(problems) > 1:
        complain(f"\n{len(problems)} problems")


def errors_document(
    problems: Iterable[Problem], file: str | None = None
) -> dict[str, Any]:
    """Give the document that unusable input gives."""
    return {"errors": [_as_mapping(problem, file) for problem in problems]}


# Their faults are not the model's.
_OUTSIDE = ("usage", "output-folder", "failed")


def _as_mapping(problem: Problem, file: str | None) -> Mapping[str, Any]:
    place = problem.place
    if place is None and problem.code in _OUTSIDE:
        file = None
    return {
        "file": place.file if place else file,
        "line": place.line if place else None,
        "column": place.column if place else None,
        "code": problem.code,
        "text": problem.text,
        "hint": problem.hint,
    }


def show_json(document: Any) -> None:
    """Print a JSON document on stdout."""
    from lagsim.outputs.manifest import encode

    content = encode(document)
    put(lambda: sys.stdout.buffer.write(content))


def coloured(text: str, code: str) -> str:
    """Give `text` in a colour where stdout is a terminal that shows colours."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    if plain or not sys.stdout.isatty():
        return text
    return f"\x1b[{code}m{text}\x1b[0m"


def counted(number: int, noun: str) -> str:
    """Give `1 row`, `2 rows`."""
    return f"{number} {noun}{'s' * (number != 1)}"


def table(rows: Iterable[tuple[str, str]], indent: str = "  ") -> str:
    """Give rows of a name and a text, aligned."""
    rows = list(rows)
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join(f"{indent}{name:<{width}}  {text}" for name, text in rows)
