"""The coefficients of Radau IIA of order 5, and what diagonalises them.

The nodes are the zeros of N(x) = (x - 1)(x^2 - 4 x/5 + 1/10). A and B integrate
Lagrange's polynomials. An eigenvector of A^-1 for the eigenvalue mu is, at the nodes,
the polynomial N'/mu + N''/mu^2 + N'''/mu^3: its derivative less mu times itself is a
multiple of N, and it vanishes at 0.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 2nd ed.,
sections IV.5 and IV.8.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

Rows = tuple[tuple[float, ...], ...]


def integrals(nodes: Sequence[float]) -> Rows:
    """Give, for each node, the integral from 0 of its polynomial: x^1, x^2, ..."""
    rows = []
    for j, own in enumerate(nodes):
        product, scale = [1.0], 1.0
        for k, other in enumerate(nodes):
            if k != j:
                shifted = [0.0, *product]
                product = [
                    a - other * b for a, b in zip(shifted, [*product, 0.0], strict=True)
                ]
                scale *= own - other
        rows.append(tuple(a / (scale * (k + 1)) for k, a in enumerate(product)))
    return tuple(rows)


def at_point(row: Sequence[float], x: float) -> float:
    """Give the polynomial row[0] x + row[1] x^2 + ... ."""
    value = 0.0
    for a in reversed(row):
        value = (value + a) * x
    return value


def inverse(A: Rows) -> Rows:
    """Give the inverse (3, 3), by cofactors."""
    minors = [
        [
            A[(i + 1) % 3][(j + 1) % 3] * A[(i + 2) % 3][(j + 2) % 3]
            - A[(i + 1) % 3][(j + 2) % 3] * A[(i + 2) % 3][(j + 1) % 3]
            for j in range(3)
        ]
        for i in range(3)
    ]
    whole = sum(a * b for a, b in zip(A[0], minors[0], strict=True))
    return tuple(tuple(minors[j][i] / whole for j in range(3)) for i in range(3))


C = ((4.0 - sqrt(6.0)) / 10.0, (4.0 + sqrt(6.0)) / 10.0, 1.0)
A = tuple(tuple(at_point(row, c) for row in integrals(C)) for c in C)
B = A[2]
A_INVERSE = inverse(A)

# The eigenvalues of A^-1: GAMMA, and ALPHA + i BETA with its conjugate.
_cubes = (
    9.0 ** (2.0 / 3.0) - 9.0 ** (1.0 / 3.0),
    9.0 ** (2.0 / 3.0) + 9.0 ** (1.0 / 3.0),
)
GAMMA = 30.0 / (6.0 + _cubes[0])
_complex = 1.0 / ((12.0 - _cubes[0] + 1j * sqrt(3.0) * _cubes[1]) / 60.0)
ALPHA, BETA = _complex.real, abs(_complex.imag)


def _eigenvector(mu: complex) -> list[complex]:
    # N = x^3 - 9/5 x^2 + 9/10 x - 1/10
    return [
        (3.0 * c * c - 3.6 * c + 0.9) / mu
        + (6.0 * c - 3.6) / (mu * mu)
        + 6.0 / (mu * mu * mu)
        for c in C
    ]


# A^-1 T = T [GAMMA, 0, 0; 0, ALPHA, -BETA; 0, BETA, ALPHA].
_real, _pair = _eigenvector(GAMMA), _eigenvector(complex(ALPHA, BETA))
T = tuple((a.real, b.real, -b.imag) for a, b in zip(_real, _pair, strict=True))
T_INVERSE = inverse(T)

# Error = (GAMMA/h - J)^-1 (f(y0) + sum ERROR_i Z_i / h), IV.8 (8.19): the difference to
# an embedded formula of order 3 that also uses f(y0).
ERROR = (
    -(13.0 + 7.0 * sqrt(6.0)) / 3.0,
    (-13.0 + 7.0 * sqrt(6.0)) / 3.0,
    -1.0 / 3.0,
)

# y0 + h sum_j y'_j (DENSE[j][0] x + ... + DENSE[j][3] x^4), y' at 0 and the nodes.
DENSE = integrals((0.0, *C))
