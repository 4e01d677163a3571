"""Solve for the multipliers of rows under laws.

Pivoting says which rows hold; these are solved for again as equations, so that the
result is accurate to rounding. A disc has no sides: there Newton's method says it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.disjoint_sets import DisjointSets
from lagsim.mechanics.contact.closed import Mode
from lagsim.mechanics.contact.facets import Facets
from lagsim.mechanics.contact.newton import by_newton
from lagsim.mechanics.contact.pivoting import lemke
from lagsim.mechanics.contact.polish import polished
from lagsim.mechanics.contact.problem import (
    Problem,
    Role,
    Solution,
    bounds,
    residual,
    scaled,
)
from lagsim.mechanics.contact.small import solve_small

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

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
