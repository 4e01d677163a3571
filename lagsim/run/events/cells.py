"""Time divided into cells, fine enough to know where a discrete function may change.

In a cell left out the function provably keeps its value; in one given, enough is known
of the surfaces that could change it to locate their crossings.

See breaks.py for what is promised. Cells come in order; memory is bounded, since the
division goes down the leftmost cells first, a batch of them at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import STEPS
from lagsim.language.intervals import (
    RULES,
    SLACK,
    Enclosures,
    Flags,
    Floats,
    Interval,
    interval,
    point,
)
from lagsim.mechanics.surfaces import joined_conditions

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.surfaces import Surface

Codes = npt.NDArray[np.int8]

PARTS = 8  # into which a cell is divided
BATCH = 1024  # cells looked at together, at most
FAINT = 4.0  # rounding errors of a surface within which it counts as zero
GROWTH = 64  # an undecidable stretch over the cells it may swallow
PATIENCE = 200_000  # cells looked at without a crossing

# What a surface does in a cell: keep its discrete value; cross once, monotone, with
# known values at both ends; stay within rounding of where it steps; or who knows.
KEPT, CROSSED, HIDDEN, OPEN = range(4)
# What is done with a cell.
_NEW, _CLEAR, _SPLIT, _READY = range(4)


class Cell(NamedTuple):
    """A stretch of time, and what each surface does there; empty for a pause."""

    lo: float
    hi: float
    states: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Cells:
    lo: Floats
    hi: Floats
    task: Codes
    states: Codes  # one row per cell

    def __getitem__(self, which: Any) -> _Cells:
        """Give some of the cells."""
        return _Cells(
            self.lo[which], self.hi[which], self.task[which], self.states[which]
        )

    def divided(self) -> _Cells:
        """Divide the cells that want it, and keep the others."""
        split = self.task == _SPLIT
        edges = (self.hi - self.lo)[:, None] * (np.arange(PARTS + 1) / PARTS)
        edges += self.lo[:, None]
        edges[:, -1] = self.hi
        edges[~split, 1:] = self.hi[~split, None]
        parts = _Cells(
            edges[:, :-1].ravel(),
            edges[:, 1:].ravel(),
            np.where(split, _NEW, self.task).astype(np.int8).repeat(PARTS),
            self.states.repeat(PARTS, axis=0),
        )
        return parts[parts.lo < parts.hi]


class Division:
    """Divides time for one discrete function.

    Attributes
    ----------
    finest
        The width of cells that are not divided further near t = 0.
    """

    def __init__(
        self,
        g: Graph,
        discrete: int,
        surfaces: Sequence[Surface],
        values: Mapping[str, float],
        start: float,
        end: float,
    ) -> None:
        self.discrete = discrete
        self.surfaces = surfaces
        nodes = [s.node for s in surfaces]
        slopes = tangent(g, nodes, {g.variable("t"): g.one})
        self.enclose = Enclosures(g, [*nodes, *slopes], values)
        joined = joined_conditions(g, discrete)
        timed = g.dependent([discrete], ("t",))
        fixed = [a for n in joined for a in g.args[n] if a not in timed]
        self.known = {
            n: point(float(x))
            for n, x in zip(fixed, evaluate(g, fixed, values), strict=True)
        }
        self.joined = [(n, RULES[g.ops[n]], g.args[n]) for n in joined if n in timed]
        self.start, self.end = start, end
        self.finest = 2.0**-106 * max(abs(start), abs(end))

    def cells(self) -> Iterator[Cell]:
        """Give the cells in which the function may change, in order."""
        whole = _Cells(
            np.array([self.start]),
            np.array([self.end]),
            np.array([_NEW], np.int8),
            np.zeros((1, len(self.surfaces)), np.int8),
        )
        stack = [whole]
        rough = (math.nan, math.nan)  # the last stretch that was given up
        effort = 0
        while stack:
            cells = stack.pop()
            if len(cells.lo) > BATCH:
                stack.append(cells[BATCH:])
                cells = cells[:BATCH]
            effort += int(np.count_nonzero(cells.task == _NEW))
            self._look(cells)
            cells = cells[cells.task != _CLEAR]
            self._give_up(cells, rough)
            splits = np.flatnonzero(cells.task == _SPLIT)
            ready = int(splits[0]) if len(splits) else len(cells.lo)
            for cell in _listed(cells[:ready]):
                if OPEN in cell.states:
                    rough = (rough[0] if cell.lo == rough[1] else cell.lo, cell.hi)
                elif CROSSED in cell.states:
                    effort = 0
                yield cell
            if ready < len(cells.lo):
                if effort > PATIENCE:
                    effort = 0
                    at = float(cells.lo[ready])
                    yield Cell(at, at, ())
                stack.append(cells[ready:].divided())

    def _give_up(self, cells: _Cells, rough: tuple[float, float]) -> None:
        """Divide no cell that is too narrow, or beside a long undecidable stretch."""
        lo, hi, task = cells.lo, cells.hi, cells.task
        if not len(lo):
            return
        least = np.maximum(np.spacing(np.maximum(-lo, hi)), self.finest)
        if lo[0] == rough[1]:
            beside = np.append(True, lo[1:] == hi[:-1])
            beside = np.logical_and.accumulate(beside & (task == _SPLIT))
            swallowed = (rough[1] - rough[0]) / GROWTH
            least = np.where(beside, np.maximum(least, swallowed), least)
        task[(task == _SPLIT) & (hi - lo <= least)] = _READY

    def _look(self, cells: _Cells) -> None:
        """Find what each surface does in the new cells, and what to do with those."""
        new = np.flatnonzero(cells.task == _NEW)
        if not len(new):
            return
        lo, hi = cells.lo[new], cells.hi[new]
        middle, beside = lo + 0.5 * (hi - lo), lo + 0.0713 * (hi - lo)
        # Two neighbouring doubles each: at a single one a sum may happen to be exact.
        found = self.enclose(
            np.concatenate((lo, lo, hi, middle, beside)),
            np.concatenate((hi, lo, hi, _next(middle, hi), _next(beside, hi))),
        )
        verdicts = dict(self.known)
        task = np.full(len(new), _READY, np.int8)
        with np.errstate(all="ignore"):
            for k, surface in enumerate(self.surfaces):
                slope = found[len(self.surfaces) + k]
                look = _Look(surface.op, found[k], slope, lo, hi, middle)
                verdicts[surface.discrete] = look.verdict
                cells.states[new, k] = look.state
                task[look.state == OPEN] = _SPLIT
        for n, rule, args in self.joined:
            verdicts[n] = rule(*(verdicts[a] for a in args))
        task[verdicts[self.discrete].single] = _CLEAR
        cells.task[new] = task


def _next(t: Floats, most: Floats) -> Floats:
    after: Floats = np.minimum(np.nextafter(t, math.inf), most)
    return after


def _listed(cells: _Cells) -> Iterator[Cell]:
    rows = zip(cells.lo.tolist(), cells.hi.tolist(), cells.states.tolist(), strict=True)
    return (Cell(lo, hi, tuple(states)) for lo, hi, states in rows)


class _Look:
    """One surface over cells: its discrete values, and what is known where it steps."""

    def __init__(
        self,
        op: str,
        s: Interval,
        slope: Interval,
        lo: Floats,
        hi: Floats,
        middle: Floats,
    ) -> None:
        n = len(lo)
        cell, at_lo, at_hi, at_middle, beside = (
            s[k * n : (k + 1) * n] for k in range(5)
        )
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
        crossed: Flags = monotone & ((op == "sign") | (verdict.width <= 1.0))
        # Nothing more is seen by looking closer: rounding errors hide the step.
        error = np.minimum(at_middle.width, beside.width)
        about = interval(at_middle.lo - FAINT * error, at_middle.hi + FAINT * error)
        hidden: Flags = (
            tame & ~_steps(op, about).single & (refined.width <= 2.0 * FAINT * error)
        )
        # Errors grow with t (a phase): they are compared within a factor of two of it.
        hidden &= hi - lo <= 0.5 * np.maximum(-lo, hi)
        state = np.where(hidden, HIDDEN, OPEN)
        state = np.where(crossed, CROSSED, state)
        self.state = np.where(self.verdict.single, KEPT, state).astype(np.int8)


def _steps(op: str, s: Interval) -> Interval:
    """Give the values of the discrete function `op` of a surface."""
    return RULES[op](s) if op in STEPS else RULES[op](s, interval(0.0, 0.0))
