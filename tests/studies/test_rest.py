"""Positions of rest and their stability against closed forms."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import lagsim
from tests.studies.test_modes import CARTESIAN, HOOP
from tests.support import MODELS, refused

DOUBLE = """
parameters: {l: 0.5, g: 9.81, m: 2}
coordinates: {a: {unit: rad}, b: {unit: rad}}
definitions:
  x1: l*sin(a)
  y1: -l*cos(a)
  x2: x1 + l*sin(b)
  y2: y1 - l*cos(b)
energy:
  kinetic: m*(x1_dot^2 + y1_dot^2 + x2_dot^2 + y2_dot^2)/2
  potential: m*g*(y1 + y2)
initial: {a: 0.4, b: -0.3}
"""
TRUSS = """
parameters: {b: 1, h: 0.3, k: 1000, m: 1, P: 5}
coordinates: {y: {unit: m}}
energy:
  kinetic: m*y_dot^2/2
  potential: k*(hypot(b, y) - hypot(b, h))^2 + P*y
initial: {y: h}
scene: {points: {left: [-b, 0], right: [b, 0], top: [0, y]}}
"""
ZIEGLER = """
parameters: {m: 1, l: 1, k: 1, P: 1, c: 0}
coordinates: {a: {unit: rad}, b: {unit: rad}}
definitions:
  x1: l*sin(a)
  y1: l*cos(a)
  x2: x1 + l*sin(b)
  y2: y1 + l*cos(b)
energy:
  kinetic: m*(2*(x1_dot^2 + y1_dot^2) + x2_dot^2 + y2_dot^2)/2
  potential: k*(a^2 + (b - a)^2)/2
  dissipation: c*(a_dot^2 + (b_dot - a_dot)^2)/2
forces: {x2: -P*sin(b), y2: -P*cos(b)}
initial: {a: 0, b: 0}
"""
# Ziegler's column with masses 2 m and m: flutter at P l/k = 7/2 - sqrt(2).
FLUTTER = 3.5 - math.sqrt(2)
EULER = """
parameters: {n: 6, L: 1, h: L/n, B: 2, P: 10, m: 0.1}
coordinates: {q(1..n): {unit: rad}}
definitions:
  x(0): 0
  y(0): 0
  x(i = 1..n): x(i-1) + h*cos(q(i))
  y(i = 1..n): y(i-1) + h*sin(q(i))
energy:
  kinetic: sum(i = 1..n, m*(x_dot(i)^2 + y_dot(i)^2)/2)
  potential: B/h*sum(i = 1..n-1, (q(i+1) - q(i))^2)/2 + P*x(n)
constraints: {end: y(n) = 0}
initial: {q(1..n): 0}
"""
BLOCK = """
parameters: {m: 2, k: 50, g: 9.81, mu: 0.4}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: k*x^2/2 + m*g*y}
constraints:
  floor: {relation: y >= 0, restitution: 0, friction: mu, slip: x_dot}
initial: {x: 0.1, y: 0}
"""


def one(found, **where):
    """Return the rest at given coordinates."""
    near = {q: pytest.approx(value, abs=1e-9) for q, value in where.items()}
    [x] = [
        x for x in found.equilibria if {q: x["coordinates"][q] for q in where} == near
    ]
    return x


@pytest.mark.slow
def test_a_double_pendulum_has_four_rests():
    found = lagsim.equilibrium(DOUBLE)
    assert len(found.equilibria) == 4
    hanging = found.equilibria[0]
    assert hanging["coordinates"] == pytest.approx({"a": 0, "b": 0}, abs=1e-9)
    assert (hanging["stable"], hanging["reason"]) == (True, "energy minimum")
    assert hanging["from_start"]
    assert hanging["distance"] == pytest.approx(0.4)
    assert hanging["energy"] == pytest.approx(-2 * 9.81 * 1.5)
    rates = [abs(complex(*x)) for x in hanging["eigenvalues"]]
    roots = math.sqrt(9.81 / 0.5) * np.sqrt(2 + np.array([-1, 1]) * math.sqrt(2))
    assert sorted(rates) == pytest.approx(sorted([*roots, *roots]), rel=1e-9)
    for a in (0, math.pi):
        for b in (0, -math.pi if a else math.pi):
            near = [
                x for x in found.equilibria
                if math.cos(x["coordinates"]["a"]) == pytest.approx(math.cos(a))
                and math.cos(x["coordinates"]["b"]) == pytest.approx(math.cos(b))
            ]  # fmt: skip
            assert len(near) == 1
            assert near[0]["stable"] is (a == b == 0)


@pytest.mark.slow
def test_a_cartesian_pendulum_hangs_by_its_constraint():
    found = lagsim.equilibrium(CARTESIAN)
    assert len(found.equilibria) == 2
    below = one(found, y=-0.7)
    assert below["stable"] is True
    # m g = 2 y lambda.
    assert below["lambda"]["rod"] == pytest.approx(3 * 9.81 / (2 * -0.7))
    assert one(found, y=0.7)["reason"] == "eigenvalues"


@pytest.mark.slow
def test_of_two_rests_at_one_distance_the_stable_one_is_first():
    """A pendulum held level is as far from hanging as from standing."""
    model = lagsim.load(str(MODELS / "pendulum-cartesian.yaml"))
    found = lagsim.equilibrium(model)
    assert [x["stable"] for x in found.equilibria] == [True, False]
    frequency = lagsim.modes(model).modes[0]["frequency"]
    assert frequency == pytest.approx(math.sqrt(9.81) / (2.0 * math.pi), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("w", "count"), [(3.0, 2), (5.0, 4)])
def test_a_bead_on_a_turning_hoop(w, count):
    found = lagsim.equilibrium(lagsim.load(HOOP).bind(w=w, theta=0.2))
    assert len(found.equilibria) == count
    assert one(found, theta=0)["stable"] is (w * w < 9.81 / 0.8)
    if count == 4:
        angle = math.acos(9.81 / (0.8 * 25))
        assert one(found, theta=angle)["stable"] is True
        assert one(found, theta=-angle)["stable"] is True


@pytest.mark.slow
def test_a_truss_snaps_through():
    found = lagsim.equilibrium(TRUSS)
    states = sorted((x["coordinates"]["y"], x["stable"]) for x in found.equilibria)
    assert [stable for _, stable in states] == [True, False, True]
    # The roots of 2 k y (1 - a/sqrt(b^2 + y^2)) + P, by an independent search.
    y = np.linspace(-0.4, 0.4, 8001)
    force = 2000 * y * (1 - math.hypot(1, 0.3) / np.hypot(1, y)) + 5
    roots = y[:-1][np.diff(np.sign(force)) != 0]
    assert [y for y, _ in states] == pytest.approx(roots, abs=2e-4)


@pytest.mark.parametrize(("part", "stable"), [(0.9, None), (1.01, False)])
def test_a_follower_force_is_not_decided_below_flutter(part, stable):
    model = lagsim.load(ZIEGLER).bind(P=part * FLUTTER)
    found = lagsim.equilibrium(model, starts=0)
    [x] = found.equilibria
    assert x["stable"] is stable
    assert (stable is None) == x["reason"].startswith("not decided: ")


@pytest.mark.parametrize(("part", "stable"), [(0.999, True), (1.001, False)])
def test_a_column_of_links_buckles(part, stable):
    # P = 4 B/h^2 sin(pi/(2 n))^2 of n links between pins.
    load = 4 * 2 * 36 * math.sin(math.pi / 12) ** 2
    model = lagsim.load(EULER).bind(P=part * load)
    [x] = lagsim.equilibrium(model, starts=0).equilibria
    assert x["stable"] is stable


@pytest.mark.slow
def test_gyroscopic_forces_alone_do_not_decide():
    text = """
coordinates: {x: {}, y: {}}
energy:
  kinetic: (x_dot^2 + y_dot^2)/2 + 2*(x*y_dot - y*x_dot)
  potential: -(x^2 + y^2)/2
initial: {x: 0, y: 0}
"""
    [x] = lagsim.equilibrium(text, starts=2).equilibria
    assert x["stable"] is None
    assert "gyroscopic" in x["reason"]
    damped = text + "forces: {x: -0.1*x_dot, y: -0.1*y_dot}\n"
    [x] = lagsim.equilibrium(damped, starts=0).equilibria
    assert (x["stable"], x["reason"]) == (False, "eigenvalues")


@pytest.mark.parametrize(("power", "sign", "stable"), [(2, 1, True), (4, 1, None)])
def test_a_level_energy_is_not_decided(power, sign, stable):
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: {sign}*x^{power}}}
initial: {{x: 0}}
"""
    [x] = lagsim.equilibrium(text, starts=0).equilibria
    assert x["stable"] is stable


@pytest.mark.slow
def test_damping_decides_by_eigenvalues():
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: x^2, dissipation: 0.1*x_dot^2}
initial: {x: 0.5}
"""
    [x] = lagsim.equilibrium(text).equilibria
    assert (x["stable"], x["reason"]) == (True, "eigenvalues")


@pytest.mark.slow
def test_coordinates_without_force_stay_and_are_named():
    text = """
coordinates: {s: {unit: m}, a: {unit: rad}}
energy: {kinetic: s_dot^2 + a_dot^2/2 + s_dot*a_dot*cos(a), potential: -cos(a)}
initial: {s: 0.7, a: 0.4}
"""
    found = lagsim.equilibrium(text)
    assert found.free == ["s"]
    assert [x["coordinates"]["s"] for x in found.equilibria] == [0.7, 0.7]
    assert [x["stable"] for x in found.equilibria] == [True, False]


@pytest.mark.slow
def test_friction_that_sticks_holds_where_the_start_is():
    found = lagsim.equilibrium(BLOCK)
    assert found.continuum
    [x] = found.equilibria
    assert x["coordinates"]["x"] == pytest.approx(0.1)
    assert x["lambda"]["floor"] == pytest.approx(2 * 9.81)
    assert x["friction"] == {"friction.floor": pytest.approx(50 * 0.1)}
    assert x["stable"] is True


@pytest.mark.slow
def test_a_contact_opens_or_holds():
    text = BLOCK.replace(", friction: mu, slip: x_dot", "")
    [x] = lagsim.equilibrium(text).equilibria
    assert x["coordinates"] == pytest.approx({"x": 0, "y": 0}, abs=1e-9)
    assert not lagsim.equilibrium(text).continuum
    hung = text.replace("m*g*y", "m*g*y + 20*(y - 1)^2")
    [x] = lagsim.equilibrium(hung).equilibria
    assert x["coordinates"]["y"] == pytest.approx(1 - 2 * 9.81 / 40)
    assert x["lambda"]["floor"] == 0


@pytest.mark.slow
def test_a_rest_far_from_the_origin_and_in_other_units():
    text = TRUSS.replace("{y: h}", "{y: h + Y}").replace("h: 0.3", "h: 300, Y: 1e6")
    text = text.replace("b: 1,", "b: 1000,").replace("P: 5", "P: 5000")
    text = text.replace("(b, y)", "(b, y - Y)").replace("[0, y]", "[0, y - Y]")
    found = lagsim.equilibrium(text)
    near = sorted(x["coordinates"]["y"] - 1e6 for x in found.equilibria)
    own = sorted(x["coordinates"]["y"] for x in lagsim.equilibrium(TRUSS).equilibria)
    assert near == pytest.approx([1e3 * y for y in own], rel=1e-6)


def test_no_rest_is_an_error_with_the_accelerations():
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: -3*x}
initial: {x: 0}
"""
    with refused("no-rest", "x_ddot = 3 "):
        lagsim.equilibrium(text, starts=2)


def test_no_rest_is_an_error_with_the_rates_of_states():
    # The shaft is at rest, and the current begins to grow by u/L.
    text = """
coordinates: {phi: {}}
states: {i: {rate: (6 - 2*i - phi_dot)/3}}
energy: {kinetic: phi_dot^2/2, potential: 0}
forces: {phi: i}
initial: {phi: 0, i: 0}
"""
    with refused("no-rest", "others: i_dot = 2 remain"):
        lagsim.equilibrium(text, starts=2)


def test_states_come_to_rest():
    text = """
coordinates: {x: {}}
states: {s: {rate: 1 - x - 0.5*s}}
energy: {kinetic: x_dot^2/2, potential: x^2, dissipation: 2*x_dot^2}
forces: {x: s}
initial: {x: 0, s: 0}
"""
    [x] = lagsim.equilibrium(text, starts=3).equilibria
    # s = 2 x and 1 - x - s/2 = 0.
    assert x["coordinates"]["x"] == pytest.approx(0.5)
    assert x["states"]["s"] == pytest.approx(1.0)


@pytest.mark.slow
def test_a_chain_of_links_hangs_between_two_hooks():
    """tan(q_i) = m g (i - (n + 1)/2)/H, with the tension H that fits the span."""
    text = """
parameters: {n: 6, m: 0.5, g: 9.81, span: 4}
coordinates: {q(1..n): {unit: rad}}
definitions:
  x(0): 0
  y(0): 0
  x(i=1..n): x(i-1) + cos(q(i))
  y(i=1..n): y(i-1) + sin(q(i))
energy:
  kinetic: sum(i=1..n-1, m*(x_dot(i)^2 + y_dot(i)^2)/2) + sum(i=1..n, q_dot(i)^2)/100
  potential: sum(i=1..n-1, m*g*y(i))
constraints: {ex: x(n) = span, ey: y(n) = 0}
initial: {q(i=1..n): {guess: 0.4*(i - 3.5)}}
"""
    weight, heights = 0.5 * 9.81, np.arange(6) - 2.5
    H = brentq(lambda H: np.sum(np.cos(np.arctan(weight * heights / H))) - 4, 1, 9)
    found = [x for x in lagsim.equilibrium(text).equilibria if x["stable"]]
    assert len(found) == 1
    q = np.array([found[0]["coordinates"][f"q.{i}"] for i in range(1, 7)])
    turned = (q + np.pi) % (2 * np.pi) - np.pi
    assert turned == pytest.approx(np.arctan(weight * heights / H), abs=1e-9)
    assert abs(found[0]["lambda"]["ex"]) == pytest.approx(H, rel=1e-9)
    assert abs(found[0]["lambda"]["ey"]) == pytest.approx(2.5 * weight, rel=1e-9)


BELT = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 2*x^2}
constraints: {belt: {relation: x_dot - 3 = 0, limit: LIMIT}}
initial: {x: 0.1}
simulation: {duration: 1}
"""


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "force", "growth"), [
    ("1.962", 1.962, 0.0),
    ("{static: 3, dynamic: 1.962}", 1.962, 0.0),
    # Friction that falls with the slip drives the mass: x'' = -4 x + 1 + exp(v - 3).
    ("1 + exp(-abs(x_dot - 3))", 1 + math.exp(-3), math.exp(-3) / 2),
    ("2 - exp(-abs(x_dot - 3))", 2 - math.exp(-3), -math.exp(-3) / 2),
])  # fmt: skip
def test_a_mass_rests_on_a_moving_belt_where_its_spring_balances_the_limit(
    limit, force, growth
):
    text = BELT.replace("LIMIT", limit)
    [found] = lagsim.equilibrium(text).equilibria
    assert found["coordinates"]["x"] == pytest.approx(force / 4, rel=1e-12)
    assert found["lambda"] == {"belt": pytest.approx(force, rel=1e-12)}
    assert found["stable"] is (growth <= 0)
    assert found["continuum"] is False
    [mode] = lagsim.modes(text).modes
    wanted = [growth, math.sqrt(4 - growth**2)]
    assert mode["eigenvalue"] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.slow
def test_friction_on_a_disc_that_slides_at_rest_damps_motion_across_the_slip():
    text = """
coordinates: {p: {components: xy}}
energy: {kinetic: "dot(p_dot, p_dot)/2", potential: "2*dot(p, p)"}
constraints: {belt: {relation: "p_dot = vec(3, 0)", limit: 1.5}}
initial: {p: [0, 0]}
simulation: {duration: 1}
"""
    [found] = lagsim.equilibrium(text).equilibria
    assert found["coordinates"] == pytest.approx({"p.x": 0.375, "p.y": 0.0})
    assert found["lambda"] == pytest.approx({"belt.x": 1.5, "belt.y": 0.0})
    # Across the slip the friction is 1.5 v/3.
    pairs = sorted(x["eigenvalue"] for x in lagsim.modes(text).modes)
    damped = [-0.25, math.sqrt(4 - 0.25**2)]
    assert np.array(pairs) == pytest.approx(np.array([damped, [0.0, 2.0]]), abs=1e-9)


SLIDING_CONTACT = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y + 2*x^2}
constraints:
  floor: {relation: y >= 0, restitution: 0.5, friction: MU, slip: x_dot - 3}
initial: {x: 0.1, y: 0}
simulation: {duration: 1}
"""


@pytest.mark.slow
@pytest.mark.parametrize(("mu", "value", "growth"), [
    ("0.2", 0.2, 0.0),
    ("{static: 0.9, dynamic: 0.2}", 0.2, 0.0),
    # x'' = -4 x + 9.81 (0.2 + exp(v - 3)).
    ("0.2 + exp(-slip_speed)", 0.2 + math.exp(-3), 9.81 * math.exp(-3) / 2),
])  # fmt: skip
def test_a_mass_rests_on_a_moving_belt_by_the_friction_of_its_contact(
    mu, value, growth
):
    text = SLIDING_CONTACT.replace("MU", mu)
    [found] = lagsim.equilibrium(text, starts=3).equilibria
    x = value * 9.81 / 4
    assert found["coordinates"] == pytest.approx({"x": x, "y": 0.0}, abs=1e-12)
    assert found["lambda"] == pytest.approx({"floor": 9.81})
    assert found["friction"] == pytest.approx({"friction.floor": value * 9.81})
    assert found["stable"] is (growth <= 0)
    assert found["continuum"] is False
    wanted = [growth, math.sqrt(4 - growth**2)]
    at_start = text.replace("x: 0.1", f"x: {x!r}")
    for model, at in ((text, "rest"), (at_start, "start")):
        [mode] = lagsim.modes(model, at=at).modes
        assert mode["eigenvalue"] == pytest.approx(wanted, abs=1e-9)


def test_a_start_at_rest_slides_on_a_moving_belt():
    text = SLIDING_CONTACT.replace("MU", "0.2").replace("x: 0.1", "x: {guess: 0.1}")
    text = text.replace("duration: 1", "duration: 1, begin: rest")
    result = lagsim.simulate(text, error_bar="never")
    assert result["x"] == pytest.approx(np.full(len(result["x"]), 0.4905), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("inwards", [True, False])
def test_a_bar_on_two_turning_rollers_has_the_frequency_of_their_friction(inwards):
    """The loads are m g (1 +- x/c)/2: x'' = -mu g x/c (S. Timoshenko)."""
    v = 2 if inwards else -2
    [found] = (
        one
        for one in lagsim.equilibrium(f"""
coordinates: {{x: {{}}, y: {{}}, a: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2 + a_dot^2/20, potential: 9.81*y}}
constraints:
  right: {{relation: y + a*(0.5 - x) >= 0, restitution: 0, friction: 0.3,
          slip: x_dot + {v}}}
  left: {{relation: y - a*(0.5 + x) >= 0, restitution: 0, friction: 0.3,
         slip: x_dot - {v}}}
initial: {{x: 0.1, y: 0, a: 0}}
""", starts=3).equilibria
        if abs(one["coordinates"]["a"]) < 0.1
    )  # fmt: skip
    assert found["coordinates"] == pytest.approx({"x": 0, "y": 0, "a": 0}, abs=1e-12)
    assert found["lambda"] == pytest.approx({"left": 4.905, "right": 4.905})
    push = 0.3 * 4.905 * (1 if inwards else -1)
    wanted = {"friction.left": push, "friction.right": -push}
    assert found["friction"] == pytest.approx(wanted)
    assert found["stable"] is inwards
    rate = math.sqrt(0.3 * 9.81 / 0.5)
    values = {complex(*z) for z in found["eigenvalues"]}
    for z in (1j * rate, -1j * rate) if inwards else (rate, -rate):
        assert min(abs(z - x) for x in values) <= 1e-9


@pytest.mark.parametrize("speed", [5, -5])
@pytest.mark.parametrize("unit", [1, 1000])
def test_a_self_energising_brake_shoe_presses_by_its_own_friction(speed, unit):
    """A shoe on a lever, 0.2 beside and 0.1 above its pivot: N (0.2 -+ 0.1 mu) = F b.

    The pivot is on a slide with a spring. `unit` is the number of units of length in a
    metre.
    """
    u, mu = unit, 0.4
    text = f"""
coordinates: {{s: {{}}, a: {{}}}}
energy: {{kinetic: s_dot^2/2 + {0.03 * u**2}*a_dot^2/2, potential: 200*s^2}}
forces: {{a: {-9 * u**2}}}
constraints:
  shoe: {{relation: "{0.2 * u}*sin(a) + {0.1 * u}*(cos(a) - 1) >= 0", restitution: 0,
         friction: {mu}, slip: "s_dot + ({0.1 * u}*cos(a) - {0.2 * u}*sin(a))*a_dot
         - ({speed * u})"}}
initial: {{s: 0, a: 0}}
"""
    found = lagsim.equilibrium(text, starts=0).equilibria[0]
    side = math.copysign(1.0, speed)
    N = 9 * u / (0.2 + 0.1 * mu * side)
    assert found["lambda"] == pytest.approx({"shoe": N})
    assert found["friction"] == pytest.approx({"friction.shoe": mu * N * side})
    wanted = {"s": mu * N * side / 400, "a": 0.0}
    assert found["coordinates"] == pytest.approx(wanted, abs=1e-12 * u)


@pytest.mark.slow
def test_friction_of_two_slips_that_slides_at_rest_damps_motion_across_the_slip():
    """Across the slip the friction is mu N v/3, with mu N = 1.5."""
    text = """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 2*(x^2 + y^2) + 10*z}
constraints:
  belt: {relation: z >= 0, restitution: 0, friction: 0.15, slip: [y_dot - 3, x_dot]}
initial: {x: 0.1, y: 0.2, z: 0}
"""
    [found] = lagsim.equilibrium(text, starts=3).equilibria
    wanted = {"x": 0, "y": 0.375, "z": 0}
    assert found["coordinates"] == pytest.approx(wanted, abs=1e-12)
    friction = {"friction.belt.1": 1.5, "friction.belt.2": 0.0}
    assert found["friction"] == pytest.approx(friction, abs=1e-12)
    pairs = sorted(z for z in found["eigenvalues"] if z[1] > 0)
    damped = [-0.25, math.sqrt(4 - 0.25**2)]
    assert np.array(pairs) == pytest.approx(np.array([damped, [0.0, 2.0]]), abs=1e-9)


@pytest.mark.slow
def test_friction_that_sticks_bears_no_more_than_friction_that_slides_pushes():
    """A block between a belt and a platen: the belt has friction 4, the platen 3.

    Friction of the belt counted as sticking: the rest was at any x, in silence. Now the
    spring balances 4 - 3 or more: 2 x is in [1, 7], and the start is nearest to 0.5.
    """
    text = """
coordinates: {x: {}, y: {}, p: {}}
energy: {kinetic: x_dot^2/2 + y_dot^2/2 + p_dot^2/2, potential: x^2 + 4*y + 6*p}
constraints:
  platen: {relation: p - y >= 0, restitution: 0, friction: 0.5, slip: x_dot}
  belt: {relation: y >= 0, restitution: 0, friction: 0.4, slip: x_dot - 2}
initial: {x: 0.1, y: 0, p: 0}
"""
    [found] = lagsim.equilibrium(text, starts=3).equilibria
    assert found["coordinates"]["x"] == pytest.approx(0.5, abs=1e-9)
    assert found["lambda"] == pytest.approx({"platen": 6, "belt": 10})
    wanted = {"friction.platen": -3, "friction.belt": 4}
    assert found["friction"] == pytest.approx(wanted)
    assert found["continuum"] is True


@pytest.mark.slow
def test_the_rest_on_a_belt_is_followed_over_the_speed_of_the_belt():
    text = SLIDING_CONTACT.replace("MU", "0.2 + exp(-slip_speed)")
    text = "parameters: {V: 3}" + text.replace("x_dot - 3", "x_dot - V")
    [branch] = lagsim.equilibrium(text, starts=0, vary={"V": (0.5, 4)}).branches
    V = np.array([point["value"] for point in branch])
    assert [V[0], V[-1]] == [0.5, 4]
    x = np.array([point["coordinates"]["x"] for point in branch])
    assert x == pytest.approx((0.2 + np.exp(-V)) * 9.81 / 4, rel=1e-12)
