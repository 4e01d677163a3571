"""Expressions in the form that a person would write, as far as a budget goes.

An expression is written out as a sum of products (a mapping from monomials, sets of
factors with exponents, to rational numbers) with more or fewer of its sums kept whole.
Sines and cosines are combined, and what belongs together is collected. The shortest
form is taken, by the number of symbols and operations in it.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections import Counter, deque
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim import limits
from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


Monomial = frozenset[tuple[Any, Any]]
Terms = dict[Monomial, Any]

ONE: Monomial = frozenset()
_LARGEST_POWER = 6


class CutError(Exception):
    """The budget is spent."""


class Meter:
    """Counts products of terms, so that what is cut is the same on every machine.

    Parameters
    ----------
    left
        How many there may be in all.
    """

    def __init__(self, left: int) -> None:
        self.left = left
        self._least = 0

    @contextlib.contextmanager
    def within(self, most: int) -> Iterator[None]:
        """Let one expression, with those inside it, take so many."""
        outer, self._least = self._least, max(0, self.left - most)
        try:
            yield
        finally:
            self._least = outer

    def spend(self, products: int = 1) -> None:
        """Count; raise where that is more than there is."""
        self.left -= products
        if self.left < self._least:
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


@functools.lru_cache(maxsize=50_000)  # sympy sorts the factors
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
        total: Terms = {}
        if a is b:  # a square: each pair once
            self.meter.spend(len(a) * (len(a) + 1) // 2)
            items = [*a.items()]
            for k, (x, m) in enumerate(items):
                add_to(total, times(x, x), m * m)
                for y, n in items[:k]:
                    add_to(total, times(x, y), 2 * m * n)
            return total
        self.meter.spend(len(a) * len(b))
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
    if len(sines) + len(cosines) < 2:
        return None
    for k, (x, _) in enumerate(sines):
        without = with_factor(monomial, sp.sin(x), -1)
        for y, _ in sines[k + 1 :]:
            meter.spend()
            rest = with_factor(without, sp.sin(y), -1)
            partner = with_factor(with_factor(rest, sp.cos(x), 1), sp.cos(y), 1)
            other = terms.get(partner)
            if other is not None and abs(other) == abs(number):
                angle = x - y if other == number else x + y
                return _merge(
                    terms, (monomial, partner), rest, circular(sp.cos, angle), other
                )
        for y, _ in cosines:
            if y == x:
                continue
            meter.spend()
            rest = with_factor(without, sp.cos(y), -1)
            partner = with_factor(with_factor(rest, sp.cos(x), 1), sp.sin(y), 1)
            other = terms.get(partner)
            if other is not None and abs(other) == abs(number):
                angle = x + y if other == number else x - y
                return _merge(
                    terms, (monomial, partner), rest, circular(sp.sin, angle), number
                )
    return None


def circular(function: Any, angle: Any) -> Any:
    """Give sin or cos as sympy does; a sum of symbols is no multiple of pi."""
    if not angle.is_Add or not all(p.as_coeff_Mul()[1].is_Symbol for p in angle.args):
        return function(angle)
    turned, positive = _direction(angle)
    value = function(positive, evaluate=False)
    return -value if turned and function is sp.sin else value


@functools.lru_cache(maxsize=10_000)
def _direction(angle: Any) -> tuple[bool, Any]:
    """Tell whether sympy keeps the opposite of a sum, and give what it keeps."""
    turned = angle.could_extract_minus_sign()
    return turned, -angle if turned else angle


def _merge(
    terms: Terms, gone: tuple[Monomial, ...], rest: Monomial, factor: Any, number: Any
) -> Monomial:
    """Put rest * factor in the place of `gone`; its sign may have turned."""
    sign, factor = factor.as_coeff_Mul()
    new = rest if factor == 1 else with_factor(rest, factor, 1)
    _replace(terms, gone, new, exact(sign) * number)
    return new


# Products of terms, and looks at pairs of them, for one form of one expression. An
# equation of a ten-link chain takes some thousands.
MOST_PRODUCTS = 60_000
# A form in which sines and cosines were drawn together may be this much longer, in
# parts, and still reads better: cos(a - b) says what its two products hide.
DRAWN_TOGETHER = 0.6
# What the rules of differentiation leave must be shorter by this much to stay.
AS_IT_COMES = 1.5


@dataclass(frozen=True)
class Roles:
    """What the symbols of a model are.

    Attributes
    ----------
    constants
        Parameters, and definitions of parameters only.
    moving
        Velocities, accelerations, multipliers: what terms are sorted by.
    """

    constants: frozenset[Any]
    moving: frozenset[Any]


@dataclass
class Tidier:
    """Tidies expressions of one model.

    Attributes
    ----------
    meter : Meter
        Of all expressions.
    most : int
        Products of terms for one form of one expression.
    cut : bool
        Some expression was left longer than it might have been: the budget was spent.
    """

    roles: Roles
    meter: Meter = field(default_factory=lambda: Meter(limits.TIDYING_PRODUCTS))
    most: int = MOST_PRODUCTS
    cut: bool = False
    _known: dict[tuple[Any, bool, bool], Any] = field(default_factory=dict)

    def __call__(self, e: Any, *, factored: bool = False, written: bool = False) -> Any:
        """Give the shortest form of `e`.

        Parameters
        ----------
        e
            A sympy expression.
        factored
            Also try to draw a common factor out of the whole.
        written
            A person wrote it like this, which counts for it.

        Raises
        ------
        InputError
            Where it has no value, because it divides by 0.
        """
        if e.is_Symbol or e.is_Rational:
            return e
        key = e, factored, written
        if key not in self._known:
            _refuse_infinite(e)
            found = self._shortest(e, factored=factored, written=written)
            self._known[key] = self._known[found, factored, written] = found
        return self._known[key]

    def one_fraction(self, e: Any) -> Any:
        """Give `e` as one product, over what its terms have below the line together."""
        found = self._terms(e, self._plain)
        return e if found is None else self._factored(found[0])

    def is_zero(self, e: Any) -> bool:
        """Tell whether `e` is seen to vanish identically."""
        return bool(self(e) == 0)

    def _shortest(self, e: Any, *, factored: bool, written: bool) -> Any:
        if isinstance(e, sp.Piecewise):
            return self._piecewise(e)
        if e.is_Relational or e.is_Boolean:
            return e
        forms = [((1.0 if written else AS_IT_COMES) * cost(e), e)]
        for whole in (self._still, self._plain, lambda _: False):
            found = self._terms(e, whole)
            if found is None:
                continue
            terms, contracted, kept = found
            made = [self._collected(terms)]
            if factored or any(b.is_Add and k < 0 for m in terms for b, k in m):
                made.append(self._factored(terms))
            weight = DRAWN_TOGETHER if contracted else 1.0
            forms += [(weight * cost(form), form) for form in made]
            if not kept:
                break  # the others are the same
        return min(forms, key=lambda form: form[0])[1]  # the first of equals

    def _piecewise(self, e: Any) -> Any:
        return sp.Piecewise(*((self(x), c) for x, c in e.args), evaluate=False)

    def _terms(
        self, e: Any, whole: Callable[[Any], bool]
    ) -> tuple[Terms, bool, bool] | None:
        """Give a sum of products, whether it is contracted, whether a sum is whole."""
        try:
            with self.meter.within(self.most):
                terms, kept = written_out(e, whole, self._inner, self.meter)
                contracted = contract(terms, self.meter)
        except CutError:
            self.cut = True
            return None
        return terms, contracted > 0, kept

    def _inner(self, e: Any) -> Any:
        """Tidy the arguments of a function, or a sum under a power."""
        if e.is_Add:
            return self(e)
        if isinstance(e, sp.Piecewise):
            return self._piecewise(e)
        if e.is_Function:
            args = tuple(self(a) for a in e.args)
            return e if args == e.args else e.func(*args)
        if e.is_Pow:
            return self(e.base) ** e.exp
        return e

    # Which sums stay whole

    def _still(self, e: Any) -> bool:
        """Tell whether a sum has nothing that moves."""
        return not e.free_symbols & self.roles.moving

    def _plain(self, e: Any) -> bool:
        """Tell whether a sum has nothing that moves, and no angles in it."""
        return self._still(e) and not e.has(sp.sin, sp.cos)

    # Putting terms together

    def _collected(self, terms: Terms) -> Any:
        """Give the sum of `terms`, those with the same velocities together."""
        groups: dict[Monomial, Terms] = {}
        for monomial, number in terms.items():
            outer = self._part(monomial, self.roles.moving.__contains__)
            rest = times(monomial, _inverse(outer))
            add_to(groups.setdefault(outer, {}), rest, number)
        return sp.Add(
            *(
                self._product(outer, rest) if outer else self._sum(rest)
                for outer, rest in groups.items()
            )
        )

    def _factored(self, terms: Terms) -> Any:
        """Give the same with the factors that all terms have in common before it."""
        common, rest = _common(terms)
        return _product(expression(common), self._collected(rest))

    def _product(self, outer: Monomial, terms: Terms) -> Any:
        """Give outer * terms, with what is common to them drawn out if shorter."""
        if len(terms) == 1 and not any(b.is_Add for m in terms for b, _ in m):
            ((one, number),) = terms.items()
            return expression(times(outer, one), number)
        direct = _product(expression(outer), self._sum(terms))
        common, rest = _common(terms)
        inner = self._sum(rest)
        # What is left may have sums that are shorter written out.
        inner = self(inner) if common else inner
        drawn = _product(expression(times(outer, common)), inner)
        return min(direct, drawn, key=cost)

    def _sum(self, terms: Terms) -> Any:
        """Give the sum, the parameters of terms that differ in them only together."""
        groups: dict[Monomial, Terms] = {}
        for monomial, number in terms.items():
            outer = self._part(monomial, self._varies)
            rest = times(monomial, _inverse(outer))
            add_to(groups.setdefault(outer, {}), rest, number)
        parts = []
        for outer, constants in groups.items():
            common, inner = _common(constants)
            total = sp.Add(*(expression(m, x) for m, x in inner.items()))
            parts.append(_product(*_powers(times(outer, common)), total))
        return sp.Add(*parts)

    def _part(self, monomial: Monomial, belongs: Callable[[Any], bool]) -> Monomial:
        return frozenset((x, k) for x, k in monomial if belongs(x))

    def _varies(self, base: Any) -> bool:
        return not base.free_symbols <= self.roles.constants


def _refuse_infinite(e: Any) -> None:
    if e.has(sp.zoo, sp.nan, sp.oo, -sp.oo):
        text = (
            "an energy, a force or a constraint, or its slope, is not finite anywhere"
        )
        hint = "look for a parameter that is 0 below the line or in a logarithm"
        raise InputError([Problem("not-finite", text, None, hint)])


def _product(*factors: Any) -> Any:
    """Give the product; sympy alone would carry a number into a sum beside it.

    A sum with minus signs only gives its sign to the product.
    """
    sums = [x for x in factors if isinstance(x, sp.Add)]
    if not sums:
        return sp.Mul(*factors)
    negative = [x for x in sums if all(map(_has_minus, x.args))]
    turned = [-x if x in negative else x for x in factors]
    sign = (-sp.S.One) ** len(negative)
    whole = sp.Mul(sign, *turned)
    if not whole.is_Add:
        return whole
    (first, *_) = (x for x in turned if isinstance(x, sp.Add))
    number = sign * sp.Mul(*(x for x in turned if x is not first))
    return whole if abs(number) == 1 else sp.Mul(number, first, evaluate=False)


def _powers(monomial: Monomial) -> Iterator[Any]:
    return (b if k == 1 else b**k for b, k in monomial)


def _has_minus(e: Any) -> bool:
    return bool(e.as_coeff_Mul()[0] < 0)


def _inverse(monomial: Monomial) -> Monomial:
    return frozenset((x, -k) for x, k in monomial)


def _common(terms: Terms) -> tuple[Monomial, Terms]:
    """Give what all terms have in common, their number apart, and the rest."""
    if len(terms) < 2:
        return ONE, terms
    lowest: dict[Any, Any] = {}
    for x, k in (factor for m in terms for factor in m):
        lowest[x] = min(lowest.get(x, k), k)
    present = Counter(x for m in terms for x, _ in m)
    common = {
        x: k if present[x] == len(terms) else min(k, 0) for x, k in lowest.items()
    }
    numbers = [*terms.values()]
    content = _content(numbers)
    shared = frozenset((x, k) for x, k in common.items() if k != 0)
    rest = {
        times(m, _inverse(shared)): x / content
        for m, x in zip(terms, numbers, strict=True)
    }
    if all(x < 0 for x in rest.values()):
        content, rest = -content, {m: -x for m, x in rest.items()}
    if content != 1:
        shared = shared | {(sp.Rational(content), 1)}
    return shared, rest


def _content(numbers: Sequence[int | Fraction]) -> Fraction:
    """Give the greatest common divisor."""
    over = math.gcd(*(x.numerator for x in numbers))
    return Fraction(over, math.lcm(*(x.denominator for x in numbers)))


def cost(e: Any) -> int:
    """Give the number of symbols, functions and operations in an expression.

    A sign costs nothing: it is part of the sum that it stands in.
    """
    total, stack = 0, [e]
    while stack:
        x = stack.pop()
        parts = [a for a in x.args if not (x.is_Mul and a is sp.S.NegativeOne)]
        if x.is_Add or x.is_Mul:
            total += len(parts) - 1
        else:
            total += 1
        stack.extend(parts)
    return total
