"""sympy expressions -> text, in the order in which a person writes them.

In a product numbers come first, then parameters, coordinates, velocities and
accelerations, functions last; in a sum accelerations come first, then velocities. A
style gives the form of each operation: the model language, plain text or LaTeX.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any, ClassVar

import sympy as sp

from lagsim.language.functions import FUNCTIONS
from lagsim.show.symbols import LARGEST_DENOMINATOR

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.show.names import Name, Typeset


# Larger whole numbers are written as decimals: 1e+20.
LARGEST_WHOLE = 10**15

# How tightly things bind.
CHOICE, SUM, PRODUCT, POWER, ATOM = range(5)

_FUNCTIONS = {
    "Abs": "abs", "sign": "sign", "ceiling": "ceil", "floor": "floor", "Min": "min",
    "Max": "max",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Piece:
    """Text, and how tightly it binds."""

    text: str
    power: int


class Style:
    """How operations look; this one is the model language.

    Parameters
    ----------
    names
        How names look.
    digits
        How many digits decimals have; all that there are where this is None.
    """

    between = "*"
    plus, minus, negative = " + ", " - ", "-"
    comparisons: ClassVar = {sign: sign for sign in ("<", "<=", ">", ">=")}
    joins: ClassVar[Mapping[str, str]] = {"and": " and ", "or": " or ", "not": "not "}

    def __init__(self, names: Typeset, digits: int | None = None) -> None:
        self.names = names
        self.digits = digits

    def whole(self, x: int) -> Piece:
        """Give a whole number that is not negative."""
        return Piece(str(x), ATOM) if x < LARGEST_WHOLE else self.decimal(_number(x))

    def decimal(self, x: float | Decimal) -> Piece:
        """Give a decimal number that is not negative."""
        text = str(x) if self.digits is None else f"{x:.{self.digits}g}"
        return Piece(text.lower(), ATOM)

    def pi(self) -> str:
        """Give the number pi."""
        return "pi"

    def group(self, text: str) -> str:
        """Put parentheses around."""
        return f"({text})"

    def fraction(self, over: Piece, under: Piece) -> Piece:
        """Give a fraction."""
        return Piece(f"{self.held(over, PRODUCT)}/{self.held(under, POWER)}", PRODUCT)

    def raised(self, base: Piece, exponent: Piece) -> Piece:
        """Give a power."""
        return Piece(f"{self.held(base, ATOM)}^{self.held(exponent, ATOM)}", POWER)

    def root(self, inside: str) -> Piece:
        """Give a square root."""
        return Piece(f"sqrt({inside})", ATOM)

    def call(self, name: str, args: Sequence[Piece], exponent: int = 1) -> Piece:
        """Give a function's value, or a power of it."""
        inside = ", ".join(a.text for a in args)
        value = Piece(f"{name}({inside})", ATOM)
        return (
            value if exponent == 1 else self.raised(value, Piece(str(exponent), ATOM))
        )

    def choice(self, cases: Sequence[tuple[str, str]], otherwise: str) -> Piece:
        """Give one of several values, by conditions."""
        for value, condition in reversed(cases):
            otherwise = f"if({condition}, {value}, {otherwise})"
        return Piece(otherwise, ATOM)

    def held(self, piece: Piece, power: int) -> str:
        """Give the text, in parentheses where it binds less tightly than `power`."""
        return piece.text if piece.power >= power else self.group(piece.text)


class Writer:
    """Writes expressions in a style.

    Parameters
    ----------
    style
        How operations look.
    symbols
        What each symbol shows.
    rank
        Where a symbol stands in products and sums: its class (0 for parameters, 1 for
        definitions, 2 for coordinates, 3 for velocities, 4 for accelerations, 5 for
        multipliers) and its place in the file.
    decimals
        Numbers are those of parameters: 9.8, not 49/5, and 0.4, not 2/5.
    """

    def __init__(
        self,
        style: Style,
        symbols: Mapping[Any, Name],
        rank: Mapping[Any, tuple[int, int]],
        *,
        decimals: bool = False,
    ) -> None:
        self.style, self.symbols, self.rank = style, symbols, rank
        self.decimals = decimals
        self._pieces: dict[Any, Piece] = {}
        self._places: dict[Any, tuple[Any, ...]] = {}

    def __call__(self, e: Any) -> str:
        """Give the text of an expression."""
        return self.piece(e).text

    def terms(self, e: Any) -> list[tuple[str, str]]:
        """Give the terms of a sum in order, each with its sign (`+` or `-`)."""
        found = []
        for part in self._ordered(e):
            negative, size = _sign(part)
            text = self.style.held(self.piece(size), PRODUCT)
            found.append(("-" if negative else "+", text))
        return found

    def piece(self, e: Any) -> Piece:
        """Give the text of an expression, and how tightly it binds."""
        if e not in self._pieces:
            self._pieces[e] = self._piece(e)
        return self._pieces[e]

    def _piece(self, e: Any) -> Piece:
        if e.is_Symbol:
            return Piece(self.style.names.show(self.symbols[e]), ATOM)
        if e.is_Number:
            return self._number(e)
        if e.is_Add:
            return self._sum(e)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        if isinstance(e, sp.Piecewise):
            return self._choice(e)
        if e is sp.pi:
            return Piece(self.style.pi(), ATOM)
        return self._call(e)

    # Numbers

    def _number(self, e: Any) -> Piece:
        negative, size = _sign(e)
        if size.is_Rational and size.q == 1:
            piece = self.style.whole(size.p)
        elif size.is_Rational and self._is_fraction(size):
            piece = self.style.fraction(*map(self.style.whole, (size.p, size.q)))
        else:
            piece = self.style.decimal(_number(size))
        return Piece(self.style.negative + piece.text, SUM) if negative else piece

    def _is_fraction(self, x: Any) -> bool:
        """Tell whether a person would write a fraction, and not a decimal."""
        if x.q > LARGEST_DENOMINATOR:
            return False
        return bool(x.q % 5 or (abs(x) < 1 and not self.decimals))

    # Sums

    def _sum(self, e: Any) -> Piece:
        (sign, text), *rest = self.terms(e)
        text = self.style.negative + text if sign == "-" else text
        for sign, term in rest:
            text += (self.style.minus if sign == "-" else self.style.plus) + term
        return Piece(text, SUM)

    def _ordered(self, e: Any) -> list[Any]:
        parts = sorted(sp.Add.make_args(e), key=self._place_in_sum)
        if _sign(parts[0])[0] and self._is_constant(parts[0]):
            parts.append(parts.pop(0))  # x + y - l
        positive = next((p for p in parts if not _sign(p)[0]), None)
        if positive is not None and _sign(parts[0])[0]:
            parts.remove(positive)
            parts.insert(0, positive)
        return parts

    def _is_constant(self, e: Any) -> bool:
        return all(self.rank[s][0] < _VARYING for s in e.free_symbols)

    def _place_in_sum(self, term: Any) -> tuple[Any, ...]:
        factors = sp.Mul.make_args(_sign(term)[1])
        found = [(self._place(x), x) for x in factors]
        degree = [0, 0, 0]
        for (group, *_), x in found:
            if group in _MOVING:
                degree[_MOVING[group]] -= (
                    int(x.exp) if x.is_Pow and x.exp.is_Integer else 1
                )
            elif group - 0.5 in _MOVING:  # a sum in which these are
                degree[_MOVING[group - 0.5]] -= 2
        varying = sorted(place for place, _ in found if place[0] >= _VARYING)
        constant = sorted(place for place, _ in found if place[0] < _VARYING)
        return *degree, varying, constant

    # Products

    def _product(self, e: Any) -> Piece:
        negative, size = _sign(e)
        if negative:
            piece = self.piece(size)
            text = self.style.negative + self.style.held(piece, PRODUCT)
            return Piece(text, SUM)
        number, over, under = sp.S.One, [], []
        for x in sp.Mul.make_args(e):
            if x.is_Rational:
                number = number * x
            elif x.is_Pow and x.exp.is_Rational and x.exp < 0:
                under.append(x.base ** (-x.exp))
            else:
                over.append(x)
        above, below = self._split(number)
        numerator = self._factors([*above, *sorted(over, key=self._place)])
        if not under and not below:
            return numerator
        denominator = self._factors([*below, *sorted(under, key=self._place)])
        return self.style.fraction(numerator, denominator)

    def _split(self, number: Any) -> tuple[list[Any], list[Any]]:
        """Give what of a number stands above the line, and below it."""
        if not self._is_fraction(number):
            return [number], []
        return (
            [sp.Integer(number.p)] if number.p != 1 else [],
            [sp.Integer(number.q)] if number.q != 1 else [],
        )

    def _factors(self, factors: list[Any]) -> Piece:
        if not factors:
            return self.style.whole(1)
        pieces = [self.piece(x) for x in factors]
        if len(pieces) == 1:
            return pieces[0]
        text = self.style.between.join(self.style.held(p, PRODUCT) for p in pieces)
        return Piece(text, PRODUCT)

    def _place(self, factor: Any) -> tuple[Any, ...]:
        if factor not in self._places:
            self._places[factor] = self._placed(factor)
        return self._places[factor]

    def _placed(self, factor: Any) -> tuple[Any, ...]:
        base, exponent = factor, sp.S.One
        if factor.is_Pow:
            base, exponent = factor.base, factor.exp
        key = str(base), str(exponent)
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

    # Powers and functions

    def _power(self, base: Any, exponent: Any) -> Piece:
        if exponent.is_Rational and exponent < 0:
            return self.style.fraction(
                self.style.whole(1), self._power(base, -exponent)
            )
        if exponent == 1:
            return self.piece(base)
        if exponent == sp.Rational(1, 2):
            return self.style.root(self(base))
        if base is sp.E:
            return self.style.call("exp", [self.piece(exponent)])
        if _is_function(base) and exponent.is_Integer:
            return self._call(base, int(exponent))
        return self.style.raised(self.piece(base), self.piece(exponent))

    def _call(self, e: Any, exponent: int = 1) -> Piece:
        if e is sp.E:
            return self.style.call("exp", [self.piece(sp.S.One)])
        if isinstance(e, sp.exp):
            name = "exp"
        else:
            plain = type(e).__name__
            name = getattr(e, "spelled", "") or _FUNCTIONS.get(plain, plain)
        args = [self.piece(a) for a in e.args]
        return self.style.call(name, args, exponent)

    # Conditions

    def _choice(self, e: Any) -> Piece:
        *cases, (last, _) = e.args
        shown = [(self(x), self.condition(c)) for x, c in cases]
        return self.style.choice(shown, self(last))

    def condition(self, c: Any) -> str:
        """Write what is true or false."""
        joins = self.style.joins
        if isinstance(c, sp.ITE):  # what an `if` in a condition becomes
            asked, then, other = c.args
            return self.condition(asked & then | ~asked & other)
        if isinstance(c, sp.Not):
            return joins["not"] + self.style.group(self.condition(c.args[0]))
        if isinstance(c, sp.And | sp.Or):
            join = joins["and" if isinstance(c, sp.And) else "or"]
            parts = sorted(c.args, key=sp.default_sort_key)
            return join.join(
                self.style.group(self.condition(p))
                if isinstance(p, sp.And | sp.Or)
                else self.condition(p)
                for p in parts
            )
        if isinstance(c, sp.Ne | sp.Eq):
            return self._equal(c)
        sign = self.style.comparisons[c.rel_op]
        return f"{self(c.lhs)} {sign} {self(c.rhs)}"

    def _equal(self, c: Any) -> str:
        """Write = and its contrary, which sympy makes, with < and >."""
        both = [sp.Le(*c.args, evaluate=False), sp.Ge(*c.args, evaluate=False)]
        text = self.style.joins["and"].join(self.condition(x) for x in both)
        if isinstance(c, sp.Ne):
            return self.style.joins["not"] + self.style.group(text)
        return text


# Groups of symbols, in the order in which sums are sorted by them.
_MOVING = {4: 0, 3: 1, 5: 2}
_VARYING = 1


@functools.lru_cache(maxsize=50_000)
def _sign(e: Any) -> tuple[bool, Any]:
    """Tell whether a term is written with a minus, and give it without."""
    coefficient, rest = e.as_coeff_Mul()
    if coefficient.is_number and coefficient < 0:
        return True, sp.Mul(-coefficient, *sp.Mul.make_args(rest))
    return False, e


def _is_function(e: Any) -> bool:
    return bool(e.is_Function) and not isinstance(e, sp.Piecewise | sp.exp)


def _number(e: Any) -> float | Decimal:
    """Give a number above 0 as a double, or, where none holds it, as a decimal."""
    try:
        x = float(e)
    except OverflowError:
        x = math.inf
    if 0.0 < x < math.inf:
        return x
    exact = sp.Rational(e)
    return (Decimal(int(exact.p)) / Decimal(int(exact.q))).normalize()


_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class UnicodeStyle(Style):
    """Plain text with superscripts, roots and signs."""

    between = " "
    minus, negative = " − ", "−"
    comparisons: ClassVar = {"<": "<", "<=": "≤", ">": ">", ">=": "≥"}

    def pi(self) -> str:
        """Give the number pi."""
        return "π"

    def raised(self, base: Piece, exponent: Piece) -> Piece:
        """Give a power."""
        held = self.held(base, ATOM)
        if exponent.text.isascii() and exponent.text.isdigit():
            return Piece(held + exponent.text.translate(_RAISED), POWER)
        return Piece(f"{held}^{self.held(exponent, ATOM)}", POWER)

    def root(self, inside: str) -> Piece:
        """Give a square root."""
        return Piece(f"√({inside})", ATOM)

    def call(self, name: str, args: Sequence[Piece], exponent: int = 1) -> Piece:
        """Give a function's value, or a power of it."""
        row = FUNCTIONS.get(name)  # sympy may bring one of its own
        shown = (row and row.text) or name
        inside = ", ".join(a.text for a in args)
        if isinstance(shown, tuple):
            return self._powered(Piece(inside.join(shown), ATOM), exponent)
        if exponent > 1:
            return Piece(f"{shown}{str(exponent).translate(_RAISED)}({inside})", POWER)
        return self._powered(Piece(f"{shown}({inside})", ATOM), exponent)

    def _powered(self, value: Piece, exponent: int) -> Piece:
        if exponent == 1:
            return value
        return self.raised(value, Piece(str(exponent), ATOM))


class LatexStyle(Style):
    """Mathematics of LaTeX, with amsmath."""

    between = r" \, "
    comparisons: ClassVar = {"<": "<", "<=": r"\le", ">": ">", ">=": r"\ge"}
    joins: ClassVar = {
        "and": r" \text{ and } ", "or": r" \text{ or } ", "not": r"\text{not } ",
    }  # fmt: skip

    def decimal(self, x: float | Decimal) -> Piece:
        """Give a decimal number that is not negative."""
        plain = super().decimal(x)
        mantissa, e, exponent = plain.text.partition("e")
        if not e:
            return plain
        power = f"10^{{{int(exponent)}}}"
        if mantissa == "1":
            return Piece(power, POWER)
        return Piece(rf"{mantissa} \cdot {power}", PRODUCT)

    def pi(self) -> str:
        """Give the number pi."""
        return r"\pi"

    def group(self, text: str) -> str:
        """Put parentheses around."""
        return rf"\left({text}\right)"

    def fraction(self, over: Piece, under: Piece) -> Piece:
        """Give a fraction."""
        return Piece(rf"\frac{{{over.text}}}{{{under.text}}}", PRODUCT)

    def raised(self, base: Piece, exponent: Piece) -> Piece:
        """Give a power."""
        return Piece(f"{self.held(base, ATOM)}^{{{exponent.text}}}", POWER)

    def root(self, inside: str) -> Piece:
        """Give a square root."""
        return Piece(rf"\sqrt{{{inside}}}", ATOM)

    def call(self, name: str, args: Sequence[Piece], exponent: int = 1) -> Piece:
        """Give a function's value, or a power of it."""
        inside = ", ".join(a.text for a in args)
        row = FUNCTIONS.get(name)
        command = (row and row.latex) or rf"\operatorname{{{name}}}"
        if isinstance(command, tuple):
            whole = Piece(inside.join(command), ATOM)
            power = Piece(str(exponent), ATOM)
            return whole if exponent == 1 else self.raised(whole, power)
        if exponent != 1:
            command += f"^{{{exponent}}}"
        bare = len(args) == 1 and args[0].power == ATOM and "(" not in inside
        value = f"{command} {inside}" if bare else f"{command}{self.group(inside)}"
        return Piece(value, PRODUCT if exponent == 1 and bare else POWER)

    def choice(self, cases: Sequence[tuple[str, str]], otherwise: str) -> Piece:
        """Give one of several values, by conditions."""
        lines = [rf"{value} & \text{{if }} {condition}" for value, condition in cases]
        lines.append(rf"{otherwise} & \text{{otherwise}}")
        inside = r" \\ ".join(lines)
        return Piece(rf"\begin{{cases}} {inside} \end{{cases}}", PRODUCT)
