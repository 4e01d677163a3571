"""The truth of located conditions at an instant: those of events, then `until`.

The kernels locate where a condition becomes true within a step (`methods.parts.search`,
whose `orientation` and `leeway` say on which side of 0 each is). At an instant the
state, its rates and the modes may jump, and rounding leaves values of either sign where
0 is meant. So the truth of each condition is decided here, from the state just before
and then from that just after all acts, impacts and changes of modes, and kept: a value
within its rounding of 0 belongs to the side that its rate leads to, until it has left
the rounding.

Just before an instant a condition is false where its value is below 0, or at 0 and
falls. It has been met where it has come to 0, or would within the instant. Afterwards
it becomes true where it was false and is above 0 now, has jumped to 0, or is at 0 and
rises. An equation is met where its value comes to 0 or jumps past it; it is on one of
two sides, and at 0 on that to which it goes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.run.instants import width
from lagsim.tolerances import RESIDUAL_ROUNDOFF, SUM_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.language.arrays import Flags, Floats
    from lagsim.run.arc import Arc

# A miss of 0 counts as this: less than any other, and more than what moves at once.
LEAST = 1e-250
# What is located at 0 but for a part of the sizes that it depends on is known to it:
# constraints have been satisfied by such a part. More is a jump of the condition.
LOCATED = 1e-7
# No condition changes at an instant that is so many times farther from 0 than what
# counted as 0 before.
FAR = 1024.0
# Slopes are differences over this part of the size of a component.
PART = 2.0**-10


class Look(NamedTuple):
    """Conditions at a state, each a function that is >= 0 where it is true.

    Attributes
    ----------
    values : ndarray, shape (C,)
    zero : ndarray, shape (C,)
        Sizes up to which a value is 0: by rounding, and by what changes in an instant.
    rates : ndarray, shape (C,)
        Time derivatives of the values; 0 where only rounding or errors are left of one.
    """

    values: Floats
    zero: Floats
    rates: Floats

    @property
    def clear(self) -> Flags:
        """The conditions that are off 0 (C,)."""
        return np.abs(self.values) > self.zero


def look(arc: Arc, found: int = -1) -> Look:
    """Look at all conditions at the state reached.

    found : the condition that has been located there; its value tells how exactly the
    state is known.
    """
    state, system = arc.state, arc.system
    count, seen = len(state.orientation), arc.seen[state.dynamic]
    values = arc.located(arc.t, arc.y)
    of = arc.runner.function("located_slopes", count * (2 + len(seen)))
    numbers = of(arc.t, arc.y)
    slopes = numbers[count:].reshape(count, -1)
    sizes = np.abs(slopes[:, :-1])
    terms = np.maximum(numbers[:count], sizes @ seen)
    part = SUM_ROUNDOFF
    if found >= 0 and abs(values[found]) <= LOCATED * terms[found]:
        part = max(part, 2.0 * float(abs(values[found]) / (terms[found] or 1.0)))
    n, rates = system.n, np.zeros(len(seen))
    if system.moreau is None:
        rates = arc.rates(arc.t, arc.y)[state.dynamic]
    rates[:n] = arc.y[arc.velocities]
    speeds = np.abs(rates)  # no rate is known better than to a part of these
    speeds[:n] = seen[n : 2 * n]
    speeds[n : 2 * n] = np.maximum(speeds[n : 2 * n], state.parts[:n])
    changes = slopes[:, :-1] @ rates + slopes[:, -1]
    if system.moreau is not None:  # whose accelerations are known after a step only
        changes[sizes[:, n:].any(axis=1)] = 0.0
    moved = sizes @ speeds + np.abs(slopes[:, -1])
    least = max(RESIDUAL_ROUNDOFF, float(arc.plan.tolerance)) * moved
    changes = np.where(np.abs(changes) > least, changes, 0.0)
    zero = part * terms + width(arc.settings, arc.t) * np.abs(changes)
    state.zero[:] = zero
    return Look(values, zero, changes)


def located_within(arc: Arc) -> float:
    """Return the time by which rounding may have moved what has been located."""
    found = int(arc.state.event) - 1
    if found < 0:
        return 0.0
    now = look(arc)
    rate = abs(float(now.rates[found]))
    return float(now.zero[found]) / rate if rate > 0.0 else 0.0


class Truth:
    """Which conditions are true at an instant, and which have become so.

    Written to the memory of the kernels, from which it is read at the next instant.
    """

    def __init__(self, arc: Arc, found: int = -1, *, set_by_modes: bool = True) -> None:
        """Look at the state just before an instant.

        set_by_modes : conditions contain modes that events set.
        """
        self.set_by_modes = set_by_modes
        self.arc, self.state, self.found = arc, arc.state, found
        is_far = self.is_clear = False
        if found < 0 and arc.steps:
            values, zero = arc.located(arc.t, arc.y), arc.state.zero
            self.is_clear = self._are_clear(values)
            is_far = self.is_clear or bool((np.abs(values) > FAR * zero).all())
        if is_far:
            self.now = Look(values, zero.copy(), np.zeros(len(values)))
        else:
            self.now = look(arc, found)

    def _are_clear(self, values: Floats) -> bool:
        """Whether no condition can change unless the state or the modes jump.

        Each is far off 0 on its side, or true for ever. There are few conditions:
        numbers are faster than arrays.
        """
        state = self.state
        arrays = values, state.zero, state.orientation, state.leeway, state.equation
        for value, zero, side, leeway, equation in zip(
            *(x.tolist() for x in arrays), strict=True
        ):
            if side == 0.0 and leeway == math.inf:
                clear = abs(value) > FAR * zero
            else:
                off = value * side if side else value
                clear = off > max(FAR * zero, 4.0 * abs(leeway))
                clear = clear and (side != 0.0 or not equation)
            if not clear:
                return False
        return True

    def begin(self) -> None:
        """Decide the truth of all conditions at the start.

        What is true there but for rounding is true; a condition at 0 that falls is
        false from then on.
        """
        state, now, equation = self.state, self.now, self.state.equation > 0.0
        side, leeway = state.orientation, state.leeway
        fixed = np.isinf(leeway)
        off = now.clear & ((now.values < 0.0) | equation) & ~fixed
        side[:] = np.where(off, np.sign(now.values), 0.0)
        true = ~off & ~fixed
        leeway[true] = 2.0 * now.zero[true]
        self._turn(now)
        true &= side == 0.0
        if true.any() and self.arc.equations.model.constraints:
            give_leeway(self.arc, now.values, true)

    def met(self) -> set[int]:
        """Conditions that are met by the motion up to the instant.

        One that is about to become false at that time counts as false.
        """
        if self.is_clear:
            return set()
        state, now = self.state, self.now
        side, leeway = state.orientation, state.leeway
        misses, comes = now.values * side, now.rates * side < 0.0
        met = misses + leeway <= 0.0
        met |= (misses <= now.zero) & comes
        met &= side != 0.0
        if self.found >= 0:
            met[self.found] = True
        self._turn(now)
        return {*met.nonzero()[0].tolist()}

    def hold(self, conditions: Iterable[int], *, for_ever: Iterable[int] = ()) -> None:
        """Take conditions to be true from now on, some of them for ever."""
        state = self.state
        for c in conditions:
            miss = max(0.0, float(self.now.values[c] * state.orientation[c]))
            state.orientation[c] = 0.0
            state.leeway[c] = 2.0 * (miss + self.now.zero[c])
        state.leeway[list(for_ever)] = np.inf

    def changed(self) -> set[int]:
        """Conditions that become true by what has been set, whatever rates follow."""
        if not self.set_by_modes:
            return set()
        before = self.now
        values = self.arc.located(self.arc.t, self.arc.y)
        self.now = now = before._replace(values=values)
        return self._become(now, before.clear, np.zeros(len(values), bool))

    def settled(self, *, struck: bool) -> set[int]:
        """Conditions that become true by the state just after the instant.

        struck : velocities have jumped.
        """
        if self.is_clear and not (struck or self.set_by_modes):
            return set()
        self.is_clear = False
        before, side = self.now, self.state.orientation
        if not self._may_change(struck=struck):
            return set()
        self.now = now = look(self.arc)
        rises = (now.rates * side < 0.0) & (self.state.equation == 0.0)
        found = self._become(now, before.clear, rises)
        self._turn(now)
        return found

    def _may_change(self, *, struck: bool) -> bool:
        """Whether a condition is close to 0 that is false, or past it that is true.

        One that has been met is at 0; the kernel follows it from there.
        """
        state, before, side = self.state, self.now, self.state.orientation
        values = before.values
        if struck or self.set_by_modes:
            values = self.arc.located(self.arc.t, self.arc.y)
        far = 4.0 * np.maximum(before.zero, np.abs(state.leeway))
        may, true = values * side <= far, side == 0.0
        if true.any():
            past = (values < -far) | ((state.equation > 0.0) & (np.abs(values) > far))
            may[true] = past[true]
        changes = may.any()
        if not changes:
            self.now = before._replace(values=values)
        return bool(changes)

    def _become(self, now: Look, were_clear: Flags, rises: Flags) -> set[int]:
        """Conditions that were false and are true; note those that are false now."""
        state = self.state
        side, leeway = state.orientation, state.leeway
        misses, zero = now.values * side, np.maximum(now.zero, leeway)
        # Below 0 a leeway is that of what an impact has brought there.
        true = (misses < -zero) | ((leeway < 0.0) & (misses + leeway <= 0.0))
        true |= (misses <= zero) & (were_clear | rises)
        true &= side != 0.0
        left = (side == 0.0) & (np.abs(now.values) > zero)
        if left.any():
            left &= (now.values < 0.0) | (state.equation > 0.0)
            side[left], leeway[left] = np.sign(now.values[left]), 0.0
        return {*np.flatnonzero(true).tolist()}

    def _turn(self, now: Look) -> None:
        """Let what is at 0 be on the side to which it goes, until it has left 0."""
        state = self.state
        side, leeway, equation = state.orientation, state.leeway, state.equation > 0.0
        at_zero = np.abs(now.values) <= np.maximum(now.zero, leeway)
        at_zero &= np.isfinite(leeway)
        if not at_zero.any():
            return
        turns = at_zero & np.where(
            equation, now.rates != 0.0, (side == 0.0) & (now.rates < 0.0)
        )  # fmt: skip
        side[turns] = np.sign(now.rates[turns])
        least = 2.0 * np.maximum(now.zero, np.abs(now.values))
        held = at_zero & (now.rates == 0.0) & (side == 0.0) & (leeway <= least)
        leeway[turns | held] = np.maximum(leeway, least)[turns | held]
        if held.any() and self.arc.equations.model.constraints:
            give_leeway(self.arc, now.values, held)


def give_leeway(arc: Arc, values: Floats, which: Flags) -> None:
    """Let some conditions that are true not be false within the tolerance.

    Where a constraint holds one on its edge, as the ground does `y <= 0`, what rounding
    leaves is no change of it. The tolerance is for the sizes of what a condition
    depends on; a velocity at rest has that of its position over the run.
    """
    state, sizes = arc.state, arc.seen.copy()
    speeds = sizes[state.positions] / arc.settings.duration
    sizes[state.velocities] = np.maximum(sizes[state.velocities], speeds)
    scale = np.zeros(len(values))
    for i in np.flatnonzero(sizes[state.dynamic]):
        y = arc.y.copy()
        y[i] += PART * sizes[i]
        with np.errstate(invalid="ignore"):
            scale += np.abs(arc.located(arc.t, y) - values) / PART
    part = float(arc.plan.tolerance)
    if arc.system.moreau is not None:  # whose contacts move by a step's way
        part = max(part, (arc.plan.step or 0.0) / arc.settings.duration)
    which = which & np.isfinite(scale)
    state.leeway[which] = np.maximum(state.leeway, part * scale)[which]


def count_closed(arc: Arc, y: Floats, closed: Floats) -> None:
    """Let conditions be true at the state y that are where its gaps are closed.

    After an impact rounding leaves a gap on either side of 0, and the motion leads away
    from it: `x <= 0` may never be true at the ground `x >= 0`.
    """
    state = arc.state
    if not len(state.orientation):
        return
    misses = arc.located(arc.t, y) * state.orientation
    met = arc.located(arc.t, closed) * state.orientation <= 0.0
    met &= (state.orientation != 0.0) & (state.leeway == 0.0)
    state.leeway[met] = -np.maximum(misses[met], LEAST)
