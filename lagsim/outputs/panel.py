"""A frame with two scales on a sheet, what is drawn in it, and names for its lines."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.transforms import Bbox

from lagsim.outputs.axis import extent
from lagsim.outputs.sheet import (
    BLACK,
    DIM,
    DPI,
    FAINT,
    SMALL,
    Pen,
    Sheet,
    fitted,
    text_width,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.outputs.axis import Axis
    from lagsim.run.observers.thinning import Array

EVENTS = Pen("#888888", (1.0, 1.5), width=0.6)
# What lies past the horizon, where a row is no longer a forecast.
LOST = Pen("#dddddd")

# Of a legend: the piece of line with the space after it, and the space between names.
SAMPLE, GAP = 0.34, 0.18

# Where a line covers this part of the area that it spans, its strokes lie a twentieth
# of an inch apart: it is a band, in which neither strokes nor dashes would be seen.
BAND = 0.5


class Panel:
    """A frame on a sheet, with a scale for each direction."""

    def __init__(
        self,
        sheet: Sheet,
        place: tuple[float, float, float, float],
        x: Axis,
        y: Axis,
    ) -> None:
        """Place it: left, top, width, height."""
        self.sheet, self.x, self.y = sheet, x, y
        self.left, self.top, self.width, self.height = place
        self.bottom = self.top + self.height
        above = sheet.height - self.top
        self.clip = Bbox.from_bounds(
            self.left, above - self.height, self.width, self.height
        )

    def across(self, x: Array) -> Array:
        """Return where values of x lie, in inches."""
        return self.left + (x - self.x.low) / (self.x.high - self.x.low) * self.width

    def down(self, y: Array) -> Array:
        """Return where values of y lie, in inches."""
        return self.bottom - (y - self.y.low) / (self.y.high - self.y.low) * self.height

    def frame(self, most: tuple[int, int], *, numbers_below: bool = True) -> None:
        """Draw frame, grid and ticks, at most so many of them in each direction."""
        left, right = self.left, self.left + self.width
        ticks, texts = self.x.ticks(most[0])
        across = self.across(np.array(ticks, float))
        levels, level_texts = self.y.ticks(most[1])
        down = self.down(np.array(levels, float))
        grid_x = [v for place in across for v in (place, place, np.nan)]
        grid_y = [self.top, self.bottom, np.nan] * len(across)
        grid_x += [left, right, np.nan] * len(down)
        grid_y += [v for place in down for v in (place, place, np.nan)]
        self.sheet.line(
            np.array(grid_x), np.array(grid_y), Pen(FAINT, width=0.4), layer=1.0
        )
        self.sheet.line(
            np.array([left, right, right, left, left]),
            np.array([self.top, self.top, self.bottom, self.bottom, self.top]),
            Pen(DIM, width=0.6),
            layer=3.0,
        )
        if numbers_below:
            for place, text in zip(across, texts, strict=True):
                self.sheet.text(
                    place, self.bottom + 0.13, text, size=SMALL, align="center"
                )
        for place, text in zip(down, level_texts, strict=True):
            self.sheet.text(
                left - 0.05,
                place,
                text,
                size=SMALL,
                align="right",
                stand="center_baseline",
            )

    def curve(self, x: Array, y: Array, pen: Pen) -> None:
        """Draw y against x; a value between two gaps becomes a dot."""
        across, down = self.across(x), self.down(y)
        self.sheet.line(across, down, pen, self.clip)
        seen = np.isfinite(across) & np.isfinite(down)
        linked = seen[:-1] & seen[1:]
        alone = seen.copy()
        alone[:-1] &= ~linked
        alone[1:] &= ~linked
        if alone.any():
            dot = Pen(pen.colour, marker="o", size=2.5)
            self.sheet.line(across[alone], down[alone], dot)

    def series(self, t: Array, values: Array, pen: Pen) -> None:
        """Draw values against time: as a curve, or as the band that it fills."""
        across, down = self.across(t), self.down(values)
        if ink(across, down) < BAND:
            self.curve(t, values, pen)
            return
        seen = np.isfinite(down)
        index = np.flatnonzero(seen)
        # A new piece begins at each gap, a new column at each pixel.
        piece = np.cumsum(np.diff(index, prepend=index[0]) > 1)
        pixel = np.floor(across[seen] * DPI)
        columns = np.flatnonzero(np.diff(pixel + piece * 1e6, prepend=-1.0))
        low = np.minimum.reduceat(down[seen], columns)
        high = np.maximum.reduceat(down[seen], columns)
        x, piece = across[seen][columns], piece[columns]
        for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(piece)) + 1):
            self.sheet.area(x[part], low[part], high[part], pen, self.clip)

    def band(self, x: Array, low: Array, high: Array, pen: Pen) -> None:
        """Fill what lies between two curves, below everything else."""
        down = self.down(low), self.down(high)
        self.sheet.area(self.across(x), *down, pen, self.clip, layer=0.8)

    def dots(self, x: Array, y: Array, pen: Pen) -> None:
        """Draw points that no line joins."""
        dot = Pen(pen.colour, marker=".", size=1.2)
        self.sheet.line(self.across(x), self.down(y), dot, self.clip)

    def mark(self, x: float, y: float, mark: Pen, colour: str) -> None:
        """Draw one mark above the curves, its edge in this colour."""
        fill = mark.fill or colour
        pen = replace(mark, colour=colour, fill=fill)
        place = self.across(np.array([x])), self.down(np.array([y]))
        self.sheet.line(*place, pen, layer=2.5)

    def path(self, x: Array, y: Array, pen: Pen, trusted: int) -> None:
        """Draw y against x, by dots or lines; pale after the first `trusted` values."""
        draw = self.dots if pen.marker else self.curve
        if trusted < len(x):
            draw(x[max(trusted - 1, 0) :], y[max(trusted - 1, 0) :], _pale(pen))
        draw(x[:trusted], y[:trusted], pen)

    def beyond(self, x: float) -> None:
        """Shade what lies past x."""
        if x < self.x.high:
            left = max(float(self.across(np.array([x]))[0]), self.left)
            across = np.array([left, self.left + self.width])
            low, high = np.full(2, self.top), np.full(2, self.bottom)
            self.sheet.area(across, low, high, LOST, self.clip, layer=0.5)

    def times(self, marks: Sequence[float], most_lines: int = 40) -> None:
        """Mark times: by thin lines, or by short ticks at the top where many."""
        inside = [t for t in marks if self.x.low <= t <= self.x.high]
        reach = self.height if len(inside) <= most_lines else 0.06
        across = self.across(np.array(inside, float))
        x = np.stack((across, across, np.full_like(across, np.nan)), axis=1).ravel()
        y = np.tile([self.top, self.top + reach, np.nan], len(across))
        self.sheet.line(x, y, EVENTS, layer=1.5)


def _pale(pen: Pen) -> Pen:
    return replace(pen, colour=LOST.colour)


def ink(x: Array, y: Array) -> float:
    """Return which part of the area that it spans a line covers, if not over itself."""
    found = extent(x), extent(y)
    length = float(np.nansum(np.hypot(np.diff(x), np.diff(y))))
    # A line along an axis spans no area, but has a width.
    sides = [max(f[1] - f[0], 0.1) for f in found if f]
    return length * BLACK.width / 72 / math.prod(sides)


def legend(
    sheet: Sheet, x: float, y: float, entries: Sequence[tuple[str, Pen]], room: float
) -> None:
    """Write a row of names, each after a piece of its line, in `room` inches."""
    names = [fitted(name, room, SMALL) for name, _ in entries]
    wanted = [SAMPLE + text_width(name, SMALL) + GAP for name in names]
    if sum(wanted) > room:
        share = room / len(names) - SAMPLE - GAP
        names = [fitted(name, share, SMALL) for name in names]
    for name, (_, pen) in zip(names, entries, strict=True):
        sample(sheet, x, y, pen)
        sheet.text(x + SAMPLE, y, name, size=SMALL)
        x += SAMPLE + text_width(name, SMALL) + GAP


def sample(sheet: Sheet, x: float, y: float, pen: Pen) -> None:
    """Draw a piece of a line, or one of its marks, before a legend's name."""
    level = y - 0.04
    if pen.marker == ".":
        sheet.line(np.linspace(x, x + 0.28, 7), np.full(7, level), pen)
    elif pen.marker:
        sheet.line(np.array([x + 0.14]), np.array([level]), pen)
    else:
        sheet.line(np.array([x, x + 0.28]), np.array([level, level]), pen)
