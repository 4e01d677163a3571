"""Pictures of a run: energy, trajectory, constraint forces, and the plots of the model.

A picture of several runs has a panel for each column and a curve for each run. Columns
against time are drawn in a grid of panels; plots that the model file requests are drawn
against time or against another column.
"""

from __future__ import annotations

import gc
import re
from functools import partial
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, TypeAlias

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.offsetbox import AnchoredText

from lagsim.language.columns import FORCE, FRICTION, IMPULSE, MULTIPLIER, is_of_kind
from lagsim.native.link import ahead
from lagsim.outputs import attempted
from lagsim.outputs.figure import (
    APART,
    BELOW_PANELS,
    BLACK,
    COLOURS,
    DIM,
    INK,
    LOST,
    MARKS,
    NOTHING,
    OF_SMALL_PRINT,
    OTHERS,
    PENS,
    SMALL,
    WIDTH,
    Mark,
    Picture,
    draw_band,
    encoded_figure,
    frame,
    in_house_style,
    inches,
    is_dotted,
    legend_above,
    marker_pen,
    marks,
    path,
    series,
    shade,
    stack_height,
    stems,
)
from lagsim.outputs.letters import Letters, mathtext
from lagsim.outputs.scale import (
    Scale,
    finite_range,
    greatest,
    log_scale,
    noise_scale,
    per_inch,
    read_off,
    set_equal_scales,
    spread_scale,
    time_scale,
    value_scale,
)
from lagsim.outputs.views import Views
from lagsim.run.observers.thinning import DRIFT
from lagsim.tolerances import ZERO_BESIDE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

    from lagsim.model.model import DrawnExpression, Model, Plot, Scene
    from lagsim.outputs import Made
    from lagsim.outputs.figure import Pen
    from lagsim.outputs.plot_data import Band, PlotData
    from lagsim.run.observers.thinning import Array, Thinning

    # Abscissae and ordinates of curves, by name.
    Curves: TypeAlias = Mapping[str, tuple[Array, Array]]

# --- What pictures of a run have in common


def sheet(
    data: PlotData,
    height: float,
    subject: str,
    *,
    width: float = WIDTH,
    timed: bool = True,
    banded: bool = False,
) -> Picture:
    """Return a picture with title, subject and legend of events, without panels.

    Parameters
    ----------
    height : float
        Height of the panels with their labels, in inches. Panels are added by the
        caller.
    subject : str
        The subject in the title.
    timed : bool
        Whether the panels have a time axis, on which events are marked.
    banded : bool
        Whether the panels have bands of standard deviations.
    """
    names: list[tuple[str, Pen]] = [DEVIATIONS] if banded else []
    if timed:
        names += [(mark.name, mark.top) for mark, _ in event_marks(data)]
    if data.horizon < data.rows.last("t"):
        names.append(("past the horizon", {"color": LOST, "linewidth": 6.0}))
    notes = [data.note] if data.note else ()
    return Picture(height, data.title, subject, width=width, legend=names, notes=notes)


# The legend of bands around curves.
DEVIATIONS: tuple[str, Pen] = (
    "± one standard deviation",
    {"color": LOST, "linewidth": 6.0},
)


def event_marks(data: PlotData) -> list[tuple[Mark, Sequence[float]]]:
    """Return the marks of events that occurred, each with the times of the events."""
    known = [(mark, data.events.get(kind, ())) for kind, mark in MARKS.items()]
    others = [t for k, own in data.events.items() if k not in MARKS for t in own]
    return [(mark, times) for mark, times in (*known, (OTHERS, others)) if times]


def mark_events(data: PlotData, axes: Axes) -> None:
    """Mark events on Axes against time, and shade the part past the horizon."""
    shade(axes, data.horizon)
    for mark, times in event_marks(data):
        marks(axes, times, mark)


def time_axis(data: PlotData) -> Scale:
    """Return the scale of a time axis, from the first row to the last."""
    return time_scale(np.array([data.rows.first("t"), data.rows.last("t")]))


# --- Columns against time

# Coordinates of one unit share a panel if there are at most `SHARING`, and if the range
# of each is at least this part of the panel.
SHARING = 3
SQUEEZED = 0.05

# Prefix of columns that are 0 except in the rows after impacts.

# Largest number of panels that are large enough to read.
MOST_PANELS = 40

# Largest number of panels, number side by side, and height of each in inches.
GRIDS = (
    (1, 1, 2.4), (2, 1, 1.6), (3, 1, 1.25), (4, 1, 1.05), (5, 1, 0.95), (12, 2, 0.95),
    (24, 3, 0.8), (MOST_PANELS, 5, 0.55),
)  # fmt: skip
# Number of panels side by side where x and y form pairs, which odd numbers would part.
IN_PAIRS = 4


def grouped(data: PlotData, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return groups of column names, one group per panel.

    A few columns of one unit share a panel if their sizes are comparable.
    """
    by_unit: dict[str, list[str]] = {}
    for name in names:
        by_unit.setdefault(data.unit(name), []).append(name)
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    for unit, of_unit in by_unit.items():
        if unit and 1 < len(of_unit) <= SHARING and _comparable(data, of_unit):
            groups.update(dict.fromkeys(of_unit, tuple(of_unit)))
    return list(dict.fromkeys(groups.values()))


def _comparable(data: PlotData, names: Sequence[str]) -> bool:
    scales = [value_scale(data.rows.series(name)[1], margin=0.0) for name in names]
    whole = max(s.high for s in scales) - min(s.low for s in scales)
    return min(s.high - s.low for s in scales) >= SQUEEZED * whole


def in_pairs(
    groups: Sequence[tuple[str, ...]], columns: int
) -> tuple[list[tuple[str, ...]], int]:
    """Return groups arranged so that x and y of a body are side by side.

    Parameters
    ----------
    groups : sequence of tuple of str
    columns : int
        Number of panels side by side.

    Returns
    -------
    found : list of tuple of str
        An empty tuple is a free place.
    columns : int
        Number of panels side by side, made even if there are pairs.
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
    """Whether two names differ in one letter only: x in `one`, y in `other`."""
    differ = [(a, b) for a, b in zip(one, other, strict=False) if a != b]
    return len(one) == len(other) and differ in ([("x", "y")], [("X", "Y")])


def evenly_spaced(names: Sequence[str], most: int) -> list[str]:
    """Return at most `most` of the names, evenly spaced, first and last included.

    Examples
    --------
    >>> evenly_spaced(["a", "b", "c", "d", "e"], 3)
    ['a', 'c', 'e']
    """
    if len(names) <= most:
        return list(names)
    return [names[k * (len(names) - 1) // (most - 1)] for k in range(most)]


class Panels:
    """A grid of panels, one for each group of columns.

    Parameters
    ----------
    data : PlotData
    groups : sequence of tuple of str
        The names of the columns of each panel.

    Attributes
    ----------
    height : float
        Height of the grid with its labels, in inches.
    """

    def __init__(self, data: PlotData, groups: Sequence[tuple[str, ...]]) -> None:
        self._data = data
        abreast, self._each = next(x for most, *x in GRIDS if len(groups) <= most)
        self._groups, self._abreast = in_pairs(groups, int(abreast))
        self._rows = -(-len(self._groups) // self._abreast)
        self.height = self._rows * (self._each + APART) + BELOW_PANELS

    def draw(
        self, picture: Picture, part: Picture | SubFigure, *, above: bool = False
    ) -> None:
        """Draw the panels in a part of a picture.

        above : whether labels of vertical axes are above the panels.
        """
        data, abreast = self._data, self._abreast
        above = above or abreast > 1
        panels = part.subplots(self._rows, abreast, squeeze=False)
        names = [name for group in self._groups for name in group]
        sizes = largest(data, {name: size_of_column(data, name) for name in names})
        under = self._groups[abreast:]
        for axes, group, follows in zip_longest(panels.flat, self._groups, under):
            if not group:
                axes.remove()
                continue
            unit = data.unit(group[0])
            written = [data.letters.name(name) for name in group]
            drawn = [data.rows.series(name) for name in group]
            bands = bands_of(data, group, drawn)
            extents = [*drawn, *sides_of(bands)]
            scale, draw = spread_scale(*extents, size=sizes[unit]), series
            if is_of_kind(group[0], IMPULSE):  # each has a size of its own
                columns = [values for _, values in drawn]
                scale, draw = value_scale(*columns, size=sizes[unit]), stems
            frame(
                axes, time_axis(data), scale, up=(", ".join(written), unit),
                below=NOTHING if follows else data.named("t"),
                above=(above or None) if len(group) == 1 else False,
            )  # fmt: skip
            picture.when_placed(bands_around, axes, bands, PENS)
            picture.when_placed(against_time, data, axes, drawn, PENS, draw)
            label_greatest(axes, scale, drawn, above=picture if above else None)
            if len(group) > 1:
                legend_above(axes, list(zip(written, PENS, strict=False)))
        if not above:
            part.align_ylabels()


def bands_of(
    data: PlotData, columns: Iterable[str], drawn: Iterable[tuple[Array, Array]]
) -> list[Band | None]:
    """Return the band of one standard deviation of each column, or None.

    drawn : times and values of each column.
    """
    pairs = zip(columns, drawn, strict=True)
    return [data.band(name, *curve) for name, curve in pairs]


def sides_of(bands: Iterable[Band | None]) -> list[tuple[Array, Array]]:
    """Return the lower and the upper curve (times, values) of each band."""
    found = [(t, side) for t, *sides in filter(None, bands) for side in sides]
    return [(t, side) for t, side in found if np.isfinite(side).any()]


def bands_around(axes: Axes, bands: Iterable[Band | None], pens: Iterable[Pen]) -> None:
    """Draw bands behind their curves, each in the colour of the curve's pen."""
    for found, pen in zip(bands, pens, strict=False):
        if found is not None:
            draw_band(axes, *found, pen)


def against_time(
    data: PlotData,
    axes: Axes,
    drawn: Iterable[tuple[Array, Array]],
    pens: Iterable[Pen],
    draw: Callable[[Axes, Array, Array, Pen], None] = series,
) -> None:
    """Draw columns (times, values) against time, and mark the events.

    pens : the pens of the columns.
    draw : function that draws one column.
    """
    mark_events(data, axes)
    for (t, values), pen in zip(drawn, pens, strict=False):
        draw(axes, t, values, pen)


def label_greatest(
    axes: Axes,
    scale: Scale,
    drawn: Sequence[tuple[Array, Array]],
    *,
    above: Picture | None = None,
) -> None:
    """Label the linear part of a scale, and the greatest value of the curves.

    drawn : the curves (times, values).
    above : the picture, to write the labels above a small panel, where a label may be
        left out for lack of space; None to write both in the panel.
    """
    if not scale.linear:
        return
    t, values = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    at = int(np.where(np.isfinite(t + values), np.abs(values), 0.0).argmax())
    most = read_off(values[at])
    beyond = f"logarithmic beyond {read_off(scale.linear)}"
    if above:  # in a small panel it would cover the curve
        above.when_placed(_label_above, axes, f"peak {most}", beyond)
        return
    # On the side away from the greatest value.
    side = "left" if t[at] > 0.5 * (t[0] + t[-1]) else "right"
    text = f"peak {most} at t = {read_off(t[at], 5)}; {beyond}"
    style: Pen = {"size": SMALL, "color": DIM}
    axes.add_artist(AnchoredText(text, f"upper {side}", frameon=False, prop=style))


def _label_above(axes: Axes, most: str, beyond: str) -> None:
    """Write the labels that fit above a panel beside its name.

    most, beyond : the labels of the greatest value, and of the linear part.
    """
    width = axes.get_window_extent().width / axes.figure.dpi
    name = re.sub(r"\\[a-z]+|\W", "", axes.get_title(loc="left"))
    letters = width * OF_SMALL_PRINT - len(name)
    for text in (f"{most}; {beyond}", beyond.replace("arithmic", ".")):
        if len(text) < letters:
            axes.set_title(text, loc="right", color=DIM)
            return


def largest(data: PlotData, sizes: Mapping[str, float]) -> dict[str, float]:
    """Return, for each unit, the greatest size of a column of that unit.

    sizes : the size of each column, by name.
    """
    found: dict[str, float] = {}
    for name, size in sizes.items():
        found[data.unit(name)] = max(found.get(data.unit(name), 0.0), size)
    return found


def size_of_column(data: PlotData, name: str) -> float:
    """Return the greatest absolute finite value of a column; 0 without any."""
    return greatest(data.rows.series(name)[1])


# --- A plot that the model asks for

# Inches: the height of a panel; with one scale for both directions, its least and its
# greatest height, its width, the room beside it, and the least width of the picture.
HEIGHT, LOWEST, TALLEST, PANEL, BESIDE, NARROWEST = 3.6, 1.2, 5.2, 6.0, 0.9, 3.4
# Greatest ratio of the sides of a panel with one scale for both directions: with larger
# ratios, a path would look like a line.
LONGEST = 12.0
DIRECTIONS = frozenset("xyz")
SIDES = ("y", "y2")


@in_house_style
def plot(data: PlotData, number: int, entry: Plot, scene: Scene) -> Picture:
    """Return the picture of one entry of the model's `output.plots`.

    number : the number of the entry, from 0.
    entry : the entry.
    scene : the scene, by which paths of points are recognised.
    """
    curves, timed = entry.curves(number), entry.x.text.strip() == "t"
    x, *names = curves
    texts = {name: data.letters.text(curve.text) for name, curve in curves.items()}
    pens = dict(zip(names, PENS * 2, strict=False))
    drawn = {name: _values(data, entry, x, name, timed=timed) for name in names}
    bands = {
        name: data.band(curves[name].text.strip(), *drawn[name]) if timed else None
        for name in names
    }
    scales = {"x": time_axis(data) if timed else value_scale(*_xs(drawn), margin=0.03)}
    if "x" in entry.log:
        scales["x"] = log_scale(*_xs(drawn), margin=0.0, least=0.0)
    sides = {side: [n for n in names if side_of(n) == side] for side in SIDES}
    for side, own in sides.items():
        shown = [drawn[n] for n in own] + sides_of(bands[n] for n in own)
        scales[side] = _up(shown, log=side in entry.log, timed=timed)
    ends = [(scales[axis].low, scales[axis].high) for axis in "xy"]
    has_one_scale = not timed and not entry.y2 and not entry.log
    has_one_scale = has_one_scale and _are_directions(data, curves, scene, drawn)
    width, height = _sides(*ends) if has_one_scale else (WIDTH, HEIGHT)
    height += BELOW_PANELS + (APART if len(names) > 1 else 0.0)
    picture = sheet(
        data, height, entry.title, timed=timed, width=width,
        banded=any(bands.values()),
    )  # fmt: skip
    axes = picture.subplots()
    if has_one_scale:
        picture.adjust.append(
            lambda: set_equal_scales(axes, ends, per_inch(axes, ends))
        )
    below = texts[x], data.unit("t" if timed else x)
    for side, own in sides.items() if entry.y2 else [("y", names)]:
        units = {data.unit(name) for name in own}
        up = ", ".join(texts[n] for n in own), units.pop() if len(units) == 1 else ""
        single = entry.y2 and len(own) == 1
        panel = axes if side == "y" else axes.twinx()
        frame(
            panel, scales["x"], scales[side], below=below, up=up,
            colour=pens[own[0]]["color"] if single else INK,
            above=None if len(names) == 1 else False,
        )  # fmt: skip
        if panel is not axes:
            panel.grid(visible=False)
        if timed and side == "y":
            picture.when_placed(mark_events, data, axes)
            label_greatest(axes, scales[side], [drawn[name] for name in own])
        for name in own:
            if timed:
                picture.when_placed(bands_around, panel, [bands[name]], [pens[name]])
                picture.when_placed(series, panel, *drawn[name], pens[name])
            else:
                picture.when_placed(_path, data, panel, *drawn[name], pens[name])
    if len(names) > 1:
        legend_above(axes, [(texts[name], pens[name]) for name in names])
    return picture


def side_of(name: str) -> str:
    """Return the vertical axis of a curve: `y` (left) or `y2` (right).

    name : the column of the curve.
    """
    return name.split(".")[1]


def _values(
    data: PlotData, entry: Plot, x: str, name: str, *, timed: bool
) -> tuple[Array, Array]:
    """Return abscissae and ordinates of a curve; nan where a logarithm is undefined.

    x, name : the columns.
    timed : whether the abscissa is time.
    """
    # Against time the envelope keeps spikes; others need both values of a row.
    across, up = data.rows.series(name) if timed else data.rows.path(x, name)
    if "x" in entry.log:
        across = np.where(across > 0.0, across, np.nan)
    if side_of(name) in entry.log:
        up = np.where(up > 0.0, up, np.nan)
    return across, up


def _xs(drawn: Curves) -> list[Array]:
    return [across for across, _ in drawn.values()]


def _up(drawn: Sequence[tuple[Array, Array]], *, log: bool, timed: bool) -> Scale:
    """Return the scale of the vertical axis for the curves of one side of a plot.

    drawn : pairs (abscissae, values).
    log : whether the scale is logarithmic.
    timed : whether the horizontal axis is time.
    """
    values = [up for _, up in drawn]
    if log:
        return log_scale(*values)
    return spread_scale(*drawn) if timed and drawn else value_scale(*values)


def _are_directions(
    data: PlotData, curves: Mapping[str, DrawnExpression], scene: Scene, drawn: Curves
) -> bool:
    """Whether a plot shows a path in space, whose axes have one scale.

    This is so if their units are equal, or if all are coordinates of points or called
    x, y or z, and if their ranges are not too different.

    curves : the ordinates by column.
    drawn : abscissae and values of each curve.
    """
    units = {data.unit(name) for name in curves}
    components = {node for parts in scene.points.values() for node in parts}
    is_known = units != {""} and len(units) == 1
    is_known |= all(curve.node in components for curve in curves.values())
    is_known |= all(curve.text in DIRECTIONS for curve in curves.values())
    ends = [finite_range(*x) for x in zip(*drawn.values(), strict=True)]
    spans = [high - low for low, high in ends]
    return is_known and 0.0 < max(spans) <= LONGEST * min(spans)


def _sides(x: tuple[float, float], y: tuple[float, float]) -> tuple[float, float]:
    """Return the width of a picture and the height of its panel, for equal scales.

    Both are in inches.

    x, y : the ranges of abscissa and ordinate of a path.
    """
    ratio = (y[1] - y[0]) / (x[1] - x[0])
    height = min(max(LOWEST, PANEL * ratio), TALLEST)
    return min(max(NARROWEST, BESIDE + height / ratio), WIDTH), height


def _path(data: PlotData, axes: Axes, x: Array, y: Array, pen: Pen) -> None:
    dots = marker_pen(".", 1.2, pen["color"])
    pen = dots if is_dotted(*inches(axes, x, y)) else pen
    path(axes, x, y, pen, data.trusted())


# --- The pictures of a run

# An energy whose distance from 0 always exceeds the largest change of all energies by
# this factor is drawn relative to its start.
FAR = 10.0
# The panels of the energies and of their drift, in inches.
TALL, LOW = 2.2, 1.1
# The picture that takes longest.
LONG = "trajectory"


@in_house_style
def energy(data: PlotData) -> Picture:
    """Draw the energies, and below them the drift of energy - work.

    Parameters
    ----------
    data : PlotData
        The rows have `energy` and `kinetic`, `potential` or `lagrangian`, and the
        difference `DRIFT` if there is a column `work`.
    """
    heights = [TALL, LOW]
    picture = sheet(data, sum(heights) + 2 * APART + BELOW_PANELS, "energy")
    axes, lower = picture.subplots(2, height_ratios=heights)
    total = "energy T + V" if data.is_sum else "energy function h = Σ q̇ ∂L/∂q̇ − L"
    named = {"kinetic": "kinetic T", "potential": "potential V"}
    named |= {"lagrangian": "lagrangian L", "energy": total}
    names = [name for name in named if name in data.rows]
    starts = _far_starts(data, names)
    unit = data.unit("energy")
    for name, start in starts.items():
        if start:
            named[name] += f" less {read_off(start)} {unit}".rstrip()
    whole = BLACK | {"linewidth": 1.8}
    pens = dict(zip(names, (*PENS[: len(names) - 1], whole), strict=True))
    # A part that equals the sum is drawn above the sum.
    drawn = {}
    for name in reversed(names):
        t, energies = data.rows.series(name)
        drawn[name] = t, energies - starts[name]
    values = spread_scale(*drawn.values())
    frame(axes, time_axis(data), values, up=("energy", unit))
    styles = [pens[name] for name in drawn]
    picture.when_placed(against_time, data, axes, drawn.values(), styles)
    label_greatest(axes, values, list(drawn.values()))
    legend_above(axes, [(named[name], pens[name]) for name in names])
    _drift(picture, lower, data)
    picture.align_ylabels()
    return picture


def _far_starts(data: PlotData, names: Sequence[str]) -> dict[str, float]:
    """Return, for each column of energy, the constant subtracted from its curve.

    It is the value at the start where the energy is far from 0 in comparison with its
    changes, else 0. Constants of the kinetic and the potential energy are also
    subtracted from their sum.
    """
    series = {name: data.rows.series(name)[1] for name in names}
    ends = {name: finite_range(values) for name, values in series.items()}
    moving = max((high - low for low, high in ends.values()), default=0.0)
    starts = dict.fromkeys(names, 0.0)
    for name in names:
        nearest = min(map(abs, ends[name]))
        if moving and nearest > FAR * moving and len(series[name]):
            starts[name] = float(series[name][0])
    if data.is_sum and {"kinetic", "potential"} <= set(names):
        starts["energy"] = starts["kinetic"] + starts["potential"]
    return starts


def _drift(picture: Picture, axes: Axes, data: PlotData) -> None:
    balance = DRIFT if DRIFT in data.rows else "energy"
    t, values = data.rows.series(balance)
    drift = values - (values[0] if len(values) else 0.0)
    size = max(size_of_column(data, "energy"), greatest(values))
    unit = data.unit("energy")
    scale = noise_scale(drift, size)
    frame(axes, time_axis(data), scale, below=data.named("t"), up=("drift", unit))
    picture.when_placed(against_time, data, axes, [(t, drift)], [BLACK])
    quantity = "energy − work" if balance == DRIFT else "energy"
    worst = greatest(drift)
    most = f"at most {read_off(worst, 2)} {unit}" if worst else "0 in every row"
    axes.set_title(f"{quantity} minus its first value: {most}".rstrip())


@in_house_style
def trajectory(
    data: PlotData,
    names: Sequence[str],
    scene: Scene,
    subject: str = "coordinates",
    model: Model | None = None,
) -> Picture:
    """Draw variables against time, and the paths of a scene's points.

    Parameters
    ----------
    data : PlotData
    names : sequence of str
        Coordinates and states.
    scene : Scene
    subject : str
    model : Model, optional
        Source of the scene's shapes, which are drawn if given.
    """
    shown = evenly_spaced(names, MOST_PANELS)
    panels = Panels(data, grouped(data, shown))
    views = Views(data, scene, model)
    subject = _counted(subject, len(shown), len(names))
    height = panels.height + views.height
    picture = sheet(data, height, subject, banded=data.has_band(shown))
    if not views.height:
        panels.draw(picture, picture)
        return picture
    heights = [panels.height, views.height]
    upper, lower = picture.subfigures(2, height_ratios=heights, squeeze=False)[:, 0]
    panels.draw(picture, upper)
    views.draw(lower, picture)
    return picture


@in_house_style
def constraint_forces(
    data: PlotData, coordinates: Sequence[str], constraints: Sequence[str]
) -> Picture:
    """Draw the constraint force on each coordinate, each multiplier and impulse.

    Parameters
    ----------
    data : PlotData
    coordinates, constraints : sequence of str
        Names.
    """
    forces = [FORCE.of(name) for name in coordinates]
    multipliers = [MULTIPLIER.of(name) for name in constraints]
    columns = data.rows.columns
    multipliers += [name for name in columns if is_of_kind(name, FRICTION)]
    impulses = [name for name in columns if is_of_kind(name, IMPULSE)]
    names = [*forces, *multipliers, *impulses]
    sizes = {name: size_of_column(data, name) for name in names}
    most = largest(data, sizes)
    acting = [n for n in names if sizes[n] > ZERO_BESIDE * most[data.unit(n)]]
    acting = acting or forces[:1]
    shown = evenly_spaced(acting, MOST_PANELS)
    subject = "constraint forces Qc and multipliers λ"
    if any(name in impulses for name in acting):
        subject = "constraint forces and impulses"
    if len(acting) < len(names):
        rest = len(names) - len(acting)
        subject = f"{subject}; {rest} more {'is' if rest == 1 else 'are'} 0"
    else:
        subject = _counted(subject, len(shown), len(names))
    panels = Panels(data, [(name,) for name in shown])
    picture = sheet(data, panels.height, subject)
    panels.draw(picture, picture, above=True)
    return picture


def _counted(subject: str, shown: int, total: int) -> str:
    return subject if shown == total else f"{subject}: {shown} of {total} are shown"


def pictures(data: PlotData, model: Model) -> Iterator[Made]:
    """Yield file name and content of each picture of a run."""
    coordinates = [coordinate.name for coordinate in model.coordinates]
    moving = [x.name for x in model.variables]
    subject = "coordinates and states" if model.states else "coordinates"
    draw: dict[str, Callable[[], Picture]] = {
        "energy": partial(energy, data),
        LONG: partial(trajectory, data, moving, model.scene, subject, model),
    }
    # The length of a quaternion takes no force.
    names = [c.name for c in model.constraints if c.name not in model.quaternions]
    if names:
        draw["constraint_forces"] = partial(constraint_forces, data, coordinates, names)
    for k, entry in enumerate(model.output.plots):
        draw[f"plot_{k + 1}"] = partial(plot, data, k, entry, model.scene)
    files = {key: partial(_file, own, data.form) for key, own in draw.items()}
    started = {LONG: ahead.start(files[LONG])}
    for key, file in (files | started).items():
        name = f"{key}.{data.form}"
        yield name, attempted(name, file)
        # A figure holds the pixels that it was drawn on, some megabytes, and itself.
        if not gc.isenabled():  # see `cli.entry`
            gc.collect(0)


def _file(draw: Callable[[], Picture], form: str) -> bytes:
    return encoded_figure(draw(), form)


# --- One picture of several runs

# Inches: height of a panel by the number of panels; least height.
OVERLAID = (2.9, 1.9, 1.5, 1.3)
LEAST_OVERLAID = 1.1
# Largest number of runs in a legend; more are distinguished by colour. Height in inches
# of the bar of colours.
MOST_NAMED, BAR = 12, 0.5


def pens(count: int) -> list[Pen]:
    """Return `count` distinct pens: by colour, then by colour and dashes."""
    size = len(PENS)
    return [
        PENS[(k + k // size) % size] | {"color": PENS[k % size]["color"]}
        for k in range(count)
    ]


@in_house_style
def overlay(
    title: str,
    runs: Mapping[str, Thinning],
    units: Mapping[str, str],
    notes: Sequence[str] = (),
    order: tuple[str, Sequence[float]] = ("run", ()),
    bands: Mapping[str, Mapping[str, Band]] | None = None,
) -> Picture:
    """Draw each column of `units` against time, with all runs on the same axes.

    Parameters
    ----------
    title : str
        The model's name.
    runs : mapping of str to Thinning
        Rows of each run, by its name.
    units : mapping of str to str
        Units of the columns; the first one is that of the time, `t`.
    notes : sequence of str
        Written below the panels.
    order : tuple of (str, sequence of float)
        Name and values of the quantity by which many runs are coloured, one for each
        run.
    bands : mapping of str to mapping, optional
        Bands of one standard deviation, by run and column.
    """
    bands = bands or {}
    columns = [name for name in units if name != "t"]
    letters = Letters(columns)
    many = len(runs) > MOST_NAMED
    values = np.array(order[1] or range(1, len(runs) + 1), float)
    colours = ScalarMappable(Normalize(values.min(), values.max()), COLOURS)
    styles = pens(len(runs))
    if many:
        styles = [
            {"color": to_hex(c), "linewidth": 0.7} for c in colours.to_rgba(values)
        ]
    height = (
        OVERLAID[len(columns) - 1] if len(columns) <= len(OVERLAID) else LEAST_OVERLAID
    )
    found = Picture(
        stack_height(len(columns), height) + (BAR if many else 0.0), title,
        f"{', '.join(letters.name(name) for name in columns)} of {len(runs)} runs",
        legend=[
            *([DEVIATIONS] if any(bands.values()) else []),
            *([] if many else zip(runs, styles, strict=True)),
        ],
        notes=notes,
    )  # fmt: skip
    rows = list(runs.values())
    times = time_scale(np.concatenate([r.series(columns[0])[0] for r in rows]))
    panels = found.subplots(len(columns), squeeze=False, sharex=True)[:, 0]
    if many:
        bar = found.colorbar(colours, ax=panels, location="bottom", aspect=60)
        bar.set_label(mathtext(f"colour: {letters.text(order[0])}"))
    for axes, name in zip(panels, columns, strict=True):
        drawn = [r.series(name) for r in rows]
        below = ("t", units.get("t", "")) if name == columns[-1] else NOTHING
        around = [bands.get(run, {}).get(name) for run in runs]
        sides = [side for _, side in sides_of(around)]
        scale = value_scale(*(column for _, column in drawn), *sides)
        frame(axes, times, scale, below=below, up=(letters.name(name), units[name]))
        found.when_placed(bands_around, axes, around, styles)
        for (t, column), pen in zip(drawn, styles, strict=True):
            found.when_placed(series, axes, t, column, pen)
    found.align_ylabels()
    return found
