"""Modes of laws from an instant on: which hold, slide or are off.

The accelerations decide which of the closed laws hold (`mechanics.row_modes`). The
modes, and how far rounding may carry a law past the end of its mode, are stored in the
memory that the kernels of the next arc read.

A slip on a disc is the slip of a contact in two tangential directions, two laws.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.mechanics.pieces import MARK, whole
from lagsim.methods.parts import parameters as kept
from lagsim.notes import Event
from lagsim.run.events.sliders import at_edge
from lagsim.tolerances import CLEAR_OF_ROUNDING, HALF_OF_DIGITS, SUM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.row_modes import RowModes
    from lagsim.run.arc import Arc
    from lagsim.run.events.kinematics import Kinematics

    Ahead = Callable[[Floats], tuple[Floats, Floats]]

FORCING = (kept.HELD, kept.SLIDING)
HOLDING = (kept.HELD, kept.REDUNDANT)
# Ratio of successive times ahead at which the change of forces is evaluated.
LATER = 10.0
# Up to this number of laws the modes of all are decided at each instant, which costs no
# more than to find those that may be kept.
FEW = 8


def write_modes(arc: Arc, chosen: Chosen) -> None:
    """Write the modes of laws in `chosen` to the memory that the kernels read."""
    p = arc.system.p
    own = p.law_place < 0.0  # the modes of sliders are set by `Sliders`
    p.law_mode[own], p.law_direction[own] = chosen.mode[own], chosen.direction[own]
    p.law_forces = float(any(mode in FORCING for mode in chosen.mode.tolist()))


def _state_after(
    here: Kinematics, free: Floats, active: list[int], p: Floats, moment: float
) -> Floats:
    """Return the state (size,) after a short time `moment`, to second order.

    free : ndarray, shape (size,), y' without the laws `active`.
    p : ndarray, shape (r,), the multipliers of these laws.
    here : all laws at the state now.
    """
    rates = free.copy()
    rates[here.arc.velocities] += here.delassus_of_forces.response[:, active] @ p
    return here.arc.later(here.y, rates, moment)


def ahead_of(
    here: Kinematics, active: list[int],
    others: Callable[[Kinematics, Floats], Floats] = lambda _here, _forced: np.zeros(0),
    unchanged: Sequence[int] = (),
) -> Ahead:  # fmt: skip
    """Return a function that maps multipliers (r,) to d/dt of accelerations.

    The function returns these rates (k + r,) of `others` and of laws, and the rounding
    bounds (r,) of those of laws. Each bounded multiplier keeps its ratio to its bound.

    Parameters
    ----------
    here : Kinematics
        All laws at the present state.
    active : list of int, length r
        Indices of the laws.
    others : callable
        Function of a `Kinematics` and of the accelerations (n,) by the multipliers,
        which returns the rates (k,) of other rows. These come first in the result.
    unchanged : sequence of int
        Laws that stay in their modes, and are not coupled with the laws `active`.
    """
    moment = here.arc.short_time

    def change(p: Floats) -> tuple[Floats, Floats]:
        free = here.moved_by(unchanged) if len(unchanged) else here.free
        y = _state_after(here, free, active, p, moment)
        later = here.at(y, here.t + moment)
        w = []
        for x in here, later:
            part, known = np.ones(len(active)), here.bounds[active] > 0.0
            part[known] = x.bounds[active][known] / here.bounds[active][known]
            D, response = (
                x.delassus_of_forces.D[np.ix_(active, active)],
                x.delassus_of_forces.response[:, active],
            )
            more = others(x, response @ (part * p))
            w.append(np.append(more, x.accelerations[active] + D @ (part * p)))
        return (w[1] - w[0]) / moment, 2.0 * here.roundoff[active] / moment

    return change


def that_could_act(here: Kinematics, also: Collection[int]) -> list[int]:
    """Return the indices of the laws that are closed and do not separate.

    Laws of `also` count as closed whatever their gaps are. A slip could act only where
    its contact could.

    here : all laws at the state reached.
    """
    table, acts = here.table, np.array(here.is_closed(also), dtype=bool)
    acts &= ~(table.one_sided & (here.rates > here.still))
    acts[table.slips] &= acts[table.normals[table.slips]]
    active: list[int] = np.flatnonzero(acts).tolist()
    return active


class Chosen(NamedTuple):
    """Selected modes of all laws, with the multipliers that justify them.

    Attributes
    ----------
    mode, direction : ndarray, shape (L,)
        Mode of each law, and the direction of its friction or limit.
    active : list of int, length r
        Indices of the laws that could act.
    multipliers, D : ndarray, shape (r,)
        Their multipliers, and the diagonal of their matrix D, accelerations per
        multiplier.
    paradox, open : bool
        Whether there is a paradox of Painlevé's (see `mechanics.row_modes.RowModes`);
        whether the motion is not unique.
    """

    mode: Floats
    direction: Floats
    active: list[int]
    multipliers: Floats
    D: Floats
    paradox: bool
    open: bool = False

    @classmethod
    def of(
        cls,
        here: Kinematics,
        active: list[int],
        found: RowModes,
        unchanged: Sequence[int] = (),
    ) -> Chosen:
        """Return the modes of all laws from those of the laws `active`.

        found : the modes of rows, of which the first belong to the laws `active`.
        unchanged : laws that stay in their modes; laws in neither list are off.
        here : all laws at the state reached.
        """
        mode, direction = np.zeros((2, here.count))
        if len(unchanged):
            p = here.arc.system.p
            mode[unchanged] = p.law_mode[unchanged]
            direction[unchanged] = p.law_direction[unchanged]
        r = len(active)
        mode[active] = [float(x) for x in found.mode[:r]]
        direction[active] = found.direction[:r]
        D = here.delassus_of_forces.D.diagonal()[active]
        return cls(
            mode, direction, active, found.multipliers[:r], D, found.paradox, found.open
        )


def chosen_modes(
    here: Kinematics,
    active: list[int],
    left: Mapping[int, int],
    unchanged: Sequence[int] = (),
) -> Chosen:
    """Select the modes by the accelerations of the laws `active`, which could act.

    left : how often each law has reached the limit of its multiplier at this time.
    unchanged : laws that stay in their modes, not coupled with the laws `active`.
    here : all laws at the state reached.
    """
    from lagsim.mechanics import row_modes

    if not active:
        none = np.empty(0)
        nothing = row_modes.RowModes((), none, none, paradox=False)
        return Chosen.of(here, active, nothing, unchanged)
    laws, accelerations = here.acting(active, left), here.accelerations[active]
    accelerations = np.where(np.abs(accelerations) <= laws.roundoff, 0.0, accelerations)
    found = row_modes.modes(
        laws.closed, accelerations, laws.rates, laws.roundoff, laws.slow,
        ahead_of(here, active, unchanged=unchanged), laws.left,
    )  # fmt: skip
    return Chosen.of(here, active, found, unchanged)


def steady_laws(before: Kinematics, after: Kinematics) -> Flags | None:
    """Return a mask (L,) of the laws whose motion no impact has changed, or None.

    The result is None if the modes of all laws are to be decided: in models with few
    laws, and in models with surfaces, massless sliders, laws with a condition `when`,
    or slips in two directions, which may couple the laws.

    before, after : the laws before and after the impacts of this instant.
    """
    system, table = before.arc.system, before.table
    coupled = system.acting_surfaces or system.sliders or system.has_times
    if before.count <= FEW or coupled or (table.pairs >= 0).any():
        return None
    same = np.ones(before.count, dtype=bool)
    if after is not before:
        for x in ("accelerations", "rates", "bounds", "statics"):
            same &= getattr(before, x) == getattr(after, x)
    return same


def unchanged_laws(
    here: Kinematics, active: list[int], steady: Flags | None, ended: Collection[int]
) -> list[int]:
    """Return the laws of `active` that keep the modes of the arc that has ended.

    A law keeps its mode if it holds or slides clearly within the range of this mode,
    and if it is not coupled with a law whose mode is decided anew. The latter are laws
    whose modes have ended or begin, and laws that an impact has changed.

    Parameters
    ----------
    here : Kinematics
        All laws at the present state.
    active : list of int
        The laws that could act.
    steady : ndarray of bool, shape (L,), or None
        See `records.LawState`; with None no law is known to stay in its mode.
    ended : collection of int
        The laws whose modes have ended at this time.
    """
    if steady is None:
        return []
    arc, p = here.arc, here.arc.system.p
    on = p.law_mode != kept.OFF
    acts = np.zeros(here.count, dtype=bool)
    acts[active] = True
    margins = arc.runner.event_functions(arc.t, here.y)[arc.system.surfaces :]
    own = here.delassus_of_forces.D.diagonal()
    balance = here.pushes / np.where(own > 0.0, own, np.inf)
    holds, slides = p.law_mode == kept.HELD, p.law_mode == kept.SLIDING
    least = np.where(holds, HALF_OF_DIGITS * balance, CLEAR_OF_ROUNDING * here.still)
    stays = steady & (holds | slides) & (margins > least)
    stays[list(ended)] = False
    decided = here.reached(
        np.flatnonzero((acts | on) & ~(acts & stays)).tolist(),
        np.flatnonzero(acts | on).tolist(),
    )
    stays[decided] = False
    stays &= acts
    found: list[int] = np.flatnonzero(stays).tolist()
    return found


def set_floors(here: Kinematics, found: Chosen, slid: Collection[int]) -> None:
    """Store the speeds at which slips on a disc count as begun, and as stopped.

    Below such a speed the direction of a slip is only rounding, and friction would turn
    the slip faster than explicit steps can follow. A slip therefore keeps its first
    direction up to `laws.BEGUN` times the least speed. The relative error of its path
    is the power 3/2 of that speed, in units of the speed that it reaches in the time in
    which forces change. With a fixed step h, the speed is also high enough for the
    stability of friction on the slip (bound 2).

    Parameters
    ----------
    here : Kinematics
        All laws at the present state.
    found : Chosen
        The modes selected.
    slid : collection of int
        Laws that slid until this time.
    """
    arc, p = here.arc, here.arc.system.p
    floors, stills = np.zeros(here.count), np.zeros(here.count)
    begun, steady = [], math.inf
    rtol = float(arc.plan.tolerance)
    for pair in here.table.discs:
        k, other = pair
        if kept.SLIDING not in found.mode[pair]:
            if k in slid or other in slid:  # stops; selection may be repeated
                stills[pair] = p.law_still[k]
            continue
        speed = float(np.linalg.norm(here.rates[pair]))
        if k in slid or other in slid:
            # The regularized beginning of a slip ends at any other event.
            floors[pair] = p.law_floor[k] if math.isinf(p.law_lasts[k]) else 0.0
            stills[pair] = p.law_still[k]
            continue
        places = [found.active.index(j) for j in pair]
        deceleration = float(np.linalg.norm((found.multipliers * found.D)[places]))
        if deceleration == 0.0:
            continue
        changes = _steady(here, found, pair, deceleration)
        scale = deceleration * changes
        # A slower slip would turn and stop in fewer roundings of t than steps need.
        rounded = 4.0 * CLEAR_OF_ROUNDING * deceleration * math.ulp(arc.settings.end)
        floor = max(rtol ** (2.0 / 3.0) * scale, 4.0 * max(here.still[k], rounded))
        floor = max(floor, rtol * float(np.max(here.reach[1][pair])))
        floor = max(floor, deceleration * (arc.plan.step or 0.0) / 2.0)
        stills[pair] = max(rtol * scale, rounded)
        if speed < floor:
            floors[pair] = floor
            begun.append(pair)
            steady = min(steady, changes)
    p.law_floor[:], p.law_still[:], p.law_lasts[:] = floors, stills, math.inf
    p.law_turn[:] = 0.0
    if begun and here.t < arc.settings.end:
        from lagsim.run.events.slips import begin_slips

        places = [found.active.index(k) for pair in begun for k in pair]
        friction = np.linalg.norm(found.multipliers[places].reshape(-1, 2), axis=1)
        begin_slips(here, np.array(begun), friction, steady)


def _steady(
    here: Kinematics, found: Chosen, pair: list[int], deceleration: float
) -> float:
    """Return the time in which the forces on a slip change by the size of its friction.

    The change is evaluated at ever later times, since a force may begin to change at a
    rate of 0. At most the time to the end of the run.

    Parameters
    ----------
    here : Kinematics
        All laws at the present state.
    found : Chosen
        The modes selected.
    pair : list of int, length 2
        The two laws of the slip on a disc.
    deceleration : float
        Deceleration of the slip by its friction.
    """
    moment, steady = here.arc.short_time, here.arc.settings.end - here.t
    while moment < steady:
        y = _state_after(here, here.free, found.active, found.multipliers, moment)
        later = here.at(y, here.t + moment)
        bends = later.accelerations - here.accelerations
        change = float(np.linalg.norm(bends[pair])) / moment
        if not math.isfinite(change):  # the forces are undefined so far ahead
            return moment
        steady = min(steady, deceleration / change) if change > 0.0 else steady
        moment *= LATER
    return steady


def set_slack(here: Kinematics, found: Chosen) -> None:
    """Store the slacks and bands of laws, so that rounding ends no mode.

    found : the modes selected.
    here : all laws at the state reached.
    """
    arc, p, K = here.arc, here.arc.system.p, here.arc.system.surfaces
    slack, table, mode = p.slack[K:], here.table, found.mode
    slack[:] = 0.0
    size, band, rounding = np.zeros((3, here.count))
    pushed = here.delassus_of_forces.D.diagonal()
    if (held := (mode == kept.HELD) & (pushed > 0.0)).any():
        size[held] = band[held] = here.roundoff[held] / pushed[held]
    slides = (mode == kept.SLIDING) & ~held
    size[slides] = here.still[slides]
    # a direction is kept down to half of its floor
    band[slides] = 0.5 * p.law_floor[slides]
    if (off := (mode == kept.OFF) & table.one_sided).any():
        rounding[off] = np.where(table.gapped, here.slack, here.still)[off]
        # A gap that has not opened yet has a slack.
        shut = off & (here.gaps <= rounding)
        size[shut] = np.maximum(rounding[shut], math.ulp(0.0))
        for k, depth in here.grazing.items():
            size[k] += 2.0 * depth
        size[off & ~np.array(here.in_force)] = math.inf  # `when` is constant in an arc
    for k in np.flatnonzero(p.law_place >= 0.0).tolist():
        _set_slack_of_slider(here, k, size, band)
    event_functions = arc.runner.event_functions(arc.t, here.y)[K:]
    slack[:] = size + 2.0 * np.maximum(0.0, -event_functions)
    p.band[K:], p.law_rounding[:] = band, rounding


def _set_slack_of_slider(here: Kinematics, k: int, size: Floats, band: Floats) -> None:
    """Store slack and band of the massless slider k in `size` and `band` (L,).

    A slider at rest has the band of a law at its edge, since it may return to its limit
    without loss.
    """
    arc, slider = here.arc, here.laws[k].slider
    assert slider is not None
    size[k] = band[k] = (
        SUM_ROUNDOFF * here.magnitudes[arc.velocities][slider.coordinate]
    )
    if arc.system.p.law_direction[k] == 0.0:
        size[k], band[k] = np.array([SUM_ROUNDOFF, at_edge(arc)]) * here.bounds[k]


def changes(here: Kinematics, before: Floats) -> Iterator[Event]:
    """Yield the events of laws that now hold and did not before, or the reverse.

    before : shape (L,), the modes before.
    here : all laws, with the modes now.
    """
    t, now = here.arc.t, here.arc.system.p.law_mode
    changed, told = np.flatnonzero(now != before).tolist(), set[str]()
    if any(MARK in here.laws[k].row.name for k in changed):
        was_on, is_on = (
            {whole(here.laws[k].row.name) for k in np.flatnonzero(x).tolist()}
            for x in (before, now)
        )
        told = was_on & is_on  # possibly on another piece of the gap
    for k in changed:
        law = here.laws[k]
        name = law.name
        if here.table.bounded[k]:
            was, holds = before[k] in HOLDING, now[k] in HOLDING
            if 0 <= law.pair < k:
                continue
            if was and now[k] == kept.SLIDING:
                yield Event(t, "slip", name)
            elif before[k] == kept.SLIDING and holds:
                yield Event(t, "stick", name)
        elif (before[k] == kept.OFF) != (now[k] == kept.OFF):
            if MARK not in law.row.name or name not in told:
                yield Event(t, "contact" if now[k] != kept.OFF else "release", name)
            told.add(name)
