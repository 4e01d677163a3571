"""Friction on the disc at any step, where its way turns; where it stops: in pairs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.scenes.contact.motions import G, contact, play, scene

MU, K = 0.01, 4.0
FLOOR = {"floor": contact("y >= 0", 0, friction=MU, slip=["x_dot", "z_dot"])}
# Of rattle, friction along a way that turns is of order 1.
METHODS = {
    "rk4": ({"step": 0.002}, 1e-9), "rattle": ({"step": 0.001}, 1e-4),
    "euler": ({"step": 0.001}, 2e-2), "dop853": ({}, 1e-9),
}  # fmt: skip


def spiral(t):
    """Give x, z (k,) of a puck on a spring, by another integrator."""

    def rates(_, s):
        v = np.hypot(s[2], s[3])
        return [s[2], s[3], *(-K * s[i] - MU * G * s[2 + i] / v for i in (0, 1))]

    return solve_ivp(
        rates, (0.0, t[-1]), [1.0, 0.0, 1.2, 0.9], "DOP853", t, rtol=1e-12, atol=1e-13
    ).y[:2]


@pytest.mark.parametrize("method", METHODS)
def test_a_way_that_turns_is_no_event(method):
    options, bound = METHODS[method]
    found = play(scene(
        "x z y", "(x_dot^2 + y_dot^2 + z_dot^2)/2", f"g*y + {K}*(x^2 + z^2)/2", FLOOR,
        {"x": 1, "z": 0, "y": 0, "x_dot": 1.2, "z_dot": 0.9}, duration=3,
        output_step=0.05, method=method, **options,
    ))  # fmt: skip
    # It goes around once and a half.
    for q, x in zip("xz", spiral(found.t), strict=True):
        assert found[q] == pytest.approx(x, abs=bound)
    assert found.result.events == ()
    assert len(found.t) == 61
