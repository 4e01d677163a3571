"""Waves into lattices at rest: steps follow the motion, not the digits of its front."""

import numpy as np
import pytest

from tests.support import run

LATTICE = """
parameters: {{n: {n}, k: 1e5}}
coordinates: {{u(1..n): {{}}}}
energy:
  kinetic: "sum(i = 1..n, u_dot(i)^2)/2"
  potential: "k/2*({links})"
{more}
initial: {{u(1..n): 0, u_dot(1..n): 0, u_dot(n): {speed}}}
simulation: {{duration: 0.1, output_step: 0.02, method: {method}, rtol: {rtol}}}
"""
CHAIN = "sum(i = 2..n, (u(i) - u(i-1))^2) + u(1)^2"
BEAM = """
    sum(i = 2..n-1, (u(i+1) - 2*u(i) + u(i-1))^2) + (u(2) - 2*u(1))^2
    + (u(n-1) - 2*u(n))^2"""
PULL = "forces: {u(n): 1}"
KICK = """
modes: {later: 0.03}
events: {kick: {at: "t >= later", impulse: {u(n): 1}}}"""
# Each model has the motion of the chain, with its first mass at rest or not.
BESIDE = {
    "held": ("constraints: {base: u(1) = 0}", 1),
    "on a curve": ("constraints: {base: sin(u(1)) = 0}", 1),
    "friction": ("constraints: {base: {relation: u_dot(1) = 0, limit: 1e3}}", 1),
    "floor": ("constraints: {base: {relation: u(1) >= -1, restitution: 0}}", 0),
    "switch": ('forces: {u(1): "-max(0, u(1) - 1)"}', 0),
}
# Steps: the fastest waves of the chain are 63 rad long, of the beam 127 rad. Each bound
# is twice what was measured; with ranges alone, dopri5, and radau and dop853 at loose
# tolerances, end because the step becomes too small, and others take 10 times as many.
METHODS = [
    ("taylor", 1e-6, 300), ("taylor", 1e-11, 300),
    ("dop853", 1e-6, 260), ("dop853", 1e-9, 700), ("dopri5", 1e-4, 600),
]  # fmt: skip


def stiffness(links, n):
    """The matrix (n, n) of the potential, over k."""
    ends = np.eye(n) - np.eye(n, k=-1)
    return ends.T @ ends if links == CHAIN else np.linalg.matrix_power(bends(n), 2)


def bends(n):
    """Second differences (n, n) of a string fixed at both ends."""
    return np.eye(n, k=1) - 2 * np.eye(n) + np.eye(n, k=-1)


def response(links, n, t, speed, force, held):
    """Displacements (n,) at time t after the last mass was struck, or pulled.

    held : the number of masses at the other end that stay at rest.
    """
    squares, modes = np.linalg.eigh(1e5 * stiffness(links, n)[held:, held:])
    w, last = np.sqrt(squares), modes[-1]
    moves = speed * np.sin(w * t) / w + force * (1 - np.cos(w * t)) / w**2
    return np.concatenate((np.zeros(held), modes @ (last * moves)))


def arrives(links, method, rtol, n=60, more="", speed=0.0, struck=0.0, held=0):
    """Run a lattice; return its steps, and its error relative to the displacements.

    struck : the time from which on it moves.
    held : see `response`.
    """
    text = LATTICE.format(
        links=links, method=method, rtol=rtol, n=n, more=more, speed=speed
    )
    found = run(text, most_steps=3000)
    last = np.array([found[f"u.{i}"][-1] for i in range(1, n + 1)])
    t = found["t"][-1] - struck
    exact = response(links, n, t, 1.0 - (more == PULL), float(more == PULL), held)
    steps = found.trajectory.statistics.steps
    return steps, np.max(np.abs(last - exact)) / np.max(np.abs(exact))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "rtol", "most"), METHODS)
def test_a_chain_struck_at_its_end(method, rtol, most):
    steps, off = arrives(CHAIN, method, rtol, speed=1.0)
    assert steps < most
    assert off < max(rtol, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize(("method", "rtol", "most"), METHODS[2:4])
def test_a_chain_struck_beside_constraints_and_switches(beside, method, rtol, most):
    more, held = BESIDE[beside]
    steps, off = arrives(CHAIN, method, rtol, more=more, speed=1.0, held=held)
    assert steps < most
    assert off < max(rtol, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("beside", ["held", "switch"])
def test_a_chain_struck_beside_a_constraint_or_switch_by_its_series(beside):
    more, held = BESIDE[beside]
    steps, off = arrives(CHAIN, "taylor", 1e-11, more=more, speed=1.0, held=held)
    assert steps < 300
    assert off < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize(("method", "rtol", "most"), METHODS)
def test_a_chain_pulled_at_its_end(method, rtol, most):
    steps, off = arrives(CHAIN, method, rtol, more=PULL)
    assert steps < most
    assert off < max(rtol, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "rtol", "most"), METHODS)
def test_a_chain_kicked_by_an_event(method, rtol, most):
    steps, off = arrives(CHAIN, method, rtol, more=KICK, struck=0.03)
    assert steps < most
    assert off < max(rtol, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "rtol", "most"), METHODS)
def test_a_beam_struck_at_its_end(method, rtol, most):
    """Its waves are twice as fast: forces of next neighbours act two masses away."""
    steps, off = arrives(BEAM, method, rtol, speed=1.0)
    assert steps < 2 * most
    assert off < 10 * max(rtol, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("rtol", "most"), [(1e-4, 600), (1e-6, 1200)])
def test_a_chain_struck_at_its_end_by_radau(rtol, most):
    steps, off = arrives(CHAIN, "radau", rtol, n=20, speed=1.0)
    assert steps < most
    assert off < rtol


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("square", [1.7, 0.4])
def test_an_oscillator_set_in_motion_by_a_weak_force(method, square):
    """Its error stays relative to its own motion, 1e-10 of the other's."""
    weak = 1e-10
    found = run(f"""
    coordinates: {{a: {{}}, b: {{}}}}
    energy:
      kinetic: (a_dot^2 + b_dot^2)/2
      potential: "(a^2 + {square}*b^2)/2 - {weak}*a*b"
    initial: {{a: 1, b: 0, a_dot: 0, b_dot: 0}}
    simulation: {{duration: 20, output_step: 2, method: {method}, rtol: 1e-9}}
    """)
    t = found["t"]
    # The back action on a is of second order, 1e-20.
    exact = weak * (np.cos(t) - np.cos(np.sqrt(square) * t)) / (square - 1)
    assert np.max(np.abs(found["b"] - exact)) < 1e-8 * np.ptp(exact)


# A coin on a disc that speeds up by 0.8 rad/s each second: its rows hold all of its
# motion, or forces have the same effect.
COIN = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
initial: {x: 0.2, y: 0}
"""
HELD = 'constraints: {a: "x_dot + 0.8*t*y = 0", b: "y_dot - 0.8*t*x = 0"}'
DRIVEN = "forces: {x: -0.8*y - 0.8*t*y_dot, y: 0.8*x + 0.8*t*x_dot}"


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("more", [HELD, DRIVEN], ids=["held", "driven"])
def test_components_that_displace_each_other_without_end(more, method):
    """No force balances their displacements, which begin as t^2 and t^4."""
    found = run(COIN + f"{more}\nsimulation: {{duration: 4, method: {method}}}")
    angle = 0.4 * found["t"] ** 2
    assert np.max(np.abs(found["x"] - 0.2 * np.cos(angle))) < 1e-11
    assert np.max(np.abs(found["y"] - 0.2 * np.sin(angle))) < 1e-11
