"""`lagsim golden`: storing, comparing, exit codes, notes."""

import json
import re
import signal
from pathlib import Path

import pytest

from tests.cli._results import document
from tests.outputs.drawn import noted
from tests.small_scenes import CAPTION, FALL, ON_THE_CURVE, PENDULUM, TIMELESS


@pytest.mark.slow
def test_a_golden_and_its_files(lagsim, write):
    stored = write(PENDULUM, "pendulum.yaml")
    assert lagsim("golden", stored, "--update", "-q").code == 0
    assert sorted(p.name for p in Path("golden").iterdir()) == [
        "pendulum.csv",
        "pendulum.json",
    ]
    about = document("golden/pendulum.json")
    assert about["horizon"] is None
    assert len(about["model_sha256"]) == 64
    header = Path("golden/pendulum.csv").read_text().split("\n")[0].split(",")
    assert list(about["bounds"]) == header
    called = lagsim("golden", stored, code=0, err="")
    assert called.out.startswith("same: pendulum, 21 rows")
    told = lagsim("golden", stored, "--json").json
    assert told["pass"] is True
    assert told["models"][0]["notes"] == []


@pytest.mark.slow
def test_what_changed_is_named_and_annotated_at_its_line(
    lagsim, stored, write, monkeypatch
):
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    lines = PENDULUM.splitlines()
    for old, new, names, line in (
        ("9.8", "9.9", ("`g`", " 9.9", " 9.8"), "parameters"),
        ("theta: 1", "theta: 1.1", ("`theta`", " 1.1", " 1.0"), "initial"),
        ("-g*l*cos(theta)", "-1.01*g*l*cos(theta)",
         ("`energy.potential`", "'-1.01*g*l*cos(theta)'", "'-g*l*cos(theta)'"),
         "energy"),
        ("initial:", "forces: {theta: -0.3*theta_dot}\ninitial:",
         ("`forces.theta`", "'-0.3*theta_dot'"), "initial"),
    ):  # fmt: skip
        assert old in PENDULUM
        write(PENDULUM.replace(old, new, 1), "pendulum.yaml")
        called = lagsim("golden", stored, code=1)
        [note] = [x for x in called.out.splitlines() if "note: " in x]
        assert all(name in note for name in names), note
        [told] = [x for x in called.err.splitlines() if x.startswith("::error")]
        at = int(told.partition(",line=")[2].partition(",")[0])
        assert lines[at - 1].startswith(line), told
        assert all(name in told for name in names), told


@pytest.mark.slow
@pytest.mark.drawn
def test_the_picture_says_what_differs_in_units(lagsim, stored, write):
    write(PENDULUM.replace("9.8", "9.9"), "pendulum.yaml")
    with noted() as drawing:
        assert lagsim("golden", stored, "--plots", "plots").code == 1
    said = [text.replace("\n", " ") for text in drawing.written()]
    assert any(re.match(r"pendulum .* \d of \d .* t = 0 s$", text) for text in said)
    assert any(all(x in text for x in ("`g`", " 9.9", " 9.8")) for text in said)
    assert not any("…" in text for text in said)
    sides = [panel.labels[1] for panel in drawing.panels]
    rates = [x for x in sides if x.startswith(("θ\N{COMBINING DOT ABOVE}", "θ"))]
    assert rates
    assert all(re.search(r"\(rad(/s²?)?\)$", x) for x in rates), rates
    assert "difference (rad/s²)" in sides


def test_a_golden_of_an_earlier_version_names_no_change(lagsim, stored, write):
    path = Path("golden/pendulum.json")
    about = json.loads(path.read_bytes())
    del about["parameters"], about["initial"], about["expressions"]
    path.write_text(json.dumps(about))
    write(PENDULUM.replace("9.8", "9.9"), "pendulum.yaml")
    called = lagsim("golden", stored, code=1)
    [note] = [x for x in called.out.splitlines() if "note: " in x]
    assert "`" not in note


# A change of the model; the exit code; a name or number in the report; its notes.
CHANGES = [
    ("9.8", "9.800001", 1, "`g`", 2),
    ("l^2*theta_dot^2/2", "(l*theta_dot)**2 * 0.5", 0, "`energy.kinetic`", 2),
    ("0.1}", "0.1, method: radau}", 0, " radau", 3),
    ("duration: 2", "duration: 1", 1, "t = 1.0", 3),
    ("duration: 2", "duration: 3", 0, "t = 3.0", 3),
    ("energy:", "definitions: {h: -l*cos(theta)}\nenergy:", 0, "`definitions.h`", 2),
]


@pytest.mark.slow
def test_a_changed_model(lagsim, stored, write):
    path = Path("golden/pendulum.json")
    path.write_text(path.read_text().replace('"lagsim": "', '"lagsim": "0.0.'))
    for old, new, code, name, notes in CHANGES:
        assert old in PENDULUM
        write(PENDULUM.replace(old, new), "pendulum.yaml")
        called = lagsim("golden", stored, code=code)
        assert called.out.startswith("differs: pendulum" if code else "same: pendulum")
        assert called.out.count("note: ") == notes
        assert " 0.0." in called.out  # the version
        assert name in called.out
        assert ("[E601]" in called.out) == bool(code)
    # Of the last, whose golden has a column more than the first.
    lagsim("golden", stored, "--update")
    write(PENDULUM, "pendulum.yaml")
    assert "missing: h" in lagsim("golden", stored, code=1).out


@pytest.mark.slow
def test_an_end_that_is_located(lagsim, write):
    until = PENDULUM.replace("duration: 2", "until: theta <= 0, duration: 2")
    file = write(until, "until.yaml")
    assert lagsim("golden", file, "--update").code == 0
    assert lagsim("golden", file).code == 0
    write(until.replace("9.8", "9.80001"), "until.yaml")
    assert lagsim("golden", file).code == 1


def test_a_broken_golden(lagsim, stored):
    for name, text in (
        ("pendulum.json", "{}"),
        ("pendulum.json", "garbage"),
        ("pendulum.csv", "t,theta\n0,1\n"),
        ("pendulum.csv", ""),
    ):
        path = Path("golden") / name
        before = path.read_text()
        path.write_text(text)
        called = lagsim("golden", stored)
        assert called.code == 2, name
        assert "pendulum." in called.err
        assert ("`lagsim golden --update`" in called.err) == (text != "")
        assert "Traceback" not in called.err
        path.write_text(before)


def test_several_models_are_all_told_of(lagsim, write, stored):
    other = write(ON_THE_CURVE, "curve.yaml")
    called = lagsim("golden", stored, other, "missing.yaml", code=2)
    assert "same: pendulum" in called.out
    assert called.reports("E603", "curve")
    assert called.reports("E101", "missing.yaml")


@pytest.mark.slow
def test_models_that_cannot_run(lagsim, write):
    assert lagsim("golden", write(TIMELESS), "--update").code == 2
    assert lagsim("golden", write(CAPTION), "--update").code == 1
    called = lagsim("golden", write(FALL), "--update", code=3)
    assert called.reports("E605", "model")
    assert not Path("golden").exists()


@pytest.mark.slow
def test_any_number_of_processes_gives_the_same_report(lagsim, write, stored):
    write(ON_THE_CURVE, "curve.yaml"), write(CAPTION, "bad.yaml")
    models = (stored, "curve.yaml", "bad.yaml", "missing.yaml")
    one, two = (lagsim("golden", *models, "-j", jobs, code=2) for jobs in (1, 2))
    assert one.out.startswith("same: pendulum")
    assert (one.out, one.err) == (two.out, two.err)
    one, two = (lagsim("golden", *models, "--json", "-j", jobs).json for jobs in (1, 2))
    assert len(one["models"]) == 1
    assert len(one["errors"]) == 3
    assert one == two


def test_an_unforeseen_fault_of_one_keeps_the_others(lagsim, stored, at_rows):
    calls = []

    def fail(_rows):
        calls.append(1)
        if len(calls) == 1:
            raise RuntimeError("unforeseen")

    at_rows(fail)
    report = ["--junit", "report.xml", "-j", 1]
    called = lagsim("golden", stored, stored, *report, code=70)
    assert called.reports("E901", "RuntimeError: unforeseen")
    assert called.out.startswith("same: pendulum")
    cases = Path("report.xml").read_text()
    assert 'errors="1"' in cases
    assert 'tests="2"' in cases


@pytest.mark.usefixtures("heeded_signals")
def test_an_interrupt_ends_the_comparison(lagsim, stored, at_rows):
    at_rows(lambda _: signal.raise_signal(signal.SIGINT))
    called = lagsim("golden", stored, "--junit", "report.xml", code=130)
    assert called.out == ""
    assert not Path("report.xml").exists()


def test_a_run_that_ends_otherwise_differs_though_all_rows_are_the_same(lagsim, stored):
    path = Path("golden/pendulum.json")
    about = json.loads(path.read_bytes())
    assert about["outcome"] == "done"
    path.write_text(json.dumps(about | {"outcome": "until"}), encoding="utf-8")
    called = lagsim("golden", stored, code=1)
    assert all(x in called.out + called.err for x in ("`done`", "`until`"))
    document = lagsim("golden", stored, "--json").json
    assert document["pass"] is False
