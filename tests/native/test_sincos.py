"""Sines and cosines of several angles against 60 digits."""

from __future__ import annotations

import ctypes
import math

import mpmath
import numpy as np
import pytest

from lagsim.native.graph import lines
from lagsim.native.link.engine import Engine, compile_object

CALLER = f"""
define void @several(ptr %x, ptr %sines, ptr %cosines) {{
%v = load {lines.VECTOR}, ptr %x, align 8
%b = call {lines.BOTH} @{lines.SINCOS}({lines.VECTOR} %v)
%s = extractvalue {lines.BOTH} %b, 0
%c = extractvalue {lines.BOTH} %b, 1
store {lines.VECTOR} %s, ptr %sines, align 8
store {lines.VECTOR} %c, ptr %cosines, align 8
ret void
}}"""


def several(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    ir = "\n".join([*lines.SINCOS_DECLARES, lines.sincos_function(), CALLER])
    engine = Engine([compile_object(ir, optimise=False)])
    call = engine.function("several", None, [ctypes.c_void_p] * 3)
    sines, cosines = np.zeros_like(x), np.zeros_like(x)
    for k in range(0, len(x), lines.LANES):
        call(*(a[k:].ctypes.data for a in (x, sines, cosines)))
    return sines, cosines


def angles() -> np.ndarray:
    rng = np.random.default_rng(1)
    quarters = np.arange(1, 401) * (math.pi / 4)  # next to zeros and to turns
    far = [lines.LARGEST, -lines.LARGEST, 6381956970095103 / 2.0**33, 1e7, 1e22]
    some = [
        rng.uniform(-1, 1, 300),
        rng.uniform(-100, 100, 300),
        rng.uniform(-lines.LARGEST, lines.LARGEST, 300),
        10.0 ** rng.uniform(-300, -1, 100),
        np.concatenate([quarters, -quarters]),
        far,
    ]
    x = np.concatenate(some)
    return np.append(x, np.zeros(-len(x) % lines.LANES))


@pytest.mark.slow
@pytest.mark.parametrize("cpu", ["host", "generic"])
def test_within_an_ulp(cpu: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LAGSIM_CPU", cpu)
    x = angles()
    with mpmath.workdps(60):
        for angle, *values in zip(x, *several(x), strict=True):
            exact = mpmath.sin(angle), mpmath.cos(angle)
            for value, true in zip(values, exact, strict=True):
                assert abs(value - true) <= np.spacing(abs(float(true)))


def test_no_numbers_stay_so() -> None:
    x = np.array([math.nan, math.inf, -math.inf, 0.5])
    sines, cosines = several(x)
    assert np.isnan(sines[:3]).all()
    assert np.isnan(cosines[:3]).all()
    # The last goes with them to the C library: half an ulp and a little more.
    assert sines[3] == pytest.approx(math.sin(0.5), rel=2.0**-52)


def test_zero_keeps_its_sign() -> None:
    sines, _ = several(np.array([-0.0, 0.0, -0.0, 1.0]))
    assert np.signbit(sines).tolist() == [True, False, True, False]
