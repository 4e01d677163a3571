"""The table of a run: as CSV, or packed (`outputs.packed`).

trajectory.csv: RFC 4180, a header, then one row per output time. Floats are the
shortest text that reads back to the same bits. On request a line of units follows the
header.
"""

from __future__ import annotations

import os
from operator import attrgetter
from typing import IO, TYPE_CHECKING

import numpy as np
import orjson

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.notes import Event

_LINE = b"\r\n"
# What begins a formula in a spreadsheet; the second four are of full width.
_COMPUTED = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")


class Writer:
    """Writes rows as they come into a file; memory does not grow with their number.

    Attributes
    ----------
    rows : int
        Rows written.
    last : float or None
        The first column of the last of them.
    """

    def __init__(self, file: IO[bytes], width: int, head: bytes = b"") -> None:
        self.rows = 0
        self.last: float | None = None
        self._file, self._width = file, width
        self._file.write(head)
        self._head = self._file.tell()

    def add(self, rows: Floats) -> None:
        """Write rows (k, at least the columns).

        Raises
        ------
        OSError
            If there is no room for them; then the file ends with the last whole row.
        """
        block = np.ascontiguousarray(rows[:, : self._width])
        text = self._text(block)
        begun, left = self._file.tell(), memoryview(text)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError:
            whole, size = self._whole(text[: len(text) - len(left)])
            self._file.truncate(begun + size)
            self._count(block[:whole])
            raise
        self._count(block)

    def begin_anew(self) -> None:
        """Take all rows back."""
        self._file.seek(self._head)
        self._file.truncate()
        self.rows, self.last = 0, None

    def finish(self) -> None:
        """Make the table whole.

        Raises
        ------
        OSError
            If there is no room for it.
        """

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _count(self, written: Floats) -> None:
        self.rows += len(written)
        if len(written):
            self.last = float(written[-1, 0])

    def _text(self, block: Floats) -> bytes:
        """Return rows as they are written."""
        return block.tobytes()

    def _whole(self, text: bytes) -> tuple[int, int]:
        """Return how many whole rows, and how many bytes of them, a text has."""
        rows = len(text) // (8 * self._width)
        return rows, 8 * self._width * rows


def numberless(unit: str) -> str:
    """Return a unit for the line of units, where a number would make a row of it."""
    try:
        float(unit)
    except ValueError:
        return unit
    return ""


def events_table(events: Iterable[Event]) -> bytes:
    """Return events.csv; what does not go with a kind of event is empty."""
    columns = (
        "time", "kind", "constraint", "rate_before", "rate_after", "energy", "switch",
    )  # fmt: skip
    return table_of(columns, map(attrgetter(*columns), events))


def table_of(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> bytes:
    """Return a small table of any values at once; what is not known (None) is empty."""
    import csv
    import io

    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(map(_cell, columns))
    for row in rows:
        writer.writerow(map(_cell, row))
    return text.getvalue().encode()


def _cell(x: object) -> object:
    if isinstance(x, bool):
        return str(x).lower()
    return guarded(x) if isinstance(x, str) else x


def guarded(text: str) -> str:
    """Return a text as a cell has it: with a `'` where a spreadsheet would compute it.

    That is what begins with one of = + - @ and is no number; `unguarded` gives it back.
    """
    bare = text.lstrip(" \t\r\n'")
    return f"'{text}" if bare.startswith(_COMPUTED) and numberless(text) else text


def unguarded(cell: str) -> str:
    """Return the text of a cell that `guarded` has made."""
    return cell[1:] if cell.startswith("'") and guarded(cell[1:]) == cell else cell


class TableWriter(Writer):
    """Writes rows as CSV.

    Parameters
    ----------
    path
        Where to write.
    columns
        The header; rows may be wider, and are cut to it.
    units
        The second line, if there is to be one.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], units: Sequence[str] | None = None
    ) -> None:
        head = table_of(columns, [] if units is None else [units])
        super().__init__(path.open("wb", buffering=0), len(columns), head)

    def go_on(self, content: Iterable[bytes], rows: int, last: float | None) -> None:
        """Begin with rows that were written before, their header with them."""
        self._file.seek(0)
        self._file.truncate()
        for block in content:
            left = memoryview(block)
            while left:
                left = left[self._file.write(left) :]
        self.rows, self.last = rows, last

    def synced(self) -> int:
        """Have the rows on the disk; return the bytes that they take."""
        os.fsync(self._file.fileno())
        return self._file.tell()

    def _text(self, block: Floats) -> bytes:
        if not len(block):
            return b""
        if np.isfinite(block).all():
            text = orjson.dumps(block, option=orjson.OPT_SERIALIZE_NUMPY)
            return text[2:-2].replace(b"],[", _LINE) + _LINE
        rows = (",".join(map(repr, row)).encode() for row in block.tolist())
        return _LINE.join(rows) + _LINE  # JSON has no nan

    def _whole(self, text: bytes) -> tuple[int, int]:
        return text.count(_LINE), text.rfind(_LINE) + len(_LINE) if _LINE in text else 0
