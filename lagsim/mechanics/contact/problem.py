"""Multipliers under one-sided laws and bounds: w = D p + c with a law for each row.

    SIGNED   p >= 0, w >= 0, p w = 0: contacts, freewheels
    BOXED    |p| <= bound; w > 0 only at p = -bound, w < 0 only at p = bound
    GIVEN    p = way * bound
    FREE     w = 0
    ABSENT   p = 0

where bound = limit + mu * p of the row's contact. The box becomes complementary
through its two sides: p = a - b, and with l = |w|

    a >= 0 complements w + l
    b >= 0 complements l - w
    l >= 0 complements bound - a - b

which is copositive for every mu. The rows on their edges, once known, are solved for
again as equations, so that the result is accurate to rounding.

Source: D. E. Stewart, J. C. Trinkle, An implicit time-stepping scheme for rigid body
dynamics with inelastic collisions and Coulomb friction, Int. J. Num. Meth. Eng. 39
(1996) 2673.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.closed import Mode
from lagsim.mechanics.contact.pivoting import lemke

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Floats

# A basis whose residual is larger does not solve the problem.
SOLVED = 1e-7
# Singular values that are smaller belong to dependent rows. D is a square, so that this
# is an angle of 1e-7.
DEPENDENT = 1e-14


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
    """

    p: Floats
    w: Floats
    modes: list[Mode]
    ways: list[float]
    residual: float
    found: bool


def scaled(problem: Problem) -> tuple[Problem, Floats]:
    """Give the problem with a diagonal near 1, by powers of two, and these scales."""
    diagonal = problem.D.diagonal()
    pairs = problem.pairs
    sizes = [
        max(diagonal[k], diagonal[j]) if j >= 0 else diagonal[k]
        for k, j in enumerate(pairs)
    ]
    s = np.array([_power(d) for d in sizes])
    coupled = zip(problem.mus, problem.normals, strict=True)
    roles = [
        role if d > 0.0 else Role.ABSENT
        for role, d in zip(problem.roles, diagonal, strict=True)
    ]
    return Problem(
        problem.D * np.outer(s, s),
        list(s * problem.c),
        roles,
        list(problem.limits / s),
        [m * (s[n] / s[k]) for k, (m, n) in enumerate(coupled)],
        problem.ways,
        problem.normals,
        pairs,
    ), s


def _power(d: float) -> float:
    """Give the power of two near 1/sqrt(d)."""
    return 1.0 if d <= 0.0 else float(2.0 ** -round(np.log2(d) / 2.0))


def bounds(problem: Problem, p: Floats) -> list[float]:
    """Give what the multipliers of boxed and given rows may be."""
    terms = zip(problem.limits, problem.mus, problem.normals, strict=True)
    return [a + mu * max(p[n], 0.0) if n >= 0 else a for a, mu, n in terms]


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
    B = (problem.D[held] @ E)[:, held]
    solve = _by_factor(factor, E, held) if factor is not None else _by_square(B)
    x = np.zeros(len(modes))
    for _ in range(2):
        x[held] -= solve((problem.c + problem.D @ (E @ x + p0))[held])
    return E @ x + p0


def _by_square(B: Floats) -> Callable[[Floats], Floats]:
    return lambda rhs: np.asarray(np.linalg.lstsq(B, rhs, rcond=DEPENDENT)[0], float)


def _by_factor(Y: Floats, E: Floats, held: list[int]) -> Callable[[Floats], Floats]:
    """Solve with B = Y_H^T Y E_H as R^T (Q^T Y E_H), where Y_H = Q R."""
    Q, R = np.linalg.qr(Y[:, held])
    forces = Q.T @ (Y @ E)[:, held]
    return lambda rhs: np.asarray(
        np.linalg.solve(forces, np.linalg.solve(R.T, rhs)), float
    )


def solve(problem: Problem) -> Solution:
    """Solve it by pivoting, and again as equations on the edges where that ends."""
    unit, s = scaled(problem)
    start = [_STARTS[role] for role in unit.roles]
    ways = list(unit.ways)
    found = _by_pivots(unit, start, ways)
    p = polished(unit, start, ways) if found else np.zeros(len(s))
    for k, role in enumerate(unit.roles):
        if role is Role.SIGNED and p[k] < 0.0:
            p[k] = 0.0
    w = unit.D @ p + unit.c
    amiss = residual(unit, p)
    w[[k for k, mode in enumerate(start) if mode is Mode.HELD]] = 0.0
    return Solution(p * s, w / s, start, ways, amiss, found and amiss < SOLVED)


_STARTS = {
    Role.ABSENT: Mode.OFF,
    Role.SIGNED: Mode.OFF,
    Role.BOXED: Mode.OFF,
    Role.GIVEN: Mode.DRIVEN,
    Role.FREE: Mode.HELD,
}


def residual(problem: Problem, p: Floats) -> float:
    """Give how far p (r,) is from what its law makes of p - w, relative to c.

    To be compared with 1 where the problem is scaled.
    """
    w = problem.D @ p + problem.c
    size = max((abs(x) for x in problem.c), default=0.0) or 1.0
    worst = 0.0
    for k, bound in enumerate(bounds(problem, p)):
        role = problem.roles[k]
        if role is Role.SIGNED:
            worst = max(worst, abs(min(p[k], w[k])))
        elif role is Role.FREE:
            worst = max(worst, abs(w[k]))
        elif role is Role.BOXED and problem.pairs[k] < 0:
            worst = max(worst, abs(p[k] - min(max(p[k] - w[k], -bound), bound)))
    return worst / size


def _by_pivots(problem: Problem, modes: list[Mode], ways: list[float]) -> bool:
    """Fill in what the rows do, by Lemke's method; False if there is no solution."""
    signed = [k for k, role in enumerate(problem.roles) if role is Role.SIGNED]
    boxed = [k for k, role in enumerate(problem.roles) if role is Role.BOXED]
    unknown = signed + boxed
    G, h = _reduced(problem, unknown)
    n, m = len(signed), len(boxed)
    M = np.zeros((n + 3 * m, n + 3 * m))
    q = np.zeros(n + 3 * m)
    a, b, side = slice(n, n + m), slice(n + m, n + 2 * m), slice(n + 2 * m, None)
    M[: n + m, : n + m] = G
    M[: n + m, b] = -G[:, n:]
    M[b] = -M[a]
    M[a, side] = M[b, side] = np.eye(m)
    M[side, a] = M[side, b] = -np.eye(m)
    q[: n + m], q[b] = h, -h[n:]
    place = {k: i for i, k in enumerate(signed)}
    for i, k in enumerate(boxed):
        q[n + 2 * m + i] = problem.limits[k]
        if problem.normals[k] in place:
            M[n + 2 * m + i, place[problem.normals[k]]] = problem.mus[k]
    basis = lemke(M, q)
    if basis is None:
        return False
    for i, k in enumerate(signed):
        modes[k] = Mode.HELD if basis[i] else Mode.OFF
    for k, up, down, slips in zip(boxed, basis[a], basis[b], basis[side], strict=True):
        held = (up or down) if not slips else (up and down)
        ways[k] = 0.0 if held else float(up) - float(down)
        if held or slips:
            modes[k] = Mode.HELD if held else Mode.DRIVEN
    return True


def _reduced(problem: Problem, unknown: list[int]) -> tuple[Floats, Floats]:
    """Give G, h: w = G p + h of the unknown rows, what is given and free put in."""
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
