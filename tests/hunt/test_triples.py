"""Random triples of features in one file, each with its own motion in closed form.

To the fragments of `tests.scenes.pairs` come those of larger files: closed loops of
rods, quaternions, brakes in the plane, sliders without mass, tables beside periodic
events, latches. The first coordinates of the three are mixed by a reflection, so that
no expression is one feature's alone, and the scene is written in another form:
elsewhere, moving, later, beside a heavy body. HUNT_TRIPLES (60) is the number of
triples of a night.
"""

import os
import random

import numpy as np
import pytest
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

from tests.scenes.pairs.physical import FRAGMENTS, Fragment, _brake
from tests.scenes.pairs.test_physical import moves

REFLECTION = np.eye(3) - 2.0 * np.outer([1, -0.7, 0.4], [1, -0.7, 0.4]) / 1.65
MIXED = {
    "coupled": True, "mix": [[repr(x) for x in row] for row in REFLECTION.tolist()],
    "names": ("u1", "u2", "u3"),
}  # fmt: skip
WORDS = ({}, {"far": 1e3}, {"speed": 1e2}, {"later": 1e4}, {"heavy": 1e6})


def ring(t):
    angle = 1.1 * t + 2.0 * np.pi * np.arange(3)[:, None] / 3.0
    x, y = np.cos(angle) / 3**0.5 + 0.3 * t, np.sin(angle) / 3**0.5
    return {
        "x$": x[0], "y$": y[0], "p$.2.x": x[1], "p$.2.y": y[1],
        "p$.3.x": x[2], "p$.3.y": y[2],
    }  # fmt: skip


def top(t):
    """Free body with moments of inertia 1, 1, 2, from w = (0.7, 0, 2)."""
    # Quaternions of half angles, which are continuous from p0 = 1 at t = 0: no sign
    # is chosen, as a single time (a crossing of a section) has no neighbour.
    turn = Rotation.from_rotvec(np.outer(t, [0.7, 0.0, 4.0]))
    q = (turn * Rotation.from_rotvec(np.outer(t, [0.0, 0.0, -2.0]))).as_quat()
    names = ("p1$", "p2$", "p3$", "p0$")
    return {"x$": 0.1 + 0.3 * t, **dict(zip(names, q.T, strict=True))}


def braked(t):
    way = _brake(t, 1.5, 1.0)
    return {"x$": 0.1 + 0.8 * way, "z$": 0.2 + 0.6 * way}


def slider(t):
    begins = np.arcsin(0.25) / 2.0
    d = t - begins
    slid = 0.25 + 2.0 * np.cos(2.0 * begins) * d - d**2 / 2.0
    x = np.where(d < 0.0, np.sin(2.0 * t), slid)
    return {"x$": x, "s$": np.where(d < 0.0, 0.0, x - 0.25)}


KNOTS, FORCES = np.arange(5) / 2.0, np.array([0.0, 2.0, -1.0, 1.0, 0.0])


def clock(t):
    """Under k f(t), k = 1, 2, ... from one knot of f to the next."""
    k = np.arange(1, 5)
    force = PPoly(np.array([k * np.diff(FORCES) / 0.5, k * FORCES[:-1]]), KNOTS)
    return {"x$": 0.3 - 0.2 * t + force.antiderivative(2)(t)}


def latched(t):
    both, apart = 1.2 * t, np.minimum(1.2 * t, 0.6)
    return {"x$": (both + apart) / 2.0, "z$": (both - apart) / 2.0}


def bounced(t):
    """Two members that strike a stop at 2/3 and at 0.5, and a state that decays."""
    x, z = 1.0 - 1.5 * t, 0.5 - t
    return {
        "x$": np.maximum(x, -0.5 * x), "z$": np.maximum(z, -0.5 * z),
        "s$": 0.7 * np.exp(-t),
    }  # fmt: skip


POINTS = [[float(x), float(y)] for x, y in zip(KNOTS, FORCES, strict=True)]
CORNERS = [[float(ring(np.zeros(1))[f"p$.{k}.{c}"][0]) for c in "xy"] for k in (2, 3)]
SPEEDS = [[0.3 - 1.1 * y, 1.1 * x] for x, y in CORNERS]
FLAT = "(x$_dot^2 + z$_dot^2)/2"
FEATURES = (
    *(f for f in FRAGMENTS if f.name not in ("many coordinates", "elimination")),
    Fragment(
        "ring", ("1/sqrt(3)", "0.3"), ring,
        sections={
            "coordinates": {"y$": "{}", "p$(2..3)": "{components: xy}"},
            "definitions": {"v$(1)": "vec(x$, y$)", "v$(i = 2..3)": "p$(i)"},
            "constraints": {
                "rod$(i = 1..3)": "norm(v$(mod(i, 3) + 1) - v$(i)) = 1"
            },
            "initial": {
                "y$": "0", "y$_dot": "1.1/sqrt(3)", "p$(2..3)": str(CORNERS),
                "p$_dot(2..3)": str(SPEEDS),
            },
        },
        kinetic="sum(i = 1..3, dot(v$_dot(i), v$_dot(i)))/2",
    ),
    Fragment(
        "quaternion", ("0.1", "0.3"), top,
        sections={
            "parameters": {"J$": "[1, 1, 2]"},
            "coordinates": {f"p{k}$": "{}" for k in range(4)},
            "frames": {"top$": "{quaternion: [p0$, p1$, p2$, p3$]}"},
            "definitions": {"w$": "omega(top$)"},
            "initial": {"p0$": "1", "p1$": "0", "p2$": "0", "p3$": "0",
                        "w$": "[0.7, 0, 2]"},
        },
        kinetic="x$_dot^2/2 + spin(J$, w$)",
    ),
    Fragment(
        "planar brake", ("0.1", "1.2"), braked,
        sections={
            "coordinates": {"z$": "{}"}, "initial": {"z$": "0.2", "z$_dot": "0.9"},
            "constraints": {"pad$": "{relation: [x$_dot = 0, z$_dot = 0], limit: 1}"},
        },
        kinetic=FLAT,
    ),
    Fragment(
        "slider", ("0", "2"), slider,
        sections={
            "coordinates": {"s$": "{}"}, "initial": {"s$": "0"},
            "constraints": {"rubs$": "{relation: s$_dot = 0, limit: 1}"},
        },
        potential="2*(x$ - s$)^2",
    ),
    Fragment(
        "table and clock", ("0.3", "-0.2"), clock,
        sections={
            "tables": {"f$": f"{{points: {POINTS}, interpolation: linear}}"},
            "modes": {"k$": "0"},
            "events": {"tick$": "{every: 0.5, set: {k$: k$ + 1}}"},
            "forces": {"x$": '"k$*f$(t)"'},
        },
    ),
    Fragment(
        "members in contact", ("1", "-1.5"), bounced,
        sections={
            "coordinates": {"z$": "{}"}, "states": {"s$": "{rate: -s$}"},
            "definitions": {"h$(1)": "x$", "h$(2)": "z$"},
            "constraints": {
                "stop$(i = 1..2)": "{relation: h$(i) >= 0, restitution: 0.5}"
            },
            "initial": {"z$": "0.5", "z$_dot": "-1", "s$": "0.7"},
        },
        kinetic=FLAT,
    ),
    Fragment(
        "latch", ("0", "1.2"), latched,
        sections={
            "coordinates": {"z$": "{}"}, "initial": {"z$": "0"}, "modes": {"h$": "0"},
            "events": {"grab$": "{at: x$ - z$ >= 0.6, set: {h$: 1}}"},
            "constraints": {"hook$": "{relation: x$ - z$ = 0.6, when: h$ > 0}"},
        },
        kinetic=FLAT,
    ),
)  # fmt: skip


def drawn(seed, count):
    """Return triples and their forms; each has at most one end, and one direction."""
    chosen = random.Random(seed)
    while count:
        features, words = chosen.sample(FEATURES, 3), chosen.choice(WORDS)
        one_way = "speed" in words and any(f.name == "freewheel" for f in features)
        if not one_way:
            count -= 1
            yield features, words


@pytest.mark.parametrize("f", FEATURES[-7:], ids=lambda f: f.name)
def test_a_feature_beside_two_others(f):
    moves(f, FEATURES[0], FEATURES[3], **MIXED)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_a_nights_triples_move_as_each_alone(seed):
    count = int(os.environ.get("HUNT_TRIPLES", "60"))
    for features, words in drawn(seed, count):
        moves(*features, **MIXED, **words)
