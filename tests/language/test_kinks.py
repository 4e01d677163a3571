"""Absolute values, however they are written: one function of the graph."""

import math
import random

import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from tests.language._programs import build

SPELLINGS = {
    "abs(x)": (
        "sqrt(x^2)", "sqrt(x*x)", "(x^2)^0.5", "hypot(x, 0)", "hypot(0, -x)",
        "max(x, -x)", "-min(x, -x)", "abs(-x)", "sqrt(4*x^2)/2", "hypot(3*x, 4*x)*0.2",
        "cbrt(abs(x)^3)", "abs(abs(x))", "sqrt((x^2 + 3*x^2)/4)", "x*sign(x)",
        "sign(-2*x)*x*(-1)", "2*x*sign(x/3)/2",
    ),
    "abs(x*y)": ("sqrt(x^2*y^2)", "sqrt((x*y)^2)", "hypot(x*y, 0)"),
    "abs(x)^3": ("(x^2)^1.5",), "abs(x)^2.5": ("(x^2)^1.25",),
    "abs(x - y)": ("max(x - y, y - x)", "sqrt((x - y)^2)"),
    "abs(x)*sqrt(1 + y^2)": ("sqrt(x^2*(1 + y^2))", "sqrt(x^2)*sqrt(1 + y^2)"),
}  # fmt: skip
PAIRS = [(text, other) for text, others in SPELLINGS.items() for other in others]


@pytest.mark.parametrize(("text", "other"), PAIRS)
def test_spellings_of_an_absolute_value_are_one_node(text, other):
    g = Graph()
    assert build(g, other) == build(g, text)


def _root(x):
    return math.sqrt(x) if x >= 0.0 else math.nan


CASES = {
    "sqrt(x^2 + y^2)": math.hypot,
    "sqrt(x^3*y)": lambda x, y: _root(x**3 * y),
    "cbrt(x^2*y)": lambda x, y: math.cbrt(x * x * y),
    "max(x, y) + min(x, -2*x)": lambda x, y: max(x, y) + min(x, -2 * x),
    "sqrt(x^2/y^2)*y": lambda x, y: abs(x / y) * y,
    "(x^2*y)^2.5": lambda x, y: _root(x * x * y) ** 5,
    "sqrt(x^6)*y": lambda x, y: abs(x) ** 3 * y,
    "hypot(x, -x/2)*y": lambda x, y: abs(x) * math.sqrt(1.25) * y,
    "abs(-2*x/3)*y": lambda x, y: abs(2 * x / 3) * y,
}


@pytest.mark.parametrize("text", CASES)
def test_values_stay_as_written(text):
    g = Graph()
    node, rng = build(g, text), random.Random(46)
    for _ in range(20):
        x, y = rng.uniform(-2, 2), rng.uniform(-2, 2)
        (found,) = evaluate(g, [node], {"x": x, "y": y})
        assert found == pytest.approx(CASES[text](x, y), rel=1e-13, nan_ok=True)
