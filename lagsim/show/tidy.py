"""Simplification of sympy expressions to a short, readable form, within a budget.

An expression is expanded into a sum of products (`Terms` of `language.forms`; a `Sums`
has the codes of the products), in several variants that keep some of its inner sums
unexpanded. Products of sines and cosines are combined, and terms with common factors
are collected. The variant with the fewest symbols and operations is selected.
`benchmarks/tidying.md` compares the result with that of sympy's `collect`,
`factor_terms` and `futrig` for the shipped models.
"""

from __future__ import annotations

import functools
import math
import time
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim import limits
from lagsim.codes.known import NOT_FINITE, TOO_LONG
from lagsim.errors import InputError, unusable
from lagsim.language.forms import Turning, add_term
from lagsim.language.sparse import Budget, TooLongError

if TYPE_CHECKING:
    from collections.abc import Callable

    from lagsim.language.forms import Terms


# A power of a sum is multiplied out up to this exponent.
LARGEST_POWER = 6
# Larger whole numbers are not left in a sum from which a common factor is extracted.
LARGEST_WHOLE = 1000
# Bits of an exponent, and the largest of an atom: in sums within sums to the sixth
# power, as deep as the budget goes, it does not outgrow them.
EXPONENT_BITS, LARGEST_EXPONENT = 16, 24
_FUNCTIONS = {sp.sin: "sin", sp.cos: "cos"}
_key = functools.lru_cache(maxsize=10_000)(sp.default_sort_key)


def exact(x: Any) -> int | Fraction:
    """Convert a rational number of sympy to `int` or `Fraction`, which are faster."""
    return int(x.p) if x.q == 1 else Fraction(int(x.p), int(x.q))


@functools.lru_cache(maxsize=50_000)  # sympy sorts the factors
def _whole(powers: frozenset[tuple[Any, Any]]) -> Any:
    return sp.Mul(*(b if k == 1 else b**k for b, k in powers))


class Sums(Turning[Any]):
    """Expressions as sums of products.

    Parameters
    ----------
    inner
        Simplifies arguments of functions, and sums that are kept unexpanded.
    budget
        Counts the products of terms.
    whole
        Predicate: whether a sum, as a factor, is kept unexpanded.

    Attributes
    ----------
    unexpanded : bool
        Whether a sum was kept unexpanded.
    """

    def __init__(
        self,
        inner: Callable[[Any], Any],
        budget: Budget,
        whole: Callable[[Any], bool] = lambda _: False,
    ) -> None:
        super().__init__(EXPONENT_BITS, parts=2)
        self.inner, self.budget, self.whole = inner, budget, whole
        self.unexpanded = False
        self._turns: dict[tuple[str, Any], int] = {}

    def of(self, e: Any) -> Terms:
        """Return the sum of products that equals e: product code -> coefficient."""
        if e.is_Rational:
            return {0: exact(e)} if e != 0 else {}
        if e.is_Add:
            total: Terms = {}
            for part in e.args:
                for product, number in self.of(part).items():
                    add_term(total, product, number)
            return total
        if e.is_Mul:
            whole: Terms = {0: 1}
            for part in e.args:
                whole = self.multiplied(whole, self._factor(part), self.budget)
            return whole
        return self._factor(e)

    def expression(self, product: int, number: Any = 1) -> Any:
        """Return the sympy expression of `number` times the product with a code."""
        whole = _whole(frozenset(self.powers(product)))
        return whole if number == 1 else sp.Mul(number, whole)

    def _factor(self, e: Any) -> Terms:
        if e.is_Add:
            return self._sum(e, 1)
        if e.is_Pow:
            return self._power(*e.as_base_exp())
        if e.is_Rational or e.is_Mul:
            return self.of(e)
        return {self.power(e if e.is_Atom or e.is_number else self.inner(e)): 1}

    def _power(self, base: Any, exponent: Any) -> Terms:
        near = exponent.is_Rational and abs(exponent) <= LARGEST_EXPONENT
        if not near or exponent.q > 2:
            power = self.inner(base) ** exponent
            return self.of(power) if power.is_Mul else {self.power(power): 1}
        k = exact(exponent)
        if base.is_Add:
            return self._sum(base, k)
        below = self._factor(base) if isinstance(k, int) else {}
        if len(below) == 1:
            ((product, number),) = below.items()
            return {int(k) * product: Fraction(number) ** k}
        return {self.power(self.inner(base), k): 1}

    def _sum(self, base: Any, exponent: int | Fraction) -> Terms:
        if isinstance(exponent, int) and 0 < exponent <= LARGEST_POWER:
            if not self.whole(base):
                terms = whole = self.of(base)
                for _ in range(exponent - 1):
                    whole = self.multiplied(whole, terms, self.budget)
                return whole
            self.unexpanded = True
        base = self.inner(base)
        if not base.is_Add:
            return self._factor(base ** sp.Rational(exponent))
        content = Fraction(1)
        if isinstance(exponent, int):
            number, base = base.primitive()
            if base.could_extract_minus_sign():
                number, base = -number, -base
            content = Fraction(exact(number)) ** exponent
        return {self.power(base, exponent): content}

    # Sines and cosines

    def turns(self, product: int) -> list[tuple[str, Any, int]]:
        """Return the sines and cosines in a product, as (function, angle, exponent).

        Sines come first; angles are in sympy's order.

        product : the code of the product.
        """
        found = [
            (_FUNCTIONS[base.func], base.args[0], k)
            for base, k in self.powers(product)
            if base.func in _FUNCTIONS and isinstance(k, int) and k > 0
        ]
        if len(found) > 1:
            found.sort(key=lambda turn: (turn[0] == "cos", _key(turn[1])))
        return found

    def turn(self, op: str, angle: Any) -> int:
        """Return the code of the product that is the sine or cosine of an angle.

        op : sin or cos.
        """
        found = self._turns.get((op, angle))
        if found is None:
            found = self._turns[op, angle] = self.power(getattr(sp, op)(angle))
        return found

    def turned(self, op: str, a: Any, b: Any, sign: int) -> tuple[Any, int]:
        """Return `op`, sin or cos, of a + sign b, as a factor and a product.

        The factor is a number, such as -1 where sympy writes sin(a - b) as -sin(b - a);
        the product is returned as a code of `language.forms`, 0 for 1.
        """
        number, factor = getattr(sp, op)(a + sign * b).as_coeff_Mul()
        return exact(number), 0 if factor == 1 else self.power(factor)


# Products of terms, and comparisons of pairs of terms, for one form of one expression.
# An equation of a ten-link chain takes some thousands.
MOST_PRODUCTS = 60_000
# A form in which sines and cosines were combined may be longer by this ratio and is
# still preferred: cos(a - b) is easier to read than its two products.
DRAWN_TOGETHER = 0.6
# A form is preferred to the result of the rules of differentiation if it is shorter by
# this ratio.
AS_IT_COMES = 1.5


class Tidier:
    """Simplifies the expressions of one model.

    Parameters
    ----------
    constants : frozenset of Symbol
        Parameters, and definitions of parameters only.
    moving : frozenset of Symbol
        Velocities, accelerations and multipliers, by which terms are sorted.

    Attributes
    ----------
    left : int
        Products of terms that remain in the budget.
    cut : bool
        Whether the budget ended the simplification of an expression.
    """

    def __init__(self, constants: frozenset[Any], moving: frozenset[Any]) -> None:
        self.constants, self.moving = constants, moving
        self.left, self.cut = limits.TIDYING_PRODUCTS, False
        self._known: dict[tuple[Any, bool, bool], Any] = {}
        self._start_time = time.process_time()

    def __call__(self, e: Any, *, factored: bool = False, written: bool = False) -> Any:
        """Return the shortest form of `e`.

        Parameters
        ----------
        e
            A sympy expression.
        factored
            Whether a form with the common factor of all terms is tried as well.
        written
            Whether `e` is written so in the file; its own form then has no penalty.

        Raises
        ------
        InputError
            If `e` has no finite value (a division by 0), or the time limit is reached.
        """
        if e.is_Symbol or e.is_Rational:
            return e
        key = e, factored, written
        if key not in self._known:
            most = limits.DERIVING_SECONDS
            if time.process_time() > self._start_time + most:
                raise too_long(
                    f"the equations are not derived within {most:.3g} s, "
                    "which is the limit"
                )
            _refuse_infinite(e)
            if _is_short(e):
                found = e
            elif e.is_Add or e.is_Mul or e.is_Pow:
                found = self._shortest(e, factored=factored, written=written)
            else:
                found = self.inner(e)
            self._known[key] = self._known[found, factored, written] = found
        return self._known[key]

    def one_fraction(self, e: Any) -> Any:
        """Return `e` as one fraction over the common denominator of its terms."""
        found = self._terms(e, self._plain)
        return e if found is None else self._factored(*found[:2])

    def _shortest(self, e: Any, *, factored: bool, written: bool) -> Any:
        forms = [((1.0 if written else AS_IT_COMES) * written_size(e), e)]
        for whole in (self._still, self._plain, lambda _: False):
            found = self._terms(e, whole)
            if found is None:
                continue
            sums, terms, joined = found
            made = [self._collected(sums, terms)]
            bases = (power for m in terms for power in sums.powers(m))
            if factored or any(b.is_Add and k < 0 for b, k in bases):
                made.append(self._factored(sums, terms))
            weight = DRAWN_TOGETHER if joined else 1.0
            forms += [(weight * written_size(form), form) for form in made]
            if not sums.unexpanded:
                break  # the other candidates are equal
        return min(forms, key=lambda form: form[0])[1]  # the first of equal candidates

    def _terms(
        self, e: Any, whole: Callable[[Any], bool]
    ) -> tuple[Sums, Terms, int] | None:
        """Expand an expression into a sum of products; None past the budget.

        whole : predicate of sums that are not expanded.

        Returns
        -------
        tuple of (Sums, dict, int)
            The codes of products, the terms, and the number of merged terms.
        """
        budget = Budget(min(MOST_PRODUCTS, self.left))
        sums = Sums(self.inner, budget, whole)
        try:
            terms = sums.of(e)
            return sums, terms, sums.join(terms, budget.add)
        except TooLongError:
            self.cut = True
            return None
        finally:
            self.left -= budget.operations

    def inner(self, e: Any) -> Any:
        """Return e with simplified arguments of a function, or base of a power.

        A sum is simplified as a whole.
        """
        if e.is_Add:
            return self(e)
        if isinstance(e, sp.Piecewise):
            cases = ((self(x), condition) for x, condition in e.args)
            return sp.Piecewise(*cases, evaluate=False)
        if e.is_Function:
            args = tuple(self(a) for a in e.args)
            return e if args == e.args else e.func(*args)
        if e.is_Pow:
            return self(e.base) ** e.exp
        return e

    # Sums that are not expanded

    def _still(self, e: Any) -> bool:
        """Whether a sum has no velocities, accelerations or multipliers."""
        return not e.free_symbols & self.moving

    def _plain(self, e: Any) -> bool:
        """Whether a sum has no velocities (or the like), and no sines or cosines."""
        return self._still(e) and not e.has(sp.sin, sp.cos)

    # Combining terms

    def _collected(self, sums: Sums, terms: Terms) -> Any:
        """Return the sum of `terms` as an expression, grouped by velocities."""
        groups = _grouped(sums, terms, self.moving.__contains__)
        return sp.Add(
            *(
                self._product(sums, outer, rest) if outer else self._sum(sums, rest)
                for outer, rest in groups.items()
            )
        )

    def _factored(self, sums: Sums, terms: Terms) -> Any:
        """Return the sum of `terms` as expression, with the common factor in front."""
        common, number, rest = _common(sums, terms)
        return _product(sums.expression(common, number), self._collected(sums, rest))

    def _product(self, sums: Sums, outer: int, terms: Terms) -> Any:
        """Return `outer` times a sum of terms, factored if that is shorter.

        outer : the code of a product.
        """
        if len(terms) == 1:
            ((one, number),) = terms.items()
            if not any(b.is_Add for b, _ in sums.powers(one)):
                return sums.expression(outer + one, number)
        direct = _product(sums.expression(outer), self._sum(sums, terms))
        common, number, rest = _common(sums, terms)
        inner = self._sum(sums, rest)
        if common or number != 1:  # the remaining sum may be shorter written out
            inner = self(inner)
        drawn = _product(sums.expression(outer + common, number), inner)
        return min(direct, drawn, key=written_size)

    def _sum(self, sums: Sums, terms: Terms) -> Any:
        """Return the sum of `terms` as expression, grouped by their variable factors.

        These are the factors other than parameters.
        """
        parts = []
        for outer, constants in _grouped(sums, terms, self._varies).items():
            common, number, inner = _common(sums, constants)
            total = sp.Add(*(sums.expression(m, x) for m, x in inner.items()))
            factors = (b if k == 1 else b**k for b, k in sums.powers(outer + common))
            parts.append(_product(sp.Rational(number), *factors, total))
        return sp.Add(*parts)

    def _varies(self, base: Any) -> bool:
        return not base.free_symbols <= self.constants


def _grouped(
    sums: Sums, terms: Terms, outside: Callable[[Any], bool]
) -> dict[int, Terms]:
    """Group terms by their factors that satisfy the predicate `outside`.

    The result maps each product of such factors to the remaining terms.
    """
    groups: dict[int, Terms] = {}
    for m, number in terms.items():
        outer = sum(sums.power(b, k) for b, k in sums.powers(m) if outside(b))
        add_term(groups.setdefault(outer, {}), m - outer, number)
    return groups


def _is_short(e: Any) -> bool:
    """Whether an expression is a sum of symbols and integers, which is not changed."""
    return e.is_Add and all(
        x.is_Integer or x.is_Symbol or (-x).is_Symbol for x in e.args
    )


def _refuse_infinite(e: Any) -> None:
    """Raise `not_finite` if `e` is infinite or not real for all variables."""
    roots = (p for p in e.atoms(sp.Pow) if p.is_number and p.is_real is False)
    if e.has(sp.zoo, sp.nan, sp.oo, -sp.oo, sp.I) or any(roots):
        raise not_finite()


def not_finite() -> InputError:
    """Return the error for equations that have no finite real value."""
    text = "an energy, a force or a constraint, or its slope, is not finite anywhere"
    hint = "look for a parameter that is 0 below the line, in a logarithm or a root"
    return unusable(NOT_FINITE, text, hint=hint)


def too_long(text: str) -> InputError:
    """Return the error for equations too long to be displayed, with a text."""
    hint = "`--format python` takes them as they are"
    return unusable(TOO_LONG, text, hint=hint)


def _product(*factors: Any) -> Any:
    """Return the product of factors, with numbers outside of sums.

    sympy alone would distribute a number over a sum. If all terms of a sum have minus
    signs, the sign is moved to the front of the product.
    """
    sums = [x for x in factors if isinstance(x, sp.Add)]
    if not sums:
        return sp.Mul(*factors)
    negative = [x for x in sums if all(p.as_coeff_Mul()[0] < 0 for p in x.args)]
    turned = [-x if x in negative else x for x in factors]
    sign = (-sp.S.One) ** len(negative)
    whole = sp.Mul(sign, *turned)
    if not whole.is_Add:
        return whole
    (first, *_) = (x for x in turned if isinstance(x, sp.Add))
    number = sign * sp.Mul(*(x for x in turned if x is not first))
    return whole if abs(number) == 1 else sp.Mul(number, first, evaluate=False)


def _common(sums: Sums, terms: Terms) -> tuple[int, Any, Terms]:
    """Return the common factor of terms, and the terms without it.

    Returns
    -------
    tuple of (int, number, dict)
        The code of the common product, the common number, and the remaining terms.
    """
    if len(terms) < 2:
        return 0, 1, terms
    over = math.gcd(*(x.numerator for x in terms.values()))
    under = math.lcm(*(x.denominator for x in terms.values()))
    common, number = sums.common(terms), Fraction(over, under)
    if max(abs(x / number) for x in terms.values()) > LARGEST_WHOLE:
        number = Fraction(1)  # decimals with many digits
    if all(x < 0 for x in terms.values()):
        number = -number
    return common, number, {m - common: x / number for m, x in terms.items()}


def written_size(e: Any) -> int:
    """Return the number of symbols, functions and operations in an expression.

    Signs are not counted: they are part of the sum.
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
