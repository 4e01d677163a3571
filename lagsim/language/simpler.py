"""Simpler forms of operations; None where there is none.

The functions return nodes; their arguments x, y and u are nodes of the graph g.

A quotient by its own absolute value is a sign: u/abs(u), abs(u)/u, u/sqrt(u^2),
u/abs(u)^q. Many models write the direction of a velocity so. At rest it would be 0/0,
and no switch would be detected. For 0 < q < 1, the form is sign(u) |u|^(1 - q).

A root of a square is an absolute value: sqrt(u^2), sqrt(4*u^2*v^2), (u^2)^0.5, hypot(u,
0), max(u, -u), u*sign(u). Written as `abs`, its corner is a switch.

A power of a root is written without the root: sqrt(e)^2, hypot(x, y)^2, cbrt(x)^3,
abs(x)^2. A root has no slope at 0, where its power has one: the energy of a body at
rest that is written with its speed. An expression is rewritten only where both forms
are equal for all arguments: sqrt(e) has no value below 0, so that sqrt(e)^2 becomes e
only where e is recognised as never negative; elsewhere its slopes are those of e
(`local_slopes`).
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


class Builder(Protocol):
    """Interface of `graph.Graph` for the functions of this module.

    `ops` and `args` have the operation and the arguments of each node; `zero` and `one`
    are the nodes of the numbers 0 and 1.
    """

    ops: list[str]
    args: list[tuple[int, ...]]
    zero: int
    one: int

    def constant(self, x: float) -> int:
        """Return the node of a number."""

    def value(self, node: int) -> float | None:
        """Return the number that a node is, or None."""

    def payload(self, node: int) -> Any:
        """Return the number, the name, the truth value or the array of a leaf."""

    def data(self, numbers: Any) -> int:
        """Return the node of an array."""

    def call(self, op: str, *args: int) -> int:
        """Return the node of an operation, simplified."""

    def cone(self, nodes: Iterable[int]) -> Sequence[int]:
        """Return `nodes` and all nodes below these, arguments first."""

    def unsimplified(self, op: str, args: tuple[int, ...]) -> int:
        """Return the node of an operation, not simplified."""


# Depth of the search for factors: shared products would be searched repeatedly.
DEEP = 5
# The power that cancels each function.
UNDONE = {"sqrt": 2, "hypot": 2, "abs": 2, "cbrt": 3}
# Factors of products that may have another form.
REWRITTEN = frozenset(("mul", "div", "pow", *UNDONE))
_NEVER_NEGATIVE = ("abs", "sqrt", "exp", "cosh", "hypot", "heaviside")
# Mantissas of powers of two, products with which are exact.
HALVES = (0.5, -0.5)
# Largest number of nodes in the search for a sign: sums of squares can be long.
MOST = 200


def direction(g: Builder, x: int, y: int) -> int | None:
    """Return x/y simplified if one contains the absolute value of the other's factor.

    None if there is no such factor.
    """
    if g.ops[x] == "abs" and y in _either(g, g.args[x][0]):
        return g.call("sign", y)
    part, size, q = _size_in(g, y)
    if size is None:
        return None
    for u in _either(g, size):
        rest = _without(g, x, u)
        if rest is not None:
            found = g.call("mul", rest, _signed(g, u, q))
            return found if part == g.one else g.call("div", found, part)
    return None


def directed_product(g: Builder, x: int, y: int) -> int | None:
    """Return x y simplified if one contains u and the other divides by |u|.

    None in other cases.
    """
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
    """Return u/|u|^q."""
    sign = g.call("sign", u)
    if q == 1.0:
        return sign
    power = g.call("pow", g.call("abs", u), g.constant(1.0 - q))
    return g.call("mul", sign, power)


def _size_in(g: Builder, y: int, depth: int = DEEP) -> tuple[int, int | None, float]:
    """Return (f, u, q) with y = f |u|^q; u is None without an absolute value.

    depth : the number of nested products that are searched.
    """
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


def _without(g: Builder, x: int, u: int, depth: int = DEEP) -> int | None:
    """Return x/u if u is recognised as a factor of x, else None.

    depth : the number of nested products that are searched.
    """
    if x == u:
        return g.one
    op, args = g.ops[x], g.args[x]
    if not depth:
        return None
    if op == "mul":
        for a, other in (args, args[::-1]):
            rest = _without(g, a, u, depth - 1)
            if rest is not None:
                return g.call("mul", rest, other)
    elif op in ("div", "neg"):
        rest = _without(g, args[0], u, depth - 1)
        if rest is not None:
            return g.call(op, rest, *args[1:])
    return None


def raised(g: Builder, x: int, exponent: float) -> int | None:
    """Return x^exponent without the root in x; None if x has no such root."""
    op, args = g.ops[x], g.args[x]
    if exponent % 1.0 or exponent < 2.0:
        return None
    if op in ("mul", "div") and any(g.ops[a] in UNDONE for a in args):
        power = g.constant(exponent)
        return g.call(op, *(g.call("pow", a, power) for a in args))
    whole, rest = divmod(exponent, UNDONE.get(op, 1))
    if op not in UNDONE or rest:
        return None
    if op == "sqrt" and not never_negative(g, args[0]):
        return None
    if op == "abs":
        return g.call("pow", args[0], g.constant(exponent))
    base = args[0]
    if op == "hypot":
        base = g.call("add", *(g.call("pow", a, g.constant(2.0)) for a in args))
    return g.call("pow", base, g.constant(whole))


def signed_product(g: Builder, x: int, y: int) -> int | None:
    """Return x y as |c u| if x is sign(u) and y = c u with a number c; else None."""
    for a, b in ((x, y), (y, x)):
        if g.ops[b] != "sign":
            continue
        (c, u), (d, v) = _multiple(g, a), _multiple(g, g.args[b][0])
        if u == v and u != g.one:
            size = g.call("abs", u)
            return g.call("mul", g.constant(math.copysign(c, c * d)), size)
    return None


def joined_product(g: Builder, x: int, y: int) -> int | None:
    """Return (c u)(d v) as (c d)(u v) with numbers c, d and variables u, v; else None.

    The result is exact for powers of two. The force of a spring with the energy k q^2/2
    is then -k q and not (-k/2)(2 q).
    """
    if g.ops[x] != "mul" or g.ops[y] != "mul":
        return None
    (a, u), (b, v) = g.args[x], g.args[y]
    c, d = g.value(a) or 0.0, g.value(b) or 0.0
    if g.ops[u] != "variable" or g.ops[v] != "variable" or not is_normal(c * d):
        return None
    if math.frexp(c)[0] not in HALVES or math.frexp(d)[0] not in HALVES:
        return None
    return g.call("mul", g.constant(c * d), g.call("mul", u, v))


def rooted_product(g: Builder, x: int, y: int) -> int | None:
    """Return x y without the root if y contains the root x as a factor; else None."""
    for a, b in ((x, y), (y, x)):
        if g.ops[b] not in UNDONE:
            continue
        if g.ops[a] == "pow" and g.args[a][0] == b:
            exponent = g.value(g.args[a][1])
            if exponent is not None and exponent >= 1.0:
                return g.call("pow", b, g.constant(exponent + 1.0))
        rest = _without(g, a, b)
        if rest is not None:
            return g.call("mul", rest, g.call("pow", b, g.constant(2.0)))
    return None


def never_negative(g: Builder, node: int) -> bool:
    """Whether a node is recognised to have no value below 0."""
    stack, left = [node], MOST
    while stack:
        n = stack.pop()
        op, args, number = g.ops[n], g.args[n], g.value(n)
        left -= 1
        if not left or (number is not None and number < 0.0):
            return False
        if op in _NEVER_NEGATIVE or number is not None:
            continue
        if op == "mul" and args[0] == args[1]:
            continue
        if op == "pow":
            exponent = g.value(args[1])
            if exponent is None or exponent % 2.0:
                stack.append(args[0])
        elif op in ("add", "mul", "div", "min", "max"):
            stack += args
        elif op in ("if", "smooth.if"):
            stack += args[1:]
        else:
            return False
    return True


def add(g: Builder, x: int, y: int) -> int | None:
    """Return x + y in a simpler form, as a node; None where there is none."""
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
    """Return x - y in a simpler form, as a node; None where there is none."""
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
    """Return x*y in a simpler form, as a node; None where there is none."""
    ops = g.ops
    if ops[x] != "constant":
        x, y = y, x
    one, other = ops[x], ops[y]
    if one == "constant":
        return _scaled(g, g.payload(x), x, y)
    if one == "neg":
        return g.call("neg", g.call("mul", g.args[x][0], y))
    if other == "neg":
        return g.call("neg", g.call("mul", x, g.args[y][0]))
    if one == "sign" or other == "sign":
        found = signed_product(g, x, y)
        if found is not None:
            return found
    if one not in REWRITTEN and other not in REWRITTEN:
        return None
    for simpler in (joined_product, directed_product, rooted_product):
        found = simpler(g, x, y)
        if found is not None:
            return found
    return None


def _scaled(g: Builder, c: float, x: int, y: int) -> int | None:
    """Return c y in a simpler form, where x is the node of the number c; else None."""
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
        return g.unsimplified("mul", (x, y))  # the constant comes first
    return None


def is_normal(x: float) -> bool:
    """Whether the number `x` has full precision: neither overflow nor underflow."""
    return sys.float_info.min <= abs(x) <= sys.float_info.max


def div(g: Builder, x: int, y: int) -> int | None:
    """Return x/y in a simpler form, as a node; None where there is none."""
    if y == g.one:
        return x
    if x == g.zero and y != g.zero:
        return g.zero
    if x == y and x != g.zero:
        return g.one
    for rule in (direction, saturation):
        found = rule(g, x, y)
        if found is not None:
            return found
    if g.ops[x] == "neg":
        return g.call("neg", g.call("div", g.args[x][0], y))
    if g.ops[y] == "neg":
        return g.call("neg", g.call("div", x, g.args[y][0]))
    c = g.value(y)
    if c is not None and c != 0.0 and math.frexp(c)[0] in HALVES:
        reciprocal = 1.0 / c
        if math.isfinite(reciprocal):  # exact for a power of two
            return g.call("mul", g.constant(reciprocal), x)
    return None


def saturation(g: Builder, x: int, y: int) -> int | None:
    """Return x/y simplified where x and y grow alike as exp does; None in other cases.

    sinh(u)/cosh(u) is tanh(u), and exp(u)/(c + exp(u)) is 1/(1 + c exp(-u)) for a
    number c. In the tails these forms neither overflow nor have slopes that cancel.
    """
    op, other = g.ops[x], g.ops[y]
    if g.args[x] == g.args[y] and (op, other) == ("sinh", "cosh"):
        return g.call("tanh", g.args[x][0])
    if g.args[x] == g.args[y] and (op, other) == ("cosh", "sinh"):
        return g.call("div", g.one, g.call("tanh", g.args[x][0]))
    if op == "exp" and other == "add" and x in g.args[y]:
        c = g.args[y][g.args[y][0] == x]
        if g.value(c) is not None:
            decay = g.call("exp", g.call("neg", g.args[x][0]))
            below = g.call("add", g.one, g.call("mul", c, decay))
            return g.call("div", g.one, below)
    return None


def hyperbolic_square(g: Builder, x: int) -> int:
    """Return the node of cosh(x)^2."""
    return g.call("pow", g.call("cosh", x), g.constant(2.0))


def neg(g: Builder, x: int) -> int | None:
    """Return -x in a simpler form, as a node; None where there is none."""
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
    """Return x^y in a simpler form, as a node; None where there is none."""
    exponent = g.value(y)
    if exponent == 0.0 or x == g.one:
        return g.one
    if exponent == 1.0:
        return x
    if exponent == 0.5:
        return g.call("sqrt", x)
    if exponent is not None and exponent % 1.0:
        found = _of_square(g, x, exponent)
        if found is not None:
            return found
    if exponent is not None and exponent % 2 == 0 and g.ops[x] == "neg":
        return g.call("pow", g.args[x][0], y)
    return None if exponent is None else raised(g, x, exponent)


def choice(g: Builder, condition: int, x: int, y: int) -> int | None:
    """Return if(condition, x, y) in a simpler form; None where there is none."""
    if g.ops[condition] == "truth":
        return x if g.payload(condition) else y
    return x if x == y else None


def extreme(g: Builder, x: int, y: int, *, largest: bool) -> int | None:
    """Return max(x, y) if `largest`, else min(x, y), in a simpler form, or None."""
    if x == y:
        return x
    if y != g.call("neg", x) or g.value(x) is not None:
        return None
    size = g.call("abs", x)
    return size if largest else g.call("neg", size)


def minimum(g: Builder, x: int, y: int) -> int | None:
    """Return min(x, y) in a simpler form; None where there is none."""
    return extreme(g, x, y, largest=False)


def maximum(g: Builder, x: int, y: int) -> int | None:
    """Return max(x, y) in a simpler form; None where there is none."""
    return extreme(g, x, y, largest=True)


def absolute(g: Builder, x: int) -> int | None:
    """Return |x| with numbers factored out, or without `abs` for x of known sign.

    None in other cases.
    """
    op, args = g.ops[x], g.args[x]
    if op == "neg":
        return g.call("abs", args[0])
    if op == "mul" and (c := g.value(args[0])) is not None:
        return g.call("mul", g.constant(abs(c)), g.call("abs", args[1]))
    if op == "div" and (c := g.value(args[1])) is not None:
        return g.call("div", g.call("abs", args[0]), g.constant(abs(c)))
    return x if g.value(x) is None and never_negative(g, x) else None


def square_root(g: Builder, x: int) -> int | None:
    """Return sqrt(x) simplified where the square of an expression is a factor of x.

    None in other cases.
    """
    return _of_square(g, x, 0.5)


def hypotenuse(g: Builder, x: int, y: int) -> int | None:
    """Return hypot(x, y) simplified where both are multiples of one expression.

    None in other cases.
    """
    (c, u), (d, v) = (_multiple(g, a) for a in (x, y))
    if g.zero in (x, y):
        return g.call("abs", y if x == g.zero else x)
    if u != v or u == g.one:
        return None
    return g.call("mul", g.constant(math.hypot(c, d)), g.call("abs", u))


def cube_root(g: Builder, x: int) -> int | None:
    """Return cbrt(x) simplified where x is a cube; None in other cases."""
    exponent = g.value(g.args[x][1]) if g.ops[x] == "pow" else None
    if exponent is None or exponent % 3.0:
        return None
    return g.call("pow", g.args[x][0], g.constant(exponent / 3.0))


def _multiple(g: Builder, x: int) -> tuple[float, int]:
    """Return c and u with x = c u, where c is a number; u is 1 if x is a number."""
    op, args, number = g.ops[x], g.args[x], g.value(x)
    if number is not None:
        return number, g.one
    if op == "neg":
        c, u = _multiple(g, args[0])
        return -c, u
    if op == "mul" and (factor := g.value(args[0])) is not None:
        c, u = _multiple(g, args[1])
        return factor * c, u
    if op == "div" and (divisor := g.value(args[1])):
        c, u = _multiple(g, args[0])
        return c / divisor, u
    return 1.0, x


def _of_square(g: Builder, x: int, exponent: float) -> int | None:
    """Return x^exponent, no integer exponent, simplified where u^2 is a factor of x.

    The result is a power of |u| times a power of the other factor; None without such u.
    """
    root, rest = _squared(g, x)
    if root is None:
        return None
    found = g.call("pow", g.call("abs", root), g.constant(2.0 * exponent))
    if rest == g.one:
        return found
    return g.call("mul", g.call("pow", rest, g.constant(exponent)), found)


def _squared(g: Builder, x: int, depth: int = DEEP) -> tuple[int | None, int]:
    """Return (u, r) with x = u^2 r; (None, x) where there is no such u.

    u is no number. A sum of multiples of one square counts as a multiple of that
    square.

    depth : the number of nested products that are searched.
    """
    op, args = g.ops[x], g.args[x]
    if not depth:
        return None, x
    if op == "pow":
        exponent = g.value(args[1])
        if exponent is not None and exponent % 2.0 == 0.0 and g.value(args[0]) is None:
            return g.call("pow", args[0], g.constant(exponent / 2.0)), g.one
    elif op == "mul" and args[0] == args[1]:
        return args[0], g.one
    elif op in ("mul", "div"):
        (u, r), (v, s) = (_squared(g, a, depth - 1) for a in args)
        if u is not None or v is not None:
            one = g.one
            root = g.call(op, one if u is None else u, one if v is None else v)
            return root, g.call(op, r, s)
    elif op == "add":
        (c, u), (d, v) = (_multiple(g, a) for a in args)
        if u == v:
            common, rest = _squared(g, u, depth - 1)
            if common is not None:
                return common, g.call("mul", g.constant(c + d), rest)
    return None, x


# Terms of the series of sin(x)/x for |x| < 1: the first omitted one is 4e-28, and its
# sixth derivative 4e-20.
_TERMS = 13


def cardinal_sine(g: Builder, x: int) -> int:
    """Return the node of sinc(x) = sin(x)/x; near 0 it is a Taylor polynomial."""
    square = g.call("mul", x, x)
    near = g.constant(1.0)
    for k in range(_TERMS - 1, 0, -1):
        part = g.constant(-1.0 / (2 * k * (2 * k + 1)))
        near = g.call("add", g.one, g.call("mul", part, g.call("mul", square, near)))
    far = g.call("smooth.sinc", x)
    return g.call("smooth.if", g.call("lt", square, g.one), near, far)


def remainder(g: Builder, x: int, y: int) -> int:
    """Return the node of mod(x, y), which has the sign of y.

    The expression contains `floor`, and jumps where `floor` does.
    """
    whole = g.call("floor", g.call("div", x, y))
    return g.call("sub", x, g.call("mul", y, whole))
