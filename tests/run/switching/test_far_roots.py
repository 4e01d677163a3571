"""Laws with a root at their switch, met where positions have few places left."""

from __future__ import annotations

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
