"""Work of forces against laws and equalities that hold all of the motion.

The velocities are rounding then, and so is the work: the error of the quadrature must
not limit the steps. The runs took more than 80,000 steps for a few hundredths of a
second.
"""

import math

import pytest

import lagsim

LIMIT, WEIGHT, FORCE = 1.5, 0.8, 6.0
# The inertias of a, and of b = U + W with W = -0.4 U.
FREE, TIED = 2.0, 2.0 * (1 + 0.4**2) / 0.6**2
MODEL = """
coordinates: {{U: {{}}, W: {{}}, a: {{}}}}
definitions: {{b: U + W}}
parameters: {{scale: {scale}}}
energy:
  kinetic: scale*(a_dot^2 + U_dot^2 + W_dot^2)
  potential: scale*(0.8*b + 3*(a - b)^2/2)
forces: {{a: scale*6*{force}}}
constraints:
  e: {{relation: W = -0.4*U}}
  floor: {{relation: b >= 0, restitution: 0}}
  rub: {{relation: a_dot - b_dot = 0, limit: scale*1.5}}
initial: {{U: 0, W: 0, a: 0, U_dot: 0, W_dot: 0, a_dot: 0}}
simulation: {{duration: 0.2, output_step: 0.05, method: {method}}}
"""


@pytest.mark.parametrize("method", ["auto", "dop853", "dopri5"])
@pytest.mark.parametrize("scale", [1.0, 1e6, 1e-9])
def test_a_force_that_grows_from_0_against_a_limit_on_a_floor(scale, method):
    text = MODEL.format(force="sin(3*t)", scale=scale, method=method)
    found = lagsim.simulate(text, error_bar="never")
    # The limit lifts b once it transmits its weight; then a and b move together.
    part = FREE / (FREE + TIED)
    slips = (LIMIT - part * WEIGHT) / (1.0 - part)
    times = [math.asin(x / FORCE) / 3.0 for x in (WEIGHT, slips)]
    assert [(x.kind, x.time) for x in found.events] == [
        ("release", pytest.approx(times[0], rel=1e-8)),
        ("slip", pytest.approx(times[1], rel=1e-8)),
    ]
    assert found.record["steps"] < 200
