"""What a referee refuses to judge, what it sees, and how friction sticks and tears off.

A referee whose equations are wrong disagrees with lagsim in the scenes of a hunt.
"""

import numpy as np
import pytest

from tests.hunt.integrator import Extrapolation, NoTruthError
from tests.hunt.lagsim_runs import Answer
from tests.hunt.scene import Item, Scene
from tests.hunt.verdict import judge, truth

Long = np.longdouble


def a_scene(item, duration, step):
    return Scene("test", (item,), 0.0, duration, step)


def slid(x, v, force, duration, step=0.5):
    """Give the motion of a unit mass on a spring of stiffness 1."""
    slider = Item(
        "slider", coordinates={"x": (x, v)}, kinetic=("x_dot^2/2",),
        potential=("x^2/2",), forces=(("x", force),),
    )  # fmt: skip
    return truth(a_scene(slider, duration, step)).motion


def test_dry_friction_stops_the_oscillator_where_it_sticks():
    found = slid(1.0, 0.0, "-0.11*sign(x_dot)", 20.0)
    # Each swing loses 0.22; past 0.12 the last one ends at 0.1, within the friction.
    assert abs(found.q[-1, 0] - Long(0.1)) < 1e-15
    assert np.allclose(found.switched, np.pi * np.arange(1, 6), rtol=0, atol=1e-14)
    assert found.v[-1, 0] == pytest.approx(0.0, abs=1e-17)
    assert found.a[-1, 0] == pytest.approx(0.0, abs=1e-17)


def test_a_block_sticks_to_a_belt_until_the_spring_tears_it_off():
    found = slid(0.0, 0.25, "-sign(x_dot - 0.25)", 3.9, 3.9)
    assert found.q[-1, 0] == pytest.approx(3.9 / 4)
    found = slid(0.0, 0.25, "-sign(x_dot - 0.25)", 6.0, 6.0)
    # From x = 1 at t = 4: x = 1 + sin(t - 4)/4 under the spring and sliding friction.
    assert abs(found.q[-1, 0] - 1 - np.sin(Long(2)) / 4) < 1e-14


@pytest.mark.slow
def test_a_chaotic_scene_gives_no_truth():
    arms = Item(
        "double", coordinates={"a": (3.0, 0.0), "b": (2.5, 0.0)},
        kinetic=("a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b)",),
        potential=("-20*cos(a) - 10*cos(b)",),
    )  # fmt: skip
    with pytest.raises(NoTruthError):
        truth(a_scene(arms, 25.0, 25.0))


def test_the_verdict_sees_what_is_wrong_and_grants_what_is_told():
    oscillator = Item(
        "oscillator", coordinates={"x": (1.0, 0.0)}, kinetic=("x_dot^2/2",),
        potential=("x^2/2",),
    )  # fmt: skip
    scene = a_scene(oscillator, 2.0, 1.0)
    exact = truth(scene)
    times = np.array([0.0, 1.0, 2.0])

    def verdict(shift, told, *, warnings=(), code=0, outcome="done"):
        rows = np.stack([times, np.cos(times) + shift * times, -np.sin(times)], axis=1)
        record = {
            "complete": True, "outcome": outcome, "warnings": list(warnings),
            "method": "m", "rtol": 1e-11,
            "error": {"coordinates": {"x": {"largest": told}}},
        }  # fmt: skip
        answer = Answer(code, "", record, ["t", "x", "x_dot"], rows)
        return judge(scene, answer, exact)

    assert verdict(0.0, 1e-12).kind == "fine"
    assert verdict(1e-9, 1e-10).kind == "fine"
    assert verdict(1e-9, 1e-10).ratio == pytest.approx(20, rel=1e-3)
    assert verdict(1e-4, 1e-9).kind == "silent-wrong"
    told = [{"code": "horizon", "text": ""}]
    assert verdict(1e-4, 1e-6, warnings=told).kind == "fine"
    assert verdict(1e-9, 0.5, warnings=told).kind == "false-horizon"
    assert verdict(1e-4, 1e-9, warnings=told).kind == "told-too-small"
    assert verdict(1e-4, 1e-9, warnings=[{"code": "step-unused"}]).is_fault
    assert verdict(0.0, 1e-12, outcome="until").kind == "wrong-rows"
    assert verdict(0.0, 1e-12, code=70).kind == "crash"
    assert verdict(0.0, 1e-12, code=3).kind == "refused-3"
    assert verdict(0.0, 1e-12, code=-1).kind == "hang"


@pytest.mark.parametrize("past", [0.0009, 0.002, 0.004])
def test_a_kink_just_before_the_end_of_a_step_is_seen(past):
    # A throw with drag as the square of the speed: it is up at atan(2), and a step
    # ends a little later, past all the midpoints but not past the kink.
    top = np.arctan(Long(2))
    end = top + Long(past)

    def slope(_, y):
        return np.array([y[1], -1 - abs(y[1]) * y[1]])

    step = Extrapolation(slope, lambda *_: float(end) / 20, 7, 1e-16, 150_000)
    t, y = Long(0), np.array([0, 2], Long)
    while t < end:
        _, _, y, t = step.advance(t, y, end)
    assert abs(y[1] + np.tanh(Long(past))) < 1e-14
