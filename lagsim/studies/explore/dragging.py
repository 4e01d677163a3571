"""Start positions with a given place of a scene point, or a given value.

The coordinates change least in the metric of the mass matrix M, on the constraints of
positions, and no gap becomes negative: a point that is dragged into a floor slides
along it. A place that cannot be reached is approached as far as possible. Velocities of
the start change least so that the constraints hold; a contact may be approached, which
is an impact.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import (
    Condition,
    Point,
    defined_conditions,
    implied_conditions,
)
from lagsim.admissibility.verdict import out_of_force, with_timed
from lagsim.language.derivatives import slopes
from lagsim.mechanics.algebra import (
    cholesky,
    least_change_metric,
    least_squares,
    null_space,
)
from lagsim.outputs.animation import stage
from lagsim.tolerances import DEPENDENT_ROWS, SATISFIED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.session import Case

# Largest numbers of steps of one drag, and of halvings of a step; the part of the first
# distance to the target that counts as 0. The next drag begins at the end of this one.
MOST_STEPS, MOST_HALVINGS, NONE = 50, 20, 1e-9
# Newton steps onto the constraints; where more are needed, the step was too long.
MOST_CORRECTIONS = 15
# The longest step, of the one before.
LONGER = 4.0
# Relative decrease of the distance below which a drag has reached its minimum.
SLOW = 1e-12
# Step aside from a dead point, relative to coordinates and distance; the least relative
# decrease of the distance that counts.
ASIDE, NEARER = 0.01, 1e-7
# Relative change of coordinates below which a Newton iteration has converged.
CONVERGED = 1e-15
# Residual, and penetration, relative to the scale of the relation, up to which a state
# counts as one on the constraints, and the share of a coordinate that is rounding.
HOLDS, ROUNDING = 1e-9, 1e-15


class _Place(NamedTuple):
    """Place that is moved: a point of the scene, or one coordinate, as nodes.

    Attributes
    ----------
    nodes : sequence of int, length d
        The components.
    slopes : sequence of dict of int to int, length d
        For each component: index of a coordinate -> node of the derivative.
    """

    nodes: Sequence[int]
    slopes: Sequence[Mapping[int, int]]

    def at(self, x: Point) -> tuple[Floats, Floats]:
        """Return the position (d,) of the place at x, and its derivatives (d, n)."""
        return x.array(self.nodes), _dense(self.slopes, x)


class ConstrainedStart:
    """Start of a run, of which points or values can be moved along the constraints.

    Parameters
    ----------
    case : Case
        The case, at whose start the constraints hold.
    """

    def __init__(self, case: Case) -> None:
        off = out_of_force(case.equations, case.start.t)
        e = self.e = with_timed(case.equations, off)
        self._x = Point(e, case.start)
        self._regular = not self._is_singular(self._x)
        self._held, self._rates = (
            implied_conditions(e.rows, velocities=moving)
            + defined_conditions(self._x, velocities=moving)
            for moving in (False, True)
        )
        sided = [x for x in e.laws if x.one_sided and x.constraint not in off]
        self._gaps = implied_conditions((x.row for x in sided), velocities=False)
        self._ways = implied_conditions(
            (x.row for x in sided if not x.row.holonomic), velocities=True
        )

    @property
    def is_free(self) -> bool:
        """Whether the model has no constraint and no contact."""
        return not (self.e.rows or self._gaps or self._ways)

    def dragged(
        self, state: Mapping[str, float], point: str, target: Floats
    ) -> dict[str, float]:
        """Return a start whose point of the scene is at, or nearest to, a target.

        Parameters
        ----------
        state : mapping of str to float
            Time and coordinates before, which satisfy the constraints.
        point : str
            Name of a point of the scene.
        target : ndarray, shape (d,)

        Returns
        -------
        dict of str to float
            Coordinates and velocities by name; those of the start if the point does not
            exist or depends on no coordinate.
        """
        g = self.e.graph
        before = np.array([state[name] for name in self.e.q])
        nodes = stage(self.e.model).points.get(point, ())
        index = {g.variable(name): j for j, name in enumerate(self.e.q)}
        rows = [slopes(g, node, frozenset(index)) for node in nodes]
        place = _Place(nodes, [{index[v]: s for v, s in row.items()} for row in rows])
        x = self._x
        if any(place.slopes):
            x = self._towards(place, x.at(before), target[: len(nodes)])
        return self._named(x, self._with_rates(x))

    def with_value(self, name: str, value: float) -> dict[str, float]:
        """Return a start in which a coordinate or a velocity has a value.

        If the constraints exclude the value, the nearest admissible one is used.

        Parameters
        ----------
        name : str
            A coordinate or a velocity.
        value : float

        Returns
        -------
        dict of str to float
            Coordinates and velocities by name, which satisfy the constraints.
        """
        g, x = self.e.graph, self._x
        if name in self.e.q:
            j = self.e.q.index(name)
            place = _Place([g.variable(name)], [{j: g.one}])
            x = self._towards(place, x, np.array([value]))
            return self._named(x, self._with_rates(x))
        j = self.e.velocities.index(name)
        node = g.variable(name)
        pin = Condition(name, node, {j: g.one}, node, value)
        near = x.at(v=x.v + _correction([*self._rates, pin], x))
        return self._named(x, self._with_rates(near))

    def _named(self, x: Point, v: Floats) -> dict[str, float]:
        return {
            **dict(zip(self.e.q, x.q.tolist(), strict=True)),
            **dict(zip(self.e.velocities, v.tolist(), strict=True)),
        }

    def _with_rates(self, x: Point) -> Floats:
        """Return velocities (n,) that satisfy the constraints, by the least change."""
        conditions = list(self._rates)
        for _ in range(1 + len(self._ways)):
            v = x.v + _correction(conditions, x) if conditions else x.v
            rates = x.at(v=v).array([way.node for way in self._ways])
            scales = x.at(v=v).array([way.scale for way in self._ways])
            least = np.flatnonzero(rates < -SATISFIED * np.abs(scales))
            if not len(least):
                break
            conditions += [self._ways[k] for k in least]
        return v

    def _towards(self, place: _Place, x: Point, target: Floats) -> Point:
        """Return the admissible state nearest to x with a place at a target (d,).

        If the place cannot reach the target, its distance from the target is a minimum.
        """
        x = self._on(x, self._closed(x))
        far = self._far(place, x, target)
        if not np.isfinite(far):
            return self._x
        least, share = NONE * far, 1.0
        for _ in range(MOST_STEPS):
            if far <= least:
                break
            at, J = place.at(x)
            try:
                step, touching = self._step(J, target - at, x)
            except np.linalg.LinAlgError:
                break
            best, nearest, share = self._along(
                place, x, (step, J @ step), touching, target, share
            )
            slow = nearest > (1.0 - SLOW) * far
            if (
                slow
                and (found := self._nearer_state(place, x, target, touching))
                is not None
            ):
                x, far = found, self._far(place, found, target)
                continue
            x, far = best, nearest
            if slow:
                break
        return x

    def _along(
        self,
        place: _Place,
        x: Point,
        step: tuple[Floats, Floats],
        touching: frozenset[int],
        target: Floats,
        share: float,
    ) -> tuple[Point, float, float]:
        """Return the state, along a step, in which a place is nearest to a target.

        Where the target is out of reach, a whole step is too long: fractions of the
        step are tried, from one near the length of the last step on. If none is nearer,
        x is returned.

        Parameters
        ----------
        step : tuple of ndarray
            Changes of the coordinates, and of the place to first order.
        touching : frozenset of int
            Gaps that stay closed.
        share : float
            The first fraction to be tried.

        Returns
        -------
        tuple of (Point, float, float)
            The state, its distance from the target, and the fraction to be tried first
            in the next step.
        """
        best, nearest, part = x, self._far(place, x, target), share
        far, at = nearest, place.at(x)[0]
        for _ in range(MOST_HALVINGS):
            other = self._on(x.at(x.q + part * step[0]), touching)
            new = self._far(place, other, target)
            if _beyond(part * step[1], place.at(other)[0] - at):
                new = math.inf
            if nearest < min(new, far):
                break
            if new < nearest:
                best, nearest, share = other, new, min(1.0, LONGER * part)
            part /= 2.0
        return best, nearest, share

    def _far(self, place: _Place, x: Point, target: Floats) -> float:
        """Return the distance of a place from a target; inf off the constraints.

        Newton's method need not converge where a step has led far away. Where the mass
        matrix alone becomes singular, as in a gimbal lock, the distance is inf, too.
        """
        every = [*self._held, *self._gaps]
        targets = np.array([c.target for c in every])
        values = x.array([c.node for c in every]) - targets
        scales = np.maximum(np.abs(x.array([c.scale for c in every])), np.abs(targets))
        slopes = np.abs(_jacobian(every, x)).sum(axis=1)
        bounds = HOLDS * scales + ROUNDING * slopes * np.max(np.abs(x.q))
        count = len(self._held)
        off = np.append(np.abs(values[:count]), -values[count:])
        if not np.all(off <= bounds) or (self._regular and self._is_singular(x)):
            return math.inf
        return float(np.linalg.norm(target - place.at(x)[0]))

    def _is_singular(self, x: Point) -> bool:
        M = x.mass_matrix
        scale = np.sqrt(np.abs(np.diagonal(M)))
        if not np.all(scale > 0.0):
            return True
        return bool(np.linalg.eigvalsh(M / np.outer(scale, scale))[0] < DEPENDENT_ROWS)

    def _nearer_state(
        self, place: _Place, x: Point, target: Floats, touching: frozenset[int]
    ) -> Point | None:
        """Return a state beside the dead point x that is nearer to a target; else None.

        At a dead point no step to first order moves the place, as where a coordinate is
        largest on a circle. Of two directions that lead equally near to the target, the
        one in which the forces pull is used.

        place : the place that is moved.
        target : (d,), the components of the target.
        touching : gaps that stay closed.
        """
        far = self._far(place, x, target)
        L = cholesky(least_change_metric(x.mass_matrix))
        conditions = [*self._held, *(self._gaps[k] for k in sorted(touching))]
        free = (
            null_space(_scaled(_jacobian(conditions, x), L))
            if conditions
            else np.eye(x.n)
        )
        J, force = _scaled(place.at(x)[1], L), x.array(self.e.f)
        best, nearest = None, (1.0 - NEARER) * far
        for basis in free.T:
            way = np.linalg.solve(L.T, basis)
            moved = float(np.linalg.norm(J @ basis))
            if moved > DEPENDENT_ROWS * float(np.linalg.norm(J)):
                continue
            size = ASIDE * max(float(np.max(np.abs(x.q))), far)
            way *= np.copysign(size / float(np.max(np.abs(way))), force @ way)
            for step in (way, -way):
                other = self._on(x.at(x.q + step), touching)
                new = self._far(place, other, target)
                if new < nearest:
                    best, nearest = other, (1.0 - NEARER) * new
        return best

    def _closed(self, x: Point) -> frozenset[int]:
        """Return the indices of gaps that are closed within the bound of a start."""
        gaps = x.array([gap.node for gap in self._gaps])
        scales = x.array([gap.scale for gap in self._gaps])
        return frozenset(np.flatnonzero(gaps <= SATISFIED * np.abs(scales)).tolist())

    def _step(self, J: Floats, way: Floats, x: Point) -> tuple[Floats, frozenset[int]]:
        """Return a step that moves a place, and the closed gaps that it keeps closed.

        A closed gap that the step would make negative is held; the others may open. The
        step ends where it closes the first open gap, to first order, so that it does
        not pass through a body.

        J : (d, n), derivatives of the place.
        way : (d,), the displacement wanted.
        """
        touching, closed = frozenset[int](), self._closed(x)
        A = _jacobian(self._gaps, x)
        while True:
            conditions = [*self._held, *(self._gaps[k] for k in sorted(touching))]
            step = _step(J, way, conditions, x)
            falls = {k: fall for k, fall in enumerate((A @ step).tolist()) if fall < 0}
            more = {k: fall for k, fall in falls.items() if k in closed - touching}
            if not more:
                break
            touching |= {min(more, key=lambda k: more[k])}
        gaps = x.array([gap.node for gap in self._gaps])
        parts = [-gaps[k] / fall for k, fall in falls.items() if k not in closed]
        return min([1.0, *parts]) * step, touching

    def _on(self, x: Point, touching: frozenset[int]) -> Point:
        """Return the state nearest to x at which constraints hold, no gap negative.

        Parameters
        ----------
        x : Point
        touching : set of int
            Indices of gaps that are closed at that state.
        """
        nodes = [gap.node for gap in self._gaps]
        for _ in range(1 + len(nodes)):
            conditions = [*self._held, *(self._gaps[k] for k in sorted(touching))]
            there = _solved(conditions, x)
            gaps = there.array(nodes)
            gaps[sorted(touching)] = 0.0
            if not np.any(gaps < 0.0):
                break
            touching |= {int(np.argmin(gaps))}
        return there


def _beyond(expected: Floats, displacement: Floats) -> bool:
    """Whether a displacement differs from its prediction by more than half of it.

    expected : the linear prediction.
    displacement : the displacement.
    """
    off = np.linalg.norm(displacement - expected)
    return bool(off > np.linalg.norm(expected) / 2.0)


def _step(J: Floats, way: Floats, conditions: Sequence[Condition], x: Point) -> Floats:
    """Return the change of coordinates (n,), least in the metric of M, to move a place.

    Parameters
    ----------
    conditions : sequence of Condition
        Conditions on the coordinates that the change keeps.
    J : ndarray, shape (d, n)
        Derivatives of the place.
    way : ndarray, shape (d,)
        Change of the place.
    """
    L = cholesky(least_change_metric(x.mass_matrix))
    free = np.eye(x.n)
    if conditions:
        free = null_space(_scaled(_jacobian(conditions, x), L))
    z = free @ least_squares(_scaled(J, L) @ free, way)
    return np.asarray(np.linalg.solve(L.T, z))


def _solved(conditions: Sequence[Condition], x: Point) -> Point:
    """Return the state at which conditions on positions hold, nearest to x.

    It is found by steps that are least in the metric of the first state x.

    conditions : the conditions.
    """
    metric = x.mass_matrix if conditions else None
    for _ in range(MOST_CORRECTIONS) if conditions else ():
        change = _correction(conditions, x, metric)
        x = x.at(x.q + change)
        if np.all(np.abs(change) <= CONVERGED * np.maximum(np.abs(x.q), 1e-3)):
            break
    return x


def _correction(
    conditions: Sequence[Condition], x: Point, metric: Floats | None = None
) -> Floats:
    """Return the least change (n,) in the metric of M that satisfies conditions.

    It is one Newton step, which is exact for velocities.

    Parameters
    ----------
    conditions : sequence of Condition
    metric : ndarray, shape (n, n), optional
        The metric; by default the mass matrix at x.
    """
    targets = np.array([c.target for c in conditions])
    residual: Floats = x.array([c.node for c in conditions]) - targets
    try:
        M = x.mass_matrix if metric is None else metric
        L = cholesky(least_change_metric(M))
        A = _scaled(_jacobian(conditions, x), L)
        return np.asarray(np.linalg.solve(L.T, -least_squares(A, residual)))
    except np.linalg.LinAlgError:
        return np.zeros(x.n)


def _jacobian(conditions: Sequence[Condition], x: Point) -> Floats:
    """Return the derivatives (m, n) of m conditions by coordinates or velocities."""
    return _dense([c.A for c in conditions], x)


def _dense(rows: Sequence[Mapping[int, int]], x: Point) -> Floats:
    """Return sparse rows of nodes as a matrix (m, n) of their values at x.

    rows : m rows, each as {index of a coordinate: node}.
    """
    found = np.zeros((len(rows), x.n))
    places = [(i, j) for i, row in enumerate(rows) for j in row]
    values = x.array([node for row in rows for node in row.values()])
    for place, value in zip(places, values, strict=True):
        found[place] = value
    return found


def _scaled(J: Floats, L: Floats) -> Floats:
    """Return J L^-T, derivatives (d, n) by coordinates in which M is the identity.

    J : (d, n).
    L : (n, n), the Cholesky factor of M.
    """
    return np.asarray(np.linalg.solve(L, J.T).T)
