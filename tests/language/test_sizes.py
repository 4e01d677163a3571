"""Powers of roots: equal for all arguments, and with slopes where roots have none."""

import math

import numpy as np
import pytest

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.simpler import never_negative
from tests.language._programs import build
from tests.support import run


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(x)^2", "sqrt(x)*sqrt(x)", "sqrt(a*x^2)^2", "sqrt(x^2 - y^2)^2",
        "sqrt(x)^4", "(a*sqrt(x))^2", "sqrt(x^3)^2", "sqrt(min(x, y^2))^2",
    ],
)  # fmt: skip
def test_no_value_appears_where_there_is_none(text):
    # Below 0 a root has none, nor has its square.
    g = Graph()
    below = {"x": -2.0, "y": 3.0, "a": -1.0}
    assert math.isnan(evaluate(g, [build(g, text)], below)[0])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sqrt(x^2 + y^2)^2", lambda x, y: x * x + y * y),
        ("sqrt(x^2 + y^2)*y*sqrt(x^2 + y^2)", lambda x, y: y * (x * x + y * y)),
        ("sqrt(x + 5)*y*sqrt(x + 5)", lambda x, y: y * (x + 5)),
        ("(3*cbrt(x))^3/y", lambda x, y: 27 * x / y),
        ("abs(x)^3", lambda x, _: abs(x) ** 3), ("abs(x)*x", lambda x, _: abs(x) * x),
        ("abs(x)*abs(y)*abs(x)", lambda x, y: x * x * abs(y)),
        ("cbrt(x)^4", lambda x, _: x * np.cbrt(x)),
        ("cbrt(x)*cbrt(x)", lambda x, _: np.cbrt(x) ** 2),
        ("hypot(x, y)^3", lambda x, y: (x * x + y * y) ** 1.5),
        ("hypot(x, y)^2*hypot(x, y)", lambda x, y: (x * x + y * y) ** 1.5),
        ("(x*hypot(x, y))^-2", lambda x, y: (x * x * (x * x + y * y)) ** -1),
    ],
)  # fmt: skip
def test_values(text, expected):
    g = Graph()
    node = build(g, text)
    for x in (-1.5, -0.3, 0.7, 2.0):
        for y in (-2.5, 0.4):
            [found] = evaluate(g, [node], {"x": x, "y": y})
            assert found == pytest.approx(expected(x, y), rel=4e-15)


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(x^2 + y^2)*sqrt(x^2 + y^2)", "hypot(x, y)^2", "abs(x)^2 + abs(y)^2",
        "(a*sqrt(x^2 + y^2))^2/a^2", "sqrt(a*x^2 + a*y^2)*sqrt(a*x^2 + a*y^2)/a",
    ],
)  # fmt: skip
def test_slopes_at_rest(text):
    # All of them are x^2 + y^2: no slope at 0, and two for the slope of the slope.
    g = Graph()
    x, y = g.variable("x"), g.variable("y")
    first = gradient(g, build(g, text), [x, y])
    second = [gradient(g, n, [x, y]) for n in first]
    rest = {"x": 0.0, "y": 0.0, "a": 2.0}
    assert evaluate(g, first, rest) == pytest.approx([0.0, 0.0])
    assert evaluate(g, [second[0][0], second[1][1]], rest) == pytest.approx([2.0, 2.0])
    assert evaluate(g, [second[0][1]], rest) == [0.0]


def test_signs_that_are_seen():
    g = Graph()
    seen = "x^2 + 3*y^4 + abs(t)*exp(x)/hypot(x, y) + max(0, x^2) + if(x > 0, 1, y^2)"
    assert never_negative(g, build(g, seen))
    for text in (
        "x",
        "x^3",
        "a*x^2",
        "x^2 - 1",
        "-(x^2)",
        "sin(x)",
        "x*y",
        "max(0, x)",
    ):
        assert not never_negative(g, build(g, text))
    many = " + ".join(f"x{k}^2" for k in range(1000))  # is not looked through
    assert not never_negative(g, build(g, many))


@pytest.mark.parametrize("speed", ["v^2", "v*v", "(2*v)^2/4", "hypot(x_dot, y_dot)^2"])
def test_a_fall_from_rest(speed):
    found = run(f"""
definitions: {{v: sqrt(x_dot^2 + y_dot^2)}}
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: "{speed}/2", potential: 9.8*y}}
initial: {{x: 0, y: 0}}
simulation: {{duration: 1}}
""")
    assert found["y"][-1] == pytest.approx(-4.9, rel=1e-10)
