"""A sweep as a matplotlib Figure: curves over one name, maps over two."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.figure import Column, figure, map_figure
from lagsim.outputs.letters import Letters, raised
from lagsim.studies.sweep.chart import borders, is_log, numbers_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from lagsim.studies.sweep.grid import Axis
    from lagsim.studies.sweep.sweeping import Found


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
