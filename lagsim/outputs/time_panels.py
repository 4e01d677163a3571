"""Columns against time, in panels below and beside each other."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.axis import Axis, extent, time_axis, value_axis
from lagsim.outputs.panel import EVENTS, GAP, LOST, SAMPLE, Panel, legend
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
    text_width,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.run.observers.thinning import Array, Thinning

# Inches at the sides of a sheet; and for the numbers at the left of a small panel.
LEFT, RIGHT, EDGE, NUMBERS = 0.78, 0.18, 0.12, 0.46

# Coordinates of one unit share a panel while they are few, and while none of them
# would be squeezed by the others into less than this part of it.
SHARING = 3
SQUEEZED = 0.05

# More panels than this would be too small to read.
MOST_PANELS = 40


@dataclass(frozen=True, slots=True)
class Record:
    """What the pictures of one run have in common.

    Attributes
    ----------
    title : the model's name; plain text, as everything that is written here.
    rows : the thinned rows of the run.
    units : unit of each column that has one; that of `t` too.
    events : times to mark.
    note : said below the title: that and why a run is incomplete; else empty.
    horizon : rows past this time are no forecast; infinite where all are.
    """

    title: str
    rows: Thinning
    units: Mapping[str, str] = field(default_factory=dict)
    events: Sequence[float] = ()
    note: str = ""
    horizon: float = math.inf

    def unit(self, column: str) -> str:
        """Return the unit of a column, empty where none is known."""
        return self.units.get(column, "")

    def trusted(self) -> int:
        """Return how many of the rows that paths show lie before the horizon."""
        if math.isinf(self.horizon):
            return self.rows.row_count
        return int(np.searchsorted(self.rows.sampled("t"), self.horizon, side="right"))

    def time(self) -> Axis:
        """Return the axis of time, from the first row to the last."""
        return time_axis(np.array([self.rows.first("t"), self.rows.last("t")]))


@dataclass(frozen=True, slots=True)
class Group:
    """Columns that share a panel."""

    names: tuple[str, ...]
    label: str
    unit: str


def header_height(record: Record) -> float:
    """Return how much of a sheet `header` takes."""
    return 0.5 if record.note else 0.32


def header(sheet: Sheet, record: Record, subject: str, *, timed: bool = True) -> None:
    """Write the model's name, what the picture shows, and that a run is incomplete."""
    right = sheet.width - RIGHT
    sheet.text(right, 0.22, subject, size=NORMAL, align="right", colour=DIM)
    right -= text_width(subject) + GAP
    for name, pen in _marked(record, timed=timed):
        right -= SAMPLE + text_width(name, SMALL) + GAP
        legend(sheet, right, 0.22, [(name, pen)], sheet.width)
    room = right - EDGE - GAP
    title = fitted(record.title, room, HEADING, bold=True)
    sheet.text(EDGE, 0.22, title, size=HEADING, bold=True)
    if record.note:
        note = fitted(record.note, sheet.width - 2 * EDGE, SMALL)
        sheet.text(EDGE, 0.39, note, size=SMALL, colour=DIM)


def _marked(record: Record, *, timed: bool) -> list[tuple[str, Pen]]:
    found = [("events", EVENTS)] if record.events and timed else []
    if record.horizon < record.rows.last("t"):
        found.append(("past the horizon", replace(LOST, width=6.0)))
    return found


def marks(panel: Panel, record: Record) -> None:
    """Mark in a panel with time across it: events, and what lies past the horizon."""
    panel.beyond(record.horizon)
    panel.times(record.events)


def grouped(record: Record, names: Sequence[str]) -> list[Group]:
    """Put columns of one unit into one group where they fit, in the given order."""
    by_unit: dict[str, list[str]] = {}
    for name in names:
        by_unit.setdefault(record.unit(name), []).append(name)
    groups: dict[str, Group] = {}
    for unit, alike in by_unit.items():
        if unit and 1 < len(alike) <= SHARING and _comparable(record, alike):
            shared = Group(tuple(alike), ", ".join(alike), unit)
            groups.update(dict.fromkeys(alike, shared))
    alone = [groups.get(name) or single(record, name) for name in names]
    return list(dict.fromkeys(alone))


def single(record: Record, name: str) -> Group:
    """Return the group of one column."""
    return Group((name,), name, record.unit(name))


def _comparable(record: Record, names: Sequence[str]) -> bool:
    spans = []
    whole: list[float] = []
    for name in names:
        axis = value_axis(record.rows.series(name)[1], margin=0.0)
        spans.append(axis.high - axis.low)
        whole += [axis.low, axis.high]
    return min(spans) >= SQUEEZED * (max(whole) - min(whole))


def chosen(names: Sequence[str], most: int) -> list[str]:
    """Return at most so many of the names, evenly spaced, first and last included."""
    if len(names) <= most:
        return list(names)
    if most == 1:
        return [names[0]]
    return [names[k * (len(names) - 1) // (most - 1)] for k in range(most)]


@dataclass(frozen=True, slots=True)
class Layout:
    """A grid of panels: how many columns of them, and their size in inches."""

    count: int
    columns: int
    width: float
    height: float
    gap: float

    @property
    def left(self) -> float:
        """Where the first column begins."""
        return LEFT if self.columns == 1 else EDGE + NUMBERS

    @property
    def rows(self) -> int:
        """How many panels stand below each other."""
        return -(-self.count // self.columns)

    @property
    def total(self) -> float:
        """How much of a sheet the panels take, with the time axis below."""
        return self.rows * (self.height + self.gap) + 0.45


def layout(groups: Sequence[Group]) -> Layout:
    """Return the grid for these groups: one column while they are few."""
    count = len(groups)
    if count <= 5:
        height = (2.4, 1.6, 1.25, 1.05, 0.95)[max(count, 1) - 1]
        gap = 0.24 if any(_headed(group, height) for group in groups) else 0.12
        return Layout(count, 1, WIDTH - LEFT - RIGHT, height, gap)
    columns = 2 if count <= 12 else 3 if count <= 24 else 5
    height = {2: 0.95, 3: 0.8, 5: 0.55}[columns]
    width = (WIDTH - RIGHT - EDGE) / columns - NUMBERS
    return Layout(count, columns, width, height, 0.25)


def _headed(group: Group, height: float) -> bool:
    """Whether the name stands above the panel and not at its side."""
    room = height - 0.05
    return len(group.names) > 1 or text_width(f"{group.label} ({group.unit})") > room


def panels(sheet: Sheet, top: float, record: Record, groups: Sequence[Group]) -> None:
    """Draw a panel for each group below `top`, as `layout` has them."""
    grid = layout(groups)
    time = record.time()
    sizes: dict[str, float] = {}
    for group in groups:
        heights = [height_of(record.rows.series(name)[1]) for name in group.names]
        sizes[group.unit] = max(sizes.get(group.unit, 0.0), *heights)
    for k, group in enumerate(groups):
        row, column = divmod(k, grid.columns)
        left = grid.left + column * (grid.width + NUMBERS)
        y = top + row * (grid.height + grid.gap) + grid.gap
        place = (left, y, grid.width, grid.height)
        lowest = k + grid.columns >= len(groups)
        panel = Panel(sheet, place, time, _scale(record, group, sizes[group.unit]))
        _fill(panel, record, group, stacked=grid.columns == 1)
        panel.frame(ticks(grid.width, grid.height), numbers_below=lowest)
        if lowest:
            time_label(panel, record)


def _scale(record: Record, group: Group, size: float) -> Axis:
    values = [record.rows.series(name)[1] for name in group.names]
    return value_axis(*values, size=size)


def _fill(panel: Panel, record: Record, group: Group, *, stacked: bool) -> None:
    marks(panel, record)
    pens = PENS[: len(group.names)]
    for name, pen in zip(group.names, pens, strict=True):
        panel.series(*record.rows.series(name), pen)
    if len(group.names) > 1:
        side_label(panel, panel.y.label(group.label, group.unit))
        legend_above(panel, list(zip(group.names, pens, strict=True)))
    elif stacked and not _headed(group, panel.height):
        side_label(panel, panel.y.label(group.label, group.unit))
    else:
        above(panel, panel.y.label(group.label, group.unit))


def ticks(width: float, height: float) -> tuple[int, int]:
    """Return how many ticks at most fit a panel of this size."""
    return max(3, int(1.5 * width)), max(3, min(7, math.ceil(3.4 * height)))


def time_label(panel: Panel, record: Record) -> None:
    """Write what the time axis shows below it."""
    text = panel.x.label("t", record.unit("t"))
    middle = panel.left + panel.width / 2
    panel.sheet.text(middle, panel.bottom + 0.31, text, align="center")


def side_label(panel: Panel, text: str) -> None:
    """Write upwards at the left edge of the sheet, beside the panel."""
    middle = panel.top + panel.height / 2
    shown = fitted(text, panel.height + 0.1)
    panel.sheet.text(0.2, middle, shown, align="center", turned=True)


def above(panel: Panel, text: str) -> None:
    """Write above the panel, from its left edge."""
    shown = fitted(text, panel.width, SMALL)
    panel.sheet.text(panel.left, panel.top - 0.06, shown, size=SMALL)


def legend_above(panel: Panel, entries: Sequence[tuple[str, Pen]]) -> None:
    """Name the lines of a panel in a row above it."""
    legend(panel.sheet, panel.left, panel.top - 0.06, entries, panel.width)


def height_of(values: Array) -> float:
    """Return the greatest size among finite values; 0 where there are none."""
    low, high = extent(values) or (0.0, 0.0)
    return max(abs(low), abs(high))
