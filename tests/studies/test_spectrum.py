"""Spectra of known sums of sines, of rows with impacts, and refusals."""

import numpy as np
import pytest

import lagsim
from lagsim.outputs.figure import encoded_figure
from lagsim.studies.spectrum import LEAST_ROWS, spectrum
from lagsim.tolerances import SAME_ROW
from tests.outputs.drawn import noted
from tests.small_scenes import scene
from tests.support import refused

STEP = 0.02
SINES = {1.2345: 1.5, 4.444: 0.2, 2.718: 1e-3}


def rows(count=1801):
    t = 7.0 + STEP * np.arange(count)
    waves = (a * np.sin(2 * np.pi * f * t + f) for f, a in SINES.items())
    return t, 3.0 + sum(waves)


def test_sines_have_their_frequency_and_amplitude():
    found = spectrum(*rows(), "x", "m")
    assert [(p.frequency, p.amplitude) for p in found.peaks] == [
        # Far nearer than the rows tell two apart; the side lobes of others, 3e-5 of
        # the largest, add to the smallest.
        (pytest.approx(f, abs=1e-4), pytest.approx(a, rel=1e-5 + 1.5 * 3e-5 / a))
        for f, a in SINES.items()
    ]
    assert found.mean == pytest.approx(3.0, abs=1e-4)
    assert found.step == pytest.approx(STEP, rel=1e-12)
    # Up to half the frequency of the rows, in the column's unit.
    assert found.frequency[0] == 0.0
    assert found.frequency[-1] == pytest.approx(0.5 / STEP, rel=1e-2)
    assert len(found.frequency) == len(found.amplitude)
    assert found.record["peaks"][0]["frequency"] == found.peaks[0].frequency


def test_what_it_says_it_tells_apart_it_does():
    t = STEP * np.arange(1800)
    alone = spectrum(t, np.sin(t), "x").resolution
    for apart, count in ((1.1 * alone, 2), (0.9 * alone, 1), (0.4 * alone, 1)):
        x = np.sin(2 * np.pi * 3.0 * t) + np.sin(2 * np.pi * (3.0 + apart) * t)
        assert len(spectrum(t, x, "x").peaks) == count


def test_peaks_are_no_nearer_than_they_are_told_apart():
    t = STEP * np.arange(1500)
    rng = np.random.default_rng(3)
    for _ in range(20):
        f, a = rng.uniform(0.2, 3.0, 25), rng.uniform(0.1, 1.0, 25)
        x = np.sin(2 * np.pi * t[:, None] * f + f) @ a
        found = spectrum(t, x, "x")
        places = np.sort([peak.frequency for peak in found.peaks])
        assert len(places) > 1
        assert np.diff(places).min() >= found.resolution
        assert found.peaks[0].amplitude == max(p.amplitude for p in found.peaks)


@pytest.mark.slow
def test_its_powers_of_ten_are_typeset():
    with noted() as drawing:
        encoded_figure(spectrum(*rows(), "x_left", "m").plot("$t"), "png")
    said = {text.said: text.typeset for text in drawing.texts}
    assert all(typeset for text, typeset in said.items() if "10^" in text)
    assert said["$\\mathdefault{10^{-2}}$"]
    assert said["$t: spectrum of x$_\\mathrm{left}$"]


def test_a_column_that_stays_has_no_peaks():
    t, _ = rows()
    for level in (0.0, 5.0):
        found = spectrum(t, np.full_like(t, level), "x")
        assert found.mean == pytest.approx(level, rel=1e-14)
        assert max(found.amplitude) <= 1e-14 * level
        assert len(found.peaks) <= 8
    assert spectrum(t, np.zeros_like(t), "x").peaks == ()


def test_the_last_row_may_lie_anywhere_and_impacts_are_left_out():
    t, x = rows()
    plain = spectrum(t, x, "x")
    for beyond in (0.3, 1e-8):
        odd = spectrum(np.append(t, t[-1] + beyond * STEP), np.append(x, 9.0), "x")
        assert odd.rows == plain.rows
        assert odd.amplitude == pytest.approx(plain.amplitude, rel=1e-9)
    # Two rows where something strikes, between the others and at one of them.
    at = [t[40] + 0.3 * STEP] * 2
    struck_t = np.insert(t, [41, 41, 100], [*at, t[100]])
    struck_x = np.insert(x, [41, 41, 100], [50.0, -50.0, 70.0])
    struck = spectrum(struck_t, struck_x, "x")
    assert struck.rows == plain.rows
    assert struck.amplitude == pytest.approx(plain.amplitude, rel=1e-9)


def test_rounding_of_times_is_no_fault():
    t = 1e5 + np.arange(20_000) * 1e-3  # 1.5e-11 is a bit of these
    assert spectrum(t, np.sin(t), "x").step == pytest.approx(1e-3, rel=1e-10)


def moved(t):
    t = t.copy()
    t[50] += 10 * SAME_ROW * STEP
    return t


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda t, x: (moved(t), x), "t = 8.0"),
        (lambda t, x: (np.delete(t, 50), np.delete(x, 50)), "t = 7.98"),
        (lambda t, x: (t[::-1], x), ""),
        (lambda t, x: (t[: LEAST_ROWS - 1], x[: LEAST_ROWS - 1]), f"{LEAST_ROWS} "),
        (lambda t, x: (t, np.where(t == t[9], np.nan, x)), "`x`"),
    ],
)
def test_what_has_no_spectrum_is_told(change, name):
    with refused("no-spectrum", name):
        spectrum(*change(*rows()), "x")


@pytest.mark.slow
def test_a_result_has_the_spectrum_of_its_columns():
    text = scene("x: 1e-6", "2*x^2", coordinates="x: {unit: m}")
    asked = {"duration": 60, "output_step": 0.05, "error_bar": "never"}
    result = lagsim.simulate(lagsim.load(text), **asked)
    found = result.spectrum("x_dot")
    [peak] = found.peaks
    assert peak.frequency == pytest.approx(1 / np.pi, abs=1e-4)
    assert peak.amplitude == pytest.approx(2e-6, rel=1e-3)
    figure = found.plot("a swing")
    figure.draw_without_rendering()
    [axes] = figure.axes
    title = figure.legends[0].get_title()
    assert title.get_text().startswith("a swing: spectrum of ")
    assert axes.bbox.y1 < title.get_window_extent().y0
    assert (axes.get_xlabel(), axes.get_yscale()) == ("frequency (Hz)", "log")
    assert axes.get_ylabel() == "amplitude of x\u0307 (m/s)"
    assert np.array_equal(axes.lines[0].get_ydata(), found.amplitude)
