"""The accounts of a run: drift, residuals against their scales."""

import math

import numpy as np
import pytest

from lagsim.run.observers.monitors import ResidualMonitor

PLAIN = ["t", "energy"]
FULL = ["t", "energy", "work", "residual_a", "residual_b", "scale:a", "scale:b"]


def monitor_of(columns, *blocks):
    monitor = ResidualMonitor(columns)
    for block in blocks:
        monitor.add(np.array(block, dtype=float))
    return monitor


def test_residuals_are_relative_to_their_own_scale():
    rows = [[0, 0, 0, 1e-3, 1e-9, 10, 1e-6], [1, 0, 0, -2e-3, 0, 100, 1e-7]]
    expected = pytest.approx(1e-3)  # b: 1e-9 of 1e-6; a: 2e-3 of 100
    assert monitor_of(FULL, rows).constraint_residual == expected
    assert monitor_of(FULL, *[[row] for row in rows]).constraint_residual == expected


def test_a_scale_that_is_zero_counts_for_nothing():
    rows = [[0, 0, 0, 0, 1e-9, 0, 1]]
    assert monitor_of(FULL, rows).constraint_residual == 1e-9


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_not_passed_over(bad):
    monitor = monitor_of(PLAIN, [[0, 1], [1, bad]], [[2, 1]])
    assert not math.isfinite(monitor.drift.size)
    good = [0, 1, 0, 0, 0, 1, 1]
    monitor = monitor_of(FULL, [good, [1, 1, 0, bad, 0, 1, 1]], [good])
    assert not math.isfinite(monitor.constraint_residual)
    monitor = monitor_of(FULL, [good], [[1, bad, bad, 0, 0, 1, 1]], [good])
    assert not math.isfinite(monitor.drift.size)


def test_roundoff_beside_terms_that_are_0_is_not_the_first_residual():
    # Of a, roundoff of terms of its size, a small residual, and a jump.
    rows = [[0, 0, 0, 1e-33, 0, 1e-33, 1], [1, 0, 0, 0.1, 0, 0.1, 1]]
    jump = [2, 0, 0, 0.2, 0, 0.2, 1]
    assert monitor_of(FULL, [*rows, jump]).constraint_since("a", 1e-6) == 1.0
    assert monitor_of(FULL, [rows[0], jump]).constraint_since("a", 1e-6) == 2.0
    assert monitor_of(FULL, rows[:1]).constraint_since("a", 1e-6) == 0.0
    assert monitor_of(FULL, [[0, 0, 0, 0, 0, 1, 1]]).constraint_since("a", 1e-6) is None
