"""Derivatives of quotients whose divisor overflows, against closed forms."""

from __future__ import annotations

import math

import pytest

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse


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
