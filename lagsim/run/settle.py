"""What happens at one instant: `settle`, whose code reads as docs/events.md.

An arc ends where something must be decided. `settle` decides all of it at that time and
in that state, in seven phases, each of which receives the record of the instant and
returns the next one (`instant.InstantRecord`):

    1 acts        events of the file that are due, in the order of the file
    2 sides       branches of t, then the side of each switching surface
    3 velocities  one problem of impulses: equalities that jump, laws that approach
    4 modes       the modes of laws, by the accelerations; then the sides of steps (as
                  of `sign`) that conditions and output alone contain
    5 ties        within 2 and 4: by the rates of the tied rows, then by a rule
    6 repeat      events that these phases have made due act at the same instant
    7 bookkeep    rows before and after jumps, and lists, all with one time

Each phase selects modes (of the file, branches of t, of surfaces and laws) and the
truth of conditions in the memory of the arc (`modes.Selection`), which compiled
functions and the kernels of the next arc read. Then `carried_out` alone writes the
state there. docs/events.md lists who writes each word.
"""

from __future__ import annotations

from functools import wraps
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeVar

import numpy as np

from lagsim.mechanics.equations import may_jump
from lagsim.run.events.constraints import (
    at_start,
    before_event,
    inelastic_impact,
    row_of,
)
from lagsim.run.events.corner_sides import CornerSides
from lagsim.run.events.records import NO_SURFACES, NOTHING, Due
from lagsim.run.failures import end_of_table
from lagsim.run.instant import InstantRecord
from lagsim.run.modes import ArcModes, Selection, TrialModes, write
from lagsim.run.trajectory import (
    GO_ON,
    NOWHERE,
    STARTED,
    Decision,
    Ending,
    Outcome,
    quoted,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc
    from lagsim.run.events.contacts import Contacts
    from lagsim.run.events.records import Before, SurfacesAt
    from lagsim.run.events.shown_sides import ShownSides
    from lagsim.run.events.switching import Switching
    from lagsim.run.events.times import KnotTimes, TimeBreaks
    from lagsim.run.events.transitions import Transitions
    from lagsim.run.trajectory import JumpImpulses, Located

P = ParamSpec("P")
T = TypeVar("T")

# Largest number of jumps of velocities at one instant, in one pass.
MOST_JUMPS = 40
# Words in the messages of Python, numpy and scipy about numbers that are out of range,
# in a ValueError or its subclass LinAlgError.
OUT_OF_RANGE = ("NaN", "infs", "math domain")


class Deciders(NamedTuple):
    """The parts of a run that decide at an instant; None for parts without use.

    Attributes
    ----------
    knots, breaks
        The branches of t: cells of tables that kernels pass, and all others.
    transitions
        The events of the file.
    switching
        The surfaces of switches in the state.
    shown
        The sides of functions with jumps that occur in conditions and output alone.
    contacts
        The laws: contacts, friction, limits, freewheels, relations with `when`.
    jumping : bool
        Whether an equality of the model or its rate may jump.
    ends : bool
        Whether the model has tables that end the run beyond their points.
    """

    knots: KnotTimes | None = None
    breaks: TimeBreaks | None = None
    transitions: Transitions | None = None
    switching: Switching | None = None
    shown: ShownSides | None = None
    contacts: Contacts | None = None
    jumping: bool = False
    ends: bool = False


def unless_overflow(work: Callable[P, T]) -> Callable[P, T | Ending]:
    """Decorate the stage `work` of a run: an overflow in Python ends the run.

    Kernels check each state themselves. Events are computed in Python, which raises
    ArithmeticError or ValueError where numpy returns inf and nan.
    """

    @wraps(work)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> T | Ending:
        try:
            return work(*args, **kwargs)
        except (ArithmeticError, ValueError) as error:
            if not is_overflow(error):
                raise
            return Ending(Outcome.NOT_FINITE)

    return guarded


def is_overflow(error: Exception) -> bool:
    """Whether an exception reports a number that is out of range."""
    if isinstance(error, ArithmeticError | np.linalg.LinAlgError):
        return True
    return any(word in str(error) for word in OUT_OF_RANGE)


def phase(
    work: Callable[[InstantRecord, Deciders], InstantRecord],
) -> Callable[[InstantRecord, Deciders], InstantRecord]:
    """Decorate the phase `work`, which then does nothing once the run has ended.

    An overflow in the phase ends the run, see `unless_overflow`.
    """

    @wraps(work)
    def guarded(now: InstantRecord, by: Deciders) -> InstantRecord:
        if now.ending is not None:
            return now
        try:
            return work(now, by)
        except (ArithmeticError, ValueError) as error:
            if not is_overflow(error):
                raise
            return now.replaced(ending=Ending(Outcome.NOT_FINITE))

    return guarded


# --- The record of an instant


def first_record(arc: Arc, last: InstantRecord, located: Located) -> InstantRecord:
    """Return the record with which an instant begins, at the end of an arc.

    Parameters
    ----------
    arc : Arc
        The arc that has ended, at the time of the instant.
    last : InstantRecord
        The record of the last instant. If no time has passed since, that instant
        continues: the acts, surfaces and laws in its record still count.
    located : Located
        The event function that has ended the arc.
    """
    alone = located.law >= 0 and not (arc.system.acting_surfaces or arc.t >= arc.end)
    if last.t != arc.t:
        return new_record(
            arc, located=located, surfaces=with_located_surface(NO_SURFACES, located),
            stale=not alone,
        )  # fmt: skip
    return last.replaced(
        arc=arc, located=located, surfaces=with_located_surface(last.surfaces, located),
        stale=not alone, impacts=False, rows=(), events=(), cautions=(),
    )  # fmt: skip


def with_located_surface(surfaces: SurfacesAt, located: Located) -> SurfacesAt:
    """Return the surfaces at an instant, with the surface just located."""
    if located.surface < 0:
        return surfaces
    return surfaces._replace(located=located.surface, off=located.off)


def new_record(arc: Arc, **known: Any) -> InstantRecord:
    """Return the record of an instant at which nothing has been decided yet.

    known : the fields that are known from the start.
    """
    laws = None
    if arc.system.laws:
        from lagsim.run.events.contacts import laws_at

        laws = laws_at(arc)
    return InstantRecord.of(arc=arc, t=arc.t, laws=laws, **known)


def equalities_may_jump(arc: Arc) -> bool:
    """Whether an equality of the model or its rate may jump."""
    e = arc.equations
    nodes = [node for x in e.rows for node in (x.residual, x.rate)]
    return arc.system.m > 0 and may_jump(e, nodes)


# --- The algorithm


def settle(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Decide everything at one instant.

    Parameters
    ----------
    now : InstantRecord
        The instant, with the event function that ended the arc, and the events due.
    by : Deciders
        The parts of the run that decide.

    Returns
    -------
    InstantRecord
        The instant, with the state just after it and the modes of the next arc in the
        arc's memory, and the rows and the events that are to be recorded.
    """
    now = end_of_mode(acts(now, by), by)
    while True:
        now = modes(sides_and_velocities(now, by), by)
        now = due_after(shown_sides(now, by), by)
        if not now.due.acts or now.ending is not None:
            return bookkeep(now, by)
        now = acts(now, by)


def sides_and_velocities(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Decide sides and velocities by turns, until no velocity jumps.

    If velocities jump `MOST_JUMPS` times, the run ends.

    now : the record before; the record after both phases is returned.
    """
    now = branches(now, by)
    for _ in range(MOST_JUMPS):
        decided = sides(now, by)
        now = velocities(decided, by)
        if now.after is decided.after or now.ending is not None:
            return now if now.before is None else now.replaced(before=None)
    last_events = now.events[-MOST_JUMPS:]
    about = quoted(x for e in last_events if (x := e.constraint or e.switch))
    return now.replaced(ending=Ending(Outcome.SWITCHES_ACCUMULATE, about))


@phase
def acts(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Execute the events that are due, and the events that become due by their acts.

    All events due together act in the order of the file; events whose conditions these
    acts make true act next, until no further condition becomes true. Then the sum of
    the impulses of all these events changes the velocities. Where velocities may jump
    at the instant, the table row just before the instant is stored first.

    now : the record before the phase.
    by : the parts of the run that decide.
    """
    arc, due = now.arc, now.due.acts
    if now.before is None and not now.located.begins:
        if by.jumping and (now.stale or due):
            now = now.replaced(before=before_event(arc))
        elif due and (arc.system.laws or arc.equations.model.kicks):
            now = now.replaced(before=row_of(arc))
    if by.transitions is None or not due:
        return now
    with Selection(arc):
        corners = corners_at(now, by)
        row = None if now.before is None else now.before.row
        found, acted = by.transitions.act(arc, now.due, now.acts, row, corners)
        if corners is not None:
            corners.restore()
    return carried_out(now, found, acts=acted, stale=True)


@phase
def branches(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Select the branches of all switches of t alone, from the instant on.

    A break at the time of the instant is passed.

    now : the record before the phase.
    by : the parts of the run that decide.
    """
    if not now.stale:
        return now
    arc, passed = now.arc, GO_ON
    if arc.system.switches.modes:
        with Selection(arc):
            if by.knots is not None:
                by.knots.select(arc)
            if by.breaks is not None:
                passed = by.breaks.select(arc)
    now = carried_out(now, passed, stale=False, admissible=None)
    arc.runner.prepare()
    return now


@phase
def sides(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Select the side of each surface (below, above, or on it), then its mode.

    Each surface is decided after the surfaces on which its argument depends, and again
    whenever one of these has changed. Where forces decide, the laws that could act are
    rows of the same problem.

    now : the record before the phase.
    by : the parts of the run that decide.
    """
    if by.switching is None:
        return now
    located, arc = now.located, now.arc
    with Selection(arc):
        if located.surface >= 0:
            found = by.switching.select_at(arc, now.surfaces, now.laws, located.surface)
        else:
            found = by.switching.select(arc, now.surfaces, now.laws)
    now = now.replaced(located=NOWHERE, admissible=None)
    return carried_out(now, found.decision, surfaces=found.surfaces, laws=found.laws)


@phase
def end_of_mode(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Compute the impacts of laws before the sides of surfaces are selected anew.

    This order is used if the end of a law's mode was located. It is used in any case if
    an equality may jump, since rounding decides which of several zeros was located.

    now : the record before.
    by : the parts of the run that decide.
    """
    law = now.located.law
    jumps = by.jumping and now.before is not None and not now.located.begins
    if law < 0 and not (jumps and may_strike(now.arc, by)):
        return now.replaced(located=NOWHERE) if now.located.begins else now
    decided = not (now.stale or now.arc.system.acting_surfaces)
    now = now if law < 0 else now.replaced(located=NOWHERE)
    return laws_struck(now, by, law=law, decided=decided)


@phase
def velocities(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Solve one problem of impulses: of equalities whose rates have jumped, and laws.

    The impulses of equalities alone come first, as if the equalities were eliminated.
    All laws that approach then, each with its own restitution, are struck in the same
    jump. The run ends here if the argument of a table is past its last point.

    now : the record before the phase.
    by : the parts of the run that decide.
    """
    ending = end_of_table(now.arc) if by.ends else None
    if ending is not None:
        return now.replaced(ending=ending)
    projected = GO_ON
    if by.jumping and now.before is not None:
        now, projected = equalities_struck(now, by, now.before)
    if by.contacts is None or now.admissible is not None or now.ending is not None:
        return now if projected.rows is None else carried_out(now, projected)
    return laws_struck(now, by, projected)


def equalities_struck(
    now: InstantRecord, by: Deciders, before: Before
) -> tuple[InstantRecord, Decision]:
    """Project the velocities onto the equalities whose rates have jumped.

    Return the record with these velocities, and a decision with the table row just
    before the jump and its impulses. The decision is carried out later, with the
    impacts of laws, since one table row after the instant shows both.

    now : the record before the projection.
    by : the parts of the run that decide.
    before : the table row just before the instant.
    """
    with Selection(now.arc) as selection:
        found, surfaces = inelastic_impact(now.arc, before, by.switching, now.surfaces)
    now = now.replaced(before=before._replace(compared=True))
    if found is GO_ON:
        selection.undo()
        return now, found
    jump = Decision(rows=found.rows, impulses=found.impulses)
    found = found._replace(rows=None)
    return carried_out(now, found, surfaces=surfaces, admissible=None), jump


def corners_at(now: InstantRecord, by: Deciders) -> CornerSides | None:
    """Return the corners of equalities at the instant; None in models without any."""
    if by.switching is None or not now.arc.system.switches.bends:
        return None
    return CornerSides(now.arc, by.switching.modes, now.surfaces)


def laws_struck(
    now: InstantRecord, by: Deciders, projected: Decision = GO_ON, *, law: int = -1,
    decided: bool = True,
) -> InstantRecord:  # fmt: skip
    """Return the record after the impacts of laws at an instant.

    now : the record before.
    by : the parts of the run that decide.
    projected : the jump of velocities by equalities, which is part of the jump by laws.
    law : the law whose mode has ended, or -1.
    decided : whether the sides of surfaces are decided.
    """
    assert by.contacts is not None
    assert now.laws is not None
    arc = now.arc
    with Selection(arc):
        laws = now.laws if law < 0 else by.contacts.located(arc, now.laws, law)
        corners = corners_at(now, by)
        found = by.contacts.velocities(arc, laws, law, corners, decided=decided)
        if corners is not None:
            corners.restore()
    if corners is not None and corners.is_decided:
        now = now.replaced(surfaces=now.surfaces._replace(stopped=corners.stopped))
    decision = found.decision(arc).after(projected)
    if decision.ending is None and law >= 0:
        decision = decision._replace(ending=by.contacts.accumulate())
    return carried_out(now, decision, laws=found.laws, admissible=found.state)


@phase
def modes(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Select the modes of all laws together, by their accelerations.

    A law may act on surfaces whose sides the forces have decided: its mode has then
    been found with these sides. A row with its multiplier at its bound and acceleration
    0 is decided by the rate of its acceleration, see `mechanics.row_modes.modes`.

    now : the record before the phase.
    by : the parts of the run that decide.
    """
    if by.contacts is None or now.laws is None or now.admissible is None:
        return now
    arc = now.arc
    with Selection(arc):
        found = by.contacts.modes(arc, now.laws, now.admissible)
    return carried_out(now, found.decision(arc), laws=found.laws, admissible=None)


@phase
def shown_sides(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Select the sides of functions with jumps in conditions and output alone.

    The motion does not depend on these sides; they are those to which it leads.

    now : the record after all modes of the motion are selected.
    by : the parts of the run that decide.
    """
    if by.shown is None or by.shown.are_decided(now.arc):
        return now
    with Selection(now.arc):
        surfaces = by.shown.select(now.arc, now.surfaces)
    return now.replaced(surfaces=surfaces)


@phase
def due_after(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Find the events that have become due by the state after all phases.

    The phases are the stages of `settle`. The record returned has these events in
    `due`.

    now : the record after the phases before.
    by : the parts of the run that decide.
    """
    on = by.transitions
    if on is None or now.acts.is_over or not on.has_conditions:
        return now if now.due is NOTHING else now.replaced(due=NOTHING)
    struck, acted = now.impacts, now.acts
    with Selection(now.arc):
        due = on.due_after(now.arc, struck=struck, stored_truth=now.stored_truth)
    acted = acted._replace(rounds=()) if struck and acted.rounds else acted
    return now.replaced(due=due, acts=acted, impacts=False, stored_truth=due.acts)


@phase
def bookkeep(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Return the record with the row after the last jump, and the end by `until`."""
    if now.arc.system.surfaces:
        now.arc.system.p.settled[:] = now.arc.t
    if now.after is not None:
        now = now.replaced(after=now.arc.runner.tabulate(now.arc.row()))
    if by.transitions is not None and now.acts.is_over:
        now = now.replaced(ending=Ending(Outcome.UNTIL))
    return now


def carried_out(now: InstantRecord, found: Decision, **others: Any) -> InstantRecord:
    """Apply the decision of a phase to the arc, and return the next record.

    Where velocities jump, the row before the first jump of the instant and the row
    after its last jump are stored, the latter with the sums of all impulses.

    Parameters
    ----------
    now : InstantRecord
        The record before the phase.
    found : Decision
        The decision of the phase.
    **others
        Further fields of the next record.
    """
    if found is GO_ON:
        return now.replaced(**others)
    arc = now.arc
    if found.sizes is not None:
        arc.sizes[:] = found.sizes
    if found.y is not None:
        arc.replace_state(found.y)
    if found.events:
        others["events"] = now.events + found.events
    if found.cautions:
        others["cautions"] = now.cautions + found.cautions
    now = now.replaced(ending=now.ending or found.ending, **others)
    return now if found.rows is None else jumped(now, found.rows, found.impulses)


def jumped(
    now: InstantRecord, before: Floats, given: JumpImpulses | None
) -> InstantRecord:
    """Return the record after a jump of velocities, with the rows before and after.

    before : ndarray, shape (1, k), the columns before the jump; the row before the
        acts of this pass, if the record has one, is written instead.
    given : the impulses of the jump, or None.
    """
    arc, rows = now.arc, now.rows
    if now.after is None and arc.row_time(-1) < arc.t:
        rows = (*rows, before if now.before is None else now.before.row)
    p = arc.system.p
    if given is not None:
        p.impulses[:] += given.laws
        p.row_impulses[:] += given.rows
    after = arc.runner.tabulate(arc.row())
    arc.pass_shown()
    return now.replaced(rows=rows, after=after, impacts=True)


# --- The events that are due, just before an instant and at the start


def due_before(now: InstantRecord, by: Deciders) -> InstantRecord:
    """Return the record with the events that are due just before the instant."""
    if by.transitions is None:
        return now
    if not by.transitions.has_conditions:
        return now.replaced(due=Due(by.transitions.periodic_due(now.arc)))

    def rests(arc: Arc) -> bool:
        """Whether a law or a surface may hold a rate at 0 from this instant on."""
        if arc.system.laws:
            from lagsim.run.events.contacts import comes_to_rest

            if comes_to_rest(arc):
                return True
        on = by.switching
        return on is not None and on.comes_to_rest(arc, now.surfaces)

    with Selection(now.arc):
        due = by.transitions.due(now.arc, rests, now.acts.waited)
    acts = now.acts
    if due.waiting:
        acts = acts._replace(waited=acts.waited | due.waiting)
    return now.replaced(due=due, acts=acts, stored_truth=True)


def started(arc: Arc, by: Deciders) -> InstantRecord:
    """Return the record with which the start of a run begins.

    The events due are those that act at the start. No arc precedes the start. Therefore
    the row before the instant is computed at the start, with the values that switches
    of t have at this time; the truth of the conditions before it is that at the start,
    and no mode of a law has ended. If events give impulses, the modes in that row are
    those of the state without the impulses, so that the row shows the forces of a body
    at rest on its floor.
    """
    now, switches = new_record(arc, located=STARTED), arc.system.switches
    if by.jumping and (switches.modes or switches.turns):
        with Selection(arc):
            before = at_start(arc)
        now = now.replaced(before=before)
    now = branches(now, by)
    if by.transitions is None:
        return now
    with TrialModes(arc):
        if by.switching is not None:
            by.switching.put_on_levels(arc)
        if by.shown is not None:
            by.shown.put_on_levels(arc)
        due = by.transitions.due_at_start(arc)
        truth = ArcModes.of(arc).truth
    write(arc, ArcModes.of(arc)._replace(truth=truth))
    now = now.replaced(due=due, stored_truth=True)
    if due.begun is not None and due.begun.impulse:
        first, rest, before = ArcModes.of(arc), now, now.before or row_of(arc)
        if not may_strike(arc, by):
            rest = modes(velocities(sides(now, by), by), by)
            before = before._replace(row=row_of(arc).row)
        now = now.replaced(before=before, surfaces=rest.surfaces, ending=rest.ending)
        write(arc, first)
    return now


def may_strike(arc: Arc, by: Deciders) -> bool:
    """Whether a closed law approaches at the state reached."""
    return by.contacts is not None and by.contacts.approach(arc)
