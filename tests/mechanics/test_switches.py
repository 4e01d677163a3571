import itertools
import random

import pytest

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.mechanics.surfaces import expression_text
from lagsim.mechanics.switches import find_switches, prevailing
from lagsim.run.events.breaks import Values, break_times

MOVING = ("x", "x_dot")


def switches_of(text):
    g = Graph()
    node = parse(text).build(g, g.variable)
    return g, node, find_switches(g, [node], MOVING)


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


TEXTS = [
    "if(t < 1, x*t, x^2)",
    "abs(t - 1)*x",
    "sign(sin(3*t)) + heaviside(t - p)*x",
    "floor(t/0.3)*ceil(p*t)",
    "min(t, 2 - t)*x + max(sin(5*t), p/4)",
    "if(t < 1, if(t < 0.5, abs(t - 0.2), 2), if(sin(9*t) > 0, x, max(t, 1.7)))",
    "abs(sin(5*t) - if(t < 0.7, 0.5, min(t, 0.9)))",
    "abs(abs(abs(t - 1) - 0.5) - 0.1)*x",
    "if(t < 1 and x > 0 or not (t < 1.5), t, x)",
    "if(t - floor(t/0.4)*0.4 < 0.1, 1, x)",
    "sign(x - floor(3*t))*max(x, if(t > 1.2, t, 0))",
    "floor(t + floor(t + floor(3*t)/7))",
    "max(0, t - 1)^2.5 + x",
]


@pytest.mark.parametrize("text", TEXTS)
def test_frozen_expressions_and_slopes_equal_the_original_on_each_arc(text):
    g = Graph()
    node = parse(text).build(g, g.variable)
    slopes = gradient(g, node, [g.variable("t"), g.variable("x")])
    nodes = [node, *slopes]
    switches = find_switches(g, nodes, MOVING)
    frozen = switches.freeze(nodes)
    # Nothing that is left switches in time.
    assert not find_switches(g, frozen, MOVING).modes

    draw = random.Random(text)
    values = {"p": 0.8, "x": draw.uniform(-2, 2)}
    discrete = [mode.discrete for mode in switches.modes]
    ends = [-1.0, *break_times(g, discrete, values, -1.0, 3.0), 3.0]
    assert len(ends) > 2
    for start, end in itertools.pairwise(ends):
        if end - start < 1e-12:
            continue  # between two breaks that rounding holds apart
        found = prevailing(Values(g, discrete, values), start, end)
        modes = {m.variable: v for m, v in zip(switches.modes, found, strict=True)}
        for _ in range(10):
            t = start + (end - start) * draw.uniform(1e-6, 1 - 1e-6)
            now = values | {"t": t}
            assert evaluate(g, frozen, now | modes) == pytest.approx(
                evaluate(g, nodes, now), rel=1e-13, abs=1e-13
            )


def test_the_frozen_form_goes_on_smoothly_past_the_end_of_its_arc():
    g, node, switches = switches_of("abs(t - 1) + if(t < 1, 0, 100)*abs((t - 0.5)^2)")
    frozen = switches.freeze([node])
    # (t - 0.5)^2 vanishes in the very middle of the arc: that is outvoted.
    discrete = [mode.discrete for mode in switches.modes]
    found = prevailing(Values(g, discrete, {}), 0.0, 1.0)
    assert sorted(found) == [-1.0, 1.0, 1.0]
    modes = {m.variable: v for m, v in zip(switches.modes, found, strict=True)}
    assert evaluate(g, frozen, modes | {"t": 1.25}) == [-0.25]
    assert evaluate(g, frozen, modes | {"t": 1.0}) == [0.0]


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


def test_many_nested_switches_take_no_recursion():
    g = Graph()
    node = g.variable("x")
    for k in range(3000):
        node = g.call(
            "if", g.call("lt", g.variable("t"), g.constant(float(k))), g.zero, node
        )
    switches = find_switches(g, [node], MOVING)
    assert len(switches.modes) == 3000
    (frozen,) = switches.freeze([node])
    modes = {m.variable: 0.0 for m in switches.modes}
    assert evaluate(g, [frozen], modes | {"x": 5.0}) == [5.0]
