"""Contact status: contacts, freewheels, timed and limited constraints at the start.

What touches and approaches is struck at once; of what then touches and rests, the
accelerations decide which rows hold, slide or let go. An equality with a time is judged
like any other where it is in force, and not elsewhere.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.algebra import least_squares
from lagsim.admissibility.lengths import Form
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import analyse
from lagsim.admissibility.verdict import CAUTION, SIDED, Verdict, body_motions
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import Closed, Mode, delassus, impact, modes
from lagsim.notes import Caution
from lagsim.tolerances import CONVERGED, RESIDUAL_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations


def out_of_force(equations: Equations, time: float) -> frozenset[str]:
    """Give the constraints that are not in force at a time."""
    whens = {law.constraint: x for law in equations.laws if (x := law.when) is not None}
    values = {p.name: p.value for p in equations.model.parameters} | {"t": time}
    found = evaluate(equations.graph, whens.values(), values)
    return frozenset(name for name, on in zip(whens, found, strict=True) if not on)


def with_timed(equations: Equations, off: frozenset[str]) -> Equations:
    """Give the equations with the equalities that are in force now among the rows."""
    timed = [
        law.row
        for law in equations.laws
        if law.kind is Kind.TIMED and law.constraint not in off
    ]
    if not timed:
        return equations
    place = {c.name: k for k, c in enumerate(equations.model.constraints)}
    rows = sorted((*equations.rows, *timed), key=lambda row: place[row.name])
    return replace(equations, rows=tuple(rows))


def one_sided(equations: Equations, names: Collection[str]) -> dict[str, Row]:
    """Give the rows of those contacts and freewheels."""
    return {
        law.constraint: law.row
        for law in equations.laws
        if law.kind in SIDED and law.constraint in names
    }


def in_force(verdicts: Sequence[Verdict], equations: Equations) -> list[Verdict]:
    """Say of the equalities with a time that are judged that they are in force."""
    timed = {law.constraint for law in equations.laws if law.when is not None}
    return [
        v._replace(active=True, holds=v.satisfied, mode="in force")
        if v.name in timed and v.active is None
        else v
        for v in verdicts
    ]


_HELD = (Mode.HELD, Mode.IMPLIED)
_PARADOX = Caution(
    "painleve",
    "at the start the laws of friction contradict each other (Painlevé's "
    "paradox): a sliding contact has no positive effective mass",
)


def contact_status(
    point: Point, verdicts: Sequence[Verdict], rank: int, *, sound: bool
) -> tuple[list[Verdict], int, list[Caution]]:
    """Decide what the laws of constraints do, where the state is `sound`.

    Else the limited equalities that do not slip count as held.

    Parameters
    ----------
    verdicts
        Of the laws.
    rank
        Of the equalities in force.

    Returns
    -------
    verdicts : list of Verdict
        With `holds` and `mode`.
    raised : int
        By how much the limited equalities that hold raise the rank.
    warnings : list of Caution
    """
    found, paradox = list(verdicts), False
    if sound:
        decided, struck, paradox = _modes(point, verdicts)
        found = [_with_mode(x, decided, struck, point) for x in verdicts]
    limited = {x.constraint: x.row for x in point.e.laws if x.kind is Kind.LIMITED}
    held = [
        limited[x.name]
        for x in found
        if x.name in limited and (x.holds if sound else x.active and x.position.exact)
    ]
    raised = 0
    if held:
        more = replace(point.e, rows=(*point.e.rows, *held))
        raised = analyse(Point(more, point.state, point.errors), ()).rank - rank
    return found, raised, [_PARADOX] if paradox else []


def _modes(
    point: Point, verdicts: Sequence[Verdict]
) -> tuple[dict[int, Mode], set[str], bool]:
    """Give the modes of laws by number, the contacts that are struck, and a paradox."""
    active = {v.name for v in verdicts if v.active}
    laws = point.e.laws
    chosen = [
        k
        for k, law in enumerate(laws)
        if law.constraint in active and law.kind is not Kind.TIMED
    ]
    if not chosen:
        return {}, set(), False
    before = _Rows(point, chosen)
    rates, rounding = before.rates, before.rounding
    struck = {
        laws[k].constraint
        for k, rate, small in zip(chosen, rates, rounding, strict=True)
        if laws[k].kind is Kind.CONTACT and rate < -small
    }
    if struck:
        hit = impact(before.closed, rates, rounding)
        point = point.at(v=point.v + before.answer.response @ hit.impulses)
        terms = np.abs(before.closed.D) @ np.abs(hit.impulses) + np.abs(rates)
        rates, rounding = hit.after, rounding + RESIDUAL_ROUNDOFF * terms
    gone = {
        k
        for k, rate, small in zip(chosen, rates, rounding, strict=True)
        if laws[k].kind in SIDED and rate > small
    }
    left = [k for k in chosen if k not in gone and laws[k].normal not in gone]
    if not left:
        return {}, struck, False
    after = _Rows(point, left)
    small = rounding[[chosen.index(k) for k in left]]
    found = modes(after.closed, *after.accelerations(), small)
    return dict(zip(left, found.mode, strict=True)), struck, found.paradox


class _Rows:
    """Rows of laws in numbers: r of them, those numbered `chosen`."""

    def __init__(self, point: Point, chosen: Sequence[int]) -> None:
        self.point = point
        laws = [point.e.laws[k] for k in chosen]
        self.rows = [law.row for law in laws]
        nodes = [row.rate for row in self.rows]
        self.rates = point.array(nodes)
        bodies = body_motions(point, [Form(x.rate, x.A.entries) for x in self.rows])
        rounding = CAUTION * point.rounding(nodes)
        self.rounding = np.maximum(rounding, CONVERGED * np.array(bodies))
        self.R = point.jacobian(self.rows)
        self.answer = delassus(point.mass_matrix, point.gradients, self.R)
        place = {k: i for i, k in enumerate(chosen)}
        self.closed = Closed(
            D=self.answer.D,
            kinds=tuple(law.kind for law in laws),
            normals=tuple(place.get(law.normal, -1) for law in laws),
            pairs=tuple(place.get(law.pair, -1) for law in laws),
            bounds=np.maximum(point.array([law.bound for law in laws]), 0.0),
            statics=np.maximum(point.array([law.static for law in laws]), 0.0),
            restitutions=np.array([law.restitution for law in laws]),
            factor=self.answer.factor,
        )

    def accelerations(self) -> tuple[Floats, Floats, Floats]:
        """Give those without forces of these laws, the rates, and their rounding."""
        point, e = self.point, self.point.e
        M, A, R = point.mass_matrix, point.gradients, self.R
        f, b = point.array(e.f), point.array([row.b for row in self.rows])
        forced = np.zeros(point.n)
        if len(A):
            asked = point.array([row.b for row in e.rows])
            forced = least_squares(A / point.sizes, asked, None) / point.sizes
        K = delassus(M, A, np.eye(point.n)).response
        a = forced + K @ (f - M @ forced)
        terms = np.abs(K) @ (np.abs(f) + np.abs(M) @ np.abs(forced)) + np.abs(forced)
        rounding = RESIDUAL_ROUNDOFF * (np.abs(R) @ terms + np.abs(b))
        return R @ a - b, self.rates, rounding


def _with_mode(
    verdict: Verdict,
    found: Mapping[int, Mode],
    struck: Collection[str],
    point: Point,
) -> Verdict:
    """Say what a constraint does."""
    if verdict.active is None or verdict.mode:
        return verdict
    laws = point.e.laws
    own = {k: laws[k].kind for k in found if laws[k].constraint == verdict.name}
    kind = next(x.kind for x in laws if x.constraint == verdict.name)
    main = [found[k] for k, x in own.items() if x is not Kind.SLIP]
    slips = [found[k] for k, x in own.items() if x is Kind.SLIP]
    holds = bool(main) and main[0] in _HELD
    if kind is Kind.LIMITED:
        mode = "sticks" if holds else "slides"
    elif kind is Kind.FREEWHEEL:
        mode = "engaged" if holds else "free"
    elif verdict.name in struck:
        mode = "impact"
    elif not holds:
        mode = "open"
    elif not slips:
        mode = "closed"
    else:
        mode = "sticks" if all(x in _HELD for x in slips) else "slides"
    return verdict._replace(holds=holds, mode=mode)
