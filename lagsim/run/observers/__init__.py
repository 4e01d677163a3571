"""Observers of the rows of a run.

An observer receives the rows of a run in blocks and stores a summary of the rows, in
bounded memory except in `Keep`. `Relay` passes rows to a store first, and to the other
observers only the rows that the store accepted; when the store is full, `Relay`
requests the end of the run.
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
    """Interface of objects that receive the rows of a run in blocks."""

    def add(self, rows: Floats) -> None:
        """Process the next rows (k, columns).

        The columns are those of `program.system.System.columns.names`.
        """


class Store(Observer, Protocol):
    """Interface of a storage of rows; `add` raises OSError when the storage is full."""

    @property
    def rows(self) -> int:
        """Number of rows stored so far."""

    @property
    def last(self) -> float | None:
        """Time of the last stored row; None before the first row."""

    def begin_anew(self) -> None:
        """Delete all stored rows."""


class Keep:
    """Storage in memory of all rows."""

    def __init__(self) -> None:
        self.begin_anew()

    def begin_anew(self) -> None:
        """Delete all stored rows."""
        self._blocks: list[Floats] = []
        self.rows = 0
        self.last: float | None = None

    def add(self, rows: Floats) -> None:
        """Store rows (k, columns)."""
        if len(rows):
            self._blocks.append(rows)
            self.rows += len(rows)
            self.last = float(rows[-1, 0])

    @property
    def table(self) -> Floats:
        """Stored rows (k, columns)."""
        return np.concatenate(self._blocks) if self._blocks else np.empty((0, 0))


class Relay:
    """Distribution of rows to a store and other observers, with the time it takes.

    Parameters
    ----------
    store : Store
        Receives all rows first.
    others : sequence of Observer
        Receive the rows that the store has accepted.
    interrupt : Interrupt
        Receives the request to end the run where the store is full.

    Attributes
    ----------
    seconds : float
        Time spent in the store and the observers.
    fault : OSError or None
        Error of the store; later rows are discarded.
    """

    def __init__(
        self, store: Store, others: Sequence[Observer], interrupt: Interrupt
    ) -> None:
        self.store, self.others, self.interrupt = store, others, interrupt
        self.seconds = 0.0
        self.fault: OSError | None = None

    def add(self, rows: Floats) -> None:
        """Store rows (k, columns); pass the rows that are stored to the observers."""
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


# More corners lie too close to be visible in a plot, and take longer than the table.
MOST = 500


class Corners:
    """Rows just before and just after the first events, each in several variants.

    Exactly on the surface of a switch an expression may have an isolated value, as sign
    has at 0. Therefore each row is also computed for states slightly off the surface,
    on either side. The variant that continues the neighbouring rows is the one to plot.

    Attributes
    ----------
    events : list of pair of ndarray, shape (variants, columns)
        Rows just before and just after each event.
    """

    def __init__(self) -> None:
        self.events: list[tuple[Floats, Floats]] = []

    def __bool__(self) -> bool:
        """Whether further rows can be stored."""
        return len(self.events) < MOST

    def add(self, before: Floats, after: Floats, within: float = 0.0) -> None:
        """Store the rows just before and just after an event.

        Events no more than `within` apart are merged: the rows before the first and
        after the last are kept. A slip with two directions may have many events before
        it stops.

        Parameters
        ----------
        before, after : ndarray, shape (variants, columns)
            The row before and the row after the event, each in all variants.
        within : float
            Largest time between merged events.
        """
        if self.events and after[-1, 0] - self.events[-1][1][-1, 0] <= within:
            before, _ = self.events.pop()
        self.events.append((before, after))

    def rows(self) -> Floats:
        """Return the rows of all k events in time order, (2 k, variants, columns).

        Each event has the row just before it and the row just after it.
        """
        return np.array([row for event in self.events for row in event])


class Moments:
    """Storage of the last row at each of given times; ends the run after them.

    Parameters
    ----------
    times : ndarray, shape (k,)
        Increasing times.
    columns : int
        Number of columns of a row.
    interrupt : Interrupt
        Receives the request to end the run.

    Attributes
    ----------
    rows : ndarray, shape (k, columns)
        nan at times without a row.
    """

    def __init__(self, times: Floats, columns: int, interrupt: Interrupt) -> None:
        self._times, self._interrupt = times, interrupt
        self.rows = np.full((len(times), columns), np.nan)

    def add(self, rows: Floats) -> None:
        """Store the rows, among rows (k, columns), that lie at the given times."""
        places = np.searchsorted(self._times, rows[:, 0])
        places = np.minimum(places, len(self._times) - 1)
        for k in np.flatnonzero(self._times[places] == rows[:, 0]):
            self.rows[places[k]] = rows[k]
        if rows[-1, 0] > self._times[-1]:
            self._interrupt.stop()


def extremes_of(columns: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest value of each column, ignoring nan.

    columns : ndarray, shape (columns, rows).
    """
    return np.fmin.reduce(columns, axis=1), np.fmax.reduce(columns, axis=1)


class Extremes:
    """Last row, and least and greatest value of each column, ignoring nan.

    Parameters
    ----------
    columns : int
        Number of leading columns of a row to be observed.

    Attributes
    ----------
    end, low, high : ndarray, shape (columns,)
        Last row, least values and greatest values.
    """

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self.begin_anew()

    def begin_anew(self) -> None:
        """Reset to the state without rows."""
        self.rows = 0
        self.last: float | None = None
        self.end, self.low, self.high = np.full((3, self._columns), np.nan)

    @property
    def stacked(self) -> Floats:
        """Last row, least values and greatest values (3, columns)."""
        return np.stack([self.end, self.low, self.high])

    def add(self, rows: Floats) -> None:
        """Update the last row and the extremes by rows (k, columns)."""
        if not len(rows):
            return
        columns = np.ascontiguousarray(rows[:, : self._columns].T)
        low, high = extremes_of(columns)
        self.low = np.fmin(self.low, low)
        self.high = np.fmax(self.high, high)
        self.end = columns[:, -1].copy()
        self.last = float(self.end[0])
        self.rows += len(rows)


# Rows whose sums are added at a time: equal sums for any division of rows into blocks.
SUMMED = 256


class Measures(Extremes):
    """Last row, and measures of each column over the rows from a time on.

    The measures ignore nan; all rows count alike, both rows of an impact, too.

    Parameters
    ----------
    columns : int
        Number of leading columns of a row to be observed.
    since : float
        Time of the first row that counts.
    """

    def __init__(self, columns: int, since: float) -> None:
        self._since = since
        super().__init__(columns)

    def begin_anew(self) -> None:
        """Reset to the state without rows."""
        super().begin_anew()
        self._waiting = np.empty((0, self._columns))
        # Number, mean, and sum of the squared deviations from the mean, by column.
        self._sums = np.zeros((3, self._columns))

    @property
    def stacked(self) -> Floats:
        """End, minimum, maximum, mean, rms and peak to peak: shape (6, columns).

        `rms` is the root mean square of the deviation from the mean.
        """
        count, mean, squares = _merged(self._sums, self._waiting)
        with np.errstate(invalid="ignore"):
            mean = np.where(count > 0, mean, np.nan)
            rms = np.sqrt(squares / count)
            spread = self.high - self.low
        return np.stack([self.end, self.low, self.high, mean, rms, spread])

    def add(self, rows: Floats) -> None:
        """Update the last row, and the measures by the rows (k, columns) that count."""
        counted = rows[rows[:, 0] >= self._since]
        super().add(counted)
        if len(rows):
            self.end = rows[-1, : self._columns].copy()
            self.last = float(self.end[0])
            self.rows += len(rows) - len(counted)
        waiting = np.concatenate([self._waiting, counted[:, : self._columns]])
        whole = len(waiting) - len(waiting) % SUMMED
        for block in np.split(waiting[:whole], range(SUMMED, whole, SUMMED)):
            self._sums = _merged(self._sums, block)
        self._waiting = waiting[whole:]


def _merged(sums: Floats, rows: Floats) -> Floats:
    """Return number, mean and sum of squared deviations, updated by k rows.

    nan do not count.

    Source: T. F. Chan, G. H. Golub, R. J. LeVeque, Algorithms for computing the sample
    variance, Amer. Stat. 37 (1983), eq. 2.1.

    rows : ndarray, shape (k, columns).
    sums : ndarray, shape (3, columns), the former values, as is the result.
    """
    if not len(rows):
        return sums
    known = ~np.isnan(rows)
    base = np.where(known[0], rows[0], 0.0)  # no rounding error in constant columns
    count = known.sum(axis=0)
    before, old, squares = sums
    whole = before + count
    with np.errstate(invalid="ignore", over="ignore"):
        away = np.where(known, rows - base, 0.0)
        mean = away.sum(axis=0) / np.maximum(count, 1)
        squares = squares + (np.where(known, away - mean, 0.0) ** 2).sum(axis=0)
        shift, share = base - old + mean, count / np.maximum(whole, 1)
        return np.stack(
            [whole, old + shift * share, squares + shift**2 * before * share]
        )
