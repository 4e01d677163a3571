"""The frame in an earthquake, mode by mode, exactly between points of the record."""

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import expm

import lagsim
from tests.support import MODELS, simulate

FRAME, STOREYS, ZETA = MODELS / "frame-in-an-earthquake.yaml", 3, 0.05
M, K, G = 2e4, 2e7, 9.80665
J = np.arange(1, STOREYS + 1)
RATES = 2 * math.sqrt(K / M) * np.sin((2 * J - 1) * math.pi / (2 * (2 * STOREYS + 1)))
SHAPES = np.sin(np.outer(J, 2 * J - 1) * math.pi / (2 * STOREYS + 1))
RECORD = np.loadtxt(MODELS / "el_centro_1940_ns.csv", delimiter=",", skiprows=8)


def oscillator(w, t, ground):
    """Return p and p' of p'' + 2 zeta w p' + w^2 p = -ground, linear between points.

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
    """Return times, displacements (3, k) and accelerations felt (3, k) of floors."""
    t, ground = RECORD.T * [[1.0], [G]]
    p, v = np.moveaxis([oscillator(w, t, ground) for w in RATES], 1, 0)
    parts = SHAPES.sum(axis=0) / (SHAPES**2).sum(axis=0)
    each = SHAPES * parts
    felt = -each @ (RATES[:, None] ** 2 * p + 2 * ZETA * RATES[:, None] * v)
    return t, each @ p, felt


def test_the_record_is_that_of_el_centro():
    t, ground = RECORD.T
    assert len(t) == 1560
    assert t == pytest.approx(0.02 * np.arange(1560), abs=1e-9)
    # The published peak and its time.
    assert np.max(np.abs(ground)) == pytest.approx(0.319, abs=5e-4)
    assert t[np.argmax(np.abs(ground))] == 2.02
    header = (MODELS / "el_centro_1940_ns.csv").read_text(encoding="utf-8")
    for word in ("El Centro", "18 May 1940", "north-south", "in g", "public domain"):
        assert word in header
        assert word in FRAME.read_text(encoding="utf-8")


def peaks(periods, zeta):
    """Return the largest deformations (m) of frames of one storey, by lagsim."""
    frame = lagsim.load(str(FRAME), n=1, zeta=zeta)
    found = lagsim.sweep(frame, {"k": [M * (2 * math.pi / T) ** 2 for T in periods]})
    return np.maximum(found["u.1.max"], -found["u.1.min"])


@pytest.mark.parametrize(
    ("zeta", "periods", "inches"),
    [
        (0, (2,), (9.91,)),
        (0.05, (2,), (5.37,)),
        pytest.param(0.02, (0.5, 1, 2), (2.67, 5.97, 7.47), marks=pytest.mark.slow),
    ],
)
def test_deformations_are_those_published(zeta, periods, inches):
    """A. K. Chopra, Dynamics of Structures, figure 6.4.1, in inches."""
    assert peaks(periods, zeta) / 0.0254 == pytest.approx(inches, abs=0.005)


@pytest.mark.slow
def test_the_response_spectrum_is_that_of_scipy():
    from scipy.signal import lsim  # takes over a second

    t, ground = RECORD.T
    periods, exact = [0.1, 0.3, 0.7, 1.5, 3.0], []
    for T in periods:
        w = 2 * math.pi / T
        system = ([-1.0], [1.0, 2 * ZETA * w, w * w])
        exact.append(np.max(np.abs(lsim(system, G * ground, t)[1])))
    assert peaks(periods, ZETA) == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
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
    assert f"{1e-3 * K * np.max(np.abs(u[0])):.1f} kN" in header


def test_each_mode_has_the_damping_of_the_file():
    small = lagsim.modes(str(FRAME), response=["a:u.3"])
    for mode, w in zip(small.modes, RATES, strict=True):
        assert mode["natural_frequency"] == pytest.approx(w / (2 * math.pi), rel=1e-10)
        assert mode["damping"] == pytest.approx(ZETA, rel=1e-10)
    parts = SHAPES[2] * SHAPES.sum(axis=0) / (SHAPES**2).sum(axis=0)
    w = 2 * math.pi * small.response["frequency"][:, None]
    exact = np.abs(np.sum(parts / (RATES**2 - w**2 + 2j * ZETA * RATES * w), axis=1))
    assert small.response["a:u.3.amplitude"] == pytest.approx(exact, rel=1e-9)
