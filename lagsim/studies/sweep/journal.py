"""Rows of a sweep on their way: on the disk as they come, whatever happens then.

A line of JSON for each, after one that says what is swept. A line that was cut off is
not one; the row is made again.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim import files
from lagsim.errors import InputError, Problem
from lagsim.outputs.results import put
from lagsim.studies.sweep.runs import Row

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

NAME = "sweep.rows.jsonl"
# How often the system is asked to put rows on the disk itself: what it takes then is a
# part of nothing.
SYNC_SECONDS = 1.0


class Journal:
    """The rows of a sweep that is not complete, in a file that grows.

    Parameters
    ----------
    what
        What is swept and how; equal for the same rows.
    """

    def __init__(self, path: Path, what: Mapping[str, Any]) -> None:
        self.path = path
        self._what = json.loads(json.dumps(what))
        self._file: int | None = None
        self._synced = time.monotonic()

    def resumed(self) -> dict[int, Row]:
        """Give the rows that are there, and go on after them.

        Raises
        ------
        InputError
            Where they are rows of another sweep.
        """
        try:
            content = files.content(self.path)
        except FileNotFoundError:
            self.begin()
            return {}
        lines = content[: content.rfind(b"\n") + 1].splitlines()
        if not lines:
            self.begin()
            return {}
        self._compare(lines[0])
        self._replace(b"".join(line + b"\n" for line in lines))
        return dict(map(_row, lines[1:]))

    def begin(self) -> None:
        """Begin anew."""
        self._replace(b"")
        self._write([self._what])

    def add(self, rows: Iterable[tuple[int, Row]]) -> None:
        """Keep rows, by their numbers."""
        self._write(
            [[k, *row._replace(numbers=row.numbers.tolist())] for k, row in rows]
        )

    def close(self) -> None:
        """Leave it as it is."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def remove(self) -> None:
        """Remove it: the rows stand elsewhere now."""
        self.close()
        with contextlib.suppress(OSError):
            self.path.unlink()

    def _replace(self, content: bytes) -> None:
        """Put a file of this content in the place of the one that there is.

        That one is not written to: it may have another name elsewhere.
        """
        self.close()
        put(self.path, content)
        self._file = files.held(self.path, os.O_RDWR | os.O_APPEND)

    def _write(self, lines: Iterable[Any]) -> None:
        assert self._file is not None
        text = "".join(json.dumps(line) + "\n" for line in lines).encode()
        view = memoryview(text)
        while view:
            view = view[os.write(self._file, view) :]
        if time.monotonic() - self._synced > SYNC_SECONDS:
            os.fsync(self._file)
            self._synced = time.monotonic()

    def _compare(self, line: bytes) -> None:
        """Refuse rows of another sweep."""
        try:
            there = dict(json.loads(line))
        except (ValueError, TypeError):
            there = {}
        other = [key for key, x in self._what.items() if there.get(key) != x]
        if other:
            text = f"{self.path} cannot be resumed: it has another {other[0]}"
            hint = "leave --resume out to start again, or choose another folder with -o"
            raise InputError([Problem("another-sweep", text, hint=hint)])


def _row(line: bytes) -> tuple[int, Row]:
    number, values, outcome, complete, error, reason, numbers, form = json.loads(line)
    cells = np.array(numbers, dtype=float)
    return number, Row(tuple(values), outcome, complete, error, reason, cells, form)
