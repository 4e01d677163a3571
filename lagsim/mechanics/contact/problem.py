"""Multipliers under one-sided laws and bounds: w = D p + c with a law for each row.

    SIGNED   p >= 0, w >= 0, p w = 0: contacts, freewheels
    BOXED    |p| <= bound; w > 0 only at p = -bound, w < 0 only at p = bound
    GIVEN    p = way * bound
    FREE     w = 0
    ABSENT   p = 0

where bound = limit + mu * p of the row's contact. Two slips share a bound: on a disc.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.closed import Mode


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
