"""The accounts of a run, kept while its rows pass: energy drift, residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.native.kernel_types import Floats


class Ledger:
    """Follows energy - work, and each constraint's residual against its scale.

    Attributes
    ----------
    energy_drift : float
        Greatest |energy - work - first value|; nan where one of them is.
    first_energy : float
    """

    def __init__(self, columns: Sequence[str]) -> None:
        self._energy = columns.index("energy")
        self._work = columns.index("work") if "work" in columns else None
        self._constraints = [
            (columns.index("residual_" + name[len("scale.") :]), k)
            for k, name in enumerate(columns)
            if name.startswith("scale.")
        ]
        self._names = [
            name[len("scale.") :] for name in columns if name.startswith("scale.")
        ]
        self._residuals = np.zeros(len(self._constraints))
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
            drift = np.max(np.abs(balance - self._start))
        # np.maximum, and not max, which would lose a nan.
        self.energy_drift = float(np.maximum(self.energy_drift, drift))
        for i, (residual, scale) in enumerate(self._constraints):
            largest = np.max(np.abs(rows[:, residual]))
            self._residuals[i] = np.maximum(self._residuals[i], largest)
            self._scales[i] = np.maximum(self._scales[i], np.max(rows[:, scale]))

    @property
    def constraint_residual(self) -> float:
        """Greatest |residual| over its scale; 0 without constraints."""
        return self.worst_constraint[1]

    @property
    def worst_constraint(self) -> tuple[str, float]:
        """The constraint of that residual, and the residual."""
        if not self._names:
            return "", 0.0
        some = ~(self._scales <= 0)
        ratios = np.divide(
            self._residuals, self._scales, out=np.zeros(len(some)), where=some
        )
        k = int(np.argmax(ratios))
        return self._names[k], float(ratios[k])
