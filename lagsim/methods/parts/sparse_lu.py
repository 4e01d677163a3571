"""A = L U of few entries, in a fixed order, for the Newton iterations of Radau IIA.

`lagsim.solve.newton` says what is solved, and in which order, so that rows need no
exchange where the matrix is far from singular, as it is at small steps. A pivot that
is nothing but the rounding of what it was left of is as good as none: a shorter step
has larger ones.

Source: T. A. Davis, Direct Methods for Sparse Linear Systems (2006), chapter 6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts.parameters import Parameters
from lagsim.native.kernels.words import at

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

# The part of its terms that a pivot must be: three digits are right then, which is
# enough for iterations.
LEFT_OVER = 1e-13


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
    starts = p.newton_starts
    diagonals = p.newton_diagonals
    columns = p.newton_columns
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
        if not LEFT_OVER * largest < abs(x[i]) < 1e300:
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
    starts = p.newton_starts
    diagonals = p.newton_diagonals
    columns = p.newton_columns
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
        if not LEFT_OVER * largest < abs(own[0]) + abs(own[1]) < 1e300:
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
    n = p.n
    rows = p.newton_rows
    parts = p.newton_parts
    places = p.newton_places
    for i in range(p.unknowns):
        x[i] = 0.0
    for e in range(p.still, p.damped):
        x[int(rows[e])] += J[e] * r[int(parts[e])]
    for e in range(p.damped, p.entries):
        j = int(parts[e])
        x[int(rows[e])] += J[e] * (g * r[j] + r[n + j])
    starts = p.newton_starts
    diagonals = p.newton_diagonals
    columns = p.newton_columns
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
    n = p.n
    rows = p.newton_rows
    parts = p.newton_parts
    places = p.newton_places
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
    starts = p.newton_starts
    diagonals = p.newton_diagonals
    columns = p.newton_columns
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
