"""What is called a few times is not optimised, and gives the same bits."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.graph import Graph
from lagsim.native.graph.keys import Layout
from lagsim.native.graph.straight_line import generate
from lagsim.native.kernels.code import translate
from lagsim.native.kernels.words import is_rare, rare
from lagsim.native.link.engine import Engine, compile_object

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

POINTER = ctypes.c_void_p


def summed(n: int, y: Floats) -> float:
    result = 0.0
    for i in range(n):
        result = result * 1.1 + y[i] / 3.0
    return result


@rare
def summed_rarely(n: int, y: Floats) -> float:
    result = 0.0
    for i in range(n):
        result = result * 1.1 + y[i] / 3.0
    return result


def both(n: int, y: Floats, out: Floats) -> None:
    out[0] = summed(n, y)
    out[1] = summed_rarely(n, y)


def test_kernels_give_the_same_bits() -> None:
    assert is_rare(summed_rarely)
    assert not is_rare(summed)
    ir = translate([both])
    heads = [line for line in ir.splitlines() if line.startswith("define")]
    assert ["optnone" in head for head in heads if "rarely" in head] == [True]
    assert sum("optnone" in head for head in heads) == 1
    y, out = np.random.default_rng(3).normal(size=50), np.zeros(2)
    engine = Engine([compile_object(ir)])
    function = engine.function("both", None, (ctypes.c_int64, POINTER, POINTER))
    function(50, y.ctypes.data, out.ctypes.data)
    assert out[0] == out[1] == summed(50, y)


def test_functions_of_a_graph_give_the_same_bits() -> None:
    g = Graph()
    x = node = g.variable("x")
    for k in range(900):  # several pieces
        node = g.call("sin", g.call("add", g.call("mul", x, node), g.constant(k / 7)))
    layout = Layout(y={"x": 0}, p={}, fixed=frozenset(), size=0)
    code = generate(g, {"often": [node], "seldom": [node]}, layout, rare=("seldom",))
    heads = [line for line in code.ir.splitlines() if line.startswith("define")]
    assert {"optnone" in head for head in heads if "@seldom." in head} == {True}
    assert {"optnone" in head for head in heads if "@often" in head} == {False}
    engine = Engine([compile_object(code.ir, optimise=False)])
    y, p, out = np.array([0.37]), np.zeros(code.p_size), np.zeros(2)
    for k, name in enumerate(("often", "seldom")):
        types = (ctypes.c_double, POINTER, POINTER, POINTER)
        function = engine.function(name, None, types)
        function(0.0, y.ctypes.data, p.ctypes.data, out[k:].ctypes.data)
    assert out[0] == out[1] != 0.0
