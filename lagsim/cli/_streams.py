"""Standard streams that may be closed, full, narrow, or left by their reader."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from typing import TYPE_CHECKING

import typer

from lagsim.errors import LagsimError

if TYPE_CHECKING:
    from collections.abc import Callable


class UnwritableError(LagsimError):
    """What was computed has nowhere to go (exit 3), as when a disk fills up."""

    exit_code = 3


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
    """Print on stdout."""
    put(lambda: print(text))


def put(write: Callable[[], object]) -> None:
    """Call `write`, which writes to stdout, and flush.

    A reader that has gone away (`| head`) is no fault: the rest goes nowhere.
    """
    try:
        write()
        sys.stdout.flush()
    except BrokenPipeError:
        _mute()
    except OSError as error:
        raise typer.Exit(full(error)) from None


def full(error: OSError) -> int:
    """Tell that stdout takes nothing more; give the exit code."""
    _mute()
    complain(f"lagsim: standard output cannot be written: {error.strerror}")
    return UnwritableError.exit_code


def complain(text: str) -> None:
    """Print on stderr; where that cannot be written, nobody can be told."""
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr, flush=True)


def _mute() -> None:
    """Send what is still to be written nowhere, so that the last flush succeeds."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
