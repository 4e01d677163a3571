"""Two runs of one motion: matched rows, scales of columns, deviations, verdict.

Rows belong together that have the same time; at an impact two rows share a time, and go
together in their order, before and after. Where velocities jump, or forces, two runs
are apart by the whole jump from the one's time to the other's, however close these are:
that is no error of what jumps, but of when, and the positions know it.

The scale of a column is its range, but no less than a nominal size of its kind: what is
constant, or should be zero, has no range but its rounding errors. The kinds are told by
the names of the columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lagsim.language.names import rate_of, rated
from lagsim.outputs import ENERGIES
from lagsim.run.observers.monitors import numbers
from lagsim.tolerances import COMPUTED_ZERO, SAME_ROW

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from lagsim.errors import Place
    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Settings
    from lagsim.notes import Event
    from lagsim.studies.tables import Table

IMPACT = "impact"


def moved(events: Iterable[Event], others: Iterable[Event]) -> Floats:
    """Return the times (k, 2) of events that both runs have.

    The same is of one kind, to one constraint, and nearest either way: what only one
    run contains has no partner.
    """
    mine, theirs = _by_what(events), _by_what(others)
    pairs = [
        partners(times, theirs[what]) for what, times in mine.items() if what in theirs
    ]
    return np.concatenate(pairs) if pairs else np.empty((0, 2))


def within(t: Floats, pairs: Floats) -> Flags:
    """Tell which times lie between the two of a pair (k, 2)."""
    found = np.zeros(len(t), bool)
    for pair in pairs:
        found |= (np.min(pair) <= t) & (t <= np.max(pair))
    return found


def on_grid(rows: Floats, settings: Settings) -> Floats:
    """Give the rows at output times, and the last: one each, that after an impact."""
    places = numbers(rows[:, 0], settings.start, settings.output_step)
    kept = (places >= 0) & np.append(places[1:] != places[:-1], [True])
    kept[-1:] = True
    return np.asarray(rows[kept])


def _by_what(events: Iterable[Event]) -> dict[tuple[str | None, ...], Floats]:
    found: dict[tuple[str | None, ...], list[float]] = {}
    for e in events:
        found.setdefault((e.kind, e.constraint, e.switch, e.name), []).append(e.time)
    return {what: np.unique(times) for what, times in found.items()}


def partners(mine: Floats, theirs: Floats) -> Floats:
    """Return the mutually nearest times (k, 2) of two runs."""
    if not (len(mine) and len(theirs)):
        return np.empty((0, 2))
    there, back = nearest(mine, theirs), nearest(theirs, mine)
    mutual = back[there] == np.arange(len(mine))
    return np.column_stack([mine[mutual], theirs[there[mutual]]])


def nearest(times: Floats, among: Floats) -> Floats:
    """Return the index of the nearest for each time (k,)."""
    middles = (among[1:] + among[:-1]) / 2.0
    return np.asarray(np.searchsorted(middles, times))


# A column counts as no narrower than this part of the widest of its kind and unit, so
# that a coordinate that should stay zero is not measured by its noise.
SHARE = 1e-3


def kind(column: str, columns: Collection[str]) -> str:
    """Return the kind of a column, by its name."""
    for prefix in ("lambda_", "Qc_", "residual_"):
        if column.startswith(prefix):
            return prefix[:-1]
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
    """Return the ranges; the size where a range is less than this part of it."""
    return np.where(ranges > least * sizes, ranges, sizes)


def scales(
    columns: Sequence[str], data: Floats, units: Mapping[str, str] | None = None
) -> Floats:
    """Give the scale of each column (columns,).

    - positions, velocities, accelerations, definitions, multipliers and constraint
      forces: the range, or the size where they do not vary; no less than SHARE of the
      widest of the kind (and unit, where units are known);
    - energies and work: the range, or that of the kinetic energy;
    - residuals: the largest coordinate, since they are to be compared with zero.

    Parameters
    ----------
    data : ndarray, shape (columns, rows)
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
            alike = [i for i, other in enumerate(groups) if other == group]
            found[k] = max(found[k], SHARE * np.max(wide[alike]))
    moves = [x for x in ("kinetic", "lagrangian") if x in columns]
    moving = float(wide[columns.index(moves[0])]) if moves else 0.0
    largest = max(
        (size[k] for k, what in enumerate(kinds) if what == "position"), default=0.0
    )
    for k, what in enumerate(kinds):
        if what == "energy":
            found[k] = max(ranges[k], moving) or wide[k]
        elif what == "residual":
            found[k] = max(ranges[k], largest)
    return found


def _extremes(data: Floats) -> tuple[Floats, Floats]:
    """Give the least and the greatest finite value of each column; 0 without any."""
    low, high = np.zeros(len(data)), np.zeros(len(data))
    for k, values in enumerate(data):
        finite = values if np.isfinite(values).all() else values[np.isfinite(values)]
        if len(finite):
            low[k], high[k] = finite.min(), finite.max()
    return low, high


Ints: TypeAlias = NDArray[np.intp]

# All rows of both, as they are.
ALL = slice(None), slice(None)


class Matched(NamedTuple):
    """Numbers of rows that belong together, and times that have no partner.

    Attributes
    ----------
    golden, new : ndarray of int, shape (k,)
    missing, extra : ndarray
        Times of one table alone.
    """

    golden: Ints
    new: Ints
    missing: Floats
    extra: Floats


def match(golden: Floats, new: Floats, tolerance: float = 0.0) -> Matched:
    """Match rows by their times.

    Parameters
    ----------
    golden, new : ndarray
        The times.
    tolerance
        Between times that are the same, if more than SAME_ROW of the spacing.
    """
    near = max(SAME_ROW * _spacing(golden), min(tolerance, 0.25 * _spacing(golden)))
    if len(golden) == len(new) and bool(np.all(np.abs(golden - new) <= near)):
        every = np.arange(len(golden))
        return Matched(every, every, golden[:0], new[:0])
    mine, theirs = (np.argsort(t, kind="stable") for t in (golden, new))
    g, n = golden[mine], new[theirs]
    wanted = np.searchsorted(n, g - near) + _turns(g, near)
    there = np.minimum(wanted, len(n) - 1)
    same = (wanted < len(n)) & (np.abs(n[there] - g) <= near)
    alone = np.ones(len(n), bool)
    alone[there[same]] = False
    return Matched(mine[same], theirs[there[same]], g[~same], n[alone])


def _spacing(t: Floats) -> float:
    steps = np.diff(t)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else 0.0


def _turns(t: Floats, near: float) -> Ints:
    """Return for each row the number of rows before it at its time."""
    turns = np.zeros(len(t), dtype=np.intp)
    for k in np.flatnonzero(np.diff(t) <= near) + 1:  # few: only impacts
        turns[k] = turns[k - 1] + 1
    return turns


class Deviation(NamedTuple):
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


class Pair(NamedTuple):
    """The values of a column in two runs, and what they may differ by: (rows,) each."""

    t: Floats
    golden: Floats
    new: Floats
    bound: Floats

    def deviation(
        self, column: str, size: float | None = None, *, exact: bool = False
    ) -> Deviation:
        """Give the worst cell.

        Parameters
        ----------
        size
            The worst is the largest difference, against this, and not against the
            bound.
        exact
            Tell 0 from -0.
        """
        t, golden, new, bound = self
        if not len(t):
            nan = math.nan
            return Deviation(column, nan, nan, nan, 0.0, 0.0, 0.0, None, 0)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            difference = np.abs(new - golden)
            difference[golden == new] = 0.0  # inf, too
            wrong = ~(difference <= bound)
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
    """Whether a run is the same as a golden one, as far as it has to be.

    Attributes
    ----------
    worst : tuple of Deviation
        One for each column of both (and each invariant), the worst first.
    missing, extra : tuple of str
        Columns that only the golden has, or only the new run.
    faults : tuple of str
        What else they differ in.
    of : callable
        Gives what was compared of a column.
    rows : Matched, optional
        Of two tables: which of their rows belong together.
    notes : tuple of str
        What has changed, and is no failure.
    changed : tuple of str
        Parameters and start values that are no longer those of the golden.
    place : Place, optional
        The line of the file that made the difference, as far as it is known.
    """

    worst: tuple[Deviation, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    faults: tuple[str, ...]
    of: Callable[[str], Pair]
    rows: Matched | None = None
    notes: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    place: Place | None = None

    @property
    def failed(self) -> list[Deviation]:
        """The columns that differ, the worst first."""
        return [d for d in self.worst if not d.passed]

    @property
    def passed(self) -> bool:
        """Whether it is the same."""
        return not (self.missing or self.faults or self.failed)

    @property
    def first(self) -> Deviation | None:
        """The column that fails first in time."""
        failed = [d for d in self.worst if d.first is not None]
        return min(failed, key=lambda d: (d.first, -d.ratio), default=None)


def ordered(found: Iterable[Deviation]) -> tuple[Deviation, ...]:
    """Give the worst first, those that pass last."""
    return tuple(sorted(found, key=lambda d: (d.passed, -d.ratio)))


def compare(
    golden: Table, new: Table, rtol: float | None = None, atol: float | None = None
) -> Verdict:
    """Compare two tables: |difference| <= atol + rtol * scale of the column.

    Parameters
    ----------
    rtol
        None forgives one unit in the last place of either value.
    atol
        0 where it is not given. With rtol = atol = 0 values pass that are equal bit by
        bit.
    """
    known = scales(golden.columns, golden.data, golden.units).tolist()
    sizes = dict(zip(golden.columns, known, strict=True))
    absolute = atol or 0.0
    bounds = {column: absolute + (rtol or 0.0) * size for column, size in sizes.items()}
    rows = match(golden.t, new.t, bounds["t"])
    mine, theirs = (rows.golden, rows.new) if rows.golden is not rows.new else ALL

    def of(column: str) -> Pair:
        g, n = golden[column][mine], new[column][theirs]
        bound = np.full(len(g), bounds[column])
        if rtol is None:
            with np.errstate(invalid="ignore", over="ignore"):
                bound += np.spacing(np.maximum(np.abs(g), np.abs(n)))
        return Pair(golden.t[mine], g, n, bound)

    exact = rtol == 0.0 and absolute == 0.0
    return Verdict(
        worst=ordered(
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
