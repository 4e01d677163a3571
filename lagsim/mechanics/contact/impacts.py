"""Impacts: impulses by Newton's law of restitution and Coulomb's of friction.

The rate of each contact after the impact is at least -e times the one before, and is
that where there is an impulse. All contacts that touch share one impact, at one time:
where they act on each other, another order of impacts would end in other rates.

Where a series of impacts is taken as one, a contact may have to pull in it: the series
ends with it at rest, and what held it down meanwhile (its weight) is part of no impact.
Its friction is in proportion, of either sign, so that what slides one way all the time
loses what it does by the impulses of the series and of the weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact.complementarity import (
    Problem,
    Role,
    Solution,
    indices,
    solve,
)
from lagsim.tolerances import DECOUPLED, SOLVED_LAWS

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.contact.complementarity import Closed


_ROLES = {
    Kind.CONTACT: Role.SIGNED,
    Kind.FREEWHEEL: Role.SIGNED,
    Kind.SLIP: Role.BOXED,
    Kind.LIMITED: Role.ABSENT,
    Kind.TIMED: Role.FREE,
}


@dataclass(frozen=True, slots=True)
class Impact:
    """What an impact does.

    Attributes
    ----------
    impulses : ndarray, shape (r,)
    after : ndarray, shape (r,)
        The rates.
    residual : float
        Of the laws, relative to the rates.
    open : bool
        Another order of the impacts would end elsewhere: a choice of this law.
    energy : float
        The change of the kinetic energy, seen from what is struck.
    found : bool
        False where the laws contradict each other (a body that is crushed).
    """

    impulses: Floats
    after: Floats
    residual: float
    open: bool
    energy: float
    found: bool = True


def impact(closed: Closed, rates: Floats, noise: Floats) -> Impact:
    """Give the impulses at rates (r,); what is smaller than noise (r,) counts as 0.

    Newton's targets of contacts that are locked into each other may contradict; such
    an impact is inelastic. A contact that is `TIMED` is stopped, whatever it takes.
    """
    if len(rates) == 1 and _ROLES[closed.kinds[0]] is Role.SIGNED:
        return _alone(closed, float(rates[0]), float(noise[0]))
    before = np.where(np.abs(rates) <= noise, 0.0, rates)
    terms = zip(
        closed.kinds, closed.restitutions.tolist(), before.tolist(), strict=True
    )
    target = np.array(
        [-e * v if kind is Kind.CONTACT and v < 0.0 else 0.0 for kind, e, v in terms]
    )
    solution = _solved(closed, before - target)
    locked = not solution.found and bool(target.any())
    if locked:
        target = np.zeros(len(before))
        solution = _solved(closed, before)
    p, after = solution.p, solution.w + target
    return Impact(
        p,
        after,
        solution.residual,
        locked or _is_open(closed, before, p),
        float(p @ (before + after)) / 2.0,
        solution.found,
    )


def _alone(closed: Closed, rate: float, noise: float) -> Impact:
    """Give the impulse of one contact by itself."""
    own, e = float(closed.D[0, 0]), float(closed.restitutions[0])
    before = 0.0 if abs(rate) <= noise else rate
    bounces = closed.kinds[0] is Kind.CONTACT and before < 0.0
    target = -e * before if bounces else 0.0
    p = max((target - before) / own, 0.0) if own > 0.0 else 0.0
    after = before + own * p
    asked, missed = abs(before - target), max(target - after, 0.0)
    residual = missed / asked if asked > 0.0 else 0.0
    energy = p * (before + after) / 2.0
    found = residual < SOLVED_LAWS
    return Impact(np.array([p]), np.array([after]), residual, False, energy, found)


def _solved(closed: Closed, c: Floats) -> Solution:
    """Give the impulses for rates c (r,) that are to become 0.

    The slips of stopped contacts slide on, or are held where that would turn them back.
    """
    roles = indices(tuple([_ROLES[kind] for kind in closed.kinds])).copy()
    ways, nothing = np.zeros((2, len(c)))
    sliding: list[list[int]] = []
    for k, (n, pair) in enumerate(zip(closed.normals, closed.pairs, strict=True)):
        if n < 0 or closed.kinds[n] is not Kind.TIMED or roles[k] != Role.BOXED:
            continue
        if pair < k:
            sliding.append([pair, k] if pair >= 0 else [k])
    for rows in sliding:
        speed = float(np.linalg.norm(c[rows]))
        for k in rows:
            roles[k] = Role.GIVEN if speed > 0.0 else Role.FREE
            ways[k] = -c[k] / speed if speed > 0.0 else 0.0
    while True:
        solution = solve(
            Problem(
                closed.D, c, roles, nothing, closed.bounds, ways,
                indices(closed.normals), indices(closed.pairs),
            )
        )  # fmt: skip
        turned = [rows for rows in sliding if solution.w[rows] @ ways[rows] > 0.0]
        if not turned:
            return solution
        for k in (k for rows in turned for k in rows):
            roles[k], ways[k] = Role.FREE, 0.0


def _is_open(closed: Closed, before: Floats, p: Floats) -> bool:
    """Tell whether the order of impacts counts.

    It does where one changes the rate of another that is struck as well. Inelastic ones
    without friction that push each other's rates down end in one state all the same.
    """
    struck = [
        k
        for k, kind in enumerate(closed.kinds)
        if kind is Kind.CONTACT and (p[k] > 0.0 or before[k] < 0.0)
    ]
    if len(struck) < 2:
        return False
    scale = np.sqrt(closed.D.diagonal())
    for i, j in combinations(struck, 2):
        rows, others = _group(closed, i, p), _group(closed, j, p)
        D = closed.D[np.ix_(rows, others)]
        if not (np.abs(D) > DECOUPLED * np.outer(scale[rows], scale[others])).any():
            continue
        plain = len(rows) == len(others) == 1 and D[0, 0] < 0.0
        if closed.restitutions[i] or closed.restitutions[j] or not plain:
            return True
    return False


def _group(closed: Closed, normal: int, p: Floats) -> list[int]:
    slips = [k for k, n in enumerate(closed.normals) if n == normal and p[k]]
    return [normal, *slips]
