"""How expressions are written elsewhere, and how they are written here: a table.

Spellings of other languages, of textbooks and of pocket calculators.
"""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING

from lagsim.language.functions import FUNCTIONS
from lagsim.model.reader import spellings
from lagsim.model.reader.quantities import NUMBER
from lagsim.model.reader.spellings import CALLED, MODULES, RADIANS, RATES

if TYPE_CHECKING:
    from collections.abc import Callable

FRACTION = "\N{FRACTION SLASH}"
MINUS = "\N{MINUS SIGN}"
_ARGUMENT = rf"(?:{NUMBER}\s*\*\s*)?(?:[^\W\d]\w*|{NUMBER})"
_POWER = r"(?:\^|\*\*)\s*(\d+)"
# What stands in parentheses, with others in it.
_INSIDE = r"((?:[^()]|\([^()]*\))*)"
_INVERSE = r"(?:(?:\^|\*\*)\s*(?:-1|\(\s*-1\s*\))|⁻¹)"
_NAME = r"([^\W\d_]\w*)"
_MADE_OF = r"(?:self|params?|parameters|p|definitions|coordinates|states?|constants)"
_EXACT = "numbers are compared by <, <=, > and >="
_TERM = r"[\w.]+(?:\s*[-+*/^]\s*[\w.]+)*"
# What may be raised to a power, or be one.
_ATOM = r"(?:[\w.]+\([^()]*\)|\([^()]*\)|[\w.]+)"


_SECOND_QUOTIENT = (
    rf"(?:\bd|∂)(?:(?:\^|\*\*)?2|²)\s*{_NAME}\s*/\s*[d∂]\s*t(?:(?:\^|\*\*)?2|²)?"
)
_PER_MINUTE = rf"({NUMBER})(?:\s+1)?\s*/\s*min\b(?!\s*\()"
_QUOTIENT = rf"(?:\bd|∂)\s*\(?{_NAME}\)?\s*/\s*[d∂]t\b"


def _from_module(found: re.Match[str]) -> str:
    name = found[1]
    if known := spellings.function(name):
        return f"write `{known}`, without a module"
    if other := spellings.rewritten(name, found[2] or ""):
        return f"write {other}"
    plain = {"e": "exp(1)", "pi": "`pi`"}.get(name)
    if name in ("inf", "nan"):
        return "every number is finite"
    return f"write {plain}, without a module" if plain else ""


def call(found: re.Match[str]) -> str:
    """Say how a function is called: its name, and its argument."""
    return f"write {spellings.call(found[1], found[2])}"


def _power_of_call(found: re.Match[str]) -> str:
    name, power, *argument = found.groups()
    power = {"²": "2", "³": "3"}.get(power, power)
    inside = argument[0] if argument and argument[0] else "..."
    call = spellings.call(name, inside)
    return f"write {call if call[-1] == ')' else f'({call})'}^{power}"


def _inverse(found: re.Match[str]) -> str:
    inside = found[2] or found[3] or "..."
    return f"write a{found[1]}({inside})"


def latex(text: str) -> str:
    """Give what is written here for an expression of LaTeX."""
    for pattern, plain in _LATEX:
        text = re.sub(pattern, plain, text)
    return text.strip()


def _exponential(found: re.Match[str]) -> str:
    return f"write exp({found[1].removeprefix('(').removesuffix(')')})"


def _compared(found: re.Match[str]) -> str:
    left, sign, right = (part.strip() for part in found.groups())
    if sign in ("!=", "<>", "≠"):
        return f"write ({left} < {right} or {left} > {right}): {_EXACT}"
    return f"write ({left} >= {right} and {left} <= {right}): {_EXACT}"


def _fractions(found: re.Match[str]) -> str:
    text = unicodedata.normalize("NFKC", found[0]).replace(FRACTION, "/")
    power = "^" if found[0][0] in "⁺⁻" else ""
    return f"write {power}({text.replace(MINUS, '-')})"


# Each is looked for around the fault: what is matched, and what to write instead.
_SPELLINGS: list[tuple[str, str | Callable[[re.Match[str]], str]]] = [
    (rf"({NUMBER})\s*π", "write {0}*pi"),
    (rf"({NUMBER})\s*%\s*$", "write {0}/100"),
    (r"\b(\d+\.\d*)[fF]\b", "write {0}"),
    (r"\b\d+\.?\d*[ij]\b", "every number is real"),
    (r"(\d+\.?\d*)[eE]([-+]?\d*\.\d+)", "write {0}*10^{1}"),
    (
        rf"({NUMBER})\s*[xX×·]\s*10\s*(?:\^|\*\*)\s*([-+]?\d+)",
        "write {0}e{1}",
    ),
    (r"\b\d+\.\d*\.\d", "a number has one decimal point"),
    (r"\b0[xXbBoO]\w+", "numbers are decimal"),
    (r"(\d+\.?\d*)[dD]([-+]?\d+)\b", "write {0}e{1}"),
    (r"(\d+\.?\d*)[eE](?![\w+-])", "write {0}e0: an exponent has digits"),
    (r"\d:\d\d", "a time is one number, such as 90 for 1:30"),
    (r"∞|\binf\b", "every number is finite"),
    (rf"({NUMBER})\s*(?:[°º]|deg(?:rees?)?\b)", f"write {{0}}*pi/180: {RADIANS}"),
    (rf"{_NAME}\s*[°º]", f"write {{0}}*pi/180: {RADIANS}"),
    (_PER_MINUTE, "write {0}*2*pi/60: rates are in rad/s"),
    (r",\s*$", "leave `,` out"),
    (r"\w\[\d*\]", "there are no indices: each has a name of its own"),
    (rf"\b[eE]\s*(?:\^|\*\*)\s*(-?\s*{_ATOM})", _exponential),
    (rf"\bexp\s*(?:\^|\*\*)\s*(-?\s*{_ATOM})", _exponential),
    (r"[¼-¾⅐-⅞]", _fractions),
    (r"^\s*(?:if\s+)?(.+?)\s+if\s+(.+?)\s+else\s+(.+)$", "write if({1}, {0}, {2})"),
    (r"^\s*if\s+(.+?)\s+then\s+(.+?)\s+else\s+(.+)$", "write if({0}, {1}, {2})"),
    (r"^\s*(.+?)\s*\?\s*(.+?)\s*:\s*(.+)$", "write if({0}, {1}, {2})"),
    (r":=", "write `=`"),
    (r"(\d)\s*([-+])\s*[eE](\d+)\b", "write {0}e{1}{2}"),
    (r"^\s*(.+?)\s+(?:when|where|if)\s+(.+)$", "write if({1}, {0}, 0)"),
    (r"\bif\s+[^(\s]", "write if(condition, a, b)"),
    (r"=<", "write `<=` for `=<`"),
    (r"=>", "write `>=` for `=>`"),
    (rf"({_TERM})\s*(==|!=|<>|≠)\s*({_TERM})", _compared),
    (rf"(?<=\bif\()\s*({_TERM})\s*(=)\s*({_TERM})", _compared),
    (r"([\w.]+)\s+(?:mod|rem)\s+([\w.]+)", "write {0} - {1}*floor({0}/{1})"),
    (r"([\w.]+)\s*%\s*([\w.]+)", "write {0} - {1}*floor({0}/{1})"),
    (r"([\w.]+)\s+div\s+([\w.]+)", "write floor({0}/{1})"),
    (rf"\b({CALLED})\s*{_POWER}\s*\({_INSIDE}\)", _power_of_call),
    (rf"\b({CALLED})\s*{_POWER}\s+({_ARGUMENT})", _power_of_call),
    (rf"\b({CALLED})\s*([²³])\s*\({_INSIDE}\)", _power_of_call),
    (rf"\b({CALLED})\s*([²³])\s*({_ARGUMENT})?", _power_of_call),
    (
        rf"\b(sinh?|cosh?|tanh?)\s*{_INVERSE}\s*(?:\({_INSIDE}\)|({_ARGUMENT}))?",
        _inverse,
    ),
    (rf"\b((?i:{CALLED}))\s*[\[{{]([^\]}}]*)[\]}}]", call),
    (rf"\b((?i:{CALLED}))\s+({_ARGUMENT})", call),
    (rf"\b(?:{MODULES})(?:\.|::)(\w+)(?:\(([^()]*)\))?", _from_module),
    (
        rf"\b(?:{'|'.join(RATES)})\(\s*{_NAME}\s*(?:,\s*t\s*)?\)",
        "the rate is written {0}_dot",
    ),
    (_SECOND_QUOTIENT, "the second rate is written {0}_ddot"),
    (_QUOTIENT, "the rate is written {0}_dot"),
    (
        rf"\bd\s*/\s*dt\s*(?:\(\s*(?=\w+\s*\)))?{_NAME}(?:\s*\))?",
        "the rate is written {0}_dot",
    ),
    (
        rf"\b(?:d\s*/\s*dt|{'|'.join(RATES)})\s*\(\s*([^(),]+?)\s*(?:,\s*t\s*)?\)",
        "write r_dot, with `r: {0}` in `definitions`",
    ),
    (rf"\bdot\s+{_NAME}", "the rate is written {0}_dot"),
    (rf"{_NAME}\u0308", "the second rate is written {0}_ddot"),
    (rf"{_NAME}\u0307", "the rate is written {0}_dot"),
    (rf"{_NAME}(?:''|″|′′|’’)", "the second rate is written {0}_ddot"),
    (rf"{_NAME}['′’]", "the rate is written {0}_dot"),
    (rf"{_NAME}\s*[.\s-]\s*ddot\b", "the second rate is written {0}_ddot"),
    (rf"{_NAME}\[t\]", "write {0}, without `[t]`"),
    (
        rf"{_NAME}(?:\s*[.\s-]\s*dot\b|\.dt\b|\.diff\(\s*t\s*\))",
        "the rate is written {0}_dot",
    ),
    (rf"\b{_MADE_OF}\.{_NAME}", "write {0}, without the text before the dot"),
    (r"([⁺⁻][⁰¹²³⁴-⁹]+)", _fractions),
    (r"\|([^|]+)\|", "write abs({0})"),
    (rf"√\s*\({_INSIDE}\)", "write sqrt({0})"),
    (r"√\s*(\w+)", "write sqrt({0})"),
    (r"∛\s*\(?(\w+)\)?", "write cbrt({0})"),
    (r"\$", "write the expression without `$`"),
    (r"\^\{([^{}]*)\}", "write ^({0})"),
    (r"[\w)]\s*!(?!=)", "there is no factorial"),
    (
        r"([\w.]+)\s*//\s*([\w.]+)",
        "write floor({0}/{1}), or ` #` where a comment begins",
    ),
    (r"[≠]", f"write < or >: {_EXACT}"),
    (r"[“”„‘’‚]", "an expression contains no quotes"),
    (r"[\u200b-\u200f\u2060\ufeff]", "delete it: it is invisible"),
    (r"(?<!&)&(?!&)", "write `and`"),
    (r";\s*$", "leave `;` out"),
    (r"[⋅∙•∗]", "write `*`"),
    (r"\w\([^()]*;", "write `,` between arguments"),
    (
        r"\b(min|max|hypot)\(([^(),]+),\s*([^(),]+),\s*([^(),]+)\)",
        "write {0}({1}, {0}({2}, {3}))",
    ),
    (r"\batan\(([^(),]+),\s*([^(),]+)\)", "write atan2({0}, {1})"),
    (r"\batan2\(([^(),/]+)/([^(),/]+)\)", "write atan2({0}, {1})"),
    (r"\blog\(([^(),]+),\s*([^(),]+)\)", "write log({0})/log({1})"),
]
# What is written for LaTeX, one after the other.
_FUNCTION = rf"\\({'|'.join(sorted(FUNCTIONS, key=len, reverse=True))})\b"
_LATEX = [
    (r"\\(?:left|right|displaystyle|limits)\b|\\[,;:! ]", " "),
    (r"\\(?:cdot|times)\b", "*"),
    (r"\\(d?dot)\b\s*\{?\s*\\?([^\W\d_]\w*)\s*\}?", r"\2_\1 "),
    (r"_\{(\w+)\}", r"_\1"),
    (r"\^\{([^{}]*)\}", r"^(\1)"),
    (rf"{_FUNCTION}\s*\^\s*(\d)\s*\\?(\w+|\([^()]*\))", r"\1(\3)^\2"),
    (rf"{_FUNCTION}\s*\\?(\w+)", r"\1(\2)"),
    (r"\\sqrt\s*\{([^{}]*)\}", r"sqrt(\1)"),
    (r"\\[dt]?frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}", r"(\1)/(\2)"),
    (r"\\(?:var)?([^\W\d_]+)", r" \1"),
    (r"(?<=[\w)])\s+(?=[\w(])|(?<=\))(?=[\w(])", "*"),
    (r"\s+", ""),
    (r"([-+=<>]+)", r" \1 "),
]
# The first of them are of numbers.
OF_NUMBERS = 10
PATTERNS = [(re.compile(pattern), meant) for pattern, meant in _SPELLINGS]
# What parses as an expression and is meant otherwise.
OF_NAMES = [
    (re.compile(pattern), meant)
    for pattern, meant in _SPELLINGS
    if meant is _exponential or pattern in (_SECOND_QUOTIENT, _QUOTIENT, _PER_MINUTE)
]
