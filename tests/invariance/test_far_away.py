"""Motions do not depend on the origin, its velocity, and the units."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.small_scenes import quarter
from tests.small_scenes import swing as swinging
from tests.support import run

ROUNDING = 2.0**-53
LENGTH, CART, BOB, WEIGHT = 0.1, 1000.0, 1.0, 9.81

CRANE = """
parameters: {{X: {place!r}, V: {speed!r}, L: {length!r}, g: {weight!r}}}
coordinates: {{c: {{}}, x: {{}}, y: {{}}}}
energy: {{kinetic: "1000*c_dot^2/2 + (x_dot^2 + y_dot^2)/2", potential: "g*y"}}
constraints: {{rod: "(x - c)^2 + y^2 = L^2"}}
initial: {{c: X, x: X + 0.8*L, y: -0.6*L, c_dot: V, x_dot: V, y_dot: 0}}
simulation: {{duration: {end!r}, output_step: {step!r}}}
"""


def crane(place=0.0, speed=0.0, metre=1.0, second=1.0):
    """Return a cart with a pendulum, in units of 1/`metre` m and 1/`second` s."""
    return CRANE.format(
        place=place * metre, speed=speed * metre / second, length=LENGTH * metre,
        weight=WEIGHT * metre / second**2, end=10.0 * second, step=0.1 * second,
    )  # fmt: skip


@pytest.fixture(scope="module")
def swing():
    """Return the angle from the vertical by the reduced equation, momentum being 0."""
    part = BOB / (BOB + CART)

    def rates(_t, s):
        sine, cosine = math.sin(s[0]), math.cos(s[0])
        pull = -WEIGHT / LENGTH * sine - part * s[1] ** 2 * sine * cosine
        return [s[1], pull / (1.0 - part * cosine**2)]

    times = np.linspace(0.0, 10.0, 101)
    found = solve_ivp(
        rates, (0.0, 10.0), [math.asin(0.8), 0.0], method="DOP853",
        rtol=1e-13, atol=1e-15, t_eval=times,
    )  # fmt: skip
    return found.y[0]


@pytest.mark.parametrize(
    ("place", "speed"),
    [
        (1e3, 0),
        (1e6, 0),
        (0, 1e4),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in [(0, 0), (1e7, 0), (-1e5, 1e3)]
        ),
    ],
)
def test_a_cart_far_away_or_in_motion(place, speed, swing):
    result = run(crane(float(place), float(speed)))
    assert result.trajectory.outcome.complete
    assert not result.trajectory.warnings
    # What doubles hold of the places, in each of some hundred steps.
    far = abs(place) + 10.0 * abs(speed)
    allowed = 1e-10 * LENGTH + 300.0 * ROUNDING * far
    assert np.max(np.abs(result["y"] + LENGTH * np.cos(swing))) < allowed
    aside = result["x"] - result["c"]
    assert np.max(np.abs(aside - LENGTH * np.sin(swing))) < allowed
    rod = np.hypot(aside, result["y"])
    assert np.max(np.abs(rod - LENGTH)) < 1e-16 + 4.0 * ROUNDING * far


@pytest.mark.parametrize(
    "method", ["auto", "dop853", pytest.param("radau", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    ("metre", "second"),
    [
        pytest.param(2.0**10, 1.0, marks=pytest.mark.slow),
        (2.0**-20, 1.0),
        (1.0, 2.0**-25),
    ],
)
def test_units_change_no_step(metre, second, method):
    # Powers of 2, so that nothing is rounded differently.
    plain = run(crane(), method=method, rtol="1e-8")
    other = run(crane(metre=metre, second=second), method=method, rtol="1e-8")
    off = np.abs(other.rows[:, 1:4] / metre - plain.rows[:, 1:4])
    # But for the step of a series, which goes through a logarithm.
    assert np.max(off) <= (1e-12 if method == "auto" else 0.0)
    assert other.trajectory.statistics.steps == plain.trajectory.statistics.steps


@pytest.mark.parametrize(
    ("turned", "formulation"),
    [
        (5000.0, "full"),
        pytest.param(1e9, "full", marks=pytest.mark.slow),
        pytest.param(5000.0, "auto", marks=pytest.mark.slow),
        pytest.param(5000.0, "projection", marks=pytest.mark.slow),
    ],
)
def test_a_wheel_that_has_turned_far(turned, formulation):
    text = f"""
coordinates: {{phi: {{}}, x: {{}}, y: {{}}}}
energy: {{kinetic: "(phi_dot^2 + x_dot^2 + y_dot^2)/2", potential: "9.81*y"}}
constraints: {{rod: "x^2 + y^2 = 0.01"}}
initial: {{phi: {turned}, phi_dot: 1, x: 0.06, y: -0.08, x_dot: 0, y_dot: 0}}
simulation: {{duration: 10, output_step: 0.1, formulation: {formulation}}}
"""
    result = run(text)
    angle = swinging(np.sqrt(98.1) * result["t"], math.asin(0.6))
    assert np.max(np.abs(result["x"] - 0.1 * np.sin(angle))) < 1e-11
    assert not result.trajectory.warnings


@pytest.mark.slow
@pytest.mark.parametrize("place", [1e3, 1e5])
def test_rows_that_vanish_nowhere_near_are_not_seen_to(place):
    # A point on a line, in coordinates whose size says nothing.
    text = f"""
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: "(x_dot^2 + y_dot^2)/2", potential: "9.81*y"}}
constraints: {{bowl: "y = (x - {place!r})^2/2"}}
initial: {{x: {place + 1.0!r}, y: 0.5, x_dot: 0, y_dot: 0}}
simulation: {{duration: 5, output_step: 0.1, formulation: projection}}
"""
    result = run(text)
    u = result["x"] - place
    energy = (1.0 + u**2) * result["x_dot"] ** 2 / 2.0 + 9.81 * u**2 / 2.0
    # The energy of the start, 9.81/2; the place is held to some roundings of itself.
    assert np.max(np.abs(energy - 4.905)) < 1e-9 + 1e3 * ROUNDING * place
    assert not result.trajectory.warnings


LEANING = """
coordinates: {{X: {{}}, q: {{}}}}
definitions: {{bob: "vec(X + 0.4*sin(q), -0.4*cos(q))"}}
gravity: [0, -9.81]
bodies: {{bob: {{mass: 0.4, at: bob}}}}
energy: {{kinetic: "bodies + X_dot^2/2", potential: bodies}}
constraints: {{wall: {{{law}}}}}
initial: {{X: "{place!r} + 0.32", X_dot: "{speed}", q: 1.2}}
simulation: {{duration: {end}, output_step: 0.1, method: {method}}}
"""


@pytest.mark.parametrize("place", [1e3, 1e6])
def test_a_cart_leaves_its_wall_when_the_rod_pulls_no_more(place):
    # At the bottom of the swing, a quarter of its period. No double is at the wall.
    law = f'relation: "X - {place!r} <= 0.32", restitution: 0'
    result = run(
        LEANING.format(law=law, place=place, speed=0, end=0.4, method="dop853")
    )
    (release,) = result.trajectory.events
    assert (release.kind, release.constraint) == ("release", "wall")
    at = math.sqrt(0.4 / 9.81) * quarter(1.2)
    assert release.time == pytest.approx(at, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("relation", "speed"),
    [("X - 1e6 = 0.32", "0"), ("X_dot - 1e6 = 0.32", "1e6 + 0.32")],
)
def test_what_a_held_cart_bears_does_not_drift_with_each_projection(relation, speed):
    text = LEANING.format(
        law=f'relation: {relation}, when: "t < 100"', place=1e6, speed=speed, end=5,
        method="rk4, step: 0.001",
    )  # fmt: skip
    result = run(text)
    swing = swinging(math.sqrt(9.81 / 0.4) * result["t"], 1.2)
    assert np.max(np.abs(result["q"] - swing)) < 1e-10


@pytest.mark.parametrize("start", [0.0, 1e4, 33333.3])
def test_a_belt_turns_back_under_a_block_on_a_rail_at_any_time(start):
    # The belt holds it until both rest; then the rail holds it: 6 - 1 N of its 6 N.
    text = f"""
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: -x}}
forces: {{x: -6*sign(x_dot)}}
constraints:
  belt: {{relation: "x_dot = 0.1*cos(5.85*(t - {start!r}))", limit: 6}}
initial: {{x: 0, x_dot: 0.1}}
simulation: {{start: {start!r}, duration: 0.5, output_step: 0.1, method: dop853}}
"""
    result = run(text)
    assert result.trajectory.outcome.complete
    events = result.trajectory.events
    assert sorted(e.kind for e in events) == ["slip", "stick"]
    assert {e.time for e in events} == {events[0].time}
    assert events[0].time - start == pytest.approx(math.pi / 2 / 5.85, abs=1e-11)
    assert result["x"][-1] == pytest.approx(0.1 / 5.85, abs=1e-12)
