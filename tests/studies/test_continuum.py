"""Continua of rests that friction holds: the point nearest to the start."""

import math

import pytest

import lagsim
from tests.studies.test_rest import BLOCK

pytestmark = pytest.mark.slow  # some seconds each

# mu m g / k
REACH = 0.4 * 2 * 9.81 / 50
PLANE = """
parameters: {m: 2, k: 50, g: 9.81, mu: 0.4}
coordinates: {x: {}, y: {}, z: {}}
energy:
  kinetic: m*(x_dot^2 + y_dot^2 + z_dot^2)/2
  potential: k*(x^2 + y^2)/2 + m*g*z
constraints:
  floor: {relation: z >= 0, restitution: 0, friction: mu, slip: [x_dot, y_dot]}
initial: {x: 0.3, y: -0.4, z: 0}
"""
HINGE = """
parameters: {L: 2}
coordinates: {a: {unit: rad}}
energy: {kinetic: a_dot^2/2, potential: -4*cos(a)}
constraints: {hinge: {relation: a_dot = 0, limit: L}}
initial: {a: 1.2}
"""
TWO = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + 3*y_dot^2)/2, potential: 5*x^2 + 8*y^2}
constraints:
  one: {relation: x_dot = 0, limit: 2}
  other: {relation: y_dot = 0, limit: 4}
initial: {x: 0.7, y: -0.1}
"""


def only(text, **options):
    found = lagsim.equilibrium(text, starts=4, **options)
    assert found.continuum
    [x] = found.equilibria
    return x


@pytest.mark.parametrize("start", [0.3, -0.5, 2.0])
def test_a_block_rests_where_friction_just_holds_it(start):
    x = only(BLOCK.replace("x: 0.1,", f"x: {start},"))
    assert x["coordinates"]["x"] == pytest.approx(math.copysign(REACH, start), rel=1e-9)
    far = (abs(start) - REACH) / max(1.0, abs(start))
    assert x["distance"] == pytest.approx(far, rel=1e-9)
    assert x["lambda"]["floor"] == pytest.approx(2 * 9.81)
    friction = math.copysign(0.4 * 2 * 9.81, start)
    assert x["friction"]["friction.floor"] == pytest.approx(friction)


def test_a_start_that_friction_holds_is_the_nearest():
    x = only(BLOCK.replace("x: 0.1,", "x: 0.1569,"))
    assert x["coordinates"]["x"] == 0.1569
    assert x["distance"] == 0


@pytest.mark.parametrize(("unit", "shift"), [(1.0, 0.0), (1e3, 0.0), (1.0, 1e4)])
def test_far_from_the_origin_and_in_other_units(unit, shift):
    text = BLOCK.replace("k*x^2/2", f"k*(x - {shift})^2/2")
    text = text.replace("g: 9.81", f"g: {9.81 * unit}")
    text = text.replace("x: 0.1,", f"x: {0.3 * unit + shift},")
    found = only(text)["coordinates"]["x"] - shift
    assert found == pytest.approx(REACH * unit, rel=1e-9 + 1e-13 * shift)


@pytest.mark.parametrize("heavy", [1e-12, 1e18])
def test_beside_a_heavy_or_a_light_body(heavy):
    text = BLOCK.replace("{x: {}, y: {}}", "{x: {}, y: {}, s: {}}")
    text = text.replace("x: 0.1, y: 0}", "x: 0.3, y: 0, s: 0.2}")
    text = text.replace("m*(x_dot^2", f"{heavy}*s_dot^2/2 + m*(x_dot^2")
    text = text.replace("k*x^2/2", f"k*x^2/2 + {heavy}*s^2/2")
    x = only(text)["coordinates"]
    assert x["x"] == pytest.approx(REACH, rel=1e-9)
    assert x["s"] == pytest.approx(0, abs=1e-9)


def test_on_a_plane_the_region_is_a_disc():
    x = only(PLANE)
    where = x["coordinates"]
    assert where["x"] == pytest.approx(0.6 * REACH, rel=1e-7)
    assert where["y"] == pytest.approx(-0.8 * REACH, rel=1e-7)
    assert math.hypot(where["x"], where["y"]) == pytest.approx(REACH, rel=1e-10)


@pytest.mark.parametrize(("start", "expected"), [(1.2, math.pi / 6), (-2, -5 / 6)])
def test_a_hinge_holds_around_both_rests(start, expected):
    x = only(HINGE.replace("a: 1.2", f"a: {start}"))
    angle = expected if expected > 0 else expected * math.pi
    assert x["coordinates"]["a"] == pytest.approx(angle, rel=1e-9)


def test_of_two_limits_one_may_not_be_reached():
    x = only(TWO)
    assert x["coordinates"]["x"] == pytest.approx(0.2, rel=1e-9)
    assert x["coordinates"]["y"] == pytest.approx(-0.1, rel=1e-7)


def test_modes_are_about_this_point():
    small = lagsim.modes(BLOCK.replace("x: 0.1,", "x: 0.3,"))
    assert small.about["x"] == pytest.approx(REACH, rel=1e-9)


# A ladder on a rough floor, against a smooth wall: it holds where tan(a) >= 1/(2 mu).
LADDER = """
parameters: {l: 2, m: 3, g: 9.81, mu: 0.5, A: 0.6}
coordinates: {x: {}, y: {}, a: {unit: rad}}
definitions: {fx: x + l*cos(a)/2, fy: y - l*sin(a)/2, wx: x - l*cos(a)/2}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2 + m*l^2*a_dot^2/24, potential: m*g*y}
constraints:
  floor: {relation: fy >= 0, restitution: 0, friction: mu, slip: fx_dot}
  wall: {relation: wx >= 0, restitution: 0}
initial: {x: l*cos(A)/2, y: l*sin(A)/2, a: A}
"""
SLOPE = """
parameters: {m: 2, k: 40, g: 9.81, b: 0.5}
coordinates: {s: {}, n: {}}
energy:
  kinetic: m*(s_dot^2 + n_dot^2)/2
  potential: k*s^2/2 + m*g*(n*cos(b) - s*sin(b))
constraints:
  plane:
    {relation: n >= 0, restitution: 0, friction: {static: 0.35, dynamic: 0.3},
      slip: s_dot}
initial: {s: 2, n: 0}
"""


@pytest.mark.parametrize("start", [0.6, math.pi / 4 - 0.01, 0.9])
def test_a_ladder_leans_at_its_least_angle(start):
    found = lagsim.equilibrium(lagsim.load(LADDER, A=start), starts=4)
    first = found.equilibria[0]
    angle = max(start, math.pi / 4)
    assert first["coordinates"]["a"] == pytest.approx(angle, rel=1e-9)
    assert first["lambda"]["floor"] == pytest.approx(3 * 9.81, rel=1e-9)
    push = 3 * 9.81 / (2 * math.tan(angle))
    assert first["lambda"]["wall"] == pytest.approx(push, rel=1e-9)
    assert first["distance"] == pytest.approx(angle - start, abs=1e-9)
    # It also stands upright, beside the wall, where it is.
    [upright] = [
        x for x in found.equilibria
        if x["coordinates"]["a"] == pytest.approx(math.pi / 2)
    ]  # fmt: skip
    assert upright["stable"] is False
    assert upright["coordinates"]["x"] == pytest.approx(math.cos(start), abs=1e-6)


@pytest.mark.parametrize(("start", "side"), [(2, 1), (-1, -1)])
def test_what_sticks_has_the_static_coefficient(start, side):
    x = only(SLOPE.replace("s: 2,", f"s: {start},"))
    push, weight = 2 * 9.81 * math.cos(0.5), 2 * 9.81 * math.sin(0.5)
    expected = (weight + side * 0.35 * push) / 40
    assert x["coordinates"]["s"] == pytest.approx(expected, rel=1e-9)
