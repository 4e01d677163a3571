"""Stiff scenes: which methods fail, as much as theory says, and which do not."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

from tests.support import run

EXCITED = """
parameters: {K: 1e8, l: 1, g: 9.8}
coordinates: {theta: {}, u: {}}
definitions: {fast: u_dot^2/2 + K*(u - (g*cos(theta) + theta_dot^2)/K)^2/2}
energy:
  kinetic: ((l + u)*theta_dot)^2/2 + u_dot^2/2
  potential: g*(l - (l + u)*cos(theta)) + K*u^2/2
initial: {theta: 1, u: 1e-4}
output: {columns: [fast]}
simulation: {duration: 1, output_step: 0.05}
"""
QUIET = EXCITED.replace("u: 1e-4", "u: g*cos(1)/K")


def test_radau_damps_a_fast_mode_silently_at_loose_tolerance():
    found = run(EXCITED, method="radau", rtol=1e-2, duration=3)
    assert found.trajectory.outcome.word == "done"
    # An oscillation of 1e-4 of the length is below the tolerance.
    assert found["fast"][-1] < 0.03 * found["fast"][0]
    # The slow motion is right nevertheless.
    exact = run(EXCITED, method="dop853", rtol=1e-9, duration=3)
    assert np.max(np.abs(found["theta"] - exact["theta"])) < 1e-2
    assert exact["fast"][-1] == pytest.approx(exact["fast"][0], rel=0.05)
    tight = run(EXCITED, method="radau", rtol=1e-7, duration=0.05, output_step=0.01)
    assert tight["fast"][-1] == pytest.approx(tight["fast"][0], rel=0.05)


class TooManyError(Exception):
    """More evaluations than it is worth to count."""


def bdf(found, most):
    """Count the evaluations of scipy's BDF on the scene and tolerances of a run.

    Up to the first past `most`.
    """
    from scipy.integrate import solve_ivp

    derivative = found.system.link(found.plan.method).function("derivative")
    n = 2 * found.system.n
    count = 0

    def rate(t, y):
        nonlocal count
        count += 1
        if count > most:
            raise TooManyError
        return derivative(t, y)[:n]

    start = np.concatenate([found.start.q, found.start.v])
    tolerances = {"rtol": found.plan.rtol, "atol": found.plan.atol}
    with contextlib.suppress(TooManyError):
        solve_ivp(rate, (0.0, found.trajectory.end), start, method="BDF", **tolerances)
    return count


def test_bdf_collapses_on_an_undamped_fast_mode():
    # BDF of orders 3 to 5 is unstable near the imaginary axis: what is left of the fast
    # mode grows to the tolerance, and from then on the step follows it.
    found = run(QUIET, method="radau", rtol=1e-4, atol=1e-10)
    assert found.trajectory.outcome.word == "done"
    most = 30 * found.trajectory.statistics.evaluations
    assert bdf(found, most) > most
