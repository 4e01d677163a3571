"""Pictures of rows that no curve can be drawn of: huge, tiny, missing, in one place."""

import numpy as np
import pytest

from lagsim.model.model import DrawnExpression, Scene
from lagsim.outputs import plots
from lagsim.outputs.figure import DPI, WIDTH, encoded_figure
from lagsim.run.observers.thinning import DRIFT
from tests.outputs.drawn import against, coordinates, record

LINE = np.linspace(0.0, 1.0, 9)
# What a column may be: by name, at nine times.
COLUMNS = {
    "zero": 0.0 * LINE,
    "constant": np.full(9, 3.0),
    "largest": np.full(9, 1.7e308),
    "smallest": np.full(9, 5e-324),
    "grows to the largest": LINE * 1.7e308,
    "grows to nothing": LINE * 1e-310,
    "jumps across all": np.where(LINE > 0.5, 1.7e308, -1.7e308),
    "explodes": np.exp(700.0 * LINE),
    "dies": np.exp(-740.0 * LINE),
    "nan": np.full(9, np.nan),
    "inf": np.full(9, np.inf),
    "ends in inf": np.where(LINE > 0.5, np.inf, LINE),
    "one value": np.where(LINE == 0.5, 1e300, np.nan),
    "one spike": np.where(LINE == 0.5, 5e-324, 0.0),
    "rounding": 1.0 + 1e-16 * LINE,
}
TIMES = {
    "ten seconds": 10.0 * LINE,
    "no time": 0.0 * LINE,
    "in pairs": np.repeat(LINE[:5], 2)[:9],
    "eons": 1e300 * LINE,
    "no time to speak of": 1e-320 * LINE,
    "far away": 1e15 + LINE,
}
NAMES = (
    "a", "kinetic", "potential", "energy", DRIFT, "Qc_a", "lambda_r", "impulse.r",
    "point.p.1", "point.p.2", "point.q.1", "point.q.2",
    "plot:0.x", "plot:0.y.1", "plot:0.y2.1",
)  # fmt: skip
PLANE = Scene({"p": (0, 0), "q": (0, 0)}, (("p", "q"),))


def draw_all(t, values, **fields):
    """Draw every picture; a curve against time and one against another, and powers."""
    known = record({"t": t} | dict.fromkeys(NAMES, values), **fields)
    sheets = [
        plots.energy(known),
        plots.trajectory(known, ["a"], PLANE),
        plots.constraint_forces(known, ["a"], ["r"]),
    ]
    for x, log in (("t", ()), ("a", ()), ("a", ("x", "y", "y2"))):
        wanted = against(x, "a", y2=(DrawnExpression(0, "a"),), log=frozenset(log))
        sheets.append(plots.plot(known, 0, wanted, PLANE))
    for sheet in sheets:
        assert encoded_figure(sheet).startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize("name", COLUMNS)
def test_columns(name):
    events = {"impact": [0.0, 5.0, 1e300]}
    draw_all(10.0 * LINE, COLUMNS[name], horizon=5.0, events=events)


@pytest.mark.slow
@pytest.mark.parametrize("name", TIMES)
def test_times(name):
    t = TIMES[name]
    draw_all(t, LINE, horizon=float(t[4]), events={"switch": list(t)})


@pytest.mark.slow
@pytest.mark.parametrize(
    "value", [-1e300, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.0, np.nan))]
)
def test_one_row(value):
    draw_all([value], [value])


@pytest.mark.slow
@pytest.mark.parametrize("moving", range(3))
@pytest.mark.parametrize("size", [1.0, 1e290])
def test_views_in_space_stay_on_the_sheet_whatever_moves(moving, size):
    """A motion along one axis leaves the other views their least length."""
    columns = {"t": LINE, "a": 0.0} | {f"point.p.{k + 1}": 0.0 for k in range(3)}
    columns[f"point.p.{moving + 1}"] = size * LINE
    for panel in coordinates(columns, ["a"], Scene({"p": (0, 0, 0)})).panels:
        assert panel.box.y0 > 0.0
        assert panel.box.x1 < WIDTH * DPI
        assert min(panel.box.width, panel.box.height) >= 0.9 * DPI - 1.0


@pytest.mark.parametrize("place", [0.0, -1e290])
@pytest.mark.parametrize("dimension", [2, 3])
def test_all_points_at_rest_in_one_place(place, dimension):
    points = [f"point.{p}.{k + 1}" for p in "pq" for k in range(dimension)]
    columns = {"t": LINE} | dict.fromkeys(["a", *points], place)
    scene = Scene({"p": (0,) * dimension, "q": (0,) * dimension}, (("p", "q"),))
    assert coordinates(columns, ["a"], scene).panels
