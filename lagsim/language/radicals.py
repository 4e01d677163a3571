"""Powers of roots and sizes: sqrt(e)^2, hypot(x, y)^2, cbrt(x)^3, abs(x)^2.

A root has no slope at 0, where its power has one: the energy of a body at rest that is
written with its speed. Only what is equal for all arguments is written otherwise:
sqrt(e) has no value below 0, so that sqrt(e)^2 is e only where e is seen never to be
negative; elsewhere its slopes are those of e all the same (`local_slopes`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.directions import without

if TYPE_CHECKING:
    from lagsim.language.builder import Builder

# The power that takes each away.
UNDONE = {"sqrt": 2, "hypot": 2, "abs": 2, "cbrt": 3}
_NEVER_NEGATIVE = ("abs", "sqrt", "exp", "cosh", "hypot", "heaviside")
# Nodes that are looked at for a sign: sums of squares of bodies are long.
MOST = 200


def raised(g: Builder, x: int, exponent: float) -> int | None:
    """Give x^exponent without the root that x is or has for a factor, else None."""
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


def product(g: Builder, x: int, y: int) -> int | None:
    """Give x y where one is a root that is a factor of the other, too, else None."""
    for a, b in ((x, y), (y, x)):
        if g.ops[b] not in UNDONE:
            continue
        if g.ops[a] == "pow" and g.args[a][0] == b:
            exponent = g.value(g.args[a][1])
            if exponent is not None and exponent >= 1.0:
                return g.call("pow", b, g.constant(exponent + 1.0))
        rest = without(g, a, b)
        if rest is not None:
            return g.call("mul", rest, g.call("pow", b, g.constant(2.0)))
    return None


def never_negative(g: Builder, node: int) -> bool:
    """Tell whether a node is seen to have no value below 0."""
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
        elif op == "if":
            stack += args[1:]
        else:
            return False
    return True
