"""`until` and switches within a step: dips, touches, and surfaces that oscillate."""

import math

import pytest

from lagsim.run.trajectory import Outcome
from tests.run.looks.scenes import line
from tests.support import run

METHODS = (
    pytest.param("auto", marks=pytest.mark.slow),
    "taylor",
    pytest.param("dop853", marks=pytest.mark.slow),
    pytest.param("radau", marks=pytest.mark.slow),
)
DEPTHS = (1e-2, 1e-5, 1e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("depth", DEPTHS)
def test_until_sees_the_top_of_a_throw(depth, method):
    g, v = 9.81, 5.0
    height = v**2 / (2 * g)
    text = line(
        f"{g}*x", v=v, duration=3, step=3, method=method,
        until=f"x >= {height - depth!r}",
    )  # fmt: skip
    found = run(text)
    assert found.trajectory.outcome is Outcome.UNTIL
    expected = v / g - math.sqrt(2 * depth / g)
    # At a grazing angle a height known to 1e-15 is a time known to its root.
    assert found.trajectory.end == pytest.approx(expected, abs=1e-14 / depth)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("depth", DEPTHS)
def test_until_invents_no_touch(depth, method):
    height = 25 / (2 * 9.81)
    text = line(
        "9.81*x", v=5, duration=3, step=3, method=method,
        until=f"x >= {height + depth!r}",
    )  # fmt: skip
    assert run(text).trajectory.outcome is Outcome.DONE


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("until", ["cos(x) <= -0.9999999", "cos(x) = -0.9999999"])
@pytest.mark.parametrize("duration", [40 * math.pi, 1e4])
def test_until_sees_the_first_of_many_dips(duration, until, method):
    """A free motion, in one step, of which the duration may be a whole period."""
    text = line(v=1, duration=duration, step=duration / 2, method=method, until=until)
    end = run(text).trajectory.end
    assert end == pytest.approx(math.acos(-0.9999999), abs=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_until_counts_once_it_has_been_false(method):
    text = line(v=1, duration=20, step=20, method=method, until="cos(x) >= 0.99")
    end = run(text).trajectory.end
    assert end == pytest.approx(2 * math.pi - math.acos(0.99), abs=1e-9)


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


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("until", "expected"),
    [
        ("exp(-((x - 7)/1e-4)^2/2) >= 0.5", 7 - 1e-4 * math.sqrt(2 * math.log(2))),
        ("x_dot*exp(-((t - 7)/1e-3)^2) >= 0.5", 7 - 1e-3 * math.sqrt(math.log(2))),
        ("tanh(1e4*(x - 3)) - tanh(1e4*(x - 3.1)) >= 1", 3),
    ],
)
def test_until_is_flat_but_for_a_moment(until, expected, method):
    text = line(v=1, duration=20, step=20, method=method, until=until)
    assert run(text).trajectory.end == pytest.approx(expected, abs=1e-9)


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
