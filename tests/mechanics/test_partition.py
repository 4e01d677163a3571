"""Closed loops solved for the accelerations of independent coordinates.

Expected accelerations and multipliers are those of the equations with M and A written
out, or of equations derived by hand and integrated by scipy.
"""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagsim.admissibility.examination import examine
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.partition import Partition, blocks_of
from lagsim.model.reader import read
from lagsim.plan.plan import make_plan
from tests.support import run, shipped

# Uniform rods. The bar p carries the coupler q, which ends on the rocker r.
FOUR_BAR = """
parameters: {a: 1.0, b: 1.2, c: 0.9, e: 1.5, m: 0.7, g: 9.81}
coordinates: {p: {}, q: {}, r: {}}
definitions:
  A: a*vec(cos(p), sin(p))
  B: A + b*vec(cos(q), sin(q))
  C: vec(e, 0) + c*vec(cos(r), sin(r))
  G: (A + B)/2
energy:
  kinetic: m*(a^2*p_dot^2/3 + dot(G_dot, G_dot) + b^2*q_dot^2/12 + c^2*r_dot^2/3)/2
  potential: m*g*(A.y/2 + G.y + C.y/2)
constraints: {loop: B = C}
initial: {p: 1.0, p_dot: 0, q: {guess: 0.1}, q_dot: {guess: 0}, r: {guess: 1.2},
  r_dot: {guess: 0}}
simulation: {duration: 1.5, output_step: 0.01}
"""
# Two loops that share the coupler q; the second one is driven by a point on it.
SIX_BAR = """
parameters: {a: 0.4, b: 1.2, c: 0.9, d: 1.3, f: 0.7, l: 1.0, h: 0.8, m: 1.0, k: 20}
coordinates: {p: {}, q: {}, r: {}, u: {}, w: {}}
definitions:
  A: a*vec(cos(p), sin(p))
  B: A + b*vec(cos(q), sin(q))
  C: vec(d, 0) + c*vec(cos(r), sin(r))
  E: A + f*vec(cos(q + 0.5), sin(q + 0.5))
  F: E + l*vec(cos(u), sin(u))
  H: vec(2.2, 1.0) + h*vec(cos(w), sin(w))
energy:
  kinetic: m*(p_dot^2 + dot(B_dot, B_dot) + q_dot^2 + r_dot^2 + dot(F_dot, F_dot)
    + u_dot^2 + w_dot^2)/2
  potential: k*(w - 2)^2/2
forces: {p: 1}
constraints: {first: B = C, second: F = H}
initial: {p: 0.5, q: {guess: 0.6}, r: {guess: 1.5}, u: {guess: 0.3}, w: {guess: 2.4},
  p_dot: 1, q_dot: {guess: 0}, r_dot: {guess: 0}, u_dot: {guess: 0}, w_dot: {guess: 0}}
simulation: {duration: 2, output_step: 0.01}
"""
SLIDER_CRANK = """
parameters: {r: 0.3, l: 1.0, m: 1.0, k: 30}
coordinates: {crank: {}, rod: {}, x: {}}
definitions:
  A: r*vec(cos(crank), sin(crank))
  G: A + l/2*vec(cos(rod), -sin(rod))
energy:
  kinetic: crank_dot^2/2 + m*dot(G_dot, G_dot)/2 + rod_dot^2/24 + x_dot^2
  potential: k*(x - 1)^2/2
constraints: {pin: "A + l*vec(cos(rod), -sin(rod)) = vec(x, 0)"}
initial: {crank: 0.3, crank_dot: 3, rod: {guess: 0.1}, rod_dot: {guess: 0},
  x: {guess: 1.2}, x_dot: {guess: 0}}
simulation: {duration: 2, output_step: 0.01}
"""


@cache
def solution(name):
    model = shipped("andrews") if name == "andrews" else read(MODELS[name], name)
    equations = derive(model)
    plan = make_plan(equations, examine(equations).start, model.settings())
    return equations, plan.elimination


MODELS = {"four-bar": FOUR_BAR, "six-bar": SIX_BAR, "slider-crank": SLIDER_CRANK}
INDEPENDENT = {
    "andrews": "beta", "four-bar": "p", "six-bar": "p", "slider-crank": "crank",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", INDEPENDENT)
def test_accelerations_solve_the_equations_with_multipliers(name):
    e, solved = solution(name)
    assert isinstance(solved, Partition)
    assert [e.q[c] for c in solved.independent] == [INDEPENDENT[name]]
    random = np.random.default_rng(1)
    n, m = len(e.q), len(e.rows)
    # Any state will do: the equations are linear in q'' and lambda.
    values = {x.name: x.value for x in e.model.parameters}
    values |= dict(zip(e.state, random.uniform(-0.6, 0.6, 2 * n), strict=True))
    values |= {"t": 0.0}
    K, right = np.zeros((n + m, n + m)), np.zeros(n + m)
    for (i, j), node in e.mass_entries.items():
        K[i, j] = evaluate(e.graph, [node], values)[0]
    for k, row in enumerate(e.rows):
        numbers = evaluate(e.graph, row.A.entries.values(), values)
        K[n + k, list(row.A.entries)] = numbers
        K[list(row.A.entries), n + k] = [-x for x in numbers]
    right[:n] = evaluate(e.graph, e.f, values)
    right[n:] = evaluate(e.graph, [row.b for row in e.rows], values)
    expected = np.linalg.solve(K, right)
    found = np.array(
        evaluate(e.graph, [*solved.motion()[0], *solved.motion()[1]], values)
    )
    # Both lose digits with the condition of the blocks.
    assert found == pytest.approx(
        expected, rel=1e-9, abs=1e-10 * np.abs(expected).max()
    )
    forces = random.uniform(-1.0, 1.0, n)
    pushed = solved.response([e.graph.constant(float(x)) for x in forces])
    expected = np.linalg.solve(K, np.concatenate([forces, np.zeros(m)]))[:n]
    assert evaluate(e.graph, pushed, values) == pytest.approx(expected, rel=1e-9)
    # The least change in the metric of M that cancels residuals has A dq = -residuals.
    off = random.uniform(-1.0, 1.0, m)
    change = solved.correction([e.graph.constant(float(x)) for x in off])
    expected = np.linalg.solve(K, np.concatenate([np.zeros(n), -off]))[:n]
    assert evaluate(e.graph, change, values) == pytest.approx(expected, rel=1e-9)


def by_hand(_, y):
    """Return y' of the four-bar, from M, A and the forces derived by hand."""
    a, b, c, m, g = 1.0, 1.2, 0.9, 0.7, 9.81
    p, q, r, u, v, w = y
    half = m * a * b / 2
    M = np.diag([4 / 3 * m * a**2, m * b**2 / 3, m * c**2 / 3])
    M[0, 1] = M[1, 0] = half * np.cos(p - q)
    f = [
        -half * np.sin(p - q) * v**2 - 1.5 * m * g * a * np.cos(p),
        half * np.sin(p - q) * u**2 - m * g * b / 2 * np.cos(q),
        -m * g * c / 2 * np.cos(r),
    ]
    turned = np.array([[-np.sin(x), np.cos(x)] for x in (p, q, r)]).T
    lengths = np.array([a, b, -c])
    A = turned * lengths
    right = np.array([[np.cos(x), np.sin(x)] for x in (p, q, r)]).T @ (
        lengths * np.array([u, v, w]) ** 2
    )
    K = np.block([[M, A.T], [A, np.zeros((2, 2))]])
    return [u, v, w, *np.linalg.solve(K, [*f, *right])[:3]]


@pytest.mark.slow
def test_a_bar_passes_the_pose_in_which_it_does_not_determine_the_others():
    result = run(FOUR_BAR)
    choices = [x.choice for x in result.trajectory.choices]
    [given_up] = [x for x in choices if " from t = " in x]
    assert given_up.startswith("solve: straight-line code")
    assert "rank" not in {event.kind for event in result.trajectory.events}
    first = result.rows[0]
    exact = solve_ivp(by_hand, (0, 1.5), first[1:7], "DOP853", rtol=1e-12, atol=1e-12)
    # q and r are parallel between the rows: there the bar p turns back.
    apart = np.sin(result["q"] - result["r"])
    assert apart.min() < -0.1
    assert apart.max() > 0.1
    # Tolerances of 1e-11 and 1e-12 a step.
    assert result.rows[-1, 1:7] == pytest.approx(exact.y[:, -1], abs=2e-8)


@pytest.mark.slow
def test_parallel_bars_become_dependent_as_without_a_partition():
    text = FOUR_BAR.replace("c: 0.9, e: 1.5", "c: 1.0, e: 1.2")
    text = text.replace("p_dot: 0,", "p_dot: 0.5,").replace("guess: 1.2", "guess: 1.0")
    result = run(text)
    choices = [x.choice for x in result.trajectory.choices]
    assert any(x.startswith("solve: straight-line code from") for x in choices)
    # Of bars of equal lengths the last ones stay parallel to the first, or cross.
    assert "rank" in {event.kind for event in result.trajectory.events}


def test_blocks_have_constant_entries_if_these_are_large_enough():
    A = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.5]])
    moving = np.array([[False, False, True], [False, False, True]])
    entries = [{0, 2}, {1, 2}]
    blocks = blocks_of(A, moving, entries)
    assert [(x.rows, x.columns) for x in blocks] == [((0,), (0,)), ((1,), (1,))]
    # The first coordinate would determine nothing: 1e-3 of its row.
    blocks = blocks_of(A * [1e-3, 1.0, 1.0], moving, entries)
    assert {c for x in blocks for c in x.columns} == {1, 2}
    assert blocks_of(A[:1] * [1.0, 1.0, 0.0] * 0.0, moving[:1], entries[:1]) is None
