"""The reported error of fixed steps, against closed forms, down to rounding."""

import numpy as np
import pytest
from scipy.special import ellipj

import lagsim
from tests.small_scenes import ellipse, on_ellipse, oscillator, scene

FEW = "duration: 20, output_step: 0.25"
SCENES = {
    # x'' = -x^3 from rest at 1 is cn(t, 1/2) (Abramowitz and Stegun, 16.1 and 16.16).
    "quartic": (
        scene("x: 1", "x^4/4", simulation=FEW), lambda t: ellipj(t, 0.5)[1]
    ),
    "kepler": (ellipse(0.5, FEW), lambda t: on_ellipse(t, 0.5)[0]),
    "spring": (oscillator("duration: 50, output_step: 0.25"), np.cos),
}  # fmt: skip


@pytest.mark.parametrize(
    "step", [0.05, *(pytest.param(h, marks=pytest.mark.slow) for h in (0.01, 0.002))]
)
@pytest.mark.parametrize(
    "method",
    ["euler", "rk4", "midpoint", "gauss4", "generalized-alpha", "verlet", "rattle",
     "moreau", "kahan-li6", "kahan-li8"],
)  # fmt: skip
@pytest.mark.parametrize("name", SCENES)
def test_reported_within_thirty_times_the_error(name, method, step):
    """Compensated methods were more exact than a repeat with error control."""
    text, exact = SCENES[name]
    found = lagsim.simulate(text, method=method, step=step, error_bar="always")
    x = found["x"]
    # That of the closed form itself: elliptic functions to a few last places.
    own = 4e-16 * np.max(np.abs(x))
    true = np.max(np.abs(x - exact(found.t)))
    reported = found.error.coordinates["x"].largest
    assert true / 30 - own < reported < 30 * (true + own)


@pytest.mark.slow
@pytest.mark.parametrize("output_step", [0.05, 0.1])
@pytest.mark.parametrize("method", ["rk4", "verlet"])
def test_a_run_that_blows_up_does_not_rest(method, output_step):
    result = lagsim.simulate(
        f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 1e8*x^4}}
initial: {{x: 3, x_dot: 0}}
simulation: {{duration: 1, output_step: {output_step}, method: {method}, step: 0.1}}
"""
    )
    assert result.outcome == "failed"
    assert not result.error.rests
    assert result.error.coordinates["x"].relative >= 0.1
