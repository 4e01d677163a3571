"""Corners of equalities beside impulses: the sides onto which an impulse leads.

At the corner of a wire y = k*abs(x) the equality is one of two rows, and the impulses
of contacts and events act along the row of the side onto which they lead. A jump of
velocities is computed on each side of the corners that the state is on. It is a
solution if the velocities after it lead onto these sides. A corner that a jump leaves
on neither side stops the motion: both rows hold. Several corners are decided together,
since equalities and contacts transmit the impulses.

A relation of velocities, y' = k*abs(x'), has its corner at a value of velocities, which
a jump may pass. The jump is then the limit of a large force in a short time: it is
followed up to the corner, and its remainder is computed from there, on the side onto
which it leads, or along the corner if it leads onto neither.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.methods.parts import parameters as kept
from lagsim.notes import Event
from lagsim.run.events.surface_modes import ABOVE, BELOW, SLIDING
from lagsim.run.modes import EqualitiesAlone
from lagsim.tolerances import CLEAR_OF_ROUNDING, RESIDUAL_ROUNDOFF, TINY

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.run.arc import Arc
    from lagsim.run.events.records import SurfacesAt
    from lagsim.run.events.surface_modes import Rows, SurfaceModes

    # A function that computes the state (size,) after a piece of a jump, on the sides
    # in the memory of the arc.
    Jump = Callable[["JumpPiece"], Floats]
    # ABOVE, BELOW or SLIDING (stopped) for each corner.
    Sides = tuple[int, ...]

# Modes of surfaces at whose levels the motion rests.
AT_LEVEL = (kept.FOLLOWED, kept.REDUNDANT_SIDE, kept.LEVEL)
# Largest number of corners all of whose sides are combined, and of sweeps over corners
# one by one.
MOST = 6
# Largest numbers of pieces of a jump, and of trials that locate the end of a piece.
MOST_PIECES, MOST_TRIALS = 10_000, 60


class JumpPiece(NamedTuple):
    """A piece of a jump of velocities, on one side of each corner.

    Attributes
    ----------
    y : ndarray, shape (size,)
        The state before the piece.
    left : float
        The fraction of the whole jump that remains at this state.
    part : float
        The fraction of this remainder that the piece covers.
    stopped : frozenset of int
        The corners at whose surfaces the velocities are stopped.
    """

    y: Floats
    left: float
    part: float
    stopped: frozenset[int]


class CornerSides:
    """Search for the sides of corners onto which a jump of velocities leads.

    The corners are corners of equalities at one state, such as x = 0 of y = k*abs(x).
    If the surface of a corner depends on the side of another surface that the state is
    on, each side of the corner is tried with each side of that surface.

    Parameters
    ----------
    arc : Arc
        The arc that has ended, at that state.
    modes : SurfaceModes
        The modes of all surfaces, in which the sides are tried.
    surfaces : SurfacesAt
        The surfaces at the instant.

    Attributes
    ----------
    corners : dict of int to float
        The level of each corner's surface, by its index, in the order of dependence.
    stopped : frozenset of int
        The corners at which the last jump has stopped velocities.
    off : frozenset of int
        The corners whose surfaces are off their levels with the sides in the memory.
    is_decided : bool
        Whether a jump has decided the sides.
    """

    stopped: frozenset[int] = frozenset()
    off: frozenset[int] = frozenset()
    is_decided = False

    def __init__(self, arc: Arc, modes: SurfaceModes, surfaces: SurfacesAt) -> None:
        self.arc, self.modes, self._y, self._left = arc, modes, arc.y, 1.0
        modes.begin(arc, surfaces.selected)
        switches = arc.system.switches
        self._moving = np.zeros(modes.count, dtype=bool)
        self._moving[[*(switches.bends - switches.turns)]] = True
        self._begun = modes.value.copy(), modes.kind.copy()
        self._find(surfaces.levels)
        is_carried = (modes.kind == kept.CARRIED).tolist()
        self._carried = {k: each for k, each in modes.carried.items() if is_carried[k]}

    def _find(self, levels: Mapping[int, float]) -> None:
        """Find the corners that the present state is on, with the present sides.

        levels : the levels of surfaces that are known to be at these levels.
        """
        arc, modes, on = self.arc, self.modes, self.arc.system.switches.bends
        levels = {k: x for k, x in levels.items() if k in on}
        values = modes.values(arc.t, self._y)
        near = RESIDUAL_ROUNDOFF * modes.sizes(self._y)
        for k in on:
            level = modes.level(k, float(values[k]))
            is_at = abs(values[k] - level) <= near[k] or modes.kind[k] in AT_LEVEL
            if k not in levels and is_at:
                levels[k] = level
        self.corners = {k: levels[k] for k in modes.order if k in levels}
        lengths = np.linalg.norm(modes.rows(self._y).J, axis=1)
        off = [
            abs(values[k] - x) / (lengths[k] or 1.0)
            for k, x in self.corners.items()
            if not self._moving[k]
        ]
        # The corners meet at one place, up to the distance of the state from each.
        reach = np.where(self._moving, 0.0, 2.0 * max(off, default=0.0) * lengths)
        self._near = near + reach
        self._speeds: dict[Sides, Floats] = {}
        self._former = modes.value.copy(), modes.kind.copy()

    def go_on(self, y: Floats) -> None:
        """Begin a further jump at the state y (size,), with the present sides."""
        self._y, self._left = y, 1.0
        self._find({})

    @property
    def may_bend(self) -> bool:
        """Whether a jump may depend on the side of a corner."""
        return bool(self.corners or self._moving.any())

    def restore(self) -> None:
        """Restore the modes that the surfaces had before the trial.

        The phase `sides` then decides their sides by the velocities after the jump.
        """
        self.modes.restore(*self._begun)
        self.modes.carried = self._carried
        self.modes.write()

    def _is_at(self, k: int, value: float) -> bool:
        """Whether a value of the expression of surface k is at a level of it."""
        return bool(abs(value - self.modes.level(k, value)) <= self._near[k])

    def project(self, y: Floats, stopped: frozenset[int]) -> None:
        """Project the velocities in y (size,), in place, onto equalities alone.

        stopped : corners at whose surfaces the velocities are stopped.
        """
        arc = self.arc
        with EqualitiesAlone(arc):
            step = arc.runner.function("velocity_step")(arc.t, y)
            y[arc.velocities] += step[: arc.system.n]
            if stopped:
                arc.runner.project_sliding(arc.t, y)

    def pieces(self, jump: Jump, *, selected: bool = False) -> Iterator[Floats]:
        """Yield the state (size,) after each piece of a jump; the last is the result.

        Each piece is on the sides onto which it leads. These sides are left in the
        memory of the arc, those of the last piece until `restore`; the last call of
        `jump` is that for the last piece. A corner may have any side onto which the
        velocities after the remaining jump lead; if they lead onto neither side, the
        corner is stopped. Of several solutions one with the fewest stopped corners is
        selected, and of these the one with the highest speed away from the corners,
        relative to the rounding of the speed.

        jump : the function that computes the jump.
        selected : whether the sides before the trial are kept if they are a solution.
        """
        for _ in range(MOST_PIECES):
            found, every = self._selected(), list(range(len(self.corners)))
            if not (selected and self._is_solution(jump, found, every)):
                found = self._found(jump, every)
            selected = False
            self._write_sides(found)
            stops = zip(self.corners, found, strict=True)
            stopped = {k for k, side in stops if side == SLIDING}
            self.stopped, self.is_decided = (
                frozenset(stopped.difference(self.off)),
                True,
            )
            part, met = self._met(jump)
            yield self._after(jump, part)
            if not met:
                return
            self._y, self._left = self._after(jump, part), (1.0 - part) * self._left
            self._find(met)
        raise OverflowError("velocities pass corners without end")

    def _after(self, jump: Jump, part: float = 1.0) -> Floats:
        """Return the state (size,) after the fraction `part` of the remaining jump."""
        return jump(JumpPiece(self._y, self._left, part, self.stopped))

    def _met(self, jump: Jump) -> tuple[float, dict[int, float]]:
        """Return the fraction of the remaining jump up to the next corner.

        The corner is one in the velocities; it is returned with its level, as a dict.
        The results are 1 and {} if the jump reaches no corner.
        """
        if not self._moving.any():
            return 1.0, {}
        arc, modes = self.arc, self.modes
        end = self._after(jump)
        here, there = (modes.values(arc.t, y) for y in (self._y, end))
        least = np.maximum(self._rounding(modes.rows(end), end), self._near)
        first, met, edge = 1.0, -1, 0.0
        lowest, highest = modes.ends(modes.value)
        for k in np.flatnonzero(self._moving & ~modes.slides).tolist():
            low, high = float(lowest[k]), float(highest[k])
            if low - least[k] <= there[k] <= high + least[k]:
                continue
            level = low if there[k] < low else high
            far = there[k] - here[k]
            part = min(max((level - here[k]) / far, 0.0), 1.0) if far else 0.0
            if met < 0 or part < first:
                first, met, edge = part, k, level
        if met < 0:
            return 1.0, {}

        def off(part: float) -> float:
            return float(modes.values(arc.t, self._after(jump, part))[met] - edge)

        return _zero(off, first, float(least[met])), {met: edge}

    def _selected(self) -> Sides:
        """Return the sides of all corners before the trial."""
        modes, found = self.modes, []
        modes.restore(*self._former)
        for k, level in self.corners.items():
            side = ABOVE if modes.way(k, level) > 0.0 else BELOW
            found.append(SLIDING if modes.kind[k] in AT_LEVEL else side)
        return tuple(found)

    def _is_solution(self, jump: Jump, sides: Sides, movable: list[int]) -> bool:
        """Whether a jump with given sides leads onto these sides.

        sides : the sides of all corners.
        movable : the indices of the corners that are examined if stopped.
        jump : the function that computes the jump.
        """
        return self._least_speed(jump, sides) > 1.0 and self._stops(
            jump, sides, movable
        )

    def _found(self, jump: Jump, every: list[int]) -> Sides:
        """Return the sides of all corners onto which a jump leads.

        every : the indices of all corners.
        jump : the function that computes the jump.
        """
        movable = self._touched(jump, every, (SLIDING,) * len(every))
        while True:
            found = self._solution(jump, movable)
            left = [i for i in every if i not in movable]
            more = self._touched(jump, left, found)
            if not more:
                return found
            movable = sorted([*movable, *more])

    def _touched(self, jump: Jump, corners: list[int], sides: Sides) -> list[int]:
        """Return the corners from which a jump may lead away, of given ones.

        All given corners are set to their upper, then to their lower sides. The
        result has the corners with a speed beyond rounding after the jump, in one of
        the two cases.

        corners : indices of the corners that are tried.
        sides : the sides of all other corners.
        jump : the function that computes the jump.
        """
        if not corners:
            return []
        found = set[int]()
        for side in (ABOVE, BELOW):
            tried = [side if i in corners else x for i, x in enumerate(sides)]
            speeds = self._speed(jump, tuple(tried))
            found |= {i for i in corners if abs(speeds[i]) > 1.0}
        return sorted(found)

    def _solution(self, jump: Jump, movable: list[int]) -> Sides:
        """Return the sides of all corners onto which a jump leads.

        If no sides are a solution, all corners are stopped.

        movable : indices of the corners that may have a side; the others are stopped.
        jump : the function that computes the jump.
        """
        still = (SLIDING,) * len(self.corners)
        if len(movable) > MOST:
            return self._by_turns(jump, movable)
        tried = sorted(
            product((ABOVE, BELOW, SLIDING), repeat=len(movable)),
            key=lambda sides: sides.count(SLIDING),
        )
        best, chosen, fewest = 0.0, still, 0
        for own in tried[:-1]:
            stops = own.count(SLIDING)
            if chosen is not still and stops > fewest:
                break
            sides = self._with(still, movable, own)
            speed = self._least_speed(jump, sides)
            if speed > max(best, 1.0) and self._stops(jump, sides, movable):
                best, chosen, fewest = speed, sides, stops
        return chosen

    def _with(self, sides: Sides, indices: Sequence[int], own: Sequence[int]) -> Sides:
        """Return `sides` with the sides `own` at `indices`."""
        found = list(sides)
        for i, side in zip(indices, own, strict=True):
            found[i] = side
        return tuple(found)

    def _stops(self, jump: Jump, sides: Sides, movable: Sequence[int]) -> bool:
        """Whether no stopped corner of `movable` has a side onto which the jump leads.

        sides : the sides of all corners.
        jump : the function that computes the jump.
        """
        for i in movable:
            if sides[i] != SLIDING:
                continue
            for side in (ABOVE, BELOW):
                if self._speed(jump, self._with(sides, [i], [side]))[i] > 1.0:
                    return False
        return True

    def _by_turns(self, jump: Jump, movable: list[int]) -> Sides:
        """Return the sides onto which a jump leads, by iteration over the corners.

        Each corner in turn gets the side onto which the jump leads with the present
        sides of the other corners, until no side changes. Arguments: see `_solution`.
        """
        still = (SLIDING,) * len(self.corners)
        sides = self._with(still, movable, [ABOVE] * len(movable))
        for _ in range(MOST):
            former = sides
            for i in movable:
                own = [self._with(sides, [i], [side]) for side in (ABOVE, BELOW)]
                speeds = [self._speed(jump, x)[i] for x in own]
                best = int(np.argmax(speeds))
                sides = own[best]
                if not speeds[best] > 1.0:
                    sides = self._with(sides, [i], [SLIDING])
            if sides == former:
                return sides
        return still

    def _write_sides(self, sides: Sides) -> None:
        """Write the sides of the corners, ABOVE, BELOW or SLIDING, to the memory.

        A surface whose expression depends on these sides, and is off its level with
        them, gets the side of its value. The corners that are off their levels are
        stored in `off`.
        """
        modes, arc = self.modes, self.arc
        modes.restore(*self._former)
        modes.carried = {}
        own = dict(zip(self.corners, sides, strict=True))
        for k, carried in self._carried.items():
            modes.kind[k] = 0.0
            if own.get(carried.leader) == ABOVE:
                modes.value[k] = carried.high
        changed, off = set[int](), set[int]()
        for k in modes.order:
            side = own.get(k)
            if not modes.depends[k].isdisjoint(changed):
                modes.write()
                value = float(modes.values(arc.t, self._y)[k])
                if not self._is_at(k, value):
                    modes.set_by_value(k, value)
                    changed.add(k)
                    off.add(k)
                    continue
            if side is not None:
                modes.set_mode(k, self.corners[k], side)
                changed.add(k)
        modes.write()
        self.off = frozenset(off)

    def _least_speed(self, jump: Jump, sides: Sides) -> float:
        """Return the least speed from a corner onto its side, in units of rounding.

        Corners that are stopped do not count.

        sides : the sides of all corners.
        jump : the function that computes the jump.
        """
        speeds = self._speed(jump, sides)
        own = [x for x, side in zip(speeds, sides, strict=True) if side != SLIDING]
        return float(min(own, default=math.inf))

    def _speed(self, jump: Jump, sides: Sides) -> Floats:
        """Return the speeds (c,) from c corners onto their sides, after a jump.

        The speeds are in units of their rounding; 0 at corners that are stopped,
        infinite at corners whose surfaces are off their levels with these sides.

        sides : the sides of all corners.
        jump : the function that computes the jump.
        """
        if (known := self._speeds.get(sides)) is not None:
            return known
        arc, modes, surfaces = self.arc, self.modes, list(self.corners)
        self._write_sides(sides)
        off = self.off
        stops = [k for k, side in zip(surfaces, sides, strict=True) if side == SLIDING]
        y = jump(JumpPiece(self._y, self._left, 1.0, frozenset(stops).difference(off)))
        rows = modes.rows(y)
        least = self._rounding(rows, y)[surfaces]
        ways = np.array([modes.way(k, self.corners[k]) for k in surfaces])
        speeds = rows.rates[surfaces]
        if self._moving.any():
            levels = np.array([*self.corners.values()])
            own = modes.values(arc.t, y)[surfaces] - levels
            speeds = np.where(self._moving[surfaces], own, speeds)
        found = ways * speeds / np.maximum(least, TINY)
        found[[i for i, k in enumerate(surfaces) if k in stops]] = 0.0
        found[[i for i, k in enumerate(surfaces) if k in off]] = math.inf
        self._speeds[sides] = found
        return np.asarray(found)

    def _rounding(self, rows: Rows, y: Floats) -> Floats:
        """Return bounds (K,) of the rounding of velocities across the surfaces.

        rows : the rows of the surfaces at the state y (size,).
        """
        arc = self.arc
        magnitudes = np.maximum(np.abs(y), arc.magnitudes)[arc.velocities]
        terms = np.abs(rows.J[:, : arc.system.n]) @ magnitudes
        return np.asarray(CLEAR_OF_ROUNDING * RESIDUAL_ROUNDOFF * terms)


def _zero(value: Callable[[float], float], near: float, least: float) -> float:
    """Return the argument in [0, 1] at which a function is 0, to its rounding `least`.

    The function has the sign of its value at 1 above its zero. The first trial is
    `near`, the zero of a linear function.
    """
    ends, x = [0.0, 1.0], near
    up = value(1.0) > 0.0
    for _ in range(MOST_TRIALS):
        off = value(x)
        if abs(off) <= least:
            break
        ends[int((off > 0.0) == up)] = x
        x = (ends[0] + ends[1]) / 2.0
    return x


def corner_events(
    arc: Arc,
    bent: Collection[int],
    energy: float,
    among: Collection[str] | None = None,
) -> Iterator[Event]:
    """Yield the event of a corner for each constraint that is at a corner.

    Parameters
    ----------
    arc : Arc
        The arc that has ended, at the state reached.
    bent : collection of int
        The indices of the corners that the state is on; several may belong to one
        constraint, as the kink and a knot of `table(abs(x))`.
    energy : float
        The change of the energy in the impact; only the first event has it.
    among : collection of str or None
        If given, only these constraints are considered.
    """
    own: dict[str, list[str]] = {}
    switches = arc.system.switches
    for k in bent:
        for name in switches.corners[k].rows:
            if among is None or name in among:
                own.setdefault(name, []).append(switches.sides[k].text)
    for i, (name, texts) in enumerate(own.items()):
        text = ", ".join(dict.fromkeys(texts))
        lost = None if i else energy
        yield Event(arc.t, "corner", name, switch=text, energy=lost)
