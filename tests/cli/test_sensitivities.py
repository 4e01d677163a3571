"""Columns of sensitivities and standard deviations, in the files and in Python."""

import json

import numpy as np
import pytest

import lagsim as in_python
from lagsim.errors import InputError
from lagsim.model.reader import read
from tests.support import refused

BALL = """
name: ball
parameters:
  e: {value: 0.8, uncertainty: 0.01}
  g: 9.81
  h: {value: 1, unit: m, uncertainty: 0.02}
coordinates: {y: {unit: m}}
energy: {kinetic: y_dot^2/2, potential: g*y}
constraints: {floor: {relation: y >= 0, restitution: e}}
initial: {y: h}
output: {sensitivities: [h]}
simulation: {duration: 0.6, output_step: 0.05}
"""
OSCILLATOR = """
name: oscillator
parameters: {k: 4}
coordinates: {x: {}}
definitions: {double: 2*x}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
initial: {x: 1}
simulation: {duration: 1, output_step: 0.25}
"""


def table(path):
    lines = path.read_text().splitlines()
    rows = [[float(x) if x else np.nan for x in line.split(",")] for line in lines[1:]]
    return dict(zip(lines[0].split(","), np.array(rows).T, strict=True))


def test_the_option_adds_columns_of_closed_form(lagsim, tmp_path):
    (tmp_path / "o.yaml").write_text(OSCILLATOR)
    lagsim("run", "o.yaml", "--sensitivities", "k, x_dot", "--no-plots", code=0)
    rows = table(tmp_path / "results" / "oscillator" / "trajectory.csv")
    t = rows["t"]
    # The closed form; errors of the method are below 1e-12.
    assert rows["d.x.k"] == pytest.approx(-t * np.sin(2 * t) / 4, abs=1e-11)
    assert rows["d.double.x_dot"] == pytest.approx(np.sin(2 * t), abs=1e-11)
    document = json.loads((tmp_path / "results/oscillator/run.json").read_text())
    assert {*document["sensitivities"]} == {"k", "x_dot"}
    assert {*document["sensitivities"]["k"]} == {"step", "error", "runs"}
    assert document["columns"]["d.x_dot.k"] == ""


def test_values_set_on_the_command_line_count(lagsim, tmp_path):
    (tmp_path / "o.yaml").write_text(OSCILLATOR)
    line = "run", "o.yaml", "--sensitivities", "k", "--set", "k=9", "--duration", "2"
    lagsim(*line, "--no-plots", code=0)
    rows = table(tmp_path / "results" / "oscillator" / "trajectory.csv")
    t = rows["t"]
    assert t[-1] == 2.0
    assert rows["d.x.k"] == pytest.approx(-t * np.sin(3 * t) / 6, abs=1e-11)


@pytest.mark.slow
def test_deviations_combine_and_rows_of_impacts_are_empty(lagsim, tmp_path):
    (tmp_path / "ball.yaml").write_text(BALL)
    lagsim("run", "ball.yaml", "--no-plots", "--units", code=0)
    folder = tmp_path / "results" / "ball"
    lines = (folder / "trajectory.csv").read_text().splitlines()
    heads, units = (line.split(",") for line in lines[:2])
    assert dict(zip(heads, units, strict=True))["d.y_dot.h"] == "1/s"
    assert dict(zip(heads, units, strict=True))["sd.y"] == "m"
    (folder / "trajectory.csv").write_text("\n".join([lines[0], *lines[2:]]))
    rows = table(folder / "trajectory.csv")
    assert "d.y.e" not in rows
    t = rows["t"]
    hit = np.sqrt(2 / 9.81)
    before, after = t < hit - 1e-9, t > hit + 1e-9
    # Before the impact the height of the fall shifts the ball; afterwards
    # y = e v d - g d^2/2 with v = sqrt(2 g h) and d = t - sqrt(2 h/g).
    assert rows["d.y.h"][before] == pytest.approx(np.ones(before.sum()), abs=1e-11)
    assert rows["sd.y"][before] == pytest.approx(
        0.02 * np.ones(before.sum()), abs=1e-12
    )
    v, d, slow = np.sqrt(2 * 9.81), t[after] - hit, 1 / np.sqrt(2 * 9.81)
    by_h = 0.8 * (9.81 / v) * d - (0.8 * v - 9.81 * d) * slow
    by_e = v * d
    assert rows["d.y.h"][after] == pytest.approx(by_h, abs=1e-10)
    deviation = np.hypot(0.02 * by_h, 0.01 * by_e)
    assert rows["sd.y"][after] == pytest.approx(deviation, abs=1e-11)
    assert np.isnan(rows["d.y.h"][~before & ~after]).all()
    assert not json.loads((folder / "run.json").read_text())["warnings"]
    assert lagsim("compare", str(folder), str(folder)).code == 0


@pytest.mark.slow
def test_rows_that_an_event_crosses_are_empty_with_a_warning(lagsim, tmp_path):
    text = BALL.replace("g: 9.81", "g: 8").replace("value: 1,", "value: 0.25,")
    (tmp_path / "ball.yaml").write_text(text)
    lagsim("run", "ball.yaml", "--sensitivities", "e", "--no-plots", code=0)
    document = json.loads((tmp_path / "results/ball/run.json").read_text())
    rows = table(tmp_path / "results/ball/trajectory.csv")
    # The speed before the impact does not depend on the restitution, that after does.
    [first, second] = np.flatnonzero(rows["t"] == 0.25)
    assert np.isnan(rows["d.y_dot.e"][[first, second]]).all()
    assert np.isfinite(rows["d.y_dot.e"][[first - 1, second + 1]]).all()
    # A row lies at the impact, whose time depends on the height alone.
    [warning] = document["warnings"]
    assert warning["code"] == "not-differentiable"
    assert "`h`" in warning["text"]


@pytest.mark.parametrize("form", ["npz", "parquet"])
def test_other_tables_have_them(lagsim, tmp_path, form):
    if form == "parquet":
        pytest.importorskip("pyarrow")
    (tmp_path / "o.yaml").write_text(OSCILLATOR)
    options = "--sensitivities", "k", "--table", form
    lagsim("run", "o.yaml", *options, "--no-plots", code=0)
    folder = tmp_path / "results" / "oscillator"
    assert lagsim("compare", str(folder), str(folder)).code == 0


def test_in_python():
    text = OSCILLATOR + "output: {sensitivities: [k]}\n"
    result = in_python.simulate(text)
    t = result["t"]
    assert result["d.x.k"] == pytest.approx(-t * np.sin(2 * t) / 4, abs=1e-11)
    assert result.record["sensitivities"]["k"]["runs"] == 8


@pytest.mark.slow
def test_at_any_time_they_have_their_closed_form():
    text = OSCILLATOR + "output: {sensitivities: [k]}\n"
    text = text.replace("k: 4", "k: {value: 4, uncertainty: 0.1}")
    result = in_python.simulate(text, error_bar="never")
    exact = -0.3333 * np.sin(2 * 0.3333) / 4
    one = result.at(0.3333)
    assert one["d.x.k"] == pytest.approx(exact, abs=1e-11)
    assert one["sd.x"] == pytest.approx(0.1 * abs(exact), abs=1e-12)
    assert [*one] == [*result.columns]
    times = np.array([[0.7, 0.3333], [0.0, 0.9]])
    several = result.at(times)
    exact = -times * np.sin(2 * times) / 4
    assert several["d.x.k"] == pytest.approx(exact, abs=1e-11)
    # Without requested columns there are none.
    assert "d.x.k" not in in_python.simulate(OSCILLATOR).at(0.3)


@pytest.mark.slow
def test_at_the_time_of_an_impact_they_are_not_a_number():
    result = in_python.simulate(BALL, error_bar="never")
    hit = np.sqrt(2 / 9.81)
    found = result.at([hit - 0.01, hit, 0.3])
    assert np.isnan(found["sd.y"]).tolist() == [False, True, False]
    assert found["sd.y"][2] == pytest.approx(0.02, abs=1e-11)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (("[h]", "[hh]"), "unknown-name"),
        (("[h]", "h"), "not-a-list"),
        (("uncertainty: 0.02", "uncertainty: -1"), "out-of-range"),
        (("uncertainty: 0.02", "uncertainty: q"), "unknown-name"),
        (("uncertainty: 0.02", "uncertain: 1"), "unknown-key"),
    ],
)
def test_faults_have_their_place(change, code):
    with pytest.raises(InputError) as found:
        read(BALL.replace(*change), "<model>")
    [problem] = found.value.problems
    assert problem.code == code
    assert problem.place.line > 0


def test_a_definition_has_no_uncertainty():
    text = OSCILLATOR.replace("double: 2*x", "double: {value: 2*x, uncertainty: 1}")
    with refused("unknown-key", "`uncertainty`"):
        read(text, "<model>")


def test_an_unknown_name_of_the_option(lagsim, tmp_path):
    (tmp_path / "o.yaml").write_text(OSCILLATOR)
    called = lagsim("run", "o.yaml", "--sensitivities", "kk", code=2)
    assert "`kk`" in called.err
    assert not (tmp_path / "results" / "oscillator" / "trajectory.csv").exists()
