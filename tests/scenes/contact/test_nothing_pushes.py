"""What touches without a force parts, or holds, as the force that begins says it does.

Nothing weighs here. Forces are 0 at the start, and begin as t, t^3 or sin: at the start
itself no acceleration tells which of what touches goes on to do so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.scenes.contact.motions import GLOBAL, close, contact, play, scene

if TYPE_CHECKING:
    from collections.abc import Callable

END, RATE = 2.0, 7.0
HALF = math.pi / RATE


@dataclass(frozen=True)
class Force:
    """A force in words of {s}, the time since the start, and where it takes 1 kg."""

    text: str
    ways: Callable[[Any], Any]


LIFTS = {
    "t": Force("{s}", lambda s: s**3 / 6),
    "t^3": Force("{s}^3", lambda s: s**5 / 20),
    "sin": Force(f"sin({RATE}*{{s}})", lambda s: s / RATE - np.sin(RATE * s) / RATE**2),
}
lifts = pytest.mark.parametrize("lift", LIFTS.values(), ids=LIFTS)


@dataclass(frozen=True)
class Told:
    """In which words: when it starts, a unit of mass, how heavy a bystander is."""

    start: float = 0.0
    mass: float = 1.0
    beside: float = 0.0

    def play(self, bodies: dict[str, float], laws, forces: dict[str, str]):
        """Run it; `bodies` are coordinates with their inertias."""
        kinetic = " + ".join(f"{self.mass * m}*{q}_dot^2/2" for q, m in bodies.items())
        potential, places = "0", dict.fromkeys(bodies, 0)
        if self.beside:
            kinetic += f" + {self.beside}*w_dot^2/2"
            potential, places = f"{self.beside}*w^2/2", places | {"w": 1}
        later = f"(t - {self.start!r})"
        forces = {q: f"{self.mass}*({f.format(s=later)})" for q, f in forces.items()}
        found = play(scene(
            " ".join(places), kinetic, potential, laws, places, forces=forces,
            start=self.start, duration=END, output_step=0.1,
        ))  # fmt: skip
        return found, found.t - self.start


WORDS = {
    "plainly": Told(),
    "later, in grams": Told(start=5.0, mass=1e3),
    "earlier, in tons": Told(start=-3.0, mass=1e-3),
    "beside a heavy one": Told(beside=1e6),
}
QUICK = ("plainly", "later, in grams")
words = pytest.mark.parametrize(
    "told",
    [
        pytest.param(told, id=name, marks=[] if name in QUICK else pytest.mark.slow)
        for name, told in WORDS.items()
    ],
)
FLOOR = {"floor": contact("y >= 0", 0)}
STACK = FLOOR | {"on": contact("z >= y", 0)}
WHEEL = {"wheel": {"relation": "b_dot >= a_dot"}}
BOX = {"l": contact("y - sin(th) >= 0", 0), "r": contact("y + sin(th) >= 0", 0)}


def events(found):
    """Give what happens; not what is rounding, at forces of 1e-9 at the most.

    Far from t = 0 the time itself is rounded, and with it the force that begins.
    """
    start = found.t[0]
    after = start + (1e-3 if start else -1.0)
    return [(e.kind, e.constraint) for e in found.result.events if e.time > after]


@lifts
@words
def test_what_is_lifted_parts_at_once(lift, told):
    found, s = told.play({"y": 1}, FLOOR, {"y": lift.text})
    assert events(found) == []
    close(found["y"], lift.ways(s))
    assert not np.any(found["lambda_floor"])


@lifts
@words
def test_a_stack_is_lifted_together_or_its_top_alone(lift, told):
    if lift is not LIFTS["sin"]:  # with that they part where it pulls back
        found, s = told.play({"y": 1, "z": 1}, STACK, {"y": lift.text})
        assert events(found) == []
        for q in "yz":
            close(found[q], lift.ways(s) / 2)
        assert np.all(found["lambda_on"][1:] > 0.0)
        assert not np.any(found["lambda_floor"])
    found, s = told.play({"y": 1, "z": 1}, STACK, {"z": lift.text})
    assert events(found) == []
    close(found["z"], lift.ways(s))
    assert np.max(np.abs(found["y"])) < 1e-12
    assert not np.any(found["lambda_on"])


@words
@pytest.mark.parametrize("power", [1, 2, 3])
def test_what_is_pressed_stays(told, power):
    for bodies, laws, q in (
        ({"y": 1}, FLOOR, "y"),
        ({"y": 1, "z": 1}, STACK, "z"),
        ({"y": 1, "th": 1 / 3}, BOX, "y"),
    ):
        found, s = told.play(bodies, laws, {q: f"-1*{{s}}^{power}"})
        assert events(found) == []
        assert np.max(np.abs(found[q])) < 1e-12
        pushes = sum(found[f"lambda_{name}"] for name in laws)
        times = 2 if laws is STACK else 1
        close(pushes, times * told.mass * s**power)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_force_that_grows_with_the_way_of_another(sign):
    # x = s^2/2 pushes y, which is s^4/24, or nothing.
    found, s = Told().play({"x": 1, "y": 1}, FLOOR, {"x": "1", "y": f"{sign}*x"})
    assert events(found) == []
    close(found["y"], s**4 / 24 if sign > 0 else np.zeros(len(s)))


@words
def test_what_is_pressed_first_parts_when_it_is_pulled(told):
    push = f"-1*{LIFTS['sin'].text}"
    found, s = told.play({"y": 1}, FLOOR, {"y": push})
    assert events(found) == [("release", "floor")]
    gone = told.start + HALF
    assert found.times("release") == pytest.approx([gone], abs=GLOBAL)
    r = np.maximum(s - HALF, 0.0)
    close(found["y"], r / RATE - np.sin(RATE * r) / RATE**2)


@lifts
@words
@pytest.mark.parametrize("sign", [1, -1])
def test_a_freewheel_takes_along_or_is_overrun(lift, told, sign):
    found, s = told.play({"a": 1, "b": 1}, WHEEL, {"a": f"{sign}*{lift.text}"})
    if lift is LIFTS["sin"]:
        if sign < 0:  # a stops again, beside b, at 2 pi/7: a touch
            return
        assert events(found)[:1] == [("release", "wheel")]
        assert told.start + HALF == pytest.approx(found.times("release")[0], abs=GLOBAL)
        s = np.minimum(s, HALF)
        close(found["b_dot"], (1 - np.cos(RATE * s)) / RATE / 2)
        return
    assert events(found) == []
    close(found["a"], sign * lift.ways(s) / (2 if sign > 0 else 1))
    close(found["b"], found["a"] if sign > 0 else np.zeros(len(s)))


@words
@pytest.mark.parametrize("power", [1, 3])
def test_a_box_is_lifted_flat_or_off_one_corner(told, power):
    lift = f"{{s}}^{power}"
    bodies = {"y": 1, "th": 1 / 3}
    found, s = told.play(bodies, BOX, {"y": lift})
    assert events(found) == []
    close(found["y"], LIFTS["t" if power == 1 else f"t^{power}"].ways(s))
    # Free, its left corner would go down: (1 - 3/2) s^k. It turns about that corner.
    found, s = told.play(bodies, BOX, {"y": lift, "th": f"0.5*{lift}"})

    def rates(s, x):
        th, v = x
        cos, sin = math.cos(th), math.sin(th)
        turned = (s**power * (cos + 0.5) + cos * sin * v * v) / (cos * cos + 1 / 3)
        return v, turned

    def pushes(s, x):
        return math.cos(x[0]) * rates(s, x)[1] - math.sin(x[0]) * x[1] ** 2 - s**power

    pushes.terminal, pushes.direction = True, -1
    held = solve_ivp(
        rates, (1e-3, END), [0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-15,
        events=pushes, dense_output=True,
    )  # fmt: skip
    # From rest at 1e-3 and not at 0: a part of 1e-6 of the way at 1 s is left.
    (gone,) = held.t_events[0]
    assert events(found) == [("release", "l")]
    assert found.times("release")[-1] == pytest.approx(told.start + gone, abs=1e-5)
    rows = (s > 0.1) & (s < gone)
    close(found["th"][rows], held.sol(s[rows])[0], 1e-4)
    close(found["y"][rows], np.sin(found["th"][rows]))
