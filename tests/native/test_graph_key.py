"""The digest of a graph depends on the inputs of its code, and on no other data."""

from __future__ import annotations

import pytest

from lagsim.language.functions import OPERATIONS
from lagsim.language.graph import Graph
from lagsim.native.graph import keys
from lagsim.native.graph.keys import Layout, fingerprint
from lagsim.native.graph.straight_line import generate
from tests.native.test_graph_code import build

LAYOUT = Layout(y={"x": 0, "v": 1}, p={"k": 0, "c": 1}, fixed=frozenset("kc"), size=2)
TEXT = "k*sin(x) - 2.5*v"


def digest(text: str = TEXT, layout: Layout = LAYOUT, once: object = ()) -> str:
    g = Graph()
    functions = {"f": [*build(g, text), g.zero]}
    return fingerprint(g, functions, layout, {"once": once})


def test_numbers_of_nodes_say_nothing() -> None:
    g = Graph()
    build(g, *(f"exp({k}*unused)" for k in range(3, 9)))
    functions = {"f": [*build(g, TEXT), g.zero]}
    assert fingerprint(g, functions, LAYOUT, {"once": ()}) == digest()


def test_what_has_other_code_has_another_digest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    texts = ["2*(k*sin(x) - 2.5*v)", "k*sin(x) - 2.5000000000000004*v", "cos(x)"]
    texts.append(TEXT.replace("v", "c"))
    others = [
        LAYOUT._replace(y={"x": 1, "v": 0}),
        LAYOUT._replace(p={"k": 1, "c": 0}),
        LAYOUT._replace(size=3),
        LAYOUT._replace(fixed=frozenset("c")),
    ]
    found = [digest(), *map(digest, texts), *(digest(layout=x) for x in others)]
    found.append(digest(once=("f",)))
    g = Graph()
    f, h = build(g, TEXT, "x")
    named = [{"g": [f]}, {"f": [f]}, {"f": [f, h]}, {"f": [h, f]}, {"f": [f], "g": [f]}]
    found += [fingerprint(g, x, LAYOUT) for x in named]
    assert len({generate(g, x, LAYOUT).ir for x in named}) == len(named)
    monkeypatch.setattr(keys, "PIECE", 1)
    found.append(digest())
    assert len(set(found)) == len(found)


@pytest.mark.parametrize(
    ("name", "counts"), [("sin", True), ("mul", True), ("tanh", False)]
)
def test_the_native_code_of_the_functions_that_are_used_counts(
    monkeypatch: pytest.MonkeyPatch, name: str, *, counts: bool
) -> None:
    before = digest()
    other = OPERATIONS[name]._replace(native="fadd double {0}, {0}")
    monkeypatch.setitem(OPERATIONS, name, other)
    assert (digest() != before) is counts
