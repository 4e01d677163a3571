"""Derivatives and series of quotients whose divisor overflows, by mpmath."""

import math

import mpmath as mp
import pytest

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.series import taylor_series
from tests.language._programs import build

ORDER = 6
EXACT = {
    "5/(1 + exp(-1000*(x - 1)))": lambda x: 5 / (1 + mp.exp(-1000 * (x - 1))),
    "1/(2 + 3*exp(100*x))^2": lambda x: 1 / (2 + 3 * mp.exp(100 * x)) ** 2,
    "1/cosh(100*x)^2": lambda x: mp.sech(100 * x) ** 2,
    "1/(cosh(70*x)*cosh(90*x))": lambda x: mp.sech(70 * x) * mp.sech(90 * x),
    "exp(10*x)/cosh(100*x)": lambda x: mp.exp(10 * x) * mp.sech(100 * x),
    "x/exp(50*x)": lambda x: x * mp.exp(-50 * x),
    "1/(3 - exp(-2*x))": lambda x: 1 / (3 - mp.exp(-2 * x)),
    "1/(exp(-2*x) - 3)": lambda x: 1 / (mp.exp(-2 * x) - 3),
}
# Far away all is flat on either side; or, of these, where the divisor grows.
FAR = {"x/exp(50*x)": [1e3], "exp(10*x)/cosh(100*x)": [-1e3, 30.0]}


def slopes_at(text, x, order):
    """Return the derivative in x, by both ways."""
    g = Graph()
    v, node = g.variable("x"), build(g, text)
    for _ in range(order - 1):
        node = gradient(g, node, [v])[0]
    both = [gradient(g, node, [v])[0], tangent(g, [node], {v: g.one})[0]]
    return list(evaluate(g, both, {"x": x}))


def series_at(text, x):
    """Return the coefficients along x' = 1, after the value, from y' = text."""
    g = Graph()
    v, node = g.variable("x"), build(g, text)
    rows = taylor_series(g, [v, g.variable("y")], [g.one, node], ORDER)
    made = [g.call("mul", g.constant(k), y) for k, (_, y) in enumerate(rows)]
    return list(evaluate(g, made[2:], {"x": x}))


@pytest.mark.parametrize("text", EXACT)
def test_where_nothing_overflows(text):
    for x in (-0.04, 0.02, 1.01):
        with mp.workdps(60):
            exact = mp.taylor(EXACT[text], mp.mpf(x), ORDER - 1)[1:]
        # Exponents of up to 1e3 lose three digits, orders some more where they cancel.
        for found, right in zip(series_at(text, x), exact, strict=True):
            assert found == pytest.approx(float(right), rel=1e-9)
        for order in (1, 2, 3):
            right = float(exact[order - 1] * math.factorial(order))
            for slope in slopes_at(text, x, order):
                assert slope == pytest.approx(right, rel=1e-10)


@pytest.mark.parametrize("text", EXACT)
def test_far_away_all_vanishes(text):
    for x in FAR.get(text, [-1e3, 1e3]):
        assert series_at(text, x) == [0.0] * (ORDER - 1)
        for order in (1, 2, 3):
            assert slopes_at(text, x, order) == [0.0, 0.0]
