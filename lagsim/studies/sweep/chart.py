"""A sweep in pictures: curves over one parameter, maps over two.

`chart` is sweep.png, `sweep_figure` a matplotlib Figure of any columns.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.curves import line
from lagsim.outputs.figure import Column, figure, map_figure
from lagsim.outputs.letters import Letters, raised
from lagsim.outputs.scale import Scale, value_scale
from lagsim.outputs.sheet import (
    EDGE,
    LINE,
    NOTHING,
    PENS,
    Named,
    Pen,
    Sheet,
    in_house_style,
    mark,
    wrapped,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from lagsim.studies.sweep.grid import Axis
    from lagsim.studies.sweep.runs import Found

    Array = NDArray[np.float64]

# Inches: the sheet, above the panels, left of them, a panel of curves, and of a map.
WIDTH, TOP, LEFT, RIGHT = 7.0, 0.82, 0.72, 0.2
CURVES, MAP, GAP, BELOW = 1.25, 1.75, 0.2, 0.5
# Between two maps; a strip of their colours, and its distance.
ACROSS, STRIP, NEAR = 1.45, 0.1, 0.42
# Panels at most, or rows of maps: of coordinates first, then of definitions.
MOST = 6
# Values that spread over so many times the least, and evenly so in their logarithms,
# stand on an axis of powers of ten.
SPREAD = 20.0
END, LOW, HIGH = range(3)
FAILED: Pen = mark("x", 5.0, "#D55E00")
AT_END: Pen = mark("o", 3.0, PENS[0]["color"])
MANY_AT_END: Pen = mark(".", 3.0, PENS[0]["color"])
BAND: Pen = {"color": "#BFE3F5", "linewidth": 6.0, "solid_capstyle": "butt"}
BAND_COLOUR, NO_RESULT = "#BFE3F5", "#999999"
COLOURS = "viridis"
# More points than these are small.
FEW = 60


@in_house_style
def chart(found: Found) -> bytes:
    """Draw what was found. Returns the picture."""
    axes = found.grid.axes
    shown = shown_columns(found)
    notes = wrapped(_notes(found, len(shown)), WIDTH - 2 * EDGE)
    shown = shown[:MOST]
    each = (CURVES if len(axes) == 1 else MAP + BELOW + 0.1) + GAP
    alone = len(axes) > 1 and found.work.ends
    rows = -(-len(shown) // 2) if alone else len(shown)
    low = TOP + rows * each + (BELOW if len(axes) == 1 else 0.0) - 0.1
    sheet = Sheet(WIDTH, low + LINE * len(notes) + 0.1)
    sheet.heading(found.model.name, f"{found.grid.runs} runs")
    missing = not all(row.numbers.size for row in found.rows.values())
    missing |= not all(row.complete for row in found.rows.values())
    if len(axes) == 1:
        _curves(sheet, found, shown, missing=missing)
    else:
        _maps(sheet, found, shown, missing=missing)
    sheet.notes(low, notes)
    return sheet.content()


def shown_columns(found: Found) -> list[str]:
    """Give the columns that are drawn: the coordinates, then the definitions."""
    model = found.model
    names = [c.name for c in model.coordinates]
    names += [d.name for d in model.definitions if d.name in found.columns]
    return names


def values_of(found: Found, column: str, numbers: NDArray[np.int64]) -> Array:
    """Give end, least and greatest of a column in runs (k, 3); nan without a result."""
    place = found.columns.index(column)
    cells = np.full((len(numbers), 3), np.nan)
    for k, number in enumerate(numbers.tolist()):
        row = found.rows.get(number)
        if row is not None and row.complete:
            cells[k] = row.numbers[:, place]
    return cells


def _curves(sheet: Sheet, found: Found, shown: list[str], *, missing: bool) -> None:
    (axis,) = found.grid.axes
    order = np.argsort(axis.values, kind="stable")
    x = np.array(axis.values)[order]
    scale = _scale(x)
    ends = AT_END if len(x) <= FEW else MANY_AT_END
    entries = [("at the end", ends)]
    entries += [] if found.work.ends else [("from least to greatest", BAND)]
    entries += [("not complete", FAILED)] if missing else []
    sheet.legend(EDGE, 0.5, entries, WIDTH - 2 * EDGE)
    for k, name in enumerate(shown):
        cells = values_of(found, name, order)
        last = k + 1 == len(shown)
        place = (LEFT, TOP + k * (CURVES + GAP), WIDTH - LEFT - RIGHT, CURVES)
        below = _axis(found, axis) if last else NOTHING
        side = _written(found, name, found.units.get(name, ""))
        up = value_scale(cells[np.isfinite(cells)])
        panel = sheet.panel(place, scale, up, below=below, side=side)
        _band(panel, x, cells, up, ends, missing=missing)


def _axis(found: Found, axis: Axis) -> Named:
    """Give what is swept as pictures write it: a start value is one."""
    name, unit = _written(found, axis.name, axis.unit)
    return f"{name} at the start" if axis.starts else name, unit


def _band(
    panel: Axes, x: Array, cells: Array, up: Scale, ends: Pen, *, missing: bool
) -> None:
    panel.fill_between(
        x, cells[:, LOW], cells[:, HIGH], color=BAND_COLOUR, linewidth=0.0, zorder=1.0
    )
    line(panel, x, cells[:, END], ends, clip_on=False, zorder=2.2)
    none = np.isnan(cells[:, END])
    if missing and none.any():
        level = np.full(int(none.sum()), up.low)
        line(panel, x[none], level, FAILED, clip_on=False, zorder=3.0)


def _maps(sheet: Sheet, found: Found, shown: list[str], *, missing: bool) -> None:
    first, second = found.grid.axes[:2]
    across, up = np.array(first.values), np.array(second.values)
    rows, columns = np.argsort(up, kind="stable"), np.argsort(across, kind="stable")
    numbers = numbers_of(found)[columns][:, rows].T
    edges = borders(across[columns]), borders(up[rows])
    if missing:
        look: Pen = {"color": NO_RESULT, "linewidth": 8.0, "solid_capstyle": "butt"}
        sheet.legend(EDGE, 0.5, [("not complete", look)], WIDTH - 2 * EDGE)
    width = (WIDTH - LEFT - ACROSS - 0.85) / 2
    named = tuple(_axis(found, a) for a in (first, second))
    parts = [(END, "at the end")]
    parts += [] if found.work.ends else [(HIGH, "greatest")]
    for k, (name, (part, said)) in enumerate(product(shown, parts)):
        content = values_of(found, name, numbers.ravel())[:, part]
        content = content.reshape(numbers.shape)
        row, column = divmod(k, 2)
        left = LEFT + column * (width + ACROSS)
        top = TOP + row * (MAP + BELOW + 0.1 + GAP)
        shown_name, unit = _written(found, name, found.units.get(name, ""))
        _map(
            sheet, (left, top, width, MAP), named, edges, content,
            (f"{shown_name}, {said}", unit),
        )  # fmt: skip


def _map(
    sheet: Sheet,
    place: tuple[float, float, float, float],
    named: Sequence[Named],
    edges: tuple[Array, Array],
    content: Array,
    title: Named,
) -> None:
    """Draw a map, and at its right what its colours mean."""
    below, side = named
    scale = value_scale(content[np.isfinite(content)], margin=0.0)
    look: Pen = {"cmap": COLOURS, "vmin": scale.low, "vmax": scale.high, "zorder": 1.0}
    x, y = (Scale(e[0], e[-1], log=is_log(e)) for e in edges)
    panel = sheet.panel(place, x, y, below=below, side=side, above=title, ticks=(5, 5))
    ground = np.isnan(content)
    if ground.any():
        grey = np.where(ground, 0.6, np.nan)
        panel.pcolormesh(*edges, grey, cmap="gray", vmin=0.0, vmax=1.0, zorder=0.9)
    panel.pcolormesh(*edges, content, **look)
    left, top, width, height = place
    levels = np.linspace(scale.low, scale.high, 65)
    strip = (left + width + NEAR, top, STRIP, height)
    panel = sheet.panel(strip, Scale(0.0, 1.0), scale, ticks=(2, 5))
    panel.pcolormesh([0.0, 1.0], levels, levels[:-1, None], **look)


def _written(found: Found, name: str, unit: str) -> Named:
    """Give a name and its unit as pictures write them."""
    model = found.model
    names = [c.name for c in model.coordinates] + [d.name for d in model.definitions]
    return Letters(names).name(name), raised(unit)


def numbers_of(found: Found) -> NDArray[np.int64]:
    """Give the numbers of the runs over the first two axes, others in their middle."""
    counts = [len(axis.texts) for axis in found.grid.axes]
    whole = np.arange(found.grid.runs).reshape(*counts[:2], -1)
    middle = 0
    for count in counts[2:]:
        middle = middle * count + (count - 1) // 2
    return np.asarray(whole[:, :, middle])


def is_log(x: Array) -> bool:
    """Tell whether sorted values stand better on an axis of powers of ten."""
    if len(x) < 3 or not x[0] > 0.0 or x[-1] < SPREAD * x[0]:
        return False
    even, powers = np.diff(x), np.diff(np.log(x))
    return bool(np.ptp(powers) / np.max(powers) < np.ptp(even) / np.max(even))


def _scale(x: Array) -> Scale:
    if is_log(x):
        return Scale(x[0], x[-1], log=True)
    return value_scale(x, margin=0.02)


def borders(x: Array) -> Array:
    """Give the borders (k + 1,) of cells around sorted values (k,)."""
    if len(x) == 1:
        half = 0.5 * abs(x[0]) or 0.5
        return np.array([x[0] - half, x[0] + half])
    log = is_log(x)
    x = np.log(x) if log else x
    middles = (x[1:] + x[:-1]) / 2.0
    edges = np.array([2 * x[0] - middles[0], *middles, 2 * x[-1] - middles[-1]])
    return np.asarray(np.exp(edges)) if log else edges


def _notes(found: Found, columns: int) -> list[str]:
    lines = []
    others = found.grid.axes[2:]
    if others:
        fixed = ", ".join(
            f"{_axis(found, a)[0]} = {a.texts[(len(a.texts) - 1) // 2]}" for a in others
        )
        lines.append(f"Of the other names, the middle value is shown: {fixed}.")
    if columns > MOST:
        lines.append(f"The first {MOST} of {columns}; sweep.csv has all columns.")
    return lines


def sweep_figure(found: Found, columns: Mapping[str, NDArray[np.float64]]) -> Figure:
    """Draw columns (runs,) of a sweep."""
    model, axes = found.model, found.grid.axes
    names = [c.name for c in model.coordinates] + [d.name for d in model.definitions]
    letters = Letters(names)

    def drawn(name: str, values: NDArray[np.float64]) -> Column:
        column, _, part = name.rpartition(".")
        unit = raised(found.units.get(column, ""))
        said = {"end": "at the end", "min": "least", "max": "greatest"}
        if part not in said:
            return Column(name, "", values)
        return Column(f"{letters.name(column)}, {said[part]}", unit, values)

    def along(axis: Axis) -> Column:
        start = " at the start" if axis.starts else ""
        name = f"{letters.name(axis.name)}{start}"
        return Column(name, raised(axis.unit), np.array(axis.values))

    if len(axes) == 1:
        order = np.argsort(axes[0].values, kind="stable")
        x = along(axes[0])
        shown = [drawn(name, values[order]) for name, values in columns.items()]
        drawing = figure(model.name, x._replace(values=x.values[order]), shown)
        return _scaled(drawing, x, None)
    across, up = along(axes[0]), along(axes[1])
    rows = np.argsort(up.values, kind="stable")
    order = np.argsort(across.values, kind="stable")
    numbers = numbers_of(found)[order][:, rows].T
    drawing = map_figure(
        model.name,
        across._replace(values=borders(across.values[order])),
        up._replace(values=borders(up.values[rows])),
        [drawn(name, values[numbers]) for name, values in columns.items()],
    )
    return _scaled(drawing, across, up)


def _scaled(drawing: Figure, across: Column, up: Column | None) -> Figure:
    """Let axes show powers of ten where values spread so."""
    for axes in drawing.axes:
        if axes.get_label() == "<colorbar>":
            continue
        if is_log(np.sort(across.values)):
            axes.set_xscale("log")
        if up is not None and is_log(np.sort(up.values)):
            axes.set_yscale("log")
    return drawing
