"""Values and slopes of series, side by side, against exact sums."""

from __future__ import annotations

import ctypes
from fractions import Fraction
from math import comb

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


def weighed(engine: Engine, *given: np.ndarray) -> list[float]:
    out = np.full(6, np.nan)
    pointers = [x.ctypes.data for x in (*given, out)]
    engine.function("weigh", None, [ctypes.c_void_p] * 4)(*pointers)
    assert np.isnan(out[5])
    return out[:5].tolist()


@pytest.mark.parametrize("cpu", ["host", "generic", "portable"])
@pytest.mark.parametrize(
    ("size", "order"), [(1, 4), (2, 5), (3, 6), (7, 9), (8, 15), (9, 4), (29, 18)]
)
def test_largest_terms(
    size: int, order: int, cpu: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LAGSIM_CPU", cpu)
    ir = polynomials.series_values(size, order)
    engine = Engine([compile_object(ir, optimise=False)])
    rng = np.random.default_rng(size)
    weights, rates = rng.uniform(0.0, 1.0, size), rng.uniform(-1.0, 1.0, size)
    for k in range(size):  # each component has the largest term once
        y = rng.uniform(-1.0, 1.0, (order + 1, size))
        y[:, k] *= 100.0
        c = np.array([float(order), *y.ravel()])
        last = [np.max(np.abs(y[order - j]) * weights) for j in range(4)]
        last.append(np.max(np.abs(y[1] - rates) * weights))
        assert weighed(engine, c, rates, weights) == last
        y[order - 1, k] = np.nan
        y[1, k] = [np.inf, -np.inf, np.nan][k % 3]
        weights[k] = [weights[k], 0.0][k // 3 % 2]
        c = np.array([float(order), *y.ravel()])
        with np.errstate(invalid="ignore"):
            sizes = np.nan_to_num(np.abs(y) * weights, posinf=np.inf).max(axis=1)
        found = weighed(engine, c, rates, weights)
        assert found == [*sizes[:-5:-1], np.inf]


@pytest.mark.slow
@pytest.mark.parametrize("cpu", ["host", "generic", "portable"])
@pytest.mark.parametrize(("size", "order"), [(1, 4), (4, 12), (11, 14), (17, 18)])
def test_two_times_have_the_bits_of_one(
    size: int, order: int, cpu: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LAGSIM_CPU", cpu)
    rng = np.random.default_rng(size)
    y = rng.uniform(-1.0, 1.0, (order + 1, size))
    c, lost = np.array([float(order), *y.ravel()]), rng.uniform(-1e-17, 1e-17, size)
    ir = polynomials.series_values(size, order)
    engine = Engine([compile_object(ir, optimise=False)])
    kind = (None, [ctypes.c_double] * 2 + [ctypes.c_void_p] * 4)
    both = np.full((2, size + 1), np.nan)
    pointers = [x.ctypes.data for x in (c, lost, *both)]
    engine.function("reached_twice", *kind)(0.7, -0.4, *pointers)
    assert np.isnan(both[:, size]).all()
    for found, h in zip(both, (0.7, -0.4), strict=True):
        assert np.array_equal(found[:size], reached(size, order, h, c, lost)[0])


@pytest.mark.parametrize("cpu", ["host", "portable"])
@pytest.mark.parametrize(("n", "order"), [(1, 4), (3, 7), (8, 12), (11, 15), (20, 18)])
def test_terms_beyond_the_order(
    n: int, order: int, cpu: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Polynomials of the highest degree that is found: velocities v, positions q.
    monkeypatch.setenv("LAGSIM_CPU", cpu)
    count, size, h = polynomials.beyond(order), 2 * n + 1, 0.7
    rng = np.random.default_rng(n)
    v = (
        rng.uniform(0.5, 1.0, (order + count + 1, n))
        * 0.3 ** np.arange(order + count + 1)[:, None]
    )
    q = np.vstack([rng.uniform(0.5, 1.0, n), v / np.arange(1, len(v) + 1)[:, None]])
    k, m = np.arange(len(q))[:, None], np.arange(len(q))
    shift = np.vectorize(comb)(m, k) * h ** np.maximum(m - k, 0)
    ends = []
    for y, x in ((q, v), (shift @ q, shift[:-1, :-1] @ v)):
        both = np.hstack([y[: order + 1], x[: order + 1], np.ones((order + 1, 1))])
        ends.append(np.array([float(order), *both.ravel()]))
    ir = polynomials.series_values(size, order, n)
    engine = Engine([compile_object(ir, optimise=False)])
    pointer, number = ctypes.c_void_p, ctypes.c_double
    extend = engine.function("extend", None, [number, *[pointer] * 3])
    lengthen = engine.function("lengthen", None, [number, number, *[pointer] * 3])
    more = np.full((count + 1) * n + 1, np.nan)
    c, other = (x[n:].ctypes.data for x in ends)
    extend(h, c, other, more.ctypes.data)
    assert np.isnan(more[-1])
    powers = h ** np.arange(order, order + count + 1)[:, None]
    expected = v[order:] * powers
    # Sums of 12 terms of the orders K - E + 1 to K, with weights up to 120.
    rounding = 1e-12 * np.max(np.abs(v[order - count + 1]) * h ** (order - count + 1))
    assert np.abs(more[:-1].reshape(count + 1, n) - expected).max() < rounding
    x = 0.45
    t = x * h
    place = np.append(t ** np.arange(order + 1) @ q[: order + 1], 7.0)
    rate = np.append(t ** np.arange(order + 1) @ v[: order + 1], 7.0)
    lengthen(x, h, *(z.ctypes.data for z in (more, place, rate)))
    assert place[n] == rate[n] == 7.0
    for found, terms in ((place, q), (rate, v)):
        exact = t ** np.arange(len(terms)) @ terms
        assert np.abs(found[:n] - exact).max() < 4e-16 + x ** (order + 1) * rounding
