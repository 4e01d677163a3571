"""The Delassus matrix against the equations it comes from, solved in fractions."""

from __future__ import annotations

import numpy as np
import pytest
from sympy import Matrix, Rational, zeros

from lagsim.mechanics.contact import delassus

M = [[3, 1, 0], [1, 2, 0], [0, 0, 5]]
A = [[1, 1, 1]]
ROWS = [[1, 0, 0], [0, 1, -1]]


def exact(M, A, rows):
    """Give rows K rows^T from M q'' = rows^T + A^T m, A q'' = 0."""
    n, e = len(M), len(A)
    kkt = zeros(n + e, n + e)
    kkt[:n, :n] = Matrix(M)
    for i, row in enumerate(A):
        for j, x in enumerate(row):
            kkt[n + i, j] = kkt[j, n + i] = Rational(x)
    forces = Matrix(n + e, len(rows), lambda i, j: Rational(rows[j][i]) if i < n else 0)
    response = kkt.LUsolve(forces)[:n, :]
    return np.array(Matrix(rows) * response, float), np.array(response, float)


@pytest.mark.parametrize("equalities", [[], A, [*A, [2, 2, 2]]])
def test_beside_equalities(equalities):
    D, response = exact(M, equalities[:1], ROWS)
    found = delassus(
        np.array(M, float),
        np.array(equalities, float).reshape(-1, 3),
        np.array(ROWS, float),
    )
    assert pytest.approx(D, rel=1e-14) == found.D
    assert found.response == pytest.approx(response, rel=1e-14)
    assert found.factor.T @ found.factor == pytest.approx(D, rel=1e-14)


def test_a_coordinate_without_mass():
    masses, A = [[2, 0], [0, 0]], [[1, -3]]
    D, _ = exact(masses, A, [[0, 1]])
    found = delassus(
        np.array(masses, float), np.array(A, float), np.array([[0.0, 1.0]])
    )
    assert pytest.approx(D, rel=1e-14) == found.D


@pytest.mark.parametrize("exponents", [(-6, 6, 0), (9, -9, 3)])
def test_units_of_coordinates_do_not_count(exponents):
    s = 10.0 ** np.array(exponents)
    plain = delassus(np.array(M, float), np.array(A, float), np.array(ROWS, float))
    found = delassus(np.array(M) * np.outer(s, s), np.array(A) * s, np.array(ROWS) * s)
    assert pytest.approx(plain.D, rel=1e-13) == found.D


def test_what_equalities_hold_does_not_answer():
    found = delassus(
        np.eye(2), np.array([[1.0, 0.3]]), np.array([[2.0, 0.6], [0.0, 1.0]])
    )
    assert found.D[0].tolist() == [0.0, 0.0]
    assert found.D[1, 1] > 0.0
