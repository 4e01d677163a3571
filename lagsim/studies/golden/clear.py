"""Which rows of a motion can be compared with those of another run of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.studies.golden.motion import befores, paired
from lagsim.studies.moved import moved, partners

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.studies.golden.motion import Motion

# Rows this close to an event, as a part of the spacing, may lie on either side of it;
# so may those within so many times what the variants move it by.
NEAR_EVENT = 1e-3
TIMES_MOVED = 10.0
# Impacts that are kept, at most: those that are at least so far from other events, in
# what may lie on either side.
MOST_IMPACTS = 6
ALONE = 4.0
# Events that are this close, as a part of the spacing, happen at once.
AT_ONCE = 1e-9


def clear(base: Motion, others: Sequence[Motion], spacing: float) -> list[int]:
    """Give the rows that are clear of events, the first, the last, and impacts.

    Of these some, evenly: both rows of each. They have times of their own, which other
    runs move.
    """
    t = base.rows[:, 0]
    events = [e for e in base.trajectory.events if e.kind != "until"]
    times = np.unique([e.time for e in events])
    reach = np.full(len(times), NEAR_EVENT * spacing)
    common = t[befores(t)]
    for other in others:
        pairs = moved(events, other.trajectory.events)
        late = np.minimum(TIMES_MOVED * np.abs(pairs[:, 1] - pairs[:, 0]), spacing)
        np.maximum.at(reach, np.searchsorted(times, pairs[:, 0]), late)
        theirs = other.rows[befores(other.rows[:, 0]), 0]
        common = partners(common, theirs)[:, 0]
    ends = np.isin(np.arange(len(t)), (0, len(t) - 1))
    kept = ends | ~(_reached(t, times, reach) | paired(t))
    first = np.flatnonzero(befores(t) & np.isin(t, common))
    apart = AT_ONCE * spacing
    alone = [
        k
        for k in first
        if not np.any(
            (np.abs(times - t[k]) > apart) & (np.abs(times - t[k]) <= ALONE * reach)
        )
    ]
    for k in np.linspace(0, len(alone) - 1, min(MOST_IMPACTS, len(alone))):
        kept[alone[round(k)] : alone[round(k)] + 2] = True
    return [int(k) for k in np.flatnonzero(kept)]


def _reached(t: Floats, times: Floats, reach: Floats) -> Flags:
    """Tell which times (k,) are within the reach of an event."""
    found = np.zeros(len(t), bool)
    for time, near in zip(times, reach, strict=True):
        found |= np.abs(t - time) <= near
    return found
