"""Breaks in time, as a source of arcs: the branch of each switch is fixed in one."""

from __future__ import annotations

from itertools import islice
from math import inf
from typing import TYPE_CHECKING

from lagsim.methods.parts import state as at
from lagsim.notes import Event
from lagsim.run.decisions import GO_ON, Decision, Ending, Source, Turn
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.run.arc import Arc


# Breaks accumulate if, after FEWEST, windows of so many get shorter so fast that all
# that follow would take less than this part of the time since the first.
WINDOW, FEWEST, SHORT = 250, 1000, 1e-3


class TimeBreaks(Source):
    """The breaks in time of a run."""

    DERIVED = ("_times",)

    def __init__(self, arc: Arc) -> None:
        self._arc = arc
        self._taken = 0
        self._marks: list[float] = []  # the first break, and the last of each window
        self._times: Iterator[float] | None = None
        self._next = self._following()

    def _following(self) -> float:
        """Give the next break; inf after the last."""
        if self._times is None:
            self._times = islice(_breaks(self._arc), self._taken, None)
        self._taken += 1
        return next(self._times, inf)

    def begin(self, arc: Arc) -> Decision:
        """Set the branches up to the next break."""
        switches = arc.system.switches
        if switches.modes:
            end = min(self._next, arc.settings.end)
            arc.system.set_modes(switches.mode_values(arc.t, end, arc.parameters))
        arc.runner.prepare()
        return GO_ON

    def limit(self, arc: Arc) -> float:  # noqa: ARG002
        """Give the next break."""
        return self._next

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go through a break that has been reached."""
        if code != at.DONE or arc.t < self._next:
            return None
        if self._taken == 1 or self._taken % WINDOW == 0:
            self._marks.append(arc.t)
        ending = None
        if self._accumulate():
            ending = Ending(Outcome.SWITCHES_ACCUMULATE, "in time")
        self._next = self._following()
        switch = (Event(arc.t, "switch"),)
        return Decision(events=switch, turn=Turn.MODES, ending=ending)

    def _accumulate(self) -> bool:
        """Tell whether breaks come ever faster towards a time that is near."""
        if self._taken < FEWEST or self._taken % WINDOW:
            return False
        *_, a, b, c = self._marks
        former, last = b - a, c - b
        since = c - self._marks[0]
        return last * last < SHORT * since * (former - last)


def _breaks(arc: Arc) -> Iterator[float]:
    modes = arc.system.switches.modes
    if not modes:
        return iter(())
    from lagsim.run.events.breaks import break_times

    settings = arc.settings
    return break_times(
        arc.equations.graph,
        [mode.discrete for mode in modes],
        arc.parameters,
        settings.start,
        settings.end,
    )
