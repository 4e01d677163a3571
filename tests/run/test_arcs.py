"""Begins and ends of arcs: breaks in time, `until`, constraints that jump."""

import math

import numpy as np
import pytest

from lagsim.run.trajectory import Outcome
from tests.small_scenes import expected_times, fall, oscillator
from tests.support import run

# Breaks in time


def test_a_pulse_of_a_millisecond_is_met():
    # From rest: x = 0 until the pulse, then the exact response to it.
    pulse = "if(t >= 50 and t < 50.001, 1000, 0)"
    simulation = "duration: 60, output_step: 0.01"
    found = run(oscillator(simulation, x=0, force=pulse))
    t, x = found["t"], found["x"]
    assert np.max(np.abs(x[t < 50.0])) == 0.0
    after = t > 50.001
    exact = 1000.0 * (np.cos(t - 50.001) - np.cos(t - 50.0))
    assert np.max(np.abs(x[after] - exact[after])) < 1e-10
    assert np.max(np.abs(x)) == pytest.approx(1.0, abs=1e-3)
    assert [(e.time, e.kind) for e in found.trajectory.events] == [
        (50.0, "switch"),
        (50.001, "switch"),
    ]
    # Without breaks a step of at most a millisecond would have been needed throughout.
    assert found.trajectory.statistics.evaluations < 3000
    assert list(t) == expected_times(0.0, 60.0, 0.01)


def driven_by_sign(t):
    """Return x of x'' + x = sign(sin t) from rest, by half periods of the drive.

    On [n pi, (n+1) pi]: x = s + A cos t + B sin t, s = (-1)^n; x and x' continue.
    """
    A, B = 0.0, 0.0
    n = int(np.floor(t / np.pi))
    s = 1.0
    A = -1.0
    for k in range(1, n + 1):
        # cos(k pi) = (-1)^k: s_old + A c = s_new + A_new c; the slope keeps B.
        c = (-1.0) ** k
        new = -s
        A += (s - new) * c
        s = new
    return s + A * math.cos(t) + B * math.sin(t)


@pytest.mark.slow
def test_a_forcing_that_changes_sign():
    simulation = "duration: 40, output_step: 0.1"
    found = run(oscillator(simulation, x=0, force="sign(sin(t))"))
    exact = np.array([driven_by_sign(t) for t in found["t"]])
    assert np.max(np.abs(exact)) > 20.0
    # The amplitude reaches 25: errors of 1e-11 of that, over 12 arcs.
    assert np.max(np.abs(found["x"] - exact)) < 1e-9
    times = [e.time for e in found.trajectory.events]
    assert times == pytest.approx([k * math.pi for k in range(1, 13)], rel=1e-15)
    assert found.drift < 1e-9
    # A restart costs a few short steps; stepping over the jumps cost 5 times as much as
    # meeting them (numerics.md), and smooth driving costs about half.
    smooth = run(oscillator(simulation, x=0, force="4/pi*sin(t)"))
    evaluations = found.trajectory.statistics.evaluations
    assert evaluations < 2.5 * smooth.trajectory.statistics.evaluations
    # Those of scipy's DOP853, which locates nothing, are 14,546 over 60 s.
    found = run("failing/square-wave", method="dop853", rtol=1e-10)
    assert found["t"][-1] == 60.0
    assert found.trajectory.statistics.evaluations < 14_546 / 2


@pytest.mark.parametrize("method", ["", ", method: rk4, step: 0.003"])
def test_breaks_and_rows_do_not_disturb_each_other(method):
    simulation = f"duration: 3, output_step: 0.1{method}"
    found = run(oscillator(simulation, x=0, force="floor(4*t)"))
    assert list(found["t"]) == expected_times(0.0, 3.0, 0.1)
    steps = [k / 4 for k in range(1, 12)]
    assert [e.time for e in found.trajectory.events] == steps
    t = found["t"]
    exact = sum(np.where(t > s, 1.0 - np.cos(t - s), 0.0) for s in steps)
    assert np.max(np.abs(found["x"] - exact)) < 1e-10


# Until


@pytest.mark.parametrize("more", ["", ", method: rk4, step: 0.037"])
@pytest.mark.parametrize("until", ["y <= 0", "y = 0", "0 >= y", "-y = 0"])
def test_until_is_located(until, more):
    # Both methods integrate a parabola exactly, so only rounding is left.
    found = run(fall(until, more=more))
    exact = math.sqrt(2.0 * 2.5 / 9.81)
    assert found.trajectory.outcome is Outcome.UNTIL
    assert found.trajectory.end == pytest.approx(exact, rel=0, abs=1e-12)
    assert found["t"][-1] == found.trajectory.end
    assert list(found["t"][:-1]) == [k * 0.1 for k in range(8)]
    assert found["y"][-1] == pytest.approx(0.0, abs=1e-12)
    assert found["y_dot"][-1] == pytest.approx(-9.81 * exact, rel=1e-12)
    event = found.trajectory.events[-1]
    assert (event.kind, event.time) == ("until", found.trajectory.end)
    assert f"`{until}`" in found.trajectory.reason


# Moving constraints whose rate or position jumps


SLIDE = """
parameters: {{v: 3}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: 2*(x_dot^2 + y_dot^2)/2, potential: 0}}
constraints: {{wall: "{wall}"}}
initial: {{x: 0, y: 0, y_dot: 1, x_dot: {x_dot}}}
simulation: {{duration: 2, output_step: 0.5}}
"""


def test_a_constraint_whose_position_jumps_ends_the_run():
    found = run(SLIDE.format(wall="x = if(t < 1, 0, 1)", x_dot=0))
    trajectory = found.trajectory
    assert trajectory.outcome is Outcome.CONSTRAINT_JUMPS
    assert trajectory.outcome.word == "failed"
    assert trajectory.end == 1.0
    assert all(x in trajectory.reason for x in ("`wall`", "t = 1.0 (x = "))
    # What was computed is kept, and ends there.
    assert found["t"][-1] == 1.0
    assert list(found["t"]) == [0.0, 0.5, 1.0]


@pytest.mark.slow
def test_breaks_are_found_as_the_run_goes():
    # Ten million of them: finding all before the run would take minutes.
    text = oscillator("duration: 1000, output_step: 1", x=0, force="floor(1e4*t)")
    found = run(text, most_steps=200)
    assert found.trajectory.outcome is Outcome.TOO_MANY_STEPS
    assert 0.0 < found.trajectory.end < 0.1
