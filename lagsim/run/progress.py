"""The end of a run whose arcs leave no time for the motion.

Histories of events detect accumulations of switches, impacts and acts (`accumulation`).
Arcs may also end without any event, where a condition is located that is then found to
be false. Therefore arcs without length are counted here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.methods.parts import state as at
from lagsim.run.trajectory import Ending, Outcome, quoted
from lagsim.tolerances import SAME_INSTANT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.run.arc import Arc

# Number of arcs in a row after which a run ends if, on average, they are no longer than
# an instant.
MOST_ARCS = 400


class Progress:
    """The arcs that have ended within a time too short for a motion."""

    def __init__(self) -> None:
        self._since = -math.inf  # the end of the first of these arcs
        self._ended: list[tuple[int, int]] = []  # return codes, and event functions

    def ending(self, arc: Arc, code: int) -> Ending | None:
        """Count the arc that has ended; return the ending of the run, or None.

        code : the kernel's return code.
        """
        settings, state = arc.settings, arc.state
        span = max(settings.duration, abs(settings.start), abs(arc.t))
        if not arc.t - self._since <= MOST_ARCS * SAME_INSTANT * span:
            self._since, self._ended = arc.t, []
        number = state.event if code == at.EVENT_FOUND else state.switched
        self._ended.append((code, int(number) - 1))
        if len(self._ended) < MOST_ARCS:
            return None
        events = all(code == at.EVENT_FOUND for code, _ in self._ended)
        outcome = Outcome.EVENTS_CHATTER if events else Outcome.SWITCHES_ACCUMULATE
        return Ending(outcome, quoted(self._names(arc)) or "of t")

    def _names(self, arc: Arc) -> Iterator[str]:
        """Yield the names of the events, switches and laws at which the arcs ended."""
        system = arc.system
        events = [x.name for x in arc.equations.model.events if x.at is not None]
        switches = [side.text for side in system.switches.sides]
        switches += [law.name for law in system.laws]
        for code, k in dict.fromkeys(self._ended):
            if code == at.EVENT_FOUND:
                yield [*events, "until"][k]
            elif code == at.SWITCH_FOUND:
                yield switches[k]
