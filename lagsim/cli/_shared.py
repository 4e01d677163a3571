"""What several commands have in common: options, faults, printing."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lagsim.errors import InputError, LagsimError, Problem

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

ModelPath = Annotated[
    str, typer.Argument(metavar="MODEL", help="Model file; - is standard input.")
]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=EXPR", help="Give a parameter another value."),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON document on stdout.")]


def ask_version(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and stop.")
    ] = False,
) -> None:
    """From energies to motion: simulate a system written down as T and V."""
    if version:
        from importlib.metadata import version as installed

        print("lagsim", installed("lagsim"))
        raise typer.Exit


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


@contextlib.contextmanager
def faults_shown(*, as_json: bool) -> Iterator[list[int]]:
    """Print the faults of the input; the list that is given gets the exit code."""
    code: list[int] = []
    try:
        yield code
    except InputError as error:
        code.append(error.exit_code)
        if as_json:
            show_json({"errors": [_as_mapping(p) for p in error.problems]})
        else:
            _print_problems(error.problems)
    except LagsimError as error:
        code.append(error.exit_code)
        if as_json:
            show_json({"errors": [_as_mapping(Problem("failed", str(error)))]})
        else:
            print(error, file=sys.stderr)


def _print_problems(problems: Iterable[Problem]) -> None:
    problems = list(problems)
    print("\n\n".join(map(str, problems)), file=sys.stderr)
    if len(problems) > 1:
        print(f"\n{len(problems)} problems", file=sys.stderr)


def _as_mapping(problem: Problem) -> Mapping[str, Any]:
    place = problem.place
    return {
        "file": place.file if place else None,
        "line": place.line if place else None,
        "column": place.column if place else None,
        "code": problem.code,
        "text": problem.text,
        "hint": problem.hint,
    }


def show_json(document: Any) -> None:
    """Print a JSON document on stdout."""
    from lagsim.outputs.manifest import encode

    sys.stdout.flush()
    sys.stdout.buffer.write(encode(document))
    sys.stdout.buffer.flush()


def coloured(text: str, code: str) -> str:
    """Give `text` in a colour where stdout is a terminal that shows colours."""
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR"):
        return text
    return f"\x1b[{code}m{text}\x1b[0m"


def table(rows: Iterable[tuple[str, str]], indent: str = "  ") -> str:
    """Give rows of a name and a text, aligned."""
    rows = list(rows)
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join(f"{indent}{name:<{width}}  {text}" for name, text in rows)
