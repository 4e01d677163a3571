"""Steps, and runs, of extreme lengths: an outcome or a fault, with any method."""

import pytest

from tests.support import refused, simulate

WELL = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2/2 + x^4}
initial: {x: 1}
simulation: {duration: 1, output_step: 0.5}
"""
FIXED = [
    "euler", "rk4", "midpoint", "gauss4", "generalized-alpha", "moreau", "verlet",
    "rattle", "kahan-li6", "kahan-li8",
]  # fmt: skip


@pytest.mark.parametrize("method", FIXED)
def test_a_step_longer_than_the_run_is_the_run(method):
    found = simulate(WELL, method=method, step=1e300)
    same = simulate(WELL, method=method, step=1)
    assert found.record["step"] == 1
    assert found.record["steps"] == same.record["steps"] == 1
    assert (found.table == same.table).all()


@pytest.mark.parametrize("step", ["1e-16", "1e-300", "5e-324"])
def test_steps_that_would_take_for_ever_are_refused(step):
    with refused("out-of-range", "`step`", "100,000,000"):
        simulate(WELL, method="rk4", step=step)


def test_a_run_that_ends_by_a_condition_may_have_short_steps():
    text = WELL.replace("output_step: 0.5", "output_step: 0.5, until: x <= 1 - 1e-12")
    found = simulate(text, method="rk4", step=1e-9)
    # x'' = -5 at the start.
    assert found.t[-1] == pytest.approx((0.4e-12) ** 0.5, rel=1e-3)


@pytest.mark.parametrize("method", [*FIXED, "dop853", "taylor", "radau"])
@pytest.mark.parametrize("duration", [1e-100, 1e300])
def test_runs_of_extreme_lengths_end(method, duration):
    step = {"step": duration / 2} if method in FIXED else {}
    found = simulate(
        WELL, method=method, duration=duration, output_step=duration / 2, **step
    )
    if duration < 1:
        assert found.complete
        assert found["x"][-1] == 1
