"""Tables and pictures of sections: the states at crossings, or after every period."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.columns import OF_CONSTRAINTS, is_of_kind
from lagsim.outputs import ENERGIES
from lagsim.outputs.letters import letters_of, raised_powers
from lagsim.outputs.table import table_of
from lagsim.outputs.units import units

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.outputs import Made

# A column whose variation on a section is below these parts of its range in the run,
# and of its largest value, counts as constant there.
FIXED, ROUNDED = 1e-6, 2.0**-40
# Number of rows from which on a straight line through them is no accident.
STRAIGHT_ROWS = 4


class RecordedSections(NamedTuple):
    """Sections of a run.

    Attributes
    ----------
    columns : sequence of str
        Columns of the tables.
    rows : mapping of str to ndarray, shape (k, columns)
        The states on each section, by its name.
    """

    columns: Sequence[str]
    rows: Mapping[str, Floats]


def tables(found: RecordedSections) -> Iterator[Made]:
    """Yield file name and content of the table of each section."""
    for name, rows in found.rows.items():
        yield f"section_{name}.csv", table_of(found.columns, rows.tolist())


def pictures(
    equations: Equations, found: RecordedSections, ranges: Floats, form: str
) -> Iterator[Made]:
    """Yield file name and content of the picture of each section.

    Parameters
    ----------
    equations : Equations
    found : RecordedSections
    ranges : ndarray, shape (2, columns)
        Least and greatest value of each column in the run.
    form : str
        png, svg or pdf.
    """
    from lagsim.outputs.figure import PlottedColumn, crossed, encoded_figure

    names = found.columns
    letters, known = letters_of(equations.model), units(equations, names)
    for section in equations.model.output.sections:
        rows = found.rows[section.name]
        x, y = (
            PlottedColumn(
                letters.name(n),
                raised_powers(known.get(n, "")),
                without_noise(n, names, rows, ranges),
            )
            for n in section.plot or section_columns(names, rows, ranges)
        )
        title = f"{equations.model.name}: {section.name}"
        kind = "periods" if section.at is None else "crossings"
        picture = crossed(title, x, y, kind)
        yield f"section_{section.name}.{form}", encoded_figure(picture, form)


def least_variations(ranges: Floats) -> Floats:
    """Return, for each column, the variation below which it is rounding, (columns,).

    Parameters
    ----------
    ranges : ndarray, shape (2, columns)
        Least and greatest value of each column in the run.
    """
    low, high = ranges
    rounding = ROUNDED * np.maximum(-low, high)
    return np.asarray(np.maximum(FIXED * (high - low), rounding))


def without_noise(
    name: str, names: Sequence[str], rows: Floats, ranges: Floats
) -> Floats:
    """Return the values of a column to draw (k,), without rounding noise.

    A column that varies by less than `least_variations` is drawn as its median.

    Parameters
    ----------
    name : str
        The column.
    names : sequence of str
        Columns of `rows`.
    rows : ndarray, shape (k, columns)
        The states on a section.
    ranges : ndarray, shape (2, columns)
        Least and greatest value of each column in the run.
    """
    k = names.index(name)
    values, least = rows[:, k], least_variations(ranges)[k]
    if not len(values) or np.ptp(values) > least:
        return values
    value = float(np.median(values))
    return np.full(len(values), 0.0 if abs(value) <= least else value)


def _bent(x: Floats, y: Floats) -> float:
    """Return the range of y (k,) about the straight line in x (k,) that fits best."""
    x, y = x - np.mean(x), y - np.mean(y)
    return float(np.ptp(y - x * ((x @ y) / (x @ x))))


def section_columns(names: Sequence[str], rows: Floats, ranges: Floats) -> list[str]:
    """Return the names of the two columns that the picture of a section shows.

    These are the first two columns that vary on the section; if only one varies, time
    comes first. Energies and columns of constraints are not considered. A section such
    as x + y = 1 fixes y by x: the second column is the first one that is not an affine
    function of the first, if there is one. Arguments are as for `without_noise`.
    """
    motion = [
        n for n in names[1:] if n not in ENERGIES and not is_of_kind(n, *OF_CONSTRAINTS)
    ]
    if not len(rows):
        return motion[:2]
    least = least_variations(ranges)
    varies = dict(zip(names, np.ptp(rows, axis=0) > least, strict=True))
    differs = dict(zip(names, np.max(np.abs(rows), axis=0) > least, strict=True))
    found = [n for n in motion if varies[n]]
    if len(found) > 1:
        first, *others = found
        x, *columns = (rows[:, names.index(n)] for n in found)
        bends = dict(zip(others, (_bent(x, y) for y in columns), strict=True))
        free = [
            n
            for n in others
            if len(rows) < STRAIGHT_ROWS or bends[n] > least[names.index(n)]
        ]
        return [first, (free or others)[0]]
    return ["t", *found, *(n for n in motion if differs[n]), *motion][:2]
