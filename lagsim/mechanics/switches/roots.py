"""Roots of velocities: forces that are continuous at rest, and steeper than any slope.

Under -c |v|^p sign(v) with 0 < p < 1 a body comes to rest in a finite time, and while
another force grows slowly from 0 it moves at (F/c)^(1/p), that is hardly, at a rate of
decay that has no bound. No step is short enough for that. So the root is taken of no
less than a floor far below the tolerance: within it the force is that of dry friction
of the size c floor^p, under which the motion sticks, slips and is located as under any
other. The velocity is off by no more than the floor. A cube root is a switch for this.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.functions import CHOOSING

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.switches.surfaces import Side

# What has no derivatives at 0.
ROOTS = ("pow", "sqrt", "cbrt")


class Roots(NamedTuple):
    """Which roots have a floor.

    Attributes
    ----------
    floors
        The expression of a surface -> the name of its floor.
    """

    graph: Graph
    floors: Mapping[int, str]

    @classmethod
    def among(
        cls,
        g: Graph,
        nodes: Iterable[int],
        sides: Sequence[Side],
        speeds: Collection[str],
    ) -> Roots:
        """Find the roots below `nodes` of what decides `sides` in velocities."""
        fast = g.dependent([s.node for s in sides], speeds)
        names = {
            s.node: f"floor.{k}"
            for k, s in enumerate(sides)
            if s.node in fast and not s.whole
        }
        possible = cls(g, names)
        cone = g.cone(nodes) if names else []
        used = {possible._of(n) for n in cone}
        return cls(g, {n: name for n, name in names.items() if name in used})

    def told(self, sides: Sequence[Side]) -> tuple[Side, ...]:
        """Give the sides with their floors."""
        return tuple(s._replace(floor=self.floors.get(s.node, "")) for s in sides)

    def _of(self, n: int) -> str:
        found = self.floor(n)
        return found[0] if found else ""

    def floor(self, n: int) -> tuple[str, float] | None:
        """Give the floor of a root or power, and by what it is to be multiplied."""
        g = self.graph
        if not self.floors or g.ops[n] not in ROOTS or self._smooth(n):
            return None
        node, factor = self._inside(g.args[n][0])
        return (self.floors[node], factor) if node in self.floors else None

    def _smooth(self, n: int) -> bool:
        """Tell whether a power is no root, nor the slope of one."""
        g = self.graph
        exponent = g.value(g.args[n][1]) if g.ops[n] == "pow" else 0.5
        return exponent is not None and (exponent > 1.0 or exponent % 1.0 == 0.0)

    def _inside(self, n: int) -> tuple[int, float]:
        """Give what decides whether a root is at 0, and its factor."""
        g, factor = self.graph, 1.0
        while n not in self.floors:
            op, args = g.ops[n], g.args[n]
            moving = [a for a in args[op == "if" :] if g.value(a) is None]
            opposite = g.call("neg", n)
            if op in ("abs", "neg") or (op in CHOOSING and len(moving) == 1):
                n = moving[0]
            elif op == "mul" and (c := g.value(args[0])):
                n, factor = args[1], factor * abs(c)
            elif op == "div" and (c := g.value(args[1])):
                n, factor = args[0], factor / abs(c)
            elif op == "sub" and opposite in self.floors:
                n = opposite
            else:
                break
        return n, factor

    def floored(self, n: int, x: int) -> int:
        """Give what root or power `n` is taken of: x, not less than its floor."""
        g = self.graph
        found = self.floor(n)
        if found is None or g.value(x) is not None:
            return x
        name, factor = found
        least = g.call("mul", g.constant(factor), g.variable(name))
        if g.ops[n] == "pow" and g.value(exponent := g.args[n][1]) is None:
            least = g.call("if", g.call("lt", exponent, g.one), least, g.zero)
        return g.call("if", g.call("gt", x, least), x, least)
