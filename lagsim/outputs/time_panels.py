"""Columns against time, in panels below and beside each other."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lagsim.outputs.curves import series, stems
from lagsim.outputs.record import LEFT, REACH, RIGHT
from lagsim.outputs.scale import extent, read_off, spread_scale, value_scale
from lagsim.outputs.sheet import (
    DIM,
    EDGE,
    NOTHING,
    PENS,
    SMALL,
    WIDTH,
    Sheet,
    text_width,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.outputs.record import Record
    from lagsim.outputs.scale import Scale
    from lagsim.outputs.sheet import Place
    from lagsim.run.observers.thinning import Array

# Inches for the numbers at the left of a small panel.
NUMBERS = 0.46

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
# So many beside each other where some are pairs, which three or five would part.
IN_PAIRS = 4


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


def in_pairs(
    groups: Sequence[tuple[str, ...]], columns: int
) -> tuple[list[tuple[str, ...]], int]:
    """Put x and y of a body side by side: an empty group is a free place.

    Give the groups, and how many stand beside each other.
    """
    firsts = {one for one, other in pairwise(groups) if _is_pair(one[0], other[0])}
    if firsts and columns > 1 and columns % 2:
        columns = IN_PAIRS
    found: list[tuple[str, ...]] = []
    for group in groups:
        if group in firsts and columns > 1 and len(found) % columns == columns - 1:
            found.append(())
        found.append(group)
    return found, columns


def _is_pair(one: str, other: str) -> bool:
    """Tell whether two names differ in an x and a y alone."""
    differ = [(a, b) for a, b in zip(one, other, strict=False) if a != b]
    return len(one) == len(other) and differ in ([("x", "y")], [("X", "Y")])


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
    gap : how much of it is above each of them.
    """

    def __init__(
        self,
        record: Record,
        groups: Sequence[tuple[str, ...]],
        least: float = 0.0,
        *,
        paired: bool = False,
    ) -> None:
        self._record, self._groups = record, groups
        self._aside = 0.0
        self._columns, self._height = next(
            size for most, *size in GRIDS if len(groups) <= most
        )
        self._wide = self._columns == 1
        self._groups, self._columns = in_pairs(groups, int(self._columns))
        groups = self._groups
        self._headed = [self._is_headed(group) for group in groups]
        if paired:  # all names in one place
            self._headed = [any(self._headed)] * len(groups)
        self.gap = 0.25
        if self._wide:
            self.gap = 0.24 if any(self._headed) else 0.12
        rows = -(-len(groups) // self._columns)
        self._height = max(self._height, least / rows - self.gap)
        self.total = rows * (self._height + self.gap) + 0.45

    @property
    def tall(self) -> float:
        """How high they are, from the frame of the first to that of the last."""
        return self.total - 0.45 - self.gap

    def leave(self, width: float) -> None:
        """Leave so much free at their right."""
        self._aside = width

    def _is_headed(self, group: tuple[str, ...]) -> bool:
        """Whether the name stands above the panel and not at its side."""
        if not group:
            return False
        # A power of ten may stand beside the unit.
        name, unit = self._record.named(group[0])
        text = f"{name} (10⁻³ {unit})"
        beside = self._wide and text_width(text) <= self._height - 0.05
        return len(group) > 1 or not beside

    @staticmethod
    def _scale(
        group: Sequence[str], drawn: Sequence[tuple[Array, Array]], size: float
    ) -> Scale:
        if group[0].startswith(IMPULSE):  # single values, each with a size of its own
            return value_scale(*(values for _, values in drawn), size=size)
        return spread_scale(*drawn, size=size)

    def draw(self, sheet: Sheet, top: float) -> None:
        """Draw them below `top`."""
        record = self._record
        width = (WIDTH - RIGHT - EDGE) / self._columns - NUMBERS
        left = EDGE + NUMBERS
        if self._wide:
            left, width = LEFT, WIDTH - LEFT - RIGHT - self._aside
        count = len(self._groups)
        sizes: dict[str, float] = {}
        for name in (name for group in self._groups for name in group):
            unit, height = record.unit(name), height_of(record.rows.series(name)[1])
            sizes[unit] = max(sizes.get(unit, 0.0), height)
        for k, group in enumerate(self._groups):
            if not group:
                continue
            row, column = divmod(k, self._columns)
            x = left + column * (width + NUMBERS)
            y = top + row * (self._height + self.gap) + self.gap
            drawn = [record.rows.series(name) for name in group]
            size = sizes[record.unit(group[0])]
            scale = self._scale(group, drawn, size)
            written = [record.letters.name(name) for name in group]
            named = (", ".join(written), record.unit(group[0]))
            above = self._headed[k] and len(group) == 1
            under = k + int(self._columns)
            is_last = under >= count or not self._groups[under]
            axes = sheet.panel(
                (x, y, width, self._height), record.time(), scale,
                below=record.named("t") if is_last else NOTHING,
                side=NOTHING if above else named,
                above=named if above else NOTHING,
                reach=REACH,
            )  # fmt: skip
            record.mark(axes)
            shown = stems if group[0].startswith(IMPULSE) else series
            for (t, values), pen in zip(drawn, PENS, strict=False):
                shown(axes, t, values, pen)
            tell(sheet, (x, y, width, self._height), scale, drawn, above=above)
            if len(group) > 1:
                names = list(zip(written, PENS, strict=False))
                sheet.legend(x, y - 0.06, names, width)


def tell(
    sheet: Sheet,
    place: Place,
    scale: Scale,
    drawn: Sequence[tuple[Array, Array]],
    *,
    above: bool = False,
) -> None:
    """Say in a panel, or above, where powers of ten begin and what is greatest."""
    if not scale.linear:
        return
    every = [np.where(np.isfinite(t + values), values, 0.0) for t, values in drawn]
    sizes = [float(np.abs(values).max(initial=0.0)) for values in every]
    k = int(np.argmax(sizes))
    at = int(np.abs(every[k]).argmax())
    t, most = drawn[k][0], read_off(float(every[k][at]))
    said = f"powers of ten beyond {read_off(scale.linear)}"
    if above:  # in a small panel it would stand across the curve
        left, top, width, _ = place
        room, x = 0.68 * width, left + width
        text = f"{most}; {said}"
        sheet.text(x, top - 0.06, text, size=SMALL, room=room, ha="right", color=DIM)
        return
    # Where the greatest value is not.
    side = "left" if t[at] - t[0] > 0.5 * (t[-1] - t[0]) else "right"
    sheet.corner(place, f"{most} at t = {read_off(t[at], 5)}; {said}", side)


def height_of(values: Array) -> float:
    """Return the greatest size among finite values; 0 where there are none."""
    low, high = extent(values) or (0.0, 0.0)
    return max(abs(low), abs(high))
