"""Runs that share what is compiled give the bits of runs alone: all kinds of scenes."""

from __future__ import annotations

import numpy as np
import pytest

import lagsim
from lagsim.model.reader import read_file
from tests.support import MODELS

# Integrated apart, sparse, with contacts, by impulses, with limits, held velocities.
SCENES = {
    "coupled-oscillators": {},
    "chain-cartesian": {},
    "newtons-cradle": {},
    "ball-on-a-vibrating-table": {"method": "moreau", "step": 1e-3},
    "stick-slip": {"method": "radau"},
    "rolling-disk": {},
    "pendulum-cartesian": {"formulation": "baumgarte"},
    "elastic-pendulum-curve": {"formulation": "elimination"},
    "heavy-top": {"formulation": "ignorable"},
    "kepler": {"method": "kahan-li8", "step": 0.01},
    "forced-oscillator": {"error_bar": "always"},
}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "options"), SCENES.items(), ids=SCENES)
def test_rows_are_those_of_runs_alone(name, options):
    path = str(MODELS / f"{name}.yaml")
    model = lagsim.load(path)
    asked = {"duration": 0.5, "output_step": 0.05, "error_bar": "never"} | options
    parameter = model.parameters[0]
    values = [parameter.value, 1.02 * parameter.value]
    swept = lagsim.sweep(model, {parameter.name: values}, jobs=1, **asked)
    for k, value in enumerate(values):
        alone = lagsim.simulate(read_file(path, {parameter.name: repr(value)}), **asked)
        assert swept["outcome"][k] == alone.outcome
        for column in alone.columns[1:]:
            rows = alone[column]
            told = [swept[f"{column}.{x}"][k] for x in ("end", "min", "max")]
            own = [rows[-1], np.fmin.reduce(rows), np.fmax.reduce(rows)]
            assert np.array_equal(told, own, equal_nan=True), column
