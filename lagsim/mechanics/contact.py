"""Numerical unilateral constraints: modes of rows, their multipliers and impulses.

All functions are linear algebra on the Delassus matrix of the rows that may be in
force, with the equalities in force eliminated; graph and state do not occur.

Impacts obey Newton's law of restitution and Coulomb's law of friction: the rate of each
contact after the impact is at least -e times the rate before, with equality where the
contact has an impulse. By Poisson's law, an impact without restitution ends the
approach; a second one adds e times its impulse, or more where a contact would close.
All contacts that touch share one simultaneous impact; where they are coupled, another
order of impacts would end in other rates. Where a series of impacts is computed as a
single impact, a contact may need a negative impulse: the series ends with the contact
at rest, and the impulse of the forces that press it down meanwhile (its weight) is part
of no impact. Friction is proportional to that impulse, of either sign, so that a slip
of constant direction loses the momentum due to the impulses of the series and of the
weight.

The modes of the rows follow from their accelerations at known rates. The friction of a
sliding row has a known direction. A row at rest holds where a multiplier within its
bound suffices, and otherwise begins to slide against that multiplier. The choice is not
unique: a box on four legs may stand on any three that support its weight. Where Lemke's
method does not end at independent contacts, because friction is bounded by discs,
contacts are removed until the remaining ones are independent, as far as friction
permits. Friction that rows share is distributed such that discs have the least parts of
their bounds: a disc slips only where no distribution holds it, in a direction that the
other rows leave free. The surface of a switch is a row, too (`Closed.with_shares`).

Source: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts (1996).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.algebra import (
    Metric,
    Span,
    least_squares,
    null_space,
    whitened_rows,
)
from lagsim.mechanics.complementarity import (
    RATES_ROUNDOFF,
    ComplementarityProblem,
    Solution,
    coupled_groups,
    is_regular,
    least_parts,
    rates_at,
    solve,
    solved_regular,
)
from lagsim.mechanics.constraints import Kind
from lagsim.tolerances import (
    ACCELERATION_ROUNDOFF,
    DEPENDENT_ROWS,
    DEPENDENT_SQUARE,
    HALF_OF_DIGITS,
    SETTLED_IMPULSE,
    SOLUTION_ROUNDOFF,
    SOLVED_LAWS,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.mechanics.constraints import Law


class Mode(IntEnum):
    """Mode of a row."""

    OFF = 0  # the multiplier is 0
    HELD = 1  # in force as an equality
    SLIDING = 2  # the multiplier is at its bound
    REDUNDANT = 3  # implied by held rows


@dataclass(frozen=True)
class Closed:
    """The r rows that may be in force: closed contacts, their slips, and other laws.

    Attributes
    ----------
    D : ndarray, shape (r, r)
        The Delassus matrix: D_ij is the acceleration of row i due to a multiplier 1
        of row j (or its change of rate due to an impulse 1). A zero diagonal entry
        marks a row that no multiplier accelerates.
    kinds : tuple of Kind
        The role of each row.
    normals : tuple of int
        For a slip, the index of the row of its contact; else -1.
    pairs : tuple of int
        For one of two slips, the index of the row of the other; else -1.
    bounds, statics : ndarray, shape (r,)
        The friction coefficient, or limit, while the row slides and while it sticks.
    restitutions : ndarray, shape (r,)
        The coefficients of restitution.
    poisson : tuple of bool, optional
        For contacts: restitution is of impulses (Poisson), not of rates (Newton).
    factor : ndarray, shape (k, r)
        D = factor^T factor. Rows at a small angle are independent in the factor even
        where they are dependent in D to rounding.
    pushes : ndarray, shape (k, r), optional
        Present where shares of switching surfaces are rows, too:
        D = factor^T pushes.
    """

    D: Floats
    kinds: tuple[Kind, ...]
    normals: tuple[int, ...]
    pairs: tuple[int, ...]
    bounds: Floats
    statics: Floats
    restitutions: Floats
    factor: Floats
    poisson: tuple[bool, ...] = ()
    pushes: Floats | None = None

    @cached_property
    def columns(self) -> Floats:
        """Matrix (k, r) with D = factor^T columns.

        `pushes` if present, else `factor`.
        """
        return self.factor if self.pushes is None else self.pushes

    @classmethod
    def of(
        cls,
        laws: Sequence[Law],
        some: Sequence[int],
        reply: Delassus,
        bounds: Floats,
        statics: Floats,
        restitutions: Floats,
    ) -> Closed:
        """Return the rows of some laws.

        Parameters
        ----------
        laws : sequence of Law
            All laws of the model.
        some : sequence of int, length r
            The indices of the laws whose rows are returned.
        reply : Delassus
            The Delassus matrix of these rows, in the order of `some`.
        bounds, statics, restitutions : ndarray, shape (r,)
            The numbers of these rows, in the order of `some`.
        """
        own, place = [laws[k] for k in some], {k: i for i, k in enumerate(some)}
        return cls(
            D=reply.D,
            kinds=tuple([law.kind for law in own]),
            normals=tuple([place.get(law.normal, -1) for law in own]),
            pairs=tuple([place.get(law.pair, -1) for law in own]),
            bounds=bounds,
            statics=statics,
            restitutions=restitutions,
            factor=reply.factor,
            poisson=tuple([law.poisson for law in own]),
        )

    def with_shares(self, D: Floats, bounds: Floats) -> Closed:
        """Return the rows with s further ones, for the shares w of switching surfaces.

        The multiplier of such a row is proportional to 1/2 - w, which is bounded in
        both directions since w is in [0, 1]. The jump of the forces need not be along
        the row, so that D need not be symmetric.

        Parameters
        ----------
        D : ndarray, shape (r + s, r + s)
            The Delassus matrix of all rows.
        bounds : ndarray, shape (s,)
            The bounds of the further multipliers.
        """
        if not len(bounds):
            return self
        alone = (-1,) * len(bounds)
        return replace(
            self, D=D, factor=np.eye(len(D)), pushes=D,
            kinds=(*self.kinds, *(Kind.LIMITED,) * len(bounds)),
            normals=self.normals + alone, pairs=self.pairs + alone,
            bounds=np.append(self.bounds, bounds),
            statics=np.append(self.statics, bounds),
        )  # fmt: skip

    @cached_property
    def bounded(self) -> Flags:
        """Mask (r,) of the rows whose multiplier is bounded in both directions."""
        return np.array([kind.bounded for kind in self.kinds], dtype=bool)


def _problem(
    closed: Closed, c: Floats, sizes: Floats, directions: Floats, *, given: Flags
) -> ComplementarityProblem:
    """Return the complementarity problem of r rows with accelerations or rates c.

    Parameters
    ----------
    closed : Closed
    c : ndarray, shape (r,)
        Accelerations or rates at multipliers 0.
    sizes : ndarray, shape (r,)
        Bounds of bounded multipliers; of slips, as parts of the multiplier of the
        contact.
    directions : ndarray, shape (r,)
        For rows that slide: the multiplier as a part of its bound, in [-1, 1].
    given : ndarray of bool, shape (r,)
        The rows that slide.
    """
    low, high = np.zeros((2, 2, len(c)))
    for k, kind in enumerate(closed.kinds):
        size = sizes[k] if kind.bounded else 1.0
        part = 1 if kind is Kind.SLIP else 0
        low[part, k], high[part, k] = kind.low * size, kind.high * size
    normals, pairs = np.array(closed.normals), np.array(closed.pairs)
    if given.any():
        low[:, given] = high[:, given] = high[:, given] * directions[given]
        pairs[given] = -1
    return ComplementarityProblem(closed.D, c, low, high, normals, pairs)


# --- the Delassus matrix --------------------------------------------------------------


class Delassus(NamedTuple):
    """Accelerations of r rows, and of n coordinates, due to multipliers of the rows.

    Attributes
    ----------
    D : ndarray, shape (r, r)
        The Delassus matrix rows K rows^T, where K f is the acceleration (n,) due to
        forces f (n,).
    response : ndarray, shape (n, r)
        K rows^T.
    factor : ndarray, shape (k, r)
        D = factor^T factor, with k the number of free directions.
    """

    D: Floats
    response: Floats
    factor: Floats


def delassus(M: Floats, A: Floats, rows: Floats) -> Delassus:
    """Compute the Delassus matrix of constraint rows under equalities.

    Rows that the equalities determine, and which no multiplier accelerates, have zero
    columns in the factor.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        The mass matrix, positive definite on the null space of A. Massless coordinates
        are admissible.
    A : ndarray, shape (e, n)
        The rows of the equalities; may be linearly dependent.
    rows : ndarray, shape (r, n)
    """
    diagonal = M.diagonal()
    if not len(A) and np.count_nonzero(M) == len(M) and diagonal.min() > 0.0:
        factor = (rows / np.sqrt(diagonal)).T
        return Delassus(factor.T @ factor, (rows / diagonal).T, factor)
    metric = Metric(M, A)
    factor = metric.free.T @ rows.T
    _, lengths = whitened_rows(rows, metric.L)
    factor[:, np.linalg.norm(factor, axis=0) <= DEPENDENT_ROWS * lengths] = 0.0
    return Delassus(factor.T @ factor, metric.free @ factor, factor)


# --- impacts --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Impact:
    """Result of an impact on r rows.

    Attributes
    ----------
    impulses : ndarray, shape (r,)
    after : ndarray, shape (r,)
        The rates of the rows after the impact.
    open : bool
        Another order of the impacts would end in other rates: the result is a
        convention of the impact law.
    energy : float
        The change of the kinetic energy in the frame of the struck bodies: the sum of
        impulse times mean rate over the rows.
    found : bool
        False where the laws have no common solution (a body that is crushed).
    """

    impulses: Floats
    after: Floats
    open: bool
    energy: float
    found: bool = True


def impact(closed: Closed, rates: Floats, roundoff: Floats) -> Impact:
    """Compute the simultaneous impact of all rows.

    Where the rates after the impact by Newton's law contradict each other, the impact
    is inelastic. The rate of a `TIMED` row becomes 0 by an impulse of either sign.

    Parameters
    ----------
    closed : Closed
    rates : ndarray, shape (r,)
        The rates of the rows before the impact.
    roundoff : ndarray, shape (r,)
        Rates up to this size count as 0.
    """
    if len(rates) == 1 and closed.kinds[0].one_sided:
        return _of_one(closed, float(rates[0]), float(roundoff[0]))
    before = np.where(np.abs(rates) <= roundoff, 0.0, rates)
    bounces = np.array([kind is Kind.CONTACT for kind in closed.kinds])
    of_impulses = bounces & (closed.poisson or False)
    newton = bounces & ~of_impulses & (before < 0.0)
    target = np.where(newton, -closed.restitutions * before, 0.0)
    rests = _at_rest(closed, before)
    solution = _impulses(closed, before - target, rests)
    locked = not solution.found and bool(target.any())
    if locked:
        target = np.zeros(len(before))
        solution = _impulses(closed, before, rests)
    p = solution.p
    if of_impulses.any() and solution.found:
        more = np.where(of_impulses, closed.restitutions * p, 0.0)
        p = p + more
        solution = _impulses(closed, solution.w + closed.D @ more, rests, more)
        p = p + solution.p
    after = solution.w + target
    is_open = locked or _is_open(closed, before, p)
    energy = float(p @ (before + after)) / 2.0
    return Impact(p, after, is_open, energy, solution.found)


def _of_one(closed: Closed, rate: float, roundoff: float) -> Impact:
    """Compute the impact of a single one-sided row."""
    own, e = float(closed.D[0, 0]), float(closed.restitutions[0])
    before = 0.0 if abs(rate) <= roundoff else rate
    bounces = closed.kinds[0] is Kind.CONTACT and before < 0.0
    target = -e * before if bounces else 0.0
    p = max((target - before) / own, 0.0) if own > 0.0 else 0.0
    after = before + own * p
    asked, missed = abs(before - target), max(target - after, 0.0)
    energy = p * (before + after) / 2.0
    found = asked == 0.0 or missed < SOLVED_LAWS * asked
    return Impact(np.array([p]), np.array([after]), False, energy, found)


def _at_rest(closed: Closed, rates: Floats) -> Flags:
    """Mark the slips at rest whose static friction coefficient is not the dynamic one.

    Returns a mask (r,).
    """
    pairs = np.array(closed.pairs)
    still = (rates == 0.0) & ((pairs < 0) | (rates[pairs] == 0.0))
    slips = np.array([kind is Kind.SLIP for kind in closed.kinds])
    return np.asarray(slips & still & (closed.statics != closed.bounds))


def _impulses(
    closed: Closed, c: Floats, rests: Flags, given: Floats | None = None
) -> Solution:
    """Solve for the impulses that bring the rates c to 0 as far as the laws permit.

    Limited rows have no impulse. Slips of `TIMED` contacts slide on in their direction,
    or are held where friction would reverse it.

    Parameters
    ----------
    closed : Closed
    c : ndarray, shape (r,)
        The rates, less the rates to be reached.
    rests : ndarray of bool, shape (r,)
        The slips with the static friction coefficient.
    given : ndarray, shape (r,), optional
        Impulses of contacts that bound friction in addition to the solved ones.
    """
    r, kinds = len(c), list(closed.kinds)
    goes_on, directions = np.zeros(r, dtype=bool), np.zeros(r)
    sizes = np.where(rests, closed.statics, closed.bounds)
    sizes = np.where([kind is Kind.SLIP for kind in kinds], sizes, 0.0)
    sliding: list[list[int]] = []
    for k, (n, pair) in enumerate(zip(closed.normals, closed.pairs, strict=True)):
        if n < 0 or kinds[n] is not Kind.TIMED or pair > k:
            continue
        rows = [k] if pair < 0 else [pair, k]
        speed = float(np.linalg.norm(c[rows]))
        if speed > 0.0:
            goes_on[rows], directions[rows] = True, -c[rows] / speed
            sliding.append(rows)
        else:
            kinds[k] = kinds[rows[0]] = Kind.TIMED
    while True:
        some = replace(closed, kinds=tuple(kinds))
        problem = _problem(some, c, sizes, directions, given=goes_on)
        if given is not None:
            known = np.where(problem.normals >= 0, given[problem.normals], 0.0)
            for bound in (problem.low, problem.high):
                bound[0] += bound[1] * known
        solution = solve(problem)
        turned = [rows for rows in sliding if solution.w[rows] @ directions[rows] > 0.0]
        if not turned:
            return solution
        for rows in turned:
            sliding.remove(rows)
            goes_on[rows] = False
            kinds[rows[0]] = kinds[rows[-1]] = Kind.TIMED


def _is_open(closed: Closed, before: Floats, p: Floats) -> bool:
    """Whether the rates after the impact depend on the order of single impacts.

    They do where two contacts that are struck are coupled, except for contacts without
    restitution and friction whose impulses lower each other's rates.
    """
    pushed = np.abs(p) > SOLUTION_ROUNDOFF * np.abs(p).max(initial=0.0)
    groups = {
        k: [k, *(i for i, n in enumerate(closed.normals) if n == k and pushed[i])]
        for k, kind in enumerate(closed.kinds)
        if kind is Kind.CONTACT and (pushed[k] or before[k] < 0.0)
    }
    scale = np.sqrt(closed.D.diagonal())
    for (i, rows), (j, others) in combinations(groups.items(), 2):
        D = closed.D[np.ix_(rows, others)]
        if not (
            np.abs(D) > SOLUTION_ROUNDOFF * np.outer(scale[rows], scale[others])
        ).any():
            continue
        plain = len(rows) == len(others) == 1 and D[0, 0] < 0.0
        if closed.restitutions[i] or closed.restitutions[j] or not plain:
            return True
    return False


# --- modes ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class RowModes:
    """Modes and multipliers of r rows.

    Attributes
    ----------
    mode : tuple of Mode, length r
        Held rows are linearly independent.
    direction : ndarray, shape (r,)
        Of a sliding row: its multiplier divided by its bound (with two slips: a
        component of a unit vector). Of a redundant row with a multiplier: the
        multiplier divided by the static bound. Of other rows: 0.
    multipliers : ndarray, shape (r,)
    paradox : bool
        Painlevé's paradox: no solution, or a sliding contact under pressure whose
        effective mass is not positive. A contact that may separate instead is
        released, without a paradox.
    open : bool
        A multiplier that is not unique bounds sliding friction: the motion is not
        unique.
    """

    mode: tuple[Mode, ...]
    direction: Floats
    multipliers: Floats
    paradox: bool
    open: bool = False


def modes(
    closed: Closed,
    accelerations: Floats,
    rates: Floats,
    roundoff: Floats,
    slip_noise: Floats,
    ahead: Callable[[Floats], tuple[Floats, Floats]] | None = None,
    left: Ints | None = None,
) -> RowModes:
    """Determine the modes of the rows and their multipliers.

    Parameters
    ----------
    closed : Closed
    accelerations : ndarray, shape (r,)
        The accelerations of the rows at multipliers 0.
    rates : ndarray, shape (r,)
        The rates of the rows. Bounded rows with larger rates than `slip_noise` slide.
    roundoff : ndarray, shape (r,)
        Accelerations up to this size count as 0.
    slip_noise : ndarray, shape (r,)
        Rates of bounded rows up to this size count as 0.
    ahead : callable, optional
        Maps multipliers (r,) to the rates of the accelerations (r,) with multipliers
        at fixed parts of their bounds, and to the rounding errors of these rates (r,).
        The rates decide ties: contacts without force and acceleration, and rows at
        rest with the multiplier at its bound. Without `ahead` tied rows hold.
    left : ndarray of int, shape (r,), optional
        How often each row has already reached the end of its held mode at this time.
        A row with a positive number does not hold where the rates decide no tie.
    """
    if not closed.kinds:
        return RowModes((), accelerations, accelerations, paradox=False)
    left = np.zeros(len(rates), dtype=int) if left is None else left
    begun = np.zeros(len(rates), dtype=bool)
    given, directions = _sliding(closed, rates, slip_noise)
    while True:
        sizes = np.where(given | begun, closed.bounds, closed.statics)
        problem = _problem(closed, accelerations, sizes, directions, given=given)
        rows = _ContactRows(
            closed, problem, sizes, given, directions, roundoff, ahead, left
        )
        solution = _solution(rows)
        if not solution.found:
            nothing, off = np.zeros(len(rates)), (Mode.OFF,) * len(rates)
            return RowModes(off, nothing, nothing, paradox=True)
        if problem.discs:
            solution = _eased(rows, _supported(rows, solution))
        found, directions_found = rows.edges(solution)
        begins = np.array([mode is Mode.SLIDING for mode in found], dtype=bool)
        begins &= ~given & (closed.bounds != sizes)
        if begins.any():
            begun |= begins
            continue
        decided = _decided(rows, found, directions_found)
        return _farther(rows, decided, directions_found) if problem.discs else decided


def _sliding(closed: Closed, rates: Floats, slip_noise: Floats) -> tuple[Flags, Floats]:
    """Return the mask (r,) of rows that slide, and the directions (r,) of friction."""
    if not closed.bounded.any():
        return closed.bounded, np.zeros(len(rates))
    pairs = np.array(closed.pairs)
    slips = np.where(pairs >= 0, np.hypot(rates, rates[pairs]), np.abs(rates))
    noise = np.where(pairs >= 0, np.maximum(slip_noise, slip_noise[pairs]), slip_noise)
    given: Flags = closed.bounded & (slips > noise)
    return given, np.where(given, -rates / np.where(given, slips, 1.0), 0.0)


# Where a row reaches the end of its mode again at the same time, multipliers in
# problems with discs count as being at their bounds within this part.
EDGE = 1e-8
# At the bound, the force of a disc is known to the square root of rounding only: it
# counts as being along a direction within this angle.
ALONG = 1e-3
# Friction up to this part of its bound is shared well enough. Close to its bound each
# small growth of a load would end a mode, and begin another one.
INSIDE = 0.5


@dataclass(frozen=True)
class _ContactRows:
    """Rows of a complementarity problem whose solution determines their modes.

    Attributes
    ----------
    closed : Closed
    problem : ComplementarityProblem
    sizes : ndarray, shape (r,)
        The bounds, as in `_problem`.
    given : ndarray of bool, shape (r,)
        The rows that slide.
    directions : ndarray, shape (r,)
        The directions of the rows that slide.
    roundoff, ahead, left
        As in `modes`.
    """

    closed: Closed
    problem: ComplementarityProblem
    sizes: Floats
    given: Flags
    directions: Floats
    roundoff: Floats
    ahead: Callable[[Floats], tuple[Floats, Floats]] | None
    left: Ints

    @cached_property
    def one_sided(self) -> list[int]:
        """Indices of contacts and freewheels."""
        return [k for k, kind in enumerate(self.closed.kinds) if kind.one_sided]

    def rounding(self, p: Floats, limits: Floats, *, coupled: bool = False) -> Floats:
        """Return roundoff bounds (r,) of the accelerations at multipliers p (r,).

        The scale is that of the largest multipliers, |p| or `limits` (r,): a row at
        rest without a force has the scale of its friction.

        coupled : whether the bounds are those of all rows coupled with discs, whose
        multipliers are known less exactly.
        """
        problem = self.problem
        pushes = np.maximum(np.abs(p), limits)
        terms = np.abs(problem.D) @ pushes + np.abs(problem.c)
        on_discs = (problem.pairs >= 0) | coupled
        parts = np.where(on_discs, SETTLED_IMPULSE, ACCELERATION_ROUNDOFF)
        return np.asarray(np.maximum(self.roundoff, parts * terms))

    def part(self, p: Floats, some: Flags) -> float:
        """Return the largest friction of `some` rows (r,) in parts of its bound."""
        limits, most = self.problem.limits(p), 0.0
        for k in np.flatnonzero(some & (limits > 0.0)).tolist():
            most = max(most, float(np.linalg.norm(p[self.disc(k)])) / limits.item(k))
        return most

    @cached_property
    def forces(self) -> Floats:
        """Forces (k,) with c = factor^T forces: those without any multiplier."""
        Y = self.closed.factor
        lengths = np.linalg.norm(Y, axis=0)
        own = lengths > 0.0
        return least_squares(
            (Y[:, own] / lengths[own]).T, self.problem.c[own] / lengths[own]
        )

    def unbalanced(self, p: Floats, rests: Flags, K: Floats) -> Floats:
        """Return the least x (j,) such that K x balances all forces on rows at rest.

        Parameters
        ----------
        p : ndarray, shape (r,)
            Multipliers.
        rests : ndarray of bool, shape (r,)
            The rows at rest.
        K : ndarray, shape (k, j)
            Directions in the space of the factor.
        """
        Y = self.closed.factor[:, rests]
        lengths = np.linalg.norm(Y, axis=0)
        U, s, _ = np.linalg.svd(
            Y / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False
        )
        Q = U[:, s > DEPENDENT_ROWS * s[0]].T
        return least_squares(Q @ K, Q @ (self.closed.columns @ p + self.forces))

    def edges(self, solution: Solution) -> tuple[list[Mode], Floats]:
        """Return the modes (r,) and directions (r,) of all rows, with ties decided.

        A row whose multiplier is strictly between its bounds is held; a row with an
        acceleration is at a bound; any other row is tied. Held rows are independent.
        """
        p, own = solution.p, self.closed.D.diagonal()
        limits = self.problem.limits(p)
        rounding = self.rounding(p, limits)
        small = rounding / np.where(own > 0.0, own, 1.0)
        if self.problem.discs:  # all forces are known to this part only
            close = EDGE if self.left.max() > 1 else SETTLED_IMPULSE
            small = np.maximum(small, close * limits)
        for disc in self.problem.discs:  # both of its rows are on its edge, or neither
            small[[*disc]] = small[[*disc]].max()
        modes, directions = [Mode.OFF] * len(p), self.directions.copy()
        held = [k for k, kind in enumerate(self.closed.kinds) if kind is Kind.TIMED]
        tied: list[int] = []
        for k in self.one_sided:
            if solution.w[k] <= rounding[k]:
                (held if p[k] > small[k] else tied).append(k)
        touches = {*held, *tied}
        bounded, ways = self._bounded(solution, rounding, limits, small)
        for k, mode in bounded.items():
            n = self.closed.normals[k]
            if n >= 0 and n not in touches:
                directions[k] = 0.0
            elif mode is Mode.SLIDING:
                modes[k], directions[k] = mode, ways[k]
            else:
                (held if mode is Mode.HELD else tied).append(k)
        self._hold(p, held, tied, modes, directions, limits, limits > small)
        return modes, directions

    def _bounded(
        self, solution: Solution, rounding: Floats, limits: Floats, small: Floats
    ) -> tuple[dict[int, Mode], Floats]:
        """Return the modes of bounded rows by their indices, and directions (r,).

        OFF for tied rows; directions as in `RowModes`, of rows that slide.

        Parameters
        ----------
        solution : Solution
        rounding : ndarray, shape (r,)
            Roundoff bounds of accelerations.
        limits, small : ndarray, shape (r,)
            Bounds of the multipliers' sizes; sizes up to `small` count as 0.
        """
        p, w = solution.p, solution.w
        force, slip, least = np.abs(p), np.abs(w), rounding.copy()
        for k, pair in enumerate(self.closed.pairs):
            if pair > k:
                disc = [k, pair]
                force[disc] = np.linalg.norm(p[disc])
                slip[disc] = np.linalg.norm(w[disc])
                least[disc] = rounding[disc].max()
        inside = ~(force >= limits - small)
        slides = (slip > least) | self.given
        at_bound = ~inside & (limits > small)
        known = np.where(at_bound, force, slip)
        ways = np.where(at_bound, p, -w) / np.where(known > 0.0, known, 1.0)
        ways = np.where(self.given, self.directions, ways)
        chosen = np.where(slides, Mode.SLIDING, np.where(inside, Mode.HELD, Mode.OFF))
        modes = chosen.tolist()
        bounded = np.flatnonzero(self.closed.bounded).tolist()
        return {k: Mode(modes[k]) for k in bounded}, ways

    def disc(self, k: int) -> list[int]:
        """Return [k], or both rows of the disc of row k, in ascending order."""
        pair = self.closed.pairs[k]
        return [k] if pair < 0 else [min(k, pair), max(k, pair)]

    def _hold(
        self,
        p: Floats,
        held: list[int],
        tied: list[int],
        modes: list[Mode],
        directions: Floats,
        limits: Floats,
        pressed: Flags,
    ) -> None:
        """Set the modes of held and tied rows, and directions of rows not held.

        A row that depends on held rows is redundant. Slips of contacts without force
        are off. `modes` and `directions` are changed in place.

        Parameters
        ----------
        p, limits : ndarray, shape (r,)
            Multipliers, and their largest sizes.
        held, tied : list of int
            Indices of rows.
        pressed : ndarray of bool, shape (r,)
            The rows whose limit is larger than rounding.
        """
        closed, span = (
            self.closed,
            _Independent(self.closed.columns, regular=self.regular),
        )
        turn = self._turned(p, tied, pressed)
        x, rate = self._rates(p, held, tied, pressed, turn)
        none = np.abs(x) <= RATES_ROUNDOFF * np.abs(x).max(initial=0.0)
        apart = [
            k
            for k in tied
            for disc in [self.disc(k)]
            if rate[disc].any() or (self.left[disc].any() and none[disc[-1]])
        ]
        ranked = sorted(tied, key=lambda k: -abs(turn[k] @ x))
        rests = [k for k in (*held, *ranked) if k not in apart]
        firm = [k for k in rests if k in held or not none[k]]
        apart = self._movable(firm, rests, apart, turn)
        for k in (*held, *ranked):
            n = closed.normals[k]
            if n >= 0 and modes[n] is not Mode.HELD:
                continue
            if k in apart:
                modes[k] = Mode.SLIDING if limits[k] else Mode.OFF
            else:
                modes[k] = Mode.HELD if span.takes(k) else Mode.REDUNDANT
            if modes[k] is not Mode.HELD and limits[k]:
                directions[k] = p[k] / limits[k]
        for k, n in enumerate(closed.normals):
            if n >= 0 and modes[n] is Mode.OFF:
                modes[k], directions[k] = Mode.OFF, 0.0

    def _turned(self, p: Floats, tied: list[int], pressed: Flags) -> Floats:
        """Return a rotation (r, r) of the rows to the axes of the forces of tied discs.

        The two rows of each tied disc become one across and one along its force; other
        rows are unchanged.
        """
        turn = np.eye(len(p))
        for i, k in self.problem.discs:
            if k in tied and pressed[k]:
                c, s = p[[i, k]] / np.linalg.norm(p[[i, k]])
                turn[np.ix_([i, k], [i, k])] = [[s, c], [-c, s]]
        return turn

    def _movable(
        self, firm: list[int], rests: list[int], apart: list[int], turn: Floats
    ) -> list[int]:
        """Return the rows of `apart` that can slip, independently of rows that hold.

        A single bounded row that depends on `firm` rows cannot. A disc can slip along
        its force only: it cannot where that direction depends on rows at rest and on
        the directions across the forces of discs at their bounds.

        Parameters
        ----------
        firm, rests, apart : list of int
            Indices of rows that hold firmly, of all rows at rest, and of tied rows
            that would not hold.
        turn : ndarray, shape (r, r)
            See `_turned`.
        """
        if not apart:
            return apart
        Y = self.closed.factor @ turn
        span = _Independent(Y)
        for k in firm:
            span.takes(k)
        single = self.closed.bounded & (np.array(self.closed.pairs) < 0)
        apart = [k for k in apart if not single[k] or span.adds(k)]
        discs = [disc for disc in self.problem.discs if disc[1] in apart]
        if not discs:
            return apart
        for k in rests:
            span.takes(k)
        for i, k in discs:
            across, along = (np.linalg.norm(span.outside(Y[:, j])) for j in (i, k))
            if across > ALONG * along:
                span.takes(i)
        locked = [disc for disc in discs if not span.adds(disc[1])]
        return [k for k in apart if self.disc(k) not in locked]

    def _rates(
        self,
        p: Floats,
        held: list[int],
        tied: list[int],
        pressed: Flags,
        turn: Floats,
    ) -> tuple[Floats, Floats]:
        """Return d/dt of multipliers less bounds (r,), and d/dt of accelerations (r,).

        Both are in the axes `turn`, and decide ties; they solve a complementarity
        problem. The rate of the multiplier of a held row is free; that of a tied row
        leads inside its bounds, or along the boundary of its disc; a row that slides
        keeps its part of its bound. Both are 0 without ties or `ahead`.
        """
        r = len(p)
        x, w = np.zeros((2, r))
        if self.ahead is None or not tied:
            return x, w
        span = _Independent(self.closed.columns, turn, regular=self.regular)
        edges = [i for i, k in self.problem.discs if k in tied and pressed[k]]
        # Rows that are not coupled with tied ones decide nothing.
        some = sorted(
            k for rows in self.groups if not rows.isdisjoint(tied) for k in rows
        )
        place = {k: i for i, k in enumerate(some)}
        free = [place[k] for k in (*held, *edges) if k in place and span.takes(k)]
        unit, S = np.eye(len(some)), np.eye(len(some))  # p' = S turn x
        for k in some:
            n = self.closed.normals[k]
            if n >= 0 and p[n] > 0.0:
                S[place[k], place[n]] = p[k] / p[n]
        ways = [unit[place[k]] for k in tied if k in self.one_sided]
        inside = [k for k in tied if pressed[k] and k not in edges]
        ways += [-(p @ turn[:, k]) * unit[place[k]] for k in inside]
        both = np.ix_(some, some)
        own = turn[both]
        D, (change, noise) = own.T @ self.closed.D[both] @ S @ own, self.ahead(p)
        c, rounding = own.T @ change[some], np.abs(own.T) @ noise[some]
        x[some], w[some] = rates_at(
            D, c, rounding, free, np.array(ways).reshape(-1, len(some))
        )
        return x, w

    @cached_property
    def groups(self) -> list[set[int]]:
        """Groups of rows that are coupled by D, bounds or discs."""
        return [set(rows) for rows in coupled_groups(self.problem)]

    @cached_property
    def regular(self) -> bool:
        """Whether all rows are independent by a margin."""
        return self.closed.pushes is None and is_regular(self.closed.D)

    @cached_property
    def alone(self) -> set[int]:
        """Rows that are coupled with no other row."""
        return {k for group in self.groups if len(group) == 1 for k in group}


class _Independent(Span):
    """Span of selected columns of Y turn (k, r), which are scaled to length 1.

    Parameters
    ----------
    Y : ndarray, shape (k, r)
    turn : ndarray, shape (r, r), optional
        A rotation of the columns.
    regular : bool
        Whether all columns are known to be independent.
    """

    def __init__(
        self, Y: Floats, turn: Floats | None = None, *, regular: bool = False
    ) -> None:
        super().__init__(len(Y))
        self.regular = regular
        if regular:
            return
        if turn is not None and not np.array_equal(turn, np.eye(len(turn))):
            Y = Y @ turn
        lengths = np.linalg.norm(Y, axis=0)
        self.units = (Y / np.where(lengths > 0.0, lengths, 1.0)).T
        # A column whose elements no other column has is independent of all others.
        shared = np.count_nonzero(Y, axis=1) > 1
        self.alone = (lengths > 0.0) & ~(self.units != 0.0)[:, shared].any(axis=1)

    def takes(self, row: int) -> bool:
        """Whether column `row` of Y is independent of the span; if so, it is added.

        A column that is independent of all others need not be in the basis.
        """
        if self.regular or self.alone[row]:
            return True
        return self.extend(self.units[row], DEPENDENT_ROWS)

    def adds(self, row: int) -> bool:
        """Whether column `row` of Y is independent of the span, which is unchanged."""
        return bool(np.linalg.norm(self.outside(self.units[row])) > DEPENDENT_ROWS)


def _solution(rows: _ContactRows) -> Solution:
    """Return multipliers of all rows with their accelerations.

    Whether limits hold bodies at rest is a question of forces alone. It is decided
    without the accelerations that inertias of different sizes would give.
    """
    problem = rows.problem
    if not problem.discs:
        return solve(problem)
    found = Solution(np.zeros(len(problem.c)), problem.c.copy(), found=True)
    free = (problem.normals < 0) & ~rows.given
    free[rows.one_sided] = False
    on_discs = problem.pairs >= 0
    left = list[int]()
    for group in coupled_groups(problem):
        rests = np.zeros(len(free), dtype=bool)
        rests[group] = free[group].all() and on_discs[group].any()
        rests &= rows.closed.columns.any(axis=0)
        held = _spread(rows, found, rests, balanced=False) if rests.any() else None
        left += [] if held else group
        found = held or found
    if left:
        left.sort()
        found.p[left], found.w[left], solved = solve(problem.part(left))
        found = found._replace(found=solved)
    return found


def _supported(rows: _ContactRows, solution: Solution) -> Solution:
    """Return a solution in which contacts with a force are independent, if possible.

    Contacts are released one by one as long as the accelerations of all rows stay the
    same to rounding.
    """
    problem, p = rows.problem, solution.p
    rounding = rows.rounding(p, problem.limits(p))
    while True:
        for k in _spare(rows, solution):
            away = (np.arange(len(problem.c)) == k) | (problem.normals == k)
            low, high = (np.where(away, 0.0, x) for x in (problem.low, problem.high))
            without = replace(problem, low=low, high=high)
            less = solve(without)
            full = problem.D @ less.p + problem.c
            if less.found and (np.abs(full - solution.w) <= rounding).all():
                solution, problem = less._replace(w=full), without
                break
        else:
            return solution


def _spare(rows: _ContactRows, solution: Solution) -> list[int]:
    """Return the contacts to be released first where contacts with force are dependent.

    The multipliers are changed along a null vector of the dependent contacts, in both
    directions, up to the first multiplier that reaches 0. The list is empty where the
    contacts with a force are independent.
    """
    p, span = solution.p, _Independent(rows.closed.columns)
    bear = [k for k in rows.one_sided if p[k] > 0.0]
    if all(span.takes(k) for k in bear):
        return []
    s = np.sqrt(rows.closed.D.diagonal()[bear])
    z = np.linalg.svd(span.units[bear].T)[2][-1] / s
    ends = []
    for direction in (z, -z):
        falls = direction < -np.abs(z).max() * DEPENDENT_ROWS
        parts = np.where(falls, p[bear] / np.where(falls, -direction, 1.0), np.inf)
        if np.isfinite(parts.min()):
            ends.append(bear[int(parts.argmin())])
    return sorted(ends, key=lambda k: float(p[k]))


def _eased(rows: _ContactRows, solution: Solution) -> Solution:
    """Return a solution whose static friction is as far inside its bounds as possible.

    A slip begins only where no choice of multipliers prevents it. Whether bodies at
    rest stay at rest is a question of forces alone, whatever the inertias are: where
    rows that are coupled with a disc are all at rest, it is decided first whether they
    stay. Otherwise the rows without acceleration stay at rest.
    """
    for group in coupled_groups(rows.problem):
        discs = [disc for disc in rows.problem.discs if disc[0] in group]
        if not discs:
            continue
        limits = rows.problem.limits(solution.p)
        rounding = rows.rounding(solution.p, limits, coupled=True)
        still = np.abs(solution.w) <= rounding
        for disc in discs:  # both of its rows rest, or neither
            still[disc] = np.linalg.norm(solution.w[disc]) <= rounding[disc].max()
        rests = np.zeros(len(still), dtype=bool)
        rests[group] = True
        slides = bool((rests & rows.given).any())
        rests &= ~rows.given & rows.closed.columns.any(axis=0)
        moves = bool((rests & ~still).any())
        if not moves and rows.part(solution.p, rests) < INSIDE:
            continue
        found = _spread(rows, solution, rests, balanced=False) if not slides else None
        if found is None and (slides or moves):
            found = _spread(rows, solution, rests & still, balanced=True)
        solution = found or solution
    return solution


def _spread(
    rows: _ContactRows, solution: Solution, rests: Flags, *, balanced: bool
) -> Solution | None:
    """Return a solution in which some rows rest, with the least parts of their bounds.

    None where no multipliers hold these rows, or better ones are not found.

    Parameters
    ----------
    rows : _ContactRows
    solution : Solution
        The multipliers of all other rows are kept.
    rests : ndarray of bool, shape (r,)
        The rows that rest.
    balanced : bool
        Whether the accelerations of these rows are 0 in `solution`.
    """
    closed, p, kinds = rows.closed, solution.p.copy(), rows.closed.kinds
    sided = rests & np.array([kind.one_sided for kind in kinds])
    timed = rests & np.array([kind is Kind.TIMED for kind in kinds])
    pushes = sided & (p > 0.0)
    rubs = rests & (rows.problem.limits(p) > 0.0)
    some = np.flatnonzero(rubs | pushes | timed)
    if not len(some):
        return None
    lengths = np.linalg.norm(closed.columns[:, some], axis=0)
    K = closed.columns[:, some] / lengths
    if not balanced:
        for _ in range(2):
            p[some] -= rows.unbalanced(p, rests, K) / lengths
        if not (p[pushes] > 0.0).all():
            return None
    discs, radii = np.zeros((2, len(p), len(p)))
    for k in np.flatnonzero(rubs).tolist():
        first = rows.disc(k)[0]
        discs[first, k], radii[first, closed.normals[k]] = 1.0, closed.normals[k] >= 0
    own = discs.any(axis=1)
    discs, radii = discs[own][:, some], radii[own][:, some]
    limits = rows.problem.limits(p)
    bounds = np.where(rubs, limits, np.where(pushes, p, 1.0))[some]
    most = (limits[some] * lengths).max()
    bounds = np.where(timed[some], most / lengths, bounds)
    free = null_space(K) / (lengths * bounds)[:, None]
    eased = p.copy()
    if free.size and (balanced or rows.part(p, rests) > INSIDE):
        free = np.linalg.qr(free)[0]
        parts = least_parts(p[some] / bounds, free, discs, radii, pushes[some])
        eased[some] = parts * bounds
    part = rows.part(eased, rests)
    most = min(1.0, rows.part(p, rests)) if balanced else 1.0 + SETTLED_IMPULSE
    if not part < most:
        return None
    return solution._replace(p=eased, w=np.where(rests, 0.0, solution.w))


def _expressed(
    rows: _ContactRows, modes: list[Mode], directions: Floats
) -> tuple[Floats, Floats]:
    """Return E (r, r) and p0 (r,) of p = E x + p0 for the multipliers p of all rows.

    x : the multipliers of the held rows. The other multipliers are at their bounds, in
    the given directions (r,).
    """
    r = len(modes)
    E, p0 = np.zeros((r, r)), np.zeros(r)
    for k, mode in enumerate(modes):
        n, part = rows.closed.normals[k], directions[k] * rows.sizes[k]
        if mode is Mode.HELD:
            E[k, k] = 1.0
        elif mode is not Mode.OFF and n < 0:
            p0[k] = part
        elif mode is not Mode.OFF and modes[n] is Mode.HELD:
            E[k, n] = part
    return E, p0


def _decided(rows: _ContactRows, modes: list[Mode], directions: Floats) -> RowModes:
    """Solve for the multipliers of the held rows, and return all modes."""
    closed, c, sizes = rows.closed, rows.problem.c, rows.sizes
    # Returned directions are parts of the bounds in force, not of the problem's.
    redundant = np.array([mode is Mode.REDUNDANT for mode in modes], dtype=bool)
    known = np.where(redundant, closed.statics, closed.bounds)
    other = (known > 0.0) & (known != sizes)
    parts = np.where(other, sizes, 1.0) / np.where(other, known, 1.0)
    E, p0 = _expressed(rows, modes, directions)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    if not held:
        return RowModes(tuple(modes), directions * parts, p0, paradox=False)
    slides = Mode.SLIDING in modes
    h, own = c + closed.D @ p0, closed.D.diagonal()
    p, jams = p0.copy(), slides and _jams(rows, E, held)
    alone = [k for k in held if k in rows.alone]
    p[alone] = -h[alone] / own[alone]
    for group in rows.groups:
        some = sorted(group.intersection(held)) if len(group) > 1 else []
        if some:
            x, ratio = _solved_together(rows, E, h, some)
            p += E[:, some] @ x
            jams |= slides and closed.pushes is None and ratio <= ACCELERATION_ROUNDOFF
    least = -ACCELERATION_ROUNDOFF * np.abs(p).max()
    for k in rows.one_sided:
        if least < p[k] < 0.0:
            p[k] = 0.0
    is_open = (
        slides and Mode.REDUNDANT in modes and _rubs_openly(rows, modes, directions)
    )
    return RowModes(tuple(modes), directions * parts, p, jams, is_open)


def _solved_together(
    rows: _ContactRows, E: Floats, h: Floats, some: list[int]
) -> tuple[Floats, float]:
    """Solve for the multipliers (k,) of k held rows that are coupled.

    The matrix B = Y_H^T Y E_H is factored as R^T (Q^T Y E_H), with D = Y^T Y and
    Y_H = Q R, so that nearly dependent rows lose no more digits than their condition
    number requires.

    Parameters
    ----------
    rows : _ContactRows
    E : ndarray, shape (r, r)
        As returned by `_expressed`.
    h : ndarray, shape (r,)
        Accelerations of all rows with the multipliers p0.
    some : list of int, length k
        Indices of the held rows.

    Returns
    -------
    x : ndarray, shape (k,)
    ratio : float
        The determinant of B relative to that without friction, det(R)^2.
    """
    closed = rows.closed
    rubs = np.count_nonzero(E[:, some]) > len(some)
    if closed.pushes is None and not rubs:
        found = solved_regular(closed.D[np.ix_(some, some)], -h[some])
        if found is not None:
            return found, 1.0
    Q, R = np.linalg.qr(closed.factor[:, some])
    forces = Q.T @ (closed.columns @ E[:, some])
    B, x = closed.D[some] @ E[:, some], np.zeros(len(some))
    for _ in range(2):
        right = np.linalg.solve(R.T, B @ x + h[some])
        x -= least_squares(forces, right, DEPENDENT_SQUARE)
    sign, size = np.linalg.slogdet(forces)
    other, plain = np.linalg.slogdet(R)
    return x, float(sign * other * np.exp(size - plain))


# Part of their reserves that redundant rows take over at most, so that the other rows
# do not reach their bounds at the last moment, where forces have no clear direction;
# number of halvings of these loads.
TAKEN = 0.9
TAKEN_OVER = 5


def _farther(rows: _ContactRows, decided: RowModes, directions: Floats) -> RowModes:
    """Return modes in which redundant limited rows have multipliers at their bounds.

    Their loads are constant in a mode, so that those of the rows that hold change. The
    less these bear at first, the later they reach their bounds: where all loads grow
    alike, when no multipliers suffice any more.

    Parameters
    ----------
    rows : _ContactRows
    decided : RowModes
        The modes with loads in the least parts of the bounds.
    directions : ndarray, shape (r,)
        As given to `_decided`.
    """
    own = rows.closed.bounded & (np.array(rows.closed.normals) < 0)
    spare, held = (
        [k for k, mode in enumerate(decided.mode) if mode is wanted and own[k]]
        for wanted in (Mode.REDUNDANT, Mode.HELD)
    )
    most = max((np.linalg.norm(directions[rows.disc(k)]) for k in spare), default=0.0)
    if not (0.0 < most < 1.0 - HALF_OF_DIGITS and held):
        return decided
    more = TAKEN * (1.0 / most - 1.0)
    for _ in range(TAKEN_OVER):
        larger = directions.copy()
        larger[spare] *= 1.0 + more
        found = _decided(rows, list(decided.mode), larger)
        limits = most * rows.problem.limits(found.multipliers)
        sizes = [np.linalg.norm(found.multipliers[rows.disc(k)]) for k in held]
        if all(x < limits[k] for x, k in zip(sizes, held, strict=True)):
            return found
        more *= 0.5
    return decided


def _rubs_openly(rows: _ContactRows, modes: list[Mode], directions: Floats) -> bool:
    """Whether the motion is not unique because non-unique multipliers bound friction.

    This is so where a combination of multipliers of held and redundant rows, with their
    friction, accelerates none of these rows and is not 0 as a force.
    """
    bears = ~rows.closed.bounded | (rows.sizes > 0.0)
    both: list[Mode] = [
        Mode.HELD if mode is Mode.REDUNDANT and bears[k] else mode
        for k, mode in enumerate(modes)
    ]
    rest = [k for k, mode in enumerate(both) if mode is Mode.HELD]
    E, _ = _expressed(rows, both, directions)
    Y = rows.closed.factor
    lengths = np.linalg.norm(Y[:, rest], axis=0)
    units = np.where(lengths > 0.0, lengths, 1.0)
    F = (rows.closed.columns @ E)[:, rest] / units
    _, s, V = np.linalg.svd(Y[:, rest].T @ F / units[:, None])
    free = V[s <= DEPENDENT_SQUARE * s[0]]
    return bool((np.linalg.norm(F @ free.T, axis=0) > SOLVED_LAWS).any())


def _jams(rows: _ContactRows, E: Floats, held: list[int]) -> bool:
    """Whether a held contact with sliding friction has no positive effective mass.

    A force on such a contact does not separate it. Each contact is tested alone; the
    rows that are coupled are tested by the sign of their determinant with friction.
    """
    D = rows.closed.D
    free = [k for k, kind in enumerate(rows.closed.kinds) if kind is Kind.TIMED]
    masses = np.einsum("ij,ji->i", D, E)
    if free:
        by_free, G = D @ E[:, free], D[free] @ E
        X = np.linalg.lstsq(G[:, free], G, rcond=None)[0]
        masses = masses - np.einsum("ij,ji->i", by_free, X)
    signed = [k for k in held if k in rows.one_sided]
    least = ACCELERATION_ROUNDOFF * D.diagonal()[signed]
    return bool((masses[signed] <= least).any())
