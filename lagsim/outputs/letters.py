"""Names in pictures: Greek letters, subscripts and dots instead of underscores.

A subscript for which Unicode has no letters is enclosed by two marks until the text is
drawn: `mathtext` converts such a text for matplotlib, `plain_letters` for others.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from lagsim.language.columns import KINDS, parsed
from lagsim.language.names import rated
from lagsim.show.names import GREEK, PrintedName, UnicodeNames

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.model.model import Model

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

# Marks around a subscript; no name contains them, other texts are cleared of both.
BELOW, END = "\x0e", "\x0f"
ELLIPSIS = "…"
_DIGITS = str.maketrans("₀₁₂₃₄₅₆₇₈₉", "0123456789")
_SUBSCRIPT = re.compile(f"{BELOW}([\\w,.+−]*){END}")
_MARKS = re.compile(f"[{BELOW}{END}]")
_DOTTED = re.compile("(\\w+)([\u0307\u0308])")
_COMMANDS = {"\u0307": "dot", "\u0308": "ddot"}
# Texts that matplotlib draws well as a formula only.
_FORMULA = re.compile(f"{BELOW}|\\w\\w[\u0307\u0308]")

_POWER = re.compile(r"(?:\^|\*\*)(-?\d+)")
# A member of a family or a function of a simple argument, with a component; or a name
# that stands alone or in an expression, and is no function.
_NAME = re.compile(
    r"(?P<head>[^\W\d]\w*)\((?P<at>[\w\s,+-]*)\)(?P<component>\.[^\W\d]\w*)?"
    r"|[^\W\d]\w*(?!\w|\s*\()"
)
# Words before the point in names of columns.
_HEADS = frozenset(x.prefix.partition(".")[0] for x in KINDS if not x.letter)


class PictureNames(UnicodeNames):
    """Names in pictures: all parts after `_` are a subscript, as in `x_left`."""

    def split(self, name: str) -> tuple[str, str]:
        """Return the letter or word of a name, and its subscript or ""."""
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
        """Return a letter or word with `order` dots over it, and a subscript.

        below : the subscript.
        """
        return base + ("", *_COMMANDS)[order] + below


class Letters:
    """Typesetting of the names of one model.

    Parameters
    ----------
    names : iterable of str
        Names of the model. Typeset names are distinct; where two would be equal,
        earlier names have precedence.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        names = list(names)
        self._typeset = PictureNames(names)
        self._families = {
            head for head, _, rest in (x.partition(".") for x in names) if rest
        }

    def name(self, name: str) -> str:
        """Return the typeset name of a variable or a column: θ̇ for `theta_dot`."""
        found = parsed(name)
        if found is not None and found[0].letter:
            rest = self.name(found[1]).translate(_DIGITS)
            below = _SUBSCRIPT.sub(r",\1", rest)
            return f"{found[0].letter}{BELOW}{below}{END}"
        base, order = rated(name)
        head, point, rest = base.partition(".")
        of_constraint = head in _HEADS and not rest[:1].isdigit()
        if point and of_constraint and not self._typeset.is_file_name(base):
            return f"{head}.{self.name(name.partition('.')[2])}"
        return self._typeset.show(PrintedName(base, order))

    def text(self, text: str) -> str:
        """Return an expression with its names typeset: q₁ for `q(1)`.

        Examples
        --------
        >>> Letters(["theta", "m"]).text("m*theta_dot^2")
        'm*θ̇^2'
        """
        return _NAME.sub(self._written, text).replace("-", "−")

    def _written(self, found: re.Match[str]) -> str:
        """Return the typeset form of one name, found in an expression by a pattern."""
        head, at, component = found["head"], found["at"], found["component"] or ""
        if head is None:
            return self.name(found[0])
        base, order = rated(head)
        if base not in self._families:
            return f"{head}({self.text(at)}){component}"
        parts = ["".join(part.split()) for part in at.split(",")]
        if all(part.isdigit() for part in parts):
            return self.name(".".join([head, *parts]) + component)
        letter, below = self._typeset.split(base)
        below += f"{BELOW}{','.join(parts).replace('-', '−')}{END}"
        return self._typeset.joined(letter, below, order) + component


def letters_of(model: Model) -> Letters:
    """Return the typesetting of a model's names."""
    parts = (model.variables, model.definitions, model.parameters)
    return Letters([x.name for part in parts for x in part])


def mathtext(text: str) -> str:
    """Return a typeset text in matplotlib's mathtext, with its own `$` escaped."""
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


def plain_letters(text: str) -> str:
    """Return a typeset text as plain letters, which may be cut anywhere: λ_c."""
    return text.replace(BELOW, "_").replace(END, "")


def cut_text(text: str, most: int) -> str:
    """Return a text of at most `most` letters; a longer one loses its middle.

    Examples
    --------
    >>> cut_text("kinetic energy of the rod", 15)
    'kinetic…the rod'
    """
    text = "".join(c if c.isprintable() or c in (BELOW, END) else " " for c in text)
    if len(text) <= most:
        return text
    text = plain_letters(text)
    # Names differ at the end more often than in the middle.
    head = max(1, most // 2)
    return text[:head] + ELLIPSIS + text[len(text) - max(1, most - head - 1) :]


def raised_powers(unit: str) -> str:
    """Return a unit with its powers raised: m/s² for `m/s^2`.

    Examples
    --------
    >>> raised_powers("m/s^2")
    'm/s²'
    """
    return _POWER.sub(lambda found: found[1].translate(SUPERSCRIPTS), unit)
