"""Switches of expressions: which are found, by which names, and how deep."""

import inspect
import sys

import pytest

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.mechanics.surfaces import expression_text
from lagsim.mechanics.switch_search import find_switches

MOVING = ("x", "x_dot")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("sign(x_dot)", ["sign(x_dot)"]),
        ("abs(x - t)", ["abs(x - t)"]),
        ("if(x > 0 and t < 1, 1, 0)", ["if(x > 0, ...)"]),
        ("max(0, x)^2.5", ["max(0, x)"]),
        ("floor(x*sign(t))", ["floor(x*sign(t))"]),
        ("min(t, p)", []),
        ("t^x", []),  # whose slope has a limit of its own at 0
    ],
)
def test_finds_the_state_switches_of_an_expression_and_its_derivative(text, shown):
    g = Graph()
    node = parse(text).build(g, g.variable)
    slopes = gradient(g, node, [g.variable(v) for v in (*MOVING, "t")])
    found = find_switches(g, [node, *slopes], MOVING)
    assert list(found.state.values()) == shown


@pytest.mark.parametrize(
    "text",
    ["a - (b - c)", "a/(b*c)", "(a + b)*c", "(-a)^2.5", "-a^2.5", "sin(a)^b*max(a, 2)",
     "a - b - c", "a/b*c", "(a/b)^c", "a^(b + c)", "(a^b)^c", "(a*b - c)*-a"],
)  # fmt: skip
def test_the_text_of_an_expression_reads_back(text):
    g = Graph()
    node = parse(text).build(g, g.variable)
    again = parse(expression_text(g, node)).build(g, g.variable)
    values = {"a": 1.3, "b": 0.7, "c": 2.1}
    assert evaluate(g, [again], values) == pytest.approx(
        evaluate(g, [node], values), nan_ok=True
    )


@pytest.fixture
def few_frames():
    """Lower Python's limit of recursion to 250 frames more than there are."""
    usual = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack(0)) + 250)
    yield
    sys.setrecursionlimit(usual)


@pytest.mark.slow
@pytest.mark.usefixtures("few_frames")
def test_many_nested_switches_take_no_recursion():
    g = Graph()
    node = g.variable("x")
    for k in range(300):
        node = g.call(
            "if", g.call("lt", g.variable("t"), g.constant(float(k))), g.zero, node
        )
    switches = find_switches(g, [node], MOVING)
    assert len(switches.modes) == 300
    (frozen,) = switches.freeze([node])
    modes = {m.variable: 0.0 for m in switches.modes}
    assert evaluate(g, [frozen], modes | {"x": 5.0}) == [5.0]
