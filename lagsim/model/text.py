"""The text of a model file, before anybody reads it."""

from __future__ import annotations

import sys
from pathlib import Path

from lagsim import files, limits
from lagsim.errors import InputError, Place, Problem

STANDARD_INPUT = "-"
# What it is called.
STDIN = "<stdin>"

# Where a shell's `<(command)` is: a pipe, and somebody writes into it.
_OPEN_ALREADY = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")


def text_of(path: str) -> tuple[str, str]:
    """Give the text of a model file, or of standard input, and what to call it.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    file = STDIN if path == STANDARD_INPUT else path
    try:
        if path == STANDARD_INPUT:
            data = files.all_of(sys.stdin.buffer, limits.MODEL_BYTES)
        elif path.startswith(_OPEN_ALREADY):
            with Path(path).open("rb") as stream:
                data = files.all_of(stream, limits.MODEL_BYTES)
        else:
            data = files.content(path, limits.MODEL_BYTES)
    except (OSError, ValueError) as error:  # ValueError: a null byte in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise unusable("unreadable", f"cannot be read: {reason}", file) from None
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1)
        place = Place(file, line, column + 1)
        message = f"not UTF-8: byte 0x{data[error.start]:02x} in line {line}"
        raise unusable("not-utf8", message, file, place) from None
    return text, file


def unusable(code: str, text: str, file: str, place: Place | None = None) -> InputError:
    """Give what tells that a text cannot be used."""
    return InputError([Problem(code, f"{file}: {text}" if not place else text, place)])
