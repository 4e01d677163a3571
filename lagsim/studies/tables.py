"""Reader of tables of results, in CSV, NPZ or Parquet.

CSV is read in blocks of lines, so that large files fit into memory, with or without a
line of units below the header. If a block is no table of numbers, or a line is empty,
the file is read again cell by cell, and the error names the first cell that is not a
number.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import os
import re
import warnings
from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import count
from typing import TYPE_CHECKING, Any, BinaryIO
from zipfile import BadZipFile

import numpy as np
import orjson

from lagsim import files, limits
from lagsim.codes.known import BAD_TABLE
from lagsim.errors import unusable
from lagsim.language.columns import DEVIATION, SENSITIVITY, is_of_kind
from lagsim.outputs import TableFormat
from lagsim.outputs.results import MANIFEST
from lagsim.outputs.table import arrow, numberless, unguarded

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from lagsim.language.arrays import Floats
    from lagsim.run.observers.thinning import Thinning

# Bytes of a line at most: beyond, the file is something else.
LONGEST_LINE = 1 << 24
# Bytes read at once.
BLOCK = 1 << 19
# Bytes of numbers that JSON parses as `float` does: no words, and no integer -0.
DECIMALS = b"-+.,eE0123456789\r\n"
SIGNED_ZERO = re.compile(rb"-0(?=[,\s]|\Z)")
# Rows that are thinned at once.
ROWS = 1 << 16
# The unit of the time in a line of units; another line of words is no line of units.
TIME = "s"


@dataclass(frozen=True, slots=True)
class StoredTable:
    """Table of numbers, one column of which is the time `t`.

    Attributes
    ----------
    name : str
        The name of the table in messages.
    columns : tuple of str
    data : ndarray, shape (columns, rows)
    units : mapping of str to str
        Units of columns, where known.
    remarks : tuple of str
        Remarks for the user on the run that made the table.
    """

    name: str
    columns: tuple[str, ...]
    data: Floats
    units: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def t(self) -> Floats:
        """The times of the rows, shape (rows,)."""
        return self["t"]

    def __getitem__(self, column: str) -> Floats:
        return np.asarray(self.data[self.columns.index(column)])


def read_results(path: Path) -> StoredTable:
    """Read the table of a folder of results, with its run.json, or a table file.

    Raises
    ------
    InputError
        If there is no table, or it is not a table of numbers.
    """
    if not path.is_dir():
        return read_table(path)
    found = [path / form.file for form in TableFormat if (path / form.file).exists()]
    table = read_table((found or [path / TableFormat.CSV.file])[0])
    units = table.units
    remarks: tuple[str, ...] = ()
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        manifest: Any = orjson.loads(files.content(path / MANIFEST))
        units = {k: str(unit) for k, unit in manifest["columns"].items()}
        if not manifest["complete"]:
            remarks = (f"{path} is incomplete: {manifest['reason']}",)
        remarks += of_another_run(path, (found or [path])[0].name, manifest)
    return StoredTable(table.name, table.columns, table.data, units, remarks)


def thinned(columns: Mapping[str, Floats]) -> Thinning:
    """Return the rows of columns, thinned for a picture.

    columns : arrays (rows,) by name, with the time `t` first.
    """
    from lagsim.run.observers.thinning import Thinning

    thin = Thinning(tuple(columns), paths=())
    for k in range(0, len(columns["t"]), ROWS):
        thin.add(np.stack([x[k : k + ROWS] for x in columns.values()], 1))
    return thin


def of_another_run(
    folder: Path, name: str, manifest: Mapping[str, Any]
) -> tuple[str, ...]:
    """Return a remark if the digest of a file differs from that in its run.json.

    The file then belongs to another run.

    folder, name : the folder and the name of the file.
    manifest : the content of run.json.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    listed = manifest.get("sha256", {}).get(name)
    if listed is None or files.digest(folder / name) == listed:
        return ()
    text = f"{folder / name} is not the file that {MANIFEST} beside it lists: it was "
    return (f"{text}changed, or belongs to another run",)


class _FaultError(Exception):
    """Reason why a file is not a table of numbers."""


def read_table(path: Path) -> StoredTable:
    """Read a table of numbers: CSV with a header, NPZ or Parquet, by its extension.

    Raises
    ------
    InputError
        If the file cannot be read, or is not a table of numbers.
    """
    read = _PACKED.get(path.suffix, _read)
    try:
        with files.opened(path) as file:
            _refuse_large(os.fstat(file.fileno()).st_size)
            return replace(read(file), name=str(path))
    except OSError as error:
        why = f"cannot be read: {error.strerror or 'it is damaged'}"
    except _FaultError as error:
        why = str(error)
    raise unusable(BAD_TABLE, f"{path}: {why}")


def _refuse_large(size: int) -> None:
    if size > limits.TABLE_BYTES:
        amount = f"{limits.bytes_text(size)} of numbers, more than the limit"
        raise _FaultError(f"it has {amount} of {limits.bytes_text(limits.TABLE_BYTES)}")


def _read(file: BinaryIO) -> StoredTable:
    head = file.readline(LONGEST_LINE)
    columns = _header(head)
    second = file.readline(LONGEST_LINE)
    units = _units(second, columns)
    body, line = len(head), 2
    if units:
        body, line = body + len(second), 3
    file.seek(body)
    rows = _numbers(file, len(columns))
    if rows is None:
        file.seek(body)
        rows = _cells(file, line, columns)
    if not len(rows):
        raise _FaultError("there are no rows after the header")
    return StoredTable("", columns, rows.T, units)


def _numbers(file: BinaryIO, count: int) -> Floats | None:
    """Return the remaining rows of a file (rows, count).

    None if a line is no row of numbers.
    """
    found, rows, last = bytearray(), 0, b"\n"
    with contextlib.suppress(ValueError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a block of blank lines
        while block := file.read(BLOCK) + file.readline(LONGEST_LINE):
            found += _block(block).reshape(-1, count).tobytes()
            rows, last = rows + block.count(b"\n"), block[-1:]
        data = np.frombuffer(found).reshape(-1, count)
        return data if len(data) == rows + (last != b"\n") else None
    return None


def _block(lines: bytes) -> Floats:
    """Parse whole lines of numbers into an array (lines, cells).

    Raises
    ------
    ValueError
        If a cell is not a number.
    """
    # Decimals as lagsim writes these are JSON, which is parsed in a third of the time.
    if not lines.translate(None, DECIMALS) and not SIGNED_ZERO.search(lines):
        with contextlib.suppress(ValueError):
            cells = lines.rstrip().replace(b"\n", b"],[")
            return np.array(orjson.loads(b"[[%b]]" % cells), float)
    text = io.StringIO(lines.decode())
    return np.loadtxt(text, delimiter=",", comments=None, ndmin=2)


def _decoded(file: BinaryIO, first: int) -> Iterator[str]:
    """Yield the remaining lines of a file as text.

    first : number of the next line, for messages.

    Raises
    ------
    _FaultError
        If a line is too long, or is not UTF-8.
    """
    for number in count(first):
        line = file.readline(LONGEST_LINE + 1)
        if not line:
            return
        if len(line) > LONGEST_LINE:
            most = limits.bytes_text(LONGEST_LINE)
            raise _FaultError(f"a line has more than {most}, which is the limit")
        try:
            yield line.decode()
        except UnicodeDecodeError:
            raise _FaultError(f"line {number} is not UTF-8") from None


def _cut(line: bytes, encoding: str = "utf-8") -> list[str] | None:
    """Return the stripped cells of a line of CSV; None if the line is not valid CSV."""
    try:
        cells = next(csv.reader([line.decode(encoding).rstrip("\r\n")], strict=True))
    except (UnicodeDecodeError, csv.Error, StopIteration):
        return None
    return [cell.strip() for cell in cells]


def _units(line: bytes, columns: tuple[str, ...]) -> dict[str, str]:
    """Return the units of columns, if a line below the header is a line of units.

    It is such a line if no cell is a number, and the time has a unit. {} for other
    lines.
    """
    cells = _cut(line) or []
    if len(cells) != len(columns) or any(numberless(cell) != cell for cell in cells):
        return {}
    found = dict(zip(columns, map(unguarded, cells), strict=True))
    return found if found["t"] == TIME else {}


def _read_npz(file: BinaryIO) -> StoredTable:
    """Read an archive with an array of numbers for each column."""
    try:
        archive = np.load(file, allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise _FaultError("it is one array, and not one for each column")
        _refuse_large(sum(x.file_size for x in archive.zip.infolist()))
        return _joined({key: archive[key] for key in archive.files})
    except (BadZipFile, ValueError, EOFError):
        raise _FaultError("it is no archive of arrays of numbers") from None


def _read_parquet(file: BinaryIO) -> StoredTable:
    try:
        about = arrow().read_metadata(file)
        _refuse_large(8 * about.num_rows * about.num_columns)
        file.seek(0)
        found = arrow().read_table(file)
        arrays = {x: found[x].to_numpy() for x in found.column_names}
    except ValueError:
        raise _FaultError("it is no table in Parquet's format") from None
    stated = {field.name: (field.metadata or {}).get(b"unit") for field in found.schema}
    units = {x: unit.decode() for x, unit in stated.items() if unit}
    return replace(_joined(arrays), units=units)


_PACKED = {".npz": _read_npz, ".parquet": _read_parquet}


def _joined(arrays: dict[str, Any]) -> StoredTable:
    """Return arrays (rows,) by name as a table with a column for each.

    Raises
    ------
    _FaultError
        If an array is not of numbers, or the lengths differ.
    """
    if "t" not in arrays:
        raise _FaultError("there is no column `t`, the time")
    many = np.shape(arrays["t"])
    for column, array in arrays.items():
        if array.dtype.kind not in "fiu" or array.ndim != 1 or array.shape != many:
            raise _FaultError(f"{column} is no column of as many numbers as `t`")
    if not many[0]:
        raise _FaultError("there are no rows")
    return StoredTable(
        "", tuple(arrays), np.array([*arrays.values()], dtype=np.float64)
    )


def _header(head: bytes) -> tuple[str, ...]:
    if not head.strip():
        raise _FaultError("the file is empty" if not head else "line 1 is blank")
    columns = _cut(head, "utf-8-sig")
    if columns is None:
        raise _FaultError("line 1 is no header of a CSV file")
    with contextlib.suppress(ValueError):
        float(columns[0])
        raise _FaultError("line 1 is no header: it begins with a number")
    if "t" not in columns:
        raise _FaultError("line 1: there is no column `t`, the time")
    if not all(columns):
        raise _FaultError("line 1: a column has no name")
    twice = [column for column, number in Counter(columns).items() if number > 1]
    if twice:
        raise _FaultError(f"line 1: the column `{twice[0]}` is given twice")
    return tuple(columns)


def _cells(file: BinaryIO, first: int, columns: tuple[str, ...]) -> Floats:
    """Read rows cell by cell (rows, columns); an error names the first invalid line.

    first : number of the first line.
    """
    reader = csv.reader(_decoded(file, first), strict=True)
    rows: list[list[float]] = []
    here, blank = first, 0
    try:
        for cells in reader:
            if blank and cells:
                raise _FaultError(f"line {blank} is blank")
            if not cells:
                blank = blank or here
            elif len(cells) != len(columns):
                found = f"{len(cells)} cell{'s' * (len(cells) != 1)}"
                why = f"line {here} has {found}, and the header {len(columns)} columns"
                raise _FaultError(why)
            else:
                pairs = zip(cells, columns, strict=True)
                rows.append([_number(cell, column, here) for cell, column in pairs])
            here = first + reader.line_num
    except csv.Error as error:
        raise _FaultError(f"line {here}: {error}") from None
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns))


def _number(cell: str, column: str, line: int) -> float:
    if not cell.strip() and is_of_kind(column, SENSITIVITY, DEVIATION):
        return math.nan
    try:
        if "_" not in cell:
            return float(cell)
    except ValueError:
        pass
    shown = f"`{cell[:40]}`" if cell.strip() else "empty"
    raise _FaultError(f"line {line}: {column} is {shown}, and not a number")
