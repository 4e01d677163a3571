"""Constraints that hold at times, at the start: in force, touching, violated.

A gap and the rate of a freewheel must not be negative. A limited equality may slip. An
equality with a time is judged like any other where it is in force, and not elsewhere.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from lagsim.admissibility.lengths import Form
from lagsim.admissibility.verdict import (
    COMPUTED,
    ONE_SIDED,
    Verdict,
    body_motions,
    measured,
)
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.laws import Kind

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.admissibility.verdict import Residual
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.laws import Law

_ONE_SIDED = (Kind.CONTACT, Kind.FREEWHEEL)


def waiting(equations: Equations, time: float) -> frozenset[str]:
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
