"""Stiff forces at tight tolerances: their roundoff, damped by an implicit step.

The references were made in quadruple precision (113 bits) by Radau IIA of 9 stages,
from the doubles of the models, by textbook equations. A tolerance larger by a factor of
100 changed the ends by less than 1e-17.
"""

import numpy as np
import pytest

from tests.small_scenes import stiff
from tests.support import run

HELD = stiff("duration: 1, output_step: 0.05, method: radau")
# Beside a slow coordinate x, a fast one z, at the distance s from 0, in other units.
BESIDE = """
parameters: {K: 1e8, c: 2e4, s: 0, l: 1, m: 1}
coordinates: {x: {}, z: {}}
definitions: {stretch: z - x - l*sin((x - s)/l)/2}
energy:
  kinetic: m*(x_dot^2 + z_dot^2)/2
  potential: m*(x - s)^2/2 + K*stretch^2/2
forces: {stretch: -c*stretch_dot}
initial: {x: s + l, z: s + l + l*sin(1)/2}
simulation: {duration: 2, output_step: 0.1, method: radau}
"""
# Eight bodies in pairs: stiff springs and dampers within them, soft springs between.
LATTICE = """
parameters: {K: 1e8, c: 2e4}
coordinates: {x(1..8): {}}
energy:
  kinetic: sum(i = 1..8, x_dot(i)^2)/2
  potential: "x(1)^4/4 + sum(i = 1..4, K*(x(2*i) - x(2*i - 1))^2/2)
    + sum(i = 1..3, (x(2*i + 1) - x(2*i))^2/2)"
  dissipation: "sum(i = 1..4, c*(x_dot(2*i) - x_dot(2*i - 1))^2/2)"
initial: {x(i = 1..8): (1 + floor((i - 1)/2))/4}
simulation: {duration: 5, output_step: 0.25, method: radau}
"""
HELD_8 = (0.6161058205692806, 0.6637891164911377, -0.4627886971522269,
          -0.5875462763062004)  # fmt: skip
HELD_12 = (0.616105816710486, 0.6637891173608469, -0.4627886964707437,
           -0.587546279106452)  # fmt: skip
BESIDE_8 = (0.37089816199331416, 0.552124497369486, -0.5233181103866604,
            -0.7671849229837281)  # fmt: skip
SHIFTED = (1000.3708981619933, 1000.5521244973695, -0.5233181103866723,
           -0.7671849229837452)  # fmt: skip
LATTICE_8 = (
    0.5877698117704687, 0.5877698131071224, 0.6520235595397926, 0.6520235587442774,
    0.4286713528920351, 0.4286713511225662, 0.29812786604447106, 0.2981278653917851,
    -0.0887144333878087, -0.08871443384270049, -0.08777109123391758,
    -0.08777109111944668, -0.06579709287186183, -0.06579709291945493,
    -0.09724789441648062, -0.09724789457375349,
)  # fmt: skip
MILLIMETRES = BESIDE.replace("K: 1e8, c: 2e4, s: 0, l: 1, m: 1",
                             "K: 1e5, c: 20, s: 0, l: 1000, m: 1e-3")  # fmt: skip
LIGHT = BESIDE.replace("K: 1e8, c: 2e4, s: 0, l: 1, m: 1",
                       "K: 0.1, c: 2e-5, s: 0, l: 1, m: 1e-9")  # fmt: skip
STIFFEST = HELD.replace("K: 1e8, c: 2e5", "K: 1e12, c: 2e7")
# Unit, end and largest error in units. A velocity has the rounding of its position,
# times some 10/h: with the steps of 1e-4 to 1e-2, 1e-15 of a size of 1 are 1e-11, and
# of a size of 1000 1e-8.
CASES = {
    "held": (HELD, 1.0, HELD_8, 1e-10),
    "held, K = 1e12": (STIFFEST, 1.0, HELD_12, 1e-9),
    "beside": (BESIDE, 1.0, BESIDE_8, 1e-9),
    "far from 0": (BESIDE.replace("s: 0", "s: 1000"), 1.0, SHIFTED, 1e-7),
    "millimetres and tons": (MILLIMETRES, 1000.0, BESIDE_8, 1e-9),
    "masses of 1e-9": (LIGHT, 1.0, BESIDE_8, 1e-9),
    "lattice": (LATTICE, 1.0, LATTICE_8, 1e-11),
}


@pytest.mark.parametrize("case", CASES)
def test_roundoff_of_stiff_forces_raises_no_tolerance_of_slow_motion(case):
    # With the roundoff of rates, times h, as tolerance the errors were 4 to 7,000 times
    # these bounds, and grew as rtol fell.
    text, unit, expected, floor = CASES[case]
    for rtol in ("1e-11", "1e-12", "1e-13"):
        found = run(text, rtol=rtol)
        end = found.rows[-1, 1 : 1 + len(expected)] / unit
        assert np.max(np.abs(end - expected)) < floor, rtol
        assert found.trajectory.statistics.steps < 4000, rtol


# The ring modulator, 15 states that begin at 0, of which some stay there until rounding
# or the motion breaks a symmetry. Source of the model and of the end: F. Mazzia and C.
# Magherini, Test Set for Initial Value Problem Solvers, release 2.4 (2008), II-2.
DIODES = {
    1: "y3 - y5 - y7 - fast", 2: "-y4 + y6 - y7 - fast",
    3: "y4 + y5 + y7 + fast", 4: "-y3 - y6 + y7 + fast",
}  # fmt: skip
RATES = (
    "(y8 - y10/2 + y11/2 + y14 - y1/25e3)/1.6e-8",
    "(y9 - y12/2 + y13/2 + y15 - y2/25e3)/1.6e-8",
    "(y10 - d1 + d4)/2e-12", "(-y11 + d2 - d3)/2e-12", "(y12 + d1 - d3)/2e-12",
    "(-y13 - d2 + d4)/2e-12", "(-y7/50 + d1 + d2 - d3 - d4)/1e-8",
    "-y1/4.45", "-y2/4.45",
    "(y1/2 - y3 - 17.3*y10)/5e-4", "(-y1/2 + y4 - 17.3*y11)/5e-4",
    "(y2/2 - y5 - 17.3*y12)/5e-4", "(-y2/2 + y6 - 17.3*y13)/5e-4",
    "(-y1 + slow - 86.3*y14)/2e-3", "(-y2 - 636.3*y15)/2e-3",
)  # fmt: skip
RING = "".join([
    "coordinates: {q: {}}\nenergy: {kinetic: q_dot^2/2, potential: 0}\ndefinitions:\n",
    "  slow: 0.5*sin(2e3*pi*t)\n  fast: 2*sin(2e4*pi*t)\n",
    *(f'  d{k}: "40.67286402e-9*(exp(17.7493332*({u})) - 1)"\n'
      for k, u in DIODES.items()),
    "states:\n", *(f'  y{k}: {{rate: "{r}"}}\n' for k, r in enumerate(RATES, 1)),
    "initial: {q: 0", *(f", y{k}: 0" for k in range(1, 16)), "}\n",
    "output: {columns: []}\n",
    "simulation: {duration: 1e-3, output_step: 1e-3, method: radau, rtol: 1e-8}\n",
])  # fmt: skip
RING_END = (
    -0.2339057358486745e-1, -0.7367485485540825e-2, 0.2582956709291169,
    -0.4064465721283450, -0.4039455665149794, 0.2607966765422943, 0.1106761861269975,
    0.2939904342435596e-6, -0.2840029933642329e-7, 0.7267198267264553e-3,
    0.7929487196960840e-3, -0.7255283495698965e-3, -0.7941401968526521e-3,
    0.7088495416976114e-4, 0.2390059075236570e-4,
)  # fmt: skip


@pytest.mark.slow
def test_states_that_begin_at_zero_by_symmetry_have_a_scale():
    # The run ended in its first step: a state without a scale was computed to 3e-322.
    found = run(RING)
    assert found["t"][-1] == 1e-3
    end = np.array([found[f"y{k}"][-1] for k in range(1, 16)])
    # Oscillations at 3e7 rad/s add up their errors over 5,000 periods.
    assert np.max(np.abs(end / RING_END - 1)) < 1e-5
