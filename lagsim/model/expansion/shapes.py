"""The shapes of a scene: frames as entries of matrices, and the shapes of bodies."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from lagsim.language.parser import ExpressionError, parse
from lagsim.model import nodes
from lagsim.model.expansion.frames import Section
from lagsim.model.expansion.scope import Reading, dotted
from lagsim.model.nodes import Mapping, Scalar, entries_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from lagsim.model.expansion.bodies import Drawn
    from lagsim.model.expansion.rotations import Frame
    from lagsim.model.expansion.trees import Tree
    from lagsim.model.nodes import Entry, Node


class Shapes(Section):
    """Writes out the section `shapes`, and adds those of bodies."""

    def given(self, section: Node | None) -> Iterator[Entry]:
        """Return the shapes of the file, by members."""
        for key, node in entries_of(section):
            if "(" not in key.text:
                yield key, self._written(node, self.x.plain)
            elif found := self.x.members(key, "a shape"):
                for indices, member in found[1]:
                    reading = Reading(self.scope, indices)
                    name = dotted(found[0].name, member)
                    full = key._replace(text=name, reading=reading)
                    yield full, self._written(node, reading)

    def of_bodies(self, drawn: Iterable[Drawn]) -> Iterator[Entry]:
        """Return the shapes of bodies."""
        for one in drawn:
            key, value = one.kind
            reading = Reading(self.scope, one.indices)
            below = [(key, self.x.bound(value, reading))]
            below.append((key._replace(text="at"), self._list(one.origin, key)))
            if one.frame:
                axes = self._axes(one.frame, key)
                below.append((key._replace(text="frame"), axes))
            name = key._replace(text=one.name, reading=reading)
            yield name, Mapping(tuple(below), key.place)

    def _written(self, node: Node, reading: Reading) -> Node:
        rules = {"frame": self._turned, "at": self._point, "arrow": self.x.spread}
        return self.x.by_keys(node, reading, rules)

    def _turned(self, node: Node, reading: Reading) -> Node:
        """Return the matrix of a frame; an expression is an angle."""
        frames = self.x.frames
        if isinstance(node, Scalar) and frames is not None:
            try:
                steps = self.scope.source(node.text, parse).postfix
                return self._axes(frames.named_by(steps, reading.indices), node)
            except ExpressionError:  # a name that is no frame's, or a faulty frame
                pass
        return self.x.bound(node, reading)

    def _point(self, node: Node, reading: Reading) -> Node:
        """Return a place: a point, one of a family, or a vector."""
        name = re.split(r"[(.]", node.text)[0] if isinstance(node, Scalar) else ""
        if name in self.x.points:
            return self.x.denoted(node, self.x.points, reading.indices)[0]
        return self.x.spread(node, reading)

    def _axes(self, frame: Frame, at: Scalar) -> nodes.Sequence:
        rows = tuple(self._list(row, at) for row in frame.rows)
        return nodes.Sequence(rows, at.place)

    def _list(self, parts: Iterable[Tree], at: Scalar) -> nodes.Sequence:
        items = tuple(self.x.made_scalar(part, at) for part in parts)
        return nodes.Sequence(items, at.place)
