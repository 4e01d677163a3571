"""Rows at events between output times, so that pictures cut no corners.

What a column does at a switch, its kink or its jump, lies between rows of the table.
Pictures show the two that an event itself has, just before it and just after.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Where there are more, corners lie too close to be seen, and cost more than the table.
MOST = 500


class Corners:
    """Keeps the first rows at events, in some ways each.

    On the very surface of a switch an expression may have a value of its own, as sign
    at 0: so that a row is told also for states a little aside, to either side. Of these
    ways the one is right that goes on from the rows beside the event.

    Attributes
    ----------
    events : list of pair of ndarray
        Just before and just after each event: (ways, columns).
    """

    def __init__(self) -> None:
        self.events: list[tuple[Floats, Floats]] = []

    def __bool__(self) -> bool:
        """Whether more are wanted."""
        return len(self.events) < MOST

    def add(self, before: Floats, after: Floats) -> None:
        """Take the rows at an event; at one time, the first and the last count."""
        if self.events and self.events[-1][0][0, 0] == after[0, 0]:
            before, _ = self.events.pop()
        self.events.append((before, after))

    def rows(self) -> Floats:
        """Return the rows in order of time: (2 k, ways, columns)."""
        return np.array([row for event in self.events for row in event])
