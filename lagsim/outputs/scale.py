"""Scales of axes: range, ticks, units of their numbers, label."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from matplotlib.ticker import (
    FixedLocator,
    FuncFormatter,
    Locator,
    LogFormatterSciNotation,
    MaxNLocator,
    ScalarFormatter,
    SymmetricalLogLocator,
)

from lagsim.outputs.letters import SUPERSCRIPTS, cut_text, mathtext
from lagsim.run.observers.thinning import FAINT
from lagsim.tolerances import COMPUTED_ZERO, OVERFLOW, ZERO_BESIDE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    from lagsim.run.observers.thinning import Array

    # Least and greatest value of the abscissa, and of the ordinate.
    Ends: TypeAlias = Sequence[tuple[float, float]]

# With fewer ticks than this, a scale cannot be read off.
LEAST_TICKS = 3
STEPS = (1, 2, 2.5, 5, 10)
# Letters per inch of a label at the side, and of one below or above; inches by which
# they may exceed the height, or the width, of the panel; least letters of a name.
OF_LABELS, ABOVE, SPARE, SPARE_ABOVE, LEAST_NAME = 12, 15, 0.4, 0.25, 7
# Ratio of the ends above which ticks of a logarithmic scale are powers of ten.
DECADES = 1000.0
# Decades up to which all multiples of a power of ten have a number. Otherwise 1, 2, 3,
# 4 and 6 times the power have one; without room between 3 and 4, 1, 2 and 5 times.
FULL = 0.4
FEW = {1.0, 2.0, 5.0}
# Room of a number in ticks of matplotlib, which are two lines high.
ROOM = 0.55

# Longest part of the time that a spike lasts, and least ratio of its height to all
# other values.
SPIKE, HIGH = 0.02, 30.0
# A curve grows without bound if its greatest value is this many times its median, and
# occurs after this part of the time.
EXPLOSION, LAST = 1e6, 0.9
# Length of the linear part of the scale of such a curve, in decades.
FEWEST = 0.5
ROUND = (1.0, 2.0, 5.0, 10.0)


class Scale(NamedTuple):
    """A range from `low` to `high`: linear, logarithmic, or linear near 0 only.

    Attributes
    ----------
    low, high : float
        Ends; `low` may be the larger if `log`.
    log : bool
        Whether the scale is logarithmic.
    linear : float
        If not 0, the scale is linear up to this absolute value, logarithmic beyond it.
    share : float
        Length of the linear part on the axis, in decades of the logarithmic part.
    """

    low: float
    high: float
    log: bool = False
    linear: float = 0.0
    share: float = 1.0

    def apply(self, axes: Axes, direction: Literal["x", "y"]) -> None:
        """Set this scale on an axis of `axes`, with ticks by matplotlib."""
        across = direction == "x"
        axis: Axis = axes.xaxis if across else axes.yaxis
        choose = axes.set_xscale if across else axes.set_yscale
        # Numbers side by side take twice the room that matplotlib gives them.
        most = min(9, max(2, axis.get_tick_space() // (2 if across else 1)))
        if self.linear:
            choose("symlog", linthresh=self.linear, linscale=self.share)
            axis.set_major_locator(self._beyond(most))
            axis.set_major_formatter(FuncFormatter(lambda x, _: read_off(x)))
        elif self.log:
            choose("log")
            axis.set_major_formatter(Powers())
            axis.set_minor_formatter(Powers())
        else:
            axis.set_major_locator(
                MaxNLocator(most, steps=STEPS, min_n_ticks=LEAST_TICKS)
            )
        (axes.set_xlim if across else axes.set_ylim)(self.low, self.high)

    def _beyond(self, most: int) -> Locator:
        """Return the ticks of a scale that is logarithmic beyond `linear`.

        These are at 0, at powers of ten, and at the ends of a long linear part.

        most : the largest number of ticks of one sign.
        """
        ends = self.low, self.high
        decades = math.log10(max(map(abs, ends)) / self.linear) / most
        powers = SymmetricalLogLocator(base=10.0, linthresh=self.linear)
        powers.set_params(numticks=most)
        # As far from the linear part as from each other.
        least = self.linear * 10.0 ** max(0.6, decades)
        found = [x for x in powers.tick_values(*ends) if abs(x) >= least]
        found += [-self.linear, 0.0, self.linear] if self.share > decades else [0.0]
        return FixedLocator(sorted(x for x in found if self.low <= x <= self.high))


def size_of(axes: Axes) -> tuple[float, float]:
    """Return width and height of a panel in inches; approximate before the layout."""
    dpi = axes.figure.dpi
    return axes.bbox.width / dpi, axes.bbox.height / dpi


def per_inch(axes: Axes, ends: Ends) -> float:
    """Return the data units per inch with which both ranges fit into a panel.

    Both axes then have one scale.

    ends : the ranges of the horizontal and vertical axis.
    """
    sides = zip(ends, size_of(axes), strict=True)
    return max((high - low) / side for (low, high), side in sides)


def set_equal_scales(axes: Axes, ends: Ends, each: float) -> None:
    """Set both axes of a panel to one scale, centred on given ranges.

    ends : the ranges of the horizontal and vertical axis.
    each : data units per inch.
    """
    across, up = (
        Scale(middle - half, middle + half)
        for (low, high), side in zip(ends, size_of(axes), strict=True)
        for middle, half in [(0.5 * (low + high), 0.5 * each * side)]
    )
    across.apply(axes, "x")
    up.apply(axes, "y")


def name_axis(axis: Axis, name: str, unit: str = "", text: Text | None = None) -> None:
    """Label an axis with name, unit, power of ten and offset of its numbers.

    The name is cut to the length of the axis.

    text : the Text above the panel that is set; by default the label of the axis.
    """
    width, height = size_of(axis.axes)
    across = text is not None or axis is axis.axes.xaxis
    room = ABOVE * (width + SPARE_ABOVE) if across else OF_LABELS * (height + SPARE)
    label = Label(text or axis.label, name, unit, int(room))
    if axis.get_scale() == "linear":
        axis.set_major_formatter(Counting(label))
        axis.offsetText.set_visible(False)


class Label:
    """Label of an axis, whose name is cut such that it has at most `most` letters."""

    def __init__(self, text: Text, name: str, unit: str, most: int) -> None:
        self._text, self._named, self._most = text, (name, unit), most
        self.write()

    def write(self, offset: str = "", scale: str = "") -> None:
        """Set the label's text, with an offset and a power of ten."""
        name, unit = self._named
        inside = f"{scale} {unit}".strip()
        if name and inside:
            inside = f" ({inside})"
        rest = offset + inside
        most = max(self._most - len(rest), LEAST_NAME)
        self._text.set_text(mathtext(cut_text(name, most) + rest))


class Counting(ScalarFormatter):
    """Formatter that writes offset and power of ten of the ticks into the axis label.

    (matplotlib writes only ten digits of the offset, which are too few.)
    """

    def __init__(self, label: Label) -> None:
        super().__init__()
        self._label = label

    def set_locs(self, locs: Any) -> None:
        """Set the places of ticks, and write their offset and power of ten."""
        super().set_locs(locs)
        # Its name before matplotlib 3.11 will be removed in 3.13.
        power = vars(self).get("_orderOfMagnitude", vars(self).get("orderOfMagnitude"))
        offset = ""
        if self.offset:
            # Fifteen digits hold it exactly: it is a multiple of the span's own size.
            offset = f" {'−' if self.offset > 0 else '+'} {abs(self.offset):.15g}"
        self._label.write(offset, power_of_ten(int(power)) if power else "")


class Powers(LogFormatterSciNotation):
    """Formatter of powers of ten, or of plain numbers on a scale of few decades."""

    def set_locs(self, locs: Any = None) -> None:
        """Select the ticks with a number: powers of ten alone, if there are several.

        matplotlib before 3.11 counts decades: a scale from 0.02 to 0.5 had one number.
        """
        assert self.axis is not None
        low, high = sorted(self.axis.get_view_interval())
        if low > 0.0:
            powers = math.floor(math.log10(high)) - math.ceil(math.log10(low)) + 1
            # Finite: with inf all ticks have a number, on any scale.
            self.minor_thresholds = (0.0 if powers > 1 else OVERFLOW, FULL)
        super().set_locs(locs)
        if low > 0.0:
            decades = math.log10(high / low)
            gap = math.log10(4 / 3) * self.axis.get_tick_space()
            if powers < 2 and decades > FULL and gap < ROOM * decades:
                self._sublabels = FEW

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the text at a tick; "" if the tick is not finite."""
        text = str(super().__call__(x, pos)) if math.isfinite(x) else ""
        assert self.axis is not None
        low, high = self.axis.get_view_interval()
        return read_off(x) if text and high < DECADES * low else text


def read_off(value: float, digits: int = 4) -> str:
    """Return a number with a few significant digits, as in print: `6.02 × 10²³`."""
    short = f"{value:.{digits}g}"
    if "e" in short:
        front, _, power = f"{value:.{digits - 1}e}".partition("e")
        front = front.rstrip("0").rstrip(".")
        times = "" if front in ("1", "-1") else f"{front} × "
        sign = "-" if front == "-1" else ""
        short = f"{sign}{times}{power_of_ten(int(power))}"
    return short.replace("-", "−")


def power_of_ten(exponent: int) -> str:
    """Return 10 with a raised exponent, in plain text.

    Examples
    --------
    >>> power_of_ten(-3)
    '10⁻³'
    """
    return "10" + str(exponent).translate(SUPERSCRIPTS)


def finite_range(
    *series: Array, empty: tuple[float, float] = (0.0, 0.0)
) -> tuple[float, float]:
    """Return the least and the greatest finite value of arrays; `empty` without any."""
    usable = [s[np.abs(s) < OVERFLOW] for s in series]
    usable = [s for s in usable if len(s)]
    if not usable:
        return empty
    return float(min(s.min() for s in usable)), float(max(s.max() for s in usable))


def greatest(values: Array) -> float:
    """Return the greatest absolute value among finite values; 0 without any."""
    return max(map(abs, finite_range(values)))


def value_scale(*series: Array, margin: float = 0.06, size: float = 0.0) -> Scale:
    """Return a linear scale for values, on which rounding noise is flat.

    Parameters
    ----------
    *series : ndarray, shape (n,)
    margin : float
        Free part of the range at both ends.
    size : float
        Size of other values in the unit; values that are rounding errors beside it are
        0.
    """
    low, high = finite_range(*series, empty=(0.0, 1.0))
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


def is_level(*series: Array) -> bool:
    """Whether all values of the arrays are constant up to rounding errors."""
    low, high = finite_range(*series)
    return high - low <= COMPUTED_ZERO * max(abs(low), abs(high))


def time_scale(t: Array) -> Scale:
    """Return a scale that the times fill from edge to edge."""
    low, high = finite_range(t, empty=(0.0, 1.0))
    if high - low <= FAINT + 1e-14 * abs(high):
        half = 0.5 * abs(low) or 0.5
        low, high = low - half, high + half
    return Scale(low, high)


def noise_scale(values: Array, size: float) -> Scale:
    """Return a scale for residuals of a quantity, on which rounding errors look small.

    size : the size of the quantity.
    """
    low, high = finite_range(values)
    low, high = min(low, 0.0), max(high, 0.0)
    if high - low < FAINT:
        high = max(abs(size) * np.finfo(float).eps, FAINT)
        low = -high
    free = 0.08 * (high - low)
    return Scale(low - free, high + free)


def log_scale(*series: Array, margin: float = 0.06, least: float = 0.1) -> Scale:
    """Return a logarithmic scale with a free margin at both ends.

    The margin is `margin` times the decades of the values, plus `least` decades.
    """
    low, high = finite_range(*(s[s > 0.0] for s in series), empty=(1.0, 10.0))
    low = max(low, FAINT)
    high = max(low, high)
    free = 10.0 ** (margin * (math.log10(high) - math.log10(low)) + least)
    # Past the largest and the smallest double there is no axis.
    return Scale(max(low / free, 1e-305), min(high * free, 1e305), log=True)


def spread_scale(*drawn: tuple[Array, Array], size: float = 0.0) -> Scale:
    """Return a scale for curves against time, on which a spike hides no other values.

    A spike, or unbounded growth, would hide all other values on a linear scale: the
    scale is then logarithmic beyond some size, or, for growth of one sign, everywhere.
    """
    series = [values for _, values in drawn]
    plain = value_scale(*series, size=size)
    sizes = np.abs(np.concatenate(series))
    weights = np.concatenate([_durations(t) for t, _ in drawn])
    finite = np.isfinite(sizes)
    sizes, weights = sizes[finite], weights[finite]
    most = float(sizes.max(initial=0.0))
    if most <= 0.0 or not math.isfinite(most) or most <= 1e-9 * size:
        return plain
    usual = _quantile(sizes, weights, 1.0 - SPIKE)
    if 0.0 < usual < most / HIGH:
        return _beyond(plain, _round(usual), most)
    usual = _quantile(sizes, weights, 0.5)
    if not 0.0 < usual < most / EXPLOSION or not _ends(drawn):
        return plain
    if all(np.nanmin(values) > 0.0 for values in series):
        return log_scale(*series)
    least = max(_quantile(sizes, weights, 0.1), most * 1e-30)
    return _beyond(plain, _round(least), most, FEWEST)


def _durations(t: Array) -> Array:
    """Return the duration that each row represents, (n,).

    Impacts of other bodies add many rows within a short time.
    """
    if len(t) < 2 or not t[-1] > t[0]:
        return np.ones(len(t))
    between = (t[1:] + t[:-1]) / 2.0
    return np.asarray(np.diff(np.concatenate([t[:1], between, t[-1:]])))


def _quantile(values: Array, weights: Array, part: float) -> float:
    """Return the value below which the weights of values are `part` of all weights.

    values, weights : (n,), n > 0, with weights that are not all 0.
    """
    order = np.argsort(values, kind="stable")
    up_to = np.cumsum(weights[order]) - 0.5 * weights[order]
    return float(np.interp(part * np.sum(weights), up_to, values[order]))


def _ends(drawn: tuple[tuple[Array, Array], ...]) -> bool:
    """Whether at least one curve is largest near its end, as in growth, not at a spike.

    drawn : the curves (times, values).
    """
    for t, values in drawn:
        sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
        largest = t[int(sizes.argmax())]
        if largest - t[0] > LAST * (t[-1] - t[0]):
            return True
    return False


def _beyond(plain: Scale, linear: float, most: float, share: float = 0.0) -> Scale:
    """Return a scale that is linear up to `linear`, and logarithmic beyond it.

    plain : the linear scale of the values.
    most : the largest |value|.
    share : length of the linear part in decades; by default a little shorter than the
        logarithmic part.
    """
    decades = max(math.log10(most / linear), 1.0)
    # The margin of a linear scale may be larger than all values on the other side.
    low = plain.low if -plain.low > 0.1 * plain.high else -linear
    high = plain.high if plain.high > -0.1 * plain.low else linear
    return Scale(1.3 * low, 1.3 * high, linear=linear, share=share or 0.9 * decades)


def _round(size: float) -> float:
    """Return the least round number, such as 1, 2 or 5 times 10^k, not below `size`."""
    power = 10.0 ** math.floor(math.log10(size))
    return next((x * power for x in ROUND if x * power >= size), 10.0 * power)
