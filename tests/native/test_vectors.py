"""Vectors in kernels: native against plain Python."""

from __future__ import annotations

import ctypes
import functools
from math import inf, nan
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lagsim.native.kernels.code import KernelError, translate
from lagsim.native.kernels.words import (
    above,
    abreast,
    exponent,
    fused,
    head,
    keep,
    larger,
    largest,
    mantissa,
    smaller,
    two_to,
    vector,
)
from lagsim.native.layout import Memory, array
from lagsim.native.link.engine import Engine, compile_object

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

ODD = [0.0, -0.0, inf, -inf, nan, 5e-324, 1e300, -1.0, 1.0, 3.0]


class Walk(Memory):
    size: int
    n: int
    t: float
    far: float
    y: Floats = array(lambda s: s.size)
    z: Floats = array(lambda s: s.size)
    # What is stored past an end would be seen.
    guard: Floats = array(lambda _: 4, 7.0)


def work(s: Walk) -> None:
    size = s.size
    n = s.n
    y = s.y
    z = s.z
    far = 0.0
    for i in abreast(size):
        v = vector(y, i)
        w = fused(abs(v), s.t, -2.0 / larger(abs(v), 0.5))
        w = above(v, 0.25, w, -v)
        if i < n:
            w = head(n - i, w + 1.0, w)
        keep(w, z, i, size - i)
        far = max(far, largest(head(size - i, w, 0.0)))
    for i in abreast(n, size):
        v = smaller(vector(z, i), 3)
        v += s.t
        keep(v, y, i, size - i)
    s.far = fused(s.t, far, 1)


@functools.cache
def made() -> object:
    engine = Engine([compile_object(translate([work]))])
    return engine.function("work", None, (ctypes.c_void_p,))


def same(a: Floats, b: Floats) -> bool:
    """Tell whether two memories have the same bits, but for what is no number."""
    told = ~np.isnan(a)
    return np.array_equal(a, b, equal_nan=True) and np.array_equal(
        np.signbit(a[told]), np.signbit(b[told])
    )


@pytest.mark.parametrize("size", range(1, 10))
def test_they_have_the_bits_of_their_numbers_alone(size: int) -> None:
    rng = np.random.default_rng(size)
    states = [Walk.made(size=size, n=(size + 1) // 2) for _ in range(8)]
    for k, state in enumerate(states):
        state.y[:] = rng.normal(scale=3.0, size=size)
        state.y[rng.integers(size)] = ODD[(k + size) % len(ODD)]
        state.t = rng.normal()
    for state in states:
        plain = state.copy()
        made()(state.address)
        with np.errstate(all="ignore"):
            work(plain)
        assert same(state.flat, plain.flat)
        assert state.guard.tolist() == [7.0] * 4


def is_compared(s: Walk) -> None:
    for i in abreast(s.size):
        if vector(s.y, i) > 0.0:
            s.t = 1.0


def is_stored(s: Walk) -> None:
    s.t = vector(s.y, 0)


def has_a_step(s: Walk) -> None:
    for _ in abreast(0, s.size, 2):
        s.t = 1.0


@pytest.mark.parametrize(
    ("kernel", "words"),
    [
        (is_compared, "compares vector, not numbers"),
        (is_stored, "is vector, not float"),
        (has_a_step, "a loop is over"),
    ],
)
def test_what_they_are_not_for_is_refused(kernel: object, words: str) -> None:
    with pytest.raises(KernelError, match=words):
        translate([kernel])


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
