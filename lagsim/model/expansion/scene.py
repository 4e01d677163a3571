"""Expansion of points, links and shapes of a scene, and of curves of plots."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from lagsim.language.names import in_file
from lagsim.language.parser import ExpressionError
from lagsim.model.expansion import trees
from lagsim.model.expansion.grammar import parsed_key
from lagsim.model.nodes import (
    Broken,
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    entries_of,
    items_of,
    value_of,
    with_value,
)

if TYPE_CHECKING:
    from lagsim.model.expansion import Expansion
    from lagsim.model.expansion.scope import MemberReading


class SceneExpansion:
    """Points, links and shapes of a scene, and curves of plots, by members.

    Parameters
    ----------
    x : Expansion
        The expansion of the file.
    """

    def __init__(self, x: Expansion) -> None:
        self._x = x

    def scene(self, node: Node | None) -> Node:
        """Return the section `scene`, its points, links and shapes by members."""
        if node is not None and not isinstance(node, Mapping):
            return node
        entries: list[Entry] = []
        if node:  # points first, since other entries name points
            given = sorted(node.entries, key=lambda entry: entry[0].text != "points")
            rules = {"points": self._points, "links": self._links}
            whole = self._x.bound(Mapping(tuple(given), node.place), None, rules)
            entries += entries_of(whole)
        shapes = next((e for e in entries if e[0].text == "shapes"), None)
        if self._x.drawn or (shapes and isinstance(shapes[1], Mapping)):
            from lagsim.model.expansion.bodies import Shapes

            at, old = shapes or (self._x.drawn[0].kind[0], None)
            writer = Shapes(self._x)
            found = (*writer.given(old), *writer.of_bodies(self._x.drawn))
            entries = [entry for entry in entries if entry is not shapes]
            entries.append((at._replace(text="shapes"), Mapping(found, at.place)))
        return Mapping(tuple(entries), node.place if node else entries[0][0].place)

    def _points(self, node: Node, reading: MemberReading) -> Node:
        if not isinstance(node, Mapping):
            return self._x.bound(node, reading)
        found = [
            (full, self._x.spread(one, reading))
            for entry in node.entries
            for full, reading, one in self._x.named(*entry, self._x.points)
        ]
        return node._replace(entries=tuple(found))

    def _links(self, node: Node, reading: MemberReading) -> Node:
        """Return the links of a scene.

        A link to a family joins its consecutive points.
        """
        if not isinstance(node, Sequence):
            return self._x.bound(node, reading)
        links = (link for item in node.items for link in self._joining(item))
        return node._replace(items=tuple(links))

    def _joining(self, node: Node) -> list[Node]:
        inner = value_of(node, ("points",))
        if inner is not node:
            length = value_of(node, ("length",))
            if length is not node:
                node = with_value(node, ("length",), self._x.bound(length))
            return [with_value(node, ("points",), x) for x in self._joining(inner)]
        if not isinstance(node, Sequence):
            return [node]
        names = [
            n for item in node.items for n in self._x.denoted(item, self._x.points)
        ]
        if any(isinstance(name, Broken) for name in names):
            return [Broken(node.place)]
        if len(names) == len(node.items):
            return [node._replace(items=tuple(names))]
        return [node._replace(items=pair) for pair in pairwise(names)]

    def axis(self, node: Node, _: MemberReading) -> Node:
        """Return the curves of an axis of a plot: one expression, or a list of them."""
        curves = [c for item in items_of(node) for c in self._curves(item)]
        if len(curves) == 1 and not isinstance(node, Sequence):
            return curves[0]
        return Sequence(tuple(curves), node.place)

    def _curves(self, node: Node) -> list[Node]:
        """Return the expressions of a plot's curve: one per member and component."""
        if not isinstance(node, Scalar):
            return [node]
        try:
            parsed = parsed_key(node.text)
        except ExpressionError:
            parsed = None
        meant = self._x.scope.reference(parsed.name) if parsed else None
        if meant and meant.broken:
            return [Broken(node.place)]
        if parsed and meant and (meant.indexed or not parsed.subscripts):
            return [
                self._x.bound(n._replace(text=in_file(n.text)))
                if isinstance(n, Scalar)
                else n
                for n in self._x.denoted(node)
            ]
        spread = self._x.spread(node, self._x.plain)
        if not isinstance(spread, Sequence):
            return [spread]
        return [
            self._x.bound(node._replace(text=f"({node.text}).{c}"))
            for c in trees.components(len(spread.items))
        ]
