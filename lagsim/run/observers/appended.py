"""Columns that are computed beside a run, appended to its rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.run.observers.monitors import grid_numbers

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.model.model import Settings
    from lagsim.notes import Caution
    from lagsim.run.observers import Store


class Appended(NamedTuple):
    """Columns of sensitivities and standard deviations, beside the rows of a run.

    Attributes
    ----------
    names : tuple of str
        `d.<column>.<name>`, then `sd.<column>`.
    settings : Settings
        Settings of the run, which define the output times.
    values : ndarray, shape (k, names)
        At the output times and the end of the run; nan at the time of an impact.
    record : dict
        The entry `sensitivities` of run.json: by name, `step`, `error` and `runs`.
    cautions : list of Caution
        Warnings of rows that are not differentiable with respect to a parameter.
    """

    names: tuple[str, ...]
    settings: Settings
    values: Floats
    record: dict[str, dict[str, float]]
    cautions: list[Caution]

    def at(self, t: Floats) -> Floats:
        """Return the columns at the times of rows, shape (rows, names).

        Rows off the output times, such as the two rows of an impact, are nan.
        """
        s = self.settings
        places = grid_numbers(t, s.start, s.output_step)
        places = np.where(t == s.end, len(self.values) - 1, places)
        known = (places >= 0) & (places < len(self.values))
        found = self.values[np.where(known, places, 0)]
        return np.where(known[:, np.newaxis], found, np.nan)


class Widened:
    """Store that appends columns to rows before another store receives the rows.

    Parameters
    ----------
    store : Store
        Receives the longer rows.
    columns : int
        Number of columns of the table, which come first.
    more : Appended
        The columns to append, and their values at the output times.
    """

    def __init__(self, store: Store, columns: int, more: Appended) -> None:
        self._store, self._columns, self._more = store, columns, more

    @property
    def rows(self) -> int:
        """Number of rows stored."""
        return self._store.rows

    @property
    def last(self) -> float | None:
        """Time of the last stored row; None before the first row."""
        return self._store.last

    def begin_anew(self) -> None:
        """Delete all stored rows."""
        self._store.begin_anew()

    def add(self, rows: Floats) -> None:
        """Store rows (k, columns) of a run, with the appended columns."""
        own = rows[:, : self._columns]
        self._store.add(np.hstack([own, self._more.at(rows[:, 0])]))
