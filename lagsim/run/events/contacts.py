"""Impacts and mode selection of laws: contacts, friction, limits, freewheels.

In an arc each law has a mode (`program/laws.py`). At an instant the impacts of closing
laws are computed first (`Contacts.velocities`): their impulses change the velocities to
admissible ones. Then the accelerations decide which of the closed laws hold
(`Contacts.modes`). A contact whose rebound would be below the tolerance comes to rest:
the rest time of a ball with ever smaller bounces is the limit of a geometric series.

A slip on a disc is the slip of a contact in two tangential directions. It is two laws,
whose multipliers lie in a disc with the radius of the largest friction.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.codes.known import (
    IMPACT_ENERGY,
    IMPACT_ORDER,
    NO_MOTION,
    SHARED_CONTACT,
    SHARED_FRICTION,
)
from lagsim.errors import InputError, Problem
from lagsim.mechanics.algebra import least_squares
from lagsim.mechanics.impacts import Impact, impact
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.notes import Event
from lagsim.run.events.accumulation import Accumulation
from lagsim.run.events.conditions import allow_closed
from lagsim.run.events.corner_sides import corner_events
from lagsim.run.events.corrections import (
    corrected_state,
    kept_at_rest,
    leaves_curves,
    stop,
)
from lagsim.run.events.impulses import data_at, followed, transmit
from lagsim.run.events.kinematics import Kinematics
from lagsim.run.events.law_modes import (
    Chosen,
    changes,
    chosen_modes,
    set_floors,
    set_slack,
    steady_laws,
    that_could_act,
    unchanged_laws,
    write_modes,
)
from lagsim.run.events.records import LawsAt, LawState
from lagsim.run.events.sliders import Sliders
from lagsim.run.failures import end_of_table
from lagsim.run.trajectory import (
    Decision,
    Ending,
    Located,
    Outcome,
    Source,
    Turn,
    quoted,
)
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    COMPUTED_ZERO,
    LEAST_CLOSING,
    SATISFIED,
    SOLUTION_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.codes.known import WarningCode
    from lagsim.language.arrays import Floats
    from lagsim.notes import Caution
    from lagsim.run.arc import Arc
    from lagsim.run.events.corner_sides import CornerSides, JumpPiece
    from lagsim.run.trajectory import JumpImpulses

# A contact with more impacts than this comes to rest by a series, not by one impact.
SERIES = 3
# Largest gap of a closed contact, in tolerances of the distance it has moved; the
# tolerance is at least the gap that a series of impacts leaves at its computed end.
CLOSING = 10.0
# Longest time to the turning point of a contact that grazes, in parts of its flight.
TURNING = 0.05


WARNINGS = {
    IMPACT_ORDER: (
        "at t = {t:.9g} {names} strike at one time, and the result depends on their "
        "order: they are treated as simultaneous"
    ),
    IMPACT_ENERGY: (
        "at t = {t:.9g} the impact at {names} raises the energy by {gained:.3g}: "
        "Newton's restitution with friction can"
    ),
    SHARED_CONTACT: (
        "at t = {t:.9g} the contacts {names} are redundant: the motion is unique, "
        "their forces are not, and one solution is given"
    ),
    SHARED_FRICTION: (
        "at t = {t:.9g} friction slides by forces of {names} that are not unique, so "
        "the motion is not, and one solution is given"
    ),
}


@dataclass(slots=True)
class StateAfter:
    """State after the events at one time, with the events, warnings and rows.

    Attributes
    ----------
    y : ndarray, shape (size,)
        The state after the impacts.
    laws : LawsAt
        The laws at the instant.
    has_new_state : bool
        Whether y may differ from the state before the impacts.
    events, cautions
        The events, and the warnings.
    rows : ndarray or None
        Table rows just before an impact; None where no impact is reported.
    impulses
        See `trajectory.Decision`.
    ending
        The reason why the motion cannot continue, or None.
    state : LawState or None
        The laws at the state reached, after their impacts.
    """

    y: Floats
    laws: LawsAt
    has_new_state: bool = True
    events: list[Event] = field(default_factory=list)
    cautions: list[Caution] = field(default_factory=list)
    rows: Floats | None = None
    impulses: JumpImpulses | None = None
    ending: Ending | None = None
    state: LawState | None = None

    def decision(self, arc: Arc) -> Decision:
        """Return the events, state, rows, impulses and ending as a `Decision`.

        The decision has a state only if the state may have changed.

        Raises
        ------
        InputError
            If no motion can begin at the start of the run.
        """
        if self.ending is not None and arc.steps == 0:
            why = f"{self.ending.about}: {self.ending.outcome.advice}"
            text = f"no motion exists from this start on: {why}"
            raise InputError([Problem(NO_MOTION, text)])
        y = self.y if self.has_new_state else None
        sizes = None if y is None else np.maximum(arc.sizes, np.abs(y))
        return Decision(
            events=tuple(self.events), cautions=tuple(self.cautions), y=y,
            sizes=sizes, rows=self.rows, impulses=self.impulses, ending=self.ending,
        )  # fmt: skip


class Contacts(Source):
    """Source of a run that computes the impacts of its laws and selects their modes.

    Attributes
    ----------
    sequence : Accumulation
        The last ends of modes of laws, and the flights of each contact.
    modes_at_start : dict
        The modes of the file at the start, at which the examination of the start has
        checked all laws in force.
    """

    def __init__(self, arc: Arc) -> None:
        self.laws, table = arc.system.laws, arc.system.law_table
        self.sequence = Accumulation(arc.settings.duration)
        self.contacts: list[int] = np.flatnonzero(table.gapped).tolist()
        self.striking: list[int] = np.flatnonzero(table.strikes).tolist()
        engaging = table.one_sided & ~table.gapped
        self.freewheels: list[int] = np.flatnonzero(engaging).tolist()
        self.sliders = arc.system.sliders
        # equalities whose rows depend on velocities, which impulses change
        pairs = enumerate(self.laws)
        curved = arc.equations.is_curved
        self.curved = [k for k, x in pairs if x.equal and curved(x.row)]
        self.always = [x.name for x in arc.equations.rows if curved(x)]
        self.modes_at_start = arc.modes

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision to settle the end of a law's mode.

        None for codes of the kernel other than `SWITCH_FOUND`, and for surfaces.

        code : the kernel's return code.
        """
        k = int(arc.state.switched) - 1 - arc.system.surfaces
        if code != at.SWITCH_FOUND or k < 0:
            return None
        return Decision(turn=Turn.SETTLE, located=Located(law=k))

    def approach(self, arc: Arc) -> bool:
        """Whether a closed law would strike at the state reached."""
        here = Kinematics(arc, arc.y)
        return any(here.closed[k] and here.strikes[k] for k in self.striking)

    def located(self, arc: Arc, laws: LawsAt, k: int) -> LawsAt:
        """Store that the mode of law k has ended, and return the laws at the instant.

        A law that was located counts as closed. If a slip on a disc has ended, the
        friction of all slips that began together with it is no longer regularized.
        """
        self.sequence.add(arc.t, k)
        p, pair, left = arc.system.p, self.laws[k].pair, dict(laws.left)
        if p.law_mode[k] == kept.HELD:
            left[k] = left.get(k, 0) + 1
        if p.law_mode[k] == kept.SLIDING and pair >= 0:
            also = np.isfinite(p.law_lasts) & (p.law_begun == p.law_begun[k])
            p.law_floor[also] = p.law_floor[[k, pair]] = 0.0
        return laws._replace(left=left, closed=laws.closed | {k})

    def accumulate(self) -> Ending | None:
        """Return the ending of a run whose contacts leave rest too often, or None."""
        restless = self.sequence.restless()
        if not restless:
            return None
        return Ending(Outcome.SWITCHES_ACCUMULATE, self._names(restless))

    def _report(
        self, found: StateAfter, code: WarningCode, indices: list[int], **numbers: float
    ) -> None:
        """Add a warning about laws, once for each code.

        Parameters
        ----------
        found : StateAfter
            The record whose `cautions` receive the warning.
        code : str
            A key of `WARNINGS`.
        indices : list of int
            Indices of the laws.
        **numbers
            Fields of the text.
        """
        text = WARNINGS[code].format(names=self._names(indices), **numbers)
        found.cautions += self.once(code, text)

    def _names(self, indices: Collection[int]) -> str:
        return quoted(self.laws[k].name for k in indices)

    def velocities(
        self, arc: Arc, laws: LawsAt, law: int, corners: CornerSides | None,
        *, decided: bool,
    ) -> StateAfter:  # fmt: skip
        """Compute the impacts of all laws that approach at the state reached.

        The state after the impacts is returned, with its events.

        Parameters
        ----------
        arc : Arc
            The arc that has ended, at the state reached.
        laws : LawsAt
            The laws at the instant.
        law : int
            Index of the law whose mode has ended, or -1.
        corners : CornerSides or None
            The corners of equalities that the state may be on; their sides are changed.
        decided : bool
            Whether the sides of all surfaces on which the bounds of laws may depend are
            decided.
        """
        here, found = Kinematics(arc, arc.y), StateAfter(arc.y.copy(), laws)
        corrected = corrected_state(here, law)
        if corrected is not None:
            found.y, here = corrected, Kinematics(arc, corrected.copy())
        arrived = here
        arc.system.p.law_opens[:] = 0.0
        recent = (t for t, _ in reversed(self.sequence.recent) if t < arc.t)
        flown = arc.t - next(recent, arc.settings.start)
        closed = here.is_closed(laws.closed)
        if grazing := _grazing(here, closed, flown):
            here.graze(grazing)
            found.laws = laws = laws._replace(closed=laws.closed.difference(grazing))
            closed = here.is_closed(laws.closed)
        ends = self._ends(here, closed)
        if not self._is_examined(arc) and (names := self._jumping(here, closed)):
            found.ending = Ending(Outcome.CONSTRAINT_JUMPS, names[0])
            return found
        closed_laws = [k for k, on in enumerate(closed) if on]
        if self.sliders:
            closed_laws = sorted({*closed_laws, *self.sliders})
        striking = [k for k in self.striking if closed[k]]
        struck = [k for k in striking if here.strikes[k]]
        if struck and self._leaves_tables(arc, closed_laws, struck, found):
            return found
        # Whether the bound of a law decreases depends on sides that are decided later.
        if wrong := here.out_of_range(closed_laws, laws.closed if decided else ()):
            found.ending = Ending(Outcome.LAW_OUT_OF_RANGE, wrong)
            return found
        if struck:
            # The impact may engage a freewheel.
            free = [k for k in self.freewheels if here.in_force[k]]
            reached = here.reached({*struck, *ends}, {*striking, *free})
            here = self._strike(here, reached, ends, found, corners)
        if self.sliders:
            here = self._settled(here, found)
        if found.rows is not None and laws.shared is not None:
            found.laws = found.laws._replace(shared=None)
        steady = None if law < 0 else steady_laws(arrived, here)
        found.state = LawState(here, striking, steady)
        return found

    def modes(self, arc: Arc, laws: LawsAt, state: LawState) -> StateAfter:
        """Select the modes of laws by the accelerations at the state reached.

        Parameters
        ----------
        arc : Arc
            The arc that has ended, at the state reached.
        laws : LawsAt
            The laws at the instant.
        state : LawState
            The laws at the state reached, none of which approaches.
        """
        here, striking, steady = state
        found = StateAfter(arc.y, laws, has_new_state=False)
        p, slid = arc.system.p, laws.slid
        if laws.shared is None or here.grazing:
            could = that_could_act(here, laws.closed)
            stay = unchanged_laws(here, could, steady, laws.closed)
            decided = sorted({*could}.difference(stay)) if stay else could
            chosen = chosen_modes(here, decided, laws.left, stay)
        else:
            chosen = Chosen.of(here, *laws.shared)
        write_modes(arc, chosen)
        set_floors(here, chosen, slid)
        set_slack(here, chosen)
        p.law_pushes[p.positions] = p.law_pushes[p.velocities] = here.moves
        held = np.flatnonzero(p.law_mode == kept.HELD).tolist()
        if not slid.isdisjoint(held):
            found.y, found.has_new_state = self._stopped(here, held, slid), True
        events = changes(here, laws.mode) if arc.steps else ()
        found.laws = laws._replace(mode=p.law_mode.copy(), shared=None)
        found.events += [e for e in events if e.constraint not in laws.rested]
        if chosen.paradox:
            found.ending = Ending(Outcome.PARADOX, self._names(striking))
        # The friction of a body that rests on two points is never determined.
        redundant = [k for k in chosen.active if chosen.mode[k] == kept.REDUNDANT]
        shares = any(here.table.is_one_sided[k] for k in redundant)
        p.law_shared[:] = p.law_shares = 0.0
        if redundant:
            bear = [k for k in held if self._can_share(here, k)]
            p.law_shared[redundant] = here.are_spanned(redundant, bear)
            p.law_shares = p.law_shared.max()
        if shares or chosen.open:
            code: WarningCode = SHARED_FRICTION if chosen.open else SHARED_CONTACT
            self._report(
                found, code, chosen.active if chosen.open else striking, t=arc.t
            )
        return found

    def _stopped(
        self, here: Kinematics, held: list[int], slid: Collection[int]
    ) -> Floats:
        """Return the state (size,) in which slips that stop are at rest.

        held, slid : indices of laws that hold from now on, and that slid until now.
        here : all laws at the state reached.
        """
        y, velocities = here.arc.y.copy(), here.arc.velocities
        stopped = [k in slid and self.laws[k].pair >= 0 for k in held]
        if any(stopped):  # the remaining speed of a slip that stops is removed
            rates = np.where(stopped, here.rates[held], 0.0)
            y[velocities] -= here.shape.lift(held, rates)
        stop(here, y, [k for k in held if k in slid])
        return y

    def _settled(self, here: Kinematics, found: StateAfter) -> Kinematics:
        """Return the kinematics after sliders without mass have changed modes.

        The state, events and ending are stored in `found`.

        here : all laws at the state reached.
        """
        arc, before = here.arc, found.y
        settled = Sliders(arc, before).settled()
        found.y, found.events = settled.y, found.events + settled.events
        if settled.jumps:
            if found.rows is None:
                found.rows = arc.runner.tabulate(arc.row())
            arc.add_work(found.y, arc.energies(before))
        if settled.unmet:
            found.ending = Ending(settled.ending, quoted(settled.unmet))
        return here.at(found.y)

    def _is_examined(self, arc: Arc) -> bool:
        """Whether the examination of the start has checked all laws in force.

        If so, residuals are not checked again here: there are no ranges of motion yet
        to compare a residual with. False after the start, and if events at the start
        have set other modes of the file.
        """
        at_start = arc.steps == 0 and arc.t == arc.settings.start
        return at_start and arc.modes == self.modes_at_start

    def _can_share(self, here: Kinematics, k: int) -> bool:
        """Whether law k can share the load of redundant laws.

        Contacts without friction, freewheels and limits can; slips, contacts with
        slips, equalities and sliders cannot.

        here : all laws at the state reached.
        """
        table = here.table
        has_friction = any(table.slips[i] for i in (k, *table.coupled_rows[k]))
        return not (has_friction or table.equal[k] or self.laws[k].slider)

    def _jumping(self, here: Kinematics, closed: list[bool]) -> list[str]:
        """Return the names of closed laws with residuals beyond the location tolerance.

        The function of such a law jumps, or the law was closed in flight, and no motion
        can continue. The energy of other bodies does not enter the tolerance.

        closed : whether each law is closed.
        here : all laws at the state reached.
        """
        rtol, table = here.arc.plan.rtol, here.table
        part = SATISFIED if rtol is None else CLOSING * max(rtol, LEAST_CLOSING)
        parts = np.where(table.gapped, part, SATISFIED)
        off = (table.gapped | table.equal) & closed & here.is_off(parts)
        return [self.laws[k].name for k in np.flatnonzero(off).tolist()]

    def _leaves_tables(
        self, arc: Arc, closed: list[int], struck: list[int], found: StateAfter
    ) -> bool:
        """Whether a table of a law is past its end at an impact, which ends the run.

        closed : the indices of closed laws, whose bounds count.
        struck : the indices of laws that approach, whose restitutions count.
        found : receives the ending.
        """
        if arc.system.switches.sides:
            given = [n for k in closed for n in arc.system.laws[k].given[:2]]
            given += [n for k in struck for n in arc.system.laws[k].given[2:]]
            found.ending = end_of_table(arc, given)
        return found.ending is not None

    def _ends(self, here: Kinematics, closed: list[bool]) -> dict[int, float]:
        """Return the end time of each series of bounces that ends with this impact.

        The keys are the indices of the contacts. Each contact is judged by its own
        flights. All series that end are ended at this impact, as one accumulation; the
        result is empty if none of their contacts strikes now.

        closed : whether each law is closed.
        here : all laws just before the impact.
        """
        t = here.arc.t
        struck = {k for k in self.contacts if closed[k] and here.strikes[k]}
        if not struck:
            return {}
        for k in struck:
            self.sequence.of(k).strikes.append((t, abs(float(here.rates[k]))))
        ends: dict[int, float] = {}
        near = here.table.gapped & (np.abs(here.gaps) <= here.least) & here.in_force
        for k in np.flatnonzero(near).tolist():
            least = float(here.least[k])
            end = self.sequence.of(k).end(t, abs(float(here.rates[k])), least)
            if end is not None:
                ends[k] = end
        if struck.isdisjoint(ends):
            return {}
        for k in struck.intersection(ends):
            self.sequence.of(k).rests.append(t)
        return ends

    def _strike(
        self,
        here: Kinematics,
        active: list[int],
        ends: dict[int, float],
        found: StateAfter,
        corners: CornerSides | None,
    ) -> Kinematics:
        """Compute and apply the impulses of laws; return the laws afterwards.

        Parameters
        ----------
        here : Kinematics
            The laws just before the impact.
        active : list of int
            Indices of the laws on which impulses may act.
        ends : dict of int to float
            End times of the series of bounces that end with this impact, by contact.
        found : StateAfter
            The record whose state, rows, events and warnings are updated.
        corners : CornerSides or None
            The corners that the state may be on.
        """
        arc, before, arrived = here.arc, found.y, here
        found.rows = arc.runner.tabulate(arc.row())
        stopped = ends
        struck = [k for k in active if here.strikes[k]]
        rests = {k: here.rest(k, float(here.restitutions[k])) for k in struck}
        ends = {k: arc.t + left for k, left in rests.items() if left is not None}
        ends |= stopped
        e = np.array([0.0 if k in ends else here.restitutions[k] for k in active])
        # A contact whose series ends is held as an equality; a slip has the friction of
        # the impulses that remain in its series.
        equalities = [i for i, k in enumerate(active) if k in ends] if stopped else []
        solution = _solve_impact(here, active, e, equalities)
        if corners is not None and corners.may_bend:
            solution = _solve_impact_beside(corners, here, active, e, equalities)
        elif not set(struck).isdisjoint(self.curved):
            solution = _follow_curves(here, active) or solution
        here, _, result, y, pushed = solution
        # A flight that begins below the ground by rounding would end lower by as much.
        lift = here.shape.lift
        deep = [k for k in active if k in self.contacts and here.gaps[k] < 0.0]
        if deep:
            y[arc.state.positions] -= lift(deep, here.gaps[deep])
        found.y = y
        there = here.at(y)
        if deep:
            rest = np.abs(result.after) <= here.still[active]
            there = kept_at_rest(there, np.array(active)[rest])
        changes = arc.add_work(y, arc.energies(before, found.rows[0]))
        energy = float(changes.sum())
        given = np.zeros(len(self.laws))
        given[active] = result.impulses
        bent = self._at_corners(here, struck, corners)
        found.impulses = transmit(arc, before, y, given, [*bent.values()], pushed)
        contacts = [k for k in struck if k in self.contacts]
        closed = y.copy()
        closed[arc.state.positions] -= lift(
            contacts, here.gaps[contacts] + here.slack[contacts]
        )
        allow_closed(arc, y, closed)
        if bent:
            assert corners is not None
            on = arc.system.switches.turns.intersection(corners.corners)
            found.events += corner_events(arc, sorted(on), energy, bent)
        self._list_impacts(solution, active, found, energy, ends)
        named = {event.constraint for event in found.events}
        found.events += [  # struck in the projection
            Event(
                arc.t, "impact", name, rate_before=float(arrived.rates[k]),
                rate_after=0.0, energy=energy,
            )
            for name, k in bent.items() if name not in named
        ]  # fmt: skip
        off = np.abs(there.rates) > CLEAR_OF_ROUNDING * there.still
        missed = [self.laws[k].name for k in self.curved if k in active and off[k]]
        if self.always and leaves_curves(arc, before, y):
            missed = self.always
        if not result.found:
            found.ending = Ending(Outcome.PARADOX, self._names(active))
        elif missed:
            # One row gives the impulses beside contacts: the curve is left.
            found.ending = Ending(Outcome.NO_ANSWER, missed[0])
        elif not result.impulses.any() and not bent:
            # the closing rates were rounding of the other motions of their bodies
            found.rows = None
        self._warn(here, active, result, found, ending=bool(stopped))
        return there

    def _list_impacts(
        self, solution: ImpactSolution, active: list[int], found: StateAfter,
        energy: float, ends: dict[int, float],
    ) -> None:  # fmt: skip
        """Add the events of the laws that have impulses in an impact to `found`.

        solution : the impulses.
        active : indices of the laws struck.
        energy : the change of the energy.
        ends : end times of the series that end with this impact, by law.
        """
        here, rates, result = solution.here, solution.rates, solution.result
        sizes = np.abs(result.impulses)
        listed = (sizes > SOLUTION_ROUNDOFF * sizes.max()).tolist()
        for i, k in enumerate(active):
            if here.table.slips[k] or not listed[i]:
                continue
            name = self.laws[k].name
            event = Event(
                here.arc.t, "impact", name, rate_before=float(rates[i]),
                rate_after=float(result.after[i]), energy=energy,
            )  # fmt: skip
            found.events.append(event)
            self._count_impact(found, k, ends)

    def _count_impact(self, found: StateAfter, k: int, ends: dict[int, float]) -> None:
        """Count an impact of a law in its series; add an event where the series ends.

        The event `zeno` is added at the end of a long series of bounces.

        found : the record whose events and laws are updated.
        k : the index of the law.
        ends : end times of the series that end with this impact, by law.
        """
        history, name = self.sequence.of(k), self.laws[k].name
        history.impacts += 1
        if k not in ends:
            return
        if history.impacts > SERIES:
            found.events.append(Event(ends[k], "zeno", name))
            rested = found.laws.rested | {name}
            found.laws = found.laws._replace(rested=rested)
        history.impacts = 0

    def _at_corners(
        self, here: Kinematics, struck: list[int], corners: CornerSides | None
    ) -> dict[str, int]:
        """Return the indices of struck equalities with `when` and kinks, by name.

        These equalities are projected onto the sides onto which the motion leads, as
        equalities without `when` are. A kink in positions counts only if the state is
        at its corner.

        here : all laws after the projection.
        struck : the laws that were struck before it.
        """
        if corners is None or not corners.may_bend:
            return {}
        known = here.arc.system.switches.corners
        names = {
            name
            for k, corner in known.items()
            if corner.moving or k in corners.corners
            for name in corner.rows
        }
        own = {self.laws[k].name: k for k in struck if here.table.equal[k]}
        return {name: k for name, k in own.items() if name in names}

    def _warn(
        self, here: Kinematics, active: list[int], result: Impact, found: StateAfter,
        *, ending: bool,
    ) -> None:  # fmt: skip
        """Add warnings of an impact that is not unique, or gains energy, to `found`.

        active : indices of the laws struck.
        result : the result of the impact.
        ending : whether the impact ends a series of bounces; then a gain is not
            reported.
        here : all laws just before the impact.
        """
        if result.open:
            self._report(found, IMPACT_ORDER, active, t=here.t)
        speeds = np.abs(here.rates[active]) + np.abs(result.after)
        # At the end of a series the contact is held, which may pull it down from its
        # last flight: no gain of energy is reported.
        if not ending and result.energy > COMPUTED_ZERO * (
            np.abs(result.impulses) @ speeds
        ):
            self._report(found, IMPACT_ENERGY, active, t=here.t, gained=result.energy)


class ImpactSolution(NamedTuple):
    """The impulses of r laws at a state, and the state after.

    Attributes
    ----------
    here : Kinematics
        The laws just before the impulses.
    rates : ndarray, shape (r,)
        The rates of the laws just before.
    result : Impact
        The impulses, and the rates after.
    y : ndarray, shape (size,)
        The state after the impulses.
    pushed : ndarray, shape (n,), or None
        The changes of all momenta by the laws, where rows change during the impact.
    """

    here: Kinematics
    rates: Floats
    result: Impact
    y: Floats
    pushed: Floats | None = None


def _solve_impact(
    here: Kinematics, active: list[int], e: Floats, equalities: list[int],
    stopped: Collection[int] = (), first: Floats | None = None,
    more: Floats | None = None,
) -> ImpactSolution:  # fmt: skip
    """Compute the impulses of r laws at a state, and the state after.

    Parameters
    ----------
    here : Kinematics
        All laws just before the impulses.
    active : list of int, length r
        The numbers of the r laws.
    e : ndarray, shape (r,)
        Their coefficients of restitution.
    equalities : list of int
        The indices in `active` of laws that are held as equalities.
    stopped : collection of int
        The corners of equalities at which the velocity across the surface is stopped,
        too.
    first : ndarray, shape (r,), or None
        The rates before an earlier part of the impact, by which contacts rebound.
    more : ndarray, shape (r,), or None
        The impulses of an expansion by Poisson's law.
    """
    matrix = here.delassus_along(stopped) if stopped else here.shape.delassus
    problem, response = here.problem(active, e, matrix)
    if equalities:
        problem = replace(problem, table=problem.table.with_equalities(equalities))
    rates, y = here.rates[active], here.y.copy()
    result = impact(problem, rates, here.still[active], first, more)
    y[here.arc.velocities] += response @ result.impulses
    return ImpactSolution(here, rates, result, y)


def _follow_curves(here: Kinematics, active: list[int]) -> ImpactSolution | None:
    """Compute the impulses of equalities whose rows depend on the velocities.

    An impulse is the limit of a large force in a short time. The velocities follow

        dv = M^-1 A(v)^T dLambda

    until the rates A vanish, all of them in proportion to their values before, with M
    and A for motions that the equalities without `when` admit. None where no velocities
    satisfy the rows, or another law is struck.

    here : all laws just before the impulses.
    active : the indices of the r laws on which impulses may act.
    """
    arc, n, equal = here.arc, here.arc.system.n, here.table.equal
    if any(here.strikes[k] and not equal[k] for k in active):
        return None
    rows = [k for k in active if equal[k]]
    rates, laws, function = here.rates[rows], np.zeros(here.count), arc.system.impulses

    def at(x: Floats) -> Kinematics:
        y = here.y.copy()
        y[arc.velocities] = x[:n]
        return here.at(y)

    def change(x: Floats) -> Floats:
        now = at(x)
        found = now.shape.delassus
        laws[rows] = given = least_squares(found.D[np.ix_(rows, rows)], -rates, None)
        jump = found.response[:, rows] @ given
        if function is None:
            return np.append(jump, laws)
        pushed = laws @ data_at(arc, now.y).rows[len(function.always) :]
        return np.concatenate([jump, laws, pushed])

    rest = 0 if function is None else len(arc.equations.q)
    x = np.append(here.y[arc.velocities], np.zeros(here.count + rest))
    try:
        x = followed(change, x, n)
    except np.linalg.LinAlgError:
        return None
    there = at(x)
    x[:n] -= there.shape.lift(rows, there.rates[rows])
    there = at(x)
    if any(there.strikes[k] for k in active):
        return None
    p = x[n : n + here.count][active]
    result = Impact(
        p, there.rates[active], open=False, energy=float(p @ here.rates[active]) / 2.0
    )
    pushed = x[n + here.count :] if rest else None
    return ImpactSolution(here, here.rates[active], result, there.y, pushed)


def _solve_impact_beside(
    corners: CornerSides,
    here: Kinematics,
    active: list[int],
    e: Floats,
    equalities: list[int],
) -> ImpactSolution:
    """Compute the impulses of laws where equalities have corners at the state.

    At a corner an equality has one row for each side; its row is that of the side on
    which the velocities after the impact continue. These sides remain in the memory of
    the arc. The compressions by Poisson's law are one jump, the expansions another.

    corners : the corners of equalities at the state.
    here, active, e, equalities : see `_solve_impact`.
    """
    first: Floats | None = None
    last: tuple[JumpPiece, ImpactSolution] | None = None
    result: Impact | None = None

    more: Floats | None = None
    expands = np.where((here.table.gapped & here.table.poisson)[active], e, 0.0)

    def jump(piece: JumpPiece) -> Floats:
        nonlocal last
        y = piece.y.copy()
        corners.project(y, piece.stopped)
        found = _solve_impact(
            here.at(y), active, e - expands, equalities, piece.stopped, first,
            None if more is None else piece.left * more,
        )  # fmt: skip
        last = piece, found
        return piece.y + piece.part * (found.y - piece.y)

    y = here.y
    while True:
        for state in corners.pieces(jump):
            assert last is not None
            y = state
            piece, found = last
            first = found.rates if first is None else first
            own = found.result.part(piece.part, found.rates)
            result = own if result is None else result.followed_by(own)
        assert first is not None
        assert result is not None
        if more is not None or not (expands * result.impulses).any():
            break
        more = expands * result.impulses
        corners.go_on(y)
    return ImpactSolution(found.here, first, result, y)


def _grazing(here: Kinematics, closed: list[bool], flown: float) -> dict[int, float]:
    """Return the depths of contacts in flight that turn back at the ground, by index.

    A depth within the error of a gap is no impact: the closing speed, of the order of
    the square root of the depth, would be a jump of a thousand times the tolerance. The
    depth must also be small enough for the rows of the table to satisfy the contact, at
    any tolerance. The force that turns the motion back has to act before the ground is
    reached: the result is empty on the surface of a switch, beyond which the forces
    differ.

    Parameters
    ----------
    here : Kinematics
        All laws at the state reached.
    closed : list of bool, length L
        Whether each law is closed.
    flown : float
        Duration of the flight so far.
    """
    system = here.arc.system
    struck = {k for k, on in enumerate(closed) if on and here.strikes[k]}
    if not struck or (system.p.slack[: system.acting_surfaces] > 0.0).any():
        return {}
    depths = {k: here.depth(k) for k in struck}
    least = here.largest_rise(min(CLOSING * here.arc.plan.tolerance, SATISFIED))
    found = {
        k: depth
        for k, depth in depths.items()
        if depth <= least[k] and -here.rates[k] <= TURNING * flown * here.present[k]
    }
    others = struck.difference(found)
    return {k: depth for k, depth in found.items() if not here.acts_on(k, others)}


def laws_at(arc: Arc) -> LawsAt:
    """Return the record of the laws at an instant, by the modes of the arc ended."""
    mode = arc.system.p.law_mode.copy()
    return LawsAt(mode, frozenset(np.flatnonzero(mode == kept.SLIDING).tolist()))


def rest_soon(arc: Arc, within: float) -> None:
    """Raise the speed at which slips on discs count as stopped.

    Slips that may stop within the time `within` are then at rest. The speed is raised
    where switches accumulate: a slip whose direction turns with the switches vanishes
    at their limit, and friction along the remaining slip would hide the effect of the
    switches.

    Parameters
    ----------
    arc : Arc
        The arc, in whose memory the speed is raised.
    within : float
        The time from now.
    """
    here, p = Kinematics(arc, arc.y), arc.system.p
    discs = [k for k, law in enumerate(arc.system.laws) if law.pair >= 0]
    slow = within * np.abs(here.present[discs])
    p.law_still[discs] = np.maximum(p.law_still[discs], slow)


def comes_to_rest(arc: Arc) -> bool:
    """Whether a closed law of friction or a limit has the rate 0, to rounding."""
    here = Kinematics(arc, arc.y)
    slow = here.table.bounded & (np.abs(here.rates) <= here.still)
    return bool((slow & here.closed).any())  # sliders without mass are not closed
