"""Is a velocity constraint a holonomic one in disguise? Brackets of motions decide.

The velocities that the constraints admit span a distribution in the space of (q, t).
Its brackets, and theirs with it, span all directions that the motion can reach; what
they leave out are hidden holonomic combinations (Frobenius; Chow and Rashevskii; see
R. Montgomery, A Tour of Subriemannian Geometries, sections 1.6 and 2.2). Brackets are
taken on the graph and evaluated at generic points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lagsim.expressions.derivatives import tangent
from lagsim.expressions.evaluate import evaluate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.point import Point
    from lagsim.constraints import Row
    from lagsim.native.kernel_types import Floats

# Vectors that differ from a span by less than this part of their length lie in it.
INDEPENDENT = 1e-7
POINTS = 2
SPREAD = 0.3
# Brackets swell; beyond this the question is left open.
MOST_NODES = 400_000


@dataclass(frozen=True, slots=True)
class Reach:
    """What the motion can reach.

    Attributes
    ----------
    dimension : int or None
        Dimension of the set of configurations that it can reach; None where that
        cannot be decided, with the `reason`.
    hidden : int or None
        How many independent combinations of the velocity constraints are holonomic.
    entering : tuple of str
        The velocity constraints that enter these combinations.
    """

    dimension: int | None
    hidden: int | None
    entering: tuple[str, ...] = ()
    reason: str = ""


def reach_of(point: Point, rows: Sequence[Row], q: Floats) -> Reach:
    """Decide what the motions that `rows` admit can reach from near q."""
    if any(not row.holonomic and not row.pfaffian for row in rows):
        return Reach(None, None, reason="a relation is not linear in the velocities")
    random = np.random.default_rng(2)  # the same points each time
    found = []
    for _ in range(POINTS):
        size = np.where(np.abs(q) > 0, np.abs(q), 1.0)
        near = q + SPREAD * size * random.standard_normal(len(q))
        time = point.t + SPREAD * abs(random.standard_normal())
        found.append(_Distribution(point, rows, near, time).reach())
    if any(f != found[0] for f in found):
        return Reach(None, None, reason="two generic points disagree")
    return found[0]


class _Distribution:
    """The admissible directions around a point, as vector fields on the graph.

    A field is a node for each of (q, t). Near the point, the constraints determine the
    `bound` directions by the `free` ones.
    """

    def __init__(
        self, point: Point, rows: Sequence[Row], q: Floats, time: float
    ) -> None:
        self.point, self.rows, self.g = point, rows, point.g
        g = self.g
        self.names = [*point.e.q, "t"]
        self.variables = [g.variable(name) for name in self.names]
        self.values = point.values(q, np.zeros_like(q)) | {"t": time}
        zero = {g.variable(name): g.zero for name in point.e.velocities}
        self.forms = []
        for row in rows:
            slopes = g.substitute(row.A, zero)
            self.forms.append([*slopes, g.substitute([row.rate], zero)[0]])
        self.numbers = np.array([self._at(form) for form in self.forms])

    def _at(self, nodes: Sequence[int]) -> Floats:
        return np.array(evaluate(self.g, nodes, self.values))

    def reach(self) -> Reach:
        """Close the distribution under brackets."""
        if not np.all(np.isfinite(self.numbers)):
            return Reach(None, None, reason="the forms are not finite near the start")
        fields = self._fields()
        span = _Span(len(self.names))
        basis = [f for f in fields if span.add(self._at(f))]
        newest = basis
        while newest and span.size < len(self.names):
            if len(self.g) > MOST_NODES:
                return Reach(None, None, reason="the brackets grow too long")
            brackets = [self._bracket(a, b) for a in fields for b in newest]
            newest = [f for f in brackets if span.add(self._at(f))]
        return self._judged(span)

    def _fields(self) -> list[list[int]]:
        """Give fields that span the kernel of the forms around the point."""
        g = self.g
        table = [list(form) for form in self.forms]
        numbers = self.numbers.copy()
        bound: dict[int, int] = {}  # column -> row
        for i in range(len(table)):
            j = int(np.argmax(np.abs(numbers[i])))
            size = np.max(np.abs(self.numbers[i]))
            if abs(numbers[i, j]) <= INDEPENDENT * size or size == 0:
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
        for free in range(len(self.names)):
            if free in bound:
                continue
            field = [g.zero] * len(self.names)
            field[free] = g.one
            for j, i in bound.items():
                field[j] = g.call("neg", table[i][free])
            fields.append(field)
        return fields

    def _bracket(self, a: list[int], b: list[int]) -> list[int]:
        """Give [a, b] = Db a - Da b."""
        g = self.g
        along_a = dict(zip(self.variables, a, strict=True))
        along_b = dict(zip(self.variables, b, strict=True))
        first, second = tangent(g, b, along_a), tangent(g, a, along_b)
        return [g.call("sub", x, y) for x, y in zip(first, second, strict=True)]

    def _judged(self, span: _Span) -> Reach:
        """Read the hidden holonomic combinations off what is reached."""
        # Combinations of the forms that vanish on everything reached.
        scaled = self.numbers / np.maximum(
            np.linalg.norm(self.numbers, axis=1, keepdims=True), 1e-300
        )
        blocked = _kernel((scaled @ span.matrix.T).T)
        kinds = np.array([not row.holonomic for row in self.rows])
        part = blocked[kinds].T
        hidden = int(np.linalg.matrix_rank(part, tol=1e-6)) if part.size else 0
        velocity_rows = [row.name for row in self.rows if not row.holonomic]
        enters = np.any(np.abs(part) > 1e-6, axis=0) if part.size else []
        names = tuple(n for n, e in zip(velocity_rows, enters, strict=False) if e)
        return Reach(span.size - 1, hidden, names)


class _Span:
    """A growing set of independent vectors."""

    def __init__(self, dimension: int) -> None:
        self.matrix = np.empty((0, dimension))

    @property
    def size(self) -> int:
        return len(self.matrix)

    def add(self, vector: Floats) -> bool:
        """Take the vector in if it is independent of those there; tell whether."""
        length = np.linalg.norm(vector)
        if not np.isfinite(length) or length == 0:
            return False
        left = vector / length
        for _ in range(2):
            left = left - self.matrix.T @ (self.matrix @ left)
        rest = np.linalg.norm(left)
        if rest <= INDEPENDENT:
            return False
        self.matrix = np.vstack([self.matrix, left / rest])
        return True


def _kernel(matrix: Floats) -> Floats:
    """Give an orthonormal basis, as columns, of what `matrix` maps to zero."""
    _, sizes, basis = np.linalg.svd(matrix)
    rank = int(np.sum(sizes > 1e-6))
    return np.asarray(basis[rank:].T)
