"""Picture of a fit: data, model, and the residuals below."""

from __future__ import annotations

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.figure import (
    DIM,
    INK,
    PENS,
    Picture,
    curve,
    encoded_figure,
    in_house_style,
    line,
    marker_pen,
    stack_height,
)
from lagsim.outputs.letters import letters_of, raised_powers
from lagsim.outputs.scale import name_axis, value_scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from lagsim.language.arrays import Floats
    from lagsim.outputs.figure import Entry, Pen
    from lagsim.outputs.letters import Letters
    from lagsim.studies.fit.data import Match
    from lagsim.studies.fit.fitting import Fit, Found

# Inches: panels of data, and of residuals.
DATA, RESIDUALS = 1.5, 0.9
# Columns at most, points of a curve, and data points that are small marks.
MOST, CURVE, MANY = 6, 800, 120
MODEL: Pen = {"color": INK, "linewidth": 0.8}


class _Drawn:
    """Data and curves of one record.

    Attributes
    ----------
    name : str
        The file name of the data.
    times : ndarray, shape (k,)
        Times of the data.
    data, residuals : ndarray, shape (k, m)
        Data, and data less model, by columns; nan in cells without a number.
    count : int
        Number of measurements, cells with a number.
    t, model : ndarray, shapes (points,) and (points, m)
        Times and columns of the curves.
    pen : Pen
        Mark of the data.
    """

    def __init__(self, fit: Fit, found: Found, number: int, begin: int) -> None:
        record, measured = fit.records[number], fit.measured[number]
        self.name, self.times = PurePath(record.name).name, record.times
        self.data, self.residuals = np.full((2, *measured.shape), np.nan)
        self.count = int(np.count_nonzero(measured))
        part = slice(begin, begin + self.count)
        self.data[measured], self.residuals[measured] = fit.data[part], -found.raw[part]
        self.t, self.model = fit.curve(found.x, number, CURVE)
        size = 2.6 if len(record.times) <= MANY else 1.6
        color = PENS[number % len(PENS)]["color"]
        self.pen = marker_pen("o", size, color)


def chart(fit: Fit, found: Found, form: str = "png") -> bytes:
    """Return the picture fit.png as bytes, or in another file format `form`."""
    drawn, begin = [], 0
    for number in range(len(fit.records)):
        drawn.append(_Drawn(fit, found, number, begin))
        begin += drawn[-1].count
    return encoded_figure(_chart(fit, found, drawn), form)


@in_house_style
def _chart(fit: Fit, found: Found, drawn: Sequence[_Drawn]) -> Picture:
    shown = fit.matches[:MOST]
    legend: list[Entry] = [(x.name, x.pen) for x in drawn]
    if len(drawn) == 1:
        legend = [("data", drawn[0].pen)]
    legend.append(("model", MODEL))
    notes = [_note(fit, found)]
    if len(fit.matches) > MOST:
        notes.append(f"{len(fit.matches) - MOST} more columns are in fit.csv")
    height = stack_height(len(shown), DATA) + stack_height(len(shown), RESIDUALS) - 0.45
    picture = Picture(height, fit.given.name, "fit", legend=legend, notes=notes)
    panels = picture.subplots(
        2 * len(shown), squeeze=False, sharex=True,
        height_ratios=[DATA, RESIDUALS] * len(shown),
    )[:, 0]  # fmt: skip
    letters = letters_of(fit.given)
    for k, match in enumerate(shown):
        above, below = panels[2 * k : 2 * k + 2]
        for one in drawn:
            curve(above, one.t, one.model[:, k], MODEL)
            line(above, one.times, one.data[:, k], one.pen)
            line(below, one.times, one.residuals[:, k], one.pen)
        _scaled(above, [x for one in drawn for x in (one.model[:, k], one.data[:, k])])
        _scaled(below, [one.residuals[:, k] for one in drawn], zero=True)
        name_axis(above.yaxis, _named(match, letters), raised_powers(match.unit))
        name_axis(below.yaxis, "residual")  # in the unit of the panel above
    times = np.concatenate([one.times for one in drawn])
    low, high = float(times.min()), float(times.max())
    free = 0.015 * (high - low) or 1.0
    panels[-1].set_xlim(low - free, high + free)
    name_axis(panels[-1].xaxis, "t", "s")
    picture.align_ylabels()
    return picture


def _scaled(axes: Axes, values: Sequence[Floats], *, zero: bool = False) -> None:
    """Set the scale of a panel for values; with `zero` symmetric, with a line at 0."""
    if zero:
        size = max(float(np.nanmax(np.abs(x), initial=0.0)) for x in values)
        values = [np.array([-size, size])]
        axes.axhline(0.0, color=DIM, linewidth=0.6)
    value_scale(*values).apply(axes, "y")


def _named(match: Match, letters: Letters) -> str:
    """Return the label of a column: its name, with the expression if that differs."""
    if match.text == match.column:
        return letters.name(match.column)
    return f"{match.column} = {letters.text(match.text)}"


def _note(fit: Fit, found: Found) -> str:
    """Return one line with the values found and their standard errors."""
    parts, letters = [], letters_of(fit.given)
    sizes = np.full(len(fit.names), np.nan)
    if found.estimate is not None:
        sizes = np.sqrt(np.diag(found.estimate.covariance)) * fit.scales
    for one, value, size in zip(fit.names, found.x.tolist(), sizes, strict=True):
        name = letters.name(one.name) + one.label.removeprefix(one.name)
        error = f" ± {size:.2g}" if np.isfinite(size) else ""
        # A line breaks between names only.
        parts.append(f"{name} = {value:.6g}{error}".replace(" ", "\u00a0"))
    return ",   ".join(parts)
