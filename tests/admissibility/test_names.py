"""What is said of names and places: unused, in degrees, without a value or inertia."""

from __future__ import annotations

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.run.session import check

SCENE = """\
parameters: {{m: 1, tilt: {{value: 0.5, unit: {unit}}}, {more}}}
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


ANGLES = """\
parameters: {{alpha: {alpha}, w: 60}}
coordinates: {{theta: {{unit: {unit}}}, x: {{unit: m}}}}
definitions: {{seen: {seen}}}
energy: {{kinetic: (theta_dot^2 + x_dot^2)/2, potential: 0*alpha*w}}
initial: {{theta: {theta}, x: 30, theta_dot: 60}}
"""


def angles(seen, theta="0", alpha="0", unit="rad"):
    text = ANGLES.format(seen=seen, theta=theta, alpha=alpha, unit=unit)
    case, _ = check(read(text, "model.yaml"))
    return [w.text for w in case.examined.warnings if w.code == "degrees"]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"seen": "sin(theta)", "theta": "60"}, "`theta` starts at 60"),
        ({"seen": "x*cos(2*theta + x)", "theta": "-45"}, "`theta` starts at -45"),
        ({"seen": "tan(theta)", "theta": "22.5", "unit": "''"}, "starts at 22.5"),
        ({"seen": "cos(theta - alpha)", "alpha": "30"}, "`alpha` is 30"),
        ({"seen": "sin(theta)", "theta": "alpha", "alpha": "72"}, "starts at 72"),
        ({"seen": "sin(w*t + alpha)", "alpha": "90"}, "`alpha` is 90"),
        ({"seen": "sin(theta + 120)"}, "a term is 120"),
        ({"seen": "theta", "theta": "cos(alpha)", "alpha": "15"}, "`alpha` is 15"),
    ],
)
def test_a_number_of_degrees_enters_a_function(given, told):
    [text] = angles(**given)
    assert told in text
    assert text.endswith("*pi/180")


@pytest.mark.parametrize(
    "given",
    [
        {"seen": "sin(theta)", "theta": "60*pi/180"},
        {"seen": "sin(theta)", "theta": "1.0471975511965976"},
        {"seen": "sin(theta)", "theta": "6"},  # not yet a turn
        {"seen": "sin(theta)", "theta": "103.84"},  # has turned 16 times
        {"seen": "sin(theta)", "theta": "20*pi"},
        {"seen": "sin(theta)", "theta": "720"},
        {"seen": "sin(x)"},  # a length
        {"seen": "sin(w*t) + cos(theta*w) + theta_dot"},  # a rate
        {"seen": "sin(30*theta)"},
        {"seen": "sin(alpha*pi/180)", "alpha": "30"},
        {"seen": "sin(theta/alpha)", "alpha": "30"},
        {"seen": "exp(alpha)*alpha", "alpha": "30"},
        {"seen": "sin(theta_dot)"},
        {"seen": "sin(theta)", "theta": "w/30"},
        {"seen": "sin(t - 10)"},  # later by 10 seconds
        {"seen": "cos(2*(x + alpha))", "alpha": "30"},  # farther by 30 metres
        {"seen": "sin(theta*x)*cos(alpha - t)", "alpha": "45"},
    ],
)
def test_numbers_that_are_no_degrees(given):
    assert angles(**given) == []


@pytest.mark.parametrize(("theta", "told"), [("60", 1), ("0.5", 0)])
def test_sums_of_sums_are_looked_through_once(theta, told):
    """Written out, the last has as many terms as a number of Fibonacci's: 1e12."""
    sums = "".join(f"a{k}: a{k - 1} + a{k - 2}, " for k in range(2, 60))
    text = ANGLES.replace("{{seen", f"{{{{a0: x, a1: theta, {sums}seen")
    text = text.format(seen="sin(a59)", theta=theta, alpha="0", unit="rad")
    case, _ = check(read(text, "model.yaml"))
    found = [w.text for w in case.examined.warnings if w.code == "degrees"]
    assert len(found) == told


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


def refused(kinetic, potential="0", force="0"):
    text = FAULTY.replace("KINETIC", kinetic).replace("POTENTIAL", potential)
    with pytest.raises(InputError) as raised:
        check(read(text.replace("FORCE", force), "model.yaml"))
    return [(p.code, p.line, p.text.partition(", where ")[0], p.hint)
            for p in raised.value.problems]  # fmt: skip


SQUARES = "x_dot^2 + y_dot^2"
SLOW = ("not-finite", 4, "`1/x^2` in the definition `slow` is inf at the start",
        "start, or guess, where x^2 is not 0")  # fmt: skip


@pytest.mark.parametrize(
    "given", [(SQUARES, "sum"), (SQUARES, "0", "slow"), ("x_dot^2*sum + y_dot^2",)]
)
def test_what_is_not_finite_is_told_once_by_what_brings_it(given):
    assert refused(*given) == [SLOW]


def test_what_nothing_uses_brings_nothing():
    # `slow` is no number at the start either, but no energy knows it.
    [(_, line, text, _)] = refused("(x_dot^2 + y_dot^2)^0.25")
    assert " in `kinetic` has no finite slope at the start" in text
    assert line == 6


def test_two_of_them_are_told_apart():
    found = refused(SQUARES, "log(x)", "slow")
    assert [text for _, _, text, _ in found] == [
        "`log(x)` in `potential` is -inf at the start", SLOW[2],
    ]  # fmt: skip
    assert [line for _, line, *_ in found] == [6, 4]


@pytest.mark.parametrize(
    ("s", "h", "kinetic", "potential", "where"),
    [
        ("sqrt(x - 2)", "2*s", "s_dot^2 + x_dot^2", "h^2", "x - 2 is -1"),
        ("sqrt(x - 2)", "s + y", "x_dot^2", "sin(h)*s", "x - 2 is -1"),
        ("3 + log(y - 4*x)", "cos(s)", "x_dot^2", "h", "y - 4*x is -4"),
        ("(x - 2)^0.5", "s^2 + 1", "x_dot^2*h", "0", "x - 2 is -1"),
    ],
)
def test_not_finite_is_reported_once_at_its_innermost_expression(
    s, h, kinetic, potential, where
):
    text = f"""\
coordinates: {{x: , y: }}
definitions:
  h: {h}
  s: {s}
energy: {{kinetic: y_dot^2 + {kinetic}, potential: {potential}}}
forces: {{y: s}}
initial: {{x: 1, y: 0, y_dot: 0}}
"""
    with pytest.raises(InputError) as raised:
        check(read(text, "model.yaml"))
    [problem] = raised.value.problems
    assert f"in the definition `s` is nan at the start, where {where}" in problem.text
    assert problem.line == 4
    assert "direction" not in problem.hint  # nothing of velocities


@pytest.mark.parametrize(
    "kinetic", ["x_dot^2", "x_dot^2 + 0*y_dot", "x_dot^2 - y_dot^2"]
)
def test_what_has_no_inertia_is_told_where_it_should_have_some(kinetic):
    [(code, line, *_)] = refused(kinetic, "x")
    assert code in ("no-inertia", "negative-inertia")
    assert line == 6


def test_the_square_of_a_root_is_finite_at_rest():
    text = FAULTY.replace("KINETIC", "speed^2").replace("POTENTIAL", "0")
    text = text.replace("FORCE", "0").replace("slow: 1/r", "slow: y")
    text = text.replace("  r: x^2", "  speed: sqrt(x_dot^2 + y_dot^2)")
    case, _ = check(read(text, "model.yaml"))
    assert case.examined.admissible


# Of each what is not finite, and the line of the file where it is written.
PLANE = """\
coordinates: {{x: {{}}, y: {{}}}}
definitions: {{d: '{definition}'}}
energy:
  kinetic: '{mass}*(x_dot^2 + y_dot^2)/2'
  potential: '{potential}'
forces:
  x: '{force}'
constraints:
  held: {{relation: 'y_dot = 0', limit: '{limit}'}}
  floor: {{relation: 'x >= 0', restitution: 0.5, friction: '{mu}', slip: y_dot}}
initial: {{x: 1, y: 0.5}}
simulation: {{duration: 1}}
"""
SOUND = {
    "definition": "x*y", "mass": "1", "potential": "9.81*x", "force": "d", "limit": "1",
    "mu": "0.3",
}  # fmt: skip
BAD = ["asin(3*x)", "sqrt(y - 2)", "log(-x)", "1/(x - 1)"]
WHERE = {"definition": 2, "force": 7, "limit": 9, "potential": 5}
CASES = [({where: bad}, {line}) for where, line in WHERE.items() for bad in BAD] + [
    ({"limit": "d", "definition": BAD[0]}, {2, 9}),
    ({"potential": BAD[0], "force": BAD[1]}, {5, 7}),
    ({"mass": "1e308*10"}, {4}),
    ({"mass": "1e200*1e200*x"}, {4}),
]  # fmt: skip


@pytest.mark.parametrize(("changed", "lines"), CASES)
def test_what_is_not_finite_has_file_line_and_column(changed, lines):
    with pytest.raises(InputError) as raised:
        check(read(PLANE.format(**SOUND | changed), "other/second.yaml"))
    for problem in raised.value.problems:
        assert (problem.code, problem.file) == ("not-finite", "other/second.yaml")
        assert problem.line in lines
        assert problem.column >= 1
