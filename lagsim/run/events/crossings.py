"""Where a step function of t changes, to the double."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lagsim.language.evaluate import evaluate
from lagsim.language.functions import OPERATIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.language.graph import Graph


class Values:
    """Evaluates nodes at one time after the other, as `evaluate` does, but faster."""

    def __init__(
        self, g: Graph, nodes: Sequence[int], values: Mapping[str, float]
    ) -> None:
        moving = g.dependent(nodes, ("t",))
        cone = g.cone(nodes)
        fixed = [n for n in cone if n not in moving]
        self.nodes = nodes
        self.found = dict(zip(fixed, evaluate(g, fixed, values), strict=True))
        self.time = g.variable("t")
        self.program = [
            (n, OPERATIONS[g.ops[n]], g.args[n])
            for n in cone
            if n in moving and n != self.time
        ]

    def __call__(self, t: float) -> list[float]:
        """Give the values at `t`."""
        found = self.found
        found[self.time] = t
        for n, row, args in self.program:
            found[n] = row(*[found[a] for a in args])
        return [found[n] for n in self.nodes]


def newton(value: Values, level: float, lo: float, hi: float) -> float:
    """Give about where value = level between `lo` and `hi`; only a guess."""
    (a, _), (b, _) = value(lo), value(hi)
    t = lo + (hi - lo) * (level - a) / (b - a) if b != a else lo
    for _ in range(6):
        if not lo <= t <= hi:
            return lo + 0.5 * (hi - lo)
        s, slope = value(t)
        step = (s - level) / slope if slope else math.nan
        t -= step
        if abs(step) <= 2.0 * math.ulp(t):
            break
    return t if lo <= t <= hi else lo + 0.5 * (hi - lo)


def first_change(
    changed: Callable[[float], bool], guess: float, lo: float, hi: float
) -> float:
    """Give the first double after `lo` at which `changed`, which it has at `hi`."""
    step = math.ulp(guess)
    if lo < guess < hi:
        if changed(guess):
            hi = guess
        else:
            lo = guess
    # Gallop away from the guess on both sides in turn until it is enclosed.
    while (t := hi - step) > lo and hi == guess:
        if not changed(t):
            lo = t
            break
        hi, guess, step = t, t, 8.0 * step
    while (t := lo + step) < hi and lo == guess:
        if changed(t):
            hi = t
            break
        lo, guess, step = t, t, 8.0 * step
    while lo < (t := lo + 0.5 * (hi - lo)) < hi:
        if changed(t):
            hi = t
        else:
            lo = t
    return hi
