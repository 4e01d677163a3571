"""One-sided constraints with `when`: they are judged while they are in force."""

import numpy as np
import pytest

from lagsim import simulate

# A ball dropped from 5 cm onto a floor that is there for a while (g = 10).
TRAP = """
name: trap
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: 10*y}}
constraints:
  floor: {{relation: y >= 0, restitution: 0, when: {when}}}
initial: {{y: 0.05}}
simulation: {{duration: 1, output_step: 0.1}}
"""


@pytest.mark.parametrize("when", ["t < 0.5", "t < 0.5 and t >= 0", "not (t >= 0.5)"])
def test_a_trapdoor_opens(when):
    found = simulate(TRAP.format(when=when))
    assert not found.warnings
    assert found.error is not None
    t = found["t"]
    expected = np.where(t < 0.1, 0.05 - 5 * t**2, 0.0)
    expected = np.where(t > 0.5, -5 * (t - 0.5) ** 2, expected)
    assert found["y"] == pytest.approx(expected, abs=1e-9)
