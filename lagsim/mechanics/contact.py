"""Unilateral constraints in numbers: rows that hold, their multipliers and impulses.

Linear algebra on the Delassus matrix of the rows that could act, beside the equalities
that hold: no graph, no state.

Impacts obey Newton's law of restitution and Coulomb's of friction: the rate of each
contact after the impact is at least -e times the one before, and is that where there is
an impulse. All contacts that touch share one impact, at one time: where they act on
each other, another order of impacts would end in other rates. Where a series of impacts
is taken as one, a contact may have to pull in it: the series ends with it at rest, and
what held it down meanwhile (its weight) is part of no impact. Its friction is in
proportion, of either sign, so that what slides one way all the time loses what it does
by the impulses of the series and of the weight.

From accelerations at rates that are known follows which rows hold, slide or let go.
What slides is driven by a force of known direction. What rests holds if a multiplier
within its bound does it, and otherwise begins to slide against it. A box on four legs
can lose any leg on whose side its weight is not. Where discs leave no corner to pivot
to, legs are taken away until those that are left are independent, as long as friction
allows it.

Source: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts (1996).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.algebra import Metric, Span, scaled
from lagsim.mechanics.complementarity import (
    Mode,
    Problem,
    Role,
    Solution,
    expressed,
    polished,
    solve,
)
from lagsim.mechanics.constraints import Kind
from lagsim.tolerances import (
    ACCELERATION_ROUNDOFF,
    DEPENDENT_DIRECTIONS,
    DEPENDENT_ROWS,
    SETTLED_IMPULSE,
    SOLUTION_ROUNDOFF,
    SOLVED_LAWS,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats, Ints


__all__ = [
    "Closed", "Delassus", "Impact", "Mode", "Modes", "delassus", "impact", "modes",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
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
    factor : ndarray, shape (k, r), optional
        D = factor^T factor, from which rows at a small angle are still told apart.
    """

    D: Floats
    kinds: tuple[Kind, ...]
    normals: tuple[int, ...]
    pairs: tuple[int, ...]
    bounds: Floats
    statics: Floats
    restitutions: Floats
    factor: Floats | None = None


@lru_cache(maxsize=64)
def _indices(numbers: tuple[int, ...]) -> Ints:
    """Array of row numbers, or of roles; it is not to be written to."""
    return np.array(numbers, dtype=np.intp)


_ROLES = {
    Kind.CONTACT: Role.SIGNED,
    Kind.FREEWHEEL: Role.SIGNED,
    Kind.SLIP: Role.BOXED,
    Kind.LIMITED: Role.BOXED,
    Kind.TIMED: Role.FREE,
}
# What is bounded gives no impulse.
_ROLES_AT_IMPACTS = _ROLES | {Kind.LIMITED: Role.ABSENT}

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
    if len(rates) == 1 and _ROLES_AT_IMPACTS[closed.kinds[0]] is Role.SIGNED:
        return _of_one(closed, float(rates[0]), float(roundoff[0]))
    before = np.where(np.abs(rates) <= roundoff, 0.0, rates)
    terms = zip(
        closed.kinds, closed.restitutions.tolist(), before.tolist(), strict=True
    )
    target = np.array(
        [-e * v if kind is Kind.CONTACT and v < 0.0 else 0.0 for kind, e, v in terms]
    )
    solution = _impulses(closed, before - target)
    locked = not solution.found and bool(target.any())
    if locked:
        target = np.zeros(len(before))
        solution = _impulses(closed, before)
    p, after = solution.p, solution.w + target
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


def _impulses(closed: Closed, c: Floats) -> Solution:
    """Impulses for rates c (r,) that are to become 0.

    The slips of stopped contacts slide on, or are held where that would turn them back.
    """
    roles = _indices(tuple([_ROLES_AT_IMPACTS[kind] for kind in closed.kinds])).copy()
    directions = np.zeros(len(c))
    sliding: list[list[int]] = []
    for k, (n, pair) in enumerate(zip(closed.normals, closed.pairs, strict=True)):
        if n < 0 or closed.kinds[n] is not Kind.TIMED or roles[k] != Role.BOXED:
            continue
        if pair < k:
            sliding.append([pair, k] if pair >= 0 else [k])
    for rows in sliding:
        speed = float(np.linalg.norm(c[rows]))
        roles[rows] = Role.GIVEN if speed > 0.0 else Role.FREE
        directions[rows] = -c[rows] / speed if speed > 0.0 else 0.0
    normals, pairs = _indices(closed.normals), _indices(closed.pairs)
    sizes = np.where(normals >= 0, closed.bounds, 0.0)
    while True:
        solution = solve(Problem(closed.D, c, roles, sizes, directions, normals, pairs))
        turned = [rows for rows in sliding if solution.w[rows] @ directions[rows] > 0.0]
        if not turned:
            return solution
        for rows in turned:
            roles[rows], directions[rows] = Role.FREE, 0.0


def _is_open(closed: Closed, before: Floats, p: Floats) -> bool:
    """Whether the order of impacts counts.

    It does where one changes the rate of another that is struck as well. Inelastic ones
    without friction that push each other's rates down end in one state all the same.
    """
    groups = {
        k: [k, *(i for i, n in enumerate(closed.normals) if n == k and p[i])]
        for k, kind in enumerate(closed.kinds)
        if kind is Kind.CONTACT and (p[k] > 0.0 or before[k] < 0.0)
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
    """

    mode: tuple[Mode, ...]
    direction: Floats
    multipliers: Floats
    paradox: bool


def modes(
    closed: Closed,
    accelerations: Floats,
    rates: Floats,
    roundoff: Floats,
    slip_noise: Floats,
    tie_break: Floats | None = None,
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
    tie_break : ndarray, shape (r,), optional
        What decides about rows on an edge, which would hold: a contact with neither
        force nor acceleration is let go where this is > 0, and a row that rests at its
        bound begins to slide where this is not 0.
    """
    problem = _at_rates(closed, accelerations, rates, slip_noise)
    ties = np.zeros(len(roundoff)) if tie_break is None else tie_break
    while (solution := solve(problem)).found:
        rounding = _known(problem, solution, roundoff)
        if (
            solution.apart
            and _is_plain(problem, solution, rounding)
            and not _begins(closed, problem, solution.modes).any()
        ):
            found = tuple(solution.modes)
            return Modes(found, solution.directions, solution.p, paradox=False)
        what, directions = _on_edges(closed, problem, solution, rounding, ties)
        begin = _begins(closed, problem, what)
        if begin.any():
            sizes = np.where(begin, closed.bounds, problem.sizes)
            problem = replace(problem, sizes=sizes)
            continue
        if (problem.pairs[problem.roles == Role.BOXED] >= 0).any():
            solution = _supported(closed, problem, solution, rounding)
            rounding = _known(problem, solution, roundoff)
            what, directions = _on_edges(closed, problem, solution, rounding, ties)
        return _decided(closed, problem, what, directions)
    nothing, off = np.zeros(len(roundoff)), (Mode.OFF,) * len(roundoff)
    return Modes(off, nothing, nothing, paradox=True)


def _at_rates(
    closed: Closed, accelerations: Floats, rates: Floats, slip_noise: Floats
) -> Problem:
    """Make what slides a given force against its slip, what rests a bounded one."""
    normals, pairs = _indices(closed.normals), _indices(closed.pairs)
    roles = _indices(tuple([_ROLES[kind] for kind in closed.kinds]))
    slips = np.where(pairs >= 0, np.hypot(rates, rates[pairs]), np.abs(rates))
    sliding = (roles == Role.BOXED) & (slips > slip_noise)
    roles = np.where(sliding, Role.GIVEN, roles)
    sizes = np.where(roles == Role.BOXED, closed.statics, closed.bounds)
    directions = np.where(sliding, -rates / np.where(sliding, slips, 1.0), 0.0)
    return Problem(closed.D, accelerations, roles, sizes, directions, normals, pairs)


def _known(problem: Problem, solution: Solution, roundoff: Floats) -> Floats:
    """Bounds of the rounding of the accelerations of rows (r,).

    Against all that could push: what rests without a force has its friction's scale.
    """
    pushes = np.maximum(np.abs(solution.p), problem.bounds(solution.p))
    terms = np.abs(problem.D) @ pushes + np.abs(problem.c)
    parts = np.where(problem.pairs >= 0, SETTLED_IMPULSE, ACCELERATION_ROUNDOFF)
    return np.asarray(np.maximum(roundoff, parts * terms))


def _is_plain(problem: Problem, solution: Solution, rounding: Floats) -> bool:
    """Whether, of one or two independent rows, none is near an edge."""
    for k, mode in enumerate(solution.modes):
        p, own, n = solution.p.item(k), problem.D.item(k, k), problem.normals.item(k)
        held, role = mode is Mode.HELD, problem.roles.item(k)
        if n >= 0 and solution.modes[n] is Mode.OFF:
            return False
        if role == Role.SIGNED:
            inside = p * own if held else solution.w.item(k)
        elif role == Role.BOXED and held:
            inside = (problem.bounds(solution.p).item(k) - abs(p)) * own
        elif role == Role.BOXED:
            inside = -solution.w.item(k) * solution.directions.item(k)
        else:
            continue
        if inside <= rounding[k]:
            return False
    return True


def _begins(closed: Closed, problem: Problem, modes: list[Mode]) -> Flags:
    """Which rows begin to slide with another bound than that of sliding (r,)."""
    driven = np.array([mode is Mode.SLIDING for mode in modes], dtype=bool)
    begin: Flags = (
        driven & (problem.roles == Role.BOXED) & (closed.bounds != problem.sizes)
    )
    return begin


def _on_edges(
    closed: Closed, problem: Problem, solution: Solution, rounding: Floats, ties: Floats
) -> tuple[list[Mode], Floats]:
    """Modes and directions where ties are decided and held rows are independent.

    rounding : (r,), accelerations that are rounding.
    """
    own = closed.D.diagonal()
    small = rounding / np.where(own > 0.0, own, 1.0)
    modes, directions = list(solution.modes), solution.directions.copy()
    p, w = solution.p, solution.w
    tied: list[int] = []  # what touches without force and is not to part
    apart: list[int] = []  # ... and what does
    for k in problem.rows(Role.SIGNED):
        if modes[k] is Mode.HELD and p[k] <= small[k] and ties[k] > 0.0:
            modes[k] = Mode.OFF
        elif modes[k] is Mode.OFF and w[k] <= rounding[k]:
            (tied if ties[k] <= 0.0 else apart).append(k)
    for k, bound in enumerate(problem.bounds(p).tolist()):
        n = problem.normals[k]
        if n >= 0 and modes[n] is Mode.OFF and n not in tied:
            modes[k], directions[k] = Mode.OFF, 0.0
            continue
        if problem.roles[k] != Role.BOXED:
            continue
        rows = [k] if problem.pairs[k] < 0 else [k, problem.pairs[k]]
        slip, force = np.linalg.norm(w[rows]), np.linalg.norm(p[rows])
        if slip > rounding[rows].max():
            modes[k], directions[k] = Mode.SLIDING, directions[k] or -float(w[k] / slip)
        elif ties[rows].any() and bound > small[k] and force >= bound - small[k]:
            modes[k], directions[k] = Mode.SLIDING, float(p[k] / force)
        elif modes[k] is not Mode.HELD:
            tied.append(k)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    held.sort(key=lambda k: problem.roles[k] != Role.FREE)
    _imply(_Rows(closed), problem, p, modes, directions, [*held, *tied], apart)
    return modes, directions


def _imply(
    span: _Rows,
    problem: Problem,
    p: Floats,
    modes: list[Mode],
    directions: Floats,
    holding: list[int],
    apart: list[int],
) -> None:
    """Mark rows that others hold as redundant, with the share of their bound they bear.

    Slips of contacts without force are off; what others hold cannot part.
    """
    limits = problem.bounds(p)
    for k in holding:
        n = problem.normals[k]
        if n >= 0 and modes[n] is not Mode.HELD:
            modes[k], directions[k] = Mode.OFF, 0.0
        elif span.takes(k):
            modes[k], directions[k] = Mode.HELD, 0.0
        else:
            modes[k] = Mode.REDUNDANT
            if n >= 0 or problem.roles[k] == Role.BOXED:
                directions[k] = p[k] / limits[k] if limits[k] else 0.0
    for k in apart:
        if span.has(k):
            modes[k] = Mode.REDUNDANT


def _columns(closed: Closed) -> Floats:
    """Y (k, r): D = Y^T Y."""
    if closed.factor is not None:
        return closed.factor
    sizes, V = np.linalg.eigh(closed.D)
    return np.asarray(np.sqrt(np.maximum(sizes, 0.0))[:, None] * V.T)


class _Rows(Span):
    """The span of the rows taken so far."""

    def __init__(self, closed: Closed) -> None:
        Y = _columns(closed)
        super().__init__(len(Y))
        self.least = DEPENDENT_DIRECTIONS if closed.factor is None else DEPENDENT_ROWS
        lengths = np.linalg.norm(Y, axis=0)
        self.units = (Y / np.where(lengths > 0.0, lengths, 1.0)).T

    def takes(self, row: int) -> bool:
        """Take a row unless it is spanned already."""
        return self.extend(self.units[row], self.least)

    def has(self, row: int) -> bool:
        """Whether a row is spanned."""
        return float(np.linalg.norm(self.outside(self.units[row]))) <= self.least


def _supported(
    closed: Closed, problem: Problem, solution: Solution, rounding: Floats
) -> Solution:
    """Solution in which the contacts that bear are independent, if there is one.

    All rows keep their accelerations within rounding (r,).
    """
    while True:
        for k in _spare(closed, problem, solution):
            away = (np.arange(len(problem.c)) == k) | (problem.normals == k)
            without = replace(problem, roles=np.where(away, Role.ABSENT, problem.roles))
            less = solve(without)
            full = closed.D @ less.p + problem.c
            if less.found and (np.abs(full - solution.w) <= rounding).all():
                solution, problem = replace(less, w=full), without
                break
        else:
            return solution


def _spare(closed: Closed, problem: Problem, solution: Solution) -> list[int]:
    """Contacts that end first where forces change along a dependence."""
    p = solution.p
    bear = [k for k in problem.rows(Role.SIGNED) if p[k] > 0.0]
    span = _Rows(closed)
    if all(span.takes(k) for k in bear):
        return []
    s = np.sqrt(closed.D.diagonal()[bear])
    z = np.linalg.svd(span.units[bear].T)[2][-1] / s
    ends = []
    for direction in (z, -z):
        falls = direction < -np.abs(z).max() * span.least
        parts = np.where(falls, p[bear] / np.where(falls, -direction, 1.0), np.inf)
        if np.isfinite(parts.min()):
            ends.append(bear[int(parts.argmin())])
    return sorted(ends, key=lambda k: float(p[k]))


def _decided(
    closed: Closed, problem: Problem, modes: list[Mode], directions: Floats
) -> Modes:
    """Solve once more, for the rows that hold by themselves."""
    p = polished(problem, modes, directions, closed.factor)
    least = -ACCELERATION_ROUNDOFF * np.abs(p).max(initial=0.0)
    p[(problem.roles == Role.SIGNED) & (p < 0.0) & (p > least)] = 0.0
    # Ways are parts of the bounds in force, here of those of the problem.
    redundant = np.array([mode is Mode.REDUNDANT for mode in modes], dtype=bool)
    known = np.where(redundant, closed.statics, closed.bounds)
    other = (known > 0.0) & (known != problem.sizes)
    parts = np.where(other, problem.sizes, 1.0) / np.where(other, known, 1.0)
    return Modes(
        tuple(modes), directions * parts, p, _jams(closed, problem, modes, directions)
    )


def _jams(
    closed: Closed, problem: Problem, modes: list[Mode], directions: Floats
) -> bool:
    """Whether a contact that holds and slides has no positive effective mass.

    Pressing on it then does not push it away: each alone, and those that hold together.
    What need not press may part; that is no paradox.
    """
    if Mode.SLIDING not in modes:
        return False
    E, _ = expressed(problem, modes, directions)
    free = problem.rows(Role.FREE)
    G = closed.D @ E
    masses = G.diagonal()
    if free:
        X = np.linalg.lstsq(G[np.ix_(free, free)], G[free], rcond=None)[0]
        masses = masses - np.einsum("ij,ji->i", G[:, free], X)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    signed = [k for k in held if problem.roles[k] == Role.SIGNED]
    if (masses[signed] <= ACCELERATION_ROUNDOFF * closed.D.diagonal()[signed]).any():
        return True
    # Those that hold together: their mass against the one without friction.
    Y = _columns(closed)
    Q, R = np.linalg.qr(Y[:, held])
    sign, size = np.linalg.slogdet(Q.T @ (Y @ E)[:, held])
    other, plain = np.linalg.slogdet(R)
    return bool(sign * other * np.exp(size - plain) <= ACCELERATION_ROUNDOFF)
