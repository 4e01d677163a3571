"""Impacts and mode selection of laws: contacts, friction, limits, freewheels.

In an arc each law has a mode (`program/laws.py`). At an instant the impacts of closing
laws are computed first (`Contacts.velocities`): their impulses change the velocities to
admissible ones. Then the accelerations decide which of the closed laws hold
(`Contacts.modes`). A contact whose rebound would be below the tolerance comes to rest:
the rest time of a ball with ever smaller bounces is the limit of a geometric series.
"""

from __future__ import annotations

import math
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
from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import impact, modes
from lagsim.mechanics.pieces import MARK, whole
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts import state as at
from lagsim.notes import Event
from lagsim.run.events.conditions import count_closed
from lagsim.run.events.impulses import transmit
from lagsim.run.events.kinematics import Kinematics
from lagsim.run.events.records import LawsAt, LawState
from lagsim.run.events.sequence import Flights, SwitchSequence
from lagsim.run.events.sliders import at_edge, select_sliding
from lagsim.run.events.slips import begin_slips
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
    SUM_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping

    from lagsim.language.arrays import Floats, Ints
    from lagsim.mechanics.contact import Impact, RowModes
    from lagsim.notes import Caution
    from lagsim.run.arc import Arc

    Ahead = Callable[[Floats], tuple[Floats, Floats]]
    from lagsim.codes.known import WarningCode

FORCING = (kept.HELD, kept.SLIDING)
HOLDING = (kept.HELD, kept.REDUNDANT)
# Kinds of laws that share loads, unless they have friction.
SHARING = (Kind.CONTACT, Kind.FREEWHEEL, Kind.LIMITED)
# Ratio of successive times ahead at which the change of forces is evaluated.
LATER = 10.0
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
    moved : bool
        Whether this may differ from the state reached.
    events, cautions
        The events, and the warnings.
    rows : ndarray or None
        Table rows just before an impact; None where no impact is reported.
    ending
        The reason why the motion cannot continue, or None.
    laws : LawsAt
        The laws at the instant.
    state : LawState or None
        The laws at the state reached, after their impacts.
    """

    y: Floats
    laws: LawsAt
    moved: bool = True
    events: list[Event] = field(default_factory=list)
    cautions: list[Caution] = field(default_factory=list)
    rows: Floats | None = None
    ending: Ending | None = None
    state: LawState | None = None

    def decision(self, arc: Arc) -> Decision:
        """Return the decision of the run that follows from this record.

        Raises
        ------
        InputError
            If no motion can begin at the start of the run.
        """
        if self.ending is not None and arc.steps == 0:
            why = f"{self.ending.about}: {self.ending.outcome.advice}"
            text = f"no motion exists from this start on: {why}"
            raise InputError([Problem(NO_MOTION, text)])
        y = self.y if self.moved else None
        sizes = None if y is None else np.maximum(arc.sizes, np.abs(y))
        return Decision(
            events=tuple(self.events), cautions=tuple(self.cautions), y=y,
            sizes=sizes, rows=self.rows, ending=self.ending,
        )  # fmt: skip


class Contacts(Source):
    """Source of a run that computes the impacts of its laws and selects their modes.

    Attributes
    ----------
    sequence : SwitchSequence
        The last ends of modes of laws, by which accumulations are found.
    bounces : list of int
        The number of impacts of each law since it was at rest.
    flights : list of Flights
        The last flights of each law.
    modes_at_start : dict
        The modes of the file at the start, at which the examination of the start has
        checked all laws in force.
    """

    def __init__(self, arc: Arc) -> None:
        self.laws = arc.system.laws
        self.sequence = SwitchSequence(arc.settings.start, arc.settings.duration)
        self.bounces = [0] * len(self.laws)
        self.flights = [Flights() for _ in self.laws]
        laws = enumerate(self.laws)
        self.contacts = [k for k, law in laws if law.kind is Kind.CONTACT]
        self.modes_at_start = arc.modes
        p = arc.system.p
        p.law_mode[:] = p.law_direction[:] = p.law_still[:] = p.impulses[:] = 0.0
        p.law_floor[:] = p.law_opens[:] = 0.0

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Return the decision to settle the end of a law's mode; else None."""
        k = int(arc.state.switched) - 1 - arc.system.surfaces
        if code != at.SWITCH_FOUND or k < 0:
            return None
        return Decision(turn=Turn.SETTLE, located=Located(law=k))

    def approach(self, arc: Arc) -> bool:
        """Whether a closed law approaches at the state reached."""
        here = Kinematics(arc, arc.y)
        closed = here.is_closed()
        return any(
            closed[k] and law.kind.strikes and here.strikes(k)
            for k, law in enumerate(self.laws)
        )

    def located(self, arc: Arc, laws: LawsAt, k: int) -> LawsAt:
        """Store that the mode of law k has ended, and return the laws at the instant.

        A law that was located counts as closed. The end of a slip on a disc ends the
        regularized beginnings of the slips that have begun with it.
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
        """Return the ending of a run whose laws' modes end too often."""
        span = self.sequence.span
        restless = [k for k in self.contacts if self.flights[k].is_restless(span)]
        if not (restless or self.sequence.is_stuck()):
            return None
        about = self._names(restless or self.sequence.lately())
        return Ending(Outcome.SWITCHES_ACCUMULATE, about)

    def _report(
        self, found: StateAfter, code: WarningCode, some: list[int], **numbers: float
    ) -> None:
        """Add a warning about some laws, once for each text.

        Parameters
        ----------
        found : StateAfter
        code : str
            A key of `WARNINGS`.
        some : list of int
            Numbers of the laws.
        **numbers
            Fields of the text.
        """
        text = WARNINGS[code].format(names=self._names(some), **numbers)
        found.cautions += self.once(code, text)

    def _names(self, some: Collection[int]) -> str:
        return quoted(self.laws[k].name for k in some)

    def velocities(
        self, arc: Arc, laws: LawsAt, met: int, *, decided: bool
    ) -> StateAfter:
        """Compute the impacts of all laws that approach at the state reached.

        Parameters
        ----------
        arc : Arc
        laws : LawsAt
        met : int
            Number of the law whose mode has ended, or -1.
        decided : bool
            Whether all sides are decided on which the bounds of laws may depend.
        """
        here, found = Kinematics(arc, arc.y), StateAfter(arc.y.copy(), laws)
        corrected = _corrected_state(here, met)
        if corrected is not None:
            found.y, here = corrected, Kinematics(arc, corrected.copy())
        arc.system.p.law_opens[:] = 0.0
        recent = (t for t, _ in reversed(self.sequence.recent) if t < arc.t)
        flown = arc.t - next(recent, arc.settings.start)
        closed = here.is_closed(laws.closed)
        here.grazing = _grazing(here, closed, flown)
        if here.grazing:
            found.laws = laws = laws._replace(
                closed=laws.closed.difference(here.grazing)
            )
            closed = here.is_closed(laws.closed)
        ends = self._ends(here, closed)
        judged = self._is_examined(arc)
        for k, law in enumerate(self.laws):
            if closed[k] and not judged and self._jumps(here, k):
                found.ending = Ending(Outcome.CONSTRAINT_JUMPS, law.name)
                return found
        some = [k for k, law in enumerate(self.laws) if closed[k] or law.slider]
        # Whether the bound of a law falls depends on sides that are decided later.
        if wrong := here.out_of_range(some, laws.closed if decided else ()):
            found.ending = Ending(Outcome.LAW_OUT_OF_RANGE, wrong)
            return found
        some = [k for k in some if closed[k] and self.laws[k].kind.strikes]
        if any(here.strikes(k) for k in some):
            free = {
                k
                for k, law in enumerate(self.laws)
                if law.kind is Kind.FREEWHEEL and here.in_force[k]
            }  # the impact may engage a freewheel
            here = self._strike(here, sorted(free.union(some)), ends, found)
        if any(law.slider for law in self.laws):
            here = self._settled(here, found)
        if found.rows is not None and laws.shared is not None:
            found.laws = found.laws._replace(shared=None)
        found.state = LawState(here, some)
        return found

    def modes(self, arc: Arc, laws: LawsAt, state: LawState) -> StateAfter:
        """Select the modes of laws by the accelerations at the state reached.

        Parameters
        ----------
        arc : Arc
        laws : LawsAt
        state : LawState
            The laws at this state, none of which approaches.
        """
        here, some = state
        found = StateAfter(arc.y, laws, moved=False)
        p, slid = arc.system.p, laws.slid
        if laws.shared is None or here.grazing:
            chosen = _chosen(here, that_could_act(here, laws.closed), laws.left)
        else:
            chosen = Chosen.of(here, *laws.shared)
        put_modes(arc, chosen)
        _set_floors(here, chosen, slid)
        _set_slack(here, chosen)
        p.law_pushes[p.positions] = p.law_pushes[p.velocities] = here.moves
        held = np.flatnonzero(p.law_mode == kept.HELD).tolist()
        if not slid.isdisjoint(held):
            found.y, found.moved = self._stopped(here, held, slid), True
        events = _changes(here, laws.mode) if arc.steps else ()
        found.laws = laws._replace(mode=p.law_mode.copy(), shared=None)
        found.events += [e for e in events if e.constraint not in laws.rested]
        if chosen.paradox:
            found.ending = Ending(Outcome.PARADOX, self._names(some))
        # The friction of a body that rests on two points is never determined.
        redundant = [k for k in chosen.some if chosen.mode[k] == kept.REDUNDANT]
        kinds = {self.laws[k].kind for k in redundant}
        shares = any(kind.one_sided for kind in kinds)
        p.law_shared[:] = p.law_shares = 0.0
        if redundant:
            rubs = {law.normal for law in self.laws if law.kind is Kind.SLIP}
            bear = [k for k in held if k not in rubs and self.laws[k].kind in SHARING]
            p.law_shared[redundant] = here.are_spanned(redundant, bear)
            p.law_shares = p.law_shared.max()
        if shares or chosen.open:
            code: WarningCode = SHARED_FRICTION if chosen.open else SHARED_CONTACT
            self._report(found, code, chosen.some if chosen.open else some, t=arc.t)
        return found

    def _stopped(
        self, here: Kinematics, held: list[int], slid: Collection[int]
    ) -> Floats:
        """Return the state (size,) in which laws that slid until now are at rest.

        held, slid : numbers of laws that hold from now on, and that slid until now.
        """
        y, velocities = here.arc.y.copy(), here.arc.velocities
        stopped = [k in slid and self.laws[k].pair >= 0 for k in held]
        if any(stopped):  # the remaining speed of a slip that stops is removed
            asked = np.where(stopped, here.rates[held], 0.0)
            y[velocities] -= here.shape.lift(held, asked)
        _stop(here, y, [k for k in held if k in slid])
        return y

    def _settled(self, here: Kinematics, found: StateAfter) -> Kinematics:
        """Return the kinematics after sliders without mass have changed their modes.

        The state, events and ending are stored in `found`.
        """
        arc, before = here.arc, found.y
        settled = select_sliding(arc, before)
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

        That examination uses the residuals left by the solution for the guesses; at a
        state that has not moved yet there are no ranges to compare a residual with.
        Events may have set other modes at the start since.
        """
        at_start = arc.steps == 0 and arc.t == arc.settings.start
        return at_start and arc.modes == self.modes_at_start

    def _jumps(self, here: Kinematics, k: int) -> bool:
        """Whether the residual of a law now in force exceeds the location tolerance.

        Then its function jumps there, or it was closed in flight, and no motion can
        continue. The energy of other bodies does not enter the tolerance.
        """
        kind, rtol, part = self.laws[k].kind, here.arc.plan.rtol, SATISFIED
        if kind is Kind.CONTACT and rtol is not None:
            part = CLOSING * max(rtol, LEAST_CLOSING)
        return kind in (Kind.TIMED, Kind.CONTACT) and here.is_off(k, part)

    def _ends(self, here: Kinematics, closed: list[bool]) -> dict[int, float]:
        """Return the end time of each series of bounces that ends with this impact.

        Each contact is judged by its own flights. All series that end are ended at this
        impact, as one accumulation; the result is empty if none of them strikes now.
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
        for k in struck.intersection(ends):
            self.flights[k].rests.append(t)
        return ends

    def _strike(
        self,
        here: Kinematics,
        some: list[int],
        ends: dict[int, float],
        found: StateAfter,
    ) -> Kinematics:
        """Compute and apply the impulses of some laws; return the laws after them.

        Parameters
        ----------
        here : Kinematics
            The laws just before the impact.
        some : list of int
            Numbers of the laws with impulses.
        ends : dict of int to float
            End times of the series of bounces that end with this impact.
        found : StateAfter
            Its state, rows, events and warnings are updated.
        """
        arc, y, lift = here.arc, found.y, here.shape.lift
        before = y.copy()
        found.rows = arc.runner.tabulate(arc.row())
        stopped = ends
        struck = [k for k in some if here.strikes(k)]
        rests = {k: here.rest(k, float(here.restitutions[k])) for k in struck}
        ends = {k: arc.t + left for k, left in rests.items() if left is not None}
        ends |= stopped
        e = [0.0 if k in ends else here.restitutions[k] for k in some]
        problem, response = here.problem(some, np.array(e), here.shape.reply)
        if stopped:
            # A contact whose series ends is held as an equality; a slip has the
            # friction of the impulses that remain in its series.
            kinds = [Kind.TIMED if k in ends else self.laws[k].kind for k in some]
            problem = replace(problem, kinds=tuple(kinds))
        rates = here.rates[some]
        result = impact(problem, rates, here.still[some])
        # A flight that begins below the ground by rounding would end deeper by as much.
        deep = [k for k in some if k in self.contacts and here.gaps[k] < 0.0]
        if deep:
            y[arc.state.positions] -= lift(deep, here.gaps[deep])
        y[arc.velocities] += response @ result.impulses
        there = here.at(y)
        if deep:
            left = rates + problem.D @ result.impulses
            there = _kept_at_rest(
                there, np.array(some)[np.abs(left) <= here.still[some]]
            )
        changes = arc.add_work(y, arc.energies(before, found.rows[0]))
        self._store(arc, before, y, some, result.impulses)
        met = [k for k in struck if k in self.contacts]
        closed = y.copy()
        closed[arc.state.positions] -= lift(met, here.gaps[met] + here.slack[met])
        count_closed(arc, y, closed)
        sizes = [abs(impulse) for impulse in result.impulses.tolist()]
        largest = max(sizes)
        for i, k in enumerate(some):
            kind, name = self.laws[k].kind, self.laws[k].name
            if kind is Kind.SLIP or sizes[i] <= SOLUTION_ROUNDOFF * largest:
                continue
            event = Event(
                arc.t, "impact", name, rate_before=float(rates[i]),
                rate_after=float(result.after[i]), energy=float(changes.sum()),
            )  # fmt: skip
            found.events.append(event)
            self.bounces[k] += 1
            if k in ends:
                if self.bounces[k] > SERIES:
                    found.events.append(Event(ends[k], "zeno", name))
                    rested = found.laws.rested | {name}
                    found.laws = found.laws._replace(rested=rested)
                self.bounces[k] = 0
        if not result.found:
            found.ending = Ending(Outcome.PARADOX, self._names(some))
        elif not result.impulses.any():
            found.rows = None  # the closing rates were rounding of their body's others
        self._warn(here, some, result, found, ending=bool(stopped))
        return there

    def _store(
        self, arc: Arc, before: Floats, y: Floats, some: list[int], impulses: Floats
    ) -> None:
        """Store the impulses (r,) of the laws `some`, and the impulses of equalities.

        before, y : ndarray, shape (size,), the states before and after the impact.
        """
        p = arc.system.p
        given = np.zeros(len(self.laws))
        given[some] = impulses
        if arc.system.impulses is not None:
            transmit(arc, before, y, given)
        p.impulses[some] = given[some] + (p.impulses[some] if p.kicked else 0.0)

    def _warn(
        self, here: Kinematics, some: list[int], result: Impact, found: StateAfter,
        *, ending: bool,
    ) -> None:  # fmt: skip
        """Add warnings of an impact that is not unique, or that gains energy."""
        if result.open:
            self._report(found, IMPACT_ORDER, some, t=here.t)
        speeds = np.abs(here.rates[some]) + np.abs(result.after)
        # The end of a series is held, and may be pulled down from its last flight.
        if not ending and result.energy > COMPUTED_ZERO * (
            np.abs(result.impulses) @ speeds
        ):
            self._report(found, IMPACT_ENERGY, some, t=here.t, gained=result.energy)


def _grazing(here: Kinematics, closed: list[bool], flown: float) -> dict[int, float]:
    """Return the depths of contacts in flight that turn back at their ground.

    A depth within the error of a gap is no impact: the closing speed, of the order of
    the square root of the depth, would be a jump of a thousand times the tolerance.
    However loose the tolerance is, the rows satisfy the contact. The force that turns
    the motion back has to act before the ground is reached: the result is empty on the
    surface of a switch, beyond which the forces differ.

    Parameters
    ----------
    here : Kinematics
    closed : list of bool, length L
        Whether each law is closed.
    flown : float
        Duration of the flight so far.
    """
    system = here.arc.system
    struck = {k for k in range(here.count) if closed[k] and here.strikes(k)}
    if not struck or (system.p.slack[: system.surfaces] > 0.0).any():
        return {}
    depths = {k: here.depth(k) for k in struck}
    part = min(CLOSING * here.arc.plan.tolerance, SATISFIED)
    found = {
        k: depth
        for k, depth in depths.items()
        if depth <= here.least(k, part)
        and -here.rates[k] <= TURNING * flown * here.present[k]
    }
    others = struck.difference(found)
    return {k: depth for k, depth in found.items() if not here.acts_on(k, others)}


def laws_at(arc: Arc) -> LawsAt:
    """Return the laws at an instant, by the modes of the arc that has ended."""
    mode = arc.system.p.law_mode.copy()
    return LawsAt(mode, frozenset(np.flatnonzero(mode == kept.SLIDING).tolist()))


def put_modes(arc: Arc, chosen: Chosen) -> None:
    """Store selected modes in the parameters that the kernels read."""
    p = arc.system.p
    own = p.law_place < 0.0  # the modes of sliders are set by `select_sliding`
    p.law_mode[own], p.law_direction[own] = chosen.mode[own], chosen.direction[own]
    p.law_forces = float(any(mode in FORCING for mode in chosen.mode.tolist()))


def rest_soon(arc: Arc, within: float) -> None:
    """Set the slips on discs that may stop within this time to be at rest.

    This applies where switches accumulate: a slip whose direction turns with the
    switches vanishes at their limit, and friction along the remaining slip would hide
    the effect of the switches.

    Parameters
    ----------
    arc : Arc
    within : float
        The time.
    """
    here, p = Kinematics(arc, arc.y), arc.system.p
    discs = [k for k, law in enumerate(arc.system.laws) if law.pair >= 0]
    slow = within * np.abs(here.present[discs])
    p.law_still[discs] = np.maximum(p.law_still[discs], slow)


def _corrected_state(here: Kinematics, met: int) -> Floats | None:
    """Return the state (size,) corrected for errors of the step that just ended.

    None where there is nothing to correct. met : the index of the law whose mode has
    ended, or -1.
    """
    if here.arc.system.p.law_opens.any():
        return _raised_state(here)
    if met >= 0 and _is_stopping(here, met):
        return _straightened_state(here, met)
    return None


def _raised_state(here: Kinematics) -> Floats:
    """Return the state (size,) in which contacts just opened have gap and rate >= 0.

    Errors of a step may leave such contacts below ground, or approaching.
    """
    state, p = here.arc.state, here.arc.system.p
    y, held = here.y.copy(), np.flatnonzero(p.law_mode == kept.HELD)
    levels = (state.positions, here.residuals), (state.velocities, here.rates)
    for level, values in levels:
        low = np.flatnonzero((p.law_opens > 0.0) & (values < 0.0))
        if len(low):
            asked = np.append(values[low], np.zeros(len(held)))
            y[level] -= here.shape.lift([*low, *held], asked)
    return y


def _stop(here: Kinematics, y: Floats, stopped: Collection[int]) -> None:
    """Set the velocities in y that laws hold from now on to their exact values.

    These are velocities that a single law determines: a switch at 0 of such a velocity
    is decided by 0, and not by the rounding of the time at which it stopped.

    Parameters
    ----------
    here : Kinematics
    y : ndarray, shape (size,)
    stopped : collection of int
        Laws that slid until now and hold from now on.
    """
    v = y[here.arc.velocities]
    for k in stopped:
        row, rate = here.rows[k], here.rates[k]
        [*places] = np.flatnonzero(row)
        if len(places) == 1 and abs(rate) <= here.still[k]:
            [j] = places
            moves = rate != row[j] * v[j]  # the surface on which it rests moves
            v[j] = v[j] - rate / row[j] if moves else 0.0
    y[here.arc.velocities] = v


def comes_to_rest(arc: Arc) -> bool:
    """Whether the rate of a law that slides is 0 at this instant, but for rounding."""
    here = Kinematics(arc, arc.y)
    return any(
        closed and law.kind in (Kind.SLIP, Kind.LIMITED) and abs(rate) <= still
        for closed, law, rate, still in zip(
            here.is_closed(), here.laws, here.rates, here.still, strict=True
        )
    )


def _is_stopping(here: Kinematics, k: int) -> bool:
    """Whether the slip of law k stops before a position changes by more than rounding.

    k : the index of a slip on a disc whose mode has ended.
    """
    pair, p = [k, here.laws[k].pair], here.arc.system.p
    if pair[1] < 0 or p.law_mode[k] != kept.SLIDING:
        return False
    speed = float(np.linalg.norm(here.rates[pair]))
    places = here.shape.slopes[pair] @ here.seen[here.arc.state.positions]
    back = float(np.linalg.norm(here.present[pair]))
    short = speed**2 <= 2.0 * back * SUM_ROUNDOFF * float(places.max())
    return short and speed > p.law_still[k]


def _straightened_state(here: Kinematics, k: int) -> Floats:
    """Return the state (size,) with a slip on a disc turned to its last direction.

    In the step that ends at the stop of a slip, rounding turns the last directions of
    its friction, and thus the slip.

    Parameters
    ----------
    here : Kinematics
    k : int
        The number of one of the two laws of the slip.
    """
    y, pair = here.y.copy(), [k, here.laws[k].pair]
    along = here.arc.system.p.law_direction[pair]
    across = here.rates[pair] - along * (along @ here.rates[pair])
    y[here.arc.velocities] -= here.shape.lift(pair, across)
    return y


def _kept_at_rest(here: Kinematics, stopped: Ints) -> Kinematics:
    """Return the laws with the velocities of `here.y` corrected, in place.

    Corrections of gaps may have changed the rates of stopped laws, which become 0.

    stopped : ndarray of int, shape (r,), the numbers of these laws.
    """
    rates = here.rates[stopped]
    if not (np.abs(rates) > here.still[stopped]).any():
        return here
    here.y[here.arc.velocities] -= here.shape.lift(stopped.tolist(), rates)
    return here.at(here.y)


# --- Mode selection: which laws hold from a state on, by the accelerations


def _state_after(here: Kinematics, some: list[int], p: Floats, moment: float) -> Floats:
    """Return the state (size,) a short time later, to second order.

    p : ndarray, shape (r,), the multipliers of the laws `some`. moment : the time.
    """
    rates = here.free.copy()
    rates[here.arc.velocities] += here.answer.response[:, some] @ p
    return here.arc.later(here.y, rates, moment)


def ahead_of(
    here: Kinematics, some: list[int],
    others: Callable[[Kinematics, Floats], Floats] = lambda _here, _forced: np.zeros(0),
) -> Ahead:  # fmt: skip
    """Return a function that maps multipliers (r,) to d/dt of accelerations.

    The function returns these rates (k + r,) of `others` and of laws, and the rounding
    bounds (r,) of those of laws. Each bounded multiplier keeps its ratio to its bound.

    Parameters
    ----------
    here : Kinematics
    some : list of int, length r
        Numbers of the laws.
    others : callable
        Function of a `Kinematics` and of the accelerations (n,) by the multipliers,
        which returns the rates (k,) of other rows. They come first in the result.
    """
    moment = here.arc.moment

    def change(p: Floats) -> tuple[Floats, Floats]:
        y = _state_after(here, some, p, moment)
        later = here.at(y, here.t + moment)
        w = []
        for x in here, later:
            part, known = np.ones(len(some)), here.bounds[some] > 0.0
            part[known] = x.bounds[some][known] / here.bounds[some][known]
            D, response = x.answer.D[np.ix_(some, some)], x.answer.response[:, some]
            more = others(x, response @ (part * p))
            w.append(np.append(more, x.accelerations[some] + D @ (part * p)))
        return (w[1] - w[0]) / moment, 2.0 * here.roundoff[some] / moment

    return change


def that_could_act(here: Kinematics, also: Collection[int]) -> list[int]:
    """Return the indices of the laws that are closed and do not separate.

    Laws of `also` count as closed whatever their gaps are. A slip could act only where
    its contact could.
    """
    closed, some = here.is_closed(also), list[int]()
    for k, law in enumerate(here.laws):
        leaves = law.kind.one_sided and here.rates[k] > here.still[k]
        if law.kind is Kind.SLIP:
            leaves = law.normal not in some
        if closed[k] and not leaves:
            some.append(k)
    return some


class Chosen(NamedTuple):
    """Selected modes of all laws, with the multipliers that justify them.

    Attributes
    ----------
    mode, direction : ndarray, shape (L,)
        Mode of each law, and the direction of its friction or limit.
    some : list of int, length r
        Numbers of the laws that could act.
    multipliers, D : ndarray, shape (r,)
        Their multipliers, and the diagonal of their matrix D, accelerations per
        multiplier.
    paradox, open : bool
        Whether there is a paradox of Painlevé's (see `mechanics.contact.RowModes`);
        whether the motion is not unique.
    """

    mode: Floats
    direction: Floats
    some: list[int]
    multipliers: Floats
    D: Floats
    paradox: bool
    open: bool = False

    @classmethod
    def of(cls, here: Kinematics, some: list[int], found: RowModes) -> Chosen:
        """Return the modes of all laws from the modes of the laws `some`.

        Others are off.

        found : its first rows belong to the laws `some`.
        """
        mode, direction = np.zeros((2, here.count))
        r = len(some)
        mode[some] = [float(x) for x in found.mode[:r]]
        direction[some] = found.direction[:r]
        D = here.answer.D.diagonal()[some]
        return cls(
            mode, direction, some, found.multipliers[:r], D, found.paradox, found.open
        )


def _chosen(here: Kinematics, some: list[int], left: Mapping[int, int]) -> Chosen:
    """Select the modes by the accelerations of the laws `some`, which could act.

    `left`: how often each law has reached the limit of its multiplier at this time.
    """
    if not some:
        none = np.empty(0)
        mode, direction = np.zeros((2, here.count))
        return Chosen(mode, direction, some, none, none, paradox=False)
    laws, asked = here.acting(some, left), here.accelerations[some]
    asked = np.where(np.abs(asked) <= laws.roundoff, 0.0, asked)
    found = modes(
        laws.closed, asked, laws.rates, laws.roundoff, laws.slow,
        ahead_of(here, some), laws.left,
    )  # fmt: skip
    return Chosen.of(here, some, found)


def _set_floors(here: Kinematics, found: Chosen, slid: Collection[int]) -> None:
    """Store the speeds at which slips on a disc count as begun, and as stopped.

    A slower slip has no direction but rounding, and friction would turn it into the
    direction of its force at once, for which explicit steps are too long. Up to
    `laws.BEGUN` times the least speed a slip keeps its first direction. The error of
    its path is the power 3/2 of the relative speed, compared with the path in the time
    in which forces change. Friction on a slower slip would make a fixed step unstable,
    whose stability bound is 2.

    Parameters
    ----------
    here : Kinematics
    found : Chosen
        The modes selected.
    slid : collection of int
        Laws that slid until this time.
    """
    arc, p = here.arc, here.arc.system.p
    floors, stills = np.zeros(here.count), np.zeros(here.count)
    begun, steady = [], math.inf
    rtol = float(arc.plan.tolerance)
    for k, law in enumerate(here.laws):
        pair = [k, law.pair]
        if law.pair < k:
            continue
        if kept.SLIDING not in found.mode[pair]:
            if k in slid or law.pair in slid:  # stops; selection may be repeated
                stills[pair] = p.law_still[k]
            continue
        speed = float(np.linalg.norm(here.rates[pair]))
        if k in slid or law.pair in slid:
            # The regularized beginning of a slip ends at any other event.
            floors[pair] = p.law_floor[k] if math.isinf(p.law_lasts[k]) else 0.0
            stills[pair] = p.law_still[k]
            continue
        places = [found.some.index(j) for j in pair]
        rubs = float(np.linalg.norm((found.multipliers * found.D)[places]))
        if rubs == 0.0:
            continue
        changes = _steady(here, found, pair, rubs)
        scale = rubs * changes
        # A slower slip would turn and stop in fewer roundings of t than steps need.
        rounded = 4.0 * CLEAR_OF_ROUNDING * rubs * math.ulp(arc.settings.end)
        floor = max(rtol ** (2.0 / 3.0) * scale, 4.0 * max(here.still[k], rounded))
        floor = max(floor, rtol * float(np.max(here.reach[1][pair])))
        floor = max(floor, rubs * (arc.plan.step or 0.0) / 2.0)
        stills[pair] = max(rtol * scale, rounded)
        if speed < floor:
            floors[pair] = floor
            begun.append(pair)
            steady = min(steady, changes)
    p.law_floor[:], p.law_still[:], p.law_lasts[:] = floors, stills, math.inf
    p.law_turn[:] = 0.0
    if begun and here.t < arc.settings.end:
        places = [found.some.index(k) for pair in begun for k in pair]
        friction = np.linalg.norm(found.multipliers[places].reshape(-1, 2), axis=1)
        begin_slips(here, np.array(begun), friction, steady)


def _steady(here: Kinematics, found: Chosen, pair: list[int], rubs: float) -> float:
    """Return the time in which the forces on a slip change by as much as its friction.

    Evaluated at ever later times, since a force may begin to change at a rate of 0.

    Parameters
    ----------
    here : Kinematics
    found : Chosen
        The modes selected.
    pair : list of int, length 2
        The two laws of the slip on a disc.
    rubs : float
        Deceleration of the slip by its friction.
    """
    moment, steady = here.arc.moment, here.arc.settings.end - here.t
    while moment < steady:
        y = _state_after(here, found.some, found.multipliers, moment)
        later = here.at(y, here.t + moment)
        bends = later.accelerations - here.accelerations
        change = float(np.linalg.norm(bends[pair])) / moment
        if not math.isfinite(change):  # the forces are undefined so far ahead
            return moment
        steady = min(steady, rubs / change) if change > 0.0 else steady
        moment *= LATER
    return steady


def _set_slack(here: Kinematics, found: Chosen) -> None:
    """Store the slacks and bands of laws, so that rounding ends no mode."""
    arc, p, K = here.arc, here.arc.system.p, here.arc.system.surfaces
    slack = p.slack[K:]
    slack[:] = 0.0
    size, band, rounding = np.zeros((3, here.count))
    push = dict(zip(found.some, found.D, strict=True))
    for k, mode in enumerate(found.mode.tolist()):
        law = here.laws[k]
        if mode == kept.HELD and push[k] > 0.0:
            size[k] = band[k] = here.roundoff[k] / push[k]
        elif law.slider:
            speed = here.seen[arc.velocities][law.slider.coordinate]
            size[k] = band[k] = SUM_ROUNDOFF * speed
            if p.law_direction[k] == 0.0:  # lossless: it may return to its limit
                size[k], band[k] = (
                    np.array([SUM_ROUNDOFF, at_edge(arc)]) * here.bounds[k]
                )
        elif mode == kept.SLIDING:
            size[k] = here.still[k]
            band[k] = 0.5 * p.law_floor[k]  # its direction is kept so far back
        elif mode == kept.OFF and law.kind.one_sided:
            position = law.kind is Kind.CONTACT
            rounding[k] = here.slack[k] if position else here.still[k]
            if here.gaps[k] <= rounding[k]:  # a gap that has not opened yet has a slack
                size[k] = max(rounding[k], math.ulp(0.0))
            size[k] += 2.0 * here.grazing.get(k, 0.0)
            if not here.in_force[k]:  # `when` is constant in an arc
                size[k] = math.inf
    event_functions = arc.runner.event_functions(arc.t, here.y)[K:]
    slack[:] = size + 2.0 * np.maximum(0.0, -event_functions)
    p.band[K:], p.law_rounding[:] = band, rounding


def _changes(here: Kinematics, before: Floats) -> Iterator[Event]:
    """Return events of constraints that now hold and did not before, or the reverse.

    `before`, shape (L,): the modes before.
    """
    t, now = here.arc.t, here.arc.system.p.law_mode
    if (now == before).all():
        return
    was_on, is_on = (
        {whole(here.laws[k].row.name) for k in np.flatnonzero(x).tolist()}
        for x in (before, now)
    )
    told = was_on & is_on  # possibly on another piece of the gap
    for k, law in enumerate(here.laws):
        name = law.name
        if law.kind.bounded:
            was, holds = before[k] in HOLDING, now[k] in HOLDING
            if 0 <= law.pair < k:
                continue
            if was and now[k] == kept.SLIDING:
                yield Event(t, "slip", name)
            elif before[k] == kept.SLIDING and holds:
                yield Event(t, "stick", name)
        elif (before[k] == kept.OFF) != (now[k] == kept.OFF):
            if MARK not in law.row.name or name not in told:
                yield Event(t, "contact" if now[k] != kept.OFF else "release", name)
            told.add(name)
