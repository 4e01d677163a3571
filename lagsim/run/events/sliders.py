"""Sliders without mass: selection of the sliding ones, and their velocities.

A slider in springs alone sticks while its force is below its limit. At the limit it
slides where sticking would raise its force above the limit. For several sliders, each
slips against its force or has a force that does not grow: a linear complementarity
problem for the slips, with the stiffness of the springs. For sliders whose force does
not change at first, the problem is solved at a time shortly after. Forces of dampers
change at once with the slips of other sliders: each slider in dampers slips against its
limit or has a force within its limit, in the same problem.

Where a limit jumps below the force of springs, sliders jump: each slips against its
force after the jump, or this force is within its limit (J. J. Moreau, Evolution
problem associated with a moving convex set, J. Diff. Eq. 26 (1977) 347, section 5).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.complementarity import ComplementarityProblem, solve
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

# A force is at its limit within this multiple of the tolerance, as a contact closes.
CLOSING = 10.0
# Largest numbers of Newton's steps for velocities (which are linear but for nonlinear
# dampers), and for positions after a jump. There the stiffness is increased by the part
# STIFFER, since two sliders in series have one force; it is computed as a difference
# quotient, over the part ASIDE of the positions.
STEPS = 8
JUMPS = 50
STIFFER = 1e-6
ASIDE = 2.0**-20


class Settled(NamedTuple):
    """The result of the selection of sliding and sticking sliders.

    Attributes
    ----------
    y : ndarray, shape (size,)
        The state with the positions and velocities of the sliders.
    events : list of Event
        The changes between sticking and sliding.
    jumps : bool
        Whether positions of sliders jump.
    unmet : list of str
        Constraints whose forces exceed their limits at all positions or velocities of
        the sliders.
    ending : Outcome
        The outcome of the run where `unmet` is not empty.
    """

    y: Floats
    events: list[Event]
    jumps: bool
    unmet: list[str]
    ending: Outcome


def at_edge(arc: Arc) -> float:
    """Return the relative distance from its limit up to which a force is at its limit.

    The distance is divided by the limit.
    """
    return float(min(CLOSING * max(arc.plan.tolerance, LEAST_CLOSING), SATISFIED))


class Sliders:
    """Selection of the sliding sliders at a state (size,), and of their velocities.

    The modes are stored in the parameters of the kernels. A slider is identified by the
    index, among the laws, of its first row.
    """

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
        """Return the state after the selection of the sliders that slide."""
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
        """Store the forces (L,) of the sliders, 0 of all other laws, and their signs.

        The sign of a slider of two rows is 1.
        """
        self.forces = np.zeros(len(self.laws))
        self.forces[self.all] = self._forces(self.y)
        signs = np.where(self.forces < 0.0, -1.0, 1.0).tolist()
        self.signs = {k: 1.0 if self.laws[k].pair >= 0 else signs[k] for k in self.own}

    def _forces(self, y: Floats) -> Floats:
        """Return the multipliers of all rows of sliders at the state y (size,)."""
        return self.arc.runner.function("sliders", len(self.all))(self.arc.t, y)

    def _past(self, sliders: list[int], part: float) -> list[int]:
        """Return the given sliders whose forces exceed their limits.

        A force exceeds its limit if it is larger by the part `part` of the limit and by
        rounding; with a negative part, if it exceeds the limit less this part and
        rounding.
        """
        found, here = [], self._at(self.own)
        for k in sliders:
            elastic, bound = k in self.elastic, float(here.bounds[k])
            over = (here.residuals if elastic else here.rates)[k]
            rounding = (here.slack if elastic else here.still)[k]
            if over > part * bound + np.copysign(rounding, part):
                found.append(k)
        return found

    def _set(self, sliders: Collection[int]) -> None:
        self.p.law_direction[self.own] = 0.0
        for k in sliders:
            self.p.law_direction[k] = self.signs[k]

    def _move(self) -> None:
        """Solve for the velocities of the sliders, given which sliders slide."""
        self._set(self.sliding)
        arc, own = self.arc, self.places
        velocities = self.y[arc.velocities]
        change = arc.runner.function("velocity_step", arc.system.n + 3)
        for _ in range(STEPS):
            step = change(arc.t, self.y)[own]
            velocities[own] += step
            if (np.abs(step) <= SUM_ROUNDOFF * np.abs(velocities[own])).all():
                return

    def _at(self, sliders: Collection[int], later: float = 0.0) -> Kinematics:
        """Evaluate the laws with given sliders set to slide.

        later : the time from now, by which the state advances at its present rates.
        """
        arc, y = self.arc, self.y
        if later:
            self._set(self.sliding)
            y = arc.later(y, arc.field(arc.t, y), later)
        self._set(sliders)
        return Kinematics(arc, y, arc.t + later)

    def _slip(self, edge: list[int]) -> None:
        """Select the sliders that slide, among the sliders `edge`.

        edge : the sliders at their limits, and all sliders in dampers.
        """
        for _ in range(STEPS if edge else 0):
            self._move()
            before, self.sliding = self.sliding, self._slipping(edge)
            if before == self.sliding:
                break
        if len(self.sliding) < len(edge):
            self.sliding = self._slipping(edge, self.arc.short_time)

    def _slipping(self, edge: list[int], later: float = 0.0) -> set[int]:
        """Return the sliders of `edge` that slide, now or at a time `later` from now.

        A linear complementarity problem of r rows is solved. The problem's matrix D (r,
        r) is the decrease of the rate of each row per unit slip of each slider against
        its force. A slider in dampers has two rows, the margins of its force to both
        limits. Where a limit is 0 the slip has either sign, which is stored.
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
        alternate = np.array([k in both for k in of], dtype=bool)
        free = (slides.bounds[of] == 0.0) & ~alternate
        low[0], high[0] = np.where(free, -np.inf, 0.0), np.inf
        c = np.where(np.abs(c) <= still, 0.0, c)
        found = (
            turned
            * D.diagonal()
            * solve(ComplementarityProblem(D, c, low, high, alone, alone)).p
        )
        taken = found[: len(edge)]
        taken[alternate[: len(edge)]] += found[len(edge) :]
        for k, slip in zip(edge, taken.tolist(), strict=True):
            self.signs[k] *= -1.0 if slip < 0.0 else 1.0
        moving = (np.abs(taken) > still[: len(edge)]).tolist()
        return {k for k, moves in zip(edge, moving, strict=True) if moves}

    def _jump(self) -> None:
        """Move the sliders in springs to positions at which no force exceeds its limit.

        The displacements of the sliders are D p + c with their forces p (s,) and the
        compliance D (s, s).
        """
        positions = self.y[self.arc.state.positions]
        jumping = [k for k in self.elastic for k in (k, self.laws[k].pair) if k >= 0]
        place = {k: i for i, k in enumerate(jumping)}
        pairs = np.array([place.get(self.laws[k].pair, -1) for k in jumping])
        of = [self.all.index(k) for k in jumping]
        own = [self.places[i] for i in of]
        before = positions[own].copy()
        for _ in range(JUMPS):
            sticks, forces = self._at(()), self._forces(self.y)[of]
            S = sticks.rows[np.ix_(jumping, own)]
            stiffness = np.zeros((len(jumping), len(jumping)))
            for i, j in enumerate(own):
                aside = self.y.copy()
                aside[j] += ASIDE * (sticks.magnitudes[j] or 1.0)
                step = aside[j] - self.y[j]
                stiffness[:, i] = (self._forces(aside)[of] - forces) / step
            stiffness = stiffness @ np.linalg.inv(S)
            most = np.linalg.norm(stiffness, 2)
            stiffened = stiffness + STIFFER * most * np.eye(len(jumping))
            D: Floats = np.asarray(np.linalg.inv(stiffened), float)
            high = np.array([sticks.bounds[jumping], np.zeros(len(jumping))])
            c = S @ (positions[own] - before) - D @ forces
            p = solve(
                ComplementarityProblem(
                    D, c, -high, high, np.full(len(jumping), -1), pairs
                )
            ).p
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
