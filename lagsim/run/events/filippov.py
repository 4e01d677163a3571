"""Filippov's conditions at a point on switching surfaces.

From a point on several surfaces the motion crosses some, or slides along them, as
Filippov's conditions select. Each surface k has a share w_k in [0, 1] of its upper
side, and a rate rho_k at which its expression grows:

    w = 0 and rho <= 0 (below it),  w = 1 and rho >= 0 (above),  or rho = 0 (along it).

Source: A. F. Filippov, Differential Equations with Discontinuous Righthand Sides,
1988, sections 4 and 8.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.row_modes import modes
from lagsim.mechanics.rows import Mode
from lagsim.run.events.kinematics import NO_LAWS
from lagsim.run.events.surface_modes import ABOVE, BELOW, LEVEL, REDUNDANT, SLIDING
from lagsim.tolerances import (
    HALF_OF_DIGITS,
    SOLUTION_ROUNDOFF,
    TINY,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from lagsim.language.arrays import Floats, Ints
    from lagsim.mechanics.row_modes import RowModes
    from lagsim.mechanics.rows import Closed
    from lagsim.run.events.kinematics import Acting

    Corner = tuple[int, ...]
    Rates = Callable[[Corner], Floats]
    Ahead = Callable[[Floats], tuple[Floats, Floats]]
    Leaves = Callable[[Floats, int, RowModes], int | None]
    AheadOfAll = Callable[[Floats, Floats], tuple[float, Floats]]


# Largest number of shares in which rates are multilinear; for more they are linear.
FEW = 5
# Largest numbers of Newton's steps for the shares, and of selections of sides.
MOST_STEPS = 20
MOST_EXCHANGES = 1000


class Beside(NamedTuple):
    """The r rows of laws and equalities beside k surfaces, at a combination of sides.

    Attributes
    ----------
    acting : Acting
        The laws, then the equalities with kinks at the surfaces.
    effect : ndarray, shape (k, r)
        The rates of the surfaces per unit multiplier.
    rows : ndarray, shape (r, n)
        The rows. They, and the attributes below, are present only if rows have kinks at
        the surfaces.
    free : ndarray, shape (n,)
        The accelerations of the coordinates without the forces of these rows.
    surfaces : ndarray, shape (k, n)
        The rows of the surfaces.
    across : ndarray, shape (n, k)
        The accelerations of the coordinates per unit force along each surface's row.
    """

    acting: Acting
    effect: Floats
    rows: Floats = NO_LAWS.rates
    free: Floats = NO_LAWS.rates
    surfaces: Floats = NO_LAWS.rates
    across: Floats = NO_LAWS.rates

    @property
    def matrices(self) -> tuple[Floats, ...]:
        """The matrices that depend on the sides: of `acting`, then of the record."""
        return self.acting.response, *self[1:]

    def mean(self, others: Sequence[tuple[float, Beside]]) -> Beside:
        """Return the record with the weighted means of the matrices of others.

        others : the records, each with its weight.
        """
        response, *matrices = (
            np.asarray(sum(part * other.matrices[i] for part, other in others))
            for i in range(len(self.matrices))
        )
        D = matrices[1] @ response
        closed = replace(self.acting.closed, D=D, factor=np.eye(len(D)), pushes=D)
        return Beside(self.acting._replace(closed=closed, response=response), *matrices)


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
    B p, and p is bounded like a friction force. Here rho_0 are the rates at shares of
    1/2, and B (count, count) their derivatives with respect to the shares. Laws beside
    the surfaces are further rows of the problem. Where switches multiply each other, or
    rows of laws have kinks at the surfaces, so that shares multiply multipliers, the
    rates are not linear, and Newton's method solves a linear problem in each step.

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
        Function of a corner. It returns the laws there, as a `Beside`.
    kinks : list of int
        The surfaces at which rows of laws have kinks.
    modes : RowModes or None
        The modes of the laws, then of the surfaces that attract, as selected.
    resting : SideSolution or None
        The solution in which the surfaces that the selected solution follows are at
        rest at their levels instead, if there is such a solution.
    """

    def __init__(
        self,
        rates: Rates,
        scale: Floats,
        leaves: Leaves = lambda _w, _k, _modes: None,
        ahead: AheadOfAll = lambda w, _p: (1.0, 0.0 * w),
        *,
        roundoff: Floats | float = 0.0,
    ) -> None:
        self.count = len(scale)
        least = np.maximum(SOLUTION_ROUNDOFF * scale, roundoff)
        self.tolerance = np.maximum(least, TINY)  # not 0, where all terms vanish
        self.rates = cache(rates)
        self.leaves, self.ahead = leaves, ahead
        self.shares, self.is_fork = np.zeros(self.count), False
        self.kinks = list[int]()
        none = Beside(NO_LAWS, np.zeros((self.count, 0)))
        self.laws: Callable[[Corner], Beside] = lambda _corner: none
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
            others = wrong or self._side_to_exchange(sides, trial)
            exchanged = [on_other_side(sides, k, now[k]) for k in others]
            exchanged = [way for way in exchanged if way not in tried]
            if not wrong and not exchanged:
                self.shares, self.modes = trial.w, trial.modes
                self.resting = self._at_levels(sides, trial)
                return trial.mode
            ways += reversed(exchanged)
        return None

    def _side_to_exchange(self, sides: Corner, trial: SideSolution) -> list[int]:
        """Return [k], the first surface whose side has to be exchanged, or [] for none.

        The side of surface k is exchanged in two cases: the motion on its present side
        does not lead away from the surface while the motion on its other side does; or
        k is at its level, and the motion leaves the level. `select` exchanges the side
        of each surface in the list and solves again.

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

        In it the switches have their values at the level, as the file defines these
        (sign(0) = 0), and not a combination of the values on both sides. The result is
        None if with these values a rate is not 0, or a force leads away from the level.

        sides : the side of each surface.
        trial : the solution with these sides.
        """
        slides = [k for k, mode in enumerate(trial.mode) if mode == SLIDING]
        if not slides:
            return None
        level_sides = tuple(
            LEVEL if k in slides else side for k, side in enumerate(sides)
        )
        # A force within rounding would leave the level later.
        if np.any(self.rates(level_sides)[slides]):
            return None
        other = self._solved_beside(level_sides, slides)
        if other is None or np.any(other.leads < 0.0):
            return None
        response = self.laws(level_sides).effect
        pushed = response @ other.modes.multipliers[: response.shape[1]]
        if np.any(pushed[slides]):
            return None
        leaves = (self.leaves(other.w, k, other.modes) for k in slides)
        return None if any(way is not None for way in leaves) else other

    def _change(self, w: Floats, j: int, p: Floats) -> Floats:
        """Return the difference of the rates (count + r,) above and below surface j.

        After the rates of the surfaces the result has the accelerations of the laws.
        The forces of laws with kinks are included; these accelerations contain the rows
        at w, since on a kink the accelerations on both sides are equal.

        w : shape (count,), the shares of all surfaces.
        p : shape (r,), the multipliers of the laws.
        """
        below, above = w.copy(), w.copy()
        below[j], above[j] = BELOW, ABOVE
        change = self._blended(above) - self._blended(below)
        if self.kinks:
            low, high, n = self._beside(below), self._beside(above), self.count
            pushed = (high.acting.response - low.acting.response) @ p
            change[:n] += (high.effect - low.effect) @ p
            change[n:] = self._beside(w).rows @ (high.free - low.free + pushed)
        return change

    def _blended(self, w: Floats) -> Floats:
        """Return the rates (count + r,) at shares w, at multipliers 0.

        w : shape (count,).
        """
        corners = self._corners(w)
        rates = np.asarray(sum(part * self.rates(corner) for part, corner in corners))
        if self.kinks:  # the rows and the forces are linear in shares, not the products
            a = self._beside(w).free
            for part, corner in corners:
                laws = self.laws(corner)
                rates[self.count :] += part * (laws.rows @ (a - laws.free))
        return rates

    def _corners(self, w: Floats) -> list[tuple[float, Corner]]:
        """Return corners with weights, which interpolate functions of corners at w.

        w : shape (count,), shares of the surfaces.
        """
        between = np.flatnonzero((w > BELOW) & (w < ABOVE)).tolist()
        low = w.astype(int)
        if len(between) > FEW:
            base, parts = low.tolist(), w[between].tolist()
            aside = [on_other_side(base, j) for j in between]
            return [(1.0 - sum(parts), tuple(base)), *zip(parts, aside, strict=True)]
        found = []
        for corner in product((BELOW, ABOVE), repeat=len(between)):
            low[between] = corner
            parts = np.where(np.array(corner) == ABOVE, w[between], 1.0 - w[between])
            found.append((float(np.prod(parts)), tuple(low.tolist())))
        return found

    def _beside(self, w: Floats) -> Beside:
        """Return the laws at shares w (count,).

        Without kinks these are the laws at the shares rounded down.
        """
        first = self.laws(tuple(w.astype(int).tolist()))
        if not self.kinks or not ((w > BELOW) & (w < ABOVE)).any():
            return first
        corners = self._corners(w)
        return first.mean([(part, self.laws(corner)) for part, corner in corners])

    def _held_at_kinks(self, sides: Floats) -> Floats:
        """Return the multipliers (r,) of the laws if the motion stays on all kinks.

        On a kink, the rows of both sides hold: a force along the surface is the
        multiplier of a further equality. The jump of the forces of laws across the kink
        is computed from the multipliers there.

        sides : shape (count,), the sides of all surfaces.
        """
        w, kinks = sides.copy(), self.kinks
        w[kinks] = 0.5
        laws, n = self._beside(w), self.count
        c, none = self._blended(w), np.zeros(len(kinks))
        rows = np.vstack([laws.rows, laws.surfaces[kinks]])
        D = rows @ np.hstack([laws.acting.response, laws.across[:, kinks]])
        acting = laws.acting
        roundoff = np.append(acting.roundoff, self.tolerance[kinks])
        c = c[[*range(n, len(c)), *kinks]]
        found = modes(
            acting.closed.with_equalities(D),
            np.where(np.abs(c) > roundoff, c, 0.0), np.append(acting.rates, none),
            roundoff, np.append(acting.slow, none),
        )  # fmt: skip
        return found.multipliers[: len(acting.rates)]

    def _solved(self, sides: Corner) -> SideSolution | None:
        """Solve for all modes, with given sides of the surfaces that do not attract.

        A surface at which laws alone hold the motion has the value of its switch at the
        level, if this is a solution; else surfaces with kinks precede the laws in the
        choice of independent rows. None where the problem has no solution.
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
        level_sides = tuple(LEVEL if k in level else x for k, x in enumerate(sides))
        other = self._solved_beside(level_sides, level) if level else None
        if other is not None and not other.leads[level].any():
            other.leads[level] = math.inf
            if self._is_inside(level_sides, other):
                return other
        first = [k for k in level if k in self.kinks]
        return (first and self._solved_beside(sides, (), first)) or trial

    def _is_mean(self, k: int, w: Floats) -> bool:
        """Whether rates at the level of surface k are the means of both sides' rates.

        True for `sign`, False for a condition.

        w : shape (count,), the shares of the other surfaces.
        """
        at, mean = w.copy(), w.copy()
        at[k], mean[k] = LEVEL, 0.5
        off = np.abs(self._blended(at) - self._blended(mean))[: self.count]
        if not np.all(off <= self.tolerance):
            return False
        if not self.kinks:
            return True
        rows = self._beside(at).rows, self._beside(mean).rows
        return bool(np.all(np.abs(rows[1] - rows[0]) <= SOLUTION_ROUNDOFF))

    def _is_inside(self, sides: Corner, trial: SideSolution) -> bool:
        """Whether the multipliers of all laws at rest are clearly inside their bounds.

        sides, trial : the sides of the surfaces, and the solution with them.
        """
        laws, p = self.laws(sides).acting, trial.modes.multipliers
        closed, slow = laws.closed, np.abs(laws.rates) <= laws.slow
        table = closed.table
        for k in np.flatnonzero(table.bounded & slow).tolist():
            if trial.modes.mode[k] is Mode.SLIDING:
                return False
            if trial.modes.mode[k] in HOLDING:
                n, pair = table.normals[k], table.pairs[k]
                size = math.hypot(p[k], p[pair] if pair >= 0 else 0.0)
                limit = closed.statics[k] * (p[n] if n >= 0 else 1.0)
                if not size < (1.0 - HALF_OF_DIGITS) * limit:
                    return False
        return True

    def _solved_beside(
        self, sides: Corner, level: Sequence[int], first: Sequence[int] = ()
    ) -> SideSolution | None:
        """Solve for the modes of the laws and of the surfaces that attract.

        Laws and surfaces are rows of one problem. None where the problem has no
        solution.

        Parameters
        ----------
        sides
            The sides of the surfaces that do not attract.
        level
            Surfaces that are treated as if they did not attract, with a constant share,
            since laws alone hold the motion at their levels.
        first
            Surfaces whose shares vary, although laws could hold the motion there: the
            multipliers of these laws are constant.
        """
        n, at = self.count, np.array(sides)
        w = at.astype(float)
        p = self._held_at_kinks(w) if self.kinks else np.zeros(0)
        bent = np.zeros(n, dtype=bool)
        for _ in range(MOST_STEPS):
            B = np.array([self._change(w, j, p) for j in range(n)]).T
            base, laws = self._blended(w), self._beside(w)
            # Each surface is scaled by a power of two, without rounding.
            size = np.maximum(np.max(np.abs(B[:n]), axis=1), np.abs(base[:n]))
            unit = np.exp2(-np.round(np.log2(np.maximum(size, TINY))))
            B[:n], base[:n] = unit[:, None] * B[:n], unit * base[:n]
            tolerance = unit * self.tolerance
            attract = bent | (B.diagonal() < -tolerance)
            attract[[*level]] = False
            bent[self.kinks] = attract[self.kinks]
            if np.any(attract & (w == LEVEL)):
                w[attract] = BELOW
                continue
            attracting, before = np.flatnonzero(attract), w
            B = B[:, attracting]
            base += B @ (0.5 - w[attracting])
            w = at.astype(float)
            found, by_laws, rounding = self._modes(
                laws, sides, attracting, unit, tolerance, base, B, first
            )
            if found.paradox:
                return None
            r = len(found.mode) - len(attracting)
            p = found.multipliers[:r]
            w[attracting] = 0.5 - found.multipliers[r:]
            rho = base[:n] - B[:n] @ found.multipliers[r:] + by_laws
            effect = self._beside(w).effect if self.kinks else laws.effect
            off = unit * (self._blended(w)[:n] + effect @ p) - rho
            # The rows with kinks were computed at the shares before.
            turned = self.kinks and np.any(np.abs(w - before) > HALF_OF_DIGITS)
            if not turned and np.all(np.abs(off) <= np.maximum(tolerance, rounding)):
                break
        mode = at.copy()
        for k, way, now in zip(
            attracting, found.direction[r:], found.mode[r:], strict=True
        ):
            mode[k] = WAYS.get(now, BELOW if way > 0.0 else ABOVE)
        by_laws_alone = [k for k in attracting.tolist() if r and mode[k] == REDUNDANT]
        off = np.where(at == LEVEL, -np.abs(rho), np.where(at == ABOVE, rho, -rho))
        leads = np.where(np.abs(rho) <= np.maximum(tolerance, rounding), 0.0, off)
        leads[attracting] = math.inf
        return SideSolution(mode.tolist(), w, leads, found, by_laws_alone)

    def _modes(
        self, beside: Beside, sides: Corner, attracting: Ints, unit: Floats,
        tolerance: Floats, base: Floats, B: Floats, first: Sequence[int],
    ) -> tuple[RowModes, Floats, Floats]:  # fmt: skip
        """Solve for the modes of laws and attracting surfaces, as one contact problem.

        If the laws cancel the effect of a share, the share is 1/2, its value at a
        level. In the shapes below, n is `count` and r is the number of laws.

        Parameters
        ----------
        beside : Beside
            The laws.
        sides
            The sides of the surfaces that do not attract.
        attracting : ndarray of int, shape (s,)
            The indices of the surfaces that attract.
        unit, tolerance : ndarray, shape (n,)
            Factors that scale the rates of surfaces, and their scaled tolerances.
        base : ndarray, shape (n + r,)
            Rates of surfaces and laws with shares of 1/2 of the surfaces `attracting`.
        B : ndarray, shape (n + r, s)
            Derivatives of these rates with respect to the shares.
        first
            Surfaces whose shares precede the laws in the choice of independent rows.

        Returns
        -------
        found : RowModes
            The modes of the laws, then of the surfaces that attract.
        rates : ndarray, shape (n,)
            The rates of the surfaces due to the laws.
        roundoff : ndarray, shape (n,)
            Bounds of the rounding in `rates`: the effects of laws may cancel.
        """
        n, s, laws, response = self.count, len(attracting), *beside[:2]
        r = len(laws.rates)
        rows = [*range(n, n + r), *attracting]
        left = np.vstack([laws.closed.D, unit[attracting, None] * response[attracting]])
        D = np.hstack([left, -B[rows]])
        # Rows of shares are scaled to the lengths of their columns, as for forces.
        down, across = (np.linalg.norm(x, axis=0) for x in (D[:r, r:], D[r:, :r].T))
        ratio = np.divide(down, across, out=np.ones(s), where=down * across > 0.0)
        scale = np.append(np.ones(r), np.exp2(np.round(np.log2(ratio))))
        roundoff = np.append(laws.roundoff, tolerance[attracting])
        c = scale * np.where(np.abs(base[rows]) > roundoff, base[rows], 0.0)

        def ahead(p: Floats) -> tuple[Floats, Floats]:
            w = np.array(sides, dtype=float)
            w[attracting] = 0.5 - p[r:]
            moment, change = self.ahead(w, p[:r])
            change[:n] *= unit
            return scale * change[rows], scale * roundoff / moment

        none, bounds = np.zeros(s), np.full(s, 0.0 if r else 0.5)
        order = [r + i for i, k in enumerate(attracting.tolist()) if k in first]
        bounds[[i - r for i in order]] = 0.5
        order += [i for i in range(r + s) if i not in order]
        while True:
            found = modes_in_order(
                order, laws.closed.with_shares(scale[:, None] * D, bounds), c,
                np.append(laws.rates, none), scale * roundoff,
                np.append(laws.slow, none), ahead, np.append(laws.left, none > 0.0),
            )  # fmt: skip
            holds = np.array([mode in HOLDING for mode in found.mode[r:]], dtype=bool)
            needed = ~holds & (bounds == 0.0)
            if not needed.any():
                p = found.multipliers[:r]
                terms = np.abs(response) @ np.abs(p)
                return found, unit * (response @ p), unit * SOLUTION_ROUNDOFF * terms
            bounds[needed] = 0.5


def modes_in_order(
    order: list[int], closed: Closed, c: Floats, rates: Floats, roundoff: Floats,
    slow: Floats, ahead: Ahead, left: Ints,
) -> RowModes:  # fmt: skip
    """Determine the modes of rows; of dependent rows the first ones in `order` hold.

    order : the indices of the r rows.
    closed, c, rates, roundoff, slow, ahead, left : see `row_modes.modes`.
    """
    if order == [*range(len(order))]:
        return modes(closed, c, rates, roundoff, slow, ahead, left)
    D, back = closed.D[np.ix_(order, order)], np.argsort(order)
    ordered = replace(
        closed, table=closed.table.part(order), D=D, factor=np.eye(len(D)),
        pushes=D, bounds=closed.bounds[order], statics=closed.statics[order],
    )  # fmt: skip

    def later(p: Floats) -> tuple[Floats, Floats]:
        change, noise = ahead(p[back])
        return change[order], noise[order]

    found = modes(
        ordered, c[order], rates[order], roundoff[order], slow[order], later,
        left[order],
    )  # fmt: skip
    return replace(
        found, mode=tuple(found.mode[i] for i in back),
        direction=found.direction[back], multipliers=found.multipliers[back],
    )  # fmt: skip


HOLDING = (Mode.HELD, Mode.REDUNDANT)
WAYS = {Mode.HELD: SLIDING, Mode.REDUNDANT: REDUNDANT}


def on_other_side(sides: Sequence[int], k: int, now: int = BELOW) -> Corner:
    """Return `sides` with surface k on its other side, or on `now` instead of LEVEL."""
    other = now if sides[k] == LEVEL else 1 - sides[k]
    return (*sides[:k], other, *sides[k + 1 :])
