"""Views of a scene along each axis: paths of its points, links and shapes."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patches import Polygon

from lagsim.outputs.figure import (
    BELOW_PANELS,
    DIM,
    INK,
    LINE,
    PENS,
    SMALL,
    WIDTH,
    curve,
    header,
    in_columns,
    is_dotted,
    line,
    marker_pen,
    path,
    point,
)
from lagsim.outputs.scale import (
    finite_range,
    name_axis,
    per_inch,
    set_equal_scales,
    size_of,
)
from lagsim.outputs.shapes import bodies, needed, projected, reached, string_lengths
from lagsim.tolerances import COMPUTED_ZERO

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

    from lagsim.model.model import Model, Scene
    from lagsim.outputs.figure import Entry, Pen, Picture
    from lagsim.outputs.plot_data import PlotData
    from lagsim.outputs.shapes import Body
    from lagsim.run.observers.thinning import Array

    # The axes to the right and up; () is the oblique view.
    View: TypeAlias = tuple[int, ...]


# --- Views

# In inches: the gap between two views, for numbers and names; the width of a single
# view, and of one of two; the least height of a view, and the greatest of a view in
# the plane. In space no view is higher than wide.
BETWEEN, WHOLE, HALF, LOWEST, HIGHEST = 0.52, 6.2, 2.8, 1.0, 3.8
# Ratio of the length of an axis to that of the paths.
FREE = 1.12
# More names than this cannot be distinguished.
MOST_NAMES = 14

# Points of a sagging string; the largest invisible slack relative to its length; the
# ratio of sag to slack, from the length of a flat parabola.
STRING, TAUT, SAG = 25, 1e-3, 3.0**0.5 / 4.0

START_LINK: Pen = {"color": DIM, "linewidth": 0.7}
END_LINK: Pen = {"color": INK, "dashes": (3.0, 1.5), "linewidth": 0.7}
FIXED_MARK = marker_pen("s", 3.4)

# First and last colour of a chain with more points than pens.
LIGHT, DARK = np.array((0.55, 0.76, 0.93)), np.array((0.0, 0.13, 0.35))

# The axes to the right and up in the views of a plane, and of a space.
PLANE, IN_SPACE = ((0, 1),), ((0, 2), (1, 2), (0, 1))
# The oblique view, and its directions to the right and up: seen from 30 degrees to the
# right of the front and 30 degrees above.
ASIDE: View = ()
OBLIQUE = np.array(((0.866, 0.5, 0.0), (-0.25, 0.433, 0.866)))


class Views:
    """The views of a scene with a legend of its points, shapes and links.

    Parameters
    ----------
    data : PlotData
    scene : Scene
    model : Model, optional
        Source of the shapes and strings, which are drawn if given.

    Attributes
    ----------
    height : float
        Height of all views, in inches; 0 without points or rows.
    """

    def __init__(
        self, data: PlotData, scene: Scene, model: Model | None = None
    ) -> None:
        self._data, self._links = data, scene.links
        self._looks = scene.looks or ("",) * len(scene.links)
        self._strings = string_lengths(model) if model else []
        self._strings = self._strings or [None] * len(scene.links)
        self.height = 0.0
        shown = scene.points or (model and scene.shapes)
        if not shown or not data.rows.row_count:
            return
        self._bodies = _bodies(data, model) if model and scene.shapes else []
        self._store_points(scene)
        self._pens = self._pens_of_moving()
        self._entries = list(self._names())
        spans = [high - low for low, high in self._extents]
        self._widths, tallest, ups = [WHOLE], HIGHEST, spans[1:]
        if len(spans) == 3:
            self._widths, tallest, ups = [HALF, HALF], HALF, [spans[2], spans[1]]
        across = max(spans[: len(self._widths)])
        self._scale = self._usable(max(across / self._widths[0], max(ups) / tallest))
        self._heights = [max(LOWEST, FREE * up / self._scale) for up in ups]
        lines = -(-len(self._entries) // in_columns(self._entries, WIDTH)[1])
        gaps = BETWEEN * (len(ups) - 1)
        self.height = LINE * lines + sum(self._heights) + gaps + BELOW_PANELS

    def _store_points(self, scene: Scene) -> None:
        """Store the positions (directions, rows) of points, and their extent and unit.

        Bodies and hanging strings count in the extent.
        """
        data = self._data
        dimension = scene.dimension
        self._positions: dict[str, Array] = {}
        units = set()
        for name, parts in scene.points.items():
            columns = [f"point.{name}.{k + 1}" for k in range(len(parts))]
            # A point at constant coordinates has no unit.
            units |= {data.unit(column) for column in columns} - {""}
            known = [data.rows.sampled(column) for column in columns]
            flat = [np.zeros_like(known[0])] * (dimension - len(parts))
            self._positions[name] = np.stack(known + flat)
        self._unit = units.pop() if len(units) == 1 else ""
        every = self._positions.values()
        ends = [[p[k] for p in every] for k in range(dimension)]
        if self._bodies:
            for own, further in zip(ends, reached([], self._bodies).T, strict=True):
                own.append(further)
        self._hanging = self._bottoms()
        for own, further in zip(ends, self._hanging, strict=False):
            own.append(further)
        self._extents = [finite_range(*own) for own in ends]
        # A scene without motion has no extent of its own.
        self._size = max(max(abs(low), abs(high)) for low, high in self._extents)

    def _usable(self, scale: float) -> float:
        """Return a scale in data units per inch with a margin around the scene.

        scale : the scale without a margin; 0 for a scene at rest, for which the result
            is positive.
        """
        scale *= FREE
        return scale if scale > COMPUTED_ZERO * self._size else self._size or 1.0

    def _pens_of_moving(self) -> dict[str, Pen]:
        """Return a pen for each point that moves, in the order of the points."""
        paths = {}
        whole = max(high - low for low, high in self._extents) or 1.0
        for name, position in self._positions.items():
            spans = [high - low for low, high in map(finite_range, position)]
            if any(span > COMPUTED_ZERO * self._size for span in spans):
                widest = sorted(range(len(spans)), key=lambda k: -spans[k])[:2]
                paths[name] = position[widest] * (HIGHEST / whole)
        share = np.linspace(0.0, 1.0, len(paths))[:, np.newaxis]
        shades = LIGHT + share * (DARK - LIGHT)
        pens: list[Pen] = [{"color": to_hex(c), "linewidth": 0.6} for c in shades]
        if len(paths) <= len(PENS):
            pens = list(PENS[: len(paths)])
        return {
            name: marker_pen(".", 6.0, pen["color"]) if is_dotted(x, y) else pen
            for (name, (x, y)), pen in zip(paths.items(), pens, strict=True)
        }

    def _names(self) -> Iterator[tuple[str, Pen]]:
        names, written = list(self._pens), self._written
        if len(names) > MOST_NAMES:
            yield written(names[0]), self._pens[names[0]]
            yield f"… {len(names) - 2} more, darker …", {}
            names = names[-1:]
        yield from ((written(name), self._pens[name]) for name in names)
        own: list[Entry] = [
            (written(body.shape.name), {"color": colour})
            for body, colour in zip(self._bodies, self._colours(), strict=True)
            if body.moves and body.shape.point not in self._pens
        ]
        if len(own) > MOST_NAMES:
            own[1:-1] = [(f"… {len(own) - 2} more …", {})]
        yield from own
        if fixed := [name for name in self._positions if name not in self._pens]:
            yield ", ".join(map(written, fixed)), FIXED_MARK
        if self._pens:
            yield "start", marker_pen("o", 4.6, fill="white")
            yield "end", marker_pen("o", 2.6)
        if self._links:
            yield "links at the start", START_LINK
            yield "links at the end", END_LINK
        if self._pens and (stride := self._data.rows.stride) > 1:
            yield f"one of {stride} rows", {}

    def _written(self, name: str) -> str:
        """Return the name of a point or shape; of a family member with subscripts."""
        return self._data.letters.name(name) if "." in name else name

    def draw(self, part: SubFigure, picture: Picture) -> None:
        """Add panels and legend to a part of a picture; curves are drawn later."""
        header(part, self._entries, WIDTH)
        rows, columns = len(self._heights), len(self._widths)
        found = part.subplots(
            rows, columns, squeeze=False, height_ratios=self._heights
        ).flat
        views = [*IN_SPACE, ASIDE] if len(self._extents) == 3 else PLANE
        panels = list(zip(found, views, strict=True))
        for axes, view in panels:
            if view == ASIDE:
                axes.grid(visible=False)
                axes.tick_params(labelbottom=False, labelleft=False)
            for axis, k in zip((axes.xaxis, axes.yaxis), view, strict=False):
                name_axis(axis, "xyz"[k], self._unit)
        picture.adjust.append(partial(self._set_scales, panels))
        picture.when_placed(self._fill, panels)

    def _set_scales(self, panels: Sequence[tuple[Axes, View]]) -> None:
        """Set one scale for all views along axes, and another for the oblique view."""
        ends = [self._ends(view) for _, view in panels]
        scales = [
            per_inch(axes, own) for (axes, _), own in zip(panels, ends, strict=True)
        ]
        largest = max(s for s, (_, view) in zip(scales, panels, strict=True) if view)
        for (axes, view), own, scale in zip(panels, ends, scales, strict=True):
            set_equal_scales(axes, own, self._usable(largest if view else scale))

    def _ends(self, view: View) -> list[tuple[float, float]]:
        """Return the ranges (least, greatest) of abscissa and ordinate of a view."""
        if view:
            return [self._extents[k] for k in view]
        shown = [OBLIQUE @ p for p in self._positions.values()]
        if self._hanging.size:
            shown.append(OBLIQUE @ self._hanging)
        if self._bodies:
            shown.append(OBLIQUE @ reached([], self._bodies).T)
        return [finite_range(*c) for c in zip(*shown, strict=True)]

    def _fill(self, panels: Sequence[tuple[Axes, View]]) -> None:
        """Draw shapes, paths and links; in the oblique view the axes, too."""
        for axes, view in panels:
            along = list(view)
            turned = np.eye(len(self._extents))[along] if view else OBLIQUE
            self._draw_bodies(axes, turned)
            flat = {
                name: p[along] if view else OBLIQUE @ p
                for name, p in self._positions.items()
            }
            self._draw(axes, flat, -turned[:, -1])
            line = {"arrowstyle": "-", "color": DIM, "linewidth": 0.7}
            for name, end in zip("" if view else "xyz", 20.0 * OBLIQUE.T, strict=False):
                axes.annotate(
                    name, (14.0, 18.0), tuple(end), "axes points", "offset points",
                    size=SMALL, color=DIM, ha="center", va="center", arrowprops=line,
                )  # fmt: skip

    def _draw(self, axes: Axes, shown: Mapping[str, Array], down: Array) -> None:
        """Draw paths and links.

        Parameters
        ----------
        axes : Axes
        shown : mapping of str to ndarray, shape (2, rows)
            Projected position of each point.
        down : ndarray, shape (2,)
            Direction in which strings sag.
        """
        for name, pen in self._pens.items():
            x, y = shown[name]
            path(axes, x, y, pen, self._data.trusted())
        for row, pen in ((0, START_LINK), (-1, END_LINK)):
            for (a, b), kind, length in zip(
                self._links, self._looks, self._strings, strict=True
            ):
                ends = np.stack((shown[a][:, row], shown[b][:, row]))
                if kind == "string":
                    slack = self._slack(a, b, row, length) * down
                    x, y = _string(ends[0], ends[1], slack).T
                    curve(axes, x, y, pen)
                elif kind in LOOKS:
                    plain = {k: v for k, v in pen.items() if k != "dashes"}
                    x, y = LOOKS[kind](ends[0], ends[1], inch_of(axes)).T
                    line(axes, x, y, plain)
                else:
                    curve(axes, ends[:, 0], ends[:, 1], pen)
        small = 0.6 if len(self._pens) > MOST_NAMES else 1.0
        for row, size, fill, edge in ((0, 4.6, "white", ""), (-1, 3.4, "", "white")):
            for name, pen in self._pens.items():
                style = marker_pen("o", small * size, pen["color"], fill)
                style["markeredgecolor"] = edge or pen["color"]
                x, y = shown[name][:, row]
                point(axes, x, y, style)
        for x, y in (p[:, 0] for name, p in shown.items() if name not in self._pens):
            point(axes, x, y, FIXED_MARK)

    def _bottoms(self) -> Array:
        """Return the lowest places of the strings that are drawn (directions, k)."""
        found, places = [], next(iter(self._positions.values()), ())
        for (a, b), kind, length in zip(
            self._links, self._looks, self._strings, strict=True
        ):
            for row in (0, -1) if kind == "string" else ():
                middle = (self._positions[a][:, row] + self._positions[b][:, row]) / 2.0
                middle[-1] -= SAG * self._slack(a, b, row, length)
                found.append(middle)
        return np.array(found).reshape(len(found), len(places)).T

    def _slack(self, a: str, b: str, row: int, length: float | None) -> float:
        """Return sqrt(length^2 - distance^2) of a string in one row; 0 if it is taut.

        a, b : the points at its ends.
        length : None for a string without a stated length, which is as long as the
            largest distance of its ends.
        """
        distances = np.linalg.norm(self._positions[a] - self._positions[b], axis=0)
        longest = float(np.nanmax(distances)) if length is None else length
        left = longest**2 - float(distances[row]) ** 2
        return left**0.5 if left > (TAUT * longest) ** 2 else 0.0

    def _colours(self) -> list[str]:
        """Return the colour of each shape.

        It is the colour of the shape's point or, if the shape moves, one of its own.
        """
        found, own = [], len(self._pens)
        for body in self._bodies:
            pen = self._pens.get(body.shape.point)
            if pen is None and body.moves:
                pen, own = PENS[own % len(PENS)], own + 1
            found.append(pen["color"] if pen else DIM)
        return found

    def _draw_bodies(self, axes: Axes, view: Array) -> None:
        """Draw the shapes; the rows of `view` (2, d) point right and up."""
        drawn = list(zip(self._bodies, self._colours(), strict=True))
        last = max((len(b.at) for b in self._bodies), default=1) - 1
        between = [last * k // (BETWEEN_TIMES + 1) for k in range(1, BETWEEN_TIMES + 1)]
        times = [(0, START_EDGE, 0.35), *((row, THIN_EDGE, 0.0) for row in between)]
        times.append((last, END_EDGE, 0.8))
        for level, (row, pen, full) in enumerate(times, 1 - len(times)):
            found = []
            for body, colour in drawn:
                if level and not body.moves:
                    continue
                if body.height is not None:
                    plane(axes, view, body.height, self._extents)
                elif (shown := projected(body, row, view)) is not None:
                    found.append((shown, body, colour))
            for shown, body, colour in sorted(found, key=lambda one: one[0].depth):
                style = pen | {"color": colour, "zorder": 1.8 + 0.1 * level}
                strong = full if body.moves else 0.3
                for face, turned in shown.faces if strong else ():
                    mixed = 1.0 - (0.12 + 0.25 * turned) * (
                        1.0 - np.array(to_rgb(colour))
                    )
                    axes.add_artist(
                        Polygon(
                            face, facecolor=(*mixed, strong), zorder=style["zorder"]
                        )
                    )
                edges(axes, shown.lines, shown.hidden, body, style)


# --- Shapes and links, in inches on paper

# Edges of a shape: number of times between start and end; pens at the start, between,
# and at the end.
BETWEEN_TIMES = 4
START_EDGE: Pen = {"linewidth": 0.6}
THIN_EDGE: Pen = {"linewidth": 0.35, "alpha": 0.6}
END_EDGE: Pen = {"linewidth": 0.9}
HIDDEN_EDGE: Pen = {"linewidth": 0.35, "dashes": (2.0, 2.0)}
# Sizes in inches: hatches of a ground and their distance, the head of an arrow, a coil
# or a damper's cylinder; number of turns of a spring.
HATCH, APART, HEAD, COIL, TURNS = 0.07, 0.08, 0.08, 0.045, 8
# Largest number of hatches of an edge.
MOST_HATCHES = 400


def _bodies(data: PlotData, model: Model) -> list[Body]:
    """Return the shapes in at most 500 rows, the first and the last included."""
    count = len(data.rows.sampled("t"))
    rows = np.unique(np.linspace(0, count - 1, 500).astype(int))
    known = [name for name in needed(model) if name in data.rows]
    columns = {name: data.rows.sampled(name)[rows] for name in known}
    return bodies(model, columns, len(rows))


def inch_of(axes: Axes) -> float:
    """Return the data units per inch of a panel's horizontal axis, for symbols."""
    low, high = axes.get_xlim()
    return (high - low) / size_of(axes)[0]


def edges(axes: Axes, lines: Array, hidden: Array, body: Body, style: Pen) -> None:
    """Draw the visible and the hidden edges (n, 2) of a body.

    lines, hidden : see `projected`.
    style : the pen.
    """
    inch, kind = inch_of(axes), body.shape.kind
    if kind == "ground":
        lines = _hatched(lines, inch)
    elif kind == "arrow":
        lines, head = _arrow(lines[-2:], inch)
        axes.add_artist(Polygon(head, facecolor=style["color"], zorder=style["zorder"]))
    line(axes, lines[:, 0], lines[:, 1], style)
    if len(hidden):
        line(axes, hidden[:, 0], hidden[:, 1], style | HIDDEN_EDGE)


def _along(a: Array, b: Array) -> tuple[float, Array, Array]:
    """Return the length from a to b, the unit vector (2,), and its left normal (2,)."""
    length = float(np.hypot(*(b - a)))
    u = (b - a) / length if length else np.array((1.0, 0.0))
    return length, u, np.array((-u[1], u[0]))


def _hatched(lines: Array, inch: float) -> Array:
    """Return the path `lines` (n, 2), to which hatches at its right are added.

    inch : data units per inch.
    """
    gap, found = np.full(2, np.nan), [lines]
    for a, b in pairwise(lines):
        length, u, left = _along(a, b)
        if not np.isfinite(length) or not length:
            continue
        count = min(int(length / (APART * inch)), MOST_HATCHES)
        for k in range(count + 1):
            start = a + u * (k + 0.5) * length / (count + 1)
            end = start - 0.7 * HATCH * inch * (left + u)
            found.append(np.stack((gap, start, end)))
    return np.concatenate(found)


def _arrow(ends: Array, inch: float) -> tuple[Array, Array]:
    """Return the shaft (2, 2) of an arrow, and the corners of its head (3, 2).

    ends : (2, 2), tail and tip.
    inch : data units per inch.
    """
    length, u, left = _along(*ends)
    head = min(HEAD * inch, 0.6 * length)
    neck = ends[1] - head * u
    return (
        np.stack((ends[0], neck)),
        np.stack((ends[1], neck + 0.42 * head * left, neck - 0.42 * head * left)),
    )


def _spring(a: Array, b: Array, inch: float) -> Array:
    """Return a zigzag from a to b, as a path (n, 2).

    a, b : (2,), the ends.
    inch : data units per inch.
    """
    length, u, left = _along(a, b)
    along = np.concatenate(([0.0], np.linspace(0.12, 0.88, 2 * TURNS + 2), [1.0]))
    aside = np.zeros(len(along))
    aside[2:-2] = COIL * inch * (1.0 - 2.0 * (np.arange(2 * TURNS) % 2))
    return np.asarray(a + length * np.outer(along, u) + np.outer(aside, left))


def _damper(a: Array, b: Array, inch: float) -> Array:
    """Return a cylinder that is open towards b, with a piston, as a path (n, 2).

    a, b : (2,), the ends.
    inch : data units per inch.
    """
    length, u, left = _along(a, b)
    wide, gap = COIL * inch * left, np.full(2, np.nan)
    begin, middle, end = (a + share * length * u for share in (0.35, 0.5, 0.65))
    return np.stack((
        a, begin, gap, end + wide, begin + wide, begin - wide, end - wide, gap,
        middle + 0.8 * wide, middle - 0.8 * wide, gap, middle, b,
    ))  # fmt: skip


def _string(a: Array, b: Array, slack: Array) -> Array:
    """Return a parabola (n, 2) from a to b: a string that sags by `slack` (2,)."""
    s = np.linspace(0.0, 1.0, STRING if slack.any() else 2)[:, np.newaxis]
    return np.asarray(a + s * (b - a) + 4.0 * SAG * s * (1.0 - s) * slack)


# Outlines of links that are not straight lines.
LOOKS = {"spring": _spring, "damper": _damper}


def plane(
    axes: Axes, view: Array, z: float, extents: Sequence[tuple[float, float]]
) -> None:
    """Draw a level ground of space: a line in a side view, an area from above.

    view : (2, 3), directions right and up.
    z : height of the ground.
    extents : range of each component.
    """
    (left, right), (front, back), _ = extents
    style: Pen = {"color": DIM, "linewidth": 0.9, "zorder": 1.0}
    if (not view[0, 2] and not view[:, 1].any()) or not view[:, 0].any():
        low, high = axes.get_xlim()
        x, y = _hatched(np.array(((low, z), (high, z))), inch_of(axes)).T
        line(axes, x, y, style)
    elif view[1, 2]:
        corners = [(left, front), (right, front), (right, back), (left, back)]
        flat = np.array([(x, y, z) for x, y in corners]) @ view.T
        axes.add_artist(Polygon(flat, facecolor=(0, 0, 0, 0.06), zorder=1.0))
