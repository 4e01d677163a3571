"""Scales: constant values, offsets, spikes, and ticks at the right places."""

import re

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from lagsim.outputs import plots
from lagsim.outputs.figure import HOUSE, Picture, frame, in_house_style
from lagsim.outputs.scale import (
    LEAST_TICKS,
    log_scale,
    name_axis,
    noise_scale,
    power_of_ten,
    read_off,
    spread_scale,
    time_scale,
    value_scale,
)
from tests.outputs.drawn import (
    LABEL,
    PLAIN,
    assert_legible,
    coordinates,
    drawn,
    record,
)

FLAT = value_scale(np.array([0.0, 1.0]))


def test_rounding_noise_of_a_constant_is_flat():
    scale = value_scale(3.5 + 1e-15 * np.arange(9))
    assert scale.low < 3.2 < 3.8 < scale.high
    assert value_scale(np.zeros(5))[:2] == (-1, 1)
    assert value_scale(1e-17 * np.arange(9.0), size=2.0).high > 0.1


@in_house_style
def panel_with(scale, unit=""):
    picture = Picture(2.5, "")
    frame(picture.subplots(), FLAT, scale, up=("x", unit))
    return picture


def read(scale):
    """Places and numbers of a scale as they are drawn."""
    [panel] = drawn(panel_with, scale).panels
    places = [(y - panel.box.y0) / panel.box.height for y, _ in panel.y]
    return places, [said for _, said in panel.y]


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
    with mpl.rc_context(HOUSE):
        axes = Figure().add_axes((0, 0, 1, 1))
    for _ in range(1000):
        centre = random.choice((0.0, 1.0, -1.0)) * 10 ** random.uniform(-280, 280)
        spread = 10 ** random.uniform(-280, 280)
        if random.random() < 0.5:
            spread = abs(centre) * 10 ** random.uniform(-15, 1)
        values = np.array([centre, centre + spread])
        for scale in (value_scale(values), time_scale(values), noise_scale(values, 1)):
            axis = axes.yaxis
            scale.apply(axes, "y")
            name_axis(axis, "x")
            places = axis.get_majorticklocs()
            numbers = axis.get_major_formatter().format_ticks(places)
            found = LABEL.fullmatch(axes.get_ylabel())
            assert scale.low < scale.high
            # A millionth of the panel, or the last bits of what a number is worth.
            size = max(abs(scale.low), abs(scale.high))
            slack = 1e-6 * (scale.high - scale.low) + 1e-15 * size
            seen = (places >= scale.low - slack) & (places <= scale.high + slack)
            numbers = [n for n, there in zip(numbers, seen, strict=True) if there]
            assert LEAST_TICKS <= len(numbers) <= 12
            assert len(set(numbers)) == len(numbers)
            unit = 10.0 ** int((found["power"] or "0").translate(PLAIN))
            offset = float(found["offset"] or "0") * (-1 if found["sign"] == "+" else 1)
            worth = [float(n.translate(PLAIN)) * unit + offset for n in numbers]
            assert worth == pytest.approx(list(places[seen]), abs=slack)


def power_of(text):
    """The number of a tick, such as 2 times 10 to the 3."""
    if m := re.fullmatch(r"\$\\mathdefault{10\^{(.*)}}\$", text):
        return 10.0 ** int(m[1].translate(PLAIN))
    front, _, power = text.partition(" × 10")
    return float(front) * 10.0 ** int((power or "0").translate(PLAIN))


@pytest.mark.parametrize(
    ("low", "high", "least"),
    [(1e-14, 1e2, 3), (0.02, 0.5, 3), (1.1, 4.0, 3), (5, 7, 2)],
)
def test_powers_of_ten_stand_where_they_say(low, high, least):
    scale = log_scale(np.array([low, high]), margin=0.0, least=0.0)
    places, numbers = read(scale)
    assert least <= len(numbers) <= 12
    worth = [power_of(text) for text in numbers]
    expected = np.log(np.array(worth) / low) / np.log(high / low)
    # Half a pixel of three hundred.
    assert places == pytest.approx(list(expected), abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "values", [[], [0.0], [5e-324, 1.0], [np.nan, np.inf, 3.0], [1e-320, 5e-324]]
)
def test_a_scale_of_powers_can_be_drawn_whatever_it_is_given(values):
    scale = log_scale(np.array(values, float))
    assert 0.0 < scale.low < scale.high < np.inf
    places, numbers = read(scale)
    assert len(places) == len(numbers) >= 2


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"), (5.0, "5"), (-1599.2, "−1599"), (1e8, "10⁸"), (-1e8, "−10⁸"),
        (3.361e38, "3.361 × 10³⁸"), (2e-7, "2 × 10⁻⁷"), (5e-4, "0.0005"),
    ],
)  # fmt: skip
def test_numbers_as_one_writes_them(value, said):
    assert read_off(value) == said


# --- Spikes and growth without end: what can be read off their scales, and is said

T = np.linspace(0.0, 10.0, 2001)
SWING = 2.0 * np.sin(3 * T)


def spiked(height, at=700):
    values = SWING.copy()
    values[at] = height
    return values


def shown(values):
    """Return panel, line, and the note on the begin of the logarithmic part."""
    drawing = coordinates({"t": T, "q": values}, ["q"])
    [panel] = drawing.panels
    notes = [text for text in drawing.texts if "logarithmic" in text.said]
    return panel, panel.lines[0], notes


def assert_straight(x, y):
    slope, start = np.polyfit(x, y, 1)
    assert np.allclose(slope * x + start, y, atol=1e-6)


@pytest.mark.parametrize("at", [160, 700, 1001, 1900])
@pytest.mark.parametrize("height", [900.0, -900.0, 4e7])
def test_beside_a_spike_the_rest_is_seen_and_the_spike_is_named(height, at):
    panel, line, [note] = shown(spiked(height, at))
    box, usual = panel.box, np.abs(SWING) < 1.9
    usual[at] = False
    # Within a percent of the half that it is given, whichever way the spike points.
    assert np.ptp(line.y[usual]) > 0.28 * box.height
    assert_straight(SWING[usual], line.y[usual])
    assert box.y0 <= line.y.min() <= line.y.max() <= box.y1
    numbers = [place for place, _ in panel.y]
    assert len(numbers) >= 3
    assert min(np.diff(numbers)) > 20  # pixels, of which a digit has 16
    told = f"peak {read_off(height)} at t = {T[at]:.5g}; logarithmic beyond 2"
    assert note.said == told
    # It stands on the side where the spike is not.
    assert (note.box.x0 < (box.x0 + box.x1) / 2 - 10) == (T[at] > 5.0)
    assert box.x0 <= note.box.x0 < note.box.x1 <= box.x1
    assert box.y0 < note.box.y0 < note.box.y1 <= box.y1


@pytest.mark.parametrize(
    "values",
    [SWING, spiked(20.0), np.exp(-T), np.exp(-5 * T), T**3, 0 * T, np.nan * T],
    ids=["swing", "small spike", "decay", "fast decay", "power", "nothing", "gaps"],
)
def test_what_is_no_spike_and_does_not_explode_stays_linear(values):
    scale = spread_scale((T, values))
    assert not scale.linear
    assert not scale.log


def test_many_rows_within_a_short_time_make_no_spike():
    # A body that is at rest while others bounce, which gives it rows.
    t = np.concatenate([np.linspace(0.0, 0.3, 31), np.linspace(0.4, 0.5, 4000), [2.0]])
    values = np.maximum(1.0 - (t / 0.3) ** 2, 0.0) + 1e-7 * (t < 0.45)
    assert not spread_scale((t, values)).linear


@pytest.mark.slow
def test_labels_of_scales_fit_above_small_panels():
    # 5 panels abreast have space for no label, 3 for a short one.
    for count, short in ((40, 0), (24, 24)):
        columns = {"t": T} | {f"quantity{k}": spiked(900.0) for k in range(count)}
        drawing = coordinates(columns, [*columns][1:])
        assert_legible(drawing)
        said = [text for text in drawing.written() if "beyond" in text]
        assert said == ["log. beyond 2"] * short


@pytest.mark.slow
def test_an_explosion_is_a_line_and_to_both_sides_shows_its_swings():
    _, line, notes = shown(1e-3 * np.exp(4.0 * T))
    assert_straight(line.x, line.y)
    assert not notes
    _, line, notes = shown(np.exp(4.0 * T) * np.cos(6 * T))
    # Each swing, also the first ones, is seen: ten to either side.
    middle = 0.5 * (line.y.max() + line.y.min())
    assert len(np.flatnonzero(np.diff(np.sign(line.y - middle)))) > 15
    assert notes


@pytest.mark.slow
def test_the_greatest_of_several_is_named_and_what_has_no_value_is_not():
    kinetic = np.abs(np.sin(3 * T))
    potential = np.cos(3 * T)
    kinetic[300], potential[700] = 500.0, -800.0
    potential[400], kinetic[900] = np.nan, np.inf
    columns = {"t": T, "kinetic": kinetic, "potential": potential, "energy": 0 * T + 1}
    said = drawn(plots.energy, record(columns)).written()
    told = "peak −800 at t = 3.5; logarithmic beyond "
    assert any(text.startswith(told) for text in said)
