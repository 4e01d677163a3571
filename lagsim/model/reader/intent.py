"""What was likely meant by a text that is none of the expression language.

Spellings of other languages, of textbooks and of pocket calculators; loaded only where
there is a fault.
"""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING

from lagsim.language.functions import FUNCTIONS
from lagsim.model.reader import quantities, spellings
from lagsim.model.reader.quantities import NUMBER
from lagsim.model.reader.spellings import RADIANS
from lagsim.model.reader.written import (
    FRACTION,
    OF_NAMES,
    OF_NUMBERS,
    PATTERNS,
    call,
    latex,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

# What is meant shows within so many letters of a fault; patterns that are tried at each
# of a million would take for ever.
WINDOW = 100
# Names that are tried as parts of a longer one.
MOST_PARTS = 200

# A letter of one side of a comparison, or a call.
_SIDE = r"(?:[^(),<>=]|\([^()]*\))"
_WORD = re.compile(r"[^\W\d]\w*")
_QUANTITY = re.compile(
    rf"\s*([-+]?\s*{NUMBER})\s*[\[(]?((?:[^\W\d_]|[°º])[\w*/^·⋅.()\s-]*?|)[\])]?\s*\.?\s*"
)

_SECOND_RATES = [
    r"dd_?(.+)", r"d2_?(.+?)(?:_?dt2)?", r"(.+?)_?ddot", r"(.+)_dotdot", r"ddot_?(.+)",
    r"(.+)_dd", r"(.+)''", r"(.+?)_?dot_?dot", r"(?:acceleration|accel|acc|a)_(.+)",
    r"(.+)_(?:acceleration|accel|acc)",
]  # fmt: skip
_RATES = [
    r"d_?(.+?)(?:_?dt)?", r"(.+?)_?dot", r"(.+)_(?:dt|d|t|prime)", r"dot_?(.+)",
    r"(?:velocity|vel|speed|omega|v|w)_?(.+)", r"(.+?)_?(?:velocity|vel|speed|rate)",
    r"(.+)d", r"(.+)'",
]  # fmt: skip
_NUMBERS = {
    "π": "write pi",
    "pi": "write pi",
    "e": "write exp(x) for e^x, exp(1) for e",
    **dict.fromkeys(("deg", "degree", "degrees"), f"write pi/180: {RADIANS}"),
    **dict.fromkeys(("inf", "infinity", "nan"), "every number is finite"),
    **dict.fromkeys(
        ("free", "guess", "auto"), "a value to be solved is written {guess: 0}"
    ),
    **dict.fromkeys(("none", "true", "false"), "write a number, such as 0"),
}
_COMBINING = {"\u0307": "_dot", "\u0308": "_ddot"}
SPEEDS = ("v", "w", "ω", "omega", "vel", "velocity", "speed", "dt")


# What is written in a relation for signs of other languages.
IN_RELATIONS = {
    "==": "write `=`, one alone",
    **dict.fromkeys("≈≡→≃", "write `=`"),
    "!=": "a relation is written with `=`, `>=` or `<=`",
    "<>": "a relation is written with `=`, `>=` or `<=`",
}


def without_guesses(hint: str, token: str, known: Collection[str]) -> str:
    """Give a hint of the parser, if what it says of a name holds here."""
    product = hint.startswith("there is no implicit product")
    if product and re.match(r"[^\W\d]", token) and not _is_known(token, known):
        return f"an operator is expected before a name, and `{token}` is none here"
    return "" if token == "," else hint


def of_text(
    text: str, offset: int, known: Collection[str], *, beside: bool = False
) -> str:
    """Give a hint for an expression with a fault at `offset`, or an empty text.

    Parameters
    ----------
    known
        The variables of the file.
    beside
        It is the value of a parameter or a definition: a unit may stand beside it.
    """
    first = max(0, offset - WINDOW)
    whole, text, offset = text, text[first : offset + WINDOW], offset - first
    if text == whole and (hint := _of_number(text, known, beside=beside)):
        return hint
    if hint := quantities.separated_around(text, offset):
        return hint
    if "\\" in text and text == whole:
        return f"write {latex(text)}"
    hint = _matching(PATTERNS, text, offset, known) or _of_unit(
        text, offset, known, beside=beside and text == whole
    )
    return re.sub(r"[^\W\d_]+", lambda word: _in_letters(word[0], known), hint)


def _in_letters(word: str, known: Collection[str]) -> str:
    """Give a Greek word by the variable that is called as it is."""
    return word if word.isascii() else _called_so(word, known) or word


def _matching(
    patterns: Iterable[tuple[re.Pattern[str], str | Callable[[re.Match[str]], str]]],
    text: str,
    offset: int,
    variables: Collection[str] = (),
) -> str:
    for pattern, meant in patterns:
        for found in pattern.finditer(text):
            if meant is call and found[1] in variables:
                continue
            if found.start() <= offset <= found.end():
                if not isinstance(meant, str):
                    return meant(found)
                return meant.format(*found.groups())
    return ""


def of_unknown(text: str, offset: int) -> str:
    """Give a hint for a name at `offset` that has a meaning with what is around it."""
    first = max(0, offset - WINDOW)
    return _matching(OF_NAMES, text[first : offset + WINDOW], offset - first)


def of_comparison(text: str, offset: int) -> str:
    """Give a hint for a comparison that stands as a number."""
    for pattern in (r"\(([^(),]+[<>][^(),]*)\)", rf"^({_SIDE}+[<>]=?{_SIDE}+)$"):
        for found in re.finditer(pattern, text[: offset + WINDOW]):
            if found.start() <= offset <= found.end():
                return f"write if({found[1].strip()}, 1, 0)"
    return ""


def _of_number(text: str, known: Collection[str], *, beside: bool) -> str:
    """Give a hint where the whole text is meant to be a number, with a unit or not."""
    plain = unicodedata.normalize("NFKC", text)
    if re.fullmatch(rf"\s*\d+{FRACTION}\d+\s*", plain):
        return f"write {plain.strip().replace(FRACTION, '/')}"
    quantity = _QUANTITY.fullmatch(text)
    if quantity is None or not quantity[2] or _is_spelt(text):
        return ""
    number, unit = quantity[1].replace(" ", ""), quantity[2]
    unit += ")" * (unit.count("(") > unit.count(")"))
    names = quantities.words(quantities.unit(unit))
    product = all(_is_known(name, known) for name in names)
    parted = _WORD.sub(lambda w: "*".join(_parts(w[0], known)) or w[0], unit)
    if parted != unit and not product and not quantities.is_unit(unit):
        return f"write {number}*{parted}"
    if product and not quantities.is_unit(unit):
        return ""
    hint = quantities.quantity(number, unit, beside=beside)
    if product and unit not in FUNCTIONS:
        product_of = f"{number}*{quantities.unit(unit)}"
        return f"{hint}; a product is written {product_of}"
    return hint if quantities.is_unit(unit) or len(names) == 1 else ""


def _of_unit(text: str, offset: int, known: Collection[str], *, beside: bool) -> str:
    """Give a hint where a unit follows what is no plain number, as in `1/2 kg`."""
    before, unit = text[:offset].strip(), text[offset:]
    names = quantities.words(before)
    inside = before.count("(") > before.count(")")
    if not before or inside or not quantities.is_unit(unit):
        return ""
    if not all(_is_known(name, known) for name in names):
        return ""
    if names and names[-1] in FUNCTIONS and before.endswith(names[-1]):
        return ""
    if all(_is_known(name, known) for name in quantities.words(unit)):
        return ""
    return quantities.quantity(before, unit, beside=beside)


def _is_spelt(text: str) -> bool:
    """Tell whether it is a number in one of the spellings: degrees, powers of 10."""
    return any(pattern.search(text) for pattern, _ in PATTERNS[:OF_NUMBERS])


def _is_known(name: str, known: Collection[str]) -> bool:
    base = name.removesuffix("_ddot").removesuffix("_dot")
    return base in known or name in ("pi", "t") or name in FUNCTIONS


def of_function(name: str, argument: str, known: Collection[str]) -> str:
    """Give a hint for a function that there is not, called with an argument."""
    if found := spellings.function(name):
        return f"write {found}({argument})"
    if meant := spellings.rewritten(name, argument):
        return f"write {meant}"
    if _is_known(name, known) or name.casefold() in _NUMBERS:
        if argument in ("", "t"):
            plain = name if name in known else name.casefold()
            return f"write {plain}, without `({argument})`"
        return f"a product is written {name}*({argument})"
    for function in FUNCTIONS:
        factor = name.removesuffix(function)
        if factor != name and _is_known(factor, known):
            return f"write {factor}*{function}({argument})"
    base = name.rstrip("0123456789")
    if base != name and base in FUNCTIONS:
        return f"write {base}({argument})^{name.removeprefix(base)}"
    return ""


def of_name(name: str, known: Collection[str], moving: Collection[str]) -> str:
    """Give a hint for a name that means nothing.

    Parameters
    ----------
    known
        The variables of the file.
    moving
        Those that have rates.
    """
    if name.casefold() in _NUMBERS:
        return _NUMBERS[name.casefold()]
    if len(name) > WINDOW:
        return ""
    if rate := rate_of(name, moving):
        return f"the {_ordinal(rate)}rate is written {rate}"
    if name.casefold() == "time" and moving:
        return "the time is `t`"
    if name in SPEEDS and moving:
        rate = f"a rate is written {next(iter(moving))}_dot"
        return f"{rate}; what is given has its value in `parameters`"
    for function in FUNCTIONS:
        rest = name.removeprefix(function)
        if rest == name:
            continue
        factor = re.match(r"\d*", rest)
        assert factor is not None
        inside = _called_so(rest[factor.end() :], known)
        if inside:
            times = f"{factor[0]}*" if factor[0] else ""
            return f"write {function}({times}{inside})"
    base = name.rstrip("23456789")
    if len(name) - len(base) == 1 and _is_known(base, known) and base != "t":
        return f"a power is written {base}^{name.removeprefix(base)}"
    return ""


def _called_so(name: str, known: Collection[str]) -> str:
    """Give the variable of this name, Greek letters or theirs; or an empty text."""
    if _is_known(name, known):
        return name
    plain = spelt_out(name)
    return next((other for other in known if name and spelt_out(other) == plain), "")


def of_several(name: str, known: Collection[str]) -> str:
    """Give a hint for a name that is two or more variables, side by side."""
    parts = _parts(name, known)
    return f"a product is written {'*'.join(parts)}" if parts else ""


def _parts(name: str, known: Collection[str]) -> list[str]:
    """Give the variables, two or more, of whose names a name is made; or none."""
    if 1 < len(known) <= MOST_PARTS and len(name) <= WINDOW:
        several = sorted(map(re.escape, known), key=len, reverse=True)
        one = f"(?:{'|'.join(several)})(?:_dot)?"
        parts = re.findall(one, name)
        if re.fullmatch(f"(?:{one}){{2,4}}", name) and len(set(parts)) == len(parts):
            return parts
    return []


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
            match = re.fullmatch(pattern, name, re.IGNORECASE)
            if match and match[1] in moving:
                return match[1] + ending
    return ""


def rate_within(text: str, moving: Collection[str]) -> str:
    """Give the rate that a text is, spelt as elsewhere: `d/dt x`; or an empty text."""
    text = text[:WINDOW]
    plain = latex(text) if "\\" in text else ""
    hint = f"the rate is written {plain}" if plain else _matching(PATTERNS, text, 0)
    found = re.fullmatch(r"the (?:second )?rate is written ((.+)_dd?ot)", hint)
    return found[1] if found and found[2] in moving else ""


def spelt_out(name: str) -> str:
    """Give a name in small letters, with Greek ones by their names: theta for θ."""
    letters = name if name.isascii() else "".join(_spelt_out(c) for c in name)
    return letters.casefold()


def _spelt_out(letter: str) -> str:
    full = unicodedata.name(letter, "")
    return full.split()[-1] if full.startswith("GREEK ") else letter
