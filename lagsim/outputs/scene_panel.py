"""The paths of the scene's points, with equal scales in all directions.

Points in the plane get one view. Points in space get three, arranged as on an
engineering drawing: from the front (x, z), from the side (y, z), and from above
(x, y) below the front view, all to one scale.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from lagsim.outputs.axis import FLAT, Axis, extent, square_axis
from lagsim.outputs.panel import SAMPLE, Panel, ink, sample
from lagsim.outputs.sheet import DIM, INK, NORMAL, PENS, SMALL, Pen, Sheet, fitted
from lagsim.outputs.time_panels import LEFT, RIGHT, Record, ticks

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from lagsim.model.model import Scene
    from lagsim.run.observers.thinning import Array

AXES = ("scene x", "scene y", "scene z")

# Inches: what the views may take together, the least for one of them, and the space
# for the numbers between two of them.
WIDEST, TALLEST, LEAST, BETWEEN = 4.3, 3.3, 0.9, 0.62

# How much longer than the paths an axis is.
FREE = 1.12

# From one name to the next.
LINE = 0.16

# More names than this do not fit beside the views.
MOST_NAMES = 14

# Successive directions of a curve that turn by more than a right angle so often mean
# that its points are too far apart to be joined.
TOO_COARSE, ENOUGH = 0.25, 1000

# Lines that cover more than the area they span leave nothing to see.
BLOT = 1.5

START_LINK = Pen(DIM, width=0.7)
END_LINK = Pen(INK, (3.0, 1.5), width=0.7)
START_MARK = Pen(INK, marker="o", size=4.6, fill="white")
END_MARK = Pen(INK, marker="o", size=2.6)
FIXED_MARK = Pen(INK, marker="s", size=3.4)

# From light to dark along a chain with more points than there are pens.
LIGHT, DARK = np.array((0.55, 0.76, 0.93)), np.array((0.0, 0.13, 0.35))


@dataclass(frozen=True, slots=True)
class Paths:
    """Where the points went.

    Attributes
    ----------
    positions : name -> (k, d), one row for each row kept, d = 2 or 3 for all.
    links : pairs of names.
    unit : that of all components, where they have one in common.
    stride : of how many rows of the run one is kept.
    trusted : how many of the rows kept lie before the horizon.
    """

    positions: dict[str, Array]
    links: tuple[tuple[str, str], ...]
    unit: str
    stride: int
    trusted: int

    @classmethod
    def of(cls, record: Record, scene: Scene) -> Self | None:
        """Take the points of a scene from the rows; None where there are none."""
        if not scene.points or not record.rows.row_count:
            return None
        dimension = max(len(parts) for parts in scene.points.values())
        positions, units = {}, set()
        for name, parts in scene.points.items():
            columns = [f"point.{name}.{k + 1}" for k in range(len(parts))]
            units |= {record.unit(column) for column in columns}
            known = [record.rows.sampled(column) for column in columns]
            flat = [np.zeros_like(known[0])] * (dimension - len(parts))
            positions[name] = np.stack(known + flat, axis=1)
        unit = units.pop() if len(units) == 1 else ""
        return cls(positions, scene.links, unit, record.rows.stride, record.trusted())

    @property
    def dimension(self) -> int:
        """Two or three."""
        return int(next(iter(self.positions.values())).shape[1])

    def extents(self) -> list[tuple[float, float]]:
        """Return the least and the greatest value in each direction."""
        every = list(self.positions.values())
        return [
            extent(*(p[:, k] for p in every)) or (0.0, 0.0)
            for k in range(self.dimension)
        ]

    def fixed(self, name: str, size: float) -> bool:
        """Whether a point stays where it is, in a picture of this size."""
        found = [extent(column) for column in self.positions[name].T]
        return all(f is None or f[1] - f[0] <= FLAT * size for f in found)


@dataclass(frozen=True, slots=True)
class View:
    """One projection: the directions it shows, where, and at which scale."""

    across: int
    up: int
    left: float
    top: float
    width: float
    height: float
    x: Axis
    y: Axis

    @property
    def scale(self) -> float:
        """What an inch stands for."""
        return (self.x.high - self.x.low) / self.width


def views(paths: Paths) -> list[View]:
    """Return the projections, placed from the upper left corner of their block."""
    found = paths.extents()
    spans = [high - low for low, high in found]
    if paths.dimension == 2:
        x, up = 0, 1
        pairs = [(0, 1, 0, 0)]
        taken, room = (spans[0], spans[1]), (WIDEST, TALLEST)
    else:
        x, up = 0, 2
        pairs = [(0, 2, 0, 0), (1, 2, 1, 0), (0, 1, 0, 1)]
        taken = (spans[0] + spans[1], spans[2] + spans[1])
        room = (WIDEST - BETWEEN, TALLEST)
    # Some of the picture stays free at each edge of it.
    scale = FREE * max(taken[0] / room[0], taken[1] / room[1])
    # A scene at rest has no size of its own.
    farthest = max(max(abs(low), abs(high)) for low, high in found)
    if scale <= FLAT * farthest:
        scale = farthest or 1.0
    lengths = [max(LEAST, FREE * span / scale) for span in spans]
    axes = [square_axis(*f, scale * n) for f, n in zip(found, lengths, strict=True)]
    return [
        View(
            a,
            b,
            column * (lengths[x] + BETWEEN),
            row * (lengths[up] + BETWEEN),
            lengths[a],
            lengths[b],
            axes[a],
            axes[b],
        )
        for a, b, column, row in pairs
    ]


class ScenePanel:
    """The views of a scene with the names beside them.

    Attributes
    ----------
    height : how much of a sheet it takes, in inches.
    """

    def __init__(self, paths: Paths) -> None:
        self._paths = paths
        self._views = views(paths)
        self._pens = _pens(paths, self._views[0].scale)
        self._entries = list(_entries(paths, self._pens))
        drawn = max(view.top + view.height for view in self._views)
        self.height = max(drawn, LINE * len(self._entries)) + 0.65

    def draw(self, sheet: Sheet, top: float) -> None:
        """Draw it below `top`."""
        top += 0.18
        for view in self._views:
            place = (LEFT + view.left, top + view.top, view.width, view.height)
            panel = Panel(sheet, place, view.x, view.y)
            panel.frame(ticks(view.width, view.height))
            _labels(panel, view, self._paths.unit)
            self._draw_view(panel, view)
        left = LEFT + max(view.left + view.width for view in self._views) + 0.3
        room = sheet.width - RIGHT - left - SAMPLE
        for k, (name, pen) in enumerate(self._entries):
            y = top + 0.1 + LINE * k
            if pen is not None:
                sample(sheet, left, y, pen)
            indent = 0.0 if pen is None else SAMPLE
            sheet.text(left + indent, y, fitted(name, room, SMALL), size=SMALL)

    def _draw_view(self, panel: Panel, view: View) -> None:
        shown = {
            name: (position[:, view.across], position[:, view.up])
            for name, position in self._paths.positions.items()
        }
        for name, pen in self._pens.items():
            panel.path(*shown[name], pen, self._paths.trusted)
        for row, pen in ((0, START_LINK), (-1, END_LINK)):
            for a, b in self._paths.links:
                ends = np.array([[shown[a][k][row], shown[b][k][row]] for k in (0, 1)])
                panel.curve(ends[0], ends[1], pen)
        small = 0.6 if len(self._pens) > MOST_NAMES else 1.0
        for row, mark in ((0, START_MARK), (-1, END_MARK)):
            sized = replace(mark, size=small * mark.size)
            for name, pen in self._pens.items():
                x, y = shown[name]
                panel.mark(x[row], y[row], sized, pen.colour)
        for name, (x, y) in shown.items():
            if name not in self._pens:
                panel.mark(x[0], y[0], FIXED_MARK, INK)


def _labels(panel: Panel, view: View, unit: str) -> None:
    middle, level = panel.left + panel.width / 2, panel.top + panel.height / 2
    across = fitted(view.x.label(AXES[view.across], unit), panel.width + 0.5)
    panel.sheet.text(middle, panel.bottom + 0.29, across, align="center", size=NORMAL)
    up = fitted(view.y.label(AXES[view.up], unit), panel.height + 0.4)
    panel.sheet.text(
        panel.left - 0.46, level, up, align="center", size=NORMAL, turned=True
    )


def _pens(paths: Paths, scale: float) -> dict[str, Pen]:
    """Return a pen for each point that moves, in their order."""
    size = max(max(abs(a), abs(b)) for a, b in paths.extents())
    moving = [name for name in paths.positions if not paths.fixed(name, size)]
    if len(moving) <= len(PENS):
        pens = PENS[: len(moving)]
    else:
        share = np.linspace(0.0, 1.0, len(moving))[:, np.newaxis]
        pens = tuple(Pen(_hex(c), width=0.6) for c in LIGHT + share * (DARK - LIGHT))
    chosen = dict(zip(moving, pens, strict=True))
    for name, pen in chosen.items():
        spans = [f[1] - f[0] for c in paths.positions[name].T if (f := extent(c))]
        widest = sorted(range(len(spans)), key=lambda k: -spans[k])[:2]
        x, y = paths.positions[name][:, widest].T / scale
        if dotted(x, y):
            chosen[name] = replace(pen, marker=".", size=3.0)
    return chosen


def _hex(colour: NDArray[np.float64]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


def _entries(paths: Paths, pens: dict[str, Pen]) -> Iterator[tuple[str, Pen | None]]:
    names = list(pens)
    if len(names) > MOST_NAMES:
        yield names[0], pens[names[0]]
        yield f"… {len(names) - 2} more, darker …", None
        names = names[-1:]
    yield from ((name, pens[name]) for name in names)
    if len(pens) < len(paths.positions):
        fixed = ", ".join(name for name in paths.positions if name not in pens)
        yield fixed, FIXED_MARK
    if pens:
        yield "start", START_MARK
        yield "end", END_MARK
    if paths.links:
        yield "links at the start", START_LINK
        yield "links at the end", END_LINK
    if pens and paths.stride > 1:
        yield f"one of {paths.stride} rows", None


def dotted(x: Array, y: Array) -> bool:
    """Whether a path, given in inches, is better shown by its points than by lines.

    It is when lines would only fill an area, and when the points are too far apart, so
    that chords would be seen and not the curve.
    """
    dx, dy = np.diff(x), np.diff(y)
    turns = dx[1:] * dx[:-1] + dy[1:] * dy[:-1] < 0
    coarse = len(turns) >= ENOUGH and float(np.mean(turns)) > TOO_COARSE
    return coarse or ink(x, y) > BLOT
