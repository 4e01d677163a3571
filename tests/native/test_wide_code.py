"""Code for several states at once against that for one: the same bits."""

from __future__ import annotations

import ctypes
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import Graph
from lagsim.native.graph import keys
from lagsim.native.graph.sincos import LANES
from lagsim.native.graph.straight_line import generate
from tests.language._programs import on_graph, programs, states
from tests.native.test_graph_code import STATE, VALUES, Compiled, build, long_functions
from tests.native.test_tape_code import bits

MOVING = (*STATE, "t")


def compare(g: Graph, nodes: list[int], some: list[dict[str, float]]) -> None:
    """Compare both on states that differ in what moves."""
    one = Compiled(g, {"f": nodes})
    several = Compiled(g, {"f": nodes}, partial(generate, wide=("f",)))
    still = {k: v for k, v in some[0].items() if k not in MOVING}
    lanes = [{**state, **still} for state in some]
    several.prepare(lanes[0])
    y = np.array([[s.get(name, 0.0) for s in lanes] for name in ("t", *STATE)])
    out = np.zeros((len(nodes), LANES))
    kinds = (ctypes.c_double, *[ctypes.c_void_p] * 3)
    call = several.engine.function("f", None, kinds)
    call(0.0, y.ctypes.data, several.p.ctypes.data, out.ctypes.data)
    for lane, state in enumerate(lanes):
        assert bits(out[:, lane].tolist()) == bits(one.at(state))


@given(
    st.lists(programs(), min_size=20, max_size=20),
    st.lists(states, min_size=LANES, max_size=LANES),
)
@settings(max_examples=6, deadline=None, derandomize=True)
def test_random_expressions(many: Any, some: Any) -> None:
    g = Graph()
    compare(g, [on_graph(g, program) for program in many], some)


def shifted() -> list[dict[str, float]]:
    return [{name: x + 0.3 * k for name, x in VALUES.items()} for k in range(LANES)]


@pytest.mark.parametrize("piece", [7, 400])
def test_long_functions(piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keys, "PIECE", piece)
    g = Graph()
    compare(g, long_functions(g)["f"], shifted())


def test_every_operation() -> None:
    g = Graph()
    x, y = build(g, "x/9", "y/7")
    test = g.call("and", g.call("lt", x, y), g.call("not", g.call("ge", x, g.one)))
    nodes = [g.call("if", test, x, y), *build(g, "x^3", "y^-2", "t^1.5", "z^0.3")]
    for name, row in OPERATIONS.items():
        if not row.condition and name != "if":
            nodes.append(g.call(name, *(x, y)[: row.arity]))
    compare(g, nodes, shifted())
