"""Which laws hold from a state on, nothing striking: decided by the accelerations."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.contact import modes
from lagsim.mechanics.laws import Kind
from lagsim.methods.parts import parameters as kept
from lagsim.notes import Event
from lagsim.run.events.touching import Touching

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from lagsim.language.arrays import Floats

ONE_SIDED = (Kind.CONTACT, Kind.FREEWHEEL)
BOUNDED = (Kind.SLIP, Kind.LIMITED)
# What opens again slowly is told from errors of the steps by this part of the tolerance
# of its motion.
OPENED = 0.05
# What holds without a force is asked again after this part of the time between rows.
SOON = 1e-6


class Settled(NamedTuple):
    """What has changed; whether there is no way on; whether pushes are determined.

    The friction of a body that rests on two points never is.
    """

    events: tuple[Event, ...]
    paradox: bool
    unique: bool


def settle(here: Touching, met: int | None, also: Collection[int]) -> Settled:
    """Set the modes at a state.

    Parameters
    ----------
    met
        The law whose mode has just ended: on the edge, it does not go on.
    also
        Laws that are closed whatever their gaps are.
    """
    arc, p = here.arc, here.arc.system.p
    before = p.law_mode.copy()
    leaning = np.zeros(here.count)
    if met is not None and before[met] == kept.HELD:
        leaning[met] = 1.0
        if (pair := here.laws[met].pair) >= 0:
            leaning[pair] = 1.0
    found = _chosen(here, leaning, also)
    idle = _idle(here, found)
    if idle:
        leaning[idle] += _parting(here, found, idle, also)
        found = _chosen(here, leaning, also)
    p.law_mode[:], p.law_way[:] = found.mode, found.way
    on = (found.mode == kept.HELD) | (found.mode == kept.DRIVEN)
    p.law_forces = float(np.any(on))
    _set_slack(here, found)
    events = tuple(_changes(here, before)) if arc.steps else ()
    implied = np.flatnonzero(found.mode == kept.IMPLIED)
    unique = not any(here.laws[k].kind in ONE_SIDED for k in implied)
    p.law_shares = 0.0 if unique else 1.0
    return Settled(events, found.paradox, unique)


def _idle(here: Touching, found: Chosen) -> list[int]:
    """Give what holds without a force, and so might as well part."""
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
    arc, p = here.arc, here.arc.system.p
    before = p.law_mode.copy(), p.law_way.copy()
    p.law_mode[:], p.law_way[:] = found.mode, found.way
    n, moment = arc.system.n, SOON * arc.state.row_step
    rates = arc.runner.function("field", arc.system.size + arc.system.m)(arc.t, here.y)
    y = here.y + moment * rates[: arc.system.size]
    y[:n] += moment**2 / 2.0 * rates[n : 2 * n]
    p.law_mode[:], p.law_way[:] = before
    later = Touching(arc, y, arc.t + moment)
    then = _chosen(later, np.zeros(here.count), {*also, *found.some})
    return np.array([float(then.mode[k] == kept.OFF) for k in idle])


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


def _set_slack(here: Touching, found: Chosen) -> None:
    """Let rounding not end a mode that has just begun."""
    arc, p, K = here.arc, here.arc.system.p, here.arc.system.surfaces
    rtol = arc.plan.tolerance
    slack = p.slack[K:]
    slack[:] = 0.0
    size, band = np.zeros(here.count), np.zeros(here.count)
    push = dict(zip(found.some, found.D, strict=True))
    for k, law in enumerate(here.laws):
        mode = found.mode[k]
        if mode == kept.HELD and push[k] > 0.0:
            size[k] = band[k] = here.noise[k] / push[k]
        elif mode == kept.DRIVEN:
            size[k] = here.still[k]
        elif mode == kept.OFF and law.kind in ONE_SIDED:
            position = law.kind is Kind.CONTACT
            noise = here.slack[k] if position else here.still[k]
            size[k] = noise if here.gaps[k] <= noise else 0.0
            if k in push:  # it touches, and parts without a speed
                size[k] += OPENED * rtol * here.reach[0 if position else 1][k]
    p.law_still[:] = 0.0
    for k, law in enumerate(here.laws):
        if law.pair >= 0:
            p.law_still[k] = max(4.0 * here.still[k], rtol * here.reach[1][k])
    margins = arc.runner.margins(arc.t, here.y)[K:]
    slack[:] = size + 2.0 * np.maximum(0.0, -margins)
    p.band[K:] = band


def _changes(here: Touching, before: Floats) -> Iterator[Event]:
    """Tell what holds now and did not, and the other way round."""
    t, now = here.arc.t, here.arc.system.p.law_mode
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
