"""How the names of a model are typeset: Greek letters, subscripts, dots, multipliers.

Different names stay different: where two would look the same (`theta1` and `theta_1`),
the later one is written letter by letter.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ",
    "eta": "η", "theta": "θ", "iota": "ι", "kappa": "κ", "lambda": "λ", "mu": "μ",
    "nu": "ν", "xi": "ξ", "omicron": "ο", "pi": "π", "rho": "ρ", "sigma": "σ",
    "tau": "τ", "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω",
}  # fmt: skip
GREEK |= {name.capitalize(): letter.upper() for name, letter in GREEK.items()}
_OF_LETTER = {letter: name for name, letter in GREEK.items()}
# Letters that look like Latin ones have no command of their own.
_LATIN = {
    "omicron": "o", "Alpha": "A", "Beta": "B", "Epsilon": "E", "Zeta": "Z", "Eta": "H",
    "Iota": "I", "Kappa": "K", "Mu": "M", "Nu": "N", "Omicron": "O", "Rho": "P",
    "Tau": "T", "Chi": "X",
}  # fmt: skip
_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_PARTS = re.compile(r"([^\W\d_]+)_?([0-9]*)((?:_\w+)?)\Z")
_ESCAPED = {"_": r"\_"}

DOTS = ("", "dot", "ddot")


@dataclass(frozen=True, slots=True)
class Name:
    """What a symbol shows: a name, how often it is differentiated, and what it is.

    `kind` is "" for a name of the file, "multiplier" for that of a constraint, and
    "unconstrained" for the acceleration of a coordinate without constraints.
    """

    base: str
    order: int = 0
    kind: str = ""


@dataclass
class Typeset:
    """The names of one model in one style.

    Attributes
    ----------
    names
        The file's names, in its order: earlier ones keep the better look.
    """

    names: Iterable[str]
    _shown: dict[str, tuple[str, str]] = field(init=False)

    def __post_init__(self) -> None:
        taken: set[str] = set(self.reserved())
        self._shown = {}
        for name in self.names:
            parts = self.split(name)
            if self.joined(*parts, 0) in taken:
                parts = self.verbatim(name)
            taken.add(self.joined(*parts, 0))
            self._shown[name] = parts

    def show(self, name: Name) -> str:
        """Give what stands for `name`."""
        if name.kind == "multiplier":
            return self.multiplier(name.base)
        if name.kind == "unconstrained":
            return self.unconstrained(self.show(Name(name.base)))
        base, below = self._shown.get(name.base) or self.split(name.base)
        return self.joined(base, below, name.order)

    def reserved(self) -> tuple[str, ...]:
        """Give what no name may look like."""
        return ()

    def split(self, name: str) -> tuple[str, str]:
        """Give the letter and the subscript of a name."""
        raise NotImplementedError

    def verbatim(self, name: str) -> tuple[str, str]:
        """Give a name letter by letter."""
        raise NotImplementedError

    def joined(self, base: str, below: str, order: int) -> str:
        """Put letter, dots and subscript together."""
        raise NotImplementedError

    def multiplier(self, constraint: str) -> str:
        """Give the multiplier of a constraint."""
        raise NotImplementedError

    def unconstrained(self, shown: str) -> str:
        """Give the acceleration without constraints of a coordinate."""
        return f"a_{shown}"


class ModelNames(Typeset):
    """Names as the model file writes them."""

    def split(self, name: str) -> tuple[str, str]:
        """Give the name as it is."""
        return name, ""

    verbatim = split

    def joined(self, base: str, below: str, order: int) -> str:
        """Give `q`, `q_dot`, `q_ddot`."""
        return f"{base}{below}" + (f"_{DOTS[order]}" if order else "")

    def multiplier(self, constraint: str) -> str:
        """Give `lambda_c`."""
        return f"lambda_{constraint}"

    def unconstrained(self, shown: str) -> str:
        """Give `a_q`, or what is like it and no name of the file."""
        name = f"a_{shown}"
        while name in self._shown:
            name += "_"
        return name


class UnicodeNames(Typeset):
    """Greek letters, subscripts, and dots above."""

    def split(self, name: str) -> tuple[str, str]:
        """Give θ, ₁ for `theta1`."""
        match = _PARTS.match(name)
        if match is None:
            return name, ""
        word, digits, rest = match.groups()
        return GREEK.get(word, word), digits.translate(_LOWERED) + rest

    def verbatim(self, name: str) -> tuple[str, str]:
        """Give the name as it is."""
        return name, ""

    def joined(self, base: str, below: str, order: int) -> str:
        """Put dots over the first letter."""
        mark = ("", "\u0307", "\u0308")[order]
        return base[0] + mark + base[1:] + below

    def multiplier(self, constraint: str) -> str:
        """Give λ with the constraint as a subscript."""
        return f"λ_{constraint}"


class LatexNames(Typeset):
    """Commands for Greek letters, subscripts, and dots above."""

    def reserved(self) -> tuple[str, ...]:
        """Give the time, which is a name in every model."""
        return ("t",)

    def split(self, name: str) -> tuple[str, str]:
        r"""Give \theta, 1 for `theta1`."""
        match = _PARTS.match(name)
        if match is None:
            return self.verbatim(name)
        word, digits, rest = match.groups()
        below = [digits] if digits else []
        below += [self._subscript(part) for part in rest.split("_") if part]
        return self._word(word), ",".join(below)

    def verbatim(self, name: str) -> tuple[str, str]:
        """Give the name letter by letter."""
        return r"\mathrm{" + _escaped(name) + "}", ""

    def joined(self, base: str, below: str, order: int) -> str:
        """Put dots over the letter and hang the subscript on it."""
        over = f"\\{DOTS[order]}{{{base}}}" if order else base
        return f"{over}_{{{below}}}" if below else over

    def multiplier(self, constraint: str) -> str:
        """Give lambda with the constraint as an upright subscript."""
        return r"\lambda_{\mathrm{" + _escaped(constraint) + "}}"

    def unconstrained(self, shown: str) -> str:
        """Give the acceleration without constraints of a coordinate."""
        return f"a_{{{shown}}}"

    def _word(self, word: str) -> str:
        name = _OF_LETTER.get(word, word)
        if name in GREEK:
            latin = _LATIN.get(name)
            return rf"\mathrm{{{latin}}}" if latin else f"\\{name}"
        if len(word) == 1 and word.isascii():
            return word
        return rf"\mathit{{{word}}}" if word.isascii() else rf"\text{{{word}}}"

    def _subscript(self, part: str) -> str:
        if part.isdigit():
            return part
        name = _OF_LETTER.get(part, part)
        return self._word(name) if len(part) == 1 or name in GREEK else (
            rf"\mathrm{{{part}}}" if part.isascii() else rf"\text{{{part}}}"
        )  # fmt: skip


def _escaped(name: str) -> str:
    text = "".join(_ESCAPED.get(c, c) for c in name)
    return text if name.isascii() else rf"\text{{{text}}}"
