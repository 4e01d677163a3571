"""Columns against time, in panels below and beside each other."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.curves import (
    EVENTS,
    IMPACTS,
    LOST,
    RESTS,
    marks,
    series,
    shade,
    stems,
)
from lagsim.outputs.scale import Scale, extent, time_scale, value_scale
from lagsim.outputs.sheet import (
    DIM,
    EDGE,
    GAP,
    HEADING,
    NOTHING,
    PENS,
    SAMPLE,
    SMALL,
    WIDTH,
    Pen,
    Sheet,
    text_width,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from lagsim.run.observers.thinning import Array, Thinning

# Inches at the sides of a sheet; for the numbers at the left of a small panel; from the
# frame of a wide one to its label.
LEFT, RIGHT, NUMBERS, REACH = 0.78, 0.18, 0.46, 0.58

# Coordinates of one unit share a panel while they are few, and while none of them
# would be squeezed by the others into less than this part of it.
SHARING = 3
SQUEEZED = 0.05

# Columns that are 0 but in the rows after impacts.
IMPULSE = "impulse."

# More panels than this would be too small to read.
MOST_PANELS = 40

# Up to so many panels: how many stand beside each other, and their height.
GRIDS = (
    (1, 1, 2.4), (2, 1, 1.6), (3, 1, 1.25), (4, 1, 1.05), (5, 1, 0.95), (12, 2, 0.95),
    (24, 3, 0.8), (MOST_PANELS, 5, 0.55),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Record:
    """What the pictures of one run have in common.

    Attributes
    ----------
    title : the model's name; plain text, as everything that is written here.
    rows : the thinned rows of the run.
    units : unit of each column that has one; that of `t` too.
    impacts, rests, events : times to mark: where velocities jump, where what bounces
        comes to rest, where something else happens.
    note : said below the title: that and why a run is incomplete; else empty.
    horizon : rows past this time are no forecast; infinite where all are.
    """

    title: str
    rows: Thinning
    units: Mapping[str, str] = field(default_factory=dict)
    events: Sequence[float] = ()
    note: str = ""
    horizon: float = math.inf
    impacts: Sequence[float] = ()
    rests: Sequence[float] = ()

    def unit(self, column: str) -> str:
        """Return the unit of a column, empty where none is known."""
        return self.units.get(column, "")

    def named(self, column: str) -> tuple[str, str]:
        """Return a column's name and unit."""
        return column, self.unit(column)

    def marks(self) -> list[tuple[str, Pen, Sequence[float]]]:
        """Return what there is to mark: its name, how it looks, its times."""
        every: list[tuple[str, Pen, Sequence[float]]] = [
            ("impacts", IMPACTS, self.impacts),
            ("comes to rest", RESTS, self.rests),
            ("events", EVENTS, self.events),
        ]
        return [(name, pen, times) for name, pen, times in every if times]

    def mark(self, axes: Axes) -> None:
        """Mark them on Axes against time, and shade what is no forecast."""
        shade(axes, self.horizon)
        for _, pen, times in self.marks():
            marks(axes, times, pen)

    def trusted(self) -> int:
        """Return how many of the rows that paths show lie before the horizon."""
        if math.isinf(self.horizon):
            return self.rows.row_count
        return int(np.searchsorted(self.rows.sampled("t"), self.horizon, side="right"))

    def time(self) -> Scale:
        """Return the scale of time, from the first row to the last."""
        return time_scale(np.array([self.rows.first("t"), self.rows.last("t")]))


def header_height(record: Record) -> float:
    """Return how much of a sheet `header` takes."""
    return 0.5 if record.note else 0.32


def header(sheet: Sheet, record: Record, subject: str, *, timed: bool = True) -> None:
    """Write the model's name, what the picture shows, and that a run is incomplete."""
    right = sheet.width - RIGHT
    sheet.text(right, 0.22, subject, ha="right", color=DIM)
    right -= text_width(subject) + GAP
    entries: list[tuple[str, Pen]] = []
    if timed:
        entries += [(name, pen) for name, pen, _ in record.marks()]
    if record.horizon < record.rows.last("t"):
        entries.append(("past the horizon", {"color": LOST, "linewidth": 6.0}))
    right -= sum(SAMPLE + text_width(name, SMALL) + GAP for name, _ in entries)
    sheet.legend(right, 0.22, entries, sheet.width)
    room = right - EDGE - GAP
    sheet.text(EDGE, 0.22, record.title, size=HEADING, bold=True, room=room)
    if record.note:
        room = sheet.width - 2 * EDGE
        sheet.text(EDGE, 0.39, record.note, size=SMALL, color=DIM, room=room)


def grouped(record: Record, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Put columns of one unit into one group where they fit, in the given order."""
    by_unit: dict[str, list[str]] = {}
    for name in names:
        by_unit.setdefault(record.unit(name), []).append(name)
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    for unit, alike in by_unit.items():
        if unit and 1 < len(alike) <= SHARING and _comparable(record, alike):
            groups.update(dict.fromkeys(alike, tuple(alike)))
    return list(dict.fromkeys(groups.values()))


def _comparable(record: Record, names: Sequence[str]) -> bool:
    scales = [value_scale(record.rows.series(name)[1], margin=0.0) for name in names]
    whole = max(s.high for s in scales) - min(s.low for s in scales)
    return min(s.high - s.low for s in scales) >= SQUEEZED * whole


def chosen(names: Sequence[str], most: int) -> list[str]:
    """Return at most so many of the names, evenly spaced, first and last included."""
    if len(names) <= most:
        return list(names)
    if most == 1:
        return [names[0]]
    return [names[k * (len(names) - 1) // (most - 1)] for k in range(most)]


class Panels:
    """A grid of panels, one for each group of columns.

    Attributes
    ----------
    total : how much of a sheet the panels take, with the time axis below.
    """

    def __init__(self, record: Record, groups: Sequence[tuple[str, ...]]) -> None:
        self._record, self._groups = record, groups
        self._columns, self._height = next(
            size for most, *size in GRIDS if len(groups) <= most
        )
        self._wide = self._columns == 1
        self._headed = [self._is_headed(group) for group in groups]
        self._gap = 0.25
        if self._wide:
            self._gap = 0.24 if any(self._headed) else 0.12
        rows = -(-len(groups) // self._columns)
        self.total = rows * (self._height + self._gap) + 0.45

    def _is_headed(self, group: tuple[str, ...]) -> bool:
        """Whether the name stands above the panel and not at its side."""
        # A power of ten may stand beside the unit.
        text = f"{group[0]} (10⁻³ {self._record.unit(group[0])})"
        beside = self._wide and text_width(text) <= self._height - 0.05
        return len(group) > 1 or not beside

    def draw(self, sheet: Sheet, top: float) -> None:
        """Draw them below `top`."""
        record = self._record
        width = (WIDTH - RIGHT - EDGE) / self._columns - NUMBERS
        left = EDGE + NUMBERS
        if self._wide:
            left, width = LEFT, WIDTH - LEFT - RIGHT
        count = len(self._groups)
        sizes: dict[str, float] = {}
        for name in (name for group in self._groups for name in group):
            unit, height = record.unit(name), height_of(record.rows.series(name)[1])
            sizes[unit] = max(sizes.get(unit, 0.0), height)
        for k, group in enumerate(self._groups):
            row, column = divmod(k, self._columns)
            x = left + column * (width + NUMBERS)
            y = top + row * (self._height + self._gap) + self._gap
            drawn = [record.rows.series(name) for name in group]
            size = sizes[record.unit(group[0])]
            scale = value_scale(*(values for _, values in drawn), size=size)
            named = (", ".join(group), record.unit(group[0]))
            above = self._headed[k] and len(group) == 1
            with sheet.panel(
                (x, y, width, self._height), record.time(), scale,
                below=record.named("t") if k + self._columns >= count else NOTHING,
                side=NOTHING if above else named,
                above=named if above else NOTHING,
                reach=REACH,
            ) as axes:  # fmt: skip
                record.mark(axes)
                shown = stems if group[0].startswith(IMPULSE) else series
                for (t, values), pen in zip(drawn, PENS, strict=False):
                    shown(axes, t, values, pen)
            if len(group) > 1:
                names = list(zip(group, PENS, strict=False))
                sheet.legend(x, y - 0.06, names, width)


def height_of(values: Array) -> float:
    """Return the greatest size among finite values; 0 where there are none."""
    low, high = extent(values) or (0.0, 0.0)
    return max(abs(low), abs(high))
