"""Random scenes of contact, each told in other words to lagsim than to the referee.

A scene is one to three bodies (balls, stops, strings, blocks, wheels), perhaps joined
by springs. To lagsim it is told with another origin, from a train, in other units, at
another time, beside something heavy, its constraints in another order: the motion is
the same.
"""

from __future__ import annotations

import json
import random
import re
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests.hunt.contact_parts import (
    Law,
    block,
    disc,
    latch,
    line,
    pendulum,
    string,
    wheels,
)


@dataclass(frozen=True)
class Told:
    """The words: shifts and boosts by coordinate, units, start, bystander, order."""

    shifts: dict[str, float]
    boosts: dict[str, float]
    length: float = 1.0
    time: float = 1.0
    mass: float = 1.0
    start: float = 0.0
    heavy: float = 0.0
    order: int = 0
    settings: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ContactScene:
    """A scene, as the referee sees it, and how it is told."""

    seed: str
    q: list[str]
    kinetic: str
    potential: str
    forces: dict[str, str]
    laws: list[Law]
    start: list[float]
    speeds: list[float]
    loose: list[bool]
    duration: float
    step: float
    told: Told

    @property
    def times(self) -> list[float]:
        return [k * self.step for k in range(round(self.duration / self.step) + 1)]

    def plain(self) -> ContactScene:
        """Give the scene in the referee's own words."""
        return replace(self, told=Told({}, {}))

    def put(self, text: str) -> str:
        """Put an expression into the words of the file."""
        told = self.told

        def word(found: re.Match[str]) -> str:
            name = found.group(0)
            at = "t" if not told.start else f"(t - {told.start!r})"
            if name == "t":
                return at if told.time == 1.0 else f"({at}/{told.time!r})"
            q = name.removesuffix("_dot")
            if q not in self.q:
                return name
            V, X = told.boosts.get(q, 0.0), told.shifts.get(q, 0.0)
            if name != q:
                rate = f"({name} - {V!r})" if V else name
                factor = told.time / told.length
                return rate if factor == 1.0 else f"({rate}*{factor!r})"
            here = f"({q} - {X!r})" if X else q
            here = f"({here} - {V!r}*{at})" if V else here
            return here if told.length == 1.0 else f"({here}/{told.length!r})"

        return re.sub(r"[A-Za-z_]\w*", word, text)

    def text(self) -> str:
        """Write the model file."""
        told = self.told
        laws = list(enumerate(self.laws))
        random.Random(told.order).shuffle(laws)
        kinetic, potential = self.put(self.kinetic), self.put(self.potential)
        if told.mass != 1.0:
            kinetic = f"{told.mass!r}*({kinetic})"
            potential = f"{told.mass!r}*({potential})"
        names, values, rates = list(self.q), [], []
        for x, q, v in zip(self.q, self.start, self.speeds, strict=True):
            values.append(q * told.length + told.shifts.get(x, 0.0))
            rates.append(v * told.length / told.time + told.boosts.get(x, 0.0))
        if told.heavy:
            names, values, rates = [*names, "heavy"], [*values, 1.0], [*rates, 0.0]
            kinetic += f" + {told.heavy!r}*heavy_dot^2/2"
            potential += f" + {told.heavy * 3 / told.time**2!r}*heavy^2/2"
        unit = told.mass / told.length
        forces = {q: f"{unit!r}*({self.put(F)})" for q, F in self.forces.items()}
        document: dict[str, Any] = {
            "name": "scene",
            "coordinates": {q: {} for q in names},
            "energy": {"kinetic": kinetic, "potential": potential},
            **({"forces": forces} if forces else {}),
            "constraints": {f"c{k}": self._law(law) for k, law in laws},
            "initial": dict(zip(names, values, strict=True))
            | {f"{q}_dot": v for q, v in zip(names, rates, strict=True)},
            "simulation": {
                "start": told.start, "duration": self.duration * told.time,
                "output_step": self.step * told.time, **told.settings,
            },
        }  # fmt: skip
        return f"# contact: {self.seed}\n" + json.dumps(document, indent=1) + "\n"

    def _law(self, law: Law) -> dict[str, Any]:
        told, relation = self.told, self.put(law.gap)
        found: dict[str, Any] = {}
        if law.kind in ("limit", "wheel") and told.time != 1.0:
            relation = f"({relation})/{told.time!r}"
        sign = "=" if law.kind in ("limit", "equality") else ">="
        found["relation"] = f"{relation} {sign} 0"
        if law.kind == "contact":
            found["restitution"] = law.e
        if law.kind == "limit":
            found["limit"] = f"{told.mass!r}*({self.put(law.limit)})"
        if law.slip:
            found["friction"] = law.mu
            if law.static:
                found["friction"] = {"static": law.static, "dynamic": law.mu}
            slip = self.put(law.slip)
            found["slip"] = slip if told.time == 1.0 else f"({slip})/{told.time!r}"
        if law.until < float("inf"):
            found["when"] = f"t < {law.until * told.time + told.start!r}"
        return found

    def back(self, names: Any, rows: Any) -> Any:
        """Take lagsim's rows (k, columns) back to the referee's words: (k, 2n)."""
        told, t = self.told, rows[:, names.index("t")] - self.told.start
        q, v = [], []
        for x in self.q:
            V, X = told.boosts.get(x, 0.0), told.shifts.get(x, 0.0)
            q.append((rows[:, names.index(x)] - X - V * t) / told.length)
            v.append((rows[:, names.index(f"{x}_dot")] - V) * told.time / told.length)
        return np.stack([*q, *v], axis=1)


PARTS = [line, line, disc, disc, pendulum, string, block, block, wheels, latch]


def contact_scene(seed: str) -> ContactScene:
    """Give the scene of a seed."""
    r = random.Random(seed)
    count = r.choice([1, 1, 1, 2, 2, 3])
    parts = [r.choice(PARTS)(r, k) for k in range(count)]
    q = [x for p in parts for x in p.q]
    potential = " + ".join(p.potential for p in parts)
    loose = [x for p in parts for x in p.q if any(p.loose)]
    if count > 1 and len(loose) > 1 and r.random() < 0.5:
        a, b = r.choice(parts[0].q), r.choice(parts[1].q)
        potential += f" + {round(r.uniform(0.5, 10), 3)}*({a} - {b})^2/2"
    wheel = any(law.kind == "wheel" for p in parts for law in p.laws)
    duration = r.choice([1.0, 2.0, 3.0])
    return ContactScene(
        seed, q, " + ".join(p.kinetic for p in parts), potential,
        {x: F for p in parts for x, F in p.forces.items()},
        [law for p in parts for law in p.laws],
        [x for p in parts for x in p.start], [x for p in parts for x in p.speeds],
        [x for p in parts for x in (p.loose or [False] * len(p.q))],
        duration, duration / r.choice([20, 64, 100]), words(r, q, wheel),
    )  # fmt: skip


def words(r: random.Random, q: list[str], wheel: bool) -> Told:
    """Give other words for a scene, or the plain ones."""
    if r.random() < 0.3:
        return Told({}, {}, order=r.randint(0, 9))
    shifts, boosts = {}, {}
    length, time = r.choice([1.0, 1.0, 1e3, 1e-6]), r.choice([1.0, 1.0, 1e3, 1e-3])
    if r.random() < 0.4:
        shifts = {x: length * r.choice([0.0, 1e2, -1e4, 7.3]) for x in q}
    if r.random() < 0.3:
        boosts = {x: length / time * r.choice([0.0, 10.0, -3.7]) for x in q}
    if wheel:
        # A freewheel has to be homogeneous in the velocities: no train.
        boosts = {}
    return Told(
        {x: X for x, X in shifts.items() if X}, {x: V for x, V in boosts.items() if V},
        length=length, time=time, mass=r.choice([1.0, 1.0, 1e-6, 1e9]),
        start=r.choice([0.0, 0.0, 5.0, 1e3]), heavy=r.choice([0.0, 0.0, 1e9]),
        order=r.randint(0, 9),
    )  # fmt: skip
