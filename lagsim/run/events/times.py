"""Events at times known in advance: switches of t alone, and features.

The branch of each switch in time is fixed in an arc. A smooth pulse, a ramp or a gate
of t alone is flat to rounding before it begins; no step sees it coming. Where such a
function of t may rise is where its argument (see `localized`) is largest, passes
zero or is least: `breaks` finds every such moment, however long the rest before it. How
far the argument has to go from there for the function to fade tells how wide it is.
Steps end where that begins and shrink towards the moment itself, see
`methods.parts.driver`.
"""

from __future__ import annotations

import heapq
import math
from functools import partial
from itertools import islice
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.language.derivatives import tangent
from lagsim.language.intervals import Enclosures
from lagsim.language.tables import at_ends
from lagsim.mechanics.surfaces import expression_text
from lagsim.mechanics.switches import prevailing
from lagsim.methods.parts import state as at
from lagsim.methods.parts.driver import pass_knots
from lagsim.methods.parts.missed import LARGEST, NEAR_ZERO, distance
from lagsim.notes import Caution, Event
from lagsim.program.localized import indicators_in_time
from lagsim.run.events.breaks import NEIGHBOURS, Clock, Values, break_times
from lagsim.run.events.sequence import Sequence
from lagsim.run.trajectory import GO_ON, Decision, Ending, Outcome, Source, Turn

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.program.localized import Indicator
    from lagsim.run.arc import Arc


# Breaks accumulate if, after FEWEST, windows of so many get shorter so fast that all
# that follow would take less than this part of the time since the first.
WINDOW, FEWEST, SHORT = 250, 1000, 1e-3


class _Ahead(Source):
    """Future breaks or features of a run, in order, found as the run gets to them.

    A run that is resumed finds it anew, past what it has taken; so does one whose
    events set modes on which it depends, from then on.
    """

    DERIVED: tuple[str, ...] = ("_coming",)

    def __init__(self, arc: Arc, nodes: Iterable[int]) -> None:
        self._arc, self._start = arc, arc.settings.start
        names, depends = arc.equations.model.modes, arc.equations.graph.depends
        self._names = sorted(names & depends(nodes)) if names else []
        self._modes = {name: arc.modes[name] for name in self._names}
        self._cautions: list[Caution] = []
        self._taken = 0
        self._coming: Iterator[Any] | None = None

    def _all(self) -> Iterator[Any]:
        """Find all of it, from `_start` on."""
        raise NotImplementedError

    @property
    def _values(self) -> dict[str, float]:
        """The parameters, and the modes that it depends on."""
        return self._arc.parameters | self._modes

    def _is_other(self, arc: Arc) -> bool:
        """Whether modes have been set that it depends on; then it begins anew."""
        modes = {name: arc.modes[name] for name in self._names}
        if modes == self._modes:
            return False
        self._modes, self._start = modes, arc.t
        self._taken, self._coming = 0, None if arc.t < arc.settings.end else iter(())
        return True

    def _following(self, last: Any) -> Any:
        """Next of it; `last` after all of it."""
        if self._coming is None:
            self._coming = self._all()
            if self._taken:  # what it told of these is told
                next(islice(self._coming, self._taken - 1, self._taken), None)
                self._cautions.clear()
        self._taken += 1
        return next(self._coming, last)


def clocks(arc: Arc) -> dict[int, Clock]:
    """Return the tables of a t + b at whose points y' has no jump, by their modes."""
    g, modes = arc.equations.graph, arc.system.switches.modes
    smooth = {k: x.discrete for k, x in enumerate(modes) if x.smooth[0] < x.smooth[1]}
    found = {k: Clock.of(g, discrete) for k, discrete in smooth.items()}
    return {k: clock for k, clock in found.items() if clock is not None}


class Knots(_Ahead):
    """The points that tables of a t + b are passed at, without a jump of y'.

    The kernel goes through them, so many at a time (`methods.parts.parameters.Knots`):
    there is nothing to decide. Where y' may jump, at the ends, are breaks besides.
    """

    def __init__(self, arc: Arc) -> None:
        modes = arc.system.switches.modes
        super().__init__(arc, [modes[k].discrete for k in clocks(arc)])
        self._are_events: list[bool] = []  # of those that the kernel knows
        self._told, self._last = 0, -inf

    def _all(self) -> Iterator[tuple[float, int, int, int, bool]]:
        """Return times, modes, cells before and after, whether each is an event."""
        return heapq.merge(*(self._of(*each) for each in clocks(self._arc).items()))

    def _of(self, k: int, clock: Clock) -> Iterator[tuple[float, int, int, int, bool]]:
        arc, is_linear = self._arc, clock.axis.numbers[1] == 0.0
        low, high = arc.system.switches.modes[k].smooth
        ends = self._start, arc.settings.end
        for time, before, after in clock.knots(
            arc.equations.graph, self._values, *ends
        ):
            if time > self._start + arc.system.p.apart:
                is_event = is_linear and low < max(before, after) < high
                yield time, k, before, after, is_event

    def begin(self, arc: Arc) -> Decision:
        """Set the cells that the time reached is in."""
        p = arc.system.p
        if self._is_other(arc) or not self._taken:
            p.apart = max(self._rounding(clock) for clock in clocks(arc).values())
            for k, clock in clocks(arc).items():
                discrete = [arc.system.switches.modes[k].discrete]
                value = Values(arc.equations.graph, discrete, self._values)
                first, *_ = next(self._of(k, clock), (arc.settings.end,))
                arc.system.set_modes(prevailing(value, arc.t, first), [k])
            self._fill(arc)
        if arc.t < arc.settings.end:  # a table may end where the run does
            pass_knots(p, arc.t + p.apart)
        return GO_ON

    def _rounding(self, clock: Clock) -> float:
        """Return how far off a time may be."""
        at = Values(self._arc.equations.graph, list(clock[1:]), self._values)
        ends = self._start, self._arc.settings.end
        x, a = (max(map(abs, pair)) for pair in zip(*map(at, ends), strict=True))
        moved = NEIGHBOURS * math.ulp(x) / a if a > 0.0 else 0.0
        return NEIGHBOURS * math.ulp(max(map(abs, ends))) + moved

    def _fill(self, arc: Arc) -> None:
        """Give the kernel the next of them."""
        p = arc.system.p
        coming = iter(partial(self._following, None), None)
        found = list(islice(coming, len(p.knot_times)))
        p.known, p.passed = len(found), 0.0
        arrays = (p.knot_times, p.knot_modes, p.cells_before, p.cells_after)
        for k, values in enumerate(arrays):
            values[: len(found)] = [x[k] for x in found]
        self._are_events, self._told = [x[-1] for x in found], 0

    def passed(self, arc: Arc) -> Decision:
        """Report the kinks that the kernel has passed."""
        p, first = arc.system.p, self._told
        if p.passed == first:
            return GO_ON
        self._told = int(p.passed)
        events = []
        for k in range(first, self._told):
            time = float(p.knot_times[k])
            if self._are_events[k] and not time - self._last <= p.apart:
                events.append(Event(time, "switch"))  # one, of several tables
                self._last = time
        return Decision(events=tuple(events))

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Give the kernel more of them."""
        if code != at.KNOTS_PASSED:
            return None
        if arc.system.p.passed >= arc.system.p.known:
            self._fill(arc)
        return GO_ON


class TimeBreaks(_Ahead):
    """The breaks in time of a run, but for the points of tables that are `Knots`."""

    DERIVED = ("_coming", "_discrete")

    def __init__(self, arc: Arc) -> None:
        modes, passed = arc.system.switches.modes, clocks(arc)
        self._own = [k for k in range(len(modes)) if k not in passed]
        self._closed = [k for k in passed if modes[k].smooth[0] == 0.0]
        super().__init__(arc, [x.discrete for x in modes])
        self._discrete: Values | None = None
        self._met = Sequence(arc.settings.start, arc.settings.duration, WINDOW)
        self._first = math.nan
        self._next: float = self._following(inf)

    def _all(self) -> Iterator[float]:
        arc, settings = self._arc, self._arc.settings
        g, ends = arc.equations.graph, (self._start, settings.end)
        self._discrete = None
        return break_times(g, self._nodes(arc), self._values, *ends)

    def _nodes(self, arc: Arc) -> list[int]:
        """Return discrete functions: of its own modes, then of the ends of `Knots`."""
        g, modes = arc.equations.graph, arc.system.switches.modes
        closed = (clock for k, clock in clocks(arc).items() if k in self._closed)
        ends = (at_ends(g, clock.axis, clock.argument) for clock in closed)
        return [*(modes[k].discrete for k in self._own), *ends]

    def begin(self, arc: Arc) -> Decision:
        """Set the branches up to the next break."""
        if self._is_other(arc):
            self._next = self._following(inf)
        if self._own:
            if self._discrete is None:
                nodes = self._nodes(arc)[: len(self._own)]
                self._discrete = Values(arc.equations.graph, nodes, self._values)
            end = min(self._next, arc.settings.end)
            branches = prevailing(self._discrete, arc.t, end)
            arc.system.set_modes(branches, self._own)
        arc.runner.prepare()
        return GO_ON

    def limit(self, arc: Arc) -> float:  # noqa: ARG002
        """Next break."""
        return self._next

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Go through a break that has been reached."""
        if code != at.DONE or arc.t < self._next:
            return None
        self._met.add(arc.t, 0)
        self._first = arc.t if self._taken == 1 else self._first
        ending = None
        if self._taken >= FEWEST and self._taken % WINDOW == 0:
            limit = self._met.end()
            if limit is not None and limit - arc.t < SHORT * (arc.t - self._first):
                ending = Ending(Outcome.SWITCHES_ACCUMULATE, "in time")
        self._next = self._following(inf)
        switch = (Event(arc.t, "switch"),)
        return Decision(events=switch, turn=Turn.MODES, ending=ending)


# Distances are in powers of e, as in `methods.parts.missed`. The width of what happens
# is the way on which it fades by the first, and it is over where it has faded by the
# second; or, where it fades as a power does, after so many widths.
FADED = 0.5
GONE = 80.0
FAR = 64.0
# The part of what it does to a motion that counts as its size already before it begins:
# until then the motion may change.
FORESEEN = 1e-2
# What varies by no more than this hides nothing: a method's own steps see it.
SHALLOW = 3.0
# Halvings of the way on which the distance has grown past what counts.
REFINED = 6
# So many turns of an argument without anything short: some seconds.
PATIENCE = 20_000


class Feature(NamedTuple):
    """Something at `time`, of this width, that is over at this distance."""

    time: float
    width: float
    reach: float


class Features(_Ahead):
    """Future features of a run, in order."""

    def __init__(self, arc: Arc) -> None:
        super().__init__(arc, [x.node for x in _indicators(arc)])
        self._next: Feature | None = self._following(None)
        self._now: Feature | None = None

    def _all(self) -> Iterator[Feature]:
        ends = self._start, self._arc.settings.end
        graph, report = self._arc.equations.graph, self._cautions.append
        lines = [
            _Line(graph, self._values, ends, indicator, report)
            for indicator in _indicators(self._arc)
        ]
        return heapq.merge(*(line.features() for line in lines if not line.shallow))

    def set_out(self, arc: Arc) -> Decision:
        """Store the next feature after the time reached for the kernel."""
        if self._is_other(arc):
            self._next, self._now = self._following(None), None
        found = self._first(arc)._replace(cautions=tuple(self._cautions))
        self._cautions.clear()
        return found

    def decide(self, arc: Arc, code: int) -> Decision | None:
        """Store the feature that comes after one that is over."""
        return self.set_out(arc) if code == at.FEATURE_PASSED else None

    def _first(self, arc: Arc) -> Decision:
        while self._now is None or self._ends(self._now) <= arc.t:
            if self._next is None:
                self._now = None
                return Decision(numbers={"feature_width": 0.0})
            self._now, self._next = self._next, self._following(None)
        now = self._now
        begins = now.time - now.reach - now.width
        is_ahead = arc.t < begins
        numbers = {
            "feature": now.time,
            "feature_width": now.width,
            "feature_reach": now.reach,
            "feature_end": begins if is_ahead else self._ends(now),
        }
        sizes = _expected(arc, now, FORESEEN if is_ahead else 1.0)
        return Decision(numbers=numbers, sizes=sizes)

    def _ends(self, now: Feature) -> float:
        """Return when it is over, or when the next begins."""
        over = now.time + now.reach
        if self._next is not None:
            over = min(over, max(now.time, self._next.time - self._next.reach))
        return over


def _indicators(arc: Arc) -> list[Indicator]:
    """Find the indicators of what depends on t alone, parameters and modes."""
    e = arc.system.equations
    found = indicators_in_time(e, e.of_motion)
    return [x for x in found if e.graph.depends([x.node]) <= {"t", *arc.parameters}]


def _expected(arc: Arc, now: Feature, part: float) -> Floats:
    """Sizes of the motion (size,) with what is about to happen.

    Or the first traces of a pulse would be controlled against a body at rest, as
    finely as rounding lets them be.
    """
    state, velocities = arc.state, arc.velocities
    sizes = arc.sizes
    for time in (now.time - now.width, now.time, now.time + now.width):
        push = part * now.width * np.abs(arc.rates(time, arc.y)[velocities])
        moved = arc.y.copy()
        moved[velocities] += push  # a body at rest takes no work
        change = part * now.width * np.abs(arc.rates(time, moved))
        change[state.positions], change[velocities] = now.width * push, push
        if np.all(np.isfinite(change)):
            sizes = np.maximum(sizes, change)
    return sizes


class _Line:
    """The moments at which one argument may wake something."""

    def __init__(
        self,
        g: Graph,
        values: Mapping[str, float],
        ends: tuple[float, float],
        indicator: Indicator,
        report: Callable[[Caution], None],
    ) -> None:
        self.g, self.values = g, values
        self.report, self.text = report, expression_text(g, indicator.node)
        self.indicator = indicator
        start, end = self.start, self.end = ends
        self.argument = Values(g, [indicator.node], values)
        # Below the least step of a run nothing happens.
        self.finest = 2.0**-40 * (end - start)
        enclose = Enclosures(g, [indicator.node], values)
        (whole,) = enclose(np.array([start]), np.array([end]))
        lo, hi = float(whole.lo[0]), float(whole.hi[0])
        self.shallow = self._shallow(lo, hi)

    def _shallow(self, lo: float, hi: float) -> bool:
        """Whether an argument between these bounds hides nothing."""
        kind, power = self.indicator.kind, self.indicator.power
        if kind == LARGEST:
            return power * (hi - lo) < SHALLOW
        if kind == NEAR_ZERO:
            return not lo <= 0.0 <= hi or power * max(-lo, hi) < SHALLOW
        if lo <= 0.0 <= hi:
            return False
        small, large = sorted((abs(lo), abs(hi)))
        return power * (math.log(large) - math.log(small)) < SHALLOW

    def features(self) -> Iterator[Feature]:
        """Return them in order."""
        g, node = self.g, self.indicator.node
        discrete = g.call("sign", node)
        if self.indicator.kind != NEAR_ZERO:
            (rate,) = tangent(g, [node], {g.variable("t"): g.one})
            discrete = g.call("sign", rate)
        if "t" not in g.depends([discrete]):
            return
        vain = 0
        for time in break_times(g, [discrete], self.values, self.start, self.end):
            found = self._at(time)
            vain += 1
            if found is not None:
                vain = 0
                yield found
            if vain == PATIENCE:
                self.report(self._given_up(time))
                return

    def _given_up(self, time: float) -> Caution:
        text = (
            f"after t = {time:.9g} steps no longer end where `{self.text}` may "
            f"have a pulse: it has turned {PATIENCE} times without one; a short "
            "pulse could be missed there"
        )
        return Caution("short-times", text)

    def _distance(self, t: float) -> float:
        """Distance of the argument from activity, see `methods.parts.missed`."""
        (u,) = self.argument(t)
        kind, power = self.indicator.kind, self.indicator.power
        return math.inf if math.isnan(u) else distance(kind, power, u)

    def _beside(self, time: float, width: float) -> list[float]:
        """Distances so long before a time, and after it."""
        return [self._distance(time - width), self._distance(time + width)]

    def _at(self, time: float) -> Feature | None:
        """Return the feature at a time, or None."""
        least = self._distance(time)
        beside = max(8.0 * math.ulp(time), self.finest)
        width = None
        fade = 0.0
        while beside <= self.end - self.start:
            sides = self._beside(time, beside)
            if width is None and min(sides) - least < -FADED:
                return None  # it is closer to waking beside that moment
            faded = max(sides) - least
            if width is None and faded >= FADED:
                width = beside
            fade = max(fade, min(sides) - least)
            if fade >= GONE or (width is not None and beside >= FAR * width):
                break
            beside *= 2.0
        if width is None or fade < SHALLOW:
            return None
        return Feature(time, width, self._reach(time, least + GONE, beside))

    def _reach(self, time: float, gone: float, far: float) -> float:
        """How far from `time`, at most `far`, it has faded on both sides."""
        near = 0.5 * far
        for _ in range(REFINED):
            middle = 0.5 * (near + far)
            faded = min(self._beside(time, middle)) >= gone
            near, far = (near, middle) if faded else (middle, far)
        return far
