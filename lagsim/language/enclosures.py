"""Enclosures of graph nodes while one variable runs through intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lagsim.language.evaluate import evaluate
from lagsim.language.interval_rules import RULES, square
from lagsim.language.intervals import Floats, Interval, interval, point

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from lagsim.language.graph import Graph


def _rule(
    op: str, args: tuple[int, ...]
) -> tuple[Callable[..., Interval], tuple[int, ...]]:
    if op == "mul" and args[0] == args[1]:
        return square, args[:1]  # x*x is never negative
    return RULES[op], args


class Enclosures:
    """Encloses nodes while t runs through intervals, all other variables fixed.

    What does not depend on t is the one number that `evaluate` gives.
    """

    def __init__(
        self, g: Graph, nodes: Iterable[int], values: Mapping[str, float]
    ) -> None:
        self.nodes = list(nodes)
        self.t = g.variable("t")
        moving = g.dependent(self.nodes, ("t",))
        cone = g.cone(self.nodes)
        fixed = [n for n in cone if n not in moving]
        self.fixed = {
            n: point(float(x))
            for n, x in zip(fixed, evaluate(g, fixed, values), strict=True)
        }
        self.program = [
            (n, *_rule(g.ops[n], g.args[n]))
            for n in cone
            if n in moving and n != self.t
        ]

    def __call__(self, lo: Floats, hi: Floats) -> list[Interval]:
        """Give the enclosure of each node over the intervals from `lo` to `hi`."""
        found = dict(self.fixed)
        found[self.t] = interval(lo, hi)
        with np.errstate(all="ignore"):
            for n, rule, args in self.program:
                found[n] = rule(*(found[a] for a in args))
        everywhere = np.zeros(lo.shape)
        return [
            interval(x.lo + everywhere, x.hi, x.partial, x.jumps)
            for x in (found[n] for n in self.nodes)
        ]
