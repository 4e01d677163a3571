"""What is said of each relation at the start: residual, scale, bound, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.expressions.derivatives import gradient

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.native.kernel_types import Floats

TOLERANCE = 1e-6
# What all digits of a number leave in a residual of a few terms.
ALL_DIGITS = 2.0**-47
ONE_SIDED = "one-sided"
START_VALUE = "start value"
# The bound of rounding errors is to first order; this keeps it a bound.
CAUTION = 4.0


@dataclass(frozen=True, slots=True)
class Residual:
    """How far a relation, or its rate, is from being met.

    Attributes
    ----------
    value, scale : float
        The residual, and the largest of its terms and of |q_i dg/dq_i|.
    rounding : float
        A bound of the error that the expressions of the start leave in the residual.
    """

    value: float
    scale: float
    rounding: float

    @property
    def bound(self) -> float:
        """What |value| may be."""
        return max(TOLERANCE * self.scale, self.rounding)

    @property
    def why(self) -> str:
        """Why the bound is that."""
        if self.rounding >= TOLERANCE * self.scale:
            return "the rounding error of the start"
        return f"{TOLERANCE:g} of its largest term"

    @property
    def met(self) -> bool:
        """Whether the residual is within its bound."""
        return abs(self.value) <= self.bound

    @property
    def digits(self) -> int | None:
        """With how many digits the start seems typed; None where it is exact."""
        exact = max(self.rounding, ALL_DIGITS * self.scale)
        if not self.met or abs(self.value) <= exact:
            return None
        return max(1, int(-math.log10(abs(self.value) / self.scale)))


@dataclass(frozen=True, slots=True)
class Verdict:
    """One relation at the start.

    Attributes
    ----------
    position : Residual
        Of g, or of the relation itself between velocities.
    velocity : Residual or None
        Of A q' + g_t for holonomic relations.
    integrable : bool or None
        Of a Pfaffian relation alone; None where it is undecided, or is no question.
    undecided : str
        Why `integrable` is None, where it is a question.
    """

    name: str
    kind: str
    scleronomic: bool
    pfaffian: bool | None
    position: Residual
    velocity: Residual | None
    redundant: bool = False
    integrable: bool | None = None
    undecided: str = ""

    @property
    def satisfied(self) -> bool:
        """Whether position and velocity meet the relation."""
        if self.kind == ONE_SIDED:
            return self.position.value >= -self.position.bound
        return self.position.met and (self.velocity is None or self.velocity.met)


def residuals(
    point: Point,
    nodes: Sequence[int],
    scales: Sequence[int],
    q: Floats,
    v: Floats,
    errors: Mapping[str, float],
) -> list[Residual]:
    """Judge `nodes`, given the errors of the initial values by name."""
    return [
        Residual(float(value), float(scale), float(CAUTION * error))
        for value, scale, error in zip(
            point.array(nodes, q, v),
            point.array(scales, q, v),
            point.rounding(nodes, q, v, errors),
            strict=True,
        )
    ]


def judge(
    point: Point, q: Floats, v: Floats, errors: Mapping[str, float]
) -> list[Verdict]:
    """Judge the two-sided constraints."""
    rows = point.e.rows
    held = residuals(
        point,
        [r.residual for r in rows],
        [r.residual_scale for r in rows],
        q,
        v,
        errors,
    )
    moving = residuals(
        point, [r.rate for r in rows], [r.rate_scale for r in rows], q, v, errors
    )
    return [
        Verdict(
            name=row.name,
            kind="holonomic" if row.holonomic else "nonholonomic",
            scleronomic=row.scleronomic,
            pfaffian=None if row.holonomic else row.pfaffian,
            position=position,
            velocity=velocity if row.holonomic else None,
        )
        for row, position, velocity in zip(rows, held, moving, strict=True)
    ]


def judge_gaps(
    point: Point, q: Floats, v: Floats, errors: Mapping[str, float]
) -> list[Verdict]:
    """Judge the one-sided constraints: their gaps must not be negative."""
    found = []
    variables = [point.g.variable(name) for name in point.e.q]
    for c in point.e.model.constraints:
        if c.law is None:
            continue
        node = c.relation.node
        value = point.array([node], q, v)[0]
        levers = np.abs(point.array(gradient(point.g, node, variables), q, v) * q)
        scale = max(abs(value), np.max(levers, initial=0.0))
        rounding = CAUTION * point.rounding([node], q, v, errors)[0]
        gap = Residual(float(value), float(scale), float(rounding))
        still = "t" not in point.g.depends([node])
        found.append(Verdict(c.name, ONE_SIDED, still, None, gap, None))
    return found


def judge_starts(
    point: Point, q: Floats, v: Floats, errors: Mapping[str, float]
) -> list[Verdict]:
    """Judge the start values of definitions."""
    found = []
    names = (*point.e.q, *point.e.velocities)
    variables = [point.g.variable(name) for name in names]
    for wanted in point.e.model.initial:
        if wanted.node is None:
            continue
        value = point.array([wanted.node], q, v)[0]
        rounding = point.rounding([wanted.node], q, v, errors)[0]
        slopes = point.array(gradient(point.g, wanted.node, variables), q, v)
        levers = np.abs(slopes) * np.abs(np.concatenate([q, v]))
        scale = max(abs(value), abs(wanted.value), np.max(levers, initial=0.0))
        residual = Residual(
            float(value - wanted.value),
            float(scale),
            float(CAUTION * (rounding + wanted.error)),
        )
        name = f"{wanted.name}: {wanted.text}"
        found.append(Verdict(name, START_VALUE, True, None, residual, None))
    return found
