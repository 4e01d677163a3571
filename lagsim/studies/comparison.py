"""Comparison of two runs: matched rows, scales of columns, deviations, verdict.

Rows with equal times are matched. The two rows of an impact have one time, and are
matched in their order, before and after. Where velocities or forces jump, the two runs
differ by the whole jump between the two times of the jump, however close these are.
This difference is an error of the time of the event, which positions show as well.

The scale of a column is its range, but at least a nominal size of its kind, since the
range of a column that is constant or should be zero consists of rounding errors. The
kind of a column follows from its name.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lagsim.language.columns import (
    DEVIATION,
    OF_CONSTRAINTS,
    SENSITIVITY,
    is_of_kind,
    parsed,
)
from lagsim.language.names import rate_of, rated
from lagsim.outputs import ENERGIES
from lagsim.run.observers.monitors import grid_numbers
from lagsim.tolerances import COMPUTED_ZERO, SAME_ROW

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from lagsim.errors import Place
    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Settings
    from lagsim.notes import Event
    from lagsim.studies.tables import StoredTable

IMPACT = "impact"


def paired_times(events: Iterable[Event], others: Iterable[Event]) -> Floats:
    """Return the times of events that both runs contain, shape (k, 2).

    Column 0 has the times in the first run, column 1 in the second. Two events match if
    kind, constraint, switch and name are equal and their times are mutually nearest. An
    event that only one run contains is left out.

    events, others : the events of the first run, and of the second run.
    """
    first, second = _times_by_kind(events), _times_by_kind(others)
    pairs = [
        mutually_nearest(times, second[key])
        for key, times in first.items()
        if key in second
    ]
    return np.concatenate(pairs) if pairs else np.empty((0, 2))


def within(t: Floats, pairs: Floats) -> Flags:
    """Return a mask (rows,) of the times t (rows,) in an interval of `pairs` (k, 2).

    Examples
    --------
    >>> within(np.array([0.0, 1.0, 2.0]), np.array([[1.5, 0.5]]))
    array([False,  True, False])
    """
    low, high = np.sort(np.min(pairs, axis=1)), np.sort(np.max(pairs, axis=1))
    first = np.searchsorted(low, t, side="right")
    return np.asarray(first > np.searchsorted(high, t))


def on_grid(rows: Floats, settings: Settings) -> Floats:
    """Return the rows of a run at output times, one for each, and the last row.

    At the time of an impact the row is that after the impact.

    rows : (k, columns), the first column is the time.
    """
    places = grid_numbers(rows[:, 0], settings.start, settings.output_step)
    kept = (places >= 0) & np.append(places[1:] != places[:-1], [True])
    kept[-1:] = True
    return np.asarray(rows[kept])


def _times_by_kind(events: Iterable[Event]) -> dict[tuple[str | None, ...], Floats]:
    found: dict[tuple[str | None, ...], list[float]] = {}
    for e in events:
        found.setdefault((e.kind, e.constraint, e.switch, e.name), []).append(e.time)
    return {key: np.unique(times) for key, times in found.items()}


def mutually_nearest(first: Floats, second: Floats) -> Floats:
    """Return the pairs of mutually nearest times of two runs, shape (k, 2).

    first, second : the times of each run, ascending; the columns 0 and 1 of the result.

    Examples
    --------
    >>> mutually_nearest(np.array([1.0, 2.0]), np.array([1.1, 5.0]))
    array([[1. , 1.1]])
    """
    if not (len(first) and len(second)):
        return np.empty((0, 2))
    there, back = nearest_times(first, second), nearest_times(second, first)
    mutual = back[there] == np.arange(len(first))
    return np.column_stack([first[mutual], second[there[mutual]]])


def nearest_times(times: Floats, among: Floats) -> Floats:
    """Return, for each time, the index of the nearest time in `among`, shape (k,).

    times : (k,).
    among : (l,), ascending.
    """
    middles = (among[1:] + among[:-1]) / 2.0
    return np.asarray(np.searchsorted(middles, times))


# The least scale of a column relative to the widest column of its kind and unit, so
# that the scale of a coordinate that should stay zero is not its rounding error.
SHARE = 1e-3


def kind(column: str, columns: Collection[str]) -> str:
    """Return the kind of a column, by its name.

    Examples
    --------
    >>> columns = ["t", "x", "x_dot", "x_ddot", "lambda_rod", "energy", "height"]
    >>> [kind(column, columns) for column in columns[2:]]
    ['velocity', 'acceleration', 'lambda', 'energy', 'definition']
    """
    if is_of_kind(column, *OF_CONSTRAINTS) and (found := parsed(column)):
        return found[0].prefix.rstrip("_")
    if column in ENERGIES:
        return "energy"
    if column == "t":
        return "t"
    for stem, order in (rated(column), (column, 0)):
        if all(rate_of(stem, k) in columns for k in range(3)):
            return ("position", "velocity", "acceleration")[order]
    return "definition"


def range_or_size(
    ranges: Floats, sizes: Floats | float, least: float = COMPUTED_ZERO
) -> Floats:
    """Return the range of each column or, if negligible, the size of its values.

    A range is negligible below `least` times the size. The arrays `ranges`
    and `sizes` have one entry for each column.
    """
    return np.where(ranges > least * sizes, ranges, sizes)


def scales(
    columns: Sequence[str], data: Floats, units: Mapping[str, str] | None = None
) -> Floats:
    """Return the scale of each column, shape (columns,), in the unit of the column.

    - positions, velocities, accelerations, definitions, multipliers and constraint
      forces: the range, or the largest absolute value of a constant column; at least
      SHARE times the widest range of the kind (and unit, if units are known);
    - energies and work: the range, or that of the kinetic energy if larger;
    - residuals: the range, or the largest absolute value of a coordinate if larger.

    Parameters
    ----------
    columns : sequence of str
        Names of the columns.
    data : ndarray, shape (columns, rows)
    units : mapping, optional
        Unit of each column.

    Examples
    --------
    >>> columns = ["t", "x", "x_dot", "x_ddot"]
    >>> data = np.array([[0, 1, 2], [1, 3, 1], [0, 0, 0], [2, 2, 2]], dtype=float)
    >>> scales(columns, data)
    array([2., 2., 0., 2.])
    """
    low, high = _extremes(data)
    size = np.maximum(np.abs(low), np.abs(high))
    ranges = high - low
    wide = range_or_size(ranges, size)
    present = frozenset(columns)
    kinds = [kind(column, present) for column in columns]
    groups = [
        (k, (units or {}).get(c, "")) for k, c in zip(kinds, columns, strict=True)
    ]
    found = wide.copy()
    for k, group in enumerate(groups):
        if kinds[k] not in ("t", "definition") or group[1]:
            same_unit = [i for i, other in enumerate(groups) if other == group]
            found[k] = max(found[k], SHARE * np.max(wide[same_unit]))
    moves = [x for x in ("kinetic", "lagrangian") if x in columns]
    moving = float(wide[columns.index(moves[0])]) if moves else 0.0
    largest = max(
        (size[k] for k, of_column in enumerate(kinds) if of_column == "position"),
        default=0.0,
    )
    for k, of_column in enumerate(kinds):
        if of_column == "energy":
            found[k] = max(ranges[k], moving) or wide[k]
        elif of_column == "residual":
            found[k] = max(ranges[k], largest)
    return found


def _extremes(data: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest finite value of each column.

    Both are 0 for a column without a finite value.

    data : (columns, rows).
    """
    low, high = np.zeros(len(data)), np.zeros(len(data))
    for k, values in enumerate(data):
        finite = values if np.isfinite(values).all() else values[np.isfinite(values)]
        if len(finite):
            low[k], high[k] = finite.min(), finite.max()
    return low, high


Ints: TypeAlias = NDArray[np.intp]

# All rows of both tables.
ALL = slice(None), slice(None)


class Matched(NamedTuple):
    """Indices of matched rows, and times without a match.

    Attributes
    ----------
    golden, new : ndarray of int, shape (k,)
        Indices of the matched rows in both tables.
    missing, extra : ndarray
        Times that only the golden table has, and that only the new one has.
    """

    golden: Ints
    new: Ints
    missing: Floats
    extra: Floats


def match(golden: Floats, new: Floats, tolerance: float = 0.0) -> Matched:
    """Match rows of two tables by their times.

    Parameters
    ----------
    golden, new : ndarray, shapes (k,) and (l,)
        The times of the rows.
    tolerance : float
        The largest difference of equal times, if more than SAME_ROW of the spacing; at
        most a quarter of the spacing is used.

    Examples
    --------
    >>> found = match(np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 3.0]))
    >>> found.golden, found.new, found.missing, found.extra
    (array([0, 2]), array([0, 1]), array([1.]), array([3.]))
    """
    near = max(SAME_ROW * _spacing(golden), min(tolerance, 0.25 * _spacing(golden)))
    if len(golden) == len(new) and bool(np.all(np.abs(golden - new) <= near)):
        every = np.arange(len(golden))
        return Matched(every, every, golden[:0], new[:0])
    first, second = (np.argsort(t, kind="stable") for t in (golden, new))
    g, n = golden[first], new[second]
    expected = np.searchsorted(n, g - near) + _turns(g, near)
    there = np.minimum(expected, len(n) - 1)
    same = (expected < len(n)) & (np.abs(n[there] - g) <= near)
    alone = np.ones(len(n), bool)
    alone[there[same]] = False
    return Matched(first[same], second[there[same]], g[~same], n[alone])


def _spacing(t: Floats) -> float:
    steps = np.diff(t)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 0.0


def _turns(t: Floats, near: float) -> Ints:
    """Return the position of each row among the rows with its time, from 0; shape (k,).

    t : (k,), ascending.
    near : the largest difference of equal times.
    """
    turns = np.zeros(len(t), dtype=np.intp)
    for k in np.flatnonzero(np.diff(t) <= near) + 1:  # few: only impacts
        turns[k] = turns[k - 1] + 1
    return turns


class Deviation(NamedTuple):
    """Largest deviation of a column between two runs.

    Attributes
    ----------
    column : str
    t : float
        The time of the cell with the largest ratio.
    golden, new, difference : float
        The values of both runs in this cell, and their absolute difference.
    tolerance : float
        The tolerance of this cell.
    ratio : float
        The difference relative to the tolerance, or relative to the scale of the column
        if the tolerance is one unit in the last place; inf if a value is nan.
    first : float or None
        The first time at which the column fails.
    cells : int
        The number of cells that fail.
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


class ComparedColumn(NamedTuple):
    """Column in two runs: in each row the time, both values, and their bound, (rows,).

    The values are `golden` (first run) and `new` (second run).
    """

    t: Floats
    golden: Floats
    new: Floats
    bound: Floats

    def deviation(
        self, column: str, size: float | None = None, *, exact: bool = False
    ) -> Deviation:
        """Return the deviation of the column, at the cell with the largest ratio.

        Parameters
        ----------
        column : str
            The name of the column.
        size : float, optional
            The denominator of the ratio, by default the bound of the cell.
        exact : bool
            Whether 0 and -0 differ.
        """
        t, golden, new, bound = self
        if not len(t):
            nan = math.nan
            return Deviation(column, nan, nan, nan, 0.0, 0.0, 0.0, None, 0)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            difference = np.abs(new - golden)
            # A derivative that does not exist is an empty cell of both.
            gaps = np.isnan(golden) & np.isnan(new)
            gaps &= is_of_kind(column, SENSITIVITY, DEVIATION)
            difference[(golden == new) | gaps] = 0.0  # inf, too
            wrong = ~(difference <= bound) & ~gaps
            if exact:
                wrong |= np.signbit(golden) != np.signbit(new)
            ratio = difference / (bound if size is None else size)
        ratio[difference == 0.0] = 0.0
        ratio[np.isnan(ratio)] = math.inf
        failed = np.flatnonzero(wrong)
        if len(failed):
            ratio[~wrong] = -1.0
        k = int(np.argmax(ratio))
        return Deviation(
            column, float(t[k]), float(golden[k]), float(new[k]), float(difference[k]),
            float(bound[k]), float(ratio[k]),
            float(t[failed[0]]) if len(failed) else None, len(failed),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Result of the comparison of a run with a golden run.

    Attributes
    ----------
    worst : tuple of Deviation
        The largest deviation of each common column (and each invariant), by falling
        ratio.
    missing, extra : tuple of str
        Columns that only the golden has, and that only the new run has.
    faults : tuple of str
        Other differences that make the comparison fail.
    of : callable
        Maps the name of a column to its `ComparedColumn`.
    rows : Matched, optional
        The matched rows of two tables.
    notes : tuple of str
        Changes that are no failure.
    changed : tuple of str
        Parameters and start values that differ from the golden.
    place : Place, optional
        The line of the file that caused the difference, if known.
    """

    worst: tuple[Deviation, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    faults: tuple[str, ...]
    of: Callable[[str], ComparedColumn]
    rows: Matched | None = None
    notes: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    place: Place | None = None

    @property
    def failed(self) -> list[Deviation]:
        """The deviations of columns that fail, by falling ratio."""
        return [d for d in self.worst if not d.passed]

    @property
    def passed(self) -> bool:
        """Whether the run agrees with the golden."""
        return not (self.missing or self.faults or self.failed)

    @property
    def first(self) -> Deviation | None:
        """The deviation of the column that fails first in time; None if none fails."""
        failed = [d for d in self.worst if d.first is not None]
        return min(failed, key=lambda d: (d.first, -d.ratio), default=None)


def sorted_deviations(found: Iterable[Deviation]) -> tuple[Deviation, ...]:
    """Sort deviations: failures first, each part by falling ratio."""
    return tuple(sorted(found, key=lambda d: (d.passed, -d.ratio)))


def compare(
    golden: StoredTable,
    new: StoredTable,
    rtol: float | None = None,
    atol: float | None = None,
) -> Verdict:
    """Compare two tables: |difference| <= atol + rtol * scale of the column.

    Parameters
    ----------
    golden, new : StoredTable
    rtol : float, optional
        None allows a difference of one unit in the last place of the larger value.
    atol : float, optional
        0 by default. With rtol = atol = 0 only bitwise equal values pass.
    """
    known = scales(golden.columns, golden.data, golden.units).tolist()
    sizes = dict(zip(golden.columns, known, strict=True))
    absolute = atol or 0.0
    bounds = {column: absolute + (rtol or 0.0) * size for column, size in sizes.items()}
    rows = match(golden.t, new.t, bounds["t"])
    first, second = (rows.golden, rows.new) if rows.golden is not rows.new else ALL

    def of(column: str) -> ComparedColumn:
        g, n = golden[column][first], new[column][second]
        bound = np.full(len(g), bounds[column])
        if rtol is None:
            with np.errstate(invalid="ignore", over="ignore"):
                bound += np.spacing(np.maximum(np.abs(g), np.abs(n)))
        return ComparedColumn(golden.t[first], g, n, bound)

    exact = rtol == 0.0 and absolute == 0.0
    return Verdict(
        worst=sorted_deviations(
            of(c).deviation(c, sizes[c] if rtol is None else None, exact=exact)
            for c in golden.columns
            if c in new.columns
        ),
        missing=tuple(c for c in golden.columns if c not in new.columns),
        extra=tuple(c for c in new.columns if c not in golden.columns),
        faults=tuple(
            f"only {which} has {len(t)} row{'s' * (len(t) > 1)}, the first at t = "
            f"{float(t[0])!r}"
            for which, t in (("golden", rows.missing), ("new", rows.extra))
            if len(t)
        ),
        of=of,
        rows=rows,
    )
