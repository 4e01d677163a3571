"""The paths of the scene's points, with equal scales in all directions.

Points in the plane get one view: beside the curves where it is narrow, else below them.
Points in space get three, arranged as on an engineering drawing: from the front (x, z),
from the side (y, z), and from above (x, y) below the front view, all to one scale; and
a fourth, from ahead, the right and above, where there is room.
"""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.colors import to_hex

from lagsim.outputs.curves import curve, dotted, path, point
from lagsim.outputs.record import LEFT, RIGHT
from lagsim.outputs.scale import FLAT, Scale, extent, with_one_power
from lagsim.outputs.sheet import DIM, INK, PENS, SMALL, WIDTH, Sheet, in_lines, mark

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from matplotlib.axes import Axes

    from lagsim.model.model import Scene
    from lagsim.outputs.record import Record
    from lagsim.outputs.sheet import Pen
    from lagsim.run.observers.thinning import Array

# Inches: the least for a view, for one beside curves, and between two, for numbers.
LEAST, LEAST_ASIDE, BETWEEN = 0.9, 1.3, 0.62
# What views may take across and up: the names beside them, above them, in space, and
# beside the curves.
SQUARE, BROAD, SPACE = (4.4, 4.2), (WIDTH - LEFT - RIGHT, 3.8), (5.42, 3.9)
ASIDE = 2.0
# How much wider than high paths are that have names above them, few names or many; and
# that stand beside the curves.
BROAD_FROM, NARROW_TO = (1.3, 2.2), 0.7

# How much longer than the paths an axis is.
FREE = 1.12

# From one name to the next: below, and line by line.
LINE, DOWN = 0.16, 0.18

# More names than this do not fit beside the views; so many are few.
MOST_NAMES, FEW_NAMES = 14, 7

START_LINK: Pen = {"color": DIM, "linewidth": 0.7}
END_LINK: Pen = {"color": INK, "dashes": (3.0, 1.5), "linewidth": 0.7}
FIXED_MARK = mark("s", 3.4)

# From light to dark along a chain with more points than there are pens.
LIGHT, DARK = np.array((0.55, 0.76, 0.93)), np.array((0.0, 0.13, 0.35))

# What runs right and up on paper, seen from 30 degrees to the right of ahead and 30
# degrees above.
OBLIQUE = np.array(((0.866, 0.5, 0.0), (-0.25, 0.433, 0.866)))


class View(NamedTuple):
    """One view: what it shows to the right and up, and where it stands among others."""

    across: int
    up: int
    column: int = 0
    row: int = 0

    def seen(self, p: Array) -> Array:
        """Return what of positions (directions, rows) runs right and up."""
        return p[[self.across, self.up]]


PLANE = (View(0, 1),)
IN_SPACE = (View(0, 2), View(1, 2, 1, 0), View(0, 1, 0, 1))


class ScenePanel:
    """The views of a scene with the names of what is in it.

    Attributes
    ----------
    height : how much of a sheet it takes below the curves, in inches; 0 where it is
        beside them, and without points or rows.
    beside : whether it stands beside curves.
    """

    def __init__(self, record: Record, scene: Scene, *, narrow: bool) -> None:
        self._record, self._links = record, scene.links
        self.height, self.beside = 0.0, False
        self.empty = not scene.points or not record.rows.row_count
        if self.empty:
            return
        self._take(scene)
        self._pens = self._pens_of_moving()
        self._entries = list(self._names())
        found = [high - low for low, high in self._extents]
        broad = found[0] / found[1] if found[1] > FLAT * found[0] else np.inf
        self._lines: list[list[tuple[str, Pen]]] = []
        if len(found) == 3:
            self._measure(*SPACE)
            self._in_lines()
        elif narrow and broad < NARROW_TO:
            self.beside = True
            self._in_lines()
        elif broad < (BROAD_FROM[len(self._entries) > FEW_NAMES]):
            self._measure(*SQUARE)
            self.height = max(self._lengths[1], LINE * len(self._entries)) + 0.65
        else:
            self._measure(*BROAD)
            self._in_lines()

    def _in_lines(self) -> None:
        """Let names stand in lines, across the sheet."""
        self._lines = in_lines(self._entries, WIDTH - LEFT - RIGHT)
        self.height = DOWN * len(self._lines) + 0.08
        if not self.beside:
            up = [self._lengths[v.up] for v in self._views if v.column == 0]
            self.height += sum(up) + BETWEEN * (len(up) - 1) + 0.7

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
        self._views = IN_SPACE if dimension == 3 else PLANE
        every = self._positions.values()
        self._extents = [
            extent(*(p[k] for p in every)) or (0.0, 0.0) for k in range(dimension)
        ]
        # A scene at rest has no size of its own.
        self._size = max(max(abs(low), abs(high)) for low, high in self._extents)

    def _measure(self, widest: float, tallest: float) -> None:
        """Choose the one scale, and with it the range and length of each direction."""
        spans = [high - low for low, high in self._extents]
        scale = max(spans[0] / widest, spans[1] / tallest)
        if len(spans) == 3:
            across, up = (spans[0], spans[1]), (spans[2], spans[1])
            scale = max(_beside(across, widest), _beside(up, tallest))
        scale = self._at_rest_too(FREE * scale)
        self._lengths = [max(LEAST, FREE * span / scale) for span in spans]
        if self.beside:
            self._lengths = [max(LEAST_ASIDE, self._lengths[0]), tallest]
        self._ranges = _around(self._extents, self._lengths, scale)

    def _scale_for(
        self, ends: Sequence[tuple[float, float]], sides: Sequence[float]
    ) -> float:
        """Return how much an inch is, so that all of it fits."""
        # Some of the picture stays free at each edge of it.
        scale = FREE * max(
            (high - low) / side for (low, high), side in zip(ends, sides, strict=True)
        )
        return self._at_rest_too(scale)

    def _at_rest_too(self, scale: float) -> float:
        """Return a scale, also where nothing moves and all points are in one place."""
        return scale if scale > FLAT * self._size else self._size or 1.0

    def _pens_of_moving(self) -> dict[str, Pen]:
        """Return a pen for each point that moves, in their order."""
        paths = {}
        whole = max(high - low for low, high in self._extents) or 1.0
        for name, position in self._positions.items():
            spans = [_span(component) for component in position]
            if any(span > FLAT * self._size for span in spans):
                widest = sorted(range(len(spans)), key=lambda k: -spans[k])[:2]
                paths[name] = position[widest] * (SQUARE[1] / whole)
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

    def width_for(self, tall: float) -> float:
        """Fit it beside curves of this height; return how much of a sheet it takes."""
        self._measure(ASIDE, tall)
        return BETWEEN + 0.1 + self._lengths[0]

    def draw(self, sheet: Sheet, top: float, side_top: float = 0.0) -> None:
        """Draw it below `top`; what stands beside curves below `side_top`."""
        for k, line in enumerate(self._lines):
            sheet.legend(LEFT, top + 0.14 + k * DOWN, line, WIDTH - LEFT - RIGHT)
        top += 0.18 + DOWN * len(self._lines)
        left = LEFT
        if self.beside:
            left, top = WIDTH - RIGHT - self._lengths[0], side_top
        right = 0.0
        steps = self._lengths[0] + BETWEEN, self._lengths[self._views[0].up] + BETWEEN
        for view in self._views:
            x, y = left + view.column * steps[0], top + view.row * steps[1]
            width, height = self._lengths[view.across], self._lengths[view.up]
            right = max(right, x + width)
            axes = sheet.panel(
                (x, y, width, height), self._ranges[view.across], self._ranges[view.up],
                below=("xyz"[view.across], self._unit),
                side=("xyz"[view.up], self._unit), spare=0.4,
            )  # fmt: skip
            self._draw_view(axes, view.seen)
        if len(self._views) > 1:
            self._draw_oblique(sheet, left + steps[0], right, top, steps[1])
        if not self._lines:
            room = sheet.width - RIGHT - right - 0.3
            sheet.legend(right + 0.3, top + 0.1, self._entries, room, down=LINE)

    def _draw_oblique(
        self, sheet: Sheet, left: float, right: float, top: float, step: float
    ) -> None:
        """Draw the view from aside where there is the most room for it."""
        end = WIDTH - RIGHT
        tall = step + self._lengths[1]
        place = (left, top + step, end - left, self._lengths[1])
        if end - right - 0.3 > max(self._lengths[1], LEAST):
            place = (right + 0.3, top, end - right - 0.3, tall)
        _, _, width, height = place
        every = np.concatenate([_aside(p) for p in self._positions.values()], axis=1)
        ends = [extent(c) or (0.0, 0.0) for c in every]
        scale = self._scale_for(ends, (width, height))
        ranges = _around(ends, (width, height), scale)
        axes = sheet.panel(place, ranges[0], ranges[1], ticks=(0, 0))
        self._draw_view(axes, _aside)
        x, y = place[0] + 0.2, place[1] + height - 0.28
        for name, (across, up) in zip("xyz", 0.22 * OBLIQUE.T, strict=True):
            sheet.line([x, x + across], [y, y - up], {"color": DIM, "linewidth": 0.7})
            x_, y_ = x + 1.3 * across - 0.03, y - 1.3 * up + 0.03
            sheet.text(x_, y_, name, size=SMALL, color=DIM)

    def _draw_view(self, axes: Axes, seen: Callable[[Array], Array]) -> None:
        shown = {name: seen(p) for name, p in self._positions.items()}
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


def _beside(spans: tuple[float, float], room: float) -> float:
    """Give how much an inch is where two views stand beside each other.

    One that is short has the least length, and the other what is left of the room.
    """
    share = room * min(spans) / sum(spans) if max(spans) > 0.0 else 0.0
    if share * FREE < LEAST:
        return max(spans) / (room - LEAST)
    return sum(spans) / room


def _aside(p: Array) -> Array:
    """Return what of positions (3, rows) runs right and up, seen from aside."""
    return OBLIQUE @ p


def _around(
    ends: Sequence[tuple[float, float]], sides: Sequence[float], scale: float
) -> list[Scale]:
    """Return ranges of these lengths with what is shown in their middle."""
    middles = [0.5 * (low + high) for low, high in ends]
    halves = [0.5 * scale * side for side in sides]
    return with_one_power(
        [Scale(m - half, m + half) for m, half in zip(middles, halves, strict=True)]
    )
