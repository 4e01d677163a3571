"""Kernels of several states at once against the same kernels by themselves."""

from __future__ import annotations

import ctypes
from math import exp, inf, nan, sqrt
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lagsim.native.kernels.code import KernelError, translate
from lagsim.native.kernels.lines import LANES
from lagsim.native.kernels.words import at, exponent, two_to, unrolled
from lagsim.native.layout import Memory, array
from lagsim.native.link.engine import Engine, compile_object

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

ODD = [0.0, -0.0, inf, -inf, nan, 5e-324, 1e300, -1.0, 1.0, 3.0]


class Walk(Memory):
    size: int
    t: float
    far: float
    y: Floats = array(lambda s: s.size)
    z: Floats = array(lambda s: s.size)


def sign_of(x: float) -> float:
    if x > 0.0:
        return 1.0
    if x < 0.0:
        return -1.0
    return x


def first_beyond(y: Floats, size: int, bound: float) -> float:
    for i in range(size):
        if y[i] > bound:
            return y[i] - bound
        if y[i] != y[i]:
            return -5.0
    return -1.0


def halved(x: float) -> float:
    steps = 0.0
    while abs(x) > 1.0 and steps < 40.0:
        x = 0.5 * x
        steps += 1.0
    return steps + x


def note(s: Walk, k: float) -> bool:
    s.far += k
    return s.far > 4.0


def both(s: Walk) -> None:
    y = s.y
    z = s.z
    size = s.size
    for i in range(size):
        z[i] = sign_of(y[i]) + halved(y[i])
    s.t = first_beyond(y, size, 0.5)
    if y[0] > 0.25 and note(s, y[1]):
        s.far += 100.0
    elif y[1] < y[0] or note(s, 2.0):
        s.far = sqrt(abs(s.far)) if s.far > 0.0 else min(y[0], y[1], 0.125)
    for k in unrolled(2):
        z[k] += exp(-abs(y[k])) ** 1.5
    if size > 2:
        rest = at(z, 2)
        rest[0] = max(rest[0], float(size)) + exponent(y[2]) * two_to(3.0)
    ended = not 0.0 < s.t < 1e3
    if ended:
        return
    s.far -= 1.0


def leaves(s: Walk) -> None:
    for i in range(s.size):
        if s.y[i] > 0.0:
            break


def counts(s: Walk) -> None:
    k = 0
    if s.t > 0.0:
        k = 1
    s.far = float(k)


def made(functions: list[object], *, wide: bool) -> object:
    ir = translate(functions, wide=wide)
    engine = Engine([compile_object(ir)])
    return engine.function("both", None, (ctypes.c_void_p,))


@pytest.mark.parametrize("seed", range(3))
def test_each_lane_has_the_bits_that_it_has_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = [Walk.made(size=4) for _ in range(LANES)]
    for k, state in enumerate(states):
        state.y[:] = rng.normal(scale=10.0 ** rng.integers(-1, 4), size=4)
        state.y[rng.integers(4)] = ODD[(k + LANES * seed) % len(ODD)]
        state.t = rng.normal()
    lanes = np.array([state.flat for state in states]).T.copy()
    made([both], wide=True)(lanes.ctypes.data)
    alone = made([both], wide=False)
    for k, state in enumerate(states):
        alone(state.address)
        assert np.array_equal(lanes[:, k], state.flat, equal_nan=True)
        signs = np.signbit(state.flat[~np.isnan(state.flat)])
        assert np.array_equal(np.signbit(lanes[~np.isnan(state.flat), k]), signs)


@pytest.mark.parametrize(
    ("kernel", "words"),
    [(leaves, "leave a loop by its condition"), (counts, "same in all lanes")],
)
def test_what_cannot_be_told_apart_is_refused(kernel: object, words: str) -> None:
    with pytest.raises(KernelError, match=words):
        translate([kernel], wide=True)


def test_bits_of_numbers() -> None:
    for k in (-1022, -3, 0, 7, 1023):
        assert two_to(float(k)) == 2.0**k
        assert exponent(-1.5 * 2.0**k) == k
    assert [exponent(x) for x in (0.0, 5e-324, inf, nan)] == [-1023, -1023, 1024, 1024]
