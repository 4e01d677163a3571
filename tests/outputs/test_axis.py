"""Scales: what is flat, what is offset, and that ticks are where they say."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.outputs.axis import (
    LEAST_TICKS,
    noise_axis,
    power_of_ten,
    time_axis,
    value_axis,
)


def test_rounding_noise_of_a_constant_is_flat():
    noisy = 3.5 + 1e-15 * np.arange(9)
    axis = value_axis(noisy)
    assert axis.low < 3.2
    assert axis.high > 3.8
    assert (value_axis(np.zeros(5)).low, value_axis(np.zeros(5)).high) == (-1, 1)
    beside = value_axis(1e-17 * np.arange(9.0), size=2.0)
    assert beside.high > 0.1


@pytest.mark.parametrize(
    ("values", "label"),
    [
        ([0.0, 3.0], "x (m)"),
        ([0.0, -2.5e-11], "x (10⁻¹¹ m)"),
        ([0.0, 6.4e6], "x (10⁶ m)"),
        ([6371000.0, 6371001.0], "x − 6371000 (m)"),
        ([-7.0 - 2e-5, -7.0 + 2e-5], "x + 7 (10⁻⁵ m)"),
    ],
)
def test_an_axis_label_says_in_what_the_ticks_count(values, label):
    assert value_axis(np.array(values)).label("x", "m") == label
    assert power_of_ten(-12) == "10⁻¹²"


def test_ticks_are_round_distinct_and_on_the_axis():
    random = np.random.default_rng(5)
    for _ in range(3000):
        centre = random.choice((0.0, 1.0, -1.0)) * 10 ** random.uniform(-280, 280)
        spread = 10 ** random.uniform(-280, 280)
        if random.random() < 0.5:
            spread = abs(centre) * 10 ** random.uniform(-15, 1)
        values = np.array([centre, centre + spread])
        most = int(random.integers(2, 9))
        for axis in (value_axis(values), time_axis(values), noise_axis(values, 1.0)):
            places, labels = axis.ticks(most)
            assert axis.low < axis.high
            assert LEAST_TICKS <= len(places) <= max(most, 3) + 3
            assert len(set(labels)) == len(labels)
            slack = 1e-6 * (axis.high - axis.low)
            assert places[0] >= axis.low - slack
            assert places[-1] <= axis.high + slack
            assert np.all(np.diff(places) > 0)
            unit = 10.0**axis.exponent
            for place, label in zip(places, labels, strict=True):
                said = float(label.replace("−", "-")) * unit + axis.offset
                assert said == pytest.approx(place, abs=slack)
