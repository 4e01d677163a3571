"""`lagsim bench`: the command and its files."""

import csv
from pathlib import Path

import pytest

from tests.cli._results import document as read
from tests.cli._results import names
from tests.small_scenes import FALL, PENDULUM

HEADER = (
    "method,formulation,setting,value,seconds,evaluations,error,error_lambda,"
    "energy_drift,constraint_residual,outcome,chosen"
)
QUICK = ("--tolerances", "1e-3:1e-5", "--steps", "0.1:0.05")
SOME = ("--methods", "dop853,rk4,scipy:DOP853", *QUICK)


def rows(folder):
    text = (Path(folder) / "work_precision.csv").read_text()
    return list(csv.DictReader(text.splitlines()))


@pytest.mark.drawn
def test_the_files_the_table_and_the_document(lagsim, write):
    called = lagsim("bench", write(PENDULUM), *SOME, code=0, err="")
    folder = Path("results/model/bench")
    files = ["work_precision.csv", "work_precision.json", "work_precision.png"]
    assert names(folder) == files
    lines = (folder / "work_precision.csv").read_bytes().split(b"\r\n")
    assert lines[0].decode() == HEADER
    found = rows(folder)
    settings = [(r["method"], r["setting"], float(r["value"])) for r in found]
    tolerances = [("rtol", 1e-3), ("rtol", 1e-4), ("rtol", 1e-5)]
    assert settings == [
        *(("dop853", *s) for s in tolerances),
        ("rk4", "step", 0.1),
        ("rk4", "step", 0.05),
        *(("scipy:DOP853", *s) for s in tolerances),
    ]
    assert [r["chosen"] for r in found] == 3 * ["true"] + 5 * ["false"]
    for row in found:
        assert row["outcome"] == "done"
        assert row["formulation"] == "none"
        assert row["error_lambda"] == ""
        assert float(row["seconds"]) > 0
        assert 0 < float(row["error"]) < 0.1
        assert int(row["evaluations"]) > 40
    png = (folder / "work_precision.png").read_bytes()
    assert png.startswith(b"\x89PNG")
    assert "reference" in called.out
    assert "selected by auto" in called.out

    document = read(folder / "work_precision.json")
    reference = document["reference"]
    assert reference["floor"] < 1e-11
    assert reference["horizon"] is None
    assert "agrees with it to" in reference["trust"]
    assert document["budget"]["spent"] > 0
    assert document["budget"]["seconds"] == 180
    assert reference["agreement"].keys() == {"theta", "theta_dot"}
    assert document["versions"].keys() >= {"python", "numpy", "scipy"}
    assert document["machine"]["cores"] > 0
    assert document["complete"] is True
    assert len(document["rows"]) == 8
    assert document["rows"][0].keys() >= set(HEADER.split(","))
    assert any(row["front_seconds"] for row in document["rows"])
    assert all(curve["compile_seconds"] >= 0 for curve in document["curves"])


@pytest.mark.slow
@pytest.mark.drawn
def test_a_chart_is_drawn_again_from_its_document(lagsim, write):
    lagsim("bench", write(PENDULUM), *SOME, "-o", "out", "-q")
    before = {path.name: path.read_bytes() for path in Path("out").iterdir()}
    Path("out/work_precision.png").unlink()
    called = lagsim("bench", "out/work_precision.json", code=0, err="")
    assert called.out.startswith("drawn: out")
    assert {path.name: path.read_bytes() for path in Path("out").iterdir()} == before
    # Some of it, elsewhere; what was measured stays whole.
    some = ("--methods", "rk4", "-o", "some", "-q")
    assert lagsim("bench", "out/work_precision.json", *some).code == 0
    drawn = {path.name: path.read_bytes() for path in Path("some").iterdir()}
    assert drawn.keys() == before.keys()
    assert {name for name in drawn if drawn[name] != before[name]} == {
        "work_precision.png"
    }


@pytest.mark.slow
@pytest.mark.parametrize(("form", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
@pytest.mark.drawn
def test_a_chart_for_print(lagsim, write, form, begins):
    quick = ("--methods", "rk4", "--steps", "0.1:0.1", "--set", "g=1.62", "-o", "out")
    line = ("bench", write(PENDULUM), *quick, "--format", form, "--json")
    [document] = lagsim(*line, code=0).json
    assert document["parameters"]["g"] == 1.62
    assert document == read("out/work_precision.json")
    files = ["work_precision.csv", "work_precision.json", f"work_precision.{form}"]
    assert names("out") == sorted(files)
    assert Path(f"out/work_precision.{form}").read_bytes().startswith(begins)
    assert read("out/work_precision.json")["files"] == [
        files[0], files[2], files[1],
    ]  # fmt: skip


@pytest.mark.slow
def test_several_models(lagsim, write):
    files = [write(PENDULUM, f"{name}.yaml") for name in "ab"]
    quick = ("--methods", "dop853", "--tolerances", "1e-4:1e-4")
    lagsim("bench", *files, *quick, "-o", "out", "-q", code=0, out="", err="")
    assert names("out") == ["a", "b"]
    assert len(rows("out/a")) == 1
    # One that cannot be measured does not keep the other from it.
    called = lagsim(
        "bench", files[0], "missing.yaml", *quick, "-o", "out", "-q", code=2
    )
    assert called.reports("E101", "missing.yaml")


@pytest.mark.slow
def test_a_motion_that_cannot_be_solved_has_no_reference(lagsim, write):
    called = lagsim("bench", write(FALL), code=3)
    assert called.reports("E511")
