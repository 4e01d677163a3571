"""Radau's sparse matrices: against full ones, closed forms and counts."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from lagsim.mechanics import linearisation as module
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.linearisation import Entry, factored, newton_matrix
from lagsim.methods.parts import newton as lu
from lagsim.methods.parts.newton import SparseNewton, decompose_sparse
from lagsim.model.reader import read
from lagsim.plan.plan import by_loops
from tests.support import case_of, refused, run


def stiff_chain(n, *, method="radau", rtol="1e-8", more=""):
    """Return masses on stiff springs and dampers, the first tied to the ground."""
    q = [f"x{i}" for i in range(n)]
    forces = []
    for i in range(n):
        pulls = [f"c*({q[j]}_dot - {q[i]}_dot)" for j in (i - 1, i + 1) if 0 <= j < n]
        forces.append(f"  {q[i]}: {' + '.join(pulls)}")
    springs = [f"K*({b} - {a})^2/2" for a, b in pairwise(q)]
    return "\n".join(
        [
            "parameters: {K: 1e6, c: 1e3}",
            f"coordinates: {{{', '.join(f'{x}: {{}}' for x in q)}}}",
            "energy:",
            f"  kinetic: {' + '.join(f'{x}_dot^2/2' for x in q)}",
            f"  potential: {' + '.join(['20*x0^2', *springs])}",
            "forces:",
            *forces,
            "initial:",
            *[f"  {x}: {0.1 + 0.01 * i}" for i, x in enumerate(q)],
            "simulation:",
            f"  {{duration: 1, output_step: 0.5, rtol: {rtol}, method: {method}}}",
            more,
        ]
    )


@pytest.mark.parametrize("left", [0.0, 1e-15])
def test_a_pivot_that_cancels_is_none(left):
    # (1, 1; 1, 1 + left): nothing but rounding is left of the second diagonal.
    entries = [Entry(0, i, j, 0) for i in (0, 1) for j in (0, 1)]
    found = factored(entries, 2, {})
    p = SparseNewton.allocate(n=2, size=4, **found.sizes)
    found.fill(p)
    for last, done in ((1.0 + left, 0), (1.5, 1)):
        values = np.array([1.0, 1.0, 1.0, last])
        for width in (1, 2):
            g, K, x = np.ones(4), np.zeros(4 * width), np.zeros(2 * width)
            assert decompose_sparse(width, p, g, values, K, x) == done


@pytest.mark.slow
def test_operations_grow_with_the_chain():
    sizes = 25, 100
    counts = []
    for n in sizes:
        found = newton_matrix(derive(read(stiff_chain(n), "m.yaml")))
        counts.append(found.operations)
        # A band of three entries a row, and the row of work: nothing is filled in.
        assert len(found.columns) == 3 * n - 2 + n + 1
    assert math.log(counts[1] / counts[0]) / math.log(sizes[1] / sizes[0]) < 1.05


CONSTRAINED = """
coordinates: {x: {}, y: {}, z: {}, w: {}}
energy:
  kinetic: (x_dot^2 + (1 + x^2)*y_dot^2 + z_dot^2 + w_dot^2)/2
  potential: 9.8*y + 2e4*(z - x)^2
forces: {z: -300*(z_dot - x_dot), x: 300*(z_dot - x_dot) - x_dot, w: sin(t) - y*w_dot}
constraints: {rod: x^2 + y^2 = 1, follow: w_dot = x*z_dot}
initial: {x: sin(1), y: -cos(1), z: sin(1), w: 0}
simulation: {duration: 1, output_step: 0.25, rtol: 1e-7, method: radau}
"""


def slopes(found):
    """Return dq''/d(q, q') (n, 2 n) at the start of a run."""
    system, n = found.system, found.system.n
    runner = system.link("radau")
    runner.prepare()
    sparse = system.newton
    # Full, the row of the work comes last.
    length = len(sparse.entries) if sparse else 2 * n * (n + 1)
    values = runner.function("jacobian", length)(0.0, system.begin(found.start))
    return sparse.jacobian(n, values) if sparse else values.reshape(-1, 2 * n)[:n]


@pytest.mark.slow
@pytest.mark.parametrize("text", [CONSTRAINED, stiff_chain(9)])
def test_the_steps_are_those_of_full_matrices(monkeypatch, text):
    monkeypatch.setattr(module, "SLOWER", 1e-3)
    sparse = run(text)
    assert sparse.system.newton is not None
    monkeypatch.setattr(module, "SLOWER", 1e9)
    full = run(text)
    assert full.system.newton is None
    few, many = sparse.trajectory.statistics, full.trajectory.statistics
    # But where rounding decides: of some hundred steps here and there one.
    assert few.steps == pytest.approx(many.steps, rel=0.01)
    assert few.evaluations == pytest.approx(many.evaluations, rel=0.01)
    for name in full.equations.q:
        # Newton's method stops at the same iterates, which rounding parts.
        assert np.allclose(sparse[name], full[name], rtol=1e-9, atol=1e-9)
    assert np.allclose(slopes(sparse), slopes(full), rtol=1e-11, atol=1e-11)


@pytest.mark.slow
def test_the_stiff_method_takes_over_with_sparse_matrices():
    text = stiff_chain(8, method="auto", rtol="1e-6").replace("20*x0^2", "-cos(x0)")
    found = run(text.replace("c: 1e3", "c: 1e6"))
    [choice] = found.trajectory.choices
    assert choice.choice.startswith("method: radau from t")


@pytest.mark.slow
def test_a_chain_of_a_hundred_bodies():
    n = 100
    found = run(stiff_chain(n))
    assert found.system.newton is not None
    laplace = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    laplace[0, 0] = laplace[-1, -1] = 1.0
    stiffness = 1e6 * laplace
    stiffness[0, 0] += 40.0
    zero = np.zeros((n, n))
    A = np.block([[zero, np.eye(n)], [-stiffness, -1e3 * laplace]])
    start = np.concatenate([0.1 + 0.01 * np.arange(n), np.zeros(n)])
    for t, row in zip((0.5, 1.0), (1, 2), strict=True):
        expected = (expm(t * A) @ start)[:n]
        got = [found[f"x{i}"][row] for i in range(n)]
        # The tolerance, and what some hundred steps make of it.
        assert np.max(np.abs(got - expected)) < 1e-5 * np.max(np.abs(start))


def test_full_matrices_alone_have_a_largest_size(monkeypatch):
    monkeypatch.setattr(lu, "LARGEST", 11)
    plan = case_of(stiff_chain(12)).plan()
    assert plan.newton is not None
    assert by_loops(plan).method == "dop853"
    # Rows that imply each other are solved for by loops, with full matrices.
    twice = stiff_chain(
        12, more="constraints: {a: x1 - x0 = 0.01, b: 2*x1 = 0.02 + 2*x0}"
    )
    with refused("method-refused", "14 coordinates"):
        case_of(twice).plan()
