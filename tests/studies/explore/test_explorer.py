"""Motions at values that a page sends, against runs of their own and closed forms."""

import json
import math
import struct
import threading

import numpy as np
import pytest

import lagsim
from lagsim.cli._faults import text_of
from lagsim.errors import LagsimError
from lagsim.studies.explore.explorer import MOST_ROWS, Explorer, SupersededError
from tests.support import MODELS

OSCILLATOR = """\
parameters:
  k: {value: 4, unit: N/m, range: [1, 9]}
  m: 2 # kilograms
  w: sqrt(k/m)
coordinates: {x: {unit: m}}
energy: {kinetic: m*x_dot^2/2, potential: k*x^2/2}
initial: {x: 0.5, x_dot: 0}
simulation: {duration: 3, output_step: 0.5}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "oscillator.yaml"
    path.write_text(OSCILLATOR)
    return path


def explorer_of(path, vary=(), **overrides):
    return Explorer(str(path), overrides, dict(vary), text_of)


def unpacked(content):
    [size] = struct.unpack("<I", content[:4])
    header = json.loads(content[4 : 4 + size])
    numbers = np.frombuffer(content[4 + size :], "<f8")
    table = numbers.reshape(len(header["columns"]), header["rows"])
    return header, dict(zip(header["columns"], table, strict=True))


def test_a_motion_at_other_values_is_that_of_a_run_with_them(file):
    explorer = explorer_of(file)
    for values in ({}, {"k": 8.0, "x": "0.1*pi"}, {"m": 1.0}):
        header, columns = unpacked(explorer.motion(values, "page"))
        k, m = float(values.get("k", 4)), float(values.get("m", 2))
        x0 = 0.1 * math.pi if "x" in values else 0.5
        expected = x0 * np.cos(math.sqrt(k / m) * columns["t"])
        # Six periods at rtol 1e-11, the default.
        np.testing.assert_allclose(columns["x"], expected, rtol=0, atol=1e-10)
        assert header["values"]["w"] == pytest.approx(math.sqrt(k / m), rel=1e-15)
        assert header["error"] == ""


def test_a_state_is_that_of_the_run_at_a_time_between_its_rows(file):
    explorer = explorer_of(file)
    run = lagsim.simulate(lagsim.load(file, k=8), error_bar="never")
    found = explorer.state({"k": 8.0}, 1.234, "page")
    assert list(found) == ["t", "x", "x_dot"]
    assert found == {name: run.at(1.234)[name] for name in found}
    assert explorer.state({}, 99.0, "page")["t"] == 3.0
    assert explorer.state({}, -1.0, "page")["t"] == 0.0


def test_sliders_are_those_of_plain_numbers_and_of_the_start(file):
    explorer = explorer_of(file)
    sliders = {x["name"]: x for x in explorer.document["sliders"]}
    assert list(sliders) == ["k", "m", "x", "x_dot"]
    ends = unpacked(explorer.motion({}, "page"))[0]["ends"]
    assert ends["k"] == [1.0, 9.0]
    assert ends["m"] == [0.0, 6.0]
    # x moves from -0.5 to 0.5 in rows 0.5 s apart; the slider covers twice that.
    low, high = ends["x"]
    assert high - low == pytest.approx(2.0, rel=0.05)
    assert (low + high) / 2 == pytest.approx(0.5)


def test_the_slider_of_an_angle_covers_a_period():
    explorer = explorer_of(MODELS / "double-pendulum.yaml")
    ends = unpacked(explorer.motion({}, "page"))[0]["ends"]
    assert ends["theta1"] == pytest.approx([-math.pi, math.pi])
    assert ends["theta1_dot"] != ends["theta1"]


def test_vary_names_the_sliders_and_their_ends(file):
    explorer = explorer_of(file, {"x": (-1.0, 2.0), "m": None})
    sliders = explorer.document["sliders"]
    assert [x["name"] for x in sliders] == ["x", "m"]
    assert unpacked(explorer.motion({}, "page"))[0]["ends"]["x"] == [-1.0, 2.0]
    with pytest.raises(LagsimError) as refused:
        explorer_of(file, {"kk": None})
    assert refused.value.code == "unknown-name"


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"nothing": 1.0}, "unknown-name"),
        ({"k": "__import__('os')"}, "expression-name"),
        ({"k": "1/0"}, "not-finite"),
        ({"k": math.inf}, "usage"),
        ({"k": "  "}, "usage"),
        ({"k": "1+" * 600 + "1"}, "usage"),
        ({"k": "x"}, "not-constant"),
    ],
)
def test_values_that_cannot_be_used_are_refused_and_leave_the_engine_whole(
    file, values, code
):
    explorer = explorer_of(file)
    with pytest.raises(LagsimError) as refused:
        explorer.motion(values, "page")
    assert refused.value.code == code
    assert unpacked(explorer.motion({}, "page"))[0]["error"] == ""


def test_a_run_that_fails_says_so_with_its_number(tmp_path):
    path = tmp_path / "blow-up.yaml"
    path.write_text(
        "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: -x^4}\n"
        "initial: {x: 1}\nsimulation: {duration: 5}\n"
    )
    explorer = explorer_of(path)
    header, _ = unpacked(explorer.motion({}, "page"))
    assert "[E5" in header["error"]
    with pytest.raises(LagsimError):
        explorer.state({}, 5.0, "page")
    assert explorer.state({"x": 1e-3}, 5.0, "page")["t"] == 5.0


def test_rows_are_thinned_to_a_screen(file):
    file.write_text(OSCILLATOR.replace("output_step: 0.5", "output_step: 0.0001"))
    header, columns = unpacked(explorer_of(file).motion({}, "page"))
    assert header["rows"] <= MOST_ROWS + 1
    assert columns["t"][-1] == 3.0


def test_a_file_that_was_saved_is_read_again_and_a_faulty_one_is_reported(file):
    explorer = explorer_of(file)
    assert not explorer.changed()
    file.write_text(OSCILLATOR.replace("m: 2", "m: 3"))
    assert explorer.changed()
    assert explorer.document["version"] == 2
    assert unpacked(explorer.motion({}, "page"))[0]["values"]["m"] == 3.0
    file.write_text(OSCILLATOR.replace("k*x^2/2", "k*y^2/2"))
    assert explorer.changed()
    assert "oscillator.yaml:6" in explorer.document["fault"]
    assert "^" in explorer.document["fault"]
    # The last sound model stays.
    assert unpacked(explorer.motion({}, "page"))[0]["values"]["m"] == 3.0
    file.write_text(OSCILLATOR)
    assert explorer.changed()
    assert explorer.document["fault"] == ""
    assert not explorer.changed()


def test_a_table_that_was_saved_changes_the_motion(tmp_path):
    (tmp_path / "force.csv").write_text("t,F\n0,1\n10,1\n")
    path = tmp_path / "pushed.yaml"
    path.write_text(
        "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: 0}\n"
        "tables: {push: {file: force.csv, x: t, y: F}}\nforces: {x: push(t)}\n"
        "initial: {x: 0}\nsimulation: {duration: 2}\n"
    )
    explorer = explorer_of(path)
    assert not explorer.changed()
    assert explorer.state({}, 2.0, "page")["x"] == pytest.approx(2.0, rel=1e-10)
    (tmp_path / "force.csv").write_text("t,F\n0,3\n10,3\n")
    assert explorer.changed()
    assert explorer.state({}, 2.0, "page")["x"] == pytest.approx(6.0, rel=1e-10)


def test_the_text_of_the_file_has_the_values_and_its_comments(file):
    explorer = explorer_of(file)
    text = explorer.text({"m": 2.5, "x": "1/4"})
    assert "m: 2.5 # kilograms" in text
    model = lagsim.load(text)
    assert lagsim.simulate(model, error_bar="never").at(0.0)["x"] == 0.25


def test_the_last_request_of_a_page_wins(tmp_path):
    path = tmp_path / "long.yaml"
    path.write_text(
        OSCILLATOR.replace("duration: 3", "duration: 9e5, method: rk4, step: 0.01")
    )
    explorer, ends = explorer_of(path), []

    def ask():
        try:
            explorer.motion({}, "page")
            ends.append("done")
        except SupersededError:
            ends.append("superseded")

    first = threading.Thread(target=ask)
    first.start()
    while not explorer._asked:
        pass
    second = threading.Thread(target=ask)
    second.start()
    first.join(60)
    assert ends == ["superseded"]
    explorer._asked["page", True].stop()
    second.join(60)
    assert ends == ["superseded"] * 2


def test_a_motion_ends_a_state_and_a_state_no_motion(tmp_path):
    path = tmp_path / "long.yaml"
    path.write_text(
        OSCILLATOR.replace("duration: 3", "duration: 9e5, method: rk4, step: 0.01")
    )
    explorer, ends = explorer_of(path), []

    def ask(what, *given):
        try:
            what({}, *given, "page")
            ends.append("done")
        except SupersededError:
            ends.append("superseded")

    state = threading.Thread(target=ask, args=(explorer.state, 9e5))
    state.start()
    while not explorer._asked:
        pass
    motion = threading.Thread(target=ask, args=(explorer.motion,))
    motion.start()
    state.join(60)
    assert ends == ["superseded"]
    late = threading.Thread(target=ask, args=(explorer.state, 9e5))
    late.start()
    motion.join(0.2)
    assert motion.is_alive()
    for interrupt in [*explorer._asked.values()]:
        interrupt.stop()
    motion.join(60)
    late.join(60)
    assert ends == ["superseded"] * 3


def test_equations_are_mathml_without_marks_of_the_file(file):
    found = explorer_of(file).equations()
    assert found.count("<math") == 1
    assert "<mi>x\u0308</mi>" in found


# --- Dragging


def test_a_dragged_bob_turns_the_angle_to_where_it_is():
    explorer = explorer_of(MODELS / "double-pendulum.yaml")
    target = [math.sin(1.0) + math.sin(0.2), -math.cos(1.0) - math.cos(0.2)]
    found = explorer.drag({}, 0.0, "lower", target, "page")
    x = math.sin(found["theta1"]) + math.sin(found["theta2"])
    y = -math.cos(found["theta1"]) - math.cos(found["theta2"])
    assert [x, y] == pytest.approx(target, abs=1e-8)


def test_a_point_out_of_reach_comes_as_near_as_it_can():
    explorer = explorer_of(MODELS / "pendulum-cartesian.yaml")
    found = explorer.drag({}, 0.0, "mass", [3.0, -4.0], "page")
    # On the circle of the rod, in the direction of the target.
    length = math.hypot(found["x"], found["y"])
    assert length == pytest.approx(1.0, rel=1e-12)
    assert found["x"] / length == pytest.approx(0.6, abs=1e-5)
    values = {name: float(x) for name, x in found.items()}
    assert unpacked(explorer.motion(values, "page"))[0]["error"] == ""
