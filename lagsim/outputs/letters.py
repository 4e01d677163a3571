"""Names as pictures write them: Greek letters, subscripts, dots; the rest as it is."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from lagsim.show.names import Name, UnicodeNames

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.model.model import Model

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
RATES = {"_dot": 1, "_ddot": 2}
# Columns that go with a name: constraint forces, multipliers and what they miss.
PREFIXES = {"Qc_": "Qc_", "lambda_": "λ_", "residual_": "residual_"}

_POWER = re.compile(r"(?:\^|\*\*)(-?\d+)")
# A name that stands alone or in an expression, and is no function.
_NAME = re.compile(r"[^\W\d]\w*(?!\w|\s*\()")


class Letters:
    """How the names of one model are written; those that come first look best."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._typeset = UnicodeNames(names)

    def name(self, name: str) -> str:
        """Give a name, or a column's: θ̇ for `theta_dot`, `Qc_θ` for `Qc_theta`."""
        for prefix, written in PREFIXES.items():
            if name.startswith(prefix):
                return written + self.name(name.removeprefix(prefix))
        for ending, order in RATES.items():
            if name.endswith(ending):
                base = self.name(name.removesuffix(ending))
                # Over a word, dots would stand above its first letter.
                letter = base.rstrip("₀₁₂₃₄₅₆₇₈₉")
                if len(letter) == 1:
                    mark = "\u0307" if order == 1 else "\u0308"
                    return letter + mark + base[1:]
                return base + ending
        head, point, rest = name.partition(".")
        if point:
            return f"{head}.{'.'.join(self.name(part) for part in rest.split('.'))}"
        return self._typeset.show(Name(name))

    def text(self, text: str) -> str:
        """Give an expression with its names written so."""
        return _NAME.sub(lambda found: self.name(found[0]), text)


def letters_of(model: Model) -> Letters:
    """Give how a model's names are written."""
    names = [c.name for c in model.coordinates]
    return Letters([*names, *(d.name for d in model.definitions)])


def raised(unit: str) -> str:
    """Give a unit with its powers raised: m/s² for `m/s^2`."""
    return _POWER.sub(lambda found: found[1].translate(SUPERSCRIPTS), unit)
