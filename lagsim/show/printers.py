"""sympy's printers, with the names of a model, in the order in which people write.

In a product numbers come first, then parameters, coordinates, velocities and
accelerations, functions last; in a sum accelerations come first, then velocities.
"""

from __future__ import annotations

import functools
import math
from decimal import Decimal
from typing import TYPE_CHECKING, Any, ClassVar

import sympy as sp
from sympy.printing.latex import LatexPrinter
from sympy.printing.precedence import PRECEDENCE
from sympy.printing.str import StrPrinter

from lagsim.language.functions import FUNCTIONS
from lagsim.show import ASCII, conditions
from lagsim.show.names import RAISED, ModelNames, PrintedName, upright_latex
from lagsim.show.symbols import LARGEST_DENOMINATOR
from lagsim.version import __version__

if TYPE_CHECKING:
    from lagsim.show import Content
    from lagsim.show.symbols import Translation


# Larger whole numbers are written as decimals: 1e+20.
LARGEST_WHOLE = 10**15
# Digits of decimal numbers, for people.
DIGITS = 6
_MUL = PRECEDENCE["Mul"]
_FUNCTIONS = {"Abs": "abs", "ceiling": "ceil", "Min": "min", "Max": "max"}
# Symbols of this class and above vary: definitions, coordinates, ...
_VARYING = 1
# Groups of symbols, in the order in which sums are sorted by them.
_MOVING = {4: 0, 3: 1, 5: 2}
# The text of an expression, memoized since the order of terms needs it repeatedly.
_text = functools.lru_cache(maxsize=50_000, typed=True)(str)
_TEXT = functools.cmp_to_key(lambda a, b: (_text(a) > _text(b)) - (_text(a) < _text(b)))


class Printer:
    """Base of the printers: order of terms, signs and decimal numbers.

    Parameters
    ----------
    x
        The symbols of a model.
    names
        Typesetting of the names.
    digits
        Significant digits of decimal numbers; None for all digits.
    """

    plus, minus, negative, between = " + ", " - ", "-", "*"
    settings: ClassVar[dict[str, Any]] = {}

    def __init__(
        self, x: Translation, names: ModelNames, digits: int | None = DIGITS
    ) -> None:
        super().__init__(self.settings)  # type: ignore[call-arg]
        self.names, self.symbols, self.rank = names, x.names, x.rank
        self.decimals, self.digits = x.substitute, digits
        self._texts: dict[Any, str] = {}
        self._place = functools.cache(self._placed)
        self._place_in_sum = functools.cache(self._placed_in_sum)

    def __call__(self, e: Any) -> str:
        """Return the text of an expression."""
        return self._print(e)

    def terms(self, e: Any) -> list[tuple[str, str]]:
        """Return the terms of a sum as pairs (sign, text), in order of printing."""
        found = map(signed, self.ordered(e))
        return [("-" if minus else "+", self.factor(x)) for minus, x in found]

    def factor(self, e: Any, *, loosely: bool = True) -> str:
        """Return the text of a factor, in parentheses if it binds less than a product.

        Unless `loosely`, a product is put in parentheses, too.
        """
        text: str = self.parenthesize(e, _MUL, strict=loosely)  # type: ignore[attr-defined]
        return text

    def _print(self, e: Any, **given: Any) -> str:
        if given:
            return super()._print(e, **given)  # type: ignore[misc,no-any-return]
        if e not in self._texts:
            self._texts[e] = super()._print(e)  # type: ignore[misc]
        return self._texts[e]

    def _print_Symbol(self, e: Any, **_: Any) -> str:
        return self.names.show(self.symbols[e])

    # Numbers

    def _print_Rational(self, e: Any) -> str:
        if e < 0:
            return self.negative + self._print(-e)
        if self._is_fraction(e):
            return self._over(*map(str, (e.p, e.q)))
        return self._decimal(e)

    def _print_Integer(self, e: Any) -> str:
        if e < 0:
            return self.negative + self._print(-e)
        return str(e) if e < LARGEST_WHOLE else self._decimal(e)

    _print_Float = _print_Rational

    def _decimal(self, e: Any) -> str:
        x = _double(e)
        return (str(x) if self.digits is None else f"{x:.{self.digits}g}").lower()

    def _is_fraction(self, x: Any) -> bool:
        """Whether a rational number x is written as a fraction, not as a decimal."""
        if not x.is_Rational or x.q > LARGEST_DENOMINATOR:
            return False
        return bool(x.q % 5 or (abs(x) < 1 and not self.decimals))

    def _over(self, over: str, under: str) -> str:
        return f"{over}/{under}"

    # Sums

    def end_of_range(self, e: Any) -> str:
        """Return the text of an end of a range: a number, or such as `i+1`."""
        off, letter = e.as_coeff_Add()
        if letter == 0 or off == 0:
            return self._print(e)
        sign = self.minus if off < 0 else self.plus
        return self._print(letter) + sign.strip() + self._print(abs(off))

    def _print_Add(self, e: Any, **_: Any) -> str:
        (sign, text), *rest = self.terms(e)
        text = self.negative + text if sign == "-" else text
        for sign, term in rest:
            text += (self.minus if sign == "-" else self.plus) + term
        return text

    def ordered(self, e: Any) -> list[Any]:
        """Return the terms of a sum in order of printing."""
        parts = sorted(sp.Add.make_args(e), key=self._place_in_sum)
        if signed(parts[0])[0] and self._is_constant(parts[0]):
            parts.append(parts.pop(0))  # x + y - l
        positive = next((p for p in parts if not signed(p)[0]), None)
        if positive is not None and signed(parts[0])[0]:
            parts.remove(positive)
            parts.insert(0, positive)
        return parts

    def _is_constant(self, e: Any) -> bool:
        return all(self.rank[s][0] < _VARYING for s in e.free_symbols)

    def _placed_in_sum(self, term: Any) -> tuple[Any, ...]:
        found = [(self._place(x), x) for x in sp.Mul.make_args(signed(term)[1])]
        degree = [0, 0, 0]
        for (group, *_), x in found:
            if group in _MOVING:
                degree[_MOVING[group]] -= (
                    int(x.exp) if x.is_Pow and x.exp.is_Integer else 1
                )
            elif group - 0.5 in _MOVING:  # a sum in which these symbols are terms
                degree[_MOVING[group - 0.5]] -= 2
        varying = sorted(place for place, _ in found if place[0] >= _VARYING)
        constant = sorted(place for place, _ in found if place[0] < _VARYING)
        return *degree, varying, constant

    # Products

    def _print_Mul(self, e: Any) -> str:
        negative, e = signed(e)
        over, under = self.fraction(e)
        text = self._quotient(over, under) if under else self.product(over)
        return self.negative + text if negative else text

    def _quotient(self, over: list[Any], under: list[Any]) -> str:
        below = f"({self.product(under)})"
        if len(under) == 1:
            below = self.factor(under[0], loosely=False)
        return self._over(self.product(over) or "1", below)

    def product(self, factors: list[Any]) -> str:
        """Return the text of a product of factors, empty for an empty list."""
        return self.between.join(map(self.factor, factors))

    def fraction(self, e: Any) -> tuple[list[Any], list[Any]]:
        """Return the factors of a product: of its numerator, and of its denominator.

        Both lists are in order of printing; without denominator the second is empty.
        """
        number, over, under = sp.S.One, [], []
        for x in sp.Mul.make_args(e):
            if x.is_Rational:
                number = number * x
            elif x.is_Pow and x.exp.is_Rational and x.exp < 0:
                under.append(x.base ** (-x.exp))
            else:
                over.append(x)
        parts = number, sp.S.One
        if self._is_fraction(number):
            parts = sp.Integer(number.p), sp.Integer(number.q)
        above, below = ([x] if x != 1 else [] for x in parts)
        above += sorted(over, key=self._place)
        return above, below + sorted(under, key=self._place)

    def _placed(self, factor: Any) -> tuple[Any, ...]:
        base, exponent = factor, sp.S.One
        if factor.is_Pow:
            base, exponent = factor.base, factor.exp
        key = _TEXT(base), _TEXT(exponent)
        if base.is_Symbol:
            return *self.rank[base], *key
        if base.is_number and not _is_function(base):
            return -1, 0, *key
        ranks = [self.rank[s] for s in base.free_symbols]
        _, index = min(ranks, default=(0, 0))
        if base.is_Add:
            last = max(ranks, default=(0, 0))[0]
            return (0 if last == 0 else last + 0.5), index, *key
        return 6, index, *key


class ModelPrinter(Printer, StrPrinter):  # type: ignore[misc]
    """Printer of expressions in the language of model files."""

    sum_of = "sum"

    def _print_Pow(self, e: Any, rational: bool = False) -> str:
        if e.exp.is_Rational and e.exp < 0:
            return self._print_Mul(e)
        text: str = super()._print_Pow(e, rational)
        return text.replace("**", "^")

    def _print_Exp1(self, _: Any) -> str:
        return "exp(1)"

    def _print_Function(self, e: Any) -> str:
        return f"{_name(e)}({self._arguments(e)})"

    def _arguments(self, e: Any) -> str:
        return ", ".join(map(self._print, e.args))

    def _print_Piecewise(self, e: Any) -> str:
        *cases, (last, _) = e.args
        text = self._print(last)
        for value, condition in reversed(cases):
            text = f"if({self._print(condition)}, {self._print(value)}, {text})"
        return text

    def _print_Sum(self, e: Any) -> str:
        """Print a sum over the members of a family as model files write it."""
        text = self._print(e.function)
        for letter, *ends in e.limits:  # inner ones first
            first, last = map(self.end_of_range, ends)
            text = f"{self.sum_of}({letter} = {first}..{last}, {text})"
        return text

    def _print_Not(self, e: Any) -> str:
        return f"not ({self._print(e.args[0])})"

    def _print_And(self, e: Any) -> str:
        word = " and " if isinstance(e, sp.And) else " or "
        parts = sorted(e.args, key=sp.default_sort_key)
        texts = ((self._print(p), isinstance(p, sp.And | sp.Or)) for p in parts)
        return word.join(f"({text})" if group else text for text, group in texts)

    _print_Or = _print_And

    def _print_ITE(self, e: Any) -> str:  # an `if` in a condition
        condition, then, other = e.args
        return self._print(condition & then | ~condition & other)

    def _print_Relational(self, e: Any) -> str:
        if isinstance(e, sp.Ne):
            return f"not ({self._print(sp.Eq(*e.args))})"
        signs = ("<=", ">=") if isinstance(e, sp.Eq) else (e.rel_op,)
        left, right = map(self._print, e.args)
        return " and ".join(f"{left} {sign} {right}" for sign in signs)


def exact_printer(x: Translation) -> ModelPrinter:
    """Return a printer with all digits, whose text reads back to equal numbers."""
    return ModelPrinter(x, ModelNames(x.own_names), digits=None)


class TextPrinter(ModelPrinter):
    """Printer of expressions as plain text with superscripts, roots and signs."""

    minus, negative, between, sum_of = " − ", "−", " ", "Σ"

    def _print_Pow(self, e: Any, rational: bool = False) -> str:
        base, exponent = e.args
        raised = exponent.is_Integer and exponent > 1
        if raised and _is_function(base) and isinstance(_shown(base), str):
            power = str(exponent).translate(RAISED)
            return f"{_shown(base)}{power}({self._arguments(base)})"
        text = super()._print_Pow(e, rational)
        if exponent == sp.S.Half:
            return text.replace("sqrt", "√", 1)
        if raised:
            return text.removesuffix(f"^{exponent}") + str(exponent).translate(RAISED)
        return text

    def _print_Pi(self, _: Any) -> str:
        return "π"

    def _print_Function(self, e: Any) -> str:
        shown = _shown(e)
        inside = self._arguments(e)
        return inside.join(shown) if isinstance(shown, tuple) else f"{shown}({inside})"

    _print_Abs = _print_Function

    def _print_Relational(self, e: Any) -> str:
        text = super()._print_Relational(e)
        return text.replace("<=", "≤").replace(">=", "≥")


class FormulaPrinter(Printer, LatexPrinter):  # type: ignore[misc]
    """Printer of expressions as mathematics of LaTeX, with amsmath."""

    between = r" \, "

    def _decimal(self, e: Any) -> str:
        text = super()._decimal(e)
        mantissa, _, exponent = text.partition("e")
        if not exponent:
            return text
        power = f"10^{{{int(exponent)}}}"
        return power if mantissa == "1" else rf"{mantissa} \cdot {power}"

    def _over(self, over: str, under: str) -> str:
        return rf"\frac{{{over}}}{{{under}}}"

    def _quotient(self, over: list[Any], under: list[Any]) -> str:
        parts = (
            self._print(x[0]) if len(x) == 1 else self.product(x) or "1"
            for x in (over, under)
        )
        return self._over(*parts)

    def _print_Function(self, e: Any, exp: str | None = None) -> str:
        row = FUNCTIONS.get(_name(e))
        command = (row and row.latex) or rf"\operatorname{{{_name(e)}}}"
        if orders := getattr(e, "orders", ()):
            signs = (rf"\partial_{k} " * order for k, order in enumerate(orders, 1))
            primes = "'" * orders[0] if len(orders) == 1 else ""
            before = "" if primes or len(orders) == 1 else "".join(signs)
            command = before + upright_latex(e.table) + primes
        inside = ", ".join(map(self._print, e.args))
        if isinstance(command, tuple):
            whole = inside.join(command)
            return whole if exp is None else f"{whole}^{{{exp}}}"
        if exp is not None:
            command += f"^{{{exp}}}"
        bare = len(e.args) == 1 and (e.args[0].is_Symbol or e.args[0].is_Integer)
        bare = bare and not e.args[0].is_negative and "(" not in inside and not orders
        return f"{command} {inside}" if bare else rf"{command}\left({inside}\right)"

    def sum_over(self, e: Any) -> str:
        """Return the signs of a sum over members in LaTeX, with the index ranges."""
        text = ""
        for letter, *ends in reversed(e.limits):  # outer ones first
            first, last = map(self.end_of_range, ends)
            text += rf"\sum_{{{letter} = {first}}}^{{{last}}} "
        return text

    def _print_Sum(self, e: Any) -> str:
        return self.sum_over(e) + self.factor(e.function)

    # A name may be e: exp stays as it is.
    _print_exp = _print_log = _print_Abs = _print_Function


@functools.lru_cache(maxsize=50_000)
def signed(e: Any) -> tuple[bool, Any]:
    """Return whether a term is written with a minus, and the term without it."""
    coefficient, rest = e.as_coeff_Mul()
    if not (coefficient.is_number and coefficient < 0):
        return False, e
    factors = () if rest is sp.S.One else sp.Mul.make_args(rest)
    if coefficient != -1 or not factors:
        factors = (-coefficient, *factors)
    return True, sp.Mul._from_args(factors)  # noqa: SLF001  the product as it is


def _is_function(e: Any) -> bool:
    return bool(e.is_Function) and not isinstance(e, sp.Piecewise | sp.exp)


def _name(e: Any) -> str:
    """Return the name in the model language of a function of sympy."""
    plain = type(e).__name__
    return getattr(e, "spelled", "") or _FUNCTIONS.get(plain, plain)


def _shown(e: Any) -> str | tuple[str, str]:
    """Return how a function is printed: by its name, or by two texts.

    The texts are before and after its arguments.
    """
    row = FUNCTIONS.get(_name(e))  # sympy may return a function of its own
    return (row and row.text) or _name(e)


def _double(e: Any) -> float | Decimal:
    """Return a positive number as a double, or as a Decimal beyond its range."""
    try:
        x = float(e)
    except OverflowError:
        x = math.inf
    if 0.0 < x < math.inf:
        return x
    exact = sp.Rational(e)
    return (Decimal(int(exact.p)) / Decimal(int(exact.q))).normalize()


# --- A derivation as JSON: expressions in the model file's own language


def as_json(content: Content) -> dict[str, Any]:
    """Return the document of a derivation as JSON; see docs/derive.md."""
    x, found = content
    write = exact_printer(x)

    def written(part: Any) -> Any:
        """Return a part of the document with its expressions as texts."""
        if isinstance(part, dict):
            return {key: written(value) for key, value in part.items()}
        if isinstance(part, list | tuple):
            return [written(value) for value in part]
        plain = part is None or isinstance(part, str | float | bool)
        return part if plain else write(part)

    model, gauss, called = x.equations.model, found["gauss"], ("function", "rate")
    if gauss is not None:
        names = [write.names.show(PrintedName(q.name, 0, "unconstrained")) for q in x.q]
        a = gauss["a"] or (None,) * len(names)
        gauss = {**gauss, "a": dict(zip(names, a, strict=True))}
    document: dict[str, Any] = written({
        "lagsim": __version__,
        "model": {"name": model.name, "file": model.file, "sha256": model.sha256},
        "parameters": {p.name: p.value for p in model.parameters},
        "coordinates": [q.name for q in x.q],
        **found,
        "constraints": [
            {**k, "conditions": conditions(k, write, multiplier, called, ASCII)}
            for k, multiplier in zip(found["constraints"], x.multipliers, strict=True)
        ],
        "gauss": gauss,
    })  # fmt: skip
    return document
