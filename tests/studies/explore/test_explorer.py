"""Motions at values that a page sends, against runs of their own and closed forms."""

import json
import math
import struct
import threading

import numpy as np
import pytest

import lagsim
from lagsim.cli._faults import error_text
from lagsim.errors import LagsimError
from lagsim.outputs.animation import stage
from lagsim.studies.explore.explorer import MOST_ROWS, Explorer, SupersededError
from tests.support import MODELS, refused

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
    return Explorer(str(path), overrides, dict(vary), error_text)


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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_point_out_of_reach_comes_as_near_as_it_can():
    explorer = explorer_of(MODELS / "pendulum-cartesian.yaml")
    found = explorer.drag({}, 0.0, "mass", [3.0, -4.0], "page")
    # On the circle of the rod, in the direction of the target.
    length = math.hypot(found["x"], found["y"])
    assert length == pytest.approx(1.0, rel=1e-12)
    assert found["x"] / length == pytest.approx(0.6, abs=1e-5)
    values = {name: float(x) for name, x in found.items()}
    assert unpacked(explorer.motion(values, "page"))[0]["error"] == ""


def admits(model, values):
    """Whether a model's start is admissible with these values."""
    return lagsim.check(model.bind(**values)).admissible


@pytest.mark.slow
def test_a_target_far_out_of_reach_leaves_the_rods_as_long_as_they_are():
    engine = explorer_of(MODELS / "chain-cartesian.yaml")
    found = engine.drag({}, 0.5, "p5", [5.0, 5.0], "page")
    length = lagsim.load(MODELS / "chain-cartesian.yaml").parameter_values["l"]
    assert math.hypot(found["x1"], found["y1"]) == pytest.approx(length, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    # The slider without mass of a Jenkins element is where its limit lets it be.
    "name", sorted({x.stem for x in MODELS.glob("*.yaml")} - {"jenkins-element"})
)  # fmt: skip
def test_a_start_that_is_dragged_anywhere_is_admissible(name):
    engine, model = (
        explorer_of(MODELS / f"{name}.yaml"),
        lagsim.load(MODELS / f"{name}.yaml"),
    )
    settings = engine.session.case.settings
    points = stage(engine.model).points
    draw = np.random.default_rng([49, len(name), *name.encode()])
    for _ in range(4 if points else 0):
        t = settings.start + draw.uniform(0.0, 0.3) * settings.duration
        point = str(draw.choice(list(points)))
        # From a tenth of a unit to a thousand units away.
        size = 10.0 ** draw.uniform(-1.0, 3.0)
        target = size * draw.normal(size=len(points[point]))
        found = engine.drag({}, float(t), point, target.tolist(), "page")
        assert admits(model, found), (t, point, target.tolist())


def begun(engine, values):
    """Return the start of the motion from given coordinates and velocities."""
    header, columns = unpacked(engine.motion(values, "page"))
    assert header["error"] == ""
    return {name: column[0] for name, column in columns.items()}


@pytest.mark.slow
def test_a_point_that_is_dragged_into_a_floor_slides_along_it():
    engine = explorer_of(MODELS / "trebuchet.yaml")
    found = engine.drag({}, 0.0, "stone", [1.5, -2.0], "page")
    assert found["y"] == pytest.approx(0.0, abs=1e-12)
    # The distance to a target below the floor changes little near its least value.
    assert found["x"] == pytest.approx(1.5, abs=1e-5)
    # The sling, which holds at times, holds at the start.
    model = lagsim.load(MODELS / "trebuchet.yaml").parameter_values
    tip = [
        -model["l"] * math.sin(found["a"]),
        model["h"] - model["l"] * math.cos(found["a"]),
    ]
    far = math.hypot(found["x"] - tip[0], found["y"] - tip[1])
    assert far == pytest.approx(model["r"], rel=1e-12)
    assert begun(engine, found)["x"] == found["x"]
    # It leaves the floor when it is dragged upwards.
    up = engine.drag(found, 0.0, "stone", [1.5, 0.25], "page")
    assert up["y"] == pytest.approx(0.25, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(("ball", "target"), [("b1", 0.3), ("b5", -0.6), ("b2", 0.2)])
def test_a_dragged_ball_pushes_those_that_it_meets(ball, target):
    engine = explorer_of(MODELS / "newtons-cradle.yaml")
    found = engine.drag({}, 0.0, ball, [target, -0.95], "page")
    # Gaps of the balls, by hand: as far apart as a diameter.
    model = lagsim.load(MODELS / "newtons-cradle.yaml").parameter_values
    d, long = 2 * model["r"] + model["gap"], model["l"]
    x = [d * k + long * math.sin(found[f"a{k + 1}"]) for k in range(5)]
    y = [-long * math.cos(found[f"a{k + 1}"]) for k in range(5)]
    for k in range(4):
        far = math.hypot(x[k + 1] - x[k], y[k + 1] - y[k])
        assert x[k + 1] > x[k]
        assert far >= 2 * model["r"] * (1 - 1e-6)
    begun(engine, found)


@pytest.mark.slow
def test_a_dragged_block_stays_above_the_ground_with_both_corners():
    engine = explorer_of(MODELS / "rocking-block.yaml")
    found = engine.drag({}, 0.0, "right", [0.6, -0.4], "page")
    start = begun(engine, found)
    model = lagsim.load(MODELS / "rocking-block.yaml").parameter_values
    for side in (-1, 1):
        sine, cosine = math.sin(start["th"]), math.cos(start["th"])
        height = start["y"] + side * model["b"] * sine - model["h"] * cosine
        assert height >= -1e-6


# --- A start value that slides on constraints


@pytest.mark.slow
def test_a_coordinate_that_slides_takes_the_others_on_the_rod():
    engine = explorer_of(MODELS / "pendulum-cartesian.yaml")
    # The rod is horizontal: to first order x does not change. The weight pulls down.
    found = engine.start({}, "x", 0.6)
    assert found["x"] == pytest.approx(0.6, rel=1e-8)
    assert found["y"] == pytest.approx(-0.8, rel=1e-8)
    begun(engine, found)
    # Beyond the rod it comes as near as it can.
    beyond = engine.start({}, "x", 2.0)
    assert beyond["x"] == pytest.approx(1.0, abs=1e-5)


def test_a_velocity_that_slides_takes_the_others_along_the_rod():
    engine = explorer_of(MODELS / "pendulum-cartesian.yaml")
    values = {"x": 0.6, "y": -0.8}
    found = engine.start(values, "x_dot", 2.0)
    assert found == {"x_dot": pytest.approx(2.0), "y_dot": pytest.approx(1.5)}
    begun(engine, values | found)


def test_a_start_value_without_constraints_slides_alone(file):
    engine = explorer_of(file)
    assert engine.start({}, "x", 0.25) == {"x": 0.25}
    assert unpacked(engine.motion({}, "page"))[0]["held"] is False


@pytest.mark.slow
def test_a_length_that_no_force_depends_on_is_no_angle():
    engine = explorer_of(MODELS / "cart-pole.yaml")
    ends = unpacked(engine.motion({}, "page"))[0]["ends"]
    assert ends["theta"] == pytest.approx([-math.pi, math.pi])
    assert ends["x"] != pytest.approx([-math.pi, math.pi])


def test_a_direction_that_no_force_depends_on_is_an_angle():
    engine = explorer_of(MODELS / "heavy-top.yaml")
    ends = unpacked(engine.motion({}, "page"))[0]["ends"]
    assert ends["phi"] == pytest.approx([-math.pi, math.pi])


@pytest.mark.slow
def test_a_rate_that_only_rounding_changes_has_a_slider_of_its_size():
    engine = explorer_of(MODELS / "rolling-disk-steady.yaml")
    low, high = unpacked(engine.motion({}, "page"))[0]["ends"]["phi_dot"]
    assert (low, high) == pytest.approx((0.0, 3.0))


@pytest.mark.slow
def test_a_number_of_members_counts_from_1_and_may_leave_values_without_a_motion():
    engine = explorer_of(MODELS / "chain-angles.yaml")
    [slider] = [x for x in engine.document["sliders"] if x["name"] == "n"]
    assert slider["whole"]
    assert slider["low"] == 1.0
    header, columns = unpacked(engine.motion({"n": 3.0}, "page"))
    assert "a.4" not in header["values"]
    assert "a.3" in columns


@pytest.mark.parametrize(
    ("given", "place", "ends", "reason"),
    [
        ("[1, 2, 3]", "n", [3, 3], "3 values"),
        ("1", "n", [1, 9], ""),
        # A name of one member asks for two members at least.
        ("1", "2", [2, 9], ""),
    ],
)
def test_a_slider_counts_the_members_that_the_file_allows(
    file, given, place, ends, reason
):
    file.write_text(f"""\
parameters: {{n: 3, m(1..n): {given}}}
coordinates: {{x(1..n): {{}}}}
energy: {{kinetic: "sum(i = 1..n, m(i)*x_dot(i)^2)/2 + x_dot({place})^2", potential: 0}}
initial: {{x(1..n): 1}}
simulation: {{duration: 1}}
""")
    [slider] = [x for x in explorer_of(file).document["sliders"] if x["name"] == "n"]
    assert [slider["low"], slider["high"]] == ends
    assert reason in slider["fixed"]
    assert bool(slider["fixed"]) == bool(reason)


ROD = """\
parameters: {L: 1}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
constraints: {rod: x^2 + y^2 = L^2}
initial: {x: 0.6, y: -0.8, x_dot: 0.8, y_dot: 0.6}
simulation: {duration: 1}
"""


@pytest.mark.slow
def test_the_start_follows_a_parameter_that_makes_it_inadmissible(file):
    file.write_text(ROD)
    engine = explorer_of(file)
    with refused("inadmissible"):
        engine.motion({"L": 1.5}, "page")
    header, _ = unpacked(engine.motion({"L": 1.5}, "page", follow=True))
    # The nearest point of the circle lies in the direction of the point before.
    found = {name: float(x) for name, x in header["moved"].items()}
    assert [found["x"], found["y"]] == pytest.approx([0.9, -1.2], rel=1e-12)
    assert header["values"]["L"] == 1.5
    assert unpacked(engine.motion({"L": 1.5, **header["moved"]}, "page"))
    assert unpacked(engine.motion({}, "page", follow=True))[0]["moved"] == {}
    with pytest.raises(LagsimError):
        engine.motion({"L": "1/0"}, "page", follow=True)


def test_units_are_raised_as_in_print(file):
    file.write_text(OSCILLATOR.replace("m: 2 #", "m: {value: 2, unit: kg*m^2/m^2} #"))
    sliders = {x["name"]: x for x in explorer_of(file).document["sliders"]}
    assert sliders["m"]["unit"] == "kg*m²/m²"
