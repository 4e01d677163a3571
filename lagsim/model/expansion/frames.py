"""The section `frames`: what each is on, and how it is turned there.

A frame is made when it is first asked for, after all those that it is on. The entries
of its matrix and its angular velocity are hidden definitions, see `trees`.
"""

from __future__ import annotations

import math
import re
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from lagsim.errors import did_you_mean
from lagsim.language.names import UNIT_LENGTH, rate_of
from lagsim.language.parser import (
    SILENT,
    ExpressionError,
    ParsedRelation,
    parse,
    silent,
)
from lagsim.model import nodes
from lagsim.model.expansion.scope import dotted
from lagsim.model.expansion.trees import (
    LETTERS,
    ONE,
    ZERO,
    Chart,
    Frame,
    Tree,
    Value,
    Vector,
    about,
    by_quaternion,
    call,
    composed,
    name,
    number,
    parsed,
    product,
    said,
    scalar,
    space,
    total,
    unit,
)
from lagsim.model.nodes import Broken, Mapping, Scalar, entries_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.errors import Place
    from lagsim.language.parser import Steps
    from lagsim.model.expansion import Expansion
    from lagsim.model.expansion.scope import Indices
    from lagsim.model.nodes import Node

# A frame by its name and subscripts.
Called = tuple[str, tuple[int, ...]]
SPACE = "space"
KEYS = ("on", "axis", "angle", "quaternion", "angles", "axes")
_SPACE: Called = (SPACE, ())
_HOW = "write {on: ..., axis: [0, 0, 1], angle: q}, {quaternion: [p0, p1, p2, p3]}, "
_HOW += "{angles: [a, b, c], axes: zxz}, or in the plane {angle: q}"


class _Given(NamedTuple):
    """A frame as the file gives it: values by their keys, for one member."""

    key: Scalar
    below: dict[str, Node]
    indices: Indices


def unknown(below: Iterable[str], keys: Iterable[str]) -> bool:
    """Tell whether there are other keys, which the reader reports."""
    return any(k not in keys and not k.startswith("x-") for k in below)


class Section:
    """Values of what stands in a section of frames or bodies.

    Faults are reported; then an ExpressionError is raised that is silent.
    """

    def __init__(self, x: Expansion) -> None:
        self.x, self.scope, self.report = x, x.scope, x.report

    def refuse(
        self, code: str, text: str, at: Place | Node, hint: str = ""
    ) -> NoReturn:
        """Report a fault, and raise what stands for one that is reported."""
        self.report(code, text, at, hint)
        raise silent()

    def value(self, node: Node, indices: Indices, what: str) -> tuple[Value, Scalar]:
        """Value of an expression, and its scalar."""
        if isinstance(node, Broken):
            raise silent()
        if not isinstance(node, Scalar) or node.empty:
            text = f"{what} must be an expression"
            self.refuse("not-an-expression", text, node)
        try:
            return self.scope.values(node.text, parse, indices)[0], node
        except ExpressionError as fault:
            self.x.fault(fault, node)
            raise silent() from None

    def moved(self, hidden: str, tree: Tree, at: Scalar) -> Tree:
        """Hide a definition whose rate is asked for, and so is one of positions."""
        found = scalar(self.x.hide(hidden, tree, at), hidden)
        self.x.moving[str(found.value)] = at
        return found

    def number(self, node: Node, indices: Indices, what: str) -> tuple[Tree, Scalar]:
        """Value of an expression that is a number, and its scalar."""
        value, at = self.value(node, indices, what)
        if not isinstance(value, Tree):
            text = f"{what} must be a number, found {said(value)}"
            self.refuse("wrong-count", text, at.place_of(0, len(at.text)))
        return value, at

    def vector(
        self, node: Node, indices: Indices, counts: Sequence[int], what: str
    ) -> list[tuple[Tree, Scalar]]:
        """Components of a list, or of a vector, each with its scalar."""
        if isinstance(node, nodes.Sequence):
            found = [self.number(item, indices, what) for item in node.items]
        else:
            value, at = self.value(node, indices, what)
            parts = (value,) if isinstance(value, Tree) else value
            found = [(part, at) for part in parts]
        if len(found) not in counts:
            wanted = " or ".join(map(str, counts))
            text = f"{what} must have {wanted} components, found {len(found)}"
            self.refuse("wrong-count", text, node)
        return found


class Frames(Section):
    """The frames of a file, each made when it is first asked for.

    Attributes
    ----------
    n : int
        Dimensions, 2 or 3: those of the frames, which turn in the plane or in space.
    """

    def __init__(self, x: Expansion, section: Node | None) -> None:
        super().__init__(x)
        self._given: dict[Called, _Given] = {}
        self._broken: set[str] = set()
        self._making: set[Called] = set()
        given = entries_of(section)
        turning = {key.text for _, node in given for key, _ in entries_of(node)}
        self.n = 3 if turning & {"axis", "angles", "axes", "quaternion"} else 2
        self._made: dict[Called, Frame | None] = {_SPACE: space(self.n)}
        for key, node in given:
            self._declare(key, node)

    def make_all(self) -> None:
        """Make all frames, and the constraints that hold their quaternions."""
        for called in self._given:
            with suppress(ExpressionError):
                self._frame_of(called)

    # What the file gives

    def _declare(self, key: Scalar, node: Node) -> None:
        below = {k.text: value for k, value in entries_of(node)}
        if isinstance(node, Scalar) and not node.empty:
            below = {"on": node}
        found = self.x.members(key, "a frame")
        name = key.text.partition("(")[0].strip()
        sound = self._sound(key, node, below)
        if found is None or not sound:
            self._broken.add(name)
            return
        for indices, member in found[1]:
            if (name, member) in self._given or name == SPACE:
                what = "is built in" if name == SPACE else "is given twice"
                text = f"the frame `{dotted(name, member)}` {what}"
                self.report("duplicate-member", text, key)
                return
            self._given[name, member] = _Given(key, below, indices)

    def _sound(self, key: Scalar, node: Node, below: dict[str, Node]) -> bool:
        """Report keys that do not make a rotation."""
        what, report = f"the frame `{key.text}`", self.report
        if not isinstance(node, Mapping) and "on" in below:
            return True
        if unknown(below, KEYS):
            return False
        ways = [k for k in ("angle", "angles", "quaternion") if k in below]
        pairs = [("axes", "angles"), ("angles", "axes"), ("axis", "angle")]
        pairs += [("angle", "axis")] if self.n > len("xy") else []
        for has, wants in pairs:
            if has in below and wants not in below:
                text = f"{what} has `{has}` but no `{wants}`"
                report("missing-key", text, key, _HOW)
                return False
        if not ways:
            report("missing-key", f"{what} has no rotation", key, _HOW)
        elif len(ways) > 1:
            text = f"{what} has both `{ways[0]}` and `{ways[1]}`"
            report("both-given", text, key, _HOW)
        return len(ways) == 1

    # Frames by their names

    def named(self, node: Scalar, indices: Indices) -> Frame:
        """Frame that an expression names; a fault is reported."""
        try:
            return self.named_by(self.scope.source(node.text, parse).postfix, indices)
        except ExpressionError as fault:
            self.x.fault(fault, node)
            raise silent() from None

    def named_by(self, steps: Steps, indices: Indices) -> Frame:
        """Frame that the steps of an expression name, see `_called` and `_frame_of`."""
        return self._frame_of(self._called(steps, indices))

    def _called(self, steps: Steps, indices: Indices) -> Called:
        """Name and subscripts of the frame that an expression names; else a fault."""
        *subscripts, (op, _, token) = steps
        if op not in ("name", "member"):
            raise token.fault("the name of a frame is expected here", "", "frame")
        values = self.scope.run(tuple(subscripts), indices)
        member = tuple(self.scope.whole(value, token) for value in values)
        name = token.text
        if (name, member) in self._given or (name, member) == _SPACE:
            return name, member
        if name in self._broken:
            raise token.fault("", "", SILENT)
        members = [m for other, m in self._given if other == name]
        hint = did_you_mean(name, [SPACE, *(other for other, _ in self._given)]) or _HOW
        if members:
            ends = (dotted(name, m) for m in (min(members), max(members)))
            hint = "there are `{}` to `{}`".format(*ends)
        text = f"there is no frame `{dotted(name, member)}`"
        raise token.fault(text, hint, "frame")

    def _frame_of(self, called: Called) -> Frame:
        """Frame of a name, made after those that it is on; faults are reported."""
        chain: list[Called] = []
        while called not in self._made:
            if called in chain:
                circle = [*chain[chain.index(called) :], called]
                shown = " -> ".join(dotted(*one) for one in circle)
                text = f"the frame `{dotted(*called)}` is on itself: {shown}"
                node = self._given[called].below["on"]
                self.report("cycle", text, node)
                self._made |= dict.fromkeys(chain)
                break
            chain.append(called)
            called = self._parent(called)
        for one in reversed(chain):
            if one in self._making:
                text = f"the frame `{dotted(*one)}` depends on itself"
                raise ExpressionError(0, 1, text, "", "frame")
            if one not in self._made:
                self._making.add(one)
                try:
                    self._made[one] = self._frame(one)
                finally:
                    self._making.discard(one)
        frame = self._made[chain[0] if chain else called]
        if frame is None:
            raise silent()
        return frame

    def _parent(self, called: Called) -> Called:
        """Name of the frame that one is on; in case of a fault, that is reported."""
        given = self._given[called]
        node = given.below.get("on")
        if node is None:
            return _SPACE
        try:
            if not isinstance(node, Scalar):
                text = f"`on` of the frame `{given.key.text}` names a frame"
                self.refuse("not-an-expression", text, node, "such as on: arm")
            steps = self.scope.source(node.text, parse).postfix
            return self._called(steps, given.indices)
        except ExpressionError as fault:
            if isinstance(node, Scalar):
                self.x.fault(fault, node)
            self._made[called] = None
            return _SPACE

    def _frame(self, called: Called) -> Frame | None:
        """Make a frame on one that is made; None where a fault is reported."""
        given, parent = self._given[called], self._made[self._parent(called)]
        if parent is None:
            return None
        name, below = "frame." + dotted(*called), given.below
        try:
            if "angles" in below:
                return self._by_angles(called, parent, name)
            if "quaternion" in below:
                own = self._quaternion(called, name)
            elif "angle" not in below:
                return parent  # another name of it
            elif self.n == len("xy"):
                return self._planar(given, parent, name)
            else:
                turn = self._moving(f"{name}.angle", *self._number(given, "angle"))
                own = about(self._axis(given, name), *turn)
        except ExpressionError:
            return None
        return composed(name, parent, own, partial(self.x.hide, at=given.key))

    def _number(self, given: _Given, key: str) -> tuple[Tree, Scalar]:
        what = f"the `{key}` of the frame `{given.key.text}`"
        return self.number(given.below[key], given.indices, what)

    def _moving(self, hidden: str, tree: Tree, at: Scalar) -> tuple[Tree, Tree]:
        """Return a tree that has a rate, and this."""
        if tree.op == "number":
            return tree, ZERO
        if tree.op != "name" or not self._is_coordinate(tree):
            tree = self.moved(hidden, tree, at)
        return tree, name(rate_of(str(tree.value)))

    def _is_coordinate(self, tree: Tree) -> bool:
        family = self.scope.variables.get(str(tree.value).partition(".")[0])
        return family is not None and family.section == "coordinates"

    # Rotations

    def _planar(self, given: _Given, parent: Frame, hidden: str) -> Frame:
        """Frame of the plane, by the sum of the angles."""
        angle, speed = self._moving(f"{hidden}.turn", *self._number(given, "angle"))
        assert parent.angle is not None
        if parent.angle != ZERO:
            whole = total([parent.angle, angle])
            angle = scalar(self.x.hide(f"{hidden}.angle", whole, given.key), hidden)
            speed = name(rate_of(str(angle.value)))
        c, s = call("cos", angle), call("sin", angle)
        return Frame(((c, call("neg", s)), (s, c)), speed, angle)

    def _axis(self, given: _Given, name: str) -> Vector:
        """Return the unit vector of an axis, which is made of parameters."""
        node, what = given.below["axis"], f"the `axis` of the frame `{given.key.text}`"
        parts = self.vector(node, given.indices, [3], what)
        values = [self._fixed(tree, at, what) for tree, at in parts]
        if not any(values) or not all(map(math.isfinite, values)):
            text = f"{what} has no direction: it is {values}"
            self.refuse("out-of-range", text, node, "such as [0, 0, 1]")
        # One along x, y or z is taken as such, which makes all that follows shorter:
        # with other values of its parameters the file is read again.
        if sum(value != 0.0 for value in values) == 1:
            self.scope.ask(*(tree for tree, _ in parts))
            signs = (float(value > 0.0) - float(value < 0.0) for value in values)
            return tuple(map(number, signs))
        raw = tuple(
            scalar(self.x.hide(f"{name}.axis.{c}", tree, at), c)
            for c, (tree, at) in zip(LETTERS, parts, strict=True)
        )
        found = self.x.hide(f"{name}.direction", unit(raw), given.key)
        assert not isinstance(found, Tree)
        return found

    def _fixed(self, tree: Tree, at: Scalar, what: str) -> float:
        """Value of a tree of parameters."""
        found = parsed(tree, at.text)
        for used in found.names:
            if used.text not in {*self.scope.numbers, *self.scope.of_tables}:
                family = self.scope.variables.get(used.text.partition(".")[0])
                if family and family.section == "parameters":
                    raise silent()
                text = f"{what} is made of parameters; `{used.text}` is none"
                place = at.place_of(used.offset, len(used.text))
                self.refuse("not-constant", text, place)
        try:
            return self.scope.number(found)
        except ExpressionError as fault:
            self.refuse("not-constant", fault.text, at, fault.hint)

    def _quaternion(self, called: Called, name: str) -> Chart:
        given = self._given[called]
        what = f"the quaternion of the frame `{given.key.text}`"
        node = given.below["quaternion"]
        parts = self.vector(node, given.indices, [4], what)
        both = [
            self._moving(f"{name}.p{k}", tree, at) for k, (tree, at) in enumerate(parts)
        ]
        p, speeds = zip(*both, strict=True)
        square = total(product(x, x) for x in p)
        if all(x.op == "name" and self._is_coordinate(x) for x in p):
            text = " + ".join(f"{x.value}^2" for x in p) + " = 1"
            relation = ParsedRelation(parsed(square, text), parsed(ONE, text), "=")
            unit_length = UNIT_LENGTH + dotted(*called)
            self.x.units.append(self.x.made(unit_length, relation, given.key, text))
        n = scalar(self.x.hide(f"{name}.square", square, given.key), name)
        return by_quaternion(p, n, speeds)

    def _by_angles(self, called: Called, parent: Frame, name: str) -> Frame:
        """Rotations about the frame's own axes, one after the other."""
        given, axes = self._given[called], self._given[called].below["axes"]
        what = f"the frame `{given.key.text}`"
        letters = axes.text if isinstance(axes, Scalar) else ""
        if not re.fullmatch("[xyz]+", letters) or re.search(r"(.)\1", letters):
            text = f"`axes` of {what} must be letters x, y and z, none twice in a row"
            self.refuse("unknown-name", text, axes, "such as `axes: zxz`")
        node, count = given.below["angles"], len(letters)
        parts = self.vector(node, given.indices, [count], f"`angles` of {what}")
        both = [
            self._moving(f"{name}.angle{k}", tree, at)
            for k, (tree, at) in enumerate(parts, 1)
        ]
        frame, hide = parent, partial(self.x.hide, at=given.key)
        for k, (letter, turn) in enumerate(zip(letters, both, strict=True), 1):
            axis = tuple(ONE if letter == c else ZERO for c in LETTERS)
            step = name if k == count else f"{name}.{k}"
            frame = composed(step, frame, about(axis, *turn), hide)
        if count == len("zxz"):
            op = "sin" if letters[0] == letters[2] else "cos"
            angles = tuple(parsed(angle, "") for angle, _ in both)
            lock = parsed(call(op, both[1][0]), "")
            self.x.gimbals.append((dotted(*called), lock, angles))
        return frame
