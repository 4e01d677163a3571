"""Thinning of rows for plots: the visible content of 10^8 rows in bounded memory.

Two reductions of the rows are computed during the run. Both are exact while the rows
are few, and independent of the division of the rows into blocks:

- the *envelope* of a column against time: each of at most 4096 buckets stores its
  least and its greatest value with their times, so that a spike of one row is kept
  and an oscillation too fast to be resolved is plotted as a band;
- a *sample* of at most 16384 rows, for curves of one column against another.

When the buckets are full, adjacent buckets are merged, each with twice as many rows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from lagsim.language.columns import FORCE, FRICTION, IMPULSE, MULTIPLIER, is_of_kind
from lagsim.tolerances import OVERFLOW

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Model

    Array: TypeAlias = NDArray[np.float64]

# Name of the series in the plot of the energy drift, if there is a column `work`.
DRIFT = "energy - work"

BUCKETS = 4096
POINTS = 16384

# Overflowing values are gaps in a plot; magnitudes below this number are plotted as 0,
# since their differences underflow in an Axes.
FAINT = 1e-285

# Multiples of the golden section fill the unit interval evenly, without resonance:
# rows at a fixed stride could sample a periodic orbit at a few points only.
_GOLDEN = (5**0.5 - 1) / 2


# Data of each bucket: its least and its greatest value, and their times.
LOW, LOW_T, HIGH, HIGH_T = range(4)


def _with_room(array: Array, axis: int, rows: int) -> Array:
    """Return an array with at least `rows` rows along an axis, doubled if too short.

    The new rows are not initialized.
    """
    shape = list(array.shape)
    if shape[axis] >= rows:
        return array
    shape[axis] = max(rows - shape[axis], shape[axis])
    return np.concatenate((array, np.empty(shape)), axis)


class _Envelope:
    """Least and greatest finite value of `width` columns in buckets of rows.

    An empty bucket has low = inf and high = -inf.
    """

    def __init__(self, width: int) -> None:
        self._stored = np.empty((4, 0, width))
        self._rows = 0
        self.size = 1

    def add(self, t: Array, values: Array) -> None:
        """Update the buckets by k rows.

        t : ndarray, shape (k,), their times.
        values : ndarray, shape (k, width).
        """
        start = 0
        while start < len(t):
            if self._rows == BUCKETS * self.size:
                self._halve()
            bucket, inside = divmod(self._rows, self.size)
            room = min(len(t) - start, BUCKETS * self.size - self._rows)
            # Up to the end of a partial bucket; else whole buckets; else the rest.
            most = self.size - inside
            whole = not inside and room >= most
            stop = start + (room - room % most if whole else min(room, most))
            size = min(most, stop - start)
            found = _extremes(t[start:stop], values[start:stop], size)
            after = bucket + found.shape[1]
            self._stored = _with_room(self._stored, 1, after)
            kept = self._stored[:, bucket:after]
            kept[:] = _merged(kept, found) if inside else found
            self._rows += stop - start
            start = stop

    def _halve(self) -> None:
        kept = self._stored[:, :BUCKETS]
        kept[:, : BUCKETS // 2] = _merged(kept[:, ::2], kept[:, 1::2])
        self.size *= 2

    def points(self, column: int) -> tuple[Array, Array]:
        """Return times and values of a column for a plot: two points per bucket.

        `column` is its index. The points are in order of time; NaN for an empty bucket.
        """
        kept = self._stored[:, : -(-self._rows // self.size), column].copy()
        values, times = kept[[LOW, HIGH]], kept[[LOW_T, HIGH_T]]
        values[:, kept[LOW] > kept[HIGH]] = np.nan
        if self.size == 1:
            return times[0], values[0]
        order = times.argsort(axis=0, kind="stable")
        t, values = (np.take_along_axis(x, order, 0).T for x in (times, values))
        return t.ravel(), values.ravel()


def _merged(first: Array, second: Array) -> Array:
    """Merge buckets (4, n, width) pairwise; `second` follows `first` in time."""
    lower, higher = second[LOW] < first[LOW], second[HIGH] > first[HIGH]
    return np.where(np.stack((lower, lower, higher, higher)), second, first)


def _extremes(t: Array, values: Array, size: int) -> Array:
    """Return low, its time, high, and its time of n whole buckets: (4, n, width).

    t : ndarray, shape (n size,).
    values : ndarray, shape (n size, width).
    size : the number of rows of a bucket.
    """
    # Contiguous along the rows, where argmin and argmax are vectorised.
    buckets = values.reshape(-1, size, values.shape[1])
    v = np.ascontiguousarray(buckets.transpose(0, 2, 1))
    found = []
    for place_of, nothing in ((np.argmin, np.inf), (np.argmax, -np.inf)):
        at = place_of(v, axis=2)
        extreme = _pick(v, at)
        # argmin and argmax return the place of a NaN, so any NaN is detected here.
        if not np.isfinite(extreme).all():
            finite = np.where(np.isfinite(v), v, nothing)
            at = place_of(finite, axis=2)
            extreme = _pick(finite, at)
        found += [extreme, np.take_along_axis(t.reshape(-1, size), at, axis=1)]
    return np.stack(found)


def _pick(v: Array, at: NDArray[np.intp]) -> Array:
    return np.take_along_axis(v, at[:, :, np.newaxis], axis=2)[:, :, 0]


class _Sample:
    """Sample of the rows (k, width): one row from each `stride` consecutive rows."""

    def __init__(self, width: int) -> None:
        self._points = np.empty((0, width))
        self._stored = 0
        self._seen = 0
        self.stride = 1

    def add(self, rows: Array, chosen: NDArray[np.intp]) -> None:
        """Update the sample by k rows, of which only some columns are stored.

        rows : ndarray, shape (k, c).
        chosen : ndarray of int, shape (width,), the indices of the stored columns.
        """
        total = self._seen + len(rows)
        while True:
            stored = min(POINTS, -(-total // self.stride))
            stretch = np.arange(self._stored, stored)
            shift = (stretch * _GOLDEN % 1.0 * self.stride).astype(np.int64)
            index = stretch * self.stride + shift
            index = index[index < total]
            kept = self._stored + len(index)
            self._points = _with_room(self._points, 0, kept)
            self._points[self._stored : kept] = rows[index - self._seen][:, chosen]
            self._stored = kept
            if kept < POINTS:
                break
            self._halve()
        self._seen = total

    def _halve(self) -> None:
        pair = np.arange(POINTS // 2)
        second = pair * _GOLDEN % 1.0 >= 0.5
        self._points[: len(pair)] = self._points[2 * pair + second]
        self._stored = len(pair)
        self.stride *= 2

    def column(self, column: int) -> Array:
        return self._points[: self._stored, column]


class Thinning:
    """Envelopes and samples of the rows of a run, for plots.

    Parameters
    ----------
    columns : names of the columns of the blocks; the first is the time.
    series, paths : names of the columns available from `series` and `path`; by default
        all. Other columns cost neither time nor memory.
    differences : name of an additional series -> the two columns whose difference it
        is, computed in each row, since it does not follow from their envelopes.
    """

    def __init__(
        self,
        columns: Sequence[str],
        *,
        series: Collection[str] | None = None,
        paths: Collection[str] | None = None,
        differences: Mapping[str, tuple[str, str]] | None = None,
    ) -> None:
        self.columns = tuple(columns)
        self.row_count = 0
        self._place = {name: k for k, name in enumerate(self.columns)}
        drawn = [c for c in self.columns if series is None or c in series]
        pairs = differences or {}
        self._series_from = self._places(drawn)
        self._minuend = self._places(a for a, _ in pairs.values())
        self._subtrahend = self._places(b for _, b in pairs.values())
        self._series_at = {name: k for k, name in enumerate([*drawn, *pairs])}
        self._envelope = _Envelope(len(self._series_at))
        followed = [c for c in self.columns if paths is None or c in paths]
        self._paths_from = self._places(followed)
        self._paths_at = {name: k for k, name in enumerate(followed)}
        self._sample = _Sample(len(followed))
        self._first = self._last = np.full(len(self.columns), np.nan)
        self._corners = np.empty((0, 1, len(self.columns)))

    def _places(self, names: Iterable[str]) -> NDArray[np.intp]:
        return np.array([self._place[name] for name in names], dtype=np.intp)

    @property
    def stride(self) -> int:
        """Number of rows for each row of the sample that `path` returns."""
        return self._sample.stride

    def __contains__(self, name: str) -> bool:
        """Whether `name` is a column, or a difference of columns."""
        return name in self._place or name in self._series_at

    def add(self, block: Array) -> None:
        """Process the next rows.

        Parameters
        ----------
        block : (k, c), c the number of columns, rows in order of time. The block is
            copied, so the caller may reuse its memory.
        """
        if not len(block):
            return
        if self.row_count == 0:
            self._first = block[0].copy()
        self._last = block[-1].copy()
        self.row_count += len(block)
        self._envelope.add(block[:, 0], self._series_of(block))
        self._sample.add(block, self._paths_from)

    def meet(self, corners: Array) -> None:
        """Add rows at events to all curves; `row_count` excludes these rows.

        Parameters
        ----------
        corners : (2 k, variants, c), rows just before and just after each of k events,
            see `observers.Corners`.
        """
        if len(corners):
            self._corners = corners[corners[:, -1, 0] <= self._last[0]]

    def _with_corners(
        self, t: Array, values: Array, at_events: Array
    ) -> tuple[Array, Array]:
        """Return a curve with values at events inserted, in order of time.

        t, values : the curve.
        at_events : (2 k, variants), values before and after each of the k events. The
            variant closest to the curve is used.
        """
        times = self._corners[:, -1, 0]
        at = np.searchsorted(t, times, side="right")
        # The row before an event continues the curve before it, the row after an event
        # begins the curve after it.
        beside = at + np.tile((-1, 0), len(at) // 2)
        near = values[np.clip(beside, 0, len(values) - 1)]
        off = np.abs(at_events - near[:, np.newaxis])
        way = off.argmin(axis=1)
        # The variant without offset (the last) is used where offsets have no effect.
        way[off[:, -1] <= 2.0 * off.min(axis=1)] = at_events.shape[1] - 1
        at_events = at_events[np.arange(len(at_events)), way]
        return np.insert(t, at, times), np.insert(values, at, at_events)

    def _series_of(self, rows: Array) -> Array:
        columns = rows[:, self._series_from]
        if not len(self._minuend):
            return columns
        with np.errstate(invalid="ignore", over="ignore"):
            differences = rows[:, self._minuend] - rows[:, self._subtrahend]
        return np.concatenate((columns, differences), axis=1)

    def first(self, name: str) -> float:
        """Return the value of a column in the first row; NaN without rows."""
        return float(_drawable(self._first)[self._place[name]])

    def last(self, name: str) -> float:
        """Return the value of a column in the last row; NaN without rows."""
        return float(_drawable(self._last)[self._place[name]])

    def series(self, name: str) -> tuple[Array, Array]:
        """Return times and values of a column, or of a difference of columns.

        Up to 4096 rows all values are returned; for more rows, the first row, the least
        and the greatest value of each bucket in time order, and the last row. NaN is a
        gap: a bucket without a finite value.

        name : the name of the column, or of a difference.
        """
        column = self._series_at[name]
        t, values = self._envelope.points(column)
        if len(self._corners):
            k, ways, c = self._corners.shape
            at_events = self._series_of(self._corners.reshape(-1, c))[:, column]
            t, values = self._with_corners(t, values, at_events.reshape(k, ways))
        if self._envelope.size > 1:
            first, last = np.split(np.stack((self._first, self._last)), 2)
            t = np.concatenate((first[:, 0], t, last[:, 0]))
            ends = [self._series_of(row)[:, column] for row in (first, last)]
            values = np.concatenate((ends[0], values, ends[1]))
        return _drawable(t), _drawable(values)

    def path(self, x: str, y: str) -> tuple[Array, Array]:
        """Return two columns in the rows of the sample, in order of time.

        Below 16384 rows the sample has all rows; for more rows, one of each `stride`
        rows, and the last row. NaN where a value is not finite.
        """
        return self.sampled(x), self.sampled(y)

    def sampled(self, name: str) -> Array:
        """Return a column in the rows of the sample, as `path` does."""
        kept = self._sample.column(self._paths_at[name])
        if len(self._corners):
            t = self._sample.column(self._paths_at[self.columns[0]])
            at_events = self._corners[:, :, self._place[name]]
            _, kept = self._with_corners(t, kept, at_events)
        if self.stride > 1:
            kept = np.append(kept, self.last(name))
        return _drawable(kept)


def _drawable(values: Array) -> Array:
    """Return a copy for plotting: infinite and huge values are NaN, tiny values 0."""
    sizes = np.abs(values)
    return np.where(sizes < OVERFLOW, np.where(sizes < FAINT, 0.0, values), np.nan)


def picture_thinning(model: Model, columns: Sequence[str]) -> Thinning:
    """Return the thinning of `columns` for the pictures of a model."""
    coordinates = [coordinate.name for coordinate in model.coordinates]
    series = {"kinetic", "potential", "lagrangian", "energy", *coordinates}
    series |= {state.name for state in model.states}
    series |= {FORCE.of(name) for name in coordinates}
    series |= {MULTIPLIER.of(constraint.name) for constraint in model.constraints}
    series |= {
        name
        for name in columns
        if name.startswith("plot:") or is_of_kind(name, FRICTION, IMPULSE)
    }
    paths = {name for name in columns if name.startswith(("point.", "plot:"))}
    shapes = [node for shape in model.scene.shapes for node in shape.nodes]
    paths |= model.graph.depends(shapes) & set(columns)
    paths |= {"t"} if paths or shapes else set()
    balance = {DRIFT: ("energy", "work")} if "work" in columns else {}
    return Thinning(columns, series=series, paths=paths, differences=balance)


# --- Rows for moving pictures: at an even stride, and both rows of each impact
#
# Between two frames the motion is smooth, so positions can be interpolated from the
# positions and rates of the frames; across an impact they cannot. If there are too many
# frames, every other frame is deleted; if there are too many impacts, every other
# impact is deleted, and the interval with a missing impact is marked (`broken`).

# Data of a row besides its columns: its number, the number of impacts up to the row,
# and the number of the impact to whose pair of rows it belongs, or 0.
NUMBER, STRUCK, PAIR = range(3)
OWN = 3


class Frames:
    """Storage of the columns `names` of at most `most` rows, and of the last row.

    Parameters
    ----------
    columns
        Names of the columns of the rows; the first is the time.
    names
        Names of the columns to store.
    most
        Largest number of stored rows.

    Attributes
    ----------
    stride : int
        Number of rows for each stored row.
    """

    def __init__(self, columns: Sequence[str], names: Sequence[str], most: int) -> None:
        place = {name: k for k, name in enumerate(columns)}
        self.names = tuple(names)
        self._chosen = np.array([place[name] for name in names], dtype=np.intp)
        self._most = max(4, most)
        self.stride = self._of_impacts = 1
        self._stored: list[Floats] = []
        self._count = self._rows = self._struck = 0
        self._last = np.empty((0, OWN + len(names)))

    def add(self, rows: Floats) -> None:
        """Store the rows of impacts and one per `stride` among rows (k, columns)."""
        if not len(rows):
            return
        fresh = np.empty((len(rows), OWN + len(self._chosen)))
        fresh[:, OWN:] = rows[:, self._chosen]
        fresh[:, NUMBER] = self._rows + np.arange(len(rows))
        # The previous row is included: it may be the first of two rows of an impact.
        block = np.concatenate((self._last, fresh))
        t = np.append(self._last[:, OWN], rows[:, 0])
        second = np.append(False, t[1:] == t[:-1])
        block[:, STRUCK] = self._struck + np.cumsum(second)
        known = len(self._last)
        block[known:, PAIR] = np.where(second, block[:, STRUCK], 0.0)[known:]
        first = np.append(second[1:], False)
        block[first, PAIR] = block[first, STRUCK] + 1.0
        self._rows += len(rows)
        self._struck = int(block[-1, STRUCK])
        self._last = block[-1:].copy()
        # The last row is processed with the next block, when its successor is known.
        done = block[:-1]
        self._append(done[self._selected(done)])

    def _struck_in(self, block: Floats) -> Flags:
        """Return a mask (k,) of the rows of a block to store because of an impact.

        They are the two rows of each impact, or of some impacts if there are many.
        """
        pair = block[:, PAIR]
        found: Flags = (pair > 0) & (pair % self._of_impacts == 0)
        return found

    def _selected(self, block: Floats) -> Flags:
        even: Flags = block[:, NUMBER] % self.stride == 0
        return even | self._struck_in(block)

    def _append(self, rows: Floats) -> None:
        self._stored.append(rows)
        self._count += len(rows)
        if self._count > 2 * self._most:
            self._thin()

    def _thin(self) -> None:
        """Delete stored rows, by doubled strides, until there are at most `most`."""
        table = np.concatenate(self._stored) if self._stored else self._last[:0]
        while len(table) > self._most:
            if np.count_nonzero(self._struck_in(table)) > self._most // 2:
                self._of_impacts *= 2
            else:
                self.stride *= 2
            table = table[self._selected(table)]
        self._stored, self._count = [table], len(table)

    def _whole(self) -> Floats:
        self._thin()
        return np.concatenate((self._stored[0], self._last))

    @property
    def table(self) -> Floats:
        """Stored rows (k, names), in order of time."""
        return self._whole()[:, OWN:]

    @property
    def broken(self) -> Flags:
        """Mask (k,) of the frames before whose next frame an impact is not stored."""
        whole = self._whole()
        struck, t = whole[:, STRUCK], whole[:, OWN]
        missing = (np.diff(struck) > 0) & (np.diff(t) > 0)
        return np.append(missing, False)
