"""Methods and commands beside each physical feature: refusals and their reasons."""

from __future__ import annotations

from math import pi, sin

from tests.scenes.pairs.physical import CHAIN
from tests.scenes.pairs.scene import HOLDS_AT_TIMES

ALONE = "constraints that hold at times need a method that evaluates y' only"
CONSTRAINTS = "it has constraints"
BETWEEN_VELOCITIES = "it has constraints between velocities"
OF_VELOCITIES = "its forces depend on the velocities"
STEADY = "the model has constraints that hold at times: a stability limit belongs to"
GAUSS = (
    "`output.gauss` requires the accelerations without constraints, M^-1 f, and the "
    "mass matrix of this model is singular"
)
BY_LOOPS = "its equations are solved by loops"
_HELD = {
    "corner": CONSTRAINTS,
    "holonomic": CONSTRAINTS,
    "rheonomic": CONSTRAINTS,
    "redundant": CONSTRAINTS,
    "Pfaffian": BETWEEN_VELOCITIES,
    "nonlinear velocity constraint": BETWEEN_VELOCITIES,
}
_LAWS = dict.fromkeys(HOLDS_AT_TIMES, ALONE)
_SWITCHES = (
    "switch in the state", "two switches", "switch within a switch", "sliding"
)  # fmt: skip
_POSITIONS = ("corner", "holonomic", "rheonomic", "redundant", "singular M")
_VELOCITIES = ("Pfaffian", "nonlinear velocity constraint")
_EXPLICIT = {**_LAWS, **_HELD, "sliding": OF_VELOCITIES}
# Method -> feature -> the reason of the refusal.
METHODS: dict[str, dict[str, str]] = {
    "dop853": {},
    "dopri5": {},
    "euler": {},
    "gauss4": {**_LAWS, **_HELD},
    "generalized-alpha": _LAWS,
    "kahan-li6": _EXPLICIT,
    "kahan-li8": _EXPLICIT,
    "midpoint": {**_LAWS, **_HELD},
    "moreau": {},
    "radau": _LAWS,
    "rattle": {
        "sliding": OF_VELOCITIES,
        "Pfaffian": BETWEEN_VELOCITIES,
        "nonlinear velocity constraint": BETWEEN_VELOCITIES,
    },
    "rk4": {},
    "taylor": {**_LAWS, "redundant": BY_LOOPS},
    "verlet": _EXPLICIT,
}
# Degrees of freedom: coordinates less the rank of what holds both ways and does not
# slip at the start.
FREEDOM = {
    "friction on one slip": 2, "friction on the disc": 3, "groove": 2, "ridge": 2,
    "limit": 0, "when": 0,
    "rheonomic": 0, "Pfaffian": 2, "many coordinates": 20,
}  # fmt: skip

_FREE = ("smooth", "ignorable", "switch in t", *_SWITCHES, "until", "event")
_FREE += ("events at one time", "impulse at an event", "sections and strobes")
_FREE += ("many coordinates",)
NO_CONSTRAINTS = dict.fromkeys(_FREE, "the model has no constraints")
AT_TIMES = "the model has constraints that hold at times"
_AT_TIMES = dict.fromkeys(HOLDS_AT_TIMES, AT_TIMES)
NO_FACTOR = "no coordinate has in ... a factor that is constant and not 0"
UNENFORCED = "the model has constraints; `drift` integrates without enforcement"
# Formulation -> feature -> the reason of the refusal.
FORMULATIONS: dict[str, dict[str, str]] = {
    "full": {},
    "none": {**_AT_TIMES, **dict.fromkeys((*_POSITIONS, *_VELOCITIES), UNENFORCED)},
    "projection": NO_CONSTRAINTS,
    "velocity projection": {
        **NO_CONSTRAINTS,
        **_AT_TIMES,
        **dict.fromkeys(_POSITIONS, "constraints are on positions"),
    },
    "elimination": {
        **NO_CONSTRAINTS,
        **_AT_TIMES,
        **dict.fromkeys(("corner", "holonomic", *_VELOCITIES), NO_FACTOR),
        "redundant": "constraints are redundant",
    },
    "baumgarte": {**NO_CONSTRAINTS, **_AT_TIMES},
    "drift": {**NO_CONSTRAINTS, **_AT_TIMES},
}
# Command, or key of `output` -> feature -> the reason of the refusal.
COMMANDS: dict[str, dict[str, str]] = {
    "check": {}, "sweep": {}, "golden": {}, "run --resume": {}, "run --animate": {},
    "bench": {}, "stability": dict.fromkeys(HOLDS_AT_TIMES, STEADY), "derive": {},
    "action": {}, "gauss": {"singular M": GAUSS}, "reactions": {},
}  # fmt: skip
# A change by some millionths that goldens are to see: the text, and what it becomes.
CHANGED = {
    "smooth": ("2*x1^2", "2.00001*x1^2"),
    "ignorable": ("0.7", "0.700005"),
    "switch in t": ("t < 0.37", "t < 0.370003"),
    "switch in the state": ("-16*x1", "-16.0001*x1"),
    "two switches": ("x1 - 0.4", "x1 - 0.400005"),
    "switch within a switch": ("mod(x1, 0.4)", "mod(x1, 0.400002)"),
    "sliding": ("0.5*sign", "0.500005*sign"),
    "until": ("x1 <= 0", "x1 <= 0.000005"),
    "event": ("x1 <= 0.2", "x1 <= 0.200002"),
    "events at one time": ("0.4*fast1", "0.400005*fast1"),
    "impulse at an event": ("x1: -0.3", "x1: -0.300002"),
    "sections and strobes": ("2*x1^2", "2.00001*x1^2"),
    "contact": ("restitution: 0.5", "restitution: 0.500005"),
    "friction on one slip": ("friction: 0.3", "friction: 0.300003"),
    "friction on the disc": ("friction: 0.2", "friction: 0.200002"),
    "limit": ("limit: 1.5", "limit: 1.500005"),
    "static and dynamic friction": ("dynamic: 0.9", "dynamic: 0.900005"),
    "freewheel": ("3*cos(3*t)", "3.00003*cos(3*t)"),
    "when": ("t < 0.6", "t < 0.600005"),
    "groove": ("abs(x1)/2", "abs(x1)/2.00001"),
    "ridge": ("-2*max", "-2.00001*max"),
    "corner": ("abs(x1)/2", "abs(x1)/2.00001"),
    "holonomic": ("1.3", "1.300005"),
    "rheonomic": ("0.1*sin", "0.100001*sin"),
    "Pfaffian": ("1.5", "1.500005"),
    "nonlinear velocity constraint": ("potential: (z1)", "potential: (1.00001*z1)"),
    "redundant": ("2*(x1^2", "2.00001*(x1^2"),
    "singular M": ("2*z1^2", "2.00001*z1^2"),
    "elimination": ("10*x1^2", "10.0001*x1^2"),
    "many coordinates": ("50*(", "50.0005*("),
}
# Where another tolerance is the same means, as of linear motion: another method.
_LINEAR = (
    "smooth", "ignorable", "until", "event", "events at one time",
    "impulse at an event", "sections and strobes", "contact",
    "friction on one slip", "limit",
    "static and dynamic friction", "freewheel", "when", "singular M",
    "many coordinates",
)  # fmt: skip
OTHER = dict.fromkeys(_LINEAR, "method: rk4, step: 0.0005")
_BEAT = (2j, -2j)
# Of the linearised motion at the start.
EIGENVALUES = {
    **dict.fromkeys(("ignorable", "switch in t", *_SWITCHES[1:]), (0.0, 0.0)),
    **dict.fromkeys(("until", "event", "events at one time"), (0.0, 0.0)),
    "impulse at an event": (0.0, 0.0),
    "holonomic": (0.0, 0.0),
    **dict.fromkeys(("smooth", "switch in the state", "elimination"), _BEAT),
    "sections and strobes": _BEAT,
    **dict.fromkeys(("redundant", "singular M"), _BEAT),
    "rheonomic": (),
    # Two directions and a place across; two speeds.
    "Pfaffian": 5 * (0.0,),
    # Two places, and the direction of the velocity: cos(d)/1.2 changes by -sin(d).
    "nonlinear velocity constraint": 3 * (0.0,),
    "many coordinates": tuple(
        sign * 20j * sin(k * pi / (2 * (CHAIN + 1)))
        for k in range(1, CHAIN + 1)
        for sign in (1, -1)
    ),
}
# What events have set by then.
MODES = {("event", 0.3): {"push1": -1.0}, ("event", 1.2): {"push1": 2.0}}
# What laws and switches do beside the derived equations, at times: their force on
# coordinates, and whether their row holds.
OUTSIDE: dict[tuple[str, float], tuple[dict[str, float], bool]] = {
    ("contact", 0.3): ({}, False),
    ("friction on one slip", 0.3): ({"x1": -0.3 * 9.81}, True),
    ("friction on the disc", 0.3): (
        {"x1": -0.8 * 0.2 * 9.81, "z1": -0.6 * 0.2 * 9.81},
        True,
    ),
    ("limit", 1.2): ({"x1": -1.5}, False),
    ("static and dynamic friction", 0.3): ({"x1": -0.9}, False),
    ("freewheel", 0.3): ({}, False),
    ("when", 1.2): ({}, False),
}
