"""Words of kernels on single numbers: native against plain Python, and exact values."""

from __future__ import annotations

import ctypes
from math import inf, nan
from typing import TYPE_CHECKING

import numpy as np

from lagsim.native.kernels.code import translate
from lagsim.native.kernels.words import exponent, fused, mantissa, two_to
from lagsim.native.link.engine import Engine, compile_object

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

ODD = [0.0, -0.0, inf, -inf, nan, 5e-324, 1e300, -1.0, 1.0, 3.0]


def work(x: Floats, n: int, out: Floats) -> None:
    for i in range(n):
        out[3 * i] = exponent(x[i])
        out[3 * i + 1] = fused(x[i], x[n - 1 - i], -2)
        out[3 * i + 2] = mantissa(x[i]) * two_to(i - 2.0)


def test_they_have_the_bits_of_plain_python() -> None:
    x = np.array([*ODD, *np.random.default_rng(1).normal(size=10)])
    native, plain = np.zeros((2, 3 * len(x)))
    work(x, len(x), plain)
    kinds = (ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p)
    engine = Engine([compile_object(translate([work]))])
    engine.function("work", None, kinds)(x.ctypes.data, len(x), native.ctypes.data)
    assert np.array_equal(native, plain, equal_nan=True)
    told = ~np.isnan(plain)
    assert np.array_equal(np.signbit(native[told]), np.signbit(plain[told]))


def test_bits_of_numbers() -> None:
    for k in (-1022, -3, 0, 7, 1023):
        assert two_to(float(k)) == 2.0**k
        assert exponent(-1.5 * 2.0**k) == k
    assert [exponent(x) for x in (0.0, 5e-324, inf, nan)] == [-1023, -1023, 1024, 1024]


def test_mantissas() -> None:
    for x in (1.0, -1.5, 6.0, 2.0**-1022, 1.75 * 2.0**1023):
        m, k = np.frexp(abs(x))
        assert mantissa(x) == 2.0 * m
        assert 2.0 * m * 2.0 ** (int(k) - 1) == abs(x)


def test_products_and_sums_rounded_once() -> None:
    tiny = 2.0**-30
    # (1 + e)^2 - 1 = 2 e + e^2, which the product alone has no room for.
    assert fused(1.0 + tiny, 1.0 + tiny, -1.0) == 2.0 * tiny + tiny * tiny
    assert (1.0 + tiny) * (1.0 + tiny) - 1.0 != 2.0 * tiny + tiny * tiny
    assert fused(1e300, 1e300, -inf) == -inf
    assert np.isnan(fused(inf, 0.0, 1.0))
