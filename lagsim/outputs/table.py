"""trajectory.csv: RFC 4180, a header, then one row per output time.

Floats are the shortest text that reads back to the same bits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import orjson

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from lagsim.native.kernel_types import Floats

NAME = "trajectory.csv"
_LINE = b"\r\n"


class TableWriter:
    """Writes rows as they come; memory does not grow with their number.

    Parameters
    ----------
    path
        Where to write.
    columns
        The header; rows may be wider, and are cut to it.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self._width = len(columns)
        self._file = path.open("wb", buffering=1 << 20)
        self._file.write(",".join(columns).encode() + _LINE)

    def add(self, rows: Floats) -> None:
        """Write rows (k, at least the columns)."""
        block = np.ascontiguousarray(rows[:, : self._width])
        if np.isfinite(block).all():
            text = orjson.dumps(block, option=orjson.OPT_SERIALIZE_NUMPY)
            self._file.write(text[2:-2].replace(b"],[", _LINE) + _LINE)
            return
        for row in block.tolist():  # JSON has no nan
            self._file.write(",".join(map(repr, row)).encode() + _LINE)

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
