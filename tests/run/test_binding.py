"""Equations derived once run at any binding, on the code compiled once."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.model.reader import read
from lagsim.native.link.cache import object_code
from lagsim.plan.making import by_loops
from lagsim.run.observers import Keep
from lagsim.run.session import open_case

# Derived parameters, a start that follows them, `if` in the time and in the state.
SWITCHED = """
parameters: {k: 20, m: 1.5, w: sqrt(k/m), on: 1/w, low: -0.5}
coordinates: {x: {}, y: {}}
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: k*x^2/2 + y^2*x^2 + y^2}
forces: {x: "if(t < on, m, 0) - if(x < low, w*(x - low), 0)", y: -0.1*y_dot}
initial: {x: 1, y: 0.2, x_dot: 0.1*w}
simulation: {duration: 2, output_step: 0.05}
"""
HELD = """
parameters: {l: 1, g: 9.8, a: 0.3, w: 2*sqrt(g/l)}
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: g*y}
constraints: {rod: (x - a*sin(w*t))^2 + y^2 = l^2}
initial: {x: l*sin(0.4), y: {guess: -l}, x_dot: 0.1, y_dot: {guess: 0}}
simulation: {duration: 2, output_step: 0.05, until: y >= 0}
"""
CASES = {
    "switched": (SWITCHED, [{"k": 35.0}, {"m": 0.7, "low": -0.2}, {"w": 3.0}]),
    "held": (HELD, [{"l": 1.3}, {"g": 1.62, "a": 0.05}]),
    "by tapes": (HELD, [{"l": 1.3}]),
    "by loops": (HELD, [{"l": 1.3}]),
}


def rows(case, by):
    plan, keep = case.plan(), Keep()
    session = case.ready(by_loops(plan) if by == "by loops" else plan)
    trajectory = session.run([keep])
    return keep.table, trajectory.statistics


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_rows_are_those_of_the_text_read_again(case, monkeypatch):
    compiled = []

    def noted(made_from, generate):
        compiled.append(made_from)
        return object_code(made_from, generate)

    monkeypatch.setattr("lagsim.run.system.object_code", noted)
    text, changes = CASES[case]
    if case == "by tapes":
        monkeypatch.setattr("lagsim.plan.making.from_tape", lambda *_: True)
    opened = open_case(read(text, "m.yaml"))
    first, _ = rows(opened, case)
    own = compiled.pop()
    for values in changes:
        again = read(text, "m.yaml", {k: repr(v) for k, v in values.items()})
        expected, same = rows(open_case(again), case)
        compiled.clear()
        found, work = rows(opened.bind(values), case)
        assert np.array_equal(found, expected)
        assert work == same
        assert found.shape != first.shape or not np.array_equal(found, first)
        # Object code is kept by a digest of the graph that it is compiled from.
        assert compiled == [own]


def test_a_mass_that_becomes_nothing_is_solved_for_by_other_functions():
    # Between masses links hand tensions on; one that joins two links of different
    # directions, and has no mass, none: what hangs below it falls freely.
    text = """
parameters: {m: 1, M: 1, g: 9.8}
coordinates: {a: {}, b: {}}
definitions:
  x: sin(a)
  y: -cos(a)
  X: x + sin(b)
  Y: y - cos(b)
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
