"""Switches whose arguments are 0, but for rounding, on one side of another switch.

A place u = 1.7 x - 0.9 y + 0.31 of a free motion is below 0 until CROSSING, and above 0
then. Arguments are positive multiples of max(u, 0), written as sums of other terms.
"""

import pytest

import lagsim
from tests.run.switching.scenes import one_quick

X, VX, Y, VY = -0.63, 1.21, 0.47, -0.13
CROSSING = -(1.7 * X - 0.9 * Y + 0.31) / (1.7 * VX - 0.9 * VY)
SCENE = """
parameters: {{k: 0.3, l: 0.1, m: 0.2}}
coordinates: {{{order}}}
energy: {{kinetic: x_dot^2/2 + y_dot^2/2 + w_dot^2/2, potential: 0}}
forces: {{w: "{force} + if(t < 0.73, 0, 0.5)"}}
initial: {{x: {x!r}, y: {y!r}, w: 0, x_dot: {vx!r}, y_dot: {vy!r}, w_dot: 0}}
simulation: {{duration: 2, output_step: 0.1, method: {method}{step}}}
"""
U = "(1.7*x - 0.9*y + 0.31)"
ARGUMENTS = (
    "(2.9*x - 0.2*y + 0.31) - min(1.2*x + 0.7*y, 2.9*x - 0.2*y + 0.31)",
    "0.31*(max(1.7*x - 0.9*y + 0.31, 0) + 1.36*y - 0.87*y - 0.49*y)",
    "0.51*x - 0.27*y + 0.093 + 0.3*abs(0.9*y - 1.7*x - 0.31)",
    f"0.75*({U}*heaviside({U}) + (1.5 - 1.38*y) - 0.4*y - (1.5 - 1.78*y))",
    f"if({U} > 0, 1.8*x - 0.9*y + 0.31, 0.1*x) + 0.2*x - 0.3*x",
    f"{U}/3 + sqrt({U}^2)/3",
    "max(1.7*x - 0.9*y + 0.31, 0) + k*y - l*y - m*y",
)
# A step of F, with its values at 0 and above.
STEPS = {
    "sign(F)": (0, 1), "if(F > 0, 1, 0)": (0, 1), "if(F < 0, 1, 0)": (0, 0),
    "if(F <= 0, 1, 0)": (1, 0), "heaviside(-(F))": (1, 0),
    "min(ceil(F), 1)": (0, 1), "max(floor(-(F) + 2), 1)": (2, 1),
}  # fmt: skip
METHODS = ("dop853", "taylor", "radau", "rk4", "verlet")


@pytest.mark.parametrize("argument", one_quick(*ARGUMENTS))
@pytest.mark.parametrize("step", one_quick(*STEPS))
@pytest.mark.parametrize("method", one_quick(*METHODS))
def test_rounding_decides_no_side(argument, step, method):
    text = SCENE.format(
        force=step.replace("F", f"({argument})"), method=method, x=X, y=Y, vx=VX, vy=VY,
        order="x: {}, y: {}, w: {}", step=", step: 0.01" * (method in METHODS[3:]),
    )  # fmt: skip
    result = lagsim.simulate(text, error_bar="never")
    before, after = STEPS[step]
    speed = before * CROSSING + after * (2 - CROSSING) + 0.5 * (2 - 0.73)
    assert result["w_dot"][-1] == pytest.approx(speed, abs=1e-8)


def test_millimetres_far_from_the_origin():
    shift = 1e5 * 1.7
    argument = f"0.51*x - 0.27*y + {93 - 0.3e3 * shift!r} + 0.3*abs(1.7*x - 0.9*y + "
    argument += f"{310 - 1e3 * shift!r})"
    text = SCENE.format(
        force=f"sign({argument})", method="dop853", x=1e3 * X + 1e8, y=1e3 * Y,
        vx=1e3 * VX, vy=1e3 * VY, order="w: {}, y: {}, x: {}", step="",
    )  # fmt: skip
    result = lagsim.simulate(text, error_bar="never")
    speed = 2 - CROSSING + 0.5 * (2 - 0.73)
    assert result["w_dot"][-1] == pytest.approx(speed, abs=1e-8)
