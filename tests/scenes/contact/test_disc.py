"""Friction on the disc at any step: where it stops, and where its way turns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lagsim

G, K = 9.81, 4.0
PUCK = """\
coordinates: {{x: {{}}, z: {{}}, y: {{}}}}
energy:
  kinetic: {mass}*(x_dot^2 + y_dot^2 + z_dot^2)/2
  potential: {mass}*(9.81*{unit}*y + {stiff}*(x^2 + z^2)/2)
constraints:
  floor: {{relation: y >= 0, restitution: 0, friction: {mu}, slip: [x_dot, z_dot]}}
initial: {{x: {x}, z: 0, y: 0, x_dot: {u}, z_dot: {w}}}
simulation: {{duration: 3, output_step: 0.05, method: {method}{step}}}
"""
STEPS = [
    ("rk4", 0.002),
    ("rk4", 0.0013),
    ("rattle", 0.001),
    ("euler", 0.001),
    ("dop853", None),
]


def puck(method, step, *, stiff=0.0, mu=0.2, speed=1.5, unit=1.0, mass=1.0):
    """Give a puck's run: from (unit, 0) at `speed` along (0.8, 0.6)."""
    asked = "" if step is None else f", step: {step}"
    text = PUCK.format(
        method=method, step=asked, stiff=stiff, mu=mu, x=unit, unit=unit, mass=mass,
        u=0.8 * speed * unit, w=0.6 * speed * unit,
    )  # fmt: skip
    return lagsim.simulate(lagsim.load(text), error_bar="never")


@pytest.mark.parametrize(("unit", "mass"), [(1.0, 1.0), (1e-4, 1e6), (1e5, 1e-3)])
@pytest.mark.parametrize(("method", "step"), STEPS)
def test_it_stops_at_the_end_of_its_parabola(method, step, unit, mass):
    found = puck(method, step, unit=unit, mass=mass)
    t = np.minimum(found.t, 1.5 / (0.2 * G))
    far = 1.5 * t - 0.2 * G * t * t / 2
    bound = 2e-3 if method == "euler" else 1e-9
    assert found["x"] / unit == pytest.approx(1.0 + 0.8 * far, abs=bound)
    assert found["z"] / unit == pytest.approx(0.6 * far, abs=bound)
    assert [e.kind for e in found.events] == ["stick"]
    assert found.events[0].time == pytest.approx(1.5 / (0.2 * G), abs=bound)
    assert found["x_dot"][-1] == found["z_dot"][-1] == 0.0


def spiral(mu, t):
    """Give x, z (k,) of a puck on a spring, by another integrator."""

    def rates(_, s):
        v = np.hypot(s[2], s[3])
        return [s[2], s[3], *(-K * s[i] - mu * G * s[2 + i] / v for i in (0, 1))]

    return solve_ivp(
        rates, (0.0, t[-1]), [1.0, 0.0, 1.2, 0.9], "DOP853", t, rtol=1e-12, atol=1e-13
    ).y[:2]


@pytest.mark.parametrize(("method", "step"), STEPS)
def test_a_way_that_turns_is_no_event(method, step):
    found = puck(method, step, stiff=K, mu=0.01)
    # It goes around once and a half.
    expected = spiral(0.01, found.t)
    # Of rattle, friction along a way that turns is of order 1.
    bound = {"rk4": 1e-9, "dop853": 1e-9, "rattle": 1e-4, "euler": 2e-2}[method]
    for q, x in zip("xz", expected, strict=True):
        assert found[q] == pytest.approx(x, abs=bound)
    assert found.events == ()
    assert len(found.t) == 61
