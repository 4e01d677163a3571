"""Logarithms and powers of two by polynomials."""

from __future__ import annotations

import math

import numpy as np

from lagsim.methods.taylor import log2_of, two_to_the

# What the polynomials leave, by their own text.
LEFT = 4e-10
SHARE = 1e-10


def test_logarithms() -> None:
    rng = np.random.default_rng(1)
    for x in (*np.exp(rng.uniform(-690, 690, 300)).tolist(), 1.0, 2.0**0.5, 0.5, 2.0):
        assert abs(log2_of(x) - math.log2(x)) < LEFT
    assert log2_of(2.0**-1022) == -1022.0
    assert log2_of(2.0**1000) == 1000.0


def test_powers() -> None:
    rng = np.random.default_rng(2)
    for x in (*rng.uniform(-1000, 1000, 300).tolist(), 0.5, -0.5):
        assert abs(two_to_the(x) / 2.0**x - 1.0) < SHARE
    ends = [two_to_the(x) / 2.0**k for x, k in ((1e9, 1023), (-1e9, -1022))]
    assert max(abs(x - 1.0) for x in ends) < SHARE
