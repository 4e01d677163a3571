"""Reader of the section `scene`: points, links between them, and shapes."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING

from lagsim.language.evaluate import evaluate
from lagsim.model.model import CURVE, LINKS, SHAPES, Level, Scene, Shape
from lagsim.model.nodes import (
    Broken,
    Mapping,
    Node,
    Scalar,
    Sequence,
    items_of,
    texts_of,
)
from lagsim.model.reader import hints
from lagsim.model.reader.expressions import check_name
from lagsim.model.reader.fields import (
    LINK,
    SHAPE,
    Fields,
    entries,
    fields,
    items,
    kind_of,
    listed,
)
from lagsim.model.reader.fields import named as texts_among

if TYPE_CHECKING:
    from lagsim.model.reader.expressions import Expressions

# Of a polygon, and of a ground.
MOST_CORNERS = 1000


def read_scene(found: Fields, x: Expressions) -> Scene:
    """Give the points, the links between them, and the shapes."""
    return _Reader(found, x).read()


class _Reader:
    """Reads a scene: `points` are sound, `named` all; `whole`: no other is meant."""

    def __init__(self, found: Fields, x: Expressions) -> None:
        self.found, self.x, self.faults = found, x, x.faults
        self.points: dict[str, tuple[int, ...]] = {}
        self.named: list[str] = []
        section = found.value("points")
        self.whole = not isinstance(section, Broken) and not found.unknown
        for key, node in entries(section, "`points`", x.faults):
            self.named.append(key.text)
            if check_name(key, "a point", x.faults):
                self.points[key.text] = self._point(f"the point `{key.text}`", node)
        # The first point at each place.
        self.lying = {nodes: name for name, nodes in reversed(self.points.items())}

    def read(self) -> Scene:
        shapes = self._shapes()
        section, given = self.found.value("links"), list[Node]()
        if section and (pair := self._pair(section)):
            text = f"`links` is a list of links, each a list, found {kind_of(section)}"
            hint = f"write [[{', '.join(pair)}]]"
            self.faults.add("not-a-list", text, section, hint)
        else:
            given = items(section, "`links`", self.faults)
        joined = [self._looking(node) for node in given]
        links = [(ends, look) for ends, look in joined if ends]
        ends, looks = zip(*links, strict=True) if links else ((), ())
        return Scene(self.points, ends, looks, shapes)

    def _point(
        self, what: str, node: Node, most: Level = Level.VELOCITY
    ) -> tuple[int, ...]:
        if isinstance(node, Broken):
            return ()
        if not isinstance(node, Sequence):
            text = f"{what} must be a list of 2 or 3 expressions, found {kind_of(node)}"
            hint = hints.as_list(node)
            if isinstance(node, Scalar) and not re.search(r"[,(]|\w\s+\w", node.text):
                hint = f"write [{node.text}, 0]"
            if isinstance(node, Mapping):
                hint = f"write [{', '.join(hints.text_of(v) for _, v in node.entries)}]"
            self.faults.add("not-a-list", text, node, hint)
            return ()
        count, apart = len(node.items), " ".join(texts_of(node.items)).split()
        text = f"{what} must have 2 or 3 components, found {count}"
        hint = "a point in a plane is [x, y], one in space [x, y, z]"
        if count == 1 < len(apart) < 4 and all(map(self.x.names.meaning, apart)):
            self.faults.add("wrong-count", text, node, f"write [{', '.join(apart)}]")
            return ()
        compiled = [self.x.compile(part, what, most) for part in node.items]
        if count not in (2, 3) and None not in compiled:
            self.faults.add("wrong-count", text, node, hint)
        return tuple(c for c in compiled if c is not None)

    # Links

    def _pair(self, node: Node) -> list[str]:
        """Give the two points that a link without brackets names, or none."""
        found = texts_of(items_of(node))
        if isinstance(node, Scalar):
            found = re.split(r"\s*(?:,|->?|–|\s)\s*", node.text)
        return found if len(found) == 2 and set(found) <= set(self.named) else []

    def _looking(self, node: Node) -> tuple[tuple[str, str] | None, str]:
        """Give the points that a link joins, and its look."""
        if not isinstance(node, Mapping):
            return self._link(node), ""
        found = fields(node, "a link", LINK, self.faults, node.place)
        points = found.value("points")
        found.needs("points", "such as points: [pivot, bob]")
        return points and self._link(points), found.choice("as", ("", *LINKS))

    def _link(self, node: Node) -> tuple[str, str] | None:
        """Give the points that a link joins."""
        if isinstance(node, Scalar) and not node.empty and (pair := self._pair(node)):
            text = f"a link must be a list, found {kind_of(node)}"
            self.faults.add("not-a-list", text, node, f"write [{', '.join(pair)}]")
            return None
        ends = items(node, "a link", self.faults)
        if isinstance(node, Sequence) and len(ends) != 2:
            text, names = f"a link joins 2 points, found {len(ends)}", texts_of(ends)
            names = (self._pair(ends[0]) or names) if len(ends) == 1 else names
            pairs = ((a, b) for a, b in pairwise(names) if {a, b} <= {*self.named})
            hint = ", ".join(f"[{a}, {b}]" for a, b in pairs)
            hint = f"write {hint}" if hint else "such as [pivot, bob]"
            self.faults.add("wrong-count", text, node, hint)
            return None
        named = list(texts_among(ends, "a link names points", self.faults))
        known = [end.text for end in named if self._is_point(end)]
        return (known[0], known[1]) if len(known) == 2 else None

    def _is_point(self, name: Scalar) -> bool:
        """Tell whether a point has this name; else that is reported."""
        named = self.named
        if name.text not in named and self.whole:
            hint = self.faults.did_you_mean(name.text, named)
            hint = hint or f"the points are {listed(named)}"
            if not named:
                hint = f"give it a place: points: {{{name.text}: [0, 0]}}"
            text = f"there is no point `{name.text}`"
            self.faults.add("unknown-name", text, name, hint)
        return name.text in named

    # Shapes

    def _shapes(self) -> tuple[Shape, ...]:
        x, found = self.x, list[Shape]()
        dimension = max(map(len, self.points.values()), default=0)
        for key, node in entries(self.found.value("shapes"), "`shapes`", x.faults):
            if not check_name(key, "a shape", x.faults) or isinstance(node, Broken):
                continue
            what = f"the shape `{key.text}`"
            known = fields(node, what, SHAPE, x.faults, key.place)
            shape = self._shape(key, known) if known.sound else None
            if shape is None:
                continue
            found.append(shape)
            if 0 < dimension < shape.dimension and () not in self.points.values():
                text = f"the {shape.kind} `{key.text}` lies in space, and the points "
                text += "of the scene in a plane"
                x.faults.add("shape-of-space", text, key)
        shapes = tuple(found)
        check_sizes(Scene({}, shapes=shapes), x)
        return shapes

    def _shape(self, key: Scalar, known: Fields) -> Shape | None:
        faults, what = self.faults, f"the shape `{key.text}`"
        kinds = [kind for kind in SHAPES if kind in known]
        if len(kinds) > 1:
            second = max(map(known.place_of, kinds), key=lambda at: at[1:3])
            faults.add("both-given", f"{what} is given as {listed(kinds)}", second)
        elif not kinds and not known.unknown:
            hint = f"the kinds of shapes are {listed(SHAPES)}"
            faults.add("missing-key", f"{what} has no kind", key, hint)
        if len(kinds) != 1:
            return None
        kind, own = kinds[0], SHAPES[kinds[0]]
        what = f"the {kind} `{key.text}`"
        for other in known.found.keys() - {kind, *own.keys}:
            of = [k for k, other_kind in SHAPES.items() if other in other_kind.keys]
            hint = f"`{other}` belongs to {listed(of)}" if of else ""
            text = f"unknown key `{other}` in {what}"
            faults.add("unknown-key", text, known.place_of(other), hint)
        return self._made(what, key.text, kind, known)

    def _made(self, what: str, name: str, kind: str, known: Fields) -> Shape | None:
        node, x = known.found[kind][1], self.x
        if isinstance(node, Broken):
            return None
        corners: tuple[tuple[int, ...], ...] = ()
        sized = list[Node]()
        if counts := SHAPES[kind].sizes:
            sized = self._sized(what, node, counts)
        elif kind == "ground" and isinstance(node, Scalar):
            sized = [node]
        elif kind in ("polygon", "ground"):
            corners = self._corners(what, node, 3 if kind == "polygon" else 2)
        elif kind == "curve":
            if "s" in known:
                sized = self._sized(f"`s` of {what}", known.found["s"][1], (2,))
            else:
                hint = "such as s: [0, 2*pi]"
                self.faults.add("missing-key", f"{what} has no `s`", node, hint)
            x.bound = {"s": x.graph.variable(CURVE)}
            corners = (self._point(what, node),)
            x.bound = {}
        else:
            corners = (self._point(what, node, Level.OUTPUT),)
            sized = [n for n in [known.value("scale")] if n is not None]
        sizes = [x.compile(n, f"a size of {what}", Level.NUMBER) for n in sized]
        if () in corners or None in sizes:
            return None
        at, point = self._at(what, known.value("at"))
        near = (self.lying.get(place, "") for place in ((at,) if at else corners))
        return Shape(
            name, kind, tuple(n for n in sizes if n is not None), corners, at,
            self._axes(what, known.value("frame")),
            point or next(filter(None, near), ""), tuple(n.place for n in sized),
        )  # fmt: skip

    def _sized(self, what: str, node: Node, counts: tuple[int, ...]) -> list[Node]:
        """Give the sizes in a list, or the one that stands by itself."""
        if counts == (1,):
            return [node]
        given, wanted = items(node, what, self.faults), " or ".join(map(str, counts))
        if isinstance(node, Sequence) and len(given) not in counts:
            text = f"{what} has {wanted} numbers, found {len(given)}"
            self.faults.add("wrong-count", text, node)
            return []
        if isinstance(node, Scalar) and node.empty:
            text = f"{what} must be a list, found nothing"
            self.faults.add("not-a-list", text, node, "such as [1, 2]")
        return given

    def _corners(
        self, what: str, node: Node, least: int
    ) -> tuple[tuple[int, ...], ...]:
        given = items(node, what, self.faults)
        if not least <= len(given) <= MOST_CORNERS and isinstance(node, Sequence):
            text = f"{what} has {least} to {MOST_CORNERS} corners, found {len(given)}"
            hint = "each corner is a list [x, y]"
            self.faults.add("wrong-count", text, node, hint)
            given = []
        return tuple(self._point(f"a corner of {what}", n) for n in given) or ((),)

    def _at(self, what: str, node: Node | None) -> tuple[tuple[int, ...], str]:
        """Give the place of a shape, and the point there, if `at` names one."""
        if node is None or isinstance(node, Broken):
            return (), ""
        if not isinstance(node, Scalar) or re.search(r"[^\w. ]", node.text):
            return self._point(f"`at` of {what}", node), ""
        if self._is_point(node) and node.text in self.points:
            return self.points[node.text], node.text
        return (), ""

    def _axes(self, what: str, node: Node | None) -> tuple[int, ...]:
        """Give the rotation matrix, of an angle or as it stands, row by row."""
        x, what = self.x, f"`frame` of {what}"
        if isinstance(node, Sequence):
            rows = [items(row, f"a row of {what}", x.faults) for row in node.items]
            if len(rows) not in (2, 3) or any(len(row) != len(rows) for row in rows):
                text = f"{what} is an angle, or 2 or 3 rows of as many entries each"
                hint = "such as [[cos(a), -sin(a)], [sin(a), cos(a)]]"
                x.faults.add("wrong-count", text, node, hint)
                return ()
            found = [x.compile(n, what, Level.VELOCITY) for row in rows for n in row]
            return () if None in found else tuple(n for n in found if n is not None)
        angle = x.compile(node, what, Level.VELOCITY)
        if angle is None:
            return ()
        cos, sin = x.graph.call("cos", angle), x.graph.call("sin", angle)
        return cos, x.graph.call("neg", sin), sin, cos


def check_sizes(scene: Scene, x: Expressions) -> None:
    """Report sizes of shapes that are negative or not finite, at these parameters."""
    numbers = {name: value for name, (value, _) in x.known.items()}
    for shape in scene.shapes:
        if not x.graph.depends(shape.sizes) <= numbers.keys():
            continue  # a parameter without a value is reported
        values = evaluate(x.graph, shape.sizes, numbers)
        what = f"a size of the {shape.kind} `{shape.name}`"
        for value, place in zip(values, shape.places, strict=True):
            if x.is_finite(value, what, place) and SHAPES[shape.kind].sizes:
                x.within(value, what, place, 0.0)
