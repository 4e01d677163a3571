"""Contacts that touch, open, hold or slip under forces that begin at zero."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from tests.scenes.contact.motions import G, contact, scene
from tests.scenes.exact import Exact

if TYPE_CHECKING:
    from collections.abc import Callable

SCENES: dict[str, Exact] = {}

# Turning at the ground: the speed of rounding is its root, and what leaves with that of
# an impact is 1e-5 off.


def stopped(width):
    """Body on a spring, released at the stretch 1, that meets a stop at -width."""
    first = math.acos(-width)

    def u(t):
        loose = np.where(t < first, np.cos(t), -width * np.cos(t - first))
        return width + loose

    return f"(x - {width})^2/2", "0", 1.0 + width, 0.0, u, [first]


# Potential, force, start, speed; the motion, and its impacts.
TURNS = {
    "stopped by a wall": stopped(0.3),
    "stopped by another": stopped(0.7),
    "pushed to and fro": ("0", "cos(t)", 0.0, 0.0, lambda t: 1 - np.cos(t), []),
    "faster": (
        "0", "2*cos(3*t)", 0.0, 0.0, lambda t: 2 / 9 * (1 - np.cos(3 * t)), [],
    ),
    "a throw": ("-x", "0", 0.5, -1.0, lambda t: (t - 1) ** 2 / 2, []),
    "another throw": ("-2*x", "0", 0.09, -0.6, lambda t: (t - 0.3) ** 2, []),
}  # fmt: skip
# How steps are told, and their error.
STEPS = {
    "rtol": ((1e-6, 1e-5), (1e-9, 1e-8), (1e-11, 1e-10)), "step": ((0.005, 1e-8),),
}  # fmt: skip
for name, (potential, force, x, v, u, impacts) in TURNS.items():
    for e in (0.0,) if impacts else (0.0, 0.5):
        for option, values in STEPS.items():
            for value, error in values:
                asked: dict[str, Any] = {option: value}
                if option == "step":
                    asked["method"] = "rk4"
                SCENES[f"{name}, e = {e}, {option} {value}"] = Exact(
                    # Beside another, whose steps are not its own.
                    scene(
                        "x z", "(x_dot^2 + z_dot^2)/2", f"{potential} + 3*z^2/2",
                        {"wall": contact("x >= 0", e)}, {"x": x, "x_dot": v, "z": 1},
                        forces={"x": force}, duration=20, output_step=0.25, **asked,
                    ),
                    lambda t, u=u: {"x": u(t)}, events={"impact": impacts},
                    within=error,
                    # So late that rounding of the time is a depth of its own.
                    unlike=("later",),
                )  # fmt: skip

# Friction of 1.5 against a push of 2 sin 3t: it sticks and slips by turns.
END, AMPLITUDE, BOUND, RATE = 3.0, 2.0, 1.5, 3.0


@functools.cache
def slips():
    """Return begin, end and sign of each slip."""
    found, t = [], math.asin(BOUND / AMPLITUDE) / RATE
    for k in range(3):
        begins, sign = t + k * math.pi / RATE, (-1) ** k

        def gained(u, begins=begins, sign=sign):
            """Return the velocity: the integral of 2 sin 3t - 1.5 sign."""
            swing = AMPLITUDE / RATE * (np.cos(RATE * begins) - np.cos(RATE * u))
            return float(swing - sign * BOUND * (u - begins))

        ends = brentq(gained, begins + 0.1, begins + 1.0, xtol=1e-15)
        found.append((begins, ends, sign))
    return found


def travelled(t, begins, sign):
    """Return the way of a slip, the integral of its velocity."""
    swing = AMPLITUDE / RATE * np.cos(RATE * begins) * (t - begins)
    swing -= AMPLITUDE / RATE**2 * (np.sin(RATE * t) - np.sin(RATE * begins))
    return swing - sign * BOUND * (t - begins) ** 2 / 2


def by_turns(t):
    return sum(
        np.where(t > begins, travelled(np.minimum(t, ends), begins, sign), 0.0)
        for begins, ends, sign in slips()
    )


def begun(after=END):
    begins, ends, _ = zip(*slips(), strict=True)
    return {"slip": [*begins], "stick": [t for t in ends if t < after]}


PUSH = f"{AMPLITUDE}*sin({RATE}*t)"
RUBBING: dict[str, tuple[str, str, dict[str, Any]]] = {
    "limit": ("x", PUSH, {"rest": {"relation": "x_dot = 0", "limit": BOUND}}),
    "sign": ("x", f"{PUSH} - {BOUND}*sign(x_dot)", {}),
    "contact": ("x y", PUSH, {
        "rest": contact("y >= 0", 0.0, friction=BOUND / 10, slip="x_dot"),
    }),
}  # fmt: skip
for law, (names, force, laws) in RUBBING.items():
    SCENES[f"pushed against a {law}"] = Exact(
        scene(
            names, " + ".join(f"{q}_dot^2/2" for q in names.split()),
            "10*y" if "y" in names else "0", laws, dict.fromkeys(names.split(), 0),
            forces={"x": force}, duration=END,
        ),
        lambda t: {"x": by_turns(t)}, events=begun(), within=1e-11,
    )  # fmt: skip


def on_a_floor(x, y):
    """A body on a floor under a force of two components."""
    floor = contact("h >= 0", 0.0, friction=BOUND / 10, slip=["x_dot", "y_dot"])
    return scene(
        "x y h", "(x_dot^2 + y_dot^2 + h_dot^2)/2", "10*h", {"floor": floor},
        {"x": 0, "y": 0, "h": 0}, forces={"x": x, "y": y}, duration=END,
    )  # fmt: skip


for angle in (0.0, 1e-3, 0.6435, math.pi / 2, 1.0, 2.0, -3.0):
    SCENES[f"pushed at an angle of {angle}"] = Exact(
        on_a_floor(f"{PUSH}*cos({angle})", f"{PUSH}*sin({angle})"),
        lambda t, a=angle: {
            "x": by_turns(t) * math.cos(a), "y": by_turns(t) * math.sin(a),
        },
        events=begun(),
    )  # fmt: skip


# Two at angles of 0.7 and -2.2, and a third on which nothing rubs.
WAYS = {"x": math.cos(0.7), "y": math.sin(0.7), "u": math.cos(2.2), "v": -math.sin(2.2)}


def two_on_floors(push, force):
    laws = {
        h: contact(f"{h} >= 0", 0.0, friction=BOUND / 10, slip=slip)
        for h, slip in {"h": ["x_dot", "y_dot"], "k": ["u_dot", "v_dot"]}.items()
    }
    names, forces = "xyhuvkz", {q: f"({push})*{way!r}" for q, way in WAYS.items()}
    return scene(
        " ".join(names), " + ".join(f"{q}_dot^2/2" for q in names), "10*h + 10*k", laws,
        dict.fromkeys(names, 0), forces=forces | {"z": force}, duration=END,
    )  # fmt: skip


# What else begins, or stands beside a switch, when a slip on a disc begins.
for push, path in ((PUSH, by_turns), ("1.5 + t", lambda t: t**3 / 6)):
    for force in ("0", "-1*sign(z + 100)"):
        SCENES[f"two are pushed by {push} beside {force}"] = Exact(
            two_on_floors(push, force),
            lambda t, path=path: {q: path(t) * way for q, way in WAYS.items()},
        )  # fmt: skip


def turning(first, turn):
    """Integrate a slip by an independent method, from 1e-6 after it begins.

    Its direction at that time is the direction of the force at the beginning, to first
    order in the time.
    """
    begins, after = BOUND - first, 1e-6
    way = np.array([math.cos(turn * begins), math.sin(turn * begins)])

    def rates(t, state):
        speeds, angle = state[2:], turn * t
        push = (first + t) * np.array([math.cos(angle), math.sin(angle)])
        return [*speeds, *(push - BOUND * speeds / np.hypot(*speeds))]

    @functools.cache
    def last():
        start = [*(way * after**3 / 6), *(way * after**2 / 2)]
        states = solve_ivp(
            rates, (begins + after, END), start, method="Radau", rtol=1e-11, atol=1e-17
        ).y[:, -1]
        return dict(zip(("x", "y", "x_dot", "y_dot"), states, strict=True))

    def at_the_end(names, t):
        ends = last()
        final = np.arange(len(t)) == len(t) - 1
        return {q: np.where(final, ends[q], np.nan) for q in names}

    return at_the_end


for first in (0.0, BOUND):
    for turn in (0.0, 0.7, 3.0):
        ends = turning(first, turn)
        SCENES[f"pushed by {first} + t, turning by {turn}"] = Exact(
            on_a_floor(f"({first} + t)*cos({turn}*t)", f"({first} + t)*sin({turn}*t)"),
            functools.partial(ends, ("x", "y")),
            functools.partial(ends, ("x_dot", "y_dot")),
            events={"slip": [BOUND - first] if first < BOUND else []}, within=1e-10,
        )  # fmt: skip

STIFF = 100.0


def hops(mass, duration):
    """Return the times of slips of a slider pulled by a spring, and its last place.

    Between two times STIFF (x(t) - s) less its bound drives it, x = sin(2 pi t)/10.
    """
    w, found, t, s = 2 * math.pi, [], 0.0, 0.0
    fast = math.sqrt(STIFF / mass)
    size = STIFF / 10 / (STIFF - mass * w * w)
    while True:
        # It is at rest until the spring pulls with the bound.
        reach = 10 * (s + 0.5 / STIFF)
        t = max(t, math.asin(reach) / w)
        if t >= duration:
            return found, s
        found.append(t)
        a = s - size * math.sin(w * t) + 0.5 / STIFF
        b = -size * w * math.cos(w * t) / fast

        def rate(u, t=t, a=a, b=b):
            turned = fast * (u - t)
            own = fast * (b * math.cos(turned) - a * math.sin(turned))
            return size * w * math.cos(w * u) + own

        period = 2 * math.pi / fast
        least = minimize_scalar(
            rate, bounds=(t + 0.8 * period, t + 1.2 * period), method="bounded",
            options={"xatol": 1e-9 * period},
        ).x  # fmt: skip
        end = min(brentq(rate, t + 0.5 * period, least, xtol=1e-17), duration)
        turned = fast * (end - t)
        s = size * math.sin(w * end) - 0.5 / STIFF
        s += a * math.cos(turned) + b * math.sin(turned)
        t = end


MU = 0.3


def stack(count):
    """Equal blocks, one on another, of which the bottom one is pushed by 20 t."""
    laws = {}
    for k in range(count):
        below, rate = (f"y{k - 1} + 1", f" - x{k - 1}_dot") if k else ("0", "")
        slip = f"x{k}_dot{rate}"
        laws[f"c{k}"] = contact(f"y{k} >= {below}", 0.0, friction=MU, slip=slip)
    names = [f"{q}{k}" for k in range(count) for q in "xy"]
    return scene(
        " ".join(names), " + ".join(f"{q}_dot^2/2" for q in names),
        " + ".join(f"g*y{k}" for k in range(count)), laws,
        {f"x{k}": 0 for k in range(count)} | {f"y{k}": k for k in range(count)},
        forces={"x0": "20*t"}, duration=END,
    )  # fmt: skip


def carried(count, t):
    """Return x of the blocks above: with the bottom one, then pulled by friction alone.

    All blocks are at their bounds then, and no block slips on the next.
    """
    load = MU * count * G
    slips, parts = load / 20, 2 * load / 20
    moving = np.clip(t, slips, parts)
    way = (20 * (moving - slips) ** 3 / 6) / count
    speed = (20 * (parts - slips) ** 2 / 2) / count
    late = np.maximum(t - parts, 0.0)
    return way + speed * late + MU * G * late**2 / 2


for count in (2, 3, 4, 5):
    SCENES[f"a stack of {count}"] = Exact(
        stack(count),
        lambda t, n=count: {f"x{k}": carried(n, t) for k in range(1, n)},
        events={"slip": [MU * count * G / 20 * k for k in (1, 2)]}, within=1e-11,
        # The times of those that slip at once are told apart by rounding.
        unlike=("later", "reordered"),
    )  # fmt: skip

# What touches without a force parts, or holds, as the force that begins says it does.
# Nothing weighs here: at the start itself no acceleration tells what goes on to do so.
LONG, FAST = 2.0, 7.0
HALF = math.pi / FAST
SINE = f"sin({FAST}*t)"
LIFTS: dict[str, Callable[[Any], Any]] = {
    "t": lambda t: t**3 / 6,
    "t^3": lambda t: t**5 / 20,
    SINE: lambda t: t / FAST - np.sin(FAST * t) / FAST**2,
}
VALUES = {"t": lambda t: t, "t^3": lambda t: t**3, SINE: lambda t: np.sin(FAST * t)}
FLOOR = {"floor": contact("y >= 0", 0)}
STACK = FLOOR | {"on": contact("z >= y", 0)}
WHEEL = {"wheel": {"relation": "b_dot >= a_dot"}}
BOX = {"l": contact("y - sin(th) >= 0", 0), "r": contact("y + sin(th) >= 0", 0)}


def weightless(laws, **forces):
    """Bodies of 1 kg at rest at 0, a box of a third of that about its middle."""
    names = {"floor": "y", "on": "y z", "wheel": "a b", "r": "y th"}[[*laws][-1]]
    inertia = {"th": 3}
    return scene(
        names, " + ".join(f"{q}_dot^2/{2 * inertia.get(q, 1)}" for q in names.split()),
        "0", laws, dict.fromkeys(names.split(), 0), forces=forces, duration=LONG,
        output_step=0.1,
    )  # fmt: skip


def nothing(*names):
    return lambda t: dict.fromkeys(names, 0.0 * t)


for force, ways in LIFTS.items():
    SCENES[f"lifted by {force}"] = Exact(
        weightless(FLOOR, y=force), lambda t, w=ways: {"y": w(t)},
        nothing("lambda_floor"), events={},
    )  # fmt: skip
    SCENES[f"the top is lifted by {force}"] = Exact(
        weightless(STACK, z=force), lambda t, w=ways: {"y": 0.0 * t, "z": w(t)},
        nothing("lambda_floor", "lambda_on"), events={},
    )  # fmt: skip
    if force == SINE:
        continue  # it pulls back, and they part
    SCENES[f"a stack is lifted by {force}"] = Exact(
        weightless(STACK, y=force),
        lambda t, w=ways: {"y": w(t) / 2, "z": w(t) / 2},
        lambda t, f=VALUES[force]: {"lambda_floor": 0.0 * t, "lambda_on": f(t) / 2},
        events={},
    )  # fmt: skip
    for sign in (1, -1):
        SCENES[f"a freewheel under {sign}*{force}"] = Exact(
            weightless(WHEEL, a=f"{sign}*{force}"),
            lambda t, w=ways, s=sign: {
                "a": s * w(t) / (2 if s > 0 else 1), "b": w(t) / 2 * (s > 0),
            },
            events={}, unlike=("boosted",),
        )  # fmt: skip
    SCENES[f"a box is lifted flat by {force}"] = Exact(
        weightless(BOX, y=force), lambda t, w=ways: {"y": w(t), "th": 0.0 * t},
        events={},
    )  # fmt: skip
for power in (1, 2, 3):
    for name, laws, q, pushes in (
        ("a body", FLOOR, "y", {"lambda_floor": 1.0}),
        ("a stack", STACK, "z", {"lambda_floor": 1.0, "lambda_on": 1.0}),
        ("a box", BOX, "y", {"lambda_l": 0.5, "lambda_r": 0.5}),
    ):
        SCENES[f"{name} is pressed by t^{power}"] = Exact(
            weightless(laws, **{q: f"-1*t^{power}"}),
            lambda t, q=q: {q: 0.0 * t},
            lambda t, p=power, pushes=pushes: {c: x * t**p for c, x in pushes.items()},
            events={}, within=1e-12 if name == "a body" else 1e-9,
        )  # fmt: skip
# x = t^2/2 pushes y, which is t^4/24, or nothing.
for sign in (1, -1):
    SCENES[f"pushed by another's way, {sign}"] = Exact(
        scene(
            "x y", "(x_dot^2 + y_dot^2)/2", "0", FLOOR, {"x": 0, "y": 0},
            forces={"x": "1", "y": f"{sign}*x"}, duration=LONG, output_step=0.1,
        ),
        lambda t, s=sign: {"x": t**2 / 2, "y": t**4 / 24 * (s > 0)}, events={},
    )  # fmt: skip
SCENES["pressed, then pulled"] = Exact(
    weightless(FLOOR, y=f"-1*{SINE}"),
    lambda t: {"y": LIFTS[SINE](np.maximum(t - HALF, 0.0))}, events={"release": [HALF]},
)  # fmt: skip


def driven_wheel(t):
    """Freewheel: a drives b for half a period of the force, then b turns freely."""
    s = np.minimum(t, HALF)
    b = (s - np.sin(FAST * s) / FAST) / FAST / 2 + np.maximum(t - HALF, 0.0) / FAST
    return {"b": np.where(t < 3 * HALF, b, np.nan)}


SCENES["a freewheel is overrun"] = Exact(
    weightless(WHEEL, a=SINE), driven_wheel, unlike=("boosted",)
)


@functools.cache
def tilted(power):
    """Integrate a box that turns about its left corner until that parts.

    Free, it would go down: (1 - 3/2) t^power. From its first power at 1e-3 on.
    """

    def rates(t, x):
        th, v = x
        cos, sin = math.cos(th), math.sin(th)
        turned = (t**power * (cos + 0.5) + cos * sin * v * v) / (cos * cos + 1 / 3)
        return v, turned

    def pushes(t, x):
        return math.cos(x[0]) * rates(t, x)[1] - math.sin(x[0]) * x[1] ** 2 - t**power

    pushes.terminal, pushes.direction = True, -1  # type: ignore[attr-defined]
    v = 1.125 * 1e-3 ** (power + 1) / (power + 1)
    return solve_ivp(
        rates, (1e-3, LONG), [v * 1e-3 / (power + 2), v], "DOP853", rtol=1e-12,
        atol=1e-15, events=pushes, dense_output=True,
    )  # fmt: skip


def corner(power):
    """Return the motion of a box that turns about a corner, then leaves it."""

    def motion(t):
        held = tilted(power)
        (gone,) = held.t_events[0]
        th, rate = held.sol(np.clip(t, 1e-3, gone))
        s, more = np.maximum(t - gone, 0.0), power + 1
        late = np.maximum(t, gone)
        way = late ** (more + 1) - gone ** (more + 1) * (1 + (more + 1) * s / gone)
        way = way / (more * (more + 1))
        y = np.sin(th) + np.cos(th) * rate * s + way
        return {"th": th + rate * s + 1.5 * way, "y": y}

    return motion


for power in (1, 3):
    force = f"t^{power}"
    SCENES[f"a box is lifted off a corner by {force}"] = Exact(
        weightless(BOX, y=force, th=f"0.5*{force}"), corner(power), within=1e-8,
    )  # fmt: skip


# What leaves its ground by a power of the time: polynomials through the ends of a step
# dip below the ground. force -> the weight, when it leaves, the push from then on.
S = Polynomial([0.0, 1.0])
LEAVING = {
    "9.81*t": (G, 1.0, G * S),
    "9.81*t^2": (G, 1.0, G * ((1 + S) ** 2 - 1)),
    "9.81*t^9": (G, 1.0, G * ((1 + S) ** 9 - 1)),
    "9.81*(1 + (t - 1)^3)": (G, 1.0, G * S**3),
    "9.81*(1 + max(0, t - 1)^2)": (G, 1.0, G * S**2),
    "t^2": (0.0, 0.0, S**2),
}


def leaving(weight, begins, push, t):
    """Two bodies leave a rising floor; a ball strikes in the first step of flight."""
    y = push.integ(2)(np.maximum(t - begins, 0.0)) + t**3 / 100
    u = np.maximum(weight / 2 * ((begins + 0.0044) ** 2 - t**2), 0.0)
    return {"y": y, "z": y, "u": u}


for method, error in {"rattle": 1e-3, "rk4": 1e-6, "dop853": 1e-9}.items():
    for force, forced in LEAVING.items():
        weight, begins, push = forced
        SCENES[f"leave by {force}, {method}"] = Exact(
            scene(
                "y z u", "(y_dot^2 + z_dot^2 + u_dot^2)/2", f"{weight}*(y + z + u)",
                {
                    "floor": contact("y >= t^3/100", 0), "on": contact("z >= y", 0),
                    "ball": contact("u >= 0", 0),
                },
                {"y": 0, "z": 0, "u": weight / 2 * (begins + 0.0044) ** 2},
                forces={"y": f"2*({force} + 0.06*t)"}, duration=2, output_step=0.033,
                method=method, **({} if method == "dop853" else {"step": 0.01}),
            ),
            lambda t, forced=forced: leaving(*forced, t),
            lambda t, begins=begins, push=push: {
                "lambda_floor": np.maximum(0.0, -2.0 * push(t - begins)),
            },
            within=error,
        )  # fmt: skip
