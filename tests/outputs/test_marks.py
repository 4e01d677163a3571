"""Impacts, rest and other events in pictures, and what jumps at them."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.model.model import Scene
from lagsim.notes import Event
from lagsim.outputs import plots
from lagsim.outputs.curves import IMPACTS, MARKS, RESTS
from lagsim.outputs.events import marked
from lagsim.outputs.record import Record
from lagsim.outputs.sheet import DPI
from lagsim.run.observers.thinning import Thinning
from tests.outputs.drawn import drawn

# A ball on a floor, told by hand: falls for a second, rebounds, and lies.
T = np.array([0.0, 0.5, 1.0, 1.0, 1.5, 2.0, 2.0, 3.0, 4.0])
AFTER = np.array([3, 6])
IMPULSES = np.array([6.0, 2.0])
# On paper a pixel is the least that can be told apart.
PIXEL = 1.0


def ball(**more):
    zero = np.zeros_like(T)
    impulse = zero.copy()
    impulse[AFTER] = IMPULSES
    return {
        "t": T,
        "y": np.array([4.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        "kinetic": np.array([0.0, 4.0, 8.0, 2.0, 1.0, 2.0, 0.0, 0.0, 0.0]),
        "energy": np.array([8.0, 8.0, 8.0, 2.0, 2.0, 2.0, 0.0, 0.0, 0.0]),
        "Qc_y": np.where(T >= 3.0, 9.8, zero),
        "Qc_z": zero,
        "lambda_floor": np.where(T >= 3.0, 9.8, zero),
        "lambda_wall": zero,
        "impulse.floor": impulse,
        "impulse.wall": zero,
        **more,
    }


def record(columns=None, **more):
    columns = columns or ball()
    thinning = Thinning(tuple(columns))
    thinning.add(np.stack(list(columns.values()), axis=1))
    return Record("ball", thinning, **more)


def forces(run):
    names = ["floor", "wall"]
    return drawn(plots.constraint_forces, run, ["y", "z"], names)


def against_time(run):
    yield drawn(plots.energy, run, is_sum=True)
    yield drawn(plots.trajectory, run, ["y"], Scene({}))
    yield forces(run)


def places(panel, times):
    """Where times lie, in pixels."""
    low, high = panel.limits[0]
    share = (np.asarray(times) - low) / (high - low)
    return panel.box.x0 + share * panel.box.width


def of_colour(panel, pen):
    return [line for line in panel.lines if line.colour == pen["color"].lower()]


def test_impacts_are_marked_in_every_panel_and_named_once():
    run = record(events={"impact": [1.0, 2.0]})
    for drawing in against_time(run):
        assert drawing.written().count("impacts") == 1
        assert "events" not in drawing.written()
        for panel in drawing.panels:
            [ticks] = of_colour(panel, IMPACTS)
            assert ticks.x == pytest.approx(places(panel, [1.0, 2.0]), abs=PIXEL)


@pytest.mark.parametrize("count", [2, 50, 1000, 10_000])
def test_however_many_impacts_leave_the_curves_free(count):
    times = np.linspace(0.5, 3.5, count)
    for drawing in against_time(record(events={"impact": list(times)})):
        for panel in drawing.panels:
            [ticks] = of_colour(panel, IMPACTS)
            assert ticks.dots
            # At most one at each pixel, none far from where there is an impact.
            assert len(ticks.x) <= min(count, panel.box.width)
            shown = places(panel, times)
            apart = np.abs(shown[:, np.newaxis] - ticks.x).min(axis=1)
            assert np.max(apart) <= PIXEL
            half = IMPACTS["markersize"] / 144 * DPI
            assert np.all(ticks.y + half <= panel.box.y1 + PIXEL)
            assert np.all(ticks.y - half >= panel.box.y1 - 0.1 * DPI)


def test_rest_is_a_line_across():
    for drawing in against_time(record(events={"impact": [1.0], "zeno": [2.0]})):
        assert drawing.written().count("comes to rest") == 1
        for panel in drawing.panels:
            thin = [line for line in panel.thin if line.colour == RESTS["color"]]
            [line] = thin
            assert line.x[:2] == pytest.approx(places(panel, [2.0, 2.0]), abs=PIXEL)
            assert sorted(line.y[:2]) == pytest.approx(
                [panel.box.y0, panel.box.y1], abs=PIXEL
            )


def test_two_rows_at_one_time_are_a_jump():
    panel = drawn(plots.energy, record(), is_sum=True).panels[0]
    [line] = of_colour(panel, {"color": "#000000"})
    jumps = np.flatnonzero(np.diff(T) == 0.0)
    assert len(jumps) == 2
    assert np.all(line.x[jumps] == line.x[jumps + 1])
    assert np.all(line.y[jumps] > line.y[jumps + 1])


def test_jumps_are_upright_in_bands_too():
    # A square wave so fast that its strokes cover most of the panel: seen as a band.
    t = (4 * np.arange(300)[:, np.newaxis] + np.arange(5)).ravel() / 1200
    y = np.repeat(np.arange(300) % 2, 5).astype(float)
    run = record({"t": t, "y": y})
    panel = drawn(plots.trajectory, run, ["y"], Scene({})).panels[0]
    [(_, corners)] = panel.areas
    steps = np.diff(corners, axis=0)
    upright = np.abs(steps[:, 1]) > 0.5 * panel.box.height
    assert np.count_nonzero(upright) > 300
    assert np.all(np.abs(steps[upright, 0]) < PIXEL)


def test_impulses_are_stems_and_what_is_zero_gives_way():
    drawing = forces(record(events={"impact": [1.0, 2.0]}))
    labels = [side or above for _, side, above in (p.labels for p in drawing.panels)]
    assert labels == ["Qc_y", "λ_floor", "impulse.floor"]
    assert "constraint forces and impulses, 3 of 5" in drawing.written()
    panel = drawing.panels[2]
    low, high = panel.limits[1]
    lines = [line for line in panel.lines if line.colour == "#0072b2"]
    stems = next(line for line in lines if np.isnan(line.x).any())
    assert stems.x[::3] == pytest.approx(places(panel, T[AFTER]), abs=PIXEL)
    tops = low + (stems.y[1::3] - panel.box.y0) / panel.box.height * (high - low)
    assert tops == pytest.approx(IMPULSES, rel=1e-3)
    # No slope from one impact to the next row.
    assert all(len(line.x) != len(T) for line in lines)


def test_without_impulses_all_forces_are_shown():
    columns = {k: v for k, v in ball().items() if not k.startswith("impulse.")}
    drawing = forces(record(columns))
    assert len(drawing.panels) == 4
    assert "constraint forces Qc and multipliers λ" in drawing.written()


def test_friction_is_among_the_multipliers():
    columns = ball(**{"friction.floor": np.sin(T)})
    labels = [p.labels[1] or p.labels[2] for p in forces(record(columns)).panels]
    assert labels == ["Qc_y", "λ_floor", "friction.floor", "impulse.floor"]


def test_a_path_along_an_axis_is_a_line_however_often_it_is_gone():
    t = np.linspace(0.0, 40.0, 4000)
    height = np.abs(np.sin(t))
    columns = {"t": t, "y": height, "point.b.1": 0.0 * t, "point.b.2": height}
    drawing = drawn(plots.trajectory, record(columns), ["y"], Scene({"b": (0, 0)}))
    paths = [line for line in drawing.panels[1].lines if len(line.x) == len(t)]
    assert [line.dots for line in paths] == [False]


def test_what_is_marked():
    events = [
        Event(1.0, "impact", "a"),
        Event(1.0, "impact", "b"),
        Event(1.0, "release", "a"),
        Event(2.0, "impact"),
        Event(3.0, "zeno", "a"),
        Event(3.5, "zeno", switch="sign(v)"),
        Event(4.0, "release", "b"),
        Event(5.0, "until"),
    ]
    assert marked(events) == {
        "impact": [1.0, 2.0], "zeno": [3.0], "switch": [3.5], "release": [4.0],
    }  # fmt: skip


def test_kinds_of_events_are_told_apart_and_named():
    """By a mark at the top of each: filled where something holds from then on."""
    times = {"stick": [1.0, 3.0], "slip": [2.0], "release": [2.5], "switch": [3.5]}
    for drawing in against_time(record(events=times)):
        said = drawing.written()
        assert {"sticks", "slips", "lets go", "switches"} <= set(said)
        assert "impacts" not in said
        for panel in drawing.panels:
            looks = {}
            for kind, own in times.items():
                top = MARKS[kind].top
                if top is None:
                    continue
                [found] = [
                    line
                    for line in panel.lines
                    if line.marker == top["marker"] and len(line.x) == len(own)
                    and line.x == pytest.approx(places(panel, own), abs=PIXEL)
                ]  # fmt: skip
                looks[kind] = (found.marker, top["markerfacecolor"])
                assert np.all(found.y > panel.box.y1 - 0.1 * DPI)
            assert len(set(looks.values())) == len(looks)
    # More names than fit beside the title have a line of their own.
    texts = {text.said: text.box for text in drawing.texts}
    assert texts["sticks"].y1 < texts["ball"].y0


def test_fast_swings_are_the_band_that_they_fill():
    """Of a steady amplitude: level, without a pattern of pixels and turns."""
    t = np.linspace(0.0, 1.0, 40_000)
    for swings in (150, 333, 999):
        run = record({"t": t, "y": np.sin(2 * np.pi * swings * t)})
        panel = drawn(plots.trajectory, run, ["y"], Scene({})).panels[0]
        [(_, corners)] = panel.areas
        top = corners[corners[:, 1] > panel.box.y0 + 0.5 * panel.box.height]
        assert np.ptp(top[:, 1]) < 0.02 * panel.box.height
