"""Kernels: native code against plain Python, bit for bit, and refusals."""

from __future__ import annotations

import ctypes
import importlib.util
import itertools
import math
import struct
import sys
from math import copysign, exp, floor, inf, log, nan, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lagsim.native.kernels.keys import Digests, KernelError
from lagsim.native.kernels.translation import translate
from lagsim.native.kernels.words import Static, apart, fused, total, unrolled
from lagsim.native.link.engine import Engine, compile_object
from tests.kernels import bind

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import ModuleType

    from lagsim.language.arrays import Floats

CONSTRAINED = True
COUNT = 3
SCALE = 0.25
WEIGHTS = ((0.0, 2.0, -0.5), (1.5, 0.0, 0.0), (0.0, 0.0, 0.0))


# Every construct of the subset. Of two floats:


def arithmetic(a: float, b: float) -> float:
    a, b = b, a + b
    c = b
    c *= 0.1
    c -= a * b / 3
    return -c + max(a, b, 0.5) * copysign(1.0, min(b, a)) - abs(a)


def comparisons(a: float, b: float) -> int:
    code = 0
    for k in unrolled(2):
        if a < b if k == 0 else a > b:
            code += 1 + k
        if a <= b if k == 0 else a >= b:
            code += 4 + 4 * k
    if a == b or a + b != 0.0:
        code += 16
    if -1.0 <= a < b <= 3:
        code += 32
    both = (a > 0.0 and b > 0.0) or (not a < -5.0 and b != b)
    return code + (64 if both else 0) + (128 if (a if a > b else 2.0) > 1 else 0)


def static_branch(a: float, b: float) -> float:
    x = a * SCALE
    if CONSTRAINED and COUNT > 2:
        x += b
    elif not CONSTRAINED:
        x = not_translated(x)
    return x if CONSTRAINED or a > 0.0 else -x


def not_translated(x: float) -> float:
    return [x][0]


def unrolled_loop(a: float, b: float) -> float:
    x = 0.0
    for s in unrolled(COUNT):
        if s == 1 and a > 0.0:
            continue
        if b > 2.0:
            break
        for j in unrolled(s, -1, -1):
            x += WEIGHTS[s][j] * a + s * b
    while True:
        x = x - 1.0
        if not x > 5.0:
            return x


def functions(a: float, b: float) -> float:
    x = abs(a) + 0.1
    y = sqrt(x) + math.sin(a) * math.cos(b) + exp(-x) - log(x) + math.atan2(a, b)
    return y + math.tanh(a) + math.pow(x, 0.3) + math.fabs(b) + a**2 - x**0.5


def conversions(a: float, b: float) -> int:
    return int(a) + 10 * floor(b) + int(float(int(a)) / 3)


# Of two integers:


def rounded_down(a: int, b: int) -> int:
    return a // 7 + 1000 * (b % 7) - (a - 1) % 2 + max(a, b) - 3 * min(a, 5)


def search(a: int, b: int) -> int:
    found = -1
    steps = 0
    for i in range(-5, 20):
        if i % 3 == b % 3:
            continue
        for j in range(10):
            steps += 1
            if j == i:
                continue
            if i * j > abs(a):
                found = i * 100 + j
                break
        if found >= 0:
            break
        i = i + 100  # noqa: PLW2901
    if found < 0:
        return i
    return found * 1000 + steps


def factorial(a: int, b: int) -> int:
    return 1 if a <= 1 else a * factorial(min(a, 15) - 1, b) % 1000003


def conjunction(a: bool, b: bool) -> bool:
    return a and not b


# Of arrays:


def fill(n: int, y: Floats, out: Floats) -> None:
    """Store into the three parts of `out` (3 n,)."""
    tail = out[n:]
    last = tail[n:]
    for i in range(n):
        out[i], tail[i] = y[i], -y[n - 1 - i]
        last[i] = i
        last[i] += y[i] * COUNT
    tail, last = last, tail
    tail[0], last[n - 1] = last[n - 1], tail[0]
    if n > 3:
        return
    out[0] = 7


def sums(n: int, y: Floats, out: Floats) -> None:
    for i in range(n - 2):
        for s in unrolled(3):
            if s == 1:
                sum_ = total(y[i + j] * WEIGHTS[s][j] for j in unrolled(3))
            else:
                sum_ = total(WEIGHTS[s][j] * y[i + j] for j in unrolled(3))
            out[3 * i + s] = y[i] + 0.5 * sum_


def side_by_side(n: int, y: Floats, out: Floats) -> None:
    middle = out[n:]
    for i in apart(n):
        slope = total(WEIGHTS[0][j] * y[i] for j in unrolled(3))
        middle[i] = slope + 0.1 * y[n - 1 - i]
        out[i] = max(0.3 * y[i], middle[i]) / 7.0
        middle[i] += i


def stretched(n: int, y: Floats, out: Floats) -> None:
    tail = out[n:]
    tail[:n] = abs(y[:n]) - 0.1 * y[:n] / (n + 1)
    tail[: n - 1] += y[1:n]
    tail[n : 2 * n] = 0.5
    tail[n + 1 : 2 * n] *= tail[1:n] - tail[: n - 1]
    tail[n:n] = 1.0  # nothing
    out[0] = power(1, y[1:]) + power(COUNT, y[2:])


def power(exponent: Static, y: Floats) -> float:
    if exponent == 1:
        return y[0]
    x = 1.0
    for _ in unrolled(exponent):
        x *= y[0]
    return x


def rounded_once(n: int, y: Floats, out: Floats) -> None:
    for i in range(n):
        out[i] = fused(y[i], y[n - 1 - i], -2)


ANY_FLOATS = [0.0, -0.0, 1.0, -1.0, 2.5, -7.25, 0.1, 1e300, -5e-324, inf, nan]
FINITE = [0.0, -0.0, 1.0, -1.0, 2.5, -7.25, 0.1, 1e17, -3e-5]
INTEGERS = [0, 1, -1, 2, -2, 3, 7, -7, 12, -100, 2**40 + 1]
SCALARS: dict[Callable[..., object], list[Any]] = {
    arithmetic: ANY_FLOATS, comparisons: ANY_FLOATS, static_branch: ANY_FLOATS,
    unrolled_loop: ANY_FLOATS, functions: FINITE, conversions: FINITE,
    rounded_down: INTEGERS, search: INTEGERS, factorial: INTEGERS,
    conjunction: [False, True],
}  # fmt: skip
ARRAYS = [fill, sums, stretched, side_by_side, rounded_once]
KINDS = {
    "int": ctypes.c_int64,
    "float": ctypes.c_double,
    "bool": ctypes.c_bool,
    "Floats": ctypes.c_void_p,
    "None": None,
}


def build(*kernels: Callable[..., object], **statics: object) -> Engine:
    return Engine([compile_object(translate(kernels, statics))])


def native(engine: Engine, kernel: Callable[..., object]) -> Callable[..., Any]:
    kinds = dict(kernel.__annotations__)
    result = KINDS[str(kinds.pop("return"))]
    return engine.function(kernel.__name__, result, [KINDS[x] for x in kinds.values()])


@pytest.fixture(scope="module")
def engine() -> Engine:
    return build(*SCALARS, *ARRAYS)


def bits(value: object) -> object:
    """Return the bits of a float, which must agree; all nan are equal."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("<d", value)
    return value


@pytest.mark.parametrize("kernel", SCALARS)
def test_numbers(engine: Engine, kernel: Callable[..., Any]) -> None:
    fast, plain = native(engine, kernel), bind(kernel, {})
    for case in itertools.product(SCALARS[kernel], repeat=2):
        assert bits(fast(*case)) == bits(plain(*case)), case


@pytest.mark.parametrize("kernel", ARRAYS)
@pytest.mark.parametrize("n", [3, 7, 16])
def test_arrays(engine: Engine, kernel: Callable[..., Any], n: int) -> None:
    y = np.random.default_rng(n).normal(size=n)
    if kernel is rounded_once:
        y[:3], y[-1] = [-0.0, inf, 5e-324], nan
    expected, out = np.full(3 * n, 9.0), np.full(3 * n, 9.0)
    bind(kernel, {})(n, y, expected)
    native(engine, kernel)(n, y.ctypes.data, out.ctypes.data)
    assert out.tobytes() == expected.tobytes()


def test_where_python_raises(engine: Engine) -> None:
    assert native(engine, conversions)(nan, 0.0) == 0
    assert native(engine, functions)(1e300, 0.0) == inf


def test_products_and_sums_rounded_once() -> None:
    tiny = 2.0**-30
    # (1 + e)^2 - 1 = 2 e + e^2, which the product alone has no room for.
    assert fused(1.0 + tiny, 1.0 + tiny, -1.0) == 2.0 * tiny + tiny * tiny
    assert (1.0 + tiny) * (1.0 + tiny) - 1.0 != 2.0 * tiny + tiny * tiny
    assert fused(1e300, 1e300, -inf) == -inf
    assert np.isnan(fused(inf, 0.0, 1.0))
    assert total(x for x in [0.1] * 10) == 0.9999999999999999  # not compensated


def test_terms_with_a_factor_of_zero_vanish(engine: Engine) -> None:
    y, out = np.array([1.0, inf, 3.0]), np.full(9, 9.0)
    native(engine, sums)(3, y.ctypes.data, out.ctypes.data)
    assert out.tolist()[:3] == [inf, 1.75, 1.0]


def test_statics_stand_before_globals() -> None:
    assert native(build(static_branch), static_branch)(8.0, 1.0) == 3.0
    assert native(build(static_branch, SCALE=0.5), static_branch)(8.0, 1.0) == 5.0
    assert bind(static_branch, {}, {"SCALE": 0.5})(8.0, 1.0) == 5.0
    assert "not_translated" not in translate([static_branch])
    with pytest.raises(KernelError, match="is not of the subset"):
        translate([static_branch], {"CONSTRAINED": False})
    with pytest.raises(KernelError, match="CONSTRAIND"):
        translate([static_branch], {"CONSTRAIND": False})


HEAD = """from __future__ import annotations
import math
from lagsim.language.arrays import Floats
from lagsim.native.kernels.words import external, total, unrolled
TABLE = (1.0, 2.0)
ROWS = {}
N = 2
def nothing() -> None:
    pass
def g(x: float) -> float:
    return x
"""


def module(path: Path, text: str) -> ModuleType:
    path.write_text(text)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def test_fingerprint_sees_text_tables_and_statics(tmp_path: Path) -> None:
    text = HEAD + "def f() -> float:\n    return TABLE[1] + math.pi\n"
    prints = [Digests().fingerprint([module(tmp_path / "k.py", text).f])]
    loaded = module(tmp_path / "k.py", text + "# more\n")
    prints.append(Digests().fingerprint([loaded.f]))
    prints.append(Digests().fingerprint([loaded.f], {"TABLE": (1.0,)}))
    prints.append(Digests().fingerprint([loaded.f, loaded.g]))
    loaded.TABLE = (1.0, 3.0)
    prints.append(Digests().fingerprint([loaded.f]))
    assert len(set(prints)) == 5
    assert Digests().fingerprint([loaded.f]) == prints[-1]
    assert translate([search]) == translate([search])


def test_functions_of_one_name_do_not_meet(tmp_path: Path) -> None:
    other = "def part(x: float) -> float:\n    return 2 * x\n"
    (tmp_path / "other.py").write_text(other)
    sys.path.insert(0, str(tmp_path))
    try:
        loaded = module(
            tmp_path / "one.py",
            HEAD + "from other import part as other_part\n"
            "def part(x: float) -> float:\n    return x + 1\n"
            "def both(φ: float) -> float:\n    return part(φ) * 10 + other_part(φ)\n",
        )
    finally:
        sys.path.remove(str(tmp_path))
        sys.modules.pop("other")
    assert native(build(loaded.both), loaded.both)(3.0) == 46.0
    assert bind(loaded.both, {})(3.0) == 46.0


def test_an_external_may_be_translated_along(tmp_path: Path) -> None:
    text = "@external\ndef part(x: float) -> float:\n    raise NotImplementedError\n"
    text += "def whole(x: float) -> float:\n    return part(x) + 1.0\n"
    whole = module(tmp_path / "whole.py", HEAD + text).whole
    part = module(tmp_path / "p.py", "def part(x: float) -> float:\n    return 2 * x\n")
    assert native(build(whole, part.part), whole)(3.0) == 7.0
    wrong = module(tmp_path / "w.py", "def part(x: int) -> float:\n    return 2.0\n")
    with pytest.raises(KernelError, match="other kinds"):
        translate([whole, wrong.part])


# The body of `f`, where `!` marks the line at fault, and what the message says.
FAULTS = [
    ("!return sum([x])", "not of the subset"),
    ("!return a[::2][0]", "leaves some elements out"),
    ("!a[:] = x\nreturn x", "needs an end"),
    ("k = 1\n!k = x\nreturn x", "is float, not int"),
    ("!if n:\n    return x\nreturn x", "is int, not bool"),
    ("!y = z\nz = y\nreturn y", "`z` has no value"),
    ("!return", "no value, not float"),
    ("!return x > 0", "bool, not float"),
    ("!return missing(x)", "`missing` is not defined"),
    ("!return ROWS[n]", "`ROWS` has no value here; globals are numbers"),
    ("!return TABLE[N]", "out of range"),
    ("!return a[-1]", "counts from the end"),
    ("!return a[x]", "is float, not int"),
    ("!for i in a:\n    pass\nreturn x", "no loop over range"),
    ("!for i in unrolled(n):\n    pass\nreturn x", "not known at translation"),
    ("for i in unrolled(2):\n!    i = 3\nreturn x", "counts a loop"),
    ("!return total(x for i in range(3))", r"no unrolled\(...\)"),
    ("!while x > 1:\n    x -= 1\nelse:\n    x = 1\nreturn x", "has an else"),
    ("!a, x = 1, 2, 3\nreturn x", "number of values"),
    ("!return g(x, x)", "takes 1 arguments"),
    ("!return g(a)", "is Floats, not float"),
    ("!return n // n + x", "not known at translation"),
    ("!return x % 2", "is float, not int"),
    ("!if 0.0 < g(x) < 1.0:\n    x = 1.0\nreturn x", "within a chain of"),
    ("!x = nothing()\nreturn x", "no value"),
    ("!x.y = 2.0\nreturn x", "takes no value"),
]


@pytest.mark.parametrize(("body", "message"), FAULTS)
def test_faults_name_their_line(tmp_path: Path, body: str, message: str) -> None:
    head = HEAD + "def f(x: float, n: int, a: Floats) -> float:\n"
    lines = body.splitlines()
    [marked] = [i for i, line in enumerate(lines) if line.startswith("!")]
    text = head + "".join(f"    {line.removeprefix('!')}\n" for line in lines)
    loaded = module(tmp_path / "faulty.py", text)
    with pytest.raises(KernelError, match=message) as caught:
        translate([loaded.f])
    where = f"{tmp_path / 'faulty.py'}:{head.count(chr(10)) + 1 + marked}: in `f`: "
    assert str(caught.value).startswith(where)


@pytest.mark.parametrize(
    "text",
    [
        "def f(x) -> int:\n    return 1\n",
        "def f(x: list) -> int:\n    return 1\n",
        "def f(x: int):\n    return 1\n",
        "def f(x: Floats) -> Floats:\n    return x\n",
        "f = lambda x: x\n",
    ],
)
def test_faults_of_signatures(tmp_path: Path, text: str) -> None:
    loaded = module(tmp_path / "faulty.py", HEAD + text)
    where = f"faulty.py:{HEAD.count(chr(10)) + 1}: "
    with pytest.raises(KernelError, match=f"{where}.*(annotate|made by `def`)"):
        translate([loaded.f])
