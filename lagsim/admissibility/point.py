"""The equations in numbers at a state, from the graph in plain Python.

One state is all that is asked, so nothing is compiled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.admissibility.metric import sizes_of
from lagsim.admissibility.newton import MET, SOLVED, Relations
from lagsim.expressions.derivatives import gradient
from lagsim.expressions.evaluate import (
    UNIT_ROUNDOFF,
    evaluate,
    evaluate_with_error,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.constraints import Row
    from lagsim.equations import Equations
    from lagsim.native.kernel_types import Floats


class Point:
    """The equations in numbers."""

    def __init__(self, equations: Equations) -> None:
        self.e = equations
        self.g = equations.graph
        self.n = len(equations.q)
        simulation = equations.model.simulation
        self.t = simulation.start if simulation else 0.0
        self._fixed = {p.name: p.value for p in equations.model.parameters}
        self._fixed["t"] = self.t
        # As of constants: what is not a whole number has been rounded.
        self._rounded = {
            p.name: UNIT_ROUNDOFF * abs(p.value)
            for p in equations.model.parameters
            if not p.value.is_integer()
        }
        self._sizes: Floats | None = None

    def move_to(self, time: float) -> None:
        """Take another time than that of the start."""
        self.t = time
        self._fixed["t"] = time

    def values(self, q: Floats, v: Floats) -> dict[str, float]:
        """Give the value of every variable at the state."""
        values = self._fixed | dict(zip(self.e.q, map(float, q), strict=True))
        return values | dict(zip(self.e.velocities, map(float, v), strict=True))

    def array(self, nodes: Sequence[int], q: Floats, v: Floats) -> Floats:
        """Give the values of `nodes` at the state."""
        return np.array(evaluate(self.g, nodes, self.values(q, v)), dtype=float)

    def rounding(
        self,
        nodes: Sequence[int],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float],
    ) -> Floats:
        """Give bounds of the rounding errors of `nodes`, from those of the start."""
        values = {
            name: (value, errors.get(name, self._rounded.get(name, 0.0)))
            for name, value in self.values(q, v).items()
        }
        return np.array([e for _, e in evaluate_with_error(self.g, nodes, values)])

    def solved_errors(self, q: Floats, v: Floats) -> dict[str, float]:
        """Give the errors of values that were solved for.

        Against the size of all positions, or velocities, in the metric of M: one that
        should be zero is left with the rounding errors of the others.
        """
        sizes = self.sizes(q, v)
        errors: dict[str, float] = {}
        for names, x in ((self.e.q, q), (self.e.velocities, v)):
            found = SOLVED * np.linalg.norm(sizes * x) / sizes
            errors |= dict(zip(names, map(float, found), strict=True))
        return errors

    def sizes(self, q: Floats, v: Floats) -> Floats:
        """Give sqrt(M_jj), or what stands in its place, where it was first asked."""
        if self._sizes is None:
            A = np.nan_to_num(self.jacobian(self.e.rows, q, v))
            self._sizes = sizes_of(self.mass(q, v), A)
        return self._sizes

    def mass(self, q: Floats, v: Floats) -> Floats:
        """Give M (n, n)."""
        nodes = [node for row in self.e.M for node in row]
        return self.array(nodes, q, v).reshape(self.n, self.n)

    def jacobian(
        self,
        rows: Sequence[Row],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float] | None = None,
    ) -> Floats:
        """Give A (m, n) of `rows`; with `errors` what is only rounding is zero."""
        nodes = [node for row in rows for node in row.A]
        found = self.array(nodes, q, v)
        if errors is not None:
            found[np.abs(found) <= self.rounding(nodes, q, v, errors)] = 0.0
        return found.reshape(len(rows), self.n)

    def relations(
        self,
        asked: Asked,
        free: Sequence[int],
        q: Floats,
        v: Floats,
        errors: Mapping[str, float],
        *,
        velocities: bool,
    ) -> Relations:
        """Give what is asked of the values `free`, positions or velocities."""
        return _AtState(self, asked, free, (q, v), errors, velocities=velocities)


class Asked:
    """Nodes, the values that they should have, and the sizes of their terms."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.nodes: list[int] = []
        self.targets: list[float] = []
        self.errors: list[float] = []
        self.scales: list[int] = []

    def add(
        self, name: str, node: int, scale: int, target: float = 0.0, error: float = 0.0
    ) -> None:
        """Ask that `node` be `target`."""
        self.names.append(name)
        self.nodes.append(node)
        self.scales.append(scale)
        self.targets.append(target)
        self.errors.append(error)


class _AtState(Relations):
    def __init__(
        self,
        point: Point,
        asked: Asked,
        free: Sequence[int],
        state: tuple[Floats, Floats],
        errors: Mapping[str, float],
        *,
        velocities: bool,
    ) -> None:
        self.point, self.asked = point, asked
        self.free, self.velocities = list(free), velocities
        self.q, self.v = state[0].copy(), state[1].copy()
        self.errors = errors
        self.targets = np.array(asked.targets)
        names = point.e.velocities if velocities else point.e.q
        self.names = [names[j] for j in free]
        unknowns = [point.g.variable(name) for name in self.names]
        self.slopes = [
            s for node in asked.nodes for s in gradient(point.g, node, unknowns)
        ]

    def _state(self, x: Floats) -> tuple[Floats, Floats]:
        state = (self.q.copy(), self.v.copy())
        state[self.velocities][self.free] = x
        return state

    def __call__(self, x: Floats) -> tuple[Floats, Floats]:
        nodes = self.asked.nodes
        found = self.point.array([*nodes, *self.slopes], *self._state(x))
        slopes = found[len(nodes) :].reshape(len(nodes), len(self.free))
        return found[: len(nodes)] - self.targets, slopes

    def met(self, x: Floats, errors: Floats) -> bool:
        residual = self(x)[0]
        state = self._state(x)
        scale = np.abs(self.point.array(self.asked.scales, *state))
        scale = np.maximum(scale, np.abs(self.targets))
        named = {
            **self.errors,
            **dict(zip(self.names, map(float, errors), strict=True)),
        }
        bound = np.maximum(MET * scale, self._rounding(x, named))
        return bool(np.all(np.abs(residual) <= bound))

    def exact(self, x: Floats) -> bool:
        residual = self(x)[0]
        return bool(np.all(np.abs(residual) <= self._rounding(x, self.errors)))

    def _rounding(self, x: Floats, errors: Mapping[str, float]) -> Floats:
        found = self.point.rounding(self.asked.nodes, *self._state(x), errors)
        return np.asarray(found + np.array(self.asked.errors))
