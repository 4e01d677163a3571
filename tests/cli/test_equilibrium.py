"""`lagsim equilibrium`: files, options, and the model file that it writes."""

import csv
import json
from pathlib import Path

import pytest

from tests.studies.test_rest import DOUBLE, TRUSS

CHAIN = """\
# A chain of masses that hangs.
name: hanging
parameters: {n: 3, k: 100, m: {value: 1, unit: kg}, g: 10}   # SI
coordinates: {q(1..n): {unit: m}, r: {components: xy}}
definitions: {x(0): 0, x(i = 1..n): q(i), last: q(n)}
energy:
  kinetic: sum(i = 1..n, m*q_dot(i)^2/2) + dot(r_dot, r_dot)
  potential: sum(i = 1..n, k*(x(i) - x(i-1))^2/2 - m*g*x(i)) + dot(r, r) - r.x
initial:
  q(1..n): 0.1      # all
  q(3): {guess: 0}  # but the last
  r: [1, 2]
  r_dot: [3, 0]
"""


@pytest.mark.drawn
@pytest.mark.slow
def test_files_and_summary(lagsim, write):
    called = lagsim("equilibrium", write("name: double\n" + DOUBLE), code=0, err="")
    assert called.out.startswith("double: 4 positions of rest\n")
    folder = Path("results/double/equilibrium")
    document = json.loads((folder / "equilibrium.json").read_text())
    assert document["files"] == [
        "equilibrium.csv", "equilibrium.png", "equilibrium.json",
    ]  # fmt: skip
    with (folder / "equilibrium.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:4] == ["equilibrium", "a", "b", "x1"]
    assert len(rows) == 4
    assert float(rows[1][1]) == document["equilibria"][1]["coordinates"]["a"]


@pytest.mark.slow
def test_json_is_one_document(lagsim, write):
    path = write("name: truss\n" + TRUSS)
    document = lagsim("equilibrium", path, "--json", "--no-plots", code=0).json
    assert set(document["equilibria"][0]) == {
        "coordinates", "definitions", "lambda", "energy", "stable", "reason",
        "eigenvalues", "distance", "from_start", "free", "continuum",
    }  # fmt: skip
    assert document["starts"] == 20
    assert [x["from_start"] for x in document["equilibria"]].count(True) == 1
    distances = [x["distance"] for x in document["equilibria"]]
    assert distances == sorted(distances)


@pytest.mark.slow
def test_the_model_file_is_written_with_its_comments(lagsim, write):
    path = write(CHAIN)
    options = "--write", "rest.yaml", "--no-plots", "-q", "--set", "m=2"
    lagsim("equilibrium", path, *options, code=0, out="")
    text = Path("rest.yaml").read_text()
    kept = CHAIN.replace("value: 1,", "value: 2,").splitlines()
    new = text.splitlines()
    same = [k for k in range(len(kept)) if kept[k] == new[k]]
    assert same == [*range(9)]
    assert new[9].endswith("]      # all")
    assert new[10].endswith("}  # but the last")
    assert new[12] == "  r_dot: [0, 0]"
    document = lagsim("equilibrium", "rest.yaml", "--json", "--no-plots").json
    first = document["equilibria"][0]
    assert first["distance"] < 1e-12
    # A mass of 2 kg below each spring: 0.6, 1.0, 1.2 m.
    found = first["coordinates"]
    assert [found[f"q.{k}"] for k in (1, 2, 3)] == pytest.approx([0.6, 1.0, 1.2])
    assert found["r.x"] == pytest.approx(0.5)


def test_a_negative_number_of_starts_is_refused(lagsim, write):
    called = lagsim("equilibrium", write(CHAIN), "--starts", "-1", code=2)
    assert "--starts" in called.err


@pytest.mark.slow
def test_branches_are_written(lagsim, write):
    path = write("name: truss\n" + TRUSS)
    options = "--vary", "P=-20:20", "--plot", "y", "--starts", "2"
    called = lagsim("equilibrium", path, *options, code=0, err="")
    assert "fold at P = 9.9499" in called.out
    folder = Path("results/truss/equilibrium")
    with (folder / "equilibrium.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["branch", "P", "y", "stable"]
    assert (folder / "equilibrium.png").exists()
    document = json.loads((folder / "equilibrium.json").read_text())
    assert sum(map(len, document["branches"])) == len(rows)
    assert [x["kind"] for x in document["points"]] == ["fold", "fold"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--vary", "P"), "two different numbers"),
        (("--vary", "y_dit=0:1"), "did you mean `y_dot`?"),
        (("--plot", "z"), "no such coordinate"),
    ],
)
def test_wrong_options_are_refused(lagsim, write, options, said):
    path = write("name: truss\n" + TRUSS)
    assert said in lagsim("equilibrium", path, *options, code=2, out="").err


MOVING = """\
name: moving
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2/2}
forces: {x: 1 + t}
initial: {x: 0}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "potential", "code"),
    [("equilibrium", "x^2/2", 0), ("modes", "x^2/2", 0), ("equilibrium", "0", 1)],
)
def test_a_warning_is_printed_once(lagsim, write, command, potential, code):
    path = write(MOVING.replace("x^2/2}", f"{potential}}}"))
    called = lagsim(command, path, "--no-plots", code=code)
    assert called.err.count("[W407]") == 1


def test_an_energy_of_rounding_is_0_in_the_report(lagsim, write):
    path = write(MOVING.replace("1 + t", "0").replace("x: 0}", "x: 1e-70}"))
    called = lagsim("equilibrium", path, "--no-plots", "--starts", "0", code=0)
    assert "1  stable  0         0       x 0" in called.out


@pytest.mark.slow
@pytest.mark.parametrize("potential", ["abs(x)", "x^2/2"])
def test_branches_that_are_not_followed_are_reported(lagsim, write, potential):
    text = "name: b\nparameters: {k: 1}\ncoordinates: {x: {}}\ninitial: {x: 1}\n"
    path = write(f"{text}energy: {{kinetic: x_dot^2/2, potential: k*{potential}}}\n")
    options = "--vary", "k=0.5:2", "--no-plots", "--starts", "2"
    out = lagsim("equilibrium", path, *options, code=0).out
    corner = "  skipped   rests in corners and in continuous families\n"
    assert (corner in out) is (potential == "abs(x)")
