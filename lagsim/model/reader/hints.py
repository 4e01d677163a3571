"""Hints: the likely meaning of an expression, a name or a key that is not valid.

They cover spellings of other languages, of textbooks and of pocket calculators. The
many patterns are compiled only where a file has a fault.
"""

from __future__ import annotations

import re
import unicodedata
from itertools import islice
from typing import TYPE_CHECKING

from lagsim.codes.known import (
    EXPRESSION_ARITY,
    EXPRESSION_NUMBER,
    EXPRESSION_UNKNOWN_FUNCTION,
)
from lagsim.language.functions import FUNCTIONS
from lagsim.language.parser import ExpressionError, parse, parse_relation
from lagsim.model.nodes import Mapping, Scalar, Sequence, items_of, texts_of
from lagsim.model.reader import quantities
from lagsim.model.reader.quantities import NUMBER

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    from lagsim.language.parser import Name, Parsed, ParsedRelation
    from lagsim.model.nodes import Entry, Node

    Meant = str | Callable[[re.Match[str]], str]
    Parser = Callable[[str], Parsed | ParsedRelation]

RADIANS = "angles are in radians"
DELAY = (
    "there are no delays: forces depend on the present state; a lag is modelled by "
    "`states`, such as z with the rate (x - z)/tau"
)
NO_NOISE = (
    "there are no random numbers: a force follows the samples of a table, and `sweep "
    "--sample` draws parameters"
)
# Calls of other languages whose meaning is no function here, and the advice for each.
_NO_FUNCTIONS = (
    (re.compile(r"(?i)(rand(n|om|int|s)?|rnd|rng|runif|rnorm|uniform|normal|normrnd|"
                r"gauss(ian)?|(white_?)?noise|wgn|awgn)"), NO_NOISE),
    (re.compile(r"(?i)(delay(ed)?|lag(ged)?|transport_?delay|dde)"), DELAY),
    (re.compile(r"(?i)(integra(l|te|tor)|quad|cumtrapz|cumsum)"),
     "an integral over time is a first-order state: `states: {s: {rate: ...}}`"),
    (re.compile(r"(?i)(dirac(_?delta)?|delta|δ|impulse)"),
     "an impulse is given by an event: `events: {kick: {at: ..., impulse: {...}}}`"),
    (re.compile(r"(?i)(interp(1d?|2d?|olate)?|lookup|spline|tabulated)"),
     "a curve is given in `tables`, and called by its name"),
    (re.compile("sum"), "a sum over a family is written sum(i = 1..n, x(i))"),
    (re.compile("dot|cross|unit"),
     "its arguments are vectors, vec(a, b) or vec(a, b, c), and this file has none"),
    (re.compile("(un)?rotate|omega(_space)?"),
     "it belongs to a frame, and this file has no `frames`"),
)  # fmt: skip

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
_REWRITTEN = {word: row for words, row in {
        "log2": ("x", "log(x)/log(2)"), "log1p": ("x", "log(1 + x)"),
        "expm1": ("x", "exp(x) - 1"), "exp2": ("x", "2^x"), "exp10": ("x", "10^x"),
        "pow power": ("a b", "a^b"), "square sqr": ("x", "x^2"), "cube": ("x", "x^3"),
        "rational fraction": ("a b", "(a/b)"), "root": ("x n", "x^(1/n)"),
        "sec": ("x", "1/cos(x)"), "csc": ("x", "1/sin(x)"),
        **{f"{of}d": ("x", f"{of}(x*pi/180)") for of in ("sin", "cos", "tan")},
        **{f"a{of}d": ("x", f"a{of}(x)*180/pi") for of in ("sin", "cos", "tan")},
        "cot ctg cotan": ("x", "1/tan(x)"), "acot arccot": ("x", "atan2(1, x)"),
        "fmod rem": ("x y", "sign(x)*mod(abs(x), abs(y))"),
        "remainder": ("x y", "mod(x, y)"), "round": ("x", "floor(x + 0.5)"),
        "float double": ("x", "x"), "int trunc fix": ("x", "sign(x)*floor(abs(x))"),
        "clip clamp": ("x a b", "max(a, min(x, b))"), "norm": ("x y", "hypot(x, y)"),
        "where ifelse iif ite cond piecewise": ("condition a b", "if(condition, a, b)"),
        "deg2rad radians rad deg": ("x", f"x*pi/180: {RADIANS}"),
        "rad2deg degrees": ("x", "x*180/pi"),
}.items() for word in words.split()}  # fmt: skip
# Keys of the file, the likelier first, and how they are called elsewhere, in small
# letters.
_KEYS = {
    "parameters": "constants params consts given",
    "coordinates columns": "variables vars dof dofs generalized_coordinates q",
    "definitions": "define functions expressions positions kinematics",
    "forces": "loads generalized_forces applied_forces",
    "simulation": "sim solve integration solver_options",
    "scene": "graphics drawing draw visualization animation geometry",
    "plots": "plot figures charts",
    "initial": "initial_conditions initial_state initial_values ic ics init x0",
    "kinetic duration": "t ke ekin kinetic_energy",
    "potential": "v u pe epot potential_energy",
    "lagrangian": "l lagrange lagrange_function",
    "dissipation": "d r rayleigh friction", "dissipation forces": "damping",
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
# Keys of counts in other programs; no key here takes a count in place of a length.
COUNTS = (
    "n", "steps", "nsteps", "n_steps", "num_steps", "number_of_steps", "output_steps",
    "samples", "points", "rows", "fps", "frames",
)  # fmt: skip
SPANS = ("tspan", "t_span", "time_span", "t_range", "interval")
# Functions that denote a rate of their first argument.
_RATES_OF = "(?i:d|der|deriv|derivative|diff|dot)"
# Names of functions in any notation, the longest first.
CALLED = "|".join(
    sorted((*FUNCTIONS, *_RENAMED, *_REWRITTEN), key=lambda name: -len(name))
)
MODULES = r"Modelica\.Math|np|numpy|jnp|math|Math|cmath|sp|sympy|torch|std"


def spelt_call(name: str, arguments: str) -> str:
    """Return a call of another language in lagsim's notation; "" if it is unknown.

    name, arguments : the texts before and within the parentheses.

    Examples
    --------
    >>> spelt_call("arctan", "x")
    'atan(x)'
    """
    known = _RENAMED.get(name.casefold(), name.casefold())
    if known in FUNCTIONS:
        return f"{known}({arguments})"
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


# --- How expressions are written elsewhere, and how they are written here: a table

_ARGUMENT = rf"(?:{NUMBER}(?:\s*\*\s*)?)?(?:[^\W\d]\w*|{NUMBER})"
_POWER = r"(?:\^|\*\*)\s*(\d+)"
# Content of parentheses, with nested ones.
_INSIDE = r"((?:[^()]|\([^()]*\))*)"
_INVERSE = r"(?:(?:\^|\*\*)\s*(?:-1|\(\s*-1\s*\))|⁻¹)"
_NAME = r"([^\W\d_]\w*)"
_MADE_OF = r"(?:self|params?|parameters|p|definitions|coordinates|states?|constants)"
_EXACT = "numbers are compared by <, <=, > and >="
_TERM = r"[\w.]+(?:\s*[-+*/^]\s*[\w.]+)*"
# A letter of one side of a comparison, or a call.
_SIDE = r"(?:[^(),<>=?:]|\([^()]*\))"
# Base or exponent of a power.
_ATOM = r"(?:[\w.]*\((?:[^()]|\([^()]*\))*\)|[\w.]+)"
_SECOND_QUOTIENT = (
    rf"(?:\bd|∂)(?:(?:\^|\*\*)?2|²)\s*{_NAME}\s*/\s*[d∂]\s*t(?:(?:\^|\*\*)?2|²)?"
)
_PER_MINUTE = rf"({NUMBER})(?:\s+1)?\s*/\s*min\b(?!\s*\()"
_EXPONENT = r"(\d)\s*([-+])\s*[eE](\d+)\b"
_QUOTIENT = rf"(?:\bd|∂)\s*\(?{_NAME}\)?\s*/\s*[d∂]t\b"
_RATE = "the rate is written {0}_dot"
_SECOND_RATE = "the second rate is written {0}_ddot"


def _call(found: re.Match[str]) -> str:
    """Return the hint `write f(x)` for a matched call of another language."""
    return f"write {spelt_call(found[1], found[2])}"


def _power_of_call(found: re.Match[str]) -> str:
    name, power, argument = found.groups()
    base = spelt_call(name, argument or "...")
    return f"write {base if base[-1] == ')' else f'({base})'}^{power}"


def _exponential(found: re.Match[str]) -> str:
    power = found[1][1:-1] if found[1][0] == "(" else found[1]
    return f"write exp({power})"


def _compared(found: re.Match[str]) -> str:
    left, sign, right = (part.strip() for part in found.groups())
    if sign in ("!=", "<>", "≠"):
        return f"write ({left} < {right} or {left} > {right}): {_EXACT}"
    return f"write ({left} >= {right} and {left} <= {right}): {_EXACT}"


def _fraction(found: re.Match[str]) -> str:
    plain = unicodedata.normalize("NFKC", found[0]).replace("\N{FRACTION SLASH}", "/")
    return f"({plain[:-3]} + {plain[-3:]})" if plain[3:] else f"({plain})"


# Each pattern is searched around the fault: the match, and its correction.
_SPELLINGS: list[tuple[str, Meant]] = [
    (r"\bif\(([^(),]+[<>][^(),]*),([^(),]+)\)", "write if({0},{1}, 0)"),
    (quantities.SEPARATED, lambda found: quantities.separated(found[0])),
    (rf"({NUMBER})\s*%\s*$", "write {0}/100"),
    (r"\b(\d+\.\d*)[fF]\b", "write {0}"),
    (r"\b\d+\.?\d*[ij]\b", "every number is real"),
    (r"\b0[xX][\da-fA-F]+\b", lambda found: f"write {int(found[0], 16)}"),
    (r"(\d+\.?\d*)[eE]([-+]?\d*\.\d+)", "write {0}*10^{1}"),
    (rf"({NUMBER})\s*[xX×·]\s*10\s*(?:\^|\*\*)\s*([-+]?\d+)", "write {0}e{1}"),
    (r"\b\d+\.\d*\.\d", "a number has one decimal point"),
    (r"(\d+\.?\d*)[dD]([-+]?\d+)\b", "write {0}e{1}"),
    (r"(\d+\.?\d*)[eE](?![\w+-])", "write {0}e0: an exponent has digits"),
    (rf"({NUMBER})\s*(?:±|\+/?-).*", "write {0}"),
    (r"\d:\d\d", "a time is one number, such as 90 for 1:30"),
    (r"∞|\.?\b(?i:inf|nan)\b", "every number is finite"),
    (rf"({NUMBER})\s*(?:[°º]|deg(?:rees?)?\b)(?!\s*/\s*s)",
     f"write {{0}}*pi/180: {RADIANS}"),
    (rf"{_NAME}\s*[°º]", f"write {{0}}*pi/180: {RADIANS}"),
    (_PER_MINUTE, "write {0}*2*pi/60: rates are in rad/s"),
    (r"([,;]|(?<!\d)\.)\s*$", "leave `{0}` out"),
    (r"\w\[\d*\]", "a member of a family is written q(1)"),
    (rf"\b(?:[eE]|exp)\s*(?:\^|\*\*)\s*(-?\s*{_ATOM})", _exponential),
    (r"\(([^()]+?)\s+if\s+([^()]+?)\s+else\s+([^()]+?)\)", "write if({1}, {0}, {2})"),
    (r"^\s*(?:if\s+)?(.+?)\s+if\s+(.+?)\s+else\s+(.+)$", "write if({1}, {0}, {2})"),
    (r"^\s*if\s+(.+?)\s+then\s+(.+?)\s+else\s+(.+)$", "write if({0}, {1}, {2})"),
    (r"^\s*(.+?)\s*\?\s*(.+?)\s*:\s*(.+)$", "write if({0}, {1}, {2})"),
    (r":=", "write `=`"),
    (_EXPONENT, "write {0}e{1}{2}"),
    (r"^\s*(.+?)\s+(?:when|where|if)\s+(.+)$", "write if({1}, {0}, 0)"),
    (r"=<", "write `<=` for `=<`"), (r"=>", "write `>=` for `=>`"),
    (rf"({_TERM})\s*(==|!=|<>|≠)\s*({_TERM})", _compared),
    (rf"(?<=\bif\()\s*({_TERM})\s*(=)\s*({_TERM})", _compared),
    (r"([\w.]+)(?:\s+(?:mod|rem)\s+|\s*%\s*)([\w.]+)",
     "write mod({0}, {1})"),
    (r"([\w.]+)\s+div\s+([\w.]+)", "write floor({0}/{1})"),
    *(
        (rf"\b({CALLED})\s*{power}", _power_of_call)
        for power in (
            rf"{_POWER}\s*\({_INSIDE}\)",
            rf"{_POWER}\s+({_ARGUMENT})",
        )
    ),
    (rf"\b(sinh?|cosh?|tanh?)\s*{_INVERSE}\s*(?:\({_INSIDE}\)|({_ARGUMENT}))?",
     lambda found: f"write a{found[1]}({found[2] or found[3] or '...'})"),
    (rf"\b((?i:{CALLED}))\s*[\[{{]([^\]}}]*)[\]}}]", _call),
    (rf"\b((?i:{CALLED}))\s+({_ARGUMENT})", _call),
    (rf"\b(?:{MODULES})(?:\.|::)e\b", "write exp(1)"),
    (rf"\b((?:{MODULES})(?:\.|::))(?=\w)", "leave `{0}` out"),
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
    (rf"\b{_MADE_OF}(?:\.|\[['\"]){_NAME}(?:['\"]\])?", "write {0}"),
    (r"\|([^|]+)\|", "write abs({0})"),
    (r"[\w)]\s*!(?!=)", "there is no factorial"),
    (r"([\w.]+)\s*//\s*([\w.]+)",
     "write floor({0}/{1}), or ` #` where a comment begins"),
    (r'"\s*$', 'leave `"` out'),
    (r"[“”„‘’‚]", "an expression contains no quotes"),
    (r"[\u200b-\u200f\u2060\ufeff]", "delete it: it is invisible"),
    (r"(?<!&)&(?!&)|\bAND\b", "write `and`"),
    (r"\bOR\b", "write `or`"), (r"\.([*/^])", "write `{0}` for `.{0}`"),
    (r"~(?=\s*[-+]?[\d.])", "leave `~` out"),
    (r";", "write `,`: it is between arguments"),
    (r"\b(min|max|hypot)\(([^(),]+),\s*([^(),]+),\s*([^(),]+)\)",
     "write {0}({1}, {0}({2}, {3}))"),
    (r"\batan\(([^(),]+),\s*([^(),]+)\)", "write atan2({0}, {1})"),
    (r"\batan2\(([^(),/]+)/([^(),/]+)\)", "write atan2({0}, {1})"),
    (r"\blog\(([^(),]+),\s*([^(),]+)\)", "write log({0})/log({1})"),
    (r"(?<!if)\(([^(),]+[<>][^(),]*)\)", "write if({0}, 1, 0)"),
    (rf"^({_SIDE}+[<>]=?{_SIDE}+)$", "write if({0}, 1, 0)"),
]  # fmt: skip
# LaTeX and signs of print, and their ASCII notation: each row is applied until it does
# not match, from the first on. Signs of products are put where the parser misses them.
_CALL = rf"\\({'|'.join(sorted(FUNCTIONS, key=len, reverse=True))})\b"
_GROUP = r"\{([^{}]*)\}"
_PART = r"\s*(?:\{([^{}]*)\}|(\d)|(\\\w+))"
_TYPED: list[tuple[str, Meant]] = [
    (r"\$|\\(?:displaystyle|limits|left|right|[,;:! ])", " "), ("º", "°"),
    (rf"\\(?:mathrm|mathit|text|operatorname)\s*{_GROUP}", " {0}"),
    (r"\\[lr]?vert\b", "|"),
    (r"\\(?:cdot|times)\b|[·×⋅∙•∗]", "*"),
    ("[÷∕⁄]", "/"), ("[−–]", "-"), ("≤", "<="), ("≥", ">="),
    (r"\\(d?dot)\b\s*\{?\s*\\?([^\W\d_]\w*)\s*\}?", r" {1}_{0} "),
    (r"_\{(\w*)\}", "_{0}"), (r"\^\{(\w+)\}", "^{0}"), (rf"\^{_GROUP}", "^({0})"),
    (rf"{_CALL}\s*{_GROUP}", " {0}({1})"),
    (rf"\\[dtc]?frac{_PART}{_PART}", lambda found: "({})/({})".format(
        *(part for part in found.groups() if part is not None))),
    (rf"\\sqrt\s*\[3\]\s*{_GROUP}", " cbrt({0})"),
    (rf"\\sqrt\s*{_GROUP}", " sqrt({0})"),
    (r"(?<!\^)(\d)\s*\\(?=\w)", "{0}*\\"),
    (r"\\(?:var)?([^\W\d_]+(?:_\w+)?)", " {0} "),
    ("[⁺⁻]?[⁰¹²³⁴-⁹]+", lambda found: "^{} ".format(
        unicodedata.normalize("NFKC", found[0]).replace("−", "-"))),
    (r"\d*[¼-¾⅐-⅞]", _fraction),
    ("\u0307", "_dot"), ("\u0308", "_ddot"),
    (r"√\s*(?=\()", "sqrt"), (r"√\s*([\w.]+)", "sqrt({0})"),
    (r"∛\s*(?=\()", "cbrt"), (r"∛\s*([\w.]+)", "cbrt({0})"), ("π", "pi"),
]  # fmt: skip
# Spellings that parse as an expression with another meaning.
_PARSED = (_SECOND_QUOTIENT, _QUOTIENT, _PER_MINUTE, _EXPONENT)

# --- Hints for expressions, from the text around a fault

# Number of letters around a fault that are searched: patterns tried at each of a
# million letters would not end in a reasonable time.
WINDOW = 100
# Names that are tried as parts of a longer one.
MOST_PARTS = 200

_QUANTITY = (
    rf"\s*([-+]?\s*{NUMBER})\s*[\[(]?"
    r"((?:[^\W\d_]|[°º])[\w*/^·⋅.()\s-]*?|)[\])]?\s*\.?\s*"
)
_RATES = {
    "_ddot": (
        r"dd_?(.+)", r"d2_?(.+?)(?:_?dt2)?", r"(.+?)_?ddot", r"(.+)_dotdot",
        r"ddot_?(.+)", r"(.+)_dd", r"(.+)''", r"(.+?)_?dot_?dot",
        r"(?:acceleration|accel|acc|a)_(.+)", r"(.+)_(?:acceleration|accel|acc)",
    ),
    "_dot": (
        r"d_?(.+?)(?:_?dt)?", r"(.+?)_?dot", r"(.+)_(?:dt|d|t|prime)", r"dot_?(.+)",
        r"(?:velocity|vel|speed|omega|v|w)_?(.+)",
        r"(.+?)_?(?:velocity|vel|speed|rate)", r"(.+)d", r"(.+)'",
    ),
}  # fmt: skip
_NUMBERS = {word: hint for words, hint in {
    "π pi m_pi": "write pi",
    "e": "write exp(x) for e^x, exp(1) for e",
    "deg degree degrees": f"write pi/180: {RADIANS}",
    "inf infinity nan": "every number is finite",
    "free guess auto": "a value to be solved is written {guess: 0}",
    "none true false yes no on off": "write a number, such as 0",
}.items() for word in words.split()}  # fmt: skip
SPEEDS = ("v", "w", "ω", "omega", "vel", "velocity", "speed", "dt")
# Signs of other languages in a relation, and their corrections.
_IN_RELATIONS = {
    "==": "write `=`",
    "=": "write 0",
    "<": "write `<=`",
    ">": "write `>=`",
    **dict.fromkeys("≈≡→≃", "write `=`"),
    **dict.fromkeys(("!=", "<>"), "a relation is written with `=`, `>=` or `<=`"),
}


def _filled(meant: Meant, found: re.Match[str]) -> str:
    if isinstance(meant, str):
        return meant.format(*found.groups())
    return meant(found)


# Largest number of corrections in one expression.
MOST_STEPS = 20
# The correction in a hint, before its reason.
_WRITTEN = (
    r"(?:leave `.*` out|delete it.*)()(: [a-z].*)?|"
    r"(?:write|(?:the|a) [a-z ]+ is written) `?(.+?)`?"
    r"(: [a-z].*|, (?:without|in|or) .*|; .*| for .*)?"
)


def of_text(
    text: str,
    parser: Parser,
    known: Collection[str],
    moving: Collection[str],
    *,
    beside: bool = False,
) -> str:
    """Return a hint for an expression with faults: the corrected expression, or a part.

    The correction of each fault is inserted until no fault is left. If that fails, the
    hint is that for the first fault.

    known : variables of the file.
    moving : the variables that have rates.
    beside : whether the expression is the value of a parameter or a definition, which
        can have a unit.
    """
    first, reason, short = "", "", len(text) <= WINDOW
    given, text = text, _typed(text, known) if short else text
    typed = text
    for step in range(MOST_STEPS if short else 1):
        try:
            found = _renaming(text, parser(text).names, known, moving)
            if found is None:
                return f"write {text.strip()}{reason}" if text != given else first
        except ExpressionError as fault:
            near = matching(text, fault.offset, known)
            unit = (
                "" if step or near else _of_quantity(text, fault, known, beside=beside)
            )
            if unit:
                return unit
            token = text[fault.offset : fault.offset + fault.length] or text[-1:]
            own = parser is parse_relation and _IN_RELATIONS.get(token)
            own_hint = fault.offset, fault.offset + fault.length, own or ""
            found = own_hint if own else _step(text, fault, known, moving)
        first = first or found[2]
        written = re.fullmatch(_WRITTEN, found[2])
        if not written or "..." in found[2]:
            break
        reason = reason or written[2] or written[4] or ""
        last = found[2].startswith("a product")
        text = _replaced(text, found[0], found[1], written[3] or "", last=last)
    return first if typed == given else f"write {typed.strip()}"


def _typed(text: str, known: Collection[str]) -> str:
    """Return an expression in lagsim's notation, from LaTeX or with typographic signs.

    The text itself is returned if it has no such notation.

    known : names, which stay as they are where they have letters beyond ASCII.
    """
    words = (w[0] for w in re.finditer(r"[^\W\d_]\w*", text) if not w[0].isascii())
    if not any(_is_known(word, known) for word in words):
        text = unicodedata.normalize("NFD", text.replace("≠", "!="))
    row, before = 0, text
    while row < len(_TYPED):
        pattern, new = _TYPED[row]
        found = re.search(pattern, text)
        if found:
            text = _replaced(text, found.start(), found.end(), _filled(new, found))
        row = 0 if found else row + 1
    if text == before:
        return text
    text = " ".join(unicodedata.normalize("NFKC", text).split())
    return re.sub(r"(?<=\() | (?=[)^*/])|(?<=[*/]) ", "", text)


def _replaced(text: str, start: int, end: int, new: str, *, last: bool = False) -> str:
    """Replace text[start:end] by `new`, with the parentheses and `*` needed.

    last : whether a power after the part belongs to its last factor only.
    """
    before, after = text[:start], text[end:]
    left, right = before.rstrip()[-1:], after.lstrip()[:1]
    level = re.sub(rf"\({_INSIDE}\)", "", new) if re.match(r"-?[\w(]", new) else ""
    tight = left in ("/", "^") or (right == "^" and not last)
    tight |= bool(re.search("[-+]", level) and {left, right} & {*"*/-"})
    new = f"({new})" if tight and re.search("[-+*/]", level) else new
    if re.search(r"[\w)]$", before) and re.match(r"[^\W_]|\(", new):
        new = f"*{new}"
    if re.search(r"[\w)]$", new) and re.match(r"[^\W_]", after):
        new = f"{new}*"
    return before + new + after


_LIST = re.compile(r"\[([^\[\]]*)\]")


def _step(
    text: str, fault: ExpressionError, known: Collection[str], moving: Collection[str]
) -> tuple[int, int, str]:
    """Return begin and end of a part of a text to replace, and the hint on it.

    The hint has the replacement in backquotes.

    fault : the fault of the text that the replacement mends.
    known, moving : see `of_text`.
    """
    offset, end, hint = fault.offset, fault.offset + fault.length, fault.hint
    token = text[offset:end]
    if "only its right side" in hint:
        return 0, end, "leave `=` out: only its right side"
    commas = [m.start() for m in re.finditer(",", text)] * (
        fault.code == EXPRESSION_ARITY
    )
    for at in (*commas, offset):
        if found := matching(text, at, known):
            return found
    if special := _special(text, offset, end):
        return special
    if fault.code == EXPRESSION_UNKNOWN_FUNCTION:
        return of_function(text, fault, known, moving)
    if "product" in hint:
        digits = re.match(NUMBER, token) if fault.code == EXPRESSION_NUMBER else None
        at = offset + digits.end() if digits else offset
        words = quantities.names_in(text[:at])[-1:] + quantities.names_in(text[at:])[:1]
        if all(_called_so(w, known) or of_name(w, known, moving) for w in words):
            return len(text[:at].rstrip()), at, "write *: there is no implicit product"
        if re.match(r"[^\W\d]", token) and not _is_known(token, known):
            hint = f"an operator is expected before a name, and `{token}` is none here"
    elif left := re.match(r"leave `(.+?)` out", hint):
        offset = text.rindex(left[1], 0, end)
    return offset, end, hint * (token != ",")


def _renaming(
    text: str, names: Iterable[Name], known: Collection[str], moving: Collection[str]
) -> tuple[int, int, str] | None:
    """Return a hint for the first unknown name that is another spelling of a name.

    The result is (begin, end, hint), with the position of the name in the text; None if
    there is no such name.

    known, moving : see `of_text`.
    """
    unknown = (name for name in names if not _is_known(name.text, known))
    for name in islice(unknown, MOST_STEPS):
        if found := matching(text, name.offset, parsed=True):
            return found
        plain = _called_so(name.text, known)
        hint = f"write {plain}" if plain else of_name(name.text, known, moving)
        if re.fullmatch(_WRITTEN, hint):
            return name.offset, name.offset + len(name.text), hint
    return None


def matching(
    text: str, offset: int, known: Collection[str] = (), *, parsed: bool = False
) -> tuple[int, int, str] | None:
    """Return a hint for the first known misspelling around an offset.

    The result is (begin, end, hint), with the position of the misspelling in the text;
    None if there is none.

    known : names of variables, which are no calls.
    parsed : whether to search only spellings that are valid, but have another meaning
        in lagsim.
    """
    first = max(0, offset - WINDOW)
    near, offset = text[first : offset + WINDOW], offset - first
    for pattern, meant in _SPELLINGS:
        if parsed and meant is not _exponential and pattern not in _PARSED:
            continue
        for found in re.finditer(pattern, near):
            if meant is _call and found[1] in known:
                continue
            at = found.start() <= offset <= found.end()
            if at and (hint := _filled(meant, found)):
                return first + found.start(), first + found.end(), hint
    return None


def _of_quantity(
    text: str, fault: ExpressionError, known: Collection[str], *, beside: bool
) -> str:
    """Return a hint for a text that is a number, or `1/2`, with a unit after it.

    "" for other texts.

    fault : the parser's fault.
    beside : see `of_text`.
    """
    found = re.fullmatch(_QUANTITY, text)
    number, unit = text[: fault.offset].strip(), text[fault.offset :]
    if found and found[2]:
        number, unit = found[1].replace(" ", ""), found[2]
        unit += ")" * (unit.count("(") > unit.count(")"))
    own = [] if found else quantities.names_in(number)
    names = quantities.names_in(unit := quantities.unit_spelling(unit))
    product = all(_is_known(name, known) for name in names)
    alone = found and len(names) == 1 and not product
    sound = quantities.is_unit(unit) or (alone and not of_name(names[0], known, ()))
    ends = re.search(rf"(?:[-+*/^,]|\b(?:{CALLED}))$|\([^)]*$|^$", number)
    unknown = not all(_is_known(name, known) for name in own) or (product and own)
    if ends or unknown or unit[:1] == "," or not sound:
        return ""
    hint = quantities.quantity(number, unit, beside=beside)
    if product and (len(names) > 1 or unit not in FUNCTIONS):
        hint = f"{hint}; " if len(names) == 1 else ""
        return f"{hint}a product is written {number}*{unit}"
    return hint


def _is_known(name: str, known: Collection[str]) -> bool:
    base = name.removesuffix("_ddot").removesuffix("_dot")
    return base in known or name in ("pi", "t") or name in FUNCTIONS


def _inertia(values: str) -> str:
    """Return a hint for a list as the first argument of `spin`."""
    parts = [part.strip() for part in values.split(",")]
    if len(parts) == 3:
        return f"write vec({', '.join(parts)})"
    return f"name it in `parameters`, J: [{values}], and write spin(J, ...)"


def _special(text: str, offset: int, end: int) -> tuple[int, int, str] | None:
    """Return begin, end and hint for some mistaken calls; None for other calls.

    These are a list as argument of `spin`, a delay `x(t - 1)`, and a call without
    arguments of a name that is no function.
    """
    token, before = text[offset:end], text[:offset].rstrip()
    listed = _LIST.match(text[offset:])
    if listed and before.endswith("spin("):
        return offset, offset + listed.end(), _inertia(listed[1])
    if token == "(" and re.match(r"\(\s*t\s*[-+]", text[offset:]):
        return offset, end, DELAY
    called = re.search(r"(\w+)\($", before)
    if token == ")" and called and (hint := _no_function(called[1])):
        return offset, end, hint
    return None


def _moves(name: str, moving: Collection[str]) -> bool:
    """Whether a name is one of `moving`, the variables that have rates, or a rate."""
    return name.removesuffix("_ddot").removesuffix("_dot") in moving


def _meant_by_call(name: str, argument: str, moving: Collection[str]) -> str:
    """Return a hint for a call such as `diff(x)` of another language; else "".

    name, argument : the name and the argument of the call.
    moving : names that have rates.
    """
    if name.casefold() == "sqr" and argument:  # of Pascal, and of Basic
        square = spelt_call("square", argument)
        return f"write {square} for the square, sqrt({argument}) for the root"
    if meant := spelt_call(name, argument):
        return f"write {meant}"
    if re.match(r"t\s*[-+]", argument) and _moves(name, moving):
        return DELAY
    return _no_function(name)


def _no_function(name: str) -> str:
    """Return the advice for a call of a name that has no counterpart here; else ""."""
    return next((hint for words, hint in _NO_FUNCTIONS if words.fullmatch(name)), "")


def of_function(
    text: str, fault: ExpressionError, known: Collection[str], moving: Collection[str]
) -> tuple[int, int, str]:
    """Return begin, end and hint for the call of an unknown function.

    fault : the parser's fault at the call.
    known, moving : see `of_text`.
    """
    offset, end = fault.offset, fault.offset + fault.length
    name = text[offset:end]
    hint = f"name an expression in `definitions` and write `{name}` alone, or give a "
    hint += "curve in `tables`: no other functions can be added"
    call = re.match(rf"\s*\({_INSIDE}\)?", text[end:])
    argument = call[1].strip() if call else ""
    until = end + (call.end() if call else 0)
    if meant := _meant_by_call(name, argument, moving):
        return offset, until, meant
    if argument in ("0", "t0", "t=0") and _moves(name, moving):
        return offset, until, f"give the start value of {name} a name in `parameters`"
    if _is_known(name, known) or name.casefold() in _NUMBERS:
        plain = name if name in known else name.casefold()
        if argument in ("", "t"):
            return offset, until, f"write {plain}, without `({argument})`"
        return offset, until, f"a product is written {name}*({argument})"
    near = re.match("did you mean `(.+)`", fault.hint)
    base = name.rstrip("0123456789")
    for function in FUNCTIONS:
        factor = name.removesuffix(function)
        if factor != name and _is_known(factor, known):
            hint = f"write {factor}*{function}({argument})"
    if parts := _parts(name, known):
        hint = f"write {'*'.join(parts)}*({argument})"
    elif base != name and base in FUNCTIONS:
        hint = f"write {base}({argument})^{name.removeprefix(base)}"
    elif near and not hint.startswith("write"):
        return offset, end, f"write {near[1]}"
    return offset, until, hint


# Words that mean something in some places only.
_WORDS = {
    "bodies": "`kinetic` and `potential` have this word, in a file with `bodies`",
    "slip_speed": "the `friction` of a contact has this name",
    "approach_speed": "the `restitution` of a contact has this name",
}


def of_name(name: str, known: Collection[str], moving: Collection[str]) -> str:
    """Return a hint for an unknown name; "" if there is none.

    known, moving : see `of_text`.
    """
    if name.casefold() in _NUMBERS:
        return _NUMBERS[name.casefold()]
    if name in _WORDS:
        return _WORDS[name]
    if len(name) > WINDOW:
        return ""
    if rate := rate_spelling(name, moving):
        ordinal = "second " if rate.endswith("_ddot") else ""
        return f"the {ordinal}rate is written {rate}"
    if name.casefold() == "time" and moving:
        return "the time is `t`"
    if name in SPEEDS and moving:
        rate = f"a rate is written {next(iter(moving))}_dot"
        return f"{rate}; a constant speed is a value in `parameters`"
    for function in FUNCTIONS:
        head, _, rest = name.partition(function)
        factor = rest[: len(rest) - len(rest.lstrip("0123456789"))]
        inside = _called_so(rest.removeprefix(factor), known)
        before = [head] if not head or _is_known(head, known) else _parts(head, known)
        if before and (inside or (factor and factor == rest)):
            argument = "*".join(filter(None, (factor, inside)))
            return f"write {'*'.join([*filter(None, before), function])}({argument})"
    base = name.rstrip("23456789")
    if len(name) - len(base) == 1 and _is_known(base, known) and base != "t":
        return f"a power is written {base}^{name.removeprefix(base)}"
    parts = _parts(name, known)
    return f"a product is written {'*'.join(parts)}" if parts else ""


def _called_so(name: str, known: Collection[str]) -> str:
    """Return the variable that a name in Greek or Latin letters denotes; else "".

    known : variables of the file.
    """
    if _is_known(name, known):
        return name
    plain = spelt_out(name).replace("_", "")
    similar = (x for x in known if plain and spelt_out(x).replace("_", "") == plain)
    return next(similar, "")


def _parts(name: str, known: Collection[str]) -> list[str]:
    """Return the two or more variables whose names, joined, are `name`; else [].

    known : variables of the file.
    """
    if 1 < len(known) <= MOST_PARTS and len(name) <= WINDOW:
        several = sorted(map(re.escape, known), key=len, reverse=True)
        one = f"(?:{'|'.join(several)})(?:_dot)?"
        parts = re.findall(one, name)
        if re.fullmatch(f"(?:{one}){{2,4}}", name) and len(set(parts)) == len(parts):
            return parts
    return []


def rate_spelling(name: str, moving: Collection[str]) -> str:
    """Return the rate that another spelling denotes, as `x_dot` for `xdot`; else "".

    moving : variables that have rates.
    """
    if len(name) > WINDOW:
        return ""
    name = _typed(name, moving)
    for ending, spellings in _RATES.items():
        for pattern in spellings:
            match = re.fullmatch(pattern, name, re.IGNORECASE)
            if match and (base := _called_so(match[1], moving)):
                return base + ending
    return ""


def rate_within(text: str, moving: Collection[str]) -> str:
    """Return the rate that a text denotes, such as `d/dt x`, or an empty text.

    moving : variables that have rates.
    """
    hint = of_text(text[:WINDOW], parse, moving, moving)
    found = re.match(r"write ((.+)_dd?ot)\b", hint)
    return found[1] if found and found[2] in moving else ""


def spelt_out(name: str) -> str:
    """Return a name in lower case, with Greek letters by their names.

    Examples
    --------
    >>> spelt_out("θ")
    'theta'
    """
    if name.isascii():
        return name.casefold()
    full = {x: unicodedata.name(x, "") for x in name if x > "\x7f"}
    greek = {x: n.split()[-1] for x, n in full.items() if n.startswith("GREEK ")}
    return "".join(greek.get(x, x) for x in name).casefold()


# --- Hints for keys, mappings and lists


def of_key(key: Scalar, value: Node, given: list[Entry], known: Collection[str]) -> str:
    """Return a hint for an unknown key whose meaning can be guessed; else "".

    Examples are a count of rows in place of `output_step`, a missing colon, or a unit.

    given : the entries of the mapping.
    known : the valid keys.
    """
    name, keys = key.text.casefold(), [k.text for k, _ in given]
    if "output_step" in known and name in SPANS:
        return quantities.span(value) or "write `start: ...` and `end: ...`"
    if "output_step" in known and name in COUNTS:
        texts = {k.text: v.text for k, v in given if isinstance(v, Scalar)}
        length = texts.get("duration", texts.get("end", "duration"))
        if "start" in texts and "duration" not in texts:
            length = f"({length} - {texts['start']})"
        length = "1" if name == "fps" else length
        return (
            f"write `output_step: {length}/{node_text(value)}`: the spacing of the rows"
        )
    two_words = re.fullmatch(r"(\w+)\s*(?:\s|=)\s*(\S.*)", key.text)
    if two_words and two_words[1] in known and not node_text(value):
        return f"a colon is missing: `{two_words[1]}: {two_words[2]}`"
    if "y2" in known and not node_text(value) and len(given) > 1:
        before, first = given[max(1, given.index((key, value))) - 1]
        both = f"{node_text(first)}, {key.text}"
        kept = f'"{both}"' if before.text == "title" else f"[{both}]"
        return f"write `{before.text}: {kept}`"
    place = texts_of(items_of(value))
    if "links" in known and len(place) in (2, 3) and name not in KEYS:
        return f"`{key.text}` belongs below `points:`, indented"
    if node_text(value) or "unit" not in known or "unit" in keys:
        return ""
    if quantities.is_unit(name) and not re.match(r"\d", name):
        return f"write `unit: {key.text}`"
    number = re.fullmatch(rf"({NUMBER})\s*(.*)", name)
    after = number and (number[2] or "".join(keys[keys.index(key.text) + 1 :][:1]))
    if "value" not in known or not number or not after:
        return ""
    unit = after if quantities.is_unit(after) else "..."
    return f"write {{value: {number[1]}, unit: {unit}}}"


# Values in the place of a mapping: its name, a pattern, and the correction.
_INSTEAD = (
    ("a plot", rf"{_NAME} (?:vs\.?|versus|over|against) {_NAME}\Z",
     "write {{x: {1}, y: {0}}}"),
    ("a plot", rf"\(?{_NAME},\s*{_NAME}\)?\Z", "write {{x: {0}, y: {1}}}"),
    ("a plot", rf"{_NAME}\Z", "write {{x: t, y: {0}}}"),
    ("the coordinate", rf"{_NAME}\Z", "write {{unit: {0}}}"),
    ("`forces`", r"(\w+)(?:,\s*|\s+)([^,]+)\Z", "write {{{0}: {1}}}"),
    ("`constraints`", "([^,]*=[^,]*)", "write `name: {0}`, with a name of your own"),
    ("`energy`", "(.+)", "write {{lagrangian: {0}}}"),
    ("", r"(\w+)\s*=\s*([^=\s].*)", "a colon is missing: `{0}: {1}`"),
    ("", r"([^\s:]+):([^\s:]\S*)",
     "a space is missing after the colon: `{0}: {1}`"),
    ("", rf"{_NAME}\s+([^\s:=]+)\Z", "a colon is missing: `{0}: {1}`"),
)  # fmt: skip


def of_lines(node: Node, label: str) -> str:
    """Return a hint for a YAML node that should be a mapping with a line per entry.

    label : name of the mapping in messages.
    """
    parts = (part for item in items_of(node) for part in items_of(item))
    text = ", ".join(texts_of(parts))
    if label == "`coordinates`" and re.fullmatch(rf"{_NAME}(?:[\s,]+{_NAME})*", text):
        names = re.split(r"[\s,]+", text)
        return f"write {{{', '.join(f'{name}: {{}}' for name in names)}}}"
    for of, pattern, written in _INSTEAD:
        found = re.match(pattern, text) if label.startswith(of) else None
        if found and (of or isinstance(node, Scalar)):
            return written.format(*found.groups())
    advice = "write lines `name: value`, without the `-` or brackets of a list"
    return advice if isinstance(node, Sequence) else ""


def as_list(node: Node, label: str = "") -> str:
    """Return a hint that spells a YAML node as a list.

    label : the name of the node in messages.
    """
    if isinstance(node, Mapping):
        pairs = [(key.text, node_text(value)) for key, value in node.entries]
        if not any(text for _, text in pairs):
            return f"write [{', '.join(key for key, _ in pairs)}]"
        if "link" in label:
            links = ", ".join(f"[{a}, {b}]" for a, b in pairs)
            return f"write [{links}]" if label == "`links`" else f"write {links}"
        return f"write [{{{', '.join(f'{a}: {b}' for a, b in pairs)}}}]"
    text = node.text.strip() if isinstance(node, Scalar) else ""
    if text == "all":
        return "delete it: all are there without it"
    if text[:1] + text[-1:] in ("()", "[]"):
        text = text[1:-1]
    return f"write [{' '.join(text.split())}]" if text else "a list is written [a, b]"


def node_text(node: Node) -> str:
    """Return the text of a scalar, the items of a list with commas, else `...`."""
    if isinstance(node, Sequence):
        return ", ".join(map(node_text, node.items))
    return node.text if isinstance(node, Scalar) else "..."
