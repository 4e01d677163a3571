"""Values that a reader reads off a picture with a ruler: artists' data, read back.

Ticks and labels give a scale, as on paper; the values of lines on that scale are
compared with the rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from lagsim.model.model import DrawnExpression, Scene
from lagsim.model.reader import read
from lagsim.outputs import plots
from lagsim.outputs.figure import DPI, PENS
from lagsim.run.observers.thinning import DRIFT
from tests.outputs.drawn import (
    NOWHERE,
    Scale,
    against,
    below,
    coordinates,
    drawn,
    finite,
    plotted,
    record,
    scale_of,
)

EVENT, SHADE = "#444444", "#dddddd"
# A tick's number has four digits or more where it is not exact, and an inch 150 pixels.
ACCURATE = 1e-6


@dataclass
class Read:
    """A panel: its scales, and the lines in it by colour."""

    x: Scale
    y: Scale
    lines: dict
    events: list
    shade: float | None

    @property
    def named(self):
        return self.x.name, self.x.unit, self.y.name, self.y.unit


def panels(drawing):
    """Read all panels of a drawing, in the order in which they are drawn."""
    found = []
    for panel in drawing.panels:
        if not panel.y:
            continue  # without scales there is nothing to read off
        # Panels above each other share the numbers of the lowest.
        numbered = next(
            p
            for p in sorted(drawing.panels, key=lambda p: -p.box.y0)
            if p.x and p.box.y0 <= panel.box.y0 and p.box.x0 == panel.box.x0
        )
        x_axis = scale_of(panel.labels[0] or numbered.labels[0], numbered.x)
        y_axis = scale_of(panel.name, panel.y)
        lines, events = {}, []
        for line in panel.lines:
            if line.colour == EVENT:
                events = list(x_axis(line.x))
            elif line.width >= 0.8 and len(line.x) > 1:
                shown = (x_axis(line.x), y_axis(line.y))
                lines.setdefault(line.colour, []).append(shown)
        shade = [float(x_axis(c[:, 0].min())) for n, c in panel.areas if n == SHADE]
        found.append(Read(x_axis, y_axis, lines, events, shade[0] if shade else None))
    return found


def assert_drawn(panel, *curves):
    """Compare the lines of a panel, by colour, with curves (x, y[, size])."""
    found = [line for group in panel.lines.values() for line in group]
    assert len(panel.lines) == len(found)
    for (across, up), (x, y, *size) in zip(found, curves, strict=True):
        most = size[0] if size else np.max(np.abs(y))
        assert np.max(np.abs(across - x)) < ACCURATE * np.ptp(x)
        assert np.max(np.abs(up - y)) < ACCURATE * most


T = np.linspace(0.0, 12.0, 400)
# Values that ask for an offset, a power of ten, both, neither; and of both signs.
SERIES = {
    "plain": 3.0 * np.sin(T) - 1.0, "small": 4e-7 * np.cos(2 * T),
    "large": 7e8 * np.sin(T), "far": 7e6 + 12.0 * np.sin(T),
    "deep": -7e6 + 12.0 * np.sin(T), "near one": 1.0 + 3e-9 * np.cos(T),
    "falling": -2e-5 * T, "level": 0.0 * T + 5.0, "zero": 0.0 * T,
}  # fmt: skip


@pytest.mark.parametrize("name", SERIES)
@pytest.mark.parametrize("start", [0.0, 86_400.0, -3e6, 1e-4])
def test_coordinates_are_drawn_where_they_are(name, start):
    values = SERIES[name]
    t = start + T * (1e-6 if start == 1e-4 else 1.0)
    columns, units = {"t": t, "q": values}, {"q": "m", "t": "s"}
    [panel] = panels(coordinates(columns, ["q"], units=units))
    assert panel.named == ("t", "s", "q", "m")
    assert_drawn(panel, (t, values, np.ptp(values) or 1.0))


@pytest.mark.slow
def test_each_coordinate_has_the_unit_and_name_of_its_own():
    """Coordinates of one unit share a panel where each stays readable."""
    columns = {"t": T, "a": np.sin(T), "b": 2 * np.cos(T), "c": 1e-8 * T, "d": T**2}
    columns |= {"e": T, "f": 1000 * T}
    units = {"t": "s", "a": "m", "b": "m", "c": "rad", "e": "N", "f": "N"}
    shown = panels(coordinates(columns, list("abcdef"), units=units))
    named = [(p.y.name, p.y.unit) for p in shown]
    assert named == [("a, b", "m"), ("c", "rad"), ("d", ""), ("e", "N"), ("f", "N")]
    for panel in shown:
        assert_drawn(panel, *((T, columns[n]) for n in panel.y.name.split(", ")))


def energies(**more):
    work = 2e-3 * T
    kinetic, potential = 1 + np.cos(4 * T), 2 - np.cos(4 * T)
    energy = kinetic + potential + work + 1e-9 * np.sin(3 * T) * (T > 0)
    columns = {"t": T, "kinetic": kinetic, "potential": potential, "energy": energy}
    return columns | {"work": work}, drawn(plots.energy, record(
        columns | {"work": work}, {DRIFT: ("energy", "work")}, **more
    ))  # fmt: skip


@pytest.mark.slow
def test_energies_and_their_drift():
    columns, drawing = energies()
    upper, lower = panels(drawing)
    assert upper.named == ("t", "s", "energy", "J")
    assert lower.named == ("t", "s", "drift", "J")
    assert_drawn(upper, *((T, columns[n]) for n in ("energy", "potential", "kinetic")))
    balance = columns["energy"] - columns["work"]
    assert_drawn(lower, (T, balance - balance[0], 1e-9))
    # A legend names the lines by their colours.
    names = ["energy T + V", "potential V", "kinetic T"]
    for name, colour in zip(names, upper.lines, strict=True):
        [text] = [t for t in drawing.texts if t.said == name]
        x, y = text.place
        samples = [
            line.colour
            for line in drawing.samples
            if abs(np.mean(line.y) - y) < 12 and 0 < x - np.max(line.x) < 24
        ]
        assert samples == [colour]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("T0", "V0", "shifted"),
    [
        (0.0, 3e6, {"potential": 3e6, "energy": 3e6}),
        (0.0, -3e6, {"potential": -3e6, "energy": -3e6}),
        (4e5, 0.0, {"kinetic": 4e5, "energy": 4e5}),
        (4e5, 3e6, {"kinetic": 4e5, "potential": 3e6, "energy": 3.4e6}),
        # They cancel in the sum, which is near 0 then.
        (4e5, -4e5, {"kinetic": 4e5, "potential": -4e5}),
        # Near enough to 0 to be read.
        (0.0, 10.0, {}),
    ],
)
def test_energies_far_from_zero_are_drawn_about_their_start(T0, V0, shifted):
    swing = 1 - np.cos(4 * T)
    columns = {"t": T, "kinetic": T0 + swing, "potential": V0 - swing}
    columns["energy"] = columns["kinetic"] + columns["potential"]
    drawing = drawn(plots.energy, record(columns))
    upper, _ = panels(drawing)
    names = ("energy", "potential", "kinetic")
    assert_drawn(upper, *((T, columns[n] - shifted.get(n, 0.0), 2.0) for n in names))
    said = " ".join(drawing.written())
    known = ("energy T + V", "potential V", "kinetic T")
    for name, written in zip(names, known, strict=True):
        assert (f"{written} less " in said) == (name in shifted)


@pytest.mark.slow
def test_what_energies_are_drawn_less_is_named():
    columns = {"t": T, "kinetic": 1 - np.cos(T), "potential": 3e6 + np.cos(T)}
    columns["energy"] = columns["kinetic"] + columns["potential"]
    said = drawn(plots.energy, record(columns)).written()
    for name in ("potential V", "energy T + V"):
        assert f"{name} less 3 × 10⁶ J" in said


def hanging(length, a, b):
    """Draw a string of a length between fixed points a and b; return its panel."""
    points = {"a": a, "b": b, "low": (0.0, -2.0)}
    columns = {"t": T, "q": np.sin(T)}
    for name, place in points.items():
        columns |= {f"point.{name}.{k + 1}": x for k, x in enumerate(place)}
    columns["point.low.1"] = 0.1 * np.sin(T)
    scene = dict.fromkeys(points, (0, 0))
    looks, lengths = ("string",), ()
    model = None
    if length is not None:
        text = f"""
coordinates: {{q: {{}}}}
energy: {{kinetic: q_dot^2/2, potential: 0}}
initial: {{q: 0}}
scene:
  points: {{a: {list(a)}, b: {list(b)}, low: {list(points["low"])}}}
  links: [{{points: [a, b], length: {length}}}]
"""
        model = read(text, "m.yaml")
        lengths = model.scene.lengths
    wanted = Scene(scene, (("a", "b"),), looks, (), lengths)
    run = record(columns)
    drawing = drawn(plots.trajectory, run, ["q"], wanted, "coordinates", model)
    return drawing.panels[1], panels(drawing)[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("length", "sag"),
    [
        (None, 0.0),  # as long as its ends are ever apart
        (0.5, 0.0),
        (1.0, 0.0),
        # sqrt(3)/4 of sqrt(l^2 - 1): of a flat parabola that is this long.
        (1.25, 3**0.5 / 4 * 0.75),
        (2.0, 0.75),
    ],
)
def test_a_string_sags_where_its_ends_are_nearer_than_it_is_long(length, sag):
    panel, read_off = hanging(length, (0.0, 0.0), (1.0, 0.0))
    lines = [(read_off.x(one.x), read_off.y(one.y)) for one in panel.lines]
    [(x, y), *_] = [line for line in lines if np.ptp(line[0]) > 0.9]
    assert (x.min(), x.max()) == pytest.approx((0.0, 1.0), abs=1e-3)
    middle = np.interp(0.5, x, y)
    assert middle == pytest.approx(-sag, abs=2e-3)


@pytest.mark.slow
def test_events_horizon_and_notes_where_there_are_any():
    told = {"switch", "past the horizon", "incomplete: until t = 3"}
    events = (0.5, 3.25, 11.0)
    more = {"events": {"switch": events}, "horizon": 7.5}
    _, drawing = energies(**more, note="incomplete: until t = 3")
    for panel in panels(drawing):
        assert panel.events == pytest.approx(events, abs=1e-6)
        assert panel.shade == pytest.approx(7.5, abs=1e-6)
    said = drawing.written()
    assert {said.count(text) for text in (*told, "swing: energy")} == {1}
    _, drawing = energies()
    assert [(p.events, p.shade) for p in panels(drawing)] == [([], None)] * 2
    assert not told & set(drawing.written())


@pytest.mark.slow
def test_constraint_forces_and_multipliers():
    columns = {"t": T, "Qc_x": 1e4 * np.sin(T), "Qc_y": -3 * T, "lambda_rod": 2 + T}
    run = record(columns, units={"t": "s", "Qc_x": "N", "Qc_y": "N"})
    shown = panels(drawn(plots.constraint_forces, run, ["x", "y"], ["rod"]))
    named = [(below("Qc", "x"), "N"), (below("Qc", "y"), "N"), (below("λ", "rod"), "")]
    assert [(p.y.name, p.y.unit) for p in shown] == named
    for panel, name in zip(shown, list(columns)[1:], strict=True):
        assert_drawn(panel, (T, columns[name]))


@pytest.mark.slow
def test_paths_of_the_scene():
    x, y, z = 5 + np.cos(T), 0.25 * np.sin(T), -1e3 + 0.1 * T
    points = {"point.p.1": x, "point.p.2": y, "point.p.3": z}
    scene, units = Scene({"p": (0, 0, 0)}), dict.fromkeys(points, "m")
    shown = panels(coordinates({"t": T, "q": x, **points}, ["q"], scene, units=units))
    for panel, across, up, (one, other) in zip(
        shown[1:], (x, y, x), (z, z, y), ("xz", "yz", "xy"), strict=True
    ):
        assert panel.named == (one, "m", other, "m")
        assert_drawn(panel, (across, up, np.ptp(up)))


# --- Plots that a model asks for

TURN = np.linspace(0.0, 2.0 * np.pi, 401)
METRES = {"plot:0.x": "m", "plot:0.y.1": "m"}


@pytest.mark.slow
@pytest.mark.parametrize("shift", [0.0, 5e4, -5e4])
def test_a_plot_of_the_model(shift):
    x, y = shift + np.cos(T), 1e-5 * np.sin(3 * T)
    columns = {"t": T, "plot:0.x": x, "plot:0.y.1": y}
    wanted = against("2*a", "b^2")
    [panel] = panels(plotted(columns, wanted, units={"plot:0.x": "m"}))
    assert panel.named == ("2*a", "m", "b^2", "")
    assert_drawn(panel, (x, y))


@pytest.mark.slow
def test_a_plot_against_time():
    columns = {"t": T, "plot:0.x": T, "plot:0.y.1": T**2}
    found = plotted(columns, against(" t ", "u"), events={"switch": (2.0,)})
    [panel] = panels(found)
    assert panel.named == (" t ", "s", "u", "")
    assert_drawn(panel, (T, T**2))
    assert panel.events == pytest.approx([2.0], abs=1e-6)


def ellipse(a, b, units, wanted=None, scene=NOWHERE):
    """Draw an ellipse; return drawing, panel, and the sides of its path in pixels."""
    columns = {"t": TURN, "plot:0.x": a * np.cos(TURN), "plot:0.y.1": b * np.sin(TURN)}
    drawing = plotted(columns, wanted or against("u", "v"), scene, units=units)
    [panel] = drawing.panels
    return drawing, panel, (np.ptp(panel.lines[0].x), np.ptp(panel.lines[0].y))


@pytest.mark.parametrize("a", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("ratio", [1.0, 1 / 3, 3.0, 8.0, 1 / 8])
def test_circles_are_circles_and_fill_the_sheet(a, ratio):
    drawing, panel, (width, height) = ellipse(a, a / ratio, METRES)
    assert width / height == pytest.approx(ratio, rel=1e-9)
    assert max(width, height) > 400
    assert 0.0 < drawing.sheet.get_figwidth() - panel.box.x1 / DPI < 0.3


@pytest.mark.parametrize(("a", "b", "unit"), [(100.0, 1.0, "m"), (1.0, 4.0, "m/s")])
def test_scales_of_their_own(a, b, unit):
    """Where one would make a line of a path, and where units differ."""
    _, panel, (width, height) = ellipse(a, b, METRES | {"plot:0.y.1": unit})
    assert width > 0.9 * panel.box.width
    assert height > 0.8 * panel.box.height


@pytest.mark.slow
def test_points_of_a_scene_have_one_scale_without_units():
    wanted = against("2*u", "v")._replace(
        x=DrawnExpression(5, "2*u"), y=(DrawnExpression(6, "v"),)
    )
    *_, (width, height) = ellipse(1.0, 1.0, {}, wanted, Scene({"bob": (5, 6)}))
    assert width == pytest.approx(height, rel=1e-9)
    *_, (width, height) = ellipse(1.0, 1.0, {}, wanted, Scene({"bob": (5, 7)}))
    assert width > 1.2 * height


@pytest.mark.slow
def test_several_curves_are_told_apart_and_named():
    columns = {"t": T, "plot:0.x": T, "plot:0.y.1": np.sin(T), "plot:0.y.2": np.cos(T)}
    units = {"t": "s", "plot:0.y.1": "rad", "plot:0.y.2": "rad/s"}
    wanted = against("t", "theta", "theta_dot", title="Both")
    drawing = plotted(columns, wanted, units=units)
    [panel] = drawing.panels
    pens = [pen["color"].lower() for pen in PENS[:2]]
    assert [line.colour for line in panel.lines] == pens
    # Two units are none.
    assert panel.labels[1] == "θ, θ\u0307"
    assert {"θ", "θ\u0307"} <= set(drawing.written())
    assert drawing.title == "swing: Both"
    above = [t.box.y0 for t in drawing.texts if t.said in ("θ", "swing: Both")]
    assert min(above) >= panel.box.y1


@pytest.mark.slow
def test_a_second_axis_stands_at_the_right_with_a_scale_and_a_colour_of_its_own():
    columns = {"t": T, "plot:0.x": T, "plot:0.y.1": T, "plot:0.y2.1": 1e2 * T}
    units = {"t": "s", "plot:0.y.1": "m", "plot:0.y2.1": "N"}
    wanted = against("t", "x")._replace(y2=(DrawnExpression(0, "F"),))
    drawing = plotted(columns, wanted, units=units)
    left, right = drawing.panels
    assert (left.labels[1], right.labels[1]) == ("x (m)", "F (N)")
    assert left.box.bounds == right.box.bounds
    texts = {text.said: text for text in drawing.texts}
    assert texts["x (m)"].box.x1 < left.box.x0
    assert texts["F (N)"].box.x0 > left.box.x1
    for text in drawing.texts:
        assert 0 <= text.box.x0 < text.box.x1 <= drawing.sheet.get_figwidth() * DPI
    for axes, panel in zip(drawing.sheet.axes, drawing.panels, strict=True):
        # Both are straight lines over the whole panel.
        [line] = panel.lines
        assert np.ptp(line.y) > 0.8 * panel.box.height
        [curve] = [x.get_color() for x in axes.lines if len(x.get_xdata()) == len(T)]
        written = [axes.yaxis.label, *axes.yaxis.get_ticklabels(which="major")]
        assert {text.get_color() for text in written} == {curve}
    # The next panel has its numbers at the left again.
    again = plotted(columns, against("t", "v"), units=units)
    [label] = [text for text in again.texts if text.said == "v (m)"]
    assert label.box.x1 < again.panels[0].box.x0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("x", "y", "log"),
    [
        (T, np.exp(7 * T / 2), "y"),
        # What is not positive is a gap.
        (np.append([-1.0, 0.0], np.logspace(-3, 3, 398)),
         np.append([-1.0, 0.0], np.logspace(-6, 6, 398)), "xy"),
    ],
    ids=["exponential", "power"],
)  # fmt: skip
def test_on_axes_of_powers_an_exponential_and_a_power_are_lines(x, y, log):
    columns = {"t": T, "plot:0.x": x, "plot:0.y.1": y}
    wanted = against("t" if log == "y" else "u", "v", log=frozenset(log))
    [panel] = plotted(columns, wanted).panels
    across, up = finite(panel.lines[0].x, panel.lines[0].y)
    assert len(across) == np.count_nonzero(y > 0)
    slope, start = np.polyfit(across, up, 1)
    assert np.allclose(slope * across + start, up, atol=1e-6)
    assert any("10" in said for _, said in panel.y)
