"""The picture of several runs: one panel a column, one pen a run."""

import numpy as np
import pytest

from lagsim.outputs import plots
from lagsim.run.observers.thinning import Thinning
from tests.outputs.drawn import drawn


def rows(t, **columns):
    thin = Thinning(("t", *columns), paths=())
    thin.add(np.stack([t, *columns.values()], axis=1))
    return thin


def test_pens_are_told_apart():
    looks = {(p["color"], str(p.get("dashes"))) for p in plots.pens(36)}
    assert len(looks) == 36


@pytest.mark.slow
def test_every_run_is_on_the_same_axes():
    t, later = np.linspace(0.0, 2.0, 50), np.linspace(1.0, 4.0, 70)
    runs = {
        "short": rows(t, x=np.sin(t), y=t),
        "long": rows(later, x=5 + 0 * later, y=later),
    }
    drawing = drawn(
        plots.overlay, "ball", runs, {"t": "s", "x": "m", "y": ""}, ["a note"]
    )
    assert len(drawing.panels) == 2
    for panel, columns in zip(drawing.panels, ("x", "y"), strict=True):
        one, other = panel.lines
        assert one.colour != other.colour
        # From the first time of any run to the last, and both runs where they belong.
        left, right = panel.box.x0, panel.box.x1
        assert np.allclose([one.x[0], other.x[-1]], [left, right], atol=0.5)
        share = (one.x[-1] - left) / (right - left)
        assert abs(share - 0.5) < 1e-6
        assert columns in panel.labels[1]
    said = " ".join(drawing.written())
    for word in ("ball", "of 2 runs", "short", "long", "a note"):
        assert word in said


@pytest.mark.slow
def test_a_dozen_runs_have_a_legend_with_room():
    t = np.linspace(0.0, 1.0, 5)
    runs = {f"run number {k}": rows(t, x=k + t) for k in range(12)}
    drawing = drawn(plots.overlay, "ball", runs, {"t": "", "x": ""})
    said = drawing.written()
    assert all(name in said for name in runs)


@pytest.mark.slow
def test_a_hundred_runs_are_told_by_colour():
    t = np.linspace(0.0, 1.0, 5)
    runs = {f"run number {k}": rows(t, x=k + t) for k in range(100)}
    masses = np.linspace(3.0, 1.0, 100)
    order = ("m1", masses.tolist())
    drawing = drawn(plots.overlay, "ball", runs, {"t": "", "x": ""}, (), order)
    said = drawing.written()
    assert not any("…" in text or text.startswith("run number") for text in said)
    assert "colour: m₁" in said
    panel, bar = drawing.panels
    numbers = [float(text) for _, text in bar.x]
    assert (min(numbers), max(numbers)) == (1.0, 3.0)
    # Colours go from one end to the other with the value, as those of the bar do.
    colours = [line.colour for line in panel.lines]
    assert len(set(colours)) > 90
    assert (colours[0], colours[-1]) == ("#fde725", "#440154")
