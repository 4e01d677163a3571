"""The alarm for coordinates that lose their meaning, where constraints hold them."""

from __future__ import annotations

import pytest

from tests.studies.judged import cautions, codes
from tests.support import run

SINGULAR = "coordinate-singularity"
# A rigid body by a quaternion, free, or beside another body.
BODY = """\
parameters: {{A: {unit}, B: 2*{unit}, C: 3*{unit}}}
coordinates: {{a: {{}}, b: {{}}, c: {{}}, d: {{}}{names}}}
definitions:
  w1: 2*(a*b_dot - b*a_dot - c*d_dot + d*c_dot)
  w2: 2*(a*c_dot - c*a_dot - d*b_dot + b*d_dot)
  w3: 2*(a*d_dot - d*a_dot - b*c_dot + c*b_dot)
energy:
  kinetic: (A*w1^2 + B*w2^2 + C*w3^2)/2{kinetic}
  potential: {potential}
constraints: {{unit: a^2 + b^2 + c^2 + d^2 = 1}}
initial: {initial}
simulation: {{duration: 3, output_step: 0.1}}
"""
UNROTATED = "{a: 1, b: 0, c: 0, d: 0, b_dot: 0.1, c_dot: 0.5, d_dot: 0.1%s}"
HALF_TURN = "{a: 0, b: 0, c: -1, d: 0, a_dot: 0.3, b_dot: 0.5, d_dot: -0.4%s}"
# A particle that passes the pole of its polar coordinates at 1e-3 of where it starts.
POLAR = ", r: 1, phi: 0, r_dot: -1, phi_dot: 1e-3"


def body(initial, unit="1", names="", kinetic="", potential="0"):
    return BODY.format(
        initial=initial, unit=unit, names=names, kinetic=kinetic, potential=potential
    )


@pytest.mark.parametrize("initial", [UNROTATED, HALF_TURN])
@pytest.mark.parametrize("unit", ["1e-9", "1e9"])
def test_a_quaternion_is_no_gimbal(initial, unit):
    assert codes(run(body(initial % "", unit))) == []


@pytest.mark.parametrize("options", [{"method": "rk4", "step": 0.001}, {"rtol": 1e-5}])
def test_nor_is_one_by_another_method_or_tolerance(options):
    assert SINGULAR not in codes(run(body(UNROTATED % ""), **options))


def test_nor_beside_a_heavy_body():
    found = run(body(UNROTATED % ", x: 5, x_dot: 2", "1", ", x: {}", " + 1e12*x_dot^2"))
    assert codes(found) == []


@pytest.mark.parametrize("unit", ["1e-6", "1", "1e6"])
def test_polar_coordinates_beside_a_quaternion_still_are(unit):
    polar = f" + {unit}*(r_dot^2 + r^2*phi_dot^2)/2"
    found = run(body(UNROTATED % POLAR, unit, ", r: {}, phi: {}", polar))
    (caution,) = [c for c in cautions(found) if c.code == SINGULAR]
    assert "inertia of `phi`" in caution.text


# Euler's angles through the upright; a constraint holds spin, precession or neither.
TOP = """\
coordinates: {{phi: {{}}, theta: {{}}, psi: {{}}, x: {{}}}}
energy:
  kinetic: >
    (theta_dot^2 + (phi_dot*sin(theta))^2)/2
    + 0.6*(psi_dot + phi_dot*cos(theta))^2/2 + x_dot^2/2
  potential: 0
constraints: {{held: {held}}}
initial: {{phi: 0, theta: 0.5, psi: 0, x: 0, theta_dot: -1, x_dot: -1, phi_dot: {turn}}}
simulation: {{duration: 0.7, output_step: 0.01}}
"""


@pytest.mark.parametrize(
    ("held", "turn", "told"),
    [
        # What is left is theta and, of spin and precession, their sum.
        ("psi = 0", 0, False),
        ("psi = phi", 0, False),
        # What holds neither leaves both.
        ("x = theta - 0.5", 1e-3, True),
    ],
)
def test_angles_at_the_pole_are_one_where_a_constraint_leaves_one(held, turn, told):
    found = run(TOP.format(held=held, turn=turn), formulation="projection")
    # At the pole itself psi'' is no number.
    assert {*codes(found)} - {"column-not-finite"} == ({SINGULAR} if told else set())
