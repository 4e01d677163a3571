"""The paths of the scene's points, with equal scales in all directions.

Points in the plane get one view. Points in space get three, arranged as on an
engineering drawing: from the front (x, z), from the side (y, z), and from above
(x, y) below the front view, all to one scale.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_hex

from lagsim.outputs.curves import curve, dotted, path, point
from lagsim.outputs.record import LEFT, RIGHT
from lagsim.outputs.scale import FLAT, Scale, extent
from lagsim.outputs.sheet import DIM, INK, PENS, Pen, Sheet, mark

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.axes import Axes

    from lagsim.model.model import Scene
    from lagsim.outputs.record import Record
    from lagsim.run.observers.thinning import Array

# Inches: what the views may take together, the least for one of them, and the space
# for the numbers between two of them.
WIDEST, TALLEST, LEAST, BETWEEN = 4.3, 3.3, 0.9, 0.62

# How much longer than the paths an axis is.
FREE = 1.12

# From one name to the next.
LINE = 0.16

# More names than this do not fit beside the views.
MOST_NAMES = 14

START_LINK: Pen = {"color": DIM, "linewidth": 0.7}
END_LINK: Pen = {"color": INK, "dashes": (3.0, 1.5), "linewidth": 0.7}
FIXED_MARK = mark("s", 3.4)

# From light to dark along a chain with more points than there are pens.
LIGHT, DARK = np.array((0.55, 0.76, 0.93)), np.array((0.0, 0.13, 0.35))

# The directions that each view shows, and its column and row.
PLANE = ((0, 1, 0, 0),)
SPACE = ((0, 2, 0, 0), (1, 2, 1, 0), (0, 1, 0, 1))


class ScenePanel:
    """The views of a scene with the names beside them.

    Attributes
    ----------
    height : how much of a sheet it takes, in inches; 0 without points or rows.
    """

    def __init__(self, record: Record, scene: Scene) -> None:
        self._record, self._links = record, scene.links
        self.height = 0.0
        if not scene.points or not record.rows.row_count:
            return
        dimension = max(len(parts) for parts in scene.points.values())
        self._positions: dict[str, Array] = {}
        units = set()
        for name, parts in scene.points.items():
            columns = [f"point.{name}.{k + 1}" for k in range(len(parts))]
            units |= {record.unit(column) for column in columns} - {""}
            known = [record.rows.sampled(column) for column in columns]
            flat = [np.zeros_like(known[0])] * (dimension - len(parts))
            self._positions[name] = np.stack(known + flat)
        self._unit = units.pop() if len(units) == 1 else ""
        self._views = SPACE if dimension == 3 else PLANE
        self._measure(dimension)
        self._pens = self._pens_of_moving()
        self._entries = list(self._names())
        self._step = self._lengths[self._views[0][1]] + BETWEEN
        drawn = self._step - BETWEEN
        if dimension == 3:
            drawn += BETWEEN + self._lengths[1]
        self.height = max(drawn, LINE * len(self._entries)) + 0.65

    def _measure(self, dimension: int) -> None:
        """Choose the one scale, and with it the range and length of each direction."""
        every = self._positions.values()
        found = [extent(*(p[k] for p in every)) or (0.0, 0.0) for k in range(dimension)]
        spans = [high - low for low, high in found]
        taken = (spans[0], spans[1]) if dimension == 2 else (
            spans[0] + spans[1], spans[2] + spans[1],
        )  # fmt: skip
        widest = WIDEST - (dimension - 2) * BETWEEN
        # Some of the picture stays free at each edge of it.
        self._scale = FREE * max(taken[0] / widest, taken[1] / TALLEST)
        # A scene at rest has no size of its own.
        self._size = max(max(abs(low), abs(high)) for low, high in found)
        if self._scale <= FLAT * self._size or not self._scale:
            self._scale = self._size or 1.0
        self._lengths = [max(LEAST, FREE * span / self._scale) for span in spans]
        halves = [0.5 * self._scale * length for length in self._lengths]
        self._ranges = [
            Scale(low + span / 2 - half, low + span / 2 + half)
            for (low, _), span, half in zip(found, spans, halves, strict=True)
        ]

    def _pens_of_moving(self) -> dict[str, Pen]:
        """Return a pen for each point that moves, in their order."""
        paths = {}
        for name, position in self._positions.items():
            spans = [f[1] - f[0] for c in position if (f := extent(c))]
            if any(span > FLAT * self._size for span in spans):
                widest = sorted(range(len(spans)), key=lambda k: -spans[k])[:2]
                paths[name] = position[widest] / self._scale
        share = np.linspace(0.0, 1.0, len(paths))[:, np.newaxis]
        shades = LIGHT + share * (DARK - LIGHT)
        pens: list[Pen] = [{"color": to_hex(c), "linewidth": 0.6} for c in shades]
        if len(paths) <= len(PENS):
            pens = list(PENS[: len(paths)])
        return {
            name: mark(".", 3.0, pen["color"]) if dotted(x, y) else pen
            for (name, (x, y)), pen in zip(paths.items(), pens, strict=True)
        }

    def _names(self) -> Iterator[tuple[str, Pen]]:
        names = list(self._pens)
        if len(names) > MOST_NAMES:
            yield names[0], self._pens[names[0]]
            yield f"… {len(names) - 2} more, darker …", {}
            names = names[-1:]
        yield from ((name, self._pens[name]) for name in names)
        if fixed := [name for name in self._positions if name not in self._pens]:
            yield ", ".join(fixed), FIXED_MARK
        if self._pens:
            yield "start", mark("o", 4.6, fill="white")
            yield "end", mark("o", 2.6)
        if self._links:
            yield "links at the start", START_LINK
            yield "links at the end", END_LINK
        if self._pens and (stride := self._record.rows.stride) > 1:
            yield f"one of {stride} rows", {}

    def draw(self, sheet: Sheet, top: float) -> None:
        """Draw it below `top`."""
        top += 0.18
        right = 0.0
        for across, up, column, row in self._views:
            left = LEFT + column * (self._lengths[0] + BETWEEN)
            width, height = self._lengths[across], self._lengths[up]
            right = max(right, left + width)
            with sheet.panel(
                (left, top + row * self._step, width, height),
                self._ranges[across],
                self._ranges[up],
                below=(f"scene {'xyz'[across]}", self._unit),
                side=(f"scene {'xyz'[up]}", self._unit),
                spare=0.4,
            ) as axes:
                self._draw_view(axes, across, up)
        room = sheet.width - RIGHT - right - 0.3
        sheet.legend(right + 0.3, top + 0.1, self._entries, room, down=LINE)

    def _draw_view(self, axes: Axes, across: int, up: int) -> None:
        shown = {name: p[[across, up]] for name, p in self._positions.items()}
        for name, pen in self._pens.items():
            x, y = shown[name]
            path(axes, x, y, pen, self._record.trusted())
        for row, pen in ((0, START_LINK), (-1, END_LINK)):
            for a, b in self._links:
                x, y = np.stack((shown[a][:, row], shown[b][:, row]), 1)
                curve(axes, x, y, pen)
        small = 0.6 if len(self._pens) > MOST_NAMES else 1.0
        for row, size, fill in ((0, 4.6, "white"), (-1, 2.6, "")):
            for name, pen in self._pens.items():
                x, y = shown[name][:, row]
                point(axes, x, y, mark("o", small * size, pen["color"], fill))
        for x, y in (p[:, 0] for name, p in shown.items() if name not in self._pens):
            point(axes, x, y, FIXED_MARK)
