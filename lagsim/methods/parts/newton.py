"""Simplified Newton iterations: convergence test and linear solvers.

For methods with a fixed step, which have no tolerance: they go on to rounding.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.words import at
from lagsim.tolerances import LEAST_PIVOT, OVERFLOW, STALLED_STEP, UNIT_ROUNDOFF

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats
    from lagsim.methods import Structure

# At a slower rate the derivatives are evaluated anew.
SLOW = 0.05
MOST = 30

GO_ON = 0
RENEW = 1
SOLVED = 2
LOST = 3


def progress(iteration: int, change: float, previous: float) -> int:
    """Judge by the size of a step and of the one before, relative to the whole."""
    if not change < OVERFLOW:
        return LOST
    if change == 0.0:
        return SOLVED
    if iteration == 0:
        return GO_ON
    rate = change / previous
    if change * min(1.0, rate) <= UNIT_ROUNDOFF or (
        rate >= 0.5 and change <= STALLED_STEP
    ):
        return SOLVED
    if iteration == MOST - 1:
        return LOST
    return RENEW if rate > SLOW else GO_ON


def take_finite(count: int, slopes: Floats) -> None:
    """Let slopes (count,) without a value be 0, for Newton's method.

    The force |v| v has the slope 0 where v = 0, but written with a root its derivative
    is 0/0 there. Where such a slope is more than nothing, steps that are short enough
    for the iteration lead to a state at which it has a value.
    """
    for k in range(count):
        if not abs(slopes[k]) < OVERFLOW:
            slopes[k] = 0.0


# --- dense L U with row interchanges --------------------------------------------------
# Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 3.4.

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
        if not 0.0 < pivots[i] < OVERFLOW:
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
    """Replace x (n,) by A^-1 x, with the factors of `decompose`."""
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


# --- sparse L U in a fixed order, for Radau IIA ---------------------------------------
# `lagsim.solve.newton` says what is solved, and in which order, so that rows need no
# exchange where the matrix is far from singular, as it is at small steps. A pivot that
# is nothing but the rounding of what it was left of is as good as none: a shorter step
# has larger ones.
#
# Source: T. A. Davis, Direct Methods for Sparse Linear Systems (2006), chapter 6.


def sum_real(p: Parameters, g: float, J: Floats, K: Floats) -> None:
    """Give C0 + g C1 + g^2 C2 of their entries J, where the factors will be."""
    slots = p.newton_slots
    for k in range(p.filled):
        K[k] = 0.0
    for e in range(p.still):
        K[int(slots[e])] += J[e]
    for e in range(p.still, p.damped):
        K[int(slots[e])] += g * J[e]
    for e in range(p.damped, p.entries):
        K[int(slots[e])] += g * g * J[e]


def factor_real(p: Parameters, g: float, J: Floats, K: Floats, x: Floats) -> int:
    """Factor C0 + g C1 + g^2 C2 into K; give 0 where a pivot vanishes.

    x : (N,), room to work in.
    """
    sum_real(p, g, J, K)
    starts, diagonals, columns = p.newton_starts, p.newton_diagonals, p.newton_columns
    for i in range(p.unknowns):
        first = int(starts[i])
        middle = int(diagonals[i])
        end = int(starts[i + 1])
        for k in range(first, end):
            x[int(columns[k])] = K[k]
        largest = abs(x[i])
        for k in range(first, middle):
            above = int(columns[k])
            before = x[i]
            diagonal = int(diagonals[above])
            part = x[above] * K[diagonal]
            x[above] = part
            for j in range(diagonal + 1, int(starts[above + 1])):
                x[int(columns[j])] -= part * K[j]
            largest = max(largest, abs(before - x[i]))
        if not LEAST_PIVOT * largest < abs(x[i]) < OVERFLOW:
            return 0
        for k in range(first, end):
            K[k] = x[int(columns[k])]
        K[middle] = 1.0 / x[i]
    return 1


def sum_pair(p: Parameters, alpha: float, beta: float, J: Floats, K: Floats) -> None:
    """Give the same for g = alpha + i beta; real and imaginary parts take turns."""
    slots = p.newton_slots
    for k in range(2 * p.filled):
        K[k] = 0.0
    for e in range(p.still):
        K[2 * int(slots[e])] += J[e]
    for e in range(p.still, p.damped):
        add(at(K, 2 * int(slots[e])), J[e], alpha, beta)
    for e in range(p.damped, p.entries):
        real = alpha * alpha - beta * beta
        add(at(K, 2 * int(slots[e])), J[e], real, 2.0 * alpha * beta)


def factor_pair(
    p: Parameters, alpha: float, beta: float, J: Floats, K: Floats, x: Floats
) -> int:
    """Factor it; x : (2 N,)."""
    sum_pair(p, alpha, beta, J, K)
    starts, diagonals, columns = p.newton_starts, p.newton_diagonals, p.newton_columns
    for i in range(p.unknowns):
        first = int(starts[i])
        middle = int(diagonals[i])
        end = int(starts[i + 1])
        own = at(x, 2 * i)
        for k in range(first, end):
            take(at(K, 2 * k), at(x, 2 * int(columns[k])))
        largest = abs(own[0]) + abs(own[1])
        for k in range(first, middle):
            above = int(columns[k])
            diagonal = int(diagonals[above])
            part = at(x, 2 * above)
            multiply(at(K, 2 * diagonal), part)
            before = own[0]
            before_i = own[1]
            for j in range(diagonal + 1, int(starts[above + 1])):
                subtract(at(x, 2 * int(columns[j])), part[0], part[1], at(K, 2 * j))
            largest = max(largest, abs(before - own[0]) + abs(before_i - own[1]))
        if not LEAST_PIVOT * largest < abs(own[0]) + abs(own[1]) < OVERFLOW:
            return 0
        for k in range(first, end):
            take(at(x, 2 * int(columns[k])), at(K, 2 * k))
        invert(at(K, 2 * middle))
    return 1


def add(z: Floats, factor: float, real: float, imaginary: float) -> None:
    """Add a complex number times a real one."""
    z[0] += factor * real
    z[1] += factor * imaginary


def take(z: Floats, out: Floats) -> None:
    """Copy a complex number."""
    out[0] = z[0]
    out[1] = z[1]


def multiply(z: Floats, out: Floats) -> None:
    """Multiply by a complex number."""
    real = out[0]
    out[0] = real * z[0] - out[1] * z[1]
    out[1] = real * z[1] + out[1] * z[0]


def subtract(out: Floats, a: float, b: float, z: Floats) -> None:
    """Subtract (a + i b) z."""
    out[0] -= a * z[0] - b * z[1]
    out[1] -= a * z[1] + b * z[0]


def invert(z: Floats) -> None:
    """Replace a complex number by its inverse; nothing overflows on the way."""
    if abs(z[0]) >= abs(z[1]):
        ratio = z[1] / z[0]
        z[0] = 1.0 / (z[0] + ratio * z[1])
        z[1] = -ratio * z[0]
    else:
        ratio = z[0] / z[1]
        z[1] = -1.0 / (z[1] + ratio * z[0])
        z[0] = -ratio * z[1]


def sparse_real(
    p: Parameters, g: float, J: Floats, K: Floats, r: Floats, x: Floats
) -> None:
    """Replace r (size,) by the solution of (g - d y'/dy) z = r. x : (N,)."""
    n, rows, parts, places = p.n, p.newton_rows, p.newton_parts, p.newton_places
    for i in range(p.unknowns):
        x[i] = 0.0
    for e in range(p.still, p.damped):
        x[int(rows[e])] += J[e] * r[int(parts[e])]
    for e in range(p.damped, p.entries):
        j = int(parts[e])
        x[int(rows[e])] += J[e] * (g * r[j] + r[n + j])
    starts, diagonals, columns = p.newton_starts, p.newton_diagonals, p.newton_columns
    for i in range(p.unknowns):
        value = x[i]
        for k in range(int(starts[i]), int(diagonals[i])):
            value -= K[k] * x[int(columns[k])]
        x[i] = value
    for back in range(p.unknowns):
        i = p.unknowns - 1 - back
        value = x[i]
        middle = int(diagonals[i])
        for k in range(middle + 1, int(starts[i + 1])):
            value -= K[k] * x[int(columns[k])]
        x[i] = value * K[middle]
    for i in range(n):
        value = x[int(places[i])]
        r[n + i] = g * value - r[i]
        r[i] = value
    for i in range(2 * n, p.size):
        r[i] = x[int(places[p.unknowns - p.size + i])]


def sparse_pair(
    p: Parameters,
    alpha: float,
    beta: float,
    J: Floats,
    K: Floats,
    real: Floats,
    imaginary: Floats,
    x: Floats,
) -> None:
    """Replace real + i imaginary by the solution for g = alpha + i beta. x : (2 N,)."""
    n, rows, parts, places = p.n, p.newton_rows, p.newton_parts, p.newton_places
    for i in range(2 * p.unknowns):
        x[i] = 0.0
    for e in range(p.still, p.damped):
        j = int(parts[e])
        add(at(x, 2 * int(rows[e])), J[e], real[j], imaginary[j])
    for e in range(p.damped, p.entries):
        j = int(parts[e])
        a = alpha * real[j] - beta * imaginary[j] + real[n + j]
        b = alpha * imaginary[j] + beta * real[j] + imaginary[n + j]
        add(at(x, 2 * int(rows[e])), J[e], a, b)
    starts, diagonals, columns = p.newton_starts, p.newton_diagonals, p.newton_columns
    for i in range(p.unknowns):
        own = at(x, 2 * i)
        for k in range(int(starts[i]), int(diagonals[i])):
            other = at(x, 2 * int(columns[k]))
            subtract(own, other[0], other[1], at(K, 2 * k))
    for back in range(p.unknowns):
        i = p.unknowns - 1 - back
        own = at(x, 2 * i)
        middle = int(diagonals[i])
        for k in range(middle + 1, int(starts[i + 1])):
            other = at(x, 2 * int(columns[k]))
            subtract(own, other[0], other[1], at(K, 2 * k))
        multiply(at(K, 2 * middle), own)
    for i in range(n):
        found = at(x, 2 * int(places[i]))
        a = alpha * found[0] - beta * found[1] - real[i]
        b = alpha * found[1] + beta * found[0] - imaginary[i]
        real[i] = found[0]
        imaginary[i] = found[1]
        real[n + i] = a
        imaginary[n + i] = b
    for i in range(2 * n, p.size):
        found = at(x, 2 * int(places[p.unknowns - p.size + i]))
        real[i] = found[0]
        imaginary[i] = found[1]


# --- the linear systems of an implicit method for q' = v, v' = a(t, q, v) -------------
# With J = da/d(q, v), (g - [0 1; Jq Jv]) (x, w) = (r, s) becomes n equations,
# (g^2 - g Jv - Jq) x = s + (g - Jv) r, and w = g x - r. A complex g = alpha + i beta
# makes it 2 n real ones. Works are quadratures: their rows come last.


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
