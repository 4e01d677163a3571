"""Sums of products in which what stands still is collected.

    (1/m) dx dx + (1/n) dx dx + (1/m) dy dy + (1/n) dy dy = (1/m + 1/n) (dx dx + dy dy):

equal products are added, and a factor that several have is multiplied once. Nothing is
multiplied out: a sum is a factor as it is.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from lagsim.language.functions.simpler import is_normal
from lagsim.language.graph import VARIABLE

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from lagsim.language.graph import Graph

ARITHMETIC = frozenset(("add", "sub", "neg", "mul", "div", "pow"))
# The factors that move in a product; and products that are added or subtracted.
Key = tuple[int, ...]
Group = list[tuple[str, Key]]


class Collected:
    """Makes such sums.

    Parameters
    ----------
    moving
        The names of what moves. All else is computed once.
    """

    def __init__(self, g: Graph, moving: Collection[str]) -> None:
        self.g = g
        self.moving = frozenset(moving)
        self._parts: dict[int, tuple[int, int]] = {}
        self._still: dict[tuple[int, ...], int] = {}

    def moves(self, n: int) -> bool:
        """Tell whether `n` depends on what moves."""
        return self.parts(n)[1] != self.g.one

    def sum(self, products: Iterable[Sequence[int]]) -> int:
        """Give the sum of products of nodes."""
        g, total = self.g, self.g.zero
        alike, given = self._alike(products)
        for still, group in alike.items():
            found = [factors for _, key in group for factors in given[key]]
            if len(found) == 1 and self._stays(still, found[0]):
                term = self._product(found[0])
            else:
                term = g.call("mul", still, self._written(group))
            total = g.call("add", total, term)
        return total

    def _alike(
        self, products: Iterable[Sequence[int]]
    ) -> tuple[dict[int, Group], dict[Key, list[Sequence[int]]]]:
        """Give what moves by the factor in front of it; and what was given of each."""
        g = self.g
        given: dict[Key, list[Sequence[int]]] = {}
        fronts: dict[Key, int] = {}
        for factors in products:
            parts = [self.parts(n) for n in factors]
            key = tuple(sorted(core for _, core in parts if core != g.one))
            still = self.still([c for c, _ in parts])
            fronts[key] = g.call("add", fronts.get(key, g.zero), still)
            given.setdefault(key, []).append(factors)
        alike: dict[int, Group] = {}
        for key, still in fronts.items():
            opposite = g.call("neg", still)
            if opposite in alike:
                alike[opposite].append(("sub", key))
            elif still != g.zero:
                alike.setdefault(still, []).append(("add", key))
        return alike, given

    def scaled(self, node: int, factor: int) -> int:
        """Give node * factor; what of it stands still goes into a sum if that is short.

        m (a + ...) - k b times 1/m is a + ... - (k/m) b.
        """
        g = self.g
        still, core = self.parts(factor)
        terms = [(sign, *self.parts(n)) for sign, n in self.addends(node)]
        inside = [(still, *factors) for factors in terms]
        signs = {g.one, g.constant(-1.0)}
        before, after = (len(self._alike(x)[0].keys() - signs) for x in (terms, inside))
        if still == g.one or after > before or (after == before and core != g.one):
            return g.call("mul", node, factor)
        return g.call("mul", self.sum(inside), core)

    def tidy(self, nodes: Sequence[int]) -> list[int]:
        """Give equal expressions, all sums in which are collected, or `nodes`.

        Which of both takes less.
        """
        g = self.g
        functions = {n for n in g.cone(nodes) if g.ops[n] not in ARITHMETIC}
        cone = g.cone(nodes, functions)  # what is below these is shared as it is
        linear = ("add", "sub", "neg")
        users = {a for n in cone if g.ops[n] not in linear for a in g.args[n]}
        users.update(nodes)
        done: dict[int, int] = {}
        for n in cone:
            if n in functions or not self.moves(n):
                done[n] = n
                continue
            new = g.call(g.ops[n], *(done[a] for a in g.args[n]))
            if g.ops[n] not in linear:
                still, core = self.parts(new)
                new = g.call("mul", still, core)
            elif n in users:
                new = self.sum((sign, *self.parts(x)) for sign, x in self.addends(new))
            done[n] = new
        found = [done[n] for n in nodes]
        return min(list(nodes), found, key=lambda x: g.cost(x, self.moving))

    def _stays(self, still: int, factors: Sequence[int]) -> bool:
        """Tell whether a product that is like no other is best as it is given.

        What stands still in its factors may stand so elsewhere, and is collected only
        where there is less of it then.
        """
        signs = self.g.one, self.g.constant(-1.0)
        fixed = [n for n in factors if n not in signs and not self.moves(n)]
        if still in signs or len(fixed) > 1:
            return False
        own = [c for c in (self.parts(n)[0] for n in factors) if c not in signs]
        return len(own) == 1 or self._size([still]) == sum(self._size([c]) for c in own)

    def _size(self, factors: Sequence[int]) -> int:
        return sum(map(abs, self._powers(factors)[1].values()))

    def _written(self, group: Group) -> int:
        """Give a sum of products, in which a factor that several have stands once."""
        g, total = self.g, self.g.zero
        held = Counter(n for _, key in group for n in set(key))
        for shared, times in held.most_common():
            if times == 1:
                break
            inner = [(op, _without(key, shared)) for op, key in group if shared in key]
            if len(inner) > 1:
                term = g.call("mul", shared, self._written(inner))
                total = g.call("add", total, term)
                group = [(op, key) for op, key in group if shared not in key]
        for op, factors in group:
            total = g.call(op, total, self._product(factors))
        return total

    def _product(self, factors: Sequence[int]) -> int:
        g, whole = self.g, self.g.one
        for n in factors:
            whole = g.call("mul", whole, n)
        return whole

    def addends(self, node: int) -> Iterator[tuple[int, int]]:
        """Give what `node` is a sum of: signs, as nodes, and addends.

        A sum of no products stays whole: it may be a small difference.
        """
        g = self.g
        sums = self._sums_of_products(node)
        stack = [(node, 1.0)]
        while stack:
            n, sign = stack.pop()
            op, args = g.ops[n], g.args[n]
            if n in sums:
                stack.append((args[-1], sign if op == "add" else -sign))
                if op != "neg":
                    stack.append((args[0], sign))
            else:
                yield g.constant(sign), n

    def _sums_of_products(self, node: int) -> set[int]:
        """Give the sums at and below `node`, through sums, that have products."""
        g = self.g
        sums, stack = set[int](), [node]
        while stack:
            n = stack.pop()
            if g.ops[n] in ("add", "sub", "neg") and n not in sums:
                sums.add(n)
                stack += g.args[n]
        found = set[int]()
        for n in sorted(sums):
            if any(a in found or g.ops[a] in ("mul", "div") for a in g.args[n]):
                found.add(n)
        return found

    def parts(self, n: int) -> tuple[int, int]:
        """Give what stands still, and what moves, of which `n` is the product."""
        known = self._parts
        if n not in known:
            near = all(a in known for a in self.g.args[n])
            for below in (n,) if near else self.g.cone([n], known):
                if below not in known:
                    known[below] = self._apart(below)
        return known[n]

    def _apart(self, n: int) -> tuple[int, int]:
        g = self.g
        op, args = g.ops[n], g.args[n]
        if op == VARIABLE and g.payload(n) in self.moving:
            return g.one, n
        found = [self._parts[a] for a in args]
        if all(core == g.one for _, core in found):
            return n, g.one
        if op == "pow" and g.value(args[1]) == 2.0:
            c, x = found[0]
            return self.still([c, c]), g.call("mul", x, x)
        if op not in ARITHMETIC or op == "pow":
            return g.one, n
        (c, x), (d, y) = found[0], found[-1]
        if op == "neg":
            return g.call("neg", c), x
        if op == "mul":
            return self.still([c, d]), g.call("mul", x, y)
        if op == "div":
            return self.still([c, g.call("div", g.one, d)]), g.call("div", x, y)
        return self._common(n, *found)

    def _common(
        self, n: int, one: tuple[int, int], other: tuple[int, int]
    ) -> tuple[int, int]:
        """Give the parts of a sum or difference: what both terms have in common."""
        g = self.g
        op, (c, x), (d, y) = g.ops[n], one, other
        opposite = g.known("sub", g.args[n][::-1]) if op == "sub" else None
        if opposite is not None and opposite < n:
            return g.constant(-1.0), opposite
        if c == d != g.one:
            return c, g.call(op, x, y)
        if c == g.call("neg", d) and c != g.one:
            return c, g.call("sub" if op == "add" else "add", x, y)
        return g.one, n

    def still(self, factors: Sequence[int]) -> int:
        """Give the product of factors that stand still; what divides it cancels."""
        g = self.g
        key = tuple(n for n in factors if n != g.one)
        if len(key) < 2:
            return key[0] if key else g.one
        if key not in self._still:
            number, powers = self._powers(key)
            top, bottom = g.constant(number), g.one
            for n in sorted(powers):
                for _ in range(powers[n]):
                    top = g.call("mul", top, n)
                for _ in range(-powers[n]):
                    bottom = g.call("mul", bottom, n)
            self._still[key] = g.call("div", top, bottom)
        return self._still[key]

    def _powers(self, factors: Sequence[int]) -> tuple[float, Counter[int]]:
        """Give the number, and the exponents of the nodes, of a product."""
        g = self.g
        number, powers = 1.0, Counter[int]()
        waiting = [(n, 1) for n in factors]
        while waiting:
            n, e = waiting.pop()
            op, args, value = g.ops[n], g.args[n], g.value(n)
            if op == "mul":
                waiting += ((a, e) for a in args)
            elif op == "div":
                waiting += ((args[0], e), (args[1], -e))
            elif op == "neg":
                number = -number
                waiting.append((args[0], e))
            elif value is not None and e > 0 and is_normal(number * value):
                number *= value
            else:
                powers[n] += e
        return number, powers


def _without(factors: tuple[int, ...], one: int) -> tuple[int, ...]:
    at = factors.index(one)
    return factors[:at] + factors[at + 1 :]
