"""Energy drift and residuals of constraints, followed while the rows of a run pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats


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
