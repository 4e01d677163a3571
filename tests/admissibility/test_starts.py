"""Starts and reports on these: residuals, ranks, contradictions, thin sets."""

import math
import re
from operator import attrgetter

import numpy as np
import pytest

import lagsim
from lagsim.errors import InputError
from tests.admissibility.scenes import (
    ASKED,
    PARALLELOGRAM,
    check,
    codes,
    judged,
    scene,
    warning,
)
from tests.scenes.reference import model_text
from tests.support import refused, run

CIRCLE = "x^2 + y^2 = 1"
AT = {"x": 0.6, "y": 0.8}
ORIGIN = {"x": 0, "y": 0}
THREE = {"x": 0.6, "y": 0.8, "z": 0}

# --- Rows that others span, and rows that contradict

# Relations, a start, and what is expected of it.
ROWS = [
    # one too many: as combinations of those before
    ({"a": CIRCLE, "b": CIRCLE}, AT, {"rows": {"b": {"a": 1.0}}}),
    ({"a": CIRCLE, "b": CIRCLE, "c": CIRCLE}, AT,
     {"rows": {"b": {"a": 1.0}, "c": {"a": 1.0}}}),
    ({"a": CIRCLE, "b": "2*x^2 + 2*y^2 = 2"}, AT, {"rows": {"b": {"a": 2.0}}}),
    ({"a": CIRCLE, "b": "1 = hypot(x, y)"}, AT, {"rows": {"b": {"a": -0.5}}}),
    ({"a": "x = 0.6", "b": "y = 0.8", "c": "2*x - y = 0.4"}, AT,
     {"rows": {"c": {"a": 2.0, "b": -1.0}}, "texts": ["c = 2 a - b"]}),
    ({"a": "x = 0.6", "b": "y = 0.8", "c": "y - 2*x = -0.4"}, AT,
     {"texts": ["c = -2 a + b"], "rows": {"c": {"a": -2.0, "b": 1.0}}}),
    ({"a": "x = 0.6", "b": "x_dot = 0", "c": "y = 0.8"}, AT,
     {"rows": {"b": {"a": 1.0}}}),
]  # fmt: skip


@pytest.mark.parametrize(("relations", "initial", "expected"), ROWS)
def test_redundant_rows_are_named_as_combinations(relations, initial, expected):
    start = judged(scene(relations, initial))
    rows = expected["rows"]
    check(start, admissible=True, redundant=[*rows], **expected)
    assert all(d.everywhere for d in start.ranks.dependences)
    loose = {*rows, *(n for c in rows.values() for n in c)}
    assert set(start.ranks.not_unique) == loose
    text = warning(start, "multipliers-not-unique")
    assert ("; unique are" in text) is (loose != set(relations))
    assert codes(start).count("redundant") == len(rows)


@pytest.mark.parametrize(
    ("relations", "level", "size"),
    [
        ({"a": "x^2 + y^2 = 1", "b": "x^2 + y^2 = 2"}, "position", 1.0),
        ({"a": "x = -1", "b": "x = -1 + t"}, "velocity", 1.0),
        ({"a": "x = -1", "b": "x = -1 + t^2"}, "acceleration", 2.0),
        ({"a": "x_dot = y_dot", "b": "2*x_dot = 2*y_dot + 3"}, "velocity", 3.0),
        ({"a": "x = -1", "b": "x_dot = 1"}, "velocity", 1.0),
    ],
)
def test_contradictory_rows(relations, level, size):
    start = judged(scene(relations, {"x": -1, "y": 0}))
    text = f"`b` contradicts `a` on the level of {level}, by {size:g}"
    against = {"b": {level: size}}
    check(start, admissible=False, against=against, unsolved=text, repair=None)
    assert start.contradictions[0].contradiction() == text
    assert "multipliers-not-unique" not in codes(start)


# Relations, a start, and what is expected of it.
REST = {"x": 0, "y": 0, "z": 0}
TOO_MANY = {"admissible": True, "thin": None, "everywhere": [True]}
ONLY_HERE = TOO_MANY | {"everywhere": [False]}
OTHERS = [
    # At x = 2 the second is a quarter of the first in its row, and not in its value.
    ({"a": CIRCLE, "b": "sqrt(x^2 + y^2) = 1"}, {"x": 2, "y": 0},
     {"admissible": False, "against": {}, "repair": {"x": 1.0},
      "rows": {"b": {"a": 0.5}}}),
    ("x^2 + y^2 = 0", {"x": 0, "y": 0, "x_dot": 3},
     {"against": {"a": {"acceleration": 18.0}},
      "unsolved": "`a` cannot be satisfied on the level of acceleration"}),
    # small, but exact: no gradient of rounding
    ("1e-30*x + 1e-31*y = 0", ORIGIN, {"ranks": (1, 1)}),
    ("x^2 = 1e-40", {"x": 1e-20, "y": 1}, {"ranks": (1, 1)}),
    # what is asked of velocities vanishes at rest
    ("x_dot^2 + y_dot^2 = 4*z_dot^2", REST,
     {"admissible": True, "ranks": (0, 1), "everywhere": [False]}),
    ("x_dot^2 + y_dot^2 = 4*z_dot^2", REST | {"x_dot": 2, "z_dot": 1},
     {"ranks": (1, 1)}),
    # a double root is satisfied as a simple one
    *[("x^2 = 0", {"x": x, "y": 0},
       {"admissible": True, "codes": ["multiple-root"], "degrees_of_freedom": 1})
      for x in ("{guess: 1}", "0")],
    # what is no thin set
    ({"a": CIRCLE, "b": "hypot(x, y) = 1"}, THREE, TOO_MANY),
    ({"a": "x = 0.6", "b": "(x - 0.6)^2 = 0"}, THREE, TOO_MANY),
    ({"a": "x = 0.6", "b": "x^2 - 1.2*x + 0.36 = 0"}, THREE, TOO_MANY),
    ("(x - 0.6)*(y - 0.8) = 0", THREE, ONLY_HERE),
    ({"a": "z = 0", "b": "z = (x - 0.6)^2 - (y - 0.8)^2"}, THREE, ONLY_HERE),
    ("(x - 0.6)^2 + z^2 = (y - 0.8)^2", THREE, ONLY_HERE),
    # beside a thin set there is no repair
    ("x^2 + y^2 = 0", {"x": 0.3, "y": 0.2},
     {"admissible": False, "repair": None, "unsolved": "multiple root"}),
    # what cannot be satisfied is named with the point of least residual
    ("x^2 + y^2 = -1", {"x": 1, "y": 1},
     {"admissible": False, "repair": None, "against": {}, "degrees_of_freedom": 1,
      "unsolved": "`a` cannot be satisfied near there: the least |residual| is 1, at"}),
    ("x^2 + y^2 = -1", {"x": "{guess: 1}", "y": "{guess: 1}"},
     {"admissible": False, "repair": None, "unsolved": "least |residual| is 1, at"}),
    ({"a": CIRCLE, "b": "x = 3"}, {"x": 1, "y": 0.1},
     {"repair": None, "unsolved": "`a` and `b` cannot be satisfied together near"}),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("relations", "initial", "expected"), OTHERS)
def test_what_is_found(relations, initial, expected):
    check(judged(scene(relations, initial)), **expected)


@pytest.mark.parametrize("angle", [1e-7, 1e-9])
def test_a_nearly_parallel_row_is_a_real_constraint(angle):
    start = judged(scene({"a": "x = 0", "b": f"x + {angle}*y = 0"}, ORIGIN))
    check(start, ranks=(2, 2), degrees_of_freedom=0, warnings=())
    # Two unit rows at that angle: the smaller singular value is angle/sqrt 2.
    assert start.ranks.smallest == pytest.approx(angle / math.sqrt(2.0), rel=1e-6)


LINKAGE = {"b": "a", "c": 0, "x": "0.5 + cos(a)", "y": "sin(a)"}


def parallelogram(angle, b_dot="1"):
    """Return cranks at an angle, turning at rate 1, joined by a coupler."""
    rates = {"a_dot": 1, "b_dot": b_dot, "x_dot": "-sin(a)", "y_dot": "cos(a)"}
    return scene(PARALLELOGRAM, {"a": angle} | LINKAGE | rates)


@pytest.mark.slow
@pytest.mark.parametrize("angle", ["0", "pi"])
def test_a_singular_configuration_is_told_from_a_relation_too_many(angle):
    start = judged(parallelogram(angle))
    check(start, admissible=True, ranks=(3, 4), everywhere=[False])
    assert 1e-3 < start.ranks.generic_smallest < 1
    assert "singular configuration" in warning(start, "redundant")
    assert judged(parallelogram("0.5")).ranks.rank == 4
    # Collinear, it may open both ways, but not at rates between.
    assert not judged(parallelogram(angle, b_dot="0.5")).admissible
    # p0 is one too many everywhere; one of the others is lost as well.
    more = 'constraints:\n  p0: "x - cos(c)/2 = cos(a)"'
    start = judged(parallelogram(angle).replace("constraints:", more))
    check(start, ranks=(3, 4), everywhere=[True, False], redundant=["p1", "p3"])


@pytest.mark.slow
def test_bricard():
    start = judged(model_text("bricard"))
    check(start, admissible=True, ranks=(23, 23), everywhere=[True])
    assert (len(start.verdicts), start.degrees_of_freedom) == (24, 1)


@pytest.mark.parametrize("at", ["pi/2", "3*pi/2", "-pi/2"])
def test_a_gradient_of_rounding_vanishes(at):
    # At the dead centre the row of `across` is (cos a, cos b, 0): 6e-17.
    def slider_crank(angle):
        """Return a crank and a rod of length 1 at an angle, turning at rate 1."""
        places = {"a": angle, "b": "-a", "x": "2*cos(a)"}
        rates = {"a_dot": 1, "b_dot": -1, "x_dot": "-2*sin(a)"}
        rows = {"along": "cos(a) + cos(b) = x", "across": "sin(a) + sin(b) = 0"}
        return scene(rows, places | rates)

    start = judged(slider_crank(at))
    check(start, admissible=True, ranks=(1, 2), rows={"across": {}}, everywhere=[False])
    assert "only here" in warning(start, "vanishing-gradient")
    assert start.ranks.not_unique == ("across",)
    assert judged(slider_crank(f"{at} + 1e-6")).ranks.rank == 2


# Relations, a start, and the coordinates that are lengths.
PATH = {"path": "u = 1 - theta^2"}
PLACED = [
    *[(PARALLELOGRAM, {"a": angle} | LINKAGE, "xy") for angle in ("0", "0.5", "pi")],
    *[({"a": CIRCLE, "b": f"2*x^2 + 2*y^2 = {square}"}, AT, "x")
      for square in (2.0, 2.001)],
    *[(PATH, {"theta": 0.5, "u": 0.75 + off, "theta_dot": 1, "u_dot": rate - 1.0}, "u")
      for off, rate in ((0, 0), (2e-7, 0), (3e-6, 0), (0, 3e-6), (1.25, 6.0))],
]  # fmt: skip


def elsewhere(relations, initial, lengths, shift, unit, factor):
    """Return a scene in other units, far away, with its last row scaled."""

    def told(text):
        for q in lengths:
            text = re.sub(rf"\b{q}\b", f"({q}/{unit!r} - {shift!r})", str(text))
            text = text.replace(f"{q}_dot", f"({q}_dot/{unit!r})")
        return text

    rows = {name: told(relation) for name, relation in relations.items()}
    left, _, right = rows[name := [*rows][-1]].partition("=")
    rows[name] = f"{factor!r}*({left} - ({right})) = 0"
    at = {q: told(value) for q, value in initial.items()}
    for q in lengths:
        at[q] = f"{unit!r}*({at[q]} + {shift!r})"
        if f"{q}_dot" in at:
            at[f"{q}_dot"] = f"{unit!r}*({at[f'{q}_dot']})"
    names = [q for q in initial if not q.endswith("_dot")]
    return scene(rows, at, kinetic=told(" + ".join(f"{q}_dot^2/2" for q in names)))


@pytest.mark.slow
@pytest.mark.parametrize(("relations", "initial", "lengths"), PLACED)
@pytest.mark.parametrize(
    ("shift", "unit", "factor"),
    [(1e3, 1.0, 1.0), (1e6, 1.0, 1.0), (0.0, 1e-6, 1e-8), (0.0, 1e3, 1e8)],
)
def test_neither_place_nor_units_nor_the_scale_of_a_row_count(
    relations, initial, lengths, shift, unit, factor
):
    plain = judged(scene(relations, initial))
    start = judged(elsewhere(relations, initial, lengths, shift, unit, factor))
    for key in ("admissible", "codes", "everywhere", "redundant", "ranks"):
        check(start, **{key: ASKED.get(key, attrgetter(key))(plain)})
    assert start.ranks.not_unique == plain.ranks.not_unique
    against = ASKED["against"]
    assert against(start).keys() == against(plain).keys()
    assert start.ranks.smallest == pytest.approx(plain.ranks.smallest, rel=1e-6)
    assert (plain.repair or {}).keys() == (start.repair or {}).keys()
    for name, value in (plain.repair or {}).items():
        is_length = name.removesuffix("_dot") in lengths
        found = start.repair[name] / (unit if is_length else 1.0)
        found -= shift if name in lengths else 0.0
        assert found == pytest.approx(value, abs=1e-9)


# --- Residuals, bounds and reasons

CURVE = scene(
    {"path": "u = l - l*theta^2"},
    {"theta": "THETA", "u": "U", "theta_dot": "TD", "u_dot": "UD"},
    kinetic="((l + u)^2*theta_dot^2 + u_dot^2)/2",
    potential="9.8*(l - (l + u)*cos(theta)) + 12.8*u^2",
    parameters="l: 1",
)


def curve(theta="1", u="l - l*theta^2", theta_dot="0", u_dot="0"):
    text = CURVE.replace("THETA", theta).replace("TD", theta_dot)
    return text.replace("UD", u_dot).replace("U", u)


def test_velocities_off_the_curve():
    start = judged(curve(theta="0.5", theta_dot="1"))
    [path] = start.verdicts
    assert path.position.satisfied
    assert path.velocity.value == 1.0  # 2 l theta theta' + u'
    assert (path.velocity.scale, path.velocity.bound) == (1.0, 1e-6)
    assert "largest term" in path.velocity.why
    assert not path.satisfied
    # theta' and u' alone change; least change in the metric diag((l + u)^2, 1) along
    # the row (1, 1) of their relation.
    weight = 1.0 / 1.75**2
    moved = 1.0 / (weight + 1.0)
    expected = {"theta_dot": 1.0 - weight * moved, "u_dot": -moved}
    assert start.repair == pytest.approx(expected, rel=1e-12)


def test_a_start_within_the_rounding_of_its_expressions():
    start = judged(scene("x = 0", {"x": "l*cos(pi/2)", "y": 0}, parameters="l: 1e6"))
    [a] = start.verdicts
    check(start, admissible=True, warnings=())
    assert 0 < abs(a.position.value) < a.position.bound < 1e-8
    assert a.position.why == "the rounding error of the start"
    assert start.state.q[0] == a.position.value  # not moved
    assert not judged(scene("x = 0", {"x": 1e-10, "y": 0})).admissible


OFF = "as if the start had been typed with"
# A text, and what is said of digits that were typed.
ROUGH = [
    (curve(theta="0.7", u="0.5100003", theta_dot="1", u_dot="-1.4"),
     f"`path` is off by 3e-07, {OFF} 6 digits; write u: l - l*theta^2"),
    (curve(theta="0.7", theta_dot="1", u_dot="-1.4000003"),
     f"{OFF} 6 digits; mark theta_dot or u_dot as {{guess: ...}}"),
    (scene({}, {"a": "pi/6", "h": "0.8660253"}, definitions="h: cos(a)"),
     "the start value `h: 0.8660253` is off by 1e-07, as if"),
    (scene("y = k*x^2", {"x": 0.3, "y": 0.0900000001}, parameters="k: 1"),
     "write y: k*x^2"),
    (scene("y = k*x^2", {"y": 0.0900000001, "x": 0.3}, parameters="k: 1"),
     "mark y or x as {guess: ...}"),
    # an advice does not use the time
    (scene("y = x + t", {"x": 0.3, "y": 0.30000001, "y_dot": 1}),
     "mark x or y as {guess: ...}"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "told"), ROUGH)
def test_typed_digits_are_told_with_what_could_be_written(text, told):
    start = judged(text)
    assert start.admissible
    assert told in warning(start, "rough-start")
    assert start.changes or "start value" in told


# --- Inertia, and forces

QUATERNION = scene(
    {"unit": "q0^2 + q1^2 + q2^2 + q3^2 = 1"},
    {"q0": 1, "q1": 0, "q2": 0, "q3": 0, "q1_dot": 0.05, "q2_dot": 0.5},
    definitions=(
        "w1: 2*(q0*q1_dot - q1*q0_dot + q3*q2_dot - q2*q3_dot)\n"
        "w2: 2*(q0*q2_dot - q2*q0_dot + q1*q3_dot - q3*q1_dot)\n"
        "w3: 2*(q0*q3_dot - q3*q0_dot + q2*q1_dot - q1*q2_dot)"
    ),
    kinetic="(w1^2 + 2*w2^2 + 3*w3^2)/2",
)
TURNED = QUATERNION.replace("q0: 1", "q0: 0.6").replace("q3: 0\n", "q3: -0.8\n")
TURNED = TURNED.replace("  q1_dot: 0.05\n  q2_dot: 0.5\n", "")
LIGHT = {"kinetic": "x_dot^2/2"}


@pytest.mark.parametrize(
    ("text", "freedom"),
    [
        (QUATERNION, 3),
        (TURNED, 3),
        (model_text("huygens_cycloid"), 1),
        (scene("1e-8*(x - 1e6*y) = 0", ORIGIN, **LIGHT), 1),
        (scene("1e8*(x - 1e6*y) = 0", ORIGIN, **LIGHT), 1),
    ],
)
def test_constraints_determine_what_has_no_inertia(text, freedom):
    check(judged(text), admissible=True, augmented=True, degrees_of_freedom=freedom)


@pytest.mark.parametrize(
    ("relations", "kinetic", "code", "name"),
    [
        ({}, "x_dot^2/2", "no-inertia", "coordinate y "),
        ({}, "(x_dot + y_dot)^2/2", "no-inertia", " x - y "),
        ({}, "x_dot^2/2 - y_dot^2/2", "negative-inertia", "coordinate y "),
        ({}, "x_dot^2/2 + 2*x_dot*y_dot", "negative-inertia", " -0.7808 x + y "),
        # A row of rounding completes nothing.
        ("sin(b)*x + y = 0", "y_dot^2/2", "no-inertia", "coordinate x "),
        # With x = y it would be 2 - 1 = 1 in sum.
        ("x = y", "x_dot^2 - y_dot^2/2", "negative-inertia", "coordinate y "),
    ],
)
def test_what_has_no_inertia_is_refused_by_name(relations, kinetic, code, name):
    with refused(code, name):
        judged(scene(relations, ORIGIN, kinetic=kinetic, parameters="b: pi"))


PLANE = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
definitions: {{speed: "{speed}"}}
forces: {{x: 1 - 3*x_dot/speed, y: -3*y_dot/speed}}
initial: {{x: 0, y: 0, x_dot: {v}, y_dot: {v}}}
simulation: {{duration: 2, output_step: 0.5}}
"""


@pytest.mark.parametrize("speed", ["hypot(x_dot, y_dot)", "sqrt(x_dot^2 + y_dot^2)"])
def test_a_direction_at_rest_is_refused_with_what_to_write(speed):
    with pytest.raises(InputError) as caught:
        judged(PLANE.format(speed=speed, v=0))
    assert {p.code for p in caught.value.problems} == {"not-finite"}
    assert all("hypot(" in p.hint for p in caught.value.problems)


@pytest.mark.slow
@pytest.mark.parametrize("v", [0, 1])
def test_what_is_to_be_written_comes_to_rest_but_for_a_creep(v):
    found = run(PLANE.format(speed="hypot(1e-4, hypot(x_dot, y_dot))", v=v))
    # Held by 1/3 of the friction: u = 1/3 hypot(c, u).
    assert found["x_dot"][-1] == pytest.approx(1e-4 / 8**0.5, rel=1e-6)
    assert abs(found["y_dot"][-1]) < 1e-9


def test_numbers_out_of_scale_are_those_that_count():
    """A parameter without use is not named."""
    text = (
        "parameters: {unused: 1e-305, large: 1e300}\n"
        "coordinates: {x: , y: }\n"
        "energy: {kinetic: 1e-200*x_dot^2/2 + y_dot^2/2, potential: x}\n"
        "constraints: {c: large*x*y + 1e-300*y^3 = 1e154}\ninitial: {x: 2, y: 1}\n"
    )
    with pytest.raises(InputError) as raised, np.errstate(all="ignore"):
        run(text + "simulation: {duration: 1}\n")
    [problem] = raised.value.problems
    assert problem.text.endswith("(1e-300, `large` is 1e+300)")


TABLE = "tables: {v: {points: [[-1, 0.25], [0, 0], [1, 0.5]], outside: extend}}"
CORNERS = {
    "abs": ("0.25*abs(x)", 0.25, -0.25),
    "if": ("if(x < 0, -0.25*x, 0.5*x)", 0.5, -0.25),
    "max": ("max(-0.25*x, 0.5*x)", 0.5, -0.25),
    "root": ("0.25*sqrt(x^2) + 0.1*x", 0.35, -0.15),
    "table": ("v(x)", 0.5, -0.25),
}


@pytest.mark.parametrize("wire", CORNERS)
@pytest.mark.parametrize("speed", [0.2, -0.2])
def test_a_speed_in_a_corner_is_on_the_side_onto_which_it_leads(wire, speed):
    relation, right, left = CORNERS[wire]
    rate = speed * (right if speed > 0 else left)
    for stated in ("{guess: 0}", repr(rate)):
        text = f"""
        {TABLE if wire == "table" else ""}
        coordinates: {{x: {{}}, y: {{}}}}
        energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}}
        constraints: {{wire: "y = {relation}"}}
        initial: {{x: 0, y: 0, x_dot: {speed}, y_dot: {stated}}}
        simulation: {{duration: 1, output_step: 0.5}}
        """
        result = lagsim.simulate(text, error_bar="never")
        # No impact: without forces the bead keeps its speed.
        assert not [e for e in result.events if e.kind == "corner"]
        assert result["y_dot"] == pytest.approx(rate, rel=1e-12)
        assert result["x"] == pytest.approx(speed * result.t, rel=1e-12)
