"""Scales of axes: range, ticks, units of their numbers, label."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from contextlib import nullcontext
from typing import TYPE_CHECKING, Literal, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.ticker import (
    FixedLocator,
    Formatter,
    FuncFormatter,
    Locator,
    LogLocator,
    MaxNLocator,
    NullLocator,
    ScalarFormatter,
    SymmetricalLogLocator,
)

from lagsim.outputs.letters import SUPERSCRIPTS
from lagsim.run.observers.thinning import FAINT
from lagsim.tolerances import COMPUTED_ZERO, OVERFLOW, ZERO_BESIDE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

    from lagsim.run.observers.thinning import Array

# Powers of ten from which on they stand in the label and not at the ticks.
PLAIN, PLAIN_TIMES, BRIEF = (-3, 4), (-3, 6), (-2, 4)

# With fewer ticks than this, a scale cannot be read off.
LEAST_TICKS = 3

# Inches: what a number across takes, in a panel that is no wider than the second.
ROOMY, BRIEFLY, CROWDED = 0.67, 0.38, 3.0
# Beside a panel no wider than this there is room for a number of six characters:
# digits that ticks share, if there are so many, stand in the label.
NARROW, SHARED = 2.0, 2

# A spike lasts for no more than this part of the time, and is so many times as high as
# anything else.
SPIKE, HIGH = 0.02, 30.0
# What ends so many times as large as it mostly was, at the end, has exploded.
EXPLOSION, LAST = 1e6, 0.9
# Of decades: what is shown of those that a spike, or growth, began with.
FEWEST = 0.5
ROUND = (1.0, 2.0, 5.0, 10.0)


class Scale(NamedTuple):
    """A range from `low` to `high`, linear or of powers of ten.

    Attributes
    ----------
    plain : powers of ten beyond which numbers are counted in them.
    log : whether it is logarithmic; then `low` may be the larger.
    linear : beyond this size it is, to both sides, if that is not 0.
    share : of how many decades the length of `linear` is.
    power : the power of ten that numbers are counted in; None where that is free.
    """

    low: float
    high: float
    plain: tuple[int, int] = PLAIN
    log: bool = False
    linear: float = 0.0
    share: float = 1.0
    power: int | None = None

    def put(
        self,
        axes: Axes,
        direction: Literal["x", "y"],
        most: int | None = None,
        *,
        bare: bool = False,
    ) -> None:
        """Give Axes this range and at most so many ticks, by default as many as fit.

        What numbers count in stands in the `label`; `bare` axes have none.
        """
        across = direction == "x"
        axis: Axis = axes.xaxis if across else axes.yaxis
        choose = axes.set_xscale if across else axes.set_yscale
        if self.linear:
            choose("symlog", linthresh=self.linear, linscale=self.share)
        elif self.log:
            choose("log")
        (axes.set_xlim if across else axes.set_ylim)(self.low, self.high)
        scale = self
        if most is None:
            width, height = size_of(axes)
            most = max(3, min(7, math.ceil(3.4 * height)))
            if across and width < CROWDED:
                most, scale = max(2, int(width / BRIEFLY)), self._replace(plain=BRIEF)
            elif across:
                most = int(width / ROOMY)
        elif most and not self.log:
            most = max(most, LEAST_TICKS)
        briefly = mpl.rc_context({"axes.formatter.offset_threshold": SHARED})
        narrow = not across and size_of(axes)[0] <= NARROW
        with briefly if narrow else nullcontext():
            locator, formatter = scale.ticks(most)
        axis.set_major_locator(locator)
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(formatter)
        axis.offsetText.set_visible(False)
        if bare:
            axis.set_tick_params(labelbottom=False)

    def ticks(self, most: int) -> tuple[Locator, Formatter]:
        """Return at most so many ticks, and how their numbers are written."""
        if not most:
            return NullLocator(), ScalarFormatter()
        read = FuncFormatter(lambda x, _: read_off(x))
        if self.linear:
            return self._beyond(most), read
        if self.log:
            low, high = sorted((math.log10(self.low), math.log10(self.high)))
            if math.floor(high) - math.ceil(low) + 1 >= LEAST_TICKS:
                return LogLocator(numticks=most), FuncFormatter(_as_power)
            subs = (1.0, 2.0, 5.0) if high - low > 1.0 else (1, 1.5, 2, 3, 4, 5, 6, 8)
            return LogLocator(subs=subs, numticks=most), read
        steps, least = [1, 2, 2.5, 5, 10], min(most, LEAST_TICKS)
        locator = MaxNLocator(max(1, most - 1), steps=steps, min_n_ticks=least)
        formatter = Counting()
        if self.power == 0:
            formatter.set_scientific(False)
        else:
            limits = self.plain if self.power is None else (self.power, self.power)
            formatter.set_powerlimits(limits)
        return locator, formatter

    def _beyond(self, most: int) -> Locator:
        """Return ticks of both parts: 0, the ends of the linear one, powers beyond."""
        powers = SymmetricalLogLocator(base=10.0, linthresh=self.linear)
        powers.set_params(numticks=most)
        ends = self.low, self.high
        decades = math.log10(max(map(abs, ends)) / self.linear)
        # As far from the linear part as from each other.
        least = self.linear * 10.0 ** max(0.6, decades / most)
        found = [x for x in powers.tick_values(*ends) if abs(x) >= least]
        found += [-self.linear, 0.0, self.linear]
        return FixedLocator(sorted(x for x in found if self.low <= x <= self.high))


def size_of(axes: Axes) -> tuple[float, float]:
    """Return width and height of a panel in inches."""
    dpi = axes.figure.dpi
    return axes.bbox.width / dpi, axes.bbox.height / dpi


class Counting(ScalarFormatter):
    """Numbers that count from an offset in powers of ten, both in the label."""

    def counted(self) -> tuple[float, int]:
        """Return the offset, and the power of ten that the numbers count in."""
        # Its name of before 3.11 will go in 3.13.
        name = "_orderOfMagnitude"
        power = vars(self).get(name, vars(self).get("orderOfMagnitude", 0))
        return float(self.offset), int(power)


def _as_power(value: float, _: object) -> str:
    # A locator looks for ticks past the ends too, where there may be no number left.
    known = 0.0 < value < math.inf
    return power_of_ten(round(math.log10(value))) if known else ""


def label(axis: Axis, name: str, unit: str = "") -> str:
    """Return what an axis shows, from where its ticks count, in what, and the unit."""
    formatter = axis.get_major_formatter()
    scale = ""
    if isinstance(formatter, Counting):
        formatter.set_locs(list(axis.get_majorticklocs()))
        offset, exponent = formatter.counted()
        if offset:
            # Fifteen digits hold it exactly: it is a multiple of the span's own size.
            sign = "−" if offset > 0 else "+"
            name = f"{name} {sign} {abs(offset):.15g}"
        scale = power_of_ten(exponent) if exponent else ""
    inside = " ".join(part for part in (scale, unit) if part)
    return f"{name} ({inside})" if inside else name


def read_off(value: float, digits: int = 4) -> str:
    """Return a number in a few digits, as one writes it by hand."""
    short = f"{value:.{digits}g}"
    if "e" in short:
        front, _, power = f"{value:.{digits - 1}e}".partition("e")
        front = front.rstrip("0").rstrip(".")
        times = "" if front in ("1", "-1") else f"{front} × "
        sign = "-" if front == "-1" else ""
        short = f"{sign}{times}{power_of_ten(int(power))}"
    return short.replace("-", "−")


def power_of_ten(exponent: int) -> str:
    """Return 10 with a raised exponent, in plain text."""
    return "10" + str(exponent).translate(SUPERSCRIPTS)


def extent(
    *series: Array, empty: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Return the least and the greatest finite value; `empty` where there is none."""
    usable = [s[np.abs(s) < OVERFLOW] for s in series]
    usable = [s for s in usable if len(s)]
    if not usable:
        return empty
    return float(min(s.min() for s in usable)), float(max(s.max() for s in usable))


def greatest(values: Array) -> float:
    """Return the greatest size among finite values; 0 where there are none."""
    return max(map(abs, extent(values)))


def value_scale(*series: Array, margin: float = 0.06, size: float = 0.0) -> Scale:
    """Return a scale for values: rounding noise of a constant is flat on it.

    `size` is that of values they are compared with; what is nothing beside it is 0.
    """
    low, high = extent(*series, empty=(0.0, 1.0))
    if max(abs(low), abs(high)) <= ZERO_BESIDE * size:
        low = high = 0.0
    else:
        size = max(abs(low), abs(high))
    if size < FAINT:
        return Scale(-1.0, 1.0)
    if high - low <= COMPUTED_ZERO * size:
        # A tenth to both sides: enough to see that it is level, and at which value.
        low, high = low - 0.1 * size, high + 0.1 * size
    free = margin * (high - low)
    return Scale(low - free, high + free)


def with_one_power(scales: Sequence[Scale]) -> list[Scale]:
    """Return scales whose numbers are counted in one power of ten."""
    spans = [s.high - s.low for s in scales]
    sizes = [
        size if size < 1e4 * span else span
        for s, span in zip(scales, spans, strict=True)
        if (size := max(abs(s.low), abs(s.high)))
    ]
    power = math.floor(math.log10(max(sizes, default=1.0)))
    power = 0 if PLAIN[0] < power < PLAIN[1] else power
    return [s._replace(power=power) for s in scales]


def time_scale(t: Array) -> Scale:
    """Return a scale that the times fill from edge to edge."""
    low, high = extent(t, empty=(0.0, 1.0))
    if high - low <= FAINT + 1e-14 * abs(high):
        half = 0.5 * abs(low) or 0.5
        low, high = low - half, high + half
    return Scale(low, high, PLAIN_TIMES)


def noise_scale(values: Array, size: float) -> Scale:
    """Return a scale for what should be zero; `size` is that of what it comes from."""
    low, high = extent(values)
    low, high = min(low, 0.0), max(high, 0.0)
    if high - low < FAINT:
        high = max(abs(size) * np.finfo(float).eps, FAINT)
        low = -high
    free = 0.08 * (high - low)
    return Scale(low - free, high + free)


def log_scale(*series: Array, margin: float = 0.06, least: float = 0.1) -> Scale:
    """Return a scale of powers of ten; of `margin` and `least` decades is left free."""
    low, high = extent(*(s[s > 0.0] for s in series), empty=(1.0, 10.0))
    low = max(low, FAINT)
    high = max(low, high)
    free = 10.0 ** (margin * (math.log10(high) - math.log10(low)) + least)
    # Past the largest and the smallest double there is no axis.
    return Scale(max(low / free, 1e-305), min(high * free, 1e305), log=True)


def spread_scale(*drawn: tuple[Array, Array], size: float = 0.0) -> Scale:
    """Return a scale for curves (times, values) against time, as `value_scale` does.

    One spike, or growth without end, would be a line at 0 and a corner on a linear
    scale: powers of ten count from some size on; growth of one sign has no other.
    """
    series = [values for _, values in drawn]
    plain = value_scale(*series, size=size)
    sizes = np.abs(np.concatenate(series))
    sizes = sizes[np.isfinite(sizes)]
    most = float(sizes.max(initial=0.0))
    if most <= 0.0 or not math.isfinite(most) or most <= 1e-9 * size:
        return plain
    usual = float(np.quantile(sizes, 1.0 - SPIKE))
    if 0.0 < usual < most / HIGH:
        return _beyond(plain, _round(usual), most)
    usual = float(np.median(sizes))
    if not 0.0 < usual < most / EXPLOSION or not _ends(drawn):
        return plain
    if all(np.nanmin(values) > 0.0 for values in series):
        return log_scale(*series)
    least = max(float(np.quantile(sizes, 0.1)), most * 1e-30)
    return _beyond(plain, _round(least), most, FEWEST)


def _ends(drawn: tuple[tuple[Array, Array], ...]) -> bool:
    """Return whether the largest value is among the last."""
    for t, values in drawn:
        sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
        largest = t[int(sizes.argmax())]
        if largest - t[0] > LAST * (t[-1] - t[0]):
            return True
    return False


def _beyond(plain: Scale, linear: float, most: float, share: float = 0.0) -> Scale:
    """Return a scale with powers of ten beyond a size, in half of it at most."""
    decades = max(math.log10(most / linear), 1.0)
    # The margin of a linear scale may be larger than all that is on the other side.
    low = plain.low if -plain.low > 0.1 * plain.high else -linear
    high = plain.high if plain.high > -0.1 * plain.low else linear
    return Scale(1.3 * low, 1.3 * high, linear=linear, share=share or 0.9 * decades)


def _round(size: float) -> float:
    """Return a round number that is not less."""
    power = 10.0 ** math.floor(math.log10(size))
    return next((x * power for x in ROUND if x * power >= size), 10.0 * power)
