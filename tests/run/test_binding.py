"""A system bound to other values of parameters, or compiled anew where it has to be."""

import numpy as np
import pytest

from lagsim.model.reader import read
from lagsim.run.observers import Keep
from lagsim.run.session import open_case


def test_a_mass_that_becomes_nothing_is_solved_for_by_other_functions():
    # Between masses links hand tensions on; one that joins two links of different
    # directions, and has no mass, none: what hangs below it falls freely.
    text = """
parameters: {m: 1, M: 1, g: 9.8}
coordinates: {a: {}, b: {}}
definitions: {x: sin(a), y: -cos(a), X: x + sin(b), Y: y - cos(b)}
energy:
  kinetic: m*(x_dot^2 + y_dot^2)/2 + M*(X_dot^2 + Y_dot^2)/2
  potential: m*g*y + M*g*Y
initial: {a: 1, b: 0}
simulation: {duration: 0.2, output_step: 0.05}
"""
    opened = open_case(read(text, "m.yaml"))
    session, case = opened.ready(), opened.bind({"m": 0.0})
    assert session.plan.elimination.along_links
    assert session.bound(opened.bind({"m": 2.0})) is not None
    keep = Keep()
    (session.bound(case) or case.ready()).run([keep])
    t, a, b = keep.table.T[:3]
    assert np.sin(a) + np.sin(b) == pytest.approx(np.sin(1.0), abs=1e-9)
    fallen = -np.cos(a) - np.cos(b) + np.cos(1.0) + 1.0
    assert fallen == pytest.approx(-9.8 * t * t / 2, abs=1e-9)
