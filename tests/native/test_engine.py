"""Objects compiled, linked, found and freed."""

from __future__ import annotations

import ctypes
import gc
import math
import subprocess
import sys
import weakref
from typing import TYPE_CHECKING

import pytest

from lagsim.native.link import engine
from lagsim.native.link.engine import Engine, NativeError, compile_object

if TYPE_CHECKING:
    from collections.abc import Iterator


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

SINE_AND_COSINE = """
declare double @llvm.sin.f64(double)
declare double @llvm.cos.f64(double)
define double @f(double %x) {
  %s = call double @llvm.sin.f64(double %x)
  %c = call double @llvm.cos.f64(double %x)
  %p = fmul double %s, %c
  ret double %p
}
"""


def test_objects_see_each_other() -> None:
    twice = Engine([compile_object(CALLER), constant(1.5)]).function(
        "twice", ctypes.c_double, []
    )
    assert twice() == 3.0


def test_engines_do_not_see_each_other() -> None:
    caller = compile_object(CALLER)
    engines = [Engine([caller, constant(k + 0.5)]) for k in range(3)]
    results = [e.function("twice", ctypes.c_double, [])() for e in engines]
    assert results == [1.0, 3.0, 5.0]
    assert len({e.address("derivative") for e in engines}) == 3


def test_functions_of_the_c_library_are_found() -> None:
    # Sine and cosine of one argument become `sincos` where there is one.
    f = Engine([compile_object(SINE_AND_COSINE)]).function(
        "f", ctypes.c_double, [ctypes.c_double]
    )
    for x in (0.3, -2.0, 1e6):
        assert f(x) == pytest.approx(math.sin(2.0 * x) / 2.0, abs=1e-9)


@pytest.mark.parametrize("name", ["derivative", "index"])
def test_open_symbols_are_named(name: str) -> None:
    # `index` is a function of libc, but none that a kernel may mean.
    code = compile_object(CALLER.replace("derivative", name))
    with pytest.raises(NativeError, match=f"`{name}`"):
        Engine([code]).address("twice")


def test_missing_symbols_are_named() -> None:
    linked = Engine([constant(1.0)])
    with pytest.raises(NativeError, match="`nothing`"):
        linked.address("nothing")
    assert linked.function("derivative", ctypes.c_double, [])() == 1.0


def test_symbols_defined_twice() -> None:
    with pytest.raises(NativeError, match="derivative"):
        Engine([constant(1.0), constant(2.0)])


def test_no_object() -> None:
    with pytest.raises(NativeError, match="not link"):
        Engine([b"no object at all" * 10])


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


@pytest.fixture
def _other_cpu() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LAGSIM_CPU", "generic")
        yield


@pytest.mark.usefixtures("_other_cpu")
def test_another_cpu() -> None:
    chosen = engine.target()
    assert chosen.cpu == "generic"
    assert chosen.features == ""
    f = Engine([constant(4.0)]).function("derivative", ctypes.c_double, [])
    assert f() == 4.0


def test_the_host_is_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LAGSIM_CPU", raising=False)
    assert engine.target().cpu not in ("", "host", "generic")
    assert engine.target().llvm


def test_llvmlite_is_loaded_when_needed() -> None:
    code = (
        "import sys, lagsim.native.link.cache\n"
        "sys.exit('llvmlite' in sys.modules or 'numpy' in sys.modules)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
