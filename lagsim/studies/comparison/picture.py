"""A picture of the worst columns: golden and new, and their difference in its band."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.axis import DecadeAxis, extent, time_axis, value_axis
from lagsim.outputs.panel import Panel, legend
from lagsim.outputs.sheet import (
    DIM,
    HEADING,
    NORMAL,
    PENS,
    SMALL,
    WIDTH,
    Pen,
    Sheet,
    fitted,
    in_house_style,
)
from lagsim.run.observers.thinning import Thinning

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.studies.comparison.judging import Comparison
    from lagsim.studies.comparison.reading import Table

    At = tuple[float, float]

# So many columns are shown.
MOST = 4
# Inches: margins, the space for the scales, the panels and what is between them.
EDGE, LEFT, TOP, HEIGHT, GAP, BELOW = 0.12, 0.66, 0.62, 1.35, 0.36, 0.08
# Differences so much smaller than the largest are not shown.
MOST_DECADES = 12
# Rows that are thinned at once.
ROWS = 1 << 16

GOLDEN = Pen(PENS[1].colour, width=2.2)
NEW = PENS[0]
APART = PENS[0]
BAND = Pen("#009E73", width=5.0)
PLACE = Pen(PENS[2].colour, marker="o", size=4.0, fill="none")


@in_house_style
def picture(title: str, golden: Table, new: Table, found: Comparison) -> bytes:
    """Draw the worst columns of a comparison; give a PNG."""
    shown = [d for d in found.worst if d.column != "t"][:MOST] or found.worst[:1]
    height = TOP + len(shown) * (HEIGHT + GAP) + BELOW
    sheet = Sheet(WIDTH, height)
    verdict = "same" if found.passed else "differ"
    sheet.text(EDGE, 0.22, verdict, size=HEADING, bold=True)
    room = WIDTH - 2 * EDGE - 0.8
    sheet.text(
        WIDTH - EDGE, 0.22, fitted(title, room), size=NORMAL, align="right", colour=DIM
    )
    width = WIDTH / 2 - LEFT - EDGE
    legend(sheet, LEFT, 0.46, [("golden", GOLDEN), ("new", NEW)], width)
    entries = [("difference", APART), ("passes", BAND), ("worst", PLACE)]
    legend(sheet, WIDTH / 2 + LEFT - 0.4, 0.46, entries, width + 0.4)
    for k, deviation in enumerate(shown):
        top = TOP + k * (HEIGHT + GAP)
        series = _series(deviation.column, golden, new, found)
        label = fitted(deviation.column, HEIGHT + 0.2, SMALL)
        at = (deviation.t, deviation.difference)
        _values(sheet, (LEFT, top, width, HEIGHT), series, label)
        _apart(sheet, (WIDTH / 2 + LEFT, top, width, HEIGHT), series, at)
    for left in (LEFT, WIDTH / 2 + LEFT):
        sheet.text(left + width / 2, height - 0.12, "t (s)", align="center")
    return sheet.png()


def _series(column: str, golden: Table, new: Table, found: Comparison) -> Thinning:
    """Give what is drawn of a column, thinned."""
    thin = Thinning(("t", "golden", "new", "apart", "bound"), paths=())
    for k in range(0, len(found.rows.golden), ROWS):
        mine = found.rows.golden[k : k + ROWS]
        g, n = golden[column][mine], new[column][found.rows.new[k : k + ROWS]]
        with np.errstate(invalid="ignore"):
            limit = found.bound(column, g, n)
            block = np.stack((golden.t[mine], g, n, np.abs(n - g), limit), 1)
        thin.add(block)
    return thin


def _values(
    sheet: Sheet, place: tuple[float, float, float, float], series: Thinning, label: str
) -> None:
    t, g = series.series("golden")
    other, n = series.series("new")
    panel = Panel(sheet, place, time_axis(t), value_axis(g, n))
    panel.series(t, g, GOLDEN)
    panel.series(other, n, NEW)
    panel.frame((5, 5))
    _label(sheet, place, panel.y.label(label))


def _apart(
    sheet: Sheet, place: tuple[float, float, float, float], series: Thinning, worst: At
) -> None:
    """Draw the size of the difference, and the band that it has to stay in."""
    t, apart = series.series("apart")
    times, bound = series.series("bound")
    apart, bound = (_logarithm(values) for values in (apart, bound))
    found = extent(apart, bound) or (-1.0, 0.0)
    low, high = max(found[0], found[1] - MOST_DECADES) - 0.5, found[1] + 0.5
    panel = Panel(sheet, place, time_axis(t), DecadeAxis(low, high))
    panel.band(times, np.full_like(bound, low), np.fmax(bound, low), BAND)
    panel.series(t, apart, APART)
    level = _logarithm(np.array([worst[1]]))
    if np.isfinite(level[0]):
        panel.mark(worst[0], float(level[0]), PLACE, PLACE.colour)
    panel.frame((5, 5))
    _label(sheet, place, "|new − golden|")


def _logarithm(values: Floats) -> Floats:
    """Give the powers of ten; nan for what is zero or not finite."""
    some = (values > 0.0) & (values < np.inf)
    return np.log10(values, out=np.full_like(values, np.nan), where=some)


def _label(sheet: Sheet, place: tuple[float, float, float, float], label: str) -> None:
    left, top, _, height = place
    sheet.text(
        left - LEFT + 0.2, top + height / 2, label, size=SMALL, align="center",
        turned=True,
    )  # fmt: skip
