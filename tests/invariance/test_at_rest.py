"""Finite motions whose components rest, or are no larger than rounding, go through."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.support import run

METHODS = ["auto", "dop853"]


def pushed(force, x=0.0, duration=3.0):
    return f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: "{force}"}}
initial: {{x: {x!r}, x_dot: 0}}
simulation: {{duration: {duration!r}, output_step: 0.1}}
"""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "steepness", [pytest.param(20, marks=pytest.mark.slow), 100, 1000]
)
def test_a_ramp_on_a_body_at_rest(steepness, method):
    # Before the ramp its two terms cancel, and leave steps of rounding.
    k = float(steepness)
    result = run(pushed(f"1 + tanh({steepness}*(t - 1))"), method=method)

    def velocity(t):
        return t + (math.log(math.cosh(k * (t - 1))) - math.log(math.cosh(k))) / k

    if steepness < 500:
        expected = [velocity(t) for t in result["t"]]
    else:  # cosh would overflow: of log cosh u, |u| - log 2 is left
        expected = [max(0.0, 2.0 * (t - 1.0)) for t in result["t"]]
    # The soft ramp begins at 2 exp(-40); at t = 1 the steep one is off by log(2)/k.
    off = np.abs(result["x_dot"] - expected)
    assert result.trajectory.outcome.complete
    beside = np.abs(result["t"] - 1.0) > 0.05
    assert np.max(off[beside]) < 1e-10
    assert result.trajectory.statistics.steps < 1000


@pytest.mark.slow
def test_a_ramp_reaches_what_is_joined_to_its_body():
    text = """
coordinates: {c: {}, a: {}}
energy:
  kinetic: "c_dot^2 + (c_dot^2 + 2*c_dot*a_dot*cos(a) + a_dot^2)/2"
  potential: "-9.81*cos(a)"
forces: {c: "1 + tanh(50*(t - 2))"}
initial: {c: 0, a: 0, c_dot: 0, a_dot: 0}
simulation: {duration: 4, output_step: 0.1}
"""

    def rates(t, s):
        _, a, v, w = s
        mass = [[3.0, math.cos(a)], [math.cos(a), 1.0]]
        push = 1.0 + math.tanh(50.0 * (t - 2.0))
        force = [push + w * w * math.sin(a), -9.81 * math.sin(a)]
        return [v, w, *np.linalg.solve(mass, force)]

    expected = solve_ivp(
        rates, (0.0, 4.0), [0.0] * 4, method="DOP853", rtol=1e-12, atol=1e-14,
        max_step=0.01,
    ).y[:, -1]  # fmt: skip
    for method in METHODS:
        result = run(text, method=method)
        assert result.trajectory.outcome.complete
        found = [result["c"][-1], result["a"][-1]]
        assert np.max(np.abs(found - expected[:2])) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_force_that_is_nothing_but_rounding(method):
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y^2/2}
forces: {x: "1 - sin(5*t + y)^2 - cos(5*t + y)^2"}
initial: {x: 0, y: START, x_dot: 0, y_dot: 0}
simulation: {duration: 10, output_step: 0.1}
"""
    drifts = []
    for start in np.linspace(0.9, 1.1, 7):
        result = run(text.replace("START", repr(float(start))), method=method)
        assert result.trajectory.outcome.complete
        assert np.max(np.abs(result["y"] - start * np.cos(result["t"]))) < 1e-11
        assert result.trajectory.statistics.steps < 200
        drifts.append(np.max(np.abs(result["x"])))
    # What a constant force of 128 units of roundoff would do, the least that is
    # controlled of terms of size 1. The last digits of one start are dice.
    assert np.median(drifts) < 0.5 * 10.0**2 * 128.0 * 2.0**-53


@pytest.mark.parametrize("method", METHODS)
def test_a_potential_that_is_nothing_but_rounding(method):
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: "1e6*(1 - sin(x)^2 - cos(x)^2)"}
initial: {x: 0.3, x_dot: 0}
simulation: {duration: 10, output_step: 0.1}
"""
    result = run(text, method=method)
    assert result.trajectory.outcome.complete
    # 1e6 times a unit of roundoff as force.
    assert np.max(np.abs(result["x"] - 0.3)) < 0.5 * 10.0**2 * 1e6 * 2.0**-52
    assert result.trajectory.statistics.steps < 200


@pytest.mark.parametrize("size", [1e-280, 1e-310, 5e-324])
def test_components_of_any_size(size):
    text = f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: x^2/2 + 2*y^2}}
initial: {{x: 1, x_dot: 0, y: {size!r}, y_dot: 0}}
simulation: {{duration: 10, output_step: 0.1, method: dop853}}
"""
    result = run(text)
    assert np.max(np.abs(result["x"] - np.cos(result["t"]))) < 1e-11
    # The least doubles have few digits: so many of the smallest steps between two.
    off = np.abs(result["y"] - size * np.cos(2.0 * result["t"]))
    assert np.max(off) <= 1e-10 * size + 64 * 5e-324
    assert result.trajectory.statistics.steps < 200


def test_growth_from_the_least_numbers():
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: -x^2/2}
initial: {x: 1e-300, x_dot: 1e-300}
simulation: {duration: 100, output_step: 1, method: dop853}
"""
    result = run(text)
    assert result["x"] == pytest.approx(1e-300 * np.exp(result["t"]), rel=1e-10)


@pytest.mark.parametrize("power", ["hypot(x, y)^3", "sqrt(x^2 + y^2)^3"])
def test_a_power_of_a_root_at_zero(power):
    text = f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: "{power}/3"}}
initial: {{x: 0, y: 0, x_dot: 0, y_dot: 1}}
simulation: {{duration: 5, output_step: 0.1, method: dop853}}
"""
    result = run(text)
    assert result.trajectory.outcome.complete
    assert np.all(result["x"] == 0.0)
    assert result.drift < 1e-10
    expected = solve_ivp(
        lambda _t, s: [s[1], -s[0] * abs(s[0])], (0.0, 5.0), [0.0, 1.0],
        method="DOP853", rtol=1e-12, atol=1e-14, t_eval=result["t"],
    ).y[0]  # fmt: skip
    assert np.max(np.abs(result["y"] - expected)) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("angle", [1e-3, 1e-5])
def test_close_to_the_pole_of_a_spherical_pendulum(angle):
    text = f"""
coordinates: {{theta: {{}}, phi: {{}}}}
energy:
  kinetic: "(theta_dot^2 + sin(theta)^2*phi_dot^2)/2"
  potential: "-9.81*cos(theta)"
initial: {{theta: {angle!r}, phi: 0, theta_dot: 1, phi_dot: 1}}
simulation: {{duration: 10, output_step: 0.1}}
"""
    result = run(text)
    assert result.trajectory.outcome.complete
    # Of an energy of 10; the lever arm falls to 1e-10, where doubles have few digits.
    assert result.drift < 1e-5


# A cart that a law holds at 0 while links hang from it: what M couples it with cancels.
HELD_CART = """
parameters: {{m(1..3): [0.683, 0.969, 1.052], L: {0!r}, l: 0.375*L, g: 9.81*L}}
coordinates: {{x: {{}}, q(1..3): {{}}}}
definitions:
  a(0): 0
  a(i = 1..3): a(i-1) + q(i)
  p(0): vec(x, 0)
  p(i = 1..3): p(i-1) + l*vec(sin(a(i)), -cos(a(i)))
gravity: [0, -g]
bodies: {{bob(i = 1..3): {{mass: m(i), at: p(i)}}}}
energy: {{kinetic: bodies + 3.654*x_dot^2/2, potential: bodies + 3.15*x^2}}
forces: {{x: 1.78*L*sin(2.69*t)}}
constraints: {{hold: {{relation: x = 0{1}}}}}
initial:
  x: 0
  x_dot: 0
  q(1..3): [0.01, 0.819, 0.174]
  q_dot(1..3): [0.56, -0.255, -0.002]
simulation: {{duration: 0.3, output_step: 0.1, method: dop853}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
def test_what_a_law_holds_at_0_against_links(unit):
    always, at_times = (
        run(HELD_CART.format(unit, when)) for when in ("", ", when: t < 1")
    )
    assert at_times["q.3"] == pytest.approx(always["q.3"], abs=1e-9)
    steps = [x.trajectory.statistics.steps for x in (always, at_times)]
    assert abs(steps[1] - steps[0]) <= 0.1 * steps[0]
