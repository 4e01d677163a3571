"""Observed orders of convergence: slopes of log(error) against log(step)."""

import math
from itertools import pairwise

import numpy as np
import pytest

from lagsim.methods import method, names
from tests.methods.test_registry import refusal_of
from tests.methods.test_symplectic import reversed_error
from tests.small_scenes import (
    angle,
    elastic_pendulum,
    held_pendulum,
    pendulum,
    swing,
    swing_rate,
)
from tests.support import run


def slope(steps, errors):
    """Return the slope of the straight line through the points; assert it is one."""
    x, y = np.log(steps), np.log(errors)
    fit = np.polyfit(x, y, 1)
    # Within a factor of 2 of a line: no point is at rounding level or pre-asymptotic.
    assert np.max(np.abs(np.polyval(fit, x) - y)) < math.log(2.0)
    return fit[0]


PENDULUM, HELD = pendulum(2), held_pendulum(2)


# q'' = 8 t^2 q^3 - 2 q^2, which q = 1/(1 + t^2) solves: nonlinear, depends on time, and
# `work` is what the energy gains.
TIMED = """
coordinates: {q: {}}
energy: {kinetic: q_dot^2/2, potential: 2*q^3/3}
forces: {q: 8*t^2*q^3}
initial: {q: 1/(1 + t0^2), q_dot: -2*t0/(1 + t0^2)^2}
"""


def swinging(found, amplitude=2.0):
    """Return the errors of angle and rate."""
    t = found["t"]
    rate = (
        found["a_dot"]
        if "a" in found.system.columns.names
        else found["y_dot"] * found["x"] - found["x_dot"] * found["y"]
    )
    return [angle(found) - swing(t, amplitude), rate - swing_rate(t, amplitude)]


def timed(found):
    t = found["t"]
    q = 1.0 / (1.0 + t * t)
    v = -2.0 * t * q * q
    energy = v * v / 2.0 + 2.0 * q**3 / 3.0
    return [found["q"] - q, found["q_dot"] - v, found["work"] - energy + energy[0]]


# The order is that of impacts; forces between them are those of Verlet's method.
SMOOTH = {"moreau": 2}
SCENES = {"pendulum": (PENDULUM, swinging), "held": (HELD, swinging)}
SCENES["timed"] = (TIMED, timed)
# Steps per unit of time, by order: fine enough for the leading term, above rounding.
COUNTS = {
    1: (400, 800, 1600, 3200),
    2: (20, 40, 80, 160),
    4: (16, 32, 64),
    6: (12, 16, 24, 32),
    8: (6, 8, 10, 12),
}
# Steps from exact values, by order of the dense output; the pendulum's may be longer.
STEPS = {
    1: (0.01, 0.02, 0.04),
    2: (0.01, 0.02, 0.04),
    3: (0.02, 0.04, 0.08),
    6: (0.03, 0.04, 0.05, 0.07),
}
PAIRS = [
    (name, scene)
    for name in names()
    if not method(name).ADAPTIVE
    for scene, (text, _) in SCENES.items()
    if not refusal_of(name, text.replace("t0", "0"))
]


def run_scene(name, scene, start, simulation):
    text = SCENES[scene][0].replace("t0", str(start))
    return run(f"{text}simulation: {{start: {start}, method: {name}, {simulation}}}")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "scene"), PAIRS)
def test_order_of_whole_runs_with_a_fixed_step(name, scene):
    counts = COUNTS[method(name).ORDER]
    errors = []
    for count in counts:
        options = f"duration: 3, output_step: 1/2, step: 1/{count}"
        found = run_scene(name, scene, 0, options)
        errors.append(max(np.max(np.abs(e)) for e in SCENES[scene][1](found)))
    # The next term of the expansion shifts a slope at such steps by a few tenths.
    order = slope([1.0 / n for n in counts], errors)
    expected = SMOOTH.get(name, method(name).ORDER)
    assert order == pytest.approx(expected, abs=0.5)


@pytest.mark.parametrize(("name", "scene"), PAIRS)
def test_order_of_rows_within_a_step(name, scene):
    """One step from exact values: a polynomial of order p is off by h^(p + 1)."""
    steps = [h if scene == "timed" else 5 * h for h in STEPS[method(name).DENSE_ORDER]]
    errors = []
    for h in steps:
        options = f"duration: {h}, output_step: {h}/20, step: {h}"
        found = run_scene(name, scene, 0.3 if scene == "timed" else 0, options)
        assert found.trajectory.statistics.steps == 1
        errors.append(max(np.max(np.abs(e)) for e in SCENES[scene][1](found)))
    # Not below; above where the scene's first terms are small, as they are from rest.
    assert slope(steps, errors) - 1 > method(name).DENSE_ORDER - 0.5


@pytest.mark.slow
@pytest.mark.parametrize("text", [PENDULUM, HELD])
@pytest.mark.parametrize("name", ["dop853", "dopri5", "radau"])
def test_error_follows_the_tolerance(name, text):
    """The order under step control: the error per tolerance is constant."""
    tolerances = [1e-6, 1e-8, 1e-10]
    errors, evaluations = [], []
    for rtol in tolerances:
        options = f"method: {name}, rtol: {rtol}, atol: {rtol}"
        options += ", duration: 4, output_step: 0.1"
        found = run(f"{text}simulation: {{{options}}}")
        errors.append(np.max(np.abs(angle(found) - swing(found["t"], 2.0))))
        evaluations.append(found.trajectory.statistics.evaluations)
    assert all(e < 10 * rtol for e, rtol in zip(errors, tolerances, strict=True))
    # The error of a step goes with h^p, so work with tolerance^(-1/p).
    ratio = 100.0 ** (1.0 / method(name).ORDER)
    for a, b in pairwise(evaluations):
        assert b / a == pytest.approx(ratio, rel=0.25)


@pytest.mark.parametrize(("name", "p"), [("dop853", 7), ("dopri5", 4)])
def test_rows_within_steps_are_polynomials_of_the_order_of_the_dense_output(name, p):
    """x = t^p, however loose the tolerance; its rate is p t^(p-1)."""
    found = run(f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: {p * (p - 1)}*t^{p - 2}}}
initial: {{x: 0}}
simulation: {{duration: 1, output_step: 1/64, method: {name}, rtol: 1e-2}}
""")
    t = found["t"]
    assert found.trajectory.statistics.steps < 32
    assert np.max(np.abs(found["x"] - t**p)) < 1e-14
    assert np.max(np.abs(found["x_dot"] - p * t ** (p - 1))) < 1e-13


FREE = elastic_pendulum("theta: 1, u: 0", "duration: 5")
CURVE = FREE.replace("initial:", 'constraints: {path: "u = l - l*theta^2"}\ninitial:')
STEERED = FREE.replace(
    "initial: {theta: 1, u: 0}",
    "constraints: {blade: u_dot*cos(theta + 5*u) = l*theta_dot*sin(theta + 5*u)}\n"
    "initial: {theta: 0.2, u: 0.5, theta_dot: 1, u_dot: {guess: 0}}",
)


@pytest.mark.slow
@pytest.mark.parametrize("text", [FREE, CURVE, STEERED])
@pytest.mark.parametrize(
    ("options", "off"),
    [
        # Errors of the two halves add up, enlarged by the motion to less than 1000.
        ({}, 1e-8),
        # 1 ms, order 4: (0.001*5.06 rad/s)^4 = 7e-10 a radian, 25 radians, and back.
        ({"method": "rk4", "step": "0.001"}, 1e-7),
    ],
)
def test_time_reversal_brings_the_state_back(text, options, off):
    assert reversed_error(text, **options) < off
