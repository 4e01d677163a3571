"""Objects compiled, linked, found and freed."""

from __future__ import annotations

import ctypes
import gc
import sys
import weakref

import pytest

from lagsim.native.link.engine import Engine, NativeError, compile_object


def constant(value: float) -> bytes:
    return compile_object(f"define double @derivative() {{\n  ret double {value}\n}}\n")


CALLER = """
declare double @derivative()
define double @twice() {
  %a = call double @derivative()
  %b = fadd double %a, %a
  ret double %b
}
"""


def test_engines_do_not_see_each_other() -> None:
    caller = compile_object(CALLER)
    engines = [Engine([caller, constant(k + 0.5)]) for k in range(3)]
    results = [e.function("twice", ctypes.c_double, [])() for e in engines]
    assert results == [1.0, 3.0, 5.0]
    assert len({e.address("derivative") for e in engines}) == 3


def test_open_symbols_are_named(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(NativeError, match="no native code for `twice`"):
        Engine([compile_object(CALLER)]).address("twice")
    assert "derivative" in capfd.readouterr().err


def test_symbols_defined_twice() -> None:
    with pytest.raises(NativeError, match="derivative"):
        Engine([constant(1.0), constant(2.0)])


@pytest.mark.parametrize(
    "ir", ["define nonsense", "define double @f() {\n  ret i64 0\n}\n"]
)
def test_wrong_ir(ir: str) -> None:
    with pytest.raises(NativeError, match="LLVM refuses"):
        compile_object(ir)


def test_callables_keep_the_engine() -> None:
    linked = Engine([constant(2.5)])
    kept = weakref.ref(linked)
    f = linked.function("derivative", ctypes.c_double, [])
    del linked
    gc.collect()
    assert kept() is not None
    assert f() == 2.5
    del f
    gc.collect()
    assert kept() is None


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_dropped_engines_free_their_code() -> None:
    # A table of 2 MB in each: kept, 40 of them would show.
    code = compile_object(
        "@table = constant [250000 x double] zeroinitializer\n"
        "define ptr @f() {\n  ret ptr @table\n}\n"
    )

    def mapped_pages() -> int:
        with open("/proc/self/statm") as file:  # noqa: PTH123
            return int(file.read().split()[0])

    sizes = []
    for _ in range(3):
        for _ in range(20):
            Engine([code]).address("f")
        gc.collect()
        sizes.append(mapped_pages())
    assert sizes[2] - sizes[1] < 5 * 500
