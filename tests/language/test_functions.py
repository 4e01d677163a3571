"""Each row of the table: value, derivative, native code and sympy twin agree."""

from __future__ import annotations

import ctypes
import itertools
import math
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

from lagsim.language.derivatives import gradient
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import FUNCTIONS, OPERATIONS, PART, SMOOTH
from lagsim.language.graph import Graph
from lagsim.native.graph.keys import Layout
from lagsim.native.graph.straight_line import generate
from lagsim.native.link.engine import Engine, compile_object
from lagsim.show.symbols import symbol, to_sympy
from tests.language._cases import CASES, DIGITS
from tests.language._programs import AsWritten, build
from tests.support import ROOT

NAMES = ("x", "y", "z")
EPS = 2.0**-52
COMPARISONS = {"lt", "le", "gt", "ge"}
CONDITIONS = COMPARISONS | {"and", "or", "not"}
SPECIAL = (
    0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -2.0, 3.0, -3.0, 1 / 3, -0.5, 2.5, -2.5, -8.0,
    1e17, 710.0, -1000.0, 1e300, -1e300, 1e-310, 5e-324, math.inf, -math.inf, math.nan,
)  # fmt: skip


def call(g: Graph, name: str) -> int:
    """Return `name` of x, y; conditions as 1 or 0."""
    x, y, z = map(g.variable, NAMES)
    if name in ("if", SMOOTH):
        return g.call(name, g.call("gt", x, g.zero), y, z)
    if name not in CONDITIONS:
        return g.call(name, *(x, y)[: OPERATIONS[name].arity])
    args = (x, y)
    if name not in COMPARISONS:
        args = (g.call("gt", x, g.zero), g.call("gt", y, g.zero))
    condition = g.call(name, *args[: OPERATIONS[name].arity])
    return g.call("if", condition, g.one, g.zero)


def points(name: str, count: int) -> list[tuple[float, ...]]:
    random = np.random.default_rng(list(CASES).index(name))
    domain = CASES[name].domain
    return [tuple(random.uniform(a, b) for a, b in domain) for _ in range(count)]


def at(args: tuple[float, ...]) -> dict[str, float]:
    return dict(zip(NAMES, args, strict=False))


def test_every_row_is_tried() -> None:
    assert set(CASES) | CONDITIONS | {"if", SMOOTH, PART} == {
        x for x, row in OPERATIONS.items() if not row.data
    }


def test_every_function_is_documented() -> None:
    text = (ROOT / "docs" / "model-file.md").read_text(encoding="utf-8")
    named = text.split("- Functions: `", 1)[1].split("`", 1)[0]
    assert set(FUNCTIONS) == {*named.split(), "if"}


@pytest.mark.parametrize("name", CASES)
def test_value(name: str) -> None:
    g = Graph()
    node = call(g, name)
    for args in points(name, 50):
        found = evaluate(g, [node], at(args))[0]
        with mp.workdps(DIGITS):
            expected = float(CASES[name].exact(*map(mp.mpf, args)))
        # The C library's functions are good to an ulp or two.
        assert found == pytest.approx(expected, rel=2 * EPS, abs=0)


def slopes(name: str, args: tuple[float, ...]) -> list[float]:
    """Return the partial derivatives by central differences with many digits."""
    h = mp.mpf(10) ** -12  # truncation h^2, rounding 1e-40/h

    def difference(i: int) -> float:
        def value(step: Any) -> Any:
            moved = [mp.mpf(a) + step * (k == i) for k, a in enumerate(args)]
            return CASES[name].exact(*moved)

        return float((value(h) - value(-h)) / (2 * h))

    with mp.workdps(DIGITS):
        return [difference(i) for i in range(len(args))]


@pytest.mark.parametrize("name", CASES)
def test_derivative(name: str) -> None:
    g = Graph()
    variables = [g.variable(n) for n in NAMES[: OPERATIONS[name].arity]]
    nodes = gradient(g, call(g, name), variables)
    for args in points(name, 30):
        found = evaluate(g, nodes, at(args))
        # 1 - tanh^2 and 1 - x^2 near 1 cancel two digits.
        assert found == pytest.approx(slopes(name, args), rel=1e-12, abs=1e-13)


def limits(name: str, args: tuple[float, ...], i: int) -> tuple[float, ...] | None:
    """Return value, slope and second slope by an argument as limits, if they exist.

    The limits are taken from both sides, not from the point itself, where a formula may
    be 0/0.
    """

    def around(h: Any) -> tuple[Any, ...]:
        def value(k: int) -> Any:
            moved = [mp.mpf(a) + k * h * (j == i) for j, a in enumerate(args)]
            return CASES[name].exact(*moved)

        far, left, right, beyond = (value(k) for k in (-2, -1, 1, 2))
        sides = (left - far) / h, (right - left) / (2 * h), (beyond - right) / h
        return (left + right) / 2, sides, (far - left - right + beyond) / (3 * h**2)

    with mp.workdps(2 * DIGITS):
        try:
            (value, sides, bend), (_, _, nearer) = (
                around(mp.mpf(10) ** -k) for k in (16, 18)
            )
        except (ZeroDivisionError, ValueError, TypeError):
            return None  # no number there, or none that is real
        found = (value, *sides, bend, nearer)
        if not all(isinstance(x, mp.mpf) and mp.isfinite(x) for x in found):
            return None
        apart = max(abs(bend - nearer), *(abs(x - sides[1]) for x in sides))
        # Where there are two slopes, sides and central differences are 1e-16 apart.
        if apart > 1e-9 * (1 + abs(bend) + abs(sides[1])):
            return None
        return float(value), float(sides[1]), float(bend)


# Where formulas of slopes may be 0/0, and beside that, where they may cancel.
PLACES = (0.0, -1e-6, 1e-3, 1.0, -1.0, 2.0)


@pytest.mark.parametrize("name", CASES)
def test_slopes_at_special_points(name: str) -> None:
    g = Graph()
    node, arity = call(g, name), OPERATIONS[name].arity
    variables = [g.variable(n) for n in NAMES[:arity]]
    firsts = gradient(g, node, variables)
    seconds = [gradient(g, s, [x])[0] for s, x in zip(firsts, variables, strict=True)]
    tried = 0
    for args in itertools.product(PLACES, repeat=arity):
        there = [limits(name, args, i) for i in range(arity)]
        expected = [x for x in there if x is not None]
        if len(expected) < arity or (name, args) == ("pow", (0.0, 1.0)):
            continue  # the latter has a test of its own
        tried += 1
        found = evaluate(g, [node, *firsts, *seconds], at(args))
        value, slopes, bends = zip(*expected, strict=True)
        assert found[0] == pytest.approx(value[0], rel=1e-12, abs=1e-13), args
        first, second = found[1 : 1 + arity], found[1 + arity :]
        assert first == pytest.approx(slopes, rel=1e-12, abs=1e-13), args
        # That of hypot is a difference of what is larger by 1/1e-6.
        assert second == pytest.approx(bends, rel=1e-9, abs=1e-9), args
    assert tried


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="y (y - 1) x^(y - 2) is 0 times infinity")
def test_the_second_slope_of_a_line_whose_exponent_varies() -> None:
    g = Graph()
    x, y = g.variable("x"), g.variable("y")
    bend = gradient(g, gradient(g, g.call("pow", x, y), [x])[0], [x])
    assert evaluate(g, bend, {"x": 0.0, "y": 1.0}) == [0.0]


@pytest.mark.parametrize("name", [n for n in CASES if OPERATIONS[n].sympy])
def test_sympy_twin(name: str) -> None:
    g = Graph()
    twin = to_sympy(g, [call(g, name)])[0]
    symbols = [symbol(n) for n in NAMES[: OPERATIONS[name].arity]]
    assert twin.free_symbols == set(symbols)
    for args in points(name, 5):
        exact = {s: sp.Rational(a) for s, a in zip(symbols, args, strict=True)}
        with mp.workdps(DIGITS):
            expected = float(CASES[name].exact(*map(mp.mpf, args)))
        assert float(twin.subs(exact).evalf(30)) == pytest.approx(expected, rel=EPS)


@pytest.fixture(scope="module")
def compiled() -> Any:
    """Return all functions compiled: (x, y) -> values by name."""
    g = AsWritten()
    rows = {name: row for name, row in OPERATIONS.items() if row.native}
    nodes = {name: call(g, name) for name, row in rows.items() if not row.data}
    layout = Layout({n: k for k, n in enumerate(NAMES)}, {}, frozenset(), 0)
    code = generate(g, {"f": list(nodes.values())}, layout)
    pointer = ctypes.c_void_p
    engine = Engine([compile_object(code.ir, optimise=False)])
    function = engine.function("f", None, (ctypes.c_double, pointer, pointer, pointer))

    def values(*args: float) -> tuple[dict[str, float], dict[str, float]]:
        y, p, out = np.array(args), np.zeros(code.p_size + 1), np.empty(len(nodes))
        function(0.0, y.ctypes.data, p.ctypes.data, out.ctypes.data)
        plain = evaluate(g, nodes.values(), at(args))
        return dict(zip(nodes, out.tolist(), strict=True)), dict(
            zip(nodes, plain, strict=True)
        )

    return values


def test_native_code_at_special_points(compiled: Any) -> None:
    for x, y in itertools.product(SPECIAL, SPECIAL):
        native, plain = compiled(x, y, 7.0)
        for name, value in native.items():
            other = plain[name]
            same = value == other or (math.isnan(value) and math.isnan(other))
            assert same or abs(value - other) <= 2 * EPS * abs(other), (name, x, y)
            if value == 0.0:
                signs = math.copysign(1.0, value), math.copysign(1.0, plain[name])
                assert signs[0] == signs[1], (name, x, y)


# What IEEE 754 and C's Annex F say; Python's own functions raise at most of these.
@pytest.mark.parametrize(
    ("name", "args", "expected"),
    [
        ("div", (1.0, 0.0), math.inf), ("div", (1.0, -0.0), -math.inf),
        ("div", (-math.inf, 0.0), -math.inf), ("div", (0.0, 0.0), math.nan),
        ("div", (math.nan, 0.0), math.nan), ("pow", (0.0, -1.0), math.inf),
        ("pow", (-0.0, -1.0), -math.inf), ("pow", (-0.0, -2.0), math.inf),
        ("pow", (0.0, -0.5), math.inf), ("pow", (-8.0, 1 / 3), math.nan),
        ("pow", (-8.0, 3.0), -512.0), ("pow", (-10.0, 400.0), math.inf),
        ("pow", (-10.0, 401.0), -math.inf), ("pow", (10.0, 400.0), math.inf),
        ("pow", (-2.0, math.inf), math.inf), ("pow", (math.nan, 0.0), 1.0),
        ("exp", (1000.0,), math.inf), ("exp", (-1000.0,), 0.0),
        ("sinh", (-1000.0,), -math.inf), ("sinh", (1000.0,), math.inf),
        ("cosh", (-1000.0,), math.inf), ("log", (0.0,), -math.inf),
        ("log", (-1.0,), math.nan), ("log10", (0.0,), -math.inf),
        ("sqrt", (-1.0,), math.nan), ("asin", (1.5,), math.nan),
        ("acosh", (0.5,), math.nan), ("atanh", (1.0,), math.inf),
        ("atanh", (-1.0,), -math.inf), ("atanh", (1.5,), math.nan),
        ("sin", (math.inf,), math.nan), ("floor", (math.inf,), math.inf),
        ("floor", (math.nan,), math.nan), ("floor", (1e300,), 1e300),
        ("ceil", (-0.5,), -0.0), ("sign", (0.0,), 0.0), ("sign", (-0.0,), 0.0),
        ("sign", (math.nan,), math.nan), ("heaviside", (0.0,), 1.0),
        ("heaviside", (-5e-324,), 0.0), ("heaviside", (math.nan,), math.nan),
        ("hypot", (math.inf, math.nan), math.inf),
        ("min", (1.0, math.nan), math.nan), ("min", (math.nan, 1.0), math.nan),
        ("max", (1.0, math.nan), math.nan), ("max", (math.nan, 1.0), math.nan),
        ("hypot", (1e200, 1e200), math.sqrt(2) * 1e200),
    ],
)  # fmt: skip
def test_values_never_raise(
    name: str, args: tuple[float, ...], expected: float, compiled: Any
) -> None:
    found = OPERATIONS[name](*args)
    assert found == pytest.approx(expected, rel=EPS, nan_ok=True)
    with np.errstate(all="ignore"):
        found = OPERATIONS[name](*map(np.float64, args))
    assert found == pytest.approx(expected, rel=EPS, nan_ok=True)
    native, _ = compiled(*args, *(0.0,) * (3 - len(args)))
    assert native[name] == pytest.approx(expected, rel=EPS, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "function"),
    [
        ("log(x)", np.log), ("log10(x)", np.log10), ("sqrt(x)", np.sqrt),
        ("asin(x)", np.arcsin), ("acos(x)", np.arccos), ("acosh(x)", np.arccosh),
        ("atanh(x)", np.arctanh), ("x^0.3", lambda x: np.power(x, 0.3)),
        ("x^y", lambda x: np.power(x, 2.5)),
    ],
)  # fmt: skip
def test_a_domain_has_the_points_with_a_value(text, function):
    g = Graph()
    node = build(g, text)
    inside, _ = OPERATIONS[g.ops[node]].domain(g, g.args[node])
    for x in (-3.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 3.0):
        with np.errstate(all="ignore"):
            expected = not np.isnan(function(x))
        assert evaluate(g, [inside], {"x": x, "y": 2.5}) == [expected], x
