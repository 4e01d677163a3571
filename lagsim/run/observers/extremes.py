"""What each column ends with, and between which values it has been."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.observers import Store


class Extremes:
    """Keeps the last row, and the least and the greatest value of each column.

    Values that are no numbers are passed over.

    Parameters
    ----------
    columns : int
        Of so many, the first of a row.

    Attributes
    ----------
    end, low, high : ndarray, shape (columns,)
    """

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self.begin_anew()

    def begin_anew(self) -> None:
        """Take all rows back."""
        self.rows = 0
        self.last: float | None = None
        self.end, self.low, self.high = np.full((3, self._columns), np.nan)

    @property
    def told(self) -> Floats:
        """All three of them (3, columns)."""
        return np.stack([self.end, self.low, self.high])

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        if not len(rows):
            return
        columns = np.ascontiguousarray(rows[:, : self._columns].T)
        self.low = np.fmin(self.low, np.fmin.reduce(columns, axis=1))
        self.high = np.fmax(self.high, np.fmax.reduce(columns, axis=1))
        self.end = columns[:, -1].copy()
        self.last = float(self.end[0])
        self.rows += len(rows)


class Followed:
    """A store whose rows, as far as it takes them, go on to a follower.

    Attributes
    ----------
    rows, last
        Of the store.
    """

    def __init__(self, store: Store, follower: Extremes) -> None:
        self._store, self._follower = store, follower
        self.rows, self.last = store.rows, store.last

    def begin_anew(self) -> None:
        """Take all rows back."""
        self._store.begin_anew()
        self._follower.begin_anew()
        self.rows, self.last = 0, None

    def add(self, rows: Floats) -> None:
        """Take rows; OSError where there is no room for all of them."""
        try:
            self._store.add(rows)
        finally:
            self._follower.add(rows[: self._store.rows - self.rows])
            self.rows, self.last = self._store.rows, self._store.last
