"""Start positions at which a point of the scene is where somebody has dragged it.

The coordinates change least in the metric of M, on the constraints of positions. A
place that the point cannot reach is approached as far as possible. Velocities of the
start change least so that the constraints hold.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import Point, conditions
from lagsim.language.derivatives import slopes
from lagsim.mechanics.algebra import (
    cholesky,
    least_change_metric,
    least_squares,
    null_space,
)
from lagsim.outputs.animation import stage

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.admissibility.point import Condition
    from lagsim.language.arrays import Floats
    from lagsim.run.session import Case

# Steps of one drag, halvings of a step, and the part of the first distance to the
# target that counts as none. A drag is followed by the next one, from where it ended.
MOST_STEPS, MOST_HALVINGS, NONE = 50, 8, 1e-9
# Relative decrease of the distance below which a drag has come as near as it can.
SLOW = 1e-13
# Relative change of coordinates below which a Newton iteration has converged.
CONVERGED = 1e-15


class _Place(NamedTuple):
    """Components of a point of the scene with their derivatives by coordinates.

    Attributes
    ----------
    nodes : sequence of int, length d
    slopes : sequence of dict of int to int, length d
        Index of a coordinate -> node.
    """

    nodes: Sequence[int]
    slopes: Sequence[Mapping[int, int]]

    def at(self, x: Point) -> tuple[Floats, Floats]:
        """Return the place (d,) and its derivatives (d, n)."""
        return x.array(self.nodes), _dense(self.slopes, x)


def dragged(
    case: Case, state: Mapping[str, float], point: str, target: Floats
) -> dict[str, float]:
    """Return coordinates and velocities of the start with a point at a target.

    Parameters
    ----------
    case : Case
    state : mapping of str to float
        Time and coordinates before, which satisfy the constraints.
    point : str
        Name of a point of the scene.
    target : ndarray, shape (d,)

    Returns
    -------
    dict of str to float
        Coordinates and velocities by name; those before if the point does not exist or
        depends on no coordinate.
    """
    e, g = case.equations, case.equations.graph
    before = np.array([state[name] for name in e.q])
    x = Point(e, case.start).at(before, case.start.v)
    nodes = stage(e.model).points.get(point, ())
    index = {g.variable(name): j for j, name in enumerate(e.q)}
    rows = [slopes(g, node, frozenset(index)) for node in nodes]
    place = _Place(nodes, [{index[v]: s for v, s in row.items()} for row in rows])
    held = conditions(e.rows, velocities=False)
    if any(place.slopes):
        x = _on(held, _towards(place, held, x, target[: len(nodes)]))
    rates = conditions(e.rows, velocities=True)
    v = x.v + _correction(rates, x) if rates else x.v
    return {
        **dict(zip(e.q, x.q.tolist(), strict=True)),
        **dict(zip(e.velocities, v.tolist(), strict=True)),
    }


def _towards(
    place: _Place, held: Sequence[Condition], x: Point, target: Floats
) -> Point:
    """Return the state after steps that bring a place near a target."""
    far = float(np.linalg.norm(target - place.at(x)[0]))
    least = NONE * far
    for _ in range(MOST_STEPS):
        if far <= least:
            break
        at, J = place.at(x)
        try:
            step = _step(J, target - at, held, x)
        except np.linalg.LinAlgError:
            break
        # Where the target is out of reach, whole steps are too long.
        best, nearest = x, far
        for _ in range(MOST_HALVINGS):
            other = _on(held, x.at(x.q + step))
            new = float(np.linalg.norm(target - place.at(other)[0]))
            if nearest < min(new, far):
                break
            if new < nearest:
                best, nearest = other, new
            step = step / 2.0
        slow = nearest > (1.0 - SLOW) * far
        x, far = best, nearest
        if slow:
            break
    return x


def _step(J: Floats, way: Floats, held: Sequence[Condition], x: Point) -> Floats:
    """Return the change of coordinates (n,) of least size in the metric of M.

    Parameters
    ----------
    J : ndarray, shape (d, n)
        Derivatives of the place.
    way : ndarray, shape (d,)
        Change of the place.
    """
    L = cholesky(least_change_metric(x.mass_matrix))
    free = np.eye(x.n)
    if held:
        free = null_space(_scaled(_jacobian(held, x), L))
    z = free @ least_squares(_scaled(J, L) @ free, way)
    return np.asarray(np.linalg.solve(L.T, z))


def _on(held: Sequence[Condition], x: Point) -> Point:
    """Return the state with constraints of positions solved by least change."""
    for _ in range(MOST_STEPS) if held else ():
        change = _correction(held, x)
        x = x.at(x.q + change)
        if np.all(np.abs(change) <= CONVERGED * np.maximum(np.abs(x.q), 1e-3)):
            break
    return x


def _correction(asked: Sequence[Condition], x: Point) -> Floats:
    """Return the least change (n,) in the metric of M that solves conditions.

    One Newton step, which is exact for velocities.
    """
    targets = np.array([c.target for c in asked])
    residual: Floats = x.array([c.node for c in asked]) - targets
    try:
        L = cholesky(least_change_metric(x.mass_matrix))
        A = _scaled(_jacobian(asked, x), L)
        return np.asarray(np.linalg.solve(L.T, -least_squares(A, residual)))
    except np.linalg.LinAlgError:
        return np.zeros(x.n)


def _jacobian(asked: Sequence[Condition], x: Point) -> Floats:
    """Return the derivatives of conditions by coordinates or velocities, (m, n)."""
    return _dense([c.A for c in asked], x)


def _dense(rows: Sequence[Mapping[int, int]], x: Point) -> Floats:
    """Return the values (m, n) of nodes in m rows: index of a coordinate -> node."""
    found = np.zeros((len(rows), x.n))
    places = [(i, j) for i, row in enumerate(rows) for j in row]
    values = x.array([node for row in rows for node in row.values()])
    for place, value in zip(places, values, strict=True):
        found[place] = value
    return found


def _scaled(J: Floats, L: Floats) -> Floats:
    """Return J L^-T: derivatives (d, n) by coordinates in which M is the identity."""
    return np.asarray(np.linalg.solve(L, J.T).T)
