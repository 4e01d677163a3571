"""The pictures of a run: energy, trajectory, constraint forces, the model's plots.

Columns against time are drawn in panels below and beside each other, plots that the
model asks for against time or against each other.
"""

from __future__ import annotations

import gc
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lagsim.native.link import ahead
from lagsim.outputs.attempted import attempted
from lagsim.outputs.curves import dotted, inches, path, series, stems
from lagsim.outputs.record import LEFT, REACH, RIGHT, Record, header, header_height
from lagsim.outputs.scale import (
    NOISE,
    Scale,
    extent,
    log_scale,
    noise_scale,
    power_of_ten,
    read_off,
    spread_scale,
    value_scale,
    with_one_power,
)
from lagsim.outputs.scene_panel import ScenePanel
from lagsim.outputs.sheet import (
    BLACK,
    DIM,
    EDGE,
    INK,
    LINE,
    NOTHING,
    PENS,
    SMALL,
    WIDTH,
    Place,
    Sheet,
    in_house_style,
    mark,
    text_width,
)
from lagsim.run.observers.thinning import DRIFT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.model.model import Model, Plot, Scene
    from lagsim.outputs.attempted import Made
    from lagsim.outputs.sheet import Named, Pen
    from lagsim.run.observers.thinning import Array

# --- Columns against time

# Inches for the numbers at the left of a small panel.
NUMBERS = 0.46

# Coordinates of one unit share a panel while they are few, and while none of them
# would be squeezed by the others into less than this part of it.
SHARING = 3
SQUEEZED = 0.05

# Columns that are 0 but in the rows after impacts.
IMPULSE = "impulse."

# More panels than this would be too small to read.
MOST_PANELS = 40

# Up to so many panels: how many stand beside each other, and their height.
GRIDS = (
    (1, 1, 2.4), (2, 1, 1.6), (3, 1, 1.25), (4, 1, 1.05), (5, 1, 0.95), (12, 2, 0.95),
    (24, 3, 0.8), (MOST_PANELS, 5, 0.55),
)  # fmt: skip
# So many beside each other where some are pairs, which three or five would part.
IN_PAIRS = 4


def grouped(record: Record, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Put columns of one unit into one group where they fit, in the given order."""
    by_unit: dict[str, list[str]] = {}
    for name in names:
        by_unit.setdefault(record.unit(name), []).append(name)
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    for unit, alike in by_unit.items():
        if unit and 1 < len(alike) <= SHARING and _comparable(record, alike):
            groups.update(dict.fromkeys(alike, tuple(alike)))
    return list(dict.fromkeys(groups.values()))


def _comparable(record: Record, names: Sequence[str]) -> bool:
    scales = [value_scale(record.rows.series(name)[1], margin=0.0) for name in names]
    whole = max(s.high for s in scales) - min(s.low for s in scales)
    return min(s.high - s.low for s in scales) >= SQUEEZED * whole


def in_pairs(
    groups: Sequence[tuple[str, ...]], columns: int
) -> tuple[list[tuple[str, ...]], int]:
    """Put x and y of a body side by side: an empty group is a free place.

    Give the groups, and how many stand beside each other.
    """
    firsts = {one for one, other in pairwise(groups) if _is_pair(one[0], other[0])}
    if firsts and columns > 1 and columns % 2:
        columns = IN_PAIRS
    found: list[tuple[str, ...]] = []
    for group in groups:
        if group in firsts and columns > 1 and len(found) % columns == columns - 1:
            found.append(())
        found.append(group)
    return found, columns


def _is_pair(one: str, other: str) -> bool:
    """Tell whether two names differ in an x and a y alone."""
    differ = [(a, b) for a, b in zip(one, other, strict=False) if a != b]
    return len(one) == len(other) and differ in ([("x", "y")], [("X", "Y")])


def chosen(names: Sequence[str], most: int) -> list[str]:
    """Return at most so many of the names, evenly spaced, first and last included."""
    if len(names) <= most:
        return list(names)
    if most == 1:
        return [names[0]]
    return [names[k * (len(names) - 1) // (most - 1)] for k in range(most)]


class Panels:
    """A grid of panels, one for each group of columns.

    Attributes
    ----------
    total : how much of a sheet the panels take, with the time axis below.
    gap : how much of it is above each of them.
    """

    def __init__(
        self,
        record: Record,
        groups: Sequence[tuple[str, ...]],
        least: float = 0.0,
        *,
        paired: bool = False,
    ) -> None:
        self._record, self._groups = record, groups
        self._aside = 0.0
        self._columns, self._height = next(
            size for most, *size in GRIDS if len(groups) <= most
        )
        self._wide = self._columns == 1
        self._groups, self._columns = in_pairs(groups, int(self._columns))
        groups = self._groups
        self._headed = [self._is_headed(group) for group in groups]
        if paired:  # all names in one place
            self._headed = [any(self._headed)] * len(groups)
        self.gap = 0.25
        if self._wide:
            self.gap = 0.24 if any(self._headed) else 0.12
        rows = -(-len(groups) // self._columns)
        self._height = max(self._height, least / rows - self.gap)
        self.total = rows * (self._height + self.gap) + 0.45

    @property
    def tall(self) -> float:
        """How high they are, from the frame of the first to that of the last."""
        return self.total - 0.45 - self.gap

    def leave(self, width: float) -> None:
        """Leave so much free at their right."""
        self._aside = width

    def _is_headed(self, group: tuple[str, ...]) -> bool:
        """Whether the name stands above the panel and not at its side."""
        if not group:
            return False
        # A power of ten may stand beside the unit.
        name, unit = self._record.named(group[0])
        text = f"{name} (10⁻³ {unit})"
        beside = self._wide and text_width(text) <= self._height - 0.05
        return len(group) > 1 or not beside

    @staticmethod
    def _scale(
        group: Sequence[str], drawn: Sequence[tuple[Array, Array]], size: float
    ) -> Scale:
        if group[0].startswith(IMPULSE):  # single values, each with a size of its own
            return value_scale(*(values for _, values in drawn), size=size)
        return spread_scale(*drawn, size=size)

    def draw(self, sheet: Sheet, top: float) -> None:
        """Draw them below `top`."""
        record = self._record
        width = (WIDTH - RIGHT - EDGE) / self._columns - NUMBERS
        left = EDGE + NUMBERS
        if self._wide:
            left, width = LEFT, WIDTH - LEFT - RIGHT - self._aside
        count = len(self._groups)
        sizes: dict[str, float] = {}
        for name in (name for group in self._groups for name in group):
            unit, height = record.unit(name), height_of(record.rows.series(name)[1])
            sizes[unit] = max(sizes.get(unit, 0.0), height)
        for k, group in enumerate(self._groups):
            if not group:
                continue
            row, column = divmod(k, self._columns)
            x = left + column * (width + NUMBERS)
            y = top + row * (self._height + self.gap) + self.gap
            drawn = [record.rows.series(name) for name in group]
            size = sizes[record.unit(group[0])]
            scale = self._scale(group, drawn, size)
            written = [record.letters.name(name) for name in group]
            named = (", ".join(written), record.unit(group[0]))
            above = self._headed[k] and len(group) == 1
            under = k + int(self._columns)
            is_last = under >= count or not self._groups[under]
            axes = sheet.panel(
                (x, y, width, self._height), record.time(), scale,
                below=record.named("t") if is_last else NOTHING,
                side=NOTHING if above else named,
                above=named if above else NOTHING,
                reach=REACH,
            )  # fmt: skip
            record.mark(axes)
            shown = stems if group[0].startswith(IMPULSE) else series
            for (t, values), pen in zip(drawn, PENS, strict=False):
                shown(axes, t, values, pen)
            tell(sheet, (x, y, width, self._height), scale, drawn, above=above)
            if len(group) > 1:
                names = list(zip(written, PENS, strict=False))
                sheet.legend(x, y - 0.06, names, width)


def tell(
    sheet: Sheet,
    place: Place,
    scale: Scale,
    drawn: Sequence[tuple[Array, Array]],
    *,
    above: bool = False,
) -> None:
    """Say in a panel, or above, where powers of ten begin and what is greatest."""
    if not scale.linear:
        return
    every = [np.where(np.isfinite(t + values), values, 0.0) for t, values in drawn]
    sizes = [float(np.abs(values).max(initial=0.0)) for values in every]
    k = int(np.argmax(sizes))
    at = int(np.abs(every[k]).argmax())
    t, most = drawn[k][0], read_off(float(every[k][at]))
    said = f"powers of ten beyond {read_off(scale.linear)}"
    if above:  # in a small panel it would stand across the curve
        left, top, width, _ = place
        room, x = 0.68 * width, left + width
        text = f"{most}; {said}"
        sheet.text(x, top - 0.06, text, size=SMALL, room=room, ha="right", color=DIM)
        return
    # Where the greatest value is not.
    side = "left" if t[at] - t[0] > 0.5 * (t[-1] - t[0]) else "right"
    sheet.corner(place, f"{most} at t = {read_off(t[at], 5)}; {said}", side)


def height_of(values: Array) -> float:
    """Return the greatest size among finite values; 0 where there are none."""
    low, high = extent(values) or (0.0, 0.0)
    return max(abs(low), abs(high))


# --- A plot that the model asks for

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


# --- The pictures

# Panels are above each other up to so many; the least that they take with a view of the
# scene beside them, in inches.
STACKED, BESIDE = 5, 3.3
# The picture that takes longest.
LONG = "trajectory"


@in_house_style
def energy(record: Record, *, is_sum: bool) -> Sheet:
    """Draw the energies, and below them how far energy - work strays from its start.

    Parameters
    ----------
    record : its rows have `energy` and `kinetic`, `potential` or `lagrangian`, and
        the difference `DRIFT` where there is a column `work`.
    is_sum : whether the energy is T + V, and not another energy function.
    """
    top = header_height(record) + 0.26
    width = WIDTH - LEFT - RIGHT
    sheet = record.sheet(WIDTH, top + 2.2 + 0.36 + 1.1 + 0.45)
    header(sheet, record, "energy")
    total = "energy T + V" if is_sum else "energy function h = Σ q̇ ∂L/∂q̇ − L"
    named = {"kinetic": "kinetic T", "potential": "potential V"}
    named |= {"lagrangian": "lagrangian L", "energy": total}
    names = [name for name in named if name in record.rows]
    pens = dict(zip(names, (*PENS[: len(names) - 1], BLACK), strict=True))
    drawn = {name: record.rows.series(name) for name in names}
    values = spread_scale(*drawn.values())
    side = ("energy", record.unit("energy"))
    place = (LEFT, top, width, 2.2)
    axes = sheet.panel(place, record.time(), values, side=side, reach=REACH)
    record.mark(axes)
    for name in names:
        series(axes, *drawn[name], pens[name])
    tell(sheet, place, values, list(drawn.values()))
    entries = [(named[name], pens[name]) for name in names]
    sheet.legend(LEFT, top - 0.06, entries, width)
    _drift(sheet, record, (LEFT, top + 2.56, width, 1.1))
    return sheet


def _drift(sheet: Sheet, record: Record, place: Place) -> None:
    ledger = DRIFT if DRIFT in record.rows else "energy"
    t, values = record.rows.series(ledger)
    drift = values - (values[0] if len(values) else 0.0)
    size = max(height_of(record.rows.series("energy")[1]), height_of(values))
    unit = record.unit("energy")
    axes = sheet.panel(
        place, record.time(), noise_scale(drift, size), below=record.named("t"),
        side=("drift", unit), reach=REACH,
    )  # fmt: skip
    record.mark(axes)
    series(axes, t, drift, BLACK)
    what = "energy − work" if ledger == DRIFT else "energy"
    worst = height_of(drift)
    most = f"at most {_written(worst)} {unit}" if worst else "0 in every row"
    text = f"{what} minus its first value: {most}".rstrip()
    sheet.text(LEFT, place[1] - 0.06, text, size=SMALL, room=place[2])


def _written(value: float) -> str:
    """Return a size in two digits, as one writes it by hand."""
    digits, exponent = f"{value:.1e}".split("e")
    power = int(exponent)
    return f"{digits} × {power_of_ten(power)}" if power else digits


@in_house_style
def trajectory(record: Record, coordinates: Sequence[str], scene: Scene) -> Sheet:
    """Draw the coordinates against time, and the paths of the scene's points."""
    shown = chosen(coordinates, MOST_PANELS)
    groups = grouped(record, shown)
    views = ScenePanel(record, scene, narrow=len(groups) <= STACKED)
    panels = Panels(record, groups, BESIDE if views.beside else 0.0)
    if views.beside:
        panels.leave(views.width_for(panels.tall))
    top = header_height(record)
    sheet = record.sheet(WIDTH, top + panels.total + views.height)
    header(sheet, record, _counted("coordinates", len(shown), len(coordinates)))
    panels.draw(sheet, top)
    if not views.empty:
        views.draw(sheet, top + panels.total, top + panels.gap)
    return sheet


@in_house_style
def constraint_forces(
    record: Record, coordinates: Sequence[str], constraints: Sequence[str]
) -> Sheet:
    """Draw the constraint force on each coordinate, each multiplier and impulse."""
    forces = [f"Qc_{name}" for name in coordinates]
    multipliers = [f"lambda_{name}" for name in constraints]
    columns = record.rows.columns
    multipliers += [name for name in columns if name.startswith("friction.")]
    impulses = [name for name in columns if name.startswith(IMPULSE)]
    total = len(forces) + len(multipliers) + len(impulses)
    families = _acting(record, (forces, multipliers, impulses))
    acting = sum(len(names) for names in families)
    left = sum(len(names) for names in families)
    shown: list[str] = []
    for names in families:
        room = MOST_PANELS - len(shown)
        shown += chosen(
            names, room if left <= room else max(1, room * len(names) // left)
        )
        left -= len(names)
    panels = Panels(record, [(name,) for name in shown], paired=True)
    top = header_height(record)
    sheet = record.sheet(WIDTH, top + panels.total)
    subject = "constraint forces Qc and multipliers λ"
    if families[2]:
        subject = "constraint forces and impulses"
    if acting < total:
        header(sheet, record, f"{subject}; {total - acting} more are 0")
    else:
        header(sheet, record, _counted(subject, len(shown), total))
    panels.draw(sheet, top)
    return sheet


def _acting(
    record: Record, families: Sequence[Sequence[str]]
) -> Sequence[Sequence[str]]:
    """Return the columns that are not 0 beside others of their unit, else the first."""
    sizes: dict[str, dict[str, float]] = {}
    for name in (name for names in families for name in names):
        of_unit = sizes.setdefault(record.unit(name), {})
        of_unit[name] = height_of(record.rows.series(name)[1])
    acting = {
        name
        for own in sizes.values()
        for name, size in own.items()
        if size > NOISE * max(own.values())
    }
    found = [[name for name in names if name in acting] for names in families]
    return found if acting else [families[0][:1], [], []]


def _counted(subject: str, shown: int, total: int) -> str:
    return subject if shown == total else f"{subject}: {shown} of {total} are shown"


@in_house_style
def plot(record: Record, number: int, wanted: Plot, scene: Scene) -> Sheet:
    """Draw one entry of the model's `output.plots`, `number` counted from 0."""
    panel = PlotPanel(record, number, wanted, scene)
    top = header_height(record, timed=panel.timed)
    lines = [LINE for shown in (wanted.title, len(panel.pens()) > 1) if shown]
    top += 0.06 + sum(lines)
    sheet = record.sheet(panel.width, top + panel.height)
    header(sheet, record, "", timed=panel.timed)
    if wanted.title:
        at = top - 0.06 - (LINE if len(lines) > 1 else 0.0)
        sheet.text(LEFT, at, wanted.title, size=SMALL, room=panel.width - LEFT - RIGHT)
    panel.draw(sheet, top)
    return sheet


def pictures(record: Record, model: Model, is_sum: bool) -> Iterator[Made]:
    """Give file name and content of every picture of a run, one after the other."""
    files = dict(_files(record, model, is_sum=is_sum))
    if ahead.may_send():
        # The one that takes as long as all others.
        files[LONG] = ahead.bring(files[LONG])
    for key, file in files.items():
        name = f"{key}.{record.form}"
        yield name, attempted(name, file)
        # A figure holds the pixels that it was drawn on, some megabytes, and itself.
        if not gc.isenabled():  # see `cli.entry`
            gc.collect(0)


def _files(
    record: Record, model: Model, *, is_sum: bool
) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Give what makes the file of each picture, by its name."""
    for name, draw in _drawings(record, model, is_sum=is_sum):
        yield name, partial(_file, draw)


def _file(draw: Callable[[], Sheet]) -> bytes:
    return draw().content()


def _drawings(
    record: Record, model: Model, *, is_sum: bool
) -> Iterator[tuple[str, Callable[[], Sheet]]]:
    """Give what draws each picture, by its name."""
    coordinates = [coordinate.name for coordinate in model.coordinates]
    yield "energy", partial(energy, record, is_sum=is_sum)
    yield LONG, partial(trajectory, record, coordinates, model.scene)
    if model.constraints:
        names = [constraint.name for constraint in model.constraints]
        forces = partial(constraint_forces, record, coordinates, names)
        yield "constraint_forces", forces
    for number, wanted in enumerate(model.output.plots):
        one = partial(plot, record, number, wanted, model.scene)
        yield f"plot_{number + 1}", one
