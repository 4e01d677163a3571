"""Laws of equalities and of velocities: freewheels, limits, times."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.scenes.contact import scenes
from tests.scenes.contact.motions import GLOBAL, G, close, play, scene, tried


def test_a_freewheel_lets_the_output_run_on():
    found = play(scenes.freewheel("10*sin(2*pi*t)"), duration=1.5)
    t, most = found.t, 10 / (2 * math.pi)
    together = most / 2 * (1 - np.cos(2 * math.pi * t))
    engaged = t < 0.5
    close(found["a_dot"], np.where(engaged, together, -most * np.cos(2 * math.pi * t)))
    close(found["b_dot"], np.where(engaged, together, most))
    assert found.times("release", "wheel")[0] == pytest.approx(0.5, abs=GLOBAL)
    assert found.times("impact") == []
    push = np.where(engaged, 5 * np.sin(2 * math.pi * t), 0.0)
    close(found["lambda_wheel"], push)


def test_a_freewheel_engages_again_without_an_impact():
    # The torque 1 + 10 sin(2 pi t) brakes after t1, and the input has caught up where
    # its integral from there is zero again.
    found = play(scenes.freewheel("1 + 10*sin(2*pi*t)"), duration=1.9)
    p = 2 * math.pi
    first = 0.5 + math.asin(0.1) / p

    def given(t):
        return t - 10 / p * (np.cos(p * t) - 1)

    again = brentq(lambda t: given(t) - given(first), first + 0.1, 1.5, xtol=1e-15)
    assert found.times("release", "wheel")[0] == pytest.approx(first, abs=GLOBAL)
    assert found.times("contact", "wheel") == pytest.approx([again], abs=1e-8)
    assert found.times("impact") == []
    t = found.t
    out = np.where(t < first, given(t), given(first))
    out = np.where(t > again, given(first) + given(t) - given(again), out) / 2
    second = 1 + first
    close(found["b_dot"][t < second], out[t < second])


@pytest.mark.parametrize("method", [None, "moreau"])
def test_a_freewheel_that_runs_on_engages_by_a_stop(method):
    # The output bounces off a stop with e = 1/2, and takes the input along: -1 both,
    # momentum 3 less the impulse of 5. Beside it, one that is still faster stays free.
    text = scene(
        "a b c", "(a_dot^2 + b_dot^2 + c_dot^2)/2", "0",
        {
            "wheel": {"relation": "b_dot >= a_dot"},
            "other": {"relation": "b_dot >= c_dot"},
            "stop": {"relation": "b <= 1", "restitution": 0.5},
        },
        {"a": 0, "a_dot": 1, "b": 0, "b_dot": 2, "c": 0, "c_dot": -2},
        duration=1, output_step=0.25,
    )  # fmt: skip
    found = play(text, method=method, step="1e-3" if method else None)
    for q, speed in {"a": -1.0, "b": -1.0, "c": -2.0}.items():
        close(found[f"{q}_dot"][-1], speed)
    if method is None:
        assert np.max(found["impulse.stop"]) == pytest.approx(5.0, abs=GLOBAL)
        assert found.instants("impact") == pytest.approx([0.5], abs=GLOBAL)


def test_a_freewheel_passes_a_blow_on():
    # A third inertia at 6 rad/s is coupled to the input: all three share its momentum.
    text = scene(
        "a b c", "(a_dot^2 + b_dot^2 + c_dot^2)/2", "0",
        {
            "wheel": {"relation": "b_dot >= a_dot"},
            "shaft": {"relation": "c_dot = a_dot", "when": "t >= 0.5"},
        },
        {"a": 0, "b": 0, "c": 0, "c_dot": 6}, duration=1, output_step=0.2,
    )  # fmt: skip
    found = play(text)
    assert found.instants("impact") == pytest.approx([0.5], abs=1e-15)
    for q in ("a_dot", "b_dot", "c_dot"):
        assert found.pair(q, 0.5)[1] == pytest.approx(2, abs=GLOBAL)
        close(found[q][found.t > 0.5], np.full(np.sum(found.t > 0.5), 2.0))


def test_a_clutch_slips_until_both_turn_alike():
    found = play(scenes.clutch())
    grips = 10 / (2 * 2)
    assert found.times("stick", "clutch") == pytest.approx([grips], abs=GLOBAL)
    slips = found.t < grips - GLOBAL
    s = np.minimum(found.t, grips)
    close(found["a_dot"], 10 - 2 * s)
    close(found["b_dot"], 2 * s)
    close(found["residual_clutch"], 10 - 4 * s)
    assert np.all(found["lambda_clutch"][slips] == -2.0)
    after = found.t > grips + GLOBAL
    assert np.max(np.abs(found["lambda_clutch"][after])) < 1e-10
    # Half of the energy is gone, and the work says so.
    close(found["energy"][-1], 25)
    close(found["work"][-1] - found["work"][0], -25)


def test_a_clutch_gives_way_to_a_growing_torque():
    # Held, it passes half of the torque on; it gives way at 4 N m.
    found = play(scenes.clutch("max(0, t - 3)*8"))
    loose = 3.5
    assert found.times("slip", "clutch")[-1] == pytest.approx(loose, abs=GLOBAL)
    s = np.maximum(found.t - 3, 0)
    r = np.maximum(found.t - loose, 0)
    held = (found.t > 2.5) & (found.t < loose)
    close(found["lambda_clutch"][held], -4 * s[held])
    end = 5 + 2 * 0.5**2 + 2 * r[-1]
    assert found["b_dot"][-1] == pytest.approx(end, rel=GLOBAL)
    assert found["a_dot"][-1] == pytest.approx(10 + 4 * s[-1] ** 2 - end, rel=GLOBAL)


def test_a_limit_may_depend_on_time():
    # A brake on a falling block gets weaker: it holds m g until 20 (1 - t) < g.
    text = scene(
        "y", "y_dot^2/2", "g*y",
        {"brake": {"relation": "y_dot = 0", "limit": "max(0, 20*(1 - t))"}},
        {"y": 0}, duration=2, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    loose = 1 - G / 20
    assert found.times("slip", "brake") == pytest.approx([loose], abs=GLOBAL)
    s = np.clip(found.t, loose, 1) - loose
    fall = 10 * s**2 + G * np.maximum(found.t - 1, 0)
    close(found["y_dot"], -fall)


def test_a_stick_that_is_cut_throws_its_bob():
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "0",
        {"stick": {"relation": "x^2 + y^2 = 1", "when": "t < 0.3"}},
        {"x": 1, "y": 0, "y_dot": 2}, duration=1, output_step=0.05,
    )  # fmt: skip
    found = play(text)
    assert found.times("release", "stick") == pytest.approx([0.3], abs=1e-15)
    assert found.times("impact") == []
    turn, s = 2 * np.minimum(found.t, 0.3), np.maximum(found.t - 0.3, 0)
    close(found["x"], np.cos(turn) - 2 * s * np.sin(turn))
    close(found["y"], np.sin(turn) + 2 * s * np.cos(turn))
    after = found.t > 0.3
    assert np.all(found["lambda_stick"][after] == 0.0)
    close(found["lambda_stick"][found.t < 0.3], np.full(np.sum(found.t < 0.3), -2))
    # It goes on to show what it would hold.
    close(found["residual_stick"][after], (2 * s[after]) ** 2)


def test_a_coupling_that_comes_in_shares_momentum():
    text = scene(
        "a b", "a_dot^2/2 + 3*b_dot^2/2", "0",
        {"shaft": {"relation": "a_dot = b_dot", "when": "t >= 0.5"}},
        {"a": 0, "b": 0, "a_dot": 8}, duration=1, output_step=0.1,
    )  # fmt: skip
    found = play(text)
    assert found.times("impact", "shaft") == pytest.approx([0.5], abs=1e-15)
    assert found.pair("a_dot", 0.5) == pytest.approx((8, 2), abs=GLOBAL)
    assert found.pair("b_dot", 0.5) == pytest.approx((0, 2), abs=GLOBAL)
    assert found.pair("energy", 0.5) == pytest.approx((32, 8), abs=32 * GLOBAL)
    balance = found["energy"] - found["work"]
    close(balance, np.full(len(balance), 32))


@pytest.mark.parametrize(
    ("place", "fits"),
    # Off by 1e-5 of its way, and by 1e-7, where a part of 1e-6 is torn.
    [("pi/2", True), ("1.5", False), ("pi/2 - 1e-5", False), ("pi/2 - 1e-7", True)],
)
def test_a_place_must_be_met_when_it_begins_to_hold(place, fits):
    text = scene(
        "x", "x_dot^2/2", "x^2/2",
        {"pin": {"relation": "x = 0", "when": f"t >= {place}"}}, {"x": 1},
        duration=3, output_step=0.1,
    )  # fmt: skip
    found = tried(text)
    assert found.result.complete == fits
    if not fits:
        assert found.result.outcome == "failed"
        assert "pin" in found.result.reason
        meant = 1.5 if place == "1.5" else math.pi / 2 - 1e-5
        assert found.t[-1] == pytest.approx(meant, abs=GLOBAL)
        return
    found_at = found.times("impact")[0]
    assert found_at == pytest.approx(math.pi / 2, abs=1e-7 + GLOBAL)
    assert found.pair("x_dot", found_at) == pytest.approx((-1, 0), abs=GLOBAL)
    pinned = found.t > math.pi / 2
    assert np.max(np.abs(found["x"][pinned])) < 1e-9 + 1e-7 * ("-" in place)
    assert np.max(np.abs(found["lambda_pin"][pinned])) < 1e-9
