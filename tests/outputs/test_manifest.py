"""run.json: one document that any reader of JSON takes."""

import json
import math
import sys

import numpy as np

from lagsim.outputs.manifest import encode, manifest, versions
from lagsim.run.error import ErrorBar
from lagsim.run.observers.monitors import ResidualMonitor
from tests.support import run


def test_the_error_bar_in_the_document():
    done = run("elastic-pendulum", duration=0.1)
    residuals = ResidualMonitor(done.system.columns.names)
    residuals.add(done.rows)
    bar = ErrorBar(
        "dop853", 1e-13, ("x",), np.array([0.0, 1.0, 2.0]),
        errors=np.array([[0.0], [3.0], [1.0]]), scales=np.array([10.0]),
    )  # fmt: skip
    document = manifest(done.session, done.trajectory, residuals, 0.0, bar, [], {}, [])
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


def test_any_document_is_json_and_has_the_same_bytes():
    for value in (math.nan, math.inf, -math.inf):
        assert json.loads(encode({"x": [value]})) == {"x": [None]}
    # The name of a file need not be Unicode.
    document = {"a\udcff": ["\udcff", ("θ", 1, None)]}
    assert json.loads(encode(document)) == {"a?": ["?", ["θ", 1, None]]}
    assert encode({"b": 0.1, "a": 1}) == b'{\n  "b": 0.1,\n  "a": 1\n}\n'
