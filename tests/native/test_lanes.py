"""Functions of several rows at once have the bits of the function of one row."""

from __future__ import annotations

import ctypes
import re

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.native.graph import lanes, straight_line
from lagsim.native.graph.keys import Layout, Manner
from lagsim.native.link.engine import Engine, compile_object

STATE = ("x", "y", "z")
LAYOUT = Layout(
    y={name: k for k, name in enumerate(STATE)},
    p={"a": 1, "b": 2, "w": 3},
    fixed=frozenset(("a", "b")),
    size=4,
)
TEXTS = [
    "x*y - a/z + t", "-sin(a*x)*cos(x) + sin(3*t - y)^2", "x^3 + z^-2 + abs(y)^1.5",
    "sqrt(abs(x*b)) - w*z", "max(x, y) + min(y, z*w)", "abs(x - y)", "0", "2.5",
    "a*b", "t", "cos(sin(x)*b + cos(z))", "x", "min(1, sqrt(x))", "max(sqrt(x), 1)",
]  # fmt: skip
GUARD = 12345.0


def graph(texts):
    g = Graph()
    return g, [parse(text).build(g, g.variable) for text in texts]


def compiled(g, nodes, manner):
    code = straight_line.generate(g, {"observe": nodes}, LAYOUT, manner)
    engine = Engine([compile_object(code.ir, optimise=False)])
    p = np.zeros(code.p_size)
    p[1:4] = 0.9, -0.4, 0.3
    pointer = ctypes.c_void_p
    one = (ctypes.c_double, pointer, pointer, pointer)
    engine.function("prepare", None, one)(0.0, None, p.ctypes.data, None)
    return engine, p, engine.function("observe", None, one)


@pytest.mark.slow
@pytest.mark.parametrize("many", [1, 60])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_rows_have_the_bits_of_one_row(count, many):
    # Many copies at other places need several pieces of code.
    texts = [re.sub(r"\bx\b", f"(x + {k})", t) for k in range(many) for t in TEXTS]
    g, nodes = graph(texts[:600])
    engine, p, one = compiled(g, nodes, Manner(together=("observe",)))
    _, alone_p, alone = compiled(g, nodes, Manner())
    width, random = len(nodes), np.random.default_rng(count)
    # Angles above 2^20 go another way than those below.
    rows = random.normal(size=(count, 1 + len(STATE))) * np.array([1, 1, 3e6, 1])
    out = np.full((count + 1, width), GUARD)
    pointer = ctypes.c_void_p
    together = engine.function(
        "observe_rows", None, (pointer, pointer, pointer, ctypes.c_int64)
    )
    together(rows.ctypes.data, p.ctypes.data, out.ctypes.data, count)
    assert np.all(out[count] == GUARD)
    for row, found in zip(rows, out, strict=False):
        state = row[1:].copy()
        for call, memory in ((one, p), (alone, alone_p)):
            expected = np.full(width + 1, GUARD)
            addresses = (a.ctypes.data for a in (state, memory, expected))
            call(row[0], *addresses)
            assert expected[-1] == GUARD
            assert np.array_equal(found, expected[:-1], equal_nan=True)


def test_functions_of_other_operations_are_not_evaluated_together():
    for text, suits in (("x + y", True), ("exp(x)", False), ("x^y", False)):
        g, nodes = graph([text, "x", "y", "z"])
        assert lanes.suits(g, nodes, len(STATE)) is suits
    g, nodes = graph(["x", "y", "z"])  # fewer than lanes
    assert not lanes.suits(g, nodes, len(STATE))


def test_functions_of_sums_of_angles_are_products():
    texts = ["sin(x - y)*cos(x)", "cos(y)", "cos(x - y + z)", "sin(z)", "sin(a + x)"]
    g, nodes = graph(texts)
    found = lanes.with_fewer_angles(g, nodes)
    angles = {g.args[n][0] for n in g.cone(found) if g.ops[n] in ("sin", "cos")}
    # x, y, z; and a + x, as there is no function of a.
    assert len(angles) == 4
    random = np.random.default_rng(2)
    for _ in range(20):
        values = dict(zip((*STATE, "a"), random.uniform(-9, 9, 4), strict=True))
        exact = evaluate(g, nodes, values)
        # A few products of numbers below 1, each rounded to 1.1e-16.
        assert evaluate(g, found, values) == pytest.approx(exact, rel=0, abs=2e-15)
