"""A method of an earlier version: files and commands that name it get `auto`."""

import numpy as np
import pytest

import lagsim
from lagsim.methods import RETIRED, names
from tests.small_scenes import oscillator

ROWS = "simulation: {duration: 3, output_step: 0.1%s}\n"


@pytest.mark.parametrize("name", RETIRED)
def test_a_file_that_names_it_runs_with_a_warning(name):
    plain = lagsim.simulate(oscillator() + ROWS % "", error_bar="never")
    text = oscillator() + ROWS % f", method: {name}"
    found = lagsim.simulate(text, error_bar="never")
    assert [(w.code, w.number) for w in found.warnings] == [("retired", "W207")]
    assert found.record["method"] == plain.record["method"]
    assert found["x"].tobytes() == plain["x"].tobytes()
    assert np.max(np.abs(found["x"] - np.cos(found.t))) < 1e-10
    [warning] = lagsim.check(text).warnings
    assert (warning["code"], warning["line"]) == ("retired", text.count("\n"))


@pytest.mark.parametrize("name", RETIRED)
def test_an_argument_that_names_it_too(name):
    asked = {"method": name, "step": 0.1, "error_bar": "never"}
    found = lagsim.simulate(oscillator() + ROWS % "", **asked)
    # The step of the retired method has no effect either.
    assert [w.code for w in found.warnings] == ["retired", "step-unused"]
    assert found.complete


@pytest.mark.parametrize("name", RETIRED)
def test_it_is_no_method_any_more(name):
    assert name not in names()
