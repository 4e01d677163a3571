"""Small changes of models as goldens record these: seen, not seen, without effect.

Expected from the equations: the numbers on which a motion depends, and when.
"""

import functools
import math

import numpy as np
import orjson
import pytest

from lagsim.errors import LagsimError
from lagsim.language.evaluate import evaluate
from lagsim.model.reader import read, read_file
from lagsim.run.session import open_case
from lagsim.studies.golden import CHANGES, judge, new_golden, run, summary
from lagsim.studies.responses import OF_TABLE, _evenly, responses
from tests.golden.scenes import GOLDENS, scene, stored
from tests.support import MODELS, SHIPPED


def measured(text, name="model.yaml"):
    """Return a golden with its recorded changes, and its case."""
    case = open_case(read(text, name))
    golden, base = new_golden(case)
    golden.about[CHANGES] = responses(case, golden, base)
    return golden, case


# Nothing of the file's numbers but these: an amplitude that cancels, a length that is
# only drawn, an offset that is 0 beside another of its unit, a friction that holds.
SILENT = """
parameters:
  k: 4
  drawn: {value: 3, unit: m}
  cancels: 2
  offset: {value: 0, unit: m}
  n: 2
coordinates: {x: {unit: m}, y: {}}
definitions: {z: x, top(i = 1..n): i*x}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: k*(x - offset)^2/2}
forces: {x: cancels*(sin(t)^2 + cos(t)^2 - 1)}
constraints: {held: {relation: y_dot = 0, limit: 5}}
initial: {x: 1, y: 0, y_dot: {guess: 0}}
scene: {points: {a: [drawn, 0], b: [x, 0]}}
simulation: {duration: 6, output_step: 0.05}
"""


@pytest.mark.slow
def test_a_motion_is_measured_not_to_respond_against_rounding():
    golden, _ = measured(SILENT)
    found = golden.about[CHANGES]
    known = summary(golden)
    assert known.undetected == []
    assert known.unresponsive == ["drawn", "cancels"]
    for name in known.unresponsive:
        assert found["parameters"][name]["response"] <= 10.0
    # What is 0 is changed by a part of the other of its unit; a number of members,
    # of which 2.0002 are none, is refused with its model.
    assert found["parameters"]["offset"]["change"] == pytest.approx(3e-4)
    assert found["parameters"]["offset"]["ratio"] > 1.0
    assert found["parameters"]["n"] == {
        "change": -2e-4, "refused": "expression-subscript"
    }  # fmt: skip
    # The start values that are in the file, and are no guesses.
    assert list(found["initial"]) == ["x", "y"]
    assert known.detected == 5


# Data at every second row, as measured loads have: (0, 0), (0.02, y_1), ...
LOAD = "\n".join(
    f"    - [{0.02 * k:.2f}, {math.sin(1.7 * k) * math.cos(0.3 * k):.6f}]"
    for k in range(101)
)
LOADED = f"""
name: loaded
tables:
  F:
    outside: hold
    points:
{LOAD}
coordinates: {{x: {{}}}}
energy:
  kinetic: x_dot^2/2
  potential: 1e4*x^2/2
  dissipation: 200*x_dot^2/2
forces: {{x: F(t)}}
initial: {{x: 0}}
simulation: {{duration: 2, output_step: 0.01}}
"""


@pytest.mark.slow
def test_data_at_every_second_row_are_guarded():
    golden, _ = measured(LOADED)
    assert len(golden.rows) >= 50
    assert np.max(np.diff(golden.rows[:, 0])) < 0.05
    found = golden.about[CHANGES]["tables"]["F"]
    assert found["points"] == 101
    assert found["changed"] == 40
    # The first point is that of the start; all others are seen, the last one too.
    assert "unseen" not in found
    assert "unresponsive" not in found
    (line,) = [x for x in LOADED.splitlines() if x.lstrip().startswith("- [1.00,")]
    for value in ("50", "0.0"):
        text = LOADED.replace(line, f"    - [1.00, {value}]")
        other = open_case(read(text, "model.yaml"))
        assert not judge(other, run(other, golden), golden).passed


@pytest.mark.slow
def test_each_point_of_such_data_is_seen():
    golden, case = measured(LOADED)
    model = case.model
    for point in range(101):
        other = open_case(model.stated.shifted(model, "F", point, -OF_TABLE))
        assert not judge(other, run(other, golden), golden).passed, point


@pytest.mark.parametrize("how", ["linear", "cubic", "monotone"])
def test_a_point_of_a_table_is_moved(how):
    text = f"""
tables: {{f: {{points: [[0, 1], [1, 3], [2, 2], [3, 5]], interpolation: {how}}}}}
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: 0}}
forces: {{x: f(t)}}
definitions: {{at: f(t)}}
initial: {{x: 0}}
simulation: {{duration: 3}}
"""
    model = read(text, "model.yaml")
    other = model.stated.shifted(model, "f", 2, 0.01)
    for t, moved in ((0.0, 0.0), (1.0, 0.0), (2.0, 0.04), (3.0, 0.0)):
        values = []
        for x in (model, other):
            (at,) = [d.node for d in x.definitions if d.name == "at"]
            values += evaluate(x.graph, [at], {"t": t})
        assert values[1] - values[0] == pytest.approx(moved, abs=1e-14)
    assert other.parameter_values == model.parameter_values


@pytest.mark.parametrize(
    ("count", "most", "some"),
    [(0, 5, []), (3, 5, [0, 1, 2]), (5, 5, [0, 1, 2, 3, 4]), (9, 5, [0, 2, 4, 6, 8])],
)
def test_some_of_many(count, most, some):
    assert _evenly(count, most) == some


# The shipped models

# What their motions do not depend on: a length that is only drawn; a friction that
# holds whatever it is; masses whose centre is at rest; the road behind the end.
UNFELT = {
    "bicycle": ["s"],
    "jenkins-element": ["l"],
    "rocking-block": ["mu"],
    "spacecraft": ["M", "m"],
}


@pytest.mark.parametrize("name", SHIPPED)
def test_the_golden_of_a_shipped_model_sees_each_number(name):
    golden = stored(name)
    known, model = summary(golden), read_file(str(MODELS / f"{name}.yaml"))
    changes = golden.about[CHANGES]
    assert [*changes["parameters"]] == [p.name for p in model.parameters if not p.mode]
    assert [*changes["initial"]] == [
        x.name for x in model.initial if x.text and not x.guess
    ]
    assert "untried" not in changes
    assert known.undetected == []
    silent = [x for x in known.unresponsive if not x.startswith("road")]
    assert silent == UNFELT.get(name, [])
    # At 20 m/s the front axle comes to 82.87 m in 4 s, which is knot 415; a cubic
    # spline carries a change on by a factor of 2 - sqrt(3) a knot, to rounding in 28.
    for entry in changes.get("tables", {}).values():
        assert all(point > 415 for point in entry.get("unresponsive", ()))
    assert len(golden.rows) >= 50 or len(golden.rows) == golden.about["run_rows"]


@functools.cache
def changed(name):
    """Return texts of numbers with the opposite changes, by name."""
    model, changes = scene(name).model, stored(name).about[CHANGES]
    found = {}
    for section, values in (
        ("parameters", model.parameter_values),
        ("initial", {x.name: x.value for x in model.initial}),
    ):
        for number, x in changes[section].items():
            if "refused" not in x and "response" not in x:
                found[number] = repr(values[number] - x["change"])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_the_opposite_changes_are_seen_too(name):
    numbers = changed(name)
    random = np.random.default_rng(len(name))
    for number in random.permutation(sorted(numbers))[:3].tolist():
        try:
            case = open_case(
                read_file(str(MODELS / f"{name}.yaml"), {number: numbers[number]})
            )
            motion = run(case, stored(name))
        except LagsimError:
            continue  # refused, and so seen
        assert not judge(case, motion, stored(name)).passed, number


def test_goldens_are_compact():
    for path in GOLDENS.glob("*.json"):
        entries = orjson.loads(path.read_bytes())[CHANGES]
        lines = path.read_text().splitlines()
        count = sum(len(x) for x in entries.values())
        assert sum('"change":' in line for line in lines) == count
