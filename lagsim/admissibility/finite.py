"""What has to be finite at the start."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.errors import InputError, Problem
from lagsim.mechanics.laws import Kind

if TYPE_CHECKING:
    from collections.abc import Collection

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Floats

NO_VALUE = (
    "check the initial values against what it divides by and the arguments of its "
    "roots and logarithms; the point of a cone, as that of hypot(x, y) at 0, has no "
    "gradient: start, or guess, beside it"
)
DIRECTION = (
    "a velocity that is 0 has no direction: friction in a plane by "
    "x_dot/hypot(x_dot, y_dot) is written x_dot/hypot(c, hypot(x_dot, y_dot)), c a "
    "speed far below those that matter, under which it creeps; along a line sign(x_dot)"
)


def refuse_infinite(
    point: Point, q: Floats, v: Floats, off: Collection[str], *, rows: bool
) -> None:
    """Refuse a state at which energies, forces or constraints are not finite.

    The `rows` of constraints need not be where they are only guessed, nor those of
    constraints that are `off`.

    Raises
    ------
    InputError
    """
    e = point.e
    named: list[tuple[str, int | None]] = [
        ("kinetic", e.model.kinetic),
        ("potential", e.model.potential),
        ("the energy function", e.energy),
    ]
    named += [(f"the force on {q}", f) for q, f in zip(e.q, e.f, strict=True)]
    if rows:
        more = [law.row for law in e.laws if law.constraint not in off]
        held = {row.name: row for row in (*e.rows, *more)}
        named += [(f"constraint {name}", row.residual) for name, row in held.items()]
        apart = _open(point, q, v)
        named += [
            (f"the rate of {name}", row.rate)
            for name, row in held.items()
            if name not in apart
        ]
        named += [
            (f"the bound of {law.multiplier}", law.bound)
            for law in e.laws
            if law.constraint not in off
        ]
    named += [(f"the inertia of {q}", e.M[j][j]) for j, q in enumerate(e.q)]
    found = [(name, node) for name, node in named if node is not None]
    values = point.array([node for _, node in found], q, v)
    resting = {name for name, rate in zip(e.velocities, v, strict=True) if not rate}
    problems = [
        Problem(
            "not-finite",
            f"{name} is {value} at the start, not finite",
            hint=DIRECTION if e.graph.depends([node]) & resting else NO_VALUE,
        )
        for (name, node), value in zip(found, values, strict=True)
        if not np.isfinite(value)
    ]
    if problems:
        raise InputError(problems)


def _open(point: Point, q: Floats, v: Floats) -> set[str]:
    """Give the contacts whose gaps are open: of them no rate is asked."""
    contacts = [law for law in point.e.laws if law.kind is Kind.CONTACT]
    gaps = point.array([law.row.residual for law in contacts], q, v)
    return {law.row.name for law, gap in zip(contacts, gaps, strict=True) if gap > 0.0}
