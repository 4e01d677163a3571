"""Curves on Axes: gaps and single values, bands, marks of events and of the horizon."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from lagsim.outputs.figure import DPI, Pen, mark
from lagsim.outputs.scale import extent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from lagsim.run.observers.thinning import Array

GREY = "#444444"


class Mark(NamedTuple):
    """How events of a kind are called and marked at the top of a panel."""

    name: str
    top: Pen


# In the order of a legend. Filled where something holds from then on.
MARKS = {
    "impact": Mark("impacts", mark("|", 5.0, "#D55E00")),
    "zeno": Mark("comes to rest", mark("o", 3.2, GREY)),
    "stick": Mark("sticks", mark("v", 3.6, GREY)),
    "slip": Mark("slips", mark("v", 3.6, GREY, "white")),
    "contact": Mark("touches", mark("s", 3.2, GREY)),
    "release": Mark("lets go", mark("s", 3.2, GREY, "white")),
    "switch": Mark("switches", mark("|", 5.0, GREY)),
    "rank": Mark("rank is lost", mark("D", 2.8, GREY)),
}
OTHERS = Mark("events", mark("|", 5.0, "#888888"))
# Points from one mark to the next of its kind, beside its own width.
APART = 2.0
# Single values more than these have no dots.
MOST_DOTS = 40
# What lies past the horizon, where a row is no longer a forecast.
LOST = "#dddddd"

# Where a line covers this part of the area that it spans, its strokes lie a twentieth
# of an inch apart: it is a band, in which neither strokes nor dashes would be seen.
BAND = 0.5
# A jump in a pixel with more values than this is hidden in its band.
CROWD = 4
# Of a band: swings no broader than so many pixels.
NARROW = 10
# Lines that cover more than the area they span leave nothing to see.
BLOT = 1.5
# Of a line that such areas are asked of, in inches.
STROKE = 0.9 / 72

# Successive directions of a curve that turn by more than a right angle so often mean
# that its points are too far apart to be joined.
TOO_COARSE, ENOUGH = 0.25, 1000


def line(axes: Axes, x: ArrayLike, y: ArrayLike, pen: Pen, **more: Any) -> None:
    """Add a line; `Axes.plot` would measure it, though the scales are known."""
    axes.add_artist(Line2D(x, y, **pen, **more))


def curve(axes: Axes, x: Array, y: Array, pen: Pen) -> None:
    """Draw y against x; a value between two gaps becomes a dot."""
    line(axes, x, y, pen)
    seen = np.isfinite(x) & np.isfinite(y)
    linked = np.append(seen[:-1] & seen[1:], False)
    alone = seen & ~linked & ~np.roll(linked, 1)
    if alone.any():
        line(axes, x[alone], y[alone], mark("o", 2.5, pen["color"]), clip_on=False)


def series(axes: Axes, t: Array, values: Array, pen: Pen) -> None:
    """Draw values against time: as a curve, or as the band that it fills."""
    if not len(t) or ink(*inches(axes, t, values)) < BAND:
        curve(axes, t, values, pen)
        return
    seen = np.flatnonzero(np.isfinite(values))
    # A new piece begins at each gap, a new column at each pixel, and where the curve is
    # seen as such at a jump.
    piece = np.cumsum(np.diff(seen, prepend=seen[0]) > 1)
    pixel = np.floor(inches(axes, t[seen], values[seen])[0] * DPI)
    _, at, crowd = np.unique(pixel, return_inverse=True, return_counts=True)
    jump = (np.diff(t[seen], prepend=-np.inf) == 0.0) & (crowd[at] <= CROWD)
    jump &= np.diff(values[seen], prepend=-np.inf) != 0.0
    parts = pixel + (piece + np.cumsum(jump)) * 1e6
    columns = np.flatnonzero(np.diff(parts, prepend=-1.0))
    low = np.minimum.reduceat(values[seen], columns)
    high = np.maximum.reduceat(values[seen], columns)
    if piece[-1] == piece[0] and not jump.any():
        low, high = _envelope(low, high, values[seen])
    ends = np.flatnonzero(np.diff(piece[columns])) + 1
    t, low, high = (
        np.insert(part, ends, np.nan) for part in (t[seen][columns], low, high)
    )
    look = {"facecolor": (pen["color"], 0.45), "edgecolor": pen["color"]}
    axes.fill_between(t, low, high, **look, linewidth=0.5, zorder=1.8)


def _envelope(low: Array, high: Array, values: Array) -> tuple[Array, Array]:
    """Widen what is filled at each pixel to what a swing fills, if that is narrow.

    Else the pixels in which swings turn, and those between, would be seen as a pattern.
    """
    turns = int(np.count_nonzero(np.diff(np.sign(np.diff(values)))))
    swing = 2.0 * len(low) / max(turns, 1)
    if swing > NARROW:
        return low, high
    half = math.ceil(1.5 * swing)
    beside = np.lib.stride_tricks.sliding_window_view
    low, high = (np.pad(part, half, mode="edge") for part in (low, high))
    width = 2 * half + 1
    return beside(low, width).min(axis=1), beside(high, width).max(axis=1)


def path(axes: Axes, x: Array, y: Array, pen: Pen, trusted: int) -> None:
    """Draw y against x, by dots or lines; pale after the first `trusted` values."""
    if trusted < len(x):
        path(
            axes, x[max(trusted - 1, 0) :], y[max(trusted - 1, 0) :], _pale(pen), len(x)
        )
    if "marker" in pen:
        line(axes, x[:trusted], y[:trusted], pen | {"markersize": 1.2})
    else:
        curve(axes, x[:trusted], y[:trusted], pen)


def _pale(pen: Pen) -> Pen:
    return {k: LOST if k in ("color", "markerfacecolor") else v for k, v in pen.items()}


def point(axes: Axes, x: ArrayLike, y: ArrayLike, pen: Pen) -> None:
    """Draw a mark, or some, above the curves, whole at the edge too."""
    x, y = np.atleast_1d(x, y)
    if len(x):  # without any it had no place, and no layout were found
        line(axes, x, y, {"zorder": 2.5, **pen}, clip_on=False)


def shade(axes: Axes, horizon: float) -> None:
    """Shade what lies past a time."""
    low, high = axes.get_xlim()
    if horizon < high:
        look: Pen = {"facecolor": (LOST, 0.45), "edgecolor": LOST, "linewidth": 0.5}
        axes.axvspan(max(horizon, low), high, **look, zorder=0.2)


def marks(axes: Axes, times: Sequence[float], look: Mark) -> None:
    """Mark times by short ticks at the top; no two of them so near that they touch."""
    low, high = axes.get_xlim()
    inside = np.sort([t for t in times if low <= t <= high])
    across = axes.get_xaxis_transform()
    at = across.transform(np.column_stack((inside, np.zeros_like(inside))))[:, 0]
    size = float(look.top["markersize"])
    apart = APART if look.top["marker"] == "|" else size + APART
    shown = inside[_spaced(at / _dpi(axes), apart / 72)]
    tall = axes.bbox.height / _dpi(axes)
    level = np.full_like(shown, 1.0 - size / 144 / tall)
    line(axes, shown, level, look.top, transform=across, zorder=1.6, clip_on=False)


def _spaced(places: Array, apart: float) -> list[int]:
    """Return which of ascending places stay, the first of those nearer than `apart`."""
    kept = []
    k = 0
    while k < len(places):
        kept.append(k)
        k = max(k + 1, int(np.searchsorted(places, places[k] + apart)))
    return kept


def stems(axes: Axes, t: Array, values: Array, pen: Pen) -> None:
    """Draw what is 0 but at single times: a line up to each value, where few a dot."""
    line(axes, axes.get_xlim(), (0.0, 0.0), pen)
    there = np.isfinite(values) & (values != 0.0)
    t, values = t[there], values[there]
    none = np.full_like(t, np.nan)
    x = np.stack((t, t, none), axis=1).ravel()
    y = np.stack((np.zeros_like(t), values, none), axis=1).ravel()
    line(axes, x, y, pen)
    if len(t) <= MOST_DOTS:
        line(axes, t, values, mark("o", 2.0, pen["color"]), clip_on=False)


def inches(axes: Axes, x: Array, y: Array) -> tuple[Array, Array]:
    """Return where values lie on the sheet."""
    across, up = axes.transData.transform(np.column_stack((x, y))).T / _dpi(axes)
    return across, up


def _dpi(axes: Axes) -> float:
    """Return how many of what is drawn on are an inch."""
    return float(axes.figure.dpi)


def ink(x: Array, y: Array) -> float:
    """Return which part of the area that it spans a line covers, if not over itself."""
    length = float(np.nansum(np.hypot(np.diff(x), np.diff(y))))
    # A line along an axis spans no area, but has a width.
    sides = [max(high - low, 0.1) for low, high in (extent(x), extent(y))]
    return length * STROKE / math.prod(sides)


def dotted(x: Array, y: Array) -> bool:
    """Whether a path, given in inches, is better shown by its points than by lines.

    It is when lines would only fill an area, and when the points are too far apart, so
    that chords would be seen and not the curve.
    """
    if min(high - low for low, high in (extent(x), extent(y))) < STROKE:
        return False  # along an axis every chord is the curve
    dx, dy = np.diff(x), np.diff(y)
    turns = dx[1:] * dx[:-1] + dy[1:] * dy[:-1] < 0
    coarse = len(turns) >= ENOUGH and float(np.mean(turns)) > TOO_COARSE
    return coarse or ink(x, y) > BLOT
