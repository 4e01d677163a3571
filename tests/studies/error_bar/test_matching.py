"""Rows of two runs correspond by their number on the grid, whatever lies between."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lagsim.model.reader import read
from lagsim.run.observers.monitors import Checkpoints
from tests.small_scenes import oscillator
from tests.studies.judged import barred


def test_a_short_last_row():
    # Half a row: nearness would match it with the row before.
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 50*x^2}
initial: {x: 1}
simulation: {duration: 3.0001, output_step: 0.5, method: dop853}
"""
    kept, bar = barred(read(text, "m.yaml"))
    assert len(bar.times) == len(kept.rows) == 8
    assert bar.times[-1] == 3.0001
    true = np.abs(kept.rows[:, 1] - np.cos(10 * kept.rows[:, 0]))
    assert bar.errors[-1, 0] == pytest.approx(true[-1], rel=0.1)
    assert bar.relative < 1e-9


IMPACT = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 2*(x - y)^2}
constraints: {a: "x = abs(t - T)"}
parameters: {T: 1.005}
initial: {x: T, y: T, x_dot: -1, y_dot: -1}
simulation: {duration: 3, output_step: 0.25}
"""


@pytest.mark.parametrize("moment", ["1.005", "1", "0.1"])
def test_impacts(moment):
    """A wall that turns back: y + T - t swings, until then at rest beside x."""
    kept, bar = barred(read(IMPACT.replace("1.005", moment), "m.yaml"))
    t, T = kept.rows[:, 0], float(moment)
    w = 2.0  # y'' = -4 (y - x)
    after = np.maximum(t - T, 0.0)
    # After it y - x is an oscillation that begins with the speed -2.
    y = np.abs(t - T) - np.where(t > T, 2.0 / w * np.sin(w * after), 0.0)
    assert np.max(np.abs(kept.rows[:, 2] - y)) < 1e-10
    assert len(bar.times) == len(set(bar.times)) == 13
    assert bar.relative < 1e-10
    assert bar.horizon is None


def test_rows_between_the_grid_are_not_kept():
    kept = Checkpoints(1, SimpleNamespace(start=0.0, output_step=0.1))
    t = np.array([0, 0.1, 0.2, 0.23, 0.23, 0.30000000000000004, 0.4, 0.43])
    kept.add(np.column_stack([t, 10 * t, 0 * t]))
    assert list(kept.states) == [0, 1, 2, 3, 4]
    assert kept.rows[:, 0].tolist() == [0, 0.1, 0.2, 0.30000000000000004, 0.4, 0.43]


def test_numbers_stay_right_where_rows_are_thinned_after_an_impact():
    kept = Checkpoints(1, SimpleNamespace(start=0.0, output_step=1.0))
    t = np.sort(np.concatenate([np.arange(20_000.0), [7.25, 7.25, 9.5, 9.5]]))
    for block in np.array_split(np.column_stack([t, t, 0 * t]), 13):
        kept.add(block)
    assert kept.stride > 1
    assert all(number == row[0] for number, row in kept.states.items())
    assert all(number % kept.stride == 0 for number in kept.states)


def test_many_rows_are_compared_with_rows_of_the_same_times():
    text = oscillator("duration: 100, output_step: 0.003, method: dop853, rtol: 1e-7")
    kept, bar = barred(read(text, "m.yaml"))
    assert kept.stride > 1
    true = np.max(np.abs(kept.rows[:, 1] - np.cos(kept.rows[:, 0])))
    assert bar.coordinates["x"].largest == pytest.approx(true, rel=0.1)


def test_an_end_that_the_repeat_does_not_confirm():
    # Narrow: 0.02 wide, passed within a hundredth of a second, if it is seen at all.
    simulation = 'duration: 10, output_step: 0.01, method: dop853, until: "x >= 0.5"'
    text = oscillator(simulation, x=0, v=1)
    kept, bar = barred(read(text, "m.yaml"))
    assert kept.rows[-1, 0] == pytest.approx(np.arcsin(0.5), abs=1e-9)
    assert bar.times[-1] == kept.rows[-1, 0]
    assert bar.parted == ""
    assert bar.relative < 1e-9
