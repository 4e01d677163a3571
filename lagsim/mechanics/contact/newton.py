"""Friction on a disc: two slips whose force is bounded together, by Newton's method.

Each law is an equation: p is what the projection onto its bounds makes of p - w. The
equations have kinks but slopes on each side of them. Sweeps of projections, contact by
contact, come near the solution from anywhere; Newton's steps end there.

Source: P. Alart, A. Curnier, A mixed formulation for frictional contact problems prone
to Newton like solution methods, Comput. Methods Appl. Mech. Eng. 92 (1991) 353; the
sweeps: M. Jean, The non-smooth contact dynamics method, ibid. 177 (1999) 235.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.facets import with_corners
from lagsim.mechanics.contact.problem import Problem, Role, bounds

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# Sweeps before Newton's method, and before the last attempt.
SWEEPS = (10, 500)
# The diagonal added to D, whose own is 1, and how often its force is taken back.
FIRM = 1e-2
PROXIMAL = 8
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
    firm = problem.D + FIRM * np.eye(len(problem.c))
    p = np.zeros(len(problem.c))
    for _ in range(PROXIMAL):
        pushed = list(np.asarray(problem.c) - FIRM * p)
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
