"""Frames and bodies: inertia of shapes of uniform density, and energies of bodies.

The matrix and the angular velocity of a frame follow from the frame it is attached to
(`on`) and its own rotation; they are hidden definitions, see `trees`. A frame is
created on its first use, after all frames it is attached to.

Sources: J. L. Meriam, L. G. Kraige, Engineering Mechanics: Dynamics, table D/4; of a
polygon, C. Steger, On the Calculation of Arbitrary Moments of Polygons (1996).
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
    RESERVED_NAME,
    UNKNOWN_NAME,
    WRONG_COUNT,
)
from lagsim.errors import did_you_mean
from lagsim.language.names import HIDDEN, UNIT_LENGTH, rate_of
from lagsim.language.parser import (
    SILENT,
    ExpressionError,
    ParsedRelation,
    parse,
    silent,
)
from lagsim.model.expansion import trees
from lagsim.model.expansion.scope import MemberReading, dotted
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
    cross,
    name,
    number,
    parsed,
    product,
    rotate,
    said,
    scalar,
    space,
    spin,
    total,
    unit,
)
from lagsim.model.nodes import Broken, Mapping, Scalar, Sequence, entries_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from collections.abc import Sequence as SequenceType

    from lagsim.codes.known import ErrorCode
    from lagsim.errors import Place
    from lagsim.language.parser import Parsed, Steps
    from lagsim.model.expansion import Expansion
    from lagsim.model.expansion.scope import Indices
    from lagsim.model.nodes import Entry, Node


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


def _all_parsed(some: Iterable[Tree]) -> tuple[Parsed, ...]:
    return tuple(parsed(x, "") for x in some)


class _DeclaredFrame(NamedTuple):
    """Frame as the file declares it, for one member: values by their keys."""

    key: Scalar
    below: dict[str, Node]
    indices: Indices


def unknown(below: Iterable[str], keys: Iterable[str]) -> bool:
    """Whether a mapping with the keys `below` has others than `keys`."""
    return any(k not in keys and not k.startswith("x-") for k in below)


class SectionReader:
    """Reader of values in the sections of frames and bodies.

    A fault is reported first; then an ExpressionError without a message is raised.
    """

    def __init__(self, x: Expansion) -> None:
        self.x, self.scope, self.report = x, x.scope, x.report

    def refuse(
        self, code: ErrorCode, text: str, at: Place | Node, hint: str = ""
    ) -> NoReturn:
        """Report a fault at a place or node, then raise an ExpressionError.

        The error has no message, since the fault is reported.
        """
        self.report(code, text, at, hint)
        raise silent()

    def value(self, node: Node, indices: Indices, what: str) -> tuple[Value, Scalar]:
        """Return the value of the expression `node` for a member, and its scalar.

        indices : values of the member's indices. what : the expression's name in
        messages.
        """
        if isinstance(node, Broken):
            raise silent()
        if not isinstance(node, Scalar) or node.empty:
            text = f"{what} must be an expression"
            self.refuse(NOT_AN_EXPRESSION, text, node)
        try:
            return self.scope.values(node.text, parse, indices)[0], node
        except ExpressionError as fault:
            self.x.fault(fault, node)
            raise silent() from None

    def moved(self, hidden: str, tree: Tree, at: Scalar) -> Tree:
        """Add a hidden definition with the expression `tree`; return a reference to it.

        Unlike other hidden definitions it has a rate, which energies use. hidden : its
        name. at : the scalar of the file from which it stems.
        """
        found = scalar(self.x.hide(hidden, tree, at), hidden)
        self.x.moving[str(found.value)] = at
        return found

    def number(self, node: Node, indices: Indices, what: str) -> tuple[Tree, Scalar]:
        """Return the value, which must be a number, of an expression, and its scalar.

        Arguments as for `value`.
        """
        value, at = self.value(node, indices, what)
        if not isinstance(value, Tree):
            text = f"{what} must be a number, found {said(value)}"
            self.refuse(WRONG_COUNT, text, at.place_of(0, len(at.text)))
        return value, at

    def vector(
        self, node: Node, indices: Indices, counts: SequenceType[int], what: str
    ) -> list[tuple[Tree, Scalar]]:
        """Return the components of a list, or of a vector expression, with scalars.

        Each is a pair of its value and the scalar of the file from which it stems.
        counts : the numbers of components that are allowed.
        """
        if isinstance(node, Sequence):
            found = [self.number(item, indices, what) for item in node.items]
        else:
            value, at = self.value(node, indices, what)
            parts = (value,) if isinstance(value, Tree) else value
            found = [(part, at) for part in parts]
        if len(found) not in counts:
            wanted = " or ".join(map(str, counts))
            text = f"{what} must have {wanted} components, found {len(found)}"
            self.refuse(WRONG_COUNT, text, node)
        return found


class FrameReader(SectionReader):
    """Frames of a file; each is created on its first use.

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
        self._made: dict[Called, Frame | None] = {_SPACE: space(self.n)}
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
                what = "is built in" if name == SPACE else "is given twice"
                text = f"the frame `{dotted(name, member)}` {what}"
                self.report(DUPLICATE_MEMBER, text, key)
                return
            self._given[name, member] = _DeclaredFrame(key, below, indices)

    def _sound(self, key: Scalar, node: Node, below: dict[str, Node]) -> bool:
        """Whether the keys of a frame's entry form a rotation.

        If not, a fault is reported.

        below : the values by key.
        """
        what, report = f"the frame `{key.text}`", self.report
        if not isinstance(node, Mapping) and "on" in below:
            return True
        if unknown(below, _KEYS_OF_FRAME):
            return False
        ways = [k for k in ("angle", "angles", "quaternion") if k in below]
        pairs = [("axes", "angles"), ("angles", "axes"), ("axis", "angle")]
        pairs += [("angle", "axis")] if self.n > len("xy") else []
        for has, wants in pairs:
            if has in below and wants not in below:
                text = f"{what} has `{has}` but no `{wants}`"
                report(MISSING_KEY, text, key, _ROTATED)
                return False
        if not ways:
            report(MISSING_KEY, f"{what} has no rotation", key, _ROTATED)
        elif len(ways) > 1:
            text = f"{what} has both `{ways[0]}` and `{ways[1]}`"
            report(BOTH_GIVEN, text, key, _ROTATED)
        return len(ways) == 1

    # Frames by their names

    def named(self, node: Scalar, indices: Indices) -> Frame:
        """Return the frame whose name is the expression `node`, such as `arm(i)`."""
        try:
            return self.named_by(self.scope.source(node.text, parse).postfix, indices)
        except ExpressionError as fault:
            self.x.fault(fault, node)
            raise silent() from None

    def named_by(self, steps: Steps, indices: Indices) -> Frame:
        """Return the frame whose name was parsed into `steps`."""
        return self._frame_of(self._called(steps, indices))

    def _called(self, steps: Steps, indices: Indices) -> Called:
        """Return name and subscripts of a frame, parsed into `steps`."""
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
        """Return the frame of a name and subscripts, built after its parents."""
        chain: list[Called] = []
        while called not in self._made:
            if called in chain:
                circle = [*chain[chain.index(called) :], called]
                shown = " -> ".join(dotted(*one) for one in circle)
                text = f"the frame `{dotted(*called)}` is on itself: {shown}"
                node = self._given[called].below["on"]
                self.report(CYCLE, text, node)
                self._made |= dict.fromkeys(chain)
                break
            chain.append(called)
            called = self._parent(called)
        for one in reversed(chain):
            if one in self._making:
                text = f"the frame `{dotted(*one)}` depends on itself"
                raise ExpressionError(0, 1, text, "", EXPRESSION_FRAME)
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
        """Return name and subscripts of the frame that is the parent (`on`)."""
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
            self._made[called] = None
            return _SPACE

    def _frame(self, called: Called) -> Frame | None:
        """Return a new frame on its parent, which exists.

        None where a fault was reported.
        """
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
        return self._turned(name, parent, own, given.key)

    def _turned(self, name: str, parent: Frame, own: Chart, at: Scalar) -> Frame:
        """Return the frame of a rotation `own` relative to `parent`, and record it."""
        made = composed(name, parent, own, partial(self.x.hide, at=at))
        assert not isinstance(made.omega, Tree)
        rows = tuple(map(_all_parsed, made.rows)), tuple(map(_all_parsed, own.rows))
        rates = _all_parsed(own.omega), _all_parsed(made.omega)
        made = made._replace(number=len(self.x.turned))
        self.x.turned.append(TurnedFrame(parent.number, *rows, *rates))
        return made

    def _number(self, given: _DeclaredFrame, key: str) -> tuple[Tree, Scalar]:
        what = f"the `{key}` of the frame `{given.key.text}`"
        return self.number(given.below[key], given.indices, what)

    def _moving(self, hidden: str, tree: Tree, at: Scalar) -> tuple[Tree, Tree]:
        """Return an angle or component, and its rate, as trees that energies can use.

        An expression becomes a hidden definition, see `Section.moved`.
        """
        if tree.op == "number":
            return tree, ZERO
        if tree.op != "name" or not self._is_coordinate(tree):
            tree = self.moved(hidden, tree, at)
        return tree, name(rate_of(str(tree.value)))

    def _is_coordinate(self, tree: Tree) -> bool:
        family = self.scope.variables.get(str(tree.value).partition(".")[0])
        return family is not None and family.section == "coordinates"

    # Rotations

    def _planar(self, given: _DeclaredFrame, parent: Frame, hidden: str) -> Frame:
        """Return a frame in the plane; its angle is added to that of its parent."""
        angle, speed = self._moving(f"{hidden}.turn", *self._number(given, "angle"))
        assert parent.angle is not None
        if parent.angle != ZERO:
            whole = total([parent.angle, angle])
            angle = scalar(self.x.hide(f"{hidden}.angle", whole, given.key), hidden)
            speed = name(rate_of(str(angle.value)))
        c, s = call("cos", angle), call("sin", angle)
        return Frame(((c, call("neg", s)), (s, c)), speed, angle)

    def _axis(self, given: _DeclaredFrame, name: str) -> Vector:
        """Return the unit vector of a frame's `axis`, made of parameters only."""
        node, what = given.below["axis"], f"the `axis` of the frame `{given.key.text}`"
        parts = self.vector(node, given.indices, [3], what)
        values = [self._fixed(tree, at, what) for tree, at in parts]
        if not any(values) or not all(map(math.isfinite, values)):
            text = f"{what} has no direction: it is {values}"
            self.refuse(OUT_OF_RANGE, text, node, "such as [0, 0, 1]")
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
        """Return the number that `tree` is, an expression of parameters.

        at : its scalar. what : its name in messages.
        """
        found = parsed(tree, at.text)
        for used in found.names:
            if used.text not in {*self.scope.numbers, *self.scope.of_tables}:
                family = self.scope.variables.get(used.text.partition(".")[0])
                if family and family.section == "parameters":
                    raise silent()
                text = f"{what} is made of parameters; `{used.text}` is none"
                place = at.place_of(used.offset, len(used.text))
                self.refuse(NOT_CONSTANT, text, place)
        try:
            return self.scope.number(found)
        except ExpressionError as fault:
            self.refuse(NOT_CONSTANT, fault.text, at, fault.hint)

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
        """Return the frame by rotations about its own axes, one after the other.

        The letters of `axes` name the axes, and `angles` has the angles.
        """
        given, axes = self._given[called], self._given[called].below["axes"]
        what = f"the frame `{given.key.text}`"
        letters = axes.text if isinstance(axes, Scalar) else ""
        if not re.fullmatch("[xyz]+", letters) or re.search(r"(.)\1", letters):
            text = f"`axes` of {what} must be letters x, y and z, none twice in a row"
            self.refuse(UNKNOWN_NAME, text, axes, "such as `axes: zxz`")
        node, count = given.below["angles"], len(letters)
        parts = self.vector(node, given.indices, [count], f"`angles` of {what}")
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


class Solid(NamedTuple):
    """Inertia of a shape about its centre of mass, and the centre in the frame."""

    inertia: Value
    centre: Vector


def _of(m: Tree, *terms: tuple[float, Tree]) -> Tree:
    """Return the moment of inertia m (a x^2 + b y^2 + ...).

    terms : pairs of a factor a and a length x
    """
    squares = (product(number(c), call("pow", x, number(2.0))) for c, x in terms)
    return product(m, total(squares))


def _about_z(m: Tree, r: Tree, own: float, *across: tuple[float, Tree]) -> Vector:
    """Return the principal moments of a body of revolution about z.

    own : the factor of m r^2 in the moment about z; across : `_of`'s terms for x and y
    """
    return (_of(m, *across),) * 2 + (_of(m, (own, r)),)


def solid(kind: str, m: Tree, sizes: SequenceType[Tree], n: int) -> Solid:
    """Return the inertia of a shape of uniform density.

    kind : name of the shape. m : its mass. sizes : its lengths. n : 2 or 3, the number
    of axes.
    """
    a = sizes[0]
    b, c = (*sizes[1:], ZERO, ZERO)[:2]
    nowhere = (ZERO,) * n
    if n == len("xy"):
        flat = {"disk": ((0.5, a),), "ring": ((1.0, a),)}
        box = (1 / 12, a), (1 / 12, b)
        return Solid(_of(m, *flat.get(kind, box)), nowhere)
    if kind == "box":
        x, y, z = (1 / 12, a), (1 / 12, b), (1 / 12, c)
        return Solid((_of(m, y, z), _of(m, x, z), _of(m, x, y)), nowhere)
    if kind == "cone":
        above = ZERO, ZERO, product(number(0.75), b)
        return Solid(_about_z(m, a, 0.3, (3 / 20, a), (3 / 80, b)), above)
    if kind == "cylinder":
        return Solid(_about_z(m, a, 0.5, (1 / 4, a), (1 / 12, b)), nowhere)
    own, across = {"disk": (0.5, 0.25), "ring": (1.0, 0.5), "sphere": (0.4, 0.4)}[kind]
    return Solid(_about_z(m, a, own, (across, a)), nowhere)


def polygon(m: Tree, corners: SequenceType[Vector]) -> Solid:
    """Return the inertia of a plane polygon of mass m with the given corners.

    The corners may be in either orientation.
    """
    areas, moments, centres = [], [], []
    for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
        area = cross(a, b)
        assert isinstance(area, Tree)
        squares = [product(x, y) for u, v in ((a, a), (a, b), (b, b))
                   for x, y in zip(u, v, strict=True)]  # fmt: skip
        areas.append(area)
        moments.append(product(area, total(squares)))
        centres.append([product(area, total(pair)) for pair in zip(a, b, strict=True)])
    whole = total(areas)

    def mean(parts: SequenceType[Tree], factor: float) -> Tree:
        return call("div", total(parts), product(number(factor), whole))

    centre = tuple(mean(parts, 3.0) for parts in zip(*centres, strict=True))
    off = total(product(x, x) for x in centre)
    about = call("sub", mean(moments, 6.0), off)
    return Solid(product(m, about), centre)


# --- The section `bodies`

# Kinds of shapes in the plane and in space, and how many sizes each has.
SIZES = {
    2: {"disk": 1, "ring": 1, "box": 2, "polygon": 0},
    3: {"disk": 1, "ring": 1, "sphere": 1, "cylinder": 2, "cone": 2, "box": 3},
}
KEYS = ("mass", "at", "frame", "inertia", "shape")
_HOW = "write {mass: m, at: [x, y, z], frame: f, inertia: J}, or `shape` for `inertia`"


class _Body(NamedTuple):
    """Body as the file declares it, for one member."""

    what: str
    name: str
    below: dict[str, Node]
    indices: Indices


class Drawn(NamedTuple):
    """Shape of a body: its name, kind with sizes, origin, and frame."""

    name: str
    kind: Entry
    indices: Indices
    origin: Vector
    frame: Frame | None


class Bodies(SectionReader):
    """Bodies of a file: their energies, and their shapes for the scene.

    Attributes
    ----------
    drawn : list of Drawn
        Shapes of the bodies.
    """

    def __init__(
        self, x: Expansion, section: Node | None, gravity: Node | None
    ) -> None:
        super().__init__(x)
        self._energies: dict[str, list[Tree]] = {"kinetic": [], "potential": []}
        self._given, self._weighs = bool(entries_of(section)), gravity is not None
        self._said: set[str] = set()
        self.drawn: list[Drawn] = []
        self._gravity: Vector = ()
        self._names: set[str] = set()
        if gravity is not None:
            with suppress(ExpressionError):
                parts = self.vector(gravity, {}, [2, 3], "`gravity`")
                pairs = zip(LETTERS, parts, strict=False)
                self._gravity = tuple(self._kept(f"gravity.{c}", p) for c, p in pairs)
        for key, node in entries_of(section):
            with suppress(ExpressionError):  # reported
                self._entry(key, {k.text: value for k, value in entries_of(node)})

    def word(self, key: str, node: Scalar) -> Tree | None:
        """Return the expression for the word `bodies` in an energy.

        None without the word.

        key : `kinetic` or `potential`. node : the energy's expression.
        """
        if key not in self._energies or not re.search(r"\bbodies\b", node.text):
            return None
        self._said.add(key)
        if family := self.scope.variables.get("bodies"):
            text = "`bodies` is the word for the energies of bodies in this file"
            self.report(RESERVED_NAME, text, family.place)
        if key == "potential" and self._given and not self._weighs:
            text = "`bodies` in the potential energy needs `gravity`"
            self.report(MISSING_KEY, text, node, "such as gravity: [0, 0, -g]")
        return total(self._energies[key])

    def idle(self) -> list[str]:
        """Return texts on keys without effect, for warnings."""
        found = []
        if self._given and "kinetic" not in self._said:
            found.append("`bodies` do not act: `kinetic` lacks the word `bodies`")
        if self._weighs and "potential" not in self._said:
            found.append("`gravity` does not act: `potential` lacks the word `bodies`")
        return found

    def _kept(self, hidden: str, found: tuple[Tree, Scalar]) -> Tree:
        """Return a number as it is; another expression as a hidden definition's name.

        hidden : the definition's name. found : the expression with its scalar.
        """
        tree, at = found
        return (
            tree if tree.op == "number" else scalar(self.x.hide(hidden, tree, at), "")
        )

    def _entry(self, key: Scalar, below: dict[str, Node]) -> None:
        """Add the bodies that an entry of the section `bodies` declares.

        below : the values of the entry by key.
        """
        found, what = self.x.members(key, "a body"), f"the body `{key.text}`"
        missing = [k for k in ("mass", "at") if k not in below]
        if "frame" in below and not below.keys() & {"inertia", "shape"}:
            missing.append("inertia` or `shape")
        elif "inertia" in below and "frame" not in below:
            missing.append("frame")
        if unknown(below, KEYS):
            return
        for k in missing:
            self.report(MISSING_KEY, f"{what} has no `{k}`", key, _HOW)
        if found is None or missing:
            return
        for indices, member in found[1]:
            name = dotted(found[0].name, member)
            if name in self._names:
                text = f"the body `{name}` is given twice"
                self.refuse(DUPLICATE_MEMBER, text, key)
            self._names.add(name)
            self._body(_Body(what, name, below, indices))

    def _body(self, one: _Body) -> None:
        """Add the kinetic and potential energy of a body to the file's energies."""
        what, name, below, indices = one
        mass = self.number(below["mass"], indices, f"the mass of {what}")
        m = self._kept(f"body.{name}.mass", mass)
        parts = self.vector(below["at"], indices, [2, 3], f"`at` of {what}")
        pairs = zip(LETTERS, parts, strict=False)
        at = tuple(self.moved(f"body.{name}.{c}", *part) for c, part in pairs)
        speeds = [trees.name(rate_of(str(x.value))) for x in at]
        squares = total(product(v, v) for v in speeds)
        energy = call("div", product(m, squares), number(2.0))
        if self._gravity:
            self._same(one, len(self._gravity), "`gravity`", len(at))
            height = total(
                product(a, b) for a, b in zip(self._gravity, at, strict=True)
            )
            self._energies["potential"].append(call("neg", product(m, height)))
        frame = self._frame(one, len(at))
        solid = self._solid(one, m, len(at), frame, at)
        if frame:
            inertia = self._inertia(one, len(at)) or (solid and solid.inertia)
            assert inertia is not None
            energy = call("add", energy, spin(inertia, frame.omega))
        self._energies["kinetic"].append(energy)

    def _same(self, one: _Body, n: int, other: str, count: int) -> None:
        if n != count:
            text = f"`at` of {one.what} has {count} components, and {other} has {n}"
            self.refuse(WRONG_COUNT, text, one.below["at"])

    def _frame(self, one: _Body, n: int) -> Frame | None:
        node, frames = one.below.get("frame"), self.x.frames
        if not isinstance(node, Scalar):
            return None
        if frames is None:
            text = f"there is no frame `{node.text}`: the file has no `frames`"
            self.refuse(EXPRESSION_FRAME, text, node)
        self._same(one, frames.n, "its frame", n)
        return frames.named(node, one.indices)

    def _inertia(self, one: _Body, n: int) -> Value | None:
        """Return the moments of inertia given by the key `inertia`, or None."""
        node = one.below.get("inertia")
        if node is None:
            return None
        what, counts = f"the inertia of {one.what}", [1, 3, 6] if n > 2 else [1]
        parts = self.vector(node, one.indices, counts, what)
        kept = [
            self._kept(f"body.{one.name}.J{k}", part) for k, part in enumerate(parts)
        ]
        return tuple(kept) if len(kept) > 1 else kept[0]

    def _solid(
        self, one: _Body, m: Tree, n: int, frame: Frame | None, at: Vector
    ) -> Solid | None:
        """Return the inertia of a body's shape, or None without a shape.

        The shape is added to `drawn`.
        """
        node, what = one.below.get("shape"), f"the shape of {one.what}"
        if node is None:
            return None
        given = entries_of(node)
        if len(given) != 1:
            text = f"{what} must be one, such as {{box: [a, b]}}, found {len(given)}"
            self.refuse(WRONG_COUNT, text, node)
        key, value = given[0]
        kind, known = key.text, SIZES[n]
        if kind not in known:
            hint = did_you_mean(kind, known) or f"there are {', '.join(known)}"
            text = f"{what} cannot be a `{kind}`"
            if kind in SIZES[5 - n]:
                text += " in the plane" if n == len("xy") else " in space"
            self.refuse(UNKNOWN_NAME, text, key, hint)
        if kind == "polygon":
            found = self._polygon(one, m, value)
        else:
            parts = self.vector(value, one.indices, [known[kind]], what)
            pairs = enumerate(parts, 1)
            sizes = [self._kept(f"body.{one.name}.size{k}", part) for k, part in pairs]
            found = solid(kind, m, sizes, n)
        off = rotate(frame, found.centre) if frame else found.centre
        origin = tuple(
            call("sub", x, c) if c != ZERO else x for x, c in zip(at, off, strict=True)
        )
        self.drawn.append(Drawn(one.name, given[0], one.indices, origin, frame))
        return found

    def _polygon(self, one: _Body, m: Tree, node: Node) -> Solid:
        what = f"the polygon of {one.what}"
        if not isinstance(node, Sequence) or len(node.items) < len("xyz"):
            text = f"{what} must be a list of 3 or more corners [x, y]"
            self.refuse(WRONG_COUNT, text, node)
        corners = []
        for k, item in enumerate(node.items):
            parts = self.vector(item, one.indices, [2], f"a corner of {what}")
            pairs = zip(LETTERS, parts, strict=False)
            name = f"body.{one.name}.corner{k}"
            corners.append(tuple(self._kept(f"{name}.{c}", part) for c, part in pairs))
        return polygon(m, corners)


# --- The shapes of a scene: frames as entries of matrices, and those of bodies


class Shapes(SectionReader):
    """Expansion of the section `shapes`, and the shapes of bodies."""

    def given(self, section: Node | None) -> Iterator[Entry]:
        """Return the shapes of the section `shapes`, one entry per member."""
        for key, node in entries_of(section):
            if "(" not in key.text:
                yield key, self._written(node, self.x.plain)
            elif found := self.x.members(key, "a shape"):
                for indices, member in found[1]:
                    reading = MemberReading(self.scope, indices)
                    name = dotted(found[0].name, member)
                    full = key._replace(text=name, reading=reading)
                    yield full, self._written(node, reading)

    def of_bodies(self, drawn: Iterable[Drawn]) -> Iterator[Entry]:
        """Return entries of the section `shapes` for the shapes of bodies."""
        for one in drawn:
            key, value = one.kind
            reading = MemberReading(self.scope, one.indices)
            below = [(key, self.x.bound(value, reading))]
            below.append((key._replace(text="at"), self._list(one.origin, key)))
            if one.frame:
                axes = self._axes(one.frame, key)
                below.append((key._replace(text="frame"), axes))
            name = key._replace(text=one.name, reading=reading)
            yield name, Mapping(tuple(below), key.place)

    def _written(self, node: Node, reading: MemberReading) -> Node:
        rules = {"frame": self._turned, "at": self._point, "arrow": self.x.spread}
        return self.x.bound(node, reading, rules)

    def _turned(self, node: Node, reading: MemberReading) -> Node:
        """Return the rotation matrix of a shape.

        An expression that names no frame is an angle.
        """
        frames = self.x.frames
        if isinstance(node, Scalar) and frames is not None:
            try:
                steps = self.scope.source(node.text, parse).postfix
                return self._axes(frames.named_by(steps, reading.indices), node)
            except ExpressionError:  # a name that is no frame's, or a faulty frame
                pass
        return self.x.bound(node, reading)

    def _point(self, node: Node, reading: MemberReading) -> Node:
        """Return the position of a shape: a point, a family's point, or a vector."""
        name = re.split(r"[(.]", node.text)[0] if isinstance(node, Scalar) else ""
        if name in self.x.points:
            return self.x.denoted(node, self.x.points, reading.indices)[0]
        return self.x.spread(node, reading)

    def _axes(self, frame: Frame, at: Scalar) -> Sequence:
        rows = tuple(self._list(row, at) for row in frame.rows)
        return Sequence(rows, at.place)

    def _list(self, parts: Iterable[Tree], at: Scalar) -> Sequence:
        made = (self.x.made(f"{HIDDEN}{at.text}", parsed(x, ""), at) for x in parts)
        return Sequence(tuple(key for key, _ in made), at.place)
