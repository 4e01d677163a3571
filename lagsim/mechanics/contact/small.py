"""One or two rows: all their edges tried out, in plain numbers.

A bouncing ball asks ten thousand times.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from lagsim.mechanics.contact.closed import Mode
from lagsim.mechanics.contact.problem import Problem, Role, Solution

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
