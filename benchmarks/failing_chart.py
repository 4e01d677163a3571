"""The pictures of docs/failing.md: one or two panels, each with a few named curves."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

import numpy as np

from lagsim.outputs.axis import DecadeAxis, extent, square_axis, time_axis, value_axis
from lagsim.outputs.panel import Panel, legend
from lagsim.outputs.sheet import SMALL, Pen, Sheet, in_house_style

WIDTH, HEIGHT = 6.4, 2.6
LEFT, RIGHT, TOP, BOTTOM, BETWEEN = 0.72, 0.14, 0.52, 0.42, 0.82

# What fails is vermilion, what holds blue, the exact thin and black: told apart by
# everyone, and by their dashes in print.
FAILS, HOLDS = Pen("#D55E00", width=1.3), Pen("#0072B2", (5.0, 2.0), width=1.3)
OTHER, EXACT = Pen("#009E73", (2.0, 1.5), width=1.2), Pen("#000000", width=0.7)
MORE = Pen("#CC79A7", (6.0, 1.5, 1.5, 1.5), width=1.2)


@dataclass
class View:
    """One panel: title, labels, and curves of (name, x, y, pen).

    With `log_x` or `log_y` the values are drawn by their decades; `marks` puts a dot at
    every point; `square` gives both axes one scale.
    """

    title: str
    x: str
    y: str
    curves: list = field(default_factory=list)
    log_x: bool = False
    log_y: bool = False
    marks: bool = False
    square: bool = False
    times: bool = True

    def add(self, name, x, y, pen):
        """Add a curve."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = np.log10(x) if self.log_x else x
            y = np.log10(y) if self.log_y else y
        self.curves.append((name, x, np.where(np.isfinite(y), y, np.nan), pen))
        return self


@in_house_style
def draw(*views):
    """Draw views side by side; gives a PNG."""
    sheet = Sheet(WIDTH, HEIGHT)
    room = WIDTH - LEFT - RIGHT - BETWEEN * (len(views) - 1)
    width, height = room / len(views), HEIGHT - TOP - BOTTOM
    for k, view in enumerate(views):
        left = LEFT + k * (width + BETWEEN)
        _panel(sheet, view, (left, TOP, width, height))
    return small_png(sheet.pixels())


def small_png(pixels):
    """Give a PNG of pixels (height, width, 4) in few colours, a third of the size."""
    # Six levels of each colour, enough for lines and their edges.
    levels = np.round(pixels[:, :, :3] / 255.0 * 5.0).astype(int)
    codes = (levels[:, :, 0] * 6 + levels[:, :, 1]) * 6 + levels[:, :, 2]
    used, index = np.unique(codes, return_inverse=True)
    height, width = codes.shape
    shades = np.stack((used // 36, used // 6 % 6, used % 6), axis=1) * 51
    rows = np.zeros((height, 1 + width), np.uint8)
    rows[:, 1:] = index.reshape(height, width)
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    parts = (
        (b"IHDR", header),
        (b"PLTE", shades.astype(np.uint8).tobytes()),
        (b"IDAT", zlib.compress(rows.tobytes(), 9)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(content)) + kind + content
        + struct.pack(">I", zlib.crc32(kind + content))
        for kind, content in parts
    )  # fmt: skip


def _axes(view, width, height):
    xs, ys = [c[1] for c in view.curves], [c[2] for c in view.curves]
    if view.square:
        (a, b), (c, d) = extent(*xs), extent(*ys)
        unit = 1.1 * max((b - a) / width, (d - c) / height)
        return square_axis(a, b, unit * width), square_axis(c, d, unit * height)
    if view.log_x:
        low, high = extent(*xs)
        x = DecadeAxis(low - 0.1, high + 0.1)
    else:
        x = time_axis(np.concatenate(xs)) if view.times else value_axis(*xs)
    if view.log_y:
        low, high = extent(*ys)
        gap = 0.06 * max(1.0, high - low)
        return x, DecadeAxis(low - gap, high + gap)
    return x, value_axis(*ys)


def _panel(sheet, view, place):
    left, top, width, height = place
    x, y = _axes(view, width, height)
    panel = Panel(sheet, place, x, y)
    for _, across, down, pen in view.curves:
        panel.curve(across, down, pen)
        if view.marks:
            for a, d in zip(across, down, strict=True):
                if np.isfinite(d):
                    panel.mark(a, d, Pen(marker="o", size=3.0), pen.colour)
    panel.frame((6, 5))
    sheet.text(left, top - 0.27, view.title, size=SMALL, bold=True)
    named = [(name, pen) for name, _, _, pen in view.curves if name]
    legend(sheet, left, top - 0.09, named, width)
    middle = left + width / 2
    label = x.label(view.x) if not view.log_x else view.x
    sheet.text(middle, top + height + 0.31, label, size=SMALL, align="center")
    label = y.label(view.y) if not view.log_y else view.y
    sheet.text(
        left - 0.48, top + height / 2, label, size=SMALL, align="center", turned=True
    )
