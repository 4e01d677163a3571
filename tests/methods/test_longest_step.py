"""Steps that are forced to be short, and the ranges that they show."""

import math

import pytest

from tests.support import run

SPRING = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 2*pi^2*x^2}
initial: {x: 0, x_dot: 2*pi}
simulation: {duration: 6, output_step: 2, rtol: 1e-8}
"""


def forced(method, longest):
    found = run(SPRING, method=method)
    return found.trajectory, found.session._replace(longest_step=longest).run([])


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_no_step_is_longer(method):
    plain, again = forced(method, 0.004)
    assert again.statistics.steps >= 1500 > plain.statistics.steps
    assert again.statistics.steps < 1650  # the first ones grow
    # All rows are zeros of x: the steps alone have seen its range.
    low, high = again.extents["x"]
    assert low == pytest.approx(-1, abs=1e-3)
    assert high == pytest.approx(1, abs=1e-3)


def test_steps_that_are_short_by_themselves_stay():
    plain, again = forced("dop853", 10.0)
    assert again.statistics.steps == plain.statistics.steps
    assert math.isfinite(again.extents["x_dot"][1])
