"""One-sided constraints with `when`: they are judged while they are in force."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.cli.conftest import lagsim  # noqa: F401

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
def test_a_trapdoor_opens(when, lagsim, tmp_path):  # noqa: F811
    file = tmp_path / "trap.yaml"
    file.write_text(TRAP.format(when=when), encoding="utf-8")
    called = lagsim("run", file, "--no-plots", "-o", tmp_path / "out")
    assert called.code == 0, called.err
    record = json.loads((tmp_path / "out" / "run.json").read_text("utf-8"))
    assert record["warnings"] == []
    assert record["error"] is not None
    table = (tmp_path / "out" / "trajectory.csv").read_text("utf-8").splitlines()
    place = table[0].split(",").index("y")
    rows = np.array([[float(x) for x in line.split(",")] for line in table[1:]])
    t, y = rows[:, 0], rows[:, place]
    expected = np.where(t < 0.1, 0.05 - 5 * t**2, 0.0)
    expected = np.where(t > 0.5, -5 * (t - 0.5) ** 2, expected)
    assert y == pytest.approx(expected, abs=1e-9)
