"""Rows and runs that last thousands of oscillations."""

import pytest

import lagsim

OSCILLATOR = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2/2}
initial: {x: 1, x_dot: V}
simulation: {duration: 1e5, output_step: 5e4, method: radau, rtol: 1e-5}
"""


@pytest.mark.parametrize("v", [0, 1])
def test_an_implicit_method_follows_an_oscillation_from_the_first_step_on(v):
    # One step of all 8,000 oscillations was accepted, after which no energy is left.
    model = lagsim.load(OSCILLATOR.replace("V", str(v)))
    found = lagsim.simulate(model, error_bar="never")
    assert found.complete
    assert found["energy"] == pytest.approx((1 + v) / 2, rel=0.05)


BUMP = """
coordinates: {q: {}, w: {}}
energy: {kinetic: q_dot^2/2 + w_dot^2/2, potential: 0}
forces: {w: "max(0, 1 - abs(q - 3))^1.5"}
initial: {q: 0, q_dot: 1, w: 0}
simulation: {duration: 6, output_step: 0.5, method: radau}
"""


def test_a_force_that_begins_at_0_is_no_oscillation():
    # Relative to a displacement of 0 but for rounding its change is without bound.
    found = lagsim.simulate(lagsim.load(BUMP), error_bar="never")
    assert found["w_dot"][-1] == pytest.approx(0.8, abs=1e-7)  # rtol 1e-9
