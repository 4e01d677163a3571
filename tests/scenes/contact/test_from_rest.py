"""What rests at first, without any motion of its own to be measured by."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from tests.scenes.contact.motions import GLOBAL, G, close, contact, play, scene

END = 3.0
AMPLITUDE, BOUND, RATE = 2.0, 1.5, 3.0


@dataclass(frozen=True)
class Told:
    """In which words: units, an origin, a moving observer, a time, and who is there."""

    length: float = 1.0
    mass: float = 1.0
    place: float = 0.0
    speed: float = 0.0
    start: float = 0.0
    beside: float = 0.0
    sign: float = 1.0

    @property
    def force(self) -> float:
        """The unit of force."""
        return self.length * self.mass

    @property
    def later(self) -> str:
        """The time since the start."""
        return f"(t - {self.start!r})"

    def where(self, x, t):
        """Give x as it is told, from the motion over what is at rest."""
        moved = self.place + self.speed * (t - self.start)
        return self.length * (moved + self.sign * np.asarray(x))

    def bystander(self) -> tuple[str, str, str, dict[str, float]]:
        """A coordinate, its energies and where it starts."""
        if not self.beside:
            return "", "", "", {}
        heavy = self.beside * self.mass
        return " z", f" + {heavy}*z_dot^2/2", f" + {heavy}*2*z^2", {"z": self.length}


WORDS = {
    "plainly": Told(),
    "tiny": Told(length=1e-6, mass=1e-9),
    "elsewhere": Told(place=1.0),
    "far away": Told(place=1e3),
    "from a train": Told(speed=3.0),
    "in mm and Mg": Told(length=1e3, mass=1e-3),
    "in km and g": Told(length=1e-3, mass=1e3),
    "beside a heavy one": Told(beside=1e6),
    "later": Told(start=7.0),
    "all at once": Told(1e3, 1e-3, 1.0, -2.0, -5.0, 1e6, -1.0),
}
words = pytest.mark.parametrize("told", WORDS.values(), ids=WORDS)


def pushed(law: str, told: Told) -> str:
    """A body that 2 sin 3t pushes against dry friction of 1.5."""
    q, kinetic, potential, z = told.bystander()
    slip = f"(x_dot - {told.speed * told.length!r})"
    push = f"{told.sign * AMPLITUDE * told.force!r}*sin({RATE}*{told.later})"
    forces = {"x": push}
    constraints, y, bound = {}, "", BOUND * told.force
    if law == "limit":
        constraints["rest"] = {"relation": f"{slip} = 0", "limit": bound}
    elif law == "sign":
        forces["x"] += f" - {bound!r}*sign({slip})"
    else:
        y = "y"
        mu = {"friction": BOUND / 10, "slip": slip}
        constraints["rest"] = contact("y >= 0", 0.0, **mu)
        kinetic += f" + {told.mass}*y_dot^2/2"
        potential += f" + {10 * told.force}*y"
    return scene(
        f"x {y}{q}", f"{told.mass}*x_dot^2/2{kinetic}", f"0{potential}", constraints,
        {"x": told.where(0.0, told.start).item(), "x_dot": told.speed * told.length}
        | ({"y": 0.0} if y else {}) | z,
        forces=forces, start=told.start, duration=END,
    )  # fmt: skip


def slips():
    """Give of each slip when it begins and ends, and its sign: the closed form."""
    found, t = [], math.asin(BOUND / AMPLITUDE) / RATE
    for k in range(3):
        begins, sign = t + k * math.pi / RATE, (-1) ** k
        ends = brentq(
            lambda u, t0=begins, s=sign: gained(u, t0, s),
            begins + 0.1,
            begins + 1.0,
            xtol=1e-15,
        )
        found.append((begins, ends, sign))
    return found


def gained(t, begins, sign):
    """Give the velocity of a slip: the integral of 2 sin 3t - 1.5 sign."""
    swing = AMPLITUDE / RATE * (np.cos(RATE * begins) - np.cos(RATE * t))
    return swing - sign * BOUND * (t - begins)


def travelled(t, begins, sign):
    """Give the way of a slip, the integral of that."""
    swing = AMPLITUDE / RATE * np.cos(RATE * begins) * (t - begins)
    swing -= AMPLITUDE / RATE**2 * (np.sin(RATE * t) - np.sin(RATE * begins))
    return swing - sign * BOUND * (t - begins) ** 2 / 2


def place(t):
    """Give x at times t: it sticks and slips by turns."""
    return sum(
        np.where(t > begins, travelled(np.minimum(t, ends), begins, sign), 0.0)
        for begins, ends, sign in slips()
    )


@words
@pytest.mark.parametrize("law", ["limit", "contact", "sign"])
def test_a_force_that_begins_at_zero_sets_a_body_in_motion(law, told):
    found = play(pushed(law, told))
    t = found.t - told.start
    x = found["x"] / told.length
    close(x, told.where(place(t), found.t) / told.length, 1e-11)
    begin, end, _ = zip(*slips(), strict=True)
    assert [s - told.start for s in found.times("slip")] == pytest.approx([*begin])
    stuck = [s - told.start for s in found.times("stick") if s > told.start]
    assert stuck == pytest.approx([s for s in end if s < END])


def oblique(angle: float, told: Told, push: str | None = None) -> str:
    """The same on a floor: a force at an angle, or one of two components."""
    q, kinetic, potential, z = told.bystander()
    m, u = told.mass, repr(told.speed * told.length)
    size = f"{told.sign * AMPLITUDE * told.force!r}*sin({RATE}*{told.later})"
    slip = [f"x_dot - {u}", f"y_dot + {u}"]
    start = told.place * told.length
    return scene(
        f"x y h{q}", f"{m}*(x_dot^2 + y_dot^2 + h_dot^2)/2{kinetic}",
        f"{10 * told.force}*h{potential}",
        {"floor": contact("h >= 0", 0.0, friction=BOUND / 10, slip=slip)},
        {"x": start, "y": -start, "h": 0.0, "x_dot": u, "y_dot": f"-{u}"} | z,
        forces={
            "x": (push or f"{size}*{{}}").format(f"cos({angle})"),
            "y": (push or f"{size}*{{}}").format(f"sin({angle})"),
        },
        start=told.start, duration=END,
    )  # fmt: skip


def check_oblique(angle, told):
    found = play(oblique(angle, told))
    moved = (told.place + told.speed * (found.t - told.start)) * told.length
    x, y = (found["x"] - moved) / told.length, (found["y"] + moved) / told.length
    along = told.sign * (x * math.cos(angle) + y * math.sin(angle))
    size = GLOBAL * (1.0 + np.max(np.abs(moved)) / told.length)
    assert along == pytest.approx(place(found.t - told.start), abs=size)
    assert y * math.cos(angle) - x * math.sin(angle) == pytest.approx(0.0, abs=size)
    begin, end, _ = zip(*slips(), strict=True)
    assert [s - told.start for s in found.times("slip")] == pytest.approx([*begin])
    stuck = [s for s in end if s < END]
    assert [s - told.start for s in found.times("stick")] == pytest.approx(stuck)


@words
def test_a_force_at_an_angle_in_other_words(told):
    check_oblique(1.0, told)


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.6435, math.pi / 2, 2.0, -3.0])
def test_a_force_at_any_angle(angle):
    check_oblique(angle, WORDS["plainly"])


@pytest.mark.slow
@pytest.mark.parametrize("first", [0.0, BOUND])
@pytest.mark.parametrize("turn", [0.0, 0.7, 3.0])
def test_a_force_that_grows_and_turns_past_its_bound(turn, first):
    # Implicit steps of another kind, from just after the slip begins: there the slip
    # has the direction of the force, but for what it turns in that time.
    found = play(oblique(0.0, WORDS["plainly"], f"({first} + t)*{{}}")
                 .replace("cos(0.0)", f"cos({turn}*t)")
                 .replace("sin(0.0)", f"sin({turn}*t)"))  # fmt: skip
    begins, after = BOUND - first, 1e-6
    way = np.array([math.cos(turn * begins), math.sin(turn * begins)])

    def rates(t, state):
        speeds, angle = state[2:], turn * t
        push = (first + t) * np.array([math.cos(angle), math.sin(angle)])
        return [*speeds, *(push - BOUND * speeds / np.hypot(*speeds))]

    told = solve_ivp(
        rates, (begins + after, END), [*(way * after**3 / 6), *(way * after**2 / 2)],
        method="Radau", rtol=1e-11, atol=1e-17,
    ).y[:, -1]  # fmt: skip
    assert found.times("slip") == pytest.approx([begins], abs=1e-12)
    names = ("x", "y", "x_dot", "y_dot")
    assert [found.at(name, END) for name in names] == pytest.approx([*told], abs=1e-10)


STIFF = 100.0


def hops(mass, duration):
    """Give when a slider slips that a moving end pulls by a spring: the closed form.

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


@pytest.mark.parametrize("mass", [1e-4, 1e-5, 1e-6, 1e-7])
def test_a_light_slider_on_a_driven_spring_starts_from_rest(mass):
    text = scene(
        "x s", f"x_dot^2/2 + {mass}*s_dot^2/2", f"{STIFF / 2}*(x - s)^2",
        {
            "drive": "x = 0.1*sin(2*pi*t)",
            "rest": {"relation": "s_dot = 0", "limit": 0.5},
        },
        {"x": 0, "s": 0, "x_dot": {"guess": 0.6}},
        duration=0.05,
    )  # fmt: skip
    found = play(text)
    times, s = hops(mass, 0.05)
    assert len(times) > 1
    assert found.times("slip") == pytest.approx(times, abs=1e-9)
    assert found["s"][-1] == pytest.approx(s, abs=1e-9)


MU = 0.3


def stack(count: int, told: Told) -> str:
    """Equal blocks, one on another, of which the bottom one is pushed by 20 t."""
    q, kinetic, potential, z = told.bystander()
    laws, initial = {}, dict(z)
    for k in range(count):
        below, base = (f"y{k - 1}", f"x{k - 1}_dot") if k else ("0", "")
        base = base or repr(told.speed * told.length)
        gap = f"y{k} - {below} >= {told.length if k else 0.0}"
        laws[f"c{k}"] = contact(gap, 0.0, friction=MU, slip=f"x{k}_dot - {base}")
        initial |= {
            f"x{k}": told.where(0.0, told.start).item(),
            f"y{k}": k * told.length,
        }
        initial |= {f"x{k}_dot": told.speed * told.length}
        kinetic += f" + {told.mass}*(x{k}_dot^2 + y{k}_dot^2)/2"
        potential += f" + {G * told.force}*y{k}"
    names = " ".join(f"x{k} y{k}" for k in range(count))
    push = f"{told.sign * 20 * told.force!r}*{told.later}"
    return scene(
        names + q, f"0{kinetic}", f"0{potential}", laws, initial,
        forces={"x0": push}, start=told.start, duration=END,
    )  # fmt: skip


def carried(count: int, t):
    """Give x of the blocks above: with the bottom one, then pulled by friction alone.

    All are at their bounds then, and none of them slips on the next.
    """
    load = MU * count * G
    slips, parts = load / 20, 2 * load / 20
    moving = np.clip(t, slips, parts)
    way = (20 * (moving - slips) ** 3 / 6) / count
    speed = (20 * (parts - slips) ** 2 / 2) / count
    late = np.maximum(t - parts, 0.0)
    return way + speed * late + MU * G * late**2 / 2


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_equal_blocks_are_at_their_bounds_together(count):
    found = play(stack(count, WORDS["plainly"]))
    assert found.instants("slip") == pytest.approx(
        [MU * count * G / 20 * k for k in (1, 2)]
    )
    for k in range(1, count):
        close(found[f"x{k}"], carried(count, found.t), 1e-11)


@words
def test_a_pushed_stack_in_other_words(told):
    found = play(stack(3, told))
    expected = told.where(carried(3, found.t - told.start), found.t)
    for name in ("x1", "x2"):
        close(found[name] / told.length, expected / told.length, 1e-11)
    assert len(found.times("slip")) == 2
