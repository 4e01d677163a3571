"""Gaps with kinks as several contacts: at every state the gap is the least of these."""

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read

MODEL = """
parameters: {k: 2, c: -0.5}
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 0}
tables:
  valley: {interpolation: linear, outside: extend, points: [[-1, 3], [0, 0], [2, 1]]}
  saw: {interpolation: linear, outside: extend,
    points: [[-2, 0], [-1, 1], [0, -1], [1, 1.5], [2, 0.5]]}
  bent: {interpolation: linear, outside: extend,
    points: [[-2, 0], [0, 1], [1, 1.2], [3, 3]]}
  wave: {interpolation: linear, outside: repeat,
    points: [[0, 0], [1, 1], [1.5, 0.9], [2, 0]]}
  short: {interpolation: linear, points: [[-3, 5], [-1, 1], [0, 0.5], [2, 1], [3, 4]]}
definitions: {used: valley(x) + saw(x) + bent(x) + wave(x) + short(x) + k + c}
constraints: {gap: {relation: "GAP >= 0", restitution: 0}}
initial: {x: 0, y: 50, z: 0}
simulation: {duration: 1}
"""
VALLEY, SAW = [(-1, 3), (0, 0), (2, 1)], [(-2, 0), (-1, 1), (0, -1), (1, 1.5), (2, 0.5)]
BENT, WAVE = [(-2, 0), (0, 1), (1, 1.2), (3, 3)], [(0, 0), (1, 1), (1.5, 0.9), (2, 0)]
CHAIN = (
    "if(x <= 1, if(x < -0.3, 0.06 - 0.9*(x + 0.3), 0.2*x + 0.12),"
    " if(x <= 1.7, 0.4*(x - 1.7) + 0.6, 0.7*(x - 1) + 0.11))"
)
LINES = [(-1.3, 0.96), (-0.3, 0.06), (1, 0.32), (1.7, 0.6), (2.7, 1.3)]
RIDGE = "if(x < 0, if(x < -1, -x - 1, 0.3*(x + 1)), if(x < 2, 0.3 - 0.4*x, x - 2.5))"
HUMP = [(-2, 1), (-1, 0), (0, 0.3), (2, -0.5), (3, 0.5)]
SHORT = [(-3, 5), (-1, 1), (0, 0.5), (2, 1), (3, 4)]


def extended(points, x):
    """Return the value of a linear table, whose first and last lines go on."""
    a, b = np.array(points, float).T
    k = int(np.clip(np.searchsorted(a, x) - 1, 0, len(a) - 2))
    return b[k] + (b[k + 1] - b[k]) / (a[k + 1] - a[k]) * (x - a[k])


# The gap, its value, and the number of contacts: grooves of the gap have one on either
# side, ridges are one contact.
GAPS = [
    ("y - k*abs(x)", lambda x, y, _: y - 2 * abs(x), 2),
    ("y + k*abs(x)", lambda x, y, _: y + 2 * abs(x), 1),
    ("y - c*abs(x)", lambda x, y, _: y + 0.5 * abs(x), 1),
    ("min(y, x) + z", lambda x, y, z: min(y, x) + z, 2),
    ("max(min(y, x), z)", lambda x, y, z: max(min(y, x), z), 2),
    ("y - abs(x) - abs(z)", lambda x, y, z: y - abs(x) - abs(z), 4),
    ("y - abs(x)*abs(z)", lambda x, y, z: y - abs(x * z), 2),
    ("y - abs(x)/k", lambda x, y, _: y - abs(x) / 2, 2),
    ("abs(y) - abs(x)", lambda x, y, _: abs(y) - abs(x), 2),
    ("exp(-abs(x)) + y", lambda x, y, _: np.exp(-abs(x)) + y, 2),
    ("y - max(x, max(z, 1))", lambda x, y, z: y - max(x, z, 1), 3),
    ("y - if(x > 0, x, -2*x)", lambda x, y, _: y - (x if x > 0 else -2 * x), 2),
    ("y + if(x > 0, x, -2*x)", lambda x, y, _: y + (x if x > 0 else -2 * x), 1),
    ("y - valley(x)", lambda x, y, _: y - extended(VALLEY, x), 2),
    ("y + valley(x)", lambda x, y, _: y + extended(VALLEY, x), 1),
    # Grooves of the gap at x = 0 alone, beside ridges at -1 and 1.
    ("y - saw(x)", lambda x, y, _: y - extended(SAW, x), 2),
    # And the other way round.
    ("y + saw(x)", lambda x, y, _: y + extended(SAW, x), 3),
    # Kinks by a slope of 0.3 one way and by 0.7 the other way.
    ("y - bent(x)", lambda x, y, _: y - extended(BENT, x), 2),
    ("y + bent(x)", lambda x, y, _: y + extended(BENT, x), 2),
    # A table that is repeated: grooves belong to two contacts in turn.
    ("y - wave(x)", lambda x, y, _: y - extended(WAVE, x % 2), 2),
    ("y + wave(x)", lambda x, y, _: y + extended(WAVE, x % 2), 2),
    # A table that ends, of which all knots are grooves, or all ridges.
    ("y - short(x)", lambda x, y, _: y - extended(SHORT, x), 4),
    ("y + short(x)", lambda x, y, _: y + extended(SHORT, x), 1),
    # Below a nonlinear function, and factors of a sign or of none.
    ("y - 1/(1 + abs(x))", lambda x, y, _: y - 1 / (1 + abs(x)), 1),
    ("y + 1/(1 + abs(x))", lambda x, y, _: y + 1 / (1 + abs(x)), 2),
    ("y - z*abs(x)", lambda x, y, z: y - z * abs(x), 1),
    ("y - (1 + x^2)*abs(x)", lambda x, y, _: y - (1 + x**2) * abs(x), 2),
    ("2*y/(2 + abs(x)) - abs(x)", lambda x, y, _: 2 * y / (2 + abs(x)) - abs(x), 2),
    ("y - min(x, z)", lambda x, y, z: y - min(x, z), 1),
    # A convex chain of lines, and one with a ridge at 0, in nested conditions.
    (f"y - {CHAIN}", lambda x, y, _: y - extended(LINES, x), 4),
    (f"y + {CHAIN}", lambda x, y, _: y + extended(LINES, x), 1),
    (f"y - {RIDGE}", lambda x, y, _: y - extended(HUMP, x), 3),
    ("y - abs(abs(x) - 1)", lambda x, y, _: y - abs(abs(x) - 1), 3),
    # Products of steps with factors that are 0 there.
    ("y - k*(x/1000)*sign(x/1000)", lambda x, y, _: y - abs(x) / 500, 2),
    ("y - c*x*sign(c*x)", lambda x, y, _: y - 0.5 * abs(x), 2),
    ("y + x*(2*heaviside(x) - 1)", lambda x, y, _: y + abs(x), 1),
    ("y - x*(2*heaviside(x) - 1)", lambda x, y, _: y - abs(x), 2),
    ("y - x*(heaviside(x) - heaviside(-x))", lambda x, y, _: y - abs(x), 2),
    ("y - x*if(not x/k < 0, 1, -1)", lambda x, y, _: y - abs(x), 2),
    ("y - x*heaviside(x)*(1 + z^2)", lambda x, y, z: y - max(x, 0) * (1 + z * z), 2),
    ("y - (x - z^2)*sign(x/2 - z^2/2)", lambda x, y, z: y - abs(x - z * z), 2),
    ("y - sinh(x)*sign(x^3)", lambda x, y, _: y - abs(np.sinh(x)), 2),
    ("y - x^2*sign(x)", lambda x, y, _: y - x * abs(x), 1),
    ("y - z*x*sign(x)", lambda x, y, z: y - z * abs(x), 1),
    # A step of the ground.
    ("y - if(x > 1, 1 + x, x)", lambda x, y, _: y - x - (x > 1), 1),
]


def test_a_gap_is_the_least_of_its_contacts():
    random = np.random.default_rng(5)
    states = random.uniform(-2.9, 2.9, size=(60, 3))
    for text, value, count in GAPS:
        e = derive(read(MODEL.replace("GAP", text), "model.yaml"))
        nodes = [law.row.residual for law in e.laws]
        assert len(nodes) == count, text
        for x, y, z in states:
            values = {"x": x, "y": y, "z": z, "k": 2.0, "c": -0.5, "t": 0.0}
            found = min(evaluate(e.graph, nodes, values))
            assert found == pytest.approx(value(x, y, z), abs=1e-12), (text, x, y, z)
