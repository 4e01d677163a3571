"""Filippov's conditions at a point on several surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.run.events.filippov import ABOVE, BELOW, SLIDING, FilippovCone
from lagsim.solve import sliding


def cone(B, r, held=None):
    B, r = np.array(B, dtype=float), np.array(r, dtype=float)
    scale = np.abs(B).sum(axis=1) + np.abs(r)
    return FilippovCone(lambda corner: B @ np.array(corner) - r, scale, held)


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
    assert here.way([ABOVE]) == [way]
    assert here.is_fork([way]) == (low < 0 < high)


def test_a_way_that_is_known_is_kept():
    here = cone([[-2.0]], [-1.0], {0: ABOVE})
    assert here.way([BELOW]) == [ABOVE]


@pytest.mark.parametrize("count", [2, 3, 5, 7, 12])
def test_friction_has_one_way_and_it_is_found(count):
    # -B positive definite, as J M^-1 J^T: exactly one way meets the conditions.
    random = np.random.default_rng(count)
    for _ in range(20):
        J = random.normal(size=(count, count + 1))
        B = -J @ J.T
        r = B @ random.uniform(-0.5, 1.5, count)
        here = cone(B, r)
        way = here.way([BELOW] * count)
        # The conditions by their own words.
        w = np.array([1.0 if k == ABOVE else 0.0 for k in way])
        along = [i for i, k in enumerate(way) if k == SLIDING]
        if along:
            w[along] = np.linalg.solve(B[np.ix_(along, along)], (r - B @ w)[along])
        rho = B @ w - r
        assert np.all((w >= -1e-12) & (w <= 1 + 1e-12))
        for k, rate in zip(way, rho, strict=True):
            assert abs(rate) < 1e-9 if k == SLIDING else (rate > 0) == (k == ABOVE)


def test_forces_of_which_only_the_sum_matters_share_it():
    here = cone([[-1.0, -1.0], [-1.0, -1.0]], [-1.0, -1.0])
    assert here.way([BELOW, BELOW]) == [SLIDING, SLIDING]


def test_no_way():
    # Each wants what the other does not let: only unstable ways are left.
    here = cone([[0.0, -2.0], [2.0, 0.0]], [-1.0, 1.0])
    assert here.way([BELOW, BELOW]) is None


def test_the_kernel_solves_for_the_shares():
    random = np.random.default_rng(1)
    for size in (1, 2, 5):
        B = random.normal(size=(size, size))
        right = random.normal(size=(size, 3))
        found = right.ravel().copy()
        sliding.solve(size, B.ravel().copy(), found)
        assert found.reshape(size, 3) == pytest.approx(np.linalg.solve(B, right))


def test_the_kernel_leaves_what_is_not_determined_at_one_half():
    found = np.array([1.0, 0.2, 0.3, 1.0, 0.2, 0.3])
    sliding.solve(2, np.ones(4), found)
    assert found == pytest.approx([0.5, 0.2, 0.3, 0.5, 0.0, 0.0])


@pytest.mark.parametrize("count", [1, 2, 7])
def test_no_way_where_a_rate_is_no_number(count):
    # A force that has no value on one side: 0/0, the root of what is below 0.
    def rates(corner):
        return np.where(np.array(corner) == ABOVE, np.nan, 1.0)

    with np.errstate(invalid="ignore"):
        assert FilippovCone(rates, np.ones(count)).way([BELOW] * count) is None
