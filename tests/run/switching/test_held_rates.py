"""Steps of rates and positions that constraints and laws hold together."""

from __future__ import annotations

import math

import numpy as np
import pytest

import lagsim
from tests.run.switching.scenes import one_quick

# The block x is held: sign(x_dot) = 0, and z = 0.2 exp(-t). The coordinates differ,
# the motion does not.
HELD = """
coordinates: {{{coordinates}}}
states: {{z: {{rate: "0.7*sign(x_dot) - z"}}}}
definitions: {{{definitions}}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: 5*(x - y)^2/2}}
forces: {{x: {force}, y: 1}}
constraints:
  held: {{relation: x_dot = 0, limit: 6}}
{more}
initial: {{{start}, z: 0.2}}
simulation: {{duration: 0.5, output_step: 0.25}}
"""
LINK = "  link: w = -0.4*u\n"
# Coordinates, definitions, further constraints, starts.
FORMS = {
    "stated": ("x: {}, y: {}", "", "", "x: 0, y: 0"),
    "scaled": ("u: {}, y: {}", "x: 0.001*u", "", "u: 0, y: 0"),
    "linked": ("u: {}, w: {}, y: {}", "x: u + w", LINK, "u: 0, w: 0, y: 0"),
}
BESIDE = "  beside: {relation: x_dot - y_dot = 0, limit: 0.46}\n"

# Three blocks, each held by the one before; the first slips once the force is 1.2.
BLOCKS = """
coordinates: {{u: {{}}, v: {{}}, w: {{}}}}
definitions: {{x: {unit}*u, y: {unit}*v, z: {unit}*w}}
energy: {{kinetic: (x_dot^2 + 2*y_dot^2 + 0.5*z_dot^2)/2, potential: 0}}
forces: {{z: "4*sin(0.9*t) + {step}"}}
constraints:
  ground: {{relation: x_dot = 0, limit: {{static: 1.2, dynamic: 0.9}}}}
  lower: {{relation: y_dot - x_dot = 0, limit: {{static: 2, dynamic: 1.6}}}}
  upper: {{relation: z_dot - y_dot = 0, limit: {{static: 2.5, dynamic: 2.2}}}}
initial: {{u: 0, v: 0, w: 0}}
simulation: {{duration: 0.4, output_step: 0.1}}
"""


@pytest.mark.parametrize("force", ["0", *one_quick("3*sin(1.3*t)", "3*sin(t + 0.3)")])
@pytest.mark.parametrize("beside", one_quick(BESIDE, ""))
@pytest.mark.parametrize("form", ["linked", *one_quick("scaled", "stated")])
def test_a_rate_held_at_0_has_the_sign_0(form, beside, force):
    coordinates, definitions, link, start = FORMS[form]
    text = HELD.format(
        coordinates=coordinates, definitions=definitions, more=link + beside,
        start=start, force=force,
    )  # fmt: skip
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert not result.events
    # rtol 1e-11 per step
    assert result["z"] == pytest.approx(0.2 * np.exp(-result.t), rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["-0.001", *one_quick("1", "30")])
@pytest.mark.parametrize(
    "step", one_quick("if(mod(x + 2*y, 0.7) < 0.3, 0.5, 0)", "0.5*heaviside(x + y)")
)
def test_a_position_held_at_a_level_stays_there_until_the_slip(unit, step):
    text = BLOCKS.format(unit=unit, step=step)
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    (slip,) = result.events
    assert (slip.kind, slip.constraint) == ("slip", "ground")
    # The force is 0.5 at the level: 4 sin(0.9 t) = 1.2 - 0.5.
    assert slip.time == pytest.approx(math.asin(0.7 / 4.0) / 0.9, rel=1e-10)


@pytest.mark.parametrize(
    ("step", "expected"),
    one_quick(
        ("floor(3*(u + w))", lambda u, w: np.floor(3 * (u + w))),
        ("abs(u + w)", lambda u, w: np.abs(u + w)),
        ("if(w < u + 0.2*w, 2, 3)", lambda u, w: np.where(w < u + 0.2 * w, 2, 3)),
    ),
)
def test_a_column_has_a_step_of_an_eliminated_coordinate_beside_a_switch(
    step, expected
):
    text = f"""
coordinates: {{u: {{}}, w: {{}}}}
energy: {{kinetic: (u_dot^2 + w_dot^2)/2, potential: 0}}
definitions: {{shown: "{step}"}}
forces: {{u: "1 + 0.72*sign(u + w + 0.6)"}}
constraints: {{link: w = -0.4*u}}
initial: {{u: -1, w: 0.4, u_dot: 0.1, w_dot: -0.04}}
simulation: {{duration: 2, output_step: 0.13}}
"""
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    assert np.ptp(result["shown"]) > 0.5
    # rounding of sums in another order
    found = expected(result["u"], result["w"])
    assert result["shown"] == pytest.approx(found, abs=1e-15)
