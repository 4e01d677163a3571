"""Eigenmodes of y' = R y: rates, shapes, and how much of a motion is in each."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.arrays import Complexes, Flags, Floats


class Eigenmodes(NamedTuple):
    """Some of the modes of a matrix.

    Attributes
    ----------
    values : ndarray, shape (k,)
    right : ndarray, shape (size, k)
        Their vectors.
    left : ndarray, shape (size, k)
        Those of the transpose, in an order of their own.
    """

    values: Complexes
    right: Complexes
    left: Complexes

    def amplitudes(self, rates: Floats) -> Complexes:
        """Give what of y' = `rates` is in each mode (k,)."""
        # Left and right vectors of equal eigenvalues need not come in pairs.
        sides = self.left.T @ self.right, self.left.T @ rates
        return np.asarray(np.linalg.lstsq(*sides, rcond=None)[0], dtype=complex)

    def swing(self, part: float) -> Flags:
        """Tell which decay by less than `part` of their rate (k,)."""
        flags: Flags = -self.values.real < part * np.abs(self.values)
        return flags


def eigenmodes(matrix: Floats, kept: Callable[[Floats], Flags]) -> Eigenmodes:
    """Give the modes of `matrix` whose rates |eigenvalue| are `kept`."""
    values, right = np.linalg.eig(matrix)
    others, left = np.linalg.eig(matrix.T)
    chosen = kept(np.abs(values))
    return Eigenmodes(values[chosen], right[:, chosen], left[:, kept(np.abs(others))])


def weighted(moved: Complexes, masses: Floats) -> Floats:
    """Give shapes (n, k) by the roots of masses (n,), each at most 1."""
    shapes: Floats = np.abs(moved) * np.sqrt(masses)[:, None]
    shapes /= np.maximum(np.max(shapes, axis=0, initial=0.0), 1e-300)
    return shapes
