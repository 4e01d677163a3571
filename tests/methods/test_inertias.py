"""What is noted of inertias on the way, and that it outlasts a change of method."""

from __future__ import annotations

import numpy as np

from lagsim.methods.parts import driver
from lagsim.methods.parts import state as at
from lagsim.native.kernels.code import bind
from lagsim.run.states import empty_state, taken_over
from tests.support import run


def test_the_smallest_is_noted_with_its_time():
    size, kept = 4, 100
    s = np.zeros(kept + 6)
    s[at.SIZE], s[at.INERTIAS], s[at.INERTIAS_AT] = size, 2, kept
    s[kept + 2 : kept + 4] = np.inf

    def inertias(t, _y, _p, out):
        out[:2] = (t - 0.3) ** 2, 2.0 + t

    note = bind(driver.note_inertias, {"inertias": inertias}, {})
    for t in (0.0, 0.25, 0.5, 1.0):
        s[at.T] = t
        note(s, np.zeros(1), np.zeros(2))
    assert s[kept : kept + 2].tolist() == [0.7**2, 3.0]
    assert s[kept + 2 : kept + 4].tolist() == [(0.25 - 0.3) ** 2, 2.0]
    assert s[kept + 4 :].tolist() == [0.25, 0.0]


def test_only_inertias_that_vary_with_positions_are_followed():
    assert run("failing/polar-miss", duration=0.1).system.inertias == ("phi",)
    assert run("failing/oscillator", duration=1).system.inertias == ()
    # What varies in time alone, a rocket's mass, is no coordinate's fault.
    rocket = run("""
coordinates: {x: {}}
energy: {kinetic: (2 - t)*x_dot^2/2, potential: 0}
initial: {x: 0, x_dot: 1}
simulation: {duration: 1}
""")
    assert rocket.system.inertias == ()


def test_what_is_noted_outlasts_the_method():
    system = run("failing/polar-miss", duration=0.1).system
    before = empty_state(system.link("dop853"))
    first = int(before[at.INERTIAS_AT])
    before[first : first + 3] = 1.0, 1e-9, 7.0
    after = taken_over(before, system.link("rk4"))
    assert len(after) != len(before)
    assert after[int(after[at.INERTIAS_AT]) :].tolist() == [1.0, 1e-9, 7.0]
