"""Plots that a model asks for: one scale, several curves, a second axis, powers."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.model.model import Curve, Plot, Scene
from lagsim.outputs import plots
from lagsim.outputs.figure import DPI, PENS, RIGHT
from tests.outputs.drawn import against, drawn, finite
from tests.outputs.test_plots import record

T = np.linspace(0.0, 2.0 * np.pi, 401)
METRES = {"plot.0.x": "m", "plot.0.y.1": "m"}
NOWHERE = Scene({})


def ellipse(a, b):
    return {"t": T, "plot.0.x": a * np.cos(T), "plot.0.y.1": b * np.sin(T)}


def path_of(columns, units, wanted=None, scene=NOWHERE):
    run = record(columns, units=units)
    drawing = drawn(plots.plot, run, 0, wanted or against("u", "v"), scene)
    [panel] = drawing.panels
    return drawing, panel, panel.lines[0]


def sides(line):
    return np.ptp(line.x), np.ptp(line.y)


@pytest.mark.parametrize("a", [1.0, 0.2, 5.0])
def test_circles_are_circles(a):
    _, _, line = path_of(ellipse(a, a), METRES)
    width, height = sides(line)
    assert width == pytest.approx(height, rel=1e-9)
    # Not in a corner: it fills the panel.
    assert width > 400


@pytest.mark.parametrize(("a", "b"), [(1.0, 3.0), (3.0, 1.0), (8.0, 1.0), (1.0, 8.0)])
def test_so_are_ellipses_and_they_fill_the_sheet(a, b):
    drawing, panel, line = path_of(ellipse(a, b), METRES)
    width, height = sides(line)
    assert width / height == pytest.approx(a / b, rel=1e-9)
    right = drawing.sheet.width - panel.box.x1 / DPI
    assert right == pytest.approx(RIGHT)


def test_a_scale_of_its_own_where_one_would_make_a_line_of_it():
    _, panel, line = path_of(ellipse(100.0, 1.0), METRES)
    assert sides(line)[1] > 0.8 * panel.box.height


def test_other_units_have_other_scales():
    _, panel, line = path_of(ellipse(1.0, 4.0), METRES | {"plot.0.y.1": "m/s"})
    assert sides(line)[0] > 0.9 * panel.box.width
    assert sides(line)[1] > 0.8 * panel.box.height


def test_points_of_a_scene_have_one_scale_without_units():
    wanted = Plot(Curve(5, "2*u"), (Curve(6, "v"),))
    _, _, line = path_of(ellipse(1.0, 1.0), {}, wanted, Scene({"bob": (5, 6)}))
    assert sides(line)[0] == pytest.approx(sides(line)[1], rel=1e-9)
    _, _, line = path_of(ellipse(1.0, 1.0), {}, wanted, Scene({"bob": (5, 7)}))
    assert sides(line)[0] > 1.2 * sides(line)[1]


def several(**more):
    return Plot(
        Curve(0, "t"), (Curve(0, "theta"), Curve(0, "theta_dot")), title="Both", **more
    )


def test_several_curves_are_told_apart_and_named():
    columns = {"t": T, "plot.0.x": T, "plot.0.y.1": np.sin(T), "plot.0.y.2": np.cos(T)}
    units = {"t": "s", "plot.0.y.1": "rad", "plot.0.y.2": "rad/s"}
    run = record(columns, units=units)
    drawing = drawn(plots.plot, run, 0, several(), NOWHERE)
    [panel] = drawing.panels
    assert [line.colour for line in panel.lines] == [
        pen["color"].lower() for pen in PENS[:2]
    ]
    # Two units are none.
    assert panel.labels[1] == "θ, θ\u0307"
    assert {"θ", "θ\u0307", "Both"} <= set(drawing.written())
    top = max(panel.box.y1 for panel in drawing.panels)
    assert all(t.box.y0 >= top for t in drawing.texts if t.said in ("θ", "Both"))


def test_a_second_axis_stands_at_the_right_with_a_scale_of_its_own():
    columns = {"t": T, "plot.0.x": T, "plot.0.y.1": T, "plot.0.y2.1": 1e3 * T}
    run = record(columns, units={"t": "s", "plot.0.y.1": "m", "plot.0.y2.1": "N"})
    wanted = Plot(Curve(0, "t"), (Curve(0, "x"),), (Curve(0, "F"),))
    drawing = drawn(plots.plot, run, 0, wanted, NOWHERE)
    left, right = drawing.panels
    assert (left.labels[1], right.labels[1]) == ("x (m)", "F (N)")
    assert left.box.bounds == right.box.bounds
    # Both are straight lines over the whole panel.
    for panel in (left, right):
        assert sides(panel.lines[0])[1] > 0.8 * panel.box.height
    texts = {text.said: text for text in drawing.texts}
    assert texts["x (m)"].box.x1 < left.box.x0
    assert texts["F (N)"].box.x0 > left.box.x1
    for text in drawing.texts:
        assert 0 <= text.box.x0 < text.box.x1 <= drawing.sheet.width * 200
    # The next panel has its numbers at the left again.
    again = drawn(plots.plot, run, 0, against("t", "v"), NOWHERE)
    [label] = [text for text in again.texts if text.said == "v (m)"]
    assert label.box.x1 < again.panels[0].box.x0


def test_an_axis_of_powers_makes_an_exponential_a_line():
    columns = {"t": T, "plot.0.x": T, "plot.0.y.1": np.exp(7 * T)}
    wanted = against("t", "v")._replace(log=frozenset("y"))
    [panel] = drawn(plots.plot, record(columns), 0, wanted, NOWHERE).panels
    x, y = panel.lines[0].x, panel.lines[0].y
    slope, start = np.polyfit(x, y, 1)
    assert np.allclose(slope * x + start, y, atol=1e-6)
    assert any("10" in said for _, said in panel.y)


def test_a_power_is_a_line_where_both_axes_are_and_what_is_not_positive_a_gap():
    x = np.concatenate(([-1.0, 0.0], np.logspace(-3, 3, 100)))
    columns = {"t": np.arange(102.0), "plot.0.x": x, "plot.0.y.1": x * abs(x)}
    wanted = against("u", "v")._replace(log=frozenset("xy"))
    [panel] = drawn(plots.plot, record(columns), 0, wanted, NOWHERE).panels
    x, y = finite(panel.lines[0].x, panel.lines[0].y)
    assert len(x) == 100
    slope, start = np.polyfit(x, y, 1)
    assert np.allclose(slope * x + start, y, atol=1e-6)
