"""What contacts push with that hold a body more often than they must: least norm.

The forces of those that hold, A_h^T lambda_h, are known; of all multipliers of what
touches, A, that give these, those of least norm are A A_h^T y, where

    (A_h A^T A A_h^T) y = A_h A_h^T lambda_h

with the coordinates in units of the rows' elements. What would pull most is left out,
and again. Where friction is bounded by them the multipliers stay as they were found.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import CONTACT, HELD, IMPLIED, Parameters
from lagsim.native.kernels.words import at
from lagsim.solve._pushes import solve

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def share(p: Parameters, out: Floats) -> None:
    """Share out the multipliers of contacts, of those of all rows (m,)."""
    left_out = p.scales
    for k in range(p.m):
        left_out[k] = 0.0
    for _ in range(p.laws):
        if share_among(p, out) > 0.0:
            return


def share_among(p: Parameters, out: Floats) -> float:
    """Share them out among those that are not left out; or leave one out, and give 0.

    What is not left out may not do: then all stay as they are.
    """
    n = p.n
    first = p.m - p.laws
    mode, A, S, Z, w, x, total = p.law_mode, p.A, p.S, p.Z, p.w, p.x, p.v
    count = 0
    weigh(p)
    for k in range(p.laws):
        if touches(p, k) > 0.0 and mode[k] == HELD:
            x[count] = first + k
            count += 1
    gather_pushes(p, count, x, out, total)
    for i in range(count):
        row = at(A, int(x[i]) * n)
        w[i] = inner(p, row, total)
        push = at(Z, i * n)
        for j in range(n):
            push[j] = 0.0
        for k in range(p.laws):
            if takes_part(p, k) > 0.0:
                other = at(A, (first + k) * n)
                part = inner(p, row, other)
                for j in range(n):
                    push[j] += part * other[j]
    for i in range(count):
        for k in range(count):
            S[i * count + k] = inner(p, at(A, int(x[i]) * n), at(Z, k * n))
    solve(count, S, w)
    return put(p, count, x, out)


def put(p: Parameters, count: int, x: Floats, out: Floats) -> float:
    """Put A A_h^T w in the place of the multipliers, unless one would pull: 0."""
    n = p.n
    first = p.m - p.laws
    A, w, total = p.A, p.w, p.v
    for j in range(n):
        total[j] = 0.0
    for i in range(count):
        row = at(A, int(x[i]) * n)
        for j in range(n):
            total[j] += w[i] * row[j]
    left_out = p.scales
    pulls = hardest(p, total)
    if pulls >= 0:
        left_out[first + pulls] = 1.0
        return 0.0
    for k in range(p.laws):
        if touches(p, k) > 0.0 and abs(total[0]) < 1e300:
            out[first + k] = takes_part(p, k) * inner(p, at(A, (first + k) * n), total)
    return 1.0


def hardest(p: Parameters, total: Floats) -> int:
    """Give the law that would pull most; or -1."""
    first = p.m - p.laws
    A = p.A
    found = -1
    most = 0.0
    for k in range(p.laws):
        if takes_part(p, k) > 0.0:
            push = inner(p, at(A, (first + k) * p.n), total)
            if push < most:
                most = push
                found = k
    return found


def gather_pushes(
    p: Parameters, count: int, x: Floats, multipliers: Floats, total: Floats
) -> None:
    """Give the forces (n,) of the rows x (count,)."""
    n, A = p.n, p.A
    for j in range(n):
        total[j] = 0.0
    for i in range(count):
        k = int(x[i])
        for j in range(n):
            total[j] += multipliers[k] * A[k * n + j]


def weigh(p: Parameters) -> None:
    """Note the square of what makes the largest element of each coordinate 1."""
    n = p.n
    first = p.m - p.laws
    A, weights = p.A, p.u
    for j in range(n):
        weights[j] = 0.0
    for k in range(p.laws):
        if touches(p, k) > 0.0:
            for j in range(n):
                weights[j] = max(weights[j], abs(A[(first + k) * n + j]))
    for j in range(n):
        if weights[j] > 0.0:
            weights[j] = 1.0 / (weights[j] * weights[j])


def inner(p: Parameters, a: Floats, b: Floats) -> float:
    """Give the product of two rows (n,)."""
    weights = p.u
    found = 0.0
    for j in range(p.n):
        found += weights[j] * a[j] * b[j]
    return found


def takes_part(p: Parameters, k: int) -> float:
    """Tell (1) whether a law is one among which multipliers are shared out."""
    left_out = p.scales
    return 0.0 if left_out[p.m - p.laws + k] > 0.0 else touches(p, k)


def touches(p: Parameters, k: int) -> float:
    """Tell (1) whether a law is a contact without friction that touches and holds."""
    kind, mode, normal = p.law_kind, p.law_mode, p.law_normal
    if kind[k] != CONTACT or not (mode[k] == HELD or mode[k] == IMPLIED):
        return 0.0
    for i in range(p.laws):
        if int(normal[i]) == k:
            return 0.0
    return 1.0
