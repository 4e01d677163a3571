"""Eigenmodes against closed forms of oscillators, and what of a motion is in each."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.mechanics.linearisation import eigenmodes, weighted

# Two oscillators apart: x'' = -w^2 x - 2 d w x' with damping ratios d.
RATES, DAMPING = (3.0, 40.0), (0.02, 0.5)
EXACT = [
    w * (-d + sign * 1j * np.sqrt(1.0 - d * d))
    for w, d in zip(RATES, DAMPING, strict=True)
    for sign in (-1.0, 1.0)
]


def oscillators():
    w, d = np.array(RATES), np.array(DAMPING)
    return np.block([
        [np.zeros((2, 2)), np.eye(2)], [np.diag(-w * w), np.diag(-2.0 * d * w)],
    ])  # fmt: skip


def everything(speeds):
    return speeds >= 0.0


def test_rates():
    found = eigenmodes(oscillators(), everything)
    # Rounding by the norm of the matrix (1600).
    assert np.sort_complex(found.values) == pytest.approx(
        np.sort_complex(np.array(EXACT)), abs=1e-11
    )
    slow = eigenmodes(oscillators(), lambda speeds: speeds < 10.0)
    assert np.abs(slow.values) == pytest.approx([3.0, 3.0], abs=1e-11)
    assert slow.right.shape == slow.left.shape == (4, 2)


def test_a_motion_is_the_sum_of_its_modes():
    modes = eigenmodes(oscillators(), everything)
    rates = np.array([0.3, -1.2, 2.5, 7.0])
    assert modes.right @ modes.amplitudes(rates) == pytest.approx(rates, abs=1e-11)
    # What moves in the first oscillator alone is in its modes alone.
    slow = eigenmodes(oscillators(), lambda speeds: speeds < 10.0)
    alone = np.array([0.3, 0.0, 2.5, 0.0])
    assert slow.right @ slow.amplitudes(alone) == pytest.approx(alone, abs=1e-11)


def test_equal_rates():
    # Three equal oscillators: any vectors of theirs are modes, and their sum is kept.
    n = 3
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(n, n)))[0]
    K = turned @ (4.0 * np.eye(n)) @ turned.T
    R = np.block([[np.zeros((n, n)), np.eye(n)], [-K, np.zeros((n, n))]])
    modes = eigenmodes(R, everything)
    rates = np.arange(1.0, 7.0)
    assert modes.right @ modes.amplitudes(rates) == pytest.approx(rates, abs=1e-12)


def test_what_swings():
    modes = eigenmodes(oscillators(), everything)
    slow = np.abs(modes.values) < 10.0
    assert (modes.swing(0.3) == slow).all()
    assert modes.swing(0.6).all()
    assert not modes.swing(0.01).any()


def test_shapes_are_weighted_by_masses():
    moved = np.array([[1.0, 3.0j], [1.0, 1.0]])
    found = weighted(moved, np.array([4.0, 9.0]))
    assert found == pytest.approx(np.array([[2.0 / 3.0, 1.0], [1.0, 0.5]]))
    assert weighted(np.zeros((2, 1)), np.ones(2)) == pytest.approx(0.0)
