"""Warnings on names and places: unused, in degrees, without a value or inertia."""

import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.run.session import check

SCENE = """\
parameters: {m: 1, tilt: {value: 0.5, unit: UNIT}, w: 60, alpha: ALPHA, MORE}
coordinates: {theta: {unit: UNIT}, x: {unit: m}}
definitions: {turned: {value: "theta - tilt", unit: UNIT}, seen: 'SEEN'}
energy: {kinetic: m*(theta_dot^2 + x_dot^2)/2, potential: 0*alpha*w}
initial: {theta: THETA, x: 30, theta_dot: 60}
simulation: {duration: DURATION}
"""
PLAIN = {
    "unit": "rad", "more": "k: 1", "seen": "k", "duration": "1", "theta": "tilt",
    "alpha": "0",
}  # fmt: skip


def filled(text, values):
    for name, value in values.items():
        text = text.replace(name.upper(), value)
    return text


def warned(keywords=None, scene=SCENE, **given):
    text = filled(scene, PLAIN | {"unit": "''"} | given)
    case, _ = check(read(text, "model.yaml", **(keywords or {})))
    found = [f"{w.code}: {w.text}" for w in case.examined.warnings]
    # Fillings of one file do not fit its units; tests/model/test_units_checked.py does.
    return [text for text in found if not text.startswith("unit-mismatch")]


# What enters a function, and what is said of it.
DEGREES = "degrees: `{0}` has the unit deg, and the argument of {1} is in radians: "
IN_DEGREES = [
    *[({"unit": "deg", "seen": f"k*{seen}"}, DEGREES.format(name, seen[:3]))
      for name, seen in (
          ("theta", "sin(theta)"), ("theta", "cos(theta + x)"),
          ("theta", "tan(2*theta)"), ("tilt", "sin(tilt)"), ("turned", "sin(turned)"),
      )],
    ({"unit": "deg", "seen": "k*x*sin(x - theta)"}, DEGREES.format("theta", "sin")),
    *[(given | {"unit": "rad", "more": "k: 1"}, f"degrees: {told}") for given, told in (
        ({"seen": "k*sin(theta)", "theta": "60"}, "`theta` starts at 60"),
        ({"seen": "k*x*cos(2*theta + x)", "theta": "-45"}, "`theta` starts at -45"),
        ({"seen": "k*cos(theta - alpha)", "alpha": "30"}, "`alpha` is 30"),
        ({"seen": "k*sin(theta)", "theta": "alpha", "alpha": "72"},
         "`theta` starts at 72"),
        ({"seen": "k*sin(w*t + alpha)", "alpha": "90"}, "`alpha` is 90"),
        ({"seen": "k*sin(theta + 120)"}, "a term is 120"),
        ({"theta": "cos(alpha)", "alpha": "15"}, "`alpha` is 15"),
        ({"seen": "k*sin(20)"}, "an angle is 20 and enters sin"),
        ({"alpha": "cos(-45)"}, "an angle is 45 and enters cos"),
        ({"theta": "tan(30)"}, "an angle is 30 and enters tan"),
    )],
    ({"seen": "k*tan(theta)", "theta": "22.5"}, "degrees: `theta` starts at 22.5"),
]  # fmt: skip


@pytest.mark.parametrize(("given", "told"), IN_DEGREES)
def test_an_angle_in_degrees_enters_a_function(given, told):
    [text] = warned(**given)
    assert text.startswith(told)
    assert "*pi/180" in text
    if given.get("unit") == "deg":
        assert warned(**given | {"unit": "rad"}) == []


@pytest.mark.parametrize(
    "given",
    [
        {"unit": "deg", "seen": "sin(theta*pi/180)"},
        {"unit": "deg", "seen": "theta + sin(x)"},
        {"unit": "deg", "seen": "exp(theta)"},
        {"seen": "sin(theta)", "theta": "60*pi/180"},
        {"seen": "sin(theta)", "theta": "1.0471975511965976"},
        {"seen": "sin(theta)", "theta": "6"},  # not yet a turn
        {"seen": "sin(2) + cos(3.7) + sin(10*t) + tan(20*pi/180) + sin(720)"},
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
def test_what_is_not_in_degrees(given):
    assert warned(**given | {"seen": f"k*({given['seen']})"}) == []


@pytest.mark.parametrize(("theta", "told"), [("60", 1), ("0.5", 0)])
def test_sums_of_sums_are_looked_through_once(theta, told):
    """Written out, the last has as many terms as a number of Fibonacci's: 1e12."""
    sums = "".join(f"a{k}: a{k - 1} + a{k - 2}, " for k in range(2, 60))
    scene = SCENE.replace("{turned", f"{{a0: x, a1: theta, {sums}turned")
    assert len(warned(scene=scene, unit="rad", seen="k*sin(a59)", theta=theta)) == told


def test_a_parameter_that_nothing_names():
    [text] = warned(more="k: 1, spare: 2*k")
    assert text == "unused-parameter: the parameter `spare` is given and used nowhere"
    [text] = warned(more='k: 1, "spare(1..3)": 2')
    assert text.endswith(
        "`spare.1` and 2 other members of `spare` are given and used nowhere"
    )
    assert warned(more="k: 1, spare: 2", seen="k + spare") == []
    # A mode that an event sets is a column.
    recorder = "modes: {seen_at: 0}\nevents: {e: {at: x <= 0, set: {seen_at: t}}}\n"
    assert warned(scene=SCENE + recorder) == []
    # It is named, though something else was said instead of it.
    instead = {"options": {"duration": "1"}}
    assert warned(instead, more="k: 1, T: 2", duration="T") == []
    assert warned({"overrides": {"k": "1"}}, more="T: 2, k: T") == []


# What has no value, no slope or no inertia, and the line of the file where it stands.
FAULTY = """\
coordinates: {x: , y: }
definitions:
  h: 'INNER'
  s: 'OUTER'
energy: {kinetic: 'KINETIC', potential: 'POTENTIAL'}
forces: {y: 'FORCE'}
constraints: {held: {relation: y_dot = 0, limit: 'LIMIT'}, floor: {relation: x >= 0,
  restitution: 0.5, friction: 'MU', slip: y_dot}}
initial: {x: 0, y: 1}
simulation: {duration: 1}
"""
SOUND = {
    "inner": "y", "outer": "y", "kinetic": "x_dot^2 + y_dot^2", "potential": "0",
    "force": "0", "limit": "1", "mu": "0.3",
}  # fmt: skip


def refused(**given):
    with pytest.raises(InputError) as raised:
        check(read(filled(FAULTY, SOUND | given), "other/second.yaml"))
    problems = raised.value.problems
    assert {p.file for p in problems} == {"other/second.yaml"}
    assert all(p.column >= 1 for p in problems)
    return [(p.code, p.line, p.text, p.hint) for p in problems]


AT_X = {"inner": "1/x^2", "outer": "h + y"}
NEGATIVE = "is nan at the start, where"
# Each is told once, by the innermost expression that brings it.
ONCE = [
    *[(AT_X | given, 3, "`1/x^2` in the definition `h` is inf at the start")
      for given in ({"potential": "s"}, {"force": "h"}, {"limit": "s"},
                    {"kinetic": "x_dot^2*s + y_dot^2"})],
    *[({"inner": root, "outer": s, "kinetic": f"y_dot^2 + {k}", "potential": V},
       3, f"in the definition `h` {NEGATIVE} {where}")
      for root, s, k, V, where in (
          ("sqrt(x - 2)", "2*h", "h_dot^2 + x_dot^2", "s^2", "x - 2 is -2"),
          ("sqrt(x - 2)", "h + y", "x_dot^2", "sin(s)*h", "x - 2 is -2"),
          ("3 + log(x - 4*y)", "cos(h)", "x_dot^2", "s", "x - 4*y is -4"),
          ("(x - 2)^0.5", "h^2 + 1", "x_dot^2*s", "0", "x - 2 is -2"),
      )],
    # `h` is no number at the start either, but no energy uses it.
    (AT_X | {"kinetic": "(x_dot^2 + y_dot^2)^0.25"}, 5,
     " in `kinetic` has no finite slope at the start"),
    *[({where: bad}, line, bad) for where, line in (("force", 6), ("potential", 5),
                                                    ("limit", 7))
      for bad in ("asin(3*y)", "sqrt(x - 2)", "log(-y)", "1/x")],
    ({"kinetic": "1e308*10*(x_dot^2 + y_dot^2)"}, 5, ""),
    ({"kinetic": "1e200*1e200*y*(x_dot^2 + y_dot^2)"}, 5, ""),
]  # fmt: skip


@pytest.mark.parametrize(("given", "line", "told"), ONCE)
def test_what_is_not_finite_is_told_once_in_its_place(given, line, told):
    [(code, at, text, hint)] = refused(**given)
    assert (code, at) == ("not-finite", line)
    assert told in text
    assert "direction" not in hint or "slope" in told  # nothing of velocities
    assert "1/x^2" not in told or hint == "start, or guess, where x^2 is not 0"


@pytest.mark.parametrize(
    ("force", "advice"),
    [("x/m", "choose parameters with which m is not 0"),
     ("sqrt(m - 1)", "choose parameters with which m - 1 is positive"),
     ("1/(y - y0)", "start, or guess, where y - y0 is not 0"),
     ("1/0", "correct the expression"), ("y*log(-1)", "correct the expression")],
)  # fmt: skip
def test_the_advice_names_the_values_that_decide(force, advice):
    text = filled(FAULTY, SOUND | {"force": force}) + "parameters: {m: 0, y0: 1}\n"
    with pytest.raises(InputError) as raised:
        check(read(text, "model.yaml"))
    [problem] = raised.value.problems
    assert advice in problem.hint


def test_two_of_them_are_told_apart():
    found = refused(**AT_X, potential="log(x)", force="h")
    assert [(line, text.partition(", where ")[0]) for _, line, text, _ in found] == [
        (5, "`log(x)` in `potential` is -inf at the start"),
        (3, "`1/x^2` in the definition `h` is inf at the start"),
    ]


@pytest.mark.parametrize(
    "kinetic", ["x_dot^2", "x_dot^2 + 0*y_dot", "x_dot^2 - y_dot^2"]
)
def test_what_has_no_inertia_is_told_where_it_should_have_some(kinetic):
    [(code, line, *_)] = refused(kinetic=kinetic, potential="x")
    assert code in ("no-inertia", "negative-inertia")
    assert line == 5


def test_the_square_of_a_root_is_finite_at_rest():
    given = {"inner": "sqrt(x_dot^2 + y_dot^2)", "kinetic": "h^2"}
    case, _ = check(read(filled(FAULTY, SOUND | given), "model.yaml"))
    assert case.examined.admissible
