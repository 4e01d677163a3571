"""A quotient by its own size is a sign: u/abs(u), abs(u)/u, u/sqrt(u^2), u/abs(u)^q.

That is how many write the direction of a velocity. At rest it would be 0/0, and no
switch would be seen in it. Where 0 < q < 1, sign(u) |u|^(1 - q) is meant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lagsim.language.builder import Builder

# Factors are looked for so far down: shared products would be walked through again and
# again.
DEEP = 5


def direction(g: Builder, x: int, y: int) -> int | None:
    """Give x/y where y is a size of a factor of x, or x of y, else None."""
    if g.ops[x] == "abs" and y in _either(g, g.args[x][0]):
        return g.call("sign", y)
    part, size, q = _size_in(g, y)
    if size is None:
        return None
    for u in _either(g, size):
        rest = without(g, x, u)
        if rest is not None:
            found = g.call("mul", rest, _signed(g, u, q))
            return found if part == g.one else g.call("div", found, part)
    return None


def directed_product(g: Builder, x: int, y: int) -> int | None:
    """Give x y where one of them divides by a size of a factor of the other."""
    for a, b in ((x, y), (y, x)):
        op, args = g.ops[b], g.args[b]
        if op == "div":
            found = direction(g, a, args[1])
            if found is not None:
                return g.call("mul", found, args[0])
        elif op == "pow" and -1.0 <= (g.value(args[1]) or 0.0) < 0.0:
            inverse = g.call("neg", args[1])
            found = direction(g, a, g.call("pow", args[0], inverse))
            if found is not None:
                return found
    return None


def _either(g: Builder, u: int) -> tuple[int, int]:
    return u, g.call("neg", u)


def _signed(g: Builder, u: int, q: float) -> int:
    """Give u/|u|^q."""
    sign = g.call("sign", u)
    if q == 1.0:
        return sign
    power = g.call("pow", g.call("abs", u), g.constant(1.0 - q))
    return g.call("mul", sign, power)


def _size_in(g: Builder, y: int, depth: int = DEEP) -> tuple[int, int | None, float]:
    """Give what else is a factor of y, u, and q where |u|^q is one."""
    op, args = g.ops[y], g.args[y]
    if op == "mul" and depth:
        for other, a in (args, args[::-1]):
            part, u, q = _size_in(g, a, depth - 1)
            if u is not None:
                return g.call("mul", other, part), u, q
    elif op == "abs":
        return g.one, args[0], 1.0
    elif op in ("sqrt", "pow"):
        q = 0.5 if op == "sqrt" else g.value(args[1]) or 0.0
        inner = args[0]
        if g.ops[inner] == "pow" and g.value(g.args[inner][1]) == 2.0:
            inner, q = g.args[inner][0], 2.0 * q
        elif g.ops[inner] == "abs":
            inner = g.args[inner][0]
        else:
            q = 0.0
        if 0.0 < q <= 1.0:
            return g.one, inner, q
    return g.one, None, 0.0


def without(g: Builder, x: int, u: int, depth: int = DEEP) -> int | None:
    """Give x/u where u is seen to be a factor of x."""
    if x == u:
        return g.one
    op, args = g.ops[x], g.args[x]
    if not depth:
        return None
    if op == "mul":
        for a, other in (args, args[::-1]):
            rest = without(g, a, u, depth - 1)
            if rest is not None:
                return g.call("mul", rest, other)
    elif op in ("div", "neg"):
        rest = without(g, args[0], u, depth - 1)
        if rest is not None:
            return g.call(op, rest, *args[1:])
    return None
