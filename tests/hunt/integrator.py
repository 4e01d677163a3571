"""Extrapolated midpoint steps in long double: Gragg, Bulirsch and Stoer.

Source: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I,
section II.9: T_j1 by n_j = 2, 4, 6, ... substeps, extrapolated in h^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

Long = np.longdouble
SAFETY, LEAST, MOST = 0.8, 0.1, 3.0
# What long double cannot know of a step: extrapolation magnifies the last bits.
ROUNDING = Long(2) ** -57
NOISE = 0.1
# What smoothing gives has more of these; a kink shows all the same.
ROUGHER = 64
SIGNS = np.array([1, -1, -1, 1, -1, 1, 1, -1, 1, 1, -1] * 40, np.longdouble)


class NoTruthError(Exception):
    """The referee gives no answer for this scene."""


@dataclass
class Extrapolation:
    """Adaptive steps of order 2*columns.

    slope : the rate of y at (t, y); y is an array (2n,) of long doubles
    cap : from (t, y, dy), the longest step that sees every feature
    sizes : roughly, how far each component moves
    """

    slope: Callable[[Any, Any], Any]
    cap: Callable[[Any, Any, Any], float]
    columns: int
    tolerance: float
    most: int
    evaluations: int = 0
    step: Any = None
    low: Any = None
    high: Any = None
    sizes: Any = 0.0
    noise: Any = 0.0

    def leap(self, t, y, dy, h):
        """Return the state at t + h and the error of the next lower order."""
        before: list[Any] = []
        early: list[Any] = []
        for j in range(self.columns):
            n = 2 * (j + 1)
            part = h / n
            last, now = y, y + part * dy
            for m in range(1, n):
                last, now = now, last + 2 * part * self.slope(t + m * part, now)
            self.evaluations += n
            # Gragg's smoothing looks at the end of the step, which midpoints do not:
            # a kink past the last of them would be passed over.
            smoothed = (now + last + part * self.slope(t + h, now)) / 2
            before = _extrapolated(now, before, n)
            early = _extrapolated(smoothed, early, n)
        if self.evaluations > self.most:
            raise NoTruthError("too many evaluations")
        apart = np.abs(before[-1] - before[-2])
        beyond = np.abs(before[-1] - early[-1]) / ROUGHER
        return before[-1], np.maximum(apart, beyond)

    def advance(self, t, y, end):
        """Advance by one accepted step, not past `end`; return h, dy, state, time."""
        dy = self.slope(t, y)
        self.evaluations += 1
        self._widen(y)
        # What the rounding of the state does to the slope; signs that do not cancel.
        moved = y * (1 + Long(2) ** -62 * SIGNS[: len(y)])
        self.noise = np.abs(self.slope(t, moved) - dy)
        if self.step is None:
            self.step = (end - t) / 10
        shorter = 1.0
        while True:
            left = end - t
            h = min(self.step, shorter * Long(self.cap(t, y, dy)), left)
            if h < left < 1.5 * h:
                h = left / 2
            found, error = self.leap(t, y, dy, h)
            ratio = self._ratio(y, dy, h, found, error)
            wish = SAFETY * max(ratio, 1e-30) ** (-1.0 / (2 * self.columns - 1))
            if ratio < NOISE:  # rounding, which says nothing of a longer step
                wish = max(wish, 1.5)
            if ratio <= 1.0:
                grown = h * min(MOST, max(LEAST, wish))
                self.step = max(grown, self.step if h < self.step else grown)
                at = end if h == left else t + h
                return h, dy, found, at
            self.step = h * max(LEAST, min(0.5, wish))
            if t + self.step == t or not self.step > 1e-22 * (abs(end) + abs(left)):
                raise NoTruthError(f"steps vanish at {float(t)}")

    def _widen(self, y):
        self.low = y if self.low is None else np.minimum(self.low, y)
        self.high = y if self.high is None else np.maximum(self.high, y)

    def _ratio(self, y, dy, h, found, error):
        """Return the error over the permitted error, the largest over components."""
        if not np.all(np.isfinite(found)):
            return np.inf
        own = self.high - self.low + np.abs(h * dy) + 1e-7 * self.sizes
        half = len(y) // 2
        largest = np.concatenate(
            [
                np.full(half, np.max(np.abs(part), initial=0))
                for part in (y[:half], y[half:])
            ]
        )
        rounding = np.abs(y) + 4 * np.abs(h * dy)
        scale = (
            self.tolerance * own
            + ROUNDING * rounding
            + 16 * h * self.noise
            + Long(2) ** -62 * largest
        )
        return float(np.max(error / (scale + Long(10) ** -4000)))


def _extrapolated(value, before, n):
    """Return a row of the extrapolation tableau: a result and its extrapolations.

    value : the result of a step by n substeps
    before : the row of n - 2 substeps
    """
    row = [value]
    for k in range(1, len(before) + 1):
        ratio = Long(n) / (n - 2 * k)
        row.append(row[-1] + (row[-1] - before[k - 1]) / (ratio * ratio - 1))
    return row
