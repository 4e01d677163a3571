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

from lagsim.mechanics.row_modes import modes
from lagsim.mechanics.rows import Mode
from lagsim.methods.parts import parameters as kept
from lagsim.program.functions import on_rates
from lagsim.run.events.kinematics import NO_LAWS
from lagsim.tolerances import (
    HALF_OF_DIGITS,
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    TINY,
    VALUE_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.mechanics.row_modes import RowModes
    from lagsim.mechanics.surfaces import Side
    from lagsim.run.arc import Arc
    from lagsim.run.events.kinematics import Acting

    Corner = tuple[int, ...]
    Rates = Callable[[Corner], Floats]
    Beside = Callable[[Corner], tuple[Acting, Floats]]
    Leaves = Callable[[Floats, int, RowModes], int | None]
    Ahead = Callable[[Floats, Floats], tuple[float, Floats]]


BELOW, ABOVE, SLIDING = 0, 1, 2
LEVEL = 3  # on its level, which is no boundary here: the expression is constant
REDUNDANT = 4  # on its level because other surfaces are: its share is constant
# Largest number of shares in which rates are multilinear; for more they are linear.
FEW = 5
# Largest numbers of Newton's steps for the shares, and of selections of sides.
MOST_STEPS = 20
MOST_EXCHANGES = 1000


class SideSolution(NamedTuple):
    """The solution for one selection of sides of n surfaces.

    Attributes
    ----------
    mode : list of int
        The mode of each surface.
    w : ndarray, shape (n,)
        The shares; LEVEL for a surface at its level.
    leads : ndarray, shape (n,)
        For a surface that does not attract, the rate of its expression towards the side
        selected; a negative rate leads to the other side. Infinity for surfaces that
        attract.
    modes : RowModes
        The modes of the laws, then of the surfaces that attract.
    by_laws : list of int
        The surfaces at which rows of laws may hold the motion alone.
    """

    mode: list[int]
    w: Floats
    leads: Floats
    modes: RowModes
    by_laws: list[int]


class FilippovCone:
    """Filippov's conditions at a point on `count` surfaces.

    The conditions are a complementarity problem: with p = 1/2 - w the rates are rho_0 -
    B p, and p is bounded like a friction force. Laws beside the surfaces are further
    rows of the problem. Where switches multiply each other, the rates are not linear in
    the shares, and Newton's method solves a linear problem in each step.

    Several solutions may exist where the rate of a surface is not less on its upper
    side than on its lower one, so that the surface does not attract. Such a surface
    stays at its level, with the value of the switch there (sign(0) = 0), if its rate
    vanishes and the motion does not leave. Else it has its present side, or the other
    side if its rate leads there, or if only the motion on that side leads away.

    Parameters
    ----------
    rates
        Function of a corner: the sides BELOW, ABOVE or LEVEL of all surfaces. It
        returns the rates (count,), then the accelerations (r,) of laws without
        multipliers.
    scale : ndarray, shape (count,)
        The magnitude of the terms of the rates.
    leaves
        Function of shares (count,), a surface, and modes. It returns the side to which
        the motion leaves the surface where the rate vanishes, or None if it stays.
    ahead
        Function of shares (count,) and multipliers (r,). It returns a short time, and
        the derivatives of rates and accelerations (count + r,).
    roundoff : ndarray, shape (count,)
        Bounds of the changes of the rates by rounding of the state.

    Attributes
    ----------
    shares : ndarray, shape (count,)
        The shares in the mode that was selected.
    is_fork : bool
        Whether the other side of some surface satisfies the conditions, too.
    laws
        Function of a corner. It returns the laws there, and the rates (count, r) per
        unit multiplier.
    modes : RowModes or None
        The modes of the laws, then of the surfaces that attract, as selected.
    resting : SideSolution or None
        The solution with surfaces at rest at their levels that are followed in the
        solution selected, if there is one.
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
        self.tolerance = np.maximum(least, TINY)  # not 0, where all terms vanish
        self.rates = cache(rates)
        self.leaves, self.ahead = leaves, ahead
        self.shares, self.is_fork = np.zeros(self.count), False
        self.laws: Beside = lambda _corner: (NO_LAWS, np.zeros((self.count, 0)))
        self.modes: RowModes | None = None
        self.resting: SideSolution | None = None

    def select(
        self, now: Sequence[int], still: Collection[int] = ()
    ) -> list[int] | None:
        """Select a mode for each surface; None where no modes satisfy the conditions.

        Parameters
        ----------
        now
            The present side of each surface.
        still
            The surfaces that may stay at their level.
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
            exchanged = [on_other_side(sides, k, now[k]) for k in others]
            exchanged = [way for way in exchanged if way not in tried]
            if not wrong and not exchanged:
                self.shares, self.modes = trial.w, trial.modes
                self.resting = self._at_levels(sides, trial)
                return trial.mode
            ways += reversed(exchanged)
        return None

    def _others(self, sides: Corner, trial: SideSolution) -> list[int]:
        """Return [k], the first surface whose side has to be exchanged, or [] for none.

        The motion on the present side of surface k does not lead away from the surface,
        and that on its other side does; or k is at its level, and the motion leaves it.
        `select` exchanges the side of each surface in the list and solves again.

        Surfaces from which the motion leads away on both sides set `is_fork`. A surface
        to which the motion returns from both sides is followed, although its rate
        vanishes.

        Parameters
        ----------
        sides : tuple of int
            The side of each surface: BELOW, ABOVE or LEVEL.
        trial : SideSolution
            The solution with these sides, in which no rate leads to another side.
        """
        self.is_fork = False
        for k in np.flatnonzero(trial.leads < math.inf).tolist():
            side, w = sides[k], trial.w.copy()
            if side == LEVEL:
                if self.leaves(w, k, trial.modes) is not None:
                    return [k]
                continue
            other = self._solved(on_other_side(sides, k))
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

    def _at_levels(self, sides: Corner, trial: SideSolution) -> SideSolution | None:
        """Return the solution with followed surfaces at rest at their levels, or None.

        Where all rates are 0 with the values of switches at the level, which the file
        defines, the motion also rests with these values. The shares of a sliding mode
        mix the values on both sides. None where the motion cannot rest with these
        values.

        sides : the side of each surface.
        trial : the solution with these sides.
        """
        slides = [k for k, mode in enumerate(trial.mode) if mode == SLIDING]
        if not slides:
            return None
        held = tuple(LEVEL if k in slides else side for k, side in enumerate(sides))
        # A force of the size of rounding would leave the level later.
        if np.any(self.rates(held)[slides]):
            return None
        other = self._solved_beside(held, slides)
        if other is None or np.any(other.leads < 0.0):
            return None
        response = self.laws(held)[1]
        pushed = response @ other.modes.multipliers[: response.shape[1]]
        if np.any(pushed[slides]):
            return None
        leaves = (self.leaves(other.w, k, other.modes) for k in slides)
        return None if any(way is not None for way in leaves) else other

    def _change(self, w: Floats, j: int) -> Floats:
        """Return the difference of the rates (count + r,) above and below surface j.

        After the rates of the surfaces the result has the accelerations of the laws.

        w : shape (count,), the shares of all surfaces.
        """
        below, above = w.copy(), w.copy()
        below[j], above[j] = BELOW, ABOVE
        return self._blended(above) - self._blended(below)

    def _blended(self, w: Floats) -> Floats:
        """Return the rates (count + r,) at shares w, interpolated between corners.

        The rates are linear in each of the shares.

        w : shape (count,).
        """
        between = np.flatnonzero((w > BELOW) & (w < ABOVE)).tolist()
        low = w.astype(int)
        base = self.rates(tuple(low.tolist()))
        if len(between) > FEW:
            effects = (
                self.rates(on_other_side(low.tolist(), j)) - base for j in between
            )
            return sum((w[j] * x for j, x in zip(between, effects, strict=True)), base)
        rates = 0.0 * base
        for corner in product((BELOW, ABOVE), repeat=len(between)):
            low[between] = corner
            parts = np.where(np.array(corner) == ABOVE, w[between], 1.0 - w[between])
            rates = rates + np.prod(parts) * self.rates(tuple(low.tolist()))
        return rates

    def _solved(self, sides: Corner) -> SideSolution | None:
        """Solve for all modes, with given sides of the surfaces that do not attract.

        A surface at which laws alone hold the motion has the value of its switch at the
        level. None where the problem has no solution.
        """
        trial = self._solved_beside(sides, ())
        if trial is None or not trial.by_laws:
            return trial
        level = list[int]()
        for k in trial.by_laws:
            if not self._is_mean(k, trial.w):
                level.append(k)
            elif abs(trial.w[k] - 0.5) <= SOLUTION_ROUNDOFF:
                trial.mode[k] = LEVEL
        held = tuple(LEVEL if k in level else x for k, x in enumerate(sides))
        other = self._solved_beside(held, level) if level else None
        if other is None or other.leads[level].any():
            return trial
        other.leads[level] = math.inf
        return other if self._is_inside(held, other) else trial

    def _is_mean(self, k: int, w: Floats) -> bool:
        """Whether rates at the level of surface k are the means of both sides' rates.

        True for `sign`, False for a condition.

        w : shape (count,), the shares of the other surfaces.
        """
        at, mean = w.copy(), w.copy()
        at[k], mean[k] = LEVEL, 0.5
        off = np.abs(self._blended(at) - self._blended(mean))[: self.count]
        return bool(np.all(off <= self.tolerance))

    def _is_inside(self, sides: Corner, trial: SideSolution) -> bool:
        """Whether the multipliers of all held laws are clearly inside their bounds.

        sides, trial : the sides of the surfaces, and the solution with them.
        """
        closed, p = self.laws(sides)[0].closed, trial.modes.multipliers
        table = closed.table
        for k in np.flatnonzero(table.bounded).tolist():
            if trial.modes.mode[k] in HOLDING:
                n, pair = table.normals[k], table.pairs[k]
                size = math.hypot(p[k], p[pair] if pair >= 0 else 0.0)
                limit = closed.statics[k] * (p[n] if n >= 0 else 1.0)
                if not size < (1.0 - HALF_OF_DIGITS) * limit:
                    return False
        return True

    def _solved_beside(
        self, sides: Corner, level: Sequence[int]
    ) -> SideSolution | None:
        """Solve for the modes of the laws and of the surfaces that attract.

        Laws and surfaces are rows of one problem. A surface that is at its level
        because other surfaces are has a constant share. None where the problem has no
        solution.

        Parameters
        ----------
        sides
            The sides of the surfaces that do not attract.
        level
            The surfaces that count among these, although they attract.
        """
        n, at = self.count, np.array(sides)
        w = at.astype(float)
        for _ in range(MOST_STEPS):
            B = np.array([self._change(w, j) for j in range(n)]).T
            base = self._blended(w)
            # Each surface is scaled by a power of two, without rounding.
            size = np.maximum(np.max(np.abs(B[:n]), axis=1), np.abs(base[:n]))
            unit = np.exp2(-np.round(np.log2(np.maximum(size, TINY))))
            B[:n], base[:n] = unit[:, None] * B[:n], unit * base[:n]
            tolerance = unit * self.tolerance
            attract = B.diagonal() < -tolerance
            attract[[*level]] = False
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
        by_laws_alone = [k for k in some.tolist() if r and mode[k] == REDUNDANT]
        off = np.where(at == LEVEL, -np.abs(rho), np.where(at == ABOVE, rho, -rho))
        leads = np.where(np.abs(rho) <= tolerance, 0.0, off)
        leads[some] = math.inf
        return SideSolution(mode.tolist(), w, leads, found, by_laws_alone)

    def _modes(
        self, sides: Corner, some: Ints, unit: Floats, tolerance: Floats, base: Floats,
        B: Floats,
    ) -> tuple[RowModes, Floats]:  # fmt: skip
        """Solve for the modes of laws and attracting surfaces, as one contact problem.

        A share that the laws leave without effect is 1/2, as at a level. With n =
        `count` surfaces and r laws:

        Parameters
        ----------
        sides
            The sides of the surfaces that do not attract.
        some : ndarray of int, shape (s,)
            The indices of the surfaces that attract.
        unit, tolerance : ndarray, shape (n,)
            Factors that scale the rates of surfaces, and their scaled tolerances.
        base : ndarray, shape (n + r,)
            Rates of surfaces and laws with shares of 1/2 of the surfaces `some`.
        B : ndarray, shape (n + r, s)
            Derivatives of these rates with respect to the shares.

        Returns
        -------
        found : RowModes
            The modes of the laws, then of the surfaces that attract.
        rates : ndarray, shape (n,)
            The rates of the surfaces due to the laws.
        """
        n, s, (laws, response) = self.count, len(some), self.laws(sides)
        r = len(laws.rates)
        rows = [*range(n, n + r), *some]
        left = np.vstack([laws.closed.D, unit[some, None] * response[some]])
        D = np.hstack([left, -B[rows]])
        # Rows of shares are scaled to the lengths of their columns, as for forces.
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


def on_other_side(sides: Sequence[int], k: int, now: int = BELOW) -> Corner:
    """Return `sides` with surface k on its other side, or on `now` instead of LEVEL."""
    other = now if sides[k] == LEVEL else 1 - sides[k]
    return (*sides[:k], other, *sides[k + 1 :])


KINDS = {SLIDING: kept.FOLLOWED, LEVEL: kept.LEVEL, REDUNDANT: kept.REDUNDANT_SIDE}
# Number of directions in which a state is changed to compute the effect of rounding.
DIRECTIONS = 3
# Change of a state, relative to its ranges, from which constancy is tested.
ASIDE = 1e-3


class Rows(NamedTuple):
    """The linear relations of K surfaces at a state, J (q'', s') = b for sliding.

    Attributes
    ----------
    residuals, rates : ndarray, shape (K,)
        The residuals of the surfaces, and their rates.
    b : ndarray, shape (K,)
        The right-hand sides of J (q'', s') = b.
    scales : ndarray, shape (K,)
        The magnitude of the terms of each expression.
    J : ndarray, shape (K, n + l)
        The Jacobian rows of q'' (n,) and of the rates s' (l,) of first order.
    """

    residuals: Floats
    rates: Floats
    b: Floats
    scales: Floats
    J: Floats


class Carried(NamedTuple):
    """A carried surface: its side depends on that of a followed surface, its leader.

    Attributes
    ----------
    leader
        The index of the leader.
    high
        The side of the carried surface on the upper side of the leader.
    ends_below, ends_above
        Whether the expression of the carried surface can leave its side, below and
        above the leader. It cannot where it is at its level because the leader is.
    """

    leader: int
    high: float
    ends_below: bool = False
    ends_above: bool = False


class Selected(NamedTuple):
    """Data on the selected modes of K surfaces that are not in the kernels' memory.

    Attributes
    ----------
    levels : ndarray, shape (K,)
        The level at which each surface was put.
    carried : mapping of int to Carried
        The carried surfaces.
    watched : tuple of int
        The surfaces whose mode ends off their level.
    """

    levels: Floats
    carried: Mapping[int, Carried]
    watched: tuple[int, ...]


class SurfaceModes:
    """The modes of the switching surfaces of a run, on trial at an instant.

    `begin` reads the modes from the memory of the arc, and `write` writes them there,
    within a trial (`run.modes`).

    Attributes
    ----------
    arc : Arc
        The arc that `begin` was called with.
    value : ndarray, shape (K,)
        The side of each surface: -1 or 1, or the integer below the expression of a
        floor; while sliding, that of the lower side. A value between the sides where
        the expression stays at its level.
    slides : ndarray of bool, shape (K,)
        Whether the motion follows each surface.
    depends : list of set of int
        For each surface, the surfaces on whose sides its expression depends.
    """

    def __init__(self, arc: Arc) -> None:
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
        self.begin(arc)

    def begin(self, arc: Arc, selected: Selected | None = None) -> None:
        """Read the modes from the memory of the arc.

        selected : the parts of the modes that the memory lacks, if modes have been
            selected at this instant; else no surface is carried or watched.
        """
        self.arc, p = arc, arc.system.p
        self.kind = p.slides.copy()
        # Before the first selection all surfaces count as on their upper sides.
        none = (p.least == p.most) & (self.kind == 0.0)
        self.value = np.where(none, 1.0, p.side)
        self.levels = np.zeros(self.count)
        self.carried: dict[int, Carried] = {}
        self.watched: list[int] = []  # whose mode ends off their level
        if selected is not None:
            self.levels[:] = selected.levels
            self.carried, self.watched = {**selected.carried}, [*selected.watched]

    def selected(self) -> Selected:
        """Return the parts of the modes that are not in the memory of the arc."""
        return Selected(self.levels.copy(), {**self.carried}, (*self.watched,))

    def _ordered(self) -> list[int]:
        """Return the indices of the surfaces, each after those on which it depends."""
        found: list[int] = []
        left = list(range(self.count))
        while left:
            ready = [k for k in left if self.depends[k] <= {*found, k}] or left[:1]
            found += ready
            left = [k for k in left if k not in ready]
        return found

    @property
    def slides(self) -> Flags:
        """Mask (K,) of the surfaces that the motion follows."""
        return np.asarray(self.kind == kept.FOLLOWED)

    @property
    def holds(self) -> Flags:
        """Mask (K,) of the surfaces whose modes keep the motion on them.

        They are followed or redundant. Surfaces at whose level constraints keep the
        motion: see `held`.
        """
        return np.asarray(self.slides | (self.kind == kept.REDUNDANT_SIDE))

    @property
    def bound(self) -> Floats:
        """Mask (K,) of the surfaces whose side is not that of their expression's value.

        They are followed, at rest at their level, or carried.
        """
        return np.asarray((self.kind != 0.0) & (self.kind != kept.CHOSEN))

    @property
    def p(self) -> kept.Parameters:
        """The parameters (memory) from which compiled functions read the modes."""
        return self.arc.system.p

    def store(self, **numbers: Floats) -> None:
        """Store arrays (K,) in the parameters p, by the names of their fields.

        Further elements of these fields, which belong to laws and `until`, stay
        unchanged.
        """
        for name, each in numbers.items():
            getattr(self.p, name)[: self.count] = each

    def restore(self, value: Floats, kind: Floats) -> None:
        """Restore `value` (K,) and `kind` (K,), the codes of the modes, from copies."""
        self.value[:], self.kind[:] = value, kind

    def forget(self) -> None:
        """Set all surfaces to be neither followed, nor carried, nor watched."""
        self.kind[:] = 0.0
        self.carried = {}
        self.watched = []

    def put(self, k: int, level: float, mode: int, share: float = 0.5) -> None:
        """Set the mode of surface k: a side, sliding along its level, or rest at it.

        level : the level of the surface.
        mode : BELOW, ABOVE, SLIDING, LEVEL or REDUNDANT.
        share : the share w of the upper side in the value at LEVEL and for REDUNDANT.
        """
        below, above = (level - 1.0, level) if self.whole[k] else (-1.0, 1.0)
        self.levels[k] = level
        self.kind[k] = KINDS.get(mode, 0.0)
        between = below + share * (above - below)
        values = {ABOVE: above, LEVEL: between, REDUNDANT: between}
        self.value[k] = values.get(mode, below)

    def way(self, k: int, level: float) -> float:
        """Return 1 where surface k is on the upper side of `level`, else -1."""
        above = self.value[k] >= level if self.whole[k] else self.value[k] > 0.0
        return 1.0 if above else -1.0

    def put_clear(self, k: int, value: float) -> None:
        """Set the side of surface k by the value of its expression, off its levels."""
        self.kind[k] = 0.0
        sign = 1.0 if value > 0.0 else -1.0
        self.value[k] = math.floor(value) if self.whole[k] else sign

    def carry(self, k: int, carried: Carried) -> None:
        """Set surface k to be carried along by its leader, a followed surface."""
        self.kind[k] = kept.CARRIED
        self.carried[k] = carried

    def level(self, k: int, value: float) -> float:
        """Return the level of surface k that is closest to `value`."""
        return float(np.round(value)) if self.whole[k] else 0.0

    def write(self) -> None:
        """Write the modes to the parameters of the compiled functions."""
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
        """Return the least and the largest value (K,) of each expression on its side.

        sides : ndarray, shape (K,), as in `value`.
        """
        up, whole = sides > 0.0, self.whole
        least, most = np.where(up, 0.0, -math.inf), np.where(up, math.inf, 0.0)
        if self.has_whole:
            least = np.where(whole, sides, least)
            most = np.where(whole, sides + 1.0, most)
        return least, most

    def rows(self, y: Floats | None = None, t: float | None = None) -> Rows:
        """Return the rows of the surfaces at y (size,) and t; by default now."""
        arc = self.arc
        y, t = arc.y if y is None else y, arc.t if t is None else t
        (residuals, rates, b, scales), J = arc.surface_rows(t, y)
        return Rows(residuals, rates, b, scales, J)

    def keeps(self, k: int) -> bool:
        """Whether surface k's expression is constant around the state reached."""
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

    def decisive(self) -> Floats:
        """Return 1 for each surface whose side decides another one's rest, shape (K,).

        The expression of a surface that rests at its level depends on the side: beside
        a knot of a linear table, `abs(table(q))` may leave 0, at which it has been.
        """
        found = np.zeros(self.count)
        for k in np.flatnonzero(self.kind == kept.LEVEL).tolist():
            found[list(self.depends[k])] = 1.0
        return found

    def held(self) -> dict[int, float]:
        """Return, by index, the surfaces at whose level constraints keep the motion.

        The value of each is a bound: the largest distance from its level that rounding
        causes in the duration of the run. The rates of these surfaces are rounding on
        both sides, at other states and at later times. Unlike the surfaces of `holds`
        they need no mode.
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
        # Surfaces at rest at their levels have values between those of their sides.
        part = np.where(self.whole, self.value % 1.0, np.abs(self.value) - 1.0)
        between = part != 0.0
        for side in (BELOW, ABOVE):
            for k in np.flatnonzero(found | between).tolist():
                self.put(k, levels[k], side)
            self.write()
            # The rate of a surface may depend on the sides of others.
            moved = np.where(self.on_rates, 0.0, span * np.abs(self.rows().rates))
            found &= moved <= most
            aside = self._aside(later)
            for t, y in ((arc.t, arc.y), (arc.t, aside), (later, aside)):
                found &= self._roundoff_of_rates(y, t) >= 0.0
        self.restore(*former)
        self.write()
        return {k: float(most[k]) for k in np.flatnonzero(found).tolist()}

    def drifts(self) -> Floats:
        """Return the largest changes (K,) of the expressions by rounding of forces.

        The changes are those in the duration of the run: where laws hold the motion at
        rest, the sizes of positions and velocities so far may all be 0.
        """
        arc, n, span = self.arc, self.arc.system.n, self.arc.settings.duration
        bounds = arc.runner.function("rounding")(arc.t, arc.y)[:n]
        reach = np.zeros(len(arc.y))
        reach[arc.velocities] = span * VALUE_ROUNDOFF * np.abs(bounds)
        reach[arc.state.positions] = span * reach[arc.velocities]
        here, found = self.values(arc.t, arc.y), np.zeros(self.count)
        for aside in self.asides(reach):
            found = np.fmax(found, np.abs(self.values(arc.t, aside) - here))
        return np.asarray(found)

    def changes(self, time: float) -> Floats:
        """Return the largest changes (K,) of the surfaces' expressions in a short time.

        The changes are computed from the present rates and from the terms of the
        forces. `time` is the length of that time.
        """
        arc, n = self.arc, self.arc.system.n
        reach = time * np.nan_to_num(np.abs(self.rates(arc.t, arc.y)))
        reach[arc.velocities] += time * arc.state.parts[:n]
        reach[arc.state.positions] += time * reach[arc.velocities]
        here = self.values(arc.t, arc.y)
        found = np.abs(self.values(arc.t + time, arc.y) - here)
        for aside in self.asides(reach):
            found = np.fmax(found, np.abs(self.values(arc.t, aside) - here))
        return np.asarray(found)

    def _aside(self, t: float) -> Floats:
        """Return a state (size,) slightly off the state reached, in every component.

        Each component is changed by a part of its range so far. A component with the
        range 0, as at the start of a run, is changed by its expected motion up to time
        t; the computation is iterated, since components at rest are set in motion by
        others, or by forces that begin at 0.
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
        """Return bounds (K,) of rounding in d/dt of the surfaces' rates at y and t.

        -1 where such a derivative exceeds its bound, so that it is not rounding alone.
        """
        arc, rates = self.arc, self.forced(y, t)
        now = arc.t if t is None else t
        bounds = arc.runner.function("rounding")(now, y)[: arc.system.n]
        slopes = np.abs(self.rows(y, t).J[:, : arc.system.n])
        roundoff = VALUE_ROUNDOFF * (slopes @ np.abs(bounds))
        return np.where(np.abs(rates) <= roundoff, roundoff, -1.0)

    def values(self, t: float, y: Floats) -> Floats:
        """Return the expressions of the surfaces (K,) at t and y (size,)."""
        return self.arc.runner.function("surfaces", self.count)(t, y)

    def rates(self, t: float, y: Floats) -> Floats:
        """Return y' (size,) at t and y (size,), on the sides that were last written."""
        return self.arc.field(t, y)

    def accelerations(self, y: Floats, t: float | None = None) -> Floats:
        """Return q'' and s' (n + l,) at y and t, on the sides that were last written.

        t : the time, by default the present time.
        """
        rates = self.rates(self.arc.t if t is None else t, y)
        return rates[self.arc.state.driven]

    def forced(self, y: Floats, t: float | None = None) -> Floats:
        """Return J (q'', s') - b (K,) of the surfaces at y and t (default: now)."""
        rows = self.rows(y, t)
        return np.asarray(rows.J @ self.accelerations(y, t) - rows.b)

    def sizes(self, rows: Rows) -> Floats:
        """Return the magnitude of each surface's terms (K,), at the sizes so far.

        The magnitude is at least the change by rounding of the state, divided by the
        unit of rounding, since slopes may vanish. Equalities transmit the rounding of
        one coordinate to others: on a rod u - x = 1e5 the coordinate x has the rounding
        of 1e5, however small it is.

        rows : the rows of the surfaces at the state.
        """
        arc, seen = self.arc, self.arc.seen
        slopes, moved = np.abs(rows.J), seen[arc.state.driven].copy()
        moved[: arc.system.n] = seen[arc.state.positions]
        levels = (slopes @ x for x in (seen[arc.state.driven], moved))
        terms = np.where(self.on_rates, *levels)
        found = np.maximum(rows.scales, terms)
        here = self.values(arc.t, arc.y)
        for aside in [*self.asides(), *self._asides_along()]:
            off = np.abs(self.values(arc.t, aside) - here)
            found = np.fmax(found, off / RESIDUAL_ROUNDOFF)
        return np.asarray(found)

    def _asides_along(self) -> list[Floats]:
        """Return states (size,) that differ by rounding along the rows in force.

        Each is the state reached, changed by the difference of two Newton steps onto
        the rows: from a state of `asides`, and from the state reached.
        """
        arc = self.arc
        if not arc.system.m:
            return []
        here, found = self._step(arc.y), []
        for aside in self.asides():
            aside[arc.state.positions] += self._step(aside) - here
            found.append(aside)
        return found

    def _step(self, y: Floats) -> Floats:
        """Return the Newton step (n,) of the positions in y (size,) onto the rows."""
        arc = self.arc
        step = arc.runner.function("position_step")
        return step(arc.t, y)[: arc.system.n].copy()

    def along_rows(self, change: Floats) -> Floats:
        """Return a small change (n + l,) of q and s, projected along the rows in force.

        change : shape (n + l,).
        """
        arc, n = self.arc, self.arc.system.n
        if not arc.system.m:
            return change
        aside, change = arc.y.copy(), change.copy()
        aside[arc.state.positions] += change[:n]
        change[:n] += self._step(aside) - self._step(arc.y)
        return change

    def asides(self, reach: Floats | float = 0.0) -> Iterator[Floats]:
        """Yield states (size,) near the state reached, for tests of its neighbourhood.

        Each component differs from that of the state by rounding plus `reach`, a number
        or an array (size,).
        """
        step = RESIDUAL_ROUNDOFF * self.arc.seen + reach
        i = np.arange(len(step))
        for k in range(DIRECTIONS):
            yield self.arc.y + np.where(i >> k & 1, -step, step)
