"""Expressions as rows show them: as written, but for switches that are followed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lagsim.language.functions import CHOOSING, JOINING, OPERATIONS, STEPS
from lagsim.mechanics.switches.surfaces import (
    Side,
    between,
    share,
    stepped,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.graph import Graph
    from lagsim.mechanics.switches.roots import Roots


# What is linear in each of its arguments, or in each branch and in the condition.
LINEAR = ("mul", "if")
SUMS = ("add", "sub", "neg")


class Shown:
    """Replaces steps by what they are worth while the motion slides."""

    def __init__(
        self,
        g: Graph,
        sides: Sequence[Side],
        sides_of: Mapping[int, tuple[int, int]],
        roots: Roots,
    ) -> None:
        self.g, self.roots = g, roots
        self.sides_of = sides_of
        half, less = g.constant(0.5), g.constant(-0.5)
        modes = {g.variable(s.variable): g.variable(s.sliding) for s in sides}
        self.slides = {v: g.call("gt", m, half) for v, m in modes.items()}
        self.level = {v: g.call("lt", m, less) for v, m in modes.items()}
        self.whole = frozenset(g.variable(s.variable) for s in sides if s.whole)
        self.done: dict[int, int] = {}
        self.shares: dict[int, int] = {}  # of the conditions that may be between
        self.on: dict[int, frozenset[int]] = {}  # the sides that each node goes with

    def nodes(self, nodes: list[int]) -> list[int]:
        """Give `nodes` as shown."""
        g = self.g
        if not self.slides:
            return nodes
        for n in g.cone(nodes):
            args = tuple(self.done[a] for a in g.args[n])
            same = n if args == g.args[n] else g.call(g.ops[n], *args)
            self.done[n] = self._between(n, same, args)
            self._combine(n)
        return [self.done[n] for n in nodes]

    def _between(self, n: int, same: int, args: tuple[int, ...]) -> int:
        g, op = self.g, self.g.ops[n]
        if self.roots.floor(n) is not None:
            return self._root(n, args)
        side = self.sides_of.get(n)
        if side is not None:
            slides, level = self.slides[side[0]], self.level[side[0]]
            kept = stepped(g, op, *side)
            if op in STEPS:
                same = g.call("if", level, kept, same)
                return g.call("if", slides, between(g, op, *side), same)
            kept = g.call("and", level, kept)
            same = g.call("or", kept, g.call("and", g.call("not", level), same))
            whole = g.call("if", same, g.one, g.zero)
            self.shares[n] = g.call("if", slides, share(g, op, *side), whole)
        elif op in JOINING and any(a in self.shares for a in g.args[n]):
            self.shares[n] = self._joined(op, [self._share(a) for a in g.args[n]])
        elif op == "if" and g.args[n][0] in self.shares:
            part = self.shares[g.args[n][0]]
            more = g.call("mul", part, g.call("sub", args[1], args[2]))
            mixed = g.call("add", args[2], more)
            low = g.call("if", g.call("le", part, g.zero), args[2], mixed)
            return g.call("if", g.call("ge", part, g.one), args[1], low)
        return same

    def _combine(self, n: int) -> None:
        """Let what is not linear in a side be the combination of both sides, as forces.

        A branch of a branch, a product of two steps. Of whole numbers a side is left.
        """
        g, op = self.g, self.g.ops[n]
        below = [self.on[a] for a in g.args[n]]
        own = self.sides_of.get(n)
        self.on[n] = frozenset().union(*below, {own[0]} if own else ())
        if own or not self.on[n] or self.roots.floor(n) is not None:
            return
        if op in SUMS:
            return
        row = OPERATIONS[op]
        if row.condition and n not in self.shares:
            self.shares[n] = g.call("if", self.done[n], g.one, g.zero)
        found = self.shares if row.condition else self.done
        most = 1 if op in LINEAR or op in JOINING else 0
        for v in self.on[n] - self.whole:
            if sum(v in one for one in below) > most:
                found[n] = self._mixed(found[n], v)

    def _mixed(self, n: int, v: int) -> int:
        g, half = self.g, self.g.constant(0.5)
        low, high = (
            g.substitute([n], {v: side})[0] for side in (g.constant(-1.0), g.one)
        )
        part = g.call("add", half, g.call("mul", half, v))
        more = g.call("mul", part, g.call("sub", high, low))
        return g.call("if", self.slides[v], g.call("add", low, more), n)

    def _root(self, n: int, args: tuple[int, ...]) -> int:
        """Give a root with its floor, which is 0 unless the motion slides."""
        g, op, inner = self.g, self.g.ops[n], self.g.args[n][0]
        if g.ops[inner] in CHOOSING:
            return self._apart(n, inner, args)
        if op != "cbrt":
            return g.call(op, self.roots.floored(n, args[0]), *args[1:])
        size = self.roots.floored(n, g.call("abs", args[0]))
        kept = g.call("sign", args[0])
        side = self.sides_of.get(g.call("sign", inner))
        if side is not None:
            kept = g.call("if", self.slides[side[0]], between(g, "sign", *side), kept)
        return g.call("mul", kept, g.call("cbrt", size))

    def _apart(self, n: int, inner: int, args: tuple[int, ...]) -> int:
        """Give a root of what has two branches, as the combination of their roots."""
        g, op = self.g, self.g.ops[inner]
        condition, *branches = g.args[inner]
        if op != "if":
            branches = list(g.args[inner])
            condition = g.call(OPERATIONS[op].decided_by, *branches)
        roots = [
            g.call(g.ops[n], self.roots.floored(n, self.done[x]), *args[1:])
            for x in branches
        ]
        side = self.sides_of.get(condition)
        plain = g.call(g.ops[n], args[0], *args[1:])
        if side is None:
            return plain
        more = g.call("sub", *roots)
        more = g.call("mul", share(g, g.ops[condition], *side), more)
        mixed = g.call("add", roots[1], more)
        return g.call("if", self.slides[side[0]], mixed, plain)

    def _share(self, condition: int) -> int:
        g = self.g
        if condition in self.shares:
            return self.shares[condition]
        return g.call("if", self.done[condition], g.one, g.zero)

    def _joined(self, op: str, parts: list[int]) -> int:
        g = self.g
        if op == "and":
            return g.call("mul", *parts)
        missing = [g.call("sub", g.one, part) for part in parts]
        if op == "not":
            return missing[0]
        return g.call("sub", g.one, g.call("mul", *missing))
