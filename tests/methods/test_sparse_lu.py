"""Radau's sparse matrices: against full ones, closed forms and counts."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from lagsim.errors import InputError
from lagsim.mechanics.equations import derive
from lagsim.methods import radau
from lagsim.methods.parts import lu
from lagsim.methods.parts.parameters import Parameters
from lagsim.methods.parts.sparse_lu import (
    factor_pair,
    factor_real,
    sparse_pair,
    sparse_real,
)
from lagsim.model.reader import read
from lagsim.plan.making import by_loops
from lagsim.solve import newton as module
from lagsim.solve.newton import Entry, factored, newton
from tests.support import case_of, run

ALPHA, BETA = 2.7, 3.1


def stiff_chain(n, *, method="radau", rtol="1e-8", more=""):
    """Give masses on stiff springs and dampers, the first tied to the ground."""
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


def random_matrix(n, m, seed):
    """Give M, R_v, R_q, A and S_q, S_v: few entries, M and R_q far from singular."""
    rng = np.random.default_rng(seed)

    def few(rows, share):
        kept = rng.random((rows, n)) < share
        return kept * rng.standard_normal((rows, n))

    M = few(n, 0.1)
    M = M @ M.T + 3.0 * np.eye(n)
    A = few(m, 0.2)
    A[range(m), range(m)] = 2.0  # independent rows
    return M, few(n, 0.1), few(n, 0.1), A, few(m, 0.1), few(m, 0.1)


def laid_out(n, m, parts):
    """Give the pattern, the values of its entries, and a memory with the pattern."""
    M, Rv, Rq, A, Sv, Sq = parts
    work = np.random.default_rng(7).standard_normal((4, n + m))
    C = np.zeros((3, n + m + 1, n + m + 1))
    C[0, :n, :n], C[0, n:-1, :n], C[0, :n, n:-1] = Rq, Sq, -A.T
    C[1, :n, :n], C[1, n:-1, :n] = Rv, Sv
    C[2, :n, :n], C[2, n:-1, :n] = M, A
    C[0, -1, :-1], C[1, -1, :n], C[2, -1, :n] = work[0], work[1, :n], work[2, :n]
    C[1, -1, -1] = -1.0
    entries = [Entry(*map(int, at), 0) for at in np.argwhere(C)]
    after = {n + i: np.flatnonzero(A[i]).tolist() for i in range(m)}
    found = factored(entries, n + m, after)
    p = Parameters.made(n=n, m=m, size=2 * n + 1, **found.sizes)
    found.fill(p)
    return found, np.array([C[e[:3]] for e in entries]), p, C


def whole_slopes(n, C):
    """Give the matrix of y' = (v, a, power) by eliminating lambda: full, and slowly."""
    # (da, dlambda) of changes of (q, v).
    left = np.hstack([C[2, :-1, :n], C[0, :-1, n:-1]])
    right = np.hstack([C[0, :-1, :n], C[1, :-1, :n]])
    found = np.linalg.solve(left, -right)
    power = np.hstack([C[0, -1, :n], C[1, -1, :n]])
    power = power + np.concatenate([C[2, -1, :n], C[0, -1, n:-1]]) @ found
    J = np.zeros((2 * n + 1, 2 * n + 1))
    J[:n, n : 2 * n] = np.eye(n)
    J[n : 2 * n, : 2 * n] = found[:n]
    J[-1, : 2 * n] = power
    return J


@pytest.mark.parametrize(("n", "m"), [(1, 0), (12, 0), (15, 4), (25, 9)])
def test_random_patterns_are_solved_as_full_matrices_are(n, m):
    found, values, p, C = laid_out(n, m, random_matrix(n, m, seed=n))
    J = whole_slopes(n, C)
    N, size = n + m + 1, 2 * n + 1
    rng = np.random.default_rng(2)
    K, pair = np.zeros(p.filled), np.zeros(2 * p.filled)
    assert factor_real(p, ALPHA, values, K, np.zeros(N)) == 1
    assert factor_pair(p, ALPHA, BETA, values, pair, np.zeros(2 * N)) == 1
    r, a, b = rng.standard_normal((3, size))
    expected = np.linalg.solve(ALPHA * np.eye(size) - J, r)
    both = np.linalg.solve((ALPHA + BETA * 1j) * np.eye(size) - J, a + b * 1j)
    sparse_real(p, ALPHA, values, K, r, np.zeros(N))
    sparse_pair(p, ALPHA, BETA, values, pair, a, b, np.zeros(2 * N))
    # Rounding, times the condition of matrices of this size, some 1e3.
    assert np.allclose(r, expected, rtol=1e-11, atol=1e-11)
    assert np.allclose(a + b * 1j, both, rtol=1e-11, atol=1e-11)
    assert np.allclose(found.jacobian(n, values), J[n : 2 * n, : 2 * n], atol=1e-11)


def test_constraints_come_after_their_coordinates():
    found, _, p, _ = laid_out(15, 4, parts := random_matrix(15, 4, seed=15))
    for i, row in enumerate(parts[3]):
        assert all(found.places[15 + i] > found.places[j] for j in np.flatnonzero(row))
    assert sorted(found.places) == list(range(p.unknowns))


@pytest.mark.parametrize("left", [0.0, 1e-15])
def test_a_pivot_that_cancels_is_none(left):
    # (1, 1; 1, 1 + left): nothing but rounding is left of the second diagonal.
    entries = [Entry(0, i, j, 0) for i in (0, 1) for j in (0, 1)]
    found = factored(entries, 2, {})
    p = Parameters.made(n=2, size=4, **found.sizes)
    found.fill(p)
    values = np.array([1.0, 1.0, 1.0, 1.0 + left])
    assert factor_real(p, 1.0, values, np.zeros(4), np.zeros(2)) == 0
    assert factor_pair(p, 1.0, 0.0, values, np.zeros(8), np.zeros(4)) == 0
    values[-1] = 1.5
    assert factor_real(p, 1.0, values, np.zeros(4), np.zeros(2)) == 1


def test_operations_grow_with_the_chain():
    sizes = 25, 100
    counts = []
    for n in sizes:
        found = newton(derive(read(stiff_chain(n), "m.yaml")))
        counts.append(found.operations)
        # A band of three entries a row, and the row of work: nothing is filled in.
        assert len(found.columns) == 3 * n - 2 + n + 1
    assert math.log(counts[1] / counts[0]) / math.log(sizes[1] / sizes[0]) < 1.05


def test_few_coordinates_have_full_matrices():
    assert newton(derive(read(stiff_chain(3), "m.yaml"))) is None


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


@pytest.mark.parametrize(
    "text", [CONSTRAINED, pytest.param(stiff_chain(9), marks=pytest.mark.slow)]
)
def test_the_steps_are_those_of_full_matrices(monkeypatch, text):
    monkeypatch.setattr(module, "SLOWER", 1e-3)
    sparse = run(text)
    assert sparse.system.newton is not None
    monkeypatch.delattr(radau, "SPARSE")
    full = run(text)
    assert full.system.newton is None
    few, many = sparse.trajectory.statistics, full.trajectory.statistics
    # But where rounding decides: of some hundred steps here and there one.
    assert few.steps == pytest.approx(many.steps, rel=0.01)
    assert few.evaluations == pytest.approx(many.evaluations, rel=0.01)
    for name in full.equations.q:
        # Newton's method stops at the same iterates, which rounding parts.
        assert np.allclose(sparse[name], full[name], rtol=1e-9, atol=1e-9)


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
    with pytest.raises(InputError, match="14 coordinates and constraints"):
        case_of(twice).plan()
