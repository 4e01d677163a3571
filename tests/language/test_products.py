"""What is fixed is multiplied first, and the value stays."""

from __future__ import annotations

import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.forms import slow_factors_first
from lagsim.language.graph import Graph
from lagsim.language.parser import parse


def build(g: Graph, text: str) -> int:
    return parse(text).build(g, g.variable)


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("l*(cos(a)*v)", "(l*cos(a))*v"), ("v*(v*(sin(a)*l))", "(l*sin(a))*(v*v)"),
        ("m*(2*(v + w))", "(m*2)*(v + w)"), ("-(v*(a*m))", "-((m*a)*v)"),
        ("(v*a)*m/(w*l)", "((m*a)*v)/(l*w)"), ("a*a*l", "l*(a*a)"),
    ],
)  # fmt: skip
def test_slow_factors_come_first(text: str, written: str) -> None:
    g = Graph()
    node, expected = build(g, text), build(g, written)
    [found] = slow_factors_first(g, [node], {"a", "t"}, {"v", "w"})
    assert found == expected


def test_a_product_that_others_need_is_made_once() -> None:
    g = Graph()
    nodes = [build(g, text) for text in ("(v*w)*m", "(v*w)*l", "v*w")]
    moving = {"v", "w"}
    found = slow_factors_first(g, nodes, {"a"}, moving)
    assert g.cost(found, moving) <= g.cost(nodes, moving) == 3
    values = {"v": 3.0, "w": 5.0, "m": 7.0, "l": 11.0}
    assert evaluate(g, found, values) == [105.0, 165.0, 15.0]
