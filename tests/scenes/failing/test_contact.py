"""Contact: what goes from impact to impact, or looks at signs alone, fails."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagsim.model.reader import read_file
from tests.support import MODELS, run


def failing(name, **values):
    """Run a scene of models/failing with other parameters."""
    sets = {key: repr(value) for key, value in values.items()}
    return run(read_file(str(MODELS / "failing" / f"{name}.yaml"), sets))


def impacts(found):
    return [e.time for e in found.trajectory.events if e.kind == "impact"]


# Infinitely many bounces

G, E = 9.81, 0.8
END = math.sqrt(2 / G) * (1 + E) / (1 - E)


def test_from_impact_to_impact_nobody_gets_past_the_accumulation():
    def gap(_t, y):
        return y[0]

    gap.terminal, gap.direction = True, -1
    t, y = 0.0, [1.0, 0.0]
    for _ in range(300):
        flight = solve_ivp(lambda _t, y: [y[1], -G], (t, 5.0), y, events=gap)
        t, y = flight.t[-1], [0.0, -E * flight.y[1, -1]]
    # What remains after 300 of them is END*E^300: rounding alone is left.
    assert t == pytest.approx(END, abs=1e-9)


def test_bounces_end_with_their_series():
    found = run("bouncing-ball")
    [zeno] = [e.time for e in found.trajectory.events if e.kind == "zeno"]
    # The time of the first impact, times 9: good to rounding but for how it is found.
    assert zeno == pytest.approx(END, rel=1e-9)
    assert found.trajectory.end == 5.0
    # Each impact leaves 0.64 of the height: 1e-11 of it, the tolerance, after 57.
    assert len(impacts(found)) <= 58
    rests = found["t"] > END + 1e-9
    assert np.count_nonzero(rests) > 90
    assert np.max(np.abs(found["y"][rests])) < 1e-12
    assert np.max(np.abs(found["y_dot"][rests])) < 1e-12
    assert found["lambda_floor"][rests] == pytest.approx(G, rel=1e-12)


# A graze


def test_signs_at_ends_of_steps_miss_a_graze():
    def gap(_t, y):
        return math.hypot(y[0], y[1]) - 1.0

    gap.terminal = True
    flight = solve_ivp(
        lambda _t, y: [y[2], y[3], 0.0, 0.0], (0.0, 30.0),
        [-10.0, 1.0 - 1e-8, 1.0, 0.0], method="DOP853", rtol=1e-11, events=gap,
    )  # fmt: skip
    assert flight.status == 0
    assert flight.y[1, -1] == 1.0 - 1e-8


@pytest.mark.parametrize("depth", [1e-4, 1e-8])
def test_a_graze_is_found_by_the_rate_of_the_gap(depth):
    found = failing("graze", depth=depth)
    # cos(a) = 1 - depth where it touches; it is thrown off by 2 a. Rounding of the
    # place, 1e-16, is 1e-16/depth of the depth and half of that of the angle.
    a = 2 * math.asin(math.sqrt(depth / 2))
    within = 1e-15 / depth + 1e-11
    [met] = impacts(found)
    assert met == pytest.approx(10.0 - math.sin(a), abs=math.sin(a) * within + 1e-14)
    assert found["y_dot"][-1] == pytest.approx(math.sin(2 * a), rel=within)
    assert found["x_dot"][-1] == pytest.approx(math.cos(2 * a), rel=1e-14)
    assert np.min(found["residual_post"]) > -1e-12


def test_a_pass_at_a_distance_of_1e_8_is_no_graze():
    found = failing("graze", depth=-1e-8)
    assert impacts(found) == []
    assert found["y_dot"] == pytest.approx(0.0, abs=1e-15)


# Balls in a row

ROW = {
    # Newton's law on every gap that closes or touches, and the sum of m v:
    "three at once": ({}, [-1 / 3, 2 / 3, 2 / 3], 2),
    "1, 2, 1 at once": ({"m2": 2, "gap": 1, "v3": -1}, [-1, 0, 1], 2),
    # Pair by pair: each keeps its sum of m v and turns its difference of v.
    "three one by one": ({"gap": 1e-6}, [0, 0, 1], 2),
    "1, 2, 1 one by one": (
        {"m2": 2, "gap": 1 + 1e-6, "v3": -1}, [-13 / 27, -10 / 27, 33 / 27], 3
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROW)
def test_balls_in_a_row_go_by_the_order_of_impacts(name):
    values, speeds, count = ROW[name]
    found = failing("balls-in-a-row", **values)
    got = [found[f"{x}_dot"][-1] for x in ("x1", "x2", "x3")]
    assert got == pytest.approx(speeds, abs=1e-12)
    assert len(impacts(found)) == count
    # The energy does not tell which is right: all keep it.
    assert np.ptp(found["energy"]) < 1e-12
    told = [w.text for w in found.trajectory.warnings if w.code == "impact-order"]
    assert len(told) == (1 if name.endswith("at once") else 0)
    assert all("simultaneous" in text for text in told)


# Time stepping


def falling(t):
    """Give the height of the ball by its parabolas."""
    start, v = math.sqrt(2 / G), E * math.sqrt(2 * G)
    y = np.where(t < start, 1.0 - G * t**2 / 2, 0.0)
    while v > 1e-12:
        s, length = t - start, 2 * v / G
        y = np.where((s >= 0.0) & (s < length), v * s - G * s**2 / 2, y)
        start, v = start + length, E * v
    return y


def test_time_stepping_through_impacts_is_of_order_1():
    # Over half decades, since how late an impact is met hangs on where steps end.
    steps = 10.0 ** -np.arange(1.5, 5.01, 0.5)
    errors = []
    for step in steps:
        found = run(
            "bouncing-ball", method="moreau", step=step, duration=3, output_step=0.01
        )
        errors.append(np.max(np.abs(found["y"] - falling(found["t"]))))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1, abs=0.1)
    # An impact that is h late moves what follows by (1 + e) v h; all of them,
    # v falling by e, by 1.8 v0/0.2 h = 40 h.
    assert np.all(errors < 40 * steps)
    located = run("bouncing-ball", duration=3, output_step=0.01)
    assert np.max(np.abs(located["y"] - falling(located["t"]))) < 1e-10
