"""Bands of one standard deviation around columns, read off the pictures."""

import numpy as np
import pytest

from lagsim.model.model import Settings
from lagsim.outputs.figure import PENS
from lagsim.run.observers.appended import Appended
from lagsim.studies import overlay
from tests.cli.conftest import lagsim  # noqa: F401
from tests.outputs.drawn import (
    against,
    assert_legible,
    coordinates,
    drawn,
    plotted,
    scale_of,
)

STEP = 0.05
T = STEP * np.arange(241)
Q, DEVIATION = np.sin(T), 0.02 * T
OSCILLATOR = """
parameters: {k: {value: 4, uncertainty: 0.4}, c: 0}
coordinates: {x: {unit: m}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2, dissipation: c*x_dot^2/2}
initial: {x: 1}
simulation: {duration: 6, output_step: 0.05}
"""
LEGEND = "± one standard deviation"


def appended(**deviations):
    """Columns of standard deviations at the times T."""
    settings = Settings(start=0.0, end=T[-1], output_step=STEP)
    names = tuple(f"sd.{name}" for name in deviations)
    return Appended(names, settings, np.array([*deviations.values()]).T, {}, [])


def bands(panel):
    """Return the areas of a panel, each as sorted corners (x, low, high) by time."""
    across, up = scale_of(panel.labels[0], panel.x), scale_of(panel.name, panel.y)
    found = []
    for _, corners in panel.areas:
        x, y = np.round(across(corners[:, 0]), 6), up(corners[:, 1])
        at = np.unique(x)
        low, high = ([f(y[x == one]) for one in at] for f in (np.min, np.max))
        found.append((at, np.array(low), np.array(high)))
    return found


def test_a_coordinate_lies_in_its_band():
    seen = coordinates({"t": T, "q": Q}, ["q"], appended=appended(q=DEVIATION))
    [panel] = seen.panels
    [(t, low, high)] = bands(panel)
    assert t == pytest.approx(T, abs=1e-6)
    assert low == pytest.approx(Q - DEVIATION, abs=1e-5)
    assert high == pytest.approx(Q + DEVIATION, abs=1e-5)
    # The whole band lies within the panel.
    bottom, top = panel.limits[1]
    assert bottom < low.min() < high.max() < top
    assert panel.areas[0][0] == PENS[0]["color"].lower()
    assert LEGEND in seen.written()
    assert_legible(seen)


@pytest.mark.slow
def test_without_a_deviation_there_is_no_band():
    for more in ({}, {"appended": appended(other=DEVIATION)}):
        seen = coordinates({"t": T, "q": Q}, ["q"], **more)
        assert not seen.panels[0].areas
        assert LEGEND not in seen.written()


@pytest.mark.slow
def test_a_band_has_gaps_where_the_deviation_is_unknown():
    """At the two rows of an impact, and where the motion is not differentiable."""
    unknown = (T > 4.0) & (T < 5.0)
    known = np.where(unknown, np.nan, 0.1)
    rows = np.sort([*T, 7.01, 7.01])
    seen = coordinates(
        {"t": rows, "q": np.cos(rows)}, ["q"], appended=appended(q=known)
    )
    found = bands(seen.panels[0])
    # Each piece ends at its last output time.
    ends = [(t[0], t[-1]) for t, _, _ in found]
    assert ends == [pytest.approx(x, abs=1e-5) for x in ((0, 4), (5, 7), (7.05, T[-1]))]
    for t, low, high in found:
        assert 0.5 * (low + high) == pytest.approx(np.cos(t), abs=1e-5)
        assert 0.5 * (high - low) == pytest.approx(0.1 + 0 * t, abs=1e-5)


@pytest.mark.slow
def test_coordinates_that_share_a_panel_have_a_band_each():
    columns = {"t": T, "a": Q, "b": Q + 1.0}
    units = {"t": "s", "a": "m", "b": "m"}
    more = appended(a=DEVIATION, b=2 * DEVIATION)
    [panel] = coordinates(columns, ["a", "b"], units=units, appended=more).panels
    sizes = [np.max(high - low) for _, low, high in bands(panel)]
    assert sizes == pytest.approx([2 * 0.24, 2 * 0.48], abs=1e-4)
    colours = [colour for colour, _ in panel.areas]
    assert colours == [pen["color"].lower() for pen in PENS[:2]]


@pytest.mark.slow
@pytest.mark.parametrize("log", [(), ("y",)])
def test_a_plot_against_time_has_bands(log):
    wanted = against("t", "q", "2*q", log=log)
    x, *names = wanted.curves(0)
    values = 1.5 + Q
    columns = {"t": T, x: T, **dict.fromkeys(names, values)}
    seen = plotted(columns, wanted, appended=appended(q=0.1 + DEVIATION))
    [panel] = seen.panels
    # `2*q` is no column, and has no deviation.
    [(_, corners)] = panel.areas
    assert len(corners) > len(T)
    assert LEGEND in seen.written()
    assert_legible(seen)
    if not log:
        [(_, low, high)] = bands(panel)
        assert 0.5 * (high - low) == pytest.approx(0.1 + DEVIATION, abs=1e-4)


@pytest.mark.slow
def test_results_on_common_axes_have_a_band_each(lagsim, tmp_path):  # noqa: F811
    for name, c in (("one", 0.1), ("other", 0.4)):
        text = OSCILLATOR.replace("c: 0", f"c: {c}")
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
        lagsim("run", f"{name}.yaml", "--no-plots", "-o", name, "-q", code=0)
    runs = overlay.read([tmp_path / "one", tmp_path / "other"])
    seen = drawn(overlay.picture, runs, ["x"])
    [panel] = seen.panels
    for run, (t, low, high) in zip(runs, bands(panel), strict=True):
        place = np.searchsorted(run.table.t, t + 1e-6) - 1
        deviation = run.table["sd.x"][place]
        assert 0.5 * (high - low) == pytest.approx(deviation, abs=1e-4)
    assert LEGEND in seen.written()
    assert_legible(seen)


@pytest.mark.slow
def test_a_path_has_no_band():
    wanted = against("q", "q")
    x, y = wanted.curves(0)
    seen = plotted({"t": T, x: Q, y: Q}, wanted, appended=appended(q=DEVIATION))
    assert not seen.panels[0].areas
    assert LEGEND not in seen.written()
