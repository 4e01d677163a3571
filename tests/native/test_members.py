"""Loops over the members of elements, in native code, against values in Python."""

from __future__ import annotations

import ctypes

import numpy as np

from lagsim.language.derivatives import gradient, tangent
from lagsim.language.elements import (
    EACH,
    SHARED,
    TOTAL,
    ElementOutput,
    Elements,
    Slot,
    part,
    sums,
)
from lagsim.language.evaluate import evaluate, roundings
from lagsim.language.graph import Graph
from lagsim.native.graph import tapes
from lagsim.native.graph.keys import Layout
from lagsim.native.link.engine import Engine, compile_object

N = 4


def pair_terms() -> Elements:
    """Return m_i m_j c_ij / sqrt((x_i - x_j)^2 + k) over pairs, c_ij a number."""
    g = Graph()
    xi, xj, mi, mj, k, c = (g.variable(s) for s in ("xi", "xj", "mi", "mj", "k", "c"))
    apart = g.call("sub", xi, xj)
    square = g.call("add", g.call("mul", apart, apart), k)
    masses = g.call("mul", g.call("mul", mi, mj), c)
    term = g.call("div", masses, g.call("sqrt", square))
    rows = [(i, j, i * N + j) for i in range(N) for j in range(i + 1, N)]
    each, empty, none = np.arange(N), np.zeros(0, np.int64), np.zeros(0)
    slots = [
        Slot(xi, 0, each, none),
        Slot(xj, 1, each, none),
        Slot(mi, 0, N + each, none),
        Slot(mj, 1, N + each, none),
        Slot(k, SHARED, np.array([2 * N]), none),
        Slot(c, 2, empty, np.linspace(1.0, 2.0, N * N)),
    ]
    table = np.array(rows, np.int32)
    return Elements(g, slots, [ElementOutput(term, TOTAL)], table, 2 * N + 1, 1)


def test_loops_have_the_values_of_the_terms() -> None:
    g, of = Graph(), pair_terms()
    names = [f"x{i}" for i in range(N)]
    x = [g.variable(name) for name in names]
    m = [g.call("exp", g.variable(f"m{i}")) for i in range(N)]
    args = [*x, *m, g.variable("k")]
    energy = part(g, sums(g, of, args), 0)
    slopes = gradient(g, energy, x)
    seed = {v: g.constant(i + 1.0) for i, v in enumerate(x)}
    weighted = g.product_sum((g.constant(i - 0.5), s) for i, s in enumerate(slopes))
    listed = sums(g, of.listed(of.outputs[0].node), args)
    functions = {
        "energy": [energy, *slopes, g.call("mul", g.variable("t"), energy)],
        "rates": [*tangent(g, slopes, seed), *gradient(g, weighted, x)],
        "bounds": roundings(g, slopes, names, names),
        "listed": [g.one, listed, g.variable("x1")],
    }
    layout = Layout(
        y={name: i for i, name in enumerate(names)},
        p={**{f"m{i}": 1 + i for i in range(N)}, "k": 1 + N},
        fixed=frozenset(("m0", "m1", "k")),
        size=2 + N,
    )
    values = {"t": 0.3, "k": 0.2, **{f"m{i}": 0.1 * i for i in range(N)}}
    values |= {name: 1.3 * i - 0.4 * i**2 for i, name in enumerate(names)}
    code = tapes.generate(g, functions, layout)
    engine = Engine([compile_object(code.ir, optimise=False)])
    p = np.full(code.p_size + 1, 12345.0)
    for name, k in layout.p.items():
        p[k] = values[name]
    y = np.array([values[name] for name in names])
    kinds = (ctypes.c_double, *[ctypes.c_void_p] * 3)
    pointer = ctypes.c_void_p(None)
    engine.function("prepare", None, kinds)(0.0, pointer, p.ctypes.data, pointer)
    for name, nodes in functions.items():
        numbers = [np.atleast_1d(v) for v in evaluate(g, nodes, values)]
        expected = np.concatenate(numbers)
        out = np.full(len(expected) + 1, 12345.0)
        call = engine.function(name, None, kinds)
        call(0.3, y.ctypes.data, p.ctypes.data, out.ctypes.data)
        assert np.allclose(out[:-1], expected, rtol=1e-14, atol=1e-15)
        assert out[-1] == p[-1] == p[0] == 12345.0  # nothing else is written to


def test_results_at_each_member_are_in_order() -> None:
    of = pair_terms()
    values = [1.0, 3.0, 4.0, 8.0, 1.0, 2.0, 3.0, 4.0, 0.0]
    listed = of.listed(of.outputs[0].node)
    assert [o.slot for o in listed.outputs] == [EACH]
    c = np.linspace(1.0, 2.0, N * N)
    expected = [
        c[i * N + j] * values[N + i] * values[N + j] / abs(values[i] - values[j])
        for i in range(N)
        for j in range(i + 1, N)
    ]
    assert np.allclose(listed.evaluate(values), expected, rtol=1e-15)
    assert np.isclose(of.evaluate(values)[0], np.sum(expected), rtol=1e-14)
