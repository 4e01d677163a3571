"""Tables of a file as functions, from points in the file or in a CSV file beside it."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, NamedTuple

from lagsim import files, limits
from lagsim.codes.known import (
    BOTH_GIVEN,
    MISSING_KEY,
    NOT_CONSTANT,
    TABLE_FILE,
    TABLE_POINTS,
    TOO_LARGE,
    UNKNOWN_INTERPOLATION,
)
from lagsim.errors import Place
from lagsim.language import tables
from lagsim.model.loading import STDIN, TEXT
from lagsim.model.model import Table
from lagsim.model.nodes import Broken, Entry, Node, Scalar, Sequence, words_below
from lagsim.model.reader.fields import (
    LISTED,
    TABLE,
    fields,
    items,
    kind_of,
    quoted_list,
)
from lagsim.model.reader.names import NameKind
from lagsim.model.reader.sheets import read_sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lagsim.codes.known import ErrorCode
    from lagsim.language.arrays import Floats
    from lagsim.model.reader.expressions import Expressions
    from lagsim.model.reader.sheets import Sheet

AXES = ("x", "y", "z")


class _Points(NamedTuple):
    """Points of a table: the numbers (n, 2) or (n, 3), and a function for messages.

    `place` returns the place in a file of the number in a given row and column.
    """

    numbers: Floats
    place: Callable[[int, int], Place]


def read_tables(
    given: list[Entry],
    x: Expressions,
    file: str,
    shifts: Mapping[str, tuple[int, float]],
) -> tuple[Table, ...]:
    """Return the tables, and declare them as functions; faults are reported.

    Parameters
    ----------
    given
        Entries of the section `tables`.
    x
        Expressions of the file, to whose names the tables are added.
    file
        Path of the model file.
    shifts
        By name of a table: the number of a point, and the change of the value there as
        a fraction of the range of all values.
    """
    for key, node in given:
        table = _TableReader(key, node, x, file).table(shifts.get(key.text))
        if table is None:
            x.names.faulty.add(key.text)
        else:
            x.names.tables[key.text] = table
    return tuple(x.names.tables.values())


class _TableReader:
    """Reader of one table.

    Parameters
    ----------
    key, node
        The name of the table, and its value in the file.
    x : Expressions
        Expressions of the file.
    file : str
        Path of the model file.
    """

    def __init__(self, key: Scalar, node: Node, x: Expressions, file: str) -> None:
        self.name, self.place, self.x, self.file = key.text, key.place, x, file
        self.label = f"the table `{key.text}`"
        self._faults = len(x.faults)
        self.below = fields(node, self.label, TABLE, x.faults, key.place)
        self.sha256 = ""

    def table(self, shift: tuple[int, float] | None = None) -> Table | None:
        """Return the table, or None where a fault was reported.

        shift : the number of a point and the change of its value, see `read_tables`.
        """
        code: ErrorCode = UNKNOWN_INTERPOLATION
        how = self.below.choice("interpolation", tables.INTERPOLATIONS, code)
        outside = self.below.choice("outside", tables.OUTSIDE, code)
        points = self._points() if self.below.sound else None
        if points is None:
            return None
        if shift is not None:
            point, part = shift
            values = points.numbers[:, -1]
            wide = values.max() - values.min()
            values[point] += part * (wide or abs(values[0]) or 1.0)
        if points.numbers.shape[1] == 2:
            axes, values = self._curve(points, outside)
        else:
            axes, values = self._grid(points, how, outside)
        size = values.size * (2 if how == "linear" else 4) ** len(axes)
        if size > limits.TABLE_NUMBERS:
            text = f"{self.label} has {size:,} coefficients, more than "
            text += f"{limits.TABLE_NUMBERS:,}"
            self._fault(TOO_LARGE, text, self.place, "fewer points, or linear, do")
        if not self._is_sound():
            return None
        made = tables.axes_and_pieces(self.name, axes, values, how, outside)
        path = self.below.text("file")
        return Table(self.name, *made, how, outside, path, self.sha256)

    def _is_sound(self) -> bool:
        """Whether this reader has reported no fault so far."""
        return len(self.x.faults) == self._faults

    def _fault(
        self, code: ErrorCode, text: str, at: Place | Node, hint: str = ""
    ) -> None:
        self.x.faults.add(code, text, at, hint)

    # The points

    def _points(self) -> _Points | None:
        """Return the points in the order of the file; None after a fault."""
        below, own = self.below, "points" in self.below
        if not own and "file" not in below and below.unknown:
            return None
        if not below.either("points", "file", "write points: [[0, 0], [10, 1]]"):
            return None
        for key in AXES if own else ():
            if key in below:
                text = f"`{key}` names a column of a `file`, and there is none"
                self._fault(BOTH_GIVEN, text, below.place_of(key))
        return self._given() if own else self._from_file()

    def _given(self) -> _Points | None:
        node = self.below.value("points")
        rows = items(node, "`points`", self.x.faults)
        if not isinstance(node, Sequence):
            return None
        parts = [row.items if isinstance(row, Sequence) else () for row in rows]
        width = 3 if parts and len(parts[0]) == 3 else 2
        for row, own in zip(rows, parts, strict=True):
            if len(own) != width and not isinstance(row, Broken):
                found = f"a list of {len(own)}" if own else kind_of(row)
                text = f"a point of {self.label} is a list of {width}, found {found}"
                hint = "[x, y] each, or [x, y, z] for a function of two arguments"
                self._fault(TABLE_POINTS, text, row, hint)
                if not own:
                    break  # all items of a flat list are numbers
        fitting = [own for own in parts if len(own) == width]
        numbers = [[self._number(part) for part in own] for own in fitting]
        if len(fitting) < len(parts):
            return None
        return self._counted(numbers, lambda i, j: parts[i][j].place)

    def _number(self, node: Node) -> float:
        """Return the value of a number or an expression of numbers; nan for a fault."""
        if isinstance(node, Scalar):
            value = _float(node.text)
            if math.isfinite(value):
                return value
        x = self.x.over(self.x.faults, {})
        for name in sorted(
            words_below(node).intersection(x.names.of(NameKind.PARAMETER))
        ):
            text = f"points are numbers, and `{name}` is a parameter"
            hint = f"scale the table where it is called: {name}*{self.name}(...)"
            self._fault(NOT_CONSTANT, text, node, hint)
            return math.nan
        found = x.number(node, f"a number of {self.label}")
        return math.nan if found is None else found

    def _counted(
        self, numbers: list[list[float]], place: Callable[[int, int], Place]
    ) -> _Points | None:
        import numpy as np

        if self._is_sound() and len(numbers) < 2:
            text = f"{self.label} has {len(numbers)} point{'s' * (len(numbers) != 1)}"
            self._fault(TABLE_POINTS, text, self.place, "a curve has 2 at least")
        points = _Points(np.array(numbers), place)
        sound = self._is_sound() and not np.isnan(points.numbers).any()
        return points if sound else None

    def _from_file(self) -> _Points | None:
        """Return the points read from columns of a CSV file, or None after a fault."""
        path, below = self.below.text("file"), self.below
        text = self._content(path)
        if text is None:
            return None
        sheet = read_sheet(text)
        header = sheet.header
        keys = [key for key in AXES if key in below]
        if keys not in (["x", "y"], ["x", "y", "z"]):
            text = f"{self.label} has no `{'x' if 'x' not in keys else 'y'}`: which "
            text += "column of the file that is"
            pairs = zip(AXES, header, strict=False)
            hint = "such as " + ", ".join(f"{k}: {h}" for k, h in pairs)
            hint *= bool(header)
            self._fault(MISSING_KEY, text, below.place_of("file"), hint)
            return None
        columns = []
        for key in keys:
            name = below.text(key)
            columns.append(header.index(name) if name in header else -1)
            if header.count(name) != 1:
                many, near = "two columns", ""
                if name not in header:
                    many, near = "no column", self.x.faults.did_you_mean(name, header)
                hint = (
                    near or f"its first line has {quoted_list(header) or 'no columns'}"
                )
                text = f"`{path}` has {many} `{name}`"
                self._fault(TABLE_FILE, text, below.at(key), hint)
        return self._read(sheet, columns, path) if self._is_sound() else None

    def _content(self, path: str) -> str | None:
        """Return the text of a file in the model's folder or below.

        None after a fault.
        """
        place = self.below.at("file")
        parts = PurePath(path)
        fault, hint = "", "the file is in the model's folder, or in one below it"
        content = b""
        if self.file in (STDIN, TEXT):
            fault, hint = "this model has no folder", "give `points`"
        elif parts.is_absolute() or ".." in parts.parts or not path or "\\" in path:
            fault = "the path does not lead into the folder of the model"
        else:
            folder = Path(self.file).parent
            try:
                real = (folder / path).resolve(strict=True)
                if not real.is_relative_to(folder.resolve()):
                    fault = "a link leads out of the model's folder"
                else:
                    content = files.content(real, limits.MODEL_BYTES)
            except (OSError, ValueError, RuntimeError) as error:
                fault = (
                    f"it cannot be read: {getattr(error, 'strerror', None) or error}"
                )
        if not fault:
            self.sha256 = hashlib.sha256(content).hexdigest()
            try:
                return content.decode("utf-8-sig")
            except UnicodeDecodeError as error:
                line = content.count(b"\n", 0, error.start) + 1
                fault, hint = f"line {line} is not UTF-8", "save it as UTF-8"
        self._fault(TABLE_FILE, f"`{path}` of {self.label}: {fault}", place, hint)
        return None

    def _read(self, sheet: Sheet, columns: list[int], path: str) -> _Points | None:
        rows, faults = sheet.rows[1:], 0
        numbers: list[list[float]] = []

        def place(i: int, j: int) -> Place:
            row, name = rows[i], str(Path(self.file).parent / path)
            return Place(name, row.number, *sheet.span(row, columns[j]), row.line)

        for i, row in enumerate(rows):
            cells = row.cells
            found = [
                sheet.number(cells[c]) if c < len(cells) else math.nan for c in columns
            ]
            numbers.append(found)
            text, j = sheet.excess(row), 0
            if not text and not all(map(math.isfinite, found)):
                j = [math.isfinite(x) for x in found].index(False)
                missing = columns[j] >= len(cells)
                label = "nothing" if missing else f"`{cells[columns[j]].strip()}`"
                text = f"a finite number is expected, found {label}"
            if text and faults < LISTED:
                faults += 1
                self._fault(TABLE_POINTS, text, place(i, j))
        return self._counted(numbers, place)

    # The arguments of the points

    def _curve(
        self, points: _Points, outside: str
    ) -> tuple[tuple[Floats, ...], Floats]:
        import numpy as np

        x, y = points.numbers.T
        steps = np.flatnonzero(~(np.diff(x) > 0.0))
        if len(steps):
            i = int(steps[0]) + 1
            more = f", and at {len(steps) - 1} more" if len(steps) > 1 else ""
            text = f"x is {x[i]:.9g} after {x[i - 1]:.9g} here{more}: it must increase"
            self._fault(TABLE_POINTS, text, points.place(i, 0))
        if outside == "repeat" and y[0] != y[-1]:
            text = f"{self.label} repeats, and its last value {y[-1]:.9g} is not the "
            text += f"first, {y[0]:.9g}"
            self._fault(TABLE_POINTS, text, points.place(len(y) - 1, 1))
        return (x,), y

    def _grid(
        self, points: _Points, how: str, outside: str
    ) -> tuple[tuple[Floats, ...], Floats]:
        import numpy as np

        numbers = points.numbers
        code: ErrorCode = TABLE_POINTS
        axes = tuple(np.unique(numbers[:, k]) for k in (0, 1))
        at = tuple(np.searchsorted(a, numbers[:, k]) for k, a in enumerate(axes))
        shape = (len(axes[0]), len(axes[1]))
        many, values = np.zeros(shape), np.zeros(shape)
        np.add.at(many, at, 1.0)
        values[at] = numbers[:, 2]
        place = points.place(0, 0)
        if how == "monotone":
            where = self.below.place_of("interpolation")
            text = "`monotone` is for functions of one argument"
            self._fault(UNKNOWN_INTERPOLATION, text, where, "write linear or cubic")
        elif (again := np.flatnonzero(many[at] > 1.0)).size:
            i = int(again[-1])
            text = (
                f"the point at {numbers[i, 0]:.9g}, {numbers[i, 1]:.9g} is given twice"
            )
            self._fault(code, text, points.place(i, 0))
        elif min(shape) < 2:
            self._fault(code, f"{self.label} has one row of a grid only", place)
        elif not many.all():
            i, j = (int(k[0]) for k in np.nonzero(many == 0.0))
            missing = f"{axes[0][i]:.9g}, {axes[1][j]:.9g}"
            text = f"{self.label} has no point at {missing}: it is no full grid "
            text += f"({shape[0]} times {shape[1]} points)"
            self._fault(code, text, place)
        elif outside == "repeat" and not (
            np.array_equal(values[0], values[-1])
            and np.array_equal(values[:, 0], values[:, -1])
        ):
            text = f"{self.label} repeats, and its last values are not the first"
            self._fault(code, text, place)
        return axes, values


def _float(text: str) -> float:
    """Return the number of a text; nan where it is none."""
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan
