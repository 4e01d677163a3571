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
  faster than they are, atan2(0, 0)), the stretch left undecided may grow, by cells of
  up to 1/64 of its length, until something can; its two ends are reported. Breaks that
  accumulate (sin(1/t) toward 0) come one by one, as far as rounding lets them be told
  apart.
- After 200,000 cells without a break the time reached is reported as a needless
  one, so that each request returns within seconds. It costs a restart of the
  method, nothing else.

Near t = 0 times are resolved to 1e-32 of the larger of start and end.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from lagsim.language.derivatives import tangent
from lagsim.mechanics.surfaces import surfaces
from lagsim.mechanics.switches import prevailing
from lagsim.run.events.cells import CROSSED, GROWTH, HIDDEN, OPEN, Cell, Division
from lagsim.run.events.crossings import Values, first_change, newton

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.surfaces import Surface

NEIGHBOURS = 4  # units in the last place within which two breaks are one


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
    finest = 2.0**-106 * max(abs(start), abs(end))
    times = heapq.merge(*(_candidates(g, d, values, start, end) for d in discrete))
    before: list[float] | None = None
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


def _candidates(
    g: Graph, discrete: int, values: Mapping[str, float], start: float, end: float
) -> Iterator[tuple[float, bool]]:
    """Give times at which one function may change, and whether each is a pause."""
    timed = g.dependent([discrete], ("t",))
    parts = [s for s in surfaces(g, discrete) if s.discrete in timed]
    division = Division(g, discrete, parts, values, start, end)
    locators = [_Locator(g, s, values, division) for s in parts]
    last = start
    for cell in division.cells():
        found = [
            time
            for k, locator in enumerate(locators)
            for time in locator.times(cell, cell.states[k] if cell.states else None)
        ]
        # A doubtful stretch is known to step only when it ends. Where in it, nobody
        # can tell: no earlier than what has been reported.
        for time in sorted(found):
            last = max(last, time)
            yield last, False
        if not cell.states:
            last = max(last, cell.lo)
            yield last, True
    for time in sorted(time for locator in locators for time in locator.flush()):
        yield max(last, time), False


class _Locator:
    """Locates the steps of one surface, cell after cell."""

    def __init__(
        self,
        g: Graph,
        surface: Surface,
        values: Mapping[str, float],
        division: Division,
    ) -> None:
        self.op = surface.op
        self.division = division
        self.step = Values(g, [surface.discrete], values)
        (slope,) = tangent(g, [surface.node], {g.variable("t"): g.one})
        self.surface = Values(g, [surface.node, slope], values)
        # The doubtful stretch that has not ended yet, and its state.
        self.doubtful: tuple[float, float, int] | None = None
        self.given_up = False  # it is long; its beginning has been reported

    def times(self, cell: Cell, state: int | None) -> list[float]:
        """Give the steps known by the end of `cell`; `state` is that of the surface."""
        lo, hi, _ = cell
        if state is None and self.doubtful and self.doubtful[1] == lo:
            return []
        found = []
        if not self.doubtful or self.doubtful[1:] != (lo, state):
            found = self.flush()
        if state in (HIDDEN, OPEN):
            lo = self.doubtful[0] if self.doubtful else lo
            self.doubtful = (lo, hi, state)
            if state == OPEN and not self.given_up and self._long(lo, hi):
                self.given_up = True
                found.append(lo)
        return [*found, *self._crossing(lo, hi)] if state == CROSSED else found

    def _long(self, lo: float, hi: float) -> bool:
        return hi - lo > GROWTH * max(math.ulp(max(-lo, hi)), self.division.finest)

    def flush(self) -> list[float]:
        """Give the steps of the doubtful stretch, which has ended."""
        if self.doubtful is None:
            return []
        lo, hi, _ = self.doubtful
        given_up = self.given_up
        self.doubtful, self.given_up = None, False
        return [hi] if given_up else self._change(lo + 0.5 * (hi - lo), lo, hi)

    def _crossing(self, lo: float, hi: float) -> list[float]:
        (old,), (new,) = self.step(lo), self.step(hi)
        level = 0.0
        if self.op in ("floor", "ceil"):
            level = max(old, new) - (self.op == "ceil")
        return self._change(newton(self.surface, level, lo, hi), lo, hi)

    def _change(self, guess: float, lo: float, hi: float) -> list[float]:
        old = repr(self.step(lo))  # nan equals nan
        if repr(self.step(hi)) == old:
            return []
        return [first_change(lambda t: repr(self.step(t)) != old, guess, lo, hi)]
