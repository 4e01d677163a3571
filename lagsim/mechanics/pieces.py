"""Pieces of a gap with kinks: the relations whose least it is.

`y - k*abs(x)` with k > 0 is the least of y - k*x and y + k*x: a groove, in which a body
may lie on both. Each of these is a contact of its own, and together they move as
separate relations do. A gap that is the greatest of several, a ridge, is the one that
the state is on: its kink stays a switch, which is located as any other. So a gap is
written as the least of pieces that have kinks of the second kind alone:

    min(a, b) + c = min(a + c, b + c),   max(min(a, b), c) = min(max(a, c), max(b, c)),

and so on through sums, factors of one sign, `abs`, `min` and `max`. A linear table is
the difference of two convex ones; one of these is the greatest of its lines.

Any other kink at u = 0, of a continuous `if(u > 0, x, y)` or below a function that is
not linear, has a jump of slope r, x - y = r u to first order. Where r < 0 it is the
least of x and y near the kink. Beyond it each is continued by the other and that line,
`if(u > 0, x, y + r u)`, so that a piece ends nowhere else.

Signs of factors and of r are those of enclosures, at the values of the parameters and
wherever the coordinates are. What has no sign known so, or more than MOST pieces,
stays whole.

Source: L. O. Chua and A.-C. Deng, Canonical piecewise-linear representation, IEEE
Transactions on Circuits and Systems 35, 1988, on lattices of linear pieces.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from lagsim.language import tables
from lagsim.language.derivatives import slopes
from lagsim.language.functions import CHOOSING, STEPS
from lagsim.language.intervals import Enclosures

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from lagsim.language.arrays import Floats
    from lagsim.language.graph import Graph
    from lagsim.language.tables import Data

# A gap has no more pieces than this.
MOST = 64
LEAST, GREATEST = 1, -1
# Between the name of a constraint and the number of its piece; no name contains it.
MARK = "#"
COMPARISONS = {"gt": 1, "ge": 1, "lt": -1, "le": -1}
KINKED = ("abs", *CHOOSING)
# A slope differs from another by more than this part of the largest.
SAME_SLOPE = 1e-12
# Lines beyond the last knots are given so far beyond them, in units of how far apart
# these are.
FAR = 1e3


def whole(name: str) -> str:
    """Return the name of the constraint that a piece is one of."""
    return name.partition(MARK)[0]


def named(name: str, k: int) -> str:
    """Name of piece k of a constraint that has several, counted from 1."""
    return f"{name}{MARK}{k}"


def pieces(
    g: Graph, gap: int, values: Mapping[str, float], moving: Collection[str]
) -> tuple[int, ...]:
    """Pieces whose least is a gap, nodes; the gap alone where it has no groove.

    Parameters
    ----------
    values
        Of the parameters.
    moving
        The names of what the gap may depend on besides.
    """
    below = _Pieces(g, values, moving)
    if not below.kinked([gap]):
        return (gap,)
    found = tuple(dict.fromkeys(below.of(gap, LEAST)))
    return found if len(found) <= MOST else (gap,)


class _Pieces:
    """Writes nodes as the least, or the greatest, of others."""

    def __init__(
        self, g: Graph, values: Mapping[str, float], moving: Collection[str]
    ) -> None:
        self.g, self.values, self.moving = g, values, [*moving]
        self.known: dict[tuple[int, int], list[int]] = {}

    def kinked(self, nodes: list[int]) -> list[int]:
        """Those below `nodes` that have kinks and move, in order of evaluation."""
        g = self.g
        kinked = [n for n in g.cone(nodes) if self._has_kink(n)]
        moves = g.dependent(kinked, self.moving) if kinked else ()
        return [n for n in kinked if n in moves]

    def _has_kink(self, n: int) -> bool:
        g = self.g
        if g.ops[n] == "table.piece":
            return self._is_linear(n)
        return g.ops[n] in KINKED

    def _is_linear(self, n: int) -> bool:
        """Whether a node is the value of a linear table of one argument."""
        axis, data, order = (self.g.payload(a) for a in self.g.args[n][:3])
        return bool(data.values[0] == tables.LINEAR and axis.values[1] == order == 0.0)

    def of(self, n: int, way: int) -> list[int]:
        """Nodes whose least (or greatest) is n, each without kinks of that kind."""
        key = (n, way)
        if key not in self.known:
            found = self._of(n, way) if self.kinked([n]) else [n]
            self.known[key] = found if len(found) <= MOST else [n]
        return self.known[key]

    def _of(self, n: int, way: int) -> list[int]:
        g, op, args = self.g, self.g.ops[n], self.g.args[n]
        if op == "table.piece":
            return self._of_table(n, way)
        if op == "neg":
            return [g.call("neg", a) for a in self.of(args[0], -way)]
        if op in ("add", "sub"):
            other = -way if op == "sub" else way
            return self._each(op, self.of(args[0], way), self.of(args[1], other))
        if op in ("mul", "div"):
            return self._of_product(n, way)
        if op in ("min", "max", "abs"):
            return self._of_extreme(n, way)
        return self._apart(n, way)

    def _each(self, op: str, some: list[int], others: list[int]) -> list[int]:
        if len(some) * len(others) > MOST:
            return [self.g.call(op, a, b) for a, b in zip(some, others, strict=False)]
        pairs = product(some, others)
        return list(dict.fromkeys(self.g.call(op, a, b) for a, b in pairs))

    def _of_product(self, n: int, way: int) -> list[int]:
        """Pieces of a product or quotient with one factor that has kinks."""
        g, op, args = self.g, self.g.ops[n], self.g.args[n]
        first, second = (bool(self.kinked([a])) for a in args)
        if op == "mul" and all(g.ops[a] == "abs" for a in args):
            both = g.call("mul", *(g.args[a][0] for a in args))
            return self.of(g.call("abs", both), way)
        if first == second or (op == "div" and second):
            return self._apart(n, way)
        factor, inner = args if second else args[::-1]
        sign = self.sign(factor)
        if not sign:
            return [n]
        found = self.of(inner, way * sign)
        return [g.call(op, *((factor, a) if second else (a, factor))) for a in found]

    def _of_extreme(self, n: int, way: int) -> list[int]:
        """Pieces of the greatest or the least of two; |u| is the greatest of u, -u."""
        g, op, args = self.g, self.g.ops[n], self.g.args[n]
        if op == "abs":
            if way == LEAST and not self.kinked([args[0]]):
                return [n]
            opposite = [g.call("neg", a) for a in self.of(args[0], -way)]
            sides = [self.of(args[0], way), opposite]
        else:
            sides = [self.of(a, way) for a in args]
        if (op == "min") == (way == LEAST):
            return list(dict.fromkeys([*sides[0], *sides[1]]))
        return self._each("min" if op == "min" else "max", *sides)

    def sign(self, node: int) -> int:
        """Sign of a node wherever it moves: 1, -1, or 0 where it has none."""
        return self._signs([node])[0]

    def _signs(self, nodes: list[int]) -> list[int]:
        line = np.array([-math.inf]), np.array([math.inf])
        found = Enclosures(self.g, nodes, self.values, self.moving)(*line)
        return [self._sign(float(x.lo[0]), float(x.hi[0])) for x in found]

    @staticmethod
    def _sign(lo: float, hi: float) -> int:
        if not lo <= hi or lo == hi == 0.0:
            return 0
        return 1 if lo >= 0.0 else -1 if hi <= 0.0 else 0

    # Kinks of any other kind: both sides near them, and a line

    def _apart(self, n: int, way: int) -> list[int]:
        """Pieces of a node by the two sides of its innermost kink."""
        g = self.g
        atom = next(iter(self.kinked([n])))
        found = self._sides(atom)
        if found is None:
            return [n]
        u, above, below = found
        x, y = (g.substitute([n], {atom: side})[0] for side in (above, below))
        jump = self._jump(g.call("sub", x, y), u)
        if jump is None or self.sign(jump) != -way:
            return [n]
        line = g.call("mul", jump, u)
        on, off = g.call("ge", u, g.zero), g.call("le", u, g.zero)
        first = g.call("if", on, x, g.call("add", y, line))
        second = g.call("if", off, y, g.call("sub", x, line))
        return [first, second]

    def _sides(self, n: int) -> tuple[int, int, int] | None:
        """Expression u of a kink, and what the node is for u > 0, and for u < 0."""
        g, op, args = self.g, self.g.ops[n], self.g.args[n]
        if op == "abs":
            return args[0], args[0], g.call("neg", args[0])
        if op in ("min", "max"):
            above, below = args if op == "max" else args[::-1]
            return g.call("sub", *args), above, below
        if op != "if" or g.ops[args[0]] not in COMPARISONS:
            return None
        sign = COMPARISONS[g.ops[args[0]]]
        u = g.call("sub", *g.args[args[0]])
        steps = {a for a in g.cone([u]) if g.ops[a] in STEPS}
        above, below = args[1:][::sign]
        return None if steps else (u, above, below)

    def _jump(self, difference: int, u: int) -> int | None:
        """Return r of difference = r u near u = 0; None where there is none."""
        g = self.g
        names = [v for v in map(g.variable, self.moving) if v in g.cone([u])]
        by_u, by_all = (slopes(g, x, frozenset(names)) for x in (u, difference))
        one = {v: s for v, s in by_u.items() if s != g.zero}
        if len(one) == 1:
            [(v, slope)] = one.items()
            return g.call("div", by_all.get(v, g.zero), slope)
        square = g.product_sum((s, s) for s in one.values())
        along = g.product_sum((s, by_all.get(v, g.zero)) for v, s in one.items())
        return None if square == g.zero else g.call("div", along, square)

    # Linear tables

    def _of_table(self, n: int, way: int) -> list[int]:
        """Pieces of a linear table of an argument without kinks: lines and a table."""
        g = self.g
        axis, data = (g.payload(a) for a in g.args[n][:2])
        w = g.args[n][3]
        if self.kinked([w]) or axis.values[2]:
            return [n]
        x, y, slope = _lines(axis, data)
        jumps = np.diff(slope)
        clear = np.abs(jumps) > SAME_SLOPE * np.max(np.abs(slope))
        grooves = clear & (way * jumps < 0.0)
        if not grooves.any():
            return [n]
        # What has the other knots alone, 0 before them; what is left has lines.
        rest = clear & ~grooves
        others = np.where(rest, jumps, 0.0) @ np.maximum(x - x[:, None], 0.0)
        knots = [0, *np.flatnonzero(grooves).tolist()]
        steps = np.cumsum([slope[0], *jumps[grooves]]).tolist()
        rise = _bent(g, axis, w, x[rest], jumps[rest])
        ends = (x[0], x[-1]) if axis.values[3] else None
        found = []
        for k, step in zip(knots, steps, strict=True):
            line = _line(g, axis, w, (x[k], y[k] - others[k], step), ends)
            found.append(g.call("add", line, rise))
        return found


def _lines(axis: Data, data: Data) -> tuple[Floats, Floats, Floats]:
    """Knots x (m + 1,) of a linear table, values there, slopes (m + 2,) between.

    Where a run ends with the table, it goes on as at its ends.
    """
    x = np.array(axis.values[tables.FIRST :])
    values, slope = np.array(data.values[1:]).reshape(-1, tables.LINEAR).T
    y = np.append(values[1:-1], values[-2] + slope[-2] * (x[-1] - x[-2]))
    if axis.values[3]:
        slope = np.array([slope[1], *slope[1:-1], slope[-2]])
    return x, y, slope


def _line(
    g: Graph,
    axis: Data,
    w: int,
    at: tuple[float, float, float],
    ends: tuple[float, float] | None,
) -> int:
    """Line y + slope (w - x), at = (x, y, slope); between two ends where there are."""
    x, y, slope = at
    if ends is None:
        way = g.call("sub", w, g.constant(x))
        return g.call("add", g.constant(y), g.call("mul", g.constant(slope), way))
    points = np.array(ends)
    made = tables.made(
        axis.name, (points,), y + slope * (points - x), "linear", "error"
    )
    return tables.called(g, *made, [w])


def _bent(g: Graph, axis: Data, w: int, x: Floats, jumps: Floats) -> int:
    """Linear table of w with these jumps of its slope at knots x (k,), 0 before."""
    if not len(x):
        return g.zero
    far = FAR * max(float(x[-1] - x[0]), float(np.max(np.abs(x))), 1.0)
    points = np.array([x[0] - far, *x, x[-1] + far])
    values = jumps @ np.maximum(points - x[:, None], 0.0)
    made = tables.made(axis.name, (points,), values, "linear", "extend")
    return tables.called(g, *made, [w])
