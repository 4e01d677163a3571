"""Events of the file, which set modes: at located conditions, or every period.

Modes are words of the parameters, constant in an arc. At an event the arc ends, the
modes are set, and another begins. All that is due at one instant acts in the order of
the file; what becomes true by that acts next, at the same time, until nothing does.
Then all sources set their own modes and impacts take place, by which conditions may
become true (`conditions`): they act, and so on. Events that lead to modes that there
have been at the same instant, by the same state, lead nowhere: that ends the run.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from lagsim.notes import Event
from lagsim.run.events.conditions import Truth
from lagsim.run.events.sequence import STUCK, Sequence
from lagsim.run.instants import width
from lagsim.run.trajectory import Decision, Ending, Outcome, Source, quoted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.run.arc import Arc

# An event that acts time and again (`sequence.STUCK`), on the average within this part
# of a run, does not end.
HARDLY = 1e-12
# So often one event acts at one instant at most, by modes that are always others.
MOST_ACTS = 1000


class Due(NamedTuple):
    """Numbers of periodic events, and of conditions, whose time has come."""

    periodic: frozenset[int] = frozenset()
    conditions: frozenset[int] = frozenset()


NOTHING = Due()


class Transitions(Source):
    """The events of a run, and `until`.

    Attributes
    ----------
    next : list of int
        The number of the next act of each that is periodic; -1 where none follows.
    rounds : list of (list of str, dict)
        The rounds at the last instant since the state jumped: names of the located
        events that acted together, and the modes before them.
    is_over : bool
        Whether `until` has come true.
    """

    DERIVED = ("_truth",)

    def __init__(self, arc: Arc) -> None:
        events, settings = arc.equations.model.events, arc.settings
        self.next = [1 if x.at is None and not x.once else -1 for x in events]
        self.periodic = [k for k, number in enumerate(self.next) if number > 0]
        self.event_of = [k for k, x in enumerate(events) if x.at is not None]
        self.rounds: list[tuple[list[str], dict[str, float]]] = []
        self.acts = [0] * len(events)  # of each, at the last instant
        self.time = math.nan  # of that
        self.sequences = [Sequence(settings.start, settings.duration) for _ in events]
        self.begun = self.is_over = False
        self.energetic = arc.system.equations.is_set
        self._truth: Truth | None = None
        nodes = [x.node for x in arc.equations.model.located]
        modes = {mode for x in events for mode, _ in x.sets}
        self.set_by_modes = bool(modes & arc.equations.graph.depends(nodes))

    def begin(self, arc: Arc) -> Decision:
        """List the events that have acted at the start, before the first row."""
        if self.begun:
            return Decision()
        self.begun = True
        begun = arc.equations.begun_by
        events, state = arc.equations.model.events, arc.state
        located = [x.name for x in events if x.at is not None]
        for name in begun.acts:
            once = any(x.once for x in events if x.name == name)
            if once and name in located:
                state.leeway[located.index(name)] = math.inf
        acts = tuple(Event(arc.t, "event", name=name) for name in begun.acts)
        ending = Ending(Outcome.UNTIL) if begun.is_over else None
        if begun.chatter:
            ending = Ending(Outcome.EVENTS_CHATTER, quoted(begun.chatter))
        return Decision(acts, ending=ending)

    def look_at_start(self, arc: Arc) -> None:
        """Decide which conditions are true at the start, once all modes are set."""
        if len(arc.state.orientation):
            Truth(arc).begin()

    def times(self, arc: Arc) -> Iterator[float]:
        """Return the times of the next acts of periodic events."""
        return (self._time(arc, k) for k in self.periodic)

    def _time(self, arc: Arc, k: int) -> float:
        """Time of the next act of a periodic event."""
        return arc.settings.start + self.next[k] * arc.equations.model.events[k].every

    def due(self, arc: Arc) -> Due:
        """Return what is due at an instant by the state just before it."""
        soon = arc.t + width(arc.settings, arc.t)
        periodic = frozenset(k for k in self.periodic if self._time(arc, k) <= soon)
        if not len(arc.state.orientation):
            return Due(periodic)
        found = int(arc.state.event) - 1
        self._truth = Truth(arc, found, set_by_modes=self.set_by_modes)
        return Due(periodic, frozenset(self._truth.met()))

    def due_after(self, arc: Arc, *, struck: bool) -> Due:
        """Return what is due by the state just after all that has happened.

        struck : velocities have jumped, so that it is another state.
        """
        if struck:
            self.rounds.clear()
        if not len(arc.state.orientation):
            return NOTHING
        truth = self._truth or Truth(arc, set_by_modes=self.set_by_modes)
        found = truth.settled(struck=struck)
        self._truth = truth if found else None
        return Due(conditions=frozenset(found))

    def act(self, arc: Arc, due: Due) -> Decision:
        """Let events act until none is due: periodic ones, and those of conditions."""
        if arc.t != self.time:
            self.time, self.acts = arc.t, [0] * len(self.acts)
            self.rounds.clear()
        events = arc.equations.model.events
        event_of = self.event_of
        y = arc.y.copy()
        before = arc.energies(y) if self.energetic else None
        found: list[Event] = []
        ending: Ending | None = None
        while due != NOTHING and ending is None:
            self.is_over |= len(event_of) in due.conditions
            own = {event_of[c]: c for c in due.conditions if c < len(event_of)}
            if self._truth is not None:
                once = [c for k, c in own.items() if events[k].once]
                self._truth.hold(due.conditions, for_ever=once)
            self.rounds.append(([events[k].name for k in sorted(own)], arc.modes))
            for k in sorted(due.periodic.union(own)):
                found.append(Event(arc.t, "event", name=events[k].name))
                ending = ending or self._set(arc, k)
            ending = ending or self._undone(arc)
            due = NOTHING
            if found and self._truth is not None:
                due = Due(conditions=frozenset(self._truth.changed()))
        if before is not None:
            arc.add_work(y, before)
        return Decision(
            tuple(found), y=y if before is not None else None, ending=ending
        )

    def _set(self, arc: Arc, k: int) -> Ending | None:
        """Let one event set its modes; tell how the run ends if it does by that."""
        events = arc.equations.model.events
        event, first = events[k], sum(len(x.sets) for x in events[:k])
        every = sum(len(x.sets) for x in events)
        values = arc.runner.function("sets", every)(arc.t, arc.y)[first:].tolist()
        ending = None
        for (mode, _), value in zip(event.sets, values, strict=False):
            arc.system.p.flat[arc.system.place(mode)] = value
            if not math.isfinite(value):
                about = f": `{mode}` in the event `{event.name}`"
                ending = Ending(Outcome.NOT_FINITE, about)
        arc.runner.prepare()
        if event.at is None:
            self.next[k] += 1
            return ending
        return ending or self._chatters(arc, k)

    def _undone(self, arc: Arc) -> Ending | None:
        """End the run where a round restores modes from before an earlier round.

        Its events undo others without time passing. Events of one round may restore a
        mode together: all were due at once, and none follows from another.
        """
        *earlier, (_, before) = self.rounds
        seen = [modes for _, modes in earlier]
        if arc.modes == before or arc.modes not in seen:
            return None
        cycle = self.rounds[seen.index(arc.modes) :]
        about = quoted(name for names, _ in cycle for name in names)
        return Ending(Outcome.EVENTS_CHATTER, about)

    def _chatters(self, arc: Arc, k: int) -> Ending | None:
        """End the run where an event acts ever again in hardly any time."""
        self.acts[k] += 1
        if self.acts[k] == 1:
            self.sequences[k].add(arc.t, k)
        if self.acts[k] <= MOST_ACTS and not self.sequences[k].is_stuck(STUCK * HARDLY):
            return None
        names = [name for names, _ in self.rounds for name in names]
        return Ending(Outcome.EVENTS_CHATTER, quoted(names))
