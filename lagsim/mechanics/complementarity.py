"""Complementarity: multipliers of w = D p + c with a law for each row.

    SIGNED   p >= 0, w >= 0, p w = 0: contacts, freewheels
    BOXED    |p| <= bound; w > 0 only at p = -bound, w < 0 only at p = bound
    GIVEN    p = direction * bound
    FREE     w = 0
    ABSENT   p = 0

where the bound of a slip is its size, mu, times p of its contact, and that of another
row its size. Two slips share a bound: on a disc.

Pivoting says which rows hold; these are solved for again as equations, so that the
result is accurate to rounding. There friction is a complementarity problem too: along
directions d_i that span the slips of a contact, p = sum of a_i d_i with a >= 0, and
with l for the size of the slip

    a_i >= 0 complements d_i . w + l
    l >= 0 complements bound - sum of a_i

which is copositive for every mu: there is a solution, and Lemke's method finds it. It
goes along edges from a point where an artificial variable makes all q >= 0. Ties are
broken lexicographically, so that it cannot run in circles: on degenerate problems too
(balls that touch at rest, redundant legs) it ends. For one slip, with the directions 1
and -1, that is Coulomb's law; for two it has corners.

A disc has no sides: there Newton's method says which rows hold. Each law is an
equation: p is what the projection onto its bounds makes of p - w. The equations have
kinks but slopes on each side of them. Sweeps of projections, contact by contact, come
near the solution from anywhere; Newton's steps end there.

Sources: D. E. Stewart, J. C. Trinkle, An implicit time-stepping scheme for rigid body
dynamics with inelastic collisions and Coulomb friction, Int. J. Num. Meth. Eng. 39
(1996) 2673; R. W. Cottle, J.-S. Pang, R. E. Stone, The Linear Complementarity Problem
(1992), sections 4.4 and 4.9; P. Alart, A. Curnier, A mixed formulation for frictional
contact problems prone to Newton like solution methods, Comput. Methods Appl. Mech. Eng.
92 (1991) 353; the sweeps: M. Jean, The non-smooth contact dynamics method, ibid. 177
(1999) 235.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.sparse import DisjointSets
from lagsim.tolerances import (
    CONVERGED,
    DEPENDENT_SQUARE,
    RESIDUAL_ROUNDOFF,
    SOLUTION_ROUNDOFF,
    SOLVED_LAWS,
    TABLEAU_ROUNDOFF,
    TERM_ROUNDOFF,
)

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats, Ints


class Mode(IntEnum):
    """Mode of a row."""

    OFF = 0  # no multiplier
    HELD = 1  # an equality with its multiplier
    SLIDING = 2  # not held: the multiplier has the size of its bound
    REDUNDANT = 3  # it holds because others do


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
    c, sizes, directions : ndarray, shape (r,)
        Of a slip the size is its friction coefficient, of what is limited its bound.
    roles : ndarray of int, shape (r,)
        A `Role` each.
    normals, pairs : ndarray of int, shape (r,)
        The row of the contact; that of the other of two slips; or -1.
    """

    D: Floats
    c: Floats
    roles: Ints
    sizes: Floats
    directions: Floats
    normals: Ints
    pairs: Ints

    def part(self, rows: list[int]) -> Problem:
        """Problem of some rows, of which none is coupled with another."""
        place = np.full(len(self.c) + 1, -1)  # the last for those that have none
        place[rows] = np.arange(len(rows))
        return Problem(
            self.D[np.ix_(rows, rows)], self.c[rows], self.roles[rows],
            self.sizes[rows], self.directions[rows],
            place[self.normals[rows]], place[self.pairs[rows]],
        )  # fmt: skip

    def rows(self, role: int) -> list[int]:
        """Rows of a role."""
        found: list[int] = np.flatnonzero(self.roles == role).tolist()
        return found

    def group(self, k: int) -> list[int]:
        """Row k, with the other of two slips."""
        return [k] if self.pairs[k] < 0 else [self.pairs.item(k), k]

    def bounds(self, p: Floats) -> Floats:
        """Return what the multipliers of boxed and given rows may be (r,)."""
        n = self.normals
        return self.sizes * np.where(n >= 0, np.maximum(p[n], 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class Solution:
    """Multipliers p and w = D p + c (r,), and what each row does.

    Attributes
    ----------
    modes : list of Mode
    directions : ndarray, shape (r,)
        Of a sliding row: the part of its bound.
    found : bool
        A solution at all.
    apart : bool
        One or two rows, which are far from being dependent.
    """

    p: Floats
    w: Floats
    modes: list[Mode]
    directions: Floats
    found: bool
    apart: bool = False


def solve(problem: Problem) -> Solution:
    """Multipliers that obey the laws, and what each row does.

    Rows that nothing couples are problems of their own: what is rounding in one of them
    may be a rate that counts in another.
    """
    groups = _decoupled(problem) if len(problem.c) > 1 else []
    if len(groups) <= 1:
        return _solved(problem)
    whole = _unsolved(problem)
    found = True
    for rows in groups:
        own = _solved(problem.part(rows))
        whole.p[rows], whole.w[rows] = own.p, own.w
        whole.directions[rows] = own.directions
        for k, mode in zip(rows, own.modes, strict=True):
            whole.modes[k] = mode
        found = found and own.found
    return replace(whole, found=found)


def _decoupled(problem: Problem) -> list[list[int]]:
    """Rows in groups that have no entry of D and no bound in common."""
    sets = DisjointSets(len(problem.c))
    for i, j in np.argwhere(problem.D).tolist():
        sets.merge(i, j)
    for others in (problem.normals, problem.pairs):
        for k, j in enumerate(others.tolist()):
            if j >= 0:
                sets.merge(k, j)
    return sets.sets()


def _solved(problem: Problem) -> Solution:
    small = _by_cases(problem) if len(problem.c) <= 2 else None
    if small is not None:
        return small
    unit, s = _scaled(problem)
    paired = bool(((unit.pairs >= 0) & (unit.roles == Role.BOXED)).any())
    found = _with_discs(unit) if paired else _with_boxes(unit)
    return replace(found, p=found.p * s, w=found.w / s)


def _scaled(problem: Problem) -> tuple[Problem, Floats]:
    """Problem with a diagonal near 1, by powers of two, and these scales."""
    own, pairs, n = problem.D.diagonal(), problem.pairs, problem.normals
    most = np.where(pairs >= 0, np.maximum(own, own[pairs]), own)
    present = most > 0.0
    s = 2.0 ** -np.round(np.log2(np.where(present, most, 1.0)) / 2.0)
    return replace(
        problem,
        D=problem.D * s * s[:, None],
        c=s * problem.c,
        roles=np.where(present, problem.roles, Role.ABSENT),
        sizes=problem.sizes * np.where(n >= 0, s[n], 1.0) / s,
    ), s


_STARTS = {
    Role.ABSENT: Mode.OFF,
    Role.SIGNED: Mode.OFF,
    Role.BOXED: Mode.OFF,
    Role.GIVEN: Mode.SLIDING,
    Role.FREE: Mode.HELD,
}


def _unsolved(problem: Problem) -> Solution:
    """Return what there is where nothing is known: no multipliers, and no solution."""
    modes = [_STARTS[role] for role in problem.roles.tolist()]
    p, w = np.zeros(len(modes)), problem.c.copy()
    return Solution(p, w, modes, problem.directions.copy(), found=False)


def _judged(
    problem: Problem, p: Floats, modes: list[Mode], directions: Floats
) -> Solution:
    w = problem.D @ p + problem.c
    w[[k for k, mode in enumerate(modes) if mode is Mode.HELD]] = 0.0
    return Solution(p, w, modes, directions, _residual(problem, p) < SOLVED_LAWS)


def _residual(problem: Problem, p: Floats) -> float:
    """Residual of p (r,): its distance from the projection of p - w.

    Relative to the largest terms of w; to be asked where the problem is scaled.
    """
    w, roles, pairs = problem.D @ p + problem.c, problem.roles, problem.pairs
    terms = np.abs(problem.D) @ np.abs(p) + np.abs(problem.c)
    z = p - w
    lengths = np.where(pairs >= 0, np.hypot(z, z[pairs]), np.abs(z))
    parts = problem.bounds(p) / np.where(lengths > 0.0, lengths, 1.0)
    off = np.where(roles == Role.SIGNED, np.minimum(p, w), 0.0)
    off = np.where(roles == Role.FREE, w, off)
    off = np.where(roles == Role.BOXED, p - z * np.minimum(1.0, parts), off)
    return float(np.abs(off).max(initial=0.0) / (terms.max(initial=0.0) or 1.0))


# --- rows that hold, as equations -----------------------------------------------------


def expressed(
    problem: Problem, modes: list[Mode], directions: Floats
) -> tuple[Floats, Floats]:
    """E (r, r), p0 (r,): p = E x + p0, where x are multipliers of held rows."""
    r = len(modes)
    E, p0 = np.zeros((r, r)), np.zeros(r)
    for k, mode in enumerate(modes):
        if mode is Mode.HELD:
            E[k, k] = 1.0
        elif directions[k] and mode is not Mode.OFF:
            n, part = problem.normals[k], directions[k] * problem.sizes[k]
            if n < 0:
                p0[k] = part
            elif modes[n] is Mode.HELD:
                E[k, n] = part
    return E, p0


def polished(
    problem: Problem,
    modes: list[Mode],
    directions: Floats,
    factor: Floats | None = None,
) -> Floats:
    """Multipliers (r,) for which the held rows hold.

    With the factor (k, r) of D, nearly dependent rows cost only the digits they must:
    B = Y_H^T Y E_H is solved with as R^T (Q^T Y E_H), where Y_H = Q R.
    """
    E, p0 = expressed(problem, modes, directions)
    held = [k for k, mode in enumerate(modes) if mode is Mode.HELD]
    if not held:
        return p0
    D = problem.D[held]
    B, h = (D @ E)[:, held], problem.c[held] + D @ p0
    if factor is not None:
        Q, R = np.linalg.qr(factor[:, held])
        forces = Q.T @ (factor @ E)[:, held]

    def solved(right: Floats) -> Floats:
        if factor is None:
            return least_squares(B, right)
        return least_squares(forces, np.linalg.solve(R.T, right))

    x = -solved(h)
    x -= solved(B @ x + h)
    return E[:, held] @ x + p0


def least_squares(B: Floats, right: Floats) -> Floats:
    """Solve B x = right, where rows of a Delassus matrix may be dependent."""
    return np.asarray(np.linalg.lstsq(B, right, rcond=DEPENDENT_SQUARE)[0], float)


# --- one or two rows ------------------------------------------------------------------

# They have so few edges that all are tried, in plain numbers: most impacts are of
# these. A case that breaks its laws by more than their terms round is not the one; rows
# that leave less than this part of themselves ask for more than Cramer's rule.
CLOSE = 1e-2
_CASES = {
    Role.ABSENT: ((Mode.OFF, 0.0),),
    Role.SIGNED: ((Mode.HELD, 0.0), (Mode.OFF, 0.0)),
    Role.BOXED: ((Mode.HELD, 0.0), (Mode.SLIDING, -1.0), (Mode.SLIDING, 1.0)),
    Role.FREE: ((Mode.HELD, 0.0),),
}


def _by_cases(problem: Problem) -> Solution | None:
    """Solution of one or two rows, or None where that takes more."""
    count, D = len(problem.c), problem.D.tolist()
    if problem.pairs.max() >= 0 or problem.D.diagonal().min() <= 0.0:
        return None
    c, limits = problem.c.tolist(), problem.sizes.tolist()
    directions = problem.directions.tolist()
    mu = 0.0
    if count == 2 and problem.normals[1] == 0:
        mu, limits[1] = limits[1], 0.0
    choices = [
        ((Mode.SLIDING, directions[k]),) if role == Role.GIVEN else _CASES[role]
        for k, role in enumerate(problem.roles.tolist())
    ]
    for case in product(*choices):
        held = [k for k, (mode, _) in enumerate(case) if mode is Mode.HELD]
        p = [d * limit for (_, d), limit in zip(case, limits, strict=True)]
        slope = case[-1][1] * mu  # of the second one, by the first
        if not _hold(D, c, p, slope, held):
            continue
        w, broken = _broken(problem, limits, mu, case, p)
        if broken <= RESIDUAL_ROUNDOFF:
            modes = [mode for mode, _ in case]
            rows = np.array([p, w, [d for _, d in case]])
            return Solution(rows[0], rows[1], modes, rows[2], found=True, apart=True)
    return None


def _broken(
    problem: Problem,
    limits: list[float],
    mu: float,
    case: tuple[tuple[Mode, float], ...],
    p: list[float],
) -> tuple[list[float], float]:
    """Return w of a case, and by what part of its terms it breaks the laws."""
    w, broken = [], 0.0
    for k, (mode, direction) in enumerate(case):
        row, role = problem.D[k].tolist(), problem.roles[k]
        terms = [problem.c.item(k), *(d * x for d, x in zip(row, p, strict=True))]
        w.append(0.0 if mode is Mode.HELD else sum(terms))
        off = 0.0
        if role == Role.SIGNED:
            off = -min(w[k], p[k] * row[k])
        elif role == Role.BOXED:
            bound = limits[k] + (mu * max(p[0], 0.0) if k else 0.0)
            off = max((abs(p[k]) - bound) * row[k], w[k] * direction)
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


# --- pivoting -------------------------------------------------------------------------

# How much diagonal is added where pivoting fails, and how often.
FIRM = 1e-6
PROXIMAL = 2
# Pivots for each row; a few times the number of rows is what it needs in practice.
PATIENCE = 50


def _with_boxes(unit: Problem) -> Solution:
    """Solve it by pivoting.

    Pivots among dependent rows can end without a solution by rounding. Then a little
    more diagonal makes the rows independent, and its force on the solution is taken
    back (proximal points), until the edges are those of the problem itself. At last
    each box is taken to be at its bound, against the speed that it has: what slides
    fast, far beyond all that its forces change, hides from pivoting what they do.
    """
    found = _on_its_edges(unit, unit)
    extra = FIRM * unit.D.diagonal()
    p = np.zeros(len(unit.c))
    for _ in range(PROXIMAL):
        if found.found:
            return found
        firm = replace(unit, D=unit.D + np.diag(extra), c=unit.c - extra * p)
        found = _on_its_edges(firm, unit)
        p = found.p
    if found.found:
        return found
    boxed = unit.roles == Role.BOXED
    roles = np.where(boxed, Role.GIVEN, unit.roles)
    directions = np.where(boxed, -np.sign(unit.c), unit.directions)
    return _on_its_edges(replace(unit, roles=roles, directions=directions), unit)


def _on_its_edges(problem: Problem, exact: Problem) -> Solution:
    """Find the edges of one problem by Lemke's method, and solve another on them."""
    signed, boxed = problem.rows(Role.SIGNED), problem.rows(Role.BOXED)
    n, m = len(signed), len(boxed)
    M, q, _ = _pivots(problem, signed, [[k] for k in boxed])
    basis = lemke(M, q)
    if basis is None:
        return _unsolved(exact)
    start = _unsolved(problem)
    modes, directions = start.modes, start.directions
    for k, pushes in zip(signed, basis, strict=False):
        modes[k] = Mode.HELD if pushes else Mode.OFF
    ends, slips = basis[n : n + 2 * m].reshape(m, 2), basis[n + 2 * m :]
    for k, (up, down), slides in zip(boxed, ends.tolist(), slips, strict=True):
        held = (up or down) if not slides else (up and down)
        directions[k] = 0.0 if held else float(up) - float(down)
        if held or slides:
            modes[k] = Mode.HELD if held else Mode.SLIDING
    p = polished(exact, modes, directions)
    p[(exact.roles == Role.SIGNED) & (p < 0.0)] = 0.0
    return _judged(exact, p, modes, directions)


# Directions of a slip; of two, a disc is replaced by a polygon of so many corners.
CORNERS = 8
SIDES = np.array([[1.0], [-1.0]])
ANGLES = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
POLYGON = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


def _pivots(
    problem: Problem, signed: list[int], groups: list[list[int]]
) -> tuple[Floats, Floats, Floats]:
    """M and q: of signed rows, of the directions of slips, of their sizes l.

    And N: p of the signed rows and of the slips, group by group, = N a.
    """
    spans = [SIDES if len(group) == 1 else POLYGON for group in groups]
    n, rows = len(signed), signed + [k for group in groups for k in group]
    owners = np.repeat(np.eye(len(groups)), list(map(len, spans)), axis=0)
    first = n + len(owners)
    N = np.zeros((len(rows), first))
    N[:n, :n] = np.eye(n)
    i = j = n
    for d in spans:
        N[i : i + d.shape[1], j : j + len(d)] = d.T
        i, j = i + d.shape[1], j + len(d)
    G, h = _reduced(problem, rows)
    M = np.zeros((first + len(groups),) * 2)
    q = np.zeros(len(M))
    M[:first, :first] = N.T @ G @ N
    q[:first] = N.T @ h
    M[n:first, first:], M[first:, n:first] = owners, -owners.T
    place = {k: i for i, k in enumerate(signed)}
    for i, (k, *_) in enumerate(groups, first):
        if problem.normals[k] < 0:
            q[i] = problem.sizes[k]
        elif problem.normals[k] in place:
            M[i, place[problem.normals[k]]] = problem.sizes[k]
    return M, q, N


def _reduced(problem: Problem, unknown: list[int]) -> tuple[Floats, Floats]:
    """G, h: w = G p + h of the unknown rows, what is given and free put in."""
    some = np.ix_(unknown, unknown)
    if len(unknown) == len(problem.c):
        return problem.D[some], problem.c[unknown]
    present = [_STARTS[role] for role in problem.roles.tolist()]
    for k in unknown:
        present[k] = Mode.HELD
    E, p0 = expressed(problem, present, problem.directions)
    G, h = problem.D @ E, problem.c + problem.D @ p0
    free = problem.rows(Role.FREE)
    if not free:
        return G[some], h[unknown]
    B = np.column_stack([G[np.ix_(free, unknown)], h[free]])
    taken = G[np.ix_(unknown, free)] @ least_squares(G[np.ix_(free, free)], B)
    return G[some] - taken[:, :-1], h[unknown] - taken[:, -1]


class _Tableau:
    """basic + T nonbasic = rhs; labels: w_i is i, z_i is n + i, the artificial 2 n."""

    def __init__(self, M: Floats, q: Floats) -> None:
        n = self.n = len(q)
        self.T = np.empty((n, n + 2))
        self.T[:, :n] = -M
        self.T[:, n] = -1.0
        self.T[:, n + 1] = q
        self.basic = list(range(n))
        self.column = {n + j: j for j in range(n + 1)}

    def exchange(self, row: int, entering: int) -> int:
        """Make a variable basic in a row; return the one that leaves it."""
        T, col = self.T, self.column.pop(entering)
        leaving = self.basic[row]
        inverse = 1.0 / T[row, col]
        pivot_row = T[row] * inverse
        pivot_row[col] = inverse
        factors = T[:, col].copy()
        factors[row] = 0.0
        T[:, col] = 0.0
        T -= factors[:, None] * pivot_row
        T[row] = pivot_row
        self.basic[row] = entering
        self.column[leaving] = col
        return leaving

    def order(self, row: int, scale: float) -> list[int]:
        """Return what decides between tied rows: that of the inverse of the basis."""
        column, basic, T = self.column, self.basic[row], self.T[row].tolist()
        entries = [
            T[column[j]] if j in column else float(basic == j) for j in range(self.n)
        ]
        return [round(x / scale / SOLUTION_ROUNDOFF) for x in entries]

    def leaving_row(self, entering: int) -> int:
        """Row that blocks first, or -1 if none does."""
        col: list[float] = self.T[:, self.column[entering]].tolist()
        rhs: list[float] = self.T[:, -1].tolist()
        ratios = {
            i: max(x, 0.0) / a
            for i, (a, x) in enumerate(zip(col, rhs, strict=True))
            if a > TABLEAU_ROUNDOFF
        }
        if not ratios:
            return -1
        most = min(ratios.values()) * (1.0 + SOLUTION_ROUNDOFF) + SOLUTION_ROUNDOFF
        tied = [i for i, ratio in ratios.items() if ratio <= most]
        if len(tied) == 1:
            return tied[0]
        for i in tied:
            if self.basic[i] == 2 * self.n:
                return i
        return min(tied, key=lambda i: self.order(i, col[i]))


def lemke(M: Floats, q: Floats) -> Flags | None:
    """Solve w = M z + q; w, z >= 0; w z = 0 by Lemke's method.

    Give which z are basic in a solution, or None where a ray is all there is.

    Parameters
    ----------
    M : ndarray, shape (n, n)
        With entries near 1: scaled.
    q : ndarray, shape (n,)

    Raises
    ------
    FloatingPointError
        Where q is not finite.
    """
    n = len(q)
    size = float(np.abs(q).max(initial=0.0))
    if not np.isfinite(size):
        raise FloatingPointError("forces that are not finite")
    basis = np.zeros(n, dtype=bool)
    if not n or float(q.min()) >= 0.0:
        return basis
    tableau = _Tableau(M, q / size)
    least = np.flatnonzero(
        tableau.T[:, -1] <= tableau.T[:, -1].min() + SOLUTION_ROUNDOFF
    )
    leaving = tableau.exchange(int(least[-1]), 2 * n)
    for _ in range(PATIENCE * n):
        entering = leaving + n if leaving < n else leaving - n
        row = tableau.leaving_row(entering)
        if row < 0:
            return None
        leaving = tableau.exchange(row, entering)
        if leaving == 2 * n:
            basis[[label - n for label in tableau.basic if label >= n]] = True
            return basis
    return None


# --- Newton's method ------------------------------------------------------------------

# Sweeps before Newton's method, and before the last attempt.
SWEEPS, MOST_SWEEPS = 10, 500
# The diagonal added to D, whose own is 1, and how often its force is taken back.
FIRM_ON_DISCS = 1e-2
PROXIMAL_ON_DISCS = 8
# Newton's steps; near the solution it takes about five.
STEPS = 30
# Of a Newton step, the parts that are tried.
PARTS = (1.0, 0.5, 0.25, 0.0625)
# Steps longer than this, in parts of what they mend, are those of dependent rows.
FAR = 1e8


def _with_discs(unit: Problem) -> Solution:
    """Solve it by Newton's method, whose solution shows the edges."""
    p = _by_newton(unit)
    found = _unsolved(unit)
    modes, directions = found.modes, found.directions
    w = unit.D @ p + unit.c
    limits = unit.bounds(p)
    for k, role in enumerate(unit.roles.tolist()):
        n, j = unit.normals[k], unit.pairs[k]
        if role == Role.SIGNED and p[k] > w[k]:
            modes[k] = Mode.HELD
        elif role == Role.BOXED and (n < 0 or modes[n] is Mode.HELD):
            rows = [k] if j < 0 else [k, j]
            z = p[rows] - w[rows]
            size = float(np.linalg.norm(z))
            modes[k] = Mode.HELD if size <= limits[k] else Mode.SLIDING
            directions[k] = 0.0 if size <= limits[k] else float(z[0]) / size
    # Of dependent rows, equations would choose shares that the discs do not allow.
    return _judged(unit, p, modes, directions)


def _by_newton(problem: Problem) -> Floats:
    """Multipliers p (r,) of a scaled problem, the best ones found."""
    limits = problem.sizes[(problem.normals < 0) & (problem.roles != Role.ABSENT)]
    size = max(float(np.abs(problem.c).max()), limits.max(initial=0.0)) or 1.0
    best, least = np.zeros(len(problem.c)), np.inf
    long = partial(_swept, sweeps=MOST_SWEEPS)
    for start in (_swept, _proximal, _from_corners, long):
        p, amiss = _descend(problem, start(problem))
        if amiss < least:
            best, least = p, amiss
        if least <= CONVERGED * size:
            break
    return best


def _from_corners(problem: Problem) -> Floats:
    """Multipliers (r,) where discs are polygons; 0 where there are none."""
    signed, boxed = problem.rows(Role.SIGNED), problem.rows(Role.BOXED)
    groups = [problem.group(k) for k in boxed if problem.pairs[k] < k]
    M, q, N = _pivots(problem, signed, groups)
    basis, p, a = lemke(M, q), np.zeros(len(problem.c)), np.zeros(len(q))
    if basis is not None:
        a[basis] = least_squares(M[np.ix_(basis, basis)], -q[basis])
        p[signed + [k for group in groups for k in group]] = N @ a[: N.shape[1]]
    return p


def _proximal(problem: Problem) -> Floats:
    """Make dependent rows independent by more diagonal, and take its force back."""
    firm = problem.D + FIRM_ON_DISCS * np.eye(len(problem.c))
    p = np.zeros(len(problem.c))
    for _ in range(PROXIMAL_ON_DISCS):
        pushed = problem.c - FIRM_ON_DISCS * p
        p, _ = _descend(replace(problem, D=firm, c=pushed), p)
    return p


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
        step = np.linalg.lstsq(J, -F, rcond=TERM_ROUNDOFF)[0]
    return np.asarray(step, float)


def equations(problem: Problem, p: Floats) -> tuple[Floats, Floats]:
    """F (r,), zero at solutions, and its slopes (r, r)."""
    D, r = problem.D, len(p)
    w = D @ p + problem.c
    unit_rows = np.eye(r)
    F, J = p.copy(), np.eye(r)
    limits = problem.bounds(p)
    for k, role in enumerate(problem.roles.tolist()):
        n, bound = problem.normals[k], limits[k]
        slope = problem.sizes[k] if n >= 0 and p[n] > 0.0 else 0.0
        if role == Role.GIVEN:
            F[k] -= problem.directions[k] * bound
            J[k, n] -= problem.directions[k] * slope
        elif role == Role.FREE or (role == Role.SIGNED and p[k] > w[k]):
            F[k], J[k] = w[k], D[k]
        elif role == Role.BOXED and problem.pairs[k] < k:
            rows = problem.group(k)
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


def _swept(problem: Problem, sweeps: int = SWEEPS) -> Floats:
    """Project row by row, each with what the earlier ones have become."""
    p = np.zeros(len(problem.c))
    for _ in range(sweeps):
        before = p.copy()
        for k, role in enumerate(problem.roles.tolist()):
            _project(problem, k, role, p)
        if np.abs(p - before).max() <= TERM_ROUNDOFF * np.abs(p).max():
            break
    return p


def _project(problem: Problem, k: int, role: int, p: Floats) -> None:
    """Replace p of a row, or of the two of a disc, by its projection."""
    D, c = problem.D, problem.c
    if role == Role.SIGNED:
        p[k] = max(0.0, p[k] - (D[k] @ p + c[k]) / D[k, k])
    elif role == Role.FREE:
        p[k] -= (D[k] @ p + c[k]) / D[k, k]
    elif role == Role.GIVEN:
        p[k] = problem.directions[k] * problem.bounds(p)[k]
    elif role == Role.BOXED and problem.pairs[k] < k:
        rows = problem.group(k)
        a, b, d = D[rows[0], rows[0]], D[rows[0], k], D[k, k]
        stiff = a if len(rows) == 1 else (a + d + np.hypot(a - d, 2.0 * b)) / 2.0
        z = p[rows] - (D[rows] @ p + c[rows]) / stiff
        p[rows] = z * min(1.0, problem.bounds(p)[k] / (np.linalg.norm(z) or 1.0))
