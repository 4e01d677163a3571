"""Errors in the input of a command: printed, or as the document of `--json`."""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import re
import sys
import time
from functools import wraps
from typing import TYPE_CHECKING, Any

from lagsim.cli._shared import annotate_problem, print_stderr, show_json, width_of
from lagsim.codes.known import (
    BUG,
    FAILED,
    NO_REFERENCE,
    NO_ROOM,
    OUTPUT_FOLDER,
    STARVED,
    USAGE,
)
from lagsim.errors import WINDOW, InputError, LagsimError, Problem, unusable
from lagsim.run.session import StartError
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

# Exit codes of failures that are no fault of the input.
BUG_EXIT, STARVED_EXIT = 70, 3
# Option to print the report of a bug as well.
TRACEBACK = "--traceback"
# Errors of a path that occur before any access to the file.
_NO_PATH = (errno.ENAMETOOLONG, errno.ELOOP, errno.EACCES)
# Faults that are not in the model file.
_OUTSIDE = (USAGE, OUTPUT_FOLDER, FAILED, NO_ROOM, NO_REFERENCE)


def reporting(command: Callable[..., int]) -> Callable[..., int]:
    """Decorate a command so that faults of its input are reported, not raised.

    They are printed, or with `--json` shown as a document; the command returns the exit
    code of the error.
    """

    @wraps(command)
    def called(**given: Any) -> int:
        documents: list[Any] = []
        try:
            with _paths_reported():
                return command(**given)
        except LagsimError as error:
            as_json = given.get("as_json") or str(given.get("form")) == "json"
            several = given.get("models", ())
            file = given.get("model") or (several[0] if len(several) == 1 else None)
            code = reported(error, documents if as_json else None, file)
        for document in documents:
            show_json(document)
        return code

    return called


@contextlib.contextmanager
def _paths_reported() -> Iterator[None]:
    """Context manager: report a path that cannot be accessed as a wrong argument."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        # `Path.resolve` raises RuntimeError of a loop of links, up to Python 3.12.
        found = error if isinstance(error, OSError) else error.__context__
        if not isinstance(found, OSError) or found.errno not in _NO_PATH:
            raise
        text = f"{found.filename} cannot be used: {found.strerror}"
        raise unusable(USAGE, text) from None


def reported(
    error: LagsimError, documents: list[Any] | None = None, file: str | None = None
) -> int:
    """Print an error, or append its document to `documents`; return the exit code.

    Parameters
    ----------
    documents : list or None
        The list for `--json`; None to print the error on stderr.
    file : str or None
        The model file, named with faults that have no place in a file.
    """
    if isinstance(error, StartError):
        from lagsim.cli._verdict import annotate_start, report
        from lagsim.outputs.manifest import examination

        annotate_start(error.equations, error.examined)
        if documents is None:
            print_stderr(report(error.equations, error.examined))
        else:
            documents.append(examination(error.equations, error.examined))
        return error.exit_code
    problems = [Problem(error.code, str(error)).whole]
    if isinstance(error, InputError):
        problems = list(error.problems)
    for problem in problems:
        annotate_problem(problem, None if problem.code in _OUTSIDE else file)
    if documents is None:
        width = width_of(sys.stderr)
        window = WINDOW if width is None else min(WINDOW, width - 2)
        print_stderr("\n\n".join(problem.shown(window) for problem in problems))
        if len(problems) > 1:
            print_stderr(f"\n{len(problems)} problems")
    else:
        documents.append(errors_document(problems, file))
    return error.exit_code


def error_text(error: LagsimError) -> str:
    """Return the text of an error as `reported` prints it, without colours."""
    if isinstance(error, StartError):
        from lagsim.cli._verdict import report

        return report(error.equations, error.examined)
    problems = [Problem(error.code, str(error)).whole]
    if isinstance(error, InputError):
        problems = list(error.problems)
    return "\n\n".join(map(str, problems))


def plain_text(error: LagsimError) -> str:
    """Return the text of an error without colours, as in a file or pipe."""
    if isinstance(error, StartError):
        from lagsim.cli._verdict import faults

        return f"inadmissible start: {'; '.join(faults(error.examined))}"
    return str(error)


def errors_document(
    problems: Iterable[Problem], file: str | None = None
) -> dict[str, Any]:
    """Return the document that describes faults of the input, for `--json`.

    file : the model file, named with faults that have no place in a file.
    """
    return {"errors": [_as_mapping(problem, file) for problem in problems]}


def _as_mapping(problem: Problem, file: str | None) -> dict[str, Any]:
    place = problem.place
    return {
        "file": problem.file or (None if problem.code in _OUTSIDE else file),
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


# --- Failures that are no fault of the input

# Messages of a system without free memory; some exist as text alone.
_STARVED = re.compile(
    r"^(MemoryError|numpy\S*MemoryError|Cannot allocate memory)|allocate memory|"
    r"failed to map segment|find/load shared object|can't start new thread",
    re.MULTILINE,
)
_MEMORY = "there is not enough memory (ulimit -v, the limits of a container)"
_FILES = "too many files are open (ulimit -n)"


def unforeseen() -> int:
    """Report an unforeseen exception; return the exit code.

    Such an exception is a bug of lagsim, unless memory or another resource of the
    system is exhausted.
    """
    import traceback

    from lagsim.codes import number

    trace = traceback.format_exc()
    starved = _MEMORY if _STARVED.search(trace) else ""
    if os.strerror(errno.EMFILE) in trace or os.strerror(errno.ENFILE) in trace:
        starved = _FILES
    if starved:
        print_stderr(f"lagsim: {starved} [{number(STARVED)}]")
        return STARVED_EXIT
    path, requested = _report_file(trace), TRACEBACK in sys.argv
    if requested or path is None:
        print_stderr(trace)
    raised = trace.rstrip("\n").rpartition("\n")[2]
    print_stderr(f"lagsim: {raised} [{number(BUG)}]")
    source = "the lines above" if path is None else str(path)
    print_stderr(
        "  This is a bug in lagsim, not in your model. Please report it with the model "
        f"file and {source}"
    )
    if not requested:
        print_stderr(
            f"  hint: the same command with {TRACEBACK} shows where it is raised"
        )
    return BUG_EXIT


def _report_file(trace: str) -> Path | None:
    """Write a report of a bug to a file in the user's cache; return its path.

    None if the file cannot be written.

    trace : the traceback.
    """
    from lagsim.native.link.cache import folder
    from lagsim.outputs.manifest import versions

    where = folder("reports")
    if where is None:
        return None
    known = ", ".join(f"{name} {version}" for name, version in versions().items())
    text = (
        f"lagsim {__version__}; {known}; {platform.platform()}\n"
        f"{' '.join(map(repr, sys.argv[1:]))}\n\n{trace}"
    )
    now = time.strftime("%Y%m%d-%H%M%S", time.gmtime())
    path = where / f"lagsim-{now}-{os.getpid()}-{time.monotonic_ns() % 10**6:06}.txt"
    try:
        with path.open("x", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return None
    return path
