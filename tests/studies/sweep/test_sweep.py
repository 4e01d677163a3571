"""A sweep: its values, its picture, and rows equal to rows of single runs."""

import gc
import itertools
import math

import numpy as np
import pytest
from matplotlib.figure import Figure

import lagsim
from lagsim.model.reader import read
from lagsim.run.interrupt import Interrupt
from lagsim.studies.attempts import ErrorBars
from lagsim.studies.sweep import chart as drawing
from lagsim.studies.sweep.batches import Batch
from lagsim.studies.sweep.grid import SweepRows, grid_of, parse_axes
from lagsim.studies.sweep.runs import Runs
from lagsim.studies.sweep.sweeping import sweep
from tests.outputs.drawn import assert_legible, drawn, noted
from tests.small_scenes import (
    CONTACT,
    FALL,
    ON_THE_CURVE,
    PENDULUM,
    ball,
    bounced,
    orbit,
    power,
)
from tests.support import MODELS

GRID = """\
parameters: {l: 2, g: {value: 9.8, unit: m/s^2}, reason: 1}
coordinates: {theta: {unit: rad}}
definitions: {x: {value: l*sin(theta), unit: m}}
energy: {kinetic: l^2*theta_dot^2/2, potential: -g*l*cos(theta)}
initial: {theta: 1, theta_dot: 0}
simulation: {duration: 2, output_step: 0.1}
"""


@pytest.fixture
def model():
    return read(GRID, "<model>")


def test_all_combinations_the_first_name_slowest(model):
    grid = parse_axes(model, ["g=1,2", "theta=0:1:3", "l=5,6"])
    expected = list(itertools.product([1, 2], [0, 0.5, 1], [5, 6]))
    assert grid.runs == 12
    assert [grid.values(k) for k in range(12)] == expected


# A name with its values: numbers, and what Python gives; the values, their unit, and
# whether they are those of a start.
AXES = [
    ("theta=0:1:3", (0, 0.5, 1), "rad", True),
    ("l=5,6", (5, 6), "", False),
    # Between round ends they are round.
    ("g=0:1:11", tuple(k / 10 for k in range(11)), "m/s^2", False),
    ("theta=-pi/2:pi:4", (-math.pi / 2, 0, math.pi / 2, math.pi), "rad", True),
    ("g=atan2(1, 2), 3*l,1e-3", (math.atan2(1, 2), 6, 1e-3), "m/s^2", False),
    ("theta_dot=1,2", (1, 2), "rad/s", True),
    ("x=0.1,0.2", (0.1, 0.2), "m", True),
    ({"g": [1, 2.5, "pi"]}, (1, 2.5, math.pi), "m/s^2", False),
]


@pytest.mark.parametrize(("given", "values", "unit", "starts"), AXES, ids=str)
def test_an_axis(model, given, values, unit, starts):
    grid = (
        grid_of(model, given) if isinstance(given, dict) else parse_axes(model, [given])
    )
    [axis] = grid.axes
    assert (axis.values, axis.unit, axis.starts) == (values, unit, starts)
    # Their texts are what was given, or numbers to the bit.
    if "atan2" in given:
        assert axis.texts == ("atan2(1, 2)", "3*l", "1e-3")
    elif isinstance(given, dict):
        assert axis.texts == ("1.0", "2.5", "pi")
    else:
        assert tuple(map(float, axis.texts)) == values or ":" not in given


# Runs that share what is compiled

# Derived parameters, a start that follows them, `if` in the time and in the state.
SWITCHED = """
parameters: {k: 20, m: 1.5, w: sqrt(k/m), on: 1/w, low: -0.5}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: k*x^2/2 + y^2*x^2 + y^2}
forces: {x: "if(t < on, m, 0) - if(x < low, w*(x - low), 0)", y: -0.1*y_dot}
initial: {x: 1, y: 0.2, x_dot: 0.1*w}
simulation: {}
"""
HELD = """
parameters: {l: 1, g: 9.8, a: 0.3, w: 2*sqrt(g/l)}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: g*y}
constraints: {rod: (x - a*sin(w*t))^2 + y^2 = l^2}
initial: {x: l*sin(0.4), y: {guess: -l}, x_dot: 0.1, y_dot: {guess: 0}}
simulation: {until: y >= 0}
"""
POWER = power("duration: 2")
BOUNCE = "parameters: {e: 0.5}\n" + CONTACT.replace(
    "restitution: 0.5", "restitution: e"
)
CENTRE = orbit("output_step: 0.1, rtol: 1e-9, formulation: full")
# Sparse, with contacts, by impulses, with limits, held velocities.
SCENES = [
    ("coupled-oscillators", {}),
    ("chain-cartesian", {}),
    ("newtons-cradle", {}),
    ("ball-on-a-vibrating-table", {"method": "moreau", "step": 1e-3}),
    ("stick-slip", {"method": "radau"}),
    ("rolling-disk", {}),
    ("pendulum-cartesian", {"formulation": "baumgarte"}),
    ("elastic-pendulum-curve", {"formulation": "elimination"}),
    ("kepler", {"method": "kahan-li8", "step": 0.01}),
    ("forced-oscillator", {"error_bar": "always"}),
    *((SWITCHED, {"name": name, "duration": 2}) for name in ("k", "m", "w")),
    *((HELD, {"name": name, "duration": 2}) for name in ("l", "g")),
    (POWER, {"values": (2, 8, 3, 8), "duration": 2}),
    (BOUNCE, {"values": (0, 0.5, 1), "duration": 2}),
    # Start values: one that the file gives, and one that it leaves at 0.
    *((PENDULUM, {"name": x, "values": (0.5, 1)}) for x in ("theta", "theta_dot")),
]
# Constraints, with a force that follows a swept value; rates that rows hold.
DAMPED = """
parameters: {m: 1.5, zeta: 0.1, c: 2*m*zeta, l: 0.8, b: l/2}
coordinates: {x: {}, y: {}}
energy:
  kinetic: m*(x_dot^2 + y_dot^2)/2
  potential: 9.81*m*y
  dissipation: c*(x_dot^2 + y_dot^2)/2
constraints: {rod: x^2 + y^2 = l^2}
initial: {x: b, y: {guess: -0.7}}
simulation: {duration: 3, output_step: 0.05}
"""
# Of last values alone, by kernels of all kinds, and with many blocks of rows.
ENDS = [
    ("elastic-pendulum", {"rtol": 1e-15, "method": "taylor"}),
    ("elastic-pendulum", {"method": "dop853"}),
    ("kepler", {"rtol": 1e-7, "method": "taylor"}),
    ("kepler", {"method": "verlet", "step": 0.01}),
    ("double-pendulum", {"output_step": 0.001}),
    ("elastic-pendulum-forced", {"method": "radau"}),
    # Without any turn it falls into the centre, by steps of no size.
    (CENTRE, {"name": "phi_dot", "values": (0, 0.2, 1.2), "duration": 3}),
    # A start value that follows, in two processes.
    (CENTRE.replace("phi_dot: 1}", "phi_dot: mu}"), {
        "name": "mu", "values": [0.7 + 0.04 * k for k in range(12)], "jobs": 2,
        "duration": 3,
    }),
    (DAMPED, {"name": "zeta"}),
    ("pendulum-cartesian", {"name": "g", "method": "dop853"}),
]  # fmt: skip


# Runs in batches with their repeats: few rows, an end between rows, blocks of rows,
# measures, methods of all kinds; starts and parameters that follow, first-order states.
LAGGING = """
parameters: {k: 20, m: 1.5, w: sqrt(k/m)}
coordinates: {x: {}}
states: {s: {rate: x - w*s/2}}
energy: {kinetic: m*x_dot^2/2, potential: k*x^2/2}
forces: {x: 0.1*s - 0.2*x_dot}
initial: {x: 1, x_dot: 0.1*w, s: 0.2}
simulation: {duration: 3, output_step: 0.05}
"""
APART_GROUPS = """
parameters: {k: 20, m: 1.5}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: k*(x^2 + y^4)/2}
initial: {x: 1, y: 0.5}
simulation: {output_step: 0.1}
"""
TOGETHER = [
    ("elastic-pendulum", {"rtol": 1e-9}),
    ("elastic-pendulum", {"method": "dop853", "duration": 3.01}),
    ("elastic-pendulum", {"name": "l", "output_step": 0.3}),
    ("elastic-pendulum", {"output_step": 0.003, "error_bar": "always"}),
    ("elastic-pendulum-forced", {"method": "radau", "duration": 2, "from_": "0.5"}),
    ("double-pendulum", {"method": "taylor", "atol": 1e-9}),
    ("kepler", {"error_bar": "never"}),
    ("forced-oscillator", {"output_step": 0.02}),
    (LAGGING, {"duration": 3}),
    (DAMPED, {"name": "zeta"}),
    ("andrews", {"name": "mom", "duration": 0.005, "output_step": 5e-5}),
    ("rolling-disk", {"name": "g", "duration": 1}),
]
# Runs that no batch makes: chaos, energy that is not conserved, rest, groups.
APART = [
    ("double-pendulum", {"rtol": 1e-5, "duration": 25, "output_step": 0.1}),
    ("double-pendulum", {"rtol": 1e-1, "method": "dop853", "output_step": 2}),
    (PENDULUM, {"name": "theta", "values": (0.5, 0, 0), "duration": 2}),
    (APART_GROUPS, {"duration": 2}),
    # Values that change where a constrained motion begins, or its masses.
    *((DAMPED, {"name": x, "duration": 1}) for x in ("l", "b", "m")),
]


def assert_those_of_runs_alone(scene, asked, *, ends=False, bars="never"):
    source = scene if "\n" in scene else str(MODELS / f"{scene}.yaml")
    model = lagsim.load(source)
    usual = {p.name: p.value for p in model.parameters}
    name = asked.pop("name", next(iter(usual)))
    values = asked.pop("values", None) or [usual[name], 1.02 * usual[name]]
    jobs, since = asked.pop("jobs", 1), asked.pop("from_", None)
    asked = {"error_bar": bars} | asked
    if ends:
        asked.pop("error_bar")
    swept = lagsim.sweep(
        model, {name: values}, jobs=jobs, ends=ends, from_=since, **asked
    )
    assert swept.record["compiled"] == 1 or not ends
    for k, value in enumerate(values):
        single = {"error_bar": "never"} | asked
        alone = lagsim.simulate(lagsim.load(source, **{name: repr(value)}), **single)
        assert swept["outcome"][k] == alone.outcome
        error = alone.error.relative if alone.error else math.nan
        assert ends or np.array_equal(swept["error"][k], error, equal_nan=True)
        for column in alone.columns[1:]:
            rows = alone[column]
            own = {"end": rows[-1]}
            if not ends:
                rows = rows[alone.t >= float(since or 0)]
                own |= {"min": np.fmin.reduce(rows), "max": np.fmax.reduce(rows)}
            told = [swept[f"{column}.{x}"][k] for x in own]
            assert np.array_equal(told, list(own.values()), equal_nan=True), column


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "options"), SCENES)
def test_rows_are_those_of_runs_alone(scene, options):
    asked = {"duration": 0.5, "output_step": 0.05, "error_bar": "never"} | options
    assert_those_of_runs_alone(scene, asked)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "options"), ENDS)
def test_ends_are_those_of_runs_alone(scene, options):
    assert_those_of_runs_alone(scene, {"duration": 6} | options, ends=True)


def batched(monkeypatch):
    """Return a list that receives whether each run of a batch was made by it."""
    made, rows = [], Batch.rows

    def counted(self, *arguments):
        found = rows(self, *arguments)
        made.extend(row is not None for row in found)
        return found

    monkeypatch.setattr(Batch, "rows", counted)
    return made


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "options"), TOGETHER)
def test_runs_of_a_batch_are_those_of_runs_alone(scene, options, monkeypatch):
    made = batched(monkeypatch)
    assert_those_of_runs_alone(scene, {"duration": 6} | options, bars="auto")
    assert made == [True]  # the first run shows how the others are made


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "options"), APART)
def test_runs_that_no_batch_makes_are_those_of_runs_alone(scene, options, monkeypatch):
    made = batched(monkeypatch)
    assert_those_of_runs_alone(scene, options, bars="auto")
    assert not any(made)


# Pictures

LONG = PENDULUM.replace("theta", "a" * 40).replace("g:", "b: 1, g:", 1)


def found(text, *arguments, ends=False):
    model = read(text, "<model>")
    result = SweepRows.of(
        model, parse_axes(model, arguments), {}, ErrorBars.NEVER, ends=ends
    )
    sweep(result, 1, requested=False)
    return result


def test_values_are_those_of_complete_runs():
    text = "parameters: {R: 1}\n" + FALL.replace("{r: 1}", "{r: R}")
    result = found(text, "R=1,5,0")  # it falls in; it does not; no start
    cells = drawing.values_of(result, "r")
    assert np.isnan(cells[[0, 2]]).all()
    end, low, high = cells[1]
    assert high == 5.0
    assert low == end < 5.0


def test_maps_have_the_first_names_across_and_up_and_others_in_their_middle():
    result = found(PENDULUM, "g=1,2", "theta=0.1,0.2,0.3", "l=1,2,3,4", "theta_dot=0")
    numbers = drawing.numbers_of(result)
    assert numbers.shape == (2, 3)
    for (i, j), number in np.ndenumerate(numbers):
        assert [place for _, place in result.grid.at(number)] == [i, j, 1, 0]


@pytest.mark.parametrize(
    ("values", "edges"),
    [
        ([1.0, 2.0, 4.0], [0.5, 1.5, 3.0, 5.0]),
        ([3.0], [1.5, 4.5]),
        ([0.1, 1.0, 10.0], [10**-1.5, 10**-0.5, 10**0.5, 10**1.5]),
    ],
)
def test_cells_end_half_way(values, edges):
    assert drawing.borders(np.array(values)) == pytest.approx(edges)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        (PENDULUM, ("g=5:10:3",)),
        (PENDULUM, ("g=1,10,100", "theta=0.1,0.2")),
        (PENDULUM, ("g=1", "theta=0.1", "l=1,2")),
        (ON_THE_CURVE, ("u=0.3,0.4",)),  # no start is admissible
        (ON_THE_CURVE, ("u=0.3,0.4", "K=1,2")),
        (LONG, ("b=1,10,100", f"{'a' * 40}=1,2")),
        (LONG, (f"{'a' * 40}=1,2",)),
    ],
)
def test_every_text_of_every_sweep_lies_on_the_sheet_and_over_no_other(text, arguments):
    seen = drawn(drawing.chart, found(text, *arguments))
    assert seen.sheet.startswith(b"\x89PNG")
    assert_legible(seen)


@pytest.mark.slow
def test_a_start_value_is_called_so_and_ends_are_points():
    result = found(PENDULUM, "theta=0.1,0.3,0.2,0.4")
    with noted() as seen:
        drawing.chart(result)
    assert "θ at the start (rad)" in [panel.labels[0] for panel in seen.panels]
    [ends] = seen.panels[0].lines
    assert ends.dots
    assert len(ends.x) == 4
    assert {"at the end", "from least to greatest"} <= set(seen.written())
    # What is a parameter is no start value.
    with noted() as seen:
        drawing.chart(found(PENDULUM, "g=1,2"))
    assert not any("start" in text for text in seen.written())


@pytest.mark.slow
def test_ends_alone_have_no_greatest():
    for arguments in (("theta=0.1,0.2",), ("theta=0.1,0.2", "g=1,2")):
        result = found(PENDULUM, *arguments, ends=True)
        with noted() as seen:
            drawing.chart(result)
        assert not any("greatest" in text for text in seen.written())
        assert any("at the end" in text for text in seen.written())


@pytest.mark.slow
def test_pictures_of_kept_runs_do_not_pile_up(tmp_path):
    """Each takes megabytes, and commands collect no garbage unasked."""
    model = read(PENDULUM, "m.yaml", {}, {"duration": "0.1"})
    names = [f"{p.name}=1:2:6" for p in model.parameters[:1]]
    grid, options = parse_axes(model, names), {"duration": "0.1"}
    bars = ErrorBars.NEVER
    runs = Runs(
        SweepRows.of(model, grid, options, bars, folder=str(tmp_path), plots=True).work
    )
    gc.collect()
    gc.disable()
    try:
        for number in range(grid.runs):
            assert runs.row(number, Interrupt()) is not None
        left = sum(isinstance(x, Figure) for x in gc.get_objects())
    finally:
        gc.enable()
    drawn = len(list(tmp_path.rglob("*.png")))
    assert left <= drawn / grid.runs < drawn


def test_a_swept_restitution_counts():
    values = [0.5, 0.65, 0.8]
    text = ball("duration: 0.8, output_step: 0.8")
    found = lagsim.sweep(text, {"e": values}, jobs=1, error_bar="never")
    heights = [float(bounced(0.8, e)) for e in values]
    assert found["y.end"] == pytest.approx(heights, abs=1e-11)
