"""Frames: rotated axes, on space or on one another.

The matrix and the angular velocity of a frame follow from the frame it is attached to
(`on`) and its own rotation; they are hidden definitions, see `trees`. A frame is
created on its first use, after all frames it is attached to.
"""

from __future__ import annotations

import math
import re
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from lagsim.codes.known import (
    BOTH_GIVEN,
    CYCLE,
    DUPLICATE_MEMBER,
    EXPRESSION_FRAME,
    MISSING_KEY,
    NOT_AN_EXPRESSION,
    NOT_CONSTANT,
    OUT_OF_RANGE,
    UNKNOWN_NAME,
    WRONG_COUNT,
)
from lagsim.errors import did_you_mean
from lagsim.language.names import UNIT_LENGTH, rate_of
from lagsim.language.parser import (
    SILENT,
    ExpressionError,
    ParsedRelation,
    parse,
    silent,
)
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
    described,
    name,
    number,
    parsed,
    product,
    scalar,
    space,
    total,
    unit,
)
from lagsim.model.nodes import Broken, Mapping, Scalar, Sequence, entries_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from collections.abc import Sequence as SequenceType

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.language.parser import Parsed, Steps
    from lagsim.model.expansion import Expansion
    from lagsim.model.expansion.scope import Indices
    from lagsim.model.nodes import Node

# A frame by its name and subscripts.
Called = tuple[str, tuple[int, ...]]
SPACE = "space"
_KEYS_OF_FRAME = ("on", "axis", "angle", "quaternion", "angles", "axes")
_SPACE: Called = (SPACE, ())
_ROTATED = (
    "write {on: ..., axis: [0, 0, 1], angle: q}, {quaternion: [p0, p1, p2, p3]}, "
)
_ROTATED += "{angles: [a, b, c], axes: zxz}, or in the plane {angle: q}"


class TurnedFrame(NamedTuple):
    """Frame in space and its rotation relative to its parent, as expressions.

    Attributes
    ----------
    parent : int
        Index of the parent among the frames in space; -1 for space.
    rows, turn : tuple of tuple of Parsed, shape (3, 3)
        The matrix R of the frame, and the matrix E of its rotation, R = P E.
    own, omega : tuple of Parsed, shape (3,)
        The angular velocities relative to the parent, and to space, in the components
        of the frame.
    """

    parent: int
    rows: tuple[tuple[Parsed, ...], ...]
    turn: tuple[tuple[Parsed, ...], ...]
    own: tuple[Parsed, ...]
    omega: tuple[Parsed, ...]


def _all_parsed(trees: Iterable[Tree]) -> tuple[Parsed, ...]:
    return tuple(parsed(x, "") for x in trees)


class _DeclaredFrame(NamedTuple):
    """Entry of `frames` in the file, for one member.

    `key` is the key of the entry, `below` has its values by key, and `indices` the
    values of the member's indices.
    """

    key: Scalar
    below: dict[str, Node]
    indices: Indices


def unknown(below: Iterable[str], keys: Iterable[str]) -> bool:
    """Whether a mapping with the keys `below` has a key that is not in `keys`."""
    return any(k not in keys and not k.startswith("x-") for k in below)


class SectionReader:
    """Reader of values in the sections of frames and bodies.

    Its methods report a fault, and then raise an ExpressionError without a message.

    Parameters
    ----------
    x : Expansion
        The expansion of the file.
    """

    def __init__(self, x: Expansion) -> None:
        self.x, self.scope, self.report = x, x.scope, x.report

    def refuse(
        self, code: ErrorCode, text: str, at: Place | Node, hint: str = ""
    ) -> NoReturn:
        """Report a fault at a place or node, then raise an ExpressionError.

        The error has no message, since the fault is already reported.
        """
        self.report(code, text, at, hint)
        raise silent()

    def value(self, node: Node, indices: Indices, label: str) -> tuple[Value, Scalar]:
        """Evaluate an expression of the file for a member of a family.

        Parameters
        ----------
        node
            The YAML node of the expression.
        indices
            Values of the member's indices.
        label
            Name of the expression in messages.

        Returns
        -------
        value
            A tree or, for a vector, a tuple of trees.
        at : Scalar
            The YAML scalar of the expression, for messages on the value.
        """
        if isinstance(node, Broken):
            raise silent()
        if not isinstance(node, Scalar) or node.empty:
            text = f"{label} must be an expression"
            self.refuse(NOT_AN_EXPRESSION, text, node)
        try:
            return self.scope.values(node.text, parse, indices)[0], node
        except ExpressionError as fault:
            self.x.fault(fault, node)
            raise silent() from None

    def with_rate(self, hidden: str, tree: Tree, at: Scalar) -> Tree:
        """Add a hidden definition that has a rate; return a reference to it.

        Energies use the rate; other hidden definitions have none.

        hidden : name of the definition.
        tree : its expression.
        at : the YAML scalar from which it stems.
        """
        found = scalar(self.x.add_hidden(hidden, tree, at), hidden)
        self.x.moving[str(found.value)] = at
        return found

    def number(self, node: Node, indices: Indices, label: str) -> tuple[Tree, Scalar]:
        """Evaluate an expression that must be a number; return its tree and scalar.

        Arguments and results as for `value`.
        """
        value, at = self.value(node, indices, label)
        if not isinstance(value, Tree):
            text = f"{label} must be a number, found {described(value)}"
            self.refuse(WRONG_COUNT, text, at.place_of(0, len(at.text)))
        return value, at

    def vector(
        self, node: Node, indices: Indices, counts: SequenceType[int], label: str
    ) -> list[tuple[Tree, Scalar]]:
        """Evaluate a list, or a vector expression; return its components.

        Each component is a pair of its tree and the YAML scalar from which it stems.

        counts : the permitted numbers of components. Other arguments as for `value`.
        """
        if isinstance(node, Sequence):
            found = [self.number(item, indices, label) for item in node.items]
        else:
            value, at = self.value(node, indices, label)
            parts = (value,) if isinstance(value, Tree) else value
            found = [(part, at) for part in parts]
        if len(found) not in counts:
            expected = " or ".join(map(str, counts))
            text = f"{label} must have {expected} components, found {len(found)}"
            self.refuse(WRONG_COUNT, text, node)
        return found


class FrameReader(SectionReader):
    """Frames of a file; each is created on its first use.

    Parameters
    ----------
    x : Expansion
        The expansion of the file.
    section : Node or None
        The section `frames`.

    Attributes
    ----------
    n : int
        Dimension of all frames: 2 for rotations in the plane, 3 for space.
    """

    def __init__(self, x: Expansion, section: Node | None) -> None:
        super().__init__(x)
        self._given: dict[Called, _DeclaredFrame] = {}
        self._broken: set[str] = set()
        self._making: set[Called] = set()
        given = entries_of(section)
        turning = {key.text for _, node in given for key, _ in entries_of(node)}
        self.n = 3 if turning & {"axis", "angles", "axes", "quaternion"} else 2
        self._frames: dict[Called, Frame | None] = {_SPACE: space(self.n)}
        for key, node in given:
            self._declare(key, node)

    def make_all(self) -> None:
        """Create all frames, and the constraints on their quaternions' lengths."""
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
                label = "is built in" if name == SPACE else "is given twice"
                text = f"the frame `{dotted(name, member)}` {label}"
                self.report(DUPLICATE_MEMBER, text, key)
                return
            self._given[name, member] = _DeclaredFrame(key, below, indices)

    def _sound(self, key: Scalar, node: Node, below: dict[str, Node]) -> bool:
        """Whether the keys of a frame's entry describe a rotation; else report a fault.

        below : the values of the entry by key.
        """
        label, report = f"the frame `{key.text}`", self.report
        if not isinstance(node, Mapping) and "on" in below:
            return True
        if unknown(below, _KEYS_OF_FRAME):
            return False
        ways = [k for k in ("angle", "angles", "quaternion") if k in below]
        pairs = [("axes", "angles"), ("angles", "axes"), ("axis", "angle")]
        pairs += [("angle", "axis")] if self.n > len("xy") else []
        for has, wants in pairs:
            if has in below and wants not in below:
                text = f"{label} has `{has}` but no `{wants}`"
                report(MISSING_KEY, text, key, _ROTATED)
                return False
        if not ways:
            report(MISSING_KEY, f"{label} has no rotation", key, _ROTATED)
        elif len(ways) > 1:
            text = f"{label} has both `{ways[0]}` and `{ways[1]}`"
            report(BOTH_GIVEN, text, key, _ROTATED)
        return len(ways) == 1

    # Frames by their names

    def named(self, node: Scalar, indices: Indices) -> Frame:
        """Return the frame whose name is the expression `node`, such as `arm(i)`.

        indices : values of the member's indices.
        """
        try:
            return self.named_by(self.scope.source(node.text, parse).postfix, indices)
        except ExpressionError as fault:
            self.x.fault(fault, node)
            raise silent() from None

    def named_by(self, steps: Steps, indices: Indices) -> Frame:
        """Return the frame whose name was parsed into `steps`, for a member.

        indices : values of the member's indices.
        """
        return self._frame_of(self._called(steps, indices))

    def _called(self, steps: Steps, indices: Indices) -> Called:
        """Return name and subscripts of the frame that parsed steps name, for a member.

        steps : postfix steps of a name such as `arm(i-1)`.
        indices : values of the member's indices.
        """
        *subscripts, (op, _, token) = steps
        if op not in ("name", "member"):
            raise token.fault(
                "the name of a frame is expected here", "", EXPRESSION_FRAME
            )
        values = self.scope.run(tuple(subscripts), indices)
        member = tuple(self.scope.whole(value, token) for value in values)
        name = token.text
        if (name, member) in self._given or (name, member) == _SPACE:
            return name, member
        if name in self._broken:
            raise token.fault("", "", SILENT)
        members = [m for other, m in self._given if other == name]
        hint = (
            did_you_mean(name, [SPACE, *(other for other, _ in self._given)])
            or _ROTATED
        )
        if members:
            ends = (dotted(name, m) for m in (min(members), max(members)))
            hint = "there are `{}` to `{}`".format(*ends)
        text = f"there is no frame `{dotted(name, member)}`"
        raise token.fault(text, hint, EXPRESSION_FRAME)

    def _frame_of(self, called: Called) -> Frame:
        """Return the frame with a name and subscripts, built after its parents.

        The parent of a frame is the frame that it is `on`.

        called : the name and the subscripts.
        """
        chain: list[Called] = []
        while called not in self._frames:
            if called in chain:
                circle = [*chain[chain.index(called) :], called]
                shown = " -> ".join(dotted(*one) for one in circle)
                text = f"the frame `{dotted(*called)}` is on itself: {shown}"
                node = self._given[called].below["on"]
                self.report(CYCLE, text, node)
                self._frames |= dict.fromkeys(chain)
                break
            chain.append(called)
            called = self._parent(called)
        for one in reversed(chain):
            if one in self._making:
                text = f"the frame `{dotted(*one)}` depends on itself"
                raise ExpressionError(0, 1, text, "", EXPRESSION_FRAME)
            if one not in self._frames:
                self._making.add(one)
                try:
                    self._frames[one] = self._frame(one)
                finally:
                    self._making.discard(one)
        frame = self._frames[chain[0] if chain else called]
        if frame is None:
            raise silent()
        return frame

    def _parent(self, called: Called) -> Called:
        """Return name and subscripts of the frame that a frame is `on`, or of space.

        called : name and subscripts of the frame.
        """
        given = self._given[called]
        node = given.below.get("on")
        if node is None:
            return _SPACE
        try:
            if not isinstance(node, Scalar):
                text = f"`on` of the frame `{given.key.text}` names a frame"
                self.refuse(NOT_AN_EXPRESSION, text, node, "such as on: arm")
            steps = self.scope.source(node.text, parse).postfix
            return self._called(steps, given.indices)
        except ExpressionError as fault:
            if isinstance(node, Scalar):
                self.x.fault(fault, node)
            self._frames[called] = None
            return _SPACE

    def _frame(self, called: Called) -> Frame | None:
        """Build a frame on its parent, which exists; None after a fault.

        called : name and subscripts of the frame.
        """
        given, parent = self._given[called], self._frames[self._parent(called)]
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
        return self._turned(name, parent, own, given.key)

    def _turned(self, name: str, parent: Frame, own: Chart, at: Scalar) -> Frame:
        """Return the frame with the rotation `own` relative to `parent`, and record it.

        name : the name of the frame.
        at : its scalar, for messages.
        """
        made = composed(name, parent, own, partial(self.x.add_hidden, at=at))
        assert not isinstance(made.omega, Tree)
        rows = tuple(map(_all_parsed, made.rows)), tuple(map(_all_parsed, own.rows))
        rates = _all_parsed(own.omega), _all_parsed(made.omega)
        made = made._replace(number=len(self.x.turned))
        self.x.turned.append(TurnedFrame(parent.number, *rows, *rates))
        return made

    def _number(self, given: _DeclaredFrame, key: str) -> tuple[Tree, Scalar]:
        label = f"the `{key}` of the frame `{given.key.text}`"
        return self.number(given.below[key], given.indices, label)

    def _moving(self, hidden: str, tree: Tree, at: Scalar) -> tuple[Tree, Tree]:
        """Return the trees of an angle (or a component) and of its rate, for energies.

        A constant has the rate 0; an expression becomes a hidden definition, see
        `SectionReader.with_rate`.

        hidden : name of that definition.
        tree : the angle.
        at : its YAML scalar.
        """
        if tree.op == "number":
            return tree, ZERO
        if tree.op != "name" or not self._is_coordinate(tree):
            tree = self.with_rate(hidden, tree, at)
        return tree, name(rate_of(str(tree.value)))

    def _is_coordinate(self, tree: Tree) -> bool:
        family = self.scope.variables.get(str(tree.value).partition(".")[0])
        return family is not None and family.section == "coordinates"

    # Rotations

    def _planar(self, given: _DeclaredFrame, parent: Frame, hidden: str) -> Frame:
        """Return a frame in the plane, whose angle adds to the angle of the parent.

        given : the entry.
        hidden : name of the hidden definition of the angle.
        """
        angle, speed = self._moving(f"{hidden}.turn", *self._number(given, "angle"))
        assert parent.angle is not None
        if parent.angle != ZERO:
            whole = total([parent.angle, angle])
            angle = scalar(
                self.x.add_hidden(f"{hidden}.angle", whole, given.key), hidden
            )
            speed = name(rate_of(str(angle.value)))
        c, s = call("cos", angle), call("sin", angle)
        return Frame(((c, call("neg", s)), (s, c)), speed, angle)

    def _axis(self, given: _DeclaredFrame, name: str) -> Vector:
        """Return the unit vector of a frame's key `axis`, made of parameters only.

        given : the entry of the frame.
        name : prefix of hidden definitions.
        """
        node, label = given.below["axis"], f"the `axis` of the frame `{given.key.text}`"
        parts = self.vector(node, given.indices, [3], label)
        values = [self._fixed(tree, at, label) for tree, at in parts]
        if not any(values) or not all(map(math.isfinite, values)):
            text = f"{label} has no direction: it is {values}"
            self.refuse(OUT_OF_RANGE, text, node, "such as [0, 0, 1]")
        # A rotation about x, y or z is expressed as such, which shortens all
        # expressions; with other values of its parameters the file is read again.
        if sum(value != 0.0 for value in values) == 1:
            self.scope.note_structural(*(tree for tree, _ in parts))
            signs = (float(value > 0.0) - float(value < 0.0) for value in values)
            return tuple(map(number, signs))
        raw = tuple(
            scalar(self.x.add_hidden(f"{name}.axis.{c}", tree, at), c)
            for c, (tree, at) in zip(LETTERS, parts, strict=True)
        )
        found = self.x.add_hidden(f"{name}.direction", unit(raw), given.key)
        assert not isinstance(found, Tree)
        return found

    def _fixed(self, tree: Tree, at: Scalar, label: str) -> float:
        """Return the number that `tree` is, an expression of parameters.

        at : the scalar of the expression.
        label : name in messages.
        """
        found = parsed(tree, at.text)
        for used in found.names:
            if used.text not in {*self.scope.numbers, *self.scope.of_tables}:
                family = self.scope.variables.get(used.text.partition(".")[0])
                if family and family.section == "parameters":
                    raise silent()
                text = f"{label} is made of parameters; `{used.text}` is none"
                place = at.place_of(used.offset, len(used.text))
                self.refuse(NOT_CONSTANT, text, place)
        try:
            return self.scope.number(found)
        except ExpressionError as fault:
            self.refuse(NOT_CONSTANT, fault.text, at, fault.hint)

    def _quaternion(self, called: Called, name: str) -> Chart:
        given = self._given[called]
        label = f"the quaternion of the frame `{given.key.text}`"
        node = given.below["quaternion"]
        parts = self.vector(node, given.indices, [4], label)
        both = [
            self._moving(f"{name}.p{k}", tree, at) for k, (tree, at) in enumerate(parts)
        ]
        p, speeds = zip(*both, strict=True)
        square = total(product(x, x) for x in p)
        if all(x.op == "name" and self._is_coordinate(x) for x in p):
            text = " + ".join(f"{x.value}^2" for x in p) + " = 1"
            relation = ParsedRelation(parsed(square, text), parsed(ONE, text), "=")
            unit_length = UNIT_LENGTH + dotted(*called)
            self.x.units.append(self.x.entry(unit_length, relation, given.key, text))
        n = scalar(self.x.add_hidden(f"{name}.square", square, given.key), name)
        return by_quaternion(p, n, speeds)

    def _by_angles(self, called: Called, parent: Frame, name: str) -> Frame:
        """Return the frame turned by angles about its own axes, one after the other.

        The letters of the key `axes` name the axes; the key `angles` has the angles.

        called, parent, name : name and subscripts of the frame, its parent, and its
            name with dots.
        """
        given, axes = self._given[called], self._given[called].below["axes"]
        label = f"the frame `{given.key.text}`"
        letters = axes.text if isinstance(axes, Scalar) else ""
        if not re.fullmatch("[xyz]+", letters) or re.search(r"(.)\1", letters):
            text = f"`axes` of {label} must be letters x, y and z, none twice in a row"
            self.refuse(UNKNOWN_NAME, text, axes, "such as `axes: zxz`")
        node, count = given.below["angles"], len(letters)
        parts = self.vector(node, given.indices, [count], f"`angles` of {label}")
        both = [
            self._moving(f"{name}.angle{k}", tree, at)
            for k, (tree, at) in enumerate(parts, 1)
        ]
        frame = parent
        for k, (letter, turn) in enumerate(zip(letters, both, strict=True), 1):
            axis = tuple(ONE if letter == c else ZERO for c in LETTERS)
            step = name if k == count else f"{name}.{k}"
            frame = self._turned(step, frame, about(axis, *turn), given.key)
        if count == len("zxz"):
            op = "sin" if letters[0] == letters[2] else "cos"
            angles = tuple(parsed(angle, "") for angle, _ in both)
            lock = parsed(call(op, both[1][0]), "")
            self.x.gimbals.append((dotted(*called), lock, angles))
        return frame
