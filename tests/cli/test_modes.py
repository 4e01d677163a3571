"""`lagsim modes`: files, options, and refusals."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.studies.test_modes import ABSORBER, HOOP
from tests.support import MODELS

NAMED = "name: absorber\n" + ABSORBER


@pytest.mark.drawn
@pytest.mark.slow
def test_files_and_summary(lagsim, write):
    path = write(NAMED)
    called = lagsim("modes", path, "--response", "x:y", code=0, err="")
    assert called.out.startswith("absorber: 2 modes\n")
    folder = Path("results/absorber/modes")
    document = json.loads((folder / "modes.json").read_text())
    assert document["files"] == [
        "modes.csv", "response.csv", "modes.png", "response.png", "modes.json",
    ]  # fmt: skip
    assert sorted(x.name for x in folder.iterdir()) == sorted(document["files"])
    with (folder / "modes.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:4] == ["mode", "natural_frequency", "frequency", "damping"]
    assert header[7:] == ["x.re", "x.im", "y.re", "y.im"]
    own = [float(row[1]) for row in rows]
    assert own == [mode["natural_frequency"] for mode in document["modes"]]
    with (folder / "response.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["frequency", "x:y.amplitude", "x:y.phase"]
    f = np.array([float(row[0]) for row in rows])
    assert np.all(np.diff(f) > 0)
    assert f[[0, -1]] == pytest.approx([own[0] / 10, own[-1] * 10])


def test_json_is_one_document(lagsim, write):
    path = write(NAMED)
    document = lagsim("modes", path, "--json", "--no-plots", code=0).json
    assert set(document) >= {"about", "modes", "zero", "model", "files"}
    assert set(document["modes"][0]) == {
        "eigenvalue", "frequency", "natural_frequency", "damping", "stable", "shape",
    }  # fmt: skip
    assert document["about"] == {"t": 0, "x": 0, "y": 0, "x_dot": 0, "y_dot": 0}
    assert lagsim("modes", path, "-q", "--no-plots", "-o", "there", code=0).out == ""
    assert Path("there/modes.csv").exists()


@pytest.mark.parametrize("ending", ["json", "npz"])
def test_matrices_are_written_with_names(lagsim, write, ending):
    path, file = write(NAMED), f"abcd.{ending}"
    lagsim("modes", path, "--matrices", file, "--no-plots", "-q", code=0)
    if ending == "json":
        found = json.loads(Path(file).read_text())
    else:
        found = dict(np.load(file))
    assert list(found["states"]) == ["x", "y", "x_dot", "y_dot"]
    assert list(found["inputs"]) == ["x"]
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-29.5, 4.5, 0, 0], [30, -30, 0, 0]])
    assert np.array(found["A"]) == pytest.approx(A)


def test_the_page_plays_each_mode(lagsim):
    path = MODELS / "double-pendulum.yaml"
    rest = "--set", "theta1=0", "--set", "theta2=0"
    lagsim("modes", path, *rest, "--animate", "--no-plots", "-o", "there", code=0)
    page = Path("there/animation.html").read_text()
    [_, data] = page.split('<script type="application/json" id="runs">')
    runs = json.loads(data.partition("</script>")[0])
    assert [run["name"].partition(":")[0] for run in runs] == ["1", "2"]


def test_a_start_that_moves_is_exit_1(lagsim, write):
    path = write("name: hoop\n" + HOOP)
    called = lagsim("modes", path, "--at", "start", code=1, out="")
    assert "theta_ddot = " in called.err
    assert "[E531]" in called.err
    assert not Path("results").exists()
    document = lagsim("modes", path, "--at", "start", "--json", code=1).json
    assert document["errors"][0]["code"] == "no-rest"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--response", "x"), "--response x: an input and an output"),
        (("--response", "q:x"), "`q` is no input"),
        (("--frequencies", "0:3"), "two frequencies above 0"),
        (("--matrices", "a.txt"), "a.txt: no such format"),
        (("--set", "mass=3"), "mass"),
    ],
)
def test_wrong_options_are_refused(lagsim, write, options, said):
    called = lagsim("modes", write(NAMED), *options, code=2, out="")
    assert said in called.err


def test_models_without_modes_and_scenes(lagsim, write):
    free = "name: free\ncoordinates: {x: {}}\ninitial: {x: 1}\n"
    path = write(free + "energy: {kinetic: x_dot^2/2, potential: 0}\n")
    document = lagsim("modes", path, "--json", code=0).json
    assert document["modes"] == []
    assert document["zero"] == 2
    assert lagsim("modes", path, "--response", "x:x", code=2)
