"""A plot that the model asks for: curves against time or against each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.curves import dotted, inches, path, series
from lagsim.outputs.record import LEFT, REACH, RIGHT
from lagsim.outputs.scale import (
    Scale,
    extent,
    log_scale,
    spread_scale,
    value_scale,
    with_one_power,
)
from lagsim.outputs.sheet import INK, PENS, WIDTH, mark
from lagsim.outputs.time_panels import tell

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.model.model import Plot, Scene
    from lagsim.outputs.record import Record
    from lagsim.outputs.sheet import Named, Pen, Sheet
    from lagsim.run.observers.thinning import Array

# Inches: of a panel; at most, and at least, where both directions have one scale.
HEIGHT, TALLEST, NARROWEST = 3.6, 5.2, 2.4
# Where one scale would make one side so many times longer than the other, a path would
# look like a line.
LONGEST = 12.0
DIRECTIONS = frozenset("xyz")


class PlotPanel:
    """One entry of `output.plots`, `number` counted from 0.

    Attributes
    ----------
    timed : whether it is drawn against time.
    height : of the sheet that it takes below its title, in inches.
    width : of the sheet.
    """

    def __init__(self, record: Record, number: int, wanted: Plot, scene: Scene) -> None:
        self._record, self._wanted, self._number = record, wanted, number
        self.timed = wanted.x.text.strip() == "t"
        names = list(wanted.curves(number))
        self._x = names[0]
        self._sides = {
            axis: [name for name in names if name.split(".")[2] == axis]
            for axis in ("y", "y2")
        }
        self._drawn = {name: self._values(name) for name in names[1:]}
        self._is_equal = self._has_one_scale(scene)
        self._scales = self._scaled()
        across, up = WIDTH - LEFT - RIGHT, HEIGHT
        if wanted.y2:
            across -= LEFT - RIGHT
        if self._is_equal:
            across, up = self._fit(across)
        self._size = across, up
        self.width = across + LEFT + (LEFT if wanted.y2 else RIGHT)
        self.height = up + 0.45

    def _values(self, name: str) -> tuple[Array, Array]:
        """Give what is drawn; what has no place on an axis of powers is a gap."""
        rows, log = self._record.rows, self._wanted.log
        # Against time the envelope keeps spikes; others need both values of a row.
        x, y = rows.series(name) if self.timed else rows.path(self._x, name)
        if "x" in log:
            x = np.where(x > 0.0, x, np.nan)
        if name.split(".")[2] in log:
            y = np.where(y > 0.0, y, np.nan)
        return x, y

    def _has_one_scale(self, scene: Scene) -> bool:
        """Tell whether both directions are of one kind: then circles are round."""
        wanted, record = self._wanted, self._record
        if self.timed or wanted.y2 or wanted.log:
            return False
        curves = wanted.curves(self._number)
        units = {record.unit(name) for name in curves}
        components = {node for parts in scene.points.values() for node in parts}
        is_known = units != {""} and len(units) == 1
        is_known |= all(curve.node in components for curve in curves.values())
        is_known |= all(curve.text in DIRECTIONS for curve in curves.values())
        found = self._extents()
        spans = [high - low for low, high in found]
        return is_known and 0.0 < max(spans) <= LONGEST * min(spans)

    def _extents(self) -> list[tuple[float, float]]:
        xs, ys = zip(*self._drawn.values(), strict=True)
        return [extent(*values) or (0.0, 0.0) for values in (xs, ys)]

    def _scaled(self) -> dict[str, Scale]:
        log = self._wanted.log
        xs = [x for x, _ in self._drawn.values()]
        scales = {"x": value_scale(*xs, margin=0.03)}
        if self.timed:
            scales["x"] = self._record.time()
        if "x" in log:
            scales["x"] = log_scale(*xs, margin=0.0, least=0.0)
        for axis, names in self._sides.items():
            drawn = [self._drawn[name] for name in names]
            values = [y for _, y in drawn]
            if axis in log:
                scales[axis] = log_scale(*values)
            elif self.timed and names:
                scales[axis] = spread_scale(*drawn)
            else:
                scales[axis] = value_scale(*values)
        return scales

    def _fit(self, widest: float) -> tuple[float, float]:
        """Give both directions one scale; return width and height of the panel."""
        ends = [(self._scales[axis].low, self._scales[axis].high) for axis in "xy"]
        spans = [high - low for low, high in ends]
        scale = max(spans[0] / widest, spans[1] / TALLEST)
        sides = [span / scale for span in spans]
        sides[0] = max(sides[0], NARROWEST)
        sides[1] = max(sides[1], 0.5 * NARROWEST)
        for axis, (low, high), side in zip("xy", ends, sides, strict=True):
            middle, half = 0.5 * (low + high), 0.5 * scale * side
            self._scales[axis] = Scale(middle - half, middle + half)
        shared = with_one_power([self._scales["x"], self._scales["y"]])
        self._scales |= dict(zip("xy", shared, strict=True))
        return sides[0], sides[1]

    def pens(self) -> Mapping[str, Pen]:
        """Return the pen of each curve."""
        return dict(zip(self._drawn, PENS * 2, strict=False))

    def draw(self, sheet: Sheet, top: float) -> None:
        """Draw it below `top`."""
        wanted, record = self._wanted, self._record
        curves, pens = wanted.curves(self._number), self.pens()
        if len(pens) > 1:
            entries = [
                (record.letters.text(curves[name].text), pen)
                for name, pen in pens.items()
            ]
            sheet.legend(LEFT, top - 0.06, entries, self._size[0])
        place = (LEFT, top, *self._size)
        unit = record.unit("t" if self.timed else self._x)
        below = (record.letters.text(wanted.x.text), unit)
        axes = sheet.panel(
            place, self._scales["x"], self._scales["y"], below=below,
            side=self._named("y"), reach=REACH, colour=self._colour("y"),
        )  # fmt: skip
        if self.timed:
            record.mark(axes)
        self._draw_curves(axes, self._sides["y"])
        if self.timed:
            drawn_left = [self._drawn[name] for name in self._sides["y"]]
            tell(sheet, place, self._scales["y"], drawn_left)
        if self._sides["y2"]:
            aside = sheet.panel(
                place, self._scales["x"], self._scales["y2"],
                side=self._named("y2"), reach=REACH, over=axes,
                colour=self._colour("y2"),
            )  # fmt: skip
            self._draw_curves(aside, self._sides["y2"])

    def _named(self, axis: str) -> Named:
        """Name the curves of an axis, and the unit that all of them have."""
        record, curves = self._record, self._wanted.curves(self._number)
        names = self._sides[axis]
        units = {record.unit(name) for name in names}
        texts = [record.letters.text(curves[name].text) for name in names]
        return ", ".join(texts), units.pop() if len(units) == 1 else ""

    def _colour(self, axis: str) -> str:
        """Give the colour of an axis with one curve, where there are two axes."""
        names, pens = self._sides[axis], self.pens()
        single = len(names) == 1 and self._sides["y2"]
        return str(pens[names[0]]["color"]) if single else INK

    def _draw_curves(self, axes: Axes, names: Sequence[str]) -> None:
        pens = self.pens()
        for name in names:
            (x, y), pen = self._drawn[name], pens[name]
            if self.timed:
                series(axes, x, y, pen)
                continue
            dots = mark(".", 1.2, pen["color"])
            path(
                axes, x, y, dots if dotted(*inches(axes, x, y)) else pen,
                self._record.trusted(),
            )  # fmt: skip
