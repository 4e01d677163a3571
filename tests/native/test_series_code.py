"""Native code of Taylor series, as a loop and written out, against values in Python."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.language.series import recurrence, taylor_series
from lagsim.native.graph import loop as loop_code
from lagsim.native.graph.keys import Layout, Loop, Manner
from lagsim.native.graph.straight_line import generate
from lagsim.native.link.engine import Engine, compile_object

LAYOUT = Layout(y={"x": 0, "v": 1}, p={"a": 1}, fixed=frozenset(["a"]), size=3)
VALUES = {"x": 0.4, "v": -0.7, "a": 1.3, "t": 0.2}
MOTIONS = {
    "no sum": ("v", "-a*x"),
    "one sum": ("v", "-x*x"),
    "three": ("v", "-a*x^2*v/(x + 2)"),
    "a square root": ("v", "-sqrt(x + 1)*v"),
    "powers": ("v", "(x^2 + v^2 + 1)^(-1.5) - (1 + x)^0.3"),
    "sines": ("v", "-a*sin(x)*cos(v) - sin(x + v)^2"),
    "time": ("v", "cos(3*t)*x + t^2 - exp(-t)*v"),
    "a choice": ("v", "if(x > a, x*v, -x*exp(v))"),
    "many": ("v*sin(x)", "sin(x)*exp(v)/(2 + cos(x)) + atan(x*v) - log(3 + x)*tanh(v)"),
}
# Portable code calls functions of lagsim's own, which are not linked here.
CASES = [(motion, order, "host") for motion in MOTIONS for order in (4, 9)]
CASES += [(motion, 15, "host") for motion in ("no sum", "time")]
CASES += [(motion, 15, "portable") for motion in ("three", "a square root")]


def compiled(loop: Loop, g: Graph, size: int) -> list[float]:
    code = generate(g, {"series": loop}, LAYOUT, Manner(contracted=("series",)))
    engine = Engine([compile_object(code.ir, optimise=False)])
    p = np.full(code.p_size + 1, np.nan)
    p[1] = VALUES["a"]
    y = np.array([VALUES["x"], VALUES["v"]])
    out = np.full(1 + (loop.order + 1) * size + 1, np.nan)
    kinds = (ctypes.c_double, *[ctypes.c_void_p] * 3)
    arrays = [a.ctypes.data for a in (y, p, out)]
    for name in ("prepare", "series"):
        engine.function(name, None, kinds)(VALUES["t"], *arrays)
    assert np.isnan(out[-1])
    assert np.isnan(p[[0, -1]]).all()  # nothing else is written to
    assert out[0] == loop.order
    return out[1:-1].tolist()


@pytest.mark.parametrize("form", ["unrolled", "edges before", "edges in vectors"])
@pytest.mark.parametrize(("motion", "order", "cpu"), CASES)
def test_coefficients(
    motion: str, order: int, cpu: str, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LAGSIM_CPU", cpu)
    if form == "edges in vectors":
        monkeypatch.setattr(loop_code, "MOST_EDGES", 0)
    g = Graph()
    state = [g.variable("x"), g.variable("v")]
    rates = [parse(text).build(g, g.variable) for text in MOTIONS[motion]]
    unrolled = form == "unrolled"
    loop = Loop(recurrence(g, state, rates), order, unrolled=unrolled)
    found = compiled(loop, g, len(state))
    rows = taylor_series(g, state, rates, order)
    expected = evaluate(g, [node for row in rows for node in row], VALUES)
    # Rounding in some ten operations an order, of coefficients of similar sizes.
    size = max(map(abs, expected))
    assert found == pytest.approx(expected, rel=1e-13, abs=1e-14 * size)
