"""The Delassus matrix against the equations it comes from, and in other units."""

import numpy as np
import pytest

from lagsim.mechanics.contact import delassus

M = np.array([[3.0, 1, 0], [1, 2, 0], [0, 0, 5]])
A = np.array([[1.0, 1, 1]])
ROWS = np.array([[1.0, 0, 0], [0, 1, -1]])
MASSLESS = np.diag([2.0, 0.0]), np.array([[1.0, -3.0]]), np.array([[0.0, 1.0]])


@pytest.mark.parametrize(("M", "A", "rows"), [(M, A[:0], ROWS), (M, A, ROWS), MASSLESS])
@pytest.mark.parametrize("twice", [False, True])
def test_beside_equalities(M, A, rows, twice):
    # M q'' = rows^T + A^T m, A q'' = 0, of whole numbers.
    e, n = A.shape
    whole = np.block([[M, -A.T], [A, np.zeros((e, e))]])
    forces = np.vstack([rows.T, np.zeros((e, len(rows)))])
    response = np.linalg.solve(whole, forces)[:n]
    found = delassus(M, np.vstack([A, 2.0 * A]) if twice else A, rows)
    assert pytest.approx(rows @ response, rel=1e-14) == found.D
    assert found.response == pytest.approx(response, rel=1e-14)
    assert found.factor.T @ found.factor == pytest.approx(found.D, rel=1e-14)


@pytest.mark.parametrize("exponents", [(-6, 6, 0), (9, -9, 3)])
def test_units_of_coordinates_do_not_count(exponents):
    s = 10.0 ** np.array(exponents)
    found = delassus(M * np.outer(s, s), A * s, ROWS * s)
    assert pytest.approx(delassus(M, A, ROWS).D, rel=1e-13) == found.D


def test_what_equalities_hold_does_not_answer():
    rows = np.array([[2.0, 0.6], [0.0, 1.0]])
    found = delassus(np.eye(2), np.array([[1.0, 0.3]]), rows)
    assert found.D[0].tolist() == [0.0, 0.0]
    assert found.D[1, 1] > 0.0
