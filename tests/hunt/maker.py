"""Elements of the grammar: scales, numbers with few digits, points, names."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tests.hunt.scene import Item

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Point:
    """A mass at a place. at : texts of its components; place, speed : their values."""

    at: tuple[str, ...]
    mass: float
    place: tuple[float, ...]
    # Its own coordinates, one a component, where it has them.
    own: bool = True


@dataclass
class Maker:
    """Builder of the items of a scene, which have similar lengths, times and masses."""

    rng: np.random.Generator
    length: float = 1.0
    time: float = 1.0
    mass: float = 1.0
    start: float = 0.0
    duration: float = 1.0
    offset: float = 0.0
    items: list[Item] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    # Coordinates of one length: (name, mass, velocity at the start).
    sliders: list[tuple[str, float, float]] = field(default_factory=list)
    # Coordinates that may be pushed: (name, a force that moves it).
    pushed: list[tuple[str, float]] = field(default_factory=list)
    count: Any = field(default_factory=lambda: itertools.count(1))

    @property
    def speed(self):
        return self.length / self.time

    @property
    def gravity(self):
        return self.length / self.time**2

    def chance(self, part):
        return bool(self.rng.random() < part)

    def one_of(self, *things):
        return things[int(self.rng.integers(len(things)))]

    def between(self, low, high, size=1.0):
        return short(size * self.rng.uniform(low, high))

    def decades(self, low, high, size=1.0):
        return short(size * 10 ** self.rng.uniform(low, high))

    def signed(self, low, high, size=1.0):
        return self.one_of(-1, 1) * self.between(low, high, size)

    def some_mass(self):
        return self.decades(-0.5, 0.5, self.mass)

    def name(self, letter):
        return f"{letter}{next(self.count)}"

    def add(self, tag, **parts):
        self.items.append(Item(tag, **parts))


class Numbers(dict[str, float]):
    """Parameters of one item, named in the order of requests."""

    def __init__(self, maker):
        super().__init__()
        self.maker = maker

    def __call__(self, letter, value):
        name = self.maker.name(letter)
        self[name] = float(value)
        return name


def short(value):
    """Return a number with three digits, as people write them."""
    return float(f"{value:.3g}")


def squares(*names):
    return " + ".join(f"{name}^2" for name in names)


def distance(a, b):
    """Return the text of the distance of two points, and its value."""
    steps = [f"({x} - {y})" for x, y in zip(a.at, b.at, strict=True)]
    value = math.dist(a.place, b.place)
    return f"sqrt({squares(*steps)})", value


def weight(k, m, height, n):
    """Return the energy of a mass at a height."""
    return f"{m}*{n('g', k.between(0.5, 10, k.gravity))}*{height}"
