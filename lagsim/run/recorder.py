"""What a run says on its way, and where its rows go."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution, Choice, Event
    from lagsim.run.decisions import Decision
    from lagsim.run.observers import Observer

# A switch or a dead point may be passed for ever: of such events so many are kept.
MOST_EVENTS = 10_000


class Recorder:
    """Keeps events, cautions and choices, and hands rows on.

    Attributes
    ----------
    rows : int
        Handed on so far.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        self.observers = observers
        self.events: list[Event] = []
        self.cautions: list[Caution] = []
        self.choices: list[Choice] = []
        self.rows = 0

    def keep(self, decision: Decision) -> None:
        """Keep what a decision says."""
        for event in decision.events:
            often = event.switch is not None or event.constraint is not None
            if not often or len(self.events) < MOST_EVENTS:
                self.events.append(event)
        self.cautions += decision.cautions
        self.choices += decision.choices

    def hand_on(self, rows: Floats) -> None:
        """Hand rows of columns on."""
        self.rows += len(rows)
        for observer in self.observers:
            observer.add(rows)
