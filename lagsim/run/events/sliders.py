"""Sliders without mass: which stick and which slide, and their velocities.

Those whose force is below its limit stick. Those at the limit slide where sticking
would lead beyond it: of several, each slips against its force or has a force that does
not grow, which is a linear complementarity problem for the slips. It is solved by
principal pivots, of the first row that is violated (K. G. Murty, Note on a Bard-type
scheme for solving the complementarity problem, Opsearch 11 (1974) 123; the stiffness of
springs is a P-matrix). Where no force changes at first, a moment later decides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods.parts import parameters as kept
from lagsim.notes import Event
from lagsim.run.events.kinematics import Kinematics
from lagsim.tolerances import LEAST_CLOSING, SATISFIED, SUM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc

# A force is at its limit within so many tolerances, as a contact closes.
CLOSING = 10.0
# A moment later is this part of the time between rows later.
SOON = 1e-6
# Pivots of so many sliders at their limits: one each, as a rule.
PIVOTS = 10
# Newton's steps to their velocities, which are linear but for dampers that are not.
STEPS = 8


class Settled(NamedTuple):
    """State of sliders: y (size,), what has changed, the constraints that jump."""

    y: Floats
    events: list[Event]
    jumps: list[str]


def at_edge(arc: Arc) -> float:
    """Part of its limit by which a force may be off it."""
    return float(min(CLOSING * max(arc.plan.tolerance, LEAST_CLOSING), SATISFIED))


def settle(arc: Arc, y: Floats) -> Settled:
    """Set how sliders move from a state on, and their velocities in it."""
    return _Sliders(arc, y).settled()


class _Sliders:
    """The sliders of a run at a state; two relations of one count as their first."""

    def __init__(self, arc: Arc, y: Floats) -> None:
        self.arc, self.y, self.p = arc, y.copy(), arc.system.p
        laws = arc.system.laws
        self.all = [k for k, law in enumerate(laws) if law.slider]
        self.own = [k for k in self.all if not 0 <= laws[k].pair < k]
        self.before = self.p.law_direction[self.own] != 0.0
        self.p.law_mode[self.all] = kept.HELD
        self._move(())
        forces = arc.runner.function("sliders", len(self.all))(arc.t, self.y)
        signs = dict(zip(self.all, np.where(forces < 0.0, -1.0, 1.0), strict=True))
        self.signs = {k: 1.0 if laws[k].pair >= 0 else signs[k] for k in self.own}

    def settled(self) -> Settled:
        """Return the state with what sticks at rest, and what slides on its way."""
        arc, laws, here = self.arc, self.arc.system.laws, self._at(self.own)
        edge, far = [], []
        for k in self.own:
            elastic, bound = laws[k].solved.holonomic, float(here.bounds[k])
            over = (here.residuals if elastic else here.rates)[k]
            rounding = (here.slack if elastic else here.still)[k]
            if over >= -at_edge(arc) * bound - rounding:
                edge.append(k)
            if elastic and over > SATISFIED * bound + rounding:
                far.append(laws[k].name)
        if far:
            return Settled(self.y, [], far)
        sliding = self._pivoted(edge)
        sliding |= self._later(edge, sliding)
        self._move(sliding)
        return Settled(self.y, self._events(sliding) if arc.steps else [], [])

    def _set(self, some: Collection[int]) -> None:
        self.p.law_direction[self.own] = 0.0
        for k in some:
            self.p.law_direction[k] = self.signs[k]

    def _move(self, sliding: Collection[int]) -> None:
        """Give sliders the velocities of those that slide, and of those that do not."""
        arc = self.arc
        self._set(sliding)
        own = self.p.law_place[self.all].astype(int)
        velocities = self.y[arc.velocities]
        change = arc.runner.function("velocity_step", arc.system.n + 3)
        for _ in range(STEPS):
            step = change(arc.t, self.y)[own]
            velocities[own] += step
            if (np.abs(step) <= SUM_ROUNDOFF * np.abs(velocities[own])).all():
                return

    def _at(self, some: Collection[int], later: float = 0.0) -> Kinematics:
        """Kinematics now, or later as things are, with the rows that slide of some."""
        arc, system, y = self.arc, self.arc.system, self.y
        if later:
            rates = arc.runner.function("field", system.size + system.m)(arc.t, y)
            y = y + later * rates[: system.size]
            y[arc.state.positions] += later**2 / 2.0 * rates[arc.velocities]
        self._set(some)
        return Kinematics(arc, y, arc.t + later)

    def _pivoted(self, edge: list[int]) -> set[int]:
        """Which slide: slips, and rates of forces below their limits, complement."""
        arc, sliding = self.arc, set[int]()
        own = self.p.law_place.astype(int)
        for _ in range(PIVOTS * len(edge)):
            self._move(sliding)
            here = self._at(edge)
            slips = arc.runner.function("gaps", here.count)(arc.t, self.y)
            still = SUM_ROUNDOFF * here.seen[arc.velocities][own]
            back, beyond = slips < -still, here.rates > here.still
            wrong = [k for k in edge if (back if k in sliding else beyond)[k]]
            if not wrong:
                break
            sliding ^= {wrong[0]}
        return sliding

    def _later(self, edge: list[int], sliding: set[int]) -> set[int]:
        """Which of those at their limits that stick slide a moment later."""
        rest = [k for k in edge if k not in sliding]
        if not rest:
            return set()
        self._set(sliding)
        here = self._at(edge, SOON * self.arc.state.row_step)
        return {k for k in rest if here.rates[k] > here.still[k]}

    def _events(self, sliding: Collection[int]) -> list[Event]:
        laws = self.arc.system.laws
        found = []
        for k, slid in zip(self.own, self.before.tolist(), strict=True):
            if slid != (k in sliding):
                found.append(
                    Event(self.arc.t, "stick" if slid else "slip", laws[k].name)
                )
        return found
