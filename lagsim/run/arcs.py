"""The loop over arcs, each integrated by a kernel that fills blocks of rows.

A source ends or pauses arcs: breaks in time, surfaces, losses of rank, steps limited by
the stability bound. A source receives the arc and returns a decision; only the loop
carries out decisions. Blocks of rows are passed to the observers and not stored, so
memory does not grow with the number of rows.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from functools import cached_property, wraps
from operator import attrgetter
from typing import TYPE_CHECKING, ParamSpec

import numpy as np

from lagsim.mechanics.equations import may_jump
from lagsim.methods import method
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Event
from lagsim.run.arc import largest_shift
from lagsim.run.events.conditions import is_postponed, located_within
from lagsim.run.events.constraints import (
    NearDependence,
    RankLosses,
    at_start,
    before_event,
    inelastic_impact,
    singularity_caution,
)
from lagsim.run.events.contacts import Contacts, comes_to_rest
from lagsim.run.events.sequence import STUCK
from lagsim.run.events.switching import Switching
from lagsim.run.events.times import KnotTimes, Pulses, TimeBreaks, clocks
from lagsim.run.events.transitions import NOTHING, Transitions
from lagsim.run.failures import (
    FAILED,
    Fallback,
    Stiffness,
    Unmet,
    end_of_table,
    reason_of,
    unsettled,
)
from lagsim.run.instants import instant, is_same, width
from lagsim.run.interrupt import Horizon
from lagsim.run.trajectory import (
    GO_ON,
    Decision,
    Ending,
    Outcome,
    Source,
    Statistics,
    Trajectory,
    Turn,
    quoted,
)
from lagsim.tolerances import SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Choice
    from lagsim.run.arc import Arc
    from lagsim.run.events.constraints import Before
    from lagsim.run.events.sections import Sections
    from lagsim.run.events.transitions import Due
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Corners, Observer


P = ParamSpec("P")

# Words in the messages of Python, numpy and scipy about numbers that are out of range,
# in a ValueError or its subclass LinAlgError.
OUT_OF_RANGE = ("NaN", "infs", "math domain")


def unless_overflow(work: Callable[P, Ending | None]) -> Callable[P, Ending | None]:
    """Decorate a stage of a run: an overflow in Python ends the run.

    Kernels check each state themselves. Events are computed in Python, which raises
    ArithmeticError or ValueError where numpy returns inf and nan.
    """

    @wraps(work)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> Ending | None:
        try:
            return work(*args, **kwargs)
        except (ArithmeticError, np.linalg.LinAlgError):
            return Ending(Outcome.NOT_FINITE)
        except ValueError as error:
            if not any(word in str(error) for word in OUT_OF_RANGE):
                raise
            return Ending(Outcome.NOT_FINITE)

    return guarded


def finite_rows(rows: Floats, columns: int) -> int:
    """Return the number of rows before the first one with a value that is not finite.

    columns : number of leading columns that are examined.
    """
    finite = np.isfinite(rows[:, :columns])
    first = int(finite.argmin())
    return len(rows) if finite.flat[first] else first // columns


# Largest number of stored events, since a switch or dead point may be passed for ever.
MOST_EVENTS = 10_000
# Number of the last stored events from which their main source and rate are reported.
LATELY = 1000


class Recorder:
    """Storage of events, cautions and choices; passes rows to the observers.

    Attributes
    ----------
    rows : int
        Number of rows passed so far.
    last : float
        Time of the last row; nan before the first.
    counts, unkept : dict
        Number of events of each kind, and number of events that are not stored.
    full : float
        Time of the first event that is not stored; inf if all are.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        self.observers = observers
        self.events: list[Event] = []
        self.cautions: list[Caution] = []
        self.choices: list[Choice] = []
        self.counts: dict[str, int] = {}
        self.unkept: dict[str, int] = {}
        self.full = math.inf
        self.rows = 0
        self.last = math.nan

    def keep(self, decision: Decision) -> None:
        """Store the events, cautions and choices of a decision."""
        for event in decision.events:
            kind = event.kind
            self.counts[kind] = self.counts.get(kind, 0) + 1
            often = event.switch or event.constraint or event.name
            if not often or len(self.events) < MOST_EVENTS:
                self.events.append(event)
            else:
                self.unkept[kind] = self.unkept.get(kind, 0) + 1
                self.full = min(self.full, event.time)
        self.cautions += decision.cautions
        self.choices += decision.choices

    def unlisted(self) -> list[Caution]:
        """Return a caution with the number of events that are not stored, if any."""
        if not self.unkept:
            return []
        kinds = ", ".join(f"{count} of kind {k}" for k, count in self.unkept.items())
        of = attrgetter("constraint", "switch", "name")
        late = [e for e in self.events if any(of(e))][-LATELY:]
        wheres = Counter(next(filter(None, of(e))) for e in late)
        where, often = wheres.most_common(1)[0]
        text = (
            f"only the first {MOST_EVENTS} events are listed: from t = {self.full:.9g} "
            f"on there were {kinds} more; {often} of the last {len(late)} listed are "
            f"at `{where}`, within {self.full - late[0].time:.3g} of time"
        )
        return [Caution("events-unlisted", text)]

    def hand_on(self, rows: Floats) -> None:
        """Pass rows (k, columns) to all observers."""
        count = len(rows)
        if not count:
            return
        self.rows += count
        self.last = float(rows[-1, 0])
        for observer in self.observers:
            observer.add(rows)


# Codes of kernels that end an arc within a step, and all codes that end one at an
# instant.
LOCATED = (at.EVENT_FOUND, at.SWITCH_FOUND)
INSTANTS = (at.DONE, *LOCATED)
# Offset of a state from a surface, as a part of the range of each component and in
# units in its last place: invisible in a picture, and larger than rounding.
ASIDE, SPACINGS = 1e-9, 64
# Offset before an event as a part of the change since the last row; it exceeds the
# rounding of a slip that stops.
BACK = 1e-6


class Run:
    """A run of a model in progress: current arc, sources of events, recorded results.

    Parameters
    ----------
    first : Arc
        First arc of the run, see `first_arc`.
    observers
        Receive all rows.
    interrupt
        Requests of an early end.
    progress
        Called with the fraction of the run that is done.
    corners
        Receives the rows just before and after events.
    sections
        Receives the rows of sections.
    """

    def __init__(
        self,
        first: Arc,
        observers: Sequence[Observer],
        *,
        interrupt: Interrupt | None = None,
        progress: Callable[[float], None] | None = None,
        corners: Corners | None = None,
        sections: Sections | None = None,
    ) -> None:
        self.arc = self.first = first
        self.sources = list(_sources(self.arc))
        self.transitions = self.switching = None
        for source in self.sources:
            if isinstance(source, Transitions):
                self.transitions = source
            elif isinstance(source, Switching):
                self.switching = source
        # Sources with event times known in advance.
        self.timed = [x for x in self.sources if type(x).times is not Source.times]
        self.recorder = Recorder(observers)
        # Called between two calls of the kernel.
        self.tick: Callable[[Run], None] | None = None
        self.interrupt, self.progress = interrupt, progress
        self.corners, self.sections = corners, sections
        if sections is not None:
            sections.begin(first)
        self.shown = first.row()[0]  # the time and the state of the last row
        self.instant = self.arc.t  # the time of the last instant
        # The row after an impact, written when time advances, since events that are
        # due at the same instant act first.
        self.after: Floats | None = None
        self.former: Floats | None = None  # the columns before events acted
        # Jumps of velocities, and their number when conditions were decided last.
        self.impacts = self.judged = 0
        self.pace = self.arc.runner.pace
        self.arcs = 0
        self._horizon = Horizon()
        # The first row with a state that is not finite; the row is not written.
        self.cut: Floats | None = None

    @property
    def t(self) -> float:
        """Current time."""
        return self.arc.t

    def whole(self, most_steps: int, arc_steps: float = 0.0) -> Trajectory:
        """Integrate all arcs of the run and return its result.

        Parameters
        ----------
        most_steps : int
            Largest number of steps of the run.
        arc_steps : float
            Number of steps that each arc counts as, in addition to its own steps.
        """
        ending = None if self.arcs else self.begin()
        while ending is None:
            if self.tick is not None:
                self.tick(self)
            ending = self.advance(most_steps, arc_steps)
            if ending is None and self.progress is not None:
                settings = self.arc.settings
                self.progress((self.t - settings.start) / settings.duration)
        if ending.outcome is Outcome.UNTIL:
            self.recorder.keep(Decision(events=(Event(self.t, "until"),)))
        if self.sections is not None and self.cut is None:
            self.sections.finish(self.arc, whole=ending.outcome is Outcome.DONE)
        self.show_last()
        return self.trajectory(ending)

    @unless_overflow
    def begin(self) -> Ending | None:
        """Begin the first arc; return the ending if the run ends at its start."""
        system = self.arc.system
        # The start, before its switches have the modes of the first arc.
        jumps = self._may_jump and (system.switches.modes or system.switches.corners)
        before = at_start(self.arc) if jumps else None
        values = self.arc.located(self.arc.t, self.arc.y)
        ending = self._set_modes() or self._past_table() or self._strike(before)
        if ending is None and self.transitions is not None:
            struck = values if self.impacts else None
            due = self.transitions.look_at_start(self.arc, struck)
            if due != NOTHING:
                ending = self._act_at_start(due)
        if ending is None:
            self._set_out(self.arc.settings.end)
        return ending

    def _act_at_start(self, due: Due) -> Ending | None:
        """Apply the events due at the start and all that follow.

        Return an ending or None.
        """
        assert self.transitions is not None
        before = before_event(self.arc) if self._may_jump else None
        self.judged = self.impacts
        ending = self._let_act(due)
        ending = ending or self._settle(None, Turn.MODES, before)
        if self.transitions.is_over:
            return Ending(Outcome.UNTIL)
        if self.after is not None:
            self.after = self._row()
        return ending

    @unless_overflow
    def advance(self, most_steps: int, arc_steps: float = 0.0) -> Ending | None:
        """Integrate by one call of the kernel; return the ending if the run ends.

        Arguments: see `whole`.
        """
        arc = self.arc
        left = most_steps - arc.steps - int(self.arcs * arc_steps)
        if left <= 0:
            return Ending(Outcome.TOO_MANY_STEPS)
        asked = min(source.ask_at(arc) for source in self.sources)
        asked = min(asked, self._horizon.ask_at) - arc.steps
        budget = min(self.pace.steps, left, asked)
        began = time.perf_counter()
        code = arc.advance(self.pace.rows, budget)
        self.pace.lasted(time.perf_counter() - began)
        ending = self._hand_on_block()
        if ending is not None:
            return ending
        for source in self.sources:
            self._take(source.passed(arc))
        if not np.isfinite(arc.y[arc.state.dynamic]).all():
            return self._cut(arc.observed())
        if self._is_stopped(code):
            return Ending(Outcome.INTERRUPTED)
        if not arc.state.projected <= largest_shift(arc.plan.rtol):
            return Ending(Outcome.STATE_JUMPS)
        if code == at.PAUSED:
            if left <= budget:
                return Ending(Outcome.TOO_MANY_STEPS)
            end = arc.settings.end
            passed = self._horizon.before(end, arc.t, arc.steps, most_steps)
            if passed is not None:
                about = f"; {most_steps:,} would not pass t = {passed:.6g}"
                return Ending(Outcome.TOO_MANY_STEPS, about)
        return self._decide(code)

    def _hand_on_block(self) -> Ending | None:
        """Pass the finite rows of the last kernel call to the observers.

        Return the ending if a row is not finite.
        """
        arc = self.arc
        emitted = int(arc.state.emitted)
        if self.sections is not None and self.after is not None:
            self.sections.take(arc, self.after[0, 0])  # with its impulses
        if self.after is not None and (emitted or arc.t > self.after[0, 0]):
            self._pass_impact()
        if self.sections is not None:
            self.sections.take(arc)
        if not emitted:
            return None
        rows = arc.runner.shown(emitted)
        self.shown = arc.runner.block[emitted - 1].copy()
        known = finite_rows(rows, 1 + arc.state.dynamic.stop)
        self.recorder.hand_on(rows[:known])
        return self._cut(rows[known]) if known < emitted else None

    def _cut(self, row: Floats) -> Ending:
        """Return the ending by a state that is not finite.

        row : the first row with that state, which is stored for the message and not
        written.
        """
        self.cut = row
        return Ending(Outcome.NOT_FINITE)

    def _is_stopped(self, code: int) -> bool:
        """Whether an interrupt ends the run, which would continue after this code."""
        if self.interrupt is None or not self.interrupt.asked:
            return False
        arc = self.arc
        # The run continues after events that act; it ends after `until`.
        acting = sum(x.at is not None for x in arc.system.equations.model.events)
        until = code == at.EVENT_FOUND and not 0 < arc.state.event <= acting
        over = until or arc.t >= arc.settings.end
        over |= arc.state.cut > 0.0  # the state is that of the step as it was
        return not over

    def _meet(self, code: int) -> None:
        """Replace the arc's time by the time of its instant, see `instants`."""
        arc, settings = self.arc, self.arc.settings
        if is_same(settings, arc.t, self.instant):
            arc.state.t = self.instant
            return
        known = [time for source in self.timed for time in source.times(arc)]
        soon, ahead = width(settings, arc.t), min(known, default=math.inf) - arc.t
        near = soon < ahead <= SAME_STEP * settings.duration
        if near and code == at.EVENT_FOUND:
            soon = max(soon, located_within(arc))
        arc.state.t = instant(
            settings, [t for t in known if t <= arc.t + soon] or [arc.t]
        )

    def _decide(self, code: int) -> Ending | None:
        """Carry out the decision of the first source that handles a kernel's code.

        Return the ending if the run ends.
        """
        arc = self.arc
        if (
            code == at.EVENT_FOUND
            and len(arc.state.orientation) > 1
            and is_postponed(arc)
        ):
            return None
        if code in LOCATED:
            self._meet(code)
        if self.sections is not None and code not in (at.BLOCK_FULL, at.PAUSED):
            arc.runner.meet_instant(arc.state)
        before = self._before(code)
        corner = self._corner(code)
        self.judged = self.impacts
        if code == at.SWITCH_FOUND and self.switching is not None:
            self.switching.locate(arc)
        due = NOTHING
        if code in INSTANTS and self.transitions is not None:
            due = self.transitions.due(arc, self._comes_to_rest)
            ending = self._let_act(due)
            if ending is not None:
                return ending
        source, decision = self._decision(code)
        if code in LOCATED:
            decision = self._with_breaks(decision)
        if due != NOTHING and (decision is None or decision.turn is not Turn.NONE):
            decision = (decision or Decision())._replace(turn=Turn.MODES)
        if decision is not None:
            return self._act_and_show(source, decision, before, corner)
        return self._end_of(code)

    def _decision(self, code: int) -> tuple[Source | None, Decision | None]:
        """Return the first source that handles the kernel's code, and its decision."""
        for source in self.sources:
            decision = source.decide(self.arc, code)
            if decision is not None:
                return source, decision
        return None, None

    def _with_breaks(self, decision: Decision | None) -> Decision | None:
        """Return a decision at a located event, joined with that of a break then.

        All modes are then selected with the branches of t after the break: with the
        former branches of some switches, and the new ones of t, an expression could
        have a value that it has on neither side.
        """
        for source in self.timed:
            passed = source.decide(self.arc, at.DONE)
            if passed is not None:
                own = decision or GO_ON
                decision = own._replace(
                    events=own.events + passed.events,
                    ending=own.ending or passed.ending,
                    turn=passed.turn,
                )
        return decision

    def _end_of(self, code: int) -> Ending | None:
        """Return the ending that a kernel's return code means.

        None if the run continues.
        """
        if code == at.DONE:
            return Ending(Outcome.DONE)
        if code == at.STEP_TOO_SMALL:
            finite = np.isfinite(self.arc.rates(self.arc.t, self.arc.y)).all()
            code = code if finite else at.NOT_FINITE
        return Ending(FAILED[code]) if code in FAILED else None

    def _act_and_show(
        self,
        source: Source | None,
        decision: Decision,
        before: Before | None,
        corner: Floats | None,
    ) -> Ending | None:
        """Carry out a decision, and store the corner of the curves at the event."""
        shown = self.recorder.rows
        ending = self._act(source, decision, before)
        # An impact has rows of its own.
        struck = self.after is not None or shown != self.recorder.rows
        if corner is not None and self.corners and not struck:
            within = ASIDE * self.arc.settings.duration
            self.corners.add(corner, self._seen(), within)
        return ending

    def _comes_to_rest(self, arc: Arc) -> bool:
        """Whether a law or a surface may hold a rate at 0 from this instant on."""
        if arc.system.laws and comes_to_rest(arc):
            return True
        return self.switching is not None and self.switching.comes_to_rest(arc)

    def _let_act(self, due: Due) -> Ending | None:
        """Apply the events of the file that are due.

        Return the ending if the run ends.
        """
        assert self.transitions is not None
        if not (due.periodic or due.conditions):
            return None
        arc = self.arc
        # The row before an impact has the modes before the event.
        self.former = arc.observed() if arc.system.laws else None
        acted = self.transitions.act(arc, due)
        self._take(acted)
        return acted.ending

    def _before(self, code: int) -> Before | None:
        """Return the row before the event just located, if equalities may jump there.

        code : the kernel's return code. None if no jump is possible.
        """
        arc = self.arc
        if not self._may_jump:
            return None
        ends = code in (at.DONE, at.SWITCH_FOUND) or code in FAILED
        ends |= code == at.EVENT_FOUND and bool(arc.equations.model.events)
        ends |= code == at.PAUSED and arc.is_looked_at
        # Unilateral constraints store the state before their own events.
        ends &= code != at.SWITCH_FOUND or arc.system.surfaces > 0
        if not (ends and (arc.t < arc.settings.end or arc.system.watched)):
            return None
        return before_event(arc)

    @cached_property
    def _may_jump(self) -> bool:
        """Whether an equality or its rate may jump.

        Impacts of unilateral constraints are handled by `Contacts`.
        """
        e = self.arc.equations
        nodes = [node for x in e.rows for node in (x.residual, x.rate)]
        return self.arc.system.m > 0 and may_jump(e, nodes)

    def _corner(self, code: int) -> Floats | None:
        """Return the columns (4, k) of states beside an event, see `_seen`.

        None if not stored.
        """
        if not self.corners:
            return None
        arc = self.arc
        meets = code in (at.SWITCH_FOUND, at.DONE)
        meets |= code == at.EVENT_FOUND and bool(arc.equations.model.events)
        meets &= arc.t < arc.settings.end
        return self._seen(BACK) if meets else None

    def _seen(self, back: float = 0.0) -> Floats:
        """Return the columns (4, k) of four states at an event.

        The states are: the current state with a small positive and with a small
        negative offset, the current state less the part `back` of the change since the
        last row, and the current state itself.
        """
        arc = self.arc
        states = np.repeat(arc.row(), 4, 0)
        states[2] -= back * (states[2] - self.shown)
        ranges = np.append(arc.settings.duration, arc.ranges_to(arc.y))
        aside = ASIDE * ranges + SPACINGS * np.spacing(np.abs(states[0]))
        # Data stored by `tabulate` are those of the last state, the current one.
        states[0] += aside
        states[1] -= aside
        return arc.runner.tabulate(states)

    def _act(
        self, source: Source | None, decision: Decision, before: Before | None
    ) -> Ending | None:
        """Carry out a decision, and all impacts, modes and events that follow it."""
        self._take(decision)
        turn = decision.turn
        if decision.ending is not None or turn is Turn.NONE:
            return decision.ending
        ending = self._settle(source, turn, before)
        if self.transitions is not None and self.transitions.is_over:
            return Ending(Outcome.UNTIL)
        if ending is not None:
            return ending
        if self.after is not None:
            self.after = self._row()
        self._set_out(decision.ahead)
        return None

    def _settle(
        self, source: Source | None, turn: Turn, before: Before | None
    ) -> Ending | None:
        """Select modes and apply impacts and events of an instant until none is due.

        source : source that has already set its own mode if the turn is MODE.
        before : state before the event.
        """
        while True:
            if turn is Turn.MODES or (turn is Turn.MODE and self.arc.system.laws):
                ending = self._set_modes(source if turn is Turn.MODE else None)
                if ending is not None:
                    return ending
            if turn is not Turn.ARC:
                ending = self._past_table() or self._strike(before)
                if ending is not None:
                    return ending
            if self.transitions is None or self.transitions.is_over:
                return None
            struck, self.judged = self.impacts != self.judged, self.impacts
            due = self.transitions.due_after(self.arc, struck=struck)
            if due == NOTHING:
                return None
            before = before_event(self.arc) if self._may_jump else None
            ending = self._let_act(due)
            if ending is not None:
                return ending
            source, turn = None, Turn.MODES

    def _past_table(self) -> Ending | None:
        """Return the ending if a table is evaluated beyond its last point."""
        ending = end_of_table(self.arc)
        if ending is not None:
            self.cut = self.arc.observed()
        return ending

    def _strike(self, before: Before | None) -> Ending | None:
        """Apply the impact on constraints whose rates jump at the current time."""
        if before is None:
            return None
        struck = inelastic_impact(self.arc, before, self.switching)
        self._take(struck)
        moved = struck.ending is None and struck.y is not None
        if moved and self.switching is not None:
            return self._set_modes()  # by the velocities after the impact
        return struck.ending

    def _set_modes(self, but: Source | None = None) -> Ending | None:
        """Select the modes of all sources except `but`.

        After an impact the modes of all sources are selected again; the run ends if
        impacts do not end after `STUCK` repetitions.
        """
        struck, left = True, STUCK
        while struck:
            if not left:
                late = self.recorder.events[-STUCK:]
                about = quoted(x for e in late if (x := e.constraint or e.switch))
                return Ending(Outcome.SWITCHES_ACCUMULATE, about)
            struck, left = False, left - 1
            for source in self.sources:
                if source is but:
                    continue
                begun = source.begin(self.arc)
                self._take(begun)
                if begun.ending is not None:
                    return begun.ending
                struck |= begun.rows is not None
            but = None
        return None

    def _take(self, decision: Decision) -> None:
        """Carry out a decision on the arc, write an impact's rows, store records."""
        if decision is GO_ON:
            return
        self.recorder.keep(decision)
        if decision.arc is not None:
            self.arc = decision.arc
        arc = self.arc
        arc.store(decision.numbers)
        if decision.sizes is not None:
            arc.sizes[:] = decision.sizes
        if decision.rows is not None:
            self.impacts += 1
            rows = decision.rows if self.former is None else self.former[None]
            self.former = None
            # With an impulse of an event, all jumps of an instant have one row before.
            joined = arc.system.p.kicked > 0.0 and self.after is not None
            if self.after is not None and not joined:
                self.recorder.hand_on(self.after)
            if arc.row_time(-1) < arc.t and not joined:
                self.recorder.hand_on(rows)
        if decision.y is not None:
            arc.put(decision.y)
        if decision.rows is not None:
            self.after = self._row()
            arc.pass_shown()

    def _set_out(self, ahead: float) -> None:
        """Begin the next arc at the current state.

        ahead : the time at which the kernel pauses before the end of the arc.
        """
        arc = self.arc
        known = (time for source in self.timed for time in source.times(arc))
        end = min(arc.settings.end, instant(arc.settings, known))
        self.instant, self.former = arc.t, None
        self.arc = arc.next(end, ahead)
        self.arcs += 1
        for source in self.sources:
            self._take(source.set_out(self.arc))

    def _row(self) -> Floats:
        """Return the columns (1, k) of the current state."""
        return self.arc.runner.tabulate(self.arc.row())

    def _pass_impact(self) -> None:
        """Pass the row after the last impact to the observers.

        Set impulse columns to 0.
        """
        if self.after is not None:
            self.recorder.hand_on(self.after)
            self.after = None
            p = self.arc.system.p
            p.impulses[:] = p.row_impulses[:] = p.kicked = 0.0

    def show_last(self) -> None:
        """Write the row at the current time, unless it has been written."""
        self._pass_impact()
        if self.cut is not None:
            return
        if not self.recorder.last >= self.t:  # also where there is none
            self.recorder.hand_on(self._row())

    def trajectory(self, ending: Ending) -> Trajectory:
        """Return the result of the run that ends by `ending`."""
        arc, recorder, state = self.arc, self.recorder, self.arc.state
        extents = zip(state.low.tolist(), state.high.tolist(), strict=True)
        return Trajectory(
            outcome=ending.outcome,
            reason=reason_of(arc, ending, self.cut),
            start=arc.settings.start,
            end=arc.t if self.cut is None else recorder.last,
            rows=recorder.rows,
            statistics=statistics_of(arc, self.arcs),
            events=tuple(sorted(recorder.events, key=attrgetter("time"))),
            event_counts=dict(recorder.counts),
            warnings=(
                *recorder.cautions,
                *recorder.unlisted(),
                *singularity_caution(arc),
                *unsettled(arc),
            ),
            choices=tuple(recorder.choices),
            extents=dict(zip(arc.system.state, extents, strict=True)),
            largest_energy=float(state.energy),
        )


def statistics_of(arc: Arc, arcs: int) -> Statistics:
    """Return the counts of the work done up to an arc's current time.

    arcs : number of arcs of the run.
    """
    state, evaluations = arc.state, int(arc.state.evaluations)
    all_constant = arc.plan.constant >= (2 if arc.system.m else 1)
    return Statistics(
        arc.steps,
        int(state.rejections),
        evaluations,
        int(state.factorisations) + (1 if all_constant else evaluations),
        state.smallest_step or None,
        arcs,
    )


def _sources(arc: Arc) -> Iterator[Source]:
    """Return the sources that may pause or end arcs, in order of precedence."""
    if arc.system.m:
        yield Unmet()
    yield Fallback()
    if clocks(arc):
        yield KnotTimes(arc)
    yield TimeBreaks(arc)
    if arc.equations.model.events or arc.equations.model.located:
        yield Transitions(arc)
    contacts = Contacts(arc) if arc.system.laws else None
    if arc.system.surfaces:
        yield Switching(arc, contacts)
    if contacts is not None:
        yield contacts
    if arc.system.m:
        yield NearDependence()
        yield RankLosses()
    yield Stiffness(arc)
    if method(arc.plan.method).ADAPTIVE and arc.system.timed:
        yield Pulses()
