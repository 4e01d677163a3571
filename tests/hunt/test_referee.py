"""What a referee refuses to judge, and what it sees; its motions the hunt itself holds.

A referee that is wrong disagrees with lagsim in the scenes of a hunt.
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
