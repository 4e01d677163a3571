"""Truth of located conditions at an instant: of the events', then of `until`.

The kernels locate where a condition becomes true within a step
(`methods.parts.search`); the arrays `orientation` and `leeway` store on which side of 0
the value of each condition is. At an instant the state, its rates and the modes may
jump, and rounding leaves values of either sign where the exact value is 0. Therefore
the truth of each condition is decided and stored here, first from the state just before
the instant and then from the state just after all acts, impacts and changes of modes. A
value within its rounding of 0 counts as on the side that its rate leads to, until the
value has left the rounding.

Just before an instant a condition is false where its value is below 0, or is 0 and
falls. It is satisfied by the motion where its value has reached 0, or would reach 0
within the instant. After the instant a condition becomes true that was false and whose
value is now above 0, has jumped to 0, or is 0 and rises. An equation is satisfied where
its value reaches 0 or jumps past 0; its value is on one of two sides, and a value of 0
is on the side to which its rate leads.
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

# Least distance of a condition's value from 0 after an impact; smaller than any other
# distance, and not 0.
LEAST = 1e-250
# Largest value at a located zero, relative to the terms of the condition, that counts
# as the error to which the state is known (constraints are satisfied to such an error).
# A larger value is a jump of the condition.
LOCATED = 1e-7
# A condition whose value is farther from 0 than this multiple of its last zero
# tolerance does not change at an instant.
FAR = 1024.0
# Increment of the difference quotients, relative to the size of a component.
PART = 2.0**-10


class Look(NamedTuple):
    """Values of all C conditions at a state; a condition is true where its value >= 0.

    Attributes
    ----------
    values : ndarray, shape (C,)
    zero : ndarray, shape (C,)
        Magnitudes up to which a value counts as 0: its rounding, and its change within
        an instant.
    rates : ndarray, shape (C,)
        Time derivatives of the values; 0 where below rounding or the tolerance.
    """

    values: Floats
    zero: Floats
    rates: Floats

    @property
    def clear(self) -> Flags:
        """Whether each value is off 0 by more than its zero tolerance: shape (C,)."""
        return np.abs(self.values) > self.zero


def look(arc: Arc, found: int = -1) -> Look:
    """Evaluate all conditions at the state reached; store their zero tolerances.

    Parameters
    ----------
    arc : Arc
    found : int
        Index of the condition located there, or -1; its value there bounds the error
        of the state.
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
    speeds = np.abs(rates)  # the errors of the rates are relative to these speeds
    speeds[:n] = seen[n : 2 * n]
    speeds[n : 2 * n] = np.maximum(speeds[n : 2 * n], state.parts[:n])
    changes = slopes[:, :-1] @ rates + slopes[:, -1]
    if system.moreau is not None:  # Moreau's method has accelerations after a step only
        changes[sizes[:, n:].any(axis=1)] = 0.0
    moved = sizes @ speeds + np.abs(slopes[:, -1])
    least = max(RESIDUAL_ROUNDOFF, float(arc.plan.tolerance)) * moved
    changes = np.where(np.abs(changes) > least, changes, 0.0)
    zero = part * terms + width(arc.settings, arc.t) * np.abs(changes)
    state.zero[:] = zero
    return Look(values, zero, changes)


def located_within(arc: Arc) -> float:
    """Return the error, by rounding, of the time of the condition just located."""
    found = int(arc.state.event) - 1
    if found < 0:
        return 0.0
    now = look(arc)
    rate = abs(float(now.rates[found]))
    return float(now.zero[found]) / rate if rate > 0.0 else 0.0


class Truth:
    """Truth of the conditions just before and just after an instant.

    It is stored in the kernels' arrays `orientation` and `leeway`, and read from these
    arrays at the next instant.
    """

    def __init__(self, arc: Arc, found: int = -1, *, set_by_modes: bool = True) -> None:
        """Evaluate the conditions at the state just before an instant.

        Parameters
        ----------
        arc : Arc
        found : int
            Index of the condition located at the instant, or -1.
        set_by_modes : bool
            Whether conditions contain modes that events set.
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

        That is so where each value is far from 0 on its side, or its condition is true
        for ever. There are few conditions: a loop over floats is faster than arrays.
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
        """Store the truth of all conditions at the start of the run.

        A condition that is true there to rounding is true; one whose value is 0 and
        falls is false from then on.
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
        """Return the indices of conditions that the motion satisfies at the instant.

        A condition that is about to become false at that time counts as false, and so
        does one that has become false by a jump of a switch within it.
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
        self._leave(now)
        self._turn(now)
        return {*met.nonzero()[0].tolist()}

    def hold(self, conditions: Iterable[int], *, for_ever: Iterable[int] = ()) -> None:
        """Store that these conditions are true from now on.

        The conditions of `for_ever` remain true for ever: their events never act again.
        """
        state = self.state
        for c in conditions:
            miss = max(0.0, float(self.now.values[c] * state.orientation[c]))
            state.orientation[c] = 0.0
            state.leeway[c] = 2.0 * (miss + self.now.zero[c])
        state.leeway[list(for_ever)] = np.inf

    def changed(self) -> set[int]:
        """Return the conditions that become true by modes set, whatever the rates."""
        if not self.set_by_modes:
            return set()
        before = self.now
        values = self.arc.located(self.arc.t, self.arc.y)
        self.now = now = before._replace(values=values)
        return self._become(now, before.clear, np.zeros(len(values), bool))

    def settled(self, *, struck: bool) -> set[int]:
        """Return the conditions that become true at the state just after the instant.

        struck : whether velocities have jumped.
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
        """Whether a false condition is close to 0, or a true condition is past 0.

        The value of a condition just satisfied is 0; the kernel follows it from there.
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
        """Return the conditions that became true; store the sides of those now false.

        Parameters
        ----------
        now : Look
            The conditions after the change.
        were_clear, rises : ndarray of bool, shape (C,)
            Whether each value was off 0 before, and whether it rises toward truth.
        """
        state = self.state
        side, leeway = state.orientation, state.leeway
        misses, zero = now.values * side, np.maximum(now.zero, leeway)
        # A negative leeway: an impact has left the value about 0, see `count_closed`.
        true = (misses < -zero) | ((leeway < 0.0) & (misses + leeway <= 0.0))
        true |= (misses <= zero) & (were_clear | rises)
        true &= side != 0.0
        self._leave(now)
        return {*np.flatnonzero(true).tolist()}

    def _leave(self, now: Look) -> None:
        """Store the sides of true conditions whose values are off 0 and false."""
        state = self.state
        side, leeway = state.orientation, state.leeway
        left = (side == 0.0) & (np.abs(now.values) > np.maximum(now.zero, leeway))
        if left.any():
            left &= (now.values < 0.0) | (state.equation > 0.0)
            side[left], leeway[left] = np.sign(now.values[left]), 0.0

    def _turn(self, now: Look) -> None:
        """Store the side to which the rate leads, for each value that is at 0."""
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
    """Raise the leeway of some true conditions to the tolerance of their values.

    Where a constraint keeps the value of a condition at 0, as the ground does that of
    `y <= 0`, rounding errors must not make it false. The tolerance of a value is
    relative to the magnitudes of the state components it depends on; that of a velocity
    at rest is the magnitude of its position over the duration of the run.

    Parameters
    ----------
    arc : Arc
    values : ndarray, shape (C,)
        Values of all conditions at the state reached.
    which : ndarray of bool, shape (C,)
        The conditions whose leeway is raised.
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
    if arc.system.moreau is not None:  # its contacts move by up to one step
        part = max(part, (arc.plan.step or 0.0) / arc.settings.duration)
    which = which & np.isfinite(scale)
    state.leeway[which] = np.maximum(state.leeway, part * scale)[which]


def count_closed(arc: Arc, y: Floats, closed: Floats) -> None:
    """Count conditions as true at the state y that are true where its gaps are closed.

    After an impact rounding leaves a gap of either sign, and the motion opens it:
    without this, `x <= 0` may never be true at the ground `x >= 0`.

    Parameters
    ----------
    arc : Arc
    y, closed : ndarray, shape (size,)
        The state after an impact, and this state with the gaps at exactly 0.
    """
    state = arc.state
    if not len(state.orientation):
        return
    misses = arc.located(arc.t, y) * state.orientation
    met = arc.located(arc.t, closed) * state.orientation <= 0.0
    met &= (state.orientation != 0.0) & (state.leeway == 0.0)
    state.leeway[met] = -np.maximum(misses[met], LEAST)
