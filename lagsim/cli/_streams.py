"""Standard streams that may be closed, full, narrow, or left by their reader.

Where GitHub's runner reads them, it takes a line that begins with `::`, after blanks
too, for a command, and `##[` anywhere in a line: what is printed is made harmless.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import typer

from lagsim.errors import LagsimError, Problem, visible

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator


# What stands before the text of a line: an indent, and a name with two blanks after it.
_LABEL = re.compile(r"\s*(?:\S+(?: \S+)?\s{2,})?")
# Begins the colours that are ours, of which no file can know.
_OWN = f"\x1b{os.urandom(8).hex()}"
_COLOUR = re.compile(rf"{_OWN}(\[\d+m)")
# Blanks without width, which Python does not count as such.
_NO_WIDTH = dict.fromkeys(map(ord, "\ufeff\u200b\u180e"))


class UnwritableError(LagsimError):
    """Results cannot be written (exit 3), as when a disk fills up."""

    exit_code = 3
    code = "no-room"


def prepare() -> None:
    """Replace closed streams, and let none fail on a letter that it does not know."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, os.fdopen(handle, mode, encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def say(text: str) -> None:
    """Print on stdout what is for a person: no line is wider than a terminal."""
    put(lambda: print(shown(text, sys.stdout)))


def width_of(stream: TextIO) -> int | None:
    """Return how many letters a line takes; None where no terminal counts them."""
    return shutil.get_terminal_size().columns if stream.isatty() else None


def colour(text: str, code: str) -> str:
    """Return a text in a colour, as `shown` lets it pass."""
    return f"{_OWN}[{code}m{text}{_OWN}[0m"


def shown(text: str, stream: TextIO, *, again: bool = False) -> str:
    """Return what a terminal shows, and does not act on, but for colours of our own.

    Parameters
    ----------
    again
        The text was printed before, by a process of ours, with its annotations.
    """
    parts = _COLOUR.split(text)
    parts[::2] = map(visible, parts[::2])
    parts[1::2] = [f"\x1b{code}" * stream.isatty() for code in parts[1::2]]
    lines = fitted("".join(parts), stream)
    return lines if again else harmless(lines)


def on_github() -> bool:
    """Return whether a runner of GitHub reads what is printed."""
    return os.environ.get("GITHUB_ACTIONS") == "true"


def harmless(text: str) -> str:
    """Return a text of which the runner takes no line for a command.

    A mark takes the place of the first blank, so that columns stay where they are.
    """
    if not on_github():
        return text
    return "".join(map(_marked, re.split("([\r\n])", unmarked(text))))


def unmarked(text: str) -> str:
    """Return a text without the sign of older commands."""
    return text.replace("##[", "## [")


def _marked(line: str) -> str:
    at = line.find("::")
    if at < 0 or line[:at].translate(_NO_WIDTH).strip():
        return line
    return f"| {line[min(2, at) :]}"


def fitted(text: str, stream: TextIO) -> str:
    """Break lines that are wider than the terminal, below where their text begins."""
    width = width_of(stream)
    return text if width is None else "\n".join(_broken(text.split("\n"), width))


def _broken(lines: Iterable[str], width: int) -> Iterator[str]:
    for line in lines:
        label = _LABEL.match(line)
        indent = len(label[0]) if label else 0
        if len(line) <= width or indent > width // 2:
            yield line
            continue
        yield from textwrap.wrap(
            line[indent:], width, initial_indent=line[:indent],
            subsequent_indent=" " * (indent or 2), break_on_hyphens=False,
            break_long_words=False,
        )  # fmt: skip


def put(write: Callable[[], object]) -> None:
    """Call `write`, which writes to stdout, and flush.

    A reader that has gone away (`| head`) is no fault: the rest goes nowhere.
    """
    try:
        write()
        sys.stdout.flush()
    except BrokenPipeError:
        _mute(sys.stdout)
    except OSError as error:
        raise typer.Exit(full(error)) from None


def full(error: OSError) -> int:
    """Report that stdout takes nothing more; return the exit code."""
    from lagsim.codes import number

    _mute(sys.stdout)
    text = f"lagsim: standard output cannot be written: {error.strerror}"
    complain(f"{text} [{number(UnwritableError.code)}]")
    return UnwritableError.exit_code


def complain(text: str, *, again: bool = False) -> None:
    """Print on stderr what is for a person."""
    _report(shown(text, sys.stderr, again=again))


def _report(text: str) -> None:
    """Print on stderr; where that cannot be written, nothing can be reported."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        _mute(sys.stderr)


def _mute(stream: TextIO) -> None:
    """Send what is still to be written nowhere, so that the last flush succeeds."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


# --- Annotations: what GitHub Actions shows beside a line of a file, where it runs us
#
# They go to stderr, which the runner reads as it does stdout, so that stdout stays what
# it is for everybody else.

ERROR, WARNING = "error", "warning"


def annotate(
    level: str, text: str, file: str | None, line: int | None = None,
    column: int | None = None, number: str | None = None,
) -> None:  # fmt: skip
    """Annotate a file; do nothing outside a workflow."""
    if not on_github():
        return
    place = {"file": _within(file), "line": line, "col": column, "title": number}
    named = ",".join(f"{k}={_property(str(v))}" for k, v in place.items() if v)
    start = f"::{level} {named}".rstrip()
    _report(visible(f"{start}::{_data(unmarked(text))}"))


def annotate_problem(problem: Problem, file: str | None = None) -> None:
    """Annotate the line of a fault; `file` is where it is if it does not say so."""
    hint = f"\nhint: {problem.whole.hint}"
    annotate(
        ERROR, problem.text + hint, problem.file or file, problem.line, problem.column,
        problem.number,
    )  # fmt: skip


def _within(file: str | None) -> str | None:
    """Return a file's path in the repository, which is what annotations name."""
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
