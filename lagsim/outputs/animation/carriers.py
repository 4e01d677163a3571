"""Forces of constraints on points of a scene.

A constraint acts on the coordinates by Qc = A^T lambda. A force F on a point r of the
scene acts on them by J^T F, with J = dr/dq. If A^T = J^T f for a unique f, then F =
lambda f is the one force on that point that does the same work in every virtual
displacement, and is drawn; a constant component of r has no force. One point is tried
first, then two that a link joins, then any two.

If f is not unique (the bob of a pendulum in its angle moves along a circle: a stop of
the angle is a torque), no force is drawn, but impacts are shown at the point.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.columns import MULTIPLIER, REACTION
from lagsim.language.derivatives import slopes
from lagsim.language.evaluate import evaluate_rows
from lagsim.tolerances import DEPENDENT_ROWS, HALF_OF_DIGITS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model, Scene

# Number of frames in which it is tested which points carry a constraint, and the part
# of the frames in which the points must: at a dead point no point may.
TRIED, MOSTLY = 9, 0.75

# Largest number of points among which pairs without a link are tried, and of displayed
# forces.
FEW_POINTS, MOST_PUSHES = 24, 64


class Push(NamedTuple):
    """Force of a constraint on a point of the scene, in every frame.

    Attributes
    ----------
    constraint, point : str
        Names of both.
    force : ndarray, shape (frames, components)
    """

    constraint: str
    point: str
    force: Floats


class ConstraintPoints(NamedTuple):
    """A constraint row, and the points on which its force acts.

    Attributes
    ----------
    constraint, multiplier : str
        Name of the constraint, and column of the multiplier.
    row : mapping of int to int
        Index of a coordinate -> node of the entry of the row A.
    points : tuple of str
        Names of the points.
    """

    constraint: str
    multiplier: str
    row: Mapping[int, int]
    points: tuple[str, ...]


class Carriers:
    """Points of a scene at which constraint forces act, and these forces.

    Parameters
    ----------
    equations : Equations
    scene : Scene
    values : mapping of str to float or ndarray, shape (count,)
        Parameters and columns.
    count : int
        Number of frames.

    Attributes
    ----------
    struck : dict of str to tuple of str
        Constraint -> names of the points on which its force acts, if known.
    pushes : list of Push
        The forces that are not always 0, friction included.
    carried : list of ConstraintPoints
        The rows that a unique force on one point, or on each of two, can replace.
    jacobians : dict of str to list of dict
        dr/dq of the points that depend on q, a mapping for each component.
    """

    def __init__(
        self,
        equations: Equations,
        scene: Scene,
        values: Mapping[str, float | Floats],
        count: int,
    ) -> None:
        self._e, self._scene = equations, scene
        self._values, self._count = values, count
        self._dimension = scene.dimension
        rows = [(x.name, MULTIPLIER.of(x.name), x.A.entries) for x in equations.rows]
        rows += [(x.name, x.multiplier, x.row.A.entries) for x in equations.laws]
        self.jacobians = self._moving() if rows else {}
        self.struck: dict[str | None, tuple[str, ...]] = {}
        self.carried: list[ConstraintPoints] = []
        found: dict[tuple[str, str], Floats] = {}
        for constraint, multiplier, A in rows:
            points, unique = self._carrier(A)
            if points:
                self.struck.setdefault(constraint, points)
            if unique:
                self.carried.append(ConstraintPoints(constraint, multiplier, A, points))
            if unique and len(found) < MOST_PUSHES:
                for point, force in self._shares(A, multiplier, points):
                    key = constraint, point
                    found[key] = found[key] + force if key in found else force
        self.pushes = [Push(*key, force) for key, force in found.items()]

    def _moving(self) -> dict[str, list[dict[int, int]]]:
        """Return dr/dq of the points that depend on q and on no velocity, by point.

        The derivatives of each component of r are a mapping: index of a coordinate ->
        node.
        """
        e, g = self._e, self._e.graph
        index = {g.variable(name): j for j, name in enumerate(e.q)}
        rates = frozenset(e.velocities)
        found = {}
        for name, parts in self._scene.points.items():
            if g.depends(parts) & rates:
                continue
            rows = [slopes(g, node, frozenset(index)) for node in parts]
            named = [
                {index[v]: s for v, s in row.items() if s != g.zero} for row in rows
            ]
            if any(named):
                found[name] = named
        return found

    def _carrier(self, A: Mapping[int, int]) -> tuple[tuple[str, ...], bool]:
        """Return the points on which forces can replace a constraint row.

        Parameters
        ----------
        A : mapping of int to int
            The constraint row: index of a coordinate -> node.

        Returns
        -------
        points : tuple of str
            The fewest points that suffice; () if none are found.
        unique : bool
            Whether the row determines the forces on these points.
        """
        step = max(1, (self._count - 1) // (TRIED - 1))
        sample = slice(0, None, step)
        several: tuple[str, ...] = ()
        for points in self._candidates():
            reached = {j for p in points for part in self.jacobians[p] for j in part}
            if not A or not A.keys() <= reached:
                continue
            _, holds, unique = self._forces(A, points, sample)
            if np.mean(holds & unique) >= MOSTLY:
                return points, True
            if np.mean(holds) >= MOSTLY:
                several = several or points
        return several, False

    def _candidates(self) -> Iterator[tuple[str, ...]]:
        known = self.jacobians
        yield from ((name,) for name in known)
        linked = [pair for pair in self._scene.links if set(pair) <= known.keys()]
        yield from linked
        if len(known) <= FEW_POINTS:
            pairs = {frozenset(pair) for pair in linked}
            yield from (x for x in combinations(known, 2) if frozenset(x) not in pairs)

    def _forces(
        self, row: Mapping[int, int], points: Sequence[str], frames: slice
    ) -> tuple[Floats, Flags, Flags]:
        """Solve A^T = J^T f for the forces f of a row on points, in some frames.

        Parameters
        ----------
        row : mapping of int to int
            Index of a coordinate -> node of the row A.
        points : sequence of str
            The points, with the derivatives J by the coordinates.
        frames : slice
            The k frames.

        Returns
        -------
        f : ndarray, shape (k, components)
            Components that never vary are left out.
        holds, unique : ndarray of bool, shape (k,)
            Whether f solves the equation, and whether it is unique.
        """
        parts = [part for p in points for part in self.jacobians[p] if part]
        columns = sorted({j for part in parts for j in part})
        zero = self._e.graph.zero
        nodes = [part.get(j, zero) for part in parts for j in columns]
        nodes += [row.get(j, zero) for j in columns]
        count = len(range(*frames.indices(self._count)))
        values = {
            name: x[frames] if isinstance(x, np.ndarray) else x
            for name, x in self._values.items()
        }
        found = evaluate_rows(self._e.graph, nodes, values, count).T
        finite = np.isfinite(found).all(axis=1)
        found[~finite] = 0.0
        n, d = len(columns), len(parts)
        J, A = found[:, :-n].reshape(count, d, n), found[:, -n:]
        f = np.einsum("kn,knd->kd", A, np.linalg.pinv(J, rcond=DEPENDENT_ROWS))
        left = np.abs(np.einsum("kdn,kd->kn", J, f) - A)
        longest = np.abs(f).max(axis=1, keepdims=True)
        terms = np.abs(J).sum(axis=1) * longest + np.abs(A)
        holds: Flags = finite & (left <= HALF_OF_DIGITS * terms).all(axis=1)
        sizes = np.linalg.svd(J, compute_uv=False)
        full: Flags = sizes[:, -1] > DEPENDENT_ROWS * sizes[:, 0]
        return f, holds, full & (d <= n)

    def _shares(
        self, A: Mapping[int, int], name: str, points: Sequence[str]
    ) -> Iterator[tuple[str, Floats]]:
        """Yield name and force of each point on which a constraint row acts.

        Each force is an array (count, components); nan in frames in which the forces
        are not unique.

        A : the row, index of a coordinate -> node.
        name : column of the multiplier.
        points : the points.
        """
        multiplier = self._values.get(name)
        if not isinstance(multiplier, np.ndarray) or not multiplier.any():
            return
        f, holds, unique = self._forces(A, points, slice(None))
        f[~(holds & unique)] = np.nan
        force = f.T * multiplier
        force[:, multiplier == 0.0] = 0.0
        varying = iter(force)
        for point in points:
            here = np.zeros((self._count, self._dimension))
            for k, part in enumerate(self.jacobians[point]):
                if part:
                    here[:, k] = next(varying)
            yield point, here


def reactions(
    model: Model, scene: Scene, columns: Mapping[str, Floats]
) -> Iterator[Push]:
    """Yield the reaction forces on points of the scene, from columns of the table.

    A point has a reaction if one of its components is a definition with a column of its
    reaction; other components of the force are 0.

    columns : the columns of the table by name.
    """
    names = {
        d.node: d.name for d in model.definitions if d.name in model.output.reactions
    }
    dimension = scene.dimension
    for point, parts in scene.points.items():
        found = [columns.get(REACTION.of(str(names.get(node)))) for node in parts]
        first = next((x for x in found if x is not None), None)
        if first is not None:
            force = np.zeros((len(first), dimension))
            for k, x in enumerate(found):
                if x is not None:
                    force[:, k] = x
            yield Push("reaction", point, force)
