"""A motion that grows past all numbers ends as such, with any events on its way."""

import numpy as np
import pytest

import lagsim
from tests.support import run

# 100 s^2/2 beyond the dead zone: a frequency of 10, of which these steps are far past
# the bound of each method, so that speeds grow until their squares are no numbers.
TEXT = """
coordinates: {x: {}}
definitions: {s: "x - max(-0.1, min(0.1, x))"}
energy: {kinetic: x_dot^2/2, potential: 100*s^2/2}
initial: {x: 0, x_dot: 1}
simulation: {duration: 500, output_step: 5}
"""


@pytest.mark.parametrize("method", ["euler", "verlet"])
@pytest.mark.parametrize("step", ["0.5", "1"])
def test_a_dead_zone_crossed_by_a_motion_that_diverges(method, step):
    found = run(TEXT, method=method, step=step)
    assert found.trajectory.outcome.word == "failed"
    assert 0.0 < found.trajectory.end < 500.0


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.5, 1.0])
def test_a_step_past_the_bound_that_takes_all_energy_is_warned_of(step):
    """Cut off at the edge, to which its interpolant comes back, no step of rk4 grows.

    It loses energy, until the motion creeps through the zone or switches accumulate.
    """
    found = lagsim.simulate(lagsim.load(TEXT), method="rk4", step=step)
    assert np.ptp(found["energy"]) > 0.4
    codes = {warning.code for warning in found.warnings}
    assert found.outcome == "failed" or "energy-lost" in codes
