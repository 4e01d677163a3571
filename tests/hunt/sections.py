"""Random models of flights with impacts and events, and their sections in closed form.

A ball falls onto a floor and bounces, another flies between two walls, and a mode is
set every period and where the second passes a place. Between these instants all is a
polynomial in t, so that every crossing of a section is the root of one.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

# Of the ball: no slower flight is looked at.
SLOW = 0.1


class Scene(NamedTuple):
    """Numbers of a model; `origin` is where it all lies, `start` when it begins."""

    origin: float
    start: float
    duration: float
    gravity: float
    push: float  # on the ball, while the mode is 1
    bounce: float
    ball: tuple[float, float]
    flyer: tuple[float, float]
    wall: float
    walls: float  # restitution
    period: float
    place: float  # of the flyer, where the mode is set to 2
    output_step: float


class Instant(NamedTuple):
    t: float
    ball: float
    ball_speed: float
    flyer: float
    flyer_speed: float
    mode: float


class Flight(NamedTuple):
    """Polynomials in t - t0 from one instant to the next."""

    begin: Instant
    end: float
    ball: Polynomial
    flyer: Polynomial

    def at(self, t):
        s, first = t - self.begin.t, self.begin
        return Instant(
            t, self.ball(s), self.ball.deriv()(s), self.flyer(s), first.flyer_speed,
            first.mode,
        )  # fmt: skip


def random_scene(seed):
    """Return a scene, and its sections as kinds with numbers."""
    random = np.random.default_rng(seed)
    u = random.uniform
    scene = Scene(
        origin=float(random.choice([0.0, 0.0, 3.0, 1e3, -1e4])),
        start=float(random.choice([0.0, 0.0, -1.0, 7.3, 1e3])),
        duration=float(u(3.0, 8.0)),
        gravity=float(u(2.0, 12.0)),
        push=float(random.choice([0.0, u(-3.0, 1.0)])),
        bounce=float(u(0.3, 0.95)),
        ball=(float(u(0.2, 2.0)), float(u(-1.0, 2.0))),
        flyer=(float(u(-0.8, 0.8)), float(u(0.5, 3.0) * random.choice([-1.0, 1.0]))),
        wall=float(u(0.9, 2.5)),
        walls=float(random.choice([1.0, u(0.6, 1.0)])),
        period=float(u(0.15, 1.5)),
        place=float(u(-0.5, 0.5)),
        output_step=float(random.choice([0.02, 0.25, 1.0])),
    )
    kinds = random.choice(sorted(RELATIONS), 5, replace=False)
    directions = random.choice(["up", "down", "both"], 5)
    numbers = u([0.05, -0.9, -0.9], [0.9, 0.9, 0.9], (5, 3))
    sections = [
        (str(kind), tuple(map(float, c)), str(way))
        for kind, c, way in zip(kinds, numbers, directions, strict=True)
    ]
    return scene, sections


# Of each relation its text, and its pieces: for a flight and its mode polynomials, and
# for a jump or a kink of the relation the inner polynomial and the distance of levels.
RELATIONS = {
    "height": "a = {0!r}",
    "speed": "a_dot = 3*{1!r}",
    "turn": "a_dot = 0",
    "flyer": "b = {1!r}",
    "flyer's speed": "b_dot = {1!r}",
    "mode": "z = 0.5 + {0!r}",
    "shifted": "b = {1!r} + 0.7*z",
    "mixed": "a - 2*b + z*{1!r} = {2!r}",
    "moving": "b - {1!r}*(t - t0) = {2!r}",
    "saw": "mod(b, 0.3 + {0!r}) = 0.2",
    "saw and mode": "mod(a - 0.1, 0.4) + 0.05*z = 0.23",
    "stairs": "b - 0.5*floor(2*b) = 0.11 + {0!r}/4",
    "kink": "abs(b - {1!r}) = 0.2",
    "branch": "if(b > {1!r}, a - 0.4, 1.3)  = 0",
    "sign": "sign(b - {1!r}) = 0.5",
    "product": "(a - 0.5)*(b - {1!r}) = 0",
    "dip": "b^2 = 1e-6",
}


def pieces(kind, c, flight, start):
    """Return (from, to, polynomial) of a relation on a flight, in s = t - t0."""
    a, b, z = flight.ball, flight.flyer, flight.begin.mode
    end, one = flight.end - flight.begin.t, Polynomial([1.0])
    clock = Polynomial([flight.begin.t - start, 1.0])
    whole = {
        "height": lambda: a - c[0],
        "speed": lambda: a.deriv() - 3.0 * c[1] * one,
        "turn": a.deriv,
        "flyer": lambda: b - c[1],
        "flyer's speed": lambda: (flight.begin.flyer_speed - c[1]) * one,
        "mode": lambda: (z - 0.5 - c[0]) * one,
        "shifted": lambda: b - c[1] - 0.7 * z,
        "mixed": lambda: a - 2.0 * b + z * c[1] - c[2],
        "moving": lambda: b - c[1] * clock - c[2],
        "product": lambda: (a - 0.5) * (b - c[1]),
        "dip": lambda: b * b - 1e-6,
    }
    if kind in whole:
        return [(0.0, end, whole[kind]())]
    inner, width = {
        "saw": (b, 0.3 + c[0]),
        "saw and mode": (a - 0.1, 0.4),
        "stairs": (b, 0.5),
        "kink": (b - c[1], math.inf),
        "branch": (b - c[1], math.inf),
        "sign": (b - c[1], math.inf),
    }[kind]
    cuts = {0.0, end}
    grid = inner(np.linspace(0.0, end, 2001))
    low, high = grid.min() - 1.0, grid.max() + 1.0
    levels = [0.0]
    if width < math.inf:
        levels = width * np.arange(math.floor(low / width), high / width + 1.0)
    for level in levels:
        cuts |= {x for x in real_roots(inner - level) if 0.0 < x < end}
    cuts = sorted(cuts)
    found = []
    for low, high in itertools.pairwise(cuts):
        value = inner(0.5 * (low + high))
        lower = width * math.floor(value / width) if width < math.inf else 0.0
        polynomial = {
            "saw": lambda n: inner - n - 0.2,
            "saw and mode": lambda n: inner - n + 0.05 * z - 0.23,
            "stairs": lambda n: inner - n - 0.11 - c[0] / 4.0,
            "kink": lambda _, v=value: math.copysign(1.0, v) * inner - 0.2,
            "branch": lambda _, v=value: a - 0.4 if v > 0.0 else 1.3 * one,
            "sign": lambda _, v=value: (math.copysign(1.0, v) - 0.5) * one,
        }[kind](lower)
        found.append((low, high, polynomial))
    return found


def real_roots(polynomial):
    """Return the real roots of a polynomial of low degree, in order."""
    coefficients = np.trim_zeros(polynomial.coef, "b")
    if len(coefficients) < 2:
        return []
    found = Polynomial(coefficients).roots()
    return sorted(float(x.real) for x in found if abs(x.imag) < 1e-13 * (1 + abs(x)))


def flights(scene):
    """Yield the flights of a scene up to its end, or to where the ball may rest."""
    end = scene.start + scene.duration
    now = Instant(scene.start, *scene.ball, *scene.flyer, 0.0)  # it has ticked
    ticks, armed = 1, scene.flyer[0] < scene.place
    while True:
        pull = -scene.gravity + scene.push * (now.mode == 1.0)
        ball = Polynomial([now.ball, now.ball_speed, 0.5 * pull])
        flyer = Polynomial([now.flyer, now.flyer_speed])
        meets = [(end, "end"), (scene.start + ticks * scene.period, "tick")]
        least = 1e-12
        falls = [s for s in real_roots(ball) if s > least and ball.deriv()(s) < 0.0]
        meets += [(now.t + s, "floor") for s in falls[:1]]
        for side in (-1.0, 1.0):
            if side * now.flyer_speed > 0.0:
                s = (side * scene.wall - now.flyer) / now.flyer_speed
                meets.append((now.t + s, "wall"))
        s = (scene.place - now.flyer) / now.flyer_speed
        if s > least:
            meets.append((now.t + s, "place"))
        t, what = min(meets)
        flight = Flight(now, t, ball, flyer)
        yield flight
        now = flight.at(t)
        if what == "end" or (what == "floor" and abs(now.ball_speed) < SLOW):
            return
        now = acted(scene, now, what, armed)
        ticks += what == "tick"
        armed ^= what == "place"


def acted(scene, now, what, armed):
    """Return the state after an event.

    what : "tick", "floor", "wall", or "place", which sets the mode if `armed`
    """
    if what == "tick":
        return now._replace(mode=1.0 - min(now.mode, 1.0))
    if what == "floor":
        return now._replace(ball=0.0, ball_speed=-scene.bounce * now.ball_speed)
    if what == "wall":
        return now._replace(flyer_speed=-scene.walls * now.flyer_speed)
    return now._replace(mode=2.0) if armed else now


def expected(scene, kind, c, way):
    """Return the instants at which a section is crossed, and the time they end at."""
    side, rows = 0.0, []
    last = scene.start
    for flight in flights(scene):
        begun = True
        for low, high, g in pieces(kind, c, flight, scene.start):
            cuts = [x for x in real_roots(g) if low < x < high]
            borders = [low, *cuts, high]
            for k in range(len(borders) - 1):
                middle = 0.5 * (borders[k] + borders[k + 1])
                sign = math.copysign(1.0, g(middle))
                crossed = side * sign < 0.0 and (k > 0 or begun)
                if crossed and way in ("both", "up" if sign > 0.0 else "down"):
                    rows.append(flight.at(flight.begin.t + borders[k]))
                side, begun = sign, False
        last = flight.end
    return rows, last


def text_of(scene, sections):
    """Return the model file."""
    written = "\n".join(
        f'    s{k}: {{at: "{RELATIONS[kind].format(*c)}", direction: {way}}}'
        for k, (kind, c, way) in enumerate(sections)
    )
    s = scene
    return f"""
parameters: {{X0: {s.origin!r}, t0: {s.start!r}}}
modes: {{z: 1}}
coordinates: {{x: {{}}, y: {{}}}}
definitions: {{a: x - X0, b: y + X0}}
energy: {{kinetic: (x_dot^2 + y_dot^2)/2, potential: {s.gravity!r}*a}}
forces: {{x: "{s.push!r}*if(z > 0.5 and z < 1.5, 1, 0)"}}
constraints:
  floor: {{relation: a >= 0, restitution: {s.bounce!r}}}
  left: {{relation: b >= -{s.wall!r}, restitution: {s.walls!r}}}
  right: {{relation: b <= {s.wall!r}, restitution: {s.walls!r}}}
events:
  tick: {{every: {s.period!r}, set: {{z: "1 - min(z, 1)"}}}}
  place: {{at: b >= {s.place!r}, set: {{z: 2}}}}
initial:
  x: X0 + {s.ball[0]!r}
  x_dot: {s.ball[1]!r}
  y: {s.flyer[0]!r} - X0
  y_dot: {s.flyer[1]!r}
simulation: {{start: t0, duration: {s.duration!r}, output_step: {s.output_step!r}}}
output:
  sections:
{written}
"""
