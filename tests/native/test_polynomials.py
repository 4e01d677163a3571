"""Values and slopes of series, side by side, against exact sums."""

from __future__ import annotations

import ctypes
from fractions import Fraction

import numpy as np
import pytest

from lagsim.native.graph import polynomials
from lagsim.native.link.engine import Engine, compile_object

KIND = (None, [ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p])


def reached(
    size: int, order: int, h: float, c: np.ndarray, lost: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    ir = polynomials.series_values(size, order)
    engine = Engine([compile_object(ir, optimise=False)])
    kind = (None, [ctypes.c_double, *[ctypes.c_void_p] * 4])
    out, left = np.full((2, size + 1), np.nan)
    pointers = [x.ctypes.data for x in (c, lost, out, left)]
    engine.function("reached", *kind)(h, *pointers)
    assert np.isnan(out[size])
    assert np.isnan(left[size])
    return out[:size], left[:size]


def values(size: int, order: int, h: float, c: np.ndarray) -> list[np.ndarray]:
    ir = polynomials.series_values(size, order)
    engine = Engine([compile_object(ir, optimise=False)])
    found = []
    for name in ("bend", "slope"):
        out = np.full(size + 1, np.nan)
        engine.function(name, *KIND)(h, c.ctypes.data, out.ctypes.data)
        assert np.isnan(out[size])  # nothing is written behind the components
        found.append(out[:size])
    return found


@pytest.mark.parametrize("cpu", ["host", "portable"])
@pytest.mark.parametrize(
    ("size", "order"), [(1, 4), (2, 5), (3, 6), (4, 7), (8, 15), (11, 14), (29, 18)]
)
def test_every_component(
    size: int, order: int, cpu: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LAGSIM_CPU", cpu)
    rng = np.random.default_rng(size)
    y = rng.uniform(-1.0, 1.0, (order + 1, size))
    c, h = np.array([float(order), *y.ravel()]), 0.7
    bend, slope = values(size, order, h, c)
    exact = Fraction(h)
    for i in range(size):
        terms = [Fraction(y[k, i]) * exact**k for k in range(2, order + 1)]
        rates = [k * Fraction(y[k, i]) * exact ** (k - 1) for k in range(1, order + 1)]
        # Each of at most 12 roundings on the way is half a unit of the terms' sizes.
        for found, parts in ((bend[i], terms), (slope[i], rates)):
            off = abs(Fraction(found) - sum(parts))
            assert off < 6 * 2.0**-52 * float(sum(map(abs, parts)))


def test_equal_bits_where_components_stand() -> None:
    # A component alone, in a vector of 8, and in the remainder has equal bits.
    order, h = 15, 0.3
    rng = np.random.default_rng(1)
    y = np.tile(rng.uniform(-1.0, 1.0, (order + 1, 1)), (1, 13))
    c = np.array([float(order), *y.ravel()])
    alone = values(1, order, h, np.array([float(order), *y[:, 0]]))
    for found, one in zip(values(13, order, h, c), alone, strict=True):
        assert np.all(found == one[0])


@pytest.mark.parametrize("cpu", ["host", "portable"])
@pytest.mark.parametrize(("size", "order"), [(2, 5), (11, 14)])
def test_the_state_and_its_roundoff(
    size: int, order: int, cpu: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LAGSIM_CPU", cpu)
    rng = np.random.default_rng(size)
    y = rng.uniform(-1.0, 1.0, (order + 1, size)) * 0.1 ** np.arange(order + 1)[:, None]
    lost = 2.0**-54 * rng.uniform(-1.0, 1.0, size)
    c, h = np.array([float(order), *y.ravel()]), 0.1
    found, left = reached(size, order, h, c, lost)
    exact = Fraction(h)
    for i in range(size):
        total = sum(Fraction(y[k, i]) * exact**k for k in range(order + 1))
        total += Fraction(lost[i])
        assert found[i] == float(Fraction(found[i]) + Fraction(left[i]))
        # Both together: y_1 h is below 1e-2, and rounded a few times.
        assert abs(Fraction(found[i]) + Fraction(left[i]) - total) < 4e-2 * 2.0**-52
