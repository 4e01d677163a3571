"""A model's functions for many states, with parameters of their own: the same bits."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lagsim.language.graph import Graph
from lagsim.native.graph import keys, lanes, order_loop
from lagsim.native.graph.straight_line import Code, generate
from lagsim.native.kernels.lines import LANES
from lagsim.native.kernels.wide_values import symbol
from tests.language._programs import on_graph, programs, states
from tests.native.test_graph_code import STATE, VALUES, Compiled, long_functions
from tests.native.test_order_loop import MOTIONS, both
from tests.native.test_tape_code import bits


def written(g: Graph, functions: Any, layout: Any) -> Code:
    """Give the code for one, which prepares, with that for many."""
    one = generate(g, functions, layout)
    many = lanes.generate(g, functions, layout, ("f",))
    definitions = [*one.ir.splitlines(), *many.ir.splitlines()]
    declared = [x for x in definitions if x.startswith("declare")]
    rest = [x for x in one.ir.splitlines() if not x.startswith("declare")]
    rest += [x for x in without(many.ir, one.ir) if not x.startswith("declare")]
    ir = "\n".join([*dict.fromkeys(declared), *rest, ""])
    return Code(ir, max(one.p_size, many.p_size))


def without(ir: str, known: str) -> list[str]:
    """Give the lines of what is not defined in other code, too."""
    parts = ["define " + x for x in ir.split("define ")[1:]]
    return [
        line
        for part in parts
        if part.splitlines()[0] not in known
        for line in part.splitlines()
    ]


def compare(
    g: Graph, nodes: Any, some: list[dict[str, float]], length: int = 0
) -> None:
    one = Compiled(g, {"f": nodes})
    many = Compiled(g, {"f": nodes}, written)
    y = np.array([[s.get(name, 0.0) for s in some] for name in STATE])
    t = np.array([s.get("t", 0.0) for s in some])
    p = []
    for state in some:
        many.prepare(state)
        p.append(many.p.copy())
    own = np.array(p).T.copy()
    length = length or len(nodes)
    out = np.zeros((length, LANES))
    call = many.engine.function(symbol("f"), None, [ctypes.c_void_p] * 4)
    call(t.ctypes.data, y.ctypes.data, own.ctypes.data, out.ctypes.data)
    for lane, state in enumerate(some):
        one.prepare(state)
        assert bits(out[:, lane].tolist()) == bits(one.call("f", state, length))


@given(
    st.lists(programs(), min_size=20, max_size=20),
    st.lists(states, min_size=LANES, max_size=LANES),
)
@settings(max_examples=2, deadline=None, derandomize=True)
def test_random_expressions(many: Any, some: Any) -> None:
    g = Graph()
    compare(g, [on_graph(g, program) for program in many], some)


@pytest.mark.parametrize("piece", [200])
def test_long_functions(piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keys, "PIECE", piece)
    g = Graph()
    some = [{name: x + 0.3 * k for name, x in VALUES.items()} for k in range(LANES)]
    compare(g, long_functions(g)["f"], some)


@pytest.mark.parametrize("edges", [0, 32])
def test_series_by_a_loop(edges: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(order_loop, "MOST_EDGES", edges)
    g, nodes, loop = both(MOTIONS[1], 5)
    some = [{name: x + 0.1 * k for name, x in VALUES.items()} for k in range(LANES)]
    compare(g, loop, some, len(nodes))
