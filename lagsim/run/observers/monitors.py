"""Monitors of a run while its rows pass: energy, residuals, and rows to compare."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.tolerances import SAME_STEP, TERM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.model.model import Settings


# Rows that are kept, at most.
MOST_ROWS = 4096


def numbers(t: Floats, start: float, step: float) -> Floats:
    """Give the numbers of times on the grid of output times, -1 between (k,)."""
    places = np.rint((t - start) / step)
    off = np.abs(t - (start + places * step))
    near = SAME_STEP * step + TERM_ROUNDOFF * np.abs(t)
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


# Rows that are kept, at most.
MOST_KEPT = 512
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
        while seen > MOST_KEPT * self._stride:
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


# A value is noted when it is so many times the one noted before.
GROWN = 1.1


class Growth:
    """Notes when a value has grown how far."""

    def __init__(self) -> None:
        self._noted: list[tuple[float, float]] = []
        self._next = 0.0

    def add(self, times: Floats, sizes: Floats) -> None:
        """Take values that are not negative, and their times (k,)."""
        top = np.maximum.accumulate(np.where(sizes > self._next, sizes, 0.0))
        for k in np.flatnonzero(np.diff(top, prepend=0.0)).tolist():
            if top[k] > self._next:
                self._noted.append((float(times[k]), float(top[k])))
                self._next = GROWN * float(top[k])

    def since(self, bound: float) -> float | None:
        """Give the first time noted at which the value exceeds `bound`."""
        return next((t for t, size in self._noted if size > bound), None)


def judged_columns(columns: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Give where each constraint's residual, or what it falls short of, is; its scale.

    What holds at times has none.
    """
    places = {name: k for k, name in enumerate(columns)}
    names = [x.removeprefix("scale.") for x in columns if x.startswith("scale.")]
    return {
        name: (
            places.get(f"missed.{name}", places.get(f"residual_{name}", -1)),
            places[f"scale.{name}"],
        )
        for name in names
    }


class ResidualMonitor:
    """Follows energy - work, and each constraint's residual against its scale.

    Attributes
    ----------
    energy_drift : float
        Greatest |energy - work - first value|; nan where one of them is.
    first_energy : float
    worst_row : ndarray or None
        Where energy - work is farthest from its first value.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._energy = columns.index("energy")
        self._work = columns.index("work") if "work" in columns else None
        judged = judged_columns(columns)
        self._names = list(judged)
        self._constraints = list(judged.values())
        self._residuals = np.zeros(len(self._constraints))
        self._grown = [Growth() for _ in self._constraints]
        self._worst_rows: list[Floats | None] = [None for _ in self._constraints]
        self._drift = Growth()
        self._signed = 0.0
        self.worst_row: Floats | None = None
        self._scales = np.zeros(len(self._constraints))
        self._start: float | None = None
        self.first_energy = 0.0
        self.energy_drift = 0.0

    def add(self, rows: Floats) -> None:
        """Take rows (k, columns)."""
        balance = rows[:, self._energy]
        if self._work is not None:
            with np.errstate(invalid="ignore"):  # inf - inf: the drift is not known
                balance = balance - rows[:, self._work]
        if self._start is None:
            self._start = float(balance[0])
            self.first_energy = float(rows[0, self._energy])
        with np.errstate(invalid="ignore"):
            drifts = balance - self._start
        sizes = np.abs(drifts)
        k = int(np.argmax(sizes))  # of the first nan, if there is one
        if not sizes[k] <= self.energy_drift:
            self._signed, self.worst_row = float(drifts[k]), rows[k].copy()
        # np.maximum, and not max, which would lose a nan.
        self.energy_drift = float(np.maximum(self.energy_drift, sizes[k]))
        self._drift.add(rows[:, 0], sizes)
        for i, (residual, scale) in enumerate(self._constraints):
            sizes = np.abs(rows[:, residual])
            scales = np.fmax(np.fmax.accumulate(rows[:, scale]), self._scales[i])
            parts = np.divide(sizes, scales, out=np.zeros_like(sizes), where=scales > 0)
            self._grown[i].add(rows[:, 0], parts)
            k = int(np.argmax(sizes))
            if not sizes[k] <= self._residuals[i]:
                self._worst_rows[i] = rows[k].copy()
            self._residuals[i] = np.maximum(self._residuals[i], sizes[k])
            self._scales[i] = np.maximum(self._scales[i], np.max(rows[:, scale]))

    @property
    def energy_gained(self) -> float:
        """The deviation that is the greatest, with its sign."""
        return self._signed

    def drift_since(self, bound: float) -> float | None:
        """Give the first time at which energy - work is off by more than `bound`."""
        return self._drift.since(bound)

    def constraint_since(self, name: str, part: float) -> float | None:
        """Give when a residual first exceeds a part of its scale so far."""
        return self._grown[self._names.index(name)].since(part)

    @property
    def constraint_residual(self) -> float:
        """Greatest |residual| over its scale; 0 without constraints."""
        return self.worst_constraint[1]

    @property
    def worst_constraint(self) -> tuple[str, float]:
        """The constraint of that residual, and the residual."""
        if not self._names:
            return "", 0.0
        ratios = self._ratios()
        k = int(np.argmax(ratios))
        return self._names[k], float(ratios[k])

    def constraints_off(self, part: float) -> list[tuple[str, float, float, Floats]]:
        """Give the constraints with a residual of more than a part of its scale.

        Of each the name, the residual, that part, and its row; the worst first.
        """
        ratios = self._ratios()
        found = []
        for k in np.argsort(-ratios).tolist():
            row = self._worst_rows[k]
            if ratios[k] > part and row is not None:
                own = float(self._residuals[k])
                found.append((self._names[k], own, float(ratios[k]), row))
        return found

    @property
    def scales(self) -> dict[str, float]:
        """The largest scale of each constraint."""
        return dict(zip(self._names, self._scales.tolist(), strict=True))

    def _ratios(self) -> Floats:
        some = ~(self._scales <= 0)
        return np.divide(
            self._residuals, self._scales, out=np.zeros(len(some)), where=some
        )
