"""Impacts of the rows that may be in force: impulses, and rates after them.

Impacts obey Newton's law of restitution and Coulomb's law of friction: the rate of each
contact after the impact is at least -e times the rate before, with equality where the
contact has an impulse. By Poisson's law, an impact without restitution ends the
approach; a second one adds e times its impulse, or more where a contact would close.
All contacts that touch share one simultaneous impact; where they are coupled, another
order of impacts would end in other rates. Where a series of impacts is computed as a
single impact, a contact may need a negative impulse: the series ends with the contact
at rest, and the impulse of the forces that press it down meanwhile (its weight) is part
of no impact. Friction is proportional to that impulse, of either sign, so that a slip
of constant direction loses the momentum due to the impulses of the series and of the
weight.

Source: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts (1996).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from lagsim.mechanics.complementarity import Solution, solve
from lagsim.tolerances import SOLUTION_ROUNDOFF, SOLVED_LAWS

if TYPE_CHECKING:
    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.rows import Closed


@dataclass(frozen=True, slots=True)
class Impact:
    """Result of an impact on r rows.

    Attributes
    ----------
    impulses : ndarray, shape (r,)
        The impulses of the rows.
    after : ndarray, shape (r,)
        The rates of the rows after the impact.
    open : bool
        Whether the result depends on the order of the impacts, in which case it is a
        convention of the impact law.
    energy : float
        The change of the kinetic energy in the frame of the struck bodies: the sum of
        impulse times mean rate over the rows.
    found : bool
        False where the laws have no common solution (a body that is crushed).
    """

    impulses: Floats
    after: Floats
    open: bool
    energy: float
    found: bool = True

    def part(self, part: float, rates: Floats) -> Impact:
        """Return an impact whose impulses are the fraction `part` of these impulses.

        The changes of rates are the same fraction of all changes.

        part : the fraction, in [0, 1].
        rates : ndarray, shape (r,), the rates before the impact.
        """
        if part == 1.0:
            return self
        p, after = part * self.impulses, rates + part * (self.after - rates)
        energy = float(p @ (rates + after)) / 2.0
        return Impact(p, after, self.open, energy, self.found)

    def followed_by(self, rest: Impact) -> Impact:
        """Return the impact that consists of this impact, then of the impact `rest`."""
        return Impact(
            self.impulses + rest.impulses, rest.after, self.open or rest.open,
            self.energy + rest.energy, self.found and rest.found,
        )  # fmt: skip


def impact(
    closed: Closed, rates: Floats, roundoff: Floats, first: Floats | None = None,
    more: Floats | None = None,
) -> Impact:  # fmt: skip
    """Compute the simultaneous impact of all rows.

    Where the rates after the impact by Newton's law contradict each other, the impact
    is inelastic. The rate of an equality becomes 0 by an impulse of either sign.

    Parameters
    ----------
    closed : Closed
        The r rows that are struck: bounds, Delassus matrix, restitutions.
    rates : ndarray, shape (r,)
        The rates of the rows before the impact.
    roundoff : ndarray, shape (r,)
        Rates up to this size count as 0.
    first : ndarray, shape (r,), optional
        The rates before an earlier part of the impact, from which contacts rebound.
    more : ndarray, shape (r,), optional
        The impulses of the expansion by Poisson's law, after a compression that an
        earlier part of the impact contains.
    """
    if first is None:
        first = rates
        if len(rates) == 1 and closed.table.one_sided[0] and more is None:
            return _of_one(closed, float(rates[0]), float(roundoff[0]))
    before, first = (np.where(np.abs(x) <= roundoff, 0.0, x) for x in (rates, first))
    bounces = closed.table.gapped
    of_impulses = bounces & closed.table.poisson
    newton = bounces & ~of_impulses & (first < 0.0)
    target = np.where(newton, -closed.restitutions * first, 0.0)
    rests = _at_rest(closed, before)
    if more is None:
        solution = _impulses(closed, before - target, rests)
    else:
        solution = _impulses(closed, before - target + closed.D @ more, rests, more)
    locked = not solution.found and bool(target.any())
    if locked:
        target = np.zeros(len(before))
        solution = _impulses(closed, before, rests)
    p = solution.p
    if more is not None:
        p = p + more
    elif of_impulses.any() and solution.found:
        more = np.where(of_impulses, closed.restitutions * p, 0.0)
        p = p + more
        solution = _impulses(closed, solution.w + closed.D @ more, rests, more)
        p = p + solution.p
    after = solution.w + target
    is_open = locked or _is_open(closed, before, p)
    energy = float(p @ (before + after)) / 2.0
    return Impact(p, after, is_open, energy, solution.found)


def _of_one(closed: Closed, rate: float, roundoff: float) -> Impact:
    """Compute the impact of a single one-sided row.

    rate : before the impact.
    roundoff : rates up to this size count as 0.
    closed : the row.
    """
    own, e = float(closed.D[0, 0]), float(closed.restitutions[0])
    before = 0.0 if abs(rate) <= roundoff else rate
    bounces = closed.table.gapped[0] and before < 0.0
    target = -e * before if bounces else 0.0
    p = max((target - before) / own, 0.0) if own > 0.0 else 0.0
    after = before + own * p
    jump, missed = abs(before - target), max(target - after, 0.0)
    energy = p * (before + after) / 2.0
    found = jump == 0.0 or missed < SOLVED_LAWS * jump
    return Impact(np.array([p]), np.array([after]), False, energy, found)


def _at_rest(closed: Closed, rates: Floats) -> Flags:
    """Return a mask (r,) of the slips at rest with a static coefficient of friction.

    The coefficient counts where it differs from the dynamic one.

    rates : (r,), the rates of the rows.
    closed : the r rows that are struck.
    """
    pairs = closed.table.pairs
    still = (rates == 0.0) & ((pairs < 0) | (rates[pairs] == 0.0))
    return np.asarray(closed.table.slips & still & (closed.statics != closed.bounds))


def _impulses(
    closed: Closed, c: Floats, rests: Flags, given: Floats | None = None
) -> Solution:
    """Solve for the impulses that bring rates to their targets as far as laws permit.

    Limited rows have no impulse. A slip whose contact is an equality keeps sliding in
    its direction; it is held as an equality, too, if friction would reverse it.

    Parameters
    ----------
    closed : Closed
        The r rows that are struck: bounds, Delassus matrix, restitutions.
    c : ndarray, shape (r,)
        The rates, less the rates to be reached.
    rests : ndarray of bool, shape (r,)
        The slips with the static friction coefficient.
    given : ndarray, shape (r,), optional
        Impulses of contacts that bound friction in addition to the solved ones.
    """
    table, goes_on, directions = closed.table, np.zeros(len(c), bool), 0.0 * c
    sizes = np.where(rests, closed.statics, closed.bounds)
    sizes = np.where(table.slips, sizes, 0.0)
    sliding: list[list[int]] = []
    equalities = list[int]()
    for k in np.flatnonzero(table.slips & table.equal[table.normals]).tolist():
        pair = table.pairs.item(k)
        if pair > k:
            continue
        rows = [k] if pair < 0 else [pair, k]
        speed = float(np.linalg.norm(c[rows]))
        if speed > 0.0:
            goes_on[rows], directions[rows] = True, -c[rows] / speed
            sliding.append(rows)
        else:
            equalities += rows
    while True:
        struck = (
            replace(closed, table=table.with_equalities(equalities))
            if equalities
            else closed
        )
        problem = struck.problem(c, sizes, directions, given=goes_on)
        if given is not None:
            known = np.where(problem.normals >= 0, given[problem.normals], 0.0)
            for bound in (problem.low, problem.high):
                bound[0] += bound[1] * known
        solution = solve(problem)
        turned = [rows for rows in sliding if solution.w[rows] @ directions[rows] > 0.0]
        if not turned:
            return solution
        for rows in turned:
            sliding.remove(rows)
            goes_on[rows] = False
            equalities += rows


def _is_open(closed: Closed, before: Floats, p: Floats) -> bool:
    """Whether the rates after the impact depend on the order of single impacts.

    This is so where two contacts that are struck are coupled, unless both have neither
    restitution nor friction and their impulses lower each other's rates.

    before : rates (r,) before the impact.
    p : impulses (r,).
    closed : the r rows that are struck.
    """
    pushed = np.abs(p) > SOLUTION_ROUNDOFF * np.abs(p).max(initial=0.0)
    struck = np.flatnonzero(closed.table.gapped & (pushed | (before < 0.0))).tolist()
    groups = {k: [k] for k in struck}
    for i in np.flatnonzero(closed.table.slips & pushed).tolist():
        if (k := closed.table.normals.item(i)) in groups:
            groups[k].append(i)
    scale = np.sqrt(closed.D.diagonal())
    for (i, rows), (j, others) in combinations(groups.items(), 2):
        D = closed.D[np.ix_(rows, others)]
        if not (
            np.abs(D) > SOLUTION_ROUNDOFF * np.outer(scale[rows], scale[others])
        ).any():
            continue
        plain = len(rows) == len(others) == 1 and D[0, 0] < 0.0
        if closed.restitutions[i] or closed.restitutions[j] or not plain:
            return True
    return False
