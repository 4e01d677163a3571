"""What rivals are given is the same motion: a textbook's equations against derived."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.textbook import OF, Numbers
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import derive
from lagsim.model.reader import read_file
from tests.support import MODELS


def accelerations(e, values):
    """Solve M a - A' lambda = f, A a = b densely."""
    g, n, m = e.graph, len(e.q), len(e.rows)
    matrix, right = np.zeros((n + m, n + m)), np.zeros(n + m)
    matrix[:n, :n] = [evaluate(g, row, values) for row in e.M]
    right[:n] = evaluate(g, e.f, values)
    for k, row in enumerate(e.rows):
        matrix[n + k, :n] = evaluate(g, row.A, values)
        matrix[:n, n + k] = -matrix[n + k, :n]
        right[n + k] = evaluate(g, [row.b], values)[0]
    return np.linalg.solve(matrix, right)[:n]


@pytest.mark.parametrize("model", OF)
def test_equations_by_hand_are_those_derived(model):
    e = derive(read_file(str(MODELS / f"{model}.yaml")))
    parameters = {p.name: p.value for p in e.model.parameters}
    start = {i.name: i.value for i in e.model.initial}
    rng = np.random.default_rng(1)
    for _ in range(3):
        # Off the constraints as well: index 1 does not need them to hold.
        q = [start.get(name, 0.0) + rng.normal(0.0, 0.02) for name in e.q]
        v = [rng.normal() for _ in e.velocities]
        state = dict(zip([*e.q, *e.velocities], [*q, *v], strict=True))
        expected = accelerations(e, parameters | state | {"t": 0.0})
        found = OF[model](q, v, parameters, Numbers)
        # Rounding, times the condition of the matrix: 1e4 in the mechanism.
        assert np.allclose(found, expected, rtol=1e-11, atol=1e-11 * max(abs(expected)))
