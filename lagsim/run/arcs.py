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
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from lagsim.codes.known import EVENTS_UNLISTED
from lagsim.methods import method
from lagsim.methods.parts import state as at
from lagsim.notes import Caution, Event
from lagsim.run.arc import largest_shift
from lagsim.run.event_store import EventStore
from lagsim.run.events.conditions import is_postponed, located_within
from lagsim.run.events.constraints import (
    LostPartition,
    NearDependence,
    RankLosses,
    singularity_caution,
)
from lagsim.run.events.records import NOTHING
from lagsim.run.events.times import KnotTimes, Pulses, TimeBreaks, clocks
from lagsim.run.events.transitions import Transitions
from lagsim.run.failures import (
    FAILED,
    Fallback,
    Stiffness,
    Unmet,
    has_ends,
    reason_of,
    unsettled,
)
from lagsim.run.instant import InstantRecord
from lagsim.run.instants import instant, is_same, width
from lagsim.run.interrupt import Horizon
from lagsim.run.progress import Progress
from lagsim.run.settle import (
    Deciders,
    due_before,
    equalities_may_jump,
    first_record,
    may_strike,
    new_record,
    settle,
    started,
    unless_overflow,
)
from lagsim.run.trajectory import (
    GO_ON,
    NOWHERE,
    Decision,
    Ending,
    Outcome,
    Source,
    Statistics,
    Trajectory,
    Turn,
)
from lagsim.tolerances import SAME_STEP

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.notes import Choice
    from lagsim.run.arc import Arc
    from lagsim.run.event_store import EventList
    from lagsim.run.events.sections import Sections
    from lagsim.run.interrupt import Interrupt
    from lagsim.run.observers import Corners, Observer


def finite_rows(rows: Floats, columns: int) -> int:
    """Return the number of rows before the first one with a value that is not finite.

    columns : number of leading columns that are examined.
    """
    finite = np.isfinite(rows[:, :columns])
    first = int(finite.argmin())
    return len(rows) if finite.flat[first] else first // columns


# Largest number of events in documents and pages, since a switch or dead point may be
# passed for ever.
MOST_EVENTS = 10_000
# Number of the last stored events from which their main source and rate are reported.
LATELY = 1000


# Rows of short arcs wait for others until so many, or so many seconds of the run, have
# come together: a call of all observers takes as long as hundreds of rows.
POOLED_ROWS, POOLED_SECONDS = 128, 0.1


class Recorder:
    """Storage of events, cautions and choices; passes rows to the observers.

    Attributes
    ----------
    rows : int
        Number of rows so far, including those not yet passed to the observers.
    last : float
        Time of the last row; nan before the first.
    listed : EventList
        Receives all events in the order of time.
    waiting : list of Event
        The events that `listed` has not received: those at the current instant, and
        ends of accumulations, which are known before other events at earlier times.
    events : list of Event
        The first `MOST_EVENTS` events of the run, and all later ones that belong to no
        switch, constraint or name.
    counts, unkept : dict
        Number of all events of each kind, and of those that are not in `events`.
    full : float
        Time of the first event that is not in `events`; inf if all are.
    """

    def __init__(
        self, observers: Sequence[Observer], listed: EventList | None = None
    ) -> None:
        self.observers = observers
        self.listed: EventList = EventStore() if listed is None else listed
        self.waiting: list[Event] = []
        self.events: list[Event] = []
        self.cautions: list[Caution] = []
        self.choices: list[Choice] = []
        self.counts: dict[str, int] = {}
        self.unkept: dict[str, int] = {}
        self.full = math.inf
        self.rows = 0
        self.last = math.nan
        self._pool: list[Floats] = []
        self._pooled, self._since = 0, 0.0

    def store(self, decision: Decision) -> None:
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
        self.waiting += decision.events
        self.cautions += decision.cautions
        self.choices += decision.choices

    def list_events(self, before: float = math.inf) -> None:
        """Pass the waiting events with times before `before` to the list of all."""
        if not self.waiting:
            return
        ready = [event for event in self.waiting if event.time < before]
        if ready:
            self.waiting = [event for event in self.waiting if event.time >= before]
            self.listed.extend(sorted(ready, key=attrgetter("time")))

    def unlisted(self) -> list[Caution]:
        """Return [caution with the number of events not in `events`], or []."""
        if not self.unkept:
            return []
        kinds = ", ".join(f"{count} of kind {k}" for k, count in self.unkept.items())
        of = attrgetter("constraint", "switch", "name")
        recent = [e for e in self.events if any(of(e))][-LATELY:]
        wheres = Counter(next(filter(None, of(e))) for e in recent)
        where, often = wheres.most_common(1)[0]
        text = (
            f"only the first {MOST_EVENTS} events are listed in run.json and in "
            f"pictures (all in events.csv): from t = {self.full:.9g} "
            f"on there were {kinds} more; {often} of the last {len(recent)} listed "
            f"are at `{where}`, within {self.full - recent[0].time:.3g} of time"
        )
        return [Caution(EVENTS_UNLISTED, text)]

    def hand_on(self, rows: Floats) -> None:
        """Store rows (k, columns) for the observers, which receive many at a time."""
        count = len(rows)
        if not count:
            return
        self.rows += count
        self.last = float(rows[-1, 0])
        if not self._pool:
            self._since = time.monotonic()
        self._pool.append(rows)
        self._pooled += count
        is_due = time.monotonic() - self._since > POOLED_SECONDS
        if is_due or self._pooled >= POOLED_ROWS:
            self.pass_on()

    def pass_on(self) -> None:
        """Pass the rows that wait to all observers, and list the events before them."""
        if not self._pool:
            return
        rows = self._pool[0] if len(self._pool) == 1 else np.concatenate(self._pool)
        self._pool, self._pooled = [], 0
        self.list_events(self.last)
        for observer in self.observers:
            observer.add(rows)


# Codes of kernels that end an arc within a step, and all codes that end one at an
# instant.
LOCATED = (at.EVENT_FOUND, at.SWITCH_FOUND)
INSTANTS = (at.DONE, *LOCATED)
# Codes at which no arc ends.
WITHIN = (at.BLOCK_FULL, at.PAUSED)
SETTLE = Decision(turn=Turn.SETTLE)
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
    listed
        Receives all events in the order of time; by default they are kept in memory.
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
        listed: EventList | None = None,
    ) -> None:
        self.arc = self.first = first
        self.sources, self.deciders = _sources(first)
        # Most sources have no such function; the others are called at each arc.
        self.timed = _with_own("times", self.sources)
        self.pausing = _with_own("pause_at", self.sources)
        self.deciding = _with_own("decide", self.sources)
        self.passing = _with_own("passed", self.sources)
        self.preparing = _with_own("set_out", self.sources)
        self.recorder = Recorder(observers, listed)
        # Called between two calls of the kernel.
        self.tick: Callable[[Run], None] | None = None
        self.interrupt, self.progress = interrupt, progress
        self.corners, self.sections = corners, sections
        if sections is not None:
            sections.begin(first)
        self.shown = first.row()[0]  # the time and the state of the last row
        self.record = InstantRecord(self.arc, math.nan)  # record of the last instant
        self.pace = self.arc.runner.pace
        self.arcs = 0
        self._horizon = Horizon()
        self._progress = Progress()
        # The first row with a state that is not finite; the row is not written.
        self.cut: Floats | None = None

    @property
    def t(self) -> float:
        """Current time of the run."""
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
            self.recorder.store(Decision(events=(Event(self.t, "until"),)))
        if self.sections is not None and self.cut is None:
            self.sections.finish(self.arc, whole=ending.outcome is Outcome.DONE)
        self.show_last()
        self.recorder.pass_on()
        self.recorder.list_events()
        return self.trajectory(ending)

    @unless_overflow
    def begin(self) -> Ending | None:
        """Begin the first arc; return the ending if the run ends at its start.

        None if the run continues.
        """
        ending = self._recorded(settle(started(self.arc, self.deciders), self.deciders))
        if ending is None:
            self._begin_arc()
        return ending

    def _recorded(self, now: InstantRecord) -> Ending | None:
        """Write the rows and lists of a settled instant; return its ending, or None.

        now : the record of the instant, see `run.settle.settle`.
        """
        for rows in now.rows:
            self.recorder.hand_on(rows)
        self.recorder.store(Decision(events=now.events, cautions=now.cautions))
        if now.ending is not None and now.ending.outcome is Outcome.TABLE_ENDS:
            self.cut = self.arc.observed()
        self.record = now
        return now.ending

    @unless_overflow
    def advance(self, most_steps: int, arc_steps: float = 0.0) -> Ending | None:
        """Integrate by one call of the kernel; return the ending if the run ends.

        None if the run continues.

        most_steps, arc_steps : see `whole`.
        """
        arc = self.arc
        left = most_steps - arc.steps - int(self.arcs * arc_steps)
        if left <= 0:
            return Ending(Outcome.TOO_MANY_STEPS)
        until_check = min(source.pause_at(arc) for source in self.pausing)
        until_check = min(until_check, self._horizon.pause_at) - arc.steps
        budget = min(self.pace.steps, left, until_check)
        began = time.perf_counter()
        code = arc.advance(self.pace.rows, budget)
        self.pace.lasted(time.perf_counter() - began)
        ending = self._hand_on_block()
        if ending is not None:
            return ending
        for source in self.passing:
            self._carry_out(source.passed(arc))
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
            rejected = int(arc.state.rejections)
            passed = self._horizon.before(end, arc.t, arc.steps, rejected, most_steps)
            if passed is not None:
                about = f"; {most_steps:,} would not pass t = {passed:.6g}"
                return Ending(Outcome.TOO_MANY_STEPS, about)
        return self._decide(code)

    def _hand_on_block(self) -> Ending | None:
        """Pass the finite rows of the last kernel call to the observers.

        Return the ending if a row is not finite, else None.
        """
        arc = self.arc
        emitted = int(arc.state.emitted)
        after = self.record.after
        if self.sections is not None and after is not None:
            self.sections.take(arc, after[0, 0])  # the state with its impulses
        if after is not None and (emitted or arc.t > after[0, 0]):
            self._pass_impact()
        if self.sections is not None:
            self.sections.take(arc)
            self.sections.keep_waiting(arc)
        if not emitted:
            return None
        rows = arc.runner.shown(emitted)
        self.shown = arc.runner.block[emitted - 1].copy()
        known = finite_rows(rows, 1 + arc.state.dynamic.stop)
        self.recorder.hand_on(rows[:known])
        return self._cut(rows[known]) if known < emitted else None

    def _cut(self, row: Floats) -> Ending:
        """Return the ending of a run whose state is not finite.

        row : the first row with that state, which is stored for the message and not
            written.
        """
        self.cut = row
        return Ending(Outcome.NOT_FINITE)

    def _is_stopped(self, code: int) -> bool:
        """Whether an interrupt ends the run after a return `code` of the kernel.

        False without an interrupt, where the run ends anyway (at its end time, by
        `until`), and while the state is that at the end of a full step which an event
        has yet to cut short.
        """
        if self.interrupt is None or not self.interrupt.requested:
            return False
        arc = self.arc
        # The run continues after events that act; it ends after `until`.
        acting = sum(x.at is not None for x in arc.system.equations.model.events)
        until = code == at.EVENT_FOUND and not 0 < arc.state.event <= acting
        over = until or arc.t >= arc.settings.end
        over |= arc.state.cut > 0.0  # the state is the end of the full step
        return not over

    def _set_instant(self, code: int) -> None:
        """Set the arc's time to the common time of its instant, see `instants`.

        code : the kernel's return code.
        """
        arc, settings = self.arc, self.arc.settings
        if is_same(settings, arc.t, self.record.t):
            arc.state.t = self.record.t
            return
        known = [time for source in self.timed for time in source.times(arc)]
        span, ahead = width(settings, arc.t), min(known, default=math.inf) - arc.t
        near = span < ahead <= SAME_STEP * settings.duration
        if near and code == at.EVENT_FOUND:
            span = max(span, located_within(arc))
        arc.state.t = instant(
            settings, [t for t in known if t <= arc.t + span] or [arc.t]
        )

    def _decide(self, code: int) -> Ending | None:
        """Carry out the decision of the first source that handles a kernel's code.

        Return the ending if the run ends, else None.
        """
        arc = self.arc
        if code not in WITHIN:
            stuck = self._progress.ending(arc, code)
            if stuck is not None:
                return stuck
        if (
            code == at.EVENT_FOUND
            and len(arc.state.orientation) > 1
            and is_postponed(arc)
        ):
            return None
        if code in LOCATED:
            self._set_instant(code)
        if self.sections is not None and code not in WITHIN:
            arc.runner.update_relations(arc.state)
        decision = self._decision(code)
        located = NOWHERE if decision is None else decision.located
        now, settles = first_record(self.arc, self.record, located), False
        if code in INSTANTS:
            now = due_before(now, self.deciders)
            settles = now.due != NOTHING or self._is_at_break()
        if decision is None:
            settles |= code == at.DONE and not settles and self._strikes_last()
            decision = SETTLE if settles else None
        elif settles:
            decision = decision._replace(turn=Turn.SETTLE)
        if decision is None:
            return self._end_of(code)
        return self._act(decision, now)

    def _decision(self, code: int) -> Decision | None:
        """Return the decision of the first source that handles the kernel's code.

        None if no source does.
        """
        for source in self.deciding:
            decision = source.decide(self.arc, code)
            if decision is not None:
                return decision
        return None

    def _strikes_last(self) -> bool:
        """Whether a law strikes at the end of the run, to rounding of the end time."""
        arc = self.arc
        if arc.t < arc.settings.end or self.record.t == arc.t:
            return False
        return may_strike(arc, self.deciders)

    def _is_at_break(self) -> bool:
        """Whether a break is at the time reached.

        All modes are then selected with the branches of t after the break: with the
        former branches of some switches, and the new ones of t, an expression could
        have a value that it has on neither side.
        """
        breaks = self.deciders.breaks
        return breaks is not None and breaks.is_at(self.arc)

    def _end_of(self, code: int) -> Ending | None:
        """Return the ending that a kernel's return code means, or None to continue."""
        if code == at.DONE:
            return Ending(Outcome.DONE)
        if code == at.STEP_TOO_SMALL:
            finite = np.isfinite(self.arc.rates(self.arc.t, self.arc.y)).all()
            code = code if finite else at.NOT_FINITE
        return Ending(FAILED[code]) if code in FAILED else None

    def _beside_event(self, back: float = 0.0) -> Floats:
        """Return the columns (4, k) of four states at an event.

        The states are: the current state with a small positive and with a small
        negative offset, the current state less the part `back` of the change since the
        last row, and the current state itself.
        """
        arc = self.arc
        here, ranges = arc.row()[0], np.empty(1 + len(arc.y))
        ranges[0], ranges[1:] = arc.settings.duration, arc.ranges_to(arc.y)
        aside = ASIDE * ranges + SPACINGS * np.spacing(np.abs(here))
        states = np.array([here, here, here, here])
        states[2] -= back * (here - self.shown)
        # Data stored by `tabulate` are those of the last state, the current one.
        states[0] += aside
        states[1] -= aside
        return arc.runner.tabulate(states)

    def _act(self, decision: Decision, now: InstantRecord) -> Ending | None:
        """Carry out a decision: settle the instant `now`, or begin another arc.

        Return the ending of the run, or None.
        """
        arc, settings = self.arc, self.arc.settings
        if decision.ending is not None or decision.turn is not Turn.SETTLE:
            self._carry_out(decision)
        if decision.ending is not None or decision.turn is Turn.NONE:
            return decision.ending
        if decision.turn is Turn.SETTLE:
            shown, corner = self.recorder.rows, None
            acts = arc.equations.model.events or not now.due.conditions
            if self.corners and acts and arc.t < settings.end:
                corner = self._beside_event(BACK)
            ending = self._recorded(settle(now, self.deciders))
            # An impact has rows of its own.
            struck = self.record.after is not None or shown != self.recorder.rows
            if self.corners and corner is not None and not struck:
                within = ASIDE * settings.duration
                self.corners.add(corner, self._beside_event(), within)
            if ending is not None:
                return ending
        self._begin_arc()
        return None

    def _carry_out(self, decision: Decision) -> None:
        """Carry out a decision on the arc; store its events, cautions and choices."""
        if decision is GO_ON:
            return
        self.recorder.store(decision)
        if decision.arc is not None:
            self.arc = decision.arc
        self.arc.store(decision.numbers)
        if decision.sizes is not None:
            self.arc.sizes[:] = decision.sizes

    def _begin_arc(self) -> None:
        """Begin the next arc at the current state."""
        arc = self.arc
        known = (time for source in self.timed for time in source.times(arc))
        end = min(arc.settings.end, instant(arc.settings, known))
        self.arc = arc.next(end)
        if self.record.t != arc.t:
            self.record = new_record(self.arc)
        self.arcs += 1
        for source in self.preparing:
            self._carry_out(source.set_out(self.arc))

    def _pass_impact(self) -> None:
        """Pass the row after the last impact, if any, to the observers.

        The impulse columns of later rows are 0.
        """
        if self.record.after is not None:
            self.recorder.hand_on(self.record.after)
            self.record = self.record.replaced(after=None)
            p = self.arc.system.p
            p.impulses[:] = p.row_impulses[:] = 0.0

    def show_last(self) -> None:
        """Write the row at the current time, unless it has been written."""
        self._pass_impact()
        if self.cut is not None:
            return
        if not self.recorder.last >= self.t:  # also if there is no row
            self.recorder.hand_on(self.arc.runner.tabulate(self.arc.row()))

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
            listed=recorder.listed,
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
    """Return the counts of steps, evaluations and factorisations so far, as a record.

    arc : the present arc, whose state has the counters.
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


def _sources(arc: Arc) -> tuple[list[Source], Deciders]:
    """Return the sources that may pause or end arcs, in order of precedence.

    Return also those of them that decide at an instant.
    """
    e, system = arc.equations, arc.system
    switching = shown = contacts = None
    knots = KnotTimes(arc) if clocks(arc) else None
    breaks = TimeBreaks(arc)
    transitions = Transitions(arc) if e.model.events or e.model.located else None
    if system.acting_surfaces:
        from lagsim.run.events.switching import Switching

        switching = Switching(arc)
    if system.surfaces > system.acting_surfaces:
        from lagsim.run.events.shown_sides import ShownSides

        shown = ShownSides(arc)
    if system.laws:
        from lagsim.run.events.contacts import Contacts

        contacts = Contacts(arc)
    deciders = Deciders(
        knots, breaks, transitions, switching, shown, contacts,
        equalities_may_jump(arc), has_ends(arc),
    )  # fmt: skip
    foresees = method(arc.plan.method).ADAPTIVE and system.timed
    sources = [
        Unmet() if system.m else None,
        LostPartition() if arc.plan.blocks else None,
        Fallback(),
        *deciders[:6],
        *((NearDependence(), RankLosses()) if system.m else ()),
        Stiffness(arc),
        Pulses() if foresees else None,
    ]
    return [x for x in sources if x is not None], deciders


def _with_own(name: str, sources: Sequence[Source]) -> list[Source]:
    """Return the sources whose function `name` is not the default of `Source`."""
    default = getattr(Source, name)
    return [x for x in sources if getattr(type(x), name) is not default]
