"""What is held at rest, or balanced: it stays, and nothing is said of its rounding.

By friction in three forms, rows, contacts, springs and symmetry; in ten wordings. The
closed form is the place where it is, whatever is rounded on the way.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np
import pytest

import lagsim
from tests.scenes.contact.motions import contact, scene
from tests.scenes.contact.test_from_rest import WORDS, Told

END = 3.0
# Told errors are rounding: of the way that forces could go, or of the place.
ROUNDING = 1e-11


@dataclass
class Words:
    """The parts of expressions in a wording, for x and y at rest at one place."""

    told: Told
    laws: dict = field(default_factory=dict)
    forces: dict = field(default_factory=dict)
    initial: dict = field(default_factory=dict)
    potential: str = "0"
    kinetic: str = ""
    more: str = ""

    @property
    def force(self) -> str:
        """The unit of force, along x."""
        return repr(self.told.sign * self.told.force)

    @property
    def energy(self) -> str:
        """The unit of energy."""
        return repr(self.told.force * self.told.length)

    @property
    def t(self) -> str:
        """The time since the start."""
        return self.told.later

    @property
    def drift(self) -> str:
        """The speed of what is at rest."""
        return repr(self.told.speed * self.told.length)

    @property
    def now(self) -> str:
        """Its place."""
        return f"({self.told.place * self.told.length!r} + {self.drift}*{self.t})"

    def at(self, q: str) -> str:
        """Give a coordinate in lengths, from there."""
        return f"(({q} - {self.now})/{self.told.sign * self.told.length!r})"

    def friction(self, q: str, bound: float = 1.5) -> str:
        """Give dry friction as a force."""
        return f"-{bound * self.told.force!r}*sign({q}_dot - {self.drift})"

    def limit(self, q: str, bound: float = 1.5) -> dict:
        """Give it as a limited constraint."""
        return {
            "relation": f"{q}_dot - {self.drift} = 0",
            "limit": bound * self.told.force,
        }

    def add(self, name: str, value: float = 0.0) -> None:
        """Add a coordinate that is no place of the frame."""
        self.more += f" {name}"
        self.kinetic += f" + {self.told.mass}*{name}_dot^2/2"
        self.initial[name] = value

    def weight(self, name: str, size: float = 10.0) -> None:
        """Let it weigh."""
        self.potential += f" + {size * self.told.force}*{name}"


def friction(push, law):
    """x under a push below the bound, 1.5."""

    def put(w):
        w.forces["x"] = push.format(F=w.force, t=w.t)
        if law == "sign":
            w.forces["x"] += f" {w.friction('x')}"
        elif law == "limit":
            w.laws["rest"] = w.limit("x")
        else:
            w.add("h")
            w.weight("h")
            slip = f"x_dot - {w.drift}"
            w.laws["floor"] = contact("h >= 0", 0.0, friction=0.15, slip=slip)

    return put


PUSHES = {
    "nothing": "0*{F}",
    "a constant": "{F}",
    "sine": "{F}*sin(3*{t})",
    "what cancels": "{F}*(1.2 - 1.1)",
    "a late step": "if({t} > 1, 0.9*{F}, 0)",
    "a pulse": "1.4*{F}*exp(-50*({t} - 1.5)^2)",
    "a ramp": "0.4*{F}*{t}",
}


def springs(w):
    w.potential += f" + {w.energy}*({w.at('x')} - {w.at('y')} + 0.3)^2"
    w.forces["x"] = f"{w.force}*0.5*sin(5*{w.t}) {w.friction('x')}"
    w.forces["y"] = w.friction("y")


def springs_limited(w):
    w.potential += f" + {w.energy}*({w.at('x')} - {w.at('y')} + 0.3)^2"
    w.forces["x"] = f"{w.force}*0.5*sin(5*{w.t})"
    w.laws |= {"a": w.limit("x"), "b": w.limit("y", 1.2)}


def fixed_spring(w):
    w.potential += f" + {w.energy}*({w.at('x')} + 0.3)^2"
    w.forces["x"] = f"{w.force}*0.5*sin(5*{w.t}) {w.friction('x')}"


def incline(w):
    grip = w.friction("x", 9.81 * 0.5 * np.cos(0.4).item())
    w.forces["x"] = f"-{w.force}*9.81*sin(0.4)*(1 + 0.1*sin({w.t})) {grip}"


def disc(w):
    w.add("h")
    w.weight("h")
    slip = [f"x_dot - {w.drift}", f"y_dot - {w.drift}"]
    w.laws["floor"] = contact("h >= 0", 0.0, friction=0.15, slip=slip)
    w.forces["x"] = f"{w.force}*sin(3*{w.t})"
    w.forces["y"] = f"0.5*{w.force}*cos(3*{w.t})"


def beside_a_swing(w):
    """h swings, and pulls at x."""
    w.add("h", w.told.length)
    w.potential += f" + {1.5 * w.told.mass}*h^2"
    w.forces["x"] = f"{w.force}*h/{w.told.length!r} {w.friction('x')}"


def row(w):
    w.laws["hold"] = f"x = {w.now}"
    w.forces["x"] = f"{w.force}*(1 + sin(3*{w.t}))"


def while_in_force(w):
    w.laws["hold"] = {"relation": f"x = {w.now}", "when": f"{w.t} < 100"}
    w.forces["x"] = f"{w.force}*sin(3*{w.t})"


def tug(w):
    w.laws["rope"] = f"x + y = 2*{w.now}"
    w.forces = dict.fromkeys("xy", f"{w.force}*(1 + sin(2*{w.t}))")


def rod(way):
    def put(w):
        w.add("h", way * w.told.length)
        w.weight("h")
        w.laws["rod"] = f"{w.at('x')}^2 + (h/{w.told.length!r})^2 = 1"

    return put


def legs(w):
    w.more += " a h"
    w.kinetic += f" + {w.told.mass}*({w.told.length**2}*a_dot^2 + h_dot^2)/2"
    w.initial |= {"a": 0.0, "h": 0.0}
    w.weight("h", 9.81)
    slip, turned = f"x_dot - {w.drift}", f"{w.told.length!r}*a"
    w.laws["left"] = contact(f"h + 0.3*{turned} >= 0", 0.3, friction=0.5, slip=slip)
    w.laws["right"] = contact(f"h - 0.4*{turned} >= 0", 0.3)
    w.forces["x"] = f"{w.force}*sin(3*{w.t})"


def wall(w):
    w.laws["wall"] = contact(f"{w.at('x')} >= 0", 0.5)
    w.forces["x"] = f"-{w.force}"


def potential(text):
    def put(w):
        w.potential += f" + {w.energy}*({text.format(x=w.at('x'), y=w.at('y'))})"

    return put


def loaded(w):
    w.potential += f" + {w.energy}*2*({w.at('x')} + 0.3)^2"
    w.forces["x"] = f"1.2*{w.force}"


def symmetric(w):
    """x between two springs, of which the other ends are as far to both sides of h."""
    w.add("h", 0.7 * w.told.length)
    h = f"h/{w.told.length!r}"
    ends = [f"(hypot({w.at('x')} {s} 1, {h}) - 0.5)^2" for s in "+-"]
    w.potential += f" + {w.energy}*2*({' + '.join(ends)})"


SCENES = {
    **{
        f"{law} against {name}": friction(push, law)
        for law in ("sign", "limit", "contact")
        for name, push in PUSHES.items()
    },
    "two by sign, with a spring": springs,
    "two by limits, with a spring": springs_limited,
    "by sign, with a fixed spring": fixed_spring,
    "by sign on an incline": incline,
    "by friction on a disc": disc,
    "by sign, beside a swing": beside_a_swing,
    "by a row": row,
    "by a row in force": while_in_force,
    "by a rope": tug,
    "below a rod": rod(-1.0),
    "on a rod": rod(1.0),
    "on legs": legs,
    "at a wall": wall,
    "in a valley": potential("2*{x}^2"),
    "in a loaded valley": loaded,
    "on a hill": potential("4*cos({x})"),
    "hanging": potential("-4*cos({x}) - 2*cos({x} - {y})"),
    "between springs": symmetric,
    "in a valley of two": potential("({x} + {y})^2 + ({x} - {y})^2*(1 + {x}*{y})"),
}
QUICK = {"plainly", "tiny", "all at once"}


def text_of(name, told, duration=END):
    w = Words(told)
    SCENES[name](w)
    q, kinetic, energy, z = told.bystander()
    place, speed = told.where(0.0, told.start).item(), told.speed * told.length
    initial = {"x": place, "y": place, "x_dot": speed, "y_dot": speed}
    m = told.mass
    return scene(
        f"x y{w.more}{q}", f"{m}*(x_dot^2 + y_dot^2)/2{w.kinetic}{kinetic}",
        f"{w.potential}{energy}", w.laws, initial | w.initial | z, forces=w.forces,
        start=told.start, duration=duration, output_step=duration / 100,
    )  # fmt: skip


@functools.cache
def held(name, word, **options):
    return lagsim.simulate(lagsim.load(text_of(name, WORDS[word])), **options)


def check(run, told):
    """It is done without a word, in few steps, stays, and its error is rounding."""
    record = run.record
    codes = {x["code"] for x in record["warnings"]} - {"unused-parameter"}
    assert (record["outcome"], codes) == ("done", set())
    assert record["error"]["horizon"] is None
    assert record["error"]["relative"] < ROUNDING
    assert record["steps"] <= 200
    t = np.asarray(run.t)
    place = told.where(0.0, t)
    for q in ("x", "y"):
        size = told.length + np.max(np.abs(place))
        assert np.max(np.abs(run[q] - place)) < 1e-12 * size


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(
    "word",
    [w if w in QUICK else pytest.param(w, marks=pytest.mark.slow) for w in WORDS],
)
def test_what_is_held_stays_without_a_word(name, word):
    check(held(name, word), WORDS[word])


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(
    "options",
    [{"method": "dop853"}, {"rtol": "1e-4"}, {"rtol": "1e-13"}, {"method": "rk4"}],
    ids=lambda x: "-".join(x.values()),
)
def test_by_other_means(name, options):
    run = held.__wrapped__(name, "in mm and Mg", **options)
    record = run.record
    codes = {x["code"] for x in record["warnings"]} - {"unused-parameter"}
    # What is linear is solved exactly, whatever the tolerance.
    codes -= {"tolerance-unused"} if record["method"] == "exponential" else set()
    assert (record["outcome"], codes) == ("done", set())
    assert record["error"]["horizon"] is None
    assert np.max(np.abs(run["x"])) < 1e-9


SMALL = """
parameters: {size: 1, L: 1}
coordinates: {x: {}, z: {}}
energy:
  kinetic: (x_dot^2 + 1e6*z_dot^2)/2
  potential: 200*(x/L + 0.05)^2*L^2 + 1e6*z^2/2
forces: {x: 20*L}
initial: {x: size*L, z: L}
simulation: {duration: 30, output_step: 0.1, method: dop853, rtol: 1e-6}
"""


@pytest.mark.parametrize("length", ["1e-9", "1", "1e6"])
@pytest.mark.parametrize("size", [1e-1, 1e-5, 1e-8])
def test_a_small_motion_about_a_balance_is_told_as_a_part_of_its_own(size, length):
    # cos(20 t), whatever the load: forces that cancel are no scale of what moves.
    model = lagsim.load(SMALL).bind(size=size, L=float(length))
    run = lagsim.simulate(model)
    range_ = size * float(length)
    true = np.max(np.abs(run["x"] - range_ * np.cos(20 * np.asarray(run.t)))) / range_
    told = run.record["error"]["coordinates"]["x"]["relative"] * 2
    assert told > 1e-9
    assert true / 30 < told < 30 * true + 1e-6
