"""Relations that are curves of velocities and begin to hold: the jump onto them.

The expected velocities are those of a large force along the relation's row, which turns
with the velocities: dv = M^-1 A(v)^T dLambda until the relation holds.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lagsim

MODEL = """
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: x_dot^2 + 0.3*x_dot*y_dot + y_dot^2/2 + 0.35*z_dot^2, potential: 0}}
constraints: {{{rows}}}
{more}
initial: {{x: 0, y: 0, z: 0, x_dot: 1.5, y_dot: -1, z_dot: 3}}
simulation: {{duration: 1, output_step: 0.1{method}}}
"""
M = np.array([[2, 0.3, 0], [0.3, 1, 0], [0, 0, 0.7]])
# A relation that begins to hold, its residual and its row; a rod that always holds.
PARABOLA = (
    "h: {relation: 'y_dot = 0.3*x_dot^2', when: t >= 0.5}",
    lambda v: v[1] - 0.3 * v[0] ** 2,
    lambda v: [-0.6 * v[0], 1, 0],
)
SADDLE = (
    "g: {relation: 'z_dot = x_dot*y_dot', when: t >= 0.5}",
    lambda v: v[2] - v[0] * v[1],
    lambda v: [-v[1], -v[0], 1],
)
ROD = ("p: z = 2*x", None, lambda _v: [-2, 0, 1])
WALL = "w: {relation: y >= -0.5, restitution: 0.5}"


def after(relations, start):
    """Return the velocities (3,), and the impulses of the relations, after the jump."""
    off = np.array([r(start) if r else 0.0 for _, r, _ in relations])

    def rates(_s, x):
        A = np.array([row(x[:3]) for _, _, row in relations], dtype=float)
        response = np.linalg.solve(M, A.T)
        given = np.linalg.solve(A @ response, -off)
        return np.append(response @ given, given)

    x = np.append(start, 0.0 * off)
    x = solve_ivp(rates, (0, 1), x, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return x[:3], x[3:]


def simulated(relations, more="", wall="", method=""):
    """Return the rows just before and just after t = 0.5, and the result."""
    rows = ", ".join([*(text for text, *_ in relations), *([wall] if wall else [])])
    text = MODEL.format(rows=rows, more=more, method=method)
    found = lagsim.simulate(text, error_bar="never")
    assert found.outcome == "done", found.reason
    assert not found.warnings
    first, *_, last = np.flatnonzero(np.abs(found.t - 0.5) < 1e-9)
    return first, last, found


@pytest.mark.parametrize("method", ["", ", method: rk4, step: 0.01"])
@pytest.mark.parametrize("relations", [[PARABOLA], [PARABOLA, ROD], [PARABOLA, SADDLE]])
def test_velocities_follow_the_rows_onto_curves(relations, method):
    _, last, found = simulated(relations, method=method)
    right, _ = after(relations, np.array([1.5, -1.0, 3.0]))
    names = ("x_dot", "y_dot", "z_dot")
    # Both integrations are exact to some units of their tolerance of 1e-13.
    assert [found[x][last] for x in names] == pytest.approx(right, abs=1e-11)
    energy = right @ M @ right / 2 - np.array([1.5, -1, 3]) @ M @ [1.5, -1, 3] / 2
    struck = next(e for e in found.events if e.kind == "impact")
    assert struck.energy == pytest.approx(energy, abs=1e-10)


@pytest.mark.slow
def test_impulses_of_curves_and_of_rods_beside_them():
    # A kick after the jump, so that impulses are columns.
    kick = "modes: {t1: 0.75}\nevents: {k: {at: t >= t1, impulse: {x: 1}}}"
    first, last, found = simulated([PARABOLA, ROD], kick)
    _, given = after([PARABOLA, ROD], np.array([1.5, -1.0, 3.0]))
    columns = ("impulse.h", "impulse.p")
    change = [found[x][last] - found[x][first] for x in columns]
    assert change == pytest.approx(given, abs=1e-10)


def test_a_contact_that_the_jump_opens_does_not_count():
    # The wall is struck at t = 0.5, just before the relation begins to hold: y_dot
    # becomes 0.5, by an impulse along y, and the jump does not lower it.
    _, last, found = simulated([PARABOLA], wall=WALL)
    response = np.linalg.solve(M, [0, 1, 0])
    start = np.array([1.5, -1, 3]) + 1.5 / response[1] * response
    right, _ = after([PARABOLA], start)
    found = [found[x][last] for x in ("x_dot", "y_dot", "z_dot")]
    assert found == pytest.approx(right, abs=1e-11)


@pytest.mark.parametrize(
    ("curve", "wall"),
    [
        ("0.3*x_dot^2", "x <= 1, restitution: 0.5"),
        ("0.3*x_dot^2", "x <= 1, restitution: 0"),
        ("0.3*x_dot^2", "y <= 0.2, restitution: 0.5"),
        ("0.3*x_dot^2", "x + y <= 1, restitution: 0"),
        ("0.3*sin(x_dot)/sin(1)", "x <= 1, restitution: 0.5"),
    ],
)
def test_an_impact_that_leads_off_a_curve_ends_the_run_with_advice(curve, wall):
    result = lagsim.simulate(
        f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
constraints:
  curve: {{relation: y_dot = {curve}}}
  wall: {{relation: {wall}}}
initial: {{x: 0, y: 0, x_dot: 1, y_dot: 0.3}}
simulation: {{duration: 3}}
""",
        error_bar="never",
    )
    # The motion is uniform up to the first impact, at which the run ends.
    assert not result.complete
    assert "an impact leads off `curve`" in result.record["reason"]
    assert result.t[-1] in (
        pytest.approx(1.0),
        pytest.approx(2 / 3),
        pytest.approx(1 / 1.3),
    )
    assert len([x for x in result.events if x.kind == "impact"]) <= 1


def test_an_impact_beside_a_curve_that_it_does_not_move():
    result = lagsim.simulate(
        """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 10*z}
constraints:
  curve: {relation: y_dot = 0.3*x_dot^2}
  floor: {relation: z >= 0, restitution: 0.5}
initial: {x: 0, y: 0, z: 1, x_dot: 1, y_dot: 0.3}
simulation: {duration: 0.6}
""",
        error_bar="never",
    )
    fall = math.sqrt(0.2)
    up = 0.5 * 10 * fall
    assert result.complete
    assert result["z"][-1] == pytest.approx(
        up * (0.6 - fall) - 5 * (0.6 - fall) ** 2, abs=1e-9
    )
    assert result["y"][-1] == pytest.approx(0.18, abs=1e-9)
