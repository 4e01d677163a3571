"""Hints: what was likely meant by an expression, a name or a key that is none here.

Spellings of other languages, of textbooks and of pocket calculators. Patterns are
compiled where a file has a fault: they are many.
"""

from __future__ import annotations

import functools
import re
import unicodedata
from typing import TYPE_CHECKING, TypeVar

from lagsim.language.functions import FUNCTIONS
from lagsim.model.nodes import Mapping, Scalar, Sequence, items_of, texts_of
from lagsim.model.reader import quantities
from lagsim.model.reader.quantities import NUMBER

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from lagsim.language.parser import ExpressionError
    from lagsim.model.nodes import Entry, Node

    Meant = str | Callable[[re.Match[str]], str]

_T = TypeVar("_T")


def _by_word(table: dict[str, _T]) -> dict[str, _T]:
    """Give a table by single words, of one whose keys are several."""
    return {word: row for words, row in table.items() for word in words.split()}


RADIANS = "angles are in radians"

# Functions, and their names elsewhere, in small letters.
_NAMES = {
    "log": "ln", "log10": "lg", "asin": "arcsin", "acos": "arccos",
    "atan": "arctan arctg", "atan2": "arctan2", "asinh": "arcsinh arsinh",
    "acosh": "arccosh arcosh", "atanh": "arctanh artanh", "tan": "tg", "sinh": "sh",
    "cosh": "ch", "tanh": "th", "sign": "sgn signum", "abs": "fabs",
    "max": "maximum fmax", "min": "minimum fmin", "heaviside": "h step unitstep",
    "ceil": "ceiling",
}  # fmt: skip
_RENAMED = {name: own for own, names in _NAMES.items() for name in names.split()}
# Functions that are written with others: their arguments, and how.
_REWRITTEN = _by_word(
    {
        "log2": ("x", "log(x)/log(2)"), "log1p": ("x", "log(1 + x)"),
        "expm1": ("x", "exp(x) - 1"), "exp2": ("x", "2^x"), "exp10": ("x", "10^x"),
        "pow power": ("a b", "a^b"), "square sqr": ("x", "x^2"), "cube": ("x", "x^3"),
        "rational": ("a b", "(a/b)"), "root": ("x n", "x^(1/n)"),
        "sec": ("x", "1/cos(x)"), "csc": ("x", "1/sin(x)"),
        **{f"{of}d": ("x", f"{of}(x*pi/180)") for of in ("sin", "cos", "tan")},
        **{f"a{of}d": ("x", f"a{of}(x)*180/pi") for of in ("sin", "cos", "tan")},
        "cot ctg cotan": ("x", "1/tan(x)"), "acot arccot": ("x", "atan2(1, x)"),
        "mod fmod rem": ("x y", "x - y*floor(x/y)"), "round": ("x", "floor(x + 0.5)"),
        "int trunc fix": ("x", "sign(x)*floor(abs(x))"),
        "clip clamp": ("x a b", "max(a, min(x, b))"), "norm": ("x y", "hypot(x, y)"),
        "where ifelse iif ite cond piecewise": ("condition a b", "if(condition, a, b)"),
        "deg2rad radians rad deg": ("x", f"x*pi/180: {RADIANS}"),
        "rad2deg degrees": ("x", "x*180/pi"),
    }
)  # fmt: skip
# Keys of the file, the likelier first, and how they are called elsewhere, in small
# letters.
_KEYS = {
    "parameters": "constants params consts given",
    "coordinates columns": "variables vars dof dofs generalized_coordinates q states",
    "definitions": "define functions expressions positions kinematics",
    "forces": "loads generalized_forces applied_forces",
    "simulation": "sim solve integration solver_options",
    "scene": "graphics drawing draw visualization animation geometry",
    "plots": "plot figures charts",
    "initial": "initial_conditions initial_state initial_values ic ics init x0",
    "kinetic duration": "t ke ekin kinetic_energy",
    "potential": "v u pe epot potential_energy",
    "lagrangian": "l lagrange lagrange_function",
    "dissipation": "d r rayleigh friction", "forces dissipation": "damping",
    "duration": "time tmax t_max length",
    "end": ("t_end tend tf t1 to tstop t_stop t_final tfinal final final_time "
        "stop_time end_time finish till"),
    "start": "t0 t_start tstart start_time begin from",
    "output_step step": "dt timestep time_step sampling dt_out", "step": "h max_step",
    "until end": "stop stop_when stop_condition event events terminate",
    "rtol": "tol tolerance reltol precision", "atol": "abstol",
    "method": "solver integrator scheme", "unit": "units dimension",
    "description title": "label", "description": "help comment text title desc",
    "dynamic": "kinetic sliding", "value": "default val",
    "relation value": "eq equation expression expr contact condition law",
    "friction": "mu", "restitution": "e bounce cor restitution_coefficient",
    "links": "lines rods edges bars", "points": "masses bodies",
}  # fmt: skip
KEYS = {name: keys.split() for keys, names in _KEYS.items() for name in names.split()}
# Keys of counts, where a length is asked for here: no key has their values.
COUNTS = (
    "n", "steps", "nsteps", "n_steps", "num_steps", "number_of_steps", "output_steps",
    "samples", "points", "rows", "fps", "frames",
)  # fmt: skip
# Keys of two times.
SPANS = ("tspan", "t_span", "time_span", "t_range", "interval")
# What gives a rate, of its first argument.
_RATES_OF = "(?i:d|der|deriv|derivative|diff|dot)"
# Every name that stands for a function somewhere, the longest first.
CALLED = "|".join(
    sorted((*FUNCTIONS, *_RENAMED, *_REWRITTEN), key=lambda name: -len(name))
)
MODULES = "np|numpy|jnp|math|Math|cmath|sp|sympy|torch|std"


def known_function(name: str) -> str:
    """Give the name that a function has here, or an empty text."""
    found = _RENAMED.get(name.casefold(), name.casefold())
    return found if found in FUNCTIONS else ""


def rewritten(name: str, arguments: str) -> str:
    """Give what is written for a function that is known elsewhere, or nothing."""
    names, text = _REWRITTEN.get(name.casefold(), ("", ""))
    given = [part.strip() for part in arguments.split(",")] if arguments else []
    places = names.split()
    if given and len(given) == len(places):
        inside = {
            place: argument if re.fullmatch(r"[\w.]+", argument) else f"({argument})"
            for place, argument in zip(places, given, strict=True)
        }
        text = re.sub(rf"\b(?:{'|'.join(places)})\b", lambda m: inside[m[0]], text)
    return text


def spelt_call(name: str, arguments: str) -> str:
    """Give a call with the name that the function has here, or nothing."""
    known = known_function(name)
    return f"{known}({arguments})" if known else rewritten(name, arguments)


# --- How expressions are written elsewhere, and how they are written here: a table

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
_RATE = "the rate is written {0}_dot"
_SECOND_RATE = "the second rate is written {0}_ddot"


def _from_module(found: re.Match[str]) -> str:
    name = found[1]
    plain = {"e": "exp(1)", "pi": "`pi`"}
    if known := known_function(name):
        return f"write `{known}`, without a module"
    if other := rewritten(name, found[2] or ""):
        return f"write {other}"
    if name in ("inf", "nan"):
        return "every number is finite"
    return f"write {plain[name]}, without a module" if name in plain else ""


def _call(found: re.Match[str]) -> str:
    """Say how a function is called: its name, and its argument."""
    return f"write {spelt_call(found[1], found[2])}"


def _power_of_call(found: re.Match[str]) -> str:
    name, power, argument = found.groups()
    base = spelt_call(name, argument or "...")
    power = {"²": "2", "³": "3"}.get(power, power)
    return f"write {base if base[-1] == ')' else f'({base})'}^{power}"


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
_SPELLINGS: list[tuple[str, Meant]] = [
    (rf"({NUMBER})\s*π", "write {0}*pi"),
    (rf"({NUMBER})\s*%\s*$", "write {0}/100"),
    (r"\b(\d+\.\d*)[fF]\b", "write {0}"),
    (r"\b\d+\.?\d*[ij]\b", "every number is real"),
    (r"(\d+\.?\d*)[eE]([-+]?\d*\.\d+)", "write {0}*10^{1}"),
    (rf"({NUMBER})\s*[xX×·]\s*10\s*(?:\^|\*\*)\s*([-+]?\d+)", "write {0}e{1}"),
    (r"\b\d+\.\d*\.\d", "a number has one decimal point"),
    (r"\b0[xXbBoO]\w+", "numbers are decimal"),
    (r"(\d+\.?\d*)[dD]([-+]?\d+)\b", "write {0}e{1}"),
    (r"(\d+\.?\d*[eE])\s*[−–]\s*(\d+)", "write {0}-{1}"),
    (r"(\d+\.?\d*)[eE](?![\w+-])", "write {0}e0: an exponent has digits"),
    (rf"({NUMBER})\s*(?:±|\+/?-).*", "write {0}"),
    (r"\d:\d\d", "a time is one number, such as 90 for 1:30"),
    (r"∞|\binf\b", "every number is finite"),
    (rf"({NUMBER})\s*(?:[°º]|deg(?:rees?)?\b)", f"write {{0}}*pi/180: {RADIANS}"),
    (rf"{_NAME}\s*[°º]", f"write {{0}}*pi/180: {RADIANS}"),
    (_PER_MINUTE, "write {0}*2*pi/60: rates are in rad/s"),
    (r",\s*$", "leave `,` out"),
    (r"\w\[\d*\]", "there are no indices: each has a name of its own"),
    (rf"\b(?:[eE]|exp)\s*(?:\^|\*\*)\s*(-?\s*{_ATOM})", _exponential),
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
    (r"([\w.]+)(?:\s+(?:mod|rem)\s+|\s*%\s*)([\w.]+)",
     "write {0} - {1}*floor({0}/{1})"),
    (r"([\w.]+)\s+div\s+([\w.]+)", "write floor({0}/{1})"),
    *(
        (rf"\b({CALLED})\s*{power}", _power_of_call)
        for power in (
            rf"{_POWER}\s*\({_INSIDE}\)",
            rf"{_POWER}\s+({_ARGUMENT})",
            rf"([²³])\s*\({_INSIDE}\)",
            rf"([²³])\s*({_ARGUMENT})?",
        )
    ),
    (rf"\b(sinh?|cosh?|tanh?)\s*{_INVERSE}\s*(?:\({_INSIDE}\)|({_ARGUMENT}))?",
     lambda found: f"write a{found[1]}({found[2] or found[3] or '...'})"),
    (rf"\b((?i:{CALLED}))\s*[\[{{]([^\]}}]*)[\]}}]", _call),
    (rf"\b((?i:{CALLED}))\s+({_ARGUMENT})", _call),
    (rf"\b(?:{MODULES})(?:\.|::)(\w+)(?:\(([^()]*)\))?", _from_module),
    (rf"\b(?:{_RATES_OF})\(\s*{_NAME}\s*(?:,\s*t\s*)?\)", _RATE),
    (_SECOND_QUOTIENT, _SECOND_RATE),
    (_QUOTIENT, _RATE),
    (rf"\bd\s*/\s*dt\s*(?:\(\s*(?=\w+\s*\)))?{_NAME}(?:\s*\))?", _RATE),
    (rf"\b(?:d\s*/\s*dt|{_RATES_OF})\s*\(\s*([^(),]+?)\s*(?:,\s*t\s*)?\)",
     "write r_dot, with `r: {0}` in `definitions`"),
    (rf"\bdot\s+{_NAME}", _RATE),
    (rf"{_NAME}(?:\u0308|''|″|′′|’’|\s*[.\s-]\s*ddot\b)", _SECOND_RATE),
    (rf"{_NAME}\[t\]", "write {0}, without `[t]`"),
    (rf"{_NAME}(?:[\u0307'′’]|\s*[.\s-]\s*dot\b|\.dt\b|\.diff\(\s*t?\s*\))", _RATE),
    (rf"\b{_MADE_OF}\.{_NAME}", "write {0}, without the text before the dot"),
    (r"([⁺⁻][⁰¹²³⁴-⁹]+)", _fractions),
    (r"\|([^|]+)\|", "write abs({0})"),
    (rf"√\s*\({_INSIDE}\)", "write sqrt({0})"),
    (r"√\s*(\w+)", "write sqrt({0})"),
    (r"∛\s*\(?(\w+)\)?", "write cbrt({0})"),
    (r"\$", "write the expression without `$`"),
    (r"\^\{([^{}]*)\}", "write ^({0})"),
    (r"[\w)]\s*!(?!=)", "there is no factorial"),
    (r"([\w.]+)\s*//\s*([\w.]+)",
     "write floor({0}/{1}), or ` #` where a comment begins"),
    (r"[≠]", f"write < or >: {_EXACT}"),
    (r"[“”„‘’‚]", "an expression contains no quotes"),
    (r"[\u200b-\u200f\u2060\ufeff]", "delete it: it is invisible"),
    (r"(?<!&)&(?!&)|\bAND\b", "write `and`"),
    (r"\bOR\b", "write `or`"),
    (r";\s*$", "leave `;` out"),
    (r"[⋅∙•∗]", "write `*`"),
    (r"\.([*/^])", "write `{0}` for `.{0}`"),
    (r"~(?=\s*[-+]?[\d.])", "leave `~` out"),
    (r"\w\([^()]*;", "write `,` between arguments"),
    (r"\b(min|max|hypot)\(([^(),]+),\s*([^(),]+),\s*([^(),]+)\)",
     "write {0}({1}, {0}({2}, {3}))"),
    (r"\batan\(([^(),]+),\s*([^(),]+)\)", "write atan2({0}, {1})"),
    (r"\batan2\(([^(),/]+)/([^(),/]+)\)", "write atan2({0}, {1})"),
    (r"\blog\(([^(),]+),\s*([^(),]+)\)", "write log({0})/log({1})"),
]  # fmt: skip
# What is written for LaTeX, one after the other.
_FUNCTION = rf"\\({'|'.join(sorted(FUNCTIONS, key=len, reverse=True))})\b"
_LATEX = [
    (r"\\(?:left|right|displaystyle|limits)\b|\\[,;:! ]", " "),
    (r"\\(?:cdot|times)\b", "*"),
    (r"(?<=\w)(?=\\)", " "),
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
    (r"(?<=.)([-+=<>]+)", r" \1 "),
]
# What parses as an expression and is meant otherwise.
_PARSED = (_SECOND_QUOTIENT, _QUOTIENT, _PER_MINUTE)
# The first of them are of numbers.
_OF_NUMBERS = 11


@functools.cache
def patterns() -> list[tuple[re.Pattern[str], Meant]]:
    """Give the table, its patterns compiled."""
    return [(re.compile(pattern), meant) for pattern, meant in _SPELLINGS]


# --- Hints for expressions, from what stands around a fault

# What is meant shows within so many letters of a fault; patterns that are tried at each
# of a million would take for ever.
WINDOW = 100
# Names that are tried as parts of a longer one.
MOST_PARTS = 200

# A letter of one side of a comparison, or a call.
_SIDE = r"(?:[^(),<>=]|\([^()]*\))"
_QUANTITY = (
    rf"\s*([-+]?\s*{NUMBER})\s*[\[(]?"
    r"((?:[^\W\d_]|[°º])[\w*/^·⋅.()\s-]*?|)[\])]?\s*\.?\s*"
)
_RATES = {
    "_dot": (
        r"d_?(.+?)(?:_?dt)?", r"(.+?)_?dot", r"(.+)_(?:dt|d|t|prime)", r"dot_?(.+)",
        r"(?:velocity|vel|speed|omega|v|w)_?(.+)",
        r"(.+?)_?(?:velocity|vel|speed|rate)", r"(.+)d", r"(.+)'",
    ),
    "_ddot": (
        r"dd_?(.+)", r"d2_?(.+?)(?:_?dt2)?", r"(.+?)_?ddot", r"(.+)_dotdot",
        r"ddot_?(.+)", r"(.+)_dd", r"(.+)''", r"(.+?)_?dot_?dot",
        r"(?:acceleration|accel|acc|a)_(.+)", r"(.+)_(?:acceleration|accel|acc)",
    ),
}  # fmt: skip
_NUMBERS = _by_word(
    {
        "π pi": "write pi",
        "e": "write exp(x) for e^x, exp(1) for e",
        "deg degree degrees": f"write pi/180: {RADIANS}",
        "inf infinity nan": "every number is finite",
        "free guess auto": "a value to be solved is written {guess: 0}",
        "none true false": "write a number, such as 0",
    }
)
_COMBINING = {"\u0307": "_dot", "\u0308": "_ddot"}
SPEEDS = ("v", "w", "ω", "omega", "vel", "velocity", "speed", "dt")
# What is written in a relation for signs of other languages.
_IN_RELATIONS = {
    "==": "write `=`, one alone",
    **dict.fromkeys("≈≡→≃", "write `=`"),
    **dict.fromkeys(("!=", "<>"), "a relation is written with `=`, `>=` or `<=`"),
}


def of_relation(text: str, token: str, known: Collection[str]) -> str:
    """Give a hint for a relation with a fault at a token, or an empty text."""
    if text.rstrip().endswith("="):
        return f"write {text.strip()} 0"
    if token in _IN_RELATIONS:
        return _IN_RELATIONS[token]
    right = re.fullmatch(r"[^<>=]*(?:[<>]?=)\s*([^<>=]+)", text)
    return _of_number(right[1], known, beside=False) if right else ""


def of_expression(fault: ExpressionError, text: str, known: Collection[str]) -> str:
    """Give a hint for a fault that the parser found, or an empty text."""
    end = fault.offset + fault.length
    token, hint = text[fault.offset : end], ""
    if fault.code == "unknown-function":
        hint = of_function(token, _argument(text[end:]), known)
        hint = hint or fault.hint or "a function of your own is a definition"
    elif "a comparison is" in fault.text:
        hint = _of_comparison(text, fault.offset)
    if hint or token == ",":
        return hint
    # What the parser says of a name may not hold here.
    product = fault.hint.startswith("there is no implicit product")
    if product and re.match(r"[^\W\d]", token) and not _is_known(token, known):
        return f"an operator is expected before a name, and `{token}` is none here"
    return fault.hint


def _argument(text: str) -> str:
    """Give what stands in the parentheses that a text begins with."""
    depth = 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if letter == ")" and depth <= 0:
            text = text[:k]
            break
    return text.strip().removeprefix("(").strip()


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
    number = quantities.around(quantities.SEPARATED, text, offset)
    if number and (hint := quantities.separated(number[0])):
        return hint
    if text == whole and (typed := _typed(text)):
        return f"write {typed}"
    if "\\" in text and text == whole:
        return f"write {latex(text)}"
    hint = _matching(text, offset, known) or _of_unit(
        text, offset, known, beside=beside and text == whole
    )
    # A Greek word by the variable that is called as it is.
    words = {word for word in re.findall(r"[^\W\d_]+", hint) if not word.isascii()}
    named = {word: _called_so(word, known) or word for word in words}
    return re.sub(r"[^\W\d_]+", lambda word: named.get(word[0], word[0]), hint)


_PRINTED = str.maketrans("·×⋅−–⁻⁺⁰¹²³⁴⁵⁶⁷⁸⁹", "***---+0123456789", "\u0307")


def _typed(text: str) -> str:
    """Give an expression with several signs of print in the letters of a keyboard."""
    text = unicodedata.normalize("NFD", text.replace("π", "pi"))
    several = len(re.findall(r"[⁺⁻]?[⁰¹²³⁴-⁹]+|[^\x00-\x7f]", text)) > 1
    text = re.sub(
        r"[⁺⁻]?[⁰¹²³⁴-⁹]+", r"^\g<0>", re.sub("\\w\u0307", r"\g<0>_dot", text)
    )
    text = text.translate(_PRINTED)
    product = re.search(r"\d[^\W\d]", text)  # d^2x, or one without its sign
    return text if several and text.isascii() and not product else ""


def _matching(
    text: str, offset: int, known: Collection[str] = (), *, parsed: bool = False
) -> str:
    """Give the hint of the first spelling around an offset, or an empty text.

    `known`: names that are variables, and call nothing; `parsed`: only of what parses
    as an expression and is meant otherwise.
    """
    for pattern, meant in patterns():
        if parsed and meant is not _exponential and pattern.pattern not in _PARSED:
            continue
        for found in pattern.finditer(text):
            if meant is _call and found[1] in known:
                continue
            if found.start() <= offset <= found.end():
                if not isinstance(meant, str):
                    return meant(found)
                return meant.format(*found.groups())
    return ""


def of_unknown(text: str, offset: int) -> str:
    """Give a hint for a name at `offset` that has a meaning with what is around it."""
    first = max(0, offset - WINDOW)
    return _matching(text[first : offset + WINDOW], offset - first, parsed=True)


def _of_comparison(text: str, offset: int) -> str:
    """Give a hint for a comparison that stands as a number."""
    for pattern in (r"\(([^(),]+[<>][^(),]*)\)", rf"^({_SIDE}+[<>]=?{_SIDE}+)$"):
        if found := quantities.around(pattern, text[: offset + WINDOW], offset):
            return f"write if({found[1].strip()}, 1, 0)"
    return ""


def _of_number(text: str, known: Collection[str], *, beside: bool) -> str:
    """Give a hint where the whole text is meant to be a number, with a unit or not."""
    plain = unicodedata.normalize("NFKC", text)
    if re.fullmatch(rf"\s*\d+{FRACTION}\d+\s*", plain):
        return f"write {plain.strip().replace(FRACTION, '/')}"
    found = re.fullmatch(_QUANTITY, text)
    # A number in one of the spellings has a hint of its own: degrees, powers of 10.
    spelt = (pattern.search(text) for pattern, _ in patterns()[:_OF_NUMBERS])
    if found is None or not found[2] or any(spelt):
        return ""
    number, unit = found[1].replace(" ", ""), found[2]
    unit += ")" * (unit.count("(") > unit.count(")"))
    names = quantities.words(quantities.unit(unit))
    product = all(_is_known(name, known) for name in names)
    if not product and not quantities.is_unit(unit):
        parted = re.sub(
            r"[^\W\d]\w*", lambda w: "*".join(_parts(w[0], known)) or w[0], unit
        )
        if parted != unit:
            return f"write {number}*{parted}"
    if product and not quantities.is_unit(unit):
        return ""
    hint = quantities.quantity(number, unit, beside=beside)
    if product and len(names) > 1:
        return f"a product is written {number}*{quantities.unit(unit)}"
    if product and unit not in FUNCTIONS:
        product_of = f"{number}*{quantities.unit(unit)}"
        return f"{hint}; a product is written {product_of}"
    return hint if quantities.is_unit(unit) or len(names) == 1 else ""


def _of_unit(text: str, offset: int, known: Collection[str], *, beside: bool) -> str:
    """Give a hint where a unit follows what is no plain number, as in `1/2 kg`."""
    before, unit = text[:offset].strip(), text[offset:]
    names = quantities.words(before)
    inside = before.count("(") > before.count(")")
    called = names and names[-1] in FUNCTIONS and before.endswith(names[-1])
    if not before or inside or called or not quantities.is_unit(unit):
        return ""
    if not all(_is_known(name, known) for name in names):
        return ""
    if all(_is_known(name, known) for name in quantities.words(unit)):
        return ""
    return quantities.quantity(before, unit, beside=beside)


def _is_known(name: str, known: Collection[str]) -> bool:
    base = name.removesuffix("_ddot").removesuffix("_dot")
    return base in known or name in ("pi", "t") or name in FUNCTIONS


def of_function(name: str, argument: str, known: Collection[str]) -> str:
    """Give a hint for a function that there is not, called with an argument."""
    if meant := spelt_call(name, argument):
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
        ordinal = "second " if rate.endswith("_ddot") else ""
        return f"the {ordinal}rate is written {rate}"
    if name.casefold() == "time" and moving:
        return "the time is `t`"
    if name in SPEEDS and moving:
        rate = f"a rate is written {next(iter(moving))}_dot"
        return f"{rate}; what is given has its value in `parameters`"
    for function in FUNCTIONS:
        rest = name.removeprefix(function)
        factor = rest[: len(rest) - len(rest.lstrip("0123456789"))]
        inside = _called_so(rest.removeprefix(factor), known) if rest != name else ""
        if inside:
            return f"write {function}({factor and f'{factor}*'}{inside})"
    base = name.rstrip("23456789")
    if len(name) - len(base) == 1 and _is_known(base, known) and base != "t":
        return f"a power is written {base}^{name.removeprefix(base)}"
    parts = _parts(name, known)
    return f"a product is written {'*'.join(parts)}" if parts else ""


def _called_so(name: str, known: Collection[str]) -> str:
    """Give the variable of this name, Greek letters or theirs; or an empty text."""
    if _is_known(name, known):
        return name
    plain = spelt_out(name)
    return next((other for other in known if name and spelt_out(other) == plain), "")


def _parts(name: str, known: Collection[str]) -> list[str]:
    """Give the variables, two or more, of whose names a name is made; or none."""
    if 1 < len(known) <= MOST_PARTS and len(name) <= WINDOW:
        several = sorted(map(re.escape, known), key=len, reverse=True)
        one = f"(?:{'|'.join(several)})(?:_dot)?"
        parts = re.findall(one, name)
        if re.fullmatch(f"(?:{one}){{2,4}}", name) and len(set(parts)) == len(parts):
            return parts
    return []


def rate_of(name: str, moving: Collection[str]) -> str:
    """Give the rate that is spelt otherwise, such as `x_dot` for `xdot`, or nothing."""
    if len(name) > WINDOW:
        return ""
    plain = unicodedata.normalize("NFD", name)
    for mark, ending in _COMBINING.items():
        if mark in plain and plain.replace(mark, "") in moving:
            return plain.replace(mark, "") + ending
    for ending, spellings in _RATES.items():
        for pattern in spellings:
            match = re.fullmatch(pattern, name, re.IGNORECASE)
            if match and (base := _called_so(match[1], moving)):
                return base + ending
    return ""


def rate_within(text: str, moving: Collection[str]) -> str:
    """Give the rate that a text is, spelt as elsewhere: `d/dt x`; or an empty text."""
    text = text[:WINDOW]
    plain = latex(text) if "\\" in text else ""
    hint = f"the rate is written {plain}" if plain else _matching(text, 0)
    found = re.fullmatch(r"the (?:second )?rate is written ((.+)_dd?ot)", hint)
    return found[1] if found and found[2] in moving else ""


def spelt_out(name: str) -> str:
    """Give a name in small letters, with Greek ones by their names: theta for θ."""
    full = {x: unicodedata.name(x, "") for x in name if x > "\x7f"}
    greek = {x: n.split()[-1] for x, n in full.items() if n.startswith("GREEK ")}
    return "".join(greek.get(x, x) for x in name).casefold()


# --- Hints for keys, mappings and lists


def of_key(key: Scalar, value: Node, given: list[Entry], known: Collection[str]) -> str:
    """Give a hint where a number, a count or two times stand as a key of a mapping."""
    name = key.text.casefold()
    if "output_step" in known and name in SPANS:
        return quantities.span(value) or "write `start: ...` and `end: ...`"
    if "output_step" in known and name in COUNTS:
        texts = {k.text: v.text for k, v in given if isinstance(v, Scalar)}
        length = texts.get("duration", texts.get("end", "duration"))
        if "start" in texts and "duration" not in texts:
            length = f"({length} - {texts['start']})"
        length = "1" if name == "fps" else length
        return (
            f"write `output_step: {length}/{text_of(value)}`: the spacing of the rows"
        )
    apart = re.fullmatch(r"(\w+)\s*(?:\s|=)\s*(\S.*)", key.text)
    if apart and apart[1] in known and not text_of(value):
        return f"a colon is missing: `{apart[1]}: {apart[2]}`"
    if "y2" in known and not text_of(value) and len(given) > 1:
        before, first = given[max(1, given.index((key, value))) - 1]
        both = f"{text_of(first)}, {key.text}"
        kept = f'"{both}"' if before.text == "title" else f"[{both}]"
        return f"write `{before.text}: {kept}`"
    place = texts_of(items_of(value))
    if "links" in known and len(place) in (2, 3) and name not in KEYS:
        return f"`{key.text}` belongs below `points:`, indented"
    if not re.fullmatch(r"\d[\d.]*", name):
        return ""
    if hint := quantities.split_by_comma(key):  # 1,5 or {1, unit: m}
        return hint
    names = [k.text for k, _ in given]
    after = "".join(names[names.index(key.text) + 1 :][:1])
    unit = after if quantities.is_unit(after) else "..."
    return f"write {{value: {key.text}, unit: {unit}}}"


def of_lines(node: Node, what: str) -> str:
    """Give a hint where something else stands for a mapping."""
    names = _names_of(node)
    if what == "`coordinates`" and names:
        return f"write {{{', '.join(f'{name}: {{}}' for name in names)}}}"
    if what == "a plot" and len(names) in (1, 2):
        return f"write {{x: {names[0] if names[1:] else 't'}, y: {names[-1]}}}"
    versus = r"(\w+) (?:vs\.?|versus|over|against) (\w+)"
    if what == "a plot" and (shown := re.fullmatch(versus, text_of(node))):
        return f"write {{x: {shown[2]}, y: {shown[1]}}}"
    if what.startswith("the coordinate") and len(names) == 1:
        return f"write {{unit: {names[0]}}}"
    if isinstance(node, Sequence):
        return "write lines `name: value`, without the `-` or brackets of a list"
    text = node.text if isinstance(node, Scalar) else ""
    if what == "`constraints`" and "=" in text:
        return f"write `name: {text}`, with a name of your own"
    for pattern, missing in (
        (r"(\w+)\s*=\s*([^=\s].*)", "a colon is missing"),
        (r"([^\s:]+):([^\s:]\S*)", "a space is missing after the colon"),
        (r"([^\W\d_]\w*)\s+([^\s:=]+)\Z", "a colon is missing"),
    ):
        if match := re.match(pattern, text):
            return f"{missing}: `{match[1]}: {match[2]}`"
    return ""


def _names_of(node: Node) -> list[str]:
    """Give the names of a list, with brackets or without; none where it is another."""
    text = node.text if isinstance(node, Scalar) else ""
    if isinstance(node, Sequence):
        text = ",".join(i.text if isinstance(i, Scalar) else "?" for i in node.items)
    one = r"[^\W\d_]\w*"
    found = text.split(",") if re.fullmatch(rf"{one}(?:\s*,\s*{one})*", text) else []
    return [name.strip() for name in found]


def as_list(node: Node, what: str = "") -> str:
    """Say how what stands for a list is written as one."""
    if isinstance(node, Mapping):
        pairs = [(key.text, text_of(value)) for key, value in node.entries]
        if not any(text for _, text in pairs):
            return f"write [{', '.join(key for key, _ in pairs)}]"
        if "link" in what:
            links = ", ".join(f"[{a}, {b}]" for a, b in pairs)
            return f"write [{links}]" if what == "`links`" else f"write {links}"
        return f"write [{{{', '.join(f'{a}: {b}' for a, b in pairs)}}}]"
    text = node.text.strip() if isinstance(node, Scalar) else ""
    if text == "all":
        return "delete it: all are there without it"
    if text[:1] + text[-1:] in ("()", "[]"):
        text = text[1:-1]
    return f"write [{' '.join(text.split())}]" if text else "a list is written [a, b]"


def text_of(node: Node) -> str:
    """Give the text of a scalar, of a list of them, or dots."""
    if isinstance(node, Sequence):
        return ", ".join(map(text_of, node.items))
    return node.text if isinstance(node, Scalar) else "..."
