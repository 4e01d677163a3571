"""Verdicts on the relations at the start, and modes of contacts and other laws.

The residual of a relation g = 0 is compared with the largest of its terms and, over the
coordinates q_i, of |q_i dg/dq_i|, but at most with the relation's own size
(`Lengths.scales`): far from the origin the terms grow, though the relation does not
change. A rate is compared with its terms, but at most with the motion in the relation,
and at least with a tenth of this motion: so a relation whose coefficients vanish at the
start is judged like its neighbours.

Contacts that are closed and approach have an impact at once; for contacts that are
closed and at rest, the accelerations decide which rows hold, slide or open. A timed
equality is judged like any other while it is in force.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import (
    LINKS,
    Condition,
    Lengths,
    Point,
    gradient_of,
    of_rows,
)
from lagsim.admissibility.rank import analyse
from lagsim.codes.known import PAINLEVE
from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import addends, evaluate
from lagsim.language.names import rate_of
from lagsim.language.sparse import joined
from lagsim.mechanics.algebra import Metric, least_squares
from lagsim.mechanics.constraints import constraint_row
from lagsim.mechanics.pieces import whole
from lagsim.mechanics.reduction import at_limit
from lagsim.mechanics.rows import Closed, Mode, RowTable, delassus
from lagsim.notes import Caution
from lagsim.tolerances import CONVERGED, RESIDUAL_ROUNDOFF, SATISFIED

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Law, Row
    from lagsim.mechanics.equations import Equations

ONE_SIDED = "one-sided"
START_VALUE = "start value"
AT_REST = "at rest"
# Safety factor of bounds of rounding errors, which are of first order.
CAUTION = 4.0
# Least scale of a rate, relative to the motion in the relation.
MOTION = 0.1
_HELD = (Mode.HELD, Mode.REDUNDANT)


class Residual(NamedTuple):
    """Residual of a relation, or of its rate.

    Attributes
    ----------
    value, scale : float
        The residual, and the size that it is compared with.
    rounding : float
        Bound of the error that the expressions of the start leave in the residual.
    size : str
        Description of `scale` in messages.
    floor : float
        Bound of the rounding error of the residual if all values have full double
        precision, from the size of the relation or of the motion.
    """

    value: float
    scale: float
    rounding: float
    size: str = "its largest term"
    floor: float = 0.0

    @property
    def bound(self) -> float:
        """Largest |value| with which the relation counts as satisfied."""
        return max(SATISFIED * self.scale, self.rounding, self.floor)

    @property
    def why(self) -> str:
        """Description, for messages, of the size from which `bound` follows."""
        if self.rounding == self.bound:
            return "the rounding error of the start"
        if self.floor == self.bound:
            return "the rounding of numbers in full precision"
        return f"{SATISFIED:g} of {self.size}"

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
        """Number of leading digits to which the residual vanishes, at least 1.

        So many digits the stated start values seem to have. None if the relation is
        exact to rounding, or not satisfied.
        """
        exact = self.exact or abs(self.value) <= RESIDUAL_ROUNDOFF * self.scale
        if not self.satisfied or exact:
            return None
        return max(1, int(-math.log10(abs(self.value) / self.scale)))


class RelationResiduals(NamedTuple):
    """Residuals of one relation at the start.

    Attributes
    ----------
    name, kind : str
    scleronomic, pfaffian : bool
        Whether the relation is independent of t, and affine in the velocities.
        `pfaffian` is None for holonomic relations.
    position : Residual
        The residual of a relation g = 0 of positions, or of a relation between
        velocities.
    velocity : Residual or None
        The residual of the rate dg/dt of a holonomic relation.
    redundant : bool
        Whether the row depends on other rows at all nearby states.
    integrable : bool or None
        Whether a Pfaffian relation alone is integrable; None if undecided, or for other
        relations.
    undecided : str
        Why `integrable` is undecided, for a Pfaffian relation.
    judged : bool
        Whether a start has to satisfy the relation.
    rate : Residual or None
        For laws: the rate of a gap, or a slip.
    active : bool or None
        Whether a contact touches, a freewheel may engage, another law is in force; None
        for permanent equalities.
    holds : bool or None
        Whether the law acts at the start; None if undecided.
    mode : str
        Mode of the law, as text.
    limit : Residual or None
        Of a slider without mass: its limit minus its force.
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
    limit: Residual | None = None

    @property
    def satisfied(self) -> bool:
        """Whether position and velocity satisfy the relation."""
        if self.limit is not None:
            return self.limit.value >= -self.limit.bound
        if not self.judged:
            return True
        if self.kind == ONE_SIDED:
            return self.position.value >= -self.position.bound
        return self.position.satisfied and (
            self.velocity is None or self.velocity.satisfied
        )


# --- Equalities


def verdicts_on(point: Point) -> list[RelationResiduals]:
    """Return verdicts on the equality rows."""
    rows = point.e.rows
    positions = _against_terms(point, [(r.residual, r.residual_scale) for r in rows])
    moving = _against_terms(point, [(r.rate, r.rate_scale) for r in rows])
    # A residual within rounding is satisfied independent of its scale.
    pairs = enumerate(zip(positions, moving, strict=True))
    inexact = [i for i, (x, y) in pairs if not (x.exact and y.exact)]
    near = _neighbours(point, inexact)
    lengths = of_rows(point, [rows[i] for i in (*inexact, *near)])
    scales, motions = lengths.scales(), lengths.motions()
    whole = body_motions(point, [rows[i].A.entries for i in inexact])
    for i, scale, motion, body in zip(inexact, scales, motions, whole, strict=False):
        moving[i] = _of_rate(moving[i], motion, body)
        positions[i] = _of_size(positions[i], scale) if rows[i].holonomic else moving[i]
    return [_of_row(*row) for row in zip(rows, positions, moving, strict=True)]


def _of_row(row: Row, position: Residual, velocity: Residual) -> RelationResiduals:
    return RelationResiduals(
        name=row.name,
        kind="holonomic" if row.holonomic else "nonholonomic",
        scleronomic=row.scleronomic,
        pfaffian=None if row.holonomic else row.pfaffian,
        position=position,
        velocity=velocity if row.holonomic else None,
    )


def _against_terms(point: Point, pairs: Sequence[tuple[int, int]]) -> list[Residual]:
    """Return residuals of relations at a point, compared with their terms.

    pairs : for each relation, the graph nodes of its residual and of the size of its
        terms.
    """
    nodes = [node for node, _ in pairs]
    values, rounding = point.array(nodes), CAUTION * point.rounding(nodes)
    found = (values, point.array([scale for _, scale in pairs]), rounding)
    return [Residual(*row) for row in zip(*(x.tolist() for x in found), strict=True)]


def _neighbours(point: Point, rows: Sequence[int]) -> list[int]:
    """Return indices of rows on which the scales of the given rows depend.

    The result has the rows that share a coordinate with a given row, directly or
    through a chain of at most LINKS - 1 other rows.

    rows : indices of the given rows, which the result excludes.
    """
    found = set(rows)
    columns = [set(row.A.entries) for row in point.e.rows]
    for _ in range(LINKS):
        known = {j for i in found for j in columns[i]}
        found |= {i for i, touched in enumerate(columns) if touched & known}
    return sorted(found - set(rows))


def _of_size(residual: Residual, own: float) -> Residual:
    """Return the residual with its scale limited to `own`, the relation's own size."""
    if not np.isfinite(own):
        return residual
    residual = residual._replace(floor=float(RESIDUAL_ROUNDOFF * own))
    if own >= residual.scale:
        return residual
    return residual._replace(scale=float(own), size="the lengths that it relates")


def _of_rate(residual: Residual, motion: float, body: float) -> Residual:
    """Return the residual of a rate, with a scale limited by the size of the motion.

    motion : size of the motion in the relation; a tenth of it is the least scale.
    body : size of the motion of the bodies in the relation, to which rounding is
        relative.
    """
    scale, size = residual.scale, residual.size
    if motion < residual.scale:
        scale, size = float(motion), "the velocities that it relates"
    elif np.isfinite(motion) and MOTION * motion > residual.scale:
        scale = float(MOTION * motion)
        size = "a tenth of the velocities that it relates"
    return residual._replace(scale=scale, size=size, floor=CONVERGED * body)


def body_motions(point: Point, rows: Sequence[Mapping[int, int]]) -> list[float]:
    """Return |A| |v| for each row A, over all coordinates coupled to it by inertia.

    The norms are those of scaled coordinates, see `point.Point.sizes`. A rate that is
    compared with this size is accurate to CONVERGED at best.

    rows : the entries of each row: index of a coordinate -> node.
    """
    if not rows:
        return []
    weights = point.sizes
    bodies = np.array(joined(point.n, (own for _, own in point.e.coupled)))
    found = []
    for row in rows:
        columns = list(row)
        A = point.array(list(row.values())) / weights[columns]
        body = np.isin(bodies, [bodies[j] for j in columns])
        motion = np.linalg.norm((weights * point.v)[body])
        found.append(float(np.linalg.norm(A) * motion))
    return found


# --- Constraints that hold at times, and start values


def judge_laws(point: Point, off: Collection[str]) -> list[RelationResiduals]:
    """Return verdicts on the constraints that have no row among the rows of `point`.

    A gap and the rate of a freewheel must not be negative; a limited equality may slip;
    constraints in `off`, out of force, are not judged.
    """
    equalities = {row.name for row in point.e.rows}
    laws = [
        law
        for law in point.e.laws
        if not law.slips and law.constraint not in equalities
    ]
    rows = [law.row for law in laws]
    values = _against_levers(point, [(r.residual, 0.0) for r in rows])
    rates = _against_levers(point, [(r.rate, 0.0) for r in rows])
    bodies = body_motions(point, [r.A.entries for r in rows])
    found = []
    for law, value, rate, body in zip(laws, values, rates, bodies, strict=True):
        moving = rate._replace(floor=CONVERGED * body)
        residual = value if law.row.holonomic else moving
        in_force = law.constraint not in off
        limit = _of_limit(point, law)
        found.append(_of_law(law, residual, moving, limit, in_force=in_force))
    return found


def _of_limit(point: Point, law: Law) -> Residual | None:
    """Return the limit minus the force of a slider without mass, as a residual.

    None for laws of other kinds.
    """
    if not (law.slider and law.slider.first and law.solved.holonomic):
        return None
    limit = [law.slider.limit]
    value, bound = point.array([*limit, law.bound])
    rounding = CAUTION * point.rounding(limit)[0]
    return Residual(float(value), float(abs(bound)), float(rounding), "the limit")


def _of_law(
    law: Law, value: Residual, rate: Residual, limit: Residual | None, *, in_force: bool
) -> RelationResiduals:
    signed, active = law.one_sided, in_force
    found = _of_row(law.row, value, rate)
    if signed:
        found = found._replace(kind=ONE_SIDED, velocity=None)
        active = in_force and value.value <= max(value.rounding, value.floor)
    return found._replace(
        name=law.constraint,
        limit=limit,
        judged=signed and in_force,
        rate=rate,
        active=active,
        holds=None if in_force else False,
        mode="" if in_force else "out of force",
    )


def of_gaps(verdicts: Sequence[RelationResiduals]) -> list[RelationResiduals]:
    """Return the verdicts with the verdicts on the pieces of each gap merged into one.

    The merged verdict is that on the least piece.
    """
    found: dict[str, list[RelationResiduals]] = {}
    for x in verdicts:
        found.setdefault(whole(x.name), []).append(x)
    return [
        _of_gap(name, own) if len(own) > 1 else own[0] for name, own in found.items()
    ]


def _of_gap(name: str, own: Sequence[RelationResiduals]) -> RelationResiduals:
    """Return one verdict on the gap `name` from the verdicts on its pieces.

    It is the verdict on the least piece that holds, else on the least closed piece,
    else on the least piece; its `position` is always that of the least piece.

    own : the verdicts on the pieces.
    """
    least = min(own, key=lambda x: (not x.holds, not x.active, x.position.value))
    position = min((x.position for x in own), key=lambda x: x.value)
    return least._replace(name=name, position=position)


def judge_starts(point: Point) -> list[RelationResiduals]:
    """Return verdicts on start values of definitions, and of steady states.

    A steady state is a first-order state whose start value is a guess: its rate is to
    be 0.
    """
    starts = [(x.node, x) for x in point.e.model.initial if x.node is not None]
    rates = {x.name: x.rate for x in point.e.states}
    starts += [
        (rates[x.name], x._replace(name=rate_of(x.name), value=0.0, text="0"))
        for x in point.e.model.initial
        if x.guess and x.name in rates
    ]
    missed = _against_levers(point, [(node, x.value) for node, x in starts])
    found = []
    for (_, start), residual in zip(starts, missed, strict=True):
        rounding = residual.rounding + CAUTION * start.error
        position = residual._replace(rounding=rounding)
        name = f"{start.name}: {start.text}"
        found.append(RelationResiduals(name, START_VALUE, True, None, position, None))
    return found


def _against_levers(
    point: Point, targets: Sequence[tuple[int, float]]
) -> list[Residual]:
    """Return the differences of nodes from target values, with scales, as residuals.

    The scale of the residual of a node g is the largest of |g| and, over the
    coordinates q_i, of |q_i dg/dq_i|.

    targets : pairs (node, value).
    """
    sizes, nodes = np.abs([*point.q, *point.v]), [node for node, _ in targets]
    values, rounding = point.array(nodes), CAUTION * point.rounding(nodes)
    found, forms = [], []
    for (node, target), value, error in zip(targets, values, rounding, strict=True):
        A = gradient_of(point, node)
        terms = np.abs(point.array(list(A.values()))) * sizes[list(A)]
        scale = max(abs(value), abs(target), np.max(terms, initial=0.0))
        found.append(Residual(float(value - target), float(scale), float(error)))
        moving = any(j >= point.n for j in A)
        forms.append(Condition("", node, {} if moving else A, node, target))
    own = Lengths(point, forms).scales()
    return [_of_size(residual, x) for residual, x in zip(found, own, strict=True)]


def judge_rest(
    point: Point, laws: Sequence[RelationResiduals], *, velocities: bool = True
) -> list[RelationResiduals]:
    """Return verdicts on a rest: velocities, or accelerations if velocities vanish.

    Parameters
    ----------
    point : Point
    laws : sequence of RelationResiduals
        Verdicts on the laws. The forces of active laws act.
    velocities : bool
        Whether velocities are judged, too.
    """
    e = point.e
    own = acting(point, laws)
    v = own.v if own.struck else point.v  # a wall that appears sets bodies in motion
    moving = [
        at_rest(name, rate, abs(point.errors.get(name, 0.0)))
        for name, rate in zip(e.velocities, v.tolist(), strict=True)
        if rate and velocities
    ]
    if not all(x.satisfied for x in moving):
        return moving
    a, terms, K = accelerations(point)
    pushes, sizes = point.jacobian(own.rows).T @ own.multipliers, point.sizes
    f, A = point.array(e.f) + pushes, point.gradients
    lam = np.zeros(0)
    if len(A):
        lam = least_squares(A.T / sizes[:, None], -f / sizes)
    sums = [addends(point.g, node) for node in e.f]
    values = np.abs(point.array([x for row in sums for x in row]))
    place = np.repeat(np.arange(point.n), [len(row) for row in sums])
    bounds = SATISFIED * np.bincount(place, values, point.n)
    bounds += CAUTION * point.rounding(e.f)
    # Bounds for the constraint forces A^T lambda: their size and the rounding of A.
    for row, multiplier in zip(
        (*e.rows, *own.rows), np.abs([*lam, *own.multipliers]), strict=True
    ):
        nodes, columns = [*row.A.entries.values()], [*row.A.entries]
        bounds[columns] += multiplier * (
            SATISFIED * np.abs(point.array(nodes)) + CAUTION * point.rounding(nodes)
        )
    bounds = np.abs(K) @ np.nan_to_num(bounds) + RESIDUAL_ROUNDOFF * terms
    # K itself is rounded, also between bodies that are not connected, and so are the
    # multipliers; dependent rows share one force.
    pushing = np.abs(point.jacobian(own.rows)).T @ np.abs(own.multipliers)
    pushing += np.abs(point.array(e.f))
    bounds += RESIDUAL_ROUNDOFF * float(np.linalg.norm(pushing / sizes)) / sizes
    pairs = zip(e.accelerations, a + K @ pushes, bounds, strict=True)
    return [at_rest(name, float(x), float(bound)) for name, x, bound in pairs]


def at_rest(name: str, value: float, bound: float) -> RelationResiduals:
    """Return the verdict on a value that is to be zero within a bound."""
    return RelationResiduals(
        name, AT_REST, True, None, Residual(value, 0.0, bound), None
    )


# --- State of the laws of constraints at the start


def out_of_force(equations: Equations, time: float) -> frozenset[str]:
    """Return the constraints whose condition `when` is not satisfied at a time."""
    whens = {law.constraint: x for law in equations.laws if (x := law.when) is not None}
    values = {p.name: p.value for p in equations.model.parameters} | {"t": time}
    found = evaluate(equations.graph, whens.values(), values)
    return frozenset(name for name, on in zip(whens, found, strict=True) if not on)


def with_timed(equations: Equations, off: frozenset[str]) -> Equations:
    """Return equations whose rows include the timed equalities that are in force.

    A timed equality has a condition `when`.

    off : names of constraints out of force.
    """
    timed = [
        law.row for law in equations.laws if law.equal and law.constraint not in off
    ]
    if not timed:
        return equations
    place = {c.name: k for k, c in enumerate(equations.model.constraints)}
    rows = sorted((*equations.rows, *timed), key=lambda row: place[row.name])
    return replace(equations, rows=tuple(rows))


def one_sided(point: Point, names: Collection[str]) -> dict[str, Row]:
    """Return by name the rows of contacts, freewheels, and sliders at their limits.

    names : the names of the constraints; constraints of other kinds are left out.
    """
    e, found = point.e, {}
    for law in e.laws:
        if law.constraint in names and law.one_sided:
            found[law.constraint] = law.row
        elif law.constraint in names and law.slider and law.slider.first:
            node = at_limit(point.g, law, float(point.array([law.slider.force])[0]))
            row = constraint_row(point.g, law.constraint, node, e.flow)
            found[law.constraint] = row
    return found


def in_force(
    verdicts: Sequence[RelationResiduals], equations: Equations
) -> list[RelationResiduals]:
    """Return the verdicts, in which judged timed equalities are set to be in force.

    For these `active` is True, `holds` is whether the start satisfies the equality, and
    `mode` is "in force". A timed equality has a condition `when`.
    """
    timed = {law.constraint for law in equations.laws if law.when is not None}
    return [
        v._replace(active=True, holds=v.satisfied, mode="in force")
        if v.name in timed and v.active is None
        else v
        for v in verdicts
    ]


_PARADOX = Caution(
    PAINLEVE,
    "at the start the laws of friction contradict each other (Painlevé's "
    "paradox): a sliding contact has no positive effective mass",
)


def contact_status(
    point: Point, verdicts: Sequence[RelationResiduals], rank: int, *, sound: bool
) -> tuple[list[RelationResiduals], int, list[Caution]]:
    """Decide the modes of laws at the start.

    Parameters
    ----------
    point : Point
    verdicts : sequence of RelationResiduals
        The verdicts on the laws.
    rank : int
        The rank of the equalities in force.
    sound : bool
        Whether the state is admissible. If not, modes are undecided, and limited
        equalities without slip count as held.

    Returns
    -------
    verdicts : list of RelationResiduals
        The verdicts with `holds` and `mode` set.
    raised : int
        The rank added by limited equalities that hold.
    warnings : list of Caution
        Warnings about the modes.
    """
    found, paradox = list(verdicts), False
    if sound:
        laws = acting(point, verdicts)
        paradox = laws.paradox
        found = [_with_mode(x, laws, point) for x in verdicts]
    limited = {x.constraint: x.row for x in point.e.laws if x.limited}
    holding = [
        limited[x.name]
        for x in found
        if x.name in limited and (x.holds if sound else x.active and x.position.exact)
    ]
    raised = 0
    if holding:
        more = replace(point.e, rows=(*point.e.rows, *holding))
        raised = analyse(Point(more, point.state, point.errors), ()).rank - rank
    return found, raised, [_PARADOX] if paradox else []


class LawsAtStart(NamedTuple):
    """Modes of laws at the start, and impacts.

    Attributes
    ----------
    modes : mapping of int to Mode
        Modes by index of the law.
    struck : collection of str
        Contacts with an impact.
    paradox : bool
        Whether the friction laws have no solution (Painlevé).
    rows : sequence of Row
        Rows that may act.
    multipliers : ndarray, shape (rows,)
        The multipliers of these rows.
    v : ndarray, shape (n,)
        The velocities after the impact.
    """

    modes: Mapping[int, Mode]
    struck: Collection[str] = ()
    paradox: bool = False
    rows: Sequence[Row] = ()
    multipliers: Floats = np.zeros(0)
    v: Floats = np.zeros(0)

    @property
    def holding(self) -> set[int]:
        """The indices of the laws whose rows hold."""
        return {k for k, mode in self.modes.items() if mode in _HELD}


def acting(point: Point, verdicts: Sequence[RelationResiduals]) -> LawsAtStart:
    """Determine the modes of laws at the start, and impacts.

    Only the laws act whose verdicts are `active`.
    """
    laws, sliders = point.e.laws, _sliders(point)
    active = {v.name for v in verdicts if v.active}
    chosen = [
        k for k, law in enumerate(laws) if law.constraint in active and law.by_forces
    ]
    if not chosen:
        return LawsAtStart(sliders)
    # Most models have no laws in force at the start.
    from lagsim.mechanics.impacts import impact
    from lagsim.mechanics.row_modes import modes

    before = _LawValues(point, chosen)
    rates, rounding = before.rates, before.rounding
    approach = [k for k, low in zip(chosen, rates < -rounding, strict=True) if low]
    struck = {laws[k].constraint for k in approach if laws[k].gapped}
    if struck:
        hit = impact(before.closed, rates, rounding)
        point = point.at(v=point.v + before.delassus.response @ hit.impulses)
        terms = np.abs(before.closed.D) @ np.abs(hit.impulses) + np.abs(rates)
        rates, rounding = hit.after, rounding + RESIDUAL_ROUNDOFF * terms
    parts = [k for k, high in zip(chosen, rates > rounding, strict=True) if high]
    one_sided = {k for k in parts if laws[k].one_sided}
    left = [k for k in chosen if k not in one_sided and laws[k].normal not in one_sided]
    if not left:
        return LawsAtStart(sliders, struck, v=point.v)
    after = _LawValues(point, left)
    small = rounding[[chosen.index(k) for k in left]]
    found = modes(after.closed, *after.accelerations(), small)
    own = {**dict(zip(left, found.mode, strict=True)), **sliders}
    multipliers = found.multipliers
    return LawsAtStart(own, struck, found.paradox, after.rows, multipliers, point.v)


def _sliders(point: Point) -> dict[int, Mode]:
    """Return the mode (held or sliding) of each slider without mass, by index.

    The index is that of the law.
    """
    own = {k: x.slider for k, x in enumerate(point.e.laws) if x.slider}
    if not own:
        return {}
    laws, v = point.e.laws, point.v.copy()
    for k, x in own.items():  # the velocities of sticking slips
        slip, slope = point.array([laws[k].row.rate, laws[k].row.A[x.coordinate]])
        v[x.coordinate] -= slip / slope
    point, found = point.at(v=v), dict[int, Mode]()
    for k, x in own.items():
        if x.first:
            nodes = [x.limit, *tangent(point.g, [x.limit], point.e.flow.forward)]
            inside, rate = point.array(nodes)
            small, slow = CAUTION * point.rounding(nodes)
            slides = inside <= small and (rate < -slow or inside < -small)
            pair = (laws[k].pair,) if laws[k].pair >= 0 else ()
            found |= dict.fromkeys((k, *pair), Mode.SLIDING if slides else Mode.HELD)
    return found


class _LawValues:
    """Gaps, rates and Delassus matrix of some laws at a state, as numbers.

    Parameters
    ----------
    point : Point
        The state.
    chosen : sequence of int
        Indices of the laws, r in all.

    Attributes
    ----------
    rates, rounding : ndarray, shape (r,)
        Rates of the rows, and their rounding errors.
    R : ndarray, shape (r, n)
        The rows.
    closed : Closed
        The laws as closed contacts, for the solution of their modes.
    """

    def __init__(self, point: Point, chosen: Sequence[int]) -> None:
        self.point, laws = point, [point.e.laws[k] for k in chosen]
        self.rows = [law.row for law in laws]
        nodes = [row.rate for row in self.rows]
        self.rates = point.array(nodes)
        bodies = body_motions(point, [x.A.entries for x in self.rows])
        rounding = CAUTION * point.rounding(nodes)
        self.rounding = np.maximum(rounding, CONVERGED * np.array(bodies))
        self.R = point.jacobian(self.rows)
        self.delassus = matrix = delassus(point.mass_matrix, point.gradients, self.R)
        g = point.g
        bounces = [
            g.constant(x.restitution) if x.bounce is None else x.bounce for x in laws
        ]
        limits = ([x.bound for x in laws], [x.static for x in laws])
        bounds, statics = (np.maximum(point.array(x), 0.0) for x in limits)
        self.closed = Closed(
            RowTable.of(point.e.laws).part(chosen), matrix.D, bounds, statics,
            point.array(bounces), matrix.factor,
        )  # fmt: skip

    def accelerations(self) -> tuple[Floats, Floats, Floats]:
        """Return accelerations, rates and rounding errors of the rows, each (r,).

        The accelerations are R q'' - b, with R the rows and q'' without the forces of
        these laws.
        """
        R, b = self.R, self.point.array([row.b for row in self.rows])
        a, terms, _ = accelerations(self.point)
        rounding = RESIDUAL_ROUNDOFF * (np.abs(R) @ terms + np.abs(b))
        return R @ a - b, self.rates, rounding


def accelerations(point: Point) -> tuple[Floats, Floats, Floats]:
    """Return accelerations (n,) under the equalities, terms (n,), and K (n, n).

    No law acts. The terms are the sums of the magnitudes of all terms of the
    accelerations. K f is the change of the accelerations by further forces f (n,).
    """
    M, A, e = point.mass_matrix, point.gradients, point.e
    f, forced = point.array(e.f), np.zeros(point.n)
    if len(A):
        targets = point.array([row.b for row in e.rows])
        forced = least_squares(A / point.sizes, targets, None) / point.sizes
    K = delassus(M, A, np.eye(point.n)).response
    if e.has_drags:
        drags = point.forces_of(e.rows) - A
        f = Metric(M, A, drags).with_drags(f, forced)
    terms = np.abs(K) @ (np.abs(f) + np.abs(M) @ np.abs(forced)) + np.abs(forced)
    return forced + K @ (f - M @ forced), terms, K


def _with_mode(
    verdict: RelationResiduals, found: LawsAtStart, point: Point
) -> RelationResiduals:
    """Return the verdict on a law, with its mode at the start as text.

    found : the modes of the laws.
    """
    if verdict.active is None or verdict.mode:
        return verdict
    laws = point.e.laws
    own = [k for k in found.modes if laws[k].constraint == verdict.name]
    law = next(x for x in laws if x.constraint == verdict.name)
    slips = [k for k in own if laws[k].slips]
    main = [k for k in own if k not in slips]
    holds = bool(main) and main[0] in found.holding
    mode = law.role.words[0 if holds else 1]
    if verdict.name in found.struck:
        mode = "impact"
    elif law.gapped and holds and slips:
        mode = laws[slips[0]].role.words[0 if found.holding.issuperset(slips) else 1]
    return verdict._replace(holds=holds, mode=mode)
