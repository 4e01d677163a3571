"""One picture of several runs: a panel for each column, a curve for each run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.curves import series
from lagsim.outputs.letters import Letters
from lagsim.outputs.record import LEFT, REACH, RIGHT
from lagsim.outputs.scale import time_scale, value_scale
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

    from lagsim.run.observers.thinning import Thinning

# Inches: what stands above the panels, a line of the legend, between two panels, and
# below the last one; and how high a panel is where there are so many.
TOP, LINE, BETWEEN, BELOW = 0.5, 0.17, 0.14, 0.45
HEIGHTS = (2.9, 1.9, 1.5, 1.3)
LEAST = 1.1


def pens(count: int) -> list[Pen]:
    """Give pens that are told apart: by colour, and by dashes, also where those end."""
    size = len(PENS)
    found = []
    for k in range(count):
        pen = dict(PENS[(k + k // size) % size])
        found.append(pen | {"color": PENS[k % size]["color"]})
    return found


@in_house_style
def picture(
    runs: Mapping[str, Thinning],
    units: Mapping[str, str],
    notes: Sequence[str] = (),
    form: str = "png",
) -> Sheet:
    """Draw each column of `units` against time, with all runs on the same axes.

    Parameters
    ----------
    runs : mapping of str to Thinning
        What each is called, and its rows.
    units : mapping of str to str
        Of the columns; the first one is that of the time, `t`.
    notes : sequence of str
        Said below the legend.
    form : str
        png, svg or pdf.
    """
    columns = [name for name in units if name != "t"]
    letters = Letters(columns)
    entries = list(zip(runs, pens(len(runs)), strict=True))
    width = WIDTH - LEFT - RIGHT
    lines = in_lines(entries, width - EDGE)
    height = HEIGHTS[len(columns) - 1] if len(columns) <= len(HEIGHTS) else LEAST
    top = TOP + LINE * (len(lines) - 1 + len(notes))
    panels = len(columns) * (height + BETWEEN) - BETWEEN
    sheet = Sheet(WIDTH, top + panels + BELOW, form)
    subject = ", ".join(letters.name(name) for name in columns)
    sheet.heading(f"{len(runs)} runs", subject)
    for k, line in enumerate(lines):
        sheet.legend(LEFT, 0.42 + k * LINE, line, width)
    for k, note in enumerate(notes):
        sheet.text(LEFT, 0.42 + (len(lines) + k) * LINE, note, size=SMALL, room=width)
    drawn = {
        name: [(rows.series(name), pen) for rows, (_, pen) in zip(
            runs.values(), entries, strict=True
        )]
        for name in columns
    }  # fmt: skip
    times = time_scale(np.concatenate([t for (t, _), _ in drawn[columns[0]]]))
    for k, name in enumerate(columns):
        last = name == columns[-1]
        with sheet.panel(
            (LEFT, top + k * (height + BETWEEN), width, height),
            times,
            value_scale(*(values for (_, values), _ in drawn[name])),
            below=("t", units.get("t", "")) if last else ("", ""),
            side=(letters.name(name), units[name]),
            reach=REACH,
        ) as axes:
            for (t, values), pen in drawn[name]:
                series(axes, t, values, pen)
    return sheet
