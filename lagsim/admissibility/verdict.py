"""Verdicts on the relations at the start: residual, scale and bound of each.

A residual is compared with the largest of its terms and of |q_i dg/dq_i|, but not with
more than the relation's own size (`lengths`): far from the origin the terms are large,
and the relation is what it was. A rate is compared with its terms, but not with more
than the motion that the relation sees, nor with less than a tenth of it: a relation
whose coefficients vanish at the start is judged like its neighbours.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.lengths import LINKS, Form, Lengths, of_rows
from lagsim.language.derivatives import slopes
from lagsim.language.evaluate import evaluate
from lagsim.language.sparse import DisjointSets

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Floats

TOLERANCE = 1e-6
# What all digits of a number leave in a residual of a few terms.
ALL_DIGITS = 2.0**-47
ONE_SIDED = "one-sided"
START_VALUE = "start value"
# The bound of rounding errors is to first order; this keeps it a bound.
CAUTION = 4.0
# The part of the motion that a rate counts as at least.
MOTION = 0.1
# What was computed elsewhere in double precision carries errors of this part of the
# motion of the body.
COMPUTED = 1e-12


class Residual(NamedTuple):
    """How far a relation, or its rate, is from being met.

    Attributes
    ----------
    value, scale : float
        The residual, and the size that it is compared with.
    rounding : float
        A bound of the error that the expressions of the start leave in the residual.
    size : str
        What `scale` is.
    floor : float
        What numbers of all digits leave, by the sizes around the relation.
    """

    value: float
    scale: float
    rounding: float
    size: str = "its largest term"
    floor: float = 0.0

    @property
    def bound(self) -> float:
        """What |value| may be."""
        return max(TOLERANCE * self.scale, self.rounding, self.floor)

    @property
    def why(self) -> str:
        """Why the bound is that."""
        if self.rounding == self.bound:
            return "the rounding error of the start"
        if self.floor == self.bound:
            return "the rounding of numbers in full precision"
        return f"{TOLERANCE:g} of {self.size}"

    @property
    def exact(self) -> bool:
        """Whether the residual is no more than rounding."""
        return abs(self.value) <= max(self.rounding, self.floor)

    @property
    def met(self) -> bool:
        """Whether the residual is within its bound."""
        return abs(self.value) <= self.bound

    @property
    def digits(self) -> int | None:
        """With how many digits the start seems typed; None where it is exact."""
        exact = self.exact or abs(self.value) <= ALL_DIGITS * self.scale
        if not self.met or exact:
            return None
        return max(1, int(-math.log10(abs(self.value) / self.scale)))


class Verdict(NamedTuple):
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
    judged : bool
        Whether a start has to meet it.
    rate : Residual or None
        Of what holds only at times: the rate of a gap, a slip.
    active : bool or None
        Whether a contact touches, a freewheel may engage, another one is in force; None
        of equalities that always are.
    holds : bool or None
        Whether it acts there; None where that was not decided.
    mode : str
        What it does.
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
    judged: bool = True
    rate: Residual | None = None
    active: bool | None = None
    holds: bool | None = None
    mode: str = ""

    @property
    def satisfied(self) -> bool:
        """Whether position and velocity meet the relation."""
        if not self.judged:
            return True
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
    # What is only rounding is met, whatever it is compared with.
    pairs = enumerate(zip(held, moving, strict=True))
    asked = [i for i, (x, y) in pairs if not (x.exact and y.exact)]
    near = _neighbours(point, asked)
    lengths = of_rows(point, [rows[i] for i in (*asked, *near)], q, v)
    scales, motions = lengths.scales(), lengths.motions()
    whole = body_motions(point, lengths.forms[: len(asked)], q, v)
    for i, scale, motion, body in zip(asked, scales, motions, whole, strict=False):
        moving[i] = _of_rate(moving[i], motion, body)
        held[i] = _of_size(held[i], scale) if rows[i].holonomic else moving[i]
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


def _neighbours(point: Point, asked: Sequence[int]) -> list[int]:
    """Give the other rows that can hand their lengths on to these."""
    found = set(asked)
    columns = [set(row.A.entries) for row in point.e.rows]
    for _ in range(LINKS):
        known = {j for i in found for j in columns[i]}
        found |= {i for i, touched in enumerate(columns) if touched & known}
    return sorted(found - set(asked))


def _of_size(residual: Residual, own: float) -> Residual:
    """Compare with the relation's own size where that is less than its terms."""
    if not np.isfinite(own):
        return residual
    residual = residual._replace(floor=float(ALL_DIGITS * own))
    if own >= residual.scale:
        return residual
    return residual._replace(scale=float(own), size="the lengths that it relates")


def _of_rate(residual: Residual, motion: float, body: float) -> Residual:
    """Compare with the motion that a relation sees, and with that of its body."""
    residual = residual._replace(floor=COMPUTED * body)
    if motion < residual.scale:
        return residual._replace(
            scale=float(motion), size="the velocities that it relates"
        )
    if np.isfinite(motion) and MOTION * motion > residual.scale:
        size = "a tenth of the velocities that it relates"
        scale = float(MOTION * motion)
        return residual._replace(scale=scale, size=size)
    return residual


def body_motions(
    point: Point, forms: Sequence[Form], q: Floats, v: Floats
) -> list[float]:
    """Give |A| |v| of each form, of the coordinates whose inertia it shares.

    To COMPUTED of that a rate is known at best.
    """
    weights, shared = point.sizes(q, v), _Bodies(point)
    found = []
    for form in forms:
        columns = list(form.A)
        A = point.array(list(form.A.values()), q, v) / weights[columns]
        body = shared.of(columns)
        found.append(float(np.linalg.norm(A) * np.linalg.norm((weights * v)[body])))
    return found


class _Bodies:
    """Coordinates that M couples with one another, directly or through others."""

    def __init__(self, point: Point) -> None:
        together = DisjointSets(point.n)
        for _, own in point.e.coupled:
            for i in own:
                together.merge(own[0], i)
        self.body = {i: body for body in together.sets() for i in body}

    def of(self, columns: Sequence[int]) -> list[int]:
        """Give the coordinates coupled with any of these, and these."""
        return sorted({i for j in columns for i in self.body[j]})


def judge_starts(
    point: Point, q: Floats, v: Floats, errors: Mapping[str, float]
) -> list[Verdict]:
    """Judge the start values of definitions."""
    found = []
    values = [w for w in point.e.model.initial if w.node is not None]
    nodes = [w.node for w in values if w.node is not None]
    left = measured(point, nodes, [w.value for w in values], (q, v), errors)
    for wanted, residual in zip(values, left, strict=True):
        missed = residual._replace(rounding=residual.rounding + CAUTION * wanted.error)
        name = f"{wanted.name}: {wanted.text}"
        found.append(Verdict(name, START_VALUE, True, None, missed, None))
    return found


def measured(
    point: Point,
    nodes: Sequence[int],
    targets: Sequence[float],
    state: tuple[Floats, Floats],
    errors: Mapping[str, float],
) -> list[Residual]:
    """Give what nodes miss their targets by, with its scale."""
    if not nodes:
        return []
    g, e = point.g, point.e
    variables = {g.variable(name): j for j, name in enumerate((*e.q, *e.velocities))}
    places = frozenset(variables)
    sizes = np.abs(np.concatenate(state))
    values, numbers = point.array(nodes, *state), point.values(*state)
    rounding = CAUTION * point.rounding(nodes, *state, errors)
    found, forms = [], []
    for i, node in enumerate(nodes):
        A = {variables[x]: slope for x, slope in slopes(g, node, places).items()}
        levers = np.abs(evaluate(g, A.values(), numbers)) * sizes[list(A)]
        scale = max(abs(values[i]), abs(targets[i]), np.max(levers, initial=0.0))
        missed = float(values[i] - targets[i])
        found.append(Residual(missed, float(scale), float(rounding[i])))
        moving = any(j >= point.n for j in A)
        forms.append(Form(node, {} if moving else A, targets[i]))
    own = Lengths(point, forms, *state).scales()
    return [_of_size(residual, x) for residual, x in zip(found, own, strict=True)]
