"""Tables and pictures of sections: the states at crossings, and every period."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.outputs import ENERGIES
from lagsim.outputs.letters import letters_of, raised
from lagsim.outputs.table import table_of
from lagsim.outputs.units import units

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.outputs import Made

# Of the range of a column in the run, and of its largest value: a column that varies by
# less on a section is fixed there.
FIXED, ROUNDED = 1e-6, 2.0**-40
# Columns of constraints.
BESIDE = ("residual_", "lambda_", "Qc_")


class Found(NamedTuple):
    """Sections of a run.

    Attributes
    ----------
    columns : sequence of str
        Those of the table.
    rows : mapping of str to ndarray, shape (k, columns)
        By the name of the section.
    """

    columns: Sequence[str]
    rows: Mapping[str, Floats]


def tables(found: Found) -> Iterator[Made]:
    """Give name and content of the table of each section."""
    for name, rows in found.rows.items():
        yield f"section_{name}.csv", table_of(found.columns, rows.tolist())


def pictures(
    equations: Equations, found: Found, ranges: Floats, form: str
) -> Iterator[Made]:
    """Give name and content of the picture of each section.

    ranges : (2, columns), the least and the greatest value of each column in the run.
    """
    from lagsim.outputs.figure import Column, content, crossed

    names = found.columns
    letters, known = letters_of(equations.model), units(equations, names)
    for section in equations.model.output.sections:
        rows = found.rows[section.name]
        x, y = (
            Column(
                letters.name(n), raised(known.get(n, "")), drawn(n, names, rows, ranges)
            )
            for n in section.plot or shown(names, rows, ranges)
        )
        title = f"{equations.model.name}: {section.name}"
        kind = "periods" if section.at is None else "crossings"
        picture = crossed(title, x, y, kind)
        yield f"section_{section.name}.{form}", content(picture, form)


def least_variations(ranges: Floats) -> Floats:
    """Return how much each column varies at least, if it is not fixed (columns,)."""
    low, high = ranges
    rounding = ROUNDED * np.maximum(-low, high)
    return np.asarray(np.maximum(FIXED * (high - low), rounding))


def drawn(name: str, names: Sequence[str], rows: Floats, ranges: Floats) -> Floats:
    """Return the values of a column as they are drawn: one, where it is fixed."""
    k = names.index(name)
    values, least = rows[:, k], least_variations(ranges)[k]
    if not len(values) or np.ptp(values) > least:
        return values
    value = float(np.median(values))
    return np.full(len(values), 0.0 if abs(value) <= least else value)


def shown(names: Sequence[str], rows: Floats, ranges: Floats) -> list[str]:
    """Return the two columns that the picture of a section shows.

    They are the first two that vary on it, against the time if there are fewer.
    Energies and what belongs to constraints do not count.
    """
    motion = [n for n in names[1:] if n not in ENERGIES and not n.startswith(BESIDE)]
    if not len(rows):
        return motion[:2]
    least = least_variations(ranges)
    varies = dict(zip(names, np.ptp(rows, axis=0) > least, strict=True))
    differs = dict(zip(names, np.max(np.abs(rows), axis=0) > least, strict=True))
    found = [n for n in motion if varies[n]]
    if len(found) > 1:
        return found[:2]
    return ["t", *found, *(n for n in motion if differs[n]), *motion][:2]
