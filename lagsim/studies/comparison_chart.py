"""Pictures of a verdict: columns with the largest deviations.

The left panel of a column shows both runs, and the right panel the absolute difference
with its bound.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.figure import (
    BLACK,
    NOTHING,
    PENS,
    Pen,
    Picture,
    encoded_figure,
    frame,
    in_house_style,
    marker_pen,
    point,
    series,
    stack_height,
)
from lagsim.outputs.letters import Letters, raised_powers
from lagsim.outputs.scale import log_scale, time_scale, value_scale
from lagsim.studies.tables import thinned

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.studies.comparison import Deviation, Verdict

# Largest number of columns in the picture.
MOST = 4
# Inches: a panel.
HEIGHT = 1.4
# Ratio to the largest difference below which differences are not shown.
LEAST = 1e-12

GOLDEN: Pen = {"color": PENS[1]["color"], "linewidth": 2.2}
NEW, DIFFERENCE = PENS[0], BLACK
BAND: Pen = {"color": "#009E73", "linewidth": 5.0}
PLACE = marker_pen("o", 4.0, PENS[2]["color"], "none")


def summary_texts(verdict: Verdict, letters: Letters) -> list[str]:
    """Return texts on a picture: how many columns differ, which is first in time."""
    first = verdict.first
    if first is None:
        return ["no column differs"]
    return [
        f"{len(verdict.failed)} of {len(verdict.worst)} columns differ",
        f"first {letters.name(first.column)} at t = {first.first:.4g} s",
    ]


def drawn_deviations(worst: Sequence[Deviation]) -> Sequence[Deviation]:
    """Return the deviations to draw, without the time unless it is the only column."""
    return [d for d in worst if d.column != "t"][:MOST] or worst[:1]


@in_house_style
def picture(
    title: str,
    subject: str,
    verdict: Verdict,
    letters: Letters,
    units: Mapping[str, str],
    notes: Sequence[str] = (),
) -> bytes:
    """Return a PNG of the columns with the largest deviations, one below the other.

    Parameters
    ----------
    title, subject : str
        Written as `title: subject`.
    verdict : Verdict
        The comparison, whose deviations are drawn.
    letters : Letters
        The form of names in the picture.
    units : mapping
        Units of the columns.
    """
    columns = drawn_deviations(verdict.worst)
    legend = [
        ("golden", GOLDEN), ("new", NEW), ("difference", DIFFERENCE), ("bound", BAND),
        ("worst", PLACE),
    ]  # fmt: skip
    height = stack_height(len(columns), HEIGHT)
    found = Picture(height, title, subject, legend=legend, notes=notes)
    panels = found.subplots(len(columns), 2, squeeze=False)
    for worst, (both, off) in zip(columns, panels, strict=True):
        # An invariant has the name of its column.
        name, blank, more = worst.column.partition(" ")
        unit = raised_powers(units.get(name, ""))
        t, g, n, bound = verdict.of(worst.column)
        time, below = time_scale(t), ("t", "s") if both is panels[-1][0] else NOTHING
        up = f"{letters.name(name)}{blank}{more}", unit
        frame(both, time, value_scale(g, n), below=below, up=up)
        for values, pen in ((g, GOLDEN), (n, NEW)):
            found.when_placed(series, both, *_thinned(t, values), pen)
        # The size of the difference, and the tolerance within which it has to stay.
        with np.errstate(invalid="ignore"):
            differences = np.abs(n - g)
        scale = log_scale(differences, bound, margin=0.0, least=0.5)
        scale = scale._replace(low=max(scale.low, LEAST * scale.high))
        frame(off, time, scale, below=below, up=("difference", unit))
        shade = {"facecolor": (BAND["color"], 0.45), "edgecolor": BAND["color"]}
        times, bound = _thinned(t, bound)
        off.fill_between(times, scale.low, bound, **shade, zorder=0.4)
        times, differences = _thinned(t, differences)
        differences = np.where(differences > 0.0, differences, np.nan)
        found.when_placed(series, off, times, differences, DIFFERENCE)
        if 0.0 < worst.difference < np.inf:
            point(off, worst.t, worst.difference, PLACE)
    found.align_ylabels()
    return encoded_figure(found)


def _thinned(t: Floats, values: Floats) -> tuple[Floats, Floats]:
    return thinned({"t": t, "values": values}).series("values")
