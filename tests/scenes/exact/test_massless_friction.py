"""Friction with an inner state: a coordinate without mass, held by its own rate."""

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.support import simulate

# LuGre: C. Canudas de Wit et al., IEEE Trans. Automatic Control 40 (1995) 419; its
# constants. At rest without a force at t = 0, pulled by a spring whose end moves.
MODEL = """
parameters: {{s0: 1e5, s1: 316.2, s2: 0.4, Fc: 1, Fs: 1.5, vs: 0.001, k: 2}}
definitions: {{g: "Fc + (Fs - Fc)*exp(-(x_dot/vs)^2)"}}
coordinates: {{x: {{}}, z: {{}}{w}}}
energy: {{kinetic: "x_dot^2/2{kinetic}", potential: "{potential}"}}
constraints: {{bristle: "z_dot = {rate}"}}
forces: {{x: "-(s0*z + s1*z_dot + s2*x_dot)"}}
initial: {{x: 0, z: 0{initial}}}
simulation: {{duration: 8.4, output_step: 0.1, method: {method}}}
"""
PULLED = {"w": "", "kinetic": "", "potential": "k*(x - t/10)^2/2", "initial": ""}
# By a body beside it, which moves, so that nothing but its place makes a force.
BESIDE = {
    "w": ", w: {}", "kinetic": " + w_dot^2/2", "potential": "k*(x - w)^2/2 + w^2/2",
    "initial": ", w: 0, w_dot: 1",
}  # fmt: skip
RATES = {
    "abs": "x_dot - s0*abs(x_dot)/g*z", "sign": "x_dot*(1 - s0*sign(x_dot)/g*z)",
    "max": "x_dot - s0*max(x_dot, -x_dot)/g*z",
    "if": "if(x_dot > 0, x_dot - s0*x_dot/g*z, x_dot + s0*x_dot/g*z)",
}  # fmt: skip


def lugre(t, y):
    """Rates of x, x', z, and of w, w' where the body beside is there."""
    x, v, z, *other = y
    rate = v - 1e5 * abs(v) / (1 + 0.5 * np.exp(-((v / 1e-3) ** 2))) * z
    force = 1e5 * z + 316.2 * rate + 0.4 * v
    end = other[0] if other else t / 10
    more = (other[1], 2 * (x - end) - end) if other else ()
    return v, 2 * (end - x) - force, rate, *more


@functools.cache
def referee(beside):
    """Return x (k,) every 0.1, by scipy's implementation of Radau IIA."""
    start = [0, 0, 0, 0, 1] if beside else [0, 0, 0]
    t = np.arange(85) / 10
    found = solve_ivp(
        lugre, (0, 8.4), start, "Radau", t, rtol=1e-9, atol=1e-13, max_step=0.02
    )
    return found.y[0]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "radau", "taylor"])
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("kind", [PULLED, BESIDE], ids=["pulled", "beside"])
def test_a_bristle_without_mass(kind, rate, method):
    found = simulate(MODEL.format(rate=RATES[rate], method=method, **kind))
    assert found.complete
    exact = referee(kind is BESIDE)
    # The referee's tolerance, over some hundred steps and a slip.
    assert np.max(np.abs(found["x"] - exact)) < 1e-6 * np.ptp(exact)
    assert np.max(np.abs(found["residual_bristle"])) < 1e-12


@pytest.mark.parametrize("kind", [PULLED, BESIDE], ids=["pulled", "beside"])
def test_a_bristle_begins_to_bend(kind):
    """Rest at the start, where no force acts yet, is none later."""
    text = MODEL.format(rate=RATES["abs"], method="dop853", **kind)
    found = simulate(text, duration=0.1, output_step=0.01)
    v, z = found["x_dot"][-1], found["z"][-1]
    # Of the rate of the bristle the second term is missing where the switch stays at 0.
    rate = v - 1e5 * abs(v) * z / (1 + 0.5 * np.exp(-((v / 1e-3) ** 2)))
    assert found["z_dot"][-1] == pytest.approx(rate, abs=1e-9 * v)
    assert abs(rate - v) > 1e-4 * v > 0
