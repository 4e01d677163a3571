"""Names as pictures write them: Greek letters, subscripts, dots; the rest as it is.

A subscript that Unicode has no letters for stands between two marks until a text is
drawn: `mathtext` gives what matplotlib typesets, `plain` what is read without it.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from lagsim.language.names import rated
from lagsim.show.names import GREEK, Name, UnicodeNames

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.model.model import Model

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Columns that go with a name: constraint forces, multipliers and what they miss.
PREFIXES = {"Qc_": "Qc", "lambda_": "λ", "residual_": "residual"}

# Around a subscript; no name has them, and of other texts they are taken out.
BELOW, END = "\x0e", "\x0f"
ELLIPSIS = "…"
_DIGITS = str.maketrans("₀₁₂₃₄₅₆₇₈₉", "0123456789")
_SUBSCRIPT = re.compile(f"{BELOW}([\\w,.]*){END}")
_MARKS = re.compile(f"[{BELOW}{END}]")
_DOTTED = re.compile("(\\w+)([\u0307\u0308])")
_COMMANDS = {"\u0307": "dot", "\u0308": "ddot"}
# What is not drawn well without a formula.
_FORMULA = re.compile(f"{BELOW}|\\w\\w[\u0307\u0308]")

_POWER = re.compile(r"(?:\^|\*\*)(-?\d+)")
# A name that stands alone or in an expression, and is no function.
_NAME = re.compile(r"[^\W\d]\w*(?!\w|\s*\()")


class PictureNames(UnicodeNames):
    """Names with all that follows `_` as a subscript: `x_left`, `omega_1`."""

    def split(self, name: str) -> tuple[str, str]:
        """Return the letter or word, and its subscript."""
        base, below = super().split(name)
        digits, _, rest = below.partition("_")
        if not rest:
            return base, below
        if len(base) > 1 and any(len(part) > 1 for part in rest.split("_")):
            return name, ""  # words: `normal_force`
        parts = [digits.translate(_DIGITS)] if digits else []
        parts += [GREEK.get(part, part) for part in rest.split("_") if part]
        return base, f"{BELOW}{','.join(parts)}{END}"

    def joined(self, base: str, below: str, order: int) -> str:
        """Put dots over a letter or word."""
        return base + ("", *_COMMANDS)[order] + below


class Letters:
    """Typeset names of one model; the names that come first look best."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._typeset = PictureNames(names)

    def name(self, name: str) -> str:
        """Return a name, or a column's: θ̇ for `theta_dot`, Qc with θ for `Qc_theta`."""
        for prefix, written in PREFIXES.items():
            if name.startswith(prefix):
                rest = self.name(name.removeprefix(prefix)).translate(_DIGITS)
                below = _SUBSCRIPT.sub(r",\1", rest)
                return f"{written}{BELOW}{below}{END}"
        base, order = rated(name)
        if "." not in name or self._typeset.knows(base):
            return self._typeset.show(Name(base, order))
        head, point, rest = name.partition(".")
        if point:
            return f"{head}.{'.'.join(self.name(part) for part in rest.split('.'))}"
        return self._typeset.show(Name(name))

    def text(self, text: str) -> str:
        """Return an expression with its names written so."""
        return _NAME.sub(lambda found: self.name(found[0]), text).replace("-", "−")


def letters_of(model: Model) -> Letters:
    """Return how a model's names are written."""
    names = [x.name for x in model.variables]
    return Letters([*names, *(d.name for d in model.definitions)])


def mathtext(text: str) -> str:
    """Return a text as matplotlib's mathtext has it; a `$` of its own is no formula."""
    shown = text.replace("$", r"\$")
    if _FORMULA.search(text):
        shown = _SUBSCRIPT.sub(_below, shown)
        shown = _DOTTED.sub(_dotted, shown)
    return _MARKS.sub("", shown)


def _below(found: re.Match[str]) -> str:
    letters = found[1].replace("_", r"\_")
    return rf"$_\mathrm{{{letters}}}$"


def _dotted(found: re.Match[str]) -> str:
    letters = found[1].replace("_", r"\_")
    return rf"$\{_COMMANDS[found[2]]}{{\mathrm{{{letters}}}}}$"


def plain(text: str) -> str:
    """Return a text that may be cut anywhere: λ_c for λ with c as its subscript."""
    return text.replace(BELOW, "_").replace(END, "")


def shortened(text: str, most: int) -> str:
    """Return a text of at most so many letters, if need be without its middle."""
    text = "".join(c if c.isprintable() or c in (BELOW, END) else " " for c in text)
    if len(text) <= most:
        return text
    text = plain(text)
    # Names differ at the end more often than in the middle.
    head = max(1, most // 2)
    return text[:head] + ELLIPSIS + text[len(text) - max(1, most - head - 1) :]


def raised(unit: str) -> str:
    """Return a unit with its powers raised: m/s² for `m/s^2`."""
    return _POWER.sub(lambda found: found[1].translate(SUPERSCRIPTS), unit)
