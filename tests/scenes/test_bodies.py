"""Motions of bodies in frames: arms, tops, free bodies, torques, gimbal lock."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import lagsim
from tests.support import refused, simulate

# --- An arm, against Newton and Euler's equations by recursion (R. Featherstone, Rigid
# Body Dynamics Algorithms, table 5.1), joint by joint, in the links' own components

AXES, LINK, CENTRE, J = "zyzyzyz", 0.3, 0.15, np.array([0.01, 0.012, 0.004])
ARM = """
parameters: {n: 7, l: 0.3, c: 0.15, m: 1, g: 9.81, d: 0.05, J: [0.01, 0.012, 0.004],
  ay(1..n): [0, 1, 0, 1, 0, 1, 0]}
coordinates: {q(1..n): {unit: rad}}
frames:
  arm(0): space
  arm(i = 1..n): {on: arm(i-1), axis: [0, ay(i), 1 - ay(i)], angle: q(i)}
definitions:
  tip(0): vec(0, 0, 0)
  tip(i = 1..n): tip(i-1) + rotate(arm(i), vec(0, 0, l))
bodies:
  link(i = 1..n):
    {mass: m, at: "tip(i-1) + rotate(arm(i), vec(0, 0, c))", frame: arm(i), inertia: J}
gravity: [0, 0, -g]
energy: {kinetic: bodies, potential: bodies,
  dissipation: "sum(i = 1..n, d*q_dot(i)^2/2)"}
initial: {q(i = 1..n): 0.3 + 0.1*(i-1)}
simulation: {duration: 1, output_step: 0.01}
output: {columns: []}
"""
TURNS = "ay(1..n): [0, 1, 0, 1, 0, 1, 0]"
BY_TURNS = ARM.replace(TURNS, "ay(i = 1..n): (1 + (-1)^i)/2")
# Positions at 1 s from `torques` solved for q'' and integrated by scipy's DOP853 at
# 1e-13. MuJoCo 3.17 by RK4 comes within 4.9e-9 of them at a step of 2e-4, and within
# 3.0e-10 at 1e-4: that is its error, which falls as the fourth power.
AT_1_S = [
    3.9770954799319274, 2.2429297121257172, 5.56139324493278, 0.3720357494742893,
    5.917942770774071, 0.5581793384820204, -0.1712808515217449,
]  # fmt: skip


def torques(q, v, a, axes=AXES, g=9.81):
    """Return the torques (7,) at the joints for a motion."""
    w = dw = r = np.zeros(3)
    acceleration = np.array([0, 0, g])
    passed = []
    for axis, angle, speed, gain in zip(axes, q, v, a, strict=True):
        n = np.eye(3)["xyz".index(axis)]
        K = np.cross(np.eye(3), n)
        R = np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K
        acceleration = acceleration + np.cross(dw, r) + np.cross(w, np.cross(w, r))
        acceleration = R.T @ acceleration
        dw = R.T @ dw + n * gain + np.cross(R.T @ w, n * speed)
        w = R.T @ w + n * speed
        r, c = [0, 0, LINK], [0, 0, CENTRE]
        force = acceleration + np.cross(dw, c) + np.cross(w, np.cross(w, c))
        passed.append((R, n, force, J * dw + np.cross(w, J * w) + np.cross(c, force)))
    found, f, m = [], np.zeros(3), np.zeros(3)
    for R, n, force, moment in reversed(passed):
        m = m + moment + np.cross([0, 0, LINK], f)
        f = f + force
        found.append(n @ m)
        f, m = R @ f, R @ m
    return np.array(found[::-1])


@pytest.mark.slow
def test_an_arm_moves_as_newton_and_euler_have_it():
    r = simulate(lagsim.load(ARM))
    q, v, a = (
        np.array([r[f"q{ending}.{k}"] for k in range(1, 8)]).T
        for ending in ("", "_dot", "_ddot")
    )
    np.testing.assert_allclose(q[-1], AT_1_S, atol=1e-11)
    for row in zip(q, v, a, strict=True):
        np.testing.assert_allclose(torques(*row), -0.05 * row[1], atol=1e-10)


@pytest.mark.parametrize("n", [1, 2, pytest.param(12, marks=pytest.mark.slow)])
def test_another_number_of_links(n):
    r = simulate(lagsim.load(BY_TURNS, n=n), duration=0.02)
    q, v, a = (
        np.array([r[f"q{ending}.{k}"][-1] for k in range(1, n + 1)])
        for ending in ("", "_dot", "_ddot")
    )
    found = torques(q, v, a, "".join("zy"[k % 2] for k in range(n)))
    np.testing.assert_allclose(found, -0.05 * v, atol=1e-10)


@pytest.mark.slow
def test_other_axes_by_values_of_parameters():
    bound = lagsim.load(BY_TURNS, n=4).bind(**{"ay.3": 1})
    r = simulate(bound, duration=0.1)
    q, v, a = (
        np.array([r[f"q{ending}.{k}"][-1] for k in range(1, 5)])
        for ending in ("", "_dot", "_ddot")
    )
    np.testing.assert_allclose(torques(q, v, a, "zyyy"), -0.05 * v, atol=1e-10)


# --- The heavy top of O. Bruels, A. Cardona, J. Comput. Nonlinear Dynam. 5 (2010)

TOP = """
parameters: {m: 15, g: 9.81, J: [0.234375, 0.46875, 0.234375]}
definitions: {w: omega(top), G: "rotate(top, vec(0, 1, 0))"}
bodies: {top: {mass: m, at: G, frame: top, inertia: J}}
gravity: [0, 0, -g]
energy: {kinetic: bodies, potential: bodies}
simulation: {duration: 1, output_step: 0.01}
"""
START = "w: 'vec(0, 150, -4.61538)'"
QUATERNION = f"""{TOP}
coordinates: {{p0: {{}}, p1: {{}}, p2: {{}}, p3: {{}}}}
frames: {{top: {{quaternion: [p0, p1, p2, p3]}}}}
initial: {{p0: 1, p1: 0, p2: 0, p3: 0, {START}}}
"""


def by_angles(axes, start, axis, angle, tilt="-pi/4"):
    """Write the top with angles on a tilted base, so that gimbal lock is far."""
    return f"""{TOP}
coordinates: {{a: {{}}, b: {{}}, c: {{}}}}
frames:
  base: {{axis: [1, 0, 0], angle: {tilt}}}
  euler: {{on: base, angles: [a, b, c], axes: {axes}}}
  top: {{on: euler, axis: {axis}, angle: {angle}}}
initial: {{{start}, {START}}}
"""


ZXZ = by_angles("zxz", "a: 0, b: -pi/4, c: 0", [1, 0, 0], "pi/2")
ZYX = by_angles("zyx", "a: pi/2, b: -pi/4, c: 0", [0, 0, 1], "-pi/2")


@pytest.mark.slow
def test_a_top_by_a_quaternion_and_by_angles():
    runs = [simulate(lagsim.load(text)) for text in (QUATERNION, ZXZ, ZYX)]
    p = np.array([runs[0][f"p{k}"] for k in range(4)])
    assert np.max(np.abs(np.linalg.norm(p, axis=0) - 1)) < 1e-14
    assert np.max(np.abs(runs[0]["lambda_unit.top"])) < 1e-8  # of 1e4 N m
    for c in "xyz":
        for one in runs[1:]:
            np.testing.assert_allclose(one[f"G.{c}"], runs[0][f"G.{c}"], atol=1e-10)
            np.testing.assert_allclose(one[f"w.{c}"], runs[0][f"w.{c}"], atol=1e-9)
        # It is symmetric: the spin about its axis is constant.
        np.testing.assert_allclose(runs[0]["w.y"], 150, rtol=1e-11)
    assert [runs[0][f"w.{c}"][0] for c in "xyz"] == pytest.approx(
        [0, 150, -4.61538], abs=1e-13
    )


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["projection", "baumgarte", "drift"])
@pytest.mark.parametrize(
    "method", ["dop853", "euler", "generalized-alpha", "radau", "rk4", "taylor"]
)
def test_a_quaternion_keeps_its_length(method, formulation):
    # At 150 rad/s: two turns and a half, or a half of one in 200 steps.
    adaptive = method in ("dop853", "radau", "taylor")
    step = None if adaptive else 1e-4
    r = simulate(
        lagsim.load(QUATERNION), method=method, formulation=formulation, step=step,
        duration=0.1 if adaptive else 0.02, error_bar="never",
    )  # fmt: skip
    p = np.array([r[f"p{k}"] for k in range(4)])
    assert np.max(np.abs(np.linalg.norm(p, axis=0) - 1)) < 1e-14


@pytest.mark.slow
def test_forces_that_are_zero_have_no_picture(tmp_path):
    r = simulate(lagsim.load(QUATERNION), duration=0.01)
    r.write(tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert "trajectory.png" in names
    assert "constraint_forces.png" not in names


@pytest.mark.slow
def test_drift_leaves_the_constraints_of_the_file():
    """The same top, held at its tip by three constraints on its free centre."""
    text = QUATERNION.replace("p3: {}}", "p3: {}, r: {components: xyz}}")
    text = text.replace("at: G", "at: r") + "constraints: {tip: r = G}\n"
    text = text.replace("initial: {", "initial: {r: {guess: [0, 1, 0]}, ")
    text = text.replace(", w:", ", r_dot: {guess: [0, 0, 0]}, w:")
    r = simulate(
        lagsim.load(text), method="euler", formulation="drift", duration=0.01,
        step=1e-4, error_bar="never",
    )  # fmt: skip
    p = np.array([r[f"p{k}"] for k in range(4)])
    assert np.max(np.abs(np.linalg.norm(p, axis=0) - 1)) < 1e-14
    assert np.max(np.abs(r["residual_tip.x"])) > 1e-5
    (held,) = (w.text for w in r.warnings if w.code == "constraint-not-held")
    assert "`tip.z`" in held


@pytest.mark.slow
def test_gimbal_lock_is_named_at_the_start_and_on_the_way():
    locked = by_angles("zxz", "a: 0, b: 0, c: 0", [1, 0, 0], 0, tilt="0")
    with refused("no-inertia", "`euler`"):
        lagsim.check(lagsim.load(locked))
    near = lagsim.check(lagsim.load(locked.replace("b: 0", "b: 1e-3")))
    assert [w["code"] for w in near.warnings] == ["coordinate-singularity"]
    assert "`euler`" in near.warnings[0]["text"]
    # The axis of the top passes the vertical, where angles about it are locked.
    upright = by_angles("zxz", "a: 0, b: -pi/2, c: 0", [1, 0, 0], "pi/2", tilt="0")
    assert not lagsim.check(lagsim.load(upright)).warnings
    r = simulate(lagsim.load(upright), duration=0.5)
    (text,) = (w.text for w in r.warnings if w.code == "coordinate-singularity")
    assert "`euler`" in text


# --- A free body: L and T are constant, and the intermediate axis flips

FREE = """
parameters: {J: [1, 2, 3]}
coordinates: {p(0..3): {}, r: {components: xyz}}
frames: {body: {quaternion: [p(0), p(1), p(2), p(3)]}}
definitions:
  w: omega(body)
  L: rotate(body, vec(J.x*w.x, J.y*w.y, J.z*w.z))
bodies: {body: {mass: 2, at: r, frame: body, inertia: J}}
energy: {kinetic: bodies, potential: 0}
initial: {p(0..3): [1, 0, 0, 0], r: [0, 0, 0], r_dot: [1, 2, 3], w: [W]}
simulation: {duration: 50, output_step: 0.1}
"""


@pytest.mark.slow
def test_the_intermediate_axis_flips():
    wx, wy = 1e-2, 1.0
    r = simulate(lagsim.load(FREE.replace("[W]", f"[{wx}, {wy}, 0]")))
    for c, start in zip("xyz", (wx, 2 * wy, 0), strict=True):
        np.testing.assert_allclose(r[f"L.{c}"], start, atol=1e-9)
    np.testing.assert_allclose(r["kinetic"], 14 + wx**2 / 2 + wy**2, rtol=1e-11)
    np.testing.assert_allclose(r["r.y"], 2 * r.t, rtol=1e-12, atol=1e-13)
    # Landau and Lifshitz, Mechanics, section 37, eqs 37.9 to 37.12: w_2 = w_0 sn(s), of
    # period 4 K in s.
    I1, I2, I3 = 1.0, 2.0, 3.0
    E2, M2 = I1 * wx**2 + I2 * wy**2, (I1 * wx) ** 2 + (I2 * wy) ** 2
    if M2 < E2 * I2:
        I1, I3 = I3, I1
    rate = math.sqrt((I3 - I2) * (M2 - E2 * I1) / (I1 * I2 * I3))
    modulus = (I2 - I1) * (E2 * I3 - M2) / ((I3 - I2) * (M2 - E2 * I1))
    period = 4 * ellipk(modulus) / rate
    # It starts at its largest w.y, and is there again with the other sign after half.
    flipped = r.at([period / 2, period])["w.y"]
    np.testing.assert_allclose(flipped, [-wy, wy], atol=1e-8)


def spun(t, w1, w3):
    """Angular velocity (3, k) from (w1, 0, w3) on, J = (1, 2, 3); Landau, eq. 37.10."""
    E2, M2 = w1**2 + 3 * w3**2, w1**2 + 9 * w3**2
    assert M2 > 2 * E2
    rate = math.sqrt((M2 - E2) / 6)
    sn, cn, dn, _ = ellipj(rate * t, (3 * E2 - M2) / (M2 - E2))
    return np.array([w1 * cn, math.sqrt((3 * E2 - M2) / 2) * sn, w3 * dn])


def freely(method, step=None, more=""):
    """Run a free body that tumbles for 20 s; return its w (3, k), and the run."""
    text = FREE.replace("[W]", "[0.6, 0, 0.8]").replace("duration: 50", "duration: 20")
    r = simulate(lagsim.load(text + more), method=method, step=step)
    return np.array([r[f"w.{c}"] for c in "xyz"]), r


@pytest.mark.slow
@pytest.mark.parametrize(
    "method", [pytest.param("dop853", marks=pytest.mark.slow), "taylor"]
)
def test_a_body_that_tumbles(method):
    """By elliptic functions. Only the quaternion's length is held: Gauss's a is q''."""
    w, r = freely(method, more="output: {gauss: true}\n")
    assert r.record["method"] == method
    np.testing.assert_allclose(w, spun(r.t, 0.6, 0.8), atol=1e-10)
    p = np.array([r[f"p.{k}"] for k in range(4)])
    assert np.max(np.abs(np.linalg.norm(p, axis=0) - 1)) < 1e-14
    for k in range(4):
        np.testing.assert_allclose(r[f"gauss.a_p.{k}"], r[f"p_ddot.{k}"], atol=1e-12)
    assert np.max(r["gauss.G"]) < 1e-20


@pytest.mark.slow
def test_a_body_that_tumbles_in_steps():
    """Moreau's time stepping is of order 1, and keeps the length to h^2."""
    errors = []
    for step in (1e-3, 5e-4):
        w, r = freely("moreau", step)
        errors.append(np.max(np.abs(w - spun(r.t, 0.6, 0.8))))
        p = np.array([r[f"p.{k}"] for k in range(4)])
        assert np.max(np.abs(np.linalg.norm(p, axis=0) - 1)) < step**2
    assert errors[0] < 0.02
    assert 1.8 < errors[0] / errors[1] < 2.2


@pytest.mark.slow
def test_a_top_by_a_series():
    series, angles = (
        simulate(lagsim.load(text), method=method)
        for text, method in ((QUATERNION, "taylor"), (ZXZ, "auto"))
    )
    assert series.record["method"] == "taylor"
    for c in "xyz":
        np.testing.assert_allclose(series[f"G.{c}"], angles[f"G.{c}"], atol=1e-9)


@pytest.mark.slow
def test_gauss_of_a_body_on_an_axis():
    """Its w.x is held at 0.6: w.y and w.z go on by Euler's equations, held by a torque.

    G = J_1 (w_1' - a_1)^2/2, where J_1 a_1 = (J_2 - J_3) w_2 w_3.
    """
    held = "constraints: {held: w.x = 0.6}\noutput: {gauss: true}\n"
    w, r = freely("dop853", more=held)
    np.testing.assert_allclose(w[0], 0.6, atol=1e-12)
    np.testing.assert_allclose(r["gauss.G"], (w[1] * w[2]) ** 2 / 2, atol=1e-10)
    assert np.ptp(w[1] * w[2]) > 0.1


@pytest.mark.slow
def test_a_torque_is_a_force_on_the_angular_velocity():
    """Of a body with all six moments, against Euler's equations by scipy."""
    matrix = np.array([[2, 0.1, 0.2], [0.1, 3, -0.3], [0.2, -0.3, 2.5]])
    text = """
parameters: {J: [2, 3, 2.5, 0.1, 0.2, -0.3]}
coordinates: {p0: {}, p1: {}, p2: {}, p3: {}}
frames: {body: {quaternion: [p0, p1, p2, p3]}}
definitions: {w: omega(body)}
energy: {kinetic: 'spin(J, w)', potential: 0}
forces: {w: 'vec(0.5, sin(3*t), -w.z)'}
initial: {p0: 1, p1: 0, p2: 0, p3: 0, w: [0.3, -1, 2]}
simulation: {duration: 3, output_step: 0.1}
"""

    def rates(t, y):
        torque = [0.5, math.sin(3 * t), -y[2]]
        return np.linalg.solve(matrix, torque - np.cross(y, matrix @ y))

    r = simulate(lagsim.load(text))
    t, y0 = r.t, [0.3, -1, 2]
    own = solve_ivp(rates, (0, 3), y0, "DOP853", t, rtol=1e-12, atol=1e-13).y
    for c, values in zip("xyz", own, strict=True):
        np.testing.assert_allclose(r[f"w.{c}"], values, atol=1e-9)
    np.testing.assert_allclose(r["energy"] - r["work"], r["energy"][0], rtol=1e-11)


@pytest.mark.slow
def test_rates_that_are_named_stay():
    text = QUATERNION.replace(START, f"{START}, p1_dot: 0")
    found = lagsim.check(lagsim.load(text))
    assert found.admissible
    text = QUATERNION.replace(START, f"{START}, p2_dot: 0")  # 75 by w.y
    assert not lagsim.check(lagsim.load(text)).admissible


@pytest.mark.parametrize(
    ("energies", "expected"),
    [
        ("{kinetic: bodies, potential: bodies}", []),
        ("{kinetic: bodies, potential: 0}", ["gravity"]),
        ("{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}", ["bodies", "gravity"]),
    ],
)
def test_what_the_energies_do_not_name_has_no_effect(energies, expected):
    text = f"""
coordinates: {{x: {{}}, y: {{}}}}
bodies: {{b: {{mass: 2, at: [x, y]}}}}
gravity: [0, -9.81]
energy: {energies}
initial: {{x: 0, y: 0}}
"""
    warnings = lagsim.check(lagsim.load(text)).warnings
    assert {w["code"] for w in warnings} <= {"no-effect"}
    assert [w["text"].split("`")[1] for w in warnings] == expected
