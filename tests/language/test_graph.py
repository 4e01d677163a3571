"""The graph: sharing, folding, simplification, substitution, degrees."""

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.language.graph import Graph, TooMuchError
from tests.language._programs import (
    AsWritten,
    OutsideError,
    build,
    exactly,
    on_graph,
    programs,
    states,
)
from tests.support import refused


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("x + y", "y + x"), ("x*y", "y*x"), ("2*x", "x*2"),
        ("hypot(x, y)", "hypot(y, x)"), ("x - (-y)", "x + y"), ("x + (-y)", "x - y"),
        ("-x + y", "y - x"), ("-(x - y)", "y - x"), ("(-x)*(-y)", "x*y"),
        ("(-x)/y", "-(x/y)"), ("x/(-y)", "-(x/y)"), ("--x", "x"), ("x + 0", "x"),
        ("0 - x", "-x"), ("x - x", "0"), ("0*x", "0"), ("0/x", "0"), ("x/x", "1"),
        ("1*x", "x"), ("-1*x", "-x"), ("x/1", "x"), ("x/4", "0.25*x"),
        ("2*(3*x)", "6*x"), ("-(2*x)", "-2*x"), ("2*(-x)", "-2*x"), ("x^1", "x"),
        ("x^0", "1"), ("1^x", "1"), ("x^0.5", "sqrt(x)"), ("(-x)^2", "x^2"),
        ("2 + 3", "5"), ("sin(0)", "0"), ("if(1 < 2, x, y)", "x"),
        ("if(not 1 < 2, x, y)", "y"), ("if(x > 0, y, y)", "y"), ("max(x, x)", "x"),
        ("min(2, 3)", "2"), ("sin(x + y)*cos(y*x)", "cos(x*y)*sin(y + x)"),
    ],
)  # fmt: skip
def test_equal_expressions_are_one_node(one, other):
    g = Graph()
    assert build(g, one) == build(g, other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("x - y", "y - x"),
        ("x/y", "y/x"),
        ("x^y", "y^x"),
        ("atan2(x, y)", "atan2(y, x)"),
        ("(-x)^3", "x^3"),
        ("x/3", "x*(1/3)"),  # would round twice
        ("0/0", "1"),
        ("0/0", "0"),
        ("min(x, y)", "max(x, y)"),
    ],
)
def test_different_expressions_are_not(one, other):
    g = Graph()
    assert build(g, one) != build(g, other)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1e308*10", math.inf), ("1e308 + 1e308", math.inf),
        ("-1e308 - 1e308", -math.inf), ("exp(1000)", math.inf),
        ("sinh(-1000)", -math.inf), ("1/0", math.inf), ("-1/0", -math.inf),
        ("0/0", math.nan), ("0^-1", math.inf), ("(-8)^(1/3)", math.nan),
        ("10^400", math.inf), ("(-10)^401", -math.inf), ("log(0)", -math.inf),
        ("sqrt(-1)", math.nan), ("asin(2)", math.nan), ("atanh(1)", math.inf),
        ("1e308*10 - 1e308*20", math.nan), ("sin(1e308*10)", math.nan),
        ("floor(1e308*10)", math.inf), ("if(1/0 > 1, 1, 2)", 1.0),
        ("if(0/0 > 1, 1, 2)", 2.0),
    ],
)  # fmt: skip
def test_folding_never_raises(text, expected):
    g = Graph()
    node = build(g, text)
    unfolded = math.isnan(expected) or math.isinf(expected)
    assert (g.value(node) is None) == (unfolded or "if" in text)
    assert evaluate(g, [node], {}) == pytest.approx([expected], nan_ok=True)


def test_gathering_factors_neither_overflows_nor_underflows():
    g = Graph()
    small = build(g, "1e-200*(1e-200*x)")
    large = build(g, "1e200*(1e200*x)")
    assert evaluate(g, [small], {"x": 1e300}) == pytest.approx([1e-100], rel=1e-15)
    assert evaluate(g, [large], {"x": 1e-300}) == pytest.approx([1e100], rel=1e-15)


@pytest.mark.slow
@given(programs(), states)
@settings(max_examples=300, deadline=None, derandomize=True)
def test_simplification_keeps_values(program, state):
    try:
        exact = exactly(program, state)
    except OutsideError:
        assume(False)
    g, plain = Graph(), AsWritten()
    node, as_written = on_graph(g, program), on_graph(plain, program)
    errors = {name: (x, 0.0) for name, x in state.items()}
    value, bound = evaluate_with_error(plain, [as_written], errors)[0]
    # Where rounding decides a branch, there is no bound.
    assume(abs(value - exact) <= 4 * bound < 1e-6 * abs(value) + 1e-9)
    assert abs(evaluate(g, [node], state)[0] - exact) <= 8 * bound


@pytest.mark.slow
@given(programs(longest=6), programs(longest=4), states)
@settings(max_examples=200, deadline=None, derandomize=True)
def test_substituting_is_evaluating_at_the_new_value(program, inner, state):
    g = AsWritten()
    node, new = on_graph(g, program), on_graph(g, inner)
    replaced = g.substitute([node], {g.variable("x"): new})[0]
    value = evaluate(g, [new], state)[0]
    expected = evaluate(g, [node], {**state, "x": value})[0]
    # The same operations on the same numbers: the same bits.
    assert evaluate(g, [replaced], state)[0] == pytest.approx(
        expected, rel=0, abs=0, nan_ok=True
    )


def test_substituting_at_once_not_in_turn():
    g = Graph()
    x, y = g.variable("x"), g.variable("y")
    node = build(g, "x - 2*y")
    assert g.substitute([node], {x: y, y: x}) == [build(g, "y - 2*x")]
    assert g.substitute([node, x], {build(g, "2*y"): x}) == [g.zero, x]


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("0", (math.inf, -math.inf)), ("a", (0, 0)), ("a*v + w", (1, 1)),
        ("v*w/a - v^2", (2, 2)), ("v^2 + sin(a)*v + 1", (0, 2)), ("(v + 1)^3", (0, 3)),
        ("a^v", None), ("v/w", None), ("sin(v)", None), ("sqrt(v^2)", None),
        ("v^-1", None), ("if(a > 0, v, w^2)", (1, 2)), ("if(v > 0, v, w)", None),
        ("-v", (1, 1)), ("v^0.5", None), ("sqrt(a)*v", (1, 1)), ("abs(a)", (0, 0)),
    ],
)  # fmt: skip
def test_degrees(text, degrees):
    g = Graph()
    assert g.degree(build(g, text), {"v", "w"}) == degrees


def test_degrees_of_chained_squares():
    # 2^64 terms: what is found takes no longer than the chain.
    g = Graph()
    mixed, pure, cubes = (build(g, text) for text in ("v + w^2", "v", "v + 1"))
    for _ in range(64):
        mixed = g.call("add", g.call("mul", mixed, mixed), mixed)
        pure = g.call("mul", pure, pure)
        cubes = g.call("pow", cubes, g.constant(3.0))
    assert g.degree(mixed, {"v", "w"}) == (1, 2**65)
    assert g.degree(pure, {"v", "w"}) == (2**64, 2**64)
    assert g.degree(cubes, {"v", "w"}) == (0, 3**64)
    assert g.degree(cubes, {"w"}) == (0, 0)
    assert g.degree(build(g, "v^5*v^5 + w^4*w^6"), {"v", "w"}) == (10, 10)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_constants_keep_their_bits(x):
    g = Graph()
    assert g.value(g.constant(x)) == x
    assert g.value(g.call("neg", g.constant(x))) == -x


def test_each_operation_is_counted_as_work():
    g = Graph(work=100.0)
    x = g.variable("x")
    with refused("too-large", kind=TooMuchError):
        for k in range(1000):
            x = g.call("mul", g.call("sin", x), g.constant(2.0 + k))
    # Work that is announced is refused before it is done, and what is left serves less.
    other = Graph(work=100.0)
    other.count(60.0)
    with refused("too-large", kind=TooMuchError):
        other.count(60.0)
    other.count(40.0)
