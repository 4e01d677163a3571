"""What operations become that are simpler written otherwise; None: nothing."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

from lagsim.language import sizes

if TYPE_CHECKING:
    from lagsim.language.builder import Builder


def add(g: Builder, x: int, y: int) -> int | None:
    """Simplify x + y."""
    if x == g.zero:
        return y
    if y == g.zero:
        return x
    if g.ops[y] == "neg":
        return g.call("sub", x, g.args[y][0])
    if g.ops[x] == "neg":
        return g.call("sub", y, g.args[x][0])
    return None


def sub(g: Builder, x: int, y: int) -> int | None:
    """Simplify x - y."""
    if y == g.zero:
        return x
    if x == g.zero:
        return g.call("neg", y)
    if x == y:
        return g.zero
    if g.ops[y] == "neg":
        return g.call("add", x, g.args[y][0])
    return None


def mul(g: Builder, x: int, y: int) -> int | None:
    """Simplify x*y."""
    if g.value(x) is None:
        x, y = y, x
    c = g.value(x)
    if c is not None:
        return _scaled(g, c, x, y)
    if g.ops[x] == "neg":
        return g.call("neg", g.call("mul", g.args[x][0], y))
    if g.ops[y] == "neg":
        return g.call("neg", g.call("mul", x, g.args[y][0]))
    found = sizes.directed_product(g, x, y)
    return sizes.rooted_product(g, x, y) if found is None else found


def _scaled(g: Builder, c: float, x: int, y: int) -> int | None:
    """Simplify c * y, where `x` is the node of c."""
    if c == 0.0:
        return g.zero
    if c == 1.0:
        return y
    if c == -1.0:
        return g.call("neg", y)
    if g.ops[y] == "neg":
        return g.call("mul", g.constant(-c), g.args[y][0])
    if g.ops[y] == "mul":
        inner = g.value(g.args[y][0])
        if inner is not None and is_normal(c * inner):
            return g.call("mul", g.constant(c * inner), g.args[y][1])
    if g.value(y) is None and y < x:
        return g.kept("mul", (x, y))  # the constant comes first
    return None


def is_normal(x: float) -> bool:
    """Tell whether `x` has all its digits, neither overflown nor underflown."""
    return sys.float_info.min <= abs(x) <= sys.float_info.max


def div(g: Builder, x: int, y: int) -> int | None:
    """Simplify x/y."""
    if x == g.zero and y != g.zero:
        return g.zero
    if x == y and x != g.zero:
        return g.one
    signed = sizes.direction(g, x, y)
    if signed is not None:
        return signed
    if g.ops[x] == "neg":
        return g.call("neg", g.call("div", g.args[x][0], y))
    if g.ops[y] == "neg":
        return g.call("neg", g.call("div", x, g.args[y][0]))
    c = g.value(y)
    if c is not None and c != 0.0 and math.frexp(c)[0] in (0.5, -0.5):
        reciprocal = 1.0 / c
        if math.isfinite(reciprocal):  # exact for a power of two
            return g.call("mul", g.constant(reciprocal), x)
    return None


def neg(g: Builder, x: int) -> int | None:
    """Simplify -x."""
    if g.ops[x] == "neg":
        return g.args[x][0]
    if g.ops[x] == "sub":
        return g.call("sub", g.args[x][1], g.args[x][0])
    if g.ops[x] == "mul":
        c = g.value(g.args[x][0])
        if c is not None:
            return g.call("mul", g.constant(-c), g.args[x][1])
    return None


def power(g: Builder, x: int, y: int) -> int | None:
    """Simplify x^y."""
    exponent = g.value(y)
    if exponent == 0.0 or x == g.one:
        return g.one
    if exponent == 1.0:
        return x
    if exponent == 0.5:
        return g.call("sqrt", x)
    if exponent is not None and exponent % 2 == 0 and g.ops[x] == "neg":
        return g.call("pow", g.args[x][0], y)
    return None if exponent is None else sizes.raised(g, x, exponent)


def choice(g: Builder, condition: int, x: int, y: int) -> int | None:
    """Simplify if(condition, x, y)."""
    if g.ops[condition] == "truth":
        return x if g.payload(condition) else y
    return x if x == y else None


def extreme(_: Builder, x: int, y: int) -> int | None:
    """Simplify min(x, y) or max(x, y)."""
    return x if x == y else None
