"""Units that follow from those of a file, and those that do not."""

from __future__ import annotations

import pytest

from lagsim.mechanics.equations import derive
from lagsim.model.reader import read
from lagsim.outputs.units import parsed, units, written

# A bead on a rough, tilted wire in the plane, with all that has a unit.
BEAD = """\
parameters:
  m: {{value: 2, unit: {mass}}}
  g: {{value: 9.8, unit: m/s^2}}
  l: {{value: 1, unit: m}}
coordinates: {{x: {{unit: m}}, y: {{unit: m}}, theta: {{unit: rad}}}}
definitions: {{slope: l*sin(theta)}}
energy:
  kinetic: m*(x_dot^2 + y_dot^2)/2 + m*l^2*theta_dot^2/6
  potential: {potential}
constraints:
  floor: {{relation: y >= -l, restitution: 0, friction: 0.1, slip: x_dot}}
  turn: theta_dot = 0
  rod: x^2 = l^2
initial: {{x: 1, y: 0, theta: 0}}
simulation: {{duration: 1}}
scene: {{points: {{a: [x, slope], o: [0, 0]}}}}
output:
  plots:
    - {{x: t, y: x_dot}}
    - {{x: slope, y: [theta, x/y, 9.8*x]}}
    - {{x: sqrt(g/l), y: m*g + 3, y2: m*g + l}}
    - {{x: reaction.slope, y: 2*l*lambda_rod}}
  reactions: [slope]
"""


def found(mass="kg", potential="m*g*y"):
    told = {"x": "m", "y": "m", "theta": "rad", "x_dot": "m/s", "y_dot": "m/s"}
    told |= {"theta_dot": "rad/s", "t": "s"}
    model = read(BEAD.format(mass=mass, potential=potential), "bead.yaml")
    return units(derive(model), told)


def test_what_follows():
    known = found()
    expected = {
        "kinetic": "J",
        "potential": "J",
        "energy": "J",
        "work": "J",
        # Q q' is a power, and lambda times a rate of its relation too.
        "Qc_x": "N",
        "Qc_theta": "N m",
        "lambda_floor": "N",
        "friction.floor": "N",
        "impulse.floor": "N s",
        "lambda_turn": "N m",
        "lambda_rod": "N/m",
        "reaction.slope": "N",
        "plot.3.x": "N",
        "plot.3.y.1": "N",
        "point.a.1": "m",
        "point.a.2": "m",
        "plot.0.x": "s",
        "plot.0.y.1": "m/s",
        "plot.1.x": "m",
        "plot.1.y.1": "rad",
        "plot.2.x": "1/s",
        "plot.2.y.1": "N",
    }
    assert {name: known.get(name) for name in expected} == expected


def test_what_does_not_follow():
    known = found()
    # A ratio; a number that may stand for a quantity; a sum of what cannot be added; a
    # point at numbers.
    for name in ("plot.1.y.2", "plot.1.y.3", "plot.2.y2.1", "point.o.1"):
        assert name not in known


def test_energies_that_do_not_agree_have_no_unit():
    # The number hides the metres per second squared.
    assert "energy" not in found(potential="m*y*9")
    assert "lambda_floor" not in found(potential="m*y*9")


def test_a_mass_without_a_unit_gives_none():
    assert "energy" not in found(mass='""')


def test_units_are_taken_apart_and_put_together():
    assert parsed("N s/m") == parsed("kg/s")
    assert parsed("N*m") == parsed("J")
    assert parsed("m s^-1") == parsed("m/s") == {"m": 1.0, "s": -1.0}
    assert parsed("rad/s") == {"s": -1.0}
    assert parsed("per cent!") is None
    assert written(parsed("kg m^2/s^2/A")) == "kg m^2/s^2/A"
    assert written(parsed("N m"), ["N m"]) == "N m"


@pytest.mark.parametrize("text", ["", "/", "m^", "m//s", "^2", "m^1.5", "5 m"])
def test_what_is_no_unit(text):
    assert parsed(text) is None
