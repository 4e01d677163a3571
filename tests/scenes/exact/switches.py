"""Forces with switches: bodies at rest on one, swinging between two laws, balanced."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import beta

from tests.scenes.contact.motions import scene
from tests.scenes.exact import Exact

SCENES: dict[str, Exact] = {}

# What lies on a switch to the last bit does not while its place moves.
MOVING = ("boosted",)
# x rests on a switch, where sign(0) = 0, and y feels it: its acceleration there.
BESIDE = {
    "1 + sign(x)": 1.0, "1 + sign(-x)": 1.0, "1 - 3*sign(2*x)": 1.0,
    "1 + sign(x)*abs(x + 5)": 1.0, "1 + sign(x)*sign(y + 30)": 1.0,
    "1 + sign(x_dot)": 1.0, "1 + sign(x_dot - 0) + sign(x)": 1.0,
    "1 + 2*heaviside(x)": 3.0, "if(x > 0, 1, 3)": 3.0, "if(x >= 0, 1, 3)": 1.0,
    "if(x < 0, 1, 3)": 3.0, "2 + floor(x)": 2.0, "1 + max(0, x)": 1.0,
}  # fmt: skip
# The same where x has forces of its own, none of which moves it.
OWN = {
    ("2*sign(x)", "1"): 1.0,  # repels, and is 0 there
    ("2*sign(x)", "1 + sign(x)"): 1.0,
    ("-2*sign(x)", "1 + sign(x)"): 1.0,  # attracts
    ("sign(x_dot)", "1 + sign(x_dot)"): 1.0,
    ("-sign(x_dot)", "1 + sign(x_dot)"): 1.0,
    ("-3*x - x_dot", "1 + sign(x)"): 1.0,
    ("if(x > 0, 1, 0)", "if(x > 0, 1, 4)"): 4.0,
    ("0", "1 + sign(x) - 0.25*sign(y_dot)"): 0.75,  # slips at once
    ("0", "0.2 + sign(x) - 0.25*sign(y_dot)"): 0.0,  # sticks
}


def two(x, y, potential="0"):
    """Two bodies at rest at 0 under these forces."""
    return scene(
        "x y", "(x_dot^2 + y_dot^2)/2", potential, {}, {"x": 0, "y": 0},
        forces={"x": x, "y": y}, duration=2, output_step=0.25,
    )  # fmt: skip


def resting(a):
    return lambda t: {"x": 0.0 * t, "y": a * t**2 / 2.0}


for potential in ("0", "x^2/2", "-x^2/2"):
    for force, a in BESIDE.items():
        SCENES[f"rests beside {force} in {potential}"] = Exact(
            two("0", force, potential), resting(a), still="x", unlike=MOVING
        )
for (own, force), a in OWN.items():
    SCENES[f"rests by {own} beside {force}"] = Exact(
        two(own, force), resting(a), still="x", unlike=MOVING
    )

# Bodies at rest, of which a growing force moves each at one time, whatever its mass.
for mass in (1e-17, 1e17):
    push = "1 + t - 3*sign({}_dot)"
    SCENES[f"rests until pushed beside {mass:g} kg"] = Exact(
        scene(
            "x y", f"(x_dot^2 + {mass}*y_dot^2)/2", "0", {}, {"x": 0, "y": 0},
            forces={"x": push.format("x"), "y": push.format("y")}, duration=3,
            output_step=0.25,
        ),
        lambda t: {"x": np.maximum(t - 2.0, 0.0) ** 3 / 6.0}, unlike=MOVING,
    )  # fmt: skip


def leaving(begins, way=1.0, power=0):
    """x leaves the level of its switch; the force on y then depends on its side."""

    def motion(t):
        late = np.maximum(t - begins, 0.0)
        x = way * late ** (power + 2) / ((power + 1) * (power + 2))
        return {"x": x, "y": t**2 / 2.0 + way * late**2 / 2.0}

    return motion


LEAVES = {f"if(t > 1, {way}, 0)": leaving(1.0, way) for way in (1, -1)}
LEAVES |= {f"t^{power}": leaving(0.0, power=power) for power in (1, 2, 5)}
# y is at 1/2 at the time 1, and takes x off.
LEAVES |= {"if(y > 0.5, 1, 0)": leaving(1.0)}
for force, motion in LEAVES.items():
    SCENES[f"leaves by {force}"] = Exact(
        two(force, "1 + sign(x)"), motion, unlike=MOVING
    )


def period(k, p):
    """Return the period under -k |x|^p sign(x) of 1 kg from rest at x = 1.

    x'^2/2 = k (1 - x^(p + 1))/(p + 1), and x^(p + 1) = s in the quadrature.
    """
    n = p + 1.0
    return float(4.0 * np.sqrt(n / (2.0 * k)) * beta(1.0 / n, 0.5) / n)


for p, force in (
    (1.5, "if(x > 0, -4*x^1.5, 4*(-x)^1.5)"),
    (1.5, "if(x < 0, 4*(-x)^1.5, -4*x^1.5)"),
    (2.5, "if(x >= 0, -4*x^2*sqrt(x), 4*(-x)^2*sqrt(-x))"),
):
    T = period(4.0, p)
    SCENES[f"swings by {force}"] = Exact(
        scene(
            "x", "x_dot^2/2", "0", {}, {"x": 1}, forces={"x": force},
            duration=2.0 * T, output_step=T / 4.0,
        ),
        # Rows are a quarter of the period apart.
        lambda t, T=T: {"x": np.cos(np.pi / 2.0 * np.round(4.0 * t / T))},
        within=1e-8,
    )  # fmt: skip

# At rest sign(0) = 0, and the force jumps as soon as the block moves. Stepping over
# that costs a few hundred times the tolerance at most.
SCENES["begins to rub"] = Exact(
    scene(
        "x", "x_dot^2/2", "2*x^2", {}, {"x": 1}, forces={"x": "-0.3*sign(x_dot)"},
        duration=1.5,
    ),
    lambda t: {"x": 0.075 + 0.925 * np.cos(2.0 * t)}, within=1e-8, steps=1000,
)  # fmt: skip

# Forces that cancel leave rounding, which step control must not chase: on a loaded
# spring, of 8.6 periods at some 30 steps each, and on a hanging pendulum.
STILL, FAST = 1.3 * 9.81 / 37.7, math.sqrt(37.7 / 1.3)


def shaken(size, t):
    return size * (np.sin(t) - np.sin(FAST * t) / FAST) / (1.3 * (FAST * FAST - 1.0))


BALANCED = {
    "sin(t)": lambda t: shaken(1.0, t),
    "1e-6*sin(t)": lambda t: shaken(1e-6, t),
    "0": lambda t: 0.0 * t,
}
for force in (*BALANCED, "1e-3*(1 - cos(t))", "t^3", "1e-6*t^3",
              "if(t < 1, 0, 1e-3*(t - 1))"):  # fmt: skip
    SCENES[f"balanced under {force}"] = Exact(
        scene(
            "x", "1.3*x_dot^2/2", "37.7*x^2/2 - 1.3*9.81*x", {},
            {"x": "1.3*9.81/37.7"}, forces={"x": force}, duration=10,
            output_step=0.01, method="dop853",
        ),
        lambda t, force=force: (
            {"x": STILL + BALANCED[force](t)} if force in BALANCED else {}
        ),
        within=3e-11, steps=300,
    )  # fmt: skip
# Of the amplitude six digits are left, which are three of the motion.
SCENES["nearly balanced"] = Exact(
    scene(
        "x", "1.3*x_dot^2/2", "37.7*x^2/2 - 1.3*9.81*x", {},
        {"x": "1.3*9.81/37.7*(1 + 1e-9)"}, duration=10, output_step=0.01,
        method="dop853",
    ),
    lambda t: {"x": STILL * (1.0 + 1e-9 * np.cos(FAST * t))}, within=3e-14, steps=300,
)  # fmt: skip
for force in ("1e-3", "1e-3*sin(t)", "1e-6*sin(t)", "1e-6*t^3"):
    SCENES[f"hangs under {force}"] = Exact(
        scene(
            "x y", "(x_dot^2 + y_dot^2)/2", "9.81*y", {"rod": "x^2 + y^2 = 1"},
            {"x": 0, "y": -1}, forces={"x": force}, duration=10,
        ),
        within=1e-12, steps=300,
    )  # fmt: skip

# On an incline of 0.3 rad, of what pulls and of what the weight presses with.
PULL, PRESS = 9.81 * math.sin(0.3), 9.81 * math.cos(0.3)


def incline(mu, v):
    """Block with friction on an incline, thrown up or down."""
    return scene(
        "x", "x_dot^2/2", f"{PULL!r}*x", {}, {"x": 0, "x_dot": v},
        forces={"x": f"{-mu * PRESS!r}*sign(x_dot)"}, duration=3,
    )  # fmt: skip


def stopped(v, a):
    """Motion with initial velocity v and constant deceleration a until it stops."""

    def motion(t):
        s = np.minimum(t, abs(v) / a)
        return {"x": np.copysign(abs(v) * s - a * s**2 / 2.0, v)}

    return motion


for v in (3.0, -3.0):
    a = 0.5 * PRESS + math.copysign(PULL, v)
    SCENES[f"stops from {v} on an incline"] = Exact(
        incline(0.5, v), stopped(v, a), events={"stick": [3.0 / a]}
    )
SCENES["slides down an incline"] = Exact(
    incline(0.2, 0), lambda t: {"x": (0.2 * PRESS - PULL) * t**2 / 2.0}, events={}
)
for mu in (0.5, math.tan(0.3)):
    SCENES[f"rests on an incline by {mu:.3g}"] = Exact(
        incline(mu, 0), lambda t: {"x": 0.0 * t}, still="x", events={}, steps=20,
        balanced=2.0 * mu * PRESS, unlike=MOVING,
    )  # fmt: skip
SCENES["breaks loose"] = Exact(
    scene(
        "x", "x_dot^2/2", "0", {}, {"x": 0},
        forces={"x": "t - 2*sign(x_dot)"}, duration=5,
    ),
    lambda t: {"x": np.maximum(t - 2.0, 0.0) ** 3 / 6.0}, events={"slip": [2.0]},
)  # fmt: skip
