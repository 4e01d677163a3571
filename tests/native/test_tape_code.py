"""Tapes against native code of the same graph: the same bits."""

from __future__ import annotations

import math
import struct
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from lagsim.language.graph import Graph
from lagsim.native.graph import tapes
from tests.language._programs import on_graph, programs, states
from tests.native.test_graph_code import (
    GUARD,
    LAYOUT,
    SIZE,
    VALUES,
    Compiled,
    build,
    long_functions,
)


def bits(found: list[float]) -> list[bytes]:
    return [b"nan" if math.isnan(x) else struct.pack("<d", x) for x in found]


def pair(g: Graph, functions: Any) -> tuple[Compiled, Compiled]:
    """Give the same functions on tapes and in straight-line code."""
    return Compiled(g, functions, tapes.generate), Compiled(g, functions)


@given(st.lists(programs(), min_size=20, max_size=20), st.lists(states, min_size=3))
@settings(max_examples=15, deadline=None, derandomize=True)
def test_random_expressions(many: Any, some_states: Any) -> None:
    g = Graph()
    tape, code = pair(g, {"f": [on_graph(g, program) for program in many]})
    for state in some_states:
        assert bits(tape.at(state)) == bits(code.at(state))


def test_several_functions_and_parameters() -> None:
    g = Graph()
    functions = long_functions(g)
    tape, code = pair(g, functions)
    for shift in (0.0, 0.4, -1.9):
        values = {name: x + shift for name, x in VALUES.items()}
        for name in functions:
            assert bits(tape.at(values, name)) == bits(code.at(values, name))
        # Not only after `prepare`: no call spoils what another one needs.
        for name in functions:
            length = len(functions[name])
            again = tape.call(name, values, length)
            assert bits(again) == bits(code.call(name, values, length))


def test_leaves_numbers_and_repeats() -> None:
    g = Graph()
    nodes = build(
        g, "x", "a", "w", "t", "2.5", "x", "1/0", "a*b", "a*b", "x*a", "z", "x*x + x*x"
    )
    nodes += [g.call("pow", nodes[0], g.constant(e)) for e in (-2.5, 3.0, 0.3)]
    tape, code = pair(g, {"f": nodes, "g": []})
    assert bits(tape.at(VALUES)) == bits(code.at(VALUES))
    # A variable in p that is not fixed is read each time.
    tape.p[LAYOUT.p["w"]] = 5.0
    assert tape.call("f", VALUES, len(nodes))[2] == 5.0


def test_memory_is_used_again() -> None:
    g = Graph()
    node = g.variable("x")
    for k in range(1000):
        node = g.call("sin", g.call("mul", node, g.constant(1.0 + k % 3)))
    tape = Compiled(g, {"f": [node]}, tapes.generate)
    # Two values at once; three numbers, of which one is 1 and multiplies nothing.
    assert tape.code.p_size <= SIZE + 2 + 2


def links(g: Graph, n: int) -> list[int]:
    """Give nodes that repeat themselves link by link, with sums along the chain.

    Sines of sums of angles, of which some are sines; conditions; values of the link
    before and of the one before that; a product that is used once, and one twice.
    """
    x, a, w = (g.variable(name) for name in "xaw")
    angle, far, found = x, g.variable("y"), []
    for k in range(n):
        angle = g.call("add", angle, g.constant(0.1 + k / 7))
        sine, cosine = g.call("sin", angle), g.call("cos", angle)
        if k % 5 == 4:
            sine = g.call("sin", sine)
        along = g.call("mul", g.call("mul", a, cosine), w)
        near = g.call("sub", g.call("mul", far, sine), g.call("mul", along, sine))
        high = g.call("gt", near, along)
        far = g.call("if", high, g.call("div", near, g.call("exp", far)), along)
        found += [far, cosine]
    return [*found, g.variable("t"), x, far]


def test_what_repeats_itself() -> None:
    g = Graph()
    for n in (3, 17, 40):
        tape, code = pair(g, {"f": links(g, n), "g": links(g, 12)})
        assert bits(tape.at(VALUES)) == bits(code.at(VALUES))
        assert bits(tape.at(VALUES, "g")) == bits(code.at(VALUES, "g"))


def test_the_machine_is_as_long_for_many_links() -> None:
    def machine(n: int) -> str:
        g = Graph()
        ir = tapes.generate(g, {"f": links(g, n)}, LAYOUT).ir
        return ir[: ir.index("@tape.f")]

    many = machine(1000)
    assert "br i1" in many
    assert len(many) < 1.5 * len(machine(100))


def test_sines_wait_for_angles_that_are_sines() -> None:
    g = Graph()
    x, found = g.variable("x"), []
    for k in range(40):
        one = g.call("sin", g.call("mul", x, g.constant(1.0 + k)))
        found += [g.call("cos", one), g.call("sin", g.call("cos", one)), one]
    tape, code = pair(g, {"f": found})
    assert bits(tape.at(VALUES)) == bits(code.at(VALUES))


def test_zeros_are_not_written_where_they_are_found() -> None:
    g = Graph()
    nodes = [g.zero, *build(g, "x*a", "0", "w"), g.zero]

    def generate(*given: Any) -> Any:
        return tapes.generate(*given, sparse=("f",))

    tape = Compiled(g, {"f": nodes, "g": nodes}, generate)
    whole, sparse = tape.at(VALUES, "g"), tape.at(VALUES)
    assert whole == [0.0, VALUES["x"] * VALUES["a"], 0.0, VALUES["w"], 0.0]
    assert sparse == [GUARD, whole[1], GUARD, whole[3], GUARD]
