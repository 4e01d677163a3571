"""One picture of several runs: a panel for each column, a curve for each run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from lagsim.outputs.curves import series
from lagsim.outputs.letters import Letters
from lagsim.outputs.record import LEFT, REACH, RIGHT
from lagsim.outputs.scale import Scale, time_scale, value_scale
from lagsim.outputs.sheet import (
    EDGE,
    PENS,
    SMALL,
    WIDTH,
    Pen,
    Sheet,
    in_house_style,
    in_lines,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.run.observers.thinning import Array, Thinning

# Inches: what stands above the panels, a line of the legend, between two panels, and
# below the last one; and how high a panel is where there are so many.
TOP, LINE, BETWEEN, BELOW = 0.5, 0.17, 0.14, 0.45
HEIGHTS = (2.9, 1.9, 1.5, 1.3)
LEAST = 1.1
# Runs that a legend names; of more, colours tell which is which: a bar of them, how
# long and how high it is, and where it begins.
MOST_NAMED, COLOURS = 12, "viridis"
BAR_LONG, BAR_HIGH, BAR_AT = 2.6, 0.1, 1.7


def pens(count: int) -> list[Pen]:
    """Give pens that are told apart: by colour, and by dashes, also where those end."""
    size = len(PENS)
    found = []
    for k in range(count):
        pen = dict(PENS[(k + k // size) % size])
        found.append(pen | {"color": PENS[k % size]["color"]})
    return found


def _coloured(values: Array) -> list[Pen]:
    """Give pens whose colours go with values."""
    span = float(np.ptp(values)) or 1.0
    colours = colormaps[COLOURS]((values - values.min()) / span)
    return [{"color": to_hex(colour), "linewidth": 0.7} for colour in colours]


def _bar(sheet: Sheet, letters: Letters, name: str, bar: Scale) -> None:
    """Draw what the colours of many runs mean."""
    sheet.text(LEFT, 0.42, f"colour: {letters.text(name)}", size=SMALL, room=BAR_AT)
    levels = np.linspace(bar.low, bar.high, 65)
    place = (LEFT + BAR_AT, 0.34, BAR_LONG, BAR_HIGH)
    axes = sheet.panel(place, bar, Scale(0.0, 1.0), below=(" ", ""), ticks=(5, 0))
    axes.pcolormesh(levels, [0.0, 1.0], levels[None, :-1], cmap=COLOURS, zorder=1.0)


@in_house_style
def picture(
    title: str,
    runs: Mapping[str, Thinning],
    units: Mapping[str, str],
    notes: Sequence[str] = (),
    order: tuple[str, Sequence[float]] = ("run", ()),
    form: str = "png",
) -> Sheet:
    """Draw each column of `units` against time, with all runs on the same axes.

    Parameters
    ----------
    title : str
        The model's name.
    runs : mapping of str to Thinning
        What each is called, and its rows.
    units : mapping of str to str
        Of the columns; the first one is that of the time, `t`.
    notes : sequence of str
        Said below the legend.
    order : tuple
        A name, and a number for each run, by which many runs are coloured.
    form : str
        png, svg or pdf.
    """
    columns = [name for name in units if name != "t"]
    letters = Letters(columns)
    width = WIDTH - LEFT - RIGHT
    many = len(runs) > MOST_NAMED
    values = np.array(order[1] or range(1, len(runs) + 1), float)
    bar = Scale(float(values.min()), float(values.max()))
    looks = _coloured(values) if many else pens(len(runs))
    entries = list(zip(runs, looks, strict=True))
    lines = [[]] if many else in_lines(entries, width - EDGE)
    height = HEIGHTS[len(columns) - 1] if len(columns) <= len(HEIGHTS) else LEAST
    top = TOP + LINE * (len(lines) - 1 + len(notes)) + (0.3 if many else 0.0)
    panels = len(columns) * (height + BETWEEN) - BETWEEN
    sheet = Sheet(WIDTH, top + panels + BELOW, form)
    subject = ", ".join(letters.name(name) for name in columns)
    sheet.heading(title, f"{subject} of {len(runs)} runs")
    if many:
        _bar(sheet, letters, order[0], bar)
    for k, line in enumerate(lines):
        sheet.legend(LEFT, 0.42 + k * LINE, line, width)
    for k, note in enumerate(notes):
        below = 0.42 + (len(lines) + k) * LINE + (0.3 if many else 0.0)
        sheet.text(LEFT, below, note, size=SMALL, room=width)
    drawn = {
        name: [(rows.series(name), pen) for rows, (_, pen) in zip(
            runs.values(), entries, strict=True
        )]
        for name in columns
    }  # fmt: skip
    times = time_scale(np.concatenate([t for (t, _), _ in drawn[columns[0]]]))
    for k, name in enumerate(columns):
        last = name == columns[-1]
        axes = sheet.panel(
            (LEFT, top + k * (height + BETWEEN), width, height),
            times,
            value_scale(*(values for (_, values), _ in drawn[name])),
            below=("t", units.get("t", "")) if last else ("", ""),
            side=(letters.name(name), units[name]),
            reach=REACH,
        )
        for (t, values), pen in drawn[name]:
            series(axes, t, values, pen)
    return sheet
