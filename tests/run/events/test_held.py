"""States held by constraints are at rest: for conditions, steps, friction, impacts."""

import numpy as np
import pytest

from lagsim import simulate

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


@pytest.mark.slow
def test_a_cart_is_held_at_the_origin_as_beside_it():
    steps = [
        simulate(HELD.replace("PLACE", place), error_bar="never").record["steps"]
        for place in ("0", "1")
    ]
    # A step or two are of the rounding of places.
    assert steps[0] <= steps[1] + 2


@pytest.mark.slow
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


@pytest.mark.slow
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
    released = ["switch", "stick", "release", "slip"]
    assert kinds == (released if "when" in hold else [])
