"""Reported errors of runs with impacts, against closed forms."""

import numpy as np
import pytest

import lagsim
from lagsim.cli.run import _error
from lagsim.run.observers.monitors import grid_numbers
from tests.scenes.contact import scenes
from tests.scenes.contact.motions import G, contact, scene
from tests.small_scenes import bounced, stopped
from tests.studies.error_bar.test_known import column, told_and_true, within
from tests.studies.judged import barred, made, repeated

FEW = [{}, {"rtol": "1e-5"}, {"method": "rk4", "step": "0.05"}]
MORE = [
    *({"rtol": rtol} for rtol in ("1e-3", "1e-8", "1e-13")),
    {"method": "euler", "step": "0.001"},
    {"method": "rattle", "step": "0.01"},
]


@pytest.mark.parametrize(
    "options", [*FEW, *(pytest.param(o, marks=pytest.mark.slow) for o in MORE)]
)
@pytest.mark.parametrize("e", [0.5, 0.8, 1.0])
def test_told_within_a_factor_30(e, options):
    ball = scenes.ball(e, duration=5, output_step=0.02)
    bar, told, true = told_and_true(ball, column(lambda t: bounced(t, e)), options)
    # Parabolas have no error but of rounding, where any of two roundings may be worse.
    assert within(told, true) or max(told, true) < 1e-13
    stop = scenes.oscillator("x >= -0.5", e, duration=20, output_step=0.02)
    bar, told, true = told_and_true(stop, column(lambda t: stopped(t, e)[0]), options)
    assert within(told, true)
    assert bar.horizon is None


BILLIARD = scene(
    "x y", "(x_dot^2 + y_dot^2)/2", "0",
    {
        "disc": contact("x^2 + y^2 >= 0.49", 1),
        **{f"w{k}": contact(wall, 1) for k, wall in
           enumerate(("x >= -1", "x <= 1", "y >= -1", "y <= 1"))},
    },
    {"x": 0.8, "y": 0.1, "x_dot": "cos(0.6)", "y_dot": "sin(0.6)"},
    duration=45, output_step=0.05,
)  # fmt: skip


@pytest.mark.slow
def test_impacts_that_part_exponentially_have_a_horizon():
    """A point between walls and a disc: Sinai's billiard; each flight is a line."""
    model = lagsim.load(BILLIARD)
    told = lagsim.simulate(model).record["error"]["horizon"]
    # The same from a start that is a thousand roundings away.
    runs = [
        lagsim.simulate(model.bind(x=x), error_bar="never") for x in (0.8, 0.8 + 1e-13)
    ]
    rows = []
    for run in runs:
        places = grid_numbers(run.t, 0.0, 0.05)
        rows.append(dict(zip(places.tolist(), run["x"].tolist(), strict=True)))
    apart = [k for k in rows[0] if k >= 0 and abs(rows[0][k] - rows[1][k]) > 0.2]
    parted = 0.05 * min(apart)
    # Both grow by the same rate, from 1e-13 and from the roundings of some impacts.
    assert parted / 2 < told < 2 * parted


@pytest.mark.parametrize("name", ["dome", "string", "freewheel", "belt", "oscillator"])
def test_a_moved_event_is_no_horizon(name):
    bar = barred(scenes.EVERY[name])[1]
    assert bar.horizon is None
    assert 0 < bar.relative < 1e-9  # GLOBAL of the scenes: what their tests demand
    assert not bar.rests


def test_an_impact_at_an_output_time_is_compared_after_it():
    # It falls for 0.5 s, and each flight takes 0.8 of the one before: 0.8, 0.64 ...
    text = scenes.ball(0.8, g=8, duration=1.3, output_step=0.05)
    kept, bar = barred(text)
    assert kept.states[10][2] == pytest.approx(0.8 * 4, rel=1e-12)
    assert kept.states[26][2] == pytest.approx(0.8**2 * 4, rel=1e-12)
    # Not 4 + 3.2, by a repeat that strikes a rounding later.
    assert np.max(bar.rates) < 1e-11


@pytest.mark.parametrize(
    "text",
    [
        scenes.ball(0.5, y=0, duration=1, output_step=0.1),
        scenes.legs(0.1, -0.2),
        scenes.incline(0.2, 0.5),
    ],
)
def test_what_constraints_hold_rests_and_says_so(text):
    bar = barred(text)[1]
    assert bar.rests
    assert bar.horizon is None
    assert bar.relative < 1e-13
    assert _error(bar).startswith("no coordinate moves; a repeat")


def test_a_motion_that_is_small_beside_its_forces_is_none_at_rest():
    # A bob that a string holds, drawn aside by 1e-9: gravity would take it 500 m.
    text = scenes.string(0).replace("x: 0", "x: 1e-9").replace("1.5", "10")
    assert "duration: 10" in text
    assert not barred(text)[1].rests


CORNERS = {"one": "h + a + b", "two": "h + a - b", "three": "h - a + b"}
FOURTH = {"four": "h - a - b"}
UNEVEN = {
    "one": "h + 0.3*a + 0.7*b", "two": "h + 0.9*a - 0.41*b",
    "three": "h - a + 0.11*b", "four": "h - 0.8*a - 0.77*b",
}  # fmt: skip


@pytest.mark.parametrize("height", ["z", "(z - 1000)"])
@pytest.mark.parametrize("corners", [CORNERS, CORNERS | FOURTH, UNEVEN])
def test_what_stands_on_legs_stays(corners, height):
    # Only the legs push what turns, with forces that balance but for rounding: no
    # motion to be controlled by, no range to be measured by.
    text = scene(
        "z a b", "(z_dot^2 + a_dot^2 + b_dot^2)/2", f"{G}*z",
        {k: contact(f"{e.replace('h', height)} >= 0", 0) for k, e in corners.items()},
        {"z": 1000 if "1000" in height else 0, "a": 0, "b": 0},
        duration=1, output_step=0.001,
    )  # fmt: skip
    session, trajectory, checkpoints = made(text)
    # Five steps without an error, which become ever longer; some more beside an end.
    assert trajectory.statistics.steps < 20
    bar = repeated(session, trajectory, checkpoints)
    assert not isinstance(bar, str), bar
    assert bar.rests
    assert bar.horizon is None
    assert np.max(np.abs(checkpoints.rows[:, 2:])) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("duration", "rtol"), [(1, 1e-11), (30, 1e-11), (30, 1e-9)])
def test_a_string_that_hangs_at_rest_does_not_move(duration, rtol):
    """Reactions balance the weights but for the rounding of the whole string."""
    text = f"""
parameters: {{n: 6, g: 9.81, d: 0.8}}
coordinates: {{"r(1..n)": {{components: xy}}}}
constraints:
  rod(i = 1..n-1): norm(r(i+1) - r(i)) = 1/(n+1)
  left: norm(r(1)) = 1/(n+1)
  right: norm(r(n) - vec(d, 0)) = 1/(n+1)
energy:
  kinetic: sum(i = 1..n, dot(r_dot(i), r_dot(i)))/2
  potential: g*sum(i = 1..n, r(i).y)
initial: {{"r(i = 1..n)": {{guess: "vec(i*d/(n+1), -0.2)"}}}}
simulation: {{begin: rest, duration: {duration}, output_step: 0.1, rtol: {rtol}}}
"""
    bar = barred(text)[1]
    assert bar.rests
    assert bar.horizon is None
