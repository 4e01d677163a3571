"""The times at which discrete functions of t alone change: rigorous, lazy, exact.

Interval arithmetic rules out every stretch of time on which a function provably keeps
its value. Where each surface that could change it is provably monotone, its crossing is
located to the double. All else is divided further. So no pulse is missed, however
narrow, as long as it is wider than a few units in the last place of t.

The conventions:

- A break is the first double at which the function has no longer its old value:
  `heaviside(t - 1)` and `sign(t - 1)` break at 1.0, `t > 1` at the next double.
- A value taken at one instant only (sign(0), a touching root) makes no break.
- Breaks closer than 4 units in the last place are one, the first; so are those that
  close to the start or the end with these, which are not reported.
- A surface that passes zero by no more than a few times the rounding error of its own
  evaluation may not switch at all; the values on both sides of the doubtful stretch
  decide, and if they differ it breaks once, where the computed value changes.
- Where nothing can be decided down to neighbouring doubles (a square wave of `floor`s
  faster than they are), the stretch left undecided may grow, by cells of up to 1/64 of
  its length, until something can; its two ends are reported. Breaks that accumulate
  (sin(1/t) toward 0) come one by one, as far as rounding lets them be told apart.
- After 200,000 cells without a break the time reached is reported as a needless
  one, so that each request returns within about a second. It costs a restart of the
  method, nothing else.

Near t = 0 times are resolved to 1e-32 of the larger of start and end.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from lagsim.crossings import Values, first_change, newton
from lagsim.expressions.derivatives import tangent
from lagsim.expressions.enclosures import Enclosures
from lagsim.expressions.evaluate import evaluate
from lagsim.expressions.interval_rules import RULES, SLACK
from lagsim.expressions.intervals import Flags, Floats, Interval, interval, point
from lagsim.switches import joined_conditions, prevailing, surfaces

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lagsim.expressions.graph import Graph

Kinds = npt.NDArray[np.int8]

NEIGHBOURS = 4  # units in the last place within which two breaks are one
PARTS = 8  # into which a cell is divided
BATCH = 1024  # cells looked at together, at most
FAINT = 4.0  # rounding errors of a surface within which it counts as zero
GROWTH = 64  # an undecidable stretch over the cells it may swallow
PATIENCE = 200_000  # cells looked at without a break

# What is known of a cell.
_NEW, _CLEAR, _SPLIT, _CROSSED, _FAINT, _ROUGH, _PAUSE = range(7)


def break_times(
    g: Graph,
    discrete: Sequence[int],
    values: Mapping[str, float],
    start: float,
    end: float,
) -> Iterator[float]:
    """Give the times at which any of `discrete` changes, in order, one at a time.

    Parameters
    ----------
    g, discrete
        Conditions or sign, heaviside, floor, ceil, of t and parameters only.
    values
        The parameters.
    start, end
        The breaks lie strictly between them.
    """
    if not discrete or not start < end:
        return
    value = Values(g, discrete, values)
    streams = [_Search(g, d, values, start, end) for d in discrete]
    before: list[float] | None = None
    finest = streams[0].finest
    times = heapq.merge(*(stream.breaks() for stream in streams))
    for this, following in pairwise(_clusters(times, start, end, finest)):
        after = prevailing(value, this.last, following.first)
        if before is not None and (this.pause or repr(after) != repr(before)):
            yield this.first
        before = after


@dataclass(slots=True)
class _Cluster:
    """Breaks that count as one."""

    first: float
    last: float
    pause: bool


def _clusters(
    times: Iterable[tuple[float, bool]], start: float, end: float, finest: float
) -> Iterator[_Cluster]:
    """Give the start, the clusters inside, and the end."""
    current = _Cluster(start, start, pause=False)
    last = end - max(NEIGHBOURS * math.ulp(end), finest)
    for time, pause in times:
        if time >= last:
            break
        near = max(NEIGHBOURS * math.ulp(current.first), finest)
        if time <= current.first + near:
            current.last = max(time, current.last)
            current.pause |= pause
        else:
            yield current
            current = _Cluster(time, time, pause)
    yield current
    yield _Cluster(end, end, pause=False)


class _Search:
    """Finds the breaks of one discrete function."""

    def __init__(
        self,
        g: Graph,
        discrete: int,
        values: Mapping[str, float],
        start: float,
        end: float,
    ) -> None:
        timed = g.dependent([discrete], ("t",))
        self.surfaces = [s for s in surfaces(g, discrete) if s.discrete in timed]
        nodes = [s.node for s in self.surfaces]
        slopes = tangent(g, nodes, {g.variable("t"): g.one})
        self.enclose = Enclosures(g, [*nodes, *slopes], values)
        joined = joined_conditions(g, discrete)
        fixed = [a for n in joined for a in g.args[n] if a not in timed]
        self.known = {
            n: point(float(x))
            for n, x in zip(fixed, evaluate(g, fixed, values), strict=True)
        }
        self.joined = [(n, RULES[g.ops[n]], g.args[n]) for n in joined if n in timed]
        self.discrete = discrete
        self.value = Values(g, [discrete], values)
        self.steps = [Values(g, [s.discrete], values) for s in self.surfaces]
        self.slopes = [
            Values(g, [s.node, slope], values)
            for s, slope in zip(self.surfaces, slopes, strict=True)
        ]
        self.start, self.end = start, end
        self.finest = 2.0**-106 * max(abs(start), abs(end))

    # ---------------------------------------------------------------- the breaks

    def breaks(self) -> Iterator[tuple[float, bool]]:
        """Give times at which the function may change, and whether each is a pause."""
        zone: tuple[float, float, bool] | None = None
        for lo, hi, kind in self._cells():
            doubtful = kind in (_FAINT, _ROUGH)
            rough = kind == _ROUGH
            if zone and doubtful and zone[1] == lo:
                zone = zone[0], hi, zone[2] or rough
                continue
            if zone:
                yield from self._ends(*zone)
            zone = (lo, hi, rough) if doubtful else None
            if kind == _CROSSED:
                yield from self._crossings(lo, hi)
            elif kind == _PAUSE:
                yield lo, True
        if zone:
            yield from self._ends(*zone)

    def _ends(self, lo: float, hi: float, rough: bool) -> Iterator[tuple[float, bool]]:
        """Give the breaks of a stretch in which nothing could be decided."""
        if rough and hi - lo > GROWTH * max(np.spacing(max(-lo, hi)), self.finest):
            yield lo, False
            yield hi, False
            return
        if repr(self.value(lo)) != repr(self.value(hi)):
            middle = lo + 0.5 * (hi - lo)
            yield _change(self.value, middle, lo, hi), False

    def _crossings(self, lo: float, hi: float) -> list[tuple[float, bool]]:
        """Give where each surface, monotone from `lo` to `hi`, is crossed."""
        found = []
        for surface, step, slope in zip(
            self.surfaces, self.steps, self.slopes, strict=True
        ):
            (old,), (new,) = step(lo), step(hi)
            if old == new:
                continue
            level = 0.0
            if surface.op in ("floor", "ceil"):
                level = max(old, new) - (surface.op == "ceil")
            guess = newton(slope, level, lo, hi)
            found.append((_change(step, guess, lo, hi), False))
        return sorted(found)

    # ----------------------------------------------------------------- the cells

    def _cells(self) -> Iterator[tuple[float, float, int]]:
        """Give the cells in which breaks may lie, in order, each with its kind."""
        stack = [
            (np.array([self.start]), np.array([self.end]), np.array([_NEW], np.int8))
        ]
        zone = (math.nan, math.nan)
        effort = 0
        while stack:
            lo, hi, kind = stack.pop()
            if len(lo) > BATCH:
                stack.append((lo[BATCH:], hi[BATCH:], kind[BATCH:]))
                lo, hi, kind = lo[:BATCH], hi[:BATCH], kind[:BATCH]
            new = kind == _NEW
            effort += int(np.count_nonzero(new))
            kind[new] = self._classify(lo[new], hi[new])
            keep = kind != _CLEAR
            lo, hi, kind = lo[keep], hi[keep], kind[keep]
            self._roughen(lo, hi, kind, zone)
            splits = np.flatnonzero(kind == _SPLIT)
            ready = int(splits[0]) if len(splits) else len(kind)
            for a, b, k in zip(
                lo[:ready].tolist(), hi[:ready].tolist(), kind[:ready].tolist(),
                strict=True,
            ):  # fmt: skip
                zone = (zone[0] if a == zone[1] else a, b)
                if k == _CROSSED:
                    zone, effort = (math.nan, math.nan), 0
                yield a, b, k
            if ready < len(kind):
                if effort > PATIENCE:
                    effort = 0
                    yield float(lo[ready]), float(lo[ready]), _PAUSE
                stack.append(_divided(lo[ready:], hi[ready:], kind[ready:]))

    def _roughen(
        self, lo: Floats, hi: Floats, kind: Kinds, zone: tuple[float, float]
    ) -> None:
        """Give up dividing cells too narrow, or beside a long undecidable stretch."""
        if not len(lo):
            return
        least = np.maximum(np.spacing(np.maximum(-lo, hi)), self.finest)
        if lo[0] == zone[1]:
            beside = np.append(True, lo[1:] == hi[:-1])
            beside = np.logical_and.accumulate(beside & (kind != _CROSSED))
            swallowed = (zone[1] - zone[0]) / GROWTH
            least = np.where(beside, np.maximum(least, swallowed), least)
        kind[(kind == _SPLIT) & (hi - lo <= least)] = _ROUGH

    def _classify(self, lo: Floats, hi: Floats) -> Kinds:
        """Give the kind of each cell: clear, crossed, faint, or to be divided."""
        if not len(lo):
            return np.array([], np.int8)
        middle = lo + 0.5 * (hi - lo)
        found = self.enclose(
            np.concatenate((lo, lo, middle, hi)), np.concatenate((hi, lo, middle, hi))
        )
        count = len(self.surfaces)
        verdicts = dict(self.known)
        crossed, faint = np.ones((2, len(lo)), np.bool_)
        with np.errstate(all="ignore"):
            for k, surface in enumerate(self.surfaces):
                look = _Look(surface.op, found[k], found[count + k], lo, middle, hi)
                verdicts[surface.discrete] = look.verdict
                crossed &= look.verdict.single | look.crossed
                faint &= look.verdict.single | look.crossed | look.faint
        for n, rule, args in self.joined:
            verdicts[n] = rule(*(verdicts[a] for a in args))
        kind = np.full(len(lo), _SPLIT, np.int8)
        kind[faint] = _FAINT
        kind[crossed] = _CROSSED
        kind[verdicts[self.discrete].single] = _CLEAR
        return kind


def _divided(lo: Floats, hi: Floats, kind: Kinds) -> tuple[Floats, Floats, Kinds]:
    """Divide the cells that want it, and keep the others."""
    split = kind == _SPLIT
    parts = np.arange(PARTS + 1) / PARTS
    edges = lo[:, None] + (hi - lo)[:, None] * parts
    edges[:, -1] = hi
    edges[~split, 1:] = hi[~split, None]
    new_kind = np.where(split, _NEW, kind).repeat(PARTS).astype(np.int8)
    new_lo, new_hi = edges[:, :-1].ravel(), edges[:, 1:].ravel()
    proper = new_lo < new_hi
    return new_lo[proper], new_hi[proper], new_kind[proper]


def _change(value: Values, guess: float, lo: float, hi: float) -> float:
    old = repr(value(lo))  # nan equals nan
    return first_change(lambda t: repr(value(t)) != old, guess, lo, hi)


class _Look:
    """One surface over cells: its discrete values, and what is known where it steps."""

    def __init__(
        self,
        op: str,
        s: Interval,
        slope: Interval,
        lo: Floats,
        middle: Floats,
        hi: Floats,
    ) -> None:
        n = len(lo)
        cell, at_lo, at_middle, at_hi = (s[k * n : (k + 1) * n] for k in range(4))
        slope = slope[:n]
        tame = ~(cell.partial | cell.jumps | slope.partial | slope.undefined)
        steepest = np.maximum(np.abs(slope.lo), np.abs(slope.hi))
        reach = np.maximum(middle - lo, hi - middle) * steepest * (1.0 + SLACK)
        reach = np.where(tame, reach, math.inf)
        # The mean value theorem: an error of second order in the width of the cell.
        refined = Interval(
            np.fmax(cell.lo, np.nextafter(at_middle.lo - reach, -math.inf)),
            np.fmin(cell.hi, np.nextafter(at_middle.hi + reach, math.inf)),
            cell.partial,
            cell.jumps,
        )
        undefined = cell.undefined
        refined.lo[undefined] = refined.hi[undefined] = math.nan
        errors = at_lo.width, at_middle.width, at_hi.width
        verdict, at_lo, at_hi = (_steps(op, x) for x in (refined, at_lo, at_hi))
        # Monotone, with known values at both ends: clear if they are equal.
        steep = tame & ((slope.lo > 0.0) | (slope.hi < 0.0))
        monotone = steep & at_lo.single & at_hi.single
        equal = monotone & (at_lo.lo == at_hi.lo)
        self.verdict = interval(
            np.where(equal, at_lo.lo, verdict.lo),
            np.where(equal, at_lo.lo, verdict.hi),
            verdict.partial,
        )
        self.crossed: Flags = monotone & ((op == "sign") | (verdict.width <= 1.0))
        # Nothing more is seen by looking closer: rounding errors hide the step.
        error = np.minimum(errors[0], np.minimum(errors[1], errors[2]))
        about = interval(at_middle.lo - FAINT * error, at_middle.hi + FAINT * error)
        self.faint: Flags = (
            tame & ~_steps(op, about).single & (refined.width <= 2.0 * FAINT * error)
        )


def _steps(op: str, s: Interval) -> Interval:
    """Give the values of the discrete function `op` of a surface."""
    return RULES[op](s, interval(0.0, 0.0)) if op in _COMPARISONS else RULES[op](s)


_COMPARISONS = ("lt", "le", "gt", "ge")
