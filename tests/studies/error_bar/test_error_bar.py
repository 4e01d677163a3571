"""The estimated error of a run against its true one."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from lagsim.model.reader import read, read_file
from lagsim.run.error import TIMES, ErrorBar
from lagsim.run.observers.monitors import MOST_ROWS, Checkpoints
from lagsim.studies.error_bar import LOOSER
from tests.scenes.reference import PROBLEMS, TWO_SIDED, model_text, states
from tests.small_scenes import pendulum, swing
from tests.studies.judged import barred
from tests.support import MODELS


def shipped(name, **options):
    return read_file(str(MODELS / f"{name}.yaml"), options=options)


PENDULUM = pendulum(2, "duration: 60, output_step: 0.1")


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
    kept, bar = barred(read(PENDULUM, "m.yaml", options=options))
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
    """Give (estimated, true, trusted) for each reference state of a problem."""
    # Rows between the reference times too, for the ranges.
    text = model_text(name).replace('output_step: "', 'output_step: "1/40*')
    kept, bar = barred(read(text, "m.yaml", options={"rtol": rtol}), always=True)
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
    "rtol",
    [pytest.param(r, marks=pytest.mark.slow) for r in ("1e-7", "1e-9", "1e-11")],
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


def test_a_tighter_tolerance_moves_the_horizon():
    _, loose = barred(shipped("double-pendulum", duration="40", rtol="1e-6"))
    _, tight = barred(shipped("double-pendulum", duration="40"))
    assert loose.horizon < tight.horizon - 5.0


def test_what_should_stay_at_rest_has_no_horizon():
    # y is 0 but for rounding: its range is rounding too, and says nothing.
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: (x^2 + y^2)/2 + 0.1*x*y*(x - y)}
initial: {x: 1, y: 1}
simulation: {duration: 200, output_step: 0.5}
"""
    rest = text.replace("x: 1, y: 1", "x: 0, y: 0")
    assert barred(read(rest, "m.yaml"))[1].relative == 0.0
    rotated = text.replace("y*(x - y)", "y*0").replace("y: 1", "y: 1e-30")
    _, bar = barred(read(rotated, "m.yaml"))
    assert bar.horizon is None
    assert bar.relative < 1e-8


def test_the_budget_is_counted_in_operations(monkeypatch):
    model = shipped("elastic-pendulum")
    monkeypatch.setattr("lagsim.studies.error_bar.BUDGET", 1e4)
    _, refused = barred(model)
    assert "operations" in refused
    _, asked = barred(model, always=True)
    assert isinstance(asked, ErrorBar)


def test_units_do_not_matter():
    text = PENDULUM.replace("a: {}", "a: {}, b: {}").replace(
        "a_dot^2/2, potential: -cos(a)", "a_dot^2/2 + b_dot^2/2/S^2, potential: -cos(a)"
    )
    text = text.replace("cos(a)", "cos(a) + (b/S)^2/2").replace("a: 2", "a: 2, b: S")
    parts = []
    for size in ("1e-3", "1", "1e6"):
        sized = "parameters: {S: " + size + "}" + text
        parts.append(barred(read(sized, "m.yaml"))[1].parts[-1])
    assert np.allclose(parts[0], parts[1], rtol=0.5, atol=1e-14)
    assert np.allclose(parts[2], parts[1], rtol=0.5, atol=1e-14)


def test_checkpoints_are_few_and_evenly_spaced():
    kept = Checkpoints(1, SimpleNamespace(start=0.0, output_step=1.0))
    rows = np.arange(100_000.0)[:, None] * [1.0, 2.0, 0.0]
    for block in np.array_split(rows, 77):
        kept.add(block)
    assert len(kept.rows) <= MOST_ROWS
    assert len(kept.rows) > MOST_ROWS / 3
    assert set(np.diff(kept.rows[:, 0])) == {float(kept.stride)}
    assert (kept.low[0], kept.high[0]) == (0.0, 199_998.0)


def test_a_run_that_ends_by_itself_is_compared_as_far_as_both_go():
    text = PENDULUM.replace("output_step: 0.1", 'output_step: 0.1, until: "a <= -1"')
    kept, bar = barred(read(text, "m.yaml", options={"rtol": "1e-6"}))
    assert len(bar.times) >= len(kept.rows) - 1
    assert math.isfinite(bar.relative)


def test_a_repeat_that_is_not_valid_itself_says_nothing(monkeypatch):
    judged = []

    def fault(run):
        judged.append(run.plan.rtol)
        assert run.monitor.end == run.trajectory.end == 60.0
        return texts[len(judged) - 1]

    monkeypatch.setattr("lagsim.studies.error_bar.fault", fault)
    texts = ["it lost energy", ""]
    bar = barred(read(PENDULUM, "m.yaml"))[1]
    assert judged == pytest.approx([1e-13, 1e-11 / LOOSER])
    assert (bar.rtol, bar.horizon) == (judged[1], None)
    texts += 9 * ["lost"]
    assert "not valid itself: lost" in barred(read(PENDULUM, "m.yaml"))[1]
