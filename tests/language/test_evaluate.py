"""Values in Python, and the running bound of their rounding errors."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given, settings

from lagsim.language.evaluate import evaluate, evaluate_rows, evaluate_with_error
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from tests.language._programs import (
    CONTINUOUS,
    AsWritten,
    OutsideError,
    exactly,
    on_graph,
    programs,
    states,
)

# The bound is to first order; the start's judgement has the same margin.
MARGIN = 4.0


def with_error(text, **values):
    g = AsWritten()
    return evaluate_with_error(g, [parse(text).build(g, g.variable)], values)[0]


def test_in_many_rows():
    g = Graph()
    x, y, c = (g.variable(name) for name in "xyc")
    texts = ["c^2", "x*y + c", "if(x > y, 1/x, sqrt(y))", "x", "2"]
    nodes = [parse(text).build(g, g.variable) for text in texts]
    xs, ys = np.array([1.0, 4.0, 0.0]), np.array([9.0, 2.0, -1.0])
    found = evaluate_rows(g, nodes, {"x": xs, "y": ys, "c": 3.0}, 3)
    expected = [[9, 9, 9], xs * ys + 3, [3, 0.25, math.inf], xs, [2, 2, 2]]
    assert np.array_equal(found, expected)
    assert evaluate_rows(g, [x, y, c], {"x": xs, "y": 1.0, "c": xs}, 3).shape == (3, 3)


# Texts, inputs with their errors; values and bounds.
ERRORS = [
    ("x", {"x": (0.3, 0.0)}, 0.3, 0.0), ("-abs(x)", {"x": (0.3, 0.0)}, -0.3, 0.0),
    ("3", {}, 3.0, 0.0), ("max(x, 2)", {"x": (0.3, 0.1)}, 2.0, 0.0),
    ("if(x > 0, 2, 3)", {"x": (0.3, 0.1)}, 2.0, 0.0),
    ("x^2", {"x": (3.0, 1e-6)}, 9.0, pytest.approx(6e-6, rel=1e-6)),
    ("x - y", {"x": (1.0, 1e-9), "y": (1.0, 2e-9)}, 0.0, pytest.approx(3e-9, rel=1e-6)),
    ("sqrt(x)", {"x": (0.0, 1e-16)}, 0.0, pytest.approx(1e-8, rel=1e-12)),
]  # fmt: skip


@pytest.mark.parametrize(("text", "inputs", "value", "bound"), ERRORS)
def test_errors_of_inputs_are_passed_on_and_what_is_exact_has_none(
    text, inputs, value, bound
):
    assert with_error(text, **inputs) == (value, bound)


def test_rounding_of_pi_halves():
    value, bound = with_error("l*cos(p/2)", l=(1.0, 0.0), p=(math.pi, 2**-52))
    assert 0 < value < MARGIN * bound < 4e-15


def test_a_rounded_constant_has_an_error():
    _, bound = with_error("0.1")
    assert abs(mp.mpf(0.1) - mp.mpf(1) / 10) <= bound < 1.2e-17


def test_never_raises():
    for text in ("1/x", "log(x)", "x^-1.5", "sqrt(x - 1)", "asin(x + 2)", "exp(1/x)"):
        value, bound = with_error(text, x=(0.0, 1e-10))
        assert not math.isfinite(value)
        assert bound >= 0 or math.isnan(bound)


@pytest.mark.slow
@given(programs(CONTINUOUS), states)
@settings(max_examples=500, deadline=None, derandomize=True)
def test_the_bound_bounds(program, state):
    try:
        exact = exactly(program, state)
    except OutsideError:
        assume(False)
    g = AsWritten()
    node = on_graph(g, program)
    errors = {name: (x, 0.0) for name, x in state.items()}
    value, bound = evaluate_with_error(g, [node], errors)[0]
    assert value == evaluate(g, [node], state)[0]
    assume(math.isfinite(value))
    assert abs(value - exact) <= MARGIN * bound
