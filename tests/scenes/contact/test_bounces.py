"""Bounces: the reference problems, infinitely many in finite time, and 10^4 of them."""

import itertools
import math

import numpy as np
import pytest
from scipy.special import ellipk, ellipkinc

from tests.scenes.contact import scenes
from tests.scenes.contact.motions import GLOBAL, G, close, contact, play, scene
from tests.scenes.reference import PROBLEMS, model_text, states
from tests.small_scenes import bounced, quarter, stopped

# Every error of a row is of the size of the tolerance, some hundred times it at most.
TOLERANCES = {"1e-11": 1e-9, "1e-12": 1e-10}
ONE_SIDED = ("bouncing_ball", "sliding_ladder")


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("name", ONE_SIDED)
def test_reference(name, rtol):
    found = play(model_text(name), rtol=rtol)
    for state in states(name):
        for values, dot in ((state.q, ""), (state.v, "_dot")):
            got = [found.at(f"{q}{dot}", state.t) for q in values]
            assert got == pytest.approx([*values.values()], abs=TOLERANCES[rtol])


def test_the_ladder_leaves_the_wall_without_an_impact():
    reference = PROBLEMS["sliding_ladder"]["reference"][0]
    found = play(model_text("sliding_ladder"), output_step=0.01)
    assert found.times("impact") == []
    left = float(reference["t_detach"])
    assert found.times("release", "c1") == pytest.approx([left], abs=GLOBAL)
    assert found.times("release", "c2") == []
    th, rate = found["th"], found["th_dot"]
    leans = found.t < left
    # th'^2 = 3g(cos(th0) - cos(th)), th'' = 3g/2 sin(th); m = L = 1.
    close(rate[leans] ** 2, 3 * G * (math.cos(0.2) - np.cos(th[leans])))
    bend = 1.5 * G * np.sin(th[leans])
    wall = (np.cos(th[leans]) * bend - np.sin(th[leans]) * rate[leans] ** 2) / 2
    floor = G - (np.sin(th[leans]) * bend + np.cos(th[leans]) * rate[leans] ** 2) / 2
    close(found["lambda_c1"][leans], wall)
    close(found["lambda_c2"][leans], floor)
    assert np.all(found["lambda_c1"][~leans] == 0.0)
    assert np.all(np.diff(found["residual_c1"][~leans]) > 0.0)


def impacts(e, count):
    """Return the times of the impacts of a ball dropped from 1 m."""
    first = math.sqrt(2 / G)
    powers = itertools.accumulate((e**k for k in range(1, count)), initial=0.0)
    return [first * (1 + 2 * p) for p in powers]


@pytest.mark.parametrize("e", [0.1, 0.5, 0.8, 0.99])
def test_infinitely_many_bounces_end_when_the_geometric_series_does(e):
    end = math.sqrt(2 / G) * (1 + e) / (1 - e)
    found = play(scenes.ball(e, duration=1.25 * end, output_step=end / 40))
    assert found.times("zeno", "floor") == pytest.approx([end], rel=GLOBAL)
    listed = found.times("impact")
    # A few at the least tell that the series is geometric.
    assert len(listed) >= 3
    assert listed == pytest.approx(impacts(e, len(listed)), rel=GLOBAL)
    assert [x.kind for x in found.result.events] == ["impact"] * len(listed) + ["zeno"]
    rests = found.t > end * (1 + GLOBAL)
    assert np.count_nonzero(rests) >= 9
    assert np.max(np.abs(found["y"][rests])) < 1e-12
    assert np.max(np.abs(found["y_dot"][rests])) < 1e-12
    close(found["lambda_floor"][rests], 2 * G)


@pytest.mark.slow
def test_a_ball_follows_its_parabolas():
    found = play(scenes.ball(0.8, duration=5, output_step=0.02))
    close(found["y"], bounced(found.t, 0.8, g=G))
    flies = found.t < 4.0  # its bounces end at 4.06
    close(found["y_ddot"][flies], np.full(np.sum(flies), -G))


def many(count):
    """Run a ball that bounces without loss; assert that it neither fades nor drifts."""
    first = math.sqrt(2 / G)
    end = 2 * count * first
    found = play(scenes.ball(1.0, duration=end, output_step=end / 100))
    expected = first * (2 * np.arange(count) + 1)
    assert np.array(found.times("impact")) == pytest.approx(expected, rel=GLOBAL)
    assert np.max(np.abs(found["energy"] / (2 * G) - 1)) < 1e-9
    # At the end it is at its highest again, for a time known to GLOBAL of the whole.
    assert found["y"][-1] == pytest.approx(1.0, abs=1e-9)
    assert found.times("zeno") == []


@pytest.mark.slow
def test_a_hundred_bounces_without_loss():
    many(100)


@pytest.mark.nightly
def test_ten_thousand_bounces_without_loss():
    many(10_000)


def test_without_restitution_it_rests_at_once():
    found = play(scenes.ball(0.0, duration=1, output_step=0.02))
    first = math.sqrt(2 / G)
    assert found.times("impact") == pytest.approx([first], abs=GLOBAL)
    assert found.times("zeno") == []
    before, after = found.pair("y_dot", first)
    assert before == pytest.approx(-math.sqrt(2 * G), abs=GLOBAL)
    assert after == pytest.approx(0.0, abs=1e-14)
    rests = found.t > first + GLOBAL
    assert np.max(np.abs(found["y"][rests])) < 1e-14
    close(found["lambda_floor"][rests], 2 * G)
    rows = np.abs(found["impulse.floor"]) > 0
    assert set(found.t[rows]) == {found.times("impact")[0]}
    assert np.max(found["impulse.floor"]) == pytest.approx(2 * math.sqrt(2 * G))


def test_an_oscillator_against_a_stop():
    found = play(scenes.oscillator("x >= -0.5", 0.8, duration=20, output_step=0.05))
    x, times = stopped(found.t, 0.8)
    assert len(times) >= 4
    assert found.times("impact") == pytest.approx(times, abs=GLOBAL)
    close(found["x"], x)


def test_a_pendulum_held_by_an_equality_strikes_a_wall():
    e, g, length = 0.7, G, 0.7
    found = play(scenes.swing(e))
    w = math.sqrt(g / length)
    k = math.sin(0.5)
    times = [quarter(1.0) / w]
    while times[-1] < 4:
        k *= e
        times.append(times[-1] + 2 * ellipk(k * k) / w)
    times.pop()
    assert found.times("impact", "wall") == pytest.approx(times, abs=GLOBAL)
    assert np.max(np.abs(found["residual_rod"])) < 1e-12
    # What remains after the last is what a swing from there on has.
    close(found["energy"][-1] / (2 * g * length) + 1, 2 * k * k)


def test_a_start_at_the_stop_that_is_let_go():
    # From the stop at rest the spring pulls away: no impact, no time lost.
    found = play(scenes.oscillator("x <= 1", 0.5, duration=3, output_step=0.1))
    close(found["x"], np.cos(found.t))
    assert found.times("impact") == []


def test_a_pendulum_released_onto_a_stop_takes_its_time():
    # An independent form of the time to a stop at half the angle.
    text = scene(
        "th", "m*l^2*th_dot^2/2", "-m*g*l*cos(th)",
        {"stop": contact("th >= 0.5", 0.0)}, {"th": 1.0},
        parameters={"m": 1, "l": 1}, duration=2, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    k = math.sin(0.5)
    inner = math.asin(math.sin(0.25) / k)
    first = (ellipk(k * k) - ellipkinc(inner, k * k)) / math.sqrt(G)
    assert found.times("impact") == pytest.approx([first], abs=GLOBAL)
    rests = found.t > first + GLOBAL
    close(found["lambda_stop"][rests], G * math.sin(0.5))
