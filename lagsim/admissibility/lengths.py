"""Lengths of relations, independent of the origin of the coordinates.

A relation is as long as the way along a coordinate on which its gradient changes by as
much as it is long: for a rod its length, for a curve its radius, for a sine one radian.
Moved elsewhere, or measured in other units, it has the same length, while its terms and
|q_i dg/dq_i| grow with the distance from the origin. A relation that is affine has no
length of its own; its coordinates have those of the other relations in which they
stand.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.algebra import least_squares
from lagsim.language.derivatives import tangent
from lagsim.tolerances import STATE_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.point import Point
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Row

# Through so many affine relations a length is handed on.
LINKS = 3
# The constant of an affine relation is rounding below this part of its terms.
ROUNDED = 1e-13
# Where states are varied, a length below this part of the longest is that of a gradient
# that all but vanishes.
TINY = 1e-8
# A length is not handed on if it is more than so many of the form's shortest.
LONG = 1e3
# A least-squares problem takes rows * columns * rank / FITTED operations made.
FITTED = 1000.0


class Form(NamedTuple):
    """What is asked of positions: a node, its gradient, and the value it should have.

    The gradient A gives for the index of a coordinate a node.
    """

    node: int
    A: Mapping[int, int]
    target: float = 0.0


class Lengths:
    """The lengths of relations at a state.

    Attributes
    ----------
    own : list of dict
        For each form: coordinate -> the way along it on which the gradient changes by
        its own length; 0 where the gradient vanishes, inf where it does not change.
    """

    def __init__(self, point: Point, forms: Sequence[Form]) -> None:
        self.point, self.forms = point, forms
        self.weights = point.sizes
        self.columns: list[list[int]] = []
        # Of each form the gradient, then its first and second derivatives by each of
        # the positions that it depends on: in the metric of M.
        self.tables: list[Floats] = []
        self.own: list[dict[int, float]] = []
        self._measure()

    def _measure(self) -> None:
        g, names = self.point.g, self.point.e.q
        place = {g.variable(name): j for j, name in enumerate(names)}
        wanted: list[list[int]] = []
        along: list[list[int]] = []
        for form in self.forms:
            nodes = list(form.A.values())
            wanted.append(nodes)
            along.append(sorted(place[x] for x in g.cone(nodes) if x in place))
            # Entries that a coordinate does not move are not looked through for it.
            moved: dict[int, list[int]] = {k: [] for k in along[-1]}
            for i, node in enumerate(nodes):
                for x in g.cone([node]):
                    if x in place:
                        moved[place[x]].append(i)
            for k, entries in moved.items():
                seed = {g.variable(names[k]): g.one}
                slopes = tangent(g, [nodes[i] for i in entries], seed)
                curvatures = tangent(g, slopes, seed)
                for found in (slopes, curvatures):
                    row = [g.zero] * len(nodes)
                    for i, slope in zip(entries, found, strict=True):
                        row[i] = slope
                    wanted.append(row)
        flat = [node for nodes in wanted for node in nodes]
        values = iter(self.point.array(flat).tolist())
        for form, ways in zip(self.forms, along, strict=True):
            columns = list(form.A)
            rows = 2 * len(ways) + 1
            table = np.array([[next(values) for _ in columns] for _ in range(rows)])
            table = table.reshape(rows, len(columns)) / self.weights[columns]
            self.columns.append(columns)
            self.tables.append(table)
            size = np.linalg.norm(table, axis=1)
            # A gradient that is only the rounding of where it is taken vanishes.
            rounding = STATE_ROUNDOFF * float(size[1::2] @ np.abs(self.point.q[ways]))
            size[0] = size[0] if size[0] > rounding else 0.0
            self.own.append(
                {
                    k: _way(size[0], size[2 * i + 1], size[2 * i + 2])
                    for i, k in enumerate(ways)
                }
            )

    @cached_property
    def coordinates(self) -> Floats:
        """The shortest length at each coordinate, shape (n,); inf where there is none.

        Affine relations hand lengths on, from those of their coordinates that have one.
        """
        return self._shortest(0.0, LONG)

    def _shortest(self, least: float, most: float) -> Floats:
        """Give the shortest lengths that are more than `least` in the metric of M.

        One that is more than `most` of a form's shortest is only that of a special
        direction, as along a rod: the shortest stands for it.
        """
        found = np.full(self.point.n, np.inf)
        for i, own in enumerate(self.own):
            shortest = np.inf if _flat(own) else self._least(i)
            for k, length in own.items():
                way = length * self.weights[k]
                way = shortest if way > most * shortest else way
                if way > least:
                    found[k] = min(found[k], way / self.weights[k])
        return self._handed_on(found)

    def _handed_on(self, found: Floats) -> Floats:
        """Give lengths (n,) where affine forms hand them on."""
        found = found.copy()
        flat = [i for i, own in enumerate(self.own) if _flat(own)]
        for _ in range(LINKS):
            before = found.copy()
            for i in flat:
                slopes = self._slopes(i)
                scale = _longest(slopes, before[self.columns[i]])
                for k, a in zip(self.columns[i], slopes, strict=True):
                    if a > 0.0 and np.isinf(found[k]):
                        found[k] = scale / a
            if np.array_equal(before, found):
                break
        return found

    @cached_property
    def spread(self) -> Floats:
        """How far around the state each coordinate is varied, shape (n,).

        Its length; 0 where no gradient depends on it. Where one does whose length
        cannot be told here (at a double root) it is the others', in the metric of M;
        without any it is the coordinate's own size.
        """
        known = [
            way * self.weights[k]
            for own in self.own
            for k, way in own.items()
            if 0.0 < way < np.inf
        ]
        size = max(known, default=0.0)
        lengths = self._shortest(TINY * size, 1.0)
        size = size or float(np.linalg.norm(self.weights * self.point.q)) or 1.0
        wanted = {k for own in self.own for k in own}
        for k in range(self.point.n):
            if k not in wanted:
                lengths[k] = 0.0
            elif np.isinf(lengths[k]):
                own = 0.0 if known else abs(float(self.point.q[k]))
                lengths[k] = own or size / self.weights[k]
        return lengths

    def scales(self) -> Floats:
        """Give the size of each form by its lengths, (m,); inf where it has none."""
        values = self.point.array([form.node for form in self.forms])
        missed = values - np.array([form.target for form in self.forms])
        return np.array([self._scale(i, x) for i, x in enumerate(missed)])

    def _slopes(self, i: int) -> Floats:
        """Give |A_j| of a form."""
        return np.asarray(np.abs(self.tables[i][0]) * self.weights[self.columns[i]])

    def _scale(self, i: int, value: float) -> float:
        columns, own, slopes = self.columns[i], self.own[i], self._slopes(i)
        if not np.all(np.isfinite(slopes)):
            return np.inf
        if not _flat(own):
            return float(np.linalg.norm(self.tables[i][0])) * self._least(i)
        scale = _longest(slopes, self.coordinates[columns])
        if np.isfinite(scale):
            return scale
        moved = float(self.tables[i][0] @ (self.weights * self.point.q)[columns])
        constant = abs(value - moved)
        terms = float(np.max(slopes * np.abs(self.point.q[columns]), initial=0.0))
        return np.inf if constant <= ROUNDED * terms else max(constant, abs(moved))

    def motions(self) -> Floats:
        """Give the size of the motion that each form sees, shape (m,); inf: not known.

        That is |A| in the metric of M^-1 times |v| in that of M, of the coordinates
        that stand in the form; velocities to which it is blind, here and nearby (both
        ends of a rod alike), do not count.
        """
        return np.array([self._motion(i) for i in range(len(self.forms))])

    def _motion(self, i: int) -> float:
        table, own = self.tables[i], self.own[i]
        if _flat(own) or not np.all(np.isfinite(table)):
            return np.inf
        # Derivatives count as what they make of the gradient over the shortest length.
        ways = [self._least(i) / self.weights[k] for k in own]
        factors = [1.0, *(x for way in ways for x in (way, way * way))]
        seen = table * np.array(factors)[:, None]
        v = (self.weights * self.point.v)[self.columns[i]]
        self.point.g.count(seen.size * min(seen.shape) / FITTED)
        along = seen.T @ least_squares(seen.T, v)
        return float(np.linalg.norm(table[0]) * np.linalg.norm(along))

    def _least(self, i: int) -> float:
        """Give the shortest length of a form, in the metric of M."""
        return float(min(way * self.weights[k] for k, way in self.own[i].items()))


def of_rows(point: Point, rows: Sequence[Row]) -> Lengths:
    """Give the lengths of constraint rows."""
    return Lengths(point, [Form(r.residual, r.A.entries) for r in rows])


def _way(size: float, first: float, second: float) -> float:
    """Give how far a gradient of this size and these derivatives stays what it is."""
    if not (np.isfinite(size) and np.isfinite(first) and np.isfinite(second)):
        return np.inf
    linear = size / first if first > 0.0 else np.inf
    curved = np.sqrt(size / second) if second > 0.0 else np.inf
    return float(min(linear, curved))


def _flat(own: Mapping[int, float]) -> bool:
    """Tell whether a gradient does not change along any coordinate."""
    return all(np.isinf(way) for way in own.values())


def _longest(slopes: Floats, lengths: Floats) -> float:
    """Give the greatest slope * length of those that have a length; inf without."""
    known = np.isfinite(lengths) & (slopes > 0.0)
    return float(np.max(slopes[known] * lengths[known])) if np.any(known) else np.inf
