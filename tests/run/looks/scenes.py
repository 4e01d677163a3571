"""Scenes with short features, and their motion by an independent solver."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.run.switching.scenes import scene

METHODS = (
    pytest.param("auto", marks=pytest.mark.slow),
    "taylor",
    pytest.param("dop853", marks=pytest.mark.slow),
    pytest.param("radau", marks=pytest.mark.slow),
)
PLANE = """
coordinates: {{x: {{}}, y: {{}}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: "{potential}"}}
forces: {{x: "{force_x}", y: "{force_y}"}}
initial: {{x: {x}, y: {y}, x_dot: {vx}, y_dot: {vy}}}
simulation: {{duration: {duration}, output_step: {step}, method: {method}}}
"""


def line(
    potential="0*x", *, force="0*x", x=0, v=0, duration=20, step=0.1, method="auto",
    until=None,
):  # fmt: skip
    more = f", method: {method}" + (f', until: "{until}"' if until else "")
    return scene(
        potential, force, x=x, v=v, duration=duration, output_step=step, more=more
    )


def plane(
    potential="0*x", start=(0, 0, 0, 0), *, forces=("0*x", "0*x"), duration=20,
    step=0.1, method="auto",
):  # fmt: skip
    x, y, vx, vy = start
    return PLANE.format(
        potential=potential, force_x=forces[0], force_y=forces[1], x=x, y=y, vx=vx,
        vy=vy, duration=duration, step=step, method=method,
    )  # fmt: skip


def stepped(field, start, duration, longest):
    """Return the end of y' = field(t, y), by steps of at most `longest`."""
    found = solve_ivp(
        field, (0, duration), start, "DOP853", rtol=1e-11, atol=1e-13, max_step=longest
    )
    assert found.success
    return np.array(found.y[:, -1])
