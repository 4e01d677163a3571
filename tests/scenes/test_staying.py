"""Bodies that start on a switch and stay there: sign(0) = 0, as it is written.

A second coordinate feels the switch. All motions are polynomials of the time, or theirs
is given beside them.
"""

from __future__ import annotations

import numpy as np
import pytest

import lagsim

SCENE = """
parameters: {{at: {at!r}, m: {m!r}}}
coordinates: {{x: {{}}, y: {{}}{more}}}
energy: {{kinetic: "m*(x_dot^2 + y_dot^2)/2{kinetic}", potential: "m*({potential})"}}
forces: {{{forces}}}
initial: {{x: at, y: {y!r}{starts}}}
simulation: {{start: {start!r}, duration: 2, output_step: 0.25}}
"""
WORDS = [
    {},
    {"at": 3.0, "start": 7.0},
    {"at": -1e3, "m": 1e-6},
    {"m": 1e6, "y": 0.5, "beside": True},
]


def simulated(forces, *, potential="0", beside=False, **numbers):
    numbers = {"at": 0.0, "m": 1.0, "start": 0.0, "y": 0.0} | numbers
    told = ", ".join(f'{q}: "m*({f})"' for q, f in forces.items())
    text = SCENE.format(
        forces=told, potential=potential, more=", z: {}" if beside else "",
        kinetic=" + 1e6*z_dot^2/2" if beside else "",
        starts=", z: 0, z_dot: 1" if beside else "", **numbers,
    )  # fmt: skip
    found = lagsim.simulate(lagsim.load(text))
    assert found.complete
    assert not found.warnings
    return found, found.t - numbers["start"], found["y"] - numbers["y"]


# The force on y beside x = at, and what it is worth there.
BESIDE = {
    "1 + sign(x - at)": 1.0,
    "1 + sign(at - x)": 1.0,
    "1 - 3*sign(2*x - 2*at)": 1.0,
    "1 + sign(x - at)*abs(x + 5)": 1.0,
    "1 + sign(x - at)*sign(y + 30)": 1.0,
    "1 + sign(x_dot)": 1.0,
    "1 + sign(x_dot - 0) + sign(x - at)": 1.0,
    "1 + 2*heaviside(x - at)": 3.0,
    "if(x > at, 1, 3)": 3.0,
    "if(x >= at, 1, 3)": 1.0,
    "if(x < at, 1, 3)": 3.0,
    "if(x = at, 1, 3)": None,
    "2 + floor(x - at)": 2.0,
    "1 + max(0, x - at)": 1.0,
}


@pytest.mark.parametrize("words", WORDS, ids=str)
@pytest.mark.parametrize("potential", ["0", "(x - at)^2/2", "-(x - at)^2/2"])
@pytest.mark.parametrize("force", [f for f, a in BESIDE.items() if a is not None])
def test_a_body_that_stays_on_a_switch_of_another(force, potential, words):
    found, s, y = simulated({"y": force}, potential=potential, **words)
    assert np.all(found["x"] == words.get("at", 0.0))
    assert y == pytest.approx(BESIDE[force] * s**2 / 2.0, abs=1e-9)


@pytest.mark.parametrize("words", WORDS, ids=str)
@pytest.mark.parametrize(
    ("own", "y_force", "acceleration"),
    [
        ("2*sign(x - at)", "1", 1.0),  # repels, and is 0 there
        ("2*sign(x - at)", "1 + sign(x - at)", 1.0),
        ("-2*sign(x - at)", "1 + sign(x - at)", 1.0),  # attracts
        ("sign(x_dot)", "1 + sign(x_dot)", 1.0),
        ("-sign(x_dot)", "1 + sign(x_dot)", 1.0),
        ("-3*(x - at) - x_dot", "1 + sign(x - at)", 1.0),
        ("if(x > at, 1, 0)", "if(x > at, 1, 4)", 4.0),
        ("0", "1 + sign(x - at) - 0.25*sign(y_dot)", 0.75),  # slips at once
        ("0", "0.2 + sign(x - at) - 0.25*sign(y_dot)", 0.0),  # sticks
    ],
)
def test_a_body_that_stays_by_its_own_forces(own, y_force, acceleration, words):
    found, s, y = simulated({"x": own, "y": y_force}, **words)
    assert np.all(found["x"] == words.get("at", 0.0))
    assert y == pytest.approx(acceleration * s**2 / 2.0, abs=1e-9)


@pytest.mark.parametrize("words", WORDS, ids=str)
@pytest.mark.parametrize("way", [1, -1])
def test_one_that_leaves_later_takes_its_side_from_there_on(way, words):
    """At the time 1 a force takes x off; y is pushed by 1, then by 1 + way."""
    start = words.get("start", 0.0)
    forces = {"x": f"if(t > {start + 1}, {way}, 0)", "y": "1 + sign(x - at)"}
    found, s, y = simulated(forces, **words)
    later = np.maximum(s - 1.0, 0.0)
    at = words.get("at", 0.0)
    assert found["x"] - at == pytest.approx(way * later**2 / 2.0, abs=1e-9)
    assert y == pytest.approx(s**2 / 2.0 + way * later**2 / 2.0, abs=1e-9)


@pytest.mark.parametrize("power", [1, 2, 5])
@pytest.mark.parametrize("words", WORDS, ids=str)
def test_one_that_a_force_takes_off_from_the_first_instant_on(power, words):
    """x'' = s^p, which begins at 0: the side is that of x > at throughout."""
    start = words.get("start", 0.0)
    forces = {"x": f"(t - {start})^{power}", "y": "1 + sign(x - at)"}
    found, s, y = simulated(forces, **words)
    expected = s ** (power + 2) / ((power + 1) * (power + 2))
    assert found["x"] - words.get("at", 0.0) == pytest.approx(expected, abs=1e-9)
    assert y == pytest.approx(s**2, abs=1e-9)


@pytest.mark.parametrize("words", WORDS, ids=str)
def test_one_that_another_takes_off(words):
    """y reaches 1/2 further on at the time 1, and then pushes x off with 1."""
    y0 = words.get("y", 0.0)
    forces = {"x": f"if(y > {y0 + 0.5}, 1, 0)", "y": "1 + sign(x - at)"}
    found, s, y = simulated(forces, **words)
    later = np.maximum(s - 1.0, 0.0)
    at = words.get("at", 0.0)
    assert found["x"] - at == pytest.approx(later**2 / 2.0, abs=1e-9)
    assert y == pytest.approx(s**2 / 2.0 + later**2 / 2.0, abs=1e-9)


def test_what_no_value_on_the_switch_lets_stay_is_not_decided():
    """At rest `if(x_dot >= 0, 1, -1)` pushes up, and down below: both go on."""
    text = SCENE.format(
        at=0.0, m=1.0, start=0.0, y=0.0, more="", kinetic="", starts="", potential="0",
        forces='x: "if(x_dot >= 0, 1, -1)"',
    )  # fmt: skip
    found = lagsim.simulate(lagsim.load(text))
    assert [w.code for w in found.warnings] == ["unresolved-switch"]
    assert abs(found["x"][-1]) == pytest.approx(2.0)
