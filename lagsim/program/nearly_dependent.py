"""Kernels for groups of rows that hold and are nearly dependent in the metric of M.

With Y = L^-1 A^T and M = L L^T, the matrix S = Y^T Y of the systems for multipliers has
the square of the condition of Y: two rows at an angle of 1e-8 make S singular to
rounding. The columns of Y, scaled to length 1, are factored as Q R instead, and
S = R^T R.

Source: A. Bjorck, Numerical Methods for Least Squares Problems, 1996, section 2.4:
Gram-Schmidt with reorthogonalisation.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.program import mass
from lagsim.tolerances import OVERFLOW

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# A row with a smaller part outside of the span of the rows before it depends on these.
INDEPENDENT = 1e-13
# In place of the first exchange of pivots: the group is factored by rows.
BY_ROWS = -1.0


def is_frictionless(p: Parameters, begin: int, end: int) -> bool:
    """Whether no sliding friction is in proportion to multipliers of some rows.

    Then their matrix S is symmetric. The rows are those with places begin to end - 1.
    """
    n = p.n
    for k in range(begin, end):
        row, push = p.Y[k * n :], p.Z[k * n :]
        i = int(p.order[k])
        for e in range(mass.first_range(p, i), mass.first_range(p, i + 1)):
            for j in range(mass.range_begin(p, e), mass.range_end(p, e)):
                if row[j] != push[j]:
                    return False
    return True


def factor_rows(p: Parameters, begin: int, count: int, R: Floats) -> int:
    """Factor the scaled columns of Y of a group as Q R.

    Return 0 if the columns are not finite, else 1. Q replaces the rows of p.Y from
    place `begin` on. A column that depends on the ones before it, as at a change point,
    has a column 0 of Q and an infinite element of R, so that its multiplier is 0.

    begin, count : the places of the group's rows.
    R : (count, count).
    """
    n = p.n
    R[: count * count] = 0.0
    for k in range(count):
        row = p.Y[(begin + k) * n :]
        row[:n] = p.Z[(begin + k) * n : (begin + k + 1) * n]
        row[:n] *= sqrt(p.scales[begin + k])
        for _ in range(2):
            for j in range(k):
                other = p.Y[(begin + j) * n :]
                part = mass.product(n, other, row)
                R[j * count + k] += part
                row[:n] -= part * other[:n]
        rest = sqrt(mass.product(n, row, row))
        if not rest < OVERFLOW:
            return 0
        if not rest > INDEPENDENT:
            rest = inf
        R[k * count + k] = rest
        row[:n] /= rest
    return 1


def solve_by_rows(p: Parameters, begin: int, count: int, R: Floats) -> None:
    """Replace the right sides in p.w by S^-1 times these, for one group.

    The right sides are scaled as the rows of S.

    begin, count : the places of the group's rows.
    R : (count, count), the factor of `factor_rows`.
    """
    w, scales = p.w[begin:], p.scales[begin:]
    for k in range(count):
        if scales[k] > 0.0:
            w[k] /= sqrt(scales[k])
        for j in range(k):
            w[k] -= R[j * count + k] * w[j]
        w[k] /= R[k * count + k]
    for back in range(count):
        k = count - 1 - back
        for j in range(k + 1, count):
            w[k] -= R[k * count + j] * w[j]
        w[k] /= R[k * count + k]
    for k in range(count):
        w[k] *= sqrt(scales[k])
