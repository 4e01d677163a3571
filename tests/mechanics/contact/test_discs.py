"""Limits on discs that hold bodies of very different masses."""

import numpy as np
import pytest

from lagsim.mechanics.complementarity import ComplementarityProblem, solve

# A single limited row, and two discs, each the pair of rows before it in the list.
PAIRS = np.array([-1, 2, 1, 4, 3])
LIMITS = np.array([1.0, 3.0, 3.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("masses", "rows", "forces"),
    [
        (
            [1e-4, 1e3],
            [[0.1, 1.1], [0.0, 0.9], [-1.6, -1.9], [0.0, -0.3], [-0.4, 0.4]],
            [0.1, -0.3],
        ),
        (
            [1e-4, 1e4],
            [[-0.2, -0.3], [1.5, 1.0], [0.0, 0.8], [-0.8, 0.0], [0.1, -0.5]],
            [1.1, -0.4],
        ),
    ],
)  # fmt: skip
def test_limits_balance_the_forces_on_light_and_heavy_bodies(masses, rows, forces):
    """Newton's matrix of the smoothed problem is singular to rounding on the way."""
    J, f, masses = np.array(rows), np.array(forces), np.array(masses)
    D, c = J / masses @ J.T, J @ (f / masses)
    high = np.vstack([LIMITS, 0.0 * LIMITS])
    alone = np.full(len(c), -1)
    p, w, found = solve(ComplementarityProblem(D, c, -high, high, alone, PAIRS))
    assert found
    assert not w.any()
    assert f + J.T @ p == pytest.approx(np.zeros(len(f)), abs=1e-8)
    sizes = [abs(p[0]), np.hypot(*p[1:3]), np.hypot(*p[3:])]
    assert (np.array(sizes) <= LIMITS[[0, 1, 3]] * (1 + 1e-12)).all()
