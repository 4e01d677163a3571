"""How functions, numbers and units are spelt elsewhere, and what they are here."""

from __future__ import annotations

import re

from lagsim.language.functions import FUNCTIONS

RADIANS = "angles are in radians"
_WHOLE = re.compile(r"[\w.]+")

# Functions, and their names elsewhere, in small letters.
_NAMES = {
    "log": "ln",
    "log10": "lg",
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan arctg",
    "atan2": "arctan2",
    "asinh": "arcsinh arsinh",
    "acosh": "arccosh arcosh",
    "atanh": "arctanh artanh",
    "tan": "tg",
    "sinh": "sh",
    "cosh": "ch",
    "tanh": "th",
    "sign": "sgn signum",
    "abs": "fabs",
    "max": "maximum fmax",
    "min": "minimum fmin",
    "heaviside": "h step unitstep",
    "ceil": "ceiling",
}
_RENAMED = {name: own for own, names in _NAMES.items() for name in names.split()}
# Functions that are written with others: their arguments, and how.
_REWRITTEN = {
    "log2": ("x", "log(x)/log(2)"),
    "log1p": ("x", "log(1 + x)"),
    "expm1": ("x", "exp(x) - 1"),
    "exp2": ("x", "2^x"),
    "exp10": ("x", "10^x"),
    **dict.fromkeys(("pow", "power"), ("a b", "a^b")),
    **dict.fromkeys(("square", "sqr"), ("x", "x^2")),
    "cube": ("x", "x^3"),
    "rational": ("a b", "(a/b)"),
    "root": ("x n", "x^(1/n)"),
    "sec": ("x", "1/cos(x)"),
    "csc": ("x", "1/sin(x)"),
    **{f"{of}d": ("x", f"{of}(x*pi/180)") for of in ("sin", "cos", "tan")},
    **{f"a{of}d": ("x", f"a{of}(x)*180/pi") for of in ("sin", "cos", "tan")},
    **dict.fromkeys(("cot", "ctg", "cotan"), ("x", "1/tan(x)")),
    **dict.fromkeys(("acot", "arccot"), ("x", "atan2(1, x)")),
    **dict.fromkeys(("mod", "fmod", "rem"), ("x y", "x - y*floor(x/y)")),
    "round": ("x", "floor(x + 0.5)"),
    **dict.fromkeys(("int", "trunc", "fix"), ("x", "sign(x)*floor(abs(x))")),
    **dict.fromkeys(("clip", "clamp"), ("x a b", "max(a, min(x, b))")),
    "norm": ("x y", "hypot(x, y)"),
    **dict.fromkeys(
        ("where", "ifelse", "iif", "ite", "cond", "piecewise"),
        ("condition a b", "if(condition, a, b)"),
    ),
    **dict.fromkeys(("deg2rad", "radians", "rad", "deg"), ("x", "x*pi/180")),
    **dict.fromkeys(("rad2deg", "degrees"), ("x", "x*180/pi")),
}
_OF_ANGLES = ("deg2rad", "radians", "rad", "deg")
# Keys of the file, the likelier first, and how they are called elsewhere, in small
# letters.
_KEYS = {
    "parameters": "constants params consts given",
    "coordinates columns": "variables vars dof dofs generalized_coordinates q states",
    "definitions": "define functions expressions",
    "forces": "loads generalized_forces applied_forces",
    "simulation": "sim solve integration solver_options",
    "scene": "graphics drawing draw visualization animation geometry",
    "plots": "plot figures charts",
    "initial": "initial_conditions initial_state initial_values ic ics init x0",
    "kinetic duration": "t ke ekin kinetic_energy",
    "potential": "v u pe epot potential_energy",
    "lagrangian": "l lagrange lagrange_function",
    "dissipation": "d r rayleigh friction damping",
    "duration": "time tmax t_max length",
    "end": (
        "t_end tend tf t1 to stop tstop t_stop t_final tfinal final final_time "
        "stop_time end_time finish till"
    ),
    "start": "t0 t_start tstart start_time begin from",
    "output_step step": "dt timestep time_step sampling dt_out",
    "step": "h max_step",
    "until": "stop_when stop_condition event events terminate",
    "rtol": "tol tolerance reltol precision",
    "atol": "abstol",
    "method": "solver integrator scheme",
    "unit": "units dimension",
    "description": "help comment text label desc",
    "value": "default val",
    "relation value": "eq equation expression expr",
    "friction": "mu",
    "restitution": "e bounce cor restitution_coefficient",
    "links": "lines rods edges bars",
    "points": "masses bodies",
}
KEYS = {name: keys.split() for keys, names in _KEYS.items() for name in names.split()}
# Keys of counts, where a length is asked for here: no key has their values.
COUNTS = (
    "n", "steps", "nsteps", "n_steps", "num_steps", "number_of_steps", "output_steps",
    "samples", "points", "rows", "fps", "frames",
)  # fmt: skip
# Keys of two times.
SPANS = ("tspan", "t_span", "time_span", "t_range", "interval")
# What gives a rate, of its first argument.
RATES = ("d", "D", "der", "deriv", "derivative", "Derivative", "diff", "Diff", "dot")
# Every name that stands for a function somewhere, the longest first.
CALLED = "|".join(
    sorted((*FUNCTIONS, *_RENAMED, *_REWRITTEN), key=lambda name: -len(name))
)
MODULES = "np|numpy|jnp|math|Math|cmath|sp|sympy|torch|std"


def function(name: str) -> str:
    """Give the name that a function has here, or an empty text."""
    small = name.casefold()
    found = _RENAMED.get(small, small)
    return found if found in FUNCTIONS else ""


def rewritten(name: str, arguments: str = "") -> str:
    """Give what is written for a function that is known elsewhere, or nothing."""
    small = name.casefold()
    if small in FUNCTIONS or small not in _REWRITTEN:
        return ""
    names, text = _REWRITTEN[small]
    given = [part.strip() for part in arguments.split(",")] if arguments else []
    places = names.split()
    if len(given) == len(places):
        inside = {
            place: argument if _WHOLE.fullmatch(argument) else f"({argument})"
            for place, argument in zip(places, given, strict=True)
        }
        text = re.sub(rf"\b(?:{'|'.join(places)})\b", lambda m: inside[m[0]], text)
    return text + (f": {RADIANS}" if small in _OF_ANGLES else "")


def is_other(name: str) -> bool:
    """Tell whether a function of another name is called so elsewhere."""
    small = name.casefold()
    return small not in FUNCTIONS and (small in _RENAMED or small in _REWRITTEN)


def call(name: str, arguments: str) -> str:
    """Give a call with the name that the function has here."""
    return rewritten(name, arguments) or f"{function(name) or name}({arguments})"
