"""Nodes that several surfaces or groups share: orientation, and owners."""

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.mechanics.groups import NOBODY, SEVERAL, owners_of
from lagsim.mechanics.surfaces import Surface, oriented


@pytest.mark.parametrize(
    "others",
    [
        ("x - y", "y - x", "-(x - y)", "3*(x - y)", "(y - x)/4", "-2*(y - x)/(-7)"),
        ("sin(x)", "-sin(x)", "sin(x)*0.5", "-sin(x)/3"),
    ],
)
def test_expressions_that_vanish_together_are_one_surface(others):
    """They differ by a sign or a constant factor; the sign is that of the factor."""
    g, state = Graph(), {"x": 0.7, "y": -0.4}
    nodes = [parse(text).build(g, g.variable) for text in others]
    found = [oriented(g, Surface(g.call("sign", node), "sign", node)) for node in nodes]
    assert len({node for node, _ in found}) == 1
    for node, (one, sign) in zip(nodes, found, strict=True):
        value, common = evaluate(g, [node, one], state)
        assert np.sign(value) == sign * np.sign(common)


def test_owners_of_nodes_are_one_group_several_or_none():
    g = Graph()
    names = {"x": 0, "x_dot": 0, "y": 1, "z": 2}
    expected = {
        "3*k + t": NOBODY,
        "k*x": 0,
        "x_dot^2 + sin(x)": 0,
        "k*y - 1": 1,
        "x*y": SEVERAL,
        "k*(y + z)": SEVERAL,
        "sin(x*y)*z": SEVERAL,
        "x*y + x": SEVERAL,
    }
    for text, owner in expected.items():
        node = parse(text).build(g, g.variable)
        assert owners_of(g, g.cone([node]), names)[node] == owner, text
