"""Scenes of contact that several tests play."""

from __future__ import annotations

import math
from typing import Any

from tests.scenes.contact.motions import contact, scene

ROLLING = "x_dot + r*phi_dot"


def ball(e, *, y=1, v=0, g="9.81", **simulation):
    """A ball above a floor."""
    return scene(
        "y", "m*y_dot^2/2", "m*g*y", {"floor": contact("y >= 0", e)},
        {"y": y, "y_dot": v}, parameters={"m": 2, "g": g}, **simulation,
    )  # fmt: skip


def oscillator(relation, e, x=1, v=0, **simulation):
    """A mass on a spring, with a stop."""
    return scene(
        "x", "x_dot^2/2", "x^2/2", {"stop": contact(relation, e)},
        {"x": x, "x_dot": v}, **simulation,
    )  # fmt: skip


def balls(count, speeds, masses, e):
    """Points on a line that touch; `speeds` are those at the start."""
    names = [f"x{k}" for k in range(1, count + 1)]
    kinetic = " + ".join(f"{m}*{x}_dot^2/2" for m, x in zip(masses, names, strict=True))
    touching = {f"c{k}": contact(f"x{k + 1} >= x{k} + 1", e) for k in range(1, count)}
    initial = {x: k for k, x in enumerate(names)}
    initial |= {f"{x}_dot": v for x, v in zip(names, speeds, strict=True)}
    return scene(
        " ".join(names), kinetic, "0", touching, initial, duration=1, output_step=0.25
    )


def sphere(spin, mu=0.2, e=0.0, **simulation):
    """A solid sphere that is dropped, spinning, onto a floor."""
    simulation = {"duration": 2, "output_step": 0.01} | simulation
    return scene(
        "x y phi", "m*(x_dot^2 + y_dot^2)/2 + I*phi_dot^2/2", "m*g*y",
        {"floor": contact("y >= r", e, friction=mu, slip=ROLLING)},
        {"x": 0, "y": 1, "phi": 0, "phi_dot": spin},
        parameters={"m": 1, "r": 0.1, "I": "2*m*r^2/5"}, **simulation,
    )  # fmt: skip


def incline(angle, mu, v=0.0, **friction):
    """A block on an incline; s runs downhill."""
    law = contact("n >= 0", 0, friction=friction or "mu", slip="s_dot")
    return scene(
        "s n", "m*(s_dot^2 + n_dot^2)/2", "m*g*(n*cos(a) - s*sin(a))", {"floor": law},
        {"s": 0, "n": 0, "s_dot": v}, parameters={"m": 3, "a": angle, "mu": mu},
        duration=1, output_step=0.01,
    )  # fmt: skip


def belt():
    """A block on a running belt, held by a spring; rest on the belt at the start."""
    law = contact(
        "y >= 0", 0, friction={"static": "ms", "dynamic": "md"}, slip="x_dot - u"
    )
    return scene(
        "x y", "m*(x_dot^2 + y_dot^2)/2", "k*x^2/2 + m*g*y", {"belt": law},
        {"x": 0, "x_dot": "u", "y": 0},
        parameters={"m": 1, "k": 100, "u": 0.2, "ms": 0.6, "md": 0.4},
        duration=4, output_step=0.01,
    )  # fmt: skip


def dry(as_limit):
    """A block on a spring with dry friction, m = k = F = 1."""
    law: dict[str, Any] = {"constraints": {}, "forces": {"x": "-F*sign(x_dot)"}}
    if as_limit:
        law = {"constraints": {"floor": {"relation": "x_dot = 0", "limit": "F"}}}
    return scene(
        "x", "x_dot^2/2", "x^2/2", initial={"x": 12, "x_dot": 6}, parameters={"F": 1},
        duration=30, output_step=0.1, **law,
    )  # fmt: skip


def rod(mu, angle, slide, **held):
    """A uniform rod that leans on its lower left end, which slides.

    Where it slides to the left a push N lifts the end by N/m times
    1 + 3*cos(th)*(cos(th) - mu*sin(th)).
    """
    tip = contact(
        "y - a*sin(th) >= 0", 0, friction="mu", slip="x_dot + a*sin(th)*th_dot"
    )
    return scene(
        "x y th", "m*(x_dot^2 + y_dot^2)/2 + m*a^2/6*th_dot^2", "m*g*y",
        {"tip": tip} | held,
        {"x": 0, "th": angle, "y": "a*sin(th)", "x_dot": slide},
        parameters={"m": 1, "a": 0.5, "mu": mu},
        duration=0.5, output_step=0.01,
    )  # fmt: skip


def dome(gap="hypot(x, y) >= R"):
    """A point that slides down a smooth dome from 0.3 rad beside its top."""
    return scene(
        "x y", "m*(x_dot^2 + y_dot^2)/2", "m*g*y", {"dome": contact(gap, 0)},
        {"x": "R*sin(0.3)", "y": "R*cos(0.3)"}, parameters={"m": 2, "R": 1.5},
        duration=1.2, output_step=0.01,
    )  # fmt: skip


def string(factor, duration=1.5):
    """A bob on a string, which starts at its lowest point with v^2 = factor*g*l."""
    return scene(
        "x y", "m*(x_dot^2 + y_dot^2)/2", "m*g*y",
        {"string": contact("hypot(x, y) <= l", 0)},
        {"x": 0, "y": "-l", "x_dot": f"sqrt({factor}*g*l)"},
        parameters={"m": 0.5, "l": 0.4}, duration=duration, output_step=0.01,
    )  # fmt: skip


def freewheel(torque, speed=0):
    """Two inertias; the first drives the second and cannot hold it back."""
    return scene(
        "a b", "J*(a_dot^2 + b_dot^2)/2", "0",
        {"wheel": {"relation": "b_dot >= a_dot"}},
        {"a": 0, "b": 0, "a_dot": speed}, parameters={"J": 1}, forces={"a": torque},
        duration=2.5, output_step=0.01,
    )  # fmt: skip


def clutch(torque="0"):
    """Two inertias and a clutch that holds 2 N m; the first turns at the start."""
    return scene(
        "a b", "J*(a_dot^2 + b_dot^2)/2", "0",
        {"clutch": {"relation": "a_dot = b_dot", "limit": 2}},
        {"a": 0, "b": 0, "a_dot": 10}, parameters={"J": 1}, forces={"a": torque},
        duration=6, output_step=0.05,
    )  # fmt: skip


def table(e, amplitude, w, y=0, v="A*w", **simulation):
    """A ball on a table that moves up and down; on it at the start, or above it."""
    return scene(
        "y", "m*y_dot^2/2", "m*g*y",
        {"table": contact("y >= A*sin(w*t)", e)}, {"y": y, "y_dot": v},
        parameters={"m": 1, "A": amplitude, "w": w}, **simulation,
    )  # fmt: skip


def swing(e):
    """A pendulum in Cartesian coordinates that strikes a wall at its lowest point."""
    return scene(
        "x y", "m*(x_dot^2 + y_dot^2)/2", "m*g*y",
        {"rod": "x^2 + y^2 = l^2", "wall": contact("x >= 0", e)},
        {"x": "l*sin(1)", "y": "-l*cos(1)"}, parameters={"m": 2, "l": 0.7},
        duration=4, output_step=0.05,
    )  # fmt: skip


def block(start=0.15, **simulation):
    """A rigid block that rocks from one lower edge to the other."""
    simulation = {"duration": 10, "output_step": 0.02} | simulation
    corner = "y {0} b*sin(th) - h*cos(th) >= 0"
    slip = "x_dot + (h*cos(th) {0} b*sin(th))*th_dot"
    laws = {
        name: contact(corner.format(lift), 0, friction=1, slip=slip.format(side))
        for name, lift, side in (("left", "-", "+"), ("right", "+", "-"))
    }
    return scene(
        "th x y", "m*(x_dot^2 + y_dot^2)/2 + I*th_dot^2/2", "m*g*y", laws,
        {"th": start, "x": "b*cos(th) - h*sin(th) - b", "y": "b*sin(th) + h*cos(th)"},
        parameters={"m": 1, "b": 0.25, "h": 1, "I": "m*(b^2 + h^2)/3"}, **simulation,
    )  # fmt: skip


def legs(x, y):
    """A table on four legs, small tilts a and b, with its weight off the middle."""
    corners = {"ne": "+ a + b", "nw": "- a + b", "se": "+ a - b", "sw": "- a - b"}
    return scene(
        "z a b", "m*z_dot^2/2 + J*(a_dot^2 + b_dot^2)/2",
        f"m*g*(z + ({x})*a + ({y})*b)",
        {k: contact(f"z {tilt} >= 0", 0) for k, tilt in corners.items()},
        {"z": 0, "a": 0, "b": 0}, parameters={"m": 2, "J": 0.5},
        duration=1, output_step=0.25,
    )  # fmt: skip


def post():
    """A fast point that meets a thin post in its way."""
    return scene(
        "x", "m*x_dot^2/2", "0", {"post": contact("(x - 5)^2 >= w^2", 1)},
        {"x": 0, "x_dot": 1000}, parameters={"m": 1, "w": 1e-4},
        duration=0.01, output_step=0.001,
    )  # fmt: skip


def channel():
    """A point between two walls a micrometre apart."""
    walls = {"left": contact("x >= 0", 1), "right": contact("x <= d", 1)}
    return scene(
        "x", "m*x_dot^2/2", "0", walls, {"x": "d/2", "x_dot": 1},
        parameters={"m": 1, "d": 1e-6}, duration=1e-4, output_step=1e-5,
    )  # fmt: skip


def slide(vx, vy, mx=1, my=1):
    """Point on a rough floor, with masses mx and my along x and y."""
    law = contact("z >= 0", 0, friction=0.3, slip=["x_dot", "y_dot"])
    return scene(
        "x y z", "(mx*x_dot^2 + my*y_dot^2 + mx*z_dot^2)/2", "mx*g*z", {"floor": law},
        {"x": 0, "y": 0, "z": 0, "x_dot": vx, "y_dot": vy},
        parameters={"mx": mx, "my": my}, duration=3, output_step=0.05,
    )  # fmt: skip


EVERY: dict[str, str] = {
    "ball": ball(0.8, duration=5, output_step=0.02),
    "dead ball": ball(0.0, duration=2, output_step=0.02),
    "oscillator": oscillator("x >= -0.5", 0.8, duration=20, output_step=0.02),
    "three balls": balls(3, [1, 0, 0], [1, 1, 1], 1),
    "sphere that slips": sphere(50),
    "sphere that rolls": sphere(10),
    "sphere that bounces": sphere(50, e=0.6),
    "steep incline": incline(0.5, 0.3),
    "block uphill": incline(0.4, 0.5, v=-2.0),
    "belt": belt(),
    "dome": dome(),
    "string": string(3.0),
    "freewheel": freewheel("10*sin(2*pi*t)"),
    "table": table(0.5, 0.01, 40, 0.2, 0, duration=2, output_step=0.01),
    "dead table": table(0.0, 0.01, 40, duration=0.5, output_step=0.001),
    "swing": swing(0.7),
    "rocking block": block(),
    "legs": legs(0.1, -0.2),
    "post": post(),
    "channel": channel(),
    "slide": slide(3, 4),
    "runner": slide(3, 4, 1, 4),
}
SPHERE_TIME = math.sqrt(2 * 0.9 / 9.81)
