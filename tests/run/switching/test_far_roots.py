"""Laws with a root at their switch, met where positions have few places left."""

import numpy as np
import pytest

from lagsim.run.trajectory import Outcome
from tests.support import run

ROOT = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: "4*(x - A)^2 + abs(x - B)^POWER"}
initial: {x: X, x_dot: 0.1}
parameters: {A: AT, B: EDGE}
simulation: {duration: 8, output_step: 0.25}
"""


def potential(d, power):
    return 4 * d**2 + abs(d - 0.3) ** power


@pytest.mark.parametrize("power", [1.2, 1.5, 1.8])
@pytest.mark.parametrize("at", [0.0, 100.0, -14900.0, 2e6])
def test_the_edge_is_passed(at, power):
    values = {
        "AT": at, "EDGE": at + 0.3, "X": at - 0.5, "POWER": power
    }  # fmt: skip
    text = ROOT
    for name, value in values.items():
        text = text.replace(name, repr(value))
    found = run(text)
    assert found.trajectory.outcome is Outcome.DONE
    assert found.trajectory.statistics.steps < 20_000
    # Half the squared speed is what the potential has lost; x is known to a place.
    energy = 0.005 + potential(-0.5, power)
    d = found["x"] - at
    kept = found["x_dot"] ** 2 / 2 + potential(d, power)
    # Every step rounds the position, against a force of up to 5.
    rounded = 5.0 * found.trajectory.statistics.steps * 2.0**-53 * abs(at)
    assert np.max(np.abs(kept - energy)) < 1e-8 * energy + rounded
    # It went to and fro over the edge: 8 is more than two periods of 2 pi/sqrt(8).
    assert np.count_nonzero(np.diff(np.sign(d - 0.3))) >= 4


FAR = """
coordinates: {{x: {{}}, w: {{}}}}
parameters: {{A: {at!r}, B: {edge!r}, K: 5000}}
energy: {{kinetic: "(x_dot^2 + w_dot^2)/2", potential: "4*(x - A)^2 + w^2/2 + {law}"}}
initial: {{x: {at!r}, x_dot: {speed!r}, w: 0.3}}
simulation: {{duration: 4, output_step: 0.5}}
"""
LAWS = {
    "hertz": "K*max(0, B - x)^2.5/2.5",
    "root of a wall": "K*max(0, B - x)^1.5/1.5",
    "wall": "K*max(0, B - x)^2/2",
    "cusp": "abs(x - B)^1.2",
    "bend": "abs(x - B)^1.5",
    "flat bend": "20*abs(x - B)^2.5",
    "kink": "3*abs(x - B)",
    "root in a product": "-10/3*max(0, x - B)*sqrt(max(0, x - B))",
}
# A place of the position, as its rounding in some hundred steps and at some switches
# grows on the way: by up to e^2 times each time that a stiff wall throws back.
PLACES = 1e4


def far_run(law, at, speed, **options):
    # What is near 0 and what is far off are the same numbers but for rounding.
    text = FAR.format(law=LAWS[law], at=at, edge=at - 0.165, speed=speed)
    found = run(text, **options)
    assert found.trajectory.outcome is Outcome.DONE
    return found


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("speed", [-2.0, -0.451])
def test_no_law_hangs_at_its_switch_wherever_that_is(law, speed):
    near = far_run(law, 0.0, speed)
    for at in (1e3, -14900.0, 617000.0, -3.3e7, 1e9):
        far = far_run(law, at, speed)
        assert far.trajectory.statistics.steps < 4000
        off = np.max(np.abs(far["x"] - at - near["x"]))
        assert off < 1e-9 + PLACES * np.spacing(abs(at))
        # What nothing touches: within its tolerance.
        assert np.max(np.abs(far["w"] - 0.3 * np.cos(far["t"]))) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("at", [14900.0, -3.3e7])
@pytest.mark.parametrize("law", ["root of a wall", "bend"])
def test_a_series_that_gets_no_farther_beside_a_switch_is_not_gone_on_with(law, at):
    near, far = far_run(law, 0.0, -2.0), far_run(law, at, -2.0, method="taylor")
    assert far.trajectory.statistics.steps < 4000
    off = np.max(np.abs(far["x"] - at - near["x"]))
    assert off < 1e-9 + PLACES * np.spacing(abs(at))


@pytest.mark.parametrize("law", ["hertz", "root of a wall", "root in a product"])
@pytest.mark.parametrize("method", ["radau", "dop853"])
def test_a_root_that_has_ended_has_no_slope(law, method):
    # Above the edge the forces of the first two are 0, those of the last one below it.
    found = far_run(law, 0.0, -2.0, method=method)
    d = found["x"] + 0.165
    beyond = {
        "hertz": 2000.0 * np.maximum(0.0, -d) ** 2.5,
        "root of a wall": 5000.0 / 1.5 * np.maximum(0.0, -d) ** 1.5,
        "root in a product": -10.0 / 3.0 * np.maximum(0.0, d) ** 1.5,
    }[law]
    energy = found["x_dot"] ** 2 / 2 + 4.0 * found["x"] ** 2 + beyond
    assert np.max(np.abs(energy - energy[0])) < 1e-8 * np.max(np.abs(energy))
