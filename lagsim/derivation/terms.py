"""Sums of products: expressions written out, with sines and cosines drawn together.

A sum is a mapping from monomials to rational numbers; a monomial is the set of its
factors, each with its exponent.
"""

from __future__ import annotations

import functools
import math
import time
from collections import deque
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import sympy as sp

if TYPE_CHECKING:
    from collections.abc import Callable

Monomial = frozenset[tuple[Any, Any]]
Terms = dict[Monomial, Any]

ONE: Monomial = frozenset()
_LARGEST_POWER = 6


class CutError(Exception):
    """The budget is spent."""


class Meter:
    """Counts operations, so that what is cut is the same on every machine.

    Parameters
    ----------
    budget
        How many there may be.
    until
        The time at which all ends, of `time.process_time`: of what goes on for ever.
    """

    def __init__(self, budget: int, until: float = math.inf) -> None:
        self.budget = budget
        self.until = until
        self.spent = 0

    def spend(self, operations: int = 1) -> None:
        """Count; raise where that is more than there is, or where time is up."""
        self.spent += operations
        if self.spent > self.budget or time.process_time() > self.until:
            raise CutError


def times(a: Monomial, b: Monomial) -> Monomial:
    """Give the product of two monomials."""
    if not a:
        return b
    if not b:
        return a
    exponents = dict(a)
    for base, exponent in b:
        exponents[base] = exponents.get(base, 0) + exponent
    return frozenset((x, e) for x, e in exponents.items() if e != 0)


def with_factor(monomial: Monomial, base: Any, exponent: Any) -> Monomial:
    """Give `monomial` times base^exponent."""
    return times(monomial, frozenset(((base, exponent),)))


def expression(monomial: Monomial, number: Any = 1) -> Any:
    """Give `number` times a monomial as a sympy expression."""
    return sp.Mul(number, *(b if k == 1 else b**k for b, k in monomial))


def exact(x: Any) -> int | Fraction:
    """Give a rational number of sympy as one of Python, which is faster."""
    return int(x.p) if x.q == 1 else Fraction(int(x.p), int(x.q))


def add_to(total: Terms, monomial: Monomial, number: Any) -> None:
    """Add a term to a sum."""
    value = total.get(monomial, 0) + number
    if value == 0:
        total.pop(monomial, None)
    else:
        total[monomial] = value


def written_out(
    e: Any, whole: Callable[[Any], bool], inner: Callable[[Any], Any], meter: Meter
) -> tuple[Terms, bool]:
    """Give `e` as a sum of products, and whether a sum stayed whole.

    Parameters
    ----------
    e
        The expression.
    whole
        Tells which sums stay as they are where they are factors.
    inner
        What becomes of the arguments of functions.
    meter
        Counts the products of terms.
    """
    expansion = _Expansion(whole, inner, meter)
    return expansion.of(e), expansion.kept


class _Expansion:
    def __init__(
        self, whole: Callable[[Any], bool], inner: Callable[[Any], Any], meter: Meter
    ) -> None:
        self.whole, self.inner, self.meter = whole, inner, meter
        self.kept = False

    def of(self, e: Any) -> Terms:
        if e.is_Rational:
            return {ONE: exact(e)} if e != 0 else {}
        if e.is_Add:
            total: Terms = {}
            for part in e.args:
                for monomial, number in self.of(part).items():
                    add_to(total, monomial, number)
            return total
        if e.is_Mul:
            product: Terms = {ONE: 1}
            for part in e.args:
                product = self._product(product, self._factor(part))
            return product
        return self._factor(e)

    def _factor(self, e: Any) -> Terms:
        if e.is_Add:
            return self._sum(e, 1)
        if e.is_Pow:
            return self._power(*e.as_base_exp())
        if e.is_Atom or e.is_number:
            return self.of(e) if e.is_Rational else {frozenset(((e, 1),)): 1}
        if e.is_Mul:
            return self.of(e)
        return {frozenset(((self.inner(e), 1),)): 1}

    def _power(self, base: Any, exponent: Any) -> Terms:
        if not exponent.is_Rational:
            return {frozenset(((self.inner(base) ** exponent, 1),)): 1}
        k = exact(exponent)
        if base.is_Add:
            return self._sum(base, k)
        below = self._factor(base) if isinstance(k, int) else {}
        if len(below) == 1:
            ((monomial, number),) = below.items()
            raised = frozenset((x, other * k) for x, other in monomial)
            return {raised: Fraction(number) ** k}
        return {frozenset(((self.inner(base), k),)): 1}

    def _sum(self, base: Any, exponent: int | Fraction) -> Terms:
        if isinstance(exponent, int) and 0 < exponent <= _LARGEST_POWER:
            if not self.whole(base):
                terms = self.of(base)
                product = terms
                for _ in range(exponent - 1):
                    product = self._product(product, terms)
                return product
            self.kept = True
        base = self.inner(base)
        if not base.is_Add:
            power = base ** sp.Rational(exponent)
            return self._factor(power)
        content = Fraction(1)
        if isinstance(exponent, int):
            number, base = base.primitive()
            if base.could_extract_minus_sign():
                number, base = -number, -base
            content = Fraction(exact(number)) ** exponent
        return {frozenset(((base, exponent),)): content}

    def _product(self, a: Terms, b: Terms) -> Terms:
        self.meter.spend(len(a) * len(b))
        total: Terms = {}
        if a is b:  # a square: each pair once
            items = [*a.items()]
            for k, (x, m) in enumerate(items):
                add_to(total, times(x, x), m * m)
                for y, n in items[:k]:
                    add_to(total, times(x, y), 2 * m * n)
            return total
        for x, m in a.items():
            for y, n in b.items():
                add_to(total, times(x, y), m * n)
        return total


def contract(terms: Terms, meter: Meter) -> int:
    """Draw sines and cosines together, in place, where that leaves fewer terms.

    sin^2 + cos^2 = 1 first, then the sines and cosines of sums and differences.

    Returns
    -------
    int
        How often that was done.
    """
    times_done = 0
    for rule in (_pythagoras, _sums_of_angles):
        pending = deque(terms)
        while pending:
            monomial = pending.popleft()
            while monomial in terms:
                found = rule(terms, monomial, meter)
                if found is None:
                    break
                times_done += 1
                pending.append(found)
    return times_done


def _trigonometric(monomial: Monomial, function: Any) -> list[tuple[Any, Any]]:
    """Give argument and exponent of the sines (or cosines), in a fixed order."""
    found = [
        (base.args[0], exponent)
        for base, exponent in monomial
        if base.func is function and isinstance(exponent, int) and exponent > 0
    ]
    return sorted(found, key=lambda item: _key(item[0])) if len(found) > 1 else found


_key = functools.lru_cache(maxsize=10_000)(sp.default_sort_key)


def _replace(terms: Terms, gone: tuple[Monomial, ...], new: Monomial, x: Any) -> None:
    for monomial in gone:
        del terms[monomial]
    add_to(terms, new, x)


def _pythagoras(terms: Terms, monomial: Monomial, meter: Meter) -> Monomial | None:
    number = terms[monomial]
    for function, other in ((sp.sin, sp.cos), (sp.cos, sp.sin)):
        for angle, exponent in _trigonometric(monomial, function):
            if exponent < 2:
                continue
            meter.spend(2)
            rest = with_factor(monomial, function(angle), -2)
            partner = with_factor(rest, other(angle), 2)
            if terms.get(partner) == number:
                _replace(terms, (monomial, partner), rest, number)
                return rest
            if terms.get(rest) == -number:  # 1 - sin^2
                _replace(terms, (monomial, rest), partner, -number)
                return partner
    return None


def _sums_of_angles(terms: Terms, monomial: Monomial, meter: Meter) -> Monomial | None:
    number = terms[monomial]
    sines = _trigonometric(monomial, sp.sin)
    cosines = _trigonometric(monomial, sp.cos)
    for k, (x, _) in enumerate(sines):
        without = with_factor(monomial, sp.sin(x), -1)
        for y, _ in sines[k + 1 :]:
            meter.spend()
            rest = with_factor(without, sp.sin(y), -1)
            partner = with_factor(with_factor(rest, sp.cos(x), 1), sp.cos(y), 1)
            other = terms.get(partner)
            if other is not None and abs(other) == abs(number):
                angle = x - y if other == number else x + y
                return _merge(terms, (monomial, partner), rest, sp.cos(angle), other)
        for y, _ in cosines:
            if y == x:
                continue
            meter.spend()
            rest = with_factor(without, sp.cos(y), -1)
            partner = with_factor(with_factor(rest, sp.cos(x), 1), sp.sin(y), 1)
            other = terms.get(partner)
            if other is not None and abs(other) == abs(number):
                angle = x + y if other == number else x - y
                return _merge(terms, (monomial, partner), rest, sp.sin(angle), number)
    return None


def _merge(
    terms: Terms, gone: tuple[Monomial, ...], rest: Monomial, factor: Any, number: Any
) -> Monomial:
    """Put rest * factor in the place of `gone`; sympy may have turned its sign."""
    sign, factor = factor.as_coeff_Mul()
    new = rest if factor == 1 else with_factor(rest, factor, 1)
    _replace(terms, gone, new, exact(sign) * number)
    return new
