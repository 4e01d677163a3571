"""How expressions look in plain text and in LaTeX; `Style` is the model language."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from lagsim.derivation.writer import ATOM, POWER, PRODUCT, Piece, Style

if TYPE_CHECKING:
    from collections.abc import Sequence

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class UnicodeStyle(Style):
    """Plain text with superscripts, roots and signs."""

    between = " "
    minus, negative = " − ", "−"
    comparisons: ClassVar = {"<": "<", "<=": "≤", ">": ">", ">=": "≥"}

    def whole(self, x: int) -> str:
        """Give a whole number that is not negative."""
        return str(x) if x < 10**15 else self.decimal(float(x))

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
        name = {"log": "ln", "log10": "log₁₀"}.get(name, name)
        inside = ", ".join(a.text for a in args)
        if name == "abs":
            return self._powered(Piece(f"|{inside}|", ATOM), exponent)
        if exponent > 1:
            return Piece(f"{name}{str(exponent).translate(_RAISED)}({inside})", POWER)
        return self._powered(Piece(f"{name}({inside})", ATOM), exponent)

    def _powered(self, value: Piece, exponent: int) -> Piece:
        if exponent == 1:
            return value
        return self.raised(value, Piece(str(exponent), ATOM))


_COMMANDS = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "min", "max")
_SPECIAL = {
    "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan", "log": r"\ln",
    "log10": r"\log_{10}", "sign": r"\operatorname{sgn}",
}  # fmt: skip
_BRACKETS = {
    "abs": (r"\left|", r"\right|"),
    "floor": (r"\left\lfloor ", r"\right\rfloor "),
    "ceil": (r"\left\lceil ", r"\right\rceil "),
}


class LatexStyle(Style):
    """Mathematics of LaTeX, with amsmath."""

    between = r" \, "
    comparisons: ClassVar = {"<": "<", "<=": r"\le", ">": ">", ">=": r"\ge"}
    joins: ClassVar = {
        "and": r" \text{ and } ", "or": r" \text{ or } ", "not": r"\text{not } ",
    }  # fmt: skip

    def whole(self, x: int) -> str:
        """Give a whole number that is not negative."""
        return str(x) if x < 10**15 else self.decimal(float(x))

    def decimal(self, x: float) -> str:
        """Give a decimal number that is not negative."""
        text = super().decimal(x)
        mantissa, e, exponent = text.partition("e")
        return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if e else text

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
        if name in _BRACKETS or name == "cbrt":
            left, right = _BRACKETS.get(name, (r"\sqrt[3]{", "}"))
            whole = Piece(left + inside + right, ATOM)
            power = Piece(str(exponent), ATOM)
            return whole if exponent == 1 else self.raised(whole, power)
        command = _SPECIAL.get(name) or (
            f"\\{name}" if name in _COMMANDS else rf"\operatorname{{{name}}}"
        )
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
