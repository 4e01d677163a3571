"""What rows that hold push with, and the equations for their multipliers.

Source: F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts, 1996,
chapter 5.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import SLIP, Parameters
from lagsim.native.kernels.words import at
from lagsim.solve._cholesky import forward

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def couple(p: Parameters, sliding: int) -> None:
    """Make Y = L^-1 A^T of the rows that hold, what pushes with them, and S.

    Each row of S, and of the right side, is brought to the size of its own diagonal.
    """
    n, A, Y, Z, S, L, order, right = p.n, p.A, p.Y, p.Z, p.S, p.L, p.order, p.w
    count = int(p.ranked)
    for k in range(count):
        row = at(Y, k * n)
        push = at(Z, k * n)
        i = int(order[k])
        for j in range(n):
            row[j] = A[i * n + j]
            push[j] = row[j]
        forward(n, L, row)
        if sliding > 0:
            slide_along(p, i, push)
        forward(n, L, push)
    for k in range(count):
        row = at(Y, k * n)
        square = 0.0
        for j in range(n):
            square += row[j] * row[j]
        scale = 1.0 / square if square > 0.0 else 0.0
        for i in range(count):
            push = at(Z, i * n)
            value = 0.0
            for j in range(n):
                value += row[j] * push[j]
            S[k * count + i] = value * scale
        right[k] *= scale


def slide_along(p: Parameters, i: int, push: Floats) -> None:
    """Add to what row i pushes with the friction that goes with its multiplier."""
    n = p.n
    first = p.m - p.laws
    normal, part, A = p.law_normal, p.law_part, p.A
    if i < first:
        return
    for k in range(p.laws):
        if int(normal[k]) == i - first and part[k] != 0.0:
            row = at(A, (first + k) * n)
            for j in range(n):
                push[j] += part[k] * row[j]


def impress(p: Parameters, sliding: int) -> None:
    """Add to u (n,) the forces of the rows that hold, times L^-1."""
    n, u, right = p.n, p.u, p.w
    for k in range(int(p.ranked)):
        push = at(p.Y, k * n)
        if sliding > 0:
            push = at(p.Z, k * n)
        for j in range(n):
            u[j] += right[k] * push[j]


def share_out(p: Parameters) -> None:
    """Leave the multiplier of each row."""
    first = p.m - p.laws
    out, order, right, part = p.multipliers, p.order, p.w, p.law_part
    normal, kind = p.law_normal, p.law_kind
    for i in range(p.m):
        out[i] = 0.0
    for k in range(int(p.ranked)):
        out[int(order[k])] = right[k]
    for k in range(p.laws):
        if part[k] != 0.0:
            out[first + k] = part[k]
            if kind[k] == SLIP:
                out[first + k] *= out[first + int(normal[k])]


def solve(size: int, S: Floats, x: Floats) -> None:
    """Solve S x = right side in place, with row pivoting."""
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(S[i * size + k]) > abs(S[best * size + k]):
                best = i
        if best != k:
            exchange(size, k, best, S, x)
        for i in range(k + 1, size):
            share = S[i * size + k] / S[k * size + k]
            if share != 0.0:
                for j in range(k + 1, size):
                    S[i * size + j] -= share * S[k * size + j]
                x[i] -= share * x[k]
    for back in range(size):
        k = size - 1 - back
        for j in range(k + 1, size):
            x[k] -= S[k * size + j] * x[j]
        x[k] /= S[k * size + k]


def exchange(size: int, k: int, i: int, S: Floats, x: Floats) -> None:
    """Exchange two rows."""
    for j in range(k, size):
        S[k * size + j], S[i * size + j] = S[i * size + j], S[k * size + j]
    x[k], x[i] = x[i], x[k]
