"""`lagsim run`: its files, its output, and its end."""

import hashlib
import io
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli._results import ended, manifest, names, table
from tests.small_scenes import CAPTION, ON_THE_CURVE, PENDULUM

MOTION = "t theta u theta_dot u_dot theta_ddot u_ddot"
FORCES = "lambda_path Qc_theta Qc_u residual_path"
ENERGIES = "kinetic potential energy"
WORKED = "t theta theta_dot theta_ddot kinetic potential energy work"
LAGRANGIAN = """\
coordinates: {x: }
energy: {lagrangian: x_dot^2/2 - x^2}
initial: {x: 1}
simulation: {duration: 1}
"""
TWO = """\
coordinates: {x: , y: , z: }
energy: {kinetic: x_dot^2 + y_dot^2 + z_dot^2, potential: x}
constraints: {b: x_dot = y_dot, a: z = t^2}
initial: {x: 1, y: 0, z: 0}
simulation: {duration: 1}
"""
TWO_COLUMNS = f"""\
t x y z x_dot y_dot z_dot x_ddot y_ddot z_ddot {ENERGIES} work
lambda_b lambda_a Qc_x Qc_y Qc_z residual_b residual_a
"""
DAMPED = PENDULUM.replace("cos(theta)}", "cos(theta), dissipation: theta_dot^2}")
MOVING = PENDULUM.replace("-g*l*cos(theta)", "-g*l*cos(theta - sin(t))")

# The columns, in the order of the contract.
COLUMNS = {
    "plain": (PENDULUM, f"t theta theta_dot theta_ddot {ENERGIES}"),
    "a Lagrangian": (LAGRANGIAN, "t x x_dot x_ddot lagrangian energy"),
    "a force": (PENDULUM + "forces: {theta: cos(t)}\n", WORKED),
    "dissipation": (DAMPED, WORKED),
    "explicit time": (MOVING, WORKED),
    "a constraint": (ON_THE_CURVE, f"{MOTION} x y {ENERGIES} {FORCES}"),
    "two, one of them moving": (TWO, TWO_COLUMNS),
    **{
        f"definitions [{chosen}]": (
            f"{ON_THE_CURVE}output: {{columns: [{chosen}]}}\n",
            f"{MOTION} {chosen.replace(',', '')} {ENERGIES} {FORCES}",
        )
        for chosen in ("", "y", "y, x")
    },
}


@pytest.mark.slow
@pytest.mark.parametrize(("text", "expected"), COLUMNS.values(), ids=COLUMNS)
def test_the_columns_stand_in_the_order_of_the_contract(lagsim, write, text, expected):
    assert lagsim("run", write(text), "--no-plots", "-o", "out").code == 0
    header, rows = table("out")
    assert header == expected.split()
    assert list(manifest("out")["columns"]) == header
    assert np.all(np.isfinite(rows))


def test_the_rows_are_at_the_output_times(lagsim, write):
    text = PENDULUM.replace("output_step: 0.1", "start: 0.3, output_step: 0.07")
    lagsim("run", write(text), "--no-plots", "-o", "out")
    t = table("out")[1][:, 0]
    expected = [0.3 + k * 0.07 for k in range(29)] + [2.3]
    assert t.tolist() == expected
    assert manifest("out")["rows"] == 30


@pytest.mark.slow
@pytest.mark.drawn
@pytest.mark.parametrize("form", ["svg", pytest.param("pdf", marks=pytest.mark.slow)])
def test_pictures_in_another_format_take_the_place_of_the_others(lagsim, write, form):
    model = write(PENDULUM + "output: {plots: [{x: t, y: theta}]}\n")
    pictures = ["energy", "plot_1", "trajectory"]
    for ending in ("png", form):
        assert lagsim("run", model, "-o", "out", "--format", ending).code == 0
        named = {f"{name}.{ending}" for name in pictures}
        assert {f for f in names("out") if f.split(".")[0] in pictures} == named | {
            "trajectory.csv"
        }
        listed = manifest("out")["files"]
        assert named <= set(listed)
        assert len(listed) == len(names("out"))


TYPES = {
    "lagsim": str, "versions": dict, "model": dict, "parameters": dict, "method": str,
    "formulation": str, "rtol": float, "atol": (float, type(None)),
    "step": (float, type(None)), "plan": list, "outcome": str, "complete": bool,
    "reason": str, "start": float, "end": float, "rows": int, "steps": int,
    "rejections": int, "evaluations": int, "factorisations": int, "events": list,
    "energy_drift": float, "constraint_residual": float, "warnings": list,
    "timings": dict, "columns": dict, "files": list,
}  # fmt: skip
LAPS = {"import", "read", "derive", "compile", "integrate", "output", "plots"}


@pytest.mark.slow
def test_run_json_has_the_keys_of_the_contract(lagsim, write):
    model = write(ON_THE_CURVE)
    lagsim("run", model, "--set", "g=2*4.9", "-o", "out", code=0)
    document = manifest("out")
    for key, kind in TYPES.items():
        assert isinstance(document[key], kind), key
    assert "error" in document
    assert document["model"] == {
        "name": "model",
        "file": model,
        "sha256": hashlib.sha256(Path(model).read_bytes()).hexdigest(),
    }
    assert document["parameters"] == {"l": 1.0, "g": 9.8, "K": 25.6, "M": 1.0}
    assert document["method"] == "taylor"
    assert document["rtol"] == 1e-11
    assert (document["outcome"], document["complete"]) == ("done", True)
    assert (document["start"], document["end"], document["rows"]) == (0.0, 1.0, 21)
    assert all(c["choice"] and c["reason"] for c in document["plan"])
    assert document["timings"].keys() == {*LAPS, "error_bar"}
    assert all(seconds >= 0 for seconds in document["timings"].values())
    assert document["columns"]["theta_ddot"] == "rad/s^2"
    assert document["columns"]["u_dot"] == "m/s"
    assert document["constraint_residual"] <= 1e-12
    # T + V keeps the value M g l (1 - cos 1) of the notes.
    header, rows = table("out")
    energy = rows[:, header.index("energy")]
    assert energy == pytest.approx(9.8 * (1 - math.cos(1)), abs=1e-9)
    assert document["energy_drift"] == np.max(np.abs(energy - energy[0]))
    assert sorted(document["files"]) == names("out")
    assert set(document["files"]) == {
        "trajectory.csv", "energy.png", "trajectory.png", "constraint_forces.png",
        "run.json",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.drawn
def test_the_files_of_plots_and_their_default_folder(lagsim, write):
    text = PENDULUM + "output: {plots: [{x: theta, y: theta_dot, title: Phase}]}\n"
    lagsim("run", write("name: a pendulum\n" + text), code=0)
    files = ["energy.png", "plot_1.png", "run.json", "trajectory.csv", "trajectory.png"]
    assert names("results") == ["a pendulum"]
    assert names("results/a pendulum") == files
    assert Path("results/a pendulum/plot_1.png").read_bytes()[:4] == b"\x89PNG"


def test_the_closing_lines(lagsim, write):
    called = lagsim(
        "run", write(ON_THE_CURVE), "--no-plots", "-o", "out", code=0, err=""
    )
    lines = called.out.splitlines()
    assert lines[0] == "done: model, t = 0 to 1, 21 rows"
    assert len(lines) <= 12
    text = called.out
    for told in ("2 coordinates, 1 constraint\n", "taylor", "elimination", "steps",
                 "in energy (energy 4.505037 at the start)", "of its scale",
                 "rtol 1e-11",
                 "out: trajectory.csv, run.json"):  # fmt: skip
        assert told in text
    forced = lagsim("run", write(PENDULUM + "forces: {theta: 1}\n"), "--no-plots")
    assert "energy - work" in forced.out
    assert "1 coordinate\n" in forced.out
    assert "residual" not in forced.out


@pytest.mark.slow
def test_quiet_and_json(lagsim, write):
    # A start that is exact to six digits only is worth a word, but not here.
    text = CAPTION.replace("theta: 1, u: l", "theta: 0.770917, u: 0.405687")
    model = write(text)
    lagsim("run", model, "--no-plots", "-q", code=0, out="", err="")
    loud = lagsim("run", model, "--no-plots")
    assert "warning: " in loud.err
    assert loud.reports("W201")
    called = lagsim("run", model, "--no-plots", "--json", "-q", code=0, err="")
    assert called.json == manifest("results/model")
    codes = [w["code"] for w in called.json["warnings"]]
    assert "start-changed" in codes


@pytest.mark.slow
def test_options_stand_for_the_files(lagsim, write):
    model = write(PENDULUM)
    called = lagsim(
        "run", model, "--no-plots", "--json", "--method", "rk4", "--step", "1/64",
        "--duration", "2*l", "--output-step", "l/4", "--set", "l=0.5",
    )  # fmt: skip
    document = called.json
    assert (document["method"], document["step"]) == ("rk4", 1 / 64)
    assert (document["end"], document["rows"], document["steps"]) == (1.0, 9, 64)
    assert (document["rtol"], document["atol"]) == (None, None)
    assert document["parameters"] == {"l": 0.5, "g": 9.8}
    called = lagsim("run", model, "--no-plots", "--json", "--rtol=1e-6", "--atol=1e-9")
    assert (called.json["rtol"], called.json["atol"]) == (1e-6, 1e-9)


def test_a_duration_without_a_section(lagsim, write):
    model = write(PENDULUM.partition("simulation")[0])
    called = lagsim("run", model, "--duration", "1", "--no-plots", code=0)
    assert "1001 rows" in called.out
    called = lagsim("run", model, "--no-plots", "-o", "out", code=2)
    assert "--duration" in called.err
    assert not Path("out").exists()


def test_standard_input(lagsim, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(PENDULUM.encode())))
    lagsim("run", "-", "--no-plots", code=0)
    assert manifest("results/stdin")["model"]["name"] == "stdin"


def test_until_ends_the_run(lagsim, write):
    model = write(PENDULUM.replace("duration: 2", "duration: 2, until: theta <= 0"))
    called = lagsim("run", model, "--no-plots", "-o", "out", code=0)
    assert called.out.startswith("until: model")
    assert "theta <= 0" in called.out
    document = manifest("out")
    assert (document["outcome"], document["complete"]) == ("until", True)
    assert document["events"][-1]["kind"] == "until"
    assert table("out")[1][-1, 0] == document["end"] < 2


@pytest.mark.slow
def test_an_inadmissible_start_writes_nothing(lagsim, write):
    called = lagsim("run", write(CAPTION), code=1, out="")
    assert called.reports("E301", "`path`", " 1 ")
    assert called.err == lagsim("check", "model.yaml").out
    assert names(".") == ["model.yaml"]
    called = lagsim("run", "model.yaml", "--json", code=1)
    assert called.json["admissible"] is False
    assert called.json["constraints"][0]["residual"] == 1.0
    assert names(".") == ["model.yaml"]


@pytest.mark.slow
@pytest.mark.usefixtures("lagsim")
def test_a_home_that_is_read_only(tmp_path, write):
    home = tmp_path / "home"
    home.write_text("not even a folder")
    told = ended("run", write(PENDULUM), "-q", "-o", "out", LAGSIM_CACHE="",
                 HOME=str(home), XDG_CACHE_HOME=str(home))  # fmt: skip
    assert told == (0, "", "")
    assert manifest("out")["complete"]
    assert home.read_text() == "not even a folder"
