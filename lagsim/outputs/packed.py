"""The table of a run: as CSV, or packed in the format of NumPy or Parquet.

Packed formats keep columns one after the other, so the rows go to a file of their own
first, in the folder of the results; nothing but blocks of them is ever in memory.
"""

from __future__ import annotations

import tempfile
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.outputs import Format
from lagsim.outputs.table import TableWriter, Writer, numberless

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from lagsim.language.arrays import Floats

    Blocks = Callable[[], Iterator[Floats]]
    Pack = Callable[[Path, Mapping[str, str], int, Blocks], None]

# Numbers that are packed at once.
BLOCK = 1 << 20
# The oldest date that a zip file knows: bytes do not tell when they were written.
NO_DATE = (1980, 1, 1, 0, 0, 0)


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
    return PackedWriter(form, path, units)


class PackedWriter(Writer):
    """Writes rows to a file of its own; `finish` packs them."""

    def __init__(self, form: Format, path: Path, units: Mapping[str, str]) -> None:
        file = tempfile.TemporaryFile(dir=path.parent, buffering=0)  # noqa: SIM115
        super().__init__(file, len(units))
        self._path, self._units = path, units
        self._pack: Pack = _as_parquet if form is Format.PARQUET else _as_npz

    def finish(self) -> None:
        """Make the table of the rows.

        Raises
        ------
        OSError
            If there is no room for it.
        """
        self._pack(self._path, self._units, self.rows, self._blocks)

    def _blocks(self) -> Iterator[Floats]:
        """Return the rows, some at a time."""
        many = max(1, BLOCK // self._width)
        self._file.seek(0)
        for start in range(0, self.rows, many):
            count = min(many, self.rows - start)
            data = self._file.read(8 * count * self._width)
            yield np.frombuffer(data).reshape(count, self._width)


def check_format(form: Format, *, show_units: bool) -> None:
    """Refuse what a packed table cannot be.

    Raises
    ------
    InputError
    """
    if show_units:
        text = f"a table in the format {form} has no line of units"
        hint = "run.json has the units of all columns, and Parquet its own"
        raise InputError([Problem("usage", text, hint=hint)])
    if form is Format.PARQUET:
        arrow()


def arrow() -> Any:
    """Return pyarrow's module of Parquet.

    Raises
    ------
    InputError
        Where it is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        text = "tables in Parquet need pyarrow, which is not installed"
        hint = "pip install pyarrow; or take npz, which needs nothing more"
        raise InputError([Problem("missing-package", text, hint=hint)]) from None
    return pyarrow.parquet


def _as_npz(path: Path, units: Mapping[str, str], rows: int, blocks: Blocks) -> None:
    """Write an array for each column, as `numpy.savez` would."""
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
    """Write a column for each, with its unit where there is one."""
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
