"""Physical features, each as a fragment of a model with the closed form of its motion.

A `$` in a fragment is replaced by the number of the fragment in its scene, so that two
fragments (or one twice) fit into one file. Masses are 1, times 0 to `DURATION`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tests.small_scenes import bounced

if TYPE_CHECKING:
    from collections.abc import Callable

DURATION = 2.0
CHAIN = 20


class Fragment(NamedTuple):
    """One feature: its sections of a model, and its motion.

    start : (x, x_dot) expressions of the first coordinate `x$`, which alone is
        transformed where two fragments are coupled
    more : name -> (start, rate) of the other coordinates
    motion : t (rows,) -> name -> positions (rows,), by closed form
    sections : further sections of the file: name -> text
    crossed : sections of the motion: name -> text, and the times of their rows
    """

    name: str
    start: tuple[str, str]
    motion: Callable[[Any], dict[str, Any]]
    potential: str = "0"
    kinetic: str = "x$_dot^2/2"
    more: dict[str, tuple[str, str]] = {}  # noqa: RUF012  (never changed)
    forces: dict[str, str] = {}  # noqa: RUF012
    constraints: dict[str, str] = {}  # noqa: RUF012
    modes: dict[str, str] = {}  # noqa: RUF012
    events: dict[str, str] = {}  # noqa: RUF012
    until: str = ""
    formulation: str = ""
    end: float = DURATION
    sections: dict[str, dict[str, str]] = {}  # noqa: RUF012
    crossed: dict[str, tuple[str, Any]] = {}  # noqa: RUF012

    def written(self, k):
        """Return sections of the file, with names and texts of the k-th fragment."""
        initial = {name: value for name, (value, _) in self.more.items()}
        initial |= {f"{name}_dot": rate for name, (_, rate) in self.more.items()}
        plain = {
            "coordinates": dict.fromkeys(self.more, "{}"), "initial": initial,
            "forces": {name: f'"{text}"' for name, text in self.forces.items()},
            "constraints": self.constraints, "modes": self.modes, "events": self.events,
        }  # fmt: skip
        return {
            section: {
                name.replace("$", str(k)): text.replace("$", str(k))
                for name, text in (
                    plain.get(section, {}) | self.sections.get(section, {})
                ).items()
            }
            for section in plain | self.sections
        }


def _parabola(t, at, x, v, a):
    return x + v * (t - at) + a * (t - at) ** 2 / 2


def _steps(t, x, v, force):
    """Return the motion under a force that is constant between its levels of x.

    Each piece is a parabola; it ends where x meets one of `force.levels`.
    """
    found = np.full(len(t), np.nan)
    at = 0.0
    while at <= DURATION:
        a = force(x, v)
        ends = [
            float(r.real)
            for level in force.levels
            for r in np.roots([a / 2, v, x - level])
            if abs(r.imag) < 1e-12 and r.real > 1e-9
        ]
        last = at + min(ends, default=DURATION + 1)
        piece = (t >= at) & (t <= last)
        found[piece] = _parabola(t[piece], at, x, v, a)
        x, v, at = _parabola(last, at, x, v, a), v + a * (last - at), last
    return found


def _two_switches(x, v):
    """Return the force of `two switches` at x; at a level, on the side of v."""
    x += 1e-6 * np.sign(v)
    return -np.sign(x) - 0.5 * np.sign(x - 0.4)


_two_switches.levels = (0.0, 0.4)


def _nested(x, v):
    """Return the force of `switch within a switch` at x; at a level, by v."""
    x += 1e-6 * np.sign(v)
    wide = 0.25 if x >= 0.6 else 0.15
    return 2.0 if x - 0.4 * np.floor(x / 0.4) < wide else -1.0


_nested.levels = (0.6, *(0.4 * k + c for k in range(-9, 9) for c in (0.0, 0.15, 0.25)))


def _bent(t):
    first, second = np.pi / 4, np.pi / 2
    return np.where(
        t < first,
        np.cos(2 * t),
        np.where(t < second, -np.sin(4 * (t - first)) / 2, np.sin(2 * (t - second))),
    )


def _bursts(t):
    """Return the motion from 0.3 under the pushes of `events at one time`."""
    x, v, found = 0.3, 0.0, np.full(len(t), np.nan)
    ends = (0.32, 0.5, 0.77, 1.0, 1.23, 1.5, 1.905, np.inf)
    at = 0.0
    for end, push in zip(ends, 2 * (2.0, 2.4, -1.6, -2.0), strict=True):
        piece = (t >= at) & (t <= end)
        found[piece] = _parabola(t[piece], at, x, v, push)
        x, v, at = _parabola(end, at, x, v, push), v + push * (end - at), end
    return found


def _kicked(t):
    """Return the motion from 0.2 at 0.5, with -0.3 each 0.62, and 0.7 at 0.3."""
    ends, x = (0.5, 0.62, 1.24, 1.86, np.inf), 0.2
    found, at = np.full(len(t), np.nan), 0.0
    for end, v in zip(ends, (0.2, 0.9, 0.6, 0.3, 0.0), strict=True):
        piece = (t >= at) & (t <= end)
        found[piece] = x + v * (t[piece] - at)
        x, at = x + v * (min(end, DURATION) - at), end
    return found


def _brake(t, v, a):
    s = np.minimum(t, v / a)
    return v * s - a * s * s / 2


def _stick_slip(t):
    """Return the motion from 0.3 by 1.2*t - 0.9, at rest from 0.5 to 1.25."""
    v, s, h = np.array([0.3, -0.9, 0.6]), np.minimum(t, 0.5), 1.25
    whole = np.polynomial.Polynomial(v).integ()
    later = np.maximum(t, h)
    again = 0.2 * (later**3 - h**3) - 0.6 * h**2 * (later - h)
    return whole(s) + again - 0.45 * (later - h) ** 2


def _freewheel(t):
    free, again = np.pi / 3, np.pi / 2
    s = np.minimum(t, free)
    return (1 - np.cos(3 * s)) / 3 + np.where(
        t > again, t - again - np.cos(3 * t) / 3, 0.0
    )


def _pushed(t):
    """Return the motion from 0.5 by -1, by 2 from 0.2 on, and by -1 again after 1.3."""
    hit = np.sqrt(0.6)
    up = _parabola(t, hit, 0.2, -hit, 2.0)
    x, v = _parabola(1.3, hit, 0.2, -hit, 2.0), -hit + 2.0 * (1.3 - hit)
    late = np.where(t < 1.3, up, _parabola(t, 1.3, x, v, -1.0))
    return np.where(t < hit, 0.5 - t**2 / 2, late)


def _chain(t):
    k = np.pi / (CHAIN + 1)
    beat = np.cos(2 * np.sin(k / 2) * 10 * t)
    return {
        ("x$" if i == 0 else f"c{i}$"): np.sin((i + 1) * k) * beat for i in range(CHAIN)
    }


def _names(i):
    return "x$" if i == 0 else f"c{i}$"


_STRETCHES = " + ".join(
    ["x$^2", f"{_names(CHAIN - 1)}^2"]
    + [f"({_names(i + 1)} - {_names(i)})^2" for i in range(CHAIN - 1)]
)


def _passing(t):
    """Return x on z = |x|/2 from rest at 1; the corner leaves 0.6 of the speed."""
    a, side = 0.4 * 9.81, 1.0
    at, v = np.sqrt(2 / a), np.sqrt(2 * a)
    found = 1 - a * t**2 / 2
    for _ in range(3):
        side, v = -side, 0.6 * v
        later = t > at
        found[later] = side * (v * (t[later] - at) - a * (t[later] - at) ** 2 / 2)
        at += 2 * v / a
    return {"x$": found, "z$": np.abs(found) / 2}


def _rolling_off(t):
    """Return the way off an edge at 0.5, in free fall, and down along a slope."""
    s = np.maximum(t - 0.5, 0.0)
    u = np.maximum(s - 4 / 9.81, 0.0)
    free = s - u
    x = t - 0.5 + 0.8 * u + 0.2 * 9.81 * u**2
    return {"x$": x, "z$": np.where(u > 0.0, -2 * x, -9.81 * free**2 / 2)}


FLAT = "(x$_dot^2 + z$_dot^2)/2"
FRAGMENTS = (
    Fragment("smooth", ("1", "0"), lambda t: {"x$": np.cos(2 * t)}, "2*x$^2"),
    Fragment("ignorable", ("0.3", "0.7"), lambda t: {"x$": 0.3 + 0.7 * t}),
    Fragment(
        "switch in t", ("0.3", "-0.2"),
        lambda t: {"x$": np.where(
            t < 0.37, _parabola(t, 0, 0.3, -0.2, 2.0),
            _parabola(t, 0.37, 0.3 - 0.2 * 0.37 + 0.37**2, -0.2 + 2 * 0.37, -1.0),
        )},
        forces={"x$": "if(t < 0.37, 2, -1)"},
    ),
    Fragment(
        "switch in the state", ("1", "0"), lambda t: {"x$": _bent(t)},
        forces={"x$": "if(x$ > 0, -4*x$, -16*x$)"},
    ),
    Fragment(
        "two switches", ("1", "0"),
        lambda t: {"x$": _steps(t, 1.0, 0.0, _two_switches)},
        forces={"x$": "-sign(x$) - 0.5*sign(x$ - 0.4)"},
    ),
    Fragment(
        "switch within a switch", ("0.9", "-1.3"),
        lambda t: {"x$": _steps(t, 0.9, -1.3, _nested)},
        forces={"x$": "if(mod(x$, 0.4) < 0.15 + 0.1*heaviside(x$ - 0.6), 2, -1)"},
    ),
    Fragment(
        "sliding", ("0.2", "0.45"), lambda t: {"x$": 0.2 + _brake(t, 0.45, 0.3)},
        forces={"x$": "0.2 - 0.5*sign(x$_dot)"},
    ),
    Fragment(
        "until", ("0.8", "0"), lambda t: {"x$": 0.8 - t**2 / 2}, "x$",
        until="x$ <= 0", end=float(np.sqrt(1.6)),
    ),
    Fragment(
        "event", ("0.5", "0"), lambda t: {"x$": _pushed(t)}, forces={"x$": "push$"},
        modes={"push$": "2"},
        events={
            "hit$": "{at: x$ <= 0.2, set: {push$: 2}}",
            "beat$": "{every: 1.3, set: {push$: push$ - 3}}",
        },
    ),
    Fragment(
        "sections and strobes", ("1", "0"), lambda t: {"x$": np.cos(2 * t)}, "2*x$^2",
        crossed={
            "down$": ("{at: x$ = 0.2, direction: down}", [np.arccos(0.2) / 2]),
            "turn$": ("{at: x$_dot = 0}", [np.pi / 2]),  # and at the start
            "beat$": ("{every: 0.4}", [0.0, 0.4, 0.8, 1.2, 1.6, 2.0]),
        },
    ),
    Fragment(
        # Every other beat turns the push at once; the speed passes 0.64 up and down.
        "events at one time", ("0.3", "0"), lambda t: {"x$": _bursts(t)},
        forces={"x$": "push$ + 0.4*fast$"},
        modes={"push$": "2", "fast$": "0", "beats$": "0"},
        events={
            "slower$": "{at: x$_dot <= 0.64, set: {fast$: 0}}",
            "faster$": "{at: x$_dot >= 0.64, set: {fast$: 1}}",
            "turn$": "{at: beats$ >= 3, set: {beats$: beats$ - 2, push$: -push$}}",
            "beat$": "{every: 0.25, set: {beats$: beats$ + 1}}",
        },
    ),
    Fragment(
        "impulse at an event", ("0.2", "0.5"), lambda t: {"x$": _kicked(t)},
        events={
            "tick$": "{every: 0.62, impulse: {x$: -0.3}}",
            "push$": "{at: x$ >= 0.3, impulse: {x$: 0.3 + 2*x$_dot}}",
        },
    ),
    Fragment(
        "contact", ("0.5", "0"), lambda t: {"x$": bounced(t, 0.5, 0.5)}, "9.81*x$",
        constraints={"floor$": "{relation: x$ >= 0, restitution: 0.5}"},
    ),
    Fragment(
        "friction on one slip", ("0.1", "2"),
        lambda t: {"x$": 0.1 + _brake(t, 2.0, 0.3 * 9.81), "y$": 0 * t},
        "9.81*y$", "(x$_dot^2 + y$_dot^2)/2", {"y$": ("0", "0")},
        constraints={
            "floor$": "{relation: y$ >= 0, restitution: 0, friction: 0.3, slip: x$_dot}"
        },
    ),
    Fragment(
        "friction on the disc", ("0.1", "1.2"),
        lambda t: {
            "x$": 0.1 + 0.8 * _brake(t, 1.5, 0.2 * 9.81),
            "z$": 0.2 + 0.6 * _brake(t, 1.5, 0.2 * 9.81), "y$": 0 * t,
        },
        "9.81*y$", "(x$_dot^2 + y$_dot^2 + z$_dot^2)/2",
        {"y$": ("0", "0"), "z$": ("0.2", "0.9")},
        constraints={"floor$": "{relation: y$ >= 0, restitution: 0, friction: 0.2, "
                               "slip: [x$_dot, z$_dot]}"},
    ),
    Fragment(
        "limit", ("0.4", "0"), lambda t: {"x$": 0.4 + np.maximum(0, t - 0.75) ** 3 / 3},
        forces={"x$": "2*t"},
        constraints={"brake$": "{relation: x$_dot = 0, limit: 1.5}"},
    ),
    Fragment(
        "static and dynamic friction", ("0.4", "0.3"),
        lambda t: {"x$": 0.4 + _stick_slip(t)}, forces={"x$": "1.2*t"},
        constraints={
            "rub$": "{relation: x$_dot = 0, limit: {static: 1.5, dynamic: 0.9}}"
        },
    ),
    Fragment(
        "freewheel", ("0", "0"), lambda t: {"x$": _freewheel(t)},
        forces={"x$": "3*cos(3*t)"}, constraints={"wheel$": "x$_dot >= 0"},
    ),
    Fragment(
        "when", ("0.5", "0"), lambda t: {"x$": 0.5 + np.maximum(0, t - 0.6) ** 2 / 2},
        "-x$", constraints={"latch$": "{relation: x$ = 0.5, when: t < 0.6}"},
    ),
    Fragment(
        "groove", ("1", "0"), _passing, "9.81*z$", FLAT, {"z$": ("0.5", "0")},
        constraints={"groove$": "{relation: z$ >= abs(x$)/2, restitution: 0}"},
    ),
    Fragment(
        "ridge", ("-0.5", "1"), _rolling_off, "9.81*z$", FLAT, {"z$": ("0", "0")},
        constraints={"edge$": '{relation: "z$ >= -2*max(x$, 0)", restitution: 0}'},
    ),
    Fragment(
        "corner", ("1", "0"), _passing, "9.81*z$", FLAT, {"z$": ("0.5", "0")},
        constraints={"wire$": "z$ = abs(x$)/2"},
    ),
    Fragment(
        "holonomic", ("1", "0"),
        lambda t: {"x$": np.cos(1.3 * t), "z$": np.sin(1.3 * t)}, "0", FLAT,
        {"z$": ("0", "1.3")}, constraints={"rod$": "x$^2 + z$^2 = 1"},
    ),
    Fragment(
        "rheonomic", ("0", "0.2*pi"), lambda t: {"x$": 0.1 * np.sin(2 * np.pi * t)},
        constraints={"drive$": "x$ = 0.1*sin(2*pi*t)"},
    ),
    Fragment(
        "Pfaffian", ("0", "0.8"),
        lambda t: {
            "x$": 0.8 / 1.5 * np.sin(1.5 * t), "z$": 0.8 / 1.5 * (1 - np.cos(1.5 * t)),
            "a$": 1.5 * t,
        },
        "0", "(x$_dot^2 + z$_dot^2 + a$_dot^2)/2",
        {"z$": ("0", "0"), "a$": ("0", "1.5")},
        constraints={"edge$": "sin(a$)*x$_dot = cos(a$)*z$_dot"},
    ),
    Fragment(
        "nonlinear velocity constraint", ("0", "1.2"),
        lambda t: {
            "x$": 1.44 * np.arctan(np.tanh(t / 1.2 / 2)) * 2,
            "z$": -1.44 * np.log(np.cosh(t / 1.2)),
        },
        "z$", FLAT, {"z$": ("0", "0")},
        constraints={"speed$": "x$_dot^2 + z$_dot^2 = 1.44"},
    ),
    Fragment(
        "redundant", ("1", "0"), lambda t: {"x$": np.cos(2 * t), "z$": np.cos(2 * t)},
        "2*(x$^2 + z$^2)", FLAT, {"z$": ("1", "0")},
        constraints={"bar$": "x$ = z$", "twin$": "2*x$ = 2*z$"},
    ),
    Fragment(
        "singular M", ("1", "0"), lambda t: {"x$": np.cos(2 * t), "z$": np.cos(2 * t)},
        "2*z$^2", more={"z$": ("1", "0")}, constraints={"bar$": "z$ = x$"},
    ),
    Fragment(
        "elimination", ("1", "0"),
        lambda t: {"x$": np.cos(2 * t), "z$": 2 * np.cos(2 * t)}, "10*x$^2", FLAT,
        {"z$": ("2", "0")}, constraints={"gear$": "z$ = 2*x$"},
        formulation="elimination",
    ),
    Fragment(
        "many coordinates", (f"sin(pi/{CHAIN + 1})", "0"), _chain,
        f"50*({_STRETCHES})",
        "(" + " + ".join(f"{_names(i)}_dot^2" for i in range(CHAIN)) + ")/2",
        {_names(i): (f"sin({i + 1}*pi/{CHAIN + 1})", "0") for i in range(1, CHAIN)},
    ),
)  # fmt: skip
BY_NAME = {f.name: f for f in FRAGMENTS}
