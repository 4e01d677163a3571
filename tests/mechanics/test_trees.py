"""Trees of frames in space, whose equations are derived by recursion."""

from __future__ import annotations

import math
import random

import mpmath
import numpy as np
import pytest

import lagsim
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.ldl import Elimination, elimination_of
from lagsim.model.reader import read
from lagsim.program.rounding import rounding_bounds
from lagsim.run.session import open_case

MASS, J = 1.3, (0.011, 0.012, 0.004)
ARM, CENTRE = (0.02, -0.05, 0.3), (0.01, 0.03, 0.15)
G = (0.4, -1.1, -9.81)
TREE = """
parameters: {{n: {n}, m: 1.3, J: {{value: [0.011, 0.012, 0.004]}}, d: 0.05}}
coordinates: {{q(1..n): {{}}{more}}}
frames:
  arm(0): {base}
{frames}
definitions:
  tip(0): {{value: {origin}}}
{tips}
bodies:
{bodies}
gravity: [0.4, -1.1, -9.81]
energy: {{kinetic: {kinetic}, potential: {potential},
  dissipation: "sum(i = 1..n, d*q_dot(i)^2/2)"}}
{rest}
initial: {{q(i = 1..n): 0.3*sin(i){start}}}
simulation: {{duration: 1, output_step: 0.1}}
"""


def tree(parents, axes, **given):
    """Return the text of a tree: body i on `parents[i - 1]`, turned about an axis."""
    frames, tips, bodies = [], [], []
    pairs = zip(parents, axes, strict=True)
    for i, (p, axis) in enumerate(pairs, 1):
        frames.append(
            f"  arm({i}): {{on: arm({p}), axis: {list(axis)}, angle: q({i})}}"
        )
        arm, centre = (f"rotate(arm({i}), vec{x})" for x in (ARM, CENTRE))
        tips.append(f"  tip({i}): {{value: 'tip({p}) + {arm}'}}")
        bodies.append(
            f"  link({i}): {{mass: m, at: 'tip({p}) + {centre}', frame: arm({i}), "
            "inertia: J}"
        )
    usual = {
        "more": "", "base": "space", "origin": "[0, 0, 0]", "kinetic": "bodies",
        "potential": "bodies", "rest": "", "start": "",
    }  # fmt: skip
    lines = {"frames": frames, "tips": tips, "bodies": bodies}
    texts = {key: "\n".join(x) for key, x in lines.items()}
    return TREE.format(n=len(parents), **{**usual, **given}, **texts)


def chain(n):
    """Return parents and axes of a chain whose joints are alternately about y and z."""
    axes = [(0, 1, 0) if i % 2 else (0, 0, 1) for i in range(n)]
    return [*range(n)], axes


def branched(n):
    """Return parents and axes of a tree, some of whose axes are oblique."""
    axes = [(0, 1, 0), (1, 0, 0), (1, 2, -2), (0, 0, 1), (0.6, 0, 0.8)]
    return [max(0, i - 1 - i % 3) for i in range(n)], [axes[i % 5] for i in range(n)]


def equations_of(text, **how):
    model = read(text, "tree.yaml")
    model.graph.unbind()
    return derive(model, **how)


def values_of(e, seed, size=1.0):
    """Return random values of all variables and the values of parameters."""
    rng = random.Random(seed)
    names = (*e.state, *e.accelerations, *e.multipliers)
    values = {name: rng.uniform(-size, size) for name in names}
    return {**e.model.parameter_values, "t": 0.7, **values}


def cross(a, b):
    return np.cross(a, b)


def newton_euler(parents, axes, q, v, a):
    """Return the torques of the joints by recursive Newton and Euler equations.

    R. Featherstone, Rigid Body Dynamics Algorithms, section 5.3, in space components.
    """
    n = len(parents)
    R, w, w_dot, at, at_dd = [np.eye(3)], [np.zeros(3)], [np.zeros(3)], [np.zeros(3)], \
        [np.zeros(3)]  # fmt: skip
    arms, forces, moments, ways = [], [], [], []
    for i, (p, axis) in enumerate(zip(parents, axes, strict=True)):
        k = np.array(axis, float) / np.linalg.norm(axis)
        K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        turn = np.eye(3) + math.sin(q[i]) * K + (1 - math.cos(q[i])) * K @ K
        R.append(R[p] @ turn)
        way = R[-1] @ k
        w.append(w[p] + way * v[i])
        w_dot.append(w_dot[p] + way * a[i] + cross(w[p], way * v[i]))

        def accelerated(r):
            return cross(w_dot[-1], r) + cross(w[-1], cross(w[-1], r))

        arm, centre = R[-1] @ ARM, R[-1] @ CENTRE
        inertia = R[-1] @ np.diag(J) @ R[-1].T
        forces.append(MASS * (at_dd[p] + accelerated(centre) - np.array(G)))
        moments.append(inertia @ w_dot[-1] + cross(w[-1], inertia @ w[-1]))
        arms.append(centre)
        ways.append((way, at[p]))
        at.append(at[p] + arm)
        at_dd.append(at_dd[p] + accelerated(arm))
    torques = np.zeros(n)
    inside = [{i} for i in range(n)]  # the bodies that joint i carries
    for i in reversed(range(n)):
        if parents[i]:
            inside[parents[i] - 1] |= inside[i]
    for i, (way, hinge) in enumerate(ways):
        for k in inside[i]:
            r = at[parents[k]] + arms[k] - hinge
            torques[i] += way @ (moments[k] + cross(r, forces[k]))
    return torques


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "n"), [(chain, 7), (chain, 20), (branched, 11), (branched, 24)]
)
def test_a_tree_moves_by_newton_and_euler(shape, n):
    e = equations_of(tree(*shape(n)))
    assert e.tree is not None
    assert (e.chains is not None) == (n == 20)  # else entries of M are shorter
    values = values_of(e, n)
    q, v, a = (
        np.array([values[x] for x in names])
        for names in (e.q, e.velocities, e.accelerations)
    )
    residuals = np.array(evaluate(e.graph, e.motion_residuals(), values))
    torques = newton_euler(*shape(n), q, v, a) + 0.05 * v
    # Roundoff of sums over n bodies, relative to the largest.
    assert residuals == pytest.approx(torques, rel=0, abs=1e-13 * np.max(abs(torques)))


FLOATING = {
    "more": ", p(1..4): {}, x(1..3): {}",
    "base": "{quaternion: [p(1), p(2), p(3), p(4)]}",
    "origin": "['x(1)', 'x(2)', 'x(3)']",
    "kinetic": "'bodies + spin(J, omega(arm(0))) + sum(i = 1..3, x_dot(i)^2)'",
    "start": ", x(i = 1..3): 0.1*i, p(1): 1, p(2): 0, p(3): 0, p(4): 0",
}
CASES = {
    "chain": {},
    "floating": FLOATING,
    "closed": {
        "rest": "constraints: {loop: 'dot(tip(n) - tip(3), tip(n) - tip(3)) = 0.2', "
        "roll: 'tip_dot(n).x - 0.3*tip_dot(n).y = 0'}",
    },
    "springs": {
        "potential": "'bodies + 40*dot(tip(n) - tip(2), tip(n) - tip(2)) "
        "+ rotate(arm(5), vec(0, 1, 0)).x^3'",
        "rest": "forces: {tip(n): ['-2*tip_dot(n).x', 'sin(t)', 0.1]}",
    },
    "touching": {
        "rest": "constraints: {floor: {relation: 'tip(n).z >= -1', restitution: 0.5}}",
    },
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("shape", [chain, branched])
def test_a_tree_has_the_equations_of_products_of_matrices(case, shape):
    text = tree(*shape(7 if shape is chain else 11), **CASES[case])
    e, plain = equations_of(text), equations_of(text, chained=False)
    assert e.tree is not None
    assert plain.tree is None
    values = values_of(e, 5)
    for one, other in [
        ([x for row in e.M for x in row], [x for row in plain.M for x in row]),
        (e.f, plain.f),
        ([*e.powers, e.energy], [*plain.powers, plain.energy]),
        *(
            ([*a.A, a.b, a.rate], [*b.A, b.b, b.rate])
            for a, b in zip(e.every_row, plain.every_row, strict=True)
        ),
    ]:
        found, expected = (
            np.array(evaluate(x.graph, nodes, values))
            for x, nodes in ((e, one), (plain, other))
        )
        size = np.max(np.abs(expected), initial=1e-300)
        assert found == pytest.approx(expected, rel=0, abs=3e-14 * size)


def test_few_rotations_are_written_out():
    # As shipped: a body with three angles, and wheels on a body.
    e = equations_of(tree([0, 1, 2, 0, 4, 5], [(0, 0, 1), (1, 0, 0), (0, 1, 0)] * 2))
    assert e.tree is None


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "some"), [(chain, 20), (branched, 48)])
def test_operations_grow_as_the_number_of_bodies(shape, some):
    costs = []
    for n in (some, 2 * some):  # of which few are at an end
        e = equations_of(tree(*shape(n)))
        solved = elimination_of(e)
        costs.append(e.graph.cost(solved.motion()[0], e.moving))
    assert math.log2(costs[1] / costs[0]) < 1.2


EXACTLY = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b, "neg": lambda a: -a, "sin": mpmath.sin,
    "cos": mpmath.cos, "sqrt": mpmath.sqrt, "pow": lambda a, b: a**b,
}  # fmt: skip


def exactly(g, nodes, values):
    """Return the values of nodes to 40 digits."""
    found = {}
    with mpmath.workdps(40):
        for n in g.cone(nodes):
            if g.args[n]:
                found[n] = EXACTLY[g.ops[n]](*(found[a] for a in g.args[n]))
            else:
                x = g.payload(n)
                found[n] = mpmath.mpf(values[x] if isinstance(x, str) else x)
        return [found[n] for n in nodes]


@pytest.mark.slow
@pytest.mark.parametrize("n", [14, 28])
def test_roundoff_is_bounded_and_not_far_below_the_bound(n):
    e = equations_of(tree(*chain(n)))
    solved = Elimination(e, math.inf)
    values = values_of(e, 1, 0.5)
    found = solved.motion()[0]
    errors = [
        abs(float(x - y))
        for x, y in zip(
            exactly(e.graph, found, values),
            evaluate(e.graph, found, values),
            strict=True,
        )
    ]
    bounds = evaluate(e.graph, rounding_bounds(e, solved)[:n], values)
    bound = 2.0**-53 * max(map(abs, bounds))
    # Bounds by magnitudes of products of matrices are 1e4 times the errors and more.
    assert max(errors) < bound < 1000 * max(errors)


@pytest.mark.slow
def test_a_long_tree_is_planned_along_its_joints():
    case = open_case(read(tree(*chain(24)), "tree.yaml"))
    plan = case.plan()
    assert plan.elimination is not None
    assert any("along chains" in x.reason for x in plan.choices)


@pytest.mark.slow
def test_equations_for_readers_are_in_the_definitions_of_the_file():
    text = lagsim.derive(lagsim.load(tree(*chain(22)))).as_text()
    assert "accelerations are too long to be read" in text
