"""Inertias that are followed on the way."""

from tests.support import run


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
