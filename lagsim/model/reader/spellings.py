"""How functions, numbers and units are spelt elsewhere, and what they are here."""

from __future__ import annotations

import re

from lagsim.language.functions import FUNCTIONS

NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
RADIANS = "angles are in radians"

# Functions that have another name here, in small letters.
_RENAMED = {
    "ln": "log",
    "lg": "log10",
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "arctan2": "atan2",
    "arctg": "atan",
    "arcsinh": "asinh",
    "arccosh": "acosh",
    "arctanh": "atanh",
    "arsinh": "asinh",
    "arcosh": "acosh",
    "artanh": "atanh",
    "tg": "tan",
    "sh": "sinh",
    "ch": "cosh",
    "th": "tanh",
    "sgn": "sign",
    "signum": "sign",
    "fabs": "abs",
    "maximum": "max",
    "minimum": "min",
    "fmax": "max",
    "fmin": "min",
    "h": "heaviside",
    "step": "heaviside",
    "unitstep": "heaviside",
    "ceiling": "ceil",
}
# Functions that are written with others.
_REWRITTEN = {
    "log2": "log(x)/log(2)",
    "log1p": "log(1 + x)",
    "expm1": "exp(x) - 1",
    "exp2": "2^x",
    "pow": "a^b",
    "power": "a^b",
    "square": "x^2",
    "sqr": "x^2",
    "root": "x^(1/n)",
    "sec": "1/cos(x)",
    "csc": "1/sin(x)",
    "cot": "1/tan(x)",
    "ctg": "1/tan(x)",
    "mod": "x - y*floor(x/y)",
    "fmod": "x - y*floor(x/y)",
    "round": "floor(x + 0.5)",
    "int": "sign(x)*floor(abs(x))",
    "trunc": "sign(x)*floor(abs(x))",
    "clip": "max(a, min(x, b))",
    "clamp": "max(a, min(x, b))",
    "norm": "hypot(x, y)",
    "where": "if(condition, a, b)",
    "ifelse": "if(condition, a, b)",
    "piecewise": "if(condition, a, b)",
    "deg2rad": f"x*pi/180: {RADIANS}",
    "radians": f"x*pi/180: {RADIANS}",
    "rad": f"x*pi/180: {RADIANS}",
    "deg": f"x*pi/180: {RADIANS}",
    "rad2deg": "x*180/pi",
    "degrees": "x*180/pi",
}
# Keys of the file that are called otherwise elsewhere, in small letters.
KEYS = {
    **dict.fromkeys(("constants", "params", "consts", "given"), ("parameters",)),
    **dict.fromkeys(
        ("variables", "vars", "dof", "dofs", "generalized_coordinates", "q"),
        ("coordinates",),
    ),
    **dict.fromkeys(
        ("initial_conditions", "initial_state", "initial_values", "ic", "ics"),
        ("initial",),
    ),
    **dict.fromkeys(("t", "ke", "ekin", "kinetic_energy"), ("kinetic", "duration")),
    **dict.fromkeys(("v", "u", "pe", "epot", "potential_energy"), ("potential",)),
    **dict.fromkeys(("l", "lagrange", "lagrange_function"), ("lagrangian",)),
    **dict.fromkeys(("d", "r", "rayleigh", "friction", "damping"), ("dissipation",)),
    **dict.fromkeys(("time", "tmax", "t_max", "length"), ("duration",)),
    **dict.fromkeys(
        ("t_end", "tend", "tf", "stop", "tstop", "t_stop", "t_final"), ("end",)
    ),
    **dict.fromkeys(("t0", "t_start", "begin"), ("start",)),
    **dict.fromkeys(
        ("dt", "timestep", "time_step", "sampling", "fps", "n"),
        ("output_step", "step"),
    ),
    **dict.fromkeys(("tol", "tolerance", "reltol", "precision"), ("rtol",)),
    **dict.fromkeys(("abstol",), ("atol",)),
    **dict.fromkeys(("solver", "integrator", "scheme"), ("method",)),
    **dict.fromkeys(("units", "dimension"), ("unit",)),
    **dict.fromkeys(("help", "comment", "text", "label"), ("description",)),
    **dict.fromkeys(("eq", "equation", "expression", "expr"), ("relation", "value")),
    **dict.fromkeys(("mu",), ("friction",)),
    **dict.fromkeys(("e", "bounce"), ("restitution",)),
    **dict.fromkeys(("lines", "rods"), ("links",)),
    **dict.fromkeys(("masses", "bodies"), ("points",)),
}
# What gives a rate, of its first argument.
RATES = ("d", "D", "der", "deriv", "derivative", "Derivative", "diff", "Diff", "dot")
# Every name that stands for a function somewhere, the longest first.
CALLED = "|".join(
    sorted((*FUNCTIONS, *_RENAMED, *_REWRITTEN), key=lambda name: -len(name))
)
MODULES = "np|numpy|jnp|math|Math|cmath|sp|sympy|torch|std"

# Units that are often names of variables too.
_UNITS = (
    "m|g|s|N|J|W|K|A|V|C|T|F|H|h|l|rad|deg|Pa|Hz|bar|Ohm|ohm|mol|L|lb|ft|rpm|"
    "sec|seconds?|minutes?|hours?|days?|met(?:re|er)s?|grams?|newtons?|joules?|watts?"
)
_UNIT = re.compile(rf"(?:da|[yzafpnuµμmcdhkMGT]|kilo)?(?:{_UNITS})|min|hr|kgf|lbf")
# What a number of them is in the units of the SI: units themselves never scale.
_SCALED = {
    "ms": ("/1000", "s"),
    "us": ("/1e6", "s"),
    "µs": ("/1e6", "s"),
    "μs": ("/1e6", "s"),
    "min": ("*60", "s"),
    "minute": ("*60", "s"),
    "minutes": ("*60", "s"),
    "h": ("*3600", "s"),
    "hr": ("*3600", "s"),
    "hour": ("*3600", "s"),
    "hours": ("*3600", "s"),
    "mm": ("/1000", "m"),
    "cm": ("/100", "m"),
    "km": ("*1000", "m"),
    "kN": ("*1000", "N"),
    "kHz": ("*1000", "Hz"),
    "kPa": ("*1000", "Pa"),
    "MPa": ("*1e6", "Pa"),
    "GPa": ("*1e9", "Pa"),
}
_WORD = re.compile(r"[^\W\d_]\w*")


def function(name: str) -> str:
    """Give the name that a function has here, or an empty text."""
    small = name.casefold()
    found = _RENAMED.get(small, small)
    return found if found in FUNCTIONS else ""


def rewritten(name: str) -> str:
    """Give what is written for a function that is known elsewhere, or nothing."""
    small = name.casefold()
    return _REWRITTEN.get(small, "") if small not in FUNCTIONS else ""


def call(name: str, arguments: str) -> str:
    """Give a call with the name that the function has here."""
    return f"{function(name) or name}({arguments})"


def words(text: str) -> list[str]:
    """Give the names in a text."""
    return _WORD.findall(text)


def is_unit(text: str) -> bool:
    """Tell whether a text looks like a unit: each word of it does."""
    found = words(unit(text))
    return bool(found) and all(map(_UNIT.fullmatch, found))


def unit(text: str) -> str:
    """Give a unit as it is written: powers by `^`, products by `*`."""
    for letter, plain in (("²", "^2"), ("³", "^3"), ("·", "*"), ("⋅", "*")):
        text = text.replace(letter, plain)
    return re.sub(r"\s*([*/^])\s*", r"\1", text.strip(" .")).replace(" ", "*")


def quantity(number: str, of: str) -> str:
    """Say how a number with a unit is written."""
    of = unit(of)
    if of in _SCALED:
        factor, plain = _SCALED[of]
        return (
            f"write {number}{factor}, in {plain}, or {number} where all is in {of}: "
            "units never scale numbers"
        )
    return (
        f"write {number}; the unit of a parameter stands beside its number: "
        f"{{value: {number}, unit: {of}}}"
    )
