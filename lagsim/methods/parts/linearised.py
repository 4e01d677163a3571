"""The linear systems of an implicit method for q' = v, v' = a(t, q, v).

With J = da/d(q, v), (g - [0 1; Jq Jv]) (x, w) = (r, s) becomes n equations,
(g^2 - g Jv - Jq) x = s + (g - Jv) r, and w = g x - r. A complex g = alpha + i beta
makes it 2 n real ones. Works are quadratures: their rows come last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.lu import decompose, solve
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def decompose_real(n: int, g: float, J: Floats, K: Floats, pivots: Floats) -> int:
    """Factor g^2 - g Jv - Jq into K (n, n); give 0 where it is singular."""
    for i in range(n):
        for j in range(n):
            K[i * n + j] = -J[2 * i * n + j] - g * J[2 * i * n + n + j]
        K[i * n + i] += g * g
    return decompose(n, K, pivots)


def decompose_pair(
    n: int, alpha: float, beta: float, J: Floats, K: Floats, pivots: Floats
) -> int:
    """Factor the same for g = alpha + i beta into K (2 n, 2 n)."""
    width = 2 * n
    for i in range(n):
        upper = at(K, i * width)
        lower = at(K, (n + i) * width)
        for j in range(n):
            slope = J[i * width + n + j]
            real = -J[i * width + j] - alpha * slope
            imaginary = -beta * slope
            if i == j:
                real += alpha * alpha - beta * beta
                imaginary += 2.0 * alpha * beta
            upper[j] = real
            lower[n + j] = real
            upper[n + j] = -imaginary
            lower[j] = imaginary
    return decompose(width, K, pivots)


def solve_real(
    n: int, works: int, g: float, J: Floats, K: Floats, pivots: Floats, r: Floats
) -> None:
    """Replace r (2 n + works,) by the solution. K, pivots are left alone."""
    right = at(r, n)
    for i in range(n):
        right[i] += g * r[i]
        for j in range(n):
            right[i] -= J[2 * i * n + n + j] * r[j]
    solve(n, K, pivots, right)
    for i in range(n):
        x = right[i]
        right[i] = g * x - r[i]
        r[i] = x
    for k in range(works):
        value = r[2 * n + k]
        row = at(J, 2 * n * (n + k))
        for j in range(2 * n):
            value += row[j] * r[j]
        r[2 * n + k] = value / g


def solve_pair(
    n: int,
    works: int,
    alpha: float,
    beta: float,
    J: Floats,
    K: Floats,
    pivots: Floats,
    real: Floats,
    imaginary: Floats,
    x: Floats,
) -> None:
    """Replace real + i imaginary by the solution; x : (2 n,) is room to work in."""
    for i in range(n):
        x[i] = real[n + i] + alpha * real[i] - beta * imaginary[i]
        x[n + i] = imaginary[n + i] + alpha * imaginary[i] + beta * real[i]
        for j in range(n):
            slope = J[2 * i * n + n + j]
            x[i] -= slope * real[j]
            x[n + i] -= slope * imaginary[j]
    solve(2 * n, K, pivots, x)
    for i in range(n):
        real[n + i] = alpha * x[i] - beta * x[n + i] - real[i]
        imaginary[n + i] = alpha * x[n + i] + beta * x[i] - imaginary[i]
        real[i] = x[i]
        imaginary[i] = x[n + i]
    square = alpha * alpha + beta * beta
    for k in range(2 * n, 2 * n + works):
        a = real[k]
        b = imaginary[k]
        row = at(J, 2 * n * (k - n))
        for j in range(2 * n):
            a += row[j] * real[j]
            b += row[j] * imaginary[j]
        real[k] = (a * alpha + b * beta) / square
        imaginary[k] = (b * alpha - a * beta) / square
