"""Pictures of a sweep: curves over one name, maps over two, dots for points.

`chart` is sweep.png, `sweep_figure` a matplotlib Figure of any columns.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.model.reader.runs import FROM
from lagsim.outputs.figure import (
    NO_RESULT,
    PENS,
    Pen,
    Picture,
    PlottedColumn,
    encoded_figure,
    figure,
    in_house_style,
    map_figure,
    marker_pen,
    stack_height,
)
from lagsim.outputs.letters import letters_of, raised_powers
from lagsim.outputs.scale import is_level, value_scale

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from lagsim.studies.sweep.grid import Axis, SweepRows

    Array = NDArray[np.float64]

# Inches: a panel of curves.
CURVES = 1.5
# Panels at most, or rows of maps: coordinates first, then definitions.
MOST = 6
# Least ratio of the largest to the smallest value for a logarithmic axis.
SPREAD = 20.0
# The largest number of swept names of points that have panels side by side.
ABREAST = 3
# Of a column of a run.
END, HIGH = 0, 2
PARTS = {
    "end": "at the end",
    "min": "least",
    "max": "greatest",
    "mean": "mean",
    "rms": "rms about the mean",
    "peak_to_peak": "peak to peak",
}
FAILED: Pen = marker_pen("x", 5.0, "#D55E00")
AT_END: Pen = marker_pen("o", 3.0, PENS[0]["color"])
MANY_AT_END: Pen = marker_pen(".", 3.0, PENS[0]["color"])
BAND: Pen = {"color": "#BFE3F5", "linewidth": 6.0, "solid_capstyle": "butt"}
# More points than these are small.
FEW = 60


def chart(found: SweepRows) -> bytes:
    """Draw sweep.png; return its content."""
    model = found.model
    names = [x.name for x in (*model.variables, *model.definitions)]
    names = [name for name in names if name in found.columns]
    missing = not all(row.numbers.size and row.complete for row in found.rows.values())
    more: dict[str, Any] = {
        "subject": f"{found.grid.runs} runs", "notes": _notes(found, len(names))
    }  # fmt: skip
    if len(found.grid.axes) == 1 or found.grid.together:
        return encoded_figure(_panels(found, names[:MOST], missing, **more))
    more["legend"] = [("not complete", BAND | {"color": NO_RESULT})] if missing else []
    parts = {"end": END} if found.work.ends else {"end": END, "max": HIGH}
    columns = {
        f"{name}.{part}": values_of(found, name)[:, k]
        for name, (part, k) in product(names[:MOST], parts.items())
    }
    return encoded_figure(_maps(found, columns, abreast=2, **more))


def sweep_figure(found: SweepRows, columns: Mapping[str, Array]) -> Figure:
    """Return a matplotlib figure of columns of a sweep, each of shape (runs,)."""
    if len(found.grid.axes) > 1 and not found.grid.together:
        return _maps(found, columns)
    order, x = _along(found, found.grid.axes[0])
    shown = [_column(found, name, values[order]) for name, values in columns.items()]
    return figure(found.model.name, x._replace(log=is_log(x.values)), shown)


def values_of(found: SweepRows, column: str) -> Array:
    """Return end, minimum and maximum of a column (runs, 3); nan without a result."""
    place = found.columns.index(column)
    cells = np.full((found.grid.runs, 3), np.nan)
    for number, row in found.rows.items():
        if row.complete:
            cells[number] = row.numbers[: cells.shape[1], place]
    return cells


def _along(found: SweepRows, axis: Axis) -> tuple[NDArray[np.int64], PlottedColumn]:
    """Return the order of the values of an axis, and the sorted values as a column.

    The order has the indices of the values, ascending in value.
    """
    values = np.array(axis.values)
    order = np.argsort(values, kind="stable")
    name = letters_of(found.model).name(axis.name)
    name += " at the start" if axis.starts else ""
    return order, PlottedColumn(name, raised_powers(axis.unit), values[order])


def _column(found: SweepRows, name: str, values: Array) -> PlottedColumn:
    """Return values (runs,) of a sweep as a column with name and unit for pictures.

    name : such as `theta` or `theta.max`.
    """
    column, _, part = (name, "", "") if name in found.columns else name.rpartition(".")
    if part not in {"", *PARTS}:
        return PlottedColumn(name, "", values)
    written = letters_of(found.model).name(column)
    written += f", {PARTS[part]}" if part else ""
    return PlottedColumn(written, raised_powers(found.units.get(column, "")), values)


@in_house_style
def _panels(
    found: SweepRows, names: Sequence[str], missing: bool, **more: Any
) -> Picture:
    """Draw the last values of columns over the first swept name.

    With one swept name, a band shows the range of each run.

    names : the names of the columns.
    missing : whether runs have no result.
    more : arguments of `Picture`.
    """
    shown, grid = found.grid.axes[:ABREAST], found.grid
    banded = len(grid.axes) == 1 and not found.work.ends
    dots = AT_END if grid.runs <= FEW else MANY_AT_END
    legend = [("at the end", dots)]
    legend += [("from least to greatest", BAND)] if banded else []
    legend += [("not complete", FAILED)] if missing else []
    height = stack_height(len(names), CURVES)
    drawing = Picture(height, found.model.name, legend=legend, **more)
    panels = drawing.subplots(
        len(names), len(shown), squeeze=False, sharex="col", sharey="row"
    )
    for row, name in zip(panels, names, strict=True):
        cells = values_of(found, name)
        for axes, lowest, axis in zip(row, panels[-1], shown, strict=True):
            order, x = _along(found, axis)
            end, low, high = cells[order].T
            if banded:
                band = {"color": BAND["color"], "linewidth": 0.0}
                axes.fill_between(x.values, low, high, **band)
            axes.plot(x.values, end, **dots, clip_on=False, zorder=2.2)
            if axes is row[0] and is_level(cells):
                value_scale(cells).apply(axes, "y")
            none = x.values[np.isnan(end)]
            if len(none):
                bottom = axes.get_ylim()[0]
                axes.plot(none, [bottom] * len(none), **FAILED, clip_on=False, zorder=3)
                axes.set_ylim(bottom)
            if axes is lowest:
                axes.set_xscale("log" if is_log(x.values) else "linear")
                x.label_axis(axes.xaxis)
        _column(found, name, cells).label_axis(row[0].yaxis)
    drawing.align_ylabels()
    return drawing


def _maps(found: SweepRows, columns: Mapping[str, Array], **more: Any) -> Picture:
    """Draw columns (runs,) as maps over the first two swept names."""
    (across, x), (up, y) = (_along(found, axis) for axis in found.grid.axes[:2])
    numbers = numbers_of(found)[across][:, up].T
    return map_figure(
        found.model.name,
        x._replace(values=borders(x.values), log=is_log(x.values)),
        y._replace(values=borders(y.values), log=is_log(y.values)),
        [_column(found, name, values[numbers]) for name, values in columns.items()],
        **more,
    )


def numbers_of(found: SweepRows) -> NDArray[np.int64]:
    """Return the indices of runs on a grid over the first two axes.

    All other axes have their middle value. The shape is that of the two axes.
    """
    counts = [len(axis.texts) for axis in found.grid.axes]
    whole = np.arange(found.grid.runs).reshape(*counts[:2], -1)
    middle = 0
    for count in counts[2:]:
        middle = middle * count + (count - 1) // 2
    return np.asarray(whole[:, :, middle])


def is_log(x: Array) -> bool:
    """Whether sorted values are spread more evenly on a logarithmic axis.

    Examples
    --------
    >>> is_log(np.array([1.0, 10.0, 100.0])), is_log(np.array([1.0, 50.0, 100.0]))
    (True, False)
    """
    if len(x) < 3 or not x[0] > 0.0 or x[-1] < SPREAD * x[0]:
        return False
    even, powers = np.diff(x), np.diff(np.log(x))
    return bool(np.ptp(powers) / np.max(powers) < np.ptp(even) / np.max(even))


def borders(x: Array, *, log: bool | None = None) -> Array:
    """Return the borders (k + 1,) of cells around sorted values (k,).

    Parameters
    ----------
    log : bool, optional
        Whether a border is the geometric mean of its neighbours; by default
        `is_log(x)`.

    Examples
    --------
    >>> borders(np.array([1.0, 2.0, 3.0]))
    array([0.5, 1.5, 2.5, 3.5])
    """
    if len(x) == 1:
        half = 0.5 * abs(x[0]) or 0.5
        return np.array([x[0] - half, x[0] + half])
    log = is_log(x) if log is None else log
    x = np.log(x) if log else x
    middles = (x[1:] + x[:-1]) / 2.0
    edges = np.array([2 * x[0] - middles[0], *middles, 2 * x[-1] - middles[-1]])
    return np.asarray(np.exp(edges)) if log else edges


def _notes(found: SweepRows, columns: int) -> list[str]:
    lines, others = [], found.grid.axes[2:]
    fixed = [
        f"{_along(found, a)[1].name} = {a.texts[(len(a.texts) - 1) // 2]}"
        for a in others
    ]
    if fixed and found.grid.together:
        if more := found.grid.axes[ABREAST:]:
            names = ", ".join(_along(found, a)[1].name for a in more)
            lines.append(f"Other names that vary: {names}.")
    elif fixed:
        text = f"Of the other names, the middle value is shown: {', '.join(fixed)}."
        lines.append(text)
    since = dict(found.work.options).get(FROM)
    if since is not None and (len(found.grid.axes) == 1 or not found.grid.together):
        lines.append(f"Least and greatest values from t = {since} on.")
    if columns > MOST:
        lines.append(f"The first {MOST} of {columns}; sweep.csv has all columns.")
    return lines
