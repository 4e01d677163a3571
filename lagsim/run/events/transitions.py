"""Events of the file, which set modes: at located conditions, or every period.

Modes are words of the parameters, constant in an arc. At an event the arc ends, the
modes are set, and another begins. Events at one time act in the order of the file; what
becomes true by them acts next, at the same time. Conditions are located by the kernels
(`methods.parts.search`), as `until` is: each counts once it has been false.

At an event rounding decides whether a condition holds. So one whose event has acted is
not false before it is by more than rounding, its leeway. Another that is about to
become false counts as false: beside `v <= c` stands `v >= c` in a relay without
hysteresis, and where one turns the motion back the other undoes it at once. That ends
the run.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods.parts import state as at
from lagsim.notes import Event
from lagsim.run.events.sequence import NO_TIME, Sequence
from lagsim.run.instants import width
from lagsim.run.trajectory import Decision, Ending, Outcome, Source, Turn, quoted
from lagsim.tolerances import RESIDUAL_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc

# Nothing has happened since an event within so many leeways of its condition, and this
# part of the first step after it.
NEAR, EARLY = 4.0, 1e-3
# Rates are differences over this part of a step.
BACK = 2.0**-10
# A miss of 0 counts as this: less than any other, and more than what moves at once.
LEAST = 1e-250
# Where `sequence.STUCK` acts take no more than this part of a run, it does not end.
HARDLY = 1e-9


class Acted(NamedTuple):
    """A located event: its condition, when it acted, its leeway, and modes before."""

    name: str
    condition: int
    time: float
    steps: int
    leeway: float
    modes: dict[str, float]


class Transitions(Source):
    """The events of a run.

    Attributes
    ----------
    next : list of int
        The number of the next act of each that is periodic; -1 where none follows.
    lately : list of Acted
        The located events that have acted one after the other, without time passing.
    """

    def __init__(self, arc: Arc) -> None:
        events, settings = arc.equations.model.events, arc.settings
        self.next = [1 if x.at is None and not x.once else -1 for x in events]
        self.lately: list[Acted] = []
        self.sequence = Sequence(settings.start, settings.duration)
        self.begun = False
        self.energetic = arc.system.equations.is_set

    def begin(self, arc: Arc) -> Decision:
        """List the periodic events, which have acted before the first row."""
        first = () if self.begun else arc.equations.model.events
        self.begun = True
        names = (x.name for x in first if x.at is None)
        return Decision(tuple(Event(arc.t, "event", name=name) for name in names))

    def times(self, arc: Arc) -> Iterator[float]:
        """Return the times of the next acts of periodic events."""
        return (self._time(arc, k) for k in range(len(self.next)))

    def _time(self, arc: Arc, k: int) -> float:
        """Time of the next act of an event; inf of one that is not periodic."""
        if self.next[k] < 0:
            return math.inf
        return arc.settings.start + self.next[k] * arc.equations.model.events[k].every

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Let the events act that are due."""
        if code not in (at.EVENT_FOUND, at.DONE):
            return None
        soon = arc.t + width(arc.settings, arc.t)
        due = {k for k in range(len(self.next)) if self._time(arc, k) <= soon}
        moment, found = _Moment(self, arc), int(arc.state.event) - 1
        if not due and found in (-1, moment.until):
            return None
        return moment.through(due, found)


def give_leeway(arc: Arc) -> None:
    """Let conditions that are true at the start not be false within the tolerance.

    Where a constraint holds one on its edge, as the ground does `y <= 0`, what rounding
    leaves is no change of it. The tolerance is for the sizes of what a condition
    depends on; a velocity at rest has that of its position over the run.
    """
    state, count = arc.state, len(arc.state.orientation)
    if not count or not arc.equations.model.constraints:
        return
    values, sizes = arc.located(arc.t, arc.y), arc.seen.copy()
    if not (values >= 0.0).any():
        return
    speeds = sizes[state.positions] / arc.settings.duration
    sizes[state.velocities] = np.maximum(sizes[state.velocities], speeds)
    scale = np.zeros(count)
    for i in np.flatnonzero(sizes[state.dynamic]):
        y = arc.y.copy()
        y[i] += BACK * sizes[i]
        with np.errstate(invalid="ignore"):
            scale += np.abs(arc.located(arc.t, y) - values) / BACK
    true = (values >= 0.0) & np.isfinite(scale)
    part = float(arc.plan.tolerance)
    if arc.system.moreau is not None:  # whose contacts move by a step's way
        part = max(part, (arc.plan.step or 0.0) / arc.settings.duration)
    state.leeway[true] = part * scale[true]


def count_closed(arc: Arc, y: Floats, closed: Floats) -> None:
    """Let conditions be true at the state y that are where its gaps are closed.

    After an impact rounding leaves a gap on either side of 0, and the motion leads away
    from it: `x <= 0` may never be true at the ground `x >= 0`.
    """
    state = arc.state
    misses = arc.located(arc.t, y) * state.orientation
    met = arc.located(arc.t, closed) * state.orientation <= 0.0
    met &= state.orientation != 0.0
    state.leeway[met] = -np.maximum(misses[met], LEAST)


class _Moment:
    """Events that act at one time.

    Attributes
    ----------
    event_of : list of int
        The events of the conditions.
    until : int
        The number of the condition `until`, after these; there may be none.
    values : ndarray
        Of the conditions: functions that are >= 0 where these are true.
    """

    def __init__(self, run: Transitions, arc: Arc) -> None:
        self.run, self.arc, self.state = run, arc, arc.state
        self.events = arc.system.equations.model.events
        self.event_of = [k for k, x in enumerate(self.events) if x.at is not None]
        self.until = len(self.event_of)
        self.count = len(self.state.orientation)
        self.values = arc.located(arc.t, arc.y)
        self.found: list[Event] = []
        self.ending: Ending | None = None

    def _change(self) -> Floats:
        """Change of conditions within a short time, at the rates before the event."""
        arc, ago = self.arc, BACK * self.state.step_h
        if arc.system.moreau is not None:  # nothing is known of rates
            return np.zeros(self.count)
        before = arc.y - ago * arc.rates(arc.t, arc.y)
        return np.asarray(self.values - arc.located(arc.t - ago, before))

    @cached_property
    def rounding(self) -> Floats:
        """Bounds of the rounding of conditions, also where all their terms vanish."""
        sizes, count = self.arc.seen[self.state.dynamic], self.count
        of = self.arc.runner.function("located_slopes", count * (1 + len(sizes)))
        found = of(self.arc.t, self.arc.y)
        slopes = np.abs(found[count:]).reshape(count, len(sizes))
        return RESIDUAL_ROUNDOFF * np.maximum(found[:count], slopes @ sizes)

    def through(self, due: set[int], found: int) -> Decision:
        """Let events act until none is due: periodic ones, and those of conditions."""
        arc, energetic = self.arc, self.run.energetic
        y = arc.y.copy()
        before = arc.energies(y) if energetic else np.zeros(0)
        true = self._true_with(found) if found >= 0 else set()
        while due or true:
            if self.until in true:
                self.ending = Ending(Outcome.UNTIL)
            due |= {self.event_of[c] for c in true if c != self.until}
            for k in sorted(due):
                self._set(k)
            if self.ending is not None:
                break
            due, true = set(), self._becoming_true()
        if energetic:
            arc.add_work(y, before)
        return Decision(tuple(self.found), y=y, ending=self.ending, turn=Turn.MODES)

    def _true_with(self, found: int) -> set[int]:
        """Conditions that become true with the one found, but for rounding.

        Those that are about to become false count as false.
        """
        state, rounding = self.state, self.rounding
        side, misses = state.orientation, self.values * state.orientation
        change = self._change()
        comes = (misses <= rounding) & (change * side < -rounding)
        true = {*np.flatnonzero((side != 0.0) & ((misses <= 0.0) | comes)), found}
        state.leeway[found] = max(0.0, misses[found])
        turns = (side == 0.0) & (state.equation == 0.0) & np.isfinite(state.leeway)
        turns &= np.abs(self.values) <= np.maximum(2.0 * rounding, state.leeway)
        turns &= change < -rounding
        side[turns], state.leeway[turns] = -1.0, rounding[turns]
        if not self._goes_on():
            self.run.lately.clear()
        return true

    def _becoming_true(self) -> set[int]:
        """Conditions that are true by what has been set, and were false."""
        state, true = self.state, set()
        self.values = self.arc.located(self.arc.t, self.arc.y)
        for c, value in enumerate(self.values.tolist()):
            side, leeway = state.orientation[c], state.leeway[c]
            if side != 0.0 and not value * side + leeway > 0.0:
                true.add(c)
            elif side == 0.0 and value < -leeway:
                state.orientation[c], state.leeway[c] = -1.0, 0.0
            elif side == 0.0 and state.equation[c] and value > leeway:
                state.orientation[c], state.leeway[c] = 1.0, 0.0
        return true

    def _set(self, k: int) -> None:
        """Let one event set its modes."""
        arc, run, event = self.arc, self.run, self.events[k]
        before, first = arc.modes, sum(len(x.sets) for x in self.events[:k])
        every = sum(len(x.sets) for x in self.events)
        values = arc.runner.function("sets", every)(arc.t, arc.y)[first:].tolist()
        for (mode, _), value in zip(event.sets, values, strict=False):
            arc.system.p.flat[arc.system.place(mode)] = value
            if not math.isfinite(value):
                about = f": `{mode}` in the event `{event.name}`"
                self.ending = Ending(Outcome.NOT_FINITE, about)
        arc.runner.prepare()
        self.found.append(Event(arc.t, "event", name=event.name))
        if event.at is None:
            run.next[k] += 1
        else:
            self._note(k, before)

    def _note(self, k: int, before: dict[str, float]) -> None:
        """Note that a located event has acted; end the run where it undoes another."""
        arc, run, state = self.arc, self.run, self.state
        name, c, after = self.events[k].name, self.event_of.index(k), arc.modes
        state.orientation[c] = 0.0
        state.leeway[c] = 2.0 * (state.leeway[c] + self.rounding[c])
        leeway = float(state.leeway[c])
        run.lately.append(Acted(name, c, arc.t, arc.steps, leeway, before))
        run.sequence.add(arc.t, k)
        undone = after != before and any(x.modes == after for x in run.lately)
        if undone or run.sequence.is_stuck(HARDLY):
            about = quoted(x.name for x in run.lately)
            self.ending = Ending(Outcome.EVENTS_CHATTER, about)
        if self.events[k].once:
            state.leeway[c] = math.inf  # never false again

    def _goes_on(self) -> bool:
        """Whether nothing has happened since the last located event."""
        arc, state = self.arc, self.state
        if not self.run.lately:
            return False
        last = self.run.lately[-1]
        if arc.t - last.time <= NO_TIME * max(arc.settings.duration, abs(arc.t)):
            return True
        early = arc.t - state.step_t <= EARLY * state.step_h
        near = abs(self.values[last.condition]) <= NEAR * last.leeway
        return bool(early and near and arc.steps - last.steps <= 1)
