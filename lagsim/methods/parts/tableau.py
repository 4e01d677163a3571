"""Runge-Kutta tableaus that check themselves when built."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Tableau:
    """A Runge-Kutta method.

    Attributes
    ----------
    A : tuple of rows, shape (s, up to s - 1)
        Trailing zeros are left out.
    B : tuple, shape (up to s,)
    C : tuple, shape (s,)
    order : int

    Raises
    ------
    ValueError
        Where a row of A does not add up to its C, or B fails a quadrature condition
        sum b c^(k-1) = 1/k of its order: a digit has been mistyped. (The conditions of
        all rooted trees up to the order are checked by the tests.)
    """

    A: tuple[tuple[float, ...], ...]
    B: tuple[float, ...]
    C: tuple[float, ...]
    order: int

    def __post_init__(self) -> None:
        for i, (row, c) in enumerate(zip(self.A, self.C, strict=True)):
            size = 1.0 + sum(map(abs, row))
            if abs(sum(row) - c) > 1e-14 * size:
                raise ValueError(f"row {i} of A adds up to {sum(row)!r}, not to {c!r}")
        for k in range(1, self.order + 1):
            terms = [b * c ** (k - 1) for b, c in zip(self.B, self.C, strict=False)]
            if abs(sum(terms) - 1 / k) > 1e-14 * (1.0 + sum(map(abs, terms))):
                raise ValueError(f"B fails the quadrature condition of order {k}")

    def amplification(self, z: complex) -> float:
        """Give |R(z)|, R(z) = 1 + z B^T (1 - z A)^-1 1, for y' = (z/h) y.

        Hairer, Norsett and Wanner, Solving ODEs II, (IV.3.2).
        """
        import numpy as np

        s = len(self.B)
        A = np.zeros((s, s))
        for i, row in enumerate(self.A[:s]):
            A[i, : len(row)] = row
        stages = np.linalg.solve(np.eye(s) - z * A, np.ones(s))
        return float(abs(1.0 + z * np.dot(self.B, stages)))
