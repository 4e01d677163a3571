"""run.json: one document that any reader of JSON takes."""

from __future__ import annotations

import json
import math
import sys

import numpy as np
import pytest

from lagsim.outputs.manifest import encode, manifest, versions
from lagsim.run.error import ErrorBar
from lagsim.run.observers.monitors import ResidualMonitor
from tests.support import run

BROKEN = """\
coordinates: {x: {unit: m}}
parameters: {k: 2}
definitions: {force: {value: -k*x, unit: N}}
energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
forces: {x: "if(t < 1, 1, 0)"}
constraints: {path: x = 1 + t^2}
initial: {x: 1}
simulation: {duration: 2}
"""


def document_of(text, bar="not asked for"):
    done = run(text)
    residuals = ResidualMonitor(done.system.columns.names)
    residuals.add(done.rows)
    return manifest(
        done.session, done.trajectory, residuals, bar, [], {"read": 1.0},
        ["run.json"],
    )  # fmt: skip


def test_the_error_bar_in_the_document():
    bar = ErrorBar(
        method="dop853",
        rtol=1e-13,
        names=("x",),
        times=np.array([0.0, 1.0, 2.0]),
        errors=np.array([[0.0], [3.0], [1.0]]),
        scales=np.array([10.0]),
    )
    document = document_of(BROKEN, bar)
    assert json.loads(encode(document)) == document
    assert document["error"] == {
        "repeated_by": "dop853",
        "repeated_rtol": 1e-13,
        "relative": 0.3,
        "coordinates": {"x": {"largest": 3.0, "relative": 0.3, "time": 1.0}},
        "growth": [{"time": 1.0, "relative": 0.3}, {"time": 2.0, "relative": 0.3}],
        "horizon": 1.0,
    }


def test_versions():
    found = versions()
    assert found.keys() >= {"python", "numpy"}
    assert found["numpy"] == np.__version__
    assert all(text[0].isdigit() for text in found.values())
    assert all(name == "python" or name in sys.modules for name in found)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_null(value):
    assert json.loads(encode({"x": [value]})) == {"x": [None]}


def test_a_name_that_is_not_unicode():
    document = {"a\udcff": ["\udcff", ("θ", 1, None)]}
    assert json.loads(encode(document)) == {"a?": ["?", ["θ", 1, None]]}


def test_the_same_document_gives_the_same_bytes():
    assert encode({"b": 0.1, "a": 1}) == b'{\n  "b": 0.1,\n  "a": 1\n}\n'
