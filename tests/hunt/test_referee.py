"""The referee against closed forms: who judges must be judged first."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from tests.hunt.grammar import scene as scene_of
from tests.hunt.hunting import shrunk
from tests.hunt.lagsim_runs import Answer
from tests.hunt.referee import EPS, NoTruthError
from tests.hunt.scene import Item, Scene
from tests.hunt.verdict import GAIN, judge, truth

# Steps at a tolerance of 3e-14, some hundred of them, of motions of size 1.
CLOSE = 1e-12


def a_scene(*items, duration=10.0, step=0.5, **more):
    return Scene("test", items, more.pop("start", 0.0), duration, step, **more)


def slider(x=1.0, v=0.0, *, potential="0", force=None, **more):
    """Give a unit mass on a line."""
    return Item(
        "slider", coordinates={"x": (x, v)}, kinetic=("x_dot^2/2",),
        potential=(potential,), forces=(("x", force),) if force else (), **more,
    )  # fmt: skip


def motion(item, **more):
    return truth(a_scene(item, **more))


def close(found, column, expected, row=slice(None), within=CLOSE):
    """Demand a column, and that the referee knows how well it knows it."""
    x = found.state[row, column]
    off, known = np.abs(x - expected), found.known[row, column]
    assert np.max(off) < within
    assert np.all(off <= GAIN * known + 8 * EPS * np.maximum(np.abs(x), 1.0))


def test_an_oscillator_follows_the_cosine():
    found = motion(slider(potential="x^2/2"), duration=20.0)
    close(found, 0, np.cos(found.times))
    close(found, 1, -np.sin(found.times))


@pytest.mark.parametrize("law", ["x^2 + y^2 = 1", "x*x_dot + y*y_dot = 0"])
def test_a_pendulum_on_a_rod_is_the_pendulum_of_an_angle(law):
    angle = Item(
        "angle", coordinates={"a": (0.5, 0.0)}, kinetic=("a_dot^2/2",),
        potential=("-9.81*cos(a)",),
    )  # fmt: skip
    start = (float(np.sin(0.5)), float(-np.cos(0.5)))
    rod = Item(
        "rod", coordinates={"x": (start[0], 0.0), "y": (start[1], 0.0)},
        kinetic=("(x_dot^2 + y_dot^2)/2",), potential=("9.81*y",),
        constraints={"rod": law},
    )  # fmt: skip
    one, other = (motion(item, duration=3.0) for item in (angle, rod))
    close(other, 0, np.sin(one.state[:, 0]))


def test_kepler_comes_back_after_a_period():
    planet = Item(
        "planet", coordinates={"x": (0.5, 0.0), "y": (0.0, float(np.sqrt(3)))},
        kinetic=("(x_dot^2 + y_dot^2)/2",), potential=("-1/sqrt(x^2 + y^2)",),
    )  # fmt: skip
    found = motion(planet, duration=float(2 * np.pi), step=float(np.pi))
    close(found, 0, [0.5, -1.5, 0.5])
    close(found, 1, 0.0)


def test_dry_friction_stops_the_oscillator_where_it_sticks():
    found = motion(slider(potential="x^2/2", force="-0.11*sign(x_dot)"), duration=17.0)
    # Each swing loses 0.22; past 0.12 the last one ends at 0.1, within the friction.
    close(found, 0, 0.1, row=-1)
    assert np.allclose(
        found.motion.switched, np.pi * np.arange(1, 6), rtol=0, atol=CLOSE
    )
    assert found.state[-1, 1] == pytest.approx(0.0, abs=1e-15)
    assert found.motion.rate[1] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    ("end", "x"),
    # From x = 1 at t = 4: x = 1 + sin(t - 4)/4 under the spring and sliding friction.
    [(3.9, 3.9 / 4), (6.0, 1 + np.sin(2) / 4)],
)
def test_a_block_sticks_to_a_belt_until_the_spring_tears_it_off(end, x):
    belt = slider(0.0, 0.25, potential="x^2/2", force="-sign(x_dot - 0.25)")
    close(motion(belt, duration=end, step=end), 0, x, row=-1)


@pytest.mark.parametrize(
    ("law", "speed"),
    [
        ("-0.5*x_dot", lambda t: 2 * np.exp(-t / 2)),
        ("-0.5*abs(x_dot)*x_dot", lambda t: 2 / (1 + t)),
        ("-sign(x_dot)*abs(x_dot)^1.5", lambda t: (2**-0.5 + t / 2) ** -2),
        ("-sign(x_dot)*sqrt(abs(x_dot))", lambda t: np.maximum(0, 2**0.5 - t / 2) ** 2),
        ("-x_dot^3", lambda t: (1 / 4 + 2 * t) ** -0.5),
    ],
)
def test_drag_slows_as_its_law_says(law, speed):
    found = motion(slider(0.0, 2.0, force=law), duration=2.5)
    close(found, 1, speed(found.times))


@pytest.mark.parametrize("past", [0.0009, 0.002, 0.004])
def test_a_kink_just_before_the_end_is_seen(past):
    # A throw with drag as the square of the speed is up at atan(2).
    throw = slider(0.0, 2.0, force="-1 - abs(x_dot)*x_dot")
    end = float(np.arctan(2)) + past
    close(motion(throw, duration=end, step=end), 1, -np.tanh(past), row=-1)


def test_until_is_located():
    fall = slider(5.0, 0.0, potential="8*x")
    found = motion(fall, until="x <= 1.76")
    assert found.motion.stopped
    assert found.times[-1] == pytest.approx(0.9, abs=1e-14)
    dips = slider(potential="x^2/2")
    found = motion(dips, until="x <= -0.9999999", step=10.0)
    assert found.times[-1] == pytest.approx(np.arccos(-0.9999999), abs=1e-8)


def test_a_narrow_pulse_is_seen():
    pulse = slider(
        0.0, force="exp(-((t - 5.3)/0.001)^2)", features=(("t - 5.3", 0.0005),)
    )
    found = motion(pulse, duration=6.0, step=3.0)
    close(found, 1, 0.001 * np.sqrt(np.pi), row=-1, within=1e-15)


def test_a_narrow_hill_turns_back_what_is_slow():
    hill = slider(-1.0, 1.0, potential="exp(-(x/0.01)^2)", features=(("x", 0.005),))
    close(motion(hill, duration=3.0), 1, -1.0, row=-1)


def test_forces_that_jump_in_time_are_met():
    box = slider(
        0.0, force="if(t > 1 and t < 1.5, 4, 0) + sign(sin(pi*t))",
        breaks=(1.0, 1.5, 2.0, 3.0, 4.0),
    )  # fmt: skip
    # Box: speed 2 from 1.5 on, 1/2 + 2*(t - 1.5); square wave: up 1, down 1, twice.
    close(motion(box, duration=4.0), 0, 0.5 + 2 * 2.5 + 2, row=-1)


def test_a_wall_gives_back_the_speed():
    wall = slider(1.0, -1.0, potential="100*max(0, -x)^2/2")
    found = motion(wall, duration=4.0, step=4.0)
    # Half a period, pi/10, in the wall.
    close(found, 0, 4.0 - 1.0 - np.pi / 10, row=-1)
    assert len(found.motion.switched) == 2


@pytest.mark.slow
def test_a_chaotic_scene_gives_no_truth():
    arms = Item(
        "double", coordinates={"a": (3.0, 0.0), "b": (2.5, 0.0)},
        kinetic=("a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b)",),
        potential=("-20*cos(a) - 10*cos(b)",),
    )  # fmt: skip
    with pytest.raises(NoTruthError):
        truth(a_scene(arms, duration=15.0, step=15.0))


TOLD = [{"code": "horizon", "text": ""}]


@pytest.mark.parametrize(
    ("kind", "shift", "told", "more"),
    [
        ("fine", 0.0, 1e-12, {}),
        ("fine", 1e-9, 1e-10, {}),
        ("silent-wrong", 1e-4, 1e-9, {}),
        ("fine", 1e-4, 1e-6, {"warnings": TOLD}),
        ("false-horizon", 1e-9, 0.5, {"warnings": TOLD}),
        ("told-too-small", 1e-4, 1e-9, {"warnings": TOLD}),
        ("silent-wrong", 1e-4, 1e-9, {"warnings": [{"code": "step-unused"}]}),
        ("wrong-rows", 0.0, 1e-12, {"outcome": "until"}),
        ("crash", 0.0, 1e-12, {"code": 70}),
        ("refused-3", 0.0, 1e-12, {"code": 3}),
        ("hang", 0.0, 1e-12, {"code": -1}),
    ],
)
def test_the_verdict_sees_what_is_wrong_and_grants_what_is_told(
    kind, shift, told, more
):
    scene = a_scene(slider(potential="x^2/2"), duration=2.0, step=1.0)
    exact, times = truth(scene), np.array([0.0, 1.0, 2.0])
    rows = np.stack([times, np.cos(times) + shift * times, -np.sin(times)], axis=1)
    record = {
        "complete": True, "outcome": "done", "warnings": [], "method": "m",
        "rtol": 1e-11, "error": {"coordinates": {"x": {"largest": told}}}, **more,
    }  # fmt: skip
    code = record.pop("code", 0)
    verdict = judge(scene, Answer(code, "", record, ["t", "x", "x_dot"], rows), exact)
    assert verdict.kind == kind
    assert verdict.is_fault == (kind != "fine")
    if not more and shift:
        assert verdict.ratio == pytest.approx(2 * shift / told, rel=1e-3)


def test_shrinking_keeps_what_fails_and_little_else():
    noise = [
        Item(f"n{i}", coordinates={f"y{i}": (1.234, 0.5)}, kinetic=(f"y{i}_dot^2/2",))
        for i in range(3)
    ]
    spring = Item("spring", parameters={"K": 2.345}, potential=("K*x^2/2",))
    scene = a_scene(*noise, slider(1.234), spring, step=0.01)
    small = shrunk(scene, lambda s: any("K" in i.parameters for i in s.items))
    # The spring needs its slider; nothing needs the others.
    assert [item.tag for item in small.items] == ["slider", "spring"]
    assert small.items[1].parameters == {"K": 2.0}
    assert small.duration < 0.1


def test_scenes_follow_from_their_seed():
    scene = scene_of("same-0")
    assert scene.text() == scene_of("same-0").text()
    assert list(yaml.safe_load(scene.text())["coordinates"]) == scene.q
    assert scene_of("same-1").text() != scene.text()
