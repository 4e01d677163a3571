"""The pictures of docs/failing.md: one or two panels, each with a few named curves."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from lagsim.outputs.figure import (
    SMALL,
    Picture,
    curve,
    frame,
    in_house_style,
    legend_above,
    marker_pen,
    point,
)
from lagsim.outputs.scale import (
    finite_range,
    log_scale,
    per_inch,
    set_equal_scales,
    time_scale,
    value_scale,
)

WIDTH, HEIGHT = 6.4, 2.5

# What fails is vermilion, what holds blue, the exact thin and black: told apart by
# everyone, and by their dashes in print.
FAILS = {"color": "#D55E00", "linewidth": 1.3}
HOLDS = {"color": "#0072B2", "dashes": (5.0, 2.0), "linewidth": 1.3}
OTHER = {"color": "#009E73", "dashes": (2.0, 1.5), "linewidth": 1.2}
EXACT = {"color": "#000000", "linewidth": 0.7}
MORE = {"color": "#CC79A7", "dashes": (6.0, 1.5, 1.5, 1.5), "linewidth": 1.2}


@dataclass
class View:
    """One panel: title, labels as `x (m)`, and curves of (name, x, y, pen).

    With `log_x` or `log_y` a scale is logarithmic; `marks` puts a dot at every point;
    `square` gives both axes one scale.
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
        y = np.where(np.isfinite(y) & ((y > 0.0) | (not self.log_y)), y, np.nan)
        self.curves.append((name, x, y, pen))
        return self


@in_house_style
def draw(*views):
    """Draw views side by side; return a PNG."""
    picture = Picture(HEIGHT, "", width=WIDTH)
    [panels] = picture.subplots(1, len(views), squeeze=False)
    for axes, view in zip(panels, views, strict=True):
        _panel(picture, axes, view)
    picture.settle()
    canvas = FigureCanvasAgg(picture)
    canvas.draw()
    return small_png(np.asarray(canvas.buffer_rgba()))


def small_png(pixels):
    """Return a PNG of pixels (height, width, 4) in few colours, to save space."""
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


def _scales(view):
    xs, ys = [c[1] for c in view.curves], [c[2] for c in view.curves]
    x = time_scale(np.concatenate(xs)) if view.times else value_scale(*xs)
    if view.log_x:
        x = log_scale(*xs, margin=0.0)
    return x, log_scale(*ys, least=0.06) if view.log_y else value_scale(*ys)


def _panel(picture, axes, view):
    frame(axes, *_scales(view), below=named(view.x), up=named(view.y))
    if view.square:
        ends = [finite_range(*(c[k] for c in view.curves)) for k in (1, 2)]
        picture.adjust.append(
            lambda: set_equal_scales(axes, ends, 1.1 * per_inch(axes, ends))
        )
    for _, x, y, pen in view.curves:
        curve(axes, x, y, pen)
        if view.marks:
            for a, b in zip(x, y, strict=True):
                if np.isfinite(b):
                    point(axes, a, b, marker_pen("o", 3.0, pen["color"]))
    look = {"weight": "bold", "size": SMALL}
    entries = [(name, pen) for name, _, _, pen in view.curves if name]
    legend_above(
        axes, entries, title=view.title, title_fontproperties=look, alignment="left"
    )


def named(text):
    """Split `name (unit)` into name and unit.

    A power of ten can then be written between name and unit at an axis.
    """
    name, _, unit = text.partition(" (")
    return name, unit.removesuffix(")")
