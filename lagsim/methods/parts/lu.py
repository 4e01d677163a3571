"""A = L U with row interchanges, for the Newton iterations of implicit methods.

Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 3.4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.structure import Structure


# Past this, matrices of all unknowns in each step cost more than a run can wait for.
LARGEST = 300


def too_large(scene: Structure) -> str:
    """Say why a scene has too many unknowns for dense matrices, or give ""."""
    if scene.unknowns <= LARGEST:
        return ""
    return (
        f"it has {scene.unknowns} coordinates and constraints, and the matrices of "
        f"this method are dense, for up to {LARGEST} (`dop853` handles large "
        "models)"
    )


def decompose(n: int, A: Floats, pivots: Floats) -> int:
    """Replace A (n, n) by its factors; give 0 where it is singular or not finite.

    Each pivot is the largest against the size of its row, so that units of rows do
    not matter. pivots : (n,).
    """
    for i in range(n):
        pivots[i] = 0.0
        for j in range(n):
            pivots[i] = max(pivots[i], abs(A[i * n + j]))
        if not 0.0 < pivots[i] < 1e300:
            return 0
    for k in range(n):
        best = largest_in_column(n, k, A, pivots)
        if A[best * n + k] == 0.0:
            return 0
        if best != k:
            for j in range(n):
                A[k * n + j], A[best * n + j] = A[best * n + j], A[k * n + j]
        pivots[best] = pivots[k]
        pivots[k] = best
        eliminate(n, k, A)
    return 1


def eliminate(n: int, k: int, A: Floats) -> None:
    """Subtract row k from those below, each times its entry of L, which stays."""
    row = at(A, k * n)
    for i in range(k + 1, n):
        below = at(A, i * n)
        if below[k] != 0.0:
            below[k] /= row[k]
            for j in range(k + 1, n):
                below[j] -= below[k] * row[j]


def largest_in_column(n: int, k: int, A: Floats, sizes: Floats) -> int:
    """Give the row from k on whose entry in column k is largest for its row."""
    best = k
    largest = 0.0
    for i in range(k, n):
        size = abs(A[i * n + k]) / sizes[i]
        if size > largest:
            largest = size
            best = i
    return best


def solve(n: int, A: Floats, pivots: Floats, x: Floats) -> None:
    """Replace x (n,) by A^-1 x, with what `decompose` left."""
    for k in range(n):
        best = int(pivots[k])
        x[k], x[best] = x[best], x[k]
    for i in range(n):
        value = x[i]
        for j in range(i):
            value -= A[i * n + j] * x[j]
        x[i] = value
    for back in range(n):
        i = n - 1 - back
        value = x[i]
        for j in range(i + 1, n):
            value -= A[i * n + j] * x[j]
        x[i] = value / A[i * n + i]
