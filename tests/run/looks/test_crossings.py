"""`until` and switches within a step: dips, touches, and surfaces that oscillate."""

import math

import pytest

from lagsim.run.trajectory import Outcome
from tests.run.looks.scenes import METHODS, line
from tests.support import run

DEPTHS = (1e-2, 1e-5, 1e-8)
TOP = 25 / (2 * 9.81)
THROW = {"potential": "9.81*x", "v": 5, "duration": 3, "step": 3}
# A free motion in one step, of which the duration may be a whole period.
FREE = {"v": 1, "duration": 20, "step": 20}
SWING = {"potential": "x^2/2", "x": 1, "duration": 20}
FALL = {"potential": "9.81*x", "x": 2.5, "duration": 5}
# Both crossings of a ball that rises 1e-3 above the level lie within one step.
UP = math.sqrt(2 * 9.81 * 1.001)
LOW, SEEN = -0.9999999, math.sqrt(math.log(2))
# `until`, when it is met, None where never, and how well that is known.
UNTIL = [
    # At a grazing angle a height known to 1e-15 is a time known to its root.
    *((f"x >= {TOP - d!r}", 5 / 9.81 - math.sqrt(2 * d / 9.81), 1e-14 / d, THROW)
      for d in DEPTHS),
    *((f"x >= {TOP + d!r}", None, 0, THROW) for d in DEPTHS),
    # At rtol 1e-11 the dense output is right to a few times that.
    ("x <= -0.25", math.acos(-0.25), 1e-10, SWING),
    ("x >= 10", None, 0, FALL),
    # True at the start it counts once it has been false: thrown up from the ground.
    *((f"x {sign} 0", 2, 1e-12, FALL | {"x": 0, "v": 9.81}) for sign in ("<=", "=")),
    # It holds from below the ground all the way: for ever true, never an event.
    ("x <= 0", None, 0, FALL | {"x": -1}),
    # x >= 0 at the start; false at pi/2, and true again at 3/2 pi: not met leaving it.
    ("x >= 0", 1.5 * math.pi, 1e-10, SWING),
    # An equation is met from either side.
    ("x = 0", 0.5 * math.pi, 1e-10, SWING),
    # The speed is 0.14 at the crossing: 1e-15 of x is 1e-14 of t.
    ("x >= 1", (UP - math.sqrt(UP * UP - 2 * 9.81)) / 9.81, 1e-12,
     FALL | {"x": 0, "v": UP}),
    # The first of many dips.
    *((f"cos(x) {sign} {LOW}", math.acos(LOW), 1e-8,
       FREE | {"duration": T, "step": T / 2})
      for sign in ("<=", "=") for T in (40 * math.pi, 1e4)),
    # It counts once it has been false.
    ("cos(x) >= 0.99", 2 * math.pi - math.acos(0.99), 1e-9, FREE),
    # It is flat but for a moment.
    ("exp(-((x - 7)/1e-4)^2/2) >= 0.5", 7 - 1e-4 * math.sqrt(2) * SEEN, 1e-9, FREE),
    ("x_dot*exp(-((t - 7)/1e-3)^2) >= 0.5", 7 - 1e-3 * SEEN, 1e-9, FREE),
    ("tanh(1e4*(x - 3)) - tanh(1e4*(x - 3.1)) >= 1", 3, 1e-9, FREE),
]  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("until", "time", "off", "motion"), UNTIL)
def test_when_until_is_met(until, time, off, motion, method):
    found = run(line(**motion, method=method, until=until)).trajectory
    assert found.outcome is (Outcome.DONE if time is None else Outcome.UNTIL)
    if time is None:
        assert not found.events
    else:
        assert found.end == pytest.approx(time, abs=off)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("fast", [30, 1e3])
def test_each_switch_of_an_oscillating_surface_is_met(fast, method):
    text = line(
        force=f"1e-6*sign(sin({fast}*x))", v=1, duration=2, step=2, method=method
    )
    found = run(text)
    assert len(found.trajectory.events) == int(fast * 2 / math.pi)
    # Up and down in turn, the speed varies by 1e-6 times the time of one.
    assert found["x_dot"][-1] == pytest.approx(1, abs=2e-6 * math.pi / fast)


@pytest.mark.parametrize("method", METHODS)
def test_a_surface_that_moves_fast(method):
    """The body meets a door that swings: as often as their paths cross."""
    w, size = 1e3, 0.01
    text = line(
        force=f"1e-9*sign(x - 0.5 - {size}*sin({w}*t))", v=1, duration=1, step=1,
        method=method,
    )  # fmt: skip
    crossings = 0
    above = False
    for k in range(1, 200_001):
        t = 0.4 + 0.2 * k / 200_000
        now = t > 0.5 + size * math.sin(w * t)
        crossings += now != above
        above = now
    assert len(run(text).trajectory.events) == crossings


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("depth", DEPTHS)
def test_a_switch_is_grazed(depth, method):
    """At the top of an oscillation the surface is passed, twice, or is not."""
    for level, count in ((1 - depth, 2), (1 + depth, 0)):
        text = line(
            "x^2/2", force=f"1e-12*sign(x - {level!r})", v=1, duration=3, step=3,
            method=method,
        )  # fmt: skip
        events = run(text).trajectory.events
        assert len(events) == count
        if count:
            times = [event.time for event in events]
            half = math.acos(level)
            expected = [math.pi / 2 - half, math.pi / 2 + half]
            assert times == pytest.approx(expected, abs=1e-11 / half)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_narrow_windows_of_a_force(method):
    """A force of 1 while cos(w x) > 0.99: energy gained in each window passed."""
    text = line(
        force="if(cos(200*x) > 0.99, 1, 0)", x=0.01, v=1, duration=1, step=1,
        method=method,
    )  # fmt: skip
    found = run(text)
    half = math.acos(0.99) / 200
    passed = int((found["x"][-1] + half) / (math.pi / 100))
    expected = math.sqrt(1 + 2 * passed * 2 * half)
    assert found["x_dot"][-1] == pytest.approx(expected, abs=1e-9)
    assert len(found.trajectory.events) == 2 * passed


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_switch_is_flat_but_for_a_moment(method):
    text = line(
        force="if(exp(-((x - 7)/1e-3)^2/2) > 0.5, 100, 0)", v=1, duration=20, step=20,
        method=method,
    )  # fmt: skip
    gained = 100 * 2 * 1e-3 * math.sqrt(2 * math.log(2))
    end = run(text)["x_dot"][-1]
    assert end == pytest.approx(math.sqrt(1 + 2 * gained), abs=1e-9)
