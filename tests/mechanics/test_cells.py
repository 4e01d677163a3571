"""Gaps with linear tables of two arguments: pieces without a groove, and motions."""

import numpy as np
import pytest

import lagsim
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read

MODEL = """
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 10*z}}
tables: {{ground: {{interpolation: linear, outside: {outside}, points: [{points}]}}}}
constraints: {{f: {{relation: "{gap} >= 0", restitution: {e}{friction}}}}}
initial: {{x: {x}, y: {y}, z: {z}, x_dot: {vx}, y_dot: {vy}}}
simulation: {{duration: {duration}}}
"""
START = {
    "e": 0, "friction": "", "x": 0, "y": 0, "z": 50, "vx": 0, "vy": 0, "duration": 1,
    "outside": "extend", "gap": "z - ground(x, y)",
}  # fmt: skip
X, Y = np.array([-2.0, -0.5, 0.0, 1.0, 2.5]), np.array([-2.0, 0.0, 1.5, 2.0])


def points(f, x=X, y=Y):
    """Return the points of a table of f on a grid."""
    return ", ".join(
        f"[{a!r}, {b!r}, {float(f(a, b))!r}]" for a in x.tolist() for b in y.tolist()
    )


def linear(values, x, y, *, hold):
    """Return the value of a bilinear table with the grid X, Y."""
    if hold:
        x, y = np.clip(x, X[0], X[-1]), np.clip(y, Y[0], Y[-1])
    i, j = (
        int(np.clip(np.searchsorted(a, b) - 1, 0, len(a) - 2))
        for a, b in ((X, x), (Y, y))
    )
    u, v = (x - X[i]) / (X[i + 1] - X[i]), (y - Y[j]) / (Y[j + 1] - Y[j])
    return np.array([1 - u, u]) @ values[i : i + 2, j : j + 2] @ np.array([1 - v, v])


def valley(x, y):
    return 0.5 * abs(x) + 0.1 * y


def hill(x, y):
    return -(x**2) - y**2


def diagonal(x, y):
    return abs(x - y)


def saddle(x, y):
    return abs(x) * y


def rough(x, y):
    return np.sin(5 * x + 3) + np.cos(7 * y) * np.sin(3 * x * y + 1)


@pytest.mark.parametrize("outside", ["hold", "extend", "error"])
@pytest.mark.parametrize("gap", ["z - ground(x, y)", "-z - 0.5*ground(x, y)"])
@pytest.mark.parametrize("f", [valley, hill, diagonal, saddle, rough])
def test_a_gap_is_the_least_of_its_pieces(f, gap, outside):
    z = 50 if gap.startswith("z") else -50
    text = MODEL.format(
        **{**START, "points": points(f), "gap": gap, "z": z, "outside": outside}
    )
    e = derive(read(text, "model.yaml"))
    nodes = [law.row.residual for law in e.laws]
    assert len(nodes) <= 9
    values = np.array([[f(a, b) for b in Y] for a in X])
    random, far = np.random.default_rng(5), 0.0 if outside == "error" else 2.0
    for _ in range(60):
        x = random.uniform(X[0] - far, X[-1] + far)
        y = random.uniform(Y[0] - far, Y[-1] + far)
        height = linear(values, x, y, hold=outside == "hold")
        own = {"x": x, "y": y, "z": 0.3, "t": 0.0}
        found = np.array(evaluate(e.graph, nodes, own))
        expected = 0.3 - height if z > 0 else -0.3 - 0.5 * height
        assert np.min(found) == pytest.approx(expected, abs=1e-11), (x, y)
        # Off the edges a body touches one contact.
        assert np.sum(np.abs(found - expected) < 1e-11) == 1, (x, y)


def run(**values):
    result = lagsim.simulate(MODEL.format(**{**START, **values}), error_bar="never")
    assert result.complete
    return result


def test_a_ball_comes_to_rest_in_a_groove_of_cells():
    # Dropped onto the groove x = 0 it then slides along it, at a slope of 0.1.
    result = run(points=points(valley), y=1, z=0.6, duration=0.8)
    assert np.max(np.abs(result["x"])) < 1e-12
    along = result["y_ddot"][-1]
    assert along == pytest.approx(-10 * 0.1 / 1.01, rel=1e-9)
    assert len(result.events) < 100


@pytest.mark.slow
@pytest.mark.parametrize("y", [-1.0, 0.0, 1.5, 1.7])
def test_a_ball_rests_in_a_groove_with_the_force_of_its_weight(y):
    own = points(lambda a, _: 0.5 * abs(a))
    for outside in ("extend", "hold", "error"):
        result = run(points=own, y=y, z=0, outside=outside)
        assert np.max(np.abs(result["z"])) < 1e-12
        assert result["lambda_f"][-1] == pytest.approx(10.0)


@pytest.mark.slow
def test_a_ball_slides_along_a_diagonal_groove():
    # The cell on the diagonal is the surface x + y - 2 x y, whose grooves are its
    # edges: at y = 0.5 the ball is between the edges x = 0 and x = 1.
    grid = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    own = points(diagonal, grid, grid)
    result = run(points=own, x=0.5, y=0.5, z=0.6, vx=0.4, vy=-0.4, duration=0.4)
    walls = MODEL.format(
        **{**START, "x": 0.5, "y": 0.5, "z": 0.6, "vx": 0.4, "vy": -0.4},
        points="",
    )
    walls = walls.replace("duration: 1", "duration: 0.4")
    lines = [line for line in walls.splitlines() if "tables" not in line]
    relations = ("x - y", "y - x", "x + y - 2*x*y")
    each = ", ".join(
        f'f{k}: {{relation: "z >= {text}", restitution: 0}}'
        for k, text in enumerate(relations)
    )
    lines = [f"constraints: {{{each}}}" if "constraints" in x else x for x in lines]
    other = lagsim.simulate("\n".join(lines), error_bar="never")
    for name in ("x", "y", "z"):
        assert result[name][-1] == pytest.approx(other[name][-1], abs=1e-9)


def test_a_ball_flies_off_a_ridge_that_becomes_a_groove():
    # The line x = 0 of |x| y is a ridge for y < 0: two pieces meet there, since it is a
    # groove for y > 0.
    start = {"x": -0.5, "y": -1, "z": -0.5, "vx": 2, "vy": 0}
    own = points(saddle, np.array([-2.0, 0.0, 2.0]), np.array([-2.0, 2.0]))
    result = run(points=own, **start, duration=0.6)
    ridge = MODEL.format(**{**START, **start, "points": own, "duration": 0.6})
    ridge = ridge.replace("ground(x, y)", "abs(x)*y")
    lines = [line for line in ridge.splitlines() if "tables" not in line]
    other = lagsim.simulate("\n".join(lines), error_bar="never")
    assert other.complete
    for name in ("x", "y", "z"):
        assert result[name][-1] == pytest.approx(other[name][-1], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_motions_are_those_over_half_planes(e, friction):
    rubs = f", friction: {friction}, slip: [x_dot, y_dot]" if friction else ""
    planes = ["0.5*x + 0.3*y", "0.5*x - 0.2*y", "-0.7*x + 0.3*y", "-0.7*x - 0.2*y"]
    start = {"x": 0.4, "y": -0.5, "z": 0.9, "vx": 0.2, "vy": 0.3}
    own = points(
        lambda a, b: max(0.5 * a, -0.7 * a) + max(0.3 * b, -0.2 * b),
    )
    result = run(points=own, friction=rubs, e=e, **start, duration=1.5)
    text = MODEL.format(
        **{**START, **start, "points": own, "e": e, "duration": 1.5, "friction": rubs}
    )
    each = ", ".join(
        f'f{k}: {{relation: "z >= {plane}", restitution: {e}{rubs}}}'
        for k, plane in enumerate(planes)
    )
    lines = [line for line in text.splitlines() if "tables" not in line]
    lines = [f"constraints: {{{each}}}" if "constraints" in x else x for x in lines]
    other = lagsim.simulate("\n".join(lines), error_bar="never")
    assert other.complete
    times = np.linspace(0.0, 1.5, 50)
    for name in ("x", "y", "z"):
        ours, theirs = (np.interp(times, r.t, r[name]) for r in (result, other))
        assert ours == pytest.approx(theirs, abs=1e-5), name


@pytest.mark.slow
def test_a_groove_that_has_no_pieces_ends_the_run_with_advice():
    # The sign of (y + 3) is not the same at all states: the gap has no pieces.
    text = MODEL.format(**{**START, "x": 0.5, "z": 2, "points": ""})
    text = text.replace("ground(x, y)", "(y + 3)*abs(x)")
    lines = [line for line in text.splitlines() if "tables" not in line]
    result = lagsim.simulate("\n".join(lines), error_bar="never")
    assert not result.complete
    assert "write one relation for each side" in result.record["reason"]
