"""What was likely meant by a text that is none of the expression language.

Spellings of other languages, of textbooks and of pocket calculators; loaded only where
there is a fault.
"""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING

from lagsim.language.functions import FUNCTIONS

if TYPE_CHECKING:
    from collections.abc import Collection

# Functions that go by another name elsewhere.
_ELSEWHERE = {
    "ln": "log(x), the natural logarithm",
    "log2": "log(x)/log(2)",
    "arcsin": "asin(x)",
    "arccos": "acos(x)",
    "arctan": "atan(x)",
    "arctan2": "atan2(y, x)",
    "arcsinh": "asinh(x)",
    "arccosh": "acosh(x)",
    "arctanh": "atanh(x)",
    "sgn": "sign(x)",
    "fabs": "abs(x)",
    "pow": "a^b",
    "square": "x^2",
    "power": "a^b",
    "maximum": "max(a, b)",
    "minimum": "min(a, b)",
    "where": "if(condition, a, b)",
    "deg2rad": "x*pi/180",
    "radians": "x*pi/180",
}
# What is meant shows within so many letters of a fault; patterns that are tried at each
# of a million would take for ever.
WINDOW = 100
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_CALLED = "|".join(sorted((*FUNCTIONS, *_ELSEWHERE), key=len, reverse=True))
# Each is looked for around the fault: what is matched, and what to write instead.
_SPELLINGS = [
    (
        rf"({_NUMBER})\s*(?:°|\bdeg(?:rees?)?\b)",
        r"write {0}*pi/180: angles are in radians",
    ),
    (rf"({_NUMBER})\s*π", "write {0}*pi"),
    (rf"\b({_CALLED})\s*(?:\^|\*\*)\s*(\d+)\s*\(([^()]*)\)", "write {0}({2})^{1}"),
    (rf"\b({_CALLED})\s*(?:\^|\*\*)\s*(\d+)\s+(\w+)", "write {0}({2})^{1}"),
    (rf"\b({_CALLED})\s*(?:\^|\*\*)\s*(\d+)", "write {0}(...)^{1}"),
    (rf"\b({_CALLED})\s+([^\W\d]\w*|{_NUMBER})", "write {0}({1})"),
    (r"\b(?:np|numpy|math|cmath|sp|sympy)\.(\w+)", "write `{0}`, without a module"),
    (r"\bdiff\(\s*(\w+)\s*,\s*t\s*\)", "the rate is written {0}_dot"),
    (r"\bd\s*\(?(\w+)\)?\s*/\s*dt\b", "the rate is written {0}_dot"),
    (r"(\w+)''", "the second rate is written {0}_ddot"),
    (r"(\w+)'", "the rate is written {0}_dot"),
    (r"\|([^|]+)\|", "write abs({0})"),
    (r"√\s*\(([^()]*)\)", "write sqrt({0})"),
    (r"√\s*(\w+)", "write sqrt({0})"),
]
# Units that are often names of variables too.
_UNITS = ("m", "g", "s", "N", "J", "W", "K", "A", "V", "C", "T", "F", "H", "h", "l")
_QUANTITY = re.compile(rf"\s*([-+]?\s*{_NUMBER})\s*([^\W\d_][\w*/^·.() -]*)")

_SECOND_RATES = [
    r"dd_?(.+)", r"d2_?(.+?)(?:_?dt2)?", r"(.+?)_?ddot", r"(.+)_dotdot", r"ddot_?(.+)",
    r"(.+)_dd",
]  # fmt: skip
_RATES = [
    r"d_?(.+?)(?:_?dt)?", r"(.+?)_?dot", r"(.+)_(?:dt|d|t|prime)", r"dot_?(.+)",
    r"[vw]_?(.+)",
]  # fmt: skip
_COMBINING = {"\u0307": "_dot", "\u0308": "_ddot"}


def of_text(text: str, offset: int, known: Collection[str]) -> str:
    """Give a hint for an expression with a fault at `offset`, or an empty text.

    Parameters
    ----------
    known
        The variables of the file.
    """
    first = max(0, offset - WINDOW)
    whole, text, offset = text, text[first : offset + WINDOW], offset - first
    quantity = _QUANTITY.fullmatch(text)
    if quantity and text == whole:
        number, unit = (part.replace(" ", "") for part in quantity.groups())
        beside = f"a unit stands beside its number: {{value: {number}, unit: {unit}}}"
        product = _is_product(quantity[2], known)
        if product and unit in _UNITS:
            return f"a product is written {number}*{unit}; {beside}"
        if not product and unit not in ("deg", "degree", "degrees"):
            return f"write {number}; where there may be one, {beside}"
    for pattern, meant in _SPELLINGS:
        for match in re.finditer(pattern, text):
            if match.start() <= offset <= match.end():
                return meant.format(*match.groups())
    return ""


def _is_product(words: str, known: Collection[str]) -> bool:
    """Tell whether what follows a number are variables, the `*` forgotten."""
    found = re.findall(r"[^\W\d_]\w*", words)
    return all(word in known or word in ("pi", "π", "t", *FUNCTIONS) for word in found)


def of_function(name: str) -> str:
    """Give a hint for a function that is called otherwise here."""
    return f"write {_ELSEWHERE[name]}" if name in _ELSEWHERE else ""


def of_name(name: str, moving: Collection[str]) -> str:
    """Give a hint for a name that means nothing.

    Parameters
    ----------
    moving
        The names that have rates.
    """
    if name in ("π", "Pi", "PI"):
        return "write pi"
    if name == "e":
        return "write exp(x) for e^x, exp(1) for e"
    rate = rate_of(name, moving)
    return f"the {_ordinal(rate)}rate is written {rate}" if rate else ""


def _ordinal(rate: str) -> str:
    return "second " if rate.endswith("_ddot") else ""


def rate_of(name: str, moving: Collection[str]) -> str:
    """Give the rate that is spelt otherwise, such as `x_dot` for `xdot`, or nothing."""
    if len(name) > WINDOW:
        return ""
    for mark, ending in _COMBINING.items():
        plain = unicodedata.normalize("NFD", name)
        if mark in plain and plain.replace(mark, "") in moving:
            return plain.replace(mark, "") + ending
    for patterns, ending in ((_RATES, "_dot"), (_SECOND_RATES, "_ddot")):
        for pattern in patterns:
            match = re.fullmatch(pattern, name)
            if match and match[1] in moving:
                return match[1] + ending
    return ""
