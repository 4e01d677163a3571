"""Integrability of velocity constraints, by Lie brackets of vector fields.

The velocities that the constraints admit span a distribution in the space of (q, t).
The distribution and its iterated brackets span all directions that the motion can
reach; the forms that vanish on these directions are hidden holonomic combinations
(Frobenius; Chow and Rashevskii; see R. Montgomery, A Tour of Subriemannian Geometries,
sections 1.6 and 2.2). Brackets are formed on the graph and evaluated at generic points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.newton import reach, relations_of
from lagsim.admissibility.point import of_rows
from lagsim.language.derivatives import tangent
from lagsim.language.functions import CHOOSING, STEPS
from lagsim.mechanics.algebra import Span, least_squares, null_space
from lagsim.tolerances import DEPENDENT_DIRECTIONS, HALF_OF_DIGITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.point import Point
    from lagsim.admissibility.verdict import RelationResiduals
    from lagsim.mechanics.constraints import Row

# Functions whose expression differs on the two sides of a switch.
BRANCHED = CHOOSING | STEPS | {"abs"}
# Safety factor of bounds of rounding errors, which are of first order.
CAUTION = 10.0
SPREAD = 0.3
# Number of generic points that must agree, of at most so many trials.
AGREE = 2
TRIALS = 8
NONE_NEARBY = "no admissible states were found nearby"
# Largest number of nodes of the graph for brackets; beyond it the result is undecided.
MOST_NODES = 40_000


class Reach(NamedTuple):
    """Configurations that the motion can reach.

    Attributes
    ----------
    dimension : int or None
        Dimension of the set of reachable configurations; None if undecided.
    hidden : int or None
        Number of independent holonomic combinations of the velocity constraints; None
        if undecided.
    entering : tuple of str
        The names of the velocity constraints in these combinations.
    reason : str
        The reason why the result is undecided; else empty.
    """

    dimension: int | None
    hidden: int | None
    entering: tuple[str, ...] = ()
    reason: str = ""


def classified(
    point: Point, verdicts: Sequence[RelationResiduals]
) -> tuple[list[RelationResiduals], Reach]:
    """Return the verdicts with `integrable` set, and the reach of the motion.

    `integrable` is set for each Pfaffian relation, as if it were the only one. The
    reach is the set of positions that are accessible under all relations.
    """
    rows = {row.name: row for row in point.e.rows}
    whole = reach_of(point, point.e.rows)
    found = list(verdicts)
    for k, verdict in enumerate(verdicts):
        if verdict.pfaffian:
            one = whole if len(rows) == 1 else reach_of(point, [rows[verdict.name]])
            integrable = None if one.hidden is None else one.hidden == 1
            why = one.reason if one.hidden is None else ""
            found[k] = verdict._replace(integrable=integrable, undecided=why)
    return found, whole


def reach_of(point: Point, rows: Sequence[Row]) -> Reach:
    """Return the reach of motions that `rows` admit near the point."""
    if any(not row.holonomic and not row.pfaffian for row in rows):
        return Reach(None, None, reason="a relation is not linear in the velocities")
    # Lie brackets are computed on one branch, and the motion may leave this branch.
    free = all(row.holonomic for row in rows)
    for row in () if free else rows:
        moving = point.g.dependent([*row.A, row.rate], (*point.e.q, "t"))
        ops = (point.g.ops[n] for n in sorted(moving))
        if op := next((op for op in ops if op in BRANCHED), None):
            reason = f"`{row.name}` has another form past the switch of its `{op}`"
            return Reach(None, None, reason=reason)
    if point.is_large:
        return Reach(None, None, reason=f"{point.n} coordinates have too many brackets")
    return _at_generic_points(point.at(v=np.zeros(point.n), errors={}), rows)


def _at_generic_points(point: Point, rows: Sequence[Row]) -> Reach:
    """Return the reach at random points near the point.

    The result is the common reach of AGREE points. The reach is undecided if the points
    disagree, or if none satisfies the rows.
    """
    random = np.random.default_rng(2)  # the same points each time
    q, weights = point.q, point.sizes
    spread = of_rows(point, rows).spread
    # If no gradient depends on a coordinate, its size alone is used.
    own = np.where(np.abs(q) > 0.0, np.abs(q), 1.0 / weights)
    spread = np.where(spread > 0.0, spread, own)
    metric = np.diag(weights**2)
    found: list[Reach] = []
    for _ in range(TRIALS):
        later = point.t + SPREAD * abs(random.standard_normal())
        near = point.at(q + SPREAD * spread * random.standard_normal(len(q)), t=later)
        relations = relations_of(near, rows, velocities=False)
        if relations.conditions:
            reached = reach(relations, near.q, metric)
            if not reached.converged:
                continue
            near = relations.at(reached.x)
        found.append(_Distribution(near, rows).reach())
        if found.count(found[-1]) == AGREE:
            return found[-1]
    reason = "generic points disagree" if found else NONE_NEARBY
    return Reach(None, None, reason=reason)


class _Distribution:
    """Velocities that the rows admit around a point, as vector fields on the graph.

    A vector field is a list of graph nodes, one component for each of (q, t). Near the
    point, the components with the indices `bound` follow from the rows and the other
    components, which are free.
    """

    def __init__(self, point: Point, rows: Sequence[Row]) -> None:
        self.point, self.rows, self.g = point, rows, point.g
        g = self.g
        self.names = [*point.e.q, "t"]
        self.variables = [g.variable(name) for name in self.names]
        # Components of vectors are compared relative to the sizes of their coordinates.
        self.weights = np.append(point.sizes, 1.0)
        self.budget = len(self.g) + MOST_NODES
        zero = {g.variable(name): g.zero for name in point.e.velocities}
        self.forms = []
        for row in rows:
            slopes = g.substitute(row.A, zero)
            self.forms.append([*slopes, g.substitute([row.rate], zero)[0]])
        self.numbers = np.array([point.array(form) for form in self.forms])
        self.scaled = self.numbers / self.weights
        lengths = np.linalg.norm(self.scaled, axis=1, keepdims=True)
        self.scaled /= np.where(lengths > 0, lengths, 1.0)

    def reach(self) -> Reach:
        """Add iterated Lie brackets until the span is complete; return the reach."""
        if not np.all(np.isfinite(self.numbers)):
            return Reach(None, None, reason="the forms are not finite near the start")
        fields = self._fields()
        span = Span(len(self.names))
        newest = [f for f in fields if self._extends(span, f)]
        while newest and span.size < len(self.names):
            brackets = []
            for a, b in ((a, b) for a in fields for b in newest):
                if len(self.g) > self.budget:
                    return Reach(None, None, reason="the brackets grow too long")
                bracket = self._bracket(a, b)
                if self._extends(span, bracket):
                    brackets.append(bracket)
                    if span.size == len(self.names):
                        break
            newest = brackets
        return self._judged(span)

    def _extends(self, span: Span, field: Sequence[int]) -> bool:
        """Extend the span by a vector field; return whether it was independent.

        A field within rounding of the span counts as dependent.
        """
        vector = self.point.array(field) * self.weights
        length = np.linalg.norm(vector)
        if not np.isfinite(length) or length == 0:
            return False
        rest = span.outside(vector / length)
        if np.linalg.norm(rest) <= DEPENDENT_DIRECTIONS:
            return False
        rounding = np.linalg.norm(self.point.rounding(field) * self.weights)
        return span.extend(rest, CAUTION * float(rounding / length))

    def _fields(self) -> list[list[int]]:
        """Return vector fields that span the null space of the rows, as lists of nodes.

        The rows are eliminated with pivots that are not small at the point.
        """
        g = self.g
        table = [list(form) for form in self.forms]
        numbers = self.scaled.copy()
        bound: dict[int, int] = {}  # column -> row
        for i in range(len(table)):
            j = int(np.argmax(np.abs(numbers[i])))
            if abs(numbers[i, j]) <= DEPENDENT_DIRECTIONS:
                continue  # a dependent row
            bound[j] = i
            pivot = table[i][j]
            table[i] = [g.call("div", entry, pivot) for entry in table[i]]
            numbers[i] /= numbers[i, j]
            for k in range(len(table)):
                if k != i and (table[k][j] != g.zero):
                    factor = table[k][j]
                    table[k] = [
                        g.call("sub", a, g.call("mul", factor, b))
                        for a, b in zip(table[k], table[i], strict=True)
                    ]
                    numbers[k] -= numbers[k, j] * numbers[i]
        fields = []
        for free in sorted(set(range(len(self.names))) - bound.keys()):
            field = [g.zero] * len(self.names)
            field[free] = g.one
            for j, i in bound.items():
                field[j] = g.call("neg", table[i][free])
            fields.append(field)
        return fields

    def _bracket(self, a: list[int], b: list[int]) -> list[int]:
        """Return the Lie bracket [a, b] = Db a - Da b of two vector fields, as nodes.

        D is the Jacobian by (q, t).
        """
        g = self.g
        along_a = dict(zip(self.variables, a, strict=True))
        along_b = dict(zip(self.variables, b, strict=True))
        first, second = tangent(g, b, along_a), tangent(g, a, along_b)
        return [g.call("sub", x, y) for x, y in zip(first, second, strict=True)]

    def _judged(self, span: Span) -> Reach:
        """Return the reach that follows from the complete span of all brackets.

        It has the number of hidden holonomic relations, and the constraints in these.
        """
        # A form that vanishes on the span is a combination of the forms; the holonomic
        # rows are known to be such forms.
        known = Span(len(self.names))
        for row, form in zip(self.rows, self.scaled, strict=True):
            if row.holonomic:
                known.extend(form, DEPENDENT_DIRECTIONS)
        blocked = null_space(np.vstack([span.basis, known.basis]), HALF_OF_DIGITS)
        shares = least_squares(self.scaled.T, blocked, DEPENDENT_DIRECTIONS)
        names = tuple(
            row.name
            for row, share in zip(self.rows, shares, strict=True)
            if not row.holonomic and np.any(np.abs(share) > HALF_OF_DIGITS)
        )
        return Reach(span.size - 1, blocked.shape[1], names)
