"""Annotations: what GitHub Actions shows beside a line of a file, where it runs us.

They go to stderr, which the runner reads as it does stdout, so that stdout stays what
it is for everybody else. What else is printed is made harmless in `_streams`.
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from lagsim.cli._streams import on_github, unmarked
from lagsim.errors import visible

if TYPE_CHECKING:
    from lagsim.errors import Problem

ERROR, WARNING = "error", "warning"


def annotate(
    level: str, text: str, file: str | None, line: int | None = None,
    column: int | None = None, number: str | None = None,
) -> None:  # fmt: skip
    """Annotate a file; do nothing where nobody runs a workflow."""
    if not on_github():
        return
    place = {"file": _within(file), "line": line, "col": column, "title": number}
    named = ",".join(f"{k}={_property(str(v))}" for k, v in place.items() if v)
    with contextlib.suppress(OSError):
        start = f"::{level} {named}".rstrip()
        print(visible(f"{start}::{_data(unmarked(text))}"), file=sys.stderr, flush=True)


def annotate_problem(problem: Problem, file: str | None = None) -> None:
    """Annotate the line of a fault; `file` is where it is if it does not say so."""
    hint = f"\nhint: {problem.whole.hint}"
    annotate(
        ERROR, problem.text + hint, problem.file or file, problem.line, problem.column,
        problem.number,
    )  # fmt: skip


def _within(file: str | None) -> str | None:
    """Give a file's path in the repository, which is what annotations name."""
    if file is None or file == "-" or file.startswith("<"):  # standard input
        return None
    root = os.environ.get("GITHUB_WORKSPACE")
    path = Path(file).absolute()
    if root and path.is_relative_to(root):
        return path.relative_to(root).as_posix()
    return file


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
