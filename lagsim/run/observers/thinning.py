"""Rows thinned for pictures: what a plot can show of 10^8 rows, in bounded memory.

Two views of the rows are kept while they pass, both exact as long as the rows are
few, both a function of the rows alone (not of how they were cut into blocks):

- the *envelope* of a column against time: each of at most 4096 buckets keeps its
  least and its greatest value with their times, so that a spike of one row survives
  and an oscillation too fast to see becomes the band that it fills;
- *true rows* for curves of one column against another, at most 16384 of them.

When the buckets are full, neighbours are merged and each holds twice as many rows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from lagsim.tolerances import OVERFLOW

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from lagsim.language.arrays import Flags, Floats
    from lagsim.model.model import Model

    Array: TypeAlias = NDArray[np.float64]

# The series whose drift the energy picture shows, where there is a column `work`.
DRIFT = "energy - work"

BUCKETS = 4096
POINTS = 16384

# What overflows is a gap in a picture; what is smaller than this is 0 there, since its
# differences leave the range of an Axes.
FAINT = 1e-285

# Multiples of the golden section fill the unit interval evenly and resonate with
# nothing: rows at a fixed stride would turn a periodic orbit into a few dots.
_GOLDEN = (5**0.5 - 1) / 2


# What is kept of each bucket: its least and its greatest value, and their times.
LOW, LOW_T, HIGH, HIGH_T = range(4)


def _with_room(array: Array, axis: int, rows: int) -> Array:
    """Return an array that has so many rows along an axis, or more: twice as many."""
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
        self._kept = np.empty((4, 0, width))
        self._rows = 0
        self.size = 1

    def add(self, t: Array, values: Array) -> None:
        """Take the rows t : (k,) and values : (k, width)."""
        start = 0
        while start < len(t):
            if self._rows == BUCKETS * self.size:
                self._halve()
            bucket, inside = divmod(self._rows, self.size)
            room = min(len(t) - start, BUCKETS * self.size - self._rows)
            # To the end of a bucket that has begun; by whole ones; or what is left.
            most = self.size - inside
            whole = not inside and room >= most
            stop = start + (room - room % most if whole else min(room, most))
            size = min(most, stop - start)
            found = _extremes(t[start:stop], values[start:stop], size)
            after = bucket + found.shape[1]
            self._kept = _with_room(self._kept, 1, after)
            kept = self._kept[:, bucket:after]
            kept[:] = _merged(kept, found) if inside else found
            self._rows += stop - start
            start = stop

    def _halve(self) -> None:
        kept = self._kept[:, :BUCKETS]
        kept[:, : BUCKETS // 2] = _merged(kept[:, ::2], kept[:, 1::2])
        self.size *= 2

    def points(self, column: int) -> tuple[Array, Array]:
        """Return times and values, two a bucket in time order; NaN for an empty one."""
        kept = self._kept[:, : -(-self._rows // self.size), column].copy()
        values, times = kept[[LOW, HIGH]], kept[[LOW_T, HIGH_T]]
        values[:, kept[LOW] > kept[HIGH]] = np.nan
        if self.size == 1:
            return times[0], values[0]
        order = times.argsort(axis=0, kind="stable")
        t, values = (np.take_along_axis(x, order, 0).T for x in (times, values))
        return t.ravel(), values.ravel()


def _merged(first: Array, second: Array) -> Array:
    """Join each bucket (4, n, width) with the one that follows it in time."""
    lower, higher = second[LOW] < first[LOW], second[HIGH] > first[HIGH]
    return np.where(np.stack((lower, lower, higher, higher)), second, first)


def _extremes(t: Array, values: Array, size: int) -> Array:
    """Return low, its time, high, its time of whole buckets: (4, n, width)."""
    # Contiguous along the rows, where argmin and argmax are vectorised.
    buckets = values.reshape(-1, size, values.shape[1])
    v = np.ascontiguousarray(buckets.transpose(0, 2, 1))
    found = []
    for place_of, nothing in ((np.argmin, np.inf), (np.argmax, -np.inf)):
        at = place_of(v, axis=2)
        extreme = _pick(v, at)
        # Both stop at a NaN, so one that is anywhere shows up here.
        if not np.isfinite(extreme).all():
            finite = np.where(np.isfinite(v), v, nothing)
            at = place_of(finite, axis=2)
            extreme = _pick(finite, at)
        found += [extreme, np.take_along_axis(t.reshape(-1, size), at, axis=1)]
    return np.stack(found)


def _pick(v: Array, at: NDArray[np.intp]) -> Array:
    return np.take_along_axis(v, at[:, :, np.newaxis], axis=2)[:, :, 0]


class _Sample:
    """Sample of true rows (k, width), one from each `stride` rows."""

    def __init__(self, width: int) -> None:
        self._points = np.empty((0, width))
        self._kept = 0
        self._seen = 0
        self.stride = 1

    def add(self, rows: Array, chosen: NDArray[np.intp]) -> None:
        """Take rows : (k, c), of which the columns `chosen` : (width,) are kept."""
        total = self._seen + len(rows)
        while True:
            begun = min(POINTS, -(-total // self.stride))
            stretch = np.arange(self._kept, begun)
            shift = (stretch * _GOLDEN % 1.0 * self.stride).astype(np.int64)
            index = stretch * self.stride + shift
            index = index[index < total]
            kept = self._kept + len(index)
            self._points = _with_room(self._points, 0, kept)
            self._points[self._kept : kept] = rows[index - self._seen][:, chosen]
            self._kept = kept
            if kept < POINTS:
                break
            self._halve()
        self._seen = total

    def _halve(self) -> None:
        pair = np.arange(POINTS // 2)
        second = pair * _GOLDEN % 1.0 >= 0.5
        self._points[: len(pair)] = self._points[2 * pair + second]
        self._kept = len(pair)
        self.stride *= 2

    def column(self, column: int) -> Array:
        return self._points[: self._kept, column]


class Thinning:
    """The rows of a run as pictures need them.

    Parameters
    ----------
    columns : names of the columns of the blocks; the first is the time.
    series, paths : the columns that `series` and `path` will be asked for; all when
        left out. What is not named costs neither time nor memory.
    differences : name of an extra series -> the two columns it is the difference of,
        taken row by row, which the envelopes of the two could not give.
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
        """Of how many rows `path` shows one."""
        return self._sample.stride

    def __contains__(self, name: str) -> bool:
        """Whether `name` is a column, or a difference of columns."""
        return name in self._place or name in self._series_at

    def add(self, block: Array) -> None:
        """Take the next rows.

        Parameters
        ----------
        block : (k, c), c the number of columns, rows in order of time. It is not
            kept, so the caller may use its memory again.
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
        """Show rows at events as well, which do not count.

        Parameters
        ----------
        corners : (2 k, ways, c), of each event that just before and that just after.
        """
        if len(corners):
            self._corners = corners[corners[:, -1, 0] <= self._last[0]]

    def _with_corners(self, t: Array, values: Array, met: Array) -> tuple[Array, Array]:
        """Put what is met at events (2 k, ways) among values, in order of time."""
        times = self._corners[:, -1, 0]
        at = np.searchsorted(t, times, side="right")
        # Before an event goes on what was, after it begins what will be.
        beside = at + np.tile((-1, 0), len(at) // 2)
        near = values[np.clip(beside, 0, len(values) - 1)]
        off = np.abs(met - near[:, np.newaxis])
        way = off.argmin(axis=1)
        # The state as it is, where being a little aside makes no difference.
        way[off[:, -1] <= 2.0 * off.min(axis=1)] = met.shape[1] - 1
        met = met[np.arange(len(met)), way]
        return np.insert(t, at, times), np.insert(values, at, met)

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
        """Return times and values of a column, or of a difference.

        Every row while there are at most 4096; beyond, the first row, the least and
        the greatest value of each bucket in time order, the last row. NaN is a gap:
        a bucket without a finite value.
        """
        column = self._series_at[name]
        t, values = self._envelope.points(column)
        if len(self._corners):
            k, ways, c = self._corners.shape
            met = self._series_of(self._corners.reshape(-1, c))[:, column]
            t, values = self._with_corners(t, values, met.reshape(k, ways))
        if self._envelope.size > 1:
            first, last = np.split(np.stack((self._first, self._last)), 2)
            t = np.concatenate((first[:, 0], t, last[:, 0]))
            ends = [self._series_of(row)[:, column] for row in (first, last)]
            values = np.concatenate((ends[0], values, ends[1]))
        return _drawable(t), _drawable(values)

    def path(self, x: str, y: str) -> tuple[Array, Array]:
        """Return two columns in the same rows, in order, the first and last included.

        Every row while there are fewer than 16384; beyond, one of each `stride`. NaN
        where a value is not finite.
        """
        return self.sampled(x), self.sampled(y)

    def sampled(self, name: str) -> Array:
        """Return a column in the rows that `path` shows."""
        kept = self._sample.column(self._paths_at[name])
        if len(self._corners):
            t = self._sample.column(self._paths_at[self.columns[0]])
            met = self._corners[:, :, self._place[name]]
            _, kept = self._with_corners(t, kept, met)
        if self.stride > 1:
            kept = np.append(kept, self.last(name))
        return _drawable(kept)


def _drawable(values: Array) -> Array:
    """Return a copy that can be drawn: what is not finite, or huge, is NaN."""
    sizes = np.abs(values)
    return np.where(sizes < OVERFLOW, np.where(sizes < FAINT, 0.0, values), np.nan)


def picture_thinning(model: Model, columns: Sequence[str]) -> Thinning:
    """Return the thinning of these columns that the pictures of a model need."""
    coordinates = [coordinate.name for coordinate in model.coordinates]
    series = {"kinetic", "potential", "lagrangian", "energy", *coordinates}
    series |= {state.name for state in model.states}
    series |= {f"Qc_{name}" for name in coordinates}
    series |= {f"lambda_{constraint.name}" for constraint in model.constraints}
    shown = ("plot:", "friction.", "impulse.")
    series |= {name for name in columns if name.startswith(shown)}
    paths = {name for name in columns if name.startswith(("point.", "plot:"))}
    shapes = [node for shape in model.scene.shapes for node in shape.nodes]
    paths |= model.graph.depends(shapes) & set(columns)
    paths |= {"t"} if paths or shapes else set()
    balance = {DRIFT: ("energy", "work")} if "work" in columns else {}
    return Thinning(columns, series=series, paths=paths, differences=balance)


# --- Rows for moving pictures: at an even stride, and both rows of each impact
#
# Between two frames a motion is smooth, so that positions there follow from those of
# the frames and from their rates; across an impact they do not. Where there are more
# frames than wanted, every other one goes; where there are too many impacts, some of
# these do, and the stretch in which one is missing says so.

# Of what is kept for a row, beside its columns: its number, how many impacts there were
# up to it, and, of the two rows of an impact, which one that is.
NUMBER, STRUCK, PAIR = range(3)
OWN = 3


class Frames:
    """Keeps the columns `names` of at most `most` rows, but for the last one.

    Parameters
    ----------
    columns
        Those of the rows; the first is the time.

    Attributes
    ----------
    stride : int
        Of how many rows one is kept.
    """

    def __init__(self, columns: Sequence[str], names: Sequence[str], most: int) -> None:
        place = {name: k for k, name in enumerate(columns)}
        self.names = tuple(names)
        self._chosen = np.array([place[name] for name in names], dtype=np.intp)
        self._most = max(4, most)
        self.stride = self._of_impacts = 1
        self._kept: list[Floats] = []
        self._count = self._rows = self._struck = 0
        self._last = np.empty((0, OWN + len(names)))

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        if not len(rows):
            return
        fresh = np.empty((len(rows), OWN + len(self._chosen)))
        fresh[:, OWN:] = rows[:, self._chosen]
        fresh[:, NUMBER] = self._rows + np.arange(len(rows))
        # The row before belongs to these: it may be the first of two at an impact.
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
        # What comes last is looked at again, when it is known what follows.
        done = block[:-1]
        self._keep(done[self._wanted(done)])

    def _struck_in(self, block: Floats) -> Flags:
        """Whether each row is kept for its impact."""
        pair = block[:, PAIR]
        found: Flags = (pair > 0) & (pair % self._of_impacts == 0)
        return found

    def _wanted(self, block: Floats) -> Flags:
        even: Flags = block[:, NUMBER] % self.stride == 0
        return even | self._struck_in(block)

    def _keep(self, rows: Floats) -> None:
        self._kept.append(rows)
        self._count += len(rows)
        if self._count > 2 * self._most:
            self._thin()

    def _thin(self) -> None:
        """Keep fewer, until there are no more than wanted."""
        table = np.concatenate(self._kept) if self._kept else self._last[:0]
        while len(table) > self._most:
            if np.count_nonzero(self._struck_in(table)) > self._most // 2:
                self._of_impacts *= 2
            else:
                self.stride *= 2
            table = table[self._wanted(table)]
        self._kept, self._count = [table], len(table)

    def _whole(self) -> Floats:
        self._thin()
        return np.concatenate((self._kept[0], self._last))

    @property
    def table(self) -> Floats:
        """Stored rows (k, names), in order of time."""
        return self._whole()[:, OWN:]

    @property
    def broken(self) -> Flags:
        """Whether an impact is missing between a frame and the next one (k,)."""
        whole = self._whole()
        struck, t = whole[:, STRUCK], whole[:, OWN]
        missing = (np.diff(struck) > 0) & (np.diff(t) > 0)
        return np.append(missing, False)
