"""Multipliers under one-sided laws and bounds: w = D p + c with a law for each row.

    SIGNED   p >= 0, w >= 0, p w = 0: contacts, freewheels
    BOXED    |p| <= bound; w > 0 only at p = -bound, w < 0 only at p = bound
    GIVEN    p = way * bound
    FREE     w = 0
    ABSENT   p = 0

where bound = limit + mu * p of the row's contact. Two slips share a bound: on a disc.

Of one or two rows all edges are tried. Of more, pivoting says which rows hold; these
are solved for again as equations, so that the result is accurate to rounding. There
friction is a complementarity problem too: along directions d_i that span the slips of a
contact, p = sum of a_i d_i with a >= 0, and with l for the size of the slip

    a_i >= 0 complements d_i . w + l
    l >= 0 complements bound - sum of a_i

which is copositive for every mu: there is a solution, and Lemke's method finds it. For
one slip, with the directions 1 and -1, that is Coulomb's law; for two it has corners.

A disc has no sides: there Newton's method says which rows hold. Each law is an
equation: p is what the projection onto its bounds makes of p - w. The equations have
kinks but slopes on each side of them. Sweeps of projections, contact by contact, come
near the solution from anywhere; Newton's steps end there.

Sources: D. E. Stewart, J. C. Trinkle, An implicit time-stepping scheme for rigid body
dynamics with inelastic collisions and Coulomb friction, Int. J. Num. Meth. Eng. 39
(1996) 2673; P. Alart, A. Curnier, A mixed formulation for frictional contact problems
prone to Newton like solution methods, Comput. Methods Appl. Mech. Eng. 92 (1991) 353;
the sweeps: M. Jean, The non-smooth contact dynamics method, ibid. 177 (1999) 235.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.contact.delassus import freedom
from lagsim.mechanics.contact.pivoting import lemke

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.constraints import Kind


class Mode(IntEnum):
    """What a row does."""

    OFF = 0  # no multiplier
    HELD = 1  # an equality with its multiplier
    DRIVEN = 2  # not held: the multiplier has the size of its bound
    IMPLIED = 3  # it holds because others do


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


class Role(Enum):
    """The law of a row."""

    ABSENT = "no multiplier"
    SIGNED = "a multiplier >= 0"
    BOXED = "a bounded multiplier"
    GIVEN = "a multiplier at its bound"
    FREE = "an equality"


@dataclass(frozen=True, slots=True)
class Problem:
    """The rows of a problem, r of them: see above.

    Attributes
    ----------
    D : ndarray, shape (r, r)
    c, limits, mus, ways : list of float, of r
    roles : list of Role
    normals, pairs : tuple of int
        The row of the contact; that of the other of two slips; or -1.
    """

    D: Floats
    c: list[float]
    roles: list[Role]
    limits: list[float]
    mus: list[float]
    ways: list[float]
    normals: tuple[int, ...]
    pairs: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Solution:
    """Multipliers p and w = D p + c (r,), and what each row does.

    Attributes
    ----------
    residual : float
        Of the laws, relative to c, in the units of the rows.
    found : bool
        A solution at all.
    apart : bool
        One or two rows, which are far from being dependent.
    """

    p: Floats
    w: Floats
    modes: list[Mode]
    ways: list[float]
    residual: float
    found: bool
    apart: bool = False


def scaled(problem: Problem) -> tuple[Problem, Floats]:
    """Give the problem with a diagonal near 1, by powers of two, and these scales."""
    diagonal: list[float] = problem.D.diagonal().tolist()
    pairs = problem.pairs
    sizes = [
        max(diagonal[k], diagonal[j]) if j >= 0 else diagonal[k]
        for k, j in enumerate(pairs)
    ]
    s = [_power(d) for d in sizes]
    scales = np.array(s)
    coupled = zip(problem.mus, problem.normals, strict=True)
    roles = [
        role if d > 0.0 else Role.ABSENT
        for role, d in zip(problem.roles, sizes, strict=True)
    ]
    return Problem(
        problem.D * scales * scales[:, None],
        [a * c for a, c in zip(s, problem.c, strict=True)],
        roles,
        [x / a for a, x in zip(s, problem.limits, strict=True)],
        [m * (s[n] / s[k]) for k, (m, n) in enumerate(coupled)],
        problem.ways,
        problem.normals,
        pairs,
    ), scales


def _power(d: float) -> float:
    """Give the power of two near 1/sqrt(d)."""
    return 1.0 if d <= 0.0 else float(2.0 ** -round(math.log2(d) / 2.0))


def bounds(problem: Problem, p: Floats) -> list[float]:
    """Give what the multipliers of boxed and given rows may be."""
    terms = zip(problem.limits, problem.mus, problem.normals, strict=True)
    return [a + mu * max(p[n], 0.0) if n >= 0 else a for a, mu, n in terms]


def residual(problem: Problem, p: Floats) -> float:
    """Give how far p (r,) is from what its law makes of p - w.

    Relative to the largest terms of w; to be asked where the problem is scaled.
    """
    w = problem.D @ p + problem.c
    terms = np.abs(problem.D) @ np.abs(p) + np.abs(problem.c)
    size = float(terms.max(initial=0.0)) or 1.0
    worst = 0.0
    for k, bound in enumerate(bounds(problem, p)):
        role = problem.roles[k]
        if role is Role.SIGNED:
            worst = max(worst, abs(min(p[k], w[k])))
        elif role is Role.FREE:
            worst = max(worst, abs(w[k]))
        elif role is Role.BOXED:
            j = problem.pairs[k]
            z = p[k] - w[k]
            length = abs(z) if j < 0 else float(np.hypot(z, p[j] - w[j]))
            worst = max(worst, abs(p[k] - z * min(1.0, bound / (length or 1.0))))
    return worst / size


# A case that breaks its laws by more, in parts of the terms, is not the one.
ROUNDING = 1e-14
# Rows that leave less than this part of themselves ask for more than Cramer's rule.
CLOSE = 1e-2


class Row(NamedTuple):
    """One of two rows: its law, and its own entry of D."""

    role: Role
    own: float
    c: float
    limit: float
    mu: float
    way: float


# What stands in for a second row.
_NOBODY = Row(Role.ABSENT, 1.0, 0.0, 0.0, 0.0, 0.0)

_CASES = {
    Role.ABSENT: ((Mode.OFF, 0.0),),
    Role.SIGNED: ((Mode.HELD, 0.0), (Mode.OFF, 0.0)),
    Role.BOXED: ((Mode.HELD, 0.0), (Mode.DRIVEN, -1.0), (Mode.DRIVEN, 1.0)),
    Role.FREE: ((Mode.HELD, 0.0),),
}


def solve_small(problem: Problem) -> Solution | None:
    """Give the solution, or None where that takes more than plain numbers."""
    r, D = len(problem.c), problem.D
    first = _row(problem, 0, D.item(0))
    second, b = (_row(problem, 1, D.item(3)), D.item(1)) if r == 2 else (_NOBODY, 0.0)
    mu = second.mu if r == 2 and problem.normals[1] == 0 else 0.0
    if first.own <= 0.0 or second.own <= 0.0 or max(problem.pairs) >= 0:
        return None
    for (m, up), (n, down) in product(_cases(first), _cases(second)):
        found = _multipliers(first, second, b, mu * down, (m, up), (n, down))
        if found is None:
            continue
        p, q = found
        w = 0.0 if m is Mode.HELD else first.own * p + b * q + first.c
        z = 0.0 if n is Mode.HELD else b * p + second.own * q + second.c
        amiss = max(
            _amiss(first, p, w, first.limit, up, abs(b * q)),
            _amiss(second, q, z, second.limit + mu * max(p, 0.0), down, abs(b * p)),
        )
        if amiss <= ROUNDING:
            return Solution(
                np.array((p, q)[:r]),
                np.array((w, z)[:r]),
                [m, n][:r],
                [up, down][:r],
                amiss,
                found=True,
                apart=True,
            )
    return None


def _row(p: Problem, k: int, own: float) -> Row:
    return Row(p.roles[k], own, p.c[k], p.limits[k], p.mus[k], p.ways[k])


def _cases(row: Row) -> tuple[tuple[Mode, float], ...]:
    return ((Mode.DRIVEN, row.way),) if row.role is Role.GIVEN else _CASES[row.role]


def _multipliers(
    first: Row,
    second: Row,
    b: float,
    slope: float,
    case: tuple[Mode, float],
    other: tuple[Mode, float],
) -> tuple[float, float] | None:
    """Give the multipliers of a case, or None if its rows are too close."""
    p, q = case[1] * first.limit, other[1] * second.limit
    held, too = case[0] is Mode.HELD, other[0] is Mode.HELD
    if held and too:
        a, d, c, e = first.own, second.own, first.c, second.c
        rest = a * d - b * b
        if rest <= CLOSE * a * d:
            return None
        return (b * e - d * c) / rest, (b * c - a * e) / rest
    if held:
        own = first.own + b * slope
        if own <= CLOSE * first.own:
            return None
        p = -(first.c + b * q) / own
        q += slope * p
    elif too:
        q = -(second.c + b * p) / second.own
    return p, q


def _amiss(
    row: Row, p: float, w: float, bound: float, way: float, others: float
) -> float:
    """Give by what part of its terms a row breaks its law."""
    broken = 0.0
    if row.role is Role.SIGNED:
        broken = -min(w, p * row.own)
    elif row.role is Role.BOXED:
        broken = max((abs(p) - bound) * row.own, w * way)
    if broken <= 0.0:
        return 0.0
    return broken / (abs(row.c) + row.own * abs(p) + others)


# Singular values that are smaller belong to dependent rows. D is a square, so that this
# is an angle of 1e-7.
DEPENDENT = 1e-14


def expressed(
    problem: Problem, modes: list[Mode], ways: list[float]
) -> tuple[Floats, Floats]:
    """Give E (r, r), p0 (r,): p = E x + p0, where x are multipliers of held rows."""
    r = len(modes)
    E, p0 = np.zeros((r, r)), np.zeros(r)
    for k, mode in enumerate(modes):
        if mode is Mode.HELD:
            E[k, k] = 1.0
        elif ways[k] and mode is not Mode.OFF:
            p0[k] = ways[k] * problem.limits[k]
            n = problem.normals[k]
            if n >= 0 and modes[n] is Mode.HELD:
                E[k, n] = ways[k] * problem.mus[k]
    return E, p0


def polished(
    problem: Problem,
    modes: list[Mode],
    ways: list[float],
    factor: Floats | None = None,
) -> Floats:
    """Give the multipliers (r,) for which the held rows hold.

    With the factor (k, r) of D, nearly dependent rows cost only the digits they must.
    """
    E, p0 = expressed(problem, modes, ways)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    if not held:
        return p0
    D = problem.D[held]
    B, h = (D @ E)[:, held], np.array(problem.c)[held] + D @ p0
    solve = _by_factor(factor, E, held) if factor is not None else _by_square(B)
    x = -solve(h)
    x -= solve(B @ x + h)
    return E[:, held] @ x + p0


def _by_square(B: Floats) -> Callable[[Floats], Floats]:
    return lambda rhs: np.asarray(np.linalg.lstsq(B, rhs, rcond=DEPENDENT)[0], float)


def _by_factor(Y: Floats, E: Floats, held: list[int]) -> Callable[[Floats], Floats]:
    """Solve with B = Y_H^T Y E_H as R^T (Q^T Y E_H), where Y_H = Q R."""
    Q, R = np.linalg.qr(Y[:, held])
    forces = Q.T @ (Y @ E)[:, held]
    return lambda rhs: np.asarray(
        np.linalg.lstsq(forces, np.linalg.solve(R.T, rhs), rcond=DEPENDENT)[0], float
    )


# Directions in which a disc is replaced by a polygon: to start Newton's method.
CORNERS = 8
SIDES = np.array([[1.0], [-1.0]])
ANGLES = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
POLYGON = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


class Facets:
    """A problem whose unknown rows are signed ones, then groups of boxed ones.

    Attributes
    ----------
    signed : list of int
    groups : list of list of int
        One row, or the two of a disc.
    """

    def __init__(self, problem: Problem) -> None:
        rows = list(enumerate(problem.roles))
        self.problem = problem
        self.signed = [k for k, role in rows if role is Role.SIGNED]
        self.groups = [
            [k] if problem.pairs[k] < 0 else [problem.pairs[k], k]
            for k, role in rows
            if role is Role.BOXED and problem.pairs[k] < k
        ]
        self.directions = [SIDES if len(g) == 1 else POLYGON for g in self.groups]

    def matrix(self) -> tuple[Floats, Floats]:
        """Give M and q of the complementarity problem."""
        problem, signed, n = self.problem, self.signed, len(self.signed)
        unknown = signed + [k for group in self.groups for k in group]
        G, h = _reduced(problem, unknown)
        N = self.spread()
        slopes, m = N.shape[1], len(self.groups)
        M = np.zeros((slopes + m, slopes + m))
        q = np.zeros(slopes + m)
        M[:slopes, :slopes] = N.T @ G @ N
        q[:slopes] = N.T @ h
        place = {k: i for i, k in enumerate(signed)}
        at = n
        for i, (group, d) in enumerate(
            zip(self.groups, self.directions, strict=True), slopes
        ):
            M[at : at + len(d), i] = 1.0
            M[i, at : at + len(d)] = -1.0
            at += len(d)
            k = group[0]
            q[i] = problem.limits[k]
            if problem.normals[k] in place:
                M[i, place[problem.normals[k]]] = problem.mus[k]
        return M, q

    def spread(self) -> Floats:
        """Give N: p of the unknown rows = N a."""
        n = len(self.signed)
        rows = n + sum(d.shape[1] for d in self.directions)
        N = np.zeros((rows, n + sum(map(len, self.directions))))
        N[:n, :n] = np.eye(n)
        i = j = n
        for d in self.directions:
            N[i : i + d.shape[1], j : j + len(d)] = d.T
            i, j = i + d.shape[1], j + len(d)
        return N

    def split(self, basis: Flags) -> tuple[list[list[bool]], list[bool]]:
        """Give which directions of each group, and which of their slips, are basic."""
        at, parts = len(self.signed), []
        for d in self.directions:
            parts.append(basis[at : at + len(d)].tolist())
            at += len(d)
        return parts, basis[at:].tolist()


def with_corners(problem: Problem) -> Floats | None:
    """Give multipliers (r,) where discs are polygons, if there is a solution."""
    facets = Facets(problem)
    M, q = facets.matrix()
    basis = lemke(M, q)
    if basis is None:
        return None
    N = facets.spread()
    a = np.zeros(len(q))
    a[basis] = np.linalg.lstsq(M[np.ix_(basis, basis)], -q[basis], rcond=DEPENDENT)[0]
    p = np.zeros(len(problem.c))
    p[facets.signed + [k for g in facets.groups for k in g]] = N @ a[: N.shape[1]]
    return p


def _reduced(problem: Problem, unknown: list[int]) -> tuple[Floats, Floats]:
    """Give G, h: w = G p + h of the unknown rows, what is given and free put in."""
    if len(unknown) == len(problem.roles):
        return problem.D[unknown][:, unknown], np.array(problem.c)[unknown]
    present = [
        Mode.OFF
        if role is Role.ABSENT
        else Mode.DRIVEN
        if role is Role.GIVEN
        else Mode.HELD
        for role in problem.roles
    ]
    E, p0 = expressed(problem, present, problem.ways)
    G, h = problem.D @ E, problem.c + problem.D @ p0
    free = [k for k, role in enumerate(problem.roles) if role is Role.FREE]
    if free:
        B = np.column_stack([G[np.ix_(free, unknown)], h[free]])
        X = np.linalg.lstsq(G[np.ix_(free, free)], B, rcond=DEPENDENT)[0]
        taken = G[np.ix_(unknown, free)] @ X
        return G[np.ix_(unknown, unknown)] - taken[:, :-1], h[unknown] - taken[:, -1]
    return G[np.ix_(unknown, unknown)], h[unknown]


# Sweeps before Newton's method, and before the last attempt.
SWEEPS = (10, 500)
# The diagonal added to D, whose own is 1, and how often its force is taken back.
FIRM_ON_DISCS = 1e-2
PROXIMAL_ON_DISCS = 8
# Newton's steps; near the solution it takes about five.
STEPS = 30
# Of a Newton step, the parts that are tried.
PARTS = (1.0, 0.5, 0.25, 0.0625)
# Equations that are met to this part of their terms are met.
MET = 1e-15
GOOD = 1e-12
# Steps longer than this, in parts of what they mend, are those of dependent rows.
FAR = 1e8


def by_newton(problem: Problem) -> Floats:
    """Give multipliers p (r,) of a scaled problem, the best ones found."""
    size = max(*map(abs, problem.c), *problem.limits) or 1.0
    best, least = np.zeros(len(problem.c)), np.inf
    for attempt in (_swept, _proximal, _from_corners, _swept_long):
        p, amiss = _descend(problem, attempt(problem))
        if amiss < least:
            best, least = p, amiss
        if least <= GOOD * size:
            break
    return best


def _swept(problem: Problem, sweeps: int = SWEEPS[0]) -> Floats:
    p = np.zeros(len(problem.c))
    for _ in range(sweeps):
        before = p.copy()
        _sweep(problem, p)
        if np.abs(p - before).max() <= MET * np.abs(p).max():
            break
    return p


def _swept_long(problem: Problem) -> Floats:
    return _swept(problem, SWEEPS[1])


def _proximal(problem: Problem) -> Floats:
    """Make dependent rows independent by more diagonal, and take its force back."""
    firm = problem.D + FIRM_ON_DISCS * np.eye(len(problem.c))
    p = np.zeros(len(problem.c))
    for _ in range(PROXIMAL_ON_DISCS):
        pushed = list(np.asarray(problem.c) - FIRM_ON_DISCS * p)
        p, _ = _descend(replace(problem, D=firm, c=pushed), p)
    return p


def _from_corners(problem: Problem) -> Floats:
    p = with_corners(problem)
    return np.zeros(len(problem.c)) if p is None else p


def _descend(problem: Problem, p: Floats) -> tuple[Floats, float]:
    """Take Newton's steps for as long as they get nearer."""
    F, J = equations(problem, p)
    size = float(np.abs(F).max())
    for _ in range(STEPS):
        step = _step(J, F)
        for part in PARTS:
            there = p + part * step
            F, J = equations(problem, there)
            if np.abs(F).max() < size:
                break
        else:
            return p, size
        p, size = there, float(np.abs(F).max())
    return p, size


def _step(J: Floats, F: Floats) -> Floats:
    """Solve J step = -F, by least squares where rows depend on each other."""
    try:
        step = np.linalg.solve(J, -F)
    except np.linalg.LinAlgError:
        step = np.full(len(F), np.inf)
    if np.abs(step).max() > FAR * np.abs(F).max():
        step = np.linalg.lstsq(J, -F, rcond=MET)[0]
    return np.asarray(step, float)


def equations(problem: Problem, p: Floats) -> tuple[Floats, Floats]:
    """Give F (r,), zero at solutions, and its slopes (r, r)."""
    D, r = problem.D, len(p)
    w = D @ p + problem.c
    unit_rows = np.eye(r)
    F, J = p.copy(), np.eye(r)
    limits = bounds(problem, p)
    for k, role in enumerate(problem.roles):
        n, j, bound = problem.normals[k], problem.pairs[k], limits[k]
        slope = problem.mus[k] if n >= 0 and p[n] > 0.0 else 0.0
        if role is Role.GIVEN:
            F[k] -= problem.ways[k] * bound
            J[k, n] -= problem.ways[k] * slope
        elif role is Role.FREE or (role is Role.SIGNED and p[k] > w[k]):
            F[k], J[k] = w[k], D[k]
        elif role is Role.BOXED and j < k:
            rows = [k] if j < 0 else [j, k]
            z = p[rows] - w[rows]
            size = float(np.linalg.norm(z))
            if size <= bound:
                F[rows], J[rows] = w[rows], D[rows]
                continue
            unit = z / size
            F[rows] -= bound * unit
            across = np.eye(len(rows)) - np.outer(unit, unit)
            J[rows] -= (bound / size) * across @ (unit_rows[rows] - D[rows])
            J[rows, n] -= slope * unit
    return F, J


def _sweep(problem: Problem, p: Floats) -> None:
    """Project row by row, each with what the earlier ones have become."""
    D, c = problem.D, problem.c
    for k, role in enumerate(problem.roles):
        j = problem.pairs[k]
        if role is Role.SIGNED:
            p[k] = max(0.0, p[k] - (D[k] @ p + c[k]) / D[k, k])
        elif role is Role.FREE:
            p[k] -= (D[k] @ p + c[k]) / D[k, k]
        elif role is Role.GIVEN:
            p[k] = problem.ways[k] * _bound(problem, p, k)
        elif role is Role.BOXED and j < k:
            rows = [k] if j < 0 else [j, k]
            a, b, d = D[rows[0], rows[0]], D[rows[0], k], D[k, k]
            stiff = a if j < 0 else (a + d + np.hypot(a - d, 2.0 * b)) / 2.0
            z = p[rows] - (D[rows] @ p + np.take(c, rows)) / stiff
            p[rows] = z * min(1.0, _bound(problem, p, k) / (np.linalg.norm(z) or 1.0))


def _bound(problem: Problem, p: Floats, k: int) -> float:
    n = problem.normals[k]
    return problem.limits[k] + (problem.mus[k] * max(p[n], 0.0) if n >= 0 else 0.0)


# What leaves a larger residual does not solve the problem.
SOLVED = 1e-7
# So many rows have so few edges that all are tried.
SMALL = 2
# How much diagonal is added where pivoting fails, and how often.
FIRM = 1e-6
PROXIMAL = 2


def solve(problem: Problem) -> Solution:
    """Give multipliers that obey the laws, and what each row does.

    Rows that nothing couples are problems of their own: what is rounding in one of them
    may be a rate that counts in another.
    """
    count = len(problem.c)
    groups = _decoupled(problem) if count > 1 else []
    if len(groups) <= 1:
        return _solved(problem)
    modes, ways = [_STARTS[role] for role in problem.roles], list(problem.ways)
    p, w = np.zeros(count), np.zeros(count)
    residuals, found = [], True
    for rows in groups:
        own = _solved(_part(problem, rows))
        p[rows], w[rows] = own.p, own.w
        for k, mode, way in zip(rows, own.modes, own.ways, strict=True):
            modes[k], ways[k] = mode, way
        residuals.append(own.residual)
        found = found and own.found
    return Solution(p, w, modes, ways, max(residuals), found)


def _decoupled(problem: Problem) -> list[list[int]]:
    """Give the rows in groups that have no entry of D and no bound in common."""
    sets = DisjointSets(len(problem.c))
    for i, j in np.argwhere(problem.D).tolist():
        sets.merge(i, j)
    for others in (problem.normals, problem.pairs):
        for k, j in enumerate(others):
            if j >= 0:
                sets.merge(k, j)
    return sets.sets()


def _part(problem: Problem, rows: list[int]) -> Problem:
    """Give the problem of some rows, of which none is coupled with another."""
    at = {k: i for i, k in enumerate(rows)}
    return Problem(
        problem.D[np.ix_(rows, rows)],
        [problem.c[k] for k in rows],
        [problem.roles[k] for k in rows],
        [problem.limits[k] for k in rows],
        [problem.mus[k] for k in rows],
        [problem.ways[k] for k in rows],
        tuple(at.get(problem.normals[k], -1) for k in rows),
        tuple(at.get(problem.pairs[k], -1) for k in rows),
    )


def _solved(problem: Problem) -> Solution:
    small = solve_small(problem) if len(problem.c) <= SMALL else None
    if small is not None:
        return small
    unit, s = scaled(problem)
    paired = any(
        j >= 0 and role is Role.BOXED
        for j, role in zip(unit.pairs, unit.roles, strict=True)
    )
    found = _with_discs(unit) if paired else _with_boxes(unit)
    return replace(found, p=found.p * s, w=found.w / s)


def _with_boxes(unit: Problem) -> Solution:
    """Solve it by pivoting.

    Pivots among dependent rows can end without a solution by rounding. Then a little
    more diagonal makes the rows independent, and its force on the solution is taken
    back (proximal points), until the edges are those of the problem itself.
    """
    found = _attempt(unit, unit)
    p = np.zeros(len(unit.c))
    for _ in range(PROXIMAL):
        if found.found:
            return found
        firm = replace(
            unit,
            D=unit.D + FIRM * np.diag(unit.D.diagonal()),
            c=list(unit.c - FIRM * unit.D.diagonal() * p),
        )
        found = _attempt(firm, unit)
        p = found.p
    return found if found.found else _sliding(unit)


def _sliding(unit: Problem) -> Solution:
    """Solve it where each box is at its bound, against the speed that it has.

    What slides fast, far beyond all that its forces change, hides from pivoting what
    they do.
    """
    boxed = Role.BOXED
    roles = [Role.GIVEN if role is boxed else role for role in unit.roles]
    ways = [
        -float(np.sign(c)) if role is boxed else way
        for role, c, way in zip(unit.roles, unit.c, unit.ways, strict=True)
    ]
    return _attempt(replace(unit, roles=roles, ways=ways), unit)


def _with_discs(unit: Problem) -> Solution:
    """Solve it by Newton's method, whose solution shows the edges."""
    p = by_newton(unit)
    modes = [_STARTS[role] for role in unit.roles]
    ways = list(unit.ways)
    w = unit.D @ p + unit.c
    limits = bounds(unit, p)
    for k, role in enumerate(unit.roles):
        n, j = unit.normals[k], unit.pairs[k]
        if role is Role.SIGNED and p[k] > w[k]:
            modes[k] = Mode.HELD
        elif role is Role.BOXED and (n < 0 or modes[n] is Mode.HELD):
            rows = [k] if j < 0 else [k, j]
            z = p[rows] - w[rows]
            size = float(np.linalg.norm(z))
            modes[k] = Mode.HELD if size <= limits[k] else Mode.DRIVEN
            ways[k] = 0.0 if size <= limits[k] else float(z[0]) / size
    # Of dependent rows, equations would choose shares that the discs do not allow.
    return _judged(unit, p, modes, ways)


def _attempt(problem: Problem, exact: Problem) -> Solution:
    """Find the edges of one problem, and the solution of another on them."""
    modes = [_STARTS[role] for role in problem.roles]
    ways = list(problem.ways)
    if not _by_pivots(problem, modes, ways):
        p = np.zeros(len(modes))
        return Solution(p, exact.D @ p + exact.c, modes, ways, np.inf, False)
    p = polished(exact, modes, ways)
    for k, role in enumerate(exact.roles):
        if role is Role.SIGNED and p[k] < 0.0:
            p[k] = 0.0
    return _judged(exact, p, modes, ways)


def _judged(
    problem: Problem, p: Floats, modes: list[Mode], ways: list[float]
) -> Solution:
    amiss = residual(problem, p)
    w = problem.D @ p + problem.c
    w[[k for k, mode in enumerate(modes) if mode is Mode.HELD]] = 0.0
    return Solution(p, w, modes, ways, amiss, amiss < SOLVED)


_STARTS = {
    Role.ABSENT: Mode.OFF,
    Role.SIGNED: Mode.OFF,
    Role.BOXED: Mode.OFF,
    Role.GIVEN: Mode.DRIVEN,
    Role.FREE: Mode.HELD,
}


def _by_pivots(problem: Problem, modes: list[Mode], ways: list[float]) -> bool:
    """Fill in what the rows do, by Lemke's method; False if there is no solution."""
    sides = Facets(problem)
    basis = lemke(*sides.matrix())
    if basis is None:
        return False
    for k, pushes in zip(sides.signed, basis, strict=False):
        modes[k] = Mode.HELD if pushes else Mode.OFF
    for (k,), (up, down), slips in zip(sides.groups, *sides.split(basis), strict=True):
        held = (up or down) if not slips else (up and down)
        ways[k] = 0.0 if held else float(up) - float(down)
        if held or slips:
            modes[k] = Mode.HELD if held else Mode.DRIVEN
    return True


def least_norm(rows: Floats, multipliers: Floats) -> Floats:
    """Give the multipliers (k,) >= 0 of least norm with the same forces.

    Parameters
    ----------
    rows : ndarray, shape (k, n)
        Of the contacts that hold, implied ones among them. Columns may have any units.
    multipliers : ndarray, shape (k,)
        Nonnegative ones.

    Notes
    -----
    With P the projection onto the changes that make no force, they are m + P u with the
    least norm of all, m, and u >= 0 complementary to them (Karush, Kuhn, Tucker).
    """
    sizes = np.abs(rows).max(axis=0)
    N = freedom((rows / np.where(sizes > 0.0, sizes, 1.0)).T)
    if not N.shape[1]:
        return multipliers
    P = N @ N.T
    r, least = len(multipliers), multipliers - P @ multipliers
    nothing, nowhere = [0.0] * r, (-1,) * r
    problem = Problem(
        P, list(least), [Role.SIGNED] * r, nothing, nothing, nothing, nowhere, nowhere
    )
    return np.maximum(least + P @ solve(problem).p, 0.0)
