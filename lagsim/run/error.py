"""Error estimate of a run, from its repeat at a tighter tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.language.arrays import Floats

# Past the horizon the estimate exceeds this part of a coordinate's range.
LOST = 0.1
# How many times the growth is told at.
TIMES = 20


class Failed(str):
    """Reason why a repeat gave no error bar."""

    __slots__ = ()


class CoordinateError(NamedTuple):
    """The estimated error of one coordinate, in its unit and as a part of its range."""

    largest: float
    relative: float
    time: float


class ErrorBar(NamedTuple):
    """Error estimate of a run, from its repeat at a tighter tolerance.

    Attributes
    ----------
    method, rtol
        Of the repeat.
    names
        Of the coordinates and the first-order states, n in all.
    times : ndarray, shape (k,)
        Of the rows that were compared.
    errors : ndarray, shape (k, n)
        The estimates, in their units.
    scales : ndarray, shape (n,)
        The range of each, or what counts as one.
    still : ndarray, shape (n,)
        What moves less than this has no horizon; by default nothing.
    rates : ndarray or None
        The estimates for the velocities, a column a coordinate.
    repeated : dict
        Times, coordinates, velocities and states of the repeat, by the number of
        what was compared.
    parted : str
        How the two runs ended differently, if they did.
    rests : bool
        Nothing moves but by rounding.
    """

    method: str
    rtol: float | None
    names: tuple[str, ...]
    times: Floats
    errors: Floats
    scales: Floats
    still: Floats | None = None
    rates: Floats | None = None
    repeated: Mapping[int, Floats] = {}
    parted: str = ""
    rests: bool = False

    @property
    def parts(self) -> Floats:
        """The estimates as parts of the ranges (k, n)."""
        return _parts(self.errors, self.scales)

    @property
    def coordinates(self) -> dict[str, CoordinateError]:
        """The largest error of each coordinate and state, and when."""
        worst = np.argmax(self.errors, axis=0)
        largest, parts = self.errors, self.parts
        return {
            name: CoordinateError(
                float(largest[k, i]), float(parts[k, i]), float(self.times[k])
            )
            for i, (name, k) in enumerate(zip(self.names, worst, strict=True))
        }

    @property
    def relative(self) -> float:
        """The largest part of a range that any error reaches."""
        return float(np.max(self.parts, initial=0.0))

    @property
    def growth(self) -> list[tuple[float, float]]:
        """Times, and the largest part of a range that any error has reached by then."""
        reached = np.maximum.accumulate(np.max(self.parts, axis=1))
        last = len(self.times) - 1
        samples = sorted({-(-last * k // TIMES) for k in range(1, TIMES + 1)})
        return [(float(self.times[k]), float(reached[k])) for k in samples]

    def lost_by(self, errors: Floats) -> Floats:
        """Errors (n,) or (k, n) as parts of what can be lost."""
        still = 0.0 if self.still is None else self.still
        return _parts(errors, np.fmax(self.scales, still))

    @property
    def lost(self) -> Floats:
        """The largest error in each row (k,), as parts of what can be lost."""
        return np.asarray(np.max(self.lost_by(self.errors), axis=1))

    @property
    def horizon(self) -> float | None:
        """The first time at which an error exceeds the part LOST of its range."""
        lost = np.flatnonzero(self.lost > LOST)
        return float(self.times[lost[0]]) if len(lost) else None


def _parts(errors: Floats, scales: Floats) -> Floats:
    return np.divide(errors, scales, out=np.zeros_like(errors), where=scales > 0.0)
