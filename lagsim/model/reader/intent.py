"""What was likely meant by a text that is none of the expression language.

Spellings of other languages, of textbooks and of pocket calculators; loaded only where
there is a fault.
"""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING

from lagsim.language.functions import FUNCTIONS
from lagsim.model.reader import spellings
from lagsim.model.reader.spellings import CALLED, MODULES, NUMBER, RADIANS, RATES

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

# What is meant shows within so many letters of a fault; patterns that are tried at each
# of a million would take for ever.
WINDOW = 100
# Names that are tried as parts of a longer one.
MOST_PARTS = 200

_ARGUMENT = rf"(?:{NUMBER}\s*\*\s*)?(?:[^\W\d]\w*|{NUMBER})"
_POWER = r"(?:\^|\*\*)\s*(\d+)"
_INVERSE = r"(?:\^|\*\*)\s*(?:-1|\(\s*-1\s*\))"
_NAME = r"([^\W\d_]\w*)"
_EXACT = "in `if` numbers are compared by <, <=, > and >="


def _from_module(found: re.Match[str]) -> str:
    name = found[1]
    if known := spellings.function(name):
        return f"write `{known}`, without a module"
    if other := spellings.rewritten(name):
        return f"write {other}"
    plain = {"e": "exp(1)", "inf": "", "nan": ""}.get(name, f"`{name}`")
    return f"write {plain}, without a module" if plain else "every number is finite"


def _call(found: re.Match[str]) -> str:
    return f"write {spellings.call(found[1], found[2])}"


def _power_of_call(found: re.Match[str]) -> str:
    name, power, *argument = found.groups()
    power = {"²": "2", "³": "3"}.get(power, power)
    inside = argument[0] if argument and argument[0] else "..."
    return f"write {spellings.call(name, inside)}^{power}"


def _inverse(found: re.Match[str]) -> str:
    name = f"a{found[1]}"
    return f"write {name}(...)" if name in FUNCTIONS else f"write 1/{found[1]}(...)"


# Each is looked for around the fault: what is matched, and what to write instead.
_SPELLINGS: list[tuple[str, str | Callable[[re.Match[str]], str]]] = [
    (rf"({NUMBER})\s*(?:[°º]|deg(?:rees?)?\b)", f"write {{0}}*pi/180: {RADIANS}"),
    (r"\s(?:rad|radians?)\s*$", f"leave the unit out: {RADIANS}"),
    (rf"({NUMBER})\s*π", "write {0}*pi"),
    (rf"({NUMBER})\s*%\s*$", "write {0}/100"),
    (
        rf"({NUMBER})\s*[xX×·]\s*10\s*(?:\^|\*\*)\s*([-+]?\d+)",
        "write {0}e{1}",
    ),
    (r"\b\d+\.\d*\.\d", "a number has one decimal point"),
    (r"\b0[xXbBoO]\w+", "numbers are decimal"),
    (r"(\d+\.?\d*)[eE](?![\w+-])", "an exponent has digits: {0}e0"),
    (r"\d:\d\d", "a time is one number, such as 90 for 1:30"),
    (r"∞|\binf\b", "every number is finite"),
    (r"\bE\s*(?:\^|\*\*)", "write exp(x) for e^x"),
    (r"^\s*(?:if\s+)?(.+?)\s+if\s+(.+?)\s+else\s+(.+)$", "write if({1}, {0}, {2})"),
    (r"^\s*if\s+(.+?)\s+then\s+(.+?)\s+else\s+(.+)$", "write if({0}, {1}, {2})"),
    (r"^\s*(.+?)\s*\?\s*(.+?)\s*:\s*(.+)$", "write if({0}, {1}, {2})"),
    (r":=", "write `=`"),
    (r"(\d)\s*([-+])\s*[eE](\d+)\b", "write {0}e{1}{2}"),
    (r"\bif\s+[^(\s]", "write if(condition, a, b)"),
    (r"=<", "write `<=`"),
    (r"=>", "write `>=`"),
    (r"\bif\s*\([^()<>]*?(?:==|!=|=)", _EXACT),
    (rf"\b({CALLED})\s*{_POWER}\s*\(([^()]*)\)", _power_of_call),
    (rf"\b({CALLED})\s*{_POWER}\s+({_ARGUMENT})", _power_of_call),
    (rf"\b({CALLED})\s*([²³])\s*\(([^()]*)\)", _power_of_call),
    (rf"\b({CALLED})\s*([²³])\s*({_ARGUMENT})?", _power_of_call),
    (rf"\b(sinh?|cosh?|tanh?)\s*{_INVERSE}", _inverse),
    (rf"\b({CALLED})\s*{_POWER}", _power_of_call),
    (rf"\b({CALLED})\s*[\[{{]([^\]}}]*)[\]}}]", _call),
    (rf"\b({CALLED})\s+({_ARGUMENT})", _call),
    (rf"\b(?:{MODULES})(?:\.|::)(\w+)", _from_module),
    (
        rf"\b(?:{'|'.join(RATES)})\(\s*{_NAME}\s*(?:,\s*t\s*)?\)",
        "the rate is written {0}_dot",
    ),
    (rf"\bd(?:\^|\*\*)?2\s*{_NAME}\s*/\s*d\s*t", "the second rate is written {0}_ddot"),
    (rf"\bd\s*\(?{_NAME}\)?\s*/\s*dt\b", "the rate is written {0}_dot"),
    (rf"\\ddot\s*\{{?\s*\\?{_NAME}", "the second rate is written {0}_ddot"),
    (rf"\\dot\s*\{{?\s*\\?{_NAME}", "the rate is written {0}_dot"),
    (rf"{_NAME}\u0308", "the second rate is written {0}_ddot"),
    (rf"{_NAME}\u0307", "the rate is written {0}_dot"),
    (rf"{_NAME}''", "the second rate is written {0}_ddot"),
    (rf"{_NAME}'", "the rate is written {0}_dot"),
    (rf"{_NAME}\s*[.\s-]\s*dot\b", "the rate is written {0}_dot"),
    (r"\|([^|]+)\|", "write abs({0})"),
    (r"√\s*\(([^()]*)\)", "write sqrt({0})"),
    (r"√\s*(\w+)", "write sqrt({0})"),
    (r"∛\s*\(?(\w+)\)?", "write cbrt({0})"),
    (r"\\d?frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}", "write ({0})/({1})"),
    (r"\\sqrt\s*\{([^{}]*)\}", "write sqrt({0})"),
    (r"\\(?:cdot|times)", "write `*`"),
    (r"\\(?:left|right|,|;|!)", "leave it out: this is no LaTeX"),
    (r"\\(\w+)", "write {0}, without `\\`"),
    (r"\$", "write the expression without `$`"),
    (r"\^\{([^{}]*)\}", "write ^({0})"),
    (r"[\w)]\s*!(?!=)", "there is no factorial"),
    (r"([\w.]+)\s*//\s*([\w.]+)", "write floor({0}/{1})"),
    (r"[⋅∙•∗]", "write `*`"),
    (r"\w\([^()]*;", "arguments are separated by `,`"),
    (
        r"\b(min|max|hypot)\(([^(),]+),\s*([^(),]+),\s*([^(),]+)\)",
        "write {0}({1}, {0}({2}, {3}))",
    ),
    (r"\batan\(([^(),]+),\s*([^(),]+)\)", "write atan2({0}, {1})"),
    (r"\blog\(([^(),]+),\s*([^(),]+)\)", "write log({0})/log({1})"),
]
# The first of them are of numbers.
_OF_NUMBERS = 8
_PATTERNS = [(re.compile(pattern), meant) for pattern, meant in _SPELLINGS]
_QUANTITY = re.compile(
    rf"\s*([-+]?\s*{NUMBER})\s*[\[(]?([^\W\d_][\w*/^·⋅.()\s-]*?|)[\])]?\s*\.?\s*"
)
_THOUSANDS = re.compile(r"\b\d{1,3}(?:[ '\u00a0\u202f]\d{3})+\b")
_FRACTION = "\N{FRACTION SLASH}"

_SECOND_RATES = [
    r"dd_?(.+)", r"d2_?(.+?)(?:_?dt2)?", r"(.+?)_?ddot", r"(.+)_dotdot", r"ddot_?(.+)",
    r"(.+)_dd", r"(.+)''",
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
    **dict.fromkeys(("free", "guess"), "a value to be solved is written {guess: 0}"),
    **dict.fromkeys(("none", "true", "false"), "write a number, such as 0"),
}
_COMBINING = {"\u0307": "_dot", "\u0308": "_ddot"}
_SPEEDS = ("v", "w", "ω", "omega", "vel", "velocity", "speed", "dt")


def of_text(text: str, offset: int, known: Collection[str]) -> str:
    """Give a hint for an expression with a fault at `offset`, or an empty text.

    Parameters
    ----------
    known
        The variables of the file.
    """
    first = max(0, offset - WINDOW)
    whole, text, offset = text, text[first : offset + WINDOW], offset - first
    if text == whole and (hint := _of_number(text, known)):
        return hint
    for pattern, meant in _PATTERNS:
        for found in pattern.finditer(text):
            if found.start() <= offset <= found.end():
                if not isinstance(meant, str):
                    return meant(found)
                return meant.format(*found.groups())
    return ""


def _of_number(text: str, known: Collection[str]) -> str:
    """Give a hint where the whole text is meant to be a number, with a unit or not."""
    if thousands := _THOUSANDS.fullmatch(text.strip()):
        return f"write {re.sub(r'[^0-9]', '', thousands[0])}"
    if _FRACTION in unicodedata.normalize("NFKC", text):
        plain = unicodedata.normalize("NFKC", text).replace(_FRACTION, "/")
        return f"write {plain}"
    quantity = _QUANTITY.fullmatch(text)
    if quantity is None or not quantity[2] or _is_spelt(text):
        return ""
    number, unit = quantity[1].replace(" ", ""), quantity[2]
    names = spellings.words(spellings.unit(unit))
    product = all(_is_known(name, known) for name in names)
    if product and not spellings.is_unit(unit):
        return ""
    hint = spellings.quantity(number, unit)
    if product and unit not in FUNCTIONS:
        beside = f"{{value: {number}, unit: {spellings.unit(unit)}}}"
        product_of = f"{number}*{spellings.unit(unit)}"
        return f"a product is written {product_of}; a unit stands beside: {beside}"
    return hint if spellings.is_unit(unit) or len(names) == 1 else ""


def _is_spelt(text: str) -> bool:
    """Tell whether it is a number in one of the spellings: degrees, powers of 10."""
    return any(pattern.search(text) for pattern, _ in _PATTERNS[:_OF_NUMBERS])


def _is_known(name: str, known: Collection[str]) -> bool:
    base = name.removesuffix("_ddot").removesuffix("_dot")
    return base in known or name in ("pi", "t") or name in FUNCTIONS


def of_function(name: str, argument: str, known: Collection[str]) -> str:
    """Give a hint for a function that there is not, called with an argument."""
    if found := spellings.function(name):
        arguments = {1: "x", 3: "condition, a, b"}.get(FUNCTIONS[found].arity, "a, b")
        return f"write {found}({'y, x' if found == 'atan2' else arguments})"
    if spellings.rewritten(name):
        return f"write {spellings.rewritten(name)}"
    if _is_known(name, known):
        if argument == "t":
            return f"write {name}, without `(t)`"
        return f"a product is written {name}*(...)"
    base = name.rstrip("0123456789")
    if base != name and base in FUNCTIONS:
        return f"write {base}(...)^{name.removeprefix(base)}"
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
    if name in _SPEEDS and moving:
        return f"a rate is written {next(iter(moving))}_dot"
    for function in FUNCTIONS:
        rest = name.removeprefix(function)
        if rest != name and _is_known(rest, known):
            return f"write {function}({rest})"
    base = name.rstrip("0123456789")
    if base != name and _is_known(base, known):
        return f"a power is written {base}^{name.removeprefix(base)}"
    return ""


def of_several(name: str, known: Collection[str]) -> str:
    """Give a hint for a name that is two or more variables, side by side."""
    if 1 < len(known) <= MOST_PARTS and len(name) <= WINDOW:
        several = sorted(map(re.escape, known), key=len, reverse=True)
        one = f"(?:{'|'.join(several)})(?:_dot)?"
        parts = re.findall(one, name)
        if re.fullmatch(f"(?:{one}){{2,4}}", name) and len(set(parts)) == len(parts):
            return f"a product is written {'*'.join(parts)}"
    return ""


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


def spelt_out(name: str) -> str:
    """Give a name in small letters, with Greek ones by their names: theta for θ."""
    return "".join(_spelt_out(c) for c in name).casefold()


def _spelt_out(letter: str) -> str:
    full = unicodedata.name(letter, "")
    return full.split()[-1] if full.startswith("GREEK ") else letter
