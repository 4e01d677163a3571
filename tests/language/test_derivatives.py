"""Gradients, tangents and total rates, against each other, sympy and differences."""

import math

import mpmath as mp
import pytest
import sympy as sp
from hypothesis import assume, given, settings

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.show.symbols import symbol, to_sympy
from tests.language._cases import DIGITS
from tests.language._programs import (
    SMOOTH,
    VARIABLES,
    OutsideError,
    exactly,
    on_graph,
    programs,
    states,
)


def slope(text, x, order=1, **values):
    """Return the derivative of `text` by x, by two ways, which must agree."""
    g = Graph()
    node = parse(text).build(g, g.variable)
    v = g.variable("x")
    for _ in range(order - 1):
        node = gradient(g, node, [v])[0]
    both = [gradient(g, node, [v])[0], tangent(g, [node], {v: g.one})[0]]
    reverse, forward = evaluate(g, both, {"x": x, **values})
    assert reverse == pytest.approx(forward, rel=1e-14, nan_ok=True)
    return reverse


@pytest.mark.parametrize(
    ("text", "x", "expected"),
    [
        ("if(x > 0, sqrt(x), 0)", 0.0, 0.0), ("if(x > 0, sqrt(x), 0)", 4.0, 0.25),
        ("if(x > 0, sqrt(x), 0)", -4.0, 0.0), ("5*if(x > 0, sqrt(x), 0) + x", 0.0, 1.0),
        ("if(x > 0, log(x), x^2)", 0.0, 0.0), ("if(x > 0, sqrt(x), 0)*x", 0.0, 0.0),
        ("if(x >= 0, x, 1/x)", 0.0, 1.0), ("max(0, x)^2.5", 0.0, 0.0),
        ("max(0, x)^2.5", 4.0, 20.0), ("max(0, x)^2.5", -1.0, 0.0),
        ("max(x, 0)^1.5", 0.0, 0.0), ("max(1, sqrt(x))", 0.0, 0.0),
        ("max(1, sqrt(x))", 4.0, 0.25), ("max(sqrt(x), 1)", 0.0, 0.0),
        ("min(-1, -sqrt(x))", 0.0, 0.0), ("min(x, x^2)", 0.5, 1.0),
        ("min(x, x^2)", 2.0, 1.0),
        ("max(x, 0)", 0.0, 1.0),  # the first where they are equal
        ("max(0, x)", 0.0, 0.0), ("sign(x)", 0.0, 0.0), ("heaviside(x)", 0.0, 0.0),
        ("x*sign(x)", -3.0, -1.0), ("x*heaviside(x)", 0.0, 1.0), ("abs(x)", 0.0, 0.0),
        ("abs(x)", -2.0, -1.0), ("abs(x)^3", -2.0, -12.0), ("x*floor(x)", 2.5, 2.0),
        ("x*ceil(x)", 2.5, 3.0),
        ("if(x > 0, if(x > 1, sqrt(x - 1), 2*x), 3*x)", 1.0, 2.0),
        ("if(x > 0, if(x > 1, sqrt(x - 1), 2*x), 3*x)", 5.0, 0.25),
        ("if(x > 0, if(x > 1, sqrt(x - 1), 2*x), 3*x)", 0.0, 3.0),
        ("if(x > 0, max(1, sqrt(x)), sqrt(-x))", 0.25, 0.0),
        ("sin(if(x > 0, sqrt(x), 2*x))", 0.0, 2.0),
        ("if(x > 0 and x < 1 or not x < 5, x^2, x^3)", 2.0, 12.0),
        ("if(x > 0 and x < 1 or not x < 5, x^2, x^3)", 0.5, 1.0),
        ("if(x > 0 and x < 1 or not x < 5, x^2, x^3)", 6.0, 12.0),
        ("x^0.5", 0.0, math.inf), ("sqrt(x)", 0.0, math.inf),
        ("x^x", 2.0, 4 * (math.log(2) + 1)), ("(x^2)^1.5", 2.0, 12.0),
        ("0^x", 2.0, 0.0),
    ],
)  # fmt: skip
def test_slopes(text, x, expected):
    assert slope(text, x) == pytest.approx(expected, rel=1e-14)


# Texts, x, slopes of a higher order, and parameters.
OTHER_SLOPES = [
    ("if(x > 0, sqrt(x), 0)", 0.0, 0.0, {"order": 2}),
    ("max(0, x)^2.5", 0.0, 0.0, {"order": 2}),
    ("max(0, x)^2.5", 4.0, 7.5, {"order": 2}),
    ("max(1, sqrt(x))", 0.0, 0.0, {"order": 2}),
    ("if(x > 0, x^2, x^3)", 0.0, 0.0, {"order": 2}),
    ("abs(x)*x", -1.0, -2.0, {"order": 2}),
    # Hertz's contact: k*d^n, n an input, at the first touch.
    ("k*max(0, x)^n", 0.0, 0.0, {"k": 3.0, "n": 1.5}),
    ("k*x^n", 4.0, 24.0, {"k": 3.0, "n": 2.0}),
    ("k*x^n", -4.0, -24.0, {"k": 3.0, "n": 2.0}),
]


@pytest.mark.parametrize(("text", "x", "expected", "more"), OTHER_SLOPES)
def test_second_slopes_and_exponents_that_are_parameters(text, x, expected, more):
    assert slope(text, x, **more) == pytest.approx(expected, rel=1e-14)


@pytest.mark.slow
@given(programs(SMOOTH, longest=5), states)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_gradient_and_tangent_are_those_of_sympy(program, state):
    try:
        exactly(program, state)
    except OutsideError:
        assume(False)
    g = Graph()
    node = on_graph(g, program)
    variables = [g.variable(name) for name in VARIABLES]
    nodes = gradient(g, node, variables)
    nodes += [tangent(g, [node], {v: g.one})[0] for v in variables]
    twin = to_sympy(g, [node])[0]
    symbols = [symbol(name) for name in VARIABLES]
    errors = {name: (x, 0.0) for name, x in state.items()}
    found = evaluate_with_error(g, nodes, errors)
    expected = sp.lambdify(symbols, [sp.diff(twin, s) for s in symbols], "mpmath")
    with mp.workdps(DIGITS):
        try:
            exact = expected(*(mp.mpf(state[name]) for name in VARIABLES))
        except ZeroDivisionError:
            assume(False)
    for (value, bound), wanted in zip(found, [*exact, *exact], strict=True):
        assume(mp.isfinite(wanted))
        assert abs(value - wanted) <= 8 * bound + 1e-14 * (1 + abs(wanted))
