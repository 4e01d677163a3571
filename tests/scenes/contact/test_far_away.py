"""Short flights far from the origin: they begin a rounding below the ground."""

import math

import numpy as np
import pytest

from tests.support import run

TEXT = """
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: 9.81*y*{hertz!r}^2}}
constraints:
  f: {{relation: "y - ({at!r}) - {speed!r}*{hertz!r}*(t - {start!r}) >= 0",
       restitution: 0.5}}
initial: {{y: {at!r} + 1, y_dot: {speed!r}*{hertz!r}}}
simulation:
  {{start: {start!r}, duration: 1.4/{hertz!r}, output_step: 0.02/{hertz!r},
    method: {method}}}
"""


@pytest.mark.parametrize("method", ["dop853", "auto"])
@pytest.mark.parametrize(("speed", "start", "hertz"), [
    (0.0, 0.0, 1.0), (10.0, 0.0, 1.0),
    # The ground goes on by 1e-6 where the time does so by its last place.
    (1e4, 1e3, 1e3),
])  # fmt: skip
@pytest.mark.parametrize("at", [-1e4, 1e4 / 3, 7e4 / 11, 1e6 / 7])
def test_impacts_are_known_as_well_as_positions_are(at, speed, start, hertz, method):
    moved = {"at": at, "speed": speed, "start": start, "hertz": hertz}
    found = run(TEXT.format(**moved, method=method))
    times = [e.time for e in found.trajectory.events if e.kind == "impact"]
    times = (np.array(times) - start) * hertz
    assert len(times) > 6
    # Flights take half of the one before; what strikes at v knows its gap by some units
    # in the last place of where it is, and the next flight begins so much wrong.
    first, k = math.sqrt(2 / 9.81), np.arange(len(times))
    exact = first * (1 + 2 * (1 - 0.5**k))
    last = np.spacing(abs(at) + 1.4 * speed) + speed * hertz * np.spacing(start)
    off = 16 * last / (first * 9.81 * 0.5**k)
    assert np.all(np.abs(times - exact) < off), (times - exact) / off
    assert found.trajectory.statistics.arcs == len(times) + 1


@pytest.mark.parametrize("e", [0.5, 0.9, 1])
def test_flights_do_not_end_by_the_rounding_of_the_time(e):
    """The ground goes on by 1e-3 where the time does so by its last place."""
    text = TEXT.replace("restitution: 0.5", f"restitution: {e}")
    found = run(text.format(at=0.0, speed=1e7, start=1e3, hertz=1e3, method="auto"))
    assert found.trajectory.event_counts["impact"] == 2
    assert found.trajectory.statistics.arcs == 3


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
    found = run(text)
    assert [event.kind for event in found.trajectory.events] == ["impact", "contact"]


@pytest.mark.parametrize("at", [0.0, 1e4, 1e6])
def test_a_slip_that_a_force_turns_stops_at_its_time_far_away(at):
    # Of a mass of 1 under a limit of 2, with a path of 4 um: it turns until it stops.
    speed, push, limit = 4e-3, np.array([-0.3, 0.5]), 2.0
    found = run(
        "coordinates: {x: {}, y: {}}\n"
        "energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}\n"
        f"forces: {{x: {push[0]}, y: {push[1]}}}\n"
        f"constraints: {{f: {{relation: [x_dot = 0, y_dot = 0], limit: {limit}}}}}\n"
        f"initial: {{x: 0, y: {at!r}, x_dot: {speed}, y_dot: 0}}\n"
        "simulation: {duration: 0.01}\n"
    )
    # By v' = P - L v/|v|, v.P + L |v| falls at the constant rate L^2 - P^2.
    stop = speed * (push[0] + limit) / (limit**2 - push @ push)
    times = [e.time for e in found.trajectory.events if e.kind == "stick"]
    assert times == pytest.approx([stop], rel=1e-9)
