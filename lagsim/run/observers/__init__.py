"""Observers of the rows of a run.

An observer takes rows, block by block, and is asked afterwards for what it has kept:
in bounded memory, but for `Keep`. `Relay` hands rows to a store first, and to the
others what the store could take; where it can take no more, the run is asked to stop.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.interrupt import Interrupt


class Observer(Protocol):
    """Takes the rows of a run, block by block."""

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns) in the order of `System.columns.names`."""


class Store(Observer, Protocol):
    """Storage of rows; raises OSError where there is no room for them.

    Attributes
    ----------
    rows : int
        Stored so far.
    last : float or None
        The time of the last of them.
    """

    rows: int
    last: float | None

    def begin_anew(self) -> None:
        """Take all rows back."""


class Keep:
    """Keeps all rows, or the first columns of them."""

    def __init__(self, columns: int | None = None) -> None:
        self._columns = columns
        self.begin_anew()

    def begin_anew(self) -> None:
        """Take all rows back."""
        self._blocks: list[Floats] = []
        self.rows = 0
        self.last: float | None = None

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        if len(rows):
            kept = rows[:, : self._columns]
            self._blocks.append(kept if self._columns is None else kept.copy())
            self.rows += len(rows)
            self.last = float(rows[-1, 0])

    @property
    def table(self) -> Floats:
        """Stored rows (k, columns)."""
        nothing = np.empty((0, self._columns or 0))
        return np.concatenate(self._blocks) if self._blocks else nothing


class Relay:
    """Hands rows on, and keeps the time that takes.

    Attributes
    ----------
    seconds : float
    fault : OSError or None
        Why the store could not take all rows.
    """

    def __init__(
        self, store: Store, others: Sequence[Observer], interrupt: Interrupt
    ) -> None:
        self.store, self.others, self.interrupt = store, others, interrupt
        self.seconds = 0.0
        self.fault: OSError | None = None

    def add(self, rows: Floats) -> None:
        """Take rows; the others get those that the store could hold."""
        if self.fault is not None:
            return
        began = time.perf_counter()
        before = self.store.rows
        try:
            self.store.add(rows)
        except OSError as error:
            self.fault = error
            self.interrupt.stop()
        kept = rows[: self.store.rows - before]
        if len(kept):
            for other in self.others:
                other.add(kept)
        self.seconds += time.perf_counter() - began


# Where there are more, corners lie too close to be seen, and cost more than the table.
MOST = 500


class Corners:
    """Keeps the first rows at events, in some ways each.

    On the very surface of a switch an expression may have a value of its own, as sign
    at 0: so that a row is told also for states a little aside, to either side. Of these
    ways the one is right that goes on from the rows beside the event.

    Attributes
    ----------
    events : list of pair of ndarray
        Just before and just after each event: (ways, columns).
    """

    def __init__(self) -> None:
        self.events: list[tuple[Floats, Floats]] = []

    def __bool__(self) -> bool:
        """Whether more rows are requested."""
        return len(self.events) < MOST

    def add(self, before: Floats, after: Floats, within: float = 0.0) -> None:
        """Take the rows at an event; at one time, the first and the last count.

        Times `within` of each other are one: a slip on a disc may turn often to stop.
        """
        if self.events and after[-1, 0] - self.events[-1][1][-1, 0] <= within:
            before, _ = self.events.pop()
        self.events.append((before, after))

    def rows(self) -> Floats:
        """Return the rows in order of time: (2 k, ways, columns)."""
        return np.array([row for event in self.events for row in event])


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
    def stacked(self) -> Floats:
        """Last, least and greatest values (3, columns)."""
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
