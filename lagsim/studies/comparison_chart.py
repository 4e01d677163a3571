"""What differs: the worst columns of two tables, or of a run and its golden.

At the left both, at the right the size of their difference in the band of its bound.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.outputs.curves import point, series
from lagsim.outputs.figure import (
    BLACK,
    LEFT,
    NOTHING,
    PENS,
    RIGHT,
    WIDTH,
    Named,
    Pen,
    Picture,
    content,
    frame,
    in_house_style,
    mark,
    stack_height,
)
from lagsim.outputs.letters import Letters, raised
from lagsim.outputs.scale import log_scale, time_scale, value_scale
from lagsim.run.observers.thinning import Thinning

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.studies.comparison import Comparison, Deviation, Verdict
    from lagsim.studies.tables import Table

# So many columns are shown.
MOST = 4
# Inches: a panel, and what is above it.
HEIGHT, APART = 1.4, 0.26
# Differences so much smaller than the largest are not shown.
LEAST = 1e-12
# Rows that are thinned at once.
ROWS = 1 << 16

GOLDEN: Pen = {"color": PENS[1]["color"], "linewidth": 2.2}
NEW, DIFFERENCE = PENS[0], BLACK
BAND: Pen = {"color": "#009E73", "linewidth": 5.0}
PLACE = mark("o", 4.0, PENS[2]["color"], "none")


class Curve(NamedTuple):
    """A column: its worst cell, its name and unit, its rows as `Thinning` keeps them.

    Those are time, golden, new, apart, bound.
    """

    worst: Deviation
    named: Named
    rows: Thinning


def picture(title: str, golden: Table, new: Table, found: Comparison) -> bytes:
    """Draw the worst columns of a comparison; give a PNG."""
    units = {**golden.units, **new.units}
    letters = Letters(golden.columns)
    curves = [
        Curve(
            d,
            (letters.name(d.column), units.get(d.column, "")),
            _series(d.column, golden, new, found),
        )
        for d in shown(found.worst)
    ]
    count, *first = told(found, letters)
    return drawn(count, title, curves, first)


def told(verdict: Verdict, letters: Letters) -> list[str]:
    """Give how many columns differ, and which is the first to do so."""
    first = verdict.first
    if first is None:
        return ["no column differs"]
    return [
        f"{len(verdict.failed)} of {len(verdict.worst)} columns differ",
        f"first {letters.name(first.column)} at t = {first.first:.4g} s",
    ]


def shown(worst: Sequence[Deviation]) -> Sequence[Deviation]:
    """Choose what is drawn; the time only where there is nothing else."""
    return [d for d in worst if d.column != "t"][:MOST] or worst[:1]


def thinned() -> Thinning:
    """Give what a curve's rows go into."""
    return Thinning(("t", "golden", "new", "apart", "bound"), paths=())


@in_house_style
def drawn(
    title: str, subject: str, curves: Sequence[Curve], notes: Sequence[str] = ()
) -> bytes:
    """Draw columns below each other, and notes; give a PNG."""
    legend = [
        ("golden", GOLDEN), ("new", NEW), ("difference", DIFFERENCE), ("bound", BAND),
        ("worst", PLACE),
    ]  # fmt: skip
    height = stack_height(len(curves), HEIGHT)
    found = Picture(height, title, subject, legend=legend, notes=notes)
    widths, heights = [(WIDTH - 2 * LEFT - RIGHT) / 2] * 2, [HEIGHT] * len(curves)
    panels = found.panels(widths, heights, top=APART, across=LEFT, down=APART)
    for (worst, (name, unit), rows), (both, off) in zip(curves, panels, strict=True):
        (t, g), (_, n) = rows.series("golden"), rows.series("new")
        time, below = time_scale(t), ("t", "s") if both is panels[-1][0] else NOTHING
        up = name, raised(unit)
        frame(both, time, value_scale(g, n), below=below, up=up)
        series(both, t, g, GOLDEN)
        series(both, rows.series("new")[0], n, NEW)
        # The size of the difference, and the band that it has to stay in.
        (t, apart), (times, bound) = rows.series("apart"), rows.series("bound")
        scale = log_scale(apart, bound, margin=0.0, least=0.5)
        scale = scale._replace(low=max(scale.low, LEAST * scale.high))
        frame(off, time, scale, below=below, up=("|new − golden|", raised(unit)))
        shade = {"facecolor": (BAND["color"], 0.45), "edgecolor": BAND["color"]}
        off.fill_between(times, scale.low, bound, **shade, zorder=0.4)
        series(off, t, np.where(apart > 0.0, apart, np.nan), DIFFERENCE)
        if 0.0 < worst.difference < np.inf:
            point(off, worst.t, worst.difference, PLACE)
    found.align_ylabels()
    return content(found)


def _series(column: str, golden: Table, new: Table, found: Comparison) -> Thinning:
    """Give what is drawn of a column, thinned."""
    thin = thinned()
    for k in range(0, len(found.rows.golden), ROWS):
        mine = found.rows.golden[k : k + ROWS]
        g, n = golden[column][mine], new[column][found.rows.new[k : k + ROWS]]
        with np.errstate(invalid="ignore"):
            limit = found.bound(column, g, n)
            block = np.stack((golden.t[mine], g, n, np.abs(n - g), limit), 1)
        thin.add(block)
    return thin
