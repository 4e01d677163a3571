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
from lagsim.mechanics.contact import impact
from lagsim.mechanics.laws import Kind
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Event
from lagsim.run.decisions import Decision, Ending, Source, Turn
from lagsim.run.events.sequence import Sequence
from lagsim.run.events.settling import settle
from lagsim.run.events.touching import Touching
from lagsim.run.trajectory import Outcome

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from collections.abc import Sequence as Some

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact import Impact
    from lagsim.run.arc import Arc

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

    def __init__(self, arc: Arc) -> None:
        self.laws = arc.system.laws
        self.sequence = Sequence(arc.settings.start, arc.settings.duration)
        self.bounces = [0] * len(self.laws)
        self.told: set[str] = set()
        self.ended = False
        p = arc.system.p
        p.law_mode[:] = p.law_way[:] = p.law_still[:] = p.impulses[:] = 0.0
        p.law_forces = p.law_shares = 0.0

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
        found = self._through(arc, k)
        if self.sequence.is_stuck() and found.ending is None:
            about = self._names(self.sequence.lately())
            found.ending = Ending(Outcome.SWITCHES_ACCUMULATE, about)
        turn = Turn.MODES if arc.system.surfaces else Turn.ARC
        return self._decision(arc, found)._replace(turn=turn)

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
        here, found = Touching(arc, arc.y), Found(arc.y.copy())
        also = {met} if met is not None else set()
        limit = self._limit(here, met)
        if limit is not None:
            also |= set(self.sequence.lately())
            self.sequence.recent.clear()
        closed = here.is_closed(also)
        for k, law in enumerate(self.laws):
            far = law.kind is Kind.TIMED and closed[k] and here.is_off(k, TORN)
            if far and law.row.holonomic:
                found.ending = Ending(Outcome.CONSTRAINT_JUMPS, law.constraint)
                return found
        some = [k for k, law in enumerate(self.laws) if closed[k]]
        some = [k for k in some if self.laws[k].kind in STRIKING]
        if any(here.strikes(k) for k in some):
            self._strike(here, some, limit, also, found)
            here, met = Touching(arc, found.y), None
        settled = settle(here, met, also)
        rested = {e.constraint for e in found.events if e.kind == "zeno"}
        found.events += [e for e in settled.events if e.constraint not in rested]
        if settled.paradox:
            found.ending = Ending(Outcome.PARADOX, self._names(some))
        if not settled.unique:
            found.cautions += self._once(
                "shared-contact",
                f"at t = {arc.t:.9g} {self._names(some)} hold more often than they "
                "must: the motion is what it is, and their forces are one way of many",
            )
        return found

    def _limit(self, here: Touching, met: int | None) -> float | None:
        """Give when impacts that come ever faster accumulate, if no motion is left.

        Contacts that strike by turns, as those of a block that rocks, pass their
        motion on: none of them bounces.
        """
        if met is None:
            return None
        limit = self.sequence.limit()
        several = self.sequence.lately()
        if limit is None and len(several) > 1 and all(map(here.is_spent, several)):
            return self.sequence.end()
        return limit

    def _strike(
        self,
        here: Touching,
        some: Some[int],
        limit: float | None,
        also: Collection[int],
        found: Found,
    ) -> None:
        """Let impulses change the velocities.

        Parameters
        ----------
        some
            The laws that may give impulses.
        limit
            When impacts that come ever faster accumulate.
        also
            Those that then come to rest.
        """
        arc = here.arc
        n, energy = arc.system.n, arc.system.columns.names.index("energy")
        found.rows = arc.runner.tabulate(arc.row())
        ends = dict(self._ends(here, some, limit, also))
        e = [0.0 if k in ends else self.laws[k].restitution for k in some]
        problem, response = here.problem(some, np.array(e))
        if limit is not None:
            problem = replace(problem, kinds=tuple(self._stopped(here, some, ends)))
        result = impact(problem, here.rates[list(some)], here.still[list(some)])
        # A flight that begins a rounding below the ground would end one farther below.
        deep = [i for i, k in enumerate(some) if here.is_below(k)]
        if deep:
            gaps = here.gaps[[some[i] for i in deep]]
            found.y[:n] -= response[:, deep] @ _raised(problem.D, deep, gaps)
        found.y[n : 2 * n] += response @ result.impulses
        change = arc.observed(found.y)[energy] - found.rows[0, energy]
        found.y[2 * n] += change
        arc.system.p.impulses[list(some)] = result.impulses
        after = here.rates[list(some)] + problem.D @ result.impulses
        largest = np.max(np.abs(result.impulses), initial=0.0)
        for i, k in enumerate(some):
            kind, name = self.laws[k].kind, self.laws[k].constraint
            if kind is Kind.SLIP or abs(result.impulses[i]) <= NO_IMPULSE * largest:
                continue
            struck = Event(
                arc.t, "impact", name, rate_before=float(here.rates[k]),
                rate_after=float(after[i]), energy=float(change),
            )  # fmt: skip
            found.events.append(struck)
            self.bounces[k] += 1
            if k in ends:
                if self.bounces[k] > SERIES:
                    found.events.append(Event(ends[k], "zeno", name))
                self.bounces[k] = 0
        found.cautions += self._told_of(here, some, result)

    def _ends(
        self,
        here: Touching,
        some: Some[int],
        limit: float | None,
        also: Collection[int],
    ) -> Iterator[tuple[int, float]]:
        """Give what comes to rest with this impact, and when its bounces would end."""
        for k in some:
            e = self.laws[k].restitution
            if limit is not None and k in also:
                yield k, limit
            elif e > 0.0 and here.strikes(k):
                left = here.rest(k, e)
                if left is not None:
                    yield k, here.arc.t + left

    def _stopped(
        self, here: Touching, some: Some[int], ends: Collection[int]
    ) -> Iterator[Kind]:
        """Give kinds for which those that end are held, with slips that have gone."""
        for k in some:
            law = self.laws[k]
            gone = law.normal in ends and here.is_spent(k)
            yield Kind.TIMED if k in ends or gone else law.kind

    def _told_of(
        self, here: Touching, some: Some[int], result: Impact
    ) -> list[Caution]:
        """Warn of what the law of impacts leaves open, or gets wrong."""
        told: list[Caution] = []
        names, t = self._names(some), here.arc.t
        if result.open:
            told += self._once(
                "impact-order",
                f"at t = {t:.9g} {names} strike at one time, and the outcome depends "
                "on their order: they were taken as simultaneous",
            )
        change, rates = result.energy, here.rates[list(some)]
        exchanged = np.abs(result.impulses) @ (np.abs(rates) + np.abs(result.after))
        if change > RAISED * exchanged:
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


def _raised(D: Floats, deep: list[int], gaps: Floats) -> Floats:
    """Give the multipliers that take gaps (d,) away, of the rows `deep` of D."""
    if len(deep) == 1:
        own = D[deep[0], deep[0]]
        return gaps / own if own > 0.0 else np.zeros(1)
    answer = D[np.ix_(deep, deep)]
    return np.asarray(np.linalg.lstsq(answer, gaps, rcond=None)[0], float)


def _impossible(ending: Ending) -> Problem:
    """Say that no motion begins at the start."""
    text = f"no motion begins at this start: {ending.about}: {ending.outcome.advice}"
    return Problem("no-motion", text)
