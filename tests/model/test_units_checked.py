"""Inconsistent units in expressions, with places and both units; consistent ones."""

import re

import pytest

import lagsim
from lagsim.model.reader import read, read_file
from tests.cli.conftest import lagsim as command  # noqa: F401
from tests.support import MODELS

TEXT = """\
parameters:
  l: {value: 1, unit: m}
  g: {value: 9.8, unit: m/s^2}
  K: {value: 25.6, unit: N/m}
  M: {value: 1, unit: kg}
  w: {value: 2, unit: rad/s}
  a: {value: 2, unit: "OTHER"}
  n: 3
coordinates: {theta: {unit: rad}, u: {unit: m}}
definitions:
  x: (l + u)*sin(theta)
  y: -(l + u)*cos(theta)
  new: EXPRESSION
energy: {kinetic: M*(x_dot^2 + y_dot^2)/2, potential: M*g*y + K*u^2/2}
initial: {theta: 0.1, u: 0.1}
simulation: {duration: 1}
"""


def found(expression="1", other="1", **sections):
    text = TEXT.replace("EXPRESSION", expression).replace("OTHER", other)
    for section, content in sections.items():
        text = re.sub(
            rf"(?m)^{section}:.*\n|\Z", f"{section}: {content}\n", text, count=1
        )
    model = read(text, "m.yaml")
    return [(x.place, x.text) for x in model.stated.mismatches(model)], text


# An expression, the unit of `a`, the marked part, and both units as they are told.
WRONG = [
    ("l + theta", "1", "+", "m and rad"),
    ("l + t", "1", "+", "m and s"),
    ("l + a*sin(2*t)", "s", "+", "m and s"),
    ("sin(l)", "1", "sin", "m"),
    ("l + sin(theta)", "1", "+", "m and a number"),
    ("l*sin(n) + theta", "1", "+", "m and rad"),
    ("1 - theta*(l - w)", "1", "-", "m and rad/s"),
    ("l^theta^u", "1", "^", "m"),
    ("max(l, theta)", "1", "max", "m and rad"),
    ("hypot(x, w)", "1", "hypot", "m and rad/s"),
    ("if(x > theta, 1, 2)", "1", ">", "m and rad"),
    ("mod(l, theta)", "1", "mod", "m and rad"),
    ("if(theta > 1, l, w)", "1", "if", "m and rad/s"),
    ("exp(-l)", "1", "exp", "m"),
    ("sqrt(K/M) + g", "1", "+", "1/s and m/s^2"),
    ("u_dot + u", "1", "+", "m/s and m"),
    ("l + a", "mm", "+", "m and mm"),
    ("M*g + a", "kN", "+", "N and kN"),
    ("2*pi*a + w", "rpm", "+", "rpm and rad/s"),
    ("t + l", "1", "+", "s and m"),
    ("x_dot^2 + x", "1", "+", "m^2/s^2 and m"),
    ("atan2(x, theta)", "1", "atan2", "m and rad"),
    ("log(a/l)", "mm", "log", "0.001"),
    ("a*u + K", "bar", "+", "kg/s^2 and N/m"),
]


@pytest.mark.parametrize(("expression", "other", "mark", "units"), WRONG)
def test_what_does_not_fit(expression, other, mark, units):
    [(place, text)], source = found(expression, other)
    line = source.splitlines()[place.line - 1]
    assert line == f"  new: {expression}"
    assert line[place.column - 1 :][: place.length] == mark
    pair = units.split(" and ")
    for unit in pair:
        assert unit in text


@pytest.mark.parametrize(
    ("expression", "other"),
    [
        ("sin(w*t) + theta + 1", "1"), ("l*theta + u + n", "1"), ("l + n*theta", "1"),
        ("l + 2", "1"), ("l + cos(2*pi*2/n)", "1"), ("l + exp(-n)", "1"),
        ("l + a", "furlong"), ("9.81*u + l", "1"), ("K*u + a*l*1", "kg/s^2"),
        ("sqrt(K/M) - w + a", "Hz"), ("atan2(x, y) + theta", "1"), ("M*g*y - a*t", "W"),
        ("a + K*u/l^2", "Pa"), ("l + a", "(m)"), ("sin(t)", "1"),
        ("if(x > 0, y, l)", "1"), ("sign(x) + heaviside(u)", "1"),
        ("u^(1/2)*l^0.5 + x", "1"), ("cbrt(x^3) + abs(y)", "1"),
        ("a*sin(theta) + w", "1/s"), ("K*u + a", "N"),
        # numbers before t are rates and speeds whose units are not written
        ("sin(2*t) + theta", "1"), ("l + 0.3 + 0.1*t", "1"), ("a*exp(-t) + w", "1/s"),
        ("l + 0.3*sin(t)", "1"), ("l - t/2", "1"), ("l + if(t < 1, 0.1*t, 2)", "1"),
        ("a*cos(2*pi*t) + l", "m"), ("l + 9.8*t^2/2", "1"), ("l + mod(t, 2)", "1"),
    ],
)  # fmt: skip
def test_what_fits(expression, other):
    assert found(expression, other)[0] == []


@pytest.mark.parametrize(
    ("sections", "mark", "text"),
    [
        ({"forces": "{u: a}"}, "a", "J here, where N"),
        ({"forces": "{theta: K*u}"}, "K*u", "N here, where J"),
        ({"forces": "{x: a/l}"}, None, ""),
        ({"forces": "{u: M*g}"}, None, ""),
        ({"constraints": "{path: u = theta}"}, "=", "m and rad"),
        (
            {"constraints": "{path: {relation: u >= theta, restitution: 0}}"},
            ">=",
            "m and rad",
        ),
        ({"constraints": "{path: x^2 + y^2 - l}"}, "-", "m^2 and m"),
        (
            {"energy": "{kinetic: M*u_dot^2/2 + M*l^2*theta_dot^2/2, potential: K*u}"},
            "K*u",
            "N, the kinetic energy in J",
        ),
        (
            {"energy": "{kinetic: M*(x_dot^2 + y_dot^2)/2, potential: M*g*l + K*u}"},
            "+",
            "J and N",
        ),
        (
            {"energy": "{kinetic: M*u_dot^2/2, potential: 0, dissipation: K*u^2}"},
            "K*u^2",
            "J here, where W",
        ),
        (
            {
                "energy": "{kinetic: M*(x_dot^2 + y_dot^2)/2, potential: 0, "
                "dissipation: K*u*u_dot}"
            },
            None,
            "",
        ),
        ({"energy": "{kinetic: (x_dot^2 + y_dot^2)/2, potential: x^2}"}, None, ""),
        ({"states": "{s: {rate: u, unit: m}}"}, "u", "m here, where m/s"),
        ({"initial": "{theta: l, u: 1}"}, "l", "m here, where rad"),
        ({"simulation": "{duration: 1, until: y >= theta}"}, ">=", "m and rad"),
    ],
)
def test_sections(sections, mark, text):
    if "states" in sections:
        sections = {**sections, "initial": "{theta: 0.1, u: 0.1, s: 0}"}
    told, source = found(other="J", **sections)
    if mark is None:
        assert told == []
        return
    [(place, words)] = told
    assert source.splitlines()[place.line - 1][place.column - 1 :].startswith(mark)
    assert place.length == len(mark)
    assert text in words


@pytest.mark.parametrize("path", sorted(MODELS.rglob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_models_have_none(path):
    model = read_file(str(path))
    assert list(model.stated.mismatches(model)) == []


@pytest.mark.slow
def test_check_and_run_say_so(command, tmp_path):  # noqa: F811
    (tmp_path / "m.yaml").write_text(TEXT.replace("EXPRESSION", "l + theta"))
    pointed = "m.yaml:13:10: `+` is given m and rad [W113]\n"
    caret = "  new: l + theta\n  " + " " * 9 + "^\n"
    assert pointed in command("check", "m.yaml", code=0).out
    called = command("run", "m.yaml", "--no-plots", code=0)
    assert f"{pointed}  {caret}" in called.err
    told = command("check", "m.yaml", "--json").json["warnings"][-1]
    assert (told["code"], told["line"], told["column"]) == ("unit-mismatch", 13, 10)
    assert command("check", "m.yaml", "--strict").code == 1
    bound = lagsim.load(tmp_path / "m.yaml").bind(l=2)
    again = lagsim.check(bound).warnings[-1]
    assert again | {"text": ""} == told | {"text": ""}
    assert lagsim.simulate(bound)["new"][0] == pytest.approx(2.1)


def test_of_a_family_the_first_member_is_named():
    text = """\
parameters: {k: {value: 1, unit: N/m}, m: {value: 1, unit: kg}}
coordinates: {q(1..3): {unit: m}}
definitions: {e(i = 1..3): k + q(i)}
energy:
  kinetic: sum(i = 1..3, m*q_dot(i)^2/2)
  potential: sum(i = 1..3, k*q(i)^2/2)
initial: {q(1..3): 0}
"""
    model = read(text, "m.yaml")
    [told] = model.stated.mismatches(model)
    assert told.place.line == 3
    assert "N/m and m" in told.text
