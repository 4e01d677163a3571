"""`lagsim.sweep`: the table of a sweep as arrays."""

import json
from pathlib import Path

import numpy as np
import pytest

import lagsim
from tests.cli.conftest import lagsim as command  # noqa: F401
from tests.small_scenes import FALL, PENDULUM


def test_columns_are_those_of_single_runs(capsys):
    model = lagsim.load("name: swing\n" + PENDULUM)
    found = lagsim.sweep(model, {"g": [5, "3*pi"], "theta": [0.1, 1]}, rtol=1e-9)
    assert capsys.readouterr() == ("", "")
    assert len(found) == 4
    assert found["g"].tolist() == [5.0, 5.0, 3 * np.pi, 3 * np.pi]
    assert found["theta"].tolist() == [0.1, 1.0, 0.1, 1.0]
    assert found["complete"].all()
    assert set(found["outcome"]) == {"done"}
    for k, (g, theta) in enumerate(zip(found["g"], found["theta"], strict=True)):
        single = lagsim.simulate(model.bind(g=g, theta=theta), rtol=1e-9)
        assert found["theta.end"][k] == single["theta"][-1]
        assert found["energy.min"][k] == single["energy"].min()
        assert found["theta_dot.max"][k] == single["theta_dot"].max()
        assert found["error"][k] == single.error.relative
    assert repr(found).startswith("<Sweep of swing: 4 of 4 runs complete\n")
    with pytest.raises(KeyError, match="there is no column `phi`"):
        found["phi"]


def test_what_fails_is_a_row():
    model = lagsim.load("parameters: {R: 1}\n" + FALL.replace("{r: 1}", "{r: R}"))
    found = lagsim.sweep(model, {"R": [0, 1, 5]}, error_bar="never")
    assert found["outcome"].tolist() == ["unusable", "failed", "done"]
    assert found["complete"].tolist() == [False, False, True]
    assert np.isnan(found["r.end"]).tolist() == [True, False, False]
    assert np.isnan(found["error"]).all()
    assert [bool(text) for text in found["reason"]] == [True, True, False]
    assert found.record["outcomes"] == {"unusable": 1, "failed": 1, "done": 1}


@pytest.mark.slow
def test_it_is_written_as_the_command_writes_it(command, tmp_path):  # noqa: F811
    (tmp_path / "model.yaml").write_text(PENDULUM, encoding="utf-8")
    assert command("sweep", "model.yaml", "g=1:9:3", "-o", "one").code == 0
    lagsim.sweep(lagsim.load("model.yaml"), {"g": [1, 5, 9]}).write("other")
    for name in ("sweep.csv", "sweep.png"):
        one, other = (Path(x, name).read_bytes() for x in ("one", "other"))
        assert one == other
    one, other = (
        json.loads(Path(x, "sweep.json").read_bytes()) for x in ("one", "other")
    )
    assert {key for key in one if one[key] != other[key]} <= {"timings"}


def test_as_a_dataframe():
    pandas = pytest.importorskip("pandas", reason="pandas is no part of lagsim")
    found = lagsim.sweep(lagsim.load(PENDULUM), {"g": [1, 2]}, error_bar="never")
    frame = found.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert tuple(frame.columns) == found.columns
    assert frame["theta.end"].tolist() == found["theta.end"].tolist()


def test_faults_are_told():
    model = lagsim.load(PENDULUM)
    for values, options in (
        ({"gg": [1]}, {}),
        ({"g": []}, {}),
        ({"g": [1]}, {"method": "no"}),
    ):
        with pytest.raises(lagsim.InputError):
            lagsim.sweep(model, values, **options)
