"""Which laws hold from a state on, nothing striking: decided by the accelerations."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.contact import modes
from lagsim.methods.parts import parameters as kept
from lagsim.notes import Event
from lagsim.run.events.touching import Touching

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from lagsim.language.arrays import Floats

ONE_SIDED = (Kind.CONTACT, Kind.FREEWHEEL)
BOUNDED = (Kind.SLIP, Kind.LIMITED)
FORCING = (kept.HELD, kept.DRIVEN)
# What opens again slowly is told from errors of the steps by this part of the tolerance
# of its motion.
OPENED = 0.05
# What holds without a force is asked again after this part of the time between rows.
SOON = 1e-6
# Forces change in no more than so many times as long.
LONG = 100.0


class Settled(NamedTuple):
    """What has changed; whether there is no way on; whether pushes are determined.

    The friction of a body that rests on two points never is.
    """

    events: tuple[Event, ...]
    paradox: bool
    unique: bool


def settle(here: Touching, left: Collection[int], also: Collection[int]) -> Settled:
    """Set the modes at a state.

    Parameters
    ----------
    left
        Laws that held until just now: on the edge, they do not go on.
    also
        Laws that are closed whatever their gaps are.
    """
    arc, p = here.arc, here.arc.system.p
    before = p.law_mode.copy()
    leaning = np.zeros(here.count)
    for k in left:
        leaning[k] = 1.0
    found = _chosen(here, leaning, also)
    idle = _idle(here, found)
    if idle:
        leaning[idle] += _parting(here, found, idle, also)
        found = _chosen(here, leaning, also)
    p.law_mode[:], p.law_way[:] = found.mode, found.way
    _set_floors(here, found, before)
    p.law_forces = float(any(found.mode[k] in FORCING for k in found.some))
    _set_slack(here, found)
    n = here.arc.system.n
    p.law_pushes[:n] = p.law_pushes[n : 2 * n] = here.moves
    events = tuple(_changes(here, before)) if arc.steps else ()
    implied = [k for k in found.some if found.mode[k] == kept.IMPLIED]
    unique = not any(here.laws[k].kind in ONE_SIDED for k in implied)
    p.law_shares = 0.0 if unique else 1.0
    return Settled(events, found.paradox, unique)


def _idle(here: Touching, found: Chosen) -> list[int]:
    """Give what holds without a force, and so might as well part."""
    if not found.some:
        return []
    pushes = np.abs(found.multipliers) * found.D
    return [
        k
        for k, push in zip(found.some, pushes, strict=True)
        if found.mode[k] == kept.HELD
        and here.laws[k].kind in ONE_SIDED
        and push <= here.noise[k]
    ]


def _parting(
    here: Touching, found: Chosen, idle: list[int], also: Collection[int]
) -> Floats:
    """Tell by the accelerations of a moment later which idle laws part then (1)."""
    later = _soon_after(here, found)
    then = _chosen(later, np.zeros(here.count), {*also, *found.some})
    return np.array([float(then.mode[k] == kept.OFF) for k in idle])


def _soon_after(here: Touching, found: Chosen) -> Touching:
    """Give the laws a moment later, in the modes found."""
    arc, p = here.arc, here.arc.system.p
    before = p.law_mode.copy(), p.law_way.copy()
    p.law_mode[:], p.law_way[:] = found.mode, found.way
    n, moment = arc.system.n, SOON * arc.state.row_step
    rates = arc.runner.function("field", arc.system.size + arc.system.m)(arc.t, here.y)
    y = here.y + moment * rates[: arc.system.size]
    y[:n] += moment**2 / 2.0 * rates[n : 2 * n]
    p.law_mode[:], p.law_way[:] = before
    return Touching(arc, y, arc.t + moment, here.shape)


class Chosen(NamedTuple):
    """The modes of all laws, and how they came about.

    some : the laws that could act; multipliers : theirs; D : their diagonal of D.
    """

    mode: Floats
    way: Floats
    some: list[int]
    multipliers: Floats
    D: Floats
    paradox: bool


def _chosen(here: Touching, leaning: Floats, also: Collection[int]) -> Chosen:
    """Let the accelerations choose among what is closed and does not separate."""
    laws, L, rates = here.laws, here.count, here.rates
    closed = here.is_closed(also)
    some: list[int] = []
    for k, law in enumerate(laws):
        leaves = law.kind in ONE_SIDED and rates[k] > here.still[k]
        if law.kind is Kind.SLIP:
            leaves = law.normal not in some
        if closed[k] and not leaves:
            some.append(k)
    mode, way = np.zeros(L), np.zeros(L)
    if not some:
        return Chosen(mode, way, some, np.empty(0), np.empty(0), False)
    problem, _ = here.problem(some, np.zeros(len(some)))
    noise = here.noise[some]
    asked = here.accelerations[some]
    found = modes(
        problem,
        np.where(np.abs(asked) <= noise, 0.0, asked),
        rates[some],
        noise,
        np.maximum(here.still, 2.0 * here.arc.system.p.law_still)[some],
        leaning[some],
    )
    mode[some], way[some] = [float(x) for x in found.mode], found.way
    diagonal = np.diag(problem.D).copy()
    return Chosen(mode, way, some, found.multipliers, diagonal, found.paradox)


def _set_floors(here: Touching, found: Chosen, before: Floats) -> None:
    """Set the speeds that slips which begin on a disc have at the least, and stop at.

    What rounding leaves of slower ones has no direction, and friction would pull them
    into that of their force at once, for which explicit steps are too long. Up to
    BEGUN of it they go on along the way that they began. The way that this is off by
    is the power 3/2 of the part, against that of the time in which forces change.
    """
    arc, p = here.arc, here.arc.system.p
    floors, stills = np.zeros(here.count), np.zeros(here.count)
    rtol = float(arc.plan.tolerance)
    for k, law in enumerate(here.laws):
        pair = [k, law.pair]
        if law.pair < k or kept.DRIVEN not in found.mode[pair]:
            continue
        speed = float(np.linalg.norm(here.rates[pair]))
        if kept.DRIVEN in before[pair]:
            stills[pair] = p.law_still[k]
            continue
        later = _soon_after(here, found)
        bends = (later.accelerations - here.accelerations)[pair] / (later.t - here.t)
        places = [found.some.index(j) for j in pair]
        rubs = float(np.linalg.norm((found.multipliers * found.D)[places]))
        changes = max(float(np.linalg.norm(bends)), rubs / (LONG * arc.state.row_step))
        scale = rubs**2 / changes if changes > 0.0 else 0.0
        floor = max(rtol ** (2.0 / 3.0) * scale, 4.0 * here.still[k])
        floor = max(floor, rtol * float(np.max(here.reach[1][pair])))
        if speed < floor:
            floors[pair], stills[pair] = floor, rtol * scale
    p.law_floor[:], p.law_still[:] = floors, stills


def _set_slack(here: Touching, found: Chosen) -> None:
    """Let rounding not end a mode that has just begun."""
    arc, p, K = here.arc, here.arc.system.p, here.arc.system.surfaces
    rtol = arc.plan.tolerance
    slack = p.slack[K:]
    slack[:] = 0.0
    size, band, rounding = np.zeros((3, here.count))
    push = dict(zip(found.some, found.D, strict=True))
    for k, mode in enumerate(found.mode.tolist()):
        law = here.laws[k]
        if mode == kept.HELD and push[k] > 0.0:
            size[k] = band[k] = here.noise[k] / push[k]
        elif mode == kept.DRIVEN:
            size[k] = here.still[k]
            band[k] = 0.5 * p.law_floor[k]  # its way holds so far back
        elif mode == kept.OFF and law.kind in ONE_SIDED:
            position = law.kind is Kind.CONTACT
            rounding[k] = here.slack[k] if position else here.still[k]
            size[k] = rounding[k] if here.gaps[k] <= rounding[k] else 0.0
            size[k] += 2.0 * here.grazing.get(k, 0.0)
            if k in push:  # it touches, and parts without a speed
                size[k] += OPENED * rtol * here.reach[0 if position else 1][k]
    margins = arc.runner.margins(arc.t, here.y)[K:]
    slack[:] = size + 2.0 * np.maximum(0.0, -margins)
    p.band[K:], p.law_rounding[:] = band, rounding


def _changes(here: Touching, before: Floats) -> Iterator[Event]:
    """Tell what holds now and did not, and the other way round."""
    t, now = here.arc.t, here.arc.system.p.law_mode
    if (now == before).all():
        return
    for k, law in enumerate(here.laws):
        name = law.constraint
        if law.kind in BOUNDED:
            twice = 0 <= law.pair < k
            if before[k] == kept.HELD and now[k] == kept.DRIVEN and not twice:
                yield Event(t, "slip", name)
            elif before[k] == kept.DRIVEN and now[k] == kept.HELD and not twice:
                yield Event(t, "stick", name)
        elif before[k] == kept.OFF and now[k] != kept.OFF:
            yield Event(t, "contact", name)
        elif before[k] != kept.OFF and now[k] == kept.OFF:
            yield Event(t, "release", name)
