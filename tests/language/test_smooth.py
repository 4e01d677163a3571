"""Smooth selections at removable singularities, and `sinc`, which is one."""

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lagsim
from lagsim.language.derivatives import tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import SMOOTH
from lagsim.language.graph import Graph
from lagsim.show.text import as_text
from tests.show.cases import small

DIGITS = 60


def exact(x, order=0):
    """Return the derivative of sin(x)/x by the series, sum of x^k/(k + 1)! cos."""
    with mp.workdps(DIGITS):
        # The integral of cos(x s) over s from 0 to 1, differentiated under it.
        return mp.quad(lambda s: s**order * mp.cos(x * s + order * mp.pi / 2), [0, 1])


@pytest.mark.parametrize("order", range(7))
@pytest.mark.parametrize("x", [0.0, 1e-300, -1e-8, 0.3, 0.999, 1.0, -1.001, 1.5, 9.0])
def test_derivatives_of_sinc_are_right_at_0_and_beside_it(x, order):
    g = Graph()
    node = g.call("sinc", g.variable("x"))
    for _ in range(order):
        node = tangent(g, [node], {g.variable("x"): g.one})[0]
    [found] = evaluate(g, [node], {"x": x})
    # Each derivative of the quotient loses a digit at most, beside |x| = 1.
    assert abs(found - float(exact(x, order))) < 4e-16 * 10.0**order


def test_a_derivative_of_a_smooth_selection_is_one():
    g = Graph()
    x = g.variable("x")
    [slope] = tangent(g, [g.call("sinc", x)], {x: g.one})
    assert g.ops[slope] == SMOOTH
    assert not g.of(("if",))


WELL = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: -4*sinc(x)}
initial: {x: X0, x_dot: V0}
simulation: {duration: 12, output_step: 0.1}
"""


def pull(x):
    """Return the slope of 4 sinc(x)."""
    if abs(x) < 0.1:
        return 4 * x * (-1 / 3 + x**2 / 30 - x**4 / 840 + x**6 / 45360)
    return 4 * (np.cos(x) - np.sin(x) / x) / x


@pytest.mark.parametrize("method", ["dop853", "taylor", "radau"])
@pytest.mark.parametrize(("x0", "v0"), [(0.5, 0), (0, 0.5), (3, 1)])
def test_a_motion_through_the_singularity_has_no_event(method, x0, v0):
    text = WELL.replace("X0", str(x0)).replace("V0", str(v0))
    found = lagsim.simulate(text, method=method, error_bar="never")
    known = solve_ivp(
        lambda _, y: [y[1], pull(y[0])], (0, 12), [x0, v0], "DOP853",
        rtol=1e-13, atol=1e-13, t_eval=found.t,
    )  # fmt: skip
    assert not found.events
    assert not found.warnings
    # The tolerance of 1e-11, and the growth of errors along the motion.
    assert np.max(np.abs(found["x"] - known.y[0])) < 1e-9


TIMED = """
coordinates: {x: {}, y: {}}
energy: {kinetic: x_dot^2/2 + y_dot^2/2, potential: 0}
forces: {x: sinc(3*t - 6)}
constraints: {rail: y = sinc(x - 1)}
initial: {x: 0, y: {guess: 0.8}}
simulation: {duration: 4, output_step: 0.1}
"""


@pytest.mark.slow
def test_of_the_time_and_in_a_constraint():
    found = lagsim.simulate(TIMED, error_bar="never")
    assert not found.events

    def bent(x):
        u = x - 1
        first = pull(u) / 4
        h = 1e-3
        second = (pull(u - 2 * h) - 8 * pull(u - h) + 8 * pull(u + h)) / (48 * h)
        return first, second - pull(u + 2 * h) / (48 * h)

    def rates(t, y):
        x, v = y
        u = 3 * t - 6
        first, second = bent(x)
        force = np.sinc(u / np.pi)
        return [v, (force - first * second * v * v) / (1 + first**2)]

    known = solve_ivp(
        rates, (0, 4), [0, 0], "DOP853", rtol=1e-12, atol=1e-13, t_eval=found.t
    )
    assert np.max(np.abs(found["x"] - known.y[0])) < 1e-9  # of the differences above
    gap = found["y"] - np.sinc((found["x"] - 1) / np.pi)
    assert np.max(np.abs(gap)) < 1e-14


def test_derive_prints_the_name():
    text = WELL.replace("X0", "1").replace("V0", "0")
    shown = as_text(small(text))
    assert "V = −4 sinc(x)" in shown
    assert "ẍ = 4 (cos(x) − sinc(x))/x" in shown


GROWING = """
parameters: {a: A}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2/2 + (1 + x^2)^(a*x)/9}
initial: {x: 1}
simulation: {duration: 6, output_step: 0.1, method: METHOD}
"""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "taylor"])
def test_a_power_with_an_exponent_that_moves_has_no_switch(method):
    text = GROWING.replace("A", "0.5", 1).replace("METHOD", method)
    found = lagsim.simulate(text, error_bar="never")

    def rates(_, y):
        x = y[0]
        power = (1 + x * x) ** (x / 2)
        slope = power * (np.log(1 + x * x) / 2 + x * x / (1 + x * x))
        return [y[1], -x - slope / 9]

    known = solve_ivp(
        rates, (0, 6), [1, 0], "DOP853", rtol=1e-13, atol=1e-13, t_eval=found.t
    )
    assert not found.events
    assert np.max(np.abs(found["x"] - known.y[0])) < 1e-9
