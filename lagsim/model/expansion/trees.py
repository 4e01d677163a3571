"""Scalar expressions as trees, and vectors as tuples of 2 or 3 trees.

`number`, `name` and `call` create a `Tree`; a vector is a plain tuple of trees. The
functions below accept either and raise `UnfitError` where sizes do not match; the scope
that evaluates an expression (`scope.Scope`) adds its place. `parsed` writes a tree as
postfix for the reader. A tree is traversed once for each use: a tree used often, or by
the next member of a recursion, becomes a *hidden definition*, which is no column:
`Expansion.add_hidden(name, value, at)` adds it as `~name` (for a vector `~name.x`,
...), and returns a reference to it.

A frame has the matrix R that transforms components in the frame into components in
space, u = R v, and its angular velocity in its own components. A frame with the
rotation E and the angular velocity e relative to the frame P it is `on` has R = P E
and, by recursion, w = E^T w_P + e, so that the cost of a chain of n frames is n times
that of one. In the plane R has two rows, and w is a number.

Sources: H. Goldstein, Classical Mechanics, sections 4.6 (rotation about an axis, eq
4.62), 4.9 (angular velocity); A. A. Shabana, Dynamics of Multibody Systems, section 2.2
(Euler parameters, divided by p . p: a quaternion of any length is a rotation).
"""

from __future__ import annotations

from functools import partial, reduce
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from lagsim.language.parser import Parsed, Token

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

LETTERS = "xyz"
# Entries of a symmetric matrix, in the order of a list of six numbers.
ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")


class UnfitError(Exception):
    """Signal that an operation does not support operands of these sizes.

    It has a text and a hint.
    """

    def __init__(self, text: str, hint: str = "") -> None:
        super().__init__(text)
        self.text = text
        self.hint = hint


class Tree(NamedTuple):
    """Number, name with its offset in the text, or operation `op` with `args`."""

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
    """Return the tree of a number."""
    return Tree("number", float(x))


def name(text: str, offset: int = 0) -> Tree:
    """Return the tree of a variable, by its name with dots."""
    return Tree("name", text, offset)


def call(op: str, *args: Tree) -> Tree:
    """Return the tree of an operation or function, such as `add` or `sin`."""
    return Tree(op, args=args)


def components(size: int) -> tuple[str, ...]:
    """Return the names of `size` components, such as `('x', 'y')`.

    For size 6, the names of the components of a symmetric matrix.
    """
    return ENTRIES if size == len(ENTRIES) else tuple(LETTERS[:size])


def size(value: Value) -> int:
    """Return the number of components; 1 for a number."""
    return 1 if isinstance(value, Tree) else len(value)


def described(value: Value) -> str:
    """Return words for a value in messages: `a number`, `a vector of 2`."""
    return f"a vector of {size(value)}" if size(value) > 1 else "a number"


def scalar(value: Value, label: str) -> Tree:
    """Return `value` if it is a number; else raise an UnfitError.

    label : name of the value in the message.
    """
    if isinstance(value, Tree):
        return value
    hint = "write a component, such as `.x`, or `norm(...)`"
    raise UnfitError(f"{label} must be a number, found {described(value)}", hint)


def vector(value: Value, label: str) -> Vector:
    """Return `value` if it is a vector of 2 or 3 components; else raise an UnfitError.

    label : name of the value in the message.
    """
    if isinstance(value, Tree) or len(value) == len(ENTRIES):
        raise UnfitError(
            f"{label} must be a vector, found {described(value)}", "write vec(a, b)"
        )
    return value


def _pairs(a: Value, b: Value) -> Iterator[tuple[Tree, Tree]]:
    """Yield the pairs of components of two vectors of equal size."""
    assert not isinstance(a, Tree)
    assert not isinstance(b, Tree)
    return zip(a, b, strict=True)


def _alike(label: str, a: Value, b: Value) -> None:
    if size(a) != size(b):
        raise UnfitError(
            f"{label} takes values of one size, found {size(a)} and {size(b)}"
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
    """Return the scalar product of two vectors."""
    _alike("`dot`", a, b)
    u, v = vector(a, "`dot`'s argument"), vector(b, "`dot`'s argument")
    return _sum(call("mul", *pair) for pair in _pairs(u, v))


def cross(a: Value, b: Value) -> Value:
    """Return the vector product; in the plane the number a_x b_y - a_y b_x."""
    _alike("`cross`", a, b)
    u, v = vector(a, "`cross`'s argument"), vector(b, "`cross`'s argument")

    def minor(i: int, j: int) -> Tree:
        return call("sub", call("mul", u[i], v[j]), call("mul", u[j], v[i]))

    if len(u) == len("xy"):
        return minor(0, 1)
    return minor(1, 2), minor(2, 0), minor(0, 1)


def norm(a: Value) -> Tree:
    """Return the length of a vector."""
    parts = vector(a, "`norm`'s argument")
    return call("sqrt", _sum(call("pow", x, number(2.0)) for x in parts))


def unit(a: Value) -> Value:
    """Return the direction of a vector: `a/norm(a)`."""
    return times("div", a, norm(a))


def choice(condition: Value, a: Value, b: Value) -> Value:
    """Return `if(condition, a, b)` between values of one size."""
    test = scalar(condition, "a condition")
    _alike("`if`", a, b)
    if isinstance(a, Tree) and isinstance(b, Tree):
        return call("if", test, a, b)
    return tuple(call("if", test, *pair) for pair in _pairs(a, b))


def parsed(tree: Tree, text: str) -> Parsed:
    """Return a tree as postfix; the offsets of its names refer to `text`."""
    items: list[tuple[str, Any, Token]] = []
    stack = [tree]
    while stack:
        op, value, offset, args = stack.pop()
        token = Token(op, "", offset) if offset else _NOWHERE
        items.append((op, len(args) if args else value, token))
        stack += args
    return Parsed(text, tuple(reversed(items)))


# --- Frames: rotations about an axis, composed, by a quaternion, or by angles

ZERO, ONE = number(0.0), number(1.0)


class Frame(NamedTuple):
    """Frame: the rows of R, and the angular velocity `omega` in its components.

    `angle` is the angle of a frame in the plane, `number` the index of a frame in
    space among those of the file; -1 for space itself.
    """

    rows: tuple[Vector, ...]
    omega: Value
    angle: Tree | None = None
    number: int = -1


def space(n: int) -> Frame:
    """Return the frame of space of n dimensions, 2 or 3: R is the identity."""
    rows = (tuple(ONE if i == j else ZERO for j in range(n)) for i in range(n))
    return Frame(tuple(rows), ZERO if n < len(LETTERS) else (ZERO,) * n, ZERO)


def product(*factors: Tree) -> Tree:
    """Return the product of factors, simplified for factors 0 and 1."""
    found, negative = ONE, False
    for x in factors:
        if x.op == "number" and x.value == 0.0:
            return ZERO
        if x.op == "number" and abs(float(x.value)) == 1.0:
            negative ^= x.value == -1.0
        else:
            found = x if found is ONE else call("mul", found, x)
    return call("neg", found) if negative else found


def total(terms: Iterable[Tree]) -> Tree:
    """Return the sum of terms, without terms that are 0."""
    found = ZERO
    for x in terms:
        if not (x.op == "number" and x.value == 0.0):
            found = x if found is ZERO else call("add", found, x)
    return found


def _inner(a: Iterable[Tree], b: Iterable[Tree]) -> Tree:
    return total(product(x, y) for x, y in zip(a, b, strict=True))


def _columns(rows: Sequence[Vector]) -> tuple[Vector, ...]:
    return tuple(zip(*rows, strict=True))


def _turned(rows: Sequence[Vector], v: Value, label: str) -> Vector:
    if size(v) != len(rows):
        expected = f"`{label}` takes a vector of {len(rows)} in this frame"
        raise UnfitError(f"{expected}, found {described(v)}")
    assert not isinstance(v, Tree)
    return tuple(_inner(row, v) for row in rows)


def rotate(frame: Frame, v: Value) -> Vector:
    """Return the components in space of a vector with the components v in the frame."""
    return _turned(frame.rows, v, "rotate")


def unrotate(frame: Frame, v: Value) -> Vector:
    """Return the components in the frame of a vector with the components v in space."""
    return _turned(_columns(frame.rows), v, "unrotate")


def omega_space(frame: Frame) -> Value:
    """Return the components in space of the frame's angular velocity."""
    planar = len(frame.rows) == len("xy")
    return frame.omega if planar else rotate(frame, frame.omega)


def spin(J: Value, w: Value) -> Tree:
    """Return the energy of rotation w . J w/2.

    J is a number, three principal moments, or the six entries Jxx, Jyy, Jzz, Jxy, Jxz,
    Jyz of a symmetric matrix.
    """
    n = size(J)
    if isinstance(J, Tree):
        parts = (w,) if isinstance(w, Tree) else w
        return call("div", product(J, _inner(parts, parts)), number(2.0))
    if n not in (len(LETTERS), len(ENTRIES)):
        text = f"`spin` takes 1, 3 or 6 moments of inertia, found {n}"
        raise UnfitError(
            text, "a number, three principal values, or Jxx, Jyy, Jzz, Jxy, ..."
        )
    if size(w) != len(LETTERS):
        text = f"`spin` with {n} moments of inertia takes an angular velocity of 3 "
        raise UnfitError(
            f"{text}components, found {described(w)}", "in the plane J is a number"
        )
    assert not isinstance(w, Tree)
    squares = total(product(j, x, x) for j, x in zip(J, w, strict=False))
    energy = call("div", squares, number(2.0))
    for j, entry in zip(J[3:], ENTRIES[3:], strict=False):
        a, b = (w[LETTERS.index(letter)] for letter in entry)
        energy = total([energy, product(j, a, b)])
    return energy


OF_A_FRAME: dict[str, Callable[..., Value]] = {
    "rotate": rotate,
    "unrotate": unrotate,
    "omega": lambda frame: frame.omega,
    "omega_space": omega_space,
}


class Chart(NamedTuple):
    """Rotation relative to another frame: the rows of E, and `omega`.

    `omega` is the angular velocity e relative to that frame, in components of the
    rotated frame.
    """

    rows: tuple[Vector, ...]
    omega: Vector


def about(axis: Vector, angle: Tree, speed: Tree) -> Chart:
    """Return the rotation by an angle about an axis of length 1 (Rodrigues' formula).

    speed : the rate of the angle.
    """
    c, s = call("cos", angle), call("sin", angle)
    rest = call("sub", ONE, c)

    def entry(i: int, j: int) -> Tree:
        if i == j:
            known = axis[i].op == "number" and abs(float(axis[i].value)) == 1.0
            return ONE if known else total([c, product(rest, axis[i], axis[i])])
        k = 3 - i - j
        sign = number(-1.0 if (i + 1) % 3 == j else 1.0)
        return total([product(rest, axis[i], axis[j]), product(sign, axis[k], s)])

    rows = tuple(tuple(entry(i, j) for j in range(3)) for i in range(3))
    return Chart(rows, tuple(product(x, speed) for x in axis))


def by_quaternion(p: Vector, n: Tree, speeds: Vector) -> Chart:
    """Return the rotation by a quaternion p, scalar first.

    n : p . p.
    speeds : the rates of the components of p.
    """
    two, q, q_dot = call("div", number(2.0), n), p[1:], speeds[1:]

    def entry(i: int, j: int) -> Tree:
        if i == j:
            j, k = (i + 1) % 3, (i + 2) % 3
            off = call("add", product(q[j], q[j]), product(q[k], q[k]))
            return call("sub", ONE, product(two, off))
        k, op = 3 - i - j, "sub" if (i + 1) % 3 == j else "add"
        return product(two, call(op, product(q[i], q[j]), product(p[0], q[k])))

    def component(i: int) -> Tree:
        j, k = (i + 1) % 3, (i + 2) % 3
        own = call("sub", product(p[0], q_dot[i]), product(q[i], speeds[0]))
        twist = call("sub", product(q[j], q_dot[k]), product(q[k], q_dot[j]))
        return product(two, call("sub", own, twist))

    rows = tuple(tuple(entry(i, j) for j in range(3)) for i in range(3))
    return Chart(rows, tuple(component(i) for i in range(3)))


def composed(
    called: str, parent: Frame, own: Chart, hide: Callable[[str, Value], Value]
) -> Frame:
    """Return the frame with the rotation `own` relative to `parent`.

    called : name of the frame.
    hide : function that makes an entry with operations a hidden definition, and returns
        a reference.
    """

    def kept(label: str, x: Tree) -> Tree:
        return x if not x.args else scalar(hide(f"{called}.{label}", x), label)

    E = _columns(own.rows)
    P = parent.rows
    rows = tuple(
        tuple(
            kept(f"{a}{b}", _inner(row, column))
            for b, column in zip(LETTERS, E, strict=True)
        )
        for a, row in zip(LETTERS, P, strict=True)
    )
    assert not isinstance(parent.omega, Tree)
    omega = tuple(
        kept(f"w.{a}", total([_inner(column, parent.omega), e]))
        for a, column, e in zip(LETTERS, E, own.omega, strict=True)
    )
    return Frame(rows, omega)
