"""Events of the file, which set modes and give impulses.

They act at located conditions, or every period. Modes of the file are constant in an
arc. At an event the arc ends, the modes are set, and the next arc begins. All events
due at one instant act in the order of the file; then the sum of their impulses, each
evaluated with the velocities before, changes the velocities (`impulses`).
Events whose conditions become true by these acts follow at the same instant, until no
further condition becomes true. Then all sources set their own modes and impacts take
place, by which conditions may become true (`conditions`): their events act, and the
cycle repeats (`settle`). Where events restore modes that were in force earlier at the
same instant, with the same state, the cycle has no end, and the run ends.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lagsim.notes import Event
from lagsim.run.events.accumulation import Accumulation
from lagsim.run.events.conditions import Truth
from lagsim.run.events.impulses import data_at, kick
from lagsim.run.events.records import NOTHING, ActsAt, Due
from lagsim.run.instants import width
from lagsim.run.trajectory import Decision, Ending, Outcome, Source, quoted
from lagsim.tolerances import SOLUTION_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc
    from lagsim.run.events.corner_sides import CornerSides
    from lagsim.run.events.records import Round
    from lagsim.run.trajectory import JumpImpulses

# Largest number of acts of one event at one instant, each with other modes.
MOST_ACTS = 1000


NONE = frozenset[int]()


class Transitions(Source):
    """The source of the events of a run and of its end by `until`.

    Attributes
    ----------
    next : list of int
        The number of the next act of each periodic event; -1 for all other events.
    periodic, event_of : list of int
        The indices of periodic events; the index of the event of each condition.
    sequence : Accumulation
        The last acts of each event, by which chatter is found.
    energetic, set_by_modes, kicks : bool
        Whether energies depend on modes that events set; whether conditions do; whether
        events give impulses.
    """

    def __init__(self, arc: Arc) -> None:
        events, settings = arc.equations.model.events, arc.settings
        self.next = [1 if x.at is None and not x.once else -1 for x in events]
        self.periodic = [k for k, number in enumerate(self.next) if number > 0]
        self.event_of = [k for k, x in enumerate(events) if x.at is not None]
        self.sequence = Accumulation(settings.start, settings.duration)
        self.energetic = arc.system.equations.is_set
        self.kicks = arc.equations.model.kicks
        nodes = [x.node for x in arc.equations.model.located]
        modes = {mode for x in events for mode, _ in x.sets}
        self.set_by_modes = bool(modes & arc.equations.graph.depends(nodes))

    def start(self, arc: Arc, corners: CornerSides | None) -> Decision:
        """Return the decision with the events that acted at the start.

        These events acted before the first row; the first arc has their modes. The
        impulses of these events are applied here.

        corners : see `act`.
        """
        begun = arc.equations.begun_by
        events = arc.equations.model.events
        located = [x.name for x in events if x.at is not None]
        for name in begun.acts:
            once = any(x.once for x in events if x.name == name)
            if once and name in located:
                arc.state.leeway[located.index(name)] = math.inf
        acts = tuple(Event(arc.t, "event", name=name) for name in begun.acts)
        y = rows = given = None
        if begun.impulses:
            rows = arc.runner.tabulate(arc.row())
            y, given, energy = self._after_impulse(
                arc, np.array(begun.impulses), corners
            )
            kicks = {x.name for x in events if x.impulses}
            acts = tuple(_with_energy(x, energy, kicks) for x in acts)
        ending = Ending(Outcome.UNTIL) if begun.is_over else None
        if begun.chatter:
            ending = Ending(Outcome.EVENTS_CHATTER, quoted(begun.chatter))
        return Decision(acts, y=y, rows=rows, impulses=given, ending=ending)

    def _truth(self, arc: Arc) -> Truth:
        """Return the decisions of the truth of the conditions."""
        return Truth(arc, set_by_modes=self.set_by_modes)

    def decide_at_start(self, arc: Arc, before: Floats | None) -> Due:
        """Decide which conditions are true at the start, after all modes are set.

        Return the conditions that become true there, see
        `conditions.Truth.become_at_start`.

        before : the values of the conditions before the impacts at the start, or None
            without impacts.
        """
        if not len(arc.state.orientation):
            return NOTHING
        truth = self._truth(arc)
        truth.begin()
        found = truth.become_at_start(before)
        return Due(conditions=frozenset(found)) if found else NOTHING

    def times(self, arc: Arc) -> Iterator[float]:
        """Return the times of the next acts of periodic events."""
        return (self._time(arc, k) for k in self.periodic)

    def _time(self, arc: Arc, k: int) -> float:
        """Return the time of the next act of periodic event k."""
        return arc.settings.start + self.next[k] * arc.equations.model.events[k].every

    def due(self, arc: Arc, comes_to_rest: Callable[[Arc], bool]) -> Due:
        """Return the events that are due at the state just before the instant.

        comes_to_rest : function of the arc, whether a law or a surface may hold a rate
            at 0 from then on, so that `if(x_dot < 0, 1, 0)` stays 0.
        """
        limit = arc.t + width(arc.settings, arc.t)
        periodic = frozenset(k for k in self.periodic if self._time(arc, k) <= limit)
        if not len(arc.state.orientation):
            return Due(periodic)
        truth = self._truth(arc)
        truth.decide_before(int(arc.state.event) - 1)
        satisfied = frozenset(truth.satisfied())
        # A rate that ends at 0 may be past 0 by rounding.
        waiting = truth.jumped([*satisfied, *truth.falsified()])
        if not waiting or not comes_to_rest(arc):
            return Due(periodic, satisfied)
        truth.wait(waiting)
        return Due(periodic, satisfied - waiting, True)

    def due_after(self, arc: Arc, *, struck: bool, stored_truth: bool) -> Due:
        """Return the events that are due at the state after all acts.

        struck : whether velocities have jumped since the conditions were decided.
        stored_truth : whether the truth of the conditions just before the instant is
            stored; if not, it is evaluated here.
        """
        if not len(arc.state.orientation):
            return NOTHING
        truth = self._truth(arc)
        if not stored_truth:
            truth.decide_before()
        found = truth.settled(struck=struck)
        return Due(conditions=frozenset(found)) if found else NOTHING

    def act(
        self, arc: Arc, due: Due, acts: ActsAt, corners: CornerSides | None
    ) -> tuple[Decision, ActsAt]:
        """Execute the events that are due, and events that become due by their acts.

        The decision returned contains the events, the state where its work integrals
        may have changed, and the ending of the run if an act causes one.

        Parameters
        ----------
        arc : Arc
            The arc that has ended; its modes of the file are set in the memory.
        due : Due
            The events that are due.
        acts : ActsAt
            The events that have acted at this instant.
        corners : CornerSides or None
            The corners of equalities in which the motion rests.
        """
        acts = acts if acts.counts else acts._replace(counts=(0,) * len(self.next))
        events = arc.equations.model.events
        event_of = self.event_of
        y = arc.y.copy()
        rows = arc.runner.tabulate(arc.row()) if self.kicks else None
        before = arc.energies(y) if self.energetic else None
        found: list[Event] = []
        acts, ending = self._returned(arc, due, acts)
        is_over, counts, rounds = acts.is_over, list(acts.counts), list(acts.rounds)
        impulse = np.zeros(len(arc.equations.q))
        truth = self._truth(arc)
        while due != NOTHING and ending is None:
            is_over |= len(event_of) in due.conditions
            own = {event_of[c]: c for c in due.conditions if c < len(event_of)}
            if due.conditions:
                once = [c for k, c in own.items() if events[k].once]
                truth.mark_true(for_ever=once)
            names = tuple(events[k].name for k in sorted(own))
            rounds.append((names, arc.modes, y[arc.velocities]))
            for k in sorted(due.periodic.union(own)):
                found.append(Event(arc.t, "event", name=events[k].name))
                if events[k].impulses:
                    more, failed = _impulse(arc, k)
                    impulse, ending = impulse + more, ending or failed
                ending = ending or self._set(arc, k)
                counts[k] += 1
                if self._chatters(arc, k, counts[k]):
                    ending = ending or _endless_ending(acts.visits or rounds)
            if due.periodic or any(events[k].once for k in own):
                # These events act once at an instant, so no cycle contains this round.
                rounds.clear()
            else:
                ending = ending or _cycle_ending(arc, rounds)
            due = NOTHING
            if found:
                due = Due(conditions=frozenset(truth.changed()))
        if before is not None:
            arc.add_work(y, before)
        kicks = ending is None and self.kicks and bool(impulse.any())
        given: JumpImpulses | None = None
        if kicks:
            y, given, energy = self._after_impulse(arc, impulse, corners, y)
            kicking = {x.name for x in events if x.impulses}
            found = [_with_energy(x, energy, kicking) for x in found]
        changed = kicks or before is not None
        decision = Decision(
            tuple(found), y=y if changed else None, rows=rows if kicks else None,
            impulses=given, ending=ending,
        )  # fmt: skip
        after = ActsAt(tuple(counts), tuple(rounds), acts.visits, is_over)
        return decision, after

    def _returned(
        self, arc: Arc, due: Due, acts: ActsAt
    ) -> tuple[ActsAt, Ending | None]:
        """Return the acts with this visit added, and the ending of a cycle, or None.

        A cycle: the impulses lead back to the modes and the velocities before an
        earlier round of the instant, with the same events. In a model without impulses
        the acts are returned unchanged.

        due : the events that act next.
        """
        if not self.kicks:
            return acts, None
        events = arc.equations.model.events
        own = [self.event_of[c] for c in due.conditions if c < len(self.event_of)]
        if due.periodic or any(events[k].once for k in own):
            return acts._replace(visits=()), None
        names, v = tuple(events[k].name for k in sorted(own)), arc.y[arc.velocities]
        least = SOLUTION_ROUNDOFF * arc.magnitudes[arc.velocities]
        earlier, now = acts.visits, (names, arc.modes, v.copy())
        for k, (some, modes, w) in enumerate(earlier):
            if some == names and modes == now[1] and (np.abs(w - v) <= least).all():
                return acts, _endless_ending(earlier[k:])
        return acts._replace(visits=(*earlier, now)), None

    def _after_impulse(
        self, arc: Arc, impulse: Floats, corners: CornerSides | None,
        y: Floats | None = None,
    ) -> tuple[Floats, JumpImpulses, float]:  # fmt: skip
        """Return the state after an impulse, the impulses of rows, and the work done.

        The work is the energy that the impulse adds to the model. The state returned
        includes it.

        Parameters
        ----------
        arc : Arc
            The arc that the impulse ends.
        impulse : ndarray, shape (n,)
            The sum of the generalized impulses, for all coordinates of the model.
        corners : CornerSides or None
            The corners of equalities in which the motion rests.
        y : ndarray, shape (size,), optional
            The state before; by default that of the arc.
        """
        before = arc.y.copy() if y is None else y
        after, given = kick(arc, before, impulse)
        if corners is not None and corners.corners:

            def jump(stopped: frozenset[int]) -> Floats:
                nonlocal given
                y, given = kick(arc, before, impulse)
                corners.project(y, stopped)
                return y

            after = corners.after(jump)
        energy = float(arc.add_work(after, arc.energies(before)).sum())
        return after, given, energy

    def _set(self, arc: Arc, k: int) -> Ending | None:
        """Set the modes of the file that event k assigns.

        Return the ending of the run if a value assigned is not finite, else None.
        """
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

    def _chatters(self, arc: Arc, k: int, count: int) -> bool:
        """Whether located event k acts too often in negligible time.

        count : the number of its acts at this instant.
        """
        if arc.equations.model.events[k].at is None:
            return False
        if count == 1:
            self.sequence.add(arc.t, k)
        return count > MOST_ACTS or self.sequence.is_too_frequent(k)


def _cycle_ending(arc: Arc, rounds: Sequence[Round]) -> Ending | None:
    """Return the ending of a run whose last round restores modes of an earlier one.

    None if it does not. The events of these rounds undo each other at one instant.
    Within one round events may restore modes: all were due together, and none follows
    from another.
    """
    *earlier, (_, before, _) = rounds
    earlier_modes, now = [modes for _, modes, _ in earlier], arc.modes
    if now == before or now not in earlier_modes:
        return None
    return _endless_ending(rounds[earlier_modes.index(now) :])


def _endless_ending(rounds: Sequence[Round]) -> Ending:
    """Return the ending of a run whose events act without end at one instant.

    rounds : the rounds of acts of these events, see `records.ActsAt`; their names are
        reported.
    """
    about = quoted(name for names, *_ in rounds for name in names)
    return Ending(Outcome.EVENTS_CHATTER, about)


def _impulse(arc: Arc, k: int) -> tuple[Floats, Ending | None]:
    """Return the generalized impulse (n,) of event k, and an ending or None.

    The impulse is that at the state reached; the ending is that of a run whose impulse
    is not finite.
    """
    found = data_at(arc, arc.y).impulses[k]
    if np.isfinite(found).all():
        return found, None
    about = f": the impulse of the event `{arc.equations.model.events[k].name}`"
    return found, Ending(Outcome.NOT_FINITE, about)


def _with_energy(event: Event, energy: float, names: Collection[str]) -> Event:
    """Return the event, with `energy` as its energy if its name is in `names`."""
    return event._replace(energy=energy) if event.name in names else event
