"""Kernels, native against plain Python, bit for bit."""

from __future__ import annotations

import ctypes
import importlib.util
import itertools
import math
import struct
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lagsim.native.kernels.code import KernelError, bind, translate
from lagsim.native.kernels.keys import fingerprint
from lagsim.native.kernels.words import total
from lagsim.native.link.engine import Engine, compile_object
from tests.native.sample_kernels import (
    ARRAY_KERNELS,
    FINITE_KERNELS,
    FLOAT_KERNELS,
    INTEGER_KERNELS,
    conjunction,
    conversions,
    divide,
    euler,
    last_of_loop,
    power,
    remainder,
    static_branch,
    sums,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import ModuleType

CTYPES = {
    "int": ctypes.c_int64,
    "float": ctypes.c_double,
    "bool": ctypes.c_bool,
    "Floats": ctypes.POINTER(ctypes.c_double),
    "None": None,
}
FLOATS = [0.0, -0.0, 1.0, -1.0, 2.5, -7.25, 0.1, 1e300, -5e-324, math.inf, math.nan]
FINITE = [0.0, -0.0, 1.0, -1.0, 2.5, -7.25, 0.1, 1e17, -3e-5]
INTEGERS = [0, 1, -1, 2, -2, 3, 7, -7, 12, -100, 2**40 + 1]


def bits(value: object) -> object:
    """Give what must agree: the bits of a float, but any nan is like another."""
    if isinstance(value, float):
        return "nan" if math.isnan(value) else struct.pack("<d", value)
    return value


def native(engine: Engine, kernel: Callable[..., object]) -> Callable[..., object]:
    kinds = dict(kernel.__annotations__)
    result = CTYPES[str(kinds.pop("return"))]
    return engine.function(
        kernel.__name__, result, [CTYPES[kind] for kind in kinds.values()]
    )


def build(*kernels: Callable[..., object], **statics: object) -> Engine:
    return Engine([compile_object(translate(kernels, statics))])


@pytest.fixture(scope="module")
def everything() -> Engine:
    return build(
        *FLOAT_KERNELS,
        *FINITE_KERNELS,
        *INTEGER_KERNELS,
        *ARRAY_KERNELS,
        conjunction,
    )


def agree(
    engine: Engine, kernel: Callable[..., object], cases: list[tuple[object, ...]]
) -> int:
    fast, plain = native(engine, kernel), bind(kernel, {})
    compared = 0
    for case in cases:
        try:
            expected = plain(*case)
        except (ArithmeticError, ValueError):
            continue  # native code gives inf or nan where Python raises
        if isinstance(expected, complex):
            continue
        if isinstance(expected, int) and kernel.__annotations__["return"] == "float":
            expected = float(expected)
        assert bits(fast(*case)) == bits(expected), case
        compared += 1
    return compared


@pytest.mark.parametrize("kernel", FLOAT_KERNELS)
def test_floats(everything: Engine, kernel: Callable[..., object]) -> None:
    cases = list(itertools.product(FLOATS, FLOATS))
    assert agree(everything, kernel, cases) == len(cases)


@pytest.mark.parametrize("kernel", FINITE_KERNELS)
def test_finite_floats(everything: Engine, kernel: Callable[..., object]) -> None:
    generator = np.random.default_rng(7)
    some = generator.uniform(-9.0, 9.0, (2000, 2)).tolist()
    cases = [*itertools.product(FINITE, FINITE), *map(tuple, some)]
    assert agree(everything, kernel, cases) > 1000


@pytest.mark.parametrize("kernel", INTEGER_KERNELS)
def test_integers(everything: Engine, kernel: Callable[..., object]) -> None:
    cases = [
        (a, b)
        for a, b in itertools.product(INTEGERS, INTEGERS)
        if kernel is not last_of_loop or abs(b - a) < 1000
    ]
    assert agree(everything, kernel, cases) > 90


def test_negative_operands_round_down(everything: Engine) -> None:
    assert native(everything, divide)(-7, 2) == -4
    assert native(everything, remainder)(-7, 2) == 1
    assert native(everything, remainder)(7, -2) == -1


def test_where_python_raises(everything: Engine) -> None:
    assert native(everything, divide)(7, 0) == 7
    assert native(everything, remainder)(7, 0) == 0
    assert native(everything, power)(0.0, -1.0) == math.inf
    assert native(everything, conversions)(math.nan, 0.0) == 0


def test_booleans(everything: Engine) -> None:
    for a, b in itertools.product([False, True], repeat=2):
        assert native(everything, conjunction)(a, b) is (a and not b)


def pointer(array: np.ndarray) -> object:
    return array.ctypes.data_as(CTYPES["Floats"])


@pytest.mark.parametrize("kernel", ARRAY_KERNELS)
@pytest.mark.parametrize("n", [3, 7, 16])
def test_arrays(everything: Engine, kernel: Callable[..., object], n: int) -> None:
    y = np.random.default_rng(n).normal(size=n)
    expected, out = np.full(3 * n, 9.0), np.full(3 * n, 9.0)
    bind(kernel, {})(n, y, expected)
    native(everything, kernel)(n, pointer(y), pointer(out))
    assert out.tobytes() == expected.tobytes()


def test_totals_of_nothing_and_without_their_zero_terms() -> None:
    y = np.array([1.0, math.inf, 3.0])
    out = np.full(9, 9.0)
    native(build(sums), sums)(3, pointer(y), pointer(out))
    # A weight of 0.0 leaves the infinity out; the last sum has no term at all.
    assert out.tolist()[0:3] == [math.inf, 1.75, 1.0]
    assert total(x for x in [0.1] * 10) == 0.9999999999999999  # not compensated
    assert total(iter(())) == 0.0


def test_statics_stand_before_globals() -> None:
    assert native(build(static_branch, CONSTRAINED=True), static_branch)(8.0, 1.0) == 3
    changed = {"CONSTRAINED": False, "COUNT": 2, "SCALE": 0.5}
    fast = native(build(static_branch, **changed), static_branch)
    plain = bind(static_branch, {}, changed)
    for a, b in [(8.0, 1.0), (-8.0, 1.0)]:
        assert fast(a, b) == plain(a, b)
    assert fast(8.0, 1.0) == 3.0
    assert fast(-8.0, 1.0) == 5.0
    assert static_branch(8.0, 1.0) == 3.0


def test_dead_branches_are_not_read() -> None:
    assert "not_translated" not in translate([static_branch])
    with pytest.raises(KernelError, match="not_translated"):
        translate([static_branch], {"CONSTRAINED": False})


def test_unknown_statics_are_named() -> None:
    with pytest.raises(KernelError, match="CONSTRAIND"):
        translate([static_branch], {"CONSTRAIND": False})


MODEL = """
define void @rate(double %t, ptr %y, ptr %out) {
  %a = load double, ptr %y
  %p = getelementptr double, ptr %y, i64 1
  %b = load double, ptr %p
  %q = getelementptr double, ptr %out, i64 1
  %c = fmul double %t, %a
  store double %b, ptr %out
  store double %c, ptr %q
  ret void
}
define double @scale_of(i64 %i, i1 zeroext %yes) {
  %a = sitofp i64 %i to double
  %b = select i1 %yes, double 2.0, double 0.5
  %c = fmul double %a, %b
  ret double %c
}
"""


def test_externals_are_linked_and_bound() -> None:
    engine = Engine([compile_object(translate([euler])), compile_object(MODEL)])

    def rate_in_python(t: float, y: np.ndarray, out: np.ndarray) -> None:
        out[0], out[1] = y[1], t * y[0]

    plain = bind(
        euler,
        {
            "rate": rate_in_python,
            "scale_of": lambda i, yes: i * (2.0 if yes else 0.5),
        },
    )
    for n in (3, 9):
        y, out = np.array([1.0, 0.25]), np.zeros(2)
        z, work = y.copy(), out.copy()
        native(engine, euler)(n, pointer(y), pointer(out))
        plain(n, z, work)
        assert y.tobytes() == z.tobytes()
        assert y[0] > 1.0
    with pytest.raises(NotImplementedError, match="rate"):
        bind(euler, {})(1, np.zeros(2), np.zeros(2))


def test_the_text_is_the_same_each_time() -> None:
    kernels = [*FLOAT_KERNELS, euler]
    assert translate(kernels) == translate(kernels)
    assert fingerprint(kernels) == fingerprint(kernels)
    assert fingerprint(kernels) != fingerprint(kernels[1:])
    assert fingerprint(kernels) != fingerprint(kernels, {"COUNT": 4})


def module(path: Path, text: str) -> ModuleType:
    path.write_text(text)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


HEAD = """from __future__ import annotations
import math
TABLE = (1.0, 2.0)
"""


def test_fingerprint_sees_text_and_tables(tmp_path: Path) -> None:
    text = HEAD + "def f() -> float:\n    return TABLE[1] + math.pi\n"
    prints = [fingerprint([module(tmp_path / "k.py", text).f])]
    loaded = module(tmp_path / "k.py", text + "# more\n")
    prints.append(fingerprint([loaded.f]))
    loaded.TABLE = (1.0, 3.0)
    prints.append(fingerprint([loaded.f]))
    assert len(set(prints)) == 3


def test_functions_of_one_name_do_not_meet(tmp_path: Path) -> None:
    (tmp_path / "other.py").write_text(
        "def part(x: float) -> float:\n    return 2 * x\n"
    )
    sys.path.insert(0, str(tmp_path))
    try:
        loaded = module(
            tmp_path / "one.py",
            "from other import part as other_part\n"
            "def part(x: float) -> float:\n    return x + 1\n"
            "def both(x: float) -> float:\n    return part(x) * 10 + other_part(x)\n",
        )
    finally:
        sys.path.remove(str(tmp_path))
    assert native_of(loaded.both)(3.0) == 46.0
    assert bind(loaded.both, {})(3.0) == 46.0
    with pytest.raises(KernelError, match="another function already"):
        translate([loaded.part, sys.modules.pop("other").part])


def test_names_may_be_greek(tmp_path: Path) -> None:
    text = "def f(φ: float) -> float:\n    ω = 2.0 * φ\n    return ω + φ\n"
    assert native_of(module(tmp_path / "greek.py", text).f)(1.5) == 4.5


def native_of(kernel: Callable[..., object]) -> Callable[[float], object]:
    engine = build(kernel)
    return engine.function(kernel.__name__, ctypes.c_double, [ctypes.c_double])


def test_an_external_may_be_translated_along(tmp_path: Path) -> None:
    text = (
        "from lagsim.native.kernels.words import external\n"
        "@external\ndef part(x: float) -> float:\n    raise NotImplementedError\n"
        "def whole(x: float) -> float:\n    return part(x) + 1.0\n"
    )
    whole = module(tmp_path / "whole.py", text).whole
    part = module(tmp_path / "p.py", "def part(x: float) -> float:\n    return 2 * x\n")
    engine = build(whole, part.part)
    assert engine.function("whole", ctypes.c_double, [ctypes.c_double])(3.0) == 7.0
    wrong = module(
        tmp_path / "w.py", "def part(x: int) -> float:\n    return 2.0 * x\n"
    )
    with pytest.raises(KernelError, match="other kinds"):
        translate([whole, wrong.part])
