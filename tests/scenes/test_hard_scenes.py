"""Scenes that are hard on the solver: rows that lose rank, forces that cancel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lagsim.run.events import singularities
from lagsim.run.trajectory import Outcome
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
    monkeypatch.setattr(singularities, "MOST_DENSE", 0)
    found = run(
        NEARLY.replace("DURATION", "1.099").replace("METHOD", ", method: dop853")
    )
    assert found.trajectory.outcome is Outcome.DONE
    (warning,) = [w for w in found.trajectory.warnings if w.code == "nearly-dependent"]
    assert "too many for a QR" in warning.text
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


def test_a_parallelogram_passes_its_dead_points():
    # Folded flat (a = c = 0 and pi) its two branches cross; 7 s pass three of those.
    # Cranks stay parallel, at a rate that T = 2 a'^2 keeps.
    found = run(FOLDING)
    assert found.trajectory.outcome is Outcome.DONE
    assert np.max(np.abs(found["a"] - 0.4 - found["t"])) < 1e-9
    assert np.max(np.abs(found["c"] - found["a"])) < 1e-9
    assert found.drift < 1e-9


REST = """
parameters: {m: 1.3, g: 9.81, K: 37.7}
coordinates: {x: {}}
energy: {kinetic: m*x_dot^2/2, potential: K*x^2/2 - m*g*x}
forces: {x: "FORCE"}
initial: {x: "m*g/K*START"}
simulation: {duration: 10, output_step: 0.01}
"""


@pytest.mark.parametrize(
    ("force", "start"),
    [
        ("sin(t)", "1"),
        ("1e-6*sin(t)", "1"),
        ("1e-3*(1 - cos(t))", "1"),
        ("t^3", "1"),
        ("1e-6*t^3", "1"),
        ("if(t < 1, 0, 1e-3*(t - 1))", "1"),
        ("0", "1"),
        ("0", "(1 + 1e-9)"),
    ],
)
def test_small_motion_about_equilibrium_costs_few_steps(force, start):
    """Forces that cancel leave rounding, which step control must not chase.

    It stalled at t = 0 or took up to 7 million steps.
    """
    found = run(REST.replace("FORCE", force).replace("START", start), method="dop853")
    assert found.trajectory.outcome is Outcome.DONE
    # 8.6 periods in all, at some 30 steps each at most.
    assert found.trajectory.statistics.steps < 300
    assert found.trajectory.statistics.rejections < 30
    t, w = found["t"], math.sqrt(37.7 / 1.3)
    still = 1.3 * 9.81 / 37.7
    exact = {
        "sin(t)": (np.sin(t) - np.sin(w * t) / w) / (1.3 * (w * w - 1.0)),
        "1e-6*sin(t)": 1e-6 * (np.sin(t) - np.sin(w * t) / w) / (1.3 * (w * w - 1.0)),
    }
    if force in exact:
        # 1e-11 of the size of x, which is 0.34.
        assert np.max(np.abs(found["x"] - still - exact[force])) < 1e-11
    if start != "1":
        off = still * 1e-9 * np.cos(w * t)
        # A few units in the last place of x: three digits of the motion are left, six
        # of its amplitude.
        assert np.max(np.abs(found["x"] - still - off)) < 1e-14


HANGING = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {rod: x^2 + y^2 = 1}
forces: {x: "FORCE"}
initial: {x: 0, y: -1}
simulation: {duration: 10}
"""


@pytest.mark.parametrize("loops", [False, True])
@pytest.mark.parametrize("force", ["1e-3", "1e-3*sin(t)", "1e-6*sin(t)", "1e-6*t^3"])
def test_a_load_on_a_hanging_pendulum_costs_few_steps(force, loops):
    found = run(HANGING.replace("FORCE", force), loops=loops)
    assert found.trajectory.outcome is Outcome.DONE
    assert found.trajectory.statistics.steps < 300
    assert found.drift < 1e-12


def test_dry_friction_begins_from_rest():
    # At rest sign(0) = 0, and the force jumps as soon as the block moves: a jump that
    # is the same part of every first step, however short.
    result = run(
        """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
forces: {x: -0.3*sign(x_dot)}
initial: {x: 1}
simulation: {duration: 1.5}
"""
    )
    assert result.trajectory.outcome.complete
    # x'' = -4 x + 0.3 while it moves down, to t = pi/2. Stepping over the jump costs a
    # few hundred times the tolerance at most.
    exact = 0.075 + 0.925 * np.cos(2 * result["t"])
    assert np.max(np.abs(result["x"] - exact)) < 1e-8
    assert result.trajectory.statistics.rejections < 100
