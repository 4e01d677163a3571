"""Instants: which times are one, and the one time that they all get.

Times within 4 units in the last place (`SAME_INSTANT`) are one instant: those of
periodic events, of strobes, of breaks, those located, and the times of rows. Its time
is that of a row, where one is that close, else that of the first of them in the order
of the file. All that happens at an instant happens at this one double, and rows, lists
and `result.at` show it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.tolerances import SAME_INSTANT, SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.model.model import Settings


def width(settings: Settings, time: float) -> float:
    """Return the largest difference of a time from another that is the same instant."""
    return SAME_INSTANT * max(abs(time), abs(settings.start))


def is_same(settings: Settings, time: float, other: float) -> bool:
    """Whether two times are one instant."""
    size = max(abs(time), abs(other), abs(settings.start))
    return abs(other - time) <= SAME_INSTANT * size


def row_near(settings: Settings, time: float) -> float:
    """Return the time of the row that is closest to a time, of the end too."""
    start, step, end = settings.start, settings.output_step, settings.end
    row = start + max(math.floor((time - start) / step + 0.5), 0) * step
    row = row if row < end - SAME_STEP * step else end
    return min((end, row), key=lambda x: abs(x - time))


def instant(settings: Settings, times: Iterable[float]) -> float:
    """Return the time of the instant that the earliest of some times belongs to.

    Parameters
    ----------
    times
        In the order of the file; inf where nothing follows.
    """
    found = [time for time in times if time < math.inf]
    if not found:
        return math.inf
    first = min(found)
    one = [x for x in found if x == first or is_same(settings, first, x)]
    for time in one:
        row = row_near(settings, time)
        if is_same(settings, time, row):
            return row
    return one[0]
