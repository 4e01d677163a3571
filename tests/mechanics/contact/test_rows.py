"""Accelerations of rows by multipliers: the equations of motion with equalities."""

import numpy as np
import pytest

from lagsim.mechanics.rows import delassus

# A few products and solves with condition numbers below 1e3.
ROUNDING = 1e-11


def by_elimination(M, A, rows):
    """Return the accelerations (n, r) by unit multipliers, from M a + A^T l = rows^T.

    The equalities A a = 0 are part of the same linear equations.
    """
    n, e = len(M), len(A)
    whole = np.block([[M, A.T], [A, np.zeros((e, e))]])
    right = np.vstack([rows.T, np.zeros((e, len(rows)))])
    return np.linalg.lstsq(whole, right, rcond=None)[0][:n]


@pytest.mark.parametrize("massless", [0, 1])
@pytest.mark.parametrize(("n", "e", "r"), [(3, 0, 2), (4, 1, 3), (4, 2, 2), (6, 3, 5)])
def test_rows_beside_equalities(n, e, r, massless):
    """Equalities, one of them twice, a full mass matrix, a row that they determine."""
    random = np.random.default_rng(n + r)
    L, A = random.normal(size=(n, n)), random.normal(size=(e, n))
    M = L @ L.T + n * np.eye(n)
    if massless and e:
        M[-1] = M[:, -1] = 0.0
    rows = random.normal(size=(r, n))
    if e:
        A = np.vstack([A, A[0]])
        rows[-1] = A.sum(axis=0)
    found = delassus(M, A, rows)
    a = by_elimination(M, A, rows)
    for computed, expected in (
        (found.response, a),
        (found.D, rows @ a),
        (found.factor.T @ found.factor, rows @ a),
    ):
        assert computed == pytest.approx(expected, abs=ROUNDING)
    if e:  # exactly: no multiplier of it is found from rounding
        assert not found.factor[:, -1].any()
        assert found.factor[:, :-1].any(axis=0).all()
