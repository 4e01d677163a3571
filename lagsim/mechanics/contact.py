"""Unilateral constraints in numbers: rows that hold, their multipliers and impulses.

Linear algebra on the Delassus matrix of the rows that could act, beside the equalities
that hold: no graph, no state.

Impacts obey Newton's law of restitution and Coulomb's of friction: the rate of each
contact after the impact is at least -e times the one before, and is that where there is
an impulse. By Poisson's law one impact without restitution ends the approach; another
adds e times its impulse, or more where a contact would close. All contacts that touch
share one impact, at one time: where they act on each other, another order of impacts
would end in other rates. Where a series of impacts is taken as one, a contact may have
to pull in it: the series ends with it at rest, and what held it down meanwhile (its
weight) is part of no impact. Its friction is in proportion, of either sign, so that
what slides one way all the time loses what it does by the impulses of the series and of
the weight.

From accelerations at rates that are known follows which rows hold, slide or let go.
What slides is driven by a force of known direction. What rests holds if a multiplier
within its bound does it, and otherwise begins to slide against it. A box on four legs
can lose any leg on whose side its weight is not. Where discs leave no corner to pivot
to, legs are taken away until those that are left are independent, as long as friction
allows it. Of friction that rows share, discs have the least parts of their bounds: a
disc slips where no sharing holds it, along a way that the other rows leave. A switch's
surface is a row as well (`Closed.with_shares`).

Source: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts (1996).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.algebra import Metric, Span, least_squares, null_space, scaled
from lagsim.mechanics.complementarity import (
    RATES_ROUNDOFF,
    Problem,
    least_parts,
    rates_at,
    solve,
)
from lagsim.mechanics.constraints import Kind
from lagsim.tolerances import (
    ACCELERATION_ROUNDOFF,
    DEPENDENT_ROWS,
    DEPENDENT_SQUARE,
    SETTLED_IMPULSE,
    SOLUTION_ROUNDOFF,
    SOLVED_LAWS,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from lagsim.language.arrays import Flags, Floats, Ints
    from lagsim.mechanics.complementarity import Solution
    from lagsim.mechanics.constraints import Law


class Mode(IntEnum):
    """Mode of a row."""

    OFF = 0  # no multiplier
    HELD = 1  # an equality with its multiplier
    SLIDING = 2  # not held: the multiplier has the size of its bound
    REDUNDANT = 3  # it holds because others do


@dataclass(frozen=True)
class Closed:
    """Contacts that touch with their slips, and other rows in force: r of them.

    Attributes
    ----------
    D : ndarray, shape (r, r)
        The Delassus matrix: the accelerations of the rows (or rates, of impulses) that
        multipliers of one give. Zero in the diagonal: a row on which nothing acts.
    kinds : tuple of Kind
    normals : tuple of int
        Of a slip: the row of its contact; else -1.
    pairs : tuple of int
        Of one of two slips: the row of the other; else -1.
    bounds, statics : ndarray, shape (r,)
        The friction coefficient while it slides and while it sticks, or the limit.
    restitutions : ndarray, shape (r,)
    poisson : tuple of bool, optional
        Of contacts: restitution is of impulses, not of rates.
    factor : ndarray, shape (k, r)
        D = factor^T factor, from which rows at a small angle are still told apart.
    pushes : ndarray, shape (k, r), optional
        Where shares of switching surfaces are rows, too: D = factor^T pushes.
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
        """What multipliers of one do in the space of the factor (k, r)."""
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
        """Rows of some laws, by their numbers; all else is of these, in this order."""
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
        """Add rows with bounds (s,) for shares of surfaces; D is that of all rows.

        A share is in [0, 1]; 1/2 less it is limited as a force is, to 1/2. The jump of
        forces need not be along the row, so that D is not symmetric.
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
        """Which multipliers are bounded in both directions (r,)."""
        return np.array([kind.bounded for kind in self.kinds], dtype=bool)


def _problem(
    closed: Closed, c: Floats, sizes: Floats, directions: Floats, *, given: Flags
) -> Problem:
    """Problem of rows whose bounded multipliers have sizes (r,), or parts of them.

    Bounds of friction are in parts of the multiplier of its contact; of what is given
    (r,), in which of the two directions (r,).
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
    return Problem(closed.D, c, low, high, normals, pairs)


# --- the Delassus matrix --------------------------------------------------------------


class Delassus(NamedTuple):
    """The answer of rows to their multipliers.

    Attributes
    ----------
    D : ndarray, shape (r, r)
        rows K rows^T, where K f is the acceleration that forces f give.
    response : ndarray, shape (n, r)
        K rows^T.
    factor : ndarray, shape (k, r)
        D = factor^T factor, for the k free directions.
    """

    D: Floats
    response: Floats
    factor: Floats


def delassus(M: Floats, A: Floats, rows: Floats) -> Delassus:
    """Delassus matrix of rows (r, n) beside equalities A (e, n).

    M (n, n) has to be positive in all directions that A lets through; coordinates
    without mass, and equalities that others imply, do no harm. A row on which nothing
    can act has zeros.
    """
    diagonal = M.diagonal()
    if not len(A) and np.count_nonzero(M) == len(M) and diagonal.min() > 0.0:
        factor = (rows / np.sqrt(diagonal)).T
        return Delassus(factor.T @ factor, (rows / diagonal).T, factor)
    metric = Metric(M, A)
    factor = metric.free.T @ rows.T
    _, lengths = scaled(rows, metric.L)
    factor[:, np.linalg.norm(factor, axis=0) <= DEPENDENT_ROWS * lengths] = 0.0
    return Delassus(factor.T @ factor, metric.free @ factor, factor)


# --- impacts --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Impact:
    """Result of an impact: impulses, and its kind.

    Attributes
    ----------
    impulses : ndarray, shape (r,)
    after : ndarray, shape (r,)
        The rates.
    open : bool
        Another order of the impacts would end elsewhere: a choice of this law.
    energy : float
        The change of the kinetic energy, seen from what is struck.
    found : bool
        False where the laws contradict each other (a body that is crushed).
    """

    impulses: Floats
    after: Floats
    open: bool
    energy: float
    found: bool = True


def impact(closed: Closed, rates: Floats, roundoff: Floats) -> Impact:
    """Impulses at rates (r,); what is smaller than roundoff (r,) counts as 0.

    Newton's targets of contacts that are locked into each other may contradict; such
    an impact is inelastic. A contact that is `TIMED` is stopped, whatever it takes.
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
    """Impact of one contact by itself."""
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
    """Which slips rest (r,) and have another friction than while they slide."""
    pairs = np.array(closed.pairs)
    still = (rates == 0.0) & ((pairs < 0) | (rates[pairs] == 0.0))
    slips = np.array([kind is Kind.SLIP for kind in closed.kinds])
    return np.asarray(slips & still & (closed.statics != closed.bounds))


def _impulses(
    closed: Closed, c: Floats, rests: Flags, given: Floats | None = None
) -> Solution:
    """Impulses for rates c (r,) that are to become 0; what is limited gives none.

    Friction is bounded by them, and by those of contacts that are `given` (r,) before;
    its coefficient is the static one where a slip rests before the impact (r,).

    The slips of stopped contacts slide on, or are held where that would turn them back.
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
    """Whether the order of impacts counts.

    It does where one changes the rate of another that is struck as well. Inelastic ones
    without friction that push each other's rates down end in one state all the same.
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
class Modes:
    """Modes of all rows, r of them.

    Attributes
    ----------
    mode : tuple of Mode
        Held rows are independent of each other.
    direction : ndarray, shape (r,)
        Of a sliding row: its multiplier over its bound; with two slips, of each
        its part. Of a redundant row that bears a share: the part, at most 1, of its
        bound at rest. Else 0.
    multipliers : ndarray, shape (r,)
    paradox : bool
        Painlevé's: no solution, or a sliding contact that presses with an effective
        mass that is not positive. What may part instead is let go.
    open : bool
        Friction slides by a multiplier that is not unique, and so is not the motion.
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
) -> Modes:
    """Decide what the rows do.

    Parameters
    ----------
    accelerations : ndarray, shape (r,)
        Of the rows, with no multiplier of theirs.
    rates : ndarray, shape (r,)
        Of slips and limited rows; those larger than slip_roundoff (r,) slide.
    roundoff : ndarray, shape (r,)
        Accelerations that are smaller count as 0.
    ahead : callable, optional
        How fast accelerations with multipliers (r,) at fixed parts of their bounds
        change, and the rounding of that, (r,) each. It decides about rows on an edge, a
        contact with neither force nor acceleration or a row that rests at its bound:
        else they hold.
    left : ndarray of int, shape (r,), optional
        How often what held until now has reached the edge of what it bears at this
        time: there it does not go on where no rate decides.
    """
    if not closed.kinds:
        return Modes((), accelerations, accelerations, paradox=False)
    left = np.zeros(len(rates), dtype=int) if left is None else left
    begun = np.zeros(len(rates), dtype=bool)
    given, directions = _sliding(closed, rates, slip_noise)
    while True:
        sizes = np.where(given | begun, closed.bounds, closed.statics)
        problem = _problem(closed, accelerations, sizes, directions, given=given)
        solution = solve(problem)
        if not solution.found:
            nothing, off = np.zeros(len(rates)), (Mode.OFF,) * len(rates)
            return Modes(off, nothing, nothing, paradox=True)
        rows = _Rows(closed, problem, sizes, given, directions, roundoff, ahead, left)
        if problem.discs:
            solution = _eased(rows, _supported(rows, solution))
        found, directions_found = rows.edges(solution)
        begins = np.array([mode is Mode.SLIDING for mode in found], dtype=bool)
        begins &= ~given & (closed.bounds != sizes)
        if begins.any():
            begun |= begins
            continue
        return _decided(rows, found, directions_found)


def _sliding(closed: Closed, rates: Floats, slip_noise: Floats) -> tuple[Flags, Floats]:
    """Which rows slide already (r,), and the directions of their friction (r,)."""
    if not closed.bounded.any():
        return closed.bounded, np.zeros(len(rates))
    pairs = np.array(closed.pairs)
    slips = np.where(pairs >= 0, np.hypot(rates, rates[pairs]), np.abs(rates))
    noise = np.where(pairs >= 0, np.maximum(slip_noise, slip_noise[pairs]), slip_noise)
    given: Flags = closed.bounded & (slips > noise)
    return given, np.where(given, -rates / np.where(given, slips, 1.0), 0.0)


# Where a row reaches its edge again at one time, forces beside discs are at their
# bounds within this part.
EDGE = 1e-8
# At the edge of what holds, the force of a disc is known to the root of rounding: it is
# along a way within this angle.
ALONG = 1e-3


@dataclass(frozen=True)
class _Rows:
    """Rows of a problem, whose solution says which are held and which on an edge.

    Those that are `given` slide in `directions`; `sizes` are their bounds.
    """

    closed: Closed
    problem: Problem
    sizes: Floats
    given: Flags
    directions: Floats
    roundoff: Floats
    ahead: Callable[[Floats], tuple[Floats, Floats]] | None
    left: Ints

    @cached_property
    def one_sided(self) -> list[int]:
        """Contacts and freewheels."""
        return [k for k, kind in enumerate(self.closed.kinds) if kind.one_sided]

    def rounding(self, p: Floats, limits: Floats) -> Floats:
        """Bounds of the rounding of the accelerations of rows (r,), at multipliers p.

        Against all that could push: what rests without a force has its friction's
        scale.
        """
        problem = self.problem
        pushes = np.maximum(np.abs(p), limits)
        terms = np.abs(problem.D) @ pushes + np.abs(problem.c)
        parts = np.where(problem.pairs >= 0, SETTLED_IMPULSE, ACCELERATION_ROUNDOFF)
        return np.asarray(np.maximum(self.roundoff, parts * terms))

    def edges(self, solution: Solution) -> tuple[list[Mode], Floats]:
        """Modes and directions where ties are decided, and held rows independent.

        What is strictly between its bounds is held, what has an acceleration is at one
        of them; the rest is tied.
        """
        p, own = solution.p, self.closed.D.diagonal()
        limits = self.problem.limits(p)
        rounding = self.rounding(p, limits)
        small = rounding / np.where(own > 0.0, own, 1.0)
        if self.problem.discs:  # their forces are known to that, and so are others
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
        for k, kind in enumerate(self.closed.kinds):
            if not kind.bounded:
                continue
            n = self.closed.normals[k]
            if n >= 0 and n not in touches:
                directions[k] = 0.0
                continue
            modes[k], way = self._bounded(k, solution, rounding, limits[k], small[k])
            if modes[k] is Mode.SLIDING:
                directions[k] = way
            else:
                (held if modes[k] is Mode.HELD else tied).append(k)
                modes[k] = Mode.OFF
        self._hold(p, held, tied, modes, directions, limits, limits > small)
        return modes, directions

    def _bounded(
        self, k: int, solution: Solution, rounding: Floats, bound: float, small: float
    ) -> tuple[Mode, float]:
        """Mode of a bounded row, and its direction; one that is tied is off."""
        if self.given[k]:
            return Mode.SLIDING, float(self.directions[k])
        rows = self.disc(k)
        slip = np.linalg.norm(solution.w[rows])
        force = np.linalg.norm(solution.p[rows])
        inside = not force >= bound - small
        if slip > rounding[rows].max():
            at_bound = not inside and bound > small
            way = solution.p[k] / force if at_bound else -solution.w[k] / slip
            return Mode.SLIDING, float(way)
        return (Mode.HELD if inside else Mode.OFF), 0.0

    def disc(self, k: int) -> list[int]:
        """Row k, or both of its disc."""
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
        """Set modes of rows that hold, each with the part of its bound that it bears.

        What others hold is redundant, and cannot part; slips of contacts without force
        are off.
        """
        closed, span = self.closed, _Independent(self.closed.columns)
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
        """Axes (r, r) of rows: of discs that are tied one across and one along p."""
        turn = np.eye(len(p))
        for i, k in self.problem.discs:
            if k in tied and pressed[k]:
                c, s = p[[i, k]] / np.linalg.norm(p[[i, k]])
                turn[np.ix_([i, k], [i, k])] = [[s, c], [-c, s]]
        return turn

    def _movable(
        self, firm: list[int], rests: list[int], apart: list[int], turn: Floats
    ) -> list[int]:
        """Rows of those apart that can move: a disc only along its force.

        Not a bounded row that firm ones hold, within their bounds or on the way there;
        nor a disc that rows which rest hold along its force, and those on its edge
        across it.
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
        """Rates (r,) of multipliers beside their bounds, and of accelerations, at ties.

        Along `turn`. They solve a complementarity problem of their own: what is held
        has any rate of its multiplier, what is tied one that leads inside, or along the
        edge of its disc; what slides, or has no rate, keeps its part of its bound.
        """
        r = len(p)
        if self.ahead is None or not tied:
            return np.zeros(r), np.zeros(r)
        span = _Independent(self.closed.columns @ turn)
        edges = [i for i, k in self.problem.discs if k in tied and pressed[k]]
        free = [k for k in (*held, *edges) if span.takes(k)]
        unit, S = np.eye(r), np.eye(r)  # p' = S turn x
        for k, n in enumerate(self.closed.normals):
            if n >= 0 and p[n] > 0.0:
                S[k, n] = p[k] / p[n]
        ways = [unit[k] for k in tied if k in self.one_sided]
        inside = [k for k in tied if pressed[k] and k not in edges]
        ways += [-(p @ turn[:, k]) * unit[k] for k in inside]
        D, (change, noise) = turn.T @ self.closed.D @ S @ turn, self.ahead(p)
        c, rounding = turn.T @ change, np.abs(turn.T) @ noise
        return rates_at(D, c, rounding, free, np.array(ways).reshape(-1, r))


class _Independent(Span):
    """The span of the rows taken so far."""

    def __init__(self, Y: Floats) -> None:
        super().__init__(len(Y))
        lengths = np.linalg.norm(Y, axis=0)
        self.units = (Y / np.where(lengths > 0.0, lengths, 1.0)).T

    def takes(self, row: int) -> bool:
        """Take a row unless it is spanned already."""
        return self.extend(self.units[row], DEPENDENT_ROWS)

    def adds(self, row: int) -> bool:
        """Whether a row is not spanned."""
        return bool(np.linalg.norm(self.outside(self.units[row])) > DEPENDENT_ROWS)


def _supported(rows: _Rows, solution: Solution) -> Solution:
    """Solution in which the contacts that bear are independent, if there is one.

    All rows keep their accelerations within rounding.
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


def _spare(rows: _Rows, solution: Solution) -> list[int]:
    """Contacts that end first where forces change along a dependence."""
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


def _eased(rows: _Rows, solution: Solution) -> Solution:
    """Solution in which friction that rests is as far inside of its bounds as can be.

    Where several rows hold by multipliers that are not unique, and some friction is at
    its bound: a slip is possible only where all of it must be.
    """
    p, closed, kinds = solution.p, rows.closed, rows.closed.kinds
    limits = rows.problem.limits(p)
    rests = (np.abs(solution.w) <= rows.rounding(p, limits)) & ~rows.given
    rests &= closed.columns.any(axis=0)
    rubs, pushes = rests & (limits > 0.0), rests & (p > 0.0)
    pushes &= np.array([kind.one_sided for kind in kinds])
    timed = rests & np.array([kind is Kind.TIMED for kind in kinds])
    some = np.flatnonzero(rubs | pushes | timed)
    discs, radii = np.zeros((2, len(p), len(p)))
    for k in np.flatnonzero(rubs).tolist():
        first = rows.disc(k)[0]
        discs[first, k], radii[first, closed.normals[k]] = 1.0, closed.normals[k] >= 0
    own = discs.any(axis=1)
    discs, radii = discs[own][:, some], radii[own][:, some]

    def largest(p: Floats) -> float:
        parts = p / np.where(rubs, rows.problem.limits(p), 1.0)
        return float((discs @ parts[some] ** 2).max(initial=0.0))

    if largest(p) < 1.0 - RATES_ROUNDOFF:
        return solution
    lengths = np.linalg.norm(closed.columns, axis=0)
    bounds = np.where(rubs, limits, np.where(pushes, p, 1.0))
    bounds[timed] = (limits * lengths).max() / lengths[timed]
    bounds, lengths = bounds[some], lengths[some]
    free = null_space(closed.columns[:, some] / lengths) / (lengths * bounds)[:, None]
    if not free.size:
        return solution
    eased, free = p.copy(), np.linalg.qr(free)[0]
    parts = least_parts(p[some] / bounds, free, discs, radii, pushes[some])
    eased[some] = parts * bounds
    better = largest(eased) < min(1.0, largest(p))
    return solution._replace(p=eased) if better else solution


def _expressed(
    rows: _Rows, modes: list[Mode], directions: Floats
) -> tuple[Floats, Floats]:
    """E (r, r), p0 (r,): p = E x + p0, where x are multipliers of held rows."""
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


def _decided(rows: _Rows, modes: list[Mode], directions: Floats) -> Modes:
    """Solve once more, for the rows that hold by themselves.

    With the factor Y of D = Y^T Y nearly dependent rows cost only the digits they must:
    B = Y_H^T Y E_H is solved with as R^T (Q^T Y E_H), where Y_H = Q R.
    """
    closed, c, sizes = rows.closed, rows.problem.c, rows.sizes
    # Directions are parts of the bounds in force, here of those of the problem.
    redundant = np.array([mode is Mode.REDUNDANT for mode in modes], dtype=bool)
    known = np.where(redundant, closed.statics, closed.bounds)
    other = (known > 0.0) & (known != sizes)
    parts = np.where(other, sizes, 1.0) / np.where(other, known, 1.0)
    E, p0 = _expressed(rows, modes, directions)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    if not held:
        return Modes(tuple(modes), directions * parts, p0, paradox=False)
    D, Y = closed.D[held], closed.factor
    B, h = (D @ E)[:, held], c[held] + D @ p0
    Q, R = np.linalg.qr(Y[:, held])
    forces = Q.T @ (closed.columns @ E)[:, held]
    x = np.zeros(len(held))
    for _ in range(2):
        right = np.linalg.solve(R.T, B @ x + h)
        x -= least_squares(forces, right, DEPENDENT_SQUARE)
    p = E[:, held] @ x + p0
    least = -ACCELERATION_ROUNDOFF * np.abs(p).max()
    for k in rows.one_sided:
        if least < p[k] < 0.0:
            p[k] = 0.0
    slides = Mode.SLIDING in modes
    jams = slides and _jams(rows, E, held, R, forces)
    is_open = (
        slides and Mode.REDUNDANT in modes and _rubs_openly(rows, modes, directions)
    )
    return Modes(tuple(modes), directions * parts, p, jams, is_open)


def _rubs_openly(rows: _Rows, modes: list[Mode], directions: Floats) -> bool:
    """Whether friction that slides moves something by multipliers of dependent rows.

    Some of their multipliers, with their friction, accelerate no row that holds.
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


def _jams(rows: _Rows, E: Floats, held: list[int], R: Floats, forces: Floats) -> bool:
    """Whether a contact that holds and slides has no positive effective mass.

    Pressing on it then does not push it away: each alone, and those that hold together,
    against their mass without friction, det(R)^2. What need not press may part; that is
    no paradox.
    """
    D = rows.closed.D
    free = [k for k, kind in enumerate(rows.closed.kinds) if kind is Kind.TIMED]
    G = D @ E
    masses = G.diagonal()
    if free:
        X = np.linalg.lstsq(G[np.ix_(free, free)], G[free], rcond=None)[0]
        masses = masses - np.einsum("ij,ji->i", G[:, free], X)
    signed = [k for k in held if k in rows.one_sided]
    if (masses[signed] <= ACCELERATION_ROUNDOFF * D.diagonal()[signed]).any():
        return True
    if rows.closed.pushes is not None:  # jumps of forces need not be along their rows
        return False
    sign, size = np.linalg.slogdet(forces)
    other, plain = np.linalg.slogdet(R)
    return bool(sign * other * np.exp(size - plain) <= ACCELERATION_ROUNDOFF)
