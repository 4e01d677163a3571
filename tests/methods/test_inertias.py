"""Inertias that are followed on the way, and when one is smallest."""

import numpy as np

from lagsim.methods.parts import driver
from lagsim.methods.parts.driver import State
from tests.kernels import bind
from tests.support import run


def test_the_smallest_is_noted_with_its_time():
    s = State.made(size=4, inertias=2)

    def inertias(t, _y, _p, out):
        out[:2] = (t - 0.3) ** 2, 2.0 + t

    note = bind(driver.note_inertias, {"inertias": inertias}, {})
    for t in (0.0, 0.25, 0.5, 1.0):
        s.t = t
        note(s, np.zeros(1), np.zeros(2))
    assert s.inertia_largest.tolist() == [0.7**2, 3.0]
    assert s.inertia_smallest.tolist() == [(0.25 - 0.3) ** 2, 2.0]
    assert s.inertia_when.tolist() == [0.25, 0.0]


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
