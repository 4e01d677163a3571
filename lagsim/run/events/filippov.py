"""Filippov's conditions, and the modes of switching surfaces in an arc.

From a point on several surfaces the motion crosses some, or slides along them, as
Filippov's conditions select. Each surface k has a share w_k in [0, 1] of its upper
side, and a rate rho_k at which its expression grows:

    w = 0 and rho <= 0 (below it),  w = 1 and rho >= 0 (above),  or rho = 0 (along it).

Source: A. F. Filippov, Differential Equations with Discontinuous Righthand Sides,
1988, sections 4 and 8.
"""

from __future__ import annotations

import math
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.algebra import Span
from lagsim.mechanics.complementarity import Problem, rates_at, solve
from lagsim.methods.parts import parameters as kept
from lagsim.program.functions import on_rates
from lagsim.tolerances import (
    DEPENDENT_DIRECTIONS,
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    TINY,
    VALUE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.surfaces import Side
    from lagsim.run.arc import Arc

    Corner = tuple[int, ...]
    Rates = Callable[[Corner], Floats]


BELOW, ABOVE, SLIDING = 0, 1, 2
LEVEL = 3  # of a surface that is no boundary here: its expression is constant
REDUNDANT = 4  # on its level because others are: its share is constant
# Where some surface does not attract, all modes are tried up to this many surfaces.
FEW = 5
MOST_EXCHANGES = 1000
# Newton's steps to the shares of surfaces.
MOST_STEPS = 20


class FilippovCone:
    """Filippov's conditions at a point on `count` surfaces.

    Parameters
    ----------
    rates
        The rates (count,) with each surface BELOW or ABOVE.
    scale : ndarray, shape (count,)
        The size of the terms of the rates.
    roundoff : ndarray, shape (count,)
        What the rounding of the state does to them.
    held
        Surfaces whose side is known.
    stays
        Whether the motion from a corner stays in it, as far as is known.
    ahead
        A short time, and how fast rates with these shares (count,) change in it.
    settled
        The motion has come to rest on the surfaces, or some of them have no rates.

    Attributes
    ----------
    shares : ndarray, shape (count,)
        Those of the mode that was selected, where some are redundant.
    """

    def __init__(
        self,
        rates: Rates,
        scale: Floats,
        held: Mapping[int, int] | None = None,
        stays: Callable[[Corner], bool | None] = lambda _: None,
        ahead: Callable[[Floats], tuple[float, Floats]] = lambda w: (1.0, 0.0 * w),
        *,
        roundoff: Floats | float = 0.0,
        settled: bool = False,
    ) -> None:
        self.count = len(scale)
        self.tolerance = np.maximum(SOLUTION_ROUNDOFF * scale, roundoff)
        self._clear = np.maximum(self.tolerance, TINY)  # not 0, where nothing pushes
        self.held = held or {}
        self.settled = settled
        self.ahead = ahead
        self.shares = np.zeros(self.count)
        self.stays = cache(stays)
        few = self.count <= FEW
        self.rates: Rates = cache(rates) if few else _affine(rates, self.count)

    def select(self, now: Sequence[int]) -> list[int] | None:
        """Select BELOW, ABOVE or SLIDING for each surface; None where none meets them.

        Of several selections, those with fewer sliding surfaces and with the sides
        `now` come first.
        """
        found = self._complementary(now) if self.count > 1 else None
        if found is not None or self.count > FEW:
            return found
        choices = [
            [self.held[k]] if k in self.held else [now[k], 1 - now[k], SLIDING]
            for k in range(self.count)
        ]
        every = [list(mode) for mode in product(*choices)]
        candidates = sorted(every, key=lambda mode: mode.count(SLIDING))
        # On a side only with a rate above rounding, at first: else the motion follows
        # the surface rather than to creep along it.
        leading = next((w for w in candidates if self.holds(w, self._clear)), None)
        if leading is not None:
            return leading
        creeping = [mode for mode in candidates if self.holds(mode, -self.tolerance)]
        doubtful = []
        for mode in creeping:
            stays = SLIDING in mode or self.stays(tuple(mode))
            if stays:
                return mode
            if stays is None:
                doubtful.append(mode)
        if doubtful or not self.settled:
            return doubtful[0] if doubtful else None
        # No side leads away: the motion stays, though no surface attracts alone.
        resting = (w for w in candidates if self.holds(w, self._clear, alone=False))
        return next(resting, None)

    def attraction(self, k: int) -> float:
        """By how much the upper side of surface k adds to its rate, all below."""
        return float(self._change(np.zeros(self.count), k)[k])

    def is_fork(self, mode: Sequence[int]) -> bool:
        """Whether the other side of some surface would do as well."""
        if REDUNDANT in mode:
            return False
        for i, k in enumerate(mode):
            if k == SLIDING or i in self.held:
                continue
            other = [*mode[:i], 1 - k, *mode[i + 1 :]]
            if self.holds(other, self._clear) or self._leads_off(other):
                return True
        return False

    def _leads_off(self, mode: Sequence[int]) -> bool:
        """Whether the motion stays on these sides though no rate says so."""
        if self.count > FEW or SLIDING in mode or not self.holds(mode, -self.tolerance):
            return False
        return self.stays(tuple(mode)) is True

    def _solved(self, mode: Sequence[int]) -> tuple[Floats, Floats, Floats]:
        """Shares that keep sliding surfaces, rates, and attractions (count,).

        The attraction of a surface is what its own upper side adds to its rate: below 0
        where the sides push onto the surface. By Newton's method: in the shares of
        several, rates have products where steps do.
        """
        along = [i for i, k in enumerate(mode) if k == SLIDING]
        # Forces of which only the sum matters: the shares closest to one half.
        w = np.array([0.5 if k == SLIDING else k for k in mode], dtype=float)
        rho, own = self._blended(w), np.zeros(self.count)
        for _ in range(MOST_STEPS if along else 0):
            slopes = np.array([self._change(w, j) for j in along]).T[along]
            slopes[np.abs(slopes) <= self.tolerance[along, None]] = 0.0
            # Of the same size, whatever the units of each surface.
            size = np.max(np.abs(slopes), axis=1)
            size[size == 0.0] = 1.0
            scaled = slopes / size[:, None], rho[along] / size
            w[along] -= np.linalg.lstsq(*scaled, rcond=None)[0]
            rho, own[along] = self._blended(w), np.diag(slopes)
            if np.all(np.abs(rho[along]) <= self.tolerance[along]):
                break
        return w, rho, own

    def _change(self, w: Floats, j: int) -> Floats:
        """Change of rates (count,) from below surface j to above it."""
        below, above = w.copy(), w.copy()
        below[j], above[j] = BELOW, ABOVE
        return self._blended(above) - self._blended(below)

    def _blended(self, w: Floats) -> Floats:
        """Rates (count,) between corners, linear in each of the shares w (count,)."""
        if self.count > FEW:
            return self.rates(tuple(w))
        sides = [(int(x),) if x in (BELOW, ABOVE) else (BELOW, ABOVE) for x in w]
        rates = np.zeros(self.count)
        for corner in product(*sides):
            parts = np.where(np.array(corner) == ABOVE, w, 1.0 - w)
            rates = rates + np.prod(parts) * self.rates(corner)
        return rates

    def holds(self, mode: Sequence[int], least: Floats, *, alone: bool = True) -> bool:
        """Whether a mode meets the conditions, at rates of `least` or more.

        And whether each sliding surface attracts alone.
        """
        w, rho, own = self._solved(mode)
        known = [i in self.held for i in range(self.count)]
        sides = np.array(mode)
        inside = (w >= -SOLUTION_ROUNDOFF) & (w <= 1.0 + SOLUTION_ROUNDOFF)
        attracts = (own < 0.0) | (not alone)
        follows = inside & attracts & (np.abs(rho) <= self.tolerance)
        leaves = np.where(sides == ABOVE, rho, -rho) >= least
        return bool(np.all(known | np.where(sides == SLIDING, follows, leaves)))

    def _complementary(self, now: Sequence[int]) -> list[int] | None:
        """Mode by one complementarity problem; None where few do not all attract.

        What does not attract is no part of it: it has the side that it has `now`, or
        the other if its rate leads there, one exchanged after the other.

        With p = -w the rates are rho = rho_0 - B p. A surface with rate 0 whose share
        is at its end is left if the rates of the shares ask for that, see `rates_at`;
        and one that keeps to its level because others do has a share that is constant.
        """
        n, none = self.count, np.zeros(self.count)
        B = np.array([self._change(none, j) for j in range(n)]).T
        # Each surface in a unit of its own: a power of two, so that nothing is rounded.
        unit = np.exp2(-np.round(np.log2(np.maximum(np.max(np.abs(B), axis=1), TINY))))
        B, tolerance = unit[:, None] * B, unit * self.tolerance
        base, above = unit * self.rates((BELOW,) * n), unit * self.rates((ABOVE,) * n)
        off, own = above - base - B.sum(axis=1), B.diagonal()
        attract = (own < -tolerance) & (np.abs(off) <= tolerance * n)
        if n <= FEW and not attract.all():
            return None
        ends, alone = np.zeros((4, n)), np.full(n, -1)
        ends[0] = -1.0
        aside = {k: now[k] for k in np.flatnonzero(~attract).tolist()}
        aside.update(self.held)
        for k, side in aside.items():  # what has reached its end is at it
            ends[::2, k] = -side
        for _ in range(MOST_EXCHANGES):
            found = solve(Problem(-B, base, ends[:2], ends[2:], alone, alone))
            if not found.found:
                return None
            leads = np.where(ends[0] < 0.0, found.w < -tolerance, found.w > tolerance)
            wrong = [k for k in aside if k not in self.held and leads[k]]
            if not wrong:
                break
            aside[wrong[0]] = 1 - aside[wrong[0]]
            ends[::2, wrong[0]] = -aside[wrong[0]]
        else:
            return None
        w, rho = -found.p, found.w
        small = tolerance / np.abs(np.where(own, own, 1.0))
        sides = np.where(rho > 0.0, ABOVE, BELOW)
        rests = np.flatnonzero(attract & (np.abs(rho) <= tolerance)).tolist()
        inside = [k for k in rests if small[k] < w[k] < 1.0 - small[k]]
        tied = [k for k in rests if k not in inside]
        w[tied] = np.round(w[tied])
        span, units = Span(n), B / np.maximum(np.linalg.norm(B, axis=0), TINY)
        free = [k for k in inside if span.extend(units[:, k], DEPENDENT_DIRECTIONS)]
        if tied:
            ways = (2.0 * w - 1.0)[tied, None] * np.eye(n)[tied]
            moment, change = self.ahead(w)
            x, rate = rates_at(-B, unit * change, tolerance / moment, free, ways)
            sides[tied] = np.where(w[tied] > 0.5, ABOVE, BELOW)
            tied = sorted([k for k in tied if not rate[k]], key=lambda k: -abs(x[k]))
        for k in (*inside, *tied):
            new = k in free or span.extend(units[:, k], DEPENDENT_DIRECTIONS)
            sides[k] = SLIDING if new else REDUNDANT
        for k, side in aside.items():
            if not attract[k]:
                sides[k] = side
        self.shares = w
        return [int(side) for side in sides]


def _affine(rates: Rates, count: int) -> Rates:
    """Rates that are affine in the shares, from those of count + 1 corners."""
    base, sides = rates((BELOW,) * count), np.eye(count, dtype=int).tolist()
    effects = np.array([rates(tuple(corner)) - base for corner in sides])
    return lambda corner: base + np.array(corner, dtype=float) @ effects


KINDS = {SLIDING: kept.FOLLOWED, LEVEL: kept.LEVEL, REDUNDANT: kept.REDUNDANT_SIDE}
# Directions in which a state is moved to see what its rounding does to a surface.
DIRECTIONS = 3
# A state this far aside, against how far it has moved, is another one.
ASIDE = 1e-3


class Rows(NamedTuple):
    """What surfaces do at a state, as `sliding.surface_rows` gives it."""

    residuals: Floats
    rates: Floats
    b: Floats
    scales: Floats
    J: Floats


class Modes:
    """The modes of the switching surfaces of a run.

    Attributes
    ----------
    value : ndarray, shape (K,)
        -1 or 1, or the whole number below; while sliding, of the lower side. Between
        them where the expression keeps its level on a whole stretch.
    slides : ndarray of bool, shape (K,)
        The motion follows it.
    depends : list of set of int
        The surfaces whose sides each one's expression depends on.
    """

    def __init__(self, arc: Arc) -> None:
        self.arc = arc
        system = arc.system
        self.sides: tuple[Side, ...] = system.switches.sides
        self.count = len(self.sides)
        self.whole = np.array([s.whole for s in self.sides])
        self.on_rates = on_rates(arc.equations, system.switches)
        numbers = {s.variable: k for k, s in enumerate(self.sides)}
        nodes = system.switches.freeze([s.node for s in self.sides])
        depends = arc.equations.graph.depends
        self.depends = [
            {numbers[name] for name in depends([node]) & numbers.keys()}
            for node in nodes
        ]
        self.order = self._ordered()
        self.nested = any(self.depends)
        self.value = np.ones(self.count)
        self.kind = np.zeros(self.count)
        self.levels = np.zeros(self.count)
        self.carried: dict[int, tuple[int, float]] = {}  # leader, and the upper value
        self.watched: list[int] = []  # a mode ends where the motion leaves their level

    def _ordered(self) -> list[int]:
        """Surfaces, those that others depend on first."""
        found: list[int] = []
        left = list(range(self.count))
        while left:
            ready = [k for k in left if self.depends[k] <= {*found, k}] or left[:1]
            found += ready
            left = [k for k in left if k not in ready]
        return found

    @property
    def slides(self) -> Flags:
        """Which surfaces the motion follows."""
        return np.asarray(self.kind == kept.FOLLOWED)

    @property
    def holds(self) -> Flags:
        """Which surfaces the motion keeps to (K,)."""
        return np.asarray(self.slides | (self.kind == kept.REDUNDANT_SIDE))

    @property
    def bound(self) -> Floats:
        """Surfaces whose expression does not determine the mode (K,)."""
        return np.asarray((self.kind != 0.0) & (self.kind != kept.CHOSEN))

    def choose(self, several: Collection[int]) -> None:
        """Take note of sides that nothing decides: rows show what was chosen."""
        for k in several:
            if self.kind[k] == 0.0:
                self.kind[k] = kept.CHOSEN

    @property
    def p(self) -> kept.Parameters:
        """The memory that the compiled functions read the modes from."""
        return self.arc.system.p

    def store(self, **numbers: Floats) -> None:
        """Store K numbers of some kinds in p, by their names there.

        Arrays that go on with numbers of laws and of `until` keep those.
        """
        for name, each in numbers.items():
            getattr(self.p, name)[: self.count] = each

    def restore(self, value: Floats, kind: Floats) -> None:
        """Take sides as they were."""
        self.value[:], self.kind[:] = value, kind

    def forget(self) -> None:
        """Slide along nothing."""
        self.kind[:] = 0.0
        self.carried = {}
        self.watched = []

    def put(self, k: int, level: float, mode: int, share: float = 0.5) -> None:
        """Put surface k below or above its level, along it, or at rest on it."""
        below, above = (level - 1.0, level) if self.whole[k] else (-1.0, 1.0)
        self.levels[k] = level
        self.kind[k] = KINDS.get(mode, 0.0)
        between = below + share * (above - below)
        values = {ABOVE: above, LEVEL: between, REDUNDANT: between}
        self.value[k] = values.get(mode, below)

    def put_clear(self, k: int, value: float) -> None:
        """Put surface k on the side on which its expression has this value."""
        self.kind[k] = 0.0
        sign = 1.0 if value > 0.0 else -1.0
        self.value[k] = math.floor(value) if self.whole[k] else sign

    def carry(self, k: int, leader: int, high: float) -> None:
        """Let surface k step together with one that the motion follows."""
        self.kind[k] = kept.CARRIED
        self.carried[k] = leader, high

    def level(self, k: int, value: float) -> float:
        """Level of surface k that is closest to a value."""
        return float(np.round(value)) if self.whole[k] else 0.0

    def write(self) -> None:
        """Store the mode where the compiled functions read it."""
        p, slides, value, whole = self.p, self.slides, self.value, self.whole
        p.sliding = float(np.count_nonzero(slides))
        p.side[:] = value
        p.slides[:] = self.kind
        up = value > 0.0
        p.low[:] = np.where(whole | self.bound, value, -1.0)
        p.high[:] = np.where(whole, value + 1.0, 1.0)
        p.leader[:] = 0.0
        for k, (leader, high) in self.carried.items():
            p.leader[k] = leader + 1
            p.high[k] = high
        least, most = np.where(up, 0.0, -math.inf), np.where(up, math.inf, 0.0)
        least = np.where(whole, value, least)
        most = np.where(whole, value + 1.0, most)
        least[self.bound], most[self.bound] = -math.inf, math.inf
        least[self.watched] = most[self.watched] = self.levels[self.watched]
        moving = np.array(self.on_rates, dtype=bool)
        least[slides] = np.where(moving, 0.0, self.levels)[slides]
        most[slides] = np.where(moving, self.levels, 0.0)[slides]
        p.least[:] = least
        p.most[:] = most

    def rows(self, y: Floats | None = None, t: float | None = None) -> Rows:
        """Return what the surfaces do at the state reached, or at y and t."""
        arc = self.arc
        y, t = arc.y if y is None else y, arc.t if t is None else t
        (residuals, rates, b, scales), J = arc.surface_rows(t, y)
        return Rows(residuals, rates, b, scales, J)

    def keeps(self, k: int) -> bool:
        """Whether an expression is constant hereabouts, not only level here."""
        seen, reach = self.arc.seen, self.arc.ranges
        reach = np.where(
            reach > 0.0, np.maximum(reach, RESIDUAL_ROUNDOFF**0.5 * seen), seen
        )
        parts = ASIDE + ASIDE**2 * np.arange(len(seen))
        aside = parts * np.where(reach > 0.0, reach, 1.0)
        here, there = self.rows(), self.rows(self.arc.y + aside)
        if self.on_rates[k]:
            still = abs(here.rates[k] - there.rates[k]) <= RESIDUAL_ROUNDOFF * abs(
                here.rates[k]
            )
        else:
            still = here.rates[k] == there.rates[k] == 0.0
        return bool(
            still
            and here.b[k] == there.b[k] == 0.0
            and not np.any(here.J[k])
            and not np.any(there.J[k])
        )

    def held(self) -> dict[int, float]:
        """Surfaces at whose level constraints hold the motion, but for this rounding.

        Neither a side nor another place gives them a rate that is more than rounding,
        and they are off by no more than that makes in the run.
        """
        arc, span = self.arc, self.arc.settings.duration
        if not arc.system.m:
            return {}
        values = self.values(arc.t, arc.y)
        levels = [self.level(k, value) for k, value in enumerate(values)]
        off = np.abs(values - levels)
        off = np.where(self.on_rates, off, span * np.abs(self.rows().rates) + off)
        most = np.where(self.on_rates, span, span * span)
        most *= self._roundoff_of_rates(arc.y)
        found = off <= most
        if not found.any():
            return {}
        parts = ASIDE + ASIDE**2 * np.arange(len(arc.y))
        former = self.value.copy(), self.kind.copy()
        for side in (BELOW, ABOVE):
            for k in np.flatnonzero(found).tolist():
                self.put(k, levels[k], side)
            self.write()
            for y in (arc.y, arc.y + parts * arc.ranges):
                found &= self._roundoff_of_rates(y) >= 0.0
        self.restore(*former)
        self.write()
        return {k: float(most[k]) for k in np.flatnonzero(found).tolist()}

    def _roundoff_of_rates(self, y: Floats) -> Floats:
        """Bound the rounding (K,) of rates at y that are nothing else; -1 of others."""
        arc, rates = self.arc, self.forced(y)
        bounds = arc.runner.function("rounding")(arc.t, y)[: arc.system.n]
        slopes = np.abs(self.rows(y).J[:, : arc.system.n])
        roundoff = VALUE_ROUNDOFF * (slopes @ np.abs(bounds))
        return np.where(np.abs(rates) <= roundoff, roundoff, -1.0)

    def values(self, t: float, y: Floats) -> Floats:
        """Expressions of the surfaces (K,)."""
        return self.arc.runner.function("surfaces", self.count)(t, y)

    def rates(self, t: float, y: Floats) -> Floats:
        """Return y' with the sides as written."""
        return self.arc.field(t, y)

    def accelerations(self, y: Floats, t: float | None = None) -> Floats:
        """Return q'' and s' at y and t (by default now), with the sides as written."""
        rates = self.rates(self.arc.t if t is None else t, y)
        return rates[self.arc.state.driven]

    def forced(self, y: Floats, t: float | None = None) -> Floats:
        """J (q'', s') - b (K,) of the surfaces at y and t (by default now)."""
        rows = self.rows(y, t)
        return np.asarray(rows.J @ self.accelerations(y, t) - rows.b)

    def sizes(self, rows: Rows) -> Floats:
        """Magnitude of the terms of each surface (K,), at sizes seen so far.

        Or what the rounding of such a state does: slopes may vanish there.
        """
        arc, seen = self.arc, self.arc.seen
        slopes, moved = np.abs(rows.J), seen[arc.state.driven].copy()
        moved[: arc.system.n] = seen[arc.state.positions]
        levels = (slopes @ x for x in (seen[arc.state.driven], moved))
        terms = np.where(self.on_rates, *levels)
        found = np.maximum(rows.scales, terms)
        here = self.values(arc.t, arc.y)
        for aside in self.asides():
            found = np.fmax(
                found, np.abs(self.values(arc.t, aside) - here) / RESIDUAL_ROUNDOFF
            )
        return np.asarray(found)

    def asides(self, reach: Floats | float = 0.0) -> Iterator[Floats]:
        """States that differ from the one reached by rounding.

        And that are no farther than `reach` (size,) besides.
        """
        step = RESIDUAL_ROUNDOFF * self.arc.seen + reach
        i = np.arange(len(step))
        for k in range(DIRECTIONS):
            yield self.arc.y + np.where(i >> k & 1, -step, step)
