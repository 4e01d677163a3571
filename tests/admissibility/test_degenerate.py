"""Redundant rows, singular configurations, singular and indefinite M."""

from __future__ import annotations

import math

import pytest

from lagsim.errors import InputError
from tests.admissibility.scenes import (
    PARALLELOGRAM,
    codes,
    judged,
    parallelogram,
    scene,
    warning,
)
from tests.scenes.reference import model_text
from tests.support import run

CIRCLE = "x^2 + y^2 = 1"
AT = {"x": 0.6, "y": 0.8}


def combinations(start):
    return {d.name: dict(d.combination) for d in start.ranks.dependences}


@pytest.mark.parametrize(
    ("relations", "expected"),
    [
        ({"a": CIRCLE, "b": CIRCLE}, {"b": {"a": 1.0}}),
        ({"a": CIRCLE, "b": CIRCLE, "c": CIRCLE}, {"b": {"a": 1.0}, "c": {"a": 1.0}}),
        ({"a": CIRCLE, "b": "2*x^2 + 2*y^2 = 2"}, {"b": {"a": 2.0}}),
        ({"a": CIRCLE, "b": "1 = hypot(x, y)"}, {"b": {"a": -0.5}}),
        (
            {"a": "x = 0.6", "b": "y = 0.8", "c": "2*x - y = 0.4"},
            {"c": {"a": 2.0, "b": -1.0}},
        ),
        (
            {"a": "x = 0.6", "b": "x_dot = 0", "c": "y = 0.8"},
            {"b": {"a": 1.0}},
        ),
    ],
)
def test_redundant_rows_are_named_as_combinations(relations, expected):
    start = judged(scene(relations, AT))
    assert start.admissible
    found = combinations(start)
    assert found.keys() == expected.keys()
    for name, combination in expected.items():
        assert found[name] == pytest.approx(combination)
    assert all(d.everywhere for d in start.ranks.dependences)
    assert [v.redundant for v in start.verdicts] == [n in expected for n in relations]
    loose = {*expected, *(n for c in expected.values() for n in c)}
    assert set(start.ranks.not_unique) == loose
    text = warning(start, "multipliers-not-unique")
    assert ("; unique are those of" in text) is (loose != set(relations))
    assert codes(start).count("redundant") == len(expected)


def test_combinations_as_text():
    relations = {"c1": "x = 0.6", "c2": "y = 0.8", "c3": "2*x - y = 0.4"}
    start = judged(scene(relations, AT))
    [d] = start.ranks.dependences
    assert str(d) == "c3 = 2 c1 - c2"
    relations["c3"] = "y - 2*x = -0.4"
    [d] = judged(scene(relations, AT)).ranks.dependences
    assert str(d) == "c3 = -2 c1 + c2"


@pytest.mark.parametrize("angle", [1e-7, 1e-9])
def test_a_nearly_parallel_row_is_a_real_constraint(angle):
    start = judged(scene({"a": "x = 0", "b": f"x + {angle}*y = 0"}, {"x": 0, "y": 0}))
    assert start.ranks.rank == start.ranks.generic_rank == 2
    assert start.degrees_of_freedom == 0
    # Two unit rows at that angle: the smaller singular value is angle/sqrt 2.
    assert start.ranks.smallest == pytest.approx(angle / math.sqrt(2.0), rel=1e-6)
    assert not start.warnings


@pytest.mark.parametrize("angle", ["0", "pi"])
def test_a_singular_configuration_is_told_from_a_relation_too_many(angle):
    start = judged(parallelogram(angle))
    assert (start.ranks.rank, start.ranks.generic_rank) == (3, 4)
    assert 1e-3 < start.ranks.generic_smallest < 1
    assert [d.everywhere for d in start.ranks.dependences] == [False]
    assert "singular configuration" in warning(start, "redundant")
    assert judged(parallelogram("0.5")).ranks.rank == 4


def test_both_at_once():
    # p5 is one too many everywhere; at angle 0 one of the others is lost as well.
    text = parallelogram("0").replace(
        "constraints:", 'constraints:\n  p0: "x - cos(c)/2 = cos(a)"'
    )
    start = judged(text)
    assert (start.ranks.rank, start.ranks.generic_rank) == (3, 4)
    assert {d.name: d.everywhere for d in start.ranks.dependences} == {
        "p1": True,
        "p3": False,
    }


def test_bricard():
    start = judged(model_text("bricard"))
    assert start.admissible
    assert len(start.verdicts) == 24
    assert start.ranks.rank == start.ranks.generic_rank == 23
    assert start.degrees_of_freedom == 1
    [d] = start.ranks.dependences
    assert d.everywhere


def test_a_velocity_gradient_that_vanishes_at_rest():
    text = scene("x_dot^2 + y_dot^2 = 4*z_dot^2", {"x": 0, "y": 0, "z": 0})
    start = judged(text)
    assert start.admissible
    assert (start.ranks.rank, start.ranks.generic_rank) == (0, 1)
    assert start.ranks.dependences[0].everywhere is False
    assert "vanishing-gradient" in codes(start)
    moving = text.replace("z: 0\n", "z: 0\n  x_dot: 2\n  z_dot: 1\n")
    assert judged(moving).ranks.rank == 1


def test_a_double_root_is_met_as_a_simple_one():
    for x in ("{guess: 1}", "0"):
        start = judged(scene("x^2 = 0", {"x": x, "y": 0}))
        assert start.admissible
        assert start.state.q[0] == 0.0
        assert codes(start) == ["multiple-root"]
        assert start.degrees_of_freedom == 1


@pytest.mark.parametrize("unit", [1e-6, 1e3])
@pytest.mark.parametrize("factor", [1e-8, 1e8])
def test_ranks_depend_on_neither_scale_nor_units(unit, factor):
    def scaled(unit, factor):
        # The coupler's x in other units, and one row scaled.
        relations = {
            k: r.replace("x ", f"x/{unit!r} ") for k, r in PARALLELOGRAM.items()
        }
        relations["p3"] = f"{factor!r}*(x/{unit!r} + cos(c)/2 - 1 - cos(b)) = 0"
        start = judged(
            scene(
                relations,
                {"a": 0, "x": 1.5 * unit, "y": 0, "c": 0, "b": 0,
                 "a_dot": 1, "y_dot": 1, "b_dot": 1},
                kinetic=(
                    f"(a_dot^2 + b_dot^2 + x_dot^2/{unit!r}^2 + y_dot^2 + c_dot^2/12)/2"
                ),
            )
        )  # fmt: skip
        [d] = start.ranks.dependences
        [(name, coefficient)] = d.combination
        return start, (d.name, name, d.everywhere), coefficient

    plain, about, coefficient = scaled(1.0, 1.0)
    start, *same = scaled(unit, factor)
    assert same == [about, pytest.approx(coefficient * factor)]
    assert start.ranks.rank == plain.ranks.rank == 3
    assert start.ranks.smallest == pytest.approx(plain.ranks.smallest, rel=1e-9)
    assert start.ranks.generic_rank == plain.ranks.generic_rank == 4
    assert start.ranks.not_unique == plain.ranks.not_unique


# Inertia

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


@pytest.mark.parametrize("turned", [False, True])
def test_a_quaternion_body(turned):
    text = QUATERNION
    if turned:
        text = text.replace("q0: 1", "q0: 0.6").replace("q3: 0\n", "q3: -0.8\n")
        text = text.replace("  q2_dot: 0.5\n", "")
        text = text.replace("  q1_dot: 0.05\n", "")
    start = judged(text)
    assert start.admissible
    assert start.augmented
    assert start.degrees_of_freedom == 3


def test_huygens_cycloid():
    start = judged(model_text("huygens_cycloid"))
    assert start.admissible
    assert start.augmented


@pytest.mark.parametrize("factor", [1e-8, 1e8])
def test_a_massless_coordinate_with_a_constraint(factor):
    text = scene(f"{factor}*(x - 1e6*y) = 0", {"x": 0, "y": 0}, kinetic="x_dot^2/2")
    assert judged(text).augmented


def test_a_constraint_of_rounding_completes_nothing():
    text = scene(
        "sin(b)*x + y = 0", {"x": 0, "y": 0}, kinetic="y_dot^2/2", parameters="b: pi"
    )
    with pytest.raises(InputError, match="the coordinate x has no inertia"):
        judged(text)


@pytest.mark.parametrize(
    ("kinetic", "said"),
    [
        ("x_dot^2/2", "the coordinate y has no inertia"),
        ("(x_dot + y_dot)^2/2", "the combination of coordinates x - y has no inertia"),
        ("x_dot^2/2 - y_dot^2/2", "falls with the speed of the coordinate y"),
        ("x_dot^2/2 + 2*x_dot*y_dot", "the mass matrix is indefinite"),
    ],
)
def test_what_has_no_inertia_is_refused_by_name(kinetic, said):
    with pytest.raises(InputError, match=said):
        judged(scene({}, {"x": 0, "y": 0}, kinetic=kinetic))


def test_a_negative_mass_that_a_constraint_hides_is_refused():
    # With x = y it would be 2 - 1 = 1 in sum.
    text = scene("x = y", {"x": 0, "y": 0}, kinetic="x_dot^2 - y_dot^2/2")
    with pytest.raises(InputError, match="coordinate y"):
        judged(text)


# Forces

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
        run(PLANE.format(speed=speed, v=0))
    assert all("no direction" in p.hint for p in caught.value.problems)


@pytest.mark.slow
@pytest.mark.parametrize("v", [0, 1])
def test_what_is_to_be_written_comes_to_rest_but_for_a_creep(v):
    found = run(PLANE.format(speed="hypot(1e-4, hypot(x_dot, y_dot))", v=v))
    # Held by 1/3 of the friction: u = 1/3 hypot(c, u).
    assert found["x_dot"][-1] == pytest.approx(1e-4 / 8**0.5, rel=1e-6)
    assert abs(found["y_dot"][-1]) < 1e-9
