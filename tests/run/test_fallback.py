"""Motions without a Taylor series, with the method `taylor` requested or not."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from lagsim.run.trajectory import Outcome
from tests.support import run

PLANE = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: {m}*(x_dot^2 + y_dot^2)/2, potential: 0}}
forces:
  x: "0.6*({push}) - sqrt(x_dot^2 + y_dot^2)*x_dot"
  y: "0.8*({push}) - sqrt(x_dot^2 + y_dot^2)*y_dot"
initial: {{x: {x}, y: {x}}}
simulation: {{start: {start}, duration: 2, output_step: 0.1, method: {method}}}
"""
LINE = """
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: "1 - sign(x_dot)*abs(x_dot)^{power}"}}
initial: {{x: 3, x_dot: -1}}
simulation: {{duration: 2, output_step: 2, method: {method}}}
"""
METHODS = ["taylor", "auto"]


def took_over(found):
    """Return the times from which on the run continues by dop853."""
    choices = [c.choice for c in found.trajectory.choices]
    return [c for c in choices if c.startswith("method: dop853 from t = ")]


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("x", "m", "start"), [(0, 1, 0), (10, 1e6, 0), (-1e3, 1, 7)])
def test_drag_from_rest_without_a_push(method, x, m, start):
    found = run(PLANE.format(push=0, x=x, m=m, start=start, method=method))
    assert found.trajectory.outcome is Outcome.DONE
    assert np.all(found["x"] == x)
    assert np.all(found["y_dot"] == 0)
    assert took_over(found) == [f"method: dop853 from t = {start} on"]


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("x", "m"), [(0, 1), (50, 4)])
def test_drag_from_rest_under_a_push(method, x, m):
    # m v' = 1 - v^2: v = tanh(t/m), and the way is m ln cosh(t/m).
    found = run(PLANE.format(push=1, x=x, m=m, start=0, method=method))
    way = m * np.log(np.cosh(found["t"] / m))
    assert found["x"] - x == pytest.approx(0.6 * way, abs=1e-9)
    assert found["y_dot"] == pytest.approx(0.8 * np.tanh(found["t"] / m), abs=1e-9)
    assert took_over(found)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("power", [1.5, 2.5, 1.25])
def test_drag_of_a_broken_power_through_a_stop(method, power):
    # dt = dv / (1 - sign(v) |v|^power), dx = v dt, on both sides of the stop.
    found = run(LINE.format(power=power, method=method))

    def time(v):
        return quad(lambda u: 1 / (1 - math.copysign(abs(u) ** power, u)), 0, v)[0]

    v = found["x_dot"][-1]
    assert v > 0
    assert time(v) - time(-1) == pytest.approx(2.0, abs=1e-8)
    sides = (
        quad(lambda u: u / (1 - math.copysign(abs(u) ** power, u)), *ends)[0]
        for ends in ((-1, 0), (0, v))
    )
    assert found["x"][-1] - 3 == pytest.approx(sum(sides), abs=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_a_singularity_ends_the_run_all_the_same(method):
    # x'' = -2/x^2 from 2 at rest is in 0 at pi sqrt(2).
    text = LINE.format(power=2, method=method).replace("x: 3, x_dot: -1", "x: 2")
    found = run(text.replace("1 - sign(x_dot)*abs(x_dot)^2", "-2/x^2"), duration=9)
    assert not found.trajectory.outcome.complete
    assert found["t"][-1] <= math.pi * math.sqrt(2)
