"""Products in which what moves least comes first.

l*(cos(a)*a') and cos(a)*(l*F) have l*cos(a) in common, and where l and m are numbers
of a run, m*(2*u) takes one product and not two: written so, what is fixed is multiplied
once, and what depends on positions alone is found again where it is needed.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from lagsim.language.graph import Graph


def slow_factors_first(
    g: Graph, nodes: Sequence[int], *faster: Collection[str]
) -> list[int]:
    """Give `nodes` with what is slow first in each product.

    Parameters
    ----------
    faster
        Names of variables, the slower ones first: a factor has the speed of the last
        of these that it depends on, and those of one speed are multiplied first.
    """
    cone = g.cone(nodes)
    speed: Counter[int] = Counter()
    for place, names in enumerate(faster, 1):
        speed.update(dict.fromkeys(g.dependent(cone, names), place))
    return _Ordered(g, cone, nodes, speed).nodes


class _Ordered:
    def __init__(
        self, g: Graph, cone: Sequence[int], nodes: Sequence[int], speed: Counter[int]
    ) -> None:
        self.g, self.speed = g, speed
        uses = Counter(a for n in cone for a in g.args[n])
        uses.update(nodes)
        self.inner = {n for n in cone if g.ops[n] == "mul" and uses[n] == 1}
        self.done: dict[int, int] = {}
        for n in cone:
            self.done[n] = self._ordered(n)
        self.nodes = [self.done[n] for n in nodes]

    def _ordered(self, n: int) -> int:
        g = self.g
        if g.ops[n] != "mul":
            args = g.args[n]
            return g.call(g.ops[n], *(self.done[a] for a in args)) if args else n
        parts: dict[int, list[int]] = {}
        for a in self._factors(n):
            parts.setdefault(self.speed[a], []).append(self.done[a])
        whole = g.one
        for place in sorted(parts):
            part = g.one
            for a in sorted(parts[place]):
                part = g.call("mul", part, a)
            whole = g.call("mul", whole, part)
        return whole

    def _factors(self, n: int) -> list[int]:
        """Give what `n` is a product of, through products that stand here alone."""
        stack, found = list(self.g.args[n]), []
        while stack:
            a = stack.pop()
            if a in self.inner:
                stack.extend(self.g.args[a])
            else:
                found.append(a)
        return found
