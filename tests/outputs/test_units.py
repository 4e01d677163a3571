"""Units that follow from the units of a file, and units that do not."""

import json

import pytest

from lagsim import simulate
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read
from lagsim.outputs.units import of_table, parsed, units, written

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
COLUMNS = ("t", "x", "y", "theta", "x_dot", "y_dot", "theta_dot")


def found(mass="kg", potential="m*g*y"):
    model = read(BEAD.format(mass=mass, potential=potential), "bead.yaml")
    return units(derive(model), COLUMNS)


def test_what_follows():
    known = found()
    expected = {
        # Others stand in `FOLLOWS`. Lambda times a rate of its relation is a power.
        "friction.floor": "N",
        "lambda_rod": "N/m",
        "reaction.slope": "N",
        "plot:3.x": "N",
        "plot:3.y.1": "N",
        "point.a.1": "m",
        "point.a.2": "m",
        "plot:0.x": "s",
        "plot:0.y.1": "m/s",
        "plot:1.x": "m",
        "plot:1.y.1": "rad",
        "plot:2.x": "1/s",
        "plot:2.y.1": "N",
    }
    assert {name: known.get(name) for name in expected} == expected


def test_what_does_not_follow():
    known = found()
    # A ratio; a number that may stand for a quantity; a sum of what cannot be added; a
    # point at numbers.
    for name in ("plot:1.y.2", "plot:1.y.3", "plot:2.y2.1", "point.o.1"):
        assert name not in known


def test_energies_that_do_not_agree_have_no_unit():
    # The number hides the metres per second squared.
    assert "energy" not in found(potential="m*y*9")
    assert "lambda_floor" not in found(potential="m*y*9")
    # These may stand for an acceleration; a hundred times the second overflows.
    for number in ("9.81", "1e307"):
        assert found(potential=f"m*y*{number}")["energy"] == "J"


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


@pytest.mark.parametrize(
    ("named", "base"),
    [
        # The SI Brochure, table 4: derived units with names.
        ("N", "kg m/s^2"), ("J", "kg m^2/s^2"), ("W", "kg m^2/s^3"), ("Hz", "1/s"),
        ("Pa", "kg/m/s^2"), ("C", "A s"), ("V", "kg m^2/s^3/A"), ("T", "kg/s^2/A"),
        ("rad m", "m"), ("N/m^2", "Pa"), ("V C", "J"), ("J/s", "W"),
    ],
)  # fmt: skip
def test_units_with_names(named, base):
    assert parsed(named) == parsed(base)


def test_a_unit_without_a_name_is_written_by_powers():
    assert written({"m": 2.0, "s": -1.0, "kg": -3.0}) == "m^2/s/kg^3"
    assert written({"s": -2.0}) == "1/s^2"
    assert written({"m": 0.5}) == written({}) == written(None) == ""


AXES = """\
parameters: {{m: {{value: 1, unit: kg}}, k: {{value: 1, unit: N/m}}}}
coordinates: {{x: {{unit: m}}, y: {{unit: m}}}}
energy: {{kinetic: m*(x_dot^2 + y_dot^2)/2, potential: k*(x^2 + y^2)/2}}
initial: {{x: 1, y: 1}}
simulation: {{duration: 1}}
output: {{plots: [{{x: t, y: "{curve}"}}]}}
"""


@pytest.mark.parametrize(
    ("curve", "unit"),
    [
        ("sqrt(x*y)", "m"), ("cbrt(x^3)", "m"), ("sqrt(k/m)", "1/s"),
        ("hypot(x, y)", "m"), ("min(x, y)", "m"), ("max(x, 2)", "m"), ("abs(x)", "m"),
        ("-x", "m"), ("x - y", "m"), ("x*y", "m^2"), ("x^3", "m^3"), ("x^-2", "1/m^2"),
        ("m*x_dot", "kg m/s"), ("if(x > y, x, y)", "m"), ("x*x_dot", "m^2/s"),
        ("3*x", "m"), ("floor(x)", "m"),
        # Angles and ratios have none, nor has what no sum can be.
        ("sin(x/y)", None), ("x/y", None), ("x + x*y", None), ("x^y", None),
        ("if(x > y, x, x_dot)", None), ("atan2(x, y)", None), ("9.8*x", None),
        # A number keeps the unit of what it is added to, or chosen with.
        ("if(t < 1, x, 0)", "m"), ("if(x > 0, 0, y - x)", "m"), ("0.45*x", "m"),
        ("0.05*max(x - y, 0)", "m"), ("x/3", "m"), ("pi*x", "m"), ("-0.2*k*x", "N"),
        # Conversions and constants of nature are no numbers.
        ("1000*x", None), ("0.001*x", None), ("0.01*x", None), ("9.81*x", None),
        ("x/3.6", None),
    ],
)  # fmt: skip
def test_the_unit_on_an_axis(curve, unit):
    model = read(AXES.format(curve=curve), "axes.yaml")
    assert units(derive(model), ["t", "x", "y"]).get("plot:0.y.1") == unit


# A block on a spring with friction, drag and a motor; of mu, c and two names no unit is
# given: mu is a number, c is none, and `rate` may be anything.
BLOCK = """\
parameters:
  m: {value: 2, unit: kg}
  k: {value: 50, unit: N/m}
  g: {value: 9.81, unit: m/s^2}
  l: {value: 1, unit: m}
  kt: {value: 3, unit: N m/rad}
  mu: 0.2
  c: 0.5
  rate: sqrt(k/m)
coordinates: {x: {unit: m}, theta: {unit: rad}}
definitions:
  stretch: if(x > l, x - l, 0)
  spring: -k*stretch
  friction: -mu*m*g*sign(x_dot)
  drag: -c*x_dot
  torque: -kt*theta
  power: spring*x_dot
  least: min(abs(x), 1.5*l)
  most: 0.25*max(x, 0)
  sum: kinetic + potential
  twice: 2*theta_dot
  phase: rate*x
  pull: if(t < 1, friction, 0)
energy: {kinetic: m*x_dot^2/2 + m*l^2*theta_dot^2/2, potential: m*g*x}
forces: {x: spring + friction + drag, theta: torque}
constraints: {floor: {relation: x >= 0, restitution: 0}, brake: theta_dot = 0}
initial: {x: 1, theta: 0}
simulation: {duration: 0.01, output_step: 0.01}
output: {action: true, gauss: true}
"""
FOLLOWS = {
    "stretch": "m", "spring": "N", "friction": "N", "drag": "", "torque": "N m",
    "power": "W", "least": "m", "most": "m", "sum": "J", "twice": "rad/s",
    "phase": "", "pull": "N", "kinetic": "J", "potential": "J", "energy": "J",
    "work": "J", "lambda_floor": "N", "lambda_brake": "N m", "Qc_x": "N",
    "Qc_theta": "N m", "residual_floor": "m", "residual_brake": "rad/s",
    "impulse.floor": "N s", "gauss.a_x": "m/s^2", "gauss.G": "J/s^2",
    "action.S": "J s", "t": "s", "x": "m", "x_dot": "m/s", "x_ddot": "m/s^2",
    "theta": "rad", "theta_dot": "rad/s", "theta_ddot": "rad/s^2",
    "gauss.a_theta": "rad/s^2",
}  # fmt: skip


@pytest.mark.slow
def test_every_column_has_the_unit_that_follows_and_all_know_it(tmp_path):
    result = simulate(read(BLOCK, "block.yaml"), error_bar="never")
    assert result.units == FOLLOWS
    assert result.record["columns"] == FOLLOWS
    result.write(tmp_path, plots=False, units=True)
    names, line = (tmp_path / "trajectory.csv").read_text().splitlines()[:2]
    assert dict(zip(names.split(","), line.split(","), strict=True)) == FOLLOWS
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["columns"] == FOLLOWS


@pytest.mark.parametrize(
    ("parameter", "use", "unit"),
    [
        # Nothing speaks against a number; an energy, a force, a dissipation does.
        ("c: 2", "", "m"),
        ("c: 2", "potential: c*x^2", ""),
        ("c: 2", "forces: {x: -c*x}", ""),
        ("c: 2", "dissipation: c*x_dot^2/2", ""),
        # What is computed from others is no number of its own.
        ("c: 2*k", "", ""),
        ("c: 2*sqrt(k)", "", ""),
        ("c: pi/2 + 1e-3", "", "m"),
        ("c: sqrt(2)/2", "", "m"),
        ('c: {value: 2, unit: "1"}', "", "m"),
    ],
)
def test_a_parameter_without_a_unit(parameter, use, unit):
    potential = use if use.startswith("potential") else "potential: k*x^2/2"
    more = "" if use.startswith("potential") else use
    dissipation = f", {more}" if more.startswith("dissipation") else ""
    text = f"""\
parameters: {{m: {{value: 1, unit: kg}}, k: {{value: 1, unit: N/m}}, {parameter}}}
coordinates: {{x: {{unit: m}}}}
definitions: {{part: c*x}}
energy: {{kinetic: m*x_dot^2/2, {potential}{dissipation}}}
{more if more.startswith("forces") else ""}
initial: {{x: 1}}
simulation: {{duration: 1}}
"""
    found = of_table(derive(read(text, "c.yaml")), ["part", "energy"])
    assert found == {"part": unit, "energy": "J"}
