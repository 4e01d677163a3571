"""Some rows of a run, each known by its number on the grid of output times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.model.model import Settings

# Rows that are kept, at most.
MOST_ROWS = 4096
# A row this close to a time of the grid, as a part of the spacing, is that time's.
SAME_TIME = 1e-9
ROUNDING = 4.0 * 2.0**-52


def numbers(t: Floats, start: float, step: float) -> Floats:
    """Give the numbers of times on the grid of output times, -1 between (k,)."""
    places = np.rint((t - start) / step)
    off = np.abs(t - (start + places * step))
    near = SAME_TIME * step + ROUNDING * np.abs(t)
    return np.where(off <= near, places, -1.0).astype(np.int64)


class Checkpoints:
    """Keeps states of some rows, evenly spaced, and the ranges of the coordinates.

    Rows between two times of the grid, as an impact gives them, are not kept, but for
    the last one: so the rows of two runs correspond, whatever happened in between.

    Parameters
    ----------
    count : int
        Of the coordinates, the columns after the time; their rates follow.
    settings
        Whose grid it is; by default that of the first two times.
    stride
        Of so many rows one is kept, to begin with.
    """

    def __init__(
        self, count: int, settings: Settings | None = None, stride: int = 1
    ) -> None:
        self._count = count
        self._start: float | None = None
        self._step = 0.0
        if settings is not None:
            self._start, self._step = settings.start, settings.output_step
        self._kept: dict[int, Floats] = {}
        self._last: Floats | None = None
        self.stride = stride
        self.low = np.full(count, np.inf)
        self.high = np.full(count, -np.inf)

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        if not len(rows):
            return
        states = rows[:, : 1 + 2 * self._count]
        q = states[:, 1 : 1 + self._count]
        self.low = np.fmin(self.low, np.min(q, axis=0))
        self.high = np.fmax(self.high, np.max(q, axis=0))
        places = self._places(states[:, 0])
        kept = (places >= 0) & (places % self.stride == 0)
        self._kept.update(zip(places[kept].tolist(), states[kept], strict=True))
        self._last = states[-1].copy()
        while len(self._kept) > MOST_ROWS:
            self.stride *= 2
            self._kept = {k: x for k, x in self._kept.items() if k % self.stride == 0}

    def _places(self, t: Floats) -> Floats:
        """Give the numbers of times on the grid, -1 between (k,)."""
        if self._start is None:
            self._start = float(t[0])
        if not self._step:
            later = t[t > self._start]
            self._step = float(later[0] - self._start) if len(later) else 0.0
        if not self._step:
            return np.where(t == self._start, 0, -1).astype(np.int64)
        return numbers(t, self._start, self._step)

    @property
    def states(self) -> dict[int, Floats]:
        """Time, coordinates and rates (1 + 2 n,) by the number of the row."""
        return self._kept

    @property
    def numbered(self) -> dict[int, Floats]:
        """The same, numbered as they are kept."""
        return {k // self.stride: row for k, row in self._kept.items()}

    @property
    def last(self) -> Floats | None:
        """The last row of all."""
        return self._last

    @property
    def rows(self) -> Floats:
        """Time and coordinates (k, 1 + n); the last row, where all are kept."""
        found = list(self._kept.values())
        last = self._last if self.stride == 1 else None
        if last is not None and not (found and found[-1][0] == last[0]):
            found.append(last)
        return np.array(found).reshape(len(found), -1)[:, : 1 + self._count]
