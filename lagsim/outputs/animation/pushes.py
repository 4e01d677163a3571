"""The forces of constraints, as forces on points of the scene.

A constraint acts on the coordinates by Qc = A^T lambda. A force F on a point r of the
scene acts on them by J^T F, with J = dr/dq. Where A^T = J^T f for one f and no other,
F = lambda f is the one force on that point that does the same work in every virtual
displacement, and is drawn; a component of r that never varies has none. One point is
tried first, then two that a link joins, then any two.

Where f is not unique (the bob of a pendulum in its angle moves along a circle: a stop
of the angle is a torque), no force is drawn, but the point is known to be struck.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.language.derivatives import slopes
from lagsim.language.evaluate import evaluate_rows
from lagsim.tolerances import DEPENDENT_ROWS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model, Scene

# Frames in which it is tried which points carry a constraint, and in which part of them
# they must: at a dead point none may.
TRIED, MOSTLY = 9, 0.75
# What is left of a row that points carry, against its terms. Rounding leaves less.
LEFT = 1e-7
# Pairs that no link joins are tried among so many points, and forces shown.
FEW_POINTS, MOST_PUSHES = 24, 64


class Push(NamedTuple):
    """The force of a constraint on a point (frames, components)."""

    constraint: str
    point: str
    force: Floats


class _Row(NamedTuple):
    constraint: str
    multiplier: str
    entries: Mapping[int, int]


class Carriers:
    """Which points carry the constraints of a scene.

    Parameters
    ----------
    values
        Parameters and columns (count,) by name.
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
        self._dimension = max(len(parts) for parts in scene.points.values())
        self._rows = list(_rows(equations))
        self._jacobians = self._moving() if self._rows else {}
        self._carried: list[tuple[_Row, tuple[str, ...]]] = []
        self.struck: dict[str | None, tuple[str, ...]] = {}
        for row in self._rows:
            points, unique = self._carrier(row)
            if points:
                self.struck.setdefault(row.constraint, points)
            if unique:
                self._carried.append((row, points))

    def _moving(self) -> dict[str, list[dict[int, int]]]:
        """Return dr/dq, a mapping a component, of the points that depend on q."""
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

    def _carrier(self, row: _Row) -> tuple[tuple[str, ...], bool]:
        """Return the fewest points that carry a row, and whether by one force alone."""
        step = max(1, (self._count - 1) // (TRIED - 1))
        some = slice(0, None, step)
        several: tuple[str, ...] = ()
        for points in self._candidates():
            reached = {j for p in points for part in self._jacobians[p] for j in part}
            if not row.entries or not row.entries.keys() <= reached:
                continue
            _, holds, unique = self._forces(row, points, some)
            if np.mean(holds & unique) >= MOSTLY:
                return points, True
            if np.mean(holds) >= MOSTLY:
                several = several or points
        return several, False

    def _candidates(self) -> Iterator[tuple[str, ...]]:
        known = self._jacobians
        yield from ((name,) for name in known)
        linked = [pair for pair in self._scene.links if set(pair) <= known.keys()]
        yield from linked
        if len(known) <= FEW_POINTS:
            met = {frozenset(pair) for pair in linked}
            yield from (x for x in combinations(known, 2) if frozenset(x) not in met)

    def _forces(
        self, row: _Row, points: Sequence[str], frames: slice
    ) -> tuple[Floats, Flags, Flags]:
        """Return f (k, components) in some frames, where A^T = J^T f, where unique.

        Components that never vary have no part in it.
        """
        parts = [part for p in points for part in self._jacobians[p] if part]
        columns = sorted({j for part in parts for j in part})
        zero = self._e.graph.zero
        nodes = [part.get(j, zero) for part in parts for j in columns]
        nodes += [row.entries.get(j, zero) for j in columns]
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
        holds: Flags = finite & (left <= LEFT * terms).all(axis=1)
        sizes = np.linalg.svd(J, compute_uv=False)
        full: Flags = sizes[:, -1] > DEPENDENT_ROWS * sizes[:, 0]
        return f, holds, full & (d <= n)

    def pushes(self) -> list[Push]:
        """Return the forces that are ever other than 0, those of friction in them."""
        found: dict[tuple[str, str], Floats] = {}
        for row, points in self._carried:
            multiplier = self._values.get(row.multiplier)
            if not points or not isinstance(multiplier, np.ndarray):
                continue
            if not multiplier.any() or len(found) >= MOST_PUSHES:
                continue
            f, holds, unique = self._forces(row, points, slice(None))
            f[~(holds & unique)] = np.nan
            force = f.T * multiplier
            force[:, multiplier == 0.0] = 0.0
            varying = iter(force)
            for point in points:
                here = np.zeros((self._count, self._dimension))
                for k, part in enumerate(self._jacobians[point]):
                    if part:
                        here[:, k] = next(varying)
                key = row.constraint, point
                found[key] = found[key] + here if key in found else here
        return [Push(*key, force) for key, force in found.items()]


def reactions(
    model: Model, scene: Scene, columns: Mapping[str, Floats]
) -> Iterator[Push]:
    """Return the reactions that the model asks for, on points that are made of them."""
    asked = {
        d.node: d.name for d in model.definitions if d.name in model.output.reactions
    }
    dimension = max(len(parts) for parts in scene.points.values())
    for point, parts in scene.points.items():
        found = [columns.get(f"reaction.{asked.get(node)}") for node in parts]
        some = next((x for x in found if x is not None), None)
        if some is not None:
            force = np.zeros((len(some), dimension))
            for k, x in enumerate(found):
                if x is not None:
                    force[:, k] = x
            yield Push("reaction", point, force)


def _rows(e: Equations) -> Iterator[_Row]:
    for row in e.rows:
        yield _Row(row.name, f"lambda_{row.name}", row.A.entries)
    for law in e.laws:
        yield _Row(law.constraint, law.multiplier, law.row.A.entries)
