"""Eigenmodes against closed forms of oscillators; motions along rows against KKT."""

import numpy as np
import pytest

from lagsim.mechanics.linearisation import eigenmodes

# Two oscillators apart, x'' = -w^2 x - 2 d w x', and their eigenvalues.
RATES, DAMPING = np.array([3.0, 40.0]), np.array([0.02, 0.5])
EXACT = RATES * (-DAMPING + 1j * np.sqrt(1.0 - DAMPING**2))


def modes_of(K, D, most=np.inf):
    I = np.eye(len(K))  # noqa: E741
    return eigenmodes(np.block([[0.0 * I, I], [-K, -D]]), lambda speeds: speeds < most)


@pytest.mark.parametrize(("most", "count"), [(np.inf, 2), (10.0, 1)])
def test_oscillators(most, count):
    K, D = np.diag(RATES**2), np.diag(2.0 * DAMPING * RATES)
    modes = modes_of(K, D, most)
    exact = np.concatenate([EXACT[:count], EXACT[:count].conj()])
    # Rounding by the norm of the matrix (1600).
    found, expected = map(np.sort_complex, (modes.values, exact))
    assert found == pytest.approx(expected, abs=1e-11)
    # Those which decay by less than a part of their rate: their damping ratio.
    slow = np.abs(modes.values) < 10.0
    assert not modes.are_slowly_damped(0.01).any()
    assert (modes.are_slowly_damped(0.3) == slow).all()
    assert modes.are_slowly_damped(0.6).all()
    # A motion is the sum of its modes; that of the first oscillator of its own alone.
    rates = np.array([0.3, -1.2, 2.5, 7.0]) * np.tile(np.arange(2) < count, 2)
    assert modes.right @ modes.amplitudes(rates) == pytest.approx(rates, abs=1e-11)


def test_equal_rates():
    # Three equal oscillators: any vectors of theirs are modes, and their sum is kept.
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    modes = modes_of(turned @ (4.0 * np.eye(3)) @ turned.T, np.zeros((3, 3)))
    rates = np.arange(1.0, 7.0)
    assert modes.right @ modes.amplitudes(rates) == pytest.approx(rates, abs=1e-12)


def test_shapes_are_weighted_by_masses():
    moved = np.array([[1.0, 3.0j], [1.0, 1.0]])
    modes = eigenmodes(np.diag([1.0, 2.0]), lambda x: x > 0.0)
    found = modes.parts(moved, np.array([4.0, 9.0]), 0)
    assert found == pytest.approx(np.array([[2.0 / 3.0, 1.0], [1.0, 0.5]]))
    assert modes.parts(np.zeros((2, 2)), np.ones(2), 0) == pytest.approx(0.0)
