"""Slopes and series of saturating functions in their tails, by mpmath."""

import math

import mpmath as mp
import pytest

import lagsim
from lagsim.language.derivatives import local_slopes
from lagsim.language.evaluate import evaluate_with_error
from lagsim.language.graph import Graph
from tests.language._programs import build
from tests.language.test_overflow import ORDER, series_at, slopes_at

EPS = 2.0**-52
EXACT = {
    "tanh(x)": mp.tanh,
    "1 - tanh(x)": lambda x: 1 - mp.tanh(x),
    "tanh(x)^2": lambda x: mp.tanh(x) ** 2,
    "1/tanh(x)": mp.coth,
    "sinh(x)/cosh(x)": mp.tanh,
    "cosh(x)/sinh(x)": mp.coth,
    "x*tanh(x)": lambda x: x * mp.tanh(x),
    "log(cosh(x))": lambda x: mp.log(mp.cosh(x)),
    "log(3*cosh(x)^2)": lambda x: mp.log(3 * mp.cosh(x) ** 2),
    "log(1 + exp(x))": lambda x: mp.log(1 + mp.exp(x)),
    "log(exp(-x) + 2)": lambda x: mp.log(mp.exp(-x) + 2),
    "exp(x)/(1 + exp(x))": lambda x: 1 / (1 + mp.exp(-x)),
    "exp(-x)/(exp(-x) + 2)": lambda x: 1 / (1 + 2 * mp.exp(x)),
    "1/(1 + exp(-x))": lambda x: 1 / (1 + mp.exp(-x)),
}


@pytest.mark.parametrize("x", [-300.0, -40.0, -17.0, -2.0, 0.3, 5.0, 19.0, 300.0])
@pytest.mark.parametrize("text", EXACT)
def test_slopes_and_series_keep_their_digits(text, x):
    """The rounding of the argument is a part |x| of the rounding of the value."""
    # 1 - tanh(|x|) is 10^(-0.87 |x|).
    with mp.workdps(40 + int(abs(x))):
        exact = mp.taylor(EXACT[text], mp.mpf(x), ORDER)[1:]
    within = 30.0 * EPS * (1.0 + abs(x))
    for order in (1, 2):
        right = float(exact[order - 1] * order)
        for slope in slopes_at(text, x, order):
            assert slope == pytest.approx(right, rel=within, abs=1e-300)
    largest = float(max(map(abs, exact)))
    for found, right in zip(series_at(text, x), exact, strict=False):
        assert found == pytest.approx(float(right), rel=within, abs=within * largest)


@pytest.mark.parametrize("x", [-1e4, -800.0, 800.0, 1e4])
@pytest.mark.parametrize("text", EXACT)
def test_slopes_are_those_of_the_asymptotes_where_exp_overflows(text, x):
    with mp.workdps(20):
        right = float(mp.diff(EXACT[text], mp.mpf(x)))
    for slope in slopes_at(text, x, 1):
        assert slope == pytest.approx(right, rel=1e-15, abs=1e-15)


def test_the_rounding_of_a_slope_is_relative():
    g = Graph()
    node = build(g, "tanh(x)")
    [slope] = [s for _, s in local_slopes(g, node)]
    [(value, error)] = evaluate_with_error(g, [slope], {"x": (30.0, 0.0)})
    assert 0.0 < error < 30.0 * EPS * value


# Beyond the tail each is exp(-2 x), to a part of 1e-13 at x = 15.
HILLS = [
    "(1 - tanh(x))/2", "(1 + tanh(-x))/2", "-tanh(x/1)/2", "0.5/tanh(x)",
    "(1 - sinh(x)/cosh(x))/2", "1/(1 + exp(2*x))", "-exp(2*x)/(1 + exp(2*x))",
    "log(1 + exp(-2*x))", "0.25/sinh(x)^2", "1/(4*cosh(x)^2)",
]  # fmt: skip


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
@pytest.mark.parametrize("hill", HILLS)
def test_a_body_at_rest_far_out_on_a_slope_slides_down_it(hill, method):
    """x'' = 2 exp(-2 x) from rest: x = 15 + log(cosh(w t)), w = sqrt(2) exp(-15)."""
    found = lagsim.simulate(
        lagsim.load(f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: {hill}}}
initial: {{x: 15, x_dot: 0}}
simulation: {{duration: 1.0e7, output_step: 1.0e6, method: {method}}}
"""),
        error_bar="never",
    )
    w = math.sqrt(2.0) * math.exp(-15.0)
    assert found["x"] - 15.0 == pytest.approx(
        [math.log(math.cosh(w * t)) for t in found.t], rel=1e-8, abs=1e-8
    )
