"""Instants: identification of nearly equal times, and their common representative.

Times within 4 units in the last place (`SAME_INSTANT`) are one instant: times of
periodic events, of strobes, of breaks, of located events and of output rows. The time
of an instant is the time of an output row, if a row lies within the instant, else the
first of its times in the order of the file. The time of a located event is known to the
rounding of its condition; within it, the event belongs to the instant of a periodic
event, or of a located event with a smaller rounding (`truth.wait`). All events of an
instant are dated with this one double, which rows, lists and `result.at` report.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.tolerances import SAME_INSTANT, SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.model.model import Settings


def width(settings: Settings, time: float) -> float:
    """Return the largest difference between `time` and another time of its instant.

    settings : the settings of the run, which define the size of an instant.
    """
    return SAME_INSTANT * max(abs(time), abs(settings.start))


def is_same(settings: Settings, time: float, other: float) -> bool:
    """Whether two times belong to one instant: they differ by at most `width`.

    settings : the settings of the run.
    """
    size = max(abs(time), abs(other), abs(settings.start))
    return abs(other - time) <= SAME_INSTANT * size


def row_near(settings: Settings, time: float) -> float:
    """Return the output time closest to `time`, the end of the run included.

    settings : the settings of the run, which define the output times.
    """
    start, step, end = settings.start, settings.output_step, settings.end
    row = start + max(math.floor((time - start) / step + 0.5), 0) * step
    row = row if row < end - SAME_STEP * step else end
    return min((end, row), key=lambda x: abs(x - time))


def instant(settings: Settings, times: Iterable[float]) -> float:
    """Return the time of the instant to which the earliest of `times` belongs.

    Parameters
    ----------
    times
        Candidate times in the order of the file; inf for an event that never occurs
        again. The result is inf if all times are.
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
