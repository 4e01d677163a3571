"""The table of a run, as CSV or packed in the format of NumPy or Parquet.

trajectory.csv: RFC 4180, a header, then one row per output time. Floats are the
shortest text that reads back to the same bits. Optionally a line of units follows the
header.

Packed formats store one column after the other, so rows are first written to a
temporary file in the folder of the results; only blocks of rows are ever in memory.
"""

from __future__ import annotations

import math
import os
import tempfile
import zipfile
from operator import attrgetter
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import orjson

from lagsim.codes.known import MISSING_PACKAGE, USAGE
from lagsim.errors import unusable
from lagsim.language.columns import DEVIATION, SENSITIVITY, is_of_kind
from lagsim.outputs import TableFormat

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.notes import Event

    Blocks = Callable[[], Iterator[Floats]]
    Pack = Callable[[Path, Mapping[str, str], int, Blocks], None]

EVENTS = "events.csv"
_LINE = b"\r\n"
# Numbers in a block of rows that are packed.
BLOCK = 1 << 20
# The earliest date of a zip entry: bytes do not depend on the time of writing.
NO_DATE = (1980, 1, 1, 0, 0, 0)
# First letters of a formula in a spreadsheet; the last four are full-width forms.
_COMPUTED = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")


class Writer:
    """Writer of rows to a file, block by block; memory does not grow with their number.

    Parameters
    ----------
    file : file object
        Receives the bytes.
    width : int
        Number of columns of the table.
    head : bytes
        Bytes before the first row.

    Attributes
    ----------
    rows : int
        Number of rows written.
    last : float or None
        First column of the last row.
    """

    def __init__(self, file: IO[bytes], width: int, head: bytes = b"") -> None:
        self.rows = 0
        self.last: float | None = None
        self._file, self._width = file, width
        self._file.write(head)
        self._head = self._file.tell()

    def add(self, rows: Floats) -> None:
        """Write rows.

        Parameters
        ----------
        rows : ndarray, shape (k, m)
            Rows with at least the columns of the table; further columns are left out.

        Raises
        ------
        OSError
            If the disk is full; then the file ends with the last whole row.
        """
        block = np.ascontiguousarray(rows[:, : self._width])
        text, begun = self._text(block), self._file.tell()
        try:
            self._append(text)
        except OSError:
            whole, size = self._whole(text[: self._file.tell() - begun])
            self._file.truncate(begun + size)
            self._count(block[:whole])
            raise
        self._count(block)

    def _append(self, text: bytes) -> None:
        left = memoryview(text)
        while left:
            left = left[self._file.write(left) :]

    def begin_anew(self) -> None:
        """Remove all rows written so far."""
        self._file.seek(self._head)
        self._file.truncate()
        self.rows, self.last = 0, None

    def finish(self) -> None:
        """Complete the table.

        Raises
        ------
        OSError
            If the disk is full.
        """

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _count(self, written: Floats) -> None:
        self.rows += len(written)
        if len(written):
            self.last = float(written[-1, 0])

    def _text(self, block: Floats) -> bytes:
        """Return a block of rows as bytes in the format of the table."""
        return block.tobytes()

    def _whole(self, text: bytes) -> tuple[int, int]:
        """Return the number of whole rows at the beginning of `text`, and their bytes.

        text : part of the file, from the beginning of a row on; a full disk may have
            cut it.
        """
        rows = len(text) // (8 * self._width)
        return rows, 8 * self._width * rows


def numberless(unit: str) -> str:
    """Return a unit as a cell of the line of units; "" if it reads as a number.

    A cell that is a number would make the line of units a row of the table.
    """
    try:
        float(unit)
    except ValueError:
        return unit
    return ""


def event_columns(*, named: bool) -> tuple[str, ...]:
    """Return the columns of events.csv.

    named : whether there is a column of names, for a file with `events`.
    """
    return (
        "time", "kind", "constraint", "rate_before", "rate_after", "energy", "switch",
        *(["name"] if named else []),
    )  # fmt: skip


def events_table(events: Iterable[Event], *, named: bool) -> bytes:
    """Return the bytes of events.csv; fields that a kind of event lacks are empty.

    Parameters
    ----------
    events : iterable of Event
    named : bool
        Whether there is a column of names, for a file with `events`.
    """
    columns = event_columns(named=named)
    return table_of(columns, map(attrgetter(*columns), events))


def table_of(columns: Iterable[str], rows: Iterable[Iterable[object]]) -> bytes:
    r"""Return a small CSV table of any values; None becomes an empty field.

    Examples
    --------
    >>> table_of(["t", "closed"], [[0.5, True], [1.0, None]])
    b't,closed\r\n0.5,true\r\n1.0,\r\n'
    """
    return _lines([columns, *rows])


def _lines(rows: Iterable[Iterable[object]]) -> bytes:
    """Return rows of any values as lines of CSV; None becomes an empty field."""
    import csv
    import io

    text = io.StringIO(newline="")
    writer = csv.writer(text)
    for row in rows:
        writer.writerow(map(_cell, row))
    return text.getvalue().encode()


def _cell(x: object) -> object:
    if isinstance(x, bool):
        return str(x).lower()
    return guarded(x) if isinstance(x, str) else x


def guarded(text: str) -> str:
    """Return a text as a CSV field that a spreadsheet does not compute.

    A text that begins with one of = + - @ and is no number gets a `'` in front;
    `unguarded` removes it.

    Examples
    --------
    >>> guarded("=1+1"), guarded("-0.5")
    ("'=1+1", '-0.5')
    """
    bare = text.lstrip(" \t\r\n'")
    return f"'{text}" if bare.startswith(_COMPUTED) and numberless(text) else text


def unguarded(cell: str) -> str:
    """Return the text from which `guarded` has made the field `cell`."""
    return cell[1:] if cell.startswith("'") and guarded(cell[1:]) == cell else cell


class TableWriter(Writer):
    """Writer of rows as CSV.

    Parameters
    ----------
    path : Path
    columns : sequence of str
        The header; wider rows are cut to it.
    units : sequence of str, optional
        The second line.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], units: Sequence[str] | None = None
    ) -> None:
        head = table_of(columns, [] if units is None else [units])
        self._gaps = [is_of_kind(x, SENSITIVITY, DEVIATION) for x in columns]
        super().__init__(path.open("wb", buffering=0), len(columns), head)

    def go_on(self, content: Iterable[bytes], rows: int, last: float | None) -> None:
        """Replace the content by rows of an earlier run, which later rows continue.

        Parameters
        ----------
        content : iterable of bytes
            The rows, in blocks of the text of a file.
        rows : int
            Number of rows in `content`.
        last : float or None
            First column of the last row.
        """
        self._file.seek(0)
        self._file.truncate()
        for block in content:
            self._append(block)
        self.rows, self.last = rows, last

    def append(self, rows: Sequence[Iterable[object]]) -> None:
        """Write rows of any values; None becomes an empty field.

        Raises
        ------
        OSError
            If the disk is full.
        """
        self._append(_lines(rows))
        self.rows += len(rows)

    def synced(self) -> int:
        """Flush the rows to the disk; return the size of the file in bytes."""
        os.fsync(self._file.fileno())
        return self._file.tell()

    def _text(self, block: Floats) -> bytes:
        if not len(block):
            return b""
        if np.isfinite(block).all():
            text = orjson.dumps(block, option=orjson.OPT_SERIALIZE_NUMPY)
            return text[2:-2].replace(b"],[", _LINE) + _LINE
        # JSON has no nan. A derivative that does not exist is an empty cell.
        rows = (",".join(map(self._cell, row, self._gaps)) for row in block.tolist())
        return _LINE.join(row.encode() for row in rows) + _LINE

    @staticmethod
    def _cell(x: float, gap: bool) -> str:
        return "" if gap and math.isnan(x) else repr(x)

    def _whole(self, text: bytes) -> tuple[int, int]:
        return text.count(_LINE), text.rfind(_LINE) + len(_LINE) if _LINE in text else 0


class EventsWriter:
    """Writer of events.csv, which receives the events during a run.

    Attributes
    ----------
    table : TableWriter
    fault : OSError or None
        The error of a disk that is full; later events are discarded.
    """

    def __init__(self, path: Path, *, named: bool) -> None:
        """Open the file; `named` as in `event_columns`."""
        columns = event_columns(named=named)
        self.table = TableWriter(path, columns)
        self.fault: OSError | None = None
        self._fields = attrgetter(*columns)

    def extend(self, events: Sequence[Event]) -> None:
        """Write events, none of which is earlier than the events written before."""
        if self.fault is None:
            try:
                self.table.append(list(map(self._fields, events)))
            except OSError as error:
                self.fault = error


class PackedWriter(Writer):
    """Writer of rows to a temporary file, which `finish` packs."""

    def __init__(self, form: TableFormat, path: Path, units: Mapping[str, str]) -> None:
        file = tempfile.TemporaryFile(dir=path.parent, buffering=0)  # noqa: SIM115
        super().__init__(file, len(units))
        self._path, self._units = path, units
        self._pack: Pack = _as_parquet if form is TableFormat.PARQUET else _as_npz

    def finish(self) -> None:
        """Write the packed table.

        Raises
        ------
        OSError
            If the disk is full.
        """
        self._pack(self._path, self._units, self.rows, self._blocks)

    def _blocks(self) -> Iterator[Floats]:
        """Yield the rows that were written, in blocks (k, columns)."""
        many = max(1, BLOCK // self._width)
        self._file.seek(0)
        for start in range(0, self.rows, many):
            count = min(many, self.rows - start)
            data = self._file.read(8 * count * self._width)
            yield np.frombuffer(data).reshape(count, self._width)


def check_format(form: TableFormat, *, show_units: bool) -> None:
    """Refuse the option `show_units` of a packed table, and Parquet without pyarrow.

    Raises
    ------
    InputError
        For such an option, or if pyarrow is missing.
    """
    if show_units:
        text = f"a table in the format {form} has no line of units"
        hint = "run.json has the units of all columns, and Parquet its own"
        raise unusable(USAGE, text, hint=hint)
    if form is TableFormat.PARQUET:
        arrow()


def arrow() -> Any:
    """Return the module pyarrow.parquet.

    Raises
    ------
    InputError
        If pyarrow is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        text = "tables in Parquet need pyarrow, which is not installed"
        hint = "pip install pyarrow; or use npz, which needs no package"
        raise unusable(MISSING_PACKAGE, text, hint=hint) from None
    return pyarrow.parquet


def _as_npz(path: Path, units: Mapping[str, str], rows: int, blocks: Blocks) -> None:
    """Write an archive with an array (rows,) for each column, as `numpy.savez` would.

    units : columns with their units.
    blocks : all rows, in blocks.
    """
    head = {"descr": "<f8", "fortran_order": False, "shape": (rows,)}
    with zipfile.ZipFile(path, "w") as archive:
        for k, name in enumerate(units):
            entry = zipfile.ZipInfo(f"{name}.npy", NO_DATE)
            with archive.open(entry, "w", force_zip64=True) as file:
                np.lib.format.write_array_header_1_0(file, head)
                for block in blocks():
                    file.write(block[:, k].astype("<f8").tobytes())


def _as_parquet(
    path: Path, units: Mapping[str, str], _rows: int, blocks: Blocks
) -> None:
    """Write a Parquet file with each column, and its unit if known.

    units : columns with their units.
    blocks : all rows, in blocks.
    """
    import pyarrow as pa

    fields = [
        pa.field(name, pa.float64(), False, {"unit": unit} if unit else None)
        for name, unit in units.items()
    ]
    schema = pa.schema(fields)
    with arrow().ParquetWriter(path, schema) as writer:
        for block in blocks():
            arrays = [pa.array(np.ascontiguousarray(x)) for x in block.T]
            writer.write_table(pa.table(arrays, schema=schema))


def table_writer(
    form: TableFormat, path: Path, units: Mapping[str, str], *, show_units: bool
) -> Writer:
    """Return the writer of a table with the columns of `units`.

    Parameters
    ----------
    form : TableFormat
    path : Path
    units : mapping of str to str
        Units of the columns.
    show_units : bool
        Whether CSV has a line of units.

    Raises
    ------
    OSError
        If the file cannot be opened.
    """
    if form is TableFormat.CSV:
        line = [numberless(unit) for unit in units.values()] if show_units else None
        return TableWriter(path, list(units), line)
    return PackedWriter(form, path, units)
