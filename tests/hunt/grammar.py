"""Random scenes: mechanisms, laws, units, offsets, durations, rows; all by a seed."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np

from tests.hunt import laws
from tests.hunt.bodies import MECHANISMS
from tests.hunt.maker import Maker, short
from tests.hunt.scene import Scene

# How often a scene has what: natural ones first, odd units and places now and then.
OTHER_UNITS, UNTIL = 0.35, 0.12
OFFSET = TWO = BYSTANDER = LATER = METHOD = 0.15
ROWS = (1, 2, 3, 7, 40, 40, 200, 200, 1000)
METHODS = ("dop853", "taylor", "radau")


def scene(seed):
    """Return the scene of a seed."""
    rng = np.random.default_rng(zlib.crc32(seed.encode()))
    maker = Maker(rng)
    if maker.chance(OTHER_UNITS):
        maker.length, maker.time = maker.decades(-3, 3), maker.decades(-3, 3)
        maker.mass = maker.decades(-6, 6)
    if maker.chance(OFFSET):
        maker.offset = maker.decades(1, 6, maker.length)
    maker.duration = maker.decades(0, 1.1, 1.5 * maker.time)
    if maker.chance(LATER):
        maker.start = maker.one_of(1, -1) * maker.decades(0, 3, maker.time)
    for _ in range(2 if maker.chance(TWO) else 1):
        maker.one_of(*MECHANISMS)(maker)
    _laws(maker)
    if maker.chance(BYSTANDER):
        laws.bystander(maker)
    rows = maker.one_of(*ROWS)
    step = maker.duration / rows
    if maker.chance(0.3):
        step = min(short(step * maker.between(0.6, 1)), maker.duration)
    made = Scene(
        seed=seed, items=tuple(maker.items), start=maker.start,
        duration=maker.duration, output_step=step, stated=maker.chance(0.6),
    )  # fmt: skip
    if maker.chance(UNTIL):
        made = replace(made, until=_until(maker))
    if maker.chance(METHOD):
        made = replace(made, settings={"method": maker.one_of(*METHODS)})
    return admissible(made)


def _laws(maker):
    choices = [laws.forcing] if maker.pushed else []
    if maker.sliders:
        choices += [
            laws.wall, laws.wall, laws.hill, laws.hill, laws.pair_law,
            laws.drag, laws.drag,
            laws.friction, laws.friction, laws.dead_zone, laws.relay,
            laws.bent_spring,
        ]  # fmt: skip
    if maker.points:
        choices += [laws.air, laws.magnetic]
    for _ in range(maker.one_of(0, 1, 1, 2, 2, 3) if choices else 0):
        maker.one_of(*choices)(maker)


def _until(maker):
    names = [q for item in maker.items for q in item.coordinates]
    name = maker.one_of(*names)
    where = {q: x for item in maker.items for q, (x, _) in item.coordinates.items()}
    level = where[name] + maker.signed(0.05, 1, maker.length)
    return f"{name} {maker.one_of('<=', '>=')} {level!r}"


def admissible(made):
    """Return the scene with velocities that satisfy its constraints, where stated."""
    if not made.stated or not made.gathered("constraints"):
        return made
    from tests.hunt.mechanics import Mechanics
    from tests.hunt.truth import Effort, Referee

    mechanics = Mechanics(replace(made, velocities={}))
    referee = Referee(mechanics, Effort())
    with np.errstate(all="ignore"):
        _, y = referee.start()
    v = y[len(made.q) :].astype(float)
    return replace(made, velocities=dict(zip(made.q, map(float, v), strict=True)))
