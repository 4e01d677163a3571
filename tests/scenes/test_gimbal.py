"""Tops in Euler angles close to gimbal lock, where M is singular but for rounding."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lagsim.model.reader import read
from tests.studies.judged import barred
from tests.support import run

# Spun up at 3 about its axis, with the mass above the point of support: it rises past
# the vertical at t = 1.11, at about the least angle at which it has been.
TOP = """
parameters: {A: 1, C: 2, nod: 0.1, lean: 1e-5}
coordinates: {psi: {}, theta: {}, phi: {}}
energy:
  kinetic: >-
    A*(psi_dot^2*sin(theta)^2 + theta_dot^2)/2 + C*(phi_dot + psi_dot*cos(theta))^2/2
  potential: cos(theta)
initial: {psi: 0, theta: lean, phi: 0, phi_dot: 3, theta_dot: nod}
simulation: {duration: 1.05, output_step: 0.05}
"""


def truth(lean, times):
    """Integrate theta, psi: p_psi = p_phi cos(lean) and p_phi = 6 are constant."""

    def rates(_, y):
        theta, rate, _ = y
        s = np.sin(theta)
        turn = 12.0 * np.sin((theta + lean) / 2) * np.sin((theta - lean) / 2) / s**2
        return [rate, turn**2 * s * np.cos(theta) - 6.0 * turn * s + s, turn]

    start = [lean, 0.1, 0.0]
    return solve_ivp(
        rates, (0.0, times[-1]), start, method="DOP853", rtol=1e-13, atol=1e-16,
        t_eval=times,
    ).y[[2, 0]]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dop853"])
@pytest.mark.parametrize("lean", ["1e-5", "1e-6"])
def test_a_start_close_to_gimbal_lock_moves(method, lean):
    # M is known to 2^-53/lean^2 of itself in the time lean/0.1 that it takes to turn up
    # to 3: that is what psi is off by, some roundings at a time.
    found = run(TOP.replace("lean: 1e-5", f"lean: {lean}"), method=method)
    psi, theta = truth(float(lean), np.clip(found["t"], 0.0, 1.05))
    assert np.max(np.abs(found["theta"] - theta)) < 1e-12
    assert np.max(np.abs(found["psi"] - psi)) < 10 * 30 * 2.0**-53 / float(lean)
    assert found.trajectory.statistics.evaluations < 10_000


@pytest.mark.parametrize(
    "method", ["auto", pytest.param("dop853", marks=pytest.mark.slow)]
)
def test_a_passage_of_gimbal_lock_is_controlled_no_finer_than_its_rounding(method):
    # Twice past an angle of 1e-3, where M is known to 1e-10 of itself.
    text = TOP.replace("lean: 1e-5", "lean: 1e-3").replace("1.05", "3")
    found = run(text, method=method)
    bar = barred(read(text, "m.yaml", options={"method": method}))[1]
    psi, theta = truth(1e-3, np.clip(found["t"], 0.0, 3.0))
    assert found.trajectory.outcome.word == "done"
    assert found.trajectory.statistics.evaluations < 100_000
    off = max(
        np.max(np.abs(found["theta"] - theta)), np.max(np.abs(found["psi"] - psi))
    )
    told = max(x.largest for x in bar.coordinates.values())
    assert off < 1e-6
    assert off / 30 < told < 30 * off
