"""CSV files of numbers, as spreadsheets and instruments write them.

Cells are separated by commas, semicolons or tabs; with semicolons or tabs, numbers may
have decimal commas. Lines that begin with `#` are comments.
"""

from __future__ import annotations

import csv
import math
import re
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

# A comma can be part of a decimal number or a name, so it is the last choice.
SEPARATORS = (";", "\t", ",")
# Number of rows that decide the separator, with the header.
SAMPLED = 20
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")


class SheetLine(NamedTuple):
    """Cells of a line, its number in the file from 1, and its text."""

    number: int
    cells: list[str]
    line: str


class Sheet(NamedTuple):
    """Rows of a file, the header first, and the notation of its numbers.

    Attributes
    ----------
    rows : list of SheetLine
        The lines that are neither empty nor comments.
    separator : str
        The separator of cells.
    comma : bool
        Whether numbers have decimal commas.
    """

    rows: list[SheetLine]
    separator: str
    comma: bool

    @property
    def header(self) -> list[str]:
        """Names of the columns, stripped of blanks."""
        return [cell.strip() for cell in self.rows[0].cells] if self.rows else []

    def number(self, cell: str) -> float:
        """Return the number of a cell; nan where it is no finite number."""
        text = cell.replace(",", ".") if self.comma else cell
        try:
            value = math.nan if "_" in text else float(text)
        except ValueError:
            return math.nan
        return value if math.isfinite(value) else math.nan

    def excess(self, row: SheetLine) -> str:
        """Return the fault of a row that is longer than the header; "" if it is not."""
        many = len(row.cells)
        if many <= len(self.header) or not any(row.cells[len(self.header) :]):
            return ""
        text = f"{many} cells, and the header has {len(self.header)}"
        if self.separator == "," and many == 2 * len(self.header):
            text += ": with decimal commas, `;` or a tab separates cells"
        return text

    def span(self, row: SheetLine, column: int) -> tuple[int, int]:
        """Return the position at which a cell begins in its line, and its length."""
        begin = sum(len(cell) + 1 for cell in row.cells[:column])
        cells = row.cells[column : column + 1]
        return min(begin, len(row.line)) + 1, max(1, len(cells[0]) if cells else 1)


def read_sheet(text: str) -> Sheet:
    """Return the rows of a CSV file that are neither empty nor comments."""
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    separator = _separator([line for _, line in lines[: SAMPLED + 1]])
    rows = [SheetLine(k, _cells(line, separator), line) for k, line in lines]
    numbers = [cell for row in rows[1:] for cell in row.cells]
    comma = separator != "," and _has_decimal_commas(numbers)
    rows = [row for row in rows if any(cell.strip() for cell in row.cells)]
    return Sheet(rows, separator, comma)


def _cells(line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # a cell of more than 131,072 letters
        return [line]


def _separator(lines: list[str]) -> str:
    """Return the separator with which rows have as many cells as the header.

    lines : the lines of the file, the header first.
    """
    several = []
    for separator in SEPARATORS:
        header, *rows = (len(_cells(line, separator)) for line in lines or [""])
        if header > 1:
            several.append(separator)
            if all(count == header for count in rows):
                return separator
    return several[-1] if several else ","


def _has_decimal_commas(cells: Iterable[str]) -> bool:
    """Whether some numbers have a decimal comma, and none a decimal point."""
    found = False
    for cell in cells:
        if "." in cell:
            return False
        found = found or _DECIMAL_COMMA.fullmatch(cell) is not None
    return found
