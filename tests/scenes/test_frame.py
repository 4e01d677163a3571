"""The frame in an earthquake, mode by mode, exactly between points of the record."""

import importlib.util
import itertools
import math

import numpy as np
import pytest
from scipy.linalg import expm

import lagsim
from tests.support import MODELS, ROOT, simulate

FRAME, STOREYS, ZETA = MODELS / "frame-in-an-earthquake.yaml", 3, 0.05
M, K = 2e4, 2e7
J = np.arange(1, STOREYS + 1)
RATES = 2 * math.sqrt(K / M) * np.sin((2 * J - 1) * math.pi / (2 * (2 * STOREYS + 1)))
SHAPES = np.sin(np.outer(J, 2 * J - 1) * math.pi / (2 * STOREYS + 1))


def made():
    """Load the program that writes the record."""
    path = ROOT / "benchmarks" / "ground_motion.py"
    spec = importlib.util.spec_from_file_location("ground_motion", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def oscillator(w, t, ground):
    """Give p and p' of p'' + 2 zeta w p' + w^2 p = -ground, linear between points.

    Source: N. C. Nigam and P. C. Jennings, Bull. Seism. Soc. Am. 59 (1969), 909.
    """
    h = t[1] - t[0]
    # Of p, p', the ground's acceleration and its slope.
    rates = np.zeros((4, 4))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1] = [-w * w, -2 * ZETA * w, -1.0, 0.0]
    step, x, found = expm(rates * h), np.zeros(2), [np.zeros(2)]
    for a, b in itertools.pairwise(ground):
        x = (step @ [*x, a, (b - a) / h])[:2]
        found.append(x)
    return np.array(found).T


@pytest.fixture(scope="module")
def exact():
    """Give times, displacements (3, k) and felt accelerations (3, k) of the floors."""
    t, ground = np.array(made().record()).T
    p, v = np.moveaxis([oscillator(w, t, ground) for w in RATES], 1, 0)
    parts = SHAPES.sum(axis=0) / (SHAPES**2).sum(axis=0)
    each = SHAPES * parts
    felt = -each @ (RATES[:, None] ** 2 * p + 2 * ZETA * RATES[:, None] * v)
    return t, each @ p, felt


def test_the_record_is_that_of_its_program():
    text = (MODELS / "synthetic_ground_motion.csv").read_text(encoding="utf-8")
    assert text == made().text()
    assert made().text(1) != text


def test_the_floors_move_as_the_sum_of_their_modes(exact):
    t, u, felt = exact
    found = simulate(lagsim.load(str(FRAME)))
    assert found.t == pytest.approx(t, abs=1e-12)
    size, most = np.max(np.abs(u)), np.max(np.abs(felt))
    for k in range(STOREYS):
        assert found[f"u.{k + 1}"] == pytest.approx(u[k], abs=1e-9 * size)
        assert found[f"felt.{k + 1}"] == pytest.approx(felt[k], abs=1e-9 * most)
    drifts = np.abs(np.diff(u, axis=0, prepend=0.0)) / 3.0
    assert found["drift"] == pytest.approx(drifts.max(axis=0), abs=1e-9 * drifts.max())
    assert found["shear"] == pytest.approx(K * u[0], abs=1e-9 * K * size)
    # What the header of the file expects.
    header = FRAME.read_text(encoding="utf-8").partition("name:")[0]
    assert f"{1e3 * size:.2f} mm" in header
    assert f"{most:.2f} m/s^2" in header


def test_each_mode_has_the_damping_of_the_file():
    small = lagsim.modes(str(FRAME), response=["a:u.3"])
    for mode, w in zip(small.modes, RATES, strict=True):
        assert mode["natural_frequency"] == pytest.approx(w / (2 * math.pi), rel=1e-10)
        assert mode["damping"] == pytest.approx(ZETA, rel=1e-10)
    parts = SHAPES[2] * SHAPES.sum(axis=0) / (SHAPES**2).sum(axis=0)
    w = 2 * math.pi * small.response["frequency"][:, None]
    exact = np.abs(np.sum(parts / (RATES**2 - w**2 + 2j * ZETA * RATES * w), axis=1))
    assert small.response["a:u.3.amplitude"] == pytest.approx(exact, rel=1e-9)
