"""One-sided constraints with `when`: they are judged while they are in force."""

import numpy as np
import pytest

from lagsim import simulate

# A ball dropped from 5 cm onto a floor that is there for a while (g = 10).
TRAP = """
name: trap
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: 10*y}}
constraints:
  floor: {{relation: y >= 0, restitution: 0, when: {when}}}
initial: {{y: 0.05}}
simulation: {{duration: 1, output_step: 0.1}}
"""


@pytest.mark.parametrize("when", ["t < 0.5", "t < 0.5 and t >= 0", "not (t >= 0.5)"])
def test_a_trapdoor_opens(when):
    found = simulate(TRAP.format(when=when))
    assert not found.warnings
    assert found.error is not None
    t = found["t"]
    expected = np.where(t < 0.1, 0.05 - 5 * t**2, 0.0)
    expected = np.where(t > 0.5, -5 * (t - 0.5) ** 2, expected)
    assert found["y"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    "method",
    ["method: dop853", pytest.param("method: rk4, step: 0.01", marks=pytest.mark.slow)],
)
def test_a_latch_holds_where_its_event_acted(method):
    # x - z = d goes up to 0.6 and stays there, within rounding; x + z swings on.
    text = f"""
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: (x + z)^2}}
modes: {{h: 0, n: 0}}
events: {{grab: {{at: x - z >= 0.6, set: {{h: 1, n: n + 1}}}}}}
constraints: {{hook: {{relation: x - z = 0.6, when: h > 0}}}}
initial: {{x: 0.5, x_dot: 1.2, z: 0.5, z_dot: 0}}
simulation: {{duration: 20, output_step: 0.1, {method}}}
"""
    result = simulate(text, error_bar="never")
    t = result.t
    d, s = np.minimum(1.2 * t, 0.6), np.cos(2.0 * t) + 0.6 * np.sin(2.0 * t)
    bound = 1e-9 if "dop853" in method else 1e-5
    assert result["x"] == pytest.approx((s + d) / 2.0, abs=bound)
    assert result["n"][-1] == 1.0
    assert result.record["steps"] < 2100


# A mass on a spring along a ground on which y = 0.3 u + 0.7 w stays, but for rounding.
GROUND = """
coordinates: {u: {}, w: {}}
definitions: {y: 0.3*u + 0.7*w, x: 0.7*u - 0.3*w}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y + 2*x^2}
constraints: {floor: {relation: y >= 0, restitution: 0}}
initial: {u: 0.7, w: -0.3}
modes: {n: 0}
events: {low: {at: y <= 0, set: {n: n + 1}}}
"""


@pytest.mark.parametrize("until", ["y <= 0", "y_dot <= 0", "y = 0"])
@pytest.mark.parametrize("method", ["dop853", "rk4, step: 0.01", "moreau, step: 0.01"])
def test_what_is_true_at_the_start_and_held_stays_true(until, method):
    settings = f"{{duration: 5, output_step: 0.1, until: {until}, method: {method}}}"
    found = simulate(f"{GROUND}simulation: {settings}\n", error_bar="never")
    assert found.outcome == "done"
    assert found["n"][-1] == 0.0
    bound = 1e-9 if method == "dop853" else 1e-2
    assert found["x"] == pytest.approx(0.58 * np.cos(2.0 * found.t), abs=bound)


def test_what_is_true_at_the_start_and_leaves_counts_again():
    text = GROUND.replace("w: -0.3", "w: -0.3, u_dot: 0.3/0.58, w_dot: 0.7/0.58")
    found = simulate(
        f"{text}simulation: {{duration: 5, until: y <= 0}}\n", error_bar="never"
    )
    assert found.outcome == "until"  # thrown up at 1 m/s
    assert found.t[-1] == pytest.approx(2.0 / 9.81, abs=1e-10)


# Four links on a cart that a constraint holds at first.
HELD = """
parameters: {n: 4, m(1..n): [0.326, 1.002, 0.826, 0.652], l: 0.375}
coordinates: {X: {}, q(1..n): {}}
definitions:
  a(0): 0
  a(i = 1..n): a(i-1) + q(i)
  p(0): vec(X, 0)
  p(i = 1..n): p(i-1) + l*vec(sin(a(i)), -cos(a(i)))
gravity: [0, -9.81]
bodies: {bob(i = 1..n): {mass: m(i), at: p(i)}}
energy: {kinetic: bodies + 2.035*X_dot^2/2, potential: bodies}
constraints: {hold: {relation: X = PLACE, when: t < 0.892}}
initial:
  X: PLACE
  q(1..n): [0.981, -0.037, -0.769, 0.424]
  q_dot(1..n): [-0.029, -0.591, -0.672, 0.573]
simulation: {duration: 0.004, output_step: 0.004}
"""


def test_a_cart_is_held_at_the_origin_as_beside_it():
    steps = [
        simulate(HELD.replace("PLACE", place), error_bar="never").record["steps"]
        for place in ("0", "1")
    ]
    # A step or two are of the rounding of places.
    assert steps[0] <= steps[1] + 2


@pytest.mark.parametrize(
    "hold", ["{relation: X_dot = 0, limit: 99}", "X_dot = 5*(1 - b)"]
)
def test_what_is_held_at_rest_strikes_nothing(hold):
    text = HELD.replace("PLACE", "0").replace("0.004", "1", 1)
    text = text.replace("{relation: X = 0, when: t < 0.892}", hold)
    events = "{kick: {every: 0.17, set: {c: 1 - c}}}"
    text += f"modes: {{b: 1, c: 1}}\nevents: {events}\nforces: {{X: -3*c*X_dot}}\n"
    found = simulate(text, error_bar="never")
    assert {event.kind for event in found.events} == {"event"}


def test_what_follows_a_coordinate_that_is_held_takes_no_steps_of_its_own():
    text = HELD.replace("PLACE", "0").replace("0.004", "0.1")
    text = text.replace(
        "relation: X = 0, when: t < 0.892", "relation: X_dot = 0, limit: 99"
    )
    alone = simulate(text, error_bar="never")
    both = text.replace("  X: 0", "  u: 0\n  w: 0\n  X: 0", 1)
    both += "states: {u: {rate: X}, w: {rate: u}}\n"
    followed = simulate(both)
    assert followed.record["steps"] <= alone.record["steps"] + 2
    assert followed["w"] == pytest.approx(0.0, abs=1e-15)
    assert followed.record["error"]["relative"] < 1e-10


RUBBED = """
coordinates: {x: {}, y: {}}
energy:
  kinetic: x_dot^2 + ((x_dot + y_dot*cos(y))^2 + (y_dot*sin(y))^2)/2
  potential: -9.81*cos(y)
forces: {x: -2*sign(x_dot)}
constraints: {hold: HOLD}
initial: {x: X, y: 0.8}
simulation: {duration: 1, output_step: 0.1}
"""


@pytest.mark.parametrize("place", ["0", "1"])
@pytest.mark.parametrize(
    "hold", ["{relation: x = X, when: t < 0.5}", "{relation: x_dot = 0, limit: 9}"]
)
def test_friction_on_what_is_held_is_zero(hold, place):
    """A pendulum's pivot: its force is d/dt(y' cos y), as sign(0) = 0."""
    text = RUBBED.replace("HOLD", hold).replace("X", place)
    found = simulate(text, error_bar="never")
    held = found.t < 0.45
    y, v = found["y"][held], found["y_dot"][held]
    force = -9.81 * np.sin(y) * np.cos(y) - v * v * np.sin(y)
    assert found["lambda_hold"][held] == pytest.approx(force, abs=1e-9)
    kinds = [event.kind for event in found.events]
    released = ["switch", "release", "stick", "slip"]
    assert kinds == (released if "when" in hold else [])


JAMMED = """
parameters: {L: LENGTH, d: 0.368*L}
coordinates: {x: {}, q: {}}
definitions: {u: x + 0.375*L*sin(q), h: -0.375*L*cos(q)}
energy:
  kinetic: (0.352*x_dot^2 + 1.029*(u_dot^2 + h_dot^2))/2
  potential: 1.029*9.81*L*h
forces: {x: (7.52*sin(5.14*t) - 4.22*sign(x_dot))*L}
constraints: {floor: {relation: h >= -d, restitution: 0.5, friction: 0.2, slip: u_dot}}
initial: {x: 0.04*L, q: -0.255, q_dot: -0.384}
simulation: {duration: 1, output_step: 0.1}
"""


@pytest.mark.parametrize("length", ["1", "1000"])
def test_a_rod_that_jams_between_a_cart_and_a_floor_rests(length):
    """Its angle from the vertical has a tangent of 0.196, below the friction of 0.2."""
    found = simulate(JAMMED.replace("LENGTH", length), error_bar="never")
    assert found.outcome == "done"
    late = found.t > 0.7
    assert found["q"][late] == pytest.approx(-np.arccos(0.368 / 0.375), abs=1e-9)
    assert found["x_dot"][late] == pytest.approx(0.0, abs=1e-12 * float(length))


@pytest.mark.parametrize(("c", "s"), [(1, 0), (0.8, 0.6)])
def test_dry_friction_beside_a_limit_adds_to_it(c, s):
    # Coulomb: `sign` and `limit` on one slip hold it together, by the sum of both.
    text = """
parameters: {{F1: 8, F2: 2.4}}
coordinates: {{r(1..2): {{components: xyz}}}}
definitions: {{slip: "{c}*r_dot(2).x + {s}*r_dot(2).y"}}
gravity: [{s}*-3, {c}*3, -9]
bodies: {{b(i = 1..2): {{mass: 1 + i/4, at: r(i)}}}}
energy: {{kinetic: bodies, potential: bodies}}
forces: {{slip: "4*sin(5*t) - {force}"}}
constraints:
  rod: norm(r(1)) = 0.4
  bar: norm(r(2) - r(1)) = 0.4
  hold: {{relation: slip = 0, limit: {limit}}}
initial: {{r(1): [0.24, 0, 0.32], r(2): [0, 0.32, 0.32]}}
simulation: {{duration: 1, output_step: 0.1}}
"""
    two, one = (
        simulate(text.format(c=c, s=s, force=force, limit=limit), error_bar="never")
        for force, limit in (("F2*sign(slip)", "F1"), ("0", "F1 + F2"))
    )
    assert two.complete
    assert len(two.events) <= 3 * len(one.events) + 3
    for name in ("r.1.x", "r.2.x", "r.2.y", "r_dot.2.z"):
        assert two[name] == pytest.approx(one[name], abs=1e-10)


def test_a_disc_that_stops_beside_a_table_stops_once():
    # The springs push by less than the brake holds: what has come to rest stays there.
    found = simulate("""
coordinates: {x: {}, y: {}}
energy:
  kinetic: (x_dot^2 + 1.3*y_dot^2 + 0.4*x_dot*y_dot)/2
  potential: 10*x^2 + 5*(x - y)^2
tables: {force: {points: [[-1, 1], [0, 0], [1, -1.2]], interpolation: monotone}}
forces: {x: force(x)}
constraints: {brake: {relation: [x_dot = 0, y_dot = 0], limit: 8}}
initial: {x: 0.1, x_dot: 0.4, y: 0.05, y_dot: 0.3}
simulation: {duration: 1, output_step: 0.1}
""")
    assert [event.kind for event in found.events] == ["stick"]


def test_a_disc_stops_whenever_its_clock_began():
    # At t = 1e6 a rounding of the time changes its speed by 4e-9, late in its turn.
    text = """
coordinates: {{x: {{}}, y: {{}}}}
energy:
  kinetic: (x_dot^2 + 1.49*y_dot^2 - 0.49*x_dot*y_dot)/2
  potential: 60*x^2 + 30*(x - y)^2
constraints: {{brake: {{relation: [x_dot = 0, y_dot = 0], limit: 8.5}}}}
initial: {{x: 0.05, x_dot: -0.29, y: 0.05, y_dot: 0.32}}
simulation: {{start: {start}, duration: 1, output_step: 0.1}}
"""
    first, *later = (
        simulate(text.format(start=start), error_bar="never") for start in (0, 1e4, 1e6)
    )
    for found in later:
        assert [e.kind for e in found.events] == [e.kind for e in first.events]
        assert found["x"][-1] == pytest.approx(first["x"][-1], abs=1e-10)
        assert found["y"][-1] == pytest.approx(first["y"][-1], abs=1e-10)


@pytest.mark.parametrize("floor", [0, 1000, -3000])
def test_a_rod_falls_onto_a_floor_far_away_once(floor):
    # Without restitution it strikes once: at the height to which rounding has put it,
    # its foot is as much at rest as where it struck.
    text = f"""
parameters: {{Y: {floor}}}
coordinates: {{x: {{}}, y: {{}}, a: {{}}}}
definitions: {{gap: y - Y - cos(a)/2, foot: x - sin(a)/2}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2 + a_dot^2/24, potential: 9.81*(y - Y)}}
constraints:
  floor: {{relation: gap >= 0, restitution: 0, friction: 0.2, slip: foot_dot}}
initial: {{x: 0, y: Y + 0.552, a: 0.498, x_dot: 0.2, y_dot: -0.3, a_dot: 2.51}}
simulation: {{duration: 0.5, output_step: 0.1}}
"""
    found = simulate(text, error_bar="never")
    assert [event.kind for event in found.events] == ["impact", "contact"]


def test_dry_friction_of_a_floor_and_of_a_switch_add_until_it_lifts_off():
    # Coulomb: together they hold the slip by 0.2*10 + 0.5 = 0.25*10 N, until the block
    # is lifted at t = 3.3.
    text = """
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: (x_dot^2 + z_dot^2)/2, potential: 10*z}}
forces: {{x: "3*sin(3*t) - {force}", z: "if(t < 3.3, 0, 12)"}}
constraints:
  floor: {{relation: z >= 0, restitution: 0, friction: {mu}, slip: x_dot}}
initial: {{x: 0, z: 0, x_dot: 0.4}}
simulation: {{duration: 5, output_step: 0.1}}
"""
    two, one = (
        simulate(text.format(force=force, mu=mu), error_bar="never")
        for force, mu in (
            ("0.5*sign(x_dot)", 0.2),
            ("if(t < 3.3, 0, 0.5*sign(x_dot))", 0.25),
        )
    )
    assert two.complete
    assert len(two.events) <= 20
    for name in ("x", "z", "x_dot"):
        assert two[name] == pytest.approx(one[name], abs=1e-10)


BALLS = """
coordinates: {a: {}, b: {}, c: {}}
energy: {kinetic: (a_dot^2 + b_dot^2 + c_dot^2)/2, potential: 0}
forces:
  a: -if(a + 1 - b <= 0, 0, (a + 1 - b)^1.5)
  b: if(a + 1 - b <= 0, 0, (a + 1 - b)^1.5) - if(b + 1 - c <= 0, 0, (b + 1 - c)^1.5)
  c: if(b + 1 - c <= 0, 0, (b + 1 - c)^1.5)
initial: {a: 0, a_dot: 51, b: 1, b_dot: 50, c: 2, c_dot: 50}
simulation: {duration: 4, output_step: 0.2}
"""


def test_rows_are_written_where_a_step_ends_as_its_search_takes_too_long():
    found = simulate(BALLS, error_bar="never")
    mean = (found["a"] + found["b"] + found["c"]) / 3
    assert mean == pytest.approx(1.0 + 151.0 / 3.0 * found.t, abs=1e-10)
