"""Typeset names of a model: Greek letters, subscripts, dots, multipliers.

Different names remain different: if two would have one image (`theta1` and `theta_1`),
the later one is written letter by letter.
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from lagsim.language.columns import REACTION
from lagsim.language.names import rate_of

if TYPE_CHECKING:
    from collections.abc import Iterable


_NAMES = """
alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi omicron pi rho
sigma tau upsilon phi chi psi omega
"""
GREEK = dict(zip(_NAMES.split(), "αβγδεζηθικλμνξοπρστυφχψω", strict=True))
GREEK |= {name.capitalize(): letter.upper() for name, letter in GREEK.items()}
_OF_LETTER = {letter: name for name, letter in GREEK.items()}
# Letters that look like Latin ones have no command of their own.
_ALIKE = "omicron Alpha Beta Epsilon Zeta Eta Iota Kappa Mu Nu Omicron Rho Tau Chi"
_LATIN = dict(zip(_ALIKE.split(), "oABEZHIKMNOPTX", strict=True))
_LOWERED = str.maketrans("0123456789+-ijkmn", "₀₁₂₃₄₅₆₇₈₉₊₋ᵢⱼₖₘₙ")
RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
_PARTS = re.compile(r"([^\W\d_]+)(?:_?([0-9]+))?((?:_\w*[^\W_])?)\Z")
_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&",
    "#": r"\#", "%": r"\%", "_": r"\_", "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}", "<": r"\textless{}", ">": r"\textgreater{}",
}  # fmt: skip
# Characters in the fonts of TeX besides letters with accents.
_IN_FONTS = frozenset("ßæÆøØœŒłŁđĐþÞðÐ§°±²³µ·×÷–—‘’“”…")

DOTS = ("", "dot", "ddot")

LETTERS_OF_MEMBERS = "ijkmn"
"""Letters that denote the index of a family: `tip.i-1.x`."""
_MEMBER = re.compile(r"([0-9]+|[ijkmn]([+-][0-9]+)?)\Z")
_INDEX = r"[ijkmn](?:[+-][0-9]+)?"
_ANY_MEMBER = re.compile(
    rf"((?:\.[0-9]+)*)\.({_INDEX})((?:\.(?:[0-9]+|{_INDEX}))*)(?=[.}}]|\Z)"
)


def indexed(name: str) -> str:
    """Return the name of a member with its index in parentheses, as in files.

    The index contains a letter: `tip(i-1).x` for `tip.i-1.x`.
    """
    return _ANY_MEMBER.sub(
        lambda m: f"({', '.join(m[0].removeprefix('.').split('.'))})", name
    )


@dataclass(frozen=True, slots=True)
class PrintedName:
    """Symbol to print: a name, its order of differentiation, and its kind.

    `kind` is "" for a name of the file, "index" for the index of a sum, "multiplier"
    for that of a constraint,
    "unconstrained" for the acceleration of a coordinate without constraints, and
    "momentum", "force" or "reaction" for that of a definition.
    """

    base: str
    order: int = 0
    kind: str = ""


@dataclass
class ModelNames:
    """Typesetting of the names of one model; this class writes names as in the file.

    Other styles are derived classes.

    Attributes
    ----------
    names : iterable of str
        The names in the order of the file. If two names would be typeset alike, the
        later one is written letter by letter.
    """

    names: Iterable[str]
    _shown: dict[str, tuple[str, str]] = field(init=False)
    _taken: set[str] = field(init=False)

    of_multiplier: ClassVar[str] = "lambda_{}"
    """The multiplier of a constraint, whose name is written letter by letter."""
    letters: ClassVar[dict[str, tuple[str, ...]]] = {
        "unconstrained": ("a_",), "momentum": ("momentum.",), "force": ("force.",),
        "reaction": (REACTION.prefix,),
    }  # fmt: skip
    """Of the other kinds, the best first; a name of the file follows as `below`."""
    below: ClassVar[str] = "{}"

    def __post_init__(self) -> None:
        taken = self._taken = set()
        self._shown = {}
        for name in self.names:
            parts = self.split(name)
            if self.joined(*parts, 0) in taken:
                parts = self.verbatim(name)
            taken.add(self.joined(*parts, 0))
            self._shown[name] = parts

    def is_file_name(self, name: str) -> bool:
        """Whether `name` is a name of the file."""
        return name in self._shown

    def show(self, name: PrintedName) -> str:
        """Return a name, with its order of differentiation and kind, typeset."""
        if name.kind == "index":
            return name.base
        if name.kind == "multiplier":
            return indexed(self.of_multiplier.format(self.verbatim(name.base)[0]))
        if name.kind:
            below = self.below.format(self.show(PrintedName(name.base)))
            letters = self.letters[name.kind]
            texts = [self.joined(x, below, name.order) for x in letters]
            more = (texts[0] + "_" * k for k in itertools.count(1))
            return next(x for x in itertools.chain(texts, more) if x not in self._taken)
        base, below = self._shown.get(name.base) or self.split(name.base)
        return self.joined(base, below, name.order)

    def split(self, name: str) -> tuple[str, str]:
        """Return the letter or word of a name, typeset, and its subscript or ""."""
        return self.verbatim(name)

    def verbatim(self, name: str) -> tuple[str, str]:
        """Return a name letter by letter, unlike `split`, and an empty subscript."""
        return name, ""

    def joined(self, base: str, below: str, order: int) -> str:
        """Return a name made of the letter `base`, subscript `below` and order.

        order : the order of the derivative, 0 to 2.
        """
        return indexed(rate_of(f"{base}{below}", order))


class UnicodeNames(ModelNames):
    """Names in Unicode: Greek letters, subscripts, and dots above for rates."""

    of_multiplier, below = "λ_{}", "_{}"
    letters: ClassVar = {
        "unconstrained": ("a", "a\u0304"), "momentum": ("p", "p\u0304"),
        "force": ("Q", "Q\u0304"), "reaction": ("R", "R\u0304"),
    }  # fmt: skip

    def split(self, name: str) -> tuple[str, str]:
        """Return the letter or word of a name, and its subscript.

        Examples are θ, ₁ for `theta1`; q, ₁,₂ for `q.1.2`; and r, .x for `r.x`.
        """
        head, *member = name.split(".")
        match = _PARTS.match(head)
        if match is None:
            return name, ""
        word, digits, rest = match.groups("")
        below = digits.translate(_LOWERED) + rest
        numbers = [part for part in member if _MEMBER.match(part)]
        below += ",".join(part.translate(_LOWERED) for part in numbers)
        below += "".join(f".{part}" for part in member if part not in numbers)
        return GREEK.get(word, word), below

    def joined(self, base: str, below: str, order: int) -> str:
        """Return `base` with dots above and subscript `below`; words end in `_dot`.

        order : the order of the derivative, 0 to 2.
        """
        if len(base) > 1 and order:
            return f"{base}{below}_{DOTS[order]}"
        return base + ("", "\u0307", "\u0308")[order] + below


class LatexNames(ModelNames):
    """Names in LaTeX: commands for Greek letters, subscripts, and dots for rates."""

    of_multiplier = r"\lambda_{{{}}}"
    letters: ClassVar = {
        "unconstrained": ("a", r"\bar{a}"), "momentum": ("p", r"\bar{p}"),
        "force": ("Q", r"\bar{Q}"), "reaction": ("R", r"\bar{R}"),
    }  # fmt: skip

    def split(self, name: str) -> tuple[str, str]:
        r"""Return the letter and the subscript of a name: \theta and 1 for `theta1`."""
        head, *member = name.split(".")
        match = _PARTS.match(head)
        if match is None:
            return self.verbatim(name)
        word, digits, rest = match.groups("")
        below = [digits] if digits else []
        below += [self._subscript(part) for part in (*rest.split("_"), *member) if part]
        return self._word(word), ",".join(below)

    def verbatim(self, name: str) -> tuple[str, str]:
        """Return a name in upright letters, unlike `split`, and an empty subscript."""
        return upright_latex(name), ""

    def joined(self, base: str, below: str, order: int) -> str:
        """Return `base` and subscript `below` as LaTeX, with dots by the order."""
        over = f"\\{DOTS[order]}{{{base}}}" if order else base
        return f"{over}_{{{below}}}" if below else over

    @staticmethod
    def letter(name: str) -> str:
        """Return the LaTeX command of a Greek letter, given its name."""
        latin = _LATIN.get(name)
        return rf"\mathrm{{{latin}}}" if latin else f"\\{name}"

    def _word(self, word: str) -> str:
        name = _OF_LETTER.get(word, word)
        if name in GREEK:
            return self.letter(name)
        if len(word) == 1 and word.isascii():
            return word
        return rf"\mathit{{{word}}}" if word.isascii() else upright_latex(word)

    def _subscript(self, part: str) -> str:
        if _MEMBER.match(part):
            return part
        name = _OF_LETTER.get(part, part)
        if len(part) == 1 or name in GREEK:
            return self._word(name)
        return upright_latex(part)


def plain_latex(text: str) -> str:
    """Return text with special characters of LaTeX escaped, unknown ones as codes."""
    return "".join(_SPECIAL.get(c) or _in_fonts(c) for c in text)


def _in_fonts(c: str) -> str:
    if c in _OF_LETTER:
        return f"${LatexNames.letter(_OF_LETTER[c])}$"
    accented = "À" <= c <= "ſ" and unicodedata.normalize("NFD", c)[0].isascii()
    return c if c.isascii() or accented or c in _IN_FONTS else f"[U+{ord(c):04X}]"


def upright_latex(name: str) -> str:
    """Return a name as LaTeX in upright letters."""
    command = "mathrm" if name.isascii() else "text"
    return rf"\{command}{{{plain_latex(name)}}}"
