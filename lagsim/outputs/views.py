"""The paths of the scene's points, with equal scales in all directions.

Points in the plane get one view. Points in space get four: from the front (x, z), from
the side (y, z), from above (x, y), all to one scale, and one from ahead, the right and
above.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_hex

from lagsim.outputs.curves import curve, dotted, path, point
from lagsim.outputs.figure import (
    BELOW_PANELS,
    DIM,
    INK,
    LEFT,
    NAMES,
    PENS,
    RIGHT,
    SMALL,
    WIDTH,
    Pen,
    Picture,
    frame,
    in_lines,
    mark,
)
from lagsim.outputs.scale import Scale, extent, with_one_power
from lagsim.tolerances import FLAT_RANGE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.model.model import Scene
    from lagsim.outputs.record import Record
    from lagsim.run.observers.thinning import Array

# Inches: between two views, with numbers and names; the least height of one, and the
# greatest of one in the plane. In space none is higher than it is wide.
BETWEEN, LEAST, TALLEST = 0.62, 0.9, 3.8
WHOLE = WIDTH - LEFT - RIGHT
HALF = (WHOLE - BETWEEN) / 2
# What is above the views: their legend is in lines.
ABOVE = 0.24
# How much longer than the paths an axis is.
FREE = 1.12
# More names than this are not told apart.
MOST_NAMES = 14

START_LINK: Pen = {"color": DIM, "linewidth": 0.7}
END_LINK: Pen = {"color": INK, "dashes": (3.0, 1.5), "linewidth": 0.7}
FIXED_MARK = mark("s", 3.4)

# From light to dark along a chain with more points than there are pens.
LIGHT, DARK = np.array((0.55, 0.76, 0.93)), np.array((0.0, 0.13, 0.35))

# The directions that run across and up in the views of a plane, and of a space.
PLANE, IN_SPACE = ((0, 1),), ((0, 2), (1, 2), (0, 1))
# What runs right and up on paper, seen from 30 degrees to the right of ahead and 30
# degrees above.
OBLIQUE = np.array(((0.866, 0.5, 0.0), (-0.25, 0.433, 0.866)))


class Views:
    """The views of a scene with the names of what is in it.

    Attributes
    ----------
    height : how much of a picture they take; 0 without points or rows.
    """

    def __init__(self, record: Record, scene: Scene) -> None:
        self._record, self._links = record, scene.links
        self.height = 0.0
        if not scene.points or not record.rows.row_count:
            return
        self._take(scene)
        self._pens = self._pens_of_moving()
        self._lines = in_lines(list(self._names()), WHOLE)
        spans = [high - low for low, high in self._extents]
        self._widths, tallest, ups = [WHOLE], TALLEST, spans[1:]
        if len(spans) == 3:
            self._widths, tallest, ups = [HALF, HALF], HALF, [spans[2], spans[1]]
        across = max(spans[: len(self._widths)])
        self._scale = self._usable(max(across / self._widths[0], max(ups) / tallest))
        self._heights = [max(LEAST, FREE * up / self._scale) for up in ups]
        gaps = (BETWEEN - 0.1) * (len(ups) - 1)
        self._above = ABOVE + NAMES * len(self._lines)
        self.height = self._above + sum(self._heights) + gaps + BELOW_PANELS

    def _take(self, scene: Scene) -> None:
        """Take the positions (directions, rows) of all points."""
        record = self._record
        dimension = max(len(parts) for parts in scene.points.values())
        self._positions: dict[str, Array] = {}
        units = set()
        for name, parts in scene.points.items():
            columns = [f"point.{name}.{k + 1}" for k in range(len(parts))]
            # A point that stands at a number has none.
            units |= {record.unit(column) for column in columns} - {""}
            known = [record.rows.sampled(column) for column in columns]
            flat = [np.zeros_like(known[0])] * (dimension - len(parts))
            self._positions[name] = np.stack(known + flat)
        self._unit = units.pop() if len(units) == 1 else ""
        every = self._positions.values()
        self._extents = [
            extent(*(p[k] for p in every)) or (0.0, 0.0) for k in range(dimension)
        ]
        # A scene at rest has no size of its own.
        self._size = max(max(abs(low), abs(high)) for low, high in self._extents)

    def _usable(self, scale: float) -> float:
        """Return how much an inch is, also where all points rest in one place."""
        scale *= FREE
        return scale if scale > FLAT_RANGE * self._size else self._size or 1.0

    def _pens_of_moving(self) -> dict[str, Pen]:
        """Return a pen for each point that moves, in their order."""
        paths = {}
        whole = max(high - low for low, high in self._extents) or 1.0
        for name, position in self._positions.items():
            spans = [_span(component) for component in position]
            if any(span > FLAT_RANGE * self._size for span in spans):
                widest = sorted(range(len(spans)), key=lambda k: -spans[k])[:2]
                paths[name] = position[widest] * (TALLEST / whole)
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

    def draw(self, picture: Picture, top: float) -> None:
        """Draw them below `top`, counted from the header."""
        for k, line in enumerate(self._lines):
            picture.name(LEFT, picture.top + top + 0.14 + k * NAMES, line, WHOLE)
        panels = picture.panels(
            self._widths, self._heights, top=top + self._above, across=BETWEEN,
            down=BETWEEN - 0.1,
        ).ravel()  # fmt: skip
        ups = np.repeat(self._heights, len(self._widths))
        views = IN_SPACE if len(self._extents) == 3 else PLANE
        for axes, (across, up), height in zip(panels, views, ups, strict=False):
            ends = self._extents[across], self._extents[up]
            sides = self._widths[0], float(height)
            frame(
                axes, *_around(ends, sides, self._scale),
                below=("xyz"[across], self._unit), up=("xyz"[up], self._unit),
            )  # fmt: skip
            flat = {name: p[[across, up]] for name, p in self._positions.items()}
            self._draw(axes, flat)
        if len(panels) > len(views):
            self._draw_oblique(panels[-1])

    def _draw_oblique(self, axes: Axes) -> None:
        """Draw the view from aside, with the directions in its corner."""
        flat = {name: OBLIQUE @ p for name, p in self._positions.items()}
        ends = [extent(*c) or (0.0, 0.0) for c in zip(*flat.values(), strict=True)]
        sides = self._widths[-1], self._heights[-1]
        (left, right), (low, high) = ends
        scale = self._usable(max((right - left) / sides[0], (high - low) / sides[1]))
        x, y = _around(ends, sides, scale)
        x.put(axes, "x", 0)
        y.put(axes, "y", 0)
        self._draw(axes, flat)
        line = {"arrowstyle": "-", "color": DIM, "linewidth": 0.7}
        for name, end in zip("xyz", 20.0 * OBLIQUE.T, strict=True):
            axes.annotate(
                name, (14.0, 18.0), tuple(end), "axes points", "offset points",
                size=SMALL, color=DIM, ha="center", va="center", arrowprops=line,
            )  # fmt: skip

    def _draw(self, axes: Axes, shown: Mapping[str, Array]) -> None:
        """Draw points, given as what runs across and up of their paths (2, rows)."""
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


def _span(values: Array) -> float:
    """Give how far values spread; 0 where none is finite."""
    found = extent(values)
    return found[1] - found[0] if found else 0.0


def _around(
    ends: Sequence[tuple[float, float]], sides: Sequence[float], scale: float
) -> list[Scale]:
    """Return ranges of these lengths with what is shown in their middle."""
    middles = [0.5 * (low + high) for low, high in ends]
    halves = [0.5 * scale * side for side in sides]
    return with_one_power(
        [Scale(m - half, m + half) for m, half in zip(middles, halves, strict=True)]
    )
