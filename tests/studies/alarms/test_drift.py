"""Energy that drifts by more than the tolerance leaves has a warning of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

import lagsim
from tests.studies.alarms.test_doubt import SWING, bar_of, bump, spoilt
from tests.studies.judged import codes
from tests.support import run

# Two stars about each other, e = 0.28, far from the origin.
STARS = """
parameters: {D: 0, G: 1, m: 1, L: 1, T: 1, heavy: 0}
coordinates: {x: {}, y: {}, u: {}, v: {}MORE}
energy:
  kinetic: m*(x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2)/2KINETIC
  potential: -G*m/hypot(u - x, v - y)POTENTIAL
initial:
  x: (D - 0.5)*L
  y: D*L
  u: (D + 0.5)*L
  v: D*L
  y_dot: -0.6*L/T
  v_dot: 0.6*L/T
INITIAL
simulation: {duration: 200*T, output_step: 0.5*T}
"""
PLAIN = dict.fromkeys(("MORE", "KINETIC", "POTENTIAL", "INITIAL"), "")
BESIDE = {
    "MORE": ", z: {}",
    "KINETIC": " + 1e9*z_dot^2/2",
    "POTENTIAL": " + 1e9*z^2",
    "INITIAL": "  z: 1",
}


def stars(words, **values):
    text = STARS
    for name, more in words.items():
        text = text.replace(name, more)
    return lagsim.load(text).bind(**values)


def told(model, **options):
    found = lagsim.simulate(model, **options)
    return found, [w["code"] for w in found.record["warnings"]]


@pytest.fixture(scope="module")
def near():
    """The motion near the origin, which knows ten digits more."""
    found, codes = told(stars(PLAIN), rtol="1e-13")
    assert codes == ["unused-parameter"]
    return found


@pytest.mark.parametrize(
    ("words", "values"),
    [
        (PLAIN, {"D": 1e9}),
        (PLAIN, {"D": -3e9}),
        (PLAIN, {"D": 1e9, "L": 1e-6, "G": 1e-18}),
        (PLAIN, {"D": 1e9, "T": 1e-3, "G": 1e6}),
        (PLAIN, {"D": 1e9, "m": 1e-9}),
        (BESIDE, {"D": 1e9}),
    ],
)
def test_stars_far_from_the_origin(words, values, near):
    found, codes = told(stars(words, **values))
    assert "energy-drifts" in codes
    # The motion is that near the origin, moved: within what is told of it.
    size, far = values.get("L", 1.0), values["D"]
    true = np.max(np.abs(found["x"] / size - far - near["x"])) / np.ptp(near["x"])
    error = found.record["error"]["coordinates"]["x"]["relative"]
    assert true / 30 < error < 30 * true


def test_energy_that_drifts_without_an_estimate_has_one_warning_too():
    _, codes = told(stars(PLAIN, D=1e9), error_bar="never")
    assert codes.count("error-unknown") == 1
    assert "energy-drifts" not in codes


@pytest.mark.parametrize("far", [1e3, 1e5])
def test_what_is_far_away_and_keeps_its_energy_has_none(far):
    assert told(stars(PLAIN, D=far))[1] == ["unused-parameter"]


@pytest.mark.parametrize("far", [1e9, 1e12])
def test_the_rounding_of_a_row_is_no_drift(far):
    # y is off by its last places, and so is its energy; the motion is a parabola.
    text = f"""
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: "9.81*(y - {far})"}}
initial: {{y: {far}, y_dot: 3}}
simulation: {{duration: 0.5, output_step: 0.01}}
"""
    assert told(lagsim.load(text))[1] == []


@pytest.mark.parametrize("size", [1e-5, -1e-4])
def test_a_drift_that_the_estimate_explains_is_told_once(size):
    found = spoilt(run(SWING), "energy", bump(size))
    bar = bar_of(found, lambda t: 1e-3 * (t > 4))
    assert codes(found, bar) == ["energy-drifts"]
    assert codes(found) == ["error-unknown"]
    # More is that of energy that is gained or lost.
    lost = spoilt(run(SWING), "energy", bump(100 * size))
    assert codes(lost, bar) == [f"energy-{'gained' if size > 0 else 'lost'}"]


@pytest.mark.parametrize("rtol", [1e-7, 1e-8, 1e-10])
def test_a_drift_counts_from_a_thousand_tolerances_on(rtol):
    whole = 1.0 - math.cos(1.0)
    least = max(1e-6, 1e3 * rtol)
    found = run(SWING, rtol=rtol)
    bar = bar_of(found, lambda t: 1e-3 * (t > 4))
    assert codes(spoilt(found, "energy", bump(2 * least * whole)), bar)
    assert not codes(spoilt(found, "energy", bump(0.5 * least * whole)), bar)


def test_methods_with_a_fixed_step_are_not_asked():
    found = spoilt(run(SWING, method="rk4", step="0.01"), "energy", bump(1e-5))
    assert codes(found, bar_of(found, lambda t: 1e-6 + 0.0 * t)) == []


def test_an_absolute_tolerance_is_what_was_asked_for():
    found = spoilt(run(SWING, atol="1e-5"), "energy", bump(1e-5))
    assert codes(found, bar_of(found, lambda t: 1e-5 + 0.0 * t)) == []
