"""Shares of contacts that are not determined: closed forms and another method."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from lagsim.mechanics.contact import least_norm
from tests.mechanics.contact.test_modes import LEGS


def test_four_legs_share_evenly_what_stands_in_the_middle():
    shares = least_norm(LEGS, np.array([5.0, 0.0, 0.0, 5.0]))
    assert shares == pytest.approx([2.5] * 4, rel=1e-15)


def test_a_load_over_one_leg_is_borne_by_it():
    # Another distribution would pull somewhere.
    assert least_norm(LEGS, np.array([7.0, 0, 0, 0])) == pytest.approx([7, 0, 0, 0])


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_units_of_coordinates_do_not_count(scale):
    # What makes no force is a multiple of (1, -1, -1, 1), 1.5 of it.
    shares = least_norm(LEGS * [1.0, scale, scale], np.array([5.0, 1.0, 1.0, 3.0]))
    assert shares == pytest.approx([3.5, 2.5, 2.5, 1.5], rel=1e-14)


def test_independent_contacts_keep_theirs():
    given = np.array([1.0, 2.0])
    assert least_norm(np.eye(2), given).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("seed", range(5))
def test_against_a_general_minimiser(seed):
    random = np.random.default_rng(seed)
    rows = random.normal(size=(9, 4))
    given = np.maximum(random.normal(size=9), 0.0)
    shares = least_norm(rows, given)
    assert shares.min() >= 0.0
    assert rows.T @ shares == pytest.approx(rows.T @ given, rel=1e-12, abs=1e-13)
    same = {
        "type": "eq",
        "fun": lambda x: rows.T @ (x - given),
        "jac": lambda _: rows.T,
    }
    best = minimize(
        lambda x: x @ x,
        given,
        jac=lambda x: 2.0 * x,
        method="SLSQP",
        bounds=[(0.0, None)] * 9,
        constraints=same,
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert best.success
    # The minimiser stops where the norm changes by less than 1e-14 of itself.
    assert shares == pytest.approx(best.x, abs=1e-5)
    assert shares @ shares <= best.fun * (1 + 1e-12)
