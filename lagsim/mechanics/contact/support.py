"""Contacts that bear without need, where discs leave no corner to pivot to.

A box on four legs can lose any leg on whose side its weight is not. Legs are taken away
until those that are left are independent, as long as friction allows it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.contact.independent import Span
from lagsim.mechanics.contact.problem import Problem, Role, Solution
from lagsim.mechanics.contact.solving import solve

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.closed import Closed


def on_discs(problem: Problem) -> bool:
    """Tell whether slips share a disc and are not known to slide."""
    rows = zip(problem.roles, problem.pairs, strict=True)
    return any(role is Role.BOXED and j >= 0 for role, j in rows)


def supported(
    closed: Closed, problem: Problem, solution: Solution, quiet: Floats
) -> Solution:
    """Give a solution in which the contacts that bear are independent, if there is one.

    All rows keep their accelerations within quiet (r,).
    """
    while True:
        for k in _spare(closed, problem, solution):
            less = solve(_without(problem, k))
            full = closed.D @ less.p + problem.c
            if less.found and (np.abs(full - solution.w) <= quiet).all():
                solution = replace(less, w=full)
                problem = _without(problem, k)
                break
        else:
            return solution


def _spare(closed: Closed, problem: Problem, solution: Solution) -> list[int]:
    """Give the contacts that end first where forces change along a dependence."""
    p = solution.p
    bear = [k for k, r in enumerate(problem.roles) if r is Role.SIGNED and p[k] > 0.0]
    span = Span(closed)
    if all(span.takes(k) for k in bear):
        return []
    s = np.sqrt(closed.D.diagonal()[bear])
    z = np.linalg.svd(span.units[:, bear])[2][-1] / s
    ends = []
    for way in (z, -z):
        falls = way < -np.abs(z).max() * span.least
        parts = np.where(falls, p[bear] / np.where(falls, -way, 1.0), np.inf)
        if np.isfinite(parts.min()):
            ends.append(bear[int(parts.argmin())])
    return sorted(ends, key=lambda k: float(p[k]))


def _without(problem: Problem, normal: int) -> Problem:
    away = [k == normal or n == normal for k, n in enumerate(problem.normals)]
    roles = [
        Role.ABSENT if gone else role
        for gone, role in zip(away, problem.roles, strict=True)
    ]
    return replace(problem, roles=roles)
