"""What rows link keeps its steps in other words: no unit, place or bystander enters."""

from __future__ import annotations

import pytest

from tests.support import run

# A pendulum in the plane x = 0, where a row holds it that knows the other coordinates:
# x has no motion of its own. With lengths U of the units of x alone.
TEXT = """
parameters: {U: 1, X: 0, W: 0}
coordinates: {p: {}, y: {}, z: {}, far: {}}
definitions: {x: U*p - X}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2 + far_dot^2/2, potential: 9.81*z}
constraints: {rod: x^2 + y^2 + z^2 = 1, plane: x = x^2 + y^2 + z^2 - 1}
initial: {p: X/U, y: 0.6, z: -0.8, far: 0, far_dot: W}
simulation: {duration: 5, output_step: 0.1, method: dop853, rtol: 1e-7}
"""


def steps(**values):
    text = TEXT
    for name, value in values.items():
        was = "1" if name == "U" else "0"
        text = text.replace(f"{name}: {was}", f"{name}: {value}")
    return run(text).trajectory.statistics.steps


@pytest.mark.parametrize("values", [{"U": "1e-9"}, {"U": "1e9"}, {"W": "1e9"}])
def test_steps_are_those_of_the_same_motion_in_other_words(values):
    assert steps(**values) == pytest.approx(steps(), rel=0.02)
