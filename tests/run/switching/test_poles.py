"""Forces that switch at poles of their arguments, with fixed steps and others."""

from math import atan, atanh, pi, sqrt

import pytest

from tests.support import run

SCENE = """
name: pole
parameters: {{c: {far}, m: {m}}}
coordinates: {{q: {{}}}}
energy: {{kinetic: m*q_dot^2/2, potential: 0}}
forces: {{q: "m*{force}"}}
initial: {{q: {q} + c, q_dot: {q_dot}}}
simulation: {{duration: {end}, output_step: 0.2, method: {method}{step}}}
"""
METHODS = ("rk4", "auto", "dopri5", "radau")


def speed(force, method, far=0.0, m=1.0, **other):
    """Return the last velocity; fixed steps are 0.001 long, with few further steps."""
    step = ", step: 0.001" if method == "rk4" else ""
    text = SCENE.format(force=force, method=method, step=step, far=far, m=m, **other)
    found = run(text, most_steps=3000)
    return found["q_dot"][-1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("far", "m"), [(0.0, 1.0), (1000.0, 1e-3)])
def test_a_force_that_ends_at_a_pole_of_tan(method, far, m):
    # From atan(atanh(0.5)) to pi/2 the force is 1.
    force = "if(tanh(tan(q - c)) > 0.5, 1, 0)"
    found = speed(force, method, far, m, q=0.0, q_dot=1.0, end=2.0)
    expected = sqrt(1.0 + 2.0 * (0.5 * pi - atan(atanh(0.5))))
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("far", "m"), [(0.0, 1.0), (1000.0, 1e-3)])
def test_a_force_that_turns_at_a_pole_of_a_reciprocal(method, far, m):
    force = "sign(atan(1/(q - c - 3)))"
    found = speed(force, method, far, m, q=2.0, q_dot=2.0, end=2.0)
    assert found == pytest.approx(sqrt(2.0) + sqrt(2.0), rel=1e-9)


@pytest.mark.parametrize("method", ["dop853", "dopri5", "taylor"])
def test_a_switch_is_reached_past_which_a_force_has_no_value(method):
    # By energy q_dot^2 = 5 - 4 sqrt(q - 1) up to q = 1, where the force is infinite.
    text = SCENE.format(
        force="if(q > 1, -1/sqrt(q - 1), 1)",
        method=method, step="", far=0.0, m=1.0, q=2, q_dot=-1, end=4,
    )  # fmt: skip
    found = run(text)
    reached = (10 * (sqrt(5) - 1) - 2 * (5 * sqrt(5) - 1) / 3) / 8
    left = 4 - reached
    [switch] = [e.time for e in found.trajectory.events]
    # Steps end within 1e-13 of the switch, where q_dot is off by sqrt(1e-13).
    assert switch == pytest.approx(reached, abs=1e-6)
    assert found["q"][-1] == pytest.approx(1 - sqrt(5) * left + left**2 / 2, abs=1e-5)
