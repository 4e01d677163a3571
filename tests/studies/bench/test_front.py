"""Costs read off a curve of work-precision."""

from __future__ import annotations

import pytest

from benchmarks.measure import cost_at


def test_costs_between_points_are_straight_in_logarithms():
    curve = [(1e-2, 1.0), (1e-4, 4.0), (1e-8, 64.0)]
    assert cost_at(curve, 1e-3) == pytest.approx(2.0)
    assert cost_at(curve, 1e-6) == pytest.approx(16.0)
    assert cost_at(curve, 1e-4) == 4.0


def test_an_error_beyond_the_ends_of_a_curve():
    curve = [(1e-2, 3.0), (1e-4, 4.0)]
    assert cost_at(curve, 1e-1) == 3.0
    assert cost_at(curve, 1e-5) is None
    assert cost_at([], 1.0) is None


def test_a_curve_that_comes_back_is_read_where_it_is_cheapest():
    # Rounding makes tight settings worse: they cost more and do not count.
    assert cost_at([(1e-2, 1.0), (1e-4, 2.0), (1e-3, 9.0)], 1e-3) < 2.0
