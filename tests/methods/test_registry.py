"""What every method must have and do: a new file in `methods` is tested at once."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from lagsim.methods import method, names
from tests.support import run

PENDULUM = """
coordinates: {a: {}}
energy: {kinetic: a_dot^2/2, potential: -cos(a)}
initial: {a: 1}
simulation: {duration: 5, output_step: 0.05, method: METHOD, step: 0.005}
"""
HELD = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: y}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: sin(1), y: -cos(1)}
simulation: {duration: 5, output_step: 0.05, method: METHOD, step: 0.005}
"""


def swing(t, amplitude=1.0):
    """Give the angle of a pendulum let go at `amplitude`: Jacobi's elliptic functions.

    sin(a/2) = k sn(K - t, k^2), k = sin(amplitude/2).
    """
    from scipy.special import ellipj, ellipk

    k = math.sin(amplitude / 2.0)
    sn, _, _, _ = ellipj(ellipk(k * k) - t, k * k)
    return 2.0 * np.arcsin(k * sn)


def test_the_methods_are_the_files():
    assert set(names()) >= {"dop853", "rk4"}
    assert list(names()) == sorted(names())


@pytest.mark.parametrize("name", names())
def test_a_method_says_what_it_is(name):
    module = method(name)
    assert name == module.NAME
    assert 3 < len(module.TITLE) < 60
    assert module.ORDER >= module.DENSE_ORDER >= 1
    assert isinstance(module.ADAPTIVE, bool)
    assert module.IMAGINARY_LIMIT >= 0.0
    assert module.HANDLES
    assert re.search(r"^Sources?: \S", module.__doc__, re.MULTILINE)
    assert module.state_size(8) > module.state_size(4) > 0
    for kernel in ("start", "step", "interpolate"):
        assert callable(getattr(module, kernel))


@pytest.mark.parametrize("name", names())
def test_a_method_behaves(name):
    # At 200 steps per unit of time order 4 has an error of (1/200)^4 = 2e-9 times a
    # constant of the order of one per unit of time.
    for text in (PENDULUM, HELD):
        found = run(text.replace("METHOD", name))
        assert found.trajectory.outcome.word == "done"
        assert len(found.rows) == 101
        expected = swing(found["t"])
        angle = found["a"] if text is PENDULUM else np.arctan2(found["x"], -found["y"])
        assert np.max(np.abs(angle - expected)) < 5e-9
        assert found.drift < 5e-9
        statistics = found.trajectory.statistics
        assert statistics.evaluations > statistics.steps > 10


@pytest.mark.parametrize("name", names())
def test_a_method_is_repeatable(name):
    first, second = (run(HELD.replace("METHOD", name)) for _ in range(2))
    assert first.rows.tobytes() == second.rows.tobytes()
    assert first.trajectory.statistics == second.trajectory.statistics
