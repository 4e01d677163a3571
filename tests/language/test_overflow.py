"""Derivatives and series of quotients whose divisor overflows, against closed forms."""

from __future__ import annotations

import math

import mpmath as mp
import pytest

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.language.series import taylor_series


def logistic(u: float) -> float:
    return 0.5 * (1.0 + math.tanh(0.5 * u))


CASES = {
    "5/(1 + exp(-1000*(x - 1)))": lambda x: (
        5e3 * logistic(1e3 * (x - 1)) * logistic(-1e3 * (x - 1))
    ),
    "1/(2 + 3*exp(100*x))^2": lambda x: (
        -600.0 * math.exp(100 * x) / (2 + 3 * math.exp(100 * x)) ** 3
    ),
    "1/cosh(100*x)^2": lambda x: -200 * math.tanh(100 * x) / math.cosh(100 * x) ** 2,
    "x/exp(50*x)": lambda x: (1 - 50 * x) * math.exp(-50 * x),
    "1/(3 - exp(-2*x))": lambda x: -2 * math.exp(-2 * x) / (3 - math.exp(-2 * x)) ** 2,
    "1/(exp(-2*x) - 3)": lambda x: 2 * math.exp(-2 * x) / (math.exp(-2 * x) - 3) ** 2,
}


@pytest.mark.parametrize("text", CASES)
def test_the_slope_where_nothing_overflows(text: str) -> None:
    for x in (-0.4, 0.2, 0.7, 1.0):
        for slope in slopes_at(text, x, 1):
            # The closed forms cancel by some digits, and so may the exponents.
            assert slope == pytest.approx(CASES[text](x), rel=1e-11)


@pytest.mark.parametrize("text", CASES)
@pytest.mark.parametrize("order", [1, 2, 3])
def test_far_away_all_slopes_vanish(text: str, order: int) -> None:
    # Either side is flat; or, of those that are not, the one where the divisor grows.
    for x in {"x/exp(50*x)": [1e3]}.get(text, [-1e3, 1e3]):
        for slope in slopes_at(text, x, order):
            assert slope == 0.0


def slopes_at(text: str, x: float, order: int) -> list[float]:
    """Give the derivative in x, by both ways."""
    g = Graph()
    v = g.variable("x")
    node = parse(text).build(g, g.variable)
    for _ in range(order - 1):
        node = gradient(g, node, [v])[0]
    both = [gradient(g, node, [v])[0], tangent(g, [node], {v: g.one})[0]]
    return list(evaluate(g, both, {"x": x}))


ORDER = 6


def series_at(text: str, x: float) -> list[float]:
    """Give the coefficients along x' = 1, after the value: those of y' = it."""
    g = Graph()
    v = g.variable("x")
    node = parse(text).build(g, g.variable)
    rows = taylor_series(g, [v, g.variable("y")], [g.one, node], ORDER)
    made = [g.call("mul", g.constant(k), y) for k, (_, y) in enumerate(rows)]
    return list(evaluate(g, made[2:], {"x": x}))


EXACT = {
    "5/(1 + exp(-1000*(x - 1)))": lambda x: 5 / (1 + mp.exp(-1000 * (x - 1))),
    "1/(2 + 3*exp(100*x))^2": lambda x: 1 / (2 + 3 * mp.exp(100 * x)) ** 2,
    "1/cosh(100*x)^2": lambda x: mp.sech(100 * x) ** 2,
    "1/(cosh(70*x)*cosh(90*x))": lambda x: mp.sech(70 * x) * mp.sech(90 * x),
    "exp(10*x)/cosh(100*x)": lambda x: mp.exp(10 * x) * mp.sech(100 * x),
    "x/exp(50*x)": lambda x: x * mp.exp(-50 * x),
    "1/(3 - exp(-2*x))": lambda x: 1 / (3 - mp.exp(-2 * x)),
}


@pytest.mark.parametrize("text", EXACT)
def test_the_series_where_nothing_overflows(text: str) -> None:
    for x in (-0.04, 0.02, 1.01):
        with mp.workdps(60):
            exact = mp.taylor(EXACT[text], mp.mpf(x), ORDER - 1)[1:]
        # Exponents of up to 1e3 lose three digits, orders some more where they cancel.
        for found, right in zip(series_at(text, x), exact, strict=True):
            assert found == pytest.approx(float(right), rel=1e-9)


@pytest.mark.parametrize("text", EXACT)
def test_far_away_the_series_vanishes(text: str) -> None:
    for x in {"x/exp(50*x)": [1e3], "exp(10*x)/cosh(100*x)": [-1e3, 30.0]}.get(
        text, [-1e3, 1e3]
    ):
        assert series_at(text, x) == [0.0] * (ORDER - 1)
