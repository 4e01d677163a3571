"""Impacts, rest and other events in pictures, and jumps of columns there."""

from itertools import groupby

import numpy as np
import pytest

from lagsim import simulate
from lagsim.model.model import Scene
from lagsim.model.reader import read
from lagsim.notes import Event
from lagsim.outputs import plots
from lagsim.outputs.figure import DPI, LOST, MARKS, TICKS_APART
from lagsim.outputs.plot_data import PlotData, marked
from lagsim.run.observers.thinning import Thinning
from tests.outputs import drawn as kit
from tests.outputs.drawn import below, coordinates, drawn

IMPACTS = MARKS["impact"].top

# A ball on a floor, told by hand: falls for a second, rebounds, and lies.
T = np.array([0.0, 0.5, 1.0, 1.0, 1.5, 2.0, 2.0, 3.0, 4.0])
AFTER = np.array([3, 6])
IMPULSES = np.array([6.0, 2.0])
HEIGHT = np.array([4.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
# On paper a pixel is the least that can be told apart.
PIXEL = 1.0


def ball(**more):
    zero = np.zeros_like(T)
    impulse = zero.copy()
    impulse[AFTER] = IMPULSES
    return {
        "t": T,
        "y": HEIGHT,
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


def record(columns=None, **fields):
    return kit.record(columns or ball(), title="ball", **fields)


def forces(run, names=("y", "z"), constraints=("floor", "wall")):
    return drawn(plots.constraint_forces, run, names, constraints)


def against_time(run):
    yield drawn(plots.energy, run)
    yield drawn(plots.trajectory, run, ["y"], Scene({}))
    yield forces(run)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 50, 1000, 10_000])
def test_impacts_are_marked_in_every_panel_named_once_and_leave_the_curves_free(count):
    times = np.linspace(0.5, 3.5, count)
    for drawing in against_time(record(events={"impact": list(times)})):
        assert drawing.written().count("impact") == 1
        assert "event" not in drawing.written()
        for panel in drawing.panels:
            [ticks] = panel.of_colour(IMPACTS["color"])
            assert ticks.dots
            assert len(ticks.x) <= min(count, panel.box.width)
            # Each is where an impact is, and near each impact is one.
            apart = np.abs(panel.at(times)[:, np.newaxis] - ticks.x)
            assert np.max(apart.min(axis=0)) <= PIXEL
            assert np.max(apart.min(axis=1)) <= TICKS_APART / 72 * DPI
            half = IMPACTS["markersize"] / 144 * DPI
            assert np.all(ticks.y + half <= panel.box.y1 + PIXEL)
            assert np.all(ticks.y - half >= panel.box.y1 - 0.1 * DPI)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["zeno", "slip", "switch", "unheard of"])
def test_marks_are_short_ticks_that_do_not_touch(kind):
    plain = drawn(plots.energy, record()).panels[0]
    for count in (1, 300):
        run = record(events={kind: list(np.linspace(1.0, 3.9, count))})
        panel = drawn(plots.energy, run).panels[0]
        # No line across: what is thin is what is thin without events.
        assert len(panel.thin) == len(plain.thin)
        [ticks] = panel.lines[: len(panel.lines) - len(plain.lines)]
        assert ticks.dots
        assert np.all(ticks.y > panel.box.y1 - 0.1 * DPI)
        # Points: what is broader than a stroke is more than 3 of them.
        least = 2.0 if ticks.marker == "|" else 4.0
        assert np.all(np.diff(ticks.x) > least / 72 * DPI - PIXEL)
        assert len(ticks.x) >= min(count, 30)


@pytest.mark.slow
def test_kinds_of_events_are_told_apart_and_named():
    """By a mark at the top of each: filled where something holds from then on."""
    times = {"stick": [1.0, 3.0], "slip": [2.0], "release": [2.5], "switch": [3.5]}
    for drawing in against_time(record(events=times)):
        said = drawing.written()
        assert set(times) <= set(said)
        assert "impact" not in said
        for panel in drawing.panels:
            looks = set()
            for kind, own in times.items():
                top = MARKS[kind].top
                [found] = [
                    line
                    for line in panel.lines
                    if line.marker == top["marker"] and len(line.x) == len(own)
                    and line.x == pytest.approx(panel.at(own), abs=PIXEL)
                ]  # fmt: skip
                looks.add((found.marker, top["markerfacecolor"]))
                assert np.all(found.y > panel.box.y1 - 0.1 * DPI)
            assert len(looks) == len(times)
    # More names than fit beside the title have a line of their own.
    texts = {text.said: text.box for text in drawing.texts}
    assert texts["stick"].y1 < texts[drawing.title].y0


def test_what_is_marked():
    events = [
        Event(1.0, "impact", "a"), Event(1.0, "impact", "b"), Event(2.0, "impact"),
        Event(1.0, "release", "a"), Event(3.0, "zeno", "a"), Event(5.0, "until"),
        Event(3.5, "zeno", switch="sign(v)"), Event(4.0, "release", "b"),
    ]  # fmt: skip
    assert marked(events) == {
        "impact": [1.0, 2.0], "zeno": [3.0], "switch": [3.5], "release": [4.0],
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("wanted", [True, False])
def test_marks_can_be_switched_off(wanted, tmp_path, monkeypatch):
    text = """\
coordinates: {x: }
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
forces: {x: -sign(x_dot)}
initial: {x: 2}
simulation: {duration: 9}
output: {event_marks: %s}
"""
    records = []
    monkeypatch.setattr(plots, "pictures", lambda run, *_: records.append(run) or ())
    result = simulate(read(text % str(wanted).lower(), "block.yaml"))
    result.write(tmp_path)
    [run] = records
    assert {e.kind for e in result.events} == {"switch", "stick"}
    assert set(run.events) == ({"switch", "stick"} if wanted else set())


# --- Jumps and impulses


@pytest.mark.slow
def test_two_rows_at_one_time_are_a_jump():
    [line] = drawn(plots.energy, record()).panels[0].of_colour("#000000")
    jumps = np.flatnonzero(np.diff(T) == 0.0)
    assert len(jumps) == 2
    assert np.all(line.x[jumps] == line.x[jumps + 1])
    assert np.all(line.y[jumps] > line.y[jumps + 1])


def test_jumps_are_upright_in_bands_too():
    # A square wave so fast that its strokes cover most of the panel: seen as a band.
    t = (4 * np.arange(300)[:, np.newaxis] + np.arange(5)).ravel() / 1200
    y = np.repeat(np.arange(300) % 2, 5).astype(float)
    [panel] = coordinates({"t": t, "y": y}, ["y"]).panels
    [(_, corners)] = panel.areas
    steps = np.diff(corners, axis=0)
    upright = np.abs(steps[:, 1]) > 0.5 * panel.box.height
    assert np.count_nonzero(upright) > 300
    assert np.all(np.abs(steps[upright, 0]) < PIXEL)


@pytest.mark.slow
def test_impulses_are_stems():
    panel = forces(record(events={"impact": [1.0, 2.0]})).panels[2]
    low, high = panel.limits[1]
    lines = panel.of_colour("#0072b2")
    stems = next(line for line in lines if np.isnan(line.x).any())
    assert stems.x[::3] == pytest.approx(panel.at(T[AFTER]), abs=PIXEL)
    tops = low + (stems.y[1::3] - panel.box.y0) / panel.box.height * (high - low)
    assert tops == pytest.approx(IMPULSES, rel=1e-3)
    # No slope from one impact to the next row.
    assert all(len(line.x) != len(T) for line in lines)


QC, LAMBDA = below("Qc", "y"), below("λ", "floor")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("impulses", "more", "labels", "said"),
    [
        (True, {}, [QC, LAMBDA, "impulse.floor"],
         "constraint forces and impulses; 3 more are 0"),
        # Beside another force of its unit it is rounding.
        (False, {"lambda_wall": 1e-16 * HEIGHT}, [QC, LAMBDA],
         "constraint forces Qc and multipliers λ; 2 more are 0"),
        (True, {"friction.floor": np.sin(T)},
         [QC, LAMBDA, "friction.floor", "impulse.floor"],
         "constraint forces and impulses; 3 more are 0"),
    ],
    ids=["impulses", "forces", "friction"],
)  # fmt: skip
def test_what_is_zero_gives_way(impulses, more, labels, said):
    columns = {k: v for k, v in ball(**more).items() if impulses or k[:2] != "im"}
    drawing = forces(record(columns))
    assert [panel.name for panel in drawing.panels] == labels
    assert drawing.title == f"ball: {said}"


@pytest.mark.slow
def test_forces_on_a_body_stand_side_by_side_and_are_named_in_one_place():
    names = ["x1", "y1", "th1", "x2", "y2", "th2", "x3", "y3"]
    columns = {"t": T} | {f"Qc_{n}": 1.0 + k + T for k, n in enumerate(names)}
    columns["lambda_a_long_name"] = 1.0 + T
    panels = forces(record(columns), names, ["a_long_name"]).panels
    assert [panel.labels[1] for panel in panels] == [""] * (len(names) + 1)
    places = {panel.name: (panel.box.x0, panel.box.y0) for panel in panels}
    for k in "123":
        (left, one), (right, other) = (places[below("Qc", f"{x}{k}")] for x in "xy")
        assert left < right
        assert one == other


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bodies", "rods"),
    [
        (3, 3),
        *(
            pytest.param(*n, marks=pytest.mark.slow)
            for n in ((5, 5), (8, 8), (10, 10), (12, 3))
        ),
    ],
)
def test_pairs_leave_no_place_free_before_the_last(bodies, rods):
    names = [f"{axis}{k}" for k in range(bodies) for axis in "xy"]
    links = [f"rod{k}" for k in range(rods)]
    columns = [*(f"Qc_{n}" for n in names), *(f"lambda_{n}" for n in links)]
    columns = {"t": T} | {n: 1.0 + k + T for k, n in enumerate(columns)}
    panels = forces(record(columns), names, links).panels
    rows = [len([*row]) for _, row in groupby(panels, lambda panel: panel.box.y0)]
    assert len(panels) == 2 * bodies + rods
    assert len({*rows[:-1]}) == 1


# --- States at events, which are no rows


def with_corners(columns, times):
    """Show the states at these times, too, just before and just after each."""
    columns = {"t": T, **columns}
    thinning = Thinning(tuple(columns))
    thinning.add(np.stack(list(columns.values()), axis=1))
    rows = np.array([[np.interp(t, T, x) for x in columns.values()] for t in times])
    thinning.meet(np.repeat(rows, 2, axis=0)[:, np.newaxis])
    return thinning


@pytest.mark.slow
@pytest.mark.parametrize("horizon", [np.inf, 100.0, 4.0])
def test_nothing_is_pale_before_the_horizon(horizon):
    """Paths pass through states at events, which are no rows; they are trusted too."""
    columns, events = {"y": HEIGHT, "point.b.1": HEIGHT, "point.b.2": HEIGHT}, 4
    rows = with_corners(columns, [0.7, 1.2, 1.7, 2.5])
    run = PlotData("ball", rows, horizon=horizon)
    assert run.trusted() == len(T) + 2 * events
    drawing = drawn(plots.trajectory, run, ["y"], Scene({"b": (0, 0)}))
    assert not any(panel.of_colour(LOST) for panel in drawing.panels)


def test_what_lies_past_the_horizon_is_counted_with_states_at_events():
    rows = with_corners({"y": HEIGHT, "point.b.1": T, "point.b.2": T}, [0.7, 2.5])
    # Seven rows up to t = 2, and the states before and after the event at 0.7.
    assert PlotData("ball", rows, horizon=2.2).trusted() == 9
