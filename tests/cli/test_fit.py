"""`lagsim fit`: files, options, and faults of data with their places."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from lagsim.model.reader import read_file
from tests.studies.test_fit import OSCILLATOR, TIMES, damped

MODEL = "name: spring" + OSCILLATOR


@pytest.fixture
def data():
    """Return a function that writes data of the oscillator, with other lines."""

    def put(name, *lines, header="t,x", count=40):
        x = damped(TIMES, 10, 0.2, 1.2)
        rows = [f"{a},{b}" for a, b in zip(TIMES, x, strict=True)][:count]
        Path(name).write_text("\n".join([header, *lines, *rows]) + "\n")
        return name

    return put


@pytest.mark.drawn
@pytest.mark.slow
def test_files_and_summary(lagsim, write, data):
    path = write(MODEL)
    options = "--vary", "k", "--vary", "x", "--write", "new.yaml"
    called = lagsim("fit", path, data("a.csv"), *options, code=0, err="")
    assert called.out.startswith("converged: spring, ")
    assert "\n  k " in called.out
    folder = Path("results/spring/fit")
    document = json.loads((folder / "fit.json").read_text())
    names = ["fit.csv", "spring-fitted.yaml", "fit.png", "fit.json"]
    assert document["files"] == names
    assert all((folder / name).stat().st_size for name in names)
    with (folder / "fit.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["data", "t", "x", "x.model", "x.residual"]
    assert len(rows) == 40
    text = Path("new.yaml").read_text()
    assert text == (folder / "spring-fitted.yaml").read_text()
    assert "# released" in text
    assert read_file("new.yaml").parameter_values["k"] == pytest.approx(10, rel=1e-7)


@pytest.mark.slow
def test_json_is_one_document(lagsim, write, data):
    path = write(MODEL)
    options = "--vary", "x", "--json", "--no-plots", "--set", "k=10"
    document = lagsim("fit", path, data("a.csv"), *options, code=0, err="").json
    assert {
        "model", "data", "match", "loss", "parameters", "correlation", "rms", "noise",
        "identifiable", "combinations", "chi2", "degrees_of_freedom", "starts",
        "reached", "iterations", "runs", "outcome", "complete", "files",
    } <= set(document)  # fmt: skip
    one = document["parameters"]["x"]
    assert set(one) == {"value", "standard_error", "interval", "start"}
    assert one["value"] == pytest.approx(1.2, rel=1e-7)
    text = Path("results/spring/fit/spring-fitted.yaml").read_text()
    assert "k: 10" in text


@pytest.mark.slow
def test_options_of_runs_and_values_of_one_file(lagsim, write, data):
    path = write(MODEL.replace("duration: 10", "duration: 1"))
    options = "--vary", "x", "--set", "x@2=0.5", "--set", "k=10", "--json", "--no-plots"
    options += "--duration", "10", "--method", "dop853", "--atol", "1e-12"
    first, second = data("a.csv"), data("b.csv")
    called = lagsim("fit", path, first, second, *options, code=0)
    document = called.json
    assert document["data"][1]["values"] == {"x": 0.5}
    assert "values" not in document["data"][0]
    assert document["parameters"]["x"]["value"] == pytest.approx(1.2, rel=1e-7)
    # The data of the second file are 2.4 times the motion from 0.5.
    assert document["rms"]["x"] > 0.1
    assert [one["code"] for one in document["warnings"]] == ["residual-pattern"]
    assert called.err.count("[W325]") == 1


@pytest.mark.parametrize("name", ["duration", "method", "formulation", "atol", "set"])
def test_options_of_runs_that_cannot_be_used(lagsim, write, data, name):
    text = {"duration": "-1", "set": "x@2=1", "formulation": "lagrange"}.get(
        name, "none"
    )
    options = "--vary", "k", f"--{name}", text
    called = lagsim("fit", write(MODEL), data("a.csv"), *options, code=2, out="")
    assert name in called.err.lower()


@pytest.mark.slow
def test_a_model_without_duration_needs_the_option(lagsim, write, data):
    path = write(MODEL.replace("simulation: {duration: 10}\n", ""))
    options = data("a.csv"), "--vary", "x", "--no-plots", "-q"
    called = lagsim("fit", path, *options, code=2, out="")
    assert "--duration" in called.err
    lagsim("fit", path, *options, "--duration", "10", code=0)


@pytest.mark.slow
def test_files_of_others_are_not_replaced(lagsim, write, data):
    path = write(MODEL)
    again = "--vary", "x", "--set", "k=10", "--no-plots", "-q"
    other = MODEL.replace("m: 1", "mass: 1").replace("m*", "mass*")
    Path("other.yaml").write_text(other)
    Path("thesis.txt").write_text("to keep")
    for name in ("other.yaml", "thesis.txt"):
        before = Path(name).read_bytes()
        options = *again, "--write", name
        called = lagsim("fit", path, data("a.csv"), *options, code=2, out="")
        assert called.reports("E703", "model.yaml")
        assert "[E703]" in called.err
        assert Path(name).read_bytes() == before
        assert not Path("results").exists()
    lagsim("fit", path, "a.csv", *again, "--write", "mine.yaml", code=0)
    lagsim("fit", "mine.yaml", "a.csv", *again, "--write", "mine.yaml", code=0)
    # A fitted file that was changed since is the user's.
    fitted = Path("results/spring/fit/spring-fitted.yaml")
    lagsim("fit", path, "a.csv", *again, code=0)
    fitted.write_text(fitted.read_text() + "# tried\n")
    called = lagsim("fit", path, "a.csv", *again, code=2, out="")
    assert called.reports("E703", "spring-fitted.yaml")
    assert fitted.read_text().endswith("# tried\n")


@pytest.mark.slow
def test_the_fitted_file_of_another_model_is_removed(lagsim, write, data):
    # A folder has the files of one fit; a file that was changed since stays.
    again = (
        data("a.csv"),
        "--vary",
        "x",
        "--set",
        "k=10",
        "--no-plots",
        "-q",
        "-o",
        "out",
    )
    kept = set()
    for name in ("one", "two", "three"):
        lagsim("fit", write(MODEL.replace("spring", name)), *again, code=0)
        there = {x.name for x in Path("out").glob("*.yaml")}
        assert there == kept | {f"{name}-fitted.yaml"}
        if name == "two":
            Path("out/two-fitted.yaml").write_text("mine")
            kept.add("two-fitted.yaml")


@pytest.mark.slow
def test_unused_columns_are_named(lagsim, write):
    Path("a.csv").write_text("t,x,room,note\n0,1,20,a\n0.5,0.1,20,b\n1,-0.9,21,c\n")
    options = "--vary", "x", "--no-plots"
    called = lagsim("fit", write(MODEL), "a.csv", *options, code=0)
    assert "note: a.csv: not used: room, note; `--match`" in called.err


@pytest.mark.parametrize(
    ("text", "place", "name"),
    [
        ("t,x\n0,1\n0.5,half\n1,0\n", "a.csv:3:5", "`x`"),
        ("t,x\n0,1\n0.5,inf\n1,0\n", "a.csv:3:5", "`x`"),
        ("t,x\n0,1\n1,2\n0.5,1\n", "a.csv:4:1", ""),
        ("t,x\n0,1\n,2\n2,1\n", "a.csv:3:1", ""),
        ("t,x\n0,1\nsoon,2\n2,1\n", "a.csv:3:1", ""),
        ("t,x\n-1,1\n1,2\n2,1\n", "a.csv:2:1", " 0 "),
        ("t,x\n0,1\n1,2\n11,1\n", "a.csv:4:1", "11"),
        ("t,x\n0,\n1,\n2,nan\n", "a.csv:1:3", "`x`"),
        ("t,y\n0,1\n1,2\n", "a.csv:1:1", ""),
        ("time,x\n0,1\n1,2\n", "a.csv:1:1", "`t`"),
        ("t,x\n", "a.csv:1:1", ""),
        ("", "a.csv:1:1", "`t`"),
        ("t,x,x\n0,1,1\n1,2,2\n", "a.csv:1:3", "`x`"),
        ("t,x\n0,1\n1,2,3\n", "a.csv:3:1", "3"),
        # Comments and other separators count as lines.
        ("# made\nt;x\n0,0;1,5\n# pause\n0,5;text\n", "a.csv:5:5", "`x`"),
    ],
)
def test_faults_of_data_have_their_places(lagsim, write, text, place, name):
    Path("a.csv").write_text(text)
    called = lagsim("fit", write(MODEL), "a.csv", "--vary", "k", code=2, out="")
    assert called.reports("E615", f"{place}: ", name)
    assert "hint: " in called.err
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (["--match", "y=x"], "the data have no such column"),
        (["--match", "x"], "a column and an expression are expected"),
        (["--match", "x=x", "--match", "x=2*x"], "given twice"),
        (["--match", "x=x:0"], "a standard deviation is expected"),
        (["--match", "x=x:small"], "a standard deviation is expected"),
        (["--match", "x=z"], "unknown name `z`"),
        (["--match", "x=x+"], "the expression ends"),
        (["--vary", "kk"], "did you mean `k`?"),
        (["--vary", "m", "--match", "x=7*t"], "changes no column of the data"),
        (["--loss", "cubic"], "--loss"),
    ],
)
def test_options_that_cannot_be_used(lagsim, write, data, options, fault):
    path = write(MODEL)
    called = lagsim("fit", path, data("a.csv"), "--vary", "k", *options, code=2, out="")
    assert fault in called.err


def test_a_file_that_is_not_there(lagsim, write):
    called = lagsim("fit", write(MODEL), "none.csv", "--vary", "k", code=2, out="")
    assert called.reports("E615", "none.csv")


@pytest.mark.slow
def test_a_run_that_ends_before_the_data(lagsim, write, data):
    text = MODEL.replace("duration: 10", "duration: 10, until: x <= 0")
    called = lagsim("fit", write(text), data("a.csv"), "--vary", "k", code=2, out="")
    # Released at 1, x reaches 0 after a quarter of a period, 0.53 s.
    row = int(np.argmax(TIMES > 0.53)) + 2
    assert called.reports("E615", f"a.csv:{row}:1: ")
