"""Kinematics of the laws of a run at a state: gaps, rates, and the closed laws.

A law is closed where it could act. Gaps and rates count as zero within the rounding of
their terms and of the time at which a step ended.
"""

from __future__ import annotations

import math
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.algebra import Span, least_squares
from lagsim.mechanics.complementarity import solved_regular
from lagsim.mechanics.rows import Closed, Delassus, RowTable, delassus
from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts.control import pseudorandom
from lagsim.tolerances import (
    CLEAR_OF_ROUNDING,
    COMPUTED_ZERO,
    DEPENDENT_ROWS,
    HALF_OF_DIGITS,
    SAME_TIME,
    SOLUTION_ROUNDOFF,
    SUM_ROUNDOFF,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.run.arc import Arc

# Relative change of a state from which the effect of its rounding is computed.
PROBE = 2.0**-26


class MassAndRows:
    """The mass matrix, and the rows of equalities and laws, at a state.

    Parameters
    ----------
    n, laws : int
        Numbers of coordinates and of laws.
    numbers : ndarray
        M (n, n), then the rows of the equalities and of the laws, each (n,).

    Attributes
    ----------
    M : ndarray, shape (n, n)
        The mass matrix.
    equalities, rows : ndarray, shape (E, n) and (L, n)
        The rows of the equalities, and of the laws.
    slopes : ndarray, shape (L, n)
        The sizes of the elements of `rows`.
    """

    def __init__(self, n: int, laws: int, numbers: Floats) -> None:
        self._made_of = n, laws, numbers
        self.M, rows = numbers[: n * n].reshape(n, n), numbers[n * n :].reshape(-1, n)
        self.equalities, self.rows = np.split(rows, [len(rows) - laws])
        self.slopes = np.abs(self.rows)
        self._links: dict[int, list[int]] = {}

    def is_of(self, n: int, laws: int, numbers: Floats) -> bool:
        """Whether this object was constructed from n, laws and `numbers`, see `_shape`.

        Then `_shape` returns it again, with its memoized results.
        """
        known = self._made_of
        return known[:2] == (n, laws) and np.array_equal(known[2], numbers)

    @cached_property
    def delassus(self) -> Delassus:
        """Delassus matrix of the laws, with the equalities in force."""
        return delassus(self.M, self.equalities, self.rows)

    def lift(self, indices: Sequence[int], rates: Floats) -> Floats:
        """Return the least change (n,) of q or q' that changes laws by given amounts.

        Parameters
        ----------
        indices
            The numbers of r laws.
        rates : ndarray, shape (r,)
            The changes of the residuals or rates of these laws.
        """
        if len(indices) == 1:
            [k] = indices
            own = self.delassus.D[k, k]
            return self.delassus.response[:, k] * (rates[0] / own if own > 0.0 else 0.0)
        D = self.delassus.D[np.ix_(indices, indices)]
        found = solved_regular(D, rates)
        if found is None:
            found = least_squares(D, rates, None)
        return self.delassus.response[:, indices] @ found

    def linked(self, k: int) -> list[int]:
        """Return the laws whose rates an impulse of law k changes; memoized."""
        found = self._links.get(k)
        if found is None:
            found = self._links[k] = np.flatnonzero(self.delassus.D[k]).tolist()
        return found

    @cached_property
    def coupling(self) -> Floats:
        """The sizes |D_ij| (L, L) of the elements of the Delassus matrix."""
        return np.abs(self.delassus.D)

    @cached_property
    def inverse_slopes(self) -> Floats:
        """The sizes (L, n) of the least change of q that changes each law by 1."""
        squares = (self.slopes * self.slopes).sum(axis=1)[:, None]
        return np.asarray(self.slopes / np.where(squares > 0.0, squares, 1.0))

    @cached_property
    def spread(self) -> Floats:
        """The sizes (n, L) of the accelerations of coordinates per multiplier."""
        return np.abs(self.delassus.response)


# The last few `MassAndRows`, latest first: they change seldom.
_LAST: list[MassAndRows] = []
_KEPT = 4


def _shape(n: int, laws: int, numbers: Floats) -> MassAndRows:
    """Return the mass matrix and the rows in the array `numbers`; memoized.

    numbers : M (n, n) and then the rows, as a compiled function returns these.
    n, laws : the counts of coordinates and laws.
    """
    for known in _LAST:
        if known.is_of(n, laws, numbers):
            return known
    found = MassAndRows(n, laws, numbers.copy())
    _LAST.insert(0, found)
    del _LAST[_KEPT:]
    return found


@lru_cache(maxsize=4)
def _probes(size: int) -> Floats:
    """Return relative changes (size,), about `PROBE`, that differ by component.

    The effects of different changes cannot cancel each other.
    """
    return np.array([PROBE * (0.5 + pseudorandom(i, 0)) for i in range(size)])


class Kinematics:
    """The laws of a run at one state.

    Attributes
    ----------
    held : sequence of int
        Indices of the laws that hold, as equalities do, while forces are evaluated; all
        other laws are off there.
    released : sequence of int
        Indices of the equalities that do not hold while forces are evaluated.
    gaps, rates, accelerations : ndarray, shape (L,)
        Of each law: the gap of a contact, or the rate of another law; the rate; and the
        derivative of the rate without the other laws.
    of_released : ndarray, shape (e,)
        The accelerations of the released equalities, without laws.
    forces : ndarray, shape (L,)
        The magnitude of the terms of `accelerations`.
    free : ndarray, shape (size,)
        y' without any law but `held`, and without the equalities `released`.
    pushes : ndarray, shape (L,)
        `forces` plus the accelerations that closed laws could add: the scale of a
        balance of forces.
    moves : ndarray, shape (n,)
        The magnitude of the accelerations of coordinates that closed laws could cause.
    bounds, statics : ndarray, shape (L,)
        The friction coefficient or limit of each law while it slides and while it
        sticks.
    slack : ndarray, shape (L,)
        Bounds of the rounding errors of `gaps`.
    still : ndarray, shape (L,)
        Bounds of the rounding errors of `rates`.
    magnitudes : ndarray, shape (size,)
        The largest magnitude of each component of the state so far.
    in_force : list of bool, length L
        Whether the condition `when` of each law is true.
    grazing : dict of int to float
        The depths of contacts whose gap turns back below 0 without an impact.
    reach : tuple of two ndarray, shape (L,)
        The ranges of the residual and of the rate of each law in the motion so far.
    fastest : ndarray, shape (L,)
        The sum of the magnitudes of the terms of each rate, at the largest velocities
        so far.
    shape : MassAndRows
        The mass matrix and all rows.
    rows : ndarray, shape (L, n)
        The rows of the laws.
    """

    def __init__(
        self,
        arc: Arc,
        y: Floats,
        t: float | None = None,
        near: Kinematics | None = None,
        held: Sequence[int] = (),
        released: Sequence[int] = (),
    ) -> None:
        """Evaluate the laws at the state y (size,) and the time t (default: now).

        near : the laws at another state of the same instant, with equal ranges.
        held : the indices of laws that hold as equalities, in their present modes.
        released : the indices of equalities that do not hold.
        """
        system, n, m = arc.system, arc.system.n, arc.system.m
        self.arc, self.y, self.laws, self.held = arc, y, system.laws, [*held]
        self.released = list(released)
        self.t = t = arc.t if t is None else t
        self.count, size = len(system.laws), (n + m) * n
        found = arc.runner.function("geometry", size + 4 * m)(t, y)
        self.shape = _shape(n, self.count, found[:size])
        self.rows = self.shape.rows
        values = found[size:].reshape(4, m)[:, m - self.count :]
        self.residuals, self.rates, gap_scales, rate_scales = values
        self.table = table = system.law_table
        self.gaps = np.where(table.gapped, self.residuals, self.rates)
        self.in_force: list[bool] = [True] * self.count
        if system.has_times:
            conditions = arc.runner.function("conditions", self.count)(t, y)
            self.in_force = (conditions != 0.0).tolist()
        slopes = self.shape.slopes
        places, speeds = self.levels = arc.state.positions, arc.state.velocities
        if near is not None and near.shape is self.shape:
            self.magnitudes: Floats = near.magnitudes
            self.reach: tuple[Floats, Floats] = near.reach
            self.fastest: Floats = near.fastest
        else:
            self.magnitudes, ranges = arc.magnitudes, arc.ranges
            self.reach = slopes @ ranges[places], slopes @ ranges[speeds]
            self.fastest = slopes @ self.magnitudes[speeds]
        magnitudes, sizes = self.magnitudes, np.maximum(rate_scales, self.fastest)
        v = y[speeds]
        # A coordinate that has not moved yet has the size that it will have soon.
        expected = magnitudes[:n] + arc.settings.output_step * np.abs(v)
        position_scales = np.maximum(gap_scales, slopes @ expected)
        # Within the rounding of the time a gap changes by its rate and by terms of t.
        speeds_of_terms = np.abs(self.rates) + np.abs(self.rates - self.rows @ v)
        self.slack = (
            SUM_ROUNDOFF * position_scales + SAME_TIME * math.ulp(t) * speeds_of_terms
        )
        self.grazing: dict[int, float] = {} if near is None else near.grazing
        self.closed = self._closed()
        self.scales = position_scales, sizes
        self._compute_free()
        # Rounding errors of balanced forces have changed rates during the last step;
        # within the rounding of the time forces change rates.
        rounding = SUM_ROUNDOFF * np.maximum(sizes, self.pushes * arc.state.step_h)
        self.still = rounding + SAME_TIME * math.ulp(t) * self.pushes

    def at(self, y: Floats, t: float | None = None) -> Kinematics:
        """Return the laws at the state y (size,) and t (default: now).

        Contacts that graze here graze there, too.
        """
        return Kinematics(self.arc, y, t, self, self.held, self.released)

    def _compute_free(self) -> None:
        """Compute accelerations (L,) of the laws, all laws off, and sizes of terms.

        The results are stored in `free`, `bounds`, `statics`, `accelerations`,
        `forces`, `pushes` and `moves`.
        """
        n = self.arc.system.n
        self.free, b, self.bounds, self.statics = self._free(self.t, self.y)
        a = self.free[self.levels[1]]
        self.accelerations = self.rows @ a - b
        self.of_released: Floats = np.zeros(0)
        if self.released:
            released = self.shape.equalities[self.released]
            self.of_released = released @ a - self.arc.system.p.b[self.released]
        # Terms of the forces now or in the last step: where forces balance or vanish,
        # the rounding is that of their terms.
        pushed = np.maximum(np.abs(a), self.arc.state.parts[:n])
        self.forces = self.shape.slopes @ pushed + np.abs(b)
        self.pushes: Floats = self.forces
        self.moves: Floats = np.zeros(n)
        if any(self.closed):
            most = self._most(self.closed)
            self.pushes = self.forces + self.shape.coupling @ most
            self.moves = self.shape.spread @ most

    def _most(self, closed: list[bool]) -> Floats:
        """Return estimates (L,) of the largest value of the multiplier of each law.

        closed : whether each law is closed; the estimate is 0 for all others.
        """
        table, own = self.table, self.shape.delassus.D.diagonal()
        balancing = self.forces / np.where(own > 0.0, own, np.inf)
        most = np.where(closed, np.where(table.bounded, self.statics, balancing), 0.0)
        if table.has_slips:
            most[table.slips] *= most[table.normals[table.slips]]
        return most

    @cached_property
    def roundoff(self) -> Floats:
        """Bounds (L,) of the errors of `accelerations` by rounding."""
        free, b, *_ = self._dynamics_nearby(self.t)
        a = self.rows @ free[self.levels[1]] - b
        changes = np.abs(a - self.accelerations) / PROBE
        return np.asarray(SUM_ROUNDOFF * np.maximum(self.pushes, changes))

    def _dynamics_nearby(self, t: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Return (y', b, bounds, statics), see `_free`, at a state slightly off `y`.

        Each component is changed by about the part PROBE of its magnitude, see
        `_known`. The changes of the results show how sensitive they are to rounding.

        t : the time.
        """
        return self._free(t, self.y + _probes(len(self.y)) * self._known())

    @cached_property
    def restitutions(self) -> Floats:
        """The coefficients of restitution (L,) of the laws at this state."""
        known = self.arc.system.restitutions
        varies = np.isnan(known)
        if not varies.any():
            return known
        evaluate = self.arc.runner.function("restitutions", self.count)
        return np.where(varies, evaluate(self.t, self.y), known)

    def out_of_range(self, closed: Collection[int], located: Collection[int]) -> str:
        """Return a message about a coefficient out of its range, or an empty string.

        Bounds must not be negative, static bounds must not be less than dynamic ones,
        and restitutions of contacts that are struck must be in [0, 1].

        Parameters
        ----------
        closed
            The numbers of the closed laws.
        located
            The indices of the laws whose event functions were located at this time.
        """
        table, e, mu = self.table, self.restitutions, self.bounds
        negative = table.bounded & (mu <= 0.0)
        weaker = table.bounded & self.arc.system.has_static_bounds
        beyond = table.gapped & self._struck & ~((e >= 0.0) & (e <= 1.0))
        doubtful = (negative | weaker | beyond).tolist()
        for k in (k for k in closed if doubtful[k]):
            what = "friction" if table.slips[k] else "limit"
            if negative[k] and self._goes_below(k, located):
                text = f"is {mu[k]:.6g}, which is negative,"
                return f"the {what} of `{self.laws[k].name}` {text}"
            if weaker[k] and self._is_weaker_at_rest(k, located):
                least = f"{self.statics[k]:.6g}, not more than the dynamic one,"
                return f"the static {what} of `{self.laws[k].name}` falls to {least}"
            if beyond[k]:
                text = f"is {e[k]:.6g}, outside of 0 to 1,"
                return f"the restitution of `{self.laws[k].name}` {text}"
        return ""

    def _is_weaker_at_rest(self, k: int, located: Collection[int]) -> bool:
        """Whether the static bound of law k is less than the dynamic bound, at slip 0.

        The static bound must be another expression than the dynamic one. If the two
        bounds are equal to rounding, the result is whether the static bound is falling
        below the dynamic one.

        located : laws whose event functions were located at this time.
        """
        pair = self.laws[k].pair
        own = [k] if pair < 0 else [k, pair]
        if (np.abs(self.rates[own]) > self.still[own]).any():
            return False
        left, least = self.statics[k] - self.bounds[k], COMPUTED_ZERO * self.bounds[k]
        falls = k in located and self.arc.system.p.law_weakens[k] > 0.0
        if left < -least or left > least or not falls:
            return bool(left < -least)
        before = self._free_before()
        return bool(before[3][k] > before[2][k])

    def _free_before(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Evaluate `_free` just before the present time, at the state of free motion.

        The time is t less the rounding of times. If the static and the dynamic bound of
        a law are equal at t, the bounds just before t show which of them has decreased.
        """
        ago = SAME_TIME * math.ulp(self.t)
        return self._free(self.t - ago, self.arc.later(self.y, self.free, -ago))

    def _goes_below(self, k: int, located: Collection[int]) -> bool:
        """Whether the bound of law k is clearly negative, or falls below 0.

        The bound of a located law is 0 within rounding. It falls below 0 if it is
        negative shortly after, on the sides that are selected now.
        """
        least, arc = self._bound_roundoff[k], self.arc
        if self.bounds[k] < -least or k not in located or not self.t < arc.settings.end:
            return bool(self.bounds[k] < -least)
        later = arc.later(self.y, self.free, arc.short_time)
        return bool(self._free(self.t + arc.short_time, later)[2][k] < -least)

    @cached_property
    def _bound_roundoff(self) -> Floats:
        """Estimates (L,) of the rounding errors of `bounds`, by their change in t."""
        span = max(abs(self.t), self.arc.settings.duration)
        bounds = self._dynamics_nearby(self.t + PROBE * span)[2]
        return np.asarray(SUM_ROUNDOFF / PROBE * np.abs(bounds - self.bounds))

    @cached_property
    def present(self) -> Floats:
        """The accelerations (L,) of the laws with the forces in the present modes."""
        system = self.arc.system
        if not system.p.law_mode.any():
            return self.accelerations
        a = self._forced(self.t, self.y)[0][self.levels[1]]
        return np.asarray(self.rows @ a - system.p.b[system.m - self.count :])

    def _known(self) -> Floats:
        """Return magnitudes (size,) of the components, in proportion to their rounding.

        The magnitude of a component is its largest size so far, or more if a row in
        force contains it: the row is satisfied only to the rounding of its terms, and a
        change of the component by its magnitude changes the row by the size of these
        terms. For positions, rows of velocities do not count.
        """
        sizes, (position_scales, rate_scales) = self.magnitudes.copy(), self.scales
        holonomic = self.arc.system.holonomic_laws
        for level, scales in zip(
            self.levels,
            (np.where(holonomic, position_scales, 0.0), rate_scales),
            strict=True,
        ):
            if scales.any():
                part = sizes[level]
                least = scales[:, None] * self.shape.inverse_slopes
                np.maximum(part, least.max(axis=0), out=part)
        return sizes

    def _free(self, t: float, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Evaluate motion and laws at t and y (size,), all L laws off except `held`.

        Returns
        -------
        field : ndarray, shape (size,)
            y' without forces of the other laws and of the released equalities.
        b : ndarray, shape (L,)
            The right-hand sides of A q'' = b, for the rows of the laws.
        bounds, statics : ndarray, shape (L,)
            The friction coefficient or limit of each law while it slides and while it
            sticks.
        """
        p, m, L = self.arc.system.p, self.arc.system.m, self.count
        field, forces = self._forced(t, y, self.held)
        if self.released:
            pushed = self._extended.response[:, L:] @ forces[self.released]
            field[self.levels[1]] -= pushed
        # Results that `field` stores in the parameters.
        b, bounds, statics = p.b[m - L :], p.law_bounds, p.law_statics
        return field, b.copy(), bounds.copy(), statics.copy()

    def moved_by(self, active: Sequence[int]) -> Floats:
        """Return y' (size,) with active laws in their present modes, others off."""
        return self._forced(self.t, self.y, active)[0]

    def _forced(
        self, t: float, y: Floats, active: Sequence[int] | None = None
    ) -> tuple[Floats, Floats]:
        """Return y' (size,) at t and y, with the shares of the surfaces followed.

        The second result is the multipliers (m,) of all rows, without these shares.

        active : the indices of laws in their present modes; all others are off. None
            for all laws in their present modes.
        """
        arc, p = self.arc, self.arc.system.p
        mode = p.law_mode.copy()
        if active is not None:
            p.law_mode[:] = kept.OFF
            p.law_mode[[*active]] = mode[[*active]]
        along = arc.rates(t, y) if p.sliding else None
        # Called last, since it leaves b and the bounds of laws.
        found = arc.runner.function("field", len(y) + arc.system.m)(t, y)
        p.law_mode[:] = mode
        size = len(y)
        return found[:size] if along is None else along, found[size:]

    @cached_property
    def delassus_of_forces(self) -> Delassus:
        """Accelerations of the laws per unit multiplier, along the surfaces followed.

        Forces act along with the forces that keep the motion on these surfaces.
        Impulses do not: for impulses see `MassAndRows.delassus`.
        """
        p = self.arc.system.p
        if not (p.sliding or self.held or self.released):
            return self.shape.delassus
        return self.delassus_along(np.flatnonzero(p.slides == kept.FOLLOWED).tolist())

    def delassus_along(self, along: Collection[int]) -> Delassus:
        """Return the accelerations of the laws per multiplier, along some surfaces.

        along : the indices of the surfaces on which the motion is held, as in corners
            of equalities.
        """
        _, J = self.arc.surface_rows(self.t, self.y)
        return self.delassus_of(self.rows, J[sorted(along), : self.arc.system.n])

    def delassus_of(self, rows: Floats, also: Floats | None = None) -> Delassus:
        """Return the accelerations of r rows per multiplier, along the rows in force.

        Parameters
        ----------
        rows : ndarray, shape (r, n)
            The rows.
        also : ndarray, shape (s, n), optional
            Further rows in force.
        """
        shape = self.shape
        equalities = np.delete(shape.equalities, self.released, axis=0)
        more = [] if also is None else [also]
        in_force = [equalities, shape.rows[self.held], *more]
        return delassus(shape.M, np.vstack(in_force), rows)

    @cached_property
    def _extended(self) -> Delassus:
        """Accelerations of laws, then of released equalities, per unit multiplier."""
        released = self.shape.equalities[self.released]
        return self.delassus_of(np.vstack([self.rows, released]))

    def _closed(self) -> list[bool]:
        """Return for each of L laws whether it is closed.

        A slip is closed if its contact is.
        """
        mode, table = self.arc.system.p.law_mode, self.table
        holds = (self.gaps <= self.slack) | (mode == kept.HELD)
        closed = holds | (mode == kept.REDUNDANT) | ~table.one_sided
        if self.arc.system.has_times:
            closed &= self.in_force
        if off := [*self.grazing, *self.arc.system.sliders]:
            closed[off] = False
        if table.has_slips:
            closed[table.slips] = closed[table.normals[table.slips]]
        found: list[bool] = closed.tolist()
        return found

    def is_closed(self, also: Collection[int] = ()) -> list[bool]:
        """Return whether each of the L laws is closed.

        also : the indices of laws that count as closed at any gap.
        """
        if not also:
            return self.closed
        closed, table = self.closed.copy(), self.table
        for k in also:
            if table.is_one_sided[k] and self.in_force[k] and k not in self.grazing:
                closed[k] = True
                for i in table.coupled_rows[k]:
                    closed[i] = True
        return closed

    def graze(self, depths: dict[int, float]) -> None:
        """Store the depths of contacts that graze; such contacts count as open."""
        self.grazing = depths
        self.closed = self._closed()

    def reached(self, struck: Iterable[int], candidates: Collection[int]) -> list[int]:
        """Return the candidates, ascending, on which impulses of `struck` laws act.

        Impulses act through the mass matrix, and through other candidates.
        """
        left, found = set(candidates), list[int]()
        queue = [k for k in struck if k in left]
        left.difference_update(queue)
        while queue:
            k = queue.pop()
            found.append(k)
            for j in (*self.shape.linked(k), *self.table.coupled_rows[k]):
                if j in left:
                    left.remove(j)
                    queue.append(j)
        return sorted(found)

    @cached_property
    def _struck(self) -> Flags:
        """Mask (L,) of the laws that are struck if they are closed, see `strikes`."""
        table, rates, still = self.table, self.rates, self.still
        jumps = table.equal & (np.abs(rates) > still)
        return np.asarray(np.where(table.one_sided, rates < -still, jumps))

    @cached_property
    def strikes(self) -> list[bool]:
        """Whether each of the L laws, if closed, is struck: its rate has to jump.

        Beyond rounding, the rate of a one-sided law is negative, or that of an equality
        not 0.
        """
        found: list[bool] = self._struck.tolist()
        return found

    def is_off(self, parts: Floats) -> Flags:
        """Return a mask (L,) of laws whose residual is not 0 within given bounds.

        The bound is a part of the residual's range so far, plus rounding.

        parts : ndarray, shape (L,), the part for each law.
        """
        # Rounding of positions: that of the displacement by forces in the last step.
        rounded = SUM_ROUNDOFF * self.forces * self.arc.state.step_h**2
        least = parts * self.reach[0] + self.slack + rounded
        return np.asarray(np.abs(self.residuals) > least)

    def depth(self, k: int) -> float:
        """Return the depth below 0 that the gap of contact k reaches in flight.

        Infinity where law k is no contact in flight, or the gap does not turn back.
        """
        flies = self.arc.system.p.law_mode[k] == kept.OFF
        back = self.present[k]
        if not self.table.gapped[k] or not (flies and back > 0.0):
            return math.inf
        return float(self.rates[k] ** 2 / (2.0 * back) + max(0.0, -self.gaps[k]))

    def rest(self, k: int, restitution: float) -> float | None:
        """Return the time until contact k has ended its series of bounces, or None.

        None if the bounces still matter: if the height of the next flight is more than
        `least`.

        restitution : the restitution of the contact.
        """
        speed, fall = -restitution * self.rates[k], -self.present[k]
        if not (fall > 0.0 and restitution > 0.0):
            return None
        if speed * speed / (2.0 * fall) > self.least[k]:
            return None
        left = 2.0 * speed / fall
        return float(left / (1.0 - restitution)) if restitution < 1.0 else 0.0

    @cached_property
    def least(self) -> Floats:
        """The largest height (L,) of a negligible flight of each contact."""
        return self.largest_rise(self.arc.plan.tolerance)

    def largest_rise(self, part: float) -> Floats:
        """Return the height (L,) up to which a rise of each gap is negligible.

        It is the part `part` of the range of the gap so far, or more for the rounding
        of the gap and of the time.
        """
        rounded = self.slack + math.ulp(self.t) * self.reach[1]
        least = np.maximum(part * self.reach[0], CLEAR_OF_ROUNDING * rounded)
        return np.asarray(least)

    def acts_on(self, k: int, others: Collection[int]) -> bool:
        """Whether impulses of the laws `others` change the rate of law k."""
        D, indices = self.shape.delassus.D, sorted(others)
        sizes = np.sqrt(np.diag(D))
        return bool(
            np.any(
                np.abs(D[k, indices]) > SOLUTION_ROUNDOFF * sizes[k] * sizes[indices]
            )
        )

    def are_spanned(self, indices: Sequence[int], others: Sequence[int]) -> list[bool]:
        """Return for each law at `indices` whether rows of others span its row."""
        sizes = self.shape.slopes.max(axis=0)
        rows = self.rows / np.where(sizes > 0.0, sizes, 1.0)
        lengths = np.linalg.norm(rows, axis=1)[:, None]
        rows = rows / np.where(lengths > 0.0, lengths, 1.0)
        span = Span(rows.shape[1])
        for k in others:
            span.extend(rows[k], DEPENDENT_ROWS)
        outside = (np.linalg.norm(span.outside(rows[k])) for k in indices)
        return [bool(left <= HALF_OF_DIGITS) for left in outside]

    def problem(
        self, active: Sequence[int], restitutions: Floats, matrix: Delassus
    ) -> tuple[Closed, Floats]:
        """Return r laws as the rows of a contact problem, and their response (n, r).

        Column k of the response is the acceleration of the n coordinates due to a
        multiplier 1 of law k.

        Parameters
        ----------
        active : sequence of int, length r
            The indices of the laws.
        restitutions : ndarray, shape (r,)
            The coefficients of restitution of these laws.
        matrix : Delassus
            The accelerations of the rows of all laws, and of coordinates, due to unit
            multipliers.
        """
        # All laws, the usual case, need no copies.
        if len(active) == self.count:
            D, response, factor = matrix
            own, limits = self.table, (self.bounds, self.statics)
        else:
            at = np.array(active, dtype=int)
            D, factor = matrix.D[at[:, None], at], matrix.factor[:, at]
            response, own = matrix.response[:, at], self.table.part(active)
            limits = self.bounds[at], self.statics[at]
        return Closed(own, D, *limits, restitutions, factor), response

    def acting(self, active: Sequence[int], left: Mapping[int, int]) -> Acting:
        """Return active laws as the rows of the problem that selects their modes.

        active : the indices of the laws.
        left : for some laws the number of times at this instant at which they reached
            the end of their mode (`mechanics.row_modes.modes`).
        """
        closed, response = self.problem(
            active, np.zeros(len(active)), self.delassus_of_forces
        )
        slow = np.maximum(self.still, 2.0 * self.arc.system.p.law_still)
        return Acting(
            closed, self.rates[active], self.roundoff[active], slow[active],
            np.array([left.get(k, 0) for k in active], dtype=int), response,
        )  # fmt: skip


class Acting(NamedTuple):
    """The r laws that could act at a state, as arguments of `row_modes.modes`.

    Attributes
    ----------
    closed : Closed
        The laws as rows of a contact problem.
    rates, roundoff : ndarray, shape (r,)
        Rates, and bounds of the rounding errors of accelerations.
    slow : ndarray, shape (r,)
        The largest slips that count as 0.
    left : ndarray of int, shape (r,)
        The number of times at this instant at which each law reached the end of its
        mode.
    response : ndarray, shape (n, r)
        Accelerations of the coordinates per unit multiplier.
    """

    closed: Closed
    rates: Floats
    roundoff: Floats
    slow: Floats
    left: Ints
    response: Floats


_NONE = np.zeros(0)
NO_LAWS = Acting(
    Closed(RowTable.of(()), np.zeros((0, 0)), _NONE, _NONE, _NONE, _NONE),
    _NONE, _NONE, _NONE, _NONE.astype(int), _NONE,
)  # fmt: skip
