"""Whether every direction has inertia: otherwise there is no M^-1 f."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations

# A matrix whose smallest eigenvalue is this small against its diagonal is singular.
SINGULAR = 1e-12
STATES = 3


def without_inertia(e: Equations) -> str | None:
    """Give a coordinate with little inertia, or None where M is positive definite.

    Looks at random states, with the parameters of the file.
    """
    random = np.random.default_rng(3)
    n = len(e.q)
    nodes = [node for row in e.M for node in row]
    parameters = {p.name: p.value for p in e.model.parameters}
    start = {i.name: i.value for i in e.model.initial}
    diagonal = np.zeros(n)
    for _ in range(STATES):
        state = {
            name: start.get(name, 0.0) + random.uniform(0.1, 0.4)
            for name in (*e.q, *e.velocities, "t")
        }
        M = np.reshape(evaluate(e.graph, nodes, parameters | state), (n, n))
        if not np.all(np.isfinite(M)):
            continue
        diagonal = np.abs(np.diag(M))
        size = np.sqrt(diagonal)
        scaled = M / np.outer(size, size) if np.all(size > 0) else None
        if scaled is not None and np.linalg.eigvalsh(scaled)[0] > SINGULAR:
            return None
    return e.q[int(np.argmin(diagonal))]
