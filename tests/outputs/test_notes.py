"""The small print of pictures: what is named in it, and that it stands clear of it."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.model.model import Scene
from lagsim.outputs import plots
from lagsim.run.observers.thinning import DRIFT
from tests.outputs.drawn import drawn
from tests.outputs.test_plots import record

T = np.linspace(0.0, 6.0, 1201)
UNITS = {"t": "s", "q": "N", "energy": "J"}


def note(columns, make=plots.trajectory, *more, **options):
    """Give a picture, and what is said of its powers of ten."""
    run = record({"t": T, **columns}, units=UNITS)
    found = drawn(make, run, *more, **options)
    [text] = [one for one in found.texts if "powers of ten" in one.said]
    return found, text


@pytest.mark.parametrize("at", [100, 599, 601, 1100])
@pytest.mark.parametrize("height", [900.0, -4e4])
def test_a_spike_is_named_on_the_side_where_it_is_not(at, height):
    values = np.sin(5 * T)
    values[at] = height
    found, text = note({"q": values}, plots.trajectory, ["q"], Scene({}))
    assert f"at t = {T[at]:.5g}; " in text.said
    box = found.panels[0].box
    half = (box.x0 + box.x1) / 2
    assert (text.box.x0 < half - 10) == (T[at] > 3.0)
    assert box.x0 <= text.box.x0 < text.box.x1 <= box.x1
    assert box.y0 < text.box.y0 < text.box.y1 <= box.y1


def test_the_greatest_of_several_is_named_and_what_has_no_value_is_not():
    kinetic = np.abs(np.sin(5 * T))
    potential = np.cos(5 * T)
    kinetic[300], potential[700] = 500.0, -800.0
    potential[400], kinetic[900] = np.nan, np.inf
    columns = {"kinetic": kinetic, "potential": potential, "energy": 0 * T + 1}
    _, text = note(columns, plots.energy, is_sum=True)
    assert text.said.startswith("−800 at t = 3.5; powers of ten beyond ")


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_drift_is_told_in_the_units_of_the_energy(scale, sign):
    energy = scale * (4 + np.sin(3 * T) + sign * 2.5e-7 * T)
    columns = {"t": T, "energy": energy, "work": scale * np.sin(3 * T)}
    run = record(columns, differences={DRIFT: ("energy", "work")}, units=UNITS)
    said = drawn(plots.energy, run, is_sum=True).written()
    power = {1e-6: "10⁻¹²", 1.0: "10⁻⁶", 1e6: ""}[scale]
    most = f"1.5 × {power}" if power else "1.5"
    assert f"energy − work minus its first value: at most {most} J" in said
