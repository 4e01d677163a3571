"""`lagsim run --error-bar`."""

from pathlib import Path

import pytest

from tests.cli._results import manifest
from tests.small_scenes import pendulum
from tests.support import MODELS

SWING = pendulum(simulation="duration: 5")


@pytest.mark.slow
def test_every_run_tells_its_error(lagsim, write):
    called = lagsim("run", write(SWING), "-o", "out", "--no-plots", code=0)
    error = manifest("out")["error"]
    # Nothing can hide from a series here: other steps are other means enough.
    assert error["repeated_by"] == "taylor"
    assert error["repeated_rtol"] == pytest.approx(1e-13)
    # A tolerance of 1e-11, and some rounding at worst.
    assert 0 < error["relative"] < 1e-10
    assert error["coordinates"]["a"]["largest"] < 2e-10
    assert error["horizon"] is None
    assert "of the range of a" in called.out
    assert called.err == ""


def test_the_result_is_the_same_with_and_without(lagsim, write):
    model = write(SWING)
    for choice in ("never", "always"):
        lagsim("run", model, "-o", choice, "--no-plots", "--error-bar", choice)
    first, second = (
        Path(choice, "trajectory.csv").read_bytes() for choice in ("never", "always")
    )
    assert first == second
    documents = [manifest(choice) for choice in ("never", "always")]
    for key in ("steps", "evaluations", "rows", "energy_drift"):
        assert documents[0][key] == documents[1][key]


@pytest.mark.parametrize(
    "plots", [pytest.param([], marks=pytest.mark.slow), ["--no-plots"]]
)
def test_past_the_horizon(lagsim, plots):
    model = MODELS / "double-pendulum.yaml"
    called = lagsim("run", model, "-o", "out", "--duration", "30", *plots, code=0)
    document = manifest("out")
    horizon = document["error"]["horizon"]
    assert 15 < horizon < 26
    assert "no forecast past t" in called.out
    (warning,) = (w for w in document["warnings"] if w["code"] == "horizon")
    assert f"{horizon:.6g}" in warning["text"]
    assert warning["text"] in called.err


def test_too_long_to_repeat(lagsim, write, monkeypatch):
    monkeypatch.setattr("lagsim.studies.repeats.BUDGET", 1e3)
    called = lagsim("run", write(SWING), "-o", "out", "--no-plots", code=0)
    assert manifest("out")["error"] is None
    assert "a repeat would need about" in called.out
    assert "--error-bar always" in called.out


def test_a_repeat_that_fails_is_a_warning(lagsim, write, monkeypatch):
    """The warning is in run.json and on the terminal; other reasons are no warning."""
    monkeypatch.setattr("lagsim.studies.repeats.Allowance.steps", lambda *_: 3)
    called = lagsim("run", write(SWING), "--no-plots", "-o", "out", code=0)
    assert called.reports("W318")
    assert [w["code"] for w in manifest("out")["warnings"]] == ["error-unknown"]
    assert manifest("out")["error"] is None
