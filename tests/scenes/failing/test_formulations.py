"""Constraints without projection: drift, and the cost of a penalty."""

import itertools

import numpy as np
import pytest

from lagsim.run.trajectory import Outcome
from tests.support import run

# RK4 on the pendulum in Cartesian coordinates: about 240 steps a period, so that the
# constraint stays far below its scale.
STEP = 0.01


def worst_residual(formulation, duration, **options):
    options |= {"formulation": formulation, "duration": duration}
    found = run("pendulum-cartesian", method="rk4", step=STEP, **options)
    assert found.trajectory.outcome is Outcome.DONE
    return np.max(np.abs(found["residual_rod"]))


@pytest.mark.slow
def test_drift_grows_with_the_square_of_time():
    # g'' = 0 holds but for local errors: they add up in g', and g' adds up in g.
    worst = [worst_residual("drift", duration) for duration in (20, 40, 80)]
    for before, after in itertools.pairwise(worst):
        # The motion is periodic, so the square is met closely: 4.00 and 4.00.
        assert 3.8 < after / before < 4.2
    assert worst[0] > 1e-4


def test_projection_does_not_drift():
    # x^2 + y^2 = 1 to two units in the last place, at any time.
    assert worst_residual("projection", 20) <= 4.5e-16
    assert worst_residual("projection", 80) <= 4.5e-16


@pytest.mark.slow
def test_a_penalty_bounds_the_drift_and_never_removes_it():
    # g'' + 2 a g' + a^2 g = local errors per step: bounded by about those over a^2.
    short, long = (worst_residual("baumgarte", T, gain=10) for T in (20, 80))
    assert long == pytest.approx(short, rel=0.05)
    assert 1e-9 < long < 1e-2 * worst_residual("drift", 80)


def test_a_penalty_holds_a_constant_drift_at_its_balance():
    """Euler's method leaves -h^2 of t^2 a step, which both terms of the gain return.

    In steps of h the residual g and its rate w obey w' = w - h (2 a w + a^2 g) and
    g' = g + h w - h^2: at rest w = h, g = -2 h/a. Of a rate alone, -h/a is left.
    """
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
constraints: {place: x = t^2, speed: y_dot = t^2}
initial: {x: 0, y: 0}
simulation: {duration: 10, output_step: 10, method: euler}
"""
    found = run(text, step=STEP, formulation="baumgarte", gain=5)
    left = found["x"][-1] - 100.0, found["y_dot"][-1] - 100.0
    assert left == pytest.approx((-2.0 * STEP / 5.0, -STEP / 5.0), rel=1e-9)


@pytest.mark.slow
def test_a_tuned_gain_beats_drift_and_a_large_one_does_not():
    """Andrews' mechanism at equal evaluations; projection is best of all."""
    exact = run("andrews", formulation="projection", rtol="1e-13")

    def error(**options):
        found = run("andrews", method="rk4", step="1.5e-5", **options)
        assert found.trajectory.statistics.evaluations == 8001
        names = found.equations.q
        return max(
            np.max(np.abs(found[q] - exact[q])) / np.ptp(exact[q]) for q in names
        )

    drift = error(formulation="drift")
    tuned = min(error(formulation="baumgarte", gain=gain) for gain in (300, 1000))
    large = error(formulation="baumgarte", gain=30000)
    projected = error(formulation="projection")
    assert tuned < 0.3 * drift  # measured: 0.12
    assert large > 3.0 * drift  # measured: 10
    assert projected < 0.3 * tuned  # measured: 0.05


def test_a_large_gain_is_paid_for_in_steps():
    # DOP853 on g'' + 2 a g' + a^2 g = 0 is stable for a h up to about 6, so that 12
    # evaluations go no further than 6/a; a natural step is 0.04 s.
    gain, duration = 1e4, 0.5
    asked = {"gain": gain, "duration": duration, "output_step": 0.01}
    costs = {
        name: run(
            "pendulum-cartesian", formulation=name, rtol="1e-8", method="dop853",
            **asked,
        ).trajectory.statistics.evaluations
        for name in ("baumgarte", "projection")
    }  # fmt: skip
    assert costs["baumgarte"] > 12 * gain * duration / 7
    assert costs["projection"] < 1e-2 * costs["baumgarte"]


@pytest.mark.slow
def test_a_gain_of_a_hundred_thousand_takes_ten_million_evaluations():
    found = run(
        "pendulum-cartesian", formulation="baumgarte", gain=1e5, rtol="1e-8",
        method="dop853",
    )  # fmt: skip
    assert found.trajectory.outcome is Outcome.DONE
    assert found.trajectory.statistics.evaluations > 1e7
