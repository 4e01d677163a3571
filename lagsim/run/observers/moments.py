"""The rows at some times, taken out of all that pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.run.interrupt import Interrupt


class Moments:
    """Keeps the last row at each of some times, and ends the run after them.

    Parameters
    ----------
    times : ndarray
        In order, each once.

    Attributes
    ----------
    rows : ndarray, shape (times, columns)
        nan where the run gave none.
    """

    def __init__(self, times: Floats, columns: int, interrupt: Interrupt) -> None:
        self._times, self._interrupt = times, interrupt
        self.rows = np.full((len(times), columns), np.nan)

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        places = np.searchsorted(self._times, rows[:, 0])
        places = np.minimum(places, len(self._times) - 1)
        for k in np.flatnonzero(self._times[places] == rows[:, 0]):
            self.rows[places[k]] = rows[k]
        if rows[-1, 0] > self._times[-1]:
            self._interrupt.stop()
