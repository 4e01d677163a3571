"""The table of a run: as CSV, or packed (`outputs.packed`).

trajectory.csv: RFC 4180, a header, then one row per output time. Floats are the
shortest text that reads back to the same bits. On request a line of units follows the
header.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Protocol

import numpy as np
import orjson

from lagsim.outputs import Format

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from lagsim.language.arrays import Floats

_LINE = b"\r\n"
# What begins a formula in a spreadsheet; the second four are of full width.
_COMPUTED = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")


class Writer(Protocol):
    """Writes rows as they come, see `TableWriter`."""

    rows: int
    last: float | None

    def add(self, rows: Floats) -> None:
        """Write rows (k, at least the columns)."""

    def begin_anew(self) -> None:
        """Take all rows back."""

    def finish(self) -> None:
        """Make the table whole."""

    def close(self) -> None:
        """Close the file."""


def table_writer(
    form: Format, path: Path, units: Mapping[str, str], *, show_units: bool
) -> Writer:
    """Open a table for the columns that `units` names.

    Parameters
    ----------
    show_units
        CSV gets a line of them.

    Raises
    ------
    OSError
    """
    if form is Format.CSV:
        line = [numberless(unit) for unit in units.values()] if show_units else None
        return TableWriter(path, list(units), line)
    from lagsim.outputs.packed import PackedWriter

    return PackedWriter(form, path, units)


def numberless(unit: str) -> str:
    """Give a unit as a line of units has it, where a number would make a row of it."""
    try:
        float(unit)
    except ValueError:
        return unit
    return ""


def table_of(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> bytes:
    """Give a small table of any values at once; what is not known (None) is empty."""
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
    """Give a text as a cell has it: with a `'` where a spreadsheet would compute it.

    That is what begins with one of = + - @ and is no number; `unguarded` gives it back.
    """
    bare = text.lstrip(" \t\r\n'")
    return f"'{text}" if bare.startswith(_COMPUTED) and numberless(text) else text


def unguarded(cell: str) -> str:
    """Give the text of a cell that `guarded` has made."""
    return cell[1:] if cell.startswith("'") and guarded(cell[1:]) == cell else cell


class TableWriter:
    """Writes rows as they come; memory does not grow with their number.

    Parameters
    ----------
    path
        Where to write.
    columns
        The header; rows may be wider, and are cut to it.
    units
        The second line, if there is to be one.

    Attributes
    ----------
    rows : int
        Rows written.
    last : float or None
        The first column of the last of them.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], units: Sequence[str] | None = None
    ) -> None:
        self.rows = 0
        self.last: float | None = None
        self._width = len(columns)
        self._file = path.open("wb", buffering=0)
        self._file.write(table_of(columns, [] if units is None else [units]))
        self._head = self._file.tell()

    def add(self, rows: Floats) -> None:
        """Write rows (k, at least the columns).

        Raises
        ------
        OSError
            If there is no room for them; then the file ends with the last whole row.
        """
        block = np.ascontiguousarray(rows[:, : self._width])
        text = _text(block)
        begun = self._file.tell()
        left = memoryview(text)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError:
            end = text.rfind(_LINE, 0, len(text) - len(left)) + len(_LINE)
            whole = text[:end] if end >= len(_LINE) else b""
            self._file.truncate(begun + len(whole))
            self._count(block[: whole.count(_LINE)])
            raise
        self._count(block)

    def begin_anew(self) -> None:
        """Take all rows back."""
        self._file.seek(self._head)
        self._file.truncate()
        self.rows, self.last = 0, None

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
        """Have the rows on the disk; give the bytes that they take."""
        os.fsync(self._file.fileno())
        return self._file.tell()

    def finish(self) -> None:
        """Make the table whole, as it is after each row."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _count(self, written: Floats) -> None:
        self.rows += len(written)
        if len(written):
            self.last = float(written[-1, 0])


def _text(block: Floats) -> bytes:
    if not len(block):
        return b""
    if np.isfinite(block).all():
        text = orjson.dumps(block, option=orjson.OPT_SERIALIZE_NUMPY)
        return text[2:-2].replace(b"],[", _LINE) + _LINE
    rows = (",".join(map(repr, row)).encode() for row in block.tolist())
    return _LINE.join(rows) + _LINE  # JSON has no nan
