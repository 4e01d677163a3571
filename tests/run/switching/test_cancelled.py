"""Switches whose argument is constant, since its terms cancel but for roundoff."""

from math import acos

import pytest

from tests.choosing import tonight, turn
from tests.run.switching.scenes import one_quick
from tests.support import run

SCENE = """
name: cancelled
modes: {{u: 0}}
parameters: {{p: 0.4, r: 0.2}}
coordinates: {{x: {{}}}}
definitions: {{z: x + p}}
energy: {{kinetic: x_dot^2/2, potential: x^2/2}}
forces: {{x: "{force}"}}
initial: {{x: 0, x_dot: 1}}
events:
  a: {{at: "2*x_dot - 0.83 <= {level} + 0.62", set: {{u: u + 1}}}}
simulation: {{duration: 4, output_step: 0.1, method: {method}}}
"""
# Each is -1.12: the motion x = sin(t) meets the condition where cos(t) = 0.165.
LEVELS = (
    "if(-x - 0.21 >= -x + 0.4, -0.25, -1.12)",
    "if(x_dot + 0.4 <= x_dot - 0.2, -0.25, -1.12)",
    "if(2*(x + t) - 1 > t + 2*x + t, -0.25, -1.12)",
    "-1.12*sign((sin(x) + 1) - (sin(x) - 1))",
    "(min(x + 0.4, x - 1.12) - x)",
    "(abs((x - 1.12) - x) - 2.24)",
    "(floor(x/2 + 0.5 - x/2) - 1.12)",
    "if(x + p <= x - r, -0.25, -1.12)",
    "-1.12*heaviside(z - x)",
    "(mod(z - x, 1) - 1.52)",
    "if(exp(x)*exp(-x) < 0.5, -0.25, -1.12)",
    "if(sin(x)^2 + cos(x)^2 < 0.5, -0.25, -1.12)",
)
METHODS = ("auto", "dop853", "taylor", "radau")


@pytest.mark.parametrize("level", one_quick(*LEVELS))
@pytest.mark.parametrize("in_force", [False, True])
def test_a_constant_switch_cuts_no_step(level, in_force):
    method = turn(
        f"{level} {in_force}", tonight(), ("auto", "dop853", "taylor", "radau")
    )
    texts = (f"{level} + 1.12", "-1.12") if in_force else ("0", level)
    found = run(
        SCENE.format(force=texts[0], level=texts[1], method=method), most_steps=1000
    )
    (event,) = found.trajectory.events
    # 1e-11 is the tolerance of the run; radau takes some 300 steps anyway.
    assert event.time == pytest.approx(acos(0.165), abs=1e-10)
    assert found.trajectory.statistics.steps < (500 if method == "radau" else 100)


def test_a_switch_of_roundoff_alone_ends_no_step_at_each_of_its_signs():
    """The argument is 0 or some roundoff, of either sign: it has no places."""
    level = "-1.12 + 1e-7*sign((x + 0.3) - 0.1 - x - 0.2)"
    text = SCENE.format(force="0", level=level, method="auto")
    found = run(text, most_steps=1000)
    (event,) = found.trajectory.events
    # The condition is known to 1e-7, as its sign is not: cos'(t) is about -1.
    assert event.time == pytest.approx(acos(0.165), abs=1e-7)
