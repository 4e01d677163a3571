"""Loops over expressions of equal form have the bits of straight-line code."""

from __future__ import annotations

import ctypes
import math
import random
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.graph import Graph
from lagsim.native.graph import repeated
from lagsim.native.graph.keys import Layout
from lagsim.native.graph.straight_line import Code, generate
from lagsim.native.link.engine import Engine, compile_object

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import pytest

N = 40


def layout(n: int) -> Layout:
    """Families x in y and c, w in p; the numbers of c are fixed."""
    return Layout(
        y={f"x.{i}": i for i in range(n)},
        p={f"c.{i}": 1 + i for i in range(n)} | {f"w.{i}": 1 + n + i for i in range(n)},
        fixed=frozenset(f"c.{i}" for i in range(n)),
        size=1 + 2 * n,
    )


def called(code: Code, n: int, lengths: Mapping[str, int]) -> dict[str, bytes]:
    """Return the results of all functions, at numbers of both signs and sizes."""
    engine = Engine([compile_object(code.ir, optimise=False)])
    rng = np.random.default_rng(7)
    y, p = rng.normal(size=n) * 10.0 ** rng.integers(-3, 3, n), np.zeros(code.p_size)
    p[: 1 + 2 * n] = rng.normal(size=1 + 2 * n)
    y[3] = y[4] = math.nan
    found = {}
    for name in ("prepare", *lengths):
        out = np.full(lengths.get(name, 0) + 1, 5.0)
        kinds = (ctypes.c_double, *[ctypes.c_void_p] * 3)
        engine.function(name, None, kinds)(0.3, *(a.ctypes.data for a in (y, p, out)))
        assert out[-1] == 5.0
        found[name] = out.tobytes()
    return found


def both(
    monkeypatch: pytest.MonkeyPatch,
    g: Graph,
    functions: Mapping[str, Sequence[int]],
    n: int,
) -> tuple[Code, Code]:
    """Return code with loops and without, after a test that values have equal bits."""
    lengths = {name: len(nodes) for name, nodes in functions.items()}
    looped = generate(g, functions, layout(n))
    with monkeypatch.context() as changed:
        changed.setattr(repeated, "SAVED", 10**9)
        straight = generate(g, functions, layout(n))
    assert called(looped, n, lengths) == called(straight, n, lengths)
    return looped, straight


def chain(g: Graph, n: int) -> dict[str, list[int]]:
    """Return forces, energies and bounds of a chain of springs, and their sums."""
    x, c, w = ([g.variable(f"{s}.{i}") for i in range(n)] for s in "xcw")
    two, call = g.constant(2.0), g.call
    apart = [call("sub", b, a) for a, b in pairwise(x)]
    pulls = [
        call("mul", call("mul", two, k), call("pow", d, g.constant(3.0)))
        for k, d in zip(c, apart, strict=False)
    ]
    forces = [call("sub", b, a) for a, b in pairwise(pulls)]
    powers = [call("mul", f, v) for f, v in zip(forces, w, strict=False)]
    totals = [powers[0]]
    for power in powers[1:]:
        totals.append(call("add", totals[-1], power))
    signs = [
        call("if", call("gt", f, g.zero), v, call("sin", v))
        for f, v in zip(forces, w, strict=False)
    ]
    return {
        "forces": [*forces, *x, *c, *[c[0]] * n, *[g.one] * n, g.variable("t")],
        "work": [totals[-1]],
        "works": [*totals, *(call("abs", a) for a in totals)],
        "signs": signs,
        "masked": [
            call("if", call("and", call("gt", a, g.zero), call("lt", b, two)), a, b)
            for a, b in zip(x, w[3:] + w[:3], strict=True)
        ],
        "numbers": [
            call("add", call("mul", g.constant(0.1 * i * i), a), g.constant(0.5))
            for i, a in enumerate(x, 1)
        ],
    }


def test_code_of_families_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = []
    for n in (N, 3 * N):
        g = Graph()
        functions = chain(g, n)
        looped, straight = both(monkeypatch, g, functions, n)
        sizes.append((looped.ir.count("\n"), straight.ir.count("\n")))
    (looped, straight), (more, much_more) = sizes
    assert much_more > 2.5 * straight
    sines = 3 * 2 * N  # are evaluated in the lanes of vectors, not by loops
    assert more - looped < 6 * sines


def test_values_have_equal_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Random expressions of few forms, which share parts, in random order."""
    loops = 0
    for seed in range(6):
        rng, g = random.Random(seed), Graph()
        layers = [[g.variable(f"{s}.{i}") for i in range(N)] for s in "xcw"]
        results = list[int]()
        for _ in range(rng.randint(2, 5)):
            op, inner = rng.choice(["add", "sub", "mul", "max"]), rng.choice("am")
            first, second = rng.choices(layers, k=2)
            made = []
            for _ in range(rng.randint(30, 60)):
                a, b, c = rng.choice(first), rng.choice(second), rng.choice(first)
                unary = g.call("abs", a) if inner == "a" else g.call("mul", a, c)
                made.append(g.call(op, unary, b))
            layers.append(made)
            results += made
        total = g.sum(dict.fromkeys(layers[-1]))
        results += [total, g.call("mul", total, layers[0][0])]
        rng.shuffle(results)
        looped, _ = both(monkeypatch, g, {"f": results, "g": results[::3]}, N)
        loops += looped.ir.count("phi i64")
    assert loops > 0


def test_sums_that_need_each_other_are_straight_line_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    g = Graph()
    x = [g.variable(f"x.{i}") for i in range(N)]
    total, results = x[0], list[int]()
    for a in x[1:]:
        total = g.call("add", total, g.call("mul", a, g.call("abs", total)))
        results.append(total)
    looped, straight = both(monkeypatch, g, {"f": results * 3}, N)
    assert "phi double" not in looped.ir
    assert looped.ir.count("\n") < 1.5 * straight.ir.count("\n")
