"""`lagsim sweep`: the rows are those of single runs, in any process."""

import csv
import io
import itertools
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lagsim.cli.sweep import _names as completed
from lagsim.outputs.results import PART
from lagsim.program.system import System
from lagsim.studies.sweep.batches import Judge
from lagsim.studies.sweep.runs import Runs
from lagsim.studies.sweep.sweeping import JOURNAL as NAME
from tests.cli._results import document, manifest, names, started, table, waited
from tests.patience import finished
from tests.small_scenes import CURVE, FALL, ON_THE_CURVE, PENDULUM, orbit, power
from tests.support import ROOT

SPRING = """\
parameters: {l: 1, g: 9.8, K: 25.6}
coordinates: {theta: {unit: rad}, u: {unit: m}}
definitions: {x: {value: (l + u)*sin(theta), unit: m}, y: -(l + u)*cos(theta)}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: g*(l + y) + K*u^2/2}
initial: {theta: 1, u: 0.1}
simulation: {duration: 1, output_step: 0.05}
"""
POWER = power("duration: 2, output_step: 0.1")
FALL_FROM = "parameters: {R: 1}\n" + FALL.replace("{r: 1}", "{r: R}")
QUICK = ("--no-plots", "--error-bar", "never")


def rows_of(folder):
    """Return the rows of sweep.csv as mappings."""
    text = (Path(folder) / "sweep.csv").read_bytes().decode()
    return list(csv.DictReader(io.StringIO(text, newline="")))


def record(folder):
    return document(folder, "sweep.json")


def assert_is_single(row, folder):
    """Compare a row with the results of a single run, bit for bit."""
    header, rows = table(folder)
    found = manifest(folder)
    error = found["error"]
    assert row["outcome"] == found["outcome"]
    assert row["error"] == ("" if error is None else repr(error["relative"]))
    assert float(row["t.end"]) == rows[-1, 0]
    for k, name in enumerate(header[1:], 1):
        told = [float(row[f"{name}.{x}"]) for x in ("end", "min", "max")]
        assert told == [rows[-1, k], rows[:, k].min(), rows[:, k].max()]


@pytest.mark.slow
@pytest.mark.parametrize("bars", ["auto", "never"])
def test_rows_have_the_values_of_single_runs(lagsim, write, bars):
    model = write(SPRING)
    more = ("--no-plots", "--error-bar", bars, "--rtol", "1e-9")
    called = lagsim(
        "sweep", model, "K=20:30:3", "g=9.8,2*pi", *more, "-j", 1, code=0, err=""
    )
    assert called.out.startswith("done: model, 6 of 6 runs complete")
    folder = Path("results/model/sweep")
    assert names(folder) == ["sweep.csv", "sweep.json"]
    rows = rows_of(folder)
    grid = list(itertools.product(("20.0", "25.0", "30.0"), ("9.8", repr(2 * np.pi))))
    assert [(row["K"], row["g"]) for row in rows] == grid
    for k, text in ((0, "9.8"), (3, "2*pi"), (5, "2*pi")):
        sets = ("--set", f"K={grid[k][0]}", "--set", f"g={text}")
        lagsim("run", model, *sets, *more, "-o", "single")
        assert_is_single(rows[k], "single")
        assert rows[k]["reason"] == ""


@pytest.mark.slow
def test_the_columns_stand_in_the_order_of_the_contract(lagsim, write):
    text = SPRING + "output: {columns: [y]}\n"
    lagsim("sweep", write(text), "theta=1", *QUICK, "-o", "out")
    header = (Path("out") / "sweep.csv").read_text(encoding="utf-8").splitlines()[0]
    columns = "theta u theta_dot u_dot theta_ddot u_ddot y kinetic potential energy"
    told = [f"{c}.{x}" for c in columns.split() for x in ("end", "min", "max")]
    expected = ["theta", "outcome", "complete", "error", "t.end", *told, "reason"]
    assert header.split(",") == expected


@pytest.mark.slow
def test_the_record_says_what_was_swept(lagsim, write):
    model = write(SPRING)
    called = lagsim("sweep", model, "K=1,2*l", "--set", "l=3", *QUICK, "--json")
    found = called.json
    assert found == record("results/model/sweep")
    assert found["model"]["name"] == "model"
    [axis] = found["grid"]
    assert (axis["name"], axis["values"]) == ("K", [1.0, 6.0])
    assert found["parameters"]["l"] == 3.0
    assert found["options"] == {"error_bar": "never"}
    assert (found["runs"], found["complete"]) == (2, 2)
    assert found["outcomes"] == {"done": 2}
    assert found["columns"]["x"] == "m"
    assert found["files"] == ["sweep.csv", "sweep.json"]


def test_fifty_runs_are_compiled_once(lagsim, write, monkeypatch):
    made = []
    begun = System.__init__

    def begin(self, *arguments, **named):
        made.append(self)
        begun(self, *arguments, **named)

    monkeypatch.setattr(System, "__init__", begin)
    assert lagsim("sweep", write(SPRING), "K=10:40:50", *QUICK, "-j", 1).code == 0
    assert len(made) == 1
    assert record("results/model/sweep")["compiled"] == 1


def test_guesses_are_solved_for_each(lagsim, write):
    text = CURVE.replace("START", "{guess: 0.1}")
    lagsim("sweep", write(text), "theta=0.5,1", *QUICK, "-o", "out")
    # The curve u = l - l*theta^2 gives u at the start, and energy keeps what it is.
    for row, theta in zip(rows_of("out"), (0.5, 1.0), strict=True):
        u = 1 - theta**2
        start = 9.8 * (1 - (1 + u) * np.cos(theta)) + 25.6 * u * u / 2
        assert float(row["energy.end"]) == pytest.approx(start, rel=1e-9)


@pytest.mark.slow
def test_what_changes_the_form_is_compiled_for_it(lagsim, write):
    called = lagsim(
        "sweep", write(POWER), "n=2,8,3,8", *QUICK, "-o", "out", "-j", 1, code=0
    )
    assert "forms were compiled" in called.err
    assert 2 <= record("out")["compiled"] <= 3


def test_failures_are_rows_with_their_reasons(lagsim, write):
    called = lagsim(
        "sweep", write(FALL_FROM), "R=1,0,5", "--duration", "2", *QUICK, code=3
    )
    first, second, third = rows_of("results/model/sweep")
    assert (first["outcome"], first["complete"]) == ("failed", "false")
    assert "r_dot" in first["reason"]  # the component that grows
    assert float(first["t.end"]) == pytest.approx(np.pi / 2**1.5, abs=1e-6)
    assert second["outcome"] == "unusable"  # 1/r at the start
    assert second["t.end"] == second["r.end"] == ""
    assert second["reason"]
    assert (third["outcome"], third["complete"]) == ("done", "true")
    assert "1 of 3 runs complete" in called.out
    assert called.err == "lagsim: 2 of 3 runs are not complete\n"
    assert "failed    1 run, the first: the step size became too small" in called.out


@pytest.mark.slow
def test_inadmissible_starts_are_rows(lagsim, write):
    model = write(ON_THE_CURVE)
    lagsim("sweep", model, "u=0,0.5", *QUICK, code=3)
    admissible, other = rows_of("results/model/sweep")
    assert admissible["outcome"] == "done"
    assert (other["outcome"], other["u"]) == ("inadmissible", "0.5")
    assert "path" in other["reason"]
    assert lagsim("sweep", model, "u=0.3:0.5:3", *QUICK).code == 1
    assert {row["outcome"] for row in rows_of("results/model/sweep")} == {
        "inadmissible"
    }


@pytest.mark.slow
def test_two_processes_give_the_same_bytes(lagsim, write):
    model = write(FALL_FROM)
    for jobs in (1, 2):
        values = ("R=0.5:3:6", "-o", f"by-{jobs}", "-j", jobs)
        assert lagsim("sweep", model, *values, *QUICK).code == 3
    one, two = (Path(f"by-{jobs}/sweep.csv").read_bytes() for jobs in (1, 2))
    assert one == two
    first, second = record("by-1"), record("by-2")
    assert {key for key in first if first[key] != second[key]} <= {"timings"}


def test_kept_folders_are_those_of_single_runs(lagsim, write):
    model = write(SPRING)
    lagsim("sweep", model, "K=20,30", "--keep", "-o", "out", *QUICK)
    assert names("out") == ["run-1", "run-2", "sweep.csv", "sweep.json"]
    lagsim("run", model, "--set", "K=30", *QUICK, "-o", "single")
    assert names("out/run-2") == names("single") == ["run.json", "trajectory.csv"]
    one, other = (Path(x) / "trajectory.csv" for x in ("single", "out/run-2"))
    assert one.read_bytes() == other.read_bytes()
    assert_is_single(rows_of("out")[1], "single")
    kept, alone = manifest("out/run-2"), manifest("single")
    assert {key for key in alone if alone[key] != kept[key]} <= {"timings"}


def test_the_shell_completes_names(write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    context = SimpleNamespace(params={"model": write(SPRING)})
    assert completed(context, "") == [
        "l=", "g=", "K=", "theta=", "u=", "theta_dot=", "u_dot=",
    ]  # fmt: skip
    assert completed(context, "th") == ["theta=", "theta_dot="]
    assert completed(SimpleNamespace(params={"model": "none.yaml"}), "") == []


@pytest.mark.usefixtures("heeded_signals")
def test_an_interrupted_sweep_goes_on_where_it_was(
    lagsim, write, interrupted, monkeypatch
):
    begun = []
    whole = ("sweep", write(SPRING), "K=20:30:8", *QUICK, "-j", 1)
    lagsim(*whole, "-o", "expected")
    interrupted(6, *whole, "-o", "out")
    assert names("out") == [NAME]
    assert (
        len((Path("out") / NAME).read_bytes().splitlines()) == 1 + 6
    )  # the last is whole
    on_each_run(monkeypatch, lambda: begun.append(1))
    assert lagsim(*whole, "-o", "out", "--resume").code == 0
    assert len(begun) == 2
    assert names("out") == ["sweep.csv", "sweep.json"]
    expected, found = (Path(x) / "sweep.csv" for x in ("expected", "out"))
    assert found.read_bytes() == expected.read_bytes()


def test_a_sweep_that_is_whole_is_left_as_it_is(lagsim, write):
    sweep = ("sweep", write(SPRING), "K=20,30", *QUICK, "-o", "out")
    lagsim(*sweep)
    before = (Path("out") / "sweep.json").read_bytes()
    told = "out already contains this sweep, complete\n"
    lagsim(*sweep, "--resume", code=0, out=told)
    assert (Path("out") / "sweep.json").read_bytes() == before


def on_each_run(monkeypatch, begin):
    """Call `begin` before each run, one made separately or in a batch."""

    def before(made):
        def run(*arguments):
            begin()
            return made(*arguments)

        return run

    monkeypatch.setattr(Runs, "row", before(Runs.row))
    monkeypatch.setattr(Judge, "run", before(Judge.run))


@pytest.fixture
def interrupted(lagsim, monkeypatch):
    """Return a function that interrupts a sweep in run number n, from 1."""

    def interrupt(run, *sweep):
        begun = []

        def begin():
            begun.append(1)
            if len(begun) == run:
                signal.raise_signal(signal.SIGINT)

        with monkeypatch.context() as patched:
            on_each_run(patched, begin)
            called = lagsim(*sweep)
        assert called.code == 130
        assert "--resume continues from there" in called.err
        return called

    return interrupt


def test_what_a_sweep_begins_goes_with_the_next_if_it_is_killed(
    lagsim, write, monkeypatch
):
    begun, replace = set(), os.replace

    def replaced(*paths):
        begun.update(name for name in names("out") if name.startswith("."))
        return replace(*paths)

    monkeypatch.setattr(os, "replace", replaced)
    lagsim("sweep", write(SPRING), "K=20,30", "-o", "out", *QUICK, code=0)
    assert {PART.format(NAME), PART.format("sweep.csv")} <= begun
    assert all(name.endswith(".part") for name in begun - {NAME})


@pytest.mark.usefixtures("heeded_signals")
def test_rows_of_another_sweep_are_not_gone_on_with(lagsim, write, interrupted):
    model = write(SPRING)
    more = (*QUICK, "-o", "out", "-j", 1)
    interrupted(1, "sweep", model, "K=20,30", *more)
    journal = (Path("out") / NAME).read_bytes()
    others = {
        "grid": ("K=20,31",),
        "options": ("K=20,30", "--rtol", "1e-7"),
        "parameters": ("K=20,30", "--set", "g=1.62"),
    }
    for what, arguments in others.items():
        called = lagsim("sweep", model, *arguments, *more, "--resume", code=2)
        assert called.reports("E611", what)
        assert called.reports("E611", "--resume")
    write(SPRING + "description: changed\n")
    called = lagsim("sweep", model, "K=20,30", *more, "--resume")
    assert called.reports("E611", "model")
    assert (Path("out") / NAME).read_bytes() == journal
    assert lagsim("sweep", model, "K=20,30", *more).code == 0
    assert names("out") == ["sweep.csv", "sweep.json"]


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), ("--resume",)])
@pytest.mark.parametrize("kind", ["hard link", "link"])
def test_a_file_that_lies_elsewhere_too_is_not_written_through(
    lagsim, write, tmp_path, kind, more
):
    victim = tmp_path / "victim"
    victim.write_text("of somebody else")
    Path("out").mkdir()
    path = Path("out", NAME)
    path.hardlink_to(victim) if kind == "hard link" else path.symlink_to(victim)
    lagsim("sweep", write(SPRING), "K=20,30", "-o", "out", "-q", *QUICK, *more)
    assert victim.read_text() == "of somebody else"


@pytest.mark.slow
def test_a_torn_line_is_made_again(lagsim, write):
    sweep = ("sweep", write(SPRING), "K=20:30:4", *QUICK, "-o", "out", "-j", 1)
    lagsim(*sweep)
    expected = Path("out/sweep.csv").read_bytes()
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, *map(str, sweep)],
        env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False,
    )  # fmt: skip
    assert killed.returncode == -signal.SIGKILL
    journal = Path("out") / NAME
    assert len(journal.read_bytes().splitlines()) == 3
    with journal.open("ab") as file:
        file.write(b'[2, [26.6], "do')
    assert Path("out/sweep.csv").read_bytes() == expected  # the sweep before
    Path("out/sweep.csv").unlink()
    assert lagsim(*sweep, "--resume").code == 0
    assert Path("out/sweep.csv").read_bytes() == expected
    assert names("out") == ["sweep.csv", "sweep.json"]


# A sweep that is killed when it begins its third run.
KILLED = """
import os, signal, sys
from lagsim.cli import main
from lagsim.studies.sweep.runs import Runs

def row(self, number, interrupt):
    self._tried = True  # no batches
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return taken(self, number, interrupt)

taken, Runs.row = Runs.row, row
sys.argv[0] = "lagsim"
main()
"""


@pytest.mark.slow
@pytest.mark.usefixtures("lagsim", "heeded_signals")
def test_processes_end_in_order_and_what_they_had_is_kept(write):
    write(SPRING)
    sweep = ["sweep", "model.yaml", "K=20:30:200", "--no-plots", "-j", "2", "-q"]
    sweep += ["--duration", "300", "-o", "out"]
    run, journal = started(*sweep), Path("out", NAME)
    assert waited(
        lambda: journal.exists() and len(journal.read_bytes().splitlines()) > 5
    )
    run.send_signal(signal.SIGTERM)
    _, err = finished(run)
    assert run.returncode == 128 + signal.SIGTERM
    assert b"--resume" in err
    assert names("out") == [NAME]


def test_a_folder_where_a_folder_has_the_place_of_rows(lagsim, write):
    Path("taken/sweep.rows.jsonl").mkdir(parents=True)
    called = lagsim("sweep", write(PENDULUM), "l=1,2", "-j", 1, "-o", "taken", code=2)
    assert called.reports("E701", "taken")
    assert "[E701]" in called.err


# --- `--ends`: last values alone, the same as those of whole runs

# An orbit with next to no angular momentum falls into the centre, by steps of no size.
CENTRE = orbit("duration: 3, output_step: 0.1, rtol: 1e-9, formulation: full")


@pytest.mark.slow
def test_they_are_the_ends_of_whole_runs(lagsim, write):
    swept = ("sweep", write(CENTRE), "phi_dot=0:1.2:7", "mu=0.9,1.1", "-j", 1)
    lagsim(*swept, "--ends", "-o", "ends", code=3)
    lagsim(*swept, *QUICK, "-o", "whole", code=3)
    one, other = rows_of("ends"), rows_of("whole")
    assert len(one) == len(other) == 14
    for row, full in zip(one, other, strict=True):
        kept = {k: v for k, v in full.items() if not k.endswith((".min", ".max"))}
        assert row == kept
