"""Motions through configurations in which the constraints lose their independence."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import run

# Cranks of length 1 on pivots 1 apart, and a coupler held to both tips. Collinear at
# a = 0, pi, ...: there the anti-parallelogram branches off, and the rows of the two
# horizontal joints depend on each other.
PARALLELOGRAM = """
coordinates: {{a: {{}}, x: {{}}, y: {{}}, c: {{}}, b: {{}}}}
energy:
  kinetic: (a_dot^2 + b_dot^2 + x_dot^2 + y_dot^2 + c_dot^2/12)/2
  potential: {weight}*y
constraints:
  left_x: x - cos(c)/2 = cos(a)
  left_y: y - sin(c)/2 = sin(a)
  right_x: x + cos(c)/2 = 1 + cos(b)
  right_y: y + sin(c)/2 = sin(b)
initial:
  a: {start}
  b: a
  c: 0
  x: cos(a) + 0.5
  y: sin(a)
  a_dot: 1
  b_dot: 1
  x_dot: -sin(a)
  y_dot: cos(a)
simulation: {{duration: 10, output_step: 0.05}}
"""

# Crank and rod of the same length: at a = pi/2 the slider is over the crank's pivot and
# the row of the guide vanishes.
SLIDER_CRANK = """
coordinates: {{a: {{}}, b: {{}}, x: {{}}}}
energy: {{kinetic: (a_dot^2 + b_dot^2 + x_dot^2)/2, potential: 0}}
constraints:
  along: cos(a) + cos(b) = x
  across: sin(a) + sin(b) = 0
initial:
  a: {start}
  b: -a
  x: 2*cos(a)
  a_dot: 1
  b_dot: -1
  x_dot: -2*sin(a)
simulation: {{duration: 10, output_step: 0.05}}
"""


def rank_losses(result, name):
    return [
        e.time
        for e in result.trajectory.events
        if e.kind == "rank" and e.constraint == name
    ]


@pytest.mark.parametrize("start", ["0.5", "1", "0"])
def test_parallelogram_coasts_through_collinear(start):
    # Without weight both cranks turn evenly: M is constant along this branch.
    result = run(PARALLELOGRAM.format(weight=0, start=start))
    assert result.trajectory.outcome.complete
    turned = float(start) + result["t"]
    # Ten times the tolerance of 1e-11, for an angle that grows to 10.
    assert np.max(np.abs(result["a"] - turned)) < 1e-9
    assert np.max(np.abs(result["b"] - turned)) < 1e-9
    assert np.max(np.abs(result["c"])) < 1e-9
    collinear = np.pi * np.arange(1, 4) - float(start)
    found = rank_losses(result, "left_x")
    for time in collinear[collinear < 10]:
        # Located on a dense output that is right to the tolerance.
        assert min(abs(time - f) for f in found) < 1e-6
    assert all(e.conditioning < 1e-5 for e in result.trajectory.events)
    assert [w.code for w in result.trajectory.warnings].count("rank") == 1


def test_parallelogram_under_weight():
    result = run(PARALLELOGRAM.format(weight=3, start="0.5"))
    assert result.trajectory.outcome.complete
    assert result.drift < 1e-9  # of energies of about 5
    assert np.max(np.abs(result["a"] - result["b"])) < 1e-8  # never the other branch
    # On this branch it is a pendulum: (1/2)(1 + 1 + 1) a'^2 + 3 sin a is constant.
    energy = 1.5 * result["a_dot"] ** 2 + 3 * np.sin(result["a"])
    assert np.max(np.abs(energy - energy[0])) < 1e-8
    assert rank_losses(result, "right_x")


@pytest.mark.parametrize("start", ["0.7", "pi/2"])
def test_slider_crank_through_dead_centre(start):
    result = run(SLIDER_CRANK.format(start=start))
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["a"] + result["b"])) < 1e-8
    # With b = -a and x = 2 cos a: a'^2 (1 + 2 sin(a)^2) is constant.
    speed = result["a_dot"] ** 2 * (1 + 2 * np.sin(result["a"]) ** 2)
    assert np.max(np.abs(speed - speed[0])) < 1e-8
    found = rank_losses(result, "across")
    angles = np.interp(found, result["t"], result["a"])
    # cos(a) = 0 there; rows every 0.05 are interpolated linearly.
    assert np.max(np.abs(np.cos(angles))) < 1e-2
    passed = int(result["a"][-1] / np.pi - 0.5) + (start == "0.7")
    assert len(found) >= passed


def test_nearly_parallel_rows_are_both_held():
    # x = 0 and x + 1e-7 y = 0 leave nothing free: a weight hangs on a tiny angle.
    result = run(
        """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {a: x = 0, b: x + 1e-7*y = 0}
initial: {x: 0, y: 0}
simulation: {duration: 2, output_step: 0.1}
"""
    )
    assert result.trajectory.outcome.complete
    assert np.max(np.abs(result["y"])) < 1e-12
    # lambda_b 1e-7 = 9.81, lambda_a = -lambda_b; half of the digits are left.
    assert result["lambda_b"] == pytest.approx(9.81e7, rel=1e-8)
    assert result["lambda_a"] == pytest.approx(-9.81e7, rel=1e-8)
