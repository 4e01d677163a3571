"""Constraints that come into force and go: contacts, friction, limits, freewheels.

In an arc each law has a mode (`solve.laws`). Where one ends, or a gap closes, it is
asked first whether anything strikes: impulses take the velocities to where they may go
on. Then the accelerations decide which of the closed laws hold. A contact that would
rebound by less than the tolerance tells apart rests: of a ball that bounces ever less
the time at which it comes to rest is that of the geometric series.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import impact
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Event
from lagsim.run.events.sequence import Flights, Sequence
from lagsim.run.events.settling import settle
from lagsim.run.events.touching import Touching
from lagsim.run.trajectory import Decision, Ending, Outcome, Source, Turn

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact import Impact
    from lagsim.run.arc import Arc
    from lagsim.run.events.touching import Shape

# What gives an impulse: a force that is bounded gives none in no time.
STRIKING = (Kind.CONTACT, Kind.FREEWHEEL, Kind.SLIP, Kind.TIMED)
# What has bounced so often comes to rest by a series, not by one impact.
SERIES = 3
# An impact that raises the energy by more than this part of what impulses exchange is
# told.
RAISED = 1e-9
# An impulse this small against the largest is rounding.
NO_IMPULSE = 1e-12
# A constraint that comes into force this far off, against its scale, is torn.
TORN = 1e-6
# A contact closes within so many tolerances of how far it has moved; no tolerance is
# less here than what a series of impacts leaves where it is taken to have ended.
CLOSING = 10.0
LEAST_TOLERANCE = 1e-10


@dataclass(slots=True)
class Found:
    """What happens at one time."""

    y: Floats
    events: list[Event] = field(default_factory=list)
    cautions: list[Caution] = field(default_factory=list)
    rows: Floats | None = None
    ending: Ending | None = None


class Contacts(Source):
    """The laws of a run."""

    DERIVED = ("shape",)  # a run that is gone on with has it from its state

    def __init__(self, arc: Arc) -> None:
        self.laws = arc.system.laws
        self.sequence = Sequence(arc.settings.start, arc.settings.duration)
        self.bounces = [0] * len(self.laws)
        self.flights = [Flights() for _ in self.laws]
        laws = enumerate(self.laws)
        self.contacts = [k for k, law in laws if law.kind is Kind.CONTACT]
        self.shape: Shape | None = None
        self.told: set[str] = set()
        self.ended = False
        self.left: set[int] = set()
        self.left_at = arc.t
        p = arc.system.p
        p.law_mode[:] = p.law_way[:] = p.law_still[:] = p.impulses[:] = 0.0
        p.law_floor[:] = 0.0

    def begin(self, arc: Arc) -> Decision:
        """Choose the modes at the state reached."""
        return self._decision(arc, self._through(arc, None))

    def set_out(self, arc: Arc) -> Decision:
        """Forget the impulses of an impact: its row has been written."""
        arc.system.p.impulses[:] = 0.0
        return super().set_out(arc)

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go through the end of a mode."""
        if code == at.DONE and arc.t >= arc.settings.end and not self.ended:
            return self._last(arc)
        k = int(arc.state.switched) - 1 - arc.system.surfaces
        if code != at.SWITCH_FOUND or k < 0:
            return None
        arc.meet_row()
        self.sequence.add(arc.t, k)
        self._leave(arc, k)
        found = self._through(arc, k)
        span = self.sequence.span
        restless = [k for k in self.contacts if self.flights[k].is_restless(span)]
        if (restless or self.sequence.is_stuck()) and found.ending is None:
            about = self._names(restless or self.sequence.lately())
            found.ending = Ending(Outcome.SWITCHES_ACCUMULATE, about)
        turn = Turn.MODES if arc.system.surfaces else Turn.ARC
        return self._decision(arc, found)._replace(turn=turn)

    def _leave(self, arc: Arc, k: int) -> None:
        """Note what has reached the edge of what it bears at this time.

        Whoever asks once more at the same time (a switch, a break, another law that
        ends then) finds it at that edge still, and it does not go on to hold.
        """
        if arc.t != self.left_at:
            self.left, self.left_at = set(), arc.t
        if arc.system.p.law_mode[k] == kept.HELD:
            self.left.add(k)

    def _last(self, arc: Arc) -> Decision | None:
        """Let strike what does so at the end, but for rounding."""
        self.ended = True
        found = self._through(arc, None)
        if found.rows is None:
            return None
        return self._decision(arc, found)._replace(turn=Turn.ARC)

    def _decision(self, arc: Arc, found: Found) -> Decision:
        if found.ending is not None and arc.steps == 0:
            raise InputError([_impossible(found.ending)])
        return Decision(
            events=tuple(found.events), cautions=tuple(found.cautions), y=found.y,
            sizes=np.maximum(arc.sizes, np.abs(found.y)), rows=found.rows,
            ending=found.ending,
        )  # fmt: skip

    def _names(self, some: Collection[int]) -> str:
        names = dict.fromkeys(self.laws[k].constraint for k in some)
        return ", ".join(f"`{name}`" for name in names)

    def _through(self, arc: Arc, met: int | None) -> Found:
        """Go through impacts, then choose the modes."""
        here, found = Touching(arc, arc.y, known=self.shape), Found(arc.y.copy())
        also = {met} if met is not None else set()
        here.grazing = _grazing(here, here.is_closed(also))
        also.difference_update(here.grazing)
        closed = here.is_closed(also)
        ends = self._ends(here, closed)
        for k, law in enumerate(self.laws):
            if closed[k] and self._jumps(here, k):
                found.ending = Ending(Outcome.CONSTRAINT_JUMPS, law.constraint)
                return found
        some = [k for k, law in enumerate(self.laws) if closed[k]]
        some = [k for k in some if self.laws[k].kind in STRIKING]
        if any(here.strikes(k) for k in some):
            self._strike(here, some, ends, found)
            grazing = here.grazing
            here = Touching(arc, found.y, known=here.shape)
            here.grazing = grazing
        self.shape = here.shape
        edge = self.left if arc.t == self.left_at else set()
        settled = settle(here, edge, also)
        rested = {e.constraint for e in found.events if e.kind == "zeno"}
        found.events += [e for e in settled.events if e.constraint not in rested]
        if settled.paradox:
            found.ending = Ending(Outcome.PARADOX, self._names(some))
        if not settled.unique:
            found.cautions += self._once(
                "shared-contact",
                (
                    f"at t = {arc.t:.9g} the contacts {self._names(some)} are "
                    "redundant: the motion is unique, their forces are not, and one "
                    "solution is given"
                ),
            )
        return found

    def _jumps(self, here: Touching, k: int) -> bool:
        """Tell whether a law that is in force now is off by more than it was located.

        Its function jumps there, or it has been closed in flight: no motion goes on,
        and no energy of other bodies hides that.
        """
        kind = self.laws[k].kind
        rtol = here.arc.plan.rtol
        if kind is Kind.CONTACT and rtol is not None:
            return here.is_off(k, CLOSING * max(rtol, LEAST_TOLERANCE))
        return kind in (Kind.TIMED, Kind.CONTACT) and here.is_off(k, TORN)

    def _ends(self, here: Touching, closed: list[bool]) -> dict[int, float]:
        """Give which series of bounces end with an impact, and when each would.

        Each contact is judged by its own flights; what an impact that is one acts on
        as well flies on. All that end do so together, as one accumulation.
        """
        t = here.arc.t
        struck = {k for k in self.contacts if closed[k] and here.strikes(k)}
        if not struck:
            return {}
        for k in struck:
            self.flights[k].add(t, abs(float(here.rates[k])))
        ends: dict[int, float] = {}
        for k in self.contacts:
            least = here.least(k)
            if here.in_force[k] and abs(here.gaps[k]) <= least:
                end = self.flights[k].end(t, abs(float(here.rates[k])), least)
                if end is not None:
                    ends[k] = end
        if struck.isdisjoint(ends):
            return {}
        loud = struck.difference(ends)
        ends = {k: end for k, end in ends.items() if not here.acts_on(k, loud)}
        for k in struck.intersection(ends):
            self.flights[k].rests.append(t)
        return ends

    def _strike(
        self,
        here: Touching,
        some: list[int],
        ends: dict[int, float],
        found: Found,
    ) -> None:
        """Let impulses change the velocities.

        Parameters
        ----------
        some
            The laws that may give impulses.
        ends
            When series end that do so with this impact.
        """
        arc = here.arc
        n = arc.system.n
        before = found.y.copy()
        found.rows = arc.runner.tabulate(arc.row())
        stopped = ends
        struck = [k for k in some if here.strikes(k)]
        rests = {k: here.rest(k, self.laws[k].restitution) for k in struck}
        ends = {k: arc.t + left for k, left in rests.items() if left is not None}
        ends |= stopped
        e = [0.0 if k in ends else self.laws[k].restitution for k in some]
        problem, response = here.problem(some, np.array(e))
        if stopped:
            problem = replace(problem, kinds=tuple(self._stopped(here, some, ends)))
        rates = here.rates[some]
        result = impact(problem, rates, here.still[some])
        # A flight that begins a rounding below the ground would end one farther below.
        deep = [i for i, k in enumerate(some) if here.is_below(k)]
        if deep:
            gaps = here.gaps[[some[i] for i in deep]]
            found.y[:n] -= response[:, deep] @ _raised(problem.D, deep, gaps)
        found.y[n : 2 * n] += response @ result.impulses
        changes = arc.energies(found.y) - arc.energies(before, found.rows[0])
        found.y[2 * n : 2 * n + arc.system.works] += changes
        arc.system.p.impulses[some] = result.impulses
        after = (rates + problem.D @ result.impulses).tolist()
        sizes = [abs(impulse) for impulse in result.impulses.tolist()]
        largest = max(sizes)
        for i, k in enumerate(some):
            kind, name = self.laws[k].kind, self.laws[k].constraint
            if kind is Kind.SLIP or sizes[i] <= NO_IMPULSE * largest:
                continue
            event = Event(
                arc.t, "impact", name, rate_before=float(rates[i]),
                rate_after=after[i], energy=float(np.sum(changes)),
            )  # fmt: skip
            found.events.append(event)
            self.bounces[k] += 1
            if k in ends:
                if self.bounces[k] > SERIES:
                    found.events.append(Event(ends[k], "zeno", name))
                self.bounces[k] = 0
        if not result.found:
            found.ending = Ending(Outcome.PARADOX, self._names(some))
        elif not result.impulses.any():
            found.rows = None  # of rates that are rounding beside others of their body
        found.cautions += self._told_of(here, some, result)

    def _stopped(
        self, here: Touching, some: list[int], ends: Collection[int]
    ) -> Iterator[Kind]:
        """Give kinds for which those that end are held, with slips that have gone.

        What slides on has the friction of what is left of their impacts.
        """
        for k in some:
            law = self.laws[k]
            spent = law.normal in ends and here.is_spent(k)
            yield Kind.TIMED if k in ends or spent else law.kind

    def _told_of(
        self, here: Touching, some: list[int], result: Impact
    ) -> list[Caution]:
        """Warn of what the law of impacts leaves open, or gets wrong."""
        told: list[Caution] = []
        t = here.arc.t
        if result.open:
            names = self._names(some)
            told += self._once(
                "impact-order",
                f"at t = {t:.9g} {names} strike at one time, and the outcome depends "
                "on their order: they were taken as simultaneous",
            )
        change, rates = result.energy, here.rates[some]
        exchanged = np.abs(result.impulses) @ (np.abs(rates) + np.abs(result.after))
        if change > RAISED * exchanged:
            names = self._names(some)
            told += self._once(
                "impact-energy",
                f"at t = {t:.9g} the impact at {names} raises the energy by "
                f"{change:.3g}: Newton's restitution with friction can",
            )
        return told

    def _once(self, code: str, text: str) -> list[Caution]:
        if code in self.told:
            return []
        self.told.add(code)
        return [Caution(code, text)]


def _grazing(here: Touching, closed: list[bool]) -> dict[int, float]:
    """Give the contacts in flight that turn back at their ground -> the depth.

    A depth within the errors of a gap is no impact: its speed, the root of that, would
    be a jump a thousand times the tolerance. What turns it back has to act before the
    ground: none is told on the surface of a switch, past which forces are others.
    """
    system = here.arc.system
    if np.any(system.p.slack[: system.surfaces] > 0.0):
        return {}
    struck = {k for k in range(here.count) if closed[k] and here.strikes(k)}
    depths = {k: here.depth(k) for k in struck}
    found = {k: depth for k, depth in depths.items() if depth <= here.least(k, CLOSING)}
    others = struck.difference(found)
    return {k: depth for k, depth in found.items() if not here.acts_on(k, others)}


def _raised(D: Floats, deep: list[int], gaps: Floats) -> Floats:
    """Give the multipliers that take gaps (d,) away, of the rows `deep` of D."""
    if len(deep) == 1:
        own = D[deep[0], deep[0]]
        return gaps / own if own > 0.0 else np.zeros(1)
    answer = D[np.ix_(deep, deep)]
    return np.asarray(np.linalg.lstsq(answer, gaps, rcond=None)[0], float)


def _impossible(ending: Ending) -> Problem:
    """Say that no motion begins at the start."""
    text = (
        f"no motion exists from this start on: {ending.about}: {ending.outcome.advice}"
    )
    return Problem("no-motion", text)
