"""Sums of products, rewritten into equal expressions that cost less.

`Products` are powers of atoms (expressions that are not split further), encoded as
integers. A sum of products is a dict, `Terms`: code of a product -> coefficient. Sums
are rewritten here for the graph, and, with sympy's expressions as atoms, in `show.tidy`
for people.

On the graph: sums of monomials c a^i b^j ... (`normal_form`), sines and cosines
combined (`fewer_terms`), constant factors collected in front (`Collected`).
"""

from __future__ import annotations

from collections import Counter, deque
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from lagsim.language.graph import CONSTANT, VARIABLE
from lagsim.language.simpler import is_normal
from lagsim.language.sparse import Budget, TooLongError

if TYPE_CHECKING:
    from collections.abc import (
        Callable,
        Collection,
        Iterable,
        Iterator,
        Mapping,
        Sequence,
    )

    from lagsim.language.graph import Graph


Atom = TypeVar("Atom")
Terms = dict[int, Any]
"""A sum: products, and the number in front of each."""


class Products(Generic[Atom]):
    """Powers of atoms encoded as integers: the code of a product is the sum of codes.

    The code of 1 is 0. Exponents must stay within `largest`, which callers ensure.

    Parameters
    ----------
    bits
        Number of bits of an exponent.
    parts
        Exponents are multiples of 1/parts.
    """

    def __init__(self, bits: int, parts: int = 1) -> None:
        self._bits, self._parts = bits, parts
        self.largest = ((1 << bits - 1) - 1) // parts
        self.atoms: list[Atom] = []
        self._places: dict[Atom, int] = {}

    def power(self, atom: Atom, exponent: int | Fraction = 1) -> int:
        """Return the code of a power of an atom."""
        place = self._places.get(atom)
        if place is None:
            place = self._places[atom] = self._bits * len(self.atoms)
            self.atoms.append(atom)
        return int(self._parts * exponent) << place

    def powers(self, product: int) -> Iterator[tuple[Atom, int | Fraction]]:
        """Return the atoms of a product, with their exponents."""
        bits, parts = self._bits, self._parts
        while product:
            k = ((product & -product).bit_length() - 1) // bits
            digits = product >> k * bits & (1 << bits) - 1
            digits -= digits >> bits - 1 << bits
            whole, rest = divmod(digits, parts)
            yield self.atoms[k], Fraction(digits, parts) if rest else whole
            product -= digits << k * bits

    def common(self, products: Collection[int]) -> int:
        """Return the code of the greatest common factor of the codes `products`."""
        lowest: dict[Atom, int | Fraction] = {}
        present = Counter[Atom]()
        for m in products:
            for atom, exponent in self.powers(m):
                lowest[atom] = min(lowest.get(atom, exponent), exponent)
                present[atom] += 1
        return sum(
            self.power(
                atom, exponent if present[atom] == len(products) else min(exponent, 0)
            )
            for atom, exponent in lowest.items()
        )

    @staticmethod
    def multiplied(a: Terms, b: Terms, budget: Budget) -> Terms:
        """Return the product of two sums; each pair of terms counts as an operation.

        budget : the counter of these operations.
        """
        total: Terms = {}
        if len(a) == 1:
            budget.add(len(b))
            ((m, c),) = a.items()
            return {m + n: c * d for n, d in b.items()}
        if a is b:  # each pair is joined once
            budget.add(len(a) * (len(a) + 1) // 2)
            items = list(a.items())
            for k, (m, c) in enumerate(items):
                total[2 * m] = total.get(2 * m, 0) + c * c
                for n, d in items[:k]:
                    total[m + n] = total.get(m + n, 0) + 2 * c * d
        else:
            budget.add(len(a) * len(b))
            for m, c in a.items():
                for n, d in b.items():
                    total[m + n] = total.get(m + n, 0) + c * d
        return {m: c for m, c in total.items() if c}


def add_term(terms: Terms, product: int, number: Any) -> None:
    """Add `number` times the product with the code `product` to a sum, in place."""
    total = terms.pop(product, 0) + number
    if total:
        terms[product] = total


Joint = tuple[int, int, Any]  # the other term, and the product and number of both
_SWAPPED = {"sin": "cos", "cos": "sin"}


class Turning(Products[Atom]):
    """Products whose atoms may be sines and cosines, merged by identities.

    Subclasses define how sines and cosines are represented.
    """

    def turns(self, product: int) -> list[tuple[str, Any, int]]:
        """Return the sines, then the cosines, in the product with the code `product`.

        Each item has the function ("sin" or "cos"), the angle and the exponent.
        """
        raise NotImplementedError

    def turn(self, op: str, angle: Any) -> int:
        """Return the code of the sine or cosine (`op`) of an angle."""
        raise NotImplementedError

    def turned(self, op: str, a: Any, b: Any, sign: int) -> tuple[Any, int]:
        """Return sin or cos (`op`) of a + sign b as (number, code of a product).

        The value is number times product; the number is -1 where sin(b - a) is used for
        sin(a - b).

        a, b : angles.
        sign : 1 or -1.
        """
        raise NotImplementedError

    def join(self, terms: Terms, count: Callable[[int], object]) -> int:
        """Merge pairs of terms by identities, in place; return the number of merges.

        The identities are sin^2 + cos^2 = 1, then those of sums and differences of
        angles.

        terms : code of a product -> its coefficient.
        count : function that counts operations against the budget.
        """
        joined = 0
        for joint in (self._joint_of_squares, self._joint_of_angles):
            pending = deque(terms)
            while pending:
                product = pending.popleft()
                while product in terms and (found := joint(terms, product, count)):
                    second, new, number = found
                    del terms[product], terms[second]
                    add_term(terms, new, number)
                    pending.append(new)
                    joined += 1
        return joined

    def _joint_of_squares(
        self, terms: Terms, m: int, count: Callable[[int], object]
    ) -> Joint | None:
        c = terms[m]
        for op, angle, exponent in self.turns(m):
            if exponent < 2:
                continue
            count(2)
            rest = m - 2 * self.turn(op, angle)
            second = rest + 2 * self.turn(_SWAPPED[op], angle)
            if terms.get(second) == c:
                return second, rest, c
            if terms.get(rest) == -c:  # 1 - sin^2 = cos^2
                return rest, second, -c
        return None

    def _joint_of_angles(
        self, terms: Terms, m: int, count: Callable[[int], object]
    ) -> Joint | None:
        c, turns = terms[m], self.turns(m)
        for k, (op, x, _) in enumerate(turns if len(turns) > 1 else ()):
            for other, y, _ in turns[k + 1 :] if op == "sin" else ():
                if x == y:
                    continue
                count(1)
                rest = m - self.turn(op, x) - self.turn(other, y)
                second = rest + self.turn("cos", x) + self.turn(_SWAPPED[other], y)
                d = terms.get(second)
                if d is None or abs(d) != abs(c):
                    continue
                # sin x sin y is paired with cos x cos y, sin x cos y with cos x sin y.
                made = _SWAPPED[other]
                sign = 1 if (c == d) == (made == "sin") else -1
                number, product = self.turned(made, x, y, sign)
                return second, rest + product, number * (d if made == "cos" else c)
        return None


# Largest number of products of two terms, in all, or for each expression if there are
# many; beyond this number the expressions are left unchanged.
MOST_PRODUCTS, PRODUCTS_EACH = 20_000, 10
# Bits of an exponent: energies have small exponents, and many factors.
EXPONENT_BITS = 7
# Time of expanding a node into a sum of products, and of searching the partner of a
# term, in operations of the graph.
EXPANDED, JOINED = 7, 2


class Origin(NamedTuple):
    """Function of a sum of angles for which a sine or cosine was created.

    The sine or cosine equals `op` of (a + sign b), "sin" or "cos", times `factor`.
    """

    op: str
    a: int
    b: int
    sign: int
    factor: int


def fewer_terms(g: Graph, nodes: Sequence[int], moving: Collection[str]) -> list[int]:
    """Return equal expressions for `nodes` that cost less in all, or `nodes`.

    Parameters
    ----------
    g, nodes
        The graph, and the expressions.
    moving
        The names of variables that change in a run. An expression without such a
        variable is computed once, and its cost is not counted.
    """
    nodes = list(nodes)
    cone = g.cone(nodes)
    g.count(EXPANDED * len(cone))
    try:
        expansion = _Expansion(g, cone, max(MOST_PRODUCTS, PRODUCTS_EACH * len(nodes)))
    except TooLongError:
        return nodes
    sums = {n: dict(expansion.sums[n]) for n in nodes if n in expansion.turning}
    for terms in sums.values():
        g.count(JOINED * len(terms))
        expansion.join(terms, g.count)
    writer = _SumBuilder(g, expansion, moving)
    found = [writer.node(sums[n]) if n in sums else n for n in nodes]
    return min((nodes, found), key=lambda x: g.cost(x, moving))


# sin(a + b) = sin a cos b + cos a sin b, cos(a + b) = cos a cos b - sin a sin b.
_SHIFTED = {
    "sin": (("sin", "cos"), ("cos", "sin")),
    "cos": (("cos",) * 2, ("sin",) * 2),
}


class _Expansion(Turning[int]):
    """Sums of products that equal given nodes and the nodes below these.

    Attributes
    ----------
    turning : set of int
        The nodes that depend on sines or cosines.
    origins : dict
        Node of each sine or cosine of a sum of angles that merging has created -> its
        origin.

    Raises
    ------
    TooLongError
        Where the expanded sums are too long.
    """

    def __init__(self, g: Graph, cone: Sequence[int], products: int) -> None:
        super().__init__(EXPONENT_BITS)
        self.g = g
        self.turning: set[int] = set()
        self.origins: dict[int, Origin] = {}
        self.sums: dict[int, Terms] = {}
        self._meter = Budget(products)
        self._degrees: dict[int, int] = {}
        for n in cone:
            if g.ops[n] in _SHIFTED or any(a in self.turning for a in g.args[n]):
                self.turning.add(n)
            self.sums[n], self._degrees[n] = self._of(n)

    def _of(self, n: int) -> tuple[Terms, int]:
        """Return node `n` as a sum of products, and a bound of the exponents in it."""
        g = self.g
        op, args = g.ops[n], g.args[n]
        if op == CONSTANT:
            value = g.value(n)
            return ({0: value} if value else {}), 0
        whole = None
        if n in self.turning or op in ("mul", "neg", "div", "pow"):
            whole = self._below(op, args)
        return whole or ({self.power(n): 1.0}, 1)

    def _below(self, op: str, args: tuple[int, ...]) -> tuple[Terms, int] | None:
        """Return an operation on sums of products as a sum of products.

        The second value is a bound of the exponents. None if the operation is not
        expanded.

        op, args : the operation, and the nodes of its arguments, which are expanded
            already.
        """
        sums = [self.sums[a] for a in args]
        degrees = [self._degrees[a] for a in args]
        if op in ("add", "sub"):
            total = dict(sums[0])
            for m, c in sums[1].items():
                add_term(total, m, c if op == "add" else -c)
            return total, max(degrees)
        if op == "neg":
            return {m: -c for m, c in sums[0].items()}, degrees[0]
        if op == "mul":
            return self._product(sums[0], sums[1], sum(degrees))
        value = self.g.value(args[-1]) if op in ("div", "pow") else None
        if op == "div" and value:
            return {m: c / value for m, c in sums[0].items()}, degrees[0]
        if op == "pow" and value in (2.0, 3.0, 4.0):
            found = sums[0], degrees[0]
            for _ in range(int(value) - 1):
                found = self._product(found[0], sums[0], found[1] + degrees[0])
            return found
        return None

    def _product(self, a: Terms, b: Terms, degree: int) -> tuple[Terms, int]:
        if degree > self.largest:
            raise TooLongError
        return self.multiplied(a, b, self._meter), degree

    def turns(self, product: int) -> list[tuple[str, int, int]]:
        g = self.g
        found = [
            (g.ops[n], g.args[n][0], int(exponent))
            for n, exponent in self.powers(product)
            if g.ops[n] in _SHIFTED
        ]
        return sorted(found, key=lambda turn: turn[0], reverse=True)

    def turn(self, op: str, angle: int) -> int:
        return self.power(self.g.call(op, angle))

    def turned(self, op: str, a: int, b: int, sign: int) -> tuple[float, int]:
        g = self.g
        angle = multiples_in(g, a)
        for n, k in multiples_in(g, b).items():
            angle[n] = angle.get(n, 0) + sign * k
        angle = {n: k for n, k in sorted(angle.items()) if k}
        flipped = next(iter(angle.values()), 1) < 0
        total = g.zero
        for n, k in angle.items():
            term = g.call("mul", g.constant(abs(k)), n)
            total = g.call("sub" if (k < 0) != flipped else "add", total, term)
        node = g.call(op, total)
        factor = -1 if flipped and op == "sin" else 1
        value = g.value(node)
        if value is not None:
            return factor * value, 0
        if node not in self.sums:
            self.origins.setdefault(node, Origin(op, a, b, sign, factor))
        return factor, self.power(node)


def multiples_in(g: Graph, n: int) -> dict[int, int]:
    """Return a node as a sum of integer multiples of others: other node -> integer.

    Examples
    --------
    >>> from lagsim.language.graph import Graph
    >>> g = Graph()
    >>> a, b = g.variable("a"), g.variable("b")
    >>> multiples_in(g, g.call("sub", g.call("add", a, b), b)) == {a: 1}
    True
    """
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
    return {n: k for n, k in found.items() if k}


class _SumBuilder:
    """Conversion of sums of products to nodes.

    If there are no more differences of angles a - b than angles, cos(a - b) is a
    function of its own. Otherwise it is expanded into sines and cosines of a and b,
    which are shared nodes.
    """

    def __init__(
        self, g: Graph, expansion: _Expansion, moving: Collection[str]
    ) -> None:
        self.g, self.expansion, self.origins = g, expansion, expansion.origins
        brought = {g.args[n] for n in self.origins}
        angles = {g.args[n] for n in expansion.turning if g.ops[n] in _SHIFTED}
        self.calls = len(brought) <= len(angles)
        self.nodes = {n: self._spelt(n) for n in expansion.atoms}
        written = set(self.nodes.values())
        self.still = written - g.dependent(written, moving)

    def node(self, terms: Terms) -> int:
        """Return the node of a sum, with the common factor of all terms in front.

        Factors that do not depend on `moving` are collected in front of the others.
        """
        g, form = self.g, _Form(self.g)
        g.count(FACTORED * len(terms))
        whole: Sum = {}
        for m, c in terms.items():
            powers = self.expansion.powers(m)
            factors = [(self.nodes[n], Fraction(e)) for n, e in powers]
            fixed = form.raised({n: e for n, e in factors if n in self.still})
            moving_factors = tuple(f for f in factors if f[0] not in self.still)
            factor = g.call("mul", g.constant(c), fixed)
            whole[moving_factors] = g.call(
                "add", whole.get(moving_factors, g.zero), factor
            )
        return form.written(whole)

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


# Atoms and their exponents, in order; and sums: monomial -> a factor that stays.
Monomial = tuple[tuple[int, Fraction], ...]
Sum = dict[Monomial, int]

LARGEST_POWER = 16
# Time of dividing a sum by a factor, in operations of the graph.
FACTORED = 2


def normal_form(g: Graph, nodes: Iterable[int], moving: Collection[int]) -> list[int]:
    """Return equal expressions for `nodes`, as sums of monomials.

    The nodes in `moving` are expanded; other nodes below are atoms. The expressions are
    equal where both are finite: a factor that was cancelled may have been zero.
    """
    nodes = list(nodes)
    form = _Form(g)
    for n in g.cone(nodes):
        form.sums[n] = form.of(n) if n in moving else {(): n}
    return [form.written(form.sums[n]) for n in nodes]


def common_factor(g: Graph, nodes: Iterable[int]) -> tuple[int, list[int]]:
    """Return the common factor of all `nodes` that are not 0, and the quotients."""
    nodes, form = list(nodes), _Form(g)
    for n in g.cone(nodes):
        form.sums[n] = form.of(n)
    whole = [form.as_monomial(form.sums[n]) for n in nodes if n != g.zero]
    shared, inverse = _shared(monomial for monomial, _ in whole)
    rest = iter([form.written({_product(m, inverse): c}) for m, c in whole])
    common = form.written({shared: g.one})
    return common, [g.zero if n == g.zero else next(rest) for n in nodes]


class _Form:
    def __init__(self, g: Graph) -> None:
        self.g = g
        self.sums: dict[int, Sum] = {}

    def of(self, n: int) -> Sum:
        """Return node `n`, which varies, as a sum of monomials."""
        g = self.g
        op, args = g.ops[n], g.args[n]
        if not args:
            return {((n, Fraction(1)),): g.one}
        below = [self.sums[a] for a in args]
        if op in ("add", "sub"):
            return self._added(below[0], self._scaled(below[1], op == "sub"))
        if op == "neg":
            return self._scaled(below[0], True)
        if op == "mul":
            return self._multiplied(*below)
        if op == "div":
            return self._multiplied(below[0], self._power(below[1], Fraction(-1)))
        p = 0.5 if op == "sqrt" else g.value(args[1]) if op == "pow" else None
        if p is not None and 2.0 * p % 1.0 == 0.0 and abs(p) <= LARGEST_POWER:
            return self._power(below[0], Fraction(p))
        call = g.call(op, *map(self.written, below))
        return {((call, Fraction(1)),): g.one}

    def _added(self, a: Sum, b: Sum) -> Sum:
        g = self.g
        total = dict(a)
        for monomial, factor in b.items():
            total[monomial] = g.call("add", total.get(monomial, g.zero), factor)
        return {m: c for m, c in total.items() if c != g.zero}

    def _scaled(self, a: Sum, negative: bool) -> Sum:
        return {m: self.g.call("neg", c) for m, c in a.items()} if negative else a

    def _multiplied(self, a: Sum, b: Sum) -> Sum:
        g = self.g
        if not a or not b:
            return {}
        (m, c), (k, d) = self.as_monomial(a), self.as_monomial(b)
        return {_product(m, k): g.call("mul", c, d)}

    def as_monomial(self, a: Sum) -> tuple[Monomial, int]:
        """Return the sum `a` as one monomial and its constant factor.

        A sum of several terms becomes the product of their common factor and an atom.
        """
        if len(a) == 1:
            return next(iter(a.items()))
        common, inverse = _shared(a)
        rest = (self._term(_product(m, inverse), c) for m, c in a.items())
        return _product(common, ((self.g.sum(rest), Fraction(1)),)), self.g.one

    def _power(self, a: Sum, exponent: Fraction) -> Sum:
        g = self.g
        if not a:  # all terms have cancelled
            return {(): g.call("pow", g.zero, g.constant(float(exponent)))}
        monomial, factor = self.as_monomial(a)
        if exponent.denominator == 1:
            raised = tuple((atom, e * exponent) for atom, e in monomial)
            p = g.constant(float(abs(exponent)))
            factor = g.call("pow", factor, p)
            return {raised: g.call("div", g.one, factor) if exponent < 0 else factor}
        # The root of a square is not its base: only the root of an atom is decomposed.
        if not (factor == g.one and len(monomial) == 1 and monomial[0][1] == 1):
            monomial = ((self.written(a), Fraction(1)),)
        return {((monomial[0][0], exponent),): g.one}

    def written(self, a: Sum) -> int:
        """Return the node of a sum."""
        if not a:
            return self.g.zero
        monomial, factor = self.as_monomial(a)
        return self._term(monomial, factor)

    def _term(self, monomial: Monomial, factor: int) -> int:
        g = self.g
        top = self.raised({atom: e for atom, e in monomial if e > 0})
        bottom = self.raised({atom: -e for atom, e in monomial if e < 0})
        return g.call("div", g.call("mul", factor, top), bottom)

    def raised(self, exponents: Mapping[int, Fraction]) -> int:
        g = self.g
        total = g.one
        for atom, exponent in exponents.items():
            whole = int(exponent)
            if whole != exponent:
                total = g.call("mul", total, g.call("sqrt", atom))
            power = atom
            while whole:
                if whole % 2:
                    total = g.call("mul", total, power)
                whole //= 2
                if whole:
                    power = g.call("mul", power, power)
        return total


def _shared(monomials: Iterable[Monomial]) -> tuple[Monomial, Monomial]:
    """Return the greatest common divisor of monomials, and its reciprocal."""
    exponents = [dict(m) for m in monomials]
    atoms = sorted(set(exponents[0]).intersection(*exponents[1:]))
    least = [(atom, min(e[atom] for e in exponents)) for atom in atoms]
    return tuple(least), tuple((atom, -e) for atom, e in least)


def _product(a: Monomial, b: Monomial) -> Monomial:
    total = dict(a)
    for atom, exponent in b:
        total[atom] = total.get(atom, Fraction(0)) + exponent
    return tuple(sorted((atom, e) for atom, e in total.items() if e))


ARITHMETIC = frozenset(("add", "sub", "neg", "mul", "div", "pow"))
# The varying factors of a product; and products that are added or subtracted.
Key = tuple[int, ...]
Group = list[tuple[str, Key]]


class Collected:
    """Sums of products with the constant factors collected in front.

    Parameters
    ----------
    g
        The graph.
    moving
        The names of variables that change in a run. An expression without such a
        variable is constant, and computed once.
    """

    def __init__(self, g: Graph, moving: Collection[str]) -> None:
        self.g = g
        self.moving = frozenset(moving)
        self._parts: dict[int, tuple[int, int]] = {}
        self._still: dict[tuple[int, ...], int] = {}

    def moves(self, n: int) -> bool:
        """Whether `n` depends on a variable that changes in a run."""
        return self.parts(n)[1] != self.g.one

    def sum(self, products: Iterable[Sequence[int]]) -> int:
        """Return the node of a sum of products, given by their factors."""
        g, total = self.g, self.g.zero
        groups, given = self._alike(products)
        for still, group in groups.items():
            [whole, *others] = [x for _, key in group for x in given[key]]
            if not others and self._stays(still, whole):
                total = g.call("add", total, self._product(whole))
                continue
            moving_part = g.zero
            for op, factors in group:
                moving_part = g.call(op, moving_part, self._product(factors))
            total = g.call("add", total, g.call("mul", still, moving_part))
        return total

    def _product(self, factors: Iterable[int]) -> int:
        g, whole = self.g, self.g.one
        for n in factors:
            whole = g.call("mul", whole, n)
        return whole

    def _stays(self, still: int, factors: Sequence[int]) -> bool:
        """Whether a product keeps its constant factor in place, without collection.

        No other product in the sum has the same variable factors. Constants in
        `factors` are nodes that other expressions can share; collecting them in `still`
        is worth while only if fewer constants remain.

        still : the constant factor of the product.
        factors : all its factors.
        """
        signs = self.g.one, self.g.constant(-1.0)
        fixed = [n for n in factors if n not in signs and not self.moves(n)]
        if still in signs or len(fixed) > 1:
            return False
        own = [c for c in (self.parts(n)[0] for n in factors) if c not in signs]
        return len(own) == 1 or self._size([still]) == sum(self._size([c]) for c in own)

    def _size(self, factors: Sequence[int]) -> int:
        return sum(map(abs, self._powers(factors)[1].values()))

    def _alike(
        self, products: Iterable[Sequence[int]]
    ) -> tuple[dict[int, Group], dict[Key, list[Sequence[int]]]]:
        """Group products by their constant factor.

        products : the factors of each, as nodes.

        Returns
        -------
        groups : dict of node to list of (str, Key)
            Constant factor -> the products that it multiplies, each as its sign ("add"
            or "sub") and its factors that vary.
        given : dict of Key to list
            Factors that vary -> the given products with these factors.
        """
        g = self.g
        given: dict[Key, list[Sequence[int]]] = {}
        fronts: dict[Key, int] = {}
        for factors in products:
            parts = [self.parts(n) for n in factors]
            key = tuple(sorted(core for _, core in parts if core != g.one))
            still = self.still([c for c, _ in parts])
            fronts[key] = g.call("add", fronts.get(key, g.zero), still)
            given.setdefault(key, []).append(factors)
        groups: dict[int, Group] = {}
        for key, still in fronts.items():
            opposite = g.call("neg", still)
            if opposite in groups:
                groups[opposite].append(("sub", key))
            elif still != g.zero:
                groups.setdefault(still, []).append(("add", key))
        return groups, given

    def scaled(self, node: int, factor: int) -> int:
        """Return the node of node * factor; a short sum is multiplied term by term.

        For example, m (a + c) - k b times 1/m is a + c - (k/m) b.
        """
        g = self.g
        still, core = self.parts(factor)
        if still == g.one:
            return g.call("mul", node, factor)
        terms = [(sign, *self.parts(n)) for sign, n in self.addends(node)]
        inside = [(still, *factors) for factors in terms]
        signs = {g.one, g.constant(-1.0)}
        before, after = (len(self._alike(x)[0].keys() - signs) for x in (terms, inside))
        if after > before or (after == before and core != g.one):
            return g.call("mul", node, factor)
        return g.call("mul", self.sum(inside), core)

    def tidy(self, nodes: Sequence[int]) -> list[int]:
        """Return equal expressions with collected sums, or `nodes` if cheaper."""
        g = self.g
        cone = g.cone(nodes)
        functions = {n for n in cone if g.ops[n] not in ARITHMETIC}
        if any(g.args[n] for n in functions):  # shared nodes below functions are kept
            cone = g.cone(nodes, functions)
        linear = ("add", "sub", "neg")
        users = {a for n in cone if g.ops[n] not in linear for a in g.args[n]}
        users.update(nodes)
        done: dict[int, int] = {}
        for n in cone:
            if not self.moves(n) or n in functions:
                done[n] = n
                continue
            args = tuple([done[a] for a in g.args[n]])
            new = n if args == g.args[n] else g.call(g.ops[n], *args)
            if g.ops[n] not in linear:
                still, core = self.parts(new)
                new = g.call("mul", still, core)
            elif n in users:
                new = self._collected(new)
            done[n] = new
        given, found = list(nodes), [done[n] for n in nodes]
        if given == found:
            return given
        return min(given, found, key=lambda x: g.cost(x, self.moving))

    def _collected(self, node: int) -> int:
        """Return a sum with constant factors collected; a single product unchanged."""
        g = self.g
        if g.ops[node] == "neg" and g.ops[g.args[node][0]] in ("mul", "div"):
            still, core = self.parts(g.args[node][0])
            if self.parts(core) == (g.one, core):
                return g.call("mul", g.call("neg", still), core)
        return self.sum((sign, *self.parts(x)) for sign, x in self.addends(node))

    def addends(self, node: int) -> Iterator[tuple[int, int]]:
        """Yield the terms of the sum `node`: pairs of a sign, as a node, and an addend.

        A sum without products is a single term: it may be a small difference of large
        numbers, which must not be separated.
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
        """Return the sums, at and below a node, that have products among the terms."""
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
        """Return two nodes whose product is `n`: a constant, and one that varies."""
        known = self._parts
        found = known.get(n)
        if found is not None:
            return found
        near = all(map(known.__contains__, self.g.args[n]))
        for below in (n,) if near else self.g.cone([n], known):
            if below not in known:
                known[below] = self._factor_of_product(below)
        return known[n]

    def _factor_of_product(self, n: int) -> tuple[int, int]:
        g = self.g
        op, args = g.ops[n], g.args[n]
        if not args:
            moves = op == VARIABLE and g.payload(n) in self.moving
            return (g.one, n) if moves else (n, g.one)
        found = [self._parts[a] for a in args]
        if not [core for _, core in found if core != g.one]:
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
        """Return the constant factor and the rest of n, a sum of products.

        n may also be a difference. A constant that both share is factored out.

        one, other : the constant and the varying part of each of the two arguments of
            n.
        """
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
        """Return the product of constant factors; a factor cancels its inverse."""
        g = self.g
        key = tuple([n for n in factors if n != g.one])
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

    def _powers(self, factors: Sequence[int]) -> tuple[float, dict[int, int]]:
        """Return a product as a number times powers: factor node -> integer exponent.

        factors : the nodes of the factors, which may be products.
        """
        g = self.g
        number, powers = 1.0, dict[int, int]()
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
                powers[n] = powers.get(n, 0) + e
        return number, powers
