"""The pictures of a run: energy, trajectory, constraint forces, the model's plots.

Columns against time are drawn in panels below and beside each other, plots that the
model asks for against time or against each other.
"""

from __future__ import annotations

import gc
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.native.link import ahead
from lagsim.outputs.attempted import attempted
from lagsim.outputs.curves import (
    LOST,
    MARKS,
    OTHERS,
    Mark,
    dotted,
    inches,
    marks,
    path,
    series,
    shade,
    stems,
)
from lagsim.outputs.figure import (
    BELOW_PANELS,
    BLACK,
    DIM,
    EDGE,
    INK,
    LEFT,
    NOTHING,
    PENS,
    RIGHT,
    SMALL,
    WIDTH,
    Picture,
    content,
    fitted,
    frame,
    in_house_style,
    legend_above,
    mark,
)
from lagsim.outputs.scale import (
    Scale,
    extent,
    log_scale,
    noise_scale,
    power_of_ten,
    read_off,
    size_of,
    spread_scale,
    time_scale,
    value_scale,
    with_one_power,
)
from lagsim.outputs.views import Views
from lagsim.run.observers.thinning import DRIFT
from lagsim.tolerances import ZERO_BESIDE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.model.model import Model, Plot, Scene
    from lagsim.outputs.attempted import Made
    from lagsim.outputs.figure import Pen
    from lagsim.outputs.record import Record
    from lagsim.run.observers.thinning import Array

# --- What pictures of a run have in common


def begun(
    record: Record,
    height: float,
    subject: str,
    *,
    width: float = WIDTH,
    timed: bool = True,
) -> Picture:
    """Return a picture with title, subject and legend of events, and no panels yet."""
    names: list[tuple[str, Pen]] = []
    if timed:
        names += [(look.name, look.top) for look, _ in happened(record)]
    if record.horizon < record.rows.last("t"):
        names.append(("past the horizon", {"color": LOST, "linewidth": 6.0}))
    return Picture(
        height, record.title, subject, width=width, legend=names,
        remarks=[record.note] if record.note else (),
    )  # fmt: skip


def happened(record: Record) -> list[tuple[Mark, Sequence[float]]]:
    """Return the marks of events, with their times."""
    known = [(look, record.events.get(kind, ())) for kind, look in MARKS.items()]
    others = [t for k, own in record.events.items() if k not in MARKS for t in own]
    return [(look, times) for look, times in (*known, (OTHERS, others)) if times]


def mark_events(record: Record, axes: Axes) -> None:
    """Mark events on Axes against time, and shade what is no forecast."""
    shade(axes, record.horizon)
    for look, times in happened(record):
        marks(axes, times, look)


def time_of(record: Record) -> Scale:
    """Return the scale of time, from the first row to the last."""
    return time_scale(np.array([record.rows.first("t"), record.rows.last("t")]))


# --- Columns against time

# Inches for the numbers at the left of a small panel, and above each for its name.
NUMBERS, APART = 0.46, 0.25

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
    height : how much of a picture they take.
    """

    def __init__(self, record: Record, groups: Sequence[tuple[str, ...]]) -> None:
        self._record = record
        abreast, self._each = next(x for most, *x in GRIDS if len(groups) <= most)
        self._groups, self._abreast = in_pairs(groups, int(abreast))
        self._rows = -(-len(self._groups) // self._abreast)
        self.height = self._rows * (self._each + APART) + BELOW_PANELS

    def draw(self, picture: Picture, *, above: bool = False) -> None:
        """Draw them below the header, with all names `above` them or as it fits."""
        record, abreast = self._record, self._abreast
        left, width = LEFT, WIDTH - LEFT - RIGHT
        if abreast > 1:
            left, above = EDGE + NUMBERS, True
            width = (WIDTH - RIGHT - EDGE) / abreast - NUMBERS
        panels = picture.panels(
            [width] * abreast, [self._each] * self._rows, left=left, top=APART,
            across=NUMBERS, down=APART,
        )  # fmt: skip
        sizes: dict[str, float] = {}
        for name in (name for group in self._groups for name in group):
            unit, height = record.unit(name), height_of(record.rows.series(name)[1])
            sizes[unit] = max(sizes.get(unit, 0.0), height)
        under = self._groups[abreast:]
        for axes, group, follows in zip_longest(panels.flat, self._groups, under):
            if not group:
                axes.remove()
                continue
            unit = record.unit(group[0])
            written = [record.letters.name(name) for name in group]
            drawn = [record.rows.series(name) for name in group]
            scale = scale_of(group, drawn, sizes[unit])
            frame(
                axes, time_of(record), scale, up=(", ".join(written), unit),
                below=NOTHING if follows else record.named("t"),
                above=(above or None) if len(group) == 1 else False,
            )  # fmt: skip
            mark_events(record, axes)
            shown = stems if group[0].startswith(IMPULSE) else series
            for (t, values), pen in zip(drawn, PENS, strict=False):
                shown(axes, t, values, pen)
            tell(axes, scale, drawn, above=above)
            if len(group) > 1:
                legend_above(axes, list(zip(written, PENS, strict=False)))
        picture.align_ylabels()


def scale_of(
    group: Sequence[str], drawn: Sequence[tuple[Array, Array]], size: float
) -> Scale:
    """Return the scale of columns, beside others of their unit of this size."""
    if group[0].startswith(IMPULSE):  # single values, each with a size of its own
        return value_scale(*(values for _, values in drawn), size=size)
    return spread_scale(*drawn, size=size)


def tell(
    axes: Axes,
    scale: Scale,
    drawn: Sequence[tuple[Array, Array]],
    *,
    above: bool = False,
) -> None:
    """Write the limit of the linear part of a scale, and the greatest value."""
    if not scale.linear:
        return
    every = [np.where(np.isfinite(t + values), values, 0.0) for t, values in drawn]
    sizes = [float(np.abs(values).max(initial=0.0)) for values in every]
    k = int(np.argmax(sizes))
    at = int(np.abs(every[k]).argmax())
    t, most = drawn[k][0], read_off(float(every[k][at]))
    said = f"powers of ten beyond {read_off(scale.linear)}"
    width, _ = size_of(axes)
    if above:  # in a small panel it would stand across the curve
        text = fitted(f"{most}; {said}", 0.68 * width, SMALL)
        axes.set_title(text, loc="right", color=DIM)
        return
    # Where the greatest value is not.
    x, side = (0.01, "left") if t[at] > 0.5 * (t[0] + t[-1]) else (0.99, "right")
    text = fitted(f"{most} at t = {read_off(t[at], 5)}; {said}", width, SMALL)
    look: Pen = {"size": SMALL, "color": DIM, "transform": axes.transAxes}
    axes.text(x, 0.96, text, ha=side, va="top", **look)


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
SIDES = ("y", "y2")


@in_house_style
def plot(record: Record, number: int, wanted: Plot, scene: Scene) -> Picture:
    """Draw one entry of the model's `output.plots`, `number` counted from 0."""
    curves, timed = wanted.curves(number), wanted.x.text.strip() == "t"
    x, *names = curves
    texts = {name: record.letters.text(curve.text) for name, curve in curves.items()}
    pens = dict(zip(names, PENS * 2, strict=False))
    drawn = {name: _values(record, wanted, x, name, timed=timed) for name in names}
    scales = _scales(record, wanted, drawn, timed=timed)
    right = LEFT if wanted.y2 else RIGHT
    size = WIDTH - LEFT - right, HEIGHT
    if not timed and _has_one_scale(record, wanted, number, scene, drawn):
        size = _equal(scales, size[0])
    named = APART if len(names) > 1 else 0.06
    picture = begun(record,
        named + size[1] + BELOW_PANELS, wanted.title, timed=timed,
        width=LEFT + size[0] + right,
    )  # fmt: skip
    [[axes]] = picture.panels([size[0]], [size[1]], top=named)
    below = (record.letters.text(wanted.x.text), record.unit("t" if timed else x))
    for side in SIDES if wanted.y2 else SIDES[:1]:
        own = [name for name in names if side_of(name) == side]
        units = {record.unit(name) for name in own}
        up = ", ".join(texts[n] for n in own), units.pop() if len(units) == 1 else ""
        single = wanted.y2 and len(own) == 1
        colour = pens[own[0]]["color"] if single else INK
        panel = axes if side == "y" else axes.twinx()
        frame(
            panel, scales["x"], scales[side], below=below, up=up, colour=colour,
            above=None if len(names) == 1 else False,
        )  # fmt: skip
        if timed and side == "y":
            mark_events(record, axes)
            tell(axes, scales[side], [drawn[name] for name in own])
        for name in own:
            _draw(record, panel, *drawn[name], pens[name], timed=timed)
    if len(names) > 1:
        legend_above(axes, [(texts[name], pens[name]) for name in names])
    return picture


def side_of(name: str) -> str:
    """Return the axis of a curve: y, or y2 at the right."""
    return name.split(".")[2]


def _values(
    record: Record, wanted: Plot, x: str, name: str, *, timed: bool
) -> tuple[Array, Array]:
    """Return the values to draw, with gaps where a logarithm has none."""
    # Against time the envelope keeps spikes; others need both values of a row.
    across, up = record.rows.series(name) if timed else record.rows.path(x, name)
    if "x" in wanted.log:
        across = np.where(across > 0.0, across, np.nan)
    if side_of(name) in wanted.log:
        up = np.where(up > 0.0, up, np.nan)
    return across, up


def _scales(
    record: Record,
    wanted: Plot,
    drawn: Mapping[str, tuple[Array, Array]],
    *,
    timed: bool,
) -> dict[str, Scale]:
    xs = [x for x, _ in drawn.values()]
    scales = {"x": time_of(record) if timed else value_scale(*xs, margin=0.03)}
    if "x" in wanted.log:
        scales["x"] = log_scale(*xs, margin=0.0, least=0.0)
    for side in SIDES:
        own = [found for name, found in drawn.items() if side_of(name) == side]
        values = [y for _, y in own]
        if side in wanted.log:
            scales[side] = log_scale(*values)
        else:
            scales[side] = spread_scale(*own) if timed and own else value_scale(*values)
    return scales


def _has_one_scale(
    record: Record,
    wanted: Plot,
    number: int,
    scene: Scene,
    drawn: Mapping[str, tuple[Array, Array]],
) -> bool:
    """Tell whether both directions are of one kind: then circles are round."""
    if wanted.y2 or wanted.log:
        return False
    curves = wanted.curves(number)
    units = {record.unit(name) for name in curves}
    components = {node for parts in scene.points.values() for node in parts}
    is_known = units != {""} and len(units) == 1
    is_known |= all(curve.node in components for curve in curves.values())
    is_known |= all(curve.text in DIRECTIONS for curve in curves.values())
    ends = [extent(*x) or (0.0, 0.0) for x in zip(*drawn.values(), strict=True)]
    spans = [high - low for low, high in ends]
    return is_known and 0.0 < max(spans) <= LONGEST * min(spans)


def _equal(scales: dict[str, Scale], widest: float) -> tuple[float, float]:
    """Give both directions one scale; return width and height of the panel."""
    ends = [(scales[axis].low, scales[axis].high) for axis in "xy"]
    spans = [high - low for low, high in ends]
    scale = max(spans[0] / widest, spans[1] / TALLEST)
    sides = max(spans[0] / scale, NARROWEST), max(spans[1] / scale, 0.5 * NARROWEST)
    found = []
    for (low, high), side in zip(ends, sides, strict=True):
        middle, half = 0.5 * (low + high), 0.5 * scale * side
        found.append(Scale(middle - half, middle + half))
    scales |= dict(zip("xy", with_one_power(found), strict=True))
    return sides


def _draw(
    record: Record, axes: Axes, x: Array, y: Array, pen: Pen, *, timed: bool
) -> None:
    if timed:
        series(axes, x, y, pen)
        return
    dots = mark(".", 1.2, pen["color"])
    pen = dots if dotted(*inches(axes, x, y)) else pen
    path(axes, x, y, pen, record.trusted())


# --- The pictures

# The panels of the energies and of their drift, in inches.
TALL, LOW = 2.2, 1.1
# The picture that takes longest.
LONG = "trajectory"


@in_house_style
def energy(record: Record) -> Picture:
    """Draw the energies, and below them how far energy - work strays from its start.

    Parameters
    ----------
    record : its rows have `energy` and `kinetic`, `potential` or `lagrangian`, and
        the difference `DRIFT` where there is a column `work`.
    """
    heights = [TALL, LOW]
    picture = begun(record, sum(heights) + 2 * APART + BELOW_PANELS, "energy")
    width = WIDTH - LEFT - RIGHT
    (axes,), (lower,) = picture.panels([width], heights, top=APART, down=APART)
    total = "energy T + V" if record.is_sum else "energy function h = Σ q̇ ∂L/∂q̇ − L"
    named = {"kinetic": "kinetic T", "potential": "potential V"}
    named |= {"lagrangian": "lagrangian L", "energy": total}
    names = [name for name in named if name in record.rows]
    pens = dict(zip(names, (*PENS[: len(names) - 1], BLACK), strict=True))
    drawn = {name: record.rows.series(name) for name in names}
    values = spread_scale(*drawn.values())
    frame(axes, time_of(record), values, up=("energy", record.unit("energy")))
    mark_events(record, axes)
    for name in names:
        series(axes, *drawn[name], pens[name])
    tell(axes, values, list(drawn.values()))
    legend_above(axes, [(named[name], pens[name]) for name in names])
    _drift(lower, record)
    picture.align_ylabels()
    return picture


def _drift(axes: Axes, record: Record) -> None:
    balance = DRIFT if DRIFT in record.rows else "energy"
    t, values = record.rows.series(balance)
    drift = values - (values[0] if len(values) else 0.0)
    size = max(height_of(record.rows.series("energy")[1]), height_of(values))
    unit = record.unit("energy")
    scale = noise_scale(drift, size)
    frame(axes, time_of(record), scale, below=record.named("t"), up=("drift", unit))
    mark_events(record, axes)
    series(axes, t, drift, BLACK)
    what = "energy − work" if balance == DRIFT else "energy"
    worst = height_of(drift)
    most = f"at most {_written(worst)} {unit}" if worst else "0 in every row"
    text = f"{what} minus its first value: {most}".rstrip()
    axes.set_title(fitted(text, WIDTH - LEFT - RIGHT, SMALL))


def _written(value: float) -> str:
    """Return a size in two digits, as one writes it by hand."""
    digits, exponent = f"{value:.1e}".split("e")
    power = int(exponent)
    return f"{digits} × {power_of_ten(power)}" if power else digits


@in_house_style
def trajectory(record: Record, coordinates: Sequence[str], scene: Scene) -> Picture:
    """Draw the coordinates against time, and the paths of the scene's points."""
    shown = chosen(coordinates, MOST_PANELS)
    panels = Panels(record, grouped(record, shown))
    views = Views(record, scene)
    subject = _counted("coordinates", len(shown), len(coordinates))
    picture = begun(record, panels.height + views.height, subject)
    panels.draw(picture)
    if views.height:
        views.draw(picture, panels.height)
    return picture


@in_house_style
def constraint_forces(
    record: Record, coordinates: Sequence[str], constraints: Sequence[str]
) -> Picture:
    """Draw the constraint force on each coordinate, each multiplier and impulse."""
    forces = [f"Qc_{name}" for name in coordinates]
    multipliers = [f"lambda_{name}" for name in constraints]
    columns = record.rows.columns
    multipliers += [name for name in columns if name.startswith("friction.")]
    impulses = [name for name in columns if name.startswith(IMPULSE)]
    total = len(forces) + len(multipliers) + len(impulses)
    families = _acting(record, (forces, multipliers, impulses))
    acting = sum(len(names) for names in families)
    left = acting
    shown: list[str] = []
    for names in families:
        room = MOST_PANELS - len(shown)
        shown += chosen(
            names, room if left <= room else max(1, room * len(names) // left)
        )
        left -= len(names)
    subject = "constraint forces Qc and multipliers λ"
    if families[2]:
        subject = "constraint forces and impulses"
    if acting < total:
        subject = f"{subject}; {total - acting} more are 0"
    else:
        subject = _counted(subject, len(shown), total)
    panels = Panels(record, [(name,) for name in shown])
    picture = begun(record, panels.height, subject)
    panels.draw(picture, above=True)
    return picture


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
        if size > ZERO_BESIDE * max(own.values())
    }
    found = [[name for name in names if name in acting] for names in families]
    return found if acting else [families[0][:1], [], []]


def _counted(subject: str, shown: int, total: int) -> str:
    return subject if shown == total else f"{subject}: {shown} of {total} are shown"


def pictures(record: Record, model: Model) -> Iterator[Made]:
    """Give file name and content of every picture of a run, one after the other."""
    files = dict(_files(record, model))
    # The one that takes as long as all others.
    files[LONG] = ahead.bring(files[LONG])
    for key, file in files.items():
        name = f"{key}.{record.form}"
        yield name, attempted(name, file)
        # A figure holds the pixels that it was drawn on, some megabytes, and itself.
        if not gc.isenabled():  # see `cli.entry`
            gc.collect(0)


def _files(record: Record, model: Model) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Give what makes the file of each picture, by its name."""

    def file(draw: Callable[..., Picture], *about: Any) -> Callable[[], bytes]:
        return lambda: content(draw(record, *about), record.form)

    coordinates = [coordinate.name for coordinate in model.coordinates]
    yield "energy", file(energy)
    yield LONG, file(trajectory, coordinates, model.scene)
    if model.constraints:
        names = [constraint.name for constraint in model.constraints]
        yield "constraint_forces", file(constraint_forces, coordinates, names)
    for number, wanted in enumerate(model.output.plots):
        yield f"plot_{number + 1}", file(plot, number, wanted, model.scene)
