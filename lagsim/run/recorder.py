"""What a run says on its way, and where its rows go."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Choice, Event
    from lagsim.run.decisions import Decision
    from lagsim.run.observers import Observer

# A switch or a dead point may be passed for ever: of such events so many are kept.
MOST_EVENTS = 10_000
# So many of the last of them show where they come from, and how fast.
LATELY = 1000


class Recorder:
    """Keeps events, cautions and choices, and hands rows on.

    Attributes
    ----------
    rows : int
        Handed on so far.
    last : float
        The time of the last of them.
    counts, unkept : dict
        How many events there were of each kind, and how many of them are not kept.
    full : float
        The time of the first that is not kept.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        self.observers = observers
        self.events: list[Event] = []
        self.cautions: list[Caution] = []
        self.choices: list[Choice] = []
        self.counts: dict[str, int] = {}
        self.unkept: dict[str, int] = {}
        self.full = math.inf
        self.rows = 0
        self.last = math.nan

    def keep(self, decision: Decision) -> None:
        """Keep what a decision says."""
        for event in decision.events:
            kind = event.kind
            self.counts[kind] = self.counts.get(kind, 0) + 1
            often = event.switch is not None or event.constraint is not None
            if not often or len(self.events) < MOST_EVENTS:
                self.events.append(event)
            else:
                self.unkept[kind] = self.unkept.get(kind, 0) + 1
                self.full = min(self.full, event.time)
        self.cautions += decision.cautions
        self.choices += decision.choices

    def unlisted(self) -> list[Caution]:
        """Say how many events were too many to be kept."""
        if not self.unkept:
            return []
        kinds = ", ".join(f"{count} of kind {k}" for k, count in self.unkept.items())
        late = [e for e in self.events if e.constraint or e.switch][-LATELY:]
        where, often = Counter(e.constraint or e.switch for e in late).most_common(1)[0]
        text = (
            f"only the first {MOST_EVENTS} events are listed: from t = {self.full:.9g} "
            f"on there were {kinds} more; {often} of the last {len(late)} listed are "
            f"at `{where}`, within {self.full - late[0].time:.3g} of time"
        )
        return [Caution("events-unlisted", text)]

    def hand_on(self, rows: Floats) -> None:
        """Hand rows of columns on."""
        count = len(rows)
        if not count:
            return
        self.rows += count
        self.last = float(rows[-1, 0])
        for observer in self.observers:
            observer.add(rows)
