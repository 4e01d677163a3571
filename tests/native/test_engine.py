"""Objects compiled, linked, found and freed."""

from __future__ import annotations

import ctypes
import gc
import sys
import weakref

import pytest

from lagsim.native.link.engine import (
    Engine,
    NativeError,
    compile_object,
    quick_objects,
)


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


@pytest.mark.slow
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


# Two functions that may be contracted, each called by one that may not, and vice versa.
MIXED = """\
declare double @llvm.sqrt.f64(double)
@table = private constant [2 x double] [double 0.1, double 0.7]
define internal double @fused(double %x, double %y,
                              double %z) noinline {
%product = fmul contract double %x, %y
%sum = fadd contract double %product, %z
%root = call double @root(double %sum)
ret double %root
}
define internal double @root(double %x) {
%y = call double @llvm.sqrt.f64(double %x)
ret double %y
}
define double @apart(double %x) {
%product = fmul double %x, %x
%sum = fadd double %product, 0x3FB999999999999A
%value = call double @fused(double %sum, double %x, double %x)
ret double %value
}
define double @last(double %x) {
%place = getelementptr double, ptr @table, i64 1
%a = load double, ptr %place
%product = fmul contract double %x, %a
%sum = fadd contract double %product, %a
%value = call double @apart(double %sum)
ret double %value
}
"""


def test_quick_code_has_the_bits_of_contracted_functions():
    usual, quick = Engine([compile_object(MIXED)]), Engine(quick_objects(MIXED))
    assert len(quick_objects(MIXED)) == 2
    number = ctypes.c_double
    for name in ("apart", "last"):
        calls = [x.function(name, number, [number]) for x in (usual, quick)]
        values = [[call(0.01 * k) for k in range(300)] for call in calls]
        assert values[0] == values[1]


def test_quick_code_of_contracted_functions_alone_is_the_usual_one():
    body = "%y = fmul contract double %x, %x\nret double %y\n"
    ir = f"define double @f(double %x) {{\n{body}}}\n"
    assert quick_objects(ir) == [compile_object(ir)]
    assert len(quick_objects(ir.replace(" contract", ""))) == 1
