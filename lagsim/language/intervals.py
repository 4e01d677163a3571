"""Intervals as arrays: enclosures of the values that expressions take.

An enclosure holds every value that an expression takes while its variable runs through
an interval, those that double arithmetic gives included. Zeros have no sign here.

Source: R. E. Moore, R. B. Kearfott, M. J. Cloud, Introduction to Interval Analysis,
SIAM 2009.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

# Libraries differ in the last places of sin, pow, ...: four units are allowed for.
SLACK = 2.0**-50
TINY = math.ulp(0.0)
LARGEST = np.finfo(np.float64).max


@dataclass(frozen=True, slots=True)
class Interval:
    """Enclosures, one per element; truth values are 0 and 1.

    Attributes
    ----------
    lo, hi : array
        The bounds; nan where the expression is nan throughout.
    partial : array of bool
        The expression may be nan somewhere in the interval.
    jumps : array of bool
        It may be discontinuous or unbounded there.
    """

    lo: Floats
    hi: Floats
    partial: Flags
    jumps: Flags

    @property
    def undefined(self) -> Flags:
        """Where the expression is nan throughout."""
        flags: Flags = np.isnan(self.lo)
        return flags

    @property
    def single(self) -> Flags:
        """Where one value is taken throughout (nan counts as one)."""
        flags: Flags = np.isnan(self.lo) | ((self.lo == self.hi) & ~self.partial)
        return flags

    @property
    def width(self) -> Floats:
        """The distance of the bounds."""
        width: Floats = self.hi - self.lo
        return width

    @property
    def has_zero(self) -> Flags:
        """Where zero is among the values."""
        flags: Flags = (self.lo <= 0.0) & (self.hi >= 0.0)
        return flags

    @property
    def unbounded(self) -> Flags:
        """Where a bound is infinite."""
        return np.isinf(self.lo) | np.isinf(self.hi)

    def __getitem__(self, where: slice) -> Interval:
        """Give some of the elements."""
        return Interval(
            self.lo[where], self.hi[where], self.partial[where], self.jumps[where]
        )


def interval(
    lo: Any,
    hi: Any,
    partial: Any = False,
    jumps: Any = False,
) -> Interval:
    """Give an Interval of equal shapes."""
    lo, hi, partial, jumps = np.broadcast_arrays(
        np.atleast_1d(np.asarray(lo, np.float64)), hi, partial, jumps
    )
    return Interval(lo, hi, partial, jumps)


def point(x: float) -> Interval:
    """Give the interval of the one value `x`."""
    return interval(x, x)


def select(which: Flags, x: Interval, y: Interval) -> Interval:
    """Give x where `which` holds, else y."""
    return Interval(
        np.where(which, x.lo, y.lo),
        np.where(which, x.hi, y.hi),
        np.where(which, x.partial, y.partial),
        np.where(which, x.jumps, y.jumps),
    )


def outward(lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
    """Widen by the slack of library functions; an infinite overflow is undone."""
    low = np.minimum(lo, LARGEST)
    high = np.maximum(hi, -LARGEST)
    return low - (np.abs(low) * SLACK + TINY), high + (np.abs(high) * SLACK + TINY)


def outward_but_zero(lo: Floats, hi: Floats) -> tuple[Floats, Floats]:
    """Widen as `outward`, for functions whose zeros are exact."""
    low, high = outward(lo, hi)
    return np.where(lo == 0.0, 0.0, low), np.where(hi == 0.0, 0.0, high)


def exact_or_next(bound: Floats, exact: Flags, toward: float) -> Floats:
    """Give a bound, moved to the next number where it is not exact."""
    return np.where(exact, bound, np.nextafter(bound, toward))
