"""Kernels that hold every construct of the subset, for the tests to run twice."""

from __future__ import annotations

import math
from math import copysign, exp, floor, inf, log, sqrt
from typing import TYPE_CHECKING

from lagsim.native.kernels.words import apart, at, external, total, unrolled

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

CONSTRAINED = True
COUNT = 3
SCALE = 0.25
WEIGHTS = ((0.0, 2.0, -0.5), (1.5, 0.0, 0.0), (0.0, 0.0, 0.0))


def divide(a: int, b: int) -> int:
    return a // b


def remainder(a: int, b: int) -> int:
    return a % b


def true_quotient(a: int, b: int) -> float:
    return a / b


def mixed(a: float, b: int) -> float:
    return -(a + b) * 3 - b / (a * a + 1) + a


def power(a: float, b: float) -> float:
    return a**b


def squares(a: float, b: float) -> float:
    return a**2 - b**3 + pow_half(a * a)


def pow_half(a: float) -> float:
    return a**0.5


def multiply_add(a: float, b: float) -> float:
    return a * b + 0.1 - a * 0.3 - b * 0.7


def extrema(a: float, b: float) -> float:
    return max(a, b, 0.5) * 2.0 + copysign(1.0, min(b, a))


def extrema_integers(a: int, b: int) -> int:
    return max(a, b) - 3 * min(a, b, 5) + abs(a)


def comparisons(a: float, b: float) -> int:
    code = 0
    if a < b:
        code += 1
    if a <= b:
        code += 2
    if a > b:
        code += 4
    if a >= b:
        code += 8
    if a == b:
        code += 16
    if a != b:
        code += 32
    if not a < b:
        code += 64
    if -1.0 <= a < b <= 3:
        code += 128
    return code


def logic(a: float, b: float) -> bool:
    return (a > 0.0 and b > 0.0) or (not a < -5.0 and b != b) or a == b


def choice(a: float, b: float) -> float:
    return (a if a > b else 2.0) + (1 if abs(b) < inf and b > 0.0 else 0)


def functions(a: float, b: float) -> float:
    x = abs(a) + 0.1
    return (
        sqrt(x)
        + math.sin(a) * math.cos(b)
        + exp(-x)
        - log(x)
        + math.atan2(a, b)
        + math.tanh(a)
        + math.pow(x, 0.3)
        + math.fabs(b)
    )


def conversions(a: float, b: float) -> int:
    return int(a) + 10 * floor(b) + int(float(int(a)) / 3)


def swap(a: float, b: float) -> float:
    c = 0.0
    a, b, c = b, a + b, a
    return a * 100 + b * 10 + c


def widened(a: int, b: int) -> float:
    x = 0.5
    x = a
    y = float(b)
    y /= 4
    return x / 8 + y


def early(a: int, b: int) -> int:
    if a > b:
        return 1
    if a == b:
        pass
    elif a == 0:
        return 3
    else:
        return 4
    return 2


def search(a: int, b: int) -> int:
    found = -1
    steps = 0
    for i in range(-5, 20):
        if i % 3 == b % 3:
            continue
        for j in range(10, 0, -2):
            steps += 1
            if j == i:
                continue
            if i * j > abs(a):
                found = i * 100 + j
                break
        if found >= 0:
            break
    return found * 1000 + steps


def last_of_loop(a: int, b: int) -> int:
    i = -9
    seen = 0
    for i in range(a, b, 3):
        seen += i
        i = i + 100  # noqa: PLW2901
    return seen * 1000 + i


def endless(a: int, b: int) -> int:
    n = 0
    while True:
        a, b = b, a - b
        n += 1
        if n > 20 or abs(a) > 1000000:
            result = n
            break
    while n > 3 and n < 15:
        n -= 2
    return result * 100 + n


def static_branch(a: float, b: float) -> float:
    x = a * SCALE
    if CONSTRAINED and COUNT > 2:
        x += b
    elif COUNT == 2:
        x -= b
    else:
        x = not_translated(x)
    return x if CONSTRAINED or a > 0.0 else -x


def not_translated(x: float) -> float:
    return [x][0]


def unrolled_loop(a: float, b: float) -> float:
    x = 0.0
    for s in unrolled(COUNT):
        if s == 1 and a > 0.0:
            continue
        if b > 2.0:
            break
        for j in unrolled(s, -1, -1):
            x += WEIGHTS[s][j] * a + s * b
    return x


def first_above(a: float, b: float) -> int:
    for s in unrolled(COUNT):
        if a < s:
            found = s
            break
        if b < s:
            return -s
    else_ = 10
    for s in unrolled(2):
        while True:
            else_ += s
            if else_ > 10 or s == 0:
                break
        if s == 1:
            return else_
    for _ in unrolled(1):
        found = 0
    return found


def fill(n: int, y: Floats, out: Floats) -> None:
    """Each of the constructs on arrays; out : (3 n,)."""
    tail = at(out, n)
    last = at(tail, n)
    for i in range(n):
        out[i], tail[i] = y[i], -y[n - 1 - i]
        last[i] = i
        last[i] += y[i] * COUNT
        out[i] *= 3
    if n == 0:
        return
    tail, last = last, tail
    tail[0], last[n - 1] = last[n - 1], tail[0]


def sums(n: int, y: Floats, out: Floats) -> None:
    for i in range(n - 2):
        for s in unrolled(3):
            out[3 * i + s] = y[i] + 0.5 * total(
                WEIGHTS[s][j] * y[i + j] for j in unrolled(3)
            )


def side_by_side(n: int, y: Floats, out: Floats) -> None:
    """Passes apart, with a branch and a variable; n may be no multiple of anything."""
    middle = at(out, n)
    for i in apart(n):
        slope = total(WEIGHTS[0][j] * y[i] for j in unrolled(3))
        middle[i] = slope + 0.1 * y[n - 1 - i]
        out[i] = max(0.3 * y[i], middle[i]) / 7.0
        middle[i] += i


@external
def rate(t: float, y: Floats, out: Floats) -> None:
    """Give the rate of change (2,)."""


@external
def scale_of(i: int, yes: bool) -> float:
    """Give something of each kind."""
    raise NotImplementedError


def euler(n: int, y: Floats, out: Floats) -> None:
    h = 0.125
    for step in range(n):
        rate(step * h, y, out)
        advance(h, y, out)
    y[0] *= scale_of(n, n > 3)


def advance(h: float, y: Floats, slope: Floats) -> None:
    for i in range(2):
        y[i] += h * slope[i]


def factorial(a: int, b: int) -> int:
    return 1 if a <= 1 else a * factorial(min(a, 15) - 1, b) % 1000003


def conjunction(a: bool, b: bool) -> bool:
    return a and not b


FLOAT_KERNELS = [
    multiply_add,
    extrema,
    comparisons,
    logic,
    choice,
    swap,
    static_branch,
    unrolled_loop,
    first_above,
]
FINITE_KERNELS = [functions, conversions, squares, power]
INTEGER_KERNELS = [
    divide,
    remainder,
    true_quotient,
    mixed,
    extrema_integers,
    widened,
    early,
    search,
    last_of_loop,
    endless,
    factorial,
]
ARRAY_KERNELS = [fill, sums, side_by_side]
