"""Straight-line elimination on the graph against numpy, and its count of operations."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.sparse import Meter, TooLongError
from lagsim.mechanics.equations import derive
from lagsim.mechanics.ldl import BUDGET, Elimination, Factorisation, affordable
from lagsim.model.reader import read


def symmetric(seed: int, n: int, density: float) -> np.ndarray:
    """Give a positive definite matrix with zeros."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n, n)) * (random.uniform(size=(n, n)) < density)
    return root @ root.T + np.eye(n)


def entries(g: Graph, S: np.ndarray) -> dict[tuple[int, int], int]:
    """Give the lower triangle as variables, so that nothing folds."""
    n = len(S)
    return {
        (i, j): g.variable(f"S{i}.{j}")
        for i in range(n)
        for j in range(i + 1)
        if S[i, j] != 0.0
    }


def values(S: np.ndarray, right: np.ndarray) -> dict[str, float]:
    n = len(S)
    found = {f"S{i}.{j}": S[i, j] for i in range(n) for j in range(n)}
    return found | {f"r{i}": x for i, x in enumerate(right)}


@pytest.mark.parametrize("density", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_solves_sparse_symmetric_systems(n: int, density: float) -> None:
    for seed in range(3):
        S = symmetric(seed, n, density)
        right = np.random.default_rng(seed + 100).normal(size=n)
        right[1::3] = 0.0
        g = Graph()
        factors = Factorisation(g, n, entries(g, S), Meter())
        assert sorted(factors.order) == list(range(n))
        nodes = {i: g.variable(f"r{i}") for i in range(n) if right[i] != 0.0}
        x = factors.solve(nodes)
        found = evaluate(g, [x.get(i, g.zero) for i in range(n)], values(S, right))
        expected = np.linalg.solve(S, right)
        lost = 1e-15 * np.linalg.cond(S)
        assert found == pytest.approx(expected, rel=0, abs=10 * lost * max(abs(right)))


def test_what_is_zero_costs_nothing() -> None:
    g = Graph()
    diagonal = {(i, i): g.variable(f"S{i}.{i}") for i in range(50)}
    factors = Factorisation(g, 50, diagonal, meter := Meter())
    assert meter.operations == 50
    assert factors.solve({3: g.variable("r3")}).keys() == {3}


def chain(g: Graph, n: int) -> dict[tuple[int, int], int]:
    """Give a tridiagonal matrix whose given order is the worst: ends last."""
    order = [*range(1, n, 2), *range(0, n, 2)]
    place = {k: i for i, k in enumerate(order)}
    found = {}
    for k in range(n):
        found[place[k], place[k]] = g.variable(f"d{k}")
        if k:
            i, j = sorted((place[k], place[k - 1]))
            found[j, i] = g.variable(f"e{k}")
    return found


def test_a_chain_fills_nothing_in_whatever_order_it_is_given() -> None:
    costs = []
    for n in (50, 100, 200):
        g, meter = Graph(), Meter()
        factors = Factorisation(g, n, chain(g, n), meter)
        assert sum(len(column) for column in factors.below.values()) == n - 1
        costs.append(meter.operations)
    assert costs[1] <= 2.05 * costs[0]
    assert costs[2] <= 2.05 * costs[1]


def test_gives_up_where_code_would_be_too_long() -> None:
    g = Graph()
    n = 30  # dense: more than n^3/6 operations
    full = {(i, j): g.variable(f"S{i}.{j}") for i in range(n) for j in range(i + 1)}
    assert n**3 / 6 > BUDGET
    with pytest.raises(TooLongError):
        Factorisation(g, n, full, Meter(BUDGET))


def test_health_tells_singular_and_indefinite() -> None:
    def health(S: list[list[float]]) -> float:
        array = np.array(S)
        g = Graph()
        factors = Factorisation(g, 2, entries(g, array), Meter())
        ratios = [g.call("div", *pair) for pair in factors.pivots.values()]
        return min(evaluate(g, ratios, values(array, np.zeros(2))))

    assert health([[2.0, 1.0], [1.0, 2.0]]) == 0.75
    assert health([[1.0, 1.0], [1.0, 1.0 + 1e-9]]) == pytest.approx(1e-9, rel=1e-6)
    assert health([[1.0, 2.0], [2.0, 1.0]]) == -3.0


MODEL = """
parameters: {m: 2, k: 0.3}
coordinates: {x: {}, y: {}, z: {}}
initial: {x: 1, y: 0, z: 0}
energy:
  kinetic: m*(x_dot^2 + y_dot^2 + z_dot^2)/2 + k*x*x_dot*y_dot
  potential: m*z
constraints:
  sphere: x^2 + y^2 + z^2 = 1
  plane: y - 2*z = 0
"""


def test_corrections_are_least_in_the_metric_of_the_mass() -> None:
    e = derive(read(MODEL, "model.yaml"))
    g = e.graph
    state = {"m": 2.0, "k": 0.3, "x": 0.9, "y": 0.4, "z": 0.3}
    nodes = Elimination(e).correction([row.residual for row in e.rows])
    M = np.reshape(evaluate(g, [node for row in e.M for node in row], state), (3, 3))
    rows = [node for row in e.rows for node in row.A]
    A = np.reshape(evaluate(g, rows, state), (2, 3))
    residuals = evaluate(g, [row.residual for row in e.rows], state)
    # min dq^T M dq with A dq = -g.
    kkt = np.block([[M, A.T], [A, np.zeros((2, 2))]])
    expected = np.linalg.solve(kkt, [0, 0, 0, -residuals[0], -residuals[1]])[:3]
    assert evaluate(g, nodes, state) == pytest.approx(expected, rel=1e-13)


def four_bars(loops: int) -> str:
    """Give so many squares side by side, of rods of length and mass 1, on the ground.

    In the points of their joints: neighbours share the masses of rods, so that the
    inverse of M has no zeros.
    """
    joints, bars = range(loops + 1), range(loops)
    legs = [f"(x{i}_dot^2 + y{i}_dot^2)/6" for i in joints]
    above = [
        f"(x{i}_dot^2 + x{i}_dot*x{i + 1}_dot + x{i + 1}_dot^2 + "
        f"y{i}_dot^2 + y{i}_dot*y{i + 1}_dot + y{i + 1}_dot^2)/6"
        for i in bars
    ]
    weights = [f"y{i}/2" for i in joints] + [f"(y{i} + y{i + 1})/2" for i in bars]
    lines = [
        "parameters: {g: 9.81}",
        "coordinates:",
        *(f"  x{i}: {{}}\n  y{i}: {{}}" for i in joints),
        "energy:",
        f"  kinetic: {' + '.join(legs + above)}",
        f"  potential: g*({' + '.join(weights)})",
        "constraints:",
        *(f"  leg{i}: (x{i} - {i})^2 + y{i}^2 = 1" for i in joints),
        *(f"  bar{i}: (x{i + 1} - x{i})^2 + (y{i + 1} - y{i})^2 = 1" for i in bars),
        "initial:",
        *(f"  x{i}: {i}\n  y{i}: 1\n  x{i}_dot: 1\n  y{i}_dot: 0" for i in joints),
    ]
    return "\n".join(lines)


@pytest.mark.parametrize("loops", [15, 30])
def test_what_loops_solve_in_less_is_given_up_before_it_is_built(loops: int) -> None:
    """S of N four-bar linkages has no zeros, and its entries sums of up to N terms."""
    e = derive(read(four_bars(loops), "four-bars.yaml"))
    before = len(e.graph.ops)
    with pytest.raises(TooLongError):
        Elimination(e, affordable(len(e.q), len(e.rows)))
    most = 7 * loops**2  # Z has some 2 N^2 entries, S would take N^3 operations
    assert len(e.graph.ops) - before <= most


@pytest.mark.parametrize("text", [MODEL, four_bars(1), four_bars(4)])
def test_what_is_counted_beforehand_is_never_more_than_it_takes(text: str) -> None:
    e = derive(read(text, "model.yaml"))
    exact = Elimination(e).operations
    assert Elimination(e, exact).operations == exact
    with pytest.raises(TooLongError):
        Elimination(e, exact - 1)
