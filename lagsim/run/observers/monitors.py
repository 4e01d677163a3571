"""Monitors of the rows of a run: energy, residuals, gaps, and rows for comparison."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.columns import FORCE, RESIDUAL, is_of_kind
from lagsim.run.observers import Extremes
from lagsim.tolerances import SAME_STEP, TERM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Settings


# Largest number of stored rows, and number for which there is room at first.
MOST_ROWS = 4096


def grid_numbers(t: Floats, start: float, step: float) -> Floats:
    """Return the index of each time (k,) in the grid of output times; -1 off the grid.

    Parameters
    ----------
    t : ndarray, shape (k,)
    start, step : float
        First time and spacing of the grid.
    """
    places = np.rint((t - start) / step)
    off = np.abs(t - (start + places * step))
    near = SAME_STEP * step + TERM_ROUNDOFF * np.abs(t)
    return np.where(off <= near, places, -1.0).astype(np.int64)


class Checkpoints:
    """States at evenly spaced output times, and the ranges of the coordinates.

    Rows between two output times, such as rows of impacts, are not stored, except the
    last row of the run. Therefore the stored rows of two runs have the same times,
    whatever events occurred between the times.

    Parameters
    ----------
    equations
        Their `state_columns` are the columns to store.
    settings
        Settings that define the grid of output times.
    stride
        Initial number of output intervals from one stored row to the next; it is
        doubled whenever more than `MOST_ROWS` rows are stored.

    Attributes
    ----------
    states : dict of int to ndarray
        Time, coordinates, rates and first-order states by the index of the row.
    """

    def __init__(
        self, equations: Equations, settings: Settings, stride: int = 1
    ) -> None:
        self._count, self._places = len(equations.q), equations.state_columns
        self._grid = settings.start, settings.output_step
        self.states: dict[int, Floats] = {}
        self._extremes = Extremes(len(self._places))
        self.stride = stride

    def add(self, rows: Floats) -> None:
        """Store the rows among (k, columns) that lie on the grid of the stride."""
        if not len(rows):
            return
        rows = rows[:, self._places]
        self._extremes.add(rows)
        places = grid_numbers(rows[:, 0], *self._grid)
        kept = (places >= 0) & (places % self.stride == 0)
        self.states.update(zip(places[kept].tolist(), rows[kept], strict=True))
        while len(self.states) > MOST_ROWS:
            self.stride *= 2
            self.states = {k: x for k, x in self.states.items() if k % self.stride == 0}

    @property
    def numbered(self) -> dict[int, Floats]:
        """Stored states: index of the row divided by the stride -> state."""
        return {k // self.stride: row for k, row in self.states.items()}

    @property
    def last(self) -> Floats | None:
        """Last row of the run, on the grid or not; None before the first row."""
        return self._extremes.end if self._extremes.rows else None

    @property
    def low(self) -> Floats:
        """Least values (n + l,) of the coordinates, then of the first-order states."""
        return self.valued(self._extremes.low)

    @property
    def high(self) -> Floats:
        """Largest values (n + l,) of the coordinates, then of first-order states."""
        return self.valued(self._extremes.high)

    def valued(self, rows: Floats) -> Floats:
        """Return the coordinates and first-order states of stored rows.

        The result has the shape (n + l,) or (k, n + l).

        rows : ndarray, shape (1 + 2 n + l,) or (k, 1 + 2 n + l), as in `states`.
        """
        rates = np.s_[1 + self._count : 1 + 2 * self._count]
        return np.delete(rows, rates, axis=-1)[..., 1:]

    @property
    def rows(self) -> Floats:
        """Time and coordinates (k, 1 + n) of the stored rows.

        The last row of the run is included if the stride is 1.
        """
        found = list(self.states.values())
        last = self.last if self.stride == 1 else None
        if last is not None and not (found and found[-1][0] == last[0]):
            found.append(last)
        return np.array(found).reshape(len(found), -1)[:, : 1 + self._count]


# Largest number of stored rows, and number for which there is room at first.
MOST_KEPT, FIRST_KEPT = 512, 32
# The initial and final energies are medians over this part of the run.
TENTH = 0.1
# A change occurs in the second half if the change in the first half is below this part
# of it.
ABRUPT = 0.1
# A change in the first tenth is permanent if later values remain above this part of it.
NO_WAY_BACK = 0.8
# A motion is wrong if its energy error exceeds this part of the largest energy so far.
WRONG = 0.3


def gained(balance: Floats) -> float:
    """Return the net growth of energy - work (k,); 0 if the balance only oscillates.

    The growth is the difference of the medians of the last and the first tenth, if it
    exceeds the interquartile range of one of these tenths. If no later value comes near
    the first value again, the change from the first value to the median of the first
    tenth is returned; if all of the change occurs in the second half, the difference of
    the last and the first value.
    """
    if len(balance) < 2:
        return 0.0
    change = np.abs(balance - balance[0])
    early = np.max(change[: (len(change) + 1) // 2])
    if early < ABRUPT * np.max(change) < change[-1]:
        return float(balance[-1] - balance[0])
    tenth = max(1, int(TENTH * len(balance)))
    # The quartiles (numpy's own function would load its masked arrays).
    ends = np.sort([balance[:tenth], balance[-tenth:]], axis=1)
    low, middle, high = (ends[:, (tenth - 1) * k // 4] for k in (1, 2, 3))
    at_once = float(middle[1] - balance[0])
    if np.min(change[tenth:], initial=np.inf) > NO_WAY_BACK * abs(at_once):
        return at_once
    grown = float(middle[1] - middle[0])
    return grown if abs(grown) > np.min(high - low) else 0.0


def _balance(rows: Floats, energy: int, work: int | None) -> Floats:
    """Return energy - work (k,) of rows (k, columns); nan for inf - inf.

    energy, work : indices of the columns; work is None in a model without work.
    """
    if work is None:
        return rows[:, energy]
    with np.errstate(invalid="ignore"):
        return np.asarray(rows[:, energy] - rows[:, work])


ENERGIES = ("energy", "kinetic", "potential", "lagrangian", "work")


def energy_parts(columns: Sequence[str]) -> dict[str, int]:
    """Return the index of each column of energy or work, by name.

    columns : names of a row's columns.
    """
    return {name: columns.index(name) for name in ENERGIES if name in columns}


def energy_in_play(
    places: Mapping[str, int], low: Floats, high: Floats, between_rows: float
) -> float:
    """Return the energy in play of rows, from the extremes of their columns.

    The energy in play is the size that a drift of the energy is compared with, see
    `EnergyMonitor.energy_in_play`.

    Parameters
    ----------
    places : mapping of str to int
        Columns, see `energy_parts`.
    low, high : ndarray, shape (columns,)
        Least and greatest value of each column.
    between_rows : float
        Largest energy at the ends of steps.
    """
    if not math.isfinite(low[places["energy"]]):
        return 0.0
    found = [float(high[k] - low[k]) for name, k in places.items() if name != "energy"]
    if math.isfinite(between_rows):
        found.append(between_rows)
    k = places["kinetic" if "kinetic" in places else "energy"]
    found.append(float(max(abs(high[k]), abs(low[k]))))
    return math.nan if any(map(math.isnan, found)) else max(found)


class EnergyMonitor:
    """Monitor of energy - work and of the states, from a subset of the rows.

    Parameters
    ----------
    columns
        Names of a row's columns.
    equations
        Equations that define the columns of coordinates, velocities and states.

    Attributes
    ----------
    between_rows : float
        Largest energy at the ends of steps, which may lie between rows.
    extents : mapping
        Least and greatest value of each coordinate and velocity at the ends of steps.
    """

    between_rows = 0.0
    extents: Mapping[str, tuple[float, float]] = {}

    def __init__(self, columns: Sequence[str], equations: Equations) -> None:
        self.count, self._state = len(equations.q), equations.state_columns
        self._shown = len(self._state) + self.count
        self._energy = columns.index("energy")
        self._work = columns.index("work") if "work" in columns else None
        own = [k for k, name in enumerate(columns) if name.startswith("work.")]
        self._works = own or ([] if self._work is None else [self._work])
        self._parts = energy_parts(columns)
        self._held = [k for k, name in enumerate(columns) if is_of_kind(name, FORCE)]
        self._extremes = Extremes(len(columns))
        # Stored rows are the first `_count` of an array that doubles where it is full.
        self._stored = np.empty((FIRST_KEPT, 2 + self._shown + len(self._works)))
        self._count = self._seen = 0
        self._stride = 1

    def add(self, rows: Floats) -> None:
        """Update the extremes by rows (k, columns), and store one row per stride."""
        finite = np.isfinite(rows[:, self._energy])
        self._extremes.add(rows if finite.all() else rows[finite])
        seen = self._seen + len(rows)
        while seen > MOST_KEPT * self._stride:
            left = self._stored[: self._count : 2].copy()
            self._count, self._stride = len(left), 2 * self._stride
            self._stored[: self._count] = left
        first = -self._seen % self._stride
        self._store(rows[first :: self._stride])
        self._seen = seen

    def _store(self, rows: Floats) -> None:
        """Store energies, time, state, accelerations and works of rows (k, columns)."""
        before, after = self._count, self._count + len(rows)
        if after > len(self._stored):
            size = max(after, 2 * len(self._stored)), self._stored.shape[1]
            self._stored, old = np.empty(size), self._stored
            self._stored[:before] = old[:before]
        # Energy - work, the kinetic energy, t, q, q', q'', s, works of each row.
        own, shown = self._stored[before:after], 2 + self._shown
        own[:, 0] = _balance(rows, self._energy, self._work)
        own[:, 1] = rows[:, self._parts.get("kinetic", self._energy)]
        own[:, 2:shown], own[:, shown:] = rows[:, : self._shown], rows[:, self._works]
        self._count = after

    @property
    def _rows(self) -> Floats:
        """Stored rows before the first one with a value that is not finite."""
        rows = self._stored[: self._count]
        lost = np.flatnonzero(~np.all(np.isfinite(rows), axis=1))
        return rows[: lost[0]] if len(lost) else rows

    @property
    def passed(self) -> Floats:
        """Time and state (k, 1 + 2 n + states) of the stored rows."""
        return self._rows[:, 2 + np.array(self._state)]

    @property
    def balance(self) -> Floats:
        """Energy - work (k,) of the stored rows."""
        return self._rows[:, 0]

    @property
    def worked(self) -> Floats:
        """Work integrals (k, works) of the stored rows."""
        return self._rows[:, 2 + self._shown :]

    @property
    def end(self) -> float:
        """Time of the last stored row; 0 without rows."""
        rows = self._rows
        return float(rows[-1, 2]) if len(rows) else 0.0

    @property
    def energy_in_play(self) -> float:
        """Largest of the kinetic energy, and the ranges of energies and of the work.

        The energy at the ends of steps is included, since the energy may vanish in all
        rows, as that of a drive that reverses at each of the output times. For a model
        by its `lagrangian` alone, the range of the Lagrangian or the largest |energy|.
        """
        low, high = self._extremes.low, self._extremes.high
        return energy_in_play(self._parts, low, high, self.between_rows)

    @property
    def ranges(self) -> Floats:
        """Range, largest less smallest value, of each column: shape (columns,)."""
        # a quantity that is infinite in all rows has no range
        with np.errstate(invalid="ignore"):
            return np.asarray(self._extremes.high - self._extremes.low)

    @property
    def constraint_forces(self) -> Floats:
        """Largest |constraint force| on each coordinate (n,); 0 without constraints."""
        if not self._held:
            return np.zeros(self.count)
        sizes = np.abs([self._extremes.low, self._extremes.high])
        return np.asarray(np.fmax(*sizes)[self._held])

    @property
    def work_range(self) -> float:
        """Range of the work; 0 if the rows have no column of work."""
        return 0.0 if self._work is None else float(self.ranges[self._work])

    @property
    def fastest_rate(self) -> float:
        """Rate of the fastest motion in the stored rows: the largest |q''|/|q'|."""
        n, rows = self.count, self._rows
        with np.errstate(over="ignore"):
            rates, accelerations = (
                np.sqrt(np.sum(rows[:, 3 + k * n :][:, :n] ** 2, axis=0))
                for k in (1, 2)
            )
        found = np.divide(accelerations, rates, out=np.zeros(n), where=rates > 0.0)
        return float(np.max(found, initial=0.0))

    def states(self, most: int) -> Iterator[tuple[float, list[Floats]]]:
        """Yield t and [q, q', q'', s] of about `most` rows, the first row included.

        The arrays have the shapes (n,), (n,), (n,) and (l,). Rows are omitted from the
        time on at which the error of the energy exceeds the part `WRONG` of the largest
        energy so far, since the motion has diverged there.
        """
        n, rows = self.count, self._rows
        if not len(rows):
            return
        change = np.abs(rows[:, 0] - rows[0, 0])
        in_play = np.maximum.accumulate(np.abs(rows[:, 1]))
        wrong = np.flatnonzero(change > WRONG * in_play)
        rows = rows[: max(1, wrong[0])] if len(wrong) else rows
        for row in rows[:: max(1, -(-len(rows) // most))]:
            state = row[3 : 2 + self._shown]
            yield float(row[2]), np.split(state, [n, 2 * n, 3 * n])


# A value is recorded when it exceeds the last recorded value by this factor.
GROWN = 1.1


def _records(sizes: Floats, least: float) -> Flags:
    """Return a mask (k,) of the sizes that exceed `least` and every earlier size."""
    top = np.maximum.accumulate(np.where(sizes > least, sizes, 0.0))
    return np.diff(top, prepend=0.0) > 0.0


class Growth:
    """Greatest magnitude of a value in a run, its row, and times at which it grew.

    Attributes
    ----------
    size : float
        Greatest magnitude; nan if any magnitude is nan.
    row : ndarray or None
        Row of the greatest magnitude, or the first row where it is nan.
    """

    def __init__(self) -> None:
        self.size = 0.0
        self.row: Floats | None = None
        self._noted: list[tuple[float, float, float]] = []  # time, size, noted size
        self._next = self._next_size = 0.0

    def grows(self, size: float, noted: float) -> bool:
        """Whether `add` would change anything for a block of rows.

        size, noted : the largest entries, or nan, of the arguments `sizes` and `noted`
            that `add` would have for this block.
        """
        return not (size <= self.size and noted <= self._next)

    def add(self, rows: Floats, sizes: Floats, noted: Floats | None = None) -> None:
        """Update the greatest magnitude and the history of growth by a block of rows.

        A time is added to the history where the magnitude exceeds the last one by a
        factor.

        Parameters
        ----------
        rows : ndarray, shape (k, columns)
            Rows with the time in the first column.
        sizes : ndarray, shape (k,)
            Magnitude of the value in each row.
        noted : ndarray, shape (k,), optional
            Magnitudes in another unit for the history of growth; by default `sizes`.
        """
        k = int(np.argmax(sizes))  # the component of the first nan, if there is one
        if not sizes[k] <= self.size:
            self.row = rows[k].copy()
        # np.maximum, and not max, which would lose a nan.
        self.size = float(np.maximum(self.size, sizes[k]))
        grown = sizes if noted is None else noted
        new = _records(grown, self._next) | _records(sizes, self._next_size)
        for k in np.flatnonzero(new).tolist():
            size, own = float(sizes[k]), float(grown[k])
            if own > self._next or size > self._next_size:
                self._noted.append((float(rows[k, 0]), size, own))
                self._next = max(self._next, GROWN * own)
                self._next_size = max(self._next_size, GROWN * size)

    def since(self, bound: float, part: float = 0.0) -> float | None:
        """Return the first recorded time at which the noted magnitude exceeds `bound`.

        None if it never does. Magnitudes up to the part `part` of the greatest one are
        left out; if only such magnitudes are recorded, the time is that of the greatest
        one.
        """
        over = [(t, size) for t, size, noted in self._noted if noted > bound]
        found = next((t for t, size in over if not size <= part * self.size), None)
        if found is None and over and self.row is not None:
            return float(self.row[0])
        return found


def judged_columns(columns: Sequence[str]) -> dict[str, tuple[int, int]]:
    """Return the indices of each constraint's residual and scale columns, by name.

    The residual of a contact or freewheel is its violation, `missed:NAME`. Limited
    equalities, and those with a condition `when`, are omitted.
    """
    places = {name: k for k, name in enumerate(columns)}
    names = [x.removeprefix("scale:") for x in columns if x.startswith("scale:")]
    return {
        name: (
            places.get(f"missed:{name}", places.get(RESIDUAL.of(name), -1)),
            places[f"scale:{name}"],
        )
        for name in names
    }


class ResidualMonitor:
    """Monitor of energy - work, and of each constraint's residual over its scale.

    Parameters
    ----------
    columns : sequence of str
        Names of a row's columns.

    Attributes
    ----------
    first_energy : float
        Energy in the first row.
    drift : Growth
        Growth of |energy - work - first value|.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._energy = columns.index("energy")
        self._work = columns.index("work") if "work" in columns else None
        self._start: float | None = None
        self.first_energy = 0.0
        self.drift = Growth()
        judged = judged_columns(columns)
        places = np.array([*judged.values()], dtype=np.intp).reshape(-1, 2)
        self._residual_at, self._scale_at = places.T
        self._residuals = {name: Growth() for name in judged}
        self._scales = np.zeros(len(judged))

    @property
    def scales(self) -> dict[str, float]:
        """Largest scale of each constraint."""
        return dict(zip(self._residuals, self._scales.tolist(), strict=True))

    def add(self, rows: Floats) -> None:
        """Update the drift and the residuals by rows (k, columns)."""
        balance = _balance(rows, self._energy, self._work)
        if self._start is None:
            self._start = float(balance[0])
            self.first_energy = float(rows[0, self._energy])
        with np.errstate(invalid="ignore"):
            self.drift.add(rows, np.abs(balance - self._start))
        sizes, scales = np.abs(rows[:, self._residual_at]), rows[:, self._scale_at]
        so_far = np.fmax(np.fmax.accumulate(scales), self._scales)
        parts = np.divide(sizes, so_far, out=np.zeros_like(sizes), where=so_far > 0)
        largest, most = np.max(sizes, axis=0), np.max(parts, axis=0)
        for k, growth in enumerate(self._residuals.values()):
            if growth.grows(largest[k], most[k]):
                growth.add(rows, sizes[:, k], parts[:, k])
        self._scales = np.maximum(self._scales, np.max(scales, axis=0))

    @property
    def energy_gained(self) -> float:
        """Change of energy - work since the first row that is greatest in magnitude."""
        if self.drift.row is None or self._start is None:
            return 0.0
        worst = _balance(self.drift.row[np.newaxis], self._energy, self._work)
        return float(worst[0]) - self._start

    def constraint_since(self, name: str, part: float) -> float | None:
        """Return the time when |residual| first exceeds `part` of its scale so far.

        None if it never does. Residuals up to that part of the greatest |residual| do
        not count, since a scale so far may be roundoff alone.
        """
        return self._residuals[name].since(part, part)

    @property
    def constraint_residual(self) -> float:
        """Greatest |residual|/scale of all constraints; 0 without constraints."""
        return float(np.max(list(self.constraint_parts.values()), initial=0.0))

    def constraints_off(self, part: float) -> list[tuple[str, float, float, Floats]]:
        """Return the constraints whose |residual| exceeds `part` of the scale.

        Each entry has the name of a constraint, the greatest |residual|, its ratio to
        the scale, and its row; in decreasing order of the ratio.
        """
        found = []
        for name, own in self.constraint_parts.items():
            worst = self._residuals[name]
            if own > part and worst.row is not None:
                found.append((name, worst.size, own, worst.row))
        return sorted(found, key=lambda row: -row[2])

    @property
    def constraint_parts(self) -> dict[str, float]:
        """Greatest |residual| of each constraint over its scale; 0 for a scale of 0."""
        return {
            name: 0.0 if scale <= 0.0 else self._residuals[name].size / scale
            for name, scale in self.scales.items()
        }


class Gap(NamedTuple):
    """First value of a column that is not finite, its time, and the count of rows."""

    value: float
    time: float
    rows: int


class Gaps:
    """Record of the first value of each column that is not finite.

    Parameters
    ----------
    columns
        Names of the leading columns of a row, which are examined.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._names = tuple(columns)
        self.found: dict[str, Gap] = {}

    def add(self, rows: Floats) -> None:
        """Record the values in rows (k, columns) that are not finite."""
        finite = np.isfinite(rows[:, : len(self._names)])
        if finite.all():
            return
        for k in np.flatnonzero(~finite.all(axis=0)).tolist():
            name, missing = self._names[k], ~finite[:, k]
            first = int(np.argmax(missing))
            new = Gap(float(rows[first, k]), float(rows[first, 0]), 0)
            known = self.found.get(name, new)
            count = known.rows + int(np.count_nonzero(missing))
            self.found[name] = known._replace(rows=count)
