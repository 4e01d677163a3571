"""Native code of graphs, straight-line and on tapes, against values in Python."""

from __future__ import annotations

import ctypes
import math
import struct
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lagsim.language.evaluate import evaluate, evaluate_with_error
from lagsim.language.graph import Graph
from lagsim.language.parser import parse
from lagsim.native.graph import keys, straight_line, tapes
from lagsim.native.graph.keys import Layout, Manner
from lagsim.native.graph.lines import number
from lagsim.native.graph.straight_line import Code, generate
from lagsim.native.link.engine import Engine, compile_object
from tests.language._programs import on_graph, programs, states

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

# x, y, z move and lie in y; a, b are parameters; w is written to p while running.
STATE = ("x", "y", "z")
PARAMETERS = ("a", "b")
SIZE = 4
LAYOUT = Layout(
    y={name: k for k, name in enumerate(STATE)},
    p={"a": 1, "b": 2, "w": 3},
    fixed=frozenset(PARAMETERS),
    size=SIZE,
)
VALUES = {"x": 0.7, "y": -1.3, "z": 2.5, "a": 0.9, "b": -0.4, "w": 0.3, "t": 1.1}
GUARD = 12345.0


class Compiled:
    """The functions of a graph, called with values by name."""

    def __init__(
        self,
        g: Graph,
        functions: Mapping[str, Sequence[int]],
        generate: Callable[..., Code] = generate,
    ) -> None:
        self.functions = functions
        self.code = generate(g, functions, LAYOUT)
        self.engine = Engine([compile_object(self.code.ir, optimise=False)])
        self.p = np.full(self.code.p_size + 1, GUARD)

    def call(self, name: str, values: Mapping[str, float], length: int) -> list[float]:
        pointer = ctypes.c_void_p
        kinds = (ctypes.c_double, pointer, pointer, pointer)
        y = np.array([values.get(name, 0.0) for name in STATE])
        out = np.full(length + 1, GUARD)
        call = self.engine.function(name, None, kinds)
        call(values.get("t", 0.0), *(a.ctypes.data for a in (y, self.p, out)))
        assert out[-1] == GUARD
        assert self.p[0] == self.p[-1] == GUARD  # nothing else is written to
        return out[:-1].tolist()

    def prepare(self, values: Mapping[str, float]) -> None:
        for name, k in LAYOUT.p.items():
            self.p[k] = values.get(name, 0.0)
        self.call("prepare", values, 0)

    def at(self, values: Mapping[str, float], name: str = "f") -> list[float]:
        self.prepare(values)
        return self.call(name, values, len(self.functions[name]))


def build(g: Graph, *texts: str) -> list[int]:
    return [parse(text).build(g, g.variable) for text in texts]


def bits(found: list[float]) -> list[bytes]:
    return [b"nan" if math.isnan(x) else struct.pack("<d", x) for x in found]


def pair(g: Graph, functions: Any) -> tuple[Compiled, Compiled]:
    """Return the functions on tapes and in straight-line code."""
    return Compiled(g, functions, tapes.generate), Compiled(g, functions)


def same(g: Graph, functions: Any, *states: Mapping[str, float]) -> Compiled:
    """Assert that both forms have equal bits; return the straight-line code."""
    tape, code = pair(g, functions)
    for state in states or (VALUES,):
        for name in functions:
            assert bits(tape.at(state, name)) == bits(code.at(state, name))
        # Not only after `prepare`: no call spoils what another one needs.
        for name in functions:
            again = tape.call(name, state, len(functions[name]))
            assert bits(again) == bits(code.at(state, name))
    return code


@pytest.mark.slow
@given(st.floats())
def test_numbers_are_written_bit_for_bit(x: float) -> None:
    text = number(x)
    assert struct.pack(">Q", int(text, 16)) == struct.pack(">d", x)


def test_leaves_numbers_parameters_and_repeats() -> None:
    g = Graph()
    nodes = build(
        g, "x", "a", "w", "t", "2.5", "x", "1/0", "a*b", "a*b", "x*a", "z", "x*x + x*x",
        "if(a > b, x, y)", "if(a > b and x > 0, 1, a*b)", "if(a < 0, a, b)",
        "x*a + y", "z*y + w", "sin(z*y)", "x*w - z*w", "sin(x*w)",
    )  # fmt: skip
    nodes += [g.call("pow", nodes[0], g.constant(e)) for e in (-2.5, 3.0, 0.3)]
    functions = {"f": nodes, "g": [], "h": [g.one]}
    others = {**VALUES, "a": -0.9}
    code = same(g, functions, VALUES, others)
    for state in (VALUES, others):
        assert code.at(state) == pytest.approx(evaluate(g, nodes, state), rel=2e-16)
    # A variable in p that is not fixed is read each time.
    for compiled in pair(g, functions):
        compiled.prepare(VALUES)
        compiled.p[LAYOUT.p["w"]] = 5.0
        assert compiled.call("f", VALUES, len(nodes))[2] == 5.0


def body(ir: str, name: str) -> str:
    """Return the text of a function."""
    start = ir.index(f"@{name}(")
    start = ir.rindex("define", 0, start)
    return ir[start : ir.index("\n}", start)]


def test_what_depends_on_parameters_alone_is_computed_by_prepare() -> None:
    g = Graph()
    nodes = build(g, "x*sin(a)", "sin(a) + y", "exp(sin(a)*b)", "w*cos(b)", "t*tan(b)")
    compiled = Compiled(g, {"f": nodes})
    f, prepare = body(compiled.code.ir, "f"), body(compiled.code.ir, "prepare")
    for function in ("sin", "exp", "cos", "tan"):
        assert f"{function}" not in f
        assert function in prepare
    # The sine of a and the cosine of b, each once.
    assert prepare.count("@sincos") == 1
    assert prepare.count("extractelement") == 2
    assert compiled.at(VALUES) == pytest.approx(evaluate(g, nodes, VALUES), rel=4e-16)
    # Other parameters are seen after `prepare`, and compile nothing.
    other = {**VALUES, "a": 1.7, "b": 0.2}
    assert compiled.at(other) == pytest.approx(evaluate(g, nodes, other), rel=4e-16)


# Twice the exponents that are products and a root, and some that are not.
@pytest.mark.parametrize("twice", [*range(-14, 15), 0.6, 31])
def test_powers(twice: float) -> None:
    exponent = twice / 2
    g = Graph()
    node = g.call("pow", g.variable("x"), g.constant(exponent))
    compiled = Compiled(g, {"f": [node]})
    written_out = abs(exponent) <= 6 and float(twice).is_integer()
    assert ("@llvm.pow" in compiled.code.ir) == (not written_out)
    for x in (0.3, 1.0, 1.7, 40.0, 0.0, -0.3, -2.0, math.inf, math.nan):
        expected = evaluate(g, [node], {"x": x})
        # Five products and a quotient at most, each rounded.
        found = compiled.at({"x": x})
        assert found == pytest.approx(expected, rel=6 * 2**-53, nan_ok=True)


def long_functions(g: Graph) -> dict[str, list[int]]:
    """Return functions that use all kinds of nodes far from their evaluation."""
    x, y, a, b, t = map(g.variable, ("x", "y", "a", "b", "t"))
    made, conditions = [x, y], []
    for k in range(12):
        c = g.constant(0.37 + k / 7)
        sine = g.call("sin", g.call("add", made[-1], g.call("mul", c, t)))
        made.append(g.call("mul", sine, g.call("add", a, made[k // 2])))
        conditions.append(g.call("gt", made[-1], g.call("mul", b, c)))
        both = g.call("or", conditions[k // 3], conditions[-1])
        made.append(g.call("if", both, made[k], g.call("cos", g.call("mul", a, c))))
    hoisted = [g.call("exp", g.call("mul", a, g.constant(k / 9))) for k in range(1, 15)]
    late = g.sum(g.call("mul", made[k], hoisted[k]) for k in range(14))
    return {"f": [*made, late, x, a, hoisted[3]], "h": made[15:25]}


@pytest.mark.slow
@pytest.mark.parametrize("piece", [7, 26, 10**9])
def test_pieces_and_tapes_give_the_same_bits(
    piece: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    g = Graph()
    functions = long_functions(g)
    monkeypatch.setattr(keys, "PIECE", piece)
    monkeypatch.setattr(keys, "WHOLE", piece)
    shifted = ({k: x + shift for k, x in VALUES.items()} for shift in (0.0, 0.4, -1.9))
    code = same(g, functions, *shifted)
    ir = code.code.ir
    assert ("@f.1" in ir) == ("optnone" in ir) == (piece < 100)
    assert piece >= 26 or "@prepare.1" in ir
    # What is called once in a step is translated as it stands sooner.
    write = partial(generate, manner=Manner(once=("h",)))
    once, alone = Compiled(g, functions, write), write(g, {"h": functions["h"]}, LAYOUT)
    first = "h.0" if piece < 100 else "h"
    assert ("optnone" in body(alone.ir, first)) == (piece < 100)
    assert "optnone" not in body(ir, first) or piece == 7
    for name in functions:
        assert bits(once.at(VALUES, name)) == bits(code.at(VALUES, name))
    expected = evaluate(g, functions["f"], VALUES)
    assert code.at(VALUES) == pytest.approx(expected, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("tape", [False, True])
def test_nodes_of_several_long_functions_are_written_once(
    tape: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    g = Graph()
    nodes = long_functions(g)["f"]
    # A product that one function needs alone, and a sum of another.
    products = [g.call("mul", a, b) for a, b in pairwise(nodes[:90])]
    sums = [g.call("add", x, nodes[0]) for x in products]
    halves = {
        "f": [*nodes[: len(nodes) // 2], *products],
        "h": [*nodes, *products],
        "k": sums,
    }
    monkeypatch.setattr(keys, "PIECE", 50)
    monkeypatch.setattr(straight_line, "LONG_TAPE", 1)
    rare = ("k",) if tape else ()
    write = partial(generate, manner=Manner(once=("f", "h", "k"), rare=rare))
    together = Compiled(g, halves, write)
    ir = together.code.ir
    assert ("tape.k" in ir) == tape
    assert body(ir, "common.0")
    apart = [write(g, {name: made}, LAYOUT).ir for name, made in halves.items()]
    # Of the three functions the longest has nearly all nodes.
    assert ir.count("fmul") < 1.3 * max(x.count("fmul") for x in apart)
    for name, made in halves.items():
        own = Compiled(g, {name: made})
        assert bits(together.at(VALUES, name)) == bits(own.at(VALUES, name))


@pytest.mark.slow
@given(st.lists(programs(), min_size=20, max_size=20), st.lists(states, min_size=3))
@settings(max_examples=12, deadline=None, derandomize=True)
def test_random_expressions(many: Any, some_states: Any) -> None:
    g = Graph()
    nodes = [on_graph(g, program) for program in many]
    compiled = same(g, {"f": nodes}, *some_states)
    for state in some_states:
        found = compiled.at(state)
        plain = evaluate_with_error(g, nodes, {k: (v, 0.0) for k, v in state.items()})
        for value, (expected, bound) in zip(found, plain, strict=True):
            if math.isfinite(expected):
                # Small powers are products here: rounded otherwise, not worse.
                assert value == expected or abs(value - expected) <= 4 * bound
            else:
                assert not math.isfinite(value)


@pytest.mark.slow
@pytest.mark.parametrize("many", [3, 2 * keys.PIECE])  # in one piece, and in several
def test_matrices_of_zeros_cost_what_their_other_entries_do(many: int) -> None:
    """M and A of many bodies by loops: LLVM takes its time for each store."""
    sizes, expected = [], []
    for zeros in (1_000, 4_000):
        g = Graph()
        terms = build(g, *(f"x*a + {k}" for k in range(many)))
        nodes = [*([g.zero] * zeros), *terms, g.zero, terms[0], g.zero]
        functions = {"f": nodes, "g": [g.zero, *terms[:2]]}
        tape, compiled = pair(g, functions)
        expected = [VALUES["x"] * VALUES["a"] + k for k in range(many)]
        wanted = [*([0.0] * zeros), *expected, 0.0, expected[0], 0.0]
        found = compiled.at(VALUES)  # what it is given is GUARD everywhere
        assert bits(found) == bits(tape.at(VALUES)) == bits(wanted)
        assert compiled.at(VALUES, "g") == [0.0, *expected[:2]]
        sizes.append(compiled.code.ir.count("\n"))
    assert sizes[1] == sizes[0] < 20 * many + 100


def test_sines_wait_for_angles_that_are_sines() -> None:
    g = Graph()
    x, found = g.variable("x"), []
    for k in range(40):
        one = g.call("sin", g.call("mul", x, g.constant(1.0 + k)))
        found += [g.call("cos", one), g.call("sin", g.call("cos", one)), one]
    same(g, {"f": found, "h": found[:3]})


@pytest.mark.parametrize("form", [tapes.generate, generate])
def test_leading_zeros_of_blank_functions_are_not_stored(
    form: Callable[..., Code],
) -> None:
    g = Graph()
    (product,) = build(g, "x*y")
    functions = {"f": [g.zero, product, g.zero, g.zero]}
    manner = Manner(blank=(("f", 3),))
    made = Compiled(g, functions, lambda *given: form(*given, manner))
    # Memory that is not 0 shows which results are stored.
    assert made.at(VALUES) == [GUARD, 0.7 * -1.3, GUARD, 0.0]
