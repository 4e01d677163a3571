"""The equations of motion as MathML, for a page in a browser."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim.language.functions import FUNCTIONS
from lagsim.show import always
from lagsim.show.names import PrintedName, UnicodeNames
from lagsim.show.printers import TextPrinter

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from lagsim.show import Content


def as_mathml(content: Content) -> str:
    """Return the equations, constraints and definitions of a derivation as MathML.

    Equations are those of coordinates and first-order states. Friction and limits,
    which are no equations, are left out.

    Returns
    -------
    str
        Elements of HTML: one `math` for each equation. Names of the file occur as
        escaped text alone.
    """
    x, c = content
    write = MathPrinter(x, UnicodeNames(x.own_names))

    def row(left: str, right: Any) -> str:
        return f"<math display='block'>{left}<mo>=</mo>{write(right)}</math>"

    def rows() -> Iterator[str]:
        for line in c["equations"]:
            yield row(write(line["left"]), line["right"])
        for name, rate in (c.get("states") or {}).items():
            yield row(_name(write.names.show(PrintedName(name, 1))), rate)
        for k in c["constraints"]:
            zero = "<mn>0</mn>"
            sign = "=" if always(k) else "≥"
            if k["limit"] is None:
                shown = write(k["function"])
                yield f"<math display='block'>{shown}<mo>{sign}</mo>{zero}</math>"
        for symbol, value in x.definitions.items():
            yield row(write(symbol), value)

    return "\n".join(rows())


def _name(shown: str) -> str:
    return f"<mi>{html.escape(shown)}</mi>"


def _inside(parts: Iterable[str]) -> str:
    return f"<mrow>{''.join(parts)}</mrow>"


class MathPrinter(TextPrinter):
    """Printer of expressions as presentation MathML."""

    plus, minus, negative = "<mo>+</mo>", "<mo>−</mo>", "<mo>−</mo>"
    # The invisible sign of a product.
    between = "<mo>&#8290;</mo>"

    def parenthesize(self, item: Any, level: Any, strict: bool = False) -> str:
        """Return an expression as MathML, in parentheses if it binds less than `level`.

        item : the expression.
        level : a precedence of sympy.
        strict : whether parentheses are left out at equal precedence.
        """
        from sympy.printing.precedence import precedence

        text = _inside([self._print(item)])
        binds = precedence(item)
        if binds < level or (not strict and binds <= level):
            return f"<mo>(</mo>{text}<mo>)</mo>"
        return text

    def _print_Symbol(self, e: Any, **given: Any) -> str:
        return _name(super()._print_Symbol(e, **given))

    def _print_Integer(self, e: Any) -> str:
        return super()._print_Integer(e) if e < 0 else f"<mn>{e}</mn>"

    def _decimal(self, e: Any) -> str:
        mantissa, _, exponent = super()._decimal(e).partition("e")
        number = f"<mn>{mantissa}</mn>"
        if not exponent:
            return number
        power = f"<msup><mn>10</mn><mn>{int(exponent)}</mn></msup>"
        return power if mantissa == "1" else f"{number}<mo>·</mo>{power}"

    def _over(self, over: str, under: str) -> str:
        over, under = (x if "<" in x else f"<mn>{x}</mn>" for x in (over, under))
        return f"<mfrac><mrow>{over}</mrow><mrow>{under}</mrow></mfrac>"

    def _quotient(self, over: list[Any], under: list[Any]) -> str:
        parts = (
            self._print(x[0]) if len(x) == 1 else self.product(x) or "1"
            for x in (over, under)
        )
        return self._over(*parts)

    def _print_Pow(self, e: Any, _rational: bool = False) -> str:
        base, exponent = e.args
        if exponent.is_Rational and exponent < 0:
            return self._print_Mul(e)
        if exponent == sp.S.Half:
            return f"<msqrt>{self._print(base)}</msqrt>"
        below = _inside(
            [self.parenthesize(base, sp.printing.precedence.PRECEDENCE["Pow"])]
        )
        return f"<msup>{below}{_inside([self._print(exponent)])}</msup>"

    def _print_Exp1(self, _: Any) -> str:
        return "<mi>e</mi>"

    def _print_Pi(self, _: Any) -> str:
        return "<mi>π</mi>"

    def _print_Function(self, e: Any) -> str:
        name = getattr(e, "spelled", "") or type(e).__name__
        row = FUNCTIONS.get(name)
        shown = (row and row.text) or name
        inside = "<mo>,</mo>".join(map(self._print, e.args))
        if isinstance(shown, tuple):
            first, last = (f"<mo>{html.escape(x)}</mo>" for x in shown)
            return f"{first}{inside}{last}"
        return f"{_name(shown)}<mo>(</mo>{inside}<mo>)</mo>"

    _print_Abs = _print_exp = _print_log = _print_Function

    def _print_Piecewise(self, e: Any) -> str:
        rows = "".join(
            f"<mtr><mtd>{self._print(value)}</mtd><mtd>{self._when(condition)}</mtd></mtr>"
            for value, condition in e.args
        )
        return f"<mo>{{</mo><mtable>{rows}</mtable>"

    def _when(self, condition: Any) -> str:
        if condition == True:  # noqa: E712  sympy's own truth
            return "<mtext>else</mtext>"
        return f"<mtext>if </mtext>{self._print(condition)}"

    def _print_Relational(self, e: Any) -> str:
        signs = {"==": "=", "<=": "≤", ">=": "≥", "!=": "≠"}
        sign = html.escape(signs.get(e.rel_op, e.rel_op))
        left, right = map(self._print, e.args)
        return f"{left}<mo>{sign}</mo>{right}"

    def _print_Not(self, e: Any) -> str:
        return f"<mtext>not </mtext><mo>(</mo>{self._print(e.args[0])}<mo>)</mo>"

    def _print_And(self, e: Any) -> str:
        word = " and " if isinstance(e, sp.And) else " or "
        parts = sorted(e.args, key=sp.default_sort_key)
        return f"<mtext>{word}</mtext>".join(map(self._print, parts))

    _print_Or = _print_And

    def _print_Sum(self, e: Any) -> str:
        text = self.factor(e.function)
        for letter, first, last in e.limits:  # inner ones first
            below = f"{self._print(letter)}<mo>=</mo>{self.end_of_range(first)}"
            ends = f"{_inside([below])}{_inside([self.end_of_range(last)])}"
            text = f"<munderover><mo>∑</mo>{ends}</munderover>{text}"
        return text
