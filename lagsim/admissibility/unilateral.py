"""Unilateral, timed and limited constraints at the start, and contact status.

A gap and the rate of a freewheel must not be negative. A limited equality may slip. An
equality with a time is judged like any other where it is in force, and not elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lagsim.admissibility.lengths import Form
from lagsim.admissibility.newton import least_squares
from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import analyse
from lagsim.admissibility.verdict import (
    CAUTION,
    COMPUTED,
    ONE_SIDED,
    Verdict,
    body_motions,
    measured,
)
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import Closed, Mode, delassus, impact, modes
from lagsim.notes import Caution
from lagsim.tolerances import UNIT_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.admissibility.report import RankReport
    from lagsim.admissibility.verdict import Residual
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Law, Row
    from lagsim.mechanics.equations import Equations


_ONE_SIDED = (Kind.CONTACT, Kind.FREEWHEEL)


def out_of_force(equations: Equations, time: float) -> frozenset[str]:
    """Give the constraints that are not in force at a time."""
    asked = [law for law in equations.laws if law.when is not None]
    if not asked:
        return frozenset()
    values = {p.name: p.value for p in equations.model.parameters} | {"t": time}
    nodes = [law.when for law in asked if law.when is not None]
    found = evaluate(equations.graph, nodes, values)
    return frozenset(
        law.constraint for law, on in zip(asked, found, strict=True) if not on
    )


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
        if law.kind in _ONE_SIDED and law.constraint in names
    }


def judge_laws(
    point: Point,
    off: frozenset[str],
    state: tuple[Floats, Floats],
    errors: Mapping[str, float],
) -> list[Verdict]:
    """Judge what `judge` does not: the constraints that are no rows of `point`."""
    if not point.e.laws:
        return []
    held = {row.name for row in point.e.rows}
    laws = [
        law
        for law in point.e.laws
        if law.kind is not Kind.SLIP and law.constraint not in held
    ]
    zeros = [0.0] * len(laws)
    values = measured(point, [x.row.residual for x in laws], zeros, state, errors)
    rates = measured(point, [x.row.rate for x in laws], zeros, state, errors)
    bodies = body_motions(
        point, [Form(x.row.rate, x.row.A.entries) for x in laws], *state
    )
    found = []
    for law, value, rate, body in zip(laws, values, rates, bodies, strict=True):
        moving = rate._replace(floor=COMPUTED * body)
        residual = value if law.row.holonomic else moving
        on = law.constraint not in off
        found.append(_verdict(law, residual, moving, in_force=on))
    return found


def _verdict(law: Law, value: Residual, rate: Residual, *, in_force: bool) -> Verdict:
    row = law.row
    signed = law.kind in _ONE_SIDED
    kind = "holonomic" if row.holonomic else "nonholonomic"
    active = in_force
    if signed and in_force:
        active = value.value <= max(value.rounding, value.floor)
    return Verdict(
        name=law.constraint,
        kind=ONE_SIDED if signed else kind,
        scleronomic=row.scleronomic,
        pfaffian=None if row.holonomic else row.pfaffian,
        position=value,
        velocity=rate if row.holonomic and not signed else None,
        judged=signed and in_force,
        rate=rate,
        active=active,
        holds=None if in_force else False,
        mode="" if in_force else "out of force",
    )


def in_force(verdicts: Sequence[Verdict], equations: Equations) -> list[Verdict]:
    """Say of the equalities with a time that are judged that they are in force."""
    timed = {law.constraint for law in equations.laws if law.when is not None}
    return [
        v._replace(active=True, holds=v.satisfied, mode="in force")
        if v.name in timed and v.active is None
        else v
        for v in verdicts
    ]


# --- Contact status: contacts, freewheels and limited equalities at the start
#
# What touches and approaches is struck at once; of what then touches and rests, the
# accelerations decide which rows hold, slide or let go.

# Accelerations are sums of a few terms per coordinate.
TERMS = 64 * UNIT_ROUNDOFF
_HELD = (Mode.HELD, Mode.IMPLIED)


@dataclass(frozen=True, slots=True)
class ContactStatus:
    """Verdicts with the modes of contacts and limited equalities.

    Attributes
    ----------
    verdicts : list of Verdict
        Those that were given, with `holds` and `mode`.
    raised : int
        By how much the limited equalities that hold raise the rank.
    """

    verdicts: list[Verdict]
    raised: int = 0
    warnings: tuple[Caution, ...] = ()


class Judged(Protocol):
    """A state, and the rank of the equalities in force there."""

    @property
    def q(self) -> Floats:
        """Positions, (n,)."""

    @property
    def v(self) -> Floats:
        """Velocities, (n,)."""

    @property
    def ranks(self) -> RankReport:
        """Of the rows of the point."""


def contact_status(
    point: Point,
    verdicts: Sequence[Verdict],
    judged: Judged,
    errors: Mapping[str, float],
    *,
    sound: bool,
) -> ContactStatus:
    """Decide what the laws of constraints do, where the state is sound.

    Else the limited equalities that do not slip count as held.
    """
    paradox = False
    if sound:
        state = judged.q, judged.v
        found, struck, paradox = _modes(point, verdicts, state, errors)
        verdicts = [_named(x, found, struck, point) for x in verdicts]
    limited = {x.constraint for x in point.e.laws if x.kind is Kind.LIMITED}
    held = {
        x.name
        for x in verdicts
        if x.name in limited and (x.holds if sound else x.active and x.position.exact)
    }
    raised = 0
    if held:
        rows = [law.row for law in point.e.laws if law.constraint in held]
        more = Point(replace(point.e, rows=(*point.e.rows, *rows)), point.t)
        raised = analyse(more, judged.q, judged.v, errors, ()).rank - judged.ranks.rank
    return ContactStatus(list(verdicts), raised, (_PARADOX,) if paradox else ())


def _modes(
    point: Point,
    verdicts: Sequence[Verdict],
    state: tuple[Floats, Floats],
    errors: Mapping[str, float],
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
    q, v = state
    before = _Rows(point, chosen, q, v, errors)
    rates, noise = before.rates, before.noise
    struck = {
        laws[k].constraint
        for k, rate, small in zip(chosen, rates, noise, strict=True)
        if laws[k].kind is Kind.CONTACT and rate < -small
    }
    if struck:
        hit = impact(before.closed, rates, noise)
        v = v + before.answer.response @ hit.impulses
        noise = noise + TERMS * (np.abs(before.closed.D) @ np.abs(hit.impulses))
        noise = noise + TERMS * np.abs(rates)
        rates = hit.after
    gone = {
        k
        for k, rate, small in zip(chosen, rates, noise, strict=True)
        if laws[k].kind in (Kind.CONTACT, Kind.FREEWHEEL) and rate > small
    }
    left = [k for k in chosen if k not in gone and laws[k].normal not in gone]
    quiet = noise[[chosen.index(k) for k in left]]
    if not left:
        return {}, struck, False
    after = _Rows(point, left, q, v, errors)
    decided = modes(after.closed, after.accelerations, after.rates, after.quiet, quiet)
    return dict(zip(left, decided.mode, strict=True)), struck, decided.paradox


_PARADOX = Caution(
    "painleve",
    "at the start the laws of friction contradict each other (Painlevé's "
    "paradox): a sliding contact has no positive effective mass",
)


class _Rows:
    """Rows of laws in numbers: r of them, those numbered `chosen`."""

    def __init__(
        self,
        point: Point,
        chosen: Sequence[int],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float],
    ) -> None:
        self.point, self.state = point, (q, v)
        laws = [point.e.laws[k] for k in chosen]
        self.rows = [law.row for law in laws]
        nodes = [row.rate for row in self.rows]
        self.rates = point.array(nodes, q, v)
        bodies = body_motions(
            point, [Form(x.rate, x.A.entries) for x in self.rows], q, v
        )
        rounding = CAUTION * point.rounding(nodes, q, v, errors)
        self.noise = np.maximum(rounding, COMPUTED * np.array(bodies))
        self.M = point.mass(q, v)
        self.A = point.jacobian(point.e.rows, q, v)
        self.R = point.jacobian(self.rows, q, v)
        self.answer = delassus(self.M, self.A, self.R)
        place = {k: i for i, k in enumerate(chosen)}
        bounds = point.array([law.bound for law in laws], q, v)
        statics = point.array([law.static for law in laws], q, v)
        self.closed = Closed(
            D=self.answer.D,
            kinds=tuple(law.kind for law in laws),
            normals=tuple(place.get(law.normal, -1) for law in laws),
            pairs=tuple(place.get(law.pair, -1) for law in laws),
            bounds=np.maximum(bounds, 0.0),
            statics=np.maximum(statics, 0.0),
            restitutions=np.array([law.restitution for law in laws]),
            factor=self.answer.factor,
        )
        self.accelerations, self.quiet = self._free()

    def _free(self) -> tuple[Floats, Floats]:
        """Give the accelerations without forces of these laws, and their rounding."""
        point, M, A, R = self.point, self.M, self.A, self.R
        f = point.array(point.e.f, *self.state)
        b = point.array([row.b for row in self.rows], *self.state)
        forced = np.zeros(point.n)
        if len(A):
            sizes = point.sizes(*self.state)
            asked = point.array([row.b for row in point.e.rows], *self.state)
            forced = least_squares(A / sizes, asked, None) / sizes
        K = delassus(M, A, np.eye(point.n)).response
        a = forced + K @ (f - M @ forced)
        terms = np.abs(K) @ (np.abs(f) + np.abs(M) @ np.abs(forced)) + np.abs(forced)
        return R @ a - b, TERMS * (np.abs(R) @ terms + np.abs(b))


def _named(
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
