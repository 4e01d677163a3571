"""Types of the public names of `lagsim`, as mypy sees them in a user's script."""

import os
import subprocess
import sys

import pytest

import lagsim
from tests.support import ROOT

SCRIPT = """
from pathlib import Path

import numpy as np

import lagsim


def furthest(result: lagsim.Result, column: str) -> float:
    return float(np.max(np.abs(result[column])))


def study(path: Path) -> None:
    model: lagsim.Model = lagsim.load(path, K=20)
    softer = model.bind(K=10.0, theta="0.1")
    found: lagsim.Examination = lagsim.check(softer)
    print(found.admissible, found.record["warnings"])
    result = lagsim.simulate(softer, duration=5, method="dop853", error_bar="always")
    one: float = result.at(0.25)["theta"]
    several = result.at(np.linspace(0, 5, 11))["theta"].reshape(-1)
    accelerations = softer.rhs(0.0, [0.1, 0.2], np.zeros(2))
    multipliers = softer.rhs.motion(0.0, [0.1, 0.2], [0.0, 0.0]).multipliers
    error = result.error
    if error is not None:
        print(error.relative, error.horizon, error.coordinates["theta"].largest)
        error.plot().savefig("error.png")
    for event in result.events:
        print(event.time, event.kind, event.constraint)
    for warning in result.warnings:
        print(warning.code, warning.text)
    peaks = [peak.frequency for peak in result.spectrum("theta").peaks]
    result.plot("theta", against="t").savefig("theta.png")
    result.animate(height=500).write("motion.html")
    model.explore({"K": (5.0, 50.0), "theta": None}, height=700).write("page.html")
    result.write("results", table="npz", plots=False)
    swept: lagsim.Sweep = lagsim.sweep(path, {"K": [1, 2.5, "25.6"]}, jobs=1)
    swept.plot("theta.end").savefig("sweep.png")
    equations: lagsim.Derivation = lagsim.derive(model, substitute=True)
    print(equations.text, equations.json["accelerations"], len(swept))
    print(one, several, accelerations.mean(), multipliers, peaks, furthest(result, "u"))


try:
    study(Path("models/elastic-pendulum.yaml"))
except lagsim.InadmissibleError as error:
    print(error.examination.repair)
except lagsim.InputError as error:
    for problem in error.problems:
        print(problem.file, problem.line, problem.code, problem.hint)
except lagsim.LagsimError as error:
    print(error.exit_code)


def mistaken(result: lagsim.Result) -> None:
    lagsim.simulate(3)  # type: ignore[arg-type]
    lagsim.simulate("a.yaml", error_bar="no")  # type: ignore[arg-type]
    lagsim.simulate("a.yaml", ouput_step=1)  # type: ignore[call-arg]
    result.at("0.5")  # type: ignore[arg-type]
    result.colums  # type: ignore[attr-defined]
"""


@pytest.mark.slow
def test_mypy_accepts_a_script_and_sees_its_mistakes(tmp_path):
    pytest.importorskip("mypy", reason="needs mypy")
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent",
         "script.py"],
        cwd=tmp_path, capture_output=True, text=True,
        # mypy does not see what is installed to be edited.
        env=os.environ | {"MYPYPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_the_package_says_that_it_is_typed():
    assert (ROOT / "lagsim" / "py.typed").exists()
    for name in ("Model", "Result", "Sweep", "Examination", "Derivation"):
        assert isinstance(getattr(lagsim, name), type)
