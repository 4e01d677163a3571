"""Arguments of the time alone whose terms cancel, but for their rounding.

Slopes of such arguments may be numbers, as 0.3 - 3*0.1, of some roundings.
"""

import pytest

import lagsim

# A step of F, with its value at 0.
STEPS = {
    "if(F < 0, 1, 0.25)": 0.25, "if(F >= 0, 1, 0.25)": 1, "sign(F)": 0,
    "heaviside(F)": 1, "max(min(floor(F + 2), 2), 1)": 2,
    "if(F < 0 or F > 0, 1, 0.25)": 0.25,
}  # fmt: skip
# Places x, y and z as functions of t, and combinations of these, which are 0.
ARGUMENTS = {
    "(-0.25)*(2.4*x + (-0.9)*y + (-1.2)*z)": (
        "1.71 + 0.78*t", "(-1.74) + 1.03*t", "4.725 + 0.7875*t",
    ),
    "0.65*(0.6*z + 3*x + 1.5*y)": (
        "1.95 + 0.99*t", "(-0.95) + (-0.22)*t", "(-7.375) + (-4.4)*t",
    ),
    "(-2.8)*y + (-1.792) + 1.3*x": (
        "(-0.63) + (-1.82)*t", "(-0.9325) + (-0.845)*t", "t",
    ),
}  # fmt: skip
SCENE = """
coordinates: {{w: {{}}}}
states: {{s: {{rate: "{step}"}}}}
definitions: {{x: "{x}", y: "{y}", z: "{z}"}}
energy: {{kinetic: w_dot^2/2, potential: 0}}
forces: {{w: "if(t < 1.3, 0, 0.5)"}}
initial: {{w: 0, w_dot: 0, s: 0}}
simulation: {{duration: 4, output_step: 0.1}}
"""


@pytest.mark.parametrize("argument", ARGUMENTS)
@pytest.mark.parametrize("step", STEPS)
def test_an_argument_of_the_time_that_stays_at_its_level(argument, step):
    x, y, z = ARGUMENTS[argument]
    text = SCENE.format(step=step.replace("F", f"({argument})"), x=x, y=y, z=z)
    result = lagsim.simulate(text, error_bar="never")
    assert result["s"][-1] == pytest.approx(4 * STEPS[step], abs=1e-9)
    assert {event.time for event in result.events} == {1.3}
