"""Expressions as sums of monomials: fewer products of what moves.

In a Taylor series a product of two moving factors costs some K^2 operations, a factor
that does not move costs K. So constants are collected, equal monomials added, common
factors taken out of sums and cancelled against divisors: c a^i b^j ... with whole and
half exponents, where a, b ... are variables, functions, or sums.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from lagsim.language.graph import CONSTANT, TRUTH, VARIABLE

if TYPE_CHECKING:
    from collections.abc import Collection, Container, Iterable, Mapping

    from lagsim.language.graph import Graph

# Atoms and their exponents, in order; and sums: monomial -> a factor that stays.
Monomial = tuple[tuple[int, Fraction], ...]
Sum = dict[Monomial, int]

LARGEST_POWER = 16


def normal_form(g: Graph, nodes: Iterable[int], moving: Collection[int]) -> list[int]:
    """Give equal expressions for `nodes`, of which those in `moving` move.

    Equal where both are finite: a factor that is cancelled may have been zero.
    """
    nodes = list(nodes)
    form = _Form(g)
    for n in g.cone(nodes):
        form.sums[n] = form.of(n) if n in moving else {(): n}
    return [form.written(form.sums[n]) for n in nodes]


def common_factor(g: Graph, nodes: Iterable[int]) -> tuple[int, list[int]]:
    """Give what all `nodes` but zeros are products with, and them without it."""
    nodes, form = list(nodes), _Form(g)
    for n in g.cone(nodes):
        form.sums[n] = form.of(n)
    whole = [form.single(form.sums[n]) for n in nodes if n != g.zero]
    exponents = [dict(monomial) for monomial, _ in whole]
    shared = set(exponents[0]).intersection(*exponents[1:])
    least = {atom: min(e[atom] for e in exponents) for atom in sorted(shared)}
    inverse = tuple((atom, -e) for atom, e in least.items())
    rest = iter([form.written({_product(m, inverse): c}) for m, c in whole])
    common = form.written({tuple(least.items()): g.one})
    return common, [g.zero if n == g.zero else next(rest) for n in nodes]


def sum_node(
    g: Graph,
    terms: Mapping[tuple[tuple[int, int], ...], float],
    still: Container[int],
) -> int:
    """Give the node of a sum of products: factors and their exponents -> a number.

    What all products have in common is taken out; the factors that stand `still` are
    collected.
    """
    form = _Form(g)
    whole: Sum = {}
    for factors, c in terms.items():
        fixed = form.raised({n: Fraction(e) for n, e in factors if n in still})
        moved = tuple((n, Fraction(e)) for n, e in factors if n not in still)
        factor = g.call("mul", g.constant(c), fixed)
        whole[moved] = g.call("add", whole.get(moved, g.zero), factor)
    return form.written(whole)


class _Form:
    def __init__(self, g: Graph) -> None:
        self.g = g
        self.sums: dict[int, Sum] = {}

    def of(self, n: int) -> Sum:
        """Give the sum that moving node `n` is, those of its arguments being known."""
        g = self.g
        op, args = g.ops[n], g.args[n]
        if op in (VARIABLE, CONSTANT, TRUTH):
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
        exponent = Fraction(1, 2) if op == "sqrt" else self._exponent(op, args)
        if exponent is not None:
            return self._power(below[0], exponent)
        call = g.call(op, *map(self.written, below))
        return {((call, Fraction(1)),): g.one}

    def _exponent(self, op: str, args: tuple[int, ...]) -> Fraction | None:
        p = self.g.value(args[1]) if op == "pow" else None
        if p is None or 2.0 * p % 1.0 or abs(p) > LARGEST_POWER:
            return None
        return Fraction(p)

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
        (m, c), (k, d) = self.single(a), self.single(b)
        return {_product(m, k): g.call("mul", c, d)}

    def single(self, a: Sum) -> tuple[Monomial, int]:
        """Give `a` as one monomial: a sum becomes an atom, without common factors."""
        if len(a) == 1:
            return next(iter(a.items()))
        exponents = [dict(m) for m in a]
        shared = set(exponents[0]).intersection(*exponents[1:])
        common = tuple(
            (atom, min(e[atom] for e in exponents)) for atom in sorted(shared)
        )
        inverse = tuple((atom, -e) for atom, e in common)
        rest = {_product(m, inverse): c for m, c in a.items()}
        return _product(common, ((self._sum(rest), Fraction(1)),)), self.g.one

    def _power(self, a: Sum, exponent: Fraction) -> Sum:
        g = self.g
        if not a:  # all has cancelled
            return {(): g.call("pow", g.zero, g.constant(float(exponent)))}
        monomial, factor = self.single(a)
        if exponent.denominator == 1:
            raised = tuple((atom, e * exponent) for atom, e in monomial)
            p = g.constant(float(abs(exponent)))
            factor = g.call("pow", factor, p)
            return {raised: g.call("div", g.one, factor) if exponent < 0 else factor}
        # The root of a square is not its base: only that of an atom is taken apart.
        if not (factor == g.one and len(monomial) == 1 and monomial[0][1] == 1):
            monomial = ((self.written(a), Fraction(1)),)
        return {((monomial[0][0], exponent),): g.one}

    def written(self, a: Sum) -> int:
        """Give the node of a sum."""
        if not a:
            return self.g.zero
        monomial, factor = self.single(a)
        return self._term(monomial, factor)

    def _sum(self, a: Sum) -> int:
        return self.g.sum(self._term(m, c) for m, c in a.items())

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


def _product(a: Monomial, b: Monomial) -> Monomial:
    total = dict(a)
    for atom, exponent in b:
        total[atom] = total.get(atom, Fraction(0)) + exponent
    return tuple(sorted((atom, e) for atom, e in total.items() if e))
