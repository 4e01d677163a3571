"""The error bar: its estimate, its scales, rows that are compared, means and costs."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mpmath import mp, mpf

from lagsim.model.reader import read_file
from lagsim.run.error import TIMES, ErrorBar, Failed
from lagsim.run.interrupt import MOST_STEPS
from lagsim.run.observers.monitors import Checkpoints
from lagsim.run.trajectory import Outcome
from lagsim.studies import attempts
from lagsim.studies.repeats import (
    LOOSER,
    Allowance,
    Repeat,
    by_other_means,
    tightened,
)
from lagsim.studies.trial import Compiled
from tests.scenes.reference import PROBLEMS, TWO_SIDED, model_text, states
from tests.small_scenes import oscillator, pendulum, scene, swing
from tests.studies.judged import barred, made, repeated
from tests.support import MODELS, run


def shipped(name, **options):
    return read_file(str(MODELS / f"{name}.yaml"), options=options)


PENDULUM = pendulum(2, "duration: 60, output_step: 0.1")


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"rtol": "1e-5"},
        {"rtol": "1e-9"},
        {"rtol": "1e-8", "atol": "1e-8"},
        {"method": "rk4", "step": "0.02"},
        {"method": "rk4", "step": "0.05"},
    ],
)
def test_estimate_of_a_pendulum(options):
    kept, bar = barred(PENDULUM, **options)
    rows = kept.rows
    true = np.abs(rows[:, 1] - swing(rows[:, 0], 2.0))
    assert bar.scales == pytest.approx([4.0], rel=1e-2)  # from -2 to 2
    # The repeat's own error is a hundredth, or far less.
    assert np.max(bar.errors) == pytest.approx(np.max(true), rel=0.1)
    assert bar.horizon is None
    times, reached = zip(*bar.growth, strict=True)
    assert times[-1] == 60.0
    assert len(times) == TIMES
    assert list(reached) == sorted(reached)


def compared(name, rtol):
    """Return (estimated, true, trusted) for each reference state of a problem."""
    # Rows between the reference times too, for the ranges.
    text = model_text(name).replace('output_step: "', 'output_step: "1/40*')
    kept, bar = barred(text, rtol=rtol, always=True)
    trusted = sorted(PROBLEMS[name]["reference"], key=lambda r: float(r["t_value"]))
    found = []
    for state, reference in zip(states(name), trusted, strict=True):
        k = int(np.argmin(np.abs(bar.times - state.t)))
        row = kept.rows[np.argmin(np.abs(kept.rows[:, 0] - state.t))]
        assert bar.times[k] == row[0] == pytest.approx(state.t, rel=1e-12)
        off = np.abs(row[1:] - list(state.q.values()))
        # Of what rests but for rounding no digit is known.
        moving = bar.scales > 1e-6 * np.max(bar.scales)
        true = np.max(off[moving] / bar.scales[moving])
        estimated = np.max(bar.errors[k][moving] / bar.scales[moving])
        found.append((estimated, true, 10.0 ** -float(reference["digits_trusted"])))
    return found


@pytest.mark.parametrize(
    "rtol", [pytest.param(r, marks=pytest.mark.slow) for r in ("1e-7", "1e-9", "1e-11")]
)
def test_estimates_of_the_reference_problems(rtol):
    """Within a factor 10 in 95 % of the cases in which the true error is known."""
    good = counted = 0
    for name in TWO_SIDED:
        for estimated, true, trusted in compared(name, rtol):
            if true > max(1e-13, trusted):
                counted += 1
                good += 0.1 * true <= estimated <= 10.0 * true
    assert counted >= 15
    assert good >= 0.95 * counted


def test_horizon_of_the_double_pendulum():
    kept, bar = barred(shipped("double-pendulum", duration="40"))
    # Published for this start: 2e-4 at 20 s and O(1) at 25 s at a tolerance of 1e-14.
    assert 15.0 < bar.horizon < 26.0
    # It is the first row off by a tenth of the range.
    before = bar.times < bar.horizon
    assert np.all(bar.parts[before] <= 0.1)
    assert np.max(bar.parts[np.sum(before)]) > 0.1
    ranges = np.ptp(kept.rows[:, 1:], axis=0)
    assert np.allclose(bar.scales, ranges, rtol=1e-3)


@pytest.mark.slow
def test_what_should_stay_at_rest_has_no_horizon():
    # y is 0 but for rounding: its range is rounding too, and says nothing.
    lasting = {"duration": 200, "output_step": 0.5}
    potential = "(x^2 + y^2)/2 + 0.1*x*y*(x - y)"
    assert barred(scene("x: 0, y: 0", potential), **lasting)[1].relative == 0.0
    bar = barred(scene("x: 1, y: 1e-30", "(x^2 + y^2)/2"), **lasting)[1]
    assert bar.horizon is None
    assert bar.relative < 1e-8


def test_the_budget_is_counted_in_operations(monkeypatch):
    model = shipped("elastic-pendulum")
    monkeypatch.setattr("lagsim.studies.repeats.BUDGET", 1e4)
    assert "operations" in barred(model)[1]
    assert isinstance(barred(model, always=True)[1], ErrorBar)


@pytest.mark.slow
def test_units_do_not_matter():
    text = scene(
        "a: 2, b: S", "-cos(a) + (b/S)^2/2", "a_dot^2/2 + b_dot^2/2/S^2",
        parameters="S: 1",
    )  # fmt: skip
    small, one, large = (
        barred(text, values={"S": S}, duration=60, output_step=0.1)[1].parts[-1]
        for S in ("1e-3", "1", "1e6")
    )
    assert np.allclose(small, one, rtol=0.5, atol=1e-14)
    assert np.allclose(large, one, rtol=0.5, atol=1e-14)


def test_a_run_that_ends_by_itself_is_compared_as_far_as_both_go():
    text = PENDULUM.replace("output_step: 0.1", 'output_step: 0.1, until: "a <= -1"')
    kept, bar = barred(text, rtol=1e-6)
    assert len(bar.times) >= len(kept.rows) - 1
    assert math.isfinite(bar.relative)


def test_a_repeat_that_is_not_valid_itself_says_nothing(monkeypatch):
    judged = []

    def finding_text(run):
        judged.append(run.plan.rtol)
        assert run.monitor.end == run.trajectory.end == 60.0
        return texts[len(judged) - 1]

    monkeypatch.setattr("lagsim.studies.attempts.finding_text", finding_text)
    texts = ["it lost energy", ""]
    bar = barred(PENDULUM)[1]
    assert judged == pytest.approx([1e-13, 1e-11 / LOOSER])
    assert (bar.rtol, bar.horizon) == (judged[1], None)
    texts += 9 * ["lost"]
    assert "not valid itself: lost" in barred(PENDULUM)[1]


# Rows that correspond


def test_a_short_last_row():
    # Half a row: nearness would match it with the row before.
    text = scene("x: 1", "50*x^2")
    kept, bar = barred(text, duration=3.0001, output_step=0.5, method="dop853")
    assert len(bar.times) == len(kept.rows) == 8
    assert bar.times[-1] == 3.0001
    true = np.abs(kept.rows[:, 1] - np.cos(10 * kept.rows[:, 0]))
    assert bar.errors[-1, 0] == pytest.approx(true[-1], rel=0.1)
    assert bar.relative < 1e-9


@pytest.mark.parametrize("T", [1.005, 1.0, 0.1])
def test_impacts(T):
    """A wall that turns back: y + T - t swings, until then at rest beside x."""
    start, wall = "x: T, y: T, x_dot: -1, y_dot: -1", 'a: "x = abs(t - T)"'
    text = scene(start, "2*(x - y)^2", constraints=wall, parameters="T: 0")
    kept, bar = barred(text, values={"T": T}, duration=3, output_step=0.25)
    t, w = kept.rows[:, 0], 2.0  # y'' = -4 (y - x)
    after = np.maximum(t - T, 0.0)
    # After it y - x is an oscillation that begins with the speed -2.
    y = np.abs(t - T) - np.where(t > T, 2.0 / w * np.sin(w * after), 0.0)
    assert np.max(np.abs(kept.rows[:, 2] - y)) < 1e-10
    assert len(bar.times) == len(set(bar.times)) == 13
    assert bar.relative < 1e-10
    assert bar.horizon is None


def test_rows_between_the_grid_are_not_kept():
    one = SimpleNamespace(q=("q",), state_columns=[0, 1, 2])
    kept = Checkpoints(one, SimpleNamespace(start=0.0, output_step=0.1))
    t = np.array([0, 0.1, 0.2, 0.23, 0.23, 0.30000000000000004, 0.4, 0.43])
    kept.add(np.column_stack([t, 10 * t, 0 * t]))
    assert list(kept.states) == [0, 1, 2, 3, 4]
    assert kept.rows[:, 0].tolist() == [0, 0.1, 0.2, 0.30000000000000004, 0.4, 0.43]


def test_many_rows_are_compared_with_rows_of_the_same_times():
    asked = {"duration": 100, "output_step": 0.003, "method": "dop853", "rtol": 1e-7}
    kept, bar = barred(oscillator(), **asked)
    assert kept.stride > 1
    true = np.max(np.abs(kept.rows[:, 1] - np.cos(kept.rows[:, 0])))
    assert bar.coordinates["x"].largest == pytest.approx(true, rel=0.1)


def test_an_end_that_the_repeat_does_not_confirm():
    # Narrow: 0.02 wide, passed within a hundredth of a second, if it is seen at all.
    text = oscillator('until: "x >= 0.5"', x=0, v=1)
    kept, bar = barred(text, duration=10, output_step=0.01, method="dop853")
    assert kept.rows[-1, 0] == pytest.approx(np.arcsin(0.5), abs=1e-9)
    assert bar.times[-1] == kept.rows[-1, 0]
    assert bar.parted == ""
    assert bar.relative < 1e-9


# What errors are measured by


@pytest.mark.slow
def test_a_light_body_does_not_hide_behind_a_heavy_one():
    # In the metric of M one part in a million of y would be 1e18 times the range of x.
    text = scene(
        "x: 2, y: R", "m*(1 - cos(x)) + M*y^2/2", "(m*x_dot^2 + M*y_dot^2)/2",
        parameters="m: 1e-3, M: 1e27, R: 0",
        simulation="duration: 30, output_step: 0.1, method: rk4, step: 0.05",
    )  # fmt: skip
    parts = [barred(text, values={"R": R})[1].parts[:, 0] for R in (0, 1e9)]
    assert np.max(parts[0]) > 1e-8
    assert np.max(parts[1]) == pytest.approx(np.max(parts[0]), rel=1e-6)


@pytest.mark.parametrize("M", ["1e-6", "1", "1e12"])
def test_what_stays_still_beside_a_motion_has_no_horizon(M):
    # z is off by rounding only, and its range is rounding, too.
    kinetic = f"({M}*x_dot^2 + z_dot^2)/2"
    text = scene("x: 1, z: 1e-14", f"{M}*x^2/2 + z^2", kinetic)
    bar = barred(text, duration=100, output_step=0.5, method="dop853")[1]
    assert bar.horizon is None


@pytest.mark.parametrize("step", ["1", "2", "3", "6.5"])
@pytest.mark.parametrize("method", ["auto", "taylor", "dop853", "radau"])
def test_rows_in_phase_with_the_motion_are_no_scale(step, method):
    # x = sin(2 pi t): of rows a period apart, or half of one, the range is rounding.
    asked = {"method": method, "output_step": step, "rtol": 1e-9, "duration": 13}
    bar = barred(scene("x: 0, x_dot: 2*pi", "2*pi^2*x^2"), **asked)[1]
    assert bar.scales == pytest.approx([2.0], rel=0.1)
    assert bar.relative < 1e-6
    assert bar.horizon is None


@pytest.mark.slow
def test_a_place_far_away_is_no_scale():
    asked = {"duration": 20, "output_step": 0.1, "method": "dop853"}

    def told(L, rtol=1e-6):
        return barred(scene(f"x: {L} + 2", f"-cos(x - {L})"), rtol=rtol, **asked)[1]

    assert told(0).scales == pytest.approx(told(4096).scales, rel=1e-3)
    # What rounding alone makes of the place is told, too.
    assert told(4096, 1e-13).coordinates["x"].largest >= 4096 * 2.0**-53


@pytest.mark.parametrize("L", [1e-9, 1.0, 1e6])
def test_what_rows_keep_at_rest_is_told_as_a_part_of_what_it_is_linked_with(L):
    # A pendulum in the plane x = 0, on which a row holds it that knows the other two:
    # what a double loses of these is all that x has.
    rows = "rod: x^2 + y^2 + z^2 = L^2, plane: x = 0.25*(x^2 + y^2 + z^2 - L^2)/L"
    start, lasting = "x: 0, y: 0.6*L, z: -0.8*L", {"method": "dop853"}
    lasting |= {"duration": "5*sqrt(L)", "output_step": "0.1*sqrt(L)"}
    text = scene(start, "9.81*z", constraints=rows, parameters=f"L: {L}")
    bar = barred(text, **lasting)[1]
    told = bar.coordinates["x"]
    assert told.largest < 1e-14 * L
    assert told.relative < 1e-12
    assert bar.scales[1] == pytest.approx(1.2 * L, rel=1e-2)


def test_a_small_motion_is_not_hidden_by_what_it_is_linked_with():
    # y = z^2 is 1e-10 of the way of z, a motion of its own, thousands of roundings.
    path = "path: y = 1e-10*z^2"
    text = scene("y: 1e-10, z: 1", "z^2/2", constraints=path)
    bar = barred(text, duration=10, output_step=0.1, method="dop853")[1]
    assert bar.scales[0] < 1e-8


def test_what_rests_at_its_place_is_told_as_a_part_of_that():
    # Rounding of its value alone, beside what moves ten times as far.
    text = scene("x: 1, y: 0", "9.81*y")
    bar = barred(text, duration=1.4, output_step=0.1, method="dop853")[1]
    told = bar.coordinates["x"]
    assert 0.0 < told.largest < 1e-15
    assert told.relative < 1e-15


# Other means

TIGHT = ("1e-13", "2e-14", "1e-14", "5e-15", "2e-15")


@pytest.mark.parametrize("rtol", ["1e-4", "1e-6", "1e-9", "1e-11", *TIGHT])
@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_tolerances_of_repeats_differ(method, rtol):
    session, trajectory, _ = made(PENDULUM, method=method, rtol=rtol)
    ways = list(by_other_means(session, trajectory, Compiled()))
    assert len(ways) >= 2
    for way in ways:
        parts = way.session.plan.rtol / float(rtol), float(rtol) / way.session.plan.rtol
        assert max(parts) >= 0.999 * LOOSER
    # The last cannot take the run's steps, whatever the tolerance makes of them.
    mean = trajectory.end / trajectory.statistics.steps
    assert ways[-1].session.longest_step < 0.5 * mean


@pytest.mark.parametrize(
    ("method", "others"),
    [
        # No feature of a pendulum can be missed: other steps of a series will do.
        ("taylor", ["taylor"] * 3),
        ("dop853", ["dop853"] * 3),
        ("radau", ["dop853", "radau"] * 2 + ["radau"]),
    ],
)
def test_repeats_are_by_another_method_or_by_other_steps(method, others):
    session, trajectory, _ = made(PENDULUM, method=method, rtol="1e-9")
    ways = by_other_means(session, trajectory, Compiled())
    assert [way.session.plan.method for way in ways] == others
    # An absolute tolerance alone becomes tighter by the factor itself.
    plan = replace(session.plan, rtol=0.0, atol=1e-8)
    assert tightened(plan, 10.0).atol == pytest.approx(1e-9, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("rtol", TIGHT)
@pytest.mark.parametrize(
    "name", ["andrews", "car-axis", "chain-angles", "chain-cartesian"]
)
def test_tight_tolerances_have_an_estimate_by_other_steps(name, rtol):
    model = shipped(name, rtol=rtol)
    bar = barred(model)[1]
    assert isinstance(bar, ErrorBar), bar
    # The errors of two motions by different steps differ by rounding, at least.
    assert 2.0**-52 < bar.relative < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("rtol", TIGHT)
def test_chaos_has_a_horizon_at_every_tolerance(rtol):
    """The Lyapunov exponent of about 1/s leaves no digit of rounding after 35 s."""
    bar = barred(shipped("double-pendulum", duration="40", rtol=rtol))[1]
    assert isinstance(bar, ErrorBar)
    assert 20.0 < bar.horizon < 35.0


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_run_is_no_repeat_of_itself(method, monkeypatch):
    options = {"method": method, "rtol": "1e-9"}
    session, trajectory, kept = made(PENDULUM, **options)

    def itself(session, _trajectory, _compiled):
        yield Repeat(session)

    monkeypatch.setattr(attempts, "by_other_means", itself)
    bar = repeated(session, trajectory, kept)
    assert isinstance(bar, Failed)
    assert "same steps as the run" in bar


@pytest.mark.parametrize("method", ["rk4", "euler", "verlet", "midpoint", "gauss4"])
def test_fixed_steps_are_repeated_by_others(method):
    options = {"method": method, "step": "0.05"}
    session, trajectory, _ = made(PENDULUM, **options)
    for way in by_other_means(session, trajectory, Compiled()):
        assert way.session.plan.method != method
        assert way.session.plan.rtol


def test_functions_of_repeats_of_fixed_steps_are_compiled_once():
    session, trajectory, _ = made(PENDULUM, method="rk4", step="0.05")
    compiled = Compiled()
    for _ in range(2):
        assert next(by_other_means(session, trajectory, compiled))
    assert len(compiled.known) == 1


# Costs, and rounded times

WAVE = scene(
    "x: 0",
    forces='x: "sign(sin(3*(t - T)))"',
    parameters="T: START",
    simulation="start: START, duration: 9, output_step: 0.25",
)


@pytest.mark.slow
def test_arcs_count_as_steps():
    whole = run(WAVE.replace("START", "0")).trajectory
    assert whole.statistics.arcs == 9  # half periods: 27/pi = 8.6
    count = whole.statistics.steps
    # Five arcs are all that the rest of the steps is worth.
    cut = run(
        WAVE.replace("START", "0"), most_steps=count + 5000, arc_steps=1000.0
    ).trajectory
    assert cut.outcome is Outcome.TOO_MANY_STEPS
    assert cut.statistics.arcs <= 6
    enough = run(
        WAVE.replace("START", "0"), most_steps=MOST_STEPS, arc_steps=1000.0
    ).trajectory
    assert enough.outcome is Outcome.DONE


def test_all_repeats_together_stay_within_the_allowance():
    found = run(PENDULUM)
    allowance = Allowance(found.system, found.trajectory)
    before = allowance.left
    price = Repeat(found.session)
    assert allowance.steps(price) > 1000
    allowance.take(price, found.trajectory)
    assert before > allowance.left > 0.0
    allowance.left = 0.0
    _, bar = barred(PENDULUM, allowance=allowance)
    assert bar.startswith("a repeat did not finish")


def exact(start, times):
    """Return the exact positions: parabolas between the zeros of the sine."""
    mp.dps = 40
    half, found = mp.pi / 3, []
    for time in times:
        left, x, v, sign = mpf(float(time)) - mpf(start), mpf(0), mpf(0), 1
        while left > 0:
            h = min(left, half)
            x, v = x + v * h + sign * h * h / 2, v + sign * h
            left, sign = left - h, -sign
        found.append(x)
    return found


@pytest.mark.parametrize("start", ["-537.3", "10000.1", "2000000.7"])
def test_times_of_switches_are_rounded_and_told(start):
    checkpoints, bar = barred(WAVE.replace("START", start))
    rows = checkpoints.rows
    truth = exact(float(start), rows[:, 0])
    off = max(
        abs(float(mpf(float(x)) - y)) for x, y in zip(rows[:, 1], truth, strict=True)
    )
    told = float(np.max(bar.errors))
    assert off > 1e-15  # the zeros of the sine are no doubles
    assert off < 30 * told
    assert told < 1000 * off
