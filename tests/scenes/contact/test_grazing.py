"""Contacts that meet their ground just as they turn: they go on as if it was not there.

The speed of rounding is its root: what leaves with that of an impact is 1e-5 off.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.support import run

TEXT = """
coordinates: {{x: {{}}, heavy: {{}}}}
definitions: {{u: "x - ({at})", s: "t - {start}"}}
energy:
  kinetic: x_dot^2/2 + {mass}*heavy_dot^2/2
  potential: "{potential} + 3*{mass}*heavy^2/2"
forces: {{x: "{force}"}}
constraints: {{wall: {{relation: u >= 0, restitution: {e}}}}}
initial: {{x: {at} + {x}, x_dot: {v}, heavy: 1}}
simulation:
  {{start: {start}, duration: 20, output_step: 0.25, {steps}}}
"""


def stopped(width):
    """A spring's body, let go at 1 from where it is loose, stopped at -width."""
    first = math.acos(-width)

    def u(t):
        loose = np.where(t < first, np.cos(t), -width * np.cos(t - first))
        return width + loose

    return (f"(u - {width})^2/2", "0", 1.0 + width, 0.0, u, 1)


# Potential, force, start, speed; the exact motion, and how many impacts it has.
SCENES = {
    "stopped by a wall": stopped(0.3),
    "stopped by another": stopped(0.7),
    "pushed to and fro": ("0", "cos(s)", 0.0, 0.0, lambda t: 1 - np.cos(t), 0),
    "faster": (
        "0", "2*cos(3*s)", 0.0, 0.0, lambda t: 2 / 9 * (1 - np.cos(3 * t)), 0,
    ),
    "a throw": ("-u", "0", 0.5, -1.0, lambda t: (t - 1) ** 2 / 2, 0),
    "another throw": ("-2*u", "0", 0.09, -0.6, lambda t: (t - 0.3) ** 2, 0),
}  # fmt: skip
# Where, when, and beside what.
PLACES = [(0, 0, 1), (100, 0, 1), (-1e4, 5, 1), (0, 1e3, 1), (0, 0, 1e9), (3, 50, 1e9)]


# How steps are told, and their error.
STEPS = {
    "rtol: 1e-6": 1e-5, "rtol: 1e-9": 1e-8, "rtol: 1e-11": 1e-10,
    "method: rk4, step: 0.005": 1e-8,
}  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("steps", STEPS)
def test_it_turns_at_its_ground(steps, name, place):
    at, start, mass = place
    potential, force, x, v, exact, impacts = SCENES[name]
    for e in (0,) if impacts else (0, 0.5):
        found = run(TEXT.format(
            at=at, start=start, mass=mass, potential=potential, force=force, x=x, v=v,
            e=e, steps=steps,
        ))  # fmt: skip
        t, u = found["t"] - start, found["x"] - at
        size = np.max(np.abs(u))
        # Of places and times the last digits count.
        known = STEPS[steps] * size + 100 * np.spacing(abs(at) + abs(start) * size)
        assert np.max(np.abs(u - exact(t))) < known
        kinds = [event.kind for event in found.trajectory.events]
        assert kinds == ["impact"] * impacts


def test_what_bounces_hardly_faster_than_it_turns_comes_to_rest():
    """A ball on one that bounces without loss: a push parts them slowly, by turns."""
    found = run("""
coordinates: {x: {}, z: {}}
energy: {kinetic: 0.814*x_dot^2 + 1.265*z_dot^2, potential: 3.256*x + 5.06*z}
forces: {x: "2.643*sin(4.42*t)"}
constraints:
  floor: {relation: x >= 0.25, restitution: 1}
  between: {relation: z - x >= 0.5, restitution: 0}
initial: {x: 0.516, z: 1.341, x_dot: -1.112, z_dot: -0.063}
simulation: {duration: 2, output_step: 0.1}
""")
    assert found.trajectory.event_counts["impact"] < 100
