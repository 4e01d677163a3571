"""Pareto fronts, and costs read off a curve."""

from __future__ import annotations

import itertools
import random

import pytest

from benchmarks.measure import cost_at
from lagsim.studies.bench.work_precision import pareto


def beaten(point, others):
    return any(
        all(a <= b for a, b in zip(other, point, strict=True)) and other != point
        for other in others
    )


def test_the_front_is_what_no_other_point_beats():
    random.seed(5)
    for _ in range(200):
        points = [(random.randrange(1, 9), random.randrange(1, 9)) for _ in range(12)]
        front = [points[k] for k in pareto(points)]
        assert set(front) == {p for p in points if not beaten(p, points)}
        assert all(a[0] > b[0] for a, b in itertools.pairwise(front))
        assert all(a[1] < b[1] for a, b in itertools.pairwise(front))


def test_of_equal_points_the_first_counts():
    assert pareto([(1, 2), (1, 2), (3, 2)]) == [0]
    assert pareto([]) == []


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
