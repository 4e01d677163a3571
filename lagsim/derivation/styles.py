"""How expressions look in plain text and in LaTeX; `Style` is the model language."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from lagsim.derivation.writer import ATOM, POWER, PRODUCT, Piece, Style
from lagsim.language.functions import FUNCTIONS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from decimal import Decimal

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
