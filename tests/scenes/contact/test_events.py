"""Impacts where they are easily missed, invented, or met together with something."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.scenes.contact import scenes
from tests.scenes.contact.motions import GLOBAL, G, close, contact, play, scene, tried
from tests.small_scenes import expected_times

DEPTH = 1e-8


def grazed(e, depth):
    """Return the motion of sin(t) under a ceiling at 1 - depth."""
    text = scenes.oscillator(
        f"x <= 1 - {depth}", e, 0, 1, duration=2.5, output_step=0.1
    )  # fmt: skip
    return play(text)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_graze_of_depth_1e_8_is_found(e):
    found, t = grazed(e, DEPTH), math.asin(1 - DEPTH)
    v = math.sqrt(2 * DEPTH - DEPTH**2)
    # A place known to 1e-12 leaves v known to 1e-12/v, and the time too.
    assert found.times("impact") == pytest.approx([t], abs=1e-7)
    before, after = found.pair("x_dot", found.times("impact")[0])
    assert before == pytest.approx(v, rel=1e-4)
    assert after == pytest.approx(-e * v, abs=1e-4 * v)
    s = found.t[found.t > t] - t
    expected = (1 - DEPTH) * np.cos(s) - e * v * np.sin(s)
    # What it gains in phase is 1e-4: found to a thousandth.
    close(found["x"][found.t > t], expected, 1e-7)


def test_a_graze_of_height_1e_8_is_not_invented():
    found = grazed(0.5, -DEPTH)
    assert not found.result.events
    assert not np.any(found.shared())
    close(found["x"], np.sin(found.t))


@pytest.mark.parametrize(("depth", "hits"), [(DEPTH, 1), (-DEPTH, 0)])
def test_a_graze_after_twenty_swings(depth, hits):
    # The ceiling comes down on the last highest point only.
    last = math.pi / 2 + 40 * math.pi
    ceiling = f"x <= 1 - {depth} + 1e-3*(t - {last!r})^2"
    text = scenes.oscillator(ceiling, 1, 0, 1, duration=last + 1, output_step=1)
    found = play(text)
    expected = [last - math.sqrt(depth / 0.501)] if hits else []
    assert found.times("impact") == pytest.approx(expected, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.2, 0.9])
def test_a_table_that_vibrates(e):
    amplitude, w, t, y, v = 0.01, 40, 0.0, 0.2, 0.0
    found = play(scenes.table(e, amplitude, w, y, v, duration=1.0, output_step=0.02))

    def above(s, t, y, v):
        return y + v * s - G * s * s / 2 - amplitude * math.sin(w * (t + s))

    times, speeds = [], []
    # The first three of each: later ones hang on these more and more.
    for _ in range(3):
        s = 1e-6
        while above(s, t, y, v) > 0:
            s += 1e-4
        s = brentq(above, s - 1e-4, s, (t, y, v), xtol=1e-15)
        t, y, v = t + s, amplitude * math.sin(w * (t + s)), v - G * s
        lift = amplitude * w * math.cos(w * t)
        v = lift - e * (v - lift)
        times.append(t)
        speeds.append(v)
    assert found.times("impact")[:3] == pytest.approx(times, abs=GLOBAL)
    after = [found.pair("y_dot", t)[1] for t in times]
    assert after == pytest.approx(speeds, abs=10 * GLOBAL)


def test_an_impact_exactly_at_an_output_time():
    # With g = 2 m/s^2 it falls from 1 m in 1 s, is back after 1 s, and after 1/2 s.
    found = play(scenes.ball(0.5, g=2, duration=2.7, output_step=0.25))
    assert found.times("impact") == pytest.approx([1, 2, 2.5], abs=1e-14)
    rows = [*expected_times(0, 2.7, 0.25), 1, 2, 2.5]
    close(found.t, sorted(rows), 1e-14)
    assert found.pair("y_dot", 1) == pytest.approx((-2, 1), abs=1e-13)
    assert found.pair("y_dot", 2) == pytest.approx((-1, 0.5), abs=1e-13)


@pytest.mark.parametrize("step", [0.25, 0.3])
@pytest.mark.parametrize("ulps", [-2, -1, 0, 1, 2])
def test_an_impact_exactly_at_the_end(ulps, step):
    """Whatever rounding makes of its time, it has two rows, as any other."""
    end = 1 + ulps * 2.0**-52
    found = play(scenes.ball(0.5, g=2, duration=end, output_step=step))
    assert found.t[-1] == end
    assert found["y"][-1] == pytest.approx(0.0, abs=1e-14)
    assert found.times("impact") == pytest.approx([1.0], abs=1e-14)
    assert np.sum(found.shared()) == 1


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_an_impact_at_the_start(e):
    found = play(scenes.ball(e, y=0, v=-3, duration=0.25, output_step=0.05))
    assert found.times("impact") == [0.0]
    assert found.pair("y_dot", 0) == pytest.approx((-3, 3 * e), abs=1e-14)
    later = found.t[2:]
    close(found["y"][2:], 3 * e * later - G * later**2 / 2 * (e > 0))


def test_a_start_on_the_floor_upwards_is_no_impact():
    found = play(scenes.ball(0.5, y=0, v=3, duration=0.5, output_step=0.05))
    assert found.times("impact") == []
    close(found["y"], 3 * found.t - G * found.t**2 / 2)


def two(first, second, **changes):
    """Two points that fall from 1 m onto floors of their own, with g = 2 m/s^2."""
    options = {"duration": 1.75, "output_step": 0.25, "forces": None} | changes
    laws = {"one": contact("a >= 0", 0.5), "two": contact("b >= -3", second)}
    return scene(
        "a b", "a_dot^2/2 + b_dot^2", "2*a + 4*b", laws, {"a": first, "b": "-2"},
        **options,
    )  # fmt: skip


def test_two_impacts_at_one_time_at_different_places():
    found = play(two(1, 0.25))
    assert found.times("impact", "one") == pytest.approx([1], abs=1e-14)
    assert found.times("impact", "two")[0] == pytest.approx(1, abs=1e-14)
    assert found.pair("a_dot", 1) == pytest.approx((-2, 1), abs=1e-12)
    assert found.pair("b_dot", 1) == pytest.approx((-2, 0.5), abs=1e-12)
    # The lighter loses 3/2, the other twice 15/8.
    lost = found.pair("energy", 1)
    assert lost[0] - lost[1] == pytest.approx(1.5 + 3.75, abs=1e-12)


def test_two_impacts_a_moment_apart():
    found = play(two("1 + 1e-12", 0.25))
    assert found.times("impact", "one") == pytest.approx([1], abs=1e-11)
    assert found.times("impact", "two")[0] == pytest.approx(1, abs=1e-11)
    assert found.at("a", 1.75) == pytest.approx(0.75 - 0.75**2, abs=1e-10)


def test_an_impact_exactly_when_another_contact_lets_go():
    # The first point lies on its floor and is pulled up ever more, free from t = 1 on;
    # that is when the second lands.
    found = play(two(0, 0.25, forces={"a": "2*t"}))
    assert found.times("release", "one") == pytest.approx([1], abs=GLOBAL)
    assert found.times("impact", "one") == []
    assert found.times("impact", "two")[0] == pytest.approx(1, abs=1e-14)
    s = np.maximum(found.t - 1, 0.0)
    close(found["a"], s**3 / 3)
    assert found.at("b", 1.25) == pytest.approx(-3 + 0.5 * 0.25 - 0.25**2, abs=GLOBAL)


def test_a_blow_that_sets_another_contact_free():
    # Two points on one line: the first rests against a wall, pressed there by a spring
    # of 1 N/m that is 1 m short; the second strikes it through a stop 1 m away.
    laws = {"wall": contact("a <= 0", 0), "stop": contact("b - a >= 1", 0)}
    text = scene(
        "a b", "(a_dot^2 + b_dot^2)/2", "(a - 1)^2/2", laws,
        {"a": 0, "b": 2, "b_dot": 1}, forces={"b": "-2"},
        duration=3, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    # b = 2 + t - t^2 is at 1 at (1 + sqrt 5)/2, with the speed -sqrt 5; both go on
    # with half of it: 2 a'' = 1 - a - 2.
    t = (1 + math.sqrt(5)) / 2
    assert found.times("impact", "stop")[0] == pytest.approx(t, abs=GLOBAL)
    assert found.times("release", "wall")[0] == pytest.approx(t, abs=GLOBAL)
    v = -math.sqrt(5) / 2
    after = found.t > t
    w = math.sqrt(0.5)
    s = found.t[after] - t
    a = -1 + np.cos(w * s) + v / w * np.sin(w * s)
    # Together while the first is not pulled ahead: the stop pushes 2 + a'' on b.
    together = 2 - w**2 * np.cos(w * s) - v * w * np.sin(w * s) > 0
    assert together.all()
    close(found["a"][after], a)
    close(found["b"][after], a + 1)


def test_a_fast_pass_through_a_thin_post():
    found = play(scenes.post())
    edge = 5 - 1e-4
    t = edge / 1000
    assert found.times("impact", "post") == pytest.approx([t], rel=GLOBAL)
    close(found["x"], np.where(found.t < t, 1000 * found.t, 2 * edge - 1000 * found.t))


@pytest.mark.slow
def test_a_narrow_channel():
    found = play(scenes.channel())
    # Off d/2 after d/2, then once in every d.
    times = 1e-6 * (np.arange(100) + 0.5)
    assert found.times("impact") == pytest.approx(times, rel=GLOBAL)
    assert np.all(np.abs(found["x_dot"]) == pytest.approx(1, abs=1e-12))
    assert np.min(found["x"]) > -1e-18
    assert np.max(found["x"]) < 1e-6 + 1e-18


@pytest.mark.slow
def test_a_contact_on_a_switch_of_a_force():
    # A force of 2 N towards x = 0, where the stop is, from either side.
    text = scene(
        "x", "x_dot^2/2", "0", {"stop": contact("x >= 0", 0.5)}, {"x": 1},
        forces={"x": "-2*sign(x)"}, duration=4, output_step=0.2,
    )  # fmt: skip
    found = play(text)
    assert found.times("impact", "stop")[:3] == pytest.approx([1, 2, 2.5], abs=GLOBAL)
    # Which of the two comes to rest first, contact or switch, does not matter.
    assert found.times("zeno") == pytest.approx([3], abs=GLOBAL)
    rests = found.t > 3 + 1e-6
    assert np.max(np.abs(found["x"][rests])) < 1e-12
    assert np.all(found["lambda_stop"] >= 0)
    assert np.max(found["lambda_stop"]) < 2 * (1 + GLOBAL)


@pytest.mark.slow
def test_a_contact_on_a_kink_of_a_force():
    # max(0, y) has its kink where the ball lies: x' is the area under its path.
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "2*y", {"floor": contact("y >= 0", 0.5)},
        {"x": 0, "y": 1}, forces={"x": "max(0, y)"}, duration=4, output_step=0.5,
    )  # fmt: skip
    found = play(text)
    # A flight from v takes v and has the area v^3/6; half of one at first.
    area = 2 / 3 + sum(v**3 / 6 for v in 0.5 ** np.arange(40))
    assert found.at("x_dot", 4) == pytest.approx(area, abs=GLOBAL)
    assert found.at("x_dot", 1.5) == pytest.approx(2 / 3 + 1 / 12, abs=GLOBAL)


@pytest.mark.slow
def test_a_run_may_stop_on_the_way_between_bounces():
    text = scenes.ball(0.8, duration=5, output_step=0.1)
    found = tried(text.replace("  duration: 5", "  until: y_dot >= 3\n  duration: 5"))
    first = math.sqrt(2 / G)
    assert found.result.outcome == "until"
    # True first just after the first bounce, where the velocity jumps past it.
    assert 0.8 * math.sqrt(2 * G) > 3
    assert found.t[-1] == pytest.approx(first, abs=GLOBAL)


@pytest.mark.parametrize(
    "method", ["rattle", "rk4", pytest.param("euler", marks=pytest.mark.slow)]
)
def test_ground_that_rises_within_a_step_strikes(method):
    floor = contact("y >= 0.5*exp(-((t - 0.35)/0.001)^2) - 0.001", 0)
    text = scene("y", "y_dot^2/2", "0", {"floor": floor}, {"y": 0}, duration=0.4)
    struck = tried(text, method=method, step=0.1).times("impact")
    assert struck[0] == pytest.approx(0.35 - 0.001 * math.sqrt(math.log(500)))
