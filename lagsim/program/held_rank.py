"""Kernels for the rank of the equalities that hold, in systems with laws.

As in `dense`, sigma is the smallest pivot of the scaled rows, here of the equalities
alone: a bounded multiplier ends its mode before its row becomes dependent.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.program import mass
from lagsim.program.nearly_dependent import BY_ROWS
from lagsim.tolerances import OVERFLOW

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats


def own_place(p: Parameters, i: int) -> int:
    """Return the index of the coordinate on which slider row i acts; else -1."""
    k = i - p.m + p.laws
    return int(p.law_place[k]) if k >= 0 else -1


def note_sigma(p: Parameters, begin: int, end: int, factors: Floats) -> None:
    """Lower p.sigma to the least pivot of the equalities among the rows of a group.

    A pivot is the part of a row of Y that the rows before it lack, relative to the
    largest length of the row in the arc. Equalities are the rows without bounds. A
    group whose S is singular is not regarded.

    begin, end : the places of the group's rows.
    factors : the factors of S of the group.
    """
    if not p.scales[begin] > 0.0:
        return
    count = end - begin
    rows = p.x
    by_rows = p.factors[begin] == BY_ROWS
    for j in range(count):
        rows[j] = begin + j
    for j in range(count):
        square = abs(factors[j * count + j])
        if by_rows:
            square = square * square if square < OVERFLOW else 0.0
        else:
            best = int(p.factors[begin + j])
            rows[j], rows[best] = rows[best], rows[j]
        k = int(rows[j])
        i = int(p.order[k])
        if is_equality(p, i) and p.scales[k] > 0.0:
            largest = max(p.lengths[i] * p.lengths[i], 1.0 / p.scales[k])
            square /= p.scales[k] * largest
            p.sigma = min(p.sigma, sqrt(square))


def is_equality(p: Parameters, i: int) -> bool:
    """Whether the multiplier of row i has no bounds, and acts on all of its columns."""
    k = i - p.m + p.laws
    if k < 0:
        return True
    return p.law_low[k] < -OVERFLOW and float(p.law_place[k]) < 0.0


def update_held_lengths(p: Parameters) -> None:
    """Update p.lengths (m,), see `dense.update_lengths`, of the rows that hold."""
    for k in range(int(p.ranked)):
        i = int(p.order[k])
        if p.scales[k] > 0.0:
            p.lengths[i] = max(p.lengths[i], 1.0 / sqrt(p.scales[k]))


def note_held_directions(p: Parameters) -> None:
    """Store directions z, orthonormal in the metric of M, in p.directions (noted, n).

    They span the vectors M^-1 A_i of the rows i that hold, but for those of sliders.
    p.momenta (noted, n) holds M z.
    """
    n, u = p.n, p.Y
    count = 0
    for k in range(int(p.ranked)):
        if count < n and own_place(p, int(p.order[k])) < 0:
            row = u[count * n :]
            row[:n] = p.Z[k * n : (k + 1) * n]
            for _ in range(2):
                for j in range(count):
                    part = mass.product(n, u[j * n :], row)
                    row[:n] -= part * u[j * n : (j + 1) * n]
            rest = sqrt(mass.product(n, row, row))
            if rest > 0.0:
                row[:n] /= rest
                mass.store_direction(p, count, row)
                count += 1
    p.noted = count
    p.factored = min(p.factored, 1.0)  # Y is overwritten
