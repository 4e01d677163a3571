"""The models of docs/recipes.md against the formulas beside these."""

import contextlib
import io
import itertools
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import ellipj, roots_laguerre

import lagsim
from tests.pages import blocks
from tests.support import ROOT

MODELS = {
    re.search(r"^name: (\S+)", block.text)[1]: block.text
    for block in blocks("docs/recipes.md")
    if block.kind == "yaml"
}
G = 9.81
# Runs are good to about 1e-11 of a range, forces to a few digits less.
CLOSE = {"rtol": 1e-8, "atol": 1e-9}


@pytest.fixture
def result(request):
    found = lagsim.simulate(lagsim.load(MODELS[request.param]), error_bar="never")
    assert found.complete
    return found


HELD = set()


def of(name):
    HELD.add(name)
    return pytest.mark.parametrize("result", [name], indirect=True, ids=[name])


@of("joint-force")
def test_the_force_of_a_pivot(result):
    # Newton along the rod, with theta_dot^2 from the conservation of energy.
    theta = result["theta"]
    pull = 2.0 * G * (3 * np.cos(theta) - 2 * np.cos(1.2))
    assert np.allclose(result["lambda_across"], -pull * np.sin(theta), **CLOSE)
    assert np.allclose(result["lambda_along"], pull * np.cos(theta), **CLOSE)


@of("rolling-cylinder")
def test_a_cylinder_rolls_down(result):
    down = G * np.sin(np.radians(20))
    assert np.allclose(result["s"], down * result.t**2 / 3, **CLOSE)
    assert np.allclose(result["lambda_rolls"], -3.0 * down / 3, **CLOSE)


@of("ball-on-a-turntable")
def test_a_ball_circles_on_a_turntable(result):
    # z'' = i (2/7) w z', with z = x + i y.
    rate = 2j / 7 * 7.0
    z = 0.3 + 0.1 / rate * (np.exp(rate * result.t) - 1)
    assert np.allclose(result["x"] + 1j * result["y"], z, **CLOSE)
    assert np.ptp(result["x"]) > 0.05


@of("moving-trolley")
def test_a_pendulum_on_a_trolley_that_speeds_up(result):
    theta, a, tilt = result["theta"], 3.0, np.arctan(3.0 / G)
    rate = 2 * np.hypot(G, a) * (np.cos(theta + tilt) - np.cos(tilt))
    assert np.allclose(result["theta_dot"] ** 2, rate, **CLOSE)
    # The turning point lies between rows, at most half a row from one.
    assert theta.min() == pytest.approx(-2 * tilt, abs=0.005**2 * np.hypot(G, a))
    balance = result["energy"] - result["work"]
    assert np.ptp(balance) < 1e-8 * np.ptp(result["energy"])


@pytest.mark.slow
@of("balance-wheel")
def test_an_escapement_tends_to_its_limit_cycle(result):
    # Of the speeds after kicks each is r times the one before, plus J/I.
    w, jump = 5 * np.pi, 8e-10 / 1.4e-9
    d = w / 400
    w1 = np.sqrt(w * w - d * d)
    r = np.exp(-np.pi * d / w1)
    rows = np.flatnonzero(np.diff(result.t) == 0.0) + 1
    after = np.abs(result["theta_dot"][rows])
    # From rest at 3.5 to 0: a damped oscillation, by its phase.
    quarter = (np.pi / 2 + np.arcsin(d / w)) / w1
    first = 3.5 * w * np.exp(-d * quarter) + jump
    last = jump / (1 - r)
    assert len(rows) == 300
    n = np.arange(300)
    assert np.allclose(after, last + (first - last) * r**n, **CLOSE)
    assert np.allclose(result.t[rows], quarter + n * np.pi / w1, **CLOSE)
    assert np.ptp(result["energy"] - result["work"]) < 1e-9 * result["energy"].max()


@of("stick-slip-by-a-spring")
def test_a_block_on_a_spring_sticks_and_slips(result):
    w, loose = np.sqrt(10.0), 3.0 / (10.0 * 0.5)
    last = 2 / w * (np.pi - np.arctan(w * (3.0 - 1.0) / (10.0 * 0.5)))
    times = [e.time for e in result.events]
    assert times[:2] == pytest.approx([loose, loose + last], abs=1e-10)
    k = int(np.searchsorted(result.t, loose + last)) + 1
    pull = 10.0 * (0.5 * (loose + last) - result["x"][k])
    assert pull == pytest.approx(2 * 1.0 - 3.0, abs=1e-9)


@of("block-on-a-slope")
def test_a_block_sticks_on_a_slope(result):
    slope = np.radians(15)
    weight, rubs = np.sin(slope), 0.4 * np.cos(slope)
    stops = 3.0 / (G * (weight + rubs))
    [event] = result.events
    assert (event.kind, event.constraint) == ("stick", "friction")
    assert event.time == pytest.approx(stops, rel=1e-9)
    later = result.t > stops
    assert np.allclose(result["x"][later], 3.0 * stops / 2, **CLOSE)
    assert np.allclose(result["lambda_friction"][later], 2 * G * weight, **CLOSE)
    assert np.allclose(result["lambda_friction"][~later], -2 * G * rubs, **CLOSE)


@of("dropped-ball")
def test_a_dropped_ball_comes_to_rest(result):
    first = np.sqrt(2 / G)
    times = [event.time for event in result.events if event.kind == "impact"]
    assert np.allclose(times[:3], first * np.array([1, 2, 2.5]), rtol=1e-10)
    [rest] = [event.time for event in result.events if event.kind == "zeno"]
    assert rest == pytest.approx(first * 3, rel=1e-9)
    assert np.allclose(result["lambda_floor"][result.t > rest], 0.5 * G, **CLOSE)


@pytest.mark.slow
@of("hanging-chain")
def test_a_chain_swings_in_its_lowest_mode(result):
    zeros, _ = roots_laguerre(3)
    mode = 1e-4 * np.cos(np.sqrt(zeros[0] * G / 0.3) * result.t)
    # Amplitude s changes the rate by (s/l)^2/16, and the other modes no more.
    tolerance = 1e-4 * (1e-4 / 0.3) ** 2 * np.sqrt(G / 0.3) * 10
    assert np.allclose(result["x3"], mode, rtol=0, atol=tolerance)
    assert np.allclose(result["lambda_link1"], -3 * 0.1 * G, rtol=1e-6)


@pytest.mark.slow
@of("tumbling-body")
def test_a_body_tumbles(result):
    one, two, three = 1.0, 2.0, 3.0
    w1, w3 = 3.0, 2.0
    energy = one * w1**2 + three * w3**2  # twice the energy
    spin = (one * w1) ** 2 + (three * w3) ** 2
    assert spin > energy * two
    low, high = energy * three - spin, spin - energy * one
    rate = np.sqrt((three - two) * high / (one * two * three))
    m = (two - one) * low / ((three - two) * high)
    sn, cn, dn, _ = ellipj(rate * result.t, m)
    assert np.allclose(result["w1"], np.sqrt(low / (one * (three - one))) * cn, **CLOSE)
    assert np.allclose(result["w2"], np.sqrt(low / (two * (three - two))) * sn, **CLOSE)
    top = np.sqrt(high / (three * (three - one)))
    assert np.allclose(result["w3"], top * dn, **CLOSE)


def test_each_recipe_is_held_against_its_formula():
    assert set(MODELS) == HELD


@pytest.mark.slow
def test_one_problem_in_several_tools():
    """docs/coming-from.md: its output of lagsim, and agreement with scipy's text."""
    (model,) = (b.text for b in blocks("docs/coming-from.md") if b.kind == "yaml")
    result = lagsim.simulate(lagsim.load(model), error_bar="never")
    page = (ROOT / "docs/coming-from.md").read_text("utf-8")
    script = next(t for b in blocks("docs/coming-from.md") if "scipy" in (t := b.text))
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(script, "coming-from", "exec"), {})
    assert abs(result["theta"][-1] - float(printed.getvalue())) < 1e-9
    assert f"it is {result['theta'][-1]:.9f}." in page
    assert len([e for e in result.events if e.kind == "impact"]) == 2


@pytest.mark.slow
@of("frame-of-one-storey")
def test_a_frame_answers_a_record(result):
    # Exactly between the points: x = (u, u', a, a') has constant coefficients.
    w, zeta, t = 10.0, 0.05, result.t
    points = [(0.0, 0.0), (0.1, 1.5), (0.3, -2.0), (0.4, 0.0), (4.0, 0.0)]
    rates = np.zeros((4, 4))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :3] = -w * w, -2 * zeta * w, -1.0
    x, u = np.zeros(2), np.zeros_like(t)
    for (a, begun), (b, ended) in itertools.pairwise(points):
        state = np.array([*x, begun, (ended - begun) / (b - a)])
        inside = np.flatnonzero((t >= a - 1e-12) & (t <= b + 1e-12))
        u[inside] = [(expm(rates * (t[k] - a)) @ state)[0] for k in inside]
        x = (expm(rates * (b - a)) @ state)[:2]
    assert np.allclose(result["u"], u, **CLOSE)
    felt = -(w**2) * result["u"] - 2 * zeta * w * result["u_dot"]
    assert np.allclose(result["felt"], felt, **CLOSE)


def swings(times, c, tau, start):
    """Return the angle of a pendulum with dry friction, swing by swing, by scipy."""
    inertia, weight = 0.5 * 0.8**2, 0.5 * G * 0.8
    y, t, sign, found = [start, 0.0], 0.0, -1.0, np.empty_like(times)
    while t < times[-1]:

        def rhs(_t, y, sign=sign):
            return [y[1], (-weight * np.sin(y[0]) - c * y[1] - tau * sign) / inertia]

        def turns(_t, y):
            return y[1]

        turns.terminal, turns.direction = True, -sign
        one = solve_ivp(
            rhs, (t, times[-1]), y, "DOP853", rtol=1e-12, atol=1e-13, events=turns,
            dense_output=True,
        )  # fmt: skip
        own = (times >= t) & (times <= one.t[-1])
        found[own] = one.sol(times[own])[0]
        y, t, sign = [one.y[0, -1], 0.0], one.t[-1], -sign
    return found


def test_the_swings_of_a_pendulum_with_friction():
    # The data of the recipe are those that its text states, to the last digit.
    path = ROOT / "models/pendulum-friction.csv"
    times, angles = np.loadtxt(path, delimiter=",", skiprows=4).T
    exact = np.degrees(swings(times, 0.012, 0.03, 0.52))
    noise = np.random.default_rng(1).normal(0, 0.3, len(times))
    assert np.allclose(angles, exact + noise, rtol=0, atol=0.00501)


@pytest.mark.slow
def test_the_friction_of_a_pendulum():
    found = lagsim.fit(
        ROOT / "models/pendulum-friction.yaml",
        ROOT / "models/pendulum-friction.csv",
        vary=["c", "tau", "theta"],
        match={"angle": "theta*180/pi"},
    )
    for name, value in (("c", 0.012), ("tau", 0.03), ("theta", 0.52)):
        low, high = found.parameters[name]["interval"]
        assert low < value < high
    assert found.noise["angle"] == pytest.approx(0.3, rel=0.15)
