"""Warnings about names: parameters that nothing uses, angles that are in degrees."""

from __future__ import annotations

import pytest

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
