"""The scale of an axis: its range, its ticks, and the number they are counted in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.run.observers.thinning import Array

# A series that varies by less than this part of its size is rounding noise, and is
# drawn flat; below the next, what varies is drawn as its distance from a round number.
FLAT = 1e-9
OFFSET = 2e-3

# What should be zero is often not quite; beside others of its unit it is if less than:
NOISE = 1e-14

# Numbers in this range of powers of ten are written out on the ticks.
PLAIN, PLAIN_TIMES = range(-2, 4), range(-2, 6)

# With fewer ticks than this, a scale cannot be read off.
LEAST_TICKS = 3

# Past these, squares and differences leave the range of a double.
_HUGE, _TINY = 1e300, 1e-290

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis from `low` to `high`; ticks count (value - offset) / 10^exponent."""

    low: float
    high: float
    offset: float = 0.0
    exponent: int = 0

    def ticks(self, most: int) -> tuple[list[float], list[str]]:
        """Return about `most` places (as values) and what is written at them."""
        unit = 10.0**self.exponent
        low, high = (self.low - self.offset) / unit, (self.high - self.offset) / unit
        widest = (high - low) / max(1, most - 1)
        first = last = 0
        while last - first + 1 < LEAST_TICKS:
            step, decimals = _round_step(widest)
            slack = 1e-9 * step
            first = math.ceil((low - slack) / step)
            last = math.floor((high + slack) / step)
            widest = step / 2
        counts = [k * step for k in range(first, last + 1)]
        places = [self.offset + count * unit for count in counts]
        return places, [_number(count, decimals) for count in counts]

    def label(self, name: str, unit: str = "") -> str:
        """Return the axis label: what it shows, from where it counts, the unit."""
        if self.offset:
            # Twelve digits hold it exactly: it is a multiple of the span's own size.
            sign = "−" if self.offset > 0 else "+"
            name = f"{name} {sign} {abs(self.offset):.12g}"
        scale = power_of_ten(self.exponent) if self.exponent else ""
        inside = " ".join(part for part in (scale, unit) if part)
        return f"{name} ({inside})" if inside else name


def power_of_ten(exponent: int) -> str:
    """Return 10 with a raised exponent, in plain text."""
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def extent(*series: Array) -> tuple[float, float] | None:
    """Return the least and the greatest finite value; None if there is none."""
    usable = [s[np.abs(s) < _HUGE] for s in series]
    usable = [s for s in usable if len(s)]
    if not usable:
        return None
    low, high = min(s.min() for s in usable), max(s.max() for s in usable)
    return float(low), float(high)


def value_axis(*series: Array, margin: float = 0.06, size: float = 0.0) -> Axis:
    """Return an axis for values: rounding noise of a constant is flat on it.

    `size` is that of values they are compared with; what is nothing beside it is 0.
    """
    found = extent(*series)
    if found is None:
        return Axis(0.0, 1.0)
    low, high = found
    if max(abs(low), abs(high)) <= NOISE * size:
        low = high = 0.0
    else:
        size = max(abs(low), abs(high))
    if size < _TINY:
        return Axis(-1.0, 1.0)
    if high - low <= FLAT * size:
        # A tenth to both sides: enough to see that it is level, and at which value.
        low, high = low - 0.1 * size, high + 0.1 * size
    return _counted(low, high, margin)


def time_axis(t: Array) -> Axis:
    """Return an axis that the times fill from edge to edge."""
    found = extent(t)
    if found is None:
        return Axis(0.0, 1.0)
    low, high = found
    if high - low <= _TINY + 1e-14 * abs(high):
        half = 0.5 * abs(low) or 0.5
        low, high = low - half, high + half
    return _counted(low, high, 0.0, PLAIN_TIMES)


def noise_axis(values: Array, size: float, margin: float = 0.08) -> Axis:
    """Return an axis for what should be zero; `size` is that of what it comes from."""
    low, high = extent(values) or (0.0, 0.0)
    low, high = min(low, 0.0), max(high, 0.0)
    if high - low < _TINY:
        least = max(abs(size) * np.finfo(float).eps, _TINY)
        low, high = -least, least
    return _counted(low, high, margin)


def square_axis(low: float, high: float, length: float) -> Axis:
    """Return an axis of a given length, in the axis's own unit, around the values."""
    middle = low + (high - low) / 2
    return _counted(middle - length / 2, middle + length / 2, 0.0)


def _counted(low: float, high: float, margin: float, plain: range = PLAIN) -> Axis:
    span = high - low
    low, high = low - margin * span, high + margin * span
    offset = 0.0
    if span < OFFSET * max(abs(low), abs(high)):
        grain = 10.0 ** math.ceil(math.log10(span))
        offset = round((low + high) / 2 / grain) * grain
    exponent = math.floor(math.log10(max(abs(low - offset), abs(high - offset))))
    return Axis(low, high, offset, 0 if exponent in plain else exponent)


def _round_step(least: float) -> tuple[float, int]:
    """Return the next of 1, 2, 2.5, 5 * 10^k from `least` on, and its decimals."""
    exponent = math.floor(math.log10(least))
    factor = next(f for f in (1.0, 2.0, 2.5, 5.0, 10.0) if f >= _near(least, exponent))
    more = {2.5: 1, 10.0: -1}.get(factor, 0)
    return factor * 10.0**exponent, max(0, more - exponent)


def _near(least: float, exponent: int) -> float:
    # A little less: a step that is round but for its last bit need not grow.
    return least / 10.0**exponent * (1 - 1e-9)


def _number(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", "−")


@dataclass(frozen=True, slots=True)
class DecadeAxis(Axis):
    """An axis of powers of ten: its values are logarithms; `low` may be the larger."""

    def ticks(self, most: int) -> tuple[list[float], list[str]]:
        """Return about `most` places (as logarithms) and the powers at them."""
        low, high = sorted((self.low, self.high))
        first, last = math.ceil(low - 1e-9), math.floor(high + 1e-9)
        step = max(1, -(-(last - first + 1) // max(1, most)))
        decades = [k for k in range(first, last + 1) if k % step == 0]
        return [float(k) for k in decades], [power_of_ten(k) for k in decades]


@dataclass(frozen=True, slots=True)
class LogAxis(DecadeAxis):
    """An axis of logarithms with 1, 2, 5 written out where decades are too few."""

    def ticks(self, most: int) -> tuple[list[float], list[str]]:
        """Return about `most` places (as logarithms) and the numbers at them."""
        places, texts = super(LogAxis, self).ticks(most)
        if len(places) >= LEAST_TICKS:
            return places, texts
        low, high = sorted((self.low, self.high))
        decades = range(math.floor(low), math.ceil(high) + 1)
        for factors in ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 8)):
            values = [float(f"{f}e{k}") for k in decades for f in factors]
            shown = [v for v in values if low - 1e-9 <= math.log10(v) <= high + 1e-9]
            if len(shown) >= LEAST_TICKS:
                break
        skip = -(-len(shown) // max(1, most))
        return [math.log10(v) for v in shown[::skip]], [f"{v:g}" for v in shown[::skip]]
