"""Faults of what a command was given: printed, or as the document of `--json`."""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import re
import sys
import time
from typing import TYPE_CHECKING, Any

from lagsim.cli._streams import annotate_problem, complain, width_of
from lagsim.errors import WINDOW, InputError, LagsimError, Problem
from lagsim.run.session import StartError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path


# Has lagsim print what a report of a bug holds as well.
TRACEBACK = "--traceback"


def kept(told: str) -> Path | None:
    """Write a report of a bug to a file of the user's cache; None without room."""
    from lagsim.native.link.cache import folder
    from lagsim.outputs.manifest import versions
    from lagsim.version import __version__

    where = folder("reports")
    if where is None:
        return None
    known = ", ".join(f"{name} {version}" for name, version in versions().items())
    text = (
        f"lagsim {__version__}; {known}; {platform.platform()}\n"
        f"{' '.join(map(repr, sys.argv[1:]))}\n\n{told}"
    )
    now = time.strftime("%Y%m%d-%H%M%S", time.gmtime())
    path = where / f"lagsim-{now}-{os.getpid()}-{time.monotonic_ns() % 10**6:06}.txt"
    try:
        with path.open("x", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return None
    return path


# Exit codes of what is no fault of the input.
BUG, STARVED = 70, 3


@contextlib.contextmanager
def faults_shown(
    documents: list[Any] | None = None,
    *,
    file: str | None = None,
    raised: list[LagsimError] | None = None,
) -> Iterator[list[int]]:
    """Print the faults of the input, or why a start is not admissible.

    The list that is given gets the exit code.

    Parameters
    ----------
    documents
        Gets them instead, as the document that `--json` prints.
    file
        Named with faults that have no place in it.
    raised
        Gets what was raised, too.
    """
    code: list[int] = []
    try:
        yield code
    except StartError as error:
        code.append(error.exit_code)
        from lagsim.cli._verdict import annotate_start, report
        from lagsim.outputs.examined import document

        if raised is not None:
            raised.append(error)
        annotate_start(error.equations, error.examined)
        if documents is None:
            complain(report(error.equations, error.examined))
        else:
            documents.append(document(error.equations, error.examined))
    except LagsimError as error:
        code.append(error.exit_code)

        problems = [Problem(error.code, str(error)).whole]
        if isinstance(error, InputError):
            problems = list(error.problems)
        if raised is not None:
            raised.append(error)
        for problem in problems:
            annotate_problem(problem, None if problem.code in _OUTSIDE else file)
        if documents is None:
            _print_problems(problems)
        else:
            documents.append(errors_document(problems, file))


def plain(error: LagsimError) -> str:
    """Give what `faults_shown` prints of an error, for what is no terminal."""
    if isinstance(error, StartError):
        from lagsim.cli._verdict import faults

        return f"inadmissible start: {'; '.join(faults(error.examined))}"
    return str(error)


def _print_problems(problems: list[Problem]) -> None:
    width = width_of(sys.stderr)
    window = WINDOW if width is None else min(WINDOW, width - 2)
    complain("\n\n".join(problem.shown(window) for problem in problems))
    if len(problems) > 1:
        complain(f"\n{len(problems)} problems")


def errors_document(
    problems: Iterable[Problem], file: str | None = None
) -> dict[str, Any]:
    """Give the document that unusable input gives."""
    return {"errors": [_as_mapping(problem, file) for problem in problems]}


# Their faults are not the model's.
_OUTSIDE = ("usage", "output-folder", "failed", "no-room", "no-reference")


def _as_mapping(problem: Problem, file: str | None) -> Mapping[str, Any]:
    if problem.code in _OUTSIDE:
        file = None
    place = problem.place
    return {
        "file": problem.file or file,
        "line": problem.line,
        "column": problem.column,
        "length": place.length if place else None,
        "source": place.source if place else None,
        "code": problem.code,
        "number": problem.number,
        "text": problem.text,
        "expected": problem.expected,
        "hint": problem.whole.hint,
    }


# What a system says that has no more to give; some of it comes as text alone.
_STARVED = re.compile(
    r"^(MemoryError|numpy\S*MemoryError|Cannot allocate memory)|allocate memory|"
    r"failed to map segment|find/load shared object|can't start new thread",
    re.MULTILINE,
)
_MEMORY = "there is not enough memory (ulimit -v, the limits of a container)"
_FILES = "too many files are open (ulimit -n)"


def unforeseen() -> int:
    """Report an unforeseen exception; give the exit code.

    It is a bug, unless the system has no more to give.
    """
    import traceback

    from lagsim.codes import number

    told = traceback.format_exc()
    starved = _MEMORY if _STARVED.search(told) else ""
    if os.strerror(errno.EMFILE) in told or os.strerror(errno.ENFILE) in told:
        starved = _FILES
    if starved:
        complain(f"lagsim: {starved} [{number('starved')}]")
        return STARVED

    path, asked = kept(told), TRACEBACK in sys.argv
    if asked or path is None:
        complain(told)
    raised = told.rstrip("\n").rpartition("\n")[2]
    complain(f"lagsim: {raised} [{number('bug')}]")
    what = "the lines above" if path is None else str(path)
    complain(
        "  This is a bug in lagsim, not in your model. Please report it with the model "
        f"file and {what}"
    )
    if not asked:
        complain(f"  hint: the same command with {TRACEBACK} shows where it is raised")
    return BUG
