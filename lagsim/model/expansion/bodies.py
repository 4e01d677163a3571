"""Bodies: inertia of shapes of uniform density, and energies of bodies.

Sources: J. L. Meriam, L. G. Kraige, Engineering Mechanics: Dynamics, table D/4; of a
polygon, C. Steger, On the Calculation of Arbitrary Moments of Polygons (1996).
"""

from __future__ import annotations

import re
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import (
    DUPLICATE_MEMBER,
    EXPRESSION_FRAME,
    MISSING_KEY,
    RESERVED_NAME,
    UNKNOWN_NAME,
    WRONG_COUNT,
)
from lagsim.errors import did_you_mean
from lagsim.language.names import HIDDEN, rate_of
from lagsim.language.parser import (
    ExpressionError,
    parse,
)
from lagsim.model.expansion import trees
from lagsim.model.expansion.frames import SectionReader, unknown
from lagsim.model.expansion.scope import MemberReading, dotted
from lagsim.model.expansion.trees import (
    LETTERS,
    ZERO,
    Frame,
    Tree,
    Value,
    Vector,
    call,
    cross,
    number,
    parsed,
    product,
    rotate,
    scalar,
    spin,
    total,
)
from lagsim.model.nodes import Mapping, Scalar, Sequence, entries_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from collections.abc import Sequence as SequenceType

    from lagsim.model.expansion import Expansion
    from lagsim.model.expansion.scope import Indices
    from lagsim.model.nodes import Entry, Node


class Solid(NamedTuple):
    """Moments of inertia of a shape about its centre of mass, and that centre.

    Both are in the axes of the body's frame.
    """

    inertia: Value
    centre: Vector


def _of(m: Tree, *terms: tuple[float, Tree]) -> Tree:
    """Return the moment of inertia m (a x^2 + b y^2 + ...) as a tree.

    terms : pairs of a factor a and a length x.
    """
    squares = (product(number(c), call("pow", x, number(2.0))) for c, x in terms)
    return product(m, total(squares))


def _about_z(m: Tree, r: Tree, own: float, *across: tuple[float, Tree]) -> Vector:
    """Return the principal moments of a body of revolution about z.

    m, r : mass and radius.
    own : the factor of m r^2 in the moment about z.
    across : terms of the moments about x and y, see `_of`.
    """
    return (_of(m, *across),) * 2 + (_of(m, (own, r)),)


def solid(kind: str, m: Tree, sizes: SequenceType[Tree], n: int) -> Solid:
    """Return the inertia of a shape of uniform density.

    kind : name of the shape.
    m : its mass.
    sizes : its lengths.
    n : 2 or 3, the number of axes.
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
    """Entry of `bodies` in the file, for one member.

    `label` is its name in messages, `name` its name, `below` has the values of the
    entry by key, and `indices` the values of the member's indices.
    """

    label: str
    name: str
    below: dict[str, Node]
    indices: Indices


class Drawn(NamedTuple):
    """Shape of a body, to be drawn: name, kind with sizes, origin, and frame.

    `indices` are the values of the member's indices.
    """

    name: str
    kind: Entry
    indices: Indices
    origin: Vector
    frame: Frame | None


class Bodies(SectionReader):
    """Bodies of a file: their energies, and their shapes for the scene.

    Parameters
    ----------
    x : Expansion
        The expansion of the file.
    section : Node or None
        The section `bodies`.
    gravity : Node or None
        The vector of gravity.

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
                self._gravity = tuple(self._named(f"gravity.{c}", p) for c, p in pairs)
        for key, node in entries_of(section):
            with suppress(ExpressionError):  # reported
                self._entry(key, {k.text: value for k, value in entries_of(node)})

    def word(self, key: str, node: Scalar) -> Tree | None:
        """Return the total energy of all bodies, which the word `bodies` denotes.

        None if the energy does not contain the word.

        key : `kinetic` or `potential`.
        node : the energy's expression in the file.
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

    def unused_keys(self) -> list[str]:
        """Return texts, for warnings, on keys of the section that have no effect."""
        found = []
        if self._given and "kinetic" not in self._said:
            found.append("`bodies` do not act: `kinetic` lacks the word `bodies`")
        if self._weighs and "potential" not in self._said:
            found.append("`gravity` does not act: `potential` lacks the word `bodies`")
        return found

    def _named(self, hidden: str, found: tuple[Tree, Scalar]) -> Tree:
        """Return a tree that can be used often at little cost: a number or a reference.

        An expression becomes a hidden definition, to which the reference refers.

        hidden : its name.
        found : the expression, and its YAML scalar.
        """
        tree, at = found
        return (
            tree
            if tree.op == "number"
            else scalar(self.x.add_hidden(hidden, tree, at), "")
        )

    def _entry(self, key: Scalar, below: dict[str, Node]) -> None:
        """Store the bodies that an entry of the section `bodies` declares.

        below : the values of the entry by key.
        """
        found, label = self.x.members(key, "a body"), f"the body `{key.text}`"
        missing = [k for k in ("mass", "at") if k not in below]
        if "frame" in below and not below.keys() & {"inertia", "shape"}:
            missing.append("inertia` or `shape")
        elif "inertia" in below and "frame" not in below:
            missing.append("frame")
        if unknown(below, KEYS):
            return
        for k in missing:
            self.report(MISSING_KEY, f"{label} has no `{k}`", key, _HOW)
        if found is None or missing:
            return
        for indices, member in found[1]:
            name = dotted(found[0].name, member)
            if name in self._names:
                text = f"the body `{name}` is given twice"
                self.refuse(DUPLICATE_MEMBER, text, key)
            self._names.add(name)
            self._body(_Body(label, name, below, indices))

    def _body(self, one: _Body) -> None:
        """Add the kinetic and potential energy of a body to the file's energies."""
        label, name, below, indices = one
        mass = self.number(below["mass"], indices, f"the mass of {label}")
        m = self._named(f"body.{name}.mass", mass)
        parts = self.vector(below["at"], indices, [2, 3], f"`at` of {label}")
        pairs = zip(LETTERS, parts, strict=False)
        at = tuple(self.with_rate(f"body.{name}.{c}", *part) for c, part in pairs)
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
            text = f"`at` of {one.label} has {count} components, and {other} has {n}"
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
        """Return the moments of inertia from the key `inertia`; None without the key.

        n : 2 or 3, the number of axes.
        """
        node = one.below.get("inertia")
        if node is None:
            return None
        label, counts = f"the inertia of {one.label}", [1, 3, 6] if n > 2 else [1]
        parts = self.vector(node, one.indices, counts, label)
        named = [
            self._named(f"body.{one.name}.J{k}", part) for k, part in enumerate(parts)
        ]
        return tuple(named) if len(named) > 1 else named[0]

    def _solid(
        self, one: _Body, m: Tree, n: int, frame: Frame | None, at: Vector
    ) -> Solid | None:
        """Return the inertia of a body's shape; None without a shape.

        The shape is added to `drawn`.

        m : the mass.
        n : the number of axes.
        frame, at : axes of the body, and the position of its origin.
        """
        node, label = one.below.get("shape"), f"the shape of {one.label}"
        if node is None:
            return None
        given = entries_of(node)
        if len(given) != 1:
            text = f"{label} must be one, such as {{box: [a, b]}}, found {len(given)}"
            self.refuse(WRONG_COUNT, text, node)
        key, value = given[0]
        kind, known = key.text, SIZES[n]
        if kind not in known:
            hint = did_you_mean(kind, known) or f"there are {', '.join(known)}"
            text = f"{label} cannot be a `{kind}`"
            if kind in SIZES[5 - n]:
                text += " in the plane" if n == len("xy") else " in space"
            self.refuse(UNKNOWN_NAME, text, key, hint)
        if kind == "polygon":
            found = self._polygon(one, m, value)
        else:
            parts = self.vector(value, one.indices, [known[kind]], label)
            pairs = enumerate(parts, 1)
            sizes = [self._named(f"body.{one.name}.size{k}", part) for k, part in pairs]
            found = solid(kind, m, sizes, n)
        off = rotate(frame, found.centre) if frame else found.centre
        origin = tuple(
            call("sub", x, c) if c != ZERO else x for x, c in zip(at, off, strict=True)
        )
        self.drawn.append(Drawn(one.name, given[0], one.indices, origin, frame))
        return found

    def _polygon(self, one: _Body, m: Tree, node: Node) -> Solid:
        label = f"the polygon of {one.label}"
        if not isinstance(node, Sequence) or len(node.items) < len("xyz"):
            text = f"{label} must be a list of 3 or more corners [x, y]"
            self.refuse(WRONG_COUNT, text, node)
        corners = []
        for k, item in enumerate(node.items):
            parts = self.vector(item, one.indices, [2], f"a corner of {label}")
            pairs = zip(LETTERS, parts, strict=False)
            name = f"body.{one.name}.corner{k}"
            corners.append(tuple(self._named(f"{name}.{c}", part) for c, part in pairs))
        return polygon(m, corners)


# --- The shapes of a scene: frames as entries of matrices, and those of bodies


class Shapes(SectionReader):
    """Expansion of the section `shapes`, to which the shapes of bodies are added."""

    def given(self, section: Node | None) -> Iterator[Entry]:
        """Yield the shapes of the section `shapes`, one entry for each member."""
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
        """Yield entries of the section `shapes` for the shapes of bodies."""
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
        """Return the rotation of a shape for a member: a matrix or angle as YAML node.

        node : the name of a frame, or an expression: an angle in the plane.
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
        """Return a shape's position, a YAML node, for a member.

        node : the name of a point, or a vector.
        """
        name = re.split(r"[(.]", node.text)[0] if isinstance(node, Scalar) else ""
        if name in self.x.points:
            return self.x.denoted(node, self.x.points, reading.indices)[0]
        return self.x.spread(node, reading)

    def _axes(self, frame: Frame, at: Scalar) -> Sequence:
        rows = tuple(self._list(row, at) for row in frame.rows)
        return Sequence(rows, at.place)

    def _list(self, parts: Iterable[Tree], at: Scalar) -> Sequence:
        made = (self.x.entry(f"{HIDDEN}{at.text}", parsed(x, ""), at) for x in parts)
        return Sequence(tuple(key for key, _ in made), at.place)
