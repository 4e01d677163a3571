"""Break times: the times at which discrete functions of t alone change value.

The search is rigorous and lazy. Interval arithmetic discards every time interval on
which a function provably keeps its value. Where each surface that could change the
value is provably monotone, its crossing is located to the double. All other intervals
are divided further, into cells, the leftmost first and a batch at a time, so that
memory is bounded. Therefore no pulse is missed that is wider than a few units in the
last place of t.

The conventions:

- A break is the first double at which the function no longer has its old value:
  `heaviside(t - 1)` and `sign(t - 1)` break at 1.0, `t > 1` at the next double.
- A value that holds at one instant only (sign(0), a touching root) causes no break.
- Breaks closer than 4 units in the last place count as one break, the first. Breaks
  that close to the start or the end are not reported.
- A surface that passes zero by no more than a few times the rounding error of its own
  evaluation may not switch at all. The function values on both sides of the doubtful
  interval decide: if they differ, there is one break, where the computed value
  changes.
- A surface that is zero but for rounding on a long interval (sin(t)^2 + cos(t)^2 - 1)
  is recognized by samples: its value and slope vanish, within rounding, at four points
  of a cell in which it varies by less than about 1e-4 of its terms (1e-6 where its
  slope may jump). Only a pulse smaller than this, between two samples, is missed.
- Where the value is undecidable down to neighbouring doubles (a square wave of `floor`
  whose period is shorter than their spacing, atan2(0, 0)), the undecided interval may
  grow, by cells of up to 1/64 of its length, up to the next decidable cell. It has one
  break if the values on both sides differ.
- Both ends of a long doubtful or undecided interval (from 1/1024 of t) are breaks if
  the prevailing value changes there: the values in it say nothing of its neighbours.
- Breaks that accumulate (sin(1/t) toward 0) are returned one by one, as long as
  rounding separates two neighbours.
- After 200,000 cells without a break the time reached is reported as a break, so that
  each request returns within seconds. The only cost is a restart of the method.

Near t = 0 times are resolved to 1e-32 of the larger of |start| and |end|.
"""

from __future__ import annotations

import heapq
import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import CHOOSING, OPERATIONS, STEPS
from lagsim.language.intervals import RULES, Enclosures, Interval, interval, point
from lagsim.language.tables import cell_of, knots_between
from lagsim.mechanics.surfaces import WHOLE, joined_conditions, surfaces
from lagsim.tolerances import TERM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from lagsim.language.arrays import Flags, Floats
    from lagsim.language.graph import Graph
    from lagsim.language.tables import Data

    Cells = NDArray[np.void]  # time intervals: lo, hi, task, states of surfaces


class Values:
    """Function of the time t that returns the values of some graph nodes.

    For many times it is faster than `evaluate`, since nodes that do not depend on t are
    evaluated once.

    Parameters
    ----------
    g : Graph
        Expression graph of the model.
    nodes : sequence of int
        Nodes to evaluate; the nodes depend on t and on parameters only.
    values : mapping of str to float
        Values of the parameters.
    """

    def __init__(
        self, g: Graph, nodes: Sequence[int], values: Mapping[str, float]
    ) -> None:
        moving = g.dependent(nodes, ("t",))
        cone = g.cone(nodes)
        fixed = [n for n in cone if n not in moving]
        self.nodes = nodes
        self.found = dict(zip(fixed, evaluate(g, fixed, values), strict=True))
        self.time = g.variable("t")
        self.program = [
            (n, OPERATIONS[g.ops[n]], g.args[n])
            for n in cone
            if n in moving and n != self.time
        ]

    def __call__(self, t: float) -> list[float]:
        """Return the values of the nodes at time t, in the order of `nodes`."""
        found = self.found
        found[self.time] = t
        for n, row, args in self.program:
            found[n] = row(*[found[a] for a in args])
        return [found[n] for n in self.nodes]


def first_change(discrete: Values, lo: float, hi: float) -> float:
    """Return the first double in (lo, hi] at which `discrete` differs from that at lo.

    Located by bisection, which supposes one change in the interval.
    """
    old = discrete(lo)
    while lo < (t := lo + 0.5 * (hi - lo)) < hi:
        lo, hi = (t, hi) if _equal(discrete(t), old) else (lo, t)
    return hi


PARTS = 8  # parts into which a cell is divided
BATCH = 1024  # largest number of cells evaluated together
FAINT = 4.0  # multiple of its rounding error within which a surface counts as zero
GROWTH = 64  # length of an undecidable interval over that of a cell added to it
# Variation of a surface in a cell over its rounding error up to which samples decide
# that it is zero: of a smooth surface, and of one whose slope may jump (abs, max).
SMOOTH, KINKED = 2.0**36, 2.0**30
# Parts of an interval at which it is tested whether a surface stays at a step.
SAMPLED = (0.11, 0.381966, 0.5, 0.723607)
LONG = 2.0**-10  # length over t from which both ends of a doubtful interval count
PATIENCE = 200_000  # cells evaluated without a crossing before a pause is reported

# State of a surface in a cell: its discrete value is constant; it crosses once,
# monotone, with known values at both ends; it stays within rounding of a step, provably
# or at all samples; or undecided.
KEPT, CROSSED, HIDDEN, FLAT, OPEN = range(5)
# Task of a cell: evaluate, discard, divide, or return.
_NEW, _CLEAR, _SPLIT, _READY = range(4)


class Cell(NamedTuple):
    """A time interval, with the state of each surface in it.

    Attributes
    ----------
    lo, hi : float
        The ends of the interval.
    states : sequence of int
        The state of each surface: KEPT if its discrete value is constant, CROSSED if
        it has one step, HIDDEN or FLAT if the surface is within rounding of a step
        (provably, or at samples), else OPEN. Empty for a pause of the search at `lo`.
    """

    lo: float
    hi: float
    states: Sequence[int]


class Division:
    """Search for the changes of one discrete function of t, by division of time.

    Parameters
    ----------
    g : Graph
        Expression graph of the model.
    discrete : int
        Node of the discrete function.
    values : mapping of str to float
        Values of the parameters.
    start, end : float
        The time interval that is searched.
    """

    def __init__(
        self,
        g: Graph,
        discrete: int,
        values: Mapping[str, float],
        start: float,
        end: float,
    ) -> None:
        self.start, self.end, self.discrete = start, end, discrete
        timed = g.dependent([discrete], ("t",))
        self.surfaces = [s for s in surfaces(g, discrete) if s.discrete in timed]
        nodes = [s.node for s in self.surfaces]
        slopes = tangent(g, nodes, {g.variable("t"): g.one})
        self.enclose = Enclosures(g, [*nodes, *slopes], values)
        self.arguments = Values(g, nodes, values)
        # Whether a surface has been found within rounding of a step in some cell.
        self.meets_step = False
        discretes = (Values(g, [s.discrete], values) for s in self.surfaces)
        self.locators = [_Locator(values_of) for values_of in discretes]
        joined = joined_conditions(g, discrete)
        fixed = [a for n in joined for a in g.args[n] if a not in timed]
        self.known = {
            n: point(float(x))
            for n, x in zip(fixed, evaluate(g, fixed, values), strict=True)
        }
        self.joined = [(n, RULES[g.ops[n]], g.args[n]) for n in joined if n in timed]

    def _stay(self, lo: float, hi: float) -> list[bool]:
        """Return for each surface whether it stays at a step, but for rounding.

        Its values and slopes are then within rounding of a step and of 0 at samples.

        lo, hi : the ends of an interval of time.
        """
        times = np.array([lo, *(lo + part * (hi - lo) for part in SAMPLED)])
        found = self.enclose(times, _next(times, np.full(len(times), hi)))
        flags = []
        for k, surface in enumerate(self.surfaces):
            samples = [found[k].part(slice(i, i + 1)) for i in range(1, len(times))]
            with np.errstate(all="ignore"):
                slopes = found[len(self.surfaces) + k]
                flags.append(bool(_vanishing(surface.op, samples, slopes, hi - lo)[0]))
        return flags

    def value_at_steps(self, lo: float, hi: float) -> float | None:
        """Return the value of the function where surfaces stay at their steps.

        These surfaces count as exactly at the step: sign(2.1 sin(t) - 3 (0.7 sin(t)))
        is 0. None if no surface stays at a step in the interval.

        lo, hi : the ends of an interval in which the function has no break.
        """
        stay = self._stay(lo, hi)
        if not any(stay):
            return None
        verdicts = dict(self.known)
        for k, surface in enumerate(self.surfaces):
            if stay[k]:
                argument = float(self.arguments(hi)[k])
                level = point(round(argument) if surface.op in WHOLE else 0.0)
                verdicts[surface.discrete] = _steps(surface.op, level)
            else:
                value = values_by_majority(self.locators[k].discrete, lo, hi)
                verdicts[surface.discrete] = point(value[0])
        for n, rule, args in self.joined:
            verdicts[n] = rule(*(verdicts[a] for a in args))
        return float(verdicts[self.discrete].lo[0])

    def times(self) -> Iterator[tuple[float, bool]]:
        """Yield pairs (time, pause) in order of time: possible changes, and pauses.

        `pause` is False at a time at which the function may change. It is True at a
        time reached after `PATIENCE` cells without a crossing. Such a time is yielded
        so that a search that finds no change returns to its caller.
        """
        last = self.start
        for cell in self._cells():
            self.meets_step |= HIDDEN in cell.states or FLAT in cell.states
            states: Sequence[int | None] = cell.states or [None] * len(self.locators)
            pairs = zip(self.locators, states, strict=True)
            found = [time for x, state in pairs for time in x.times(cell, state)]
            # A doubtful interval is known to contain a step only when it ends. The
            # place of the step in it is unknown: it is assumed no earlier than the last
            # reported time.
            for time in sorted(found):
                last = max(last, time)
                yield last, False
            if not cell.states:
                last = max(last, cell.lo)
                yield last, True
        for time in sorted(time for x in self.locators for time in x.flush()):
            yield max(last, time), False

    def _cells(self) -> Iterator[Cell]:
        """Yield the cells, in order of time, in which the function may change.

        A cell without states is a pause of the search, see `times`.
        """
        states = ("states", np.int8, (len(self.surfaces),))
        whole = np.zeros(1, [("lo", float), ("hi", float), ("task", np.int8), states])
        whole["lo"], whole["hi"] = self.start, self.end
        stack = [whole]
        rough = (math.nan, math.nan)  # the last interval left undecided
        effort = 0
        while stack:
            cells = stack.pop()
            if len(cells) > BATCH:
                stack.append(cells[BATCH:])
                cells = cells[:BATCH]
            effort += int(np.count_nonzero(cells["task"] == _NEW))
            self._enclose(cells)
            cells = cells[cells["task"] != _CLEAR]
            self._end_division(cells, rough)
            splits = np.flatnonzero(cells["task"] == _SPLIT)
            ready = int(splits[0]) if len(splits) else len(cells)
            done = (cells[name][:ready].tolist() for name in ("lo", "hi", "states"))
            for cell in map(Cell, *done):
                if OPEN in cell.states:
                    rough = (rough[0] if cell.lo == rough[1] else cell.lo, cell.hi)
                elif CROSSED in cell.states:
                    effort = 0
                yield cell
            if ready < len(cells):
                if effort > PATIENCE:
                    effort = 0
                    at = float(cells["lo"][ready])
                    yield Cell(at, at, [])
                stack.append(_divided(cells[ready:]))

    def _end_division(self, cells: Cells, rough: tuple[float, float]) -> None:
        """Set the task of cells that are too narrow to be divided to `_READY`.

        A cell is too narrow to be divided at the spacing of doubles; next to the
        interval `rough`, also where it is shorter than the length of `rough` over
        GROWTH, so that a long undecided interval costs few cells.

        cells : the cells, whose tasks are changed in place.
        rough : (lo, hi), the last interval of time in which the value of the function
            stayed undecided.
        """
        lo, hi, split = cells["lo"], cells["hi"], cells["task"] == _SPLIT
        if not len(cells):
            return
        least = np.maximum(
            np.spacing(np.maximum(-lo, hi)), finest(self.start, self.end)
        )
        if lo[0] == rough[1]:
            beside = np.append(True, lo[1:] == hi[:-1])
            beside = np.logical_and.accumulate(beside & split)
            narrow = (rough[1] - rough[0]) / GROWTH
            least = np.where(beside, np.maximum(least, narrow), least)
        cells["task"][split & (hi - lo <= least)] = _READY

    def _enclose(self, cells: Cells) -> None:
        """Enclose the values of each surface in new cells; set the cells' tasks.

        The task of a cell is to be divided, to be searched for steps, or none.

        cells : intervals of time.
        """
        new = np.flatnonzero(cells["task"] == _NEW)
        if not len(new):
            return
        lo, hi = cells["lo"][new], cells["hi"][new]
        middle, beside = lo + 0.5 * (hi - lo), lo + 0.0713 * (hi - lo)
        # Two neighbouring doubles each: at a single one a sum may be exact by chance.
        found = self.enclose(
            np.concatenate((lo, lo, hi, middle, beside)),
            np.concatenate((hi, lo, hi, _next(middle, hi), _next(beside, hi))),
        )
        verdicts = dict(self.known)
        task = np.full(len(new), _READY, np.int8)
        with np.errstate(all="ignore"):
            for k, surface in enumerate(self.surfaces):
                slope = found[len(self.surfaces) + k]
                verdict, state = _enclosed(surface.op, found[k], slope, lo, hi, middle)
                verdicts[surface.discrete] = verdict
                cells["states"][new, k] = state
                task[state == OPEN] = _SPLIT
        for n, rule, args in self.joined:
            verdicts[n] = rule(*(verdicts[a] for a in args))
        task[verdicts[self.discrete].is_constant] = _CLEAR
        cells["task"][new] = task


def finest(start: float, end: float) -> float:
    """Return the width of the narrowest cells near t = 0, in units of time.

    start, end : the ends of the time interval that is searched.
    """
    return 2.0**-106 * max(abs(start), abs(end))


def _divided(cells: Cells) -> Cells:
    """Return the cells, each cell marked for division replaced by `PARTS` cells."""
    split = cells["task"] == _SPLIT
    lo, hi = cells["lo"], cells["hi"]
    edges = (hi - lo)[:, None] * (np.arange(PARTS + 1) / PARTS) + lo[:, None]
    edges[:, -1] = hi
    edges[~split, 1:] = hi[~split, None]
    parts = cells.repeat(PARTS)
    parts["lo"], parts["hi"] = edges[:, :-1].ravel(), edges[:, 1:].ravel()
    parts["task"][parts["task"] == _SPLIT] = _NEW
    return parts[parts["lo"] < parts["hi"]]


def _next(t: Floats, most: Floats) -> Floats:
    after: Floats = np.minimum(np.nextafter(t, math.inf), most)
    return after


def _enclosed(
    op: str, s: Interval, slope: Interval, lo: Floats, hi: Floats, middle: Floats
) -> tuple[Interval, Any]:
    """Enclose the values of a discrete function in n cells, and find its states.

    Parameters
    ----------
    op : str
        The discrete function: `sign`, `floor`, a comparison.
    s, slope : Interval, shape (5n,)
        Values and slopes of the surface over the cells; then at lo, at hi, at the
        middle, and beside it.
    lo, hi, middle : ndarray, shape (n,)
        Ends and middles of the cells.

    Returns
    -------
    values : Interval, shape (n,)
        Enclosures of the values of the function.
    states : ndarray, shape (n,)
        The state of the surface in each cell, see `Cell`.
    """
    n = len(lo)
    cell, at_lo, at_hi, at_middle, beside = (
        s.part(slice(k * n, (k + 1) * n)) for k in range(5)
    )
    slopes, slope = slope, slope.part(slice(n))
    is_smooth = ~(cell.partial | cell.jumps | slope.partial | slope.undefined)
    steepest = np.maximum(np.abs(slope.lo), np.abs(slope.hi))
    reach = np.maximum(middle - lo, hi - middle) * steepest * (1.0 + TERM_ROUNDOFF)
    reach = np.where(is_smooth, reach, math.inf)
    # By the mean value theorem: its error is of second order in the width of the cell.
    refined = Interval(
        np.fmax(cell.lo, np.nextafter(at_middle.lo - reach, -math.inf)),
        np.fmin(cell.hi, np.nextafter(at_middle.hi + reach, math.inf)),
        cell.partial,
        cell.jumps,
    )
    undefined = cell.undefined
    refined.lo[undefined] = refined.hi[undefined] = math.nan
    samples = [at_lo, at_hi, at_middle, beside]
    verdict, at_lo, at_hi = (_steps(op, x) for x in (refined, at_lo, at_hi))
    # Monotone, with known values at both ends: constant if these are equal.
    has_one_sign = is_smooth & ((slope.lo > 0.0) | (slope.hi < 0.0))
    monotone = has_one_sign & at_lo.is_constant & at_hi.is_constant
    equal = monotone & (at_lo.lo == at_hi.lo)
    known = interval(
        np.where(equal, at_lo.lo, verdict.lo),
        np.where(equal, at_lo.lo, verdict.hi),
        verdict.partial,
    )
    crossed: Flags = monotone & ((op == "sign") | (verdict.width <= 1.0))
    # Further division is of no use: rounding errors hide the step.
    error = np.minimum(at_middle.width, beside.width)
    about = interval(at_middle.lo - FAINT * error, at_middle.hi + FAINT * error)
    hidden = is_smooth & ~_steps(op, about).is_constant
    # Errors grow with t (a phase): they are compared only within a factor of 2 in t.
    hidden &= hi - lo <= 0.5 * np.maximum(-lo, hi)
    most = np.where(slope.jumps, KINKED, SMOOTH)
    flat = hidden & (refined.width <= most * error)
    if flat.any():
        flat &= _vanishing(op, samples, slopes)
    hidden &= refined.width <= 2.0 * FAINT * error
    state = np.select(
        [known.is_constant, crossed, hidden, flat], [KEPT, CROSSED, HIDDEN, FLAT], OPEN
    )
    return known, state


def _vanishing(
    op: str, samples: Sequence[Interval], slopes: Interval, length: float = math.inf
) -> Flags:
    """Return whether a surface and its slope are within rounding of zero at samples.

    A slope that is a number has no enclosure of its rounding, as 0.3 - 3*0.1. It counts
    as 0 if it changes the surface by no more than its rounding in all of a long time.

    Parameters
    ----------
    op : str
        The discrete function. The surface may be near any of its steps.
    samples : sequence of Interval, shape (n,)
        Values of the surface at four points of each cell.
    slopes : Interval, shape (5n,)
        Slopes over the cells, then at these points.
    length : float
        The time.
    """
    n = len(samples[0].lo)
    rates = [slopes.part(slice(k * n, (k + 1) * n)) for k in range(1, 5)]
    found: Flags = np.ones(n, bool)
    # At one point alone a sum may be exact: the largest of the errors holds for all.
    error = FAINT * np.maximum.reduce([x.width for x in samples])
    noise = FAINT * np.maximum.reduce([x.width for x in rates]) + error / length
    for x, rate in zip(samples, rates, strict=True):
        found &= ~_steps(op, interval(x.lo - error, x.hi + error)).is_constant
        found &= (rate.lo - noise <= 0.0) & (rate.hi + noise >= 0.0)
    return found


def _steps(op: str, s: Interval) -> Interval:
    """Return the enclosure of the discrete function `op` over values s of a surface."""
    return RULES[op](s) if op in STEPS else RULES[op](s, interval(0.0, 0.0))


class Prevailing:
    """Values of discrete functions of t between two breaks, and the search of breaks.

    Each value is that at most sampled times. A function that stays at a step has the
    value of the step instead, since samples there are decided by rounding.

    Parameters
    ----------
    g : Graph
        Expression graph of the model.
    discrete : sequence of int
        Nodes of conditions or of sign, heaviside, floor, ceil, that depend on t and on
        parameters only.
    values : mapping of str to float
        Values of the parameters.
    start, end : float
        The time interval.

    Attributes
    ----------
    times : iterator of (float, bool)
        Times in order at which a function may change, see `Division.times`.
    """

    def __init__(
        self,
        g: Graph,
        discrete: Sequence[int],
        values: Mapping[str, float],
        start: float,
        end: float,
    ) -> None:
        self.at = Values(g, discrete, values)
        self._divisions: dict[int, Division] = {}
        searches = []
        for k, node in enumerate(discrete):
            clock = TimedTable.of(g, node)
            if clock is None:
                self._divisions[k] = Division(g, node, values, start, end)
                searches.append(self._divisions[k].times())
            else:
                searches.append(_knots_located(g, node, clock, values, (start, end)))
        self.times = heapq.merge(*searches)

    def __call__(self, lo: float, hi: float) -> list[float]:
        """Return the values of all functions between the times lo and hi.

        The interval has no break, and breaks have been searched up to its end.
        """
        found = values_by_majority(self.at, lo, hi)
        for k, division in self._divisions.items():
            if division.meets_step:
                value = division.value_at_steps(lo, hi)
                found[k] = found[k] if value is None else value
        return found


NEIGHBOURS = 4  # units in the last place within which two breaks are one


def breaks_of(value: Prevailing, start: float, end: float) -> Iterator[float]:
    """Yield the times at which any of the functions `value` changes, in order.

    value : the functions; their search of breaks is used up.
    start, end : times; the breaks lie strictly in between.
    """
    before: list[float] | None = None
    for this, following in pairwise(_clusters(value.times, start, end)):
        after = value(this.last, following.first)
        if before is not None and (this.pause or not _equal(after, before)):
            yield this.first
        before = after


class TimedTable(NamedTuple):
    """Table whose argument is linear in t: a t + b.

    Attributes
    ----------
    axis
        The arguments (knots) of the table.
    argument, rate
        Nodes of a t + b and of a.
    """

    axis: Data
    argument: int
    rate: int

    @classmethod
    def of(cls, g: Graph, discrete: int) -> TimedTable | None:
        """Return the table of a t + b whose cell number is the node `discrete`.

        None where the node is no cell of a table, or its argument is not linear in t.
        """
        cell = cell_of(g, discrete)
        if cell is None or _jumps(g, cell[1]):
            return None
        (rate,) = tangent(g, [cell[1]], {g.variable("t"): g.one})
        return None if "t" in g.depends([rate]) else cls(*cell, rate)

    def knots(
        self, g: Graph, values: Mapping[str, float], start: float, end: float
    ) -> Iterator[tuple[float, int, int]]:
        """Yield (time, cell before, cell after) of each knot from `start` to `end`.

        The times are exact to rounding. The iterator is lazy: each time is computed
        when it is requested.

        values : the values of the parameters.
        """
        at = Values(g, [self.argument, self.rate], values)
        (first, a), (last, _) = at(start), at(end)
        up = a > 0.0
        for k, knot in knots_between(self.axis, first, last) if first != last else ():
            yield start + (knot - first) / a, k - up, k - (not up)


def _jumps(g: Graph, argument: int) -> bool:
    """Whether the node `argument` jumps in t, which its derivative does not show."""
    timed = g.dependent([argument], ("t",))
    return any(g.ops[n] in STEPS | CHOOSING for n in timed)


def _knots_located(
    g: Graph,
    discrete: int,
    clock: TimedTable,
    values: Mapping[str, float],
    ends: tuple[float, float],
) -> Iterator[tuple[float, bool]]:
    """Yield the first time in each cell that the argument of a table enters.

    Each item is a pair (time, False): the time is no pause of the search, see
    `Division.times`. Each time lies near a knot of `TimedTable.knots`.

    discrete : the node of the number of the cell.
    clock : the table.
    ends : start and end of the run.
    values : the values of the parameters.
    """
    value = Values(g, [discrete], values)
    for time, _, _ in clock.knots(g, values, *ends):
        reach = max(math.ulp(time), finest(*ends))
        while value(time - reach) == value(time + reach):
            reach *= 2.0
        yield first_change(value, time - reach, time + reach), False


class _Cluster(NamedTuple):
    """Breaks that count as one: their first and last time; whether one is a pause."""

    first: float
    last: float
    pause: bool = False


def _clusters(
    times: Iterable[tuple[float, bool]], start: float, end: float
) -> Iterator[_Cluster]:
    """Yield clusters of breaks within one instant; first `start`, last `end`.

    times : pairs (time, pause) in order of time, see `Division.times`.
    start, end : the ends of the run, each a cluster of its own.
    """

    def near(t: float) -> float:
        return max(NEIGHBOURS * math.ulp(t), finest(start, end))

    current = _Cluster(start, start)
    for time, pause in times:
        if time >= end - near(end):
            break
        first, last, paused = current
        if time <= first + near(first):
            current = _Cluster(first, max(time, last), paused or pause)
        else:
            yield current
            current = _Cluster(time, time, pause)
    yield current
    yield _Cluster(end, end)


class _Locator:
    """Location of the steps of one surface's discrete value, cell by cell."""

    def __init__(self, discrete: Values) -> None:
        self.discrete = discrete
        # The doubtful interval (lo, hi) that has not ended yet, and its state.
        self.doubtful: tuple[float, float, int] | None = None
        self.entered = False  # whether `lo` of the doubtful interval has been returned

    def times(self, cell: Cell, state: int | None) -> list[float]:
        """Return the times of the steps that are certain once `cell` has been examined.

        The list may be empty.

        cell : the next interval of time.
        state : the state of the surface in the cell, see `Cell`; None for a pause.
        """
        lo, hi, _ = cell
        if state is None and self.doubtful and self.doubtful[1] == lo:
            return []
        found = []
        faint, before = (HIDDEN, FLAT), self.doubtful
        if before and before[1] == lo and state in faint and before[2] in faint:
            state = FLAT if FLAT in (state, before[2]) else HIDDEN
        elif not before or before[1:] != (lo, state):
            found = self.flush()
        if state in (HIDDEN, FLAT, OPEN):
            lo = self.doubtful[0] if self.doubtful else lo
            self.doubtful = (lo, hi, state)
        long = hi - lo > LONG * max(-lo, hi)
        if state in (FLAT, OPEN) and long and not self.entered:
            self.entered = True
            return [*found, lo]
        return [*found, *self._change(lo, hi)] if state == CROSSED else found

    def flush(self) -> list[float]:
        """Return the times at which the value may change in the doubtful interval.

        The time of the step in it, if it contains one; the end of a long interval whose
        start has been returned by `times`. The interval is deleted.
        """
        if self.doubtful is None:
            return []
        (lo, hi, _), entered = self.doubtful, self.entered
        self.doubtful, self.entered = None, False
        return [hi] if entered else self._change(lo, hi)

    def _change(self, lo: float, hi: float) -> list[float]:
        if _equal(self.discrete(hi), self.discrete(lo)):
            return []
        return [first_change(self.discrete, lo, hi)]


def values_by_majority(
    value: Callable[[float], Sequence[float]], start: float, end: float
) -> list[float]:
    """Return the values of step functions on an interval without any step.

    Each value is that of at least two of three samples in (start, end), so that a value
    that a function has at a single instant, like sign(0), is not returned.

    value : t -> the values of all functions.
    """
    samples = [
        [float(x) for x in value(start + part * (end - start))]
        for part in (0.381966, 0.5, 0.723607)
    ]
    return [
        a if _same(a, b) or _same(a, c) else b for a, b, c in zip(*samples, strict=True)
    ]


def _equal(a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether two lists of values are equal; 0 equals -0, and nan equals nan."""
    return all(map(_same, a, b))


def _same(a: float, b: float) -> bool:
    return a == b or (math.isnan(a) and math.isnan(b))
