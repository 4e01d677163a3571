"""What is said of names and places: unused, in degrees, without a value or inertia."""

from __future__ import annotations

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.run.session import check

SCENE = """\
parameters: {{m: 1, tilt: {{value: 30, unit: {unit}}}, {more}}}
coordinates: {{theta: {{unit: {unit}}}, x: {{unit: m}}}}
definitions: {{turned: {{value: "theta - tilt", unit: {unit}}}, seen: {seen}}}
energy: {{kinetic: m*(theta_dot^2 + x_dot^2)/2, potential: 0}}
initial: {{theta: tilt, x: 0}}
simulation: {{duration: {duration}}}
"""


def warned(unit="rad", more="k: 1", seen="k", duration="1", **keywords):
    text = SCENE.format(unit=unit, more=more, seen=seen, duration=duration)
    case, _ = check(read(text, "model.yaml", **keywords))
    return [(w.code, w.text) for w in case.examined.warnings]


@pytest.mark.parametrize(
    "seen",
    ["sin(theta)", "cos(theta + x)", "tan(2*theta)", "x*sin(x - theta)"],
)
def test_an_angle_in_degrees_enters_a_function(seen):
    [(code, text)] = warned(unit="deg", seen=f"k*{seen}")
    assert code == "degrees"
    assert "`theta` has the unit deg" in text
    assert "theta*pi/180" in text
    assert warned(unit="rad", seen=f"k*{seen}") == []


def test_so_do_parameters_and_definitions():
    [(_, text)] = warned(unit="deg", seen="k*sin(tilt)")
    assert "`tilt`" in text
    [(_, text)] = warned(unit="deg", seen="k*sin(turned)")
    assert "`turned`" in text


@pytest.mark.parametrize("seen", ["sin(theta*pi/180)", "theta + sin(x)", "exp(theta)"])
def test_degrees_that_are_converted_or_enter_nothing(seen):
    assert warned(unit="deg", seen=f"k*{seen}") == []


def test_a_parameter_that_nothing_names():
    [(code, text)] = warned(more="k: 1, spare: 2*k")
    assert (code, "`spare`" in text) == ("unused-parameter", True)
    assert warned(more="k: 1, spare: 2", seen="k + spare") == []
    # It is named, though something else was said instead of it.
    assert warned(more="k: 1, T: 2", duration="T", options={"duration": "1"}) == []
    assert warned(more="T: 2, k: T", overrides={"k": "1"}) == []


FAULTY = """\
coordinates: {x: , y: }
definitions:
  r: x^2
  slow: 1/r
  sum: slow + y
energy: {kinetic: KINETIC, potential: POTENTIAL}
forces: {y: FORCE}
initial: {x: 0, y: 1}
simulation: {duration: 1}
"""


@pytest.mark.parametrize(
    ("kinetic", "potential", "force", "told", "line"),
    [
        ("x_dot^2 + y_dot^2", "sum", "0", "the definition `slow`", 4),
        ("x_dot^2 + y_dot^2", "0", "slow", "the definition `slow`", 4),
        ("x_dot^2*sum + y_dot^2", "0", "0", "the definition `slow`", 4),
    ],
)
def test_what_is_not_finite_is_told_by_what_brings_it(
    kinetic, potential, force, told, line
):
    text = FAULTY.replace("KINETIC", kinetic).replace("POTENTIAL", potential)
    text = text.replace("FORCE", force)
    with pytest.raises(InputError) as raised:
        check(read(text, "model.yaml"))
    assert {p.code for p in raised.value.problems} == {"not-finite"}
    assert {(p.file, p.line) for p in raised.value.problems} == {("model.yaml", line)}
    assert all(p.text.endswith(f"by {told}") for p in raised.value.problems)


def test_what_nothing_uses_brings_nothing():
    # `slow` is no number at the start either, but no energy knows it.
    text = FAULTY.replace("KINETIC", "(x_dot^2 + y_dot^2)^0.25")
    text = text.replace("POTENTIAL", "0").replace("FORCE", "0")
    with pytest.raises(InputError) as raised:
        check(read(text, "model.yaml"))
    assert all(p.text.endswith("by `kinetic`") for p in raised.value.problems)
    assert {p.line for p in raised.value.problems} == {6}


def test_two_of_them_are_told_apart():
    text = FAULTY.replace("KINETIC", "x_dot^2 + y_dot^2")
    text = text.replace("POTENTIAL", "log(x)").replace("FORCE", "slow")
    with pytest.raises(InputError) as raised:
        check(read(text, "model.yaml"))
    found = {p.text.split()[0]: p for p in raised.value.problems}
    assert found["potential"].text.endswith("by `potential`")
    assert found["potential"].line == 6


@pytest.mark.parametrize(
    "kinetic", ["x_dot^2", "x_dot^2 + 0*y_dot", "x_dot^2 - y_dot^2"]
)
def test_what_has_no_inertia_is_told_where_it_should_have_some(kinetic):
    text = FAULTY.replace("KINETIC", kinetic)
    text = text.replace("POTENTIAL", "x").replace("FORCE", "0")
    with pytest.raises(InputError) as raised:
        check(read(text, "model.yaml"))
    [problem] = raised.value.problems
    assert problem.code in ("no-inertia", "negative-inertia")
    assert (problem.file, problem.line, problem.column) == ("model.yaml", 6, 19)


def test_the_square_of_a_root_is_finite_at_rest():
    text = FAULTY.replace("KINETIC", "speed^2").replace("POTENTIAL", "0")
    text = text.replace("FORCE", "0").replace("slow: 1/r", "slow: y")
    text = text.replace("  r: x^2", "  speed: sqrt(x_dot^2 + y_dot^2)")
    case, _ = check(read(text, "model.yaml"))
    assert case.examined.admissible
