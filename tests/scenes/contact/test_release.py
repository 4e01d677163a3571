"""Contacts that end without an impact: where the contact force vanishes."""

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from tests.scenes.contact import scenes
from tests.scenes.contact.motions import GLOBAL, G, close, play

# A gap in metres, and one that is not: the motion is the same, the multiplier is not.
DOMES = {"metres": "hypot(x, y) >= R", "squares": "x^2 + y^2 >= R^2"}


@pytest.mark.parametrize("unit", DOMES)
def test_a_point_leaves_a_dome_at_two_thirds_of_its_height(unit):
    found = play(scenes.dome(DOMES[unit]))
    radius, top = 1.5, math.cos(0.3)
    left = math.acos(2 / 3 * top)

    # th'^2 = 2g/R (cos(th0) - cos(th)); th = 0.3 + s^2 takes the root at the start out.
    def slowness(s):
        fall = 2 * math.sin(0.3 + s * s / 2) * math.sin(s * s / 2)
        return 2 * s / math.sqrt(2 * G / radius * fall)

    t, off = quad(slowness, 1e-9, math.sqrt(left - 0.3), epsabs=1e-13, epsrel=1e-13)
    assert off < 1e-11
    t += 1e-9 * slowness(1e-9)
    assert found.times("release", "dome") == pytest.approx([t], abs=GLOBAL)
    assert found.times("impact") == []
    speed = math.sqrt(2 / 3 * G * radius * top)
    s = found.t[found.t > t] - t
    x = radius * math.sin(left) + speed * math.cos(left) * s
    y = radius * math.cos(left) - speed * math.sin(left) * s - G * s**2 / 2
    close(found["x"][found.t > t], x)
    close(found["y"][found.t > t], y)
    held = found.t < t
    th = np.arctan2(found["x"][held], found["y"][held])
    push = 2 * G * (3 * np.cos(th) - 2 * top)
    arm = 2 * radius if unit == "squares" else 1.0
    close(found["lambda_dome"][held], push / arm)
    assert np.all(found["lambda_dome"][~held] == 0.0)


@pytest.mark.parametrize("factor", [2.5, 3.0, 3.5, 4.9])
def test_a_string_goes_slack_and_catches(factor):
    """With v^2 = k g l below it goes slack where cos(th) = (2 - k)/3.

    From there the bob falls freely for 4 v_y/g; the string takes its radial velocity.
    For k = 3.5 it catches at the very bottom.
    """
    length = 0.4
    found = play(scenes.string(factor))
    slack = math.acos((2 - factor) / 3)
    rate = math.sqrt(G / length)

    def faster(th):
        return 1 / (rate * math.sqrt(factor - 2 + 2 * math.cos(th)))

    left, _ = quad(faster, 0, slack, epsabs=1e-14, epsrel=1e-13)
    assert found.times("release", "string")[0] == pytest.approx(left, abs=GLOBAL)
    speed = math.sqrt(-math.cos(slack) * G * length)
    start = np.array([math.sin(slack), -math.cos(slack)]) * length
    v = speed * np.array([math.cos(slack), math.sin(slack)])
    flight = 4 * v[1] / G
    caught = left + flight
    assert found.times("impact", "string")[0] == pytest.approx(caught, abs=GLOBAL)
    free = (found.t > left) & (found.t < caught)
    s = found.t[free] - left
    close(found["x"][free], start[0] + v[0] * s)
    close(found["y"][free], start[1] + v[1] * s - G * s**2 / 2)
    place = (start + v * flight - [0, G * flight**2 / 2]) / length
    falls = v - [0, G * flight]
    along = falls @ [-place[1], place[0]]
    rows = np.array([found.pair(c, caught) for c in ("x_dot", "y_dot")])
    assert rows[:, 0] == pytest.approx(falls, abs=GLOBAL)
    assert rows[:, 1] == pytest.approx(
        along * np.array([-place[1], place[0]]), abs=GLOBAL
    )
    # Then it swings with the string taut, by equations of the angle.
    angle = math.atan2(place[0], -place[1])
    rows_t = found.t[found.t > caught + GLOBAL][:20]
    other = solve_ivp(
        lambda _, s: [s[1], -(rate**2) * math.sin(s[0])],
        (caught, rows_t[-1]), [angle, along / length], "DOP853", rows_t,
        rtol=1e-12, atol=1e-13,
    )  # fmt: skip
    taut = other.y[1] ** 2 + rate**2 * np.cos(other.y[0]) > 0
    assert np.count_nonzero(taut[:3]) == 3
    upto = len(taut) if taut.all() else int(np.argmin(taut))
    rows = np.flatnonzero(found.t > caught + GLOBAL)[:upto]
    # Errors of the catch grow with the time since.
    close(found["x"][rows], length * np.sin(other.y[0][:upto]), 10 * GLOBAL)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("rattle", 2), ("rk4", 4)])
def test_a_string_goes_slack_under_fixed_steps(method, order):
    text, errors = scenes.string(3.0, duration=0.45), []
    for step in (2e-3, 1e-3):
        found = play(text, method=method, step=step)
        assert len(found.times("release")) == 1
        errors.append(found["x"][-1] - play(text)["x"][-1])
    assert errors[0] / errors[1] == pytest.approx(2**order, rel=0.25)


def test_a_table_drops_away_under_a_block_and_comes_back():
    # It leaves where A w^2 sin(wt) = g, with the velocity of the table.
    amplitude, w = 0.01, 40
    found = play(scenes.table(0.0, amplitude, w, duration=0.5, output_step=0.001))
    left = math.asin(G / (amplitude * w * w)) / w
    y, v = G / w**2, amplitude * w * math.cos(w * left)

    def gap(t):
        s = t - left
        return y + v * s - G * s * s / 2 - amplitude * math.sin(w * t)

    lands = brentq(gap, left + 0.01, left + 0.15, xtol=1e-15)
    assert found.times("release", "table")[0] == pytest.approx(left, abs=GLOBAL)
    assert found.times("impact", "table")[0] == pytest.approx(lands, abs=GLOBAL)
    before, after = found.pair("y_dot", lands)
    assert before == pytest.approx(v - G * (lands - left), abs=GLOBAL)
    assert after == pytest.approx(amplitude * w * math.cos(w * lands), abs=GLOBAL)
    rides = (found.t < left) & (found.t > 0)
    close(found["y"][rides], amplitude * np.sin(w * found.t[rides]))
    push = G - amplitude * w**2 * np.sin(w * found.t[rides])
    close(found["lambda_table"][rides], push)
    # What the table gives is work: energy - work stays.
    balance = found["energy"] - found["work"]
    close(balance, np.full(len(balance), balance[0]))


@pytest.mark.slow
def test_a_block_rocks_as_housner_says():
    """He lets each impact pass on 1 - 3/2 sin(alpha)^2 of the rate."""
    found = play(scenes.block())
    alpha, size = math.atan(0.25), math.hypot(0.25, 1)
    p2, start = 3 * G / (4 * size), 0.15

    # th'^2 = 2 p^2 (cos(alpha - most) - cos(alpha - th)) with th = most - s^2, the
    # difference of cosines as a product.
    def rate(s, most):
        mean = math.sin(alpha - most + s * s / 2)
        return math.sqrt(4 * p2 * mean * math.sin(s * s / 2))

    def quarter(most):
        end = math.sqrt(most)
        t, off = quad(lambda s: 2 * s / rate(s, most), 1e-9, end, epsabs=1e-13)
        assert off < 1e-10
        return t + 2e-18 / rate(1e-9, most)

    kept = 1 - 1.5 * math.sin(alpha) ** 2
    times, most = [quarter(start)], start
    for _ in range(5):
        after = kept * rate(math.sqrt(most), most)
        most = alpha - math.acos(math.cos(alpha) + after**2 / (2 * p2))
        times.append(times[-1] + 2 * quarter(most))
    assert found.instants("impact")[:6] == pytest.approx(times, abs=GLOBAL)
    first = times[0]
    edges = [found.times("impact", edge)[0] for edge in ("right", "left")]
    assert edges == pytest.approx(times[:2], abs=GLOBAL)
    before, after = found.pair("th_dot", first)
    assert before == pytest.approx(-rate(math.sqrt(start), start), abs=GLOBAL)
    assert after == pytest.approx(kept * before, abs=GLOBAL)
    # Infinitely many impacts leave it at rest, on both edges.
    assert len(found.times("zeno")) >= 1
    assert abs(found["th"][-1]) < 1e-10
    assert found["lambda_left"][-1] == pytest.approx(G / 2, rel=1e-8)
    assert found["lambda_right"][-1] == pytest.approx(G / 2, rel=1e-8)
    # Nothing slid: the right edge is where it was set down first.
    edge = found["x"] + 0.25 * np.cos(found["th"]) + np.sin(found["th"])
    assert edge[-1] == pytest.approx(0.25, abs=GLOBAL)
