"""Scenes that are hard on the solver: rows that lose rank, loads that are balanced."""

import numpy as np
import pytest

from lagsim.run.events import constraints
from lagsim.run.trajectory import Outcome
from tests.scenes.exact.switches import SCENES
from tests.small_scenes import NEARLY, expected_times
from tests.support import run

# Mechanisms near singular positions


@pytest.mark.parametrize("duration", [1.0999, 2.0])
@pytest.mark.parametrize("method", [", method: dop853", ", method: rk4, step: 0.003"])
def test_rows_that_nearly_lose_their_independence_are_solved_by_loops(duration, method):
    # dz and dz - (1.1 - x) dy: the angle between the rows falls to zero at x = 1.1,
    # where rank is lost for a moment. x = t, y = z = 0 is the motion all the way, and
    # the clock makes the steps short.
    text = NEARLY.replace("DURATION", str(duration)).replace("METHOD", method)
    found = run(text)
    assert found.plan.elimination is not None
    assert found.trajectory.outcome is Outcome.DONE
    assert "nearly-dependent" in [w.code for w in found.trajectory.warnings]
    # Rows within the step after which the solver changed are interpolated, too.
    assert list(found["t"]) == expected_times(0.0, duration, 0.01)
    assert np.max(np.abs(found["x"] - found["t"])) < 1e-12
    assert np.max(np.abs(found["y"])) < 1e-12
    # rk4: (0.003*20)^4/120 a radian, 40 radians.
    clock = found["clock"] - np.cos(20.0 * found["t"])
    assert np.max(np.abs(clock)) < (1e-5 if method else 1e-9)


def test_where_loops_would_take_too_long_the_run_goes_on_without(monkeypatch):
    monkeypatch.setattr(constraints, "MOST_DENSE", 0)
    found = run(
        NEARLY.replace("DURATION", "1.099").replace("METHOD", ", method: dop853")
    )
    assert found.trajectory.outcome is Outcome.DONE
    codes = [w.code for w in found.trajectory.warnings]
    assert codes.count("nearly-dependent") == 1
    assert found.system.plan is found.plan
    # The rows are 1e-3 apart at the end: rounding is divided by the square of that.
    assert np.max(np.abs(found["x"] - found["t"])) < 1e-9


FOLDING = """
parameters: {r: 1, b: 2}
coordinates: {a: {}, c: {}}
energy: {kinetic: a_dot^2/2 + 3*c_dot^2/2, potential: 0}
constraints: {coupler: "(b + r*cos(c) - r*cos(a))^2 + (r*sin(c) - r*sin(a))^2 = b^2"}
initial: {a: 0.4, c: 0.4, a_dot: 1, c_dot: 1}
simulation: {duration: 7, output_step: 0.05}
"""


@pytest.mark.slow
def test_a_parallelogram_passes_its_dead_points():
    # Folded flat (a = c = 0 and pi) its two branches cross; 7 s pass three of those.
    # Cranks stay parallel, at a rate that T = 2 a'^2 keeps.
    found = run(FOLDING)
    assert found.trajectory.outcome is Outcome.DONE
    assert np.max(np.abs(found["a"] - 0.4 - found["t"])) < 1e-9
    assert np.max(np.abs(found["c"] - found["a"])) < 1e-9
    assert found.drift < 1e-9


@pytest.mark.parametrize("name", [n for n in SCENES if n.startswith("hangs")])
def test_a_load_on_a_hanging_pendulum_costs_few_steps_by_loops(name):
    found = run(SCENES[name].text, loops=True)
    assert found.trajectory.outcome is Outcome.DONE
    assert found.trajectory.statistics.steps < 300
    assert found.drift < 1e-12
