"""The kinetic energy of bodies on chains, as squares of sums along the chains.

With x_k' = x_{k-1}' + l cos(a_k) a_k' and so on M of the angles is full, but the energy
in all of x_k' and a_k' is a sum of a few squares each. Found on the graph: definitions
written with each other, and sums that expressions share, are the same there.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.disjoint_sets import DisjointSets
from lagsim.language.rounding import roundings

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from lagsim.language.graph import Graph

Vector = dict[int, int]  # unknown -> node; what is absent is zero

FLAT = frozenset((0,))
AFFINE = frozenset((0, 1))


class Chains(NamedTuple):
    """The kinetic energy as squares of sums, which are written with each other.

    The unknowns 0 to n - 1 are the velocities, those from n on the sums.

    Attributes
    ----------
    size : int
        n.
    sums : tuple of dict
        Sum k, unknown n + k: its factor of each unknown in it. Only sums before k.
    squares : dict
        (i, j), i <= j: the second derivative of L by these two unknowns.
    rates : tuple of int
        The sums, as nodes of L.
    """

    size: int
    sums: tuple[Vector, ...]
    squares: dict[tuple[int, int], int]
    rates: tuple[int, ...]

    @property
    def key(self) -> tuple[object, ...]:
        """What is equal for equal chains."""
        sums = (tuple(form.items()) for form in self.sums)
        return (*sums, tuple(self.squares.items()))

    @property
    def nodes(self) -> list[int]:
        """All that M is made of."""
        factors = [node for form in self.sums for node in form.values()]
        return [*factors, *self.squares.values()]

    def product(self, g: Graph, x: Sequence[int]) -> list[int]:
        """Give M x (n,): along the chains and back."""
        found = [*x, *(g.zero for _ in self.sums)]
        for k, form in enumerate(self.sums, self.size):
            found[k] = g.product_sum((c, found[i]) for i, c in form.items())
        forces = [g.zero] * len(found)
        for (i, j), weight in self.squares.items():
            for a, b in {(i, j), (j, i)}:
                term = g.call("mul", weight, found[b])
                forces[a] = g.call("add", forces[a], term)
        for k in range(len(found) - 1, self.size - 1, -1):
            for i, c in self.sums[k - self.size].items():
                forces[i] = g.call("add", forces[i], g.call("mul", c, forces[k]))
        return forces[: self.size]

    def sizes(self, g: Graph, x: Sequence[int], moving: Collection[str]) -> list[int]:
        """Give the size of the terms of M x and of what rounds factors, for x >= 0."""
        rounded = dict(zip(self.nodes, roundings(g, self.nodes, moving), strict=True))

        def size(node: int) -> int:
            return g.call("add", g.call("abs", node), rounded[node])

        sums = ({i: size(c) for i, c in form.items()} for form in self.sums)
        squares = {key: size(weight) for key, weight in self.squares.items()}
        return self._replace(sums=tuple(sums), squares=squares).product(g, x)

    def groups(self) -> list[tuple[list[int], list[int]]]:
        """Give the coordinates that M couples, group by group, with its nodes."""
        together = DisjointSets(self.size + len(self.sums))
        for k, form in enumerate(self.sums, self.size):
            for i in form:
                together.merge(k, i)
        for i, j in self.squares:
            together.merge(i, j)
        place: dict[int, int] = {}
        found: list[tuple[list[int], list[int]]] = []
        for at, group in enumerate(together.sets()):
            place |= dict.fromkeys(group, at)
            found.append(([], [i for i in group if i < self.size]))
        for k, form in enumerate(self.sums, self.size):
            found[place[k]][0].extend(form.values())
        for (i, _), weight in self.squares.items():
            found[place[i]][0].append(weight)
        return found

    def neighbours(self) -> list[int]:
        """Give for each velocity those it meets in M, as the bits of a number."""
        reach = [1 << j for j in range(self.size)]
        for form in self.sums:
            mask = 0
            for i in form:
                mask |= reach[i]
            reach.append(mask)
        met = [0] * len(reach)
        for i, j in self.squares:
            met[i] |= reach[j]
            met[j] |= reach[i]
        for k in range(len(met) - 1, self.size - 1, -1):
            for i in self.sums[k - self.size]:
                met[i] |= met[k]
        return met[: self.size]


class _NotFoundError(Exception):
    """L is not seen to be quadratic in sums of velocities."""


def chains(
    g: Graph,
    lagrangian: int,
    rates: Sequence[int],
    names: Collection[str],
    moving: Collection[str] = (),
) -> Chains | None:
    """Find how `lagrangian` is written with sums of the velocities `rates`.

    None where it is no polynomial of second degree in them, as far as is seen.

    Parameters
    ----------
    moving
        The square of one velocity is that of a sum where its factor depends on these.
    """
    cone = g.cone([lagrangian])
    degrees = dict(zip(cone, g.degrees(cone, names), strict=True))
    whole = degrees[lagrangian]
    if whole is None or max(whole, default=0) > 2:
        return None
    try:
        products = _products(g, cone, degrees)
        return _Reader(g, degrees, rates, products).chains(frozenset(moving))
    except _NotFoundError:
        return None


def _products(
    g: Graph, cone: Sequence[int], degrees: Mapping[int, frozenset[int] | None]
) -> dict[tuple[int, int], int]:
    """Give the factor of each product of two affine nodes in the last of `cone`."""
    weights = {cone[-1]: g.one}
    found: dict[tuple[int, int], int] = {}
    for n in reversed(cone):
        weight = weights.pop(n, g.zero)
        if weight == g.zero or _within(degrees[n], AFFINE):
            continue
        factors = _factors(g, n, degrees)
        if factors is not None:
            found[factors] = g.call("add", found.get(factors, g.zero), weight)
            continue
        for a, scale in _slopes(g, n, degrees):
            term = g.call("mul", weight, scale)
            weights[a] = g.call("add", weights.get(a, g.zero), term)
    return found


def _factors(
    g: Graph, n: int, degrees: Mapping[int, frozenset[int] | None]
) -> tuple[int, int] | None:
    """Give the two affine nodes that `n` is a product of."""
    args = g.args[n]
    if g.ops[n] == "pow" and g.value(args[1]) == 2.0:
        args = (args[0], args[0])
    elif g.ops[n] != "mul":
        return None
    if all(_within(degrees[a], AFFINE) and degrees[a] != FLAT for a in args):
        return min(args), max(args)
    return None


def _slopes(
    g: Graph, n: int, degrees: Mapping[int, frozenset[int] | None]
) -> list[tuple[int, int]]:
    """Give what `n` is a sum of, with factors: only what moves with velocities."""
    op, args = g.ops[n], g.args[n]
    one, minus = g.one, g.constant(-1.0)
    flat = [_within(degrees[a], FLAT) for a in args]
    if op in ("add", "sub"):
        terms = zip(args, (one, one if op == "add" else minus), flat, strict=True)
        return [(a, scale) for a, scale, still in terms if not still]
    if op == "neg":
        return [(args[0], minus)]
    if op == "mul" and any(flat):
        return [(args[1], args[0])] if flat[0] else [(args[0], args[1])]
    if op == "div" and flat[1]:
        return [(args[0], g.call("div", one, args[1]))]
    raise _NotFoundError


def _within(degree: frozenset[int] | None, most: frozenset[int]) -> bool:
    return degree is not None and degree <= most


class _Reader:
    """Names the sums that are unknowns: those needed more than once, and squared."""

    def __init__(
        self,
        g: Graph,
        degrees: Mapping[int, frozenset[int] | None],
        rates: Sequence[int],
        products: Mapping[tuple[int, int], int],
    ) -> None:
        self.g, self.products, self.size = g, products, len(rates)
        ends = set(rates)
        self.parts: dict[int, list[tuple[int, int]]] = {}
        self.uses = Counter(a for pair in products for a in set(pair))
        stack = list(self.uses)
        while stack:
            n = stack.pop()
            if n in ends or n in self.parts:
                continue
            self.parts[n] = _slopes(g, n, degrees)
            self.uses.update(a for a, _ in self.parts[n])
            stack += [a for a, _ in self.parts[n]]
        self.forms = {v: {j: g.one} for j, v in enumerate(rates)}
        self.sums: list[Vector] = []
        self.rates: list[int] = []

    def chains(self, moving: frozenset[str]) -> Chains:
        g, squared = self.g, {a for pair in self.products for a in pair}
        for n in sorted(self.parts):
            form = self._sum(self.parts[n])
            several = len(form) > 1 and (self.uses[n] > 1 or n in squared)
            turning = n in squared and not moving.isdisjoint(g.depends(form.values()))
            if several or turning:
                self.sums.append(form)
                self.rates.append(n)
                form = {self.size + len(self.sums) - 1: g.one}
            self.forms[n] = form
        sums, rates = tuple(self.sums), tuple(self.rates)
        return Chains(self.size, sums, self._squares(), rates)

    def _sum(self, parts: Sequence[tuple[int, int]]) -> Vector:
        g, total = self.g, Vector()
        for a, scale in parts:
            for i, factor in self.forms[a].items():
                term = g.call("mul", scale, factor)
                total[i] = g.call("add", total.get(i, g.zero), term)
        return {i: node for i, node in total.items() if node != g.zero}

    def _squares(self) -> dict[tuple[int, int], int]:
        g = self.g
        found: dict[tuple[int, int], int] = {}
        for (a, b), weight in self.products.items():
            for i, one in self.forms[a].items():
                for j, other in self.forms[b].items():
                    term = g.call("mul", weight, g.call("mul", one, other))
                    if i == j:
                        term = g.call("mul", g.constant(2.0), term)
                    key = min(i, j), max(i, j)
                    found[key] = g.call("add", found.get(key, g.zero), term)
        return found
