"""Scalar expressions as trees, and vectors as tuples of 2 or 3 of them.

A `Tree` is made by `number`, `name` and `call`; a vector is a plain tuple of trees. The
functions below take either and raise `UnfitError` where sizes do not fit; the scope
that evaluates an expression (`scope.Scope`) adds its place. `parsed` writes a tree as
the postfix that the reader builds. It is walked as often as it is used: what is used
often, or by the next member of a recursion, becomes a *hidden definition*, no column:
`Expansion.hide(name, value, at)` enters it as `~name` (a vector's `~name.x`, ...), and
gives what refers to it.
"""

from __future__ import annotations

from functools import partial, reduce
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from lagsim.language.parser import Parsed, Token

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

LETTERS = "xyz"
# Entries of a symmetric matrix, in the order in which six numbers give them.
ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")


class UnfitError(Exception):
    """Values of sizes that an operation does not take; a sentence, and a hint."""

    def __init__(self, text: str, hint: str = "") -> None:
        super().__init__(text)
        self.text = text
        self.hint = hint


class Tree(NamedTuple):
    """A number, a name with its offset in the text, or an operation with arguments."""

    op: str
    value: float | str = 0.0
    offset: int = 0
    args: tuple[Tree, ...] = ()


Vector: TypeAlias = tuple[Tree, ...]
Value: TypeAlias = Tree | Vector

_NOWHERE = Token("", "", 0)
# The sum over an empty range, of any size.
EMPTY = Tree("number", 0.0, -1)


def number(x: float) -> Tree:
    """Return tree of a number."""
    return Tree("number", float(x))


def name(text: str, offset: int = 0) -> Tree:
    """Return tree of a variable, by its name with dots."""
    return Tree("name", text, offset)


def call(op: str, *args: Tree) -> Tree:
    """Return the tree of an operation or function, such as `add` or `sin`."""
    return Tree(op, args=args)


def components(size: int) -> tuple[str, ...]:
    """Return the names of the components of a vector, or of a matrix's six."""
    return ENTRIES if size == len(ENTRIES) else tuple(LETTERS[:size])


def size(value: Value) -> int:
    """Return count of components; 1 for a number."""
    return 1 if isinstance(value, Tree) else len(value)


def said(value: Value) -> str:
    """Return description of a value by its size, for messages."""
    return f"a vector of {size(value)}" if size(value) > 1 else "a number"


def scalar(value: Value, what: str) -> Tree:
    """Return value that is expected to be a number."""
    if isinstance(value, Tree):
        return value
    hint = "write a component, such as `.x`, or `norm(...)`"
    raise UnfitError(f"{what} must be a number, found {said(value)}", hint)


def vector(value: Value, what: str) -> Vector:
    """Return value that is expected to be a vector of 2 or 3 components."""
    if isinstance(value, Tree) or len(value) == len(ENTRIES):
        raise UnfitError(
            f"{what} must be a vector, found {said(value)}", "write vec(a, b)"
        )
    return value


def _pairs(a: Value, b: Value) -> Iterator[tuple[Tree, Tree]]:
    """Return the components of two vectors of one size."""
    assert not isinstance(a, Tree)
    assert not isinstance(b, Tree)
    return zip(a, b, strict=True)


def _alike(what: str, a: Value, b: Value) -> None:
    if size(a) != size(b):
        raise UnfitError(
            f"{what} takes values of one size, found {size(a)} and {size(b)}"
        )


def plus(op: str, a: Value, b: Value) -> Value:
    """Return `a + b` or `a - b` (`op` is add or sub), component by component."""
    if b is EMPTY:
        return a
    if a is EMPTY:
        return b if op == "add" else negative(b)
    if isinstance(a, Tree) and isinstance(b, Tree):
        return call(op, a, b)
    _alike("`+`" if op == "add" else "`-`", a, b)
    return tuple(call(op, *pair) for pair in _pairs(a, b))


def negative(a: Value) -> Value:
    """Return `-a`."""
    if isinstance(a, Tree):
        return call("neg", a)
    return tuple(call("neg", x) for x in a)


def times(op: str, a: Value, b: Value) -> Value:
    """Return `s*v`, `v*s` or `v/s` (`op` is mul or div)."""
    if isinstance(b, Tree):
        if isinstance(a, Tree):
            return call(op, a, b)
        return tuple(call(op, x, b) for x in a)
    if op == "div":
        raise UnfitError("division by a vector", "divide by `norm(...)`")
    if isinstance(a, Tree):
        return tuple(call(op, a, y) for y in b)
    raise UnfitError("`*` of two vectors", "write dot(a, b) or cross(a, b)")


def _sum(terms: Iterable[Tree]) -> Tree:
    return reduce(partial(call, "add"), terms)


def dot(a: Value, b: Value) -> Tree:
    """Return scalar product."""
    _alike("`dot`", a, b)
    u, v = vector(a, "`dot`'s argument"), vector(b, "`dot`'s argument")
    return _sum(call("mul", *pair) for pair in _pairs(u, v))


def cross(a: Value, b: Value) -> Value:
    """Return vector product; a number in the plane."""
    _alike("`cross`", a, b)
    u, v = vector(a, "`cross`'s argument"), vector(b, "`cross`'s argument")

    def minor(i: int, j: int) -> Tree:
        return call("sub", call("mul", u[i], v[j]), call("mul", u[j], v[i]))

    if len(u) == len("xy"):
        return minor(0, 1)
    return minor(1, 2), minor(2, 0), minor(0, 1)


def norm(a: Value) -> Tree:
    """Return length of a vector."""
    parts = vector(a, "`norm`'s argument")
    return call("sqrt", _sum(call("pow", x, number(2.0)) for x in parts))


def unit(a: Value) -> Value:
    """Return direction of a vector: `a/norm(a)`."""
    return times("div", a, norm(a))


def choice(condition: Value, a: Value, b: Value) -> Value:
    """Return `if(condition, a, b)` between values of one size."""
    test = scalar(condition, "a condition")
    _alike("`if`", a, b)
    if isinstance(a, Tree) and isinstance(b, Tree):
        return call("if", test, a, b)
    return tuple(call("if", test, *pair) for pair in _pairs(a, b))


def parsed(tree: Tree, text: str) -> Parsed:
    """Return the postfix of a tree; `text` is where the offsets of names are."""
    items: list[tuple[str, Any, Token]] = []
    stack = [tree]
    while stack:
        op, value, offset, args = stack.pop()
        token = Token(op, "", offset) if offset else _NOWHERE
        items.append((op, len(args) if args else value, token))
        stack += args
    return Parsed(text, tuple(reversed(items)))
