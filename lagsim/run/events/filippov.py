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

from lagsim.mechanics.contact import Mode, modes
from lagsim.methods.parts import parameters as kept
from lagsim.program.functions import on_rates
from lagsim.run.events.kinematics import NO_LAWS
from lagsim.tolerances import (
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    TINY,
    VALUE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.mechanics.contact import Modes as RowModes
    from lagsim.mechanics.surfaces import Side
    from lagsim.run.arc import Arc
    from lagsim.run.events.kinematics import Acting

    Corner = tuple[int, ...]
    Rates = Callable[[Corner], Floats]
    Beside = Callable[[Corner], tuple[Acting, Floats]]
    Leaves = Callable[[Floats, int, RowModes], int | None]
    Ahead = Callable[[Floats, Floats], tuple[float, Floats]]


BELOW, ABOVE, SLIDING = 0, 1, 2
LEVEL = 3  # of a surface that is no boundary here: its expression is constant
REDUNDANT = 4  # on its level because others are: its share is constant
# Rates are products of so many shares at most, beyond that sums.
FEW = 5
# Newton's steps to the shares of surfaces, and sides that are tried.
MOST_STEPS = 20
MOST_EXCHANGES = 1000


class Trial(NamedTuple):
    """What a selection leads to, with n surfaces.

    Attributes
    ----------
    mode : list of int
    w : ndarray, shape (n,)
        The shares, LEVEL at a level.
    leads : ndarray, shape (n,)
        Of a surface that does not attract, the rate at which it leaves to the side that
        it was put on: below 0 it is wrong there. Else infinity.
    modes : Modes
        Those of laws beside them, then of surfaces that attract.
    """

    mode: list[int]
    w: Floats
    leads: Floats
    modes: RowModes


class FilippovCone:
    """Filippov's conditions at a point on `count` surfaces.

    They are a complementarity problem: with p = 1/2 - w the rates are rho_0 - B p, and
    p is limited as a force is: laws beside the surfaces are rows of the same problem.
    Where steps multiply, it is solved by Newton's method, linear in each of its steps.

    Several answers may hold where the own upper side of a surface does not diminish its
    rate, so that it does not attract. Such a surface keeps to its level, with the value
    that is written there, if nothing moves it from there: sign(0) = 0. Else it has the
    side that it has now, or the other one if its rate leads there, or if only that side
    leads away.

    Parameters
    ----------
    rates
        The rates (count,) with each surface BELOW, ABOVE or at its LEVEL; then the
        accelerations (r,) of laws without their multipliers.
    scale : ndarray, shape (count,)
        The size of the terms of the rates.
    roundoff : ndarray, shape (count,)
        What the rounding of the state does to them.
    leaves
        The side to which the motion with these shares (count,) leaves a surface, where
        no rate tells; None if it stays.
    ahead
        A short time, and how fast rates with these shares (count,) and multipliers (r,)
        change in it.

    Attributes
    ----------
    shares : ndarray, shape (count,)
        Those of the mode that was selected.
    is_fork : bool
        The other side of some surface would do as well.
    laws
        The laws at a corner, and the rates (count, r) by their multipliers.
    modes : Modes or None
        Those of the laws, then of surfaces that attract, in the mode that was selected.
    """

    def __init__(
        self,
        rates: Rates,
        scale: Floats,
        leaves: Leaves = lambda _w, _k, _modes: None,
        ahead: Ahead = lambda w, _p: (1.0, 0.0 * w),
        *,
        roundoff: Floats | float = 0.0,
    ) -> None:
        self.count = len(scale)
        least = np.maximum(SOLUTION_ROUNDOFF * scale, roundoff)
        self.tolerance = np.maximum(least, TINY)  # not 0, where nothing pushes
        self.rates = cache(rates)
        self.leaves, self.ahead = leaves, ahead
        self.shares, self.is_fork = np.zeros(self.count), False
        self.laws: Beside = lambda _corner: (NO_LAWS, np.zeros((self.count, 0)))
        self.modes: RowModes | None = None

    def select(
        self, now: Sequence[int], still: Collection[int] = ()
    ) -> list[int] | None:
        """Select a mode for each surface; None where none meets the conditions.

        Parameters
        ----------
        now
            The sides that the surfaces have.
        still
            Surfaces that may be at their level.
        """
        ways = [tuple(LEVEL if k in still else side for k, side in enumerate(now))]
        tried: set[Corner] = set()
        while ways and len(tried) < MOST_EXCHANGES:
            sides = ways.pop()
            tried.add(sides)
            trial = self._solved(sides)
            if trial is None:
                continue
            wrong = np.flatnonzero(trial.leads < 0.0).tolist()
            others = wrong or self._others(sides, trial)
            exchanged = [exchange(sides, k, now[k]) for k in others]
            exchanged = [way for way in exchanged if way not in tried]
            if not wrong and not exchanged:
                self.shares, self.modes = trial.w, trial.modes
                return trial.mode
            ways += reversed(exchanged)
        return None

    def _others(self, sides: Corner, trial: Trial) -> list[int]:
        """First surface that leaves by its other side alone; note if one does by both.

        A surface to which the motion comes back from either side is followed, though no
        rate says so.
        """
        self.is_fork = False
        for k in np.flatnonzero(trial.leads < math.inf).tolist():
            side, w = sides[k], trial.w.copy()
            if side == LEVEL:
                if self.leaves(w, k, trial.modes) is not None:
                    return [k]
                continue
            other = self._solved(exchange(sides, k))
            here = bool(trial.leads[k] > 0.0)
            there = other is not None and bool(
                other.leads[k] > 0.0 and np.all(other.leads >= 0.0)
            )
            if not here and not there:
                way = self.leaves(w, k, trial.modes)
                w[k] = 1 - side
                back = self.leaves(w, k, trial.modes)
                here, there = way == side, back == 1 - side
                if way == 1 - side and back == side:
                    trial.mode[k] = SLIDING
            if there and not here:
                return [k]
            self.is_fork = self.is_fork or (here and there)
        return []

    def _change(self, w: Floats, j: int) -> Floats:
        """Change of rates (count,) from below surface j to above it."""
        below, above = w.copy(), w.copy()
        below[j], above[j] = BELOW, ABOVE
        return self._blended(above) - self._blended(below)

    def _blended(self, w: Floats) -> Floats:
        """Rates (count,) between corners, linear in each of the shares w (count,)."""
        between = np.flatnonzero((w > BELOW) & (w < ABOVE)).tolist()
        low = w.astype(int)
        base = self.rates(tuple(low.tolist()))
        if len(between) > FEW:
            effects = (self.rates(exchange(low.tolist(), j)) - base for j in between)
            return sum((w[j] * x for j, x in zip(between, effects, strict=True)), base)
        rates = 0.0 * base
        for corner in product((BELOW, ABOVE), repeat=len(between)):
            low[between] = corner
            parts = np.where(np.array(corner) == ABOVE, w[between], 1.0 - w[between])
            rates = rates + np.prod(parts) * self.rates(tuple(low.tolist()))
        return rates

    def _solved(self, sides: Corner) -> Trial | None:
        """Mode where surfaces that do not attract have these sides.

        Those that do are rows of one problem with the laws beside them. One that keeps
        to its level because others do has a share that is constant.
        """
        n, at = self.count, np.array(sides)
        w = at.astype(float)
        for _ in range(MOST_STEPS):
            B = np.array([self._change(w, j) for j in range(n)]).T
            base = self._blended(w)
            # Each surface in a unit of its own: a power of two, which rounds nothing.
            size = np.maximum(np.max(np.abs(B[:n]), axis=1), np.abs(base[:n]))
            unit = np.exp2(-np.round(np.log2(np.maximum(size, TINY))))
            B[:n], base[:n] = unit[:, None] * B[:n], unit * base[:n]
            tolerance = unit * self.tolerance
            attract = B.diagonal() < -tolerance
            if np.any(attract & (w == LEVEL)):
                w[attract] = BELOW
                continue
            some = np.flatnonzero(attract)
            B = B[:, some]
            base += B @ (0.5 - w[some])
            w = at.astype(float)
            found, by_laws = self._modes(sides, some, unit, tolerance, base, B)
            if found.paradox:
                return None
            r = len(found.mode) - len(some)
            w[some] = 0.5 - found.multipliers[r:]
            rho = base[:n] - B[:n] @ found.multipliers[r:] + by_laws
            off = unit * self._blended(w)[:n] + by_laws - rho
            if np.all(np.abs(off) <= tolerance):
                break
        mode = at.copy()
        for k, way, now in zip(some, found.direction[r:], found.mode[r:], strict=True):
            mode[k] = WAYS.get(now, BELOW if way > 0.0 else ABOVE)
            if r and mode[k] == REDUNDANT and not way:
                mode[k] = LEVEL  # laws alone hold it
        off = np.where(at == LEVEL, -np.abs(rho), np.where(at == ABOVE, rho, -rho))
        leads = np.where(np.abs(rho) <= tolerance, 0.0, off)
        leads[some] = math.inf
        return Trial(mode.tolist(), w, leads, found)

    def _modes(
        self, sides: Corner, some: Ints, unit: Floats, tolerance: Floats, base: Floats,
        B: Floats,
    ) -> tuple[RowModes, Floats]:  # fmt: skip
        """Modes of laws and of the surfaces that attract; what the laws add to rates.

        A share that laws can do without is 1/2, as that of a surface at its level.

        Parameters
        ----------
        some : ndarray of int, shape (s,)
            The numbers of those surfaces.
        unit, tolerance : ndarray, shape (n,)
            Of the surfaces, which have been brought to these units.
        base : ndarray, shape (n + r,)
            Rates of surfaces and laws with shares of 1/2 of some.
        B : ndarray, shape (n + r, s)
            How they change with these shares.
        """
        n, s, (laws, response) = self.count, len(some), self.laws(sides)
        r = len(laws.rates)
        rows = [*range(n, n + r), *some]
        left = np.vstack([laws.closed.D, unit[some, None] * response[some]])
        D = np.hstack([left, -B[rows]])
        # Rows of shares as long as their columns, as those of forces are.
        down, across = (np.linalg.norm(x, axis=0) for x in (D[:r, r:], D[r:, :r].T))
        ratio = np.divide(down, across, out=np.ones(s), where=down * across > 0.0)
        scale = np.append(np.ones(r), np.exp2(np.round(np.log2(ratio))))
        roundoff = np.append(laws.roundoff, tolerance[some])
        c = scale * np.where(np.abs(base[rows]) > roundoff, base[rows], 0.0)

        def ahead(p: Floats) -> tuple[Floats, Floats]:
            w = np.array(sides, dtype=float)
            w[some] = 0.5 - p[r:]
            moment, change = self.ahead(w, p[:r])
            change[:n] *= unit
            return scale * change[rows], scale * roundoff / moment

        none, bounds = np.zeros(s), np.full(s, 0.0 if r else 0.5)
        while True:
            found = modes(
                laws.closed.with_shares(scale[:, None] * D, bounds), c,
                np.append(laws.rates, none), scale * roundoff,
                np.append(laws.slow, none), ahead, np.append(laws.left, none > 0.0),
            )  # fmt: skip
            needed = ~np.isin(found.mode[r:], HOLDING) & (bounds == 0.0)
            if not needed.any():
                return found, unit * (response @ found.multipliers[:r])
            bounds[needed] = 0.5


HOLDING = (Mode.HELD, Mode.REDUNDANT)
WAYS = {Mode.HELD: SLIDING, Mode.REDUNDANT: REDUNDANT}


def exchange(sides: Sequence[int], k: int, now: int = BELOW) -> Corner:
    """Sides with surface k on its other one; from its level, on `now`."""
    other = now if sides[k] == LEVEL else 1 - sides[k]
    return (*sides[:k], other, *sides[k + 1 :])


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


class Carried(NamedTuple):
    """A surface with a side of its own on either side of one that the motion follows.

    Attributes
    ----------
    leader
        The number of that one.
    high
        The side on its upper side.
    ends_below, ends_above
        Whether the expression has a value there that can leave the side: it has none
        where it is at its level because that one is.
    """

    leader: int
    high: float
    ends_below: bool = False
    ends_above: bool = False


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
        self.has_whole = bool(self.whole.any())
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
        self.carried: dict[int, Carried] = {}
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

    def way(self, k: int, level: float) -> float:
        """Return 1 where surface k is above a level, -1 where it is below."""
        above = self.value[k] >= level if self.whole[k] else self.value[k] > 0.0
        return 1.0 if above else -1.0

    def put_clear(self, k: int, value: float) -> None:
        """Put surface k on the side on which its expression has this value."""
        self.kind[k] = 0.0
        sign = 1.0 if value > 0.0 else -1.0
        self.value[k] = math.floor(value) if self.whole[k] else sign

    def carry(self, k: int, carried: Carried) -> None:
        """Let surface k have two sides, on those of one that the motion follows."""
        self.kind[k] = kept.CARRIED
        self.carried[k] = carried

    def level(self, k: int, value: float) -> float:
        """Level of surface k that is closest to a value."""
        return float(np.round(value)) if self.whole[k] else 0.0

    def write(self) -> None:
        """Store the mode where the compiled functions read it."""
        p, slides, value, free = self.p, self.slides, self.value, self.bound
        p.sliding = float(np.count_nonzero(slides))
        p.side[:] = value
        p.slides[:] = self.kind
        p.low[:] = np.where(self.whole | free, value, -1.0)
        p.high[:] = np.where(self.whole, value + 1.0, 1.0)
        p.leader[:] = p.ends_above = 0.0
        least, most = self._ends(value)
        for k, carried in self.carried.items():
            p.leader[k] = carried.leader + 1
            p.high[k] = carried.high
            free[k] = not carried.ends_below
            p.ends_above += carried.ends_above
        if p.ends_above:
            p.least_above[:], p.most_above[:] = self._ends(p.high)
            fixed = [k for k, x in self.carried.items() if not x.ends_above]
            p.least_above[fixed], p.most_above[fixed] = -math.inf, math.inf
        least[free], most[free] = -math.inf, math.inf
        if self.watched:
            least[self.watched] = most[self.watched] = self.levels[self.watched]
        if p.sliding:
            least[slides] = np.where(self.on_rates, 0.0, self.levels)[slides]
            most[slides] = np.where(self.on_rates, self.levels, 0.0)[slides]
        p.least[:] = least
        p.most[:] = most

    def _ends(self, sides: Floats) -> tuple[Floats, Floats]:
        """Values between which expressions keep these sides, least and most (K,)."""
        up, whole = sides > 0.0, self.whole
        least, most = np.where(up, 0.0, -math.inf), np.where(up, math.inf, 0.0)
        if self.has_whole:
            least = np.where(whole, sides, least)
            most = np.where(whole, sides + 1.0, most)
        return least, most

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

        Neither a side nor another place, nor a later time, gives them a rate that is
        more than rounding, and they are off by no more than that makes in the run.
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
        later = arc.t + ASIDE * span
        former = self.value.copy(), self.kind.copy()
        for side in (BELOW, ABOVE):
            for k in np.flatnonzero(found).tolist():
                self.put(k, levels[k], side)
            self.write()
            aside = self._aside(later)
            for t, y in ((arc.t, arc.y), (arc.t, aside), (later, aside)):
                found &= self._roundoff_of_rates(y, t) >= 0.0
        self.restore(*former)
        self.write()
        return {k: float(most[k]) for k in np.flatnonzero(found).tolist()}

    def _aside(self, t: float) -> Floats:
        """State (size,) aside by a part of each range, or of what a rate does by t.

        At a start nothing has a range: what rests is set in motion by forces that begin
        at 0 there, or by what moves beside it, one after the other.
        """
        arc, state = self.arc, self.arc.state
        parts = ASIDE + ASIDE**2 * np.arange(len(arc.y))
        reach, time = arc.ranges, t - arc.t
        for _ in range(len(arc.y)):
            rates = np.abs(self.rates(t, arc.y + parts * reach))
            moved = time * np.where(np.isfinite(rates), rates, 0.0)
            moved[state.positions] += time * moved[state.velocities]
            if not np.any(moved[reach == 0.0]):
                break
            reach = np.where(reach == 0.0, moved, reach)
        return np.asarray(arc.y + parts * reach)

    def _roundoff_of_rates(self, y: Floats, t: float | None = None) -> Floats:
        """Bound the rounding (K,) of rates at y that are nothing else; -1 of others."""
        arc, rates = self.arc, self.forced(y, t)
        now = arc.t if t is None else t
        bounds = arc.runner.function("rounding")(now, y)[: arc.system.n]
        slopes = np.abs(self.rows(y, t).J[:, : arc.system.n])
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
