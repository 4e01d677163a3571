"""Sliders without mass: which stick and which slide, and their velocities.

Those in springs alone whose force is below its limit stick. Those at the limit slide
where sticking would lead beyond it: of several, each slips against its force or has a
force that does not grow, which is a linear complementarity problem for the slips, with
the stiffness of the springs. A moment later it decides about those whose force does not
change at first. Forces of dampers change at once with the slips of others: each such
slider slips against its limit or has a force within it, in the same problem.

Where a limit falls at once below the force of springs, sliders jump: each slips against
the force that it has then, or none of it is beyond its limit (J. J. Moreau, Evolution
problem associated with a moving convex set, J. Diff. Eq. 26 (1977) 347, section 5).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.complementarity import Problem, solve
from lagsim.methods.parts import parameters as kept
from lagsim.notes import Event
from lagsim.run.events.kinematics import Kinematics
from lagsim.run.trajectory import Outcome
from lagsim.tolerances import (
    DEPENDENT_ROWS,
    LEAST_CLOSING,
    SATISFIED,
    SUM_ROUNDOFF,
    TINY,
)

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc

# A force is at its limit within so many tolerances, as a contact closes.
CLOSING = 10.0
# Newton's steps to their velocities, which are linear but for dampers that are not; and
# to their places after a jump, of springs that are stiffer by the second part, since
# two sliders in series have one force; their stiffness is a difference over the third.
STEPS = 8
JUMPS = 50
STIFFER = 1e-6
ASIDE = 2.0**-20


class Settled(NamedTuple):
    """State of sliders: y (size,), what has changed, and whether places jump.

    And the constraints whose forces exceed their limits wherever sliders are, or at
    whatever velocities.
    """

    y: Floats
    events: list[Event]
    jumps: bool
    unmet: list[str]
    ending: Outcome


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
        laws = self.laws = arc.system.laws
        self.all = [k for k, law in enumerate(laws) if law.slider]
        self.own = [k for k in self.all if not 0 <= laws[k].pair < k]
        self.elastic = [k for k in self.own if laws[k].solved.holonomic]
        self.viscous = set(self.own).difference(self.elastic)
        self.viscous.difference_update(k for k in self.own if laws[k].pair >= 0)
        self.places: list[int] = self.p.law_place[self.all].astype(int).tolist()
        self.before = self.p.law_direction[self.own] != 0.0
        self.p.law_mode[self.all] = kept.HELD
        self.sliding = set[int]()
        self._move()
        self._measure()

    def settled(self) -> Settled:
        """Return the state with what sticks at rest, and what slides on its way."""
        past = self._past(self.elastic, SATISFIED)
        jumps = bool(past)
        if jumps:
            self._jump()
        self._slip(sorted({*self._past(self.own, -at_edge(self.arc)), *self.viscous}))
        self._move()
        past = self._past(self.own, SATISFIED)
        rows = self._at(self.sliding).rows[np.ix_(self.all, self.places)]
        rows = np.nan_to_num(rows)
        rows /= np.maximum(np.linalg.norm(rows, axis=1), TINY)[:, None]
        if not past and not np.linalg.svd(rows)[1].min() > DEPENDENT_ROWS:
            past = sorted(self.sliding)
        events = self._events() if self.arc.steps else []
        unmet = [self.laws[k].name for k in past]
        elastic = set(past).issubset(self.elastic)
        ending = Outcome.PARADOX if elastic else Outcome.UNDETERMINED_SLIDERS
        return Settled(self.y, events, jumps, unmet, ending)

    def _measure(self) -> None:
        """Note the forces (L,), and on which side of 0 the limits are of what slides.

        They are 0 of other laws.
        """
        self.forces = np.zeros(len(self.laws))
        self.forces[self.all] = self._forces(self.y)
        signs = np.where(self.forces < 0.0, -1.0, 1.0).tolist()
        self.signs = {k: 1.0 if self.laws[k].pair >= 0 else signs[k] for k in self.own}

    def _forces(self, y: Floats) -> Floats:
        """Multipliers of all sliders at y."""
        return self.arc.runner.function("sliders", len(self.all))(self.arc.t, y)

    def _past(self, some: list[int], part: float) -> list[int]:
        """Which forces of some are past their limits by a part of these, or rounding.

        Where the part is below 0, no more than that below.
        """
        found, here = [], self._at(self.own)
        for k in some:
            elastic, bound = k in self.elastic, float(here.bounds[k])
            over = (here.residuals if elastic else here.rates)[k]
            rounding = (here.slack if elastic else here.still)[k]
            if over > part * bound + np.copysign(rounding, part):
                found.append(k)
        return found

    def _set(self, some: Collection[int]) -> None:
        self.p.law_direction[self.own] = 0.0
        for k in some:
            self.p.law_direction[k] = self.signs[k]

    def _move(self) -> None:
        """Give sliders the velocities of those that slide, and of those that do not."""
        self._set(self.sliding)
        arc, own = self.arc, self.places
        velocities = self.y[arc.velocities]
        change = arc.runner.function("velocity_step", arc.system.n + 3)
        for _ in range(STEPS):
            step = change(arc.t, self.y)[own]
            velocities[own] += step
            if (np.abs(step) <= SUM_ROUNDOFF * np.abs(velocities[own])).all():
                return

    def _at(self, some: Collection[int], later: float = 0.0) -> Kinematics:
        """Kinematics with the rows that slide of some, now or later as things are."""
        arc, y = self.arc, self.y
        if later:
            self._set(self.sliding)
            y = arc.later(y, arc.field(arc.t, y), later)
        self._set(some)
        return Kinematics(arc, y, arc.t + later)

    def _slip(self, edge: list[int]) -> None:
        """Find which slide: slips, and rates of forces below limits, complement."""
        for _ in range(STEPS if edge else 0):
            self._move()
            before, self.sliding = self.sliding, self._slipping(edge)
            if before == self.sliding:
                break
        if len(self.sliding) < len(edge):
            self.sliding = self._slipping(edge, self.arc.moment)

    def _slipping(self, edge: list[int], later: float = 0.0) -> set[int]:
        """Which of some (e,) slide, now or later, where velocities change linearly.

        D (r, r): what a slip of each against its force takes off the rate of each row.
        A slider in dampers has two rows, of the margins of its force to both limits.
        Where the limit is 0 both signs are: that of the slip is taken.
        """
        slides, sticks = self._at(edge, later), self._at((), later)
        both = [k for k in edge if k in self.viscous]
        of, turned = [*edge, *both], np.repeat([1.0, -1.0], [len(edge), len(both)])
        own, ways = self.places, np.zeros((len(self.laws), len(of)))
        for i, k in enumerate(of):
            ways[k, i] = turned[i] * self.signs[k]
            rows = [k, self.laws[k].pair]
            if rows[1] >= 0 and (size := np.linalg.norm(self.forces[rows])) > 0.0:
                ways[rows, i] = self.forces[rows] / size
        slips = np.column_stack([ways, sticks.rates])[self.all]
        back = np.linalg.solve(sticks.rows[np.ix_(self.all, own)], slips)
        change = turned[:, None] * slides.rows[np.ix_(of, own)] @ back
        rates = slides.rates[of]
        rates[turned < 0.0] = -slides.rates[both] - 2.0 * slides.bounds[both]
        D, c = change[:, :-1], change[:, -1] - rates
        still, alone = slides.still[of], np.full(len(of), -1)
        low, high = np.zeros((2, 2, len(of)))
        free = (slides.bounds[of] == 0.0) & ~np.isin(of, both)
        low[0], high[0] = np.where(free, -np.inf, 0.0), np.inf
        c = np.where(np.abs(c) <= still, 0.0, c)
        found = turned * D.diagonal() * solve(Problem(D, c, low, high, alone, alone)).p
        taken = found[: len(edge)]
        taken[np.isin(edge, both)] += found[len(edge) :]
        for k, slip in zip(edge, taken.tolist(), strict=True):
            self.signs[k] *= -1.0 if slip < 0.0 else 1.0
        moving = (np.abs(taken) > still[: len(edge)]).tolist()
        return {k for k, moves in zip(edge, moving, strict=True) if moves}

    def _jump(self) -> None:
        """Take sliders in springs to where no force is beyond its limit.

        With forces p (s,) of these the ways of slips are D p + c, by the compliance D.
        """
        positions = self.y[self.arc.state.positions]
        some = [k for k in self.elastic for k in (k, self.laws[k].pair) if k >= 0]
        place = {k: i for i, k in enumerate(some)}
        pairs = np.array([place.get(self.laws[k].pair, -1) for k in some])
        of = [self.all.index(k) for k in some]
        own = [self.places[i] for i in of]
        before = positions[own].copy()
        for _ in range(JUMPS):
            sticks, forces = self._at(()), self._forces(self.y)[of]
            S = sticks.rows[np.ix_(some, own)]
            stiffness = np.zeros((len(some), len(some)))
            for i, j in enumerate(own):
                aside = self.y.copy()
                aside[j] += ASIDE * (sticks.seen[j] or 1.0)
                step = aside[j] - self.y[j]
                stiffness[:, i] = (self._forces(aside)[of] - forces) / step
            stiffness = stiffness @ np.linalg.inv(S)
            most = np.linalg.norm(stiffness, 2)
            firm = stiffness + STIFFER * most * np.eye(len(some))
            D: Floats = np.asarray(np.linalg.inv(firm), float)
            high = np.array([sticks.bounds[some], np.zeros(len(some))])
            c = S @ (positions[own] - before) - D @ forces
            p = solve(Problem(D, c, -high, high, np.full(len(some), -1), pairs)).p
            step = np.linalg.solve(S, D @ (p - forces))
            positions[own] += step
            if (np.abs(step) <= SUM_ROUNDOFF * np.abs(positions[own])).all():
                break
        self._move()
        self._measure()

    def _events(self) -> list[Event]:
        found = []
        for k, slid in zip(self.own, self.before.tolist(), strict=True):
            if slid != (k in self.sliding):
                kind = "stick" if slid else "slip"
                found.append(Event(self.arc.t, kind, self.laws[k].name))
        return found
