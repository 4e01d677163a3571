"""The equations in numbers at a state, from the graph in plain Python.

One state is all that is asked, so nothing is compiled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.expressions.derivatives import gradient
from lagsim.expressions.evaluate import evaluate, evaluate_with_error

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

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
            name: (value, errors.get(name, 0.0))
            for name, value in self.values(q, v).items()
        }
        return np.array([e for _, e in evaluate_with_error(self.g, nodes, values)])

    def mass(self, q: Floats, v: Floats) -> Floats:
        """Give M (n, n)."""
        nodes = [node for row in self.e.M for node in row]
        return self.array(nodes, q, v).reshape(self.n, self.n)

    def jacobian(self, rows: Sequence[Row], q: Floats, v: Floats) -> Floats:
        """Give A (m, n) of `rows`."""
        nodes = [node for row in rows for node in row.A]
        return self.array(nodes, q, v).reshape(len(rows), self.n)

    def equations_for(
        self,
        nodes: Sequence[int],
        targets: Floats,
        free: Sequence[int],
        q: Floats,
        v: Floats,
        *,
        velocities: bool,
    ) -> Callable[[Floats], tuple[Floats, Floats]]:
        """Give nodes - targets (k,) and its slopes (k, free) as a function of x.

        x (free,) are the values `free` of the positions, or of the velocities.
        """
        names = self.e.velocities if velocities else self.e.q
        unknowns = [self.g.variable(names[j]) for j in free]
        slopes = [s for node in nodes for s in gradient(self.g, node, unknowns)]
        shape = (len(nodes), len(free))

        def evaluate_at(x: Floats) -> tuple[Floats, Floats]:
            state = [q.copy(), v.copy()]
            state[velocities][list(free)] = x
            found = self.array([*nodes, *slopes], *state)
            return found[: len(nodes)] - targets, found[len(nodes) :].reshape(shape)

        return evaluate_at
