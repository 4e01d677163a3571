"""Reader of the section `scene`: points, links between them, and shapes."""

from __future__ import annotations

import re
from copy import copy
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
from lagsim.model.reader.fields import Fields, entries, fields, items, kind_of, listed
from lagsim.model.reader.fields import named as texts_among
from lagsim.model.reader.sections import LINK, SHAPE

if TYPE_CHECKING:
    from lagsim.model.reader.expressions import Expressions

# Of a polygon, and of a ground.
MOST_CORNERS = 1000


def read_scene(found: Fields, x: Expressions) -> Scene:
    """Give the points, the links between them, and the shapes."""
    points: dict[str, tuple[int, ...]] = {}
    section, named = found.value("points"), list[str]()
    for key, node in entries(section, "`points`", x.faults):
        named.append(key.text)
        if check_name(key, "a point", x.faults):
            points[key.text] = _point(f"the point `{key.text}`", node, x)
    whole = not isinstance(section, Broken) and not found.unknown
    shapes = _Shapes(points, named, x, whole=whole).read(found.value("shapes"))
    section, given = found.value("links"), list[Node]()
    if section and (pair := _pair(section, named)):
        text = f"`links` is a list of links, each a list, found {kind_of(section)}"
        hint = f"write [[{', '.join(pair)}]]"
        x.faults.add("not-a-list", text, section, hint)
    else:
        given = items(section, "`links`", x.faults)
    joined = [_looking(node, named, x, whole=whole) for node in given]
    links = [(ends, look) for ends, look in joined if ends]
    ends, looks = zip(*links, strict=True) if links else ((), ())
    return Scene(points, ends, looks, shapes)


def _point(
    what: str, node: Node, x: Expressions, most: Level = Level.VELOCITY
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
        x.faults.add("not-a-list", text, node, hint)
        return ()
    apart = " ".join(texts_of(node.items[:1])).split() if len(node.items) == 1 else []
    if len(apart) in (2, 3) and all(x.names.meaning(part) for part in apart):
        text = f"{what} must have 2 or 3 components, found 1"
        hint = f"write [{', '.join(apart)}]"
        x.faults.add("wrong-count", text, node, hint)
        return ()
    compiled = [x.compile(part, what, most) for part in node.items]
    if len(node.items) not in (2, 3) and None not in compiled:
        text = f"{what} must have 2 or 3 components, found {len(node.items)}"
        hint = "a point in a plane is [x, y], one in space [x, y, z]"
        x.faults.add("wrong-count", text, node, hint)
    return tuple(c for c in compiled if c is not None)


# --- Links


def _pair(node: Node, named: list[str]) -> list[str]:
    """Give the two points that a link names without brackets of its own, or none."""
    found = texts_of(items_of(node))
    if isinstance(node, Scalar):
        found = re.split(r"\s*(?:,|->?|–|\s)\s*", node.text)
    return found if len(found) == 2 and set(found) <= set(named) else []


def _looking(
    node: Node, named: list[str], x: Expressions, *, whole: bool
) -> tuple[tuple[str, str] | None, str]:
    """Give the points that a link joins, and its look."""
    if not isinstance(node, Mapping):
        return _link(node, named, x, whole=whole), ""
    found = fields(node, "a link", LINK, x.faults, node.place)
    points = found.value("points")
    found.needs("points", "such as points: [pivot, bob]")
    look = found.choice("as", ("", *LINKS))
    return points and _link(points, named, x, whole=whole), look


def _link(
    node: Node, named: list[str], x: Expressions, *, whole: bool
) -> tuple[str, str] | None:
    """Give the points that a link joins; `whole`: `named` are all that there are."""
    if isinstance(node, Scalar) and not node.empty and (pair := _pair(node, named)):
        text = f"a link must be a list, found {kind_of(node)}"
        x.faults.add("not-a-list", text, node, f"write [{', '.join(pair)}]")
        return None
    ends = items(node, "a link", x.faults)
    if isinstance(node, Sequence) and len(ends) != 2:
        text, names = f"a link joins 2 points, found {len(ends)}", texts_of(ends)
        names = (_pair(ends[0], named) or names) if len(ends) == 1 else names
        links = [f"[{a}, {b}]" for a, b in pairwise(names) if {a, b} <= {*named}]
        hint = f"write {', '.join(links)}" if links else "such as [pivot, bob]"
        x.faults.add("wrong-count", text, node, hint)
        return None
    names = []
    for end in texts_among(ends, "a link names points", x.faults):
        if end.text in named:
            names.append(end.text)
        elif whole:
            _no_point(end, named, x)
    return (names[0], names[1]) if len(names) == 2 else None


def _no_point(name: Scalar, named: list[str], x: Expressions) -> None:
    hint = x.faults.did_you_mean(name.text, named)
    hint = hint or f"the points are {listed(named)}"
    if not named:
        hint = f"give it a place: points: {{{name.text}: [0, 0]}}"
    text = f"there is no point `{name.text}`"
    x.faults.add("unknown-name", text, name, hint)


# --- Shapes


class _Shapes:
    """Reader of `shapes`, whose points are read; `whole`: these are all."""

    def __init__(
        self,
        points: dict[str, tuple[int, ...]],
        named: list[str],
        x: Expressions,
        *,
        whole: bool,
    ) -> None:
        self._points, self._named, self._x = points, named, x
        self._whole = whole
        # The first point at each place.
        self._lying = {nodes: name for name, nodes in reversed(points.items())}

    def read(self, section: Node | None) -> tuple[Shape, ...]:
        x, found = self._x, list[Shape]()
        dimension = max(map(len, self._points.values()), default=0)
        for key, node in entries(section, "`shapes`", x.faults):
            if not check_name(key, "a shape", x.faults) or isinstance(node, Broken):
                continue
            what = f"the shape `{key.text}`"
            known = fields(node, what, SHAPE, x.faults, key.place)
            shape = self._shape(key, known) if known.sound else None
            if shape is None:
                continue
            found.append(shape)
            if 0 < dimension < shape.dimension and () not in self._points.values():
                text = f"the {shape.kind} `{key.text}` lies in space, and the points "
                text += "of the scene in a plane"
                hint = "give a point 3 components, such as [x, y, 0]"
                x.faults.add("shape-of-space", text, key, hint)
        shapes = tuple(found)
        check_sizes(Scene({}, shapes=shapes), x)
        return shapes

    def _shape(self, key: Scalar, known: Fields) -> Shape | None:
        faults, what = self._x.faults, f"the shape `{key.text}`"
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
        node, x = known.value(kind), self._x
        if node is None or isinstance(node, Broken):
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
                x.faults.add("missing-key", f"{what} has no `s`", node, hint)
            along = copy(x)
            along.bound = {"s": x.graph.variable(CURVE)}
            corners = (_point(what, node, along),)
        else:
            corners = (_point(what, node, x, Level.OUTPUT),)
            sized = [n for n in [known.value("scale")] if n is not None]
        sizes = [x.compile(n, f"a size of {what}", Level.NUMBER) for n in sized]
        if () in corners or None in sizes:
            return None
        at, point = self._at(what, known)
        near = (self._lying.get(place, "") for place in ((at,) if at else corners))
        return Shape(
            name, kind, tuple(n for n in sizes if n is not None), corners, at,
            self._axes(what, known.value("frame")),
            point or next(filter(None, near), ""), tuple(n.place for n in sized),
        )  # fmt: skip

    def _sized(self, what: str, node: Node, counts: tuple[int, ...]) -> list[Node]:
        """Give the sizes in a list, or the one that stands by itself."""
        if counts == (1,):
            return [node]
        given, wanted = items(node, what, self._x.faults), " or ".join(map(str, counts))
        if isinstance(node, Sequence) and len(given) not in counts:
            text = f"{what} has {wanted} numbers, found {len(given)}"
            self._x.faults.add("wrong-count", text, node)
            return []
        if isinstance(node, Scalar) and node.empty:
            text = f"{what} must be a list, found nothing"
            self._x.faults.add("not-a-list", text, node, "such as [1, 2]")
        return given

    def _corners(
        self, what: str, node: Node, least: int
    ) -> tuple[tuple[int, ...], ...]:
        given = items(node, what, self._x.faults)
        if not least <= len(given) <= MOST_CORNERS and isinstance(node, Sequence):
            text = f"{what} has {least} to {MOST_CORNERS} corners, found {len(given)}"
            hint = "each corner is a list [x, y]"
            self._x.faults.add("wrong-count", text, node, hint)
            given = []
        corners = [_point(f"a corner of {what}", one, self._x) for one in given]
        return tuple(corners) or ((),)

    def _at(self, what: str, known: Fields) -> tuple[tuple[int, ...], str]:
        """Give the place of a shape, and the point there, if `at` names one."""
        node, points = known.value("at"), self._points
        if node is None or isinstance(node, Broken):
            return (), ""
        if not isinstance(node, Scalar) or re.search(r"[^\w. ]", node.text):
            return _point(f"`at` of {what}", node, self._x), ""
        if node.text in points:
            return points[node.text], node.text
        if self._whole and node.text not in self._named:
            _no_point(node, self._named, self._x)
        return (), ""

    def _axes(self, what: str, node: Node | None) -> tuple[int, ...]:
        """Give the rotation matrix, of an angle or as it stands, row by row."""
        x, what = self._x, f"`frame` of {what}"
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
