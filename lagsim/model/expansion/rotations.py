"""Frames: rotations about an axis, composed, by a quaternion, or by angles.

A frame has the matrix R that turns components in it into components in space, u = R v,
and its angular velocity in its own components. What a frame adds to the one it is `on`,
R = P E, goes on by recursion, w = E^T w_P + e, so that a chain of n frames costs n
times one of them. In the plane R has two rows, and w is a number.

Sources: H. Goldstein, Classical Mechanics, sections 4.6 (rotation about an axis, eq
4.62), 4.9 (angular velocity); A. A. Shabana, Dynamics of Multibody Systems, section 2.2
(Euler parameters, with p . p divided by: a quaternion of any length is a rotation).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.model.expansion.trees import (
    ENTRIES,
    LETTERS,
    Tree,
    UnfitError,
    Value,
    Vector,
    call,
    number,
    said,
    scalar,
    size,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    # Enters a hidden definition of a name, and gives what refers to it.
    Hide = Callable[[str, Value], Value]

ZERO, ONE = number(0.0), number(1.0)


class Frame(NamedTuple):
    """A frame: the rows of R, and its angular velocity in its own components.

    The angle is that of a frame of the plane.
    """

    rows: tuple[Vector, ...]
    omega: Value
    angle: Tree | None = None

    @property
    def planar(self) -> bool:
        """Whether it turns in the plane."""
        return len(self.rows) == len("xy")


def _identity(n: int) -> tuple[Vector, ...]:
    return tuple(tuple(ONE if i == j else ZERO for j in range(n)) for i in range(n))


def space(n: int) -> Frame:
    """Space of n dimensions, 2 or 3."""
    return Frame(_identity(n), ZERO if n < len(LETTERS) else (ZERO,) * n, ZERO)


def product(*factors: Tree) -> Tree:
    """Product of factors, in which 0 and 1 are taken as what they are."""
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
    """Sum of terms, without those that are 0."""
    found = ZERO
    for x in terms:
        if not (x.op == "number" and x.value == 0.0):
            found = x if found is ZERO else call("add", found, x)
    return found


def _inner(a: Iterable[Tree], b: Iterable[Tree]) -> Tree:
    return total(product(x, y) for x, y in zip(a, b, strict=True))


def _columns(rows: Sequence[Vector]) -> tuple[Vector, ...]:
    return tuple(zip(*rows, strict=True))


def _turned(rows: Sequence[Vector], v: Value, what: str) -> Vector:
    if size(v) != len(rows):
        text = f"`{what}` takes a vector of {len(rows)} in this frame, found {said(v)}"
        raise UnfitError(text)
    assert not isinstance(v, Tree)
    return tuple(_inner(row, v) for row in rows)


def rotate(frame: Frame, v: Value) -> Vector:
    """Components in space of a vector with the components v in the frame."""
    return _turned(frame.rows, v, "rotate")


def unrotate(frame: Frame, v: Value) -> Vector:
    """Components in the frame of a vector with the components v in space."""
    return _turned(_columns(frame.rows), v, "unrotate")


def omega_space(frame: Frame) -> Value:
    """Components in space of the angular velocity."""
    return frame.omega if frame.planar else rotate(frame, frame.omega)


def spin(J: Value, w: Value) -> Tree:
    """Energy of rotation w . J w/2: J is a number, three principal ones, or a matrix.

    The six entries of a symmetric matrix are Jxx, Jyy, Jzz, Jxy, Jxz, Jyz.
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
            f"{text}components, found {said(w)}", "in the plane J is a number"
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
    """What a frame adds to the one it is on: the rows of E, an angular velocity."""

    rows: tuple[Vector, ...]
    omega: Vector


def about(axis: Vector, angle: Tree, speed: Tree) -> Chart:
    """Rotation by an angle about an axis of length 1 (Rodrigues)."""
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
    """Rotation by a quaternion p, scalar first; n is p . p."""
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


def composed(called: str, parent: Frame, own: Chart, hide: Hide) -> Frame:
    """Frame on another one, by what it adds; entries that are no leaf are hidden."""

    def kept(what: str, x: Tree) -> Tree:
        return x if not x.args else scalar(hide(f"{called}.{what}", x), what)

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
