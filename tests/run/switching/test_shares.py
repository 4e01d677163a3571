"""Filippov's conditions at a point on several surfaces."""

import numpy as np
import pytest

from lagsim.run.events.filippov import FilippovCone
from lagsim.run.events.surface_modes import ABOVE, BELOW, SLIDING


def cone(B, r):
    B, r = np.array(B, dtype=float), np.array(r, dtype=float)
    scale = np.abs(B).sum(axis=1) + np.abs(r)
    return FilippovCone(lambda corner: B @ np.array(corner) - r, scale)


@pytest.mark.parametrize(
    ("low", "high", "way"),
    [
        (1.0, 2.0, ABOVE),
        (-2.0, -1.0, BELOW),
        (1.0, -1.0, SLIDING),
        (-1.0, 1.0, ABOVE),  # both would do: the side it is on
        (0.0, -1.0, SLIDING),  # not even below it moves on
        (0.0, 1.0, ABOVE),
        (0.0, 0.0, ABOVE),  # nothing moves it
    ],
)
def test_one_surface(low, high, way):
    here = cone([[high - low]], [-low])
    assert here.select([ABOVE]) == [way]
    assert here.is_fork == (low < 0 < high)


@pytest.mark.parametrize("count", [2, 3, 5, 7, 12])
def test_friction_has_one_way_and_it_is_found(count):
    # -B positive definite, as J M^-1 J^T: exactly one way meets the conditions.
    random = np.random.default_rng(count)
    for _ in range(20):
        J = random.normal(size=(count, count + 1))
        B = -J @ J.T
        r = B @ random.uniform(-0.5, 1.5, count)
        here = cone(B, r)
        way = here.select([BELOW] * count)
        # The conditions by their own words.
        w = np.array([1.0 if k == ABOVE else 0.0 for k in way])
        along = [i for i, k in enumerate(way) if k == SLIDING]
        if along:
            w[along] = np.linalg.solve(B[np.ix_(along, along)], (r - B @ w)[along])
        rho = B @ w - r
        assert np.all((w >= -1e-12) & (w <= 1 + 1e-12))
        for k, rate in zip(way, rho, strict=True):
            assert abs(rate) < 1e-9 if k == SLIDING else (rate > 0) == (k == ABOVE)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_steps_that_multiply(count):
    # Each rate is bilinear in the shares; each surface attracts for all of them.
    random = np.random.default_rng(count)
    for _ in range(20):
        base, B = random.normal(size=count), 0.3 * random.normal(size=(count, count))
        B[range(count), range(count)] = random.uniform(-2, -1, count)
        pairs = random.uniform(-0.2, 0.2, (count, count, count))
        pairs *= np.triu(np.ones((count, count)), 1)

        def rates(w, base=base, B=B, pairs=pairs):
            w = np.array(w)
            return base + B @ w + (pairs @ w) @ w

        here = FilippovCone(rates, np.full(count, 10.0))
        way = here.select([BELOW] * count)
        assert np.all((here.shares >= 0.0) & (here.shares <= 1.0))
        for k, w, rate in zip(way, here.shares, rates(here.shares), strict=True):
            assert abs(rate) < 1e-10 if k == SLIDING else w == k
            assert k == SLIDING or (rate > 0) == (k == ABOVE)


@pytest.mark.parametrize("now", [[BELOW, ABOVE], [ABOVE, BELOW]])
def test_of_two_ways_the_present_one_is_taken_and_told(now):
    # The second surface repels, and its side decides what the first one does: (0, 1)
    # has the rates -1.5 and 2, (1, 0) has 0.5 and -1.
    here = cone([[-1.0, -3.0], [-2.0, 1.0]], [-1.5, -1.0])
    assert here.select(now) == now
    assert here.is_fork


def test_no_way():
    # Each wants what the other does not let: only unstable ways are left.
    here = cone([[0.0, -2.0], [2.0, 0.0]], [-1.0, 1.0])
    assert here.select([BELOW, BELOW]) is None
