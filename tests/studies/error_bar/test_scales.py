"""What errors are measured by: each coordinate's own motion."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.model.reader import read
from tests.studies.judged import barred

LIGHT = """
parameters: {m: 1e-3, M: 1e27, R: 1e9}
coordinates: {x: {}, y: {}}
energy: {kinetic: "(m*x_dot^2 + M*y_dot^2)/2", potential: "m*(1 - cos(x)) + M*y^2/2"}
initial: {x: 2, y: R}
simulation: {duration: 30, output_step: 0.1, method: rk4, step: 0.05}
"""


def test_a_light_body_does_not_hide_behind_a_heavy_one():
    # In the metric of M one part in a million of y would be 1e18 times the range of x.
    alone = LIGHT.replace("R: 1e9", "R: 0")
    parts = [barred(read(text, "m.yaml"))[1].parts[:, 0] for text in (alone, LIGHT)]
    assert np.max(parts[0]) > 1e-8
    assert np.max(parts[1]) == pytest.approx(np.max(parts[0]), rel=1e-6)


@pytest.mark.parametrize("heavy", ["1e-6", "1", "1e12"])
def test_what_stays_still_beside_a_motion_has_no_horizon(heavy):
    # z is off by rounding only, and its range is rounding, too.
    text = """
parameters: {M: 1}
coordinates: {x: {}, z: {}}
energy: {kinetic: (M*x_dot^2 + z_dot^2)/2, potential: M*x^2/2 + z^2}
initial: {x: 1, z: 1e-14}
simulation: {duration: 100, output_step: 0.5, method: dop853}
"""
    bar = barred(read(text.replace("M: 1}", f"M: {heavy}}}"), "m.yaml"))[1]
    assert bar.horizon is None


@pytest.mark.parametrize("step", ["1", "2", "3", "6.5"])
@pytest.mark.parametrize("method", ["auto", "taylor", "dop853", "radau"])
def test_rows_in_phase_with_the_motion_are_no_scale(step, method):
    # x = sin(2 pi t): of rows a period apart, or half of one, the range is rounding.
    text = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 2*pi^2*x^2}
initial: {x: 0, x_dot: 2*pi}
simulation: {duration: 13, output_step: 1}
"""
    options = {"method": method, "output_step": step, "rtol": "1e-9"}
    bar = barred(read(text, "m.yaml", options=options))[1]
    assert bar.scales == pytest.approx([2.0], rel=0.1)
    assert bar.relative < 1e-6
    assert bar.horizon is None


def test_a_place_far_away_is_no_scale():
    near = """
parameters: {L: 0}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: -cos(x - L)}
initial: {x: L + 2}
simulation: {duration: 20, output_step: 0.1, method: dop853, rtol: 1e-6}
"""
    far = near.replace("L: 0", "L: 4096")
    scales = [barred(read(text, "m.yaml"))[1].scales for text in (near, far)]
    assert scales[0] == pytest.approx(scales[1], rel=1e-3)
    # What rounding alone makes of the place is told, too.
    bar = barred(read(far, "m.yaml", options={"rtol": "1e-13"}))[1]
    assert bar.coordinates["x"].largest >= 4096 * 2.0**-53


# A pendulum in the plane x = 0, on which a row holds it that knows the other two.
PLANE = """
parameters: {{L: 1, m: 1}}
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: m*(x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 9.81*m*z}}
constraints: {{rod: x^2 + y^2 + z^2 = L^2{more}}}
initial: {{x: 0, y: 0.6*L, z: -0.8*L}}
simulation: {{duration: 5*sqrt(L), output_step: 0.1*sqrt(L), method: dop853}}
"""


@pytest.mark.parametrize("length", ["1e-9", "1", "1e6"])
def test_what_rows_keep_at_rest_is_told_as_a_part_of_what_it_is_linked_with(length):
    # x is 0 for ever; what a double loses of the other two is all that it has.
    row = "x = 0.25*(x^2 + y^2 + z^2 - L^2)/L"
    text = PLANE.format(more=f", plane: {row}")
    bar = barred(read(text.replace("L: 1", f"L: {length}"), "m.yaml"))[1]
    told = bar.coordinates["x"]
    assert told.largest < 1e-14 * float(length)
    assert told.relative < 1e-12
    assert bar.scales[1] == pytest.approx(1.2 * float(length), rel=1e-2)


def test_a_small_motion_is_not_hidden_by_what_it_is_linked_with():
    # y = z^2 is 1e-10 of the way of z, a motion of its own, thousands of roundings.
    text = """
coordinates: {y: {}, z: {}}
energy: {kinetic: (y_dot^2 + z_dot^2)/2, potential: z^2/2}
constraints: {path: y = 1e-10*z^2}
initial: {y: 1e-10, z: 1}
simulation: {duration: 10, output_step: 0.1, method: dop853}
"""
    bar = barred(read(text, "m.yaml"))[1]
    assert bar.scales[0] < 1e-8


def test_what_rests_at_its_place_is_told_as_a_part_of_that():
    # Rounding of its value alone, beside what moves ten times as far.
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
initial: {x: 1, y: 0}
simulation: {duration: 1.4, output_step: 0.1, method: dop853}
"""
    told = barred(read(text, "m.yaml"))[1].coordinates["x"]
    assert 0.0 < told.largest < 1e-15
    assert told.relative < 1e-15
