"""`lagsim.fit`: data as arrays and files, and the result as the command writes it."""

import json
from pathlib import Path

import numpy as np
import pytest

import lagsim
from tests.support import refused

MODEL = """
name: spring
parameters: {k: 3}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
initial: {x: 1}  # released
simulation: {duration: 5}
"""
TIMES = np.linspace(0.1, 4, 30)
DATA = {"t": TIMES, "x": np.cos(2 * TIMES), "note": ["a"] * 30}


@pytest.mark.slow
def test_arrays_and_files_have_one_result(tmp_path):
    path = tmp_path / "a.csv"
    pairs = np.column_stack([TIMES, DATA["x"]]).tolist()
    rows = (f"{t!r},{x!r}" for t, x in pairs)
    path.write_text("\n".join(["t,x", *rows]))
    for data in (DATA, [DATA], path, [str(path)]):
        found = lagsim.fit(MODEL, data, vary=["k"])
        assert found.values == pytest.approx({"k": 4}, rel=1e-7)
        assert found.outcome == "converged"
    assert "k" in repr(found)
    assert found.fitted.parameters[0].value == found.values["k"]


@pytest.mark.slow
def test_files_are_those_of_the_command(tmp_path):
    found = lagsim.fit(MODEL, DATA, vary=["k", "x"])
    found.write(tmp_path)
    document = json.loads((tmp_path / "fit.json").read_text())
    names = ["fit.csv", "spring-fitted.yaml", "fit.png", "fit.json"]
    assert document["files"] == names
    assert "# released" in (tmp_path / "spring-fitted.yaml").read_text()
    assert "<img" in found._repr_html_()


def test_arguments_that_cannot_be_used():
    with pytest.raises(ValueError, match="loss"):
        lagsim.fit(MODEL, DATA, vary=["k"], loss="cubic")
    with pytest.raises(ValueError, match="starts"):
        lagsim.fit(MODEL, DATA, vary=["k"], starts=-1)
    with pytest.raises(TypeError, match="data are"):
        lagsim.fit(MODEL, 3.0, vary=["k"])
    with refused("bad-data", "data 1: row 2"):
        lagsim.fit(MODEL, {"t": [1, 0], "x": [1, 1]}, vary=["k"])
    with refused("bad-data"):
        lagsim.fit(MODEL, {"t": [1, 2], "x": [1]}, vary=["k"])
    with refused("bad-data", "none.csv"):
        lagsim.fit(MODEL, Path("none.csv"), vary=["k"])
