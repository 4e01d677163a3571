"""Graphs as sympy expressions: names, numbers, conditions, depth.

The twin of each function is tried in test_functions, of random ones in
test_derivatives.
"""

from __future__ import annotations

import pytest
import sympy as sp

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.show.symbols import symbol, to_sympy


def twin(text: str) -> sp.Expr:
    g = Graph()
    return to_sympy(g, [parse(text).build(g, g.variable)])[0]


@pytest.mark.parametrize("name", ["E", "I", "S", "N", "beta", "lambda", "zoo", "größe"])
def test_names_are_only_names(name: str) -> None:
    found = twin(f"2*{name}")
    assert found == 2 * symbol(name)
    assert [s.name for s in found.free_symbols] == [name]
    assert symbol(name).is_real


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("x/2", "x/2"),
        ("0.75*x", "3*x/4"),
        ("9.8*x", "9.8*x"),
        ("3*x", "3*x"),
        ("x^1.5", "x**(3/2)"),
        ("x - x", "0"),
        ("1e-9*x", "1.0e-9*x"),
        ("1e12*x", "1000000000000.0*x"),
    ],
)
def test_numbers_are_shown_as_people_write_them(text: str, shown: str) -> None:
    assert str(twin(text)) == shown


@pytest.mark.parametrize("x", [0.1, 1 / 3, 2.0**-40, 1e300, 5e-324, 9.80665, 1e9 + 0.5])
def test_numbers_keep_their_bits(x: float) -> None:
    g = Graph()
    assert float(to_sympy(g, [g.constant(x)])[0]) == x


def test_conditions() -> None:
    g = Graph()
    text = "if(x > 0 and not y <= 1 or x < -3, x^2, if(y >= 2, y, 0.3))"
    node = parse(text).build(g, g.variable)
    found = to_sympy(g, [node])[0]
    for x in (-4.0, -1.0, 0.0, 2.0):
        for y in (0.5, 1.0, 2.0, 3.0):
            value = found.subs({symbol("x"): x, symbol("y"): y})
            assert float(value) == evaluate(g, [node], {"x": x, "y": y})[0]
    assert to_sympy(g, [g.truth(True), g.truth(False)]) == [sp.true, sp.false]


@pytest.mark.slow
def test_depth_is_no_limit() -> None:
    g = Graph()
    node = x = g.variable("x")
    for _ in range(1500):
        node = g.call("atan", g.call("add", node, x))
    found = to_sympy(g, [node, x])
    assert found[0].func == sp.atan
    assert found[1] == symbol("x")
