"""Switches whose argument is constant: its terms cancel, but for roundoff."""

from math import acos, pi

import pytest

from tests.support import run

SCENE = """
name: cancelled
modes: {{u: 0}}
coordinates: {{x: {{}}}}
energy: {{kinetic: x_dot^2/2, potential: x^2/2}}
forces: {{x: "{force}"}}
initial: {{x: 0, x_dot: 1}}
events:
  a: {{at: "2*x_dot - 0.83 <= {level} + 0.62", set: {{u: u + 1}}}}
simulation: {{duration: 4, output_step: 0.1}}
"""
# Each is -1.12: a motion x = sin(t) meets the condition where cos(t) = 0.165.
LEVELS = (
    "if(-x - 0.21 >= -x + 0.4, -0.25, -1.12)",
    "if(x_dot + 0.4 <= x_dot - 0.2, -0.25, -1.12)",
    "if(2*(x + t) - 1 > t + 2*x + t, -0.25, -1.12)",
    "-1.12*sign((sin(x) + 1) - (sin(x) - 1))",
    "(min(x + 0.4, x - 1.12) - x)",
    "(abs((x - 1.12) - x) - 2.24)",
    "(floor(x/2 + 0.5 - x/2) - 1.12)",
)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("in_force", [False, True])
def test_a_constant_switch_cuts_no_step(level, in_force):
    texts = ("0", level)
    if in_force:
        texts = (f"{level} + 1.12", "-1.12")
    found = run(SCENE.format(force=texts[0], level=texts[1]), most_steps=500)
    (event,) = found.trajectory.events
    # 1e-11 is the tolerance of the run; a step or two to each place are enough.
    assert event.time == pytest.approx(acos(0.165), abs=1e-10)
    assert event.time < pi
    assert found.trajectory.statistics.steps < 100
