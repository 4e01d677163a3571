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
from lagsim.language.sparse import DisjointSets
from lagsim.mechanics.constraints import Kind
from lagsim.tolerances import CONVERGED, RESIDUAL_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.mechanics.constraints import Law, Row

TOLERANCE = 1e-6
ONE_SIDED = "one-sided"
START_VALUE = "start value"
# The bound of rounding errors is to first order; this keeps it a bound.
CAUTION = 4.0
# The part of the motion that a rate counts as at least.
MOTION = 0.1
SIDED = (Kind.CONTACT, Kind.FREEWHEEL)


class Residual(NamedTuple):
    """How far a relation, or its rate, is from being satisfied.

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
    def satisfied(self) -> bool:
        """Whether the residual is within its bound."""
        return abs(self.value) <= self.bound

    @property
    def digits(self) -> int | None:
        """With how many digits the start seems typed; None where it is exact."""
        exact = self.exact or abs(self.value) <= RESIDUAL_ROUNDOFF * self.scale
        if not self.satisfied or exact:
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
        Whether a start has to satisfy it.
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
        """Whether position and velocity satisfy the relation."""
        if not self.judged:
            return True
        if self.kind == ONE_SIDED:
            return self.position.value >= -self.position.bound
        return self.position.satisfied and (
            self.velocity is None or self.velocity.satisfied
        )


# --- Equalities


def judge(point: Point) -> list[Verdict]:
    """Judge the two-sided constraints."""
    rows = point.e.rows
    held = _against_terms(point, [(r.residual, r.residual_scale) for r in rows])
    moving = _against_terms(point, [(r.rate, r.rate_scale) for r in rows])
    # What is only rounding is satisfied, whatever it is compared with.
    pairs = enumerate(zip(held, moving, strict=True))
    asked = [i for i, (x, y) in pairs if not (x.exact and y.exact)]
    near = _neighbours(point, asked)
    lengths = of_rows(point, [rows[i] for i in (*asked, *near)])
    scales, motions = lengths.scales(), lengths.motions()
    whole = body_motions(point, lengths.forms[: len(asked)])
    for i, scale, motion, body in zip(asked, scales, motions, whole, strict=False):
        moving[i] = _of_rate(moving[i], motion, body)
        held[i] = _of_size(held[i], scale) if rows[i].holonomic else moving[i]
    return [_of_row(*row) for row in zip(rows, held, moving, strict=True)]


def _of_row(row: Row, position: Residual, velocity: Residual) -> Verdict:
    return Verdict(
        name=row.name,
        kind="holonomic" if row.holonomic else "nonholonomic",
        scleronomic=row.scleronomic,
        pfaffian=None if row.holonomic else row.pfaffian,
        position=position,
        velocity=velocity if row.holonomic else None,
    )


def _against_terms(point: Point, pairs: Sequence[tuple[int, int]]) -> list[Residual]:
    """Give the residuals of nodes, each with the node of its scale."""
    nodes = [node for node, _ in pairs]
    values, rounding = point.array(nodes), CAUTION * point.rounding(nodes)
    found = (values, point.array([scale for _, scale in pairs]), rounding)
    return [Residual(*row) for row in zip(*(x.tolist() for x in found), strict=True)]


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
    residual = residual._replace(floor=float(RESIDUAL_ROUNDOFF * own))
    if own >= residual.scale:
        return residual
    return residual._replace(scale=float(own), size="the lengths that it relates")


def _of_rate(residual: Residual, motion: float, body: float) -> Residual:
    """Compare with the motion that a relation sees, and with that of its body."""
    scale, size = residual.scale, residual.size
    if motion < residual.scale:
        scale, size = float(motion), "the velocities that it relates"
    elif np.isfinite(motion) and MOTION * motion > residual.scale:
        scale = float(MOTION * motion)
        size = "a tenth of the velocities that it relates"
    return residual._replace(scale=scale, size=size, floor=CONVERGED * body)


def body_motions(point: Point, forms: Sequence[Form]) -> list[float]:
    """Give |A| |v| of each form, of the coordinates whose inertia it shares.

    To CONVERGED of that a rate is known at best.
    """
    weights, together = point.sizes, DisjointSets(point.n)
    for _, own in point.e.coupled:
        for i in own:
            together.merge(own[0], i)
    bodies = {i: body for body in together.sets() for i in body}
    found = []
    for form in forms:
        columns = list(form.A)
        A = point.array(list(form.A.values())) / weights[columns]
        body = sorted({i for j in columns for i in bodies[j]})
        motion = np.linalg.norm((weights * point.v)[body])
        found.append(float(np.linalg.norm(A) * motion))
    return found


# --- Constraints that hold at times, and start values


def judge_laws(point: Point, off: Collection[str]) -> list[Verdict]:
    """Judge the constraints that are no rows of `point`.

    A gap and the rate of a freewheel must not be negative; a limited equality may slip;
    those that are `off`, out of force, are not judged.
    """
    held = {row.name for row in point.e.rows}
    laws = [
        law
        for law in point.e.laws
        if law.kind is not Kind.SLIP and law.constraint not in held
    ]
    rows = [law.row for law in laws]
    values = _against_levers(point, [(r.residual, 0.0) for r in rows])
    rates = _against_levers(point, [(r.rate, 0.0) for r in rows])
    bodies = body_motions(point, [Form(r.rate, r.A.entries) for r in rows])
    found = []
    for law, value, rate, body in zip(laws, values, rates, bodies, strict=True):
        moving = rate._replace(floor=CONVERGED * body)
        residual = value if law.row.holonomic else moving
        in_force = law.constraint not in off
        found.append(_of_law(law, residual, moving, in_force=in_force))
    return found


def _of_law(law: Law, value: Residual, rate: Residual, *, in_force: bool) -> Verdict:
    signed, active = law.kind in SIDED, in_force
    found = _of_row(law.row, value, rate)
    if signed:
        found = found._replace(kind=ONE_SIDED, velocity=None)
        active = in_force and value.value <= max(value.rounding, value.floor)
    return found._replace(
        name=law.constraint,
        judged=signed and in_force,
        rate=rate,
        active=active,
        holds=None if in_force else False,
        mode="" if in_force else "out of force",
    )


def judge_starts(point: Point) -> list[Verdict]:
    """Judge the start values of definitions."""
    values = [(x.node, x) for x in point.e.model.initial if x.node is not None]
    missed = _against_levers(point, [(node, x.value) for node, x in values])
    found = []
    for (_, wanted), residual in zip(values, missed, strict=True):
        rounding = residual.rounding + CAUTION * wanted.error
        position = residual._replace(rounding=rounding)
        name = f"{wanted.name}: {wanted.text}"
        found.append(Verdict(name, START_VALUE, True, None, position, None))
    return found


def _against_levers(
    point: Point, targets: Sequence[tuple[int, float]]
) -> list[Residual]:
    """Give what nodes miss their targets by, against values and |q_i dg/dq_i|."""
    if not targets:
        return []
    g, e, nodes = point.g, point.e, [node for node, _ in targets]
    variables = {g.variable(name): j for j, name in enumerate((*e.q, *e.velocities))}
    places = frozenset(variables)
    sizes = np.abs(np.concatenate([point.q, point.v]))
    values, rounding = point.array(nodes), CAUTION * point.rounding(nodes)
    found, forms = [], []
    for (node, target), value, error in zip(targets, values, rounding, strict=True):
        A = {variables[x]: slope for x, slope in slopes(g, node, places).items()}
        levers = np.abs(point.array(list(A.values()))) * sizes[list(A)]
        scale = max(abs(value), abs(target), np.max(levers, initial=0.0))
        found.append(Residual(float(value - target), float(scale), float(error)))
        moving = any(j >= point.n for j in A)
        forms.append(Form(node, {} if moving else A, target))
    own = Lengths(point, forms).scales()
    return [_of_size(residual, x) for residual, x in zip(found, own, strict=True)]
