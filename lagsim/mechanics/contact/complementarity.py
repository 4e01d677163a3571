"""Multipliers under one-sided laws and bounds: w = D p + c with a law for each row.

    SIGNED   p >= 0, w >= 0, p w = 0: contacts, freewheels
    BOXED    |p| <= bound; w > 0 only at p = -bound, w < 0 only at p = bound
    GIVEN    p = way * bound
    FREE     w = 0
    ABSENT   p = 0

where bound = limit + mu * p of the row's contact. Two slips share a bound: on a disc.

Pivoting says which rows hold; these are solved for again as equations, so that the
result is accurate to rounding. There friction is a complementarity problem too: along
directions d_i that span the slips of a contact, p = sum of a_i d_i with a >= 0, and
with l for the size of the slip

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

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.contact.pivoting import lemke
from lagsim.tolerances import CONVERGED, DEPENDENT_SQUARE, SOLVED_LAWS

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Flags, Floats, Ints
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


@lru_cache(maxsize=64)
def indices(numbers: tuple[int, ...]) -> Ints:
    """Give an array of row numbers, or of roles; it is not to be written to."""
    return np.array(numbers, dtype=np.intp)


class Role:
    """The law of a row: numbers, which arrays are compared with."""

    ABSENT = 0  # no multiplier
    SIGNED = 1  # a multiplier >= 0
    BOXED = 2  # a bounded multiplier
    GIVEN = 3  # a multiplier at its bound
    FREE = 4  # an equality


@dataclass(frozen=True, slots=True)
class Problem:
    """The rows of a problem, r of them: see above.

    Attributes
    ----------
    D : ndarray, shape (r, r)
    c, limits, mus, ways : ndarray, shape (r,)
    roles : ndarray of int, shape (r,)
        A `Role` each.
    normals, pairs : ndarray of int, shape (r,)
        The row of the contact; that of the other of two slips; or -1.
    """

    D: Floats
    c: Floats
    roles: Ints
    limits: Floats
    mus: Floats
    ways: Floats
    normals: Ints
    pairs: Ints

    def part(self, rows: list[int]) -> Problem:
        """Give the problem of some rows, of which none is coupled with another."""
        place = np.full(len(self.c) + 1, -1)  # the last for those that have none
        place[rows] = np.arange(len(rows))
        return Problem(
            self.D[np.ix_(rows, rows)], self.c[rows], self.roles[rows],
            self.limits[rows], self.mus[rows], self.ways[rows],
            place[self.normals[rows]], place[self.pairs[rows]],
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Solution:
    """Multipliers p and w = D p + c (r,), and what each row does.

    Attributes
    ----------
    modes : list of Mode
    ways : ndarray, shape (r,)
        Of a driven row: the part of its bound.
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
    ways: Floats
    residual: float
    found: bool
    apart: bool = False


def scaled(problem: Problem) -> tuple[Problem, Floats]:
    """Give the problem with a diagonal near 1, by powers of two, and these scales."""
    own, pairs = problem.D.diagonal(), problem.pairs
    sizes = np.where(pairs >= 0, np.maximum(own, own[pairs]), own)
    present = sizes > 0.0
    s = 2.0 ** -np.round(np.log2(np.where(present, sizes, 1.0)) / 2.0)
    return replace(
        problem,
        D=problem.D * s * s[:, None],
        c=s * problem.c,
        roles=np.where(present, problem.roles, Role.ABSENT),
        limits=problem.limits / s,
        mus=problem.mus * s[problem.normals] / s,
    ), s


def bounds(problem: Problem, p: Floats) -> Floats:
    """Give what the multipliers of boxed and given rows may be (r,)."""
    n = problem.normals
    pushes = np.where(n >= 0, np.maximum(p[n], 0.0), 0.0)
    return np.asarray(problem.limits + problem.mus * pushes)


def residual(problem: Problem, p: Floats) -> float:
    """Give how far p (r,) is from what its law makes of p - w.

    Relative to the largest terms of w; to be asked where the problem is scaled.
    """
    w, roles, pairs = problem.D @ p + problem.c, problem.roles, problem.pairs
    terms = np.abs(problem.D) @ np.abs(p) + np.abs(problem.c)
    z = p - w
    lengths = np.where(pairs >= 0, np.hypot(z, z[pairs]), np.abs(z))
    parts = bounds(problem, p) / np.where(lengths > 0.0, lengths, 1.0)
    off = np.where(roles == Role.SIGNED, np.minimum(p, w), 0.0)
    off = np.where(roles == Role.FREE, w, off)
    off = np.where(roles == Role.BOXED, p - z * np.minimum(1.0, parts), off)
    return float(np.abs(off).max(initial=0.0) / (terms.max(initial=0.0) or 1.0))


def expressed(
    problem: Problem, modes: list[Mode], ways: Floats
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
    ways: Floats,
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
    B, h = (D @ E)[:, held], problem.c[held] + D @ p0
    solve = _by_factor(factor, E, held) if factor is not None else _by_square(B)
    x = -solve(h)
    x -= solve(B @ x + h)
    return E[:, held] @ x + p0


def _by_square(B: Floats) -> Callable[[Floats], Floats]:
    return lambda rhs: np.asarray(
        np.linalg.lstsq(B, rhs, rcond=DEPENDENT_SQUARE)[0], float
    )


def _by_factor(Y: Floats, E: Floats, held: list[int]) -> Callable[[Floats], Floats]:
    """Solve with B = Y_H^T Y E_H as R^T (Q^T Y E_H), where Y_H = Q R."""
    Q, R = np.linalg.qr(Y[:, held])
    forces = Q.T @ (Y @ E)[:, held]
    return lambda rhs: np.asarray(
        np.linalg.lstsq(forces, np.linalg.solve(R.T, rhs), rcond=DEPENDENT_SQUARE)[0],
        float,
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
        self.problem, pairs = problem, problem.pairs.tolist()
        self.signed = np.flatnonzero(problem.roles == Role.SIGNED).tolist()
        self.groups = [
            [k] if pairs[k] < 0 else [pairs[k], k]
            for k in np.flatnonzero(problem.roles == Role.BOXED).tolist()
            if pairs[k] < k
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
    a[basis] = np.linalg.lstsq(
        M[np.ix_(basis, basis)], -q[basis], rcond=DEPENDENT_SQUARE
    )[0]
    p = np.zeros(len(problem.c))
    p[facets.signed + [k for g in facets.groups for k in g]] = N @ a[: N.shape[1]]
    return p


def _reduced(problem: Problem, unknown: list[int]) -> tuple[Floats, Floats]:
    """Give G, h: w = G p + h of the unknown rows, what is given and free put in."""
    if len(unknown) == len(problem.c):
        return problem.D[np.ix_(unknown, unknown)], problem.c[unknown]
    present = [_STARTS[role] for role in problem.roles.tolist()]
    for k in unknown:
        present[k] = Mode.HELD
    E, p0 = expressed(problem, present, problem.ways)
    G, h = problem.D @ E, problem.c + problem.D @ p0
    free = np.flatnonzero(problem.roles == Role.FREE).tolist()
    if free:
        B = np.column_stack([G[np.ix_(free, unknown)], h[free]])
        X = np.linalg.lstsq(G[np.ix_(free, free)], B, rcond=DEPENDENT_SQUARE)[0]
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
# Steps longer than this, in parts of what they mend, are those of dependent rows.
FAR = 1e8


def by_newton(problem: Problem) -> Floats:
    """Give multipliers p (r,) of a scaled problem, the best ones found."""
    size = max(float(np.abs(problem.c).max()), float(problem.limits.max())) or 1.0
    best, least = np.zeros(len(problem.c)), np.inf
    for attempt in (_swept, _proximal, _from_corners, _swept_long):
        p, amiss = _descend(problem, attempt(problem))
        if amiss < least:
            best, least = p, amiss
        if least <= CONVERGED * size:
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
        pushed = problem.c - FIRM_ON_DISCS * p
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
    for k, role in enumerate(problem.roles.tolist()):
        n, j, bound = problem.normals[k], problem.pairs[k], limits[k]
        slope = problem.mus[k] if n >= 0 and p[n] > 0.0 else 0.0
        if role == Role.GIVEN:
            F[k] -= problem.ways[k] * bound
            J[k, n] -= problem.ways[k] * slope
        elif role == Role.FREE or (role == Role.SIGNED and p[k] > w[k]):
            F[k], J[k] = w[k], D[k]
        elif role == Role.BOXED and j < k:
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
    for k, role in enumerate(problem.roles.tolist()):
        j = problem.pairs[k]
        if role == Role.SIGNED:
            p[k] = max(0.0, p[k] - (D[k] @ p + c[k]) / D[k, k])
        elif role == Role.FREE:
            p[k] -= (D[k] @ p + c[k]) / D[k, k]
        elif role == Role.GIVEN:
            p[k] = problem.ways[k] * bounds(problem, p)[k]
        elif role == Role.BOXED and j < k:
            rows = [k] if j < 0 else [j, k]
            a, b, d = D[rows[0], rows[0]], D[rows[0], k], D[k, k]
            stiff = a if j < 0 else (a + d + np.hypot(a - d, 2.0 * b)) / 2.0
            z = p[rows] - (D[rows] @ p + c[rows]) / stiff
            p[rows] = z * min(1.0, bounds(problem, p)[k] / (np.linalg.norm(z) or 1.0))


# How much diagonal is added where pivoting fails, and how often.
FIRM = 1e-6
PROXIMAL = 2
_STARTS = {
    Role.ABSENT: Mode.OFF,
    Role.SIGNED: Mode.OFF,
    Role.BOXED: Mode.OFF,
    Role.GIVEN: Mode.DRIVEN,
    Role.FREE: Mode.HELD,
}


def solve(problem: Problem) -> Solution:
    """Give multipliers that obey the laws, and what each row does.

    Rows that nothing couples are problems of their own: what is rounding in one of them
    may be a rate that counts in another.
    """
    groups = _decoupled(problem) if len(problem.c) > 1 else []
    if len(groups) <= 1:
        return _solved(problem)
    whole = _edgeless(problem)
    residuals, found = [], True
    for rows in groups:
        own = _solved(problem.part(rows))
        whole.p[rows], whole.w[rows], whole.ways[rows] = own.p, own.w, own.ways
        for k, mode in zip(rows, own.modes, strict=True):
            whole.modes[k] = mode
        residuals.append(own.residual)
        found = found and own.found
    return replace(whole, residual=max(residuals), found=found)


def _edgeless(problem: Problem) -> Solution:
    """Give what there is where nothing is known: no multipliers, and no solution."""
    modes = [_STARTS[role] for role in problem.roles.tolist()]
    p = np.zeros(len(modes))
    w = problem.c.copy()
    return Solution(p, w, modes, problem.ways.copy(), np.inf, found=False)


def _decoupled(problem: Problem) -> list[list[int]]:
    """Give the rows in groups that have no entry of D and no bound in common."""
    sets = DisjointSets(len(problem.c))
    for i, j in np.argwhere(problem.D).tolist():
        sets.merge(i, j)
    for others in (problem.normals, problem.pairs):
        for k, j in enumerate(others.tolist()):
            if j >= 0:
                sets.merge(k, j)
    return sets.sets()


# One or two rows have so few edges that all are tried, in plain numbers: most impacts
# are of these. A case that breaks its laws by more than the first, in parts of their
# terms, is not the one; rows that leave less than the second part of themselves ask for
# more than Cramer's rule.
BROKEN = 1e-14
CLOSE = 1e-2
_EDGES = {
    Role.ABSENT: ((Mode.OFF, 0.0),),
    Role.SIGNED: ((Mode.HELD, 0.0), (Mode.OFF, 0.0)),
    Role.BOXED: ((Mode.HELD, 0.0), (Mode.DRIVEN, -1.0), (Mode.DRIVEN, 1.0)),
    Role.FREE: ((Mode.HELD, 0.0),),
}


def _by_edges(problem: Problem) -> Solution | None:
    """Give the solution of one or two rows, or None where that takes more."""
    count, D = len(problem.c), problem.D.tolist()
    if problem.pairs.max() >= 0 or problem.D.diagonal().min() <= 0.0:
        return None
    c, limits, ways = problem.c.tolist(), problem.limits.tolist(), problem.ways.tolist()
    mu = float(problem.mus[-1]) if count == 2 and problem.normals[1] == 0 else 0.0
    choices = [
        ((Mode.DRIVEN, ways[k]),) if role == Role.GIVEN else _EDGES[role]
        for k, role in enumerate(problem.roles.tolist())
    ]
    for edges in product(*choices):
        held = [k for k, (mode, _) in enumerate(edges) if mode is Mode.HELD]
        p = [way * limit for (_, way), limit in zip(edges, limits, strict=True)]
        slope = edges[-1][1] * mu  # of the second one, by the first
        if not _hold(D, c, p, slope, held):
            continue
        w, broken = _broken(problem, mu, edges, p)
        if broken <= BROKEN:
            modes, parts = [mode for mode, _ in edges], [way for _, way in edges]
            return Solution(
                np.array(p), np.array(w), modes, np.array(parts), broken,
                found=True, apart=True,
            )  # fmt: skip
    return None


def _broken(
    problem: Problem, mu: float, edges: tuple[tuple[Mode, float], ...], p: list[float]
) -> tuple[list[float], float]:
    """Give w of a case, and by what part of its terms it breaks the laws."""
    w, broken = [], 0.0
    for k, (mode, way) in enumerate(edges):
        row, role = problem.D[k].tolist(), problem.roles[k]
        terms = [problem.c.item(k), *(d * x for d, x in zip(row, p, strict=True))]
        w.append(0.0 if mode is Mode.HELD else sum(terms))
        off = 0.0
        if role == Role.SIGNED:
            off = -min(w[k], p[k] * row[k])
        elif role == Role.BOXED:
            bound = problem.limits.item(k) + (mu * max(p[0], 0.0) if k else 0.0)
            off = max((abs(p[k]) - bound) * row[k], w[k] * way)
        if off > 0.0:
            broken = max(broken, off / sum(map(abs, terms)))
    return w, broken


def _hold(
    D: list[list[float]], c: list[float], p: list[float], slope: float, held: list[int]
) -> bool:
    """Complete the multipliers p by those of held rows, unless these are too close.

    slope : by how much p of the second row goes with that of the first.
    """
    if len(held) == 2:
        (a, b), (_, d) = D
        rest = a * d - b * b
        if rest <= CLOSE * a * d:
            return False
        p[0], p[1] = (b * c[1] - d * c[0]) / rest, (b * c[0] - a * c[1]) / rest
    elif held:
        (k,) = held
        own, others = D[k][k], c[k]
        if len(p) == 2:
            others += D[k][1 - k] * p[1 - k]
            own += D[k][1] * slope if k == 0 else 0.0
        if own <= CLOSE * D[k][k]:
            return False
        p[k] = -others / own
        if len(p) == 2 and k == 0:
            p[1] += slope * p[0]
    return True


def _solved(problem: Problem) -> Solution:
    small = _by_edges(problem) if len(problem.c) <= 2 else None
    if small is not None:
        return small
    unit, s = scaled(problem)
    paired = bool(((unit.pairs >= 0) & (unit.roles == Role.BOXED)).any())
    found = _with_discs(unit) if paired else _with_boxes(unit)
    return replace(found, p=found.p * s, w=found.w / s)


def _with_boxes(unit: Problem) -> Solution:
    """Solve it by pivoting.

    Pivots among dependent rows can end without a solution by rounding. Then a little
    more diagonal makes the rows independent, and its force on the solution is taken
    back (proximal points), until the edges are those of the problem itself. At last
    each box is taken to be at its bound, against the speed that it has: what slides
    fast, far beyond all that its forces change, hides from pivoting what they do.
    """
    found = _on_its_edges(unit, unit)
    if found.found:
        return found
    extra = FIRM * unit.D.diagonal()
    p = np.zeros(len(unit.c))
    for _ in range(PROXIMAL):
        firm = replace(unit, D=unit.D + np.diag(extra), c=unit.c - extra * p)
        found = _on_its_edges(firm, unit)
        if found.found:
            return found
        p = found.p
    boxed = unit.roles == Role.BOXED
    roles = np.where(boxed, Role.GIVEN, unit.roles)
    ways = np.where(boxed, -np.sign(unit.c), unit.ways)
    return _on_its_edges(replace(unit, roles=roles, ways=ways), unit)


def _with_discs(unit: Problem) -> Solution:
    """Solve it by Newton's method, whose solution shows the edges."""
    p = by_newton(unit)
    found = _edgeless(unit)
    modes, ways = found.modes, found.ways
    w = unit.D @ p + unit.c
    limits = bounds(unit, p)
    for k, role in enumerate(unit.roles.tolist()):
        n, j = unit.normals[k], unit.pairs[k]
        if role == Role.SIGNED and p[k] > w[k]:
            modes[k] = Mode.HELD
        elif role == Role.BOXED and (n < 0 or modes[n] is Mode.HELD):
            rows = [k] if j < 0 else [k, j]
            z = p[rows] - w[rows]
            size = float(np.linalg.norm(z))
            modes[k] = Mode.HELD if size <= limits[k] else Mode.DRIVEN
            ways[k] = 0.0 if size <= limits[k] else float(z[0]) / size
    # Of dependent rows, equations would choose shares that the discs do not allow.
    return _judged(unit, p, modes, ways)


def _on_its_edges(problem: Problem, exact: Problem) -> Solution:
    """Find the edges of one problem by Lemke's method, and solve another on them."""
    modes = [_STARTS[role] for role in problem.roles.tolist()]
    ways = problem.ways.copy()
    sides = Facets(problem)
    basis = lemke(*sides.matrix())
    if basis is None:
        return _edgeless(exact)
    for k, pushes in zip(sides.signed, basis, strict=False):
        modes[k] = Mode.HELD if pushes else Mode.OFF
    for (k,), (up, down), slips in zip(sides.groups, *sides.split(basis), strict=True):
        held = (up or down) if not slips else (up and down)
        ways[k] = 0.0 if held else float(up) - float(down)
        if held or slips:
            modes[k] = Mode.HELD if held else Mode.DRIVEN
    p = polished(exact, modes, ways)
    p[(exact.roles == Role.SIGNED) & (p < 0.0)] = 0.0
    return _judged(exact, p, modes, ways)


def _judged(problem: Problem, p: Floats, modes: list[Mode], ways: Floats) -> Solution:
    amiss = residual(problem, p)
    w = problem.D @ p + problem.c
    w[[k for k, mode in enumerate(modes) if mode is Mode.HELD]] = 0.0
    return Solution(p, w, modes, ways, amiss, amiss < SOLVED_LAWS)
