"""Events of the file, which set modes and give impulses.

They act at located conditions, or every period. Modes of the file are constant in an
arc. At an event the arc ends, the modes are set, and the next arc begins. All events
due at one instant act in rounds, in the order of the file (`rounds`); then the sum of
their impulses, each evaluated with the velocities before, changes the velocities
(`impulses`). Then all sources set their own modes and impacts take place, by which
conditions may become true (`conditions`): their events act, and the cycle repeats
(`settle`). Where events are due again at the same instant, with the modes and the state
with which they have acted before, the cycle has no end, and the run ends.
"""

from __future__ import annotations

import math
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.equations import Acted
from lagsim.notes import Event
from lagsim.run.events.conditions import Truth
from lagsim.run.events.impulses import data_at, kick
from lagsim.run.events.records import NOTHING, ActsAt, Due
from lagsim.run.events.rounds import act_in_rounds, names_of
from lagsim.run.instants import width
from lagsim.run.trajectory import (
    Decision,
    Ending,
    JumpImpulses,
    Outcome,
    Source,
    quoted,
)
from lagsim.tolerances import SOLUTION_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.surfaces import Side
    from lagsim.run.arc import Arc
    from lagsim.run.events.corner_sides import CornerSides, JumpPiece


class Transitions(Source):
    """The source of the events of a run and of its end by `until`.

    Attributes
    ----------
    next : list of int
        The number of the next act of each periodic event; -1 for all other events.
    sets : list of int
        The number of assignments before each event, and of all.
    periodic, event_of : list of int
        The indices of periodic events; the index of the event of each condition.
    has_conditions : bool
        Whether any event, or `until`, has a condition.
    selects : bool
        Whether conditions contain functions with jumps (steps, such as `sign`), whose
        sides are selected at an instant.
    stepping : frozenset of int
        The conditions with such steps of rates, as in `sign(x_dot) = 0`.
    energetic, set_by_modes, kicks : bool
        Whether energies depend on modes that events set; whether conditions do; whether
        events give impulses.
    """

    def __init__(self, arc: Arc) -> None:
        events = arc.equations.model.events
        self.next = [1 if x.at is None and not x.once else -1 for x in events]
        self.sets = [0, *accumulate(len(x.sets) for x in events)]
        self.periodic = [k for k, number in enumerate(self.next) if number > 0]
        self.event_of = [k for k, x in enumerate(events) if x.at is not None]
        self.has_conditions = bool(arc.equations.model.located)
        self.energetic = arc.system.equations.is_set
        self.kicks = arc.equations.model.kicks
        nodes = [x.node for x in arc.equations.model.located]
        modes = {mode for x in events for mode, _ in x.sets}
        self.set_by_modes = bool(modes & arc.equations.graph.depends(nodes))
        sides, on_rates = arc.system.switches.sides, arc.system.p.on_rates
        self.selects = bool(_with_steps(arc, nodes, sides))
        rates = [x for x, on in zip(sides, on_rates, strict=True) if on > 0.0]
        self.stepping = _with_steps(arc, nodes, rates)

    def truth(self, arc: Arc) -> Truth:
        """Return the decisions of the truth of the conditions."""
        return Truth(arc, set_by_modes=self.set_by_modes, steps=self.selects)

    def due_at_start(self, arc: Arc) -> Due:
        """Store the truth of the conditions at the start, and return the acts there.

        The modes of the file in the memory are already those after the acts, since the
        admissible start depends on them.
        """
        events, begun = arc.equations.model.events, arc.equations.begun_by
        if len(arc.state.orientation):
            for c, k in enumerate(self.event_of):
                if events[k].once and events[k].name in begun.names:
                    arc.state.leeway[c] = math.inf
            self.truth(arc).begin()
        if not begun.names:
            return NOTHING
        periodic = [k for k, x in enumerate(events) if x.at is None]
        return Due(periodic=frozenset(periodic), begun=begun)

    def times(self, arc: Arc) -> Iterator[float]:
        """Return the times of the next acts of periodic events."""
        return (self._time(arc, k) for k in self.periodic)

    def _time(self, arc: Arc, k: int) -> float:
        """Return the time of the next act of periodic event k."""
        return arc.settings.start + self.next[k] * arc.equations.model.events[k].every

    def periodic_due(self, arc: Arc) -> frozenset[int]:
        """Return the indices of the periodic events that act at the time reached."""
        limit = arc.t + width(arc.settings, arc.t)
        return frozenset(k for k in self.periodic if self._time(arc, k) <= limit)

    def due(
        self, arc: Arc, comes_to_rest: Callable[[Arc], bool], waited: frozenset[int]
    ) -> Due:
        """Return the events due just before the instant, in a model with conditions.

        comes_to_rest : function of the arc, whether a law or a surface may hold a rate
            at 0 from then on, so that `if(x_dot < 0, 1, 0)` stays 0.
        waited : conditions that have waited at this instant for its laws and surfaces.
        """
        periodic, truth = self.periodic_due(arc), self.truth(arc)
        truth.decide_before(int(arc.state.event) - 1)
        satisfied = frozenset(truth.satisfied())
        waiting = frozenset[int]()
        if self.stepping:  # a rate that ends at 0 may be past 0 by rounding
            waiting = self.stepping & {*satisfied, *truth.falsified()} - waited
        if not waiting or not comes_to_rest(arc):
            return Due(periodic, satisfied)
        truth.wait(waiting)
        return Due(periodic, satisfied - waiting, waiting)

    def due_after(self, arc: Arc, *, struck: bool, stored_truth: bool) -> Due:
        """Return the events due after all acts, in a model with conditions.

        struck : whether velocities have jumped since the conditions were decided.
        stored_truth : whether the truth of the conditions just before the instant is
            stored; if not, it is evaluated here.
        """
        truth = self.truth(arc)
        if not stored_truth:
            truth.decide_before()
        found = truth.settled(struck=struck)
        return Due(conditions=frozenset(found)) if found else NOTHING

    def act(
        self, arc: Arc, due: Due, acts: ActsAt, row: Floats | None,
        corners: CornerSides | None,
    ) -> tuple[Decision, ActsAt]:  # fmt: skip
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
        row : ndarray, shape (1, k), or None
            The table row before the acts; None where they cannot change velocities.
        corners : CornerSides or None
            The corners of equalities that the state may be on.
        """
        events, y = arc.equations.model.events, arc.y.copy()
        before = arc.energies(y) if self.energetic else None
        acts, chatter = self._returned(arc, due, acts)
        acted, ending = due.begun, None
        if acted is None and not chatter:
            on = ArcActs(arc, self, due.waiting)
            acted, acts, ending = act_in_rounds(on, events, due, acts)
        acted = acted or Acted()
        if before is not None:
            arc.add_work(y, before)
        found = [Event(arc.t, "event", name=name) for name in acted.names]
        if chatter := chatter or acted.chatter:
            ending = Ending(Outcome.EVENTS_CHATTER, quoted(chatter))
        kicks = ending is None and bool(acted.impulse)
        given: JumpImpulses | None = None
        if kicks:
            y, given, energy = self._after_impulse(
                arc, np.array(acted.impulse), corners, y
            )
            kicking = {x.name for x in events if x.impulses}
            own = [energy if x.name in kicking else x.energy for x in found]
            found = [x._replace(energy=y) for x, y in zip(found, own, strict=True)]
        changed = kicks or before is not None
        decision = Decision(
            tuple(found), y=y if changed else None, rows=row if kicks else None,
            impulses=given, ending=ending,
        )  # fmt: skip
        return decision, acts._replace(is_over=True) if acted.is_over else acts

    def _returned(
        self, arc: Arc, due: Due, acts: ActsAt
    ) -> tuple[ActsAt, tuple[str, ...]]:
        """Return the acts with this visit added, and the names of a cycle, or ().

        A cycle: the impulses lead back to the modes and the velocities before an
        earlier round of the instant, with the same events. In a model without impulses
        the acts are returned unchanged.

        due : the events that act next.
        """
        if not self.kicks:
            return acts, ()
        events = arc.equations.model.events
        own = [self.event_of[c] for c in due.conditions if c < len(self.event_of)]
        if due.periodic or any(events[k].once for k in own):
            return acts._replace(visits=()), ()
        names, v = tuple(events[k].name for k in sorted(own)), arc.y[arc.velocities]
        least = SOLUTION_ROUNDOFF * arc.magnitudes[arc.velocities]
        earlier, now = acts.visits, (names, arc.modes, v.copy())
        for k, (acted, modes, w) in enumerate(earlier):
            if acted == names and modes == now[1] and (np.abs(w - v) <= least).all():
                return acts, names_of(earlier[k:])
        return acts._replace(visits=(*earlier, now)), ()

    def _after_impulse(
        self, arc: Arc, impulse: Floats, corners: CornerSides | None, before: Floats
    ) -> tuple[Floats, JumpImpulses, float]:  # fmt: skip
        """Return the state after an impulse, the impulses of rows, and the work done.

        The work is the energy that the impulse adds to the model. It is added to the
        work integrals in the state returned.

        Parameters
        ----------
        arc : Arc
            The arc that the impulse ends.
        impulse : ndarray, shape (n,)
            The sum of the generalized impulses, for all coordinates of the model.
        corners : CornerSides or None
            The corners of equalities that the state may be on.
        before : ndarray, shape (size,)
            The state before.
        """
        if corners is None or not corners.may_bend:
            after, given = kick(arc, before, impulse)
        else:
            after = before
            last, several = JumpImpulses(np.zeros(0), np.zeros(0)), []

            def jump(piece: JumpPiece) -> Floats:
                nonlocal last
                y, last = kick(arc, piece.y, piece.left * piece.part * impulse)
                corners.project(y, piece.stopped)
                return y

            for state in corners.pieces(jump):
                after = state
                several.append(last)
            sums = (sum(x.laws for x in several), sum(x.rows for x in several))
            given = JumpImpulses(*map(np.asarray, sums))
        energy = float(arc.add_work(after, arc.energies(before)).sum())
        return after, given, energy


class ArcActs:
    """The modes of the file and the conditions of an arc, on which events act.

    See `rounds.ActsTarget`. The modes are those in the memory, in a selection
    (`run.modes`). The truth of the conditions `waiting` is decided after the acts.
    """

    def __init__(self, arc: Arc, by: Transitions, waiting: frozenset[int]) -> None:
        self.arc, self.by, self.waiting = arc, by, waiting
        self._truth = by.truth(arc)
        if waiting:
            self._truth.keep()

    @property
    def modes(self) -> dict[str, float]:
        """The modes of the file, by name."""
        return self.arc.modes

    def begin_round(self, due: Collection[int], once: Collection[int]) -> None:
        """Mark the conditions `due` as true, and `once` for the rest of the run."""
        if due:
            self._truth.mark_true(for_ever=once)

    def changed(self) -> set[int]:
        """Return the conditions that have become true by the acts of the round."""
        found = self._truth.changed()
        if self.waiting:
            self._truth.wait(self.waiting)
        return found - self.waiting

    def impulse(self, k: int) -> tuple[Floats, Ending | None]:
        """Return the generalized impulse (n,) of event k, and an ending or None.

        The impulse is that at the state reached; the ending is that of a run whose
        impulse is not finite.
        """
        found = data_at(self.arc, self.arc.y).impulses[k]
        if np.isfinite(found).all():
            return found, None
        name = self.arc.equations.model.events[k].name
        about = f": the impulse of the event `{name}`"
        return found, Ending(Outcome.NOT_FINITE, about)

    def set_modes(self, k: int) -> Ending | None:
        """Set the modes of the file that event k assigns.

        Return the ending of the run if a value assigned is not finite, else None.
        """
        arc, event = self.arc, self.arc.equations.model.events[k]
        first, every = self.by.sets[k], self.by.sets[-1]
        values = arc.runner.function("sets", every)(arc.t, arc.y)[first:].tolist()
        ending = None
        for (mode, _), value in zip(event.sets, values, strict=False):
            arc.system.p.flat[arc.system.place(mode)] = value
            if not math.isfinite(value):
                about = f": `{mode}` in the event `{event.name}`"
                ending = Ending(Outcome.NOT_FINITE, about)
        arc.runner.prepare()
        if event.at is None:
            self.by.next[k] += 1
        return ending


def _with_steps(arc: Arc, nodes: list[int], sides: Sequence[Side]) -> frozenset[int]:
    """Return the indices of the conditions `nodes` that contain steps of `sides`."""
    if not sides:
        return frozenset()
    names = {side.variable for side in sides}
    found = arc.system.switches.at_levels(nodes)
    depends = arc.equations.graph.depends
    return frozenset(k for k, x in enumerate(found) if names & depends([x]))


def _with_energy(event: Event, energy: float, names: Collection[str]) -> Event:
    """Return the event, with `energy` as its energy if its name is in `names`."""
    return event._replace(energy=energy) if event.name in names else event
