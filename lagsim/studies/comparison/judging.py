"""How far two tables are apart, column by column, and whether that is too far."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.studies.comparison.matching import match
from lagsim.studies.comparison.scales import scales

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.studies.comparison.matching import Matched
    from lagsim.studies.comparison.reading import Table

# Cells that are compared at once: some 10 MB of working memory.
CELLS = 1 << 18


@dataclass(frozen=True, slots=True)
class Deviation:
    """The worst cell of a column.

    Attributes
    ----------
    tolerance : float
        What it may differ by there.
    ratio : float
        How bad the cell is: the difference over the tolerance, or over the column's
        scale where the tolerance is one unit in the last place; inf for nan.
    first : float or None
        The first time at which the column fails.
    cells : int
        How many of its cells fail.
    """

    column: str
    t: float
    golden: float
    new: float
    difference: float
    tolerance: float
    ratio: float
    first: float | None
    cells: int

    @property
    def passed(self) -> bool:
        """Whether every cell is within its tolerance."""
        return self.cells == 0


@dataclass(frozen=True, slots=True)
class Comparison:
    """What a comparison found.

    Attributes
    ----------
    worst : tuple of Deviation
        One for each column of both tables, the worst first.
    missing, extra : tuple of str
        Columns that only the golden table has, or only the new one.
    rows : Matched
    bound : callable
        (column, golden, new) -> what values (rows,) of the column may differ by.
    """

    worst: tuple[Deviation, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    rows: Matched
    bound: Callable[[str, Floats, Floats], Floats]

    @property
    def passed(self) -> bool:
        """Whether the tables are the same, as far as they have to be."""
        same_times = not len(self.rows.missing) and not len(self.rows.extra)
        return same_times and not self.missing and all(d.passed for d in self.worst)

    @property
    def first(self) -> Deviation | None:
        """The column that fails first in time."""
        failed = [d for d in self.worst if d.first is not None]
        return min(failed, key=lambda d: (d.first, -d.ratio), default=None)


def compare(
    golden: Table, new: Table, rtol: float | None = None, atol: float | None = None
) -> Comparison:
    """Compare two tables: |difference| <= atol + rtol * scale of the column.

    Parameters
    ----------
    rtol
        None forgives one unit in the last place of either value.
    atol
        0 where it is not given. With rtol = atol = 0 values pass that are equal bit by
        bit.
    """
    sizes = scales(golden.columns, golden.data, golden.units)
    absolute = atol or 0.0
    exact = rtol == 0.0 and absolute == 0.0
    bounds = {
        column: absolute + (rtol or 0.0) * size
        for column, size in zip(golden.columns, sizes.tolist(), strict=True)
    }
    rows = match(golden.t, new.t, bounds["t"])
    common = [c for c in golden.columns if c in new.columns]

    def allowed(column: str, g: Floats, n: Floats) -> Floats:
        bound = bounds[column]
        if rtol is None:
            with np.errstate(invalid="ignore", over="ignore"):
                units = np.spacing(np.maximum(np.abs(g), np.abs(n)))
            return np.asarray(bound + units)
        return np.full(len(g), bound)

    known = dict(zip(golden.columns, sizes.tolist(), strict=True))
    found = [
        _deviation(
            c, golden, new, rows, allowed,
            size=known[c] if rtol is None else None, exact=exact,
        )
        for c in common
    ]  # fmt: skip
    return Comparison(
        worst=ordered(found),
        missing=tuple(c for c in golden.columns if c not in new.columns),
        extra=tuple(c for c in new.columns if c not in golden.columns),
        rows=rows,
        bound=allowed,
    )


def ordered(found: Iterable[Deviation]) -> tuple[Deviation, ...]:
    """Give the worst first, those that pass last."""
    return tuple(sorted(found, key=lambda d: (d.passed, -d.ratio)))


def _deviation(
    column: str,
    golden: Table,
    new: Table,
    rows: Matched,
    allowed: Callable[[str, Floats, Floats], Floats],
    *,
    size: float | None,
    exact: bool,
) -> Deviation:
    t, g, n = golden.t, golden[column], new[column]
    aligned = rows.golden is rows.new
    parts = []
    for k in range(0, len(rows.golden), CELLS):
        mine = slice(k, k + CELLS) if aligned else rows.golden[k : k + CELLS]
        theirs = slice(k, k + CELLS) if aligned else rows.new[k : k + CELLS]
        old, now = g[mine], n[theirs]
        bound = allowed(column, old, now)
        parts.append(
            deviations(column, t[mine], old, now, bound, size=size, exact=exact)
        )
    return (
        _joined(parts)
        if parts
        else Deviation(column, math.nan, math.nan, math.nan, 0.0, 0.0, 0.0, None, 0)
    )


def deviations(
    column: str,
    t: Floats,
    golden: Floats,
    new: Floats,
    bound: Floats,
    *,
    size: float | None = None,
    exact: bool = False,
) -> Deviation:
    """Compare the values of a column (rows,), which are some.

    Parameters
    ----------
    bound : ndarray, shape (rows,)
        What each may differ by.
    size
        The worst is the largest difference, against this, and not against the bound.
    exact
        Tell 0 from -0.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        difference = np.abs(new - golden)
        difference[golden == new] = 0.0  # inf, too
        wrong = ~(difference <= bound)
        if exact:
            wrong |= np.signbit(golden) != np.signbit(new)
        ratio = difference / (bound if size is None else size)
    ratio[difference == 0.0] = 0.0
    ratio[np.isnan(ratio)] = math.inf
    if wrong.any():
        ratio[~wrong] = -1.0
    k = int(np.argmax(ratio))
    failed = np.flatnonzero(wrong)
    return Deviation(
        column, float(t[k]), float(golden[k]), float(new[k]), float(difference[k]),
        float(bound[k]), float(ratio[k]),
        float(t[failed[0]]) if len(failed) else None, len(failed),
    )  # fmt: skip


def _joined(parts: Sequence[Deviation]) -> Deviation:
    """Give the worst of several stretches of a column."""
    worst = ordered(parts)[0]
    times = [d.first for d in parts if d.first is not None]
    return replace(
        worst, first=min(times, default=None), cells=sum(d.cells for d in parts)
    )
