"""The constraint rows: scaled, triangularised with pivoting, and solved with.

Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., sections 5.2, 5.4
and 5.5.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import NOTE, Parameters
from lagsim.native.kernels.words import at
from lagsim.solve._cholesky import backward, cholesky, forward

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# A pivoted column counts as zero past the rank that the rows have in general (away from
# the constraints, at the stages of a step, dependent rows are not quite so), and below
# PASSING of REFERENCE: where rank is lost on the way, what would be divided by it is
# rounding.
RANK = 1e-10
PASSING = 1e-8


def spread(p: Parameters) -> None:
    """Make the rows of Y: L^-1 A_i, scaled, and the scales.

    The scale of a row is the largest length (m,) that it has had on the way, so that
    one that vanishes is seen to; see `keep_lengths`.
    """
    n, A, Y, lengths, scales = p.n, p.A, p.Y, p.lengths, p.scales
    for i in range(p.m):
        row = at(Y, i * n)
        for j in range(n):
            row[j] = A[i * n + j]
        forward(n, p.L, row)
        length = 0.0
        for j in range(n):
            length += row[j] * row[j]
        length = max(lengths[i], sqrt(length))
        scales[i] = 0.0
        if length > 0.0:
            scales[i] = 1.0 / length
        for j in range(n):
            row[j] *= scales[i]


def keep_lengths(p: Parameters) -> None:
    """Note the lengths that `spread` has scaled by, of a state on the way.

    Not of every state: what a step is tried with may lie anywhere.
    """
    order, lengths, scales = p.order, p.lengths, p.scales
    for k in range(p.m):
        i = int(order[k])
        if scales[k] > 0.0:
            lengths[i] = max(lengths[i], 1.0 / scales[k])


def reflect(p: Parameters) -> int:
    """Triangularise Y^T by reflections with pivoting; give the rank.

    Leaves the size of the last column that is independent in general as sigma. Row k
    of Y then holds R[0:k, k] and the k-th reflection's vector after its first
    component, which is 1. Past the rank that is so, too, as far as anything is left.
    A row is reflected onto the largest of its own entries, which is exchanged into
    place k, and noted: rounding stays among the coordinates that rows join.
    """
    n, m, Y, diagonal, factors, places = p.n, p.m, p.Y, p.diagonal, p.factors, p.places
    kept = set_aside(p)
    for k in range(n):
        places[k] = k
    cutoff = max(RANK, PASSING * p.reference)
    expected = min(n, kept, int(p.expected))
    p.sigma = 1.0
    rank = expected
    reflected = 0
    for k in range(expected):
        best = longest_row(n, k, kept, Y)
        longest = sqrt(rest_of_row(n, k, at(Y, best * n)))
        p.sigma = longest
        if longest < cutoff:
            rank = min(rank, k)
        if longest == 0.0:
            break
        swap(p, k, best)
        row = at(Y, k * n)
        places[k] = largest_entry(n, k, row)
        exchange(n, m, k, int(places[k]), Y)
        diagonal[k] = -longest
        if row[k] < 0.0:
            diagonal[k] = longest
        head = row[k] - diagonal[k]
        factors[k] = -head / diagonal[k]
        for j in range(k + 1, n):
            row[j] /= head
        for i in range(k + 1, m):
            mirror(n, k, row, factors[k], at(Y, i * n))
        reflected = k + 1
    if p.least_sigma >= NOTE:
        note_directions(p, reflected)
    p.least_sigma = min(p.least_sigma, p.sigma)
    return rank


def note_directions(p: Parameters, end: int) -> None:
    """Note the directions of the constraints: one for each of the first reflections."""
    n, L, Y, factors, directions, u = p.n, p.L, p.Y, p.factors, p.directions, p.mirrored
    p.noted = end
    for k in range(end):
        z = at(directions, 2 * n * k)
        mass = at(z, n)
        for j in range(n):
            u[j] = 0.0
        u[k] = 1.0
        for before in range(k + 1):
            j = k - before
            mirror(n, j, at(Y, j * n), factors[j], u)
        from_places(n, p.places, u)
        for a in range(n):
            mass[a] = 0.0
            for j in range(a + 1):
                mass[a] += L[a * n + j] * u[j]
        backward(n, L, u, z)


def longest_row(n: int, k: int, end: int, Y: Floats) -> int:
    """Give the row among k, ..., end - 1 that is longest from column k on."""
    best = k
    longest = -1.0
    for i in range(k, end):
        length = rest_of_row(n, k, at(Y, i * n))
        if length > longest:
            longest = length
            best = i
    return best


def set_aside(p: Parameters) -> int:
    """Put the rows that are marked in `aside` (m,) last; give how many are not."""
    m, aside, order = p.m, p.aside, p.order
    kept = m
    for back in range(m):
        i = m - 1 - back
        order[i] = i
        if aside[i] > 0.0:
            kept -= 1
    end = m
    for back in range(m):
        i = m - 1 - back
        if aside[i] > 0.0:
            end -= 1
            swap(p, i, end)
    return kept


def rest_of_row(n: int, k: int, row: Floats) -> float:
    """Give the square of the length of a row from column k on."""
    length = 0.0
    for j in range(k, n):
        length += row[j] * row[j]
    return length


def swap(p: Parameters, k: int, i: int) -> None:
    """Exchange rows k and i of Y, with their scale, right side and index."""
    n, Y, scales, right, order = p.n, p.Y, p.scales, p.w, p.order
    for j in range(n):
        Y[k * n + j], Y[i * n + j] = Y[i * n + j], Y[k * n + j]
    scales[k], scales[i] = scales[i], scales[k]
    right[k], right[i] = right[i], right[k]
    order[k], order[i] = order[i], order[k]


def largest_entry(n: int, k: int, row: Floats) -> int:
    """Give where a row is largest, from column k on."""
    best = k
    for j in range(k + 1, n):
        if abs(row[j]) > abs(row[best]):
            best = j
    return best


def exchange(n: int, m: int, k: int, c: int, Y: Floats) -> None:
    """Exchange columns k and c of Y; of the reflections made, too."""
    if c != k:
        for i in range(m):
            Y[i * n + k], Y[i * n + c] = Y[i * n + c], Y[i * n + k]


def to_places(n: int, places: Floats, x: Floats) -> None:
    """Exchange the components of x (n,) as the columns were."""
    for k in range(n):
        c = int(places[k])
        x[k], x[c] = x[c], x[k]


def from_places(n: int, places: Floats, x: Floats) -> None:
    """Exchange them back."""
    for back in range(n):
        k = n - 1 - back
        c = int(places[k])
        x[k], x[c] = x[c], x[k]


def mirror(n: int, k: int, row: Floats, factor_k: float, x: Floats) -> None:
    """Apply the k-th reflection to x (n,)."""
    product = x[k]
    for j in range(k + 1, n):
        product += row[j] * x[j]
    product *= factor_k
    x[k] -= product
    for j in range(k + 1, n):
        x[j] -= product * row[j]


def impress(p: Parameters, rank: int) -> None:
    """Give u = Q w (n,) with R^T w = right side: the constraint forces times L^-1."""
    n, Y, u, w, diagonal, factors = p.n, p.Y, p.u, p.w, p.diagonal, p.factors
    for k in range(rank):
        for j in range(k):
            w[k] -= Y[k * n + j] * w[j]
        w[k] /= diagonal[k]
    for j in range(n):
        u[j] = 0.0
    for k in range(rank):
        u[k] = w[k]
    for i in range(rank):
        k = rank - 1 - i
        mirror(n, k, at(Y, k * n), factors[k], u)
    from_places(n, p.places, u)


def multipliers(p: Parameters, rank: int) -> None:
    """Leave lambda (m,) of R lambda = w in the original scale and order, of least norm.

    With B = R1^-1 R2 and x = R1^-1 w: lambda = (x - B z, z), (I + B^T B) z = B^T x.
    """
    m, w, order, x, out = p.m, p.w, p.order, p.x, p.multipliers
    for k in range(rank):
        x[k] = w[k]
    unscaled_backward(p, rank, x)
    if rank < m:
        shorten(p, rank)
    for c in range(rank, m):
        out[int(order[c])] = w[c - rank]
    for k in range(rank):
        out[int(order[k])] = x[k]


def shorten(p: Parameters, rank: int) -> None:
    """Leave the free multipliers z (m - rank,) in w, x - B z in x, of least norm."""
    n = p.n
    spare = p.m - rank
    Y, x, scales, free, B = p.Y, p.x, p.scales, p.w, p.free
    normal = at(B, rank * spare)
    for c in range(spare):
        column = at(B, c * rank)
        for k in range(rank):
            column[k] = 0.0
            if scales[rank + c] > 0.0:
                column[k] = Y[(rank + c) * n + k] / scales[rank + c]
        unscaled_backward(p, rank, column)
    z = at(x, rank)
    for c in range(spare):
        z[c] = inner(rank, at(B, c * rank), x)
        for d in range(c + 1):
            normal[c * spare + d] = inner(rank, at(B, c * rank), at(B, d * rank))
        normal[c * spare + c] += 1.0
    cholesky(spare, normal)
    forward(spare, normal, z)
    backward(spare, normal, z, free)
    for c in range(spare):
        for k in range(rank):
            x[k] -= B[c * rank + k] * free[c]


def unscaled_backward(p: Parameters, rank: int, x: Floats) -> None:
    """Replace x (rank,) by the solution of R1 D^-1 x, D the scales."""
    n, Y, scales, diagonal = p.n, p.Y, p.scales, p.diagonal
    for i in range(rank):
        k = rank - 1 - i
        for j in range(k + 1, rank):
            x[k] -= Y[j * n + k] * x[j] / scales[j]
        x[k] *= scales[k] / diagonal[k]


def inner(length: int, a: Floats, b: Floats) -> float:
    """Give the inner product."""
    value = 0.0
    for i in range(length):
        value += a[i] * b[i]
    return value
