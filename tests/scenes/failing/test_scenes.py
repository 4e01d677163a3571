"""Scenes where methods fail: by how much; and that the chosen method does not."""

import math

import numpy as np
import pytest

import lagsim
from lagsim.model.reader import read_file
from lagsim.run.observers.monitors import ResidualMonitor
from tests.support import MODELS, run


def changed(name, **values):
    """Return a failing model with other values of its parameters."""
    sets = {key: repr(value) for key, value in values.items()}
    return read_file(str(MODELS / "failing" / f"{name}.yaml"), sets)


def rows_of(found, *names):
    return np.column_stack([found[name] for name in names])


# Coordinates near their singularity


@pytest.mark.slow
def test_a_narrow_miss_of_the_pole_costs_evaluations():
    costs = []
    for miss in (1e-1, 1e-3, 1e-5, 1e-7):
        found = run(changed("polar-miss", miss=miss), method="dop853", rtol=1e-9)
        costs.append(found.trajectory.statistics.evaluations)
        t = found["t"]
        expected = np.column_stack([np.cos(t), miss * np.sin(t)])
        # Errors of 1e-9 for each of six passages, over the last miss.
        assert np.max(np.abs(rows_of(found, "x", "y") - expected)) < 1e-6
    # Measured: 5,779, 9,586, 12,488, 13,474: with the logarithm, until the tolerance of
    # the angle no longer sees the passage.
    assert costs == sorted(costs)
    assert costs[-1] > 2 * costs[0]


@pytest.mark.slow
def test_a_spherical_pendulum_near_its_pole_costs_evaluations():
    costs = []
    for push in (1e-1, 1e-4, 1e-7):
        found = run(changed("gimbal", push=push), method="dop853", rtol=1e-9)
        costs.append(found.trajectory.statistics.evaluations)
        momentum = push * math.sin(1.0) ** 2
        # Six passages, at each of which phi and its rate have no digits to spare.
        assert found["momentum"] == pytest.approx(momentum, abs=1e-6)
        assert np.max(found["theta"]) < 1.0 + 1e-6
    assert costs == sorted(costs)
    assert costs[-1] > 1.5 * costs[0]


def test_cartesian_coordinates_pass_the_pole():
    plane = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: (x^2 + y^2)/2}
initial: {x: 1, y: 0, y_dot: 1e-5}
simulation: {duration: 20}
"""
    cartesian = run(plane, method="dop853", rtol=1e-9).trajectory.statistics
    polar = run("failing/polar-miss", method="dop853", rtol=1e-9).trajectory
    assert cartesian.evaluations < 0.3 * polar.statistics.evaluations
    # x = cos t is 0 at the time that the warning names.
    assert abs(np.cos(float(polar.warnings[0].text.split()[3]))) < 1e-4


# Steps


@pytest.mark.slow
def test_steps_do_not_swing_about_the_stability_bound():
    found = run("failing/relaxation", method="dop853", rtol=1e-6, duration=5)
    counts = found.trajectory.statistics
    # Measured: 1.5 % with PI control, 4.3 % without.
    assert counts.rejections < 0.025 * counts.steps


def test_a_stiff_method_is_not_held_by_stability():
    options = {"rtol": 1e-6, "duration": 5}
    held = run("failing/relaxation", method="dop853", **options)
    free = run("failing/relaxation", method="radau", **options)
    counts = [x.trajectory.statistics.evaluations for x in (held, free)]
    assert counts[0] > 10 * counts[1]
    # Both follow sin(x)/2 as far as the damper lets them: y' 2c/k = 2e-4 y' behind.
    for found in (held, free):
        assert np.max(np.abs(found["y"] - 0.5 * np.sin(found["x"]))) < 2e-4


@pytest.mark.slow
def test_the_rounding_of_a_stiff_force_shortens_no_steps():
    # K = 1e8 makes 5e-9 of the last place of y: more than Newton's method is to leave.
    loose, tight = (
        run("failing/relaxation", method="radau", rtol=rtol, duration=2)
        for rtol in (1e-9, 1e-12)
    )
    few, many = (x.trajectory.statistics.steps for x in (loose, tight))
    # Steps go with the power 4/5 of the tolerance, of an error that has the power 4 of
    # them, or 3 where the order is reduced; 25 times as many where rounding counts.
    assert many < 2 * 1000 ** (0.8 / 3) * few
    exact = run("failing/relaxation", method="taylor", rtol=1e-13, duration=2)
    assert np.max(np.abs(tight["x"] - exact["x"])) < 1e-12


EXCITED = """
parameters: {K: 1e8, l: 1, g: 9.8}
coordinates: {theta: {}, u: {}}
definitions: {fast: u_dot^2/2 + K*(u - (g*cos(theta) + theta_dot^2)/K)^2/2}
energy:
  kinetic: ((l + u)*theta_dot)^2/2 + u_dot^2/2
  potential: g*(l - (l + u)*cos(theta)) + K*u^2/2
initial: {theta: 1, u: 1e-4}
output: {columns: [fast]}
simulation: {duration: 1, output_step: 0.05}
"""


@pytest.mark.slow
def test_radau_damps_a_fast_mode_silently_at_loose_tolerance():
    found = run(EXCITED, method="radau", rtol=1e-2, duration=3)
    assert found.trajectory.outcome.word == "done"
    # An oscillation of 1e-4 of the length is below the tolerance.
    assert found["fast"][-1] < 0.03 * found["fast"][0]
    # The slow motion is right nevertheless.
    exact = run(EXCITED, method="dop853", rtol=1e-9, duration=3)
    assert np.max(np.abs(found["theta"] - exact["theta"])) < 1e-2
    assert exact["fast"][-1] == pytest.approx(exact["fast"][0], rel=0.05)
    tight = run(EXCITED, method="radau", rtol=1e-7, duration=0.05, output_step=0.01)
    assert tight["fast"][-1] == pytest.approx(tight["fast"][0], rel=0.05)


# Constraints


def test_a_duplicated_row_shares_its_force():
    found = run("failing/duplicate-row")
    # g/2 along each axis on a slope of 45 degrees, and the force (g/2, g/2): the line
    # x + y = 0 with lambda g/2 alone, or l1 + 2 l2 = g/2 with the least l1^2 + l2^2.
    g = 9.81
    assert found["x_ddot"] == pytest.approx(g / 2, rel=1e-13)
    assert found["lambda_line"] == pytest.approx(g / 10, rel=1e-13)
    assert found["lambda_twice"] == pytest.approx(g / 5, rel=1e-13)
    for force in ("Qc_x", "Qc_y"):
        assert found[force] == pytest.approx(g / 2, rel=1e-14)


def test_a_contradictory_row_is_refused():
    found = lagsim.check(lagsim.load(MODELS / "failing/duplicate-row.yaml", gap=0.1))
    assert not found.admissible
    assert not found.repair


@pytest.mark.slow
def test_multipliers_grow_where_forces_do_not():
    found = run("failing/parallelogram")
    a, lam = found["a"], found["lambda_left_x"]
    near = np.abs(np.sin(a)) < 0.3
    grown = np.abs(lam * np.sin(a))
    # lambda ~ 1/angle; the forces on the cranks, which are weights, are not.
    assert np.max(np.abs(lam[near])) > 20.0
    assert np.max(grown[near]) < 3.0
    assert (
        np.max(
            np.abs(1.5 * found["a_dot"] ** 2 + 5 * np.sin(a) - 1.5 - 5 * np.sin(0.5))
        )
        < 1e-7
    )
    for force in ("Qc_a", "Qc_b", "Qc_y"):
        assert np.max(np.abs(found[force])) < 10.0
    assert np.max(np.abs(found["b"] - a)) < 1e-8


def test_a_coordinate_without_inertia():
    found = run("failing/massless", method="dop853")
    # m x'' = -k s/2, s = x/2: angular frequency 2.
    assert found["x"] == pytest.approx(np.cos(2.0 * found["t"]), abs=1e-9)
    assert found["s"] == pytest.approx(0.5 * np.cos(2.0 * found["t"]), abs=1e-9)
    assert found["Qc_x"] == pytest.approx(-4.0 * found["x"], abs=1e-8)


@pytest.mark.slow
def test_a_nonlinear_velocity_constraint_does_work():
    found = run("failing/constant-speed")
    # psi' = -(g/c) cos(psi): the Gudermannian.
    expected = -2.0 * np.arctan(np.tanh(9.8 / 9.0 * found["t"]))
    assert found["psi"] == pytest.approx(expected, abs=1e-10)
    # The speed is kept, so that all height is paid for: by the constraint.
    assert np.ptp(found["kinetic"]) < 1e-12
    assert found["energy"][-1] - found["energy"][0] < -20.0
    residuals = ResidualMonitor(found.system.columns.names)
    residuals.add(found.rows)
    assert residuals.drift.size < 1e-11


# Contact


def impacts(found):
    return [e.time for e in found.trajectory.events if e.kind == "impact"]


@pytest.mark.parametrize("depth", [1e-4, 1e-8, -1e-8])
def test_a_graze_is_found_by_the_rate_of_the_gap(depth):
    found = run(changed("graze", depth=depth))
    if depth < 0.0:  # it passes beside the post
        assert impacts(found) == []
        assert found["y_dot"] == pytest.approx(0.0, abs=1e-15)
        return
    # cos(a) = 1 - depth where it touches; it is thrown off by 2 a. Rounding of the
    # place, 1e-16, is 1e-16/depth of the depth and half of that of the angle.
    a = 2 * math.asin(math.sqrt(depth / 2))
    within = 1e-15 / depth + 1e-11
    [met] = impacts(found)
    assert met == pytest.approx(10.0 - math.sin(a), abs=math.sin(a) * within + 1e-14)
    assert found["y_dot"][-1] == pytest.approx(math.sin(2 * a), rel=within)
    assert found["x_dot"][-1] == pytest.approx(math.cos(2 * a), rel=1e-14)
    assert np.min(found["residual_post"]) > -1e-12


ROW = {
    # Newton's law on every gap that closes or touches, and the sum of m v:
    "three at once": ({}, [-1 / 3, 2 / 3, 2 / 3], 2),
    "1, 2, 1 at once": ({"m2": 2, "gap": 1, "v3": -1}, [-1, 0, 1], 2),
    # Pair by pair: each keeps its sum of m v and turns its difference of v.
    "three one by one": ({"gap": 1e-6}, [0, 0, 1], 2),
    "1, 2, 1 one by one": (
        {"m2": 2, "gap": 1 + 1e-6, "v3": -1}, [-13 / 27, -10 / 27, 33 / 27], 3
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROW)
def test_balls_in_a_row_go_by_the_order_of_impacts(name):
    values, speeds, count = ROW[name]
    found = run(changed("balls-in-a-row", **values))
    got = [found[f"{x}_dot"][-1] for x in ("x1", "x2", "x3")]
    assert got == pytest.approx(speeds, abs=1e-12)
    assert len(impacts(found)) == count
    # The energy does not tell which is right: all keep it.
    assert np.ptp(found["energy"]) < 1e-12
    codes = [w.code for w in found.trajectory.warnings]
    assert codes.count("impact-order") == name.endswith("at once")
