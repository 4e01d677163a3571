"""Random scenes of contact, each told in other words to lagsim than to the referee.

A scene is one to three bodies (balls, stops, strings, blocks, wheels), perhaps joined
by springs. To lagsim it is told with another origin, from a train, in other units, at
another time, beside something heavy, its constraints in another order: the motion is
the same.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.hunt import contact_parts as of
from tests.hunt.scene import Item, Scene
from tests.invariance.same import CHANGES, Sizes
from tests.invariance.transforms import document

if TYPE_CHECKING:
    from tests.invariance.transforms import Document

PARTS = [
    of.line, of.line, of.disc, of.disc, of.pendulum, of.string, of.block, of.block,
    of.wheels, of.latch,
]  # fmt: skip

UNITS = ("metres", "megametres", "microseconds", "years", "grams", "tonnes")


@dataclass(frozen=True)
class ContactScene:
    """A scene, as the referee sees it, and the words in which it is told to lagsim."""

    scene: Scene
    words: tuple[str, ...] = ()

    @property
    def rounding(self) -> float:
        """How many times those of the scene the places and times are that it has."""
        return sum(CHANGES[word].rounding for word in self.words)

    def told(self) -> Document:
        """Give it in its words; columns `q` and `rate_q` are those of the scene."""
        rates = {f"rate_{q}": f"{q}_dot" for q in self.scene.q}
        whole = Scene(
            self.scene.seed, (*self.scene.items, Item("rates", definitions=rates)),
            self.scene.start, self.scene.duration, self.scene.output_step,
        )  # fmt: skip
        found = document(whole.text(), keep=tuple(rates))
        # Sizes are in the scene's own units: these change last.
        for word in sorted(self.words, key=UNITS.__contains__):
            found = CHANGES[word].put(found, Sizes(1.0, 1.0, self.scene.duration))
        return found


def contact_scene(seed: str) -> ContactScene:
    """Give the scene of a seed."""
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
