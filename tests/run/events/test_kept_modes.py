"""Modes that laws keep at an instant at which only other laws change."""

import numpy as np
import pytest

from lagsim.mechanics import row_modes
from lagsim.run.events import law_modes
from tests.scenes.contact.motions import play

COUNT = 12

# Block i is held by its limit 1 until its force reaches it, at t = 1/a.
BLOCKS = f"""
parameters: {{n: {COUNT}}}
coordinates: {{"x(1..n)": {{}}}}
definitions: {{"a(i = 1..n)": 1 + 0.3*i + 0.01*i^2}}
energy: {{kinetic: "sum(i = 1..n, x_dot(i)^2/2)", potential: "0"}}
forces: {{"x(i = 1..n)": a(i)*t}}
constraints: {{"rub(i = 1..n)": {{relation: x_dot(i) = 0, limit: 1}}}}
initial: {{"x(i = 1..n)": 0}}
simulation: {{duration: 1.5}}
"""

# Ball i falls against a wall and returns with the speed 0.9; block i feels 0.5 plus
# this speed, and its limit is 1: it is held until the impact, and slips from then on.
STRUCK = f"""
parameters: {{n: {COUNT}}}
coordinates: {{"x(1..n)": {{}}, "b(1..n)": {{}}, "z(1..n)": {{}}}}
energy:
  kinetic: "sum(i = 1..n, x_dot(i)^2 + b_dot(i)^2 + z_dot(i)^2)/2"
  potential: "0"
forces: {{"x(i = 1..n)": 0.5 + b_dot(i), "z(i = 1..n)": 0.9 + 0.05*b_dot(i)}}
constraints:
  wall(i = 1..n): {{relation: b(i) >= 0, restitution: 1}}
  rub(i = 1..n): {{relation: x_dot(i) = 0, limit: 1}}
  hold(i = 1..n): {{relation: z_dot(i) = 0, limit: 1}}
initial:
  {{"x(i = 1..n)": 0, "z(i = 1..n)": 0, "b(i = 1..n)": 0.09*i, "b_dot(i = 1..n)": -0.9}}
simulation: {{duration: 1.5}}
"""

# Neighbours are joined by dampers, so that a block that slips or stops changes how the
# forces on those beside it go on.
DAMPED = """
parameters: {n: 12, k: 100, c: 1}
coordinates: {"x(1..n)": {}}
definitions: {d(0): 0.5*sin(4*t), "d(i = 1..n)": x(i)}
energy:
  kinetic: sum(i = 1..n, x_dot(i)^2/2)
  potential: sum(i = 1..n, k*(d(i) - d(i-1))^2/2)
  dissipation: sum(i = 2..n, c*(x_dot(i) - x_dot(i-1))^2/2)
constraints: {"rub(i = 1..n)": {relation: x_dot(i) = 0, limit: 4}}
initial: {"x(i = 1..n)": 0}
simulation: {duration: 3}
"""


@pytest.fixture
def decided(monkeypatch):
    """The numbers of laws whose modes are decided at each instant."""
    counts, choose = [], row_modes.modes

    def counted(closed, *others):
        counts.append(len(closed))
        return choose(closed, *others)

    monkeypatch.setattr(row_modes, "modes", counted)
    return counts


@pytest.mark.slow
def test_a_block_that_slips_leaves_the_others_as_they_are(decided):
    found = play(BLOCKS)
    i = np.arange(1, COUNT + 1)
    a = 1 + 0.3 * i + 0.01 * i**2
    for k in range(COUNT):
        [slip] = found.times("slip", f"rub.{k + 1}")
        assert slip == pytest.approx(1 / a[k], abs=1e-12)
        end = a[k] * (1.5 - 1 / a[k]) ** 3 / 6  # x'' = a (t - 1/a)
        assert found[f"x.{k + 1}"][-1] == pytest.approx(end, rel=1e-10)
    assert decided == [COUNT, *[1] * COUNT]


@pytest.mark.slow
def test_an_impact_changes_forces_on_laws_that_it_does_not_strike(decided):
    found = play(STRUCK)
    for k in range(1, COUNT + 1):
        [slip] = found.times("slip", f"rub.{k}")
        assert slip == pytest.approx(0.1 * k, abs=1e-12)
        end = 0.4 * (1.5 - 0.1 * k) ** 2 / 2
        assert found[f"x.{k}"][-1] == pytest.approx(end, rel=1e-10, abs=1e-14)
        assert not found.times("slip", f"hold.{k}")
    assert (found["z.1"] == 0.0).all()
    assert max(decided[1:]) < COUNT


@pytest.mark.parametrize("scene", [DAMPED, STRUCK])
def test_modes_kept_and_modes_decided_give_one_motion(scene, monkeypatch):
    kept = play(scene)
    monkeypatch.setattr(law_modes, "FEW", 1000)
    every = play(scene)
    assert len(kept.result.events) > COUNT
    assert [(e.kind, e.constraint, e.time) for e in kept.result.events] == [
        (e.kind, e.constraint, e.time) for e in every.result.events
    ]
    assert np.array_equal(kept["x.2"], every["x.2"])
