"""State space with inputs of forces and constraints, against the Laplace transform."""

import numpy as np
import pytest

import lagsim

# Coupled masses, springs and dampers, a first-order state, a constraint between
# positions, and one between velocities that depends on positions and the state. The
# parameter u is a part of all of these.
JOINED = """
parameters: {u: 0}
coordinates: {x: {}, y: {}, z: {}, w: {}}
states: {a: {rate: 0.6*x - 2*a + 0.1*y_dot + 0.3*u}}
energy:
  kinetic: (2*x_dot^2 + 3*y_dot^2 + z_dot^2 + 1.5*w_dot^2)/2 + 0.2*x_dot*y_dot
  potential: (30*x^2 + 20*(y - x)^2 + 15*z^2 + 10*(w - x)^2)/2
  dissipation: (x_dot^2 + 0.4*(y_dot - z_dot)^2 + 0.6*w_dot^2)/2
forces: {y: 0.5*a + 2*u}
constraints:
  tie: z - y - 0.5*x = u
  roll: w_dot - 0.3*x_dot - 0.7*y - 0.2*a = 0.8*u
initial: {x: 0, y: 0, z: {guess: 0}, w: 0, a: 0,
  x_dot: 0, y_dot: 0, z_dot: {guess: 0}, w_dot: {guess: 0}}
simulation: {duration: 1}
"""
M = np.diag([2.0, 3.0, 1.0, 1.5])
M[0, 1] = M[1, 0] = 0.2
K = np.diag([60.0, 20.0, 15.0, 10.0])
K[0, 1] = K[1, 0] = -20.0
K[0, 3] = K[3, 0] = -10.0
DAMPERS = np.diag([1.0, 0.4, 0.4, 0.6])
DAMPERS[1, 2] = DAMPERS[2, 1] = -0.4
TIE, ROLL = np.array([-0.5, -1.0, 1.0, 0.0]), np.array([-0.3, 0.0, 0.0, 1.0])


def transformed(s):
    """Return x, y, z, w, a and both multipliers (7, 4) per unit of each input.

    The inputs are a force on y, the right sides of both constraints, and u. The
    equations are those of the file, with s in place of d/dt.
    """
    whole, right = np.zeros((7, 7), complex), np.zeros((7, 4))
    whole[:4, :4] = M * s**2 + DAMPERS * s + K
    whole[1, 4] = -0.5
    whole[4, :5] = [-0.6, -0.1 * s, 0, 0, s + 2]
    whole[5, :4] = TIE
    whole[6, :5] = [*ROLL * s, -0.2]
    whole[6, 1] -= 0.7
    whole[:4, 5], whole[:4, 6] = -TIE, -ROLL
    right[1, 0] = right[5, 1] = right[6, 2] = 1.0
    right[[1, 4, 5, 6], 3] = [2.0, 0.3, 1.0, 0.8]
    return np.linalg.solve(whole, right)


def test_inputs_of_all_kinds_beside_both_kinds_of_constraints():
    names = ["x", "y", "z", "w", "a", "lambda_tie", "lambda_roll"]
    inputs = ["y", "tie", "roll", "u"]
    found = lagsim.modes(lagsim.load(JOINED)).matrices(inputs, names)
    assert found.states == ("x", "y", "w", "x_dot", "y_dot", "a")
    assert found.inputs == (
        "y", "tie", "tie'", "tie''", "roll", "roll'", "u", "u'", "u''",
    )  # fmt: skip
    frequencies = np.array([0.0, 0.1, 0.7, 2.0])
    for f, response in zip(frequencies, found.response(frequencies), strict=True):
        expected = transformed(2j * np.pi * f)
        assert response == pytest.approx(expected, rel=1e-9, abs=1e-12)
