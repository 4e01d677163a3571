"""One or two rows: all their edges tried out, in plain numbers.

A bouncing ball asks ten thousand times.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.closed import Mode
from lagsim.mechanics.contact.problem import Problem, Role, Solution

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

# A case that breaks its laws by more, in parts of the terms, is not the one.
ROUNDING = 1e-14
# Determinants below this part of the diagonal: rows that are nearly the same.
DEPENDENT = 1e-8

Case = tuple[Mode, float]

_CASES: dict[Role, tuple[Case, ...]] = {
    Role.ABSENT: ((Mode.OFF, 0.0),),
    Role.SIGNED: ((Mode.HELD, 0.0), (Mode.OFF, 0.0)),
    Role.BOXED: ((Mode.HELD, 0.0), (Mode.DRIVEN, -1.0), (Mode.DRIVEN, 1.0)),
    Role.FREE: ((Mode.HELD, 0.0),),
}


def solve_small(problem: Problem) -> Solution | None:
    """Give the solution, or None where that takes more than plain numbers."""
    D: list[list[float]] = problem.D.tolist()
    if max(problem.pairs) >= 0 or min(D[k][k] for k in range(len(D))) <= 0.0:
        return None
    cases = [
        ((Mode.DRIVEN, way),) if role is Role.GIVEN else _CASES[role]
        for role, way in zip(problem.roles, problem.ways, strict=True)
    ]
    for case in product(*cases):
        p = _on_edges(problem, D, case)
        if p is None:
            continue
        w = [
            0.0 if mode is Mode.HELD else _dot(row, p) + c
            for (mode, _), row, c in zip(case, D, problem.c, strict=True)
        ]
        amiss = max(_amiss(problem, D, p, w, k, way) for k, (_, way) in enumerate(case))
        if amiss <= ROUNDING:
            modes, ways = [mode for mode, _ in case], [way for _, way in case]
            return Solution(np.array(p), np.array(w), modes, ways, amiss, True)
    return None


def _on_edges(
    problem: Problem, D: list[list[float]], case: Sequence[Case]
) -> list[float] | None:
    """Give the multipliers of a case, or None if its rows are not independent."""
    p = [way * limit for (_, way), limit in zip(case, problem.limits, strict=True)]
    slopes = [0.0] * len(p)
    held = [k for k, (mode, _) in enumerate(case) if mode is Mode.HELD]
    for k, (mode, way) in enumerate(case):
        if mode is Mode.DRIVEN and problem.normals[k] in held:
            slopes[k] = way * problem.mus[k]
    if len(held) == 1:
        (k,) = held
        j = 1 - k if len(p) == 2 else k
        own = D[k][k] + (D[k][j] * slopes[j] if j != k else 0.0)
        if own <= DEPENDENT * D[k][k]:
            return None
        p[k] = -(problem.c[k] + (D[k][j] * p[j] if j != k else 0.0)) / own
        if j != k:
            p[j] += slopes[j] * p[k]
    elif held:
        (a, b), (_, d) = D
        c, e = problem.c
        det = a * d - b * b
        if det <= DEPENDENT * a * d:
            return None
        p = [(b * e - d * c) / det, (b * c - a * e) / det]
    return p


def _amiss(
    problem: Problem,
    D: list[list[float]],
    p: list[float],
    w: list[float],
    k: int,
    way: float,
) -> float:
    """Give by what part of its terms a row breaks its law."""
    role, n = problem.roles[k], problem.normals[k]
    terms = abs(problem.c[k]) + _dot(map(abs, D[k]), map(abs, p))
    if not terms:
        return 0.0
    if role is Role.SIGNED:
        return -min(w[k], p[k] * D[k][k], 0.0) / terms
    if role is Role.BOXED:
        bound = problem.limits[k] + (problem.mus[k] * max(p[n], 0.0) if n >= 0 else 0.0)
        return max((abs(p[k]) - bound) * D[k][k], w[k] * way, 0.0) / terms
    return 0.0


def _dot(a: Iterable[float], b: Iterable[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))
