"""Events at times known in advance: switches of t alone, and the sizes of pulses.

The branch of each switch of t alone is fixed in an arc. A smooth pulse of t alone is
located within the steps, as all localized terms are (`methods.parts.search`).
"""

from __future__ import annotations

import heapq
import math
from functools import partial
from itertools import islice
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.language.evaluate import evaluate_rows
from lagsim.language.tables import at_ends, is_smooth
from lagsim.methods.parts import state as at
from lagsim.methods.parts.driver import pass_knots
from lagsim.methods.parts.search_table import distance
from lagsim.notes import Event
from lagsim.run.events.accumulation import Accumulation
from lagsim.run.events.breaks import (
    NEIGHBOURS,
    Prevailing,
    TimedTable,
    Values,
    breaks_of,
    values_by_majority,
)
from lagsim.run.instants import width
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome, Source

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc


# After FEWEST breaks, breaks accumulate if the lengths of windows of WINDOW breaks
# decrease so fast that all breaks to come would take less than the part SHORT of the
# time since the first break.
WINDOW, FEWEST, SHORT = 250, 1000, 1e-3


class _Ahead(Source):
    """Future breaks of a run in order of time, computed when the run reaches them.

    A resumed run computes its breaks again and skips the breaks that it has passed.
    Where an event sets modes on which breaks depend, the breaks after this event are
    computed again.

    Parameters
    ----------
    arc : Arc
        The first arc of the run.
    nodes : iterable of int
        The expressions on which the breaks depend.
    """

    DERIVED: tuple[str, ...] = ("_coming",)

    def __init__(self, arc: Arc, nodes: Iterable[int]) -> None:
        self._arc, self._start = arc, arc.settings.start
        names, depends = arc.equations.model.modes, arc.equations.graph.depends
        self._names = sorted(names & depends(nodes)) if names else []
        self._modes = {name: arc.modes[name] for name in self._names}
        self._taken = 0
        self._coming: Iterator[Any] | None = None

    def _all(self) -> Iterator[Any]:
        """Return an iterator over all breaks from the time `_start`."""
        raise NotImplementedError

    @property
    def _values(self) -> dict[str, float]:
        """The values of the parameters, and of the modes on which breaks depend."""
        return self._arc.parameters | self._modes

    def _is_other(self, arc: Arc) -> bool:
        """Whether modes of the file on which breaks depend have changed.

        If so, the breaks are searched again from now on.
        """
        modes = {name: arc.modes[name] for name in self._names}
        if modes == self._modes:
            return False
        self._modes, self._start = modes, arc.t
        self._taken, self._coming = 0, None if arc.t < arc.settings.end else iter(())
        return True

    def _search(self) -> None:
        """Begin the search for further breaks, unless it has begun."""
        if self._coming is None:
            self._coming = self._all()
            if self._taken:
                next(islice(self._coming, self._taken - 1, self._taken), None)

    def _following(self, last: Any) -> Any:
        """Return the next break, or `last` after all breaks."""
        self._search()
        assert self._coming is not None
        self._taken += 1
        return next(self._coming, last)


def clocks(arc: Arc) -> dict[int, TimedTable]:
    """Return the tables of a t + b that kernels pass, by the indices of their switches.

    The index is that of the table in the model's switches of t. y' has no jump at the
    points of such a table.
    """
    g, modes = arc.equations.graph, arc.system.switches.modes
    smooth = {k: x.discrete for k, x in enumerate(modes) if x.smooth[0] < x.smooth[1]}
    found = {k: TimedTable.of(g, discrete) for k, discrete in smooth.items()}
    return {k: clock for k, clock in found.items() if clock is not None}


class KnotTimes(_Ahead):
    """The knots of a run: points of tables of a t + b without a jump of y'.

    The kernel passes the knots without ending the arc; its memory holds a number of
    knots at a time (`methods.parts.parameters.KnownPoints`). The ends of a table, at
    which y' may jump, are breaks also.
    """

    def __init__(self, arc: Arc) -> None:
        modes = arc.system.switches.modes
        super().__init__(arc, [modes[k].discrete for k in clocks(arc)])
        # whether each knot in the kernel's memory is an event
        self._are_events: list[bool] = []
        self._reported, self._last = 0, -inf

    def _all(self) -> Iterator[tuple[float, int, int, int, bool]]:
        """Return an iterator over the knots in order of time.

        A knot is a tuple of its time, the index of its table (see `clocks`), the cells
        before and after it, and whether it is an event.
        """
        return heapq.merge(*(self._of(*each) for each in clocks(self._arc).items()))

    def _of(
        self, k: int, clock: TimedTable
    ) -> Iterator[tuple[float, int, int, int, bool]]:
        arc, is_linear = self._arc, clock.axis.numbers[1] == 0.0
        low, high = arc.system.switches.modes[k].smooth
        ends = self._start, arc.settings.end
        for time, before, after in clock.knots(
            arc.equations.graph, self._values, *ends
        ):
            if time > self._start + arc.system.p.knot_distance:
                is_event = is_linear and low < max(before, after) < high
                yield time, k, before, after, is_event

    def select(self, arc: Arc) -> None:
        """Set the cell of each table at the time reached."""
        p = arc.system.p
        if self._is_other(arc) or not self._taken:
            p.knot_distance = max(
                self._rounding(clock) for clock in clocks(arc).values()
            )
            for k, clock in clocks(arc).items():
                discrete = [arc.system.switches.modes[k].discrete]
                value = Values(arc.equations.graph, discrete, self._values)
                first, *_ = next(self._of(k, clock), (arc.settings.end,))
                arc.system.set_modes(values_by_majority(value, arc.t, first), [k])
            self._fill(arc)
        if arc.t < arc.settings.end:  # a table may end where the run does
            pass_knots(p, arc.t + p.knot_distance)

    def _rounding(self, clock: TimedTable) -> float:
        """Return a bound of the rounding error of the knots' times of a table.

        clock : the table.
        """
        at = Values(self._arc.equations.graph, list(clock[1:]), self._values)
        ends = self._start, self._arc.settings.end
        x, a = (max(map(abs, pair)) for pair in zip(*map(at, ends), strict=True))
        by_argument = NEIGHBOURS * math.ulp(x) / a if a > 0.0 else 0.0
        return NEIGHBOURS * math.ulp(max(map(abs, ends))) + by_argument

    def _fill(self, arc: Arc) -> None:
        """Write the next knots to the memory of the kernel."""
        p = arc.system.p
        coming = iter(partial(self._following, None), None)
        found = list(islice(coming, len(p.knot_times)))
        p.known, p.passed = len(found), 0.0
        arrays = (p.knot_times, p.knot_modes, p.cells_before, p.cells_after)
        for k, values in enumerate(arrays):
            values[: len(found)] = [x[k] for x in found]
        self._are_events, self._reported = [x[-1] for x in found], 0

    def passed(self, arc: Arc) -> Decision:
        """Return a decision with events at the knots passed since the last call."""
        p, first = arc.system.p, self._reported
        if p.passed == first:
            return GO_ON
        self._reported = int(p.passed)
        events = []
        for k in range(first, self._reported):
            time = float(p.knot_times[k])
            if self._are_events[k] and not time - self._last <= p.knot_distance:
                events.append(Event(time, "switch"))  # one event for several tables
                self._last = time
        return Decision(events=tuple(events))

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Write further knots to the kernel's memory if all in it are passed.

        None for codes of the kernel other than `KNOTS_PASSED`.

        code : the kernel's return code.
        """
        if code != at.KNOTS_PASSED:
            return None
        if arc.system.p.passed >= arc.system.p.known:
            self._fill(arc)
        return GO_ON


class TimeBreaks(_Ahead):
    """The breaks of a run: times at which time switches change their branches.

    Times at which y' does not jump, the knots, are excluded, see `KnotTimes`.
    """

    DERIVED = ("_coming", "_discrete")

    def __init__(self, arc: Arc) -> None:
        modes, passed = arc.system.switches.modes, clocks(arc)
        self._own = [k for k in range(len(modes)) if k not in passed]
        self._closed = [k for k in passed if modes[k].smooth[0] == 0.0]
        super().__init__(arc, [x.discrete for x in modes])
        g = arc.equations.graph
        self._smooth = {k for k in self._own if is_smooth(g, modes[k].discrete)}
        self._discrete: Prevailing | None = None
        self._met = Accumulation(arc.settings.duration, WINDOW)
        self._first = math.nan
        self._next: float = self._following(inf)

    def _all(self) -> Iterator[float]:
        arc, settings = self._arc, self._arc.settings
        g, ends = arc.equations.graph, (self._start, settings.end)
        self._discrete = Prevailing(g, self._nodes(arc), self._values, *ends)
        return breaks_of(self._discrete, *ends)

    def _nodes(self, arc: Arc) -> list[int]:
        """Return the nodes of discrete functions of t whose changes are breaks.

        The nodes are those of the switches of t that kernels do not pass, then those of
        the ends of the tables in `KnotTimes`.
        """
        g, modes = arc.equations.graph, arc.system.switches.modes
        closed = (clock for k, clock in clocks(arc).items() if k in self._closed)
        ends = (at_ends(g, clock.axis, clock.argument) for clock in closed)
        return [*(modes[k].discrete for k in self._own), *ends]

    def select(self, arc: Arc) -> Decision:
        """Set the branches of switches of t for the interval up to the next break.

        Return the decision with the event of a break at the time reached, if any.
        """
        found = self._passed(arc) if self.is_at(arc) else GO_ON
        if self._is_other(arc):
            self._discrete = None
            self._next = self._following(inf)
        if self._own:
            arc.system.set_modes(self._branches(arc), self._own)
        return found

    def _branches(self, arc: Arc) -> list[float]:
        """Return the branches from the time reached up to the next break."""
        self._search()
        end = min(self._next, arc.settings.end)
        if self._discrete is None:  # modes have changed at the end of the run
            nodes, g = self._nodes(arc), arc.equations.graph
            self._discrete = Prevailing(g, nodes, self._values, arc.t, end)
        return self._discrete(arc.t, end)[: len(self._own)]

    def times(self, arc: Arc) -> tuple[float]:  # noqa: ARG002
        """Return the time of the next break; inf after the last."""
        return (self._next,)

    def is_at(self, arc: Arc) -> bool:
        """Whether the next break is at the time reached."""
        return arc.t >= self._next - width(arc.settings, arc.t)

    def _passed(self, arc: Arc) -> Decision:
        """Pass the break at the time reached; return its event, or the run's ending."""
        self._met.add(arc.t, 0)
        self._first = arc.t if self._taken == 1 else self._first
        ending = None
        if self._taken >= FEWEST and self._taken % WINDOW == 0:
            limit = self._met.end()
            if limit is not None and limit - arc.t < SHORT * (arc.t - self._first):
                ending = Ending(Outcome.SWITCHES_ACCUMULATE, "in time")
        self._next = self._following(inf)
        return Decision(events=self._events(arc), ending=ending)

    def _events(self, arc: Arc) -> tuple[Event, ...]:
        """Return the event of the break reached; () at knots where y' is continuous.

        Such knots are those of smooth tables in an argument that is not a t + b.
        """
        if self._smooth and self._discrete is not None:
            before = arc.system.p.branches[self._own]
            after = self._branches(arc)
            changes = zip(self._own, before, after, strict=True)
            levels = {k: max(x, y) for k, x, y in changes if x != y}
            modes = arc.system.switches.modes
            if levels and all(
                k in self._smooth and modes[k].smooth[0] < x < modes[k].smooth[1]
                for k, x in levels.items()
            ):
                return ()
        return (Event(arc.t, "switch"),)


# Number of samples of an arc. Distances from the centre of a pulse are in powers of e,
# see `methods.parts.missed`; a pulse has a minimum of distance at least SHALLOW deep.
SAMPLES = 128
SHALLOW = 3.0
# Part of the change by a pulse that counts as the size of a component before it.
FORESEEN = 1e-2


class Pulses(Source):
    """Sizes of the changes that pulses of t alone will cause, for error control.

    Without these sizes the error control would resolve the tail of a wide pulse, a
    hundred powers of ten below its peak, down to rounding. A pulse between the samples
    has no size until a step over it is rejected (`methods.parts.search`).
    """

    def __init__(self) -> None:
        self._seen = -inf  # searched up to this time

    def set_out(self, arc: Arc) -> Decision:
        """Return the decision that raises the sizes of components by pulses ahead."""
        if arc.t < self._seen:
            return GO_ON
        self._seen = arc.end
        times, p = np.linspace(arc.t, arc.end, SAMPLES), arc.system.p
        beyond = 2.0 * times[-1] - times[-2]
        knots = p.knot_times[int(p.passed) : int(p.known)]
        times = np.array(sorted({*times.tolist(), *knots.tolist()}))
        times = np.append(times[times <= arc.end], beyond)
        sizes = arc.sizes
        for time in pulses(arc, times):
            sizes = np.maximum(sizes, _pushed(arc, time))
        return Decision(sizes=sizes)


def pulses(arc: Arc, times: Floats) -> list[float]:
    """Return the times of pulses: of terms of t alone that are localized.

    Parameters
    ----------
    arc
        The arc, with its parameters and modes.
    times : ndarray, shape (k,)
        Increasing sample times; the first and last are never pulses.

    Returns
    -------
    list of float
        The samples at which the argument of a term is closer than at neighbouring
        samples to the value at which the term acts.
    """
    graph, timed = arc.equations.graph, arc.system.timed
    values: dict[str, Any] = {**arc.parameters, "t": times}
    for mode in arc.system.switches.modes:
        (values[mode.variable],) = evaluate_rows(
            graph, [mode.discrete], values, len(times)
        )
    nodes = [x.node for x in timed]
    rows = evaluate_rows(graph, nodes, values, len(times)).tolist()
    found = np.zeros(len(times) - 2, bool)
    for one, arguments in zip(timed, rows, strict=True):
        away = np.array([distance(one.kind, one.power, u) for u in arguments])
        away[np.isnan(away)] = inf
        before = np.maximum.accumulate(away)[:-2]
        after = np.maximum.accumulate(away[::-1])[::-1][2:]
        closest = away[1:-1] <= np.minimum(away[:-2], away[2:])
        found |= closest & (np.minimum(before, after) - away[1:-1] >= SHALLOW)
    return list(map(float, times[1:-1][found]))


def _pushed(arc: Arc, time: float) -> Floats:
    """Return the changes (size,) of the state by the forces at a later time.

    The forces act for the part `FORESEEN` of the interval between samples. 0 where a
    change is not finite.
    """
    state, velocities = arc.state, arc.velocities
    width = FORESEEN * (arc.end - arc.t) / SAMPLES
    displacement = width * np.abs(arc.rates(time, arc.y)[velocities])
    displaced = arc.y.copy()
    displaced[velocities] += displacement  # forces do no work on a body at rest
    change = width * np.abs(arc.rates(time, displaced))
    change[state.positions], change[velocities] = width * displacement, displacement
    return change if np.isfinite(change).all() else np.zeros(len(change))
