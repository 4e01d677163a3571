"""Levels at which the motion stays by itself, since rates of its argument cancel.

The terms of `co . x + c` cancel at the start, as do their rates and their second
derivatives, in decimal numbers: each argument is 0 for ever, but for its rounding.
"""

import pytest

import lagsim
from tests.run.switching.scenes import one_quick

CARRIERS = {  # coordinates, states, forces and initial values; the argument
    "states": (
        "", "x: {rate: 0.1}, y: {rate: 0.3}", "", "x: 0.2, y: 0.6", "y - 3*x",
    ),
    "free": (
        "x: {}, y: {}", "", "", "x: -0.37, y: 0.1, x_dot: 0.1, y_dot: 0.3",
        "y - 3*x - 1.21",
    ),
    "beside a state": (
        "y: {}", "x: {rate: -1.47}", "", "x: 1.26, y: -0.36, y_dot: 0.42",
        "0.2*x + 0.7*y",
    ),
    "accelerated": (
        "x: {}, y: {}", "", "x: 0.7, y: 2.1,", "x: 0.2, y: 0.6, x_dot: 0.1, y_dot: 0.3",
        "0.7*y - 2.1*x",
    ),
    "oscillating": (
        "x: {}, y: {}", "", "x: -x, y: -y,", "x: 0.2, y: 0.6, x_dot: 0.1, y_dot: 0.3",
        "y - 3*x",
    ),
    "velocities": (
        "x: {}, y: {}", "", "x: 0.7, y: 2.1,", "x: 7, y: 3, x_dot: 0.1, y_dot: 0.3",
        "y_dot - 3*x_dot",
    ),
}  # fmt: skip
SCENE = """
coordinates: {{{coordinates}w: {{}}}}
states: {{{states}}}
energy: {{kinetic: "{kinetic}w_dot^2/2", potential: 0}}
forces: {{{forces} w: "{force}"}}
initial: {{w: 0, w_dot: 0, {initial}}}
simulation: {{duration: 4, output_step: 0.1, method: {method}{step}}}
"""
# A step of F, with its value at 0.
STEPS = {
    "if(F < 0, 1, 0.25)": 0.25, "if(F >= 0, 1, 0.25)": 1, "sign(F)": 0,
    "heaviside(F)": 1, "max(min(floor(F + 2), 2), 1)": 2, "abs(sign(F))": 0,
}  # fmt: skip
METHODS = ("rk4", "dop853", "taylor", "radau")


@pytest.mark.parametrize("carrier", one_quick(*CARRIERS))
@pytest.mark.parametrize("step", one_quick(*STEPS))
@pytest.mark.parametrize("method", one_quick(*METHODS))
def test_an_argument_that_stays_at_its_level(carrier, step, method):
    coordinates, states, forces, initial, argument = CARRIERS[carrier]
    names = [name for name in "xy" if f"{name}: {{}}" in coordinates]
    text = SCENE.format(
        coordinates=f"{coordinates}, " * bool(coordinates), states=states,
        kinetic="".join(f"{name}_dot^2/2 + " for name in names), forces=forces,
        force=f"{step.replace('F', f'({argument})')} + if(t < 1.3, 0, 0.5)",
        initial=initial, method=method, step=", step: 0.01" * (method == "rk4"),
    )  # fmt: skip
    if not states:
        text = text.replace("states: {}\n", "")
    result = lagsim.simulate(text, error_bar="never")
    speed = 4 * STEPS[step] + 0.5 * (4 - 1.3)
    assert result["w_dot"][-1] == pytest.approx(speed, abs=1e-9)
    assert {event.time for event in result.events} == {1.3}
