"""Spikes and growth without end: what can be read off their scales, and is said."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.model.model import Scene
from lagsim.outputs import plots
from lagsim.outputs.scale import read_off, spread_scale
from tests.outputs.drawn import drawn
from tests.outputs.test_plots import record

T = np.linspace(0.0, 10.0, 2001)
SWING = 2.0 * np.sin(3 * T)


def spiked(height, at=700):
    values = SWING.copy()
    values[at] = height
    return values


def panel_of(values):
    run = record({"t": T, "q": values}, units={"t": "s", "q": "N"})
    drawing = drawn(plots.trajectory, run, ["q"], Scene({}))
    return drawing, drawing.panels[0]


@pytest.mark.parametrize("height", [900.0, -900.0, 4e7])
def test_beside_a_spike_the_rest_is_seen_and_the_spike_is_named(height):
    drawing, panel = panel_of(spiked(height))
    [line] = panel.lines
    usual = np.delete(line.y, 700)
    # Within a percent of the half that it is given, whichever way the spike points.
    assert np.ptp(usual) > 0.3 * panel.box.height
    assert panel.box.y0 <= line.y.min() <= line.y.max() <= panel.box.y1
    [said] = [t.said for t in drawing.texts if "powers of ten beyond 2" in t.said]
    assert said.startswith(f"{read_off(height)} at t = 3.5;")
    numbers = [said for _, said in panel.y]
    assert len(numbers) >= 3
    places = [place for place, _ in panel.y]
    assert min(np.diff(places)) > 20  # pixels, of which a digit has 16


def test_the_usual_part_is_linear():
    _, panel = panel_of(spiked(900.0))
    [line] = panel.lines
    inside = np.abs(SWING) < 1.9
    inside[700] = False
    slope, start = np.polyfit(SWING[inside], line.y[inside], 1)
    assert np.allclose(slope * SWING[inside] + start, line.y[inside], atol=1e-6)


@pytest.mark.parametrize(
    "values",
    [
        SWING,
        spiked(20.0),
        np.exp(-T),
        np.exp(-5.0 * T),
        T**3,
        np.zeros_like(T),
        np.full_like(T, np.nan),
    ],
    ids=["swing", "small spike", "decay", "fast decay", "power", "nothing", "gaps"],
)
def test_what_is_no_spike_and_does_not_explode_stays_linear(values):
    scale = spread_scale((T, values))
    assert not scale.linear
    assert not scale.log


def test_an_explosion_is_a_line():
    _, panel = panel_of(1e-3 * np.exp(4.0 * T))
    [line] = panel.lines
    slope, start = np.polyfit(line.x, line.y, 1)
    assert np.allclose(slope * line.x + start, line.y, atol=1e-6)


def test_an_explosion_to_both_sides_shows_its_swings():
    values = np.exp(4.0 * T) * np.cos(6 * T)
    drawing, panel = panel_of(values)
    [line] = panel.lines
    # Each swing, also the first ones, is seen: ten to either side.
    middle = 0.5 * (line.y.max() + line.y.min())
    turns = np.flatnonzero(np.diff(np.sign(line.y - middle)))
    assert len(turns) > 15
    assert any("powers of ten" in text for text in drawing.written())


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"), (5.0, "5"), (-1599.2, "−1599"), (1e8, "10⁸"), (-1e8, "−10⁸"),
        (3.361e38, "3.361 × 10³⁸"), (2e-7, "2 × 10⁻⁷"), (0.05, "0.05"),
    ],
)  # fmt: skip
def test_numbers_as_one_writes_them(value, said):
    assert read_off(value) == said


def note(columns, make=plots.trajectory, *more, **options):
    """Give a picture, and what is said of its powers of ten."""
    run = record({"t": T, **columns})
    found = drawn(make, run, *more, **options)
    [text] = [one for one in found.texts if "powers of ten" in one.said]
    return found, text


@pytest.mark.parametrize("at", [160, 999, 1001, 1900])
@pytest.mark.parametrize("height", [900.0, -4e4])
def test_a_spike_is_named_on_the_side_where_it_is_not(at, height):
    values = np.sin(3 * T)
    values[at] = height
    found, text = note({"q": values}, plots.trajectory, ["q"], Scene({}))
    assert f"at t = {T[at]:.5g}; " in text.said
    box = found.panels[0].box
    half = (box.x0 + box.x1) / 2
    assert (text.box.x0 < half - 10) == (T[at] > 5.0)
    assert box.x0 <= text.box.x0 < text.box.x1 <= box.x1
    assert box.y0 < text.box.y0 < text.box.y1 <= box.y1


def test_the_greatest_of_several_is_named_and_what_has_no_value_is_not():
    kinetic = np.abs(np.sin(3 * T))
    potential = np.cos(3 * T)
    kinetic[300], potential[700] = 500.0, -800.0
    potential[400], kinetic[900] = np.nan, np.inf
    columns = {"kinetic": kinetic, "potential": potential, "energy": 0 * T + 1}
    _, text = note(columns, plots.energy)
    assert text.said.startswith("−800 at t = 3.5; powers of ten beyond ")
