"""Simplified Newton iterations: convergence test and linear solvers.

For methods with a fixed step, which have no tolerance and iterate to rounding.
"""

from __future__ import annotations

from lagsim.language.arrays import Floats
from lagsim.methods import Structure
from lagsim.methods.parts.parameters import Blocks, Parameters
from lagsim.native.kernels.words import Static, total, unrolled
from lagsim.native.layout import array
from lagsim.tolerances import LEAST_PIVOT, OVERFLOW, STALLED_STEP, UNIT_ROUNDOFF

# Contraction rate above which the derivatives are evaluated again.
SLOW = 0.05
MOST = 30

GO_ON = 0
RENEW = 1
SOLVED = 2
LOST = 3


def progress(iteration: int, change: float, previous: float) -> int:
    """Return the state of an iteration: GO_ON, RENEW, SOLVED or LOST.

    iteration : its number, from 0.
    change, previous : relative sizes of the last change and of the one before.
    """
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
    return RENEW if rate > SLOW else GO_ON


def zero_nonfinite(count: int, slopes: Floats) -> None:
    """Set elements of slopes (count,) that are not finite to 0, for Newton's method.

    The force |v| v has the slope 0 at v = 0, but its derivative written with a root is
    0/0 there. If such a slope is not 0, the iteration with short steps leads to a state
    at which the slope is finite.
    """
    for k in range(count):
        if not abs(slopes[k]) < OVERFLOW:
            slopes[k] = 0.0


# --- numbers of `width` doubles: real ones, or complex ones ---------------------------


def add(width: Static, factor: float, z: Floats, out: Floats) -> None:
    """Add a real factor times the number z (width,) to the number `out`."""
    for k in unrolled(width):
        out[k] += factor * z[k]


def take(width: Static, z: Floats, out: Floats) -> None:
    """Copy the number z, real (width 1) or complex (width 2), to `out`."""
    for k in unrolled(width):
        out[k] = z[k]


def magnitude(width: Static, z: Floats) -> float:
    """Return |z|, or for a complex number z (width 2) the sum of |Re z| and |Im z|."""
    return total(abs(z[k]) for k in unrolled(width))


def add_product(width: Static, sign: float, y: Floats, z: Floats, out: Floats) -> None:
    """Add sign * y z to the number `out`, which is stored apart from y and z.

    width : number of doubles of a number, 1 (real) or 2 (complex).
    """
    if width == 1:
        out[0] += sign * (y[0] * z[0])
    else:
        out[0] += sign * (y[0] * z[0] - y[1] * z[1])
        out[1] += sign * (y[0] * z[1] + y[1] * z[0])


def multiply(width: Static, z: Floats, out: Floats) -> None:
    """Multiply the number `out` by z, both real (width 1) or complex (width 2)."""
    real = out[0]
    out[0] *= z[0]
    if width == 2:
        out[0] -= out[1] * z[1]
        out[1] = real * z[1] + out[1] * z[0]


def divide(width: Static, z: Floats, out: Floats) -> None:
    """Divide the number `out` by z without overflow (R. L. Smith, CACM 5, 1962)."""
    if width == 1:
        out[0] /= z[0]
    elif abs(z[0]) >= abs(z[1]):
        ratio = z[1] / z[0]
        below = z[0] + ratio * z[1]
        real = (out[0] + ratio * out[1]) / below
        out[1] = (out[1] - ratio * out[0]) / below
        out[0] = real
    else:
        ratio = z[0] / z[1]
        below = z[1] + ratio * z[0]
        real = (ratio * out[0] + out[1]) / below
        out[1] = (ratio * out[1] - out[0]) / below
        out[0] = real


# --- dense L U with row interchanges --------------------------------------------------
# Source: G. H. Golub and C. F. Van Loan, Matrix Computations, 4th ed., section 3.4.

# Number of unknowns above which dense matrices in each step are too expensive.
LARGEST = 300


def too_large(scene: Structure) -> str:
    """Return the reason why a model has too many unknowns for dense matrices, or "".

    scene : the structure of the model.
    """
    if scene.unknowns <= LARGEST:
        return ""
    return (
        f"it has {scene.unknowns} coordinates and constraints, and the matrices of "
        f"this method are dense, for up to {LARGEST} (`dop853` handles large "
        "models)"
    )


def decompose(width: Static, n: int, band: int, A: Floats, pivots: Floats) -> int:
    """Factor A (n, n), of numbers of `width` doubles, in place.

    Return 0 if A is singular or not finite, else 1. Each pivot is the largest relative
    to its row, so that units of rows do not matter.

    band : A_ij = 0 where |i - j| > band.
    pivots : (n,), on return the rows exchanged.
    """
    row = width * n
    for i in range(n):
        pivots[i] = 0.0
        for j in range(max(0, i - band), min(n, i + band + 1)):
            pivots[i] = max(pivots[i], magnitude(width, A[i * row + width * j :]))
        if not 0.0 < pivots[i] < OVERFLOW:
            return 0
    for k in range(n):
        best = largest_in_column(width, n, k, min(n, k + band + 1), A, pivots)
        if magnitude(width, A[best * row + width * k :]) == 0.0:
            return 0
        if best != k:
            for j in range(width * k, width * min(n, k + 2 * band + 1)):
                A[k * row + j], A[best * row + j] = A[best * row + j], A[k * row + j]
        pivots[best] = pivots[k]
        pivots[k] = best
        eliminate(width, n, k, band, A)
    return 1


def eliminate(width: Static, n: int, k: int, band: int, A: Floats) -> None:
    """Subtract multiples of row k of A (n, n) from the rows below.

    The multipliers are stored in column k. Interchanges double the `band` above the
    diagonal.

    width : number of doubles of an entry, 1 or 2.
    """
    row = A[k * width * n :]
    for i in range(k + 1, min(n, k + band + 1)):
        below = A[i * width * n :]
        first = below[width * k :]
        if magnitude(width, first) != 0.0:
            divide(width, row[width * k :], first)
            for j in range(k + 1, min(n, k + 2 * band + 1)):
                add_product(width, -1.0, first, row[width * j :], below[width * j :])


def largest_in_column(
    width: Static, n: int, k: int, end: int, A: Floats, sizes: Floats
) -> int:
    """Return the row i, k <= i < end, with the relatively largest entry in column k.

    A : (n, n).
    sizes : (n,), the largest entry of each row, to which entries are relative.
    width : number of doubles of an entry, 1 or 2.
    """
    best = k
    largest = 0.0
    for i in range(k, end):
        part = magnitude(width, A[width * (i * n + k) :]) / sizes[i]
        if part > largest:
            largest = part
            best = i
    return best


def solve(
    width: Static, n: int, band: int, A: Floats, pivots: Floats, x: Floats
) -> None:
    """Replace x (n,) by A^-1 x, with the factors A and the pivots of `decompose`.

    band : see `decompose`.
    width : number of doubles of an entry, 1 or 2.
    """
    for k in range(n):
        best = int(pivots[k])
        for c in unrolled(width):
            i = width * k + c
            j = width * best + c
            x[i], x[j] = x[j], x[i]
        for i in range(k + 1, min(n, k + band + 1)):
            first = A[width * (i * n + k) :]
            add_product(width, -1.0, first, x[width * k :], x[width * i :])
    for back in range(n):
        i = n - 1 - back
        row = A[i * width * n :]
        for j in range(i + 1, min(n, i + 2 * band + 1)):
            add_product(width, -1.0, row[width * j :], x[width * j :], x[width * i :])
        divide(width, row[width * i :], x[width * i :])


# --- the linear systems of an implicit method for q' = v, v' = a(t, q, v) -------------
# (g - [0 1; Jq Jv]) (x, w) = (r, s), with J = da/d(q, v), becomes n equations,
# (g^2 - g Jv - Jq) x = s + (g - Jv) r, and w = g x - r. The argument `g` holds g and
# its square. First-order states have rows, and columns, of their own after these: g on
# the diagonal and no g x - r. Works are quadratures: their rows come last.


def square(width: Static, g: Floats) -> None:
    """Write g^2 into the elements that follow the number g in memory."""
    take(width, g, g[width:])
    multiply(width, g, g[width:])


def combine(width: Static, n: int, g: Floats, r: Floats, out: Floats) -> None:
    """Write s + g r (n,) to `out`, the part without Jv of s + (g - Jv) r.

    The latter is the right side of the Newton system after the elimination of
    velocities. In memory r (n,), the right side for positions, is followed by s (n,),
    that for velocities.

    g : a number of `width` doubles, as are the elements of the vectors.
    """
    for i in range(n):
        own = out[width * i :]
        take(width, r[width * (n + i) :], own)
        add_product(width, 1.0, g, r[width * i :], own)


def conclude(width: Static, n: int, i: int, g: Floats, x: Floats, r: Floats) -> None:
    """Replace r_i and s_i by the solutions for a position and its velocity.

    The solutions are x_i, and w_i = g x_i - r_i. In memory r (n,), the right side for
    positions, is followed by s (n,), the right side for velocities.

    g : a number of `width` doubles.
    x : the number x_i, of `width` doubles.
    """
    other = r[width * (n + i) :]
    for k in unrolled(width):
        other[k] = -r[width * i + k]
    add_product(width, 1.0, g, x, other)
    take(width, x, r[width * i :])


def decompose_newton(
    width: Static, s: Blocks, g: Floats, J: Floats, K: Floats, pivots: Floats
) -> int:
    """Factor the Newton matrix g^2 - g Jv - Jq into K; return 0 if singular, else 1.

    K : (n + states, n + states).
    g : the number and its square.
    J : derivatives of the accelerations and rates.
    pivots : see `decompose`.
    width : number of doubles of a number, 1 (real) or 2 (complex).
    """
    n = s.n
    unknowns = n + s.states
    K[: width * unknowns * unknowns] = 0.0
    for i in range(unknowns):
        by_positions = J[i * s.dynamic.stop :]
        by_velocities = by_positions[s.velocities]
        by_states = by_positions[s.first_order]
        for j in range(n):
            own = K[width * (i * unknowns + j) :]
            own[0] = -by_positions[j]
            add(width, -by_velocities[j], g, own)
        for j in range(s.states):
            K[width * (i * unknowns + n + j)] = -by_states[j]
        diagonal = K[width * (i * unknowns + i) :]
        if i < n:
            add(width, 1.0, g[width:], diagonal)
        else:
            add(width, 1.0, g, diagonal)
    return decompose(width, unknowns, unknowns, K, pivots)


def solve_newton(
    width: Static, s: Blocks,
    g: Floats, J: Floats, K: Floats, pivots: Floats, r: Floats, x: Floats,
) -> None:  # fmt: skip
    """Solve the Newton system for the right side r (size,), in place.

    g, J, K, pivots : see `decompose_newton`.
    x : (n + states,), working memory.
    width : number of doubles of a number, 1 (real) or 2 (complex).
    """
    n = s.n
    combine(width, n, g, r, x)
    for i in range(n, n + s.states):
        take(width, r[width * (n + i) :], x[width * i :])
    for i in range(n + s.states):
        own = x[width * i :]
        row = J[i * s.dynamic.stop :]
        for j in range(n):
            add(width, -row[n + j], r[width * j :], own)
    solve(width, n + s.states, n + s.states, K, pivots, x)
    for i in range(n, n + s.states):
        take(width, x[width * i :], r[width * (n + i) :])
    for i in range(n):
        conclude(width, n, i, g, x[width * i :], r)
    for k in range(s.quadratures.start, s.size):
        row = J[(k - n) * s.dynamic.stop :]
        for j in range(s.dynamic.stop):
            add(width, row[j], r[width * j :], r[width * k :])
        divide(width, g, r[width * k :])


# --- the same with a sparse matrix in a fixed order -----------------------------------
# `mechanics/linearisation.py` defines the matrix, C0 + g C1 + g^2 C2, and an order in
# which rows need no exchange if the matrix is far from singular, as for small steps. A
# pivot within the rounding of its subtrahends counts as 0: a shorter step has larger
# pivots.
#
# Source: T. A. Davis, Direct Methods for Sparse Linear Systems (2006), chapter 6.


class SparseNewton(Parameters):
    """Pattern of a sparse Newton matrix, written by `mechanics/linearisation.py`."""

    # Numbers of rows, of entries of the factors, and of entries of C0, of C0 and C1, of
    # C0, C1 and C2.
    unknowns: int
    filled: int
    still: int
    damped: int
    entries: int

    # For each entry: its place among the entries of the factors, its row there, and the
    # component of y that its column denotes.
    newton_slots: Floats = array("entries")
    newton_rows: Floats = array("entries")
    newton_parts: Floats = array("entries")
    # The position of each unknown in the order of elimination; the first entry of each
    # row, its diagonal entry, and the column of each entry of the factors.
    newton_places: Floats = array("unknowns")
    newton_starts: Floats = array(lambda p: p.unknowns + 1)
    newton_diagonals: Floats = array("unknowns")
    newton_columns: Floats = array("filled")


def assemble(width: Static, p: SparseNewton, g: Floats, J: Floats, K: Floats) -> None:
    """Write C0 + g C1 + g^2 C2 to the slots of the factors K.

    g : the number and its square.
    J : the entries of C0, C1 and C2, one after the other.
    width : number of doubles of a number, 1 (real) or 2 (complex).
    """
    slots = p.newton_slots
    K[: width * p.filled] = 0.0
    for e in range(p.still):
        K[width * int(slots[e])] += J[e]
    for e in range(p.still, p.damped):
        add(width, J[e], g, K[width * int(slots[e]) :])
    for e in range(p.damped, p.entries):
        add(width, J[e], g[width:], K[width * int(slots[e]) :])


def decompose_sparse(
    width: Static, p: SparseNewton, g: Floats, J: Floats, K: Floats, x: Floats
) -> int:
    """Factor C0 + g C1 + g^2 C2 into K; return 0 if a pivot vanishes, else 1.

    K contains the inverses of the pivots.

    g, J : see `assemble`.
    x : (N,), working memory.
    width : number of doubles of a number, 1 (real) or 2 (complex).
    """
    assemble(width, p, g, J, K)
    starts, columns = p.newton_starts, p.newton_columns
    for i in range(p.unknowns):
        first = int(starts[i])
        middle = int(p.newton_diagonals[i])
        end = int(starts[i + 1])
        own = x[width * i :]
        for k in range(first, end):
            take(width, K[width * k :], x[width * int(columns[k]) :])
        largest = magnitude(width, own)
        for k in range(first, middle):
            above = int(columns[k])
            diagonal = int(p.newton_diagonals[above])
            part = x[width * above :]
            multiply(width, K[width * diagonal :], part)
            real = own[0]
            imaginary = own[width - 1]
            for j in range(diagonal + 1, int(starts[above + 1])):
                other = x[width * int(columns[j]) :]
                add_product(width, -1.0, part, K[width * j :], other)
            change = abs(real - own[0])
            if width == 2:
                change += abs(imaginary - own[1])
            largest = max(largest, change)
        size = magnitude(width, own)
        if not LEAST_PIVOT * largest < size < OVERFLOW:
            return 0
        for k in range(first, end):
            take(width, x[width * int(columns[k]) :], K[width * k :])
        pivot = K[width * middle :]
        for k in unrolled(width):
            pivot[k] = 1.0 - k
        divide(width, own, pivot)
    return 1


def solve_sparse(
    width: Static, p: SparseNewton,
    g: Floats, J: Floats, K: Floats, r: Floats, x: Floats,
) -> None:  # fmt: skip
    """Solve the sparse Newton system for the right side r (size,), in place.

    g, J : see `assemble`.
    K : the factors of `decompose_sparse`.
    x : (N + n,), working memory.
    width : number of doubles of a number, 1 (real) or 2 (complex).
    """
    n = p.n
    combined = x[width * p.unknowns :]
    combine(width, n, g, r, combined)
    x[: width * p.unknowns] = 0.0
    for e in range(p.still, p.damped):
        add(
            width,
            J[e],
            r[width * int(p.newton_parts[e]) :],
            x[width * int(p.newton_rows[e]) :],
        )
    for e in range(p.damped, p.entries):
        add(
            width,
            J[e],
            combined[width * int(p.newton_parts[e]) :],
            x[width * int(p.newton_rows[e]) :],
        )
    for i in range(p.unknowns):
        for k in range(int(p.newton_starts[i]), int(p.newton_diagonals[i])):
            other = x[width * int(p.newton_columns[k]) :]
            add_product(width, -1.0, K[width * k :], other, x[width * i :])
    for back in range(p.unknowns):
        i = p.unknowns - 1 - back
        middle = int(p.newton_diagonals[i])
        for k in range(middle + 1, int(p.newton_starts[i + 1])):
            other = x[width * int(p.newton_columns[k]) :]
            add_product(width, -1.0, K[width * k :], other, x[width * i :])
        multiply(width, K[width * middle :], x[width * i :])
    for i in range(n):
        conclude(width, n, i, g, x[width * int(p.newton_places[i]) :], r)
    for i in range(p.quadratures.start, p.size):
        take(
            width,
            x[width * int(p.newton_places[p.unknowns - p.size + i]) :],
            r[width * i :],
        )
