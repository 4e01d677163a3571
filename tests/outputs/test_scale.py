"""Scales: what is flat, what is offset, and that ticks are where they say."""

from __future__ import annotations

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from lagsim.outputs.figure import Picture, frame, in_house_style
from lagsim.outputs.scale import (
    LEAST_TICKS,
    label,
    log_scale,
    noise_scale,
    power_of_ten,
    time_scale,
    value_scale,
)
from tests.outputs.drawn import drawn

PLAIN = str.maketrans("−⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "--0123456789")
LABEL = re.compile(
    r"x(?: (?P<sign>[−+]) (?P<offset>[\d.e+-]+))?(?: \(10(?P<power>[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)\))?"
)
FLAT = value_scale(np.array([0.0, 1.0]))


def test_rounding_noise_of_a_constant_is_flat():
    noisy = 3.5 + 1e-15 * np.arange(9)
    scale = value_scale(noisy)
    assert scale.low < 3.2
    assert scale.high > 3.8
    assert (value_scale(np.zeros(5)).low, value_scale(np.zeros(5)).high) == (-1, 1)
    beside = value_scale(1e-17 * np.arange(9.0), size=2.0)
    assert beside.high > 0.1


@in_house_style
def panel_with(scale, ticks=5, unit=""):
    picture = Picture(2.5, "")
    [[axes]] = picture.panels([1.5], [1.5])
    frame(axes, FLAT, scale, up=("x", unit))
    scale.put(axes, "y", ticks)
    return picture


def read(scale, ticks=5):
    """Places, numbers and label of a scale as they are drawn."""
    [panel] = drawn(panel_with, scale, ticks).panels
    places = [(y - panel.box.y0) / panel.box.height for y, _ in panel.y]
    return places, [said for _, said in panel.y], panel.labels[1]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([0.0, 3.0], "x (m)"),
        ([0.0, -2.5e-11], "x (10⁻¹¹ m)"),
        ([0.0, 6.4e6], "x (10⁶ m)"),
        ([6371000.0, 6371001.0], "x − 6371000 (m)"),
        ([-7.0 - 2e-5, -7.0 + 2e-5], "x + 7 (10⁻⁵ m)"),
    ],
)
def test_an_axis_label_says_in_what_the_ticks_count(values, said):
    [panel] = drawn(panel_with, value_scale(np.array(values)), unit="m").panels
    assert panel.labels[1] == said
    assert power_of_ten(-12) == "10⁻¹²"


@pytest.mark.slow
def test_ticks_are_round_distinct_and_where_they_say():
    random = np.random.default_rng(5)
    axes = Figure().add_axes((0, 0, 1, 1))
    for _ in range(1000):
        centre = random.choice((0.0, 1.0, -1.0)) * 10 ** random.uniform(-280, 280)
        spread = 10 ** random.uniform(-280, 280)
        if random.random() < 0.5:
            spread = abs(centre) * 10 ** random.uniform(-15, 1)
        values = np.array([centre, centre + spread])
        most = int(random.integers(2, 9))
        for scale in (value_scale(values), time_scale(values), noise_scale(values, 1)):
            axis = axes.yaxis
            scale.put(axes, "y", most)
            places = axis.get_majorticklocs()
            said = label(axis, "x")
            numbers = axis.get_major_formatter().format_ticks(places)
            assert scale.low < scale.high
            # A millionth of the panel, or the last bits of what a number is worth.
            size = max(abs(scale.low), abs(scale.high))
            slack = 1e-6 * (scale.high - scale.low) + 1e-15 * size
            seen = (places >= scale.low - slack) & (places <= scale.high + slack)
            places = places[seen]
            numbers = [n for n, there in zip(numbers, seen, strict=True) if there]
            assert LEAST_TICKS <= len(places) <= max(most, 3) + 3
            assert len(set(numbers)) == len(numbers)
            found = LABEL.fullmatch(said)
            unit = 10.0 ** int((found["power"] or "0").translate(PLAIN))
            offset = float(found["offset"] or "0") * (-1 if found["sign"] == "+" else 1)
            for place, number in zip(places, numbers, strict=True):
                worth = float(number.translate(PLAIN)) * unit + offset
                assert worth == pytest.approx(place, abs=slack)


@pytest.mark.parametrize(
    ("low", "high", "least"),
    [(1e-14, 1e2, 3), (0.02, 0.5, 3), (1.1, 4.0, 3), (5, 7, 2)],
)
def test_powers_of_ten_stand_where_they_say(low, high, least):
    scale = log_scale(np.array([low, high]), margin=0.0, least=0.0)
    places, numbers, _ = read(scale, 6)
    assert least <= len(numbers) <= 9
    worth = [
        10.0 ** int(n.translate(PLAIN)[2:]) if set(n) & set("⁰¹²³⁴⁵⁶⁷⁸⁹") else float(n)
        for n in numbers
    ]
    expected = np.log(np.array(worth) / low) / np.log(high / low)
    # Half a pixel of three hundred.
    assert places == pytest.approx(list(expected), abs=2e-3)


@pytest.mark.parametrize(
    "values", [[], [0.0], [5e-324, 1.0], [np.nan, np.inf, 3.0], [1e-320, 5e-324]]
)
def test_a_scale_of_powers_can_be_drawn_whatever_it_is_given(values):
    scale = log_scale(np.array(values, float))
    assert 0.0 < scale.low < scale.high < np.inf
    places, numbers, _ = read(scale)
    assert len(places) == len(numbers) >= 2
