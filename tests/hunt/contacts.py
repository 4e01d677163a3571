"""Random scenes of contact, written for lagsim in another form than for the referee.

A scene is one to three bodies (balls, stops, strings, blocks, wheels), perhaps joined
by springs. For lagsim it is written with another origin, in a moving frame, in other
units, at another time, beside a heavy body, with its constraints in another order: the
motion does not change.
"""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import dataclass, replace
from math import cos, sin

import yaml

from tests.hunt import hybrid
from tests.hunt.hybrid_verdict import Told
from tests.hunt.scene import Item, Law, Scene
from tests.invariance.same import CHANGES, Sizes
from tests.invariance.transforms import document


def part(
    q, kinetic, potential, laws, start,
    speeds, forces = None, loose = (),
):  # fmt: skip
    """Return a moving part whose coordinates begin at `start` with `speeds`."""
    states = zip(start, speeds, strict=True)
    return Item(
        "part", coordinates=dict(zip(q, states, strict=True)), kinetic=(kinetic,),
        potential=(potential,), forces=tuple((forces or {}).items()), laws=tuple(laws),
        loose=tuple(loose),
    )  # fmt: skip


def restitution(r):
    return r.choice([0.0, 0.0, 1.0, 0.5, 0.8, round(r.uniform(0.05, 0.95), 2)])


def friction(r, slip):
    if r.random() < 0.3:
        return {}
    mu = round(r.choice([0.0, r.uniform(0.05, 0.4), r.uniform(0.4, 0.9)]), 2)
    static = round(mu * 1.3, 3) if r.random() < 0.3 and mu else 0.0
    return {"mu": mu, "static": static, "slip": slip}


def some(r, low, high):
    return round(r.uniform(low, high), 3)


def line(r, k):
    """Balls on a line, perhaps between walls, under weight or none."""
    count = r.randint(1, 4)
    q = [f"x{k}{i}" for i in range(count)]
    m = [some(r, 0.2, 3) for _ in q]
    walls = r.choice(["left", "both", "both"])
    width = 0.5
    laws = [Law("contact", f"{q[0]} - {width / 2}", restitution(r))]
    for a, b in itertools.pairwise(q):
        laws.append(Law("contact", f"{b} - {a} - {width}", restitution(r)))
    room = some(r, 0.3, 2) + count * (width + 0.4)
    if walls == "both":
        laws.append(Law("contact", f"{room} - {q[-1]} - {width / 2}", restitution(r)))
    gaps = [some(r, 0.02, 0.35) for _ in q]
    start = [width / 2 + i * width + sum(gaps[: i + 1]) for i in range(count)]
    g = r.choice([0, 9.81, 2, -3])
    potential = " + ".join(f"{w * g!r}*{x}" for w, x in zip(m, q, strict=True))
    if count > 1 and r.random() < 0.4:
        potential += f" + {some(r, 1, 50)}*({q[-1]} - {q[0]} - {count * 0.6})^2/2"
    forces = {}
    if r.random() < 0.4:
        forces[r.choice(q)] = f"{some(r, 1, 8)}*sin({some(r, 1, 9)}*t)"
    return part(
        q, " + ".join(f"{w}*{x}_dot^2/2" for w, x in zip(m, q, strict=True)),
        potential, laws, start, [some(r, -2, 2) for _ in q], forces,
        q,
    )  # fmt: skip


def disc(r, k):
    """Spinning balls that touch a floor, which may move, a wall, and one another."""
    count = r.choice([1, 1, 2])
    q, T, V, laws, start, speeds = [], [], [], [], [], []
    table = r.choice(["0", "0", f"{some(r, 0.01, 0.1)}*sin({some(r, 3, 20)}*t)",
                      f"{some(r, -0.3, 0.3)}*t"])  # fmt: skip
    belt = r.choice(["0", f"{some(r, -1, 1)}"])
    for i in range(count):
        x, y, a = f"x{k}{i}", f"y{k}{i}", f"a{k}{i}"
        m, R = some(r, 0.3, 2), 0.1
        q += [x, y, a]
        T.append(f"{m}*({x}_dot^2 + {y}_dot^2)/2 + {0.4 * m * R * R!r}*{a}_dot^2/2")
        V.append(f"{m * 9.81!r}*{y}")
        slip = f"{x}_dot + {R}*{a}_dot - {belt}"
        laws.append(
            Law("contact", f"{y} - {R} - {table}", restitution(r), **friction(r, slip))
        )
        if r.random() < 0.5:
            wall = Law("contact", f"{i + 0.6} - {x}", restitution(r))
            laws.append(wall)
        start += [0.35 * i, some(r, 0.3, 1.0), 0.0]
        speeds += [some(r, -1, 1), some(r, -1, 1), r.choice([0.0, some(r, -40, 40)])]
    if count == 2:
        gap = f"hypot(x{k}1 - x{k}0, y{k}1 - y{k}0) - 0.2"
        if r.random() < 0.4:
            gap = f"(x{k}1 - x{k}0)^2 + (y{k}1 - y{k}0)^2 - 0.04"
        laws.append(Law("contact", gap, restitution(r)))
    return part(q, " + ".join(T), " + ".join(V), laws, start, speeds, {},
                q)  # fmt: skip


def pendulum(r, k):
    """A pendulum with stops, in its angle or in x and y on a rod."""
    size, e, m = some(r, 0.4, 1.5), restitution(r), some(r, 0.3, 2)
    if r.random() < 0.5:
        a = f"a{k}"
        laws = [Law("contact", f"{a} + {some(r, 0.0, 0.9)}", e)]
        if r.random() < 0.5:
            laws.append(Law("contact", f"{some(r, 0.5, 1.4)} - {a}", restitution(r)))
        if r.random() < 0.3:
            laws.append(Law("limit", f"{a}_dot", limit=repr(some(r, 0.1, 1.5))))
        drive = f"{some(r, 0, 4)}*cos({some(r, 1, 6)}*t)"
        return part(
            [a], f"{m * size * size!r}*{a}_dot^2/2",
            f"-{m * 9.81 * size!r}*cos({a})", laws,
            [some(r, 0.1, 0.45)], [some(r, -2, 2)], {a: drive}, [a],
        )  # fmt: skip
    x, y, th = f"x{k}", f"y{k}", some(r, 0.3, 1.2)
    w = some(r, -1, 1)
    laws = [
        Law("equality", f"{x}^2 + {y}^2 - {size * size!r}"),
        Law("contact", f"{x} + {some(r, 0, 0.3)}", e),
    ]
    if r.random() < 0.4:
        laws.append(Law("contact", f"{y} + {0.97 * size!r}", restitution(r)))
    return part(
        [x, y], f"{m}*({x}_dot^2 + {y}_dot^2)/2", f"{m * 9.81!r}*{y}", laws,
        [size * sin(th), -size * cos(th)], [size * cos(th) * w, size * sin(th) * w],
    )  # fmt: skip


def string(r, k):
    """Bob on a slack string, or in a bowl, in two or three dimensions."""
    q = [f"x{k}", f"y{k}"] + ([f"z{k}"] if r.random() < 0.4 else [])
    size, m, up = some(r, 0.4, 1), some(r, 0.3, 2), r.choice([1, 1, -1])
    square = " + ".join(f"{x}^2" for x in q)
    gap = (
        f"{size} - sqrt({square})"
        if r.random() < 0.6
        else f"{size * size!r} - ({square})"
    )
    laws = [Law("contact", gap, restitution(r))]
    if r.random() < 0.4:
        laws.append(Law("contact", f"{q[0]} + {some(r, 0, 0.3)}", restitution(r)))
    start = [some(r, 0.0, 0.25 * size) for _ in q]
    return part(
        q, f"{m}*({' + '.join(f'{x}_dot^2' for x in q)})/2",
        f"{m * up * 9.81!r}*{q[1]}", laws, start, [some(r, -2, 2) for _ in q], {},
        q,
    )  # fmt: skip


def block(r, k):
    """A block on an incline, a spring at it, a stop below, the floor perhaps a belt."""
    s, n, m, a = f"s{k}", f"n{k}", some(r, 0.5, 3), some(r, 0, 0.8)
    belt = r.choice(["0", "0", repr(some(r, -0.6, 0.6)), f"0.3*sin({some(r, 1, 8)}*t)"])
    rough = friction(r, f"{s}_dot - {belt}") or {"mu": 0.3, "slip": f"{s}_dot - {belt}"}
    laws = [Law("contact", n, restitution(r), **rough)]
    V = f"{m * 9.81 * cos(a)!r}*{n} - {m * 9.81 * sin(a)!r}*{s}"
    if r.random() < 0.6:
        V += f" + {some(r, 5, 100)}*{s}^2/2"
    if r.random() < 0.5:
        laws.append(Law("contact", f"{some(r, 0.05, 0.6)} - {s}", restitution(r)))
    high = r.choice([0.0, some(r, 0, 0.3)])
    forces = {}
    if r.random() < 0.3:  # a soft bumper: a kink
        forces[s] = f"{some(r, 50, 400)}*max(0, -0.02 - {s})"
    return part(
        [s, n], f"{m}*({s}_dot^2 + {n}_dot^2)/2", V, laws, [0.0, high],
        [some(r, -2, 2), 0.0 if high == 0.0 else some(r, -1, 1)], forces,
        [s, n] if high > 0.0 else [s],
    )  # fmt: skip


def wheels(r, k):
    """Two inertias: a freewheel or a clutch between them, a stop on one."""
    a, b = f"a{k}", f"b{k}"
    drive = {a: f"{some(r, 1, 10)}*sin({some(r, 1, 7)}*t)"}
    laws = [
        r.choice([
            Law("wheel", f"{b}_dot - {a}_dot"),
            Law("limit", f"{a}_dot - {b}_dot", limit=repr(some(r, 0.3, 4))),
        ])
    ]  # fmt: skip
    if r.random() < 0.5:
        laws.append(Law("limit", f"{b}_dot", limit=repr(some(r, 0.1, 2))))
    if r.random() < 0.5:
        laws.append(Law("contact", f"{some(r, 0.3, 2)} - {a}", restitution(r)))
    w = some(r, -3, 3)
    return part(
        [a, b], f"{some(r, 0.3, 2)}*{a}_dot^2/2 + {some(r, 0.3, 2)}*{b}_dot^2/2",
        f"{some(r, 0, 5)}*{b}^2/2", laws, [0.0, 0.0], [w, w + abs(some(r, 0, 2))],
        drive, [a, b],
    )  # fmt: skip


def latch(r, k):
    """Mass over a floor, held at its place until a latch releases it."""
    y, m, e = f"y{k}", some(r, 0.3, 2), restitution(r)
    laws = [
        Law("equality", f"{y} - 0.4", until=some(r, 0.1, 0.8)),
        Law("contact", y, e),
    ]
    return part([y], f"{m}*{y}_dot^2/2", f"{m * 9.81!r}*{y}", laws, [0.4], [0.0])


PARTS = [
    line, line, disc, disc, pendulum, string, block, block,
    wheels, latch,
]  # fmt: skip

UNITS = ("metres", "megametres", "microseconds", "years", "grams", "tonnes")


@dataclass(frozen=True)
class ContactScene:
    """Scene in the form of the referee, and its other form for lagsim."""

    scene: Scene
    words: tuple[str, ...] = ()

    def told(self):
        """Return the scene in both forms; lagsim's columns are those of the scene."""
        scene = self.scene
        rates = {f"rate_{q}": f"{q}_dot" for q in scene.q}
        items = (*scene.items, Item("rates", definitions=rates))
        found = document(replace(scene, items=items).text(), keep=tuple(rates))
        # Sizes are in the scene's own units: these change last.
        for word in sorted(self.words, key=UNITS.__contains__):
            found = CHANGES[word].put(found, Sizes(1.0, 1.0, scene.duration))
        return Told(
            found.text(), plain_of(scene),
            {q: q for q in scene.q} | {v: rate for rate, v in rates.items()},
            scene.start, scene.times, 1e-7 * scene.output_step, found.shift,
            found.scale, sum(CHANGES[word].rounding for word in self.words), 1e-3,
            # Impacts by turns that accumulate end as the last bits have it.
            (("impact-order", math.inf),),
        )  # fmt: skip


def plain_of(scene):
    """Return a scene in the form of the hybrid referee."""
    items = tuple(replace(item, laws=()) for item in scene.items)
    laws: list[hybrid.Law] = []
    for law in scene.terms("laws"):
        kind = {"equality": "hold", "wheel": "ratchet"}.get(law.kind, law.kind)
        when = f"t < {law.until!r}" if law.until < math.inf else "1 > 0"
        contact = hybrid.Law(kind, law.gap, when, e=repr(law.e), mu=law.limit or "0")
        if law.slip:
            laws.append(hybrid.Law(
                "slip", law.slip, when, mu=repr(law.mu),
                static=repr(law.static or law.mu), normal=len(laws) + 1,
            ))  # fmt: skip
        laws.append(contact)
    times = [law.until for law in scene.terms("laws") if law.until < math.inf]
    # BaseLoader keeps all scalars text.
    text = replace(scene, items=items).text()
    document = yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506
    return hybrid.Plain(document, tuple(laws), times=tuple(times))


def contact_scene(seed):
    """Return the scene of a seed."""
    r = random.Random(seed)
    count = r.choice([1, 1, 1, 2, 2, 3])
    parts = [r.choice(PARTS)(r, k) for k in range(count)]
    if count > 1 and sum(len(p.coordinates) for p in parts if p.loose) > 1:
        joined = r.random() < 0.5
        if joined:
            a, b = (r.choice([*p.coordinates]) for p in parts[:2])
            spring = f"{round(r.uniform(0.5, 10), 3)}*({a} - {b})^2/2"
            parts.append(Item("spring", potential=(spring,)))
    duration = r.choice([1.0, 2.0, 3.0])
    step = duration / r.choice([20, 64, 100])
    words = [*CHANGES]
    if any(law.kind == "wheel" for p in parts for law in p.laws):
        # A freewheel has to be homogeneous in the velocities: no train.
        words.remove("boosted")
    some = tuple(r.sample(words, r.choice([0, 1, 1, 2, 3])))
    return ContactScene(Scene(seed, tuple(parts), 0.0, duration, step), some)
