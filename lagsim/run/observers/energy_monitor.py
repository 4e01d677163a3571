"""Keeps some rows of a run, evenly spaced, for what is asked of them afterwards."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats

# Rows that are kept, at most.
MOST_ROWS = 512
# The part of the run that its first and its last energy are the medians of.
TENTH = 0.1
# A change is in the second half where the first has less than this part of it.
ABRUPT = 0.1
# And within the first tenth, for good, where later values keep so much of it.
NO_WAY_BACK = 0.8
# An energy off by this part of what has been in play is that of another motion.
WRONG = 0.3


def gained(balance: Floats) -> float:
    """Give how much energy - work (k,) has grown; 0 where that is only part of a swing.

    By the medians of the first and the last tenth, where one of them varies by less;
    from the first value where nothing comes near it again; to the last one where all of
    the change is in the second half.
    """
    if len(balance) < 2:
        return 0.0
    change = np.abs(balance - balance[0])
    early = np.max(change[: (len(change) + 1) // 2])
    if early < ABRUPT * np.max(change) < change[-1]:
        return float(balance[-1] - balance[0])
    some = max(1, int(TENTH * len(balance)))
    # The quartiles (numpy's own function would load its masked arrays).
    ends = np.sort([balance[:some], balance[-some:]], axis=1)
    low, middle, high = (ends[:, (some - 1) * k // 4] for k in (1, 2, 3))
    at_once = float(middle[1] - balance[0])
    if np.min(change[some:], initial=np.inf) > NO_WAY_BACK * abs(at_once):
        return at_once
    grown = float(middle[1] - middle[0])
    return grown if abs(grown) > np.min(high - low) else 0.0


class EnergyMonitor:
    """Follows energy - work, and the states, as rows pass.

    Parameters
    ----------
    columns
        The names of a row's columns.
    count : int
        Of the coordinates.

    Attributes
    ----------
    between_rows : float
        The largest energy at the ends of steps, which rows may pass over.
    extents : mapping
        The least and the greatest value there of coordinates and velocities.
    """

    between_rows = 0.0
    extents: Mapping[str, tuple[float, float]] = {}

    def __init__(self, columns: Sequence[str], count: int) -> None:
        self.count = count
        self._energy = columns.index("energy")
        self._work = columns.index("work") if "work" in columns else None
        own = [k for k, name in enumerate(columns) if name.startswith("work.")]
        self._works = own or ([] if self._work is None else [self._work])
        shown = ("kinetic", "potential", "lagrangian", "work")
        self._parts = {name: columns.index(name) for name in shown if name in columns}
        self._held = [k for k, name in enumerate(columns) if name.startswith("Qc_")]
        self._low = np.full(len(columns), np.inf)
        self._high = np.full(len(columns), -np.inf)
        self._kept = np.empty((0, 3 + 3 * count + len(self._works)))
        self._seen, self._stride = 0, 1

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        finite = np.isfinite(rows[:, self._energy])
        known = rows if finite.all() else rows[finite]
        if len(known):
            columns = np.ascontiguousarray(known.T)  # looked through at a stretch
            self._low = np.fmin(self._low, np.min(columns, axis=1))
            self._high = np.fmax(self._high, np.max(columns, axis=1))
        seen = self._seen + len(rows)
        while seen > MOST_ROWS * self._stride:
            self._kept = self._kept[::2]
            self._stride *= 2
        first = -self._seen % self._stride
        more = self._parts_of(rows[first :: self._stride])
        self._kept = np.concatenate([self._kept, more])
        self._seen = seen

    def _parts_of(self, rows: Floats) -> Floats:
        """Give energy - work, the kinetic energy, t, q, q', q'', works of each row."""
        balance = rows[:, self._energy]
        if self._work is not None:
            with np.errstate(invalid="ignore"):
                balance = balance - rows[:, self._work]
        moving = rows[:, self._parts.get("kinetic", self._energy)]
        state, works = rows[:, : 1 + 3 * self.count], rows[:, self._works]
        return np.column_stack([balance, moving, state, works])

    @property
    def _rows(self) -> Floats:
        """What is kept and finite, from the start to where it ceases to be."""
        rows = self._kept
        lost = np.flatnonzero(~np.all(np.isfinite(rows), axis=1))
        return rows[: lost[0]] if len(lost) else rows

    @property
    def passed(self) -> Floats:
        """Time, coordinates and velocities (k, 1 + 2 n) of what is kept."""
        return self._rows[:, 2 : 3 + 2 * self.count]

    @property
    def balance(self) -> Floats:
        """Energy - work (k,) of what is kept."""
        return self._rows[:, 0]

    @property
    def worked(self) -> Floats:
        """The works (k, works) of what is kept."""
        return self._rows[:, 3 + 3 * self.count :]

    @property
    def end(self) -> float:
        """The time of the last row that is kept."""
        rows = self._rows
        return float(rows[-1, 2]) if len(rows) else 0.0

    @property
    def energy_gained(self) -> float:
        """How much energy - work has grown; 0 where that is only part of a swing."""
        return gained(self.balance)

    @property
    def energy_in_play(self) -> float:
        """The largest kinetic energy, or range of the potential or of the work.

        Rows alone may show none of it: of a drive, say, that turns at each of them. Of
        a `lagrangian`, which tells neither, the range or the energy's size.
        """
        low, high = self._low, self._high
        if not np.isfinite(low[self._energy]):
            return 0.0
        found = [high[k] - low[k] for k in self._parts.values()]
        if math.isfinite(self.between_rows):
            found.append(self.between_rows)
        alone = "kinetic" if "kinetic" in self._parts else "energy"
        k = self._parts.get(alone, self._energy)
        found.append(max(abs(high[k]), abs(low[k])))
        return float(np.max(found))

    @property
    def ranges(self) -> Floats:
        """The range of each column."""
        return np.asarray(self._high - self._low)

    @property
    def held(self) -> Floats:
        """The largest constraint force on each coordinate (n,)."""
        if not self._held:
            return np.zeros(self.count)
        return np.asarray(np.fmax(np.abs(self._low), np.abs(self._high))[self._held])

    @property
    def work_range(self) -> float:
        """The range of the work; 0 where there is none."""
        return 0.0 if self._work is None else float(self.ranges[self._work])

    @property
    def fastest_rate(self) -> float:
        """How fast the fastest motion is that the rows show: |q''| against |q'|."""
        n, rows = self.count, self._rows
        rates, accelerations = (
            np.sqrt(np.sum(rows[:, 3 + k * n :][:, :n] ** 2, axis=0)) for k in (1, 2)
        )
        found = np.divide(accelerations, rates, out=np.zeros(n), where=rates > 0.0)
        return float(np.max(found, initial=0.0))

    def states(self, most: int) -> Iterator[tuple[float, Floats, Floats, Floats]]:
        """Give t, q, q', q'' of at most so many rows, the first among them.

        None from where the energy is wrong by a large part of what has been in play: a
        motion that has blown up says nothing of the scene.
        """
        n, rows = self.count, self._rows
        if not len(rows):
            return
        change = np.abs(rows[:, 0] - rows[0, 0])
        in_play = np.maximum.accumulate(np.abs(rows[:, 1]))
        wrong = np.flatnonzero(change > WRONG * in_play)
        rows = rows[: max(1, wrong[0])] if len(wrong) else rows
        for row in rows[:: max(1, -(-len(rows) // most))]:
            yield float(row[2]), row[3 : 3 + n], row[3 + n :][:n], row[3 + 2 * n :][:n]
