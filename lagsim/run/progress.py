"""The end of a run whose arcs leave no time for the motion.

Histories of events detect accumulations of switches and impacts (`accumulation`). Arcs
may also end at ever new events without a limit, or without any event, where a condition
is located that is then found to be false. Therefore the ends of all arcs are stored
here, with their times.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from lagsim.methods.parts import state as at
from lagsim.run.trajectory import Ending, Outcome, quoted
from lagsim.tolerances import SAME_INSTANT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from lagsim.run.arc import Arc

# Number of arcs in a row after which a run ends if, on average, they are no longer than
# an instant.
MOST_ARCS = 400
# Number of arcs that end at one event function after which a run ends if their ends are
# apart, on average, by no more than an instant, or by the part HURRIES of the duration.
# Intervals of which the last is more than the part GROWS of the sum leave the instant:
# where a surface is met at rounding of its level, each is some 30 times the one before.
MOST_ENDS, HURRIES, GROWS = 40, 1e-12, 0.25


class Progress:
    """The ends of the last arcs: their times, and their codes and event functions."""

    def __init__(self) -> None:
        self._ends: deque[tuple[float, int, int]] = deque(maxlen=MOST_ARCS)
        self._own: dict[tuple[int, int], deque[float]] = {}  # times, by event function

    def ending(self, arc: Arc, code: int) -> Ending | None:
        """Store the end of an arc; return the ending of the run, or None.

        code : the kernel's return code.
        """
        since = self._stuck_since(arc, code)
        if since is None:
            return None
        ends = sorted({(code, k) for t, code, k in self._ends if t >= since})
        events = all(code == at.EVENT_FOUND for code, _ in ends)
        outcome = Outcome.EVENTS_CHATTER if events else Outcome.SWITCHES_ACCUMULATE
        return Ending(outcome, quoted(_names(arc, ends)) or "of t")

    def _stuck_since(self, arc: Arc, code: int) -> float | None:
        """Store the end of an arc; return the time since which arcs are too short."""
        state, t = arc.state, arc.t
        number = state.event if code == at.EVENT_FOUND else state.switched
        end = code, int(number) - 1
        own = self._own.get(end)
        if own is None:
            own = self._own[end] = deque(maxlen=MOST_ENDS)
        own.append(t)
        self._ends.append((t, *end))
        is_own_long = len(own) == MOST_ENDS and code != at.DONE
        is_long = len(self._ends) == MOST_ARCS
        if not is_long and not is_own_long:
            return None
        settings, first = arc.settings, self._ends[0][0]
        least = SAME_INSTANT * max(settings.duration, abs(settings.start), abs(t))
        if is_long and t - first <= MOST_ARCS * least:
            return first
        if not is_own_long:
            return None
        least = max(least, HURRIES * settings.duration)
        took = t - own[0]
        is_stuck = took <= MOST_ENDS * least and t - own[-2] <= GROWS * took
        return own[0] if is_stuck else None


def _names(arc: Arc, ends: Iterable[tuple[int, int]]) -> Iterator[str]:
    """Yield the names of events, switches and laws, by codes and event functions."""
    system = arc.system
    events = [x.name for x in arc.equations.model.events if x.at is not None]
    switches = [side.text for side in system.switches.sides]
    switches += [law.name for law in system.laws]
    for code, k in ends:
        if code == at.EVENT_FOUND:
            yield [*events, "until"][k]
        elif code == at.SWITCH_FOUND:
            yield switches[k]
