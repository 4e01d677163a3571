"""Sums of products of sines and cosines, in fewer terms.

    sin(a)^2 + cos(a)^2 = 1,  cos(a) cos(b) + sin(a) sin(b) = cos(a - b),  and its kin:

what energies written in the positions of bodies that turn are full of. Products are
multiplied out as far as there are sines and cosines in them; other sums stay whole.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from lagsim.language.graph import CONSTANT
from lagsim.language.normal_form import sum_node

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from lagsim.language.graph import Graph

# A product of powers as one integer, with so many bits for each exponent: the product
# of two is their sum. A sum of products gives each its number.
Sum = dict[int, float]
BITS = 6
LARGEST_EXPONENT = 2**BITS - 1

# Products of two terms, in all, or for each expression where there are many: where it
# takes more, nothing is changed.
MOST_PRODUCTS, PRODUCTS_EACH = 20_000, 10


class TooLongError(Exception):
    """Multiplied out, the expressions would be too long."""


class Origin(NamedTuple):
    """What a sine or cosine is: `factor` times that of a + sign b."""

    op: str
    a: int
    b: int
    sign: int
    factor: int


def fewer_terms(g: Graph, nodes: Sequence[int], moving: Collection[str]) -> list[int]:
    """Give equal expressions for `nodes`, which are shorter in all, or these.

    Parameters
    ----------
    moving
        The names of what moves. All else is computed once, and counts nothing.
    """
    nodes = list(nodes)
    try:
        terms = _Terms(g, g.cone(nodes), PRODUCTS_EACH * len(nodes))
    except TooLongError:
        return nodes
    joined = _Joined(g, terms)
    sums = {n: joined.of(n) for n in dict.fromkeys(nodes) if n in terms.turning}
    writer = _Writer(g, terms, joined, moving)
    found = [writer.node(sums[n]) if n in sums else n for n in nodes]
    return min((nodes, found), key=lambda x: g.cost(x, moving))


# sin(a + b) = sin a cos b + cos a sin b, cos(a + b) = cos a cos b - sin a sin b.
_SHIFTED = {
    "sin": (("sin", "cos"), ("cos", "sin")),
    "cos": (("cos",) * 2, ("sin",) * 2),
}


class _Terms:
    """The nodes of a cone as sums of products.

    Attributes
    ----------
    turning : set of int
        The nodes that have sines or cosines below them.
    factors : list of int
        The nodes that products are made of, in the order of their bits.
    """

    def __init__(self, g: Graph, cone: Sequence[int], products: int) -> None:
        self.g = g
        self.turning: set[int] = set()
        self.factors: list[int] = []
        self._places: dict[int, int] = {}
        self._left = max(MOST_PRODUCTS, products)
        self.sums: dict[int, Sum] = {}
        self._degrees: dict[int, int] = {}
        for n in cone:
            if g.ops[n] in _SHIFTED or any(a in self.turning for a in g.args[n]):
                self.turning.add(n)
            self.sums[n], self._degrees[n] = self._of(n)

    def product(self, factor: int, exponent: int = 1) -> int:
        """Give a power of a node as a product."""
        place = self._places.get(factor)
        if place is None:
            place = self._places[factor] = BITS * len(self.factors)
            self.factors.append(factor)
        return exponent << place

    def powers(self, product: int) -> Iterator[tuple[int, int]]:
        """Give the factors of a product, with their exponents."""
        while product:
            k = ((product & -product).bit_length() - 1) // BITS
            exponent = product >> k * BITS & LARGEST_EXPONENT
            yield self.factors[k], exponent
            product -= exponent << k * BITS

    def _of(self, n: int) -> tuple[Sum, int]:
        """Give the sum that node `n` is, and a bound of its exponents."""
        g = self.g
        op, args = g.ops[n], g.args[n]
        if op == CONSTANT:
            value = g.value(n)
            return ({0: value} if value else {}), 0
        whole = None
        if n in self.turning or op in ("mul", "neg", "div", "pow"):
            whole = self._below(op, args)
        return whole or ({self.product(n): 1.0}, 1)

    def _below(self, op: str, args: tuple[int, ...]) -> tuple[Sum, int] | None:
        """Give the sum that an operation makes of those of its arguments."""
        sums = [self.sums[a] for a in args]
        degrees = [self._degrees[a] for a in args]
        if op in ("add", "sub"):
            return _added(sums[0], sums[1], 1.0 if op == "add" else -1.0), max(degrees)
        if op == "neg":
            return {m: -c for m, c in sums[0].items()}, degrees[0]
        if op == "mul":
            return self._multiplied(sums[0], sums[1], sum(degrees)), sum(degrees)
        value = self.g.value(args[-1]) if op in ("div", "pow") else None
        if op == "div" and value:
            return {m: c / value for m, c in sums[0].items()}, degrees[0]
        if op == "pow" and value in (2.0, 3.0, 4.0):
            whole, degree = sums[0], degrees[0] * int(value)
            for _ in range(int(value) - 1):
                whole = self._multiplied(whole, sums[0], degree)
            return whole, degree
        return None

    def _multiplied(self, a: Sum, b: Sum, degree: int) -> Sum:
        self._left -= len(a) * len(b)
        if self._left < 0 or degree > LARGEST_EXPONENT:
            raise TooLongError
        total: Sum = {}
        for m, c in a.items():
            for k, d in b.items():
                total[m + k] = total.get(m + k, 0.0) + c * d
        return {m: c for m, c in total.items() if c}


def _added(a: Sum, b: Sum, sign: float) -> Sum:
    total = dict(a)
    for m, c in b.items():
        total[m] = total.get(m, 0.0) + sign * c
    return {m: c for m, c in total.items() if c}


class _Joined:
    """The sums in which no identity makes one term of two.

    Attributes
    ----------
    origins : dict
        The sines and cosines of sums of angles that this has brought.
    """

    def __init__(self, g: Graph, terms: _Terms) -> None:
        self.g, self.terms = g, terms
        self.origins: dict[int, Origin] = {}

    def of(self, n: int) -> Sum:
        """Give the sum that node `n` is, joined."""
        whole, terms = dict(self.terms.sums[n]), -1
        while len(whole) != terms:  # what was joined may join others
            terms = len(whole)
            for m in list(whole):
                found = next(self._joint(whole, m), None) if m in whole else None
                if found is not None:
                    second, joint, c = found
                    del whole[m], whole[second]
                    total = whole.pop(joint, 0.0) + c
                    if total:
                        whole[joint] = total
        return whole

    def _joint(self, whole: Sum, m: int) -> Iterator[tuple[int, int, float]]:
        """Give terms that join the term `m`, and what they are together."""
        g, product = self.g, self.terms.product
        turns = [(n, e) for n, e in self.terms.powers(m) if g.ops[n] in _SHIFTED]
        sines = [(n, e) for n, e in turns if g.ops[n] == "sin"]
        for sine, exponent in sines:
            cosine = g.call("cos", *g.args[sine])
            rest = m - product(sine, 2)
            second = rest + product(cosine, 2)
            if exponent >= 2 and whole.get(second) == whole[m]:
                yield second, rest, whole[m]
        for sine, _ in sines:
            for other, _ in turns:
                yield from self._turned(whole, m, sine, other)

    def _turned(
        self, whole: Sum, m: int, sine: int, other: int
    ) -> Iterator[tuple[int, int, float]]:
        g, product = self.g, self.terms.product
        (a,), (b,) = g.args[sine], g.args[other]
        if a == b:
            return
        rest = m - product(sine) - product(other)
        op, swapped = ("cos", "cos") if g.ops[other] == "sin" else ("sin", "sin")
        second = rest + product(g.call("cos", a)) + product(g.call(swapped, b))
        c, d = whole[m], whole.get(second)
        if d is None or abs(d) != abs(c):
            return
        # sin a sin b stands with cos a cos b, sin a cos b with cos a sin b.
        equal = 1 if c == d else -1
        node, sign = self._turn(op, a, b, -equal if op == "cos" else equal)
        scale = sign * (d if op == "cos" else c)
        value = g.value(node)
        if value is None:
            yield second, rest + product(node), scale
        else:
            yield second, rest, scale * value

    def _turn(self, op: str, a: int, b: int, sign: int) -> tuple[int, int]:
        """Give the sine or cosine of a + sign b, and the sign in front of it."""
        g = self.g
        angle = _linear(g, a)
        for n, k in _linear(g, b).items():
            angle[n] = angle.get(n, 0) + sign * k
        angle = {n: k for n, k in sorted(angle.items()) if k}
        flipped = next(iter(angle.values()), 1) < 0
        total = g.zero
        for n, k in angle.items():
            term = g.call("mul", g.constant(abs(k)), n)
            total = g.call("sub" if (k < 0) != flipped else "add", total, term)
        node = g.call(op, total)
        factor = -1 if flipped and op == "sin" else 1
        if node not in self.terms.sums:
            self.origins.setdefault(node, Origin(op, a, b, sign, factor))
        return node, factor


def _linear(g: Graph, n: int) -> dict[int, int]:
    """Give how often each addend stands in a node, through differences and signs."""
    found: dict[int, int] = {}
    waiting = [(n, 1)]
    while waiting:
        n, k = waiting.pop()
        if g.ops[n] in ("add", "sub", "neg"):
            first = -k if g.ops[n] == "neg" else k
            signs = (first, -k if g.ops[n] == "sub" else k)
            waiting += zip(g.args[n], signs, strict=False)
        else:
            found[n] = found.get(n, 0) + k
    return found


class _Writer:
    """Sums as nodes.

    The cosine of a - b is a function where there are no more of these than angles, and
    otherwise what it is of the sines and cosines of a and b: a node that is shared.
    """

    def __init__(
        self, g: Graph, terms: _Terms, joined: _Joined, moving: Collection[str]
    ) -> None:
        self.g, self.terms, self.origins = g, terms, joined.origins
        brought = {g.args[n] for n in joined.origins}
        angles = {g.args[n] for n in terms.turning if g.ops[n] in _SHIFTED}
        self.calls = len(brought) <= len(angles)
        self.nodes = {n: self._spelt(n) for n in terms.factors}
        written = set(self.nodes.values())
        self.still = written - g.dependent(written, moving)

    def node(self, whole: Sum) -> int:
        """Give the node of a sum: what stands still is collected in front."""
        products = {
            tuple((self.nodes[n], e) for n, e in self.terms.powers(m)): c
            for m, c in whole.items()
        }
        return sum_node(self.g, products, self.still)

    def _spelt(self, n: int) -> int:
        x = self.origins.get(n)
        if self.calls or x is None:
            return n
        g = self.g
        pairs = [
            [
                self._spelt(g.call(op, angle))
                for op, angle in zip(ops, x[1:3], strict=True)
            ]
            for ops in _SHIFTED[x.op]
        ]
        one, other = (g.call("mul", *pair) for pair in pairs)
        adds = (x.sign > 0) == (x.op == "sin")
        if x.factor < 0:
            one, other = (g.call("neg", one), other) if adds else (other, one)
            return g.call("sub", one, other)
        return g.call("add" if adds else "sub", one, other)
