"""The digest of a graph tells what its code depends on, and nothing else."""

from __future__ import annotations

import pytest

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import Graph
from lagsim.native.graph import keys
from lagsim.native.graph.keys import Layout, fingerprint
from lagsim.native.graph.straight_line import generate

LAYOUT = Layout(y={"x": 0, "v": 1}, p={"k": 0, "c": 1}, fixed=frozenset("kc"), size=2)


def graph(before: int = 0) -> tuple[Graph, dict[str, list[int]]]:
    """Give k*sin(x) - 2.5*v, with some nodes of no use before it."""
    g = Graph()
    for k in range(before):
        g.call("exp", g.call("mul", g.constant(3.0 + k), g.variable("unused")))
    spring = g.call("mul", g.variable("k"), g.call("sin", g.variable("x")))
    drag = g.call("mul", g.constant(2.5), g.variable("v"))
    return g, {"f": [g.call("sub", spring, drag), g.zero]}


def digest(g: Graph, functions: dict[str, list[int]], layout: Layout = LAYOUT) -> str:
    return fingerprint(g, functions, layout, {"sparse": ()})


def test_numbers_of_nodes_say_nothing() -> None:
    first, second = graph(), graph(before=7)
    assert first[1]["f"] != second[1]["f"]
    assert digest(*first) == digest(*second)
    assert generate(*first, LAYOUT) == generate(*second, LAYOUT)


OTHERS = {
    "a number": lambda g, f: {"f": [g.call("mul", f["f"][0], g.constant(2.0)), g.zero]},
    "a number in the last place": lambda g, _: {
        "f": [
            g.call(
                "sub",
                g.call("mul", g.variable("k"), g.call("sin", g.variable("x"))),
                g.call("mul", g.constant(2.5 + 2.0**-51), g.variable("v")),
            ),
            g.zero,
        ]
    },
    "a variable": lambda g, f: {
        "f": g.substitute(f["f"], {g.variable("v"): g.variable("c")})
    },
    "an operation": lambda g, f: {"f": [g.call("cos", f["f"][0]), g.zero]},
    "a name": lambda _, f: {"g": f["f"]},
    "an order": lambda _, f: {"f": f["f"][::-1]},
    "one more": lambda _, f: {"f": f["f"], "h": f["f"]},
}


@pytest.mark.parametrize("what", OTHERS)
def test_other_functions_are_told_apart(what: str) -> None:
    g, functions = graph()
    others = OTHERS[what](g, functions)
    assert generate(g, others, LAYOUT) != generate(g, functions, LAYOUT)
    assert digest(g, others) != digest(g, functions)


@pytest.mark.parametrize(
    "layout",
    [
        LAYOUT._replace(y={"x": 1, "v": 0}),
        LAYOUT._replace(p={"k": 1, "c": 0}),
        LAYOUT._replace(size=3),
        LAYOUT._replace(fixed=frozenset("c")),
    ],
)
def test_other_layouts_are_told_apart(layout: Layout) -> None:
    g, functions = graph()
    assert digest(g, functions, layout) != digest(g, functions)


def test_the_manner_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    g, functions = graph()
    before = digest(g, functions)
    assert fingerprint(g, functions, LAYOUT, {"sparse": ("f",)}) != before
    monkeypatch.setattr(keys, "PIECE", 1)
    assert digest(g, functions) != before


@pytest.mark.parametrize(
    ("name", "counts"), [("sin", True), ("mul", True), ("tanh", False)]
)
def test_the_native_code_of_the_functions_that_are_used_counts(
    monkeypatch: pytest.MonkeyPatch, name: str, *, counts: bool
) -> None:
    g, functions = graph()
    before = digest(g, functions)
    other = OPERATIONS[name]._replace(native="fadd double {0}, {0}")
    monkeypatch.setitem(OPERATIONS, name, other)
    assert (digest(g, functions) != before) is counts
