"""One picture of several runs: a panel for each column, a curve for each run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lagsim.outputs.bare_matplotlib  # noqa: F401

# isort: split
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex

from lagsim.outputs.curves import series
from lagsim.outputs.figure import (
    COLOURS,
    LEFT,
    NOTHING,
    PENS,
    SMALL,
    Pen,
    Picture,
    frame,
    in_house_style,
    stack_height,
    stacked,
)
from lagsim.outputs.letters import Letters
from lagsim.outputs.scale import time_scale, value_scale

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.run.observers.thinning import Thinning

# Inches: how high a panel is where there are so many; and at least.
HEIGHTS = (2.9, 1.9, 1.5, 1.3)
LEAST = 1.1
# Runs that a legend names; of more, colours tell which is which: a bar of them, how
# long and how high it is, where it begins, and what it takes with its numbers.
MOST_NAMED = 12
BAR_LONG, BAR_HIGH, BAR_AT, BAR = 2.6, 0.1, 1.7, 0.3


def pens(count: int) -> list[Pen]:
    """Return distinct pens: by colour, and by dashes, also where colours end."""
    size = len(PENS)
    return [
        PENS[(k + k // size) % size] | {"color": PENS[k % size]["color"]}
        for k in range(count)
    ]


def _bar(found: Picture, name: str, colours: ScalarMappable) -> None:
    """Draw what the colours of many runs mean."""
    found.write(LEFT, found.top + 0.1, f"colour: {name}", size=SMALL, room=BAR_AT)
    [[axes]] = found.panels([BAR_LONG], [BAR_HIGH], left=LEFT + BAR_AT)
    found.colorbar(colours, cax=axes, orientation="horizontal")


@in_house_style
def picture(
    title: str,
    runs: Mapping[str, Thinning],
    units: Mapping[str, str],
    notes: Sequence[str] = (),
    order: tuple[str, Sequence[float]] = ("run", ()),
) -> Picture:
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
    """
    columns = [name for name in units if name != "t"]
    letters = Letters(columns)
    many = len(runs) > MOST_NAMED
    values = np.array(order[1] or range(1, len(runs) + 1), float)
    colours = ScalarMappable(Normalize(values.min(), values.max()), COLOURS)
    looks = pens(len(runs))
    if many:
        looks = [
            {"color": to_hex(c), "linewidth": 0.7} for c in colours.to_rgba(values)
        ]
    height = HEIGHTS[len(columns) - 1] if len(columns) <= len(HEIGHTS) else LEAST
    aside = BAR if many else 0.0
    found = Picture(
        stack_height(len(columns), height) + aside, title,
        f"{', '.join(letters.name(name) for name in columns)} of {len(runs)} runs",
        legend=[] if many else list(zip(runs, looks, strict=True)),
        remarks=notes,
    )  # fmt: skip
    if many:
        _bar(found, letters.text(order[0]), colours)
    rows = list(runs.values())
    times = time_scale(np.concatenate([r.series(columns[0])[0] for r in rows]))
    panels = stacked(found, len(columns), height, aside)
    for axes, name in zip(panels, columns, strict=True):
        drawn = [r.series(name) for r in rows]
        below = ("t", units.get("t", "")) if name == columns[-1] else NOTHING
        scale = value_scale(*(column for _, column in drawn))
        frame(axes, times, scale, below=below, up=(letters.name(name), units[name]))
        for (t, column), pen in zip(drawn, looks, strict=True):
            series(axes, t, column, pen)
    found.align_ylabels()
    return found
