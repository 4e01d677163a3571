"""Symmetric compositions of Verlet steps, and rows within them.

Dense output of order 6: the quintic through q, q', q'' at both ends of the step is good
enough to evaluate the acceleration at four points between; the polynomials that have
those too are right to two orders more (W. H. Enright, K. R. Jackson, S. P. Norsett and
P. G. Thomsen, Interpolants for Runge-Kutta formulas, ACM Trans. Math. Softw. 12 (1986)
193-218: bootstrapping). In w = x (1 - x) and c = x - 1/2,

    q(x) = quintic(x) + w^3 (r0 + r1 c + r2 c^2 + r3 c^3),
    q'(x), work(x) = cubic(x) + w^2 (r0 + r1 c + r2 c^2 + r3 c^3)

with r from what is left over at the four points, of the accelerations and the power.
(The derivative of q(x) would divide the error of the step by its length.) It is made
where a row needs it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.methods.parts import symplectic
from lagsim.methods.parts.fixed import hermite
from lagsim.methods.parts.interface import derivative, power
from lagsim.methods.parts.state import (
    EVALUATIONS,
    HEADER,
    ROW,
    ROW_LIMIT,
    ROW_START,
    ROW_STEP,
    SIZE,
    STEP_H,
    STEP_T,
    N,
    T,
)
from lagsim.native.kernels.words import at, total, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

UNTIL = True

NODES = (0.2, 0.4, 0.6, 0.8)
# r from what is left over at the nodes: the inverse of (w^3 c^m)'' there, and of
# (w^2 c^m)'.
BEND = (
    (-2375 / 2816, -29125 / 12672, -29125 / 12672, -2375 / 2816),
    (321875 / 153216, 334375 / 76608, -334375 / 76608, -321875 / 153216),
    (-15625 / 704, -15625 / 1056, -15625 / 1056, -15625 / 704),
    (1328125 / 38304, -78125 / 6384, 78125 / 6384, -1328125 / 38304),
)
RISE = (
    (1375 / 576, 125 / 288, -125 / 288, -1375 / 576),
    (-2125 / 352, 1125 / 176, 1125 / 176, -2125 / 352),
    (3125 / 144, -3125 / 72, 3125 / 72, -3125 / 144),
    (15625 / 88, 15625 / 132, 15625 / 132, 15625 / 88),
)

# Those of `symplectic`, r (4 size), the quintic (3 size), what is left over (4 size)
# and a state (size).
ARRAYS = symplectic.ARRAYS + 12


def make_dense(s: Floats, p: Floats) -> None:
    """Make the polynomials: the quintic always, r where a row lies within the step."""
    size = int(s[SIZE])
    n = int(s[N])
    r = at(s, HEADER + 12 * size + 6)
    left = at(r, 7 * size)
    for i in range(4 * size):
        r[i] = 0.0
    quintic(s)
    row = s[ROW_START] + s[ROW] * s[ROW_STEP]
    if UNTIL or (row < s[ROW_LIMIT] and row < s[T]):
        look_within(s, p)
        for i in range(n):
            for m in unrolled(4):
                some = total(BEND[m][j] * left[j * size + i] for j in unrolled(4))
                r[m * size + i] = some
        correct(s, n, 2 * n)
        if size > 2 * n:
            look_at_power(s, p)
            correct(s, 2 * n, size)


def quintic(s: Floats) -> None:
    """Find what x^3, x^4, x^5 have in the quintics (3, size) of the positions."""
    size = int(s[SIZE])
    n = int(s[N])
    h = s[STEP_H]
    y = at(s, HEADER)
    old = at(s, HEADER + 6 * size + 6)
    before = at(old, size)
    k = at(before, size)
    c3 = at(s, HEADER + 16 * size + 6)
    c4 = at(c3, size)
    c5 = at(c4, size)
    for i in range(n):
        a0 = h * h * before[n + i]
        rest = y[i] - old[i] - h * old[n + i] - 0.5 * a0
        turn = h * (y[n + i] - old[n + i]) - a0
        change = h * h * k[n + i] - a0
        c3[i] = 10.0 * rest - 4.0 * turn + 0.5 * change
        c4[i] = -15.0 * rest + 7.0 * turn - change
        c5[i] = 6.0 * rest - 3.0 * turn + 0.5 * change


def look_within(s: Floats, p: Floats) -> None:
    """Find what is left over of the accelerations (4, size)."""
    size = int(s[SIZE])
    n = int(s[N])
    h = s[STEP_H]
    before = at(s, HEADER + 7 * size + 6)
    slope = at(s, HEADER + 9 * size + 6)
    c3 = at(s, HEADER + 16 * size + 6)
    c4 = at(c3, size)
    c5 = at(c4, size)
    left = at(c5, size)
    z = at(left, 4 * size)
    for j in unrolled(4):
        x = NODES[j]
        within(s, x, z)
        derivative(s[STEP_T] + x * h, z, p, slope)
        s[EVALUATIONS] += 1.0
        for i in range(n):
            curved = x * (6.0 * c3[i] + x * (12.0 * c4[i] + x * 20.0 * c5[i]))
            left[j * size + i] = h * h * (slope[n + i] - before[n + i]) - curved
            left[j * size + n + i] = h * slope[n + i] - steepness(s, n + i, x)


def look_at_power(s: Floats, p: Floats) -> None:
    """Find what is left over of the power, on the way now known."""
    size = int(s[SIZE])
    h = s[STEP_H]
    i = 2 * int(s[N])
    left = at(s, HEADER + 19 * size + 6)
    z = at(left, 4 * size)
    for j in unrolled(4):
        x = NODES[j]
        within(s, x, z)
        rate = at(left, j * size + i)
        power(s[STEP_T] + x * h, z, p, rate)
        rate[0] = h * rate[0] - steepness(s, i, x)


def correct(s: Floats, first: int, end: int) -> None:
    """Find r of the components from `first` on whose rates were looked at."""
    size = int(s[SIZE])
    r = at(s, HEADER + 12 * size + 6)
    left = at(r, 7 * size)
    for i in range(first, end):
        for m in unrolled(4):
            some = total(RISE[m][j] * left[j * size + i] for j in unrolled(4))
            r[m * size + i] = some


def steepness(s: Floats, i: int, x: float) -> float:
    """Give how steep the cubic of component i is, times the step."""
    size = int(s[SIZE])
    h = s[STEP_H]
    old = at(s, HEADER + 6 * size + 6)
    before = at(old, size)
    k = at(before, size)
    u = 1.0 - x
    change = s[HEADER + i] - old[i]
    first = h * before[i] - change
    last = h * k[i] - change
    return float(change + u * (u - 2.0 * x) * first + x * (x - 2.0 * u) * last)


def within(s: Floats, x: float, out: Floats) -> None:
    """Give y (size,) at the fraction x of the last step."""
    size = int(s[SIZE])
    n = int(s[N])
    h = s[STEP_H]
    old = at(s, HEADER + 6 * size + 6)
    before = at(old, size)
    c3 = at(s, HEADER + 16 * size + 6)
    c4 = at(c3, size)
    c5 = at(c4, size)
    w = x * (1.0 - x)
    hermite(s, x, out)
    for i in range(n):
        straight = x * h * (old[n + i] + 0.5 * x * h * before[n + i])
        far = x * x * x * (c3[i] + x * (c4[i] + x * c5[i]))
        out[i] = old[i] + straight + far + w * w * w * polynomial(s, i, x)
    for i in range(n, size):
        out[i] += w * w * polynomial(s, i, x)


def polynomial(s: Floats, i: int, x: float) -> float:
    """Give r0 + r1 c + r2 c^2 + r3 c^3 of component i, c = x - 1/2."""
    size = int(s[SIZE])
    r = at(s, HEADER + 12 * size + 6)
    c = x - 0.5
    more = r[size + i] + c * (r[2 * size + i] + c * r[3 * size + i])
    return float(r[i] + c * more)
