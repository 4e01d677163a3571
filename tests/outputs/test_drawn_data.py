"""What a reader of a picture reads off it, with a ruler: artists' data, read back.

Ticks and labels give a scale, as on paper; what the lines are worth on that scale is
held against the rows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pytest

from lagsim.model.model import Scene
from lagsim.outputs import plots
from lagsim.run.observers.thinning import DRIFT
from tests.outputs.drawn import against, below, drawn, record

EVENT, SHADE = "#444444", "#dddddd"
PLAIN = str.maketrans("−⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "--0123456789")
LABEL = re.compile(
    r"(?P<name>.*?)(?: (?P<sign>[−+]) (?P<offset>[\d.e+-]+))?"
    r"(?: \((?:10(?P<power>[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))? ?(?P<unit>[^()]*)\))?"
)
# A tick's number has four digits or more where it is not exact, and an inch 150 pixels.
ACCURATE = 1e-6


@dataclass
class Scale:
    """A scale on paper: value = slope * pixels + start, of what, in which unit."""

    name: str
    unit: str
    slope: float
    start: float

    def __call__(self, pixels):
        return self.slope * np.asarray(pixels, float) + self.start


def scale_of(label, ticks):
    """Make a scale from an axis label and (pixels, text) of its ticks."""
    m = LABEL.fullmatch(label)
    assert m, label
    unit = 10.0 ** int((m["power"] or "0").translate(PLAIN))
    offset = float(m["offset"] or 0.0) * (1.0 if m["sign"] == "−" else -1.0)
    places = np.array([place for place, _ in ticks])
    counts = np.array([float(text.translate(PLAIN)) for _, text in ticks])
    slope, start = np.polyfit(places, counts, 1)
    # Ticks are evenly spaced, or somebody moved one.
    assert np.allclose(
        slope * places + start, counts, rtol=0, atol=1e-6 * np.ptp(counts)
    )
    return Scale(m["name"], m["unit"] or "", unit * slope, unit * start + offset)


@dataclass
class Read:
    """A panel: its scales, and the lines in it by colour."""

    x: Scale
    y: Scale
    lines: dict
    events: list
    shade: float | None


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
        below, side, above = panel.labels
        x_axis = scale_of(below or numbered.labels[0], numbered.x)
        y_axis = scale_of(side or above, panel.y)
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


def same(found, expected, scale=None):
    scale = np.nanmax(np.abs(expected)) if scale is None else scale
    assert np.max(np.abs(found - expected)) < ACCURATE * scale


T = np.linspace(0.0, 12.0, 400)
# Values that ask for an offset, a power of ten, both, neither; and of both signs.
SERIES = {
    "plain": 3.0 * np.sin(T) - 1.0,
    "small": 4e-7 * np.cos(2 * T),
    "large": 7e8 * np.sin(T),
    "far": 7e6 + 12.0 * np.sin(T),
    "deep": -7e6 + 12.0 * np.sin(T),
    "near one": 1.0 + 3e-9 * np.cos(T),
    "falling": -2e-5 * T,
    "level": 0.0 * T + 5.0,
    "zero": 0.0 * T,
}


@pytest.mark.parametrize("name", SERIES)
@pytest.mark.parametrize("start", [0.0, 86_400.0, -3e6, 1e-4])
def test_coordinates_are_drawn_where_they_are(name, start):
    values = SERIES[name]
    t = start + T * (1e-6 if start == 1e-4 else 1.0)
    run = record({"t": t, "q": values}, units={"q": "m", "t": "s"})
    [panel] = panels(drawn(plots.trajectory, run, ["q"], Scene({})))
    assert (panel.x.name, panel.x.unit) == ("t", "s")
    assert (panel.y.name, panel.y.unit) == ("q", "m")
    [[(x, y)]] = panel.lines.values()
    same(x, t, np.ptp(t))
    same(y, values, np.ptp(values) or 1.0)


def test_each_coordinate_has_the_unit_and_name_of_its_own():
    columns = {"t": T, "a": np.sin(T), "b": 2 * np.cos(T), "c": 1e-8 * T, "d": T**2}
    units = {"t": "s", "a": "m", "b": "m", "c": "rad"}
    run = record(columns, units=units)
    shown = panels(drawn(plots.trajectory, run, list("abcd"), Scene({})))
    assert [p.y.name for p in shown] == ["a, b", "c", "d"]
    assert [p.y.unit for p in shown] == ["m", "rad", ""]
    curves = [line for p in shown for group in p.lines.values() for line in group]
    for name, (x, y) in zip("abcd", curves, strict=True):
        same(x, T)
        same(y, columns[name])
    for p in shown:
        assert len(set(p.lines)) == len(p.lines)


def energies(**more):
    work = 2e-3 * T
    kinetic, potential = 1 + np.cos(4 * T), 2 - np.cos(4 * T)
    energy = kinetic + potential + work + 1e-9 * np.sin(3 * T) * (T > 0)
    columns = {"t": T, "kinetic": kinetic, "potential": potential, "energy": energy}
    columns["work"] = work
    units = {"t": "s", "energy": "J", "kinetic": "J", "potential": "J", "work": "J"}
    return columns, record(columns, {DRIFT: ("energy", "work")}, units=units, **more)


def test_energies_and_their_drift():
    columns, run = energies()
    drawing = drawn(plots.energy, run)
    upper, lower = panels(drawing)
    assert (upper.y.name, upper.y.unit) == ("energy", "J")
    assert (lower.y.name, lower.y.unit) == ("drift", "J")
    curves = [lines[0] for lines in upper.lines.values()]
    for name, (x, y) in zip(("kinetic", "potential", "energy"), curves, strict=True):
        same(x, T)
        same(y, columns[name])
    [[(x, y)]] = lower.lines.values()
    ledger = columns["energy"] - columns["work"]
    same(x, T)
    same(y, ledger - ledger[0], 1e-9)


def test_legends_name_the_lines_by_their_colours():
    _, run = energies()
    drawing = drawn(plots.energy, run)
    upper, _ = panels(drawing)
    names = ["kinetic T", "potential V", "energy T + V"]
    for name, colour in zip(names, upper.lines, strict=True):
        [text] = [t for t in drawing.texts if t.said == name]
        x, y = text.place
        samples = [
            line.colour
            for line in drawing.samples
            if abs(np.mean(line.y) - y) < 12 and 0 < x - np.max(line.x) < 24
        ]
        assert samples == [colour]


def test_events_and_horizon_stand_at_their_times():
    events = (0.5, 3.25, 11.0)
    _, run = energies(events={"switch": events}, horizon=7.5)
    for panel in panels(drawn(plots.energy, run)):
        assert panel.events == pytest.approx(events, abs=1e-6)
        assert panel.shade == pytest.approx(7.5, abs=1e-6)
    _, run = energies()
    for panel in panels(drawn(plots.energy, run)):
        assert panel.events == []
        assert panel.shade is None


def test_constraint_forces_and_multipliers():
    columns = {"t": T, "Qc_x": 1e4 * np.sin(T), "Qc_y": -3 * T, "lambda_rod": 2 + T}
    run = record(columns, units={"t": "s", "Qc_x": "N", "Qc_y": "N"})
    shown = panels(drawn(plots.constraint_forces, run, ["x", "y"], ["rod"]))
    assert [p.y.name for p in shown] == [
        below("Qc", "x"),
        below("Qc", "y"),
        below("λ", "rod"),
    ]
    assert [p.y.unit for p in shown] == ["N", "N", ""]
    for p, name in zip(shown, list(columns)[1:], strict=True):
        [[(x, y)]] = p.lines.values()
        same(x, T)
        same(y, columns[name])


@pytest.mark.parametrize("shift", [0.0, 5e4, -5e4])
def test_a_plot_of_the_model(shift):
    x, y = shift + np.cos(T), 1e-5 * np.sin(3 * T)
    run = record({"t": T, "plot.0.x": x, "plot.0.y.1": y}, units={"plot.0.x": "m"})
    [panel] = panels(drawn(plots.plot, run, 0, against("2*a", "b^2"), Scene({})))
    assert (panel.x.name, panel.x.unit) == ("2*a", "m")
    assert (panel.y.name, panel.y.unit) == ("b^2", "")
    [[(found_x, found_y)]] = panel.lines.values()
    same(found_x, x, np.ptp(x))
    same(found_y, y)


def test_a_plot_against_time():
    run = record(
        {"t": T, "plot.0.x": T, "plot.0.y.1": T**2},
        units={"t": "s"},
        events={"switch": (2.0,)},
    )
    [panel] = panels(drawn(plots.plot, run, 0, against(" t ", "u"), Scene({})))
    assert (panel.x.name, panel.x.unit) == (" t ", "s")
    [[(x, y)]] = panel.lines.values()
    same(x, T)
    same(y, T**2)
    assert panel.events == pytest.approx([2.0], abs=1e-6)


def test_paths_of_the_scene():
    x, y, z = 5 + np.cos(T), 0.25 * np.sin(T), -1e3 + 0.1 * T
    points = {"point.p.1": x, "point.p.2": y, "point.p.3": z}
    run = record({"t": T, "q": x, **points}, units=dict.fromkeys(points, "m"))
    front, side, top = panels(
        drawn(plots.trajectory, run, ["q"], Scene({"p": (0, 0, 0)}))
    )[1:]
    for panel, across, up, names in (
        (front, x, z, "xz"), (side, y, z, "yz"), (top, x, y, "xy"),
    ):  # fmt: skip
        assert [panel.x.name, panel.y.name] == list(names)
        assert panel.x.unit == panel.y.unit == "m"
        [[(found_x, found_y)]] = panel.lines.values()
        same(found_x, across, np.ptp(across))
        same(found_y, up, np.ptp(up))


def test_notes_say_what_they_are_given():
    _, run = energies(
        note="incomplete: until t = 3", events={"switch": (1.0,)}, horizon=4.0
    )
    for drawing, subject in (
        (drawn(plots.energy, run), "energy"),
        (drawn(plots.trajectory, run, ["kinetic"], Scene({})), "coordinates"),
    ):
        said = drawing.written()
        for text in ("swing", subject, "incomplete: until t = 3", "switches",
                     "past the horizon"):  # fmt: skip
            assert said.count(text) == 1
    _, plain = energies()
    said = drawn(plots.energy, plain).written()
    assert "switches" not in said
    assert "past the horizon" not in said
