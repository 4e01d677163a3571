"""The reported error of fixed steps, against closed forms, down to rounding."""

import numpy as np
import pytest
from scipy.special import ellipj

import lagsim

MODEL = """
coordinates: {{{coordinates}}}
energy: {{kinetic: "{kinetic}", potential: "{potential}"}}
initial: {{{initial}}}
simulation: {{duration: {T}, output_step: 0.25}}
"""


def kepler(t):
    """Abscissa of an ellipse of eccentricity 0.5, from the pericentre."""
    e, E = 0.5, t.copy()
    for _ in range(40):
        E -= (E - e * np.sin(E) - t) / (1 - e * np.cos(E))
    return np.cos(E) - e


SCENES = {
    # x'' = -x^3 from rest at 1 is cn(t, 1/2) (Abramowitz and Stegun, 16.1 and 16.16).
    "quartic": (
        ("x: {}", "x_dot^2/2", "x^4/4", "x: 1", 20),
        lambda t: ellipj(t, 0.5)[1],
    ),
    "kepler": (
        (
            "x: {}, y: {}", "(x_dot^2 + y_dot^2)/2", "-1/hypot(x, y)",
            "x: 0.5, y: 0, x_dot: 0, y_dot: sqrt(3)", 20,
        ),
        kepler,
    ),
    "spring": (("x: {}", "x_dot^2/2", "x^2/2", "x: 1", 50), np.cos),
}  # fmt: skip


@pytest.mark.parametrize(
    "step", [0.05, *(pytest.param(h, marks=pytest.mark.slow) for h in (0.01, 0.002))]
)
@pytest.mark.parametrize(
    "method",
    ["euler", "rk4", "midpoint", "gauss4", "generalized-alpha", "verlet", "rattle",
     "moreau", "kahan-li6", "kahan-li8"],
)  # fmt: skip
@pytest.mark.parametrize("scene", SCENES)
def test_reported_within_thirty_times_the_error(scene, method, step):
    """Compensated methods were more exact than a repeat with error control."""
    (coordinates, kinetic, potential, initial, T), exact = SCENES[scene]
    text = MODEL.format(
        coordinates=coordinates, kinetic=kinetic, potential=potential, initial=initial,
        T=T,
    )  # fmt: skip
    found = lagsim.simulate(text, method=method, step=step, error_bar="always")
    x = found["x"]
    # That of the closed form itself: elliptic functions to a few last places.
    own = 4e-16 * np.max(np.abs(x))
    true = np.max(np.abs(x - exact(found.t)))
    reported = found.error.coordinates["x"].largest
    assert true / 30 - own < reported < 30 * (true + own)


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
