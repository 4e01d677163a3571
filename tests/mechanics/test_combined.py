"""Rows as the elimination takes them: the same solution, in fewer operations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mpmath as mp
import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import Equations, derive
from lagsim.mechanics.ldl import Elimination
from lagsim.model.reader import read, read_file
from tests.support import MODELS

if TYPE_CHECKING:
    from lagsim.model.model import Model

CONSTRAINED = (
    "andrews",
    "appell-hamel",
    "bead-hoop-cartesian",
    "car-axis",
    "chain-cartesian",
    "chaplygin-sleigh",
    "elastic-pendulum-steered",
    "pendulum-cartesian",
    "rolling-disk",
)


def at_random(model: Model, seed: int) -> dict[str, float]:
    """Give parameters, and a state near where the model starts."""
    random = np.random.default_rng(seed)
    values = {p.name: p.value for p in model.parameters}
    for c in model.coordinates:
        values[c.name] = random.uniform(-1.0, 1.0)
        values[f"{c.name}_dot"] = random.uniform(-2.0, 2.0)
    return values | {"t": random.uniform(0.0, 1.0)}


def matrices(e: Equations, values: dict[str, float]) -> tuple[mp.matrix, mp.matrix]:
    """Give the matrix and the right side of M q'' - A^T lambda = f, A q'' = b."""
    n, m = len(e.q), len(e.rows)
    M = evaluate(e.graph, [node for row in e.M for node in row], values)
    A = evaluate(e.graph, [node for row in e.rows for node in row.A], values)
    right = evaluate(e.graph, [*e.f, *(row.b for row in e.rows)], values)
    whole = mp.zeros(n + m)
    for i in range(n):
        for j in range(n):
            whole[i, j] = M[n * i + j]
        for k in range(m):
            whole[i, n + k] = -A[n * k + i]
            whole[n + k, i] = A[n * k + i]
    return whole, mp.matrix(right)


@pytest.mark.parametrize("name", CONSTRAINED)
def test_accelerations_and_multipliers_solve_the_equations(name: str) -> None:
    model = read_file(str(MODELS / f"{name}.yaml"))
    e = derive(model)
    nodes = [x for part in Elimination(e).motion() for x in part]
    for seed in range(2):
        values = at_random(model, seed)
        found = np.array(evaluate(e.graph, nodes, values))
        with mp.workdps(40):
            whole, right = matrices(e, values)
            expected = mp.lu_solve(whole, right)
        expected = np.array([float(x) for x in expected])
        condition = np.linalg.cond(np.array(whole.tolist(), dtype=float), 1)
        # Rounding of the matrix, times its condition: bodies and rows of other units.
        lost = 1e-15 * condition * max(abs(expected))
        assert found == pytest.approx(expected, rel=1e-9, abs=lost)


@pytest.mark.parametrize(
    ("name", "most"),
    [
        # By hand: six of squares and products of a rod, its pivot and solution, and
        # gravity and forces on each end; 299 in all as books have it.
        ("chain-cartesian", 299),
        # x'^2 + y'^2, x^2 + y^2, the quotient of both with g y: 8; then two forces, g.
        ("pendulum-cartesian", 13),
        ("andrews", 430),
        ("bead-hoop-cartesian", 60),
        # r theta'^2 + g cos - (K/M) u and (- g sin - 2 theta' u')/r, r = l + u: 15 and
        # what M r^2 has as a divisor of its own.
        ("elastic-pendulum", 20),
        ("rolling-disk", 125),
    ],
)
def test_elimination_is_as_short_as_by_hand(name: str, most: int) -> None:
    model = read_file(str(MODELS / f"{name}.yaml"))
    e = derive(model)
    moving = (*e.q, *e.velocities, "t")
    q_ddot = Elimination(e).motion()[0]
    cone = e.graph.dependent(q_ddot, moving)
    assert sum(bool(e.graph.args[n]) for n in cone) <= most


STAR = """
parameters: {{m: 2, l: 1.5}}
coordinates: {{{coordinates}}}
initial: {{x0: 0, {initial}}}
energy:
  kinetic: m*({kinetic})/2
  potential: 0
constraints:
{constraints}
"""


def star(arms: int) -> Equations:
    """Give pistons on lines whose rods meet in one joint, with y = x0."""
    k = range(1, arms + 1)
    names = ["x0", *(f"x{i}" for i in k)]
    return derive(
        read(
            STAR.format(
                coordinates=", ".join(f"{x}: {{}}" for x in names),
                initial=", ".join(f"x{i}: 1" for i in k),
                kinetic=" + ".join(f"{x}_dot^2" for x in names),
                constraints="\n".join(f"  c{i}: sin(x0) = x{i}^3" for i in k),
            ),
            "model.yaml",
        )
    )


def test_differences_change_neither_forces_nor_corrections_nor_health() -> None:
    e = star(5)
    g, n, m = e.graph, 6, 5
    elimination = Elimination(e)
    random = np.random.default_rng(1)
    values = {"m": 2.0, "l": 1.5, "t": 0.0}
    values |= {x: random.uniform(0.5, 1.0) for x in (*e.q, *e.velocities)}
    values |= {f"length.c{i}": 0.0 for i in range(1, m + 1)}
    A = np.array([evaluate(g, row.A, values) for row in e.rows])
    b = np.array(evaluate(g, [row.b for row in e.rows], values))
    S = A @ A.T / 2.0
    lam = np.linalg.solve(S, b)
    assert evaluate(g, elimination.motion()[1], values) == pytest.approx(lam, rel=1e-11)
    squares = evaluate(g, elimination.reactions(), values)
    assert squares == pytest.approx(lam**2 * np.diag(S), rel=1e-10)
    residuals = [g.variable(f"x{i}_dot") for i in range(1, m + 1)]
    r = [values[f"x{i}_dot"] for i in range(1, m + 1)]
    step = evaluate(g, elimination.correction(residuals), values)
    assert step == pytest.approx(-A.T @ np.linalg.solve(S, r) / 2.0, rel=1e-11)
    assert len(step) == n
    # The pivots' product is det S, whatever the rows are taken from.
    ratios = [
        x / (elimination.rows[k].weights[k] ** 2 * 2.0 * S[k, k])
        for k, x in enumerate(
            evaluate(g, [elimination.schur.pivots[k][0] for k in range(m)], values)
        )
    ]
    scaled = S / np.sqrt(np.outer(np.diag(S), np.diag(S)))
    assert np.prod(ratios) == pytest.approx(np.linalg.det(scaled), rel=1e-11)
    health = evaluate(g, [elimination.health()], values)[0]
    assert health == pytest.approx(np.sqrt(min(ratios)), rel=1e-11)


def test_nearly_equal_rows_are_seen() -> None:
    e = star(4)
    values = dict.fromkeys((*e.q, *e.velocities), 1.0) | {"m": 2.0, "l": 1.0, "t": 0.0}
    values |= {f"length.c{i}": 0.0 for i in range(1, 5)}
    elimination = Elimination(e)
    assert any(len(row.weights) == 2 for row in elimination.rows)
    # Arms 2 and 3 hardly move: both rows are nearly that of the joint.
    values |= {"x2": 1e-3, "x3": 1e-3}
    health = evaluate(e.graph, [elimination.health()], values)[0]
    assert health < 1e-5


def test_far_from_the_origin_only_differences_count() -> None:
    e = derive(
        read(
            "parameters: {m: 2, g: 9.81, X: 1e6}\n"
            "coordinates: {x: {}, y: {}, u: {}, v: {}}\n"
            "initial: {x: X + 1, y: X, u: X + 2, v: X}\n"
            "energy:\n"
            "  kinetic: m*(x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2)/2\n"
            "  potential: m*g*(y + v)\n"
            "constraints:\n"
            "  upper: (x - X)^2 + (y - X)^2 = 1\n"
            "  lower: (u - x)^2 + (v - y)^2 = 1\n",
            "model.yaml",
        )
    )
    nodes = [n for part in Elimination(e).motion() for n in part]
    rates = {"x_dot": 0.25, "y_dot": -0.5, "u_dot": 1.5, "v_dot": 0.75}
    found = []
    for X in (0.0, 2.0**20):
        places = {"x": 0.625 + X, "y": -0.75 + X, "u": 1.25 + X, "v": -1.5 + X}
        values = {"m": 2.0, "g": 9.81, "X": X, "t": 0.0} | places | rates
        found.append(evaluate(e.graph, nodes, values))
    assert found[0] == found[1]  # these places are exact in doubles
