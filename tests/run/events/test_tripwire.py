"""A contact that closes, and an impact, has a gap within its slack, or the run ends.

The mechanism is made wrong on purpose, beside an oscillator of 50 kJ, in whose energy
what the box gains is rounding: what no alarm sees may not go on for a row.
"""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.model.reader import read
from lagsim.run.events.kinematics import Kinematics
from lagsim.run.trajectory import Outcome
from tests.run.events.test_dropped_boxes import box
from tests.support import run

BALLS = """
name: balls
parameters: {{M: 1e5}}
coordinates: {{y: {{}}, w: {{}}, z: {{}}}}
energy:
  kinetic: (y_dot^2 + w_dot^2 + M*z_dot^2)/2
  potential: 9.81*(y + w) + M*z^2/2
constraints:
  low: {{relation: y >= {ground}, restitution: 0.5}}
  high: {{relation: w >= {ground}, restitution: 0.5}}
initial: {{y: {ground} + 1, w: {ground} + 1.0 + {higher}, z: 1}}
simulation: {{start: {start}, duration: 2, output_step: 0.01}}
"""
FALL = np.sqrt(2.0 / 9.81)


def balls(higher, ground=0.0, start=0.0):
    return read(BALLS.format(higher=higher, ground=ground, start=start), "balls.yaml")


@pytest.mark.parametrize("k", [24, 55])  # another corner is 0.4 mm up there
def test_a_corner_in_flight_that_is_closed_with_others_ends_the_run(monkeypatch, k):
    scene = read(box(k), "box.yaml", options={"rtol": "1e-10"})
    right = run(scene)
    assert right.trajectory.outcome.complete
    all_closed = Kinematics.is_closed
    monkeypatch.setattr(
        Kinematics, "is_closed",
        lambda here, also=(): [True] * 4 if also else all_closed(here, also),
    )  # fmt: skip
    found = run(scene)
    assert found.trajectory.outcome is Outcome.CONSTRAINT_JUMPS
    assert found.trajectory.outcome.failure["code"] == "constraint-jumps"
    count = len(found.rows)  # what has been written is the motion
    np.testing.assert_allclose(found["y"], right["y"][:count], atol=1e-6)


@pytest.mark.parametrize("higher", [1e-8, 1e-3, 0.3])
@pytest.mark.parametrize(("ground", "start"), [(0.0, 0.0), (5.0, 0.0), (0.0, 1e3)])
def test_a_ball_in_flight_that_strikes_ends_the_run(monkeypatch, higher, ground, start):
    """The second ball, which is higher by that, is struck with the first."""
    all_closed = Kinematics.is_closed
    monkeypatch.setattr(
        Kinematics, "is_closed",
        lambda here, also=(): [True, True] if also else all_closed(here, also),
    )  # fmt: skip
    found = run(balls(higher, ground, start))
    assert found.trajectory.outcome is Outcome.CONSTRAINT_JUMPS
    assert found.trajectory.end - start == pytest.approx(FALL, abs=1e-7)
    assert np.min(found["w"]) > ground + 0.9 * higher


def test_balls_that_strike_at_once_go_on():
    found = run(balls(0.0))
    assert found.trajectory.outcome is Outcome.DONE
    np.testing.assert_allclose(found["y"], found["w"], atol=1e-9)
