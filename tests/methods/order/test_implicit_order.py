"""Orders of implicit methods, and what is left of them on stiff motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lagsim.methods import radau
from lagsim.methods.parts.parameters import Parameters
from tests.methods.order.test_convergence import slope
from tests.methods.plain import Plain, exact, fresh_state, state_of
from tests.small_scenes import swing
from tests.support import run

NO_PARAMETERS = Parameters.made()


def accelerated(acceleration, slopes):
    """Give what the kernels call for q'' = acceleration(t, q, v); slopes to q and v."""

    def derivative(t, y, _p, out):
        out[0], out[1] = y[1], acceleration(t, y[0], y[1])

    def jacobian(t, y, _p, out):
        out[:2] = slopes(t, y[0], y[1])

    def measure(_t, _y, _p, out):
        out[:4] = 0.0, 0.0, 1.0, 0.0

    model = {"derivative": derivative, "jacobian": jacobian, "measure": measure}
    return model | exact(1)


def steps_of(model, y, h):
    """Make two units of time of steps of Radau of length h, whatever their error.

    Gives after each step t, y, and y from the dense output at parts of it.
    """
    plain, s = Plain(radau, model), fresh_state(radau, y, n=1, rtol=1e-12, atol=1e-12)
    start, attempt, accept, within = map(
        plain.kernel, ("start", "attempt", "accept", "interpolate")
    )
    start(s, NO_PARAMETERS)
    found = []
    for _ in range(round(2.0 / h)):
        # Newton's method goes on to 0.03 of a tenth of the tolerance.
        assert attempt(s, NO_PARAMETERS, h) >= 0.0
        accept(s, NO_PARAMETERS, h)
        s.jacobian = 0.0  # the Jacobian is due
        rows = np.zeros((len(PARTS), 2))
        for x, row in zip(PARTS, rows, strict=True):
            within(s, x, row)
        found.append((s.t, state_of(s), rows))
    return found


PARTS = np.linspace(0.0, 1.0, 21)
STEPS = [0.4, 0.2, 0.1]
RATES = accelerated(
    lambda _t, q, _v: -math.sin(q), lambda _t, q, _v: (-math.cos(q), 0.0)
)
STIFF = 1e6


def prothero_robinson(t, _q, v):
    """v' = -L (v - sin t) + cos t: v = sin t (Prothero and Robinson, 1974)."""
    return -STIFF * (v - math.sin(t)) + math.cos(t)


def test_radau_has_order_5_and_its_dense_output_4():
    errors, between = [], []
    for h in STEPS:
        found = steps_of(RATES, [2.0, 0.0], h)
        errors.append(max(abs(y[0] - swing(t, 2.0)) for t, y, _ in found))
        # Over one step from exact values: a polynomial of order p is off by h^(p + 1).
        _, after, rows = found[0]
        between.append(np.max(np.abs(rows[:, 0] - swing(PARTS * h, 2.0))))
        assert rows[0].tolist() == [2.0, 0.0]
        assert rows[-1] == pytest.approx(after, abs=1e-14)
    assert slope(STEPS, errors) == pytest.approx(5, abs=0.4)
    # From rest the first error of the positions vanishes: one more.
    assert slope(STEPS, between) - 1 > radau.DENSE_ORDER - 0.3


def test_radaus_order_falls_to_3_on_a_stiff_problem():
    model = accelerated(prothero_robinson, lambda _t, _q, _v: (0.0, -STIFF))
    errors = []
    for h in STEPS:
        found = steps_of(model, [-1.0, 0.0], h)
        errors.append(max(abs(y[1] - math.sin(t)) for t, y, _ in found))
    # IV.15, table 15.1: h^s/L with s = 3 stages.
    assert slope(STEPS, errors) == pytest.approx(3, abs=0.1)


PROTHERO_ROBINSON = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: -1e6*(x_dot - sin(t)) + cos(t)}
initial: {x: -1}
simulation: {duration: 2, output_step: 0.5, method: METHOD, step: 0.1}
"""
SMOOTH = PROTHERO_ROBINSON.replace("1e6", "1")


@pytest.mark.parametrize(
    ("name", "soft", "stiff"), [("gauss4", 4, 2), ("midpoint", 2, 2)]
)
def test_the_order_of_gauss_methods_on_a_stiff_problem(name, soft, stiff):
    for text, order in ((SMOOTH, soft), (PROTHERO_ROBINSON, stiff)):
        steps, errors = [0.125, 0.0625, 0.03125], []
        for h in steps:
            found = run(text.replace("METHOD", name), step=h)
            errors.append(np.max(np.abs(found["x_dot"] - np.sin(found["t"]))))
        assert slope(steps, errors) == pytest.approx(order, abs=0.4)
