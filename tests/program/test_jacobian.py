"""The exact Jacobian of the accelerations, against differences."""

import numpy as np
import pytest

from lagsim.methods import rk4
from tests.choosing import tonight, turn
from tests.support import SHIPPED, has_laws, ready

# Where constraints hold at times, no method asks for it.
WITHOUT_LAWS = [x for x in SHIPPED if x != "chain-cartesian" and not has_laws(x)]
MASSLESS = """
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: x_dot^2/2 + x*y_dot^2, potential: cos(x) + z^2/2}
forces: {x: -x_dot^3*z}
constraints: {rod: z = x*y + sin(x), tie: y_dot = x*x_dot + t}
initial: {x: 1, y: 0.3, z: {guess: 1}, x_dot: 0.4, y_dot: {guess: 0}, z_dot: {guess: 0}}
simulation: {duration: 1}
"""
DOUBLED = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y}
constraints: {rod: x^2 + y^2 = 1, again: 2*x^2 + 2*y^2 = 2}
initial: {x: sin(1), y: -cos(1), x_dot: cos(1), y_dot: sin(1)}
simulation: {duration: 1}
"""
DRAGGED = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y}
forces: {x: -3*x_dot*y^2, y: -y_dot^3}
constraints: {rod: x^2 + y^2 = 1 + t}
initial: {x: sin(1), y: -cos(1), x_dot: {guess: 0}, y_dot: {guess: 0}}
simulation: {duration: 1}
"""


@pytest.fixture(autouse=True)
def _asked_for(monkeypatch):
    monkeypatch.setattr(rk4, "NEEDS", ("jacobian",))


def linked(model, **options):
    session = ready(model, method="rk4", **options)
    system = session.system
    runner = system.link("rk4")
    runner.prepare()
    return system, runner, session.case.start


def exact(system, runner, t, y):
    """Return the Jacobian; the rates of states and works are the last rows."""
    rows, d = system.size - system.n, len(system.equations.state)
    return runner.function("jacobian", rows * d)(t, y).reshape(rows, d)


def differences(system, runner, t, y):
    """Return the Jacobian by central differences of order 4."""
    derivative = runner.function("derivative")
    columns = []
    for k in range(len(system.equations.state)):
        h = 2.0**-10 * max(1.0, abs(y[k]))
        at = [derivative(t, y + s * h * np.eye(len(y))[k]) for s in (-2, -1, 1, 2)]
        columns.append((at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * h))
    return np.array(columns).T[system.n : system.size]


def check(model, **options):
    system, runner, start = linked(model, **options)
    random = np.random.default_rng(1)
    d = len(system.equations.state)
    for spread in (0.0, 0.01):
        y = np.concatenate([start.q, start.v, start.s, [0.0] * system.works])
        y[:d] += spread * random.standard_normal(d)
        found = exact(system, runner, 0.3, y)
        expected = differences(system, runner, 0.3, y)
        # Differences lose h^4 = 1e-12 times the fifth derivative, and rounding / h.
        size = np.max(np.abs(expected), axis=1, keepdims=True) + 1.0
        assert np.max(np.abs(found - expected) / size) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("name", WITHOUT_LAWS)
def test_shipped_models(name):
    """Solved straight or by loops, in turn as commits go by."""
    check(name, loops=turn(name, tonight(), (False, True)))


@pytest.mark.parametrize("text", [MASSLESS, DOUBLED, DRAGGED])
def test_hard_scenes(text):
    check(text)
